//! Where a round part of a tool, a ball or a capsule, has its samples: on a patch that is as wide as what it touches, seen along the
//! direction in which it pushes.
//!
//! A ball's patch is Hertz's disc, in rings. A capsule's is a strip along its axis, in rows, as long as the force is spread over: with a
//! straight part of no length it is the disc of its round end, with a long one Hertz's line contact.

use super::posed::Posed;
use super::shape::Frame;
use super::view::{LEAST_FACING, View, part_before};
use crate::math::{Real, Vec3};
use crate::model::constraint::MOST_POINTS;
use std::f64::consts::PI;
use std::ops::Range;

/// Columns of a strip at most, and its rows.
pub(super) const COLUMNS: usize = 7;
pub(super) const ROWS: usize = 3;
/// Samples of a patch at most.
pub(super) const MOST_SAMPLES: usize = COLUMNS * ROWS;
/// Patches of a tool at most.
pub(super) const MOST_PATCHES: usize = MOST_POINTS / (1 + 3 * Density::COARSE.rings * (Density::COARSE.rings + 1));

/// How many samples a patch has.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Density {
    /// Rings of samples around the middle one of a disc; ring `k` has `6k`, so that all stand for about the same area.
    rings: usize,
    /// Columns of a strip.
    columns: usize,
}

impl Density {
    /// A tool of one part may have three patches of these: in a corner it touches three faces.
    const FINE: Self = Self { rings: 2, columns: COLUMNS };
    const COARSE: Self = Self { rings: 1, columns: 3 };

    /// Of a tool of so many `round` parts, whose samples are `most` in all: fine ones where each part may have a patch of them.
    pub(super) fn of(round: usize, most: usize) -> Self {
        if round * Self::FINE.columns * ROWS <= most { Self::FINE } else { Self::COARSE }
    }
}

/// A ball or capsule that may touch.
#[derive(Clone, Copy, Debug)]
pub(super) struct Round<'a> {
    /// In the middle of the tick.
    pub(super) at: &'a Posed<'a>,
    /// Its number among the parts of its tool, ...
    pub(super) part: usize,
    /// ... and all of them.
    pub(super) all: &'a [Posed<'a>],
    /// At its start and at its end.
    pub(super) moves: [&'a Frame; 2],
    /// Up to this far away it is looked at [m].
    pub(super) margin: Real,
    pub(super) density: Density,
}

/// A place of its surface.
#[derive(Clone, Copy, Debug)]
pub(super) struct Foot {
    /// Coordinates of the place of the core that is nearest.
    pub(super) core: Vec3,
    /// Out of the tool.
    pub(super) normal: Vec3,
    /// From the start of its axis [m].
    pub(super) arm: Vec3,
    /// How far beyond an end of the axis it is seen [m]: there it is curved along the axis as across.
    pub(super) beyond: Real,
    /// How far it is seen outside of what can be touched of the tool [m].
    outside: Real,
}

impl Foot {
    /// Mean square of the distances beyond the end [m²] over a cell whose own are spread by `spread` [m²], less that of its middle.
    pub(super) fn curved_along(&self, spread: Real) -> Real {
        let half = (3.0 * spread).sqrt();
        match self.beyond {
            beyond if beyond >= half => spread,
            beyond if beyond <= -half => 0.0,
            beyond => (beyond + half).powi(3) / (6.0 * half) - beyond.max(0.0).powi(2),
        }
    }
}

