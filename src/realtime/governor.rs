//! Turns measured compute time into the work budget of the next tick, in the units of [`crate::stepping::work`].
//!
//! The budget is an input of the core and is recorded, so a replay does not depend on how fast its machine is.

/// Part of a tick that may be spent [ns], three quarters of it on the body's motion; the rest is for a late wake-up.
pub const WORK_TIME: f64 = 850_000.0;
/// Ticks before the measured cost is trusted: caches and clocks have to warm up.
const WARM_UP: u32 = 64;
/// Ticks that averages run over.
const MEMORY: f64 = 256.0;
/// Cost of a unit [ns] until it has been measured: that of a common machine.
const FIRST_COST: f64 = 20.0;
/// Bounds on the cost of a unit [ns]: beyond them it is the measurement that is wrong.
const COST: std::ops::RangeInclusive<f64> = 4.0..=4_000.0;
/// Units must vary by this part of their mean before their cost can be told from what every tick costs.
const LEAST_SPREAD: f64 = 0.1;

/// Follows what a tick costs: `fixed + cost · units`, by least squares over the last ticks.
///
/// A body at rest takes few units, so that what every tick costs (contact, surface, messages) outweighs them: one mean
/// cost per unit would leave no room to refine when a tool comes.
#[derive(Clone, Copy, Debug)]
pub struct Governor {
    /// Running means of units, time [ns], units², units·time.
    mean: [f64; 4],
    /// Cost of a unit [ns].
    cost: f64,
    ticks: u32,
    floor: u32,
}

impl Governor {
    /// The budget never falls below `floor`: what the body takes when it is as coarse as can be, so that it always moves.
    pub fn new(floor: u32) -> Self {
        Self { mean: [0.0; 4], cost: FIRST_COST, ticks: 0, floor }
    }

    /// Takes in the units that a tick spent and how long it took [ns].
    pub fn measure(&mut self, work: u32, compute: u64) {
        if work == 0 {
            return;
        }
        let (units, mut time) = (f64::from(work), compute as f64);
        self.ticks = self.ticks.saturating_add(1);
        if self.ticks > WARM_UP {
            // A tick in which the machine was elsewhere says nothing of the cost: it counts as twice what was expected at
            // most.
            time = time.min(2.0 * (self.fixed() + self.cost * units));
        }
        let weight = (1.0 / f64::from(self.ticks)).max(1.0 / MEMORY);
        for (mean, x) in self.mean.iter_mut().zip([units, time, units * units, units * time]) {
            *mean += (x - *mean) * weight;
        }
        let [u, t, uu, ut] = self.mean;
        let variance = uu - u * u;
        if variance > (LEAST_SPREAD * u) * (LEAST_SPREAD * u) {
            self.cost = ((ut - u * t) / variance).clamp(*COST.start(), *COST.end());
        } else if t < self.cost * u {
            // No tick costs less than nothing beside its units.
            self.cost = (t / u).max(*COST.start());
        }
    }

    /// What every tick costs [ns].
    fn fixed(&self) -> f64 {
        (self.mean[1] - self.cost * self.mean[0]).max(0.0)
    }

    /// Units that the next tick may spend.
    pub fn budget(&self) -> u32 {
        if self.ticks < WARM_UP {
            return u32::MAX;
        }
        (((WORK_TIME - self.fixed()) / self.cost).max(0.0) as u32).max(self.floor)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_slower_machine_gets_a_smaller_budget_and_one_stall_changes_little() {
        let mut governor = Governor::new(1000);
        (0..400).for_each(|i| governor.measure(8_000 + i % 5 * 1000, 20 * (8_000 + i as u64 % 5 * 1000)));
        let before = governor.budget();
        assert!((40_500..=44_500).contains(&before), "{before}");
        governor.measure(10_000, 50_000_000);
        assert!(governor.budget() > before * 9 / 10, "{}", governor.budget());
        (0..2000).for_each(|i| governor.measure(8_000 + i % 5 * 1000, 200 * (8_000 + i as u64 % 5 * 1000)));
        assert!((3_300..5_200).contains(&governor.budget()), "{}", governor.budget());
        (0..4000).for_each(|_| governor.measure(10_000, 100_000_000));
        assert_eq!(governor.budget(), 1000);
    }

    #[test]
    fn what_every_tick_costs_is_not_taken_for_the_cost_of_units() {
        let mut governor = Governor::new(1000);
        // 150 µs whatever happens and 20 ns a unit: at rest, then with a tool coming, then at rest again.
        let cost = |units: u32| 150_000 + 20 * u64::from(units);
        (0..500).for_each(|_| governor.measure(1_000, cost(1_000)));
        assert!(governor.budget() > 10_000, "{}", governor.budget());
        (0..500).for_each(|i| governor.measure(1_000 + 20 * i, cost(1_000 + 20 * i)));
        assert!((34_000..36_000).contains(&governor.budget()), "{}", governor.budget());
        (0..5000).for_each(|_| governor.measure(1_000, cost(1_000)));
        assert!((34_000..36_000).contains(&governor.budget()), "{}", governor.budget());
    }
}
