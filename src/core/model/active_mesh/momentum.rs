//! Linear and angular momentum: what a change of resolution has to leave as it was, by organ.

use super::{ActiveMesh, padded, vec3};
use crate::math::{Mat3, Real, Vec3};
use crate::model::organ::MOST_ORGANS;

/// Momenta about the origin.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Momenta {
    /// Σ m v [kg·m/s].
    pub linear: Vec3,
    /// Σ m x × v [kg·m²/s].
    pub angular: Vec3,
}

/// Those of an organ's nodes that can move: Σ m [kg], Σ m x [kg·m] and Σ m x xᵀ [kg·m²].
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Moments {
    mass: Real,
    first: Vec3,
    second: Mat3,
}

/// A rigid motion: `velocity + turn × (x − centre)`.
struct RigidMotion {
    centre: Vec3,
    velocity: Vec3,
    turn: Vec3,
}

impl RigidMotion {
    fn at(&self, x: Vec3) -> Vec3 {
        self.velocity + self.turn.cross(&(x - self.centre))
    }
}

impl Moments {
    /// The rigid motion that has these momenta.
    fn motion_with(&self, momenta: &Momenta) -> RigidMotion {
        let centre = self.first / self.mass;
        let about = self.second - centre * self.first.transpose();
        let inertia = Mat3::identity() * about.trace() - about;
        let angular = momenta.angular - centre.cross(&momenta.linear);
        // Free nodes in a line cannot be given every angular momentum.
        let mean = inertia.trace() / 3.0;
        let turns = inertia.determinant() > LEAST_INERTIA * mean * mean * mean;
        let turn = if turns { inertia.try_inverse().map_or(Vec3::zeros(), |i| i * angular) } else { Vec3::zeros() };
        RigidMotion { centre, velocity: momenta.linear / self.mass, turn }
    }
}

/// By organ.
pub(super) type ByOrgan<T> = [T; MOST_ORGANS];

impl ActiveMesh {
    /// Momenta of the active nodes.
    pub fn momenta(&self) -> Momenta {
        let of_organs = self.momenta_by_organ();
        let sum = |of: fn(&Momenta) -> Vec3| of_organs.iter().map(of).sum();
        Momenta { linear: sum(|m| m.linear), angular: sum(|m| m.angular) }
    }

    pub(super) fn momenta_by_organ(&self) -> ByOrgan<Momenta> {
        self.sum_by_organ(|s| vec3(&self.motion.velocity[s]) * self.motion.mass[s])
    }

    /// Σ p and Σ x × p over the active nodes, of some `p` of the node in a slot.
    fn sum_by_organ(&self, of: impl Fn(usize) -> Vec3) -> ByOrgan<Momenta> {
        let mut sums: ByOrgan<Momenta> = Default::default();
        for &slot in &self.active {
            let s = slot.index();
            let (x, p) = (vec3(&self.motion.position[s]), of(s));
            let sum = &mut sums[self.organ[s].index()];
            sum.linear += p;
            sum.angular += x.cross(&p);
        }
        sums
    }

    fn moments_by_organ(&self) -> ByOrgan<Moments> {
        let mut sums: ByOrgan<Moments> = Default::default();
        for &slot in &self.active {
            let s = slot.index();
            if self.motion.inverse_mass[s] > 0.0 {
                let sum = &mut sums[self.organ[s].index()];
                let (x, m) = (vec3(&self.motion.position[s]), self.motion.mass[s]);
                sum.mass += m;
                sum.first += x * m;
                sum.second += x * x.transpose() * m;
            }
        }
        sums
    }

    /// One rigid motion of all nodes that can move of each organ that has changed, so that its momenta are what they were
    /// `before`. Of all, because those near the change may be so few, or so nearly in a line, that turning them takes any speed.
    pub(super) fn correct_momenta(&mut self, changed: ByOrgan<bool>, before: &ByOrgan<Momenta>) {
        let (now, moments) = (self.momenta_by_organ(), self.moments_by_organ());
        let corrections: ByOrgan<Option<RigidMotion>> = std::array::from_fn(|organ| {
            let (before, now) = (&before[organ], &now[organ]);
            let lost = Momenta { linear: before.linear - now.linear, angular: before.angular - now.angular };
            (changed[organ] && moments[organ].mass > 0.0).then(|| moments[organ].motion_with(&lost))
        });
        for &slot in &self.active {
            let s = slot.index();
            if let Some(correction) = &corrections[self.organ[s].index()]
                && self.motion.inverse_mass[s] > 0.0
            {
                let v = vec3(&self.motion.velocity[s]) + correction.at(vec3(&self.motion.position[s]));
                self.motion.velocity[s] = padded(v);
            }
        }
    }

    /// Whether an organ that can move as a whole is among the bodies.
    pub fn has_free_organs(&self) -> bool {
        self.free_organs.contains(&true)
    }

    /// Takes from the residuals of organs that can move as a whole, which act now with steps of `class`, what would move
    /// them so: a change of resolution is no push, wherever a tool has gone since and however the body has turned.
    pub fn balance_residuals(&mut self, class: usize) {
        let moments = self.moments_by_organ();
        let sums = self.sum_by_organ(|s| vec3(&self.motion.residual[s][class]));
        let pushes: ByOrgan<Option<RigidMotion>> = std::array::from_fn(|organ| {
            (self.free_organs[organ] && moments[organ].mass > 0.0).then(|| moments[organ].motion_with(&sums[organ]))
        });
        for &slot in &self.active {
            let s = slot.index();
            if let Some(push) = &pushes[self.organ[s].index()] {
                let residual = &mut self.motion.residual[s][class];
                *residual = padded(vec3(residual) - push.at(vec3(&self.motion.position[s])) * self.motion.mass[s]);
            }
        }
    }
}

/// Determinant of an inertia over the cube of its mean moment below which it is as good as singular.
const LEAST_INERTIA: Real = 1e-3;
