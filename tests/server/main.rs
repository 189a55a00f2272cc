//! The server over real zenoh sessions on loopback: what a client sees, and what it may do to the server.

#[cfg(unix)]
mod c_client;
mod parameters;
#[path = "../common/ports.rs"]
mod ports;
#[path = "../common/stranger.rs"]
mod stranger;
mod two_hands;
mod viewers;

use palpate::recording::{Recording, replay};
use palpate::scene::LoadedScene;
use palpate::server::{Options, Server};
use palpate_core::model::element_kernel::Simd;
use palpate_proto::{self as proto, Message, WrenchFlag, control_request::Request, keys};
use palpate_sdk::{Attachment, Connection, Endpoints, PoseSample, SdkError, Tool, ToolPhase, WatchOptions, Wrench};
use std::path::Path;
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};
use stranger::stranger;
use viewers::Viewer;
use zenoh::Wait;

/// `tool` for `client`, held rigidly.
fn rigid(client: &str, tool: &str, rate_hz: f64) -> Attachment {
    Attachment { client: client.to_owned(), tool: tool.to_owned(), rate_hz, ..Attachment::default() }
}

/// Two ports that nobody listens on.
fn free_endpoints() -> (String, String) {
    (ports::free_endpoint(), ports::free_endpoint())
}

struct Running {
    runtime: tokio::runtime::Runtime,
    server: Option<Server>,
    endpoints: Endpoints,
    folder: tempfile::TempDir,
}

/// A small cube that adapts its resolution, clamped at the bottom, with two ball tools.
fn serve() -> Running {
    serve_cells("[[3,3,3],[5,5,5]]")
}

/// A server of a cube of one level: what it answers does not depend on what the machine affords.
fn serve_one_level() -> Running {
    serve_cells("[[5,5,5]]")
}

/// A server of a cube that has levels of these cells.
fn serve_cells(cells: &str) -> Running {
    serve_with(cells, "tool=[{name=\"left\", radius=0.02}, {name=\"right\", radius=0.02}]")
}

/// With this key set as well.
fn serve_with(cells: &str, key: &str) -> Running {
    let given = [format!("body.cells={cells}"), "world.gravity=[0,0,0]".to_owned(), key.to_owned()];
    let loaded = LoadedScene::load(Path::new("cube"), &given).unwrap();
    let body = Arc::new(loaded.build(&mut |_, _, _| {}).unwrap());
    let start = loaded.scene.at_rest(&body);
    let (force, surface) = free_endpoints();
    let folder = tempfile::tempdir().unwrap();
    let options = Options {
        session: "test".into(),
        force_endpoint: force.clone(),
        surface_endpoint: surface.clone(),
        recordings: folder.path().to_owned(),
        ..Options::default()
    };
    let runtime = tokio::runtime::Builder::new_multi_thread().enable_all().worker_threads(2).build().unwrap();
    let server = runtime.block_on(Server::start(loaded.scene, body, start, options)).unwrap();
    Running {
        runtime,
        server: Some(server),
        endpoints: Endpoints { force, surface, session: "test".into(), identity: None },
        folder,
    }
}

impl Running {
    fn status(&self) -> proto::Status {
        self.server.as_ref().unwrap().live().borrow().clone()
    }

    fn stop(mut self) -> proto::Status {
        self.runtime.block_on(self.server.take().unwrap().stop())
    }

    fn refused(&self, reason: &str) -> u64 {
        self.status().refused.iter().find(|r| r.reason == reason).map_or(0, |r| r.count)
    }
}

/// Looks every millisecond; a minute is long enough for a machine on which much else runs.
fn wait_for(what: &str, mut done: impl FnMut() -> bool) {
    let began = Instant::now();
    while !done() {
        assert!(began.elapsed() < Duration::from_secs(60), "waited in vain: {what}");
        std::thread::sleep(Duration::from_millis(1));
    }
}

/// Above the middle of the cube's top, the ball `height` [m] above touching it.
fn above(height: f64) -> PoseSample {
    PoseSample {
        position: [0.05, 0.05, 0.12 + height],
        orientation: [0.0, 0.0, 0.0, 1.0],
        linear_velocity: None,
        buttons: 0,
        opening: 0.0,
    }
}

