//! Organs that lie on each other, as a scene has them.

use super::{build, load_text};
use palpate_core::contact::tool::{Coupling, PoseSample, ToolEvent};
use palpate_core::geometry::Surface;
use palpate_core::ids::OrganId;
use palpate_core::math::{Pose, Real, Vec3, from_parry, to_parry};
use palpate_core::model::{ActiveMesh, Body};
use palpate_core::simulation::{Inputs, Simulation};
use parry3d_f64::query::PointQuery;
use std::path::Path;

/// Deepest that the displayed vertices of one organ are in another [m].
fn deepest(body: &Body, mesh: &ActiveMesh) -> Real {
    let mut skin = vec![Vec3::zeros(); body.surface().vertices.len()];
    mesh.skin(&mut skin);
    let surface = |organ: &palpate_core::model::Organ| Surface {
        vertices: skin[organ.vertices.clone()].to_vec(),
        triangles: body.surface().triangles[organ.triangles.clone()]
            .iter()
            .map(|t| t.map(|v| v - organ.vertices.start as u32))
            .collect(),
    };
    let mut most: Real = 0.0;
    for (i, organ) in body.organs().iter().enumerate() {
        let shape = surface(organ).to_trimesh();
        let others = body.organs().iter().enumerate().filter(|(j, _)| *j != i);
        for v in others.flat_map(|(_, other)| &skin[other.vertices.clone()]) {
            let found = shape.project_local_point(to_parry(*v), false);
            if found.is_inside {
                most = most.max((from_parry(found.point) - v).norm());
            }
        }
    }
    most
}

/// The patches of both are 8 to 17 mm wide, and meet with their mean places: their middles are farther out.
#[test]
fn a_liver_that_is_pressed_onto_a_kidney_stays_on_it_and_passes_on_what_it_feels() {
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("config/scenes/organs.toml");
    let ends = "hold=[{min=[0.0,0.0,0.0], max=[0.12,1.0,1.0], relative=true}, \
                {min=[0.85,0.0,0.0], max=[1.0,1.0,1.0], relative=true}]";
    let text = std::fs::read_to_string(file).unwrap();
    let loaded = load_text(&text, &["organ.0.position=[0.04,0.0,0.004]", ends]);
    let body = build(&loaded);
    let start = loaded.scene.settled(&body, &mut |_, _, _| {});
    let mut simulation = Simulation::new(body.clone(), loaded.scene.settings(), start).unwrap();
    let mut skin = vec![Vec3::zeros(); body.surface().vertices.len()];
    simulation.mesh().skin(&mut skin);
    let beside = |p: &Vec3| Vec3::new(p.x, p.y + 0.005, 0.0).norm();
    let above = skin[body.organs()[0].vertices.clone()].iter().filter(|p| beside(p) < 0.005);
    let top = above.map(|p| p.z).fold(Real::NEG_INFINITY, Real::max);
    let on_liver = |simulation: &Simulation| -> Vec3 {
        let own = |i: u32| if body.patches().organ(i) == OrganId(0) { 1.0 } else { -1.0 };
        simulation.meetings().iter().map(|m| m.force * own(m.patch)).sum()
    };
    let (mut before, mut step, mut felt) = (on_liver(&simulation), 0.0, Vec3::zeros());
    let mut lying = Vec3::zeros();
    for tick in 0..500u64 {
        let height = 0.012 - 0.022 * (tick as Real / 400.0).min(1.0);
        let pose = Pose { position: Vec3::new(0.0, -0.005, top + height), ..Pose::default() };
        let mut inputs = Inputs::default();
        inputs.tools[0] = Some(match tick {
            0 => ToolEvent::Attach { epoch: 1, period_ticks: 1, coupling: Coupling::RIGID },
            _ => ToolEvent::Pose(PoseSample { sequence: tick as u32, time_ns: 0, pose, buttons: 0, opening: 0.0 }),
        });
        felt = simulation.advance(&inputs).tools[0].state.physical_force;
        let now = on_liver(&simulation);
        step = (now - before).norm().max(step);
        before = now;
        if felt == Vec3::zeros() {
            lying = now;
        }
    }
    let deep = deepest(&body, simulation.mesh());
    println!("{lying:?} N on the liver at rest, {before:?} N under {felt:?} N; steps of {step} N; {deep} m deep");
    assert!(lying.z > 1.0 && felt.z > 0.5 && before.z > lying.z + 0.4 * felt.z);
    // Elements between them are crushed to less than half, and shake.
    assert!(step < 0.2 * before.norm() && deep < 3e-3);
}
