//! Supports that move: they take along what they hold, as with breathing.

use palpate_body::prepare::{self, Recipe, Region, prepare};
use palpate_core::adaptation::Adaptivity;
use palpate_core::contact::safety::ForceLimits;
use palpate_core::contact::tool::{Coupling, Following, PoseSample, Shape, Tool, ToolEvent};
use palpate_core::geometry::primitives::box_mesh;
use palpate_core::ids::{OrganId, Vertex};
use palpate_core::math::{Bounds, Pose, Real, Vec3};
use palpate_core::model::{Body, Material, Periodic, SupportMotion};
use palpate_core::simulation::{Inputs, Settings, Simulation, Snapshot, TICK};
use std::sync::Arc;

/// A block that is held by springs at its upper side.
fn hanging(size: Vec3, youngs_modulus: Real, poisson_ratio: Real) -> Arc<Body> {
    let bounds = Bounds::new(Vec3::new(0.0, 0.0, size.z), size);
    let recipe = Recipe {
        name: "block".into(),
        shape: prepare::Shape::meshes([3, 6].map(|n| box_mesh(size, [n; 3]))),
        material: Material::from_young(youngs_modulus, poisson_ratio, 1000.0),
        inclusions: vec![],
        holds: vec![Region { bounds, stiffness: None, exact: false }],
        elements: Default::default(),
        damping_ratio: 0.2,
    };
    prepare(&recipe, &mut |_, _, _| {}).unwrap().into()
}

/// What is held at the upper side of that moves by `displacement` [m] and back within `period` ticks.
fn breath(displacement: Vec3, period: u32) -> SupportMotion {
    let region = Bounds::new(Vec3::new(0.0, 0.0, 1.0), Vec3::repeat(1.0));
    let motion = Periodic { displacement, period, parts: [0.4, 0.1, 0.4] };
    SupportMotion { organ: OrganId(0), frame: Pose::default(), region, relative: true, motion }
}

fn settings(body: &Arc<Body>, support_motions: Vec<SupportMotion>) -> Settings {
    Settings {
        gravity: Vec3::new(0.0, 0.0, -9.81),
        tools: vec![Tool { name: "ball".into(), shape: Shape::ball(0.01), friction: 0.0, pivot: None }],
        obstacles: vec![],
        organ_friction: Default::default(),
        support_motions,
        following: Following { speed: 1.0, engage_ticks: 10 },
        limits: ForceLimits { force: 100.0, torque: 10.0, slew: 1e6 },
        adaptivity: None,
        most_elements: body.element_count(),
    }
}

/// At rest under its weight before anything moves.
fn at_rest(body: &Arc<Body>, level: usize) -> Snapshot {
    let mut simulation =
        Simulation::new(body.clone(), settings(body, vec![]), Snapshot::at_rest(body, level, 1)).unwrap();
    for _ in 0..1500 {
        simulation.advance(&Inputs::default());
        simulation.mesh_mut().change_motion(|_, _, v| *v *= 0.98);
    }
    Snapshot { tick: 0, moved_for: 0, ..simulation.snapshot() }
}

fn places(simulation: &Simulation) -> Vec<Vec3> {
    (0..simulation.body().surface().vertices.len()).map(|v| simulation.mesh().vertex(Vertex::at(v))).collect()
}

fn farthest(a: &[Vec3], b: &[Vec3], moved: Vec3) -> Real {
    a.iter().zip(b).map(|(a, b)| (b - a - moved).norm()).fold(0.0, Real::max)
}

#[test]
fn what_moves_a_body_slowly_moves_it_as_a_whole_and_back() {
    let displacement = Vec3::new(0.004, -0.003, 0.008);
    for (size, modulus, nu) in [(0.1, 2e4, 0.35), (0.03, 5e4, 0.2), (0.06, 8e3, 0.45)] {
        let body = hanging(Vec3::new(size, 1.2 * size, 0.8 * size), modulus, nu);
        for level in 0..2 {
            let start = at_rest(&body, level);
            let settings = settings(&body, vec![breath(displacement, 4000)]);
            let mut simulation = Simulation::new(body.clone(), settings, start).unwrap();
            let before = places(&simulation);
            (0..1700).for_each(|_| _ = simulation.advance(&Inputs::default()));
            let there = farthest(&before, &places(&simulation), displacement);
            (0..2100).for_each(|_| _ = simulation.advance(&Inputs::default()));
            let back = farthest(&before, &places(&simulation), Vec3::zeros());
            println!("{size} m, level {level}: off by {there:e}, {back:e} m");
            // What swings on after a motion of least jerk.
            assert!(there < 2e-4 && back < 2e-4);
        }
    }
}

