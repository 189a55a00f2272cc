//! What a tick is made of, each part by itself, on the bundled liver: `cargo bench`.
//!
//! Absolute times are this machine's; a claim about speed is a ratio of two rows of one run.

use criterion::measurement::WallTime;
use criterion::{BenchmarkGroup, Criterion, Throughput, criterion_group, criterion_main};
use palpate::display::Display;
use palpate::scene::LoadedScene;
use palpate::wire;
use palpate::wire::surface::SurfaceEncoder;
use palpate_core::contact::tool::{Coupling, Part as ShapePart, PoseSample, Shape, ToolEvent};
use palpate_core::ids::Node;
use palpate_core::math::{Pose, Vec3};
use palpate_core::model::active_set::Change;
use palpate_core::model::element_kernel::{Rates, Simd};
use palpate_core::model::element_pool::CLASSES;
use palpate_core::model::{ActiveMesh, Body, State};
use palpate_core::simulation::{Budget, Frame, Inputs, Laps, Part, Simulation, Snapshot};
use palpate_proto::Message;
use std::hint::black_box;
use std::path::Path;
use std::sync::Arc;
use std::time::{Duration, Instant};

/// Elements of the body that the kernel runs on, at least.
const ELEMENTS: usize = 20_000;

fn load(overrides: &[&str]) -> LoadedScene {
    let overrides: Vec<String> = overrides.iter().map(|s| (*s).to_owned()).collect();
    LoadedScene::load(Path::new("liver"), &overrides).unwrap()
}

fn build(loaded: &LoadedScene) -> Arc<Body> {
    Arc::new(loaded.build(&mut |_, _, _| {}).unwrap())
}

fn pose(sequence: u32, position: Vec3) -> Option<ToolEvent> {
    let pose = Pose { position, ..Pose::default() };
    let sample = PoseSample { sequence, time_ns: 0, pose, buttons: 0, opening: 0.0 };
    Some(ToolEvent::Pose(sample))
}

/// All elements of the coarsest level that has enough of them, in one class of steps, a little strained.
fn element_kernel(c: &mut Criterion) {
    let mut group = c.benchmark_group("element kernel");
    let laws = [
        ("tetrahedra", "st_venant_kirchhoff"),
        ("tetrahedra", "neo_hookean"),
        ("tetrahedra", "transversely_isotropic"),
        ("smoothed", "st_venant_kirchhoff"),
    ];
    for ((kind, law), damping_ratio) in laws.into_iter().flat_map(|kind| [(kind, "0.0"), (kind, "0.15")]) {
        let keys = [
            format!("material.damping_ratio={damping_ratio}"),
            format!("material.elements='{kind}'"),
            format!("material.law='{law}'"),
        ];
        let fibres = ["material.fibre_modulus=2e4", "material.fibre_direction=[2,1,0]"];
        let fibres = if law == "transversely_isotropic" { &fibres[..] } else { &[] };
        let keys: Vec<&str> = keys.iter().map(String::as_str).chain(fibres.iter().copied()).collect();
        let body = build(&load(&keys));
        let level = (0..body.levels().len()).find(|r| body.elements_of(*r).len() >= ELEMENTS).unwrap();
        let mut state = State::at_rest(&body, level);
        let all = state.classes.concat();
        let elements = all.len() as u64;
        state.classes = vec![Vec::new(); CLASSES];
        state.classes[0] = all;
        let stars = state.stars.concat();
        state.stars = vec![Vec::new(); CLASSES];
        state.stars[0] = stars;
        let mut mesh = ActiveMesh::new(&body, &state, usize::MAX).unwrap();
        mesh.change_motion(|_, x, _| *x *= 1.01);
        let rates = Rates { volume: 0.1, shear: 0.1, decay: [0.98, 0.9], share: [0.2, 0.3] };
        group.throughput(Throughput::Elements(elements));
        for path in Simd::available() {
            let name = format!("{kind}, {law}, {path:?}, {} branches, {elements} elements", body.maxwell().len());
            group.bench_function(name, |b| b.iter(|| mesh.add_forces(path, 0, black_box(&rates))));
        }
    }
    group.finish();
}

