//! Bodies of several organs: each that meets no other moves as it would alone, and all share the clock, the tools and the work budget.

mod meeting;

use palpate::display::Display;
use palpate::recording::{Recording, RecordingWriter, replay};
use palpate::scene::LoadedScene;
use palpate_body::prepare::body_file::{BodyFile, Provenance};
use palpate_body::prepare::merge::merge;
use palpate_core::contact::Shape as ToolShape;
use palpate_core::contact::tool::{Coupling, Part, PoseSample, ToolEvent};
use palpate_core::ids::{OrganId, Slot, Vertex};
use palpate_core::math::{Pose, Real, Vec3, is_finite};
use palpate_core::model::active_set::Change;
use palpate_core::model::element_kernel::Simd;
use palpate_core::model::{ActiveMesh, Body, State};
use palpate_core::simulation::{Budget, Inputs, MOST_FROZEN, Parameter, Simulation, TICKS_PER_FRAME};
use std::f64::consts::PI;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// A box, and a smaller, stiffer one beside it that is turned, both held below; a tool for each.
const SCENE: &str = r#"
name = "large"
[body]
source = "box"
cells = [[2, 2, 2], [4, 4, 4], [8, 8, 8]]
[material]
youngs_modulus = 10000.0
poisson_ratio = 0.35
density = 1000.0
[[hold]]
min = [0.0, 0.0, 0.0]
max = [0.1, 0.1, 0.0]
exact = true
[[organ]]
name = "small"
position = [0.25, 0.02, 0.01]
orientation = [0.0, 0.0, 0.6, 0.8]
[organ.body]
source = "box"
size = [0.05, 0.06, 0.07]
cells = [[2, 2, 2], [3, 3, 4], [5, 6, 7]]
[organ.material]
youngs_modulus = 30000.0
density = 1200.0
[[organ.hold]]
min = [0.0, 0.0, 0.0]
max = [0.05, 0.06, 0.0]
exact = true
[[tool]]
name = "left"
radius = 0.02
[[tool]]
name = "right"
radius = 0.015
[world]
gravity = [0.0, 0.0, 0.0]
settle = 0.0
"#;

fn load_text(text: &str, overrides: &[&str]) -> LoadedScene {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("organs.toml");
    std::fs::write(&path, text).unwrap();
    let overrides: Vec<String> = overrides.iter().map(|s| (*s).to_owned()).collect();
    LoadedScene::load(&path, &overrides).unwrap()
}

fn load(overrides: &[&str]) -> LoadedScene {
    load_text(SCENE, overrides)
}

fn build(loaded: &LoadedScene) -> Arc<Body> {
    Arc::new(loaded.build(&mut |_, _, _| {}).unwrap())
}

fn refused(overrides: &[&str]) -> String {
    load(overrides).build(&mut |_, _, _| {}).unwrap_err().to_string()
}

/// The organs of `loaded`, each by itself and where it is.
fn alone(loaded: &LoadedScene) -> [(Body, Pose); 2] {
    let organ = &loaded.scene.organ[0];
    let first = palpate::scene::Scene { organ: vec![], ..loaded.scene.clone() };
    let built = |scene| LoadedScene { scene, ..loaded.clone() }.build(&mut |_, _, _| {}).unwrap();
    [(built(first), Pose::default()), (built(loaded.scene.of_organ(organ)), organ.pose())]
}

fn simulation(loaded: &LoadedScene, body: &Arc<Body>) -> Simulation {
    Simulation::new(body.clone(), loaded.scene.settings(), loaded.scene.at_rest(body)).unwrap()
}

/// The middles of the tops of both.
fn tops(loaded: &LoadedScene) -> [Vec3; 2] {
    [Vec3::new(0.05, 0.05, 0.1), loaded.scene.organ[0].pose().to_world(Vec3::new(0.025, 0.03, 0.07))]
}

