//! A body that folds onto itself: its sides meet as organs do, keep momenta and gain nothing, and pass on what pushes them.

use palpate_body::prepare::{self, Recipe, Region, prepare};
use palpate_core::adaptation::Adaptivity;
use palpate_core::contact::meeting::Between;
use palpate_core::contact::safety::ForceLimits;
use palpate_core::contact::tool::{Coupling, Following, PoseSample, Shape as ToolShape, Tool, ToolEvent};
use palpate_core::geometry::TetMesh;
use palpate_core::geometry::primitives::box_mesh;
use palpate_core::geometry::tet_mesh::volume;
use palpate_core::ids::{Slot, Vertex};
use palpate_core::math::{Bounds, Pose, Real, Vec3};
use palpate_core::model::meeting::Meeting;
use palpate_core::model::{Body, Material, energy};
use palpate_core::simulation::{Inputs, Settings, Simulation, Snapshot};
use std::collections::BTreeMap;
use std::sync::Arc;

/// Two prongs on a foot, on each level so many cells to the gap between them, of this width [m] over both, and this material [Pa].
#[derive(Clone, Copy)]
struct Fork {
    width: Real,
    cells: &'static [u32],
    youngs_modulus: Real,
    poisson_ratio: Real,
    held: bool,
}

const FORK: Fork = Fork { width: 0.05, cells: &[1], youngs_modulus: 2e4, poisson_ratio: 0.35, held: false };

impl Fork {
    /// Prongs of two gaps' width and five gaps' height above the foot, which is as high as the gap is wide.
    fn mesh(&self, n: u32) -> TetMesh {
        let gap = self.width / 5.0;
        let mut mesh = box_mesh(Vec3::new(5.0, 2.0, 6.0) * gap, [5 * n, 2 * n, 6 * n]);
        let middle = |e: &[u32; 4]| e.iter().map(|n| mesh.nodes[*n as usize]).sum::<Vec3>() / 4.0;
        let is_between = |p: Vec3| (2.0 * gap..3.0 * gap).contains(&p.x) && p.z > gap;
        let elements: Vec<_> = mesh.elements.iter().filter(|e| !is_between(middle(e))).copied().collect();
        let mut number = vec![None; mesh.nodes.len()];
        let mut nodes = Vec::new();
        mesh.elements = elements
            .iter()
            .map(|e| {
                e.map(|n| {
                    *number[n as usize].get_or_insert_with(|| {
                        nodes.push(mesh.nodes[n as usize]);
                        nodes.len() as u32 - 1
                    })
                })
            })
            .collect();
        mesh.nodes = nodes;
        mesh
    }

    fn body(&self) -> Body {
        let bounds = Bounds::new(Vec3::zeros(), Vec3::new(self.width, self.width, 0.0));
        let hold = Region { bounds, stiffness: None, exact: true };
        let recipe = Recipe {
            name: "fork".into(),
            shape: prepare::Shape::meshes(self.cells.iter().map(|n| self.mesh(*n))),
            material: Material::from_young(self.youngs_modulus, self.poisson_ratio, 1000.0),
            inclusions: vec![],
            holds: if self.held { vec![hold] } else { vec![] },
            elements: Default::default(),
            damping_ratio: if self.held { 0.3 } else { 0.0 },
        };
        prepare(&recipe, &mut |_, _, _| {}).unwrap()
    }

    /// With a ball where `radius` [m] is given.
    fn simulation(&self, friction: Real, radius: Option<Real>) -> Simulation {
        let body = Arc::new(self.body());
        let ball = |radius| Tool { name: "ball".into(), shape: ToolShape::ball(radius), friction: 0.0, pivot: None };
        let settings = Settings {
            gravity: Vec3::zeros(),
            tools: radius.map(ball).into_iter().collect(),
            obstacles: vec![],
            organ_friction: Between::all(friction),
            support_motions: vec![],
            following: Following { speed: 1.0, engage_ticks: 10 },
            limits: ForceLimits { force: 100.0, torque: 10.0, slew: 1e6 },
            adaptivity: (self.cells.len() > 1).then(Adaptivity::default),
            most_elements: body.element_count(),
        };
        let start = Snapshot::at_rest(&body, 0, settings.tools.len());
        Simulation::new(body, settings, start).unwrap()
    }

    /// Prongs fly at each other with this speed [m/s] each.
    fn clapping(&self, friction: Real, speed: Real) -> Simulation {
        let mut simulation = self.simulation(friction, None);
        let half = 0.5 * self.width;
        simulation.mesh_mut().change_motion(|_, p, v| {
            let up = (p.z / self.width - 0.2).max(0.0);
            *v = Vec3::new(if p.x < half { speed * up } else { -0.8 * speed * up }, 0.1 * speed * up, 0.0);
        });
        simulation
    }
}

