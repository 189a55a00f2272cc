//! What changes while a body is touched: stiffness, gravity, friction, damping and the tool's shape.

use super::*;
use palpate_core::contact::tool::MOST_TOOLS;
use palpate_core::model::element_pool::CLASSES;
use palpate_core::model::step_class::{Strained, omega_squared, stable_step, step_of};
use palpate_core::simulation::{Parameter, ParameterRanges, Threshold};

/// A ball of another tissue below the middle of the top.
const NODULE: &str =
    "material.region=[{name='nodule', centre=[0.05,0.05,0.085], radius=0.012, youngs_modulus=20000.0}]";
const DAMPED: &str = "material.damping_ratio=0.15";
/// Of the rendered force [N/s].
const SLEW: Real = 1000.0;

/// A cube with a nodule, the whole `all` times and the nodule `nodule` times as stiff as above.
fn with_nodule(cube: fn(&[&str]) -> Setup, all: Real, nodule: Real) -> Setup {
    let base = format!("material.youngs_modulus={}", 1e4 * all);
    let region = NODULE.replace("20000.0", &(2e4 * nodule).to_string());
    cube(&[&base, &region, DAMPED, "safety.force_limit=100", &format!("safety.slew_limit={SLEW}")])
}

fn stiffness(tissue: u16, factor: Real) -> Parameter {
    Parameter::Stiffness { tissue, factor }
}

/// Tick `i` of a press that is 3 mm deep from 0.3 s on.
fn press(i: u64) -> Inputs {
    let place = TOP + Vec3::z() * (0.022 - 0.005 * ease(i as Real * TICK, 0.0, 0.3));
    inputs(&[Some(if i == 0 { attach() } else { at(place) })])
}

/// Presses, and sets one of `parameters` a tick from tick `WHEN` on; the force [N] at rest again, and its largest change in a
/// tick from `WHEN` on.
fn pressed(setup: &Setup, parameters: &[Parameter]) -> (Real, Real) {
    let mut press = simulation(setup);
    let (mut last, mut jump) = (0.0, 0.0 as Real);
    for i in 0..1500u64 {
        let parameter = i.checked_sub(WHEN).and_then(|k| parameters.get(k as usize).copied());
        let force = press.advance(&Inputs { parameter, ..self::press(i) }).tools[0].state.force.z;
        if i >= WHEN {
            jump = jump.max((force - last).abs());
        }
        last = force;
    }
    (last, jump)
}

const WHEN: u64 = 500;

fn cube_of_tetrahedra(more: &[&str]) -> Setup {
    cube(&[&["material.elements='tetrahedra'"], more].concat())
}

#[test]
fn tissues_made_stiffer_or_softer_under_a_tool_push_as_if_prepared_so() {
    type Cube = (fn(&[&str]) -> Setup, Real, Real);
    let cubes: [Cube; 7] = [
        (cube, 8.0, 8.0),
        (cube, 0.5, 0.5),
        (adaptive_cube, 2.0, 2.0),
        (cube, 1.0, 4.0),
        (adaptive_cube, 3.0, 1.0),
        (cube_of_tetrahedra, 0.5, 0.5),
        (cube_of_tetrahedra, 1.0, 4.0),
    ];
    for (cube, all, nodule) in cubes {
        let (expected, _) = pressed(&with_nodule(cube, all, nodule), &[]);
        let changed = with_nodule(cube, 1.0, 1.0);
        let (before, _) = pressed(&changed, &[]);
        let (force, jump) = pressed(&changed, &[stiffness(0, all), stiffness(1, nodule)]);
        let off = force / expected - 1.0;
        println!("{all}, {nodule}: {before:.4} N to {force:.4} N, {:+.2} %; {jump:.4} N a tick", 100.0 * off);
        // Where it adapts, the nodes under the tool are others.
        assert!(off.abs() < if all > nodule { 0.02 } else { 0.001 }, "{force} N, prepared so {expected} N");
        assert!((force / before - 1.0).abs() > 0.1 && jump <= SLEW * TICK * (1.0 + 1e-9), "{jump} N in a tick");
    }
}

