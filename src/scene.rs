//! Scenes: TOML text → checked parameters → a body and the settings of its simulation.
//!
//! Every key stands in `config/scenes/reference.toml` with its unit, range and default; a test holds the two together.
//! A wrong key, a bad value or a bad mesh gets an error that names the file, the line and what to do.

use crate::contact::safety::ForceLimits;
use crate::contact::tool::{Following, MOST_TOOLS, Shape as ToolShape, Tool};
use crate::geometry::MeshError;
use crate::geometry::decimate::decimate;
use crate::geometry::locate::{Host, Locator};
use crate::geometry::mesh_io::{self, LengthUnit};
use crate::geometry::{Surface, TetMesh, primitives};
use crate::math::{Real, Vec3};
use crate::model::{Body, Material};
use crate::prepare::{self, PrepareError, Recipe, Region};
use crate::simulation::{Inputs, Settings, Simulation, Snapshot, TICK};
use garde::Validate;
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Scenes that come with the program: name and text.
pub const BUNDLED: [(&str, &str); 4] = [
    ("liver", include_str!("../config/scenes/liver.toml")),
    ("toy", include_str!("../config/scenes/toy.toml")),
    ("cube", include_str!("../config/scenes/cube.toml")),
    ("organ", include_str!("../config/scenes/organ.toml")),
];

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
    /// Regions held in space.
    #[serde(default)]
    #[garde(dive, length(max = 64))]
    pub hold: Vec<HoldKeys>,
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
    /// The bundled toy with limbs that swing.
    Toy,
    /// A box from the origin to `size`, of structured conforming meshes.
    Box,
    /// A closed surface from `file`.
    Surface,
    /// Tetrahedral meshes from `files`, one per level.
    Volumes,
}

/// `[body]`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, Validate)]
#[serde(deny_unknown_fields)]
#[garde(allow_unvalidated)]
pub struct BodyKeys {
    /// Where the shape comes from.
    pub source: Source,
    /// `surface`: OBJ or STL file, relative to the scene's.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub file: Option<PathBuf>,
    /// `volumes`: MSH files, coarse to fine, relative to the scene's.
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
    /// Lattice constants of the levels [m], coarse to fine; empty: three chosen by volume.
    #[serde(default)]
    #[garde(length(max = 8), inner(range(min = 1e-4, max = 1.0)), custom(falling))]
    pub spacings: Vec<Real>,
    /// Vertices of the display surface, about.
    #[serde(default = "display_vertices")]
    #[garde(range(min = 50, max = 5_000))]
    pub display_vertices: usize,
    /// Level that moves; left out: the finest that the tick covers.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub active_level: Option<u32>,
}

/// `[material]`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, Validate)]
#[serde(deny_unknown_fields, default)]
#[garde(allow_unvalidated)]
pub struct MaterialKeys {
    /// Young's modulus [Pa].
    #[garde(range(min = 10.0, max = 1e9))]
    pub youngs_modulus: Real,
    /// Poisson's ratio.
    #[garde(range(min = 0.0, max = 0.49))]
    pub poisson_ratio: Real,
    /// Density [kg/m³].
    #[garde(range(min = 1.0, max = 2e4))]
    pub density: Real,
    /// Relaxation time τ [s]: φ = λτ, ψ = μτ.
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
}

