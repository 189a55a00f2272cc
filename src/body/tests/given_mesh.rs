//! A given tetrahedral mesh against a reference solution on that very mesh (case R7: a liver of 181 nodes, part of it
//! fixed, part of it pressed down by 5 mm, under its weight).
//!
//! Mesh and reference lie in a folder beside the project; without them the test says so and passes.

use palpate_body::geometry::mesh_io::{LengthUnit, read_surface, read_tet_mesh};
use palpate_body::prepare::{Elements, Recipe, Shape, boundary_surface, prepare};
use palpate_core::contact::safety::ForceLimits;
use palpate_core::contact::tool::Following;
use palpate_core::geometry::locate::Locator;
use palpate_core::geometry::{Surface, TetMesh};
use palpate_core::math::{Real, Vec3, to_parry};
use palpate_core::model::body::Support;
use palpate_core::model::element_kernel::{Rates, Simd};
use palpate_core::model::element_pool::CLASSES;
use palpate_core::model::step_class::{class_at_rest, step_of};
use palpate_core::model::{Body, Material};
use palpate_core::simulation::{Inputs, Settings, Simulation, Snapshot};
use parry3d_f64::query::PointQueryWithLocation;
use serde_json::Value;
use std::sync::Arc;

#[path = "../../../tests/common/shared.rs"]
mod shared;
use palpate_core::ids::{Node, Slot, Vertex};
use shared::shared;

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
    let recipe = Recipe {
        name: "R7".into(),
        shape,
        material,
        inclusions: vec![],
        holds: vec![],
        elements: Elements::Tetrahedra,
        damping_ratio: 0.0,
    };
    let mut parts = prepare(&recipe, &mut |_, _, _| {}).unwrap().into_parts();
    parts.levels[0].fixed = fixed;
    Arc::new(Body::new(parts).unwrap())
}

/// What would hold each node in place against its elements and its weight [N].
fn reactions(simulation: &mut Simulation, gravity: Vec3) -> Vec<(Node, Vec3)> {
    let body = simulation.body().clone();
    let mesh = simulation.mesh_mut();
    (0..CLASSES).for_each(|class| {
        mesh.add_forces(Simd::best(), class, &Rates::ELASTIC);
    });
    let slots = mesh.active().to_vec();
    let of = |slot: &Slot| {
        let n = mesh.node(*slot);
        let f = std::mem::take(&mut mesh.motion.force[slot.index()]);
        (n, -(Vec3::new(f[0], f[1], f[2]) + gravity * body.level(0).node_mass[n.index()]))
    };
    slots.iter().map(of).collect()
}

/// Moves the nodes, but for those that are `still`, until the forces of the core's elements balance their weight: plain
/// damped steps of the shortest length that any element takes.
fn balance(simulation: &mut Simulation, gravity: Vec3, still: &[Node]) {
    let body = simulation.body().clone();
    let classes = body.elements_of(0).map(|e| class_at_rest(&body, e));
    let step = 0.5 * step_of(classes.max().unwrap());
    let mut velocity = vec![Vec3::zeros(); body.node_count()];
    for _ in 0..60_000 {
        for (n, force) in reactions(simulation, gravity) {
            let v = &mut velocity[n.index()];
            *v = if still.contains(&n) {
                Vec3::zeros()
            } else {
                *v * 0.97 - force * (step / body.level(0).node_mass[n.index()])
            };
        }
        simulation.mesh_mut().change_motion(|n, x, _| *x += velocity[n.index()] * step);
    }
}

/// The body under its weight, where it was made.
fn at_rest(body: &Arc<Body>, gravity: Vec3) -> Simulation {
    let settings = Settings {
        gravity,
        tools: vec![],
        obstacles: vec![],
        organ_friction: Default::default(),
        support_motions: vec![],
        following: Following { speed: 1.0, engage_ticks: 1 },
        limits: ForceLimits { force: 100.0, torque: 10.0, slew: 1e6 },
        adaptivity: None,
        most_elements: usize::MAX,
    };
    Simulation::new(body.clone(), settings, Snapshot::at_rest(body, 0, 0)).unwrap()
}

/// Lets the body come to rest, damped about as much as its slowest mode can be without creeping.
fn settle(simulation: &mut Simulation, ticks: u32) {
    for _ in 0..ticks {
        simulation.advance(&Inputs::default());
        simulation.mesh_mut().change_motion(|_, _, v| *v *= 0.92);
    }
}

/// The body under its weight, its nodes in `patch` moved by `pressed` [m], at rest.
fn press(body: &Arc<Body>, gravity: Vec3, patch: &[Node], pressed: Vec3) -> Simulation {
    let mut simulation = at_rest(body, gravity);
    // In steps: an element is never crushed on the way.
    for step in 1..=5 {
        let now = pressed * (Real::from(step) / 5.0);
        simulation.mesh_mut().change_motion(|n, x, _| {
            if patch.contains(&n) {
                *x = body.rest(n) + now;
            }
        });
        settle(&mut simulation, if step < 5 { 50 } else { 3_000 });
    }
    simulation
}

