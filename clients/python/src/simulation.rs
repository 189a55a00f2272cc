//! A simulation in the process of Python, as `palpate simulate` runs it: the same bits.

use std::path::PathBuf;
use std::sync::Arc;

use numpy::{PyArray1, PyArray2};
use palpate::scene::{LoadedScene, Scene};
use palpate_core::contact::jaws::Stance;
use palpate_core::contact::tool::{Coupling, Phase, PoseSample, ToolEvent};
use palpate_core::math::Bounds;
use palpate_core::model::State;
use palpate_core::simulation::{Inputs, ParameterRanges, Simulation as Core, Snapshot, TICK};
use pyo3::exceptions::PyRuntimeError;
use pyo3::prelude::*;
use pyo3::types::{PyBool, PyBytes, PyDict, PyList, PyString, PyTuple};

use crate::poses::{named_values, one_pose, poses};
use crate::wrenches::{Row, Wrench, Wrenches, table};
use crate::{bad_file, bad_value};

/// Bytes before a snapshot: whose body it is of.
const CHECKSUM_BYTES: usize = 8;

/// A body under way in this process, bit for bit as ``palpate simulate`` runs it.
///
/// ``scene`` is a scene file, a prepared body (``.palpate``) or a bundled scene ("liver", "organs", "toy", "cube", "grasp", "squeeze", "laparoscopy").
/// Keywords override its keys: ``Simulation("liver", material={"youngs_modulus": 8000})``, or
/// ``Simulation("liver", **{"material.youngs_modulus": 8000})``.
///
/// Building a body takes from below a second to a minute. Poses are (3) positions [m], or (7) with a quaternion. Raises
/// ``ValueError`` with file, line and remedy where the scene is wrong, or starts unfit to be touched.
#[pyclass(module = "palpate")]
pub struct Simulation {
    core: Core,
    scene: Scene,
    reset: State,
    /// Poses so far (tools).
    sequence: Vec<u32>,
}

/// A tool by its number or its name.
#[derive(FromPyObject)]
enum ToolName {
    Number(usize),
    Name(String),
}

impl Simulation {
    fn tool(&self, tool: &ToolName) -> PyResult<usize> {
        let names = || self.scene.tool.iter().map(|tool| tool.name.as_str()).collect::<Vec<_>>().join(", ");
        let found = match tool {
            ToolName::Number(number) => Some(*number).filter(|number| *number < self.scene.tool.len()),
            ToolName::Name(name) => self.scene.tool.iter().position(|tool| tool.name == *name),
        };
        found.ok_or_else(|| match tool {
            ToolName::Number(number) => bad_value(format!("no tool {number}: the scene has {}", names())),
            ToolName::Name(name) => bad_value(format!("no tool \"{name}\": the scene has {}", names())),
        })
    }

    /// A tool that somebody holds.
    fn held(&self, tool: &ToolName) -> PyResult<usize> {
        let tool = self.tool(tool)?;
        if self.core.tools()[tool].epoch == 0 {
            let name = &self.scene.tool[tool].name;
            return Err(PyRuntimeError::new_err(format!("tool \"{name}\" is not attached: call attach() first")));
        }
        Ok(tool)
    }

    /// A tick in which nothing but `event` happens to `tool`.
    fn tick_with(&mut self, tool: usize, event: Option<ToolEvent>) {
        let mut inputs = Inputs::default();
        inputs.tools[tool] = event;
        self.core.advance(&inputs);
    }

    fn pose_event(&mut self, tool: usize, Stance { pose, opening }: Stance) -> ToolEvent {
        self.sequence[tool] += 1;
        let sequence = self.sequence[tool];
        // As in a trajectory, whose times [s] begin with the tick in which the tool is taken.
        let time = self.core.tick().saturating_sub(1) as f64 / 1000.0;
        ToolEvent::Pose(PoseSample { sequence, time_ns: (time * 1e9) as u64, pose, buttons: 0, opening })
    }
}

#[pymethods]
impl Simulation {
    #[new]
    #[pyo3(signature = (scene = PathBuf::from("liver"), /, **overrides))]
    fn new(py: Python<'_>, scene: PathBuf, overrides: Option<&Bound<'_, PyDict>>) -> PyResult<Self> {
        let mut set = Vec::new();
        if let Some(overrides) = overrides {
            flatten("", overrides, &mut set)?;
        }
        py.detach(|| {
            let loaded = LoadedScene::load(&scene, &set).map_err(bad_value)?;
            let body = Arc::new(loaded.build(&mut |_, _, _| ()).map_err(bad_value)?);
            let start = loaded.scene.settled(&body, &mut |_, _, _| ());
            loaded.scene.check_settled(&body, &start).map_err(bad_value)?;
            let (scene, reset) = (loaded.scene, start.body.clone());
            let sequence = vec![0; scene.tool.len()];
            let core = Core::new(body, scene.settings(), start).map_err(bad_value)?;
            Ok(Self { core, scene, reset, sequence })
        })
    }

