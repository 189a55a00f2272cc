//! What a part of a tool turns about as the tool's jaws open.

use crate::math::{Pose, Real, Vec3};

/// An axis of a tool, and how far a part is turned about it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Hinge {
    /// Unit vector in the tool's own frame.
    pub axis: Vec3,
    /// A place that stays where it is, likewise [m].
    pub point: Vec3,
    /// By how much the part is turned from its place while the jaws are closed [rad].
    pub closed: Real,
    /// And while they are open.
    pub open: Real,
}

impl Hinge {
    /// The frame of a tool at `pose`, as a part on the hinge has it where the jaws are open by `opening`, 0 to 1.
    pub(super) fn turned(&self, pose: &Pose, opening: Real) -> Pose {
        pose.turned_about(self.point, self.axis, self.closed + opening * (self.open - self.closed))
    }

    /// How the place `p` [m] of a part of a tool at `pose` moves as the part turns from closed to open [m/rad].
    pub(super) fn lever(&self, pose: &Pose, p: Vec3) -> Vec3 {
        pose.rotate(self.axis).cross(&(p - pose.to_world(self.point)))
    }
}
