//! The step classes of the elements in use: each steps as long as its strain and the springs at its nodes allow.

use super::ActiveMesh;
use crate::ids::{Element, Slot};
use crate::math::Real;
use crate::model::body::Body;
use crate::model::element_pool::CLASSES;
use crate::model::step_class::{self, LONGEST_CONTACT_CLASS, SOFT_CONTACT_CLASS, Strained};

impl ActiveMesh {
    /// Class of the shortest steps that elements in use take.
    pub fn finest_class(&self) -> usize {
        (0..CLASSES).rev().find(|class| self.pool.count(*class) > 0).unwrap_or(0)
    }

    /// Class of the steps by which contact at points of tools and of obstacles, numbered as [`Constraint::point`], is held.
    ///
    /// Tools: at least as often as the elements around the nodes that carry the points could swing freely, at rest. Between two
    /// solves these nodes are free; held less often than they swing, they press with no more than `mass · gap / Δt²`, however
    /// stiff the elements are. Viscosity, which may shorten the elements' own steps further, slows the swing.
    ///
    /// Obstacles, which nothing soft is between: as often as the elements are kicked.
    ///
    /// [`Constraint::point`]: crate::model::Constraint::point
    pub fn contact_class(
        &mut self,
        body: &Body,
        tools: impl Iterator<Item = u32>,
        obstacles: impl Iterator<Item = u32>,
    ) -> usize {
        let kicked = self.class_around(body, obstacles);
        let mut tools = tools.peekable();
        match kicked {
            Some(class) if tools.peek().is_none() => class,
            _ => self.class_under_tools(body, tools).max(kicked.unwrap_or(0)),
        }
    }

    /// Class of the shortest steps of the elements around the nodes that carry these points; `None` where there are none.
    fn class_around(&mut self, body: &Body, points: impl Iterator<Item = u32>) -> Option<usize> {
        self.work.noted_nodes.clear();
        let mut most = None;
        for point in points {
            let corners = body.corners_of_point(point).map(|v| (v, 1.0));
            for (vertex, _) in body.patch_of_point(point).unwrap_or(&corners) {
                for slot in self.embedded[vertex.index()].slots {
                    let node = self.node[slot.index()];
                    if self.work.noted_nodes.visit(node.index()) {
                        let classes = body.elements_around(node).iter().filter_map(|e| self.pool.class_of(*e));
                        most = most.max(classes.max());
                    }
                }
            }
        }
        most
    }

    fn class_under_tools(&mut self, body: &Body, points: impl Iterator<Item = u32>) -> usize {
        self.work.noted_nodes.clear();
        let mut most = 0.0;
        for vertex in points.flat_map(|point| body.corners_of_point(point)) {
            for slot in self.embedded[vertex.index()].slots {
                let node = self.node[slot.index()];
                if self.work.noted_nodes.visit(node.index()) {
                    let used = body.elements_around(node).iter().filter(|e| self.pool.class_of(**e).is_some());
                    most = used.map(|e| self.omega_squared[e.index()]).fold(most, Real::max);
                }
            }
        }
        let swing = if most > 0.0 { step_class::class_for(2.0 / most.sqrt()) } else { 0 };
        swing.max(self.finest_class().clamp(LONGEST_CONTACT_CLASS, SOFT_CONTACT_CLASS))
    }

    /// Springs' share of `ω²` [1/s²] at the nodes in `slots`, at most.
    pub(super) fn springs_at(&self, slots: [Slot; 4]) -> Real {
        slots.iter().map(|s| self.springs[s.index()]).fold(0.0, Real::max)
    }

    /// Moves element `e` to the class of its longest stable step; lengthening asks for some margin, so that elements do
    /// not flutter.
    pub fn reclass(&mut self, body: &Body, e: Element) {
        let (Some(class), Some((strain, det))) = (self.pool.class_of(e), self.pool.strain_and_det(e)) else { return };
        let springs = self.springs_at(body.element(e).map(|n| self.slot[n.index()]));
        let strained = Strained::of(self.material_of(body, e), &strain, det);
        let step = step_class::stable_step(self.omega_squared[e.index()], strained, body.damping_time(), springs);
        let mut wanted = step_class::class_in(body, step);
        if wanted < class {
            wanted = step_class::class_in(body, step / LENGTHENING_MARGIN).min(class);
        }
        if wanted != class {
            self.move_residual(body, e, wanted);
            self.pool.set_class(e, wanted);
            self.revision[class] = self.revision[class].wrapping_add(1);
            self.revision[wanted] = self.revision[wanted].wrapping_add(1);
            self.limit_strain(body, e, wanted);
        }
    }

    /// Tells the kernel up to which strain element `e` may stay in `class`.
    pub(super) fn limit_strain(&mut self, body: &Body, e: Element, class: usize) {
        let springs = self.springs_at(body.element(e).map(|n| self.slot[n.index()]));
        let omega_squared = self.omega_squared[e.index()];
        let material = self.material_of(body, e);
        let limit = step_class::strain_limit(class, material, omega_squared, body.damping_time(), springs);
        self.pool.set_strain_limit(e, limit);
    }

    /// [`ActiveMesh::reclass`] for the elements that their last evaluation found strained beyond what their step
    /// allows.
    pub fn reclass_over_limit(&mut self, body: &Body) {
        self.work.elements.clear();
        for class in 0..CLASSES {
            self.work.elements.extend(self.pool.over_limit(class));
        }
        self.pool.forget_over_limit();
        for i in 0..self.work.elements.len() {
            self.reclass(body, self.work.elements[i]);
        }
    }

    /// [`ActiveMesh::reclass`] for part `part` of `parts` of the elements in use.
    pub fn reclass_part(&mut self, body: &Body, part: u64, parts: u64) {
        for class in 0..CLASSES {
            let at = |k: u64| (self.pool.count(class) as u64 * k / parts) as usize;
            // From the end, because leaving fills the gap with the last.
            for place in (at(part)..at(part + 1)).rev() {
                if let Some(e) = self.pool.id_at(class, place) {
                    self.reclass(body, e);
                }
            }
        }
    }
}

/// An element takes a longer step only when it could take one this much longer still.
const LENGTHENING_MARGIN: Real = 1.15;
