//! When and where to refine and coarsen [DDCB01 3.3], within the work budget.
//!
//! Knows the body, its motion, what presses on it, and where tools are or will be, as an axis and a radius ([`Focus`]);
//! decides changes of resolution and has them made. It keeps nothing from tick to tick: what it decides follows from the
//! state, the budget and the tick.

pub mod indicator;
mod shedding;

use crate::ids::{Element, Node, Slot};
use crate::math::{Bounds, Real, Vec3};
use crate::model::active_mesh::Loads;
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
    /// Nodes closer to a tool than this many spacings of their level are split, and from farther where the material is uneven.
    pub reach: Real,
    /// Finest level that is used.
    pub finest: usize,
}

impl Default for Adaptivity {
    fn default() -> Self {
        Self { split: 0.1, merge: 0.3, reach: 1.4, finest: usize::MAX }
    }
}

/// Where resolution is wanted: around a tool, where it is or where its velocity takes it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Focus {
    /// Start of the tool's axis [m].
    pub from: Vec3,
    /// End of its axis [m].
    pub to: Vec3,
    /// Its radius [m].
    pub radius: Real,
}

impl Focus {
    /// Distance of `p` from the tool's surface [m], negative inside.
    fn distance(&self, p: Vec3) -> Real {
        let along = self.to - self.from;
        let squared = along.norm_squared();
        let t = if squared > 0.0 { ((p - self.from).dot(&along) / squared).clamp(0.0, 1.0) } else { 0.0 };
        (p - (self.from + along * t)).norm() - self.radius
    }
}

/// Most changes of one tick.
const MOST_CHANGES: usize = 64;
/// Ticks between two looks at where resolution is wanted, and the first of them: none ends a frame, or lies in the middle of
/// one. Splits come at every other look: a tool at 1 m/s comes 8 mm farther in between, less than it is refined ahead of it.
const LOOK_TICKS: u64 = 4;
const FIRST_LOOK: u64 = 2;
/// Looks for splits, and looks for merges, that a full look at the indicator takes: 32 ms. They take turns, or a body that is
/// always refined somewhere would never be coarsened. What is near tools is all looked at in each.
const INDICATOR_LOOKS: u64 = 4;
/// A family near a tool stays refined up to this much farther away than it was refined at.
const STAY: Real = 1.3;
/// Where the material is uneven, nodes are split from this much farther away: large elements show too little of what is
/// smaller than they are, and what they show is felt from afar.
const UNEVEN: Real = 1.5;
/// Values from here on are those of nodes that a tool is close to, and the most that strain alone is worth: at the limit of
/// the budget it gives way to touch.
const TOUCHED: Real = 2.0;
const STRAINED: Real = 1.9;
/// What is near a tool gives way to what is worth this much more.
const WORTH_MORE: Real = 0.5;
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
    wanted: Vec<(Real, Node)>,
    /// Value and parent, least first.
    spare: Vec<(Real, Node)>,
    changes: Vec<Change>,
    /// Finest level that can be stepped and is allowed.
    finest: usize,
}

impl Workspace {
    /// For `body`.
    pub fn new(body: &Body, adaptivity: &Adaptivity) -> Self {
        Self {
            wanted: Vec::with_capacity(MOST_CHANGES + 1),
            // Families that may be merged: at most one for each coarser node.
            spare: Vec::with_capacity(body.node_count() - body.nodes_of(body.finest()).len()),
            changes: Vec::with_capacity(MOST_CHANGES),
            finest: adaptivity.finest.min(finest_steppable(body)),
        }
    }
}

/// Longest stable step [s] of all elements of level `r`, at rest.
pub fn step_of_level(body: &Body, r: usize) -> Real {
    let stiffest = body.elements_of(r).map(|e| step_class::omega_squared(body, e)).fold(0.0, Real::max);
    step_class::stable_step(stiffest, Strained::REST, body.damping_time(), 0.0)
}

/// The finest level that can be stepped: the core does not use finer ones. Level 0 is used whatever it needs.
pub fn finest_steppable(body: &Body) -> usize {
    let can = |r: usize| step_of_level(body, r) >= step_class::step_of(CLASSES - 1);
    (0..body.levels().len()).take_while(|r| *r == 0 || can(*r)).last().unwrap_or(0)
}

/// What may be spent.
#[derive(Clone, Copy, Debug)]
pub struct Means<'a> {
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

