//! When and where to refine and coarsen [DDCB01 3.3], within the work budget.
//!
//! Knows the body, its motion, what presses on it, and where tools are or will be, as an axis and a radius ([`Focus`]);
//! decides changes of resolution and has them made. It keeps nothing from tick to tick: what it decides follows from the
//! state, the budget and the tick.

mod change_budget;
pub mod indicator;
mod priority;
mod shedding;

use change_budget::ChangeBudget;
pub use priority::Focus;
use priority::{Priorities, TOUCHED, slice};

use crate::ids::{Element, Node};
use crate::math::Real;
use crate::model::active_mesh::{Loads, STAR_EVALUATIONS};
use crate::model::active_set::Change;
use crate::model::element_pool::CLASSES;
use crate::model::step_class::{self, Strained};
use crate::model::{ActiveMesh, Body};
use crate::stepping::work::{self, Budget, Laps, Part, Prices};

/// When to refine and to coarsen.
#[derive(Clone, Debug, PartialEq)]
pub struct Adaptivity {
    /// Nodes whose [`indicator::strain_jump`] is above it are split.
    pub split: Real,
    /// Families whose children are all below this part of `split` are merged.
    pub merge: Real,
    /// Nodes closer than this many spacings of their level to a tool, or to patches of organs that press each other, are split, and from
    /// farther where the material is heterogeneous.
    pub reach: Real,
    /// Finest level that is used.
    pub finest: usize,
}

impl Default for Adaptivity {
    fn default() -> Self {
        Self { split: 0.1, merge: 0.3, reach: 1.4, finest: usize::MAX }
    }
}

/// Ticks in a row in which a body may stand still: a force that keeps its value for longer feels like a stick.
pub const MOST_FROZEN: u32 = 5;
/// Most changes of one tick.
const MOST_CHANGES: usize = 64;
/// Ticks between two looks at where resolution is wanted, and the first of them: none ends a frame, or lies in the middle of
/// one. Splits come at every other look: a tool at 1 m/s comes 8 mm farther in between, less than it is refined ahead of it.
const LOOK_TICKS: u64 = 4;
const FIRST_LOOK: u64 = 2;
/// Looks for splits, and looks for merges, that a full look at the indicator takes: 32 ms. They take turns, or a body that is
/// always refined somewhere would never be coarsened. What is near tools is all looked at in each.
const INDICATOR_LOOKS: u64 = 4;
/// What is near a tool gives way to what has a priority higher by this much.
const PRIORITY_MARGIN: Real = 0.5;
/// Part of what a tick has left that several changes of resolution may take together, one in this many: what they take
/// together is less well known than what one takes.
const SEVERAL: u32 = 2;
/// Part of what the tools press with from which on a node is not settled. Split and merged in turns before it is, a family
/// would be strained more each time.
const UNSETTLED: Real = 0.02;
/// Changes that take more than a tick has left, after which no others are looked at.
const MOST_REFUSED: u32 = 2;
/// Contact points that room is kept for once a tool is there: a ball pressed in by half of its radius holds some thirty
/// vertices of a display that is four times as fine as it is wide.
pub const EXPECTED_CONTACTS: u32 = 32;
/// Part, in 1/16, of what a tick may take up to which refinement fills it; tuned. What is admitted must not be shed again as
/// soon as it is strained and takes shorter steps, or prices rise: with 15 a liver on a busy machine is refined and coarsened
/// in turns, with less fewer elements are used.
const ADMITTED: u32 = 12;
/// Part of that, in 1/16, up to which strain alone fills it: what a tool makes room for must not fill up again with
/// what it was taken from.
const STRAIN_FILLED: u32 = 13;
/// Part, in 1/16, of what a tick may take from which on what there is time for beside the motion is merged again; tuned, and
/// between [`ADMITTED`] and the whole, from which on there has to be time: with 16 bodies stand still to be coarsened.
const SHED: u32 = 14;

/// What was done in one tick.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Adapted {
    /// Nodes split.
    pub splits: u32,
    /// Families merged.
    pub merges: u32,
    /// Time that changing it took, by the prices [ns].
    pub work: u32,
    /// Elements that a look at where resolution is wanted is paid by, [`Part::Look`].
    pub looked: u32,
}

impl Adapted {
    /// `changes` of `mesh` that took `units`, at `prices`.
    fn of(changes: &[Change], units: u32, prices: &Prices) -> Self {
        let splits = changes.iter().filter(|c| matches!(c, Change::Split(_))).count() as u32;
        Self { splits, merges: changes.len() as u32 - splits, work: prices.of(Part::Change, units), looked: 0 }
    }
}

