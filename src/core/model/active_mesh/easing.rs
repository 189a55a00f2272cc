//! Changes of resolution under a load: what they put out of balance is held at first, and let go little by little.
//!
//! New nodes lie where the old ones say, strained otherwise than by themselves. Let loose at once, light nodes under a tool
//! would ring for some milliseconds, and the hand would feel it. So every node gets forces that leave its acceleration as it
//! was, and that fade. They act within a tick when what they stand for does, or a node would be off its place when its
//! elements are due. They add up to nothing, as those between the elements do, and so do their moments.

use super::foresight::sides;
use super::skin;
use super::{ActiveMesh, Upkeep, constants, padded, vec3};
use crate::ids::{Element, Node, Slot, Vertex};
use crate::math::{Real, Vec3};
use crate::model::active_set::Change;
use crate::model::body::Body;
use crate::model::constraint::PointMemory;
use crate::model::element_kernel::Padded;
use crate::model::element_pool::CLASSES;
use crate::model::step_class::Ease;

/// What acts on a body from outside.
#[derive(Clone, Copy, Debug)]
pub struct Loads<'a> {
    /// By tool: the points that it holds.
    pub points: &'a [Vec<PointMemory>],
    /// [m/s²].
    pub gravity: Vec3,
}

/// Nothing held.
pub(super) const NO_EASE: Ease<Padded> = [[0.0; 4]; CLASSES];

/// Part of what is held that is let go of in a tick: a time constant of 25 ms. What is held is dead weight, and does not give
/// way with the body: for longer, and it crushes what is under a tool.
const EASED: Real = 0.04;
/// Less than this [N] is let go at once: so little that the sum of all stays nothing.
const LEAST_EASE: Real = 1e-15;

impl ActiveMesh {
    /// Makes `changes` as [`ActiveMesh::apply`] does, under `loads`.
    pub fn apply_under(&mut self, body: &Body, changes: &[Change], loads: &Loads) -> Upkeep {
        let Upkeep { eased, .. } = self.foresee(body, changes, true);
        self.add_balance(body, loads, 1.0);
        let upkeep = self.apply(body, changes);
        self.add_balance(body, loads, -1.0);
        Upkeep { eased, ..upkeep }
    }

    /// Whether there are residual forces that have not decayed yet.
    pub fn has_eases(&self) -> bool {
        self.eases
    }

    /// What is held on the active node in `slot` [N].
    pub fn eased(&self, slot: Slot) -> Vec3 {
        self.motion.ease[slot.index()].iter().map(vec3).sum()
    }

    /// Adds to what is held `sign` times what accelerates each active node, as far as the concerned elements and `loads` go:
    /// by class of step, so that it acts when what it stands for does.
    fn add_balance(&mut self, body: &Body, loads: &Loads, sign: Real) {
        self.eases = true;
        for i in 0..self.work.concerned.len() {
            let e = self.work.concerned[i];
            if let Some((class, slots, forces)) = self.weigh_element(body, e) {
                (0..4).for_each(|i| self.hold_on(slots[i], class, forces[i] * sign));
            }
        }
        let class = self.contact_class(body, loads.points.iter().flatten().map(|p| p.point));
        self.hold_points(body, loads, class, sign);
        for &slot in &self.active {
            let s = slot.index();
            if self.motion.inverse_mass[s] > 0.0 {
                let weight = loads.gravity * (self.motion.mass[s] * sign);
                let ease = &mut self.motion.ease[s][class];
                *ease = padded(vec3(ease) + weight);
            }
        }
    }

    /// Holds `force` [N] more on the node in `slot`, with steps of `class`: on its masters, if it is an interface node.
    fn hold_on(&mut self, slot: Slot, class: usize, force: Vec3) {
        let motion = &mut self.motion;
        let mut hold = |slot: Slot, weight: Real| {
            if motion.inverse_mass[slot.index()] > 0.0 {
                let ease = &mut motion.ease[slot.index()][class];
                *ease = padded(vec3(ease) + force * weight);
            }
        };
        if self.set.is_active(self.node[slot.index()]) {
            hold(slot, 1.0);
        } else {
            self.row[slot.index()].entries().for_each(|(master, weight)| hold(master, weight));
        }
    }

