//! Points of the display surface as rows of active nodes.

use super::ActiveMesh;
use crate::geometry::tet_mesh::gradients;
use crate::ids::Vertex;
use crate::math::{Real, Vec3};
use crate::model::constraint::{Foot, Row};

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

/// The row of a patch with, against it, what carries the place of a triangle that it meets; and how that goes along with it.
pub fn two_sided(mesh: &ActiveMesh, patch: &[(Vertex, Real)], stencil: &[(Vertex, Real); 3]) -> (Row, Foot) {
    let (other, _) = row(mesh, stencil);
    let heaviest = stencil.iter().max_by(|a, b| a.1.total_cmp(&b.1)).map_or(stencil[0].0, |(v, _)| *v);
    let host = mesh.embedding(heaviest).slots;
    let slopes = gradients(&host.map(|slot| mesh.position(slot)));
    let against = |patch: &[(Vertex, Real)]| {
        let (mut row, _) = row(mesh, patch);
        other.entries().iter().for_each(|(slot, b)| row.add(*slot, -b));
        row
    };
    let whole = |patch: &[(Vertex, Real)]| {
        let (mut row, mut foot) = (against(patch), Foot::FIXED);
        let mut has_room = true;
        for (slot, g) in host.iter().zip(slopes) {
            if mesh.is_master(*slot) {
                has_room &= foot.add(&mut row, *slot, g);
            } else {
                mesh.row(*slot).entries().for_each(|(master, p)| has_room &= foot.add(&mut row, master, g * p));
            }
        }
        (has_room && !row.is_full()).then_some((row, foot))
    };
    // Where there is no room for all that carries a patch, what carries the vertex in its middle stands for it.
    let middle = [(patch[0].0, 1.0)];
    whole(patch).or_else(|| whole(&middle)).unwrap_or_else(|| (against(&middle), Foot::FIXED))
}
