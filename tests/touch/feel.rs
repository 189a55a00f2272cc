//! What a press gives and takes.

use super::*;

// ---- What a press gives and takes ----

/// A cube that nothing holds, under one tool.
fn free_cube(shapes: &[ToolShape], friction: Real) -> Setup {
    let elastic = Material::from_young(1e4, 0.35, 1000.0);
    let recipe = Recipe {
        name: "free".into(),
        shape: Shape::meshes([box_mesh(Vec3::repeat(SIDE), [4; 3])]),
        material: Material { phi: elastic.lambda * 1e-3, psi: elastic.mu * 1e-3, ..elastic },
        inclusions: vec![],
        holds: vec![],
        elements: Default::default(),
        damping_ratio: 0.0,
    };
    let settings = Settings {
        gravity: Vec3::zeros(),
        tools: shapes
            .iter()
            .map(|shape| Tool { name: "tool".into(), shape: shape.clone(), friction, pivot: None })
            .collect(),
        obstacles: vec![],
        organ_friction: Default::default(),
        support_motions: vec![],
        following: Following { speed: 1.0, engage_ticks: 100 },
        limits: ForceLimits { force: 3.3, torque: 0.2, slew: 1000.0 },
        adaptivity: None,
        most_elements: usize::MAX,
    };
    let body = Arc::new(prepare(&recipe, &mut |_, _, _| {}).unwrap());
    Setup { rest: Snapshot::at_rest(&body, 0, shapes.len()), body, settings }
}

/// Largest error of the momentum balance over any tick, against the largest momentum, and largest error of the
/// balance of angular momentum as a lever arm [m] of the force, against the way that the fastest node made in the tick.
pub(super) fn momentum_errors<const N: usize>(
    shapes: [ToolShape; N],
    friction: Real,
    pose_at: impl Fn(Real) -> [ToolEvent; N],
) -> (Real, Real) {
    let mut free = simulation(&free_cube(&shapes, friction));
    free.advance(&inputs(&[Some(attach()); N]));
    let (mut worst, mut most_momentum, mut worst_lever, mut pushed) = (0.0 as Real, 0.0 as Real, 0.0 as Real, 0);
    for i in 0..400 {
        let before = energy(free.body(), free.mesh(), Vec3::zeros());
        let tools: Vec<ToolState> =
            free.advance(&inputs(&pose_at(i as Real * TICK).map(Some))).tools.iter().map(|t| t.state).collect();
        let after = energy(free.body(), free.mesh(), Vec3::zeros());
        let given = tools.iter().map(|t| t.physical_force).sum::<Vec3>() * TICK;
        // Points of one tool push against each other, too.
        let points = free.snapshot().points;
        let size = points.iter().flatten().map(|p| p.multiplier + p.tangential.norm()).sum::<Real>() * TICK;
        worst = worst.max((after.linear_momentum - before.linear_momentum + given).norm());
        most_momentum = most_momentum.max(after.linear_momentum.norm());
        if tools.iter().all(|t| t.physical_force.norm() * TICK > 1e-6) {
            pushed += 1;
            let moment = |tool: &ToolState| {
                let middle = (tool.previous.position + tool.pose.position) * 0.5;
                (tool.physical_torque + middle.cross(&tool.physical_force)) * TICK
            };
            let moments = tools.iter().map(moment).sum::<Vec3>();
            let error = (after.angular_momentum - before.angular_momentum + moments).norm();
            let way = fastest(&free) * TICK;
            worst_lever = worst_lever.max(error / size / way);
        }
    }
    assert!(pushed > 50, "pushed in {pushed} ticks only");
    (worst / most_momentum, worst_lever)
}

