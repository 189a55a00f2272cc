//! What keys say of the elastic law of a material, and of its fibres.

use palpate_core::math::{Real, Vec3};
use palpate_core::model::{Fibres, Material};
use serde::{Deserialize, Serialize};

/// What the elastic energy of a material is.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Law {
    /// St. Venant and Kirchhoff's: softens when squeezed.
    #[default]
    StVenantKirchhoff,
    /// The neo-Hookean one, without a pole where elements invert.
    NeoHookean,
    /// That with fibres in it.
    TransverselyIsotropic,
}

/// The keys of a law.
#[derive(Clone, Copy)]
pub(super) struct LawKeys {
    pub law: Law,
    /// Young's modulus along fibres less that across [Pa].
    pub modulus: Option<Real>,
    /// Their direction at rest, of any length; left out: as the volume files say.
    pub direction: Option<[Real; 3]>,
}

impl LawKeys {
    /// `material` of that law.
    pub(super) fn of(&self, material: Material) -> Material {
        Material { neo_hookean: self.neo_hookean(), fibres: self.fibres(), ..material }
    }

    /// As [`Material::neo_hookean`].
    pub(super) fn neo_hookean(&self) -> Real {
        if self.law == Law::StVenantKirchhoff { 0.0 } else { 1.0 }
    }

    /// As [`Material::fibres`].
    pub(super) fn fibres(&self) -> Fibres {
        match self.modulus {
            Some(modulus) if self.law == Law::TransverselyIsotropic => {
                Fibres { modulus, direction: self.direction.and_then(along).unwrap_or_default() }
            }
            _ => Fibres::NONE,
        }
    }

    /// Adds what is wrong with them, in the table `path`, which has keys of fibres or not.
    pub(super) fn faults(&self, path: &str, has_fibres: bool, out: &mut Vec<(String, String)>) {
        let (key, fault) = match self.law {
            Law::TransverselyIsotropic if self.modulus.is_none() => (
                "fibre_modulus",
                "give what fibres add to Young's modulus [Pa], or another law than transversely_isotropic",
            ),
            Law::TransverselyIsotropic if self.direction.is_some_and(|a| along(a).is_none()) => {
                ("fibre_direction", "give a direction, or leave it out where the volume files have some")
            }
            Law::StVenantKirchhoff | Law::NeoHookean if has_fibres => {
                ("law", "give transversely_isotropic, the law with fibres, or no fibre_modulus and fibre_direction")
            }
            _ => return,
        };
        out.push((format!("{path}.{key}"), fault.to_owned()));
    }
}

/// A direction of length 1; `None` for no direction.
fn along(direction: [Real; 3]) -> Option<Vec3> {
    Vec3::from(direction).try_normalize(0.0)
}
