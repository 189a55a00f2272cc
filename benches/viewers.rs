//! What viewers cost: `cargo bench --bench viewers`. A server with the bundled liver in this process, a virtual Phantom
//! that palpates it in another, and 0, 1, 8 or 32 viewers of every frame in a third, in turn; twice round, so that what
//! the machine does meanwhile falls on all of them. The device's clock drifts through three of the server's ticks in a run:
//! how long before its tick a pose comes is worth up to 1 ms, and would be an accident of each run. Ends with an error
//! when the force channel's p99 with 32 viewers is more than 1.2 times that with none.

use palpate::scene::LoadedScene;
use palpate::server::{Options, Server};
use palpate_phantom::Pattern;
use palpate_sdk::{Connection, Endpoints, WatchOptions};
use serde_json::{Value, json};
use std::io::{BufRead, BufReader, Read};
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::sync::Arc;
use std::sync::atomic::AtomicBool;
use std::time::{Duration, Instant};

const VIEWERS: [usize; 4] = [0, 1, 8, 32];
const ROUNDS: usize = 2;
const SECONDS: f64 = 15.0;
const CLOCK_DRIFT: f64 = 3.0 * 1e-3 / SECONDS;
/// Most that 32 viewers may multiply the 99th percentile of pose to wrench by.
const MOST: f64 = 1.2;

/// Set for the other processes: what each is, and the server's endpoints.
const ROLE: &str = "PALPATE_BENCH_ROLE";
const ENDPOINTS: &str = "PALPATE_BENCH_ENDPOINTS";

fn main() {
    let endpoints = std::env::var(ENDPOINTS).unwrap_or_default();
    let (force, surface) = endpoints.split_once(' ').unwrap_or_default();
    let endpoints = Endpoints { force: force.into(), surface: surface.into(), ..Endpoints::default() };
    let report = match std::env::var(ROLE).as_deref() {
        Ok("phantom") => palpate(endpoints),
        Ok(viewers) => watch(&endpoints, viewers.parse().unwrap()),
        // `cargo test` runs benches, too, without this word.
        Err(_) if std::env::args().any(|arg| arg == "--bench") => return serve(),
        Err(_) => return,
    };
    println!("{report}");
}

/// The Phantom's process.
fn palpate(endpoints: Endpoints) -> Value {
    let pattern = Pattern::Palpate;
    let options = palpate_phantom::Options {
        endpoints,
        pattern,
        clock_drift: CLOCK_DRIFT,
        seconds: Some(SECONDS),
        echo: false,
        ..palpate_phantom::Options::default()
    };
    let report = palpate_phantom::run(&options, &AtomicBool::new(false), &mut |_| ()).unwrap();
    json!({ "p50": report.round_trip.p50, "p99": report.round_trip.p99, "missed": report.missed_wrenches })
}

/// The viewers' process: they watch until its input ends.
fn watch(endpoints: &Endpoints, viewers: usize) -> Value {
    let open = || Connection::open_surface(endpoints).unwrap().watch_surface(WatchOptions::default()).unwrap();
    let watches: Vec<_> = (0..viewers).map(|_| open()).collect();
    let sum = || {
        let all = watches.iter().map(|watch| watch.counters());
        all.fold([0; 4], |[frames, lost, undecodable, bytes], c| {
            [frames + c.frames, lost + c.lost, undecodable + c.undecodable, bytes + c.bytes]
        })
    };
    println!("ready");
    std::thread::sleep(Duration::from_secs(1));
    let (before, began) = (sum(), Instant::now());
    std::io::stdin().read_to_end(&mut Vec::new()).unwrap();
    let (after, each) = (sum(), 1.0 / (began.elapsed().as_secs_f64() * viewers.max(1) as f64));
    let [frames, lost, undecodable, bytes] = [0, 1, 2, 3].map(|i| (after[i] - before[i]) as f64 * each);
    assert_eq!(undecodable, 0.0);
    json!({ "frames": frames, "lost": lost, "bytes": bytes })
}

fn start(role: &str, endpoints: &Endpoints) -> Child {
    Command::new(std::env::current_exe().unwrap())
        .env(ROLE, role)
        .env(ENDPOINTS, format!("{} {}", endpoints.force, endpoints.surface))
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .spawn()
        .unwrap()
}