impl Means<'_> {
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
pub struct Wishes<'a> {
    /// When to refine and to coarsen.
    pub adaptivity: &'a Adaptivity,
    /// Where the tools are or will be.
    pub focus: &'a [Focus],
    /// What may be spent.
    pub means: Means<'a>,
    /// What acts on the body.
    pub loads: Loads<'a>,
    /// Completed ticks.
    pub ticks: u64,
}

/// Decides by `wishes` what to change, and has it done.
pub fn adapt(
    body: &Body,
    mesh: &mut ActiveMesh,
    wishes: &Wishes,
    work: &mut Workspace,
    laps: &mut dyn Laps,
) -> Adapted {
    let Wishes { adaptivity, focus, means, loads, ticks } = wishes;
    let ticks = *ticks;
    if work.finest == 0 {
        return Adapted::default();
    }
    work.wanted.clear();
    work.spare.clear();
    work.changes.clear();
    let (held, expected) = means.loads(body, mesh);
    let load = held.max(expected);
    let Budget { limit, planned, .. } = means.budget;
    // Under a tool, what changes put out of balance is eased.
    let pressed: Real = loads.points.iter().flatten().map(|p| p.multiplier).sum();
    let eases = pressed > 0.0;
    // Ticks that end a frame have to fit, too; there nothing is changed.
    let frame = work::of_frame(means.prices);
    let sheds = held > sixteenths(planned, SHED) || held.saturating_add(frame) > sixteenths(means.budget.frame, SHED);
    // Between what is planned for the end of a frame and what there is, few frames are late.
    let must = held > planned || held.saturating_add(frame) > limit;
    let looks =
        if sheds { !means.frame || held.saturating_add(frame) > limit } else { ticks % LOOK_TICKS == FIRST_LOOK };
    if !looks {
        return Adapted::default();
    }
    let settled = if eases && !must { UNSETTLED * pressed } else { Real::INFINITY };
    let look = Look { body, adaptivity, focus, settled, prices: means.prices };
    // No refinement that a little strain, or a little more to pay for it, would make a load to be shed.
    let looked = if sheds { shedding::looked(mesh) } else { mesh.pool().len() as u32 };
    let looking = means.prices.of(Part::Look, looked);
    let full = sixteenths(means.budget.frame.saturating_sub(frame).min(planned.saturating_sub(looking)), ADMITTED);
    let now = held.saturating_add(looking).saturating_add(if means.frame { frame } else { 0 });
    let short = if sheds {
        let motion = work::of_motion(body, mesh, means.prices, means.points << means.class);
        let units = |most: u32, spent: u32| means.prices.count(Part::Change, most.saturating_sub(spent));
        let left = shedding::Left {
            beside: units(means.budget.change, now),
            standing: must.then(|| units(limit, now - motion)),
            moves: means.moves,
            eases,
            excess: load.saturating_sub(full),
        };
        shedding::plan(&look, mesh, left, ticks, work);
        None
    } else {
        // Nothing is refined that could not be merged again beside the contacts that are expected: that takes as long.
        let most = means.budget.change.saturating_sub(looking.saturating_add(load));
        let left = means.prices.count(Part::Change, most);
        let mut pay = Pay::new([left, left / SEVERAL], eases, MOST_REFUSED);
        if left <= work::empty_batch_units(mesh) {
            return Adapted::default();
        }
        if (ticks / LOOK_TICKS).is_multiple_of(2) {
            look.wanted_nodes(mesh, ticks, work.finest, &mut work.wanted);
        }
        let room = [full, sixteenths(full, STRAIN_FILLED)].map(|filled| filled.saturating_sub(load));
        let short = plan_splits(&look, mesh, &mut pay, room, work);
        Some((short, pay)).filter(|_| work.changes.is_empty())
    };
    if let Some((short, mut pay)) = short {
        // What is wanted and does not fit may take the place of what is worth less.
        let limit = match work.wanted.first() {
            Some((value, _)) if *value > TOUCHED => (value - WORTH_MORE).max(TOUCHED),
            Some((value, _)) => 0.5 * value,
            None => adaptivity.merge,
        };
        let some = slice(mesh.active(), ticks / (2 * LOOK_TICKS) % INDICATOR_LOOKS, INDICATOR_LOOKS);
        look.spare_families(mesh, some.iter(), limit, &mut work.spare);
        plan_merges(&look, mesh, &mut pay, Saving { excess: short, below: adaptivity.merge }, work);
    }
    laps.lap(Part::Look, looked);
    let upkeep = match work.changes.as_slice() {
        [] => return Adapted { looked, ..Adapted::default() },
        changes if eases => mesh.apply_under(body, changes, loads),
        changes => mesh.apply(body, changes),
    };
    let units = work::change_units(mesh, &upkeep);
    laps.lap(Part::Change, units);
    Adapted { looked, ..Adapted::of(&work.changes, units, means.prices) }
}

