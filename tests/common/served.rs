//! The program as a server of its own.
#![allow(dead_code, reason = "each test uses a part")]

#[path = "ports.rs"]
pub mod ports;

use std::path::Path;
use std::process::{Child, Command, Stdio};

/// A server, until it is dropped.
pub struct Served {
    process: Child,
    /// Of forces, and of the surface.
    pub endpoints: [String; 2],
}

impl Served {
    /// Starts `program` with a weightless cube, and waits until it answers.
    pub fn start(program: &Path) -> Self {
        Self::start_with(Command::new(program), &[])
    }

    /// The same for `serve`, which runs the program, with more arguments for it.
    pub fn start_with(serve: Command, more: &[&str]) -> Self {
        Self::run(serve, &[&["--scene", "cube", "--set", "world.gravity=[0.0, 0.0, 0.0]"], more].concat())
    }

    /// Starts `program` with `arguments`, and waits until it answers.
    pub fn of(program: &Path, arguments: &[&str]) -> Self {
        Self::run(Command::new(program), arguments)
    }

    fn run(serve: Command, arguments: &[&str]) -> Self {
        let [force, surface] = [0, 1].map(|_| ports::free_endpoint());
        Self::at(serve, arguments, &palpate_sdk::Endpoints { force, surface, ..Default::default() })
    }

    /// Starts `serve`, which runs the program, at `endpoints` with `arguments`, and waits until it answers who owns their
    /// identity.
    pub fn at(mut serve: Command, arguments: &[&str], endpoints: &palpate_sdk::Endpoints) -> Self {
        let [force, surface] = [&endpoints.force, &endpoints.surface];
        serve.arg("serve").args(arguments).arg("--until-input-ends");
        serve.args(["--force-endpoint", force, "--surface-endpoint", surface]);
        let process = serve.stdin(Stdio::piped()).stdout(Stdio::null()).spawn().unwrap();
        let is_up = || palpate_sdk::Connection::open_surface(endpoints).is_ok_and(|c| c.session().is_ok());
        assert!((0..20).any(|_| is_up()), "the server does not come up");
        Self { process, endpoints: [force.clone(), surface.clone()] }
    }
}

impl Served {
    /// Number of its process.
    pub fn id(&self) -> u32 {
        self.process.id()
    }

    /// Waits until it has ended, by itself or by a signal; its exit code.
    pub fn code(&mut self) -> Option<i32> {
        self.process.wait().unwrap().code()
    }

    /// Sends it the signal `name`, as in `STOP`.
    pub fn signal(&self, name: &str) {
        let kill = format!("kill -{name} {}", self.process.id());
        assert!(Command::new("sh").args(["-c", &kill]).status().unwrap().success(), "{kill}");
    }
}

impl Drop for Served {
    fn drop(&mut self) {
        drop(self.process.stdin.take());
        let _ = self.process.wait();
    }
}

/// What replay, with more `arguments`, says of `recording`, and its exit code.
pub fn replayed(recording: &Path, arguments: &[&str]) -> (Option<i32>, String) {
    let mut replay = Command::new(env!("CARGO_BIN_EXE_palpate"));
    let outcome = replay.arg("replay").arg(recording).args(arguments).output().unwrap();
    let said = [outcome.stdout, outcome.stderr].concat();
    (outcome.status.code(), String::from_utf8_lossy(&said).into_owned())
}
