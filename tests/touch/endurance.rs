//! Nothing that a client or the machine does breaks the body or the hand, and the same inputs give the same bits.

use super::*;

/// As of a device for the desk, and the softest that a server takes.
const COUPLINGS: [Coupling; 3] = [
    Coupling::RIGID,
    Coupling { compliance: 1.0 / 800.0, angular_compliance: 1.0 / 0.3 },
    Coupling { compliance: 0.1, angular_compliance: 100.0 },
];

impl Random {
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
            let before = press.tools()[0];
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

/// Moves three tools, each in one way after another.
struct Wild {
    random: Random,
    ways: [Way; 3],
    until: [u64; 3],
    turned: [[Real; 4]; 3],
}

const WILD_TOOLS: &str = "tool=[{name='ball', radius=0.01}, {name='rod', radius=0.005, length=0.08, friction=0.4}, {name='tip', radius=0.001, friction=0.8}]";

impl Wild {
    fn new(seed: u64) -> Self {
        Self { random: Random(seed), ways: [const { Way::Silent }; 3], until: [0; 3], turned: [UPRIGHT; 3] }
    }

    /// What it does in tick `i`; ticks come one after the other.
    fn events(&mut self, i: u64) -> [Option<ToolEvent>; 3] {
        let random = &mut self.random;
        let mut events = [None; 3];
        #[expect(clippy::needless_range_loop, reason = "four arrays under the same index")]
        for tool in 0..3 {
            if i >= self.until[tool] {
                self.until[tool] = i + 5 + random.below(200) as u64;
                self.turned[tool] = random.orientation();
                let place = random.place();
                (self.ways[tool], events[tool]) = match random.below(10) {
                    0 => (Way::Silent, Some(ToolEvent::Detach)),
                    1 => (Way::Silent, None),
                    2 | 3 => (
                        Way::Shake,
                        Some(ToolEvent::Attach {
                            epoch: 1,
                            period_ticks: 1 + i as u32 % 20,
                            coupling: COUPLINGS[i as usize % 3],
                        }),
                    ),
                    4 | 5 => (Way::Jump(place), None),
                    6 => (Way::Shake, None),
                    _ => {
                        // From outside through the middle and out again.
                        let way = Vec3::from_fn(|_, _| random.between(-1.0, 1.0)).normalize();
                        (Way::Stab(Vec3::repeat(0.05) - way * 0.12, way * (1e-3 * random.between(0.3, 1.2))), None)
                    }
                };
            } else {
                events[tool] = match &mut self.ways[tool] {
                    Way::Jump(place) => Some(posed(*place, self.turned[tool])),
                    Way::Stab(place, way) => {
                        *place += *way;
                        Some(posed(*place, self.turned[tool]))
                    }
                    Way::Shake => Some(posed(random.place(), random.orientation())),
                    Way::Silent => None,
                };
            }
        }
        events
    }
}

#[test]
fn wild_clients_with_solid_tools_never_break_the_body() {
    let tools = "tool=[{name='forceps', shape='compound', part=[\
        {shape='cylinder', radius=0.004, length=0.05, rounding=0.001, position=[0,0,0.03]}, \
        {shape='convex', points=[[0.004,-0.003,0],[0.004,0.003,0],[0.007,0,0],[0.001,0,0.03],[0.003,0,0.03]]}, \
        {shape='convex', points=[[-0.004,-0.003,0],[-0.004,0.003,0],[-0.007,0,0],[-0.001,0,0.03],[-0.003,0,0.03]]}]}, \
        {name='disc', shape='cylinder', radius=0.02, length=0.001, rounding=0.0005, friction=0.5}, \
        {name='blade', shape='convex', points=[[0,0,0],[0,0,0.05],[0.01,0,0],[0.01,0,0.05],[0,0.0005,0]], rounding=0.0002}]";
    let damped = "material.damping_time=0.01";
    let cubes = [cube(&["body.cells=[[2,2,2],[4,4,4]]", damped, tools]), adaptive_cube(&[damped, tools])];
    for seed in 0..cases(4, 10) {
        let mut client = Wild::new(100 + seed);
        let mut wild = simulation(&cubes[seed as usize % 2]);
        let (mut felt, mut physical) = ([0; 3], 0.0 as Real);
        for i in 0..1500 {
            let outputs = wild.advance(&inputs(&client.events(i)));
            assert!(!outputs.restored, "seed {seed}, tick {i}");
            for (tool, felt) in outputs.tools.iter().zip(&mut felt) {
                assert!(is_finite(&tool.state.physical_force) && is_finite(&tool.state.physical_torque));
                physical = physical.max(tool.state.physical_force.norm());
                *felt += u32::from(tool.contact_points > 0);
            }
        }
        println!("seed {seed}: {felt:?} ticks felt, up to {physical:.1} N");
    }
}

#[test]
fn wild_clients_never_break_the_body_and_it_recovers() {
    let (tools, damped) = (WILD_TOOLS, "material.damping_time=0.01");
    // A display surface finer than the level that moves, one as coarse, and levels that come and go.
    let cubes = [
        cube(&["body.active_level=0", damped, tools]),
        cube(&["body.cells=[[2,2,2],[4,4,4]]", damped, tools]),
        adaptive_cube(&[damped, tools]),
    ];
    assert!(cubes[..2].iter().all(|cube| cube.rest.body.history.len() == 384));
    go_wild_on(&cubes, cases(9, 30));
}

#[test]
fn nor_one_of_the_neo_hookean_law() {
    let keys = ["material.law='neo_hookean'", "material.damping_time=0.01", WILD_TOOLS];
    go_wild_on(&[cube(&[&["body.cells=[[2,2,2],[4,4,4]]"], &keys[..]].concat()), adaptive_cube(&keys)], cases(4, 20));
}

/// Nearly incompressible, where means hold the volume and single tetrahedra have to resist being crushed.
#[test]
fn nor_nearly_incompressible_ones_nor_fibres_nor_tetrahedra_alone() {
    let damped = ["material.damping_time=0.01", WILD_TOOLS];
    let tetrahedra = ["material.elements='tetrahedra'"];
    let incompressible = ["material.poisson_ratio=0.499"];
    let fibres = [
        "material.law='transversely_isotropic'",
        "material.fibre_modulus=1e5",
        "material.fibre_direction=[1.0,0.3,0.5]",
    ];
    for keys in [
        &[&incompressible[..], &damped[..]].concat(),
        &[&tetrahedra[..], &damped[..]].concat(),
        &[&fibres[..], &damped[..]].concat(),
    ] {
        go_wild_on(
            &[cube(&[&["body.cells=[[2,2,2],[4,4,4]]"], &keys[..]].concat()), adaptive_cube(keys)],
            cases(2, 20),
        );
    }
}

fn go_wild_on(cubes: &[Setup], clients: u64) {
    let limit = cubes[0].settings.limits.force * (1.0 + 1e-9);
    let (mut worst_bend, mut folded, mut entangled) = (0.0 as Real, 0, 0);
    for seed in 0..clients {
        let mut client = Wild::new(seed);
        let mut wild = simulation(&cubes[seed as usize % cubes.len()]);
        let mut physical = 0.0 as Real;
        let mut bend = 0.0 as Real;
        for i in 0..2000 {
            let outputs = wild.advance(&inputs(&client.events(i)));
            assert!(!outputs.restored, "seed {seed}, tick {i}");
            for tool in &outputs.tools {
                assert!(tool.state.force.norm() <= limit, "seed {seed}, tick {i}");
                physical = physical.max(tool.state.physical_force.norm());
            }
            assert!(wild.snapshot().body.is_finite(), "seed {seed}, tick {i}");
            bend = bend.max(rest_distance(&wild));
        }
        wild.advance(&inputs(&[Some(ToolEvent::Detach); 3]));
        // What is left to fade moves by 1e-3 of the body's size in a frame at most.
        let restored = (0..4000).filter(|_| wild.advance(&Inputs::default()).restored).count();
        assert!(restored <= 1, "seed {seed} is put back {restored} times");
        entangled += restored;
        let left = rest_distance(&wild);
        println!("seed {seed}: up to {:.0} mm from rest, {physical:.1} N; {:.3} mm left", bend * 1e3, left * 1e3);
        worst_bend = worst_bend.max(bend);
        assert!(fastest(&wild) < 0.01, "seed {seed} does not come to rest");
        // What was stabbed right through a mesh may stay folded, as a ball keeps a dent: that is an equilibrium, too, and
        // the body is put back where elements are crushed in it.
        if left > 0.05 * SIDE {
            folded += 1;
            wild.advance(&Inputs { reset: true, ..Inputs::default() });
            assert!(rest_distance(&wild) < 1e-6 * SIDE, "a reset unfolds it");
        }
    }
    println!("{folded} of {clients} keep a fold, {entangled} were put back out of one");
    assert!(worst_bend > 0.02, "wild enough to mean something");
    assert!(folded == 0 && entangled as u64 <= clients.div_ceil(10));
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
        0 => Some(ToolEvent::Attach { epoch: 2, period_ticks: 14, coupling: COUPLINGS[1] }),
        200..330 => None,
        _ if i.is_multiple_of(14) => {
            Some(posed(Vec3::new(-0.03 + 0.15 * ease(t, 0.0, 0.5), 0.02, 0.05 + 0.06 * ease(t, 0.3, 0.31)), turned))
        }
        _ => None,
    };
    let starved = if i % 50 == 7 { 1000 } else { u32::MAX };
    Inputs {
        lapsed: u32::from(i == 100) * 3,
        budget: Budget::of(starved),
        reset: i == 450,
        ..inputs(&[Some(ball), rod])
    }
}

