//! Jaws that grasp: forceps close on a free block, lift it and let it go.

use super::*;
use palpate_core::contact::jaws::{Hinge, Mechanism};
use palpate_core::contact::tool::Part;
use palpate_core::ids::Vertex;
use palpate_core::model::constraint::PointMemory;
use palpate_core::simulation::ToolOutput;

/// The bundled block on its table, and the forceps above it, which clients open and close.
fn block(overrides: &[&str]) -> Simulation {
    let overrides: Vec<String> = overrides.iter().map(|s| (*s).to_owned()).collect();
    let loaded = LoadedScene::load(Path::new("grasp"), &overrides).unwrap();
    let body = Arc::new(loaded.build(&mut |_, _, _| {}).unwrap());
    let start = loaded.scene.settled(&body, &mut |_, _, _| ());
    let mut simulation = Simulation::new(body, loaded.scene.settings(), start).unwrap();
    tick(&mut simulation, attach());
    simulation
}

fn held_at(position: Vec3, opening: Real) -> ToolEvent {
    let pose = Pose { position, ..Pose::default() };
    ToolEvent::Pose(PoseSample { sequence: 1, time_ns: 0, pose, buttons: 0, opening })
}

/// The same of fewer nodes.
const COARSE: &str = "body.cells=[[3,3,3],[5,5,5]]";

/// A tick of the forceps with their tips `height` above the table and their jaws open by `opening`.
fn jaws(simulation: &mut Simulation, height: Real, opening: Real) -> ToolOutput {
    tick(simulation, held_at(Vec3::new(0.02, 0.02, height), opening)).tools[0]
}

/// Middle of the display vertices [m].
fn middle(simulation: &Simulation) -> Vec3 {
    let mut skin = vec![Vec3::zeros(); simulation.body().surface().vertices.len()];
    simulation.mesh().skin(&mut skin);
    skin.iter().sum::<Vec3>() / skin.len() as Real
}

/// Height of the tips where the jaws hold the block with all of their faces [m].
const HELD: Real = 0.024;

/// Down over the block within 0.6 s, closed within 0.5 s, up by `by` [m] within 0.6 s and held, `ticks` in all; what the forceps feel.
fn lifted(simulation: &mut Simulation, by: Real, ticks: u32) -> Vec<ToolOutput> {
    let height = |t: Real| HELD + 0.06 * (1.0 - ease(t, 0.0, 0.6)) + by * ease(t, 1.3, 1.9);
    let at = |i: u32| Real::from(i) * TICK;
    (0..ticks).map(|i| jaws(simulation, height(at(i)), 1.0 - ease(at(i), 0.7, 1.2))).collect()
}

fn weight(simulation: &Simulation) -> Real {
    simulation.body().mass() * 9.81
}

/// Nothing jumps in the hand.
fn assert_even(felt: &[ToolOutput]) {
    for (i, pair) in felt.windows(2).enumerate() {
        let [a, b] = [&pair[0].state, &pair[1].state];
        let (force, grip) = ((b.force - a.force).norm(), (b.jaws.torque - a.jaws.torque).abs());
        assert!(force < 0.1 && grip < 0.005, "tick {i}: {force} N, {grip} N m");
    }
}

#[test]
fn forceps_lift_a_block_bear_its_weight_without_slipping_and_let_it_fall() {
    let mut simulation = block(&[]);
    let (weight, before) = (weight(&simulation), middle(&simulation));
    let felt = lifted(&mut simulation, 0.03, 3000);
    assert_even(&felt);
    let (early, late) = (felt[2500].state, felt[2999].state);
    let (held, table) = (middle(&simulation), simulation.outputs().obstacles[0].wrench.force.norm());
    println!("{:.4} N of {weight:.4}; risen by {:.2} mm", late.physical_force.z, 1e3 * (held - before).z);
    assert!((late.physical_force.z / -weight - 1.0).abs() < 0.01 && table == 0.0, "{table}");
    // It hangs a little lower than it stood, as soft as it is.
    assert!((0.025..0.03).contains(&(held - before).z) && (held - before).xy().norm() < 1e-3);
    for _ in 0..500 {
        jaws(&mut simulation, HELD + 0.03, 0.0);
    }
    let moved = (middle(&simulation) - held).norm();
    // At the rim, where next to nothing presses, what sticks goes over into what slips (Cattaneo and Mindlin).
    let slips = |p: &PointMemory| p.tangential.norm() > 0.999 * 0.8 * p.multiplier;
    let points = simulation.snapshot().points[0].clone();
    let pressed = |points: &mut dyn Iterator<Item = &PointMemory>| points.map(|p| p.multiplier).sum::<Real>();
    let slipping = pressed(&mut points.iter().filter(|p| slips(p))) / pressed(&mut points.iter());
    println!("sways by {:.1} µm in 0.5 s; grip {:.1} mN m", 1e6 * moved, 1e3 * late.jaws.physical_torque);
    assert!(moved < 3e-5 && slipping < 0.05, "{slipping} of what presses slips");
    assert!((early.jaws.opening - late.jaws.opening).abs() < 1e-3 && late.jaws.device == 0.0);
    for i in 0..1500 {
        jaws(&mut simulation, HELD + 0.03, ease(Real::from(i) * TICK, 0.0, 0.4));
    }
    let (after, free) = (middle(&simulation), simulation.tools()[0]);
    assert!(free.physical_force == Vec3::zeros() && free.jaws.torque == 0.0 && free.jaws.opening == 1.0);
    assert!((after - before).norm() < 5e-3, "it lies on the table again: {after}");
}

