//! How the server fares: measured from the ticks' own reports, published once a second.

use super::health::Weight;
use super::{ServerError, Shared, metrics, network};
use crate::realtime::mailbox::{Dropped, RecordTap, TickTiming};
use crate::realtime::scheduling;
use hdrhistogram::Histogram;
use palpate_core::model::step_class::TICK_NS;
use palpate_core::simulation::{Part, Prices};
use palpate_proto::{self as proto, Message, keys};
use std::collections::VecDeque;
use std::sync::Arc;
use std::sync::atomic::{AtomicU32, AtomicU64, Ordering};
use std::time::{Duration, Instant};
use tokio::sync::{mpsc, oneshot, watch};

/// Counted by the parts of the server.
#[derive(Debug, Default)]
pub(super) struct Counters {
    pub(super) tick: AtomicU64,
    pub(super) wrenches_sent: AtomicU64,
    pub(super) wrenches_skipped: AtomicU64,
    pub(super) surface_frames: AtomicU64,
}

/// What the status is made from.
pub(super) struct Sources {
    pub(super) timings: rtrb::Consumer<TickTiming>,
    pub(super) retired: rtrb::Consumer<Box<RecordTap>>,
    pub(super) dropped: Arc<Dropped>,
    pub(super) others: Arc<AtomicU32>,
}

/// Ticks before the clock is judged: the first ones fault in pages and warm up caches.
const WARM_UP_TICKS: u64 = 500;

/// Ticks of a second in which the body may stand still before the user is told.
const MOST_UNMOVED: u64 = 100;

/// Sums over the run.
struct Sums {
    lateness: Histogram<u64>,
    compute: Histogram<u64>,
    ticks: u64,
    late: u64,
    missed: u64,
    missed_away: u64,
    lapsed: u64,
    stalls: u64,
    unmoved_ticks: u64,
    splits: u64,
    merges: u64,
    restored: u64,
    last: Option<TickTiming>,
    prices: Option<Prices>,
}

impl Sums {
    fn new() -> Self {
        // Nanoseconds up to a minute, three digits.
        let histogram =
            || Histogram::new_with_bounds(1, 60_000_000_000, 3).unwrap_or_else(|_| unreachable!("valid bounds"));
        Self {
            lateness: histogram(),
            compute: histogram(),
            ticks: 0,
            late: 0,
            missed: 0,
            missed_away: 0,
            lapsed: 0,
            stalls: 0,
            unmoved_ticks: 0,
            splits: 0,
            merges: 0,
            restored: 0,
            last: None,
            prices: None,
        }
    }

    fn add(&mut self, t: TickTiming) {
        self.ticks += 1;
        metrics::tick(&t);
        if self.ticks > WARM_UP_TICKS {
            self.lateness.saturating_record(t.lateness.max(1));
            self.compute.saturating_record(t.compute.max(1));
            self.late += u64::from(t.lateness >= TICK_NS);
            self.missed += u64::from(t.missed);
            self.missed_away += u64::from(t.missed && t.was_away());
        }
        self.lapsed += u64::from(t.lapsed);
        self.stalls += u64::from(t.lapsed > 0);
        self.unmoved_ticks += u64::from(t.plan.taken < t.plan.needed);
        self.splits += u64::from(t.adapted.splits);
        self.merges += u64::from(t.adapted.merges);
        self.restored += u64::from(t.restored);
        self.last = Some(t);
        self.prices = t.prices.or(self.prices);
    }
}

fn distribution(histogram: &Histogram<u64>) -> proto::Distribution {
    let micros = |ns: u64| ns as f64 / 1e3;
    proto::Distribution {
        p50: micros(histogram.value_at_quantile(0.5)),
        p99: micros(histogram.value_at_quantile(0.99)),
        p999: micros(histogram.value_at_quantile(0.999)),
        max: micros(histogram.max()),
        count: histogram.len(),
    }
}

