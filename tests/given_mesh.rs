//! A given tetrahedral mesh against a reference solution on that very mesh (case R7: a liver of 181 nodes, part of it
//! fixed, part of it pressed down by 5 mm, under its weight).
//!
//! Mesh and reference lie in a folder beside the project; without them the test says so and passes.

use palpate::contact::safety::ForceLimits;
use palpate::contact::tool::Following;
use palpate::geometry::TetMesh;
use palpate::geometry::locate::Locator;
use palpate::geometry::mesh_io::{LengthUnit, read_surface, read_tet_mesh};
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
fn liver(case: &Value, shape: Shape, fixed: Vec<u32>) -> Arc<Body> {
    let number = |key: &str| case[key].as_f64().unwrap();
    let material = Material::from_young(number("E"), number("nu"), number("rho"));
    let recipe = Recipe { name: "R7".into(), shape, material, inclusions: vec![], holds: vec![], damping_ratio: 0.0 };
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

/// The body under its weight, its nodes in `patch` moved by `pressed` [m], at rest.
fn press(body: &Arc<Body>, gravity: Vec3, patch: &[u32], pressed: Vec3) -> Simulation {
    let settings = Settings {
        gravity,
        tools: vec![],
        following: Following { speed: 1.0, engage_ticks: 1 },
        limits: ForceLimits { force: 100.0, torque: 10.0, slew: 1e6 },
        adaptivity: None,
        most_elements: usize::MAX,
    };
    let mut simulation = Simulation::new(body.clone(), settings, Snapshot::at_rest(body, 0, 0)).unwrap();
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
    simulation
}

/// Reference and given mesh of the case, in metres about its centre; `None` where the reference is not there.
fn given() -> Option<(Value, TetMesh)> {
    let shared = Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared");
    let (reference, mesh) = (shared.join("reference/reference.json"), shared.join("meshes/liver.msh"));
    if !reference.exists() || !mesh.exists() {
        eprintln!("the reference is not there: not tested");
        return None;
    }
    let all: Value = serde_json::from_str(&std::fs::read_to_string(reference).unwrap()).unwrap();
    let case = all["cases"]["R7_liver"].clone();
    let mut mesh = read_tet_mesh(&mesh, LengthUnit::Metre).unwrap();
    place(&case, &mut mesh.nodes);
    Some((case, mesh))
}

/// Points of a file [its unit] where the case has them [m].
fn place(case: &Value, points: &mut [Vec3]) {
    let (centre, scale) = (vector(&case["mesh"]["centre"]), case["mesh"]["scale"].as_f64().unwrap());
    points.iter_mut().for_each(|u| *u = (*u - centre) * scale);
}

#[test]
fn a_given_mesh_answers_as_the_reference_does_on_the_same_mesh() {
    let Some((case, mesh)) = given() else { return };
    let (fixed, patch) = (numbers(&case["fixed"]), numbers(&case["patch"]));
    let mut still: Vec<u32> = fixed.iter().chain(&patch).copied().collect();
    still.sort_unstable();
    let body = liver(&case, Shape::meshes([mesh]), still.clone());
    let volume = case["mesh"]["volume_m3"].as_f64().unwrap();
    assert!((body.level(0).volume() / volume - 1.0).abs() < 1e-9, "{}", body.level(0).volume());
    for (number, place) in case["probes"].as_object().unwrap() {
        assert!((body.rest(number.parse().unwrap()) - vector(place)).norm() < 1e-9, "node {number}");
    }

    let gravity = Vec3::new(0.0, -case["g"].as_f64().unwrap(), 0.0);
    let pressed = vector(&case["patch_displacement"]);
    let mut simulation = press(&body, gravity, &patch, pressed);

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

/// The same load on the body that is prepared from the surface that goes with the mesh. Between linear and quadratic
/// elements on the mesh the answer changes by some thirds: that is what its resolution leaves open.
#[test]
fn the_body_of_the_surface_around_it_answers_as_well_as_its_resolution_can_tell() {
    let Some((case, mesh)) = given() else { return };
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared/meshes/liver-smooth.obj");
    let mut surface = read_surface(&file, LengthUnit::Metre).unwrap();
    place(&case, &mut surface.vertices);
    let (fixed, patch) = (numbers(&case["fixed"]), numbers(&case["patch"]));
    let gravity = Vec3::new(0.0, -case["g"].as_f64().unwrap(), 0.0);
    let pressed = vector(&case["patch_displacement"]);
    let locator = Locator::new(&mesh, 0.02);
    // A place of the mesh belongs to a set of its nodes where that holds all nodes of its element, or of the face it is on.
    let belongs = |p: Vec3, to: &[u32], least: Real| {
        let host = locator.host(p);
        let element = mesh.elements[host.element as usize];
        let outside: Real = (0..4).filter(|k| !to.contains(&element[*k])).map(|k| host.weights[k].abs()).sum();
        outside < least
    };
    let results = case["res"].as_array().unwrap();
    let of = |kind: &str| results.iter().find(|r| r["elem"] == kind).unwrap();
    let (linear, quadratic) = (of("P1"), of("P2"));
    let mut answers = Vec::new();
    for spacing in [0.016, 0.008] {
        let free = liver(&case, Shape::closed(surface.clone(), vec![spacing]), vec![]);
        let nodes = || 0..free.node_count() as u32;
        let held: Vec<u32> = nodes().filter(|n| belongs(free.rest(*n), &fixed, 1e-3)).collect();
        // The faces that are pressed are carried by the elements that the displayed surface lies in there.
        let under = (0..free.surface().vertices.len() as u32)
            .filter(|v| belongs(free.surface().vertices[*v as usize], &patch, 0.25));
        let mut moved: Vec<u32> = under.flat_map(|v| free.element(free.embedding(0, v).unwrap().element)).collect();
        moved.sort_unstable();
        moved.dedup();
        let mut still = [&held[..], &moved[..]].concat();
        still.sort_unstable();
        still.dedup();
        let body = liver(&case, Shape::closed(surface.clone(), vec![spacing]), still);
        let mut simulation = press(&body, gravity, &moved, pressed);
        let forces = reactions(&mut simulation, gravity);
        // Distance from the quadratic answer, and that of the linear one.
        let compare = |what: &str, found: Vec3, key: &dyn Fn(&Value) -> Vec3| {
            let (coarse, fine) = (key(linear), key(quadratic));
            let (off, left_open) = ((found - fine).norm(), (coarse - fine).norm());
            println!("R7, {spacing} m, {what}: {found:.4?}, off by {off:.2e}, linear by {left_open:.2e}");
            (off, left_open)
        };
        let mut all = Vec::new();
        for (name, nodes) in [("patch", &moved), ("fixed", &held)] {
            let found: Vec3 = forces.iter().filter(|(n, _)| nodes.contains(n)).map(|(_, force)| force).sum();
            all.push(compare(name, found, &|r| vector(&r[format!("reaction_{name}_N")])));
        }
        let level = Locator::new(&body.level(0).mesh, spacing);
        for (number, at) in case["probes"].as_object().unwrap() {
            let host = level.host(vector(at));
            let shift = |n: u32| simulation.mesh().position_of(n).unwrap() - body.rest(n);
            let moved = body.element(host.element).into_iter().zip(host.weights).map(|(n, w)| shift(n) * w).sum();
            all.push(compare(number, moved, &|r| vector(&r["probes"][number])));
        }
        answers.push(all);
    }
    let (coarse, fine) = (&answers[0], &answers[1]);
    assert!(coarse.iter().zip(fine).all(|(coarse, fine)| fine.0 < coarse.0), "nearer with smaller elements");
    assert!(fine[..2].iter().all(|(off, left_open)| *off < 0.5 * left_open), "reactions");
    // Two of the probes are next to what is pressed, where surface and mesh lie millimetres apart.
    let together =
        |of: &dyn Fn(&(Real, Real)) -> Real| fine[2..].iter().map(|pair| of(pair).powi(2)).sum::<Real>().sqrt();
    assert!(together(&|pair| pair.0) < together(&|pair| pair.1), "probes");
}