/// The last line that a process prints before it ends.
fn report(mut process: Child) -> Value {
    drop(process.stdin.take());
    let text = process.wait_with_output().unwrap().stdout;
    serde_json::from_slice(text.split(|b| *b == b'\n').rfind(|line| !line.is_empty()).unwrap()).unwrap()
}

/// Processor time [s] of this process but for the simulation thread.
fn processor_time() -> f64 {
    let mut sum = 0.0;
    for task in std::fs::read_dir("/proc/self/task").unwrap() {
        let read = |file: &str| std::fs::read_to_string(task.as_ref().unwrap().path().join(file)).unwrap_or_default();
        if read("comm").trim() != "simulation" {
            sum += read("schedstat").split(' ').next().and_then(|ns| ns.parse::<f64>().ok()).unwrap_or(0.0) * 1e-9;
        }
    }
    sum
}

/// What one run measured: pose to wrench [µs], the server's processor time [%], and per viewer and second.
struct Run {
    p50: f64,
    p99: f64,
    missed: f64,
    processor: f64,
    bytes: f64,
    frames: f64,
    lost: f64,
}

fn run(endpoints: &Endpoints, viewers: usize) -> Run {
    let mut watching = start(&viewers.to_string(), endpoints);
    let mut ready = String::new();
    BufReader::new(watching.stdout.as_mut().unwrap()).read_line(&mut ready).unwrap();
    let (before, began) = (processor_time(), Instant::now());
    let mut phantom = start("phantom", endpoints);
    phantom.wait().unwrap();
    let processor = 100.0 * (processor_time() - before) / began.elapsed().as_secs_f64();
    let (touched, seen) = (report(phantom), report(watching));
    let number = |of: &Value, name: &str| of[name].as_f64().unwrap();
    Run {
        p50: number(&touched, "p50"),
        p99: number(&touched, "p99"),
        missed: number(&touched, "missed"),
        processor,
        bytes: number(&seen, "bytes"),
        frames: number(&seen, "frames"),
        lost: number(&seen, "lost"),
    }
}

fn serve() {
    let loaded = LoadedScene::load(Path::new("liver"), &[]).unwrap();
    let body = Arc::new(loaded.build(&mut |_, _, _| {}).unwrap());
    let start = loaded.scene.at_rest(&body);
    let (vertices, free) = (body.surface().vertices.len(), || std::net::TcpListener::bind("127.0.0.1:0").unwrap());
    let [force, surface] = [free(), free()].map(|l| format!("tcp/127.0.0.1:{}", l.local_addr().unwrap().port()));
    let endpoints = Endpoints { force: force.clone(), surface: surface.clone(), ..Endpoints::default() };
    let options = Options { force_endpoint: force, surface_endpoint: surface, ..Options::default() };
    let runtime = tokio::runtime::Builder::new_multi_thread().enable_all().build().unwrap();
    let server = runtime.block_on(Server::start(loaded.scene, body, start, options)).unwrap();
    println!("liver, {vertices} vertices shown; {}", server.warning().unwrap_or("scheduling as asked for"));
    println!(
        "| viewers | kB/s each | frames/s each | lost/s | server beside the simulation | pose to wrench p50 | p99 |"
    );
    println!("|---|---|---|---|---|---|---|");
    let mut p99s = VIEWERS.map(|_| 0.0);
    for (viewers, p99) in (0..ROUNDS).flat_map(|_| 0..VIEWERS.len()).map(|at| (VIEWERS[at], at)) {
        let run = run(&endpoints, viewers);
        p99s[p99] += run.p99 / ROUNDS as f64;
        println!(
            "| {viewers} | {:.0} | {:.1} | {:.2} | {:.1} % of a core | {:.0} µs | {:.0} µs, {} missed |",
            1e-3 * run.bytes,
            run.frames,
            run.lost,
            run.processor,
            run.p50,
            run.p99,
            run.missed
        );
    }
    runtime.block_on(server.stop());
    let ratio = p99s[3] / p99s[0];
    println!("p99 with 32 viewers over p99 with none: {ratio:.2}");
    assert!(ratio <= MOST, "viewers slow the force channel");
}