/// Presses the tools in `used` 6 mm into the tops within 0.3 s.
fn press(loaded: &LoadedScene, used: &[usize], tick: u64) -> Inputs {
    let mut inputs = Inputs::default();
    for &tool in used {
        let height = loaded.scene.tool[tool].radius + (0.004 - 0.010 * (tick as Real / 300.0).min(1.0));
        let pose = PoseSample {
            sequence: tick as u32,
            time_ns: 0,
            pose: Pose { position: tops(loaded)[tool] + Vec3::z() * height, ..Pose::default() },
            buttons: 0,
            opening: 0.0,
        };
        inputs.tools[tool] = Some(match tick {
            0 => ToolEvent::Attach { epoch: 1, period_ticks: 1, coupling: Coupling::RIGID },
            _ => ToolEvent::Pose(pose),
        });
    }
    inputs
}

/// Active nodes of the finest level in each organ.
fn finest(body: &Body, mesh: &ActiveMesh) -> [usize; 2] {
    let active = |organ| {
        let nodes = body.nodes_of(body.finest());
        nodes.filter(|n| body.organ_of(*n).index() == organ && mesh.set().is_active(*n)).count()
    };
    [active(0), active(1)]
}

/// Each of the parts has two faces, of which the second ones come later than the first ones of all.
#[test]
fn four_balls_of_one_tool_between_two_organs_push_both_of_them_and_quietly() {
    let beside = ["organ.0.position=[0.116,0,0]", "organ.0.orientation=[0,0,0,1]", "organ.0.body.size=[0.1,0.1,0.1]"];
    // Both held by all of the face below.
    let held = "organ.0.hold=[{min=[0,0,0],max=[0.1,0.1,0],exact=true}]";
    let loaded =
        load(&[&beside[..], &[held, "organ.0.material.youngs_modulus=10000", "material.damping_time=0.01"]].concat());
    let body = build(&loaded);
    let mut settings = loaded.scene.settings();
    let ball = |y: Real| Part::capsule(0.01, 0.0).at(Pose { position: Vec3::new(0.0, y, 0.0), ..Pose::default() });
    settings.tools[0].shape = ToolShape::compound([-0.036, -0.012, 0.012, 0.036].map(ball).to_vec()).unwrap();
    let mut press = Simulation::new(body.clone(), settings, loaded.scene.at_rest(&body)).unwrap();
    let (mut forces, mut walls) = (Vec::new(), [[0.0; 2]; 4]);
    for tick in 0..600u64 {
        let position = Vec3::new(0.108, 0.05, 0.115 - 0.045 * (tick as Real / 400.0).min(1.0));
        let pose = Pose { position, ..Pose::default() };
        let mut inputs = Inputs::default();
        inputs.tools[0] = Some(match tick {
            0 => ToolEvent::Attach { epoch: 1, period_ticks: 1, coupling: Coupling::RIGID },
            _ => ToolEvent::Pose(PoseSample { sequence: tick as u32, time_ns: 0, pose, buttons: 0, opening: 0.0 }),
        });
        forces.push(press.advance(&inputs).tools[0].state.physical_force);
        walls = [[0.0; 2]; 4];
        for p in &press.snapshot().points[0] {
            let part = (p.point / body.points_of_a_part()) as usize;
            walls[part][usize::from(p.normal.x > 0.0)] += p.multiplier;
        }
    }
    // The organs still swing.
    let kink = forces[500..].windows(3).map(|f| (f[2] - 2.0 * f[1] + f[0]).norm()).fold(0.0, Real::max);
    println!("walls {walls:.4?} N, kinks of {kink:.1e} N");
    let mean = walls.iter().flatten().sum::<Real>() / 8.0;
    assert!(walls.iter().flatten().all(|wall| (wall / mean - 1.0).abs() < 0.1), "{walls:?}");
    assert!(mean > 0.05 && kink < 3e-3 * mean, "{kink} of {mean} N");
}

