//! Where a part of a tool has its samples: on a patch that is as wide as what it touches, seen along the direction in which it pushes.
//!
//! A ball's patch is Hertz's disc, in rings. A capsule's is a strip along its axis, in rows, as long as the force is spread over: with a
//! straight part of no length it is the disc of its round end, with a long one Hertz's line contact. A cylinder's or a hull's is a rectangle,
//! in rows, as long and as wide as the force is spread over and the part is seen.

use super::moving_part::{Foot, MOST_CAP, MovingPart, Silhouette};
use super::view::{View, part_before};
use crate::math::{Real, Vec3};
use std::f64::consts::PI;

/// How a tool pressed in the last tick, as it is seen now.
#[derive(Clone, Copy, Debug)]
pub(super) struct Pressed {
    /// [N].
    pub(super) force: Real,
    /// Mean place of that along both axes of the view, from the part's start [m], ...
    pub(super) middle: [Real; 2],
    /// ... and the mean squares of the distances from that towards both sides [m²], as if each had half of the force.
    pub(super) spread: [[Real; 2]; 2],
    /// From where to where along both axes the patch was [m]; none for a new one.
    pub(super) edges: Option<[[Real; 2]; 2]>,
}

impl Pressed {
    /// Not at all, at this place.
    pub(super) fn not(middle: [Real; 2]) -> Self {
        Self { force: 0.0, middle, spread: [[0.0; 2]; 2], edges: None }
    }
}

/// A patch as it is seen: everything within `half_width` of a line along the first axis of the view, or a rectangle.
#[derive(Clone, Copy, Debug)]
pub(super) struct Patch {
    /// Where the line begins and ends, from the part's start [m], or the rectangle, ...
    pub(super) line: [Real; 2],
    /// ... and where that does along the second axis.
    pub(super) across: [Real; 2],
    /// [m]; zero of a rectangle.
    pub(super) half_width: Real,
    /// Whether what is touched may be longer.
    pub(super) grows: bool,
}

/// What a sample is of the part.
#[derive(Clone, Copy, Debug)]
pub(super) struct Spot {
    /// Where its mean place is, from the part's start [m], ...
    pub(super) arm: Vec3,
    /// ... which is the part's radius along its mean `normal` from these coordinates.
    pub(super) core: Vec3,
    /// Out of the part.
    pub(super) normal: Vec3,
    /// As it lies on the part [m²]: nothing beside it.
    pub(super) area: Real,
    /// How much farther from the surface the part is on the mean over that than at the place [m].
    pub(super) rounded: Real,
    /// Whether it is not beside the one before.
    pub(super) starts_row: bool,
}

/// A cell of a patch as it is seen.
#[derive(Clone, Copy, Debug, Default)]
struct Cell {
    /// Its middle, as [`MovingPart::front`] takes it [m].
    at: [Real; 2],
    /// [m²].
    area: Real,
    /// Mean over it of the squares of the distances from its middle, along and across [m²].
    spread: [Real; 2],
    starts_row: bool,
}

impl Patch {
    /// Where a tool that `pressed` a half-space presses it now, which gives way by `compliance` [m²/N].
    pub(super) fn of(part: &MovingPart, view: &View, compliance: Real, pressed: &Pressed) -> Self {
        let Pressed { force, middle, spread, edges } = *pressed;
        let (radius, along) = (part.radius(), 0.5 * (spread[0][0] + spread[0][1]));
        let load = 4.0 * compliance * force * radius;
        let disc = libm::cbrt(3.0 * PI / 16.0 * load);
        // What the force lies on is the convolution of a straight part of length `s` and the disc of half-width `b`: `along = s²/12 + b²/5`
        // of Hertz's pressures. `16/(3π) b³ + s b² = 4 k F R` is Hertz's disc for `s = 0` and his strip for a long one.
        let straight = |width: Real| (12.0 * (along - width * width / 5.0)).max(0.0).sqrt();
        let width = |straight: Real| {
            (0..6).fold(disc, |b, _| {
                let slope = b * (16.0 / PI * b + 2.0 * straight);
                let excess = b * b * (16.0 / (3.0 * PI) * b + straight) - load;
                if slope > 0.0 { b - excess / slope } else { b }
            })
        };
        let b = if part.is_ball() { disc } else { width(straight(width(straight(disc)))) };
        // The force and the width are each the other's answer: to go all the way to the last one would overshoot where a tool is deep.
        let half_way = edges.map_or(WIDER * b, |[_, [low, high]]| 0.5 * (0.5 * (high - low) + WIDER * b));
        let half_width = half_way.clamp(LEAST_CAP * radius, MOST_CAP * radius);
        if part.is_ball() {
            return Self { line: [0.0; 2], across: [0.0; 2], half_width, grows: false };
        }
        // What is beyond an end is no farther from it than beside it.
        let [low, high] = part.seen(view);
        // A pressure that is elliptic along the line reaches farther than a constant one.
        let half = (5.0_f64 / 12.0).sqrt() * straight(b);
        // Not `clamp`, which panics where a bound is no number.
        let middle = middle[0].max(low).min(high);
        let line = [(middle - half).max(low), (middle + half).min(high)];
        Self { line, across: [0.0; 2], half_width, grows: false }
    }

