//! Recorded tool trajectories, run again: against traces of force and torque, which a change of the physics may move a
//! little, and bit for bit, which nothing may.
//!
//! `tests/trajectories/README.md` says where each trajectory comes from. After a change of the physics that is meant, write
//! the traces and hashes anew with `PALPATE_WRITE_TRACES=1 cargo test --release --test replay`.

use assert_cmd::Command;
use palpate::offline::{self, Trajectory};
use palpate::recording::{FORMAT, Recording, RecordingWriter, replay};
use palpate::scene::LoadedScene;
use palpate_core::contact::tool::{Coupling, PoseSample, ToolEvent};
use palpate_core::math::{Pose, Vec3};
use palpate_core::model::element_kernel::Simd;
use palpate_core::model::{Body, State};
use palpate_core::simulation::{Budget, Inputs, Simulation, Snapshot, ToolOutput};
use palpate_proto::keys::topics;
use palpate_proto::{Message, RecordingStart};
use std::collections::BTreeMap;
use std::convert::Infallible;
use std::fmt::Write as _;
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Bodies that the trajectories touch: bundled scenes, the organs with coarser levels and fewer vertices.
const BODIES: [(&str, &str, &[&str]); 6] = [
    ("cube", "cube", &[]),
    ("level", "cube", &["body.active_level=1"]),
    ("liver", "liver", &["body.spacings=[0.03, 0.019, 0.012]", "body.display_vertices=1500"]),
    ("toy", "toy", &TOY),
    ("organs", "organs", &ORGANS),
    ("grasp", "grasp", &["body.cells=[[3,3,3],[5,5,5]]"]),
];
const TOY: [&str; 8] = [
    "body.spacings=[0.02, 0.013]",
    "body.display_vertices=1500",
    "world.gravity=[0.0, 0.0, 0.0]",
    "world.settle=0",
    "material.youngs_modulus=8000",
    "material.density=1000",
    "hold=[{min=[0.0, 0.0, 0.0], max=[1.0, 1.0, 0.5], relative=true}]",
    "tool=[{name='ball', radius=0.008}]",
];
const ORGANS: [&str; 4] = [
    "body.spacings=[0.03, 0.019]",
    "body.display_vertices=1200",
    "organ.0.body.spacings=[0.02, 0.013]",
    "organ.0.body.display_vertices=600",
];
const BALL: &str = "tool=[{name=\"ball\", radius=0.01, friction=0.5}]";
/// Half open: a shaft and two jaws.
const FORCEPS: &str = "tool=[{name=\"forceps\", shape=\"compound\", friction=0.3, part=[\
    {shape=\"cylinder\", radius=0.004, length=0.06, rounding=0.001, position=[0.0, 0.0, 0.03]}, \
    {radius=0.003, length=0.03, position=[0.007, 0.0, 0.0]}, \
    {radius=0.003, length=0.03, position=[-0.007, 0.0, 0.0]}]}]";

/// Name of the trajectory, the body it touches, and its tools where they are not those of the scene.
const RUNS: [(&str, &str, &str); 18] = [
    ("press", "level", ""),
    ("press", "cube", ""),
    ("palpate", "cube", ""),
    ("stroke", "level", ""),
    ("tap", "cube", ""),
    ("tremor", "cube", ""),
    ("friction", "cube", BALL),
    ("forceps", "cube", FORCEPS),
    ("release", "cube", ""),
    ("reentry", "cube", ""),
    ("headset", "cube", ""),
    ("far", "cube", ""),
    ("palpate_liver", "liver", ""),
    ("capsule_turned", "liver", ""),
    ("two_tools", "organs", ""),
    ("stroke_organs", "organs", ""),
    ("press_toy", "toy", ""),
    ("grasp", "grasp", ""),
];
/// Ticks between two points of a trace.
const TRACE: u64 = 20;

fn folder(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests").join(name)
}

fn writing() -> bool {
    std::env::var_os("PALPATE_WRITE_TRACES").is_some()
}

fn trajectory(name: &str) -> Trajectory {
    let file = folder("trajectories").join(format!("{name}.csv"));
    Trajectory::parse(&fs::read_to_string(&file).unwrap(), &file.display().to_string(), 2).unwrap()
}

/// A body come to rest under gravity, and the scene that its tools are of.
#[derive(Clone)]
struct Stage {
    loaded: LoadedScene,
    body: Arc<Body>,
    start: State,
}