#[test]
fn a_merged_body_has_what_its_organs_have() {
    let loaded = load(&[]);
    let body = build(&loaded);
    let alone = alone(&loaded);
    assert_eq!(body.name(), "large, small");
    assert_eq!(body.organs().len(), 2);
    let sum = |of: &dyn Fn(&Body) -> Real| alone.iter().map(|(body, _)| of(body)).sum::<Real>();
    assert!((body.mass() / sum(&|b| b.mass()) - 1.0).abs() < 1e-14);
    assert_eq!(body.element_count() as Real, sum(&|b| b.element_count() as Real));
    assert!((body.surface().volume() - (1e-3 + 0.05 * 0.06 * 0.07)).abs() < 1e-12);
    for (organ, (own, pose)) in body.organs().iter().zip(&alone) {
        assert_eq!(organ.name, own.name());
        assert!((organ.mass / own.mass() - 1.0).abs() < 1e-14);
        assert!((organ.centre_of_mass - pose.to_world(own.centre_of_mass())).norm() < 1e-12);
        for (v, vertex) in organ.vertices.clone().zip(&own.surface().vertices) {
            assert!((body.surface().vertices[v] - pose.to_world(*vertex)).norm() < 1e-15);
            assert_eq!(&body.parts().materials[body.material_number(body.element_at(Vertex::at(v)))], own.material());
        }
        let triangles = &body.surface().triangles[organ.triangles.clone()];
        assert!(triangles.iter().flatten().all(|v| organ.vertices.contains(&(*v as usize))));
    }
    // Every element has the volume, the stiffness and the ties of the one it was.
    for r in 0..3 {
        let mut nodes = body.nodes_of(r);
        let mut elements = body.elements_of(r);
        for (i, (own, pose)) in alone.iter().enumerate() {
            for n in own.nodes_of(r) {
                let merged = nodes.next().unwrap();
                assert_eq!(body.organ_of(merged), OrganId::at(i));
                assert!((body.rest(merged) - pose.to_world(own.rest(n))).norm() < 1e-15);
                assert_eq!((body.spacing_at(merged), body.is_fixed(merged)), (own.spacing_at(n), own.is_fixed(n)));
                assert_eq!(body.stabilisation(merged), own.stabilisation(n));
                assert_eq!(body.children(merged).len(), own.children(n).len());
            }
            for e in own.elements_of(r) {
                let merged = elements.next().unwrap();
                assert!((body.volume(merged) / own.volume(e) - 1.0).abs() < 1e-9);
                assert_eq!(body.material_of(merged), own.material_of(e));
                assert_eq!(body.density(merged), own.density(e));
            }
        }
    }
    let again = Body::from_bytes(body.bytes()).unwrap();
    assert_eq!(again.parts(), body.parts());
    let mut mixed = again.into_parts();
    mixed.organs[0].vertices += 1;
    mixed.organs[1].vertices -= 1;
    assert!(Body::new(mixed).unwrap_err().to_string().contains("organs share a part"));
}

#[test]
fn fibres_turn_with_their_organ() {
    let law = "youngs_modulus = 30000.0\nlaw = \"transversely_isotropic\"\nfibre_modulus = 9e4\nfibre_direction = [1.0, 0.5, 0.2]";
    let loaded = load_text(&SCENE.replace("youngs_modulus = 30000.0", law), &[]);
    let pose = loaded.scene.organ[0].pose();
    let a = Vec3::new(1.0, 0.5, 0.2).normalize();
    let turned = |body: &Body| {
        for e in body.elements() {
            let fibres = body.led(body.material_of(e), e).fibres;
            let is_second = body.organ_of(body.element(e)[0]) == OrganId::at(1);
            assert_eq!(fibres.modulus, if is_second { 9e4 } else { 0.0 });
            assert!(!is_second || (fibres.direction - pose.rotate(a)).norm() < 1e-12, "{fibres:?}");
        }
    };
    turned(&build(&loaded));
    // The same where a file gives the direction of each element.
    let [first, (second, pose)] = alone(&loaded);
    let mut parts = second.into_parts();
    parts.labels.directions = parts.levels.iter().map(|level| vec![a; level.mesh.elements.len()]).collect();
    let tissues = parts.materials.iter_mut().chain(&mut parts.mixtures.tissues);
    tissues.for_each(|material| material.fibres.direction = Vec3::zeros());
    turned(&merge(vec![first, (Body::new(parts).unwrap(), pose)], 0.0).unwrap());
}