/// Mass [kg], place [m] and velocity [m/s] of each active node.
fn nodes(simulation: &Simulation) -> Vec<(Real, Vec3, Vec3)> {
    let mesh = simulation.mesh();
    let of = |s: &Slot| {
        let velocity = Vec3::from_row_slice(&mesh.motion.velocity[s.index()][..3]);
        (mesh.motion.mass[s.index()], mesh.position(*s), velocity)
    };
    mesh.active().iter().map(of).collect()
}

fn momenta(simulation: &Simulation) -> (Vec3, Vec3) {
    let of = |(m, x, v): (Real, Vec3, Vec3)| (v * m, x.cross(&v) * m);
    let add = |sum: (Vec3, Vec3), one: (Vec3, Vec3)| (sum.0 + one.0, sum.1 + one.1);
    nodes(simulation).into_iter().map(of).fold((Vec3::zeros(), Vec3::zeros()), add)
}

fn energy(simulation: &Simulation) -> Real {
    energy::energy(simulation.body(), simulation.mesh(), Vec3::zeros()).total()
}

/// Where nodes are at rest [m], by slot.
fn rest(simulation: &Simulation) -> BTreeMap<Slot, Vec3> {
    let mesh = simulation.mesh();
    mesh.active().iter().map(|s| (*s, mesh.position(*s))).collect()
}

/// Most inner vertices of the left prong that are in the right one by more than `tolerance` [m].
fn through(simulation: &Simulation, rest: &BTreeMap<Slot, Vec3>, width: Real, tolerance: Real) -> usize {
    let (body, mesh) = (simulation.body(), simulation.mesh());
    let is_right = |e: &Vec<Slot>| e.iter().map(|s| rest[s].x).sum::<Real>() > 4.0 * 0.5 * width;
    let elements = body.elements().filter_map(|e| Some(mesh.pool().nodes_of(e)?.collect()));
    let right: Vec<Vec<Slot>> = elements.filter(is_right).collect();
    let is_in = |p: Vec3| {
        right.iter().any(|e| {
            let u: [Vec3; 4] = std::array::from_fn(|i| mesh.position(e[i]));
            (0..4).all(|i| {
                let mut v = u;
                v[i] = p;
                volume(&v) >= 0.0
            })
        })
    };
    let place = &body.surface().vertices;
    let inner = (0..place.len()).filter(|v| (place[*v].x - 0.4 * width).abs() < 1e-9 && place[*v].z > 0.2 * width);
    inner.filter(|v| is_in(mesh.vertex(Vertex::at(*v)) - Vec3::x() * tolerance)).count()
}

fn pushed(simulation: &Simulation) -> Real {
    simulation.meetings().iter().filter(|m| m.held).map(|m| m.force.norm()).sum()
}

#[test]
fn prongs_that_clap_keep_both_momenta_and_gain_no_energy() {
    let fine = Fork { cells: &[2], poisson_ratio: 0.45, ..FORK };
    let small = Fork { width: 0.02, youngs_modulus: 5e3, ..FORK };
    for (fork, friction, speed) in [(FORK, 0.0, 0.5), (fine, 0.5, 0.4), (small, 0.3, 0.2)] {
        let mut simulation = fork.clapping(friction, speed);
        let (p, l) = momenta(&simulation);
        let scale: Real = nodes(&simulation).iter().map(|(m, _, v)| m * v.norm()).sum();
        let (before, mut most, mut worst) = (energy(&simulation), Real::NEG_INFINITY, (0.0, 0.0));
        let (mut inside, mut force, rest) = (0, 0.0, rest(&simulation));
        for tick in 0..300 {
            simulation.advance(&Inputs::default());
            let now = momenta(&simulation);
            worst = ((now.0 - p).norm().max(worst.0), (now.1 - l).norm().max(worst.1));
            most = energy(&simulation).max(most);
            if tick % 10 == 0 {
                inside = through(&simulation, &rest, fork.width, 0.03 * fork.width).max(inside);
            }
            force = pushed(&simulation).max(force);
        }
        let [linear, angular, end] = [worst.0 / scale, worst.1 / (scale * fork.width), energy(&simulation) / before];
        println!(
            "{} m, {speed} m/s, friction {friction}: {linear:.0e}, {angular:.0e}; energy {:.4} to {end:.3}; {force} N",
            fork.width,
            most / before
        );
        assert!(force > 0.01);
        assert!(linear < 1e-13 && angular < 1e-13 && most < 1.0001 * before);
        assert_eq!(inside, 0);
    }
}

