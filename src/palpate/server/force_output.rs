//! Wrenches out: a real-time thread that sends what the last tick said, once per tick.

use super::health::Weight;
use super::local_model::Models;
use super::{ServerError, Shared, network};
use crate::realtime::clock::{Clock, Monotonic};
use crate::realtime::mailbox::TickReport;
use crate::realtime::scheduling;
use crate::wire;
use palpate_core::contact::tool::{MOST_TOOLS, Phase};
use palpate_core::feedback::LocalModel;
use palpate_proto::{Message, keys};
use rustix::fd::OwnedFd;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use zenoh::Wait;
use zenoh::pubsub::Publisher;
use zenoh::qos::{CongestionControl, Priority};

/// The running thread.
pub(super) struct ForceOutput {
    stop: Arc<AtomicBool>,
    wake: Arc<OwnedFd>,
    thread: std::thread::JoinHandle<()>,
}

impl ForceOutput {
    pub(super) fn start(
        shared: &Arc<Shared>,
        session: &zenoh::Session,
        reports: rtrb::Consumer<TickReport>,
        models: triple_buffer::Output<Models>,
        wake: Arc<OwnedFd>,
    ) -> Result<Self, ServerError> {
        let publishers = (0..shared.scene.tool.len() as u32)
            .map(|tool| {
                session
                    .declare_publisher(keys::tool_wrench(&shared.options.session, tool))
                    .priority(Priority::RealTime)
                    .express(true)
                    .congestion_control(CongestionControl::Drop)
                    .wait()
                    .map_err(network)
            })
            .collect::<Result<Vec<_>, _>>()?;
        let stop = Arc::new(AtomicBool::new(false));
        let watch = shared.health.watch("the thread of the force output", Weight::Fails);
        let (shared, stopped, waker) = (shared.clone(), stop.clone(), wake.clone());
        let thread = std::thread::Builder::new().name("force output".into()).spawn(move || {
            let _watch = watch;
            if scheduling::fifo(scheduling::FORCE_OUTPUT).is_err() {
                tracing::debug!("the force output runs at normal priority");
            }
            send(&shared, &publishers, reports, models, &waker, &stopped);
        })?;
        Ok(Self { stop, wake, thread })
    }

    pub(super) fn stop(self) {
        self.stop.store(true, Ordering::Relaxed);
        let _ = rustix::io::write(&self.wake, &1u64.to_ne_bytes());
        let _ = self.thread.join();
    }
}

/// Age of a tick [ns] from which its wrench is not sent any more: clients let a force fall from this age on.
const STALE_NS: u64 = 20_000_000;

fn send(
    shared: &Shared,
    publishers: &[Publisher<'_>],
    mut reports: rtrb::Consumer<TickReport>,
    mut models: triple_buffer::Output<Models>,
    wake: &OwnedFd,
    stop: &AtomicBool,
) {
    let mut sequence = [0u64; MOST_TOOLS];
    let mut local = [LocalModel::default(); MOST_TOOLS];
    let mut bytes = Vec::with_capacity(512);
    while !stop.load(Ordering::Relaxed) {
        let mut count = [0u8; 8];
        if rustix::io::read(wake, &mut count).is_err() {
            continue;
        }
        // After a burst only the newest force matters; the others leave a gap in the sequence.
        let mut newest = None;
        while let Ok(report) = reports.pop() {
            (0..publishers.len()).filter(|i| is_heard(&report, *i)).for_each(|i| sequence[i] += 1);
            if newest.replace(report).is_some() {
                shared.counters.wrenches_skipped.fetch_add(1, Ordering::Relaxed);
            }
        }
        // What was found before the process stood still is no force of now: the hand has let go of it since.
        let is_old = |report: &TickReport| Monotonic.now().saturating_sub(report.began) > STALE_NS;
        let Some(report) = newest.filter(|report| !is_old(report)) else { continue };
        let stiffness = models.read();
        for (i, publisher) in publishers.iter().enumerate() {
            let tool = &report.tools[i];
            if !is_heard(&report, i) {
                continue;
            }
            let mut wrench = wire::wrench(i as u32, report.tick, sequence[i], tool, report.flags);
            wire::add_model(&mut wrench, local[i].update(tool, &stiffness[i]));
            bytes.clear();
            // A Vec grows as it needs to: encoding into it cannot fail.
            let _ = wrench.encode(&mut bytes);
            if publisher.put(bytes.as_slice()).wait().is_ok() {
                shared.counters.wrenches_sent.fetch_add(1, Ordering::Relaxed);
            }
        }
    }
}

/// True while a client may listen to tool `i`: one whose poses stopped is told so, and hears its force fade.
fn is_heard(report: &TickReport, i: usize) -> bool {
    let tool = &report.tools[i].state;
    tool.phase != Phase::Detached || tool.epoch != 0
}
