//! Simulations without a network: any scene, for any time, under a recorded tool trajectory, as fast as it goes.

use crate::output::Output;
use crate::scene::Scene;
use palpate_core::contact::tool::{Coupling, MOST_TOOLS, PoseSample, ToolEvent};
use palpate_core::geometry::locate::Host;
use palpate_core::ids::{Element, Node};
use palpate_core::math::{Pose, Real, Vec3, normalized_quaternion};
use palpate_core::model::energy::energy;
use palpate_core::simulation::{Inputs, Outputs, Simulation, TICK};
use std::io;
use std::path::Path;

/// Poses of tools over time: the events of each tick.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Trajectory {
    /// Tick (from 1), tool, event; ascending by tick.
    events: Vec<(u64, usize, ToolEvent)>,
}

/// Why a trajectory cannot be used.
#[derive(Debug, thiserror::Error)]
#[error("{origin}, line {line}: {what}")]
pub struct TrajectoryError {
    /// The file.
    pub origin: String,
    /// Line, from 1.
    pub line: usize,
    /// What is wrong, and what is expected.
    pub what: String,
}

/// First line of a trajectory file.
pub const TRAJECTORY_HEADER: &str = "time_s,tool,x_m,y_m,z_m,qx,qy,qz,qw,buttons";

impl Trajectory {
    /// Reads a trajectory: CSV with the columns of [`TRAJECTORY_HEADER`], times ascending from 0 (a row of time `t`
    /// acts in the first tick that ends later), each tool attached just before its first pose, with the median time
    /// between its rows as its period.
    ///
    /// # Errors
    /// With file, line and what is expected. `tools` is how many the scene has.
    pub fn parse(text: &str, origin: &str, tools: usize) -> Result<Self, TrajectoryError> {
        let mut reader = csv::ReaderBuilder::new()
            .has_headers(false)
            .flexible(true)
            .trim(csv::Trim::All)
            .from_reader(text.as_bytes());
        let records = reader.records().filter(|r| !r.as_ref().is_ok_and(|r| r.iter().all(str::is_empty)));
        let mut records = records.peekable();
        // The reader counts lines from where it stood before it passed over empty ones.
        let line_of = |position: Option<&csv::Position>| {
            let at = position.map_or(0, |p| p.byte() as usize).min(text.len());
            let blank = text[at..].len() - text[at..].trim_start_matches(['\r', '\n']).len();
            text[..at + blank].matches('\n').count() + 1
        };
        let fault_at = |line: usize, what: String| TrajectoryError { origin: origin.to_owned(), line, what };
        let columns: Vec<&str> = TRAJECTORY_HEADER.split(',').collect();
        let header = records.next().and_then(Result::ok).unwrap_or_default();
        if header != columns {
            let line = line_of(header.position());
            return Err(fault_at(line, format!("the first line must be \"{TRAJECTORY_HEADER}\"")));
        }
        let mut poses: Vec<(u64, usize, PoseSample)> = Vec::new();
        for record in records {
            let record = record.map_err(|e| fault_at(line_of(e.position()), e.to_string()))?;
            let fault = |what: String| fault_at(line_of(record.position()), what);
            let fields: Vec<&str> = record.iter().collect();
            let [time, tool, rest @ ..] = &fields[..] else {
                return Err(fault(format!("ten columns are expected, found {}", fields.len())));
            };
            let number = |s: &str| s.parse::<Real>().ok().filter(|x| x.is_finite());
            let time = number(time)
                .filter(|t| (0.0..=1e6).contains(t))
                .ok_or_else(|| fault(format!("time_s must be a number from 0 to 1e6, not {time:?}")))?;
            let tool = tool
                .parse::<usize>()
                .ok()
                .filter(|t| *t < tools)
                .ok_or_else(|| fault(format!("tool {tool:?}: the scene has the tools 0 to {}", tools - 1)))?;
            // A column too many has no name: how many there are is said below.
            let names = columns[2..].iter().chain(std::iter::repeat(&"the next column"));
            let values: Vec<Real> = rest
                .iter()
                .zip(names)
                .map(|(s, name)| number(s).ok_or_else(|| fault(format!("{name}: {s:?} is not a finite number"))))
                .collect::<Result<_, _>>()?;
            let &[x, y, z, qx, qy, qz, qw, buttons] = &values[..] else {
                return Err(fault(format!("ten columns are expected, found {}", fields.len())));
            };
            let orientation = normalized_quaternion([qx, qy, qz, qw])
                .ok_or_else(|| fault("qx,qy,qz,qw must be a quaternion other than zero".into()))?;
            let tick = (time / TICK + 1e-6).floor() as u64 + 1;
            if poses.last().is_some_and(|last| last.0 > tick) {
                return Err(fault("times must ascend".into()));
            }
            poses.push((
                tick,
                tool,
                PoseSample {
                    sequence: 0,
                    time_ns: (time * 1e9) as u64,
                    pose: Pose { position: Vec3::new(x, y, z), orientation },
                    buttons: buttons as u32,
                },
            ));
        }
        Ok(Self { events: events_of(poses) })
    }

    /// The inputs of tick `tick` (from 1).
    pub fn inputs(&self, tick: u64) -> Inputs {
        let mut inputs = Inputs::default();
        let first = self.events.partition_point(|e| e.0 < tick);
        for (_, tool, event) in self.events[first..].iter().take_while(|e| e.0 == tick) {
            inputs.tools[*tool] = Some(*event);
        }
        inputs
    }

