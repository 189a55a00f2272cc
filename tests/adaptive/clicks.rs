//! A change of resolution is neither felt nor seen.
//!
//! What a change does is told from what happens anyway by running the tick twice: as it is, and from the same state
//! without the change.

use super::*;
use palpate_core::math::Bounds;

/// Jump of the force [N] that a hand does not feel, at any force.
const NOTICEABLE: Real = 0.010;
/// The same over the force: a hand tells steps of 7 to 10 per cent.
const UNFELT_PART: Real = 0.05;
/// Motion of the surface within a frame that no eye sees, over the body's size.
const UNSEEN: Real = 1.2e-3;
/// How far beyond [`NOTICEABLE`] the force may get in [`RINGS`] ticks where resolution comes late or has to go: the coarse level
/// does not agree with the fine one on a dent as small as its elements, so it has to go somewhere, but a hand tells 10 to
/// 15 per cent that come within some milliseconds.
const MOST_RING: Real = 2.5;
/// Ticks in which what a change has put out of balance shows in the force.
const RINGS: u64 = 8;

fn damped_cube() -> Arc<Body> {
    Cube { spacings: vec![0.032, 0.019, 0.011], damping_ratio: 0.15, ..elastic_cube(1e4, true) }.body()
}

/// Highest point of the surface.
fn summit(body: &Body) -> Vec3 {
    let vertices = &body.surface().vertices;
    vertices.iter().copied().max_by(|a, b| a.z.total_cmp(&b.z)).unwrap()
}

fn skin(simulation: &Simulation) -> Vec<Vec3> {
    let mut vertices = vec![Vec3::zeros(); simulation.body().surface().vertices.len()];
    simulation.mesh().skin(&mut vertices);
    vertices
}

fn most_apart(a: &[Vec3], b: &[Vec3]) -> Real {
    a.iter().zip(b).map(|(a, b)| (a - b).norm()).fold(0.0, Real::max)
}

/// What the surface moves by at most within a frame because of what changes have left to fade [m].
fn most_fade(simulation: &mut Simulation) -> Real {
    let mesh = simulation.mesh_mut();
    let before = mesh.geomorph.clone();
    (0..TICKS_PER_FRAME).for_each(|_| mesh.decay_geomorph());
    let moved = before.iter().zip(&mesh.geomorph).map(|(a, b)| Vec3::new(a[0] - b[0], a[1] - b[1], a[2] - b[2]).norm());
    let most = moved.fold(0.0, Real::max);
    mesh.geomorph = before;
    most
}

/// Largest clicks of a run.
#[derive(Debug, Default)]
struct Clicks {
    changes: u32,
    ticks: u32,
    /// Rendered force with the change less that without it [N], and over what is unfelt at that force.
    force: Real,
    over: Real,
    /// Tick of it.
    at: u64,
    /// The same within [`RINGS`] ticks, if nothing else changed in them.
    rings: Real,
    /// Display vertex with the change less that without it [m].
    surface: Real,
    /// What fades within a frame [m].
    fade: Real,
}

/// The tool presses the place `place` by 6 mm from above, holds, slides by 40 mm at 50 mm/s and leaves.
fn tool_at(place: Vec3, along: Vec3, i: u64) -> Inputs {
    if i == 0 {
        return inputs(ATTACH);
    }
    let t = i as Real * TICK;
    let depth = -0.002 + 0.008 * ease(t, 0.0, 0.4) - 0.02 * ease(t, 1.6, 1.9);
    inputs(ball_at(place + Vec3::z() * (0.01 - depth) + along * (0.04 * ease(t, 0.6, 1.4))))
}

/// A run of `ticks`; every tick with a change is run again without it.
fn compare(press: &mut Simulation, from: u64, ticks: u64, at: impl Fn(u64) -> Inputs) -> Clicks {
    let mut before = press.snapshot();
    let mut clicks = Clicks::default();
    let mut peak = 0.0 as Real;
    for i in from..from + ticks {
        press.save_into(&mut before);
        let outputs = press.advance(&at(i));
        let changes = outputs.adapted.splits + outputs.adapted.merges;
        let force = outputs.tools[0].state.force;
        assert!(!outputs.restored);
        peak = peak.max(force.norm());
        if changes == 0 {
            continue;
        }
        clicks.fade = clicks.fade.max(most_fade(press));
        let mut without = Simulation::new(press.body().clone(), settings(None), before.clone()).unwrap();
        let expected = without.advance(&at(i)).tools[0].state.force;
        let jump = (force - expected).norm();
        let over = jump / NOTICEABLE.max(UNFELT_PART * expected.norm());
        clicks.changes += changes;
        clicks.ticks += 1;
        clicks.force = clicks.force.max(jump);
        if over > clicks.over {
            (clicks.over, clicks.at) = (over, i);
        }
        clicks.surface = clicks.surface.max(most_apart(&skin(press), &skin(&without)));
        let mut with = with_settings(press, &settings(None));
        for k in 1..=RINGS {
            let force = with.advance(&at(i + k)).tools[0].state.force;
            let expected = without.advance(&at(i + k)).tools[0].state.force;
            let over = (force - expected).norm() / NOTICEABLE.max(UNFELT_PART * expected.norm());
            clicks.rings = clicks.rings.max(over);
        }
    }
    println!("force up to {peak:.3} N; {clicks:?}");
    assert!(peak > 0.1 && clicks.changes > 20, "there is something to feel");
    clicks
}

