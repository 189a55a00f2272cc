//! When and where to refine and coarsen [DDCB01 3.3], within the work budget.
//!
//! Knows the body, its motion and where tools are or will be; decides changes of resolution and has them made. It keeps
//! nothing from tick to tick: what it decides follows from the state, the budget and the tick.

pub mod indicator;
mod shedding;

use crate::math::{Real, Vec3};
use crate::model::active_mesh::{Loads, Upkeep};
use crate::model::active_set::Change;
use crate::model::element_pool::CLASSES;
use crate::model::step_class::{self, Strained};
use crate::model::{ActiveMesh, Body};
use crate::stepping::work::{self, CHANGE_UPKEEP, EASED_CHANGE};

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
/// A full look at the indicator takes this many ticks.
const INDICATOR_TICKS: u64 = 32;
/// A full look at what is near tools takes this many.
const FOCUS_TICKS: u64 = 4;
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
/// Part of what is for motion that several changes of resolution may take together in one tick, one in this many.
const UPKEEP_PART: u32 = 6;
/// Part of what the tools press with from which on a node is not settled. Split and merged in turns before it is, a family
/// would be strained more each time.
const UNSETTLED: Real = 0.02;
/// Changes that take more than a tick has left, after which no others are looked at.
const MOST_REFUSED: u32 = 4;
/// Contact points that room is kept for once a tool is there.
const EXPECTED_CONTACTS: usize = 20;
/// Part of what is for motion, in 1/16, up to which refinement fills it, and up to which strain alone does: the rest is for
/// strains that shorten steps, and what a tool makes room for must not fill up again with what it was taken from.
const FILLED: u32 = 11;
const STRAIN_FILLED: u32 = 9;

/// What was done in one tick.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Adapted {
    /// Nodes split.
    pub splits: u32,
    /// Families merged.
    pub merges: u32,
    /// Units of work it took.
    pub work: u32,
    /// The body is to stand still.
    pub saving: bool,
}

impl Adapted {
    /// `changes` of `mesh` that took `upkeep`.
    fn of(mesh: &ActiveMesh, changes: &[Change], upkeep: &Upkeep) -> Self {
        let splits = changes.iter().filter(|c| matches!(c, Change::Split(_))).count() as u32;
        Self { splits, merges: changes.len() as u32 - splits, work: work::of_batch(mesh, upkeep), saving: false }
    }
}

