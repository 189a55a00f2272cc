//! How far levels agree, load by load.

use super::block::Block;
use super::load::twist;
use super::system::System;
use super::{CalibrationError, answers, bear, loaded};
use palpate_core::hierarchy::Level;
use palpate_core::math::Real;
use palpate_core::model::material::Material;

/// How exactly [`agreement`] is solved for ([`solve`](super::solver::solve)): whole per cents are shown, which with a hundred times
/// more would err; with less it takes longer.
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
