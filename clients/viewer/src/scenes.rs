//! Servers of bundled scenes, for who has none running yet: processes of their own that end with this one.

use palpate_sdk::Endpoints;
use std::net::TcpListener;
use std::path::PathBuf;
use std::process::{Child, Command, Stdio};

/// What can be served, and by which program.
#[derive(Clone, Debug)]
pub struct Scenes {
    /// The server's program: understands `serve --scene NAME`.
    pub program: PathBuf,
    /// Its bundled scenes.
    pub names: Vec<String>,
}

/// A server that was started for this viewer; it ends when this is dropped, or when the viewer dies.
pub(crate) struct LocalServer {
    child: Child,
    endpoints: Endpoints,
}

impl Scenes {
    /// Starts a server of scene `name` on free ports of this machine. Errors: why it cannot be started, for people.
    pub(crate) fn start(&self, name: &str) -> Result<LocalServer, String> {
        let (force, surface) = (free_endpoint()?, free_endpoint()?);
        let endpoints = Endpoints { force, surface, ..Endpoints::default() };
        let child = Command::new(&self.program)
            .args(["serve", "--until-input-ends", "--scene", name])
            .args(["--force-endpoint", &endpoints.force, "--surface-endpoint", &endpoints.surface])
            .stdin(Stdio::piped())
            .stdout(Stdio::null())
            .spawn()
            .map_err(|e| format!("cannot start {}: {e}", self.program.display()))?;
        Ok(LocalServer { child, endpoints })
    }
}

/// A port that nobody listens on now.
fn free_endpoint() -> Result<String, String> {
    let port = TcpListener::bind("127.0.0.1:0").and_then(|listener| listener.local_addr());
    port.map(|address| format!("tcp/{address}")).map_err(|e| format!("no free port on this machine: {e}"))
}

impl LocalServer {
    pub(crate) fn endpoints(&self) -> &Endpoints {
        &self.endpoints
    }
}

impl Drop for LocalServer {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}
