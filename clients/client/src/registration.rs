//! Where the device's space lies in the body's, and the clutch that moves it.
//!
//! Both are in Palpate's axes and metres by now, see [`Frame`](crate::Frame). With scale s, rotation R and translation t:
//!
//! ```text
//! x_body = s R x_device + t      v_body = s R v_device      F_device = s Rᵀ F_body
//! ω_body = R ω_device            τ_device = Rᵀ τ_body
//! ```
//!
//! Forces go back with the factor with which motions came, so that power is the same on both sides and a passive body
//! stays passive: F_device · v_device = F_body · v_body. A stiffness K of the body is s² K to the device. With s below 1
//! a large motion of the hand is a fine one of the tool; to feel true newtons, take s = 1.

#![allow(non_snake_case)] // F is a force, K a stiffness, as printed

use nalgebra::{Matrix3, Quaternion, UnitQuaternion, Vector3};

use crate::{ClientError, Device, PoseSample};

/// How far points must lie off a common line, relative to their extent along it. Below that the rotation about the line
/// would be a guess from measurement errors.
const LEAST_SPREAD: f64 = 0.01;
/// Time [s] in which the force goes to zero when the clutch is pressed: quick, because the hand moves freely at once.
const RELEASE_TIME: f64 = 0.02;
/// Time [s] in which the force comes back after the clutch is let go, slow enough for the hand to answer.
const ENGAGE_TIME: f64 = 0.2;

/// The map from device space to body space.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Registration {
    scale: f64,
    rotation: UnitQuaternion<f64>,
    translation: Vector3<f64>,
    /// How the tool is turned in the hand: applied first, so that it changes no direction of motion.
    grip: UnitQuaternion<f64>,
}

/// A registration and how well it explains the points it was fitted to.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Fit {
    /// The best one in the sense of least squares.
    pub registration: Registration,
    /// Root mean square of the distances that remain, in body space [m].
    pub residual: f64,
}

impl Default for Registration {
    /// Device space is body space.
    fn default() -> Self {
        Self {
            scale: 1.0,
            rotation: UnitQuaternion::identity(),
            translation: Vector3::zeros(),
            grip: UnitQuaternion::identity(),
        }
    }
}

impl Registration {
    /// From scale, rotation (4: x, y, z, w) and translation (3) [m].
    ///
    /// Errors: [`ClientError::Registration`] when the scale is not above 0, the quaternion is zero or a number not finite.
    pub fn new(scale: f64, [x, y, z, w]: [f64; 4], translation: [f64; 3]) -> Result<Self, ClientError> {
        let rotation = UnitQuaternion::try_new(Quaternion::new(w, x, y, z), 1e-9);
        match rotation {
            _ if !(scale > 0.0 && scale.is_finite()) => Err(unfit("the scale must be above 0")),
            Some(rotation) if [x, y, z, w].iter().chain(&translation).all(|number| number.is_finite()) => {
                Ok(Self { scale, rotation, translation: translation.into(), ..Self::default() })
            }
            _ => Err(unfit("the rotation must be a quaternion and every number finite")),
        }
    }

