//! The hash of a simulation covers exactly what a snapshot saves: no more, or what is restored would hash otherwise, and no
//! less, or two runs that part could pass for one.

use palpate_body::geometry::primitives::sphere_surface;
use palpate_body::prepare::merge::merge;
use palpate_body::prepare::{Elements, Recipe, Shape, prepare};
use palpate_core::adaptation::Adaptivity;
use palpate_core::contact::obstacle::{Form, Obstacle};
use palpate_core::contact::safety::ForceLimits;
use palpate_core::contact::tool::{Coupling, Following, PoseSample, Shape as ToolShape, Tool, ToolEvent};
use palpate_core::math::{Pose, Vec3};
use palpate_core::model::{Body, Material, State};
use palpate_core::simulation::{Inputs, Parameter, Settings, Simulation, Snapshot};
use std::collections::BTreeMap;
use std::sync::Arc;

/// Two balls side by side, that touch.
fn body(elements: Elements) -> Arc<Body> {
    let material = Material { phi: 3.0, psi: 5.0, ..Material::from_young(1e4, 0.35, 1000.0) };
    let recipe = Recipe {
        name: "ball".into(),
        shape: Shape::closed(sphere_surface(0.05, 0.015), vec![0.035, 0.024]),
        material,
        inclusions: vec![],
        holds: vec![],
        elements,
        damping_ratio: 0.1,
    };
    let ball = || prepare(&recipe, &mut |_, _, _| {}).unwrap();
    let beside = Pose { position: Vec3::x() * 0.0995, ..Pose::default() };
    merge(vec![(ball(), Pose::default()), (ball(), beside)], 0.1).unwrap().into()
}

/// Just below the ball at rest.
fn floor() -> Obstacle {
    let pose = Pose { position: Vec3::z() * -0.05, ..Pose::default() };
    Obstacle { name: "floor".into(), shape: Form::Ground, friction: 0.5, pose, motion: None }
}

fn settings(body: &Body) -> Settings {
    Settings {
        gravity: Vec3::zeros(),
        tools: vec![Tool { name: "ball".into(), shape: ToolShape::ball(0.01), friction: 0.5, pivot: None }],
        obstacles: vec![floor()],
        organ_friction: Default::default(),
        support_motions: vec![],
        following: Following { speed: 1.0, engage_ticks: 10 },
        limits: ForceLimits { force: 100.0, torque: 10.0, slew: 1e6 },
        adaptivity: Some(Adaptivity::default()),
        most_elements: body.element_count(),
    }
}

/// A ball that is pressed until resolution changes around the tool: nothing of the state is empty.
fn pressed(body: &Arc<Body>) -> Simulation {
    let mut simulation = Simulation::new(body.clone(), settings(body), Snapshot::at_rest(body, 0, 1)).unwrap();
    let mut inputs = Inputs::default();
    inputs.tools[0] = Some(ToolEvent::Attach { epoch: 1, period_ticks: 1, coupling: Coupling::RIGID });
    simulation.advance(&inputs);
    for tick in 1..1000 {
        let height = 0.062 - 3e-5 * f64::from(tick);
        let pose = Pose { position: Vec3::new(0.0, 0.0, height), ..Pose::default() };
        inputs.tools[0] = Some(ToolEvent::Pose(PoseSample { sequence: tick, pose, ..PoseSample::default() }));
        inputs.parameter = [
            Parameter::Damping(0.9),
            Parameter::Stiffness { tissue: 0, factor: 1.1 },
            Parameter::Friction { tool: 0, coefficient: 0.4 },
            Parameter::Shape { tool: 0, of: 0 },
        ]
        .get(tick as usize - 1)
        .copied();
        simulation.advance(&inputs);
        let Snapshot { body: State { interface, residual, geomorph, .. }, points, .. } = simulation.snapshot();
        let held = residual.iter().flatten().any(|e| *e != Vec3::zeros());
        if !interface.is_empty() && held && geomorph.iter().any(|f| *f != [0.0; 4]) && points[0].len() > 1 {
            return simulation;
        }
    }
    panic!("the resolution does not change under the tool");
}

