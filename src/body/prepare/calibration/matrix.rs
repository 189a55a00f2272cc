//! The stiffness of one level at rest, by rows of node blocks.

use super::block::{Block, CHUNK};
use palpate_core::geometry::tet_mesh::{gradients, volume};
use palpate_core::hierarchy::Level;
use palpate_core::math::{Mat3, Real, Vec3, symmetric};
#[cfg(doc)]
use palpate_core::model::Fibres;
use palpate_core::model::body::stars;
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

    /// The elastic stiffness of a level, of smoothed elements ([`stars`]) where its `stabilisation` is below 1; fixed nodes get
    /// empty rows.
    pub(super) fn elastic(
        level: &Level,
        material: impl Fn(usize) -> Material + Sync,
        stabilisation: Real,
        fixed: &[bool],
    ) -> Self {
        let mesh = &level.mesh;
        let n_nodes = mesh.nodes.len();
        let corners: Vec<(u32, u32)> = {
            let all = mesh.elements.iter().enumerate();
            let mut corners: Vec<_> = all.flat_map(|(e, nodes)| nodes.map(|n| (n, e as u32))).collect();
            corners.sort_unstable();
            corners
        };
        let starts: Vec<usize> = (0..=n_nodes).map(|n| corners.partition_point(|c| (c.0 as usize) < n)).collect();
        let around = |n: usize| corners[starts[n]..starts[n + 1]].iter().map(|corner| corner.1 as usize);
        let star = |n: usize| Element::star(level, around(n), &material, stabilisation);
        let smoothed = if stabilisation < 1.0 { n_nodes } else { 0 };
        let stars: Vec<Element> = (0..smoothed).into_par_iter().map(star).collect();
        let row = |n: usize| {
            let mut row: Vec<(u32, Block)> = Vec::with_capacity(28);
            if fixed[n] {
                return row;
            }
            around(n).for_each(|e| {
                Element::tetrahedron(level, e, &stars::of_jumps(&material(e), stabilisation)).add_row(n, &mut row);
            });
            // Any two nodes of a star are its node's neighbours: those around it have node `n` in theirs.
            if let Some(own) = stars.get(n) {
                own.weights.iter().for_each(|(m, _)| stars[*m as usize].add_row(n, &mut row));
            }
            row.sort_unstable_by_key(|(column, _)| *column);
            row
        };
        let mut start = vec![0];
        let (mut column, mut block) = (Vec::new(), Vec::new());
        // Some at a time: all of them twice would be most of the memory that preparing a body takes.
        for first in (0..n_nodes).step_by(CHUNK) {
            let rows: Vec<_> = (first..n_nodes.min(first + CHUNK)).into_par_iter().map(row).collect();
            for row in rows {
                for (c, b) in row {
                    column.push(c);
                    block.push(b);
                }
                start.push(column.len() as u32);
            }
        }
        Self { spring: vec![0.0; column.len()], start, column, elastic: block }
    }
}

/// A tetrahedron or a star, at rest.
struct Element {
    /// Its nodes, and the gradients of their weights [1/m].
    weights: Vec<(u32, Vec3)>,
    /// λ times its volume [N·m].
    lambda: Real,
    /// μ times its volume [N·m].
    mu: Real,
    /// What its fibres add, [`Fibres::rows`]: the stress `(M : ε) M`.
    fibres: Mat3,
}

impl Element {
    /// Element `e`, of `material`.
    fn tetrahedron(level: &Level, e: usize, material: &Material) -> Self {
        let (gradients, volume) = weights_of(&level.mesh.corners(e));
        Self {
            weights: level.mesh.elements[e].into_iter().zip(gradients).collect(),
            lambda: material.lambda * level.fraction[e] * volume,
            mu: material.mu * level.fraction[e] * volume,
            fibres: symmetric(material.fibres.rows(level.fraction[e] * volume)),
        }
    }

    /// The star of the node that has the elements `around`.
    fn star(
        level: &Level,
        around: impl Iterator<Item = usize> + Clone,
        material: impl Fn(usize) -> Material,
        stabilisation: Real,
    ) -> Self {
        let mut weights: Vec<(u32, Vec3)> = Vec::with_capacity(16);
        let mut volume = 0.0;
        for e in around.clone() {
            let (gradients, all) = weights_of(&level.mesh.corners(e));
            let quarter = level.fraction[e] * all / 4.0;
            volume += quarter;
            for (m, gradient) in level.mesh.elements[e].into_iter().zip(gradients) {
                let place = place(&mut weights, m);
                weights[place].1 += gradient * quarter;
            }
        }
        weights.iter_mut().for_each(|(_, gradient)| *gradient /= volume);
        let materials: Vec<(Material, Real)> =
            around.map(|e| (material(e), level.fraction[e] * level.mesh.volume(e))).collect();
        let mean = stars::mean(materials.iter().copied());
        let of_means = mean.map(|mean| stars::of_means(&mean, stabilisation));
        let of = |modulus: fn(&Material) -> Real| of_means.as_ref().map_or(0.0, |material| volume * modulus(material));
        let fibres = of_means.map_or_else(Mat3::zeros, |material| symmetric(material.fibres.rows(volume)));
        Self { weights, lambda: of(|material| material.lambda), mu: of(|material| material.mu), fibres }
    }

    /// Adds its part of the `row` of node `n`, if that is one of its nodes.
    fn add_row(&self, n: usize, row: &mut Vec<(u32, Block)>) {
        let (lambda, mu) = (self.lambda, self.mu);
        let Some((_, ga)) = self.weights.iter().find(|(m, _)| *m as usize == n) else { return };
        for (m, gb) in &self.weights {
            let place = place(row, *m);
            let both = mu * ga.dot(gb);
            for i in 0..3 {
                for j in 0..3 {
                    row[place].1[i][j] += lambda * ga[i] * gb[j] + mu * gb[i] * ga[j];
                }
                row[place].1[i][i] += both;
            }
            if self.fibres != Mat3::zeros() {
                let along = (self.fibres * ga) * (self.fibres * gb).transpose();
                (0..3).for_each(|i| (0..3).for_each(|j| row[place].1[i][j] += along[(i, j)]));
            }
        }
    }
}

/// Place of node `n` in a list, to whose end it comes if it is not there.
fn place<T: Default>(list: &mut Vec<(u32, T)>, n: u32) -> usize {
    list.iter().position(|(m, _)| *m == n).unwrap_or_else(|| {
        list.push((n, T::default()));
        list.len() - 1
    })
}

/// Gradients of the four barycentric coordinates [1/m] of the tetrahedron `u`, whose sum is nothing to the last bit so that
/// a shift costs no force, and its volume [m³].
pub(super) fn weights_of(u: &[Vec3; 4]) -> ([Vec3; 4], Real) {
    let [_, g1, g2, g3] = gradients(u);
    ([-(g1 + g2 + g3), g1, g2, g3], volume(u))
}
