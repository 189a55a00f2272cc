//! Every fault, one after the other, on one server with two hands, four viewers and a recorder: what each costs, as a table.
//!
//! A round takes a minute; `PALPATE_MINUTES=10` repeats it for ten, and `PALPATE_FAULT=road` those faults alone that are called so.
//! The clients reach the server over a road of a network of its
//! own, where the system grants one.
//! A program of its own, as it takes the machine from whatever runs beside it.
#![cfg(target_os = "linux")] // signals, and the server itself

#[path = "../common/hand.rs"]
mod hand;
#[path = "../common/random.rs"]
mod random;
#[path = "../common/roads.rs"]
mod roads;
#[path = "../common/served.rs"]
mod served;
#[path = "../common/stranger.rs"]
mod stranger;

use hand::{Hand, INSIDE, OUTSIDE, TOOLS};
use palpate_proto::{self as proto, Message, control_request::Request, keys};
use palpate_sdk::{Connection, Endpoints, SurfaceWatch, WatchOptions, Wrench};
use roads::{Road, Roads};
use served::{Served, replayed};
use std::fmt::Write as _;
use std::net::TcpStream;
use std::process::{Command, Stdio};
use std::sync::atomic::{AtomicBool, Ordering::Relaxed};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};
use stranger::{SESSION, asker, asks, forged, stranger};
use zenoh::Wait;

const PROGRAM: &str = env!("CARGO_BIN_EXE_palpate");
/// As long as a hand may take to feel the body again after a fault has ended [s]: it finds its connections gone, opens them
/// again, attaches, and comes from outside, on a machine on which much else runs.
const LONGEST: Duration = Duration::from_secs(30);
/// The slew limit of the rendered force [N a tick]: `safety.force_slew`.
const SLEW: f64 = 1.0;
/// What the server may take more after a fault [MB]: what waits for slow readers is bounded.
const MOST_MORE: f64 = 100.0;
/// What it may take more from the end of the first round to the end of the last [MB], whatever their number.
const MOST_GROWTH: f64 = 10.0;

/// What a hand has seen since it was asked last.
#[derive(Default)]
struct Seen {
    /// When it felt the body last.
    felt: Option<Instant>,
    last: Option<Wrench>,
    lost: u64,
    /// Largest change of the rendered force from one tick to the next [N].
    step: f64,
}

impl Seen {
    fn take(&mut self, wrench: Wrench) {
        if let Some(last) = self.last {
            self.lost += wrench.sequence.saturating_sub(last.sequence).saturating_sub(1);
            if wrench.tick == last.tick + 1 {
                let change = (0..3).map(|axis| (wrench.force[axis] - last.force[axis]).powi(2)).sum::<f64>().sqrt();
                self.step = self.step.max(change);
            }
        }
        self.last = Some(wrench);
    }
}

/// A hand that presses for 1.4 s and leaves for 0.6 s, until it is told to stop, whatever happens to its tool.
fn pressing(mut hand: Hand, stop: Arc<AtomicBool>) -> (Arc<Mutex<Seen>>, std::thread::JoinHandle<()>) {
    let seen = Arc::new(Mutex::new(Seen::default()));
    let told = seen.clone();
    let thread = std::thread::spawn(move || {
        let began = Instant::now();
        while !stop.load(Relaxed) {
            let inside = began.elapsed().as_millis() % 2000 < 1400;
            let felt = hand.step(if inside { INSIDE } else { OUTSIDE });
            let mut seen = told.lock().unwrap();
            hand.take_wrenches().into_iter().for_each(|wrench| seen.take(wrench));
            if felt.is_some_and(|(wrench, force)| wrench.contact_points > 0 && force > 0.1) {
                seen.felt = Some(Instant::now());
            }
        }
    });
    (seen, thread)
}

/// The server and everybody around it.
struct Stage {
    served: Served,
    roads: Option<Roads>,
    hands: [Arc<Mutex<Seen>>; 2],
    connection: Connection,
    viewers: Vec<SurfaceWatch>,
    /// The newest status, and when it came.
    status: Arc<Mutex<Option<(Instant, proto::Status)>>>,
}

impl Stage {
    fn watch(&self) -> SurfaceWatch {
        connected(&self.served).watch_surface(WatchOptions::default()).unwrap()
    }

    /// A status that comes from now on.
    fn status(&self) -> proto::Status {
        let now = Instant::now();
        self.until("a status", || {
            let status = self.status.lock().unwrap();
            status.as_ref().filter(|(came, _)| *came > now).map(|(_, status)| status.clone())
        })
    }

