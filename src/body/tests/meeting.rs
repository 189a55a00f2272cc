//! Organs that meet: what one feels the other does, nothing is gained, they carry each other, and hold and slide by Coulomb's law.

use palpate_body::prepare::merge::merge;
use palpate_body::prepare::{self, Recipe, Region, prepare};
use palpate_core::adaptation::Adaptivity;
use palpate_core::contact::meeting::Between;
use palpate_core::contact::safety::ForceLimits;
use palpate_core::contact::tool::{Coupling, Following, PoseSample, Shape as ToolShape, Tool, ToolEvent};
use palpate_core::geometry::primitives::box_mesh;
use palpate_core::ids::{OrganId, Slot, Vertex};
use palpate_core::math::{Bounds, Pose, Real, Vec3};
use palpate_core::model::energy;
use palpate_core::model::meeting::Meeting;
use palpate_core::model::{Body, Material};
use palpate_core::simulation::{Budget, Inputs, Parameter, Settings, Simulation, Snapshot};
use std::sync::Arc;

/// A block of this size [m] with so many cells along x and as large ones along z on each level, of a material [Pa], at `position` [m].
#[derive(Clone, Copy)]
struct Block {
    size: Vec3,
    cells: &'static [u32],
    youngs_modulus: Real,
    poisson_ratio: Real,
    position: Vec3,
    /// Whether its lower face is held.
    held: bool,
}

impl Block {
    fn body(&self) -> (Body, Pose) {
        let bounds = Bounds::new(Vec3::zeros(), Vec3::new(self.size.x, self.size.y, 0.0));
        let hold = Region { bounds, stiffness: None, exact: true };
        let cells = |n: &u32| [*n, *n, (Real::from(*n) * self.size.z / self.size.x).ceil() as u32];
        let recipe = Recipe {
            name: "block".into(),
            shape: prepare::Shape::meshes(self.cells.iter().map(|n| box_mesh(self.size, cells(n)))),
            material: Material::from_young(self.youngs_modulus, self.poisson_ratio, 1000.0),
            inclusions: vec![],
            holds: if self.held { vec![hold] } else { vec![] },
            elements: Default::default(),
            damping_ratio: 0.0,
        };
        (prepare(&recipe, &mut |_, _, _| {}).unwrap(), Pose { position: self.position, ..Pose::default() })
    }
}

const SOFT: Block = Block {
    size: Vec3::new(0.05, 0.05, 0.05),
    cells: &[4],
    youngs_modulus: 5e3,
    poisson_ratio: 0.35,
    position: Vec3::new(0.0, 0.0, 0.0),
    held: false,
};

/// The blocks as organs, without a tool.
fn simulation(blocks: &[Block], damping_ratio: Real, friction: Real, gravity: Vec3) -> Simulation {
    let body = Arc::new(merge(blocks.iter().map(Block::body).collect(), damping_ratio).unwrap());
    let settings = Settings {
        gravity,
        tools: vec![],
        obstacles: vec![],
        organ_friction: Between::all(friction),
        support_motions: vec![],
        following: Following { speed: 1.0, engage_ticks: 10 },
        limits: ForceLimits { force: 100.0, torque: 10.0, slew: 1e6 },
        adaptivity: None,
        most_elements: body.element_count(),
    };
    Simulation::new(body.clone(), settings, Snapshot::at_rest(&body, 0, 0)).unwrap()
}

/// The blocks as organs of a resolution that follows a ball, which holds still at `from` [m] for 100 ticks, goes to `to` in 500, and stays.
struct Pressed {
    simulation: Simulation,
    from: Vec3,
    to: Vec3,
    tick: u32,
    budget: Budget,
}

impl Pressed {
    fn new(blocks: &[Block], radius: Real, [from, to]: [Vec3; 2]) -> Self {
        let without = simulation(blocks, 0.3, 0.3, Vec3::zeros());
        let tools = vec![Tool { name: "ball".into(), shape: ToolShape::ball(radius), friction: 0.0, pivot: None }];
        let settings = Settings { tools, adaptivity: Some(Adaptivity::default()), ..without.settings().clone() };
        let body = without.body().clone();
        let mut simulation = Simulation::new(body.clone(), settings, Snapshot::at_rest(&body, 0, 1)).unwrap();
        let mut inputs = Inputs::default();
        inputs.tools[0] = Some(ToolEvent::Attach { epoch: 1, period_ticks: 1, coupling: Coupling::RIGID });
        simulation.advance(&inputs);
        Self { simulation, from, to, tick: 0, budget: Budget::UNLIMITED }
    }

