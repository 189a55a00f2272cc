//! Wrenches to Python: one by one, or a row each.

use numpy::{PyArray1, PyArray2, PyArrayMethods};
use palpate_core::contact::tool::Phase;
use palpate_core::simulation::{Outputs, TickFlags};
use palpate_sdk::proto::{ToolPhase, ToolWrench, WrenchFlag};
use pyo3::prelude::*;

/// Numbers of one wrench.
#[derive(Clone, Copy, Default)]
pub struct Row {
    pub tick: u64,
    pub position: [f64; 3],
    pub orientation: [f64; 4],
    pub force: [f64; 3],
    pub torque: [f64; 3],
    pub physical_force: [f64; 3],
    pub physical_torque: [f64; 3],
    pub opening: f64,
    pub grip_torque: f64,
    pub contact_points: u32,
    pub phase: u8,
    pub flags: u32,
}

impl Row {
    /// What the tick of `outputs` says of tool `tool`.
    pub fn of(outputs: &Outputs, tool: usize) -> Self {
        let output = &outputs.tools[tool];
        let (state, limited) = (&output.state, &output.limited);
        let TickFlags { restored, substeps_dropped } = outputs.flags();
        let flags = [
            (limited.clamped, WrenchFlag::Clamped),
            (limited.slew, WrenchFlag::SlewLimited),
            (limited.ramping, WrenchFlag::Ramping),
            (state.speed_limited, WrenchFlag::SpeedLimited),
            (restored, WrenchFlag::StateRestored),
            (substeps_dropped, WrenchFlag::SubstepsDropped),
        ];
        let phase = match state.phase {
            Phase::Detached => ToolPhase::Detached,
            Phase::Waiting => ToolPhase::Waiting,
            Phase::Engaged => ToolPhase::Engaged,
            Phase::Holding => ToolPhase::Holding,
        };
        Self {
            tick: outputs.tick,
            position: state.pose.position.into(),
            orientation: state.pose.orientation,
            force: state.force.into(),
            torque: state.torque.into(),
            physical_force: state.physical_force.into(),
            physical_torque: state.physical_torque.into(),
            opening: state.jaws.opening,
            grip_torque: state.jaws.torque,
            contact_points: output.contact_points,
            phase: phase as u8,
            flags: flags.iter().filter(|(set, _)| *set).map(|(_, flag)| *flag as u32).sum(),
        }
    }
}

impl From<&palpate_sdk::Wrench> for Row {
    fn from(wrench: &palpate_sdk::Wrench) -> Self {
        Self {
            tick: wrench.tick,
            position: wrench.position,
            orientation: wrench.orientation,
            force: wrench.force,
            torque: wrench.torque,
            physical_force: wrench.physical_force,
            physical_torque: wrench.physical_torque,
            opening: wrench.opening,
            grip_torque: wrench.grip_torque,
            contact_points: wrench.contact_points,
            phase: wrench.phase as u8,
            flags: wrench.flags,
        }
    }
}

impl TryFrom<&ToolWrench> for Row {
    type Error = palpate_sdk::ClientError;

    fn try_from(message: &ToolWrench) -> Result<Self, Self::Error> {
        Ok(Self::from(&palpate_sdk::Wrench::try_from(message)?))
    }
}

/// What a tool feels in one tick.
#[pyclass(frozen, module = "palpate")]
pub struct Wrench(pub Row);

#[pymethods]
impl Wrench {
    /// Simulated time [ms].
    #[getter]
    fn tick(&self) -> u64 {
        self.0.tick
    }
    /// (3) [m] of the simulated tool, which hangs back from the handle under force.
    #[getter]
    fn position<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_slice(py, &self.0.position)
    }
    /// (4) quaternion x, y, z, w of the simulated tool.
    #[getter]
    fn orientation<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_slice(py, &self.0.orientation)
    }
    /// (3) [N] on the tool, rendered: after clamp, slew limit and ramp.
    #[getter]
    fn force<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_slice(py, &self.0.force)
    }
    /// (3) [N·m] about the tool's reference point, rendered.
    #[getter]
    fn torque<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_slice(py, &self.0.torque)
    }
    /// (3) [N] on the tool, as the contact gives it.
    #[getter]
    fn physical_force<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_slice(py, &self.0.physical_force)
    }
    /// (3) [N·m] about the tool's reference point, as the contact gives it.
    #[getter]
    fn physical_torque<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_slice(py, &self.0.physical_torque)
    }
    /// How far the jaws of the simulated tool are open: 0, closed, to 1.
    #[getter]
    fn opening(&self) -> f64 {
        self.0.opening
    }
    /// [N·m] What opens the jaws, for the angle between them, rendered.
    #[getter]
    fn grip_torque(&self) -> f64 {
        self.0.grip_torque
    }
    /// Contact points that carry force; 0: free.
    #[getter]
    fn contact_points(&self) -> u32 {
        self.0.contact_points
    }
    /// "detached", "waiting", "engaged" or "holding", see :class:`palpate.Phase`.
    #[getter]
    fn phase(&self) -> &'static str {
        phase_name(self.0.phase)
    }
    /// Bits of :class:`palpate.WrenchFlag`.
    #[getter]
    fn flags(&self) -> u32 {
        self.0.flags
    }
    fn __repr__(&self) -> String {
        let Row { tick, force: [x, y, z], contact_points, .. } = self.0;
        let phase = self.phase();
        format!("Wrench(tick={tick}, force=[{x:.4}, {y:.4}, {z:.4}], phase='{phase}', contact_points={contact_points})")
    }
}