/// The largest displacement of the second organ, and how far it goes from where it would be alone, while the first is pressed.
fn beside_a_press(overrides: &[&str]) -> (Real, Real) {
    let loaded = load(overrides);
    let body = build(&loaded);
    let [_, second] = alone(&loaded);
    let second = Arc::new(merge(vec![second], loaded.scene.material.damping_ratio).unwrap());
    let (mut both, mut one) = (simulation(&loaded, &body), simulation(&loaded, &second));
    let (mut force, mut moved, mut away) = (0.0 as Real, 0.0 as Real, 0.0 as Real);
    for tick in 0..800 {
        force = force.max(both.advance(&press(&loaded, &[0], tick)).tools[0].state.physical_force.norm());
        one.advance(&Inputs::default());
        let [there, here] = [(&body, &both, 1), (&second, &one, 0)].map(|(body, simulation, organ)| {
            let own = body.organs()[organ].vertices.clone();
            own.map(|v| simulation.mesh().vertex(Vertex::at(v))).collect::<Vec<Vec3>>()
        });
        for ((a, b), rest) in there.iter().zip(&here).zip(&second.surface().vertices) {
            (moved, away) = (moved.max((a - rest).norm()), away.max((a - b).norm()));
        }
    }
    assert!(force > 0.3, "{force} N");
    (moved, away)
}

#[test]
fn an_organ_moves_as_it_would_alone_while_the_other_is_pressed() {
    let gravity = "world.gravity=[0.5, 0.0, -2.0]";
    // Where elements of both take the same steps, bit for bit; else nodes rest at more places of a tick, and round there.
    let alike = [
        "material.elements='tetrahedra'",
        "organ.0.material.youngs_modulus=10000",
        "organ.0.material.poisson_ratio=0.35",
        "body.active_level=1",
    ];
    let (moved, away) = beside_a_press(&[&alike[..], &[gravity]].concat());
    assert!(moved > 1e-5 && away == 0.0, "{moved} m, {away} m");
    for level in [&["body.active_level=1"][..], &[]] {
        let (moved, away) = beside_a_press(&[level, &[gravity]].concat());
        println!("{level:?}: goes {moved:.1e} m, {away:.1e} m from where it goes alone");
        assert!(moved > 1e-5 && away < 1e-11, "{moved} m, {away} m");
    }
}

#[test]
fn two_tools_feel_the_two_organs_as_each_would_feel_its_own() {
    let loaded = load(&["body.active_level=1"]);
    let body = build(&loaded);
    let run = |used: &[usize]| {
        let mut simulation = simulation(&loaded, &body);
        for tick in 0..600 {
            simulation.advance(&press(&loaded, used, tick));
        }
        used.iter().map(|tool| simulation.tools()[*tool].physical_force.z).collect::<Vec<Real>>()
    };
    let (both, left, right) = (run(&[0, 1]), run(&[0]), run(&[1]));
    println!("{both:?} N together, {left:?} and {right:?} N by themselves");
    assert!(both[0] > 0.2 && both[1] > 0.2);
    assert!((both[0] / left[0] - 1.0).abs() < 1e-9 && (both[1] / right[0] - 1.0).abs() < 1e-9);
}

