//! Bodies from mesh files, as `palpate prepare` makes them.

use std::path::PathBuf;

use palpate::preparation::{Preparation, Prepared};
use palpate_body::geometry::mesh_io::LengthUnit;
use palpate_body::prepare::input::Fineness;
use palpate_body::prepare::report::report;
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
    let preparation = Preparation { scale, fineness, largest, scene, set, ..Preparation::of(inputs, unit) };
    py.detach(|| {
        let Prepared { file, mut said, .. } = preparation.run(&[("out", &out)], &mut |_, _, _| ()).map_err(refused)?;
        let report = report(&file.body);
        if !report.levels[0].can_be_stepped() {
            return Err(bad_value(format!("not even the coarsest level can be used:\n{report}")));
        }
        palpate::output::write(&out, &file.bytes()).map_err(bad_file)?;
        said.push(report.to_string());
        Ok(said.join("\n"))
    })
}

/// What the file system refused is an `OSError`, all else a `ValueError`.
fn refused(error: anyhow::Error) -> PyErr {
    // Some causes are told in what is about them.
    let text = error
        .chain()
        .map(|cause| cause.to_string())
        .reduce(|text, cause| if text.contains(&cause) { text } else { format!("{text}: {cause}") });
    let of_files = error.chain().any(|cause| cause.is::<std::io::Error>());
    if of_files { bad_file(text.unwrap_or_default()) } else { bad_value(text.unwrap_or_default()) }
}

/// A file or several: the levels of one body.
#[derive(FromPyObject)]
pub enum Inputs {
    One(PathBuf),
    Several(Vec<PathBuf>),
}
