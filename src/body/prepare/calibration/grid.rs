//! The coarsest correction, solved directly.

use super::block::Block;
use super::matrix::Rows;
use palpate_core::hierarchy::Level;
use palpate_core::math::{Bounds, Real, Vec3};

/// A box grid around the coarsest level, coarse enough to be solved directly: what moves large parts of the body.
pub(super) struct Grid {
    /// Grid points around each node, and their weights there (n_nodes): trilinear.
    rows: Vec<([u32; 8], [Real; 8])>,
    /// Cholesky factor of the stiffness between grid points, lower rows one after the other [√(N/m)].
    factor: Vec<Real>,
    /// Three times the grid points.
    size: usize,
}

/// Most points of the grid: the direct solution costs their square in each iteration.
const MOST_GRID_POINTS: usize = 150;

impl Grid {
    /// None when the mesh has no extent or its stiffness is not finite.
    pub(super) fn new(level: &Level, stiff: &Rows) -> Option<Grid> {
        let nodes = &level.mesh.nodes;
        let low = Bounds::of(nodes.iter().copied()).low;
        let extent = nodes.iter().fold(0.0, |extent: Real, u| extent.max((u - low).max()));
        // The eight grid points around a node, as whole numbers of cells.
        let around = |u: &Vec3, cell: Real| {
            let first = ((u - low) / cell).map(Real::floor);
            [0, 1, 2, 3, 4, 5, 6, 7].map(|c| [0, 1, 2].map(|i| first[i] as u32 + (c >> i & 1)))
        };
        let mut cell = (2.0 * level.spacing).max(extent / 32.0);
        if !(cell > 0.0 && cell.is_finite()) {
            return None;
        }
        let points = loop {
            let mut points: Vec<[u32; 3]> = nodes.iter().flat_map(|u| around(u, cell)).collect();
            points.sort_unstable();
            points.dedup();
            // One cell around all of it has eight.
            if points.len() <= MOST_GRID_POINTS {
                break points;
            }
            cell *= 1.2;
        };
        let row = |u: &Vec3| {
            let corners = around(u, cell);
            let weight = |c: &[u32; 3]| {
                (0..3).map(|i| 1.0 - ((u[i] - low[i]) / cell - Real::from(c[i])).abs()).product::<Real>()
            };
            (corners.map(|c| points.binary_search(&c).unwrap_or(0) as u32), corners.each_ref().map(weight))
        };
        let mut rows: Vec<_> = nodes.iter().map(row).collect();
        for (_, (_, weights)) in rows.iter_mut().enumerate().filter(|(n, _)| stiff.of(*n).is_empty()) {
            *weights = [0.0; 8];
        }

        let size = 3 * points.len();
        let mut stiffness = vec![0.0; size * size];
        for (n, row) in rows.iter().enumerate() {
            for entry in stiff.of(n) {
                let mut k = stiff.elastic[entry];
                (0..3).for_each(|i| k[i][i] += stiff.spring[entry]);
                let column = &rows[stiff.column[entry] as usize];
                for (a, weight_a) in row.0.iter().zip(row.1) {
                    for (b, weight_b) in column.0.iter().zip(column.1) {
                        // The lower triangle is all that the factor reads.
                        for i in 0..3 {
                            for j in 0..3 {
                                stiffness[(3 * *a as usize + i) * size + 3 * *b as usize + j] +=
                                    weight_a * weight_b * k[i][j];
                            }
                        }
                    }
                }
            }
        }
        // Points that barely touch the body, and a free body's rigid motions, would leave pivots of rounding errors.
        let trace: Real = (0..size).map(|i| stiffness[i * size + i]).sum();
        (0..size).for_each(|i| stiffness[i * size + i] += 1e-6 * trace / size as Real);
        cholesky(&mut stiffness, size).then_some(Grid { rows, factor: stiffness, size })
    }

    /// Adds to `z` the displacement that balances the forces `r` on the grid points.
    pub(super) fn add_correction(&self, r: &[Block], z: &mut [Block]) {
        let mut x = vec![[0.0; 3]; self.size];
        for ((points, weights), r) in self.rows.iter().zip(r) {
            for (point, weight) in points.iter().zip(weights) {
                for i in 0..3 {
                    (0..3).for_each(|j| x[3 * *point as usize + i][j] += weight * r[i][j]);
                }
            }
        }
        let row = |i: usize| &self.factor[i * self.size..i * self.size + i + 1];
        for i in 0..self.size {
            let mut sum = x[i];
            for (l, x) in row(i)[..i].iter().zip(&x) {
                (0..3).for_each(|j| sum[j] -= l * x[j]);
            }
            x[i] = sum.map(|s| s / row(i)[i]);
        }
        for i in (0..self.size).rev() {
            x[i] = x[i].map(|s| s / row(i)[i]);
            let known = x[i];
            for (l, x) in row(i)[..i].iter().zip(&mut x) {
                (0..3).for_each(|j| x[j] -= l * known[j]);
            }
        }
        for ((points, weights), z) in self.rows.iter().zip(z) {
            for (point, weight) in points.iter().zip(weights) {
                for i in 0..3 {
                    (0..3).for_each(|j| z[i][j] += weight * x[3 * *point as usize + i][j]);
                }
            }
        }
    }
}

/// Replaces the lower triangle of a symmetric matrix (rows one after the other) by its Cholesky factor; false when the
/// matrix is not positive.
fn cholesky(matrix: &mut [Real], size: usize) -> bool {
    for i in 0..size {
        let (above, row) = matrix.split_at_mut(i * size);
        for j in 0..i {
            let other = &above[j * size..j * size + j + 1];
            let sum: Real = row[..j].iter().zip(other).map(|(a, b)| a * b).sum();
            row[j] = (row[j] - sum) / other[j];
        }
        let pivot = row[i] - row[..i].iter().map(|a| a * a).sum::<Real>();
        #[expect(clippy::neg_cmp_op_on_partial_ord, reason = "NaN is not positive, too")]
        if !(pivot > 0.0) {
            return false;
        }
        row[i] = pivot.sqrt();
    }
    true
}
