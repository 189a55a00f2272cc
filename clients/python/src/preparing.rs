//! Bodies from mesh files, as `palpate prepare` makes them.

use std::path::{Path, PathBuf};

use palpate::output::same_file;
use palpate::scene::LoadedScene;
use palpate::scene::prepared::body_keys;
use palpate_body::geometry::mesh_io::LengthUnit;
use palpate_body::prepare::bodies::one_body;
use palpate_body::prepare::body_check::check;
use palpate_body::prepare::body_file::{BodyFile, Provenance};
use palpate_body::prepare::input::{Fineness, Input, shape};
use palpate_body::prepare::report::report;
use palpate_body::prepare::{self as preparation, DISPLAY_VERTICES};
use pyo3::prelude::*;
use pyo3::types::PyDict;

use crate::simulation::flatten;
use crate::{bad_file, bad_value};

/// Makes a body from a closed surface or tetrahedral meshes, writes it to ``out`` (``.palpate``) and returns a report.
///
/// ``unit`` is "m", "cm", "mm" or "in". ``finest`` [m] is the lattice constant of the finest level, ``levels`` [m] those of
/// all levels, coarse to fine; by default there are four, by volume. ``largest`` takes the largest of several bodies in a
/// file. Material and holds are those of ``scene`` with ``overrides``, as for :class:`Simulation`.
#[pyfunction]
#[pyo3(signature = (inputs, out, *, unit, scale = 1.0, finest = None, levels = Vec::new(), largest = false, scene = PathBuf::from("organ"), **overrides))]
#[allow(clippy::too_many_arguments, reason = "keywords of Python, each with its default")]
pub fn prepare(
    py: Python<'_>,
    inputs: Inputs,
    out: PathBuf,
    unit: &str,
    scale: f64,
    finest: Option<f64>,
    levels: Vec<f64>,
    largest: bool,
    scene: PathBuf,
    overrides: Option<&Bound<'_, PyDict>>,
) -> PyResult<String> {
    let mut set = Vec::new();
    if let Some(overrides) = overrides {
        flatten("", overrides, &mut set)?;
    }
    let inputs = match inputs {
        Inputs::One(path) => vec![path],
        Inputs::Several(paths) => paths,
    };
    let unit: LengthUnit = unit.parse().map_err(bad_value)?;
    let fineness = match (finest, levels.is_empty()) {
        (Some(_), false) => return Err(bad_value("give finest or levels, not both")),
        (Some(finest), true) => Fineness::Finest(finest),
        (None, false) => Fineness::Levels(levels),
        (None, true) => Fineness::Automatic,
    };
    let Some(first) = inputs.first() else { return Err(bad_value("no input: give a mesh file or several")) };
    let name: String = first.file_stem().unwrap_or_default().to_string_lossy().chars().take(64).collect();
    // By whatever name, and also where an input brings files along that were not named.
    let spares = |files: &[PathBuf]| match files.iter().find(|file| same_file(&out, file)) {
        Some(input) => {
            Err(bad_value(format!("{}: this is the file that is read ({})", out.display(), input.display())))
        }
        None => Ok(()),
    };
    py.detach(|| {
        spares(&inputs)?;
        let mut loaded = LoadedScene::load(&scene, &set).map_err(bad_value)?;
        spares(&[vec![scene], loaded.files()].concat())?;
        let (mut said, mut files, mut solids) = (Vec::new(), Vec::new(), Vec::new());
        for path in &inputs {
            let about = |error: &dyn std::fmt::Display| bad_value(format!("{}: {error}", path.display()));
            let input = Input::read(path, unit, scale, 0.0, None).map_err(|error| about(&error))?;
            let folder = path.parent().unwrap_or(Path::new(""));
            spares(&input.files.iter().map(|file| folder.join(&file.name)).collect::<Vec<_>>())?;
            said.extend(input.said());
            let element = fineness.finest_element(&input.solid);
            let (solid, dropped) = one_body(input.solid, element, largest).map_err(|error| about(&error))?;
            said.extend(dropped);
            files.extend(input.files);
            solids.push(solid);
        }
        check(&solids, unit, scale, false, false).map_err(bad_value)?;
        let shape = shape(solids, &fineness, DISPLAY_VERTICES).map_err(bad_value)?;
        loaded.scene.name = name;
        loaded.scene.body = body_keys();
        loaded.scene.organ.clear();
        let body = preparation::prepare(&loaded.recipe(shape), &mut |_, _, _| ()).map_err(bad_value)?;
        let report = report(&body);
        if !report.levels[0].can_be_stepped() {
            return Err(bad_value(format!("not even the coarsest level can be used:\n{report}")));
        }
        let provenance = Provenance {
            palpate: env!("CARGO_PKG_VERSION").into(),
            inputs: files,
            options: options(unit, scale, &fineness, largest),
            scene: loaded.scene.to_toml(),
        };
        palpate::output::write(&out, &BodyFile { provenance, body }.bytes()).map_err(bad_file)?;
        said.push(report.to_string());
        Ok(said.join("\n"))
    })
}

/// A file or several: the levels of one body.
#[derive(FromPyObject)]
pub enum Inputs {
    One(PathBuf),
    Several(Vec<PathBuf>),
}

/// What decides the body beside files and scene, as on the command line.
fn options(unit: LengthUnit, scale: f64, fineness: &Fineness, largest: bool) -> String {
    let mut options = format!("--unit {unit} --display-vertices {DISPLAY_VERTICES}");
    if scale != 1.0 {
        options += &format!(" --scale {scale}");
    }
    match fineness {
        Fineness::Automatic => {}
        Fineness::Finest(finest) => options += &format!(" --finest {finest}m"),
        Fineness::Levels(levels) => {
            let levels: Vec<String> = levels.iter().map(|level| format!("{level}m")).collect();
            options += &format!(" --levels {}", levels.join(","));
        }
    }
    if largest {
        options += " --largest";
    }
    options
}
