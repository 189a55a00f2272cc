//! Bodies from shapes and files: levels that are independent, tied together, and safe to step.

use palpate::scene::LoadedScene;
use palpate_body::geometry::primitives::liver_surface;
use palpate_core::geometry::primitives::box_mesh;
use palpate_core::geometry::{Moments, Surface, TetMesh};
use palpate_core::ids::Slot;
use palpate_core::math::{Bounds, Real, Vec3};
use palpate_core::model::element_kernel::{Rates, Simd};
use palpate_core::model::element_pool::CLASSES;
use palpate_core::model::step_class::{self, Strained};
use palpate_core::model::{ActiveMesh, Body, State};
use palpate_core::simulation::{Inputs, Simulation};
use std::collections::BTreeSet;
use std::fmt::Write as _;
use std::fs;
use std::path::Path;
use std::sync::Arc;

#[path = "common/shared.rs"]
mod shared;
use shared::shared;
#[path = "common/random.rs"]
mod random;
use random::whole;

fn load(scene: &Path, given: &[&str]) -> LoadedScene {
    LoadedScene::load(scene, &given.iter().map(|s| (*s).to_owned()).collect::<Vec<_>>()).unwrap()
}

fn build(scene: &str, given: &[&str]) -> Body {
    load(Path::new(scene), given).build(&mut |_, _, _| {}).unwrap()
}

#[test]
fn the_bundled_shapes_make_tied_levels_of_one_mass() {
    for scene in ["liver", "toy"] {
        let body = build(scene, &[]);
        let surface = body.surface();
        let Bounds { low, high } = surface.bounds();
        let size = (high - low).norm();
        assert!((0.15..0.40).contains(&size), "{scene}: {size} m");
        assert!(body.levels().len() >= 2);
        let centre = body.levels().last().unwrap().centre_of_mass();
        for (i, level) in body.levels().iter().enumerate() {
            let mass: Real = level.node_mass.iter().sum();
            let volume = level.volume() / surface.volume() - 1.0;
            let moved = (level.centre_of_mass() - centre).norm() / size;
            let inertia = Moments::of_points(&level.mesh.nodes, &level.node_mass).inertia_error(&body.mass_moments());
            let worst = level.embedding.iter().map(|h| h.extrapolation()).fold(0.0, Real::min);
            println!(
                "{scene} level {i}: {} nodes, {} elements, volume {:+.2} %, centre off by {:.2} %, inertia by {:+.2} %, worst \
                 row {worst:.2}",
                level.mesh.nodes.len(),
                level.mesh.elements.len(),
                100.0 * volume,
                100.0 * moved,
                100.0 * inertia
            );
            assert!((mass / body.mass() - 1.0).abs() < 1e-12);
            assert!(volume.abs() < 0.01 && moved < 0.001 && worst > -0.5);
            assert!(inertia.abs() < if i == 0 { 0.01 } else { 1e-3 }, "inertia {inertia:+.1e}");
            let alone = ActiveMesh::new(&body, &State::at_rest(&body, i), usize::MAX).unwrap();
            for (n, m) in body.nodes_of(i).zip(&level.node_mass).filter(|_| i == body.finest()) {
                let active = alone.motion.mass[alone.slot(n).unwrap().index()];
                assert!((active / m - 1.0).abs() < 1e-6, "node {n} weighs {active} kg among others, {m} kg by itself");
            }
            // At rest every display vertex is where it belongs, whichever level carries it.
            let mut vertices = vec![Vec3::zeros(); surface.vertices.len()];
            ActiveMesh::new(&body, &State::at_rest(&body, i), usize::MAX).unwrap().skin(&mut vertices);
            let off = vertices.iter().zip(&surface.vertices).map(|(a, b)| (a - b).norm()).fold(0.0, Real::max);
            assert!(off < 1e-12 * size.max(1.0) * 10.0, "{off}");
        }
        for pair in body.levels().windows(2) {
            let parents: BTreeSet<u32> = pair[1].parent.iter().copied().collect();
            assert_eq!(parents.len(), pair[0].mesh.nodes.len(), "every coarse node has a child");
            assert!(pair[0].mesh.nodes.iter().all(|u| pair[1].mesh.nodes.iter().all(|v| (u - v).norm() > 1e-9)));
            for (host, u) in pair[1].coarser_host.iter().zip(&pair[1].mesh.nodes) {
                let corners = pair[0].mesh.corners(host.element as usize);
                let back: Vec3 = corners.iter().zip(host.weights).map(|(c, w)| c * w).sum();
                assert!((back - u).norm() < 1e-12);
            }
        }
    }
}

