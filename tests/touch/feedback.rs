//! The local model that remote hands render: is its stiffness what a hand would find?

use super::*;
use palpate_core::contact::tool::Part;
use palpate_core::feedback::relaxed::Probe;
use palpate_core::math::Mat3;

/// How far the handle goes to either side [m].
const NUDGE: Real = 2e-4;
/// Time in which the body comes to rest again.
const SETTLES: u32 = 500;

/// A ball presses `depth` deep within 0.4 s and strokes 30 mm in 0.6 s.
fn stroke(depth: Real) -> impl Fn(Real) -> Vec3 {
    move |t: Real| {
        TOP + Vec3::new(-0.015 + 0.03 * ease(t, 0.5, 1.1), 0.004, 0.012 - (depth + 0.002) * ease(t, 0.0, 0.4))
    }
}

/// Mean force while the handle is held at `place`, once the body has settled.
fn held_at(from: &Snapshot, setup: &Setup, place: Vec3) -> Vec3 {
    let settings = Settings { adaptivity: None, ..setup.settings.clone() };
    let mut hold = Simulation::new(setup.body.clone(), settings, from.clone()).unwrap();
    let start = from.tools[0].device.position;
    let mut sum = Vec3::zeros();
    for i in 0..SETTLES + 50 {
        let on_the_way = start + (place - start) * ease(Real::from(i), 0.0, 100.0);
        let force = tick(&mut hold, at(on_the_way)).tools[0].state.physical_force;
        if i >= SETTLES {
            sum += force / 50.0;
        }
    }
    sum
}

/// Runs the stroke and asks at random moments; the worst ratios of eigenvalues told and found.
fn ask(setup: &Setup, coupling: Coupling, depth: Real, moments: usize) -> (Real, Real) {
    let mut press = simulation(setup);
    tick(&mut press, ToolEvent::Attach { epoch: 1, period_ticks: 1, coupling });
    let mut probe = Probe::new(setup.body.clone(), setup.settings.clone()).unwrap();
    let mut copy = press.snapshot();
    let mut random = Random(7);
    let mut at_ticks: Vec<u32> = (0..moments).map(|_| 350 + random.below(750) as u32).collect();
    at_ticks.sort_unstable();
    at_ticks.dedup();
    let (mut least, mut most) = (Real::INFINITY, 0.0 as Real);
    let way = stroke(depth);
    let friction = setup.settings.tools[0].friction > 0.0;
    for i in 0..1100 {
        tick(&mut press, at(way(Real::from(i) * TICK)));
        // As the server does: a question every frame.
        if i % 32 != 0 && !at_ticks.contains(&i) {
            continue;
        }
        press.save_shape_into(&mut copy);
        let begun = std::time::Instant::now();
        let told = probe.stiffness(&copy)[0];
        let took = begun.elapsed();
        if !at_ticks.contains(&i) {
            continue;
        }
        let told = told.expect("the tool touches");
        let snapshot = press.snapshot();
        let mut found = Mat3::zeros();
        let place = snapshot.tools[0].device.position;
        for k in 0..3 {
            let mut nudge = Vec3::zeros();
            nudge[k] = NUDGE;
            let change = held_at(&snapshot, setup, place + nudge) - held_at(&snapshot, setup, place - nudge);
            found.set_column(k, &(-change / (2.0 * NUDGE)));
        }
        let sorted = |m: Mat3| {
            let mut values: Vec<Real> =
                (0.5 * (m + m.transpose())).symmetric_eigen().eigenvalues.iter().copied().collect();
            values.sort_by(Real::total_cmp);
            values
        };
        let (told_values, found_values) = (sorted(told.matrix), sorted(found));
        println!(
            "tick {i}: told {told_values:.0?} N/m, found {found_values:.0?}; {} iterations, {:.1} ms",
            told.iterations,
            took.as_secs_f64() * 1e3
        );
        // Along a flat face a ball without friction is not held at all, or rolls off by itself. One that slips gives
        // nothing more ahead and all of it back, so that anything between is as true: there is nothing to compare, but
        // no more may be told than what sticks, within the same bounds, or a fourth of what is across.
        let largest = found_values[2];
        for k in 0..3 {
            let (told, found) = (told_values[k], found_values[k]);
            if found > 0.5 * largest {
                (least, most) = (least.min(told / found), most.max(told / found));
            } else {
                let allowed = if friction { 1.25 * found_values[1] } else { 0.25 * largest };
                assert!(told < allowed, "{told} N/m told, {found} N/m found");
            }
        }
    }
    println!("told over found: {least:.2} to {most:.2}");
    (least, most)
}

#[test]
fn the_stiffness_told_is_what_a_hand_finds() {
    let setup = adaptive_cube(&["tool.radius=0.01", "material.damping_ratio=0.15"]);
    let (least, most) = ask(&setup, Coupling::RIGID, 0.005, cases(7, 20) as usize);
    assert!(least > 0.8 && most < 1.25);
}

#[test]
fn so_it_is_with_friction_and_through_a_coupling() {
    let setup = adaptive_cube(&["tool.radius=0.01", "material.damping_ratio=0.15", "tool.friction=0.5"]);
    let (least, most) =
        ask(&setup, Coupling { compliance: 1.0 / 700.0, ..Coupling::RIGID }, 0.005, cases(4, 8) as usize);
    // What sticks slips at the rim when it is nudged to one side.
    assert!(least > 0.75 && most < 1.25);
}

/// A capsule on its side that touches 15 to 45 mm from where it is held.
#[test]
fn so_it_is_where_the_tool_turns_with_the_torque() {
    let mut setup = adaptive_cube(&["material.damping_ratio=0.15"]);
    let lying = Pose { position: Vec3::new(0.015, 0.0, 0.0), orientation: ALONG_X };
    setup.settings.tools[0].shape = ToolShape::compound(vec![Part::capsule(0.01, 0.03).at(lying)]).unwrap();
    let coupling = Coupling { compliance: 1.0 / 800.0, angular_compliance: 1.0 / 0.3 };
    let (least, most) = ask(&setup, coupling, 0.004, cases(7, 20) as usize);
    assert!(least > 0.8 && most < 1.25);
}