#[test]
fn smooth_jaws_slip_off_what_is_too_heavy_for_them() {
    let mut simulation = block(&[COARSE, "tool.friction=0.05"]);
    let weight = weight(&simulation);
    let felt = lifted(&mut simulation, 0.03, 2200);
    let most = felt.iter().map(|out| -out.state.physical_force.z).fold(0.0, Real::max);
    println!("they pull with {most:.3} N of {weight:.3}");
    assert!(most > 0.05 && most < 0.6 * weight);
    assert!(middle(&simulation).z < 0.021, "it stays on the table");
}

#[test]
fn what_is_held_shut_opens_the_jaws_with_no_more_than_their_grip_and_softer_tissue_with_less() {
    let pressed = |modulus: &str| {
        let mut simulation = block(&[COARSE, &format!("material.youngs_modulus={modulus}")]);
        let state = lifted(&mut simulation, 0.0, 1800)[1799].state;
        // The spring between the hand and the jaws.
        let angle = Mechanism::of(&simulation.settings().tools[0].shape).angle;
        let compliance = angle / 0.12;
        assert!((state.jaws.opening * angle - compliance * state.jaws.physical_torque).abs() < 1e-9);
        (state.jaws.opening, state.jaws.physical_torque)
    };
    let [soft, stiff, hard] = ["5e3", "2e4", "1e5"].map(pressed);
    println!("opening and torque [N m] at 5, 20 and 100 kPa: {soft:.4?} {stiff:.4?} {hard:.4?}");
    assert!(soft.1 < stiff.1 && stiff.1 < hard.1 && hard.1 < 0.12);
    // Something that does not give way holds them as wide as it is: 40 mm between faces that are 36 mm apart at angle zero, 92 mm below
    // the hinge.
    let width: Real = (0.19 + 0.002 / 0.092) / 0.34;
    assert!((hard.0 / width - 1.0).abs() < 0.05, "{} of {width}", hard.0);
}

#[test]
fn a_jaw_presses_with_its_torque_over_its_lever() {
    let mut cube = cube(&[]);
    // A finger that hangs from a hinge 80 mm above its tip, and turns towards +x as it closes.
    let hinge = Hinge { axis: Vec3::y(), point: Vec3::z() * 0.08, closed: -0.3, open: 0.0 };
    let shape: ToolShape = Part::capsule(0.008, 0.02).hinged(hinge).into();
    cube.settings.tools[0].shape = shape.with_grip(0.05);
    let mut simulation = simulation(&cube);
    tick(&mut simulation, attach());
    let place = Vec3::new(-0.012, 0.05, 0.06);
    let state = (0..1500)
        .map(|i| tick(&mut simulation, held_at(place, 1.0 - ease(Real::from(i) * TICK, 0.2, 0.7))).tools[0].state)
        .last()
        .unwrap();
    // It pushes along x, some way up its 20 mm: the force acts where force and torque about the reference point say.
    let height = state.physical_torque.y / state.physical_force.x;
    let lever = state.jaws.physical_torque / state.physical_force.norm();
    println!("{:.3} N at {:.1} mm, lever {:.1} mm", state.physical_force.norm(), 1e3 * height, 1e3 * lever);
    assert!(state.physical_force.x < -0.1);
    assert!((lever / (0.08 - height) - 1.0).abs() < 0.05, "{lever} of {}", 0.08 - height);
}

#[test]
fn jaws_that_are_left_alone_hold_still_and_let_go_of_the_hand() {
    let mut simulation = block(&[COARSE]);
    let mut before = lifted(&mut simulation, 0.03, 2200)[2199];
    let opening = before.state.jaws.opening;
    for i in 0..120 {
        let out = simulation.advance(&Inputs::default()).tools[0];
        assert_even(&[before, out]);
        if out.state.touches() {
            assert!((out.state.jaws.opening - opening).abs() < 0.01, "tick {i}");
        }
        before = out;
    }
    assert!(before.state.force == Vec3::zeros() && before.state.jaws.torque == 0.0);
    assert_eq!(before.state.phase, Phase::Detached);
}