    fn until<T>(&self, what: &str, mut ready: impl FnMut() -> Option<T>) -> T {
        let began = Instant::now();
        loop {
            if let Some(value) = ready() {
                return value;
            }
            assert!(began.elapsed() < LONGEST, "waited in vain: {what}");
            std::thread::sleep(Duration::from_millis(5));
        }
    }

    /// Waits until both hands feel the body, every viewer has a new frame, and the server tells its status; how long that took,
    /// and the status.
    fn recovered(&self) -> (Duration, proto::Status) {
        let began = Instant::now();
        let frames: Vec<u64> = self.viewers.iter().map(|viewer| viewer.counters().frames).collect();
        self.until("hands that feel, and viewers that see", || {
            let feel = self.hands.iter().all(|hand| hand.lock().unwrap().felt.is_some_and(|felt| felt > began));
            let see = self.viewers.iter().zip(&frames).all(|(viewer, before)| viewer.counters().frames > *before);
            (feel && see).then_some(())
        });
        (began.elapsed(), self.status())
    }

    /// Memory that the server takes [MB].
    fn memory(&self) -> f64 {
        let status = std::fs::read_to_string(format!("/proc/{}/status", self.served.id())).unwrap();
        let line = status.lines().find(|line| line.starts_with("VmRSS:")).unwrap();
        line.split_whitespace().nth(1).unwrap().parse::<f64>().unwrap() / 1000.0
    }

    /// For `time`, again and again.
    fn keep(time: Duration, mut act: impl FnMut()) {
        let began = Instant::now();
        while began.elapsed() < time {
            act();
            std::thread::sleep(Duration::from_millis(1));
        }
    }

    fn strangers(&self) -> [zenoh::Session; 2] {
        [stranger(&self.served.endpoints[0]), stranger(&self.served.endpoints[1])]
    }

    fn addresses(&self) -> [&str; 2] {
        [0, 1].map(|i| self.served.endpoints[i].strip_prefix("tcp/").unwrap())
    }

    fn stop(&self, time: Duration) {
        self.served.signal("STOP");
        std::thread::sleep(time);
        self.served.signal("CONT");
    }

    /// For `time` the road to the server is as `road`.
    fn on_road(&self, road: Road, time: Duration) {
        let roads = self.roads.as_ref().expect("faults of roads are tried where there are roads");
        roads.set(0, 1, road);
        std::thread::sleep(time);
        roads.set(0, 1, Road::default());
    }
}

fn connected(served: &Served) -> Connection {
    let [force, surface] = served.endpoints.clone();
    Connection::open(&Endpoints { force, surface, ..Endpoints::default() }).unwrap()
}

const SECOND: Duration = Duration::from_secs(1);

