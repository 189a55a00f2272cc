//! The claims of the paper in short: what study `claims` shows at length, on smaller bodies and for less time.

use palpate_body::geometry::primitives::liver_surface;
use palpate_core::math::Real;
use palpate_study::claims::{behaviours, holding, indicators, machines, mixes, modes, releases, swings, tool_loop};
use palpate_study::coupling::Coupling;
use palpate_study::laws::Law;
use palpate_study::levels::Levels;
use palpate_study::oscillate::{damped, material};
use palpate_study::touch::organ_stroke;
use palpate_study::trial::{balanced, body_of};

/// Figures 4 and 5: on meshes as they are all laws swing farther apart than the core on the same meshes.
#[test]
fn three_resolutions_swing_closer_together_in_the_core_than_under_any_printed_law() {
    let levels = swings::cube(&[2, 3, 4], material());
    let apart = |method| {
        let c = swings::compare(&levels, method, 1.0, 5.0).unwrap();
        println!("{}: depth {:.3}, period {:.3}, rms {:.3}", method.name(), c.depth, c.period, c.apart);
        c
    };
    let core = apart(swings::Method::Core);
    assert!(core.period < 0.05);
    for law in [Law::MassSpring, Law::Cauchy, Law::Green] {
        assert!(apart(swings::Method::Plain(law)).apart > 1.5 * core.apart, "{law:?}");
    }
}

/// Section 6: stable "even when no damping is applied".
#[test]
fn mixed_levels_without_damping_blow_up_coupled_by_forces_and_keep_their_energy_in_the_core() {
    let levels = Levels::of_box(palpate_core::math::Vec3::repeat(1.0), &[[2; 3], [3; 3], [5; 3]], material(), false);
    let run = |method| {
        let run = mixes::let_go(&levels, method, 0, 5.0).unwrap();
        println!("{method:?}: drift {:.1e}, blown up {:?}", run.drift, run.blown);
        run
    };
    for law in [Law::Cauchy, Law::Green] {
        assert!(run(mixes::Method::Plain(law, Coupling::Force)).drift > 0.1, "{law:?}");
        assert!(run(mixes::Method::Plain(law, Coupling::Energy)).drift < mixes::KEPT, "{law:?}");
    }
    assert!(run(mixes::Method::Core).drift < mixes::KEPT);
}

/// The abstract: damped modes are "nearly unchanged for several levels of refinement".
#[test]
fn damped_modes_are_those_of_the_finest_level_on_every_level_of_the_core_and_on_mixed_ones() {
    let levels = Levels::of_box(palpate_core::math::Vec3::repeat(1.0), &[[2; 3], [4; 3]], damped(modes::TAU), true);
    let body = body_of(&levels, 0.0, 1).unwrap();
    let mixed = balanced(&body, &levels, &levels.random_active_set(0));
    let frequency = |on: &modes::On| modes::measure(&levels, on, &modes::MODES[0], 2.0).unwrap().0;
    let finest = frequency(&modes::On::Core(body.nodes_of(1).collect()));
    for nodes in [body.nodes_of(0).collect(), mixed] {
        let off = frequency(&modes::On::Core(nodes)) / finest - 1.0;
        assert!(off.abs() < swings::NEARLY, "{off}");
    }
    let off = frequency(&modes::On::Plain(0)) / frequency(&modes::On::Plain(1)) - 1.0;
    assert!(off > swings::NEARLY, "as printed the coarse level is stiffer, by {off}");
}

/// Section 3.3, eq. 9.
#[test]
fn under_a_tool_at_rest_strain_jump_finds_where_resolution_is_needed() {
    let (_, seen) = indicators::watch([4, 8]).unwrap();
    for ((_, moment), seen) in indicators::MOMENTS.iter().zip(&seen) {
        let of = |values: &[Real]| {
            (indicators::rank_correlation(values, &seen.truth), indicators::found(values, &seen.truth))
        };
        println!("{moment}: γ {:.2?}, strain jump {:.2?}", of(&seen.gamma), of(&seen.jump));
    }
    let rest = &seen[1];
    assert!(indicators::found(&rest.jump, &rest.truth) >= 0.5);
    let correlation = |values: &[Real]| indicators::rank_correlation(values, &rest.truth);
    assert!(correlation(&rest.jump) > correlation(&rest.gamma) - 0.1);
}

