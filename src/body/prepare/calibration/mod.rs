//! Levels that answer alike: a stiffness factor for each element.
//!
//! Linear tetrahedra are too stiff, the more so the larger they are: a coarse level sags less under the same weight than
//! a fine one, and swings faster. Factors on λ and μ of each level take that out: they are chosen so that the level moves
//! under a smooth load as the finest level does, which keeps its material as it is. From place to place they change
//! slowly, so that each load moves each part as it should (`softness`), and stiffen no element; then one more factor, near
//! 1, sets the amplitude.
//!
//! The load is the body's weight along each of the three axes, as the finest level bears it, handed down to the coarser
//! ones. What must agree is the root mean square of the displacement, over the mass and all axes. That stands between
//! the work of the load, which makes amplitudes agree but leaves coarse levels swinging too slowly (their mass reaches
//! beyond the body), and the first frequency, which leaves them sagging too little; it takes no mode to be found. Only
//! what deforms the body counts: sinking and tipping as a whole on soft springs tells nothing about its elements. A body
//! that nothing holds is loaded without resultant instead, its middle against its ends.
//!
//! Locked elements store less of the same work as shear, which alone the Maxwell branches damp: the moduli of these get a
//! factor of the level's own, too, the finest level's part of shear in the energy of the answers over its own.
//!
//! Each answer is a linear elastic solution at rest, by conjugate gradients. The three axes are solved as one system, a
//! node's unknown being a 3×3 block with a column per axis: that reads the matrix once for three. All of it is
//! `+ − × ÷ √` in a fixed order, whatever the number of threads: each row of the matrix gathers its own sum, and sums
//! over nodes run in chunks of fixed length.

mod block;
mod direct;
mod grid;
mod load;
mod matrix;
mod rigid;
mod softness;
mod solver;
pub mod stabilisation;
mod system;

use block::{Block, ZERO, add_scaled, columns, product};
use load::{balanced_load, weight};
use matrix::weights_of;
use palpate_core::hierarchy::Level;
use palpate_core::math::{Mat3, Real, Vec3};
use palpate_core::model::material::Material;
use rayon::prelude::*;
use rigid::{holds_firmly, mean_motion};
use softness::local_factors;
use solver::{SLOW, TOLERANCE, solve};
use system::{System, row};

/// Smallest factor ever returned: with a smaller one the level's own shape and holds are wrong, not its stiffness.
pub const LEAST_FACTOR: Real = 0.2;
/// Largest factor ever returned: a level that is far softer than the finest does not cover the same body, and stiffening
/// it shortens its step.
pub const LARGEST_FACTOR: Real = 1.5;
/// Largest factor on the moduli of a level's Maxwell branches.
const MOST_DAMPED: Real = 1.5;
/// How often the softness is changed from place to place. A third time changes periods and amplitudes by a thousandth.
const ROUNDS: usize = 2;

/// Why levels could not be calibrated.
#[derive(Debug, PartialEq, thiserror::Error)]
pub enum CalibrationError {
    /// The elastic solution was not found: an element is degenerate, or stiffness differs too much from place to place.
    #[error(
        "level {level} does not come to rest under its weight ({:.1e} of it unbalanced after {iterations} iterations): \
         look for flat or inverted elements in it",
        residual
    )]
    NotConverged {
        /// Level, coarsest first.
        level: usize,
        /// Unbalanced force over the load, both as root of the sum of squares.
        residual: Real,
        /// Iterations done.
        iterations: usize,
    },
    /// The elastic solution would take too long: coarse levels cannot bend as fine ones do.
    #[error(
        "level {level} does not come to rest under its weight within {iterations} iterations: much of the body is too thin \
         or slender for elements of {:.1} mm; give finer levels (--finest or --levels), or thicken or leave out what is thin",
        1e3 * spacing
    )]
    TooThin {
        /// Level, coarsest first.
        level: usize,
        /// Its spacing [m].
        spacing: Real,
        /// Iterations done.
        iterations: usize,
    },
}

/// What the answers to a smooth load tell.
#[derive(Clone, Debug, PartialEq)]
pub struct Calibration {
    /// Factors on λ and μ (n_levels × n_elements) that make all levels answer as the finest does; 1 on the last one.
    pub factors: Vec<Vec<Real>>,
    /// Factors on the moduli of Maxwell branches over μ (n_levels) that make all levels damp as the finest does; 1 on the
    /// last one.
    pub branch_factors: Vec<Real>,
    /// Angular frequency ω₁ of the slowest mode [rad/s], without the body's sinking on its holds: Rayleigh and Ritz's
    /// estimate from the three answers, a few per cent too high at most. 0 when nothing moves.
    pub slowest_mode: Real,
}

