//! Shapes of tools: a few convex parts, each a core and a rounding around it, and what contact asks of them.
//!
//! The rounding makes the distance from a core smooth outside of it, and tells from which side a surface point comes. A
//! core's points have *coordinates* that turn and move with the tool: `(0, 0, part)` on an axis, metres in the part's
//! own frame in a solid core.

use crate::math::{ParryVec, Pose, Real, Vec3, from_parry, is_finite, to_parry};
use parry3d_f64::query::PointQuery;
use parry3d_f64::query::details::closest_points_segment_segment_with_locations_nD as segment_segment;
use parry3d_f64::query::details::closest_points_support_map_support_map_with_params as closest_of_support_maps;
use parry3d_f64::query::gjk::{ConstantPoint, GJKResult, VoronoiSimplex};
use parry3d_f64::shape::{Segment, SupportMap, Triangle};
use parry3d_f64::transformation::try_convex_hull;

/// Most parts of a shape: what bounds the cost of a tick.
pub const MOST_PARTS: usize = 8;

/// Most corners of a convex core, for the same reason.
pub const MOST_CORNERS: usize = 64;

/// Rigid shape of a tool: convex parts in the tool's own frame.
#[derive(Clone, Debug, PartialEq)]
pub struct Shape {
    parts: Vec<Part>,
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
        (1..=MOST_PARTS).contains(&parts.len()).then_some(Self { parts })
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
        Self { parts: vec![part] }
    }
}

/// A convex part of a tool.
#[derive(Clone, Debug, PartialEq)]
pub struct Part {
    core: Core,
    /// Of the rounding around the core [m].
    radius: Real,
    /// Where it is in the tool's own frame.
    place: Pose,
    /// Half of its least width [m].
    half_thickness: Real,
    /// Capsule about as large: start and axis in the tool's own frame [m], and radius [m].
    outline: (Vec3, Vec3, Real),
    /// Radius of the ball around the tool's reference point that holds it [m].
    bounding_radius: Real,
}

#[derive(Clone, Debug, PartialEq)]
enum Core {
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
        let part = Self { core, radius, place: Pose::default(), half_thickness, outline, bounding_radius: 0.0 };
        part.at(Pose::default())
    }

    /// The same part with its frame at `place` of the tool's own frame.
    pub fn at(mut self, place: Pose) -> Self {
        let (old, (start, along, radius)) = (self.place, self.outline);
        self.outline = (place.to_world(old.to_own(start)), place.rotate(old.unrotate(along)), radius);
        self.place = place;
        let frame = Frame::new(&Pose::default(), &self);
        let farthest = self.core.box_corners().map(|c| frame.at(c).norm()).fold(0.0, Real::max);
        self.bounding_radius = farthest + self.radius;
        self
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

    /// A capsule about as large: start and axis in the tool's own frame [m], and its radius [m].
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
    let (low, high) = bounds(points);
    let (middle, half) = ((low + high) * 0.5, (high - low) * 0.5);
    let longest = half.imax();
    let radius = (0..3).filter(|c| *c != longest).map(|c| half[c]).fold(0.0, Real::max);
    let mut reach = Vec3::zeros();
    reach[longest] = half[longest] - radius;
    (middle - reach, reach * 2.0, radius + rounding)
}

fn bounds(points: &[Vec3]) -> (Vec3, Vec3) {
    let first = points.first().copied().unwrap_or_default();
    points.iter().fold((first, first), |(low, high), p| (low.inf(p), high.sup(p)))
}

impl Core {
    fn is_solid(&self) -> bool {
        matches!(self, Core::Solid(_))
    }

    /// Least and greatest coordinates.
    fn bounds(&self) -> (Vec3, Vec3) {
        match self {
            Core::Axis(_) => (Vec3::zeros(), Vec3::z()),
            Core::Solid(Solid::Hull(hull)) => hull.bounds,
            Core::Solid(Solid::Cylinder { radius, low, high }) => {
                (Vec3::new(-radius, -radius, *low), Vec3::new(*radius, *radius, *high))
            }
        }
    }

    /// Corners of the box of its coordinates.
    fn box_corners(&self) -> impl Iterator<Item = Vec3> {
        let (low, high) = self.bounds();
        (0..8).map(move |i| Vec3::from_fn(|c, _| if i >> c & 1 == 0 { low[c] } else { high[c] }))
    }
}

/// A core that a surface point can get inside of. All points are coordinates [m].
#[derive(Clone, Debug, PartialEq)]
enum Solid {
    /// Around z, between two heights.
    Cylinder {
        radius: Real,
        low: Real,
        high: Real,
    },
    Hull(Hull),
}

/// Convex hull of at most [`MOST_CORNERS`] points.
#[derive(Clone, Debug, PartialEq)]
struct Hull {
    corners: Vec<Vec3>,
    /// Outward unit normals and heights of the faces.
    faces: Vec<(Vec3, Real)>,
    bounds: (Vec3, Vec3),
}

