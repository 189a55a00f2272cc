//! Coulomb's friction: points stick to the tool, and slip at the edge of the cone.

use super::*;

const MU: Real = 0.3;

/// Presses a ball of 15 mm `depth` deep into the top within 0.3 s, and then goes by `way(t)`, `t` from then on, for
/// `seconds`; the physical force of every tick.
fn pressed(cube: &Setup, depth: Real, seconds: Real, way: impl Fn(Real) -> Vec3) -> Vec<Vec3> {
    let coefficient = cube.settings.tools[0].friction;
    let mut press = simulation(cube);
    tick(&mut press, attach());
    let mut forces = Vec::new();
    for i in 0..(300 + (seconds / TICK) as u32) {
        let t = Real::from(i) * TICK;
        let place = TOP + Vec3::z() * (0.017 - (depth + 0.002) * ease(t, 0.0, 0.3)) + way((t - 0.3).max(0.0));
        let tool = tick(&mut press, at(place)).tools[0].state;
        let points = &press.snapshot().points[0];
        for p in points {
            let along = p.normal.dot(&p.tangential).abs();
            assert!(p.tangential.norm() <= coefficient * p.multiplier * (1.0 + 1e-9), "tick {i} leaves the cone");
            assert!(along <= 1e-9 * (1e-6 + p.multiplier), "tick {i}: friction is along the surface");
        }
        if i >= 300 {
            forces.push(tool.physical_force);
        }
    }
    forces
}

fn rough(coefficient: Real) -> Setup {
    cube(&["tool.radius=0.015", &format!("tool.friction={coefficient}"), "material.damping_time=0.01"])
}

#[test]
fn a_stroke_slips_at_the_edge_of_the_cone_against_the_motion() {
    let way = |t: Real| Vec3::new(0.05 * t, 0.0, 0.0);
    let with = pressed(&rough(MU), 0.004, 0.5, way);
    let without = pressed(&rough(0.0), 0.004, 0.5, way);
    // The cube leans and the dent is not quite even, so that a frictionless ball, too, feels something along its way.
    let (mut least, mut most) = (Real::INFINITY, 0.0 as Real);
    for (a, b) in with.iter().zip(&without).skip(200) {
        let ratio = (b.x - a.x) / a.z;
        (least, most) = (least.min(ratio), most.max(ratio));
    }
    println!("friction over pressure: {least:.3} to {most:.3} for μ = {MU}");
    assert!(least > 0.75 * MU && most < 1.15 * MU, "{least} to {most}");
}

#[test]
fn what_sticks_comes_back_and_does_not_creep() {
    let there = 0.0005;
    // The cube swings to and fro first.
    let forces =
        pressed(&rough(2.0), 0.004, 6.0, |t| Vec3::new(there * (ease(t, 0.0, 0.2) - ease(t, 5.5, 5.7)), 0.0, 0.0));
    let sideways = |t: Real| forces[(t / TICK) as usize].x - forces[0].x;
    let (held, later, back) = (sideways(4.4), sideways(5.4), sideways(5.99));
    println!("{:.2} mN, {:.2} mN 1 s later, {:.3} mN when it is back", held * 1e3, later * 1e3, back * 1e3);
    assert!(held < -0.01, "it is held back");
    assert!((later / held - 1.0).abs() < 2e-4, "it creeps");
    // What has slipped at the rim of the contact stays behind.
    assert!(back.abs() < 0.08 * held.abs(), "it does not come back");
}

#[test]
fn a_ball_that_twists_is_held_back_by_what_it_touches() {
    let cube = rough(MU);
    let mut press = simulation(&cube);
    tick(&mut press, attach());
    let (mut torque, mut force) = (Vec3::zeros(), Vec3::zeros());
    for i in 0..900 {
        let t = Real::from(i) * TICK;
        let half = 0.4 * ease(t, 0.3, 0.8);
        let turned = normalized_quaternion([0.0, 0.0, half, 1.0]).unwrap();
        let tool =
            tick(&mut press, posed(TOP + Vec3::z() * (0.017 - 0.006 * ease(t, 0.0, 0.3)), turned)).tools[0].state;
        (torque, force) = (tool.physical_torque, tool.physical_force);
    }
    // All of the contact slips around the axis: μ F times about two thirds of the contact's radius.
    let arm = -torque.z / (MU * force.z);
    println!("{:.3} mN m at {:.3} N: an arm of {:.2} mm", torque.z * 1e3, force.z, arm * 1e3);
    assert!(arm > 1e-3 && arm < 8e-3, "{arm} m");
}
