//! Places of the surface as moving least squares fits to the active nodes around them, of whatever level these are.
//!
//! The weights `w_k = m_k W(|X_k − p|/ρ)` of the nodes around the place `p` at rest, `W` the cubic spline, are corrected to
//! first order, so that `Σ w = 1` and `Σ w X = p`: the shape functions of the element-free Galerkin method [Belytschko, Lu & Gu
//! 1994]. They change continuously with the place, and as the masses `m_k` are the nodes' parts of the volume, hardly with how the
//! nodes lie around it.

use super::ActiveMesh;
use crate::ids::{Slot, Vertex};
use crate::math::{Mat3, Real, Vec3};
use crate::model::body::Body;
use crate::model::constraint::{MOST_ROW_NODES, Row};
use crate::model::interface::Search;

/// Support of a row over the spacing of the nodes: with less the lattice is felt, with more rows have no room and thin bodies no depth.
/// Elements that are softer in their shortest waves need a wider one.
pub fn support(body: &Body) -> Real {
    if body.stars().is_empty() { 1.75 } else { 2.0 }
}

/// Spacing of the nodes under the place of the surface that is such a combination of display vertices [m].
pub fn spacing(mesh: &ActiveMesh, stencil: impl IntoIterator<Item = (Vertex, Real)>) -> Real {
    stencil.into_iter().map(|(v, w)| mesh.embedding(v).spacing * w).sum()
}

/// And where that is at rest [m].
pub fn at_rest(body: &Body, stencil: impl IntoIterator<Item = (Vertex, Real)>) -> Vec3 {
    stencil.into_iter().map(|(v, w)| body.surface().vertices[v.index()] * w).sum()
}

/// An active node near a place.
#[derive(Clone, Copy, Debug)]
struct Near {
    slot: Slot,
    /// At rest [m].
    place: Vec3,
    /// [kg].
    mass: Real,
}

/// The active nodes around a part of the surface.
#[derive(Debug)]
pub struct Surroundings {
    search: Search,
    nodes: Vec<Near>,
}

impl Surroundings {
    /// Of some part of `body`.
    pub fn new(body: &Body) -> Self {
        Self { search: Search::new(body), nodes: Vec::with_capacity(MOST_NEAR) }
    }

    /// Looks for the nodes up to `radius` [m] around the place `p` at rest, from those in the slots of `from` on: over elements and not
    /// through the air, so that the lips of a slit do not hang on each other.
    pub fn gather(&mut self, body: &Body, mesh: &ActiveMesh, from: &[Slot], p: Vec3, radius: Real) {
        let seeds = from.iter().map(|slot| mesh.node(*slot));
        let found = self.search.within(body, mesh.set(), p, seeds, radius);
        self.nodes.clear();
        for (_, n) in found.iter().filter(|(distance, _)| *distance < radius * radius) {
            if let Some(slot) = mesh.slot(*n).filter(|_| self.nodes.len() < self.nodes.capacity()) {
                self.nodes.push(Near { slot, place: body.rest(*n), mass: mesh.motion.mass[slot.index()] });
            }
        }
    }

    /// The row of the place `p` at rest [m] on nodes up to `support` [m] away: less where these are more than a row has room
    /// for, more where they do not fix a plane's slope. `None` where even as many as there is room for do not.
    pub fn row(&self, p: Vec3, mut support: Real) -> Option<Row> {
        let within = |support: Real| move |near: &&Near| (near.place - p).norm_squared() < support * support;
        let count = |support: Real| self.nodes.iter().filter(within(support)).count();
        let mut held = count(support);
        while held > MOST_ROW_NODES {
            support *= NARROWER;
            held = count(support);
        }
        for _ in 0..MOST_TRIES {
            let row = fit(self.nodes.iter().filter(within(support)), p, support);
            let wider = support / NARROWER;
            if row.is_some() || count(wider) > MOST_ROW_NODES {
                return row;
            }
            support = wider;
        }
        None
    }
}

/// The row of the place `p` [m] on nodes `near` it, no more than a row has room for.
fn fit<'a>(near: impl Iterator<Item = &'a Near>, p: Vec3, support: Real) -> Option<Row> {
    let mut weighed = [(Slot::NONE, 0.0, Vec3::zeros()); MOST_ROW_NODES];
    let mut len = 0;
    let (mut sum, mut first, mut second) = (0.0, Vec3::zeros(), Mat3::zeros());
    for (near, weighed) in near.zip(&mut weighed) {
        let d = near.place - p;
        let w = near.mass * spline(d.norm() / support);
        *weighed = (near.slot, w, d);
        len += 1;
        sum += w;
        first += d * w;
        second += d * d.transpose() * w;
    }
    if sum <= 0.0 {
        return None;
    }
    let mean = first / sum;
    let spread = second / sum - mean * mean.transpose();
    // Its eigenvalues are squares of how far the nodes lie apart in each direction.
    if spread.determinant() < LEAST_SPREAD * (support * support).powi(3) {
        return None;
    }
    let slope = spread.try_inverse()? * mean;
    let mut row = Row::EMPTY;
    for (slot, w, d) in weighed[..len].iter().filter(|(_, w, _)| *w > 0.0) {
        row.push(*slot, w / sum * (1.0 - slope.dot(&(d - mean))));
    }
    Some(row)
}

/// The cubic spline kernel on [0, 1], up to a factor.
fn spline(q: Real) -> Real {
    if q < 0.5 {
        1.0 - 6.0 * q * q * (1.0 - q)
    } else if q < 1.0 {
        2.0 * (1.0 - q) * (1.0 - q) * (1.0 - q)
    } else {
        0.0
    }
}

/// Deviation of a row's weights along the surface, in each of its directions, over the support: that of the spline in a half-ball,
/// corrected to first order. From `M_n = ∫ W(q) qⁿ dq` = .03125, .0138393, .0070313 and .0039374 for n of 2 to 5: the variance is
/// `.075 + .22143 · .0008577/.02597` before the correction, which takes off what the half-ball has of slope.
pub const DEVIATION: Real = 0.287;

/// Most nodes that are gathered.
const MOST_NEAR: usize = 512;
/// A support that is too wide or too narrow is made narrower or wider by this, ...
const NARROWER: Real = 0.9;
/// ... so often at most.
const MOST_TRIES: usize = 12;
/// Over the sixth power of the support: below it the nodes lie in a plane but for rounding.
const LEAST_SPREAD: Real = 1e-8;
