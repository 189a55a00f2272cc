//! Tissues whose stiffness changes while the body moves.
//!
//! Elements take over another stiffness one after another, by number, some in each tick: all at once would take several; then
//! stars do. What is below [`Stiffening::reached`] is as stiff as `now` says, the rest as `before`, so that a saved state tells
//! each one's.

use super::{ActiveMesh, STAR_EVALUATIONS, constants};
use crate::ids::{Element, Node, Vertex};
use crate::math::Real;
use crate::model::body::{Body, stars};
use crate::model::element::ElementConstants;
use crate::model::element_pool::CLASSES;
use crate::model::material::Material;
use crate::model::step_class;
use serde::{Deserialize, Serialize};

/// How stiff the tissues of a body are, and how far a change of it has come.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Stiffening {
    /// How many times as stiff as prepared each tissue is, (tissues); empty: all are as prepared.
    pub now: Vec<Real>,
    /// And was before the last change, (tissues).
    pub before: Vec<Real>,
    /// Elements below this number, then nodes' stars below what it is beyond all elements, are as stiff as `now` says.
    pub reached: u32,
}

impl Stiffening {
    /// All as prepared.
    pub const NONE: Self = Self { now: Vec::new(), before: Vec::new(), reached: u32::MAX };

    /// The same with room for so many tissues.
    pub fn with_room(tissues: usize) -> Self {
        Self { now: Vec::with_capacity(tissues), before: Vec::with_capacity(tissues), ..Self::NONE }
    }

    /// Whether it is one of `body`, all factors positive.
    pub fn fits(&self, body: &Body) -> bool {
        let tissues = body.tissue_count();
        let fits = |of: &[Real]| of.len() == tissues && of.iter().all(|factor| *factor > 0.0 && factor.is_finite());
        fits(&self.now) && fits(&self.before)
    }

    /// Whether all is as stiff as prepared, and was before.
    fn is_prepared(&self) -> bool {
        self.now.iter().chain(&self.before).all(|factor| *factor == 1.0)
    }

    /// Feeds every bit of it to `hash`.
    pub fn hash_into(&self, hash: &mut xxhash_rust::xxh3::Xxh3) {
        hash.update(bytemuck::cast_slice(&self.now));
        hash.update(bytemuck::cast_slice(&self.before));
        hash.update(&self.reached.to_le_bytes());
    }

    /// Takes over `from`, and allocates nothing where there is room.
    pub fn copy_from(&mut self, from: &Self) {
        self.now.clone_from(&from.now);
        self.before.clone_from(&from.before);
        self.reached = from.reached;
    }
}

/// Elements in use that take over another stiffness in a tick, of which a star is worth [`STAR_EVALUATIONS`]: some 0.05 ms.
const AT_ONCE: usize = 128;
/// And elements that are looked at for it, of which many are not in use: as long at most.
const MOST_LOOKED_AT: usize = 8192;

/// Stiffness of all materials, now and before.
#[derive(Debug)]
pub(super) struct Materials {
    stiffening: Stiffening,
    /// (materials)
    now: Vec<Material>,
    before: Vec<Material>,
    /// Whether both are those of the body.
    as_prepared: bool,
}

impl Materials {
    pub(super) fn new(body: &Body) -> Self {
        let (prepared, ones) = (body.parts().materials.clone(), vec![1.0; body.tissue_count()]);
        let stiffening = Stiffening { now: ones.clone(), before: ones, reached: u32::MAX };
        Self { stiffening, now: prepared.clone(), before: prepared, as_prepared: true }
    }
}

impl ActiveMesh {
    /// Material of element `e`.
    pub fn material_of(&self, body: &Body, e: Element) -> &Material {
        let Materials { stiffening, now, before, .. } = &self.materials;
        let of = if e.0 < stiffening.reached { now } else { before };
        &of[body.material_number(e)]
    }

    /// What the materials of the elements around node `n` are to its star.
    fn materials_of_star(&self, body: &Body, n: Node) -> &[Material] {
        let Materials { stiffening, now, before, .. } = &self.materials;
        if n.index() < (stiffening.reached as usize).saturating_sub(body.element_count()) { now } else { before }
    }

    /// What the star of node `n` has of the materials around it.
    pub fn means_material(&self, body: &Body, n: Node) -> Material {
        let mean = if self.materials.as_prepared {
            body.stars().of(n).material
        } else {
            stars::mean_around(body, n, self.materials_of_star(body, n))
        };
        stars::of_means(&mean, self.star_stabilisation[n.index()])
    }

    /// Part α of the energy of strain jumps that the elements around node `n` keep as these are active, their mean by volume; 1 where
    /// tetrahedra have all energy.
    pub fn stabilisation_around(&self, n: Node) -> Real {
        if self.star_stabilisation.is_empty() {
            1.0
        } else if self.stars.contains(n) {
            self.star_stabilisation[n.index()]
        } else {
            stars::LARGEST
        }
    }

    /// Sets what the star of node `n` leaves to the tetrahedra around it, as these are active. Whether that is something else than before.
    pub(super) fn note_stabilisation(&mut self, body: &Body, n: Node) -> bool {
        let now = body.stabilisation_around(n, |e| self.active_vertices[e.index()]);
        std::mem::replace(&mut self.star_stabilisation[n.index()], now) != now
    }

