//! The contact solve of one sub-step: projected Gauss–Seidel on end-of-step positions, warm-started.
//!
//! For each point: `r = n·(Σ b_i (x_i + Δt v_i)) + G λ − (offset + rate·t)`,
//! `λ ← max(0, λ − r / (Δt² Σ b_i²/m_i + G))`, and the change of λ at once acts on the velocities. The gap is closed
//! as a whole: scaling it (Baumgarte) would make the force too small, because G turns gap into force.

use crate::math::Real;
use crate::model::constraint::FIRMER;
use crate::model::element_kernel::Padded;
use crate::model::{ActiveMesh, Constraint};

/// Sweeps over all points in one sub-step; the multipliers of the last sub-step are the start.
const SWEEPS: usize = 3;

/// What the sweeps need of each point beside the constraint itself; reused from tick to tick.
#[derive(Clone, Copy, Debug, Default)]
pub struct Prepared {
    /// `Δt² Σ b²/m + G` [m/N].
    response: Real,
    /// `n·Σ b_i x_i` at the start of the sub-step [m].
    position: Real,
    /// Least `n·q` at the end of the sub-step [m].
    target: Real,
}

/// Changes the velocities so that no surface point ends the sub-step inside a tool, and leaves each point's
/// multiplier [N] in `constraint.multiplier`. `end` [s]: end of the sub-step, from the start of the tick.
pub fn solve(mesh: &mut ActiveMesh, constraints: &mut [Constraint], prepared: &mut [Prepared], step: Real, end: Real) {
    let motion = &mut mesh.motion;
    let inverse_mass = &motion.inverse_mass;
    for (c, p) in constraints.iter_mut().zip(prepared.iter_mut()) {
        let mobility: Real = c.row.entries().iter().map(|&(n, b)| b * b * inverse_mass[n as usize]).sum();
        p.response = step * step * mobility + c.compliance;
        p.position = c.normal.dot(&c.row.interpolate(&motion.position));
        p.target = c.offset + c.rate * end;
        push(&mut motion.velocity, inverse_mass, c, step * c.multiplier);
    }
    for _ in 0..SWEEPS {
        for (c, p) in constraints.iter_mut().zip(prepared.iter()) {
            let moved = step * c.normal.dot(&c.row.interpolate(&motion.velocity));
            let residual = p.position + moved + c.compliance * c.multiplier - p.target;
            let compliant = c.multiplier - residual / p.response;
            // Beyond the largest dent only a part of the compliance is left; the larger multiplier is the right one.
            let rest = FIRMER * c.compliance;
            let deep = p.position + moved + (1.0 - FIRMER) * c.most_dent + rest * c.multiplier - p.target;
            let firm = c.multiplier - deep / (p.response - c.compliance + rest);
            // A point that would pull is released: its multiplier stays at zero.
            let multiplier = compliant.max(firm).max(0.0);
            let change = multiplier - c.multiplier;
            if change != 0.0 {
                c.multiplier = multiplier;
                push(&mut motion.velocity, inverse_mass, c, step * change);
            }
        }
    }
}

/// Gives the point's nodes the impulse `impulse`·n [N·s] through its row.
fn push(velocity: &mut [Padded], inverse_mass: &[Real], c: &Constraint, impulse: Real) {
    for &(n, b) in c.row.entries() {
        let change = c.normal * (impulse * b * inverse_mass[n as usize]);
        for (v, d) in velocity[n as usize].iter_mut().zip(change.iter()) {
            *v += d;
        }
    }
}