    /// One tick; the force on the tool [N].
    fn advance(&mut self) -> Vec3 {
        self.tick += 1;
        let part = ((Real::from(self.tick) - 100.0) / 500.0).clamp(0.0, 1.0);
        let pose = Pose { position: self.from + (self.to - self.from) * part, ..Pose::default() };
        let mut inputs = Inputs { budget: self.budget, ..Inputs::default() };
        inputs.tools[0] = Some(ToolEvent::Pose(PoseSample { sequence: self.tick, pose, ..PoseSample::default() }));
        self.simulation.advance(&inputs).tools[0].state.physical_force
    }
}

/// Mass [kg], place [m] and velocity [m/s] of each active node, with its organ.
fn nodes(simulation: &Simulation) -> Vec<(OrganId, Real, Vec3, Vec3)> {
    let mesh = simulation.mesh();
    let velocity = |s: usize| Vec3::from_row_slice(&mesh.motion.velocity[s][..3]);
    let organ = |s: &Slot| simulation.body().organ_of(mesh.node(*s));
    let of = |s: &Slot| (organ(s), mesh.motion.mass[s.index()], mesh.position(*s), velocity(s.index()));
    mesh.active().iter().map(of).collect()
}

fn momenta(simulation: &Simulation) -> (Vec3, Vec3) {
    let all = nodes(simulation);
    let of = |(_, m, x, v): &(OrganId, Real, Vec3, Vec3)| (v * *m, x.cross(v) * *m);
    all.iter().map(of).fold((Vec3::zeros(), Vec3::zeros()), |sum, one| (sum.0 + one.0, sum.1 + one.1))
}

fn kinetic(simulation: &Simulation) -> Real {
    nodes(simulation).iter().map(|(_, m, _, v)| 0.5 * m * v.norm_squared()).sum()
}

fn energy(simulation: &Simulation) -> Real {
    energy::energy(simulation.body(), simulation.mesh(), Vec3::zeros()).total()
}

/// Centre of mass of an organ [m].
fn centre(simulation: &Simulation, organ: u32) -> Vec3 {
    let own: Vec<_> = nodes(simulation).into_iter().filter(|n| n.0 == OrganId(organ)).collect();
    own.iter().map(|(_, m, x, _)| x * *m).sum::<Vec3>() / own.iter().map(|n| n.1).sum::<Real>()
}

/// What organ 0 is pushed with by the others [N].
fn force(simulation: &Simulation) -> Vec3 {
    let patches = simulation.body().patches();
    let own = |organ: OrganId| if organ == OrganId(0) { 1.0 } else { -1.0 };
    let with_it = |m: &&Meeting| m.held && (m.other == OrganId(0) || patches.organ(m.patch) == OrganId(0));
    simulation.meetings().iter().filter(with_it).map(|m| m.force * own(patches.organ(m.patch))).sum()
}

fn fade(simulation: &mut Simulation, ticks: usize) {
    for _ in 0..ticks {
        simulation.advance(&Inputs::default());
        simulation.mesh_mut().change_motion(|_, _, v| *v *= 0.98);
    }
    (0..ticks).for_each(|_| _ = simulation.advance(&Inputs::default()));
}

#[test]
fn organs_that_collide_keep_both_momenta_to_rounding_and_gain_no_energy() {
    let harder = Block { youngs_modulus: 2e4, size: Vec3::new(0.06, 0.04, 0.05), cells: &[5], ..SOFT };
    for (friction, aside, speed) in [(0.0, 0.004, 0.3), (0.0, 0.02, 1.0), (0.5, 0.013, 0.3), (0.2, 0.021, 0.1)] {
        let other = Block { position: Vec3::new(aside, 0.3 * aside, 0.052), ..harder };
        let mut simulation = simulation(&[SOFT, other], 0.0, friction, Vec3::zeros());
        let body = simulation.body().clone();
        simulation.mesh_mut().change_motion(|n, _, v| {
            *v = if body.organ_of(n) == OrganId(0) {
                Vec3::new(0.1 * speed, 0.0, 0.5 * speed)
            } else {
                Vec3::new(0.0, 0.0, -speed)
            };
        });
        let (p, l) = momenta(&simulation);
        let scale: Real = nodes(&simulation).iter().map(|(_, m, _, v)| m * v.norm()).sum();
        let (before, mut most, mut pushed) = (energy(&simulation), Real::NEG_INFINITY, 0.0);
        let mut worst = (0.0, 0.0);
        for _ in 0..400 {
            simulation.advance(&Inputs::default());
            let now = momenta(&simulation);
            worst = ((now.0 - p).norm().max(worst.0), (now.1 - l).norm().max(worst.1));
            most = energy(&simulation).max(most);
            pushed = force(&simulation).norm().max(pushed);
        }
        let [linear, angular, end] = [worst.0 / scale, worst.1 / (scale * 0.05), energy(&simulation) / before];
        println!(
            "{speed} m/s, friction {friction}: {linear:.0e}, {angular:.0e}; energy {:.3} to {end:.3}",
            most / before
        );
        assert!(pushed > 0.05);
        assert!(linear < 1e-13 && angular < 1e-13 && most < 1.0001 * before);
    }
}

