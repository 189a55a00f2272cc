//! How what is found late is closed: an overlap, and what the surface has been shifted by.

use crate::math::Real;
use crate::model::active_mesh::RESIDUAL_KEPT;
use crate::model::constraint::PointMemory;

/// What there was a tick ago.
#[derive(Clone, Copy, Debug)]
pub(super) struct Before<'a> {
    /// The points of this tool.
    pub(super) memory: &'a [PointMemory],
    /// Whether the resolution has changed since.
    pub(super) changed: bool,
}

/// How an overlap that is found late is closed, and what has been shifted goes back, within a tick.
#[derive(Clone, Copy, Debug)]
pub(super) struct Closing {
    /// [`PointMemory::slack`] at the start of the tick [m] ...
    pub(super) slack: Real,
    /// ... and at its end.
    pub(super) slack_end: Real,
    /// [`PointMemory::shift`] at its end [m].
    pub(super) shift_end: Real,
}

impl Closing {
    /// Of a point that is `known` from the last tick with this slack and this `shift` [m], and overlaps by this much beside that [m] at
    /// the start of a tick in which the tool has `moved` towards it [m].
    ///
    /// Neither the last multiplier nor the last slack explains that overlap: the tool came too fast, or the point was just found.
    pub(super) fn new(known: Option<Real>, overlap: Real, shift: Real, moved: Real) -> Self {
        let slack = match known {
            Some(slack) => slack.min(overlap.max(0.0)).max(overlap - UNNOTICED - 0.5 * moved.abs()),
            None => overlap.max(0.0),
        };
        let left = |of: Real, kept: Real| if of.abs() > 1e-7 { of * kept } else { 0.0 };
        let (slack_end, shift_end) = (left(slack, SLACK_KEPT), left(shift, RESIDUAL_KEPT));
        let fastest = FASTEST_SHIFT.max(SHIFT_LEFT * shift.abs());
        Self { slack, slack_end, shift_end: shift + (shift_end - shift).clamp(-fastest, fastest) }
    }
}

/// Part of an overlap found late that remains after each tick: 32 of them (a frame) close 99.5 % of it.
const SLACK_KEPT: Real = 0.85;

/// What it changes by at most [m] within a tick, or this part of it where that is more: many changes in a row leave more than
/// one.
const FASTEST_SHIFT: Real = 10e-6;
const SHIFT_LEFT: Real = 0.01;

/// Overlap [m] that rounding and a solve of few sweeps may leave.
pub(super) const UNNOTICED: Real = 5e-5;
