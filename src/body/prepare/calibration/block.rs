//! Three displacements or forces of a node at once, and sums over nodes.

use palpate_core::math::{Mat3, Real};
use rayon::prelude::*;

/// Three columns: a displacement [m] or force [N] for the load along each axis.
pub(super) type Block = [[Real; 3]; 3];
pub(super) const ZERO: Block = [[0.0; 3]; 3];

/// Nodes per chunk of a sum or a pass; part of the result's last bits, so never the number of threads.
pub(super) const CHUNK: usize = 1024;

/// A block as nalgebra's matrix.
pub(super) fn columns(block: &Block) -> Mat3 {
    Mat3::from(*block).transpose()
}

/// Visits every node's block, chunks side by side.
pub(super) fn for_each_node(blocks: &mut [Block], visit: impl Fn(usize, &mut Block) + Sync) {
    blocks.par_chunks_mut(CHUNK).enumerate().for_each(|(chunk, blocks)| {
        for (i, block) in blocks.iter_mut().enumerate() {
            visit(chunk * CHUNK + i, block);
        }
    });
}

/// `a += s b`.
pub(super) fn add_scaled(a: &mut Block, s: Real, b: &Block) {
    for i in 0..3 {
        for j in 0..3 {
            a[i][j] += s * b[i][j];
        }
    }
}

/// Sum of the products of all components.
pub(super) fn product(a: &Block, b: &Block) -> Real {
    (0..3).map(|i| a[i][0] * b[i][0] + a[i][1] * b[i][1] + a[i][2] * b[i][2]).sum()
}

/// Sum of the products over all nodes; chunks are summed side by side, their sums in order.
pub(super) fn dot(a: &[Block], b: &[Block]) -> Real {
    let sum = |(a, b): (&[Block], &[Block])| a.iter().zip(b).map(|(a, b)| product(a, b)).sum();
    let sums: Vec<Real> = a.par_chunks(CHUNK).zip(b.par_chunks(CHUNK)).map(sum).collect();
    sums.iter().sum()
}
