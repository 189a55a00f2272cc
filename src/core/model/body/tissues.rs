//! What a body is made of: the materials of its elements, and the tissues that these are mixed of.

use super::Body;
use super::parts::MixtureParts;
use crate::ids::{Element, Vertex};
use crate::math::Real;
use crate::model::material::Material;

impl Body {
    /// Material of element `e` as prepared.
    pub fn material_of(&self, e: Element) -> &Material {
        &self.parts.materials[self.material_number(e)]
    }

    /// Number of the material of element `e`.
    pub fn material_number(&self, e: Element) -> usize {
        let (r, place) = self.place_of_element(e);
        usize::from(self.parts.material_of[r].get(place).copied().unwrap_or_default())
    }

    /// Number of the material under display vertex `v`, on the finest level that reaches there.
    pub fn material_number_at(&self, v: Vertex) -> usize {
        let host = (0..self.levels().len()).rev().find_map(|r| self.embedding(r, v));
        host.map_or(0, |host| self.material_number(host.element))
    }

    /// Tissues that the materials are mixed of.
    pub fn tissue_count(&self) -> usize {
        let MixtureParts { tissues, of } = &self.parts.mixtures;
        if of.is_empty() { self.parts.materials.len() } else { tissues.len() }
    }

    /// Whether there is some of tissue `t` in material number `m`.
    pub fn has_tissue(&self, m: usize, t: usize) -> bool {
        self.parts.mixtures.of.get(m).map_or(m == t, |mixed| mixed.iter().any(|(tissue, _)| usize::from(*tissue) == t))
    }

    /// Material number `m` where each tissue is so many times as stiff as prepared, (tissues).
    pub fn mixed(&self, m: usize, stiffness: &[Real]) -> Material {
        let prepared = self.parts.materials[m];
        let MixtureParts { tissues, of } = &self.parts.mixtures;
        let Some(mixed) = of.get(m) else { return prepared.stiffened(stiffness[m]) };
        let factor = |(t, _): &(u16, u8)| stiffness[usize::from(*t)];
        let first = factor(&mixed[0]);
        if mixed.iter().all(|of| factor(of) == first) {
            return prepared.stiffened(first);
        }
        let part = |of: &(u16, u8)| (u32::from(of.1), tissues[usize::from(of.0)].stiffened(factor(of)));
        part(&mixed[0]).1.mixed(mixed[1..].iter().map(part))
    }
}
