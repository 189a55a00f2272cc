//! Turns measured time into what a tick may take: the price of each of its parts, and the margin by which some ticks
//! take longer than their prices say.
//!
//! All of it enters the core as recorded inputs, so a replay does not depend on how fast its machine is.
//!
//! - **Prices** are running means of time over count, part by part ([`Part`]), over some sixteen occurrences: they have
//!   followed a change of the machine's speed within 50 ms.
//! - **The margin** is a high quantile: of the last 4,096 ticks all but one took no longer than planned and the margin, so that
//!   one in 4,000 takes longer. It reacts at once and is given back slowly. A mean would not do: a deadline is missed by the
//!   worst of ticks. Ticks that end a frame, or change the resolution, do what is less well known beforehand, and have a
//!   margin of their own, as rarely exceeded: all together less than one tick in a thousand.
//! - **The share**: on the average the process's real-time threads together take at most nine tenths of a processor. They can
//!   come to share one, and the kernel stops real-time threads that take more than 95 %.
//!
//! A tick in which the thread was away says nothing of costs. Where another thread had its processor the thread's own clock
//! tells; an interrupt or the hypervisor shows as one part of one tick that takes several times what it takes before and
//! after.

use super::work::{Budget, Costs, Part, Prices};
use crate::model::step_class::TICK_NS;

/// What a tick may take [ns]: the rest is for its wake-up, which is late by 30 to 60 µs in one of a hundred ticks where
/// SCHED_FIFO is granted.
pub const LIMIT: u32 = 950_000;
/// What ticks may be planned to take [ns] where the process has no other real-time threads: nine tenths of a processor, where
/// the kernel's own limit is 95 % (`sched_rt_runtime_us`), above which it stops them for the rest of each second.
pub const MOST_PLANNED: u32 = (TICK_NS / 10 * 9) as u32;
/// Occurrences that a price is the mean of: fewer follow noise, with more than 24 it takes more than 50 ms to follow a machine
/// that has become slower.
const MEMORY: f64 = 16.0;
/// Ticks whose greatest excesses are kept, and how many times that is looked back at.
const BLOCK: u32 = 64;
const BLOCKS: usize = 64;
/// Away for longer than this [ns] within a tick, its laps say nothing of costs: an interrupt takes less.
const AWAY: u64 = 20_000;

/// Ticks by how well what they take is known beforehand.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum TickKind {
    /// Moves the body.
    Ordinary,
    /// Ends a frame, too, or copies the state.
    Frame,
    /// Changes the resolution, too.
    Change,
}

impl TickKind {
    /// Of a tick that `changes` the resolution, or ends a frame or copies the state.
    pub fn of(changes: bool, frame: bool) -> Self {
        match (changes, frame) {
            (true, _) => TickKind::Change,
            (false, true) => TickKind::Frame,
            (false, false) => TickKind::Ordinary,
        }
    }
}

/// Kinds of ticks.
const KINDS: usize = 3;

/// What ticks cost, and what the next one may take.
#[derive(Clone, Debug)]
pub struct Governor {
    costs: Costs,
    /// By block, the newest in `newest`, and by kind of tick: the greatest two excesses over what was planned [ns].
    excess: [[[i64; 2]; KINDS]; BLOCKS],
    newest: usize,
    in_block: u32,
    /// What the process's other real-time threads take of a tick [ns].
    others: u32,
}

impl Default for Governor {
    fn default() -> Self {
        Self::new()
    }
}

impl Governor {
    /// Nothing is known yet.
    pub fn new() -> Self {
        Self { costs: Costs::default(), excess: [[[0; 2]; KINDS]; BLOCKS], newest: 0, in_block: 0, others: 0 }
    }

    /// `part` has been done `count` times in `time` [ns] of the tick that runs.
    pub fn lap(&mut self, part: Part, count: u32, time: u64) {
        self.costs.lap(part, count, time);
    }

    /// Ends a tick that was planned to take `planned` [ns], computed for `computed` [ns], and was away for `away` [ns]. How long
    /// it was away in all, with what only its laps show.
    pub fn end_tick(&mut self, planned: u32, kind: TickKind, computed: u64, away: u64) -> u64 {
        if away > AWAY {
            self.costs.drop_tick();
            return away;
        }
        let hidden = self.costs.end_tick(MEMORY);
        let computed = computed.saturating_sub(hidden);
        let excess = computed as i64 - i64::from(planned);
        if self.in_block == BLOCK {
            self.newest = (self.newest + 1) % BLOCKS;
            self.excess[self.newest] = [[0; 2]; KINDS];
            self.in_block = 0;
        }
        self.in_block += 1;
        rank(&mut self.excess[self.newest][kind as usize], excess);
        away + hidden
    }

