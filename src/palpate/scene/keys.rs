//! The keys of a scene, each with its range and default, and what follows from them.

use super::elastic_keys::{ElasticKeys, LARGEST_POISSON_RATIO, STIFFNESS, fill};
use super::organ_keys::OrganKeys;
use super::tool_keys::{ToolKeys, centimetre};
use garde::Validate;
use palpate_body::geometry::mesh_io::LengthUnit;
use palpate_body::prepare::Region;
use palpate_body::prepare::inclusions::{Inclusion, Place};
use palpate_body::prepare::region::Reach;
use palpate_core::adaptation::{Adaptivity, finest_steppable};
use palpate_core::contact::safety::ForceLimits;
use palpate_core::contact::tool::{Following, MOST_TOOLS};
use palpate_core::geometry::locate::{Host, Locator};
use palpate_core::math::{Bounds, Real, Vec3};
use palpate_core::model::element_pool::CLASSES;
use palpate_core::model::organ::MOST_ORGANS;
use palpate_core::model::step_class::step_of;
use palpate_core::model::{Body, Material};
use palpate_core::simulation::{Inputs, Settings, Simulation, Snapshot, TICK};
use serde::{Deserialize, Serialize};
use std::path::PathBuf;
use std::sync::Arc;

/// A scene as written, every key with its default.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, Validate)]
#[serde(deny_unknown_fields)]
#[garde(allow_unvalidated)]
pub struct Scene {
    /// Name of the body, for people.
    #[garde(length(min = 1, max = 64))]
    pub name: String,
    /// Its shape and levels.
    #[garde(dive)]
    pub body: BodyKeys,
    /// Its material.
    #[serde(default)]
    #[garde(dive)]
    pub material: MaterialKeys,
    /// When to refine and coarsen.
    #[serde(default)]
    #[garde(dive)]
    pub resolution: ResolutionKeys,
    /// Regions held in space.
    #[serde(default)]
    #[garde(dive, length(max = 64))]
    pub hold: Vec<HoldKeys>,
    /// Further bodies beside it, which do not touch it.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    #[garde(dive, length(max = MOST_ORGANS - 1))]
    pub organ: Vec<OrganKeys>,
    /// Tools that clients may take; one ball when the list is empty.
    #[serde(default = "one_ball")]
    #[garde(dive, length(min = 1, max = MOST_TOOLS))]
    pub tool: Vec<ToolKeys>,
    /// Gravity and settling.
    #[serde(default)]
    #[garde(dive)]
    pub world: WorldKeys,
    /// Limits on poses and forces.
    #[serde(default)]
    #[garde(dive)]
    pub safety: SafetyKeys,
    /// Points whose motion `simulate` writes down.
    #[serde(default)]
    #[garde(dive, length(max = 64))]
    pub probe: Vec<ProbeKeys>,
}

/// Where a body's shape comes from.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Source {
    /// The bundled organ, about 0.2 m wide.
    Liver,
    /// The bundled kidney, about 0.11 m long.
    Kidney,
    /// The bundled toy with limbs that swing.
    Toy,
    /// A box from the origin to `size`, of structured conforming meshes.
    Box,
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
    #[serde(default, skip_serializing_if = "Option::is_none")]
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
    /// Which labels of the volume files regions of the material go by, where there are several.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub labels: Option<String>,
}

/// `[resolution]`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, Validate)]
#[serde(deny_unknown_fields, default)]
#[garde(allow_unvalidated)]
pub struct ResolutionKeys {
    /// Strain jump (mean deviation from the mean strain around a node) above which a node is split.
    #[garde(range(min = 1e-4, max = 10.0))]
    pub split: Real,
    /// Part of `split` below which nodes are merged again.
    #[garde(range(min = 0.0, max = 0.9))]
    pub merge: Real,
    /// Nodes closer to a tool than this many spacings of their level are split.
    #[garde(range(min = 0.0, max = 10.0))]
    pub reach: Real,
    /// Finest level to be used; left out: the finest that can be stepped.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub finest_level: Option<u32>,
    /// Most elements in use at once: what memory is made for.
    #[garde(range(min = 100, max = 4_000_000))]
    pub most_elements: usize,
}

impl Default for ResolutionKeys {
    fn default() -> Self {
        let Adaptivity { split, merge, reach, .. } = Adaptivity::default();
        Self { split, merge, reach, finest_level: None, most_elements: 60_000 }
    }
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