/// Sends poses every millisecond for `milliseconds`, the height going from `from` to `to`.
fn move_tool(tool: &mut Tool, from: f64, to: f64, milliseconds: u32) {
    let mut next = Instant::now();
    for i in 1..=milliseconds {
        tool.send_pose(above(from + (to - from) * f64::from(i) / f64::from(milliseconds))).unwrap();
        next += Duration::from_millis(1);
        std::thread::sleep(next.saturating_duration_since(Instant::now()));
    }
}

/// Sends the pose at `height` until `done` likes the newest wrench; gives that wrench. On a busy machine poses may come
/// so late that the tool is held for a while: what a test says of a touch is said of a wrench that it has waited for.
fn send_until(tool: &mut Tool, height: f64, what: &str, mut done: impl FnMut(&Wrench) -> bool) -> Wrench {
    let mut found = None;
    wait_for(what, || {
        tool.send_pose(above(height)).unwrap();
        found = tool.latest_wrench().map(|received| received.wrench).filter(&mut done);
        found.is_some()
    });
    found.unwrap_or_else(|| unreachable!("waited for"))
}

/// Holds the tool at `height` until nothing has come between it and the body for `ticks`; the last wrench. Where the machine
/// was away for so long that the tool has to come from outside again, it does.
fn hold(tool: &mut Tool, height: f64, ticks: u64) -> Wrench {
    let (mut since, mut found, mut waits) = (None, None, false);
    wait_for("an undisturbed hold", || {
        tool.send_pose(above(if waits { 0.02 } else { height })).unwrap();
        let Some(wrench) = tool.latest_wrench().map(|received| received.wrench) else { return false };
        waits = wrench.phase == ToolPhase::Waiting;
        let disturbed = wrench.phase != ToolPhase::Engaged || wrench.flags & WrenchFlag::Ramping as u32 != 0;
        since = if disturbed { None } else { Some(since.unwrap_or(wrench.tick)) };
        found = since.is_some_and(|since| wrench.tick >= since + ticks).then_some(wrench);
        found.is_some()
    });
    found.unwrap_or_else(|| unreachable!("waited for"))
}

#[test]
fn a_client_finds_the_session_presses_and_is_answered_every_tick() {
    let running = serve_one_level();
    let connection = Connection::open(&running.endpoints).unwrap();
    let session = connection.session().unwrap();
    assert_eq!((session.version_major, session.ticks_per_frame), (proto::VERSION_MAJOR, 32));
    assert_eq!(session.tools.len(), 2);
    assert!((session.body.as_ref().unwrap().mass_kg - 1.0).abs() < 1e-9);
    let surface = connection.surface_topology().unwrap();
    assert!(!surface.triangles.is_empty());
    let viewer = Viewer::watch(&connection, WatchOptions::default());

    let mut tool = connection.attach(&rigid("test", "left", 1000.0)).unwrap();
    assert!(connection.session().unwrap().tools[0].taken);
    move_tool(&mut tool, 0.02, 0.02, 50);
    move_tool(&mut tool, 0.02, -0.008, 300);
    let pressed = hold(&mut tool, -0.008, 700);
    assert!(pressed.force[2] > 0.1 && pressed.force[2] < 3.3, "{pressed:?}");
    let counters = tool.counters();
    // About a thousand ticks have passed; on a busy machine some are late or superseded.
    assert!(counters.received > 700, "{counters:?}");
    assert_eq!(counters.undecodable, 0);

    send_until(&mut tool, -0.008, "twenty moments", |_| viewer.seen().len() > 20);
    let moments = viewer.stop();
    for pair in moments.windows(2) {
        assert!(pair[1].tick > pair[0].tick && pair[1].tick.is_multiple_of(32));
    }
    let last = &moments.last().unwrap().positions;
    assert_eq!(last.len(), surface.rest_positions.len());
    let dent = last.iter().zip(&surface.rest_positions).map(|(now, rest)| rest[2] - now[2]).fold(0.0, f32::max);
    assert!(dent > 0.002, "the surface shows the dent: {dent}");

    tool.detach().unwrap();
    wait_for("the tool to be free", || !connection.session().unwrap().tools[0].taken);
    let status = running.stop();
    assert!(status.tick > 1000 && status.restored_states == 0, "{status:?}");
}

