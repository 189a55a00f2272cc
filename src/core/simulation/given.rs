//! How a change of a [`Parameter`] is made, and taken back to what the settings give.

use super::parameter::{Parameter, Threshold};
use super::{Settings, Simulation};
use crate::adaptation::Adaptivity;
use crate::contact::shape::Shape;
use crate::math::{Real, Vec3};
use crate::model::Body;
use crate::model::active_mesh::Stiffening;

/// Values that the settings give to what may change.
#[derive(Debug)]
pub(super) struct Given {
    gravity: Vec3,
    /// By tool, as the next.
    friction: Vec<Real>,
    shapes: Vec<Shape>,
    adaptivity: Option<Adaptivity>,
}

impl Given {
    pub(super) fn by(settings: &Settings) -> Self {
        Self {
            gravity: settings.gravity,
            friction: settings.tools.iter().map(|tool| tool.friction).collect(),
            shapes: settings.tools.iter().map(|tool| tool.shape.clone()).collect(),
            adaptivity: settings.adaptivity.clone(),
        }
    }
}

/// Most quantities that may have been changed in a session of `body` with `settings`.
pub(super) fn most_parameters(body: &Body, settings: &Settings) -> usize {
    3 + Threshold::ALL.len() + body.tissue_count() + 2 * settings.tools.len()
}

impl Simulation {
    /// Quantities that have been changed since the settings, with their values.
    pub fn parameters(&self) -> &[Parameter] {
        &self.parameters
    }

    /// Gives a quantity another value; of a tissue or tool that is not there, nothing happens.
    pub(super) fn set(&mut self, parameter: Parameter) {
        let has = |tool: u16| self.tools.get(usize::from(tool)).map(|state| state.shape.unwrap_or(tool));
        let is_another = matches!(parameter, Parameter::Shape { tool, of } if has(tool) != Some(of));
        let friction = |tool: u16| self.settings.tools.get(usize::from(tool)).map_or(0.0, |tool| tool.friction);
        let was = if let Parameter::Friction { tool, .. } = parameter { friction(tool) } else { 0.0 };
        if self.assume(parameter) {
            match parameter {
                Parameter::Supports(factor) => self.mesh.set_support_factor(&self.body, factor),
                Parameter::Shape { tool, .. } if is_another => self.forget_contacts_of(usize::from(tool)),
                Parameter::Friction { tool, coefficient } if self.tools[usize::from(tool)].touches() => {
                    self.tools[usize::from(tool)].friction_left += was - coefficient;
                }
                _ => {}
            }
        }
    }

    /// Elements go on taking over the stiffness of their tissues, or begin to.
    pub(super) fn stiffen(&mut self) {
        let wanted = self.parameters.iter().filter_map(|parameter| match parameter {
            Parameter::Stiffness { tissue, factor } => Some((usize::from(*tissue), *factor)),
            _ => None,
        });
        self.mesh.begin_stiffening(&self.body, wanted);
        self.mesh.go_on_stiffening(&self.body);
    }

    /// A tool of another shape may be inside the body: it has to come from outside again.
    fn forget_contacts_of(&mut self, tool: usize) {
        if self.tools[tool].touches() {
            self.tools[tool].wait();
        }
        self.points[tool].clear();
        self.detection.forget();
    }

    /// False where there is no such quantity.
    fn assume(&mut self, parameter: Parameter) -> bool {
        match parameter {
            Parameter::Gravity(gravity) => self.settings.gravity = gravity,
            Parameter::Friction { tool, coefficient } if usize::from(tool) < self.settings.tools.len() => {
                self.settings.tools[usize::from(tool)].friction = coefficient;
            }
            Parameter::Shape { tool, of } => {
                let Some(shape) = self.given.shapes.get(usize::from(of)) else { return false };
                let Some(taker) = self.settings.tools.get_mut(usize::from(tool)) else { return false };
                taker.shape.clone_from(shape);
                self.tools[usize::from(tool)].shape = (of != tool).then_some(of);
            }
            Parameter::Damping(factor) => self.mesh.damping = factor,
            Parameter::Supports(factor) => self.mesh.assume_support_factor(factor),
            Parameter::Resolution { threshold, value } => match (&mut self.settings.adaptivity, threshold) {
                (Some(adaptivity), Threshold::Split) => adaptivity.split = value,
                (Some(adaptivity), Threshold::Merge) => adaptivity.merge = value,
                (Some(adaptivity), Threshold::Reach) => adaptivity.reach = value,
                (None, _) => return false,
            },
            Parameter::Stiffness { tissue, .. } if usize::from(tissue) < self.body.tissue_count() => {}
            _ => return false,
        }
        match self.parameters.iter_mut().find(|set| set.is_same_quantity(&parameter)) {
            Some(set) => *set = parameter,
            None => self.parameters.push(parameter),
        }
        true
    }

    /// Makes these all that has been changed, before a state is restored.
    pub(super) fn assume_all(&mut self, parameters: &[Parameter], stiffening: &Stiffening) {
        self.settings.gravity = self.given.gravity;
        let given = self.given.friction.iter().zip(&self.given.shapes);
        for ((tool, state), (friction, shape)) in self.settings.tools.iter_mut().zip(&mut self.tools).zip(given) {
            tool.friction = *friction;
            tool.shape.clone_from(shape);
            state.shape = None;
        }
        self.settings.adaptivity.clone_from(&self.given.adaptivity);
        self.mesh.damping = 1.0;
        self.mesh.assume_support_factor(1.0);
        self.mesh.assume_stiffness(&self.body, stiffening);
        self.parameters.clear();
        parameters.iter().for_each(|parameter| {
            self.assume(*parameter);
        });
    }
}
