//! What a hand that is far away needs beside the force: how the force will change where the tool goes next.

use crate::math::{Real, Vec3};

/// The force near the pose that a wrench answers, `F(x) = force − K (x − x₀)`, as long as it does not pull.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct LocalModel {
    /// Force on the handle at x₀ [N]; short of contact it points into the body.
    pub force: Vec3,
    /// Out of the body, unit; zero where nothing is near.
    pub normal: Vec3,
    /// K [N/m], symmetric: xx, yy, zz, yz, zx, xy.
    pub stiffness: [Real; 6],
    /// How far from x₀ the model holds [m]; 0: it says nothing.
    pub range: Real,
}
