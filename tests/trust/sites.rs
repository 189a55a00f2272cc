//! Three sites with a router each, two servers behind one of them, a hundred viewers behind the others, and hands 20 ms away.

use super::hand::{Hand, INSIDE, OUTSIDE, TOOLS};
use super::roads::{Apart, Road, Roads, apart};
use super::served::Served;
use palpate_sdk::{Connection, Endpoints, SdkError, Subscription, WatchOptions};
use std::io::{BufRead, BufReader, Read};
use std::process::{Child, ChildStdout, Command, Stdio};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, Instant};
use zenoh::Wait;

const PROGRAM: &str = env!("CARGO_BIN_EXE_palpate");
/// Set for a process of this program that is a router: where it listens, and what it connects to.
const ROUTER: &str = "PALPATE_TEST_ROUTER";
/// Set for one that is viewers: the endpoint that they hang on.
const VIEWERS: &str = "PALPATE_TEST_VIEWERS";
/// Set for one that is a hand: the endpoint that it presses through.
const HAND: &str = "PALPATE_TEST_HAND";
/// Viewers at a site.
const CROWD: usize = 50;
const PATIENCE: Duration = Duration::from_secs(60);
const SECOND: Duration = Duration::from_secs(1);

/// The site of hands and half of the viewers.
const HERE: usize = 0;
/// That of the servers.
const SERVERS: usize = 1;
/// That of the other viewers.
const THERE: usize = 2;

/// What a process says when it does what it is for.
const READY: &str = "ready";

/// A process that ends with this, and what it says: libTest ends where nobody listens.
struct Process(Child, BufReader<ChildStdout>);

impl Process {
    /// This program again, as it is started by `command`, to be what the variable `role` says.
    fn of(mut command: Command, role: &str, value: &str) -> Self {
        let test = "sites::a_crowd_at_two_sites_costs_a_server_two_streams";
        command.args([test, "--exact", "--nocapture"]).env(role, value).stdout(Stdio::piped());
        let mut process = command.spawn().unwrap();
        let said = BufReader::new(process.stdout.take().unwrap());
        Self(process, said)
    }

    /// Waits until it says that it is ready.
    fn ready(&mut self) {
        assert!(self.1.by_ref().lines().map_while(Result::ok).any(|line| line == READY), "it has ended");
    }
}

impl Drop for Process {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

/// A router as `zenohd` is one: of the same library, with the settings that the guide asks for.
fn route(places: &str) -> ! {
    let (listen, connect) = places.split_once(' ').unwrap();
    let mut config = zenoh::Config::default();
    for (key, value) in [
        ("mode", "\"router\"".to_owned()),
        ("listen/endpoints", format!("[{listen:?}]")),
        ("connect/endpoints", if connect.is_empty() { "[]".into() } else { format!("[{connect:?}]") }),
        ("scouting/multicast/enabled", "false".into()),
        ("transport/link/tx/queue/congestion_control/drop/wait_before_drop", "0".into()),
        ("transport/link/tx/queue/size/data_low", "16".into()),
    ] {
        config.insert_json5(key, &value).unwrap();
    }
    let _session = zenoh::open(config).wait().unwrap();
    loop {
        std::thread::park();
    }
}

/// Somebody who is sent the surface. It decodes the first moment alone: to decode them all for a hundred takes two processors, and
/// says nothing of the roads.
struct Viewer {
    frames: Arc<AtomicU64>,
    _subscription: Subscription,
    _connection: Connection,
}

impl Viewer {
    fn of(endpoints: &Endpoints) -> Result<Self, SdkError> {
        let connection = Connection::open_surface(endpoints)?;
        connection.surface_now()?;
        let frames = Arc::new(AtomicU64::new(0));
        let came = frames.clone();
        let count = move |_| {
            came.fetch_add(1, Ordering::Relaxed);
        };
        let subscription = connection.subscribe_frames(WatchOptions::default(), count)?;
        Ok(Self { frames, _subscription: subscription, _connection: connection })
    }