/// Width of a hull, over its size, below which it counts as flat.
const FLAT: Real = 1e-4;

impl Hull {
    /// Of many points only those are kept that stand out the most.
    fn new(points: &[Vec3]) -> Option<Self> {
        let (low, high) = bounds(points);
        let size = (high - low).norm();
        if points.len() < 4 || !points.iter().all(is_finite) || size == 0.0 {
            return None;
        }
        // Four points that are far from each other, from their line and from their plane.
        let farthest = |from: &dyn Fn(&Vec3) -> Real| {
            points.iter().copied().reduce(|a, b| if from(&b) > from(&a) { b } else { a }).unwrap_or_default()
        };
        let a = farthest(&|p| p.x);
        let b = farthest(&|p| (p - a).norm_squared());
        let c = farthest(&|p| (p - a).cross(&(b - a)).norm_squared());
        let normal = (b - a).cross(&(c - a));
        let d = farthest(&|p| (p - a).dot(&normal).abs());
        let mut hull = Self::through(&[a, b, c, d], size)?;
        while hull.corners.len() < MOST_CORNERS {
            let next = farthest(&|p| hull.height(p));
            if hull.height(&next) <= 1e-6 * size {
                break;
            }
            hull.corners.push(next);
            hull = Self::through(&hull.corners, size)?;
        }
        Some(hull)
    }

    /// The hull of `points`, of this size.
    fn through(points: &[Vec3], size: Real) -> Option<Self> {
        let scaled: Vec<ParryVec> = points.iter().map(|p| to_parry((p - points[0]) / size)).collect();
        let (corners, triangles) = try_convex_hull(&scaled).ok()?;
        let corners: Vec<Vec3> = corners.iter().map(|p| from_parry(*p) * size + points[0]).collect();
        let middle = corners.iter().sum::<Vec3>() / corners.len() as Real;
        let mut faces: Vec<(Vec3, Real)> = Vec::new();
        for [a, b, c] in triangles.iter().map(|t| t.map(|i| corners[i as usize])) {
            let area = (b - a).cross(&(c - a));
            // Slivers lie in the planes of others.
            if area.norm() < 1e-9 * size * size {
                continue;
            }
            let normal = area.normalize();
            let normal = if normal.dot(&(a - middle)) < 0.0 { -normal } else { normal };
            let height = corners.iter().map(|p| normal.dot(p)).fold(Real::NEG_INFINITY, Real::max);
            if !faces.iter().any(|f| (f.0 - normal).norm() < 1e-7) {
                faces.push((normal, height));
            }
        }
        let bounds = bounds(&corners);
        let hull = Self { corners, faces, bounds };
        (hull.faces.len() >= 4 && hull.least_width() > FLAT * size).then_some(hull)
    }

    /// Height of `p` above the highest face: negative inside.
    fn height(&self, p: &Vec3) -> Real {
        self.faces.iter().map(|(n, h)| n.dot(p) - h).fold(Real::NEG_INFINITY, Real::max)
    }

    /// Least distance between a face and the corner opposite.
    fn least_width(&self) -> Real {
        let width = |(n, h): &(Vec3, Real)| h - self.corners.iter().map(|p| n.dot(p)).fold(Real::INFINITY, Real::min);
        self.faces.iter().map(width).fold(Real::INFINITY, Real::min)
    }
}

impl SupportMap for Solid {
    fn local_support_point(&self, direction: ParryVec) -> ParryVec {
        match self {
            Solid::Cylinder { radius, low, high } => {
                let across = (direction.x * direction.x + direction.y * direction.y).sqrt();
                let part = if across > 0.0 { radius / across } else { 0.0 };
                ParryVec::new(direction.x * part, direction.y * part, if direction.z < 0.0 { *low } else { *high })
            }
            Solid::Hull(hull) => {
                let d = from_parry(direction);
                let mut best = (Real::NEG_INFINITY, Vec3::zeros());
                for p in &hull.corners {
                    let far = d.dot(p);
                    if far > best.0 {
                        best = (far, *p);
                    }
                }
                to_parry(best.1)
            }
        }
    }
}

impl Solid {
    fn contains(&self, p: Vec3) -> bool {
        match self {
            Solid::Cylinder { radius, low, high } => {
                p.z >= *low && p.z <= *high && p.x * p.x + p.y * p.y <= radius * radius
            }
            Solid::Hull(hull) => hull.faces.iter().all(|(n, h)| n.dot(&p) <= *h),
        }
    }

