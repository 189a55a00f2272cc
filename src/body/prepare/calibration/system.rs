//! The equations of one level at rest.

use super::block::{Block, ZERO, add_scaled, columns, for_each_node};
use super::direct::Direct;
use super::grid::Grid;
use super::matrix::Rows;
use super::rigid::{Arms, RigidMotion, held_points, rigid_modes, rigid_stiffness};
use palpate_core::geometry::TetMesh;
use palpate_core::geometry::locate::Host;
use palpate_core::hierarchy::Level;
use palpate_core::math::{Mat3, Real};
use palpate_core::model::material::Material;

/// The linear equations of one level at rest, `(elastic + spring) u = load`, by rows of node blocks.
///
/// Rows are gathered, not scattered by elements, so that threads need no order among them. The rows of fixed nodes are
/// empty, which keeps their displacement at zero.
pub(super) struct System<'a> {
    pub(super) level: &'a Level,
    /// None when they do not hold the body firmly; then fixed nodes are left free, too.
    pub(super) holds: Option<&'a [(u32, Real)]>,
    /// The matrix.
    pub(super) rows: Rows,
    /// Inverse of the diagonal blocks [m/N], zero at fixed nodes (n_nodes).
    pub(super) inverse_diagonal: Vec<Block>,
    /// Force that deforms the body, per axis [N] for an acceleration of 1 m/s² (n_nodes).
    pub(super) load: Vec<Block>,
    /// Where each node lies in the next coarser level (n_nodes), or empty.
    pub(super) coarser: Vec<([u32; 4], [Real; 4])>,
    /// The same by coarser node: starts (n_coarser_nodes + 1) into node and weight.
    finer_start: Vec<u32>,
    finer: Vec<(u32, Real)>,
    /// On the coarsest level, one of these.
    pub(super) grid: Option<Grid>,
    pub(super) direct: Option<Direct>,
}

impl<'a> System<'a> {
    /// The equations of level `l`, without load.
    pub(super) fn new(
        levels: &'a [Level],
        l: usize,
        material: &(impl Fn(usize, usize) -> Material + Sync),
        stabilisation: Real,
        holds: Option<&'a [(u32, Real)]>,
    ) -> Self {
        let level = &levels[l];
        let n_nodes = level.mesh.nodes.len();
        let mut fixed = vec![false; n_nodes];
        if holds.is_some() {
            level.fixed.iter().for_each(|n| fixed[*n as usize] = true);
        }
        let mut rows = Rows::elastic(level, |e| material(l, e), stabilisation, &fixed);
        for &(vertex, stiffness) in holds.unwrap_or_default() {
            let (nodes, weights) = row(&level.embedding[vertex as usize], &level.mesh);
            for (a, weight_a) in nodes.iter().zip(weights) {
                for (b, weight_b) in nodes.iter().zip(weights) {
                    if let Some(entry) = rows.entry(*a, *b) {
                        rows.spring[entry] += stiffness * weight_a * weight_b;
                    }
                }
            }
        }
        let inverse = |n: u32| {
            let diagonal = rows.entry(n, n)?;
            // Symmetric, so that rows for columns make no difference.
            let block = Mat3::from(rows.elastic[diagonal]) + Mat3::identity() * rows.spring[diagonal];
            block.try_inverse().map(Block::from)
        };
        let inverse_diagonal = (0..n_nodes as u32).map(|n| inverse(n).unwrap_or(ZERO)).collect();
        let coarser: Vec<_> = match l {
            0 => Vec::new(),
            _ => level.coarser_host.iter().map(|host| row(host, &levels[l - 1].mesh)).collect(),
        };
        let (finer_start, finer) = transposed(&coarser, if l == 0 { 0 } else { levels[l - 1].mesh.nodes.len() });
        let mut system = System {
            level,
            holds,
            rows,
            inverse_diagonal,
            load: Vec::new(),
            coarser,
            finer_start,
            finer,
            grid: None,
            direct: None,
        };
        if l == 0 {
            system.direct = Direct::new(&system.rows, holds.is_some());
            if system.direct.is_none() {
                system.grid = Grid::new(level, &system.rows);
            }
        }
        system
    }

    /// Gives level `l`, which this is of, another stabilisation.
    pub(super) fn set_stabilisation(
        &mut self,
        levels: &'a [Level],
        l: usize,
        material: &(impl Fn(usize, usize) -> Material + Sync),
        stabilisation: Real,
    ) {
        let load = std::mem::take(&mut self.load);
        *self = System { load, ..System::new(levels, l, material, stabilisation, self.holds) };
    }

    /// Sets the load, less what the holds bear while the body moves on them as a whole: what is left deforms it.
    pub(super) fn bear(&mut self, load: &[Block]) {
        let borne = self.in_place(&self.rigid_motion(load));
        let left = |(n, load): (usize, &Block)| {
            let mut left = *load;
            add_scaled(&mut left, -1.0, &self.force_of_holds(n, &borne));
            left
        };
        self.load = load.iter().enumerate().map(left).collect();
    }