/// What presses a prong against the other is felt there, and by the hand.
#[test]
fn a_prong_that_is_pressed_against_the_other_takes_it_along() {
    let large = Fork { width: 0.1, youngs_modulus: 1e5, poisson_ratio: 0.45, ..FORK };
    for fork in [FORK, Fork { cells: &[2], ..FORK }, large, Fork { cells: &[1, 2], ..FORK }] {
        let fork = Fork { held: true, ..fork };
        let (gap, radius) = (fork.width / 5.0, fork.width / 8.0);
        let mut simulation = fork.simulation(0.3, Some(radius));
        let mut inputs = Inputs::default();
        inputs.tools[0] = Some(ToolEvent::Attach { epoch: 1, period_ticks: 1, coupling: Coupling::RIGID });
        simulation.advance(&inputs);
        let (mut alone, mut jump, mut before, mut changes) = (0.0, 0.0, 0.0, 0);
        let rest = rest(&simulation);
        for tick in 1..2000u32 {
            let far = gap * (2.5 * (Real::from(tick) / 1200.0).min(1.0) - 0.2);
            let position = Vec3::new(far - radius, gap, 5.0 * gap);
            let pose = Pose { position, ..Pose::default() };
            let mut inputs = Inputs::default();
            inputs.tools[0] = Some(ToolEvent::Pose(PoseSample { sequence: tick, pose, ..PoseSample::default() }));
            let force = -simulation.advance(&inputs).tools[0].state.physical_force.x;
            if simulation.meetings().iter().all(|m| m.force == Vec3::zeros()) {
                alone = force / far.max(1e-9);
            }
            let adapted = simulation.outputs().adapted;
            changes += adapted.splits + adapted.merges;
            jump = (force - before).abs().max(jump);
            before = force;
        }
        let (far, on_other) = (2.3 * gap, pushed(&simulation));
        let tip = |x: Real| {
            let rest = &simulation.body().surface().vertices;
            let v = (0..rest.len()).find(|v| (rest[*v] - Vec3::new(x, 0.0, 6.0 * gap)).norm() < 1e-9).unwrap();
            simulation.mesh().vertex(Vertex::at(v)).x - x
        };
        // Once resolutions are mixed slots are of other nodes than at the start.
        let inside = if changes == 0 { through(&simulation, &rest, fork.width, 0.05 * gap) } else { 0 };
        let deepest = simulation.meetings().iter().map(|m| m.gap).fold(0.0, Real::min);
        let [near, other] = [tip(2.0 * gap), tip(3.0 * gap)];
        println!("{before} N of {} N alone, {on_other} N on the other", alone * far);
        println!("tips are {near} and {other} m away, at most {jump} N a tick, {deepest} m deep, {changes} changes");
        assert!(on_other > 0.1 * before && before > 1.15 * alone * far);
        assert!(inside == 0 && deepest > -0.02 * gap);
        assert!(near > other && other > 0.3 * gap);
        assert_eq!(changes > 0, fork.cells.len() > 1);
        assert!(jump < 0.05 * before);
    }
}

#[test]
fn a_state_in_which_a_body_is_folded_goes_on_as_it_would_have() {
    let mut first = FORK.clapping(0.3, 1.0);
    while pushed(&first) == 0.0 {
        first.advance(&Inputs::default());
    }
    let snapshot = first.snapshot();
    let mut second = Simulation::new(first.body().clone(), first.settings().clone(), snapshot).unwrap();
    let mut let_go = false;
    for _ in 0..100 {
        first.advance(&Inputs::default());
        second.advance(&Inputs::default());
        assert_eq!(first.hash(), second.hash());
        let_go |= !first.meetings().iter().any(|m| m.held);
    }
    assert!(let_go);
}

/// Sides that are far apart along the surface, but behind each other.
#[test]
fn what_is_thin_does_not_meet_its_own_other_side() {
    let plate = Fork { width: 0.005, ..FORK };
    let mut simulation = plate.clapping(0.0, 0.2);
    let half = 0.5 * plate.width;
    let body = simulation.body().clone();
    let rest = |v: Vertex| body.surface().vertices[v.index()].x;
    let is_left = |m: &Meeting| {
        let on_left =
            |vertices: &[Vertex]| vertices.iter().map(|v| rest(*v)).sum::<Real>() < half * vertices.len() as Real;
        (on_left(&[body.patches().middle(m.patch)]), on_left(&body.triangle(m.triangle)))
    };
    // What is between the prongs leans over the foot.
    let is_high = |m: &&Meeting| body.surface().vertices[body.patches().middle(m.patch).index()].z > half;
    let mut all = Vec::new();
    for _ in 0..100 {
        all.extend(simulation.meetings().iter().filter(is_high).map(is_left));
        simulation.advance(&Inputs::default());
    }
    assert!(!all.is_empty() && all.iter().all(|(patch, triangle)| patch != triangle));
}
