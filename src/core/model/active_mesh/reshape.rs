//! Changes of resolution: what has to follow when nodes are split or merged, and only that.

use super::{ActiveMesh, constants, padded, vec3};
use crate::geometry::locate::Host;
use crate::ids::{Element, Node, Slot};
use crate::math::{Mat3, Real, Vec3, components};
use crate::model::active_set::Change;
use crate::model::body::Body;
use crate::model::element_pool::{ElementConstants, History};
use crate::model::interface::InterfaceRow;
use crate::model::organ::MOST_ORGANS;
use crate::model::step_class;

/// What a change cost, for the governor: counts of the same things that the budget is made of.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ChangeCost {
    /// Elements put in or taken out.
    pub elements: u32,
    /// Interface rows made.
    pub rows: u32,
    /// Weighings of an element's forces.
    pub residual: u32,
}

impl ActiveMesh {
    /// Elements that a split of `n` would add.
    pub fn added_by_split(&mut self, body: &Body, n: Node) -> u32 {
        self.next_turn();
        let mut added = 0;
        for &c in body.children(n) {
            for &e in body.elements_around(c) {
                if self.active_vertices[e.index()] == 0 && self.work.noted_elements.visit(e.index()) {
                    added += 1;
                }
            }
        }
        added
    }

    /// True when there is room for a change that adds `elements`.
    pub fn has_room(&self, elements: u32) -> bool {
        // Each new element brings at most four new nodes, but where every node has a slot no more can come.
        let nodes = self.free.len() >= 4 * elements as usize || self.node.len() == self.slot.len();
        nodes && self.pool.len() + elements as usize <= self.pool.capacity()
    }

    /// True when there is room for splits that add `elements`, and for some merges after them: those, too, bring elements
    /// before others leave, and a full body could not be coarsened any more.
    pub fn has_room_to_split(&self, elements: u32) -> bool {
        let capacity = self.pool.capacity();
        let for_merges = if capacity < self.active_vertices.len() { capacity as u32 / 5 } else { 0 };
        self.has_room(elements + for_merges)
    }

    /// Makes `changes`, which are allowed side by side: splits or merges of nodes that are there.
    ///
    /// New nodes take over position and velocity from what stood for them, then each organ that changes is given the one
    /// rigid motion that leaves its linear and angular momentum as they were. What the displayed surface would jump by goes
    /// into the geomorph offset.
    pub fn apply(&mut self, body: &Body, changes: &[Change]) -> ChangeCost {
        if changes.is_empty() {
            return ChangeCost::default();
        }
        self.collect_residuals(body, changes);
        let mut changed = [false; MOST_ORGANS];
        changes.iter().for_each(|(Change::Split(n) | Change::Merge(n))| changed[body.organ_of(*n).index()] = true);
        let momenta = self.momenta_by_organ();
        self.next_turn();
        self.work.moved.clear();
        self.collect_arrivals(body, changes);
        for &change in changes {
            self.set.apply(body, change);
        }
        self.swap_nodes(body);
        self.reweigh(body);
        self.remake_rows(body, changes);
        self.normalise(body);
        self.hand_residuals_over(body, changes);
        self.place_rehung();
        self.correct_momenta(changed, &momenta);
        self.reattach(body);
        self.swap_elements(body);
        self.swap_stars(body);
        self.alike_is_known = false;
        self.release_unused(body);
        self.revision.iter_mut().for_each(|r| *r = r.wrapping_add(1));
        ChangeCost {
            elements: (self.work.entering.len() + self.work.leaving.len()) as u32,
            rows: self.work.dirty.len() as u32,
            residual: 0,
        }
    }

    /// Nothing has been looked at yet.
    pub(super) fn next_turn(&mut self) {
        self.work.noted_nodes.clear();
        self.work.noted_elements.clear();
        self.work.noted_vertices.clear();
        self.work.moved_slots.clear();
    }

    /// What becomes active, with where and how fast it is, and what ceases to be.
    fn collect_arrivals(&mut self, body: &Body, changes: &[Change]) {
        self.work.on.clear();
        self.work.off.clear();
        for &change in changes {
            match change {
                Change::Split(n) => {
                    for &c in body.children(n) {
                        let (x, v) = self.interpolate(body, c, host_of(body, c, &change));
                        self.work.on.push((c, x, v));
                    }
                    self.work.off.push(n);
                }
                Change::Merge(n) => {
                    let (x, _) = self.interpolate(body, n, host_of(body, n, &change));
                    let (mut mass, mut momentum) = (0.0, Vec3::zeros());
                    for &c in body.children(n) {
                        let slot = self.slot[c.index()].index();
                        mass += self.motion.mass[slot];
                        momentum += vec3(&self.motion.velocity[slot]) * self.motion.mass[slot];
                        self.work.off.push(c);
                    }
                    let v = if body.is_fixed(n) { Vec3::zeros() } else { momentum / mass };
                    self.work.on.push((n, x, v));
                }
            }
        }
    }