#[test]
fn what_the_tool_gets_the_body_loses_tick_by_tick() {
    let ball = |friction, sideways: Real| {
        momentum_errors([ToolShape::ball(0.02)], friction, |t| {
            [at(TOP + Vec3::new(0.02 - sideways * t, -0.01, 0.023 - 0.1 * t))]
        })
    };
    let (ball, rough) = (ball(0.0, 0.0), ball(0.4, 0.1));
    let capsule = momentum_errors([ToolShape::capsule(0.008, 0.06)], 0.0, |t| {
        let turned = normalized_quaternion([0.3 * t, 1.0, 0.1, 1.0 - t]).unwrap();
        [posed(TOP + Vec3::new(-0.03 + 0.05 * t, -0.01, 0.012 - 0.08 * t), turned)]
    });
    println!("linear: ball {:.1e}, rough {:.1e}, capsule {:.1e} of the momentum", ball.0, rough.0, capsule.0);
    println!(
        "angular: {:.1e}, {:.1e}, {:.1e} of the way of the fastest node, as a lever arm",
        ball.1, rough.1, capsule.1
    );
    for (linear, angular) in [ball, rough, capsule] {
        assert!(linear <= 1e-12);
        // The wrench takes the surface point where it was at the start of the tick; the sub-steps push it where it has
        // got to along the tool, on average after half the way of the tick. A ball is pushed through its middle, a little beside
        // where the mesh has the place: rows reach twice the spacing of nodes.
        assert!(angular <= 1.4);
    }
}

#[test]
fn a_tool_never_pulls() {
    for radius in [0.01, 0.02] {
        let mut press = simulation(&cube(&[&format!("tool.radius={radius}")]));
        tick(&mut press, attach());
        let (mut most, mut least) = (0.0 as Real, Real::INFINITY);
        for i in 0..1200 {
            // Down, hold, and off the surface faster than it follows.
            let t = i as Real * TICK;
            let height = 0.02 - 0.028 * (ease(t, 0.0, 0.3) - ease(t, 0.6, 0.65));
            let force = tick(&mut press, at(TOP + Vec3::z() * (radius + height))).tools[0].state.physical_force;
            (most, least) = (most.max(force.z), least.min(force.z));
        }
        let last = tick(&mut press, at(TOP + Vec3::z() * (radius + 0.02))).tools[0];
        println!("R {:.0} mm: {least} N to {most:.3} N, {} points at the end", radius * 1e3, last.contact_points);
        assert!(most > 0.2 && least >= 0.0);
        let left = (last.state.physical_force, last.state.force, last.contact_points);
        assert_eq!(left, (Vec3::zeros(), Vec3::zeros(), 0));
    }
}

#[test]
fn a_frictionless_ball_feels_no_torque_about_its_centre() {
    let mut press = simulation(&cube(&["tool.radius=0.015"]));
    tick(&mut press, attach());
    let (mut force, mut torque) = (0.0 as Real, 0.0 as Real);
    for i in 0..600 {
        let t = i as Real * TICK;
        let place = TOP + Vec3::new(0.04 * ease(t, 0.3, 0.6), 0.01, 0.017 - 0.012 * ease(t, 0.0, 0.3));
        let turned = normalized_quaternion([0.5 * t, t, -0.2, 1.0]).unwrap();
        let tool = tick(&mut press, posed(place, turned)).tools[0].state;
        force = force.max(tool.physical_force.norm());
        torque = torque.max(tool.physical_torque.norm().max(tool.torque.norm()));
    }
    println!("torque {torque:.1e} N m at {force:.3} N");
    assert!(force > 0.5 && torque <= 1e-9);
}