/// The script of a press in which everything changes, and the body is reset.
fn all_change(i: u64) -> Inputs {
    let parameter = match i {
        350 => Some(stiffness(1, 6.0)),
        351 => Some(stiffness(0, 0.5)),
        400 => Some(Parameter::Gravity(Vec3::new(1.0, 0.0, -5.0))),
        450 => Some(Parameter::Damping(0.3)),
        470 => Some(Parameter::Friction { tool: 0, coefficient: 0.8 }),
        480 => Some(Parameter::Resolution { threshold: Threshold::Split, value: 0.03 }),
        490 => Some(Parameter::Supports(0.4)),
        700 => Some(Parameter::Shape { tool: 0, of: 1 }),
        799 => Some(stiffness(0, 10.0)),
        900 => Some(stiffness(0, 1.0)),
        _ => None,
    };
    let mut inputs = press(i);
    if i > 470
        && let Some(ToolEvent::Pose(sample)) = &mut inputs.tools[0]
    {
        sample.pose.position.x += 0.02 * ease(i as Real * TICK, 0.47, 0.9);
    }
    Inputs { parameter, reset: i == 800, ..inputs }
}

/// Held by springs instead of nodes that do not move.
const SPRINGS: &str = "hold=[{min=[0,0,0], max=[0.1,0.1,0], stiffness=1e6}]";

#[test]
fn restored_after_any_change_it_goes_on_bit_for_bit() {
    let cube = |more: &[&str]| adaptive_cube(&[&[SPRINGS, SHAPES], more].concat());
    restored_after_any_change(&with_nodule(cube, 1.0, 1.0), true);
}

#[test]
fn so_do_tetrahedra_alone() {
    let cube = |more: &[&str]| adaptive_cube(&[&[SPRINGS, SHAPES, "material.elements='tetrahedra'"], more].concat());
    restored_after_any_change(&with_nodule(cube, 1.0, 1.0), false);
}

fn restored_after_any_change(setup: &Setup, smoothed: bool) {
    let hashes = |simulation: &mut Simulation, from: u64| -> Vec<u64> {
        let run = |i| {
            simulation.advance(&all_change(i));
            simulation.hash()
        };
        (from..1000).map(run).collect()
    };
    let whole = hashes(&mut simulation(setup), 0);
    let mut run = simulation(setup);
    let mut copy = simulation(setup);
    for i in 0..1000u64 {
        if [350, 351, 355, 401, 460, 600, 800, 801, 802, 901].contains(&i) {
            let snapshot = run.snapshot();
            // Elements follow one after another, then stars, and are found half-way.
            let follow = snapshot.stiffening.reached < u32::MAX;
            assert!(follow || ![355, 800, 901].contains(&i), "tick {i}");
            assert!(!follow || smoothed || [355, 800, 901].contains(&i), "tick {i}");
            assert!(!follow || ![350, 600].contains(&i), "tick {i}");
            let restored = || {
                let again = Simulation::new(setup.body.clone(), setup.settings.clone(), snapshot.clone()).unwrap();
                again.with_reset_state(&setup.rest.body).unwrap()
            };
            assert_eq!(hashes(&mut restored(), i), whole[i as usize..], "from tick {i}");
            // One that other changes have been made to takes over all the same.
            copy.load(&snapshot);
            assert_eq!(copy.hash(), run.hash());
            assert_eq!(copy.advance(&all_change(i)).tools, restored().advance(&all_change(i)).tools, "from tick {i}");
        }
        run.advance(&all_change(i));
    }
    assert_eq!(run.parameters().len(), 8);
}

#[test]
fn a_body_that_was_made_stiff_is_stable_after_a_reset() {
    let setup = with_nodule(adaptive_cube, 1.0, 1.0);
    let mut run = simulation(&setup);
    for i in 0..1500u64 {
        let parameter = [stiffness(0, 20.0), stiffness(1, 20.0)].get(i as usize).copied();
        let outputs = run.advance(&Inputs { parameter, reset: i % 300 == 299, ..press(i % 300) });
        assert!(!outputs.restored, "tick {i}");
    }
    assert!(fastest(&run) < 0.5, "{} m/s", fastest(&run));
}

