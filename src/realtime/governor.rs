//! Turns measured compute time into the work budget of the next tick, in the units of [`crate::stepping::work`].
//!
//! The budget is an input of the core and is recorded, so a replay does not depend on how fast its machine is.

/// Part of a tick that may be spent [ns]; the rest is for a late wake-up.
const WORK_TIME: f64 = 750_000.0;
/// Ticks before the measured cost is trusted: caches and clocks have to warm up.
const WARM_UP: u32 = 64;

/// Follows the cost of a unit of work.
#[derive(Clone, Copy, Debug)]
pub struct Governor {
    /// Mean cost of a unit [ns], everything in the tick included.
    cost: f64,
    ticks: u32,
    floor: u32,
}

impl Governor {
    /// The budget never falls below `floor`: what the body takes when it is as coarse as can be, so that it always moves.
    pub fn new(floor: u32) -> Self {
        Self { cost: 0.0, ticks: 0, floor }
    }

    /// Takes in the units that a tick spent and how long it took [ns].
    pub fn measure(&mut self, work: u32, compute: u64) {
        if work == 0 {
            return;
        }
        let cost = compute as f64 / f64::from(work);
        self.ticks = self.ticks.saturating_add(1);
        if self.ticks == 1 {
            self.cost = cost;
        } else {
            // A tick in which the machine was elsewhere says nothing of the cost: it counts as twice the mean at most.
            self.cost += (cost.min(2.0 * self.cost) - self.cost) / 64.0;
        }
    }

    /// Units that the next tick may spend.
    pub fn budget(&self) -> u32 {
        if self.ticks < WARM_UP {
            return u32::MAX;
        }
        ((WORK_TIME / self.cost) as u32).max(self.floor)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_slower_machine_gets_a_smaller_budget_and_one_stall_changes_little() {
        let mut governor = Governor::new(1000);
        (0..200).for_each(|_| governor.measure(10_000, 200_000));
        let before = governor.budget();
        assert!((36_000..=38_000).contains(&before), "{before}");
        governor.measure(10_000, 50_000_000);
        assert!(governor.budget() > before * 96 / 100);
        (0..500).for_each(|_| governor.measure(10_000, 2_000_000));
        assert!(governor.budget() < 4_000);
        (0..2000).for_each(|_| governor.measure(10_000, 100_000_000));
        assert_eq!(governor.budget(), 1000);
    }
}
