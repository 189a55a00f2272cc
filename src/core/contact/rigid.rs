//! What meets the body, and where what is found of that goes.

use super::shape::Shape;
use super::tool::ToolState;
use crate::ids::ToolId;
use crate::math::{Real, Vec3};
use crate::model::Constraint;

/// A tool that a hand holds, or an obstacle.
#[derive(Clone, Copy, Debug)]
pub struct Rigid<'a> {
    /// Which it is; the numbers of obstacles come after those of the tools.
    pub id: ToolId,
    /// Its shape.
    pub shape: &'a Shape,
    /// Coulomb's coefficient of friction.
    pub friction: Real,
    /// Where it is.
    pub state: &'a ToolState,
    /// As [`Constraint::horizon`] [s].
    pub horizon: Real,
}

impl Rigid<'_> {
    /// Whether a hand holds it: what it touches is then solved without a horizon.
    pub(super) fn is_held(&self) -> bool {
        self.horizon <= 0.0
    }
}

/// Receives what is found.
#[derive(Debug)]
pub struct Found<'a> {
    /// The constraints of all tools.
    pub constraints: &'a mut Vec<Constraint>,
    /// The surface point at which each one acts [m].
    pub points_of_action: &'a mut Vec<Vec3>,
}
