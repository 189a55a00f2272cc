//! A bad network, in simulated time: delay, jitter and loss, the same again from the same seed.

use std::collections::VecDeque;

use crate::ClientError;

/// What a link does to what is sent over it.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct LinkConditions {
    /// Shortest time from one end to the other [ns].
    pub delay_ns: u64,
    /// Every item takes up to this much longer [ns], uniformly distributed.
    pub jitter_ns: u64,
    /// Share of the items that never arrive, 0 to 1.
    pub loss: f64,
}

impl LinkConditions {
    /// Errors: [`ClientError::Link`] when the loss is no share of the whole.
    pub fn check(&self) -> Result<(), ClientError> {
        if (0.0..=1.0).contains(&self.loss) { Ok(()) } else { Err(ClientError::Link { loss: self.loss }) }
    }
}

/// One direction of a link.
///
/// An item that a later one has overtaken never comes out: the force channel works so too, where the newest counts.
#[derive(Clone, Debug)]
pub struct Link<T> {
    conditions: LinkConditions,
    random: u64,
    sent: u64,
    delivered: u64,
    /// Arrival [ns], number and item, in order of arrival.
    under_way: VecDeque<(u64, u64, T)>,
}

impl<T> Link<T> {
    /// An empty link. Two links with the same seed treat what is sent over them alike.
    pub fn new(conditions: LinkConditions, seed: u64) -> Self {
        Self { conditions, random: seed, sent: 0, delivered: 0, under_way: VecDeque::new() }
    }

    /// Sends an item at `now_ns`.
    pub fn send(&mut self, now_ns: u64, item: T) {
        self.sent += 1;
        let (lost, late) = (self.uniform() < self.conditions.loss, self.uniform());
        if !lost {
            let arrival_ns = now_ns + self.conditions.delay_ns + (late * self.conditions.jitter_ns as f64) as u64;
            let place = self.under_way.partition_point(|(arrival, ..)| *arrival <= arrival_ns);
            self.under_way.insert(place, (arrival_ns, self.sent, item));
        }
    }

    /// The next item that has arrived by `now_ns`.
    pub fn poll(&mut self, now_ns: u64) -> Option<T> {
        while self.under_way.front().is_some_and(|(arrival, ..)| *arrival <= now_ns) {
            let (_, number, item) = self.under_way.pop_front()?;
            if number > self.delivered {
                self.delivered = number;
                return Some(item);
            }
        }
        None
    }

    /// Uniform in 0..1: SplitMix64, whose sequence is the same on every machine.
    fn uniform(&mut self) -> f64 {
        self.random = self.random.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let z = (self.random ^ (self.random >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        let z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((z ^ (z >> 31)) >> 11) as f64 / (1u64 << 53) as f64
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MS: u64 = 1_000_000;

    /// Sends 1, 2, 3 … a millisecond apart and returns what comes out, with its time [ns].
    fn through(mut link: Link<u64>, items: u64) -> Vec<(u64, u64)> {
        let mut out = Vec::new();
        for now_ns in (0..(items + 100) * 10).map(|step| step * MS / 10) {
            if now_ns % MS == 0 && now_ns < items * MS {
                link.send(now_ns, now_ns / MS);
            }
            while let Some(item) = link.poll(now_ns) {
                out.push((now_ns, item));
            }
        }
        out
    }

    #[test]
    fn a_perfect_link_delivers_at_once() {
        let out = through(Link::new(LinkConditions::default(), 1), 100);
        assert!(out.len() == 100 && out.iter().all(|(now_ns, item)| *now_ns == item * MS));
    }

    #[test]
    fn delay_is_kept_and_jitter_adds_up_to_its_width() {
        let conditions = LinkConditions { delay_ns: 5 * MS, jitter_ns: 4 * MS, loss: 0.0 };
        let out = through(Link::new(conditions, 7), 2000);
        let times: Vec<u64> = out.iter().map(|(now_ns, item)| now_ns - item * MS).collect();
        let (least, most) = (*times.iter().min().unwrap(), *times.iter().max().unwrap());
        assert!((5 * MS..6 * MS).contains(&least) && (8 * MS..=9 * MS + MS / 10).contains(&most), "{least} {most}");
        assert!(out.windows(2).all(|pair| pair[0].1 < pair[1].1), "overtaken items never come out");
        assert!(out.len() > 800 && out.len() < 1900, "{} of 2000 were not overtaken", out.len());
    }

    #[test]
    fn the_share_that_is_lost_is_lost_and_the_seed_says_which() {
        let conditions = LinkConditions { delay_ns: MS, jitter_ns: 0, loss: 0.2 };
        let out = through(Link::new(conditions, 3), 5000);
        assert!((out.len() as f64 / 5000.0 - 0.8).abs() < 0.03, "{}", out.len());
        assert_eq!(out, through(Link::new(conditions, 3), 5000));
        assert_ne!(out, through(Link::new(conditions, 4), 5000));
        assert!(through(Link::new(LinkConditions { loss: 1.0, ..conditions }, 3), 50).is_empty());
    }

    #[test]
    fn a_loss_that_is_no_share_is_refused() {
        for loss in [-0.1, 1.1, f64::NAN] {
            assert!(LinkConditions { loss, ..LinkConditions::default() }.check().is_err());
        }
        LinkConditions { loss: 1.0, ..LinkConditions::default() }.check().unwrap();
    }
}
