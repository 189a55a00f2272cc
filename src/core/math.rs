//! Numbers and their shapes: one scalar, one vector type, one pose; the only place where nalgebra meets parry's glam.
//!
//! The core uses `+ − × ÷ √` alone, each rounded once (IEEE 754): no fused multiply-add, no transcendental function.
//! That is what makes a recording replay bit for bit on every x86-64 machine, whichever SIMD path runs.

use serde::{Deserialize, Serialize};

/// The one scalar of the core.
pub type Real = f64;
/// A vector or point, (3).
pub type Vec3 = nalgebra::Vector3<Real>;
/// A matrix, (3, 3).
pub type Mat3 = nalgebra::Matrix3<Real>;
/// parry's vector (glam).
pub type ParryVec = parry3d_f64::math::Vector;

/// To parry's vector.
pub fn to_parry(v: Vec3) -> ParryVec {
    ParryVec::new(v.x, v.y, v.z)
}
/// From parry's vector.
pub fn from_parry(v: ParryVec) -> Vec3 {
    Vec3::new(v.x, v.y, v.z)
}

/// A box along the axes: least and greatest coordinates [m].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Bounds {
    /// Least coordinates [m].
    pub low: Vec3,
    /// Greatest coordinates [m].
    pub high: Vec3,
}

impl Bounds {
    /// Around nothing.
    pub const NOTHING: Self = Self {
        low: Vec3::new(Real::INFINITY, Real::INFINITY, Real::INFINITY),
        high: Vec3::new(-Real::INFINITY, -Real::INFINITY, -Real::INFINITY),
    };

    /// From `low` to `high` [m].
    pub const fn new(low: Vec3, high: Vec3) -> Self {
        Self { low, high }
    }

    /// Around `points`.
    pub fn of(points: impl IntoIterator<Item = Vec3>) -> Self {
        points.into_iter().fold(Self::NOTHING, |all, p| Self { low: all.low.inf(&p), high: all.high.sup(&p) })
    }

    /// Around both.
    pub fn joined(&self, other: &Self) -> Self {
        Self { low: self.low.inf(&other.low), high: self.high.sup(&other.high) }
    }

    /// With `by` [m] more on each side.
    pub fn grown(&self, by: Real) -> Self {
        Self { low: self.low.add_scalar(-by), high: self.high.add_scalar(by) }
    }

    /// From the least to the greatest coordinates [m].
    pub fn size(&self) -> Vec3 {
        self.high - self.low
    }

    /// The place in the middle [m].
    pub fn middle(&self) -> Vec3 {
        (self.low + self.high) * 0.5
    }

    /// True when `p` is inside, or on a face.
    pub fn contains(&self, p: &Vec3) -> bool {
        let (low, high) = (&self.low, &self.high);
        (p.x >= low.x) & (p.x <= high.x) & (p.y >= low.y) & (p.y <= high.y) & (p.z >= low.z) & (p.z <= high.z)
    }

    /// True when all of `points` lie beyond one and the same face.
    pub fn is_apart(&self, points: &[Vec3]) -> bool {
        (0..3).any(|c| points.iter().all(|p| p[c] < self.low[c]) || points.iter().all(|p| p[c] > self.high[c]))
    }

    /// `(Δx, Δy, Δz)` squared and summed [m²]: how far `p` is outside; zero inside.
    pub fn distance_squared(&self, p: &Vec3) -> Real {
        let apart = |c: usize| (self.low[c] - p[c]).max(p[c] - self.high[c]).max(0.0);
        let (x, y, z) = (apart(0), apart(1), apart(2));
        x * x + y * y + z * z
    }
}

/// Position [m] and orientation of a rigid thing in the world frame.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Pose {
    /// Of the reference point [m].
    pub position: Vec3,
    /// Unit quaternion, components x, y, z, w.
    pub orientation: [Real; 4],
}

impl Default for Pose {
    fn default() -> Self {
        Self { position: Vec3::zeros(), orientation: [0.0, 0.0, 0.0, 1.0] }
    }
}

