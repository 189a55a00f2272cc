//! What a body does whose motion takes more than ticks are planned to take: it merges its least valuable regions, as many in
//! a tick as that has time for beside the motion. Where there is no time for any, the cheapest is merged all the same, and the
//! body stands still for that tick; where the motion alone does not fit, all of the tick's time is for merging.

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

/// Plans merges that take at most `left` change units and save about `excess` [ns] a tick; at least one where there `must` be
/// one: a body that takes too much is coarsened whatever that takes.
pub(super) fn plan(
    look: &Look,
    mesh: &mut ActiveMesh,
    (left, eases, must): (u32, bool, bool),
    (excess, prices): (u32, &Prices),
    ticks: u64,
    work: &mut Workspace,
) {
    let parts = mesh.active().len().div_ceil(LOOKED_AT);
    let some = mesh.active().iter().skip(ticks as usize % parts).step_by(parts);
    look.spare_families(mesh, some, Real::INFINITY, &mut work.spare);
    let mut pay = Pay::new([left, left], eases, MOST_REFUSED);
    plan_merges(look, mesh, &mut pay, (excess, 0.0, prices), work);
    if let Some((_, change)) = pay.cheapest.filter(|_| must && work.changes.is_empty()) {
        work.changes.push(change);
    }
}
