//! A given tetrahedral mesh against a reference solution on that very mesh (case R7: a liver of 181 nodes, part of it
//! fixed, part of it pressed down by 5 mm, under its weight).
//!
//! Mesh and reference lie in a folder beside the project; without them the test says so and passes.

use palpate::contact::safety::ForceLimits;
use palpate::contact::tool::Following;
use palpate::geometry::mesh_io::{LengthUnit, read_tet_mesh};
use palpate::math::{Real, Vec3};
use palpate::model::element_kernel::{Path as KernelPath, Rates};
use palpate::model::element_pool::CLASSES;
use palpate::model::step_class::{class_at_rest, step_of};
use palpate::model::{Body, Material};
use palpate::prepare::{Recipe, Shape, prepare};
use palpate::simulation::{Inputs, Settings, Simulation, Snapshot};
use serde_json::Value;
use std::path::Path;
use std::sync::Arc;

fn vector(value: &Value) -> Vec3 {
    let number = |i: usize| value[i].as_f64().unwrap();
    Vec3::new(number(0), number(1), number(2))
}

fn numbers(value: &Value) -> Vec<u32> {
    value.as_array().unwrap().iter().map(|n| n.as_u64().unwrap() as u32).collect()
}

/// The liver of `case`, its nodes in `fixed` never moving.
fn liver(case: &Value, file: &Path, fixed: Vec<u32>) -> Arc<Body> {
    let mut mesh = read_tet_mesh(file, LengthUnit::Metre).unwrap();
    let (centre, scale) = (vector(&case["mesh"]["centre"]), case["mesh"]["scale"].as_f64().unwrap());
    mesh.nodes.iter_mut().for_each(|u| *u = (*u - centre) * scale);
    let number = |key: &str| case[key].as_f64().unwrap();
    let material = Material::from_young(number("E"), number("nu"), number("rho"));
    let recipe = Recipe {
        name: "R7".into(),
        shape: Shape::meshes([mesh]),
        material,
        inclusions: vec![],
        holds: vec![],
        damping_ratio: 0.0,
    };
    let mut parts = prepare(&recipe, &mut |_, _, _| {}).unwrap().into_parts();
    parts.levels[0].fixed = fixed;
    Arc::new(Body::new(parts).unwrap())
}

/// What would hold each node in place against its elements and its weight [N].
fn reactions(simulation: &mut Simulation, gravity: Vec3) -> Vec<(u32, Vec3)> {
    let body = simulation.body().clone();
    let mesh = simulation.mesh_mut();
    (0..CLASSES).for_each(|class| {
        mesh.add_forces(KernelPath::best(), class, &Rates::ELASTIC);
    });
    let slots = mesh.active().to_vec();
    let of = |slot: &u32| {
        let n = mesh.node(*slot);
        let f = std::mem::take(&mut mesh.motion.force[*slot as usize]);
        (n, -(Vec3::new(f[0], f[1], f[2]) + gravity * body.level(0).node_mass[n as usize]))
    };
    slots.iter().map(of).collect()
}

/// Moves the nodes, but for those that are `still`, until the forces of the core's elements balance their weight: plain
/// damped steps of the shortest length that any element takes.
fn balance(simulation: &mut Simulation, gravity: Vec3, still: &[u32]) {
    let body = simulation.body().clone();
    let classes = body.elements_of(0).map(|e| class_at_rest(&body, e));
    let step = 0.5 * step_of(classes.max().unwrap());
    let mut velocity = vec![Vec3::zeros(); body.node_count()];
    for _ in 0..60_000 {
        for (n, force) in reactions(simulation, gravity) {
            let v = &mut velocity[n as usize];
            *v = if still.contains(&n) {
                Vec3::zeros()
            } else {
                *v * 0.97 - force * (step / body.level(0).node_mass[n as usize])
            };
        }
        simulation.mesh_mut().change_motion(|n, x, _| *x += velocity[n as usize] * step);
    }
}

