//! How the force on a device changes with where it goes.

use crate::math::{Mat3, Real, Vec3};

/// How the force on a device changes where it goes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Stiffness {
    /// K [N/m], symmetric, no negative eigenvalue: the force changes by `−K dx`.
    pub matrix: Mat3,
    /// Out of the body, unit.
    pub normal: Vec3,
    /// How far it holds [m]: a model that is linear knows nothing of where contact ends.
    pub range: Real,
    /// The force under which it is so [N].
    pub load: Real,
    /// Where there was no contact yet: `normal · x` of the device at which it begins [m].
    pub begins: Option<Real>,
    /// Iterations that it took, of all axes together.
    pub iterations: usize,
}