/// Gathers ten times a second into `live`, publishes every tenth; a request on `flush` is answered once everything
/// that the simulation thread left behind is in.
pub(super) async fn publish(
    shared: &Arc<Shared>,
    session: &zenoh::Session,
    mut sources: Sources,
    live: watch::Sender<proto::Status>,
    mut flush: mpsc::Receiver<oneshot::Sender<()>>,
) -> Result<tokio::task::JoinHandle<()>, ServerError> {
    let publisher = session.declare_publisher(keys::status(&shared.options.session)).await.map_err(network)?;
    let shared = shared.clone();
    Ok(shared.clone().health.spawn("the task of the status", Weight::Degrades, async move {
        let mut sums = Sums::new();
        metrics::describe();
        let mut interval = tokio::time::interval(Duration::from_millis(100));
        interval.set_missed_tick_behavior(tokio::time::MissedTickBehavior::Delay);
        let (mut rounds, mut second, mut warned) = (0u64, Second::begin(&sums, &shared), false);
        loop {
            let done = tokio::select! {
                _ = interval.tick() => None,
                done = flush.recv() => done,
            };
            while let Ok(timing) = sources.timings.pop() {
                sums.add(timing);
            }
            // Dropping a tap tells its recorder that the recording is over.
            while sources.retired.pop().is_ok() {}
            if let Some(last) = sums.last {
                shared.counters.tick.store(last.tick, Ordering::Relaxed);
            }
            rounds += 1;
            if rounds.is_multiple_of(10) {
                second.end(&sums, &shared);
                sources.others.store(second.others(), Ordering::Relaxed);
                second.warn(&sums, &mut warned);
                shared.holders.free_silent(&shared);
                shared.holders.free_flooded(&shared);
                shared.holders.tell_jumps(&shared);
            }
            let status = compose(&shared, &sums, &second, &sources.dropped);
            if rounds.is_multiple_of(10) {
                let frames = shared.counters.surface_frames.load(Ordering::Relaxed);
                metrics::status(&status, sums.ticks, frames, &shared.holders.pose_ages(&shared));
                let _ = publisher.put(status.encode_to_vec()).await;
            }
            live.send_replace(status);
            if let Some(done) = done {
                let _ = done.send(());
            }
        }
    }))
}

/// Seconds that [`Second::missed`] looks back.
const MINUTE: usize = 60;

/// Rates over the last whole second.
struct Second {
    began: Instant,
    ticks: u64,
    frames: u64,
    tick_rate: f64,
    frame_rate: f64,
    /// Ticks in which the body stood still until now, and in this second.
    unmoved: (u64, u64),
    /// Processor time of the real-time threads until now [ns], and their share of a processor in this second: the simulation
    /// thread, and all others.
    used: Option<(u64, u64)>,
    share: (f64, f64),
    /// Deadlines missed for want of time until now, at the end of each of the last seconds.
    missed: VecDeque<u64>,
}

impl Second {
    fn begin(sums: &Sums, shared: &Shared) -> Self {
        let frames = shared.counters.surface_frames.load(Ordering::Relaxed);
        let unmoved = (sums.unmoved_ticks, 0);
        Self {
            began: Instant::now(),
            ticks: sums.ticks,
            frames,
            tick_rate: 0.0,
            frame_rate: 0.0,
            unmoved,
            used: scheduling::real_time_use(),
            share: (0.0, 0.0),
            missed: VecDeque::from([sums.missed - sums.missed_away]),
        }
    }

    /// What the other real-time threads took of each tick [ns].
    fn others(&self) -> u32 {
        (self.share.1 * TICK_NS as f64) as u32
    }

    /// Deadlines missed for want of time, over the last minute.
    fn missed_per_minute(&self) -> f64 {
        let seconds = self.missed.len().saturating_sub(1).max(1);
        let missed = self.missed.back().unwrap_or(&0) - self.missed.front().unwrap_or(&0);
        missed as f64 * MINUTE as f64 / seconds as f64
    }

