//! Where a tool is held.

use palpate_proto::ToolPose;

use crate::ClientError;

/// Where the tool is held, as the device measures it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PoseSample {
    /// (3) [m] of the tool's reference point, in the world frame.
    pub position: [f64; 3],
    /// (4) unit quaternion x, y, z, w.
    pub orientation: [f64; 4],
    /// (3) [m/s], for the [`Renderer`](crate::Renderer) beside the device: it is not sent. `None` where the device does not
    /// measure it.
    pub linear_velocity: Option<[f64; 3]>,
    /// Bit i = button i held.
    pub buttons: u32,
    /// How far the tool's jaws are to be open: 0, closed, to 1. A tool without jaws takes no notice.
    pub opening: f64,
}

impl PoseSample {
    /// True when every number is finite.
    pub(crate) fn is_finite(&self) -> bool {
        let velocity = self.linear_velocity.iter().flatten();
        self.position
            .iter()
            .chain(&self.orientation)
            .chain(velocity)
            .chain([&self.opening])
            .all(|number| number.is_finite())
    }

    /// The message of this pose, which was taken at `time_ns` [ns]; `sequence` counts the samples of `epoch` from 1, and
    /// `secret` came with the epoch.
    ///
    /// Errors: [`ClientError::PoseNotFinite`] when a number is not finite as f32.
    pub fn message(&self, epoch: u32, secret: u64, sequence: u32, time_ns: u64) -> Result<ToolPose, ClientError> {
        Ok(ToolPose {
            epoch,
            secret,
            sequence,
            time_ns,
            position: finite(&self.position)?,
            orientation: finite(&self.orientation)?,
            buttons: self.buttons,
            opening: finite(&[self.opening])?[0],
        })
    }
}

fn finite(values: &[f64]) -> Result<Vec<f32>, ClientError> {
    let values: Vec<f32> = values.iter().map(|&value| value as f32).collect();
    if values.iter().all(|value| value.is_finite()) { Ok(values) } else { Err(ClientError::PoseNotFinite) }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn pose() -> PoseSample {
        PoseSample {
            position: [0.1, 0.2, 0.3],
            orientation: [0.0, 0.0, 0.0, 1.0],
            linear_velocity: Some([1.0, 2.0, 3.0]),
            buttons: 5,
            opening: 0.25,
        }
    }

    #[test]
    fn a_pose_keeps_every_number_that_is_sent() {
        let message = pose().message(7, 8, 2, 99).unwrap();
        assert_eq!((message.epoch, message.sequence, message.time_ns, message.buttons), (7, 2, 99, 5));
        assert_eq!(message.position, [0.1f32, 0.2, 0.3]);
        assert_eq!(message.orientation, [0.0f32, 0.0, 0.0, 1.0]);
        assert_eq!(message.opening, 0.25);
    }

    #[test]
    fn a_pose_that_is_not_finite_as_f32_has_no_message() {
        for bad in [f64::NAN, f64::INFINITY, 1e60] {
            let pose = PoseSample { position: [0.0, bad, 0.0], ..pose() };
            assert_eq!(pose.message(1, 1, 1, 1), Err(ClientError::PoseNotFinite));
        }
    }
}
