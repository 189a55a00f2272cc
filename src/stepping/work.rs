//! What a tick costs, counted before it runs.
//!
//! One unit is one element evaluation. The other weights are costs relative to it as the benchmarks measure them; the
//! governor turns units into time.

use crate::model::active_mesh::Upkeep;
use crate::model::element_pool::CLASSES;
use crate::model::step_class;
use crate::model::{ActiveMesh, Body};

/// An entry of an interface row, placed and handed back once, in 1/16 units.
const ROW_ENTRY: u32 = 4;
/// A node, moved and kicked once, in 1/16 units.
const NODE: u32 = 4;

/// Units of looking for contacts near the surface, and of holding one point for a tick.
const CONTACT: u32 = 1_000;
const POINT: u32 = 150;
/// Units per element put in or taken out.
const ELEMENT_UPKEEP: u32 = 40;
/// Units of weighing the forces of one element, as is done before and after changes under a load.
const EASE_UPKEEP: u32 = 10;
/// Elements that are weighed at once at least.
const LEAST_WEIGHED: u32 = 64;
/// Units per interface row made.
const ROW_UPKEEP: u32 = 40;
/// Units of one change in a batch, for plans.
pub const CHANGE_UPKEEP: u32 = 3_500;
/// Units of weighing the forces of one change under a load, for plans.
pub const EASED_CHANGE: u32 = 3_500;

/// Work of one event in which `elements` of a class are due [units]; all nodes and interface rows may be concerned.
fn event(mesh: &ActiveMesh, elements: u32) -> u32 {
    if elements == 0 {
        return 0;
    }
    // A class concerns at most four nodes per element.
    let part = |all: u32| all.min(4 * elements);
    elements + (part(mesh.active().len() as u32) * NODE + part(mesh.row_entries()) * ROW_ENTRY) / 16
}

/// Units of work of a tick in which `contacts` points are held.
pub fn of_tick(mesh: &ActiveMesh, contacts: usize) -> u32 {
    let elements: u32 = (0..CLASSES).map(|c| event(mesh, mesh.pool().count(c) as u32) << c).sum();
    elements + if contacts > 0 { CONTACT + POINT * contacts as u32 } else { 0 }
}

/// Element evaluations of a tick.
pub fn evaluations(mesh: &ActiveMesh) -> u32 {
    (0..CLASSES).map(|c| (mesh.pool().count(c) as u32) << c).sum()
}

/// Units that the body's motion may take of the `budget` of a tick: the rest of it is there for changes of resolution.
pub fn for_motion(budget: u32) -> u32 {
    budget - budget / 4
}

/// Elements that `units` are enough to weigh the forces of, some in any case, and the units that it takes to weigh so many.
pub fn of_weighing(units: u32) -> (u32, u32) {
    let elements = (units / EASE_UPKEEP).max(LEAST_WEIGHED);
    (elements, elements * EASE_UPKEEP)
}

/// Units of a batch of changes of resolution of a body with `nodes` nodes in use, whatever is in it: momenta, masses and the
/// surface before and after.
fn of_any_batch(nodes: u32) -> u32 {
    1_000 + nodes
}

/// As [`of_batch`], of a batch with nothing in it.
pub fn of_empty_batch(mesh: &ActiveMesh) -> u32 {
    of_any_batch((mesh.active().len() + mesh.interface().len()) as u32)
}

/// Units of work of a batch of changes of resolution of `mesh`.
pub fn of_batch(mesh: &ActiveMesh, upkeep: &Upkeep) -> u32 {
    let each = upkeep.elements * ELEMENT_UPKEEP + upkeep.rows * ROW_UPKEEP + upkeep.eased * EASE_UPKEEP;
    of_empty_batch(mesh) + each
}

/// Units of work of a tick, at rest, in which only the coarsest level is used, with room for strains and for one change of
/// resolution: the budget that a body cannot do with less than.
pub fn floor(body: &Body) -> u32 {
    let elements: u32 = body.elements_of(0).map(|e| 1 << step_class::class_at_rest(body, e)).sum();
    let nodes = body.nodes_of(0).len() as u32;
    let motion = 2 * elements + nodes + CONTACT + 32 * POINT + of_any_batch(2 * nodes) + CHANGE_UPKEEP;
    motion + motion.div_ceil(3)
}