    /// The ball, the box or the label; `None` where the keys are those of none or of several, or of an empty box.
    fn place(&self) -> Option<Place> {
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
    pub(super) fn faults(&self, path: &str, out: &mut Vec<(String, String)>) {
        if self.place().is_none() {
            let fault = "give a ball, centre = [x, y, z] and radius, or a box, min = [x, y, z] and max, greater in each, or a label of the \
                 volume files";
            out.push((path.to_owned(), fault.to_owned()));
        }
        self.elastic_keys().region_faults(path, out);
    }
}

impl MaterialKeys {
    /// Its elastic constants as written.
    pub(super) fn elastic_keys(&self) -> ElasticKeys {
        let Self { youngs_modulus, poisson_ratio, lambda, mu, .. } = *self;
        ElasticKeys { youngs_modulus, poisson_ratio, lambda, mu }
    }

    /// Its constants, without viscosity.
    pub(super) fn elastic(&self) -> Material {
        self.elastic_keys().material(self.density)
    }

    /// Writes out the defaults of elastic constants.
    pub(super) fn fill(&mut self) {
        fill(self.elastic_keys(), &mut self.youngs_modulus, &mut self.poisson_ratio);
    }

    /// Adds what is wrong with the keys together, under `path`.
    pub(super) fn faults(&self, path: &str, out: &mut Vec<(String, String)>) {
        self.elastic_keys().faults(path, out);
        let regions = self.region.iter().enumerate();
        regions.for_each(|(i, region)| region.faults(&format!("{path}.region[{i}]"), out));
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
}

/// `[world]`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, Validate)]
#[serde(deny_unknown_fields, default)]
#[garde(allow_unvalidated)]
pub struct WorldKeys {
    /// Gravity [m/s²].
    #[garde(inner(range(min = -100.0, max = 100.0)))]
    pub gravity: [Real; 3],
    /// How long the body comes to rest under its load before it is served [s].
    #[garde(range(min = 0.0, max = 60.0))]
    pub settle: Real,
}

impl Default for WorldKeys {
    fn default() -> Self {
        Self { gravity: [0.0, 0.0, -9.81], settle: 2.0 }
    }
}

/// `[safety]`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, Validate)]
#[serde(deny_unknown_fields, default)]
#[garde(allow_unvalidated)]
pub struct SafetyKeys {
    /// Largest rendered force [N].
    #[garde(range(min = 0.01, max = 100.0))]
    pub force_limit: Real,
    /// Largest rendered torque [N·m].
    #[garde(range(min = 1e-4, max = 10.0))]
    pub torque_limit: Real,
    /// Fastest change of the rendered force [N/s].
    #[garde(range(min = 1.0, max = 1e5))]
    pub slew_limit: Real,
    /// Fastest that a touching tool moves [m/s].
    #[garde(range(min = 0.01, max = 1.5))]
    pub tool_speed: Real,
    /// Rise of the force from zero at engage [s].
    #[garde(range(min = 0.001, max = 5.0))]
    pub engage_time: Real,
    /// How far poses may be outside the body's box [m]; those beyond are refused.
    #[garde(range(min = 0.01, max = 10.0))]
    pub workspace_margin: Real,
}

impl Default for SafetyKeys {
    fn default() -> Self {
        Self {
            force_limit: 3.3,
            torque_limit: 0.2,
            slew_limit: 1000.0,
            tool_speed: 1.0,
            engage_time: 0.1,
            workspace_margin: 0.5,
        }
    }
}

/// `[[probe]]`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, Validate)]
#[serde(deny_unknown_fields)]
#[garde(allow_unvalidated)]
pub struct ProbeKeys {
    /// Column name.
    #[garde(length(min = 1, max = 32))]
    pub name: String,
    /// Place at rest [m].
    #[garde(inner(range(min = -1e3, max = 1e3)))]
    pub position: [Real; 3],
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
fn one_ball() -> Vec<ToolKeys> {
    vec![ToolKeys::ball("ball", centimetre())]
}
fn falling(spacings: &[Real], _: &()) -> garde::Result {
    let ordered = spacings.windows(2).all(|pair| pair[1] <= 0.8 * pair[0]);
    if ordered { Ok(()) } else { Err(garde::Error::new("each spacing must be at most 0.8 of the one before it")) }
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
}

impl Scene {
    /// The material's constants.
    pub fn material(&self) -> Material {
        let keys = &self.material;
        let elastic = keys.elastic();
        Material {
            phi: keys.phi.unwrap_or(elastic.lambda * keys.damping_time),
            psi: keys.psi.unwrap_or(elastic.mu * keys.damping_time),
            ..elastic
        }
    }

