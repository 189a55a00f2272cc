//! Smoothed elements ([`stars`](palpate_core::model::body::stars)) whose levels answer alike: a stabilisation for each level.
//!
//! The part α of the energy of strain jumps that tetrahedra keep is [`FINEST`] on the finest level, near the continuum on any
//! mesh. What errs is the coarser levels' bending and twisting, and that only: each gets the α at which it moves under the
//! load of [`calibrate`](super::calibrate) as far as the finest. Uniform strain has its exact energy whatever α, so that no
//! load is answered worse for it.

use super::block::Block;
use super::load::twist;
use super::system::System;
use super::{Answer, CalibrationError, TOLERANCE, answer, answers, bear, loaded, slowest_mode};
use palpate_core::hierarchy::Level;
use palpate_core::math::Real;
use palpate_core::model::body::stars::LARGEST;
use palpate_core::model::material::Material;

/// α of the finest level. Measured in statics: with this, covers and structured meshes of cubes, bars and plates at ν of 0.3 to
/// 0.49 come nearest to the continuum in bending, torsion and under presses together. With less, presses come out too soft; with
/// more, bending too stiff.
pub const FINEST: Real = 0.35;
/// Least α of a level: with less, a tool that touches it feels more of the modes that means do not see than of the body.
pub const LEAST: Real = 0.2;

/// Change of α, as a part, that is the last to be made: the next would change amplitudes by less than a thousandth.
const ENOUGH: Real = 1e-2;

/// What the answers to a smooth load tell of smoothed elements.
#[derive(Clone, Debug, PartialEq)]
pub struct Stabilised {
    /// α (n_levels) at which all levels answer as the finest does, which keeps its own. [`LEAST`] or [`LARGEST`]: no α in that range
    /// makes the level agree.
    pub stabilisation: Vec<Real>,
    /// As [`Calibration::slowest_mode`](super::Calibration::slowest_mode) [rad/s].
    pub slowest_mode: Real,
}

/// Makes all levels of smoothed elements answer to a smooth load as the finest does, from the α that they have. Arguments as of
/// [`calibrate`](super::calibrate).
///
/// # Errors
/// When a level has no elastic solution.
pub fn stabilise(
    levels: &[Level],
    material: impl Fn(usize, usize) -> Material + Sync,
    holds: &[(u32, Real)],
) -> Result<Stabilised, CalibrationError> {
    let mut stabilisation: Vec<Real> = levels.iter().map(|level| level.stabilisation).collect();
    let mut systems = loaded(levels, &material, holds);
    let mut answers = answers(&systems, TOLERANCE)?;
    let Some(finest) = answers.pop() else { return Ok(Stabilised { stabilisation, slowest_mode: 0.0 }) };
    let slowest_mode = systems.last().map_or(0.0, |system| slowest_mode(system, &finest.deforming));
    for (l, now) in answers.into_iter().enumerate() {
        stabilisation[l] = matching(now, stabilisation[l], finest.amplitude, |alpha, guess| {
            systems[l].set_material(levels, l, &material, alpha);
            answer(&systems, l, &systems[l].load, guess, TOLERANCE)
        })?;
    }
    Ok(Stabilised { stabilisation, slowest_mode })
}

/// How exactly [`agreement`] is solved for ([`solve`](super::solver::solve)): whole per cents are shown.
const ROUGH: Real = 1e-4;

/// The loads of [`agreement`].
pub const LOADS: [&str; 6] =
    ["weight along x", "weight along y", "weight along z", "twist about x", "twist about y", "twist about z"];

/// How much more each level gives way than the finest, as a part (n_levels), under each of [`LOADS`]: compliance over the
/// finest's, less one. Instead of its weight a body that nothing holds bears the load of
/// [`calibrate`](super::calibrate). Arguments as there.
///
/// # Errors
/// When a level has no elastic solution.
pub fn agreement(
    levels: &[Level],
    material: impl Fn(usize, usize) -> Material + Sync,
    holds: &[(u32, Real)],
) -> Result<Vec<[Real; LOADS.len()]>, CalibrationError> {
    let mut systems = loaded(levels, &material, holds);
    let weighed = compliances(&systems)?;
    bear(&mut systems, twist);
    let twisted = compliances(&systems)?;
    let all: Vec<[Real; LOADS.len()]> = weighed
        .iter()
        .zip(&twisted)
        .map(|(weighed, twisted)| std::array::from_fn(|i| if i < 3 { weighed[i] } else { twisted[i - 3] }))
        .collect();
    let of_finest = all.last().copied().unwrap_or_default();
    // A body of which every node is fixed gives way nowhere.
    let more = |a: Real, finest: Real| if finest > 0.0 { a / finest - 1.0 } else { 0.0 };
    Ok(all.iter().map(|level| std::array::from_fn(|i| more(level[i], of_finest[i]))).collect())
}

/// Work [J] of the load along each axis on what it deforms, on each level.
fn compliances(systems: &[System]) -> Result<Vec<[Real; 3]>, CalibrationError> {
    let work = |system: &System, u: &[Block], axis: usize| -> Real {
        // What deforms the body is kept with its sign turned.
        system.load.iter().zip(u).map(|(f, u)| -(0..3).map(|i| f[i][axis] * u[i][axis]).sum::<Real>()).sum()
    };
    let answers = answers(systems, ROUGH)?;
    Ok(systems.iter().zip(&answers).map(|(s, a)| [0, 1, 2].map(|axis| work(s, &a.deforming, axis))).collect())
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