/// Memory that decisions need and no one keeps.
#[derive(Debug)]
pub struct Workspace {
    /// Value and node, best first.
    wanted: Vec<(Real, u32)>,
    /// Value and parent, least first.
    spare: Vec<(Real, u32)>,
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

/// The finest level that can be stepped: the core does not use finer ones.
pub fn finest_steppable(body: &Body) -> usize {
    let can = |r: usize| {
        let stiffest = body.elements_of(r).map(|e| step_class::omega_squared(body, e)).fold(0.0, Real::max);
        let step = step_class::stable_step(stiffest, Strained::REST, body.damping_time(), 0.0);
        step >= step_class::step_of(CLASSES - 1)
    };
    (0..body.levels().len()).take_while(|r| *r == 0 || can(*r)).last().unwrap_or(0)
}

/// What may be spent.
#[derive(Clone, Copy, Debug)]
pub struct Means {
    /// Units of work that a tick may take.
    pub budget: u32,
    /// Those of them that are for the body's motion.
    pub motion: u32,
    /// What this tick has for that (a body that is held has all of it for changes): less after one that took more, more after
    /// some in which the body stood still.
    pub allowed: u32,
    /// Contact points that are held.
    pub contacts: usize,
}

/// Decides what to change after `ticks` completed ticks, with tools in `focus`, while `loads` act on the body, and has it done.
pub fn adapt(
    body: &Body,
    mesh: &mut ActiveMesh,
    adaptivity: &Adaptivity,
    focus: &[Focus],
    (means, loads): (&Means, &Loads),
    ticks: u64,
    work: &mut Workspace,
) -> Adapted {
    if work.finest == 0 {
        return Adapted::default();
    }
    work.wanted.clear();
    work.spare.clear();
    work.changes.clear();
    let contacts = if focus.is_empty() { means.contacts } else { means.contacts.max(EXPECTED_CONTACTS) };
    let load = work::of_tick(mesh, contacts);
    let sheds = mesh.is_held() || work::of_tick(mesh, means.contacts) > means.motion;
    // Under a tool, what changes put out of balance is eased.
    let pressed: Real = loads.points.iter().flatten().map(|p| p.multiplier).sum();
    let eases = pressed > 0.0;
    let settled = if eases && !sheds { UNSETTLED * pressed } else { Real::INFINITY };
    let look = Look { body, adaptivity, focus, settled };
    // A body without room for a change could not follow a tool.
    let spare = means.budget.saturating_sub(work::of_empty_batch(mesh) + CHANGE_UPKEEP + EASED_CHANGE);
    let part = |of: u32| ((u64::from(means.motion) * u64::from(of) / 16) as u32).min(spare);
    let full = part(FILLED);
    if sheds {
        return shedding::shed(&look, mesh, (means, loads, eases), (load, full), ticks, work);
    }
    // What the last change took has to be made up for first.
    let left = if means.allowed < means.motion { 0 } else { means.budget.saturating_sub(load) };
    let mut pay = Pay { one: left, several: left.min(means.motion / UPKEEP_PART), eases, taken: 0, refused: 0 };
    look.wanted_nodes(mesh, ticks, work.finest, &mut work.wanted);
    let room = [full, part(STRAIN_FILLED)].map(|filled| filled.saturating_sub(load));
    let short = plan_splits(&look, mesh, &mut pay, room, work);
    if work.changes.is_empty() {
        // What is wanted and does not fit may take the place of what is worth less.
        let limit = match work.wanted.first() {
            Some((value, _)) if *value > TOUCHED => (value - WORTH_MORE).max(TOUCHED),
            Some((value, _)) => 0.5 * value,
            None => adaptivity.merge,
        };
        let some = slice(mesh.active(), ticks % INDICATOR_TICKS, INDICATOR_TICKS);
        look.spare_families(mesh, some.iter(), limit, &mut work.spare);
        plan_merges(body, mesh, &mut pay, short, adaptivity.merge, work);
    }
    let upkeep = match work.changes.as_slice() {
        [] => return Adapted::default(),
        changes if eases => mesh.apply_under(body, changes, loads),
        changes => mesh.apply(body, changes),
    };
    Adapted::of(mesh, &work.changes, &upkeep)
}

/// What pays for changes, and for several of them only where they take little.
struct Pay {
    /// Units of work that one may take, with what it adds to the tick.
    one: u32,
    /// And several together.
    several: u32,
    /// Whether what they put out of balance is eased.
    eases: bool,
    taken: u32,
    refused: u32,
}

impl Pay {
    /// True where it is enough for `change`, too, which adds `more` units to the tick. Changes side by side take together what
    /// each takes alone, or less, but for the few elements that none of them alone takes out.
    fn takes(&mut self, body: &Body, mesh: &mut ActiveMesh, change: Change, more: u32) -> bool {
        let units = self.alone(body, mesh, change) + more;
        let (total, most) = match self.taken {
            0 => (units, self.one),
            taken => (taken + units - work::of_empty_batch(mesh), self.several),
        };
        let enough = total <= most;
        *(if enough { &mut self.taken } else { &mut self.refused }) = if enough { total } else { self.refused + 1 };
        enough
    }

    /// Units of work that `change` takes by itself.
    fn alone(&self, body: &Body, mesh: &mut ActiveMesh, change: Change) -> u32 {
        let upkeep = mesh.foresee(body, &[change], self.eases);
        work::of_batch(mesh, &upkeep)
    }

