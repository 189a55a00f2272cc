//! The core against answers for the continuum (NGSolve 6.2, quadratic and cubic elements, Newton's method): linear
//! tetrahedra come to them with the square of their size, or a little slower where an edge is singular; smoothed elements are
//! nearer from the start.

use palpate_body::prepare::{Elements, Recipe, Region, Shape, prepare};
use palpate_core::adaptation::Adaptivity;
use palpate_core::contact::safety::ForceLimits;
use palpate_core::contact::tool::{Coupling, Following, PoseSample, Shape as ToolShape, Tool, ToolEvent};
use palpate_core::geometry::primitives::{box_mesh, box_surface};
use palpate_core::ids::Slot;
use palpate_core::math::{Bounds, Pose, Real, Vec3};
use palpate_core::model::{Body, Material};
use palpate_core::simulation::{Inputs, Settings, Simulation, Snapshot, TICK};
use std::sync::Arc;

fn settings(gravity: Vec3, adaptivity: Option<Adaptivity>, radius: Real) -> Settings {
    Settings {
        gravity,
        tools: vec![Tool { name: "ball".into(), shape: ToolShape::ball(radius), friction: 0.0, pivot: None }],
        obstacles: vec![],
        organ_friction: Default::default(),
        support_motions: vec![],
        following: Following { speed: 1.0, engage_ticks: 1 },
        limits: ForceLimits { force: 100.0, torque: 10.0, slew: 1e6 },
        adaptivity,
        most_elements: 1_000_000,
    }
}

fn kinetic_energy(simulation: &Simulation) -> Real {
    let motion = &simulation.mesh().motion;
    let one = |s: &Slot| {
        let v = motion.velocity[s.index()];
        0.5 * motion.mass[s.index()] * (v[0] * v[0] + v[1] * v[1] + v[2] * v[2])
    };
    simulation.mesh().active().iter().map(one).sum()
}

/// A box clamped at x = 0.
#[derive(Clone, Copy)]
struct Block {
    size: Vec3,
    material: Material,
    elements: Elements,
}

/// Displacement of the corner at `place` of `block`, at rest under `gravity`: whenever the
/// kinetic energy falls, all velocities are taken away.
fn sagging_corner(block: &Block, cells: [u32; 3], gravity: Real, place: Vec3) -> Vec3 {
    let Block { size, material, elements } = *block;
    let clamp =
        Region { bounds: Bounds::new(Vec3::zeros(), Vec3::new(0.0, size.y, size.z)), stiffness: None, exact: true };
    let recipe = Recipe {
        name: "box".into(),
        shape: Shape::meshes([box_mesh(size, cells)]),
        material,
        inclusions: vec![],
        holds: vec![clamp],
        elements,
        damping_ratio: 0.0,
    };
    let body = Arc::new(prepare(&recipe, &mut |_, _, _| {}).unwrap());
    let corner = body.nodes().find(|n| (body.rest(*n) - place).norm() < 1e-9).unwrap();
    let gravity = Vec3::new(0.0, 0.0, -gravity);
    let mut sag = Simulation::new(body.clone(), settings(gravity, None, 0.01), Snapshot::at_rest(&body, 0, 1)).unwrap();
    let (mut last, mut stops, mut found) = (0.0, 0, Vec3::zeros());
    for _ in 0..20_000 {
        sag.advance(&Inputs::default());
        let now = kinetic_energy(&sag);
        if now < last {
            let before = found;
            found = sag.mesh().position_of(corner).unwrap() - place;
            sag.mesh_mut().change_motion(|_, _, v| *v = Vec3::zeros());
            stops += 1;
            last = 0.0;
            if stops > 10 && (found - before).norm() < 1e-5 * found.norm() {
                return found;
            }
            continue;
        }
        last = now;
    }
    panic!("no rest after {stops} stops");
}

/// What tetrahedra give on meshes of halved size comes to `expected` (± `uncertainty`), the faster the finer; smoothed elements are nearer
/// on each, and within `most` on the finest.
fn converges(name: &str, on: impl Fn(Elements) -> [Real; 3], expected: Real, uncertainty: Real, most: Real) {
    let values = on(Elements::Tetrahedra);
    let smoothed = on(Elements::Smoothed).map(|v| v / expected - 1.0);
    println!("{name}: smoothed elements {:+.2?} % off", smoothed.map(|off| 100.0 * off));
    // Where the last two lead at the second order (Richardson).
    let limit = values[2] + (values[2] - values[1]) / 3.0;
    let errors = values.map(|v| v - expected);
    let orders = [0, 1].map(|i| (errors[i] / errors[i + 1]).abs().log2());
    println!(
        "{name}: {values:.5?} m of {expected:.5}; errors {:+.2}, {:+.2}, {:+.2} %; orders {:.2}, {:.2}; limit {:+.2} %",
        100.0 * errors[0] / expected,
        100.0 * errors[1] / expected,
        100.0 * errors[2] / expected,
        orders[0],
        orders[1],
        100.0 * (limit / expected - 1.0)
    );
    assert!(errors[2].abs() > uncertainty, "{name}: no order can be told below the reference's own digits");
    assert!(orders[0] > 1.1 && orders[1] > 1.4 && orders[1] > orders[0], "{name}: orders {orders:?}");
    assert!((limit / expected - 1.0).abs() < 0.025, "{name}: comes to {limit}, not to {expected}");
    let nearer = smoothed.iter().zip(errors).all(|(off, error)| off.abs() < 0.5 * (error / expected).abs());
    assert!(nearer && smoothed[2].abs() < most, "{name}: {smoothed:?}");
}

