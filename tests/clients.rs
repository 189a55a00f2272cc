//! Clients of every kind on the same place of the same liver, in one session: they feel the same.
//!
//! A client that lacks something to be run is left out, and the table says so.
#![cfg(target_os = "linux")] // how libraries are found

#[path = "web/browser.rs"]
mod browser;
#[path = "../clients/sdk/tests/c_program/mod.rs"]
mod c_program;
#[path = "common/python.rs"]
mod python;
#[path = "common/served.rs"]
mod served;

use browser::{Heard, Page, Visitor};
use c_program::{Linked, compile_example, held_forces, library, run};
use palpate_proto::ToolPhase;
use palpate_sdk::{Attachment, Connection, Device, Endpoints, PoseSample, Registration};
use served::Served;
use std::io::{BufRead, BufReader};
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

/// Where all begin, and how far the handle goes down to its place within a second [m].
const ABOVE: f64 = 0.025;
/// How deep the handle of a ball of 10 mm goes into the body [m].
const DEPTH: f64 = 0.008;
const RADIUS: f64 = 0.01;
/// Poses are held for a second more; of its last part a force is taken [s].
const SETTLED: f64 = 1.6;
const ENDS: f64 = 2.0;

/// Two levels of the liver, which are built within a second.
const COARSE: &str = "body.spacings=[0.023, 0.015]";

/// What a client felt: the force up while it held still [N], and the times from poses to their first wrenches [ms].
struct Felt {
    newtons: f64,
    answers: Vec<f64>,
}

fn median(mut of: Vec<f64>) -> Option<f64> {
    of.sort_by(f64::total_cmp);
    of.get(of.len() / 2).copied()
}

/// Height above the place, `seconds` after the beginning.
fn height(seconds: f64) -> f64 {
    ABOVE * (1.0 - seconds).max(0.0)
}

/// A program killed when this is dropped.
struct Killed(Child);