#[test]
fn a_change_of_resolution_in_one_organ_leaves_the_other_as_it_was() {
    let loaded = load(&["hold=[]", "organ.0.hold=[]"]);
    let body = build(&loaded);
    let state = State::at_rest_on(&body, body.nodes_of(0).collect()).unwrap();
    let mut mesh = ActiveMesh::new(&body, &state, body.element_count()).unwrap();
    mesh.change_motion(|n, x, v| {
        let wave = (Real::from(n.0) * 0.7).sin();
        *x += Vec3::new(wave, -wave, 0.5 * wave) * 1e-3;
        *v = Vec3::new(0.3 * wave, 0.2, x.x);
    });
    let motion = |mesh: &ActiveMesh, organ: usize| {
        let own = mesh.active().iter().filter(|s| body.organ_of(mesh.node(**s)).index() == organ);
        let moves = |s: &Slot| (mesh.node(*s), mesh.motion.position[s.index()], mesh.motion.velocity[s.index()]);
        let mut all: Vec<_> = own.map(moves).collect();
        all.sort_by_key(|(n, ..)| *n);
        all
    };
    let momenta = |mesh: &ActiveMesh, organ: usize| {
        let own = mesh.active().iter().filter(|s| body.organ_of(mesh.node(**s)).index() == organ).map(|s| s.index());
        own.fold((0.0, Vec3::zeros(), Vec3::zeros()), |(mass, linear, angular), s| {
            let at = |p: &[Real; 4]| Vec3::new(p[0], p[1], p[2]);
            let m = mesh.motion.mass[s];
            let p = at(&mesh.motion.velocity[s]) * m;
            (mass + m, linear + p, angular + at(&mesh.motion.position[s]).cross(&p))
        })
    };
    let before = (motion(&mesh, 1), momenta(&mesh, 0), momenta(&mesh, 1));
    for n in body.nodes_of(0).filter(|n| body.organ_of(*n) == OrganId(0)) {
        mesh.apply(&body, &[Change::Split(n)]);
        let (mass, linear, angular) = momenta(&mesh, 0);
        assert!((mass / body.organs()[0].mass - 1.0).abs() < 1e-12);
        assert!((linear - before.1.1).norm() < 1e-12 && (angular - before.1.2).norm() < 1e-12);
        assert!(motion(&mesh, 1) == before.0, "the other organ is moved");
        assert!((momenta(&mesh, 1).0 / before.2.0 - 1.0).abs() < 1e-12);
    }
}

#[test]
fn both_organs_refine_under_their_tools_and_shed_when_the_budget_is_cut() {
    let loaded = load(&["material.damping_ratio=0.15", "material.damping_time=0"]);
    let body = build(&loaded);
    let mut touched = simulation(&loaded, &body);
    let mut forces = [0.0; 2];
    for tick in 0..600 {
        let outputs = touched.advance(&press(&loaded, &[0, 1], tick));
        assert!(!outputs.restored);
        forces = [0, 1].map(|i| outputs.tools[i].state.physical_force.z);
    }
    let refined = finest(&body, touched.mesh());
    // Hardly enough for the coarsest level, the contacts and the end of a frame.
    let coarse = load(&["material.damping_ratio=0.15", "material.damping_time=0", "body.active_level=0"]);
    let mut least = simulation(&coarse, &body);
    for tick in 0..600 {
        least.advance(&press(&coarse, &[0, 1], tick));
    }
    let frame = 600..600 + TICKS_PER_FRAME;
    let budget = frame.map(|tick| least.advance(&press(&coarse, &[0, 1], tick)).plan.whole).max().unwrap() * 6 / 5;
    let mut frozen = 0;
    for tick in 600..1200 {
        let outputs = touched.advance(&Inputs { budget: Budget::of(budget), ..press(&loaded, &[0, 1], tick) });
        // Only one that has stood still for too long may take more.
        let whole = outputs.plan.whole;
        assert!(!outputs.restored && (whole <= budget || frozen == MOST_FROZEN), "{whole} of {budget}");
        frozen = if outputs.plan.taken == 0 { frozen + 1 } else { 0 };
    }
    let shed = finest(&body, touched.mesh());
    let later = [0, 1].map(|i| touched.tools()[i].physical_force.z);
    println!("{refined:?} nodes of the finest level, {shed:?} on a budget of {budget}; {forces:?} N, then {later:?} N");
    assert!(refined.iter().all(|n| *n > 10) && shed.iter().zip(refined).all(|(shed, before)| *shed < before / 2));
    assert!(forces.iter().chain(&later).all(|f| *f > 0.2), "the hand keeps feeling both");
}

/// Damping ratio of a signal that swings about a place that itself creeps back: the mean logarithmic decrement of its way
/// from turn to turn over two half swings.
fn damping_ratio(signal: &[Real]) -> Real {
    let turns = signal.windows(3).filter(|w| (w[1] - w[0]) * (w[2] - w[1]) < 0.0).map(|w| w[1]);
    let turns: Vec<Real> = std::iter::once(signal[0]).chain(turns).take(4).collect();
    assert!(turns.len() == 4, "{} turns: no swing to be measured", turns.len());
    let ways: Vec<Real> = turns.windows(2).map(|pair| (pair[1] - pair[0]).abs()).collect();
    let decrement = (ways[0] / ways[2]).ln() / 2.0;
    decrement / (PI * PI + decrement * decrement).sqrt()
}

