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
    /// the start of a tick in which the tool has `moved` towards it [m], which a hand holds or not.
    ///
    /// Neither the last multiplier nor the last slack explains that overlap: the tool came too fast, or the point was just found.
    pub(super) fn new(known: Option<Real>, overlap: Real, shift: Real, moved: Real, is_held: bool) -> Self {
        let slack = match known {
            Some(slack) => slack.min(overlap.max(0.0)).max(overlap - UNNOTICED - 0.5 * moved.abs()),
            None => overlap.max(0.0),
        };
        let slack_end = if is_held { slowly(slack, RESIDUAL_KEPT) } else { left(slack, SLACK_KEPT) };
        Self { slack, slack_end, shift_end: slowly(shift, RESIDUAL_KEPT) }
    }
}

/// What of a slack or a shift [m] there is after a tick.
fn left(of: Real, kept: Real) -> Real {
    if of.abs() > 1e-7 { of * kept } else { 0.0 }
}

/// The same where a hand would feel it. To close it takes work that the hand does not do: at once, a lively surface that gets into a tool
/// between two ticks would be thrown out faster than it came, again and again.
fn slowly(of: Real, kept: Real) -> Real {
    let fastest = FASTEST.max(PART_LEFT * of.abs());
    of + (left(of, kept) - of).clamp(-fastest, fastest)
}

/// Part of an overlap of what no hand holds that remains after each tick: 32 of them (a frame) close 99.5 % of it, or bodies would sink into
/// what they lie on.
const SLACK_KEPT: Real = 0.85;

/// What it changes by at most under a hand [m] within a tick, or this part of it where that is more: many changes of the resolution in a row
/// leave more than one. With less a tool that got in stays in for seconds; with more the hand is pushed, and the body pumped.
const FASTEST: Real = 10e-6;
const PART_LEFT: Real = 0.01;

/// Overlap [m] that rounding and a solve of few sweeps may leave.
pub(super) const UNNOTICED: Real = 5e-5;
