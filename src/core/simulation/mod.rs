//! The core: `advance(inputs of this tick) → outputs`, a deterministic function of the body, the settings and the
//! ordered inputs.
//!
//! Nothing in here reads a clock, a file, the environment or a random source, takes a lock, logs or allocates once
//! the simulation is built. Nothing but [`Inputs`] enters a tick, nothing but [`Outputs`] leaves it, and a
//! [`Snapshot`] is all that it carries over: restored, the same inputs give the same bits.

mod contacts;
mod given;
mod inputs;
mod outputs;
mod parameter;
mod ranges;
mod room;
mod snapshot;

pub use crate::adaptation::MOST_FROZEN;
pub use crate::model::step_class::TICK;
pub use crate::stepping::work::{Budget, Laps, Part, Prices};
pub use inputs::{Inputs, Settings};
pub use outputs::{Frame, MOST_LEVELS, ObstacleOutput, Outputs, Plan, TickFlags, ToolOutput};
pub use parameter::{DAMPING, FRICTION, GRAVITY, Parameter, STIFFNESS, SUPPORTS, Threshold};
pub use ranges::ParameterRanges;
pub use snapshot::Snapshot;

use crate::adaptation::{self, Allowance, Focus, Request};
use crate::contact::dent::{Dent, deepen};
use crate::contact::detection;
use crate::contact::friction::{self, Solved};
use crate::contact::jaws::Mechanism;
use crate::contact::meeting;
use crate::contact::obstacle::{Form, MOST_OBSTACLES, Obstacle};
use crate::contact::safety;
use crate::contact::shape::MOST_PARTS;
use crate::contact::tool::{MOST_POINTS, MOST_TOOLS, Phase, ToolState};
use crate::contact::wrench;
use crate::ids::ToolId;
use crate::math::{Real, Vec3};
use crate::model::active_mesh::{Loads, Stiffening};
use crate::model::constraint::{Foot, PointMemory};
use crate::model::element_kernel::{Extremes, Simd};
use crate::model::entangled::{ENTANGLED_FRAMES, ReferencePose};
use crate::model::meeting::{MOST_MEETINGS, Meeting};
use crate::model::{ActiveMesh, Body, Constraint, State};
use crate::stepping::step::{self, Pushing, World};
use crate::stepping::work;
use given::{Given, most_parameters};
use std::sync::Arc;

/// Ticks of a frame: the surface is published once per frame (31.25 Hz).
pub const TICKS_PER_FRAME: u64 = 32;

/// A body under way.
#[derive(Debug)]
pub struct Simulation {
    body: Arc<Body>,
    /// As given but for the `parameters`.
    settings: Settings,
    given: Given,
    parameters: Vec<Parameter>,
    path: Simd,
    tick: u64,
    frozen: u32,
    /// As [`Snapshot::moved`].
    moved: Real,
    /// As [`Snapshot::moved_for`].
    moved_for: u64,
    prices: Prices,
    entangled: u32,
    mesh: ActiveMesh,
    tools: Vec<ToolState>,
    points: Vec<Vec<PointMemory>>,
    obstacle_points: Vec<Vec<PointMemory>>,
    meetings: Vec<Meeting>,
    start: State,
    /// Where `start` is.
    reference: ReferencePose,
    /// All display vertices [m], as of when all were last asked for.
    vertices: Vec<Vec3>,
    constraints: Vec<Constraint>,
    points_of_action: Vec<Vec3>,
    /// Other sides of the last constraints, which are between organs.
    feet: Vec<Foot>,
    focus: Vec<Focus>,
    met: Vec<Focus>,
    adaptation: adaptation::Workspace,
    stepping: step::Workspace,
    detection: detection::Workspace,
    /// Where the body has several organs.
    meeting: meeting::Workspace,
    outputs: Outputs,
}