impl Round<'_> {
    pub(super) fn radius(&self) -> Real {
        self.at.part.radius()
    }

    /// Start of its axis [m].
    pub(super) fn start(&self) -> Vec3 {
        self.at.frame.at(Vec3::zeros())
    }

    /// Its axis from end to end [m]; zero for a ball.
    pub(super) fn axis(&self) -> Vec3 {
        self.at.frame.axes[2]
    }

    pub(super) fn is_ball(&self) -> bool {
        self.at.part.ball_radius().is_some()
    }

    /// Samples of each of its patches.
    pub(super) fn samples(&self) -> usize {
        let Density { rings, columns } = self.density;
        if self.is_ball() { 1 + 3 * rings * (rings + 1) } else { columns * ROWS }
    }

    /// Those of them that are on the line.
    pub(super) fn on_line(&self) -> Range<usize> {
        let columns = self.columns();
        if self.is_ball() { 0..1 } else { columns * (ROWS / 2)..columns * (ROWS / 2 + 1) }
    }

    /// Which one of them is in the middle.
    pub(super) fn middle(&self) -> usize {
        if self.is_ball() { 0 } else { self.samples() / 2 }
    }

    /// Half-width of a disc over what its rings are apart.
    fn rings(&self) -> Real {
        self.density.rings as Real + 0.3
    }

    /// Columns of each strip.
    pub(super) fn columns(&self) -> usize {
        self.density.columns
    }

    /// True for the first and for the last sample of a row of a strip.
    pub(super) fn is_outermost(&self, i: usize) -> bool {
        let columns = self.columns();
        i.is_multiple_of(columns) || i % columns == columns - 1
    }

    /// Part of a disc of radius `width` [m] around a place of its surface that can be touched: all of it while its middle is, and what is not
    /// inside of another part of the tool.
    pub(super) fn part_touchable(&self, foot: &Foot, width: Real) -> Real {
        let p = self.start() + foot.arm;
        let others = self.all.iter().enumerate().filter(|(i, _)| *i != self.part);
        let part = |other: &Posed| {
            let away = p - other.frame.at(other.nearest(p));
            let depth = other.part.radius() - away.norm();
            // Along the surface to where that of the other part comes through it.
            let rises = away.try_normalize(1e-9).map_or(1.0, |out| out.cross(&foot.normal).norm());
            if depth == 0.0 { 0.5 } else { part_before(depth / (rises * width)) }
        };
        others.map(|(_, other)| part(other)).fold(part_before(2.0 * foot.outside / width - 1.0), Real::min)
    }

    /// Which end of the axis is ahead.
    fn foremost(&self, view: &View) -> Real {
        if view.ahead.dot(&self.axis()) > 0.0 { 1.0 } else { 0.0 }
    }

    /// From where to where along the first axis of the view the axis is seen, from its start [m].
    fn seen(&self, view: &View) -> [Real; 2] {
        let (axis, shadow) = (self.axis(), view.across[0].dot(&self.axis()));
        if shadow < LEAST_FACING * axis.norm() { [self.foremost(view) * shadow; 2] } else { [0.0, shadow] }
    }

    /// What of it is foremost in this view at the place `x`, `y` from the start of its axis [m]; nothing beside it.
    pub(super) fn front(&self, view: &View, [x, y]: [Real; 2]) -> Option<Foot> {
        let (radius, axis, [u, v]) = (self.radius(), self.axis(), view.across);
        let length = axis.norm();
        let end = |part: Real, beyond: Real| {
            let aside = u * (x - part * u.dot(&axis)) + v * y;
            let (away, most) = (aside.norm(), MOST_CAP * radius);
            // What is farther out is as far out as can be touched.
            let aside = if away > most { aside * (MOST_CAP / away) } else { aside / radius };
            let normal = aside + view.ahead * (1.0 - aside.norm_squared()).sqrt();
            let core = Vec3::new(0.0, 0.0, part);
            Some(Foot { core, normal, arm: axis * part + normal * radius, beyond, outside: away - most })
        };
        if length == 0.0 {
            return end(0.0, Real::INFINITY);
        }
        let along = axis / length;
        let (rise, flat) = (view.ahead.dot(&along), u.dot(&along));
        if flat < LEAST_FACING {
            return end(self.foremost(view), Real::INFINITY);
        }
        let sin = y / radius;
        let cos = (1.0 - sin * sin).max(0.0).sqrt();
        // The front of an endless cylinder.
        let part = (x + radius * rise * cos) / (flat * length);
        let beyond = (part - 1.0).max(-part) * flat * length;
        if beyond > 0.0 {
            return end(if part < 0.0 { 0.0 } else { 1.0 }, beyond);
        } else if sin.abs() > 1.0 {
            return None;
        }
        let normal = (view.ahead - along * rise) * (cos / flat) + v * sin;
        let core = Vec3::new(0.0, 0.0, part);
        Some(Foot { core, normal, arm: axis * part + normal * radius, beyond, outside: y.abs() - MOST_CAP * radius })
    }
}

/// How a tool pressed in the last tick.
#[derive(Clone, Copy, Debug)]
pub(super) struct Pressed {
    /// [N].
    pub(super) force: Real,
    /// Mean place of that along the first axis of the view, from the start of the tool's axis [m], ...
    pub(super) middle: Real,
    /// ... and its variance [m²].
    pub(super) along: Real,
    /// Half-width of the patch [m]; none for a new one.
    pub(super) half_width: Option<Real>,
}

impl Pressed {
    /// Not at all, at this place.
    pub(super) fn not(middle: Real) -> Self {
        Self { force: 0.0, middle, along: 0.0, half_width: None }
    }
}

/// A patch as it is seen: everything within `half_width` of a line along the first axis of the view.
#[derive(Clone, Copy, Debug)]
pub(super) struct Patch {
    /// Where the line begins and ends, from the start of the tool's axis [m].
    pub(super) line: [Real; 2],
    /// [m].
    pub(super) half_width: Real,
    /// Whether what is touched may be longer.
    pub(super) grows: bool,
}

/// A sample of it.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Cell {
    /// Its middle, as [`Round::front`] takes it [m].
    pub(super) at: [Real; 2],
    /// Area as it is seen [m²].
    pub(super) area: Real,
    /// Mean over it of the squares of the distances from its middle, along and across [m²].
    pub(super) spread: [Real; 2],
    /// Whether it is not beside the one before.
    pub(super) starts_row: bool,
}

