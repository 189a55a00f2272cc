//! Shapes of tools: a few convex parts, each a core and a rounding around it, and what contact asks of them.
//!
//! The rounding makes the distance from a core smooth outside of it, and tells from which side a surface point comes. A
//! core's points have *coordinates* that turn and move with the tool: `(0, 0, part)` on an axis, metres in the part's
//! own frame in a solid core.

use super::hinge::Hinge;
pub use super::solid::MOST_CORNERS;
use super::solid::{Hull, Solid};
use crate::math::{Bounds, Pose, Real, Vec3};
pub use crate::model::constraint::MOST_PARTS;
use std::sync::Arc;

/// Rigid shape of a tool: convex parts in the tool's own frame.
#[derive(Clone, Debug, PartialEq)]
pub struct Shape {
    /// Shared, so that a tool takes another shape without allocating.
    parts: Arc<[Part]>,
    /// See [`Shape::grip`].
    grip: Real,
}

impl Shape {
    /// A ball of `radius` [m] around the reference point.
    pub fn ball(radius: Real) -> Self {
        Self::capsule(radius, 0.0)
    }

    /// Everything within `radius` [m] of the axis from the reference point along the tool's own +z, `length` [m].
    pub fn capsule(radius: Real, length: Real) -> Self {
        Part::capsule(radius, length).into()
    }

    /// Of one to [`MOST_PARTS`] parts; `None` for another number.
    pub fn compound(parts: Vec<Part>) -> Option<Self> {
        (1..=MOST_PARTS).contains(&parts.len()).then(|| Self { parts: parts.into(), grip: 0.0 })
    }

    /// The same shape, of which the hinged parts press with `grip` [N·m].
    pub fn with_grip(self, grip: Real) -> Self {
        Self { grip, ..self }
    }

    /// Moment between its jaws where a client closes them all the way and something holds them open as far as they go [N·m]; 0:
    /// nothing makes them give way.
    pub fn grip(&self) -> Real {
        self.grip
    }

    /// Its parts.
    pub fn parts(&self) -> &[Part] {
        &self.parts
    }

    /// Radius of the ball around the reference point that holds the shape [m].
    pub fn bounding_radius(&self) -> Real {
        self.parts.iter().map(|p| p.bounding_radius).fold(0.0, Real::max)
    }
}

impl From<Part> for Shape {
    fn from(part: Part) -> Self {
        Self { parts: Arc::new([part]), grip: 0.0 }
    }
}

/// A convex part of a tool.
#[derive(Clone, Debug, PartialEq)]
pub struct Part {
    pub(super) core: Core,
    /// Of the rounding around the core [m].
    pub(super) radius: Real,
    /// Where it is in the tool's own frame, ...
    place: Pose,
    /// ... from where this turns it.
    hinge: Option<Hinge>,
    /// Half of its least width [m].
    half_thickness: Real,
    /// Capsule about as large: start and axis in the tool's own frame [m], and radius [m].
    outline: (Vec3, Vec3, Real),
    /// Radius of the ball around the tool's reference point that holds it [m].
    bounding_radius: Real,
}

/// What a part is rounded around.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Core {
    /// From the origin along +z [m]; 0 for a point.
    Axis(Real),
    Solid(Solid),
}

impl Part {
    /// As [`Shape::capsule`].
    pub fn capsule(radius: Real, length: Real) -> Self {
        Self::new(Core::Axis(length), radius, radius, (Vec3::zeros(), Vec3::z() * length, radius))
    }

    /// A cylinder of `radius` from the reference point along +z, `length` long, with flat ends and its rims rounded by
    /// `rounding`, which is at most the radius and half the length [m].
    pub fn cylinder(radius: Real, length: Real, rounding: Real) -> Self {
        let solid = Solid::Cylinder {
            radius: (radius - rounding).max(0.0),
            low: rounding.min(0.5 * length),
            high: (length - rounding).max(0.5 * length),
        };
        // A flat disc becomes a capsule across.
        let (start, along, round) = if length < 2.0 * radius {
            let across = radius - 0.5 * length;
            (Vec3::new(-across, 0.0, 0.5 * length), Vec3::x() * (2.0 * across), 0.5 * length)
        } else {
            (Vec3::z() * radius, Vec3::z() * (length - 2.0 * radius), radius)
        };
        Self::new(Core::Solid(solid), rounding, radius.min(0.5 * length), (start, along, round))
    }

