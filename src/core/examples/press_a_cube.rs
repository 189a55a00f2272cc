//! Presses a ball into a soft cube, in this process, and prints the force: `cargo run -p palpate-core --example press_a_cube`.

use palpate_core::contact::safety::ForceLimits;
use palpate_core::contact::tool::{Coupling, Following, PoseSample, Shape, Tool, ToolEvent};
use palpate_core::geometry::primitives::{box_mesh, box_surface};
use palpate_core::math::{Pose, Vec3};
use palpate_core::model::{Body, Material, body::BodyParts};
use palpate_core::simulation::{Inputs, Settings, Simulation, Snapshot};
use std::error::Error;

/// Contact force on the ball [N].
pub fn press_a_cube() -> Result<Vec3, Box<dyn Error>> {
    // 0.1 m wide, Young's modulus 10 kPa, in 6 × 6 × 6 cells of tetrahedra; its lowest nodes do not move.
    let (size, cells) = (Vec3::repeat(0.1), [6; 3]);
    let material = Material { psi: 5.0, ..Material::from_young(1e4, 0.35, 1000.0) };
    let mut parts = BodyParts::of_mesh("cube", box_mesh(size, cells), box_surface(size, cells), material);
    let level = &mut parts.levels[0];
    level.fixed = (0..).zip(&level.mesh.nodes).filter(|(_, u)| u.z == 0.0).map(|(n, _)| n).collect();
    let body = Body::new(parts)?;

    let settings = Settings {
        gravity: Vec3::zeros(),
        tools: vec![Tool { name: "ball".into(), shape: Shape::ball(0.02), friction: 0.0, pivot: None }],
        obstacles: vec![],
        organ_friction: Default::default(),
        support_motions: vec![],
        following: Following { speed: 1.0, engage_ticks: 1 },
        limits: ForceLimits { force: 100.0, torque: 10.0, slew: 1e6 },
        adaptivity: None,
        most_elements: body.element_count(),
    };
    let start = Snapshot::at_rest(&body, 0, 1);
    let mut simulation = Simulation::new(body.into(), settings, start)?;

    let mut inputs = Inputs::default();
    inputs.tools[0] = Some(ToolEvent::Attach { epoch: 1, period_ticks: 1, coupling: Coupling::RIGID });
    simulation.advance(&inputs);
    for tick in 0..700 {
        // From 1 mm above the cube 10 mm/s downward, then at rest.
        let height = (0.121 - 1e-5 * f64::from(tick)).max(0.115);
        let pose = Pose { position: Vec3::new(0.05, 0.05, height), ..Pose::default() };
        inputs.tools[0] = Some(ToolEvent::Pose(PoseSample { sequence: tick, pose, ..PoseSample::default() }));
        simulation.advance(&inputs);
    }
    Ok(simulation.outputs().tools[0].state.physical_force)
}

fn main() -> Result<(), Box<dyn Error>> {
    println!("{:.2} N", press_a_cube()?.z);
    Ok(())
}
