//! An element in use: what it is made of, what it remembers, and how far it may be strained.

use crate::math::Real;
use serde::{Deserialize, Serialize};

/// Most Maxwell branches of an element.
pub const MAX_BRANCHES: usize = 2;

/// What an element is made of.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ElementConstants {
    /// ∇L_1, ∇L_2, ∇L_3 at rest [1/m]; ∇L_0 is minus their sum.
    pub gradient: [[Real; 3]; 3],
    /// λ·w·vol [N·m].
    pub lambda: Real,
    /// μ·w·vol [N·m].
    pub mu: Real,
    /// Factor on the shear moduli of the Maxwell branches over μ.
    pub branch: Real,
}

/// What an element remembers between two evaluations. Components of strains are xx, yy, zz, yz, xz, xy.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct History {
    /// Green strain `E` at the last evaluation.
    pub strain: [Real; 6],
    /// `J = det F` at the last evaluation.
    pub det: Real,
    /// Memory `D` of each Maxwell branch; zero for branches that the pool does not have.
    pub branch: [[Real; 6]; MAX_BRANCHES],
}

impl History {
    /// True when no number is infinite or not a number.
    pub fn is_finite(&self) -> bool {
        self.det.is_finite() && self.strain.iter().chain(self.branch.iter().flatten()).all(|x| x.is_finite())
    }

    /// Of an element that has always been at rest.
    pub const REST: History = History { strain: [0.0; 6], det: 1.0, branch: [[0.0; 6]; MAX_BRANCHES] };
}

/// Strain up to which an element may keep its step: `|dev 2E| ≤ deviator − slope · tr 2E`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct StrainLimit {
    /// No unit.
    pub deviator: Real,
    /// No unit.
    pub slope: Real,
}

impl StrainLimit {
    /// Whatever the strain.
    pub const NONE: Self = Self { deviator: Real::INFINITY, slope: 0.0 };
}
