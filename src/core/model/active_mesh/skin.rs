//! Points of the display surface as rows of active nodes.

use super::ActiveMesh;
use crate::ids::Vertex;
use crate::math::{Real, Vec3};
use crate::model::constraint::Row;

/// The surface point `Σ weights·vertices` as a row of node weights, and its fade [m]: the displayed point is the row's
/// plus the fade.
pub fn row(mesh: &ActiveMesh, point: &[(Vertex, Real)]) -> (Row, Vec3) {
    let mut row = Row::EMPTY;
    let mut fade = Vec3::zeros();
    for &(vertex, weight) in point {
        let attachment = mesh.attachment(vertex);
        for (slot, w) in attachment.slots.iter().zip(attachment.weights) {
            if mesh.is_master(*slot) {
                row.add(*slot, weight * w);
            } else {
                mesh.row(*slot).entries().for_each(|(master, p)| row.add(master, weight * w * p));
            }
        }
        let f = &mesh.fade[vertex.index()];
        fade += Vec3::new(f[0], f[1], f[2]) * weight;
    }
    (row, fade)
}