/// R2: a cube of 50 kPa that hangs sideways.
#[test]
fn a_clamped_cube_sags_as_the_continuum_does() {
    let material = Material::from_young(5e4, 0.35, 1000.0);
    let corner = Vec3::new(0.1, 0.0, 0.0);
    let on = |elements| {
        let block = Block { size: Vec3::repeat(0.1), material, elements };
        [4, 8, 16].map(|n| sagging_corner(&block, [n; 3], 9.81, corner).z)
    };
    converges("R2", on, -5.738e-3, 6e-6, 0.01);
}

/// R3: a cantilever that bends by a quarter of its length.
#[test]
fn a_cantilever_bends_as_the_continuum_does() {
    let material = Material::from_young(1e6, 0.3, 1000.0);
    let size = Vec3::new(0.2, 0.02, 0.02);
    let tip = Vec3::new(0.2, 0.01, 0.01);
    for (gravity, expected, uncertainty) in [(0.4905, -2.9463e-3, 2e-6), (9.81, -0.05542, 3e-5)] {
        let on = |elements| {
            let block = Block { size, material, elements };
            [2, 4, 8].map(|n| sagging_corner(&block, [10 * n, n, n], gravity, tip).z)
        };
        converges(&format!("R3, {gravity} m/s²"), on, expected, uncertainty, 0.01);
    }
}

/// R4: a ball of 20 mm pressed into a block, in the core as it is.
#[test]
fn a_ball_is_felt_as_the_continuum_says() {
    let side = 0.1;
    let bottom =
        Region { bounds: Bounds::new(Vec3::zeros(), Vec3::new(side, side, 0.0)), stiffness: None, exact: false };
    let body = |spacings: &[Real], elements: Elements| -> Arc<Body> {
        let recipe = Recipe {
            name: "block".into(),
            shape: Shape::closed(box_surface(Vec3::repeat(side), [60; 3]), spacings.to_vec()),
            material: Material::from_young(1e4, 0.35, 1000.0),
            inclusions: vec![],
            holds: vec![Region { ..bottom.clone() }],
            elements,
            damping_ratio: 0.3,
        };
        Arc::new(prepare(&recipe, &mut |_, _, _| {}).unwrap())
    };
    let radius = 0.02;
    let mut errors = Vec::new();
    for (spacings, elements) in [
        (vec![0.032, 0.018, 0.0102], Elements::Tetrahedra),
        (vec![0.032, 0.018, 0.0102], Elements::Smoothed),
        (vec![0.032, 0.018, 0.0102, 0.0058], Elements::Smoothed),
    ] {
        let body = body(&spacings, elements);
        let adaptivity = Adaptivity { split: 0.01, reach: 1.0, ..Adaptivity::default() };
        let mut press = Simulation::new(
            body.clone(),
            settings(Vec3::zeros(), Some(adaptivity), radius),
            Snapshot::at_rest(&body, 0, 1),
        )
        .unwrap();
        let mut attach = Inputs::default();
        attach.tools[0] = Some(ToolEvent::Attach { epoch: 1, period_ticks: 1, coupling: Coupling::RIGID });
        press.advance(&attach);
        let (mut tick, mut before) = (0, -1e-3);
        for (depth, expected) in [(5e-4, 0.0232092), (1e-3, 0.0640657), (2e-3, 0.1751750)] {
            let until = tick + 700;
            let mut force = 0.0;
            while tick < until {
                tick += 1;
                let part = ((tick + 700 - until) as Real * TICK / 0.3).min(1.0);
                let reached = before + (depth - before) * part;
                let position = Vec3::new(0.05, 0.05, side + radius - reached);
                let mut inputs = Inputs::default();
                inputs.tools[0] = Some(ToolEvent::Pose(PoseSample {
                    sequence: tick as u32,
                    time_ns: 0,
                    pose: Pose { position, ..Pose::default() },
                    buttons: 0,
                    opening: 0.0,
                }));
                force = press.advance(&inputs).tools[0].state.physical_force.z;
            }
            before = depth;
            errors.push(force / expected - 1.0);
            println!(
                "R4, {elements:?}, finest {:.1} mm, {:.1} mm deep: {force:.4} N of {expected:.4} ({:+.1} %), {:?}",
                spacings.last().unwrap() * 1e3,
                depth * 1e3,
                100.0 * (force / expected - 1.0),
                press.mesh().set().count()
            );
        }
    }
    // The radius of the contact is 3.2, 4.5 and 6.3 mm: the dent is below the mesh's size, and restored by the compliance
    // of the contact.
    assert!(errors.iter().all(|e| e.abs() < 0.07), "{errors:?}");
}