/// What pays for changes, and for several of them only where they take little.
struct Pay {
    /// Change units that one may take, with what it adds to the tick.
    one: u32,
    /// And several together.
    several: u32,
    /// Whether what they put out of balance is eased.
    eases: bool,
    taken: u32,
    refused: u32,
    /// Changes that take more than there is, after which no others are looked at.
    most_refused: u32,
    /// The one of them that takes the least, and its change units.
    cheapest: Option<(u32, Change)>,
}

impl Pay {
    fn new([one, several]: [u32; 2], eases: bool, most_refused: u32) -> Self {
        Self { one, several, eases, taken: 0, refused: 0, most_refused, cheapest: None }
    }

    /// True where it is enough for `change`, too, which adds as much as `more` change units to the tick. Changes side by side take together what
    /// each takes alone, or less, but for the few elements that none of them alone takes out.
    fn takes(&mut self, body: &Body, mesh: &mut ActiveMesh, change: Change, more: u32) -> bool {
        let units = self.alone(body, mesh, change) + more;
        let (total, most) = match self.taken {
            0 => (units, self.one),
            taken => (taken + units - work::empty_batch_units(mesh), self.several),
        };
        let enough = total <= most;
        if !enough && self.cheapest.is_none_or(|(least, _)| units < least) {
            self.cheapest = Some((units, change));
        }
        *(if enough { &mut self.taken } else { &mut self.refused }) = if enough { total } else { self.refused + 1 };
        enough
    }

    /// Change units that `change` takes by itself.
    fn alone(&self, body: &Body, mesh: &mut ActiveMesh, change: Change) -> u32 {
        let upkeep = mesh.foresee(body, &[change], self.eases);
        work::change_units(mesh, &upkeep)
    }

    /// True where it were enough for `change` alone, if that had just the `room` that it adds to the tick.
    fn would_take(&mut self, body: &Body, mesh: &mut ActiveMesh, change: Change, room: u32) -> bool {
        let enough = self.alone(body, mesh, change) + room <= self.one;
        self.refused += u32::from(!enough);
        enough
    }

    /// True where it is of no use to ask for more.
    fn is_spent(&self) -> bool {
        self.refused >= if self.taken > 0 { 1 } else { self.most_refused }
    }
}

/// Splits nodes that `pay` is enough for and whose elements take no more than `room` [ns] a tick, those that only strain asks
/// for no more than the second. Time that the best of those that do not fit is short of [ns].
fn plan_splits(look: &Look, mesh: &mut ActiveMesh, pay: &mut Pay, room: [u32; 2], work: &mut Workspace) -> u32 {
    let prices = look.prices;
    let (mut elements, mut taken, mut short, mut least) = (0, 0, 0, 0.0);
    for &(value, wanted) in &work.wanted {
        if work.changes.len() >= MOST_CHANGES || pay.is_spent() {
            break;
        }
        // Neighbours stay within one level: first what has to be split before.
        let mut n = wanted;
        while let Some(before) = mesh.set().first_needed(look.body, n) {
            n = before;
        }
        let settled = mesh.slot(n).is_none_or(|slot| look.is_settled(mesh, slot));
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
        let added = mesh.added_by_split(look.body, n);
        let mut cost = cost_of_split(look.body, mesh, n, added, prices);
        if n != wanted {
            // Without room for what it is for, it would be merged again.
            let added = mesh.added_by_split(look.body, wanted);
            cost += cost_of_split(look.body, mesh, wanted, added, prices);
        }
        if taken + cost <= room && mesh.has_room_to_split(elements + added) {
            if pay.takes(look.body, mesh, Change::Split(n), prices.count(Part::Change, cost)) {
                taken += cost;
                elements += added;
                work.changes.push(Change::Split(n));
            }
        } else if short == 0
            && taken + cost > room
            && pay.would_take(look.body, mesh, Change::Split(n), prices.count(Part::Change, room))
        {
            // What would be merged for it must not take the room in its stead.
            (short, least) = (taken + cost - room, value - WORTH_MORE);
        }
    }
    short
}

