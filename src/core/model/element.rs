//! An element in use: what it is made of, what it remembers, and how far it may be strained.

use super::material::{COLLAPSE_ONSET, COLLAPSE_STIFFNESS};
use crate::math::{Mat3, Real, Vec3, symmetric};
use serde::{Deserialize, Serialize};

/// Most Maxwell branches of an element.
pub const MAX_BRANCHES: usize = 2;

/// What an element is made of: a tetrahedron, or a star, whose nodes are a node and its neighbours.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ElementConstants<G = [[Real; 3]; 3]> {
    /// Gradients at rest [1/m] of the weights of its nodes but for the first, whose gradient is minus their sum: ∇L_1, ∇L_2,
    /// ∇L_3 of a tetrahedron, `b` of a star's neighbours.
    pub gradient: G,
    /// λ·w·vol [N·m].
    pub lambda: Real,
    /// μ·w·vol [N·m].
    pub mu: Real,
    /// As [`Material::neo_hookean`](super::Material::neo_hookean).
    pub neo_hookean: Real,
    /// As [`Material::collapse`](super::Material::collapse).
    pub collapse: Real,
    /// As [`Fibres::rows`](super::Fibres::rows).
    pub fibres: [Real; 6],
}

/// The law of the kernel for one element, on matrices: what the kernel is tested against, and what weighs an element that is
/// not due.
impl<G: AsRef<[[Real; 3]]>> ElementConstants<G> {
    /// Deformation gradient `F = Σ (x_i − x_0) ⊗ ∇L_i` with its first node at `origin` and the others at `ends` [m].
    pub fn deformation(&self, origin: Vec3, ends: impl Iterator<Item = Vec3>) -> Mat3 {
        ends.zip(self.gradient.as_ref()).map(|(x, g)| (x - origin) * Vec3::from(*g).transpose()).sum()
    }

    /// Second Piola–Kirchhoff stress at `f` times its part of the volume [N·m]: that of St. Venant and Kirchhoff's law, of fibres, and of Maxwell
    /// branches of these `moduli` over μ with what they remember. Viscosity, the neo-Hookean law and the term against collapse are not in it.
    pub fn stress(&self, f: &Mat3, moduli: impl Iterator<Item = Real>, history: &History) -> Mat3 {
        let (lambda, mu) = (self.lambda, self.mu);
        let doubled = f.transpose() * f - Mat3::identity();
        let green = 1.0 - self.neo_hookean;
        let mut s = (doubled * mu + Mat3::identity() * (0.5 * lambda * doubled.trace())) * green;
        let along = symmetric(self.fibres);
        s += along * (0.5 * along.dot(&doubled));
        for (modulus, held) in moduli.zip(&history.branch) {
            let d = symmetric(*held) * 2.0;
            s += (d - Mat3::identity() * (d.trace() / 3.0)) * (mu * modulus);
        }
        s
    }

    /// Forces on its nodes but for the first [N], on which minus their sum acts, at the deformation gradient `f` and the stress
    /// `s`, with the neo-Hookean law and the term against collapse.
    pub fn forces(&self, f: &Mat3, s: &Mat3) -> impl Iterator<Item = Vec3> {
        let mut p = f * s;
        let det = f.determinant();
        if det < COLLAPSE_ONSET || self.neo_hookean > 0.0 {
            let rows: [Vec3; 3] = std::array::from_fn(|r| f.row(r).transpose());
            let cofactor = [rows[1].cross(&rows[2]), rows[2].cross(&rows[0]), rows[0].cross(&rows[1])];
            let squeeze =
                COLLAPSE_STIFFNESS * (self.lambda + 2.0 * self.mu) * self.collapse * (det - COLLAPSE_ONSET).min(0.0);
            let swelling = self.neo_hookean * ((self.lambda + self.mu) * (det - 1.0) - self.mu);
            p += Mat3::from_rows(&cofactor.map(|c| c.transpose())) * (squeeze + swelling);
            p += f * (self.neo_hookean * self.mu);
        }
        self.gradient.as_ref().iter().map(move |g| -(p * Vec3::from(*g)))
    }
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
