//! `palpate web`: a server in a process of its own, a gateway, and pages that are WebSockets.

mod browser;
mod decoder;
mod door;
mod faults;
mod hands;
mod memory;
mod pictures;
mod roles;

#[path = "../common/random.rs"]
mod random;
#[path = "../common/secured.rs"]
mod secured;
#[path = "../common/served.rs"]
mod served;
#[path = "../common/textured_cube.rs"]
mod textured_cube;

use browser::{Page, Visitor};
use palpate_sdk::Endpoints;
use palpate_web::{Gateway, Options, Rights};
use served::ports;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

/// Endpoints of two ports that nobody listens on.
fn free_endpoints() -> Endpoints {
    let [force, surface] = [0, 1].map(|_| ports::free_endpoint());
    Endpoints { force, surface, session: "main".into(), identity: None }
}

/// A server of a weightless cube with two balls, in a process of its own; it is killed when this is dropped.
struct Server(Child);

impl Server {
    fn start(endpoints: &Endpoints) -> Self {
        let tools = "tool=[{name=\"left\", radius=0.02}, {name=\"right\", radius=0.02}]";
        Self::of("cube", &["--set", "world.gravity=[0.0, 0.0, 0.0]", "--set", tools], endpoints)
    }

    /// A server of `scene`, with more arguments.
    fn of(scene: &str, arguments: &[&str], endpoints: &Endpoints) -> Self {
        let child = Command::new(env!("CARGO_BIN_EXE_palpate"))
            .args(["serve", "--scene", scene])
            .args(arguments)
            .args(["--force-endpoint", &endpoints.force, "--surface-endpoint", &endpoints.surface])
            .stdin(Stdio::null())
            .stdout(Stdio::null())
            .spawn()
            .unwrap();
        Self(child)
    }

    fn kill(mut self) {
        self.0.kill().unwrap();
        self.0.wait().unwrap();
    }
}

impl Drop for Server {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

/// A gateway on a port of its own.
struct Web {
    runtime: tokio::runtime::Runtime,
    gateway: Option<Gateway>,
}

impl Web {
    fn start(endpoints: &Endpoints) -> Self {
        Self::with(Options {
            endpoints: endpoints.clone(),
            listen: "127.0.0.1:0".parse().unwrap(),
            tls: None,
            origins: vec![],
            view_only: false,
        })
    }

    fn with(options: Options) -> Self {
        let runtime = tokio::runtime::Builder::new_multi_thread().enable_all().worker_threads(2).build().unwrap();
        let gateway = Some(runtime.block_on(Gateway::start(options)).unwrap());
        Self { runtime, gateway }
    }

    fn gateway(&self) -> &Gateway {
        self.gateway.as_ref().unwrap()
    }

    /// A browser that was let in.
    fn visitor(&self, rights: Rights) -> Visitor {
        Visitor::enter(&self.gateway().invite(rights))
    }

    /// A page that is open.
    fn page(&self, rights: Rights) -> Page {
        self.visitor(rights).page()
    }
}

impl Drop for Web {
    fn drop(&mut self) {
        if let Some(gateway) = self.gateway.take() {
            self.runtime.block_on(gateway.stop());
        }
    }
}

/// Looks every millisecond; a minute is long enough for a machine on which much else runs.
fn wait_for(what: &str, mut done: impl FnMut() -> bool) {
    let began = Instant::now();
    while !done() {
        assert!(began.elapsed() < Duration::from_secs(60), "waited in vain: {what}");
        std::thread::sleep(Duration::from_millis(1));
    }
}
