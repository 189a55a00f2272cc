//! Further bodies of a scene, beside `[body]`: the keys of each, and the scene that it would be alone.

use super::body_keys::{BodyKeys, HoldKeys, MaterialKeys, RegionKeys, hold_faults};
use super::elastic_keys::{ElasticKeys, LARGEST_POISSON_RATIO, STIFFNESS, fill};
use super::law_keys::Law;
use super::tool_keys::{unit_quaternion, upright};
use garde::Validate;
use palpate_core::math::{Pose, Real, Vec3, normalized_quaternion};
use serde::{Deserialize, Serialize};

/// `[[organ]]`: as `[body]`, `[material]` and `[[hold]]` of a scene of its own, and where it is.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, Validate)]
#[serde(deny_unknown_fields)]
#[garde(allow_unvalidated)]
pub struct OrganKeys {
    /// For people.
    #[garde(length(min = 1, max = 64))]
    pub name: String,
    /// Where the origin of its own frame is [m].
    #[serde(default)]
    #[garde(inner(range(min = -1e3, max = 1e3)))]
    pub position: [Real; 3],
    /// How its own frame is turned: unit quaternion x, y, z, w.
    #[serde(default = "upright")]
    #[garde(custom(unit_quaternion))]
    pub orientation: [Real; 4],
    /// Its shape and levels; lengths are in its own frame.
    #[garde(dive)]
    pub body: BodyKeys,
    /// Its material.
    #[serde(default)]
    #[garde(dive)]
    pub material: TissueKeys,
    /// Regions held in space.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    #[garde(dive, length(max = 64))]
    pub hold: Vec<HoldKeys>,
}

/// `[organ.material]`: a material without damping, which is the same for the whole scene.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, Validate)]
#[serde(deny_unknown_fields, default)]
#[garde(allow_unvalidated)]
pub struct TissueKeys {
    /// Young's modulus [Pa]; left out without `lambda` and `mu`: 5000.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[garde(inner(range(min = STIFFNESS.0, max = STIFFNESS.1)))]
    pub youngs_modulus: Option<Real>,
    /// Poisson's ratio; left out without `lambda` and `mu`: 0.45.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[garde(inner(range(min = 0.0, max = LARGEST_POISSON_RATIO)))]
    pub poisson_ratio: Option<Real>,
    /// Lamé's first parameter λ [Pa]; with `mu`, instead of Young's modulus and Poisson's ratio.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub lambda: Option<Real>,
    /// Shear modulus μ [Pa]; with `lambda`, instead of Young's modulus and Poisson's ratio.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub mu: Option<Real>,
    /// Density [kg/m³].
    #[garde(range(min = 1.0, max = 2e4))]
    pub density: Real,
    /// What its elastic energy is.
    pub law: Law,
    /// Young's modulus along fibres less that across [Pa].
    #[serde(skip_serializing_if = "Option::is_none")]
    #[garde(inner(range(min = STIFFNESS.0, max = STIFFNESS.1)))]
    pub fibre_modulus: Option<Real>,
    /// Their direction at rest in the organ's own frame, of any length; left out: that of each element of the volume files.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[garde(inner(inner(range(min = -1e3, max = 1e3))))]
    pub fibre_direction: Option<[Real; 3]>,
    /// Places where the material is another, in the organ's own frame; later ones cover earlier ones.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    #[garde(dive, length(max = 16))]
    pub region: Vec<RegionKeys>,
}

impl TissueKeys {
    /// Its elastic constants as written.
    pub(super) fn elastic_keys(&self) -> ElasticKeys {
        let Self { youngs_modulus, poisson_ratio, lambda, mu, .. } = *self;
        ElasticKeys { youngs_modulus, poisson_ratio, lambda, mu }
    }

    /// The same with the damping and the elements of a `scene`.
    pub(super) fn in_scene(&self, scene: &MaterialKeys) -> MaterialKeys {
        let Self {
            youngs_modulus,
            poisson_ratio,
            lambda,
            mu,
            density,
            law,
            fibre_modulus,
            fibre_direction,
            ref region,
        } = *self;
        let (region, damping) = (region.clone(), scene.clone());
        MaterialKeys {
            youngs_modulus,
            poisson_ratio,
            lambda,
            mu,
            density,
            law,
            fibre_modulus,
            fibre_direction,
            region,
            ..damping
        }
    }

    /// Writes out the defaults of elastic constants.
    pub(super) fn fill(&mut self) {
        fill(self.elastic_keys(), &mut self.youngs_modulus, &mut self.poisson_ratio);
    }

    /// Names of its keys: what is taken over from a prepared body.
    pub(super) const KEYS: [&str; 9] = [
        "youngs_modulus",
        "poisson_ratio",
        "lambda",
        "mu",
        "density",
        "law",
        "fibre_modulus",
        "fibre_direction",
        "region",
    ];
}

impl Default for TissueKeys {
    fn default() -> Self {
        let MaterialKeys {
            youngs_modulus,
            poisson_ratio,
            lambda,
            mu,
            density,
            law,
            fibre_modulus,
            fibre_direction,
            region,
            ..
        } = MaterialKeys::default();
        Self { youngs_modulus, poisson_ratio, lambda, mu, density, law, fibre_modulus, fibre_direction, region }
    }
}

impl OrganKeys {
    /// Where it is.
    pub fn pose(&self) -> Pose {
        let orientation = normalized_quaternion(self.orientation).unwrap_or_else(upright);
        Pose { position: Vec3::from(self.position), orientation }
    }

    /// Adds what is wrong with the keys together, under `path`.
    pub(super) fn faults(&self, path: &str, scene: &MaterialKeys, out: &mut Vec<(String, String)>) {
        hold_faults(&self.hold, &format!("{path}.hold"), out);
        self.material.in_scene(scene).faults(&format!("{path}.material"), out);
        if self.body.active_level.is_some() {
            out.push((format!("{path}.body.active_level"), "is for [body], and means every organ".into()));
        }
    }
}
