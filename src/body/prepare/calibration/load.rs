//! The loads that levels answer to.

use super::block::{Block, columns};
use super::rigid::{Arms, mean_motion, rigid_modes};
use palpate_core::hierarchy::Level;
use palpate_core::math::{Mat3, Vec3};

/// Weight along each axis [N] for 1 m/s².
pub(super) fn weight(level: &Level) -> Vec<Block> {
    level.node_mass.iter().map(|m| (Mat3::identity() * *m).into()).collect()
}

/// A load without resultant along each axis [N]: an acceleration that grows with the square of the distance from the
/// centre of mass (1 m/s² at the radius of gyration), less the rigid motion in it. It bends what is long or flat.
pub(super) fn balanced_load(level: &Level) -> Vec<Block> {
    balanced(level, |arm| Mat3::identity() * arm.norm_squared())
}

/// A twist about each axis through the centre of mass, without resultant [N]: an acceleration about the axis that grows along it.
pub(super) fn twist(level: &Level) -> Vec<Block> {
    balanced(level, |arm| {
        let about = |i: usize| Vec3::ith(i, arm[i]).cross(&arm);
        Mat3::from_columns(&[about(0), about(1), about(2)])
    })
}

/// The masses times `acceleration` at their places, in radii of gyration from the centre of mass, less the rigid motion in it.
fn balanced(level: &Level, acceleration: impl Fn(Vec3) -> Mat3) -> Vec<Block> {
    let arms = Arms::new(level);
    // nalgebra stores columns, a block rows.
    let mut load: Vec<Block> = level.mesh.nodes.iter().map(|u| acceleration(arms.to(u)).transpose().into()).collect();
    let rigid = mean_motion(level, &load);
    for ((load, u), m) in load.iter_mut().zip(&level.mesh.nodes).zip(&level.node_mass) {
        *load = ((columns(load) - rigid_modes(arms.to(u)) * rigid) * *m).transpose().into();
    }
    load
}
