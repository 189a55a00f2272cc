//! The local model of a tool that does not touch yet: where contact will begin, and how stiff it will be there, from the
//! elastic half-space. A hand far away is in contact for two delays of the network before it can hear of it.

use super::stiffness::Stiffness;
use crate::contact::outside::{NearTriangle, near_triangles};
use crate::contact::posed::{Posed, posed};
use crate::contact::shape::Shape;
use crate::contact::tool::ToolState;
use crate::ids::Vertex;
use crate::math::{Real, Vec3};
use crate::model::{ActiveMesh, Body};
use std::f64::consts::PI;

/// A surface farther away than this [m] says nothing yet: at 0.5 m/s it is 40 ms ahead.
const REACH: Real = 0.02;
/// Depth at which the force is what is told [m].
const DEPTH: Real = 1e-3;
/// How far below the surface the model holds [m].
const BELOW: Real = 4e-3;

/// What a `tool` of that `shape` will meet first, where the displayed `vertices` [m] of `body`, which moves as `mesh`, are;
/// `None` where nothing is near, or where the tool is not in front of it.
pub(super) fn ahead(
    body: &Body,
    mesh: &ActiveMesh,
    vertices: &[Vec3],
    shape: &Shape,
    tool: &ToolState,
) -> Option<Stiffness> {
    let (all, parts) = posed(&tool.stance(), shape);
    let nearest = all[..parts].iter().filter_map(|part| nearest(body, vertices, part));
    let (gap, away, radius, vertex) = nearest.min_by(|a, b| a.0.total_cmp(&b.0))?;
    let normal = -away;
    // Hertz: F/d = 4/3 E* a, with a² = R d; large strain softens it.
    let material = mesh.material_at(body, vertex);
    let plane_strain = 1.0 / (PI * material.half_space(&body.rest_normal(vertex)));
    let softened = 1.0 + material.softening((DEPTH / radius).sqrt());
    let contact = 4.0 / 3.0 * plane_strain * (radius * DEPTH).sqrt() / softened;
    let along = 1.0 / (1.0 / contact + tool.coupling.compliance);
    Some(Stiffness {
        matrix: normal * normal.transpose() * along,
        normal,
        range: gap + BELOW,
        // Under this force dF/dd = 2 E* a is as much.
        load: contact * DEPTH / (1.5 * 1.5 * 1.5),
        begins: Some(normal.dot(&tool.device.position) - gap),
        iterations: 0,
    })
}

/// Gap [m] between a part of a tool and the surface, unit direction towards it, about the part's radius [m], and a display
/// vertex there.
fn nearest(body: &Body, vertices: &[Vec3], at: &Posed) -> Option<(Real, Vec3, Real, Vertex)> {
    let radius = at.part.radius();
    let mut best: Option<(Real, Vec3, Vertex)> = None;
    let inward = |corners: &[Vec3; 3]| -(corners[1] - corners[0]).cross(&(corners[2] - corners[0]));
    for NearTriangle { triangle, place, core, .. } in near_triangles(body, vertices, at, radius + REACH, inward) {
        let away = place - at.frame.at(core.unwrap_or_else(|| at.nearest(place)));
        let distance = away.norm();
        if distance > radius && best.is_none_or(|b| distance - radius < b.0) {
            // A place on an edge is met from outside whichever way its triangle faces.
            best = Some((distance - radius, away / distance, triangle[0]));
        }
    }
    best.filter(|b| b.0 < REACH).map(|(gap, away, vertex)| (gap, away, at.part.outline().2, vertex))
}