/// Memory that decisions need and no one keeps.
#[derive(Debug)]
pub struct Workspace {
    /// Value and node, best first.
    split_candidates: Vec<(Real, Node)>,
    /// Value and parent, least first.
    merge_candidates: Vec<(Real, Node)>,
    changes: Vec<Change>,
    /// Finest level that can be stepped and is allowed.
    finest: usize,
}

impl Workspace {
    /// For `body`.
    pub fn new(body: &Body, adaptivity: &Adaptivity) -> Self {
        Self {
            split_candidates: Vec::with_capacity(MOST_CHANGES + 1),
            // Families that may be merged: at most one for each coarser node.
            merge_candidates: Vec::with_capacity(body.node_count() - body.nodes_of(body.finest()).len()),
            changes: Vec::with_capacity(MOST_CHANGES),
            finest: adaptivity.finest.min(finest_steppable(body)),
        }
    }
}

/// Longest stable step [s] of all elements of level `r`, at rest.
pub fn step_of_level(body: &Body, r: usize) -> Real {
    let stiffest =
        body.elements_of(r).map(|e| step_class::omega_squared(body, body.material_of(e), e)).fold(0.0, Real::max);
    step_class::stable_step(stiffest, Strained::REST, body.damping_time(), 0.0)
}

/// The finest level that can be stepped: the core does not use finer ones. Level 0 is used whatever it needs.
pub fn finest_steppable(body: &Body) -> usize {
    let can = |r: usize| step_of_level(body, r) >= step_class::step_of(CLASSES - 1);
    (0..body.levels().len()).take_while(|r| *r == 0 || can(*r)).last().unwrap_or(0)
}

/// What may be spent.
#[derive(Clone, Copy, Debug)]
pub struct Allowance<'a> {
    /// Time of the tick.
    pub budget: Budget,
    /// What work costs.
    pub prices: &'a Prices,
    /// Time that finding the contact points takes [ns], as many as in the last tick.
    pub contact: u32,
    /// Contact points of the last tick.
    pub points: u32,
    /// Class of the steps by which they are held.
    pub class: usize,
    /// Time that finding [`EXPECTED_CONTACTS`] takes [ns] where a tool is near; else 0.
    pub expected: u32,
    /// The tick ends a frame, or lies in the middle of one, where the state may be copied.
    pub frame: bool,
    /// The body has stood still for as long as it may: it moves in this tick, whatever that takes.
    pub moves: bool,
}

impl Allowance<'_> {
    /// Time of a tick that moves `mesh` and ends no frame [ns]: with the contacts that are held, and with those expected.
    fn loads(&self, body: &Body, mesh: &ActiveMesh) -> (u32, u32) {
        let rest = work::of_rest(self.prices, false);
        let with = |points: u32, contact: u32| {
            let motion = work::of_motion(body, mesh, self.prices, points << self.class);
            motion.saturating_add(rest).saturating_add(contact)
        };
        let expected = self.points.max(EXPECTED_CONTACTS);
        (with(self.points, self.contact), if self.expected > 0 { with(expected, self.expected) } else { 0 })
    }
}

/// What decides about resolution.
#[derive(Clone, Copy, Debug)]
pub struct Request<'a> {
    /// When to refine and to coarsen.
    pub adaptivity: &'a Adaptivity,
    /// Where the tools are or will be.
    pub focus: &'a [Focus],
    /// Where organs press each other.
    pub met: &'a [Focus],
    /// What may be spent.
    pub allowance: Allowance<'a>,
    /// What acts on the body.
    pub loads: Loads<'a>,
    /// Completed ticks.
    pub ticks: u64,
}

