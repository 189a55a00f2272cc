//! The energy of a body that nothing damps: how far it goes astray, and when the body blows up.

use super::coupling::{Mixed, Motion};
use super::laws::green_strain;
use super::levels::Random;
use palpate_core::math::{Mat3, Real, Vec3};

/// What happened to one undamped body.
#[derive(Clone, Debug, Default)]
pub struct Run {
    /// Largest change of the total energy over the largest kinetic energy of the first second; infinite once blown up.
    pub drift: Real,
    /// When the energy had changed by ten times that, if ever [s].
    pub blown: Option<Real>,
    /// Largest speed of the centre of mass that no force accounts for [m/s]; of a free body.
    pub centre_speed: Real,
    /// Largest |E| of any element; infinite once blown up.
    pub strain: Real,
    /// Largest energy change so far over the same scale, as a power of ten, against time [s].
    pub energy: Vec<(Real, Real)>,
}

/// Collects energies [J] on the way.
#[derive(Clone, Debug)]
pub struct Watch {
    start: Real,
    scale: Real,
    changes: Vec<(Real, Real)>,
    /// What is known so far.
    pub run: Run,
}

impl Watch {
    /// From a total and a kinetic energy on.
    pub fn new(total: Real, kinetic: Real) -> Self {
        Self { start: total, scale: kinetic, changes: Vec::new(), run: Run::default() }
    }

    /// The energies at `time` [s]; false once the body has blown up.
    pub fn note(&mut self, time: Real, total: Real, kinetic: Real) -> bool {
        if time <= 1.0 && kinetic.is_finite() {
            // What blows up within the first second must not become its own measure.
            self.scale = self.scale.max(kinetic.min(1e4));
        }
        let change = (total - self.start).abs();
        self.changes.push((time, change));
        let blown = change.is_nan() || (time > 0.1 && change >= 10.0 * self.scale);
        self.run.blown = blown.then_some(time);
        !blown
    }

    /// What became of it.
    pub fn end(mut self) -> Run {
        let mut most: Real = 1e-12;
        for (time, change) in &self.changes {
            most = most.max(change / self.scale);
            self.run.energy.push((*time, most.log10()));
        }
        self.run.drift = most;
        if self.run.blown.is_some() {
            // `max` passes over NaN, so a body that overflows between two samples would look quiet.
            (self.run.drift, self.run.strain) = (Real::INFINITY, Real::INFINITY);
        }
        self.run
    }
}

/// A gradient of velocity of up to 1/s: a free body spins and wobbles.
pub fn random_gradient(seed: u64) -> Mat3 {
    let mut random = Random::new(seed);
    Mat3::from_fn(|_, _| 2.0 * random.unit() - 1.0)
}

/// Lets `mixed` go at rest positions with this `gradient` of velocity [1/s], less its mean, for `duration` [s] at steps of
/// `dt` [s].
pub fn let_go(mixed: &Mixed, gradient: Mat3, gravity: Vec3, duration: Real, dt: Real) -> Run {
    let mass: Real = mixed.mass.iter().sum();
    let mut v: Vec<Vec3> = mixed.levels.rest.iter().map(|u| gradient * u).collect();
    let mean: Vec3 = v.iter().zip(&mixed.mass).map(|(v, m)| v * (*m / mass)).sum();
    v.iter_mut().for_each(|v| *v -= mean);
    let mut motion = Motion::new(mixed, v, gravity);
    let start = motion.sums(mixed);
    let mut watch = Watch::new(start.energy, start.kinetic);
    for step in 1..=(duration / dt) as usize {
        motion.step(mixed, dt);
        if step % 8 == 0 {
            let sums = motion.sums(mixed);
            let strain =
                |(e, _): &(usize, Real)| green_strain(&mixed.levels.elements[*e].gradient_of(&motion.x)).norm();
            let run = &mut watch.run;
            run.strain = mixed.weighted.iter().map(strain).fold(run.strain, Real::max);
            run.centre_speed = run.centre_speed.max((sums.momentum - start.momentum).norm() / mass);
            if !watch.note(step as Real * dt, sums.energy, sums.kinetic) {
                break;
            }
        }
    }
    watch.end()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_body_that_gains_energy_without_bound_is_told_from_one_that_keeps_it() {
        let watched = |growth: Real| {
            let mut watch = Watch::new(1.0, 1.0);
            let at = |i: i32| (0.1 * Real::from(i), 1.0 + 1e-3 * (growth * Real::from(i)).exp());
            let all = (1..200).map(at).take_while(|(t, energy)| watch.note(*t, *energy, 1.0)).count();
            (watch.end(), all)
        };
        let (quiet, all) = watched(0.0);
        assert!(quiet.blown.is_none() && (quiet.drift - 1e-3).abs() < 1e-12 && all == 199);
        let (blown, all) = watched(0.5);
        assert!(blown.drift.is_infinite() && all == 18 && (blown.blown.unwrap() - 1.9).abs() < 1e-9);
    }
}
