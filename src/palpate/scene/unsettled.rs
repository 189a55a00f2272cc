//! Starts that nobody should touch: bodies that have not come to rest, have turned inside out, or are not where they were put.

use super::Scene;
use palpate_core::math::{Bounds, Real, Vec3};
use palpate_core::model::{Body, Organ};
use palpate_core::simulation::{Inputs, Simulation, Snapshot, TICK};
use std::sync::Arc;

/// Why a start is refused.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[error("{organ} {fault}. Remedy: {remedy}; or world.unsettled = true, to start with it so")]
pub struct Unsettled {
    /// Which organ.
    pub organ: String,
    /// What is wrong.
    pub fault: Fault,
    remedy: &'static str,
}

/// What is wrong with a start.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum Fault {
    /// An element has no volume left, or is inside out.
    #[error("has been crushed by its own weight: the least det F is {det_f:.2}")]
    Inverted {
        /// Least ratio of an element's volume to that at rest; below 0: inside out.
        det_f: Real,
    },
    /// It is somewhere else.
    #[error("has settled {:.0} mm from where it was put, and is {:.0} mm wide", 1e3 * distance, 1e3 * width)]
    Far {
        /// Largest displacement of a vertex [m].
        distance: Real,
        /// Diagonal of its box at rest [m].
        width: Real,
    },
    /// It goes on moving.
    #[error(
        "is not at rest after {settle} s of settling: within {:.0} ms it moves by {:.2} mm, and is {:.0} mm wide",
        1e3 * LOOK_TICKS as Real * TICK, 1e3 * distance, 1e3 * width
    )]
    Moving {
        /// Largest motion of a vertex in that time [m].
        distance: Real,
        /// Diagonal of its box at rest [m].
        width: Real,
        /// `world.settle` [s].
        settle: Real,
    },
}

/// Ticks that a start is watched for, undamped but by its own damping: a third of the period of a soft organ.
const LOOK_TICKS: u64 = 128;
/// Ticks between two looks at where it is: an organ that swings to and fro may end where it began.
const LOOK_EVERY: u64 = 16;
/// Most that it may move meanwhile, over its diagonal. Below 0.002 organs that swing down after a coarse settling are
/// refused; above 0.01 a hand feels the body come towards it.
const MOST_MOTION: Real = 0.005;
/// Most that a vertex may be from where it was put, over the diagonal. The softest organ that still is one sags by a tenth;
/// what has slid off its support or fallen over is farther.
const MOST_DISTANCE: Real = 0.25;

/// How an organ starts: what [`Scene::check_settled`] judges by.
#[derive(Clone, Debug, PartialEq)]
pub struct Start {
    /// Its name.
    pub organ: String,
    /// Diagonal of its box at rest [m].
    pub width: Real,
    /// Largest displacement of a vertex from where it was put [m].
    pub distance: Real,
    /// Largest distance of a vertex from where it starts, within 128 ms [m].
    pub motion: Real,
}

impl Scene {
    /// Refuses `start`, as [`Scene::settled`] gives it for `body`, where it is unfit to be touched, unless the scene says
    /// `unsettled`, or asks for no settling: then the body starts as it was put.
    ///
    /// # Errors
    /// With what is wrong, and what to do.
    pub fn check_settled(&self, body: &Arc<Body>, start: &Snapshot) -> Result<(), Unsettled> {
        if self.world.unsettled || self.world.settle == 0.0 {
            return Ok(());
        }
        let (det_f, starts) = self.starts(body, start);
        for Start { organ, width, distance, motion } in starts {
            let refused = |fault, remedy| Err(Unsettled { organ: organ.clone(), fault, remedy });
            if det_f <= 0.0 {
                let remedy = "a stiffer material (material.youngs_modulus), or more of it held ([[hold]]) or on a floor ([[obstacle]])";
                return refused(Fault::Inverted { det_f }, remedy);
            }
            if distance > MOST_DISTANCE * width {
                let remedy = "hold it ([[hold]]), put it on a floor ([[obstacle]]), or make it stiffer (material.youngs_modulus)";
                return refused(Fault::Far { distance, width }, remedy);
            }
            if motion > MOST_MOTION * width {
                let remedy = "settle for longer (world.settle), or hold more of it ([[hold]])";
                return refused(Fault::Moving { distance: motion, width, settle: self.world.settle }, remedy);
            }
        }
        Ok(())
    }

    /// Least det F of the elements of `body` in the first 128 ms after `start`, and how each organ starts.
    pub fn starts(&self, body: &Arc<Body>, start: &Snapshot) -> (Real, Vec<Start>) {
        let Ok(mut simulation) = Simulation::new(body.clone(), self.still_settings(), start.clone()) else {
            return (Real::INFINITY, Vec::new());
        };
        let rest = &body.surface().vertices;
        let (mut before, mut after) = (rest.clone(), rest.clone());
        simulation.mesh().skin(&mut before);
        let farthest = |from: &[Vec3], to: &[Vec3]| {
            let apart = from.iter().zip(to).map(|(a, b)| (a - b).norm());
            apart.fold(0.0, |most, apart| if apart.is_finite() { Real::max(most, apart) } else { Real::INFINITY })
        };
        let start = |organ: &Organ| {
            let own = organ.vertices.clone();
            Start {
                organ: organ.name.clone(),
                width: Bounds::of(rest[own.clone()].iter().copied()).size().norm(),
                distance: farthest(&rest[own.clone()], &before[own]),
                motion: 0.0,
            }
        };
        let mut starts: Vec<Start> = body.organs().iter().map(start).collect();
        let mut det_f = Real::INFINITY;
        for tick in 1..=LOOK_TICKS {
            det_f = det_f.min(simulation.advance(&Inputs::default()).extremes.det_f);
            if tick.is_multiple_of(LOOK_EVERY) {
                simulation.mesh().skin(&mut after);
                for (start, organ) in starts.iter_mut().zip(body.organs()) {
                    let own = organ.vertices.clone();
                    start.motion = start.motion.max(farthest(&before[own.clone()], &after[own]));
                }
            }
        }
        (det_f, starts)
    }
}
