//! Conjugate gradients, preconditioned by the coarser levels.

use super::CalibrationError;
use super::block::{Block, ZERO, add_scaled, dot, for_each_node};
use super::system::System;
use palpate_core::math::Real;

/// Most iterations of one solution.
const MOST_ITERATIONS: usize = 3000;
/// A solution is done when this many iterations ...
const LOOK_BACK: usize = 8;
/// ... add less than this part of its work, or what else its caller asks.
pub(super) const TOLERANCE: Real = 1e-7;

/// A solution that takes more iterations than this is that of a thin body, of which coarser levels tell little. ...
const SLOW: usize = 150;
/// ... Its last iterations are done when they add this many times as much. Gains fall by a part in a hundred there, so that
/// some thousandth of the work is left, which is as exact as levels are to agree.
const SLOW_TOLERANCE: Real = 100.0;

/// Unbalanced part of the load that is left when all that is still to be found is rounding.
const ROUNDED: Real = 1e-12;

/// Solves level `l` under `load` from the displacements `u`, by preconditioned conjugate gradients, until
/// [`LOOK_BACK`] iterations add less than `tolerance` of the work.
pub(super) fn solve(
    systems: &[System],
    l: usize,
    load: &[Block],
    mut u: Vec<Block>,
    tolerance: Real,
) -> Result<Vec<Block>, CalibrationError> {
    let system = &systems[l];
    let mut r = load.to_vec();
    for_each_node(&mut r, |n, r| add_scaled(r, -1.0, &system.force(n, &u)));
    let mut p = vec![ZERO; u.len()];
    let mut q = p.clone();
    let mut rz = 0.0;
    // What the iterations add to the work 2 f·u − u·K u, which the solution makes largest.
    let mut work = dot(load, &u) + dot(&r, &u);
    let mut gains = [Real::INFINITY; LOOK_BACK];
    let mut iterations = 0;
    loop {
        let z = precondition(systems, l, &r);
        let rz_before = rz;
        rz = dot(&r, &z);
        let enough = if iterations > SLOW { SLOW_TOLERANCE * tolerance } else { tolerance };
        if rz == 0.0 || gains.iter().sum::<Real>() <= enough * work {
            return Ok(u);
        }
        let beta = if iterations == 0 { 0.0 } else { rz / rz_before };
        for_each_node(&mut p, |n, p| {
            let mut next = z[n];
            add_scaled(&mut next, beta, p);
            *p = next;
        });
        for_each_node(&mut q, |n, q| *q = system.force(n, &p));
        let step = rz / dot(&p, &q);
        let gain = step * rz;
        #[expect(clippy::neg_cmp_op_on_partial_ord, reason = "NaN is no gain, too")]
        if !(gain > 0.0) || iterations == MOST_ITERATIONS {
            let residual = (dot(&r, &r) / dot(load, load)).sqrt();
            // The few unknowns of a very small body are found before there is anything to look back at; and a level that is
            // solved directly, but for roundings that a slender body makes much of.
            let last = gains[(iterations + LOOK_BACK - 1) % LOOK_BACK];
            if residual < ROUNDED || residual < 0.01 && last <= tolerance * work {
                return Ok(u);
            }
            let spacing = system.level.spacing;
            return Err(if gain > 0.0 && !system.level.fills_body() {
                CalibrationError::TooThin { level: l, spacing, iterations }
            } else {
                CalibrationError::NotConverged { level: l, residual, iterations }
            });
        }
        for_each_node(&mut u, |n, u| add_scaled(u, step, &p[n]));
        for_each_node(&mut r, |n, r| add_scaled(r, -step, &q[n]));
        work += gain;
        gains[iterations % LOOK_BACK] = gain;
        iterations += 1;
    }
}

/// Displacements that roughly balance the forces `r` [N]: what each node alone would give way, on this level and on all
/// coarser ones [Bramble, Pasciak and Xu 1990]; the coarse levels carry forces across the body at once.
fn precondition(systems: &[System], l: usize, r: &[Block]) -> Vec<Block> {
    let system = &systems[l];
    if let Some(direct) = &system.direct {
        return direct.correction(r);
    }
    let mut z = vec![ZERO; r.len()];
    for_each_node(&mut z, |n, z| {
        let k = &system.inverse_diagonal[n];
        for i in 0..3 {
            for j in 0..3 {
                z[i][j] = k[i][0] * r[n][0][j] + k[i][1] * r[n][1][j] + k[i][2] * r[n][2][j];
            }
        }
    });
    if let Some(grid) = &system.grid {
        grid.add_correction(r, &mut z);
    } else if l > 0 && system.coarser.len() == r.len() {
        system.add_from_coarser(&precondition(systems, l - 1, &system.to_coarser(r)), &mut z);
    }
    z
}