#[test]
fn gravity_that_is_set_acts_as_if_the_scene_had_it() {
    let gravity = Vec3::new(0.0, 3.0, -9.81);
    let falls = |simulation: &mut Simulation, parameter| {
        for i in 0..1500u64 {
            simulation.advance(&Inputs { parameter: if i == 0 { parameter } else { None }, ..Inputs::default() });
        }
        let (body, mesh) = (simulation.body().clone(), simulation.mesh());
        let moved = |s: &Slot| mesh.position(*s) - body.rest(mesh.node(*s));
        mesh.active().iter().map(moved).sum::<Vec3>() / mesh.active().len() as Real
    };
    let setup = cube(&[DAMPED]);
    let mut with = setup.settings.clone();
    with.gravity = gravity;
    let expected = falls(&mut Simulation::new(setup.body.clone(), with, setup.rest.clone()).unwrap(), None);
    let mut set = simulation(&setup);
    let found = falls(&mut set, Some(Parameter::Gravity(gravity)));
    assert!(expected.norm() > 1e-4 && found == expected, "{found:?} and {expected:?}");
    assert_eq!(set.settings().gravity, gravity);
}

#[test]
fn a_tool_made_rough_is_held_back_and_a_body_damped_less_swings_longer() {
    let setup = cube(&[DAMPED, "tool.radius=0.015"]);
    let sideways = |parameter: Option<Parameter>| {
        let mut run = simulation(&setup);
        let mut force = Vec3::zeros();
        for i in 0..900u64 {
            let t = i as Real * TICK;
            let place = TOP + Vec3::new(0.03 * (t - 0.4).max(0.0), 0.0, 0.017 - 0.006 * ease(t, 0.0, 0.3));
            let event = Some(if i == 0 { attach() } else { at(place) });
            force = run.advance(&Inputs { parameter: parameter.filter(|_| i == 350), ..inputs(&[event]) }).tools[0]
                .state
                .physical_force;
        }
        force.x / force.z
    };
    let (smooth, rough) = (sideways(None), sideways(Some(Parameter::Friction { tool: 0, coefficient: 0.3 })));
    println!("{smooth:.3} and {rough:.3} of the pressure");
    assert!((smooth - rough - 0.3).abs() < 0.05);

    let swings = |damping: Real| {
        let mut run = simulation(&setup);
        let parameter = Some(Parameter::Damping(damping));
        run.mesh_mut().change_motion(|_, x, v| v.x = 5.0 * x.z);
        run.advance(&Inputs { parameter, ..Inputs::default() });
        let of = |run: &Simulation| energy(run.body(), run.mesh(), Vec3::zeros()).total();
        let before = of(&run);
        (0..200).for_each(|_| {
            run.advance(&Inputs::default());
        });
        of(&run) / before
    };
    let left = [1.0, 0.5, 0.1].map(swings);
    println!("after 0.2 s {left:.4?} of the energy");
    assert!(left[0] < 0.6 * left[1] && left[1] < 0.6 * left[2] && left[2] < 1.0);
}

/// A ball, and shapes for it to take: a larger ball, and a cylinder that stands on end.
const SHAPES: &str = "tool=[{name='ball', radius=0.02}, {name='large', radius=0.0215}, \
     {name='post', shape='cylinder', radius=0.008, length=0.05}]";

#[test]
fn a_tool_that_takes_a_shape_pushes_as_the_tool_that_it_is_of() {
    for (cube, of) in [(cube as fn(&[&str]) -> Setup, 1), (cube, 2), (adaptive_cube, 1), (adaptive_cube, 2)] {
        let setup = cube(&[DAMPED, SHAPES]);
        // From the tick before it comes down on, or the tool of that shape instead.
        let force = |tool: usize, parameter: Option<Parameter>| {
            let mut run = simulation(&setup);
            for i in 0..800u64 {
                let event = press(i).tools[0];
                let mut tools = [None; MOST_TOOLS];
                tools[tool] = event.map(|event| match event {
                    ToolEvent::Pose(mut sample) => {
                        sample.pose.position.z += [0.0, 0.0, -0.02][usize::from(of)];
                        ToolEvent::Pose(sample)
                    }
                    other => other,
                });
                run.advance(&Inputs { parameter: parameter.filter(|_| i == 0), tools, ..Inputs::default() });
            }
            run.tools()[tool].physical_force
        };
        let (own, taken) = (force(usize::from(of), None), force(0, Some(Parameter::Shape { tool: 0, of })));
        println!("{of}: {:.4} and {:.4} N", own.z, taken.z);
        assert!(own.z > 0.05 && own == taken, "{own:?} and {taken:?}");
        assert!(force(0, None) != taken);
    }
}

