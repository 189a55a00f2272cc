//! What a body does that takes more than a tick affords: it stands still until it has shed the least valuable regions.
//!
//! Each tick merges as much as it affords. Where many will have to, what that puts out of balance is not weighed around each
//! batch but over the whole body, before the first and after the last, as much in each tick as that affords. So no tick
//! takes more than its budget, however much is to go.

use super::{Adapted, Look, Means, Pay, Workspace, plan_merges};
use crate::math::Real;
use crate::model::ActiveMesh;
use crate::model::active_mesh::Loads;
use crate::model::state::Shedding;
use crate::stepping::work;

/// Nodes whose families are looked at in a tick. They are taken from all over the body, so that the least valuable of them are
/// nearly the least valuable of all.
const LOOKED_AT: usize = 96;
/// Part of what is for motion, one in this many, that is left free where little is shed.
const ROOM: u32 = 16;

/// Sheds some of what is too much: the body's motion takes `load` units, and is to take `full`.
pub(super) fn shed(
    look: &Look,
    mesh: &mut ActiveMesh,
    (means, loads, eases): (&Means, &Loads, bool),
    (load, full): (u32, u32),
    ticks: u64,
    work: &mut Workspace,
) -> Adapted {
    let body = look.body;
    let stands = |work| Adapted { work, saving: true, ..Adapted::default() };
    let (weighable, units) = work::of_weighing(means.budget);
    let parts = mesh.active().len().div_ceil(LOOKED_AT);
    match mesh.shedding() {
        Shedding::Holds(_) => {
            mesh.hold(body, loads, weighable);
            return stands(units);
        }
        Shedding::Coarsens(idle) if load > full && (idle as usize) < parts => {}
        Shedding::LetsGo(_) | Shedding::Coarsens(_) => {
            mesh.let_go(body, loads, weighable);
            return Adapted { saving: mesh.is_held(), ..stands(units) };
        }
        Shedding::No | Shedding::Resumes(_) => {}
    }
    let some = mesh.active().iter().skip(ticks as usize % parts).step_by(parts);
    look.spare_families(mesh, some, Real::INFINITY, &mut work.spare);
    let apart = eases && !mesh.is_held();
    // One that is dearer than what a tick has is saved up for.
    let mut pay = Pay { one: means.allowed, several: means.budget, eases: apart, taken: 0, refused: 0 };
    // A body that takes a little too much moves again as soon as it fits.
    let excess = load.saturating_sub(if mesh.is_held() { full } else { full.max(means.motion - means.motion / ROOM) });
    let saved = plan_merges(body, mesh, &mut pay, excess, 0.0, work);
    if work.changes.is_empty() && (pay.refused > 0 || !mesh.is_held()) {
        return Adapted { saving: pay.refused > 0, ..Adapted::default() };
    }
    if mesh.is_held() {
        let upkeep = mesh.coarsen(body, &work.changes);
        return if work.changes.is_empty() {
            stands(0)
        } else {
            Adapted { saving: true, ..Adapted::of(mesh, &work.changes, &upkeep) }
        };
    }
    let upkeep = if apart {
        let (eased, batches) = (mesh.foresee(body, &work.changes, true).eased, excess / saved.max(1));
        if eased.saturating_mul(batches) > 2 * mesh.pool().len() as u32 {
            mesh.hold(body, loads, weighable);
            return stands(units);
        }
        mesh.apply_under(body, &work.changes, loads)
    } else {
        mesh.apply(body, &work.changes)
    };
    Adapted::of(mesh, &work.changes, &upkeep)
}
