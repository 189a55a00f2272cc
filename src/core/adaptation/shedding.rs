//! What a body does whose motion takes more than ticks are planned to take: it merges its least valuable regions, as many in
//! a tick as that has time for beside the motion. Where there is no time for any it stands still for that tick, and all of the
//! tick's time is for merging. Where not even that is enough for any, the cheapest is merged in the tick that moves whatever it
//! takes.

use super::{INDICATOR_LOOKS, Look, Pay, Workspace, plan_merges};
use crate::math::Real;
use crate::model::ActiveMesh;
use crate::stepping::work::Prices;

/// Nodes whose families are looked at in a tick. They are taken from all over the body, so that the least valuable of them are
/// nearly the least valuable of all.
const LOOKED_AT: usize = 96;
/// Merges that take more than the tick has left, after which no others are looked at.
const MOST_REFUSED: u32 = 8;

/// As many elements as a look at [`LOOKED_AT`] nodes costs: other looks, which are priced by all elements in use, take a
/// slice of the nodes.
pub(super) fn looked(mesh: &ActiveMesh) -> u32 {
    let (elements, nodes) = (mesh.pool().len(), mesh.active().len().max(1));
    (elements * LOOKED_AT * INDICATOR_LOOKS as usize / nodes).min(elements) as u32
}

/// Plans merges that save about `excess` [ns] a tick, and take no more change units than a tick has left `beside` the motion,
/// or else no more than one has left in which the body is `standing`, if it may. A tick that `moves` whatever it takes makes
/// the cheapest where none of these fits.
pub(super) fn plan(
    look: &Look,
    mesh: &mut ActiveMesh,
    (beside, standing, moves, eases): (u32, Option<u32>, bool, bool),
    (excess, prices): (u32, &Prices),
    ticks: u64,
    work: &mut Workspace,
) {
    let parts = mesh.active().len().div_ceil(LOOKED_AT);
    let some = mesh.active().iter().skip(ticks as usize % parts).step_by(parts);
    look.spare_families(mesh, some, Real::INFINITY, &mut work.spare);
    let mut plan = |left: u32, work: &mut Workspace| {
        let mut pay = Pay::new([left, left], eases, MOST_REFUSED);
        plan_merges(look, mesh, &mut pay, (excess, 0.0, prices), work);
        pay.cheapest
    };
    plan(beside, work);
    let Some(standing) = standing.filter(|_| work.changes.is_empty()) else { return };
    let cheapest = plan(standing, work);
    if moves {
        // What fits a tick that stands still waits for the next.
        let fits = !work.changes.is_empty();
        work.changes.clear();
        work.changes.extend(cheapest.filter(|_| !fits).map(|(_, change)| change));
    }
}