impl Drop for Killed {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

/// In Rust, 1,000 poses a second; and where the tool itself was under the force. `None` where the hand was lost.
fn in_rust(endpoints: &Endpoints, place: [f64; 3]) -> Option<(Felt, [f64; 3])> {
    let connection = Connection::open(endpoints).unwrap();
    let device = Device::by_name("Touch").unwrap();
    let mut tool = connection.attach(&Attachment::of("Rust", &device, &Registration::default())).unwrap();
    let (mut forces, mut answers, mut hung) = (Vec::new(), Vec::new(), place);
    let (begun, mut answered) = (Instant::now(), 0);
    loop {
        let seconds = begun.elapsed().as_secs_f64();
        if seconds > ENDS {
            break;
        }
        let position = [place[0], place[1], place[2] + height(seconds)];
        let orientation = [0.0, 0.0, 0.0, 1.0];
        tool.send_pose(PoseSample { position, orientation, linear_velocity: None, buttons: 0, opening: 0.0 }).unwrap();
        std::thread::sleep(Duration::from_millis(1));
        let Some(received) = tool.latest_wrench() else { continue };
        let wrench = received.wrench;
        if wrench.pose_sequence > answered {
            answered = wrench.pose_sequence;
            answers.push(1e-6 * received.arrival_ns.saturating_sub(wrench.pose_time_ns) as f64);
        }
        if seconds > SETTLED && wrench.phase == ToolPhase::Engaged {
            forces.push(tool.safe_force(tool.now_ns())[2]);
            hung = wrench.position;
        }
    }
    tool.detach().unwrap();
    Some((Felt { newtons: median(forces)?, answers }, hung))
}

/// In C, with the example: it ends 1 mm above the place that it is given.
fn in_c(program: &Path, endpoints: &Endpoints, place: [f64; 3]) -> Option<Felt> {
    let place = [place[0], place[1], place[2] - 1e-3].map(|x| x.to_string());
    let said = run(Command::new(program).args([&endpoints.force, &endpoints.surface, &endpoints.session]).args(place));
    let newtons = median(held_forces(&said))?;
    said.contains("held, engaged").then_some(Felt { newtons, answers: vec![] })
}

/// In C# under mono; its axes are right, up and forward.
fn in_csharp(program: &Path, endpoints: &Endpoints, place: [f64; 3]) -> Option<Felt> {
    let place = [place[0], place[2], place[1]].map(|x| x.to_string());
    let mut mono = Command::new("mono");
    mono.arg(program).args([&endpoints.force, &endpoints.surface, &endpoints.session]).args(place);
    let said = run(mono.env("LD_LIBRARY_PATH", program.parent().unwrap()));
    let held = said.lines().find_map(|line| line.strip_prefix("held ")).unwrap_or_else(|| panic!("{said}"));
    let newtons = held.trim().parse().unwrap();
    said.contains("Held and Engaged").then_some(Felt { newtons, answers: vec![] })
}

/// In Python; prints the force while it holds still and how the tool is doing.
const PYTHON: &str = "
import sys, numpy as np, palpate
*server, x, y, z, above, settled, ends = sys.argv[1:]
time = np.arange(0.0, float(ends), 1e-3)
heights = float(above) * np.maximum(1.0 - time, 0.0)
poses = np.array([float(x), float(y), float(z)]) + np.outer(heights, [0.0, 0.0, 1.0])
with palpate.connect(*server).attach('ball', device='Touch') as tool:
    felt = tool.follow(poses)
    print(np.median(felt.force[time > float(settled), 2]), tool.state['hold'], tool.state['phase'])
";

fn in_python(python: &Path, endpoints: &Endpoints, place: [f64; 3]) -> Option<Felt> {
    let numbers = place.into_iter().chain([ABOVE, SETTLED, ENDS]).map(|x| x.to_string());
    let mut script = Command::new(python);
    script.args(["-c", PYTHON, &endpoints.force, &endpoints.surface, &endpoints.session]).args(numbers);
    let said = run(&mut script);
    let (newtons, state) = said.trim().split_once(' ').unwrap_or_else(|| panic!("{said}"));
    (state == "held engaged").then(|| Felt { newtons: newtons.parse().unwrap(), answers: vec![] })
}

/// Through the gateway, 90 poses a second. A page has no device, whose coupling would hang its tool back: its place is
/// that of the tool itself.
fn on_a_page(page: &mut Page, place: [f64; 3]) -> Option<Felt> {
    page.place = place.map(|x| x as f32);
    let tool = page.attach("ball").unwrap();
    page.socket.get_mut().set_read_timeout(Some(Duration::from_millis(5))).unwrap();
    let (mut forces, mut answers, mut sent) = (Vec::new(), Vec::new(), Vec::new());
    let (begun, mut answered, first) = (Instant::now(), 0, page.pose(tool, ABOVE as f32));
    sent.push(begun);
    while begun.elapsed().as_secs_f64() < ENDS {
        if sent.last().is_some_and(|last: &Instant| last.elapsed() > Duration::from_millis(11)) {
            sent.push(Instant::now());
            page.pose(tool, height(begun.elapsed().as_secs_f64()) as f32);
        }
        let Heard::Wrench(wrench) = page.hear() else { continue };
        if wrench.pose_sequence >= first.max(answered + 1) {
            answered = wrench.pose_sequence;
            answers.push(1e3 * sent[(answered - first) as usize].elapsed().as_secs_f64());
        }
        if begun.elapsed().as_secs_f64() > SETTLED && wrench.phase() == ToolPhase::Engaged {
            forces.push(f64::from(wrench.force[2]));
        }
    }
    page.socket.get_mut().set_read_timeout(Some(Duration::from_secs(30))).unwrap();
    page.give_back(tool);
    Some(Felt { newtons: median(forces)?, answers })
}

/// A machine that is busy elsewhere for a tenth of a second silences the hand, which then has to come from outside again.
fn pressed<T>(client: &str, press: impl FnMut() -> Option<T>) -> T {
    std::iter::repeat_with(press).take(10).flatten().next().unwrap_or_else(|| panic!("{client} never felt the body"))
}

#[test]
fn every_client_feels_the_same_at_the_same_place() {
    let program = Path::new(env!("CARGO_BIN_EXE_palpate"));
    // One level of detail, whatever the machine has time for.
    let server = Served::of(program, &["--scene", "liver", "--set", COARSE, "--set", "body.active_level=1"]);
    let [force, surface] = server.endpoints.clone();
    let endpoints = Endpoints { force, surface, session: "main".into(), identity: None };
    let folder = tempfile::tempdir().unwrap();
    let watching = Connection::open_surface(&endpoints).unwrap();
    let (_, moment) = watching.surface_now().unwrap();
    let top = moment.positions.iter().copied().max_by(|a, b| a[2].total_cmp(&b[2])).unwrap().map(f64::from);
    let place = [top[0], top[1], top[2] + RADIUS - DEPTH];

    let (rust, hung) = pressed("Rust", || in_rust(&endpoints, place));
    let mut table = vec![("Rust", rust)];
    let touch = folder.path().join("touch");
    compile_example(&Path::new(env!("CARGO_MANIFEST_DIR")).join("clients/sdk"), "touch", Linked::Shared, &touch);
    table.push(("C", pressed("C", || in_c(&touch, &endpoints, place))));
    let is_there = |program: &str| Command::new(program).arg("--version").output().is_ok_and(|o| o.status.success());
    if is_there("mcs") && is_there("mono") {
        let touch = folder.path().join("touch.exe");
        let unity = Path::new(env!("CARGO_MANIFEST_DIR")).join("clients/unity");
        let mut compile = Command::new("mcs");
        compile.args(["-langversion:7", &format!("-out:{}", touch.display()), "Runtime/*.cs", "Tests~/Touch.cs"]);
        run(compile.current_dir(unity));
        std::fs::copy(library(Linked::Shared), folder.path().join("libpalpate_sdk.so")).unwrap();
        table.push(("C#", pressed("C#", || in_csharp(&touch, &endpoints, place))));
    } else {
        println!("C# is left out: mcs or mono is not there (apt-get install mono-mcs mono-runtime)");
    }
    if let Some((python, _)) = python::python() {
        table.push(("Python", pressed("Python", || in_python(&python, &endpoints, place))));
    }
    let mut web = Command::new(program);
    web.args(["web", "--listen", "127.0.0.1:0", "--force-endpoint", &endpoints.force]);
    web.args(["--surface-endpoint", &endpoints.surface]).stdin(Stdio::null()).stdout(Stdio::piped());
    let mut web = Killed(web.spawn().unwrap());
    let mut line = String::new();
    BufReader::new(web.0.stdout.take().unwrap()).read_line(&mut line).unwrap();
    let visitor = Visitor::enter(line.trim().strip_prefix("to touch: ").unwrap());
    let mut page = visitor.page().ready();
    table.push(("page", pressed("page", || on_a_page(&mut page, hung))));

    println!("client   force [N]   pose to wrench, p50 and p99 [ms]");
    for (client, Felt { newtons, answers }) in &mut table {
        answers.sort_by(f64::total_cmp);
        let quantile = |q: f64| answers.get((q * answers.len() as f64) as usize);
        let times = quantile(0.5).zip(quantile(0.99)).map_or("–".into(), |(p50, p99)| format!("{p50:.1}  {p99:.1}"));
        println!("{client:7}  {newtons:9.4}   {times}");
    }
    let expected = table[0].1.newtons;
    assert!(expected > 0.1, "the body is pressed: {expected} N");
    for (client, felt) in &table {
        assert!((felt.newtons / expected - 1.0).abs() < 0.01, "{client}: {} N, {expected} N in Rust", felt.newtons);
    }
}
