//! Where a tool meets the display surface: point constraints, once per tick.
//!
//! Balls and capsules touch by samples (`samples.rs`). For cylinders and hulls a constraint stands at each display vertex near one
//! and at each near triangle's point nearest to its core, so that nothing slips between vertices. Normals run from the core to
//! the point, at the tool's place in the middle of the tick.

use super::areas::{share_areas, thin_out};
use super::candidate::{ALIKE, Candidate, Sheet, Touch, follow_sunk, near_triangles, near_vertices, sunk_depth};
use super::closing::{Before, Closing, UNNOTICED};
use super::hanging::{Hanging, Load};
use super::nearby::Nearby;
use super::patch::{Density, MOST_SAMPLES, Round};
use super::posed::{Posed, posed};
use super::rigid::{Found, Rigid};
use super::samples::{Hold, Samples};
use super::shape::MOST_PARTS;
use super::tool::MOST_POINTS;
use super::touchable::{FASTEST_SURFACE, MARGIN, Touchable};
use super::wrench::middle_pose;
use crate::ids::{Triangle, Vertex};
use crate::math::{Real, Vec3};
use crate::model::constraint::{Constraint, PointMemory, Pushed};
use crate::model::step_class::TICK;
use crate::model::{ActiveMesh, Body, Friction};
use crate::visited::Visited;

/// Memory that detection needs and no one keeps.
#[derive(Debug)]
pub struct Workspace {
    candidates: Vec<Candidate>,
    loads: Vec<Load>,
    /// Around each tool.
    nearby: Vec<Nearby>,
    /// Display vertices [m], (n_vertices); those far from the tool at hand as of some earlier tick.
    vertices: Vec<Vec3>,
    pub(super) memory: Vec<PointMemory>,
    /// Display vertices around the tool.
    near: Vec<Vertex>,
    /// Display triangles that have been looked at.
    seen: Visited,
    /// By which balls and capsules touch.
    samples: Samples,
    /// By which points hang on nodes.
    hanging: Hanging,
    /// Part of the way to what it stands for now that a point's area goes in a tick.
    followed: Real,
    /// No display edge is longer at rest [m].
    longest_edge: Real,
    /// Whether the resolution has changed since the last tick.
    changed: bool,
}

/// Stretch of display edges up to which no triangle near a tool is missed.
const MOST_STRETCH: Real = 2.0;

impl Workspace {
    /// For the surface of `body`, all of which may come near one of `tools` tools and obstacles at once, with at most `points`
    /// contact points each.
    pub fn new(body: &Body, mesh: &ActiveMesh, tools: usize, points: usize) -> Self {
        // Some triangles have a point for each of several parts.
        let most = body.surface().vertices.len() + 2 * body.surface().triangles.len();
        let surface = body.surface();
        let edge = |t: &[u32; 3], i: usize| {
            (surface.vertices[t[i] as usize] - surface.vertices[t[(i + 1) % 3] as usize]).norm()
        };
        let longest = surface.triangles.iter().flat_map(|t| (0..3).map(move |i| edge(t, i))).fold(0.0, Real::max);
        Self {
            candidates: Vec::with_capacity(most),
            loads: Vec::with_capacity(MOST_POINTS),
            nearby: (0..tools).map(|_| Nearby::new(body, mesh)).collect(),
            vertices: surface.vertices.clone(),
            memory: Vec::with_capacity(points),
            near: Vec::with_capacity(surface.vertices.len()),
            seen: Visited::new(surface.triangles.len()),
            samples: Samples::new(),
            hanging: Hanging::new(body),
            followed: TAKEN_FOLLOWED,
            longest_edge: longest,
            changed: false,
        }
    }
}

impl Workspace {
    /// What is where may have changed at once.
    pub(crate) fn forget(&mut self) {
        self.hanging.around.forget();
        self.nearby.iter_mut().for_each(Nearby::forget);
    }

    /// The resolution is another in this tick than in the last one.
    pub(crate) fn follow_change(&mut self, body: &Body, mesh: &ActiveMesh) {
        self.changed = true;
        self.hanging.around.forget();
        self.nearby.iter_mut().for_each(|nearby| nearby.follow_change(body, mesh));
    }

