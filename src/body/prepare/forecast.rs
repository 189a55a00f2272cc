//! What of a body a machine can move in real time: a touch of it, simulated as it would be served.
//!
//! Not a promise: the governor measures again in every tick. But it is the same planner that decides, and the same governor
//! that tells it what there is, with prices and margins that are measured on the same body and at the same rate.

use palpate_core::adaptation::Adaptivity;
use palpate_core::contact::safety::ForceLimits;
use palpate_core::contact::tool::{Coupling, Following, PoseSample, Shape, Tool, ToolEvent};
use palpate_core::math::{Bounds, Pose, Real, Vec3};
use palpate_core::model::Body;
use palpate_core::model::active_mesh::STAR_EVALUATIONS;
use palpate_core::model::step_class::{TICK_NS, class_at_rest, class_of_rest, step_of};
use palpate_core::simulation::{Inputs, Laps, Part, Prices, Settings, Simulation, Snapshot, TICKS_PER_FRAME};
use palpate_core::stepping::governor::{Governor, TickKind};
use palpate_core::stepping::work;
use std::sync::Arc;
use std::time::{Duration, Instant};

/// Radius of the ball that touches [m]: a fingertip's. A smaller one asks for fewer elements, a larger one for more.
const RADIUS: Real = 0.01;
/// Depth of the press over the ball's radius (no unit): a firm press. A deeper one asks for more contact points.
const DEPTH: Real = 0.8;
/// Greatest radius of the ball over the body's longest side (no unit): a larger ball would press a small body flat.
const WIDEST: Real = 0.1;
/// Ticks in which it comes.
const COMES: u32 = 300;
/// Ticks in all, as many as margins are kept for, and the last of them, whose mean counts.
const TICKS: u32 = 4096;
const COUNTED: u32 = 1024;
/// Elements in use at once at most.
const MOST_ELEMENTS: usize = 100_000;

/// Times the parts of ticks on the clock of the machine at hand.
struct Timed<'a> {
    last: Instant,
    governor: &'a mut Governor,
}

