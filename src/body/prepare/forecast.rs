//! What of a body a machine can move in real time: a touch of it, simulated as it would be served.
//!
//! Not a promise: the governor measures again in every tick. But it is the same planner that decides, with prices that are
//! measured on the same body.

use palpate_core::adaptation::Adaptivity;
use palpate_core::contact::safety::ForceLimits;
use palpate_core::contact::tool::{Coupling, Following, PoseSample, Shape, Tool, ToolEvent};
use palpate_core::math::{Pose, Real, Vec3};
use palpate_core::model::Body;
use palpate_core::model::step_class::{class_at_rest, step_of};
use palpate_core::simulation::{Budget, Inputs, Laps, Part, Prices, Settings, Simulation, Snapshot};
use palpate_core::stepping::work::{self, Costs};
use std::sync::Arc;
use std::time::Instant;

/// The ball that touches: a fingertip's radius [m], on a body that is wide enough for it, and how deep it goes over that.
const RADIUS: Real = 0.01;
const DEPTH: Real = 0.8;
/// On a smaller body, its radius over the body's longest side.
const WIDEST: Real = 0.1;
/// Ticks in which it comes, and in all.
const COMES: u32 = 300;
const TICKS: u32 = 700;
/// Occurrences that measured prices are means of.
const MEMORY: f64 = 64.0;
/// Elements in use at once at most.
const MOST_ELEMENTS: usize = 100_000;

/// Times the parts of ticks on the clock of the machine at hand.
struct Timed {
    last: Instant,
    costs: Costs,
}

impl Laps for Timed {
    fn lap(&mut self, part: Part, count: u32) {
        let now = Instant::now();
        self.costs.lap(part, count, (now - self.last).as_nanos() as u64);
        self.last = now;
    }
}

/// The parts of a tick on this machine, and what of a body runs under a touch.
#[derive(Clone, Debug)]
pub struct Forecast {
    /// What each part costs.
    pub prices: Prices,
    /// Time of a tick of the coarsest body at rest, a frame with it [s].
    pub floor: Real,
    /// Elements in use under the touch.
    pub elements: u32,
    /// Evaluations of elements in such a tick.
    pub evaluations: u32,
    /// Time that such a tick takes [s].
    pub tick: Real,
    /// Each level.
    pub levels: Vec<LevelForecast>,
}

/// What of one level runs in real time.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LevelForecast {
    /// Time that a tick takes with all of the level in use [s].
    pub tick: Real,
    /// Elements of it that are in use at once around a touch; all of them where all fit.
    pub elements: usize,
    /// How far around a touch on the surface those reach, alone [m]; `None` where all fit.
    pub reach: Option<Real>,
}

/// A ball pressed into the top of `body`, where a tick has `budget`.
fn touch(body: &Arc<Body>, budget: Budget, prices: Prices) -> Result<(Simulation, Costs), String> {
    let (low, high) = body.surface().bounds();
    let radius = RADIUS.min(WIDEST * (high - low).max());
    let ball = Tool { name: "ball".into(), shape: Shape::ball(radius), friction: 0.0 };
    let settings = Settings {
        gravity: Vec3::zeros(),
        tools: vec![ball],
        following: Following { speed: 1.0, engage_ticks: 1 },
        limits: ForceLimits { force: 1e3, torque: 1e2, slew: 1e9 },
        adaptivity: Some(Adaptivity::default()),
        most_elements: MOST_ELEMENTS,
    };
    let mut simulation = Simulation::new(body.clone(), settings, Snapshot::at_rest(body, 0, 1))?;
    let top = body.surface().vertices.iter().copied().max_by(|a, b| a.z.total_cmp(&b.z)).unwrap_or_default();
    let mut timed = Timed { last: Instant::now(), costs: Costs::default() };
    for tick in 0..TICKS {
        let down = (1.0 + DEPTH) * radius * Real::from(tick.min(COMES)) / Real::from(COMES);
        let pose = Pose { position: top + Vec3::z() * (2.0 * radius - down), ..Pose::default() };
        let (linear_velocity, angular_velocity) = (Vec3::zeros(), Vec3::zeros());
        let sample = PoseSample { sequence: tick, time_ns: 0, pose, linear_velocity, angular_velocity, buttons: 0 };
        let event = match tick {
            0 => ToolEvent::Attach { epoch: 1, period_ticks: 1, coupling: Coupling::RIGID },
            _ => ToolEvent::Pose(sample),
        };
        let mut inputs = Inputs { budget, prices: Some(prices), ..Inputs::default() };
        inputs.tools[0] = Some(event);
        timed.last = Instant::now();
        simulation.advance_with(&inputs, &mut timed);
        timed.lap(Part::Fixed, 1);
        timed.costs.end_tick(MEMORY);
    }
    Ok((simulation, timed.costs))
}

