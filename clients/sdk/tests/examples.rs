//! The example against a stand-in server: a springy floor.

#[path = "../examples/press.rs"]
#[allow(dead_code, reason = "its main function asks the default endpoints")]
mod press;

mod fake_server;

use fake_server::{FLOOR_STIFFNESS, FakeServer, TOOL_RADIUS};

#[test]
fn a_headless_client_finds_the_session_presses_and_feels_the_floor() {
    let server = FakeServer::current();
    let forces = press::press(&server.endpoints).unwrap();
    println!("{forces:?}");
    assert_eq!(forces.len(), 10);
    // It begins above the floor, and its last pose is 20 mm below it.
    let deepest = FLOOR_STIFFNESS * (TOOL_RADIUS + 0.02);
    assert_eq!(forces[0], 0.0);
    assert!(forces[9] > 0.8 * deepest && forces[9] < 1.01 * deepest, "{forces:?} of {deepest}");
}
