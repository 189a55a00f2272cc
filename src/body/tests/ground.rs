//! A body on an obstacle: it carries the weight, holds and slides by Coulomb's law, and is followed where it moves.

use palpate_body::geometry::primitives::sphere_surface;
use palpate_body::prepare::{self, Elements, Recipe, prepare};
use palpate_core::contact::obstacle::{Form, Obstacle};
use palpate_core::contact::safety::ForceLimits;
use palpate_core::contact::tool::{Coupling, Following, Part, PoseSample, Shape, Tool, ToolEvent, ToolState};
use palpate_core::feedback::relaxed::Probe;
use palpate_core::geometry::primitives::box_mesh;
use palpate_core::ids::Slot;
use palpate_core::math::{Mat3, Pose, Real, Vec3};
use palpate_core::model::energy::{deformation_gradient, energy};
use palpate_core::model::{Body, Fibres, Material, Periodic};
use palpate_core::simulation::{Inputs, Settings, Simulation, Snapshot, TICK};
use std::sync::Arc;

fn block(size: Vec3, cells: &[u32], youngs_modulus: Real, poisson_ratio: Real) -> Arc<Body> {
    block_of(Material::from_young(youngs_modulus, poisson_ratio, 1000.0), Elements::Tetrahedra, 0.15, size, cells)
}

fn block_of(material: Material, elements: Elements, damping_ratio: Real, size: Vec3, cells: &[u32]) -> Arc<Body> {
    let recipe = Recipe {
        name: "block".into(),
        shape: prepare::Shape::meshes(cells.iter().map(|n| box_mesh(size, [*n; 3]))),
        material,
        inclusions: vec![],
        holds: vec![],
        elements,
        damping_ratio,
    };
    prepare(&recipe, &mut |_, _, _| {}).unwrap().into()
}

fn floor(friction: Real) -> Obstacle {
    Obstacle { name: "floor".into(), shape: Form::Ground, friction, pose: Pose::default(), motion: None }
}

fn on(body: &Arc<Body>, obstacle: Obstacle, gravity: Vec3, level: usize) -> Simulation {
    between(body, vec![obstacle], gravity, level)
}

fn between(body: &Arc<Body>, obstacles: Vec<Obstacle>, gravity: Vec3, level: usize) -> Simulation {
    let settings = Settings {
        gravity,
        tools: vec![],
        obstacles,
        organ_friction: Default::default(),
        support_motions: vec![],
        following: Following { speed: 1.0, engage_ticks: 10 },
        limits: ForceLimits { force: 100.0, torque: 10.0, slew: 1e6 },
        adaptivity: None,
        most_elements: body.element_count(),
    };
    Simulation::new(body.clone(), settings, Snapshot::at_rest(body, level, 0)).unwrap()
}

/// Ticks in which the velocities fade, then as many in which they do not.
fn settle(simulation: &mut Simulation, ticks: usize) {
    for _ in 0..ticks {
        simulation.advance(&Inputs::default());
        simulation.mesh_mut().change_motion(|_, _, v| *v *= 0.98);
    }
    (0..ticks).for_each(|_| _ = simulation.advance(&Inputs::default()));
}

/// Mass [kg], place [m] and velocity [m/s] of each active node.
fn nodes(simulation: &Simulation) -> Vec<(Real, Vec3, Vec3)> {
    let mesh = simulation.mesh();
    let velocity = |s: usize| Vec3::from_row_slice(&mesh.motion.velocity[s][..3]);
    let of = |s: &Slot| (mesh.motion.mass[s.index()], mesh.position(*s), velocity(s.index()));
    mesh.active().iter().map(of).collect()
}

fn kinetic(simulation: &Simulation) -> Real {
    nodes(simulation).iter().map(|(m, _, v)| 0.5 * m * v.norm_squared()).sum()
}

fn momentum(simulation: &Simulation) -> Vec3 {
    nodes(simulation).iter().map(|(m, _, v)| v * *m).sum()
}

fn centre(simulation: &Simulation) -> Vec3 {
    let mass: Real = nodes(simulation).iter().map(|n| n.0).sum();
    nodes(simulation).iter().map(|(m, x, _)| x * *m).sum::<Vec3>() / mass
}

fn weight(body: &Body) -> Real {
    9.81 * body.mass()
}

/// Gravity on a floor that is tilted by this slope.
fn on_slope(slope: Real) -> Vec3 {
    let angle = slope.atan();
    Vec3::new(angle.sin(), 0.0, -angle.cos()) * 9.81
}

