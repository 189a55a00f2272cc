//! Local models for hands that are far away: a thread of its own looks at copies of the simulation and tells the force
//! output how stiff it is under each tool.

use super::Shared;
use super::health::Weight;
use palpate_core::contact::tool::MOST_TOOLS;
use palpate_core::feedback::relaxed::{Probe, Stiffness};
use palpate_core::simulation::Snapshot;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

/// What is known of each tool.
pub(super) type Models = [Option<Stiffness>; MOST_TOOLS];

/// How often a new copy is looked for: one comes every 32 ms.
const POLL: Duration = Duration::from_millis(2);

/// The running thread.
pub(super) struct LocalModels {
    stop: Arc<AtomicBool>,
    thread: std::thread::JoinHandle<()>,
}

impl LocalModels {
    pub(super) fn start(
        shared: &Shared,
        mut copies: triple_buffer::Output<Snapshot>,
    ) -> std::io::Result<(Self, triple_buffer::Output<Models>)> {
        let (mut models, newest) = triple_buffer::triple_buffer(&Models::default());
        let (body, settings) = (shared.body.clone(), shared.scene.settings());
        let stop = Arc::new(AtomicBool::new(false));
        let (stopped, watch) = (stop.clone(), shared.health.watch("the thread of the local models", Weight::Degrades));
        let thread = std::thread::Builder::new().name("local models".into()).spawn(move || {
            let _watch = watch;
            let mut probe = match Probe::new(body, settings) {
                Ok(probe) => probe,
                Err(reason) => return tracing::error!(reason, "no local models"),
            };
            while !stopped.load(Ordering::Relaxed) {
                if copies.updated() {
                    models.write(probe.stiffness(copies.read()));
                }
                std::thread::sleep(POLL);
            }
        })?;
        Ok((Self { stop, thread }, newest))
    }

    pub(super) fn stop(self) {
        self.stop.store(true, Ordering::Relaxed);
        let _ = self.thread.join();
    }
}
