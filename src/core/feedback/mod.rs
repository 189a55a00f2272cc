//! What a hand that is far away needs beside the force: how the force will change where the tool goes next.

mod approach;
pub mod relaxed;
mod stiffness;

use crate::math::{Mat3, Real, Vec3};
use crate::simulation::ToolOutput;
use stiffness::Stiffness;

/// The force near the pose that a wrench answers, `F(x) = force − K (x − position)`, as long as it does not pull.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct LocalModel {
    /// Where the device is that this answers [m].
    pub position: Vec3,
    /// Force on the device there [N]; short of contact it points into the body.
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

/// Part of the way to a new stiffness that is made in each tick: a hand feels no step, and after a frame it is all there.
const FOLLOWED: Real = 0.1;

impl LocalModel {
    /// The model after a tick that left `tool`, of which the newest copy said `stiffness`.
    ///
    /// Before contact it says where the surface is, so that a hand far away finds it there without waiting for the
    /// network; a tool that has just lost contact keeps the last model until more is known.
    pub fn update(&mut self, tool: &ToolOutput, stiffness: &Option<Stiffness>) -> &Self {
        let state = &tool.state;
        let place = state.device.position;
        if !state.touches() || (place - self.position).norm() > FORGOTTEN {
            self.range = 0.0;
        }
        let physical = state.physical_force.norm_squared();
        let pushed = tool.contact_points > 0 && physical > 0.0;
        let Some(known) = stiffness.filter(|known| state.touches() && (pushed || known.begins.is_some())) else {
            return self;
        };
        // What ramps and limits take from the force they take from what it changes by.
        let rendered = if pushed { state.force.dot(&state.physical_force) / physical } else { state.ramp };
        // Since the copy the tool has gone in or out: round things in contact are stiffer by the cube root of the force
        // [Hertz].
        let firmer = if pushed { (physical.sqrt() / known.load).cbrt().clamp(0.5, 2.0) } else { 1.0 };
        let k = known.matrix * (firmer * rendered.clamp(0.0, 1.0));
        let target = [k.m11, k.m22, k.m33, k.m23, k.m13, k.m12];
        let share = if self.range > 0.0 { FOLLOWED } else { 1.0 };
        let stiffness = std::array::from_fn(|i| self.stiffness[i] + share * (target[i] - self.stiffness[i]));
        let ahead = || {
            let [xx, yy, zz, yz, zx, xy] = stiffness;
            let gap = known.normal.dot(&place) - known.begins.unwrap_or_default();
            -Mat3::new(xx, xy, zx, xy, yy, yz, zx, yz, zz) * known.normal * gap.max(0.0)
        };
        let force = if pushed { state.force } else { ahead() };
        *self = Self { position: place, force, normal: known.normal, stiffness, range: known.range };
        self
    }
}