/// Decides by `wishes` what to change, and has it done.
pub fn adapt(
    body: &Body,
    mesh: &mut ActiveMesh,
    request: &Request,
    work: &mut Workspace,
    laps: &mut dyn Laps,
) -> Adapted {
    let Request { adaptivity, focus, met, allowance, loads, ticks } = request;
    let ticks = *ticks;
    if work.finest == 0 {
        return Adapted::default();
    }
    work.split_candidates.clear();
    work.merge_candidates.clear();
    work.changes.clear();
    let (held, expected) = allowance.loads(body, mesh);
    let load = held.max(expected);
    let Budget { limit, planned, .. } = allowance.budget;
    // Under a tool, the out-of-balance force of a change decays as a residual.
    let pressed = loads.pressed();
    let residuals = pressed > 0.0;
    let mut spare;
    // Ticks that end a frame have to fit, too; there nothing is changed.
    let frame = work::of_frame(allowance.prices);
    let sheds =
        held > sixteenths(planned, SHED) || held.saturating_add(frame) > sixteenths(allowance.budget.frame, SHED);
    // Between what is planned for the end of a frame and what there is, few frames are late.
    let must = held > planned || held.saturating_add(frame) > limit;
    let looks =
        if sheds { !allowance.frame || held.saturating_add(frame) > limit } else { ticks % LOOK_TICKS == FIRST_LOOK };
    if !looks {
        return Adapted::default();
    }
    if residuals {
        mesh.note_loads(body, loads);
    }
    let settled = if residuals && !must { UNSETTLED * pressed } else { Real::INFINITY };
    let priorities = Priorities { body, adaptivity, focus, met, settled, prices: allowance.prices };
    // No refinement that a little strain, or a little more to pay for it, would make a load to be shed.
    let looked = if sheds { shedding::looked(mesh) } else { mesh.pool().len() as u32 };
    let looking = allowance.prices.of(Part::Look, looked);
    let full = sixteenths(allowance.budget.frame.saturating_sub(frame).min(planned.saturating_sub(looking)), ADMITTED);
    let now = held.saturating_add(looking).saturating_add(if allowance.frame { frame } else { 0 });
    let short = if sheds {
        let motion = work::of_motion(body, mesh, allowance.prices, allowance.points << allowance.class);
        let units = |most: u32, spent: u32| allowance.prices.count(Part::Change, most.saturating_sub(spent));
        let left = shedding::Left {
            beside: units(allowance.budget.change, now),
            standing: must.then(|| units(limit, now - motion)),
            moves: allowance.moves,
            residuals,
            excess: load.saturating_sub(full),
        };
        // A look after which there is no time for any change is none.
        if left.beside == 0 && left.standing.is_none_or(|units| units == 0) && !left.moves {
            return Adapted::default();
        }
        spare = shedding::plan(&priorities, mesh, left, ticks, work);
        None
    } else {
        // Nothing is refined that could not be merged again beside the contacts that are expected: that takes as long.
        let most = allowance.budget.change.saturating_sub(looking.saturating_add(load));
        let left = allowance.prices.count(Part::Change, most);
        let mut budget_left = ChangeBudget::new([left, left / SEVERAL], residuals, MOST_REFUSED);
        if left <= work::empty_batch_units(mesh) {
            return Adapted::default();
        }
        if (ticks / LOOK_TICKS).is_multiple_of(2) {
            priorities.split_candidates(mesh, ticks, work.finest, &mut work.split_candidates);
        }
        let room = [full, sixteenths(full, STRAIN_FILLED)].map(|filled| filled.saturating_sub(load));
        let short = plan_splits(&priorities, mesh, &mut budget_left, room, work);
        spare = budget_left.spare();
        Some((short, budget_left)).filter(|_| work.changes.is_empty())
    };
    if let Some((short, mut budget_left)) = short {
        // What is wanted and does not fit may take the place of what has a lower priority.
        let limit = match work.split_candidates.first() {
            Some((value, _)) if *value > TOUCHED => (value - PRIORITY_MARGIN).max(TOUCHED),
            Some((value, _)) => 0.5 * value,
            None => adaptivity.merge,
        };
        let some = slice(mesh.active(), ticks / (2 * LOOK_TICKS) % INDICATOR_LOOKS, INDICATOR_LOOKS);
        priorities.merge_candidates(mesh, some.iter(), limit, &mut work.merge_candidates);
        plan_merges(&priorities, mesh, &mut budget_left, Saving { excess: short, below: adaptivity.merge }, work);
        spare = budget_left.spare();
    }
    laps.lap(Part::Look, looked);
    let mut weighed = 0;
    let cost = match work.changes.as_slice() {
        [] => return Adapted { looked, ..Adapted::default() },
        changes if residuals => {
            // The loads are weighed exactly where there is time left for it.
            weighed = work::weighing_units(mesh.loads_near(body, changes));
            weighed = if weighed <= spare { weighed } else { 0 };
            mesh.apply_under(body, changes, loads, weighed > 0)
        }
        changes => mesh.apply(body, changes),
    };
    let units = work::change_units(mesh, &cost) + weighed;
    laps.lap(Part::Change, units);
    Adapted { looked, ..Adapted::of(&work.changes, units, allowance.prices) }
}

