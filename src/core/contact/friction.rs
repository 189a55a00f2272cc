//! What is remembered of a contact point after the solve: its multipliers, and where it sticks to the tool.

use super::dent::measure;
use super::tool::ToolState;
use crate::math::{Pose, Real, Vec3};
use crate::model::constraint::PointMemory;
use crate::model::step_class::TICK;
use crate::model::{ActiveMesh, Constraint};

/// Part of μ λ from which on a point slips.
const SLIPS: Real = 1.0 - 1e-9;

/// Writes what the solve of `constraints`, the tool's own, has found into `points`, one for each; `per_part` are the numbers
/// that a part of the tool takes. The solve took the tool at `solved_at`; `moved` says that the body has moved by a tick and
/// not stood still.
///
/// A point that slips takes its anchor along, so that nothing but the force on the edge of Coulomb's disc is left to
/// hold it; one that sticks keeps its anchor for ever.
pub fn remember(
    mesh: &ActiveMesh,
    (constraints, per_part): (&[Constraint], u32),
    solved_at: &Pose,
    tool: &ToolState,
    points: &mut [PointMemory],
    moved: bool,
) {
    measure(constraints, points, per_part);
    for (c, point) in constraints.iter().zip(points) {
        debug_assert_eq!(c.point, point.point);
        point.multiplier = c.multiplier;
        point.dent = c.dent(constraints, 0.0).0;
        if !moved {
            // The tool went on alone, there or back, and what is displayed faded: within the next tick, that would be a blow.
            let away = c.normal.dot(&c.row.interpolate(&mesh.motion.position)) + point.dent - c.offset;
            point.shift += c.rate * TICK - if c.multiplier > 0.0 { away } else { 0.0 };
        }
        if c.friction.coefficient == 0.0 {
            continue;
        }
        point.tangential = c.friction.multiplier;
        if moved && c.friction.multiplier.norm() >= SLIPS * c.friction.coefficient * c.multiplier {
            let sheared = |(other, g): (&Constraint, &Real)| other.friction.multiplier * (g * c.friction.compliance);
            let shear: Vec3 = constraints.iter().zip(&c.compliance).map(sheared).sum();
            let fade = c.friction.anchor + c.friction.rate * TICK - solved_at.to_world(point.anchor);
            point.anchor = tool.pose.to_own(c.row.interpolate(&mesh.motion.position) + shear - fade);
        }
    }
}