/// Cubes of one level, of three, and of three that hang on springs and remember.
fn three_cubes(overrides: &[&str]) -> [(&'static str, Setup); 3] {
    let springs = ["hold=[{min=[0,0,0], max=[0.1,0.1,0]}]", "material.damping_ratio=0.1"];
    let on_springs: Vec<&str> = overrides.iter().chain(&springs).copied().collect();
    [
        ("one level", cube(overrides)),
        ("three levels", adaptive_cube(overrides)),
        ("three levels on springs, with memory", adaptive_cube(&on_springs)),
    ]
}

#[test]
fn the_same_inputs_give_the_same_bits() {
    for (name, cube) in
        three_cubes(&["tool=[{name='ball', radius=0.01, friction=0.3}, {name='rod', radius=0.005, length=0.08}]"])
    {
        let (mut starved, mut splits, mut merges) = (0, 0, 0);
        let mut run = |simulation: &mut Simulation, from: u64, to: u64| -> Vec<(u64, Vec<Vec3>, u64)> {
            let mut row = |i| {
                let outputs = simulation.advance(&script(i));
                let forces = outputs.tools.iter().flat_map(|t| [t.state.force, t.state.torque]).collect();
                let frame = (outputs.frame, outputs.hash);
                starved += u32::from(outputs.flags().substeps_dropped);
                (splits, merges) = (splits + outputs.adapted.splits, merges + outputs.adapted.merges);
                assert!(!frame.0 || frame.1 == simulation.hash());
                (simulation.tick(), forces, simulation.hash())
            };
            (from..to).map(&mut row).collect()
        };
        let same = |a: &[(u64, Vec<Vec3>, u64)], b: &[(u64, Vec<Vec3>, u64)], what: &str| {
            let first = a.iter().zip(b).position(|(a, b)| a != b);
            assert!(first.is_none() && a.len() == b.len(), "{name}, {what}: {:?}", first.map(|i| (&a[i], &b[i])));
        };
        let ticks = 20 * TICKS_PER_FRAME;
        let first = run(&mut simulation(&cube), 0, ticks);
        assert!(first.iter().any(|row| row.1[0].norm() > 0.1) && first.iter().any(|row| row.1[2].norm() > 0.1));
        for path in element_kernel::Simd::available() {
            same(&first, &run(&mut simulation(&cube).with_path(path), 0, ticks), &format!("{path:?}"));
        }
        for middle in [100, 201, 333, 441] {
            let mut half = simulation(&cube);
            let mut rows = run(&mut half, 0, middle);
            let bytes = postcard::to_stdvec(&half.snapshot()).unwrap();
            let snapshot: Snapshot = postcard::from_bytes(&bytes).unwrap();
            let restored = Simulation::new(cube.body.clone(), cube.settings.clone(), snapshot).unwrap();
            assert_eq!(restored.hash(), half.hash());
            rows.extend(run(&mut restored.with_reset_state(&cube.rest.body).unwrap(), middle, ticks));
            same(&first, &rows, &format!("restored after tick {middle}"));
        }
        let adapted = cube.settings.adaptivity.is_some();
        println!(
            "{name}: last hash {:016x}; {starved} ticks starved, {splits} splits, {merges} merges",
            first.last().unwrap().2
        );
        assert!(starved > 0 && (splits > 100) == adapted && (merges > 100) == adapted);
    }
}

/// Parts of two snapshots that are not the same.
fn what_differs(a: &Snapshot, b: &Snapshot) -> Vec<&'static str> {
    let parts = [
        ("tick", a.tick == b.tick),
        ("frozen", a.frozen == b.frozen),
        ("tools", a.tools == b.tools),
        ("points", a.points == b.points),
        ("nodes", a.body.nodes == b.body.nodes),
        ("positions", a.body.position == b.body.position),
        ("velocities", a.body.velocity == b.body.velocity),
        ("interface", a.body.interface == b.body.interface),
        ("classes", a.body.classes == b.body.classes),
        ("history", a.body.history == b.body.history),
        ("strain limit", a.body.strain_limit == b.body.strain_limit),
        ("geomorph", a.body.geomorph == b.body.geomorph),
    ];
    parts.into_iter().filter(|p| !p.1).map(|p| p.0).collect()
}

