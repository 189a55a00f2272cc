//! How a change of a [`Parameter`] is made, and taken back to what the settings give.

use super::parameter::Parameter;
use super::{Settings, Simulation};
use crate::math::{Real, Vec3};
use crate::model::Body;

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
