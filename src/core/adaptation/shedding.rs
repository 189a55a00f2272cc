//! What a body does whose motion takes more than ticks are planned to take: it merges its least valuable regions, as many in
//! a tick as that has time for beside the motion. Where there is no time for any it stands still for that tick, and all of the
//! tick's time is for merging. Where not even that is enough for any, the cheapest is merged in the tick that moves whatever it
//! takes.

use super::change_budget::ChangeBudget;
use super::priority::Priorities;
use super::{INDICATOR_LOOKS, MOST_FROZEN, Saving, Workspace, plan_merges};
use crate::math::Real;
use crate::model::ActiveMesh;

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

/// What a tick has left for merges.
#[derive(Clone, Copy, Debug)]
pub(super) struct Left {
    /// Change units beside the motion.
    pub(super) beside: u32,
    /// Change units of a tick in which the body stands still; `None` where it need not.
    pub(super) standing: Option<u32>,
    /// The body moves in this tick, whatever that takes.
    pub(super) moves: bool,
    /// Out-of-balance forces of changes decay as residuals: a tool presses.
    pub(super) residuals: bool,
    /// Time that the merges are to save [ns] a tick, about.
    pub(super) excess: u32,
}

/// Plans merges that save the excess, as many as fit beside the motion, or else as many as fit a tick in which
/// the body stands still. A tick that moves whatever it takes makes the cheapest where none fits either.
///
/// Change units that are left beside the merges: enough to weigh the loads near them, where merges fit beside that.
pub(super) fn plan(
    priorities: &Priorities,
    mesh: &mut ActiveMesh,
    left: Left,
    ticks: u64,
    work: &mut Workspace,
) -> u32 {
    let parts = mesh.active().len().div_ceil(LOOKED_AT);
    // Ticks that have to move come after so many that stand still, and each sees the next part, too.
    let turn = if left.moves { ticks / u64::from(MOST_FROZEN + 1) } else { ticks };
    let some = mesh.active().iter().skip(turn as usize % parts).step_by(parts);
    priorities.merge_candidates(mesh, some, Real::INFINITY, &mut work.merge_candidates);
    let mut with = |units: u32, weighs: bool, work: &mut Workspace| {
        let mut budget_left = ChangeBudget::new([units, units], left.residuals, MOST_REFUSED);
        budget_left.weighs = weighs;
        plan_merges(priorities, mesh, &mut budget_left, Saving { excess: left.excess, below: 0.0 }, work);
        (budget_left.spare(), budget_left.cheapest)
    };
    let mut plan = |units: u32, work: &mut Workspace| {
        let exact = with(units, left.residuals, work);
        if work.changes.is_empty() && left.residuals { with(units, false, work) } else { exact }
    };
    let (spare, _) = plan(left.beside, work);
    let Some(standing) = left.standing.filter(|_| work.changes.is_empty()) else { return spare };
    let (spare, cheapest) = plan(standing, work);
    if left.moves {
        // What fits a tick that stands still waits for the next.
        let fits = !work.changes.is_empty();
        work.changes.clear();
        work.changes.extend(cheapest.filter(|_| !fits).map(|(_, change)| change));
        return 0;
    }
    spare
}