/// Where all is still, patches look around seldom: what is thrown then is known all the same.
#[test]
fn organs_that_are_thrown_together_after_they_have_lain_still_are_found_in_time() {
    for (gap, speed) in [(0.5e-3, 1.0), (2.5e-3, 1.0), (2.5e-3, 0.3), (6e-3, 1.0)] {
        let other = Block { position: Vec3::new(0.004, 0.001, 0.05 + gap), cells: &[5], ..SOFT };
        let mut simulation = simulation(&[SOFT, other], 0.0, 0.2, Vec3::zeros());
        (0..300).for_each(|_| _ = simulation.advance(&Inputs::default()));
        let body = simulation.body().clone();
        simulation.mesh_mut().change_motion(|n, _, v| {
            *v = Vec3::z() * if body.organ_of(n) == OrganId(0) { 0.5 * speed } else { -0.5 * speed };
        });
        let (before, mut most, mut deepest) = (energy(&simulation), 0.0 as Real, 0.0 as Real);
        for _ in 0..300 {
            simulation.advance(&Inputs::default());
            most = most.max(energy(&simulation));
            deepest = simulation.meetings().iter().map(|m| m.gap).fold(deepest, Real::min);
        }
        println!("{speed} m/s, {:.1} mm apart: {:.2} mm deep, energy {:.4}", gap * 1e3, -deepest * 1e3, most / before);
        assert!((-1e-3..-1e-5).contains(&deepest) && most < 1.0001 * before);
    }
}

#[test]
fn an_organ_that_lies_on_another_weighs_on_it_and_both_lie_still() {
    for (size, modulus, nu) in [(0.05, 3e4, 0.35), (0.02, 1e4, 0.45), (0.1, 5e4, 0.2)] {
        let lower =
            Block { size: Vec3::repeat(1.3 * size), youngs_modulus: modulus, poisson_ratio: nu, held: true, ..SOFT };
        let position = Vec3::new(0.2 * size, 0.15 * size, 1.3 * size);
        let upper = Block { size: Vec3::repeat(size), cells: &[5], position, held: false, ..lower };
        let mut simulation = simulation(&[lower, upper], 0.1, 0.5, Vec3::new(0.0, 0.0, -9.81));
        fade(&mut simulation, 1500);
        let weight = 9.81 * simulation.body().organ(OrganId(1)).mass;
        let places = |simulation: &Simulation| -> Vec<Vec3> {
            let mesh = simulation.mesh();
            mesh.active().iter().map(|slot| mesh.position(*slot)).collect()
        };
        let before = places(&simulation);
        for _ in 0..50 {
            simulation.advance(&Inputs::default());
            let force = force(&simulation);
            // Stars and tetrahedra that step apart push a node to and fro within a tick, each with its part of what balances.
            assert!((force.z / -weight - 1.0).abs() < 1e-6, "{force} of {weight} N");
            assert!(force.xy().norm() < 1e-6 * weight, "{force} of {weight} N");
        }
        let deepest = simulation.meetings().iter().filter(|m| m.multiplier > 0.0).map(|m| m.gap).fold(0.0, Real::min);
        let moved = before.iter().zip(places(&simulation)).map(|(a, b)| (a - b).norm()).fold(0.0, Real::max);
        println!("{size} m: overlap {deepest:e} m, moved by {moved:e} m");
        assert!(deepest > -2e-3 * size && moved < 1e-6 * size);
    }
}