    /// Where a solid part of this `outline` that `pressed` on a patch with these `edges` presses now: on as much as the force is spread over.
    /// Of Hertz's pressures on a disc, the mean square is a fifth of the squared radius; of others that end somewhere it is more, and of a flat
    /// face, which ends with the part, much more.
    pub(super) fn of_solid(part: &MovingPart, outline: &Silhouette, pressed: &Pressed, edges: [[Real; 2]; 2]) -> Self {
        let least = LEAST_CAP * part.radius();
        Self::rectangle([0, 1].map(|c| {
            let [low, high] = outline.bounds[c];
            let [before, behind] = pressed.spread[c].map(|spread| (WIDER * (6.0 * spread).sqrt()).max(least));
            let [from, to] = [-before, behind].map(|aside| pressed.middle[c] + aside);
            // Half of the way, as of round parts.
            let [from, to] = [0.5 * (edges[c][0] + from.max(low)), 0.5 * (edges[c][1] + to.min(high))];
            [from.max(low).min(high - least), to.min(high).max(low + least)]
        }))
    }

    /// From where to where along both axes of the view it is [m].
    pub(super) fn rectangle([line, across]: [[Real; 2]; 2]) -> Self {
        Self { line, across, half_width: 0.0, grows: false }
    }

    /// A rectangle that reaches farther along and across [m].
    pub(super) fn grown(&self, by: [Real; 2]) -> Self {
        let [line, across] = [(self.line, by[0]), (self.across, by[1])].map(|([from, to], by)| [from - by, to + by]);
        Self { line, across, ..*self }
    }

    /// Length and width of its straight part [m].
    pub(super) fn straight(&self) -> [Real; 2] {
        [self.line, self.across].map(|[from, to]| to - from)
    }

    /// Sides of its cells, so many `columns` and `rows` [m].
    pub(super) fn sides(&self, [columns, rows]: [usize; 2]) -> [Real; 2] {
        let [long, wide] = self.straight().map(|straight| straight + 2.0 * self.half_width);
        [long / columns as Real, wide / rows as Real]
    }

    /// Half-width of the patch of a round part that has these samples, whose normals are told by number [m].
    pub(super) fn half_width_of(part: &MovingPart, view: &View, normal: impl Fn(usize) -> Vec3) -> Real {
        let Some([columns, rows]) = part.cells() else {
            return normal(0).cross(&normal(1)).norm() * rings(part) * part.radius();
        };
        let row = |row: usize| view.across[1].dot(&normal(row * columns + columns / 2));
        0.5 * rows as Real / (rows - 1) as Real * (row(rows - 1) - row(0)).abs() * part.radius()
    }

    /// Its sample number `i`.
    pub(super) fn spot(&self, part: &MovingPart, view: &View, outline: Option<&Silhouette>, i: usize) -> Spot {
        let cell = self.cell(part, i);
        let Cell { at, area, spread, starts_row } = cell;
        if let Some(outline) = outline {
            return self.spot_of_solid(part, view, outline, &cell);
        }
        let Some(foot) = part.front(view, at) else { return beside(part, view, &cell) };
        let Foot { arm, core, normal, outside, .. } = foot;
        let slope = normal.dot(&view.ahead);
        let width = (area / PI).sqrt();
        // All of a sample counts while its middle can be touched.
        let share = part_before(2.0 * outside / width - 1.0).min(part.part_alone(arm, normal, width));
        let curved = spread[1] + foot.curved_along(spread[0]);
        let rounded = curved / (2.0 * part.radius() * slope);
        Spot { arm, core, normal, area: share * area / slope, rounded, starts_row }
    }

