//! How many samples the patches of a tool have.

use super::shape::Part;
use crate::model::constraint::MOST_POINTS;

/// Columns of a patch at most, and rows.
pub(super) const COLUMNS: usize = 7;
pub(super) const ROWS: usize = 5;
/// Samples of a patch at most.
pub(super) const MOST_SAMPLES: usize = 25;
/// Patches of a tool at most.
pub(super) const MOST_PATCHES: usize = MOST_POINTS / (1 + 3 * Density::COARSE.rings * (Density::COARSE.rings + 1));

/// How many samples a patch has.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Density {
    /// Rings of samples around the middle one of a disc; ring `k` has `6k`, so that all stand for about the same area.
    pub(super) rings: usize,
    /// Columns and rows of a strip, ...
    strip: [usize; 2],
    /// ... and of what a cylinder or a hull touches.
    face: [usize; 2],
}

impl Density {
    /// A tool of one part may have two or three patches of these: in a corner it touches three faces.
    const FINE: Self = Self { rings: 2, strip: [COLUMNS, 3], face: [5, ROWS] };
    /// Three parts may have one each.
    const MIDDLE: Self = Self { rings: 1, strip: [5, 3], face: [4, 4] };
    const COARSE: Self = Self { rings: 1, strip: [3, 3], face: [3, 3] };

    /// Of a tool of these `parts`, which may have `most` samples in all: the finest of which each part may have a patch.
    pub(super) fn of(parts: &[Part], most: usize) -> Self {
        let fits = |density: &Self| parts.iter().map(|part| density.samples(part)).sum::<usize>() <= most;
        [Self::FINE, Self::MIDDLE].into_iter().find(fits).unwrap_or(Self::COARSE)
    }

    /// Samples of each patch of `part`.
    pub(super) fn samples(&self, part: &Part) -> usize {
        let [columns, rows] = self.cells(part);
        if part.ball_radius().is_some() { 1 + 3 * self.rings * (self.rings + 1) } else { columns * rows }
    }

    /// Columns and rows of each patch of `part`, unless it is a ball.
    pub(super) fn cells(&self, part: &Part) -> [usize; 2] {
        if part.is_solid() { self.face } else { self.strip }
    }
}
