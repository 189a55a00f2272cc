//! What a force on the surface of an elastic body does below the size of a mesh, in closed form.
//!
//! Under a load that is spread like a normal distribution of deviation `S` a half-space gives way by `k ψ(r; S)` at the distance
//! `r`, `k = (1−ν²)/(πE)` [Johnson 1985, 3.2; the convolution of Boussinesq's `1/r`]. A mesh shows the load of a sample as if it
//! were as wide as the rows by which it hangs on the nodes. So what the mesh leaves out of the sample's own, narrower load is the
//! difference of two such potentials, as in the splitting of long and short range by Hockney & Eastwood (1988): it is short-ranged, has no
//! singularity, and its matrix over any samples is positive semidefinite while the mesh's load is the wider one.

use crate::math::Real;
use std::f64::consts::PI;

/// `ψ(r; S) = √(π/2)/S · e^{−x} I₀(x)`, `x = r²/(4S²)` [1/m], for a squared distance [m²] and a variance `S²` [m²].
pub(super) fn potential(distance_squared: Real, variance: Real) -> Real {
    (0.5 * PI / variance).sqrt() * scaled_bessel(distance_squared / (4.0 * variance))
}

/// `e^{−x} I₀(x)` for `x ≥ 0`, within 2e-7 [Abramowitz & Stegun 1964, 9.8.1 and 9.8.2].
fn scaled_bessel(x: Real) -> Real {
    let sum = |c: &[Real], t: Real| c.iter().rev().fold(0.0, |sum, c| sum * t + c);
    if x < LARGE {
        let t = x / LARGE;
        libm::exp(-x) * sum(&NEAR, t * t)
    } else {
        sum(&FAR, LARGE / x) / x.sqrt()
    }
}

const LARGE: Real = 3.75;
const NEAR: [Real; 7] = [1.0, 3.5156229, 3.0899424, 1.2067492, 0.2659732, 0.0360768, 0.0045813];
const FAR: [Real; 9] =
    [0.39894228, 0.01328592, 0.00225319, -0.00157565, 0.00916281, -0.02057706, 0.02635537, -0.01647633, 0.00392377];

/// Variance [m²] of the normal distribution that gives way under itself as much as a uniform load on a disc of this `area` [m²] does
/// on the average: the disc's `16/(3πs)` for its radius `s` [Johnson 1985, 3.4] and `ψ(0; √2 σ) = √π/(2σ)` for two equal ones.
pub(super) fn variance_of_disc(area: Real) -> Real {
    let deviation = 3.0 * PI * PI.sqrt() / 32.0;
    deviation * deviation * area / PI
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Against the integral `e^{−x} I₀(x) = 1/π ∫ e^{x (cos θ − 1)} dθ`.
    #[test]
    fn the_potential_is_that_of_a_normal_distribution() {
        for x in [0.0, 0.1, 1.0, 3.7, 3.8, 10.0, 200.0] {
            let steps = 20_000;
            let at = |i: u32| x * ((PI * (Real::from(i) + 0.5) / Real::from(steps)).cos() - 1.0);
            let exact = (0..steps).map(|i| at(i).exp()).sum::<Real>() / Real::from(steps);
            assert!((scaled_bessel(x) / exact - 1.0).abs() < 1e-6, "{x}");
        }
        // Far away it is Boussinesq's.
        assert!((potential(1.0, 1e-4) - 1.0).abs() < 1e-3);
    }

    #[test]
    fn a_disc_gives_way_under_itself_by_its_mean() {
        let radius = 2e-3;
        let own = potential(0.0, 2.0 * variance_of_disc(PI * radius * radius));
        assert!((own * radius / (16.0 / (3.0 * PI)) - 1.0).abs() < 1e-12);
    }
}