    /// The process's other real-time threads take `time` [ns] of each tick.
    pub fn share_with(&mut self, time: u32) {
        self.others = time;
    }

    /// What each part costs.
    pub fn prices(&self) -> Prices {
        self.costs.prices()
    }

    /// What ticks of a kind take beyond their plan [ns]: those of the last 4,096 ticks, all but one.
    fn margin(&self, kind: TickKind) -> u32 {
        let mut greatest = [0; 2];
        self.excess.iter().flat_map(|block| block[kind as usize]).for_each(|excess| rank(&mut greatest, excess));
        greatest[1].min(i64::from(LIMIT)) as u32
    }

    /// What the next tick may take.
    pub fn budget(&self) -> Budget {
        let share = MOST_PLANNED.saturating_sub(self.others);
        Budget {
            limit: LIMIT,
            planned: (LIMIT - self.margin(TickKind::Ordinary)).min(share),
            frame: LIMIT - self.margin(TickKind::Frame),
            change: LIMIT - self.margin(TickKind::Change),
        }
    }
}

/// Keeps the two greatest, the greatest first.
fn rank(greatest: &mut [i64; 2], excess: i64) {
    if excess > greatest[0] {
        *greatest = [excess, greatest[0]];
    } else {
        greatest[1] = greatest[1].max(excess);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Ticks of `elements` evaluations at `price` [ns] beside 100 µs for the rest, planned as the governor says.
    fn run(governor: &mut Governor, ticks: u32, elements: u32, price: u64) {
        for _ in 0..ticks {
            let prices = governor.prices();
            let planned = prices.of(Part::Fixed, 1) + prices.of(Part::Element(1), elements);
            governor.lap(Part::Fixed, 1, 100_000 * price / 20);
            governor.lap(Part::Element(1), elements, u64::from(elements) * price);
            governor.end_tick(planned, TickKind::Ordinary, 100_000 * price / 20 + u64::from(elements) * price, 0);
        }
    }

    /// Evaluations that a tick may be planned with.
    fn room(governor: &Governor) -> u32 {
        let (prices, budget) = (governor.prices(), governor.budget());
        prices.count(Part::Element(1), budget.planned.saturating_sub(prices.of(Part::Fixed, 1)))
    }

    #[test]
    fn a_machine_that_becomes_slower_is_followed_within_50_ms_and_what_it_gives_back_comes_slowly() {
        let mut governor = Governor::new();
        run(&mut governor, 5000, 20_000, 20);
        let before = room(&governor);
        assert!((38_000..=40_000).contains(&before), "{before}");
        run(&mut governor, 50, 20_000, 40);
        let slow = room(&governor);
        assert!(slow < 18_000, "{slow} of {before} on a machine half as fast");
        run(&mut governor, 200, 10_000, 20);
        let soon = room(&governor);
        run(&mut governor, 4200, 10_000, 20);
        let later = room(&governor);
        assert!(soon < 9 * before / 10 && later > 95 * before / 100, "{soon}, then {later} of {before}");
    }

    #[test]
    fn a_tick_in_which_the_machine_was_away_costs_nothing_and_one_slow_tick_a_second_little() {
        let mut governor = Governor::new();
        run(&mut governor, 5000, 20_000, 20);
        let before = room(&governor);
        governor.lap(Part::Element(1), 20_000, 5_000_000);
        governor.end_tick(500_000, TickKind::Ordinary, 500_000, 4_600_000);
        assert_eq!(room(&governor), before);
        governor.end_tick(500_000, TickKind::Ordinary, 900_000, 0);
        assert_eq!(governor.margin(TickKind::Ordinary), 0);
        // Two of them in four thousand would be missed deadlines.
        run(&mut governor, 100, 20_000, 20);
        governor.end_tick(500_000, TickKind::Ordinary, 850_000, 0);
        assert_eq!(governor.margin(TickKind::Ordinary), 350_000);
    }

    #[test]
    fn what_has_not_been_measured_costs_what_it_would_on_a_common_machine_as_slow_as_this() {
        let mut governor = Governor::new();
        run(&mut governor, 100, 20_000, 60);
        let prices = governor.prices();
        let common = Prices::COMMON;
        let times = |part: Part| f64::from(prices.0[part.index()]) / f64::from(common.0[part.index()]);
        assert!((times(Part::SolidPoint) - times(Part::Frame)).abs() < 1e-3);
        assert!(times(Part::SolidPoint) > 2.9, "{}", times(Part::SolidPoint));
    }

    #[test]
    fn what_other_real_time_threads_take_is_not_there_to_be_spent() {
        let mut governor = Governor::new();
        assert_eq!(governor.budget().planned, 900_000);
        governor.share_with(150_000);
        assert_eq!(governor.budget(), Budget { limit: LIMIT, planned: 750_000, frame: LIMIT, change: LIMIT });
    }
}
