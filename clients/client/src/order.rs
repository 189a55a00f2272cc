//! Which wrenches a client takes: those in order, none that runs ahead of the clock, and none from before a silence.

use crate::Wrench;

/// Wrenches that may have gone missing at once, of the thousand that come in a second. Fewer, and a short outage of the network
/// costs a silence; more, and one wrench with a wrong sequence keeps the true ones out for as much longer.
const MOST_AHEAD: u64 = 1000;
/// Time that makes room for one [ns]: half of that between two, so that clocks may differ.
const ROOM_NS: u64 = 500_000;
/// After this long without a wrench that could be taken [ns] no force of before is felt any more, and any sequence is
/// believed: a wrong one must not keep the true ones out for good.
const SILENCE_NS: u64 = 70_000_000;

/// What becomes of a wrench.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Verdict {
    /// It is taken; so many before it never came.
    Taken {
        /// Sequence numbers that never came.
        missed: u64,
    },
    /// It is a repeated or an older one.
    Old,
    /// No server sends it: its sequence runs ahead of the clock, or after a silence its tick has stood still, so that its
    /// force is from before.
    Implausible,
}

/// Judges the wrenches of one tool, of one epoch, as they come.
#[derive(Clone, Copy, Debug, Default)]
pub struct Order {
    /// The newest that was taken: its sequence, tick and arrival [ns].
    last: Option<(u64, u64, u64)>,
    /// How far the sequence may go now, as the time that made room for it [ns].
    room_ns: u64,
}

impl Order {
    /// Of `wrench`, which came at `arrival_ns`.
    pub fn judge(&mut self, wrench: &Wrench, arrival_ns: u64) -> Verdict {
        let Some((sequence, tick, arrived)) = self.last else {
            return self.take(wrench, arrival_ns, 0, MOST_AHEAD * ROOM_NS);
        };
        let silence = arrival_ns.saturating_sub(arrived);
        if silence >= SILENCE_NS {
            // A tick is a millisecond. A server that stood still, or a message that did, says so by its tick.
            let went_on = (wrench.tick.saturating_sub(tick)).saturating_mul(1_000_000);
            if went_on.saturating_add(SILENCE_NS) < silence {
                return Verdict::Implausible;
            }
            let missed = wrench.sequence.saturating_sub(sequence).saturating_sub(1);
            return self.take(wrench, arrival_ns, missed, MOST_AHEAD * ROOM_NS);
        }
        let room_ns = (self.room_ns + silence).min(MOST_AHEAD * ROOM_NS);
        match wrench.sequence.checked_sub(sequence) {
            None | Some(0) => Verdict::Old,
            Some(ahead) if ahead > room_ns / ROOM_NS => Verdict::Implausible,
            Some(ahead) => self.take(wrench, arrival_ns, ahead - 1, room_ns - ahead * ROOM_NS),
        }
    }

    fn take(&mut self, wrench: &Wrench, arrival_ns: u64, missed: u64, room_ns: u64) -> Verdict {
        (self.last, self.room_ns) = (Some((wrench.sequence, wrench.tick, arrival_ns)), room_ns);
        Verdict::Taken { missed }
    }

    /// True when a wrench has been taken.
    pub fn has_begun(&self) -> bool {
        self.last.is_some()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::renderer::tests::{MS, held};

    fn numbered(sequence: u64, tick: u64) -> Wrench {
        Wrench { sequence, tick, ..held(1, [0.0; 3]) }
    }

    /// An order that has taken one wrench a millisecond until `ms`.
    fn steady(ms: u64) -> Order {
        let mut order = Order::default();
        for i in 1..=ms {
            assert_eq!(order.judge(&numbered(i, i), i * MS), Verdict::Taken { missed: 0 });
        }
        order
    }

    #[test]
    fn gaps_are_missed_wrenches_and_older_ones_are_left_out() {
        let mut order = steady(3000);
        assert_eq!(order.judge(&numbered(3004, 3004), 3004 * MS), Verdict::Taken { missed: 3 });
        for sequence in [3004, 3000, 1] {
            assert_eq!(order.judge(&numbered(sequence, 3005), 3005 * MS), Verdict::Old, "{sequence}");
        }
    }

    #[test]
    fn one_wrench_with_the_largest_sequence_is_left_out_and_the_true_ones_go_on() {
        let mut order = steady(3000);
        assert_eq!(order.judge(&numbered(u64::MAX, 3001), 3001 * MS), Verdict::Implausible);
        assert_eq!(order.judge(&numbered(3001, 3001), 3001 * MS), Verdict::Taken { missed: 0 });
        // As far ahead as is believed: the true ones are back after 70 ms, and not after as many as were left out.
        assert!(matches!(order.judge(&numbered(3900, 3002), 3002 * MS), Verdict::Taken { .. }));
        let back = (3003..).find(|ms| order.judge(&numbered(*ms, *ms), ms * MS) != Verdict::Old);
        assert_eq!(back, Some(3002 + 70));
        assert_eq!(order.judge(&numbered(3073, 3073), 3073 * MS), Verdict::Taken { missed: 0 });
    }

    #[test]
    fn of_a_flood_a_thousand_are_taken_in_each_80_ms() {
        let mut order = steady(3000);
        let taken = (1..20_000u64).filter(|i| {
            let now = 3000 * MS + i * MS / 100;
            matches!(order.judge(&numbered(3000 + i, 3000 + i), now), Verdict::Taken { .. })
        });
        let taken = taken.count();
        assert!((1000..=3100).contains(&taken), "{taken}");
    }

    #[test]
    fn what_was_on_its_way_while_the_server_stood_still_is_left_out_and_what_comes_then_is_taken() {
        let mut order = steady(3000);
        let after = 3500;
        assert_eq!(order.judge(&numbered(3001, 3001), after * MS), Verdict::Implausible);
        assert_eq!(order.judge(&numbered(3002, after + 1), (after + 1) * MS), Verdict::Taken { missed: 1 });
        // Where the network was away and the server was not.
        let mut order = steady(3000);
        assert_eq!(order.judge(&numbered(3499, 3499), after * MS), Verdict::Taken { missed: 498 });
    }
}