/// Time a tick that a split of `n` costs which adds `elements` [ns]: theirs, and that of as many nodes and row entries as
/// come with each element that is in use now. They take shorter steps than at rest where those around `n` do.
fn cost_of_split(body: &Body, mesh: &ActiveMesh, n: Node, elements: u32, prices: &Prices) -> u32 {
    let around = body.elements_around(n).iter();
    let shorter = |e: &Element| Some(mesh.pool().class_of(*e)?.saturating_sub(step_class::class_at_rest(body, *e)));
    let shorter = around.filter_map(shorter).max().unwrap_or_default();
    let class = (class_of_level(body, n) + shorter).min(CLASSES - 1);
    let evaluations = elements << class;
    let with_each =
        |count: u32| (2 * u64::from(evaluations) * u64::from(count) / mesh.pool().len().max(1) as u64) as u32;
    prices.of(Part::Element(class as u8), evaluations)
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
    /// Families worth less than this are merged whatever that saves.
    below: Real,
}

/// Merges families that `pay` is enough for, the least valuable first, until they save what they are for.
fn plan_merges(look: &Look, mesh: &mut ActiveMesh, pay: &mut Pay, saving: Saving, work: &mut Workspace) {
    let Saving { excess, below } = saving;
    let (mut saved, mut added) = (0, 0);
    for &(value, parent) in &work.spare {
        if work.changes.len() >= MOST_CHANGES || pay.is_spent() || (saved >= excess && value >= below) {
            break;
        }
        let elements = look.body.elements_around(parent).len() as u32;
        let may = mesh.has_room(added + elements) && mesh.set().may_merge(look.body, parent);
        if may && pay.takes(look.body, mesh, Change::Merge(parent), 0) {
            added += elements;
            work.changes.push(Change::Merge(parent));
            // A node has about six elements of its own.
            let own = 6 * look.body.children(parent).len() as u32;
            saved += cost_of_split(look.body, mesh, parent, own, look.prices);
        }
    }
}

/// What decisions look at.
struct Look<'a> {
    body: &'a Body,
    adaptivity: &'a Adaptivity,
    focus: &'a [Focus],
    prices: &'a Prices,
    /// Nodes that more than this [N] is still let go of at are not changed again, [`UNSETTLED`].
    settled: Real,
}

