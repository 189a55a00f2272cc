//! The display surface in each level [DDCB01 4.1]: every display vertex is a row on the element that contains it.
//!
//! Not on the level's outer triangles: those of a lattice cover lie up to one spacing outside the body.

use super::level::Level;
use crate::geometry::locate::Locator;
use crate::math::Vec3;

/// Fills `embedding` of every level for the display vertices `vertices` [m].
pub fn embed(levels: &mut [Level], vertices: &[Vec3]) {
    for level in levels {
        let locator = Locator::new(&level.mesh, level.spacing);
        level.embedding = vertices.iter().map(|v| locator.host(*v)).collect();
    }
}
