use palpate::math::*;
use palpate::model::energy::energy;
use palpate::scene::LoadedScene;
use palpate::simulation::*;
use palpate::contact::tool::*;
use std::sync::Arc;
fn main() {
    let args: Vec<String> = std::env::args().skip(1).collect();
    let scene = &args[0];
    let sets: Vec<String> = args[1..].to_vec();
    let loaded = LoadedScene::load(std::path::Path::new(scene), &sets).unwrap();
    let body = Arc::new(loaded.build(&mut |_, _, _| {}).unwrap());
    for (r, l) in body.levels().iter().enumerate() {
        println!("level {r}: {} nodes {} elements class {:?} factor {}", l.mesh.nodes.len(), l.mesh.elements.len(), palpate::adaptation::class_at_rest(&body, r), l.stiffness_factor);
    }
    let t0 = std::time::Instant::now();
    let start = loaded.scene.settled(&body, &mut |_, _, _| {});
    println!("settled in {:?}: {} active, {} interface, {} elements", t0.elapsed(), start.body.nodes.len(), start.body.interface.len(), start.body.history.len());
    let mut sim = Simulation::new(body.clone(), loaded.scene.settings(), start).unwrap();
    let top = sim.body().surface().vertices.iter().copied().max_by(|a, b| a.z.total_cmp(&b.z)).unwrap();
    let radius = loaded.scene.tool[0].radius;
    let mut inputs = Inputs::default();
    inputs.budget = std::env::var("BUDGET").ok().and_then(|b| b.parse().ok()).unwrap_or(u32::MAX);
    let full = inputs;
    inputs.tools[0] = Some(ToolEvent::Attach { epoch: 1, period_ticks: 1 });
    sim.advance(&inputs);
    let mut worst = 0.0f64;
    let mut last = Vec3::zeros();
    for i in 0..3000u32 {
        let t = f64::from(i) * 1e-3;
        let depth = if t < 0.5 { -0.02 + t * 0.06 } else if t < 2.0 { 0.01 } else { 0.01 - (t - 2.0) * 0.1 };
        let slide = ((t - 1.0).max(0.0) * 0.03).min(0.03);
        let p = top + Vec3::new(slide, 0.0, radius - depth);
        let mut inputs = full;
        inputs.tools[0] = Some(ToolEvent::Pose(PoseSample { sequence: i + 1, time_ns: 0, pose: Pose { position: p, ..Pose::default() }, linear_velocity: Vec3::zeros(), angular_velocity: Vec3::zeros(), buttons: 0 }));
        let t0 = std::time::Instant::now();
        let o = sim.advance(&inputs);
        let dt = t0.elapsed().as_secs_f64();
        worst = worst.max(dt);
        let f = o.tools[0].state.physical_force;
        if (f - last).norm() > 0.05 { println!("  tick {i}: force jump {:.4} at {:.3} splits {} merges {}", (f - last).norm(), f.norm(), o.adapted.splits, o.adapted.merges); }
        last = f;
        if i % 100 == 0 {
            let o = o.clone();
            println!("t {t:.2} F {:.4} pts {} active {:?} iface {} el {} evals {} work {:?} adapted {:?} {:.0} µs worst {:.0} det {:.2} restored {}", f.norm(), o.tools[0].contact_points, &o.active[..body.levels().len()], sim.mesh().interface().len(), o.elements, o.element_evaluations, o.plan, o.adapted, dt * 1e6, worst * 1e6, o.extremes.det_f, o.restored);
            worst = 0.0;
        }
    }
    let e = energy(&body, sim.mesh(), sim.settings().gravity);
    println!("{e:?}");
}
