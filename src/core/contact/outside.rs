//! Whether a tool is outside the body.

use super::jaws::Stance;
use super::posed::{Posed, posed};
use super::shape::Shape;
use super::touchable::weights_in_triangle;
use crate::ids::Vertex;
use crate::math::{Bounds, Real, Vec3};
use crate::model::active_mesh::MOST_ASIDE;
use crate::model::organ::MOST_ORGANS;
use crate::model::{ActiveMesh, Body};

/// Around each organ as it is displayed [m].
pub fn boxes(body: &Body, mesh: &ActiveMesh) -> [Bounds; MOST_ORGANS] {
    let mut boxes = [Bounds::NOTHING; MOST_ORGANS];
    for &slot in mesh.active().iter().chain(mesh.interface()) {
        let around = &mut boxes[body.organ_of(mesh.node(slot)).index()];
        let x = mesh.position(slot);
        (around.low, around.high) = (around.low.inf(&x), around.high.sup(&x));
    }
    // Weights below zero, all together: no vertex hangs farther outside of its element, by its size, but those that are extrapolated, or
    // fade.
    let outside = (3.0 * MOST_ASIDE).min(0.5 * (mesh.lever() - 1.0));
    let places = mesh.extrapolated().iter().chain(mesh.morphing()).map(|v| (v.index(), mesh.vertex(*v)));
    for (around, organ) in boxes.iter_mut().zip(body.organs()) {
        // Elements are at most about so much larger than their level's spacing.
        let spacing = organ.levels.iter().map(|level| level.spacing).fold(0.0, Real::max);
        *around = around.grown(outside * spacing);
        for (_, p) in places.clone().filter(|(v, _)| organ.vertices.contains(v)) {
            (around.low, around.high) = (around.low.inf(&p), around.high.sup(&p));
        }
    }
    boxes
}

/// True when the tool neither touches nor lies inside the `body`, its display vertices where `vertices` are [m]: where it
/// may engage.
pub fn is_outside(body: &Body, vertices: &[Vec3], shape: &Shape, stance: &Stance) -> bool {
    let (all, parts) = posed(stance, shape);
    all[..parts].iter().all(|at| is_part_outside(body, vertices, at))
}

/// True when the tool is outside all of `boxes`, which are around the body: a quick answer, and false where it takes a look.
pub fn is_apart(boxes: &[Bounds], shape: &Shape, stance: &Stance) -> bool {
    let (all, parts) = posed(stance, shape);
    let windows = all[..parts].iter().map(|at| at.window(at.part.radius()));
    let overlap = |a: &Bounds, b: &Bounds| (0..3).all(|c| a.low[c] <= b.high[c] && b.low[c] <= a.high[c]);
    !windows.into_iter().any(|window| boxes.iter().any(|around| overlap(&window, around)))
}

fn is_part_outside(body: &Body, vertices: &[Vec3], at: &Posed) -> bool {
    let radius = at.part.radius();
    let window = at.window(radius);
    let near = |p: Vec3, core: Vec3| (p - at.frame.at(core)).norm_squared() < radius * radius;
    if vertices.iter().any(|p| window.contains(p) && near(*p, at.nearest(*p))) {
        return false;
    }
    let grazes = near_triangles(body, vertices, at, radius, |_| Vec3::z()).any(
        |NearTriangle { corners, place, core, .. }| {
            weights_in_triangle(&corners, place).is_some_and(|w| {
                let p = corners[0] * w[0] + corners[1] * w[1] + corners[2] * w[2];
                near(p, core.unwrap_or_else(|| at.nearest(p)))
            })
        },
    );
    // The origin of its frame need not be in it.
    let within = at.frame.at(at.nearest(at.middle()));
    !grazes && !is_inside(body, |v| vertices[v.index()], within)
}

/// A triangle of the surface near a tool.
#[derive(Clone, Copy, Debug)]
pub struct NearTriangle {
    /// Its display vertices.
    pub triangle: [Vertex; 3],
    /// Where they are [m].
    pub corners: [Vec3; 3],
    /// Its place that is nearest to the core, or deepest in it [m].
    pub place: Vec3,
    /// Coordinates of the core's nearest point, of an axis.
    pub core: Option<Vec3>,
}

/// Triangles of the `body`, its display vertices where `vertices` are [m], in the box around the core of a part grown by
/// `reach` [m], each with its nearest place; `push` of its corners is where the core would push it out along.
pub fn near_triangles<'a>(
    body: &'a Body,
    vertices: &'a [Vec3],
    at: &'a Posed,
    reach: Real,
    push: impl Fn(&[Vec3; 3]) -> Vec3 + 'a,
) -> impl Iterator<Item = NearTriangle> + 'a {
    let window = at.window(reach);
    body.triangles().filter_map(move |triangle| {
        let corners = triangle.map(|v| vertices[v.index()]);
        if window.is_apart(&corners) {
            return None;
        }
        let (place, core) = at.nearest_in_triangle(&corners, push(&corners));
        Some(NearTriangle { triangle, corners, place, core })
    })
}

/// True when `p` lies inside the `body` with its display vertices at `place` [m]: three rays vote by the parity of their
/// crossings, so that none decides alone.
pub(super) fn is_inside(body: &Body, place: impl Fn(Vertex) -> Vec3, p: Vec3) -> bool {
    let mut crossings = [0u32; 3];
    for triangle in body.triangles() {
        let corners = triangle.map(&place);
        for (axis, count) in crossings.iter_mut().enumerate() {
            *count += u32::from(crosses(&triangle, &corners, p, axis));
        }
    }
    crossings.iter().filter(|c| *c % 2 == 1).count() >= 2
}

/// True when the ray from `p`, nearly along +`axis`, meets the triangle.
///
/// The ray leans a little, so that it does not run along the edges of boxes and other regular shapes. A ray through an
/// edge meets exactly one of its two triangles: both ask on which side it passes with the edge's ends in the same order.
fn crosses(triangle: &[Vertex; 3], corners: &[Vec3; 3], p: Vec3, axis: usize) -> bool {
    let (i, j) = ((axis + 1) % 3, (axis + 2) % 3);
    let flat = |k: usize| {
        let d = corners[k] - p;
        (d[i] - 0.0173 * d[axis], d[j] - 0.0419 * d[axis])
    };
    // Twice the area of the ray's foot with the edge, and the side; positive counts as left, zero too.
    let side = |from: usize, to: usize| {
        let in_order = triangle[from] < triangle[to];
        let (a, b) = if in_order { (flat(from), flat(to)) } else { (flat(to), flat(from)) };
        let area = a.0 * b.1 - a.1 * b.0;
        if in_order { (area, area >= 0.0) } else { (-area, area < 0.0) }
    };
    let (to_a, to_b, to_c) = (side(1, 2), side(2, 0), side(0, 1));
    if to_a.1 != to_b.1 || to_b.1 != to_c.1 {
        return false;
    }
    let height = |k: usize| corners[k][axis] - p[axis];
    let total = to_a.0 + to_b.0 + to_c.0;
    let weighted = to_a.0 * height(0) + to_b.0 * height(1) + to_c.0 * height(2);
    // The sign of weighted / total.
    (weighted > 0.0) == (total > 0.0) && weighted != 0.0
}
