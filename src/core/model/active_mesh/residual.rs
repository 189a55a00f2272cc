//! Residual forces: what a change of resolution under a load puts out of balance acts no sooner than it has decayed.
//!
//! New nodes lie where the old ones say, strained otherwise than by themselves. Let loose at once, light nodes under a tool
//! would ring for some milliseconds, and the hand would feel it. So every node gets residual forces that leave its
//! acceleration as it was, and that decay. They act within a tick when what they stand for does, or a node would be off its place when its
//! elements are due. They add up to nothing, as those between the elements do, and so do their moments.

use super::contact_row::{Surroundings, at_rest, spacing, support};
use super::estimate::sides;
use super::skin;
use super::{ActiveMesh, ChangeCost, constants, padded, vec3};
use crate::ids::{Element, Node, Slot, Vertex};
use crate::math::{Bounds, Real, Vec3};
use crate::model::active_set::Change;
use crate::model::body::Body;
use crate::model::constraint::PointMemory;
use crate::model::element_kernel::Padded;
use crate::model::element_pool::{CLASSES, ElementConstants, History};
use crate::model::meeting::Meeting;
use crate::model::step_class::Residual;

/// What acts on a body from outside.
#[derive(Clone, Copy, Debug)]
pub struct Loads<'a> {
    /// By tool: the points that it holds.
    pub points: &'a [Vec<PointMemory>],
    /// By obstacle: the points that lie on it.
    pub obstacle_points: &'a [Vec<PointMemory>],
    /// Where organs meet.
    pub meetings: &'a [Meeting],
    /// [m/s²].
    pub gravity: Vec3,
}

impl<'a> Loads<'a> {
    /// Points on tools and obstacles that push.
    pub fn pushing(&self) -> impl Iterator<Item = &'a PointMemory> + use<'a> {
        self.points.iter().chain(self.obstacle_points).flatten().filter(|point| point.multiplier > 0.0)
    }

    /// What all push with together [N].
    pub fn pressed(&self) -> Real {
        let between = self.meetings.iter().filter(|m| m.held).map(|m| m.force.norm());
        self.pushing().map(|point| point.multiplier).chain(between).sum()
    }

    /// [`Constraint::point`](crate::model::Constraint::point)s of what nothing soft is between: obstacles, and organs that meet.
    pub fn hard_points(&self, body: &'a Body) -> impl Iterator<Item = u32> + use<'a> {
        let meeting = self.meetings.iter().filter(|m| m.held).flat_map(|m| m.points(body));
        self.obstacle_points.iter().flatten().map(|p| p.point).chain(meeting)
    }
}

/// The display vertices on which a point hangs, with their weights.
fn stencil(body: &Body, point: &PointMemory) -> [(Vertex, Real); 3] {
    let corners = body.corners_of_point(point.point);
    std::array::from_fn(|i| (corners[i], point.weights[i]))
}

/// Whether one of the `boxes` of changes is nearer to a load than the support of its row.
fn is_near((place, support_squared): &(Vec3, Real), boxes: &[Bounds]) -> bool {
    boxes.iter().any(|around| around.distance_squared(place) < *support_squared)
}

/// What has forces of its own on nodes.
#[derive(Clone, Copy, Debug)]
pub(super) enum Kind {
    Element(Element),
    /// Of this node.
    Star(Node),
}

/// No residual force.
pub(super) const NO_RESIDUAL: Residual<Padded> = [[0.0; 4]; CLASSES];

/// Part of a residual that remains after each tick: a time constant of 7 ms, *tuned*. A residual is dead weight, which does not give
/// way with the body: one that lasts longer crushes what is under a tool, a shorter one lets the change be felt. What contact sees of a
/// change fades as fast: as much as the mesh's dent becomes deeper, what the mesh leaves out of it becomes less.
pub const RESIDUAL_KEPT: Real = 0.87;
/// Over the support of a row, how far points are apart at most for which nodes are gathered together: with less they are gathered for nearly
/// each point, with more each row looks at more nodes than it needs. It decides about time only.
const NEAR: Real = 0.5;
/// Less than this [N] ends at once: so little that the sum of all stays nothing.
const LEAST_RESIDUAL: Real = 1e-15;

impl ActiveMesh {
    /// Notes where `loads` push, for [`ActiveMesh::loads_near`].
    pub fn note_loads(&mut self, body: &Body, loads: &Loads) {
        self.work.loaded.clear();
        for point in loads.pushing().filter(|p| body.patch_of_point(p.point).is_none()) {
            if self.work.loaded.len() < self.work.loaded.capacity() {
                let hangs = stencil(body, point);
                let support = support(body) * spacing(self, hangs);
                self.work.loaded.push((at_rest(body, hangs), support * support));
            }
        }
    }

    /// How many noted loads act on rows that `changes` may alter.
    pub fn loads_near(&mut self, body: &Body, changes: &[Change]) -> u32 {
        self.bound(body, changes);
        self.work.loaded.iter().filter(|load| is_near(load, &self.work.boxes)).count() as u32
    }