impl Simulation {
    /// `body` in the state `start`, which a reset returns to.
    ///
    /// # Errors
    /// When `start` does not fit the body or the tools, or more than [`MOST_TOOLS`] or [`MOST_OBSTACLES`] are given.
    pub fn new(body: Arc<Body>, settings: Settings, start: Snapshot) -> Result<Self, String> {
        let tools = settings.tools.len();
        let most_points = start.points.iter().map(Vec::len).max().unwrap_or(0);
        if tools > MOST_TOOLS || start.tools.len() != tools || start.points.len() != tools || most_points > MOST_POINTS
        {
            return Err(format!("{tools} tools: a session has at most {MOST_TOOLS}, and its state as many"));
        }
        let obstacles = settings.obstacles.len();
        let most = |obstacle: &Obstacle| obstacle.most_points(&body);
        let most_points = settings.obstacles.iter().map(most).fold(MOST_POINTS, usize::max);
        let touched = &start.obstacle_points;
        let fits = (touched.is_empty() || touched.len() == obstacles) && touched.iter().all(|p| p.len() <= most_points);
        if obstacles > MOST_OBSTACLES || !fits {
            return Err(format!(
                "{obstacles} obstacles: a session has at most {MOST_OBSTACLES}, and its state as many"
            ));
        }
        let fits = if start.parameters.is_empty() {
            start.stiffening == Stiffening::NONE
        } else {
            start.parameters.len() <= most_parameters(&body, &settings) && start.stiffening.fits(&body)
        };
        if !fits {
            return Err("the state's parameters are not those of this body and its tools".into());
        }
        let mesh = ActiveMesh::new(&body, &start.body, settings.most_elements)?;
        let vertices = body.surface().vertices.len();
        // Lists are swapped when contacts are found: all have the same room.
        let with_room = |count: usize, from: &[Vec<PointMemory>]| {
            let mut points: Vec<Vec<PointMemory>> = (0..count).map(|_| Vec::with_capacity(most_points)).collect();
            points.iter_mut().zip(from).for_each(|(to, from)| to.extend_from_slice(from));
            points
        };
        let (points, obstacle_points) = (with_room(tools, &start.points), with_room(obstacles, touched));
        let (patches, organs) = (body.patches(), body.organs());
        let is_of_body = |m: &Meeting| {
            let known = m.patch < patches.count() && m.other.index() < organs.len();
            known && organs[m.other.index()].triangles.contains(&m.triangle.index())
        };
        if start.meetings.len() > MOST_MEETINGS || !start.meetings.iter().all(is_of_body) {
            return Err("the state has organs meet that the body has not".into());
        }
        let mut meetings = Vec::with_capacity(MOST_MEETINGS);
        meetings.extend_from_slice(&start.meetings);
        let most_constraints = MOST_POINTS * tools + settings.obstacles.iter().map(most).sum::<usize>() + MOST_MEETINGS;
        let mut simulation = Self {
            given: Given::by(&settings),
            parameters: Vec::with_capacity(most_parameters(&body, &settings)),
            path: Simd::best(),
            tick: start.tick,
            frozen: start.frozen,
            moved: start.moved,
            moved_for: start.moved_for,
            prices: start.prices,
            entangled: start.entangled,
            tools: start.tools,
            points,
            obstacle_points,
            meetings,
            reference: ReferencePose::new(&body, &mesh),
            vertices: vec![Vec3::zeros(); vertices],
            constraints: Vec::with_capacity(most_constraints),
            points_of_action: Vec::with_capacity(most_constraints),
            feet: Vec::with_capacity(MOST_MEETINGS),
            focus: Vec::with_capacity(MOST_TOOLS * MOST_PARTS * LOOKS_AHEAD),
            met: Vec::with_capacity(MOST_MEETINGS),
            adaptation: adaptation::Workspace::new(&body, &settings.adaptivity.clone().unwrap_or_default()),
            stepping: step::Workspace::new(&mesh, most_constraints),
            detection: detection::Workspace::new(&body, &mesh, tools + obstacles, most_points),
            meeting: meeting::Workspace::new(&body),
            outputs: Outputs {
                tick: start.tick,
                tools: vec![ToolOutput::default(); tools],
                obstacles: vec![ObstacleOutput::default(); obstacles],
                frame: false,
                skin: body.surface().vertices.clone(),
                dents: vec![Dent::default(); outputs::most_dents(&settings)],
                levels: vec![0; vertices],
                hash: 0,
                plan: Plan::default(),
                element_evaluations: 0,
                active: [0; MOST_LEVELS],
                elements: 0,
                adapted: adaptation::Adapted::default(),
                extremes: Extremes::REST,
                restored: false,
            },
            start: start.body,
            mesh,
            body,
            settings,
        };
        if !simulation.settings.support_motions.is_empty() {
            let moving: Vec<_> =
                simulation.settings.support_motions.iter().map(|of| of.supports(&simulation.body)).collect();
            if let Some(still) = moving.iter().position(Vec::is_empty) {
                return Err(format!("motion {} of supports: there are none in its region", still + 1));
            }
            simulation.mesh.join_supports(&simulation.body, &moving);
            simulation.move_supports();
            simulation.mesh.follow_offsets(&simulation.body);
        }
        if !start.parameters.is_empty() {
            simulation.assume_all(&start.parameters, &start.stiffening);
            simulation.mesh.restore(&simulation.body, &simulation.start);
        }
        Ok(simulation)
    }

