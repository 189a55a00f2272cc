//! What a run measured.

use std::fmt;

use hdrhistogram::Histogram;
use palpate_sdk::{Counters, ToolPhase};
use serde::Serialize;

/// Longest time a histogram tells apart [ns]; longer ones count as this.
const LONGEST_NS: u64 = 10_000_000_000;

/// An empty histogram of times [ns], 1 ns to 10 s to three digits.
pub(crate) fn histogram() -> Histogram<u64> {
    Histogram::new_with_bounds(1, LONGEST_NS, 3).expect("these bounds are valid")
}

/// A histogram of times, summed up [µs].
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Distribution {
    /// Number of values.
    pub count: u64,
    /// Median [µs].
    pub p50: f64,
    /// 99 of 100 are below [µs].
    pub p99: f64,
    /// 999 of 1000 are below [µs].
    pub p999: f64,
    /// The greatest [µs].
    pub max: f64,
}

impl Distribution {
    /// Sums up a histogram of nanoseconds.
    pub(crate) fn of(histogram: &Histogram<u64>) -> Self {
        let at = |quantile| histogram.value_at_quantile(quantile) as f64 * 1e-3;
        Self {
            count: histogram.len(),
            p50: at(0.5),
            p99: at(0.99),
            p999: at(0.999),
            max: histogram.max() as f64 * 1e-3,
        }
    }
}

/// Every pattern has reached its depth by then [s].
const TOUCHED_BY: f64 = 2.5;

/// What one run did and measured. Times are in microseconds, forces in newtons.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Report {
    /// Device that was modelled.
    pub device: String,
    /// What the hand did.
    pub pattern: String,
    /// Tool that was held, by the session's name for it.
    pub tool: String,
    /// Poses per second [Hz].
    pub rate_hz: f64,
    /// How the force was made from the wrenches.
    pub render: String,
    /// Delay added each way [ms], beside the network's own. Round trips are measured without it.
    pub delay_ms: f64,
    /// Width of the jitter added each way [ms].
    pub jitter_ms: f64,
    /// Share lost on purpose each way.
    pub loss: f64,
    /// What the system granted the device loop.
    pub scheduling: String,
    /// Length of the run [s].
    pub seconds: f64,
    /// Ticks of the device, 1000 per second.
    pub ticks: u64,
    /// Of these, ticks that were made up after their time because the loop woke too late.
    pub late_ticks: u64,
    /// Wake-ups that found no wrench newer than the one before.
    pub stale_ticks: u64,
    /// Poses sent.
    pub poses_sent: u64,
    /// Wrenches received.
    pub wrenches: u64,
    /// Wrenches that never came: gaps in their sequence.
    pub missed_wrenches: u64,
    /// Messages that were no wrench of this tool.
    pub refused_wrenches: u64,
    /// From sending a pose to the arrival of the first wrench that answers it [µs].
    pub round_trip: Distribution,
    /// Age of the newest wrench when the device renders its force [µs].
    pub update_age: Distribution,
    /// Wake-up of the device loop after its deadline [µs].
    pub lateness: Distribution,
    /// Bare round trip of as many bytes through the same sessions, meanwhile [µs]; `None` when not asked for.
    pub bare_round_trip: Option<Distribution>,
    /// Bare round trips that never came back.
    pub lost_echoes: u64,
    /// Greatest force to render, as the server sent it [N].
    pub peak_force: f64,
    /// Greatest force of the contact itself, before the server's limits [N].
    pub peak_physical_force: f64,
    /// Greatest change of the force to render [N] in one simulated millisecond.
    pub peak_force_step: f64,
    /// Wrenches with a force that is not finite.
    pub non_finite_wrenches: u64,
    /// Wrenches in contact.
    pub contact_wrenches: u64,
    /// Greatest force that the device gave, as its renderer made it of the wrenches [N].
    pub peak_device_force: f64,
    /// Greatest torque that it gave [N·m].
    pub peak_device_torque: f64,
    /// Greatest torque that opened its jaws, as the server sent it [N·m].
    pub peak_grip_torque: f64,
    /// How far it was turned from upright at most [rad].
    pub turned: f64,
    /// Most energy that the passivity observer saw going out to the hand beyond what it had put in [J].
    pub peak_energy: f64,
    /// How much of that the device allows [J].
    pub energy_budget: f64,
    /// Deepest point the device reached below touch [m]; the hand wanted to go to `depth`.
    pub reached_depth: f64,
    /// How far the hand wanted to go [m].
    pub depth: f64,
    /// One per tick from the beginning, as many as were asked for. Not part of the JSON.
    #[serde(skip)]
    pub samples: Vec<Sample>,
}

impl Report {
    /// True when the hand had the time to go to its depth: a run without contact has missed the body.
    pub fn should_have_touched(&self) -> bool {
        self.seconds >= TOUCHED_BY
    }

    /// The report as indented JSON.
    pub fn to_json(&self) -> String {
        serde_json::to_string_pretty(self).expect("a struct of numbers and strings can be written")
    }

