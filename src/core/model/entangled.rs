//! Bodies that have been pushed through themselves and stay so.
//!
//! No element resists a body's passing through itself, which may leave it folded over itself or wound up for good.

use super::active_mesh::ActiveMesh;
use super::body::Body;
use super::material::COLLAPSE_ONSET;
use crate::math::{Bounds, Real, Vec3};

/// A body that is entangled for as many frames in a row does not come out of it: two seconds.
pub const ENTANGLED_FRAMES: u32 = 64;
/// How far from where it started some part of an entangled body is, over its size.
const KNOT_SIZE: Real = 0.1;

/// Where a body started: what an entangled one is far from.
#[derive(Debug)]
pub struct ReferencePose {
    /// Display vertices [m].
    skin: Vec<Vec3>,
    /// Farther than this from there [m] they are somewhere else.
    far: Real,
}

impl ReferencePose {
    /// `body` as `mesh` has it.
    pub fn new(body: &Body, mesh: &ActiveMesh) -> Self {
        let mut skin = vec![Vec3::zeros(); body.surface().vertices.len()];
        mesh.skin(&mut skin);
        let Bounds { low, high } = body.surface().bounds();
        Self { skin, far: KNOT_SIZE * (high - low).norm() }
    }

    /// True for a body with display vertices `now` [m] that nothing touches, `least_det` the least `det F` of its elements:
    /// some of them are crushed all the same, and some place is far from here. A body that only swings comes by here, or
    /// is not crushed on its way, and one that its own weight crushes does not leave.
    pub fn is_entangled(&self, least_det: Real, now: &[Vec3]) -> bool {
        let is_far = |(now, start): (&Vec3, &Vec3)| (now - start).norm_squared() > self.far * self.far;
        least_det < COLLAPSE_ONSET && now.iter().zip(&self.skin).any(is_far)
    }
}
