//! Recordings as arrays.

use std::path::PathBuf;

use numpy::{PyArray1, PyArray2};
use palpate::export::{moments, surface};
use palpate::recording::Recording as Read;
use palpate_core::contact::tool::ToolEvent;
use palpate_sdk::Moment;
use pyo3::prelude::*;

use crate::wrenches::{Row, Wrenches, table};
use crate::{bad_file, bad_value};

/// A recording in memory.
#[pyclass(frozen, module = "palpate")]
pub struct Recording(Read);

/// Reads a recording (MCAP). Raises ``OSError`` when it is none. One cut short gives what is whole.
#[pyfunction]
pub fn read_recording(py: Python<'_>, path: PathBuf) -> PyResult<Recording> {
    py.detach(|| Read::read(&path)).map(Recording).map_err(bad_file)
}

impl Recording {
    fn tool(&self, tool: usize) -> PyResult<usize> {
        let tools = self.0.scene.tool.len();
        if tool < tools { Ok(tool) } else { Err(bad_value(format!("no tool {tool}: the recording has {tools}"))) }
    }
}

/// Ticks and poses (n, 7).
type Poses<'py> = (Bound<'py, PyArray1<u64>>, Bound<'py, PyArray2<f64>>);
/// Ticks, and a surface (vertices, 3) for each.
type Surfaces<'py> = (Bound<'py, PyArray1<u64>>, Vec<Bound<'py, PyArray2<f32>>>);

#[pymethods]
impl Recording {
    /// Names of the tools.
    #[getter]
    fn tools(&self) -> Vec<String> {
        self.0.scene.tool.iter().map(|tool| tool.name.clone()).collect()
    }

    /// The scene (TOML).
    #[getter]
    fn scene(&self) -> String {
        self.0.scene.to_toml()
    }

    /// (n) simulated time of every recorded tick [ms].
    #[getter]
    fn ticks<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<u64>> {
        PyArray1::from_vec(py, self.0.inputs.iter().map(|(tick, _)| *tick).collect())
    }

    /// Why reading ended before the end of the file, when it did.
    #[getter]
    fn cut(&self) -> Option<String> {
        self.0.cut.clone()
    }

    /// Wrenches of a tool while it was held.
    #[pyo3(signature = (tool = 0))]
    fn wrenches(&self, tool: usize) -> PyResult<Wrenches> {
        let tool = self.tool(tool)? as u32;
        let of_tool = self.0.wrenches.values().filter(|wrench| wrench.tool == tool);
        of_tool.map(|wrench| Row::try_from(wrench).map_err(bad_file)).collect::<PyResult<_>>().map(Wrenches)
    }

    /// Ticks (n) and poses (n, 7): position [m] and quaternion, as the client sent them.
    #[pyo3(signature = (tool = 0))]
    fn poses<'py>(&self, py: Python<'py>, tool: usize) -> PyResult<Poses<'py>> {
        let tool = self.tool(tool)?;
        let (mut ticks, mut rows) = (Vec::new(), Vec::<[f64; 7]>::new());
        for (tick, inputs) in &self.0.inputs {
            if let Some(ToolEvent::Pose(sample)) = &inputs.tools[tool] {
                let ([x, y, z], [qx, qy, qz, qw]) = (sample.pose.position.into(), sample.pose.orientation);
                ticks.push(*tick);
                rows.push([x, y, z, qx, qy, qz, qw]);
            }
        }
        Ok((PyArray1::from_vec(py, ticks), table(py, rows.into_iter())?))
    }

    /// Ticks and hashes of the state at frames.
    fn hashes<'py>(&self, py: Python<'py>) -> (Bound<'py, PyArray1<u64>>, Bound<'py, PyArray1<u64>>) {
        let (ticks, hashes) = self.0.hashes.iter().map(|(tick, hash)| (*tick, *hash)).unzip();
        (PyArray1::from_vec(py, ticks), PyArray1::from_vec(py, hashes))
    }

    /// (m, 3) vertex numbers.
    #[getter]
    fn triangles<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<u32>>> {
        table(py, surface(&self.0).map_err(bad_file)?.triangles.iter().copied())
    }

    /// Ticks, and the surface (vertices, 3) [m] of each: every frame, or every second, third …
    #[pyo3(signature = (every = 1))]
    fn vertices<'py>(&self, py: Python<'py>, every: usize) -> PyResult<Surfaces<'py>> {
        if every == 0 {
            return Err(bad_value("every is 0: every frame (1), every second (2) or so"));
        }
        let kept: Vec<Moment> = py.detach(|| {
            let surface = surface(&self.0).map_err(bad_file)?;
            moments(&self.0, surface).step_by(every).map(|moment| moment.map_err(bad_file)).collect::<PyResult<_>>()
        })?;
        let ticks = kept.iter().map(|moment| moment.tick).collect();
        let positions =
            kept.into_iter().map(|moment| table(py, moment.positions.into_iter())).collect::<PyResult<_>>()?;
        Ok((PyArray1::from_vec(py, ticks), positions))
    }

    fn __repr__(&self) -> String {
        let (ticks, body) = (self.0.inputs.len(), self.0.body.name());
        format!("Recording('{body}', {ticks} ticks, {} surfaces)", self.0.frames.len())
    }
}