/// Makes all levels answer to a smooth load as the finest does.
///
/// `material` of an element, by level and element. `holds`: display vertices held by springs [N/m], which act through
/// the rows of `embedding` and are not scaled. The levels must be tied, embedded and have their fixed nodes. Accurate to
/// 1e-3; [`LEAST_FACTOR`] or [`LARGEST_FACTOR`] on all elements means that no factor makes that level agree.
///
/// # Errors
/// When a level has no elastic solution.
pub fn calibrate(
    levels: &[Level],
    material: impl Fn(usize, usize) -> Material + Sync,
    holds: &[(u32, Real)],
) -> Result<Calibration, CalibrationError> {
    let mut factors: Vec<Vec<Real>> = levels.iter().map(|level| vec![1.0; level.mesh.elements.len()]).collect();
    let mut systems = loaded(levels, &material, holds);
    let last = levels.len().saturating_sub(1);
    let mut answers = answers(&systems, TOLERANCE)?;
    let mut branch_factors = vec![1.0; levels.len()];
    let Some(finest) = answers.pop() else { return Ok(Calibration { factors, branch_factors, slowest_mode: 0.0 }) };
    let sheared = part_of_shear(&levels[last], |e| material(last, e), &factors[last], &finest.displacement);
    let slowest_mode = slowest_mode(&systems[last], &finest.deforming);
    let wanted = at_coarser_nodes(levels, finest.deforming);
    // Coarse elements are too stiff already; none is to be stiffer than the finest.
    let stiffest = |l: usize| mean_modulus(levels, levels.len() - 1, &material) / mean_modulus(levels, l, &material);
    for (l, (level, (mut now, wanted))) in levels.iter().zip(answers.into_iter().zip(&wanted)).enumerate() {
        // Amplitudes go almost with the softness. Where a level cannot follow the finest, its parts cannot, either.
        let factor = now.amplitude / finest.amplitude;
        if !wanted.is_empty() && (LEAST_FACTOR..LARGEST_FACTOR).contains(&factor) {
            factors[l].fill(factor);
            now = respond(&mut systems, levels, l, &material, &factors[l], now.displacement)?;
            // Changes from place to place take twenty answers more, which would be minutes.
            for _ in 0..if now.is_slow { 0 } else { ROUNDS } {
                factors[l] = local_factors(&systems, l, &material, &factors[l], &now, wanted, factor.max(stiffest(l)))?;
                now = respond(&mut systems, levels, l, &material, &factors[l], now.displacement)?;
            }
        }
        // One more factor on all elements leaves the parts of the energy as they are.
        let own = part_of_shear(level, |e| material(l, e), &factors[l], &now.displacement);
        if sheared > 0.0 && own > 0.0 {
            branch_factors[l] = (sheared / own).clamp(1.0 / MOST_DAMPED, MOST_DAMPED);
        }
        let all = |factor| factors[l].iter().map(|f| within(f * factor)).collect::<Vec<_>>();
        let factor = matching_factor(now, finest.amplitude, |factor, guess| {
            respond(&mut systems, levels, l, &material, &all(factor), guess)
        })?;
        factors[l] = all(factor);
    }
    Ok(Calibration { factors, branch_factors, slowest_mode })
}

/// The equations of all levels, under the weight of the finest along each axis; of a body that nothing holds under its
/// [`balanced_load`].
fn loaded<'a>(
    levels: &'a [Level],
    material: &(impl Fn(usize, usize) -> Material + Sync),
    holds: &'a [(u32, Real)],
) -> Vec<System<'a>> {
    // All levels bear the same load, or their answers could not be compared.
    let held = levels.iter().all(|level| holds_firmly(level, holds));
    let system = |l: usize| System::new(levels, l, material, levels[l].stabilisation, held.then_some(holds));
    let mut systems: Vec<System> = (0..levels.len()).map(system).collect();
    bear(&mut systems, if held { weight } else { balanced_load });
    systems
}

/// Puts the finest level's load on all levels.
fn bear(systems: &mut [System], load_of: fn(&Level) -> Vec<Block>) {
    let mut load = Vec::new();
    for l in (0..systems.len()).rev() {
        load = match systems.get(l + 1) {
            Some(finer) if finer.is_tied() => finer.to_coarser(&load),
            _ => load_of(systems[l].level),
        };
        // What fixed nodes bear does not reach the body.
        load.iter_mut().enumerate().filter(|(n, _)| systems[l].is_fixed(*n)).for_each(|(_, load)| *load = ZERO);
        systems[l].bear(&load);
    }
}

