//! Play with several tools at once: a ball that goes from hand to hand, and a toy that falls over and is picked up.

use super::*;

/// A bundled scene, settled, all of its tools attached.
fn at_hand(name: &str) -> Simulation {
    let loaded = LoadedScene::load(Path::new(name), &[]).unwrap();
    let body = Arc::new(loaded.build(&mut |_, _, _| {}).unwrap());
    let start = loaded.scene.settled(&body, &mut |_, _, _| ());
    let tools = loaded.scene.tool.len();
    let mut simulation = Simulation::new(body, loaded.scene.settings(), start).unwrap();
    simulation.advance(&inputs(&vec![Some(attach()); tools]));
    simulation
}

/// One tick with the tools upright at these places [m].
fn hold(simulation: &mut Simulation, places: &[Vec3]) {
    let events: Vec<_> = places.iter().map(|place| Some(posed(*place, UPRIGHT))).collect();
    let outputs = simulation.advance(&inputs(&events));
    assert!(!outputs.restored);
}

/// Middle of the display vertices, and the lowest and highest of them [m].
fn place(simulation: &Simulation) -> (Vec3, Real, Real) {
    let mut skin = vec![Vec3::zeros(); simulation.body().surface().vertices.len()];
    simulation.mesh().skin(&mut skin);
    let heights = || skin.iter().map(|p| p.z);
    let middle = skin.iter().sum::<Vec3>() / skin.len() as Real;
    (middle, heights().fold(Real::MAX, Real::min), heights().fold(Real::MIN, Real::max))
}

#[test]
fn a_ball_is_lifted_by_one_hand_taken_over_by_the_other_and_set_down_elsewhere() {
    let mut simulation = at_hand("squeeze");
    let (start, ..) = place(&simulation);
    let weight = 9.81 * simulation.body().mass();
    let mut carried = Vec::new();
    for i in 0..5000 {
        let t = Real::from(i) * TICK;
        let lift = 0.04 * (ease(t, 1.0, 1.5) - ease(t, 3.6, 4.1));
        let aside = 0.05 * ease(t, 3.0, 3.5);
        // From how far the tips are apart when they hover to how far when they hold.
        let apart =
            |closes: Real, opens: Real| 0.022 - 0.027 * (ease(t, closes, closes + 0.4) - ease(t, opens, opens + 0.4));
        let (left, right) = (apart(0.4, 2.5), apart(1.8, 4.3));
        let (left_lift, at) = (if t < 2.9 { lift } else { 0.04 }, start + Vec3::new(0.0, aside, lift));
        let first = start + Vec3::z() * left_lift;
        let places = [
            first - Vec3::x() * (0.025 + 0.008 + left),
            first + Vec3::x() * (0.025 + 0.010 + left),
            at - Vec3::y() * (0.025 + 0.008 + right),
            at + Vec3::y() * (0.025 + 0.010 + right),
        ];
        hold(&mut simulation, &places);
        let force = |tool: usize| simulation.outputs().tools[tool].state.physical_force;
        match i {
            1650 => carried.push((place(&simulation).0 - start, force(0) + force(1))),
            2980 | 3550 => carried.push((place(&simulation).0 - start, force(2) + force(3))),
            4999 => carried.push((place(&simulation).0 - start, (0..4).map(force).sum())),
            _ => (),
        }
    }
    let expected = [Vec3::z() * 0.04, Vec3::z() * 0.04, Vec3::new(0.0, 0.05, 0.04), Vec3::y() * 0.05];
    for (k, ((way, force), expected)) in carried.iter().zip(expected).enumerate() {
        println!("{way:?} of {expected:?} m, {force:?} of {weight} N");
        // What is let go of may roll a little.
        assert!((way - expected).norm() < if k < 3 { 6e-3 } else { 11e-3 });
        assert!(k == 3 && force.norm() == 0.0 || k < 3 && (force.z / -weight - 1.0).abs() < 0.1);
    }
}

#[test]
fn a_toy_that_is_pushed_falls_over_and_is_picked_up() {
    let mut simulation = at_hand("toy");
    let (start, _, top) = place(&simulation);
    let away = Vec3::new(-0.25, -0.085, 0.1);
    // At the back of its head, until it falls on its face.
    for i in 0..1500 {
        let y = 0.06 - 0.14 * ease(Real::from(i) * TICK, 0.2, 1.2);
        hold(&mut simulation, &[Vec3::new(0.0, y, 0.15), away]);
    }
    for i in 0..2500 {
        let back = 0.25 * ease(Real::from(i) * TICK, 0.0, 0.8);
        hold(&mut simulation, &[Vec3::new(back, -0.08, 0.15 + back), away]);
    }
    let (lying, low, high) = place(&simulation);
    println!("{start:?}, {top} m high; {lying:?}, {low} to {high} m");
    assert!(high < 0.75 * top && low > -2e-3 && lying.z < 0.7 * start.z);
    // Squeezed from both sides, lifted, and set down again.
    let weight = 9.81 * simulation.body().mass();
    for i in 0..5200 {
        let t = Real::from(i) * TICK;
        let apart = 0.25 - 0.205 * ease(t, 0.4, 1.4) + 0.1 * ease(t, 4.2, 4.6);
        let lift = 0.12 * (ease(t, 1.6, 2.4) - ease(t, 3.2, 4.0));
        let at = Vec3::new(0.0, -0.085, 0.045 + lift);
        hold(&mut simulation, &[at + Vec3::x() * apart, at - Vec3::x() * apart]);
        let force = |tool: usize| simulation.outputs().tools[tool].state.physical_force;
        if i == 3100 {
            let ((_, low, _), carried) = (place(&simulation), force(0) + force(1));
            println!("{low} m above the floor, {carried:?} of {weight} N");
            assert!(low > 0.01 && (carried.z / -weight - 1.0).abs() < 0.05 && carried.xy().norm() < 0.1 * weight);
        }
    }
    let (set_down, low, high) = place(&simulation);
    println!("set down at {set_down:?}, {low} to {high} m");
    assert!(low > -2e-3 && high < 0.75 * top);
}