    /// Last tick with a pose.
    pub fn last_tick(&self) -> u64 {
        self.events.last().map_or(0, |e| e.0)
    }
}

/// Attach events and numbered poses, at most one event per tool and tick.
fn events_of(poses: Vec<(u64, usize, PoseSample)>) -> Vec<(u64, usize, ToolEvent)> {
    let mut events = Vec::new();
    for tool in 0..MOST_TOOLS {
        let mut mine: Vec<(u64, PoseSample)> = poses.iter().filter(|p| p.1 == tool).map(|p| (p.0, p.2)).collect();
        // Of several poses in one tick the newest counts, as in a mailbox.
        mine.reverse();
        mine.dedup_by_key(|p| p.0);
        mine.reverse();
        let Some(first) = mine.first() else { continue };
        let mut gaps: Vec<u64> = mine.windows(2).map(|pair| pair[1].0 - pair[0].0).collect();
        gaps.sort_unstable();
        let period_ticks = gaps.get(gaps.len() / 2).copied().unwrap_or(1) as u32;
        // The tool is taken one tick before its first pose, so everything moves one tick later.
        events.push((first.0, tool, ToolEvent::Attach { epoch: 1, period_ticks, coupling: Coupling::RIGID }));
        for (i, (tick, sample)) in mine.into_iter().enumerate() {
            let sample = PoseSample { sequence: i as u32 + 1, ..sample };
            events.push((tick + 1, tool, ToolEvent::Pose(sample)));
        }
    }
    events.sort_by_key(|e| (e.0, e.1));
    events
}

/// A trajectory file being written.
pub struct TrajectoryWriter(csv::Writer<Output>);

impl TrajectoryWriter {
    /// Creates the file with its header.
    ///
    /// # Errors
    /// Those of the file system.
    pub fn create(path: &Path) -> io::Result<Self> {
        let mut out = csv::Writer::from_writer(Output::create(path)?);
        out.write_record(TRAJECTORY_HEADER.split(','))?;
        Ok(Self(out))
    }

    /// Adds the row of a pose that acts at `tick`.
    ///
    /// # Errors
    /// Those of the file system.
    pub fn write(&mut self, tick: u64, tool: usize, sample: &PoseSample) -> io::Result<()> {
        let out = &mut self.0;
        out.write_field(format!("{:.3}", tick.saturating_sub(1) as Real * TICK))?;
        out.write_field(tool.to_string())?;
        for x in sample.pose.position.iter().chain(&sample.pose.orientation) {
            out.write_field(x.to_string())?;
        }
        out.write_field(sample.buttons.to_string())?;
        Ok(out.write_record(None::<&[u8]>)?)
    }

    /// Puts the file in its place.
    ///
    /// # Errors
    /// Those of the file system.
    pub fn finish(self) -> io::Result<()> {
        self.0.into_inner().map_err(|e| e.into_error())?.finish()
    }
}

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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_trajectory_gives_one_event_per_tool_and_tick() {
        let text = format!(
            "{TRAJECTORY_HEADER}\n0.000,0,0,0,0.1,0,0,0,1,0\n0.0002,0,0,0,0.2,0,0,0,1,0\n0.010,0,0,0,0.3,0,0,0,2,1\n"
        );
        let trajectory = Trajectory::parse(&text, "t.csv", 1).unwrap();
        assert_eq!(
            trajectory.inputs(1).tools[0],
            Some(ToolEvent::Attach { epoch: 1, period_ticks: 10, coupling: Coupling::RIGID })
        );
        let Some(ToolEvent::Pose(pose)) = trajectory.inputs(2).tools[0] else { panic!("a pose") };
        assert_eq!((pose.pose.position.z, pose.sequence), (0.2, 1));
        let Some(ToolEvent::Pose(pose)) = trajectory.inputs(12).tools[0] else { panic!("a pose") };
        assert_eq!((pose.pose.orientation, pose.buttons, trajectory.last_tick()), ([0.0, 0.0, 0.0, 1.0], 1, 12));
        assert_eq!(trajectory.inputs(5), Inputs::default());
    }

    #[test]
    fn a_bad_row_is_named_with_its_line() {
        let row = |row: &str| format!("{TRAJECTORY_HEADER}\n0,0,0,0,0,0,0,0,1,0\n{row}\n");
        for (bad, what) in [
            ("0.1,0,0,0,NaN,0,0,0,1,0", "z_m: \"NaN\" is not a finite number"),
            ("0.1,0,0,0,0,0,0,0,1,0,", "the next column"),
            ("0.1,0,0,0,0,0,0,0,1,0,0", "found 11"),
            ("0.1,3,0,0,0,0,0,0,1,0", "tools 0 to 0"),
            ("0.1,0,0,0,0,0,0,0,0,0", "quaternion"),
            ("0.1,0,0,0", "ten columns"),
            ("-1,0,0,0,0,0,0,0,1,0", "time_s"),
        ] {
            let e = Trajectory::parse(&row(bad), "t.csv", 1).unwrap_err().to_string();
            assert!(e.contains("t.csv, line 3") && e.contains(what), "{e}");
        }
        for blank in ["\n\n", "\r\n \r\n", " \n\t\n"] {
            let e = Trajectory::parse(&row(&format!("{blank}oops")), "t.csv", 1).unwrap_err().to_string();
            assert!(e.contains("t.csv, line 5"), "lines without content count: {e}");
        }
        assert!(Trajectory::parse("a,b\n", "t.csv", 1).is_err());
    }
}
