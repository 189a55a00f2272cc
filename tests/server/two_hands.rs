//! Virtual Phantoms in one body over the real network: one that turns, and one of two killed in the middle of its press.

use crate::{Running, serve, serve_cells, serve_with, wait_for};
use palpate::recording::Recording;
use palpate_core::contact::tool::{PoseSample, ToolEvent};
use palpate_core::simulation::{Inputs, Simulation};
use palpate_phantom::{Device, Options, Pattern, Report, Vec3, run};
use palpate_proto::{self as proto, control_request::Request};
use palpate_sdk::{Connection, Endpoints, LinkConditions, WatchOptions};
use std::collections::BTreeMap;
use std::process::{Child, Command, Stdio};
use std::sync::atomic::{AtomicBool, Ordering::Relaxed};

/// Set for the process that is killed: the endpoints of the server.
const VICTIM: &str = "PALPATE_TEST_PHANTOM";
/// Name of the test that this process runs.
const VICTIMS_TEST: &str = "two_hands::a_hand_far_away_presses_the_real_body_within_its_energy_budget";
/// Greatest age of a survivor's pose [ticks] with which its own client counts as awake: on a busy machine poses come in
/// bursts, and the force follows them in steps of its own.
const AWAKE: u32 = 2;

/// A hand that presses in within a second and holds, trembling, `aside` of the middle of the cube's top.
fn trembling(endpoints: &Endpoints, tool: &str, aside: f64) -> Options {
    Options {
        endpoints: endpoints.clone(),
        tool: tool.to_owned(),
        pattern: Pattern::Tremor,
        site: Some((Vec3::new(0.05 + aside, 0.05, 0.1), Vec3::z())),
        echo: false,
        ..Options::default()
    }
}

fn hold(options: &Options) -> Report {
    run(options, &AtomicBool::new(false), &mut |_| ()).unwrap()
}

#[test]
fn a_hand_far_away_presses_the_real_body_within_its_energy_budget() {
    if let Ok(endpoints) = std::env::var(VICTIM) {
        let (force, surface) = endpoints.split_once(' ').unwrap();
        let endpoints =
            Endpoints { force: force.into(), surface: surface.into(), session: "test".into(), identity: None };
        // Until it is killed.
        hold(&Options { seconds: Some(120.0), ..trembling(&endpoints, "left", -0.025) });
        return;
    }
    let running = serve();
    let link = LinkConditions { delay_ns: 10_000_000, jitter_ns: 5_000_000, loss: 0.05 };
    let near = Options { seconds: Some(3.0), samples: 3000, ..trembling(&running.endpoints, "left", -0.025) };
    let far = Options { tool: "right".to_owned(), link, seed: 7, ..near.clone() };
    let (near, far) = (hold(&near), hold(&far));
    println!("{near}\n\n{far}");
    for report in [&near, &far] {
        assert!(report.peak_device_force > 0.1 && report.non_finite_wrenches == 0, "{report}");
        assert!(report.peak_energy <= report.energy_budget, "{report}");
    }
    running.stop();
}

#[test]
fn a_hand_that_turns_a_rough_ball_feels_its_torque_and_its_button_is_recorded() {
    let device = Device::by_name("PHANTOM Premium 1.5 6DOF").unwrap();
    // On a machine that was away the hand may have been let go of.
    let attempt = || {
        let running = serve_with("[[5,5,5]]", "tool=[{name=\"left\", radius=0.02, friction=0.8}]");
        let control = Connection::open(&running.endpoints).unwrap();
        control.control(Request::StartRecording(proto::StartRecording { path: "turn.mcap".into() })).unwrap();
        let options = trembling(&running.endpoints, "left", 0.0);
        let turning = Options { device: device.clone(), pattern: Pattern::Turn, seconds: Some(3.5), ..options };
        let report = hold(&turning);
        control.control(Request::StopRecording(proto::StopRecording {})).unwrap();
        let recording = Recording::read(&running.folder.path().join("turn.mcap")).unwrap();
        drop(control);
        running.stop();
        println!("{report}");
        Some((recording, report)).filter(|(_, report)| report.peak_device_torque > 5e-4)
    };
    let (recording, report) = (0..5).find_map(|_| attempt()).expect("a torque in one of five runs");
    assert!(report.turned > 0.5 && report.peak_device_torque <= device.max_torque, "{report}");
    let poses = recording.inputs.iter().filter_map(|(_, inputs)| match inputs.tools[0] {
        Some(ToolEvent::Pose(sample)) => Some(sample),
        _ => None,
    });
    let turned = |sample: &PoseSample| 2.0 * sample.pose.orientation[2].atan2(sample.pose.orientation[3]);
    let (held, free): (Vec<_>, Vec<_>) = poses.partition(|sample| sample.buttons == 1);
    assert!(held.len() > 500 && free.iter().all(|sample| sample.buttons == 0), "{} with the button", held.len());
    let range = held.iter().map(turned).fold([0.0f64; 2], |[low, high], angle| [low.min(angle), high.max(angle)]);
    assert!(range[0] < -0.4 && range[1] > 0.4, "turned from {} to {} rad", range[0], range[1]);
}

