//! Touch by samples: a ball on blocks, against answers for the continuum.

use palpate_body::prepare::{self, Elements, Recipe, Region, prepare};
use palpate_core::adaptation::Adaptivity;
use palpate_core::contact::safety::ForceLimits;
use palpate_core::contact::shape::Part;
use palpate_core::contact::tool::{Coupling, Following, PoseSample, Shape, Tool, ToolEvent};
use palpate_core::geometry::primitives::box_surface;
use palpate_core::math::{Bounds, Pose, Real, Vec3};
use palpate_core::model::active_mesh::contact_row::{Surroundings, at_rest, spacing, support};
use palpate_core::model::{Body, Fibres, Material};
use palpate_core::simulation::{Inputs, Settings, Simulation, Snapshot};
use std::sync::Arc;

const SIZE: Vec3 = Vec3::new(0.2, 0.2, 0.1);

fn block(spacing: Real, elements: Elements, nu: Real, young: Real, cells: u32) -> Arc<Body> {
    block_of(vec![spacing], elements, Material::from_young(young, nu, 1000.0), cells)
}

fn block_of(spacings: Vec<Real>, elements: Elements, material: Material, cells: u32) -> Arc<Body> {
    let floor = Bounds::new(Vec3::zeros(), Vec3::new(SIZE.x, SIZE.y, 0.0));
    let recipe = Recipe {
        name: "block".into(),
        shape: prepare::Shape::closed(box_surface(SIZE, [2 * cells, 2 * cells, cells]), spacings),
        material,
        inclusions: vec![],
        holds: vec![Region { bounds: floor, stiffness: None, exact: false }],
        elements,
        damping_ratio: 0.3,
    };
    prepare(&recipe, &mut |_, _, _| {}).unwrap().into()
}

fn with_ball(body: &Arc<Body>, radius: Real, level: usize) -> Simulation {
    with_tool(body, Shape::ball(radius), 0.0, level)
}

fn with_tool(body: &Arc<Body>, shape: Shape, friction: Real, level: usize) -> Simulation {
    let mut simulation =
        Simulation::new(body.clone(), settings(body, shape, friction), Snapshot::at_rest(body, level, 1)).unwrap();
    attach(&mut simulation, Coupling::RIGID);
    simulation
}

fn attach(simulation: &mut Simulation, coupling: Coupling) {
    let mut inputs = Inputs::default();
    inputs.tools[0] = Some(ToolEvent::Attach { epoch: 1, period_ticks: 1, coupling });
    simulation.advance(&inputs);
}

fn settings(body: &Body, shape: Shape, friction: Real) -> Settings {
    Settings {
        gravity: Vec3::zeros(),
        tools: vec![Tool { name: "tool".into(), shape, friction, pivot: None }],
        obstacles: vec![],
        organ_friction: Default::default(),
        support_motions: vec![],
        following: Following { speed: 1.0, engage_ticks: 1 },
        limits: ForceLimits { force: 1e6, torque: 1e6, slew: 1e9 },
        adaptivity: None,
        most_elements: body.element_count(),
    }
}

fn hold(simulation: &mut Simulation, sequence: u32, position: Vec3) -> Vec3 {
    let mut inputs = Inputs::default();
    let pose = Pose { position, ..Pose::default() };
    inputs.tools[0] = Some(ToolEvent::Pose(PoseSample { sequence, time_ns: 0, pose, buttons: 0, opening: 0.0 }));
    simulation.advance(&inputs).tools[0].state.physical_force
}

/// Force [N] at each depth [m] over the place `at` of the top.
fn presses(simulation: &mut Simulation, radius: Real, at: [Real; 2], depths: &[Real]) -> Vec<Real> {
    let (mut forces, mut before, mut sequence) = (vec![], -1e-3, 0);
    for &depth in depths {
        let mut force = 0.0;
        for tick in 0..500 {
            sequence += 1;
            let reached = before + (depth - before) * (Real::from(tick) / 200.0).min(1.0);
            force = hold(simulation, sequence, Vec3::new(at[0], at[1], SIZE.z + radius - reached)).z;
        }
        before = depth;
        forces.push(force);
    }
    forces
}

/// Depth [m] and force [N] of a frictionless ball of 20 mm on this block at ν = 0.35: elements of third order, Newton's method
/// (NGSolve 6.2).
const CONTINUUM: [(Real, Real); 3] = [(2.5e-4, 8.30e-3), (5e-4, 0.02320), (1e-3, 0.0642)];

