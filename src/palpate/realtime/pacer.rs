//! Absolute deadlines at 1 kHz, and what to do about ticks that were missed.
//!
//! A machine that was away for a few ticks catches up by running them back to back; after a longer stall the rest
//! lapses: time passes for the body without motion. Either way simulated time is within one tick of the wall clock
//! again 5 ms after the stall, and nothing accumulates.

use super::clock::Clock;
use palpate_core::model::step_class::TICK_NS;

/// Time in which missed ticks may be caught up by running them [ns]; what would take longer lapses.
const CATCH_UP_NS: u64 = 4_000_000;

/// What the pacer says of the tick that begins now.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Begin {
    /// Ticks that lapse before it.
    pub lapsed: u32,
    /// How late it begins after its deadline [ns].
    pub lateness: u64,
    /// When it begins [ns].
    pub began: u64,
}

/// Paces ticks on a clock.
#[derive(Debug)]
pub struct Pacer<C> {
    clock: C,
    /// Deadline of the next tick [ns].
    deadline: u64,
    began: u64,
    /// Mean time inside a tick [ns].
    mean_compute: u64,
}

impl<C: Clock> Pacer<C> {
    /// The first tick is due one tick from now.
    pub fn start(mut clock: C) -> Self {
        let now = clock.now();
        Self { clock, deadline: now + TICK_NS, began: now, mean_compute: TICK_NS / 4 }
    }

    /// What it paces on.
    pub fn clock(&mut self) -> &mut C {
        &mut self.clock
    }

    /// Sleeps until the next tick is due.
    pub fn begin(&mut self) -> Begin {
        self.clock.sleep_until(self.deadline);
        self.began = self.clock.now();
        let lateness = self.began.saturating_sub(self.deadline);
        let behind = lateness / TICK_NS;
        // Running `behind` ticks takes their compute time, in which further ticks come due.
        let gain = TICK_NS.saturating_sub(self.mean_compute);
        let catch_up = behind.saturating_mul(self.mean_compute * TICK_NS) / gain.max(1);
        let lapsed = if behind > 0 && catch_up > CATCH_UP_NS { behind } else { 0 };
        self.deadline += TICK_NS * (1 + lapsed);
        Begin { lapsed: lapsed.min(u64::from(u32::MAX)) as u32, lateness, began: self.began }
    }

    /// Ends the tick; returns the time it took [ns], and whether the next deadline has passed already.
    pub fn end(&mut self) -> (u64, bool) {
        let now = self.clock.now();
        let compute = now.saturating_sub(self.began);
        // One slow tick (the machine was elsewhere) must not make every later stall lapse.
        let counted = compute.min(2 * self.mean_compute);
        self.mean_compute = (15 * self.mean_compute + counted).div_ceil(16).clamp(1_000, 2 * TICK_NS);
        (compute, now > self.deadline)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::cell::Cell;
    use std::rc::Rc;

    /// Time that passes only as it is told.
    #[derive(Clone)]
    struct MadeUp(Rc<Cell<u64>>);
    impl Clock for MadeUp {
        fn now(&mut self) -> u64 {
            self.0.get()
        }
        fn sleep_until(&mut self, deadline: u64) {
            self.0.set(self.0.get().max(deadline));
        }
    }

    /// Runs one second of ticks of `compute` ns, with a stall of `stall` ns inside tick 200; returns how far
    /// simulated time is behind wall time at worst from 5 ms after the stall on [ns], and the lapsed ticks.
    fn run(compute: u64, stall: u64) -> (u64, u64) {
        let time = Rc::new(Cell::new(7));
        let mut pacer = Pacer::start(MadeUp(time.clone()));
        let started = time.get();
        let (mut ticks, mut lapsed, mut worst, mut recovered_at) = (0u64, 0u64, 0, u64::MAX);
        while ticks < 1000 {
            let begin = pacer.begin();
            ticks += 1 + u64::from(begin.lapsed);
            lapsed += u64::from(begin.lapsed);
            let at_begin = time.get();
            if at_begin > recovered_at {
                worst = worst.max((at_begin - started).saturating_sub(ticks * TICK_NS));
            }
            let stalls = ticks == 200;
            time.set(time.get() + compute + if stalls { stall } else { 0 });
            if stalls {
                recovered_at = time.get() + 5_000_000;
            }
            pacer.end();
        }
        (worst, lapsed)
    }

    #[test]
    fn five_milliseconds_after_any_stall_simulated_time_is_within_a_tick_of_the_wall_clock() {
        for compute in [50_000, 200_000, 500_000, 900_000] {
            for stall in [0, 300_000, 1_500_000, 4_000_000, 12_000_000, 100_000_000, 500_000_000] {
                let (behind, _) = run(compute, stall);
                assert!(behind <= TICK_NS, "compute {compute}, stall {stall}: {behind} ns behind");
            }
        }
    }

    #[test]
    fn short_stalls_are_caught_up_and_long_ones_lapse() {
        assert_eq!(run(200_000, 5_000_000).1, 0);
        let lapsed = run(200_000, 100_000_000).1;
        assert!((98..=101).contains(&lapsed), "{lapsed}");
    }

    #[test]
    fn a_machine_that_was_suspended_for_a_month_goes_on_in_the_tick_that_is_due() {
        let month = 30 * 24 * 3600 * 1_000_000_000;
        let (behind, lapsed) = run(200_000, month);
        assert!(behind <= TICK_NS && lapsed.abs_diff(month / TICK_NS) <= 1, "{behind} ns behind, {lapsed} lapsed");
    }

    #[test]
    fn a_tick_that_always_takes_too_long_never_falls_behind_the_wall_clock() {
        let time = Rc::new(Cell::new(0));
        let mut pacer = Pacer::start(MadeUp(time.clone()));
        let mut ticks = 0;
        for _ in 0..1000 {
            ticks += 1 + u64::from(pacer.begin().lapsed);
            let behind = time.get().saturating_sub(ticks * TICK_NS);
            assert!(behind <= 8 * TICK_NS, "{behind}");
            time.set(time.get() + 2_500_000);
            pacer.end();
        }
        assert!(time.get().abs_diff(ticks * TICK_NS) <= 8 * TICK_NS);
    }
}
