//! What is remembered of organs that meet, each other or themselves.

use super::body::Body;
use crate::ids::{OrganId, Triangle};
use crate::math::{Real, Vec3};
use serde::{Deserialize, Serialize};

/// Most places where organs meet each other or themselves, or are about to: what bounds the cost of a tick.
pub const MOST_MEETINGS: usize = 256;

/// Where a patch of an organ's surface is near another organ, or another place of its own, as it is remembered from tick to tick.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Meeting {
    /// Number of the patch, ...
    pub patch: u32,
    /// ... and the other organ, which is its own where it is folded.
    pub other: OrganId,
    /// The other organ's display triangle that is next to it, ...
    pub triangle: Triangle,
    /// ... and barycentric weights of the place there.
    pub weights: [Real; 3],
    /// From that place to the patch along the normal [m]; below zero where they overlap.
    pub gap: Real,
    /// How much of the patch meets the other organ: less than all where its middle is beyond an edge.
    pub share: Real,
    /// Whether they are held apart: so near that they may touch within the tick.
    pub held: bool,
    /// Unit vector from the other organ to this one.
    pub normal: Vec3,
    /// The force that the other organ put on this one in the last tick, on the mean [N].
    pub force: Vec3,
    /// Last multiplier [N].
    pub multiplier: Real,
    /// Last force along the surface [N].
    pub tangential: Vec3,
    /// Overlap that has not been closed yet [m].
    pub slack: Real,
    /// How far the patch has come along the surface from where it sticks [m].
    pub stretch: Vec3,
}

impl Meeting {
    /// [`Constraint::point`](super::Constraint::point)s of both sides.
    pub fn points(&self, body: &Body) -> [u32; 2] {
        [body.point_of_patch(self.patch), self.triangle.0]
    }
}
