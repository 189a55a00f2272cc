//! Contact as the hand and the body feel it: what a press gives and takes, that tools never pull, that nothing a
//! client may do breaks the body, and that the same inputs give the same bits.

use palpate::scene::LoadedScene;
use palpate_body::prepare::{Recipe, Shape, prepare};
use palpate_core::contact::safety::ForceLimits;
use palpate_core::contact::tool::{Coupling, Following, PoseSample, Shape as ToolShape, Tool, ToolEvent};
use palpate_core::contact::tool::{Phase, ToolState};
use palpate_core::geometry::primitives::box_mesh;
use palpate_core::ids::Slot;
use palpate_core::math::{Pose, Real, Vec3, is_finite, normalized_quaternion};
use palpate_core::model::element_kernel;
use palpate_core::model::energy::energy;
use palpate_core::model::{Body, Material};
use palpate_core::simulation::{
    Budget, Inputs, MOST_FROZEN, Outputs, Settings, Simulation, Snapshot, TICK, TICKS_PER_FRAME,
};
use std::path::Path;
use std::sync::Arc;

#[path = "../common/random.rs"]
mod random;
use random::{Random, cases, whole};

mod compounds;
mod continuity;
mod coupling;
mod endurance;
mod feedback;
mod feel;
mod friction;
mod grasp;
mod parameters;
mod play;
mod shapes;
mod shown;
mod similar;
mod tunnel;

/// Edge of every body here [m].
const SIDE: Real = 0.1;
/// Middle of the top face.
const TOP: Vec3 = Vec3::new(0.05, 0.05, SIDE);
const UPRIGHT: [Real; 4] = [0.0, 0.0, 0.0, 1.0];
/// Turns a tool's own +z to +x.
const ALONG_X: [Real; 4] = [0.0, std::f64::consts::FRAC_1_SQRT_2, 0.0, std::f64::consts::FRAC_1_SQRT_2];

/// A body, what it is told, and how it starts.
struct Setup {
    body: Arc<Body>,
    settings: Settings,
    rest: Snapshot,
}

/// The bundled cube without gravity, held fast at its bottom, its finer level moving; `overrides` as for `--set`.
fn cube(overrides: &[&str]) -> Setup {
    let small = ["body.cells=[[4,4,4],[8,8,8]]", "body.active_level=1"];
    scene(&small.iter().chain(overrides).copied().collect::<Vec<_>>())
}

/// The same with three levels, adapting itself between them. Their nodes do not coincide, as on no real body.
fn adaptive_cube(overrides: &[&str]) -> Setup {
    scene(&["body.cells=[[3,3,3],[5,5,5],[9,9,9]]"].iter().chain(overrides).copied().collect::<Vec<_>>())
}

fn scene(overrides: &[&str]) -> Setup {
    let still = ["world.gravity=[0,0,0]", "world.settle=0"];
    let all: Vec<String> = still.iter().chain(overrides).map(|s| (*s).to_owned()).collect();
    let loaded = LoadedScene::load(Path::new("cube"), &all).unwrap();
    let body = Arc::new(loaded.build(&mut |_, _, _| {}).unwrap());
    Setup { settings: loaded.scene.settings(), rest: loaded.scene.at_rest(&body), body }
}

fn simulation(setup: &Setup) -> Simulation {
    Simulation::new(setup.body.clone(), setup.settings.clone(), setup.rest.clone()).unwrap()
}

fn attach() -> ToolEvent {
    ToolEvent::Attach { epoch: 1, period_ticks: 1, coupling: Coupling::RIGID }
}

fn posed(position: Vec3, orientation: [Real; 4]) -> ToolEvent {
    ToolEvent::Pose(PoseSample {
        sequence: 1,
        time_ns: 0,
        pose: Pose { position, orientation },
        buttons: 0,
        opening: 0.0,
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

/// How far the farthest active node is from where it is at rest [m].
fn rest_distance(simulation: &Simulation) -> Real {
    let (body, mesh) = (simulation.body(), simulation.mesh());
    mesh.active().iter().map(|s| (mesh.position(*s) - body.rest(mesh.node(*s))).norm()).fold(0.0, Real::max)
}

/// Speed of the fastest node [m/s].
fn fastest(simulation: &Simulation) -> Real {
    let mesh = simulation.mesh();
    let speed = |s: &Slot| mesh.motion.velocity[s.index()].iter().map(|c| c * c).sum::<Real>().sqrt();
    mesh.active().iter().map(speed).fold(0.0, Real::max)
}
