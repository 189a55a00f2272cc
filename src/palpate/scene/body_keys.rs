//! The keys of one body of a scene: its shape and levels, its material, and where it is held.

use super::elastic_keys::{ElasticKeys, LARGEST_POISSON_RATIO, STIFFNESS, fill};
use super::law_keys::{Law, LawKeys};
use super::motion_keys::MotionKeys;
use garde::Validate;
use palpate_body::geometry::mesh_io::LengthUnit;
use palpate_body::prepare::inclusions::Place;
use palpate_body::prepare::region::Reach;
use palpate_body::prepare::{Elements, Region};
use palpate_core::ids::OrganId;
use palpate_core::math::{Bounds, Pose, Real, Vec3};
use palpate_core::model::{Material, SupportMotion};
use serde::{Deserialize, Serialize};
use std::path::PathBuf;

/// Where a body's shape comes from.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Source {
    /// The bundled organ, about 0.2 m wide.
    Liver,
    /// The bundled kidney, about 0.11 m long.
    Kidney,
    /// The bundled gallbladder, 0.075 m long.
    Gallbladder,
    /// The bundled stomach, about 0.09 m long.
    Stomach,
    /// The bundled toy with limbs that swing.
    Toy,
    /// A box from the origin to `size`, of structured conforming meshes.
    Box,
    /// An ellipsoid around the origin with the diameters `size`.
    Ellipsoid,
    /// A closed surface from `file`.
    Surface,
    /// Tetrahedral meshes from `files`, one per level.
    Volumes,
    /// A body that `palpate prepare` has made, from `file`.
    Prepared,
}

/// `[body]`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, Validate)]
#[serde(deny_unknown_fields)]
#[garde(allow_unvalidated)]
pub struct BodyKeys {
    /// Where the shape comes from.
    pub source: Source,
    /// `surface`: mesh file; `prepared`: `.palpate` file; relative to the scene's.
    #[serde(default, skip_serializing_if = "Option::is_none", serialize_with = "in_letters")]
    pub file: Option<PathBuf>,
    /// `volumes`: mesh files, coarse to fine, relative to the scene's.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub files: Vec<PathBuf>,
    /// Unit of the files' coordinates.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub unit: Option<LengthUnit>,
    /// Further factor on the files' coordinates.
    #[serde(default = "one")]
    #[garde(range(min = 1e-6, max = 1e6))]
    pub scale: Real,
    /// `box`: edge lengths [m].
    #[serde(default = "decimetre")]
    #[garde(inner(range(min = 1e-3, max = 10.0)))]
    pub size: [Real; 3],
    /// `box`: cells per axis, one triple per level, coarse to fine.
    #[serde(default = "two_levels")]
    #[garde(length(min = 1, max = 8), inner(inner(range(min = 1, max = 128))))]
    pub cells: Vec<[u32; 3]>,
    /// Lattice constants of the levels [m], coarse to fine; empty: four chosen by volume.
    #[serde(default)]
    #[garde(length(max = 8), inner(range(min = 1e-4, max = 1.0)), custom(falling))]
    pub spacings: Vec<Real>,
    /// Vertices of the display surface, about.
    #[serde(default = "display_vertices")]
    #[garde(range(min = 50, max = 20_000))]
    pub display_vertices: usize,
    /// Level whose nodes are all active, all the time; left out: the resolution adapts itself.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub active_level: Option<u32>,
    /// Surface that viewers are shown instead of the one that is touched; relative to the scene's file.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub display: Option<PathBuf>,
    /// Unit of its coordinates; left out: `unit`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub display_unit: Option<LengthUnit>,
    /// Which labels of the volume files regions of the material go by, where there are several.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub labels: Option<String>,
}

/// `[material]`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, Validate)]
#[serde(deny_unknown_fields, default)]
#[garde(allow_unvalidated)]
pub struct MaterialKeys {
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
    /// Their direction at rest, of any length; left out: that of each element of the volume files.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[garde(inner(inner(range(min = -1e3, max = 1e3))))]
    pub fibre_direction: Option<[Real; 3]>,
    /// Of which elements the body is made.
    pub elements: Elements,
    /// Damping ratio ζ of the slowest mode, by Maxwell branches of the stress.
    #[garde(range(min = 0.0, max = 0.4))]
    pub damping_ratio: Real,
    /// Relaxation time τ [s] of Kelvin–Voigt viscosity: φ = λτ, ψ = μτ.
    #[garde(range(min = 0.0, max = 1.0))]
    pub damping_time: Real,
    /// Viscosity φ [Pa·s], instead of λτ.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[garde(inner(range(min = 0.0, max = 1e9)))]
    pub phi: Option<Real>,
    /// Shear viscosity ψ [Pa·s], instead of μτ.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[garde(inner(range(min = 0.0, max = 1e9)))]
    pub psi: Option<Real>,
    /// Places where the material is another; later ones cover earlier ones.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    #[garde(dive, length(max = 16))]
    pub region: Vec<RegionKeys>,
}