#[test]
fn a_tick_depends_on_the_snapshot_before_it_and_its_inputs_alone() {
    // Stiff enough for elements of many steps, which change with the strain.
    for (name, cube) in three_cubes(&[WILD_TOOLS, "material.youngs_modulus=5e4"]) {
        let mut on = simulation(&cube);
        let (mut client, mut random) = (Wild::new(3), Random(4));
        let mut faults = Vec::new();
        for i in 0..cases(300, 1000) {
            let again = Simulation::new(cube.body.clone(), cube.settings.clone(), on.snapshot()).unwrap();
            let mut again = again.with_reset_state(&cube.rest.body).unwrap();
            let budget = Budget::of([u32::MAX, u32::MAX, u32::MAX, 200_000, 0][random.below(5)]);
            let tick = Inputs { budget, reset: random.below(100) == 0, ..inputs(&client.events(i)) };
            on.advance(&tick);
            again.advance(&tick);
            // The hash leaves out what elements remember.
            let differs = what_differs(&on.snapshot(), &again.snapshot());
            if on.hash() != again.hash() || !differs.is_empty() {
                faults.push((i, differs));
            }
        }
        let (count, first) = (faults.len(), faults.first());
        assert!(count == 0, "{name}: {count} ticks go another way when they start from a snapshot, first {first:?}");
    }
}

