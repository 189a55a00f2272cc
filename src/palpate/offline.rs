//! Simulations without a network: any scene, for any time, under a trajectory of its tools, as fast as it goes.

mod trajectory;

pub use trajectory::{
    BUDGET_COLUMNS, EVENT_COLUMNS, PARAMETER_COLUMNS, TRAJECTORY_HEADER, Trajectory, TrajectoryError,
};

use crate::output::Output;
use crate::scene::Scene;
use palpate_core::geometry::locate::Host;
use palpate_core::ids::{Element, Node};
use palpate_core::math::{Real, Vec3};
use palpate_core::model::energy::energy;
use palpate_core::simulation::{Outputs, Simulation, TICK};
use std::io;
use std::path::Path;

/// What a run comes to.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct Summary {
    /// Name of the scene's body.
    pub scene: String,
    /// xxh3-64 of the body, hexadecimal.
    pub body_checksum: String,
    /// Ticks simulated.
    pub ticks: u64,
    /// Simulated time [s].
    pub seconds: Real,
    /// Nodes of the level that moves.
    pub nodes: usize,
    /// Its elements.
    pub elements: usize,
    /// Element evaluations in all.
    pub element_evaluations: u64,
    /// Largest physical force on each tool [N].
    pub peak_physical_force: Vec<Real>,
    /// Largest rendered force on each tool [N].
    pub peak_force: Vec<Real>,
    /// Smallest det F of any element at any time.
    pub smallest_det_f: Real,
    /// Kinetic, elastic, gravity energy at the end [J].
    pub final_energy: [Real; 3],
    /// Non-finite states contained.
    pub restored_states: u64,
    /// Hash of the final state, hexadecimal.
    pub state_hash: String,
    /// Wall-clock time [s]; not reproducible.
    pub wall_seconds: Real,
}

/// Writes `samples.csv`: one row per `every` ticks.
pub struct SampleWriter {
    out: csv::Writer<Output>,
    probes: Vec<Vec<Host<Element>>>,
    every: u64,
}

impl SampleWriter {
    /// Creates `samples.csv` in `folder` with its header.
    ///
    /// # Errors
    /// Those of the file system.
    pub fn create(folder: &Path, scene: &Scene, simulation: &Simulation, every: u64) -> io::Result<Self> {
        let mut header = vec!["time_s".to_owned()];
        for tool in &scene.tool {
            for (quantity, unit) in [("force", "N"), ("rendered_force", "N"), ("torque", "Nm")] {
                header.extend(["x", "y", "z"].map(|axis| format!("{}_{quantity}_{axis}_{unit}", tool.name)));
            }
            header.push(format!("{}_contact_points", tool.name));
        }
        let energies = ["kinetic_J", "elastic_J", "gravity_J", "total_J"];
        let momenta = ["px_kgm_s", "py_kgm_s", "pz_kgm_s", "lx_kgm2_s", "ly_kgm2_s", "lz_kgm2_s"];
        header.extend(energies.iter().chain(&momenta).map(|name| (*name).to_owned()));
        header.extend((0..simulation.body().levels().len()).map(|level| format!("active_nodes_level{level}")));
        header.extend(["element_evaluations", "substeps", "smallest_det_F"].map(str::to_owned));
        for probe in &scene.probe {
            header.extend(["x", "y", "z"].map(|axis| format!("{}_u{axis}_m", probe.name)));
        }
        let mut out = csv::Writer::from_writer(Output::create(&folder.join("samples.csv"))?);
        out.write_record(header)?;
        Ok(Self { out, probes: scene.probes(simulation.body()), every: every.max(1) })
    }