    /// Fits rotation and translation to pairs of a point of device space and the point of body space it is (3 each)
    /// [m]: three or more that do not lie on one line. Fits the scale too, unless it is given.
    ///
    /// Errors: [`ClientError::Registration`] for fewer points, points on a line, numbers that are not finite.
    pub fn fit(pairs: &[([f64; 3], [f64; 3])], scale: Option<f64>) -> Result<Fit, ClientError> {
        if pairs.len() < 3 {
            return Err(unfit("it takes three pairs of points or more"));
        }
        if pairs.iter().any(|(device, body)| device.iter().chain(body).any(|number| !number.is_finite())) {
            return Err(unfit("a point is not finite"));
        }
        let n = pairs.len() as f64;
        let points = || pairs.iter().map(|(device, body)| (Vector3::from(*device), Vector3::from(*body)));
        let device_mean = points().map(|(device, _)| device).sum::<Vector3<f64>>() / n;
        let body_mean = points().map(|(_, body)| body).sum::<Vector3<f64>>() / n;
        let [mut device_scatter, mut body_scatter, mut covariance] = [Matrix3::zeros(); 3];
        for (device, body) in points().map(|(device, body)| (device - device_mean, body - body_mean)) {
            device_scatter += device * device.transpose();
            body_scatter += body * body.transpose();
            covariance += body * device.transpose();
        }
        for (scatter, space) in [(device_scatter, "device"), (body_scatter, "body")] {
            let spread = scatter.singular_values(); // squares of lengths, in descending order
            if spread[0] == 0.0 || spread[1] < LEAST_SPREAD * LEAST_SPREAD * spread[0] {
                return Err(unfit(&format!("the points in {space} space lie on one line or in one spot")));
            }
        }
        // Kabsch 1976, Umeyama 1991: R = U S Vᵀ, where S turns a reflection into the nearest rotation.
        let svd = covariance.svd(true, true);
        let (Some(u), Some(v_t)) = (svd.u, svd.v_t) else { return Err(unfit("the points have no rotation")) };
        let sign = Vector3::new(1.0, 1.0, (u * v_t).determinant().signum());
        let rotation = UnitQuaternion::from_matrix(&(u * Matrix3::from_diagonal(&sign) * v_t));
        let scale = scale.unwrap_or(svd.singular_values.dot(&sign) / device_scatter.trace());
        if !(scale > 0.0 && scale.is_finite()) {
            return Err(unfit("the scale must be above 0"));
        }
        let translation = body_mean - scale * (rotation * device_mean);
        let registration = Self { scale, rotation, translation, ..Self::default() };
        let squares = pairs.iter().map(|(device, body)| {
            (Vector3::from(registration.position(*device)) - Vector3::from(*body)).norm_squared()
        });
        Ok(Fit { registration, residual: (squares.sum::<f64>() / n).sqrt() })
    }

    /// The same scale and rotation, shifted so that this point of device space is that point of body space (3) [m].
    pub fn place(self, device: [f64; 3], body: [f64; 3]) -> Self {
        let translation = Vector3::from(body) - self.scale * (self.rotation * Vector3::from(device));
        Self { translation, ..self }
    }

    /// How many metres of the body one metre of the device is.
    pub fn scale(&self) -> f64 {
        self.scale
    }

    /// R as a unit quaternion x, y, z, w.
    pub fn rotation(&self) -> [f64; 4] {
        self.rotation.coords.into()
    }

    /// Where the origin of device space lies in body space (3) [m].
    pub fn translation(&self) -> [f64; 3] {
        self.translation.into()
    }

    /// A position (3) [m], from device to body space.
    pub fn position(&self, device: [f64; 3]) -> [f64; 3] {
        (self.scale * (self.rotation * Vector3::from(device)) + self.translation).into()
    }

    /// A velocity (3) [m/s], from device to body space.
    pub fn velocity(&self, device: [f64; 3]) -> [f64; 3] {
        (self.scale * (self.rotation * Vector3::from(device))).into()
    }

    /// An angular velocity (3) [rad/s], from device to body space.
    pub fn angular_velocity(&self, device: [f64; 3]) -> [f64; 3] {
        (self.rotation * Vector3::from(device)).into()
    }

    /// An orientation (4: x, y, z, w), from device to body space.
    pub fn orientation(&self, [x, y, z, w]: [f64; 4]) -> [f64; 4] {
        let device = UnitQuaternion::new_normalize(Quaternion::new(w, x, y, z));
        (self.rotation * device * self.grip).coords.into()
    }

    /// A whole pose, from device to body space.
    pub fn pose(&self, device: &PoseSample) -> PoseSample {
        PoseSample {
            position: self.position(device.position),
            orientation: self.orientation(device.orientation),
            linear_velocity: device.linear_velocity.map(|v| self.velocity(v)),
            buttons: device.buttons,
            opening: device.opening,
        }
    }

    /// A force (3) [N], from body to device space.
    pub fn force_to_device(&self, body: [f64; 3]) -> [f64; 3] {
        (self.scale * self.rotation.inverse_transform_vector(&Vector3::from(body))).into()
    }

    /// A torque (3) [N·m] about the tool's reference point, from body to device space. It is not scaled: turns are not.
    pub fn torque_to_device(&self, body: [f64; 3]) -> [f64; 3] {
        self.rotation.inverse_transform_vector(&Vector3::from(body)).into()
    }