/// The true explicit limit [s] at rest: `2/ω` with `ω²` the largest eigenvalue of `M⁻¹K`, by power iteration on
/// differences of the kernel's own forces and the springs'.
fn explicit_limit(body: &Body, mesh: &mut ActiveMesh) -> Real {
    let slots = mesh.active().to_vec();
    let rest: Vec<Vec3> = slots.iter().map(|s| body.rest(mesh.node(*s))).collect();
    let mut index = vec![usize::MAX; body.node_count()];
    slots.iter().enumerate().for_each(|(i, s)| index[mesh.node(*s).index()] = i);
    let mut shape: Vec<Vec3> = (0..rest.len())
        .map(|i| Vec3::new((i % 7) as Real - 3.0, (i % 5) as Real - 2.0, (i % 3) as Real - 1.0))
        .collect();
    let mut eigenvalue = 0.0;
    for _ in 0..400 {
        let norm = shape.iter().map(|v| v.norm_squared()).sum::<Real>().sqrt();
        shape.iter_mut().for_each(|v| *v /= norm);
        let scale = 1e-6;
        mesh.change_motion(|n, x, _| *x = body.rest(n) + shape[index[n.index()]] * scale);
        for class in 0..CLASSES {
            mesh.add_forces(Simd::best(), class, &Rates::ELASTIC);
        }
        for hold in body.supports() {
            let pull = (body.surface().vertices[hold.vertex.index()] - mesh.vertex(hold.vertex)) * hold.stiffness;
            let attachment = *mesh.embedding(hold.vertex);
            for (slot, w) in attachment.slots.iter().zip(attachment.weights) {
                (0..3).for_each(|c| mesh.motion.force[slot.index()][c] += pull[c] * w);
            }
        }
        mesh.hand_back_all();
        let take = |s: &Slot| {
            let f = std::mem::replace(&mut mesh.motion.force[s.index()], [0.0; 4]);
            Vec3::new(f[0], f[1], f[2]) * (-mesh.motion.inverse_mass[s.index()] / scale)
        };
        shape = slots.iter().map(take).collect();
        // Converges from below to the largest eigenvalue: its square root within 1 % is enough here.
        eigenvalue = shape.iter().map(|v| v.norm_squared()).sum::<Real>().sqrt();
    }
    2.0 / eigenvalue.sqrt()
}

#[test]
fn the_steps_of_the_elements_are_below_the_true_limit() {
    let free = "world.gravity=[0,0,0]";
    let flat = ["body.size=[0.2,0.05,0.1]", "body.cells=[[8,3,4]]", "hold=[]", free];
    let all: [(&str, &str, &[&str]); 5] = [
        ("box", "cube", &[]),
        ("flat box", "cube", &flat),
        ("nearly incompressible", "liver", &["material.poisson_ratio=0.49"]),
        ("liver", "liver", &[]),
        ("toy", "toy", &[]),
    ];
    for (name, scene, given) in all.into_iter().take(if whole() { 5 } else { 3 }) {
        let body = build(scene, given);
        for level in 0..body.levels().len() {
            let mut mesh = ActiveMesh::new(&body, &State::at_rest(&body, level), usize::MAX).unwrap();
            // What the element of the shortest step would take, had it no viscosity.
            let stiffest = body
                .elements_of(level)
                .map(|e| step_class::omega_squared(&body, body.material_of(e), e))
                .fold(0.0, Real::max);
            let chosen = step_class::stable_step(stiffest, Strained::REST, 0.0, mesh.stiffest_spring());
            let limit = explicit_limit(&body, &mut mesh);
            println!(
                "{name}, level {level}: step {:.3} ms, limit {:.3} ms, used {:.0} %",
                1e3 * chosen,
                1e3 * limit,
                1e2 * chosen / limit
            );
            assert!(chosen < 0.97 * limit, "{name}, level {level}");
            assert!(chosen > 0.2 * limit, "{name}, level {level}: needlessly short");
        }
    }
}