fn ticks(c: &mut Criterion) {
    let loaded = load(&["world.gravity=[0,0,0]"]);
    let body = build(&loaded);
    let simulation = || Simulation::new(body.clone(), loaded.scene.settings(), loaded.scene.at_rest(&body)).unwrap();
    let top = body.surface().vertices.iter().copied().max_by(|a, b| a.z.total_cmp(&b.z)).unwrap();
    let radius = loaded.scene.tool[0].radius;
    let mut tick = c.benchmark_group("tick");
    let mut free = simulation();
    tick.bench_function("untouched", |b| b.iter(|| free.advance(&Inputs::default()).tick));
    let mut touched = simulation();
    let mut inputs = Inputs::default();
    inputs.tools[0] = Some(ToolEvent::Attach { epoch: 1, period_ticks: 1, coupling: Coupling::RIGID });
    touched.advance(&inputs);
    let mut sequence = 0;
    let mut press = |simulation: &mut Simulation, height: f64| {
        sequence += 1;
        let mut inputs = Inputs::default();
        inputs.tools[0] = pose(sequence, top + Vec3::new(0.0, 0.0, radius + height));
        simulation.advance(&inputs).tools[0].contact_points
    };
    (0..1000).for_each(|i| {
        press(&mut touched, 0.01 - 6e-5 * f64::from(i.min(300)));
    });
    assert!(press(&mut touched, -0.008) > 0, "the bench touches");
    let mesh = touched.mesh();
    let counts = (mesh.pool().len(), mesh.set().count().to_vec(), mesh.interface().len());
    println!("pressed: {} elements, {:?} active nodes by level, {} interface nodes", counts.0, counts.1, counts.2);
    assert!(counts.1.iter().skip(1).any(|n| *n > 0), "the bench refines");
    tick.bench_function("pressed", |b| b.iter(|| press(&mut touched, -0.008)));
    let mut lapsing = simulation();
    let none = Inputs { budget: Budget::of(0), ..Inputs::default() };
    tick.bench_function("without budget", |b| b.iter(|| lapsing.advance(&none).tick));
    tick.finish();

    let mut frame = c.benchmark_group("frame");
    let mut vertices = vec![Vec3::zeros(); body.surface().vertices.len()];
    frame.bench_function("skin", |b| b.iter(|| black_box(touched.mesh()).skin(&mut vertices)));
    frame.bench_function("state hash", |b| b.iter(|| touched.hash()));
    let mut room = Snapshot::with_room(&body, touched.settings());
    frame.bench_function("snapshot", |b| b.iter(|| touched.save_into(black_box(&mut room))));
    // Two seconds of palpation, again and again: one key frame in sixteen.
    let mut palpated = Vec::new();
    for tick in 0..2048 {
        let height = -0.008 + 1e-5 * f64::from((tick % 1024).min(1024 - tick % 1024));
        inputs.tools[0] = pose(2_000_000_000 + tick, top + Vec3::new(0.0, 0.0, radius + height));
        let outputs = touched.advance(&inputs);
        if outputs.frame {
            palpated.push(Frame::from(outputs));
        }
    }
    let mut encoder = SurfaceEncoder::new(Display::touched(&body).into(), 1);
    let mut turn = palpated.iter().cycle();
    frame.bench_function(format!("encode surface, {} vertices", vertices.len()), |b| {
        b.iter(|| {
            let Some(frame) = turn.next() else { unreachable!("frames come in a circle") };
            let parts = encoder.frame(black_box(frame)).unwrap();
            parts.iter().map(|part| part.encode_to_vec().len()).sum::<usize>()
        });
    });
    let outputs = touched.outputs();
    frame.bench_function("encode wrench", |b| {
        b.iter(|| wire::wrench(0, 1, 1, black_box(&outputs.tools[0]), outputs.flags()).encode_to_vec());
    });
    frame.finish();
}

/// Time in which contacts are found and solved.
struct OfContact {
    since: Instant,
    sum: Duration,
}

impl Laps for OfContact {
    fn lap(&mut self, part: Part, _: u32) {
        let now = Instant::now();
        if matches!(part, Part::Search | Part::Point | Part::SolidPoint | Part::PatchPoint | Part::Solve) {
            self.sum += now - self.since;
        }
        self.since = now;
    }
}

