//! The virtual coupling: the simulated tool hangs on its handle by a spring without mass.

use super::*;

/// [m/N] of a device that renders 700 N/m.
const COMPLIANCE: Real = 1.0 / 700.0;

/// Leads a tool on `coupling` along `way(t)` for `seconds`; the tool after every tick.
fn led(cube: &Setup, coupling: Coupling, seconds: Real, way: impl Fn(Real) -> ToolEvent) -> Vec<ToolState> {
    let mut press = simulation(cube);
    tick(&mut press, ToolEvent::Attach { epoch: 1, period_ticks: 1, coupling });
    (0..(seconds / TICK) as u32).map(|i| tick(&mut press, way(Real::from(i) * TICK)).tools[0].state).collect()
}

/// Presses a ball by `way(t)`, held by a spring of `compliance`.
fn pressed(cube: &Setup, compliance: Real, seconds: Real, way: impl Fn(Real) -> Vec3) -> Vec<ToolState> {
    led(cube, Coupling { compliance, ..Coupling::RIGID }, seconds, |t| at(way(t)))
}

/// 6 mm deep within 0.3 s, then 20 mm along in 0.5 s.
fn press_and_stroke(t: Real) -> Vec3 {
    TOP + Vec3::new(0.02 * ease(t, 0.4, 0.9), 0.0, 0.012 - 0.008 * ease(t, 0.0, 0.3))
}

fn rough() -> Setup {
    cube(&["tool.radius=0.01", "tool.friction=0.3", "material.damping_time=0.01"])
}

#[test]
fn the_tool_hangs_back_by_the_force_over_the_stiffness() {
    let tools = pressed(&rough(), COMPLIANCE, 1.0, press_and_stroke);
    let mut most = 0.0 as Real;
    for tool in &tools {
        let hangs = tool.pose.position - tool.device.position;
        assert!((hangs - tool.physical_force * COMPLIANCE).norm() < 1e-12);
        assert_eq!(tool.pose.orientation, tool.device.orientation);
        most = most.max(hangs.norm());
    }
    println!("the tool hangs back by up to {:.2} mm", most * 1e3);
    assert!(most > 2e-4);
}

/// The contact does not know of the springs: a rigid tool led along the same way feels the same.
fn a_rigid_tool_where_it_was_feels_the_same(cube: &Setup, coupled: &[ToolState]) {
    let poses: Vec<Pose> = coupled.iter().map(|t| t.pose).collect();
    let rigid = led(cube, Coupling::RIGID, 1.0, |t| {
        let Pose { position, orientation } = poses[((t / TICK).round() as usize).min(poses.len() - 1)];
        posed(position, orientation)
    });
    for (what, of) in [("force", (|t| t.physical_force) as fn(&ToolState) -> Vec3), ("torque", |t| t.physical_torque)] {
        let peak = coupled.iter().map(|t| of(t).norm()).fold(0.0, Real::max);
        let square: Real = coupled.iter().zip(&rigid).map(|(a, b)| (of(a) - of(b)).norm_squared()).sum();
        let rms = (square / coupled.len() as Real).sqrt();
        println!("{what}: {rms:.1e} rms apart, peak {peak:.1e}");
        assert!(rms < 0.015 * peak);
    }
}

#[test]
fn a_rigid_tool_where_the_coupled_one_is_feels_the_same() {
    a_rigid_tool_where_it_was_feels_the_same(&rough(), &pressed(&rough(), COMPLIANCE, 1.0, press_and_stroke));
}

/// A capsule on its side, held at one end, pressed 6 mm deep and then swept about that end by 0.2 rad.
#[test]
fn a_tool_turns_by_the_torque_over_the_angular_stiffness() {
    let mut cube = rough();
    cube.settings.tools[0].shape = ToolShape::capsule(0.01, 0.05);
    let way = |t: Real| {
        let place = TOP + Vec3::new(-0.025, 0.0, 0.012 - 0.008 * ease(t, 0.0, 0.3));
        let swept = Pose { position: place, orientation: ALONG_X }.turned(Vec3::z() * (0.2 * ease(t, 0.4, 0.9)));
        posed(place, swept.orientation)
    };
    // As of a device for the desk, and so soft that the tool gives way to the body more than the body to it.
    for angular_compliance in [1.0 / 0.3, 1.0 / 0.05] {
        let tools = led(&cube, Coupling { compliance: COMPLIANCE, angular_compliance }, 1.0, way);
        let mut most = 0.0 as Real;
        for tool in &tools {
            let angle = tool.physical_torque * angular_compliance;
            assert_eq!(tool.pose.orientation, tool.device.turned(angle).orientation);
            most = most.max(angle.norm());
        }
        let end = tools.last().unwrap();
        println!("turned by up to {most:.3} rad; at the end {:?} N m", end.physical_torque);
        // It is pushed up where it lies, and held back by what it sweeps over.
        assert!(most > 0.03 && end.physical_torque.y < -2e-3 && end.physical_torque.z < -5e-4);
        a_rigid_tool_where_it_was_feels_the_same(&cube, &tools);
    }
}

/// What is behind a jump of the handle comes through a spring: the softer, the gentler.
#[test]
fn the_coupling_bounds_what_the_hand_may_feel_per_millimetre() {
    let cube = cube(&["tool.radius=0.01", "material.youngs_modulus=1e5", "material.damping_time=0.01"]);
    for coupling in [1.0 / 2000.0, COMPLIANCE, 1.0 / 200.0] {
        let tools = pressed(&cube, coupling, 0.5, press_and_stroke);
        for (a, b) in tools.iter().zip(tools.iter().skip(1)) {
            let (moved, change) = (b.device.position - a.device.position, b.physical_force - a.physical_force);
            // A body that swings adds a little of its own.
            assert!(change.norm() < moved.norm() / coupling * 1.05 + 0.01, "{change:?} for {moved:?}");
        }
        assert!(tools.last().unwrap().physical_force.z > 0.1);
    }
}