#[test]
fn a_hard_kick_dies_away_at_every_damping_time() {
    // Kelvin–Voigt viscosity of every strength, and Maxwell branches.
    let all = [("0.0", "0.0"), ("0.05", "0.0"), ("0.0", "0.15"), ("0.0005", "0.0"), ("0.005", "0.0")];
    for (tau, zeta) in all.into_iter().take(if whole() { 5 } else { 3 }) {
        let damping = [format!("material.damping_time={tau}"), format!("material.damping_ratio={zeta}")];
        let given = ["body.active_level=0", &damping[0], &damping[1], "world.gravity=[0,0,0]"];
        let damped = given[1..3] != ["material.damping_time=0.0", "material.damping_ratio=0.0"];
        let loaded = load(Path::new("liver"), &given);
        let body = Arc::new(loaded.build(&mut |_, _, _| {}).unwrap());
        let start = loaded.scene.at_rest(&body);
        let mut simulation = Simulation::new(body.clone(), loaded.scene.settings(), start).unwrap();
        simulation.mesh_mut().change_motion(|n, _, v| {
            // Undamped, a hard kick makes elements change their steps to and fro with the strain, and each change of
            // step costs or gives a little energy; a soft one leaves the steps alone.
            if n.index().is_multiple_of(3) {
                *v = Vec3::new(0.5, -0.4, 0.3) * if damped { 1.0 } else { 0.02 };
            }
        });
        let energy = |s: &Simulation| palpate_core::model::energy::energy(&body, s.mesh(), Vec3::zeros()).total();
        let mut evaluations = 0;
        // Largest energy of each tenth of a second: within a step near the limit the energy of the fastest modes
        // swings between kinetic and elastic, but it must not grow.
        let mut most = [0.0 as Real; 10];
        for tick in 0..1000 {
            let outputs = simulation.advance(&Inputs::default());
            evaluations += outputs.element_evaluations;
            assert!(!outputs.restored && outputs.plan.taken == outputs.plan.needed);
            most[tick / 100] = most[tick / 100].max(energy(&simulation));
        }
        let per_tick = Real::from(evaluations) / 1e3 / simulation.mesh().pool().len() as Real;
        println!(
            "τ = {tau} s, ζ = {zeta}: {per_tick:.2} evaluations a tick, energy {:.2e} J → {:.2e} J",
            most[0], most[9]
        );
        assert!(most[9] < most[0] * if damped { 0.5 } else { 1.05 }, "τ = {tau} s, ζ = {zeta}: {most:?}");
    }
}

/// Gmsh 2.2 and 4.1 text of a mesh.
fn msh(mesh: &TetMesh, version: &str, scale: Real) -> String {
    let mut text = format!("$MeshFormat\n{version} 0 8\n$EndMeshFormat\n$Nodes\n");
    let (nodes, elements) = (mesh.nodes.len(), mesh.elements.len());
    if version == "4.1" {
        writeln!(text, "1 {nodes} 1 {nodes}\n3 1 0 {nodes}").unwrap();
        (1..=nodes).for_each(|i| writeln!(text, "{i}").unwrap());
    } else {
        writeln!(text, "{nodes}").unwrap();
    }
    for (i, u) in mesh.nodes.iter().enumerate() {
        let tag = if version == "4.1" { String::new() } else { format!("{} ", i + 1) };
        writeln!(text, "{tag}{} {} {}", u.x * scale, u.y * scale, u.z * scale).unwrap();
    }
    text.push_str("$EndNodes\n$Elements\n");
    let head =
        if version == "4.1" { format!("1 {elements} 1 {elements}\n3 1 4 {elements}") } else { elements.to_string() };
    writeln!(text, "{head}").unwrap();
    for (i, e) in mesh.elements.iter().enumerate() {
        let kind = if version == "4.1" { "" } else { " 4 2 0 1" };
        writeln!(text, "{}{kind} {} {} {} {}", i + 1, e[0] + 1, e[1] + 1, e[2] + 1, e[3] + 1).unwrap();
    }
    text.push_str("$EndElements\n");
    text
}

