//! How far what may change can go, for whoever lets changes in.

use super::Settings;
use super::parameter::{DAMPING, FRICTION, GRAVITY, Parameter, STIFFNESS, SUPPORTS};
use crate::adaptation::finest_steppable;
use crate::math::Real;
use crate::model::element_pool::CLASSES;
use crate::model::step_class::{largest_omega_squared, omega_squared};
use crate::model::{Body, Material};
use std::ops::RangeInclusive;

/// What each quantity may be in a session.
#[derive(Clone, Debug)]
pub struct ParameterRanges {
    /// Largest `ω²` at rest of the elements of each material on the levels in use [1/s²], and that of the shortest step.
    omega_squared: Vec<Real>,
    largest: Real,
    tools: usize,
    adapts: bool,
}

impl ParameterRanges {
    /// For sessions of `body` with `settings`.
    pub fn new(body: &Body, settings: &Settings) -> Self {
        let allowed = settings.adaptivity.as_ref().map_or(usize::MAX, |adaptivity| adaptivity.finest);
        let mut stiffest = vec![0.0; body.parts().materials.len()];
        for e in (0..=finest_steppable(body).min(allowed)).flat_map(|r| body.elements_of(r)) {
            let of: &mut Real = &mut stiffest[body.material_number(e)];
            *of = of.max(omega_squared(body, body.material_of(e), e));
        }
        let largest = largest_omega_squared(CLASSES - 1, body.damping_time());
        Self { omega_squared: stiffest, largest, tools: settings.tools.len(), adapts: settings.adaptivity.is_some() }
    }

    /// Values that the quantity of `parameter` may take beside those that have been `set`; `None` where there is no such tool or
    /// tissue, or the resolution does not adapt.
    pub fn of(&self, body: &Body, parameter: &Parameter, set: &[Parameter]) -> Option<RangeInclusive<Real>> {
        match parameter {
            Parameter::Gravity(_) => Some(GRAVITY),
            Parameter::Friction { tool, .. } => (usize::from(*tool) < self.tools).then_some(FRICTION),
            Parameter::Shape { tool, .. } => {
                (usize::from(*tool) < self.tools).then_some(0.0..=self.tools as Real - 1.0)
            }
            Parameter::Damping(_) => Some(DAMPING),
            Parameter::Supports(_) => Some(SUPPORTS),
            Parameter::Resolution { threshold, .. } => self.adapts.then(|| threshold.range()),
            Parameter::Stiffness { tissue, .. } => {
                let t = usize::from(*tissue);
                (t < body.tissue_count()).then(|| *STIFFNESS.start()..=self.stiffest(body, t, set))
            }
        }
    }

    /// Largest factor on the stiffness of tissue `t` with which its elements can be stepped.
    fn stiffest(&self, body: &Body, t: usize, set: &[Parameter]) -> Real {
        let mut stiffness = vec![1.0; body.tissue_count()];
        for parameter in set {
            if let Parameter::Stiffness { tissue, factor } = parameter {
                stiffness[usize::from(*tissue)] = *factor;
            }
        }
        let has_it: Vec<usize> = (0..self.omega_squared.len()).filter(|m| body.has_tissue(*m, t)).collect();
        let mut can_step = |factor: Real| {
            stiffness[t] = factor;
            has_it.iter().all(|m| {
                let (now, then) = (body.mixed(*m, &stiffness), body.parts().materials[*m]);
                // Branches count by the part that shear has in the stiffness.
                let shear = |material: &Material| material.mu / material.largest_modulus();
                let branches = (shear(&now) / shear(&then)).max(1.0);
                self.omega_squared[*m] * now.largest_modulus() / then.largest_modulus() * branches <= self.largest
            })
        };
        let (mut can, mut cannot) = (*STIFFNESS.start(), *STIFFNESS.end());
        if can_step(cannot) {
            return cannot;
        }
        while cannot > 1.0001 * can {
            let middle = (can * cannot).sqrt();
            if can_step(middle) {
                can = middle;
            } else {
                cannot = middle;
            }
        }
        (1e3 * can).floor() / 1e3
    }
}