#[test]
fn a_given_mesh_answers_as_the_reference_does_on_the_same_mesh() {
    let shared = Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared");
    let (reference, mesh) = (shared.join("reference/reference.json"), shared.join("meshes/liver.msh"));
    if !reference.exists() || !mesh.exists() {
        eprintln!("the reference is not there: not tested");
        return;
    }
    let all: Value = serde_json::from_str(&std::fs::read_to_string(reference).unwrap()).unwrap();
    let case = &all["cases"]["R7_liver"];
    let (fixed, patch) = (numbers(&case["fixed"]), numbers(&case["patch"]));
    let mut still: Vec<u32> = fixed.iter().chain(&patch).copied().collect();
    still.sort_unstable();
    let body = liver(case, &mesh, still.clone());
    let volume = case["mesh"]["volume_m3"].as_f64().unwrap();
    assert!((body.level(0).volume() / volume - 1.0).abs() < 1e-9, "{}", body.level(0).volume());
    for (number, place) in case["probes"].as_object().unwrap() {
        assert!((body.rest(number.parse().unwrap()) - vector(place)).norm() < 1e-9, "node {number}");
    }

    let gravity = Vec3::new(0.0, -case["g"].as_f64().unwrap(), 0.0);
    let settings = Settings {
        gravity,
        tools: vec![],
        following: Following { speed: 1.0, engage_ticks: 1 },
        limits: ForceLimits { force: 100.0, torque: 10.0, slew: 1e6 },
        adaptivity: None,
        most_elements: usize::MAX,
    };
    let mut simulation = Simulation::new(body.clone(), settings, Snapshot::at_rest(&body, 0, 0)).unwrap();
    let pressed = vector(&case["patch_displacement"]);
    // In steps: an element is never crushed on the way.
    for step in 1..=5 {
        let now = pressed * (Real::from(step) / 5.0);
        simulation.mesh_mut().change_motion(|n, x, _| {
            if patch.contains(&n) {
                *x = body.rest(n) + now;
            }
        });
        // Damped about as much as its slowest mode can be without creeping.
        (0..if step < 5 { 50 } else { 3_000 }).for_each(|_| {
            simulation.advance(&Inputs::default());
            simulation.mesh_mut().change_motion(|_, _, v| *v *= 0.92);
        });
    }

    let linear = case["res"].as_array().unwrap().iter().find(|r| r["elem"] == "P1").unwrap();
    let moves_as_the_reference = |simulation: &Simulation, what: &str, allowed: Real| {
        for (number, expected) in linear["probes"].as_object().unwrap() {
            let node: u32 = number.parse().unwrap();
            let moved = simulation.mesh().position_of(node).unwrap() - body.rest(node);
            let off = (moved - vector(expected)).norm() / pressed.norm();
            println!("R7, {what}, node {number}: {:.5} mm, off by {off:.1e} of the press", 1e3 * moved.norm());
            assert!(off < allowed, "{what}, node {number}: {moved} for {expected}");
        }
    };
    // Between the impulses of its elements a node falls by g Δt²/8, a micrometre, and more of it adds up towards the free
    // ends.
    moves_as_the_reference(&simulation, "at rest in time", 3e-3);
    balance(&mut simulation, gravity, &still);
    moves_as_the_reference(&simulation, "its forces in balance", 1e-6);
    let forces = reactions(&mut simulation, gravity);
    for (name, nodes) in [("patch", &patch), ("fixed", &fixed)] {
        let expected = vector(&linear[format!("reaction_{name}_N")]);
        let found: Vec3 = forces.iter().filter(|(n, _)| nodes.contains(n)).map(|(_, force)| force).sum();
        let off = (found - expected).norm() / expected.norm();
        println!("R7, reaction of the {name} nodes: {:.5} N, off by {off:.1e}", found.norm());
        assert!(off < 1e-6, "{found} for {expected}");
    }
}
