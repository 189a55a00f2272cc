//! Damping by Maxwell branches: as much as was asked for on every level and across them, and none for rigid motion.

use super::*;
use palpate_core::model::energy::energy;
use palpate_core::stepping::work;
use std::f64::consts::PI;

const ASKED: Real = 0.15;

fn damped() -> Cube {
    Cube { damping_ratio: ASKED, ..elastic_cube(1e4, true) }
}

/// Damping ratio of a signal that swings about zero, from the extremes between its zeros: the mean logarithmic
/// decrement over three half swings after the first, in which faster modes die away.
fn damping_ratio(signal: &[Real]) -> Real {
    let zeros = zeros(signal);
    assert!(zeros.len() >= 5, "{} zeros: no swing to be measured", zeros.len());
    let ticks: Vec<usize> = zeros.iter().map(|t| (t / TICK) as usize + 1).collect();
    let extreme = |k: usize| signal[ticks[k]..ticks[k + 1]].iter().fold(0.0 as Real, |most, x| most.max(x.abs()));
    let decrement = (extreme(0) / extreme(3)).ln() / 3.0;
    decrement / (PI * PI + decrement * decrement).sqrt()
}

#[test]
fn the_slowest_mode_is_damped_as_asked_on_every_level_and_across_levels() {
    let body = damped().body();
    report(&body);
    println!("{:?}", body.maxwell());
    let mut sets: Vec<(String, Vec<Node>)> =
        (0..body.levels().len()).map(|r| (format!("level {r}"), uniform(&body, r))).collect();
    sets.extend((0..4).map(|seed| (format!("set {seed}"), random_set(&body, &mut Random(seed)))));
    for axis in [Vec3::z(), Vec3::y()] {
        let mut ratios = vec![];
        for (name, nodes) in &sets {
            let sag = sagging(&body, nodes.clone(), axis * -1.0, 1500);
            let mut swing = with_settings(&sag, &settings(None));
            let signal: Vec<Real> = (0..1500)
                .map(|_| {
                    swing.advance(&Inputs::default());
                    mean_displacement(&body, swing.mesh()).dot(&axis)
                })
                .collect();
            let ratio = damping_ratio(&signal);
            println!("{name}: ζ = {ratio:.3}, first zeros {:.3?} s", &zeros(&signal)[..3]);
            assert!((0.1..0.2).contains(&ratio), "{name} is damped at {ratio}");
            ratios.push(ratio);
        }
        let finest = ratios[body.finest()];
        for (ratio, (name, _)) in ratios.iter().zip(&sets) {
            assert!((ratio / finest - 1.0).abs() < 0.05, "{name} is damped at {ratio}, the finest level at {finest}");
        }
    }
}

/// A body that flies and turns slowly is not braked: what its turning stretches it by is too little to matter.
#[test]
fn rigid_motion_is_not_damped() {
    let body = Cube { held: false, ..damped() }.body();
    let centre = body.centre_of_mass();
    let (flight, turn) = (Vec3::new(0.2, -0.1, 0.05), Vec3::new(0.3, 0.5, -0.4));
    let mut sets = vec![uniform(&body, 0), uniform(&body, 2)];
    sets.extend((0..3).map(|seed| random_set(&body, &mut Random(seed))));
    for nodes in sets {
        let mut fly = simulation(&body, &settings(None), nodes);
        fly.mesh_mut().change_motion(|n, _, v| *v = flight + turn.cross(&(body.rest(n) - centre)));
        let before = energy(&body, fly.mesh(), Vec3::zeros());
        let whole = 0.5 * body.mass() * flight.norm_squared();
        let turning = before.kinetic - whole;
        (0..10_000).for_each(|_| assert!(!fly.advance(&Inputs::default()).restored));
        let after = energy(&body, fly.mesh(), Vec3::zeros());
        let linear = (after.linear_momentum - before.linear_momentum).norm() / before.linear_momentum.norm();
        let angular = (after.angular_momentum - before.angular_momentum).norm() / before.angular_momentum.norm();
        let lost = (after.kinetic - before.kinetic) / turning;
        println!(
            "{} active: momenta {linear:.1e} {angular:.1e}; energy of turning {lost:+.1e}",
            fly.mesh().active().len()
        );
        assert!(linear < 1e-11 && angular < 1e-11);
        // The centrifugal strain is (ω/ω₁)² ~ 4e-4, and settles once; viscosity that knew the velocity would have
        // stopped the turning altogether.
        assert!(lost.abs() < 5e-3, "{lost}");
    }
}

/// Branches stiffen what acts at once; steps get shorter for it, but not by much.
#[test]
fn damping_costs_few_element_evaluations() {
    let viscous = {
        let mut cube = elastic_cube(1e4, true);
        cube.material.phi = cube.material.lambda * 1e-3;
        cube.material.psi = cube.material.mu * 1e-3;
        cube
    };
    let mut worst = 0.0 as Real;
    // Steps are powers of two: only over several stiffnesses is a factor on the step what it costs.
    for stiffer in [1.0, 1.4, 2.0, 2.8, 4.0, 5.6, 8.0, 11.0] {
        let stiff = |cube: &Cube| {
            let m = cube.material;
            let material = Material {
                lambda: m.lambda * stiffer,
                mu: m.mu * stiffer,
                phi: m.phi * stiffer,
                psi: m.psi * stiffer,
                ..m
            };
            Cube { material, ..cube.clone() }.body()
        };
        let (damped, viscous) = (stiff(&damped()), stiff(&viscous));
        let mut sets = vec![uniform(&damped, 1), uniform(&damped, 2)];
        sets.extend((0..3).map(|seed| random_set(&damped, &mut Random(seed))));
        let count = |body: &Body| -> Vec<u32> {
            sets.iter().map(|nodes| work::evaluations(&mesh_on(body, nodes.clone()))).collect()
        };
        let (with, without) = (count(&damped), count(&viscous));
        println!("E = {:.0} kPa: {with:?} evaluations a tick, viscous {without:?}", 10.0 * stiffer);
        let sum = |all: &[u32]| all.iter().map(|x| Real::from(*x)).sum::<Real>();
        worst += sum(&with) / sum(&without) / 8.0;
    }
    println!("on the mean {worst:.2} times as many");
    assert!(worst < 1.5, "{worst}");
}
