//! What of a body a machine can move in real time, from the speed at which it steps elements.
//!
//! Not a promise: the governor measures again in every tick and sheds resolution where the forecast was too bright.

use crate::math::Real;
use crate::model::element_kernel::Path;
use crate::model::step_class::{class_at_rest, step_of};
use crate::model::{ActiveMesh, Body, State};
use crate::stepping::step::{self, Workspace};
use crate::stepping::work;
use std::time::{Duration, Instant};

/// The machine is tried on the coarsest level with this many elements: about as many as are in use under a tool, so
/// that caches hold what they will hold then.
const TRIED: usize = 4_000;
/// How long it is tried.
const TRIAL: Duration = Duration::from_millis(250);
/// Units of work that a touch takes beside the elements: 32 contact points.
const TOUCH: Real = 6_000.0;
/// Part of the budget that refinement fills; the rest is for strains that shorten steps, and for changes of resolution.
const FILLED: Real = 0.75 * 11.0 / 16.0;
/// Work of refined elements over that of as many elements of a level that is in use as a whole: rows of interface nodes.
const ROWS: Real = 1.5;

/// Time of one unit of work ([`work`]) of `body` on this machine [s]: the median of ticks of one of its levels.
pub fn unit_time(body: &Body) -> Real {
    let tried = |r: &usize| body.elements_of(*r).len() >= TRIED;
    let level = (0..body.levels().len()).find(tried).unwrap_or(body.finest());
    let Ok(mut mesh) = ActiveMesh::new(body, &State::at_rest(body, level), usize::MAX) else { return Real::INFINITY };
    let units = Real::from(work::of_tick(&mesh, 0).max(1));
    let mut workspace = Workspace::new(&mesh, 0);
    let (began, mut times) = (Instant::now(), Vec::new());
    while times.len() < 3 || began.elapsed() < TRIAL {
        let tick = Instant::now();
        step::tick(Path::best(), body, &mut mesh, &mut [], Default::default(), &mut workspace);
        times.push(tick.elapsed().as_secs_f64());
    }
    times.sort_unstable_by(Real::total_cmp);
    times[times.len() / 2] / units
}

/// What of one level runs in real time.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LevelForecast {
    /// Time that a tick takes with all of the level in use [s].
    pub tick: Real,
    /// Elements of it that may be in use at once beside the coarsest level; all of them where all fit.
    pub elements: usize,
    /// How far around a touch on the surface those reach, alone [m]; `None` where all fit.
    pub reach: Option<Real>,
}

/// Each level of `body` on a machine that does a unit of work in `unit_time` [s] and has `work_time` [s] of each tick.
pub fn forecast(body: &Body, unit_time: Real, work_time: Real) -> Vec<LevelForecast> {
    let usable = work_time / unit_time * FILLED - TOUCH;
    // Units of a tick in which all of level `r` is in use.
    let units = |r: usize| {
        let mut evaluations = 0.0;
        let mut shortest = 0;
        for e in body.elements_of(r) {
            let class = class_at_rest(body, e);
            evaluations += 1.0 / (step_of(class) / step_of(0));
            shortest = shortest.max(class);
        }
        evaluations + 0.25 * body.nodes_of(r).len() as Real * (step_of(0) / step_of(shortest))
    };
    let coarsest = units(0);
    let level = |r: usize| {
        let (all, units) = (body.elements_of(r).len(), units(r));
        let tick = (units + TOUCH) * unit_time;
        if units <= usable {
            return LevelForecast { tick, elements: all, reach: None };
        }
        let part = if r == 0 { 0.0 } else { ((usable - coarsest) / (ROWS * units)).max(0.0) };
        // Half a ball below the surface.
        let volume = part * body.level(r).volume();
        let reach = (volume * 3.0 / (2.0 * std::f64::consts::PI)).cbrt();
        LevelForecast { tick, elements: (part * all as Real) as usize, reach: Some(reach) }
    };
    (0..body.levels().len()).map(level).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::primitives::sphere_surface;
    use crate::model::Material;
    use crate::prepare::{Recipe, Shape, prepare};

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
        let body = prepare(&recipe, &mut |_, _, _| {}).unwrap();
        let [fast, slow, slowest] = [1e-9, 40e-9, 1e-6].map(|unit| forecast(&body, unit, 850e-6));
        assert!(fast.iter().all(|level| level.reach.is_none()));
        assert_eq!((slow[0].reach, slow[2].elements < body.elements_of(2).len()), (None, true), "{slow:?}");
        let reach = slow[2].reach.unwrap();
        assert!((0.003..0.05).contains(&reach), "{reach}");
        assert!(slowest.iter().all(|level| level.reach == Some(0.0)), "{slowest:?}");
        assert!(unit_time(&body) > 0.0);
    }
}
