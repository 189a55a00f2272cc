//! Jaws that grasp: forceps close on a free block, lift it and let it go.

use super::*;
use palpate_core::simulation::ToolOutput;

/// The bundled block on its table, and the forceps above it, which clients open and close.
fn block(overrides: &[&str]) -> (Simulation, Settings) {
    let overrides: Vec<String> = overrides.iter().map(|s| (*s).to_owned()).collect();
    let loaded = LoadedScene::load(Path::new("grasp"), &overrides).unwrap();
    let body = Arc::new(loaded.build(&mut |_, _, _| {}).unwrap());
    let start = loaded.scene.settled(&body, &mut |_, _, _| ());
    let settings = loaded.scene.settings();
    let mut simulation = Simulation::new(body, settings.clone(), start).unwrap();
    tick(&mut simulation, attach());
    (simulation, settings)
}

/// A tick of the forceps with their tips `height` above the table and their jaws open by `opening`.
fn jaws(simulation: &mut Simulation, height: Real, opening: Real) -> ToolOutput {
    let pose = Pose { position: Vec3::new(0.02, 0.02, height), ..Pose::default() };
    let sample = PoseSample { sequence: 1, time_ns: 0, pose, buttons: 0, opening };
    tick(simulation, ToolEvent::Pose(sample)).tools[0]
}

/// Middle of the display vertices [m].
fn middle(simulation: &Simulation) -> Vec3 {
    let mut skin = vec![Vec3::zeros(); simulation.body().surface().vertices.len()];
    simulation.mesh().skin(&mut skin);
    skin.iter().sum::<Vec3>() / skin.len() as Real
}

const HELD: Real = 0.012;

/// Down over the block within 0.6 s, closed within 0.5 s, up by 30 mm within 0.6 s; what the forceps feel, each tick.
fn lifted(simulation: &mut Simulation, seconds: Real) -> Vec<ToolOutput> {
    (0..(seconds / TICK) as u32)
        .map(|i| {
            let t = Real::from(i) * TICK;
            let height = HELD + 0.06 * (1.0 - ease(t, 0.0, 0.6)) + 0.03 * ease(t, 1.3, 1.9);
            jaws(simulation, height, 1.0 - ease(t, 0.7, 1.2))
        })
        .collect()
}

#[test]
fn forceps_lift_a_block_bear_its_weight_and_let_it_fall() {
    let (mut simulation, _) = block(&[]);
    let weight = simulation.body().mass() * 9.81;
    let before = middle(&simulation);
    let felt = lifted(&mut simulation, 3.0);
    for (i, out) in felt.iter().enumerate().step_by(100) {
        let s = &out.state;
        println!(
            "{i}: {:?} force {:.3?} grip {:.4} opening {:.3} device {:.3} points {} middle",
            s.phase,
            s.physical_force.as_slice(),
            s.jaws.physical_torque,
            s.jaws.opening,
            s.jaws.device,
            out.contact_points
        );
    }
    let held = felt.last().unwrap().state;
    let risen = middle(&simulation) - before;
    println!("weight {weight:.3} N: {:.4?} N; risen {:.5?}", held.physical_force.as_slice(), risen.as_slice());
    assert!((held.physical_force.z / -weight - 1.0).abs() < 0.02);
    assert!((risen.z - 0.03).abs() < 2e-3 && risen.xy().norm() < 1e-3);
}
