//! Who watches the watchers: every thread and task of the server says when it ends without having been asked to.

use palpate_proto as proto;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use tokio::sync::watch;
use tokio::task::JoinHandle;

/// How much depends on a part.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Weight {
    /// Hands are served without it.
    Degrades,
    /// Without it the server cannot go on.
    Fails,
}

/// How the server as a whole is doing: what has gone wrong since it started.
pub(super) struct Health {
    /// The server is being stopped: what ends now was asked to.
    stopping: AtomicBool,
    faults: watch::Sender<Vec<(Weight, String)>>,
}

impl Health {
    pub(super) fn new() -> Arc<Self> {
        Arc::new(Self { stopping: AtomicBool::new(false), faults: watch::channel(Vec::new()).0 })
    }

    /// Says that something has gone wrong.
    pub(super) fn report(&self, weight: Weight, what: String) {
        match weight {
            Weight::Degrades => tracing::warn!(fault = what, "degraded"),
            Weight::Fails => tracing::error!(fault = what, "failed"),
        }
        self.faults.send_modify(|faults| faults.push((weight, what)));
    }

    /// For the thread or task `part`, which keeps it until it ends.
    pub(super) fn watch(self: &Arc<Self>, part: &'static str, weight: Weight) -> Watch {
        Watch { health: self.clone(), part, weight }
    }

    /// Runs `work` as a task that is watched.
    pub(super) fn spawn(
        self: &Arc<Self>,
        part: &'static str,
        weight: Weight,
        work: impl Future<Output = ()> + Send + 'static,
    ) -> JoinHandle<()> {
        let watch = self.watch(part, weight);
        tokio::spawn(async move {
            let _watch = watch;
            work.await;
        })
    }

    /// From now on parts end because they were asked to.
    pub(super) fn stop(&self) {
        self.stopping.store(true, Ordering::Relaxed);
    }

    /// As the status says it: the state, and what has gone wrong.
    pub(super) fn status(&self) -> (proto::Health, Vec<String>) {
        let faults = self.faults.borrow();
        let is_any = |weight| faults.iter().any(|fault| fault.0 == weight);
        let state = match (is_any(Weight::Fails), is_any(Weight::Degrades)) {
            (true, _) => proto::Health::Failed,
            (false, true) => proto::Health::Degraded,
            (false, false) => proto::Health::Serving,
        };
        (state, faults.iter().map(|fault| fault.1.clone()).collect())
    }

    /// Comes back when the server cannot go on.
    pub(super) async fn failed(&self) {
        let is_failed = |faults: &Vec<(Weight, String)>| faults.iter().any(|fault| fault.0 == Weight::Fails);
        // The sender lives as long as this does.
        let _ = self.faults.subscribe().wait_for(is_failed).await;
    }
}

/// Kept by a thread or a task; that it is dropped means that this has ended, by a panic or of itself.
pub(super) struct Watch {
    health: Arc<Health>,
    part: &'static str,
    weight: Weight,
}

impl Drop for Watch {
    fn drop(&mut self) {
        if !self.health.stopping.load(Ordering::Relaxed) {
            self.health.report(self.weight, format!("{} ended", self.part));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::time::Duration;

    #[test]
    fn a_thread_that_panics_and_a_task_that_ends_are_told_at_once() {
        let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build().unwrap();
        runtime.block_on(async {
            let health = Health::new();
            assert_eq!(health.status(), (proto::Health::Serving, vec![]));
            let watch = health.watch("the thread of the local models", Weight::Degrades);
            let thread = std::thread::spawn(move || {
                let _watch = watch;
                panic!("as this test wants it to");
            });
            assert!(thread.join().is_err());
            assert_eq!(
                health.status(),
                (proto::Health::Degraded, vec!["the thread of the local models ended".to_owned()])
            );
            let task = health.spawn("the task of control", Weight::Fails, std::future::ready(()));
            tokio::time::timeout(Duration::from_secs(10), health.failed()).await.unwrap();
            task.await.unwrap();
            let (state, faults) = health.status();
            assert_eq!((state, faults[1].as_str()), (proto::Health::Failed, "the task of control ended"));
        });
    }

    #[test]
    fn what_ends_while_the_server_stops_is_no_fault() {
        let health = Health::new();
        let watch = health.watch("the simulation thread", Weight::Fails);
        health.stop();
        drop(watch);
        assert_eq!(health.status(), (proto::Health::Serving, vec![]));
    }
}
