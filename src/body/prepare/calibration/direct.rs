//! The coarsest level of a slender or branched body, solved directly.
//!
//! Of our own because libraries' factors take the instructions that a machine has: the same input is to give the same
//! bytes on all of them.

use super::block::Block;
use super::matrix::Rows;
use palpate_core::math::Real;
use std::collections::VecDeque;

/// A Cholesky factor within the envelope of the matrix. Along a rod or a limb, which a box grid is too coarse to bend,
/// nodes can be numbered so that each has its neighbours close before it.
pub(super) struct Direct {
    /// Nodes in the order of the rows.
    order: Vec<u32>,
    /// First column of each row, and where in `factor` the row starts (3 n_nodes + 1 for the latter).
    first: Vec<usize>,
    start: Vec<usize>,
    /// Rows from their first column to the diagonal [√(N/m)].
    factor: Vec<Real>,
}

/// Levels of fewer nodes are those of compact bodies, for which the grid does well.
const FEWEST_NODES: usize = 600;
/// Most entries of the factor: twice of them are multiplied in each iteration.
const MOST_ENTRIES: usize = 300_000;

impl Direct {
    /// None where the grid does as well, for a body that nothing holds, of whose rigid motions roundings would make much, or
    /// when the stiffness is not finite.
    pub(super) fn new(rows: &Rows, is_held: bool) -> Option<Direct> {
        let nodes = rows.start.len() - 1;
        if nodes < FEWEST_NODES || !is_held {
            return None;
        }
        let order = order(rows);
        let mut place = vec![0; nodes];
        order.iter().enumerate().for_each(|(i, n)| place[*n as usize] = i);
        // Rows of fixed nodes are empty, and what rows of others have of them has no effect.
        let entries = |n: u32| {
            let row = rows.start[n as usize] as usize..rows.start[n as usize + 1] as usize;
            row.filter(|entry| is_free(rows, rows.column[*entry]))
        };
        let (mut first, mut start) = (Vec::with_capacity(3 * nodes), vec![0]);
        for (i, n) in order.iter().enumerate() {
            let least = entries(*n).map(|entry| place[rows.column[entry] as usize]).fold(i, usize::min);
            for row in 3 * i..3 * i + 3 {
                first.push(3 * least);
                start.push(start[row] + row + 1 - 3 * least);
            }
        }
        if start[3 * nodes] > MOST_ENTRIES {
            return None;
        }
        let mut factor = vec![0.0; start[3 * nodes]];
        for (i, n) in order.iter().enumerate() {
            for entry in entries(*n) {
                let (j, mut k) = (place[rows.column[entry] as usize], rows.elastic[entry]);
                (0..3).for_each(|c| k[c][c] += rows.spring[entry]);
                for (a, row) in (3 * i..).zip(&k) {
                    for (b, value) in (3 * j..).zip(row).filter(|(b, _)| *b <= a) {
                        factor[start[a] + b - first[a]] = *value;
                    }
                }
            }
        }
        // Soft holds would leave pivots of rounding errors; and fixed nodes do not give way at all.
        let diagonal = |row: usize| start[row + 1] - 1;
        let mean = (0..3 * nodes).map(|row| factor[diagonal(row)]).sum::<Real>() / (3 * nodes) as Real;
        let added = |row: usize| if is_free(rows, order[row / 3]) { ADDED * mean } else { Real::INFINITY };
        (0..3 * nodes).for_each(|row| factor[diagonal(row)] += added(row));
        let mut direct = Direct { order, first, start, factor };
        direct.factorize().then_some(direct)
    }

    fn row(&self, row: usize) -> &[Real] {
        &self.factor[self.start[row]..self.start[row + 1]]
    }

    /// Replaces the matrix by its factor; false when it is not positive.
    fn factorize(&mut self) -> bool {
        for i in 0..self.first.len() {
            let (above, row) = self.factor.split_at_mut(self.start[i]);
            for j in self.first[i]..i {
                let other = &above[self.start[j]..self.start[j + 1]];
                let from = self.first[i].max(self.first[j]);
                let sum = product(&row[from - self.first[i]..j - self.first[i]], &other[from - self.first[j]..]);
                row[j - self.first[i]] = (row[j - self.first[i]] - sum) / other[j - self.first[j]];
            }
            let before = &row[..i - self.first[i]];
            let pivot = row[i - self.first[i]] - product(before, before);
            #[expect(clippy::neg_cmp_op_on_partial_ord, reason = "NaN is not positive, too")]
            if !(pivot > 0.0) {
                return false;
            }
            row[i - self.first[i]] = pivot.sqrt();
        }
        true
    }