#[test]
fn tools_have_one_holder_and_requests_that_make_no_sense_are_answered() {
    let running = serve();
    let connection = Connection::open(&running.endpoints).unwrap();
    let refused = |outcome: Result<Tool, SdkError>| match outcome {
        Err(e) => e.to_string(),
        Ok(_) => panic!("attached"),
    };
    let left = connection.attach(&rigid("first", "left", 1000.0)).unwrap();
    assert!(refused(connection.attach(&rigid("second", "left", 1000.0))).contains("held by first"));
    assert!(refused(connection.attach(&rigid("second", "scalpel", 1000.0))).contains("left, right"));
    assert!(refused(connection.attach(&rigid("second", "", 0.5))).contains("rate_hz"));
    let soft = Attachment { coupling_angular_stiffness: 1e-3, ..rigid("second", "", 1000.0) };
    assert!(refused(connection.attach(&soft)).contains("coupling_angular_stiffness is 0.001 N·m/rad"));
    let right = connection.attach(&rigid("second", "", 80.0)).unwrap();
    assert_eq!((left.id(), right.id()), (0, 1));
    assert!(refused(connection.attach(&rigid("third", "", 1000.0))).contains("every tool is taken"));
    let outside = proto::StartRecording { path: "../elsewhere.mcap".into() };
    let e = connection.control(Request::StartRecording(outside));
    assert!(e.unwrap_err().to_string().contains("below the server's recordings folder"));
    let e = connection.control(Request::StopRecording(proto::StopRecording {}));
    assert!(e.unwrap_err().to_string().contains("no recording"));
    running.stop();
}

#[test]
fn garbage_bad_poses_and_floods_are_refused_and_counted_while_the_clock_goes_on() {
    let running = serve();
    let connection = Connection::open(&running.endpoints).unwrap();
    let mut tool = connection.attach(&rigid("test", "left", 1000.0)).unwrap();
    move_tool(&mut tool, 0.02, 0.02, 30);
    // A client that is not careful.
    let stranger = stranger(&running.endpoints.force);
    let attach =
        proto::Attach { client: "careless".into(), tool: "right".into(), rate_hz: 1000.0, ..Default::default() };
    let attached = connection.control(Request::Attach(attach)).unwrap();
    let attached = attached.attached.unwrap();
    assert_eq!(attached.tool, 1);
    let good = proto::ToolPose {
        epoch: attached.epoch,
        secret: attached.secret,
        sequence: 1_000_000,
        position: vec![0.05, 0.05, 0.14],
        orientation: vec![0.0, 0.0, 0.0, 1.0],
        ..Default::default()
    };
    let send = |tool: u32, bytes: Vec<u8>| stranger.put(keys::tool_pose("test", tool), bytes).wait().unwrap();
    let changed = |change: &dyn Fn(&mut proto::ToolPose)| {
        let mut pose = good.clone();
        change(&mut pose);
        pose.encode_to_vec()
    };
    send(1, good.encode_to_vec());
    send(1, b"\xff\xfe garbage".to_vec());
    send(1, vec![0xff; 60_000]);
    send(99, good.encode_to_vec());
    send(1, changed(&|p| p.epoch ^= 1));
    send(1, changed(&|p| p.position[0] = f32::NAN));
    send(1, changed(&|p| p.orientation = vec![0.0; 4]));
    send(1, changed(&|p| p.position = vec![90.0, 0.0, 0.0]));
    send(1, changed(&|p| p.sequence = 0));
    for (reason, least) in [
        ("malformed", 2),
        ("unknown tool", 1),
        ("wrong epoch", 1),
        ("not finite", 1),
        ("bad orientation", 1),
        ("out of range", 1),
        ("stale", 1),
    ] {
        wait_for(reason, || running.refused(reason) >= least);
    }
    let before = running.status().tick;
    let malformed = running.refused("malformed");
    for _ in 0..20_000 {
        send(0, b"\xff\xfe garbage".to_vec());
    }
    wait_for("the flood to be counted", || running.refused("malformed") > malformed + 1000);
    wait_for("the clock to go on", || running.status().tick > before + 200);
    let wrench = hold(&mut tool, 0.02, 50);
    assert_eq!(wrench.force, [0.0; 3]);
    let status = running.stop();
    assert_eq!(status.restored_states, 0);
}