    /// Takes a tool, by number or name, and returns its number. Takes one tick.
    ///
    /// ``rate_hz`` is how often poses will come; slower poses are followed evenly. ``coupling_stiffness`` [N/m] and
    /// ``coupling_angular_stiffness`` [N·m/rad] are those of the virtual coupling; 0 holds the tool rigidly.
    #[pyo3(signature = (tool = ToolName::Number(0), *, rate_hz = 1000.0, coupling_stiffness = 0.0, coupling_angular_stiffness = 0.0))]
    fn attach(
        &mut self,
        tool: ToolName,
        rate_hz: f64,
        coupling_stiffness: f64,
        coupling_angular_stiffness: f64,
    ) -> PyResult<usize> {
        let tool = self.tool(&tool)?;
        if !(10.0..=2000.0).contains(&rate_hz) {
            return Err(bad_value(format!("rate_hz is {rate_hz}: how often poses come, 10 to 2000")));
        }
        let compliance = |name: &str, stiffness: f64| match stiffness {
            0.0 => Ok(0.0),
            stiffness if stiffness > 0.0 && stiffness.is_finite() => Ok(1.0 / stiffness),
            _ => Err(bad_value(format!("{name} is {stiffness}: 0 holds the tool rigidly, else above 0"))),
        };
        let coupling = Coupling {
            compliance: compliance("coupling_stiffness", coupling_stiffness)?,
            angular_compliance: compliance("coupling_angular_stiffness", coupling_angular_stiffness)?,
        };
        let period_ticks = ((1.0 / (rate_hz * TICK)).round() as u32).max(1);
        let epoch = self.core.tools()[tool].epoch.wrapping_add(1).max(1);
        self.sequence[tool] = 0;
        self.tick_with(tool, Some(ToolEvent::Attach { epoch, period_ticks, coupling }));
        Ok(tool)
    }

    /// Lets a tool go. Takes one tick.
    #[pyo3(signature = (tool = ToolName::Number(0)))]
    fn detach(&mut self, tool: ToolName) -> PyResult<()> {
        let tool = self.held(&tool)?;
        self.tick_with(tool, Some(ToolEvent::Detach));
        Ok(())
    }

    /// Sets parameters, each in a tick of its own: ``{"stiffness.nodule": 2.0, "gravity": [0, 0, -9.81]}``.
    ///
    /// Names: "gravity" [m/s²], "damping" (part of the scene's), "stiffness.TISSUE" (factor on what the scene gives),
    /// "friction.TOOL", "shape.TOOL" (the tool whose shape it has); "stiffness", "friction" and "shape" alone mean all. Raises
    /// ``ValueError`` with the name and the range of one that is refused, and sets none then.
    fn set_parameters(&mut self, parameters: &Bound<'_, PyDict>) -> PyResult<()> {
        let named = |(name, values): &(String, Vec<f64>)| self.scene.parameters_named(name, values).map_err(bad_value);
        let parameters = named_values(parameters)?.iter().map(named).collect::<PyResult<Vec<_>>>()?.concat();
        let ranges = ParameterRanges::new(self.core.body(), self.core.settings());
        let mut set = self.core.parameters().to_vec();
        self.scene.check_parameters(self.core.body(), &ranges, &parameters, &mut set).map_err(bad_value)?;
        for parameter in parameters {
            self.core.advance(&Inputs { parameter: Some(parameter), ..Inputs::default() });
        }
        Ok(())
    }

    /// One tick (1 ms), in which the tool gets a new pose, or nothing happens; the wrench after it.
    #[pyo3(signature = (pose = None, tool = ToolName::Number(0)))]
    fn step(&mut self, py: Python<'_>, pose: Option<&Bound<'_, PyAny>>, tool: ToolName) -> PyResult<Wrench> {
        let (tool, event) = match pose {
            Some(pose) => {
                let (tool, pose) = (self.held(&tool)?, one_pose(pose)?);
                (tool, Some(self.pose_event(tool, pose)))
            }
            None => (self.tool(&tool)?, None),
        };
        py.detach(|| self.tick_with(tool, event));
        Ok(Wrench(Row::of(self.core.outputs(), tool)))
    }

