//! What a hand that is far away needs beside the force: how the force will change where the tool goes next.

pub mod relaxed;

use crate::math::{Real, Vec3};
use crate::simulation::ToolOutput;
use relaxed::Stiffness;

/// The force near the pose that a wrench answers, `F(x) = force − K (x − position)`, as long as it does not pull.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct LocalModel {
    /// Where the handle is that this answers [m].
    pub position: Vec3,
    /// Force on the handle there [N]; short of contact it points into the body.
    pub force: Vec3,
    /// Out of the body, unit; zero where nothing is near.
    pub normal: Vec3,
    /// K [N/m], symmetric: xx, yy, zz, yz, zx, xy.
    pub stiffness: [Real; 6],
    /// How far from there the model holds [m]; 0: it says nothing.
    pub range: Real,
}

/// Farther from where contact ended than this [m], the next one will be elsewhere.
const FORGOTTEN: Real = 0.02;

impl LocalModel {
    /// The model after a tick that left `tool`, under which the body was last found to be `stiffness`.
    ///
    /// A tool that has just lost contact keeps the last model: it says where the surface begins, so that a hand far away
    /// finds it there again without waiting for the network.
    pub fn update(&mut self, tool: &ToolOutput, stiffness: &Option<Stiffness>) -> &Self {
        let state = &tool.state;
        if !state.touches() || (state.handle.position - self.position).norm() > FORGOTTEN {
            self.range = 0.0;
        }
        let physical = state.physical_force.norm_squared();
        if let Some(known) = stiffness.filter(|_| tool.contact_points > 0 && state.touches() && physical > 0.0) {
            // What ramps and limits take from the force they take from what it changes by.
            let rendered = (state.force.dot(&state.physical_force) / physical).clamp(0.0, 1.0);
            let k = known.matrix * rendered;
            *self = Self {
                position: state.handle.position,
                force: state.force,
                normal: known.normal,
                stiffness: [k.m11, k.m22, k.m33, k.m23, k.m13, k.m12],
                range: known.range,
            };
        }
        self
    }
}
