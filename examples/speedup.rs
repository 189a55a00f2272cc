use palpate::adaptation::Adaptivity;
use palpate::contact::safety::ForceLimits;
use palpate::contact::tool::*;
use palpate::geometry::primitives::box_surface;
use palpate::math::*;
use palpate::model::*;
use palpate::prepare::*;
use palpate::simulation::*;
use std::sync::Arc;
fn path(body: &Body, liver: bool, i: u32) -> Vec3 {
    let t = f64::from(i) * 1e-3;
    let side = 0.1;
    if !liver {
        let depth = if t < 0.15 { -0.005 + t / 0.15 * 0.010 } else { 0.005 };
        let x = 0.025 + ((t - 0.2).max(0.0) * 0.1).min(0.05);
        return Vec3::new(x, 0.05, side + 0.01 - depth);
    }
    let depth = if t < 0.15 { -0.005 + t / 0.15 * 0.015 } else { 0.010 };
    let top = body.surface().vertices.iter().copied().max_by(|a, b| a.z.total_cmp(&b.z)).unwrap();
    let x = top.x - 0.025 + ((t - 0.2).max(0.0) * 0.1).min(0.05);
    // height of the rest surface under the tool's centre line: highest triangle point, smoothed by the ball
    let mut z = f64::NEG_INFINITY;
    for v in &body.surface().vertices {
        let d2 = (v.x - x).powi(2) + (v.y - top.y).powi(2);
        if d2 < 0.01 * 0.01 { z = z.max(v.z + (0.01f64 * 0.01 - d2).sqrt()); }
    }
    Vec3::new(x, top.y, z - depth)
}
fn run(body: &Arc<Body>, adaptivity: Option<Adaptivity>, level: usize, budget: u32, liver: bool) -> (Vec<f64>, f64, f64, f64, f64) {
    let tool = Tool { name: "ball".into(), shape: palpate::contact::tool::Shape { radius: 0.01, length: 0.0 } };
    let settings = Settings { gravity: Vec3::zeros(), tools: vec![tool], following: Following { speed: 1.0, engage_ticks: 1 }, limits: ForceLimits { force: 100.0, torque: 10.0, slew: 1e6 }, adaptivity, most_elements: 4_000_000 };
    let mut sim = Simulation::new(body.clone(), settings, Snapshot::at_rest(body, level, 1)).unwrap();
    let mut force = vec![];
    let (mut evals, mut worst, mut el) = (0.0, 0.0f64, 0.0);
    let mut inputs = Inputs::default();
    inputs.tools[0] = Some(ToolEvent::Attach { epoch: 1, period_ticks: 1 });
    sim.advance(&inputs);
    let t0 = std::time::Instant::now();
    for i in 0..750u32 {
        let p = path(body, liver, i);
        let mut inputs = Inputs { budget, ..Inputs::default() };
        inputs.tools[0] = Some(ToolEvent::Pose(PoseSample { sequence: i + 1, time_ns: 0, pose: Pose { position: p, ..Pose::default() }, linear_velocity: Vec3::zeros(), angular_velocity: Vec3::zeros(), buttons: 0 }));
        let o = sim.advance(&inputs);
        if o.restored { println!("RESTORED at {i}"); }
        force.push(o.tools[0].state.physical_force.norm());
        evals += f64::from(o.element_evaluations);
        worst = worst.max(f64::from(o.element_evaluations));
        el += f64::from(o.elements);
    }
    (force, evals / 750.0, worst, el / 750.0, t0.elapsed().as_secs_f64())
}
fn main() {
    let which: usize = std::env::args().nth(1).unwrap().parse().unwrap();
    let side = 0.1;
    let levels = [vec![0.032, 0.018, 0.010], vec![0.030, 0.016, 0.0086, 0.00464], vec![0.032, 0.018, 0.010, 0.0052, 0.00271]][which.min(2)].clone();
    let clamp = Region { bounds: (Vec3::zeros(), Vec3::new(side, side, 0.0)), stiffness: None, exact: false };
    let recipe = Recipe {
        name: "cube".into(),
        shape: palpate::prepare::Shape::Closed(box_surface(Vec3::repeat(side), [30; 3]), levels),
        material: Material::from_young(1e4, 0.35, 1000.0),
        holds: vec![clamp],
        damping_ratio: 0.15,
    };
    let body = if which < 3 { Arc::new(prepare(&recipe, &mut |_, _, _| {}).unwrap()) } else {
        let spacings = if which == 3 { "body.spacings=[0.024,0.012,0.006]" } else { "body.spacings=[0.026,0.014,0.0075,0.004]" };
        let loaded = palpate::scene::LoadedScene::load(std::path::Path::new("/tmp/human.toml"), &[spacings.into()]).unwrap();
        Arc::new(loaded.build(&mut |_, _, _| {}).unwrap())
    };
    for (r, l) in body.levels().iter().enumerate() { println!("{} nodes {} elements factor {:.3} class {:?}", l.mesh.nodes.len(), l.mesh.elements.len(), l.stiffness_factor, palpate::adaptation::class_at_rest(&body, r)); }
    println!("{:?}", body.maxwell());
    let t0 = std::time::Instant::now();
    let (reference, evals, worst, el, wall) = run(&body, None, body.finest(), u32::MAX, which >= 3);
    println!("uniform {:?}", reference[150..180].iter().map(|f| (f * 1e3).round() / 1e3).collect::<Vec<_>>());
    let peak = reference.iter().copied().fold(0.0, f64::max);
    println!("uniform finest: {evals:.0} evals/tick, worst {worst:.0} el {el:.0} wall {wall:.2} s peak {peak:.4} N   ({:?})", t0.elapsed());
    for level in 0..0 {
        let (f, e, _, _, w) = run(&body, None, level, u32::MAX, which >= 3);
        let rms = (f.iter().zip(&reference).map(|(a, b)| (a - b) * (a - b)).sum::<f64>() / f.len() as f64).sqrt() / peak;
        println!("uniform level {level}: err {:.2} % evals ratio {:.1} wall ratio {:.1}", 100.0 * rms, evals / e, wall / w);
    }
    for (split, reach) in [(0.1, 0.7), (0.1, 2.0)] {
        let a = Adaptivity { split, merge: 0.3, reach, finest: usize::MAX };
        let (f, e, worst_a, el, w) = run(&body, Some(a), 0, u32::MAX, which >= 3);
        let rms = (f.iter().zip(&reference).map(|(a, b)| (a - b) * (a - b)).sum::<f64>() / f.len() as f64).sqrt() / peak;
        println!("   {:?}", f[150..180].iter().map(|f| (f * 1e3).round() / 1e3).collect::<Vec<_>>());
        let jump = |f: &[f64]| f.windows(2).map(|w| (w[1] - w[0]).abs()).fold(0.0, f64::max);
        println!("   max jump in stroke: uniform {:.4} adaptive {:.4}", jump(&reference[200..]), jump(&f[200..]));
        let mean = (f[300..].iter().sum::<f64>() / reference[300..].iter().sum::<f64>() - 1.0) * 100.0;
        println!("split {split} reach {reach}: err {:.2} % (mean {mean:+.2}) evals ratio {:.1} (global-step worst ratio {:.1}) el {el:.0} evals {e:.0} worst {worst_a:.0} wall ratio {:.1}", 100.0 * rms, evals / e, worst / e, wall / w);
    }
}