    /// The device as it looks from body space: what its limits of force, stiffness and damping are there.
    pub fn in_body(&self, device: &Device) -> Device {
        let s = self.scale;
        Device {
            name: device.name.clone(),
            max_force: device.max_force / s,
            max_torque: device.max_torque,
            max_angular_stiffness: device.max_angular_stiffness,
            max_stiffness: device.max_stiffness / (s * s),
            max_damping: device.max_damping / (s * s),
            workspace_radius: device.workspace_radius * s,
            resolution: device.resolution * s,
            mass: device.mass / (s * s),
            friction: device.friction / s,
        }
    }

    /// The stiffness of the virtual coupling [N/m] to attach with: the stiffest the device renders, in body space.
    pub fn coupling_stiffness(&self, device: &Device) -> f64 {
        self.in_body(device).max_stiffness
    }
}

fn unfit(reason: &str) -> ClientError {
    ClientError::Registration(reason.to_owned())
}

/// A registration that the hand can shift: while the clutch is pressed the tool stays where it is in the body, the hand
/// moves freely, and afterwards the motion goes on from there.
#[derive(Clone, Debug, PartialEq)]
pub struct Clutch {
    registration: Registration,
    /// Where the tool was when the clutch was pressed, and still is.
    held: Option<PoseSample>,
    force_scale: f64,
    last_ns: Option<u64>,
}

impl Clutch {
    /// Not pressed, force in full.
    pub fn new(registration: Registration) -> Self {
        Self { registration, held: None, force_scale: 1.0, last_ns: None }
    }

    /// Where the tool is in the body, for a device held at `device` at `now_ns`, the clutch pressed or not.
    ///
    /// Without a jump in position or orientation when the clutch is let go: the translation takes up the shift of the
    /// hand, and the tool keeps its new turn in the hand. A pose that is none, because a number is not finite or the
    /// quaternion zero, changes nothing: the tool stays where the clutch holds it, or is not finite either.
    pub fn follow(&mut self, device: &PoseSample, pressed: bool, now_ns: u64) -> PoseSample {
        let in_body = self.registration.pose(device);
        if !in_body.is_finite() {
            return self.held.unwrap_or(in_body);
        }
        let dt = self.last_ns.map_or(0, |last| now_ns.saturating_sub(last)) as f64 * 1e-9;
        self.last_ns = Some(now_ns);
        let step = if pressed { -dt / RELEASE_TIME } else { dt / ENGAGE_TIME };
        self.force_scale = (self.force_scale + step).clamp(0.0, 1.0);

        if pressed {
            let held = *self.held.get_or_insert(in_body);
            return PoseSample {
                linear_velocity: device.linear_velocity.map(|_| [0.0; 3]),
                buttons: device.buttons,
                opening: device.opening,
                ..held
            };
        }
        if let Some(held) = self.held.take() {
            self.registration = self.registration.place(device.position, held.position);
            let [x, y, z, w] = device.orientation;
            let hand = self.registration.rotation * UnitQuaternion::new_normalize(Quaternion::new(w, x, y, z));
            let [x, y, z, w] = held.orientation;
            self.registration.grip = hand.inverse() * UnitQuaternion::new_normalize(Quaternion::new(w, x, y, z));
        }
        self.registration.pose(device)
    }

    /// The registration as the clutch has shifted it: forces go back through this one.
    pub fn registration(&self) -> &Registration {
        &self.registration
    }

