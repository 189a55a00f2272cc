//! The core: `advance(inputs of this tick) → outputs`, a deterministic function of the body, the settings and the
//! ordered inputs.
//!
//! Nothing in here reads a clock, a file, the environment or a random source, takes a lock, logs or allocates once
//! the simulation is built. Nothing but [`Inputs`] enters a tick, nothing but [`Outputs`] leaves it, and a
//! [`Snapshot`] is all that it carries over: restored, the same inputs give the same bits.

use crate::contact::detection::{self, Touchable};
use crate::contact::safety::{self, ForceLimits, Limited};
use crate::contact::tool::{Following, MOST_POINTS, MOST_TOOLS, Phase, Tool, ToolEvent, ToolState};
use crate::contact::wrench::{self, Wrench};
use crate::math::{Real, Vec3};
use crate::model::constraint::PointMemory;
use crate::model::element_kernel::{Extremes, Path};
use crate::model::{Body, Constraint, State, skin};
use crate::stepping::step;
use crate::stepping::time_step;
use serde::{Deserialize, Serialize};
use std::sync::Arc;

/// Length of a tick [s].
pub const TICK: Real = 1e-3;
/// Ticks of a frame: the surface is published once per frame (31.25 Hz).
pub const TICKS_PER_FRAME: u64 = 32;

/// What a simulation is told once.
#[derive(Clone, Debug, PartialEq)]
pub struct Settings {
    /// Gravity [m/s²].
    pub gravity: Vec3,
    /// Tools that clients may take, at most [`MOST_TOOLS`]; a tool's id is its index.
    pub tools: Vec<Tool>,
    /// How tools follow their poses.
    pub following: Following,
    /// Bounds on rendered forces.
    pub limits: ForceLimits,
}

/// Everything that one tick consumes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Inputs {
    /// Ticks that the machine lost just before this one: time passes, the body stands still.
    pub lapsed: u32,
    /// Element evaluations that this tick may spend.
    pub budget: u32,
    /// Back to the starting state first.
    pub reset: bool,
    /// What happened to each tool, by id.
    pub tools: [Option<ToolEvent>; MOST_TOOLS],
}

impl Default for Inputs {
    /// Nothing happens, and work is unbounded.
    fn default() -> Self {
        Self { lapsed: 0, budget: u32::MAX, reset: false, tools: [None; MOST_TOOLS] }
    }
}

/// Everything that changes from tick to tick.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Snapshot {
    /// Ticks since the start of the session.
    pub tick: u64,
    /// Motion of the body.
    pub body: State,
    /// Each tool, by id.
    pub tools: Vec<ToolState>,
    /// Each tool's contact points of the last tick, ascending, at most [`MOST_POINTS`].
    pub points: Vec<Vec<PointMemory>>,
}

impl Snapshot {
    /// The body at rest, no tool held.
    pub fn at_rest(body: &Body, tools: usize) -> Self {
        Self {
            tick: 0,
            body: State::at_rest(body),
            tools: vec![ToolState::default(); tools],
            points: (0..tools).map(|_| Vec::with_capacity(MOST_POINTS)).collect(),
        }
    }

    /// Takes over `other`, of the same body and tools, without allocating.
    pub fn copy_from(&mut self, other: &Snapshot) {
        self.tick = other.tick;
        self.body.copy_from(&other.body);
        self.tools.copy_from_slice(&other.tools);
        for (mine, theirs) in self.points.iter_mut().zip(&other.points) {
            mine.clear();
            mine.extend_from_slice(theirs);
        }
    }

    /// xxh3-64 of every bit of it.
    pub fn hash(&self) -> u64 {
        let mut hash = xxhash_rust::xxh3::Xxh3::new();
        hash.update(&self.tick.to_le_bytes());
        self.body.hash_into(&mut hash);
        for (tool, points) in self.tools.iter().zip(&self.points) {
            tool.hash_into(&mut hash);
            for p in points {
                hash.update(&p.point.to_le_bytes());
                for x in [p.multiplier, p.slack, p.normal.x, p.normal.y, p.normal.z] {
                    hash.update(&x.to_le_bytes());
                }
            }
        }
        hash.digest()
    }
}

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

/// What a tick says of itself with every wrench.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct TickFlags {
    /// A state that was not finite was contained.
    pub restored: bool,
    /// The budget did not cover the tick.
    pub substeps_dropped: bool,
}