/// The answers of all levels to their loads, as exactly as `tolerance` asks ([`solve`]).
fn answers(systems: &[System], tolerance: Real) -> Result<Vec<Answer>, CalibrationError> {
    let mut answers: Vec<Answer> = Vec::new();
    for (l, system) in systems.iter().enumerate() {
        let mut guess = vec![ZERO; system.load.len()];
        if let Some(coarser) = answers.last() {
            system.add_from_coarser(&coarser.displacement, &mut guess);
        }
        answers.push(answer(systems, l, &system.load, guess, tolerance)?);
    }
    Ok(answers)
}

/// The nearest factor within the range.
fn within(factor: Real) -> Real {
    factor.clamp(LEAST_FACTOR, LARGEST_FACTOR)
}

/// The finest level's displacements at the nodes of the coarser levels (n_levels - 1); none below levels without ties.
fn at_coarser_nodes(levels: &[Level], finest: Vec<Block>) -> Vec<Vec<Block>> {
    let mut all = vec![finest];
    for pair in levels.windows(2).rev() {
        let (coarse, fine, displacement) = (&pair[0], &pair[1], &all[all.len() - 1]);
        let tied = !displacement.is_empty() && coarse.finer_host.len() == coarse.mesh.nodes.len();
        let at = |host| {
            let (nodes, weights) = row(host, &fine.mesh);
            let mut u = ZERO;
            nodes.iter().zip(weights).for_each(|(n, weight)| add_scaled(&mut u, weight, &displacement[*n as usize]));
            u
        };
        let coarser = if tied { coarse.finer_host.iter().map(at).collect() } else { Vec::new() };
        all.push(coarser);
    }
    all.reverse();
    all.pop();
    all
}

/// Mean of λ + 2μ [Pa] over the elements of level `l`.
fn mean_modulus(levels: &[Level], l: usize, material: &impl Fn(usize, usize) -> Material) -> Real {
    let elements = levels[l].mesh.elements.len();
    (0..elements).map(|e| material(l, e).pressure_modulus()).sum::<Real>() / elements as Real
}

/// How much of the strain energy of the displacements `u` of `level`, along all axes together, is shear's: `μ dev ε:ε` over
/// `½ λ (tr ε)² + μ ε:ε` and what fibres have.
fn part_of_shear(level: &Level, material: impl Fn(usize) -> Material + Sync, factors: &[Real], u: &[Block]) -> Real {
    let of_element = |e: usize| {
        let (gradients, volume) = weights_of(&level.mesh.corners(e));
        let (material, weight) = (material(e), factors[e] * level.fraction[e] * volume);
        let (mut all, mut sheared) = (0.0, 0.0);
        for axis in 0..3 {
            let along = |n: u32| Vec3::from(u[n as usize].map(|row| row[axis]));
            let nodes = level.mesh.elements[e];
            let gradient: Mat3 = nodes.iter().zip(gradients).map(|(n, g)| along(*n) * g.transpose()).sum();
            let strain = (gradient + gradient.transpose()) * 0.5;
            let (square, trace) = (strain.dot(&strain), strain.trace());
            let of_fibres = material.fibres.energy_density(&strain);
            all += weight * (0.5 * material.lambda * trace * trace + material.mu * square + of_fibres);
            sheared += weight * material.mu * (square - trace * trace / 3.0);
        }
        (all, sheared)
    };
    let each: Vec<(Real, Real)> = (0..level.mesh.elements.len()).into_par_iter().map(of_element).collect();
    let (all, sheared) = each.iter().fold((0.0, 0.0), |sum, x| (sum.0 + x.0, sum.1 + x.1));
    if all > 0.0 { sheared / all } else { 0.0 }
}

/// `material`, stiffer by `factor`.
pub(super) fn scaled(material: Material, factor: Real) -> Material {
    let fibres = material.fibres.stiffened(factor);
    Material { lambda: factor * material.lambda, mu: factor * material.mu, fibres, ..material }
}

