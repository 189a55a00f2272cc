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
    let arms = Arms::new(level);
    let growing = |u: &Vec3| (Mat3::identity() * arms.to(u).norm_squared()).into();
    let mut load: Vec<Block> = level.mesh.nodes.iter().map(growing).collect();
    let rigid = mean_motion(level, &load);
    for ((load, u), m) in load.iter_mut().zip(&level.mesh.nodes).zip(&level.node_mass) {
        // nalgebra stores columns, a block rows.
        *load = ((columns(load) - rigid_modes(arms.to(u)) * rigid) * *m).transpose().into();
    }
    load
}