/// Every field of a snapshot, by name, with a change of it that still fits the body. One that is new and not named here is
/// an error of the compiler.
fn changes(snapshot: &Snapshot) -> BTreeMap<&'static str, Snapshot> {
    let Snapshot {
        tick: _,
        frozen: _,
        moved_for: _,
        prices: _,
        entangled: _,
        parameters: _,
        stiffening: _,
        body,
        tools: _,
        points: _,
        obstacle_points: _,
        meetings: _,
        moved: _,
    } = snapshot;
    let State {
        nodes: _,
        position: _,
        velocity: _,
        residual: _,
        interface: _,
        classes,
        history: _,
        strain_limit: _,
        stars,
        star_history: _,
        star_strain_limit: _,
        geomorph: _,
    } = body;
    let several_stars = stars.iter().position(|nodes| nodes.len() > 1);
    let several = classes.iter().position(|ids| ids.len() > 1).unwrap();
    let mut changed = BTreeMap::new();
    let mut change = |name, make: &dyn Fn(&mut Snapshot)| {
        let mut other = snapshot.clone();
        make(&mut other);
        assert_ne!(&other, snapshot, "{name}");
        changed.insert(name, other);
    };
    change("tick", &|s| s.tick += 1);
    change("frozen", &|s| s.frozen += 1);
    change("time of motions", &|s| s.moved_for += 1);
    change("prices", &|s| s.prices.0[3] += 1);
    change("entangled", &|s| s.entangled += 1);
    change("a parameter less", &|s| _ = s.parameters.pop());
    change("parameters", &|s| s.parameters[0] = Parameter::Damping(0.8));
    change("stiffness", &|s| s.stiffening.now[0] += 1e-12);
    change("stiffness before", &|s| s.stiffening.before[0] += 1e-12);
    change("elements that have followed", &|s| s.stiffening.reached -= 1);
    change("order of nodes", &|s| s.body.nodes.swap(0, 1));
    change("position", &|s| s.body.position[1].y += 1e-12);
    change("velocity", &|s| s.body.velocity[1].z += 1e-12);
    change("residual", &|s| s.body.residual[1][0].x += 1e-12);
    change("order of interface nodes", &|s| s.body.interface.swap(0, 1));
    change("order of elements", &|s| s.body.classes[several].swap(0, 1));
    change("class of an element", &|s| {
        let e = s.body.classes[several].pop().unwrap();
        s.body.classes[several + 1].insert(0, e);
    });
    change("last history", &|s| s.body.history.last_mut().unwrap().strain[5] += 1e-12);
    change("volume ratio", &|s| s.body.history[0].det += 1e-12);
    change("first branch", &|s| s.body.history[1].branch[0][2] += 1e-12);
    change("second branch", &|s| s.body.history[1].branch[1][2] += 1e-12);
    change("strain limit", &|s| s.body.strain_limit[0].deviator += 1e-12);
    change("slope of a strain limit", &|s| s.body.strain_limit[0].slope += 1e-12);
    if let Some(several) = several_stars {
        change("order of stars", &|s| s.body.stars[several].swap(0, 1));
        change("class of a star", &|s| {
            let n = s.body.stars[several].pop().unwrap();
            s.body.stars[several + 1].insert(0, n);
        });
        change("last history of a star", &|s| s.body.star_history.last_mut().unwrap().strain[5] += 1e-12);
        change("volume ratio of a star", &|s| s.body.star_history[0].det += 1e-12);
        change("first branch of a star", &|s| s.body.star_history[1].branch[0][2] += 1e-12);
        change("second branch of a star", &|s| s.body.star_history[1].branch[1][2] += 1e-12);
        change("strain limit of a star", &|s| s.body.star_strain_limit[0].deviator += 1e-12);
    }
    change("geomorph", &|s| s.body.geomorph[0][2] += 1e-12);
    change("tools", &|s| s.tools[0].ramp += 1e-12);
    change("a point less", &|s| s.points[0].truncate(1));
    change("points", &|s| s.points[0][0].weights[2] += 1e-12);
    change("an obstacle's point less", &|s| _ = s.obstacle_points[0].pop());
    change("an obstacle's points", &|s| s.obstacle_points[0][0].anchor.x += 1e-12);
    change("a meeting less", &|s| _ = s.meetings.pop());
    change("meetings", &|s| s.meetings[0].gap += 1e-12);
    change("what moved", &|s| s.moved += 1e-12);
    changed
}

#[test]
fn the_state_hash_covers_every_field_of_a_snapshot() {
    covers_every_field(&body(Elements::Tetrahedra));
    covers_every_field(&body(Elements::Smoothed));
}

fn covers_every_field(body: &Arc<Body>) {
    assert_eq!(body.maxwell().len(), 2, "a branch that the body does not have is no part of a state");
    let simulation = pressed(body);
    let snapshot = simulation.snapshot();
    let hash = |snapshot| Simulation::new(body.clone(), settings(body), snapshot).map(|restored| restored.hash());
    assert_eq!(hash(snapshot.clone()).unwrap(), simulation.hash(), "what a snapshot leaves out is hashed");
    for (name, changed) in changes(&snapshot) {
        assert_ne!(hash(changed).unwrap(), simulation.hash(), "{name} is not hashed");
    }
}

#[test]
fn the_state_hash_covers_the_bytes_of_a_snapshot() {
    covers_bytes(&body(Elements::Tetrahedra));
    covers_bytes(&body(Elements::Smoothed));
}

fn covers_bytes(body: &Arc<Body>) {
    let simulation = pressed(body);
    let bytes = postcard::to_stdvec(&simulation.snapshot()).unwrap();
    let (mut judged, mut unfit) = (0, 0);
    // The head and the end, where tools and contact points are, whole; of the long arrays a part that comes to all places
    // of a number.
    let ends = |at: &usize| *at < 100 || *at + 600 > bytes.len() || at.is_multiple_of(101);
    for at in (0..bytes.len()).filter(ends) {
        let mut other = bytes.clone();
        other[at] ^= 1;
        let Ok((snapshot, [])) = postcard::take_from_bytes::<Snapshot>(&other) else { continue };
        match Simulation::new(body.clone(), settings(body), snapshot) {
            Ok(restored) => {
                judged += 1;
                assert_ne!(restored.hash(), simulation.hash(), "byte {at} of {} is not hashed", bytes.len());
            }
            Err(_) => unfit += 1,
        }
    }
    println!("{} bytes, {judged} changes hashed, {unfit} refused", bytes.len());
    assert!(judged > 1000 && unfit * 10 < judged);
}