impl Pose {
    /// `v` turned from the pose's own frame into the world.
    pub fn rotate(&self, v: Vec3) -> Vec3 {
        let q = Vec3::new(self.orientation[0], self.orientation[1], self.orientation[2]);
        let w = self.orientation[3];
        let t = 2.0 * q.cross(&v);
        v + w * t + q.cross(&t)
    }

    /// `v` turned from the world into the pose's own frame.
    pub fn unrotate(&self, v: Vec3) -> Vec3 {
        let [x, y, z, w] = self.orientation;
        Pose { position: self.position, orientation: [-x, -y, -z, w] }.rotate(v)
    }

    /// The world's place of the point `p` of the pose's own frame.
    pub fn to_world(&self, p: Vec3) -> Vec3 {
        self.position + self.rotate(p)
    }

    /// The point of the pose's own frame that is at `p` in the world.
    pub fn to_own(&self, p: Vec3) -> Vec3 {
        self.unrotate(p - self.position)
    }

    /// The pose turned in place about the world's axes by the vector `angle` [rad], 1 % short of it at 0.35 rad and at a
    /// half turn for what is infinite: twice the half angle's tangent, which needs no transcendental function.
    pub fn turned(&self, angle: Vec3) -> Pose {
        let (v, [x, y, z, w]) = (angle / 2.0, self.orientation);
        let q = Vec3::new(x, y, z);
        let turned = v * w + q + v.cross(&q);
        let blend = [turned.x, turned.y, turned.z, w - v.dot(&q)];
        Pose { orientation: normalized_quaternion(blend).unwrap_or(self.orientation), ..*self }
    }

    /// The pose turned in place the shortest way so that its own +z points at the world's place `at` [m]; as it is where that is no direction.
    pub fn pointed(&self, at: Vec3) -> Pose {
        let Some(to) = (at - self.position).try_normalize(1e-9) else { return *self };
        let (from, [x, y, z, w]) = (self.rotate(Vec3::z()), self.orientation);
        let axis = from.cross(&to);
        // The other way round any axis across does.
        let half = normalized_quaternion([axis.x, axis.y, axis.z, 1.0 + from.dot(&to)]);
        let [a, b, c, d] = half.unwrap_or_else(|| {
            let x = self.rotate(Vec3::x());
            [x.x, x.y, x.z, 0.0]
        });
        let (v, q) = (Vec3::new(a, b, c), Vec3::new(x, y, z));
        let turned = v * w + q * d + v.cross(&q);
        let product = [turned.x, turned.y, turned.z, w * d - v.dot(&q)];
        Pose { orientation: normalized_quaternion(product).unwrap_or(self.orientation), ..*self }
    }

    /// The pose turned by `angle` [rad] about the axis along the unit vector `axis` through `point` [m], both in its own frame.
    pub fn turned_about(&self, point: Vec3, axis: Vec3, angle: Real) -> Pose {
        let (v, c, [x, y, z, w]) = (axis * libm::sin(0.5 * angle), libm::cos(0.5 * angle), self.orientation);
        let q = Vec3::new(x, y, z);
        let turned = v * w + q * c + q.cross(&v);
        let product = [turned.x, turned.y, turned.z, w * c - q.dot(&v)];
        let turned = Pose { orientation: normalized_quaternion(product).unwrap_or(self.orientation), ..*self };
        Pose { position: self.to_world(point) - turned.rotate(point), ..turned }
    }

    /// The pose a `fraction` (0..=1) of the way to `target`: straight line and normalised quaternion blend, which for
    /// the small angles between two samples is within 1e-4 rad of the great arc and needs no transcendental function.
    pub fn towards(&self, target: &Pose, fraction: Real) -> Pose {
        let position = self.position + (target.position - self.position) * fraction;
        let (a, b) = (self.orientation, target.orientation);
        let dot = a[0] * b[0] + a[1] * b[1] + a[2] * b[2] + a[3] * b[3];
        let sign = if dot < 0.0 { -1.0 } else { 1.0 };
        let blend = std::array::from_fn(|i| a[i] + (sign * b[i] - a[i]) * fraction);
        Pose { position, orientation: normalized_quaternion(blend).unwrap_or(b) }
    }
}