/// `[[material.region]]`: a ball, a box or what has a label.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, Validate)]
#[serde(deny_unknown_fields)]
#[garde(allow_unvalidated)]
pub struct RegionKeys {
    /// What its parameters are called by; left out: "region" and its number, from 1.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[garde(length(min = 1, max = 64))]
    pub name: Option<String>,
    /// Centre of a ball at rest [m].
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[garde(inner(inner(range(min = -1e3, max = 1e3))))]
    pub centre: Option<[Real; 3]>,
    /// Its radius [m].
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[garde(inner(range(min = 5e-4, max = 1e3)))]
    pub radius: Option<Real>,
    /// Least corner of a box at rest [m].
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[garde(inner(inner(range(min = -1e3, max = 1e3))))]
    pub min: Option<[Real; 3]>,
    /// Its greatest corner [m].
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[garde(inner(inner(range(min = -1e3, max = 1e3))))]
    pub max: Option<[Real; 3]>,
    /// Label of a region of the volume files.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub label: Option<i64>,
    /// Young's modulus [Pa].
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[garde(inner(range(min = STIFFNESS.0, max = STIFFNESS.1)))]
    pub youngs_modulus: Option<Real>,
    /// Poisson's ratio; left out without `lambda` and `mu`: that of the rest.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[garde(inner(range(min = 0.0, max = LARGEST_POISSON_RATIO)))]
    pub poisson_ratio: Option<Real>,
    /// Lamé's first parameter λ [Pa]; with `mu`, instead of Young's modulus and Poisson's ratio.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub lambda: Option<Real>,
    /// Shear modulus μ [Pa]; with `lambda`, instead of Young's modulus and Poisson's ratio.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub mu: Option<Real>,
    /// Density [kg/m³]; left out: that of the rest.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[garde(inner(range(min = 1.0, max = 2e4)))]
    pub density: Option<Real>,
    /// What its elastic energy is; left out: that of the rest.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub law: Option<Law>,
    /// Young's modulus along fibres less that across [Pa]; left out: that of the rest.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[garde(inner(range(min = STIFFNESS.0, max = STIFFNESS.1)))]
    pub fibre_modulus: Option<Real>,
    /// Their direction at rest, of any length; left out: as in the rest.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[garde(inner(inner(range(min = -1e3, max = 1e3))))]
    pub fibre_direction: Option<[Real; 3]>,
}

impl RegionKeys {
    /// Its elastic constants as written.
    pub(super) fn elastic_keys(&self) -> ElasticKeys {
        let Self { youngs_modulus, poisson_ratio, lambda, mu, .. } = *self;
        ElasticKeys { youngs_modulus, poisson_ratio, lambda, mu }
    }

    /// Young's modulus [Pa] and Poisson's ratio of the region in a material of Poisson's ratio `rest`.
    pub(super) fn young(&self, rest: Real) -> (Real, Real) {
        let keys = self.elastic_keys();
        ElasticKeys { poisson_ratio: keys.poisson_ratio.or(Some(rest)), ..keys }.young()
    }

    /// Its law in a material of `rest`.
    pub(super) fn law_keys(&self, rest: &LawKeys) -> LawKeys {
        LawKeys {
            law: self.law.unwrap_or(rest.law),
            modulus: self.fibre_modulus.or(rest.modulus),
            direction: self.fibre_direction.or(rest.direction),
        }
    }

    /// The ball, the box or the label; `None` where the keys are those of none or of several, or of an empty box.
    pub(super) fn place(&self) -> Option<Place> {
        match (self.centre, self.radius, self.min, self.max, self.label) {
            (Some(centre), Some(radius), None, None, None) => Some(Reach::Ball(Vec3::from(centre), radius).into()),
            (None, None, Some(min), Some(max), None) if (0..3).all(|c| min[c] < max[c]) => {
                Some(Reach::Box(Bounds::new(Vec3::from(min), Vec3::from(max))).into())
            }
            (None, None, None, None, Some(label)) => Some(Place::Labelled(label)),
            _ => None,
        }
    }

    /// Adds what is wrong with the keys together, under `path`.
    pub(super) fn faults(&self, path: &str, elements: Elements, rest: &MaterialKeys, out: &mut Vec<(String, String)>) {
        let has_fibres = self.fibre_modulus.is_some() || self.fibre_direction.is_some();
        self.law_keys(&rest.law_keys()).faults(path, has_fibres, out);
        if self.place().is_none() {
            let fault = "give a ball, centre = [x, y, z] and radius, or a box, min = [x, y, z] and max, greater in each, or a label of the \
                 volume files";
            out.push((path.to_owned(), fault.to_owned()));
        }
        self.elastic_keys().region_faults(path, elements, out);
    }
}

impl MaterialKeys {
    /// Its elastic constants as written.
    pub(super) fn elastic_keys(&self) -> ElasticKeys {
        let Self { youngs_modulus, poisson_ratio, lambda, mu, .. } = *self;
        ElasticKeys { youngs_modulus, poisson_ratio, lambda, mu }
    }

