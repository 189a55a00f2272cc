//! Tissues whose stiffness changes while the body moves.

use super::{ActiveMesh, constants};
use crate::ids::{Element, Node, Vertex};
use crate::math::Real;
use crate::model::body::Body;
use crate::model::element_pool::CLASSES;
use crate::model::material::Material;
use crate::model::step_class;

impl ActiveMesh {
    /// Material of element `e` now.
    pub fn material_of(&self, body: &Body, e: Element) -> &Material {
        &self.materials[body.material_number(e)]
    }

    /// Material under display vertex `v` now, on the finest level that reaches there.
    pub fn material_at(&self, body: &Body, v: Vertex) -> &Material {
        &self.materials[body.material_number_at(v)]
    }

    /// How many times as stiff as prepared each tissue is, (tissues).
    pub fn stiffness(&self) -> &[Real] {
        &self.stiffness
    }

    /// Makes tissue `t`, which the body has, `factor` times as stiff as prepared, where no element is told of it: before
    /// [`ActiveMesh::restore`].
    pub(crate) fn assume_stiffness(&mut self, body: &Body, t: usize, factor: Real) {
        self.stiffness[t] = factor;
        for m in (0..self.materials.len()).filter(|m| body.has_tissue(*m, t)) {
            self.materials[m] = body.mixed(m, &self.stiffness);
        }
    }

    /// Makes tissue `t`, which the body has, `factor` times as stiff as prepared: `λ` and `μ` of its elements, and their steps.
    /// The strain stays, so that the stress changes at once. Allocates nothing.
    pub fn set_stiffness(&mut self, body: &Body, t: usize, factor: Real) {
        self.assume_stiffness(body, t, factor);
        self.stiffen_elements(body, t);
    }

    /// Gives all elements the steps that the stiffness asks for, after a state of the body as prepared has been restored.
    pub(crate) fn reclass_stiffened(&mut self, body: &Body) {
        for t in 0..self.stiffness.len() {
            if self.stiffness[t] != 1.0 {
                self.stiffen_elements(body, t);
            }
        }
    }

    fn stiffen_elements(&mut self, body: &Body, t: usize) {
        self.work.elements.clear();
        for class in 0..CLASSES {
            self.work.elements.extend(self.pool.ids(class).filter(|e| body.has_tissue(body.material_number(*e), t)));
        }
        for i in 0..self.work.elements.len() {
            let e = self.work.elements[i];
            let material = self.material_of(body, e);
            let constants = constants(body, material, e, self.active_vertices[e.index()]);
            self.omega_squared[e.index()] = step_class::omega_squared(body, material, e);
            self.pool.set_stiffness(e, constants.lambda, constants.mu);
            self.reclass(body, e);
            if let Some(class) = self.pool.class_of(e) {
                self.limit_strain(body, e, class);
            }
        }
    }

    /// How many times as far as prepared a half-space of what is around node `n` gives way.
    pub fn softness(&self, body: &Body, n: Node) -> Real {
        if self.stiffness.iter().all(|factor| *factor == 1.0) {
            return 1.0;
        }
        let mean = |of: &dyn Fn(Element) -> Material| {
            let (mut lambda, mut mu) = (0.0, 0.0);
            for &e in body.elements_around(n) {
                let material = of(e);
                lambda += body.volume(e) * material.lambda;
                mu += body.volume(e) * material.mu;
            }
            Material { lambda, mu, ..*body.material() }.half_space()
        };
        // Both are off by the volume, which cancels.
        mean(&|e| *self.material_of(body, e)) / mean(&|e| *body.material_of(e))
    }
}
