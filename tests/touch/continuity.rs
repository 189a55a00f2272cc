//! Force and local model go on without steps: over triangle borders, changes of resolution, and where contact begins and
//! ends.

use super::shapes::{block, quaternion};
use super::*;
use palpate_core::feedback::LocalModel;
use palpate_core::feedback::relaxed::Probe;
use palpate_core::math::Mat3;

/// Step of the force [N], or its part of the force, that a hand does not feel.
const NOTICEABLE: (Real, Real) = (0.010, 0.05);
/// Ticks from a copy of the simulation to its local model.
const ANSWERED: u32 = 16;
/// Step of the stiffness in a tick, over the largest eigenvalue.
const STEP: Real = 0.1;

fn matrix(model: &LocalModel) -> Mat3 {
    let [xx, yy, zz, yz, zx, xy] = model.stiffness;
    Mat3::new(xx, xy, zx, xy, yy, yz, zx, yz, zz)
}

/// Largest steps of a run.
#[derive(Debug, Default)]
struct Steps {
    /// Of the force beyond what the motion explains, over what is unfelt.
    force: Real,
    /// Of the stiffness, over its largest eigenvalue.
    stiffness: Real,
    /// Of what the model says of a place a millimetre ahead of the handle, over what is unfelt.
    ahead: Real,
    changes: u32,
    /// Ticks in which contact began or ended.
    borders: u32,
}

/// Presses `depth` deep, strokes 40 mm at up to 75 mm/s over the face, leaves, and comes again.
fn way(depth: Real, t: Real) -> Vec3 {
    let height = 0.012 - (depth + 0.002) * (ease(t, 0.0, 0.3) - ease(t, 1.3, 1.5) + ease(t, 1.6, 1.8));
    TOP + Vec3::new(-0.02 + 0.04 * ease(t, 0.4, 1.2), 0.004, height)
}

fn run(setup: &Setup, compliance: Real, depth: Real) -> Steps {
    let mut press = simulation(setup);
    let coupling = Coupling { compliance, ..Coupling::RIGID };
    tick(&mut press, ToolEvent::Attach { epoch: 1, period_ticks: 1, coupling });
    let mut probe = Probe::new(setup.body.clone(), setup.settings.clone()).unwrap();
    let (mut local, mut found, mut next) = (LocalModel::default(), None, None);
    let mut steps = Steps::default();
    let mut before: Option<(LocalModel, bool)> = None;
    for i in 0..2000u32 {
        let outputs = tick(&mut press, at(way(depth, Real::from(i) * TICK)));
        steps.changes += outputs.adapted.splits + outputs.adapted.merges;
        let tool = outputs.tools[0];
        if next.as_ref().is_some_and(|(at, _)| *at == i) {
            found = next.take().and_then(|(_, stiffness)| stiffness);
        }
        let now = *local.update(&tool, &found);
        if i % 32 == 0 {
            next = Some((i + ANSWERED, probe.stiffness(&press.snapshot())[0]));
        }
        let touches = tool.contact_points > 0;
        if let Some((last, touched)) = before.filter(|(last, _)| last.range > 0.0 && now.range > 0.0) {
            let k = matrix(&last);
            let unfelt = NOTICEABLE.0.max(NOTICEABLE.1 * tool.state.force.norm());
            let felt = |m: &LocalModel, x: Vec3| {
                let f = m.force - matrix(m) * (x - m.position);
                if f.dot(&m.normal) > 0.0 { f } else { Vec3::zeros() }
            };
            let beyond = if touched && touches { now.force - felt(&last, now.position) } else { Vec3::zeros() };
            let ahead = now.position - now.normal * 1e-3;
            let stiffest = matrix(&now).symmetric_eigenvalues().max().max(k.symmetric_eigenvalues().max());
            let change = (matrix(&now) - k).symmetric_eigenvalues().amax();
            let step = (felt(&now, ahead) - felt(&last, ahead)).norm();
            steps.force = steps.force.max(beyond.norm() / unfelt);
            steps.ahead = steps.ahead.max(step / unfelt);
            steps.stiffness = steps.stiffness.max(change / stiffest);
            steps.borders += u32::from(touches != touched);
        }
        before = Some((now, touches));
    }
    println!("{steps:?}");
    assert!(steps.changes > 20 && steps.borders >= 3, "there is something to feel");
    steps
}

#[test]
fn neither_force_nor_stiffness_makes_a_step() {
    let setup = adaptive_cube(&["tool.radius=0.01", "material.damping_ratio=0.15"]);
    for (coupling, depth) in [(1.0 / 700.0, 0.005), (0.0, 0.003)] {
        let steps = run(&setup, coupling, depth);
        assert!(steps.force < 1.0 && steps.ahead < 1.0 && steps.stiffness < STEP, "{steps:?}");
    }
}

