//! What the wrenches of a run tell, one by one.

use std::sync::{Mutex, MutexGuard, PoisonError};

use hdrhistogram::Histogram;
use palpate_sdk::Wrench;

use crate::{Vec3, report::histogram};

/// What every single wrench tells, also those that a newer one overtakes before the device loop reads it.
pub(crate) struct WrenchLog {
    pub(crate) round_trip: Histogram<u64>,
    pub(crate) answered_pose: u32,
    /// Tick and rendered force of the wrench before.
    pub(crate) last: Option<(u64, Vec3)>,
    pub(crate) peak_force: f64,
    pub(crate) peak_physical_force: f64,
    pub(crate) peak_force_step: f64,
    pub(crate) non_finite: u64,
    pub(crate) in_contact: u64,
}

impl WrenchLog {
    pub(crate) fn new() -> Self {
        Self {
            round_trip: histogram(),
            answered_pose: 0,
            last: None,
            peak_force: 0.0,
            peak_physical_force: 0.0,
            peak_force_step: 0.0,
            non_finite: 0,
            in_contact: 0,
        }
    }

    pub(crate) fn record(&mut self, wrench: &Wrench, arrival_ns: u64) {
        if wrench.pose_sequence > self.answered_pose {
            self.answered_pose = wrench.pose_sequence;
            self.round_trip.saturating_record(arrival_ns.saturating_sub(wrench.pose_time_ns));
        }
        self.in_contact += u64::from(wrench.contact_points > 0);
        let (force, physical) = (Vec3::from(wrench.force), Vec3::from(wrench.physical_force));
        if !(force.norm().is_finite() && physical.norm().is_finite()) {
            self.non_finite += 1;
            return;
        }
        self.peak_force = self.peak_force.max(force.norm());
        self.peak_physical_force = self.peak_physical_force.max(physical.norm());
        if let Some((tick, before)) = self.last
            && wrench.tick > tick
        {
            let step = (force - before).norm() / (wrench.tick - tick) as f64;
            self.peak_force_step = self.peak_force_step.max(step);
        }
        self.last = Some((wrench.tick, force));
    }
}

/// The log is only written whole, so that a poisoned one is still good.
pub(crate) fn locked(log: &Mutex<WrenchLog>) -> MutexGuard<'_, WrenchLog> {
    log.lock().unwrap_or_else(PoisonError::into_inner)
}

#[cfg(test)]
mod tests {
    use palpate_sdk::ToolPhase;

    use super::*;
    use crate::Distribution;

    fn wrench(tick: u64, pose_sequence: u32, pose_time_ns: u64, force: f64) -> Wrench {
        Wrench {
            sequence: tick,
            tick,
            pose_sequence,
            pose_time_ns,
            pose_age_ticks: 0,
            position: [0.0; 3],
            orientation: [0.0, 0.0, 0.0, 1.0],
            physical_force: [0.0, 0.0, 2.0 * force],
            physical_torque: [0.0; 3],
            force: [0.0, 0.0, force],
            torque: [0.0; 3],
            contact_points: 1,
            phase: ToolPhase::Engaged,
            flags: 0,
            model: None,
            opening: 0.0,
            grip_torque: 0.0,
        }
    }

    #[test]
    fn a_round_trip_ends_with_the_first_wrench_that_answers_the_pose() {
        let mut log = WrenchLog::new();
        log.record(&wrench(1, 0, 0, 0.0), 5_000_000);
        log.record(&wrench(2, 1, 6_000_000, 0.0), 7_000_000);
        log.record(&wrench(3, 1, 6_000_000, 0.0), 8_000_000);
        log.record(&wrench(4, 2, 8_000_000, 0.0), 8_500_000);
        let round_trip = Distribution::of(&log.round_trip);
        assert_eq!(round_trip.count, 2);
        assert!((round_trip.max - 1000.0).abs() < 1.0 && (round_trip.p50 - 500.0).abs() < 1.0);
    }

    #[test]
    fn a_force_step_is_counted_per_simulated_millisecond() {
        let mut log = WrenchLog::new();
        log.record(&wrench(10, 0, 0, 0.0), 0);
        log.record(&wrench(14, 0, 0, 2.0), 0);
        log.record(&wrench(15, 0, 0, f64::NAN), 0);
        assert_eq!((log.peak_force_step, log.peak_force, log.peak_physical_force), (0.5, 2.0, 4.0));
        assert_eq!((log.non_finite, log.in_contact), (1, 3));
    }
}
