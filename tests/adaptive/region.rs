//! A finest level that covers only a region of the body.

use super::*;
use palpate_body::prepare::region::{Reach, keep_finest_within};

/// The middle of the top of the cube, and how far the region reaches from it [m].
const TOP: Vec3 = Vec3::new(0.05, 0.05, SIDE);
const RADIUS: Real = 0.045;

fn damped_cube() -> Cube {
    let mut cube = elastic_cube(1e4, true);
    (cube.damping_ratio, cube.spacings) = (0.15, vec![0.034, 0.021, 0.011]);
    cube
}

fn in_region(body: &Arc<Body>) -> Arc<Body> {
    let whole = Body::from_bytes(body.bytes()).unwrap();
    let body = Arc::new(keep_finest_within(whole, &Reach::Ball(TOP, RADIUS)).unwrap());
    report(&body);
    body
}

/// Forces [N] and finest nodes in use of a press 5 mm deep, of which the ball's lowest point first touches at `place`, along
/// `inward`.
fn press(body: &Arc<Body>, place: Vec3, inward: Vec3) -> (Vec<Vec3>, Vec<u32>) {
    let adaptive = settings(Some(Adaptivity::default()));
    let mut press = simulation(body, &adaptive, uniform(body, 0));
    press.advance(&inputs(ATTACH));
    let (mut forces, mut finest) = (Vec::new(), Vec::new());
    for i in 1..700 {
        let depth = -0.003 + 0.008 * ease(Real::from(i) * TICK, 0.0, 0.3);
        let outputs = press.advance(&inputs(ball_at(place + inward * (depth - 0.01))));
        assert!(!outputs.restored);
        forces.push(outputs.tools[0].state.physical_force);
        finest.push(outputs.active[body.finest()]);
    }
    (forces, finest)
}

#[test]
fn in_its_region_a_finest_level_feels_as_one_of_the_whole_body_does() {
    let whole = damped_cube().body();
    let region = in_region(&whole);
    let (nodes, all) = (region.nodes_of(2).len(), whole.nodes_of(2).len());
    println!("{nodes} of {all} finest nodes");
    assert!(nodes < all / 2);
    let (expected, in_use) = press(&whole, TOP, -Vec3::z());
    let (found, used) = press(&region, TOP, -Vec3::z());
    let peak = expected.iter().map(|f| f.norm()).fold(0.0, Real::max);
    let off = expected.iter().zip(&found).map(|(a, b)| (a - b).norm()).fold(0.0, Real::max) / peak;
    let [most, other] = [&in_use, &used].map(|nodes| *nodes.iter().max().unwrap());
    println!("peak {peak:.3} N, {most} finest nodes in use, {other} in the region; off by {off:.1e} of the peak");
    // The same families are split, but a few ticks sooner or later: nodes take their turns in the order of their numbers.
    assert!(peak > 0.1 && most > 20 && other.abs_diff(most) < most / 10);
    assert!(off < 5e-3, "{off}");
}

#[test]
fn outside_its_region_the_level_before_it_carries_the_tool() {
    let body = in_region(&damped_cube().body());
    let (forces, finest) = press(&body, Vec3::new(SIDE, 0.05, 0.02), -Vec3::x());
    let held = forces[650].norm();
    println!("{held:.3} N, at most {} finest nodes in use", finest.iter().max().unwrap());
    assert!(held > 0.05 && finest.iter().all(|n| *n == 0));
    // In the ghost layer, too.
    let (forces, finest) = press(&body, TOP + Vec3::new(0.04, 0.0, 0.0), -Vec3::z());
    let rough = forces[600..].windows(2).map(|pair| (pair[1] - pair[0]).norm()).fold(0.0, Real::max);
    println!("on the ghosts {:.3} N, {} finest nodes in use, {rough:.1e} N a tick", forces[650].norm(), finest[650]);
    assert!(forces[650].norm() > 0.05 && finest[650] > 0 && rough < 0.02 * forces[650].norm());
}

#[test]
fn a_body_with_a_region_keeps_its_energy_and_its_momenta() {
    let body = in_region(&elastic_cube(2e3, false).body());
    for level in 1..3 {
        let kept = conservation::run(&body, body.covering(level), false, 10.0);
        println!(
            "level {level}, {} elements: energy {:.1e}, momenta {:.1e} {:.1e}",
            kept.elements, kept.energy, kept.linear, kept.angular
        );
        assert!(kept.energy < 5e-4 && kept.linear < 1e-10 && kept.angular < 1e-10);
    }
}

#[test]
fn a_body_with_a_region_survives_its_file_and_never_uses_the_rim() {
    let body = in_region(&damped_cube().body());
    let again = Body::from_bytes(body.bytes()).unwrap();
    assert_eq!(again.levels(), body.levels());
    assert!((again.mass() / 1.0 - 1.0).abs() < 1e-2, "{} kg", again.mass());
    let ghosts = body.nodes_of(2).find(|n| body.is_ghost(*n)).unwrap();
    let mut nodes = body.covering(2);
    assert!(State::at_rest_on(&body, nodes.clone()).is_some());
    nodes.push(ghosts);
    assert!(State::at_rest_on(&body, nodes).is_none());
    // A ghost layer that runs through a family is refused.
    let mut parts = again.into_parts();
    let first = parts.levels[2].ghosts.remove(0);
    let refused = Body::new(parts).unwrap_err().to_string();
    println!("node {first} taken off the ghosts: {refused}");
    assert!(refused.contains("runs through a family") || refused.contains("lies in no element"), "{refused}");
}
