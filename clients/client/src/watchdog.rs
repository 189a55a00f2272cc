//! What a client does when wrenches stop, and how it learns that its tool is no longer its own.

use crate::Wrench;

/// Age of the newest wrench [ns] up to which its force is felt in full.
const HOLD_NS: u64 = 20_000_000;
/// Age of the newest wrench [ns] from which no force is felt.
const SILENT_NS: u64 = 70_000_000;
/// Age of the newest wrench [ns] from which the tool counts as gone. Below, a slow network loses its tool on paper; above,
/// a user pushes at air that long. The server frees the tool of a client whose connection broke 2 s ago.
const GONE_NS: u64 = 1_000_000_000;
/// Time [ns] for which poses go unanswered while wrenches come until they count as refused: more than a round trip.
const REFUSED_NS: u64 = 200_000_000;

/// How much of a wrench is still felt, from its age since arrival [ns]: 1 up to 20 ms, falling linearly to 0 at 70 ms.
///
/// The client's mirror of the server's watchdog: should the network fall silent in contact, the hand is let go gently
/// instead of being pushed by an old force.
pub fn watchdog_scale(age_ns: u64) -> f64 {
    let faded = age_ns.saturating_sub(HOLD_NS) as f64 / (SILENT_NS - HOLD_NS) as f64;
    (1.0 - faded).max(0.0)
}

/// Whether a tool is still in the hand.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Hold {
    /// Wrenches come and answer the poses.
    Held,
    /// Wrenches have stopped for 20 ms or more: the force fades, and is zero from 70 ms on.
    Fading,
    /// Wrenches come, but the server takes none of the poses since 0.2 s: they lie outside the workspace, or are malformed.
    Refused,
    /// Somebody else holds the tool, or no wrench has come for 1 s: attach again.
    Gone,
}

/// Tells from what a client sends and receives whether it still holds its tool.
///
/// The server sends a wrench every tick from the attachment on, even before the first pose; so silence means that the tool
/// was freed, or that the server or the network is away.
#[derive(Clone, Copy, Debug)]
pub struct Grip {
    /// Arrival of the newest wrench [ns]; of the attachment before the first.
    arrival_ns: u64,
    /// Newest pose that it answers.
    answered: u32,
    /// Newest pose that was sent, and when [ns].
    sent: (u32, u64),
    /// Since when poses wait for an answer [ns].
    waiting_ns: u64,
    taken: bool,
}

impl Grip {
    /// Of a tool that was attached at `now_ns`.
    pub fn new(now_ns: u64) -> Self {
        Self { arrival_ns: now_ns, answered: 0, sent: (0, now_ns), waiting_ns: now_ns, taken: false }
    }

    /// The pose number `sequence` was sent at `now_ns`.
    pub fn sent(&mut self, sequence: u32, now_ns: u64) {
        if self.sent.0 == self.answered {
            self.waiting_ns = now_ns;
        }
        self.sent = (sequence, now_ns);
    }

    /// A wrench of the own epoch came at `arrival_ns`.
    pub fn received(&mut self, wrench: &Wrench, arrival_ns: u64) {
        self.arrival_ns = arrival_ns;
        if wrench.pose_sequence != self.answered {
            (self.answered, self.waiting_ns) = (wrench.pose_sequence, arrival_ns);
        }
    }

    /// A wrench of another epoch came after one of the own: the tool was freed, and somebody else has taken it.
    pub fn taken(&mut self) {
        self.taken = true;
    }

    /// Age of the newest wrench [ns].
    pub fn age_ns(&self, now_ns: u64) -> u64 {
        now_ns.saturating_sub(self.arrival_ns)
    }

    /// Whether the tool is still in the hand at `now_ns`.
    pub fn hold(&self, now_ns: u64) -> Hold {
        match self.age_ns(now_ns) {
            age if self.taken || age >= GONE_NS => Hold::Gone,
            age if age > HOLD_NS => Hold::Fading,
            _ if self.sent.0 != self.answered && self.sent.1.saturating_sub(self.waiting_ns) > REFUSED_NS => {
                Hold::Refused
            }
            _ => Hold::Held,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::renderer::tests::{MS, held};

    #[test]
    fn the_watchdog_holds_20_ms_and_is_silent_at_70_ms() {
        assert_eq!(watchdog_scale(0), 1.0);
        assert_eq!(watchdog_scale(20_000_000), 1.0);
        assert!((watchdog_scale(45_000_000) - 0.5).abs() < 1e-12);
        assert_eq!(watchdog_scale(70_000_000), 0.0);
        assert_eq!(watchdog_scale(u64::MAX), 0.0);
    }

    fn answer(pose_sequence: u32) -> Wrench {
        Wrench { pose_sequence, ..held(1, [0.0; 3]) }
    }

    #[test]
    fn a_tool_is_gone_after_a_second_of_silence_or_when_somebody_else_has_it() {
        let mut grip = Grip::new(5000 * MS);
        for (ms, hold) in
            [(0, Hold::Held), (20, Hold::Held), (21, Hold::Fading), (999, Hold::Fading), (1000, Hold::Gone)]
        {
            assert_eq!(grip.hold((5000 + ms) * MS), hold, "{ms} ms");
        }
        grip.received(&answer(0), 6500 * MS);
        assert_eq!(grip.hold(6501 * MS), Hold::Held, "the network was away, and is back");
        grip.taken();
        grip.received(&answer(0), 6502 * MS);
        assert_eq!(grip.hold(6502 * MS), Hold::Gone);
    }

    #[test]
    fn poses_are_refused_where_wrenches_go_on_to_answer_an_older_one() {
        let mut grip = Grip::new(0);
        for ms in 1..=500u32 {
            let now_ns = u64::from(ms) * MS;
            // From 100 ms on the hand is outside the workspace; answers take 30 ms.
            grip.sent(ms, now_ns);
            grip.received(&answer(ms.saturating_sub(30).min(100)), now_ns);
            let expected = if ms > 130 + 200 { Hold::Refused } else { Hold::Held };
            assert_eq!(grip.hold(now_ns), expected, "{ms} ms");
        }
        // Back inside, and after a pause.
        grip.received(&answer(500), 510 * MS);
        assert_eq!(grip.hold(510 * MS), Hold::Held);
        grip.sent(501, 2000 * MS);
        grip.received(&answer(500), 2001 * MS);
        assert_eq!(grip.hold(2001 * MS), Hold::Held, "a pose just sent is not refused yet");
    }
}