    /// One tick for each row of ``poses``, (n, 3), (n, 7) or, of a tool with jaws, (n, 8). Python's lock is free meanwhile.
    ///
    /// Several tools at once, each with as many poses.
    #[pyo3(signature = (poses, tool = ToolName::Number(0)))]
    fn run<'py>(&mut self, py: Python<'py>, poses: &Bound<'py, PyAny>, tool: ToolName) -> PyResult<Bound<'py, PyAny>> {
        // A dictionary moves several tools at once.
        let by_tool: Vec<(usize, Vec<Stance>)> = match poses.cast::<PyDict>() {
            Ok(poses) => {
                let one = |(name, poses): (Bound<'py, PyAny>, Bound<'py, PyAny>)| {
                    PyResult::Ok((self.held(&name.extract()?)?, self::poses(&poses)?))
                };
                poses.iter().map(one).collect::<PyResult<_>>()?
            }
            Err(_) => vec![(self.held(&tool)?, self::poses(poses)?)],
        };
        let ticks = by_tool.first().map_or(0, |(_, poses)| poses.len());
        if by_tool.iter().any(|(_, poses)| poses.len() != ticks) {
            return Err(bad_value("tools that move together have as many poses each"));
        }
        let rows = py.detach(|| {
            let mut rows: Vec<Vec<Row>> = by_tool.iter().map(|_| Vec::with_capacity(ticks)).collect();
            for tick in 0..ticks {
                let mut inputs = Inputs::default();
                for (tool, poses) in &by_tool {
                    inputs.tools[*tool] = Some(self.pose_event(*tool, poses[tick]));
                }
                let outputs = self.core.advance(&inputs);
                by_tool.iter().zip(&mut rows).for_each(|((tool, _), rows)| rows.push(Row::of(outputs, *tool)));
            }
            rows
        });
        if let Ok(given) = poses.cast::<PyDict>() {
            let out = PyDict::new(py);
            for (name, rows) in given.keys().iter().zip(rows) {
                out.set_item(name, Wrenches(rows))?;
            }
            return Ok(out.into_any());
        }
        Ok(Bound::new(py, Wrenches(rows.into_iter().flatten().collect()))?.into_any())
    }

    /// (n, 3) [m] vertices of the surface now.
    fn vertices<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        table::<3, _>(py, self.core.touched_surface().into_iter().map(Into::into))
    }

    /// (m, 3) vertex numbers, counter-clockwise seen from outside.
    #[getter]
    fn triangles<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<u32>>> {
        table(py, self.core.body().surface().triangles.iter().copied())
    }

    /// (n, 3) [m] vertices of the surface at rest.
    #[getter]
    fn rest_vertices<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        table::<3, _>(py, self.core.body().surface().vertices.iter().map(|x| (*x).into()))
    }

    /// (2, 3) [m] least and greatest coordinates of the surface at rest.
    #[getter]
    fn bounds<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let Bounds { low, high } = self.core.body().surface().bounds();
        table::<3, _>(py, [low.into(), high.into()].into_iter())
    }

    /// (n) level of detail that displays each vertex, 0 the coarsest.
    fn levels<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<u8>> {
        let mut levels = vec![0; self.core.body().surface().vertices.len()];
        self.core.mesh().display_levels(self.core.body(), &mut levels);
        PyArray1::from_vec(py, levels)
    }

    /// Everything that the next tick depends on beside its inputs.
    fn snapshot<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyBytes>> {
        let mut bytes = self.core.body().checksum().to_le_bytes().to_vec();
        bytes.extend(postcard::to_stdvec(&self.core.snapshot()).map_err(bad_value)?);
        Ok(PyBytes::new(py, &bytes))
    }

    /// Goes back to a snapshot of this body: the same poses give the same bits again.
    fn restore(&mut self, py: Python<'_>, snapshot: &[u8]) -> PyResult<()> {
        let none = || bad_value("these bytes are no snapshot of this body");
        let (checksum, state) = snapshot.split_first_chunk::<CHECKSUM_BYTES>().ok_or_else(none)?;
        if *checksum != self.core.body().checksum().to_le_bytes() {
            return Err(none());
        }
        let state: Snapshot = postcard::from_bytes(state).map_err(|_| none())?;
        py.detach(|| {
            let sequence = state.tools.iter().map(|tool| tool.sequence).collect();
            let core = Core::new(self.core.body().clone(), self.scene.settings(), state).map_err(bad_value)?;
            self.core = core.with_reset_state(&self.reset).map_err(bad_value)?;
            self.sequence = sequence;
            Ok(())
        })
    }

    /// 64 bits of the whole state: the same for the same history, on any x86-64 machine.
    #[getter]
    fn hash(&self) -> u64 {
        self.core.hash()
    }

    /// Ticks since the start.
    #[getter]
    fn tick(&self) -> u64 {
        self.core.tick()
    }

    /// Simulated time [s].
    #[getter]
    fn time(&self) -> f64 {
        self.core.tick() as f64 * TICK
    }

    /// Names of the tools.
    #[getter]
    fn tools(&self) -> Vec<String> {
        self.scene.tool.iter().map(|tool| tool.name.clone()).collect()
    }

    /// Which of them are attached.
    #[getter]
    fn attached(&self) -> Vec<bool> {
        self.core.tools().iter().map(|tool| tool.epoch != 0).collect()
    }

    /// Name of the body.
    #[getter]
    fn name(&self) -> &str {
        self.core.body().name()
    }

    /// Mass of the body [kg].
    #[getter]
    fn mass(&self) -> f64 {
        self.core.body().mass()
    }

    /// Nodes that are simulated now, of all levels.
    #[getter]
    fn active_nodes(&self) -> usize {
        self.core.mesh().active().len()
    }

    /// Elements that are simulated now.
    #[getter]
    fn elements(&self) -> usize {
        self.core.mesh().pool().len()
    }

    /// The scene (TOML), every default written out.
    #[getter]
    fn scene(&self) -> String {
        self.scene.to_toml()
    }

    /// As :meth:`run`, and writes a recording (MCAP) that ``palpate replay`` runs again and ``palpate view`` shows.
    #[pyo3(signature = (path, poses, tool = ToolName::Number(0)))]
    fn record(
        &mut self,
        py: Python<'_>,
        path: PathBuf,
        poses: &Bound<'_, PyAny>,
        tool: ToolName,
    ) -> PyResult<Wrenches> {
        use palpate::recording::RecordingWriter;
        let (tool, poses) = (self.held(&tool)?, self::poses(poses)?);
        py.detach(|| {
            let (scene, body) = (self.scene.clone(), self.core.body().clone());
            let start = self.core.snapshot();
            let mut writer = RecordingWriter::create(&path, &scene, &body, &start, &self.reset).map_err(bad_file)?;
            let mut rows = Vec::with_capacity(poses.len());
            for pose in poses {
                let mut inputs = Inputs::default();
                inputs.tools[tool] = Some(self.pose_event(tool, pose));
                let outputs = self.core.advance(&inputs);
                let hash = outputs.frame.then_some(outputs.hash);
                writer.tick(outputs.tick, &inputs, &outputs.tools, outputs.flags(), hash).map_err(bad_file)?;
                if outputs.frame {
                    writer.frame(&outputs.into()).map_err(bad_file)?;
                }
                rows.push(Row::of(outputs, tool));
            }
            writer.finish().map_err(bad_file)?;
            Ok(Wrenches(rows))
        })
    }

    fn __repr__(&self) -> String {
        let held = self.core.tools().iter().filter(|tool| tool.phase != Phase::Detached).count();
        let body = self.core.body();
        format!("Simulation('{}', {:.3} s, {:.3} kg, {held} tools held)", body.name(), self.time(), body.mass())
    }
}