    /// How `forces` would move the body on its springs if elements were rigid; not at all with fixed nodes.
    pub(super) fn rigid_motion(&self, forces: &[Block]) -> RigidMotion {
        let springs = self.holds.filter(|_| self.level.fixed.is_empty()).unwrap_or_default();
        rigid_stiffness(held_points(self.level, springs)).cholesky().map_or(RigidMotion::zeros(), |stiffness| {
            let arms = Arms::new(self.level);
            let mut resultant = RigidMotion::zeros();
            for (u, force) in self.level.mesh.nodes.iter().zip(forces) {
                resultant += rigid_modes(arms.to(u)).transpose() * columns(force);
            }
            stiffness.solve(&resultant)
        })
    }

    /// The displacement of each node in a rigid motion.
    pub(super) fn in_place(&self, motion: &RigidMotion) -> Vec<Block> {
        let arms = Arms::new(self.level);
        // nalgebra stores columns, a block rows.
        self.level.mesh.nodes.iter().map(|u| (rigid_modes(arms.to(u)) * motion).transpose().into()).collect()
    }

    /// Force of the springs on node `n` [N] at the displacements `u`, backwards.
    pub(super) fn force_of_holds(&self, n: usize, u: &[Block]) -> Block {
        let mut force = ZERO;
        for entry in self.rows.of(n) {
            add_scaled(&mut force, self.rows.spring[entry], &u[self.rows.column[entry] as usize]);
        }
        force
    }

    /// True for a node that does not move.
    pub(super) fn is_fixed(&self, n: usize) -> bool {
        self.rows.of(n).is_empty()
    }

    /// True when each node has a place in the next coarser level.
    pub(super) fn is_tied(&self) -> bool {
        !self.coarser.is_empty() && self.coarser.len() + 1 == self.rows.start.len()
    }

    /// Adds the coarser level's displacement, interpolated; fixed nodes stay.
    pub(super) fn add_from_coarser(&self, coarse: &[Block], fine: &mut [Block]) {
        if !self.is_tied() {
            return;
        }
        for_each_node(fine, |n, u| {
            if !self.is_fixed(n) {
                let (nodes, weights) = &self.coarser[n];
                for (c, weight) in nodes.iter().zip(weights) {
                    add_scaled(u, *weight, &coarse[*c as usize]);
                }
            }
        });
    }

    /// Forces on this level's nodes, handed to the coarser level's through the same rows.
    pub(super) fn to_coarser(&self, fine: &[Block]) -> Vec<Block> {
        let mut coarse = vec![ZERO; self.finer_start.len() - 1];
        for_each_node(&mut coarse, |c, f| {
            for (n, weight) in &self.finer[self.finer_start[c] as usize..self.finer_start[c + 1] as usize] {
                add_scaled(f, *weight, &fine[*n as usize]);
            }
        });
        coarse
    }

    /// Force of node `n` [N] at the displacements `u`: row `n` of the matrix times `u`.
    pub(super) fn force(&self, n: usize, u: &[Block]) -> Block {
        let (mut elastic, mut spring) = (ZERO, ZERO);
        for entry in self.rows.of(n) {
            let (u, k) = (&u[self.rows.column[entry] as usize], &self.rows.elastic[entry]);
            for i in 0..3 {
                for j in 0..3 {
                    elastic[i][j] += k[i][0] * u[0][j] + k[i][1] * u[1][j] + k[i][2] * u[2][j];
                }
            }
            add_scaled(&mut spring, self.rows.spring[entry], u);
        }
        add_scaled(&mut spring, 1.0, &elastic);
        spring
    }
}

/// The four nodes that carry a point of `mesh`, and their weights.
pub(super) fn row(host: &Host, mesh: &TetMesh) -> ([u32; 4], [Real; 4]) {
    (mesh.elements[host.element as usize], host.weights)
}

/// Rows of four weights by column: starts (n_columns + 1) into row and weight.
fn transposed(rows: &[([u32; 4], [Real; 4])], n_columns: usize) -> (Vec<u32>, Vec<(u32, Real)>) {
    let mut start = vec![0u32; n_columns + 1];
    for &c in rows.iter().flat_map(|(columns, _)| columns) {
        start[c as usize + 1] += 1;
    }
    for c in 1..start.len() {
        start[c] += start[c - 1];
    }
    let mut next = start.clone();
    let mut list = vec![(0, 0.0); rows.len() * 4];
    for (n, (columns, weights)) in rows.iter().enumerate() {
        for (c, weight) in columns.iter().zip(weights) {
            list[next[*c as usize] as usize] = (n as u32, *weight);
            next[*c as usize] += 1;
        }
    }
    (start, list)
}
