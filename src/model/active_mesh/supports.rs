//! Supports: the springs that hold the displayed surface in space, folded into the elements that carry it.
//!
//! A spring of stiffness `k_h` pulls the displayed point `Σ_j w_hj x_j + d_h` of one element (`d_h` its geomorph offset) to
//! its place at rest `X_h`. All springs of an element together give its node `i` the force
//! `f_i = c_i − Σ_j K_ij x_j`, `K_ij = Σ_h k_h w_hi w_hj`, `c_i = Σ_h k_h w_hi (X_h − d_h)`: the sum over springs is made
//! when they come to be carried by other elements, not in every step.

use super::ActiveMesh;
use crate::math::Real;
use crate::model::body::{Body, NONE};
use crate::model::element_kernel::Padded;

/// The springs of one element.
#[derive(Clone, Copy, Debug)]
pub(super) struct Support {
    /// Slots of the element's nodes.
    slots: [u32; 4],
    /// `K` [N/m].
    stiffness: [[Real; 4]; 4],
    /// `c` without geomorph offsets [N].
    rest: [Padded; 4],
    /// `c` [N].
    pull: [Padded; 4],
    /// `Σ_h k_h |w_hi| |w_hj|` [N/m].
    bound: [[Real; 4]; 4],
}

/// All supports of a body as it moves.
#[derive(Debug)]
pub(super) struct Supports {
    list: Vec<Support>,
    /// By element: its place in the list, or [`NONE`].
    of_element: Vec<u32>,
    /// Springs whose displayed point has a geomorph offset, and their places in the list.
    offset: Vec<(u32, u32)>,
    /// By display vertex: whether a spring holds it.
    held: Vec<bool>,
}

impl Supports {
    /// Room for the springs of `body`.
    pub(super) fn new(body: &Body) -> Self {
        let springs = body.holds().len();
        let elements = if springs > 0 { body.element_count() } else { 0 };
        let mut held = vec![false; body.surface().vertices.len()];
        body.holds().iter().for_each(|hold| held[hold.vertex as usize] = true);
        Self {
            list: Vec::with_capacity(springs),
            of_element: vec![NONE; elements],
            offset: Vec::with_capacity(springs),
            held,
        }
    }
}

impl ActiveMesh {
    /// Folds all springs into the elements that carry them now.
    pub(super) fn fold_supports(&mut self, body: &Body) {
        let Self { supports: Supports { list, of_element, offset, .. }, attachment, fade, .. } = self;
        list.clear();
        offset.clear();
        for (h, hold) in body.holds().iter().enumerate() {
            let a = &attachment[hold.vertex as usize];
            let place = &mut of_element[a.element as usize];
            if list.get(*place as usize).is_none_or(|s| s.slots != a.slots) {
                *place = list.len() as u32;
                let (none, rest) = ([[0.0; 4]; 4], [[0.0; 4]; 4]);
                list.push(Support { slots: a.slots, stiffness: none, rest, pull: rest, bound: none });
            }
            let support = &mut list[*place as usize];
            let rest = body.surface().vertices[hold.vertex as usize];
            for i in 0..4 {
                let k = hold.stiffness * a.weights[i];
                for j in 0..4 {
                    support.stiffness[i][j] += k * a.weights[j];
                    support.bound[i][j] += (k * a.weights[j]).abs();
                }
                (0..3).for_each(|c| support.rest[i][c] += k * rest[c]);
            }
            if fade[hold.vertex as usize] != [0.0; 4] {
                offset.push((h as u32, *place));
            }
        }
        list.iter_mut().for_each(|s| s.pull = s.rest);
        self.follow_offsets(body);
    }

    /// Whether one of the display vertices is held by a spring.
    pub(super) fn holds_any(&self, vertices: &[u32]) -> bool {
        vertices.iter().any(|v| self.supports.held[*v as usize])
    }

    /// Bounds what the supports add to `ω²`: `Σ_h k |b_j| Σ_i |b_i| / m_j` by row sums, the rows of interface nodes with
    /// their amplification.
    pub(super) fn weigh_supports(&mut self) {
        if self.supports.list.is_empty() {
            return;
        }
        self.active.iter().for_each(|s| self.springs[*s as usize] = 0.0);
        for support in &self.supports.list {
            let amplifies = |s: u32| if self.is_master(s) { 1.0 } else { self.row[s as usize].amplification() };
            let amplification = support.slots.map(amplifies);
            for (slot, bound) in support.slots.iter().zip(&support.bound) {
                let stiffness: Real = bound.iter().zip(&amplification).map(|(b, a)| b * a).sum();
                if self.is_master(*slot) {
                    self.springs[*slot as usize] += stiffness * self.motion.inverse_mass[*slot as usize];
                } else {
                    for (master, p) in self.row[*slot as usize].entries() {
                        self.springs[master as usize] +=
                            stiffness * p.abs() * self.motion.inverse_mass[master as usize];
                    }
                }
            }
        }
        self.stiffest_spring = self.active.iter().map(|s| self.springs[*s as usize]).fold(0.0, Real::max);
    }

    /// Supports follow the geomorph offsets of this tick.
    pub fn follow_offsets(&mut self, body: &Body) {
        let Self { supports: Supports { list, offset, .. }, attachment, fade, .. } = self;
        for &(_, place) in offset.iter() {
            let support = &mut list[place as usize];
            support.pull = support.rest;
        }
        offset.retain(|&(h, place)| {
            let hold = body.holds()[h as usize];
            let (away, weights) = (&fade[hold.vertex as usize], &attachment[hold.vertex as usize].weights);
            for (pull, w) in list[place as usize].pull.iter_mut().zip(weights) {
                (0..3).for_each(|c| pull[c] -= hold.stiffness * w * away[c]);
            }
            *away != [0.0; 4]
        });
    }

    /// Elements that carry supports.
    pub fn support_count(&self) -> usize {
        self.supports.list.len()
    }

    /// Slots of the nodes that supports pull at, four for each element.
    pub fn supported(&self) -> impl Iterator<Item = u32> + '_ {
        self.supports.list.iter().flat_map(|support| support.slots)
    }

    /// Adds the forces of the supports to [`super::Motion::force`].
    pub fn add_supports(&mut self) {
        for support in &self.supports.list {
            let x = support.slots.map(|s| self.motion.position[s as usize]);
            for (i, slot) in support.slots.iter().enumerate() {
                let force = &mut self.motion.force[*slot as usize];
                let k = &support.stiffness[i];
                for c in 0..4 {
                    let held = k[0] * x[0][c] + k[1] * x[1][c] + k[2] * x[2][c] + k[3] * x[3][c];
                    force[c] += support.pull[i][c] - held;
                }
            }
        }
    }

    /// What a step of the supports needs [1/s²]: bound on their share of `ω²` at any node.
    pub fn stiffest_spring(&self) -> Real {
        self.stiffest_spring
    }
}
