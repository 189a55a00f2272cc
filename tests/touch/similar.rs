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
        assert!((force / reference - 1.0).abs() < 0.01 && kinetic < 1e-9);
    }
}