impl Laps for Timed<'_> {
    fn lap(&mut self, part: Part, count: u32) {
        let now = Instant::now();
        self.governor.lap(part, count, (now - self.last).as_nanos() as u64);
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
    /// Time that ticks are planned to take at most [s].
    pub planned: Real,
    /// Elements in use under the touch, in the mean.
    pub elements: u32,
    /// Evaluations of elements in such a tick.
    pub evaluations: u32,
    /// Time that such a tick is planned to take [s].
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

/// A ball that is pressed into the top of a body.
struct Touch {
    simulation: Simulation,
    /// Its radius, and the highest place of the body [m].
    radius: Real,
    top: Vec3,
    ticks: u32,
}

impl Touch {
    fn of(body: &Arc<Body>) -> Result<Self, String> {
        let Bounds { low, high } = body.surface().bounds();
        let radius = RADIUS.min(WIDEST * (high - low).max());
        let ball = Tool { name: "ball".into(), shape: Shape::ball(radius), friction: 0.0, pivot: None };
        let settings = Settings {
            gravity: Vec3::zeros(),
            tools: vec![ball],
            obstacles: vec![],
            organ_friction: Default::default(),
            support_motions: vec![],
            following: Following { speed: 1.0, engage_ticks: 1 },
            limits: ForceLimits { force: 1e3, torque: 1e2, slew: 1e9 },
            adaptivity: Some(Adaptivity::default()),
            most_elements: MOST_ELEMENTS,
        };
        let simulation = Simulation::new(body.clone(), settings, Snapshot::at_rest(body, 0, 1))?;
        let top = body.surface().vertices.iter().copied().max_by(|a, b| a.z.total_cmp(&b.z)).unwrap_or_default();
        Ok(Self { simulation, radius, top, ticks: 0 })
    }

    /// The next tick, with the rest of its `inputs`.
    fn tick(&mut self, mut inputs: Inputs, laps: &mut dyn Laps) {
        let down = (1.0 + DEPTH) * self.radius * Real::from(self.ticks.min(COMES)) / Real::from(COMES);
        let pose = Pose { position: self.top + Vec3::z() * (2.0 * self.radius - down), ..Pose::default() };
        let sample = PoseSample { sequence: self.ticks, time_ns: 0, pose, buttons: 0, opening: 0.0 };
        inputs.tools[0] = Some(match self.ticks {
            0 => ToolEvent::Attach { epoch: 1, period_ticks: 1, coupling: Coupling::RIGID },
            _ => ToolEvent::Pose(sample),
        });
        self.simulation.advance_with(&inputs, laps);
        self.ticks += 1;
    }
}

/// What of `body` runs on this machine: a touch that takes as long as it would, about four seconds. `computed` tells how long
/// this thread has had a processor [ns].
///
/// # Errors
/// When the body's coarsest level is too large to be simulated at all.
pub fn forecast(body: &Arc<Body>, mut computed: impl FnMut() -> u64) -> Result<Forecast, String> {
    let mut touch = Touch::of(body)?;
    let mut copy = touch.simulation.snapshot();
    let mut governor = Governor::new();
    let (mut elements, mut evaluations, mut planned) = (0, 0, 0);
    let mut deadline = Instant::now();
    for tick in 0..TICKS {
        let (began, had, prices) = (Instant::now(), computed(), governor.prices());
        let inputs = Inputs { budget: governor.budget(), prices: Some(prices), ..Inputs::default() };
        let mut timed = Timed { last: began, governor: &mut governor };
        touch.tick(inputs, &mut timed);
        let outputs = touch.simulation.outputs();
        let mut whole = outputs.plan.whole;
        let copies = outputs.tick % TICKS_PER_FRAME == TICKS_PER_FRAME / 2;
        let kind = TickKind::of(outputs.adapted.work > 0, outputs.frame || copies);
        if tick >= TICKS - COUNTED {
            elements += outputs.elements;
            evaluations += outputs.element_evaluations;
            planned += whole / COUNTED;
        }
        timed.lap(Part::Fixed, 1);
        if copies {
            touch.simulation.save_shape_into(&mut copy);
            timed.lap(Part::Copy, 1);
            whole += prices.of(Part::Copy, 1);
        }
        let computed = computed() - had;
        governor.end_tick(whole, kind, computed, (began.elapsed().as_nanos() as u64).saturating_sub(computed));
        // Between ticks other threads take the caches, as they will.
        deadline += Duration::from_nanos(TICK_NS);
        let now = Instant::now();
        std::thread::sleep(deadline.saturating_duration_since(now));
        deadline = deadline.max(now);
    }
    let (prices, budget) = (governor.prices(), governor.budget());
    let [elements, evaluations] = [elements, evaluations].map(|sum: u32| sum / COUNTED);
    let pool = touch.simulation.mesh().pool();
    let there = Real::from(budget.planned) * 1e-9;
    let each = Real::from(planned) * 1e-9 / Real::from(evaluations.max(1));
    let level = |r: usize| {
        let all = body.elements_of(r).len();
        let used = body.elements_of(r).filter(|e| pool.contains(*e)).count();
        let steps = |class: usize| step_of(0) / step_of(class);
        let elements: Real = body.elements_of(r).map(|e| steps(class_at_rest(body, e))).sum();
        let mut stars = 0.0;
        if body.is_smoothed() {
            let (rest, all) = (touch.simulation.mesh(), body.nodes_of(r));
            stars = all.map(|n| steps(class_of_rest(body, rest.omega_squared_of_star(body, n)))).sum();
        }
        let tick = (elements + STAR_EVALUATIONS as Real * stars) * each;
        if tick <= there {
            return LevelForecast { tick, elements: all, reach: None };
        }
        // Half a ball below the surface.
        let volume = used as Real / all as Real * body.level(r).volume();
        let reach = (volume * 3.0 / (2.0 * std::f64::consts::PI)).cbrt();
        LevelForecast { tick, elements: used, reach: Some(reach) }
    };
    let levels = (0..body.levels().len()).map(level).collect();
    let start = touch.simulation.reset_state().clone();
    touch.simulation.mesh_mut().restore(body, &start);
    let floor = Real::from(work::floor(body, touch.simulation.mesh(), &prices)) * 1e-9;
    Ok(Forecast { prices, floor, planned: there, elements, evaluations, tick: Real::from(planned) * 1e-9, levels })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::primitives::sphere_surface;
    use crate::prepare::{Recipe, Shape, prepare};
    use palpate_core::model::Material;
    use palpate_core::simulation::Budget;

    #[test]
    fn a_slower_machine_runs_less_of_the_fine_levels_and_a_very_slow_one_none() {
        let recipe = Recipe {
            name: "ball".into(),
            shape: Shape::closed(sphere_surface(0.05, 0.004), vec![0.02, 0.012, 0.006]),
            material: Material::from_young(5e3, 0.45, 1000.0),
            inclusions: vec![],
            holds: vec![],
            elements: Default::default(),
            damping_ratio: 0.15,
        };
        let body = Arc::new(prepare(&recipe, &mut |_, _, _| {}).unwrap());
        let elements = |slowness: u32| {
            let prices = Prices(Prices::COMMON.0.map(|price| price * slowness));
            let mut touch = Touch::of(&body).unwrap();
            for _ in 0..700 {
                touch.tick(Inputs { budget: Budget::of(900_000), prices: Some(prices), ..Inputs::default() }, &mut ());
            }
            let pool = touch.simulation.mesh().pool();
            [0, 1, 2].map(|r| body.elements_of(r).filter(|e| pool.contains(*e)).count())
        };
        let [fast, slow, slowest] = [1, 3, 12].map(elements);
        println!("elements by level: {fast:?}, {slow:?}, {slowest:?}");
        let all = |elements: [usize; 3]| elements.iter().sum::<usize>();
        assert!(all(fast) > all(slow), "{fast:?}, {slow:?}");
        assert_eq!((slowest[1], slowest[2]), (0, 0));
        let began = Instant::now();
        let forecast = forecast(&body, || began.elapsed().as_nanos() as u64).unwrap();
        assert!(forecast.floor > 0.0, "{forecast:?}");
        assert!(forecast.tick <= 900e-6 && forecast.evaluations >= forecast.elements, "{forecast:?}");
    }
}