/// The victim, in a process of its own.
struct Victim(Child);

impl Victim {
    fn start(endpoints: &Endpoints) -> Self {
        let mut command = Command::new(std::env::current_exe().unwrap());
        command.args([VICTIMS_TEST, "--exact"]).env(VICTIM, format!("{} {}", endpoints.force, endpoints.surface));
        Self(command.stdout(Stdio::null()).spawn().unwrap())
    }
}

impl Drop for Victim {
    /// SIGKILL: nothing of it gets to say goodbye.
    fn drop(&mut self) {
        self.0.kill().unwrap();
        self.0.wait().unwrap();
    }
}

/// Rendered force of tool `tool` (3) [N] by tick, in the ticks of `span` in which its own client was awake.
fn felt(recording: &Recording, tool: u32, span: std::ops::Range<u64>) -> Vec<(u64, Vec3)> {
    let wrenches = recording.wrenches.range((span.start, 0)..(span.end, 0)).filter(|((_, id), _)| *id == tool);
    let awake = wrenches.filter(|(_, w)| w.pose_age_ticks <= AWAKE && w.phase == proto::ToolPhase::Engaged as i32);
    awake.map(|((tick, _), w)| (*tick, Vec3::from_fn(|i, _| f64::from(w.force[i])))).collect()
}

/// True when a client that touched the body was silent for so long that its tool was held.
fn overslept(recording: &Recording, tool: u32) -> bool {
    let holding = proto::ToolPhase::Holding as i32;
    recording.wrenches.iter().any(|((_, id), w)| *id == tool && w.phase == holding)
}

/// Greatest change [N] from one tick to the next.
fn greatest_change(felt: &[(u64, Vec3)]) -> f64 {
    let changes = felt.windows(2).filter(|pair| pair[1].0 == pair[0].0 + 1).map(|pair| (pair[1].1 - pair[0].1).norm());
    changes.fold(0.0, f64::max)
}

fn mean(felt: &[Vec3]) -> f64 {
    felt.iter().map(|force| force.norm()).sum::<f64>() / felt.len() as f64
}

/// Force of the right tool (3) [N] in every tick of the recording, had there never been a left one.
fn alone(recording: &Recording) -> Vec<(u64, Vec3)> {
    let settings = recording.scene.settings();
    let simulation = Simulation::new(recording.body.clone(), settings, recording.start.clone()).unwrap();
    let mut simulation = simulation.with_reset_state(&recording.reset).unwrap();
    let force = |(tick, inputs): &(u64, Inputs)| {
        let mut inputs = *inputs;
        inputs.tools[0] = None;
        (*tick, simulation.advance(&inputs).tools[1].state.force)
    };
    recording.inputs.iter().map(force).collect()
}

/// Presses with both hands, kills the one, goes on with the other for a second and a half, and reads what was recorded
/// meanwhile. `None` when the one to be killed was silent for so long that its tool was let go of inside of the body: there
/// it waits to come in from outside, which this hand never does.
fn kill_one_of_two(running: &Running) -> Option<(Recording, Report)> {
    let control = Connection::open(&running.endpoints).unwrap();
    let ask = |request| control.control(request).unwrap();
    ask(Request::StartRecording(proto::StartRecording { path: "two.mcap".into() }));
    let taken = || control.session().unwrap().tools[0].taken;
    let mut victim = Some(Victim::start(&running.endpoints));
    wait_for("the victim to take its tool", taken);
    let watch = control.watch_surface(WatchOptions::default()).unwrap();
    let (engaged, waiting) = (proto::ToolPhase::Engaged as i32, proto::ToolPhase::Waiting as i32);
    let its = || watch.latest().and_then(|moment| moment.tools.first().cloned());
    let pressed = || its().is_some_and(|tool| tool.phase == engaged && tool.force[2] > 0.3);
    let let_go = || its().is_some_and(|tool| tool.phase == waiting);

    // Three seconds are enough for this hand to arrive and hold; the other may have had a late start.
    let (stop, mut killed) = (AtomicBool::new(false), None);
    let survivor = trembling(&running.endpoints, "right", 0.025);
    let report = run(&survivor, &stop, &mut |live| match killed {
        None if live.sample.time > 3.0 && pressed() => {
            victim = None;
            killed = Some(live.sample.time);
        }
        None if live.sample.time > 3.0 && let_go() => stop.store(true, Relaxed),
        killed if live.sample.time > killed.map_or(60.0, |at| at + 1.5) => stop.store(true, Relaxed),
        _ => (),
    });
    let seen = its();
    drop(watch);
    if killed.is_none() && seen.as_ref().is_some_and(|tool| tool.phase == waiting) {
        return None;
    }
    assert!(killed.is_some(), "the victim has not pressed within a minute: {seen:?}");
    wait_for("the tool to be free", || !taken());
    ask(Request::StopRecording(proto::StopRecording {}));
    Some((Recording::read(&running.folder.path().join("two.mcap")).unwrap(), report.unwrap()))
}

