//! Recorded tool trajectories, run again: against force traces, which a change of the physics may move a little, and
//! bit for bit, which nothing may.
//!
//! The trajectories under `tests/trajectories` were recorded from the virtual Phantom in closed loop with the bundled
//! cube (250 poses a second). After a change of the physics that is meant, write the traces and hashes anew with
//! `PALPATE_WRITE_TRACES=1 cargo test --release --test replay`.

use assert_cmd::Command;
use palpate::offline::{self, Trajectory};
use palpate::recording::{FORMAT, Recording, RecordingWriter, replay};
use palpate::scene::LoadedScene;
use palpate_core::model::Body;
use palpate_core::model::element_kernel::Path as KernelPath;
use palpate_core::simulation::{Simulation, Snapshot};
use palpate_proto::keys::topics;
use palpate_proto::{Message, RecordingStart};
use std::collections::BTreeMap;
use std::convert::Infallible;
use std::fmt::Write as _;
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::Arc;

const NAMES: [&str; 5] = ["press", "palpate", "stroke", "tap", "tremor"];
/// Ticks between two points of a force trace.
const TRACE: u64 = 20;

fn folder(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests").join(name)
}

fn writing() -> bool {
    std::env::var_os("PALPATE_WRITE_TRACES").is_some()
}

fn trajectory(name: &str) -> Trajectory {
    let file = folder("trajectories").join(format!("{name}.csv"));
    Trajectory::parse(&fs::read_to_string(&file).unwrap(), &file.display().to_string(), 1).unwrap()
}

struct Cube {
    loaded: LoadedScene,
    body: Arc<Body>,
    start: Snapshot,
}

/// The bundled cube with its middle level moving, come to rest under gravity.
fn cube() -> Cube {
    cube_with(&["body.active_level=1"])
}

/// The same with all its levels, between which it adapts itself.
fn adaptive_cube() -> Cube {
    cube_with(&[])
}

fn cube_with(overrides: &[&str]) -> Cube {
    let overrides: Vec<String> = overrides.iter().map(|s| (*s).to_owned()).collect();
    let loaded = LoadedScene::load(Path::new("cube"), &overrides).unwrap();
    let body = Arc::new(loaded.build(&mut |_, _, _| {}).unwrap());
    let start = loaded.scene.settled(&body, &mut |_, _, _| {});
    Cube { loaded, body, start }
}

impl Cube {
    fn simulation(&self, path: KernelPath) -> Simulation {
        Simulation::new(self.body.clone(), self.loaded.scene.settings(), self.start.clone()).unwrap().with_path(path)
    }

    /// Force on the tool along z [N] every [`TRACE`] ticks, every frame's hash, and the final hash.
    fn run(&self, path: KernelPath, trajectory: &Trajectory) -> (Vec<f64>, Vec<u64>, u64) {
        let mut simulation = self.simulation(path);
        let (mut forces, mut hashes) = (Vec::new(), Vec::new());
        offline::run(&mut simulation, trajectory, trajectory.last_tick(), |_, outputs| {
            if outputs.tick.is_multiple_of(TRACE) {
                forces.push(outputs.tools[0].state.physical_force.z);
            }
            if outputs.frame {
                hashes.push(outputs.hash);
            }
            Ok::<(), Infallible>(())
        })
        .unwrap();
        (forces, hashes, simulation.hash())
    }

    /// Records the trajectory into `file`.
    fn record(&self, trajectory: &Trajectory, file: &Path) -> u64 {
        let mut simulation = self.simulation(KernelPath::best());
        let scene = &self.loaded.scene;
        let mut writer = RecordingWriter::create(file, scene, &self.body, &self.start, &self.start.body).unwrap();
        offline::run(&mut simulation, trajectory, trajectory.last_tick(), |_, o| {
            let inputs = trajectory.inputs(o.tick);
            writer.tick(o.tick, &inputs, &o.tools, o.flags(), o.frame.then_some(o.hash))?;
            if o.frame {
                let tools: Vec<_> = o.tools.iter().map(|t| t.state).collect();
                writer.frame(o.tick, &o.skin, &o.levels, &tools)?;
            }
            Ok::<(), palpate::recording::RecordingError>(())
        })
        .unwrap();
        writer.finish().unwrap().ticks
    }
}