#[test]
fn every_organ_swings_damped_as_the_scene_asks_though_one_is_slower() {
    for modulus in ["40000.0", "200000.0"] {
        let asked = "material.damping_ratio=0.15";
        let loaded = load_text(
            &SCENE.replace("30000.0", modulus),
            &[asked, "material.damping_time=0", "body.active_level=1", "world.gravity=[-2.0,0,0]", "world.settle=2"],
        );
        let body = build(&loaded);
        let modes = alone(&loaded).map(|(body, _)| body.slowest_mode());
        let start = loaded.scene.settled(&body, &mut |_, _, _| {});
        let settings = palpate_core::simulation::Settings { gravity: Vec3::zeros(), ..loaded.scene.settings() };
        let mut swing = Simulation::new(body.clone(), settings, start).unwrap();
        let mut signals = [vec![], vec![]];
        for _ in 0..1500 {
            swing.advance(&Inputs::default());
            for (organ, signal) in body.organs().iter().zip(&mut signals) {
                let shift = |v: usize| swing.mesh().vertex(Vertex::at(v)).x - body.surface().vertices[v].x;
                signal.push(organ.vertices.clone().map(shift).sum::<Real>());
            }
        }
        let ratios = signals.map(|signal| damping_ratio(&signal));
        println!("{modulus} Pa, {asked}: modes {modes:.1?} rad/s, ζ = {ratios:.3?}");
        assert!(modes[1] > 2.0 * modes[0] && body.slowest_mode() == modes[0]);
        assert!(ratios.iter().all(|ratio| (0.12..0.18).contains(ratio)), "{ratios:?}");
    }
}

#[test]
fn organs_that_let_go_keep_their_energy_and_rest_stays_rest() {
    let loaded = load(&["material.damping_time=0"]);
    let body = build(&loaded);
    let mut rest = simulation(&loaded, &body);
    for _ in 0..200 {
        rest.advance(&Inputs::default());
    }
    let start = loaded.scene.at_rest(&body);
    let mut still = vec![Vec3::zeros(); body.surface().vertices.len()];
    rest.mesh().skin(&mut still);
    let moved = still.iter().zip(&body.surface().vertices).map(|(x, u)| (x - u).norm()).fold(0.0, Real::max);
    assert!(moved < 1e-12, "{moved} m");
    let energy = |s: &Simulation| {
        let e = palpate_core::model::energy::energy(&body, s.mesh(), Vec3::zeros());
        e.kinetic + e.elastic
    };
    let mut swing = Simulation::new(body.clone(), loaded.scene.settings(), start).unwrap();
    swing.mesh_mut().change_motion(|n, u, v| {
        if !body.is_fixed(n) {
            *v = Vec3::new(0.2 * u.z, 0.1 * u.z, 0.0) * 10.0;
        }
    });
    let before = energy(&swing);
    let mut worst = 0.0 as Real;
    for _ in 0..3000 {
        swing.advance(&Inputs::default());
        worst = worst.max((energy(&swing) / before - 1.0).abs());
    }
    println!("energy {before:.3e} J, off by {worst:.1e} of it at most in 3 s");
    assert!(worst < 0.05, "{worst}");
}

#[test]
fn a_recording_of_two_organs_replays_identical() {
    let loaded = load(&["world.gravity=[0.0, 0.0, -2.0]"]);
    let body = build(&loaded);
    let start = loaded.scene.at_rest(&body);
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("organs.mcap");
    let mut simulation = simulation(&loaded, &body);
    let mut writer = RecordingWriter::create(&file, &loaded.scene, &body, &start, &start.body).unwrap();
    for tick in 0..640 {
        let inputs = press(&loaded, &[0, 1], tick);
        let o = simulation.advance(&inputs);
        writer.tick(o.tick, &inputs, &o.tools, o.flags(), o.frame.then_some(o.hash)).unwrap();
        if o.frame {
            writer.frame(&o.into()).unwrap();
        }
    }
    writer.finish().unwrap();
    let recording = Recording::read(&file).unwrap();
    assert_eq!(recording.body.organs().len(), 2);
    for path in Simd::available() {
        let report = replay(&recording, path).unwrap();
        assert_eq!((report.difference, report.ticks, report.hashes), (None, 640, 20));
    }
    // A snapshot of both, taken up again, goes on with the same bits.
    let mut again = Simulation::new(body.clone(), loaded.scene.settings(), simulation.snapshot()).unwrap();
    for tick in 640..700 {
        simulation.advance(&press(&loaded, &[0, 1], tick));
        again.advance(&press(&loaded, &[0, 1], tick));
    }
    assert_eq!(simulation.hash(), again.hash());
    assert!(simulation.tools().iter().all(|tool| is_finite(&tool.physical_force) && tool.physical_force.z > 0.1));
}

