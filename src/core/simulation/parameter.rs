//! What may change while a simulation runs. A change enters a tick as an input, so that a replay makes it, too.

use crate::math::{Real, Vec3};
use serde::{Deserialize, Serialize};
use std::ops::RangeInclusive;

/// A quantity that may change, with its new value.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub enum Parameter {
    /// Gravity [m/s²].
    Gravity(Vec3),
    /// How many times as stiff as prepared a tissue is: factor on λ, μ and the viscosities.
    Stiffness {
        /// Its number, below [`Body::tissue_count`](crate::model::Body::tissue_count).
        tissue: u16,
        /// No unit.
        factor: Real,
    },
    /// Friction of a tool on the body.
    Friction {
        /// The tool's id.
        tool: u16,
        /// Coulomb's coefficient μ.
        coefficient: Real,
    },
    /// Factor on the viscosities and the Maxwell branches of every tissue.
    Damping(Real),
    /// Factor on the stiffness of all supports.
    Supports(Real),
    /// When nodes are split and merged.
    Resolution {
        /// Which number of [`Adaptivity`](crate::adaptation::Adaptivity).
        threshold: Threshold,
        /// Its unit.
        value: Real,
    },
    /// A tool takes the shape that the settings give to another.
    Shape {
        /// The tool's id.
        tool: u16,
        /// The other's.
        of: u16,
    },
}

/// A number of [`Adaptivity`](crate::adaptation::Adaptivity).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Threshold {
    /// Strain jump above which a node is split.
    Split,
    /// Part of it below which nodes are merged again.
    Merge,
    /// Spacings from a tool within which nodes are split.
    Reach,
}

impl Threshold {
    /// All of them.
    pub const ALL: [Threshold; 3] = [Threshold::Split, Threshold::Merge, Threshold::Reach];

    /// As scenes call it.
    pub fn name(self) -> &'static str {
        match self {
            Threshold::Split => "split",
            Threshold::Merge => "merge",
            Threshold::Reach => "reach",
        }
    }

    /// What it may be.
    pub fn range(self) -> RangeInclusive<Real> {
        match self {
            Threshold::Split => 1e-4..=10.0,
            Threshold::Merge => 0.0..=0.9,
            Threshold::Reach => 0.0..=10.0,
        }
    }
}

impl Parameter {
    /// Whether `other` is a value of the same quantity.
    pub fn is_same_quantity(&self, other: &Parameter) -> bool {
        use Parameter::{Damping, Friction, Gravity, Resolution, Shape, Stiffness, Supports};
        match (self, other) {
            (Stiffness { tissue: a, .. }, Stiffness { tissue: b, .. })
            | (Friction { tool: a, .. }, Friction { tool: b, .. })
            | (Shape { tool: a, .. }, Shape { tool: b, .. }) => a == b,
            (Resolution { threshold: a, .. }, Resolution { threshold: b, .. }) => a == b,
            (Gravity(_), Gravity(_)) | (Damping(_), Damping(_)) | (Supports(_), Supports(_)) => true,
            _ => false,
        }
    }

    /// A [`Parameter::Shape`] of `tool` with the value `of`; `None` where that is not a whole number.
    pub fn shape(tool: u16, of: Real) -> Option<Self> {
        let whole = of as u16;
        (Real::from(whole) == of).then_some(Parameter::Shape { tool, of: whole })
    }

    /// Its numbers.
    pub fn values(&self) -> Vec<Real> {
        match self {
            Parameter::Gravity(g) => g.iter().copied().collect(),
            Parameter::Shape { of, .. } => vec![Real::from(*of)],
            Parameter::Stiffness { factor: value, .. }
            | Parameter::Friction { coefficient: value, .. }
            | Parameter::Resolution { value, .. }
            | Parameter::Supports(value)
            | Parameter::Damping(value) => vec![*value],
        }
    }
}

/// Gravity along each axis [m/s²].
pub const GRAVITY: RangeInclusive<Real> = -100.0..=100.0;
/// Coefficients of friction.
pub const FRICTION: RangeInclusive<Real> = 0.0..=2.0;
/// Part of the body's damping: more would shorten the steps that the body was prepared for, and with less the error of a step
/// adds energy.
pub const DAMPING: RangeInclusive<Real> = 0.1..=1.0;
/// Part of the supports' stiffness: with more, elements around them would need shorter steps, with less a body falls.
pub const SUPPORTS: RangeInclusive<Real> = 0.01..=1.0;
/// Factors on the stiffness of a tissue, as far as its elements can be stepped: a softer one is crushed by the forces that hands
/// apply to the body as prepared, a stiffer one is better prepared so.
pub const STIFFNESS: RangeInclusive<Real> = 0.05..=20.0;