#[test]
fn meshes_from_gmsh_files_are_levels_and_move_like_the_box_they_came_from() {
    let folder = tempfile::tempdir().unwrap();
    let size = Vec3::repeat(0.1);
    // Millimetres in powers of two, so that the way through the text and the unit changes no bit of 0.1 m.
    fs::write(folder.path().join("coarse.msh"), msh(&box_mesh(size, [2; 3]), "2.2", 1.0)).unwrap();
    fs::write(folder.path().join("fine.msh"), msh(&box_mesh(size, [4; 3]), "4.1", 1.0)).unwrap();
    let scene = folder.path().join("scene.toml");
    let text = "name = \"two files\"\n[body]\nsource = \"volumes\"\nfiles = [\"coarse.msh\", \"fine.msh\"]\nunit = \"m\"\n\
                [[hold]]\nmin = [0.0, 0.0, 0.0]\nmax = [0.1, 0.1, 0.0]\nexact = true\n";
    fs::write(&scene, text).unwrap();
    let swing = |loaded: LoadedScene| {
        let body = Arc::new(loaded.build(&mut |_, _, _| {}).unwrap());
        assert_eq!(body.levels().len(), 2);
        let start = loaded.scene.at_rest(&body);
        let mut simulation = Simulation::new(body, loaded.scene.settings(), start).unwrap();
        (0..200).for_each(|_| {
            simulation.advance(&Inputs::default());
        });
        simulation.snapshot().body
    };
    let given = "material={youngs_modulus=5000.0, poisson_ratio=0.45, density=1050.0}";
    let fine = "body.active_level=1";
    let files = swing(load(&scene, &[fine]));
    let boxes = swing(load(Path::new("cube"), &["body.cells=[[2,2,2],[4,4,4]]", given, fine]));
    assert_eq!(files.nodes.len(), 125);
    assert_eq!(files, boxes);
    let top = files.position.iter().map(|x| x.z).fold(0.0, Real::max);
    assert!(top < 0.1 - 1e-4, "it sags: {top}");
}

fn write_obj(surface: &Surface, scale: Real) -> String {
    let mut text = String::new();
    surface.vertices.iter().for_each(|v| writeln!(text, "v {} {} {}", v.x * scale, v.y * scale, v.z * scale).unwrap());
    surface.triangles.iter().for_each(|t| writeln!(text, "f {} {} {}", t[0] + 1, t[1] + 1, t[2] + 1).unwrap());
    text
}

#[test]
fn a_surface_file_in_millimetres_makes_an_organ_of_its_size_and_an_open_one_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let surface = liver_surface(0.006);
    let file = folder.path().join("liver.obj");
    fs::write(&file, write_obj(&surface, 1000.0)).unwrap();
    let name = format!("body.file={:?}", file.to_str().unwrap());
    let body = build("organ", &[&name, "body.unit=mm"]);
    assert!((body.mass() / (1050.0 * surface.volume()) - 1.0).abs() < 0.01);
    assert_eq!(body.levels().len(), 4);

    let mut open = surface.clone();
    open.triangles.pop();
    fs::write(&file, write_obj(&open, 1000.0)).unwrap();
    let e = load(Path::new("organ"), &[&name, "body.unit=mm"]).build(&mut |_, _, _| {}).unwrap_err().to_string();
    println!("{e}");
    assert!(e.contains("liver.obj") && e.contains("not closed") && e.contains("3 edges"), "{e}");
}

#[test]
fn holds_that_hold_nothing_and_levels_that_do_not_exist_are_named() {
    let fault = |given: &[&str]| match load(Path::new("liver"), given).build(&mut |_, _, _| {}) {
        Ok(_) => panic!("{given:?} made a body"),
        Err(e) => e.to_string(),
    };
    let e = fault(&["hold.0.min=[5,5,5]", "hold.0.max=[6,6,6]"]);
    assert!(e.contains("hold 1 holds nothing") && e.contains("the body reaches from"), "{e}");
    let e = fault(&["hold.0.exact=true"]);
    assert!(e.contains("hold 1 is exact"), "{e}");
    let e = fault(&["body.active_level=7"]);
    assert!(e.contains("active_level is 7") && e.contains("0 to 3"), "{e}");
    let e = fault(&["body.spacings=[0.0001]"]);
    assert!(e.contains("over the limit"), "{e}");
}

