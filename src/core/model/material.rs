//! The material laws: St. Venant–Kirchhoff or neo-Hookean, with [fibres](Fibres) or without, with Kelvin–Voigt viscosity and a term
//! against collapse.
//!
//! Green strain `E = ½(FᵀF − I)`, second Piola–Kirchhoff stress `S = λ tr(E) I + 2μ E + φ tr(Ė) I + 2ψ Ė`
//! [DDCB01 eq. 1–4, in standard scaling: the paper's ε is 2E and its σ is 2S], nodal forces `f_i = −vol F S ∇L_i`
//! [DDCB01 eq. 8].
//!
//! St. Venant–Kirchhoff softens when squeezed and then inverts for good, so the energy density gets
//! `½ k (J − 0.6)²` where `J = det F < 0.6`, `k = 8(λ + 2μ)`: the force then rises monotonically and the body
//! recovers.
//!
//! The neo-Hookean law has the energy density `½ μ (|F|² − 3) − μ (J − 1) + ½ (λ + μ) (J − 1)²` instead of that of `λ tr(E) I + 2μ E`: its
//! stress `P = μ F + ((λ + μ)(J − 1) − μ) cof F` is that of the same λ and μ in small strain, goes through inversion without a pole
//! and keeps its shear modulus when squeezed [Smith, de Goes & Kim 2018, before their barrier]. It is linear in λ and μ, too.

use super::fibres::Fibres;
use crate::math::{Mat3, Real, Vec3};
use serde::{Deserialize, Serialize};
use std::f64::consts::PI;

/// `J` below which the compression term acts.
pub const COLLAPSE_ONSET: Real = 0.6;
/// Stiffness of the compression term over `λ + 2μ`.
pub const COLLAPSE_STIFFNESS: Real = 8.0;
/// Parts of an element's volume are counted in these, one over 64 each.
pub const PARTS: u32 = 64;

/// Constants of one visco-elastic material.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Material {
    /// Lamé's first parameter λ [Pa]: resists volume change.
    pub lambda: Real,
    /// Shear modulus μ [Pa].
    pub mu: Real,
    /// Viscosity φ against volume change [Pa·s].
    pub phi: Real,
    /// Shear viscosity ψ [Pa·s].
    pub psi: Real,
    /// Density ρ at rest [kg/m³].
    pub density: Real,
    /// Part of the elastic energy that is neo-Hookean, and not St. Venant–Kirchhoff's: none or all, or what of a mixture is.
    pub neo_hookean: Real,
    /// Stiffness of the compression term over that of such a material alone: 1, or what of it a part of a material has.
    pub collapse: Real,
    /// What makes it stiffer along one direction; of the same relaxation time as shear.
    pub fibres: Fibres,
}

impl Material {
    /// What an element is of that has so many [`PARTS`] of each of the `others` in `self`: as dense as all of them together, and
    /// as stiff as a material with balls of the others in it. For given volumes that is Hashin and Shtrikman's bound (1963), in
    /// which `self` surrounds the rest; the plain mean would be right only for what lies side by side along every load, and
    /// count a tenth part of what is ten times as stiff for twice the stiffness. Viscosity goes with the stiffness.
    pub fn mixed(&self, others: impl Iterator<Item = (u32, Material)> + Clone) -> Material {
        let bulk = |m: &Material| m.lambda + 2.0 / 3.0 * m.mu;
        let inside: u32 = others.clone().map(|(n, _)| n).sum();
        let all = Real::from(inside.max(PARTS));
        let rest = Real::from(PARTS.saturating_sub(inside)) / all;
        let mean = |of: &dyn Fn(&Material) -> Real, around: Real| {
            let softness = others.clone().map(|(n, m)| Real::from(n) / all / (of(&m) + around));
            1.0 / (rest / (of(self) + around) + softness.sum::<Real>()) - around
        };
        let (k, g) = (bulk(self), self.mu);
        let mu = mean(&|m| m.mu, g * (9.0 * k + 8.0 * g) / (6.0 * (k + 2.0 * g)));
        // Rounding alone could make it negative where nothing resists a change of volume alone.
        let lambda = (mean(&bulk, 4.0 / 3.0 * g) - 2.0 / 3.0 * mu).max(0.0);
        let over = |viscosity: Real, modulus: Real| if modulus > 0.0 { viscosity / modulus } else { 0.0 };
        let neo_hookean = others.clone().map(|(n, m)| m.neo_hookean * Real::from(n) / all).sum::<Real>();
        let fibres = others.clone().map(|(n, m)| (m.fibres, Real::from(n) / all));
        Material {
            lambda,
            mu,
            phi: lambda * over(self.phi, self.lambda),
            psi: mu * over(self.psi, self.mu),
            density: rest * self.density + others.map(|(n, m)| m.density * Real::from(n) / all).sum::<Real>(),
            neo_hookean: rest * self.neo_hookean + neo_hookean,
            collapse: 1.0,
            fibres: Fibres::mean(std::iter::once((self.fibres, rest)).chain(fibres)),
        }
    }

