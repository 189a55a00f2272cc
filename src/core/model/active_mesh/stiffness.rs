//! Tissues whose stiffness changes while the body moves.
//!
//! Elements take over another stiffness one after another, by number, some in each tick: all at once would take several. Those
//! below [`Stiffening::reached`] are as stiff as `now` says, the others as `before`, so that a saved state tells each one's.

use super::{ActiveMesh, constants};
use crate::ids::{Element, Vertex};
use crate::math::Real;
use crate::model::body::Body;
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
    /// Elements below this number are as stiff as `now` says.
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

/// Elements in use that take over another stiffness in a tick: some 0.05 ms.
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
}

impl Materials {
    pub(super) fn new(body: &Body) -> Self {
        let (prepared, ones) = (body.parts().materials.clone(), vec![1.0; body.tissue_count()]);
        let stiffening = Stiffening { now: ones.clone(), before: ones, reached: u32::MAX };
        Self { stiffening, now: prepared.clone(), before: prepared }
    }
}

impl ActiveMesh {
    /// Material of element `e`.
    pub fn material_of(&self, body: &Body, e: Element) -> &Material {
        let Materials { stiffening, now, before } = &self.materials;
        let of = if e.0 < stiffening.reached { now } else { before };
        &of[body.material_number(e)]
    }

    /// Material under display vertex `v`, on the finest level that reaches there, once all elements have taken it over.
    pub fn material_at(&self, body: &Body, v: Vertex) -> &Material {
        &self.materials.now[body.material_number_at(v)]
    }

    /// How stiff the tissues are.
    pub fn stiffening(&self) -> &Stiffening {
        &self.materials.stiffening
    }

    /// Takes over `stiffening`, of which no element is told: before [`ActiveMesh::restore`].
    pub(crate) fn assume_stiffness(&mut self, body: &Body, stiffening: &Stiffening) {
        let Materials { stiffening: own, now, before } = &mut self.materials;
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
    }

    /// Elements begin to take over the stiffness that `wanted` gives tissues (number and factor), but not while they take over
    /// another one.
    pub(crate) fn begin_stiffening(&mut self, body: &Body, wanted: impl Iterator<Item = (usize, Real)> + Clone) {
        let Materials { stiffening, now, before } = &mut self.materials;
        if stiffening.reached != u32::MAX || wanted.clone().all(|(t, factor)| stiffening.now[t] == factor) {
            return;
        }
        stiffening.before.copy_from_slice(&stiffening.now);
        before.copy_from_slice(now);
        wanted.for_each(|(t, factor)| stiffening.now[t] = factor);
        now.iter_mut().enumerate().for_each(|(m, material)| *material = body.mixed(m, &stiffening.now));
        stiffening.reached = 0;
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
            if reached as usize == body.element_count() {
                self.materials.stiffening.reached = u32::MAX;
                return;
            }
            self.materials.stiffening.reached += 1;
            let e = Element(reached);
            if self.active_vertices[e.index()] > 0 {
                let m = body.material_number(e);
                if self.materials.now[m] != self.materials.before[m] {
                    self.stiffen(body, e);
                    left -= 1;
                }
            }
        }
    }

    /// Gives all elements the steps that the stiffness asks for, after a state of the body as prepared has been restored.
    pub(crate) fn reclass_stiffened(&mut self, body: &Body) {
        let Stiffening { now, before, .. } = &self.materials.stiffening;
        if now.iter().chain(before).all(|factor| *factor == 1.0) {
            return;
        }
        self.work.elements.clear();
        (0..CLASSES).for_each(|class| self.work.elements.extend(self.pool.ids(class)));
        for i in 0..self.work.elements.len() {
            self.stiffen(body, self.work.elements[i]);
        }
    }

    fn stiffen(&mut self, body: &Body, e: Element) {
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
