//! How much of a tick is left for what is touched anew: a patch of samples that no plan knew of must not make the tick late.

use crate::contact::detection;
use crate::contact::rigid::{Found, Rigid};
use crate::contact::shape::Part as ShapePart;
use crate::model::constraint::PointMemory;
use crate::model::{ActiveMesh, Body};
use crate::stepping::work::{self, Laps, Part, Prices};

/// Time that is left for contact points which are new.
#[derive(Debug)]
pub(super) struct Room {
    prices: Prices,
    /// [ns].
    left: u32,
}

impl Room {
    /// Of so much time [ns].
    pub(super) fn new(prices: Prices, left: u32) -> Self {
        Self { prices, left }
    }

    /// As [`detection::detect`], with no more points than there is time for.
    pub(super) fn detect(
        &mut self,
        (body, mesh): (&Body, &ActiveMesh),
        rigid: Rigid,
        points: &mut Vec<PointMemory>,
        out: Found,
        work: &mut detection::Workspace,
    ) {
        let part = work::part_of_points(rigid.shape.parts().iter().any(ShapePart::is_solid));
        let (before, new) = (points.len(), self.prices.count(part, self.left));
        detection::detect(body, mesh, rigid, points, out, new, work);
        self.left = self.left.saturating_sub(self.prices.of(part, points.len().saturating_sub(before) as u32));
    }
}

/// Tells of a search that found `points` on a tool or obstacle, `solid` when one of its parts is a cylinder or a hull.
pub(super) fn lap_points(laps: &mut dyn Laps, points: usize, solid: bool) {
    match points as u32 {
        0 => laps.lap(Part::Search, 1),
        n if solid => laps.lap(Part::SolidPoint, n),
        n => laps.lap(Part::Point, n),
    }
}
