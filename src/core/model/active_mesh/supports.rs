//! Supports: the springs that hold the displayed surface in space, folded into the elements that carry it.
//!
//! A spring of stiffness `k_h` pulls the displayed point `Σ_j w_hj x_j + d_h` of one element (`d_h` its geomorph offset) to
//! its place at rest `X_h`, or to where that has been [moved](ActiveMesh::move_supports) to. All springs of an element together
//! give its node `i` the force `f_i = c_i − Σ_j K_ij x_j`, `K_ij = Σ_h k_h w_hi w_hj`, `c_i = Σ_h k_h w_hi (X_h − d_h)`: the sum over springs is made
//! when they come to be carried by other elements, not in every step.

use super::ActiveMesh;
use crate::ids::{Element, Slot, Vertex};
use crate::math::{Real, Vec3};
use crate::model::body::Body;
use crate::model::csr::Csr;
use crate::model::element_kernel::Padded;
use crate::model::step_class::class_in;

/// The springs of one element.
#[derive(Clone, Copy, Debug)]
struct Support {
    /// Slots of the element's nodes.
    slots: [Slot; 4],
    /// `K` [N/m].
    stiffness: [[Real; 4]; 4],
    /// `c` without geomorph offsets and of springs that do not move [N].
    rest: [Padded; 4],
    /// `c` [N].
    pull: [Padded; 4],
    /// `Σ_h k_h |w_hi| |w_hj|` [N/m].
    bound: [[Real; 4]; 4],
}

/// All supports of a body as it moves.
#[derive(Debug)]
pub(super) struct Supports {
    /// Elements that carry springs, ascending, and their places in `room`: sums do not depend on which came first.
    order: Vec<(Element, u32)>,
    room: Vec<Support>,
    /// Places in `room` that are not in use.
    free: Vec<u32>,
    /// Springs that move or whose displayed point has a geomorph offset, ascending, and the places in `room` they are folded into.
    offset: Vec<(u32, u32)>,
    /// Springs by display vertex.
    springs: Csr<u32>,
    /// Elements that carry other springs than before.
    changed: Vec<Element>,
    /// Springs of one element.
    carried: Vec<u32>,
    /// Factor on the stiffness of all springs.
    factor: Real,
    /// By spring: number of those that it moves with.
    moves_with: Vec<Option<u16>>,
    /// How far these have moved [m].
    moved: Vec<Vec3>,
}

impl Supports {
    /// Room for the springs of `body`.
    pub(super) fn new(body: &Body) -> Self {
        let springs = body.supports().len();
        let by_vertex = body.supports().iter().zip(0..).map(|(hold, h)| (hold.vertex.index(), h));
        Self {
            order: Vec::with_capacity(springs),
            room: Vec::with_capacity(springs),
            free: Vec::with_capacity(springs),
            offset: Vec::with_capacity(2 * springs),
            springs: Csr::new(body.surface().vertices.len(), by_vertex),
            changed: Vec::with_capacity(2 * springs),
            carried: Vec::with_capacity(2 * springs),
            factor: 1.0,
            moves_with: vec![None; springs],
            moved: Vec::new(),
        }
    }

    fn iter(&self) -> impl Iterator<Item = &Support> {
        self.order.iter().map(|(_, place)| &self.room[*place as usize])
    }

    /// Where the support of `element`, which has one, is in `room`.
    fn place_of(order: &[(Element, u32)], element: Element) -> u32 {
        order.binary_search_by_key(&element, |(e, _)| *e).map_or(0, |at| order[at].1)
    }

    /// Display vertex `v` hangs on `now` and hung on `before`.
    pub(super) fn rehang(&mut self, v: Vertex, before: Element, now: Element) {
        if !self.springs.of(v.index()).is_empty() {
            self.changed.extend([before, now]);
        }
    }

    /// Display vertex `v` has a geomorph offset now.
    pub(super) fn displace(&mut self, v: Vertex) {
        self.offset.extend(self.springs.of(v.index()).iter().map(|h| (*h, 0)));
    }
}

