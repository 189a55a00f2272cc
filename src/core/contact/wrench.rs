//! From multipliers to the wrench on the tool.

pub use super::tool::Wrench;
use crate::ids::ToolId;
use crate::math::{Pose, Vec3};
use crate::model::Constraint;

/// What `constraints` put on tool `tool`: minus the sum of the mean multipliers, of their moments about the
/// reference point and of those that open its jaws, and how many of them push.
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
        sum.grip += c.lever.dot(&on_tool);
        sum.torque += arm.cross(&on_tool) + (arm - c.arm).cross(&c.normal) * c.mean_multiplier;
        pushing += 1;
    }
    (sum, pushing)
}