/// `q` scaled to length one, or `None` when its length is below 1e-6 or not finite.
pub fn normalized_quaternion(q: [Real; 4]) -> Option<[Real; 4]> {
    let length = (q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3]).sqrt();
    (length.is_finite() && length > 1e-6).then(|| q.map(|c| c / length))
}

/// Components xx, yy, zz, yz, xz, xy of a symmetric matrix.
pub fn components(m: &Mat3) -> [Real; 6] {
    [m[(0, 0)], m[(1, 1)], m[(2, 2)], m[(1, 2)], m[(0, 2)], m[(0, 1)]]
}

/// The symmetric matrix of these [`components`].
pub fn symmetric([xx, yy, zz, yz, xz, xy]: [Real; 6]) -> Mat3 {
    Mat3::new(xx, xy, xz, xy, yy, yz, xz, yz, zz)
}

/// True when all three components are finite.
pub fn is_finite(v: &Vec3) -> bool {
    v.x.is_finite() && v.y.is_finite() && v.z.is_finite()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_quarter_turn_about_z_takes_x_to_y() {
        let half = std::f64::consts::FRAC_1_SQRT_2;
        let pose = Pose { position: Vec3::zeros(), orientation: [0.0, 0.0, half, half] };
        assert!((pose.rotate(Vec3::x()) - Vec3::y()).norm() < 1e-15);
    }

    #[test]
    fn a_turn_is_about_the_axes_of_the_world() {
        let half = std::f64::consts::FRAC_1_SQRT_2;
        let pose = Pose { position: Vec3::x(), orientation: [0.0, 0.0, half, half] };
        let turned = pose.turned(Vec3::new(0.1, 0.0, 0.0));
        // The pose's own x lies along the world's y, and goes from there towards z.
        let (angle, way) = (2.0 * 0.05_f64.atan(), turned.rotate(Vec3::x()));
        assert!((way - Vec3::new(0.0, angle.cos(), angle.sin())).norm() < 1e-15, "{way}");
        assert_eq!(turned.position, Vec3::x());
    }

    #[test]
    fn a_pose_that_is_pointed_turns_the_shortest_way_and_no_farther() {
        let tilted = Pose { position: Vec3::new(0.1, 0.0, 0.0), ..Pose::default() }.turned(Vec3::new(0.3, -0.2, 0.9));
        for pose in [Pose::default(), tilted] {
            for at in [Vec3::new(0.2, -0.3, 0.4), Vec3::new(0.1, 0.0, 5.0), Vec3::new(0.0, 0.0, -1.0)] {
                let pointed = pose.pointed(at);
                let way = (at - pose.position).normalize();
                assert!((pointed.rotate(Vec3::z()) - way).norm() < 1e-14, "{pointed:?}");
                // What is across both directions stays.
                let across = pose.rotate(Vec3::z()).cross(&way).try_normalize(1e-9).unwrap_or(pose.rotate(Vec3::x()));
                let own = pose.unrotate(across);
                assert!((pointed.rotate(own) - across).norm() < 1e-14, "{pointed:?}");
                assert_eq!(pointed.position, pose.position);
            }
            assert_eq!(pose.pointed(pose.position), pose);
        }
    }

    #[test]
    fn halfway_between_opposite_signs_of_one_orientation_is_that_orientation() {
        let a = Pose::default();
        let b = Pose { position: Vec3::x(), orientation: [0.0, 0.0, 0.0, -1.0] };
        let half = a.towards(&b, 0.5);
        assert_eq!(half.orientation, [0.0, 0.0, 0.0, 1.0]);
        assert_eq!(half.position.x, 0.5);
    }
}