#[test]
fn recorded_trajectories_give_their_forces_and_their_bits_again() {
    let hash_file = folder("regressions").join("hashes.txt");
    let mut hashes = String::new();
    let known = fs::read_to_string(&hash_file).unwrap_or_default();
    for (kind, cube) in [("", cube()), ("adaptive.", adaptive_cube())] {
        for name in NAMES {
            let trajectory = trajectory(name);
            let (forces, frames, hash) = cube.run(KernelPath::best(), &trajectory);
            writeln!(hashes, "{kind}{name} {hash:016x}").unwrap();
            let trace_file = folder("trajectories").join(format!("{name}.{kind}force.csv"));
            if writing() {
                let mut out = csv::Writer::from_path(&trace_file).unwrap();
                out.write_record(["tick", "force_z_N"]).unwrap();
                for (i, f) in forces.iter().enumerate() {
                    out.write_record([((i as u64 + 1) * TRACE).to_string(), format!("{f:.6}")]).unwrap();
                }
                out.flush().unwrap();
            }
            let trace: Vec<(u64, f64)> =
                csv::Reader::from_path(&trace_file).unwrap().into_deserialize().map(Result::unwrap).collect();
            let trace: Vec<f64> = trace.into_iter().map(|(_, force)| force).collect();
            assert_eq!(trace.len(), forces.len(), "{kind}{name}");
            let peak = trace.iter().copied().fold(0.0, f64::max);
            assert!(peak > 0.05, "{kind}{name} touches: {peak} N");
            let worst = trace.iter().zip(&forces).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
            println!("{kind}{name}: peak {peak:.3} N, largest difference from the trace {worst:.6} N");
            assert!(worst <= 0.03 * peak + 0.002, "{kind}{name}: {worst} N of {peak} N");

            // The other forms of the kernel give the same bits at every frame.
            for path in KernelPath::available() {
                let again = cube.run(path, &trajectory);
                assert_eq!(again, (forces.clone(), frames.clone(), hash), "{kind}{name} on {path:?}");
            }
        }
    }
    if writing() {
        fs::create_dir_all(folder("regressions")).unwrap();
        fs::write(&hash_file, &hashes).unwrap();
        return;
    }
    // Written by an optimised build; this one may have another profile.
    assert_eq!(hashes, known, "the bits have changed: see the head of this file");
}

#[test]
fn a_recording_replays_identical_in_the_library_and_on_the_command_line() {
    let cube = adaptive_cube();
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("tap.mcap");
    let ticks = cube.record(&trajectory("tap"), &file);
    let recording = Recording::read(&file).unwrap();
    for path in KernelPath::available() {
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
    // The trajectory that comes out is the one that went in, one tick (the attaching) later.
    let text = fs::read_to_string(&again).unwrap();
    let (before, after) = (trajectory("tap"), Trajectory::parse(&text, "again", 1).unwrap());
    assert_eq!(after.last_tick(), before.last_tick() + 1);
}

#[test]
fn a_changed_input_is_found_with_its_tick_and_its_size() {
    let cube = cube();
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("press.mcap");
    cube.record(&trajectory("press"), &file);
    let mut recording = Recording::read(&file).unwrap();
    let (_, inputs) = recording.inputs.iter_mut().find(|(tick, i)| *tick > 1400 && i.tools[0].is_some()).unwrap();
    let Some(palpate_core::contact::tool::ToolEvent::Pose(pose)) = &mut inputs.tools[0] else { panic!("a pose") };
    pose.pose.position.z += 1e-4;
    let changed = pose.sequence;
    let report = replay(&recording, KernelPath::best()).unwrap();
    let difference = report.difference.unwrap();
    println!("{changed}: {difference:?}");
    // While it presses: the force is another, too.
    assert!((1400..1410).contains(&difference.tick), "{difference:?}");
    assert!(difference.what.contains("pose by") && difference.what.contains("force by"), "{difference:?}");
    assert!(!difference.what.contains("physical force by 0e0"), "{difference:?}");
}

#[test]
fn a_recording_cut_short_replays_up_to_the_cut() {
    let cube = cube();
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("stroke.mcap");
    let ticks = cube.record(&trajectory("stroke"), &file);
    let bytes = fs::read(&file).unwrap();
    for percent in [97, 70, 50] {
        let cut = folder.path().join(format!("cut{percent}.mcap"));
        fs::write(&cut, &bytes[..bytes.len() * percent / 100]).unwrap();
        let recording = Recording::read(&cut).unwrap();
        let report = replay(&recording, KernelPath::best()).unwrap();
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
