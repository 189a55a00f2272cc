//! A convex part of a tool as it moves within a tick, and what of it is foremost along the direction in which it pushes.

use super::density::Density;
use super::posed::Posed;
use super::shape::Core;
use super::solid::Solid;
use super::view::{LEAST_FACING, View, part_before};
use crate::math::{Real, Vec3};
use std::ops::Range;

/// A part of a tool that may touch.
#[derive(Clone, Copy, Debug)]
pub(super) struct MovingPart<'a> {
    /// In the middle of the tick.
    pub(super) at: &'a Posed<'a>,
    /// Its number among the parts of its tool, ...
    pub(super) number: usize,
    /// ... and all of them.
    pub(super) all: &'a [Posed<'a>],
    /// At its start and at its end.
    pub(super) moves: [&'a Posed<'a>; 2],
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
    /// From the part's start [m].
    pub(super) arm: Vec3,
    /// How far beyond an end of the axis it is seen [m]: there it is curved along the axis as across.
    pub(super) beyond: Real,
    /// How far it is seen outside of what can be touched of the tool [m].
    pub(super) outside: Real,
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

impl<'a> MovingPart<'a> {
    /// Of the rounding around its core [m].
    pub(super) fn radius(&self) -> Real {
        self.at.part.radius()
    }

    /// What its places are counted from: the start of its axis, or the middle of its solid core [m].
    pub(super) fn start(&self) -> Vec3 {
        if self.is_solid() { self.at.middle() } else { self.at.frame.at(Vec3::zeros()) }
    }

    /// The place of its surface, from its start [m], that is next to these coordinates, where it faces along `normal`.
    pub(super) fn arm(&self, core: Vec3, normal: Vec3) -> Vec3 {
        self.at.frame.at(core) - self.start() + normal * self.radius()
    }

    /// The axis of a ball or capsule from end to end [m]; zero for a ball.
    pub(super) fn axis(&self) -> Vec3 {
        self.at.frame.axes[2]
    }

    pub(super) fn is_ball(&self) -> bool {
        self.at.part.ball_radius().is_some()
    }

    pub(super) fn is_solid(&self) -> bool {
        self.at.is_solid()
    }

    /// Samples of each of its patches.
    pub(super) fn samples(&self) -> usize {
        self.density.samples(self.at.part)
    }

    /// Columns and rows of a patch that has such.
    pub(super) fn cells(&self) -> Option<[usize; 2]> {
        (!self.is_ball()).then(|| self.density.cells(self.at.part))
    }

    /// Those of its samples that are foremost: on the line of a rod.
    pub(super) fn on_line(&self) -> Range<usize> {
        match self.cells() {
            None => 0..1,
            Some([columns, rows]) if self.is_solid() => 0..columns * rows,
            Some([columns, rows]) => columns * (rows / 2)..columns * (rows / 2 + 1),
        }
    }

    /// Which one of them is in the middle.
    pub(super) fn middle(&self) -> usize {
        if self.is_ball() { 0 } else { self.samples() / 2 }
    }

    /// True for the first and for the last sample of a row.
    pub(super) fn is_outermost(&self, i: usize) -> bool {
        self.cells().is_some_and(|[columns, _]| i.is_multiple_of(columns) || i % columns == columns - 1)
    }

    /// Part of a disc of radius `width` [m] around a place of its surface that is not inside of another part of the tool.
    pub(super) fn part_alone(&self, arm: Vec3, normal: Vec3, width: Real) -> Real {
        let p = self.start() + arm;
        let others = self.all.iter().enumerate().filter(|(i, _)| *i != self.number);
        let part = |other: &Posed| {
            let away = p - other.frame.at(other.nearest(p));
            let depth = other.part.radius() - away.norm() + other.depth(p);
            // Along the surface to where that of the other part comes through it.
            let rises = away.try_normalize(1e-9).map_or(1.0, |out| out.cross(&normal).norm());
            if depth == 0.0 { 0.5 } else { part_before(depth / (rises * width)) }
        };
        others.map(|(_, other)| part(other)).fold(1.0, Real::min)
    }

    /// Which end of the axis is ahead.
    fn foremost(&self, view: &View) -> Real {
        if view.ahead.dot(&self.axis()) > 0.0 { 1.0 } else { 0.0 }
    }

    /// From where to where along the first axis of the view the axis of a rod is seen, from its start [m].
    pub(super) fn seen(&self, view: &View) -> [Real; 2] {
        let (axis, shadow) = (self.axis(), view.across[0].dot(&self.axis()));
        if shadow < LEAST_FACING * axis.norm() { [self.foremost(view) * shadow; 2] } else { [0.0, shadow] }
    }

