//! The work budget: resolution gives way to it, the rate and the hand's safety never do.

use super::*;
use palpate_core::ids::Slot;
use palpate_core::math::is_finite;
use palpate_core::simulation::{MOST_FROZEN, Outputs};
use palpate_core::stepping::work::{self, Part, Prices};

fn hold(i: u64) -> Inputs {
    if i == 0 {
        return inputs(ATTACH);
    }
    let t = i as Real * TICK;
    inputs(ball_at(Vec3::new(0.05, 0.05, SIDE + 0.01 - (-0.003 + 0.009 * ease(t, 0.0, 0.4)))))
}

/// Prices by which elements, nodes and rows take eight times as long as on a common machine, so that contact does not outweigh
/// them.
fn dear() -> Prices {
    let mut prices = Prices::COMMON;
    for part in Part::ALL {
        if matches!(part, Part::Element(_) | Part::Node | Part::Row | Part::Support) {
            prices.0[part.index()] *= 8;
        }
    }
    prices
}

#[test]
fn a_budget_cut_coarsens_and_no_tick_is_lost_or_too_dear() {
    let mut cube = elastic_cube(2e4, true);
    (cube.damping_ratio, cube.spacings) = (0.15, vec![0.060, 0.034, 0.020, 0.0115]);
    let body = cube.body();
    report(&body);
    let mut settings = settings(Some(Adaptivity { split: 0.02, reach: 1.0, ..Adaptivity::default() }));
    settings.limits = ForceLimits { force: 3.3, torque: 0.2, slew: 1000.0 };
    let mut press = simulation(&body, &settings, uniform(&body, 0));
    let active = |o: &Outputs| o.active.iter().sum::<u32>();

    // What it takes when nothing is scarce.
    (0..900).for_each(|i| {
        press.advance(&hold(i));
    });
    let full = press.advance(&hold(900)).clone();
    let before = active(&full);
    // Ample first, then about what the coarsest level takes under the ball.
    let (budget, least) = (2_600_000, 500_000);
    println!("{before} active, {} elements, {:?}; budget {budget}, then {least}", full.elements, full.plan);

    let (mut dearest, mut fewest, mut still) = (0, u32::MAX, 0);
    let (mut in_a_row, mut longest) = (0, 0);
    let mut last = full.tools[0].state;
    let mut physical = 0.0 as Real;
    let mut recovered = 0;
    for i in 901..3500 {
        let allowed = if (1200..2200).contains(&i) { least } else { budget };
        let o = press.advance(&Inputs { budget: Budget::of(allowed), prices: Some(dear()), ..hold(i) });
        assert_eq!(o.tick, i + 1, "no tick is lost");
        assert!(!o.restored);
        // Only one that has stood still for too long may take more.
        let forced = in_a_row == MOST_FROZEN;
        in_a_row = if o.plan.taken == 0 { in_a_row + 1 } else { 0 };
        longest = longest.max(in_a_row);
        if (1200..2200).contains(&i) {
            dearest = dearest.max(if forced { 0 } else { o.plan.whole });
            fewest = fewest.min(active(o));
            still += u32::from(o.plan.taken == 0);
            if i % 200 == 0 || i < 1205 {
                println!("tick {i}: {:?} of {allowed}, {:?}, {} active", o.plan, o.adapted, active(o));
            }
        }
        let tool = o.tools[0].state;
        assert!(is_finite(&tool.force) && is_finite(&tool.physical_force));
        assert!((tool.force - last.force).norm() <= settings.limits.slew * TICK * (1.0 + 1e-9));
        assert!(tool.force.norm() <= settings.limits.force * (1.0 + 1e-9));
        physical = physical.max((tool.physical_force - last.physical_force).norm());
        last = tool;
        recovered = active(o);
    }
    println!(
        "with less {dearest} ns in the dearest tick; {fewest} active at least and {still} ticks without a step, at most \
         {longest} in a row; {recovered} active in the end; the force changes by up to {:.1} mN a tick",
        physical * 1e3
    );
    assert!(fewest < before / 2, "resolution gives way");
    assert!(recovered > before * 3 / 4, "and comes back");
    // While what is too much is shed the body stands still and the force keeps its value; that must end soon.
    assert!(still < 60 && longest <= MOST_FROZEN, "{still} ticks without a step, {longest} in a row");
    assert!(dearest <= least, "{dearest} ns in one tick");
    // 0.99 N; on the next ticks it goes to what the coarse level feels like.
    assert!(physical < 0.05 * 0.99, "the force changes by {physical} N in a tick");
}