#[test]
fn without_budget_the_body_stands_still_for_5_ms_at_most_and_the_last_force_stands() {
    let mut press = simulation(&cube(&["tool.radius=0.015"]));
    let place = |depth: Real| at(TOP + Vec3::z() * (0.016 - depth));
    tick(&mut press, attach());
    for i in 0..400 {
        tick(&mut press, place(0.005 * ease(i as Real * TICK, 0.0, 0.3)));
    }
    for _ in 0..10 {
        let before = press.snapshot();
        let force = before.tools[0].physical_force;
        assert!(force.z > 0.1);
        for i in 1..=MOST_FROZEN {
            let outputs = press.advance(&Inputs { budget: Budget::of(0), ..inputs(&[Some(place(0.005))]) });
            assert_eq!((outputs.plan.taken, outputs.element_evaluations), (0, 0));
            assert!(outputs.flags().substeps_dropped && outputs.plan.needed >= 1);
            let tool = outputs.tools[0];
            assert_eq!(tool.state.physical_force, force);
            assert_eq!(press.tick(), before.tick + u64::from(i));
            assert!(press.snapshot().body == before.body, "tick {i}");
        }
        let moved = press.advance(&Inputs { budget: Budget::of(0), ..inputs(&[Some(place(0.005))]) });
        assert!(moved.plan.taken > 0 && moved.element_evaluations > 0, "it never stands still for longer");
        let after = moved.tools[0].state.physical_force;
        assert!(
            (after - force).norm() < 0.01 * force.norm(),
            "{:.4} N before the halt, {:.4} N after",
            force.z,
            after.z
        );
    }
}