    /// Of the same Poisson's ratio and relaxation times, `factor` times as stiff.
    pub fn stiffened(&self, factor: Real) -> Material {
        let Self { lambda, mu, phi, psi, fibres, .. } = *self;
        let fibres = fibres.stiffened(factor);
        Self { lambda: factor * lambda, mu: factor * mu, phi: factor * phi, psi: factor * psi, fibres, ..*self }
    }

    /// Of the neo-Hookean law with the same constants.
    pub fn as_neo_hookean(self) -> Self {
        Self { neo_hookean: 1.0, ..self }
    }

    /// Of St. Venant and Kirchhoff's law, from Young's modulus [Pa] and Poisson's ratio; viscosities zero.
    pub fn from_young(youngs_modulus: Real, poisson_ratio: Real, density: Real) -> Self {
        let (e, nu) = (youngs_modulus, poisson_ratio);
        Self {
            lambda: e * nu / ((1.0 + nu) * (1.0 - 2.0 * nu)),
            mu: e / (2.0 * (1.0 + nu)),
            phi: 0.0,
            psi: 0.0,
            density,
            neo_hookean: 0.0,
            collapse: 1.0,
            fibres: Fibres::NONE,
        }
    }

    /// Young's modulus [Pa], of fibres without what is around them.
    pub fn youngs_modulus(&self) -> Real {
        self.mu * (3.0 * self.lambda + 2.0 * self.mu) / (self.lambda + self.mu)
    }

    /// Poisson's ratio, without fibres.
    pub fn poisson_ratio(&self) -> Real {
        self.lambda / (2.0 * (self.lambda + self.mu))
    }

    /// `s` of the factor `1/(1 + s)` on Hertz's force where a ball touches a disc of `reach` times its radius, as large strain
    /// softens St. Venant–Kirchhoff's law: that of axisymmetric elements of third order within 1 % of
    /// the force up to a reach of 0.3. It is not known to grow beyond 0.5. The neo-Hookean law, which keeps its shear modulus when squeezed,
    /// is not known to soften.
    pub fn softening(&self, reach: Real) -> Real {
        let nu = self.poisson_ratio();
        (1.0 - self.neo_hookean) * (0.17 + nu * (0.5 + nu * nu * 1.9)) * reach.min(0.5)
    }

    /// `1/(πM)` [m²/N], `M = E/(1−ν²)`: under a point load along `normal` (of length 1, at rest) an elastic half-space gives way by this much
    /// per newton and per distance. With fibres `M` is the indentation modulus of a transversely isotropic half-space: in closed form along
    /// and across the fibres [Delafargue & Ulm 2004]. Between them, where there is none, the geometric mean of the arithmetic and the harmonic
    /// mean of both, weighed by the square of the cosine of the angle.
    pub fn half_space(&self, normal: &Vec3) -> Real {
        let nu = self.poisson_ratio();
        let isotropic = (1.0 - nu * nu) / (PI * self.youngs_modulus());
        if !self.fibres.are_there() {
            return isotropic;
        }
        // Stiffnesses c₁₁, c₁₂ = c₁₃ and c₄₄ = c₆₆ of the matrix; c₃₃ with the fibres along axis 3.
        let (c11, c13, c44) = (self.pressure_modulus(), self.lambda, self.mu);
        let c33 = c11 + self.fibres.modulus;
        let mean = (c11 * c33).sqrt();
        let along = 2.0 * ((c11 * c33 - c13 * c13) / c11 / (1.0 / c44 + 2.0 / (mean + c13))).sqrt();
        let across = ((c11 / c33).sqrt() * along * (c11 * c11 - c13 * c13) / c11).sqrt();
        let part = self.fibres.direction.dot(normal).powi(2).min(1.0);
        let arithmetic = across + (along - across) * part;
        let harmonic = 1.0 / (1.0 / across + (1.0 / along - 1.0 / across) * part);
        1.0 / (PI * (arithmetic * harmonic).sqrt())
    }

