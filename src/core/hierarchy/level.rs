//! One level: an independent quasi-uniform mesh of the whole body, and its ties to its neighbours.

use crate::geometry::Moments;
use crate::geometry::locate::Host;
use crate::geometry::tet_mesh::TetMesh;
use crate::math::{Real, Vec3};
use nalgebra::{SMatrix, SVector};
use serde::{Deserialize, Serialize};

/// A level as prepared: only read afterwards.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Level {
    /// Rest mesh [m].
    pub mesh: TetMesh,
    /// Typical node distance [m]: the lattice constant of a cover, the mean edge of a given mesh.
    pub spacing: Real,
    /// Part of each element that lies inside the body, 0.1..=1, (n_elements): weighs its stiffness and its mass.
    pub fraction: Vec<Real>,
    /// Density [kg/m³] of each element (n_elements): that of its material but for [`Level::weigh`].
    pub density: Vec<Real>,
    /// Lumped mass [kg] (n_nodes): a quarter of ρ·fraction·volume from each incident element, but not less than
    /// `least_mass`.
    pub node_mass: Vec<Real>,
    /// Smallest altitude of any element [m]: the Courant length.
    pub altitude: Real,
    /// Least mass [kg] that an active node is given. At the border of a cover a node may have next to none: whatever pushes
    /// it, a tool or a spring, would throw it about. 0 on meshes that fill their body.
    pub least_mass: Real,
    /// Part α of the energy of strain jumps that tetrahedra keep, 0 < α ≤ 1; 1: they have all energy. See
    /// [`stars`](crate::model::body::stars).
    pub stabilisation: Real,
    /// Nearest node of the next coarser level (n_nodes); empty on level 0.
    pub parent: Vec<u32>,
    /// Where each node lies in the next coarser level (n_nodes); empty on level 0.
    pub coarser_host: Vec<Host>,
    /// Where each node lies in the next finer level (n_nodes); empty on the finest.
    pub finer_host: Vec<Host>,
    /// Where each display vertex lies in this level (n_vertices).
    pub embedding: Vec<Host>,
    /// Nodes that do not move at all, ascending; only on meshes that conform to the body.
    pub fixed: Vec<u32>,
    /// Ghost nodes, which are never active, ascending: the border of a level that covers only a region of the body, where some
    /// of their elements are left out. Rows on such a level are on element [`NONE`](crate::ids::NONE) where it does not reach.
    pub ghosts: Vec<u32>,
}

impl Level {
    /// A level of `mesh` without ties yet, of one `density` [kg/m³].
    pub fn new(mesh: TetMesh, fraction: Vec<Real>, spacing: Real, density: Real) -> Self {
        let elements = mesh.elements.len();
        let mut level = Self {
            spacing,
            density: vec![density; elements],
            node_mass: Vec::new(),
            altitude: (0..elements).map(|e| mesh.smallest_altitude(e)).fold(Real::INFINITY, Real::min),
            least_mass: 0.0,
            stabilisation: 1.0,
            parent: Vec::new(),
            coarser_host: Vec::new(),
            finer_host: Vec::new(),
            embedding: Vec::new(),
            fixed: Vec::new(),
            ghosts: Vec::new(),
            mesh,
            fraction,
        };
        level.lump(density * level.volume());
        level
    }

    /// Gives the nodes of a level of about `mass` [kg] theirs.
    fn lump(&mut self, mass: Real) {
        let reaches_beyond = self.fraction.iter().any(|w| *w < 1.0);
        self.least_mass = if reaches_beyond { LEAST_MASS * mass / self.mesh.nodes.len() as Real } else { 0.0 };
        self.node_mass.clear();
        self.node_mass.resize(self.mesh.nodes.len(), 0.0);
        for (e, element) in self.mesh.elements.iter().enumerate() {
            let quarter = 0.25 * self.density[e] * self.fraction[e] * self.mesh.volume(e);
            element.iter().for_each(|n| self.node_mass[*n as usize] += quarter);
        }
        self.node_mass.iter_mut().for_each(|m| *m = m.max(self.least_mass));
    }