    /// True where `change` would put a node so that an element around it is inside out: what is crushed so far stays as it is.
    pub fn turns_inside_out(&mut self, body: &Body, change: Change) -> bool {
        self.collect_arrivals(body, std::slice::from_ref(&change));
        for i in 0..self.work.on.len() {
            for &e in body.elements_around(self.work.on[i].0) {
                let x = body.element(e).map(|n| match self.work.on.iter().find(|o| o.0 == n) {
                    Some(&(_, x, _)) => x,
                    None => self.interpolate(body, n, host_of(body, n, &change)).0,
                });
                if (x[1] - x[0]).cross(&(x[2] - x[0])).dot(&(x[3] - x[0])) <= 0.0 {
                    return true;
                }
            }
        }
        false
    }

    /// Position and velocity of node `n`, which is not active: where it is as an interface node; else in its host where all of that is
    /// there, else by its row.
    fn interpolate(&mut self, body: &Body, n: Node, host: Option<Host<Element>>) -> (Vec3, Vec3) {
        if body.is_fixed(n) {
            return (body.rest(n), Vec3::zeros());
        }
        let slot = self.slot[n.index()];
        if slot != Slot::NONE {
            return (vec3(&self.motion.position[slot.index()]), self.velocity_of(slot));
        }
        let mut x = Vec3::zeros();
        let mut v = Vec3::zeros();
        let nodes = host.map(|h| (body.element(h.element), h.weights));
        if let Some((nodes, weights)) =
            nodes.filter(|(nodes, _)| nodes.iter().all(|n| self.slot[n.index()] != Slot::NONE))
        {
            for (node, w) in nodes.iter().zip(weights) {
                let slot = self.slot[node.index()];
                x += vec3(&self.motion.position[slot.index()]) * w;
                v += self.velocity_of(slot) * w;
            }
        } else {
            let row = self.work.search.row(body, &self.set, n);
            for (node, w) in row.entries() {
                let slot = self.slot[node.index()];
                x += vec3(&self.motion.position[slot.index()]) * w;
                v += vec3(&self.motion.velocity[slot.index()]) * w;
            }
        }
        (x, v)
    }

    fn velocity_of(&self, slot: Slot) -> Vec3 {
        if self.is_master(slot) {
            return vec3(&self.motion.velocity[slot.index()]);
        }
        self.row[slot.index()].entries().map(|(m, w)| vec3(&self.motion.velocity[m.index()]) * w).sum()
    }

    /// Gives the nodes that become active their slots and motion, and takes the others off the list.
    fn swap_nodes(&mut self, body: &Body) {
        let off = std::mem::take(&mut self.work.off);
        for &n in &off {
            let slot = self.slot[n.index()];
            self.delist(slot, true);
            self.set_row(slot, InterfaceRow::empty());
            self.motion.velocity[slot.index()] = [0.0; 4];
            self.enlist(slot, false);
        }
        let on = std::mem::take(&mut self.work.on);
        for &(n, x, v) in &on {
            let slot = match self.slot[n.index()] {
                Slot::NONE => self.take_slot(body, n),
                slot => {
                    self.drop_row(slot);
                    self.delist(slot, false);
                    slot
                }
            };
            self.remember_place(slot);
            self.enlist(slot, true);
            self.motion.position[slot.index()] = padded(x);
            self.motion.velocity[slot.index()] = if body.is_fixed(n) { [0.0; 4] } else { padded(v) };
        }
        self.work.off = off;
        self.work.on = on;
    }

