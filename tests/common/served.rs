//! The program as a server of its own.
#![allow(dead_code, reason = "each test uses a part")]

use std::net::TcpListener;
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
        let taken: Vec<TcpListener> = (0..2).map(|_| TcpListener::bind("127.0.0.1:0").unwrap()).collect();
        let endpoint = |i: usize| format!("tcp/127.0.0.1:{}", taken[i].local_addr().unwrap().port());
        let endpoints = [endpoint(0), endpoint(1)];
        drop(taken);
        Self::at(serve, arguments, endpoints)
    }

    /// Starts `serve`, which runs the program, with `arguments` at `endpoints`, and waits until it answers.
    pub fn at(mut serve: Command, arguments: &[&str], endpoints: [String; 2]) -> Self {
        serve.arg("serve").args(arguments).arg("--until-input-ends");
        serve.args(["--force-endpoint", &endpoints[0], "--surface-endpoint", &endpoints[1]]);
        let process = serve.stdin(Stdio::piped()).stdout(Stdio::null()).spawn().unwrap();
        let session = arguments.iter().skip_while(|argument| **argument != "--session").nth(1);
        let session = session.map_or_else(|| palpate_sdk::Endpoints::default().session, |name| (*name).to_owned());
        let surface = palpate_sdk::Endpoints { surface: endpoints[1].clone(), session, ..Default::default() };
        let is_up = || palpate_sdk::Connection::open_surface(&surface).is_ok_and(|c| c.session().is_ok());
        assert!((0..20).any(|_| is_up()), "the server does not come up");
        Self { process, endpoints }
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
