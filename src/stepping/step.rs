//! The step: drift, kick, drift (position Verlet).
//!
//! Half a drift, forces at the middle, a kick, half a drift: one force evaluation per step, second order and
//! symplectic without damping; damping reads the velocity before the kick and is first order. Contact is held at the
//! next middle, where forces will be evaluated again.

use super::constraint_solve::{self, Prepared};
use super::internal_force::internal_force;
use crate::math::{Real, Vec3};
use crate::model::element_kernel::{Extremes, PaddedForce, Path};
use crate::model::{Body, Constraint, State};

/// Memory that the step needs and no one keeps.
#[derive(Debug)]
pub struct Workspace {
    force: Vec<PaddedForce>,
    prepared: Vec<Prepared>,
}

impl Workspace {
    /// For `body` and at most `constraints` points at a time.
    pub fn new(body: &Body, constraints: usize) -> Self {
        Self { force: vec![[0.0; 4]; body.level().mesh.nodes.len()], prepared: vec![Prepared::default(); constraints] }
    }
}

/// Moves `state` by `count` sub-steps of `step` [s] in the field `gravity` [m/s²], and leaves the mean multiplier of
/// each constraint over them.
pub fn substeps(
    path: Path,
    body: &Body,
    state: &mut State,
    constraints: &mut [Constraint],
    gravity: Vec3,
    (count, step): (u32, Real),
    work: &mut Workspace,
) -> Extremes {
    let mut extremes = Extremes::REST;
    constraints.iter_mut().for_each(|c| c.mean_multiplier = 0.0);
    for i in 0..count {
        drift(state, 0.5 * step);
        extremes = internal_force(path, body, state, &mut work.force);
        kick(body, state, &work.force, gravity, step);
        let next_middle = (Real::from(i) + 1.5) * step;
        constraint_solve::solve(body, state, constraints, &mut work.prepared, step, next_middle);
        constraints.iter_mut().for_each(|c| c.mean_multiplier += c.multiplier);
        drift(state, 0.5 * step);
        state.stiffening = extremes.stiffening();
        state.stretching = extremes.stretching();
    }
    constraints.iter_mut().for_each(|c| c.mean_multiplier /= Real::from(count.max(1)));
    extremes
}

fn drift(state: &mut State, step: Real) {
    for (x, v) in state.position.iter_mut().zip(&state.velocity) {
        *x += v * step;
    }
}

fn kick(body: &Body, state: &mut State, force: &[PaddedForce], gravity: Vec3, step: Real) {
    for ((v, f), &inverse_mass) in state.velocity.iter_mut().zip(force).zip(body.inverse_mass()) {
        // Nodes held fast have no inverse mass and never had a velocity.
        if inverse_mass > 0.0 {
            *v += (Vec3::new(f[0], f[1], f[2]) * inverse_mass + gravity) * step;
        }
    }
}
