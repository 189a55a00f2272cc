//! How long a sub-step may be, and how many of them a tick gets.

use crate::math::Real;
use crate::model::{Body, State};

/// Most sub-steps of one tick: beyond it the body is too stiff for the tick and stands still instead of breaking.
pub const MOST_SUBSTEPS: u32 = 256;

/// Longest stable step [s] of `body` when its elements are `stiffening` times as stiff as at rest.
///
/// `Δt ≤ (2/ω)(√(1+ξ²) − ξ)`, `ξ = τω/2`, with `2/ω` the undamped limit (smallest altitude over wave speed, with its
/// safety factor) and τ the viscous relaxation time. Viscosity acts on the present shape, so it stiffens alike.
pub fn stable_step(body: &Body, stiffening: Real) -> Real {
    let undamped = body.undamped_step() / stiffening.sqrt();
    let xi = body.damping_time() / undamped;
    undamped * ((1.0 + xi * xi).sqrt() - xi)
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
    // The bound on stiffness is never below 1 (a state that is not finite would compare false and get all of them).
    let step = stable_step(body, state.stiffening.max(1.0));
    let needed = (tick / step).ceil();
    let needed = if needed <= f64::from(MOST_SUBSTEPS) { (needed as u32).max(1) } else { MOST_SUBSTEPS };
    let affordable = budget / (body.level().mesh.elements.len() as u32).max(1);
    Plan { needed, taken: needed.min(affordable) }
}
