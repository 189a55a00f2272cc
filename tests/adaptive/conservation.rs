//! One energy for the whole body: without damping it stays, and a free body keeps its momenta, whatever is active.

use super::*;
use palpate_core::model::energy::energy;

/// What an undamped run kept.
pub(super) struct Kept {
    /// Largest change of the total energy over the largest that was exchanged.
    pub(super) energy: Real,
    pub(super) linear: Real,
    pub(super) angular: Real,
    pub(super) elements: usize,
}

/// `seconds` of the cube with the set `nodes`, from rest shape and a smooth motion.
///
/// The body is so soft that the fastest modes turn by a fraction of a radian in a tick: what is left of the step's own
/// error (proportional to its square, and bounded) is then below what is asked.
pub(super) fn run(body: &Arc<Body>, nodes: Vec<Node>, held: bool, seconds: Real) -> Kept {
    let mut free = simulation(body, &settings(None), nodes);
    let centre = body.centre_of_mass();
    free.mesh_mut().change_motion(|n, _, v| {
        let d = body.rest(n) - centre;
        *v = if held {
            Vec3::new(0.0, 0.12, 0.04) * (body.rest(n).x / SIDE)
        } else {
            Vec3::new(0.1, 0.0, 0.05) + Vec3::new(0.6, -0.4, 0.7).cross(&d) + Vec3::new(d.x, -d.y, 0.0)
        };
    });
    let before = energy(body, free.mesh(), Vec3::zeros());
    // What the momenta are relative to: all of the motion, in whatever direction.
    let scale = (2.0 * before.kinetic * body.mass()).sqrt();
    let (mut drift, mut exchanged, mut linear, mut angular) = (0.0 as Real, 0.0 as Real, 0.0 as Real, 0.0 as Real);
    for i in 0..(seconds / TICK) as u32 {
        assert!(!free.advance(&Inputs::default()).restored, "tick {i}");
        if i % 16 == 15 {
            let now = energy(body, free.mesh(), Vec3::zeros());
            exchanged = exchanged.max(now.elastic);
            drift = drift.max((now.total() - before.total()).abs());
            linear = linear.max((now.linear_momentum - before.linear_momentum).norm() / scale);
            angular = angular.max((now.angular_momentum - before.angular_momentum).norm() / (scale * SIDE));
        }
    }
    Kept { energy: drift / exchanged, linear, angular, elements: free.mesh().pool().len() }
}

fn random_sets(held: bool, most: Real) {
    let body = elastic_cube(2e3, held).body();
    report(&body);
    let (mut worst, mut mean) = (Kept { energy: 0.0, linear: 0.0, angular: 0.0, elements: 0 }, 0.0);
    let sets = cases(10, 30);
    for seed in 0..sets {
        let nodes = random_set(&body, &mut Random(seed));
        let active = nodes.len();
        let kept = run(&body, nodes, held, 20.0);
        println!(
            "set {seed}, {active} active nodes, {} elements: energy {:.1e}, momenta {:.1e} {:.1e}",
            kept.elements, kept.energy, kept.linear, kept.angular
        );
        assert!(kept.elements > body.elements_of(0).len() / 2);
        mean += kept.energy / sets as Real;
        worst.energy = worst.energy.max(kept.energy);
        worst.linear = worst.linear.max(kept.linear);
        worst.angular = worst.angular.max(kept.angular);
    }
    println!(
        "held {held}: energy within {:.2e} of what is exchanged (mean {mean:.2e}); momenta within {:.1e} and {:.1e}",
        worst.energy, worst.linear, worst.angular
    );
    assert!(worst.energy < most, "energy changed by {:.2e} of what is exchanged", worst.energy);
    if !held {
        // Some 1e4 roundings of 1e-16 a second, of random sign.
        assert!(worst.linear < 1e-11 && worst.angular < 1e-11, "{:.1e} {:.1e}", worst.linear, worst.angular);
    }
}

#[test]
fn random_sets_of_a_held_cube_keep_their_energy() {
    random_sets(true, 1e-3);
}

#[test]
fn random_sets_of_a_free_cube_keep_energy_and_momenta() {
    random_sets(false, 1e-3);
}

/// A free cube is pushed by a ball that leaves it; changes of resolution, and what they leave to fade, go on: no push, and no
/// turn. The ball leaves a body that moves, or one that stands still to shed load.
#[test]
fn what_changes_of_resolution_leave_to_fade_is_no_push() {
    let body = Cube { damping_ratio: 0.15, ..elastic_cube(2e3, false) }.body();
    let push = |i: u64| match i {
        0 => inputs(ATTACH),
        // Into its top by the side: it turns, too.
        _ => inputs(ball_at(Vec3::new(0.03, 0.05, SIDE + 0.012 - 0.016 * ease(i as Real * TICK, 0.0, 0.1)))),
    };
    let adaptivity = Adaptivity { split: 0.004, ..Adaptivity::default() };
    for budget in [u32::MAX, 140_000] {
        let mut free = simulation(&body, &settings(Some(adaptivity.clone())), uniform(&body, 0));
        (0..100).for_each(|i| {
            free.advance(&push(i));
        });
        let cut = |i: u64, of: Inputs| Inputs { budget: Budget::of(if i < 100 { u32::MAX } else { budget }), ..of };
        let mut tick = 100;
        let frozen = |of: &Simulation| of.outputs().plan.taken == 0;
        while !frozen(&free) && tick < if budget == u32::MAX { 110 } else { 200 } {
            free.advance(&cut(tick, push(tick)));
            tick += 1;
        }
        assert_eq!(frozen(&free), budget < u32::MAX, "the body sheds when the ball leaves it");
        free.advance(&cut(tick, inputs(ToolEvent::Detach)));
        let eases = |mesh: &ActiveMesh| -> Real { mesh.active().iter().map(|s| mesh.residual(*s).abs().sum()).sum() };
        let (before, held) = (energy(&body, free.mesh(), Vec3::zeros()), eases(free.mesh()));
        let (mut changes, mut linear, mut angular) = (0, 0.0 as Real, 0.0 as Real);
        let scale = (2.0 * before.kinetic * body.mass()).sqrt();
        for i in 0..600 {
            let o = free.advance(&cut(tick + i, Inputs::default()));
            changes += o.adapted.splits + o.adapted.merges;
            let now = energy(&body, free.mesh(), Vec3::zeros());
            linear = linear.max((now.linear_momentum - before.linear_momentum).norm() / scale);
            angular = angular.max((now.angular_momentum - before.angular_momentum).norm() / (scale * SIDE));
        }
        println!("{changes} changes, {held:.3} N held when it leaves; momenta {linear:.1e} {angular:.1e}");
        assert!(changes > 10 && held > 1e-3);
        assert!(linear < 1e-11 && angular < 1e-11, "{linear:.1e} {angular:.1e}");
    }
}