    /// Where the material is stiffer or softer.
    pub fn inclusions(&self) -> Vec<Inclusion> {
        let (_, rest) = self.material.elastic_keys().young();
        let inclusion = |region: &RegionKeys| {
            let (youngs_modulus, poisson_ratio) = region.young(rest);
            Some(Inclusion {
                place: region.place()?,
                youngs_modulus,
                poisson_ratio,
                density: region.density.unwrap_or(self.material.density),
            })
        };
        self.material.region.iter().filter_map(inclusion).collect()
    }

    /// The simulation's settings.
    pub fn settings(&self) -> Settings {
        Settings {
            gravity: Vec3::from(self.world.gravity),
            tools: self.tool.iter().map(ToolKeys::tool).collect(),
            following: Following {
                speed: self.safety.tool_speed,
                engage_ticks: (self.safety.engage_time / TICK).ceil() as u32,
            },
            limits: ForceLimits {
                force: self.safety.force_limit,
                torque: self.safety.torque_limit,
                slew: self.safety.slew_limit,
            },
            adaptivity: self.body.active_level.is_none().then(|| Adaptivity {
                split: self.resolution.split,
                merge: self.resolution.merge,
                reach: self.resolution.reach,
                finest: self.resolution.finest_level.map_or(usize::MAX, |r| r as usize),
            }),
            most_elements: self.resolution.most_elements,
        }
    }

    /// What of `body` this scene cannot use, in words.
    pub fn warning(&self, body: &Body) -> Option<String> {
        let usable = finest_steppable(body);
        let wanted = self.body.active_level.or(self.resolution.finest_level).map_or(body.finest(), |r| r as usize);
        (wanted > usable).then(|| {
            format!(
                "{}: the elements of level {} need steps below {:.0} µs and cannot be simulated; levels up to {usable} \
                 are used",
                body.name(),
                usable + 1,
                1e6 * step_of(CLASSES - 1)
            )
        })
    }

    /// The box that poses must lie in [m].
    pub fn workspace(&self, body: &Body) -> Bounds {
        body.surface().bounds().grown(self.safety.workspace_margin)
    }

    /// Where each probe lies on each level that reaches there, coarsest first; elements are numbered through.
    pub fn probes(&self, body: &Body) -> Vec<Vec<Host>> {
        let on = |r: usize, p: &ProbeKeys| {
            let host = Locator::new(&body.level(r).mesh, body.level(r).spacing).host(Vec3::from(p.position));
            let reaches = body.level(r).is_whole() || host.extrapolation() > -0.5;
            reaches.then(|| Host { element: host.element + body.elements_of(r).start, ..host })
        };
        self.probe.iter().map(|p| (0..body.levels().len()).filter_map(|r| on(r, p)).collect()).collect()
    }

    /// The body at rest, as it starts before it settles.
    pub fn at_rest(&self, body: &Body) -> Snapshot {
        let level = self.body.active_level.map_or(0, |r| r as usize);
        Snapshot::at_rest(body, level.min(finest_steppable(body)), self.tool.len())
    }

    /// The state in which `body` has come to rest under its load: `world.settle` seconds of ticks in which its
    /// velocities fade, so that it does not swing when it is first touched.
    pub fn settled(&self, body: &Arc<Body>, progress: &mut dyn FnMut(&str, usize, usize)) -> Snapshot {
        let rest = self.at_rest(body);
        let ticks = (self.world.settle / TICK) as usize;
        let Ok(mut simulation) = Simulation::new(body.clone(), self.settings(), rest.clone()) else { return rest };
        for tick in 0..ticks {
            if tick % 100 == 0 {
                progress("settling under gravity", tick, ticks);
            }
            simulation.advance(&Inputs::default());
            simulation.mesh_mut().change_motion(|_, _, v| *v *= 0.98);
        }
        progress("settling under gravity", ticks, ticks);
        simulation.mesh_mut().change_motion(|_, _, v| *v = Vec3::zeros());
        Snapshot { tick: 0, ..simulation.snapshot() }
    }

    /// The scene with every default written out.
    pub fn to_toml(&self) -> String {
        // Scenes hold nothing that TOML cannot say.
        toml::to_string(self).unwrap_or_default()
    }
}