    /// Its law as written.
    pub(super) fn law_keys(&self) -> LawKeys {
        LawKeys { law: self.law, modulus: self.fibre_modulus, direction: self.fibre_direction }
    }

    /// Its constants, without viscosity.
    pub(super) fn elastic(&self) -> Material {
        self.law_keys().of(self.elastic_keys().material(self.density))
    }

    /// Writes out the defaults of elastic constants.
    pub(super) fn fill(&mut self) {
        fill(self.elastic_keys(), &mut self.youngs_modulus, &mut self.poisson_ratio);
    }

    /// Adds what is wrong with the keys together, under `path`.
    pub(super) fn faults(&self, path: &str, out: &mut Vec<(String, String)>) {
        self.elastic_keys().faults(path, self.elements, out);
        let has_fibres = self.fibre_modulus.is_some() || self.fibre_direction.is_some();
        self.law_keys().faults(path, has_fibres, out);
        let regions = self.region.iter().enumerate();
        regions.for_each(|(i, region)| region.faults(&format!("{path}.region[{i}]"), self.elements, self, out));
    }
}

impl Default for MaterialKeys {
    fn default() -> Self {
        Self {
            youngs_modulus: None,
            poisson_ratio: None,
            lambda: None,
            mu: None,
            density: 1050.0,
            law: Law::default(),
            fibre_modulus: None,
            fibre_direction: None,
            elements: Elements::default(),
            damping_ratio: 0.0,
            damping_time: 1e-3,
            phi: None,
            psi: None,
            region: vec![],
        }
    }
}

/// `[[hold]]`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, Validate)]
#[serde(deny_unknown_fields)]
#[garde(allow_unvalidated)]
pub struct HoldKeys {
    /// Least corner of the region at rest [m].
    #[garde(inner(range(min = -1e3, max = 1e3)))]
    pub min: [Real; 3],
    /// Greatest corner [m].
    #[garde(inner(range(min = -1e3, max = 1e3)))]
    pub max: [Real; 3],
    /// Corners are fractions of the body's own box instead of metres.
    #[serde(default)]
    pub relative: bool,
    /// Stiffness per area [N/m³]; left out: 10 E over the finest spacing.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[garde(inner(range(min = 0.0, max = 1e12)))]
    pub stiffness: Option<Real>,
    /// Do not move the region's nodes at all (boxes and given meshes only).
    #[serde(default)]
    pub exact: bool,
    /// How its springs' other ends move; left out: not at all.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[garde(dive)]
    pub motion: Option<MotionKeys>,
}

impl HoldKeys {
    /// The region, for a body of this box.
    pub(super) fn region(&self, body: Bounds) -> Region {
        let place = |corner: [Real; 3]| {
            let corner = Vec3::from(corner);
            if self.relative { body.low + body.size().component_mul(&corner) } else { corner }
        };
        Region { bounds: Bounds::new(place(self.min), place(self.max)), stiffness: self.stiffness, exact: self.exact }
    }

    /// How what it holds of `organ`, whose own frame is `frame`, is moved.
    pub(super) fn support_motion(&self, organ: OrganId, frame: Pose) -> Option<SupportMotion> {
        let region = Bounds::new(Vec3::from(self.min), Vec3::from(self.max));
        let motion = self.motion.as_ref()?.periodic();
        Some(SupportMotion { organ, frame, region, relative: self.relative, motion })
    }
}

/// What is wrong with motions of `holds` at `path`.
pub(super) fn hold_faults(holds: &[HoldKeys], path: &str, out: &mut Vec<(String, String)>) {
    for (i, hold) in holds.iter().enumerate() {
        let Some(motion) = &hold.motion else { continue };
        if hold.exact {
            out.push((format!("{path}[{i}].motion"), "what does not move at all cannot: exact = false".into()));
        }
        motion.faults(&format!("{path}[{i}].motion"), out);
    }
}

/// The name of a file, whose bytes may be no text, as near to it as letters are.
fn in_letters<S: serde::Serializer>(file: &Option<PathBuf>, serializer: S) -> Result<S::Ok, S::Error> {
    file.as_ref().map(|file| file.to_string_lossy()).serialize(serializer)
}

fn one() -> Real {
    1.0
}
fn decimetre() -> [Real; 3] {
    [0.1; 3]
}
fn two_levels() -> Vec<[u32; 3]> {
    vec![[3; 3], [5; 3]]
}
fn display_vertices() -> usize {
    palpate_body::prepare::DISPLAY_VERTICES
}

fn falling(spacings: &[Real], _: &()) -> garde::Result {
    let ordered = spacings.windows(2).all(|pair| pair[1] <= 0.8 * pair[0]);
    if ordered { Ok(()) } else { Err(garde::Error::new("each spacing must be at most 0.8 of the one before it")) }
}
