//! How soft the elements of a level are made, from place to place.
//!
//! The thinner a body is, the more a coarse level's elements are too stiff there; and next to holds the mesh ends elsewhere
//! than the body. No single factor makes up for both. The softness, one over the factor, is therefore changed by a
//! polynomial of second order in the position at rest. Its coefficients are those that bring the level's answers nearest
//! to the finest level's in the least squares over the mass.

use super::block::{Block, ZERO, add_scaled, columns};
use super::matrix::weights_of;
use super::rigid::Arms;
use super::system::System;
use super::{Answer, CalibrationError, answer, scaled, within};
use nalgebra::{SMatrix, SVector};
use palpate_core::math::{Mat3, Real, Vec3};
use palpate_core::model::material::Material;
use rayon::prelude::*;

/// Terms of the polynomial.
const TERMS: usize = 10;
type Terms = SVector<Real, TERMS>;

/// How much more than their shapes the answers' amplitudes count. With a twentieth of it, the bundled liver of 237 nodes
/// swings too slowly.
const AMPLITUDE_WEIGHT: Real = 100.0;

/// What the square of a coefficient costs, the mean softness and the squares of the wanted answers being one each: it
/// keeps those small that make next to no difference.
const COST: Real = 0.01;

/// How exactly changes are solved for ([`solve`](super::solver::solve)): they only point the way.
const TOLERANCE: Real = 1e-6;

/// Factors on the stiffness of the elements of level `l` (n_elements) that bring its answers, `now` at `factors`, nearer
/// to `wanted` (n_nodes), which is what deforms the body [m]: a step of Gauss and Newton.
///
/// None is made larger than `stiffest`: what stiffens some elements to make up for others is felt by a tool. With factors
/// up to 1.5, a ball on a block feels 8 % too much.
pub(super) fn local_factors(
    systems: &[System],
    l: usize,
    material: &impl Fn(usize, usize) -> Material,
    factors: &[Real],
    now: &Answer,
    wanted: &[Block],
    stiffest: Real,
) -> Result<Vec<Real>, CalibrationError> {
    let level = systems[l].level;
    let mass = &level.node_mass;
    // Loads along other axes must lead to the same: answers are measured by the products of the wanted ones.
    let Some(measure) = products(mass, wanted, wanted).try_inverse() else { return Ok(factors.to_vec()) };
    let arms = Arms::new(level);
    let middle = |e| level.mesh.corners(e).iter().sum::<Vec3>() * 0.25;
    let terms: Vec<Terms> = (0..level.mesh.elements.len()).map(|e| terms(arms.to(&middle(e)))).collect();
    let mut changes = Vec::with_capacity(TERMS);
    for load in loads(&systems[l], |e| scaled(material(l, e), factors[e]), &terms, &now.displacement) {
        changes.push(answer(systems, l, &load, vec![ZERO; load.len()], TOLERANCE)?.deforming);
    }
    let mut gap = wanted.to_vec();
    gap.iter_mut().zip(&now.deforming).for_each(|(gap, now)| add_scaled(gap, -1.0, now));

    let along: Vec<Mat3> = changes.par_iter().map(|u| products(mass, u, wanted)).collect();
    let both = |i: usize, v: &[Block], v_along: &Mat3| {
        let amplitudes = along[i] * measure * v_along.transpose();
        (measure * (products(mass, &changes[i], v) + amplitudes * AMPLITUDE_WEIGHT)).trace()
    };
    // The lower triangle is all that the Cholesky factor reads.
    let row = |i| Terms::from_fn(|j, _| if j <= i { both(i, &changes[j], &along[j]) } else { 0.0 });
    let rows: Vec<Terms> = (0..TERMS).into_par_iter().map(row).collect();
    let mut matrix = SMatrix::<Real, TERMS, TERMS>::from_fn(|i, j| rows[i][j]);
    (1..TERMS).for_each(|i| matrix[(i, i)] += COST);
    let gap_along = products(mass, &gap, wanted);
    let right = Terms::from_fn(|i, _| both(i, &gap, &gap_along));
    let change = matrix.cholesky().map_or(Terms::zeros(), |matrix| matrix.solve(&right));
    let softer = |(terms, factor): (&Terms, &Real)| {
        let wanted = factor / (1.0 + terms.dot(&change)).max(Real::MIN_POSITIVE);
        within(wanted.min(stiffest))
    };
    Ok(terms.iter().zip(factors).map(softer).collect())
}

/// The loads (n_terms × n_nodes) that move the level on from `u` as far as each term does, added to a softness of 1.
fn loads(system: &System, material: impl Fn(usize) -> Material, terms: &[Terms], u: &[Block]) -> Vec<Vec<Block>> {
    let level = system.level;
    let mut loads = vec![vec![ZERO; u.len()]; TERMS];
    for (e, nodes) in level.mesh.elements.iter().enumerate() {
        let (gradients, volume) = weights_of(&level.mesh.corners(e));
        let Material { lambda, mu, .. } = material(e);
        let mut force = [ZERO; 4];
        for axis in 0..3 {
            let mut gradient = Mat3::zeros();
            for (n, g) in nodes.iter().zip(gradients) {
                gradient += columns(&u[*n as usize]).column(axis) * g.transpose();
            }
            let stress = Mat3::identity() * (lambda * gradient.trace()) + (gradient + gradient.transpose()) * mu;
            for (force, g) in force.iter_mut().zip(gradients) {
                let f = stress * g * (level.fraction[e] * volume);
                (0..3).for_each(|i| force[i][axis] = f[i]);
            }
        }
        for (load, term) in loads.iter_mut().zip(&terms[e]) {
            for (n, force) in nodes.iter().zip(&force).filter(|(n, _)| !system.is_fixed(**n as usize)) {
                add_scaled(&mut load[*n as usize], *term, force);
            }
        }
    }
    loads
}

/// Products of up to two coordinates of `arm`, weighted so that turns keep the sum of the coefficients' squares.
fn terms(arm: Vec3) -> Terms {
    let (x, y, z) = (arm.x, arm.y, arm.z);
    let mixed = std::f64::consts::SQRT_2;
    [1.0, x, y, z, x * x, y * y, z * z, mixed * x * y, mixed * y * z, mixed * z * x].into()
}

/// `Σ m u_i·v_j` of the displacements `u` and `v` for the loads along the axes `i` and `j`.
fn products(mass: &[Real], u: &[Block], v: &[Block]) -> Mat3 {
    mass.iter().zip(u).zip(v).fold(Mat3::zeros(), |sum, ((m, u), v)| sum + columns(u).transpose() * columns(v) * *m)
}
