//! When and where to refine and coarsen [DDCB01 3.3], within the work budget.
//!
//! Knows the body, its motion and where tools are or will be; decides changes of resolution and has them made. It keeps
//! nothing from tick to tick: what it decides follows from the state, the budget and the tick.

pub mod indicator;

use crate::math::{Real, Vec3};
use crate::model::active_mesh::{Loads, Upkeep};
use crate::model::active_set::Change;
use crate::model::element_pool::CLASSES;
use crate::model::step_class::{self, Strained};
use crate::model::{ActiveMesh, Body};
use crate::stepping::work::{
    self, BATCH_UPKEEP, CHANGE_UPKEEP, EASE_UPKEEP, EASED_CHANGE, ELEMENT_UPKEEP, ROW_UPKEEP, SHED_UPKEEP,
};

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
        Self { split: 0.1, merge: 0.3, reach: 1.0, finest: usize::MAX }
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
/// Values from here on are those of nodes that a tool is close to.
const TOUCHED: Real = 2.0;
/// Part of the budget that changes of resolution may take in one tick, one in this many, where that pays for a change.
const UPKEEP_PART: u32 = 6;
/// Part of the budget, in 1/16, up to which refinement fills it: the rest is for strains that shorten steps.
const FILLED: u32 = 11;

/// What was done in one tick.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Adapted {
    /// Nodes split.
    pub splits: u32,
    /// Families merged.
    pub merges: u32,
    /// Units of work it took.
    pub work: u32,
    /// The body is to stand still and save up for the next change.
    pub saving: bool,
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
    /// Units that this one may take: less after one that took more, more after some in which the body stood still.
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
    let (budget, load) = (means.budget, work::of_tick(mesh, means.contacts));
    let full = (u64::from(budget) * u64::from(FILLED) / 16) as u32;
    let look = Look { body, adaptivity, focus };
    let shedding = load > budget;
    // Under a tool, what changes put out of balance is eased; a body that has too much to do cannot afford that.
    let eases = !shedding && loads.points.iter().flatten().any(|p| p.multiplier > 0.0);
    let each = CHANGE_UPKEEP + if eases { EASED_CHANGE } else { 0 };
    if shedding {
        // Before it moves again the body sheds what is too much, in batches as large as may be: they share the rows that
        // they make, so few large ones take less than many small ones, even if they have to be saved up for.
        look.spare_families(mesh, 0, 1, Real::INFINITY, &mut work.spare);
        plan_merges(body, mesh, MOST_CHANGES, load - full, work);
        let needed = BATCH_UPKEEP + SHED_UPKEEP * work.changes.len() as u32;
        if !work.changes.is_empty() && needed > means.allowed {
            return Adapted { saving: true, ..Adapted::default() };
        }
    } else {
        let upkeep = means.allowed.saturating_sub(load).min((budget / UPKEEP_PART).max(BATCH_UPKEEP + each));
        look.wanted_nodes(mesh, ticks, work.finest, &mut work.wanted);
        plan_splits(&look, mesh, most_changes(upkeep, each), full.saturating_sub(load), work);
        if work.changes.is_empty() {
            // What is wanted and does not fit may take the place of what is worth less.
            let limit = work.wanted.first().map_or(adaptivity.merge, |w| 0.5 * w.0);
            look.spare_families(mesh, ticks % INDICATOR_TICKS, INDICATOR_TICKS, limit, &mut work.spare);
            plan_merges(body, mesh, most_changes(upkeep, each), u32::MAX, work);
        }
    }
    if work.changes.is_empty() {
        return Adapted::default();
    }
    let Upkeep { elements, rows, eased } =
        if eases { mesh.apply_under(body, &work.changes, loads) } else { mesh.apply(body, &work.changes) };
    let splits = work.changes.iter().filter(|c| matches!(c, Change::Split(_))).count() as u32;
    Adapted {
        splits,
        merges: work.changes.len() as u32 - splits,
        work: BATCH_UPKEEP + elements * ELEMENT_UPKEEP + rows * ROW_UPKEEP + eased * EASE_UPKEEP,
        saving: false,
    }
}

/// Changes of `each` units that `units` of work pay for.
fn most_changes(units: u32, each: u32) -> usize {
    ((units.saturating_sub(BATCH_UPKEEP) / each) as usize).min(MOST_CHANGES)
}