/// What is done, and whether it needs roads.
type Fault = (&'static str, bool, fn(&mut Stage));

const FAULTS: [Fault; 17] = [
    ("none, for 3 s", false, |_| std::thread::sleep(3 * SECOND)),
    ("forged wrenches on all keys, 1 s", false, |stage| {
        let sessions = stage.strangers();
        Stage::keep(SECOND, || {
            for key in [keys::tool_wrench(SESSION, 0), keys::all_tool_wrenches(SESSION), "palpate/**".into()] {
                for session in &sessions {
                    session.put(key.clone(), forged(1, u64::MAX, u64::MAX)).wait().unwrap();
                }
            }
        });
    }),
    ("poses in a hand's place, 1 s", false, |stage| {
        let [session, _] = stage.strangers();
        let pose = proto::ToolPose {
            epoch: 1,
            sequence: u32::MAX / 2,
            position: vec![0.05, 0.05, 0.3],
            orientation: vec![0.0, 0.0, 0.0, 1.0],
            ..Default::default()
        };
        let bytes = pose.encode_to_vec();
        Stage::keep(SECOND, || session.put(keys::tool_pose(SESSION, 0), bytes.clone()).wait().unwrap());
    }),
    ("answers in the server's place", false, |stage| {
        let [_, session] = stage.strangers();
        let lie = |query: zenoh::query::Query| drop(query.reply(query.key_expr().clone(), Vec::new()).wait());
        session.declare_queryable("palpate/**").complete(true).callback(lie).background().wait().unwrap();
        assert_eq!(stage.connection.session().unwrap().tools.len(), 2);
    }),
    ("tools freed by a stranger", false, |stage| {
        for (tool, secret) in [(0, 0), (0, u64::MAX), (1, 1)] {
            let detach = proto::Detach { tool, epoch: 1, secret };
            stage.connection.control(Request::Detach(detach)).unwrap_err();
        }
    }),
    ("the body reset in a press", false, |stage| {
        stage.connection.control(Request::Reset(proto::ResetBody {})).unwrap();
    }),
    ("3,000 questions, no answer read, 4 s", false, |stage| {
        let mut asker = asker(&stage.served.endpoints[1], NAME);
        std::thread::sleep(4 * SECOND);
        asker.kill().unwrap();
        asker.wait().unwrap();
    }),
    ("100,000 poses of nonsense", false, |stage| {
        let [session, _] = stage.strangers();
        for i in 0..100_000 {
            session.put(keys::tool_pose(SESSION, i % 2), vec![0xff; 60]).wait().unwrap();
        }
    }),
    ("20 messages of 2 MB", false, |stage| {
        let [session, _] = stage.strangers();
        (0..20).for_each(|_| session.put(keys::tool_pose(SESSION, 0), vec![0xff; 2_000_000]).wait().unwrap());
    }),
    ("600 connections that say nothing, 2 s", false, |stage| {
        let addresses = stage.addresses();
        let idle: Vec<_> = (0..600).filter_map(|i| TcpStream::connect(addresses[i % 2]).ok()).collect();
        std::thread::sleep(2 * SECOND);
        drop(idle);
    }),
    ("a viewer that goes, and comes back", false, |stage| {
        drop(stage.viewers.pop());
        stage.viewers.push(stage.watch());
    }),
    ("four busy programs, 3 s", false, |_| {
        let busy = || Command::new("sh").args(["-c", "while :; do :; done"]).stdin(Stdio::null()).spawn().unwrap();
        let mut programs: Vec<_> = (0..4).map(|_| busy()).collect();
        std::thread::sleep(3 * SECOND);
        for program in &mut programs {
            program.kill().unwrap();
            program.wait().unwrap();
        }
    }),
    ("the server stopped for 0.5 s", false, |stage| stage.stop(SECOND / 2)),
    ("the server stopped for 5 s", false, |stage| stage.stop(5 * SECOND)),
    ("20 % of the packets lost, 3 s", true, |stage| {
        stage.on_road(Road { loss: 0.2, ..Road::default() }, 3 * SECOND);
    }),
    ("the road closed for 0.5 s", true, |stage| stage.on_road(Road { loss: 1.0, ..Road::default() }, SECOND / 2)),
    ("the road closed for 5 s", true, |stage| stage.on_road(Road { loss: 1.0, ..Road::default() }, 5 * SECOND)),
];

/// What a fault cost, at worst.
#[derive(Clone, Copy, Debug, Default)]
struct Cost {
    ticks: u64,
    wrenches: u64,
    /// [N].
    step: f64,
    /// [MB].
    memory: f64,
    /// [s].
    recovery: f64,
}

impl Cost {
    fn max(self, other: Self) -> Self {
        Self {
            ticks: self.ticks.max(other.ticks),
            wrenches: self.wrenches.max(other.wrenches),
            step: self.step.max(other.step),
            memory: self.memory.max(other.memory),
            recovery: self.recovery.max(other.recovery),
        }
    }

    fn verdict(&self) -> &'static str {
        // Rounded to single precision on its way.
        match self.step < SLEW * (1.0 + 1e-5) && self.memory < MOST_MORE {
            true => "holds",
            false => "FAILS",
        }
    }
}

fn cost(stage: &mut Stage, fault: fn(&mut Stage)) -> Cost {
    let (before, memory) = (stage.status(), stage.memory());
    stage.hands.iter().for_each(|hand| *hand.lock().unwrap() = Seen::default());
    fault(stage);
    let (recovery, after) = stage.recovered();
    // How fast the disk is, is the machine's: a recording that it ended is told of, and replays as far as it goes.
    let others: Vec<_> = after.faults.iter().filter(|fault| !fault.contains(SLOW_DISK)).collect();
    assert!(others.is_empty(), "{others:?}");
    let hands = stage.hands.each_ref().map(|hand| hand.lock().unwrap());
    Cost {
        ticks: after.lapsed_ticks - before.lapsed_ticks,
        wrenches: hands.iter().map(|hand| hand.lost).sum(),
        step: hands.iter().map(|hand| hand.step).fold(0.0, f64::max),
        memory: stage.memory() - memory,
        recovery: recovery.as_secs_f64(),
    }
}

/// What is said of a recording that ended early because of the disk.
const SLOW_DISK: &str = "the disk was too slow";

const NAME: &str = "every_fault_passes_and_what_was_felt_meanwhile_replays";