/// `key=value` of `given` and of the dictionaries in it, with dotted keys behind `before` and values as TOML has them.
pub fn flatten(before: &str, given: &Bound<'_, PyDict>, out: &mut Vec<String>) -> PyResult<()> {
    for (key, value) in given {
        let key = format!("{before}{}", key.extract::<String>()?);
        match value.cast::<PyDict>() {
            Ok(inner) => flatten(&format!("{key}."), inner, out)?,
            Err(_) => out.push(format!("{key}={}", toml_value(&key, &value)?)),
        }
    }
    Ok(())
}

fn toml_value(key: &str, value: &Bound<'_, PyAny>) -> PyResult<String> {
    let list = |items: Vec<Bound<'_, PyAny>>| {
        let items: Vec<String> = items.iter().map(|item| toml_value(key, item)).collect::<PyResult<_>>()?;
        PyResult::Ok(format!("[{}]", items.join(", ")))
    };
    if let Ok(table) = value.cast::<PyDict>() {
        let entry = |(name, value): (Bound<'_, PyAny>, Bound<'_, PyAny>)| {
            let name: String = name.extract()?;
            PyResult::Ok(format!("{name} = {}", toml_value(&format!("{key}.{name}"), &value)?))
        };
        return Ok(format!("{{ {} }}", table.iter().map(entry).collect::<PyResult<Vec<_>>>()?.join(", ")));
    }
    if let Ok(truth) = value.cast::<PyBool>() {
        return Ok(truth.is_true().to_string());
    }
    if let Ok(text) = value.cast::<PyString>() {
        let text = text.to_cow()?.replace('\\', "\\\\").replace('"', "\\\"");
        return Ok(format!("\"{text}\""));
    }
    if let Ok(items) = value.cast::<PyList>() {
        return list(items.iter().collect());
    }
    if let Ok(items) = value.cast::<PyTuple>() {
        return list(items.iter().collect());
    }
    // Numbers of numpy are numbers, too.
    if let Ok(number) = value.extract::<i64>() {
        return Ok(number.to_string());
    }
    if let Ok(number) = value.extract::<f64>() {
        return Ok(format!("{number:?}"));
    }
    Err(bad_value(format!("{key}: a scene has numbers, texts, truths, lists and tables, not {}", value.get_type())))
}
