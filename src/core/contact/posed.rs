//! The parts of a tool where they are: what contact asks of them.

use super::jaws::Stance;
use super::shape::{Core, Frame, MOST_PARTS, Part, Shape};
use crate::math::{Bounds, Pose, Real, Vec3, from_parry, to_parry};
use parry3d_f64::query::PointQuery;
use parry3d_f64::query::details::closest_points_segment_segment_with_locations_nD as segment_segment;
use parry3d_f64::shape::{Segment, Triangle};

/// The parts of a tool where it stands, and how many they are: what is behind them repeats the first.
pub fn posed<'a>(stance: &Stance, shape: &'a Shape) -> ([Posed<'a>; MOST_PARTS], usize) {
    let mut all = [Posed::new(stance, &shape.parts()[0]); MOST_PARTS];
    for (posed, part) in all.iter_mut().zip(shape.parts()).skip(1) {
        *posed = Posed::new(stance, part);
    }
    (all, shape.parts().len())
}

/// A part of a tool where it is.
#[derive(Clone, Copy, Debug)]
pub struct Posed<'a> {
    /// The part.
    pub part: &'a Part,
    /// The tool's frame as the part has it.
    pub carrier: Pose,
    /// Its core in the world.
    pub frame: Frame,
}

impl<'a> Posed<'a> {
    /// `part` of a tool that stands so.
    pub fn new(stance: &Stance, part: &'a Part) -> Self {
        let carrier = stance.of_part(part);
        Self { part, carrier, frame: Frame::new(&carrier, part) }
    }

    /// Coordinates of the core's point nearest to the world's place `p`; where `p` is inside, those of `p`.
    pub fn nearest(&self, p: Vec3) -> Vec3 {
        match &self.part.core {
            Core::Axis(_) => Vec3::new(0.0, 0.0, self.along(p)),
            Core::Solid(solid) => solid.nearest(self.frame.own(p)),
        }
    }

    /// World's place in the middle of the core's box.
    pub fn middle(&self) -> Vec3 {
        self.frame.at(self.part.core.bounds().middle())
    }

    /// Part of the axis (0..=1) nearest to `p`.
    fn along(&self, p: Vec3) -> Real {
        let axis = self.frame.axes[2];
        let length_squared = axis.norm_squared();
        if length_squared == 0.0 {
            return 0.0;
        }
        ((p - self.frame.from).dot(&axis) / length_squared).clamp(0.0, 1.0)
    }

    /// True when the surface can get inside of the core.
    pub fn is_solid(&self) -> bool {
        self.part.is_solid()
    }

    /// Where the way from the world's place `p` along the unit vector `d` leaves a solid core (coordinates), and how long
    /// it is [m]; `None` for an axis, which has no inside.
    pub fn exit(&self, p: Vec3, d: Vec3) -> Option<(Vec3, Real)> {
        match &self.part.core {
            Core::Axis(_) => None,
            Core::Solid(solid) => {
                let (p, d) = (self.frame.own(p), self.frame.own_direction(d));
                let way = solid.exit(p, d);
                Some((p + d * way, way))
            }
        }
    }

    /// How deep the world's place `p` is inside of a solid core at the least [m]; zero outside.
    pub(super) fn depth(&self, p: Vec3) -> Real {
        match &self.part.core {
            Core::Axis(_) => 0.0,
            Core::Solid(solid) => solid.depth(self.frame.own(p)),
        }
    }

    /// Box around the core, grown by `reach`.
    pub fn window(&self, reach: Real) -> Bounds {
        let own = self.part.core.bounds();
        let (middle, half) = (own.middle(), own.size() * 0.5);
        let size: Vec3 = (0..3).map(|c| self.frame.axes[c].abs() * half[c]).sum();
        let place = self.frame.at(middle);
        Bounds { low: place - size.add_scalar(reach), high: place + size.add_scalar(reach) }
    }

    /// True where a triangle is farther than `reach` [m] from the core beyond doubt: a box around a slanted core says less.
    pub(super) fn is_apart(&self, corners: &[Vec3; 3], reach: Real) -> bool {
        match &self.part.core {
            Core::Axis(_) => {
                let middle = (corners[0] + corners[1] + corners[2]) / 3.0;
                let size = corners.iter().map(|p| (p - middle).norm_squared()).fold(0.0, Real::max).sqrt();
                let away = middle - self.frame.at(Vec3::new(0.0, 0.0, self.along(middle)));
                away.norm() > reach + size
            }
            core @ Core::Solid(_) => core.bounds().grown(reach).is_apart(&corners.map(|p| self.frame.own(p))),
        }
    }

    /// The place of a triangle that is nearest to the core, or deepest in it along `push`, along which the core would push
    /// it out; for an axis also the coordinates of its nearest point.
    pub fn nearest_in_triangle(&self, corners: &[Vec3; 3], push: Vec3) -> (Vec3, Option<Vec3>) {
        match &self.part.core {
            Core::Axis(_) => self.nearest_to_axis(corners),
            Core::Solid(solid) => {
                let own = corners.map(|p| self.frame.own(p));
                (self.frame.at(solid.nearest_in_triangle(&own, self.frame.own_direction(push))), None)
            }
        }
    }

    fn nearest_to_axis(&self, corners: &[Vec3; 3]) -> (Vec3, Option<Vec3>) {
        let triangle = Triangle::new(to_parry(corners[0]), to_parry(corners[1]), to_parry(corners[2]));
        let on_triangle = |p: Vec3| from_parry(triangle.project_local_point(to_parry(p), true).point);
        // The nearest pair lies at an end of the axis or between the axis and an edge; an axis that pierces the triangle
        // has passed the surface, and its reference end still gives the side.
        let mut best = (Real::INFINITY, Vec3::zeros(), Vec3::zeros());
        let mut keep = |along: Real, p: Vec3| {
            let core = Vec3::new(0.0, 0.0, along);
            let distance = (p - self.frame.at(core)).norm_squared();
            if distance < best.0 {
                best = (distance, p, core);
            }
        };
        let ends = [0.0, 1.0].map(|part| self.frame.at(Vec3::new(0.0, 0.0, part)));
        keep(0.0, on_triangle(ends[0]));
        if self.frame.axes[2].norm_squared() > 0.0 {
            keep(1.0, on_triangle(ends[1]));
            let axis = Segment::new(to_parry(ends[0]), to_parry(ends[1]));
            for i in 0..3 {
                let edge = Segment::new(to_parry(corners[i]), to_parry(corners[(i + 1) % 3]));
                let (_, place) = segment_segment((&axis.a, &axis.b), (&edge.a, &edge.b));
                let p = from_parry(edge.point_at(&place));
                keep(self.along(p), p);
            }
        }
        (best.1, Some(best.2))
    }
}