    /// The point nearest to `p`: itself, where it is inside.
    fn nearest(&self, p: Vec3) -> Vec3 {
        match self {
            Solid::Cylinder { radius, low, high } => {
                let across = (p.x * p.x + p.y * p.y).sqrt();
                let part = if across > *radius { radius / across } else { 1.0 };
                Vec3::new(p.x * part, p.y * part, p.z.clamp(*low, *high))
            }
            Solid::Hull(_) if self.contains(p) => p,
            Solid::Hull(hull) => match closest(self, &ConstantPoint(to_parry(p)), p) {
                Closest::Apart(on_core, _) => on_core,
                // So near that rounding decides: the face that it is above the most.
                _ => {
                    let above = |(n, h): &(Vec3, Real)| (n.dot(&p) - h, *n);
                    let highest = hull.faces.iter().map(above).reduce(|a, b| if b.0 > a.0 { b } else { a });
                    highest.map_or(p, |(height, n)| p - n * height.max(0.0))
                }
            },
        }
    }

    /// How far it is from `p`, inside or in front of the way in, along the unit vector `d` until it leaves the core.
    fn exit(&self, p: Vec3, d: Vec3) -> Real {
        let mut way = Real::INFINITY;
        let mut leaves = |speed: Real, room: Real| {
            if speed > 1e-12 {
                way = way.min(room / speed);
            }
        };
        match self {
            Solid::Cylinder { radius, low, high } => {
                leaves(d.z, high - p.z);
                leaves(-d.z, p.z - low);
                let (a, b) = (d.x * d.x + d.y * d.y, p.x * d.x + p.y * d.y);
                let c = p.x * p.x + p.y * p.y - radius * radius;
                leaves(a, (b * b - a * c).max(0.0).sqrt() - b);
            }
            Solid::Hull(hull) => hull.faces.iter().for_each(|(n, h)| leaves(n.dot(&d), h - n.dot(&p))),
        }
        if way.is_finite() { way.max(0.0) } else { 0.0 }
    }

    /// The place of the triangle where it is nearest to the core, or deepest in it against `inward`: a smooth function of
    /// where they are, but for edges and corners.
    fn nearest_in_triangle(&self, corners: &[Vec3; 3], inward: Vec3, blend: Real) -> Vec3 {
        let triangle = Triangle::new(to_parry(corners[0]), to_parry(corners[1]), to_parry(corners[2]));
        let on_triangle = |p: Vec3| from_parry(triangle.project_local_point(to_parry(p), true).point);
        let middle = (corners[0] + corners[1] + corners[2]) / 3.0;
        match closest(self, &triangle, middle) {
            Closest::Apart(on_core, place) => {
                // Where a face of the core lies flat on the triangle, many places are about as near, and the nearest would
                // jump about; the one next to the middle stays.
                let steady = on_triangle(self.nearest(middle));
                let farther = (steady - self.nearest(steady)).norm() - (place - on_core).norm();
                steady + (place - steady) * (farther / blend).clamp(0.0, 1.0)
            }
            Closest::Through => {
                let deepest = on_triangle(from_parry(self.local_support_point(to_parry(inward))));
                if self.contains(deepest) { deepest } else { self.meet(middle, on_triangle) }
            }
            Closest::Unknown => self.meet(middle, on_triangle),
        }
    }

    /// From `p` to and fro between the core and a triangle: ends where they are nearest, or in both.
    fn meet(&self, mut p: Vec3, on_triangle: impl Fn(Vec3) -> Vec3) -> Vec3 {
        for _ in 0..MEETINGS {
            p = on_triangle(self.nearest(p));
        }
        p
    }
}

/// Difference of distances, over the rounding, up to which a triangle's point goes from next to its middle to where it is
/// nearest: half as much makes a flat end on a flat face rattle, more hides the nearest place.
const BLEND: Real = 0.3;

/// Steps between core and triangle where they intersect.
const MEETINGS: usize = 8;

enum Closest {
    /// The points on the core and on the other.
    Apart(Vec3, Vec3),
    /// They intersect.
    Through,
    /// Not found within the steps that there are.
    Unknown,
}

/// Nearest points of a core and something `about` there [GJK].
fn closest(solid: &Solid, other: &impl SupportMap, about: Vec3) -> Closest {
    let (low, high) = match solid {
        Solid::Hull(hull) => hull.bounds,
        Solid::Cylinder { low, high, .. } => (Vec3::z() * *low, Vec3::z() * *high),
    };
    let direction = to_parry(about - (low + high) * 0.5);
    let same = parry3d_f64::math::Pose::IDENTITY;
    let mut simplex = VoronoiSimplex::new();
    match closest_of_support_maps(&same, solid, other, Real::MAX, &mut simplex, Some(direction)) {
        GJKResult::ClosestPoints(a, b, _) => Closest::Apart(from_parry(a), from_parry(b)),
        GJKResult::Intersection => Closest::Through,
        GJKResult::NoIntersection(_) | GJKResult::Proximity(_) => Closest::Unknown,
    }
}

