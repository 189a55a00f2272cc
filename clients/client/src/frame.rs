//! Frames of other systems: their axes, units and quaternions to Palpate's, and back.
//!
//! Palpate's frame is right-handed, in metres, +x to the right, +y away from the user, +z up; quaternions are x, y, z, w.
//! Only +z is fixed by the scene: where a body lies in the plane is up to the [`Registration`](crate::Registration).
//!
//! | preset | handed | x | y | z | unit | quaternion |
//! |---|---|---|---|---|---|---|
//! | `palpate` | right | right | forward | up | m | x, y, z, w |
//! | `openxr` | right | right | up | back, to the user | m | x, y, z, w |
//! | `unity` | left | right | up | forward | m | x, y, z, w |
//! | `unreal` | left | forward | right | up | cm | x, y, z, w |
//! | `ros` (REP 103) | right | forward | left | up | m | x, y, z, w |
//! | `phantom` (OpenHaptics) | right | right | up | back, to the user | mm | x, y, z, w |
//! | `haply` (Inverse, its own basis) | right | right | forward | up | m | w, x, y, z |
//!
//! Whatever the unit of length, forces are in newtons and torques in newton metres on both sides; angular velocities are
//! in rad/s. OpenHaptics gives orientation as a matrix: make the quaternion from it in its own frame.
//!
//! Between a left- and a right-handed frame positions, velocities and forces are mirrored as the axes are. Torques and
//! angular velocities are pseudo-vectors: their sense belongs to the hand rule of their frame, so that they change sign
//! besides, and so does the vector part of a quaternion.

use nalgebra::{Matrix3, Vector3};

use crate::ClientError;

/// The axes, unit and quaternion order of another system.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Frame {
    /// Lower case.
    pub name: &'static str,
    /// Row i: Palpate's axis i in the other frame's axes. A signed permutation.
    axes: [[f64; 3]; 3],
    /// Length of the other frame's unit [m].
    unit: f64,
    /// True where the scalar stands first.
    scalar_first: bool,
}

const RIGHT_FORWARD_UP: [[f64; 3]; 3] = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
const RIGHT_UP_BACK: [[f64; 3]; 3] = [[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]];
const RIGHT_UP_FORWARD: [[f64; 3]; 3] = [[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, 1.0, 0.0]];
const FORWARD_RIGHT_UP: [[f64; 3]; 3] = [[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]];
const FORWARD_LEFT_UP: [[f64; 3]; 3] = [[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]];

const FRAMES: [Frame; 7] = [
    Frame { name: "palpate", axes: RIGHT_FORWARD_UP, unit: 1.0, scalar_first: false },
    Frame { name: "openxr", axes: RIGHT_UP_BACK, unit: 1.0, scalar_first: false },
    Frame { name: "unity", axes: RIGHT_UP_FORWARD, unit: 1.0, scalar_first: false },
    Frame { name: "unreal", axes: FORWARD_RIGHT_UP, unit: 0.01, scalar_first: false },
    Frame { name: "ros", axes: FORWARD_LEFT_UP, unit: 1.0, scalar_first: false },
    Frame { name: "phantom", axes: RIGHT_UP_BACK, unit: 1e-3, scalar_first: false },
    Frame { name: "haply", axes: RIGHT_FORWARD_UP, unit: 1.0, scalar_first: true },
];

impl Frame {
    /// The preset called `name`, in whatever case. Errors: there is none; the error lists those there are.
    pub fn by_name(name: &str) -> Result<Frame, ClientError> {
        FRAMES.into_iter().find(|frame| frame.name.eq_ignore_ascii_case(name)).ok_or_else(|| {
            let known = FRAMES.map(|frame| frame.name).join(", ");
            ClientError::Unknown { what: "frame", name: name.to_owned(), known }
        })
    }

    /// A position (3), from the frame's unit to Palpate's metres.
    pub fn position_in(&self, position: [f64; 3]) -> [f64; 3] {
        (self.axes() * Vector3::from(position) * self.unit).into()
    }

    /// A position (3), from Palpate's metres to the frame's unit.
    pub fn position_out(&self, position: [f64; 3]) -> [f64; 3] {
        (self.axes().tr_mul(&Vector3::from(position)) / self.unit).into()
    }