    /// What is foremost in this view at the place `x`, `y` from the start [m]; nothing beside it.
    pub(super) fn front(&self, view: &View, [x, y]: [Real; 2]) -> Option<Foot> {
        let (radius, axis, [u, v]) = (self.radius(), self.axis(), view.across);
        if let Some(solid) = self.solid() {
            let frame = &self.at.frame;
            let p = frame.own(self.start() + u * x + v * y);
            let (core, normal) = solid.front(p, frame.own_direction(view.ahead), radius, LEAST_FACING)?;
            let normal = frame.direction(normal);
            return Some(Foot { core, normal, arm: self.arm(core, normal), beyond: Real::INFINITY, outside: 0.0 });
        }
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

    /// How far a place inside of its solid core is from its surface along the unit vector `d` [m], and the part's normal there; nothing where
    /// it turns away from that.
    pub(super) fn way_out(&self, place: Vec3, d: Vec3) -> Option<(Real, Vec3)> {
        let (frame, radius) = (&self.at.frame, self.radius());
        let (core, normal) = self.solid()?.front(frame.own(place), frame.own_direction(d), radius, LEAST_FACING)?;
        let normal = frame.direction(normal);
        Some((d.dot(&(frame.at(core) + normal * radius - place)), normal))
    }

    /// Its solid core.
    pub(super) fn solid(&self) -> Option<&'a Solid> {
        match &self.at.part.core {
            Core::Axis(_) => None,
            Core::Solid(solid) => Some(solid),
        }
    }

    /// Which way the first axis of a view along `ahead` goes, for a solid: along its longest side, as far as that is seen from aside, else along
    /// the next one.
    pub(super) fn longest_across(&self, ahead: Vec3) -> Vec3 {
        let [first, second] = self.at.part.long_sides().map(|side| self.at.frame.direction(side));
        let aside = |v: Vec3| v - ahead * ahead.dot(&v);
        let part = (aside(first).norm_squared() / (LEAST_FACING * LEAST_FACING)).min(1.0);
        aside(first) * part + aside(second) * (1.0 - part)
    }
}

/// What can be touched of a solid part as it is seen: a convex polygon.
#[derive(Clone, Copy, Debug)]
pub(super) struct Silhouette {
    /// How far out its sides are [m], of which the normals are [`AROUND`].
    sides: [Real; AROUND.len()],
    /// Least and greatest places along both axes of the view [m].
    pub(super) bounds: [[Real; 2]; 2],
}

impl Silhouette {
    /// Of a solid part, from its start: in each direction it ends where the part turns away from what is ahead.
    pub(super) fn of(part: &MovingPart, solid: &Solid, view: &View) -> Self {
        let (start, frame, [u, v]) = (part.start(), &part.at.frame, view.across);
        let sides = AROUND.map(|[x, y]| {
            let aside = u * x + v * y;
            let last = view.ahead * LEAST_FACING + aside * MOST_CAP;
            let corner = frame.at(solid.foremost(frame.own_direction(last)));
            aside.dot(&(corner - start)) + MOST_CAP * part.radius()
        });
        let quarter = AROUND.len() / 4;
        let bounds = [0, quarter].map(|i| [-sides[i + 2 * quarter], sides[i]]);
        Self { sides, bounds }
    }

    /// How far a place is outside of it [m], below zero inside, and which way that is.
    pub(super) fn outside(&self, [x, y]: [Real; 2]) -> (Real, [Real; 2]) {
        let away = |(out, far): (&[Real; 2], &Real)| (out[0] * x + out[1] * y - far, *out);
        let all = AROUND.iter().zip(&self.sides).map(away);
        all.reduce(|a, b| if b.0 > a.0 { b } else { a }).unwrap_or((0.0, [0.0; 2]))
    }
}

/// Unit vectors around, a quarter of a turn after as many.
const AROUND: [[Real; 2]; 24] = {
    // Cosines of 0°, 15° and so on.
    const C: [Real; 7] = [
        1.0,
        0.965_925_826_289_068_3,
        0.866_025_403_784_438_6,
        std::f64::consts::FRAC_1_SQRT_2,
        0.5,
        0.258_819_045_102_520_76,
        0.0,
    ];
    let mut around = [[0.0; 2]; 24];
    let mut i = 0;
    while i < 6 {
        let [x, y] = [C[i], C[6 - i]];
        around[i] = [x, y];
        around[i + 6] = [-y, x];
        around[i + 12] = [-x, -y];
        around[i + 18] = [y, -x];
        i += 1;
    }
    around
};

/// Over the radius: at 1 the outermost samples push sideways alone; with less a deep ball is not felt where it is widest.
pub(super) const MOST_CAP: Real = 0.95;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_silhouette_has_sides_all_around() {
        for (i, [x, y]) in AROUND.into_iter().enumerate() {
            let (sin, cos) = (std::f64::consts::TAU * i as Real / AROUND.len() as Real).sin_cos();
            assert!((x - cos).abs() < 1e-15 && (y - sin).abs() < 1e-15, "{i}");
        }
        assert!((LEAST_FACING.powi(2) + MOST_CAP.powi(2) - 1.0).abs() < 1e-3);
    }
}