#[test]
fn a_level_that_cannot_be_stepped_is_named_and_not_used() {
    let warning = |given: &[&str]| {
        let loaded = load(Path::new("cube"), given);
        loaded.scene.warning(&loaded.build(&mut |_, _, _| {}).unwrap())
    };
    assert_eq!(warning(&[]), None);
    let stiff = ["material.youngs_modulus=5e8", "material.damping_time=0"];
    let said = warning(&stiff).unwrap();
    println!("{said}");
    assert!(said.contains("of level 2 need") && said.contains("levels up to 1 are used"), "{said}");
    assert_eq!(warning(&[stiff[0], stiff[1], "resolution.finest_level=1"]), None);
    let fixed = [stiff[0], stiff[1], "body.active_level=2"];
    assert_eq!(warning(&fixed), Some(said));
    let loaded = load(Path::new("cube"), &fixed);
    let body = loaded.build(&mut |_, _, _| {}).unwrap();
    let start = loaded.scene.at_rest(&body).body.nodes;
    assert!(start.iter().all(|n| body.level_of(*n) == 1));
}

#[test]
fn a_body_survives_its_file_and_a_damaged_file_is_refused() {
    let body = build("toy", &[]);
    let again = Body::from_bytes(body.bytes()).unwrap();
    assert_eq!((again.checksum(), again.bytes()), (body.checksum(), body.bytes()));
    assert_eq!(again.levels(), body.levels());
    assert_eq!(build("toy", &[]).bytes(), body.bytes(), "the same scene gives the same bytes");
    let mut damaged = body.bytes().to_vec();
    let middle = damaged.len() / 2;
    damaged[middle] ^= 1;
    assert!(Body::from_bytes(&damaged).unwrap_err().to_string().contains("damaged"));
    assert!(Body::from_bytes(&body.bytes()[..middle]).unwrap_err().to_string().contains("damaged"));
    assert!(Body::from_bytes(b"solid").unwrap_err().to_string().contains("not a palpate body"));
}

#[test]
fn real_organs_make_bodies_where_they_are_at_hand() {
    let Some(meshes) = shared("meshes") else { return };
    for (file, unit, scale, litres) in [
        ("Liver.stl", "mm", "1.0", 1.818),
        ("Spleen.stl", "mm", "1.0", 0.344),
        ("liver-smooth.obj", "m", "0.0308519", 1.2),
    ] {
        let name = format!("body.file={:?}", meshes.join(file).to_str().unwrap());
        let body = build("organ", &[&name, &format!("body.unit={unit}"), &format!("body.scale={scale}")]);
        let volume = 1e3 * body.surface().volume();
        println!("{file}: {volume:.3} L, {} display vertices", body.surface().vertices.len());
        assert!((volume / litres - 1.0).abs() < 0.15, "{file}: {volume} L");
        for level in body.levels() {
            let error = level.volume() / body.surface().volume() - 1.0;
            println!(
                "  {} nodes, {} elements, volume {:+.2} %",
                level.mesh.nodes.len(),
                level.mesh.elements.len(),
                1e2 * error
            );
            assert!(error.abs() < 0.04);
        }
    }
}

#[test]
fn a_body_too_stiff_for_the_shortest_step_is_refused_with_how_much_softer_it_must_be() {
    let given = |modulus: f64| {
        let stiff = [format!("material.youngs_modulus={modulus}"), "material.density=10".into()];
        let loaded = LoadedScene::load(Path::new("cube"), &stiff).unwrap();
        loaded.build(&mut |_, _, _| {}).map(|_| ()).map_err(|fault| fault.to_string())
    };
    let fault = given(1e8).unwrap_err();
    assert!(fault.contains("cube") && fault.contains("times softer or denser"), "{fault}");
    let factor: f64 = fault.split("material ").nth(1).and_then(|s| s.split(' ').next()).unwrap().parse().unwrap();
    println!("{fault}");
    assert_eq!(given(1e8 / (1.02 * factor)), Ok(()));
}