    /// True where it were enough for `change` alone, if that had just the `room` that it adds to the tick.
    fn would_take(&mut self, body: &Body, mesh: &mut ActiveMesh, change: Change, room: u32) -> bool {
        let enough = self.alone(body, mesh, change) + room <= self.one;
        self.refused += u32::from(!enough);
        enough
    }

    /// True where it is of no use to ask for more.
    fn is_spent(&self) -> bool {
        self.refused >= if self.taken > 0 { 1 } else { MOST_REFUSED }
    }
}

/// Splits nodes that `pay` is enough for and whose elements take no more than `room` units of work a tick, those that only
/// strain asks for no more than the second. Units that the best of those that do not fit is short of.
fn plan_splits(look: &Look, mesh: &mut ActiveMesh, pay: &mut Pay, room: [u32; 2], work: &mut Workspace) -> u32 {
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
        let added = mesh.added_by_split(look.body, n);
        let mut cost = cost_of_split(look.body, n, added);
        if value < least {
            break;
        }
        let room = room[usize::from(value < TOUCHED)];
        if n != wanted {
            // Without room for what it is for, it would be merged again.
            cost += cost_of_split(look.body, wanted, mesh.added_by_split(look.body, wanted));
        }
        if taken + cost <= room && mesh.has_room_to_split(elements + added) {
            if pay.takes(look.body, mesh, Change::Split(n), cost) {
                taken += cost;
                elements += added;
                work.changes.push(Change::Split(n));
            }
        } else if short == 0 && taken + cost > room && pay.would_take(look.body, mesh, Change::Split(n), room) {
            // What would be merged for it must not take the room in its stead.
            (short, least) = (taken + cost - room, value - WORTH_MORE);
        }
    }
    short
}

/// Units of work a tick that a split of `n` costs which adds `elements`, with the nodes and rows that come with them.
fn cost_of_split(body: &Body, n: u32, elements: u32) -> u32 {
    (elements << class_of_level(body, n)) * 3 / 2
}

/// Class at rest of the level that the children of `n` are on, from any of their elements.
fn class_of_level(body: &Body, n: u32) -> usize {
    let element = body.children(n).first().and_then(|c| body.elements_around(*c).first());
    element.map_or(0, |e| step_class::class_at_rest(body, *e))
}

/// Merges families that `pay` is enough for, the least valuable first: those worth less than `merge`, and others until about `excess`
/// units of work a tick are saved. Units that are.
fn plan_merges(
    body: &Body,
    mesh: &mut ActiveMesh,
    pay: &mut Pay,
    excess: u32,
    merge: Real,
    work: &mut Workspace,
) -> u32 {
    let (mut saved, mut added) = (0, 0);
    for &(value, parent) in &work.spare {
        if work.changes.len() >= MOST_CHANGES || pay.is_spent() || (saved >= excess && value >= merge) {
            break;
        }
        let elements = body.elements_around(parent).len() as u32;
        let may = mesh.has_room(added + elements) && mesh.set().may_merge(body, parent);
        if may && pay.takes(body, mesh, Change::Merge(parent), 0) {
            added += elements;
            work.changes.push(Change::Merge(parent));
            // A node has about six elements of its own.
            saved += (6 * body.children(parent).len() as u32) << class_of_level(body, parent);
        }
    }
    saved
}

/// What decisions look at.
struct Look<'a> {
    body: &'a Body,
    adaptivity: &'a Adaptivity,
    focus: &'a [Focus],
    /// Nodes that more than this [N] is still let go of at are not changed again, [`UNSETTLED`].
    settled: Real,
}

