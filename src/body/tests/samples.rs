//! Touch by samples: a ball on blocks, against answers for the continuum.

use palpate_body::prepare::{self, Elements, Recipe, Region, prepare};
use palpate_core::contact::safety::ForceLimits;
use palpate_core::contact::tool::{Coupling, Following, PoseSample, Shape, Tool, ToolEvent};
use palpate_core::geometry::primitives::box_surface;
use palpate_core::math::{Bounds, Pose, Real, Vec3};
use palpate_core::model::{Body, Material};
use palpate_core::simulation::{Inputs, Settings, Simulation, Snapshot};
use std::sync::Arc;

const SIZE: Vec3 = Vec3::new(0.2, 0.2, 0.1);

fn block(spacing: Real, elements: Elements, nu: Real, young: Real, cells: u32) -> Arc<Body> {
    let floor = Bounds::new(Vec3::zeros(), Vec3::new(SIZE.x, SIZE.y, 0.0));
    let recipe = Recipe {
        name: "block".into(),
        shape: prepare::Shape::closed(box_surface(SIZE, [2 * cells, 2 * cells, cells]), vec![spacing]),
        material: Material::from_young(young, nu, 1000.0),
        inclusions: vec![],
        holds: vec![Region { bounds: floor, stiffness: None, exact: false }],
        elements,
        damping_ratio: 0.3,
    };
    prepare(&recipe, &mut |_, _, _| {}).unwrap().into()
}

fn with_ball(body: &Arc<Body>, radius: Real, samples: bool) -> Simulation {
    let settings = Settings {
        gravity: Vec3::zeros(),
        tools: vec![Tool { name: "ball".into(), shape: Shape::ball(radius), friction: 0.0 }],
        obstacles: vec![],
        following: Following { speed: 1.0, engage_ticks: 1 },
        limits: ForceLimits { force: 1e6, torque: 1e6, slew: 1e9 },
        adaptivity: None,
        most_elements: body.element_count(),
    };
    let mut simulation = Simulation::new(body.clone(), settings, Snapshot::at_rest(body, 0, 1)).unwrap();
    if samples {
        simulation.touch_by_samples();
    }
    let mut inputs = Inputs::default();
    inputs.tools[0] = Some(ToolEvent::Attach { epoch: 1, period_ticks: 1, coupling: Coupling::RIGID });
    simulation.advance(&inputs);
    simulation
}

fn hold(simulation: &mut Simulation, sequence: u32, position: Vec3) -> Vec3 {
    let mut inputs = Inputs::default();
    let pose = Pose { position, ..Pose::default() };
    inputs.tools[0] = Some(ToolEvent::Pose(PoseSample { sequence, time_ns: 0, pose, buttons: 0 }));
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

#[test]
fn table() {
    let depths = [2.5e-4, 5e-4, 1e-3];
    let expected = [8.30e-3, 0.02320, 0.0642];
    for spacing in [0.018, 0.013, 0.009] {
        for elements in [Elements::Tetrahedra, Elements::Smoothed] {
            let body = block(spacing, elements, 0.35, 1e4, 20);
            for samples in [false, true] {
                let mut simulation = with_ball(&body, 0.02, samples);
                let forces = presses(&mut simulation, 0.02, [0.1, 0.1], &depths);
                let off: Vec<String> =
                    forces.iter().zip(expected).map(|(f, e)| format!("{:+.1}", 100.0 * (f / e - 1.0))).collect();
                println!("{:.1} mm {elements:?} samples {samples}: {off:?}", 1e3 * spacing);
            }
        }
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

#[test]
fn slides() {
    for (spacing, nu, radius, depth) in [
        (0.0125, 0.45, 0.01, 1e-3),
        (0.0125, 0.45, 0.01, 3e-3),
        (0.0125, 0.3, 0.04, 3e-3),
        (0.0125, 0.49, 0.01, 3e-3),
        (0.018, 0.45, 0.003, 1e-3),
    ] {
        for elements in [Elements::Tetrahedra, Elements::Smoothed] {
            let body = block(spacing, elements, nu, 5e3, 20);
            for samples in [false, true] {
                let mut simulation = with_ball(&body, radius, samples);
                let from = Vec3::new(0.09, 0.095, SIZE.z);
                let forces = slide(&mut simulation, radius, depth, from, Vec3::new(0.018, 0.009, 0.0));
                let hertz = 4.0 / 3.0 * 5e3 / (1.0 - nu * nu) * radius.sqrt() * depth.powf(1.5);
                let [mean, range, step, aside] = evenness(&forces);
                println!(
                    "a {:.1} nu {nu} R {:.0} depth {:.1} {elements:?} samples {samples}: over Hertz {:+.1} % range {range:.1} % step {step:.2} % aside {aside:.1} %",
                    1e3 * spacing,
                    1e3 * radius,
                    1e3 * depth,
                    100.0 * (mean / hertz - 1.0)
                );
            }
        }
    }
}

#[test]
fn edge() {
    for spacing in [0.0125] {
        let body = block(spacing, Elements::Smoothed, 0.3, 5e3, 20);
        for samples in [false, true] {
            let mut simulation = with_ball(&body, 0.01, samples);
            let forces = slide(&mut simulation, 0.01, 1e-3, Vec3::new(0.185, 0.097, SIZE.z), Vec3::new(0.03, 0.0, 0.0));
            let shown: Vec<String> =
                forces.iter().step_by(20).map(|f| format!("{:.1}/{:.1}", 1e3 * f.z, 1e3 * f.x)).collect();
            let step = forces.windows(2).map(|w| (w[1] - w[0]).norm()).fold(0.0, Real::max);
            for (i, w) in forces.windows(2).enumerate().filter(|(_, w)| (w[1] - w[0]).norm() > 2.5e-4) {
                println!("{i}: {:.2?} {:.2?}", (w[0] * 1e3).as_slice(), (w[1] * 1e3).as_slice());
            }
            println!("a {:.1} samples {samples}: mN {shown:?} largest step {:.2} mN", 1e3 * spacing, 1e3 * step);
        }
    }
}