    /// What a reset returns to; the starting state unless set.
    pub fn reset_state(&self) -> &State {
        &self.start
    }

    /// Makes a reset return to `state`.
    ///
    /// # Errors
    /// When it is of another body.
    pub fn with_reset_state(mut self, state: &State) -> Result<Self, String> {
        let mesh = ActiveMesh::new(&self.body, state, self.settings.most_elements)?;
        self.reference = ReferencePose::new(&self.body, &mesh);
        self.start = state.clone();
        Ok(self)
    }

    /// Runs the kernel on `path` from now on; it must be available on this CPU. The results do not depend on it.
    pub fn with_path(mut self, path: Simd) -> Self {
        debug_assert!(Simd::available().contains(&path));
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

    /// Ticks since the start of the session.
    pub fn tick(&self) -> u64 {
        self.tick
    }

    /// What the last tick gave.
    pub fn outputs(&self) -> &Outputs {
        &self.outputs
    }

    /// The body as it moves.
    pub fn mesh(&self) -> &ActiveMesh {
        &self.mesh
    }

    /// Each tool, by id.
    pub fn tools(&self) -> &[ToolState] {
        &self.tools
    }

    /// Changes the body between ticks: for tests, studies and for settling a body before it is served.
    pub fn mesh_mut(&mut self) -> &mut ActiveMesh {
        self.detection.forget();
        self.detection.follow_change(&self.body, &self.mesh);
        &mut self.mesh
    }

    /// The surface that is touched, (n_vertices) [m]: as the mesh shows it, and what that leaves out of the dents under tools and obstacles.
    pub fn touched_surface(&self) -> Vec<Vec3> {
        let mut vertices = vec![Vec3::zeros(); self.vertices.len()];
        self.mesh.skin(&mut vertices);
        let dents: Vec<Dent> = self.detection.dents(&self.constraints).collect();
        deepen(&mut vertices, &self.body.surface().triangles, &dents);
        vertices
    }

    /// Where organs meet, or are about to.
    pub fn meetings(&self) -> &[Meeting] {
        &self.meetings
    }

    /// The body, where the tools touch it, standing still, and its display vertices [m]: for questions about a copy.
    pub fn contacts(&mut self) -> (&mut ActiveMesh, &[Constraint], &[Vec3]) {
        self.tools.iter_mut().for_each(ToolState::stand);
        self.find_contacts(Budget::UNLIMITED, &mut ());
        self.mesh.skin(&mut self.vertices);
        (&mut self.mesh, &self.constraints, &self.vertices)
    }

    /// One tick.
    pub fn advance(&mut self, inputs: &Inputs) -> &Outputs {
        self.advance_with(inputs, &mut ())
    }

    /// One tick, which tells `laps` what it does.
    pub fn advance_with(&mut self, inputs: &Inputs, laps: &mut dyn Laps) -> &Outputs {
        self.begin(inputs);
        self.move_tools(inputs);
        self.adapt(inputs.budget, laps);
        self.find_contacts(inputs.budget, laps);
        self.detection.end_tick();
        self.step(inputs.budget, laps);
        self.contain();
        self.render_forces();
        self.end_frame(laps);
        &self.outputs
    }

    fn begin(&mut self, inputs: &Inputs) {
        self.tick += 1 + u64::from(inputs.lapsed);
        self.moved_for += 1;
        self.outputs.tick = self.tick;
        self.outputs.restored = false;
        self.prices = inputs.prices.unwrap_or(self.prices);
        if inputs.reset {
            self.back_to_start();
        }
        if let Some(parameter) = inputs.parameter {
            self.set(parameter);
        }
        self.stiffen();
        if !self.settings.support_motions.is_empty() {
            self.move_supports();
            self.mesh.follow_offsets(&self.body);
        }
    }

    /// Supports are where their motion has them by now.
    fn move_supports(&mut self) {
        for (number, of) in self.settings.support_motions.iter().enumerate() {
            self.mesh.move_supports(number, of.motion.at(self.moved_for));
        }
    }

    fn back_to_start(&mut self) {
        self.moved_for = 0;
        self.move_supports();
        self.mesh.restore(&self.body, &self.start);
        self.mesh.reclass_stiffened(&self.body);
        self.detection.forget();
        (self.entangled, self.frozen) = (0, 0);
        self.points.iter_mut().chain(&mut self.obstacle_points).for_each(Vec::clear);
        self.meetings.clear();
        self.constraints.clear();
        self.feet.clear();
        // The shape jumps back under the tools: they have to come from outside again.
        for tool in &mut self.tools {
            if tool.touches() {
                tool.wait();
            }
        }
    }

    fn move_tools(&mut self, inputs: &Inputs) {
        for ((tool, of), event) in self.tools.iter_mut().zip(&self.settings.tools).zip(&inputs.tools) {
            tool.lapse(inputs.lapsed, &self.settings.following);
            let event = event.map(|event| of.pivot.map_or(event, |pivot| event.through(pivot)));
            tool.follow(event.as_ref(), &Mechanism::of(&of.shape), TICK, &self.settings.following);
        }
    }

    /// Refines and coarsens, and gives elements the steps that their strain asks for.
    fn adapt(&mut self, budget: Budget, laps: &mut dyn Laps) {
        let ticks = self.tick;
        self.outputs.adapted = adaptation::Adapted::default();
        if let Some(adaptivity) = &self.settings.adaptivity {
            self.focus.clear();
            for (tool, held) in self.tools.iter().zip(&self.settings.tools) {
                if tool.phase == Phase::Detached {
                    continue;
                }
                let velocity = (tool.pose.position - tool.previous.position) / TICK;
                for k in 0..LOOKS_AHEAD {
                    let way = velocity * (k as Real * LOOK_AHEAD);
                    for part in held.shape.parts() {
                        let ((start, along, radius), carrier) = (part.outline(), tool.stance().of_part(part));
                        let from = carrier.position + way + carrier.rotate(start);
                        let to = from + carrier.rotate(along);
                        self.focus.push(Focus { from, to, radius });
                    }
                }
            }
            self.met.clear();
            let presses = self.meetings.iter().filter(|m| m.multiplier > 0.0);
            self.met.extend(presses.map(|m| Focus::of_meeting(&self.body, &self.mesh, m)));
            let (contact, points) = self.contact_time(0);
            let near = !self.focus.is_empty();
            let loads = Loads {
                points: &self.points,
                obstacle_points: &self.obstacle_points,
                meetings: &self.meetings,
                gravity: self.settings.gravity,
            };
            let tools = self.points.iter().flatten().map(|p| p.point);
            let class = self.mesh.contact_class(&self.body, tools, loads.hard_points(&self.body));
            let allowance = Allowance {
                budget,
                prices: &self.prices,
                contact,
                points,
                class,
                expected: if near { self.contact_time(adaptation::EXPECTED_CONTACTS).0 } else { 0 },
                frame: ticks.is_multiple_of(TICKS_PER_FRAME / 2),
                moves: self.frozen >= MOST_FROZEN,
            };
            laps.lap(Part::Fixed, 0);
            let wishes = Request { adaptivity, focus: &self.focus, met: &self.met, allowance, loads, ticks };
            self.outputs.adapted = adaptation::adapt(&self.body, &mut self.mesh, &wishes, &mut self.adaptation, laps);
            let adapted = &self.outputs.adapted;
            if adapted.splits + adapted.merges > 0 {
                self.detection.follow_change(&self.body, &self.mesh);
                laps.lap(Part::Change, 0);
            }
        }
        laps.lap(Part::Fixed, 0);
        self.mesh.step_alike(&self.body, self.meetings.iter().flat_map(|m| m.points(&self.body)));
        laps.lap(Part::PatchPoint, 0);
        self.mesh.reclass_part(&self.body, ticks % RECLASS_TICKS, RECLASS_TICKS);
        laps.lap(Part::Fixed, 0);
    }

    /// Time that the tick may take [ns].
    fn most_of(&self, budget: Budget) -> u32 {
        // What a change of resolution takes is less well known than the rest.
        if self.outputs.adapted.work > 0 { budget.change } else { budget.limit }
    }

    /// Time that the tick takes beside motion and contacts [ns], if it ends a `frame`.
    fn beside_motion(&self, frame: bool) -> u32 {
        let rest = work::of_rest(&self.prices, frame);
        let looked = self.prices.of(Part::Look, self.outputs.adapted.looked);
        rest.saturating_add(looked).saturating_add(self.outputs.adapted.work)
    }

    fn step(&mut self, budget: Budget, laps: &mut dyn Laps) {
        let of_tools = self.points.iter().map(Vec::len).sum::<usize>().min(self.constraints.len());
        let (tools, hard) = self.constraints.split_at(of_tools);
        let (tools, hard) = (tools.iter().map(|c| c.point), hard.iter().map(|c| c.point));
        let other_sides = self.meetings.iter().filter(|m| m.held).map(|m| m.triangle.0);
        let contact = self.mesh.contact_class(&self.body, tools, hard.chain(other_sides));
        let solves = (self.constraints.len() as u32) << contact;
        let motion = work::of_motion(&self.body, &self.mesh, &self.prices, solves);
        let needed = motion.saturating_add(self.contact_time(0).0);
        let frame = self.tick.is_multiple_of(TICKS_PER_FRAME);
        let whole = needed.saturating_add(self.beside_motion(frame));
        // A body that never fits moves all the same, now and then.
        let moves = whole <= self.most_of(budget) || self.frozen >= MOST_FROZEN;
        self.frozen = if moves { 0 } else { self.frozen + 1 };
        // A tick that stands still has found its contacts all the same.
        let (taken, left_out) = if moves { (needed, 0) } else { (0, motion) };
        self.outputs.plan = Plan { needed, taken, whole: whole - left_out };
        laps.lap(Part::Fixed, 0);
        self.outputs.element_evaluations = 0;
        if moves {
            self.outputs.element_evaluations = work::evaluations(&self.mesh);
            let looks = self.looks_for_meetings();
            if looks {
                self.mesh.note_places();
            }
            let world = World { path: self.path, body: &self.body, gravity: self.settings.gravity };
            let pushing = Pushing { constraints: &mut self.constraints, feet: &self.feet, class: contact };
            self.outputs.extremes = step::tick(&world, &mut self.mesh, pushing, &mut self.stepping, laps);
            self.moved = if looks { self.mesh.most_moved() } else { Real::INFINITY };
            self.mesh.decay_residuals();
            laps.lap(Part::Fixed, 0);
            self.mesh.reclass_over_limit(&self.body);
            laps.lap(Part::Fixed, 0);
        }
        self.mesh.decay_geomorph();
        self.mesh.follow_offsets(&self.body);
    }

    /// Our last line: a state that is not finite, or that the body would stay in for ever, is replaced by the one a reset
    /// returns to, and the hand feels nothing.
    fn contain(&mut self) {
        if self.mesh.is_finite() && self.entangled < ENTANGLED_FRAMES {
            return;
        }
        self.outputs.restored = true;
        self.back_to_start();
        for tool in &mut self.tools {
            tool.force.fill(0.0);
            tool.torque.fill(0.0);
            tool.jaws.torque = 0.0;
        }
    }

    fn render_forces(&mut self) {
        let stood_still = self.outputs.plan.taken < self.outputs.plan.needed;
        let (mut constraints, per_part) = (self.constraints.as_slice(), self.body.points_of_a_part());
        for (i, (tool, points)) in self.tools.iter_mut().zip(&mut self.points).enumerate() {
            let own;
            (own, constraints) = constraints.split_at(points.len().min(constraints.len()));
            let (middle, shape) = (tool.middle().pose, &self.settings.tools[i].shape);
            let (mut physical, mut contact_points) =
                wrench::wrench_on(ToolId::at(i), &middle, &self.constraints, &self.points_of_action);
            if stood_still && tool.touches() {
                // No step, no new force: the last one stands.
                physical = tool.physical();
                contact_points = own.iter().filter(|c| c.multiplier > 0.0).count() as u32;
            }
            let solved_at = tool.stance();
            tool.update_proxy(&Mechanism::of(shape), &physical);
            // What the solver found is where the next tick starts.
            let solved = Solved { constraints: own, at: solved_at, shape: Some(shape), per_part, moved: !stood_still };
            friction::remember(&self.mesh, &solved, tool, points);
            let limited = safety::render(tool, &physical, &self.settings.limits, TICK);
            self.outputs.tools[i] = ToolOutput { state: *tool, contact_points, limited };
        }
        for (i, (of, points)) in self.settings.obstacles.iter().zip(&mut self.obstacle_points).enumerate() {
            let own;
            (own, constraints) = constraints.split_at(points.len().min(constraints.len()));
            let (id, state) = (ToolId::at(self.tools.len() + i), of.state_at(self.moved_for, points));
            let output = &mut self.outputs.obstacles[i];
            output.position = state.pose.position;
            if !stood_still {
                let middle = state.middle().pose;
                (output.wrench, _) = wrench::wrench_on(id, &middle, &self.constraints, &self.points_of_action);
            }
            let shape = match &of.shape {
                Form::Ground => None,
                Form::Parts(shape) => Some(shape),
            };
            let solved = Solved { constraints: own, at: state.stance(), shape, per_part, moved: !stood_still };
            friction::remember(&self.mesh, &solved, &state, points);
        }
        if !stood_still {
            meeting::remember(&self.mesh, constraints, &mut self.meetings);
        }
    }

    fn end_frame(&mut self, laps: &mut dyn Laps) {
        laps.lap(Part::Fixed, 0);
        let frame = self.tick.is_multiple_of(TICKS_PER_FRAME);
        self.outputs.frame = frame;
        self.outputs.elements = self.mesh.pool().len() as u32;
        for (to, from) in self.outputs.active.iter_mut().zip(self.mesh.set().count()) {
            *to = *from;
        }
        if frame {
            self.mesh.skin(&mut self.outputs.skin);
            self.outputs.dents.fill(Dent::default());
            let dents = self.detection.dents(&self.constraints);
            self.outputs.dents.iter_mut().zip(dents).for_each(|(to, dent)| *to = dent);
            self.mesh.display_levels(&self.body, &mut self.outputs.levels);
        }
        self.count_knotted();
        if frame {
            self.outputs.hash = self.hash();
            laps.lap(Part::Frame, 1);
        }
    }

    fn count_knotted(&mut self) {
        // Where the body stood still there is no news of it.
        if self.outputs.plan.taken != self.outputs.plan.needed {
            return;
        }
        // What lies on the ground is not on its way out of it.
        let is_pushed = |c: &Constraint| c.tool.index() < self.tools.len() && c.multiplier > 0.0;
        if self.constraints.iter().any(is_pushed) {
            self.entangled = 0;
        } else if self.outputs.frame {
            let entangled = self.reference.is_entangled(self.outputs.extremes.det_f, &self.outputs.skin);
            self.entangled = if entangled { self.entangled + 1 } else { 0 };
        }
    }
}

/// Places along a tool's way that are refined for it, [`LOOK_AHEAD`] apart.
const LOOKS_AHEAD: usize = 3;
/// [s].
const LOOK_AHEAD: Real = 0.025;
/// A full look at which elements may take longer steps again takes this many ticks; those that need shorter ones are
/// found by their evaluation.
const RECLASS_TICKS: u64 = 64;
