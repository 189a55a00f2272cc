//! The paper's test of laws [DDCB01 3.1]: a cube held by one side that is let go, on one mesh, under any of the laws.
//!
//! The paper's meshes have 27, 57 and 135 (in the text 137) nodes; its cube's size and constants are not printed. Here:
//! 1 m, λ = 146 kPa, μ = 75 kPa, 1000 kg/m³.

use super::laws::{Law, Solid};
use super::levels::Levels;
use palpate_core::math::{Real, Vec3};
use palpate_core::model::{Fibres, Material};

/// Field of all studies that have one [m/s²].
pub const GRAVITY: Vec3 = Vec3::new(0.0, 0.0, -9.81);

/// What all studies are made of.
pub fn material() -> Material {
    damped(0.0)
}

/// The same with viscosities `φ = τ λ`, `ψ = τ μ`, `tau` in [s].
pub fn damped(tau: Real) -> Material {
    let (lambda, mu) = (1.46e5, 0.75e5);
    Material {
        lambda,
        mu,
        phi: tau * lambda,
        psi: tau * mu,
        density: 1000.0,
        neo_hookean: 0.0,
        collapse: 1.0,
        fibres: Fibres::NONE,
    }
}

/// A solid held at x = 0, with what is needed to let it swing.
#[derive(Clone, Debug)]
pub struct Swing {
    /// What swings.
    pub solid: Solid,
    /// Its law.
    pub law: Law,
    /// Field [m/s²].
    pub gravity: Vec3,
    /// Positions [m] (n_nodes).
    pub x: Vec<Vec3>,
    /// Velocities [m/s] (n_nodes).
    pub v: Vec<Vec3>,
}

impl Swing {
    /// Level `r` of `levels` at rest by itself.
    pub fn new(levels: &Levels, r: usize, law: Law) -> Self {
        let solid = Solid::new(&levels.tied[r].mesh, levels.material);
        let (x, v) = (solid.rest.clone(), vec![Vec3::zeros(); solid.rest.len()]);
        Self { solid, law, gravity: Vec3::zeros(), x, v }
    }

    /// Advances by `time` [s].
    ///
    /// Kick, then drift, all nodes together: symplectic, so that an undamped run neither gains nor loses.
    pub fn advance(&mut self, time: Real) {
        // A quarter of the altitude: springs and stretched elements are stiffer than the material at rest. Viscosity
        // shortens the limit 2/ω to (2/ω)(√(1 + ξ²) − ξ), ξ = τω/2.
        let material = &self.solid.material;
        let elastic = self.solid.altitude / material.wave_speed();
        let xi = material.damping_time() / elastic;
        let steps = (time / (0.25 * elastic * ((1.0 + xi * xi).sqrt() - xi))).ceil();
        let dt = time / steps;
        for _ in 0..steps as usize {
            let mut force = self.solid.force(self.law, &self.x);
            if self.solid.material.psi > 0.0 {
                let viscous = self.solid.viscous_force(&self.x, &self.v);
                force.iter_mut().zip(viscous).for_each(|(f, d)| *f += d);
            }
            for (n, force) in force.iter().enumerate() {
                if self.solid.rest[n].x > 1e-9 {
                    self.v[n] += (force / self.solid.mass[n] + self.gravity) * dt;
                    self.x[n] += self.v[n] * dt;
                }
            }
        }
    }

    /// Whether an element is inside out.
    pub fn is_inverted(&self) -> bool {
        self.solid.elements.iter().any(|e| e.gradient_of(&self.x).determinant() < 0.0)
    }
}

/// The strongest line of a signal `(t [s], value)` between two frequencies [Hz]: its frequency, and the part of the
/// signal's mean square that it is.
pub fn strongest_line(points: &[(Real, Real)], between: [Real; 2]) -> (Real, Real) {
    let (windowed, square) = windowed(points);
    let strength = |frequency: Real| {
        let (real, imaginary) = at_frequency(&windowed, frequency);
        real * real + imaginary * imaginary
    };
    let steps = ((between[1] - between[0]) / 0.005).round() as u32;
    let frequencies = (0..=steps).map(|i| between[0] + 0.005 * Real::from(i));
    let best = frequencies.map(|f| (strength(f), f)).fold((0.0, Real::NAN), |a, b| if b.0 > a.0 { b } else { a });
    // A pure line of amplitude A has |Σ w s exp(iωt)|² = (A Σ w / 2)² and Σ w s² = A² Σ w / 2.
    let weight: Real = windowed.iter().map(|(_, _, w)| w).sum();
    (best.1, (2.0 * best.0 / (weight * square)).min(1.0))
}

