//! The adaptive body as a whole: what a change of resolution leaves as it was, what the levels have in common, and what
//! resolution may cost. Every test prints the figures that it judges.

use palpate_body::geometry::primitives::liver_surface;
use palpate_body::prepare::{Recipe, Region, Shape, prepare};
use palpate_core::adaptation::Adaptivity;
use palpate_core::contact::safety::ForceLimits;
use palpate_core::contact::tool::{Coupling, Following, PoseSample, Shape as ToolShape, Tool, ToolEvent};
use palpate_core::geometry::Surface;
use palpate_core::geometry::primitives::box_surface;
use palpate_core::ids::{Node, Slot};
use palpate_core::math::{Bounds, Pose, Real, Vec3};
use palpate_core::model::active_set::{ActiveSet, Change, Status};
use palpate_core::model::{ActiveMesh, Body, Material, State};
use palpate_core::simulation::{Budget, Inputs, Settings, Simulation, Snapshot, TICK, TICKS_PER_FRAME};
use std::sync::Arc;

#[path = "../common/random.rs"]
mod random;
use random::{Random, cases};
#[path = "../common/shared.rs"]
mod shared;

mod budget;
mod clicks;
mod collision;
mod conservation;
mod cost;
mod damping;
mod determinism;
mod gut;
mod levels;
mod modes;
mod nodule;
mod reference;
mod region;
mod release;
mod resolution;
mod wild;

/// Edge of the cube [m].
const SIDE: Real = 0.1;
/// Lattice constants of most covers here [m]: about 75, 270 and 900 nodes of the cube.
const THREE: [Real; 3] = [0.034, 0.021, 0.013];

impl Random {
    fn vector(&mut self, size: Real) -> Vec3 {
        Vec3::from_fn(|_, _| self.between(-size, size))
    }

    fn within(&mut self, Bounds { low, high }: Bounds) -> Vec3 {
        Vec3::from_fn(|i, _| self.between(low[i], high[i]))
    }
}

/// What a covered cube is made of.
#[derive(Clone)]
struct Cube {
    spacings: Vec<Real>,
    material: Material,
    /// Springs hold its face at x = 0.
    held: bool,
    damping_ratio: Real,
}

/// Undamped, of `young` [Pa], on the three usual levels.
fn elastic_cube(young: Real, held: bool) -> Cube {
    let material = Material::from_young(young, 0.35, 1000.0);
    Cube { spacings: THREE.to_vec(), material, held, damping_ratio: 0.0 }
}

impl Cube {
    fn body(&self) -> Arc<Body> {
        Arc::new(prepare(&self.recipe(), &mut |_, _, _| {}).unwrap())
    }

    fn recipe(&self) -> Recipe {
        let face =
            Region { bounds: Bounds::new(Vec3::zeros(), Vec3::new(0.0, SIDE, SIDE)), stiffness: None, exact: false };
        Recipe {
            name: "cube".into(),
            shape: Shape::closed(box_surface(Vec3::repeat(SIDE), [12; 3]), self.spacings.clone()),
            material: self.material,
            inclusions: vec![],
            holds: if self.held { vec![face] } else { vec![] },
            elements: Default::default(),
            damping_ratio: self.damping_ratio,
        }
    }
}

/// The bundled liver in a bed up to `bed` of its height, of `young` [Pa].
fn liver(bed: Real, spacings: Vec<Real>, young: Real, damping_ratio: Real) -> Arc<Body> {
    organ(liver_surface(0.006), bed, spacings, young, damping_ratio)
}

/// An organ in a bed up to `bed` of its height, of `young` [Pa].
fn organ(surface: Surface, bed: Real, spacings: Vec<Real>, young: Real, damping_ratio: Real) -> Arc<Body> {
    let Bounds { low, high } = surface.bounds();
    let bounds = Bounds::new(low, Vec3::new(high.x, high.y, low.z + bed * (high.z - low.z)));
    let recipe = Recipe {
        name: "liver".into(),
        shape: Shape::closed(surface, spacings),
        material: Material::from_young(young, 0.45, 1050.0),
        inclusions: vec![],
        holds: vec![Region { bounds, stiffness: None, exact: false }],
        elements: Default::default(),
        damping_ratio,
    };
    Arc::new(prepare(&recipe, &mut |_, _, _| {}).unwrap())
}