/// What each kind of tool takes of a tick while it presses the liver: finding its points, and all their solves.
fn contact(c: &mut Criterion) {
    let loaded = load(&["world.gravity=[0,0,0]"]);
    let body = build(&loaded);
    let top = body.surface().vertices.iter().copied().max_by(|a, b| a.z.total_cmp(&b.z)).unwrap();
    let at = |part: ShapePart, position: Vec3| part.at(Pose { position, ..Pose::default() });
    let lying =
        Pose { orientation: [0.0, 0.5_f64.sqrt(), 0.0, 0.5_f64.sqrt()], position: Vec3::new(-0.01, 0.0, 0.004) };
    let jaw = |y: f64| {
        let corners = (0..8).map(|i| {
            let far = |bit: i32| f64::from(i >> bit & 1);
            Vec3::new(0.016 * far(0) - 0.008, y + 0.006 * far(1) - 0.003, 0.03 * far(2))
        });
        ShapePart::convex(&corners.collect::<Vec<_>>(), 0.0005).unwrap()
    };
    let tips = [-0.01, 0.01].map(|x| at(ShapePart::capsule(0.004, 0.0), Vec3::new(x, 0.0, 0.004)));
    let kinds: [(&str, Shape); 6] = [
        ("ball", at(ShapePart::capsule(0.01, 0.0), Vec3::z() * 0.01).into()),
        ("capsule, lying", ShapePart::capsule(0.004, 0.02).at(lying).into()),
        ("cylinder", ShapePart::cylinder(0.008, 0.03, 0.001).into()),
        ("hull", jaw(0.0).into()),
        ("two balls", Shape::compound(tips.to_vec()).unwrap()),
        ("two flat jaws", Shape::compound(vec![jaw(-0.006), jaw(0.006)]).unwrap()),
    ];
    let mut group = c.benchmark_group("contact");
    for (name, shape) in kinds {
        let mut settings = loaded.scene.settings();
        settings.tools[0].shape = shape;
        let simulation = Simulation::new(body.clone(), settings, loaded.scene.at_rest(&body)).unwrap();
        // Down to 5 mm, and held there.
        take_contact(&mut group, name, simulation, 800, |tick| {
            (top + Vec3::z() * (0.005 - 2e-5 * f64::from(tick.min(500))), 0.0)
        });
    }
    // Without the table, whose contact is another matter.
    let free = ["obstacle=[]", "world.gravity=[0,0,0]"].map(String::from);
    let loaded = LoadedScene::load(Path::new("grasp"), &free).unwrap();
    let body = build(&loaded);
    let start = loaded.scene.settled(&body, &mut |_, _, _| ());
    for (name, closed) in [("forceps, open around a block", 0.0), ("forceps that hold it", 1.0)] {
        let simulation = Simulation::new(body.clone(), loaded.scene.settings(), start.clone()).unwrap();
        take_contact(&mut group, name, simulation, 1500, |tick| {
            let [down, shut] = [0.0, 500.0].map(|from| ((f64::from(tick) - from) / 400.0).clamp(0.0, 1.0));
            (Vec3::new(0.02, 0.02, 0.024 + 0.05 * (1.0 - down)), 1.0 - closed * shut)
        });
    }
    // The liver, held at its ends, lies on the kidney; and three organs of few nodes, many of whose patches are near each other.
    let lying = [
        "organ.0.position=[0.04, 0.0, 0.004]",
        "hold=[{min=[0.0, 0.0, 0.0], max=[0.12, 1.0, 1.0], relative=true}, {min=[0.85, 0.0, 0.0], max=[1.0, 1.0, 1.0], relative=true}]",
    ];
    meet(&mut group, "a liver on a kidney", "organs", &lying);
    meet(&mut group, "three organs of keyhole surgery", "laparoscopy", &[]);
    group.finish();
}

/// What finding and solving the contacts takes of the organs of a scene, where they lie.
fn meet(group: &mut BenchmarkGroup<WallTime>, name: &str, scene: &str, keys: &[&str]) {
    let keys: Vec<String> = keys.iter().map(|key| key.to_string()).collect();
    let loaded = LoadedScene::load(Path::new(scene), &keys).unwrap();
    let body = build(&loaded);
    let start = loaded.scene.settled(&body, &mut |_, _, _| ());
    let mut simulation = Simulation::new(body.clone(), loaded.scene.settings(), start).unwrap();
    (0..100).for_each(|_| _ = simulation.advance(&Inputs::default()));
    let held = simulation.meetings().iter().filter(|m| m.held).count();
    let name = format!("{name}, {held} of {} patches", simulation.meetings().len());
    group.bench_function(name, |b| {
        b.iter_custom(|times| {
            let mut laps = OfContact { since: Instant::now(), sum: Duration::ZERO };
            for _ in 0..times {
                laps.since = Instant::now();
                simulation.advance_with(&Inputs::default(), &mut laps);
            }
            laps.sum
        });
    });
}

