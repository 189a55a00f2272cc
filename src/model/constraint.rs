//! A point of the surface that a tool pushes: what contact hands to the solver, and nothing else passes between them.

use crate::math::{Real, Vec3};
use serde::{Deserialize, Serialize};

/// Nodes that a surface point can hang on: three display vertices with four nodes each.
pub const MOST_ROW_NODES: usize = 12;

/// A surface point as an affine combination of nodes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Row {
    /// Node and weight; only the first `len` count, nodes distinct.
    entries: [(u32, Real); MOST_ROW_NODES],
    len: u32,
}

impl Row {
    /// No nodes yet.
    pub const EMPTY: Row = Row { entries: [(0, 0.0); MOST_ROW_NODES], len: 0 };

    /// Adds `weight` on `node`.
    pub fn add(&mut self, node: u32, weight: Real) {
        let len = self.len as usize;
        if let Some(entry) = self.entries[..len].iter_mut().find(|e| e.0 == node) {
            entry.1 += weight;
        } else if len < MOST_ROW_NODES {
            self.entries[len] = (node, weight);
            self.len += 1;
        } else {
            debug_assert!(false, "a row hangs on at most {MOST_ROW_NODES} nodes");
        }
    }

    /// Nodes and weights.
    pub fn entries(&self) -> &[(u32, Real)] {
        &self.entries[..self.len as usize]
    }

    /// `Σ b_i field_i`.
    pub fn interpolate(&self, field: &[Vec3]) -> Vec3 {
        self.entries().iter().map(|&(n, b)| field[n as usize] * b).sum()
    }
}

/// One unilateral constraint `n·q(t) + G λ ≥ offset + rate·t`, `λ ≥ 0`, on the surface point `q`; `t` [s] from the
/// start of the tick. The multiplier λ [N] is the force along `normal` that the tool puts on the body.
#[derive(Clone, Copy, Debug)]
pub struct Constraint {
    /// The surface point.
    pub row: Row,
    /// Unit vector from the tool towards the surface.
    pub normal: Vec3,
    /// Least `n·q` at the start of the tick [m].
    pub offset: Real,
    /// How fast that grows [m/s]: the tool's own speed, and the gradual closing of a gap found late.
    pub rate: Real,
    /// Compliance G [m/N] in series: the part of the dent that the mesh is too coarse to show.
    pub compliance: Real,
    /// Dent `G λ` [m] beyond which the point gets firmer, so that the tool stays outside the displayed surface.
    pub most_dent: Real,
    /// Index of the tool.
    pub tool: u32,
    /// What tells this point from the tool's others, from tick to tick: a display vertex, or the number of vertices
    /// plus a display triangle.
    pub point: u32,
    /// Multiplier to start from [N].
    pub multiplier: Real,
    /// Mean multiplier over the sub-steps of the tick [N]: the solver's answer.
    pub mean_multiplier: Real,
}

/// Part of the compliance that is left beyond [`Constraint::most_dent`]. None at all would leave nothing to divide by
/// where a point hangs on nodes that are held fast.
pub const FIRMER: Real = 0.1;

/// Dent [m] below the mesh's size under the multiplier `multiplier` [N]: `G λ`, firmer beyond `most`.
pub fn dent(compliance: Real, multiplier: Real, most: Real) -> Real {
    let soft = compliance * multiplier;
    if soft <= most { soft } else { most + FIRMER * (soft - most) }
}

/// What is remembered of a contact point from tick to tick.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct PointMemory {
    /// [`Constraint::point`].
    pub point: u32,
    /// Last multiplier [N].
    pub multiplier: Real,
    /// Overlap that has not been closed yet [m].
    pub slack: Real,
    /// Last normal, from the tool towards the surface.
    pub normal: Vec3,
}