#[test]
fn an_opening_that_is_no_number_or_out_of_range_is_no_harm() {
    let mut simulation = block(&[COARSE]);
    lifted(&mut simulation, 0.0, 1300);
    for opening in [Real::NAN, Real::INFINITY, -3.0, 1e300] {
        for _ in 0..20 {
            let state = jaws(&mut simulation, HELD, opening).state;
            assert!((0.0..=1.0).contains(&state.jaws.opening) && is_finite(&state.force), "{opening}");
        }
    }
}

/// Through an incision in the wall of the belly, with two more organs that touch what is grasped, and all of them breathe.
#[test]
fn a_grasper_lifts_the_gallbladder_out_of_its_bed_and_lets_it_go() {
    let loaded = LoadedScene::load(Path::new("laparoscopy"), &[]).unwrap();
    let body = Arc::new(loaded.build(&mut |_, _, _| ()).unwrap());
    let start = loaded.scene.settled(&body, &mut |_, _, _| ());
    let mut simulation = Simulation::new(body.clone(), loaded.scene.settings(), start).unwrap();
    tick(&mut simulation, attach());
    let own = body.organs()[0].vertices.clone();
    let heights = |simulation: &Simulation| {
        let places = own.clone().map(|v| simulation.mesh().vertex(Vertex::at(v)));
        let (sum, top) = places.fold((0.0, Real::MIN), |(sum, top), p| (sum + p.z, p.z.max(top)));
        (sum / own.len() as Real, top)
    };
    let (before, top) = heights(&simulation);
    let pivot = Vec3::from(loaded.scene.tool[0].pivot.unwrap());
    let mut felt = Vec::new();
    let mut lifted = before;
    for i in 0..4500 {
        let t = Real::from(i) * TICK;
        let height = top + 0.02 - 0.036 * ease(t, 0.0, 1.0) + 0.03 * ease(t, 1.7, 2.7);
        let opening = 1.0 - ease(t, 1.0, 1.5) + ease(t, 3.2, 3.6);
        let out = tick(&mut simulation, held_at(Vec3::new(0.0, 0.0, height), opening)).tools[0];
        felt.push(out);
        if (3000..3150).contains(&i) {
            lifted = heights(&simulation).0;
            // It hangs in the jaws and on its duct, which pull it down.
            assert!((-0.8..-0.2).contains(&out.state.force[2]), "tick {i}: {:?} N", out.state.force);
        }
        let shaft = out.state.pose.rotate(Vec3::z());
        let aside = shaft.cross(&(pivot - out.state.pose.position)).norm();
        assert!(i < 400 || aside < 1e-3, "tick {i}: the shaft passes the incision {aside} m away");
    }
    let (after, _) = heights(&simulation);
    println!("lifted by {} m of 0.03, then at {} m", lifted - before, after - before);
    assert!(lifted - before > 0.012 && (after - before).abs() < 0.006);
    assert_even(&felt);
}

/// Lifted within 4 s, so that speeding up takes next to nothing, and held for so many `seconds`: what presses from both sides and what
/// pulls at the hand [N], and how far the block has come, and how far it has crept in all but the first two seconds of that [m].
fn lifted_slowly(friction: Real, seconds: u32) -> [Real; 4] {
    let mut simulation = block(&[COARSE, &format!("tool.friction={friction}")]);
    let before = middle(&simulation);
    let height = |t: Real| HELD + 0.06 * (1.0 - ease(t, 0.0, 0.6)) + 0.03 * ease(t, 1.5, 5.5);
    let (mut pull, mut held) = (0.0, before);
    for i in 0..5500 + 1000 * seconds {
        let t = Real::from(i) * TICK;
        pull = -jaws(&mut simulation, height(t), 1.0 - ease(t, 0.7, 1.2)).state.physical_force.z;
        if i == 7500 {
            held = middle(&simulation);
        }
    }
    let pressed: Real = simulation.snapshot().points[0].iter().map(|p| p.multiplier).sum();
    [pressed, pull, (middle(&simulation) - before).z, (middle(&simulation) - held).norm()]
}

#[test]
fn jaws_hold_what_coulomb_says_and_nothing_that_is_heavier() {
    let weight = weight(&block(&[COARSE]));
    let needed = weight / lifted_slowly(0.8, 0)[0];
    let [_, pull, risen, crept] = lifted_slowly(1.2 * needed, if whole() { 60 } else { 5 });
    println!(
        "needed {needed:.3}; with 1.2 of it {pull:.4} N of {weight:.4}, {:.1} mm up, crept {crept:.1e} m",
        1e3 * risen
    );
    assert!((pull / weight - 1.0).abs() < 0.01 && risen > 0.025 && crept < 10e-6);
    let [_, pull, risen, _] = lifted_slowly(0.9 * needed, 0);
    println!("with 0.9 of it {pull:.4} N, {:.1} mm up", 1e3 * risen);
    assert!(pull.abs() < 0.1 * weight && risen < 5e-3);
}