/// Reference and given mesh of the case, in metres about its centre; `None` where the reference is not there.
fn given() -> Option<(Value, TetMesh)> {
    let (reference, mesh) = (shared("reference/reference.json")?, shared("meshes/liver.msh")?);
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
    // The mesh is the only level: its nodes are the body's.
    let [fixed, patch, still] = [fixed, patch, still].map(|nodes| nodes.into_iter().map(Node).collect::<Vec<_>>());
    let volume = case["mesh"]["volume_m3"].as_f64().unwrap();
    assert!((body.level(0).volume() / volume - 1.0).abs() < 1e-9, "{}", body.level(0).volume());
    for (number, place) in case["probes"].as_object().unwrap() {
        assert!((body.rest(Node(number.parse().unwrap())) - vector(place)).norm() < 1e-9, "node {number}");
    }

    let gravity = Vec3::new(0.0, -case["g"].as_f64().unwrap(), 0.0);
    let pressed = vector(&case["patch_displacement"]);
    let mut simulation = press(&body, gravity, &patch, pressed);

    let linear = case["res"].as_array().unwrap().iter().find(|r| r["elem"] == "P1").unwrap();
    let moves_as_the_reference = |simulation: &Simulation, what: &str, allowed: Real| {
        for (number, expected) in linear["probes"].as_object().unwrap() {
            let node = Node(number.parse().unwrap());
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

/// Answers of linear elements on the given mesh where each tetrahedron is cut regularly into 8, and again, to edges of
/// about 12 and 6 mm: reactions [N] of what is pressed and fixed, and how the probes move [mm].
///
/// They are static solutions (Newton's method) of a solver of its own, no part of this project, that gives the
/// reference's linear and quadratic answers on the mesh itself to all digits shown. A midpoint belongs to a set where
/// both ends do, but node 134 of the patch, on none of its faces, is free: alone it holds less and less as elements
/// shrink. The limit that is extrapolated, the second answer and its difference from the first, moves by no more than
/// 0.03 mm and 0.08 N with a third cut; that of quadratic elements lies within 0.15 mm and 0.15 N of it.
const CUT: [(&str, [Vec3; 2]); 7] = [
    ("patch", [Vec3::new(-7.0461, -5.5978, -0.4958), Vec3::new(-6.5235, -4.2568, -0.5569)]),
    ("fixed", [Vec3::new(7.0461, 16.6569, 0.4958), Vec3::new(6.5235, 15.3159, 0.5569)]),
    ("16", [Vec3::new(-0.85404, -9.96865, -1.04260), Vec3::new(-1.12721, -11.16792, -1.42889)]),
    ("33", [Vec3::new(-0.08457, -0.36405, -0.02195), Vec3::new(-0.09115, -0.43161, -0.02403)]),
    ("52", [Vec3::new(-0.39446, -2.21152, 0.08476), Vec3::new(-0.42000, -2.21295, 0.07999)]),
    ("82", [Vec3::new(0.82636, -8.78435, -0.97251), Vec3::new(1.06549, -9.63616, -1.36649)]),
    ("100", [Vec3::new(0.33714, -2.99220, 0.59354), Vec3::new(0.41442, -2.97733, 0.56815)]),
];

/// The quantities of [`CUT`] for the load of the case on the body that is prepared from `surface` with elements of
/// `spacing` [m].
///
/// A cover reaches beyond the body, so that fixing its nodes would hold and press more than the faces. They are held as
/// the program holds regions, by springs of 10 E over the spacing; those of the pressed faces reach for places that lie
/// as much lower.
fn covered(case: &Value, mesh: &TetMesh, surface: &Surface, spacing: Real) -> Vec<Vec3> {
    let (fixed, patch) = (numbers(&case["fixed"]), numbers(&case["patch"]));
    let gravity = Vec3::new(0.0, -case["g"].as_f64().unwrap(), 0.0);
    let pressed = vector(&case["patch_displacement"]);
    let (faces, around) = (mesh.boundary(), boundary_surface(mesh).to_trimesh());
    let locator = Locator::new(mesh, 0.02);
    let all_in = |nodes: &[u32], set: &[u32]| nodes.iter().all(|n| set.contains(n));
    let inside_fixed = |p: &Vec3| {
        let host = locator.host(*p);
        host.extrapolation() == 0.0 && all_in(&mesh.elements[host.element as usize], &fixed)
    };

    let mut parts = liver(case, Shape::closed(surface.clone(), vec![spacing]), vec![]).parts().clone();
    let level = &mut parts.levels[0];
    level.fixed = (0..level.mesh.nodes.len() as u32).filter(|n| inside_fixed(&level.mesh.nodes[*n as usize])).collect();
    // By set, the area of its faces that each vertex stands for: a triangle belongs to the face that it is nearest to.
    let mut areas = [&patch, &fixed].map(|_| vec![0.0; surface.vertices.len()]);
    for (t, triangle) in surface.triangles.iter().enumerate() {
        let [a, b, c] = surface.corners(t);
        let (_, (face, _)) = around.project_local_point_and_get_location(to_parry((a + b + c) / 3.0), false);
        for (set, areas) in [&patch, &fixed].iter().zip(&mut areas) {
            if all_in(&faces[face as usize], set) {
                triangle.iter().for_each(|v| areas[*v as usize] += (b - a).cross(&(c - a)).norm() / 6.0);
            }
        }
    }
    let mut sets: [Vec<Vertex>; 2] = Default::default();
    for ((areas, set), shift) in areas.iter().zip(&mut sets).zip([pressed, Vec3::zeros()]) {
        for (v, area) in areas.iter().enumerate().filter(|(_, area)| **area > 0.0) {
            let per_area = 10.0 * case["E"].as_f64().unwrap() / spacing;
            parts.supports.push(Support { vertex: Vertex::at(v), stiffness: per_area * area });
            parts.surface.vertices[v] += shift;
            set.push(Vertex::at(v));
        }
    }
    let body = Arc::new(Body::new(parts).unwrap());
    let is_free = |n: Node| !body.is_fixed(n);

    // From near the answer, so that nothing is crushed on the way.
    let middle = sets[0].iter().map(|v| body.surface().vertices[v.index()]).sum::<Vec3>() / sets[0].len() as Real;
    let mut simulation = at_rest(&body, gravity);
    simulation.mesh_mut().change_motion(|n, x, _| {
        if is_free(n) {
            *x += pressed * (1.4 - (body.rest(n) - middle).norm() / 0.05).clamp(0.0, 1.0);
        }
    });
    settle(&mut simulation, 1_500);

    let mesh = simulation.mesh();
    let pull = |hold: &Support| {
        // What fixed nodes bear of a spring is counted with them.
        let host = body.embedding(0, hold.vertex).unwrap();
        let free: Real =
            body.element(host.element).iter().zip(host.weights).filter(|(n, _)| is_free(**n)).map(|(_, w)| w).sum();
        (body.surface().vertices[hold.vertex.index()] - mesh.vertex(hold.vertex)) * (hold.stiffness * free)
    };
    let mut found: Vec<Vec3> =
        sets.iter().map(|set| body.supports().iter().filter(|h| set.contains(&h.vertex)).map(pull).sum()).collect();
    let level = Locator::new(&body.level(0).mesh, spacing);
    for (number, _) in &CUT[2..] {
        let host = body.host_on(0, level.host(vector(&case["probes"][number]))).unwrap();
        let shift = |n: Node| mesh.position_of(n).unwrap() - body.rest(n);
        found.push(body.element(host.element).into_iter().zip(host.weights).map(|(n, w)| shift(n) * (1e3 * w)).sum());
    }
    let at_nodes = reactions(&mut simulation, gravity);
    found[1] += at_nodes.iter().filter(|(n, _)| !is_free(*n)).map(|(_, force)| force).sum::<Vec3>();
    found
}

/// The same load on bodies that are prepared from surfaces, against the limit of the cut meshes: each reaction and each
/// probe by itself.
///
/// Errors are about of first order, for stresses have no bound at the rim of what is pressed and held. So half the size
/// leaves open about what it has changed: the difference of the body's own two spacings and, as those of one cover may
/// agree by chance, that of the two cut meshes, whose elements are about as large; a quarter on top, as is usual for
/// such estimates. A body a fifth softer or a quarter stiffer is beyond it. The surface that goes with the mesh has
/// another shape, 7 % more volume and weight, and is 17 mm off at a crease: what that changes is taken from the coarse
/// bodies of both.
#[test]
fn the_body_of_the_surface_around_it_answers_as_well_as_its_resolution_can_tell() {
    let Some((case, mesh)) = given() else { return };
    let Some(file) = shared("meshes/liver-smooth.obj") else { return };
    let mut smooth = read_surface(&file, LengthUnit::Metre).unwrap();
    place(&case, &mut smooth.vertices);
    let own = boundary_surface(&mesh).subdivided(5);
    let mut of_own = Vec::new();
    for (name, surface) in [("own surface", own), ("smooth surface", smooth)] {
        let [coarse, fine] = [0.016, 0.008].map(|spacing| covered(&case, &mesh, &surface, spacing));
        if of_own.is_empty() {
            of_own = coarse.clone();
        }
        for (i, (what, [once, twice])) in CUT.iter().enumerate() {
            let limit = twice * 2.0 - once;
            let shape = (coarse[i] - of_own[i]).norm();
            let allowed = 1.25 * ((coarse[i] - fine[i]).norm() + (twice - once).norm()) + shape;
            let [before, off] = [coarse[i], fine[i]].map(|found| (found - limit).norm());
            println!("R7, {name}, {what}: {:.3?}, off by {before:.3}, {off:.3} of {allowed:.3}", fine[i].as_slice());
            assert!(off < before, "{name}, {what}: not nearer with smaller elements");
            assert!(off < allowed, "{name}, {what}: {} for {limit}", fine[i]);
        }
    }
}