/// Everything that leaves a tick.
#[derive(Clone, Debug)]
pub struct Outputs {
    /// Ticks since the start of the session.
    pub tick: u64,
    /// Each tool, by id.
    pub tools: Vec<ToolOutput>,
    /// The tick ends a frame: `skin` and `hash` are those of this tick.
    pub frame: bool,
    /// Display vertices [m], (n_vertices); as of the last frame.
    pub skin: Vec<Vec3>,
    /// [`Snapshot::hash`] as of the last frame.
    pub hash: u64,
    /// Sub-steps needed and taken.
    pub plan: time_step::Plan,
    /// Element evaluations spent.
    pub element_evaluations: u32,
    /// How far the elements are from rest.
    pub extremes: Extremes,
    /// A state that was not finite has been replaced by the last good one, at rest.
    pub restored: bool,
}

impl Outputs {
    /// What the tick says of itself with every wrench.
    pub fn flags(&self) -> TickFlags {
        TickFlags { restored: self.restored, substeps_dropped: self.plan.taken < self.plan.needed }
    }
}

/// A body under way.
#[derive(Debug)]
pub struct Simulation {
    body: Arc<Body>,
    settings: Settings,
    path: Path,
    now: Snapshot,
    start: State,
    last_good: State,
    vertices: Vec<Vec3>,
    constraints: Vec<Constraint>,
    points_of_action: Vec<Vec3>,
    stepping: step::Workspace,
    detection: detection::Workspace,
    outputs: Outputs,
}

impl Simulation {
    /// `body` in the state `start`, which a reset returns to.
    ///
    /// # Errors
    /// When `start` does not fit the body or the tools, or more than [`MOST_TOOLS`] are given.
    pub fn new(body: Arc<Body>, settings: Settings, start: Snapshot) -> Result<Self, String> {
        let nodes = body.level().mesh.nodes.len();
        if start.body.position.len() != nodes || start.body.velocity.len() != nodes {
            return Err(format!("the state has {} nodes, the body {nodes}", start.body.position.len()));
        }
        let tools = settings.tools.len();
        let most_points = start.points.iter().map(Vec::len).max().unwrap_or(0);
        if tools > MOST_TOOLS || start.tools.len() != tools || start.points.len() != tools || most_points > MOST_POINTS
        {
            return Err(format!("{tools} tools: a session has at most {MOST_TOOLS}, and its state as many"));
        }
        let mut now = Snapshot::at_rest(&body, tools);
        now.copy_from(&start);
        let vertices = body.surface().vertices.len();
        Ok(Self {
            path: Path::best(),
            start: start.body.clone(),
            last_good: start.body,
            vertices: vec![Vec3::zeros(); vertices],
            constraints: Vec::with_capacity(MOST_POINTS * tools),
            points_of_action: Vec::with_capacity(MOST_POINTS * tools),
            stepping: step::Workspace::new(&body, MOST_POINTS * tools),
            detection: detection::Workspace::new(&body),
            outputs: Outputs {
                tick: now.tick,
                tools: vec![ToolOutput::default(); tools],
                frame: false,
                skin: body.surface().vertices.clone(),
                hash: 0,
                plan: time_step::Plan { needed: 0, taken: 0 },
                element_evaluations: 0,
                extremes: Extremes::REST,
                restored: false,
            },
            now,
            body,
            settings,
        })
    }

    /// What a reset returns to; the starting state unless set.
    pub fn reset_state(&self) -> &State {
        &self.start
    }

    /// Makes a reset return to `state`, which must be of the same body.
    pub fn with_reset_state(mut self, state: &State) -> Self {
        self.start.copy_from(state);
        self
    }

    /// Runs the kernel on `path` from now on; it must be available on this CPU. The results do not depend on it.
    pub fn with_path(mut self, path: Path) -> Self {
        debug_assert!(Path::available().contains(&path));
        self.path = path;
        self
    }

    /// The body.
    pub fn body(&self) -> &Arc<Body> {
        &self.body
    }

    /// The settings.
    pub fn settings(&self) -> &Settings {
        &self.settings
    }

    /// Everything that the next tick depends on beside its inputs.
    pub fn snapshot(&self) -> &Snapshot {
        &self.now
    }

    /// Changes the state between ticks: for tests and for settling a body before it is served.
    pub fn state_mut(&mut self) -> &mut State {
        &mut self.now.body
    }

    /// One tick.
    pub fn advance(&mut self, inputs: &Inputs) -> &Outputs {
        self.begin(inputs);
        self.move_tools(inputs);
        self.find_contacts();
        let plan = time_step::plan(&self.body, &self.now.body, TICK, inputs.budget);
        self.step(plan);
        self.contain();
        self.render_forces();
        self.end_frame();
        &self.outputs
    }