/// Where hardly more than the coarsest level fits, elements are merged all the same: whatever part of the body a tick looks at that
/// has to move, in the end it is every one.
#[test]
fn a_body_that_has_to_shed_nearly_all_of_it_gets_there() {
    let mut cube = elastic_cube(2e4, true);
    (cube.damping_ratio, cube.spacings) = (0.15, vec![0.060, 0.034, 0.020, 0.0115]);
    let body = cube.body();
    let settings = settings(Some(Adaptivity { split: 0.02, reach: 1.0, ..Adaptivity::default() }));
    let run = |ticks: std::ops::Range<u64>, budget: u32, press: &mut Simulation| -> u32 {
        let mut still = 0;
        for i in ticks {
            let o = press.advance(&Inputs { budget: Budget::of(budget), prices: Some(dear()), ..hold(i) });
            still += u32::from(o.plan.taken == 0);
        }
        println!("{still} ticks without a step, {:?} active", press.mesh().set().count());
        still
    };
    let fixed = Settings { adaptivity: None, ..settings.clone() };
    let mut coarsest = simulation(&body, &fixed, uniform(&body, 0));
    run(0..900, u32::MAX, &mut coarsest);
    let taken = coarsest.outputs().plan.whole + work::of_frame(&dear());
    let mut press = simulation(&body, &settings, uniform(&body, 0));
    run(0..900, u32::MAX, &mut press);
    let before = press.outputs().active.iter().sum::<u32>();
    let still = run(900..1900, taken / 10 * 11, &mut press);
    let after = press.outputs().active.iter().sum::<u32>();
    assert!(before > 200 && after < before / 4 && still < 400, "{before} active, then {after}; {still} without a step");
}

/// On a machine that becomes half as fast no tick takes more than its budget, but one in six while much has to go; and neither
/// the contact nor the hand gets a blow, though a ball is pressed in by more than its radius and the elements left are larger.
#[test]
fn a_liver_on_a_machine_that_becomes_half_as_fast_sheds_within_every_ticks_means() {
    let body = liver(0.45, vec![0.026, 0.015, 0.0085, 0.005], 5e3, 0.15);
    report(&body);
    let budget = 700_000;
    for down in [0.012, 0.016, 0.02] {
        let press_at = |i: u64| {
            let down = down * ease(i as Real * TICK, 0.1, 0.5);
            if i == 0 { inputs(ATTACH) } else { inputs(ball_at(Vec3::new(-0.01, 0.002, 0.12 - down))) }
        };
        let adaptivity = Adaptivity { reach: 3.0, ..Adaptivity::default() };
        let mut press = simulation(&body, &settings(Some(adaptivity)), uniform(&body, 0));
        let mut before = press.advance(&press_at(0)).clone();
        for i in 1..700 {
            before = press.advance(&Inputs { budget: Budget::of(2 * budget), ..press_at(i) }).clone();
        }
        let (mut dearest, mut still, mut steps, mut last) = (0, 0, [0.0 as Real; 2], before.clone());
        let mut in_a_row = 0;
        for i in 700..1400 {
            let o = press.advance(&Inputs { budget: Budget::of(budget), ..press_at(i) }).clone();
            dearest = dearest.max(if in_a_row == MOST_FROZEN { 0 } else { o.plan.whole });
            in_a_row = if o.plan.taken == 0 { in_a_row + 1 } else { 0 };
            assert!(in_a_row <= MOST_FROZEN);
            still += u32::from(o.plan.taken == 0);
            let [now, was] = [&o, &last].map(|o| [o.tools[0].state.physical_force, o.tools[0].state.force]);
            for (step, (now, was)) in steps.iter_mut().zip(now.iter().zip(&was)) {
                *step = step.max((now - was).norm() / was.norm());
            }
            last = o;
        }
        let active = |o: &Outputs| o.active.iter().sum::<u32>();
        println!(
            "{} active and {} ns, then {} and {} on {budget}: {dearest} in the dearest tick, {still} without a step; the \
             contact's force changes by up to {:.1} % a tick, the rendered one by {:.1} %",
            active(&before),
            before.plan.needed,
            active(&last),
            last.plan.needed,
            100.0 * steps[0],
            100.0 * steps[1]
        );
        // Ticks that end a frame have to fit, too.
        let frame = Prices::COMMON.of(Part::Frame, 1);
        assert!(before.plan.needed + frame > budget && active(&last) < active(&before), "there is something to shed");
        assert!(dearest <= budget, "{dearest} ns in one tick");
        assert!(still < 250 && last.plan.taken == last.plan.needed, "{still} ticks without a step");
        assert!(steps.iter().all(|step| *step < 0.05), "the force changes by {steps:?} of it in a tick");
    }
}

/// Room for elements is what a session is given, not a part of it: a press reaches the finest level on a small body, too.
#[test]
fn a_small_body_is_refined_as_far_as_a_large_one() {
    for spacings in [vec![0.034, 0.021], vec![0.040, 0.024, 0.0145], vec![0.034, 0.020, 0.012]] {
        let body = Cube { spacings, damping_ratio: 0.15, ..elastic_cube(1e4, true) }.body();
        report(&body);
        let mut press = simulation(&body, &settings(Some(Adaptivity::default())), uniform(&body, 0));
        (0..800).for_each(|i| {
            press.advance(&hold(i));
        });
        let count = press.mesh().set().count();
        println!("active by level under the tool: {count:?}");
        assert!(count[body.finest()] >= 8, "the contact is not on the finest level: {count:?}");
    }
}