/// From four to eight radii of the contact between nodes down to two. Nothing of contact was fitted to it.
#[test]
fn a_ball_is_pushed_back_as_by_the_continuum_by_both_kinds_of_elements() {
    for (spacing, elements) in [
        (0.018, Elements::Tetrahedra),
        (0.013, Elements::Tetrahedra),
        (0.018, Elements::Smoothed),
        (0.009, Elements::Smoothed),
    ] {
        let body = block(spacing, elements, 0.35, 1e4, 20);
        let forces = presses(&mut with_ball(&body, 0.02, 0), 0.02, [0.1, 0.1], &CONTINUUM.map(|c| c.0));
        for (force, (depth, expected)) in forces.iter().zip(CONTINUUM) {
            let off = 100.0 * (force / expected - 1.0);
            println!("{elements:?} {:.0} mm, {:.2} mm deep: {off:+.1} %", 1e3 * spacing, 1e3 * depth);
            assert!(off.abs() < 6.0);
        }
    }
}

/// A body with fibres, which lie along the surface, askew to it, or across, is as firm under a ball as a transversely isotropic half-space
/// is beside an isotropic one, whatever the mesh shows of it.
#[test]
fn fibres_are_felt_as_firm_on_coarse_levels_as_on_fine_ones() {
    let plain = Material::from_young(1e4, 0.35, 1000.0).as_neo_hookean();
    let depths = [2.5e-4, 1e-3];
    let press = |material: Material, spacing: Real| {
        let body = block_of(vec![spacing], Elements::Smoothed, material, 20);
        presses(&mut with_ball(&body, 0.02, 0), 0.02, [0.1, 0.1], &depths)
    };
    let spacings = [0.018, 0.0125];
    let without = spacings.map(|spacing| press(plain, spacing));
    for direction in [Vec3::x(), Vec3::new(1.0, 0.0, 1.0).normalize(), Vec3::z()] {
        let material = Material { fibres: Fibres { modulus: 5e4, direction }, ..plain };
        let firmer = plain.half_space(&Vec3::z()) / material.half_space(&Vec3::z());
        let with = spacings.map(|spacing| press(material, spacing));
        for ((spacing, with), without) in spacings.iter().zip(&with).zip(&without) {
            let ratios: Vec<Real> = with.iter().zip(without).map(|(a, b)| a / b / firmer).collect();
            println!(
                "fibres along {direction:.2?}, {:.1} mm: {with:.5?} N, {ratios:.3?} of {firmer:.3}",
                1e3 * spacing
            );
            assert!(ratios.iter().all(|ratio| (ratio - 1.0).abs() < 0.08));
        }
        assert!(with[0].iter().zip(&with[1]).all(|(a, b)| (a / b - 1.0).abs() < 0.03));
    }
}

/// A display of a few triangles is touched as one of many: what is touched are the nodes' fields, not the triangles.
#[test]
fn the_force_does_not_depend_on_the_display() {
    let force = |cells| {
        let body = block(0.0125, Elements::Smoothed, 0.45, 5e3, cells);
        presses(&mut with_ball(&body, 0.01, 0), 0.01, [0.093, 0.096], &[1e-3, 3e-3])
    };
    let (coarse, fine) = (force(7), force(35));
    for (a, b) in coarse.iter().zip(&fine) {
        println!("{a:.5} N on {} vertices, {b:.5} N on {}", 6 * 7 * 7 * 5 / 3, 6 * 35 * 35 * 5 / 3);
        assert!((a / b - 1.0).abs() < 0.01);
    }
}

/// A hundred times as stiff a body pushes back a hundred times as hard, under a small ball as under a large one.
#[test]
fn the_force_goes_with_the_modulus() {
    for radius in [0.004, 0.03] {
        let force = |young| {
            let body = block(0.018, Elements::Smoothed, 0.45, young, 20);
            presses(&mut with_ball(&body, radius, 0), radius, [0.1, 0.1], &[1e-3])[0]
        };
        let (soft, stiff) = (force(5e3), force(5e5));
        println!("R {:.0} mm: {soft:.5} N and {stiff:.3} N", 1e3 * radius);
        assert!((stiff / soft / 100.0 - 1.0).abs() < 0.03);
    }
}