/// In uniform stress there is no difference between a column and one that is cut through.
#[test]
fn a_column_of_two_blocks_sags_as_one_does() {
    let column = |blocks: &[Block]| {
        let mut simulation = simulation(blocks, 0.1, 0.5, Vec3::new(0.0, 0.0, -9.81));
        fade(&mut simulation, 2500);
        let last = simulation.body().organs().len() - 1;
        let vertices = simulation.body().organs()[last].vertices.clone();
        let top = vertices.map(|v| simulation.mesh().vertex(Vertex::at(v)).z).fold(0.0, Real::max);
        (top, force(&simulation).z)
    };
    let lower = Block { youngs_modulus: 2e4, poisson_ratio: 0.0, held: true, ..SOFT };
    let upper = Block { position: Vec3::z() * 0.05, held: false, ..lower };
    let (one, _) = column(&[Block { size: Vec3::new(0.05, 0.05, 0.1), ..lower }]);
    // What is kicked more often than the other side gives way by more of a step's inertia.
    for (cells, most) in [(&[3], 0.01), (&[4], 0.02), (&[6], 0.05)] {
        let (two, pushed) = column(&[lower, Block { cells, ..upper }]);
        let [sag, whole] = [two, one].map(|top| 0.1 - top);
        println!("{cells:?} cells on {:?}: sags by {sag} m, one block by {whole} m; {pushed} N", lower.cells);
        assert!((sag / whole - 1.0).abs() < most);
    }
}

#[test]
fn an_organ_holds_and_slides_on_another_as_coulomb_says() {
    let lower = Block { size: Vec3::new(0.16, 0.08, 0.03), cells: &[5], youngs_modulus: 1e5, held: true, ..SOFT };
    let position = Vec3::new(0.02, 0.025, 0.03);
    let upper = Block { size: Vec3::repeat(0.03), cells: &[3], youngs_modulus: 3e4, position, ..SOFT };
    let tilted = |slope: Real| Vec3::new(slope.atan().sin(), 0.0, -slope.atan().cos()) * 9.81;
    for blocks in [[lower, upper], [Block { held: true, ..lower }, Block { youngs_modulus: 1e4, ..upper }]] {
        let mut held = simulation(&blocks, 0.2, 0.5, tilted(0.35));
        fade(&mut held, 1500);
        let mut before = centre(&held, 1);
        let mut crept = [0.0; 2];
        for crept in &mut crept {
            (0..1000).for_each(|_| _ = held.advance(&Inputs::default()));
            *crept = (centre(&held, 1) - std::mem::replace(&mut before, centre(&held, 1))).norm();
        }
        println!("creeps by {crept:?} m/s");
        assert!(crept[1] < 1e-7);
    }

    let mut slides = simulation(&[lower, upper], 0.2, 0.3, tilted(0.8));
    let velocity = |simulation: &Simulation| {
        let own: Vec<_> = nodes(simulation).into_iter().filter(|n| n.0 == OrganId(1)).collect();
        own.iter().map(|(_, m, _, v)| v * *m).sum::<Vec3>() / own.iter().map(|n| n.1).sum::<Real>()
    };
    (0..60).for_each(|_| _ = slides.advance(&Inputs::default()));
    let from = velocity(&slides);
    (0..120).for_each(|_| _ = slides.advance(&Inputs::default()));
    let (a, angle) = ((velocity(&slides) - from).x / 0.12, (0.8 as Real).atan());
    let expected = 9.81 * (angle.sin() - 0.3 * angle.cos());
    println!("{a} m/s² of {expected}");
    assert!((a / expected - 1.0).abs() < 0.01);
}

#[test]
fn a_state_in_which_organs_meet_goes_on_as_it_would_have() {
    let other = Block { position: Vec3::new(0.011, 0.007, 0.0502), ..SOFT };
    let mut first = simulation(&[SOFT, other], 0.1, 0.3, Vec3::zeros());
    let body = first.body().clone();
    first.mesh_mut().change_motion(|n, _, v| *v = Vec3::z() * if body.organ_of(n) == OrganId(0) { 0.2 } else { -0.2 });
    (0..37).for_each(|_| _ = first.advance(&Inputs::default()));
    assert!(first.meetings().iter().any(|m| m.multiplier > 0.0));
    let snapshot = first.snapshot();
    let mut second = Simulation::new(body, first.settings().clone(), snapshot).unwrap();
    for _ in 0..100 {
        first.advance(&Inputs::default());
        second.advance(&Inputs::default());
        assert_eq!(first.hash(), second.hash());
    }
}

