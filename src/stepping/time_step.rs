//! How long a sub-step may be, and how many of them a tick gets.

use crate::math::Real;
use crate::model::{Body, State};

/// Most sub-steps of one tick: beyond it the body is too stiff for the tick and stands still instead of breaking.
pub const MOST_SUBSTEPS: u32 = 256;

/// Longest stable step [s] of `body` when its elements are `stiffening` times as stiff as at rest and stretched to
/// `stretching` times their squared length.
///
/// The explicit limit of a mode of frequency ω with viscosity read before the kick is `Δt²ω²/2 + Δt·c ≤ 2`; at rest,
/// with `c = τω²`, that is `Δt ≤ (2/ω)(√(1+ξ²) − ξ)`, `ξ = τω/2`. Here `2/ω` is the undamped limit (smallest altitude
/// over wave speed, with its safety factor). Strain stiffens the elastic part; the viscous part, which knows nothing of
/// the compression term, grows only with the stretch.
pub fn stable_step(body: &Body, stiffening: Real, stretching: Real) -> Real {
    let omega = 2.0 / body.undamped_step();
    let elastic = stiffening * omega * omega;
    let viscous = stretching * body.damping_time() * omega * omega;
    ((viscous * viscous + 4.0 * elastic).sqrt() - viscous) / elastic
}

/// Sub-steps of one tick and what the budget left of them.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Plan {
    /// Sub-steps that the tick needs at the present stiffness.
    pub needed: u32,
    /// Sub-steps that are taken: fewer when the budget does not cover them.
    pub taken: u32,
}

/// Splits a tick of `tick` [s] into equal sub-steps, and takes as many as `budget` element evaluations allow.
pub fn plan(body: &Body, state: &State, tick: Real, budget: u32) -> Plan {
    let step = stable_step(body, state.stiffening.max(1.0), state.stretching.max(1.0));
    let needed = (tick / step).ceil();
    let needed = if needed <= f64::from(MOST_SUBSTEPS) { (needed as u32).max(1) } else { MOST_SUBSTEPS };
    let affordable = budget / (body.level().mesh.elements.len() as u32).max(1);
    Plan { needed, taken: needed.min(affordable) }
}