    /// Class of what is held of element `e`, its nodes' slots and the forces on them [N]; `None` unless it is in use.
    fn weigh_element(&self, body: &Body, e: Element) -> Option<(usize, [Slot; 4], [Vec3; 4])> {
        let class = self.pool.class_of(e)?;
        let history = self.pool.history(e)?;
        let slots = body.element(e).map(|n| self.slot[n.index()]);
        let x = slots.map(|slot| vec3(&self.motion.position[slot.index()]));
        let constants = constants(body, e, self.active_vertices[e.index()]);
        let f = constants.deformation(&x);
        let forces = constants.forces(&f, &constants.stress(&f, body.maxwell().iter().map(|b| b.modulus), &history));
        Some((class, slots, forces))
    }

    /// Holds `sign` times what the tools' points press with.
    fn hold_points(&mut self, body: &Body, loads: &Loads, class: usize, sign: Real) {
        for point in loads.points.iter().flatten().filter(|p| p.multiplier > 0.0) {
            let on_body = (point.normal * point.multiplier + point.tangential) * sign;
            let corners = body.corners_of_point(point.point);
            let stencil: [(Vertex, Real); 3] = std::array::from_fn(|i| (corners[i], point.weights[i]));
            let row = skin::row(self, if corners[0] == corners[1] { &stencil[..1] } else { &stencil }).0;
            row.entries().iter().for_each(|(slot, b)| self.hold_on(*slot, class, on_body * *b));
        }
    }

    /// What was held on the nodes that `changes` take away, to be taken over by those that come.
    pub(super) fn collect_eases(&mut self, body: &Body, changes: &[Change]) {
        self.work.handed.clear();
        for change in changes {
            let slots = sides(body, change).0.iter().map(|n| self.slot[n.index()].index());
            let sum = |class: usize| slots.clone().map(|s| vec3(&self.motion.ease[s][class])).sum();
            self.work.handed.push(std::array::from_fn(sum));
        }
    }

    /// Hands it to them, in parts as their masses.
    pub(super) fn hand_eases_over(&mut self, body: &Body, changes: &[Change]) {
        for (change, handed) in changes.iter().zip(&self.work.handed) {
            let slots = || sides(body, change).1.iter().map(|n| self.slot[n.index()].index());
            let mass: Real = slots().map(|s| self.motion.mass[s]).sum();
            for s in sides(body, change).1.iter().map(|n| self.slot[n.index()].index()) {
                self.motion.ease[s] = handed.map(|held| padded(held * (self.motion.mass[s] / mass)));
            }
        }
    }

    /// Element `e` is to go over to steps of `class`: what is held of its forces goes along, so that it acts with them.
    pub(super) fn hand_ease_on(&mut self, body: &Body, e: Element, class: usize) {
        let ease = |mesh: &Self, n: Node, class: usize| mesh.motion.ease[mesh.slot[n.index()].index()][class];
        let eased = |n: &Node| (0..CLASSES).any(|class| ease(self, *n, class) != [0.0; 4]);
        if !body.element(e).iter().any(eased) {
            return;
        }
        let Some((from, slots, forces)) = self.weigh_element(body, e) else { return };
        // Of what is held there, the part that looks like this element's.
        let nodes = body.element(e);
        let held: Real = nodes.iter().zip(&forces).map(|(n, f)| -vec3(&ease(self, *n, from)).dot(f)).sum();
        let whole: Real = forces.iter().map(Vec3::norm_squared).sum();
        if from == class || held <= 0.0 {
            return;
        }
        let part = (held / whole).min(1.0);
        for (slot, force) in slots.into_iter().zip(forces) {
            self.hold_on(slot, from, force * part);
            self.hold_on(slot, class, force * -part);
        }
    }

    /// Lets go a little of what is held, by one tick in which the body moved.
    pub fn ease_off(&mut self) {
        if !self.eases {
            return;
        }
        self.eases = false;
        for &slot in &self.active {
            for e in self.motion.ease[slot.index()].as_flattened_mut() {
                *e = if e.abs() > LEAST_EASE { *e * (1.0 - EASED) } else { 0.0 };
                self.eases |= *e != 0.0;
            }
        }
    }
}
