//! The virtual coupling: the simulated tool hangs on its handle by a spring without mass.

use super::*;

/// [m/N] of a device that renders 700 N/m.
const COMPLIANCE: Real = 1.0 / 700.0;

/// Presses a ball by `way(t)` for `seconds`, held by a spring of `coupling`; the tool after every tick.
fn pressed(
    cube: &Setup,
    coupling: Real,
    seconds: Real,
    way: impl Fn(Real) -> Vec3,
) -> Vec<palpate::contact::tool::ToolState> {
    let mut press = simulation(cube);
    tick(&mut press, ToolEvent::Attach { epoch: 1, period_ticks: 1, coupling });
    (0..(seconds / TICK) as u32).map(|i| tick(&mut press, at(way(Real::from(i) * TICK))).tools[0].state).collect()
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
        let hangs = tool.pose.position - tool.handle.position;
        assert!((hangs - tool.physical_force * COMPLIANCE).norm() < 1e-12);
        assert_eq!(tool.pose.orientation, tool.handle.orientation);
        most = most.max(hangs.norm());
    }
    println!("the tool hangs back by up to {:.2} mm", most * 1e3);
    assert!(most > 2e-4);
}

/// The contact does not know of the spring: a rigid tool led along the same way feels the same.
#[test]
fn a_rigid_tool_where_the_coupled_one_is_feels_the_same() {
    let coupled = pressed(&rough(), COMPLIANCE, 1.0, press_and_stroke);
    let places: Vec<Vec3> = coupled.iter().map(|t| t.pose.position).collect();
    let rigid = pressed(&rough(), 0.0, 1.0, |t| places[((t / TICK).round() as usize).min(places.len() - 1)]);
    let peak = coupled.iter().map(|t| t.physical_force.norm()).fold(0.0, Real::max);
    let square: Real =
        coupled.iter().zip(&rigid).map(|(a, b)| (a.physical_force - b.physical_force).norm_squared()).sum();
    let rms = (square / coupled.len() as Real).sqrt();
    println!("{:.2} mN rms apart, peak {peak:.3} N", rms * 1e3);
    assert!(rms < 0.01 * peak);
}

/// What is behind a jump of the handle comes through a spring: the softer, the gentler.
#[test]
fn the_coupling_bounds_what_the_hand_may_feel_per_millimetre() {
    let cube = cube(&["tool.radius=0.01", "material.youngs_modulus=1e5", "material.damping_time=0.01"]);
    for coupling in [1.0 / 2000.0, COMPLIANCE, 1.0 / 200.0] {
        let tools = pressed(&cube, coupling, 0.5, press_and_stroke);
        for (a, b) in tools.iter().zip(tools.iter().skip(1)) {
            let (moved, change) = (b.handle.position - a.handle.position, b.physical_force - a.physical_force);
            // A body that swings adds a little of its own.
            assert!(change.norm() < moved.norm() / coupling * 1.05 + 0.01, "{change:?} for {moved:?}");
        }
        assert!(tools.last().unwrap().physical_force.z > 0.1);
    }
}