/// A phase in words.
pub fn phase_name(phase: u8) -> &'static str {
    match ToolPhase::try_from(i32::from(phase)) {
        Ok(ToolPhase::Waiting) => "waiting",
        Ok(ToolPhase::Engaged) => "engaged",
        Ok(ToolPhase::Holding) => "holding",
        Ok(ToolPhase::Detached) | Err(_) => "detached",
    }
}

/// Wrenches of one tool, a row each.
#[pyclass(frozen, module = "palpate")]
pub struct Wrenches(pub Vec<Row>);

/// Rows of `N` numbers as an array (n, N).
pub fn table<'py, const N: usize, T: numpy::Element + Copy>(
    py: Python<'py>,
    rows: impl ExactSizeIterator<Item = [T; N]>,
) -> PyResult<Bound<'py, PyArray2<T>>> {
    let n = rows.len();
    PyArray1::from_vec(py, rows.flatten().collect()).reshape([n, N])
}

fn column<'py, T: numpy::Element>(rows: &[Row], py: Python<'py>, of: impl Fn(&Row) -> T) -> Bound<'py, PyArray1<T>> {
    PyArray1::from_vec(py, rows.iter().map(of).collect())
}

#[pymethods]
impl Wrenches {
    fn __len__(&self) -> usize {
        self.0.len()
    }
    /// (n) simulated time [ms].
    #[getter]
    fn tick<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<u64>> {
        column(&self.0, py, |row| row.tick)
    }
    /// (n) simulated time [s].
    #[getter]
    fn time<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        column(&self.0, py, |row| row.tick as f64 * palpate_core::simulation::TICK)
    }
    /// (n, 3) [m] of the simulated tool.
    #[getter]
    fn position<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        table(py, self.0.iter().map(|row| row.position))
    }
    /// (n, 4) quaternions x, y, z, w of the simulated tool.
    #[getter]
    fn orientation<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        table(py, self.0.iter().map(|row| row.orientation))
    }
    /// (n, 3) [N] on the tool, rendered: after clamp, slew limit and ramp.
    #[getter]
    fn force<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        table(py, self.0.iter().map(|row| row.force))
    }
    /// (n, 3) [N·m] about the tool's reference point, rendered.
    #[getter]
    fn torque<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        table(py, self.0.iter().map(|row| row.torque))
    }
    /// (n, 3) [N] on the tool, as the contact gives it.
    #[getter]
    fn physical_force<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        table(py, self.0.iter().map(|row| row.physical_force))
    }
    /// (n, 3) [N·m] about the tool's reference point, as the contact gives it.
    #[getter]
    fn physical_torque<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        table(py, self.0.iter().map(|row| row.physical_torque))
    }
    /// (n) how far the jaws of the simulated tool are open: 0, closed, to 1.
    #[getter]
    fn opening<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        column(&self.0, py, |row| row.opening)
    }
    /// (n) [N·m] what opens the jaws, for the angle between them, rendered.
    #[getter]
    fn grip_torque<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        column(&self.0, py, |row| row.grip_torque)
    }
    /// (n) contact points that carry force.
    #[getter]
    fn contact_points<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<u32>> {
        column(&self.0, py, |row| row.contact_points)
    }
    /// (n) values of :class:`palpate.Phase`.
    #[getter]
    fn phase<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<u8>> {
        column(&self.0, py, |row| row.phase)
    }
    /// (n) bits of :class:`palpate.WrenchFlag`.
    #[getter]
    fn flags<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<u32>> {
        column(&self.0, py, |row| row.flags)
    }
    fn __repr__(&self) -> String {
        format!("Wrenches({} rows)", self.0.len())
    }
}
