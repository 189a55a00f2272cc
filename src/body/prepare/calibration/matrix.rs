//! The stiffness of one level at rest, by rows of node blocks.

use super::block::{Block, ZERO};
use palpate_core::geometry::tet_mesh::{gradients, volume};
use palpate_core::hierarchy::Level;
use palpate_core::math::{Real, Vec3};
use palpate_core::model::material::Material;
use rayon::prelude::*;
use std::ops::Range;

/// Rows of the matrix; those of fixed nodes are empty.
pub(super) struct Rows {
    /// Row starts (n_nodes + 1) into the three lists below.
    pub(super) start: Vec<u32>,
    /// Node of each entry, ascending within a row.
    pub(super) column: Vec<u32>,
    /// Elastic stiffness [N/m].
    pub(super) elastic: Vec<Block>,
    /// Stiffness of the holds [N/m], the same along each axis.
    pub(super) spring: Vec<Real>,
}

impl Rows {
    /// Entries of row `n`.
    pub(super) fn of(&self, n: usize) -> Range<usize> {
        self.start[n] as usize..self.start[n + 1] as usize
    }

    /// Index of column `b` in row `a`; none in the rows of fixed nodes.
    pub(super) fn entry(&self, a: u32, b: u32) -> Option<usize> {
        let row = self.of(a as usize);
        let first = row.start;
        self.column[row].binary_search(&b).ok().map(|i| first + i)
    }

    /// The elastic stiffness of a level; fixed nodes get empty rows.
    pub(super) fn elastic(level: &Level, material: impl Fn(usize) -> Material + Sync, fixed: &[bool]) -> Self {
        let mesh = &level.mesh;
        let n_nodes = mesh.nodes.len();
        let corners: Vec<(u32, u32)> = {
            let all = mesh.elements.iter().enumerate();
            let mut corners: Vec<_> = all.flat_map(|(e, nodes)| nodes.map(|n| (n, e as u32))).collect();
            corners.sort_unstable();
            corners
        };
        let starts: Vec<usize> = (0..=n_nodes).map(|n| corners.partition_point(|c| (c.0 as usize) < n)).collect();
        let row = |n: usize| {
            let mut row: Vec<(u32, Block)> = Vec::with_capacity(28);
            if fixed[n] {
                return row;
            }
            for &(_, e) in &corners[starts[n]..starts[n + 1]] {
                let (e, u) = (e as usize, mesh.corners(e as usize));
                let (gradients, volume) = weights_of(&u);
                let material = material(e);
                let lambda = material.lambda * level.fraction[e] * volume;
                let mu = material.mu * level.fraction[e] * volume;
                let nodes = mesh.elements[e];
                let Some(a) = nodes.iter().position(|m| *m as usize == n) else { continue };
                let ga = gradients[a];
                for (m, gb) in nodes.into_iter().zip(gradients) {
                    let place = row.iter().position(|(column, _)| *column == m).unwrap_or_else(|| {
                        row.push((m, ZERO));
                        row.len() - 1
                    });
                    let both = mu * ga.dot(&gb);
                    for i in 0..3 {
                        for j in 0..3 {
                            row[place].1[i][j] += lambda * ga[i] * gb[j] + mu * gb[i] * ga[j];
                        }
                        row[place].1[i][i] += both;
                    }
                }
            }
            row.sort_unstable_by_key(|(column, _)| *column);
            row
        };
        let rows: Vec<_> = (0..n_nodes).into_par_iter().map(row).collect();
        let mut start = vec![0];
        let (mut column, mut block) = (Vec::new(), Vec::new());
        for row in rows {
            for (c, b) in row {
                column.push(c);
                block.push(b);
            }
            start.push(column.len() as u32);
        }
        Self { spring: vec![0.0; column.len()], start, column, elastic: block }
    }
}

/// Gradients of the four barycentric coordinates [1/m] of the tetrahedron `u`, whose sum is nothing to the last bit so that
/// a shift costs no force, and its volume [m³].
pub(super) fn weights_of(u: &[Vec3; 4]) -> ([Vec3; 4], Real) {
    let [_, g1, g2, g3] = gradients(u);
    ([-(g1 + g2 + g3), g1, g2, g3], volume(u))
}