/// A body that stands still for a tick, because the budget did not cover it, leaves the tool to go on alone: what it then
/// has to catch up with does not come in one blow.
#[test]
fn a_tick_in_which_the_body_stands_still_is_not_felt() {
    let cube = adaptive_cube(&["tool.radius=0.01", "body.cells=[[4,4,4],[8,8,8],[14,14,14]]"]);
    let largest_step = |every: u32| {
        let mut press = simulation(&cube);
        tick(&mut press, attach());
        let (mut last, mut worst, mut still) = (Vec3::zeros(), 0.0 as Real, 0);
        for i in 0..250u32 {
            // Down at 80 mm/s.
            let mut now = inputs(&[Some(at(TOP + Vec3::z() * (0.022 - 0.08 * Real::from(i) * TICK)))]);
            if i > 180 && i.is_multiple_of(every) {
                now.budget = Budget::of(0);
            }
            let outputs = press.advance(&now);
            still += u32::from(outputs.plan.taken < outputs.plan.needed);
            let force = outputs.tools[0].state.force;
            if i > 180 {
                worst = worst.max((force - last).norm() / (NOTICEABLE.1 * force.norm()).max(NOTICEABLE.0));
            }
            last = force;
        }
        (worst, still)
    };
    let (without, with) = (largest_step(u32::MAX), largest_step(7));
    println!(
        "largest step {:.2} of what may be felt, {:.2} with {} ticks of standing still",
        without.0, with.0, with.1
    );
    assert!(without.1 == 0 && with.1 > 8);
    assert!(with.0 < without.0 + 0.6, "a step of {:.2} of what may be felt", with.0);
}

/// Largest step of the contact's force from tick to tick over what may be felt, 5 % of it or 10 mN, and that in newtons, of the
/// only tool, from tick `from` on.
fn largest_step(setup: &Setup, budget: u32, ticks: std::ops::Range<u32>, at: impl Fn(Real) -> ToolEvent) -> [Real; 2] {
    let mut press = simulation(setup);
    tick(&mut press, attach());
    let (mut last, mut over, mut step) = (Vec3::zeros(), 0.0 as Real, 0.0 as Real);
    for i in 0..ticks.end {
        let event = at(Real::from(i) * TICK);
        let force = press.advance(&Inputs { budget: Budget::of(budget), ..inputs(&[Some(event)]) }).tools[0]
            .state
            .physical_force;
        if i > ticks.start {
            over = over.max((force - last).norm() / (0.05 * last.norm()).max(0.01));
            step = step.max((force - last).norm());
        }
        last = force;
    }
    assert!(last.norm() > 0.005, "there is something to feel");
    [over, step]
}

/// What of the surface gets inside of an edge or a corner may come out of it at another side: however slowly that happens,
/// nothing is felt of it at once, also on elements much larger than the tool.
#[test]
fn an_edge_and_a_corner_pressed_in_make_no_step_on_any_mesh() {
    let rounding = 0.0005;
    let quarter = 0.25 * std::f64::consts::PI;
    let edge: ToolShape = block(Vec3::new(-0.004, 0.0, 0.0), Vec3::new(0.008, 0.01, 0.01), rounding).into();
    let corner: ToolShape = block(Vec3::zeros(), Vec3::repeat(0.01), rounding).into();
    let (along, upright) = (quaternion(Vec3::x(), quarter), quaternion(Vec3::new(1.0, -1.0, 0.0), 0.9553));
    let coarse = "[[4,4,4]]";
    for (name, shape, turned, depth, cells) in [
        ("edge", &edge, along, 0.003, coarse),
        ("edge", &edge, along, 0.006, coarse),
        ("corner", &corner, upright, 0.01, coarse),
        ("corner", &corner, upright, 0.01, "[[4,4,4],[7,7,7],[12,12,12]]"),
    ] {
        for time in [0.3, 1.2] {
            let mut cube = scene(&["material.damping_time=0.01", &format!("body.cells={cells}")]);
            cube.settings.tools[0].shape = shape.clone();
            let place = TOP + Vec3::new(0.008, 0.016, rounding);
            let ticks = (time / TICK) as u32;
            let [over, step] = largest_step(&cube, u32::MAX, ticks / 3..ticks + 200, |t| {
                posed(place - Vec3::z() * ((depth + 0.002) * ease(t, 0.0, time) - 0.002), turned)
            });
            println!(
                "{name} {depth} m deep within {time} s on {cells}: {:.1} mN, {over:.2} of what is felt",
                1e3 * step
            );
            assert!(over < 1.0, "{name} {depth} m deep on {cells}: {over}");
        }
    }
}

/// A tip much thinner than elements and triangles feels more here than there. It does so by its way alone: as slow again by
/// four, with a quarter of the way in a tick, it feels steps of a third or so, also where only coarse elements are
/// used; a step of the force in place would be felt whole.
#[test]
fn the_force_of_a_thin_tip_is_continuous_along_its_way() {
    for (radius, depth, finest) in [(0.0005, 0.002, 2), (0.0005, 0.002, 0), (0.00125, 0.003, 0), (0.002, 0.006, 2)] {
        let finest = format!("resolution.finest_level={finest}");
        let cells = "body.cells=[[5,5,5],[9,9,9],[17,17,17]]";
        let mut cube = scene(&["material.damping_time=0.01", cells, &finest]);
        cube.settings.tools[0].shape = ToolShape::ball(radius);
        // 40 mm, at 0.1 m/s and at a quarter of that.
        let steps = [0.4, 1.6].map(|time| {
            largest_step(&cube, u32::MAX, 601..600 + (time / TICK) as u32, |t| {
                let x = -0.02 + 0.04 * ((t - 0.6) / time).clamp(0.0, 1.0);
                at(TOP + Vec3::new(x, 0.003, radius + 0.002 - (depth + 0.002) * ease(t, 0.0, 0.5)))
            })[1]
        });
        let [fast, slow] = steps.map(|s| 1e3 * s);
        println!("ball of {radius} m, {depth} m deep, {finest}: {fast:.1} mN at 0.1 m/s, {slow:.1} mN at a quarter");
        assert!(slow < 0.5 * fast || fast < 1.0, "{radius}: {slow} of {fast} mN");
    }
}