fn overrides(of: &[&str]) -> Vec<String> {
    of.iter().map(|s| (*s).to_owned()).collect()
}

impl Stage {
    fn new(name: &str) -> Self {
        let (_, scene, given) = BODIES.into_iter().find(|body| body.0 == name).unwrap();
        let loaded = LoadedScene::load(Path::new(scene), &overrides(given)).unwrap();
        let body = Arc::new(loaded.build(&mut |_, _, _| {}).unwrap());
        let start = loaded.scene.settled(&body, &mut |_, _, _| {}).body;
        Self { loaded, body, start }
    }

    /// With the tools that the override `tools` says, if it says any.
    fn with_tools(mut self, scene: &str, tools: &str) -> Self {
        if !tools.is_empty() {
            let of = LoadedScene::load(Path::new(scene), &overrides(&[tools])).unwrap();
            self.loaded.scene.tool = of.scene.tool;
        }
        self
    }

    fn start(&self) -> Snapshot {
        Snapshot::with_state(self.start.clone(), self.loaded.scene.tool.len())
    }

    fn simulation(&self, path: Simd) -> Simulation {
        Simulation::new(self.body.clone(), self.loaded.scene.settings(), self.start()).unwrap().with_path(path)
    }

    /// Each tool's force [N] and torque [N·m] on it every [`TRACE`] ticks, every frame's hash, and the final hash.
    fn run(&self, path: Simd, trajectory: &Trajectory) -> Ran {
        let mut simulation = self.simulation(path);
        let mut ran = Ran::default();
        offline::run(&mut simulation, trajectory, trajectory.last_tick(), |_, outputs| {
            if outputs.tick.is_multiple_of(TRACE) {
                let wrench = |tool: &ToolOutput| [tool.state.physical_force, tool.state.physical_torque];
                ran.trace.push(outputs.tools.iter().flat_map(wrench).flat_map(<[f64; 3]>::from).collect());
            }
            if outputs.frame {
                ran.frames.push(outputs.hash);
            }
            Ok::<(), Infallible>(())
        })
        .unwrap();
        ran.hash = simulation.hash();
        ran
    }

    /// Records what `inputs` of each of `ticks` ticks bring about, into `file`.
    fn record(&self, inputs: impl Fn(u64) -> Inputs, ticks: u64, file: &Path) {
        let mut simulation = self.simulation(Simd::best());
        let scene = &self.loaded.scene;
        let mut writer = RecordingWriter::create(file, scene, &self.body, &self.start(), &self.start).unwrap();
        for tick in 1..=ticks {
            let inputs = inputs(tick);
            let o = simulation.advance(&inputs);
            writer.tick(o.tick, &inputs, &o.tools, o.flags(), o.frame.then_some(o.hash)).unwrap();
            if o.frame {
                writer.frame(&o.into()).unwrap();
            }
        }
        assert_eq!(writer.finish().unwrap().ticks, ticks);
    }

    fn record_trajectory(&self, trajectory: &Trajectory, file: &Path) -> u64 {
        self.record(|tick| trajectory.inputs(tick), trajectory.last_tick(), file);
        trajectory.last_tick()
    }
}

/// What a run gave.
#[derive(Clone, Debug, Default, PartialEq)]
struct Ran {
    trace: Vec<Vec<f64>>,
    frames: Vec<u64>,
    hash: u64,
}

/// Largest length of the vectors that begin at column `at` of each row.
fn peak(trace: &[Vec<f64>], at: usize) -> f64 {
    trace.iter().map(|row| row[at..at + 3].iter().map(|c| c * c).sum::<f64>().sqrt()).fold(0.0, f64::max)
}