    /// The displacement that balances the forces `r`; none of fixed nodes.
    pub(super) fn correction(&self, r: &[Block]) -> Vec<Block> {
        let mut x: Vec<[Real; 3]> = self.order.iter().flat_map(|n| r[*n as usize]).collect();
        for i in 0..x.len() {
            let row = self.row(i);
            let (before, at) = x.split_at_mut(i);
            let (last, row) = (row[row.len() - 1], &row[..row.len() - 1]);
            let mut sum = at[0];
            for (l, x) in row.iter().zip(&before[self.first[i]..]) {
                (0..3).for_each(|axis| sum[axis] -= l * x[axis]);
            }
            at[0] = sum.map(|s| s / last);
        }
        for i in (0..x.len()).rev() {
            let row = self.row(i);
            let (before, at) = x.split_at_mut(i);
            let (last, row) = (row[row.len() - 1], &row[..row.len() - 1]);
            at[0] = at[0].map(|s| s / last);
            for (l, x) in row.iter().zip(&mut before[self.first[i]..]) {
                (0..3).for_each(|axis| x[axis] -= l * at[0][axis]);
            }
        }
        let mut z = vec![[[0.0; 3]; 3]; r.len()];
        for (n, rows) in self.order.iter().zip(x.chunks_exact(3)) {
            z[*n as usize].copy_from_slice(rows);
        }
        z
    }
}

/// Added to the diagonal, as a part of its mean.
const ADDED: Real = 1e-10;

/// Sum of the products of the entries that both have.
fn product(a: &[Real], b: &[Real]) -> Real {
    let length = a.len().min(b.len());
    let (a, b) = (a[..length].chunks_exact(4), b[..length].chunks_exact(4));
    let rest: Real = a.remainder().iter().zip(b.remainder()).map(|(a, b)| a * b).sum();
    // Four sums at once, always the same four.
    let mut sums = [0.0; 4];
    for (a, b) in a.zip(b) {
        (0..4).for_each(|i| sums[i] += a[i] * b[i]);
    }
    sums.iter().sum::<Real>() + rest
}

/// False for fixed nodes.
fn is_free(rows: &Rows, n: u32) -> bool {
    rows.start[n as usize] < rows.start[n as usize + 1]
}

/// Nodes so that neighbours are close to each other [Cuthill and McKee 1969, reversed]: from one end of the body to the
/// other, pieces that fixed nodes cut off one after the other.
fn order(rows: &Rows) -> Vec<u32> {
    let nodes = rows.start.len() - 1;
    let around = |n: u32| &rows.column[rows.start[n as usize] as usize..rows.start[n as usize + 1] as usize];
    let mut reached = vec![0u32; nodes];
    let mut round = 0;
    // All that hangs together with `first`, from near to far, fewer neighbours first.
    let mut walk = |first: u32| {
        round += 1;
        let (mut order, mut open) = (Vec::new(), VecDeque::from([first]));
        reached[first as usize] = round;
        while let Some(n) = open.pop_front() {
            order.push(n);
            let mut next: Vec<u32> = Vec::new();
            for m in around(n).iter().filter(|m| is_free(rows, **m)) {
                if std::mem::replace(&mut reached[*m as usize], round) != round {
                    next.push(*m);
                }
            }
            next.sort_by_key(|m| (around(*m).len(), *m));
            open.extend(next);
        }
        order
    };
    let mut all: Vec<u32> = Vec::with_capacity(nodes);
    let mut placed = vec![false; nodes];
    for n in 0..nodes as u32 {
        if placed[n as usize] {
            continue;
        }
        // The last to be reached lies at an end, the last from there at the other.
        let mut piece = walk(n);
        for _ in 0..2 {
            piece = walk(piece[piece.len() - 1]);
        }
        for m in piece {
            if !std::mem::replace(&mut placed[m as usize], true) {
                all.push(m);
            }
        }
    }
    all.reverse();
    all
}