#[test]
fn a_jump_of_a_metre_is_followed_at_the_speed_limit_and_within_the_force_limit() {
    let running = serve();
    let connection = Connection::open(&running.endpoints).unwrap();
    let wrenches = Arc::new(Mutex::new(Vec::new()));
    let observed = wrenches.clone();
    let observer = move |wrench: &Wrench, _| observed.lock().unwrap().push(*wrench);
    let mut tool = connection.attach_observed(&rigid("test", "left", 1000.0), observer).unwrap();
    hold(&mut tool, 0.3, 50);
    // Straight through the body to below it: 0.7 m at once, then held there until it would be through.
    let mut sent = 0;
    send_until(&mut tool, -0.4, "it to go through", |_| {
        sent += 1;
        sent > 600 && wrenches.lock().unwrap().iter().any(|w| w.force[2] > 0.0)
    });
    // A tool whose poses have not come for a while is nobody's, for a tick at least, and begins where the next one is.
    let wrenches = wrenches.lock().unwrap();
    let follows = |pair: &&[Wrench]| {
        pair[1].tick == pair[0].tick + 1 && pair.iter().all(|wrench| wrench.phase != ToolPhase::Detached)
    };
    let steps: Vec<f64> =
        wrenches.windows(2).filter(follows).map(|p| (p[1].position[2] - p[0].position[2]).abs()).collect();
    assert!(steps.len() > 300, "{} wrenches of ticks in a row", steps.len());
    let fastest = steps.iter().copied().fold(0.0, f64::max);
    assert!(fastest > 0.9e-3 && fastest <= 1.01e-3, "{fastest} m in a tick");
    let worst = wrenches.iter().map(|w| w.force.iter().map(|c| c * c).sum::<f64>().sqrt()).fold(0.0, f64::max);
    println!("peak force {worst} N");
    assert!(worst > 0.0 && worst <= 3.3 + 1e-5, "{worst}");
    assert_eq!(running.stop().restored_states, 0);
}

#[test]
fn a_silent_client_feels_its_force_fade_and_loses_contact() {
    let running = serve();
    let connection = Connection::open(&running.endpoints).unwrap();
    let wrenches = Arc::new(Mutex::new(Vec::new()));
    let observed = wrenches.clone();
    let observer = move |wrench: &Wrench, _| observed.lock().unwrap().push(*wrench);
    let mut tool = connection.attach_observed(&rigid("test", "left", 1000.0), observer).unwrap();
    move_tool(&mut tool, 0.02, 0.02, 50);
    move_tool(&mut tool, 0.02, -0.008, 300);
    let pressed = hold(&mut tool, -0.008, 200);
    assert!(pressed.force[2] > 0.1);
    // Silence. The wrenches go on and say so.
    wait_for("the contact to end", || tool.latest_wrench().unwrap().wrench.phase == ToolPhase::Detached);
    let last = tool.latest_wrench().unwrap().wrench;
    let wrenches = wrenches.lock().unwrap();
    let silent = wrenches.iter().filter(|w| w.tick > pressed.tick);
    let ages: Vec<_> = silent.map(|w| (w.pose_age_ticks, w.force[2], w.phase)).collect();
    for (age, force, phase) in &ages {
        // One newton per millisecond of slew may stand between the ramp and the force.
        let left = (70.0 - f64::from(*age)) / 50.0;
        assert!(*force <= pressed.force[2] * left.clamp(0.0, 1.0) * 1.1 + 0.02, "{age}: {force}");
        assert!(*age <= 20 || *phase != ToolPhase::Engaged, "{age} {phase:?}");
    }
    assert!(ages.iter().any(|a| a.2 == ToolPhase::Holding), "{ages:?}");
    assert_eq!((last.phase, last.force), (ToolPhase::Detached, [0.0; 3]));
    running.stop();
}