#[test]
fn a_tool_taken_inside_the_body_touches_nothing_until_it_has_been_outside() {
    let cube = cube(&["tool.radius=0.01"]);
    let (mut inside, mut alone) = (simulation(&cube), simulation(&cube));
    tick(&mut inside, attach());
    alone.advance(&Inputs::default());
    for i in 0..500 {
        // Around in the body, and half out of it.
        let place = TOP + Vec3::new(0.03 * (i as Real * 0.01).sin(), 0.0, -0.05 + 0.055 * ease(i as Real, 0.0, 500.0));
        let tool = tick(&mut inside, at(place)).tools[0];
        alone.advance(&Inputs::default());
        assert_eq!(tool.state.phase, Phase::Waiting, "tick {i}");
        assert_eq!(
            (tool.state.physical_force, tool.state.force, tool.contact_points),
            (Vec3::zeros(), Vec3::zeros(), 0)
        );
        assert_eq!(inside.snapshot().body, alone.snapshot().body, "tick {i}");
    }
    let mut last = ToolState::default();
    let mut engaged_at = None;
    for i in 0..600 {
        let t = i as Real * TICK;
        let height = 0.005 + 0.015 * ease(t, 0.0, 0.2) - 0.015 * ease(t, 0.2, 0.4);
        last = tick(&mut inside, at(TOP + Vec3::z() * height)).tools[0].state;
        if last.phase == Phase::Engaged && engaged_at.is_none() {
            engaged_at = Some(height);
        }
    }
    println!("engaged {:.2} mm above the face, then {:.3} N", 1e3 * engaged_at.unwrap(), last.force.z);
    assert!(engaged_at.unwrap() >= 0.01 && last.force.z > 0.1);
}

#[test]
fn a_deeper_press_pushes_harder_and_a_hold_is_quiet() {
    for radius in [0.01, 0.015, 0.02] {
        let mut press = simulation(&cube(&[&format!("tool.radius={radius}")]));
        tick(&mut press, attach());
        let mut forces = vec![0.0];
        for i in 0..2000 {
            // 10 mm in two seconds.
            let depth = 5e-6 * Real::from(i);
            let force = tick(&mut press, at(TOP + Vec3::z() * (radius + 1e-4 - depth))).tools[0].state.physical_force;
            if i % 100 == 99 {
                forces.push(force.z);
            }
        }
        let (mut noise, mut last) = (0.0 as Real, 0.0);
        let mut spread = (Real::INFINITY, 0.0 as Real);
        for i in 0..1000 {
            let force = tick(&mut press, at(TOP + Vec3::z() * (radius - 9.9e-3))).tools[0].state.physical_force.z;
            if i >= 500 {
                noise = noise.max((force - last).abs());
                spread = (spread.0.min(force), spread.1.max(force));
            }
            last = force;
        }
        let least_rise = forces.windows(2).map(|f| f[1] - f[0]).fold(Real::INFINITY, Real::min);
        println!(
            "R {:.0} mm: {:.4} N at 5 mm, {:.4} N at 10 mm, least rise {:.4} N per 0.5 mm; hold: {:.2e} N from tick to \
             tick, {:.2e} N in all",
            radius * 1e3,
            forces[10],
            forces[20],
            least_rise,
            noise,
            spread.1 - spread.0
        );
        assert!(least_rise > 0.0, "{forces:?}");
        assert!(noise < 2e-3 && forces[20] > 2.0 * forces[10]);
    }
}

#[test]
fn a_capsule_on_its_side_feels_its_force_in_its_middle() {
    let length = 0.05;
    let mut press = simulation(&cube(&["tool.radius=0.01", &format!("tool.length={length}")]));
    tick(&mut press, attach());
    let mut tool = ToolState::default();
    for i in 0..1500 {
        let depth = 0.006 * ease(i as Real * TICK, 0.0, 0.5);
        let place = TOP + Vec3::new(-0.5 * length, 0.0, 0.011 - depth);
        tool = tick(&mut press, posed(place, ALONG_X)).tools[0].state;
    }
    let (force, torque) = (tool.physical_force, tool.physical_torque);
    let arm = -torque.y / force.z;
    let sideways = force.xy().norm() / force.z;
    println!("force {force:?} N, torque {torque:?} N m: arm {:.2} mm, sideways {:.3}", arm * 1e3, sideways);
    assert!(force.z > 0.3 && sideways < 0.05);
    assert!((arm / (0.5 * length) - 1.0).abs() < 0.05);
    assert!((torque.x.abs() + torque.z.abs()) < 0.05 * torque.y.abs());
}

