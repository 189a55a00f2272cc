//! Forces that the body puts on its own nodes: elements, and the springs that hold it.

use crate::math::Vec3;
use crate::model::element_kernel::{Extremes, PaddedForce, Path, add_forces};
use crate::model::{Body, State};

/// Writes the internal forces [N] of `state` into `force` (n_nodes).
pub fn internal_force(path: Path, body: &Body, state: &State, force: &mut [PaddedForce]) -> Extremes {
    force.fill([0.0; 4]);
    let extremes = add_forces(path, body.elements(), &state.position, &state.velocity, force);
    for (hold, row) in body.holds() {
        let q: Vec3 = row.iter().map(|(n, w)| state.position[*n as usize] * *w).sum();
        let pull = (body.surface().vertices[hold.vertex as usize] - q) * hold.stiffness;
        for (n, w) in row {
            for (c, f) in force[*n as usize][..3].iter_mut().enumerate() {
                *f += pull[c] * w;
            }
        }
    }
    extremes
}
