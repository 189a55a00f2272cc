//! What holds when something breaks: the server as a process of its own, and what is done to it.
#![cfg(target_os = "linux")] // signals, and the server itself

mod faults;
mod hand;
mod matrix;
#[path = "../common/random.rs"]
mod random;
#[path = "../common/roads.rs"]
mod roads;
mod roles;
#[path = "../common/served.rs"]
mod served;
mod sites;
mod stopped;
#[path = "../common/stranger.rs"]
mod stranger;
mod strangers;

/// What replay, with more `arguments`, says of `recording`, and its exit code.
fn replayed(recording: &std::path::Path, arguments: &[&str]) -> (Option<i32>, String) {
    let mut replay = std::process::Command::new(env!("CARGO_BIN_EXE_palpate"));
    let outcome = replay.arg("replay").arg(recording).args(arguments).output().unwrap();
    let said = [outcome.stdout, outcome.stderr].concat();
    (outcome.status.code(), String::from_utf8_lossy(&said).into_owned())
}