/// How far a ball of `radius` around `centre` reaches through the present top face [m]: positive where they overlap.
fn overlap(simulation: &Simulation, centre: Vec3, radius: Real) -> Real {
    let body = simulation.body();
    let mut vertices = vec![Vec3::zeros(); body.surface().vertices.len()];
    simulation.mesh().skin(&mut vertices);
    let at_rest = &body.surface().vertices;
    let top = |t: &&[u32; 3]| t.iter().all(|v| at_rest[*v as usize].z == SIDE);
    let (mut nearest, mut above) = (Real::INFINITY, 0.0);
    for [a, b, c] in body.surface().triangles.iter().filter(top).map(|t| t.map(|v| vertices[v as usize])) {
        let parts = 50;
        for i in 0..=parts {
            for j in 0..=parts - i {
                let (s, t) = (Real::from(i) / Real::from(parts), Real::from(j) / Real::from(parts));
                let away = centre - (a + (b - a) * s + (c - a) * t);
                if away.norm() < nearest {
                    (nearest, above) = (away.norm(), (b - a).cross(&(c - a)).dot(&away));
                }
            }
        }
    }
    radius - if above < 0.0 { -nearest } else { nearest }
}

/// Middle of a display triangle next to the middle of the top face; vertices stand every 12.5 mm.
fn between_vertices(body: &Body) -> Vec3 {
    let surface = body.surface();
    let middles = surface.triangles.iter().map(|t| t.iter().map(|v| surface.vertices[*v as usize]).sum::<Vec3>() / 3.0);
    middles.min_by(|a, b| (a - TOP).norm().total_cmp(&(b - TOP).norm())).unwrap()
}

#[test]
fn a_thin_tip_between_vertices_is_felt_the_more_the_deeper_it_is() {
    let radius = 1e-3;
    let cube = cube(&["tool.radius=0.001"]);
    let middle = between_vertices(&cube.body);
    let mut press = simulation(&cube);
    tick(&mut press, attach());
    let mut rows = Vec::new();
    for i in 0..2000 {
        let depth = 0.005 * Real::from(i) / 2000.0;
        let tool = tick(&mut press, at(middle + Vec3::z() * (radius - depth + 1e-4))).tools[0].state;
        if i % 400 == 399 {
            rows.push((depth - 1e-4, tool.physical_force.z, overlap(&press, tool.pose.position, radius)));
        }
    }
    for (depth, force, sunk) in &rows {
        println!("{:.1} mm deep: {force:.4} N, {:.3} mm through the surface", depth * 1e3, sunk * 1e3);
    }
    assert!(rows.iter().all(|row| row.1 > 0.0) && rows.windows(2).all(|pair| pair[1].1 > pair[0].1));
    // Almost all of that is dent, as in the continuum, and most of the dent below what the mesh shows.
    assert!(rows.iter().all(|row| row.2 < row.0), "sinks through");
}

#[test]
fn a_thin_tip_that_slides_keeps_its_force() {
    for (radius, depth) in [(0.001, 0.001), (0.001, 0.003), (0.003, 0.003)] {
        let cube = cube(&[&format!("tool.radius={radius}"), "material.damping_time=0.01"]);
        let start = between_vertices(&cube.body) - Vec3::new(0.0125, 0.0, 0.0);
        let mut press = simulation(&cube);
        tick(&mut press, attach());
        let mut last = Vec3::zeros();
        for i in 0..400 {
            let height = radius + 1e-3 - (depth + 1e-3) * ease(i as Real * TICK, 0.0, 0.2);
            last = tick(&mut press, at(start + Vec3::z() * height)).tools[0].state.physical_force;
        }
        let held = last.z;
        let (mut least, mut most, mut sum, mut jump) = (held, held, 0.0, 0.0 as Real);
        for i in 0..600 {
            // 30 mm at 50 mm/s, across several triangles.
            let way = Vec3::new(1.0, 0.2, 0.0) * (5e-5 * Real::from(i));
            let force = tick(&mut press, at(start + way + Vec3::z() * (radius - depth))).tools[0].state.physical_force;
            (least, most, sum) = (least.min(force.z), most.max(force.z), sum + force.z);
            jump = jump.max((force - last).norm());
            last = force;
        }
        println!(
            "R {:.0} mm, {:.0} mm deep: {held:.4} N held, {least:.4} N to {most:.4} N on the way, {jump:.4} N at once",
            radius * 1e3,
            depth * 1e3
        );
        let mean = sum / 600.0;
        assert!(least > 0.6 * mean && most < 1.5 * mean, "{least} N to {most} N, {mean} N on average");
        assert!(jump < 0.2 * mean, "{jump} N from tick to tick");
    }
}