    /// New weights of the elements around changed nodes, and the masses that go with them.
    fn reweigh(&mut self, body: &Body) {
        self.work.elements.clear();
        for n in self.work.on.iter().map(|o| o.0).chain(self.work.off.iter().copied()) {
            for &e in body.elements_around(n) {
                if self.work.noted_elements.visit(e.index()) {
                    self.work.elements.push(e);
                }
            }
        }
        self.work.entering.clear();
        self.work.leaving.clear();
        self.work.nodes.clear();
        for i in 0..self.work.elements.len() {
            let e = self.work.elements[i];
            let nodes = body.element(e);
            let now = nodes.iter().filter(|n| self.set.is_active(**n)).count() as u8;
            let was = std::mem::replace(&mut self.active_vertices[e.index()], now);
            if now == was {
                continue;
            }
            for n in nodes {
                if self.work.noted_nodes.visit(n.index()) {
                    self.work.nodes.push(n);
                }
                if self.slot[n.index()] == Slot::NONE {
                    let slot = self.take_slot(body, n);
                    self.enlist(slot, false);
                }
            }
            self.weigh(body, e, i64::from(now) - i64::from(was));
            if was == 0 {
                self.work.entering.push(e);
            } else if now == 0 {
                self.work.leaving.push(e);
            } else {
                let constants = constants(body, self.material_of(body, e), e, now);
                self.pool.set_stiffness(e, &constants);
            }
        }
    }

    /// Rows that looked at a changed node, and new ones; those whose node's mass alone has changed hand that on.
    fn remake_rows(&mut self, body: &Body, changes: &[Change]) {
        self.work.dirty.clear();
        self.bound(body, changes);
        let mut dirty = std::mem::take(&mut self.work.dirty);
        for i in 0..self.interface.len() {
            let slot = self.interface[i];
            if self.hangs_otherwise(body, slot, changes) {
                dirty.push(slot);
            } else if self.work.noted_nodes.contains(self.node[slot.index()].index()) {
                self.hand_mass(slot, -1);
                self.handed_mass[slot.index()] = self.own_mass[slot.index()];
                self.hand_mass(slot, 1);
            }
        }
        self.work.dirty = dirty;
        for i in 0..self.work.dirty.len() {
            self.drop_row(self.work.dirty[i]);
        }
        for i in 0..self.work.dirty.len() {
            let slot = self.work.dirty[i];
            if self.is_needed(body, self.node[slot.index()]) {
                self.make_row(body, slot);
            }
        }
    }

    /// Places the interface nodes whose rows are others now; all others hang on nodes that stay where they are.
    fn place_rehung(&mut self) {
        let slots = std::mem::take(&mut self.work.dirty);
        slots.iter().for_each(|slot| self.remember_place(*slot));
        self.place_these(&slots);
        self.work.dirty = slots;
        // Many come to be where they were.
        let (position, was) = (&self.motion.position, &self.work.was);
        self.work.moved.retain(|slot| position[slot.index()] != was[slot.index()]);
    }

    /// True when an element in use has the node `n`.
    fn is_needed(&self, body: &Body, n: Node) -> bool {
        body.elements_around(n).iter().any(|e| self.active_vertices[e.index()] > 0)
    }

    /// Puts in the elements that are needed now, strained as they lie there, and takes out the others.
    fn swap_elements(&mut self, body: &Body) {
        for i in 0..self.work.entering.len() {
            let e = self.work.entering[i];
            let slots = body.element(e).map(|n| self.slot[n.index()]);
            let constants = constants(body, self.material_of(body, e), e, self.active_vertices[e.index()]);
            let (strain, det) = self.strain(&constants, &slots);
            let history = History { strain, det, branch: self.inherited_branches(body, e) };
            self.omega_squared[e.index()] = step_class::omega_squared(body, self.material_of(body, e), e);
            let class = self.class_strained(body, e, &strain, det);
            let taken = self.pool.insert(e, class, &slots, &constants, &history);
            debug_assert!(taken, "whoever plans a change asks for room first");
            self.limit_strain(body, e, class);
        }
        for i in 0..self.work.leaving.len() {
            self.pool.remove(self.work.leaving[i]);
        }
    }

    /// Puts in the stars of the nodes that have become active, strained as they lie there, takes out the others, and gives those beside them
    /// the stiffness that elements around them have left or taken over.
    fn swap_stars(&mut self, body: &Body) {
        if body.stars().is_empty() {
            return;
        }
        for i in 0..self.work.on.len() {
            let n = self.work.on[i].0;
            self.note_stabilisation(body, n);
            let constants = self.star_constants(body, n);
            self.note_star(body, n);
            let (strain, det) = self.strain(&constants, &self.work.star);
            let history = History { strain, det, branch: self.inherited_branches_of_star(body, n) };
            self.star_omega_squared[n.index()] = self.omega_squared_of_star(body, n);
            let class = self.class_of_star_strained(body, n, &strain, det);
            let taken = self.stars.insert(n, class, &self.work.star, &constants, &history);
            debug_assert!(taken, "each is around a node with a slot");
            self.limit_strain_of_star(body, n, class);
        }
        for i in 0..self.work.off.len() {
            self.stars.remove(self.work.off[i]);
        }
        for i in 0..self.work.nodes.len() {
            let n = self.work.nodes[i];
            if self.stars.contains(n) && self.note_stabilisation(body, n) {
                self.stiffen_star(body, n);
            }
        }
    }

