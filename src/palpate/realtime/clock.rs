//! Time since the start of the machine, real or made up.

use palpate_core::stepping::work::Part;
use rustix::thread::{ClockId as SleepClock, clock_nanosleep_absolute};
use rustix::time::{ClockId, Timespec, clock_gettime};

/// A monotonic clock that can be slept on.
pub trait Clock {
    /// Now [ns].
    fn now(&mut self) -> u64;
    /// Returns at or after `deadline` [ns]; at once when it has passed.
    fn sleep_until(&mut self, deadline: u64);
    /// Time that the calling thread has computed for [ns]: what it was away for does not count.
    fn computed(&mut self) -> u64 {
        self.now()
    }
    /// Now [ns], when `part` of a tick has just been done, `count` times: a clock that is made up may make its cost up, too.
    fn after(&mut self, _part: Part, _count: u32) -> u64 {
        self.now()
    }
}

impl<C: Clock> Clock for &mut C {
    fn now(&mut self) -> u64 {
        (**self).now()
    }
    fn sleep_until(&mut self, deadline: u64) {
        (**self).sleep_until(deadline);
    }
    fn computed(&mut self) -> u64 {
        (**self).computed()
    }
    fn after(&mut self, part: Part, count: u32) -> u64 {
        (**self).after(part, count)
    }
}

/// The system's monotonic clock, the one that goes on while the machine is suspended: to a hand that is time, too.
#[derive(Clone, Copy, Debug, Default)]
pub struct Monotonic;

impl Clock for Monotonic {
    fn now(&mut self) -> u64 {
        let t = clock_gettime(ClockId::Boottime);
        t.tv_sec as u64 * 1_000_000_000 + t.tv_nsec as u64
    }

    fn computed(&mut self) -> u64 {
        let t = clock_gettime(ClockId::ThreadCPUTime);
        t.tv_sec as u64 * 1_000_000_000 + t.tv_nsec as u64
    }

    fn sleep_until(&mut self, deadline: u64) {
        let request =
            Timespec { tv_sec: (deadline / 1_000_000_000) as i64, tv_nsec: (deadline % 1_000_000_000) as i64 };
        // A signal may wake it early: the deadline is absolute, so asking again loses nothing.
        while clock_nanosleep_absolute(SleepClock::Boottime, &request) == Err(rustix::io::Errno::INTR) {}
    }
}