#[test]
fn a_larger_ball_pushes_harder_at_the_same_depth_wherever_it_touches() {
    // A vertex of the display surface, the middles of two edges, and a place inside a triangle.
    let places = [[0.0, 0.0], [0.00625, 0.0], [0.00625, 0.00625], [0.0083, 0.0042]];
    let mut rows = Vec::new();
    for radius in [0.01, 0.015, 0.017, 0.018, 0.02, 0.03] {
        let cube = cube(&[&format!("tool.radius={radius}"), "material.damping_time=0.01"]);
        let forces = places.map(|[x, y]| {
            let mut press = simulation(&cube);
            tick(&mut press, attach());
            let forces = [0.002, 0.005].map(|depth| {
                let start = press.tools()[0].pose.position.z;
                let above = if start > SIDE { start } else { SIDE + radius + 5e-4 };
                let mut force = 0.0;
                for i in 0..250 {
                    let z = above + (SIDE + radius - depth - above) * ease(i as Real * TICK, 0.0, 0.2);
                    force = tick(&mut press, at(Vec3::new(0.05 + x, 0.05 + y, z))).tools[0].state.physical_force.z;
                }
                force
            });
            (forces[0], forces[1])
        });
        println!("R {:.0} mm: N at 2 and 5 mm {forces:.3?}", radius * 1e3);
        rows.push((radius, forces));
    }
    for (radius, forces) in &rows {
        assert!(forces.iter().all(|f| f.0 > 0.02 && f.1 > 0.1), "R {radius} m: nothing felt");
        // The mesh is coarse, but where it is touched must not decide what is felt.
        let (least, most) = forces.iter().fold((Real::INFINITY, 0.0 as Real), |a, f| (a.0.min(f.1), a.1.max(f.1)));
        assert!(most < 1.35 * least, "R {radius} m: {least} N to {most} N at 5 mm");
    }
    for pair in rows.windows(2) {
        for (small, large) in pair[0].1.iter().zip(&pair[1].1) {
            assert!(large.1 > 0.95 * small.1, "{} m feels {} N, {} m {} N", pair[0].0, small.1, pair[1].0, large.1);
        }
    }
}

