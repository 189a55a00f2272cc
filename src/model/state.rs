//! Everything about a body that moves.

use super::body::Body;
use super::element_kernel::Extremes;
use crate::math::{Real, Vec3, is_finite};
use serde::{Deserialize, Serialize};

/// Motion of the nodes of the level that moves: what is hashed, saved and restored.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct State {
    /// World positions [m], (n_nodes).
    pub position: Vec<Vec3>,
    /// Velocities [m/s], (n_nodes).
    pub velocity: Vec<Vec3>,
    /// Bound on the elements' present stiffness over the one at rest, from the last sub-step: shortens the next ones.
    pub stiffening: Real,
    /// Bound on their present squared stretch, likewise.
    pub stretching: Real,
}

impl State {
    /// At rest in the rest shape.
    pub fn at_rest(body: &Body) -> Self {
        let position = body.level().mesh.nodes.clone();
        let velocity = vec![Vec3::zeros(); position.len()];
        Self { position, velocity, stiffening: Extremes::REST.stiffening(), stretching: Extremes::REST.stretching() }
    }

    /// Takes over `other` without allocating; both belong to the same body.
    pub fn copy_from(&mut self, other: &State) {
        self.position.copy_from_slice(&other.position);
        self.velocity.copy_from_slice(&other.velocity);
        self.stiffening = other.stiffening;
        self.stretching = other.stretching;
    }

    /// True when no number is infinite or not a number.
    pub fn is_finite(&self) -> bool {
        self.stiffening.is_finite()
            && self.stretching.is_finite()
            && self.position.iter().all(is_finite)
            && self.velocity.iter().all(is_finite)
    }

    /// Feeds every bit to `hash`.
    pub fn hash_into(&self, hash: &mut xxhash_rust::xxh3::Xxh3) {
        hash.update(bytemuck::cast_slice(&self.position));
        hash.update(bytemuck::cast_slice(&self.velocity));
        hash.update(&self.stiffening.to_le_bytes());
        hash.update(&self.stretching.to_le_bytes());
    }
}