    /// Adds the row of the tick that `simulation` has just made.
    ///
    /// # Errors
    /// Those of the file system.
    pub fn write(&mut self, simulation: &Simulation, outputs: &Outputs) -> io::Result<()> {
        if !outputs.tick.is_multiple_of(self.every) {
            return Ok(());
        }
        let body = simulation.body();
        let out = &mut self.out;
        out.write_field(format!("{:.3}", outputs.tick as Real * TICK))?;
        for tool in &outputs.tools {
            let t = &tool.state;
            numbers(out, [t.physical_force, t.force, t.physical_torque].iter().flatten())?;
            out.write_field(tool.contact_points.to_string())?;
        }
        let e = energy(body, simulation.mesh(), simulation.settings().gravity);
        numbers(out, &[e.kinetic, e.elastic, e.gravity, e.total()])?;
        numbers(out, e.linear_momentum.iter().chain(&e.angular_momentum))?;
        for count in &outputs.active[..body.levels().len()] {
            out.write_field(count.to_string())?;
        }
        out.write_field(outputs.element_evaluations.to_string())?;
        out.write_field(outputs.plan.taken.to_string())?;
        out.write_field(outputs.extremes.det_f.to_string())?;
        for host in &self.probes {
            numbers(out, &displacement(simulation, host))?;
        }
        Ok(out.write_record(None::<&[u8]>)?)
    }

    /// Puts the file in its place.
    ///
    /// # Errors
    /// Those of the file system.
    pub fn finish(self) -> io::Result<()> {
        self.out.into_inner().map_err(|e| e.into_error())?.finish()
    }
}

/// Adds `values` to the row that is being written.
fn numbers<'a>(out: &mut csv::Writer<Output>, values: impl IntoIterator<Item = &'a Real>) -> io::Result<()> {
    for x in values {
        out.write_field(format!("{x:e}"))?;
    }
    Ok(())
}

/// Displacement [m] of a point, from where it lies on each level: on the one whose nodes around it are active.
pub fn displacement(simulation: &Simulation, hosts: &[Host<Element>]) -> Vec3 {
    let (body, mesh) = (simulation.body(), simulation.mesh());
    let active = |h: &&Host<Element>| mesh.active_vertices(h.element);
    let Some(host) = hosts.iter().max_by_key(active) else { return Vec3::zeros() };
    let moved = |n: Node| mesh.position_of(n).map_or(Vec3::zeros(), |x| x - body.rest(n));
    body.element(host.element).into_iter().zip(host.weights).map(|(n, w)| moved(n) * w).sum()
}

/// Runs `simulation` for `ticks` under `trajectory`; `each` sees every tick.
///
/// # Errors
/// Those of `each`.
pub fn run<E>(
    simulation: &mut Simulation,
    trajectory: &Trajectory,
    ticks: u64,
    mut each: impl FnMut(&Simulation, &Outputs) -> Result<(), E>,
) -> Result<Summary, E> {
    let started = std::time::Instant::now();
    let tools = simulation.settings().tools.len();
    let (mut peak_physical_force, mut peak_force) = (vec![0.0 as Real; tools], vec![0.0 as Real; tools]);
    let (mut element_evaluations, mut restored_states) = (0, 0);
    let mut smallest_det_f = Real::INFINITY;
    for tick in 1..=ticks {
        let outputs = simulation.advance(&trajectory.inputs(tick)).clone();
        element_evaluations += u64::from(outputs.element_evaluations);
        restored_states += u64::from(outputs.restored);
        smallest_det_f = smallest_det_f.min(outputs.extremes.det_f);
        for (i, tool) in outputs.tools.iter().enumerate() {
            peak_physical_force[i] = peak_physical_force[i].max(tool.state.physical_force.norm());
            peak_force[i] = peak_force[i].max(tool.state.force.norm());
        }
        each(simulation, &outputs)?;
    }
    let body = simulation.body();
    let e = energy(body, simulation.mesh(), simulation.settings().gravity);
    Ok(Summary {
        scene: body.name().to_owned(),
        body_checksum: format!("{:016x}", body.checksum()),
        ticks,
        seconds: ticks as Real * TICK,
        nodes: simulation.mesh().active().len(),
        elements: simulation.mesh().pool().len(),
        element_evaluations,
        peak_physical_force,
        peak_force,
        smallest_det_f,
        final_energy: [e.kinetic, e.elastic, e.gravity],
        restored_states,
        state_hash: format!("{:016x}", simulation.hash()),
        wall_seconds: started.elapsed().as_secs_f64(),
    })
}