/// Section 4.2 and figure 7.
#[test]
fn the_printed_loop_answers_a_tool_in_steps_and_the_core_without() {
    let levels = tool_loop::cube(&[3, 6], tool_loop::TAU);
    let (printed, core) = (tool_loop::printed(&levels, 0.9), tool_loop::core(&levels, true, 0.9).unwrap());
    let (ours, theirs) = (core.resting(|r| r.sum), printed.resting(|r| r.sum));
    println!(
        "{theirs:.3} N printed, {ours:.3} N by the core; steps {:.3} and {:.3}",
        printed.largest_step(),
        core.largest_step()
    );
    assert!(printed.blown.is_none() && core.blown.is_none());
    assert!(theirs > 1.1 * ours, "all colliding points are held");
    assert!(printed.largest_step() > 0.07 && core.largest_step() < 0.07 && core.finest > 0.95);
}

/// Section 4.2, the areas: weighted by parts of the nodes' areas the forces of points that are held sum to what the nodes
/// transmit, less than the 0.0642 N of a ball without friction; weighted by areas, or by parts of the collision's, to less and
/// less as mesh and display are refined.
#[test]
fn move_and_hold_answers_less_than_the_continuum_and_its_weights_make_no_force() {
    let [coarse, fine] = [4e-3, 2e-3].map(|spacing| holding::move_and_hold(spacing, spacing, 1e-3));
    println!("{coarse:?}, {fine:?}");
    assert!((fine.part / fine.sum - 1.0).abs() < 1e-9, "parts of the nodes' areas sum to one");
    assert!((0.04..0.0642).contains(&fine.sum));
    assert!(fine.area < 0.4 * coarse.area && fine.mean < 0.4 * coarse.mean);
}

/// Section 5: "nice oscillations when the tool is removed".
#[test]
fn an_adaptive_body_swings_on_like_a_fine_one_when_the_tool_is_removed() {
    let run = |adaptive| releases::release(&[3, 6], 0.02, adaptive, 800).unwrap();
    let (adaptive, fine) = (run(true), run(false));
    let off = releases::swing(&adaptive).0 / releases::swing(&fine).0 - 1.0;
    println!("frequency {:+.2} %, {} passes", 100.0 * off, releases::passes(&adaptive));
    assert!(off.abs() < 0.02 && releases::passes(&adaptive) > 4 && !adaptive.restored);
}

/// Figure 8.
#[test]
fn one_organ_is_jelly_that_springs_back_or_tissue_that_creeps_back() {
    let on = behaviours::organ(&[0.026, 0.016]).unwrap();
    let of = |name: &str| {
        let behaviour = behaviours::BEHAVIOURS.iter().find(|b| b.name == name).unwrap();
        let shown = behaviours::show(&on, behaviour, 600).unwrap();
        println!("{name}: {:.4} N, passes its rest {} times", shown.peak(), shown.passes());
        assert!(!shown.restored);
        shown
    };
    let [slime, jelly, tissue] = ["slime", "jelly", "tissue"].map(of);
    assert!(jelly.passes() >= 3 && tissue.passes() <= 1);
    assert!(jelly.peak() > 20.0 * slime.peak() && tissue.peak() > 2.0 * jelly.peak());
}

/// Section 3.3: a guaranteed rate, "regardless of computational platform".
#[test]
fn on_machines_of_other_speed_every_tick_fits_and_only_resolution_differs() {
    let on = organ_stroke(liver_surface(0.008), &[0.026, 0.015, 0.0085], 5e3).unwrap();
    let [fast, slow, again] = [1.0, 3.0, 3.0].map(|slowness| machines::stroke(&on, Some(slowness)).unwrap());
    let mean = |s: &machines::Stroked| s.nodes.iter().map(|n| n.1).sum::<Real>() / s.nodes.len() as Real;
    println!("{:.0} and {:.0} nodes, still {:?} and {:?}", mean(&fast), mean(&slow), fast.still, slow.still);
    assert!(fast.late == 0 && slow.late == 0);
    assert!(mean(&slow) < 0.8 * mean(&fast));
    assert!(slow == again, "the same inputs, the same bits");
}