/// Forces [N] on the way along x at this `depth` [m], over `way` [m], 0.05 m/s.
fn slide(simulation: &mut Simulation, radius: Real, depth: Real, from: Vec3, way: Vec3) -> Vec<Vec3> {
    let place = |reached: Real, along: Real| from + way * along + Vec3::z() * (radius - reached);
    let mut sequence = 0;
    for tick in 0..600 {
        sequence += 1;
        hold(simulation, sequence, place(-1e-3 + (depth + 1e-3) * (Real::from(tick) / 200.0).min(1.0), 0.0));
    }
    let ticks = (way.norm() / 5e-5) as u32;
    (0..ticks)
        .map(|i| {
            sequence += 1;
            hold(simulation, sequence, place(depth, Real::from(i + 1) / Real::from(ticks)))
        })
        .collect()
}

fn evenness(forces: &[Vec3]) -> [Real; 4] {
    let z: Vec<Real> = forces.iter().map(|f| f.z).collect();
    let mean = z.iter().sum::<Real>() / z.len() as Real;
    let (low, high) = z.iter().fold((Real::INFINITY, 0.0 as Real), |(l, h), f| (l.min(*f), h.max(*f)));
    let step = z.windows(2).map(|w| (w[1] - w[0]).abs()).fold(0.0, Real::max);
    let aside = forces.iter().map(|f| f.xy().norm()).fold(0.0, Real::max);
    [mean, 100.0 * (high - low) / mean, 100.0 * step / mean, 100.0 * aside / mean]
}

/// Slides of 20 mm aslant over a cover, from far below to about the spacing of its nodes, up to nearly incompressible.
#[test]
fn a_ball_that_slides_keeps_its_force() {
    for (spacing, nu, radius, depth) in
        [(0.0125, 0.45, 0.01, 1e-3), (0.0125, 0.3, 0.04, 3e-3), (0.0125, 0.49, 0.01, 3e-3), (0.018, 0.45, 0.003, 1e-3)]
    {
        for elements in [Elements::Tetrahedra, Elements::Smoothed] {
            let body = block(spacing, elements, nu, 5e3, 20);
            let from = Vec3::new(0.09, 0.095, SIZE.z);
            let forces = slide(&mut with_ball(&body, radius, 0), radius, depth, from, Vec3::new(0.018, 0.009, 0.0));
            let hertz = 4.0 / 3.0 * 5e3 / (1.0 - nu * nu) * radius.sqrt() * depth.powf(1.5);
            let [mean, range, step, aside] = evenness(&forces);
            println!(
                "{elements:?} a {:.1} mm, nu {nu}, R {:.0} mm, {:.1} mm deep: {:+.1} % over Hertz, range {range:.1} %, step {step:.2} %, aside {aside:.1} %",
                1e3 * spacing,
                1e3 * radius,
                1e3 * depth,
                100.0 * (mean / hertz - 1.0)
            );
            assert!(range < 5.0 && step < 0.1 && aside < 2.0);
        }
    }
}

/// The ball's axis goes over the edge and 4 mm beyond; 0.05 mm a tick. At one place or another a sample leaves the surface while its load is
/// still a part of all: of ten places along the edge 4 to 6.5 % in one tick.
#[test]
fn over_an_edge_the_force_goes_to_zero_without_a_leap() {
    let body = block(0.0125, Elements::Smoothed, 0.3, 5e3, 20);
    for beside in [0.0922, 0.097, 0.1006] {
        let from = Vec3::new(0.185, beside, SIZE.z);
        let forces = slide(&mut with_ball(&body, 0.01, 0), 0.01, 1e-3, from, Vec3::new(0.03, 0.0, 0.0));
        let step = forces.windows(2).map(|w| (w[1] - w[0]).norm()).fold(0.0, Real::max);
        println!("{:.4} N inside, largest step {step:.5} N, {:.4} of it", forces[0].z, step / forces[0].z);
        assert!(forces.last().unwrap().norm() == 0.0 && step < 0.07 * forces[0].z);
    }
}

