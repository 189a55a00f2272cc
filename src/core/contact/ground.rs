//! Where the body lies on flat ground: point constraints, once per tick, one for each patch of the surface that is near.

use super::closing::Closing;
use super::detection::Workspace;
use super::rigid::Found;
use super::tool::{MOST_POINTS, ToolState};
use super::touchable::{FASTEST_SURFACE, MARGIN};
use crate::ids::{ToolId, Vertex};
use crate::math::{Real, Vec3};
use crate::model::active_mesh::skin;
use crate::model::constraint::{Constraint, Held, PointMemory, Pushed};
use crate::model::step_class::{TICK, step_of};
use crate::model::{ActiveMesh, Body, Friction};

/// Ground that a body may lie on.
#[derive(Clone, Copy, Debug)]
pub struct Ground<'a> {
    /// Its number, after those of the tools.
    pub id: ToolId,
    /// Coulomb's coefficient of friction.
    pub friction: Real,
    /// Where it is.
    pub state: &'a ToolState,
}

/// Appends the constraints of `ground` on the body at the start of a tick to `out`; `memory` holds its points of the last tick,
/// ascending, and receives this tick's.
///
/// A patch meets ground with its mean place, and gives way as the mesh does under its load: of an even pressure nothing is left
/// below the mesh's size.
pub fn lie(
    body: &Body,
    mesh: &ActiveMesh,
    ground: &Ground,
    memory: &mut Vec<PointMemory>,
    out: Found,
    work: &mut Workspace,
) {
    let (Ground { id, friction, state }, Found { constraints, points_of_action }) = (*ground, out);
    std::mem::swap(memory, &mut work.memory);
    memory.clear();
    let before = &work.memory;
    let normal = state.pose.rotate(Vec3::z());
    let (start, end) = (normal.dot(&state.previous.position), normal.dot(&state.pose.position));
    let moved = end - start;
    let margin = MARGIN.max(moved.abs() + FASTEST_SURFACE * TICK);
    for i in 0..body.patches().count() {
        let patch = body.patches().of(i);
        let place: Vec3 = patch.iter().map(|(v, w)| mesh.vertex(*v) * *w).sum();
        let overlap = start - normal.dot(&place);
        if overlap < -margin {
            continue;
        }
        let point = body.point_of_patch(i);
        let known = before.binary_search_by_key(&point, |m| m.point).ok().map(|k| &before[k]);
        let shift = known.map_or(0.0, |m| m.shift);
        let closing = Closing::new(known.map(|m| m.slack), overlap - shift, shift, moved, false);
        let (anchor, tangential) = match known.filter(|_| friction > 0.0) {
            Some(m) => (m.anchor, m.tangential - normal * normal.dot(&m.tangential)),
            None => (state.previous.to_own(place), Vec3::zeros()),
        };
        let anchored = (state.previous.to_world(anchor), state.pose.to_world(anchor));
        let (row, geomorph) = skin::row(mesh, patch);
        let mobility: Real = row.entries().iter().map(|(s, b)| b * b * mesh.motion.inverse_mass[s.index()]).sum();
        // Of the elements that carry it, the one that is kicked the least often.
        let kicked = |(v, _): &(Vertex, Real)| mesh.pool().class_of(mesh.embedding(*v).element);
        let horizon = patch.iter().filter_map(kicked).map(step_of).fold(0.0, Real::max);
        // As much as its inertia gives way within a step: many patches hang on few nodes of a coarse level, and of all ways to
        // share their load none would be the right one.
        let mut compliance = [0.0; MOST_POINTS];
        compliance[0] = horizon * horizon * mobility;
        constraints.push(Constraint {
            row,
            normal,
            offset: start - normal.dot(&geomorph) - closing.slack - shift,
            rate: (moved + closing.slack - closing.slack_end + shift - closing.shift_end) / TICK,
            first: constraints.len() as u32,
            compliance,
            tool: id,
            point,
            multiplier: known.map_or(0.0, |m| m.multiplier),
            mean_multiplier: 0.0,
            friction: Friction {
                coefficient: friction,
                compliance: 1.0,
                anchor: anchored.0 - geomorph,
                rate: (anchored.1 - anchored.0) / TICK,
                multiplier: tangential,
                mean_multiplier: Vec3::zeros(),
            },
            arm: place - state.middle().pose.position,
            lever: Vec3::zeros(),
            held: Held { coupling: state.coupling, ..Held::default() },
            allowed_for: Pushed::default(),
            horizon,
        });
        points_of_action.push(place);
        memory.push(PointMemory {
            point,
            slack: closing.slack_end,
            shift: closing.shift_end,
            normal,
            tangential,
            anchor,
            ..PointMemory::default()
        });
    }
}