#[test]
fn with_half_of_what_it_needs_a_body_gives_up_resolution_and_goes_on() {
    // So much resolution that half of it is far more than the least that a body needs.
    let cells = "body.cells=[[4,4,4],[7,7,7],[13,13,13]]";
    let cube = adaptive_cube(&[cells, "resolution.reach=2.0", "material.youngs_modulus=5e4", "tool.radius=0.015"]);
    let mut press = simulation(&cube);
    let place = |depth: Real| at(TOP + Vec3::z() * (0.016 - depth));
    tick(&mut press, attach());
    for i in 0..400 {
        tick(&mut press, place(0.005 * ease(i as Real * TICK, 0.0, 0.3)));
    }
    let fine = tick(&mut press, place(0.005)).clone();
    let force = fine.tools[0].state.physical_force;
    assert!(force.z > 0.1 && fine.active[2] > 0, "{:?}", fine.active);
    let budget = fine.plan.whole * 2 / 3;
    let (mut halted, mut last, mut in_a_row) = (Vec::new(), fine.clone(), 0);
    for i in 0..500 {
        let depth = 0.005 + 0.003 * ease(i as Real * TICK, 0.0, 0.2);
        last = press.advance(&Inputs { budget: Budget::of(budget), ..inputs(&[Some(place(depth))]) }).clone();
        assert!(!last.restored && is_finite(&last.tools[0].state.physical_force));
        assert!(press.snapshot().body.is_finite());
        // Only one that has stood still for too long may take more.
        assert!(last.plan.whole <= budget || in_a_row == MOST_FROZEN, "{:?} of {budget}", last.plan);
        in_a_row = if last.plan.taken == 0 { in_a_row + 1 } else { 0 };
        assert!(in_a_row <= MOST_FROZEN);
        if last.plan.taken == 0 {
            halted.push(last.adapted.merges);
        }
    }
    let slow = last.tools[0].state.physical_force;
    println!(
        "{:?} nodes at {:.4} N, with two thirds of that {:?} at {:.4} N; it stood still in {} ticks",
        &fine.active[..3],
        force.z,
        &last.active[..3],
        slow.z,
        halted.len()
    );
    // While it sheds what is too much, and no longer than a hand would take for a stick.
    assert!(halted.len() < 20 && halted.iter().any(|merges| *merges > 0), "{halted:?} of {budget}");
    assert!(last.elements < fine.elements && slow.z > force.z);
}