    /// A velocity (3), from the frame's unit per second to m/s.
    pub fn velocity_in(&self, velocity: [f64; 3]) -> [f64; 3] {
        self.position_in(velocity)
    }

    /// A velocity (3), from m/s to the frame's unit per second.
    pub fn velocity_out(&self, velocity: [f64; 3]) -> [f64; 3] {
        self.position_out(velocity)
    }

    /// A force or a direction (3), which has no unit of length, from the frame's axes to Palpate's.
    pub fn force_in(&self, force: [f64; 3]) -> [f64; 3] {
        (self.axes() * Vector3::from(force)).into()
    }

    /// A force or a direction (3), from Palpate's axes to the frame's.
    pub fn force_out(&self, force: [f64; 3]) -> [f64; 3] {
        self.axes().tr_mul(&Vector3::from(force)).into()
    }

    /// A torque [N·m] or an angular velocity [rad/s] (3), from the frame's axes and hand rule to Palpate's.
    pub fn torque_in(&self, torque: [f64; 3]) -> [f64; 3] {
        (self.axes() * Vector3::from(torque) * self.handedness()).into()
    }

    /// A torque [N·m] or an angular velocity [rad/s] (3), from Palpate's axes and hand rule to the frame's.
    pub fn torque_out(&self, torque: [f64; 3]) -> [f64; 3] {
        (self.axes().tr_mul(&Vector3::from(torque)) * self.handedness()).into()
    }

    /// An orientation (4), from the frame's quaternion order to Palpate's x, y, z, w. The identity stays the identity.
    pub fn orientation_in(&self, q: [f64; 4]) -> [f64; 4] {
        let [x, y, z, w] = if self.scalar_first { [q[1], q[2], q[3], q[0]] } else { q };
        let [x, y, z] = self.torque_in([x, y, z]);
        [x, y, z, w]
    }

    /// An orientation (4), from Palpate's x, y, z, w to the frame's quaternion order.
    pub fn orientation_out(&self, [x, y, z, w]: [f64; 4]) -> [f64; 4] {
        let [x, y, z] = self.torque_out([x, y, z]);
        if self.scalar_first { [w, x, y, z] } else { [x, y, z, w] }
    }

    fn axes(&self) -> Matrix3<f64> {
        Matrix3::from(self.axes).transpose() // nalgebra takes columns
    }

    /// 1 for a right-handed frame, −1 for a left-handed one.
    fn handedness(&self) -> f64 {
        self.axes().determinant()
    }
}

impl Default for Frame {
    /// Palpate's own: nothing changes.
    fn default() -> Self {
        let [palpate, ..] = FRAMES;
        palpate
    }
}

#[cfg(test)]
mod tests {
    use std::f64::consts::FRAC_1_SQRT_2;

    use nalgebra::{Quaternion, UnitQuaternion};

    use super::*;

    const RIGHT: [f64; 3] = [1.0, 0.0, 0.0];
    const FORWARD: [f64; 3] = [0.0, 1.0, 0.0];
    const UP: [f64; 3] = [0.0, 0.0, 1.0];

    fn frame(name: &str) -> Frame {
        Frame::by_name(name).unwrap()
    }

    /// Rotates with x, y, z, w.
    fn rotate([x, y, z, w]: [f64; 4], vector: [f64; 3]) -> Vector3<f64> {
        UnitQuaternion::new_normalize(Quaternion::new(w, x, y, z)) * Vector3::from(vector)
    }

    fn near(a: impl AsRef<[f64]>, b: impl AsRef<[f64]>) -> bool {
        let (a, b) = (a.as_ref(), b.as_ref());
        a.len() == b.len() && a.iter().zip(b).all(|(a, b)| (a - b).abs() < 1e-12)
    }

    #[test]
    fn right_forward_and_up_of_every_preset_are_those_of_palpate() {
        for (name, right, forward, up) in [
            ("palpate", RIGHT, FORWARD, UP),
            ("openxr", [1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]),
            ("unity", [1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, 1.0, 0.0]),
            ("unreal", [0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]),
            ("ros", [0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]),
            ("phantom", [1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]),
            ("haply", RIGHT, FORWARD, UP),
        ] {
            let frame = frame(name);
            assert_eq!([right, forward, up].map(|v| frame.force_in(v)), [RIGHT, FORWARD, UP], "{name}");
        }
        assert!(Frame::by_name("blender").unwrap_err().to_string().contains("openxr, unity, unreal, ros"));
    }