#[test]
fn two_tools_squeeze_evenly_and_one_that_leaves_does_not_jerk_the_other() {
    let names = "tool=[{name='left', radius=0.01}, {name='right', radius=0.01}]";
    let cube = cube(&[names, "material.damping_time=0.01"]);
    // Forces along x while held, and the largest change of the right one in a tick after the left one left.
    let run = |taken: [bool; 2]| {
        let mut press = simulation(&cube);
        let only = |events: [ToolEvent; 2]| [0, 1].map(|i| taken[i].then_some(events[i]));
        press.advance(&inputs(&only([attach(); 2])));
        let (mut held, mut last, mut jump) = ([0.0; 2], 0.0, 0.0 as Real);
        for i in 0..900 {
            let depth = 0.003 * ease(i as Real * TICK, 0.0, 0.4);
            let left = at(Vec3::new(-0.011 + depth, 0.05, 0.05));
            let right = at(Vec3::new(SIDE + 0.011 - depth, 0.05, 0.05));
            let left = if i < 700 { left } else { ToolEvent::Detach };
            let outputs = press.advance(&inputs(&only([left, right])));
            let now = [0, 1].map(|i| outputs.tools[i].state.physical_force.x);
            if i < 700 {
                held = now;
            } else {
                assert_eq!(now[0], 0.0);
                jump = jump.max((now[1] - last as Real).abs());
            }
            last = now[1];
        }
        (held, last, jump)
    };
    let (left, right, both) = (run([true, false]), run([false, true]), run([true, true]));
    println!("alone {:.4} and {:.4} N, together {:.4?} N; then {:.4} N", left.0[0], right.0[1], both.0, both.1);
    println!("largest change in a tick {:.2e} N", both.2);
    // What one takes the other gives: the held bottom has next to nothing to add.
    assert!((both.0[0] + both.0[1]).abs() < 0.02 * both.0[1]);
    // Against one tool the whole cube yields, against two it cannot; the rest of the dent is local.
    for (alone, together) in [(-left.0[0], -both.0[0]), (right.0[1], both.0[1])] {
        assert!(together > alone && together < 1.3 * alone, "{alone} N alone, {together} N together");
    }
    assert!((both.1 / right.0[1] - 1.0).abs() < 0.05, "afterwards as alone");
    assert!(both.2 < 0.05 * both.0[1]);
}

#[test]
fn two_tools_far_apart_feel_what_each_feels_alone() {
    let names = "tool=[{name='left', radius=0.005}, {name='right', radius=0.005}]";
    let cube = cube(&[names, "material.damping_time=0.01"]);
    let run = |taken: [bool; 2]| {
        let mut press = simulation(&cube);
        let only = |events: [ToolEvent; 2]| [0, 1].map(|i| taken[i].then_some(events[i]));
        press.advance(&inputs(&only([attach(); 2])));
        let mut held = [0.0; 2];
        for i in 0..600 {
            let height = 0.0055 - 0.002 * ease(i as Real * TICK, 0.0, 0.3);
            let events = [-0.034, 0.034].map(|x| at(TOP + Vec3::new(x, 0.0, height)));
            let outputs = press.advance(&inputs(&only(events)));
            held = [0, 1].map(|i| outputs.tools[i].state.physical_force.z);
        }
        held
    };
    let (left, right, both) = (run([true, false])[0], run([false, true])[1], run([true; 2]));
    println!("alone {left:.4} and {right:.4} N, together {both:.4?} N");
    assert!((both[0] / left - 1.0).abs() < 0.05 && (both[1] / right - 1.0).abs() < 0.05);
}

// ---- What a client may do wrong ----

/// Where nodes of one level lie on nodes of the next, half of the finer ones are as near to several coarser ones: `prepare` warns of such
/// levels.
#[test]
fn a_body_of_nested_levels_is_about_as_stiff_as_its_finest() {
    let pressed = |cells: &str, more: &[&str]| {
        let cells = format!("body.cells={cells}");
        let heavy = [&cells, "world.gravity=[0,0,-9.81]", "material.damping_ratio=0.2"];
        let mut press = simulation(&scene(&[&heavy, more].concat()));
        tick(&mut press, attach());
        let (mut force, mut most) = (0.0, 0.0 as Real);
        for i in 0..3000 {
            let down = 0.012 * ease(Real::from(i) * TICK, 1.0, 1.5);
            force = tick(&mut press, at(TOP + Vec3::z() * (0.022 - down))).tools[0].state.physical_force.z;
            most = most.max(force);
        }
        (force, most)
    };
    for (cells, finest) in [("[[4,4,4],[8,8,8]]", "1"), ("[[2,2,2],[4,4,4],[8,8,8]]", "2")] {
        let fine = pressed(cells, &[&format!("body.active_level={finest}")]);
        let adaptive = pressed(cells, &[]);
        println!("{cells}: {adaptive:.3?} N, its finest level {fine:.3?} N");
        assert!((adaptive.0 / fine.0 - 1.0).abs() < 0.13);
    }
}
