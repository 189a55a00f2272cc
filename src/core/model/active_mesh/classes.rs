//! The step classes of the elements in use: each steps as long as its strain and the springs at its nodes allow.

use super::ActiveMesh;
use super::residual::Kind;
use crate::ids::{Element, Node};
use crate::math::Real;
use crate::model::body::Body;
use crate::model::element_pool::CLASSES;
use crate::model::material::Material;
use crate::model::step_class::{self, LONGEST_CONTACT_CLASS, SOFT_CONTACT_CLASS, Strained};

impl ActiveMesh {
    /// Class of the shortest steps that elements in use take.
    pub fn finest_class(&self) -> usize {
        (0..CLASSES).rev().find(|class| self.is_used(*class)).unwrap_or(0)
    }

    /// True when a tetrahedron or a star steps in `class`.
    pub fn is_used(&self, class: usize) -> bool {
        self.pool.count(class) + self.stars.count(class) > 0
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
                        let stars = self.stars_around(body, node).filter_map(|n| self.stars.class_of(n));
                        most = most.max(classes.max()).max(stars.max());
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
                    let stars = self.stars_around(body, node).filter(|n| self.stars.contains(*n));
                    most = stars.map(|n| self.star_omega_squared[n.index()]).fold(most, Real::max);
                }
            }
        }
        let swing = if most > 0.0 { step_class::class_for(2.0 / most.sqrt()) } else { 0 };
        swing.max(self.finest_class().clamp(LONGEST_CONTACT_CLASS, SOFT_CONTACT_CLASS))
    }

    /// Nodes whose stars node `n` is in, where there are any.
    fn stars_around<'a>(&self, body: &'a Body, n: Node) -> impl Iterator<Item = Node> + use<'a> {
        if body.stars().is_empty() { &[][..] } else { body.neighbours(n) }.iter().copied()
    }

    /// What element `e` has of its material, and not the stars of its nodes.
    pub fn jumps_material(&self, body: &Body, e: Element) -> Material {
        body.of_jumps(self.material_of(body, e), e, self.active_vertices[e.index()])
    }

    /// Springs' share of `ω²` [1/s²] at the nodes of element `e`, at most.
    fn springs_at(&self, body: &Body, e: Element) -> Real {
        body.element(e).iter().map(|n| self.spring_at(*n)).fold(0.0, Real::max)
    }

    /// The same at the nodes of the star of node `n`.
    fn springs_in_star(&self, body: &Body, n: Node) -> Real {
        body.neighbours(n).iter().map(|n| self.spring_at(*n)).fold(0.0, Real::max)
    }

    fn spring_at(&self, n: Node) -> Real {
        self.springs[self.slot[n.index()].index()]
    }

    /// Class of the longest stable step of element `e`, whose nodes have slots, strained as given.
    pub(super) fn class_strained(&self, body: &Body, e: Element, strain: &[Real; 6], det: Real) -> usize {
        step_class::class_in(body, self.step_of(body, e, strain, det))
    }

    /// The same of the star of node `n`.
    pub(super) fn class_of_star_strained(&self, body: &Body, n: Node, strain: &[Real; 6], det: Real) -> usize {
        step_class::class_in(body, self.step_of_star(body, n, strain, det))
    }

    fn step_of(&self, body: &Body, e: Element, strain: &[Real; 6], det: Real) -> Real {
        let strained = Strained::of(&self.jumps_material(body, e), strain, det);
        let springs = self.springs_at(body, e);
        step_class::stable_step(self.omega_squared[e.index()], strained, body.damping_time(), springs)
    }

    fn step_of_star(&self, body: &Body, n: Node, strain: &[Real; 6], det: Real) -> Real {
        let strained = Strained::of(&self.means_material(body, n), strain, det);
        let (omega_squared, springs) = (self.star_omega_squared[n.index()], self.springs_in_star(body, n));
        step_class::stable_step(omega_squared, strained, body.damping_time(), springs)
    }

    /// Has all that is around the nodes which carry these points of meeting organs step alike, as often as the fastest of it could swing, and
    /// gives other elements and stars the steps that they can take themselves again.
    ///
    /// Contact between what is kicked now and then and what is kicked often would push too much after each kick of the one, and too little
    /// before it.
    pub fn step_alike(&mut self, body: &Body, points: impl Iterator<Item = u32> + Clone) {
        if self.alike_is_known && points.clone().eq(self.alike_points.iter().copied()) {
            return;
        }
        self.alike_points.clear();
        self.alike_points.extend(points.clone());
        self.alike_is_known = true;
        self.held_alike.iter().for_each(|n| self.least_class[n.index()] = 0);
        self.held_alike.clear();
        self.work.noted_nodes.clear();
        for point in points {
            let corners = body.corners_of_point(point).map(|v| (v, 1.0));
            for (vertex, _) in body.patch_of_point(point).unwrap_or(&corners) {
                for slot in self.embedded[vertex.index()].slots {
                    let masters = self.row[slot.index()].entries().map(|(master, _)| master);
                    for slot in std::iter::once(slot).chain(masters) {
                        let node = self.node[slot.index()];
                        if self.work.noted_nodes.visit(node.index()) {
                            self.held_alike.push(node);
                        }
                    }
                }
            }
        }
        let mut fastest = 0.0;
        for n in &self.held_alike {
            let used = body.elements_around(*n).iter().filter(|e| self.pool.class_of(**e).is_some());
            fastest = used.map(|e| self.omega_squared[e.index()]).fold(fastest, Real::max);
            let stars = self.stars_around(body, *n).filter(|n| self.stars.contains(*n));
            fastest = stars.map(|n| self.star_omega_squared[n.index()]).fold(fastest, Real::max);
        }
        if fastest == 0.0 {
            return;
        }
        let class = step_class::class_of_rest(body, fastest);
        self.held_alike.iter().for_each(|n| self.least_class[n.index()] = class as u8);
        for i in 0..self.held_alike.len() {
            let n = self.held_alike[i];
            for e in body.elements_around(n) {
                if self.pool.class_of(*e).is_some_and(|own| own < class) {
                    self.reclass(body, *e);
                }
            }
            for star in self.stars_around(body, n) {
                if self.stars.class_of(star).is_some_and(|own| own < class) {
                    self.reclass_star(body, star);
                }
            }
        }
    }

    /// Class of the longest steps that what acts on these nodes may take.
    fn least_class_at(&self, nodes: &[Node]) -> usize {
        if self.held_alike.is_empty() {
            return 0;
        }
        nodes.iter().map(|n| usize::from(self.least_class[n.index()])).max().unwrap_or(0)
    }

    /// Moves element `e` to the class of its longest stable step; lengthening asks for some margin, so that elements do
    /// not flutter.
    pub fn reclass(&mut self, body: &Body, e: Element) {
        let (Some(class), Some((strain, det))) = (self.pool.class_of(e), self.pool.strain_and_det(e)) else { return };
        let least = self.least_class_at(&body.element(e));
        let wanted = class_wanted(body, class, self.step_of(body, e, &strain, det)).max(least);
        if wanted != class {
            self.move_residual(body, Kind::Element(e), wanted);
            self.pool.set_class(e, wanted);
            self.change_classes(class, wanted);
            self.limit_strain(body, e, wanted);
        }
    }

    /// The same for the star of node `n`.
    pub(super) fn reclass_star(&mut self, body: &Body, n: Node) {
        let (Some(class), Some((strain, det))) = (self.stars.class_of(n), self.stars.strain_and_det(n)) else { return };
        let least = self.least_class_at(body.neighbours(n));
        let wanted = class_wanted(body, class, self.step_of_star(body, n, &strain, det)).max(least);
        if wanted != class {
            self.move_residual(body, Kind::Star(n), wanted);
            self.stars.set_class(n, wanted);
            self.change_classes(class, wanted);
            self.limit_strain_of_star(body, n, wanted);
        }
    }

    fn change_classes(&mut self, from: usize, to: usize) {
        for class in [from, to] {
            self.revision[class] = self.revision[class].wrapping_add(1);
        }
    }

    /// Tells the kernel up to which strain element `e` may stay in `class`.
    pub(super) fn limit_strain(&mut self, body: &Body, e: Element, class: usize) {
        let springs = self.springs_at(body, e);
        let omega_squared = self.omega_squared[e.index()];
        let material = self.jumps_material(body, e);
        let limit = step_class::strain_limit(class, &material, omega_squared, body.damping_time(), springs);
        self.pool.set_strain_limit(e, limit);
    }

    /// The same for the star of node `n`.
    pub(super) fn limit_strain_of_star(&mut self, body: &Body, n: Node, class: usize) {
        let (material, springs) = (self.means_material(body, n), self.springs_in_star(body, n));
        let omega_squared = self.star_omega_squared[n.index()];
        let limit = step_class::strain_limit(class, &material, omega_squared, body.damping_time(), springs);
        self.stars.set_strain_limit(n, limit);
    }

    /// [`ActiveMesh::reclass`] for the elements and stars that their last evaluation found strained beyond what their step
    /// allows.
    pub fn reclass_over_limit(&mut self, body: &Body) {
        self.work.elements.clear();
        self.work.nodes.clear();
        for class in 0..CLASSES {
            self.work.elements.extend(self.pool.over_limit(class));
            self.work.nodes.extend(self.stars.over_limit(class));
        }
        self.pool.forget_over_limit();
        self.stars.forget_over_limit();
        for i in 0..self.work.elements.len() {
            self.reclass(body, self.work.elements[i]);
        }
        for i in 0..self.work.nodes.len() {
            self.reclass_star(body, self.work.nodes[i]);
        }
    }

    /// [`ActiveMesh::reclass`] for part `part` of `parts` of the elements and stars in use.
    pub fn reclass_part(&mut self, body: &Body, part: u64, parts: u64) {
        let places = |count: usize| {
            let at = |k: u64| (count as u64 * k / parts) as usize;
            // From the end, because leaving fills the gap with the last.
            (at(part)..at(part + 1)).rev()
        };
        for class in 0..CLASSES {
            for place in places(self.pool.count(class)) {
                if let Some(e) = self.pool.id_at(class, place) {
                    self.reclass(body, e);
                }
            }
            for place in places(self.stars.count(class)) {
                if let Some(n) = self.stars.id_at(class, place) {
                    self.reclass_star(body, n);
                }
            }
        }
    }
}

/// Class for what may step by `step` [s], and steps in `class` now.
fn class_wanted(body: &Body, class: usize, step: Real) -> usize {
    let wanted = step_class::class_in(body, step);
    if wanted < class { step_class::class_in(body, step / LENGTHENING_MARGIN).min(class) } else { wanted }
}

/// An element takes a longer step only when it could take one this much longer still.
const LENGTHENING_MARGIN: Real = 1.15;