    fn begin(&mut self, inputs: &Inputs) {
        self.now.tick += 1 + u64::from(inputs.lapsed);
        self.outputs.tick = self.now.tick;
        self.outputs.restored = false;
        if inputs.reset {
            self.now.body.copy_from(&self.start);
            self.last_good.copy_from(&self.start);
            self.now.points.iter_mut().for_each(Vec::clear);
            // The shape jumps back under the tools: they have to come from outside again.
            for tool in &mut self.now.tools {
                if tool.touches() {
                    tool.phase = Phase::Waiting;
                    tool.ramp = 0.0;
                }
            }
        }
    }

    fn move_tools(&mut self, inputs: &Inputs) {
        for (tool, event) in self.now.tools.iter_mut().zip(&inputs.tools) {
            tool.follow(event.as_ref(), TICK, &self.settings.following);
        }
    }

    /// Fills the constraint list, tool by tool, and lets waiting tools engage where they are outside.
    fn find_contacts(&mut self) {
        self.constraints.clear();
        self.points_of_action.clear();
        if self.now.tools.iter().all(|t| t.phase == Phase::Detached) {
            self.now.points.iter_mut().for_each(Vec::clear);
            return;
        }
        skin::skin(self.body.level(), &self.now.body.position, &mut self.vertices);
        let on = Touchable { body: &self.body, vertices: &self.vertices, tick: TICK };
        for (i, (tool, points)) in self.now.tools.iter_mut().zip(&mut self.now.points).enumerate() {
            let shape = &self.settings.tools[i].shape;
            if tool.phase == Phase::Waiting && detection::is_outside(&on, shape, &tool.pose) {
                tool.phase = Phase::Engaged;
                tool.previous = tool.pose;
            }
            if !tool.touches() {
                points.clear();
                continue;
            }
            let out = (&mut self.constraints, &mut self.points_of_action);
            detection::detect(&on, i as u32, shape, tool, points, out, &mut self.detection);
        }
    }

    fn step(&mut self, plan: time_step::Plan) {
        self.outputs.plan = plan;
        self.outputs.element_evaluations = plan.taken * self.body.level().mesh.elements.len() as u32;
        if plan.taken > 0 {
            self.outputs.extremes = step::substeps(
                self.path,
                &self.body,
                &mut self.now.body,
                &mut self.constraints,
                self.settings.gravity,
                (plan.taken, TICK / Real::from(plan.needed)),
                &mut self.stepping,
            );
        }
        // The solver's multipliers are where the next tick starts.
        let mut constraints = self.constraints.iter();
        for point in self.now.points.iter_mut().flatten() {
            if let Some(c) = constraints.next() {
                debug_assert_eq!(c.point, point.point);
                point.multiplier = c.multiplier;
            }
        }
    }

    /// Our last line: a state that is not finite is replaced by the last good one, at rest, and the hand feels nothing.
    fn contain(&mut self) {
        if self.now.body.is_finite() {
            if self.now.tick.is_multiple_of(TICKS_PER_FRAME) {
                self.last_good.copy_from(&self.now.body);
            }
            return;
        }
        self.outputs.restored = true;
        self.now.body.copy_from(&self.last_good);
        self.now.body.velocity.fill(Vec3::zeros());
        // At rest from now on, so that a recording which begins here knows it too.
        self.last_good.copy_from(&self.now.body);
        self.now.points.iter_mut().for_each(Vec::clear);
        self.constraints.clear();
        for tool in &mut self.now.tools {
            tool.force.fill(0.0);
            tool.torque.fill(0.0);
            if tool.touches() {
                tool.phase = Phase::Waiting;
                tool.ramp = 0.0;
            }
        }
    }

    fn render_forces(&mut self) {
        let stood_still = self.outputs.plan.taken == 0;
        for (i, tool) in self.now.tools.iter_mut().enumerate() {
            let middle = wrench::middle_pose(tool);
            let (mut physical, mut contact_points) =
                wrench::wrench_on(i as u32, &middle, &self.constraints, &self.points_of_action);
            if stood_still && tool.touches() {
                // No step, no new force: the last one stands.
                physical = Wrench { force: tool.physical_force, torque: tool.physical_torque };
                contact_points = self.now.points[i].iter().filter(|p| p.multiplier > 0.0).count() as u32;
            }
            let limited = safety::render(tool, &physical, &self.settings.limits, TICK);
            self.outputs.tools[i] = ToolOutput { state: *tool, contact_points, limited };
        }
    }

    fn end_frame(&mut self) {
        let frame = self.now.tick.is_multiple_of(TICKS_PER_FRAME);
        self.outputs.frame = frame;
        if frame {
            skin::skin(self.body.level(), &self.now.body.position, &mut self.outputs.skin);
            self.outputs.hash = self.now.hash();
        }
    }
}
