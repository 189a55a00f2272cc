//! Force and local model go on without steps: over triangle borders, changes of resolution, and where contact begins and
//! ends.

use super::*;
use palpate::feedback::LocalModel;
use palpate::feedback::relaxed::Probe;
use palpate::math::Mat3;

/// Step of the force [N], or its part of the force, that a hand does not feel.
const UNFELT: (Real, Real) = (0.010, 0.05);
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
            let unfelt = UNFELT.0.max(UNFELT.1 * tool.state.force.norm());
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
                now.budget = 0;
            }
            let outputs = press.advance(&now);
            still += u32::from(outputs.plan.taken < outputs.plan.needed);
            let force = outputs.tools[0].state.force;
            if i > 180 {
                worst = worst.max((force - last).norm() / (UNFELT.1 * force.norm()).max(UNFELT.0));
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
