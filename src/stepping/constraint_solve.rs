//! The contact solve of one sub-step: projected Gauss–Seidel on end-of-step positions, warm-started.
//!
//! For each point: `r = n·(Σ b_i (x_i + Δt v_i)) + Σ_j G_j λ_j − (offset + rate·t)`,
//! `λ ← max(0, λ − r / (Δt² Σ b_i²/m_i + G))`, and the change of λ at once acts on the velocities and on the other
//! points' dents. The gap is closed as a whole: scaling it (Baumgarte) would make the force too small, because G turns
//! gap into force.

use crate::math::Real;
use crate::model::constraint::FIRMER;
use crate::model::element_kernel::Padded;
use crate::model::{ActiveMesh, Constraint};

/// Sweeps over all points in one sub-step; the multipliers of the last sub-step are the start.
const SWEEPS: usize = 3;

/// What the sweeps need of each point beside the constraint itself; reused from tick to tick.
#[derive(Clone, Copy, Debug, Default)]
pub struct Prepared {
    /// `Δt² Σ b²/m` [m/N].
    mobility: Real,
    /// Its own compliance G [m/N].
    compliance: Real,
    /// `n·Σ b_i x_i` at the start of the sub-step [m].
    position: Real,
    /// Least `n·q` at the end of the sub-step [m].
    target: Real,
    /// `Σ_j G_j λ_j` [m].
    dent: Real,
}

/// Changes the velocities so that no surface point ends the sub-step inside a tool, and leaves each point's
/// multiplier [N] in `constraint.multiplier`. `end` [s]: end of the sub-step, from the start of the tick.
pub fn solve(mesh: &mut ActiveMesh, constraints: &mut [Constraint], prepared: &mut [Prepared], step: Real, end: Real) {
    let motion = &mut mesh.motion;
    let inverse_mass = &motion.inverse_mass;
    for (i, p) in prepared[..constraints.len()].iter_mut().enumerate() {
        let c = &constraints[i];
        let mobility: Real = c.row.entries().iter().map(|&(n, b)| b * b * inverse_mass[n as usize]).sum();
        let others = constraints[c.first as usize..].iter().zip(&c.compliance);
        *p = Prepared {
            mobility: step * step * mobility,
            compliance: c.compliance[i - c.first as usize],
            position: c.normal.dot(&c.row.interpolate(&motion.position)),
            target: c.offset + c.rate * end,
            // Those of other tools have a compliance of zero.
            dent: others.map(|(other, g)| g * other.multiplier).sum(),
        };
        push(&mut motion.velocity, inverse_mass, c, step * c.multiplier);
    }
    for _ in 0..SWEEPS {
        for i in 0..constraints.len() {
            let (c, p) = (&mut constraints[i], &prepared[i]);
            let moved = step * c.normal.dot(&c.row.interpolate(&motion.velocity));
            let open = p.position + moved - p.target;
            let compliant = c.multiplier - (open + p.dent) / (p.mobility + p.compliance);
            // Beyond the largest dent only a part of the compliance is left; the larger multiplier is the right one.
            let deep = open + (1.0 - FIRMER) * c.most_dent + FIRMER * p.dent;
            let firm = c.multiplier - deep / (p.mobility + FIRMER * p.compliance);
            // A point that would pull is released: its multiplier stays at zero.
            let multiplier = compliant.max(firm).max(0.0);
            let change = multiplier - c.multiplier;
            if change != 0.0 {
                c.multiplier = multiplier;
                push(&mut motion.velocity, inverse_mass, c, step * change);
                let others = prepared[c.first as usize..].iter_mut().zip(&c.compliance);
                others.for_each(|(other, g)| other.dent += g * change);
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
