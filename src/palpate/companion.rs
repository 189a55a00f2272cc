//! Another command of this program beside it, as a process of its own.

use crate::ServerArgs;
use anyhow::Context;
use std::cell::RefCell;
use std::process::{Child, Command, Stdio};

/// A process that was started; it ends when this is dropped.
pub struct Companion(RefCell<Child>);

impl Companion {
    /// Starts `command`, the name of one that connects to a server, with its options.
    pub fn start(command: &[&str], server: &ServerArgs) -> anyhow::Result<Self> {
        let child = Command::new(std::env::current_exe().context("where this program is")?)
            .args(command)
            .args(["--session", &server.session])
            .args(["--surface-endpoint", &server.surface_endpoint])
            .args(["--force-endpoint", &server.force_endpoint])
            .stdin(Stdio::null())
            .spawn()
            .with_context(|| format!("starting palpate {}", command.join(" ")))?;
        Ok(Self(RefCell::new(child)))
    }

    /// True when it has ended, or never began.
    pub fn has_ended(&self) -> bool {
        self.0.borrow_mut().try_wait().map_or(true, |ended| ended.is_some())
    }

    /// True when it ended because it could not go on: it says why itself, on standard error.
    pub fn has_failed(&self) -> bool {
        let ended = self.0.borrow_mut().try_wait();
        ended.is_ok_and(|ended| ended.is_some_and(|status| status.code().is_some_and(|code| code != 0)))
    }
}

impl Drop for Companion {
    fn drop(&mut self) {
        let child = self.0.get_mut();
        let _ = child.kill();
        let _ = child.wait();
    }
}