#[test]
fn a_motion_begins_anew_at_a_reset_and_waits_while_the_machine_is_away() {
    let body = hanging(Vec3::repeat(0.06), 2e4, 0.35);
    let start = at_rest(&body, 0);
    let rest = start.body.clone();
    let moving = settings(&body, vec![breath(Vec3::z() * 0.01, 2000)]);
    let new = || Simulation::new(body.clone(), moving.clone(), start.clone()).unwrap().with_reset_state(&rest).unwrap();
    let (mut alone, mut stalled) = (new(), new());
    (0..500).for_each(|_| _ = alone.advance(&Inputs::default()));
    (0..300).for_each(|_| _ = stalled.advance(&Inputs::default()));
    stalled.advance(&Inputs { lapsed: 3000, ..Inputs::default() });
    (301..500).for_each(|_| _ = stalled.advance(&Inputs::default()));
    assert_eq!(farthest(&places(&alone), &places(&stalled), Vec3::zeros()), 0.0);
    assert!(places(&alone)[0].z > places(&new())[0].z + 1e-3);

    stalled.advance(&Inputs { reset: true, ..Inputs::default() });
    let mut fresh = new();
    fresh.advance(&Inputs::default());
    // A motion does not go on in the tick of a reset itself.
    assert!(farthest(&places(&fresh), &places(&stalled), Vec3::zeros()) < 1e-6);
}

#[test]
fn a_restored_state_goes_on_as_the_body_did_while_it_is_moved_touched_and_refined() {
    let body = hanging(Vec3::repeat(0.08), 1e4, 0.4);
    let adaptive = |mut settings: Settings| {
        settings.adaptivity = Some(Adaptivity::default());
        settings
    };
    let settings = adaptive(settings(&body, vec![breath(Vec3::new(0.0, 0.003, 0.006), 1500)]));
    let mut simulation = Simulation::new(body.clone(), settings.clone(), at_rest(&body, 0)).unwrap();
    let below = places(&simulation).iter().map(|p| p.z).fold(0.0, Real::min);
    let press = |simulation: &mut Simulation, tick: u32| {
        let position = Vec3::new(0.04, 0.04, below - 0.012 + 0.01 * (0.002 * Real::from(tick)).min(1.0));
        let sample = PoseSample {
            sequence: tick,
            time_ns: 0,
            pose: Pose { position, ..Pose::default() },
            buttons: 0,
            opening: 0.0,
        };
        let mut inputs = Inputs::default();
        inputs.tools[0] = Some(match tick {
            0 => ToolEvent::Attach { epoch: 1, period_ticks: 1, coupling: Coupling::RIGID },
            _ => ToolEvent::Pose(sample),
        });
        simulation.advance(&inputs);
    };
    (0..620).for_each(|tick| press(&mut simulation, tick));
    assert!(!simulation.mesh().interface().is_empty(), "it is refined");
    let mut restored = Simulation::new(body.clone(), settings, simulation.snapshot()).unwrap();
    assert_eq!(restored.hash(), simulation.hash());
    for tick in 620..900 {
        press(&mut simulation, tick);
        press(&mut restored, tick);
        assert_eq!(restored.hash(), simulation.hash(), "tick {tick}");
    }
}

#[test]
fn a_motion_of_no_support_is_refused() {
    let body = hanging(Vec3::repeat(0.06), 2e4, 0.35);
    let low = Bounds::new(Vec3::zeros(), Vec3::new(1.0, 1.0, 0.2));
    let motions = vec![SupportMotion { region: low, ..breath(Vec3::z() * 0.01, (1.0 / TICK) as u32) }];
    let refused = Simulation::new(body.clone(), settings(&body, motions), Snapshot::at_rest(&body, 0, 1)).unwrap_err();
    assert!(refused.contains("none in its region"), "{refused}");
}
