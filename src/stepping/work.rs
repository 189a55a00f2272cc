//! What a tick costs, counted before it runs.
//!
//! One unit is one element evaluation. The other weights are costs relative to it as the benchmarks measure them; the
//! governor turns units into time.

use crate::model::ActiveMesh;
use crate::model::element_pool::CLASSES;

/// An entry of an interface row, placed and handed back once, in 1/16 units.
const ROW_ENTRY: u32 = 4;
/// A node, moved and kicked once, in 1/16 units.
const NODE: u32 = 4;

/// Work of one event in which `elements` of a class are due [units]; all nodes and interface rows may be concerned.
fn event(mesh: &ActiveMesh, elements: u32) -> u32 {
    if elements == 0 {
        return 0;
    }
    // A class concerns at most four nodes per element.
    let part = |all: u32| all.min(4 * elements);
    elements + (part(mesh.active().len() as u32) * NODE + part(mesh.row_entries()) * ROW_ENTRY) / 16
}

/// Units of work of a tick.
pub fn of_tick(mesh: &ActiveMesh) -> u32 {
    (0..CLASSES).map(|c| event(mesh, mesh.pool().count(c) as u32) << c).sum()
}

/// Element evaluations of a tick.
pub fn evaluations(mesh: &ActiveMesh) -> u32 {
    (0..CLASSES).map(|c| (mesh.pool().count(c) as u32) << c).sum()
}