    /// The convex hull of `points` [m] and everything within `rounding` [m] of it; `None` where the points lie in a plane
    /// or are not finite.
    pub fn convex(points: &[Vec3], rounding: Real) -> Option<Self> {
        let hull = Hull::new(points)?;
        let half_thickness = 0.5 * hull.least_width() + rounding;
        let outline = outline(&hull.corners, rounding);
        Some(Self::new(Core::Solid(Solid::Hull(hull)), rounding, half_thickness, outline))
    }

    fn new(core: Core, radius: Real, half_thickness: Real, outline: (Vec3, Vec3, Real)) -> Self {
        let part =
            Self { core, radius, place: Pose::default(), hinge: None, half_thickness, outline, bounding_radius: 0.0 };
        part.at(Pose::default())
    }

    /// The same part with its frame at `place` of the tool's own frame.
    pub fn at(mut self, place: Pose) -> Self {
        let (old, (start, along, radius)) = (self.place, self.outline);
        self.outline = (place.to_world(old.to_own(start)), place.rotate(old.unrotate(along)), radius);
        self.place = place;
        self.bounded()
    }

    /// The same part on a hinge.
    pub fn hinged(mut self, hinge: Hinge) -> Self {
        self.hinge = Some(hinge);
        self.bounded()
    }

    /// With the ball that holds it however it is turned about its hinge.
    fn bounded(mut self) -> Self {
        let about = self.hinge.map_or(Vec3::zeros(), |hinge| hinge.point);
        self.bounding_radius = about.norm() + self.farthest(about);
        self
    }

    /// What it turns about as the tool's jaws open.
    pub fn hinge(&self) -> Option<&Hinge> {
        self.hinge.as_ref()
    }

    /// How far from its hinge it reaches at most [m].
    pub(super) fn reach(&self) -> Real {
        self.hinge.map_or(0.0, |hinge| self.farthest(hinge.point))
    }

    /// How far from `point` of the tool's own frame it reaches at most [m].
    fn farthest(&self, point: Vec3) -> Real {
        let frame = Frame::new(&Pose::default(), self);
        self.core.box_corners().map(|c| (frame.at(c) - point).norm()).fold(0.0, Real::max) + self.radius
    }

    /// Radius of the rounding around the core [m].
    pub fn radius(&self) -> Real {
        self.radius
    }

    /// Half of the least width [m].
    pub fn half_thickness(&self) -> Real {
        self.half_thickness
    }

    /// Radius of a ball [m]; `None` for other shapes.
    pub fn ball_radius(&self) -> Option<Real> {
        matches!(self.core, Core::Axis(0.0)).then_some(self.radius)
    }

    /// A capsule about as large: start and axis in the tool's own frame as the part has it [m], and its radius [m].
    pub fn outline(&self) -> (Vec3, Vec3, Real) {
        self.outline
    }

    /// Radius of the ball around the tool's reference point that holds the part [m].
    pub fn bounding_radius(&self) -> Real {
        self.bounding_radius
    }

    /// True when the surface can get inside of the core.
    pub fn is_solid(&self) -> bool {
        self.core.is_solid()
    }

    /// Unit vectors along the two longest sides of a solid, in its own frame.
    pub(super) fn long_sides(&self) -> [Vec3; 2] {
        match &self.core {
            Core::Solid(Solid::Hull(hull)) => hull.long_sides,
            Core::Axis(_) | Core::Solid(Solid::Cylinder { .. }) => [Vec3::z(), Vec3::x()],
        }
    }