fn report(body: &Body) {
    let level = |r: usize| {
        let l = body.level(r);
        format!("{} nodes, {} elements, α {:.3}", l.mesh.nodes.len(), l.mesh.elements.len(), l.stabilisation)
    };
    let levels: Vec<String> = (0..body.levels().len()).map(level).collect();
    println!("{}: {}", body.name(), levels.join("; "));
}

/// One ball, no gravity, a hand without limits.
fn settings(adaptivity: Option<Adaptivity>) -> Settings {
    Settings {
        gravity: Vec3::zeros(),
        tools: vec![Tool { name: "ball".into(), shape: ToolShape::ball(0.01), friction: 0.0, pivot: None }],
        obstacles: vec![],
        organ_friction: Default::default(),
        support_motions: vec![],
        following: Following { speed: 1.0, engage_ticks: 1 },
        limits: ForceLimits { force: 100.0, torque: 10.0, slew: 1e6 },
        adaptivity,
        most_elements: 1_000_000,
    }
}

/// The body at rest with these active nodes.
fn simulation(body: &Arc<Body>, settings: &Settings, nodes: Vec<Node>) -> Simulation {
    let state = State::at_rest_on(body, nodes).unwrap();
    Simulation::new(body.clone(), settings.clone(), Snapshot::with_state(state, settings.tools.len())).unwrap()
}

fn uniform(body: &Body, level: usize) -> Vec<Node> {
    body.nodes_of(level).collect()
}

/// A mesh at rest with room for every element.
fn mesh_on(body: &Body, nodes: Vec<Node>) -> ActiveMesh {
    ActiveMesh::new(body, &State::at_rest_on(body, nodes).unwrap(), body.element_count()).unwrap()
}

/// The node to split first so that `n` may be split.
fn split_first(body: &Body, set: &ActiveSet, n: Node) -> Node {
    let mut first = n;
    while let Some(before) = set.first_needed(body, first) {
        first = before;
    }
    first
}

fn active_nodes(body: &Body, set: &ActiveSet) -> Vec<Node> {
    body.nodes().filter(|n| set.is_active(*n)).collect()
}

/// Refined around one to three random places, as tools would.
fn random_set(body: &Body, random: &mut Random) -> Vec<Node> {
    let mut set = ActiveSet::uniform(body, 0);
    let size = body.surface().bounds().size().norm() / 1.7;
    for _ in 0..1 + random.below(3) {
        let place = random.within(body.surface().bounds());
        let radius = random.between(0.1, 0.5) * size;
        for r in 0..body.finest() {
            for n in body.nodes_of(r) {
                if (body.rest(n) - place).norm() < radius * 0.6f64.powi(r as i32) {
                    while set.is_active(n) {
                        let first = split_first(body, &set, n);
                        set.apply(body, Change::Split(first));
                    }
                }
            }
        }
    }
    active_nodes(body, &set)
}

/// A batch of splits or of merges that are allowed side by side, as adaptation plans them: around one place, or
/// anywhere.
fn random_changes(body: &Body, set: &ActiveSet, random: &mut Random) -> Vec<Change> {
    let nodes = active_nodes(body, set);
    let place = random.within(body.surface().bounds());
    let near = random.below(2) == 0;
    let split = random.below(2) == 0;
    let most = 1 + random.below(12);
    let mut candidates: Vec<Node> = match near {
        true => nodes,
        false => (0..4 * most).map(|_| nodes[random.below(nodes.len())]).collect(),
    };
    if near {
        candidates.sort_by(|a, b| {
            let distance = |n: Node| (body.rest(n) - place).norm_squared();
            distance(*a).total_cmp(&distance(*b))
        });
    }
    let mut changes = Vec::new();
    for n in candidates {
        let change = match split {
            true if body.level_of(n) < body.finest() => Change::Split(split_first(body, set, n)),
            false if body.level_of(n) > 0 && set.may_merge(body, body.parent(n)) => Change::Merge(body.parent(n)),
            _ => continue,
        };
        if changes.len() < most && !changes.contains(&change) {
            changes.push(change);
        }
    }
    changes
}

