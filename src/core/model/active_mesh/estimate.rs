//! What changes of resolution will take, counted before they are made.

use super::{ActiveMesh, ChangeCost, STAR_EVALUATIONS};
use crate::ids::{Element, Node, Slot};
use crate::math::Bounds;
use crate::model::active_set::Change;
use crate::model::body::Body;

impl ActiveMesh {
    /// What `changes`, of one kind, take at most; with the evaluation of their residual forces when `residual`: those of elements around nodes that
    /// come and go, and of interface nodes that will hang otherwise.
    pub fn estimate(&mut self, body: &Body, changes: &[Change], residual: bool) -> ChangeCost {
        self.next_turn();
        self.work.concerned.clear();
        let off = || changes.iter().flat_map(|c| sides(body, c).0).copied();
        let on = || changes.iter().flat_map(|c| sides(body, c).1).copied();
        let mut cost = ChangeCost::default();
        let (mut coming, mut going) = (0, 0);
        for n in on() {
            for &e in body.elements_around(n) {
                if self.is_first(e) {
                    coming += u32::from(self.active_vertices[e.index()] == 0);
                }
                cost.rows += self.note_nodes(body, e);
            }
        }
        // They come with it, but not to hang on others.
        cost.rows -= on().filter(|n| self.slot[n.index()] == Slot::NONE).count() as u32;
        for n in off() {
            cost.rows += 1;
            for &e in body.elements_around(n) {
                self.is_first(e);
                self.note_nodes(body, e);
                let left = self.active_vertices[e.index()].wrapping_sub(1);
                self.active_vertices[e.index()] = left;
                going += u32::from(left == 0);
            }
        }
        for n in off() {
            for &e in body.elements_around(n) {
                self.active_vertices[e.index()] = self.active_vertices[e.index()].wrapping_add(1);
            }
        }
        self.bound(body, changes);
        for i in 0..self.interface.len() {
            let slot = self.interface[i];
            if self.hangs_otherwise(body, slot, changes) {
                cost.rows += 1;
                if residual {
                    let n = self.node[slot.index()];
                    body.elements_around(n).iter().for_each(|e| {
                        self.is_first(*e);
                    });
                }
            }
        }
        cost.elements = coming + going;
        if residual {
            let used = self.work.concerned.iter().filter(|e| self.active_vertices[e.index()] > 0).count() as u32;
            cost.residual = used + (used + coming - going);
            if body.is_smoothed() {
                self.note_stars(body);
                let stars = self.work.concerned_stars.iter().filter(|n| self.stars.contains(**n)).count() as u32;
                let (on, off) = (on().count() as u32, off().count() as u32);
                cost.residual += STAR_EVALUATIONS as u32 * (2 * stars + on - off);
            }
        }
        cost
    }

    /// Lists the nodes of the concerned elements, whose stars are concerned where they are in use: every two nodes of a star share
    /// an element.
    fn note_stars(&mut self, body: &Body) {
        self.work.concerned_stars.clear();
        self.work.noted_stars.clear();
        for n in self.work.concerned.iter().flat_map(|e| body.element(*e)) {
            if self.work.noted_stars.visit(n.index()) {
                self.work.concerned_stars.push(n);
            }
        }
    }

    /// Puts `e` on the list of those concerned unless it is there.
    fn is_first(&mut self, e: Element) -> bool {
        let first = self.work.noted_elements.visit(e.index());
        if first {
            self.work.concerned.push(e);
        }
        first
    }

    /// Notes the nodes of `e`: their weight changes. How many of them are new here, and have no slot.
    fn note_nodes(&mut self, body: &Body, e: Element) -> u32 {
        let mut new = 0;
        for n in body.element(e) {
            let first = self.work.noted_nodes.visit(n.index());
            new += u32::from(first && self.slot[n.index()] == Slot::NONE);
        }
        new
    }

    /// Notes where `changes` are.
    pub(super) fn bound(&mut self, body: &Body, changes: &[Change]) {
        self.work.boxes.clear();
        self.work.boxes.extend(changes.iter().map(|change| Bounds::of(concerned(body, change).map(|n| body.rest(n)))));
    }

    /// True for an interface node that has no row (its reach is infinite), or whose row depends on one of the nodes concerned by `changes`, whose
    /// bounds are noted.
    pub(super) fn hangs_otherwise(&self, body: &Body, slot: Slot, changes: &[Change]) -> bool {
        let (u, reach) = (&self.rest[slot.index()], self.reach[slot.index()]);
        let depends = |(change, around): (&Change, &Bounds)| {
            if around.distance_squared(u) > reach {
                return false;
            }
            let row = &self.row[slot.index()];
            if row.is_hosted() {
                let mut lost = sides(body, change).0.iter().map(|n| self.slot[n.index()]);
                return lost.any(|lost| row.entries().any(|(master, _)| master == lost));
            }
            concerned(body, change).any(|n| (body.rest(n) - u).norm_squared() <= reach)
        };
        changes.iter().zip(&self.work.boxes).any(depends)
    }
}

/// Nodes that are active before or after a change, and not both.
fn concerned<'a>(body: &'a Body, change: &'a Change) -> impl Iterator<Item = Node> + 'a {
    let (off, on) = sides(body, change);
    off.iter().chain(on).copied()
}

/// Nodes that cease to be active by a change, and those that become so.
pub(super) fn sides<'a>(body: &'a Body, change: &'a Change) -> (&'a [Node], &'a [Node]) {
    match change {
        Change::Split(n) => (std::slice::from_ref(n), body.children(*n)),
        Change::Merge(n) => (body.children(*n), std::slice::from_ref(n)),
    }
}
