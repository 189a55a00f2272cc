//! Two free bodies that tools push at each other, again and again, while their resolution changes.

use super::*;
use palpate_body::prepare::merge::merge;
use palpate_core::contact::meeting::Between;
use palpate_core::ids::OrganId;
use palpate_core::model::energy::energy;

/// Edges of both [m].
const EDGES: [Real; 2] = [0.06, 0.05];
/// Ticks from one push to the next.
const PUSH: u64 = 600;

fn two(spacings: Real) -> Arc<Body> {
    let block = |edge: Real, young: Real, position: Vec3| {
        let recipe = Recipe {
            name: "block".into(),
            shape: Shape::closed(
                box_surface(Vec3::repeat(edge), [8; 3]),
                [0.03, 0.02, 0.014].map(|a| a * spacings).to_vec(),
            ),
            material: Material::from_young(young, 0.4, 1000.0),
            inclusions: vec![],
            holds: vec![],
            elements: Default::default(),
            damping_ratio: 0.1,
        };
        (prepare(&recipe, &mut |_, _, _| {}).unwrap(), Pose { position, ..Pose::default() })
    };
    let [large, small] = EDGES;
    Arc::new(
        merge(vec![block(large, 1e4, Vec3::zeros()), block(small, 4e3, Vec3::new(0.007, 0.004, large + 0.003))], 0.1)
            .unwrap(),
    )
}

/// Mass-weighted means of the places and velocities of an organ [m, m/s].
fn centre(simulation: &Simulation, organ: u32) -> (Vec3, Vec3) {
    let (body, mesh) = (simulation.body(), simulation.mesh());
    let own = mesh.active().iter().filter(|s| body.organ_of(mesh.node(**s)) == OrganId(organ));
    let (mut mass, mut place, mut velocity) = (0.0, Vec3::zeros(), Vec3::zeros());
    for slot in own {
        let m = mesh.motion.mass[slot.index()];
        mass += m;
        place += mesh.position(*slot) * m;
        velocity += Vec3::from_row_slice(&mesh.motion.velocity[slot.index()][..3]) * m;
    }
    (place / mass, velocity / mass)
}

/// What one run kept, relative to what moves, and what it went through.
struct Ran {
    linear: Real,
    angular: Real,
    touched: u32,
    met_untouched: u32,
    changes: u32,
}

fn run(body: &Arc<Body>, friction: Real, seed: u64, budget: Budget) -> Ran {
    let ball =
        |name: &str, radius| Tool { name: name.into(), shape: ToolShape::ball(radius), friction: 0.3, pivot: None };
    let settings = Settings {
        tools: vec![ball("one", 0.01), ball("other", 0.008)],
        organ_friction: Between::all(friction),
        adaptivity: Some(Adaptivity { split: 0.05, ..Adaptivity::default() }),
        ..settings(None)
    };
    let mut pair = simulation(body, &settings, uniform(body, 0));
    let mut random = Random(seed);
    let mut start = Inputs::default();
    start.tools[..2].fill(Some(ATTACH));
    pair.advance(&start);
    let (mut aside, mut pushes, mut out) = ([Vec3::zeros(); 2], [true; 2], [0.1 as Real; 2]);
    let mut kept = energy(body, pair.mesh(), Vec3::zeros());
    let (mut linear, mut angular, mut scale) = (Vec3::zeros(), Vec3::zeros(), 0.0 as Real);
    let mut ran = Ran { linear: 0.0, angular: 0.0, touched: 0, met_untouched: 0, changes: 0 };
    for tick in 0..20_000u64 {
        let phase = tick % PUSH;
        if phase == 0 {
            aside = [0, 1].map(|_| random.vector(0.006));
            let who = random.below(3);
            pushes = [who != 1, who != 2];
        }
        let centres = [0, 1].map(|o| centre(&pair, o));
        let axis = (centres[1].0 - centres[0].0).normalize();
        let mut inputs = Inputs { budget, ..Inputs::default() };
        for (tool, outward) in [-axis, axis].into_iter().enumerate() {
            let away = centres[tool].1 - centres[1 - tool].1;
            // From behind, towards the other; what comes to it by itself is not struck, or both are faster each time.
            let comes = pushes[tool] && away.dot(&outward) > -0.05 && (50..450).contains(&phase);
            let way = if comes { -0.15e-3 } else { 0.5e-3 };
            out[tool] = (out[tool] + way).max(0.35 * EDGES[tool]).min(1.8 * EDGES[tool]);
            // On the side to which it goes.
            let ahead = (away - outward * away.dot(&outward)) * 0.1;
            inputs.tools[tool] = Some(ball_at(centres[tool].0 + outward * out[tool] + ahead + aside[tool]));
        }
        let touched = {
            let outputs = pair.advance(&inputs);
            assert!(!outputs.restored, "tick {tick}");
            ran.changes += outputs.adapted.splits + outputs.adapted.merges;
            outputs.tools.iter().any(|t| t.contact_points > 0)
        };
        let now = energy(body, pair.mesh(), Vec3::zeros());
        scale = scale.max((2.0 * now.kinetic * body.mass()).sqrt());
        if touched {
            ran.touched += 1;
        } else {
            linear += now.linear_momentum - kept.linear_momentum;
            angular += now.angular_momentum - kept.angular_momentum;
            ran.met_untouched += u32::from(pair.meetings().iter().any(|m| m.multiplier > 0.0));
            ran.linear = linear.norm().max(ran.linear);
            ran.angular = angular.norm().max(ran.angular);
        }
        kept = now;
    }
    (ran.linear, ran.angular) = (ran.linear / scale, ran.angular / (scale * EDGES[0]));
    ran
}

#[test]
fn bodies_that_are_pushed_at_each_other_keep_what_the_tools_gave_them_for_20_s() {
    for (spacings, friction, budget) in
        [(1.0, 0.0, Budget::UNLIMITED), (1.2, 0.5, Budget::UNLIMITED), (1.0, 0.3, Budget::of(1_200_000))]
    {
        let body = two(spacings);
        report(&body);
        for seed in 0..cases(1, 8) {
            let ran = run(&body, friction, seed, budget);
            println!(
                "friction {friction}, seed {seed}: momenta {:.1e} {:.1e}; {} ticks under a tool, {} in which only they meet, {} changes",
                ran.linear, ran.angular, ran.touched, ran.met_untouched, ran.changes
            );
            assert!(ran.touched > 500 && ran.met_untouched > 500 && ran.changes > 100);
            assert!(ran.linear < 1e-12 && ran.angular < 1e-12);
        }
    }
}
