use palpate::math::*;
use palpate::model::active_set::*;
use palpate::model::energy::energy;
use palpate::model::*;
use palpate::prepare::*;
use palpate::simulation::*;
use palpate::geometry::primitives::box_surface;
use palpate::contact::safety::ForceLimits;
use palpate::contact::tool::Following;
use std::sync::Arc;

fn rng(seed: &mut u64) -> f64 {
    *seed = seed.wrapping_add(0x9E37_79B9_7F4A_7C15);
    let mut z = *seed;
    z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
    ((z ^ (z >> 31)) >> 11) as f64 / (1u64 << 53) as f64
}
fn random_set(body: &Body, seed: u64) -> Vec<u32> {
    let mut s = seed;
    let mut set = ActiveSet::uniform(body, 0);
    let clusters = 1 + (rng(&mut s) * 3.0) as usize;
    let (lo, hi) = body.surface().bounds();
    for _ in 0..clusters {
        let c = Vec3::new(rng(&mut s), rng(&mut s), rng(&mut s)).component_mul(&(hi - lo)) + lo;
        let radius = (0.1 + 0.4 * rng(&mut s)) * (hi - lo).norm() / 1.7;
        for r in 0..body.finest() {
            let rr = radius * 0.6f64.powi(r as i32);
            for n in body.nodes_of(r) {
                if (body.rest(n) - c).norm() < rr {
                    while set.is_active(n) {
                        let mut m = n;
                        while let Some(b) = set.first_needed(body, m) { m = b; }
                        set.apply(body, Change::Split(m));
                    }
                }
            }
        }
    }
    (0..body.node_count() as u32).filter(|n| set.is_active(*n)).collect()
}
fn main() {
    let args: Vec<f64> = std::env::args().skip(1).map(|a| a.parse().unwrap()).collect();
    let (seeds, seconds, clamped, amp) = (args[0] as u64, args[1], args[2] > 0.0, args[3]);
    let side = 0.1;
    let clamp = Region { bounds: (Vec3::zeros(), Vec3::new(0.0, side, side)), stiffness: None, exact: false };
    let recipe = Recipe {
        name: "cube".into(),
        shape: Shape::Closed(box_surface(Vec3::repeat(side), [12; 3]), vec![0.034, 0.021, 0.013]),
        material: Material::from_young(args.get(4).copied().unwrap_or(1e4), 0.35, 1000.0),
        holds: if clamped { vec![clamp] } else { vec![] },
        damping_ratio: 0.0,
    };
    let body = Arc::new(prepare(&recipe, &mut |_, _, _| {}).unwrap());
    for l in body.levels() { println!("{} nodes {} elements", l.mesh.nodes.len(), l.mesh.elements.len()); }
    let settings = Settings { gravity: Vec3::zeros(), tools: vec![], following: Following { speed: 1.0, engage_ticks: 1 }, limits: ForceLimits { force: 1.0, torque: 1.0, slew: 1.0 }, adaptivity: None, most_elements: 1_000_000 };
    for seed in 0..seeds {
        let nodes: Vec<u32> = match std::env::var("LEVEL") { Ok(l) => body.nodes_of(l.parse().unwrap()).collect(), _ => random_set(&body, seed) };
        let state = State::at_rest_on(&body, nodes).unwrap();
        let mut sim = Simulation::new(body.clone(), settings.clone(), Snapshot::with_state(state, 0)).unwrap();
        // squeeze + swing + spin
        let c = body.centre_of_mass();
        sim.mesh_mut().change_motion(|n, x, v| {
            let u = body.rest(n);
            let d = u - c;
            *v = if clamped { Vec3::new(0.0, 0.3, 0.1) * (u.x / side) * amp } else { Vec3::new(0.1, 0.0, 0.05) + Vec3::new(1.2, -0.8, 1.4).cross(&d) + Vec3::new(d.x, -d.y, 0.0) * 6.0 * amp };
            let _ = x;
        });
        let e0 = energy(&body, sim.mesh(), Vec3::zeros());
        let m0 = sim.mesh().momenta();
        let mut worst = 0.0f64; let mut exch = 0.0f64; let mut when = 0.0;
        let ticks = (seconds * 1000.0) as u32;
        for i in 0..ticks {
            let o = sim.advance(&Inputs::default());
            if o.restored { println!("  restored at {i}"); worst = f64::NAN; break; }
            if i % 32 == 31 {
                let e = energy(&body, sim.mesh(), Vec3::zeros());
                exch = exch.max(e.elastic);
                let d = (e.total() - e0.total()).abs();
                if d > worst { worst = d; when = i as f64 * 1e-3; } if std::env::var("TRACE").is_ok() && i % std::env::var("TRACE").unwrap().parse::<u32>().unwrap() == 31 { println!("   {i} {:.4e} kin {:.4e} el {:.4e}", (e.total() - e0.total()) / exch, e.kinetic, e.elastic); }
            }
        }
        let m = sim.mesh().momenta();
        let classes: Vec<usize> = (0..8).map(|c| sim.mesh().pool().count(c)).collect();
        println!("set {seed} {:?} iface {} el {} |dE|/exchanged {:.2e} at {when} exch {exch:.2e} dP {:.1e} dL {:.1e} classes {:?}", sim.mesh().set().count(), sim.mesh().interface().len(), sim.mesh().pool().len(), worst / exch, (m.linear - m0.linear).norm(), (m.angular - m0.angular).norm(), &classes);
    }
}