    /// Of what is seen of a solid part within a cell: as an edge or a rim may go through it, it is looked at in four places (those of Gauss).
    fn spot_of_solid(&self, part: &MovingPart, view: &View, outline: &Silhouette, cell: &Cell) -> Spot {
        let [along, across] = cell.spread.map(Real::sqrt);
        let width = (0.25 * cell.area / PI).sqrt();
        let (mut all, mut arm, mut normal) = (0.0, Vec3::zeros(), Vec3::zeros());
        for [x, y] in [[-1.0, -1.0], [1.0, -1.0], [-1.0, 1.0], [1.0, 1.0]] {
            let mut at = [cell.at[0] + x * along, cell.at[1] + y * across];
            let (beyond, out) = outline.outside(at);
            let share = part_before(beyond / width);
            if beyond > -EDGE {
                at = [0, 1].map(|c| at[c] - (beyond + EDGE) * out[c]);
            }
            if let Some(foot) = (share > 0.0).then(|| part.front(view, at)).flatten() {
                all += 0.25 * share;
                arm += foot.arm * (0.25 * share);
                normal += foot.normal * (0.25 * share);
            }
        }
        let Some(normal) = normal.try_normalize(1e-9) else { return beside(part, view, cell) };
        let arm = arm / all;
        let slope = normal.dot(&view.ahead);
        let share = all * part.part_alone(arm, normal, 2.0 * width);
        let core = part.at.frame.own(part.start() + arm - normal * part.radius());
        Spot { arm, core, normal, area: share * cell.area / slope, rounded: 0.0, starts_row: cell.starts_row }
    }

    /// Its cell number `i`.
    fn cell(&self, part: &MovingPart, i: usize) -> Cell {
        let Some(cells) = part.cells() else {
            let width = self.half_width / rings(part);
            let area = PI * width * width * if i == 0 { 0.25 } else { 1.0 / 3.0 };
            let spread = [area / (4.0 * PI); 2];
            // The ring that it is in, and its place there.
            let ring = (1..=part.density.rings).filter(|k| i > 3 * k * (k - 1)).count();
            if ring == 0 {
                return Cell { at: [self.line[0], 0.0], area, spread, starts_row: true };
            }
            let place = i - 1 - 3 * ring * (ring - 1);
            let (sin, cos) = libm::sincos(2.0 * PI * place as Real / (6 * ring) as Real);
            let away = ring as Real * width;
            let at = [self.line[0] + away * cos, away * sin];
            return Cell { at, area, spread, starts_row: place == 0 };
        };
        let sides = self.sides(cells);
        let number = [i % cells[0], i / cells[0]];
        let middle = [self.line, self.across].map(|[from, to]| 0.5 * (from + to));
        let at = |c: usize| middle[c] + sides[c] * (number[c] as Real - 0.5 * (cells[c] - 1) as Real);
        Cell {
            at: [at(0), at(1)],
            area: sides[0] * sides[1],
            spread: sides.map(|side| side * side / 12.0),
            starts_row: number[0] == 0,
        }
    }

    /// True for what is on it or less than `reach` [m] from its line, `at` being from the part's start as it is seen [m].
    pub(super) fn covers(&self, at: [Real; 2], reach: Real) -> bool {
        let beyond = |x: Real, [low, high]: [Real; 2]| x - x.max(low).min(high);
        let along = if self.grows { 0.0 } else { beyond(at[0], self.line) };
        let across = beyond(at[1], self.across);
        let squared = along * along + across * across;
        squared == 0.0 || squared < reach * reach
    }
}

/// A sample that is beside the part.
fn beside(part: &MovingPart, view: &View, cell: &Cell) -> Spot {
    let (arm, normal) = (view.across[0] * cell.at[0] + view.across[1] * cell.at[1], view.ahead);
    // A solid's coordinates are places; an axis has none there.
    let core =
        if part.is_solid() { part.at.frame.own(part.start() + arm - normal * part.radius()) } else { Vec3::zeros() };
    Spot { arm, core, normal, area: 0.0, rounded: 0.0, starts_row: cell.starts_row }
}

/// Half-width of a disc over what its rings are apart.
fn rings(part: &MovingPart) -> Real {
    part.density.rings as Real + 0.3
}

/// Outermost samples over what is touched: just outside of it. With less the force is too high, as what is beside presses nothing;
/// with more samples lie idle.
const WIDER: Real = 1.05;
/// Over the radius, what is looked at before there is a load: the disc of a depth of 1/500 of the radius.
const LEAST_CAP: Real = 0.045;
/// How far inside of its silhouette a part is looked at where it ends [m]: with nothing, rounding decides whether there is anything ahead;
/// with more than a micrometre the place would not be the end.
const EDGE: Real = 1e-9;