#[test]
fn every_fault_passes_and_what_was_felt_meanwhile_replays() {
    if asks() {
        return;
    }
    let minutes = std::env::var("PALPATE_MINUTES").map_or(0.0, |minutes| minutes.parse().unwrap());
    // With a network of its own the test runs in another process; without, here, but for the faults of roads.
    let roads = match roads::apart(NAME) {
        roads::Apart::Ran => return,
        roads::Apart::Here => Some(Roads::build(2)),
        roads::Apart::Refused => None,
    };
    let folder = tempfile::tempdir().unwrap();
    let recording = folder.path().join("matrix.mcap");
    let arguments = ["--scene", "cube", "--set", "world.gravity=[0.0, 0.0, 0.0]", "--set", "body.cells=[[5,5,5]]"];
    let arguments = [&arguments[..], &["--set", TOOLS, "--record", recording.to_str().unwrap()]].concat();
    let served = match &roads {
        Some(roads) => {
            let site = &roads.sites[1];
            let (force, surface) = (site.endpoint(7447), site.endpoint(7448));
            let endpoints = Endpoints { force, surface, ..Endpoints::default() };
            Served::at(site.command(PROGRAM), &[&arguments[..], &["--insecure"]].concat(), &endpoints)
        }
        None => Served::start_with(Command::new(PROGRAM), &arguments[2..]),
    };
    let stop = Arc::new(AtomicBool::new(false));
    let hand = |tool, x| pressing(Hand::with(tool, [x, 0.05], &served.endpoints), stop.clone());
    let [(left, left_thread), (right, right_thread)] = [hand("left", 0.03), hand("right", 0.07)];
    let connection = connected(&served);
    let status = Arc::new(Mutex::new(None));
    let told = status.clone();
    let _status =
        connection.subscribe_status(move |status| *told.lock().unwrap() = Some((Instant::now(), status))).unwrap();
    let mut stage = Stage { served, roads, hands: [left, right], connection, viewers: Vec::new(), status };
    stage.viewers = (0..4).map(|_| stage.watch()).collect();
    stage.recovered();

    let called = std::env::var("PALPATE_FAULT").unwrap_or_default();
    assert!(FAULTS.iter().any(|(what, ..)| what.contains(&called)), "no fault is called {called:?}");
    let began = Instant::now();
    let mut costs: Vec<Option<Cost>> = vec![None; FAULTS.len()];
    let (mut rounds, mut first) = (0, 0.0);
    while rounds == 0 || began.elapsed().as_secs_f64() < 60.0 * minutes {
        for ((what, needs_roads, fault), worst) in FAULTS.iter().zip(&mut costs) {
            if *needs_roads && stage.roads.is_none() || !what.contains(&called) {
                continue;
            }
            let cost = cost(&mut stage, *fault);
            println!("{what}: {cost:?}");
            *worst = Some(worst.map_or(cost, |worst| worst.max(cost)));
        }
        rounds += 1;
        println!("round {rounds}: {:.1} MB", stage.memory());
        if rounds == 1 {
            first = stage.memory();
        }
    }
    let (growth, status) = (stage.memory() - first, stage.status());
    stop.store(true, Relaxed);
    left_thread.join().unwrap();
    right_thread.join().unwrap();
    stage.served.signal("TERM");
    // That is so of server and replay alike.
    let ends_with = if status.faults.iter().any(|fault| fault.contains(SLOW_DISK)) { 3 } else { 0 };
    assert_eq!(stage.served.code(), Some(ends_with));
    let (code, said) = replayed(&recording, &["--kernel", "portable"]);

    let mut table =
        "| fault | ticks lost | wrenches lost | largest step [N a tick] | memory [MB] | felt again after [s] | |\n\
        |---|---|---|---|---|---|---|\n"
            .to_owned();
    for ((what, ..), cost) in FAULTS.iter().zip(&costs) {
        match cost {
            None => writeln!(table, "| {what} | | | | | | skipped |").unwrap(),
            Some(cost) => {
                let Cost { ticks, wrenches, step, memory, recovery } = cost;
                let verdict = cost.verdict();
                writeln!(
                    table,
                    "| {what} | {ticks} | {wrenches} | {step:.3} | {memory:+.1} | {recovery:.1} | {verdict} |"
                )
                .unwrap();
            }
        }
    }
    println!("{table}");
    println!(
        "{rounds} rounds, {:.1} minutes, {} ticks; after the first round {growth:+.1} MB; {} late ticks; replay: {}",
        began.elapsed().as_secs_f64() / 60.0,
        status.tick,
        status.late_ticks,
        said.trim()
    );
    assert!(code == Some(ends_with) && said.contains("identical"), "{said}");
    assert!(growth < MOST_GROWTH, "{growth} MB");
    assert!(costs.iter().flatten().all(|cost| cost.verdict() == "holds"));
}