/// What finding contacts and solving them takes after so many `ticks` of a tool that goes where `way` says, its jaws as open as that
/// says.
fn take_contact(
    group: &mut BenchmarkGroup<WallTime>,
    name: &str,
    mut simulation: Simulation,
    ticks: u32,
    way: impl Fn(u32) -> (Vec3, f64),
) {
    let mut inputs = Inputs::default();
    inputs.tools[0] = Some(ToolEvent::Attach { epoch: 1, period_ticks: 1, coupling: Coupling::RIGID });
    simulation.advance(&inputs);
    let mut sequence = 0;
    let mut press = |laps: &mut OfContact| {
        sequence += 1;
        let (position, opening) = way(sequence);
        let pose = Pose { position, ..Pose::default() };
        inputs.tools[0] = Some(ToolEvent::Pose(PoseSample { sequence, time_ns: 0, pose, buttons: 0, opening }));
        laps.since = Instant::now();
        simulation.advance_with(&inputs, laps).tools[0].contact_points
    };
    let mut laps = OfContact { since: Instant::now(), sum: Duration::ZERO };
    let points = (0..ticks).map(|_| press(&mut laps)).last();
    group.bench_function(format!("{name}, {} points", points.unwrap_or_default()), |b| {
        b.iter_custom(|times| {
            laps.sum = Duration::ZERO;
            (0..times).for_each(|_| {
                press(&mut laps);
            });
            laps.sum
        });
    });
}

/// The same press on a body without and with a level ten times as large as its finest, which is not used.
fn unused_level(c: &mut Criterion) {
    let mut group = c.benchmark_group("unused level");
    for (name, spacings) in [("without", "0.026, 0.015, 0.0085"), ("with", "0.026, 0.015, 0.0085, 0.0039")] {
        let spacings = format!("body.spacings=[{spacings}]");
        let loaded = load(&["world.gravity=[0,0,0]", "resolution.finest_level=2", &spacings]);
        let body = build(&loaded);
        let mut simulation =
            Simulation::new(body.clone(), loaded.scene.settings(), loaded.scene.at_rest(&body)).unwrap();
        let top = body.surface().vertices.iter().copied().max_by(|a, b| a.z.total_cmp(&b.z)).unwrap();
        let radius = loaded.scene.tool[0].radius;
        let mut inputs = Inputs::default();
        inputs.tools[0] = Some(ToolEvent::Attach { epoch: 1, period_ticks: 1, coupling: Coupling::RIGID });
        simulation.advance(&inputs);
        let mut sequence = 0;
        let mut press = || {
            sequence += 1;
            let height = 0.01 - 6e-5 * f64::from(sequence.min(300));
            inputs.tools[0] = pose(sequence, top + Vec3::new(0.0, 0.0, radius + height));
            simulation.advance(&inputs).elements
        };
        (0..1000).for_each(|_| {
            press();
        });
        println!("{name}: {} of {} elements in use", press(), body.element_count());
        group.bench_function(name, |b| b.iter(&mut press));
    }
    group.finish();
}

/// A family in the middle of the body is split and merged again.
fn change_of_resolution(c: &mut Criterion) {
    let body = build(&load(&[]));
    let mut mesh = ActiveMesh::new(&body, &State::at_rest(&body, 0), usize::MAX).unwrap();
    let centre = body.centre_of_mass();
    let away = |n: &Node| (body.rest(*n) - centre).norm_squared();
    let middle = body.nodes_of(0).min_by(|a, b| away(a).total_cmp(&away(b))).unwrap();
    assert_eq!(mesh.set().first_needed(&body, middle), None);
    let changed = mesh.apply(&body, &[Change::Split(middle)]);
    assert!(mesh.set().may_merge(&body, middle));
    mesh.apply(&body, &[Change::Merge(middle)]);
    println!("split: {} children, {changed:?}", body.children(middle).len());
    c.bench_function("whether a split turns elements inside out", |b| {
        b.iter(|| mesh.turns_inside_out(&body, Change::Split(middle)));
    });
    c.bench_function("split and merge of a family", |b| {
        b.iter(|| {
            mesh.apply(&body, &[Change::Split(middle)]);
            mesh.apply(&body, &[Change::Merge(middle)])
        });
    });
}

criterion_group!(benches, element_kernel, ticks, contact, unused_level, change_of_resolution);
criterion_main!(benches);
