//! A simulation that was saved and restored while its resolution changes goes on bit for bit.

use super::*;
use palpate_core::model::element_kernel::Simd;

/// Ticks that are compared after a restore.
const COMPARED: u64 = 500;

fn body(young: Real) -> Arc<Body> {
    let mut cube = elastic_cube(young, true);
    cube.damping_ratio = 0.15;
    cube.spacings = vec![0.034, 0.020, 0.012];
    cube.body()
}

/// As [`press_and_stroke`], but towards the face that springs hold, where they shorten steps, too.
fn stroke_to_the_hold(i: u64) -> Inputs {
    if i == 0 {
        return inputs(ATTACH);
    }
    let t = i as Real * TICK;
    let depth = -0.003 + 0.010 * ease(t, 0.0, 0.3);
    let x = 0.035 - 0.033 * ease(t, 0.4, 1.0);
    inputs(ball_at(Vec3::new(x, 0.05, SIDE + 0.01 - depth)))
}

/// As [`press_and_stroke`], with a budget that is cut to a fraction while the ball presses and comes back.
fn press_on_a_cut_budget(i: u64) -> Inputs {
    Inputs {
        budget: Budget::of(if (CUT..CUT + 300).contains(&i) { 260_000 } else { 1_600_000 }),
        ..press_and_stroke(i)
    }
}

/// Ticks before the cut.
const CUT: u64 = 420;

/// What a tick says that must be the same.
type Row = (u64, [u64; 6], u64, [u32; 4], bool);

fn advance(simulation: &mut Simulation, script: fn(u64) -> Inputs, from: u64, ticks: u64) -> Vec<Row> {
    let row = |i| {
        let o = simulation.advance(&script(i));
        let (f, t) = (o.tools[0].state.physical_force, o.tools[0].state.physical_torque);
        let changes = o.adapted.splits + o.adapted.merges > 0;
        let counts = [o.elements, o.element_evaluations, o.adapted.splits, o.adapted.merges];
        let wrench = [f.x, f.y, f.z, t.x, t.y, t.z].map(Real::to_bits);
        (o.tick, wrench, simulation.hash(), counts, changes)
    };
    (from..from + ticks).map(row).collect()
}

#[test]
fn restored_at_any_moment_it_goes_on_bit_for_bit() {
    restored_at_any_moment(press_and_stroke, 1e4);
}

#[test]
fn restored_at_any_moment_near_a_hold_it_goes_on_bit_for_bit() {
    restored_at_any_moment(stroke_to_the_hold, 3e4);
}

/// While a body stands still now and then to shed many nodes under a tool, its state is all that says how it will go on.
#[test]
fn restored_while_it_sheds_it_goes_on_bit_for_bit() {
    let body = Cube { spacings: vec![0.060, 0.034, 0.020, 0.0115], ..elastic_cube(1e4, true) }.body();
    report(&body);
    let settings = settings(Some(Adaptivity { split: 0.02, ..Adaptivity::default() }));
    let start = || simulation(&body, &settings, uniform(&body, 0));
    let mut whole = start();
    let (mut all, mut held) = (Vec::new(), Vec::new());
    for i in 0..CUT + 800 {
        all.extend(advance(&mut whole, press_on_a_cut_budget, i, 1));
        if whole.outputs().plan.taken == 0 {
            held.push(i);
        }
    }
    let [before, shed] = [CUT, CUT + 200].map(|i| all[i as usize].3[0]);
    println!("held in ticks {held:?}; {before} elements, then {shed}");
    assert!(!held.is_empty() && shed * 10 < before * 9, "there is nothing to get wrong");
    for moment in (CUT..=held[held.len() - 1] + 2).take(40).step_by(cases(3, 1) as usize) {
        restored_at(moment, &body, start, press_on_a_cut_budget, &all);
    }
}

fn restored_at_any_moment(script: fn(u64) -> Inputs, young: Real) {
    let body = body(young);
    report(&body);
    let settings = settings(Some(Adaptivity::default()));
    let start = || simulation(&body, &settings, uniform(&body, 0));
    let all = advance(&mut start(), script, 0, 1500);
    let changing: Vec<u64> = (0..all.len() as u64).filter(|i| all[*i as usize].4).collect();
    println!("{} of {} ticks change the resolution, at {:?} …", changing.len(), all.len(), &changing[..8]);
    assert!(changing.len() > 30, "there is something to get wrong");

    // Before the first change, right after changes while pressing, holding and stroking, and between changes.
    let mut moments: Vec<u64> = changing.iter().map(|i| i + 1).filter(|i| *i <= 1000).step_by(5).collect();
    moments.extend([3, 450, 1000]);
    for &moment in &moments {
        restored_at(moment, &body, start, script, &all);
        println!("restored after {moment} ticks ({:?} before): {COMPARED} ticks alike", all[moment as usize - 1].3);
    }
}

/// Goes on as in `all` after being saved and restored at `moment`.
fn restored_at(moment: u64, body: &Arc<Body>, start: impl Fn() -> Simulation, script: fn(u64) -> Inputs, all: &[Row]) {
    let mut half = start();
    advance(&mut half, script, 0, moment);
    let bytes = postcard::to_stdvec(&half.snapshot()).unwrap();
    let snapshot: Snapshot = postcard::from_bytes(&bytes).unwrap();
    assert_eq!(snapshot, half.snapshot(), "postcard");
    for path in [Simd::Portable, Simd::best()] {
        let settings = half.settings().clone();
        let mut restored = Simulation::new(body.clone(), settings, snapshot.clone()).unwrap().with_path(path);
        assert_eq!(restored.hash(), half.hash());
        let expected = &all[moment as usize..];
        let rows = advance(&mut restored, script, moment, COMPARED.min(expected.len() as u64));
        for (row, expected) in rows.iter().zip(expected) {
            assert_eq!(row, expected, "restored after {moment} ticks on {path:?}");
        }
    }
}

/// What is kept from tick to tick to save time, such as what of the surface may be near a tool, makes no other difference.
#[test]
fn loaded_afresh_for_every_tick_it_goes_on_bit_for_bit() {
    let body = body(1e4);
    let settings = settings(Some(Adaptivity::default()));
    let start = || simulation(&body, &settings, uniform(&body, 0));
    let (mut pressed, mut afresh, mut changing) = (start(), start(), 0);
    for i in 0..1200 {
        afresh.load(&pressed.snapshot());
        let rows = [&mut pressed, &mut afresh].map(|s| advance(s, press_and_stroke, i, 1));
        assert_eq!(rows[0], rows[1]);
        changing += u32::from(rows[0][0].4);
    }
    println!("{changing} ticks change the resolution");
    assert!(changing > 30, "there is something to get wrong");
}

#[test]
fn every_path_of_the_kernel_gives_the_same_bits() {
    let body = body(1e4);
    let settings = settings(Some(Adaptivity::default()));
    let run = |path| {
        let mut pressed = simulation(&body, &settings, uniform(&body, 0)).with_path(path);
        advance(&mut pressed, press_and_stroke, 0, 900)
    };
    let portable = run(Simd::Portable);
    for path in Simd::available() {
        assert!(run(path) == portable, "{path:?}");
    }
    println!("{:?}: {} ticks alike", Simd::available(), portable.len());
}
