//! What may change while a simulation runs. A change enters a tick as an input, so that a replay makes it, too.

use super::{Settings, Simulation};
use crate::adaptation::finest_steppable;
use crate::math::{Real, Vec3};
use crate::model::element_pool::CLASSES;
use crate::model::step_class::{largest_omega_squared, omega_squared};
use crate::model::{Body, Material};
use serde::{Deserialize, Serialize};
use std::ops::RangeInclusive;

/// A quantity that may change, with its new value.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub enum Parameter {
    /// Gravity [m/s²].
    Gravity(Vec3),
    /// How many times as stiff as prepared a tissue is: factor on λ, μ and the viscosities.
    Stiffness {
        /// Its number, below [`Body::tissue_count`].
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
}

impl Parameter {
    /// Whether `other` is a value of the same quantity.
    pub fn is_same_quantity(&self, other: &Parameter) -> bool {
        use Parameter::{Damping, Friction, Gravity, Stiffness};
        match (self, other) {
            (Stiffness { tissue: a, .. }, Stiffness { tissue: b, .. })
            | (Friction { tool: a, .. }, Friction { tool: b, .. }) => a == b,
            (Gravity(_), Gravity(_)) | (Damping(_), Damping(_)) => true,
            _ => false,
        }
    }

    /// Its numbers.
    pub fn values(&self) -> &[Real] {
        match self {
            Parameter::Gravity(g) => g.as_slice(),
            Parameter::Stiffness { factor: value, .. }
            | Parameter::Friction { coefficient: value, .. }
            | Parameter::Damping(value) => std::slice::from_ref(value),
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
/// Factors on the stiffness of a tissue, as far as its elements can be stepped: a softer one is crushed by the forces that hands
/// apply to the body as prepared, a stiffer one is better prepared so.
pub const STIFFNESS: RangeInclusive<Real> = 0.05..=20.0;

/// What each quantity may be in a session.
#[derive(Clone, Debug)]
pub struct ParameterRanges {
    /// Largest `ω²` at rest of the elements of each material on the levels in use [1/s²], and that of the shortest step.
    omega_squared: Vec<Real>,
    largest: Real,
    tools: usize,
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
        Self { omega_squared: stiffest, largest, tools: settings.tools.len() }
    }

    /// Values that the quantity of `parameter` may take beside those that have been `set`; `None` where there is no such tool or
    /// tissue.
    pub fn of(&self, body: &Body, parameter: &Parameter, set: &[Parameter]) -> Option<RangeInclusive<Real>> {
        match parameter {
            Parameter::Gravity(_) => Some(GRAVITY),
            Parameter::Friction { tool, .. } => (usize::from(*tool) < self.tools).then_some(FRICTION),
            Parameter::Damping(_) => Some(DAMPING),
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
                let shear = |material: &Material| material.mu / material.pressure_modulus();
                let branches = (shear(&now) / shear(&then)).max(1.0);
                self.omega_squared[*m] * now.pressure_modulus() / then.pressure_modulus() * branches <= self.largest
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

impl Simulation {
    /// Quantities that have been changed since the settings, with their values.
    pub fn parameters(&self) -> &[Parameter] {
        &self.parameters
    }

    /// Gives a quantity another value; of a tissue or tool that is not there, nothing happens.
    pub(super) fn set(&mut self, parameter: Parameter) {
        if self.assume(parameter) {
            if let Parameter::Stiffness { tissue, factor } = parameter {
                self.mesh.set_stiffness(&self.body, usize::from(tissue), factor);
                self.detection.forget_stiffness();
            }
            // The body finds another balance, and the hand need not feel how.
            self.tools.iter_mut().filter(|tool| tool.touches()).for_each(|tool| tool.begin_transition());
        }
    }

    /// [`Simulation::set`], of which no element hears. False where there is no such quantity.
    fn assume(&mut self, parameter: Parameter) -> bool {
        match parameter {
            Parameter::Gravity(gravity) => self.settings.gravity = gravity,
            Parameter::Stiffness { tissue, factor } if usize::from(tissue) < self.mesh.stiffness().len() => {
                self.mesh.assume_stiffness(&self.body, usize::from(tissue), factor);
            }
            Parameter::Friction { tool, coefficient } if usize::from(tool) < self.settings.tools.len() => {
                self.settings.tools[usize::from(tool)].friction = coefficient;
            }
            Parameter::Damping(factor) => self.mesh.damping = factor,
            _ => return false,
        }
        match self.parameters.iter_mut().find(|set| set.is_same_quantity(&parameter)) {
            Some(set) => *set = parameter,
            None => self.parameters.push(parameter),
        }
        true
    }

    /// Makes `parameters` all that has been changed, before the state is restored.
    pub(super) fn assume_all(&mut self, parameters: &[Parameter]) {
        self.settings.gravity = self.given.gravity;
        for (tool, friction) in self.settings.tools.iter_mut().zip(&self.given.friction) {
            tool.friction = *friction;
        }
        self.mesh.damping = 1.0;
        for t in 0..self.mesh.stiffness().len() {
            if self.mesh.stiffness()[t] != 1.0 {
                self.mesh.assume_stiffness(&self.body, t, 1.0);
            }
        }
        self.parameters.clear();
        parameters.iter().for_each(|parameter| {
            self.assume(*parameter);
        });
    }
}

/// Values that the settings give to what may change.
#[derive(Debug)]
pub(super) struct Given {
    gravity: Vec3,
    /// By tool.
    friction: Vec<Real>,
}

impl Given {
    pub(super) fn by(settings: &Settings) -> Self {
        Self { gravity: settings.gravity, friction: settings.tools.iter().map(|tool| tool.friction).collect() }
    }
}

/// Most quantities that may have been changed in a session of `body` with `settings`.
pub(super) fn most_parameters(body: &Body, settings: &Settings) -> usize {
    2 + body.tissue_count() + settings.tools.len()
}