/// The slowest mode [rad/s] among the combinations of the answers `u` to the loads along the three axes: the largest
/// eigenvalue of `K⁻¹M`, `K_ij = u_i·f_j`, `M_ij = Σ m u_i·u_j`.
fn slowest_mode(system: &System, deforming: &[Block]) -> Real {
    let (mut k, mut m) = (Mat3::zeros(), Mat3::zeros());
    for ((u, f), mass) in deforming.iter().zip(&system.load).zip(&system.level.node_mass) {
        // Rows are components, columns axes.
        let (u, f) = (columns(u).transpose(), columns(f).transpose());
        // What deforms the body is kept with its sign turned.
        k -= u.transpose() * f;
        m += u.transpose() * u * *mass;
    }
    let Some(inverse) = k.try_inverse() else { return 0.0 };
    let mut shape = Vec3::new(1.0, 0.8, 0.6);
    let mut largest = 0.0;
    for _ in 0..200 {
        let next = inverse * (m * shape);
        largest = next.norm();
        #[expect(clippy::neg_cmp_op_on_partial_ord, reason = "NaN, too, must leave here")]
        if !(largest > 0.0) {
            return 0.0;
        }
        shape = next / largest;
    }
    1.0 / largest.sqrt()
}

/// The factor at which a level has the amplitude `wanted`; `answer` is its answer at factor 1.
///
/// Secants in the softness `1/factor`: the amplitude is almost proportional to it, but for what the holds give way.
fn matching_factor(
    mut answer: Answer,
    wanted: Real,
    mut solve: impl FnMut(Real, Vec<Block>) -> Result<Answer, CalibrationError>,
) -> Result<Real, CalibrationError> {
    let (mut factor, mut softness) = (1.0, 1.0);
    // Rigid elements do not deform.
    let mut before = (0.0, 0.0);
    for _ in 0..8 {
        let slope = (answer.amplitude - before.1) / (softness - before.0);
        // Nothing moves when every node is fixed; then any factor will do.
        if !(slope > 0.0 && slope.is_finite()) {
            break;
        }
        before = (softness, answer.amplitude);
        softness = (softness + (wanted - answer.amplitude) / slope).clamp(1.0 / LARGEST_FACTOR, 1.0 / LEAST_FACTOR);
        let change = (softness / before.0 - 1.0).abs();
        factor = 1.0 / softness;
        // The last secant corrects far more than what it leaves.
        if change < 1e-3 {
            break;
        }
        answer = solve(factor, answer.displacement)?;
    }
    Ok(within(factor))
}

/// How a level answers to its load.
struct Answer {
    /// Displacement, per axis [m] (n_nodes).
    displacement: Vec<Block>,
    /// What of it deforms the body, its sign turned [m] (n_nodes).
    deforming: Vec<Block>,
    /// Root of the sum over the mass of its square, all axes together [m √kg].
    amplitude: Real,
    /// Whether it took long to find.
    is_slow: bool,
}

/// The answer of level `l` to its load when its elements are stiffer than `material` by `factors`, from the displacements
/// `guess`.
fn respond<'a>(
    systems: &mut [System<'a>],
    levels: &'a [Level],
    l: usize,
    material: &(impl Fn(usize, usize) -> Material + Sync),
    factors: &[Real],
    guess: Vec<Block>,
) -> Result<Answer, CalibrationError> {
    systems[l].set_material(levels, l, &|l, e| scaled(material(l, e), factors[e]), 1.0);
    answer(systems, l, &systems[l].load, guess, TOLERANCE)
}

/// The answer of level `l` to `load`, from the displacements `guess`, as exactly as `tolerance` asks ([`solve`]).
fn answer(
    systems: &[System],
    l: usize,
    load: &[Block],
    guess: Vec<Block>,
    tolerance: Real,
) -> Result<Answer, CalibrationError> {
    let system = &systems[l];
    let (displacement, iterations) = solve(systems, l, load, guess, tolerance)?;
    // Where little or nothing holds the body, it may have drifted; what deforms it leaves the holds in balance.
    let drift = match system.holds {
        Some(_) => {
            let forces: Vec<Block> = (0..displacement.len()).map(|n| system.force_of_holds(n, &displacement)).collect();
            system.rigid_motion(&forces)
        }
        None => mean_motion(system.level, &displacement),
    };
    let mut deforming = system.in_place(&drift);
    let mut squares = 0.0;
    for ((drift, u), m) in deforming.iter_mut().zip(&displacement).zip(&system.level.node_mass) {
        add_scaled(drift, -1.0, u);
        squares += m * product(drift, drift);
    }
    Ok(Answer { displacement, deforming, amplitude: squares.sqrt(), is_slow: iterations > SLOW })
}

#[cfg(test)]
mod tests;
