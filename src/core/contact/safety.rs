//! Safety of the hand: the rendered force is bounded, changes at a bounded rate, and rises and falls on ramps.

use super::tool::{Phase, ToolState, Wrench};
use crate::math::{Real, is_finite};

/// Bounds on what is rendered. The slew limit is a net set well above what tissue does (a hard tap changes the force
/// by some 0.5 N in a millisecond): used as a tuning tool it would take stability away from remote clients.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ForceLimits {
    /// Largest force [N].
    pub force: Real,
    /// Largest torque [N·m].
    pub torque: Real,
    /// Fastest change of the force [N/s]; the torque changes at `slew · torque/force` at most.
    pub slew: Real,
}

/// Why the rendered force differs from the physical one.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Limited {
    /// By the force or torque limit.
    pub clamped: bool,
    /// By the slew limit.
    pub slew: bool,
    /// By a ramp.
    pub ramping: bool,
}

/// Sets `tool.force`, `tool.torque` and the jaws' from the physical wrench, one tick of `tick` [s] after the last ones.
pub fn render(tool: &mut ToolState, physical: &Wrench, limits: &ForceLimits, tick: Real) -> Limited {
    if !(is_finite(&physical.force) && is_finite(&physical.torque) && physical.grip.is_finite()) {
        tool.force.fill(0.0);
        tool.torque.fill(0.0);
        tool.jaws.torque = 0.0;
        return Limited::default();
    }
    let scale = if tool.touches() { tool.ramp } else { 0.0 };
    let mut force = physical.force * scale;
    let mut torque = physical.torque * scale;
    let mut limited =
        Limited { ramping: matches!(tool.phase, Phase::Engaged | Phase::Holding) && scale < 1.0, ..Limited::default() };
    // One factor for both keeps the wrench's axis.
    let fits = |size: Real, limit: Real| if size > limit { limit / size } else { 1.0 };
    let factor = fits(force.norm(), limits.force).min(fits(torque.norm(), limits.torque));
    if factor < 1.0 {
        force *= factor;
        torque *= factor;
        limited.clamped = true;
    }
    for (now, before, rate) in
        [(&mut force, tool.force, limits.slew), (&mut torque, tool.torque, limits.slew * limits.torque / limits.force)]
    {
        let change = *now - before;
        let size = change.norm();
        if size > rate * tick {
            *now = before + change * (rate * tick / size);
            limited.slew = true;
        }
    }
    // Of jaws apart from the wrench, as their motor is another, with the limits of a torque.
    let (grip, change) = (physical.grip * scale, limits.slew * limits.torque / limits.force * tick);
    let bounded = grip.max(-limits.torque).min(limits.torque);
    let rendered = bounded.max(tool.jaws.torque - change).min(tool.jaws.torque + change);
    (limited.clamped, limited.slew) = (limited.clamped || bounded != grip, limited.slew || rendered != bounded);
    tool.jaws.torque = rendered;
    tool.force = force;
    tool.torque = torque;
    limited
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::Vec3;
    use proptest::prelude::*;

    const LIMITS: ForceLimits = ForceLimits { force: 3.3, torque: 0.2, slew: 1000.0 };

    fn engaged() -> ToolState {
        ToolState { phase: Phase::Engaged, ramp: 1.0, ..ToolState::default() }
    }

    #[test]
    fn a_force_that_is_not_a_number_becomes_none() {
        let mut tool = engaged();
        tool.force = Vec3::x();
        let bad = Wrench { force: Vec3::new(Real::NAN, 0.0, 0.0), torque: Vec3::zeros(), grip: 0.0 };
        render(&mut tool, &bad, &LIMITS, 1e-3);
        assert_eq!(tool.force, Vec3::zeros());
    }

    #[test]
    fn a_lost_tool_feels_nothing_within_four_ticks() {
        let mut tool = engaged();
        tool.force = Vec3::new(0.0, 0.0, 3.3);
        tool.phase = Phase::Detached;
        for _ in 0..4 {
            render(&mut tool, &Wrench::default(), &LIMITS, 1e-3);
        }
        assert_eq!(tool.force, Vec3::zeros());
    }

    proptest! {
        #[test]
        fn force_and_its_change_stay_within_their_limits(
            forces in prop::collection::vec(prop::array::uniform6(-1e6..1e6f64), 1..50),
            ramp in 0.0..1.0f64,
        ) {
            let mut tool = engaged();
            tool.ramp = ramp;
            for f in forces {
                let (before, grip_before) = (tool.force, tool.jaws.torque);
                let physical = Wrench { force: Vec3::new(f[0], f[1], f[2]), torque: Vec3::new(f[3], f[4], f[5]), grip: f[3] };
                render(&mut tool, &physical, &LIMITS, 1e-3);
                prop_assert!(tool.force.norm() <= LIMITS.force * (1.0 + 1e-12));
                prop_assert!(tool.torque.norm() <= LIMITS.torque * (1.0 + 1e-12));
                prop_assert!(tool.jaws.torque.abs() <= LIMITS.torque * (1.0 + 1e-12));
                let change = LIMITS.slew * LIMITS.torque / LIMITS.force * 1e-3;
                prop_assert!((tool.jaws.torque - grip_before).abs() <= change * (1.0 + 1e-9));
                prop_assert!((tool.force - before).norm() <= 1.0 + 1e-12);
            }
        }
    }
}
