//! The hand on the device: a mass that turns, pulled to a target by the hand, pushed and turned by the device.

#![allow(non_snake_case)] // F is a force, as printed

use nalgebra::UnitQuaternion;

use crate::{Device, Target, Vec3};

/// Time step of the motion [s]. Ten per tick keep the friction below, the stiffest term, far from its stability limit.
const SUBSTEP: f64 = 1e-4;
/// Speed [m/s] at which Coulomb friction has reached 71 % of its value. Smaller is closer to a true stick, and stiffer:
/// friction / (mass · SLIP_SPEED) · SUBSTEP must stay well below 1 (0.27 for the Omni held by the default hand).
const SLIP_SPEED: f64 = 1e-3;
/// Time constant of the velocity estimate [s], as drivers filter the differences of quantised positions.
const VELOCITY_FILTER: f64 = 5e-3;

/// A hand holding the tip of a device.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Hand {
    /// Pull towards the target [N/m].
    pub stiffness: f64,
    /// Pull towards the target's velocity [N·s/m].
    pub damping: f64,
    /// Apparent mass [kg], moving with the device's own.
    pub mass: f64,
    /// Turn towards the target's orientation [N·m/rad].
    pub angular_stiffness: f64,
    /// Turn towards the target's angular velocity [N·m·s/rad].
    pub angular_damping: f64,
    /// Moment of inertia of the fingers with what they hold [kg·m²], the same about every axis.
    pub inertia: f64,
}

impl Default for Hand {
    /// A moderate grip. Of how it turns there is no source here: as stiff as to give 11° under a device's 0.1 N·m, critically damped at 16 Hz.
    fn default() -> Self {
        let (stiffness, damping, mass) = (150.0, 3.0, 0.05);
        Self { stiffness, damping, mass, angular_stiffness: 0.5, angular_damping: 0.01, inertia: 5e-5 }
    }
}

/// A device in a hand, moving.
#[derive(Clone, Debug, PartialEq)]
pub struct HeldDevice {
    device: Device,
    hand: Hand,
    position: Vec3,
    velocity: Vec3,
    reported_velocity: Vec3,
    orientation: UnitQuaternion<f64>,
    angular_velocity: Vec3,
}

/// What a device is told to give, or gives, at the tip that the hand holds.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Given {
    /// [N]
    pub force: Vec3,
    /// [N·m]
    pub torque: Vec3,
}

impl HeldDevice {
    /// At rest, upright at `position` [m].
    pub fn new(device: Device, hand: Hand, position: Vec3) -> Self {
        Self {
            device,
            hand,
            position,
            velocity: Vec3::zeros(),
            reported_velocity: Vec3::zeros(),
            orientation: UnitQuaternion::identity(),
            angular_velocity: Vec3::zeros(),
        }
    }

    /// Moves on by `dt` [s] towards `target`, with what is `commanded` throughout; returns what the motors give, which is
    /// that cut to the device's greatest.
    ///
    /// m x'' = k (x_target − x) + b (v_target − v) + F_device − f v / sqrt(v² + v_slip²), and so for turns but for
    /// friction: I ω' = k_r θ + b_r (ω_target − ω) + τ_device, θ the turn that is left to the target. Semi-implicit
    /// Euler. The target moves on with its own velocities meanwhile.
    pub fn step(&mut self, dt: f64, target: &Target, commanded: Given) -> Given {
        let Hand { stiffness: k, damping: b, .. } = self.hand;
        let m = self.hand.mass + self.device.mass;
        let F_device = commanded.force.cap_magnitude(self.device.max_force);
        let torque = commanded.torque.cap_magnitude(self.device.max_torque);
        let reported_before = self.reported_position();
        let substeps = (dt / SUBSTEP).ceil().max(1.0);
        let h = dt / substeps;
        for substep in 1..=substeps as u32 {
            let x_target = target.position + target.velocity * (h * f64::from(substep));
            let (x, v) = (self.position, self.velocity);
            let friction = v * (self.device.friction / (v.norm_squared() + SLIP_SPEED * SLIP_SPEED).sqrt());
            let F = k * (x_target - x) + b * (target.velocity - v) + F_device - friction;
            self.velocity += F * (h / m);
            self.position += self.velocity * h;
            self.turn(h, target, h * f64::from(substep), torque);
        }
        let difference = (self.reported_position() - reported_before) / dt;
        self.reported_velocity += (difference - self.reported_velocity) * (dt / (VELOCITY_FILTER + dt));
        Given { force: F_device, torque }
    }