impl ActiveMesh {
    /// Factor on the stiffness of all springs.
    pub fn support_factor(&self) -> Real {
        self.supports.factor
    }

    /// Makes all springs `factor` times as stiff as prepared, 1 at most: elements may keep their steps. Allocates nothing.
    pub fn set_support_factor(&mut self, body: &Body, factor: Real) {
        self.supports.factor = factor;
        self.fold_all_supports(body);
        self.weigh_supports();
    }

    /// The same before [`ActiveMesh::restore`], which folds them.
    pub(crate) fn assume_support_factor(&mut self, factor: Real) {
        self.supports.factor = factor;
    }

    /// Has the supports of each of these lists, of numbers among [`Body::supports`], move together from now on.
    pub fn join_supports(&mut self, body: &Body, together: &[Vec<u32>]) {
        self.supports.moved = vec![Vec3::zeros(); together.len()];
        for (number, all) in (0..).zip(together) {
            all.iter().for_each(|h| self.supports.moves_with[*h as usize] = Some(number));
        }
        self.fold_all_supports(body);
    }

    /// The supports of list `number` are this far from where they were at rest [m], before [`ActiveMesh::follow_offsets`] or
    /// [`ActiveMesh::restore`].
    pub fn move_supports(&mut self, number: usize, moved: Vec3) {
        self.supports.moved[number] = moved;
    }

    /// Folds all springs into the elements that carry them now.
    pub(super) fn fold_all_supports(&mut self, body: &Body) {
        let Self { supports, embedded, geomorph, .. } = self;
        supports.order.clear();
        supports.room.clear();
        supports.free.clear();
        supports.offset.clear();
        for v in body.supports().iter().map(|hold| hold.vertex) {
            let element = embedded[v.index()].element;
            if supports.changed.last() != Some(&element) {
                supports.changed.push(element);
            }
        }
        let is_off =
            |h: usize, vertex: Vertex| supports.moves_with[h].is_some() || geomorph[vertex.index()] != [0.0; 4];
        let off = (0..).zip(body.supports()).filter(|(h, hold)| is_off(*h as usize, hold.vertex));
        supports.offset.extend(off.map(|(h, _)| (h, 0)));
        self.fold_supports(body);
    }

    /// Folds springs into elements that carry others than before.
    pub(super) fn fold_supports(&mut self, body: &Body) {
        let Self { supports, embedded, extrapolated, .. } = self;
        supports.changed.sort_unstable();
        supports.changed.dedup();
        let Supports { order, room, free, offset, springs, changed, carried, factor, .. } = supports;
        order.retain(|(element, place)| {
            let stays = changed.binary_search(element).is_err();
            if !stays {
                free.push(*place);
            }
            stays
        });
        for &e in changed.iter() {
            carried.clear();
            let hangs = body.hosted(e).iter().chain(extrapolated.iter()).filter(|v| embedded[v.index()].element == e);
            carried.extend(hangs.flat_map(|v| springs.of(v.index())));
            carried.sort_unstable();
            carried.dedup();
            let Some(first) = carried.first() else { continue };
            let slots = embedded[body.supports()[*first as usize].vertex.index()].slots;
            let (none, rest) = ([[0.0; 4]; 4], [[0.0; 4]; 4]);
            let mut support = Support { slots, stiffness: none, rest, pull: rest, bound: none };
            for &h in carried.iter() {
                let hold = body.supports()[h as usize];
                let weights = &embedded[hold.vertex.index()].weights;
                let rest = body.surface().vertices[hold.vertex.index()];
                for (i, w) in weights.iter().enumerate() {
                    let k = *factor * hold.stiffness * w;
                    for (j, v) in weights.iter().enumerate() {
                        support.stiffness[i][j] += k * v;
                        support.bound[i][j] += (k * v).abs();
                    }
                    (0..3).for_each(|c| support.rest[i][c] += k * rest[c]);
                }
            }
            support.pull = support.rest;
            let place = free.pop().unwrap_or(room.len() as u32);
            match room.get_mut(place as usize) {
                Some(old) => *old = support,
                None => room.push(support),
            }
            let at = order.partition_point(|(element, _)| *element < e);
            order.insert(at, (e, place));
        }
        changed.clear();
        offset.sort_unstable();
        offset.dedup_by_key(|(h, _)| *h);
        let element = |h: u32| embedded[body.supports()[h as usize].vertex.index()].element;
        offset.iter_mut().for_each(|(h, place)| *place = Supports::place_of(order, element(*h)));
        self.follow_offsets(body);
    }