/// Time, value about the mean times the window, and the window; and the windowed sum of squares. The window fades at
/// both ends and keeps other frequencies from leaking in.
fn windowed(points: &[(Real, Real)]) -> (Vec<(Real, Real, Real)>, Real) {
    let mean = points.iter().map(|p| p.1).sum::<Real>() / points.len() as Real;
    let (first, duration) = (points[0].0, points[points.len() - 1].0 - points[0].0);
    let mut square = 0.0;
    let of = |(t, y): &(Real, Real)| {
        let window = (std::f64::consts::PI * (t - first) / duration).sin().powi(2);
        square += window * (y - mean) * (y - mean);
        (*t, window * (y - mean), window)
    };
    let windowed = points.iter().map(of).collect();
    (windowed, square)
}

fn at_frequency(windowed: &[(Real, Real, Real)], frequency: Real) -> (Real, Real) {
    let (mut real, mut imaginary) = (0.0, 0.0);
    for (t, y, _) in windowed {
        let phase = std::f64::consts::TAU * frequency * t;
        real += y * phase.cos();
        imaginary += y * phase.sin();
    }
    (real, imaginary)
}

/// Damping ratio of the line at `frequency` [Hz]: how much weaker it is in the signal's second half than in its first.
pub fn damping_ratio(points: &[(Real, Real)], frequency: Real) -> Real {
    let half = points.len() / 2;
    let strength = |part: &[(Real, Real)]| {
        let (real, imaginary) = at_frequency(&windowed(part).0, frequency);
        (real * real + imaginary * imaginary).sqrt()
    };
    let apart = points[half].0 - points[0].0;
    let decay = (strength(&points[..half]) / strength(&points[half..2 * half])).ln() / apart;
    decay / (std::f64::consts::TAU * frequency)
}

/// Root mean square of the difference of two signals that are sampled alike.
pub fn root_mean_square(a: &[(Real, Real)], b: &[(Real, Real)]) -> Real {
    (a.iter().zip(b).map(|(a, b)| (a.1 - b.1) * (a.1 - b.1)).sum::<Real>() / a.len() as Real).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_undamped_swing_keeps_its_energy_and_a_damped_one_comes_to_rest() {
        let levels = |tau| Levels::of_box(Vec3::repeat(1.0), &[[2; 3]], damped(tau), true);
        let total = |s: &Swing| {
            let one = |n: usize| {
                0.5 * s.v[n].norm_squared() * s.solid.mass[n]
                    - s.solid.mass[n] * s.gravity.dot(&(s.x[n] - s.solid.rest[n]))
            };
            s.solid.energy(s.law, &s.x) + (0..s.x.len()).map(one).sum::<Real>()
        };
        for law in Law::ALL {
            let mut swing = Swing { gravity: GRAVITY, ..Swing::new(&levels(0.0), 0, law) };
            let (mut kinetic, mut worst): (Real, Real) = (0.0, 0.0);
            for _ in 0..500 {
                swing.advance(0.01);
                kinetic = kinetic.max((0..27).map(|n| 0.5 * swing.solid.mass[n] * swing.v[n].norm_squared()).sum());
                worst = worst.max(total(&swing).abs());
            }
            println!("{law:?}: energy within {worst:.1} J, peak kinetic {kinetic:.1} J");
            assert!(worst < 0.1 * kinetic, "{law:?}: {worst} of {kinetic}");
        }
        let mut swing = Swing { gravity: GRAVITY, ..Swing::new(&levels(0.1), 0, Law::Green) };
        (0..600).for_each(|_| swing.advance(0.01));
        assert!(swing.v.iter().all(|v| v.norm() < 1e-3));
    }

    #[test]
    fn frequency_purity_and_damping_of_a_decaying_cosine_come_out() {
        let signal = |zeta: Real, more: Real| -> Vec<(Real, Real)> {
            let at = |t: Real| (-zeta * 6.0 * t).exp() * 0.1 * (6.0 * t).cos() + more * (17.0 * t).cos();
            (0..1000).map(|i| 0.01 * i as Real).map(|t| (t, at(t))).collect()
        };
        let (frequency, part) = strongest_line(&signal(0.0, 0.0), [0.5, 5.0]);
        assert!((frequency * std::f64::consts::TAU / 6.0 - 1.0).abs() < 0.01 && part > 0.98, "{frequency} {part}");
        let part = strongest_line(&signal(0.0, 0.1), [0.5, 5.0]).1;
        assert!((part - 0.5).abs() < 0.02, "{part}");
        let damped = signal(0.05, 0.0);
        let ratio = damping_ratio(&damped, strongest_line(&damped, [0.5, 5.0]).0);
        assert!((ratio / 0.05 - 1.0).abs() < 0.05, "{ratio}");
    }
}
