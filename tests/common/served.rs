//! The program as a server of its own.
#![allow(dead_code)] // each test uses a part

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
        Self::of(program, &["--scene", "cube", "--set", "world.gravity=[0.0, 0.0, 0.0]"])
    }

    /// The same with other arguments.
    pub fn of(program: &Path, arguments: &[&str]) -> Self {
        let taken: Vec<TcpListener> = (0..2).map(|_| TcpListener::bind("127.0.0.1:0").unwrap()).collect();
        let endpoint = |i: usize| format!("tcp/127.0.0.1:{}", taken[i].local_addr().unwrap().port());
        let endpoints = [endpoint(0), endpoint(1)];
        drop(taken);
        let mut serve = Command::new(program);
        serve.arg("serve").args(arguments).arg("--until-input-ends");
        serve.args(["--force-endpoint", &endpoints[0], "--surface-endpoint", &endpoints[1]]);
        let process = serve.stdin(Stdio::piped()).stdout(Stdio::null()).spawn().unwrap();
        let surface = palpate_sdk::Endpoints { surface: endpoints[1].clone(), ..Default::default() };
        let is_up = || palpate_sdk::Connection::open_surface(&surface).is_ok_and(|c| c.session().is_ok());
        assert!((0..20).any(|_| is_up()), "the server does not come up");
        Self { process, endpoints }
    }
}

impl Drop for Served {
    fn drop(&mut self) {
        drop(self.process.stdin.take());
        let _ = self.process.wait();
    }
}
