//! When to show which tick: frames come unevenly, motion on the screen must be even.

use super::TICK;

/// How long after it could have come a tick is shown [s]: a frame's 32 ms, so that the next frame is there to go
/// towards, and 8 ms for uneven arrivals.
pub const DELAY: f64 = 0.040;
/// How fast the estimate of the shortest way forgets [s per frame]: follows clocks that drift by 100 ppm and more.
const FORGET: f64 = 2e-5;
/// A frame later than this [s] means that time itself has jumped: the server stalled, or is another one.
const JUMP: f64 = 0.25;

/// Learns from arrivals how the server's ticks lie on this machine's clock.
#[derive(Clone, Debug, Default)]
pub struct Pace {
    /// Clock minus simulated time [s] of the frame that came the fastest lately.
    offset: Option<f64>,
}

impl Pace {
    /// A frame of `tick` came at `clock` [s].
    pub fn arrived(&mut self, tick: u64, clock: f64) {
        let sample = clock - tick as f64 * TICK;
        self.offset = Some(match self.offset {
            Some(offset) if (sample - offset).abs() < JUMP => sample.min(offset + FORGET),
            _ => sample,
        });
    }

    /// The tick to show at `clock` [s]; `None` before the first arrival.
    pub fn tick_at(&self, clock: f64) -> Option<f64> {
        self.offset.map(|offset| (clock - offset - DELAY) / TICK)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn uneven_arrivals_give_even_motion() {
        let mut pace = Pace::default();
        assert_eq!(pace.tick_at(0.0), None);
        let (mut shown, mut steps) = (None, Vec::new());
        for number in 0..300u64 {
            let late = [0.0, 0.004, 0.001, 0.006, 0.0][number as usize % 5];
            let clock = 10.0 + number as f64 * 0.032 + late;
            pace.arrived(32 * number, clock);
            let tick = pace.tick_at(10.0 + number as f64 * 0.032 + 0.01).unwrap();
            if let Some(last) = shown.replace(tick) {
                steps.push(tick - last);
            }
            // What is to be shown has come, and is not older than the delay and the frame's own time say.
            assert!(tick <= 32.0 * number as f64, "{tick} at frame {number}");
            assert!(tick >= 32.0 * number as f64 - 33.0, "{tick} at frame {number}");
        }
        assert!(steps.iter().skip(5).all(|step| (step - 32.0).abs() < 0.2), "{steps:?}");
    }

    #[test]
    fn a_stall_or_a_new_server_is_followed_at_once() {
        let mut pace = Pace::default();
        pace.arrived(1_000_000, 5.0);
        pace.arrived(32, 5.1);
        assert!((pace.tick_at(5.1).unwrap() - (32.0 - 40.0)).abs() < 1e-6);
        pace.arrived(64, 8.0);
        assert!((pace.tick_at(8.0).unwrap() - 24.0).abs() < 1e-6);
    }
}
