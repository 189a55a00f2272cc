//! Scenes: TOML text → checked parameters → a body and the settings of its simulation.
//!
//! Every key stands in `config/scenes/reference.toml` with its unit, range and default; a test holds the two together.
//! A wrong key, a bad value or a bad mesh gets an error that names the file, the line and what to do.

pub mod body_keys;
pub mod contact_keys;
mod elastic_keys;
pub mod keys;
pub mod law_keys;
pub mod motion_keys;
pub mod obstacle_keys;
pub mod organ_keys;
pub mod parameters;
pub mod prepared;
mod shapes;
pub mod tool_keys;
pub mod unsettled;

pub use keys::Scene;

use body_keys::{Source, hold_faults};
use garde::Validate;
use palpate_body::geometry::mesh_io::{self, Solid};
use palpate_body::geometry::textured::TexturedMesh;
use palpate_body::geometry::{LabelledMesh, MeshError};
use palpate_body::prepare::bodies::one_body;
use palpate_body::prepare::body_file::{self, BodyFileError};
use palpate_body::prepare::input::{Fineness, Input};
use palpate_body::prepare::merge::merge;
use palpate_body::prepare::shape_fault::ShapeFault;
use palpate_body::prepare::{self, PrepareError, Recipe};
use palpate_core::adaptation::step_of_level;
use palpate_core::contact::tool::Part;
use palpate_core::geometry::primitives::box_mesh;
use palpate_core::math::{Pose, Real, Vec3};
use palpate_core::model::Body;
use palpate_core::model::element_pool::CLASSES;
use palpate_core::model::step_class::step_of;
use shapes::by_formula;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Scenes that come with the program: name and text.
pub const BUNDLED: [(&str, &str); 8] = [
    ("liver", include_str!("../../../config/scenes/liver.toml")),
    ("organs", include_str!("../../../config/scenes/organs.toml")),
    ("toy", include_str!("../../../config/scenes/toy.toml")),
    ("cube", include_str!("../../../config/scenes/cube.toml")),
    ("grasp", include_str!("../../../config/scenes/grasp.toml")),
    ("squeeze", include_str!("../../../config/scenes/squeeze.toml")),
    ("laparoscopy", include_str!("../../../config/scenes/laparoscopy.toml")),
    ("organ", include_str!("../../../config/scenes/organ.toml")),
];

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
    /// A mesh that is several bodies.
    #[error("{origin}: body: {}: {source}", path.display())]
    Shape {
        /// File or bundled scene.
        origin: String,
        /// The mesh file.
        path: PathBuf,
        /// Why.
        source: Box<ShapeFault>,
    },
    /// A file of a tool's shape that cannot be used.
    #[error("{origin}: {key}: {}: {reason}", path.display())]
    ToolFile {
        /// File or bundled scene.
        origin: String,
        /// The key.
        key: String,
        /// The shape's file.
        path: PathBuf,
        /// Why.
        reason: String,
    },
    /// A surface to look at that cannot be used.
    #[error("{origin}: {key}: {}: {reason}", path.display())]
    Display {
        /// File or bundled scene.
        origin: String,
        /// The key.
        key: String,
        /// The surface's file.
        path: PathBuf,
        /// Why.
        reason: String,
    },
    /// A prepared body that cannot be used.
    #[error("{origin}: body: {}: {source}", path.display())]
    Prepared {
        /// File or bundled scene.
        origin: String,
        /// The body's file.
        path: PathBuf,
        /// Why.
        source: Box<BodyFileError>,
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
    /// A level that the body does not have.
    #[error("{origin}: {key} is {level}, but the body has the levels 0 to {last}")]
    NoSuchLevel {
        /// File or bundled scene.
        origin: String,
        /// The key.
        key: &'static str,
        /// Level asked for.
        level: u32,
        /// Finest level.
        last: usize,
    },
    /// A body of which no level can be stepped.
    #[error(
        "{origin}: even level 0 needs steps of {:.2} µs, and the shortest is {:.2} µs: make the material {:.1} times \
         softer or denser, its damping less, or the level coarser and without slivers",
        1e6 * step,
        1e6 * step_of(CLASSES - 1),
        (step_of(CLASSES - 1) / step).powi(2)
    )]
    TooStiff {
        /// File or bundled scene.
        origin: String,
        /// Longest stable step [s].
        step: f64,
    },
    /// An obstacle in the body.
    #[error(
        "{origin}: obstacle[{index}]: \"{name}\" overlaps the body at rest by {:.1} mm at [{:.4}, {:.4}, {:.4}], and may by \
         {:.1} mm: move it (position)",
        1e3 * depth, place.x, place.y, place.z, 1e3 * most
    )]
    Overlap {
        /// File or bundled scene.
        origin: String,
        /// Which obstacle.
        index: usize,
        /// Its name.
        name: String,
        /// How deep it is in the body [m].
        depth: Real,
        /// Where [m].
        place: Vec3,
        /// How deep it may be [m].
        most: Real,
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

/// Names of the bundled scenes, for messages and help.
pub fn bundled_names() -> String {
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
    /// Reads the scene file at `path`, or the bundled scene of that name, or takes the scene that the prepared body at
    /// `path` was made for, and applies `overrides` (`key=value`, dotted keys, TOML values; a bare word counts as a
    /// string).
    ///
    /// # Errors
    /// With file, line and remedy.
    pub fn load(path: &Path, overrides: &[String]) -> Result<Self, SceneError> {
        let bundled = BUNDLED.iter().find(|(name, _)| Path::new(name) == path);
        let (text, origin, folder) = match bundled {
            Some((name, text)) => ((*text).to_owned(), format!("bundled scene {name}"), PathBuf::new()),
            None => {
                let text = if path.extension().is_some_and(|e| e == body_file::EXTENSION) {
                    prepared::scene_of(path)?
                } else {
                    std::fs::read_to_string(path)
                        .map_err(|source| SceneError::Read { path: path.to_owned(), source })?
                };
                let folder = path.parent().unwrap_or(Path::new("")).to_owned();
                (text, path.display().to_string(), folder)
            }
        };
        let given_text = text;
        let (text, origin) = if overrides.is_empty() {
            (given_text.clone(), origin)
        } else {
            (override_keys(&given_text, &origin, overrides)?, format!("{origin} with --set"))
        };
        // A name may be of any bytes, which the text of a scene cannot say.
        let named = |mut scene: Scene| {
            if let (Some(name), Some(file)) = (path.file_name(), &mut scene.body.file)
                && *file == Path::new(&*name.to_string_lossy())
            {
                *file = name.into();
            }
            scene
        };
        let mut scene = named(parse(&text, &origin).map_err(|e| wrong_override(&given_text, overrides).unwrap_or(e))?);
        if let Some(text) = prepared::completed(&text, &scene, &origin, &folder)? {
            scene = named(parse(&text, &origin)?);
        }
        load_tools(&mut scene, &origin, &folder)?;
        load_displays(&mut scene, &origin, &folder)?;
        Ok(Self { scene, origin, folder })
    }

    /// The files of bodies that it reads.
    pub fn files(&self) -> Vec<PathBuf> {
        let bodies = [&self.scene.body].into_iter().chain(self.scene.organ.iter().map(|organ| &organ.body));
        bodies
            .flat_map(|body| body.file.iter().chain(&body.files).chain(&body.display))
            .map(|file| self.folder.join(file))
            .collect()
    }

    /// Builds the body; `progress` hears what is done next, and its place among how many.
    ///
    /// # Errors
    /// When a mesh is missing or broken, or the keys make no body.
    pub fn build(&self, progress: &mut dyn FnMut(&str, usize, usize)) -> Result<Body, SceneError> {
        let mut body = self.first_body(progress)?;
        if !self.scene.organ.is_empty() {
            let mut all = vec![(body, Pose::default())];
            for organ in &self.scene.organ {
                let origin = format!("{}: organ \"{}\"", self.origin, organ.name);
                let alone = Self { scene: self.scene.of_organ(organ), origin, folder: self.folder.clone() };
                let mut told = |what: &str, done, of| progress(&format!("{}: {what}", organ.name), done, of);
                all.push((alone.first_body(&mut told)?, organ.pose()));
            }
            body = merge(all, self.scene.material.damping_ratio).map_err(self.failed())?;
        }
        self.check_obstacles(&body)?;
        let step = step_of_level(&body, 0);
        if step < step_of(CLASSES - 1) {
            return Err(SceneError::TooStiff { origin: self.origin.clone(), step });
        }
        let keys =
            [("active_level", self.scene.body.active_level), ("finest_level", self.scene.resolution.finest_level)];
        for (key, level) in keys {
            if let Some(level) = level.filter(|r| *r as usize > body.finest()) {
                return Err(SceneError::NoSuchLevel { origin: self.origin.clone(), key, level, last: body.finest() });
            }
        }
        Ok(body)
    }

    /// What `[body]` says, without the further organs.
    fn first_body(&self, progress: &mut dyn FnMut(&str, usize, usize)) -> Result<Body, SceneError> {
        progress("reading shapes", 0, 1);
        match self.shape(progress)? {
            Some(shape) => prepare::prepare(&self.recipe(shape), progress).map_err(self.failed()),
            None => self.prepared_body(progress),
        }
    }

    fn failed(&self) -> impl Fn(PrepareError) -> SceneError {
        |source| SceneError::Prepare { origin: self.origin.clone(), source: Box::new(source) }
    }

    /// A body of `shape`, of the scene's material and held as the scene says.
    pub fn recipe(&self, shape: prepare::Shape) -> Recipe {
        let bounds = shape.bounds();
        Recipe {
            name: self.scene.name.clone(),
            shape,
            material: self.scene.material(),
            inclusions: self.scene.inclusions(),
            holds: self.scene.hold.iter().map(|h| h.region(bounds)).collect(),
            elements: self.scene.material.elements,
            damping_ratio: self.scene.material.damping_ratio,
        }
    }

    /// The one body that `input`, of the file at `path`, holds; `progress` hears what was repaired and left out.
    fn one_body(
        &self,
        path: &Path,
        input: Input,
        fineness: &Fineness,
        progress: &mut dyn FnMut(&str, usize, usize),
    ) -> Result<Solid, SceneError> {
        let said = input.said();
        let element = fineness.finest_element(&input.solid);
        let fault =
            |source| SceneError::Shape { origin: self.origin.clone(), path: path.to_owned(), source: Box::new(source) };
        let (solid, dropped) = one_body(input.solid, element, false).map_err(fault)?;
        said.iter().chain(&dropped).for_each(|line| progress(&format!("{}: {line}", path.display()), 0, 1));
        Ok(solid)
    }

    /// What the body is made of; `None` where it is made already.
    fn shape(&self, progress: &mut dyn FnMut(&str, usize, usize)) -> Result<Option<prepare::Shape>, SceneError> {
        let keys = &self.scene.body;
        let missing = |source_name, needs| SceneError::Missing { origin: self.origin.clone(), source_name, needs };
        let unit = |source_name| {
            keys.unit.ok_or_else(|| missing(source_name, "body.unit, one of \"m\", \"cm\", \"mm\", \"in\""))
        };
        let at = |file: &PathBuf| self.folder.join(file);
        let failed =
            |path: PathBuf, source| SceneError::Mesh { origin: self.origin.clone(), path, source: Box::new(source) };
        if let Some(mut surface) = by_formula(keys) {
            surface.vertices.iter_mut().for_each(|v| *v *= keys.scale);
            return Ok(Some(prepare::Shape::covered(surface, keys.spacings.clone(), None, keys.display_vertices)));
        }
        Ok(Some(match keys.source {
            Source::Box => {
                let size = Vec3::from(keys.size) * keys.scale;
                let meshes = keys.cells.iter().map(|c| box_mesh(size, *c).into()).collect();
                prepare::Shape::Meshes { meshes, display_vertices: keys.display_vertices }
            }
            Source::Surface => {
                let file = keys.file.as_ref().ok_or_else(|| missing("surface", "body.file, as in \"organ.stl\""))?;
                let unit = unit("surface")?;
                let read = Input::read(&at(file), unit, keys.scale, 0.0, None).map_err(|e| failed(at(file), e))?;
                let fineness = match keys.spacings.as_slice() {
                    [] => Fineness::Automatic,
                    spacings => Fineness::Levels(spacings.to_vec()),
                };
                let solid = self.one_body(&at(file), read, &fineness, progress)?;
                let surface = mesh_io::surface_of(solid).map_err(|e| failed(at(file), e))?;
                prepare::Shape::covered(surface, keys.spacings.clone(), None, keys.display_vertices)
            }
            Source::Volumes => {
                if keys.files.is_empty() {
                    return Err(missing("volumes", "body.files, a list of mesh files from coarse to fine"));
                }
                let unit = unit("volumes")?;
                let mut read = |file: &PathBuf| {
                    let labels = keys.labels.as_deref();
                    let read =
                        Input::read(&at(file), unit, keys.scale, 0.0, labels).map_err(|e| failed(at(file), e))?;
                    let solid = self.one_body(&at(file), read, &Fineness::Automatic, progress)?;
                    mesh_io::volume_of(solid).map_err(|e| failed(at(file), e))
                };
                let meshes = keys.files.iter().map(&mut read).collect::<Result<Vec<LabelledMesh>, SceneError>>()?;
                prepare::Shape::Meshes { meshes, display_vertices: keys.display_vertices }
            }
            // Made already.
            _ => return Ok(None),
        }))
    }
}

/// Reads and checks a scene's text; `origin` names it in messages.
///
/// # Errors
/// With line and remedy, all values out of range at once.
pub fn parse(text: &str, origin: &str) -> Result<Scene, SceneError> {
    let mut scene: Scene = toml::from_str(text)
        .map_err(|e| SceneError::Syntax { origin: origin.to_owned(), message: e.to_string().trim_end().to_owned() })?;
    let mut faults = not_finite(text);
    if let Err(report) = scene.validate() {
        let ranges = report.iter().map(|(path, e)| (path.to_string(), e.to_string()));
        let fresh: Vec<_> = ranges.filter(|(path, _)| faults.iter().all(|(known, _)| known != path)).collect();
        faults.extend(fresh);
    }
    // What belongs together is looked at once each value is in its range.
    if faults.is_empty() {
        scene.material.faults("material", &mut faults);
        hold_faults(&scene.hold, "hold", &mut faults);
        let organs = scene.organ.iter().enumerate();
        organs.for_each(|(i, organ)| organ.faults(&format!("organ[{i}]"), &scene.material, &mut faults));
        let obstacles = scene.obstacle.iter().enumerate();
        obstacles.for_each(|(i, obstacle)| obstacle.faults(&format!("obstacle[{i}]"), &mut faults));
        scene.tool.iter().enumerate().for_each(|(i, tool)| tool.faults(&format!("tool[{i}]"), &mut faults));
        let names = scene.organ_names();
        for (i, organ) in scene.organ.iter().enumerate().filter(|(i, organ)| names[..=*i].contains(&&*organ.name)) {
            faults.push((format!("organ[{i}].name"), format!("an organ further up is called {:?}, too", organ.name)));
        }
        contact_keys::faults(&scene.contact, &names, &mut faults);
    }
    let told = |(path, fault): &(String, String)| match line_of(text, path) {
        Some(line) => format!("{origin}, line {line}: {path}: {fault}"),
        None => format!("{origin}: {path}: {fault}"),
    };
    if !faults.is_empty() {
        return Err(SceneError::Values(faults.iter().map(told).collect()));
    }
    scene.material.fill();
    scene.organ.iter_mut().for_each(|organ| organ.material.fill());
    Ok(scene)
}

/// Values that are infinite or no number, which TOML can say and a range does not exclude.
fn not_finite(text: &str) -> Vec<(String, String)> {
    fn search(path: &str, value: &toml::Value, out: &mut Vec<(String, String)>) {
        match value {
            toml::Value::Float(x) if !x.is_finite() => out.push((path.into(), "give a finite number".into())),
            toml::Value::Array(list) => {
                list.iter().enumerate().for_each(|(i, value)| search(&format!("{path}[{i}]"), value, out));
            }
            toml::Value::Table(table) => {
                let dot = if path.is_empty() { "" } else { "." };
                table.iter().for_each(|(key, value)| search(&format!("{path}{dot}{key}"), value, out));
            }
            _ => {}
        }
    }
    let mut out = vec![];
    if let Ok(table) = toml::from_str::<toml::Table>(text) {
        search("", &toml::Value::Table(table), &mut out);
    }
    out
}

/// Puts the shapes in tools' files in their files' place.
fn load_tools(scene: &mut Scene, origin: &str, folder: &Path) -> Result<(), SceneError> {
    for (i, tool) in scene.tool.iter_mut().enumerate() {
        tool.load_files(&format!("tool[{i}]"), |key, file, unit, rounding| {
            let path = folder.join(file);
            let failed = |reason: String| SceneError::ToolFile {
                origin: origin.to_owned(),
                key: format!("{key}.file"),
                path: path.clone(),
                reason,
            };
            let surface = mesh_io::read_surface(&path, unit).map_err(|e| failed(e.to_string()))?;
            let part = Part::convex(&surface.vertices, rounding);
            let part = part.ok_or_else(|| failed("all its vertices lie in a plane".into()))?;
            if part.bounding_radius() > LARGEST_TOOL {
                return Err(failed(format!(
                    "reaches {:.3} m, a tool {LARGEST_TOOL} m at most",
                    part.bounding_radius()
                )));
            }
            Ok(part.hull().0.into_iter().map(Into::into).collect())
        })?;
    }
    Ok(())
}

/// Reads the surfaces to look at.
fn load_displays(scene: &mut Scene, origin: &str, folder: &Path) -> Result<(), SceneError> {
    let organs = scene.organ.iter().enumerate().map(|(i, organ)| (format!("organ[{i}].body"), &organ.body));
    let read = |(key, keys): (String, &body_keys::BodyKeys)| {
        let Some(file) = &keys.display else { return Ok(None) };
        let path = folder.join(file);
        let failed = |reason: String| SceneError::Display {
            origin: origin.to_owned(),
            key: format!("{key}.display"),
            path: path.clone(),
            reason,
        };
        let unit = keys.display_unit.or(keys.unit);
        let unit =
            unit.ok_or_else(|| failed(format!("give {key}.display_unit, one of \"m\", \"cm\", \"mm\", \"in\"")))?;
        let mut mesh = TexturedMesh::read(&path, unit).map_err(|e| failed(e.to_string()))?;
        mesh.surface.vertices.iter_mut().for_each(|v| *v *= keys.scale);
        Ok(Some(Arc::new(mesh)))
    };
    let all = std::iter::once(("body".to_owned(), &scene.body)).chain(organs);
    let shown = all.map(read).collect::<Result<Vec<_>, _>>()?;
    // Without any, a scene is as its text says.
    scene.shown = if shown.iter().any(Option::is_some) { shown } else { Vec::new() };
    Ok(())
}

/// How far a tool may reach from its reference point [m]: what scenes allow for points.
const LARGEST_TOOL: Real = 1.0;

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

/// The first of the `overrides` that makes the scene `text`, readable without it, unreadable: its key is wrong, or the type
/// of its value. Lines of a scene with overrides are in no file.
fn wrong_override(text: &str, overrides: &[String]) -> Option<SceneError> {
    toml::from_str::<Scene>(text).ok()?;
    overrides.iter().find_map(|given| {
        let text = override_keys(text, "", std::slice::from_ref(given)).ok()?;
        let e = toml::from_str::<Scene>(&text).err()?;
        Some(SceneError::Override { given: given.clone(), message: e.message().to_owned() })
    })
}

#[cfg(test)]
mod tests;