impl Default for MaterialKeys {
    fn default() -> Self {
        Self { youngs_modulus: 5e3, poisson_ratio: 0.45, density: 1050.0, damping_time: 1e-3, phi: None, psi: None }
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

/// `[[tool]]`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, Validate)]
#[serde(deny_unknown_fields)]
#[garde(allow_unvalidated)]
pub struct ToolKeys {
    /// Name that clients ask for.
    #[garde(length(min = 1, max = 32))]
    pub name: String,
    /// Radius [m].
    #[serde(default = "centimetre")]
    #[garde(range(min = 5e-4, max = 0.1))]
    pub radius: Real,
    /// Length of the capsule's axis along the tool's own +z [m]; 0 is a ball.
    #[serde(default)]
    #[garde(range(min = 0.0, max = 1.0))]
    pub length: Real,
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
fn centimetre() -> Real {
    0.01
}
fn decimetre() -> [Real; 3] {
    [0.1; 3]
}
fn two_levels() -> Vec<[u32; 3]> {
    vec![[2; 3], [4; 3]]
}
fn display_vertices() -> usize {
    2_500
}
fn one_ball() -> Vec<ToolKeys> {
    vec![ToolKeys { name: "ball".into(), radius: centimetre(), length: 0.0 }]
}
fn falling(spacings: &[Real], _: &()) -> garde::Result {
    let ordered = spacings.windows(2).all(|pair| pair[1] <= 0.8 * pair[0]);
    if ordered { Ok(()) } else { Err(garde::Error::new("each spacing must be at most 0.8 of the one before it")) }
}

/// Why a scene cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum SceneError {
    /// No such file, and no bundled scene of that name.
    #[error("cannot read scene {}: {source}; bundled scenes are {}", path.display(), bundled_names())]
    Read {
        /// What was asked for.
        path: PathBuf,
        /// Why.
        source: std::io::Error,
    },
    /// Not TOML, a wrong key or a wrong type; the text shows line and place.
    #[error("{origin}: {message}")]
    Syntax {
        /// File or bundled scene.
        origin: String,
        /// What, with the line and a caret.
        message: String,
    },
    /// Values out of range.
    #[error("{}", .0.join("\n"))]
    Values(
        /// One line per value: file, line, key, range.
        Vec<String>,
    ),
    /// A `key=value` override that is none.
    #[error("--set {given}: {message}")]
    Override {
        /// As given.
        given: String,
        /// What to do.
        message: String,
    },
    /// A mesh file that cannot be used.
    #[error("{origin}: body: {}: {source}", path.display())]
    Mesh {
        /// File or bundled scene.
        origin: String,
        /// The mesh file.
        path: PathBuf,
        /// Why.
        source: Box<MeshError>,
    },
    /// A key that the source needs.
    #[error("{origin}: body.source = \"{source_name}\" needs {needs}")]
    Missing {
        /// File or bundled scene.
        origin: String,
        /// The source.
        source_name: &'static str,
        /// What is missing, with an example.
        needs: &'static str,
    },
    /// Shapes and parameters that make no body.
    #[error("{origin}: {source}")]
    Prepare {
        /// File or bundled scene.
        origin: String,
        /// Why.
        source: Box<PrepareError>,
    },
}

fn bundled_names() -> String {
    BUNDLED.map(|b| b.0).join(", ")
}

/// A scene together with where it came from.
#[derive(Clone, Debug, PartialEq)]
pub struct LoadedScene {
    /// Its keys.
    pub scene: Scene,
    /// File or "bundled scene …", for messages.
    pub origin: String,
    /// Folder that its file names are relative to.
    pub folder: PathBuf,
}

impl LoadedScene {
    /// Reads the scene file at `path`, or the bundled scene of that name, and applies `overrides` (`key=value`,
    /// dotted keys, TOML values; a bare word counts as a string).
    ///
    /// # Errors
    /// With file, line and remedy.
    pub fn load(path: &Path, overrides: &[String]) -> Result<Self, SceneError> {
        let bundled = BUNDLED.iter().find(|(name, _)| Path::new(name) == path);
        let (text, origin, folder) = match bundled {
            Some((name, text)) => ((*text).to_owned(), format!("bundled scene {name}"), PathBuf::new()),
            None => {
                let text = std::fs::read_to_string(path)
                    .map_err(|source| SceneError::Read { path: path.to_owned(), source })?;
                let folder = path.parent().unwrap_or(Path::new("")).to_owned();
                (text, path.display().to_string(), folder)
            }
        };
        let (text, origin) = if overrides.is_empty() {
            (text, origin)
        } else {
            (override_keys(&text, &origin, overrides)?, format!("{origin} with --set"))
        };
        Ok(Self { scene: parse(&text, &origin)?, origin, folder })
    }

    /// Builds the body; `progress` hears what is done next, and its place among how many.
    ///
    /// # Errors
    /// When a mesh is missing or broken, or the keys make no body.
    pub fn build(&self, progress: &mut dyn FnMut(&str, usize, usize)) -> Result<Body, SceneError> {
        progress("reading shapes", 0, 1);
        let shape = self.shape()?;
        let bounds = match &shape {
            prepare::Shape::Closed(surface, _) => surface.bounds(),
            prepare::Shape::Meshes(meshes) => {
                Surface { vertices: meshes.iter().flat_map(|m| m.nodes.clone()).collect(), triangles: vec![] }.bounds()
            }
        };
        let recipe = Recipe {
            name: self.scene.name.clone(),
            shape,
            material: self.scene.material(),
            holds: self.scene.hold.iter().map(|h| h.region(bounds)).collect(),
            active_level: self.scene.body.active_level,
        };
        prepare::prepare(&recipe, progress)
            .map_err(|source| SceneError::Prepare { origin: self.origin.clone(), source: Box::new(source) })
    }

    fn shape(&self) -> Result<prepare::Shape, SceneError> {
        let keys = &self.scene.body;
        let missing = |source_name, needs| SceneError::Missing { origin: self.origin.clone(), source_name, needs };
        let unit = |source_name| {
            keys.unit.ok_or_else(|| missing(source_name, "body.unit, one of \"m\", \"cm\", \"mm\", \"in\""))
        };
        let at = |file: &PathBuf| self.folder.join(file);
        let failed =
            |path: PathBuf, source| SceneError::Mesh { origin: self.origin.clone(), path, source: Box::new(source) };
        // A surface net at this spacing has about as many vertices as asked for (area over spacing squared).
        let spacing = |area: Real| (area / keys.display_vertices as Real).sqrt();
        let closed = |mut surface: Surface| {
            surface.vertices.iter_mut().for_each(|v| *v *= keys.scale);
            prepare::Shape::Closed(surface, keys.spacings.clone())
        };
        Ok(match keys.source {
            Source::Liver => closed(primitives::liver_surface(spacing(LIVER_AREA))),
            Source::Toy => closed(primitives::toy_surface(spacing(TOY_AREA))),
            Source::Box => {
                let size = Vec3::from(keys.size) * keys.scale;
                prepare::Shape::Meshes(keys.cells.iter().map(|c| primitives::box_mesh(size, *c)).collect())
            }
            Source::Surface => {
                let file = keys.file.as_ref().ok_or_else(|| missing("surface", "body.file, an OBJ or STL file"))?;
                let unit = unit("surface")?;
                let surface = mesh_io::read_surface(&at(file), unit).map_err(|e| failed(at(file), e))?;
                closed(decimate(&surface, keys.display_vertices))
            }
            Source::Volumes => {
                if keys.files.is_empty() {
                    return Err(missing("volumes", "body.files, a list of MSH files from coarse to fine"));
                }
                let unit = unit("volumes")?;
                let read = |file: &PathBuf| {
                    let mut mesh = mesh_io::read_tet_mesh(&at(file), unit).map_err(|e| failed(at(file), e))?;
                    mesh.nodes.iter_mut().for_each(|u| *u *= keys.scale);
                    Ok(mesh)
                };
                prepare::Shape::Meshes(keys.files.iter().map(read).collect::<Result<Vec<TetMesh>, SceneError>>()?)
            }
        })
    }
}

/// Areas of the bundled shapes [m²]: they turn a vertex count into a spacing.
const LIVER_AREA: Real = 0.070;
const TOY_AREA: Real = 0.060;

impl HoldKeys {
    fn region(&self, (low, high): (Vec3, Vec3)) -> Region {
        let place = |corner: [Real; 3]| {
            let corner = Vec3::from(corner);
            if self.relative { low + (high - low).component_mul(&corner) } else { corner }
        };
        Region { bounds: (place(self.min), place(self.max)), stiffness: self.stiffness, exact: self.exact }
    }
}

impl Scene {
    /// The material's constants.
    pub fn material(&self) -> Material {
        let keys = &self.material;
        let elastic = Material::from_young(keys.youngs_modulus, keys.poisson_ratio, keys.density);
        Material {
            phi: keys.phi.unwrap_or(elastic.lambda * keys.damping_time),
            psi: keys.psi.unwrap_or(elastic.mu * keys.damping_time),
            ..elastic
        }
    }

    /// The simulation's settings.
    pub fn settings(&self) -> Settings {
        let tool = |keys: &ToolKeys| Tool {
            name: keys.name.clone(),
            shape: ToolShape { radius: keys.radius, length: keys.length },
        };
        Settings {
            gravity: Vec3::from(self.world.gravity),
            tools: self.tool.iter().map(tool).collect(),
            following: Following {
                speed: self.safety.tool_speed,
                engage_ticks: (self.safety.engage_time / TICK).ceil() as u32,
            },
            limits: ForceLimits {
                force: self.safety.force_limit,
                torque: self.safety.torque_limit,
                slew: self.safety.slew_limit,
            },
        }
    }

    /// The box that poses must lie in [m].
    pub fn workspace(&self, body: &Body) -> (Vec3, Vec3) {
        let (low, high) = body.surface().bounds();
        (low.add_scalar(-self.safety.workspace_margin), high.add_scalar(self.safety.workspace_margin))
    }

    /// Where each probe hangs on the level that moves.
    pub fn probes(&self, body: &Body) -> Vec<Host> {
        let locator = Locator::new(&body.level().mesh, body.level().spacing);
        self.probe.iter().map(|p| locator.host(Vec3::from(p.position))).collect()
    }

    /// The state in which `body` has come to rest under its load: `world.settle` seconds of ticks in which its
    /// velocities fade, so that it does not swing when it is first touched.
    pub fn settled(&self, body: &Arc<Body>, progress: &mut dyn FnMut(&str, usize, usize)) -> Snapshot {
        let tools = self.tool.len();
        let rest = Snapshot::at_rest(body, tools);
        let ticks = (self.world.settle / TICK) as usize;
        let Ok(mut simulation) = Simulation::new(body.clone(), self.settings(), rest.clone()) else { return rest };
        for tick in 0..ticks {
            if tick % 100 == 0 {
                progress("settling under gravity", tick, ticks);
            }
            simulation.advance(&Inputs::default());
            simulation.state_mut().velocity.iter_mut().for_each(|v| *v *= 0.98);
        }
        progress("settling under gravity", ticks, ticks);
        let mut settled = Snapshot::at_rest(body, tools);
        settled.body.copy_from(&simulation.snapshot().body);
        settled.body.velocity.fill(Vec3::zeros());
        settled
    }

    /// The scene with every default written out.
    pub fn to_toml(&self) -> String {
        // Scenes hold nothing that TOML cannot say.
        toml::to_string(self).unwrap_or_default()
    }
}

/// Reads and checks a scene's text; `origin` names it in messages.
///
/// # Errors
/// With line and remedy, all values out of range at once.
pub fn parse(text: &str, origin: &str) -> Result<Scene, SceneError> {
    let scene: Scene = toml::from_str(text)
        .map_err(|e| SceneError::Syntax { origin: origin.to_owned(), message: e.to_string().trim_end().to_owned() })?;
    scene.validate().map_err(|report| {
        let line = |path: &str| match line_of(text, path) {
            Some(line) => format!("{origin}, line {line}: {path}"),
            None => format!("{origin}: {path}"),
        };
        SceneError::Values(report.iter().map(|(path, e)| format!("{}: {e}", line(&path.to_string()))).collect())
    })?;
    Ok(scene)
}

/// Line (from 1) where the value of the dotted key `path` (with `[index]`) starts.
fn line_of(text: &str, path: &str) -> Option<usize> {
    use toml::de::{DeTable, DeValue};
    let table = DeTable::parse(text).ok()?;
    let mut parts = path.split('.').flat_map(|p| p.split('[')).map(|p| p.trim_end_matches(']'));
    let first = parts.next()?;
    let mut value = table.get_ref().iter().find(|(k, _)| k.get_ref() == first)?.1;
    for part in parts {
        // A key left out has no line of its own: its table's stands for it.
        let next = match value.get_ref() {
            DeValue::Table(table) => table.iter().find(|(k, _)| k.get_ref() == part).map(|(_, v)| v),
            DeValue::Array(array) => array.get(part.parse::<usize>().ok()?),
            _ => None,
        };
        value = match next {
            Some(next) => next,
            None => break,
        };
    }
    Some(text[..value.span().start].matches('\n').count() + 1)
}

/// The scene text with each `key=value` put in its place.
fn override_keys(text: &str, origin: &str, overrides: &[String]) -> Result<String, SceneError> {
    let mut table: toml::Table = toml::from_str(text)
        .map_err(|e| SceneError::Syntax { origin: origin.to_owned(), message: e.to_string().trim_end().to_owned() })?;
    for given in overrides {
        let fault = |message: &str| SceneError::Override { given: given.clone(), message: message.to_owned() };
        let (key, value) =
            given.split_once('=').ok_or_else(|| fault("write key=value, as in material.density=1000"))?;
        let value = value.trim();
        let parsed = toml::from_str::<toml::Table>(&format!("v = {value}"))
            .ok()
            .and_then(|mut t| t.remove("v"))
            .unwrap_or_else(|| toml::Value::String(value.to_owned()));
        let mut at = &mut table;
        let mut parts = key.trim().split('.').peekable();
        while let Some(part) = parts.next() {
            if parts.peek().is_none() {
                at.insert(part.to_owned(), parsed);
                break;
            }
            let next = at.entry(part).or_insert_with(|| toml::Value::Table(toml::Table::new()));
            at = match next {
                toml::Value::Table(inner) => inner,
                // `tool.radius=…` means the first tool, `tool.1.radius=…` the second.
                toml::Value::Array(list) => {
                    let index = parts.peek().and_then(|p| p.parse::<usize>().ok());
                    if index.is_some() {
                        parts.next();
                    }
                    list.get_mut(index.unwrap_or(0))
                        .and_then(toml::Value::as_table_mut)
                        .ok_or_else(|| fault("the list has no such entry"))?
                }
                _ => return Err(fault("the key runs through a value that is no table")),
            };
        }
    }
    Ok(table.to_string())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_bundled_scene_is_valid() {
        for (name, _) in BUNDLED {
            LoadedScene::load(Path::new(name), &[]).unwrap();
        }
    }

    #[test]
    fn the_reference_names_every_key_with_its_default() {
        let text = include_str!("../config/scenes/reference.toml");
        let scene = parse(text, "reference.toml").unwrap();
        // What is left out of a minimal scene is what the reference says.
        let minimal = parse("name = \"reference\"\n[body]\nsource = \"box\"\n", "minimal").unwrap();
        let optional = Scene {
            hold: vec![],
            probe: vec![],
            material: MaterialKeys { phi: None, psi: None, ..scene.material.clone() },
            body: BodyKeys { file: None, files: vec![], unit: None, active_level: None, ..scene.body.clone() },
            ..scene.clone()
        };
        assert_eq!(optional, minimal);
        // Every key of a full scene stands in the reference, none is left out.
        let full = scene.to_toml();
        for key in full.lines().filter_map(|l| l.split_once(" = ")).map(|(k, _)| k) {
            assert!(text.lines().any(|l| l.split_once(" = ").is_some_and(|(k, _)| k == key)), "{key}");
        }
        for key in ["phi", "psi", "file", "files", "unit", "active_level", "stiffness"] {
            assert!(full.contains(&format!("{key} = ")), "the reference leaves out {key}");
        }
    }

    #[test]
    fn a_wrong_key_names_file_line_and_place() {
        let e = parse("name = \"x\"\n[body]\nsource = \"box\"\nsise = [1, 1, 1]\n", "my.toml").unwrap_err().to_string();
        assert!(e.contains("my.toml") && e.contains("line 4") && e.contains("sise") && e.contains("size"), "{e}");
    }

    #[test]
    fn bad_values_are_reported_all_at_once_with_their_lines() {
        let text = "name = \"x\"\n[body]\nsource = \"liver\"\nspacings = [0.01, 0.02]\n\n[material]\npoisson_ratio = 0.7\n\
                    youngs_modulus = -3.0\n[[tool]]\nname = \"t\"\nradius = 7.0\n";
        let e = parse(text, "my.toml").unwrap_err().to_string();
        for part in ["line 7: material.poisson_ratio", "line 8: material.youngs_modulus", "line 11: tool[0].radius"] {
            assert!(e.contains(part), "{e}");
        }
        assert!(e.contains("line 4: body.spacings") && e.contains("0.8 of the one before"), "{e}");
    }

    #[test]
    fn overrides_reach_tables_lists_and_strings() {
        let given = ["material.density=900", "tool.0.radius=0.02", "body.file=a b.stl", "world.gravity=[0, -9.81, 0]"];
        let given = given.map(String::from);
        let loaded = LoadedScene::load(Path::new("liver"), &given).unwrap();
        assert_eq!(loaded.scene.material.density, 900.0);
        assert_eq!(loaded.scene.tool[0].radius, 0.02);
        assert_eq!(loaded.scene.body.file, Some(PathBuf::from("a b.stl")));
        let e = LoadedScene::load(Path::new("liver"), &["material.densty=900".into()]).unwrap_err().to_string();
        assert!(e.contains("densty") && e.contains("--set"), "{e}");
    }

    #[test]
    fn a_missing_unit_or_file_says_what_to_write() {
        let scene = |extra: &str| {
            let text = format!("name = \"x\"\n[body]\nsource = \"surface\"\n{extra}");
            LoadedScene { scene: parse(&text, "s.toml").unwrap(), origin: "s.toml".into(), folder: PathBuf::new() }
        };
        let e = scene("").build(&mut |_, _, _| {}).unwrap_err().to_string();
        assert!(e.contains("body.file"), "{e}");
        let e = scene("file = \"a.stl\"\n").build(&mut |_, _, _| {}).unwrap_err().to_string();
        assert!(e.contains("body.unit"), "{e}");
        let e = scene("file = \"a.stl\"\nunit = \"mm\"\n").build(&mut |_, _, _| {}).unwrap_err().to_string();
        assert!(e.contains("a.stl") && e.contains("s.toml"), "{e}");
    }
}