    fn frames(&self) -> u64 {
        self.frames.load(Ordering::Relaxed)
    }
}

/// `count` viewers that hang on `endpoint`.
fn crowd(endpoint: &str, count: usize) -> Vec<Viewer> {
    let endpoints = Endpoints { surface: endpoint.to_owned(), ..Endpoints::default() };
    let watch = || {
        let began = Instant::now();
        loop {
            match Viewer::of(&endpoints) {
                Ok(viewer) => return viewer,
                Err(e) => assert!(began.elapsed() < PATIENCE, "{e}"),
            }
        }
    };
    (0..count).map(|_| watch()).collect()
}

/// Messages with frames, or parts of them, that each of `viewers` is sent in `time`.
fn frames(viewers: &[Viewer], time: Duration) -> Vec<u64> {
    let count = || viewers.iter().map(Viewer::frames).collect::<Vec<_>>();
    let before = count();
    std::thread::sleep(time);
    count().iter().zip(before).map(|(after, before)| after - before).collect()
}

/// What a hand felt while it pressed for `time`, 1.4 s of every 2 s: its part of the time inside in which it felt the body, and the
/// largest force [N].
fn presses(hand: &mut Hand, time: Duration) -> (f64, f64) {
    let (began, mut inside, mut felt, mut most) = (Instant::now(), 0, 0, 0.0f64);
    while began.elapsed() < time {
        let at = began.elapsed().as_millis() % 2000;
        let step = hand.step(if at < 1400 { INSIDE } else { OUTSIDE });
        // It needs some time to arrive, and to be ramped up.
        if (400..1400).contains(&at) {
            inside += 1;
            if let Some((_, force)) = step {
                felt += u32::from(force > 0.1);
                most = most.max(force);
            }
        }
    }
    (f64::from(felt) / f64::from(inside), most)
}

#[test]
fn a_crowd_at_two_sites_costs_a_server_two_streams() {
    if let Ok(places) = std::env::var(ROUTER) {
        route(&places);
    }
    if let Ok(endpoint) = std::env::var(VIEWERS) {
        let _viewers = crowd(&endpoint, CROWD);
        println!("{READY}");
        loop {
            std::thread::park();
        }
    }
    if let Ok(endpoint) = std::env::var(HAND) {
        let mut hand = Hand::with("right", [0.07, 0.05], &[endpoint.clone(), endpoint]);
        hand.press();
        println!("{READY}");
        loop {
            presses(&mut hand, SECOND);
        }
    }
    let _alone = super::alone();
    if apart("sites::a_crowd_at_two_sites_costs_a_server_two_streams") != Apart::Here {
        return;
    }
    let roads = Roads::build(3);
    let far = Road { delay: Duration::from_millis(20), loss: 0.01 };
    roads.set(HERE, SERVERS, far);
    roads.set(THERE, SERVERS, far);
    let own = std::env::current_exe().unwrap();
    let port = |site: usize| roads.sites[site].endpoint(7500);
    let router =
        |site: usize, to: &str| Process::of(roads.sites[site].command(&own), ROUTER, &format!("{} {to}", port(site)));
    let _central = router(SERVERS, "");
    let (mut here, _there) = (router(HERE, &port(SERVERS)), router(THERE, &port(SERVERS)));
    let serve = |session: &str, first: u16, tools: &str| {
        let site = &roads.sites[SERVERS];
        let arguments = ["--scene", "cube", "--set", "world.gravity=[0.0, 0.0, 0.0]", "--set", "body.cells=[[5,5,5]]"];
        let central = port(SERVERS);
        let arguments =
            [&arguments[..], &["--set", tools, "--session", session, "--insecure", "--connect", &central]].concat();
        let (force, surface) = (site.endpoint(first), site.endpoint(first + 1));
        let endpoints = Endpoints { force, surface, session: session.into(), ..Endpoints::default() };
        Served::at(site.command(PROGRAM), &arguments, &endpoints)
    };
    let (main, _second) = (serve("main", 7447, TOOLS), serve("second", 7457, "tool=[{name=\"ball\", radius=0.02}]"));

    // Both are found at a router that they have never heard of.
    let began = Instant::now();
    loop {
        let listed = Command::new(PROGRAM).args(["list", "--connect", &port(HERE)]).output().unwrap();
        let listed = String::from_utf8(listed.stdout).unwrap();
        if listed.contains("main: cube; left (free), right (free)\n") && listed.contains("second: cube; ball (free)\n")
        {
            break println!("{listed}");
        }
        assert!(began.elapsed() < PATIENCE, "{listed}");
    }

    // A hand beside the server keeps the body in motion.
    let mut near = Process::of(roads.sites[SERVERS].command(&own), HAND, &port(SERVERS));
    near.ready();
    // A stream leaves the server's site for each site where somebody watches, whatever many do.
    let outgoing = |time: Duration| {
        let before = roads.carried(SERVERS);
        std::thread::sleep(time);
        (roads.carried(SERVERS) - before) as f64 / time.as_secs_f64()
    };
    let first = crowd(&port(HERE), 1);
    outgoing(2 * SECOND);
    let (alone, quiet) = (outgoing(5 * SECOND), frames(&first, 3 * SECOND)[0]);
    let many = crowd(&port(HERE), CROWD - 1);
    let mut crowd_there = Process::of(roads.sites[THERE].command(&own), VIEWERS, &port(THERE));
    crowd_there.ready();
    outgoing(2 * SECOND);
    let (crowded, seen) = (outgoing(5 * SECOND), frames(&many, 3 * SECOND));
    println!(
        "one viewer: {:.1} kB/s leave the site, {quiet} messages in 3 s; {} at two sites: {:.1} kB/s, {} to {} messages",
        alone / 1e3,
        2 * CROWD,
        crowded / 1e3,
        seen.iter().min().unwrap(),
        seen.iter().max().unwrap()
    );
    assert!(crowded < 3.0 * alone, "{crowded} B/s for {} viewers, {alone} B/s for one", 2 * CROWD);
    // However few frames a busy machine has time for, everybody is sent some.
    let mut waiting = many.iter().map(|viewer| (viewer, viewer.frames())).collect::<Vec<_>>();
    let began = Instant::now();
    while !waiting.is_empty() {
        waiting.retain(|(viewer, before)| viewer.frames() == *before);
        assert!(began.elapsed() < PATIENCE, "{} of {CROWD} viewers see nothing", waiting.len());
        std::thread::sleep(Duration::from_millis(20));
    }
    drop((crowd_there, many, near));

    // A hand 20 ms away, over the router, with loss.
    let mut hand = Hand::with("left", [0.03, 0.05], &[port(HERE), port(HERE)]);
    hand.press();
    let (holding, attached) = (hand.take_wrenches().len(), hand.attached);
    let (felt, most) = presses(&mut hand, 10 * SECOND);
    let age = hand.take_wrenches().iter().map(|wrench| wrench.pose_age_ticks).max().unwrap();
    println!(
        "{holding} wrenches until it felt the body; it felt it in {:.0} % of the time inside, {most:.2} N at most; poses up to \
         {age} ms old; attached {} times more",
        100.0 * felt,
        hand.attached - attached
    );
    assert!(felt > 0.5 && most < 3.31, "{felt}, {most} N");

    // The router of the site is killed, and comes back.
    here.0.kill().unwrap();
    here.0.wait().unwrap();
    let until = Instant::now() + 3 * SECOND;
    while Instant::now() < until {
        hand.step(INSIDE);
    }
    drop(std::mem::replace(&mut here, router(HERE, &port(SERVERS))));
    let (began, lost) = (Instant::now(), hand.attached);
    hand.press();
    println!(
        "felt again {:.1} s after its router was back, attached {} times more",
        began.elapsed().as_secs_f64(),
        hand.attached - lost
    );
    let began = Instant::now();
    while frames(&first, SECOND)[0] == 0 {
        assert!(began.elapsed() < PATIENCE, "its viewer sees no frame");
    }
    println!("its viewer sees again {:.1} s later", began.elapsed().as_secs_f64());
    main.signal("TERM");
}