#[test]
fn organs_that_overlap_or_do_not_fit_are_refused_by_name_and_place() {
    let e = refused(&["organ.0.position=[0.1, 0.02, 0.01]"]);
    assert!(e.contains("large and small overlap by") && e.contains("around (0.0"), "{e}");
    let e = refused(&["organ.0.position=[0.06, 0.02, 0.01]", "organ.0.body.size=[0.02, 0.02, 0.02]"]);
    assert!(e.contains("large and small overlap"), "one inside the other: {e}");
    let e = refused(&["organ.0.body.cells=[[2,2,2],[4,4,4]]"]);
    assert!(e.contains("large has 3 levels, small has 2"), "{e}");
    let e = refused(&["organ.0.hold.0.min=[0.2, 0.2, 0.2]", "organ.0.hold.0.max=[0.3, 0.3, 0.3]"]);
    assert!(e.contains("organ \"small\"") && e.contains("hold 1 holds nothing"), "{e}");
    let parsed = |change: &str| palpate::scene::parse(&format!("{SCENE}{change}"), "my.toml").unwrap_err().to_string();
    let another = "[[organ]]\nname = \"x\"\n[organ.body]\nsource = \"box\"\n";
    let e = parsed(&format!("{another}active_level = 1\n"));
    assert!(e.contains("organ[1].body.active_level") && e.contains("means every organ"), "{e}");
    let e = parsed(&format!("{another}[organ.material]\ndamping_ratio = 0.2\n"));
    assert!(e.contains("damping_ratio") && e.contains("youngs_modulus"), "{e}");
    let given = |names: &str| format!("{SCENE}[[contact]]\nbetween = [{names}]\nfriction = 0.1\n");
    let between = |names: &str| parsed(&given(names)[SCENE.len()..]);
    let e = between("'large', 'nobody'");
    assert!(e.contains("contact[0].between") && e.contains("\"nobody\": there is large, small"), "{e}");
    let folds = palpate::scene::parse(&given("'large', 'large'"), "my.toml").unwrap().settings().organ_friction;
    let [large, small] = [0, 1].map(OrganId);
    assert_eq!((folds.of(large, large), folds.of(large, small)), (0.1, 0.0));
    let e = between("'large', 'small']\nfriction = 0.2\n[[contact]]\nbetween = ['small', 'large'");
    assert!(e.contains("contact[1].between") && e.contains("further up"), "{e}");
    let e = parsed("[[contact]]\nbetween = ['large', 'small']\nfriction = 3.0\n");
    assert!(e.contains("contact[0].friction"), "{e}");
    let e = parsed(&another.repeat(7));
    assert!(e.contains("organ") && e.contains('7'), "{e}");
    let e = parsed(&another.replace("name", "orientation = [1, 1, 0, 0]\nname"));
    assert!(e.contains("organ[1].orientation") && e.contains("quaternion"), "{e}");
}

