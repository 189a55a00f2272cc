//! What a body is made of: the materials of its elements, and the tissues that these are mixed of.

use super::Body;
use super::parts::MixtureParts;
use crate::ids::{Element, Triangle, Vertex};
use crate::math::{Real, Vec3};
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

    /// The element that display vertex `v` lies in, on the finest level that reaches there.
    pub fn element_at(&self, v: Vertex) -> Element {
        let host = (0..self.levels().len()).rev().find_map(|r| self.embedding(r, v));
        host.map_or(Element(0), |host| host.element)
    }

    /// `material` with the fibres of element `e` where the files of the body say how they lie.
    pub fn led(&self, material: &Material, e: Element) -> Material {
        if !material.fibres.are_there() {
            return *material;
        }
        let (r, place) = self.place_of_element(e);
        self.parts.led(material, r, place)
    }

    /// Unit normal of the display surface at vertex `v` at rest, outward: the mean of the triangles around, by area.
    pub fn rest_normal(&self, v: Vertex) -> Vec3 {
        let area = |t: &Triangle| {
            let [a, b, c] = self.surface().corners(t.index());
            (b - a).cross(&(c - a))
        };
        self.triangles_around(v).iter().map(area).sum::<Vec3>().try_normalize(0.0).unwrap_or_default()
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
