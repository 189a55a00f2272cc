//! From multipliers to the wrench on the tool.

use super::tool::ToolState;
use crate::ids::ToolId;
use crate::math::{Pose, Real, Vec3};
use crate::model::Constraint;

/// Force [N] and torque about a tool's reference point [N·m].
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Wrench {
    /// Force [N].
    pub force: Vec3,
    /// Torque [N·m].
    pub torque: Vec3,
}

/// What `constraints` put on tool `tool`: minus the sum of the mean multipliers and of their moments about the
/// reference point, and how many of them push.
///
/// What acts along the surface does so at the `surface_points` of the body, and what pushes at the constraint's arm, along the normal
/// from the tool's axis: a frictionless ball feels no torque about its centre.
pub fn wrench_on(tool: ToolId, middle: &Pose, constraints: &[Constraint], surface_points: &[Vec3]) -> (Wrench, u32) {
    let mut sum = Wrench::default();
    let mut pushing = 0;
    for (c, point) in constraints.iter().zip(surface_points) {
        if c.tool != tool || c.mean_multiplier <= 0.0 {
            continue;
        }
        let on_tool = -c.normal * c.mean_multiplier - c.friction.mean_multiplier;
        sum.force += on_tool;
        let arm = point - middle.position;
        sum.torque += arm.cross(&on_tool) + (arm - c.arm).cross(&c.normal) * c.mean_multiplier;
        pushing += 1;
    }
    (sum, pushing)
}

/// The pose in the middle of the last tick: where contacts are found and moments taken.
pub fn middle_pose(tool: &ToolState) -> Pose {
    tool.previous.towards(&tool.pose, 0.5 as Real)
}
