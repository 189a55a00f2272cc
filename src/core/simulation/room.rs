//! How much of a tick is left for what is touched anew: a patch of samples that no plan knew of must not make the tick late.

use crate::contact::detection;
use crate::contact::obstacle::{Form, Obstacle};
use crate::contact::rigid::{Found, Rigid};
use crate::contact::shape::{Part as ShapePart, Shape};
use crate::model::constraint::PointMemory;
use crate::model::{ActiveMesh, Body};
use crate::stepping::work::{Laps, Part, Prices};

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

    /// How many points that are counted as `part` there is time for.
    pub(super) fn of(&self, part: Part) -> u32 {
        self.prices.count(part, self.left)
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
        let part = part_of_tool(rigid.shape);
        let (before, new) = (points.len(), self.of(part));
        detection::detect(body, mesh, rigid, points, out, new, work);
        self.left = self.left.saturating_sub(self.prices.of(part, points.len().saturating_sub(before) as u32));
    }
}

/// What the points of a tool of this shape are counted as.
pub(super) fn part_of_tool(shape: &Shape) -> Part {
    if shape.parts().iter().any(ShapePart::is_solid) { Part::SolidPoint } else { Part::Point }
}

/// And those of an obstacle.
pub(super) fn part_of(obstacle: &Obstacle) -> Part {
    match &obstacle.shape {
        Form::Ground => Part::PatchPoint,
        Form::Parts(shape) => part_of_tool(shape),
    }
}

/// Tells of a search that found so many `points`, which are counted as `part`.
pub(super) fn lap_points(laps: &mut dyn Laps, points: usize, part: Part) {
    match points as u32 {
        0 => laps.lap(Part::Search, 1),
        n => laps.lap(part, n),
    }
}
