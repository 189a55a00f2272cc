//! What enters a simulation: its settings once, and the inputs of each tick.

use super::parameter::Parameter;
use crate::adaptation::Adaptivity;
use crate::contact::meeting::Between;
use crate::contact::obstacle::Obstacle;
use crate::contact::safety::ForceLimits;
use crate::contact::tool::{Following, MOST_TOOLS, Tool, ToolEvent};
use crate::math::Vec3;
use crate::model::SupportMotion;
use crate::stepping::work::{Budget, Prices};

/// What a simulation is told once.
#[derive(Clone, Debug, PartialEq)]
pub struct Settings {
    /// Gravity [m/s²].
    pub gravity: Vec3,
    /// Tools that clients may take, at most [`MOST_TOOLS`]; a tool's id is its index.
    pub tools: Vec<Tool>,
    /// Rigid things that the body meets, at most [`MOST_OBSTACLES`](crate::contact::obstacle::MOST_OBSTACLES).
    pub obstacles: Vec<Obstacle>,
    /// What of friction is between organs.
    pub organ_friction: Between,
    /// Supports that do not stay where they are; one that is in several of these follows the last.
    pub support_motions: Vec<SupportMotion>,
    /// How tools follow their poses.
    pub following: Following,
    /// Bounds on rendered forces.
    pub limits: ForceLimits,
    /// When to refine and coarsen; `None` keeps the active nodes that the start has.
    pub adaptivity: Option<Adaptivity>,
    /// Most elements in use at once: what memory is made for.
    pub most_elements: usize,
}

/// Everything that one tick consumes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Inputs {
    /// Ticks that the machine lost just before this one: time passes, poses age, the body stands still.
    pub lapsed: u32,
    /// Time that this tick may take, by the prices.
    pub budget: Budget,
    /// What work costs from this tick on, where it has been measured anew.
    pub prices: Option<Prices>,
    /// Back to the starting state first; parameters stay as they are.
    pub reset: bool,
    /// What is changed then.
    pub parameter: Option<Parameter>,
    /// What happened to each tool, by id.
    pub tools: [Option<ToolEvent>; MOST_TOOLS],
}

impl Default for Inputs {
    /// Nothing happens, and work is unbounded.
    fn default() -> Self {
        Self {
            lapsed: 0,
            budget: Budget::UNLIMITED,
            prices: None,
            reset: false,
            parameter: None,
            tools: [None; MOST_TOOLS],
        }
    }
}
