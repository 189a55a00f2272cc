//! Whether a tool is outside the body.

use super::candidate::{is_apart, is_in, weights_in_triangle};
use super::detection::Touchable;
use super::shape::{Posed, Shape, posed};
use crate::math::{Pose, Vec3};

/// True when the tool neither touches nor lies inside the closed surface `vertices`: where it may engage.
pub fn is_outside(on: &Touchable, shape: &Shape, pose: &Pose) -> bool {
    let (all, parts) = posed(pose, shape);
    all[..parts].iter().all(|at| is_part_outside(on, at))
}

fn is_part_outside(on: &Touchable, at: &Posed) -> bool {
    let radius = at.part.radius();
    let window = at.window(radius);
    let near = |p: Vec3, core: Vec3| (p - at.frame.at(core)).norm_squared() < radius * radius;
    if on.vertices.iter().any(|p| is_in(&window, p) && near(*p, at.nearest(*p))) {
        return false;
    }
    let grazes = on.body.surface().triangles.iter().any(|triangle| {
        let corners = triangle.map(|v| on.vertices[v as usize]);
        if is_apart(&corners, &window) {
            return false;
        }
        let (place, core) = at.nearest_in_triangle(&corners, Vec3::z());
        weights_in_triangle(&corners, place).is_some_and(|w| {
            let p = corners[0] * w[0] + corners[1] * w[1] + corners[2] * w[2];
            near(p, core.unwrap_or_else(|| at.nearest(p)))
        })
    });
    !grazes && !is_inside(on, at.frame.at(Vec3::zeros()))
}

/// True when `p` lies inside: three rays vote by the parity of their crossings, so that none decides alone.
pub(super) fn is_inside(on: &Touchable, p: Vec3) -> bool {
    let mut crossings = [0u32; 3];
    for triangle in &on.body.surface().triangles {
        for (axis, count) in crossings.iter_mut().enumerate() {
            *count += u32::from(crosses(on.vertices, triangle, p, axis));
        }
    }
    crossings.iter().filter(|c| *c % 2 == 1).count() >= 2
}

/// True when the ray from `p`, nearly along +`axis`, meets the triangle.
///
/// The ray leans a little, so that it does not run along the edges of boxes and other regular shapes. A ray through an
/// edge meets exactly one of its two triangles: both ask on which side it passes with the edge's ends in the same order.
fn crosses(vertices: &[Vec3], triangle: &[u32; 3], p: Vec3, axis: usize) -> bool {
    let (i, j) = ((axis + 1) % 3, (axis + 2) % 3);
    let flat = |v: u32| {
        let d = vertices[v as usize] - p;
        (d[i] - 0.0173 * d[axis], d[j] - 0.0419 * d[axis])
    };
    // Twice the area of the ray's foot with the edge, and the side; positive counts as left, zero too.
    let side = |from: u32, to: u32| {
        let (a, b) = (flat(from.min(to)), flat(from.max(to)));
        let area = a.0 * b.1 - a.1 * b.0;
        if from < to { (area, area >= 0.0) } else { (-area, area < 0.0) }
    };
    let [a, b, c] = *triangle;
    let (to_a, to_b, to_c) = (side(b, c), side(c, a), side(a, b));
    if to_a.1 != to_b.1 || to_b.1 != to_c.1 {
        return false;
    }
    let height = |v: u32| vertices[v as usize][axis] - p[axis];
    let total = to_a.0 + to_b.0 + to_c.0;
    let weighted = to_a.0 * height(a) + to_b.0 * height(b) + to_c.0 * height(c);
    // The sign of weighted / total.
    (weighted > 0.0) == (total > 0.0) && weighted != 0.0
}