    /// Gives the level its masses: elements of `density` [kg/m³] (n_elements), on a cover but for a factor near 1 that makes
    /// mass, centre of mass and inertia of the nodes those of `wanted` [kg]. Masses at nodes lie farther out than those of
    /// the elements, by an order of the spacing squared: a level of some hundred nodes would be 4 % harder to turn. (A mesh
    /// that fills its body keeps the masses that finite elements have by custom.)
    ///
    /// Among all factors that do so these differ least from 1 (least squares, by mass): the means over an element's nodes
    /// of one quadratic polynomial of place, none below `LEAST_FACTOR` or above `MOST_FACTOR`. On a level of few nodes
    /// something is left: up to one per cent of the inertia at 400 nodes.
    pub fn weigh(&mut self, density: &[Real], wanted: &Moments) {
        let mass = wanted.volume;
        self.density.copy_from_slice(density);
        self.lump(mass);
        if self.fills_body() {
            return;
        }
        // Ten moments, 1, x, y, z, and the products of two, in radii of gyration about the centre.
        let powers = |u: &Vec3| {
            let d = (u - wanted.centre) / wanted.radius();
            Ten::from([1.0, d.x, d.y, d.z, d.x * d.x, d.y * d.y, d.z * d.z, d.y * d.z, d.x * d.z, d.x * d.y])
        };
        let at_nodes: Vec<Ten> = self.mesh.nodes.iter().map(powers).collect();
        let mean = |element: &[u32; 4]| element.iter().map(|n| at_nodes[*n as usize]).sum::<Ten>() / 4.0;
        let s = wanted.second / (wanted.radius() * wanted.radius());
        let mut goal = Ten::from([mass, 0.0, 0.0, 0.0, s.m11, s.m22, s.m33, s.m23, s.m13, s.m12]);
        let moments = |masses: &[Real]| at_nodes.iter().zip(masses).map(|(p, m)| p * *m).sum::<Ten>();
        // Of what is too much of the inertia so much stays.
        let mut before = moments(&self.node_mass);
        before *= mass / before[0];
        let excess = before.fixed_rows::<3>(4).sum() / mass - 1.0;
        let kept = 1.0 - MOST_TAKEN / excess.max(MOST_TAKEN);
        (4..10).for_each(|k| goal[k] += kept * (before[k] - goal[k]));
        // A few nodes do not tell all moments apart: those then stay as they are.
        let mut gram = SMatrix::<Real, 10, 10>::identity() * (1e-9 * mass);
        for (e, element) in self.mesh.elements.iter().enumerate() {
            let p = mean(element);
            gram += p * p.transpose() * (density[e] * self.fraction[e] * self.mesh.volume(e));
        }
        let Some(gram) = gram.cholesky() else { return };
        let mut polynomial = Ten::zeros();
        // More than once for nodes of the least mass and elements of the least and the largest factor, which do not follow.
        for _ in 0..ROUNDS {
            let left = goal - moments(&self.node_mass);
            if left.amax() <= 1e-12 * mass {
                break;
            }
            polynomial += gram.solve(&left);
            for ((changed, density), element) in self.density.iter_mut().zip(density).zip(&self.mesh.elements) {
                *changed = density * (1.0 + mean(element).dot(&polynomial)).clamp(LEAST_FACTOR, MOST_FACTOR);
            }
            self.lump(mass);
        }
        let rest = mass / self.node_mass.iter().sum::<Real>();
        self.density.iter_mut().chain(&mut self.node_mass).for_each(|m| *m *= rest);
        self.least_mass *= rest;
    }

    /// True for a level of the whole body, false for one of a region.
    pub fn is_whole(&self) -> bool {
        self.ghosts.is_empty()
    }

    /// True for a mesh whose elements fill the body, false for a cover that reaches beyond it.
    pub fn fills_body(&self) -> bool {
        self.least_mass == 0.0
    }

    /// Volume inside the body [m³].
    pub fn volume(&self) -> Real {
        (0..self.mesh.elements.len()).map(|e| self.fraction[e] * self.mesh.volume(e)).sum()
    }

    /// Centre of the lumped masses at rest [m].
    pub fn centre_of_mass(&self) -> Vec3 {
        let moment: Vec3 = self.mesh.nodes.iter().zip(&self.node_mass).map(|(u, m)| u * *m).sum();
        moment / self.node_mass.iter().sum::<Real>()
    }
}

/// Least mass of a node over the mean of its level.
const LEAST_MASS: Real = 0.1;

/// Ten moments, or the coefficients of a quadratic polynomial.
type Ten = SVector<Real, 10>;
/// Factors on the density of an element. Farther from 1 levels of few nodes would no longer answer as the others do: with
/// 0.5 to 1.5 a cube of 149 nodes stretches 5 % otherwise under its weight, and light elements take short steps.
const LEAST_FACTOR: Real = 0.75;
const MOST_FACTOR: Real = 1.25;
/// Most that is taken off the inertia, as a part of it. Where two hundred nodes lost all that they have too much, bodies of
/// mixed levels would twist 2.5 % too fast.
const MOST_TAKEN: Real = 0.07;
/// Most often that the polynomial is mended; fine levels need it three times.
const ROUNDS: usize = 30;

/// Mean edge length of a mesh [m].
pub fn mean_edge(mesh: &TetMesh) -> Real {
    let (mut sum, mut count) = (0.0, 0);
    for e in 0..mesh.elements.len() {
        let u = mesh.corners(e);
        for (i, j) in [(0, 1), (0, 2), (0, 3), (1, 2), (1, 3), (2, 3)] {
            sum += (u[i] - u[j]).norm();
            count += 1;
        }
    }
    sum / count.max(1) as Real
}