/// Nor are there numbers of their own for other shapes: what a coarse cover answers a finer one does, too. The points of a solid lie on
/// the display, whose triangles are as wide as a fifth of its end here.
#[test]
fn a_capsule_and_flat_ends_are_pushed_back_alike_by_covers_of_any_size() {
    let lying =
        Pose { position: Vec3::new(-0.02, 0.0, 0.003), orientation: [0.0, 0.5_f64.sqrt(), 0.0, 0.5_f64.sqrt()] };
    let corner = |i: u8| [i & 1, i >> 1 & 1, i >> 2].map(|bit| 0.016 * Real::from(bit) - 0.008);
    let cube: Vec<Vec3> = (0..8).map(|i| Vec3::from(corner(i)) + Vec3::z() * 8e-3).collect();
    let tools = [
        ("lying capsule", Shape::from(Part::capsule(0.003, 0.04).at(lying)), 0.0, 0.02),
        ("standing capsule", Shape::capsule(0.003, 0.04), 0.003, 0.03),
        ("cylinder", Shape::from(Part::cylinder(0.01, 0.02, 0.001)), 0.0, 0.08),
        ("cube", Shape::from(Part::convex(&cube, 0.001).unwrap()), 0.001, 0.08),
    ];
    let covers = [0.018, 0.0125].map(|spacing| block(spacing, Elements::Smoothed, 0.45, 5e3, 16));
    for (name, shape, radius, most) in tools {
        let press = |body| {
            let mut simulation = with_tool(body, shape.clone(), 0.0, 0);
            presses(&mut simulation, radius, [0.103, 0.097], &[1e-3, 2e-3])
        };
        let forces = covers.each_ref().map(press);
        println!("{name}: {forces:.4?} N");
        for depth in 0..2 {
            let of = forces.each_ref().map(|f| f[depth]);
            let (low, high) =
                (of.iter().copied().fold(Real::INFINITY, Real::min), of.iter().copied().fold(0.0, Real::max));
            assert!(low > 0.0 && high / low - 1.0 < most);
        }
    }
}

/// With friction, on the spring of a virtual coupling, while levels of either kind of elements come and go under it.
#[test]
fn a_rough_ball_on_a_spring_slides_by_coulombs_law_and_goes_on_from_a_snapshot() {
    let (radius, friction, compliance) = (0.01, 0.4, 4e-4);
    for elements in [Elements::Tetrahedra, Elements::Smoothed] {
        let body = block_of(vec![0.036, 0.02, 0.0125], elements, Material::from_young(1e4, 0.45, 1000.0), 20);
        let adaptive = || {
            let adaptivity = Some(Adaptivity::default());
            Settings { adaptivity, ..settings(&body, Shape::ball(radius), friction) }
        };
        let mut simulation = Simulation::new(body.clone(), adaptive(), Snapshot::at_rest(&body, 0, 1)).unwrap();
        attach(&mut simulation, Coupling { compliance, ..Coupling::RIGID });
        let place = |tick: u32| {
            let depth = 0.003 * (Real::from(tick) / 200.0).min(1.0) - 1e-3;
            let way = 5e-5 * Real::from(tick.saturating_sub(250));
            Vec3::new(0.09 + way, 0.097, SIZE.z + radius - depth)
        };
        let (mut changes, mut ratios, mut copy) = (0, [Real::INFINITY, 0.0], None);
        for tick in 0..700 {
            let force = hold(&mut simulation, tick + 1, place(tick));
            changes += simulation.outputs().adapted.splits + simulation.outputs().adapted.merges;
            let tool = simulation.outputs().tools[0].state;
            assert!((tool.pose.position - tool.device.position - force * compliance).norm() < 1e-12);
            // From where a spring of that softness has been pulled until the ball slips.
            if tick > 400 {
                let ratio = force.xy().norm() / force.z;
                ratios = [ratios[0].min(ratio), ratios[1].max(ratio)];
            }
            if tick % 150 == 100 {
                copy = Some(Simulation::new(body.clone(), adaptive(), simulation.snapshot()).unwrap());
            } else if let Some(copy) = &mut copy {
                assert_eq!(hold(copy, tick + 1, place(tick)), force, "{elements:?}, tick {tick}");
            }
        }
        println!("{elements:?}: {changes} changes, tangential force {ratios:.4?} of the normal one");
        // It ploughs, too: what it pushes ahead of itself pushes back.
        assert!(changes > 20 && ratios[0] > 0.99 * friction && ratios[1] < 1.07 * friction);
    }
}