    fn end(&mut self, sums: &Sums, shared: &Shared) {
        let seconds = self.began.elapsed().as_secs_f64();
        let next = Second::begin(sums, shared);
        let tick_rate = (next.ticks - self.ticks) as f64 / seconds;
        let frame_rate = (next.frames - self.frames) as f64 / seconds;
        let unmoved = (sums.unmoved_ticks, sums.unmoved_ticks - self.unmoved.0);
        let share = match (self.used, next.used) {
            // Where a thread has ended meanwhile, nothing can be said.
            (Some(before), Some(now)) if now.0 >= before.0 && now.1 >= before.1 => {
                let part = |before: u64, now: u64| (now - before) as f64 / 1e9 / seconds;
                (part(before.0, now.0), part(before.1, now.1))
            }
            _ => self.share,
        };
        let mut missed = std::mem::take(&mut self.missed);
        missed.extend(&next.missed);
        if missed.len() > MINUTE + 1 {
            missed.pop_front();
        }
        *self = Second { tick_rate, frame_rate, unmoved, share, missed, ..next };
    }

    /// Says once that the machine cannot carry the body.
    fn warn(&self, sums: &Sums, warned: &mut bool) {
        let Some(last) = sums.last.filter(|_| self.unmoved.1 > MOST_UNMOVED && !*warned) else { return };
        *warned = true;
        tracing::warn!(
            "the body stood still in {} ticks of the last second: it takes {} µs of a tick, and this machine has {} µs; \
             choose a coarser body, or no body.active_level",
            self.unmoved.1,
            last.plan.needed / 1000,
            last.budget.planned / 1000
        );
    }
}

/// What each part of a tick costs, to be told.
fn part_costs(prices: &Prices) -> Vec<proto::PartCost> {
    let cost = |part: Part| {
        let (name, of) = part.describe();
        proto::PartCost { part: name, of: of.into(), ns: f64::from(prices.0[part.index()]) / 1e3 }
    };
    Part::ALL.into_iter().map(cost).collect()
}

fn compose(shared: &Shared, sums: &Sums, second: &Second, dropped: &Dropped) -> proto::Status {
    let last = sums.last;
    let (health, faults) = shared.health.status();
    let load = |counter: &AtomicU64| counter.load(Ordering::Relaxed);
    proto::Status {
        tick: last.map_or(0, |t| t.tick),
        tick_rate_hz: second.tick_rate,
        lateness_us: Some(distribution(&sums.lateness)),
        compute_us: Some(distribution(&sums.compute)),
        late_ticks: sums.late,
        missed_deadlines: sums.missed,
        lapsed_ticks: sums.lapsed,
        stalls: sums.stalls,
        unmoved_ticks: sums.unmoved_ticks,
        restored_states: sums.restored,
        nodes: last.map_or(0, |t| t.active.iter().map(|n| u64::from(*n)).sum()),
        elements: last.map_or(0, |t| u64::from(t.elements)),
        element_evaluations: last.map_or(0, |t| u64::from(t.element_evaluations)),
        budget: last.map_or(0, |t| u64::from(t.budget.limit)),
        surface_frames_hz: second.frame_rate,
        wrenches_sent: load(&shared.counters.wrenches_sent),
        wrenches_skipped: load(&shared.counters.wrenches_skipped) + load(&dropped.reports),
        refused: shared
            .input
            .refused()
            .filter(|r| r.1 > 0)
            .map(|(reason, count)| proto::Refusal { reason: reason.into(), count })
            .collect(),
        recording: shared.recorder.status(),
        scheduling: shared.scheduling.clone(),
        active_nodes: last
            .map_or(vec![], |t| t.active[..shared.body.levels().len()].iter().map(|n| u64::from(*n)).collect()),
        splits: sums.splits,
        merges: sums.merges,
        work: last.map_or(0, |t| u64::from(t.plan.whole)),
        planned: last.map_or(0, |t| u64::from(t.budget.planned)),
        missed_away: sums.missed_away,
        missed_per_minute: second.missed_per_minute(),
        floor: u64::from(shared.measured.floor),
        real_time_share: second.share.0 + second.share.1,
        costs: sums.prices.map_or(vec![], |prices| part_costs(&prices)),
        clients: shared.holders.clients(|tool| shared.scene.tool[tool].name.clone()),
        health: health.into(),
        faults,
    }
}
