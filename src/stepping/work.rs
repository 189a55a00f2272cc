//! What a tick costs, counted before it runs.
//!
//! One unit is one element evaluation. The other weights are costs relative to it as the benchmarks measure them; the
//! governor turns units into time.

use crate::model::ActiveMesh;
use crate::model::element_pool::CLASSES;
use crate::model::step_class::TICK_CLASS;

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

/// Units of work of the tick after `ticks` completed ones.
pub fn of_tick(mesh: &ActiveMesh, ticks: u64) -> u32 {
    let next = ticks + 1;
    (0..CLASSES)
        .map(|class| {
            let work = event(mesh, mesh.pool().count(class) as u32);
            if class >= TICK_CLASS {
                work << (class - TICK_CLASS)
            } else {
                // Long steps are due in the middle of their windows.
                let window = 1 << (TICK_CLASS - class);
                if next % window == window / 2 { work } else { 0 }
            }
        })
        .sum()
}

/// Units of work of the costliest tick to come, as long as nothing changes.
pub fn worst_tick(mesh: &ActiveMesh) -> u32 {
    let short: u32 =
        (TICK_CLASS..CLASSES).map(|c| event(mesh, mesh.pool().count(c) as u32) << (c - TICK_CLASS)).sum();
    short + (0..TICK_CLASS).map(|c| event(mesh, mesh.pool().count(c) as u32)).max().unwrap_or(0)
}

/// Element evaluations of the tick after `ticks` completed ones.
pub fn evaluations(mesh: &ActiveMesh, ticks: u64) -> u32 {
    let next = ticks + 1;
    (0..CLASSES)
        .map(|class| {
            let count = mesh.pool().count(class) as u32;
            if class >= TICK_CLASS {
                count << (class - TICK_CLASS)
            } else {
                let window = 1 << (TICK_CLASS - class);
                if next % window == window / 2 { count } else { 0 }
            }
        })
        .sum()
}