/// Sizes [m], cells of the levels, Young's moduli [Pa] and Poisson's ratios.
fn blocks() -> Vec<(Arc<Body>, usize)> {
    [
        (Vec3::repeat(0.1), vec![3, 6], 2e4, 0.35),
        (Vec3::new(0.16, 0.1, 0.05), vec![4, 8], 5e3, 0.45),
        (Vec3::repeat(0.03), vec![3, 6], 5e4, 0.1),
    ]
    .into_iter()
    .flat_map(|(size, cells, e, nu)| {
        let body = block(size, &cells, e, nu);
        (0..cells.len()).map(move |level| (body.clone(), level)).collect::<Vec<_>>()
    })
    .collect()
}

#[test]
fn a_floor_carries_the_weight_and_the_body_lies_still() {
    for (body, level) in blocks() {
        let mut simulation = on(&body, floor(0.5), on_slope(0.0), level);
        settle(&mut simulation, 1500);
        for _ in 0..100 {
            let force = simulation.advance(&Inputs::default()).obstacles[0].wrench.force;
            assert!((force.z / -weight(&body) - 1.0).abs() < 1e-6, "{force} for {} N", weight(&body));
            assert!(force.xy().norm() < 1e-6 * weight(&body), "{force}");
        }
        // As if it had fallen by 0.1 µm.
        assert!(kinetic(&simulation) < 1e-7 * weight(&body), "{:e} J", kinetic(&simulation));
    }
}

#[test]
fn a_body_slides_down_a_slope_steeper_than_the_friction_as_coulomb_says() {
    for (body, level) in blocks() {
        let gravity = on_slope(0.7);
        let mut simulation = on(&body, floor(0.5), gravity, level);
        settle(&mut simulation, 500);
        let mut places = [Vec3::zeros(); 3];
        for place in &mut places {
            *place = centre(&simulation);
            (0..100).for_each(|_| _ = simulation.advance(&Inputs::default()));
        }
        let rate = (places[2] - places[1] * 2.0 + places[0]) / (100.0 * TICK).powi(2);
        let expected = gravity.x + 0.5 * gravity.z;
        assert!((rate.x / expected - 1.0).abs() < 0.01, "{rate} for {expected} m/s²");
    }
}

#[test]
fn a_block_stands_on_a_slope_up_to_its_width_over_its_height_and_tips_beyond() {
    // So stiff that it does not lean: a half.
    let body = block(Vec3::new(0.05, 0.05, 0.1), &[3], 1e6, 0.3);
    let height = |slope: Real| {
        let mut simulation = on(&body, floor(1.5), on_slope(slope), 0);
        settle(&mut simulation, 700);
        centre(&simulation).z
    };
    let (stands, tips) = (height(0.42), height(0.56));
    assert!(stands > 0.048 && tips < 0.03, "its middle is {stands} m high where it stands, {tips} m where it tips");
}

#[test]
fn what_a_falling_body_loses_of_its_momentum_is_what_the_floor_gives() {
    for (body, level) in blocks() {
        let below = Pose { position: Vec3::z() * -0.01, ..Pose::default() };
        let mut simulation = on(&body, Obstacle { pose: below, ..floor(0.3) }, on_slope(0.3), level);
        let (mut given, mut most) = (Vec3::zeros(), 0.0 as Real);
        for _ in 0..300 {
            given +=
                (on_slope(0.3) * body.mass() - simulation.advance(&Inputs::default()).obstacles[0].wrench.force) * TICK;
            most = most.max(momentum(&simulation).norm());
        }
        let off = (momentum(&simulation) - given).norm();
        assert!(most > 0.3 * body.mass() && off < 1e-12 * most, "{off:e} of {most} kg m/s");
    }
}

#[test]
fn a_body_follows_a_floor_that_breathes_and_is_carried_along_by_friction() {
    let displacement = Vec3::new(0.006, 0.0, 0.01);
    let motion = Some(Periodic { displacement, period: 2000, parts: [0.4, 0.0, 0.4] });
    for (body, level) in blocks() {
        let mut simulation = on(&body, Obstacle { motion, ..floor(0.5) }, on_slope(0.0), level);
        settle(&mut simulation, 1000);
        let (start, mut before) = (centre(&simulation), simulation.outputs().obstacles[0].wrench.force);
        for tick in 0..2000 {
            let force = simulation.advance(&Inputs::default()).obstacles[0].wrench.force;
            // What a mass feels of the motion, 10/√3 of the displacement over the time of the rise squared, and its rate.
            assert!((force.z / -weight(&body) - 1.0).abs() < 0.03, "{tick}: {force} for {} N", weight(&body));
            assert!((force - before).norm() < 2e-3 * weight(&body), "{tick}: {force} after {before}");
            before = force;
            if tick == 799 {
                let way = centre(&simulation) - start;
                assert!((way - displacement).norm() < 2e-4, "{way} for {displacement}");
            }
        }
        assert!((centre(&simulation) - start).norm() < 2e-4, "{}", centre(&simulation) - start);
    }
}