    /// What to multiply force and torque by: falls to 0 within 20 ms of pressing, rises to 1 within 200 ms of letting
    /// go.
    pub fn force_scale(&self) -> f64 {
        self.force_scale
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn vector(limit: f64) -> impl Strategy<Value = [f64; 3]> {
        [-limit..limit, -limit..limit, -limit..limit]
    }

    fn any_registration() -> impl Strategy<Value = Registration> {
        (0.05..20.0, vector(3.0), vector(1.0)).prop_map(|(scale, turn, translation)| {
            let rotation = UnitQuaternion::from_scaled_axis(Vector3::from(turn));
            Registration::new(scale, rotation.coords.into(), translation).unwrap()
        })
    }

    fn near(a: [f64; 3], b: [f64; 3], tolerance: f64) -> bool {
        (Vector3::from(a) - Vector3::from(b)).norm() <= tolerance
    }

    fn pose(position: [f64; 3], turn: [f64; 3]) -> PoseSample {
        PoseSample {
            position,
            orientation: UnitQuaternion::from_scaled_axis(Vector3::from(turn)).coords.into(),
            linear_velocity: Some([0.1, 0.0, 0.0]),
            buttons: 2,
            opening: 0.5,
        }
    }

    proptest! {
        #[test]
        fn power_is_the_same_on_both_sides(
            registration in any_registration(), v in vector(1.0), F in vector(10.0), omega in vector(5.0), tau in vector(1.0)
        ) {
            let dot = |a: [f64; 3], b: [f64; 3]| Vector3::from(a).dot(&Vector3::from(b));
            let body = dot(F, registration.velocity(v)) + dot(tau, registration.angular_velocity(omega));
            let device = dot(registration.force_to_device(F), v) + dot(registration.torque_to_device(tau), omega);
            prop_assert!((body - device).abs() <= 1e-12 * (1.0 + body.abs() + 1e3));
        }

        #[test]
        fn the_velocity_is_the_rate_of_the_position(registration in any_registration(), x in vector(1.0), v in vector(1.0)) {
            let moved = std::array::from_fn(|i| x[i] + 1e-3 * v[i]);
            let difference = Vector3::from(registration.position(moved)) - Vector3::from(registration.position(x));
            prop_assert!(near((difference / 1e-3).into(), registration.velocity(v), 1e-9));
        }

        #[test]
        fn a_spring_of_the_coupling_stiffness_feels_as_stiff_as_the_device_can(registration in any_registration()) {
            let device = Device::default();
            let K = registration.coupling_stiffness(&device);
            let F = registration.velocity([0.0, 0.0, -1e-3]).map(|x| -K * x);
            prop_assert!((registration.force_to_device(F)[2] / 1e-3 / device.max_stiffness - 1.0).abs() < 1e-9);
            let budget = registration.in_body(&device).passivity_budget();
            prop_assert!((budget / device.passivity_budget() - 1.0).abs() < 1e-9, "energy is the same in both");
        }

        #[test]
        fn three_points_or_more_find_the_registration_they_came_from(
            registration in any_registration(),
            more in prop::collection::vec(vector(0.1), 0..5),
        ) {
            let points = [[0.0; 3], [0.1, 0.0, 0.0], [0.0, 0.08, 0.02]].into_iter().chain(more);
            let pairs: Vec<_> = points.map(|device| (device, registration.position(device))).collect();
            let fit = Registration::fit(&pairs, None).unwrap();
            prop_assert!(fit.residual < 1e-9 && (fit.registration.scale() / registration.scale() - 1.0).abs() < 1e-9);
            let elsewhere = [0.05, -0.07, 0.09];
            prop_assert!(near(fit.registration.position(elsewhere), registration.position(elsewhere), 1e-8));
            let rigid = Registration::fit(&pairs, Some(registration.scale())).unwrap();
            prop_assert!(rigid.residual < 1e-9);
        }

        #[test]
        fn the_clutch_lets_the_hand_move_and_the_tool_stay(
            registration in any_registration(), from in vector(0.1), to in vector(0.1), on in vector(0.1), turn in vector(2.0)
        ) {
            let mut clutch = Clutch::new(registration);
            let before = clutch.follow(&pose(from, [0.0; 3]), false, 0);
            let held = [clutch.follow(&pose(from, [0.0; 3]), true, 1_000_000), clutch.follow(&pose(to, turn), true, 50_000_000)];
            for held in held {
                prop_assert!(near(held.position, before.position, 1e-12));
                prop_assert_eq!(held.linear_velocity, Some([0.0; 3]));
            }
            let after = clutch.follow(&pose(to, turn), false, 51_000_000);
            prop_assert!(near(after.position, before.position, 1e-9));
            let turned: f64 = (0..4).map(|i| after.orientation[i] * before.orientation[i]).sum();
            prop_assert!((turned.abs() - 1.0).abs() < 1e-9, "no jump in orientation");
            // From there on the tool moves as the hand does.
            let moved = clutch.follow(&pose(on, turn), false, 52_000_000);
            let motion = registration.velocity(std::array::from_fn(|i| on[i] - to[i]));
            prop_assert!(near(moved.position, std::array::from_fn(|i| after.position[i] + motion[i]), 1e-9));
        }
    }

    #[test]
    fn degenerate_points_are_errors_that_say_so() {
        let at = |points: &[[f64; 3]]| points.iter().map(|p| (*p, *p)).collect::<Vec<_>>();
        let error = |pairs: &[_]| Registration::fit(pairs, None).unwrap_err().to_string();
        assert!(error(&at(&[[0.0; 3], [1.0, 0.0, 0.0]])).contains("three pairs"));
        assert!(error(&at(&[[0.0; 3], [1.0, 0.0, 0.0], [2.0, 0.001, 0.0]])).contains("device space lie on one line"));
        assert!(error(&at(&[[0.5; 3]; 4])).contains("one spot"));
        assert!(error(&at(&[[0.0; 3], [1.0, 0.0, 0.0], [0.0, f64::NAN, 0.0]])).contains("not finite"));
        let collapsed = [[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]].map(|device| (device, [0.0; 3]));
        assert!(error(&collapsed).contains("body space"));
        let triangle = at(&[[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]);
        assert!(Registration::fit(&triangle, Some(-1.0)).is_err());
        for bad in [0.0, -1.0, f64::NAN, f64::INFINITY] {
            assert!(Registration::new(bad, [0.0, 0.0, 0.0, 1.0], [0.0; 3]).is_err());
        }
        assert!(Registration::new(1.0, [0.0; 4], [0.0; 3]).is_err());
        assert!(Registration::new(1.0, [0.0, 0.0, 0.0, 1.0], [0.0, f64::NAN, 0.0]).is_err());
    }

    #[test]
    fn mirrored_points_give_a_rotation_and_a_residual_that_tells() {
        let points = [[0.0; 3], [0.1, 0.0, 0.0], [0.0, 0.1, 0.0], [0.0, 0.0, 0.1]];
        let mirrored = points.map(|p| (p, [-p[0], p[1], p[2]]));
        let fit = Registration::fit(&mirrored, None).unwrap();
        assert!(fit.residual > 0.01);
    }

    #[test]
    fn placing_puts_one_point_on_another() {
        let registration = Registration::new(0.5, [0.0, 0.0, 1.0, 1.0], [1.0, 2.0, 3.0]).unwrap();
        let placed = registration.place([0.1, 0.2, 0.3], [0.0, 0.0, 0.1]);
        assert!(near(placed.position([0.1, 0.2, 0.3]), [0.0, 0.0, 0.1], 1e-15));
        assert_eq!(placed.velocity([1.0, 0.0, 0.0]), registration.velocity([1.0, 0.0, 0.0]));
    }

    #[test]
    fn a_pose_that_is_none_leaves_the_clutch_as_it_is() {
        let good = pose([0.1, 0.0, 0.0], [0.0; 3]);
        let bad = [
            PoseSample { position: [f64::NAN, 0.0, 0.0], ..good },
            PoseSample { orientation: [0.0; 4], ..good },
            PoseSample { linear_velocity: Some([0.0, f64::INFINITY, 0.0]), ..good },
        ];
        let mut clutch = Clutch::new(Registration::default());
        let before = clutch.follow(&good, false, 0);
        for bad in bad {
            assert!(!clutch.follow(&bad, false, 1_000_000).is_finite());
            clutch.follow(&bad, true, 2_000_000);
            assert!(clutch.follow(&good, true, 3_000_000).is_finite());
            assert!(clutch.follow(&bad, true, 4_000_000).is_finite(), "the tool stays");
            clutch.follow(&bad, false, 5_000_000);
            assert_eq!(clutch.follow(&good, false, 6_000_000), before);
        }
    }

    #[test]
    fn the_clutch_ramps_the_force_out_and_in() {
        let mut clutch = Clutch::new(Registration::default());
        let mut after = |pressed, ms: u64| {
            clutch.follow(&pose([0.0; 3], [0.0; 3]), pressed, ms * 1_000_000);
            clutch.force_scale()
        };
        assert_eq!(after(false, 0), 1.0);
        assert!((after(true, 10) - 0.5).abs() < 1e-12);
        assert_eq!(after(true, 100), 0.0);
        assert!((after(false, 200) - 0.5).abs() < 1e-12);
        assert_eq!(after(false, 500), 1.0);
    }
}