/// Takes `mesh` to the set `target` by batches of allowed changes; gives every batch to `each` before it is made.
fn go_to(body: &Body, mesh: &mut ActiveMesh, target: &ActiveSet, mut each: impl FnMut(&mut ActiveMesh, &[Change])) {
    loop {
        let set = mesh.set();
        let all = || body.nodes();
        let too_coarse = |n: &Node| set.is_active(*n) && target.status(*n) == Status::Refined;
        let too_fine = |n: &Node| target.status(*n) != Status::Refined && set.may_merge(body, *n);
        let mut changes: Vec<Change> = Vec::new();
        for n in all().filter(too_coarse) {
            let change = Change::Split(split_first(body, set, n));
            if changes.len() < 16 && !changes.contains(&change) {
                changes.push(change);
            }
        }
        if changes.is_empty() {
            changes.extend(all().filter(too_fine).take(16).map(Change::Merge));
        }
        if changes.is_empty() {
            break;
        }
        each(mesh, &changes);
        mesh.apply(body, &changes);
    }
    assert!(body.nodes().all(|n| mesh.set().status(n) == target.status(n)), "the set is reached");
}

fn ball_at(position: Vec3) -> ToolEvent {
    ToolEvent::Pose(PoseSample {
        sequence: 1,
        time_ns: 0,
        pose: Pose { position, ..Pose::default() },
        buttons: 0,
        opening: 0.0,
    })
}

/// One event of the only tool.
fn inputs(event: ToolEvent) -> Inputs {
    let mut inputs = Inputs::default();
    inputs.tools[0] = Some(event);
    inputs
}

const ATTACH: ToolEvent = ToolEvent::Attach { epoch: 1, period_ticks: 1, coupling: Coupling::RIGID };

/// From 0 at `from` to 1 at `to`, without a kink.
fn ease(t: Real, from: Real, to: Real) -> Real {
    let s = ((t - from) / (to - from)).clamp(0.0, 1.0);
    s * s * (3.0 - 2.0 * s)
}

/// Presses the top of the cube with the ball of [`settings`] by 5 mm, holds, and strokes it slowly by 40 mm.
fn press_and_stroke(i: u64) -> Inputs {
    if i == 0 {
        return inputs(ATTACH);
    }
    let t = i as Real * TICK;
    let depth = -0.003 + 0.008 * ease(t, 0.0, 0.3);
    let x = 0.03 + 0.04 * ease(t, 0.5, 1.3);
    inputs(ball_at(Vec3::new(x, 0.05, SIDE + 0.01 - depth)))
}

/// Mean displacement of the mass from rest [m]: the sum that swings when the body does.
fn mean_displacement(body: &Body, mesh: &ActiveMesh) -> Vec3 {
    let moved = |slot: &Slot| (mesh.position(*slot) - body.rest(mesh.node(*slot))) * mesh.motion.mass[slot.index()];
    mesh.active().iter().map(moved).sum::<Vec3>() / body.mass()
}

/// The body at rest under `gravity`, brought there with its velocities fading.
fn sagging(body: &Arc<Body>, nodes: Vec<Node>, gravity: Vec3, ticks: usize) -> Simulation {
    let mut sagging = simulation(body, &Settings { gravity, ..settings(None) }, nodes);
    for _ in 0..ticks {
        sagging.advance(&Inputs::default());
        sagging.mesh_mut().change_motion(|_, _, v| *v *= 0.95);
    }
    sagging.mesh_mut().change_motion(|_, _, v| *v = Vec3::zeros());
    sagging
}

/// The same state with other settings.
fn with_settings(before: &Simulation, settings: &Settings) -> Simulation {
    Simulation::new(before.body().clone(), settings.clone(), before.snapshot()).unwrap()
}

/// Zeros of a sampled signal [s], by linear interpolation between ticks.
fn zeros(signal: &[Real]) -> Vec<Real> {
    let crossing = |(i, pair): (usize, &[Real])| {
        let [a, b] = [pair[0], pair[1]];
        (a * b < 0.0).then(|| (i as Real + a / (a - b)) * TICK)
    };
    signal.windows(2).enumerate().filter_map(crossing).collect()
}

/// Period [s] of a signal that swings about zero.
fn period(signal: &[Real]) -> Real {
    let zeros = zeros(signal);
    assert!(zeros.len() >= 5, "{} zeros: no swing to be measured", zeros.len());
    2.0 * (zeros[zeros.len() - 1] - zeros[0]) / (zeros.len() - 1) as Real
}