    /// Makes `changes` as [`ActiveMesh::apply`] does, under `loads`, which have been noted: those near are weighed by the rows on which they
    /// act where there is time to be `exact`, or by those of the display.
    pub fn apply_under(&mut self, body: &Body, changes: &[Change], loads: &Loads, exact: bool) -> ChangeCost {
        let ChangeCost { residual, .. } = self.estimate(body, changes, true);
        self.work.near.clear();
        self.work.near.extend(self.work.loaded.iter().map(|load| is_near(load, &self.work.boxes)));
        self.add_balance(body, loads, exact, 1.0);
        let cost = self.apply(body, changes);
        self.add_balance(body, loads, exact, -1.0);
        ChangeCost { residual, ..cost }
    }

    /// Whether there are residual forces that have not decayed yet.
    pub fn has_residuals(&self) -> bool {
        self.residuals
    }

    /// The residual force on the active node in `slot` [N].
    pub fn residual(&self, slot: Slot) -> Vec3 {
        self.motion.residual[slot.index()].iter().map(vec3).sum()
    }

    /// Adds to the residuals `sign` times the force on each active node, as far as the concerned elements and `loads` go: by
    /// class of step, so that it acts when that force does.
    fn add_balance(&mut self, body: &Body, loads: &Loads, exact: bool, sign: Real) {
        self.residuals = true;
        for i in 0..self.work.concerned.len() {
            self.add_forces_of(body, Kind::Element(self.work.concerned[i]), sign);
        }
        for i in 0..self.work.concerned_stars.len() {
            self.add_forces_of(body, Kind::Star(self.work.concerned_stars[i]), sign);
        }
        let of_tools = loads.points.iter().flatten().map(|p| p.point);
        let class = self.contact_class(body, of_tools, loads.hard_points(body));
        let mut around = self.work.around.take();
        self.add_contact_forces(body, loads, around.as_mut().filter(|_| exact), class, sign);
        self.work.around = around;
        for &slot in &self.active {
            let s = slot.index();
            if self.motion.inverse_mass[s] > 0.0 {
                let weight = loads.gravity * (self.motion.mass[s] * sign);
                let residual = &mut self.motion.residual[s][class];
                *residual = padded(vec3(residual) + weight);
            }
        }
    }

    /// Adds `force` [N] to the residual of the node in `slot`, with steps of `class`: to its masters', if it is an interface node.
    fn add_residual(&mut self, slot: Slot, class: usize, force: Vec3) {
        let motion = &mut self.motion;
        let mut add = |slot: Slot, weight: Real| {
            if motion.inverse_mass[slot.index()] > 0.0 {
                let residual = &mut motion.residual[slot.index()][class];
                *residual = padded(vec3(residual) + force * weight);
            }
        };
        if self.set.is_active(self.node[slot.index()]) {
            add(slot, 1.0);
        } else {
            self.row[slot.index()].entries().for_each(|(master, weight)| add(master, weight));
        }
    }

    /// Adds `sign` times its forces to the residuals of the nodes of an element, if it is in use.
    fn add_forces_of(&mut self, body: &Body, kind: Kind, sign: Real) {
        if let Some(class) = self.weigh_element(body, kind) {
            for i in 0..self.work.weighed.len() {
                let (slot, force) = self.work.weighed[i];
                self.add_residual(slot, class, force * sign);
            }
        }
    }

    /// Lists the forces on the nodes of an element [N]; its step class. `None` unless it is in use.
    fn weigh_element(&mut self, body: &Body, kind: Kind) -> Option<usize> {
        match kind {
            Kind::Element(e) => {
                let (class, history) = (self.pool.class_of(e)?, self.pool.history(e)?);
                let slots = body.element(e).map(|n| self.slot[n.index()]);
                let constants = constants(body, self.material_of(body, e), e, self.active_vertices[e.index()]);
                self.list_forces(body, &slots, &constants, &history);
                Some(class)
            }
            Kind::Star(n) => {
                let (class, history) = (self.stars.class_of(n)?, self.stars.history(n)?);
                self.note_star(body, n);
                let slots = std::mem::take(&mut self.work.star);
                self.list_forces(body, &slots, &self.star_constants(body, n), &history);
                self.work.star = slots;
                Some(class)
            }
        }
    }

    fn list_forces(
        &mut self,
        body: &Body,
        slots: &[Slot],
        constants: &ElementConstants<impl AsRef<[[Real; 3]]>>,
        history: &History,
    ) {
        let f = self.deformation(constants, slots);
        let moduli = body.maxwell().iter().map(|b| b.modulus * self.damping);
        let stress = constants.stress(&f, moduli, history);
        let forces = constants.forces(&f, &stress);
        let weighed = &mut self.work.weighed;
        weighed.clear();
        weighed.extend(slots.first().map(|slot| (*slot, Vec3::zeros())));
        weighed.extend(slots.iter().copied().skip(1).zip(forces));
        let sum: Vec3 = weighed.iter().map(|(_, force)| force).sum();
        if let Some((_, first)) = weighed.first_mut() {
            *first = -sum;
        }
    }