impl Look<'_> {
    /// Distance of `p` from the nearest tool [m].
    fn distance(&self, p: Vec3) -> Real {
        self.focus.iter().map(|f| f.distance(p)).fold(Real::INFINITY, Real::min)
    }

    /// Box around all places closer to a tool than `distance` [m].
    fn near_tools(&self, distance: Real) -> Bounds {
        let ends = self.focus.iter().flat_map(|f| [(f.from, f.radius), (f.to, f.radius)]);
        let around = |(end, radius): (Vec3, Real)| Bounds { low: end, high: end }.grown(radius + distance);
        ends.map(around).fold(Bounds::NOTHING, |all, one| all.joined(&one))
    }

    /// How much a place `distance` away from a tool is worth on a level of `spacing`: nothing out of reach, else
    /// [`TOUCHED`] and more the closer it is.
    fn worth(&self, distance: Real, spacing: Real, farther: Real) -> Real {
        let reach = self.adaptivity.reach * spacing * farther;
        if distance < reach { TOUCHED + (1.0 - distance / reach).min(2.0) } else { 0.0 }
    }

    /// The widest spacing of any level [m].
    fn widest(&self) -> Real {
        self.body.organs().iter().flat_map(|o| &o.levels).map(|l| l.spacing).fold(0.0, Real::max)
    }

    /// How much farther than elsewhere a tool is felt around node `n`.
    fn farther(&self, n: Node) -> Real {
        if self.body.is_uneven(n) { UNEVEN } else { 1.0 }
    }

    /// False where there is nothing finer that may be used.
    fn may_split(&self, n: Node, finest: usize) -> bool {
        self.body.level_of(n) < finest && !self.body.children(n).is_empty()
    }

    /// False where nothing around the children of `n` can move: they show no strain, whatever there is around `n`.
    fn can_strain(&self, n: Node) -> bool {
        let elements = self.body.children(n).iter().flat_map(|c| self.body.elements_around(*c));
        elements.flat_map(|e| self.body.element(*e)).any(|m| !self.body.is_fixed(m))
    }

    /// Nodes worth splitting, of the slice of this look.
    fn wanted_nodes(&self, mesh: &ActiveMesh, ticks: u64, finest: usize, wanted: &mut Vec<(Real, Node)>) {
        for slot in slice(mesh.active(), ticks / (2 * LOOK_TICKS) % INDICATOR_LOOKS, INDICATOR_LOOKS) {
            let n = mesh.node(*slot);
            if self.may_split(n, finest) && self.is_settled(mesh, *slot) {
                let value = indicator::strain_jump(self.body, mesh, n).unwrap_or_default() / self.adaptivity.split;
                if value > 1.0 && self.can_strain(n) {
                    keep(wanted, value.min(STRAINED), n);
                }
            }
        }
        if self.focus.is_empty() {
            return;
        }
        let near = self.near_tools(self.adaptivity.reach * UNEVEN * self.widest());
        for slot in mesh.active() {
            // Most nodes around a tool are as fine as may be, and most others are far away.
            let n = mesh.node(*slot);
            if self.body.level_of(n) >= finest {
                continue;
            }
            let p = mesh.position(*slot);
            if !near.contains(&p) {
                continue;
            }
            let distance = self.distance(p);
            if self.may_split(n, finest) && self.is_settled(mesh, *slot) {
                let value = self.worth(distance, self.body.spacing_at(n), self.farther(n));
                if value > 0.0 {
                    keep(wanted, value, n);
                }
            }
        }
    }

    fn is_settled(&self, mesh: &ActiveMesh, slot: Slot) -> bool {
        mesh.eased(slot).norm_squared() <= self.settled * self.settled
    }

    /// Families worth less than `limit` whose first child is in one of the `slots`.
    fn spare_families<'s>(
        &self,
        mesh: &ActiveMesh,
        slots: impl Iterator<Item = &'s Slot>,
        limit: Real,
        spare: &mut Vec<(Real, Node)>,
    ) {
        for slot in slots {
            let n = mesh.node(*slot);
            if self.body.level_of(n) == 0 {
                continue;
            }
            let parent = self.body.parent(n);
            let family = self.body.children(parent);
            let settled = |c: &Node| mesh.slot(*c).is_some_and(|slot| self.is_settled(mesh, slot));
            if family[0] != n || !family.iter().all(|c| mesh.set().is_active(*c) && settled(c)) {
                continue;
            }
            let spacing = self.body.spacing_at(parent);
            let mut distance = Real::INFINITY;
            if !self.focus.is_empty() {
                let from_tools = |c: &Node| mesh.position_of(*c).map_or(Real::INFINITY, |x| self.distance(x));
                distance = family.iter().map(from_tools).fold(Real::INFINITY, Real::min);
            }
            let touch = self.worth(distance, spacing, STAY * self.farther(parent));
            // Strain takes a while to weigh, and a family that is worth too much anyhow is not asked for more.
            if touch >= limit || spare.len() == spare.capacity() {
                continue;
            }
            let jump = |most: Real, c: &Node| Some(most.max(indicator::strain_jump(self.body, mesh, *c)?));
            let strain = family.iter().try_fold(0.0, jump).unwrap_or_default() / self.adaptivity.split;
            let value = touch.max(strain.min(STRAINED));
            if value < limit {
                spare.push((value, parent));
            }
        }
        spare.sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
    }
}

/// `part`/16 of `time`.
fn sixteenths(time: u32, part: u32) -> u32 {
    (u64::from(time) * u64::from(part) / 16) as u32
}

/// Slice `part` of `parts` of `all`.
fn slice<T>(all: &[T], part: u64, parts: u64) -> &[T] {
    let at = |k: u64| (all.len() as u64 * k / parts) as usize;
    &all[at(part)..at(part + 1)]
}

/// Puts `(value, n)` in its place in a list of the [`MOST_CHANGES`] largest values, ties to the smaller number.
fn keep(list: &mut Vec<(Real, Node)>, value: Real, n: Node) {
    let place = list.partition_point(|&(v, m)| v > value || (v == value && m < n));
    if place < MOST_CHANGES && list.get(place).is_none_or(|e| e.1 != n) {
        list.truncate(MOST_CHANGES - 1);
        list.insert(place, (value, n));
    }
}