/// Set for the process that the next test kills: the endpoints of that test's server.
const VICTIM: &str = "PALPATE_TEST_VICTIM";

#[test]
fn a_press_that_is_held_keeps_its_force() {
    let (running, endpoints, ticks) = match std::env::var(VICTIM) {
        Ok(endpoints) => {
            let (force, surface) = endpoints.split_once(' ').unwrap();
            let endpoints =
                Endpoints { force: force.into(), surface: surface.into(), session: "test".into(), identity: None };
            (None, endpoints, 20_000)
        }
        Err(_) => {
            let running = serve_one_level();
            let endpoints = running.endpoints.clone();
            (Some(running), endpoints, 1_000)
        }
    };
    let connection = Connection::open(&endpoints).unwrap();
    let mut tool = connection.attach(&rigid("victim", "left", 1000.0)).unwrap();
    move_tool(&mut tool, 0.02, 0.02, 50);
    move_tool(&mut tool, 0.02, -0.008, 300);
    let early = hold(&mut tool, -0.008, 300).force[2];
    let wrench = hold(&mut tool, -0.008, ticks);
    let late = wrench.force[2];
    // A hand far away is told how it goes on from here.
    let model = wrench.model.expect("a local model comes within a second of contact");
    assert_eq!((model.position, model.force), (wrench.position, wrench.force));
    assert!(model.normal[2] > 0.9 && model.stiffness[2][2] > 20.0 && model.range > 0.0, "{model:?}");
    println!("{early} N, then {late} N");
    assert!(early > 0.1 && (late / early - 1.0).abs() < 0.1);
    if let Some(running) = running {
        running.stop();
    }
}

#[test]
fn a_client_killed_mid_press_frees_its_tool() {
    let running = serve();
    let mut victim = std::process::Command::new(std::env::current_exe().unwrap())
        .args(["a_press_that_is_held_keeps_its_force", "--exact"])
        .env(VICTIM, format!("{} {}", running.endpoints.force, running.endpoints.surface))
        .stdout(std::process::Stdio::null())
        .spawn()
        .unwrap();
    let other = Connection::open(&running.endpoints).unwrap();
    wait_for("the victim to take its tool", || other.session().unwrap().tools[0].taken);
    std::thread::sleep(Duration::from_millis(600));
    victim.kill().unwrap();
    victim.wait().unwrap();
    let killed = Instant::now();
    wait_for("the tool to be free", || !other.session().unwrap().tools[0].taken);
    println!("freed {:?} after the kill", killed.elapsed());
    let before = running.status().tick;
    let mut again = other.attach(&rigid("next", "left", 1000.0)).unwrap();
    // Inside the body: no force until it has been outside.
    let mut since = None;
    let wrench = send_until(&mut again, -0.03, "60 ticks inside", |wrench| {
        assert!(matches!(wrench.phase, ToolPhase::Waiting | ToolPhase::Detached) && wrench.force == [0.0; 3]);
        wrench.tick > *since.get_or_insert(wrench.tick) + 60 && wrench.phase == ToolPhase::Waiting
    });
    assert_eq!(wrench.force, [0.0; 3]);
    send_until(&mut again, 0.03, "contact", |wrench| wrench.phase == ToolPhase::Engaged);
    wait_for("the clock to go on", || running.status().tick > before + 100);
    assert_eq!(running.stop().restored_states, 0);
}

#[test]
fn a_headset_at_72_hz_presses_smoothly() {
    let running = serve();
    let connection = Connection::open(&running.endpoints).unwrap();
    // A machine too busy to keep the headset's clock says nothing of the server.
    let mut attempts = std::iter::repeat_with(|| headset(&connection)).take(10);
    let (steps, _) = attempts.find(|(_, latest)| *latest < 5e-3).expect("an undisturbed press in ten");
    // 28 mm in a second: between samples the tool moves on, a little each tick, instead of 0.39 mm at every 14th.
    let largest = steps.iter().copied().fold(0.0, f64::max);
    let moving = steps.iter().filter(|s| **s > 1e-6).count();
    println!("largest step {largest} m, moving in {moving} of {}", steps.len());
    assert!(largest < 1.5e-4, "{largest}");
    assert!(moving * 10 > steps.len() * 7);
    running.stop();
}

