//! The displayed surface near a tool, as contact looks at it.

use crate::ids::{Triangle, Vertex};
use crate::math::{Real, Vec3};
use crate::model::constraint::PointMemory;
use crate::model::{ActiveMesh, Body};
use crate::visited::Visited;

/// Points this far from the tool [m] become constraints, so that contact begins with an open gap, and no tool passes
/// between two ticks what it did not push: more where a tick's motion is more.
pub(super) const MARGIN: Real = 2e-3;

/// A surface that comes to meet a tool is taken to be no faster [m/s].
pub(super) const FASTEST_SURFACE: Real = 1.0;

/// What a tool may touch.
#[derive(Debug)]
pub(super) struct Touchable<'a> {
    pub(super) body: &'a Body,
    pub(super) mesh: &'a ActiveMesh,
    /// Display vertices at the start of the tick [m], (n_vertices), as far as they are `near` the tool.
    pub(super) vertices: &'a [Vec3],
    pub(super) near: &'a Visited,
}

impl Touchable<'_> {
    /// Where display vertex `v` is [m], near the tool or not.
    #[inline]
    pub(super) fn vertex(&self, v: Vertex) -> Vec3 {
        if self.near.contains(v.index()) { self.vertices[v.index()] } else { self.mesh.vertex(v) }
    }

    /// Where the place of a triangle with these barycentric weights is displayed [m].
    pub(super) fn displayed(&self, t: Triangle, weights: [Real; 3]) -> Vec3 {
        let corners = self.body.triangle(t).map(|v| self.vertex(v));
        corners.iter().zip(weights).map(|(c, w)| c * w).sum()
    }

    /// Where the place is now that a sample touched [m].
    pub(super) fn touched(&self, m: &PointMemory) -> Vec3 {
        self.displayed(self.body.triangle_of_point(m.point), m.weights)
    }
}

/// Outward area vector of display triangle `t`, twice its area long [m²].
pub(super) fn area_vector(on: &Touchable, t: Triangle) -> Vec3 {
    let [a, b, c] = on.body.triangle(t).map(|v| on.vertex(v));
    (b - a).cross(&(c - a))
}

/// Barycentric weights of the triangle's place `p`; `None` for a collapsed triangle.
pub(super) fn weights_in_triangle(corners: &[Vec3; 3], p: Vec3) -> Option<[Real; 3]> {
    let (e1, e2, d) = (corners[1] - corners[0], corners[2] - corners[0], p - corners[0]);
    let (a, b, c) = (e1.norm_squared(), e1.dot(&e2), e2.norm_squared());
    let det = a * c - b * b;
    #[expect(clippy::neg_cmp_op_on_partial_ord, reason = "NaN, too, must leave here")]
    if !(det > 0.0) {
        return None;
    }
    let (r, s) = (e1.dot(&d), e2.dot(&d));
    let (w1, w2) = ((c * r - b * s) / det, (a * s - b * r) / det);
    Some([1.0 - w1 - w2, w1, w2])
}