#[test]
fn a_prepared_body_is_an_organ_of_its_own_material_and_holds() {
    let loaded = load(&["material.damping_ratio=0.15"]);
    let [_, (own, _)] = alone(&loaded);
    let scene = loaded.scene.of_organ(&loaded.scene.organ[0]);
    let provenance = Provenance { scene: scene.to_toml(), ..Provenance::default() };
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("small.palpate"), BodyFile { provenance, body: own }.bytes()).unwrap();
    let text = SCENE.split("[organ.body]").next().unwrap();
    let path: PathBuf = folder.path().join("scene.toml");
    let prepared = |more: &str| {
        let organ = format!("{text}[organ.body]\nsource = \"prepared\"\nfile = \"small.palpate\"\n{more}");
        std::fs::write(&path, organ).unwrap();
        LoadedScene::load(Path::new(&path), &["material.damping_ratio=0.15".to_owned()]).unwrap()
    };
    let (fresh, again) = (build(&loaded), build(&prepared("")));
    assert_eq!(again.parts(), fresh.parts());
    let stiffer = build(&prepared("[organ.material]\nyoungs_modulus = 60000.0\n"));
    assert!((stiffer.parts().materials[1].youngs_modulus() - 6e4).abs() < 1.0);
    assert_eq!(stiffer.parts().materials[1].density, 1200.0);
}

#[test]
fn session_and_surface_say_whose_what_is() {
    let loaded = load(&[]);
    let body = build(&loaded);
    let session = palpate::wire::session::describe(&loaded.scene, &body);
    let told = session.body.unwrap().organs;
    let surface =
        palpate_sdk::Surface::from_parts(palpate::wire::surface::topology(&body, &Display::touched(&body), 1)).unwrap();
    assert_eq!(surface.organs, told);
    assert_eq!(told.iter().map(|organ| organ.name.as_str()).collect::<Vec<_>>(), ["large", "small"]);
    assert!(
        (told[1].volume - 0.05 * 0.06 * 0.07).abs() < 1e-12 && (told[1].mass_kg / told[1].volume - 1200.0).abs() < 1e-6
    );
    assert!((told[1].youngs_modulus - 3e4).abs() < 1.0 && (told[0].youngs_modulus - 1e4).abs() < 1.0);
    for ([vertices, triangles], organ) in surface.ranges().zip(body.organs()) {
        assert_eq!(vertices, organ.vertices);
        assert!(surface.triangles[triangles].iter().flatten().all(|v| vertices.contains(&(*v as usize))));
    }
    // A body of one says so, too.
    let [(one, _), _] = alone(&loaded);
    assert_eq!(palpate::wire::session::organs(&one, &Display::touched(&one).organs).len(), 1);
}

#[test]
fn tissues_of_organs_and_regions_have_names_in_the_order_of_the_body() {
    let given = [
        "body.cells=[[3,3,3],[5,5,5]]",
        "material.region=[{name='nodule', centre=[0.05,0.05,0.05], radius=0.02, youngs_modulus=3e4}]",
        "organ=[{name='kidney', position=[0.3,0,0], body={source='box', cells=[[3,3,3],[5,5,5]]}, \
          material={youngs_modulus=2e4, region=[{centre=[0.05,0.05,0.05], radius=0.02, youngs_modulus=4e4}]}}]",
    ];
    let loaded = LoadedScene::load(Path::new("cube"), &given.map(String::from)).unwrap();
    let body = loaded.build(&mut |_, _, _| {}).unwrap();
    let names = loaded.scene.tissues();
    assert_eq!(names, ["cube", "nodule", "kidney", "kidney.region1"]);
    let tissues = body.parts().mixtures.tissues.iter().map(|tissue| tissue.youngs_modulus().round());
    assert_eq!(tissues.collect::<Vec<_>>(), [1e4, 3e4, 2e4, 4e4]);
    // One that is named changes its own elements and those that have some of it, and no others.
    for (t, name) in names.iter().enumerate() {
        let named = loaded.scene.parameters_named(&format!("stiffness.{name}"), &[2.0]).unwrap();
        assert_eq!(named, [Parameter::Stiffness { tissue: t as u16, factor: 2.0 }]);
        let mut stiffness = [1.0; 4];
        stiffness[t] = 2.0;
        for (m, prepared) in body.parts().materials.iter().enumerate() {
            let factor = body.mixed(m, &stiffness).mu / prepared.mu;
            assert!((1.0..=2.0 + 1e-12).contains(&factor) && (body.has_tissue(m, t) || factor == 1.0), "{factor}");
        }
    }
    assert_eq!(loaded.scene.parameters_named("stiffness", &[2.0]).unwrap().len(), 4);
}
