//! Points of the display surface as rows of active nodes.

use super::ActiveMesh;
use crate::ids::Vertex;
use crate::math::{Real, Vec3};
use crate::model::constraint::Row;

/// The surface point `Σ weights·vertices` as a row of node weights, and its geomorph offset [m]: the displayed point is the row's
/// plus the offset.
pub fn row(mesh: &ActiveMesh, point: &[(Vertex, Real)]) -> (Row, Vec3) {
    let mut row = Row::EMPTY;
    let mut geomorph = Vec3::zeros();
    for &(vertex, weight) in point {
        let embedded = mesh.embedding(vertex);
        for (slot, w) in embedded.slots.iter().zip(embedded.weights) {
            if mesh.is_master(*slot) {
                row.add(*slot, weight * w);
            } else {
                mesh.row(*slot).entries().for_each(|(master, p)| row.add(master, weight * w * p));
            }
        }
        let f = &mesh.geomorph[vertex.index()];
        geomorph += Vec3::new(f[0], f[1], f[2]) * weight;
    }
    (row, geomorph)
}
