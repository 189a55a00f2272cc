//! A server that asks for certificates, and certificates for it.
#![allow(dead_code, reason = "each test uses a part")]

use super::served::Served;
use palpate_sdk::{Connection, Endpoints};
use std::net::UdpSocket;
use std::path::{Path, PathBuf};
use std::process::Command;

const PROGRAM: &str = env!("CARGO_BIN_EXE_palpate");

/// One of each role; the two operators share the tools.
pub const ROLES: &str = r#"
wall = { role = "viewer" }
anna = { role = "operator", tools = ["left"] }
bert = { role = "operator", tools = ["right"] }
ines = { role = "instructor" }
root = { role = "admin" }
"#;

/// A weightless cube with the tools left and right.
pub const SCENE: [&str; 8] = [
    "--scene",
    "cube",
    "--set",
    "world.gravity=[0.0, 0.0, 0.0]",
    "--set",
    "body.cells=[[5,5,5]]",
    "--set",
    "tool=[{name=\"left\", radius=0.02}, {name=\"right\", radius=0.02}]",
];

/// A server that asks for certificates, and the folder in which those are, in `certificates`.
pub struct Secured {
    pub served: Served,
    pub folder: tempfile::TempDir,
}

impl Secured {
    pub fn start() -> Self {
        let folder = tempfile::tempdir().unwrap();
        certificates(folder.path(), ROLES, "certificates");
        let free = || format!("quic/{}", UdpSocket::bind("127.0.0.1:0").unwrap().local_addr().unwrap());
        let identity = Some(folder.path().join("certificates/clients/wall"));
        let endpoints = Endpoints { force: free(), surface: free(), identity, ..Endpoints::default() };
        let mut serve = Command::new(PROGRAM);
        serve.current_dir(folder.path());
        let trust = ["--identity", "certificates/server", "--roles", "roles.toml"];
        Self { served: Served::at(serve, &[&SCENE[..], &trust].concat(), &endpoints), folder }
    }

    /// For whoever has the certificate in `identity`, below the folder.
    pub fn endpoints(&self, identity: Option<&str>) -> Endpoints {
        let identity = identity.map(|identity| self.folder.path().join(identity));
        let [force, surface] = self.served.endpoints.clone();
        Endpoints { force, surface, identity, ..Endpoints::default() }
    }

    /// Folder of the certificate of `name`.
    pub fn certificate(&self, name: &str) -> PathBuf {
        self.folder.path().join("certificates/clients").join(name)
    }

    pub fn connect(&self, name: &str) -> Connection {
        Connection::open(&self.endpoints(Some(&format!("certificates/clients/{name}")))).unwrap()
    }
}

/// Makes certificates for `roles` in `out` below `folder`; what the command says.
pub fn certificates(folder: &Path, roles: &str, out: &str) -> String {
    std::fs::write(folder.join("roles.toml"), roles).unwrap();
    let mut command = Command::new(PROGRAM);
    command.args(["certificates", "--roles", "roles.toml", "--out", out]).current_dir(folder);
    let made = command.output().unwrap();
    assert!(made.status.success(), "{}", String::from_utf8_lossy(&made.stderr));
    String::from_utf8_lossy(&made.stdout).into_owned()
}
