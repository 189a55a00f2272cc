//! Contact as the hand and the body feel it: what a press gives and takes, that tools never pull, that nothing a
//! client may do breaks the body, and that the same inputs give the same bits.

use palpate::contact::safety::ForceLimits;
use palpate::contact::tool::{Following, PoseSample, Shape as ToolShape, Tool, ToolEvent};
use palpate::contact::tool::{Phase, ToolState};
use palpate::geometry::primitives::box_mesh;
use palpate::math::{Pose, Real, Vec3, is_finite, normalized_quaternion};
use palpate::model::element_kernel;
use palpate::model::energy::energy;
use palpate::model::skin::skin;
use palpate::model::{Body, Material};
use palpate::prepare::{Recipe, Shape, prepare};
use palpate::scene::LoadedScene;
use palpate::simulation::{Inputs, Outputs, Settings, Simulation, Snapshot, TICK, TICKS_PER_FRAME};
use std::path::Path;
use std::sync::Arc;

mod endurance;
mod feel;

/// Edge of every body here [m].
const SIDE: Real = 0.1;
/// Middle of the top face.
const TOP: Vec3 = Vec3::new(0.05, 0.05, SIDE);
const UPRIGHT: [Real; 4] = [0.0, 0.0, 0.0, 1.0];
/// Turns a tool's own +z to +x.
const ALONG_X: [Real; 4] = [0.0, std::f64::consts::FRAC_1_SQRT_2, 0.0, std::f64::consts::FRAC_1_SQRT_2];

/// The bundled cube without gravity, held fast at its bottom; `overrides` as for `--set`.
fn cube(overrides: &[&str]) -> (Arc<Body>, Settings) {
    let small = ["body.cells=[[4,4,4],[8,8,8]]", "body.active_level=1", "world.gravity=[0,0,0]", "world.settle=0"];
    let all: Vec<String> = small.iter().chain(overrides).map(|s| (*s).to_owned()).collect();
    let loaded = LoadedScene::load(Path::new("cube"), &all).unwrap();
    (Arc::new(loaded.build(&mut |_, _, _| {}).unwrap()), loaded.scene.settings())
}

fn simulation((body, settings): &(Arc<Body>, Settings)) -> Simulation {
    let rest = Snapshot::at_rest(body, settings.tools.len());
    Simulation::new(body.clone(), settings.clone(), rest).unwrap()
}

fn attach() -> ToolEvent {
    ToolEvent::Attach { epoch: 1, period_ticks: 1 }
}

fn posed(position: Vec3, orientation: [Real; 4]) -> ToolEvent {
    ToolEvent::Pose(PoseSample {
        sequence: 1,
        time_ns: 0,
        pose: Pose { position, orientation },
        linear_velocity: Vec3::zeros(),
        angular_velocity: Vec3::zeros(),
        buttons: 0,
    })
}

fn at(position: Vec3) -> ToolEvent {
    posed(position, UPRIGHT)
}

/// One event for each tool, in order.
fn inputs(events: &[Option<ToolEvent>]) -> Inputs {
    let mut inputs = Inputs::default();
    inputs.tools[..events.len()].copy_from_slice(events);
    inputs
}

/// One tick of the only tool.
fn tick(simulation: &mut Simulation, event: ToolEvent) -> &Outputs {
    simulation.advance(&inputs(&[Some(event)]))
}

/// From 0 at `from` to 1 at `to`, without a kink.
fn ease(t: Real, from: Real, to: Real) -> Real {
    let s = ((t - from) / (to - from)).clamp(0.0, 1.0);
    s * s * (3.0 - 2.0 * s)
}

fn rest_distance(simulation: &Simulation) -> Real {
    let rest = &simulation.body().level().mesh.nodes;
    simulation.snapshot().body.position.iter().zip(rest).map(|(x, u)| (x - u).norm()).fold(0.0, Real::max)
}
