//! Levels that answer alike: a stabilisation for each level of smoothed elements.
//!
//! Where stars ([`stars`](palpate_core::model::body::stars)) have a part of the energy, the part α of that of strain jumps which
//! tetrahedra keep is [`FINEST`] on the finest level, near the continuum on any mesh. What errs is the coarser levels' bending and
//! twisting, and that only: each gets the α at which it moves under a smooth load as far as the finest. Uniform strain has its
//! exact energy whatever α, so that no load is answered worse for it.
//!
//! The load is the body's weight along each of the three axes, as the finest level bears it, handed down to the coarser
//! ones. What must agree is the root mean square of the displacement, over the mass and all axes. That stands between
//! the work of the load, which makes amplitudes agree but leaves coarse levels swinging too slowly (their mass reaches
//! beyond the body), and the first frequency, which leaves them sagging too little; it takes no mode to be found. Only
//! what deforms the body counts: sinking and tipping as a whole on soft springs tells nothing about its elements. A body
//! that nothing holds is loaded without resultant instead, its middle against its ends.
//!
//! Each answer is a linear elastic solution at rest, by conjugate gradients. The three axes are solved as one system, a
//! node's unknown being a 3×3 block with a column per axis: that reads the matrix once for three. All of it is
//! `+ − × ÷ √` in a fixed order, whatever the number of threads: each row of the matrix gathers its own sum, and sums
//! over nodes run in chunks of fixed length.

pub mod agreement;
mod block;
mod direct;
mod grid;
mod load;
mod matrix;
mod rigid;
mod solver;
mod system;

use block::{Block, ZERO, add_scaled, columns, product};
use load::{balanced_load, weight};
use palpate_core::hierarchy::Level;
use palpate_core::math::{Mat3, Real, Vec3};
use palpate_core::model::body::stars::LARGEST;
use palpate_core::model::material::Material;
use rigid::{holds_firmly, mean_motion};
use solver::{TOLERANCE, solve};
use system::System;

/// α of the finest level. Measured in statics: with this, covers and structured meshes of cubes, bars and plates at ν of 0.3 to
/// 0.49 come nearest to the continuum in bending, torsion and under presses together. With less, presses come out too soft; with
/// more, bending too stiff.
pub const FINEST: Real = 0.35;
/// Least α of a level: with less, a tool that touches it feels more of the modes that means do not see than of the body; with more,
/// fewer coarse levels give way as far as the finest.
pub const LEAST: Real = 0.2;

/// Change of α, as a part, that is the last to be made: the next would change amplitudes by less than a thousandth. With more, levels
/// agree less; with less, each takes solutions more, which nothing shows.
const ENOUGH: Real = 1e-2;

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
    /// α (n_levels) at which all levels answer as the finest does, which keeps its own. [`LEAST`] or [`LARGEST`]: no α in that range
    /// makes the level agree. Levels of tetrahedra alone keep their 1.
    pub stabilisation: Vec<Real>,
    /// Angular frequency ω₁ of the slowest mode [rad/s], without the body's sinking on its holds: Rayleigh and Ritz's
    /// estimate from the three answers, a few per cent too high at most. 0 when nothing moves.
    pub slowest_mode: Real,
}

/// Makes all levels answer to a smooth load as the finest does, from the α that they have.
///
/// `material` of an element, by level and element. `holds`: display vertices held by springs [N/m], which act through
/// the rows of `embedding`. The levels must be tied, embedded and have their fixed nodes.
///
/// # Errors
/// When a level has no elastic solution.
pub fn calibrate(
    levels: &[Level],
    material: impl Fn(usize, usize) -> Material + Sync,
    holds: &[(u32, Real)],
) -> Result<Calibration, CalibrationError> {
    let mut stabilisation: Vec<Real> = levels.iter().map(|level| level.stabilisation).collect();
    let mut systems = loaded(levels, &material, holds);
    let mut answers = answers(&systems, TOLERANCE)?;
    let Some(finest) = answers.pop() else { return Ok(Calibration { stabilisation, slowest_mode: 0.0 }) };
    let slowest_mode = systems.last().map_or(0.0, |system| slowest_mode(system, &finest.deforming));
    for (l, now) in answers.into_iter().enumerate().filter(|(l, _)| levels[*l].stabilisation < 1.0) {
        stabilisation[l] = matching(now, stabilisation[l], finest.amplitude, |alpha, guess| {
            systems[l].set_stabilisation(levels, l, &material, alpha);
            answer(&systems, l, &systems[l].load, guess, TOLERANCE)
        })?;
    }
    Ok(Calibration { stabilisation, slowest_mode })
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

/// The α at which a level has the amplitude `wanted`; `answer` is its answer at `alpha`.
///
/// Secants in one over the amplitude, which is a stiffness and almost linear in α: matrices are. Not logarithms, which are not
/// the same on every machine.
fn matching(
    mut answer: Answer,
    mut alpha: Real,
    wanted: Real,
    mut solve: impl FnMut(Real, Vec<Block>) -> Result<Answer, CalibrationError>,
) -> Result<Real, CalibrationError> {
    // Nothing moves when every node is fixed; then any α will do.
    if !(answer.amplitude > 0.0 && wanted > 0.0) {
        return Ok(alpha);
    }
    let stiffness = |answer: &Answer| 1.0 / answer.amplitude;
    let wanted = 1.0 / wanted;
    let mut before = (alpha, stiffness(&answer));
    alpha = if before.1 > wanted { LEAST } else { LARGEST };
    for _ in 0..8 {
        answer = solve(alpha, answer.displacement)?;
        let now = stiffness(&answer);
        let slope = (now - before.1) / (alpha - before.0);
        if !(slope > 0.0 && slope.is_finite()) {
            break;
        }
        before = (alpha, now);
        alpha = (alpha + (wanted - now) / slope).clamp(LEAST, LARGEST);
        if (alpha / before.0 - 1.0).abs() < ENOUGH {
            break;
        }
    }
    Ok(alpha)
}

/// How a level answers to its load.
struct Answer {
    /// Displacement, per axis [m] (n_nodes).
    displacement: Vec<Block>,
    /// What of it deforms the body, its sign turned [m] (n_nodes).
    deforming: Vec<Block>,
    /// Root of the sum over the mass of its square, all axes together [m √kg].
    amplitude: Real,
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
    let displacement = solve(systems, l, load, guess, tolerance)?;
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
    Ok(Answer { displacement, deforming, amplitude: squares.sqrt() })
}

#[cfg(test)]
mod tests;