impl Patch {
    /// Where a tool that `pressed` a half-space presses it now, which gives way by `compliance` [m²/N].
    ///
    /// What the force lies on is the convolution of a straight part of length `s` and the disc of half-width `b`: `along = s²/12 + b²/5`
    /// of Hertz's pressures. `16/(3π) b³ + s b² = 4 k F R` is Hertz's disc for `s = 0` and his strip for a long one.
    pub(super) fn of(round: &Round, view: &View, compliance: Real, pressed: &Pressed) -> Self {
        let Pressed { force, middle, along, half_width: before } = *pressed;
        let radius = round.radius();
        let load = 4.0 * compliance * force * radius;
        let disc = libm::cbrt(3.0 * PI / 16.0 * load);
        let straight = |width: Real| (12.0 * (along - width * width / 5.0)).max(0.0).sqrt();
        let width = |straight: Real| {
            (0..6).fold(disc, |b, _| {
                let slope = b * (16.0 / PI * b + 2.0 * straight);
                let excess = b * b * (16.0 / (3.0 * PI) * b + straight) - load;
                if slope > 0.0 { b - excess / slope } else { b }
            })
        };
        let b = if round.is_ball() { disc } else { width(straight(width(straight(disc)))) };
        // The force and the width are each the other's answer: to go all the way to the last one would overshoot where a tool is deep.
        let half_way = before.map_or(WIDER * b, |before| 0.5 * (before + WIDER * b));
        let half_width = half_way.clamp(LEAST_CAP * radius, MOST_CAP * radius);
        if round.is_ball() {
            return Self { line: [0.0; 2], half_width, grows: false };
        }
        // What is beyond an end is no farther from it than beside it.
        let [low, high] = round.seen(view);
        // A pressure that is elliptic along the line reaches farther than a constant one.
        let half = (5.0_f64 / 12.0).sqrt() * straight(b);
        // Not `clamp`, which panics where a bound is no number.
        let middle = middle.max(low).min(high);
        Self { line: [(middle - half).max(low), (middle + half).min(high)], half_width, grows: false }
    }

    /// Length of its straight part [m].
    pub(super) fn straight(&self) -> Real {
        self.line[1] - self.line[0]
    }

    /// Sides of the cells of a strip of so many `columns` [m].
    pub(super) fn sides(&self, columns: usize) -> [Real; 2] {
        [(self.straight() + 2.0 * self.half_width) / columns as Real, 2.0 * self.half_width / ROWS as Real]
    }

    /// Half-width of the patch that has these samples, whose normals are told by number [m].
    pub(super) fn half_width_of(round: &Round, view: &View, normal: impl Fn(usize) -> Vec3) -> Real {
        if round.is_ball() {
            return normal(0).cross(&normal(1)).norm() * round.rings() * round.radius();
        }
        let row = |row: usize| view.across[1].dot(&normal(row * round.columns() + round.columns() / 2));
        0.5 * ROWS as Real / (ROWS - 1) as Real * (row(ROWS - 1) - row(0)).abs() * round.radius()
    }

    /// Its cell number `i`.
    pub(super) fn cell(&self, round: &Round, i: usize) -> Cell {
        if round.is_ball() {
            let width = self.half_width / round.rings();
            let area = PI * width * width * if i == 0 { 0.25 } else { 1.0 / 3.0 };
            let spread = [area / (4.0 * PI); 2];
            // The ring that it is in, and its place there.
            let ring = (1..=round.density.rings).filter(|k| i > 3 * k * (k - 1)).count();
            if ring == 0 {
                return Cell { at: [self.line[0], 0.0], area, spread, starts_row: true };
            }
            let place = i - 1 - 3 * ring * (ring - 1);
            let (sin, cos) = libm::sincos(2.0 * PI * place as Real / (6 * ring) as Real);
            let away = ring as Real * width;
            let at = [self.line[0] + away * cos, away * sin];
            return Cell { at, area, spread, starts_row: place == 0 };
        }
        let columns = round.columns();
        let [along, across] = self.sides(columns);
        let (column, row) = (i % columns, i / columns);
        let middle = 0.5 * (self.line[0] + self.line[1]);
        let at = |side: Real, i: usize, n: usize| side * (i as Real - 0.5 * (n - 1) as Real);
        Cell {
            at: [middle + at(along, column, columns), at(across, row, ROWS)],
            area: along * across,
            spread: [along * along / 12.0, across * across / 12.0],
            starts_row: column == 0,
        }
    }

    /// True for what is less than `reach` [m] from its line, `at` being from the start of the tool's axis as it is seen [m].
    pub(super) fn covers(&self, at: [Real; 2], reach: Real) -> bool {
        let along = if self.grows { 0.0 } else { at[0] - at[0].max(self.line[0]).min(self.line[1]) };
        along * along + at[1] * at[1] < reach * reach
    }
}

/// Outermost samples over what is touched: just outside of it. With less the force is too high, as what is beside presses nothing;
/// with more samples lie idle.
const WIDER: Real = 1.05;
/// Over the radius, what is looked at before there is a load: the disc of a depth of 1/500 of the radius.
const LEAST_CAP: Real = 0.045;
/// Over the radius: at 1 the outermost samples push sideways alone; with less a deep ball is not felt where it is widest.
const MOST_CAP: Real = 0.95;