/// Compares what `stage` gives under `trajectory` with its trace, or writes the trace anew; gives the final hash.
fn check_run(name: &str, stage: &Stage, trajectory: &Trajectory) -> u64 {
    let ran = stage.run(Simd::best(), trajectory);
    let file = folder("trajectories").join(format!("{name}.trace.csv"));
    if writing() {
        let mut out = csv::Writer::from_path(&file).unwrap();
        let axes = ["force_x_N", "force_y_N", "force_z_N", "torque_x_Nm", "torque_y_Nm", "torque_z_Nm"];
        let columns = stage.loaded.scene.tool.iter().flat_map(|t| axes.map(|axis| format!("{}_{axis}", t.name)));
        out.write_record(["tick".to_owned()].into_iter().chain(columns)).unwrap();
        for (row, tick) in ran.trace.iter().zip(1..) {
            let numbers = row.iter().map(|x| format!("{x:.6}"));
            out.write_record([(tick * TRACE).to_string()].into_iter().chain(numbers)).unwrap();
        }
        out.flush().unwrap();
    }
    let rows = csv::Reader::from_path(&file).unwrap().into_deserialize::<Vec<f64>>();
    let trace: Vec<Vec<f64>> = rows.map(|row| row.unwrap()[1..].to_vec()).collect();
    assert_eq!(trace.len(), ran.trace.len(), "{name}");
    let mut touched = 0.0;
    for tool in (0..ran.trace[0].len()).step_by(6) {
        for (quantity, unit, at, least) in [("force", "N", tool, 0.002), ("torque", "N·m", tool + 3, 5e-5)] {
            let peak = peak(&trace, at);
            touched = f64::max(touched, if at == tool { peak } else { 0.0 });
            let off = |(a, b): (&Vec<f64>, &Vec<f64>)| {
                a[at..at + 3].iter().zip(&b[at..at + 3]).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max)
            };
            let worst = trace.iter().zip(&ran.trace).map(off).fold(0.0, f64::max);
            println!("{name}: tool {}: {quantity} up to {peak:.4} {unit}, off by {worst:.6}", tool / 6);
            assert!(worst <= 0.03 * peak + least, "{name}: {quantity} off by {worst} of {peak} {unit}");
        }
    }
    assert!(touched > 0.05, "{name} touches: {touched} N");
    // The other forms of the kernel give the same bits at every frame.
    for path in Simd::available().into_iter().filter(|path| *path != Simd::best()) {
        assert_eq!(stage.run(path, trajectory), ran, "{name} on {path:?}");
    }
    ran.hash
}

#[test]
fn recorded_trajectories_give_their_wrenches_and_their_bits_again() {
    let on_body = |(body, scene, _): (&str, &str, &[&str])| {
        let stage = Stage::new(body);
        let runs = RUNS.into_iter().filter(|run| run.1 == body);
        runs.map(|(name, _, tools)| {
            let file = format!("{name}.{body}");
            let hash = check_run(&file, &stage.clone().with_tools(scene, tools), &trajectory(name));
            (file, hash)
        })
        .collect::<Vec<_>>()
    };
    let ran: Vec<(String, u64)> = std::thread::scope(|scope| {
        let threads = BODIES.map(|body| scope.spawn(move || on_body(body)));
        threads.into_iter().flat_map(|thread| thread.join().unwrap()).collect()
    });
    assert_eq!(ran.len(), RUNS.len(), "each run names a body");
    let mut hashes = String::new();
    ran.iter().for_each(|(name, hash)| writeln!(hashes, "{name} {hash:016x}").unwrap());
    let hash_file = folder("regressions").join("hashes.txt");
    if writing() {
        fs::create_dir_all(folder("regressions")).unwrap();
        fs::write(&hash_file, &hashes).unwrap();
        return;
    }
    // Written by an optimised build; this one may have another profile.
    let known = fs::read_to_string(&hash_file).unwrap_or_default();
    assert_eq!(hashes, known, "the bits have changed: see the head of this file");
}

/// A hand that presses the cube through a soft coupling, turns, lets go at depth, and comes again, with a reset between.
fn visit(tick: u64) -> Inputs {
    let mut inputs = Inputs { reset: tick == 900, ..Inputs::default() };
    let coupling = Coupling { compliance: 1.0 / 700.0, angular_compliance: 1.0 / 0.4 };
    let angle = 0.5 * (tick as f64 / 400.0).sin();
    let depth = 0.012 * (0.5 - 0.5 * (tick as f64 * std::f64::consts::TAU / 700.0).cos());
    let pose = Pose {
        position: Vec3::new(0.045 + 0.01 * angle, 0.05, 0.1225 - depth),
        orientation: [0.0, (0.5 * angle).sin(), 0.0, (0.5 * angle).cos()],
    };
    inputs.tools[0] = match tick {
        1 | 1000 => Some(ToolEvent::Attach { epoch: 5, period_ticks: 2, coupling }),
        420 => Some(ToolEvent::Detach),
        421..=999 => None,
        _ => tick.is_multiple_of(2).then(|| {
            ToolEvent::Pose(PoseSample {
                sequence: tick as u32,
                time_ns: 7 * tick,
                pose,
                buttons: u32::from(tick > 300),
                opening: 0.0,
            })
        }),
    };
    inputs
}

