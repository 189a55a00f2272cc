//! One block under one ball, to scale: at rest, force over `E L²` is one number, however stiff, small or light the block is.

use super::*;

/// A block of `length` [m] of 6 × 6 × 6 cells.
fn block(length: Real, modulus: Real, density: Real) -> Setup {
    let middle = 0.5 * length;
    scene(&[
        "body.cells=[[6,6,6]]",
        "safety.force_limit=100",
        "material.damping_ratio=0.3",
        "material.damping_time=0",
        &format!("body.size=[{length},{length},{length}]"),
        &format!("hold.max=[{length},{length},0]"),
        &format!("probe.position=[{middle},{middle},{length}]"),
        &format!("material.youngs_modulus={modulus}"),
        &format!("material.density={density}"),
        &format!("tool.radius={}", 0.2 * length),
    ])
}

/// Force over `E L²` half a second after a ball of `0.2 L` has begun to press `0.04 L` deep, and the kinetic energy left over
/// the elastic one.
fn pressed(length: Real, modulus: Real, density: Real) -> (Real, Real) {
    let block = block(length, modulus, density);
    let mut simulation = simulation(&block);
    simulation.advance(&inputs(&[Some(attach())]));
    let mut force = 0.0;
    for i in 0..500 {
        let gap = length * (0.01 - 0.05 * ease(Real::from(i) * TICK, 0.02, 0.3));
        let outputs = tick(&mut simulation, at(Vec3::new(0.5 * length, 0.5 * length, 1.2 * length + gap)));
        force = outputs.tools[0].state.physical_force.z;
    }
    let energy = energy(simulation.body(), simulation.mesh(), Vec3::zeros());
    (force / (modulus * length * length), energy.kinetic / energy.elastic)
}

#[test]
fn the_force_of_a_press_goes_with_the_modulus_and_the_area_and_nothing_moves_under_it() {
    let (reference, _) = pressed(0.1, 1e5, 1000.0);
    for (length, modulus, density) in [
        (0.1, 3e5, 1000.0),
        (0.1, 1e6, 1000.0),
        (0.1, 1e7, 1000.0),
        (0.01, 1e5, 1000.0),
        (0.003, 1e5, 1000.0),
        (0.3, 1e6, 1000.0),
        (0.1, 1e5, 20.0),
    ] {
        let (force, kinetic) = pressed(length, modulus, density);
        println!(
            "{length} m, {modulus:e} Pa, {density} kg/m³: {force:.5} of {reference:.5}, {kinetic:.1e} of the energy"
        );
        // Stars and tetrahedra that step apart push a node to and fro within a tick, each with its part of what balances.
        assert!((force / reference - 1.0).abs() < 0.01 && kinetic < 1e-7);
    }
}

/// Work [J] that a hand puts into an undamped block of this modulus while it presses a ball in by `depth` [m] at up to `speed` [m/s] and
/// takes it out again, the most on the way, and what of it the body still has.
fn cycle(modulus: Real, depth: Real, speed: Real, cells: &str) -> [Real; 3] {
    let block = scene(&[
        &format!("body.cells={cells}"),
        "safety.force_limit=100",
        "safety.tool_speed=1.5",
        "material.damping_ratio=0",
        "material.damping_time=0",
        &format!("material.youngs_modulus={modulus}"),
        "tool.radius=0.02",
    ]);
    let mut press = simulation(&block);
    tick(&mut press, attach());
    let from = 0.001;
    // Half a cosine down and half a cosine up.
    let half = 0.5 * std::f64::consts::PI * (depth + from) / speed;
    let height = |i: u64| from - 0.5 * (depth + from) * (1.0 - (std::f64::consts::PI * i as Real * TICK / half).cos());
    let (mut work, mut most, mut last) = (0.0, 0.0 as Real, None);
    for i in 0..(2.0 * half / TICK) as u64 {
        let tool = tick(&mut press, at(TOP + Vec3::z() * (0.02 + height(i)))).tools[0].state;
        // Over a tick the tool moves evenly, and its force is the mean.
        let way = last.map_or(Vec3::zeros(), |last| tool.pose.position - last);
        work -= tool.physical_force.dot(&way);
        (most, last) = (most.max(work), Some(tool.pose.position));
    }
    [work, most, energy(press.body(), press.mesh(), Vec3::zeros()).total()]
}

#[test]
fn a_closed_cycle_without_damping_gains_nothing_and_slow_gives_its_work_back() {
    for (modulus, cells) in [(1e4, "[[6,6,6]]"), (1e5, "[[6,6,6]]"), (1e4, "[[3,3,3],[5,5,5],[9,9,9]]")] {
        for (depth, speed) in [(0.004, 0.05), (0.01, 0.05), (0.004, 0.2), (0.01, 0.7), (0.01, 1.4)] {
            let [work, most, left] = cycle(modulus, depth, speed, cells);
            let lost = (work - left) / most;
            println!(
                "{modulus:.0e} Pa, {cells}, {:.0} mm at {speed} m/s: {most:.2e} J in, {:.2} % not given back, \
                 {:.2} % left in the body, {:.2} % lost",
                1e3 * depth,
                100.0 * work / most,
                100.0 * left / most,
                100.0 * lost
            );
            assert!(lost > -0.01, "gains {}", -lost);
            assert!(speed > 0.05 || lost < 0.035, "loses {lost}");
        }
    }
}
