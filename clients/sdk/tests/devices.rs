//! The examples for devices, on imagined ones: the vendors' libraries are stubs with the same imagined hand behind each, which
//! presses the stand-in server's floor, lifts in the clutch, and presses on from there.
#![cfg(unix)] // the flags are those of cc

mod c_program;
mod fake_server;
#[path = "../../devices/haply.rs"]
#[allow(dead_code, reason = "its main function reads arguments")]
mod haply;
mod haply_service;

use c_program::{Linked, compile_against, run};
use fake_server::{FLOOR_STIFFNESS, FakeServer, TOOL_RADIUS};
use std::net::TcpListener;
use std::path::Path;
use std::process::Command;

/// What the hand feels where it ends, 1 mm above the floor [N].
const PRESSED: f64 = FLOOR_STIFFNESS * (TOOL_RADIUS - 1e-3);
/// How long it takes for all of it [s].
const SECONDS: &str = "4";

/// While it pressed, in the clutch and after it: as hard again where the hand is 10 mm higher, and nothing in between.
fn check(felt: [f64; 3], what: &str) {
    let near = |force: f64| (force / PRESSED - 1.0).abs() < 0.01;
    assert!(near(felt[0]) && felt[1] == 0.0 && near(felt[2]), "{what}: {felt:?} N, {PRESSED} N expected");
}

fn c_example(name: &str, standard: &str, more: &[&str]) {
    let devices = Path::new(env!("CARGO_MANIFEST_DIR")).join("../devices");
    let server = FakeServer::current();
    let folder = tempfile::tempdir().unwrap();
    let program = folder.path().join(name);
    let sources = [devices.join(format!("{name}.c")), devices.join(format!("stubs/{name}.c"))];
    let include = [Path::new(env!("CARGO_MANIFEST_DIR")).join("include"), devices.join("stubs")];
    compile_against(&include, &sources, standard, more, Linked::Shared, &program);
    let endpoints = [&server.endpoints.force, &server.endpoints.surface, &server.endpoints.session];
    let said = run(Command::new(&program).args(endpoints).args(["0", "0", "0", SECONDS]));
    let number = |before: &str| -> f64 {
        said.split_once(before).unwrap().1.split_whitespace().next().unwrap().parse().unwrap()
    };
    check(["pressed ", "clutched ", "after "].map(number), name);
}

#[test]
fn a_device_of_openhaptics_presses_and_moves_on_with_the_clutch() {
    c_example("openhaptics", "-std=c11", &["-lpthread"]);
}

#[test]
fn a_device_of_force_dimension_presses_and_moves_on_with_the_clutch() {
    c_example("forcedimension", "-std=c99", &[]);
}

/// Height of the imagined hand after `t` seconds [m], and whether it presses the clutch: as in stubs/imagined.h.
fn hand(t: f64) -> (f64, bool) {
    let lift = ((t - 2.1) / 0.3).clamp(0.0, 1.0);
    (0.025 - 0.024 * t.min(1.0) + 0.010 * lift, t > 2.0 && t < 2.6)
}

#[test]
fn haplys_service_presses_and_moves_on_with_the_clutch() {
    let server = FakeServer::current();
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let url = format!("ws://{}", listener.local_addr().unwrap());
    let endpoints = server.endpoints.clone();
    let bridge = std::thread::spawn(move || haply::touch(&url, &endpoints, [0.0; 3]).map_err(|e| e.to_string()));
    let mut felt = [0.0; 3];
    let messages = haply_service::run(&listener, 3.8, hand, |t, force| {
        for (part, (from, to)) in [(1.2, 2.0), (2.2, 2.6), (3.0, 9.0)].into_iter().enumerate() {
            if t > from && t < to {
                felt[part] = f64::max(felt[part], force);
            }
        }
    });
    assert_eq!(bridge.join().unwrap(), Ok(()));
    println!("{messages} messages, {felt:?} N");
    check(felt, "haply");
}