#[test]
fn a_body_lies_on_a_convex_table() {
    let corner = |x: Real, y: Real, z: Real| Vec3::new(x, y, z);
    let corners: Vec<Vec3> =
        (0..8).map(|i| corner([-0.1, 0.2][i & 1], [-0.1, 0.2][i >> 1 & 1], [-0.05, -5e-4][i >> 2])).collect();
    let table = Form::Parts(Part::convex(&corners, 5e-4).unwrap().into());
    let body = block(Vec3::repeat(0.1), &[3], 2e4, 0.35);
    let mut simulation = on(&body, Obstacle { shape: table, ..floor(0.5) }, on_slope(0.1), 0);
    settle(&mut simulation, 700);
    let before = centre(&simulation);
    let mut mean = Vec3::zeros();
    (0..200).for_each(|_| mean += simulation.advance(&Inputs::default()).obstacles[0].wrench.force / 200.0);
    let expected = on_slope(0.1) * body.mass();
    assert!((mean - expected).norm() < 1e-3 * weight(&body), "{mean} for {expected}");
    // Friction holds places of the surface, and what is between them and the nodes gives way a little.
    assert!((centre(&simulation) - before).norm() < 2.5e-5, "{}", centre(&simulation) - before);
}

#[test]
fn the_stiffness_told_of_a_body_on_a_floor_is_that_by_which_its_force_grows() {
    let body = block(Vec3::repeat(0.1), &[3, 6], 2e4, 0.35);
    let start = {
        let mut simulation = on(&body, floor(0.5), on_slope(0.0), 1);
        settle(&mut simulation, 500);
        simulation.snapshot()
    };
    let tool = Tool { name: "ball".into(), shape: Shape::ball(0.02), friction: 0.0, pivot: None };
    let settings = Settings { tools: vec![tool], ..on(&body, floor(0.5), on_slope(0.0), 1).settings().clone() };
    let with_tool = Snapshot { tools: vec![ToolState::default()], points: vec![vec![]], ..start };
    let mut simulation = Simulation::new(body.clone(), settings.clone(), with_tool).unwrap();
    let mut press = |depth: Real, ticks: u32| {
        for tick in 0..ticks {
            let position = Vec3::new(0.05, 0.05, 0.12 - depth * Real::from(tick.min(500)) / 500.0);
            let sample = PoseSample { pose: Pose { position, ..Pose::default() }, ..PoseSample::default() };
            let attach = ToolEvent::Attach { epoch: 1, period_ticks: 1, coupling: Coupling::RIGID };
            let mut inputs = Inputs::default();
            inputs.tools[0] = Some(if tick == 0 { attach } else { ToolEvent::Pose(sample) });
            simulation.advance(&inputs);
        }
        (simulation.outputs().tools[0].state.physical_force.z, simulation.snapshot())
    };
    let (first, snapshot) = press(0.006, 2000);
    let (second, _) = press(0.0063, 2000);
    let told = Probe::new(body, settings).unwrap().stiffness(&snapshot)[0].unwrap();
    let grows = (second - first) / 3e-4;
    assert!(first > 0.3 && (told.matrix[(2, 2)] / grows - 1.0).abs() < 0.15, "{} for {grows} N/m", told.matrix);
}

#[test]
fn a_body_on_a_floor_that_moves_goes_on_from_a_snapshot_to_the_same_bits() {
    let motion = Some(Periodic { displacement: Vec3::z() * 0.01, period: 200, parts: [0.4, 0.0, 0.4] });
    let body = block(Vec3::repeat(0.05), &[2, 4], 2e4, 0.35);
    let mut simulation = on(&body, Obstacle { motion, ..floor(0.5) }, on_slope(0.2), 1);
    (0..150).for_each(|_| _ = simulation.advance(&Inputs::default()));
    let snapshot = simulation.snapshot();
    assert!(snapshot.obstacle_points[0].iter().any(|point| point.multiplier > 0.0));
    let mut again = Simulation::new(body, simulation.settings().clone(), snapshot).unwrap();
    for _ in 0..100 {
        let force = simulation.advance(&Inputs::default()).obstacles[0];
        assert_eq!(again.advance(&Inputs::default()).obstacles[0], force);
        assert_eq!(again.hash(), simulation.hash());
    }
}

