//! Cores of tools that a surface point can get inside of: cylinders and convex hulls.

use crate::math::{Bounds, Mat3, ParryVec, Real, Vec3, from_parry, is_finite, to_parry};
use parry3d_f64::query::PointQuery;
use parry3d_f64::query::details::closest_points_support_map_support_map_with_params as closest_of_support_maps;
use parry3d_f64::query::gjk::{ConstantPoint, GJKResult, VoronoiSimplex};
use parry3d_f64::shape::{SupportMap, Triangle};
use parry3d_f64::transformation::try_convex_hull;

/// Most corners of a convex core: what bounds the cost of a tick.
pub const MOST_CORNERS: usize = 64;

/// A core that a surface point can get inside of. All points are coordinates [m].
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Solid {
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
pub(super) struct Hull {
    pub(super) corners: Vec<Vec3>,
    /// Outward unit normals and heights of the faces.
    faces: Vec<(Vec3, Real)>,
    pub(super) bounds: Bounds,
    /// Unit vectors along its two longest sides: of its corners, the principal axes.
    pub(super) long_sides: [Vec3; 2],
}

/// Width of a hull, over its size, below which it counts as flat.
const FLAT: Real = 1e-4;

impl Hull {
    /// Of many points only those are kept that stand out the most.
    pub(super) fn new(points: &[Vec3]) -> Option<Self> {
        let size = Bounds::of(points.iter().copied()).size().norm();
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
        let bounds = Bounds::of(corners.iter().copied());
        let scatter: Mat3 = corners.iter().map(|p| (p - middle) * (p - middle).transpose()).sum();
        // Where two sides are as long, rounding must not turn them.
        let least = 1e-9 * scatter.trace();
        let axes = scatter.map(|x| if x.abs() > least { x } else { 0.0 }).symmetric_eigen();
        let mut order = [0, 1, 2];
        order.sort_by(|a, b| axes.eigenvalues[*b].total_cmp(&axes.eigenvalues[*a]));
        let long_sides = [order[0], order[1]].map(|i| axes.eigenvectors.column(i).into_owned());
        let hull = Self { corners, faces, bounds, long_sides };
        (hull.faces.len() >= 4 && hull.least_width() > FLAT * size).then_some(hull)
    }

    /// Height of `p` above the highest face: negative inside.
    fn height(&self, p: &Vec3) -> Real {
        self.faces.iter().map(|(n, h)| n.dot(p) - h).fold(Real::NEG_INFINITY, Real::max)
    }

    /// Least distance between a face and the corner opposite.
    pub(super) fn least_width(&self) -> Real {
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
    pub(super) fn nearest(&self, p: Vec3) -> Vec3 {
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
    pub(super) fn exit(&self, p: Vec3, d: Vec3) -> Real {
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

    /// How deep `p` is inside at the least [m]; zero outside.
    pub(super) fn depth(&self, p: Vec3) -> Real {
        let room = match self {
            Solid::Cylinder { radius, low, high } => {
                (radius - (p.x * p.x + p.y * p.y).sqrt()).min(p.z - low).min(high - p.z)
            }
            Solid::Hull(hull) => -hull.height(&p),
        };
        room.max(0.0)
    }

    /// The place of it that is foremost along `direction`.
    pub(super) fn foremost(&self, direction: Vec3) -> Vec3 {
        from_parry(self.local_support_point(to_parry(direction)))
    }

    /// What is foremost along the unit vector `ahead`, of all that is within `radius` [m] of the core, on the line along that through `p`: the
    /// place of the core that it is next to, and the unit vector from there. Nothing where the cosine between the two is less than `least`.
    pub(super) fn front(&self, p: Vec3, ahead: Vec3, radius: Real, least: Real) -> Option<(Vec3, Vec3)> {
        let mut at = match self {
            // The line ends on the first of the planes of the faces, there or, near an edge, before it.
            Solid::Hull(hull) => {
                let facing = hull.faces.iter().filter(|(n, _)| n.dot(&ahead) > 1e-9);
                let ends = facing.map(|(n, h)| ((h + radius - n.dot(&p)) / n.dot(&ahead), *n));
                let (way, normal) = ends.reduce(|a, b| if b.0 < a.0 { b } else { a })?;
                let core = p + ahead * way - normal * radius;
                if hull.height(&core) <= CLOSE * radius {
                    return (normal.dot(&ahead) >= least).then_some((core, normal));
                }
                p + ahead * way
            }
            Solid::Cylinder { .. } => {
                let foremost = self.foremost(ahead);
                p + ahead * (ahead.dot(&(foremost - p)) + radius)
            }
        };
        // Back along the line the distance from what is convex falls, and ever more slowly: Newton's steps go never too far.
        for _ in 0..STEPS {
            let core = self.nearest(at);
            let away = at - core;
            let distance = away.norm();
            let normal = away / distance;
            let facing = normal.dot(&ahead);
            #[expect(clippy::neg_cmp_op_on_partial_ord, reason = "NaN, too, must leave here")]
            if !(facing >= least) {
                return None;
            }
            if distance - radius <= CLOSE * radius {
                return Some((core, normal));
            }
            at -= ahead * ((distance - radius) / facing);
        }
        None
    }

    /// The place of the triangle where it is nearest to the core, or deepest in it against `inward`.
    pub(super) fn nearest_in_triangle(&self, corners: &[Vec3; 3], inward: Vec3) -> Vec3 {
        let triangle = Triangle::new(to_parry(corners[0]), to_parry(corners[1]), to_parry(corners[2]));
        let on_triangle = |p: Vec3| from_parry(triangle.project_local_point(to_parry(p), true).point);
        let middle = (corners[0] + corners[1] + corners[2]) / 3.0;
        match closest(self, &triangle, middle) {
            Closest::Apart(_, place) => place,
            Closest::Through => {
                let deepest = on_triangle(self.foremost(inward));
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

/// Steps along a line: they double the digits.
const STEPS: usize = 12;
/// Over the radius, how far from the surface they may end: with less, rounding would keep them going; with more it would be felt.
const CLOSE: Real = 1e-6;
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
    let middle = match solid {
        Solid::Hull(hull) => hull.bounds.middle(),
        Solid::Cylinder { low, high, .. } => (Vec3::z() * *low + Vec3::z() * *high) * 0.5,
    };
    let direction = to_parry(about - middle);
    let same = parry3d_f64::math::Pose::IDENTITY;
    let mut simplex = VoronoiSimplex::new();
    match closest_of_support_maps(&same, solid, other, Real::MAX, &mut simplex, Some(direction)) {
        GJKResult::ClosestPoints(a, b, _) => Closest::Apart(from_parry(a), from_parry(b)),
        GJKResult::Intersection => Closest::Through,
        GJKResult::NoIntersection(_) | GJKResult::Proximity(_) => Closest::Unknown,
    }
}