    /// Lists the slots of the star of node `n`: its own, and those of its neighbours, which are nodes of elements in use.
    pub(super) fn note_star(&mut self, body: &Body, n: Node) {
        self.work.star.clear();
        let nodes = std::iter::once(&n).chain(body.stars().neighbours(n));
        self.work.star.extend(nodes.map(|n| self.slot[n.index()]));
    }

    /// Green strain and determinant of an element where its nodes lie now.
    pub(super) fn strain(
        &self,
        constants: &ElementConstants<impl AsRef<[[Real; 3]]>>,
        slots: &[Slot],
    ) -> ([Real; 6], Real) {
        let f = self.deformation(constants, slots);
        (components(&((f.transpose() * f - Mat3::identity()) * 0.5)), f.determinant())
    }

    /// Deformation gradient of an element where its nodes lie now.
    pub(super) fn deformation(&self, constants: &ElementConstants<impl AsRef<[[Real; 3]]>>, slots: &[Slot]) -> Mat3 {
        let mut x = slots.iter().map(|slot| self.position(*slot));
        let origin = x.next().unwrap_or_default();
        constants.deformation(origin, x)
    }

    /// What the Maxwell branches of element `e` hold: the mean over the elements that contain its vertices on the
    /// neighbouring levels. The branches' strain is carried, not what is left of it, so that the stress goes on.
    fn inherited_branches(&self, body: &Body, e: Element) -> [[Real; 6]; 2] {
        let mut sum = [[0.0; 6]; 2];
        if body.maxwell().is_empty() {
            return sum;
        }
        let mut count = 0.0;
        for n in body.element(e) {
            for host in [body.coarser_host(n), body.finer_host(n)].into_iter().flatten() {
                if let Some(history) = self.pool.history(host.element) {
                    count += 1.0;
                    for (to, from) in sum.iter_mut().flatten().zip(history.branch.iter().flatten()) {
                        *to += from;
                    }
                }
            }
        }
        sum.map(|b| b.map(|x| if count > 0.0 { x / count } else { 0.0 }))
    }

    /// What the Maxwell branches of the star of node `n` hold: as [`ActiveMesh::inherited_branches`], of the stars of the nodes
    /// of the elements that contain it, as much as they weigh there.
    fn inherited_branches_of_star(&self, body: &Body, n: Node) -> [[Real; 6]; 2] {
        let (mut sum, mut weight) = ([[0.0; 6]; 2], 0.0);
        if body.maxwell().is_empty() {
            return sum;
        }
        for host in [body.coarser_host(n), body.finer_host(n)].into_iter().flatten() {
            for (node, w) in body.element(host.element).into_iter().zip(host.weights) {
                // Outside of an element weights may be negative: a mean has none.
                if let Some(history) = self.stars.history(node).filter(|_| w > 0.0) {
                    weight += w;
                    for (to, from) in sum.iter_mut().flatten().zip(history.branch.iter().flatten()) {
                        *to += w * from;
                    }
                }
            }
        }
        sum.map(|b| b.map(|x| if weight > 0.0 { x / weight } else { 0.0 }))
    }

    /// Frees the slots of nodes that no element in use has any more.
    fn release_unused(&mut self, body: &Body) {
        for i in 0..self.work.nodes.len() {
            let n = self.work.nodes[i];
            let slot = self.slot[n.index()];
            if slot != Slot::NONE && !self.set.is_active(n) && !self.is_needed(body, n) {
                self.drop_row(slot);
                self.delist(slot, false);
                self.slot[n.index()] = Slot::NONE;
                self.node[slot.index()] = Node::NONE;
                self.free.push(slot);
            }
        }
    }
}

/// Where node `n` lies in what `change` takes away.
fn host_of(body: &Body, n: Node, change: &Change) -> Option<Host<Element>> {
    match change {
        Change::Split(_) => body.coarser_host(n),
        Change::Merge(_) => body.finer_host(n),
    }
}