/// Splits nodes that `budget_left` is enough for and whose elements take no more than `room` [ns] a tick, those that only strain asks
/// for no more than the second. Time that the best of those that do not fit is short of [ns].
fn plan_splits(
    priorities: &Priorities,
    mesh: &mut ActiveMesh,
    budget_left: &mut ChangeBudget,
    room: [u32; 2],
    work: &mut Workspace,
) -> u32 {
    let prices = priorities.prices;
    let (mut elements, mut taken, mut short, mut least) = (0, 0, 0, 0.0);
    for &(value, split_candidates) in &work.split_candidates {
        if work.changes.len() >= MOST_CHANGES || budget_left.is_spent() {
            break;
        }
        // Neighbours stay within one level: first what has to be split before.
        let mut n = split_candidates;
        while let Some(before) = mesh.set().first_needed(priorities.body, n) {
            n = before;
        }
        let settled = mesh.slot(n).is_none_or(|slot| priorities.is_settled(mesh, slot));
        if !settled || work.changes.contains(&Change::Split(n)) {
            continue;
        }
        if value < least {
            break;
        }
        let room = room[usize::from(value < TOUCHED)];
        // How much more one takes is of no interest where nothing is left and it is known what is short.
        if short > 0 && taken >= room {
            continue;
        }
        let added = mesh.added_by_split(priorities.body, n);
        let mut cost = cost_of_split(priorities.body, mesh, n, added, prices);
        if n != split_candidates {
            // Without room for what it is for, it would be merged again.
            let added = mesh.added_by_split(priorities.body, split_candidates);
            cost += cost_of_split(priorities.body, mesh, split_candidates, added, prices);
        }
        if taken + cost <= room && mesh.has_room_to_split(elements + added) {
            if !mesh.turns_inside_out(priorities.body, Change::Split(n))
                && budget_left.takes(priorities.body, mesh, Change::Split(n), prices.count(Part::Change, cost))
            {
                taken += cost;
                elements += added;
                work.changes.push(Change::Split(n));
            }
        } else if short == 0
            && taken + cost > room
            && budget_left.would_take(priorities.body, mesh, Change::Split(n), prices.count(Part::Change, room))
        {
            // What would be merged for it must not take the room in its stead.
            (short, least) = (taken + cost - room, value - PRIORITY_MARGIN);
        }
    }
    short
}

/// Time a tick that a split of `n` costs which adds `elements` [ns]: theirs and the children's stars', and that of as many nodes and
/// row entries as come with each element that is in use now. They take shorter steps than at rest where those around `n` do.
fn cost_of_split(body: &Body, mesh: &ActiveMesh, n: Node, elements: u32, prices: &Prices) -> u32 {
    let around = body.elements_around(n).iter();
    let shorter = |e: &Element| Some(mesh.pool().class_of(*e)?.saturating_sub(step_class::class_at_rest(body, *e)));
    let shorter = around.filter_map(shorter).max().unwrap_or_default();
    let class = (class_of_level(body, n) + shorter).min(CLASSES - 1);
    let stars = if body.is_smoothed() { (body.children(n).len() as u32) << class } else { 0 };
    let elements = elements << class;
    let with_each = |count: u32| (2 * u64::from(elements) * u64::from(count) / mesh.pool().len().max(1) as u64) as u32;
    prices.of(Part::Element(class as u8), elements + STAR_EVALUATIONS as u32 * stars)
        + prices.of(Part::Node, with_each(mesh.active().len() as u32))
        + prices.of(Part::Row, with_each(mesh.row_entries()))
}

/// Class at rest of the level that the children of `n` are on, from any of their elements.
fn class_of_level(body: &Body, n: Node) -> usize {
    let element = body.children(n).first().and_then(|c| body.elements_around(*c).first());
    element.map_or(0, |e| step_class::class_at_rest(body, *e))
}

/// What merges are for.
#[derive(Clone, Copy, Debug)]
struct Saving {
    /// Time that they are to save [ns] a tick, about.
    excess: u32,
    /// Families of a lower priority than this are merged whatever that saves.
    below: Real,
}

/// Merges families that `budget_left` is enough for, those of the least priority first, until they save what they are for.
fn plan_merges(
    priorities: &Priorities,
    mesh: &mut ActiveMesh,
    budget_left: &mut ChangeBudget,
    saving: Saving,
    work: &mut Workspace,
) {
    let Saving { excess, below } = saving;
    let (mut saved, mut added) = (0, 0);
    for &(value, parent) in &work.merge_candidates {
        if work.changes.len() >= MOST_CHANGES || budget_left.is_spent() || (saved >= excess && value >= below) {
            break;
        }
        let elements = priorities.body.elements_around(parent).len() as u32;
        let may = mesh.has_room(added + elements)
            && mesh.set().may_merge(priorities.body, parent)
            && !mesh.turns_inside_out(priorities.body, Change::Merge(parent));
        if may && budget_left.takes(priorities.body, mesh, Change::Merge(parent), 0) {
            added += elements;
            work.changes.push(Change::Merge(parent));
            // A node has about six elements of its own.
            let own = 6 * priorities.body.children(parent).len() as u32;
            saved += cost_of_split(priorities.body, mesh, parent, own, priorities.prices);
        }
    }
}

/// `part`/16 of `time`.
fn sixteenths(time: u32, part: u32) -> u32 {
    (u64::from(time) * u64::from(part) / 16) as u32
}
