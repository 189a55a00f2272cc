//! Two soft balls pressed together, against Hertz's answer for two elastic bodies.

use palpate_body::geometry::primitives::sphere_surface;
use palpate_body::prepare::merge::merge;
use palpate_body::prepare::{self, Elements, Recipe, prepare};
use palpate_core::contact::safety::ForceLimits;
use palpate_core::contact::tool::Following;
use palpate_core::ids::OrganId;
use palpate_core::math::{Pose, Real, Vec3};
use palpate_core::model::{Body, Material};
use palpate_core::simulation::{Inputs, Settings, Simulation, Snapshot};
use std::sync::Arc;

/// [Pa]
const YOUNGS_MODULUS: Real = 1e4;

/// A ball of this radius [m] whose nodes are `spacing` radii apart.
fn ball(radius: Real, spacing: Real, poisson_ratio: Real) -> Body {
    let recipe = Recipe {
        name: "ball".into(),
        shape: prepare::Shape::closed(sphere_surface(radius, 0.07 * radius), vec![spacing * radius]),
        material: Material::from_young(YOUNGS_MODULUS, poisson_ratio, 1000.0),
        inclusions: vec![],
        holds: vec![],
        elements: Elements::Tetrahedra,
        damping_ratio: 0.5,
    };
    prepare(&recipe, &mut |_, _, _| {}).unwrap()
}

/// The halves that are away from each other come closer by `approach` [m], in so many ticks, and stay for as many; the force [N].
fn press(simulation: &mut Simulation, radius: Real, approach: [Real; 2], ticks: u32) -> Real {
    let body = simulation.body().clone();
    for tick in 0..2 * ticks {
        let part = (Real::from(tick) / Real::from(ticks)).min(1.0);
        let closer = approach[0] + (approach[1] - approach[0]) * part;
        simulation.mesh_mut().change_motion(|n, x, v| {
            let rest = body.rest(n);
            let (down, away) = match body.organ_of(n) {
                OrganId(0) => (0.0, -rest.z),
                _ => (closer, rest.z - 2.0 * radius),
            };
            *v *= 0.995;
            if away > 0.5 * radius {
                (*x, *v) = (rest - Vec3::z() * down, Vec3::zeros());
            }
        });
        simulation.advance(&Inputs::default());
    }
    let up = |organ: OrganId| if organ == OrganId(1) { 1.0 } else { -1.0 };
    let held = simulation.meetings().iter().filter(|m| m.held);
    held.map(|m| m.force.z * up(body.patches().organ(m.patch))).sum()
}

/// Pressed until the contact is as wide as some four to nine patches of each, also where one is twice as fine as the other.
#[test]
fn two_balls_push_each_other_as_hertz_says() {
    for (radius, poisson_ratio, spacings) in
        [(0.01, 0.35, [0.14, 0.14]), (0.03, 0.35, [0.14, 0.25]), (0.1, 0.45, [0.14, 0.14])]
    {
        let at = |z: Real| Pose { position: Vec3::z() * z, ..Pose::default() };
        let balls = spacings.map(|spacing| ball(radius, spacing, poisson_ratio));
        let body = Arc::new(merge(balls.into_iter().zip([at(0.0), at(2.0 * radius)]).collect(), 0.5).unwrap());
        let settings = Settings {
            gravity: Vec3::zeros(),
            tools: vec![],
            obstacles: vec![],
            organ_friction: Default::default(),
            support_motions: vec![],
            following: Following { speed: 1.0, engage_ticks: 10 },
            limits: ForceLimits { force: 100.0, torque: 10.0, slew: 1e6 },
            adaptivity: None,
            most_elements: body.element_count(),
        };
        let mut simulation = Simulation::new(body.clone(), settings, Snapshot::at_rest(&body, 0, 0)).unwrap();
        for approach in [[0.0, 0.05], [0.05, 0.1]].map(|approach| approach.map(|part| part * radius)) {
            let force = press(&mut simulation, radius, approach, 350);
            let stiffness = 0.5 * YOUNGS_MODULUS / (1.0 - poisson_ratio * poisson_ratio);
            let hertz = 4.0 / 3.0 * stiffness * (0.5 * radius).sqrt() * approach[1].powf(1.5);
            let touching = simulation.meetings().iter().filter(|m| m.multiplier > 0.0).count();
            let off = 100.0 * (force / hertz - 1.0);
            println!(
                "R {:.0} mm, nu {poisson_ratio}, {spacings:?} R, {:.1} mm: {force:.4} N, {off:+.1} % of Hertz, {touching} patches",
                1e3 * radius,
                1e3 * approach[1]
            );
            assert!(off.abs() < 15.0);
        }
    }
}
