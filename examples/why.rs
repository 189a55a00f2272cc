use palpate::recording::replay::Recording;
use palpate::simulation::*;
fn main() {
    let r = Recording::read(std::path::Path::new(&std::env::args().nth(1).unwrap())).unwrap();
    let mut sim = Simulation::new(r.body.clone(), r.scene.settings(), r.start.clone()).unwrap();
    let mut stat: [Vec<(f64, u32, u32, u32)>; 4] = Default::default();
    let mut last = 0.0;
    let mut log: Vec<String> = vec![];
    for (tick, inputs) in &r.inputs {
        let t0 = std::time::Instant::now();
        let o = sim.advance(inputs).clone();
        let us = t0.elapsed().as_secs_f64() * 1e6;
        let key = if o.plan.taken < o.plan.needed { 3 } else if o.adapted.work > 0 { 2 } else if o.tools[0].contact_points > 0 { 1 } else { 0 };
        stat[key].push((us, o.plan.taken, o.adapted.work, o.adapted.splits + o.adapted.merges));
        let t = &o.tools[0];
        let f = t.state.physical_force.norm();
        let line = format!("{tick} F {f:.4} render {:.4} pts {} plan {:?} adapted {:?} active {:?} lapsed {} budget {} det {:.2} pos {:?}", t.state.force.norm(), t.contact_points, o.plan, o.adapted, &o.active[..4], inputs.lapsed, inputs.budget, o.extremes.det_f, t.state.pose.position.as_slice());
        log.push(line);
        if (f - last).abs() > 0.06 {
            println!("---- jump {:.3}", f - last);
            for l in log.iter().rev().take(4).rev() { println!("{l}"); }
        }
        last = f;
        let from: u64 = std::env::var("FROM").ok().and_then(|x| x.parse().ok()).unwrap_or(u64::MAX);
        if *tick >= from && *tick < from + 8 {
            println!("{}", log.last().unwrap());
            let m = sim.mesh();
            let b = sim.body();
            let mut list: Vec<(f64, u32)> = (0..b.element_count() as u32).filter(|e| m.active_vertices(*e) > 0).map(|e| (m.pool().history(e).unwrap().det, e)).collect();
            list.sort_by(|a, b| a.0.total_cmp(&b.0));
            for (det, e) in list.iter().take(6) {
                let slots = b.element(*e).map(|n| m.slot(n).unwrap());
                let mass = slots.map(|s| (m.motion.mass[s as usize] * 1e6).round());
                let v = slots.map(|s| { let v = m.motion.velocity[s as usize]; ((v[0] * v[0] + v[1] * v[1] + v[2] * v[2]).sqrt() * 1e3).round() });
                println!("    e {e} level {} active {} class {:?} det {det:.3} frac {:.2} mass mg {:?} v mm/s {:?} hold {:?}", b.level_of_element(*e), m.active_vertices(*e), m.pool().class_of(*e), b.level(b.level_of_element(*e)).fraction[(*e - b.elements_of(b.level_of_element(*e)).start) as usize], mass, v, slots.map(|s| m.row(s).amplification()));
            }
        }
    }
    for (k, v) in stat.iter_mut().enumerate() {
        v.sort_by(|a, b| a.0.total_cmp(&b.0));
        let n = v.len().max(1) as f64;
        let mean = |f: &dyn Fn(&(f64, u32, u32, u32)) -> f64| v.iter().map(f).sum::<f64>() / n;
        println!("kind {k}: {} ticks, µs mean {:.0} p50 {:.0} p99 {:.0}, taken {:.0} adapt {:.0} changes {:.2}", v.len(), mean(&|x| x.0), v.get(v.len() / 2).map_or(0.0, |x| x.0), v.get(v.len() * 99 / 100).map_or(0.0, |x| x.0), mean(&|x| f64::from(x.1)), mean(&|x| f64::from(x.2)), mean(&|x| f64::from(x.3)));
    }
}
