//! Fibres of a material: what makes it stiffer along one direction.
//!
//! They add `½ K (a·E a)²` to the energy density of the matrix they lie in, `a` their direction at rest and `a·E a = ½(λ² − 1)` their Green
//! strain at the stretch `λ`: the standard reinforcing model, `¼·½ K (I₄ − 1)²` [Weiss, Maker & Govindjee 1996; Merodio & Ogden 2005].
//! In small strain that is a transversely isotropic solid, of Young's modulus `E + K` along the fibres. It resists being pressed
//! along them, too, down to `λ = 1/√3`, where their force is largest.

use crate::math::{Mat3, Real, Vec3, components};
use serde::{Deserialize, Serialize};

/// Fibres that lie in one direction.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Fibres {
    /// `K` [Pa]; 0: there are none.
    pub modulus: Real,
    /// Their direction `a` at rest, of length 1; zero: that of each element, as the file has it that the body was made from.
    pub direction: Vec3,
}

impl Fibres {
    /// None.
    pub const NONE: Self = Self { modulus: 0.0, direction: Vec3::new(0.0, 0.0, 0.0) };

    /// Whether there are some.
    pub fn are_there(&self) -> bool {
        self.modulus > 0.0
    }

    /// `factor` times as stiff.
    pub fn stiffened(&self, factor: Real) -> Self {
        Self { modulus: factor * self.modulus, ..*self }
    }

    /// In the direction `along` where they have none of their own; none where that is zero.
    pub fn led(&self, along: Vec3) -> Self {
        match (self.direction == Vec3::zeros(), along == Vec3::zeros()) {
            (true, true) => Self::NONE,
            (true, false) => Self { direction: along, ..*self },
            _ => *self,
        }
    }

    /// Of parts that have these fibres and weights: as much of them as all have, in their mean direction. A direction is as good as its
    /// opposite. Where those of some are the file's and those of others not, the latter count.
    pub fn mean(parts: impl Iterator<Item = (Fibres, Real)>) -> Self {
        let (mut weights, mut modulus, mut sum) = (0.0, 0.0, Vec3::zeros());
        for (fibres, weight) in parts {
            weights += weight;
            modulus += weight * fibres.modulus;
            let own = fibres.direction * (weight * fibres.modulus);
            sum += if sum.dot(&own) < 0.0 { -own } else { own };
        }
        let modulus = if modulus > 0.0 { modulus / weights } else { 0.0 };
        Self { modulus, direction: sum.try_normalize(0.0).unwrap_or_default() }
    }

    /// `√(K V) a ⊗ a` [√(N·m)] of the volume `V` [m³], its components xx, yy, zz, yz, xz, xy: `M` of the stress `(M : E) M`.
    pub fn rows(&self, volume: Real) -> [Real; 6] {
        if !self.are_there() {
            return [0.0; 6];
        }
        components(&(self.direction * self.direction.transpose())).map(|x| x * (self.modulus * volume).sqrt())
    }

    /// `½ K (a·E a)²` [J/m³] at the Green strain `e`.
    pub fn energy_density(&self, e: &Mat3) -> Real {
        0.5 * self.modulus * self.direction.dot(&(e * self.direction)).powi(2)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_mean_has_all_of_the_fibres_and_no_direction_takes_another_away() {
        let along = |modulus: Real, direction: Vec3| Fibres { modulus, direction };
        let mean = Fibres::mean([(along(3.0, Vec3::x()), 1.0), (along(5.0, -Vec3::x()), 3.0)].into_iter());
        assert!((mean.modulus - 4.5).abs() < 1e-12 && (mean.direction.x.abs() - 1.0).abs() < 1e-12);
        let half = Fibres::mean([(Fibres::NONE, 1.0), (along(8.0, Vec3::y()), 1.0)].into_iter());
        assert_eq!(half, along(4.0, Vec3::y()));
        assert_eq!(Fibres::mean([(Fibres::NONE, 1.0)].into_iter()), Fibres::NONE);
        let led = along(8.0, Vec3::zeros()).led(Vec3::z());
        assert_eq!((led, half.led(Vec3::z())), (along(8.0, Vec3::z()), half));
        assert_eq!(along(8.0, Vec3::zeros()).led(Vec3::zeros()), Fibres::NONE);
    }
}