#[test]
fn a_tool_that_went_deeper_while_the_body_stood_still_does_not_hit_it() {
    for (ticks, deeper) in [(5, 0.0005), (5, 0.001), (30, 0.003), (60, 0.006)] {
        let mut press = simulation(&cube(&["tool.radius=0.015"]));
        let place = |depth: Real| at(TOP + Vec3::z() * (0.015 - depth));
        tick(&mut press, attach());
        for i in 0..600 {
            tick(&mut press, place(-0.001 + 0.005 * ease(i as Real * TICK, 0.0, 0.4)));
        }
        let before = press.tools()[0].physical_force.z;
        for i in 1..=ticks {
            let depth = 0.004 + deeper * Real::from(i) / Real::from(ticks);
            press.advance(&Inputs { budget: Budget::of(0), ..inputs(&[Some(place(depth))]) });
        }
        let (mut most, mut fastest, mut after) = (0.0 as Real, 0.0 as Real, 0.0);
        for _ in 0..400 {
            after = tick(&mut press, place(0.004 + deeper)).tools[0].state.physical_force.z;
            most = most.max(after);
            fastest = fastest.max(super::fastest(&press));
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

/// A client that was silent for so long that its force is gone, and comes back somewhere else, leaves its contact behind.
#[test]
fn a_tool_that_comes_back_elsewhere_takes_nothing_of_its_contact_along() {
    let cube = cube(&["material.damping_time=0.01", "tool.friction=0.5"]);
    for coupling in COUPLINGS {
        let mut press = simulation(&cube);
        tick(&mut press, ToolEvent::Attach { epoch: 1, period_ticks: 1, coupling });
        for i in 0..300 {
            tick(&mut press, at(TOP + Vec3::z() * (0.021 - 0.007 * ease(Real::from(i) * TICK, 0.0, 0.2))));
        }
        let held = (0..80).map(|_| press.advance(&inputs(&[None])).tools[0].state).last().unwrap();
        assert!(held.phase == Phase::Holding && held.ramp == 0.0 && held.physical_force.z > 0.05, "{held:?}");
        // On the other side of the body, where what it touched faces away.
        let below = TOP - Vec3::z() * 0.15;
        for _ in 0..20 {
            let tool = tick(&mut press, at(below)).tools[0];
            assert_eq!((tool.state.phase, tool.contact_points), (Phase::Engaged, 0));
            assert_eq!(tool.state.physical_force, Vec3::zeros());
            assert!((tool.state.pose.position - below).norm() < 1e-12);
        }
        assert!(fastest(&press) < 1.0);
    }
}

#[test]
fn a_state_that_is_not_finite_gives_way_to_that_of_a_reset_and_the_hand_feels_nothing() {
    let cube = cube(&["tool.radius=0.015"]);
    let mut press = simulation(&cube);
    tick(&mut press, attach());
    for i in 0..500 {
        tick(&mut press, at(TOP + Vec3::z() * (0.0155 - 0.005 * ease(i as Real * TICK, 0.0, 0.3))));
    }
    let pressed = press.tools()[0].force.norm();
    assert!(pressed > 0.3);
    let node = press.mesh().node(press.mesh().active()[60]);
    press.mesh_mut().change_motion(|n, _, v| v.y = if n == node { Real::NAN } else { v.y });
    let outputs = tick(&mut press, at(TOP + Vec3::z() * 0.0105));
    assert!(outputs.restored && outputs.flags().restored);
    assert_eq!(outputs.tools[0].state.force, Vec3::zeros());
    let (now, reset) = (press.snapshot().body, press.reset_state().clone());
    assert!(now.nodes == reset.nodes && now.position == reset.position && now.velocity == reset.velocity);
    // The clock goes on, and so does the touch once the tool has been outside.
    for i in 0..800 {
        let height = 0.0105 + 0.01 * ease(i as Real * TICK, 0.0, 0.2) - 0.01 * ease(i as Real * TICK, 0.3, 0.5);
        assert!(!tick(&mut press, at(TOP + Vec3::z() * height)).restored);
    }
    let again = press.tools()[0].force.norm();
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
    let mut again = Simulation::new(cube.body.clone(), cube.settings.clone(), press.snapshot()).unwrap();
    for _ in 0..3 {
        let starved = Inputs { budget: Budget::of(0), ..inputs(&[Some(at(TOP + Vec3::z() * 0.0105))]) };
        let (first, second) = (press.advance(&starved).tools.clone(), again.advance(&starved).tools.clone());
        assert!(first[0].contact_points > 0);
        assert_eq!(first, second);
    }
}