    /// The element that the star of node `n` is.
    pub(crate) fn star_constants<'a>(&self, body: &'a Body, n: Node) -> ElementConstants<&'a [[Real; 3]]> {
        body.stars().constants(n, &self.means_material(body, n))
    }

    /// [`step_class::omega_squared_of_star`] of node `n`.
    pub fn omega_squared_of_star(&self, body: &Body, n: Node) -> Real {
        let means = self.means_material(body, n);
        step_class::omega_squared_of_star(body, n, self.materials_of_star(body, n), &means)
    }

    /// Material under display vertex `v`, on the finest level that reaches there, once all elements have taken it over.
    pub fn material_at(&self, body: &Body, v: Vertex) -> Material {
        let e = body.element_at(v);
        body.led(&self.materials.now[body.material_number(e)], e)
    }

    /// How stiff the tissues are.
    pub fn stiffening(&self) -> &Stiffening {
        &self.materials.stiffening
    }

    /// Takes over `stiffening`, of which no element is told: before [`ActiveMesh::restore`].
    pub(crate) fn assume_stiffness(&mut self, body: &Body, stiffening: &Stiffening) {
        let Materials { stiffening: own, now, before, as_prepared } = &mut self.materials;
        if stiffening.now.is_empty() {
            own.now.fill(1.0);
            own.before.fill(1.0);
            own.reached = u32::MAX;
        } else {
            own.copy_from(stiffening);
        }
        for (materials, stiffness) in [(now, &own.now), (before, &own.before)] {
            materials.iter_mut().enumerate().for_each(|(m, material)| *material = body.mixed(m, stiffness));
        }
        *as_prepared = own.is_prepared();
    }

    /// Elements begin to take over the stiffness that `wanted` gives tissues (number and factor), but not while they take over
    /// another one.
    pub(crate) fn begin_stiffening(&mut self, body: &Body, wanted: impl Iterator<Item = (usize, Real)> + Clone) {
        let Materials { stiffening, now, before, as_prepared } = &mut self.materials;
        if stiffening.reached != u32::MAX || wanted.clone().all(|(t, factor)| stiffening.now[t] == factor) {
            return;
        }
        stiffening.before.copy_from_slice(&stiffening.now);
        before.copy_from_slice(now);
        wanted.for_each(|(t, factor)| stiffening.now[t] = factor);
        now.iter_mut().enumerate().for_each(|(m, material)| *material = body.mixed(m, &stiffening.now));
        stiffening.reached = 0;
        *as_prepared = stiffening.is_prepared();
    }

    /// The next elements take over what they are to be: `λ` and `μ`, and with them their steps. The strain stays, so that the
    /// stress changes at once.
    pub(crate) fn go_on_stiffening(&mut self, body: &Body) {
        let mut left = AT_ONCE;
        for _ in 0..MOST_LOOKED_AT {
            let reached = self.materials.stiffening.reached;
            if reached == u32::MAX || left == 0 {
                return;
            }
            let stars = if body.is_smoothed() { body.node_count() } else { 0 };
            if reached as usize == body.element_count() + stars {
                self.materials.stiffening.reached = u32::MAX;
                return;
            }
            self.materials.stiffening.reached += 1;
            let changes = |e: &Element| {
                let m = body.material_number(*e);
                self.materials.now[m] != self.materials.before[m]
            };
            if let Some(n) = (reached as usize).checked_sub(body.element_count()).map(Node::at) {
                if self.stars.contains(n) && body.elements_around(n).iter().any(changes) {
                    self.stiffen_star(body, n);
                    left = left.saturating_sub(STAR_EVALUATIONS);
                }
            } else if self.active_vertices[reached as usize] > 0 && changes(&Element(reached)) {
                self.stiffen(body, Element(reached));
                left -= 1;
            }
        }
    }

    /// Gives all elements the steps that the stiffness asks for, after a state of the body as prepared has been restored.
    pub(crate) fn reclass_stiffened(&mut self, body: &Body) {
        if self.materials.as_prepared {
            return;
        }
        self.work.elements.clear();
        (0..CLASSES).for_each(|class| self.work.elements.extend(self.pool.ids(class)));
        for i in 0..self.work.elements.len() {
            self.stiffen(body, self.work.elements[i]);
        }
        self.work.nodes.clear();
        (0..CLASSES).for_each(|class| self.work.nodes.extend(self.stars.ids(class)));
        for i in 0..self.work.nodes.len() {
            self.stiffen_star(body, self.work.nodes[i]);
        }
    }

    fn stiffen(&mut self, body: &Body, e: Element) {
        let material = self.material_of(body, e);
        let constants = constants(body, material, e, self.active_vertices[e.index()]);
        self.omega_squared[e.index()] = step_class::omega_squared(body, material, e);
        self.alike_is_known = false;
        self.pool.set_stiffness(e, &constants);
        self.reclass(body, e);
        if let Some(class) = self.pool.class_of(e) {
            self.limit_strain(body, e, class);
        }
    }

    pub(super) fn stiffen_star(&mut self, body: &Body, n: Node) {
        let constants = self.star_constants(body, n);
        self.star_omega_squared[n.index()] = self.omega_squared_of_star(body, n);
        self.alike_is_known = false;
        self.stars.set_stiffness(n, &constants);
        self.reclass_star(body, n);
        if let Some(class) = self.stars.class_of(n) {
            self.limit_strain_of_star(body, n, class);
        }
    }
}