    /// Bounds what the supports add to `ω²`: `Σ_h k |b_j| Σ_i |b_i| / m_j` by row sums, the rows of interface nodes with
    /// their amplification.
    pub(super) fn weigh_supports(&mut self) {
        if self.supports.order.is_empty() {
            return;
        }
        self.active.iter().for_each(|s| self.springs[s.index()] = 0.0);
        for support in self.supports.iter() {
            let amplifies = |s: Slot| if self.is_master(s) { 1.0 } else { self.row[s.index()].amplification() };
            let amplification = support.slots.map(amplifies);
            for (slot, bound) in support.slots.iter().zip(&support.bound) {
                let stiffness: Real = bound.iter().zip(&amplification).map(|(b, a)| b * a).sum();
                if self.is_master(*slot) {
                    self.springs[slot.index()] += stiffness * self.motion.inverse_mass[slot.index()];
                } else {
                    for (master, p) in self.row[slot.index()].entries() {
                        self.springs[master.index()] += stiffness * p.abs() * self.motion.inverse_mass[master.index()];
                    }
                }
            }
        }
        self.stiffest_spring = self.active.iter().map(|s| self.springs[s.index()]).fold(0.0, Real::max);
    }

    /// Supports follow the geomorph offsets of this tick, and their own motion.
    pub fn follow_offsets(&mut self, body: &Body) {
        let Self { supports, embedded, geomorph, .. } = self;
        let Supports { room, offset, factor, moves_with, moved, .. } = supports;
        for &(_, place) in offset.iter() {
            let support = &mut room[place as usize];
            support.pull = support.rest;
        }
        offset.retain(|&(h, place)| {
            let hold = body.supports()[h as usize];
            let (away, weights) = (&geomorph[hold.vertex.index()], &embedded[hold.vertex.index()].weights);
            let moves = moves_with[h as usize];
            let moved = moves.map_or(Vec3::zeros(), |number| moved[usize::from(number)]);
            for (pull, w) in room[place as usize].pull.iter_mut().zip(weights) {
                (0..3).for_each(|c| pull[c] += *factor * hold.stiffness * w * (moved[c] - away[c]));
            }
            moves.is_some() || *away != [0.0; 4]
        });
    }

    /// Elements that carry supports.
    pub fn support_count(&self) -> usize {
        self.supports.order.len()
    }

    /// Slots of the nodes that supports pull at, four for each element.
    pub fn supported(&self) -> impl Iterator<Item = Slot> + '_ {
        self.supports.iter().flat_map(|support| support.slots)
    }

    /// Adds the forces of the supports to [`super::Motion::force`].
    pub fn add_supports(&mut self) {
        let Self { supports, motion, .. } = self;
        for support in supports.iter() {
            let x = support.slots.map(|s| motion.position[s.index()]);
            for (i, slot) in support.slots.iter().enumerate() {
                let force = &mut motion.force[slot.index()];
                let k = &support.stiffness[i];
                for c in 0..4 {
                    let held = k[0] * x[0][c] + k[1] * x[1][c] + k[2] * x[2][c] + k[3] * x[3][c];
                    force[c] += support.pull[i][c] - held;
                }
            }
        }
    }

    /// The class of steps by which supports act.
    pub fn support_class(&self, body: &Body) -> usize {
        class_in(body, 1.0 / self.stiffest_spring().max(1.0).sqrt())
    }

    /// What a step of the supports needs [1/s²]: bound on their share of `ω²` at any node.
    pub fn stiffest_spring(&self) -> Real {
        self.stiffest_spring
    }
}
