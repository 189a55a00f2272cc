//! Where a tool meets the display surface: point constraints, once per tick, at samples on it (`samples.rs`).

use super::closing::Before;
use super::density::{Density, MOST_SAMPLES};
use super::dent::Dent;
use super::moving_part::MovingPart;
use super::nearby::Nearby;
use super::posed::posed;
use super::rigid::{Found, Rigid};
use super::samples::{Hold, Samples};
use super::shape::MOST_PARTS;
use super::tool::{MOST_POINTS, Wrench};
use super::touchable::{FASTEST_SURFACE, MARGIN, Touchable};
use crate::math::{Bounds, Real, Vec3};
use crate::model::active_mesh::contact_row::Surroundings;
use crate::model::constraint::{Constraint, PointMemory, Pushed};
use crate::model::step_class::TICK;
use crate::model::{ActiveMesh, Body};

/// Memory that detection needs and no one keeps.
#[derive(Debug)]
pub struct Workspace {
    /// Around each tool.
    nearby: Vec<Nearby>,
    /// Display vertices [m], (n_vertices); those far from the tool at hand as of some earlier tick.
    vertices: Vec<Vec3>,
    pub(super) memory: Vec<PointMemory>,
    /// By which parts touch.
    samples: Samples,
    /// What those add to what the mesh displays, of all that touches the body.
    dents: Vec<Dent>,
    /// Nodes, for all that touches the body.
    nodes: Surroundings,
    /// No display edge is longer at rest [m].
    longest_edge: Real,
    /// Whether the resolution has changed since the last tick.
    changed: bool,
}

/// Stretch of display edges up to which no triangle near a tool is missed.
pub(super) const MOST_STRETCH: Real = 2.0;

impl Workspace {
    /// For the surface of `body`, all of which may come near one of `tools` tools and obstacles at once, with at most `points`
    /// contact points each.
    pub fn new(body: &Body, mesh: &ActiveMesh, tools: usize, points: usize) -> Self {
        Self {
            nearby: (0..tools).map(|_| Nearby::new(body, mesh)).collect(),
            vertices: body.surface().vertices.clone(),
            memory: Vec::with_capacity(points),
            samples: Samples::new(),
            dents: Vec::with_capacity(tools * MOST_POINTS),
            nodes: Surroundings::new(body),
            longest_edge: body.surface().longest_edge(),
            changed: false,
        }
    }
}

impl Workspace {
    /// What is where may have changed at once.
    pub(crate) fn forget(&mut self) {
        self.dents.clear();
        self.nodes.forget();
        self.nearby.iter_mut().for_each(Nearby::forget);
    }

    /// The resolution is another in this tick than in the last one.
    pub(crate) fn follow_change(&mut self, body: &Body, mesh: &ActiveMesh) {
        self.changed = true;
        self.nodes.forget();
        self.nearby.iter_mut().for_each(|nearby| nearby.follow_change(body, mesh));
    }

    /// What touches the body is looked for anew.
    pub(crate) fn begin(&mut self) {
        self.dents.clear();
    }

    /// What the samples that were found add to what the mesh displays, now that their `constraints` are solved.
    pub(crate) fn dents<'a>(&'a self, constraints: &'a [Constraint]) -> impl Iterator<Item = Dent> + 'a {
        self.dents.iter().map(|dent| dent.solved(constraints))
    }

    /// And is not.
    pub(crate) fn end_tick(&mut self) {
        self.changed = false;
    }
}

/// Appends the constraints of the `rigid` tool or obstacle on the body at the start of a tick to `out`; `memory` holds its points of the
/// last tick and receives this tick's, part by part. No more than `room` of them are new, but for the first that it touches.
pub fn detect(
    body: &Body,
    mesh: &ActiveMesh,
    rigid: Rigid,
    memory: &mut Vec<PointMemory>,
    out: Found,
    room: u32,
    work: &mut Workspace,
) {
    let Rigid { id, shape, state: tool, .. } = rigid;
    let Found { constraints, points_of_action } = out;
    let ((all, parts), (start, _), (end, _)) =
        (posed(&tool.middle(), shape), posed(&tool.previous_stance(), shape), posed(&tool.stance(), shape));
    let all = &all[..parts];
    let way = |i: usize| start[i].frame.farthest_move(&end[i].frame, all[i].part);
    let margin = (0..parts).map(|i| way(i) + FASTEST_SURFACE * TICK).fold(MARGIN, Real::max);
    // Whatever touches the tool has all its vertices within an edge's length of the box of one of its parts.
    let more = margin + MOST_STRETCH * work.longest_edge;
    let windows = all.iter().map(|at| at.window(at.part.radius() + more));
    let window = windows.reduce(|a, b| a.joined(&b)).unwrap_or(Bounds::NOTHING);
    work.nearby[id.index()].place(body, mesh, window, &mut work.vertices);
    let nearby = &work.nearby[id.index()];
    let on = &Touchable { body, mesh, vertices: &work.vertices, near: nearby.placed() };
    let density = Density::of(shape.parts(), MOST_POINTS);
    let moving = |number: usize| {
        let number = number.min(parts - 1);
        MovingPart { at: &all[number], number, all, moves: [&start[number], &end[number]], margin, density }
    };
    let moving: [MovingPart; MOST_PARTS] = std::array::from_fn(moving);
    let moving = &moving[..parts];
    let (samples, nodes) = (&mut work.samples, &mut work.nodes);
    samples.begin(if memory.is_empty() { FIRST.max(room as usize) } else { room as usize });
    let before = Before { memory, changed: work.changed };
    samples.follow(on, moving, before, nodes);
    for part in moving {
        samples.find_new(on, part, before, nodes, nearby.triangles());
    }
    work.memory.clear();
    // The pose is where the coupling's springs are as long as the last force and torque made them.
    let Wrench { force, torque, grip } = tool.physical();
    let allowed_for = Pushed { force: -force, torque: -torque, grip: -grip };
    let hold = Hold { rigid, parts: moving, allowed_for, first: constraints.len() };
    let out = Found { constraints, points_of_action };
    samples.constrain(on, &hold, memory, out, &mut work.memory);
    work.dents.extend(samples.dents(moving, hold.first));
    std::mem::swap(memory, &mut work.memory);
}

/// Points that a tool may touch with at first, however little time there is: a patch.
const FIRST: usize = MOST_SAMPLES;