/// Force over the area at rest [Pa] of `material` that is squeezed along its fibres to `stretch` and free across, by its closed form.
fn squeezed(material: &Material, stretch: Real) -> Real {
    let (lambda, mu) = (material.lambda, material.mu);
    if material.neo_hookean == 0.0 {
        // S = E (stretch² − 1)/2, and across E free of stress.
        return material.youngs_modulus() * stretch * 0.5 * (stretch * stretch - 1.0);
    }
    let swelling = |across: Real| (lambda + mu) * (stretch * across * across - 1.0) - mu;
    // μ across + swelling · stretch · across = 0, by halving.
    let (mut low, mut high) = (1.0, 2.0);
    for _ in 0..60 {
        let middle = 0.5 * (low + high);
        *(if mu + swelling(middle) * stretch < 0.0 { &mut low } else { &mut high }) = middle;
    }
    mu * stretch + swelling(low) * low * low + material.fibres.modulus * stretch * 0.5 * (stretch * stretch - 1.0)
}

/// All laws as a textbook has them, in the large: also on smoothed elements.
#[test]
fn a_block_between_smooth_plates_pushes_back_as_the_closed_form_of_its_law_says() {
    let (size, down) = (Vec3::new(0.04, 0.04, 0.04), [1.0, 0.0, 0.0, 0.0]);
    for (nu, elements) in [(0.3, Elements::Tetrahedra), (0.45, Elements::Tetrahedra), (0.45, Elements::Smoothed)] {
        let green = Material::from_young(2e4, nu, 1000.0);
        let mut forces = Vec::new();
        let with_fibres = Material { fibres: fibres(2e4, Vec3::z()), ..green.as_neo_hookean() };
        for material in [green, green.as_neo_hookean(), with_fibres] {
            let body = block_of(material, elements, 0.15, size, &[6]);
            let motion = Periodic { displacement: Vec3::z() * -0.2 * size.z, period: 4000, parts: [0.4, 0.6, 0.0] };
            let at = Pose { position: Vec3::z() * size.z, orientation: down };
            let plate = Obstacle { name: "plate".into(), pose: at, motion: Some(motion), ..floor(0.0) };
            let mut simulation = between(&body, vec![floor(0.0), plate], Vec3::zeros(), 0);
            (0..3000).for_each(|_| _ = simulation.advance(&Inputs::default()));
            let force = simulation.advance(&Inputs::default()).obstacles[1].wrench.force.z;
            // The plates' patches give way a little.
            let mesh = simulation.mesh();
            let face = |z: Real| {
                let on_it = mesh.active().iter().filter(|s| (body.rest(mesh.node(**s)).z - z).abs() < 1e-9);
                let heights: Vec<Real> = on_it.map(|s| mesh.position(*s).z).collect();
                heights.iter().sum::<Real>() / heights.len() as Real
            };
            let stretch = (face(size.z) - face(0.0)) / size.z;
            assert!((0.8..0.83).contains(&stretch), "{stretch}");
            let expected = -squeezed(&material, stretch) * size.x * size.y;
            println!(
                "nu {nu}, {elements:?}, neo-Hookean {}, fibres {} Pa: {force:.4} N of {expected:.4} at {stretch:.4}",
                material.neo_hookean, material.fibres.modulus
            );
            assert!((force / expected - 1.0).abs() < 0.02);
            forces.push(force);
        }
        assert!(forces[1] > 1.4 * forces[0], "the neo-Hookean law does not soften as much");
    }
}

fn fibres(modulus: Real, direction: Vec3) -> Fibres {
    Fibres { modulus, direction: direction.normalize() }
}