#[test]
fn when_one_of_two_phantoms_is_killed_the_other_feels_nothing_but_the_tissue() {
    // A machine too busy to keep a client awake takes the survivor's force away as well: that says nothing of the other.
    // Nor does a change of resolution, which such a machine asks for, too: the body has one level.
    let attempt = || {
        let running = serve_cells("[[5,5,5]]");
        let outcome = kill_one_of_two(&running);
        assert_eq!(running.stop().restored_states, 0);
        outcome.filter(|(recording, _)| !overslept(recording, 1))
    };
    let (recording, report) = (0..10).find_map(|_| attempt()).expect("an undisturbed run in ten");
    let is_freed = |inputs: &Inputs| matches!(inputs.tools[0], Some(ToolEvent::Detach));
    let freed = recording.inputs.iter().find(|(_, inputs)| is_freed(inputs)).expect("it is freed").0;

    // It was pressing until its poses stopped, and from the tick in which it is freed it is not there. Should the system
    // be slow to say that its connection is gone, its force is on the ramp of a silent client by then.
    let its: Vec<_> =
        recording.wrenches.iter().filter(|((_, tool), _)| *tool == 0).map(|((tick, _), w)| (*tick, w)).collect();
    assert!(its.iter().all(|(tick, _)| *tick < freed));
    let last = its.iter().rposition(|(_, w)| w.pose_age_ticks == 0).expect("a pose came");
    let (force, contacts) = (its[last].1.force[2], its[last].1.contact_points);
    println!("killed: {force:.4} N, freed {} ticks after its last pose", freed - its[last].0);
    assert!(force > 0.1 && contacts > 0);
    for (_, w) in &its[last..] {
        let left = ((70.0 - w.pose_age_ticks as f32) / 50.0).clamp(0.0, 1.0);
        assert!(w.force[2] <= 1.1 * force * left + 0.02, "{} N, {} ticks old", w.force[2], w.pose_age_ticks);
    }

    // In no tick, before and after, does the force change by more than one step of the device's encoders makes of the
    // stiffest contact that the device renders.
    let device = Device::default();
    let bound = device.max_stiffness * device.resolution;
    let (before, after) = (felt(&recording, 1, 0..freed), felt(&recording, 1, freed - 1..u64::MAX));
    let changes = [&before, &after].map(|felt| greatest_change(felt));
    println!("change in a tick: {:.4} N before, {:.4} N after, {bound:.4} N allowed", changes[0], changes[1]);
    assert!(before.len() > 300 && after.len() > 300, "{} and {} ticks", before.len(), after.len());
    assert!(changes.iter().all(|change| *change > 0.0 && *change <= bound), "{changes:?} N");

    // And soon it is the force of one hand, as if the other had never been there.
    let alone: BTreeMap<u64, Vec3> = alone(&recording).into_iter().collect();
    let late: Vec<_> = after.iter().filter(|(tick, _)| *tick > freed + 1000).collect();
    let now = mean(&late.iter().map(|(_, force)| *force).collect::<Vec<_>>());
    let then = mean(&late.iter().map(|(tick, _)| alone[tick]).collect::<Vec<_>>());
    let held: Vec<Vec3> = before.iter().rev().take(300).map(|(_, force)| *force).collect();
    println!("the other: {:.4} N before, {now:.4} N a second after, {then:.4} N alone", mean(&held));
    assert!(mean(&held) > 0.1 && (now / then - 1.0).abs() < 0.02);
    println!("{report}");
}