fn press(body: &Arc<Body>, place: Vec3, along: Vec3) -> Clicks {
    report(body);
    let mut press = simulation(body, &settings(Some(Adaptivity::default())), uniform(body, 0));
    compare(&mut press, 0, 2000, |i| tool_at(place, along, i))
}

/// The tool rests on a coarse body before resolution may follow, and again when it may not stay.
#[test]
fn resolution_that_comes_late_and_goes_early_is_not_felt() {
    let body = damped_cube();
    let held = |i: u64| tool_at(Vec3::new(0.05, 0.05, SIDE), Vec3::x(), i.min(550));
    let mut hold = simulation(&body, &settings(None), uniform(&body, 0));
    (0..700).for_each(|i| {
        hold.advance(&held(i));
    });
    let mut hold = with_settings(&hold, &settings(Some(Adaptivity::default())));
    let coming = compare(&mut hold, 700, 600, held);
    // Nothing is worth being fine any more.
    let away = Adaptivity { split: 10.0, reach: 0.0, ..Adaptivity::default() };
    let mut hold = with_settings(&hold, &settings(Some(away)));
    let going = compare(&mut hold, 1300, 600, held);
    judge(&coming, SIDE, MOST_RING);
    judge(&going, SIDE, MOST_RING);
}

fn judge(clicks: &Clicks, size: Real, most_ring: Real) {
    assert!(clicks.over < 1.0, "a change can be felt at once: {clicks:?}");
    assert!(clicks.rings < most_ring, "a change can be felt within milliseconds: {clicks:?}");
    assert!(clicks.surface < UNSEEN * size, "a change can be seen: {clicks:?}");
    assert!(clicks.fade < UNSEEN * size, "what fades can be seen: {clicks:?}");
}

#[test]
fn a_press_and_a_stroke_on_the_cube_feel_and_show_no_change() {
    judge(&press(&damped_cube(), Vec3::new(0.03, 0.05, SIDE), Vec3::x()), SIDE, 1.0);
}

#[test]
fn a_press_and_a_stroke_on_the_liver_feel_and_show_no_change() {
    let body = liver(0.45, vec![0.028, 0.017, 0.010], 5e3, 0.15);
    let Bounds { low, high } = body.surface().bounds();
    judge(&press(&body, summit(&body), Vec3::x()), (high - low).max(), 1.0);
}

/// The whole contact region refined by hand, and coarsened again, in one tick each: far more than adaptation does.
#[test]
fn refining_and_coarsening_the_whole_contact_in_one_tick_is_not_felt() {
    let body = damped_cube();
    // Pressed 3.5 mm deep: on the coarse level a deeper dent would be firmer than it should.
    let place = Vec3::new(0.05, 0.05, SIDE + 0.0025);
    let held = |i: u64| if i == 0 { inputs(ATTACH) } else { tool_at(place, Vec3::x(), i.min(550)) };
    let mut hold = simulation(&body, &settings(None), uniform(&body, 0));
    let mut target = ActiveSet::uniform(&body, 0);
    let coarse = target.clone();
    for r in 0..body.finest() {
        for n in body.nodes_of(r) {
            while target.is_active(n) && (body.rest(n) - place).norm() < 0.03 {
                let first = split_first(&body, &target, n);
                target.apply(&body, Change::Split(first));
            }
        }
    }
    let mut i = 0;
    let mut worst = Clicks::default();
    for round in 0..6 {
        for _ in 0..if round == 0 { 700 } else { 350 } {
            hold.advance(&held(i));
            i += 1;
        }
        let mut without = with_settings(&hold, &settings(None));
        let mut jumped = 0.0 as Real;
        let mut seen = skin(&hold);
        let to = if round % 2 == 0 { &target } else { &coarse };
        let mut batches = 0;
        let mesh = hold.mesh_mut();
        let mut now = seen.clone();
        go_to(&body, mesh, to, |mesh, _| {
            // The batch before this one.
            mesh.skin(&mut now);
            jumped = jumped.max(most_apart(&now, &seen));
            seen.copy_from_slice(&now);
            batches += 1;
        });
        jumped = jumped.max(most_apart(&skin(&hold), &seen));
        let fade = most_fade(&mut hold);
        let (before, mut force) = (hold.tools()[0].physical_force.norm(), 0.0 as Real);
        let mut after = 0.0;
        // The change acts at once; what is out of balance shows within a few milliseconds.
        for k in 0..8 {
            let with = hold.advance(&held(i)).tools[0].state.physical_force;
            let expected = without.advance(&held(i)).tools[0].state.physical_force;
            if k == 0 {
                after = (with - expected).norm();
            }
            force = force.max((with - expected).norm());
            i += 1;
        }
        println!(
            "round {round}, {batches} batches: {before:.4} N, {:.1} mN in the first tick, {:.1} mN within 8; the surface \
             jumps by {jumped:.1e} m, {:.3} mm fade in a frame",
            after * 1e3,
            force * 1e3,
            fade * 1e3
        );
        assert!(before > 0.1);
        // What the fade does not take up is below a picometre a batch.
        assert!(jumped < 1e-11, "the surface jumps by {jumped:e} m");
        worst.force = worst.force.max(after / NOTICEABLE.max(UNFELT_PART * before));
        worst.fade = worst.fade.max(fade);
    }
    assert!(worst.fade < UNSEEN * SIDE, "{} mm fade in a frame", worst.fade * 1e3);
    // Far more at once than the core ever does under a tool; what is rendered then follows slowly besides.
    assert!(worst.force < 2.5, "the force jumps by {:.2} of what is not felt", worst.force);
}