/// A part's core in the world.
#[derive(Clone, Copy, Debug)]
pub struct Frame {
    from: Vec3,
    /// What the coordinates count: the axis of a ball or capsule is the third, of any length.
    axes: [Vec3; 3],
}

impl Frame {
    /// Of `part` of a tool at `pose`.
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
    fn own(&self, p: Vec3) -> Vec3 {
        self.own_direction(p - self.from)
    }

    fn own_direction(&self, d: Vec3) -> Vec3 {
        Vec3::new(self.axes[0].dot(&d), self.axes[1].dot(&d), self.axes[2].dot(&d))
    }

    /// How far any point of the core of `part` moves from here to `other` at most, on a straight way [m].
    pub fn farthest_move(&self, other: &Frame, part: &Part) -> Real {
        part.core.box_corners().map(|c| (other.at(c) - self.at(c)).norm()).fold(0.0, Real::max)
    }
}

/// The parts of a tool at `pose`, and how many they are: what is behind them repeats the first.
pub fn posed<'a>(pose: &Pose, shape: &'a Shape) -> ([Posed<'a>; MOST_PARTS], usize) {
    let mut all = [Posed::new(pose, &shape.parts[0]); MOST_PARTS];
    for (posed, part) in all.iter_mut().zip(&shape.parts).skip(1) {
        *posed = Posed::new(pose, part);
    }
    (all, shape.parts.len())
}

/// A part of a tool where it is.
#[derive(Clone, Copy, Debug)]
pub struct Posed<'a> {
    /// The part.
    pub part: &'a Part,
    /// Its core in the world.
    pub frame: Frame,
}

impl<'a> Posed<'a> {
    /// `part` of a tool at `pose`.
    pub fn new(pose: &Pose, part: &'a Part) -> Self {
        Self { part, frame: Frame::new(pose, part) }
    }

    /// Coordinates of the core's point nearest to the world's place `p`; where `p` is inside, those of `p`.
    pub fn nearest(&self, p: Vec3) -> Vec3 {
        match &self.part.core {
            Core::Axis(_) => Vec3::new(0.0, 0.0, self.along(p)),
            Core::Solid(solid) => solid.nearest(self.frame.own(p)),
        }
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

    /// Box around the core, grown by `reach`.
    pub fn window(&self, reach: Real) -> (Vec3, Vec3) {
        let (low, high) = self.part.core.bounds();
        let (middle, half) = ((low + high) * 0.5, (high - low) * 0.5);
        let size: Vec3 = (0..3).map(|c| self.frame.axes[c].abs() * half[c]).sum();
        let place = self.frame.at(middle);
        (place - size.add_scalar(reach), place + size.add_scalar(reach))
    }

    /// The place of a triangle that is nearest to the core, or deepest in it along `push`, along which the core would push
    /// it out; for an axis also the coordinates of its nearest point.
    pub fn nearest_in_triangle(&self, corners: &[Vec3; 3], push: Vec3) -> (Vec3, Option<Vec3>) {
        match &self.part.core {
            Core::Axis(_) => self.nearest_to_axis(corners),
            Core::Solid(solid) => {
                let own = corners.map(|p| self.frame.own(p));
                let blend = BLEND * self.part.radius;
                (self.frame.at(solid.nearest_in_triangle(&own, self.frame.own_direction(push), blend)), None)
            }
        }
    }

    /// Where an axis is deepest below a triangle that faces `outward`, straight below it: the place on the triangle, the
    /// coordinates on the axis and the depth [m]. `None` where no part of the axis is below it, and for solid cores.
    pub fn below_triangle(&self, corners: &[Vec3; 3], outward: Vec3) -> Option<(Vec3, Vec3, Real)> {
        let size = outward.norm();
        if self.part.core.is_solid() || size == 0.0 {
            return None;
        }
        let (from, axis, up) = (self.frame.from, self.frame.axes[2], outward / size);
        // The part of the axis between the planes that stand on the triangle's edges.
        let mut part = (0.0 as Real, 1.0 as Real);
        for i in 0..3 {
            let across = up.cross(&(corners[(i + 1) % 3] - corners[i]));
            let (at, rise) = (across.dot(&(from - corners[i])), across.dot(&axis));
            if rise > 0.0 {
                part.0 = part.0.max(-at / rise);
            } else if rise < 0.0 {
                part.1 = part.1.min(-at / rise);
            } else if at < 0.0 {
                return None;
            }
        }
        if part.0 > part.1 {
            return None;
        }
        let along = if up.dot(&axis) > 0.0 { part.0 } else { part.1 };
        let core = Vec3::new(0.0, 0.0, if axis == Vec3::zeros() { 0.0 } else { along });
        let p = self.frame.at(core);
        let depth = up.dot(&(corners[0] - p));
        (depth > 0.0).then_some((p + up * depth, core, depth))
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