    /// What it is made of, in the tool's own frame: all that is within [`radius`](Self::radius) of the convex hull of
    /// points [m]; in a cylinder, of a disc that goes from one to the other: its radius [m] and the unit vector across it.
    pub fn hull(&self) -> (Vec<Vec3>, Option<(Real, Vec3)>) {
        let (points, disc) = match &self.core {
            Core::Axis(0.0) => (vec![Vec3::zeros()], None),
            Core::Axis(length) => (vec![Vec3::zeros(), Vec3::z() * *length], None),
            Core::Solid(Solid::Hull(hull)) => (hull.corners.clone(), None),
            Core::Solid(Solid::Cylinder { radius, low, high }) => {
                (vec![Vec3::z() * *low, Vec3::z() * *high], Some((*radius, self.place.rotate(Vec3::z()))))
            }
        };
        (points.into_iter().map(|p| self.place.to_world(p)).collect(), disc)
    }
}

/// A capsule about as large as the box of `points`, along the box's longest edge.
fn outline(points: &[Vec3], rounding: Real) -> (Vec3, Vec3, Real) {
    let around = Bounds::of(points.iter().copied());
    let (middle, half) = (around.middle(), around.size() * 0.5);
    let longest = half.imax();
    let radius = (0..3).filter(|c| *c != longest).map(|c| half[c]).fold(0.0, Real::max);
    let mut reach = Vec3::zeros();
    reach[longest] = half[longest] - radius;
    (middle - reach, reach * 2.0, radius + rounding)
}

impl Core {
    pub(super) fn is_solid(&self) -> bool {
        matches!(self, Core::Solid(_))
    }

    /// Least and greatest coordinates.
    pub(super) fn bounds(&self) -> Bounds {
        match self {
            Core::Axis(_) => Bounds { low: Vec3::zeros(), high: Vec3::z() },
            Core::Solid(Solid::Hull(hull)) => hull.bounds,
            Core::Solid(Solid::Cylinder { radius, low, high }) => {
                Bounds { low: Vec3::new(-radius, -radius, *low), high: Vec3::new(*radius, *radius, *high) }
            }
        }
    }

    /// Corners of the box of its coordinates.
    fn box_corners(&self) -> impl Iterator<Item = Vec3> {
        let Bounds { low, high } = self.bounds();
        (0..8).map(move |i| Vec3::from_fn(|c, _| if i >> c & 1 == 0 { low[c] } else { high[c] }))
    }
}

/// A part's core in the world.
#[derive(Clone, Copy, Debug)]
pub struct Frame {
    pub(super) from: Vec3,
    /// What the coordinates count: the axis of a ball or capsule is the third, of any length.
    pub(super) axes: [Vec3; 3],
}

impl Frame {
    /// Of `part` whose tool's frame is `pose`, as the part has it.
    pub fn new(pose: &Pose, part: &Part) -> Self {
        let length = match part.core {
            Core::Axis(length) => length,
            Core::Solid(_) => 1.0,
        };
        let turned = |v: Vec3| pose.rotate(part.place.rotate(v));
        Self {
            from: pose.to_world(part.place.position),
            axes: [turned(Vec3::x()), turned(Vec3::y()), turned(Vec3::z() * length)],
        }
    }

    /// World's place of the core's point `core` (coordinates).
    pub fn at(&self, core: Vec3) -> Vec3 {
        self.from + (self.axes[0] * core.x + self.axes[1] * core.y + self.axes[2] * core.z)
    }

    /// Coordinates of the world's place `p`, for a solid core.
    pub(super) fn own(&self, p: Vec3) -> Vec3 {
        self.own_direction(p - self.from)
    }

    /// World's direction of one in coordinates, for a solid core.
    pub(super) fn direction(&self, d: Vec3) -> Vec3 {
        self.axes[0] * d.x + self.axes[1] * d.y + self.axes[2] * d.z
    }

    pub(super) fn own_direction(&self, d: Vec3) -> Vec3 {
        Vec3::new(self.axes[0].dot(&d), self.axes[1].dot(&d), self.axes[2].dot(&d))
    }

    /// How far any point of the core of `part` moves from here to `other` at most, on a straight way [m].
    pub fn farthest_move(&self, other: &Frame, part: &Part) -> Real {
        part.core.box_corners().map(|c| (other.at(c) - self.at(c)).norm()).fold(0.0, Real::max)
    }
}