/// Presses for a second at 72 Hz: how far the tool went in each tick that was seen [m], and how late the latest pose was
/// [s].
fn headset(connection: &Connection) -> (Vec<f64>, f64) {
    let mut tool = connection.attach(&rigid("headset", "left", 72.0)).unwrap();
    let (mut steps, mut latest) = (Vec::new(), 0.0f64);
    let mut last: Option<(u64, f64)> = None;
    let began = Instant::now();
    for i in 0..72 {
        let t = f64::from(i) / 72.0;
        latest = latest.max(began.elapsed().as_secs_f64() - t);
        tool.send_pose(above(0.02 - 0.028 * t)).unwrap();
        while began.elapsed().as_secs_f64() < f64::from(i + 1) / 72.0 {
            let fresh = tool.latest_wrench().filter(|r| r.fresh).map(|r| r.wrench);
            if let Some(w) = fresh.filter(|w| w.phase == ToolPhase::Engaged) {
                if let Some((tick, z)) = last {
                    steps.push((w.position[2] - z).abs() / (w.tick - tick).max(1) as f64);
                }
                last = Some((w.tick, w.position[2]));
            }
            std::thread::sleep(Duration::from_micros(500));
        }
    }
    tool.detach().unwrap();
    (steps, latest)
}

#[test]
fn a_recording_of_a_live_session_replays_bit_for_bit() {
    let running = serve();
    let connection = Connection::open(&running.endpoints).unwrap();
    let mut tool = connection.attach(&rigid("test", "left", 1000.0)).unwrap();
    move_tool(&mut tool, 0.02, 0.02, 30);
    let ask = |request| connection.control(request).unwrap();
    ask(Request::StartRecording(proto::StartRecording { path: "press.mcap".into() }));
    move_tool(&mut tool, 0.02, -0.01, 300);
    ask(Request::Reset(proto::ResetBody {}));
    move_tool(&mut tool, -0.01, 0.02, 200);
    move_tool(&mut tool, 0.02, -0.01, 200);
    // What is counted below is there however busy the machine is.
    hold(&mut tool, -0.01, 600);
    let done = ask(Request::StopRecording(proto::StopRecording {})).recording.unwrap();
    assert!(done.fault.is_empty() && done.ticks > 600, "{done:?}");
    let file = running.folder.path().join("press.mcap");
    let recording = Recording::read(&file).unwrap();
    assert!(recording.cut.is_none());
    assert!(recording.frames.len() > 15 && recording.wrenches.len() > 600);
    assert!(recording.inputs.iter().any(|(_, inputs)| inputs.reset));
    let pressed = recording.wrenches.values().filter(|w| w.contact_points > 0).count();
    assert!(pressed > 100, "{pressed}");
    for path in Simd::available() {
        let report = replay(&recording, path).unwrap();
        println!("{path:?}: {}", report.verdict());
        assert_eq!(report.difference, None);
        assert_eq!(report.ticks, done.ticks);
    }
    running.stop();
}

#[test]
fn a_taken_port_is_named() {
    let running = serve();
    let given = ["body.cells=[[2,2,2]]", "world.settle=0"].map(String::from);
    let loaded = LoadedScene::load(Path::new("cube"), &given).unwrap();
    let body = Arc::new(loaded.build(&mut |_, _, _| {}).unwrap());
    let start = loaded.scene.at_rest(&body);
    let options = Options { force_endpoint: running.endpoints.force.clone(), ..Options::default() };
    let outcome = running.runtime.block_on(Server::start(loaded.scene, body, start, options));
    let e = outcome.err().unwrap().to_string();
    assert!(e.contains(&running.endpoints.force) && e.contains("--force-endpoint"), "{e}");
    running.stop();
}