/// What there is time for decides where the resolution changes, and that hangs on how many meetings there are.
#[test]
fn so_it_does_on_a_budget_while_the_resolution_changes() {
    let lower = Block { size: Vec3::new(0.1, 0.1, 0.05), cells: &[4, 8, 12], held: true, ..SOFT };
    let position = Vec3::new(0.02, 0.02, 0.05);
    let upper = Block { size: Vec3::new(0.06, 0.06, 0.03), cells: &[3, 6, 9], position, held: false, ..lower };
    let way = [Vec3::new(0.05, 0.045, 0.093), Vec3::new(0.05, 0.045, 0.08)];
    let mut first = Pressed::new(&[lower, upper], 0.01, way);
    first.budget = Budget::of(1_600_000);
    let mut changes = 0;
    for _ in 0..8 {
        (0..60).for_each(|_| _ = first.advance());
        let (body, settings) = (first.simulation.body().clone(), first.simulation.settings().clone());
        let simulation = Simulation::new(body, settings, first.simulation.snapshot()).unwrap();
        let mut second = Pressed { simulation, from: first.from, to: first.to, tick: first.tick, budget: first.budget };
        for _ in 0..20 {
            first.advance();
            second.advance();
            let adapted = first.simulation.outputs().adapted;
            changes += adapted.splits + adapted.merges;
            assert_eq!(first.simulation.hash(), second.simulation.hash());
        }
    }
    println!("{changes} changes");
    assert!(changes > 10);
}

#[test]
fn a_state_with_meetings_that_are_none_is_refused() {
    let other = Block { position: Vec3::new(0.011, 0.007, 0.0502), ..SOFT };
    let mut simulation = simulation(&[SOFT, other], 0.1, 0.3, Vec3::zeros());
    (0..10).for_each(|_| _ = simulation.advance(&Inputs::default()));
    let (body, settings) = (simulation.body().clone(), simulation.settings().clone());
    let with = |change: &dyn Fn(&mut Snapshot)| {
        let mut snapshot = simulation.snapshot();
        change(&mut snapshot);
        Simulation::new(body.clone(), settings.clone(), snapshot).is_ok()
    };
    assert!(with(&|_| ()));
    let own = body.patches().organ(simulation.meetings()[0].patch);
    assert!(!with(&|s| s.meetings[0].patch = u32::MAX) && !with(&|s| s.meetings[0].triangle.0 = u32::MAX));
    assert!(!with(&|s| s.meetings[0].other = own) && !with(&|s| s.meetings[0].other = OrganId(2)));
    assert!(!with(&|s| s.meetings = vec![s.meetings[0]; 1000]));
}

#[test]
fn what_presses_an_organ_presses_what_it_lies_on_while_the_resolution_changes() {
    let lower = Block { size: Vec3::new(0.1, 0.1, 0.05), cells: &[4, 8], held: true, ..SOFT };
    let position = Vec3::new(0.02, 0.02, 0.05);
    let upper = Block { size: Vec3::new(0.06, 0.06, 0.03), cells: &[3, 6, 9], position, held: false, ..lower };
    let lower = Block { cells: &[4, 8, 12], ..lower };
    let way = |depth: Real| [Vec3::new(0.05, 0.045, 0.093), Vec3::new(0.05, 0.045, 0.09 - depth)];
    for (depth, harder) in [(0.006, 1.0), (0.012, 4.0)] {
        let upper = Block { youngs_modulus: harder * upper.youngs_modulus, ..upper };
        let mut pressed = Pressed::new(&[lower, upper], 0.01, way(depth));
        let (mut before, mut jump, mut changes) = (Vec3::zeros(), 0.0, 0);
        for _ in 0..1500 {
            pressed.advance();
            let adapted = pressed.simulation.outputs().adapted;
            changes += adapted.splits + adapted.merges;
            let now = force(&pressed.simulation);
            jump = (now - before).norm().max(jump);
            before = now;
        }
        let on_tool = pressed.advance();
        let passed_on = force(&pressed.simulation);
        println!("{on_tool:?} N on the tool, {passed_on:?} N below; {changes} changes, at most {jump} N a tick");
        assert!(changes > 20 && on_tool.z > 0.2);
        assert!((on_tool + passed_on).norm() < 0.01 * on_tool.norm());
        assert!(jump < 0.05 * on_tool.norm());
    }
}