#[test]
fn a_trajectory_made_of_a_recording_gives_its_forces_again() {
    let cube = Stage::new("cube");
    let ticks = 1500;
    // As a server records: each tick has a budget.
    for (kind, limit, most_off) in [("unlimited", u32::MAX, 1e-6), ("as a slow server has it", 300_000, 0.02)] {
        let folder = tempfile::tempdir().unwrap();
        let path = |name: &str| folder.path().join(name).display().to_string();
        let budget = Budget { limit, ..Budget::UNLIMITED };
        cube.record(|tick| Inputs { budget, ..visit(tick) }, ticks, Path::new(&path("visit.mcap")));
        let palpate = |arguments: &[&str]| {
            let done = Command::new(env!("CARGO_BIN_EXE_palpate")).args(arguments).assert().success();
            String::from_utf8_lossy(&done.get_output().stdout).into_owned()
        };
        let said = palpate(&["replay", &path("visit.mcap"), "--trajectory-out", &path("visit.csv")]);
        assert!(said.contains("identical") && !said.contains("differs"), "{said}");
        let (csv, out) = (path("visit.csv"), path("out"));
        palpate(&["simulate", "cube", "--seconds", "1.5", "--trajectory", &csv, "--out", &out]);
        let mut samples = csv::Reader::from_path(folder.path().join("out/samples.csv")).unwrap();
        let rows: Vec<Vec<f64>> = samples.deserialize().map(Result::unwrap).collect();
        let recording = Recording::read(Path::new(&path("visit.mcap"))).unwrap();
        let (mut peak, mut worst) = (0.0, 0.0);
        for (row, tick) in rows.iter().zip(1..) {
            let Some(recorded) = recording.wrenches.get(&(tick, 0)) else { continue };
            for (recorded, again) in recorded.physical_force.iter().chain(&recorded.force).zip(&row[1..7]) {
                peak = f64::max(peak, again.abs());
                worst = f64::max(worst, (f64::from(*recorded) - again).abs());
            }
        }
        println!("{kind}: up to {peak:.3} N, off by {worst:e} N");
        assert!(rows.len() == ticks as usize && peak > 0.2, "{} ticks, {peak} N", rows.len());
        assert!(worst <= most_off * peak, "{kind}: off by {worst} N of {peak} N");
    }
}

#[test]
fn a_recording_replays_identical_in_the_library_and_on_the_command_line() {
    let cube = Stage::new("cube");
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("tap.mcap");
    let ticks = cube.record_trajectory(&trajectory("tap"), &file);
    let recording = Recording::read(&file).unwrap();
    for path in Simd::available() {
        let report = replay(&recording, path).unwrap();
        assert_eq!((report.difference, report.ticks), (None, ticks));
        assert!(report.hashes == ticks / 32 && report.wrenches > ticks * 9 / 10);
    }
    let again = folder.path().join("again.csv");
    let output = Command::new(env!("CARGO_BIN_EXE_palpate"))
        .args(["replay", file.to_str().unwrap(), "--trajectory-out", again.to_str().unwrap()])
        .assert()
        .success();
    let text = String::from_utf8_lossy(&output.get_output().stdout).into_owned();
    assert!(text.contains("identical") && !text.contains("differs"), "{text}");
    // The trajectory that comes out is the one that went in.
    let text = fs::read_to_string(&again).unwrap();
    let (before, after) = (trajectory("tap"), Trajectory::parse(&text, "again", 1).unwrap());
    assert_eq!((after.last_tick(), after.inputs(1)), (before.last_tick(), before.inputs(1)));
}

#[test]
fn a_changed_input_is_found_with_its_tick_and_its_size() {
    let cube = Stage::new("level");
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("press.mcap");
    cube.record_trajectory(&trajectory("press"), &file);
    let mut recording = Recording::read(&file).unwrap();
    let (_, inputs) = recording.inputs.iter_mut().find(|(tick, i)| *tick > 1400 && i.tools[0].is_some()).unwrap();
    let Some(ToolEvent::Pose(pose)) = &mut inputs.tools[0] else { panic!("a pose") };
    pose.pose.position.z += 1e-4;
    let changed = pose.sequence;
    let report = replay(&recording, Simd::best()).unwrap();
    let difference = report.difference.unwrap();
    println!("{changed}: {difference:?}");
    // While it presses: the force is another, too.
    assert!((1400..1410).contains(&difference.tick), "{difference:?}");
    assert!(difference.what.contains("pose by") && difference.what.contains("force by"), "{difference:?}");
    assert!(!difference.what.contains("physical force by 0e0"), "{difference:?}");
}

