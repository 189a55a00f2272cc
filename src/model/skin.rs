//! The display surface as the body moves: every vertex follows the element it lies in.

use crate::hierarchy::Level;
use crate::math::{Real, Vec3};
use crate::model::constraint::Row;

/// Positions of the display vertices [m] for the node positions of `level`; both slices have their full length.
pub fn skin(level: &Level, position: &[Vec3], vertices: &mut [Vec3]) {
    for (vertex, host) in vertices.iter_mut().zip(&level.embedding) {
        let nodes = &level.mesh.elements[host.element as usize];
        let mut sum = position[nodes[0] as usize] * host.weights[0];
        for i in 1..4 {
            sum += position[nodes[i] as usize] * host.weights[i];
        }
        *vertex = sum;
    }
}

/// The surface point `Σ weights·vertices` as a row of node weights.
pub fn row(level: &Level, point: &[(u32, Real)]) -> Row {
    let mut row = Row::EMPTY;
    for &(vertex, weight) in point {
        let host = &level.embedding[vertex as usize];
        for (node, w) in level.mesh.elements[host.element as usize].iter().zip(host.weights) {
            row.add(*node, weight * w);
        }
    }
    row
}
