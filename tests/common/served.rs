//! The program as a server of its own.

use std::net::TcpListener;
use std::path::Path;
use std::process::{Child, Command, Stdio};

/// A server of the cube, until it is dropped.
pub struct Served {
    process: Child,
    /// Of forces, and of the surface.
    pub endpoints: [String; 2],
}

#[allow(dead_code, reason = "of what it can do every test uses a part")]
impl Served {
    /// Starts `program`, and waits until it answers.
    pub fn start(program: &Path) -> Self {
        Self::start_with(Command::new(program), &[])
    }

    /// Starts `serve`, which runs the program, with more arguments for it, and waits until it answers.
    pub fn start_with(mut serve: Command, more: &[&str]) -> Self {
        let taken: Vec<TcpListener> = (0..2).map(|_| TcpListener::bind("127.0.0.1:0").unwrap()).collect();
        let endpoint = |i: usize| format!("tcp/127.0.0.1:{}", taken[i].local_addr().unwrap().port());
        let endpoints = [endpoint(0), endpoint(1)];
        drop(taken);
        serve.args(["serve", "--scene", "cube", "--set", "world.gravity=[0.0, 0.0, 0.0]", "--until-input-ends"]);
        serve.args(["--force-endpoint", &endpoints[0], "--surface-endpoint", &endpoints[1]]);
        let process = serve.args(more).stdin(Stdio::piped()).stdout(Stdio::null()).spawn().unwrap();
        let surface = palpate_sdk::Endpoints { surface: endpoints[1].clone(), ..Default::default() };
        let is_up = || palpate_sdk::Connection::open_surface(&surface).is_ok_and(|c| c.session().is_ok());
        assert!((0..20).any(|_| is_up()), "the server does not come up");
        Self { process, endpoints }
    }
}

#[allow(dead_code, reason = "not every test sends signals")]
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