    pub(crate) fn take_counters(&mut self, counters: Counters) {
        self.wrenches = counters.received;
        self.missed_wrenches = counters.missed;
        self.refused_wrenches = counters.undecodable + counters.foreign;
    }
}

impl fmt::Display for Report {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(f, "{} held, tool '{}', pattern {}", self.device, self.tool, self.pattern)?;
        writeln!(
            f,
            "{:.1} s, {} poses at {} Hz, device loop {}",
            self.seconds, self.poses_sent, self.rate_hz, self.scheduling
        )?;
        write!(f, "force rendered by '{}'", self.render)?;
        if self.delay_ms + self.jitter_ms + self.loss > 0.0 {
            let (delay, jitter, loss) = (self.delay_ms, self.jitter_ms, 100.0 * self.loss);
            write!(f, " over {delay} ms and up to {jitter} ms more each way, {loss} % lost (not in the times below)")?;
        }
        writeln!(f)?;
        writeln!(f)?;
        writeln!(f, "{:<28}{:>10}{:>10}{:>10}{:>10}{:>10}", "[µs]", "p50", "p99", "p99.9", "max", "count")?;
        let rows = [
            ("pose to wrench", Some(self.round_trip)),
            ("bare round trip", self.bare_round_trip),
            ("update age", Some(self.update_age)),
            ("device loop lateness", Some(self.lateness)),
        ];
        for (name, row) in rows {
            if let Some(d) = row {
                writeln!(f, "{name:<28}{:>10.1}{:>10.1}{:>10.1}{:>10.1}{:>10}", d.p50, d.p99, d.p999, d.max, d.count)?;
            }
        }
        writeln!(f)?;
        writeln!(
            f,
            "wrenches: {} received, {} missed, {} refused, {} not finite, {} in contact",
            self.wrenches, self.missed_wrenches, self.refused_wrenches, self.non_finite_wrenches, self.contact_wrenches
        )?;
        writeln!(
            f,
            "ticks: {}, of which {} late; {} wake-ups without a fresh wrench; {} echoes lost",
            self.ticks, self.late_ticks, self.stale_ticks, self.lost_echoes
        )?;
        writeln!(
            f,
            "force: peak {:.3} N rendered, {:.3} N physical, largest step {:.4} N/ms",
            self.peak_force, self.peak_physical_force, self.peak_force_step
        )?;
        writeln!(
            f,
            "device: peak {:.3} N and {:.1} mN·m given, turned by {:.0}° at most, jaws opened by {:.1} mN·m, {:.2} mJ of {:.2} mJ given out to the hand at most",
            self.peak_device_force,
            1e3 * self.peak_device_torque,
            self.turned.to_degrees(),
            1e3 * self.peak_grip_torque,
            1e3 * self.peak_energy,
            1e3 * self.energy_budget
        )?;
        write!(f, "depth: {:.2} mm of {:.2} mm wanted", 1e3 * self.reached_depth, 1e3 * self.depth)
    }
}

/// One tick of the device.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Sample {
    /// Since the beginning of the run [s].
    pub time: f64,
    /// Where the hand wanted the tool [m].
    pub target: [f64; 3],
    /// Where the tip was [m].
    pub position: [f64; 3],
    /// How it was turned (x, y, z, w).
    pub orientation: [f64; 4],
    /// What the motors gave [N], ...
    pub force: [f64; 3],
    /// ... and [N·m].
    pub torque: [f64; 3],
}

/// The state of a run, for people watching.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Live {
    /// The newest tick.
    pub sample: Sample,
    /// Where the tool stands in its life.
    pub phase: ToolPhase,
    /// Contacts that carry force.
    pub contact_points: u32,
    /// Wrenches received so far.
    pub wrenches: u64,
    /// Wrenches missed so far.
    pub missed_wrenches: u64,
    /// Median from pose to wrench so far [µs].
    pub round_trip_p50: f64,
    /// 99th percentile from pose to wrench so far [µs].
    pub round_trip_p99: f64,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_distribution_sums_up_its_histogram_in_microseconds() {
        let mut times = histogram();
        (1..=1000u64).for_each(|n| times.saturating_record(n * 1000));
        let summed = Distribution::of(&times);
        assert_eq!(summed.count, 1000);
        for (value, expected) in [(summed.p50, 500.0), (summed.p99, 990.0), (summed.p999, 999.0), (summed.max, 1000.0)]
        {
            assert!((value / expected - 1.0f64).abs() < 2e-3);
        }
        assert_eq!(Distribution::of(&histogram()), Distribution::default());
    }

    #[test]
    fn the_report_is_a_table_and_valid_json() {
        let report = Report { device: "Touch".to_owned(), peak_force: 1.25, ..Default::default() };
        assert!(report.to_string().contains("pose to wrench") && report.to_string().contains("1.250 N rendered"));
        assert!(!report.to_string().contains("bare round trip"));
        let json: serde_json::Value = serde_json::from_str(&report.to_json()).unwrap();
        assert_eq!(json["device"], "Touch");
        assert_eq!(json["round_trip"]["count"], 0);
    }
}
