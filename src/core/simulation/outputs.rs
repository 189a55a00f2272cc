//! What leaves a tick.

use super::inputs::Settings;
use crate::adaptation;
use crate::contact::dent::Dent;
use crate::contact::safety::Limited;
use crate::contact::tool::{MOST_POINTS, ToolState};
use crate::contact::wrench::Wrench;
use crate::math::Vec3;
use crate::model::Body;
use crate::model::element_kernel::Extremes;

/// What a tick says of one tool.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ToolOutput {
    /// The tool's state after the tick: pose, physical and rendered wrench, what it answers.
    pub state: ToolState,
    /// Contact points that push.
    pub contact_points: u32,
    /// Why the rendered force differs from the physical one.
    pub limited: Limited,
}

/// What a tick says of one obstacle.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ObstacleOutput {
    /// Its reference point after the tick [m].
    pub position: Vec3,
    /// What the body puts on it, about that point.
    pub wrench: Wrench,
}

/// What a tick says of itself with every wrench.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct TickFlags {
    /// A state that was not finite was contained, or an entangled one.
    pub restored: bool,
    /// The budget did not cover the tick.
    pub substeps_dropped: bool,
}

/// Most levels of a body.
pub const MOST_LEVELS: usize = 16;

/// Time of one tick [ns], by the prices, counted before it runs.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Plan {
    /// What the body's motion needs, contacts with it.
    pub needed: u32,
    /// What is spent on it: all of it, or nothing.
    pub taken: u32,
    /// What the whole tick takes.
    pub whole: u32,
}

/// Everything that leaves a tick.
#[derive(Clone, Debug)]
pub struct Outputs {
    /// Ticks since the start of the session.
    pub tick: u64,
    /// Each tool, by id.
    pub tools: Vec<ToolOutput>,
    /// Each obstacle, in the order of the scene.
    pub obstacles: Vec<ObstacleOutput>,
    /// The tick ends a frame: `skin`, `dents`, `levels` and `hash` are those of this tick.
    pub frame: bool,
    /// Display vertices as the mesh shows them [m], (n_vertices); as of the last frame.
    pub skin: Vec<Vec3>,
    /// What it leaves out where tools and obstacles touch, as many as there may be; as of the last frame.
    pub dents: Vec<Dent>,
    /// Level of detail that displays each of them, (n_vertices); as of the last frame.
    pub levels: Vec<u8>,
    /// [`Simulation::hash`](super::Simulation::hash) as of the last frame.
    pub hash: u64,
    /// Time that the tick was planned to take: the body stood still when the budget did not cover its motion.
    pub plan: Plan,
    /// Element evaluations spent.
    pub element_evaluations: u32,
    /// Active nodes per level.
    pub active: [u32; MOST_LEVELS],
    /// Elements in use.
    pub elements: u32,
    /// Changes of resolution.
    pub adapted: adaptation::Adapted,
    /// How far the elements are from rest.
    pub extremes: Extremes,
    /// The state was not finite, or the body stayed entangled: it has been replaced by the one that a reset
    /// returns to.
    pub restored: bool,
}

impl Outputs {
    /// What the tick says of itself with every wrench.
    pub fn flags(&self) -> TickFlags {
        TickFlags { restored: self.restored, substeps_dropped: self.plan.taken < self.plan.needed }
    }
}

/// As many as all tools and obstacles together may make.
pub(super) fn most_dents(settings: &Settings) -> usize {
    (settings.tools.len() + settings.obstacles.len()) * MOST_POINTS
}

/// What viewers are shown of a tick that ends a frame.
#[derive(Clone, Debug)]
pub struct Frame {
    /// The tick that ended it.
    pub tick: u64,
    /// Display vertices as the mesh shows them [m], (n_vertices).
    pub skin: Vec<Vec3>,
    /// What it leaves out where tools and obstacles touch.
    pub dents: Vec<Dent>,
    /// Level of detail that displays each of them, (n_vertices).
    pub levels: Vec<u8>,
    /// Each tool, by id.
    pub tools: Vec<ToolState>,
    /// Each obstacle, in the order of the scene.
    pub obstacles: Vec<ObstacleOutput>,
}

impl Frame {
    /// One that any tick of `body` with `settings` fits into.
    pub fn with_room(body: &Body, settings: &Settings) -> Self {
        let vertices = body.surface().vertices.len();
        Self {
            tick: 0,
            skin: vec![Vec3::zeros(); vertices],
            dents: vec![Dent::default(); most_dents(settings)],
            levels: vec![0; vertices],
            tools: vec![ToolState::default(); settings.tools.len()],
            obstacles: vec![ObstacleOutput::default(); settings.obstacles.len()],
        }
    }

    /// Takes over what `outputs` say, for which it has room.
    pub fn fill(&mut self, outputs: &Outputs) {
        self.tick = outputs.tick;
        self.skin.copy_from_slice(&outputs.skin);
        self.dents.copy_from_slice(&outputs.dents);
        self.levels.copy_from_slice(&outputs.levels);
        for (to, from) in self.tools.iter_mut().zip(&outputs.tools) {
            *to = from.state;
        }
        self.obstacles.copy_from_slice(&outputs.obstacles);
    }
}

impl From<&Outputs> for Frame {
    fn from(outputs: &Outputs) -> Self {
        Self {
            tick: outputs.tick,
            skin: outputs.skin.clone(),
            dents: outputs.dents.clone(),
            levels: outputs.levels.clone(),
            tools: outputs.tools.iter().map(|tool| tool.state).collect(),
            obstacles: outputs.obstacles.clone(),
        }
    }
}