#[test]
fn a_tool_that_takes_a_larger_shape_inside_the_body_has_to_come_from_outside_again() {
    let setup = cube(&[DAMPED, SHAPES, "safety.force_limit=100", &format!("safety.slew_limit={SLEW}")]);
    let mut run = simulation(&setup);
    let (mut last, mut forces) = (0.0, vec![]);
    for i in 0..2500u64 {
        let parameter = (i == WHEN).then_some(Parameter::Shape { tool: 0, of: 1 });
        // Out from 1.0 to 1.2 s, and in again from 1.4 to 1.7 s.
        let t = i as Real * TICK;
        let place =
            TOP + Vec3::z() * (0.022 - 0.005 * (ease(t, 0.0, 0.3) - 5.0 * ease(t, 1.0, 1.2) + 5.0 * ease(t, 1.4, 1.7)));
        let event = Some(if i == 0 { attach() } else { at(place) });
        let state = run.advance(&Inputs { parameter, ..inputs(&[event]) }).tools[0].state;
        assert!((state.force.z - last).abs() <= SLEW * TICK * (1.0 + 1e-9), "tick {i}");
        assert!(!run.outputs().restored);
        last = state.force.z;
        forces.push(state);
    }
    assert_eq!((forces[499].shape, forces[500].shape), (None, Some(1)));
    assert!(forces[499].force.z > 0.05, "{}", forces[499].force.z);
    // Not one that is felt inside; nothing pushes the body.
    assert!(
        forces[500..1000].iter().all(|state| state.phase == Phase::Waiting && state.physical_force == Vec3::zeros())
    );
    assert!(forces[600..1300].iter().all(|state| state.force == Vec3::zeros()));
    println!("{:?}, {:.3} and {:.3} N", forces[2400].phase, forces[499].force.z, forces[2400].force.z);
    assert!(forces[2400].phase == Phase::Engaged && forces[2400].force.z > 1.5 * forces[499].force.z);
    // The same shape again is no change.
    let again = Some(Parameter::Shape { tool: 0, of: 1 });
    let state = run.advance(&Inputs { parameter: again, ..Inputs::default() }).tools[0].state;
    assert!(state.phase == Phase::Engaged && state.force.z > 0.5, "{state:?}");
    // There is no such shape, and no such tool.
    for parameter in [Parameter::Shape { tool: 0, of: 3 }, Parameter::Shape { tool: 3, of: 0 }] {
        run.advance(&Inputs { parameter: Some(parameter), ..Inputs::default() });
        assert_eq!(run.parameters(), [Parameter::Shape { tool: 0, of: 1 }]);
    }
}

#[test]
fn the_range_of_a_stiffness_ends_where_elements_can_no_longer_be_stepped() {
    let setup = with_nodule(cube, 1.0, 1.0);
    let ranges = ParameterRanges::new(&setup.body, &setup.settings);
    let most = |tissue: u16, set: &[Parameter]| ranges.of(&setup.body, &stiffness(tissue, 1.0), set).map(|r| *r.end());
    assert_eq!(most(0, &[]), Some(20.0));
    assert_eq!(most(2, &[]), None);
    let stiff = cube(&["material.youngs_modulus=1e6"]);
    let ranges = ParameterRanges::new(&stiff.body, &stiff.settings);
    let largest = *ranges.of(&stiff.body, &stiffness(0, 1.0), &[]).unwrap().end();
    let levels = 0..=palpate_core::adaptation::finest_steppable(&stiff.body);
    let of = |e| omega_squared(&stiff.body, &stiff.body.material_of(e).stiffened(largest), e);
    let most = levels.flat_map(|r| stiff.body.elements_of(r)).map(of).fold(0.0, Real::max);
    let step = stable_step(most, Strained::REST, stiff.body.damping_time(), 0.0);
    println!("{largest:.3} times as stiff: {:.3} µs", 1e6 * step);
    assert!((1.0..20.0).contains(&largest) && (step / step_of(CLASSES - 1) - 1.0).abs() < 1e-3);
}