    /// Turns on by `h` [s] towards where `target` has turned to after `time` [s], with `torque` [N·m] from the device.
    fn turn(&mut self, h: f64, target: &Target, time: f64, torque: Vec3) {
        let Hand { angular_stiffness: k, angular_damping: b, inertia, .. } = self.hand;
        let wanted = UnitQuaternion::new(target.angular_velocity * time) * target.orientation;
        let left = (wanted * self.orientation.inverse()).scaled_axis();
        let all = k * left + b * (target.angular_velocity - self.angular_velocity) + torque;
        self.angular_velocity += all * (h / inertia);
        self.orientation = UnitQuaternion::new(self.angular_velocity * h) * self.orientation;
    }

    /// How it is turned; its encoders see that without a step.
    pub fn orientation(&self) -> UnitQuaternion<f64> {
        self.orientation
    }

    /// Where the tip truly is [m].
    pub fn position(&self) -> Vec3 {
        self.position
    }

    /// Where the encoders see it [m]: each coordinate the nearest multiple of the resolution.
    pub fn reported_position(&self) -> Vec3 {
        let resolution = self.device.resolution;
        self.position.map(|x| (x / resolution).round() * resolution)
    }

    /// The driver's estimate of the velocity [m/s]: filtered differences of the encoders' positions.
    pub fn reported_velocity(&self) -> Vec3 {
        self.reported_velocity
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const DT: f64 = 1e-3;

    fn omni() -> Device {
        Device::default()
    }

    fn frictionless() -> Device {
        Device { friction: 0.0, ..omni() }
    }

    fn still(position: Vec3) -> Target {
        Target::upright(position, Vec3::zeros())
    }

    fn pushed(force: Vec3) -> Given {
        Given { force, ..Given::default() }
    }

    #[test]
    fn a_torque_turns_the_hand_back_by_torque_over_stiffness_and_no_more_than_the_device_gives() {
        let device = Device { max_torque: 0.1, ..frictionless() };
        let wanted = UnitQuaternion::new(Vec3::new(0.3, -0.2, 0.5));
        let turned = |device: &Device, torque: Vec3| {
            let mut held = HeldDevice::new(device.clone(), Hand::default(), Vec3::zeros());
            let target = Target { orientation: wanted, ..still(Vec3::zeros()) };
            let given = (0..2000).map(|_| held.step(DT, &target, Given { torque, ..Given::default() })).last();
            ((held.orientation() * wanted.inverse()).scaled_axis(), given.unwrap().torque)
        };
        let torque = Vec3::new(0.0, 0.06, 0.02);
        let (angle, given) = turned(&device, torque);
        assert!((angle - torque / Hand::default().angular_stiffness).norm() < 1e-9 && given == torque);
        let (angle, given) = turned(&device, torque * 10.0);
        assert!((given.norm() - 0.1).abs() < 1e-12);
        assert!((angle.norm() - 0.1 / Hand::default().angular_stiffness).abs() < 1e-9);
        // A device without torque turns where the hand wants it.
        let (angle, given) = turned(&frictionless(), torque);
        assert!(angle.norm() < 1e-9 && given == Vec3::zeros());
    }

    #[test]
    fn a_turning_hand_turns_the_device_along() {
        let velocity = Vec3::new(0.5, 1.0, -0.3);
        let mut held = HeldDevice::new(omni(), Hand::default(), Vec3::zeros());
        for tick in 0..1000 {
            let orientation = UnitQuaternion::new(velocity * (f64::from(tick) * DT));
            let still = Target::upright(Vec3::zeros(), Vec3::zeros());
            held.step(DT, &Target { orientation, angular_velocity: velocity, ..still }, Given::default());
        }
        // Within what it turns in a sub-step.
        assert!(held.orientation().angle_to(&UnitQuaternion::new(velocity)) < 1.1 * velocity.norm() * SUBSTEP);
    }

    #[test]
    fn a_free_device_reaches_its_target() {
        let target = Vec3::new(0.01, -0.02, 0.03);
        for (device, bound) in [(frictionless(), 1e-9), (omni(), omni().friction / Hand::default().stiffness)] {
            let mut held = HeldDevice::new(device, Hand::default(), Vec3::zeros());
            for _ in 0..2000 {
                held.step(DT, &still(target), Given::default());
            }
            assert!((held.position() - target).norm() <= bound);
        }
    }

    #[test]
    fn a_force_pushes_the_hand_back_by_force_over_stiffness() {
        let hand = Hand::default();
        let mut held = HeldDevice::new(frictionless(), hand, Vec3::zeros());
        let force = Vec3::new(0.0, 0.0, 1.5);
        for _ in 0..2000 {
            held.step(DT, &still(Vec3::zeros()), pushed(force));
        }
        assert!((held.position() - force / hand.stiffness).norm() < 1e-9);
    }

    #[test]
    fn the_device_never_renders_more_than_its_force_limit() {
        let mut held = HeldDevice::new(frictionless(), Hand::default(), Vec3::zeros());
        let rendered = held.step(DT, &still(Vec3::zeros()), pushed(Vec3::new(30.0, 40.0, 0.0))).force;
        assert!((rendered - Vec3::new(0.6, 0.8, 0.0) * 3.3).norm() < 1e-12);
        for _ in 0..2000 {
            held.step(DT, &still(Vec3::zeros()), pushed(Vec3::new(30.0, 40.0, 0.0)));
        }
        assert!((held.position().norm() - 3.3 / Hand::default().stiffness).abs() < 1e-9);
    }

    #[test]
    fn friction_holds_a_force_smaller_than_itself_and_takes_energy_from_motion() {
        // Creep at a force below friction: at most force / sqrt(friction² − force²) slip speeds.
        let loose = Hand { stiffness: 0.0, damping: 0.0, ..Hand::default() };
        let mut held = HeldDevice::new(omni(), loose, Vec3::zeros());
        for _ in 0..1000 {
            held.step(DT, &still(Vec3::zeros()), pushed(Vec3::new(0.13, 0.0, 0.0)));
        }
        assert!(held.position().norm() < SLIP_SPEED);
        let mut moving = HeldDevice { velocity: Vec3::new(0.1, 0.0, 0.0), ..held };
        for _ in 0..200 {
            moving.step(DT, &still(Vec3::zeros()), Given::default());
        }
        assert!(moving.velocity.norm() < SLIP_SPEED);
    }

    #[test]
    fn a_light_grip_oscillates_at_the_frequency_of_its_mass_and_stiffness() {
        let hand = Hand { damping: 0.0, ..Hand::default() };
        let mut held = HeldDevice::new(frictionless(), hand, Vec3::new(0.01, 0.0, 0.0));
        let period = std::f64::consts::TAU * ((hand.mass + omni().mass) / hand.stiffness).sqrt();
        for _ in 0..(10.0 * period / DT).round() as u32 {
            held.step(DT, &still(Vec3::zeros()), Given::default());
        }
        assert!((held.position().x - 0.01).abs() < 1e-4, "amplitude and phase are kept over ten periods");
    }

    #[test]
    fn encoder_positions_are_multiples_of_the_resolution() {
        let mut held = HeldDevice::new(omni(), Hand::default(), Vec3::zeros());
        let target = Target::upright(Vec3::new(0.0123, -0.0456, 0.0789), Vec3::zeros());
        for _ in 0..100 {
            held.step(DT, &target, Given::default());
            let steps = held.reported_position() / omni().resolution;
            assert!(steps.iter().all(|n| (n - n.round()).abs() < 1e-6));
            let error = (held.reported_position() - held.position()).amax();
            assert!(error <= 0.5 * omni().resolution * (1.0 + 1e-9));
        }
    }

    #[test]
    fn the_reported_velocity_is_that_of_a_steady_motion() {
        let velocity = Vec3::new(0.05, 0.0, 0.0);
        let mut held = HeldDevice::new(frictionless(), Hand::default(), Vec3::zeros());
        let mut mean = Vec3::zeros();
        for tick in 0..3000 {
            let position = velocity * (f64::from(tick) * DT);
            held.step(DT, &Target::upright(position, velocity), Given::default());
            if tick >= 2000 {
                mean += held.reported_velocity() / 1000.0;
            }
        }
        assert!((mean - velocity).norm() < 1e-4);
    }

    #[test]
    fn the_same_inputs_give_the_same_motion() {
        let motion = || {
            let mut held = HeldDevice::new(omni(), Hand::default(), Vec3::zeros());
            for tick in 0..500 {
                let force = Vec3::new(0.0, (f64::from(tick) * 0.01).sin(), 0.5);
                held.step(DT, &still(Vec3::new(0.01, 0.0, 0.0)), pushed(force));
            }
            held
        };
        assert_eq!(motion(), motion());
    }
}
