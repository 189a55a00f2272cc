//! What is remembered of a contact point after the solve: its multipliers, and where it sticks to the tool.

use super::jaws::Stance;
use super::shape::Shape;
use super::tool::ToolState;
use crate::math::{Real, Vec3};
use crate::model::constraint::PointMemory;
use crate::model::step_class::TICK;
use crate::model::{ActiveMesh, Constraint};

/// Part of μ λ from which on a point slips.
pub(super) const SLIPS: Real = 1.0 - 1e-9;

/// A tool's part of a solve.
#[derive(Clone, Copy, Debug)]
pub struct Solved<'a> {
    /// The tool's own constraints.
    pub constraints: &'a [Constraint],
    /// Where the solve took the tool to be.
    pub at: Stance,
    /// Convex parts of the tool; nothing of the ground.
    pub shape: Option<&'a Shape>,
    /// [`Constraint::point`] of one part less than that of the next.
    pub per_part: u32,
    /// The body has moved by a tick and not stood still.
    pub moved: bool,
}

/// Writes what was `solved` into `points`, one for each of the tool's constraints.
///
/// A point that slips takes its anchor along, so that nothing but the force on the edge of Coulomb's disc is left to
/// hold it; one that sticks keeps its anchor for ever.
pub fn remember(mesh: &ActiveMesh, solved: &Solved, tool: &ToolState, points: &mut [PointMemory]) {
    let Solved { constraints, at, shape, per_part, moved } = *solved;
    // The tool's frame as the part of a point has it.
    let carrier = |stance: &Stance, point: u32| {
        let part = shape.and_then(|shape| shape.parts().get((point / per_part) as usize));
        part.map_or(stance.pose, |part| stance.of_part(part))
    };
    for (c, point) in constraints.iter().zip(points) {
        debug_assert_eq!(c.point, point.point);
        point.multiplier = c.multiplier;
        // A compliance is to those from its first on.
        let sharing = &constraints[(c.first - constraints[0].first) as usize..];
        point.dent = c.dent(sharing);
        point.place = c.row.interpolate(&mesh.motion.position);
        if !moved {
            // The tool went on alone, there or back, and what is displayed faded: within the next tick, that would be a blow.
            let away = c.normal.dot(&point.place) + point.dent - c.offset;
            point.shift += c.rate * TICK - if c.multiplier > 0.0 { away } else { 0.0 };
        }
        if c.friction.coefficient == 0.0 {
            continue;
        }
        point.tangential = c.friction.multiplier;
        if moved && c.friction.multiplier.norm() >= SLIPS * c.friction.coefficient * c.multiplier {
            let sheared = |(other, g): (&Constraint, &Real)| other.friction.multiplier * (g * c.friction.compliance);
            let shear: Vec3 = sharing.iter().zip(&c.compliance).map(sheared).sum();
            let geomorph =
                c.friction.anchor + c.friction.rate * TICK - carrier(&at, point.point).to_world(point.anchor);
            point.anchor = carrier(&tool.stance(), point.point).to_own(point.place + shear - geomorph);
        }
    }
}
