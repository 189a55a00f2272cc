use palpate::model::active_set::*;
use palpate::model::*;
use palpate::scene::LoadedScene;
use std::time::Instant;
fn main() {
    let loaded = LoadedScene::load(std::path::Path::new("liver"), &[]).unwrap();
    let body = loaded.build(&mut |_, _, _| {}).unwrap();
    let state = State::at_rest(&body, 0);
    let mut mesh = ActiveMesh::new(&body, &state, 60000).unwrap();
    // refine around a point to get a typical patch
    let top = body.surface().vertices.iter().copied().max_by(|a, b| a.z.total_cmp(&b.z)).unwrap();
    for (r, rad) in [(0usize, 0.06), (1, 0.04), (2, 0.025)] {
        loop {
            let cand = body.nodes_of(r).find(|n| mesh.set().is_active(*n) && (body.rest(*n) - top).norm() < rad);
            let Some(mut n) = cand else { break };
            while let Some(b) = mesh.set().first_needed(&body, n) { n = b; }
            mesh.apply(&body, &[Change::Split(n)]);
        }
    }
    println!("{:?} elements {} interface {}", mesh.set().count(), mesh.pool().len(), mesh.interface().len());
    for level in 0..3 {
        let Some(n) = body.nodes_of(level).find(|n| mesh.set().is_active(*n) && mesh.set().first_needed(&body, *n).is_none() && (body.rest(*n) - top).norm() < 0.1) else { continue };
        let t0 = Instant::now();
        let (mut el, mut rows) = (0, 0);
        let k = 6000;
        for _ in 0..k {
            let a = mesh.apply(&body, &[Change::Split(n)]);
            let b = mesh.apply(&body, &[Change::Merge(n)]);
            el = a.elements + b.elements; rows = a.rows + b.rows;
        }
        let us = t0.elapsed().as_secs_f64() * 1e6 / k as f64 / 2.0;
        println!("level {level}: {us:.1} µs per change, elements {} rows {} children {}", el / 2, rows / 2, body.children(n).len());
        let t0 = Instant::now();
        for _ in 0..k { std::hint::black_box(mesh.set().first_needed(&body, n)); }
        println!("   first_needed {:.2} µs", t0.elapsed().as_secs_f64() * 1e6 / k as f64);
    }
    let mut skin = vec![palpate::math::Vec3::zeros(); body.surface().vertices.len()];
    let t0 = Instant::now();
    for _ in 0..200 { mesh.skin(&mut skin); }
    println!("skin {:.1} µs for {}", t0.elapsed().as_secs_f64() * 1e6 / 200.0, skin.len());
}
