//! What a tool feels: the wrench of one tick, checked and in plain arrays.

use palpate_proto::{ToolPhase, ToolWrench};

use crate::ClientError;

/// Encoded size of a wrench in contact, of a tool with jaws [bytes]: a bare round trip of this many bytes is what the network alone costs.
pub const WRENCH_BYTES: usize = 232;

/// One `ToolWrench` of the contract. Forces act on the tool, in the world frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Wrench {
    /// +1 per wrench of this tool.
    pub sequence: u64,
    /// Simulated time [ms].
    pub tick: u64,
    /// The newest pose this wrench answers; 0 before the first.
    pub pose_sequence: u32,
    /// That pose's time [ns] on this client's clock, the one that was sent with it.
    pub pose_time_ns: u64,
    /// Ticks since that pose reached the server.
    pub pose_age_ticks: u32,
    /// (3) [m] of the simulated tool.
    pub position: [f64; 3],
    /// (4) unit quaternion x, y, z, w of the simulated tool.
    pub orientation: [f64; 4],
    /// (3) [N] as the contact gives it.
    pub physical_force: [f64; 3],
    /// (3) [N·m] about the tool's reference point, as the contact gives it.
    pub physical_torque: [f64; 3],
    /// (3) [N] after clamp, slew limit and ramp: the one to feel.
    pub force: [f64; 3],
    /// (3) [N·m] after clamp, slew limit and ramp: the one to feel.
    pub torque: [f64; 3],
    /// Of the jaws of the simulated tool: 0, closed, to 1.
    pub opening: f64,
    /// What opens the jaws [N·m], for the angle between them, after clamp, slew limit and ramp.
    pub grip_torque: f64,
    /// Contacts that carry force; 0 means free.
    pub contact_points: u32,
    /// Where the tool stands in its life.
    pub phase: ToolPhase,
    /// Bits of `WrenchFlag`.
    pub flags: u32,
    /// What the force will be nearby; `None` where the server does not say.
    pub model: Option<LocalModel>,
}

/// The force near the pose that a wrench answers: `F(x) = force − K (x − position)` for a tool held at `x`, no farther
/// than `range` from there, and zero where that would pull (`normal · F < 0`).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LocalModel {
    /// (3) [m] of the handle: the client's own pose, smoothed, that `force` answers.
    pub position: [f64; 3],
    /// (3) [N] there; short of contact it points into the body.
    pub force: [f64; 3],
    /// (3) unit, out of the body; zero where nothing is near.
    pub normal: [f64; 3],
    /// (3, 3) [N/m] K: symmetric, without negative eigenvalues, relaxed.
    pub stiffness: [[f64; 3]; 3],
    /// How far from `position` it holds [m].
    pub range: f64,
}

impl TryFrom<&ToolWrench> for Wrench {
    type Error = ClientError;

    /// Checks lengths and the phase; numbers are taken as they are, finite or not.
    fn try_from(message: &ToolWrench) -> Result<Self, ClientError> {
        Ok(Wrench {
            sequence: message.sequence,
            tick: message.tick,
            pose_sequence: message.pose_sequence,
            pose_time_ns: message.pose_time_ns,
            pose_age_ticks: message.pose_age_ticks,
            position: array("position", &message.position)?,
            orientation: array("orientation", &message.orientation)?,
            physical_force: array("physical_force", &message.physical_force)?,
            physical_torque: array("physical_torque", &message.physical_torque)?,
            force: array("force", &message.force)?,
            torque: array("torque", &message.torque)?,
            opening: message.opening.into(),
            grip_torque: message.grip_torque.into(),
            contact_points: message.contact_points,
            phase: ToolPhase::try_from(message.phase)
                .map_err(|_| undecodable(format!("{} is no phase", message.phase)))?,
            flags: message.flags,
            model: (message.model_range > 0.0).then(|| model(message)).transpose()?,
        })
    }
}

fn model(message: &ToolWrench) -> Result<LocalModel, ClientError> {
    let [xx, yy, zz, yz, zx, xy] = array("model_stiffness", &message.model_stiffness)?;
    Ok(LocalModel {
        position: array("model_position", &message.model_position)?,
        force: array("model_force", &message.model_force)?,
        normal: array("model_normal", &message.model_normal)?,
        stiffness: [[xx, xy, zx], [xy, yy, yz], [zx, yz, zz]],
        range: f64::from(message.model_range),
    })
}

/// `values` as an array of `N`; errors with the field's name when the length differs.
fn array<const N: usize>(field: &str, values: &[f32]) -> Result<[f64; N], ClientError> {
    let values: [f32; N] =
        values.try_into().map_err(|_| undecodable(format!("{field} has {} numbers, not {N}", values.len())))?;
    Ok(values.map(f64::from))
}

fn undecodable(reason: String) -> ClientError {
    ClientError::Undecodable { message: "ToolWrench", reason }
}

#[cfg(test)]
mod tests {
    use palpate_proto::Message;

    use super::*;

    fn wrench_in_contact() -> ToolWrench {
        ToolWrench {
            tool: 1,
            epoch: 7,
            sequence: 3,
            tick: 1003,
            pose_sequence: 2,
            pose_time_ns: 5,
            pose_age_ticks: 1,
            position: vec![0.01, 0.02, 0.03],
            orientation: vec![0.0, 0.0, 0.0, 1.0],
            physical_force: vec![0.0, 0.0, 4.0],
            physical_torque: vec![0.0; 3],
            force: vec![0.0, 0.0, 3.3],
            torque: vec![0.0; 3],
            contact_points: 6,
            phase: ToolPhase::Engaged as i32,
            flags: 1,
            model_position: vec![0.01, 0.02, 0.031],
            model_force: vec![0.0, 0.0, 3.3],
            model_normal: vec![0.0, 0.0, 1.0],
            model_stiffness: vec![200.0, 200.0, 400.0, 0.0, 0.0, 1.0],
            model_range: 0.005,
            opening: 0.5,
            grip_torque: 0.02,
        }
    }

    #[test]
    fn a_wrench_keeps_every_number_of_its_message() {
        let wrench = Wrench::try_from(&wrench_in_contact()).unwrap();
        assert_eq!(wrench.force, [0.0, 0.0, f64::from(3.3f32)]);
        assert_eq!(wrench.physical_force[2], 4.0);
        assert_eq!((wrench.sequence, wrench.pose_sequence, wrench.pose_time_ns), (3, 2, 5));
        assert_eq!((wrench.phase, wrench.contact_points, wrench.flags), (ToolPhase::Engaged, 6, 1));
        assert_eq!((wrench.opening, wrench.grip_torque), (0.5, f64::from(0.02f32)));
    }

    #[test]
    fn a_wrench_of_wrong_shape_is_refused_by_field_name() {
        let short = ToolWrench { force: vec![1.0], ..wrench_in_contact() };
        assert_eq!(
            Wrench::try_from(&short).unwrap_err().to_string(),
            "undecodable ToolWrench: force has 1 numbers, not 3"
        );
        let unknown = ToolWrench { phase: 9, ..wrench_in_contact() };
        assert!(Wrench::try_from(&unknown).is_err());
    }

    #[test]
    fn the_echo_payload_is_as_long_as_a_wrench() {
        assert_eq!(wrench_in_contact().encoded_len(), WRENCH_BYTES);
    }
}