/// Struck so that it squeezes itself and shears as it swings; twice as hard, the default law bursts and the other does not. (With a damping
/// ratio of 0.02 it does not, either.)
#[test]
fn an_undamped_block_keeps_its_energy_in_the_large_and_a_neo_hookean_one_is_not_burst() {
    let (plain, smoothed) = (Elements::Tetrahedra, Elements::Smoothed);
    let (none, some, strong) = (Fibres::NONE, fibres(2e4, Vec3::x()), fibres(4e5, Vec3::new(2.0, 1.0, -0.5)));
    for (elements, neo_hookean, nu, scale, fibres) in [
        (plain, 0.0, 0.4, 0.5, none),
        (plain, 0.5, 0.4, 1.0, none),
        (plain, 1.0, 0.3, 0.5, none),
        (plain, 1.0, 0.3, 1.0, none),
        (plain, 1.0, 0.49, 1.0, none),
        (smoothed, 0.0, 0.4, 0.5, none),
        (smoothed, 1.0, 0.4, 0.5, none),
        (plain, 1.0, 0.3, 0.5, some),
        (plain, 1.0, 0.4, 0.5, strong),
        (plain, 1.0, 0.3, 1.0, strong),
        (smoothed, 1.0, 0.4, 0.5, strong),
    ] {
        let material = Material { neo_hookean, fibres, ..Material::from_young(2e4, nu, 1000.0) };
        let body = block_of(material, elements, 0.0, Vec3::repeat(0.04), &[4]);
        let mut simulation = between(&body, vec![], Vec3::zeros(), 0);
        let rate = Mat3::new(-60.0, 50.0, 0.0, 0.0, 30.0, 0.0, 0.0, 0.0, 30.0) * scale;
        simulation.mesh_mut().change_motion(|_, x, v| *v = rate * (*x - body.centre_of_mass()));
        let energy = |s: &Simulation| energy(s.body(), s.mesh(), Vec3::zeros()).total();
        let (start, mut least, mut most) = (energy(&simulation), Real::INFINITY, 0.0 as Real);
        let mut squeezed = 1.0 as Real;
        for _ in 0..1000 {
            simulation.advance(&Inputs::default());
            let now = energy(&simulation) / start;
            (least, most) = (least.min(now), most.max(now));
            let det = |e| deformation_gradient(&body, simulation.mesh(), e).determinant();
            squeezed = body.elements().map(det).fold(squeezed, Real::min);
        }
        println!(
            "{elements:?}, neo-Hookean {neo_hookean}, nu {nu}, fibres {}: energy {least:.4} to {most:.4}, least det F {squeezed:.2}",
            fibres.modulus
        );
        assert!(least > if scale < 1.0 { 0.97 } else { 0.8 } && most < 1.05, "{least} to {most}");
    }
}

/// A ball of soft tissue and a cube, from 0.2 m, on floors with friction and without.
#[test]
fn what_is_dropped_gains_no_energy_and_comes_to_rest() {
    let down = Vec3::z() * -9.81;
    let material = |modulus| Material::from_young(modulus, 0.45, 1050.0);
    let ball = |modulus, radius: Real| {
        let recipe = Recipe {
            name: "ball".into(),
            shape: prepare::Shape::closed(sphere_surface(radius, 0.12 * radius), vec![0.3 * radius]),
            material: material(modulus),
            inclusions: vec![],
            holds: vec![],
            elements: Elements::Tetrahedra,
            damping_ratio: 0.15,
        };
        (Arc::new(prepare(&recipe, &mut |_, _, _| {}).unwrap()), radius)
    };
    let cube = (block_of(material(1e4), Elements::Tetrahedra, 0.15, Vec3::repeat(0.04), &[5]), 0.0);
    // A ball rolls for some seconds, as a body of few faces.
    for ((body, below), friction, seconds) in [(ball(1e4, 0.03), 0.5, 20), (ball(3e4, 0.02), 0.0, 8), (cube, 0.5, 4)] {
        let mut simulation = on(&body, floor(friction), down, 0);
        simulation.mesh_mut().change_motion(|_, x, _| x.z += 0.2 + below);
        let energy = |s: &Simulation| energy(s.body(), s.mesh(), down).total() + 9.81 * body.mass() * below;
        let (start, mut most) = (energy(&simulation), 0.0 as Real);
        let mut before = nodes(&simulation);
        for tick in 0..1000 * seconds {
            if tick == 1000 * (seconds - 1) {
                before = nodes(&simulation);
            }
            simulation.advance(&Inputs::default());
            most = most.max(energy(&simulation) / start);
        }
        // Not by velocities: what sticks swings within a tick.
        let now = nodes(&simulation);
        let moved = now.iter().zip(&before).map(|(now, then)| (now.1 - then.1).norm()).fold(0.0, Real::max);
        println!("energy at most {most:.9} of {start:.4} J; moves by {moved:.1e} m in the last second");
        assert!(most < 1.0 + 1e-9 && moved < 1e-5, "{most}, {moved} m");
    }
}