    #[test]
    fn only_unity_and_unreal_are_left_handed() {
        for frame in FRAMES {
            let left = ["unity", "unreal"].contains(&frame.name);
            assert_eq!(frame.handedness(), if left { -1.0 } else { 1.0 }, "{}", frame.name);
        }
    }

    #[test]
    fn lengths_change_their_unit_and_forces_do_not() {
        // 20 cm forward, 10 to the right and 30 up.
        assert!(near(frame("unreal").position_in([20.0, 10.0, 30.0]), [0.1, 0.2, 0.3]));
        assert!(near(frame("unreal").velocity_in([20.0, 10.0, 30.0]), [0.1, 0.2, 0.3]));
        assert!(near(frame("unreal").force_in([2.0, 1.0, 3.0]), [1.0, 2.0, 3.0]));
        // 50 mm up and 100 towards the user.
        assert!(near(frame("phantom").position_in([0.0, 50.0, 100.0]), [0.0, -0.1, 0.05]));
        assert!(near(frame("phantom").force_out([0.0, 0.0, 3.3]), [0.0, 3.3, 0.0]));
    }

    #[test]
    fn a_quarter_turn_about_up_turns_the_same_way_everywhere() {
        let s = FRAC_1_SQRT_2;
        // To the left, as right-handed frames count: forward becomes left. Left-handed ones count to the right.
        for (name, quaternion, after) in [
            ("palpate", [0.0, 0.0, s, s], [-1.0, 0.0, 0.0]),
            ("openxr", [0.0, s, 0.0, s], [-1.0, 0.0, 0.0]),
            ("unity", [0.0, s, 0.0, s], [1.0, 0.0, 0.0]),
            ("unreal", [0.0, 0.0, s, s], [1.0, 0.0, 0.0]),
            ("ros", [0.0, 0.0, s, s], [-1.0, 0.0, 0.0]),
            ("phantom", [0.0, s, 0.0, s], [-1.0, 0.0, 0.0]),
            ("haply", [s, 0.0, 0.0, s], [-1.0, 0.0, 0.0]),
        ] {
            let turned = rotate(frame(name).orientation_in(quaternion), FORWARD);
            assert!(near(turned, Vector3::from(after)), "{name}: {turned}");
        }
    }

    #[test]
    fn rotating_and_changing_the_frame_may_be_done_in_either_order() {
        let quaternion = UnitQuaternion::from_euler_angles(0.3, -0.7, 1.1);
        let vector = [0.2, -0.5, 0.9];
        for frame in FRAMES {
            let [x, y, z, w] = quaternion.coords.into();
            let theirs = if frame.scalar_first { [w, x, y, z] } else { [x, y, z, w] };
            let inside = rotate(frame.orientation_in(theirs), frame.force_in(vector));
            let outside = frame.force_in(rotate([x, y, z, w], vector).into());
            assert!(near(inside, Vector3::from(outside)), "{}", frame.name);
        }
    }

    #[test]
    fn a_torque_is_lever_times_force_in_every_frame() {
        let (lever, force) = (Vector3::new(0.1, -0.2, 0.3), Vector3::new(2.0, 1.0, -0.5));
        for frame in FRAMES {
            // The cross product's components follow the hand rule of their frame.
            let theirs = lever.cross(&force);
            let ours = Vector3::from(frame.force_in(lever.into())).cross(&Vector3::from(frame.force_in(force.into())));
            assert!(near(frame.torque_in(theirs.into()), ours), "{}", frame.name);
        }
    }

    #[test]
    fn what_comes_in_goes_out_unchanged() {
        let (vector, quaternion) = ([0.3, -1.2, 2.5], [0.1, -0.5, 0.7, 0.5]);
        for frame in FRAMES {
            assert!(near(frame.position_out(frame.position_in(vector)), vector));
            assert!(near(frame.velocity_out(frame.velocity_in(vector)), vector));
            assert!(near(frame.force_out(frame.force_in(vector)), vector));
            assert!(near(frame.torque_out(frame.torque_in(vector)), vector));
            assert!(near(frame.orientation_out(frame.orientation_in(quaternion)), quaternion));
        }
    }
}
