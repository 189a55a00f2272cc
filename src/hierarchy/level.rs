//! One level: an independent quasi-uniform mesh of the whole body, and its ties to its neighbours.

use crate::geometry::locate::Host;
use crate::geometry::tet_mesh::TetMesh;
use crate::math::{Real, Vec3};
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
    /// Lumped mass [kg] (n_nodes): a quarter of ρ·fraction·volume from each incident element, scaled so that the sum
    /// is the body's mass.
    pub node_mass: Vec<Real>,
    /// Smallest altitude of any element [m]: the Courant length.
    pub altitude: Real,
    /// Least mass [kg] that an active node is given. At the rim of a cover a node may have next to none: whatever pushes
    /// it, a tool or a spring, would throw it about. 0 on meshes that fill their body.
    pub least_mass: Real,
    /// Density [kg/m³] with which the node masses sum to the body's mass: that of the material on a mesh that fills the
    /// body, a little more where elements were dropped.
    pub density: Real,
    /// Factor on the stiffness of each element (n_elements), which makes the level answer to smooth loads as the finest
    /// one does: coarse linear tetrahedra are too stiff.
    pub stiffness_factor: Vec<Real>,
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
    /// Nodes that are never active, ascending: on the rim of a level that covers only a region of the body, where some
    /// of their elements are left out. Rows on such a level are on element [`NOWHERE`] where it does not reach.
    pub rim: Vec<u32>,
}

/// Stands for the element of a place that a level does not reach.
pub const NOWHERE: u32 = u32::MAX;

impl Level {
    /// A level of `mesh` without ties yet. `density` [kg/m³]; `mass` [kg] is what the node masses are scaled to sum to.
    pub fn new(mesh: TetMesh, fraction: Vec<Real>, spacing: Real, density: Real, mass: Option<Real>) -> Self {
        let mut node_mass = vec![0.0; mesh.nodes.len()];
        let mut altitude = Real::INFINITY;
        for (e, element) in mesh.elements.iter().enumerate() {
            altitude = altitude.min(mesh.smallest_altitude(e));
            let quarter = 0.25 * density * fraction[e] * mesh.volume(e);
            for &n in element {
                node_mass[n as usize] += quarter;
            }
        }
        let mut factor = 1.0;
        if let Some(mass) = mass {
            factor = mass / node_mass.iter().sum::<Real>();
        }
        let least_mass = if fraction.iter().any(|w| *w < 1.0) {
            LEAST_MASS * factor * node_mass.iter().sum::<Real>() / node_mass.len() as Real
        } else {
            0.0
        };
        node_mass.iter_mut().for_each(|m| *m = (*m * factor).max(least_mass));
        if let Some(mass) = mass {
            let factor = mass / node_mass.iter().sum::<Real>();
            node_mass.iter_mut().for_each(|m| *m *= factor);
        }
        Self {
            stiffness_factor: vec![1.0; mesh.elements.len()],
            mesh,
            spacing,
            fraction,
            node_mass,
            altitude,
            least_mass,
            density: density * factor,
            parent: Vec::new(),
            coarser_host: Vec::new(),
            finer_host: Vec::new(),
            embedding: Vec::new(),
            fixed: Vec::new(),
            rim: Vec::new(),
        }
    }

    /// True for a level of the whole body, false for one of a region.
    pub fn is_whole(&self) -> bool {
        self.rim.is_empty()
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