/// Nodes on which more than a fiftieth of what the tool presses with is held, unless the body has to shed load.
fn unsettled(press: &Simulation, budget: u32) -> Vec<Node> {
    let (mesh, points) = (press.mesh(), &press.snapshot().points[0]);
    let pressed: Real = points.iter().map(|p| p.multiplier).sum();
    let needed = press.outputs().plan.needed.saturating_add(work::of_rest(&Prices::COMMON, true));
    let sheds = pressed <= 0.0 || needed > budget;
    let unsettled = mesh.active().iter().filter(|s| !sheds && mesh.residual(**s).norm() > 0.02 * pressed);
    unsettled.map(|s| mesh.node(*s)).collect()
}

/// Where the budget is the limit, what strain asks for elsewhere gives way to where the tool is.
#[test]
fn on_a_short_budget_the_fine_levels_follow_a_stroke() {
    let body = liver(0.45, vec![0.023, 0.015, 0.0085, 0.005], 5e3, 0.15);
    report(&body);
    // Down by 12 mm, then to and fro over 50 mm, at up to 0.1 m/s.
    let stroke = |i: u64| {
        let t = i as Real * TICK;
        let x = -0.025 * (4.0 * (t - 0.6).max(0.0)).cos();
        if i == 0 { inputs(ATTACH) } else { inputs(ball_at(Vec3::new(x, 0.002, 0.12 - 0.02 * ease(t, 0.1, 0.6)))) }
    };
    let mut needed = 0;
    for budget in [u32::MAX, 1_500_000, 1_150_000] {
        let mut press = simulation(&body, &settings(Some(Adaptivity::default())), uniform(&body, 0));
        let mut under = vec![0; body.levels().len()];
        let (mut changes, mut still, mut last, mut step) = (0, 0, [Vec3::zeros(); 2], 0.0 as Real);
        let (mut bends, mut held) = (0.0, 0);
        for i in 0..4000 {
            let unsettled = unsettled(&press, budget);
            let o = press.advance(&Inputs { budget: Budget::of(budget), ..stroke(i) }).clone();
            // Changed before it has settled it would be strained more each time, until it bursts.
            assert!(unsettled.iter().all(|n| press.mesh().set().is_active(*n)), "tick {i}");
            held += unsettled.len();
            let force = o.tools[0].state.force;
            let [before, first] = last;
            last = [force, before];
            if i < 600 {
                continue;
            }
            step = step.max((force - before).norm() / (0.05 * force.norm()).max(0.01));
            bends += (force - before * 2.0 + first).norm_squared() / force.norm_squared();
            (changes, still) = (changes + o.adapted.splits + o.adapted.merges, still + u32::from(o.plan.taken == 0));
            let spent = o.plan.whole;
            assert!(spent <= budget, "{spent} ns of {budget} in tick {i}");
            needed = o.plan.needed.max(if budget == u32::MAX { needed } else { 0 });
            let (centre, mesh) = (o.tools[0].state.pose.position, press.mesh());
            let distance = |s: Slot| (mesh.position(s) - centre).norm();
            let near = mesh.active().iter().min_by(|a, b| distance(**a).total_cmp(&distance(**b)));
            under[body.level_of(mesh.node(*near.unwrap()))] += 1;
        }
        let shakes = (bends / 3400.0).sqrt();
        println!(
            "{budget} ns a tick, {needed} needed at most without a limit: ticks by level under the tool {under:?}; \
             {changes} changes, {held} nodes that had to settle, {still} without a step; largest step of the force {step:.2} of what may be felt, \
             second differences of {:.2} % of it, rms",
            100.0 * shakes
        );
        if budget == u32::MAX {
            assert!(needed > 1_650_000, "{needed} ns: the budget is not short");
        }
        // One change a tick is all that such a budget has: the finest may be late where the tool turns up.
        assert!(budget < 1_500_000 || under[body.finest()] > 3400 * 11 / 20, "the fine levels stay behind: {under:?}");
        assert!(budget < 1_500_000 || under[0] + under[1] < 3400 / 5, "the tool is on coarse levels: {under:?}");
        assert!(still < 34, "{still} ticks without a step");
        // Deeper than the ball's radius, where walls come and go beside it.
        let [most_step, most_shakes] = if budget == u32::MAX { [0.3, 0.002] } else { [1.0, 0.008] };
        assert!(step < most_step, "the force changes by {step} of 5 % or 10 mN in a tick");
        assert!(shakes < most_shakes, "the force goes up and down by {shakes} of it");
    }
}
