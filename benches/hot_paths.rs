//! What a tick is made of, each part by itself, on the bundled liver: `cargo bench`.
//!
//! Absolute times are this machine's; a claim about speed is a ratio of two rows of one run.

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use palpate::contact::tool::{PoseSample, ToolEvent};
use palpate::math::{Pose, Vec3};
use palpate::model::element_kernel::{Path as KernelPath, add_forces};
use palpate::model::skin;
use palpate::scene::LoadedScene;
use palpate::simulation::{Inputs, Simulation, Snapshot};
use palpate::wire;
use palpate_proto::Message;
use std::hint::black_box;
use std::path::Path;
use std::sync::Arc;

fn pose(sequence: u32, position: Vec3) -> Option<ToolEvent> {
    let zero = Vec3::zeros();
    let pose = Pose { position, ..Pose::default() };
    let sample = PoseSample { sequence, time_ns: 0, pose, linear_velocity: zero, angular_velocity: zero, buttons: 0 };
    Some(ToolEvent::Pose(sample))
}

fn hot_paths(c: &mut Criterion) {
    let loaded = LoadedScene::load(Path::new("liver"), &["world.gravity=[0,0,0]".into()]).unwrap();
    let body = Arc::new(loaded.build(&mut |_, _, _| {}).unwrap());
    let level = body.level();
    let elements = level.mesh.elements.len() as u64;
    let position = level.mesh.nodes.clone();
    let velocity = vec![Vec3::zeros(); position.len()];

    let mut kernel = c.benchmark_group("element kernel");
    kernel.throughput(Throughput::Elements(elements));
    for path in KernelPath::available() {
        let mut force = vec![[0.0; 4]; position.len()];
        kernel.bench_function(format!("{path:?}"), |b| {
            b.iter(|| add_forces(path, body.elements(), black_box(&position), &velocity, &mut force));
        });
    }
    kernel.finish();

    let simulation = || {
        let start = Snapshot::at_rest(&body, loaded.scene.tool.len());
        Simulation::new(body.clone(), loaded.scene.settings(), start).unwrap()
    };
    let top = body.surface().vertices.iter().copied().max_by(|a, b| a.z.total_cmp(&b.z)).unwrap();
    let radius = loaded.scene.tool[0].radius;
    let mut tick = c.benchmark_group("tick");
    let mut free = simulation();
    tick.bench_function("untouched", |b| b.iter(|| free.advance(&Inputs::default()).tick));
    let mut touched = simulation();
    let mut inputs = Inputs::default();
    inputs.tools[0] = Some(ToolEvent::Attach { epoch: 1, period_ticks: 1 });
    touched.advance(&inputs);
    let mut sequence = 0;
    let mut press = |simulation: &mut Simulation, height: f64| {
        sequence += 1;
        let mut inputs = Inputs::default();
        inputs.tools[0] = pose(sequence, top + Vec3::new(0.0, 0.0, radius + height));
        simulation.advance(&inputs).tools[0].contact_points
    };
    (0..300).for_each(|i| {
        press(&mut touched, 0.01 - 6e-5 * f64::from(i));
    });
    assert!(press(&mut touched, -0.008) > 0, "the bench touches");
    tick.bench_function("pressed", |b| b.iter(|| press(&mut touched, -0.008)));
    let mut lapsing = simulation();
    let none = Inputs { budget: 0, ..Inputs::default() };
    tick.bench_function("without budget", |b| b.iter(|| lapsing.advance(&none).tick));
    tick.finish();

    let mut frame = c.benchmark_group("frame");
    let mut vertices = vec![Vec3::zeros(); body.surface().vertices.len()];
    frame.bench_function("skin", |b| b.iter(|| skin::skin(level, black_box(&position), &mut vertices)));
    frame.bench_function("state hash", |b| b.iter(|| touched.snapshot().hash()));
    let outputs = touched.advance(&Inputs::default()).clone();
    let tools: Vec<_> = outputs.tools.iter().map(|t| t.state).collect();
    frame.bench_function("encode surface", |b| {
        b.iter(|| wire::surface_frame(1, 1, black_box(&outputs.skin), &tools).encode_to_vec());
    });
    frame.bench_function("encode wrench", |b| {
        b.iter(|| wire::wrench(0, 1, 1, black_box(&outputs.tools[0]), outputs.flags()).encode_to_vec());
    });
    frame.finish();
}

criterion_group!(benches, hot_paths);
criterion_main!(benches);
