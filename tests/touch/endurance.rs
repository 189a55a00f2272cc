//! Nothing that a client or the machine does breaks the body or the hand, and the same inputs give the same bits.

use super::*;

/// Splitmix64: any seed gives its own sequence.
struct Random(u64);

impl Random {
    fn bits(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let z = (self.0 ^ (self.0 >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        let z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    fn between(&mut self, low: Real, high: Real) -> Real {
        low + (high - low) * (self.bits() >> 11) as Real / (1u64 << 53) as Real
    }

    fn below(&mut self, count: u64) -> u64 {
        self.bits() % count
    }

    fn place(&mut self) -> Vec3 {
        Vec3::from_fn(|_, _| self.between(-0.05, 0.15))
    }

    fn orientation(&mut self) -> [Real; 4] {
        normalized_quaternion(std::array::from_fn(|_| self.between(-1.0, 1.0))).unwrap_or(UPRIGHT)
    }
}

#[test]
fn a_jump_of_a_metre_moves_the_tool_at_its_limit_and_harms_nothing() {
    let jumps = [Vec3::x(), -Vec3::x(), Vec3::z(), -Vec3::z(), Vec3::new(0.6, 0.0, -0.8)];
    for jump in jumps {
        let mut press = simulation(&cube(&["tool.radius=0.01"]));
        let (speed, limits) = (press.settings().following.speed, press.settings().limits);
        tick(&mut press, attach());
        let (mut fastest, mut rendered, mut slew, mut physical) = (0.0 as Real, 0.0 as Real, 0.0 as Real, 0.0 as Real);
        for i in 0..1400 {
            let t = i as Real * TICK;
            let place = TOP + Vec3::z() * (0.011 - 0.005 * ease(t, 0.0, 0.3));
            let before = press.snapshot().tools[0];
            let outputs = tick(&mut press, at(if i < 350 { place } else { place + jump }));
            let tool = outputs.tools[0].state;
            assert!(!outputs.restored && is_finite(&tool.physical_force), "jump {jump:?}, tick {i}");
            if i > 0 {
                fastest = fastest.max((tool.pose.position - before.pose.position).norm() / TICK);
            }
            rendered = rendered.max(tool.force.norm());
            slew = slew.max((tool.force - before.force).norm() / TICK);
            physical = physical.max(tool.physical_force.norm());
            assert!(press.snapshot().body.is_finite());
        }
        let left = rest_distance(&press);
        println!(
            "{:?}: {fastest:.6} m/s, rendered {rendered:.3} N (physical {physical:.2} N), {slew:.0} N/s; {:.2} mm from \
             rest",
            jump.as_slice(),
            left * 1e3
        );
        assert!(fastest <= speed * (1.0 + 1e-9) && fastest > 0.99 * speed);
        assert!(rendered <= limits.force * (1.0 + 1e-9) && slew <= limits.slew * (1.0 + 1e-9));
    }
}

/// What a wild client does with a tool.
enum Way {
    Jump(Vec3),
    Stab(Vec3, Vec3),
    Shake,
    Silent,
}

#[test]
fn twenty_wild_clients_never_break_the_body_and_it_recovers() {
    let tools =
        "tool=[{name='ball', radius=0.01}, {name='rod', radius=0.005, length=0.08}, {name='tip', radius=0.001}]";
    let damped = "material.damping_time=0.01";
    // A display surface finer than the level that moves, and one as coarse.
    let cubes = [cube(&["body.active_level=0", damped, tools]), cube(&["body.cells=[[2,2,2],[4,4,4]]", damped, tools])];
    assert!(cubes.iter().all(|cube| cube.0.level().mesh.elements.len() == 384));
    let limit = cubes[0].1.limits.force * (1.0 + 1e-9);
    let (mut worst_left, mut worst_bend, mut worst_force) = (0.0 as Real, 0.0 as Real, 0.0 as Real);
    for seed in 0..20 {
        let mut random = Random(seed);
        let mut wild = simulation(&cubes[seed as usize % 2]);
        let mut ways = [const { Way::Silent }; 3];
        let mut until = [0; 3];
        let mut turned = [UPRIGHT; 3];
        let mut physical = 0.0 as Real;
        let mut bend = 0.0 as Real;
        for i in 0..2000 {
            let mut events = [None; 3];
            for tool in 0..3 {
                if i >= until[tool] {
                    until[tool] = i + 5 + random.below(200);
                    turned[tool] = random.orientation();
                    let place = random.place();
                    (ways[tool], events[tool]) = match random.below(10) {
                        0 => (Way::Silent, Some(ToolEvent::Detach)),
                        1 => (Way::Silent, None),
                        2 | 3 => (Way::Shake, Some(ToolEvent::Attach { epoch: 1, period_ticks: 1 + i as u32 % 20 })),
                        4 | 5 => (Way::Jump(place), None),
                        6 => (Way::Shake, None),
                        _ => {
                            // From outside through the middle and out again.
                            let way = Vec3::from_fn(|_, _| random.between(-1.0, 1.0)).normalize();
                            (Way::Stab(Vec3::repeat(0.05) - way * 0.12, way * (1e-3 * random.between(0.3, 1.2))), None)
                        }
                    };
                } else {
                    events[tool] = match &mut ways[tool] {
                        Way::Jump(place) => Some(posed(*place, turned[tool])),
                        Way::Stab(place, way) => {
                            *place += *way;
                            Some(posed(*place, turned[tool]))
                        }
                        Way::Shake => Some(posed(random.place(), random.orientation())),
                        Way::Silent => None,
                    };
                }
            }
            let outputs = wild.advance(&inputs(&events));
            assert!(!outputs.restored, "seed {seed}, tick {i}");
            for tool in &outputs.tools {
                assert!(tool.state.force.norm() <= limit, "seed {seed}, tick {i}");
                physical = physical.max(tool.state.physical_force.norm());
            }
            assert!(wild.snapshot().body.is_finite(), "seed {seed}, tick {i}");
            bend = bend.max(rest_distance(&wild));
        }
        wild.advance(&inputs(&[Some(ToolEvent::Detach); 3]));
        for _ in 0..2000 {
            assert!(!wild.advance(&Inputs::default()).restored);
        }
        let left = rest_distance(&wild);
        println!("seed {seed}: up to {:.0} mm from rest, {physical:.1} N; {:.3} mm left", bend * 1e3, left * 1e3);
        (worst_left, worst_bend, worst_force) = (worst_left.max(left), worst_bend.max(bend), worst_force.max(physical));
    }
    assert!(worst_bend > 0.02, "wild enough to mean something");
    assert!(worst_left < 0.05 * SIDE, "{worst_left} m from rest");
}

// ---- The same inputs, the same bits ----

/// What tools `ball` and `rod` do in tick `i`: a pure function, with stabs, jumps, silence and new attaches.
fn script(i: u64) -> Inputs {
    let t = i as Real * TICK;
    let ball = match i {
        0 | 400 => attach(),
        390 => ToolEvent::Detach,
        _ => at(TOP + Vec3::new(0.03 * ease(t, 0.15, 0.3), 0.01, 0.012 - 0.012 * ease(t, 0.0, 0.15))),
    };
    let turned = normalized_quaternion([0.2 * t, 0.1, 0.3, 1.0]).unwrap();
    let rod = match i {
        0 => Some(ToolEvent::Attach { epoch: 2, period_ticks: 14 }),
        200..330 => None,
        _ if i.is_multiple_of(14) => {
            Some(posed(Vec3::new(-0.03 + 0.15 * ease(t, 0.0, 0.5), 0.02, 0.05 + 0.06 * ease(t, 0.3, 0.31)), turned))
        }
        _ => None,
    };
    let starved = if i % 50 == 7 { 4000 } else { u32::MAX };
    Inputs { lapsed: u32::from(i == 100) * 3, budget: starved, reset: i == 450, ..inputs(&[Some(ball), rod]) }
}

#[test]
fn the_same_inputs_give_the_same_bits() {
    let cube = cube(&["tool=[{name='ball', radius=0.01}, {name='rod', radius=0.005, length=0.08}]"]);
    let hashes = |simulation: &mut Simulation, from: u64, to: u64| -> Vec<(u64, Vec<Vec3>, u64)> {
        let row = |simulation: &mut Simulation, i| {
            let outputs = simulation.advance(&script(i));
            let forces = outputs.tools.iter().flat_map(|t| [t.state.force, t.state.torque]).collect();
            let frame = (outputs.frame, outputs.hash);
            assert!(!frame.0 || frame.1 == simulation.snapshot().hash());
            (simulation.snapshot().tick, forces, simulation.snapshot().hash())
        };
        (from..to).map(|i| row(simulation, i)).collect()
    };
    let ticks = 20 * TICKS_PER_FRAME;
    let first = hashes(&mut simulation(&cube), 0, ticks);
    assert!(first.iter().any(|row| row.1[0].norm() > 0.1) && first.iter().any(|row| row.1[2].norm() > 0.1));
    assert_eq!(first, hashes(&mut simulation(&cube), 0, ticks));
    for path in element_kernel::Path::available() {
        assert_eq!(first, hashes(&mut simulation(&cube).with_path(path), 0, ticks), "{path:?}");
    }
    for middle in [100, 201, 333, 441] {
        let mut half = simulation(&cube);
        let mut rows = hashes(&mut half, 0, middle);
        let bytes = postcard::to_stdvec(half.snapshot()).unwrap();
        let snapshot: Snapshot = postcard::from_bytes(&bytes).unwrap();
        assert_eq!(snapshot.hash(), half.snapshot().hash());
        let restored = Simulation::new(cube.0.clone(), cube.1.clone(), snapshot).unwrap();
        let rest = Snapshot::at_rest(&cube.0, 2);
        rows.extend(hashes(&mut restored.with_reset_state(&rest.body), middle, ticks));
        assert_eq!(first, rows, "restored after tick {middle}");
    }
    println!("{} ticks on {:?}, last hash {:016x}", ticks, element_kernel::Path::available(), first.last().unwrap().2);
}

#[test]
fn without_budget_the_body_stands_still_and_the_last_force_stands() {
    let cube = cube(&["tool.radius=0.015"]);
    let elements = cube.0.level().mesh.elements.len() as u32;
    let mut press = simulation(&cube);
    let place = |depth: Real| at(TOP + Vec3::z() * (0.016 - depth));
    tick(&mut press, attach());
    for i in 0..400 {
        tick(&mut press, place(0.005 * ease(i as Real * TICK, 0.0, 0.3)));
    }
    let before = press.snapshot().clone();
    let force = before.tools[0].physical_force;
    assert!(force.z > 0.1);
    for i in 1..=50 {
        let outputs = press.advance(&Inputs { budget: 0, ..inputs(&[Some(place(0.005))]) });
        assert_eq!((outputs.plan.taken, outputs.element_evaluations), (0, 0));
        assert!(outputs.flags().substeps_dropped && outputs.plan.needed >= 1);
        let tool = outputs.tools[0];
        assert_eq!((tool.state.physical_force, tool.state.force), (force, force));
        assert_eq!(press.snapshot().tick, before.tick + i);
        assert_eq!(press.snapshot().body, before.body);
    }
    let after = tick(&mut press, place(0.005)).tools[0].state.physical_force;
    println!("{:.4} N before the halt, {:.4} N after", force.z, after.z);
    assert!((after - force).norm() < 0.01 * force.norm());

    // Half of what it needs: slower, not broken.
    let mut needed = 0;
    for i in 0..500 {
        let depth = 0.005 + 0.003 * ease(i as Real * TICK, 0.0, 0.2);
        let outputs =
            press.advance(&Inputs { budget: elements * (needed / 2).max(1), ..inputs(&[Some(place(depth))]) });
        needed = outputs.plan.needed;
        assert!(!outputs.restored && is_finite(&outputs.tools[0].state.physical_force));
        assert!(outputs.plan.taken < outputs.plan.needed && outputs.plan.taken >= 1, "{:?}", outputs.plan);
        assert!(press.snapshot().body.is_finite());
    }
    let slow = press.snapshot().tools[0].physical_force;
    println!("{} of {needed} sub-steps: {:.4} N", needed / 2, slow.z);
    assert!(slow.z > force.z);
}

#[test]
fn a_tool_that_went_deeper_while_the_body_stood_still_does_not_hit_it() {
    for (ticks, deeper) in [(10, 0.001), (30, 0.003), (60, 0.006)] {
        let mut press = simulation(&cube(&["tool.radius=0.015"]));
        let place = |depth: Real| at(TOP + Vec3::z() * (0.015 - depth));
        tick(&mut press, attach());
        for i in 0..600 {
            tick(&mut press, place(-0.001 + 0.005 * ease(i as Real * TICK, 0.0, 0.4)));
        }
        let before = press.snapshot().tools[0].physical_force.z;
        for i in 1..=ticks {
            let depth = 0.004 + deeper * Real::from(i) / Real::from(ticks);
            press.advance(&Inputs { budget: 0, ..inputs(&[Some(place(depth))]) });
        }
        let (mut most, mut fastest, mut after) = (0.0 as Real, 0.0 as Real, 0.0);
        for _ in 0..400 {
            after = tick(&mut press, place(0.004 + deeper)).tools[0].state.physical_force.z;
            most = most.max(after);
            fastest = press.snapshot().body.velocity.iter().map(|v| v.norm()).fold(fastest, Real::max);
        }
        println!(
            "{:.0} mm in {ticks} ticks without budget: {before:.3} N, then up to {most:.3} N and {fastest:.2} m/s, at \
             last {after:.3} N",
            deeper * 1e3
        );
        // A tool that engages so deep in the body has 32 ticks to press its way out; so has one that got there unseen.
        assert!(most < 2.0 * after && fastest < 2.0, "{most} N for {after} N, {fastest} m/s");
    }
}

#[test]
fn a_state_that_is_not_finite_gives_way_to_the_last_good_one_and_the_hand_feels_nothing() {
    let mut press = simulation(&cube(&["tool.radius=0.015"]));
    tick(&mut press, attach());
    for i in 0..500 {
        tick(&mut press, at(TOP + Vec3::z() * (0.0155 - 0.005 * ease(i as Real * TICK, 0.0, 0.3))));
    }
    let pressed = press.snapshot().tools[0].force.norm();
    assert!(pressed > 0.3);
    press.state_mut().velocity[60].y = Real::NAN;
    let outputs = tick(&mut press, at(TOP + Vec3::z() * 0.0105));
    assert!(outputs.restored && outputs.flags().restored);
    assert_eq!(outputs.tools[0].state.force, Vec3::zeros());
    assert!(press.snapshot().body.is_finite());
    // The clock goes on, and so does the touch once the tool has been outside.
    for i in 0..800 {
        let height = 0.0105 + 0.01 * ease(i as Real * TICK, 0.0, 0.2) - 0.01 * ease(i as Real * TICK, 0.3, 0.5);
        assert!(!tick(&mut press, at(TOP + Vec3::z() * height)).restored);
    }
    let again = press.snapshot().tools[0].force.norm();
    println!("{pressed:.3} N, then none, then {again:.3} N");
    assert!((again / pressed - 1.0).abs() < 0.05);
}

#[test]
fn a_tick_without_budget_depends_on_the_snapshot_alone() {
    let cube = cube(&["tool.radius=0.015"]);
    let mut press = simulation(&cube);
    tick(&mut press, attach());
    for i in 0..500 {
        tick(&mut press, at(TOP + Vec3::z() * (0.0155 - 0.005 * ease(i as Real * TICK, 0.0, 0.3))));
    }
    // A recording may begin with such a tick: its replay knows the snapshot and nothing of earlier outputs.
    let mut again = Simulation::new(cube.0.clone(), cube.1.clone(), press.snapshot().clone()).unwrap();
    for _ in 0..3 {
        let starved = Inputs { budget: 0, ..inputs(&[Some(at(TOP + Vec3::z() * 0.0105))]) };
        let (first, second) = (press.advance(&starved).tools.clone(), again.advance(&starved).tools.clone());
        assert!(first[0].contact_points > 0);
        assert_eq!(first, second);
    }
}