    /// Adds `sign` times the contact forces: by the rows on which they act, with what is `around`, or by those of the display.
    fn add_contact_forces(
        &mut self,
        body: &Body,
        loads: &Loads,
        mut around: Option<&mut Surroundings>,
        class: usize,
        sign: Real,
    ) {
        if let Some(around) = around.as_deref_mut() {
            around.forget();
        }
        let mut gathered: Option<Vec3> = None;
        let mut number = 0;
        for point in loads.pushing() {
            let patch = body.patch_of_point(point.point);
            number += usize::from(patch.is_none());
            // What hangs as before would cancel.
            if patch.is_none() && !self.work.near.get(number - 1).is_some_and(|near| *near) {
                continue;
            }
            let hangs = stencil(body, point);
            let fitted = around.as_deref_mut().filter(|_| patch.is_none()).and_then(|around| {
                let (at, support) = (at_rest(body, hangs), support(body) * spacing(self, hangs));
                if gathered.is_none_or(|from| (at - from).norm() > NEAR * support) {
                    around.gather(body, self, hangs[0].0, at, (1.0 + NEAR) * support);
                    gathered = Some(at);
                }
                around.row(at, support)
            });
            let own = if hangs[0].1 == 1.0 { &hangs[..1] } else { &hangs };
            let row = fitted.unwrap_or_else(|| skin::row(self, patch.unwrap_or(own)).0);
            let on_body = (point.normal * point.multiplier + point.tangential) * sign;
            row.entries().iter().for_each(|(slot, b)| self.add_residual(*slot, class, on_body * *b));
        }
        for m in loads.meetings.iter().filter(|m| m.force != Vec3::zeros()) {
            let (corners, force) = (body.triangle(m.triangle), m.force * sign);
            let place: [(Vertex, Real); 3] = std::array::from_fn(|i| (corners[i], m.weights[i]));
            for (side, force) in [(body.patches().of(m.patch), force), (&place[..], -force)] {
                let (row, _) = skin::row(self, side);
                row.entries().iter().for_each(|(slot, b)| self.add_residual(*slot, class, force * *b));
            }
        }
    }

    /// Sums the residuals of the nodes that `changes` take away, for those that come.
    pub(super) fn collect_residuals(&mut self, body: &Body, changes: &[Change]) {
        self.work.handed.clear();
        for change in changes {
            let slots = sides(body, change).0.iter().map(|n| self.slot[n.index()].index());
            let sum = |class: usize| slots.clone().map(|s| vec3(&self.motion.residual[s][class])).sum();
            self.work.handed.push(std::array::from_fn(sum));
        }
    }

    /// Shares these among the nodes that come, as their masses.
    pub(super) fn hand_residuals_over(&mut self, body: &Body, changes: &[Change]) {
        for (change, handed) in changes.iter().zip(&self.work.handed) {
            let slots = || sides(body, change).1.iter().map(|n| self.slot[n.index()].index());
            let mass: Real = slots().map(|s| self.motion.mass[s]).sum();
            for s in sides(body, change).1.iter().map(|n| self.slot[n.index()].index()) {
                self.motion.residual[s] = handed.map(|held| padded(held * (self.motion.mass[s] / mass)));
            }
        }
    }

    /// An element is to go over to steps of `class`: its share of the residuals goes along, so that it acts with its forces.
    pub(super) fn move_residual(&mut self, body: &Body, kind: Kind, class: usize) {
        let held = |n: &Node| self.motion.residual[self.slot[n.index()].index()] != NO_RESIDUAL;
        let is_concerned = match kind {
            Kind::Element(e) => body.element(e).iter().any(held),
            Kind::Star(n) => body.neighbours(n).iter().any(held),
        };
        if !is_concerned {
            return;
        }
        let Some(from) = self.weigh_element(body, kind) else { return };
        // Of the residuals there, the part along this element's forces.
        let weighed = std::mem::take(&mut self.work.weighed);
        let residual = |slot: Slot| vec3(&self.motion.residual[slot.index()][from]);
        let held: Real = weighed.iter().map(|(slot, force)| -residual(*slot).dot(force)).sum();
        let whole: Real = weighed.iter().map(|(_, force)| force.norm_squared()).sum();
        if from != class && held > 0.0 {
            let part = (held / whole).min(1.0);
            for &(slot, force) in &weighed {
                self.add_residual(slot, from, force * part);
                self.add_residual(slot, class, force * -part);
            }
        }
        self.work.weighed = weighed;
    }

    /// Decays the residuals by one tick in which the body moved.
    pub fn decay_residuals(&mut self) {
        if !self.residuals {
            return;
        }
        self.residuals = false;
        for &slot in &self.active {
            for e in self.motion.residual[slot.index()].as_flattened_mut() {
                *e = if e.abs() > LEAST_RESIDUAL { *e * RESIDUAL_KEPT } else { 0.0 };
                self.residuals |= *e != 0.0;
            }
        }
    }
}