#[test]
fn what_overlaps_at_rest_is_eased_apart() {
    for overlap in [0.0, 0.3e-3, 0.9e-3] {
        let other = Block { position: Vec3::new(0.004, 0.003, 0.05 - overlap), ..SOFT };
        let mut simulation = simulation(&[SOFT, other], 0.2, 0.0, Vec3::zeros());
        let (mut fastest, mut pushed) = (0.0, 0.0);
        for _ in 0..2000 {
            simulation.advance(&Inputs::default());
            let speeds = nodes(&simulation).into_iter().map(|(_, _, _, v)| v.norm());
            fastest = speeds.fold(fastest, Real::max);
            pushed = force(&simulation).norm().max(pushed);
        }
        let deepest = simulation.meetings().iter().map(|m| m.gap).fold(0.0, Real::min);
        println!("{overlap} m: {deepest:e} m at last, up to {fastest} m/s and {pushed} N");
        assert!(deepest > -1e-5 && fastest < 0.4);
    }
}

/// Each is so small that what is looked at around its lower side reaches beyond the upper side of the next.
#[test]
fn a_tower_of_small_blocks_stands_with_all_its_weight_on_the_lowest() {
    let size = 0.005;
    let lowest = Block { size: Vec3::repeat(1.4 * size), youngs_modulus: 2e4, poisson_ratio: 0.45, held: true, ..SOFT };
    let block = |i: u32| {
        let aside = 0.01 * size * Real::from(i);
        let position = Vec3::new(0.2 * size + aside, 0.17 * size - aside, (1.4 + Real::from(i)) * size);
        Block { size: Vec3::repeat(size), cells: &[3], position, held: false, ..lowest }
    };
    let mut simulation = simulation(&[lowest, block(0), block(1), block(2)], 0.2, 0.5, Vec3::z() * -9.81);
    fade(&mut simulation, 800);
    let weight: Real = simulation.body().organs()[1..].iter().map(|organ| 9.81 * organ.mass).sum();
    let carried = force(&simulation).z / -weight;
    println!("carries {carried} of the weight, {:e} J", kinetic(&simulation));
    assert!((carried - 1.0).abs() < 1e-4);
}

/// A block that lies on another is let down by its weight, lies there, and floats off again.
#[test]
fn organs_are_refined_where_they_press_each_other_and_only_while_they_do() {
    for (cells, youngs_modulus, poisson_ratio) in [(&[2, 4][..], 2e4, 0.35), (&[2, 4, 7][..], 5e4, 0.45)] {
        let block = Block { cells, youngs_modulus, poisson_ratio, ..SOFT };
        let upper = Block { position: Vec3::new(0.004, -0.003, 0.05), ..block };
        let without = simulation(&[Block { held: true, ..block }, upper], 0.5, 0.3, Vec3::zeros());
        // No strain is worth it.
        let adaptivity = Some(Adaptivity { split: 10.0, ..Adaptivity::default() });
        let body = without.body().clone();
        let settings = Settings { adaptivity, ..without.settings().clone() };
        let mut simulation = Simulation::new(body.clone(), settings, Snapshot::at_rest(&body, 0, 0)).unwrap();
        let run = |simulation: &mut Simulation, gravity: Real, ticks: u32| {
            let mut changes = vec![];
            for tick in 0..ticks {
                let parameter = (tick == 0).then_some(Parameter::Gravity(Vec3::z() * gravity));
                let adapted = simulation.advance(&Inputs { parameter, ..Inputs::default() }).adapted;
                changes.push(adapted.splits + adapted.merges);
            }
            let late = changes[ticks as usize / 2..].iter().sum::<u32>();
            let mesh = simulation.mesh();
            let deep = |s: &Slot| (body.level_of(mesh.node(*s)), (mesh.position(*s).z - 0.05).abs());
            (late, mesh.active().iter().map(deep).collect::<Vec<_>>(), force(simulation).z)
        };
        let (_, apart, none) = run(&mut simulation, 0.0, 500);
        assert!(none == 0.0 && apart.iter().all(|(level, _)| *level == 0));
        let (late, lying, weight) = run(&mut simulation, -9.81, 2500);
        let finest = cells.len() - 1;
        let met = lying.iter().filter(|(_, away)| *away < 0.008);
        let coarse = met.clone().filter(|(level, _)| *level < finest).count();
        println!(
            "{:?}: {} nodes, {coarse} of {} coarse, {late} late changes, {weight:.4} N",
            cells,
            lying.len(),
            met.count()
        );
        assert!(late == 0 && coarse == 0);
        assert!(lying.iter().any(|(level, away)| *level == 0 && *away > 0.04));
        let (late, floating, none) = run(&mut simulation, 2.0, 1000);
        println!("then {} nodes", floating.len());
        assert!(late == 0 && none == 0.0 && floating.iter().all(|(level, _)| *level == 0));
    }
}