/// Rows on nodes that were gathered before, for other places of the surface, are those on nodes that are gathered anew: a simulation that
/// goes on from a snapshot has none that it kept.
#[test]
fn rows_on_nodes_that_are_kept_are_those_on_nodes_looked_for_anew() {
    let body = block_of(vec![0.036, 0.02, 0.0125], Elements::Tetrahedra, Material::from_young(1e4, 0.45, 1000.0), 20);
    let adaptive = Settings { adaptivity: Some(Adaptivity::default()), ..settings(&body, Shape::ball(0.01), 0.0) };
    let mut simulation = Simulation::new(body.clone(), adaptive, Snapshot::at_rest(&body, 0, 1)).unwrap();
    attach(&mut simulation, Coupling::RIGID);
    presses(&mut simulation, 0.01, [0.1, 0.1], &[4e-3]);
    let mesh = simulation.mesh();
    assert!(mesh.set().count().iter().filter(|nodes| **nodes > 0).count() > 1, "levels are mixed");
    let mut kept = Surroundings::new(&body);
    let (mut rows, mut uneven) = (0, 0.0 as Real);
    for t in body.triangles().step_by(7).chain(body.triangles().step_by(11)) {
        let stencil = [(t[0], 0.2), (t[1], 0.5), (t[2], 0.3)];
        let (place, support) = (at_rest(&body, stencil), support(&body) * spacing(mesh, stencil));
        let row = |nodes: &mut Surroundings| {
            nodes.gather(&body, mesh, t[0], place, support);
            nodes.row(place, support)
        };
        let found = row(&mut kept);
        assert_eq!(found, row(&mut Surroundings::new(&body)));
        let Some(found) = found else { continue };
        rows += 1;
        let sum: Real = found.entries().iter().map(|(_, b)| b).sum();
        let mean: Vec3 = found.entries().iter().map(|(slot, b)| body.rest(mesh.node(*slot)) * *b).sum();
        uneven = uneven.max((sum - 1.0).abs()).max((mean - place).norm() / support);
    }
    assert!(rows > 500 && uneven < 1e-12, "{rows} rows, off by {uneven:e}");
}

/// What one does to the other goes through nodes that both push, where they are near each other.
#[test]
fn two_balls_near_each_other_come_to_rest_and_bear_alike() {
    let body = block(0.0125, Elements::Tetrahedra, 0.35, 1e4, 20);
    for apart in [1e-3, 8e-3, 0.08] {
        let mut both = settings(&body, Shape::ball(0.01), 0.3);
        both.tools.push(Tool { name: "other".into(), ..both.tools[0].clone() });
        let mut simulation = Simulation::new(body.clone(), both, Snapshot::at_rest(&body, 0, 2)).unwrap();
        let attach = Some(ToolEvent::Attach { epoch: 1, period_ticks: 1, coupling: Coupling::RIGID });
        let mut inputs = Inputs::default();
        inputs.tools[..2].fill(attach);
        simulation.advance(&inputs);
        let (mut last, mut step) = ([Vec3::zeros(); 2], 0.0 as Real);
        for tick in 0..1200 {
            let depth = 0.004 * (Real::from(tick) / 200.0).min(1.0) - 1e-3;
            let pose = |side: Real| {
                let position = Vec3::new(0.1 + side * apart / 2.0, 0.1, SIZE.z + 0.01 - depth);
                let pose = Pose { position, ..Pose::default() };
                Some(ToolEvent::Pose(PoseSample { sequence: tick + 1, time_ns: 0, pose, buttons: 0, opening: 0.0 }))
            };
            inputs.tools[..2].copy_from_slice(&[-1.0, 1.0].map(pose));
            simulation.advance(&inputs);
            let forces = [0, 1].map(|i| simulation.outputs().tools[i].state.physical_force);
            step =
                if tick > 1000 { step.max((forces[0] - last[0]).norm() + (forces[1] - last[1]).norm()) } else { 0.0 };
            last = forces;
        }
        let [left, right] = last;
        println!("{apart} m apart: {left:.5?} and {right:.5?} N, {step:e} N a tick");
        assert!(left.z > 0.05 && step < 1e-4 * left.z, "held still they push alike from tick to tick: {step:e} N");
        assert!((left.z - right.z).abs() < 0.05 * left.z && (left.x + right.x).abs() < 0.05 * left.z);
    }
}
