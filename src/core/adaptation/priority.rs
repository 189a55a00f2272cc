//! Which nodes to split and which families to merge first: by strain jump, and by the distance from tools.

use super::indicator;
use super::{Adaptivity, INDICATOR_LOOKS, LOOK_TICKS, MOST_CHANGES};
use crate::ids::{Node, Slot};
use crate::math::{Bounds, Real, Vec3};
use crate::model::meeting::Meeting;
use crate::model::{ActiveMesh, Body};
use crate::stepping::work::Prices;

/// Where resolution is wanted: around a tool, where it is or where its velocity takes it, or around a patch that presses on another
/// organ.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Focus {
    /// Start of the axis [m].
    pub from: Vec3,
    /// Its end [m].
    pub to: Vec3,
    /// The radius around it [m].
    pub radius: Real,
}

impl Focus {
    /// Around the place where organs meet.
    pub fn of_meeting(body: &Body, mesh: &ActiveMesh, m: &Meeting) -> Self {
        let corners = body.triangle(m.triangle).into_iter().zip(m.weights);
        let place = corners.map(|(v, w)| mesh.vertex(v) * w).sum();
        Self { from: place, to: place, radius: body.patches().radius(m.patch) }
    }

    /// Distance of `p` from the surface around it [m], negative inside.
    fn distance(&self, p: Vec3) -> Real {
        let along = self.to - self.from;
        let squared = along.norm_squared();
        let t = if squared > 0.0 { ((p - self.from).dot(&along) / squared).clamp(0.0, 1.0) } else { 0.0 };
        (p - (self.from + along * t)).norm() - self.radius
    }
}

/// A family near a tool stays refined up to this much farther away than it was refined at.
const STAY: Real = 1.3;
/// Where the material is heterogeneous, nodes are split from this much farther away: large elements show too little of what is
/// smaller than they are, and what they show is felt from afar.
const HETEROGENEOUS: Real = 1.5;
/// Values from here on are those of nodes that a tool is close to, and the most that strain alone gives: at the limit of
/// the budget it gives way to touch.
pub(super) const TOUCHED: Real = 2.0;
const STRAINED: Real = 1.9;
/// Most that a node has whose organ presses on another there: strain gives way to it, and it to touch. Any number between the two orders them
/// so; at either end they would be alike.
const MET: Real = 1.95;

/// What priorities of splits and merges follow from.
pub(super) struct Priorities<'a> {
    pub(super) body: &'a Body,
    pub(super) adaptivity: &'a Adaptivity,
    /// Around tools, ...
    pub(super) focus: &'a [Focus],
    /// ... and around organs that press each other.
    pub(super) met: &'a [Focus],
    pub(super) prices: &'a Prices,
    /// Nodes with a larger residual force than this [N] are not changed again, [`super::UNSETTLED`].
    pub(super) settled: Real,
}

impl Priorities<'_> {
    /// Boxes around all places closer than `distance` [m] to a tool, and to organs that press each other.
    fn near(&self, distance: Real) -> [Bounds; 2] {
        [self.focus, self.met].map(|focus| {
            let ends = focus.iter().flat_map(|f| [(f.from, f.radius), (f.to, f.radius)]);
            let around = |(end, radius): (Vec3, Real)| Bounds { low: end, high: end }.grown(radius + distance);
            ends.map(around).fold(Bounds::NOTHING, |all, one| all.joined(&one))
        })
    }

    /// Priority of any of the `places` [m] for what is around on a level of `spacing`, which is reached from so much `farther` than usual:
    /// none out of reach, and the more the closer they are, [`TOUCHED`] and above for tools.
    fn priority(&self, places: impl Iterator<Item = Vec3> + Clone, spacing: Real, farther: Real) -> Real {
        let reach = self.adaptivity.reach * spacing * farther;
        let near = |focus: &[Focus]| {
            let distances = places.clone().flat_map(|p| focus.iter().map(move |f| f.distance(p)));
            let distance = distances.fold(Real::INFINITY, Real::min);
            (distance < reach).then(|| 1.0 - distance / reach)
        };
        let touched = || near(self.focus).map(|near| TOUCHED + near.min(2.0));
        let met = || near(self.met).map(|near| STRAINED + (MET - STRAINED) * near.min(1.0));
        touched().or_else(met).unwrap_or(0.0)
    }

    /// The widest spacing of any level [m].
    fn widest(&self) -> Real {
        self.body.organs().iter().flat_map(|o| &o.levels).map(|l| l.spacing).fold(0.0, Real::max)
    }

    /// How much farther than elsewhere what presses is felt around node `n`.
    fn farther(&self, n: Node) -> Real {
        if self.body.is_heterogeneous(n) { HETEROGENEOUS } else { 1.0 }
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
    pub(super) fn split_candidates(
        &self,
        mesh: &ActiveMesh,
        ticks: u64,
        finest: usize,
        split_candidates: &mut Vec<(Real, Node)>,
    ) {
        for slot in slice(mesh.active(), ticks / (2 * LOOK_TICKS) % INDICATOR_LOOKS, INDICATOR_LOOKS) {
            let n = mesh.node(*slot);
            if self.may_split(n, finest) && self.is_settled(mesh, *slot) {
                let value = indicator::strain_jump(self.body, mesh, n).unwrap_or_default() / self.adaptivity.split;
                if value > 1.0 && self.can_strain(n) {
                    keep(split_candidates, value.min(STRAINED), n);
                }
            }
        }
        if self.focus.is_empty() && self.met.is_empty() {
            return;
        }
        let near = self.near(self.adaptivity.reach * HETEROGENEOUS * self.widest());
        for slot in mesh.active() {
            // Most nodes around a tool are as fine as may be, and most others are far away.
            let n = mesh.node(*slot);
            if self.body.level_of(n) >= finest {
                continue;
            }
            let p = mesh.position(*slot);
            if near.iter().all(|near| !near.contains(&p)) {
                continue;
            }
            if self.may_split(n, finest) && self.is_settled(mesh, *slot) {
                let value = self.priority(std::iter::once(p), self.body.spacing_at(n), self.farther(n));
                if value > 0.0 {
                    keep(split_candidates, value, n);
                }
            }
        }
    }

    pub(super) fn is_settled(&self, mesh: &ActiveMesh, slot: Slot) -> bool {
        mesh.residual(slot).norm_squared() <= self.settled * self.settled
    }

    /// Families of a lower priority than `limit` whose first child is in one of the `slots`.
    pub(super) fn merge_candidates<'s>(
        &self,
        mesh: &ActiveMesh,
        slots: impl Iterator<Item = &'s Slot>,
        limit: Real,
        merge_candidates: &mut Vec<(Real, Node)>,
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
            let places = family.iter().filter_map(|c| mesh.position_of(*c));
            let touch = self.priority(places, spacing, STAY * self.farther(parent));
            // Strain takes a while to weigh, and a family whose priority is too high anyhow is not asked for more.
            if touch >= limit || merge_candidates.len() == merge_candidates.capacity() {
                continue;
            }
            let jump = |most: Real, c: &Node| Some(most.max(indicator::strain_jump(self.body, mesh, *c)?));
            let strain = family.iter().try_fold(0.0, jump).unwrap_or_default() / self.adaptivity.split;
            let value = touch.max(strain.min(STRAINED));
            if value < limit {
                merge_candidates.push((value, parent));
            }
        }
        merge_candidates.sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
    }
}

/// Slice `part` of `parts` of `all`.
pub(super) fn slice<T>(all: &[T], part: u64, parts: u64) -> &[T] {
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