#[test]
fn a_recording_cut_short_replays_up_to_the_cut() {
    let cube = Stage::new("level");
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("stroke.mcap");
    let ticks = cube.record_trajectory(&trajectory("stroke"), &file);
    let bytes = fs::read(&file).unwrap();
    for percent in [97, 70, 50] {
        let cut = folder.path().join(format!("cut{percent}.mcap"));
        fs::write(&cut, &bytes[..bytes.len() * percent / 100]).unwrap();
        let recording = Recording::read(&cut).unwrap();
        let report = replay(&recording, Simd::best()).unwrap();
        println!("{percent} %: {} of {ticks} ticks, {:?}", report.ticks, recording.cut);
        assert_eq!(report.difference, None);
        // The index at the end of the file counts too, and a chunk that is not whole is lost.
        let least = if percent == 97 { 60 } else { percent as u64 - 25 };
        assert!(report.ticks * 100 >= ticks * least && report.ticks > 0, "{percent} %: {}", report.ticks);
        assert!(percent == 97 || recording.cut.is_some());
    }
    fs::write(&file, &bytes[..1000]).unwrap();
    let e = Recording::read(&file).err().unwrap().to_string();
    assert!(e.contains("stroke.mcap") && e.contains("start"), "{e}");
    fs::write(&file, b"no recording at all").unwrap();
    let output =
        Command::new(env!("CARGO_BIN_EXE_palpate")).args(["replay", file.to_str().unwrap()]).assert().failure();
    let text = String::from_utf8_lossy(&output.get_output().stderr).into_owned();
    assert!(text.contains("stroke.mcap"), "{text}");
}

#[test]
fn a_recording_of_an_earlier_format_is_refused_with_both_formats() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("old.mcap");
    let mut writer = mcap::Writer::new(fs::File::create(&file).unwrap()).unwrap();
    let channel_id = writer.add_channel(0, topics::START, "protobuf", &BTreeMap::new()).unwrap();
    let header = mcap::records::MessageHeader { channel_id, sequence: 0, log_time: 0, publish_time: 0 };
    let start = RecordingStart { format: FORMAT - 1, palpate_version: "0.0.9".into(), ..Default::default() };
    writer.write_to_known_channel(&header, &start.encode_to_vec()).unwrap();
    writer.finish().unwrap();
    let e = Recording::read(&file).err().unwrap().to_string();
    let expected = format!("recorded in format {} by palpate 0.0.9; ", FORMAT - 1);
    assert!(e.contains("old.mcap") && e.contains(&expected) && e.contains(&format!("format {FORMAT}")), "{e}");
}

#[test]
fn a_record_that_claims_more_bytes_than_there_are_gets_no_memory() {
    // A record of a chunk: a byte that tells the kind and eight for its length, here 256 TiB.
    let record = [&[mcap::records::op::MESSAGE][..], &(1u64 << 48).to_le_bytes()].concat();
    // As a frame of LZ4 with one block that is not compressed: magic, flags, largest block, checksum of the two, length, end.
    let mut frame = b"\x04\x22\x4d\x18\x60\x40\x82".to_vec();
    frame.extend((record.len() as u32 | 1 << 31).to_le_bytes());
    frame.extend(&record);
    frame.extend([0; 4]);
    // First and last time, length without compression, no checksum, kind of compression, length with it.
    let mut chunk = [[0; 8], [0; 8], (1u64 << 49).to_le_bytes()].concat();
    chunk.extend([0, 0, 0, 0, 3, 0, 0, 0]);
    chunk.extend(b"lz4");
    chunk.extend((frame.len() as u64).to_le_bytes());
    chunk.extend(&frame);
    let mut bytes = mcap::MAGIC.to_vec();
    bytes.push(mcap::records::op::CHUNK);
    bytes.extend((chunk.len() as u64).to_le_bytes());
    bytes.extend(&chunk);
    let e = Recording::from_bytes(&bytes, "huge.mcap").err().unwrap().to_string();
    assert!(e.contains("huge.mcap") && e.contains(&(1u64 << 48).to_string()), "{e}");
}