impl Look<'_> {
    /// Distance of `p` from the nearest tool [m].
    fn distance(&self, p: Vec3) -> Real {
        self.focus.iter().map(|f| f.distance(p)).fold(Real::INFINITY, Real::min)
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
    fn farther(&self, n: u32) -> Real {
        if self.body.is_uneven(n) { UNEVEN } else { 1.0 }
    }

    /// False where there is nothing finer that may be used.
    fn may_split(&self, n: u32, finest: usize) -> bool {
        self.body.level_of(n) < finest && !self.body.children(n).is_empty()
    }

    /// False where nothing around the children of `n` can move: they show no strain, whatever there is around `n`.
    fn can_strain(&self, n: u32) -> bool {
        let elements = self.body.children(n).iter().flat_map(|c| self.body.elements_around(*c));
        elements.flat_map(|e| self.body.element(*e)).any(|m| !self.body.is_fixed(m))
    }

    /// Nodes worth splitting, of the slices of this tick.
    fn wanted_nodes(&self, mesh: &ActiveMesh, ticks: u64, finest: usize, wanted: &mut Vec<(Real, u32)>) {
        for slot in slice(mesh.active(), ticks % INDICATOR_TICKS, INDICATOR_TICKS) {
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
        let farthest = self.adaptivity.reach * UNEVEN * self.widest();
        for slot in slice(mesh.active(), ticks % FOCUS_TICKS, FOCUS_TICKS) {
            let distance = self.distance(mesh.position(*slot));
            // Most are far away, and where a node lies is at hand while the body's tables are not.
            if distance >= farthest {
                continue;
            }
            let n = mesh.node(*slot);
            if self.may_split(n, finest) && self.is_settled(mesh, *slot) {
                let value = self.worth(distance, self.body.spacing_at(n), self.farther(n));
                if value > 0.0 {
                    keep(wanted, value, n);
                }
            }
        }
    }

    fn is_settled(&self, mesh: &ActiveMesh, slot: u32) -> bool {
        mesh.eased(slot).norm_squared() <= self.settled * self.settled
    }

    /// Families worth less than `limit` whose first child is in one of the `slots`.
    fn spare_families<'s>(
        &self,
        mesh: &ActiveMesh,
        slots: impl Iterator<Item = &'s u32>,
        limit: Real,
        spare: &mut Vec<(Real, u32)>,
    ) {
        for slot in slots {
            let n = mesh.node(*slot);
            if self.body.level_of(n) == 0 {
                continue;
            }
            let parent = self.body.parent(n);
            let family = self.body.children(parent);
            let settled = |c: &u32| mesh.slot(*c).is_some_and(|slot| self.is_settled(mesh, slot));
            if family[0] != n || !family.iter().all(|c| mesh.set().is_active(*c) && settled(c)) {
                continue;
            }
            let spacing = self.body.spacing_at(parent);
            let mut distance = Real::INFINITY;
            if !self.focus.is_empty() {
                let from_tools = |c: &u32| mesh.position_of(*c).map_or(Real::INFINITY, |x| self.distance(x));
                distance = family.iter().map(from_tools).fold(Real::INFINITY, Real::min);
            }
            let touch = self.worth(distance, spacing, STAY * self.farther(parent));
            // Strain takes a while to weigh, and a family that is worth too much anyhow is not asked for more.
            if touch >= limit || spare.len() == spare.capacity() {
                continue;
            }
            let jump = |most: Real, c: &u32| Some(most.max(indicator::strain_jump(self.body, mesh, *c)?));
            let strain = family.iter().try_fold(0.0, jump).unwrap_or_default() / self.adaptivity.split;
            let value = touch.max(strain.min(STRAINED));
            if value < limit {
                spare.push((value, parent));
            }
        }
        spare.sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
    }
}

/// Slice `part` of `parts` of `all`.
fn slice<T>(all: &[T], part: u64, parts: u64) -> &[T] {
    let at = |k: u64| (all.len() as u64 * k / parts) as usize;
    &all[at(part)..at(part + 1)]
}

/// Puts `(value, n)` in its place in a list of the [`MOST_CHANGES`] largest values, ties to the smaller number.
fn keep(list: &mut Vec<(Real, u32)>, value: Real, n: u32) {
    let place = list.partition_point(|&(v, m)| v > value || (v == value && m < n));
    if place < MOST_CHANGES && list.get(place).is_none_or(|e| e.1 != n) {
        list.truncate(MOST_CHANGES - 1);
        list.insert(place, (value, n));
    }
}