    /// And is not.
    pub(crate) fn end_tick(&mut self) {
        self.changed = false;
    }

    /// For questions about a copy: areas as they will be once the tool rests.
    pub(crate) fn settle(&mut self) {
        self.followed = 1.0;
    }
}

/// Appends the constraints of the `rigid` tool or obstacle on the body at the start of a tick to `out`; `memory` holds its points of the
/// last tick and receives this tick's: those of cylinders and hulls, ascending, then those of balls and capsules, part by part. No more
/// than `room` of them are new, but for the first that it touches.
pub fn detect(
    body: &Body,
    mesh: &ActiveMesh,
    rigid: Rigid,
    memory: &mut Vec<PointMemory>,
    out: Found,
    room: u32,
    work: &mut Workspace,
) {
    let Rigid { id, shape, friction, state: tool, horizon } = rigid;
    let Found { constraints, points_of_action } = out;
    let candidates = &mut work.candidates;
    candidates.clear();
    let per_part = body.points_of_a_part();
    let middle = middle_pose(tool);
    let ((all, parts), (start, _), (end, _)) =
        (posed(&middle, shape), posed(&tool.previous, shape), posed(&tool.pose, shape));
    let all = &all[..parts];
    let way = |i: usize| if i < parts { start[i].frame.farthest_move(&end[i].frame, all[i].part) } else { 0.0 };
    let ways: [Real; MOST_PARTS] = std::array::from_fn(way);
    let margin = ways[..parts].iter().map(|way| way + FASTEST_SURFACE * TICK).fold(MARGIN, Real::max);
    let is_of_solid = |m: &PointMemory| all.get((m.point / per_part) as usize).is_some_and(Posed::is_solid);
    let (pointed, sampled) = memory.split_at(memory.iter().position(|m| !is_of_solid(m)).unwrap_or(memory.len()));
    let deep = sunk_depth(body, mesh, all, pointed);
    let noticeable = LEAST_NOTICEABLE + NOTICEABLE * tool.physical_force.norm();
    let touch = Touch { parts: all, ways, noticeable, margin, deep, per_part, memory: pointed };
    // Whatever touches the tool has all its vertices within an edge's length of the box of one of its parts.
    work.near.clear();
    let windows = touch.windows(MOST_STRETCH * work.longest_edge);
    let window = windows[..parts].iter().fold(windows[0], |a, b| a.joined(b));
    for &v in work.nearby[id.index()].place(body, mesh, window, &mut work.vertices) {
        if windows[..parts].iter().any(|w| w.contains(&work.vertices[v.index()])) {
            work.near.push(v);
        }
    }
    let near = work.nearby[id.index()].placed();
    let on = &Touchable { body, mesh, vertices: &work.vertices, near };
    // The pose is where the coupling's springs are as long as the last force and torque made them.
    let allowed_for = Pushed { force: -tool.physical_force, torque: -tool.physical_torque };
    work.memory.clear();

    let solids = all.iter().filter(|at| at.is_solid()).count();
    // Each part has its share of the points.
    let most = MOST_POINTS - MOST_POINTS * solids / parts;
    let density = Density::of(parts - solids, most);
    let round = |part: usize| {
        let (part, at) = (part.min(parts - 1), &all[part.min(parts - 1)]);
        Round { at, part, all, moves: [&start[part].frame, &end[part].frame], margin, density }
    };
    let rounds: [Round; MOST_PARTS] = std::array::from_fn(round);
    let (samples, nodes) = (&mut work.samples, &mut work.hanging.around);
    samples.begin(most, if memory.is_empty() { FIRST.max(room as usize) } else { room as usize });
    let before = Before { memory: sampled, changed: work.changed };
    let is_round = |round: &&Round| !round.at.is_solid();
    rounds[..parts].iter().filter(is_round).for_each(|round| samples.follow(on, round, before, nodes));
    for round in rounds[..parts].iter().filter(is_round) {
        work.seen.clear();
        let window = &windows[round.part];
        let near = work.near.iter().filter(|v| window.contains(&work.vertices[v.index()]));
        let (seen, around) = (&mut work.seen, near.flat_map(|v| body.triangles_around(*v)));
        let around = around.copied().filter(|t| seen.visit(t.index()));
        samples.find_new(on, round, before, nodes, around);
    }

    work.seen.clear();
    if solids > 0 {
        near_vertices(on, &touch, &work.near, candidates);
        near_triangles(on, &touch, &work.near, &mut work.seen, candidates);
        follow_sunk(margin, candidates);
        candidates.sort_unstable_by_key(|c| c.point);
        share_areas(on, all, candidates);
        let most = (MOST_POINTS - samples.count()).min(pointed.len().saturating_add(samples.room()));
        thin_out(on, candidates, pointed, most);
        recall(on, candidates, pointed, per_part, parts as u32);
    }
    work.loads.clear();
    work.loads.extend(candidates.iter().map(|c| Load::new(on, c, pointed, work.followed)));
    let hanging = &mut work.hanging;
    hanging.hang(on, candidates, &mut work.loads, Before { memory: pointed, changed: work.changed });
    let first = constraints.len() as u32;
    for (i, candidate) in candidates.iter().enumerate() {
        let (n, core) = (candidate.normal, candidate.core);
        let [start, end] = [&start, &end].map(|posed| posed[candidate.part as usize].frame.at(core));
        // That of the part's rounding, but for what stands for others, too.
        let radius = n.dot(&(candidate.place - all[candidate.part as usize].frame.at(core))) - candidate.gap;
        let known = candidate.known.map(|k| &pointed[k as usize]);
        let load = work.loads[i];
        let points = work.loads.len();
        let mut compliance = [0.0; MOST_POINTS];
        // Filled in once for both.
        let before = constraints[first as usize..].iter().map(|other| other.compliance[i]);
        compliance.iter_mut().zip(before).for_each(|(g, before)| *g = before);
        (i..points).for_each(|j| compliance[j] = hanging.between(i, j));
        (0..samples.count()).for_each(|j| compliance[points + j] = samples.between_point(hanging.load(i), j));
        let moved = n.dot(&(end - start));
        let own: Real = compliance.iter().zip(&work.loads).map(|(g, other)| g * other.multiplier).sum();
        let of_samples: Real = (0..samples.count()).map(|j| compliance[points + j] * samples.multiplier(j)).sum();
        let shown = own + of_samples;
        let overlap = n.dot(&start) + radius - n.dot(&load.touched) - shown;
        // Other nodes show other parts of the dents: nothing is to be felt of that at once, be it more or less.
        let shift = known.map_or(0.0, |m| m.shift) - load.receded;
        // Where a point leaves its area to a corner, that leaves it no force.
        let share = candidate.share;
        // What comes out of a solid core at another side than it was pushed to is let go of bit by bit.
        let escaped = |_: &PointMemory| {
            let rises = n.dot(&load.row.interpolate(&mesh.motion.velocity)) * TICK;
            (overlap - share * shift + UNNOTICED + moved.abs() + rises.abs()).min(0.0)
        };
        let shift = shift + known.filter(|m| m.multiplier > 0.0).map_or(0.0, escaped);
        let overlap = overlap - share * shift;
        let Closing { slack, slack_end, shift_end } = Closing::new(known, overlap, shift, moved);
        let same = |m: &&PointMemory| m.point % per_part == candidate.point % per_part;
        let (anchor, tangential) = match known.filter(|_| friction > 0.0).filter(same) {
            Some(m) => {
                // Another place of the triangle is the nearest now: the anchor goes along by as much.
                let now = candidate.place - candidate.at(on, m.weights);
                let back = m.tangential - n * n.dot(&m.tangential);
                (tool.previous.to_own(tool.previous.to_world(m.anchor) + now), back)
            }
            None => (tool.previous.to_own(load.touched), Vec3::zeros()),
        };
        let anchored = (tool.previous.to_world(anchor), tool.pose.to_world(anchor));
        constraints.push(Constraint {
            row: load.row,
            normal: n,
            offset: n.dot(&(start - load.geomorph)) + radius - slack - share * shift,
            rate: (moved + slack - slack_end + share * (shift - shift_end)) / TICK,
            first,
            compliance,
            tool: id,
            point: candidate.point,
            multiplier: load.multiplier,
            mean_multiplier: 0.0,
            friction: Friction {
                coefficient: friction,
                compliance: (2.0 - load.nu) / (2.0 * (1.0 - load.nu)),
                anchor: anchored.0 - load.geomorph,
                rate: (anchored.1 - anchored.0) / TICK,
                multiplier: tangential,
                mean_multiplier: Vec3::zeros(),
            },
            arm: load.touched - middle.position,
            coupling: tool.coupling,
            allowed_for,
            horizon,
        });
        // The surface's own point, not the tool's: that is where the body gets the force.
        points_of_action.push(load.touched);
        work.memory.push(PointMemory {
            point: candidate.point,
            // What the solve changes is written back after it.
            multiplier: 0.0,
            slack: slack_end,
            shift: shift_end,
            dent: 0.0,
            taken: load.taken,
            normal: n,
            tangential,
            anchor,
            weights: candidate.stencil.map(|s| s.1),
            place: Vec3::zeros(),
            shown: hanging.load(i).shown,
        });
    }
    let hold = Hold { rigid, rounds: &rounds[..parts], allowed_for, first: first as usize };
    let out = Found { constraints, points_of_action };
    samples.constrain(on, &hold, sampled, out, &mut work.memory);
    std::mem::swap(memory, &mut work.memory);
}

