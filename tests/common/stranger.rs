//! A zenoh session that keeps to no contract.
#![allow(dead_code, reason = "each test uses a part")]

use palpate_proto::{self as proto, Message as _, keys};
use std::process::{Child, Command, Stdio};
use std::time::Duration;
use zenoh::Wait as _;
use zenoh::qos::CongestionControl;

pub const SESSION: &str = keys::DEFAULT_SESSION;

/// Somebody without the sdk's care.
pub fn stranger(endpoint: &str) -> zenoh::Session {
    stranger_with(endpoint, vec![])
}

/// The same with more settings of zenoh.
pub fn stranger_with(endpoint: &str, settings: Vec<(String, String)>) -> zenoh::Session {
    let mut config = zenoh::Config::default();
    for (key, value) in [
        ("mode", "\"client\"".to_owned()),
        ("connect/endpoints", format!("[{endpoint:?}]")),
        ("scouting/multicast/enabled", "false".into()),
    ] {
        config.insert_json5(key, &value).unwrap();
    }
    for (key, value) in settings {
        config.insert_json5(&key, &value).unwrap();
    }
    zenoh::open(config).wait().unwrap()
}

/// A wrench that pushes sideways with all that there is.
pub fn forged(epoch: u32, sequence: u64, tick: u64) -> Vec<u8> {
    let force = vec![3.3, 0.0, 0.0];
    let wrench = proto::ToolWrench {
        epoch,
        sequence,
        tick,
        position: vec![0.0; 3],
        orientation: vec![0.0, 0.0, 0.0, 1.0],
        physical_force: force.clone(),
        physical_torque: vec![0.0; 3],
        force,
        torque: vec![0.0; 3],
        phase: proto::ToolPhase::Engaged.into(),
        ..Default::default()
    };
    wrench.encode_to_vec()
}

/// Set for the process that asks, as slow callbacks would hold up the hand in their own: the endpoint of the server.
const ASKER: &str = "PALPATE_TEST_ASKER";

/// Asks for everything a thousand times, and takes a fifth of a second for each answer, for ever.
fn ask(endpoint: &str) {
    let session = stranger(endpoint);
    for _ in 0..1000 {
        let attach = keys::control(SESSION, "attach", keys::ANYBODY);
        for key in [keys::surface_topology(SESSION), keys::session(SESSION), attach] {
            let slow = |_| std::thread::sleep(Duration::from_millis(200));
            // Where the server has cut it off, there is nothing more to ask.
            let _ = session.get(key).congestion_control(CongestionControl::Block).callback(slow).wait();
        }
    }
    std::thread::park();
}

/// True in a process that was started to ask, once it has.
pub fn asks() -> bool {
    std::env::var(ASKER).is_ok_and(|endpoint| {
        ask(&endpoint);
        true
    })
}

/// Starts a process that asks the server at `endpoint`: the test `name` of this program, which begins with `asks`.
pub fn asker(endpoint: &str, name: &str) -> Child {
    Command::new(std::env::current_exe().unwrap())
        .args([name, "--exact"])
        .env(ASKER, endpoint)
        .stdout(Stdio::null())
        .spawn()
        .unwrap()
}
