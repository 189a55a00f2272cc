//! The contact solve of one sub-step: projected Gauss–Seidel on end-of-step positions, warm-started.
//!
//! For each point: `r = n·(Σ b_i (x_i + h v_i)) + d − (offset + rate·t)`, `d = Σ_j G_j λ_j` the dent;
//! `λ ← max(0, λ − r / (Δt h Σ b_i²/m_i + G))`, `h` the sub-step Δt or a longer
//! [horizon](Constraint::horizon), and the change of λ at once acts on the velocities
//! and on the other points' dents. The gap is closed as a whole: scaling it (Baumgarte) would make the force too small,
//! because G turns gap into force. Where there is friction, the tangential multiplier follows the same way, and is then cut
//! to the disc of radius μ λ [Coulomb]. A tool that hangs on springs gives way to the sum of its points' forces and turns
//! with the sum of their moments: compliances that all of them share.

use crate::math::{Real, Vec3};
use crate::model::constraint::{MOST_OBSTACLES, MOST_TOOLS, Pushed};
use crate::model::element_kernel::Padded;
use crate::model::{ActiveMesh, Constraint};

/// Sweeps over all points in one sub-step; the multipliers of the last sub-step are the start.
const SWEEPS: usize = 5;

/// What the sweeps need of each point beside the constraint itself; reused from tick to tick.
#[derive(Clone, Copy, Debug, Default)]
pub struct Prepared {
    /// Within which the gap is closed [s].
    horizon: Real,
    /// `Δt h Σ b²/m` [m/N].
    mobility: Real,
    /// Its own compliance G [m/N].
    compliance: Real,
    /// `n·Σ b_i x_i` at the start of the sub-step [m].
    position: Real,
    /// When it is to be closed, from the start of the tick [s].
    due: Real,
    /// Least `n·q` then [m].
    target: Real,
    /// `Σ_j G_j λ_j` [m].
    dent: Real,
    /// `Σ b_i x_i` at the start of the sub-step [m].
    place: Vec3,
    /// `Σ_j G_j τ_j` [m], tangential compliances.
    shear: Vec3,
}

/// Changes the velocities so that no surface point ends the sub-step inside a tool, and leaves each point's
/// multiplier [N] in `constraint.multiplier`. `end` [s]: end of the sub-step, from the start of the tick.
pub fn solve(mesh: &mut ActiveMesh, constraints: &mut [Constraint], prepared: &mut [Prepared], step: Real, end: Real) {
    let motion = &mut mesh.motion;
    let inverse_mass = &motion.inverse_mass;
    // By tool: the sum of what its points push with.
    let mut pushed = [Pushed::default(); MOST_TOOLS + MOST_OBSTACLES];
    for c in constraints.iter() {
        pushed[c.tool.index()].add(&c.arm, &(c.normal * c.multiplier + c.friction.multiplier));
    }
    for (i, p) in prepared[..constraints.len()].iter_mut().enumerate() {
        let c = &constraints[i];
        let mobility: Real = c.row.entries().iter().map(|&(n, b)| b * b * inverse_mass[n.index()]).sum();
        // Those of other tools have a compliance of zero.
        let others = || constraints[c.first as usize..].iter().zip(&c.compliance);
        let place = c.row.interpolate(&motion.position);
        let horizon = c.horizon.max(step);
        let due = end + (horizon - step);
        *p = Prepared {
            horizon,
            due,
            mobility: step * horizon * mobility,
            compliance: c.compliance[i - c.first as usize],
            position: c.normal.dot(&place),
            target: c.offset + c.rate * due,
            dent: others().map(|(other, g)| g * other.multiplier).sum(),
            place,
            shear: others().map(|(other, g)| other.friction.multiplier * (g * c.friction.compliance)).sum(),
        };
        push(&mut motion.velocity, inverse_mass, c, &c.normal, step * c.multiplier);
        if c.friction.coefficient > 0.0 {
            push(&mut motion.velocity, inverse_mass, c, &c.friction.multiplier, step);
        }
    }
    for sweep in 0..SWEEPS {
        for k in 0..constraints.len() {
            // To and fro: what one end is told by the other must not take a sweep for the way back.
            let i = if sweep % 2 == 0 { k } else { constraints.len() - 1 - k };
            let (c, p) = (&mut constraints[i], &prepared[i]);
            let moved = p.horizon * c.normal.dot(&c.row.interpolate(&motion.velocity));
            let pushed = &mut pushed[c.tool.index()];
            let open = p.position + moved - p.target + c.normal.dot(&pushed.give(&c.allowed_for, &c.coupling, &c.arm));
            let turned = c.coupling.angular_compliance * c.arm.cross(&c.normal).norm_squared();
            let mobility = p.mobility + c.coupling.compliance + turned;
            // A point that would pull is released: its multiplier stays at zero.
            let multiplier = (c.multiplier - (open + p.dent) / (mobility + p.compliance)).max(0.0);
            let change = multiplier - c.multiplier;
            if change != 0.0 {
                c.multiplier = multiplier;
                pushed.add(&c.arm, &(c.normal * change));
                push(&mut motion.velocity, inverse_mass, c, &c.normal, step * change);
                let others = prepared[c.first as usize..].iter_mut().zip(&c.compliance);
                others.for_each(|(other, g)| other.dent += g * change);
            }
            if c.friction.coefficient > 0.0 {
                let p = prepared[i];
                let place = p.place + c.row.interpolate(&motion.velocity) * p.horizon;
                let given_way = pushed.give(&c.allowed_for, &c.coupling, &c.arm);
                let apart = place + p.shear + given_way - (c.friction.anchor + c.friction.rate * p.due);
                let gap = apart - c.normal * c.normal.dot(&apart);
                // No direction along the surface turns the tool by more than this.
                let turned = c.coupling.angular_compliance * c.arm.norm_squared();
                let mobility = p.mobility + c.coupling.compliance + turned;
                let stuck = c.friction.multiplier - gap / (mobility + c.friction.compliance * p.compliance);
                let (most, size) = (c.friction.coefficient * c.multiplier, stuck.norm());
                let multiplier = if size > most { stuck * (most / size) } else { stuck };
                let change = multiplier - c.friction.multiplier;
                c.friction.multiplier = multiplier;
                pushed.add(&c.arm, &change);
                push(&mut motion.velocity, inverse_mass, c, &change, step);
                let others = prepared[c.first as usize..].iter_mut().zip(&c.compliance);
                others.for_each(|(other, g)| other.shear += change * (g * c.friction.compliance));
            }
        }
    }
}

/// Gives the point's nodes the impulse `impulse`·`direction` [N·s] through its row.
fn push(velocity: &mut [Padded], inverse_mass: &[Real], c: &Constraint, direction: &Vec3, impulse: Real) {
    for &(n, b) in c.row.entries() {
        let change = direction * (impulse * b * inverse_mass[n.index()]);
        for (v, d) in velocity[n.index()].iter_mut().zip(change.iter()) {
            *v += d;
        }
    }
}