/// Finds what is remembered of each candidate. A point that has gone from one part of a tool to the next keeps its force
/// and its anchor; a tip that has sunk below one triangle and slid below the next takes them along.
fn recall(on: &Touchable, candidates: &mut [Candidate], memory: &[PointMemory], per_part: u32, parts: u32) {
    let index = |point: u32| memory.binary_search_by_key(&point, |m| m.point).ok();
    for i in 0..candidates.len() {
        let (own, normal) = (candidates[i].point, candidates[i].normal);
        let left = |point: &u32| candidates.binary_search_by_key(point, |c| c.point).is_err();
        let others = (0..parts).map(|part| own % per_part + part * per_part).filter(|point| *point != own);
        let alike = |k: &usize| memory[*k].normal.dot(&normal) > ALIKE;
        let known = index(own).or_else(|| others.filter(left).filter_map(index).find(alike));
        candidates[i].known = known.map(|k| k as u32);
    }
    let vertices = on.vertices.len() as u32;
    for i in 0..candidates.len() {
        let c = candidates[i];
        if c.sheet != Sheet::Sunk || c.known.is_some() {
            continue;
        }
        let meets = |point: u32| match (point % per_part).checked_sub(vertices) {
            None => c.stencil().iter().any(|s| s.0.0 == point % per_part),
            Some(t) => c.stencil().iter().any(|s| on.body.triangle(Triangle(t)).contains(&s.0)),
        };
        let left = |k: &usize| {
            let (point, taken) = (memory[*k].point, Some(*k as u32));
            point / per_part == c.part
                && meets(point)
                && candidates.iter().all(|o| o.point != point && o.known != taken)
        };
        let alike = |k: &usize| memory[*k].normal.dot(&c.normal) > ALIKE;
        let force = |k: &usize| memory[*k].multiplier;
        let known = (0..memory.len()).filter(left).filter(alike).max_by(|a, b| force(a).total_cmp(&force(b)));
        candidates[i].known = known.map(|k| k as u32);
    }
}

/// Change of a tool's force [N] that is not felt of one point of a solid core that turns: at least, and over the force.
const LEAST_NOTICEABLE: Real = 2e-3;
const NOTICEABLE: Real = 0.01;

/// Points that a tool may touch with at first, however little time there is: a patch.
const FIRST: usize = MOST_SAMPLES;

/// [`Workspace::followed`] of a tick.
const TAKEN_FOLLOWED: Real = 0.05;