#[test]
fn a_lower_threshold_refines_more_and_the_given_one_coarsens_again() {
    let setup = adaptive_cube(&[DAMPED]);
    let mut run = simulation(&setup);
    let split = |value| Some(Parameter::Resolution { threshold: Threshold::Split, value });
    let elements =
        [None, split(3e-4), split(setup.settings.adaptivity.as_ref().unwrap().split)].map(|mut parameter| {
            (0..1000).for_each(|i| {
                let pressed = press(run.tick().min(500));
                run.advance(&Inputs { parameter: if i == 0 { parameter.take() } else { None }, ..pressed });
            });
            run.outputs().elements
        });
    println!("{elements:?} elements");
    assert!(elements[1] > elements[0] * 5 / 4 && elements[2] < elements[1] * 9 / 10, "{elements:?}");
}

/// A body on springs hangs by its weight over their stiffness.
#[test]
fn supports_made_softer_give_way_by_as_much_more() {
    let setup = cube(&[SPRINGS, DAMPED]);
    let mut run = simulation(&setup);
    let mut settle = |parameters: [Option<Parameter>; 2]| {
        for i in 0..2500 {
            run.advance(&Inputs { parameter: parameters.get(i).copied().flatten(), ..Inputs::default() });
            run.mesh_mut().change_motion(|_, _, v| *v *= 0.99);
        }
        let (body, mesh) = (run.body(), run.mesh());
        let bottom = |s: &&Slot| body.rest(mesh.node(**s)).z == 0.0;
        let down: Vec<Real> = mesh.active().iter().filter(bottom).map(|s| -mesh.position(*s).z).collect();
        down.iter().sum::<Real>() / down.len() as Real
    };
    let hard = settle([Some(Parameter::Gravity(Vec3::new(0.0, 0.0, -2.0))), None]);
    let soft = settle([Some(Parameter::Supports(0.2)), None]);
    let weight = setup.body.mass() * 2.0 / 1e4;
    println!("{:.3} mm and {:.3} mm of {:.3} mm", 1e3 * hard, 1e3 * soft, 1e3 * weight);
    assert!((hard / weight - 1.0).abs() < 0.1 && (soft / hard - 5.0).abs() < 0.25);
}

/// A ball that sticks, and is pulled aside: all that holds it aside goes, and the hand feels no step of it.
#[test]
fn what_is_set_under_a_tool_makes_no_step_in_the_hand() {
    let setup = cube(&[DAMPED, "tool.radius=0.01", "tool.friction=1.0"]);
    let changes = [Parameter::Friction { tool: 0, coefficient: 0.0 }, Parameter::Supports(0.2)];
    for change in changes.map(Some).into_iter().chain([None]) {
        let mut run = simulation(&setup);
        run.advance(&inputs(&[Some(attach())]));
        let (mut forces, mut step) = ([Vec3::zeros(); 2], 0.0 as Real);
        for i in 0..1000 {
            let t = Real::from(i) * TICK;
            let place = TOP + Vec3::new(0.006 * ease(t, 0.3, 0.6), 0.0, 0.012 - 0.008 * ease(t, 0.0, 0.3));
            let parameter = change.filter(|_| i == 750);
            let force = run.advance(&Inputs { parameter, ..inputs(&[Some(at(place))]) }).tools[0].state.force;
            if i >= 750 {
                step = step.max((force - forces[1]).norm() / (0.05 * force.norm()).max(0.01));
            }
            forces = [if i == 749 { force } else { forces[0] }, force];
        }
        let [before, after] = forces.map(|force| force.x.abs() / force.z);
        println!("{change:?}: {step:.2} of what may be felt; aside {before:.3}, then {after:.3} of the pressure");
        assert!(step < 1.0 && before > 0.3);
        assert_eq!(after < 0.02, matches!(change, Some(Parameter::Friction { .. })));
    }
}