/// What of `body` runs on this machine, of which a tick has `limit` [ns].
///
/// # Errors
/// When the body's coarsest level is too large to be simulated at all.
pub fn forecast(body: &Arc<Body>, limit: u32) -> Result<Forecast, String> {
    // What it costs, from a touch that takes what it likes in about such a tick on a common machine; then what that buys.
    let prices = touch(body, Budget::of(limit), Prices::COMMON)?.1.prices();
    let (mut simulation, _) = touch(body, Budget::of(limit), prices)?;
    let (plan, evaluations) = (simulation.outputs().plan, simulation.outputs().element_evaluations);
    let pool = simulation.mesh().pool();
    let each = Real::from(plan.whole) * 1e-9 / Real::from(evaluations.max(1));
    let level = |r: usize| {
        let all = body.elements_of(r).len();
        let used = body.elements_of(r).filter(|e| pool.contains(*e)).count();
        let evaluations: Real = body.elements_of(r).map(|e| step_of(0) / step_of(class_at_rest(body, e))).sum();
        let tick = evaluations * each;
        if tick <= Real::from(limit) * 1e-9 {
            return LevelForecast { tick, elements: all, reach: None };
        }
        // Half a ball below the surface.
        let volume = used as Real / all as Real * body.level(r).volume();
        let reach = (volume * 3.0 / (2.0 * std::f64::consts::PI)).cbrt();
        LevelForecast { tick, elements: used, reach: Some(reach) }
    };
    let levels = (0..body.levels().len()).map(level).collect();
    let elements = pool.len() as u32;
    let start = simulation.reset_state().clone();
    simulation.mesh_mut().restore(body, &start);
    let floor = Real::from(work::floor(body, simulation.mesh(), &prices)) * 1e-9;
    Ok(Forecast { prices, floor, elements, evaluations, tick: Real::from(plan.whole) * 1e-9, levels })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::primitives::sphere_surface;
    use crate::prepare::{Recipe, Shape, prepare};
    use palpate_core::model::Material;

    #[test]
    fn a_slower_machine_runs_less_of_the_fine_levels_and_a_very_slow_one_none() {
        let recipe = Recipe {
            name: "ball".into(),
            shape: Shape::closed(sphere_surface(0.05, 0.004), vec![0.02, 0.012, 0.006]),
            material: Material::from_young(5e3, 0.45, 1000.0),
            inclusions: vec![],
            holds: vec![],
            damping_ratio: 0.15,
        };
        let body = Arc::new(prepare(&recipe, &mut |_, _, _| {}).unwrap());
        let elements = |slowness: u32| {
            let prices = Prices(Prices::COMMON.0.map(|price| price * slowness));
            let (simulation, _) = touch(&body, Budget::of(900_000), prices).unwrap();
            let pool = simulation.mesh().pool();
            [0, 1, 2].map(|r| body.elements_of(r).filter(|e| pool.contains(*e)).count())
        };
        let [fast, slow, slowest] = [1, 2, 12].map(elements);
        println!("elements by level: {fast:?}, {slow:?}, {slowest:?}");
        let all = |elements: [usize; 3]| elements.iter().sum::<usize>();
        assert!(all(fast) > all(slow) && slow[2] > 0, "{fast:?}, {slow:?}");
        assert_eq!((slowest[1], slowest[2]), (0, 0));
        let forecast = forecast(&body, 900_000).unwrap();
        assert!(forecast.floor > 0.0, "{forecast:?}");
        assert!(forecast.tick <= 900e-6 && forecast.evaluations >= forecast.elements);
    }
}