    /// `λ + 2μ` [Pa], the modulus of pressure waves across fibres.
    pub fn pressure_modulus(&self) -> Real {
        self.lambda + 2.0 * self.mu
    }

    /// `k` [Pa] of the compression term.
    pub fn collapse_stiffness(&self) -> Real {
        COLLAPSE_STIFFNESS * self.collapse * self.pressure_modulus()
    }

    /// `λ + 2μ + K` [Pa]: that of the fastest waves, pressure waves along fibres.
    pub fn largest_modulus(&self) -> Real {
        self.pressure_modulus() + self.fibres.modulus
    }

    /// Speed of the fastest waves at rest [m/s]: the fastest that anything travels.
    pub fn wave_speed(&self) -> Real {
        (self.largest_modulus() / self.density).sqrt()
    }

    /// The longer of the relaxation times of pressure and shear [s]: bounds the damping of every mode.
    pub fn damping_time(&self) -> Real {
        ((self.phi + 2.0 * self.psi) / self.pressure_modulus()).max(self.psi / self.mu)
    }

    /// Elastic energy density [J/m³] at the deformation gradient `f`.
    pub fn energy_density(&self, f: &Mat3) -> Real {
        let e = (f.transpose() * f - Mat3::identity()) * 0.5;
        let trace = e.trace();
        let det = f.determinant();
        let squeeze = (det - COLLAPSE_ONSET).min(0.0);
        let k = self.collapse_stiffness();
        let green = 0.5 * self.lambda * trace * trace + self.mu * e.dot(&e);
        // |F|² − 3 = tr 2E.
        let neo_hookean = self.mu * (trace - (det - 1.0)) + 0.5 * (self.lambda + self.mu) * (det - 1.0).powi(2);
        let matrix = (1.0 - self.neo_hookean) * green + self.neo_hookean * neo_hookean + 0.5 * k * squeeze * squeeze;
        matrix + self.fibres.energy_density(&e)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn young_and_poisson_survive_the_way_through_lame() {
        let m = Material::from_young(5000.0, 0.45, 1050.0);
        assert!((m.youngs_modulus() / 5000.0 - 1.0).abs() < 1e-14);
        assert!((m.poisson_ratio() / 0.45 - 1.0).abs() < 1e-14);
    }

    #[test]
    fn crushing_costs_ever_more_energy() {
        let m = Material::from_young(1e4, 0.45, 1000.0);
        for m in [m, m.as_neo_hookean()] {
            let density = |s: Real| m.energy_density(&Mat3::from_diagonal_element(s));
            let mut last = 0.0;
            for i in 1..20 {
                let now = density(1.0 - 0.05 * i as Real);
                assert!(now > last);
                last = now;
            }
        }
    }

    #[test]
    fn all_laws_are_hooke_s_in_small_strain_and_linear_in_their_constants() {
        let strain = Mat3::new(1.0, 0.3, -0.2, 0.3, -0.6, 0.5, -0.2, 0.5, 0.4) * 1e-5;
        for nu in [0.0, 0.3, 0.49] {
            let m = Material::from_young(1e4, nu, 1000.0);
            let hooke = 0.5 * m.lambda * strain.trace().powi(2) + m.mu * strain.dot(&strain);
            let fibres = Fibres { modulus: 7e4, direction: Vec3::new(0.6, 0.0, 0.8) };
            for (m, fibres) in [(m, Fibres::NONE), (m.as_neo_hookean(), Fibres::NONE), (m.as_neo_hookean(), fibres)] {
                let m = Material { fibres, ..m };
                let hooke = hooke + 0.5 * fibres.modulus * (strain * fibres.direction).dot(&fibres.direction).powi(2);
                let energy = m.energy_density(&(Mat3::identity() + strain));
                assert!((energy / hooke - 1.0).abs() < 1e-4, "{nu}: {energy} of {hooke}");
                let large = Mat3::identity() + strain * 1e4;
                let ratio = m.stiffened(3.0).energy_density(&large) / m.energy_density(&large);
                assert!((ratio - 3.0).abs() < 1e-12, "{ratio}");
            }
        }
    }
}