/// Splits at most `most` nodes whose elements take no more than `room` units of work a tick.
fn plan_splits(look: &Look, mesh: &mut ActiveMesh, most: usize, mut room: u32, work: &mut Workspace) {
    let mut elements = 0;
    for &(_, wanted) in &work.wanted {
        if work.changes.len() >= most {
            break;
        }
        // Neighbours stay within one level: first what has to be split before.
        let mut n = wanted;
        while let Some(before) = mesh.set().first_needed(look.body, n) {
            n = before;
        }
        if work.changes.contains(&Change::Split(n)) {
            continue;
        }
        let added = mesh.added_by_split(look.body, n);
        // Nodes and rows come with them.
        let cost = (added << class_of_level(look.body, n)) * 3 / 2;
        if cost <= room && mesh.has_room(elements + added) {
            room -= cost;
            elements += added;
            work.changes.push(Change::Split(n));
        }
    }
}

/// Class at rest of the level that the children of `n` are on, from any of their elements.
fn class_of_level(body: &Body, n: u32) -> usize {
    let element = body.children(n).first().and_then(|c| body.elements_around(*c).first());
    element.map_or(0, |e| step_class::class_at_rest(body, *e))
}

/// Merges at most `most` families, the least valuable first, until about `excess` units of work a tick are saved.
fn plan_merges(body: &Body, mesh: &ActiveMesh, most: usize, excess: u32, work: &mut Workspace) {
    let (mut saved, mut added) = (0, 0);
    for &(_, parent) in &work.spare {
        if work.changes.len() >= most || saved >= excess {
            break;
        }
        let elements = body.elements_around(parent).len() as u32;
        if mesh.has_room(added + elements) && mesh.set().may_merge(body, parent) {
            added += elements;
            work.changes.push(Change::Merge(parent));
            // A node has about six elements of its own.
            saved += (6 * body.children(parent).len() as u32) << class_of_level(body, parent);
        }
    }
}

/// What decisions look at.
struct Look<'a> {
    body: &'a Body,
    adaptivity: &'a Adaptivity,
    focus: &'a [Focus],
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

    /// How much farther than elsewhere a tool is felt around node `n`.
    fn farther(&self, n: u32) -> Real {
        if self.body.is_uneven(n) { UNEVEN } else { 1.0 }
    }

    /// False where there is nothing finer that may be used.
    fn may_split(&self, n: u32, finest: usize) -> bool {
        self.body.level_of(n) < finest && !self.body.children(n).is_empty()
    }

    /// Nodes worth splitting, of the slices of this tick.
    fn wanted_nodes(&self, mesh: &ActiveMesh, ticks: u64, finest: usize, wanted: &mut Vec<(Real, u32)>) {
        for slot in slice(mesh.active(), ticks % INDICATOR_TICKS, INDICATOR_TICKS) {
            let n = mesh.node(*slot);
            if self.may_split(n, finest) {
                let value = indicator::strain_jump(self.body, mesh, n) / self.adaptivity.split;
                if value > 1.0 {
                    keep(wanted, value.min(TOUCHED), n);
                }
            }
        }
        if self.focus.is_empty() {
            return;
        }
        for slot in slice(mesh.active(), ticks % FOCUS_TICKS, FOCUS_TICKS) {
            let n = mesh.node(*slot);
            if self.may_split(n, finest) {
                let x = mesh.position(*slot);
                let value = self.worth(self.distance(x), self.body.spacing_at(n), self.farther(n));
                if value > 0.0 {
                    keep(wanted, value, n);
                }
            }
        }
    }

    /// Families worth less than `limit`, of slice `part` of `parts`.
    fn spare_families(&self, mesh: &ActiveMesh, part: u64, parts: u64, limit: Real, spare: &mut Vec<(Real, u32)>) {
        for slot in slice(mesh.active(), part, parts) {
            let n = mesh.node(*slot);
            if self.body.level_of(n) == 0 {
                continue;
            }
            let parent = self.body.parent(n);
            let family = self.body.children(parent);
            if family[0] != n || !family.iter().all(|c| mesh.set().is_active(*c)) {
                continue;
            }
            let spacing = self.body.spacing_at(parent);
            let mut distance = Real::INFINITY;
            let mut value: Real = 0.0;
            for &c in family {
                value = value.max(indicator::strain_jump(self.body, mesh, c) / self.adaptivity.split);
                if !self.focus.is_empty() {
                    distance = distance.min(mesh.position_of(c).map_or(Real::INFINITY, |x| self.distance(x)));
                }
            }
            let value = value.min(TOUCHED).max(self.worth(distance, spacing, STAY * self.farther(parent)));
            if value < limit && spare.len() < spare.capacity() {
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
