//! Where balls and capsules touch the surface, as samples on it: a patch of them in each direction in which one pushes, as wide as
//! what it touches there ([`super::patch`]).
//!
//! The samples follow the tool and not the displayed triangles: they neither come nor go while the tool slides, and each touches the
//! surface wherever that is straight ahead of it. The surface is the one of the mesh, through rows of nodes around each place
//! ([`crate::model::active_mesh::contact_row`]), plus what the mesh leaves out of the samples' own loads ([`super::influence`]).

use super::closing::{Before, Closing, UNNOTICED};
use super::influence::{Grid, Narrow, variance_of_disc};
use super::patch::{COLUMNS, Cell, Foot, MOST_PATCHES, Patch, Pressed, ROWS, Round};
use super::rigid::{Found, Rigid};
use super::touchable::{Touchable, area_vector};
use super::view::{LEAST_FACING, View, part_before};
use super::wrench::middle_pose;
use crate::ids::{Triangle, Vertex};
use crate::math::{Real, Vec3};
use crate::model::active_mesh::contact_row::{self, DEVIATION, Surroundings, support};
use crate::model::constraint::{Constraint, Friction, MOST_POINTS, PointMemory, Pushed};
use crate::model::step_class::TICK;
use crate::model::{Material, Row};
use std::f64::consts::PI;

/// What samples need and no one keeps.
#[derive(Debug)]
pub(super) struct Samples {
    faces: Vec<Face>,
    /// Of all faces, one after the other.
    found: Vec<Sample>,
    /// Samples that the tool may have, ...
    most: usize,
    /// ... and how many of them may be new ones.
    room: usize,
}

/// A part of the surface that faces the tool, and where the tool touches it.
#[derive(Clone, Copy, Debug)]
struct Face {
    /// Number of the tool's part.
    part: usize,
    /// Number of its first sample.
    first: usize,
    view: View,
    patch: Patch,
    /// How far from the patch's line the surface of the mesh may overlap the tool [m].
    reach: Real,
    /// What the mesh leaves out of loads on the cells of a strip.
    grid: Option<Grid<COLUMNS, ROWS>>,
    /// Where the resolution has changed since the last tick, the variance with which the mesh showed the loads then [m²], and what of them
    /// it left out.
    was: Option<(Real, Option<Grid<COLUMNS, ROWS>>)>,
    /// Poisson's ratio.
    nu: Real,
}

/// A place of the tool and what is ahead of it.
#[derive(Clone, Copy, Debug)]
struct Sample {
    face: u32,
    load: Narrow,
    /// Coordinates of the place of the tool's core that is nearest.
    core: Vec3,
    /// Area that it stands for [m²]; none where the surface ends.
    area: Real,
    /// How much farther from the surface the tool is on the mean over that than in its middle [m].
    rounded: Real,
    /// The triangle that is ahead of it, or the last one before the surface ends there.
    triangle: Triangle,
    /// Barycentric weights there.
    weights: [Real; 3],
    /// Where that is displayed [m], ...
    displayed: Vec3,
    /// ... and where the row is.
    place: Vec3,
    row: Row,
    /// What is remembered of it.
    known: Option<u32>,
    /// How far a change of resolution has moved what was touched in the last tick [m].
    moved: Vec3,
    /// Last multiplier [N].
    multiplier: Real,
}

/// Where the surface is about to be touched: a triangle, how it is looked at, and how it was pushed.
#[derive(Clone, Copy, Debug)]
struct Ahead {
    triangle: Triangle,
    view: View,
    pressed: Pressed,
    /// What is remembered of its first sample.
    known: Option<u32>,
}

impl Samples {
    pub(super) fn new() -> Self {
        Self { faces: Vec::with_capacity(MOST_PATCHES), found: Vec::with_capacity(MOST_POINTS), most: 0, room: 0 }
    }

    /// Begins with a tool that may have at most so many samples, and this many new ones.
    pub(super) fn begin(&mut self, most: usize, room: usize) {
        self.found.clear();
        self.faces.clear();
        (self.most, self.room) = (most, room);
    }

    /// How many have been found.
    pub(super) fn count(&self) -> usize {
        self.found.len()
    }

    /// How many more new points there may be.
    pub(super) fn room(&self) -> usize {
        self.room
    }

    /// Finds the samples of a part of a tool on the faces that it touched a tick ago, of which `before` holds the points.
    pub(super) fn follow(&mut self, on: &Touchable, round: &Round, before: Before, nodes: &mut Surroundings) {
        let per_part = on.body.points_of_a_part();
        let of_part = |from: usize| before.memory.partition_point(|m| ((m.point / per_part) as usize) < from);
        let (first, end) = (of_part(round.part), of_part(round.part + 1));
        for (i, known) in before.memory[first..end].chunks_exact(round.samples()).enumerate() {
            // One beside others that does nothing is not looked for again.
            let idle = known.iter().all(|m| m.multiplier <= 0.0 && m.slack <= 0.0);
            if idle && self.own(round).next().is_some() {
                continue;
            }
            if let Some(ahead) = still_ahead(on, round, known, (first + i * round.samples()) as u32) {
                let foot = round.front(&ahead.view, [ahead.pressed.middle, 0.0]);
                let is_covered =
                    |face: &Face| foot.is_some_and(|f| face.covers(f.arm, f.normal, face.patch.half_width));
                if !self.own(round).any(is_covered) {
                    self.look(on, round, before, nodes, &ahead);
                }
            }
        }
    }

    /// And on a new one where it overlaps the surface beside those, as long as there is room. `near` are the triangles that it may touch.
    pub(super) fn find_new(
        &mut self,
        on: &Touchable,
        round: &Round,
        before: Before,
        nodes: &mut Surroundings,
        near: impl Iterator<Item = Triangle>,
    ) {
        if self.found.len() + round.samples() > self.most || round.samples() > self.room {
            return;
        }
        if let Some(ahead) = self.new_ahead(on, round, near) {
            self.room -= round.samples();
            self.look(on, round, before, nodes, &ahead);
        }
    }

    /// Faces of a part.
    fn own<'a>(&'a self, round: &Round) -> impl Iterator<Item = &'a Face> {
        let part = round.part;
        self.faces.iter().filter(move |face| face.part == part)
    }

    /// Where the tool touches the surface next beside the faces that there are: at first what is nearest.
    fn new_ahead(&self, on: &Touchable, round: &Round, near: impl Iterator<Item = Triangle>) -> Option<Ahead> {
        let (radius, start) = (round.radius(), round.start());
        let is_first = self.own(round).next().is_none();
        let mut nearest = (if is_first { round.margin } else { -UNNOTICED }, None);
        // What is farther away is not nearest.
        let window = round.at.window(radius + if is_first { round.margin } else { 0.0 });
        for t in near {
            let corners = on.body.triangle(t).map(|v| on.vertices[v.index()]);
            if window.is_apart(&corners) {
                continue;
            }
            let outward = area_vector(on, t);
            let (place, core) = round.at.nearest_in_triangle(&corners, -outward);
            let from = core.map_or(start, |core| round.at.frame.at(core));
            let away = place - from;
            let mut gap = away.norm() - radius;
            let Some(normal) = away.try_normalize(1e-12) else { continue };
            let is_covered = |face: &Face| face.covers(place - start, normal, face.reach);
            if outward.dot(&away) >= 0.0 || gap >= nearest.0 || self.own(round).any(is_covered) {
                continue;
            }
            if !is_first {
                gap += self.dent(place, normal);
            }
            if gap < nearest.0 {
                nearest = (gap, Some((t, normal, place - start)));
            }
        }
        let (triangle, normal, place) = nearest.1?;
        let view = View::new(normal, round.axis());
        Some(Ahead { triangle, view, pressed: Pressed::not(view.across[0].dot(&place)), known: None })
    }

    /// What the mesh leaves out of the dent of all samples [m] at `place` [m], along `normal`.
    fn dent(&self, place: Vec3, normal: Vec3) -> Real {
        let pushing = self.found.iter().filter(|sample| sample.multiplier > 0.0);
        pushing.map(|sample| sample.load.at(place, normal) * sample.multiplier).sum()
    }

    /// Adds a face, and its samples, where something is `ahead`.
    fn look(&mut self, on: &Touchable, round: &Round, before: Before, nodes: &mut Surroundings, ahead: &Ahead) {
        let memory = before.memory;
        let Ahead { triangle, view, pressed, known } = *ahead;
        let (radius, start, first) = (round.radius(), round.start(), self.found.len());
        let end = view.walk(on, triangle, start + view.across[0] * pressed.middle);
        let (under, weights) = (end.triangle, end.weights);
        let corners = on.body.triangle(under);
        let material = on.mesh.material_at(on.body, corners[0]);
        let nu = material.poisson_ratio();
        let patch = |k: Real| Patch::of(round, &view, k, &pressed);
        // Large strain makes it wider, and softens what gives way as under a ball.
        let firm = patch(material.half_space());
        let as_ball = 2.0 * firm.half_width / (2.0 * firm.half_width + firm.straight());
        let softening = as_ball * Material::softening(nu, firm.half_width / radius);
        let compliance = material.half_space() * (1.0 + softening);
        let mut patch = patch(compliance);
        let ends = known.into_iter().flat_map(|k| memory[k as usize..].iter().take(round.samples()).enumerate());
        let mut ends = ends.filter(|(i, _)| round.is_outermost(*i));
        patch.grows = !round.is_ball() && (pressed.force <= 0.0 || ends.any(|(_, m)| m.multiplier > 0.0));
        let (number, mut triangle) = (self.faces.len() as u32, under);
        for i in 0..round.samples() {
            let Cell { at, area, spread, starts_row } = patch.cell(round, i);
            let foot = round.front(&view, at);
            let arm = foot.map_or(view.across[0] * at[0] + view.across[1] * at[1], |foot| foot.arm);
            let from = if starts_row { under } else { triangle };
            let end = view.walk(on, from, start + arm);
            triangle = end.triangle;
            let normal = foot.map_or(view.ahead, |foot| foot.normal);
            let slope = normal.dot(&view.ahead);
            // What another patch has samples of already is not touched twice.
            let is_taken = |foot: &Foot| self.own(round).any(|f| f.covers(foot.arm, foot.normal, f.patch.half_width));
            let whole = |foot: Foot| area * round.part_touchable(&foot, (area / PI).sqrt()) / slope;
            let area = foot.filter(|foot| !is_taken(foot)).map_or(0.0, whole);
            let width = (area / PI).sqrt();
            let beyond = match end.beyond {
                found if found > 0.0 || width == 0.0 => found,
                _ => view.margin(on, end.triangle, start + arm, width),
            };
            let part = if width > 0.0 { part_before(beyond / width) } else { 0.0 };
            let area = if part > LEAST_PART { part * area } else { 0.0 };
            let curved = spread[1] + foot.map_or(0.0, |foot| foot.curved_along(spread[0]));
            let known = known.map(|k| k + i as u32);
            let corners = on.body.triangle(end.triangle).map(|v| on.vertex(v));
            self.found.push(Sample {
                face: number,
                load: Narrow { place: start + arm, normal, variance: variance_of_disc(area), shown: 0.0, compliance },
                core: foot.map_or(Vec3::zeros(), |foot| foot.core),
                area,
                rounded: part * curved / (2.0 * radius * slope),
                triangle: end.triangle,
                weights: end.weights,
                displayed: corners.iter().zip(end.weights).map(|(c, w)| c * w).sum(),
                place: start + arm,
                row: Row::EMPTY,
                known,
                moved: Vec3::zeros(),
                multiplier: known.map_or(0.0, |k| memory[k as usize].multiplier),
            });
        }
        let spacing = spacing(on, under, weights);
        let cap = patch.half_width + 0.5 * patch.straight();
        self.hang(on, first, before, nodes, (support(on.body) * spacing).min(cap));
        let shown = shown_variance(on, corners[0], spacing);
        self.found[first..].iter_mut().for_each(|sample| sample.load.shown = shown);
        // Of the mesh, which does not show the dent, the tool overlaps more than its patch: the most where the mesh is dented the least.
        let along = |v: Vec3| view.ahead.dot(&v);
        let depth = |sample: &Sample| {
            let [from, to] = round.moves.map(|frame| frame.at(sample.core));
            along(sample.displayed - round.at.frame.at(sample.core)) - along(to - from).abs()
        };
        let depth = self.found[first..][round.on_line()].iter().map(depth).fold(radius, Real::min);
        let reach = patch.half_width.max((radius * radius - depth.max(0.0).powi(2)).sqrt());
        let grid = |shown| (!round.is_ball()).then(|| Grid::new(round.columns(), patch.sides(round.columns()), shown));
        let before_change = known.filter(|_| before.changed).map_or(&[][..], |k| &memory[k as usize..]);
        // Those beside the tool have touched nothing.
        let was = before_change.iter().take(round.samples()).map(|m| m.shown).find(|was| *was > 0.0);
        let was = was.filter(|was| *was != shown);
        let (grid, was) = (grid(shown), was.map(|was| (was, grid(was))));
        self.faces.push(Face { part: round.part, first, view, patch, reach, grid, was, nu });
    }

    /// Gives the samples from the `first` on their rows, on nodes that are gathered for all within `near` [m] of one of them at once: a
    /// long strip is near more nodes than can be gathered.
    fn hang(&mut self, on: &Touchable, first: usize, before: Before, nodes: &mut Surroundings, near: Real) {
        let (support, near) = (support(on.body), REACH * near);
        let mut origin: Option<Vec3> = None;
        for sample in self.found[first..].iter_mut().filter(|sample| sample.area > 0.0) {
            let at = at_rest(on, sample.triangle, sample.weights);
            let own = support * spacing(on, sample.triangle, sample.weights);
            if origin.is_none_or(|origin| (at - origin).norm() > near) {
                let corner = on.body.triangle(sample.triangle)[0];
                nodes.gather(on.body, on.mesh, corner, at, near + REACH * own);
                origin = Some(at);
            }
            match nodes.row(at, own) {
                Some(row) => {
                    sample.row = row;
                    sample.place = row.interpolate(&on.mesh.motion.position);
                }
                None => (sample.area, sample.load.variance) = (0.0, 0.0),
            }
            let known = sample.known.filter(|_| before.changed).map(|k| &before.memory[k as usize]);
            let pushed = known.filter(|m| m.multiplier > 0.0);
            if let Some((m, touched)) = pushed.and_then(|m| Some((m, touched_triangle(on, m)?))) {
                let own = support * spacing(on, touched, m.weights);
                let row = nodes.row(at_rest(on, touched, m.weights), own);
                sample.moved = row.map_or(Vec3::zeros(), |row| row.interpolate(&on.mesh.motion.position) - m.place);
            }
        }
    }

    /// What a newton on one sample adds at the other to the dent that the mesh leaves out [m/N].
    fn between(&self, i: usize, j: usize) -> Real {
        let (a, b) = (&self.found[i], &self.found[j]);
        let face = &self.faces[a.face as usize];
        match face.grid.as_ref().filter(|_| a.face == b.face) {
            Some(grid) => between_cells(grid, [(i - face.first, a), (j - face.first, b)]),
            None => a.load.between(&b.load),
        }
    }

    /// The same of a point of the display.
    pub(super) fn between_point(&self, point: &Narrow, i: usize) -> Real {
        point.between(&self.found[i].load)
    }

    /// Last force on a sample [N].
    pub(super) fn multiplier(&self, i: usize) -> Real {
        self.found[i].multiplier
    }

    /// By how much a change of resolution has made what the mesh leaves out of the last loads of sample `i`'s face deeper there [m].
    fn deepened(&self, samples: usize, i: usize) -> Real {
        let sample = &self.found[i];
        let face = &self.faces[sample.face as usize];
        let (Some((was, grid)), first) = (&face.was, face.first) else { return 0.0 };
        let from = |j: usize| {
            let other = &self.found[j];
            let before = match grid {
                Some(grid) => between_cells(grid, [(i - first, sample), (j - first, other)]),
                None => sample.load.shown_as(*was).between(&other.load.shown_as(*was)),
            };
            (self.between(i, j) - before) * other.multiplier
        };
        (first..first + samples).map(from).sum()
    }
}

/// As [`Narrow::between`], of cells of one strip.
fn between_cells(grid: &Grid<COLUMNS, ROWS>, [(i, a), (j, b)]: [(usize, &Sample); 2]) -> Real {
    if a.area <= 0.0 || b.area <= 0.0 {
        return 0.0;
    }
    let facing = a.load.normal.dot(&b.load.normal).max(0.0);
    0.5 * (a.load.compliance + b.load.compliance) * grid.between(i, j) * facing
}

/// A place of a triangle with these barycentric weights, as a combination of display vertices.
fn stencil(on: &Touchable, t: Triangle, weights: [Real; 3]) -> [(Vertex, Real); 3] {
    let corners = on.body.triangle(t);
    std::array::from_fn(|i| (corners[i], weights[i]))
}

/// Spacing of the nodes under that [m].
fn spacing(on: &Touchable, t: Triangle, weights: [Real; 3]) -> Real {
    contact_row::spacing(on.mesh, stencil(on, t, weights))
}

/// Where that is at rest [m].
fn at_rest(on: &Touchable, t: Triangle, weights: [Real; 3]) -> Vec3 {
    contact_row::at_rest(on.body, stencil(on, t, weights))
}

/// The triangle that a sample touched.
fn touched_triangle(on: &Touchable, m: &PointMemory) -> Option<Triangle> {
    (m.point % on.body.points_of_a_part()).checked_sub(on.vertices.len() as u32).map(Triangle)
}

/// Where a face of the last tick is now, whose points are `known` and begin at number `first`: about the direction in which it was pushed.
fn still_ahead(on: &Touchable, round: &Round, known: &[PointMemory], first: u32) -> Option<Ahead> {
    let push: Vec3 = known.iter().map(|m| m.normal * m.multiplier).sum();
    let (middle, load) = (known.get(round.middle())?, push.norm());
    let triangle = touched_triangle(on, middle)?;
    // Half of the way, as the patch's width goes: the direction and the force are each the other's answer, too.
    let half_way = |push: Vec3| (push + middle.normal).try_normalize(1e-6).unwrap_or(push);
    let ahead = if load > 0.0 { half_way(push / load) } else { middle.normal };
    // A surface that it sees from the edge tells nothing of where it touches: it goes on looking as before, or straight at it.
    let inward = (-area_vector(on, triangle)).try_normalize(0.0).unwrap_or(ahead);
    let ahead = [ahead, middle.normal].into_iter().find(|d| d.dot(&inward) > LEAST_FACING).unwrap_or(inward);
    let view = View::new(ahead, first_axis(round, known, ahead));
    let [along, start] = [view.across[0], round.start()];
    // Where on the tool it was: the tool has moved since, about as far as within this tick.
    let [from, to] = round.moves.map(|frame| frame.at(Vec3::zeros()));
    let place = |m: &PointMemory| along.dot(&(displayed(on, m) - start + (to - from)));
    if load <= 0.0 {
        // It has let go, unless the mesh alone would swallow the tool.
        let foot = displayed(on, middle);
        let shadow = along.dot(&round.axis());
        let part = if shadow > 0.0 { (place(middle) / shadow).clamp(0.0, 1.0) } else { 0.0 };
        if ahead.dot(&(foot - start - round.axis() * part)) > 0.0 {
            return None;
        }
        let pressed = Pressed::not(if round.is_ball() { 0.0 } else { place(middle) });
        return Some(Ahead { triangle, view, pressed, known: Some(first) });
    }
    let half_width = Some(Patch::half_width_of(round, &view, |i| known.get(i).map_or(ahead, |m| m.normal)));
    if round.is_ball() {
        let pressed = Pressed { force: load, middle: 0.0, along: 0.0, half_width };
        return Some(Ahead { triangle, view, pressed, known: Some(first) });
    }
    let all: Real = known.iter().map(|m| m.multiplier).sum();
    let mean = |of: &dyn Fn(&PointMemory) -> Real| known.iter().map(|m| m.multiplier * of(m)).sum::<Real>() / all;
    let middle = mean(&place);
    // Each lies on a cell as long as the samples are apart.
    let cell = (place(known.get(round.columns() - 1)?) - place(&known[0])) / (round.columns() - 1) as Real;
    let along = mean(&|m| (place(m) - middle).powi(2)) + cell * cell / 12.0;
    let pressed = Pressed { force: load, middle, along, half_width };
    Some(Ahead { triangle, view, pressed, known: Some(first) })
}

/// Which way the first axis of a view along `ahead` goes whose samples of the last tick are `known`: a rod's own, as far as that is seen from
/// aside. From ahead it could be any: it stays as it was.
fn first_axis(round: &Round, known: &[PointMemory], ahead: Vec3) -> Vec3 {
    if round.is_ball() {
        return known.get(1).map_or(ahead, |m| m.normal);
    }
    let axis = round.axis().normalize();
    let aside = axis - ahead * ahead.dot(&axis);
    let part = (aside.norm_squared() / (LEAST_FACING * LEAST_FACING)).min(1.0);
    let line = round.on_line();
    let turns = known[line.end - 1].normal - known[line.start].normal;
    match (turns.try_normalize(1e-6), aside.try_normalize(1e-6)) {
        (Some(before), Some(now)) if part < 1.0 => before + (now - before) * part,
        (Some(before), None) => before,
        _ => axis,
    }
}

impl Face {
    /// True for a place [m] from the start of the tool's axis that is within `reach` [m] of the patch's line, ahead or, where the tool's
    /// `normal` there says so, beside.
    fn covers(&self, place: Vec3, normal: Vec3, reach: Real) -> bool {
        self.view.ahead.dot(&normal) > -0.5 && self.patch.covers(self.view.across.map(|u| u.dot(&place)), reach)
    }
}

/// Variance of a load as the mesh shows it [m²], `under` which nodes are of this `spacing` [m]: that of the rows, less what the
/// lattice's short waves are too soft by. Their stiffness is `C k² (1 + c a²k²)`, `c = −.167 + .145 α` for the part α that strain jumps keep, from the
/// symbol of the infinite body-centred lattice; it does not depend on Poisson's ratio.
pub(super) fn shown_variance(on: &Touchable, under: Vertex, spacing: Real) -> Real {
    let deviation = DEVIATION * support(on.body);
    let node = on.mesh.node(on.mesh.embedding(under).slots[0]);
    (deviation * deviation - (0.167 - 0.145 * on.body.stabilisation(node))) * spacing * spacing
}

/// What stays the same for all samples of a tool.
#[derive(Clone, Copy, Debug)]
pub(super) struct Hold<'a> {
    pub(super) rigid: Rigid<'a>,
    /// Its parts.
    pub(super) rounds: &'a [Round<'a>],
    pub(super) allowed_for: Pushed,
    /// Number of its first constraint.
    pub(super) first: usize,
}

impl Samples {
    /// Appends the constraints of the samples that were found to `out`, and what is to be remembered of them to `memory`.
    pub(super) fn constrain(
        &self,
        on: &Touchable,
        hold: &Hold,
        known: &[PointMemory],
        out: Found,
        memory: &mut Vec<PointMemory>,
    ) {
        let Rigid { id, friction, state: tool, horizon, .. } = hold.rigid;
        let first = hold.first;
        let points = out.constraints.len() - first;
        for (i, sample) in self.found.iter().enumerate() {
            let face = &self.faces[sample.face as usize];
            let round = &hold.rounds[face.part];
            let radius = round.radius();
            let n = sample.load.normal;
            let [start, end] = round.moves.map(|frame| frame.at(sample.core));
            let known = sample.known.map(|k| &known[k as usize]);
            let mut compliance = [0.0; MOST_POINTS];
            let before = &out.constraints[first..];
            // Filled in once for both.
            for (j, g) in compliance[..points + self.found.len()].iter_mut().enumerate() {
                *g = match before.get(j) {
                    Some(other) => other.compliance[points + i],
                    None => self.between(i, j - points),
                };
            }
            // The mesh shows the place above the tool's own. A ball is pushed through its middle all the same, and feels no moment.
            let met_at = if round.is_ball() { sample.load.place } else { sample.place };
            let nu = face.nu;
            let point = face.part as u32 * on.body.points_of_a_part() + on.vertices.len() as u32 + sample.triangle.0;
            let moved = n.dot(&(end - start));
            let mut constraint = Constraint {
                row: sample.row,
                normal: n,
                // It touches nothing where the surface ends.
                offset: Real::NEG_INFINITY,
                rate: 0.0,
                first: first as u32,
                compliance,
                tool: id,
                point,
                multiplier: 0.0,
                mean_multiplier: 0.0,
                friction: Friction {
                    coefficient: 0.0,
                    compliance: (2.0 - nu) / (2.0 * (1.0 - nu)),
                    anchor: start,
                    rate: (end - start) / TICK,
                    multiplier: Vec3::zeros(),
                    mean_multiplier: Vec3::zeros(),
                },
                arm: met_at - middle_pose(tool).position,
                coupling: tool.coupling,
                allowed_for: hold.allowed_for,
                horizon,
            };
            let mut remembered = PointMemory { point, normal: n, weights: sample.weights, ..PointMemory::default() };
            if sample.area > 0.0 {
                let of_points: Real =
                    compliance.iter().zip(&before[..points]).map(|(g, other)| g * other.multiplier).sum();
                let own = compliance[points..].iter().zip(&self.found);
                let dent = own.map(|(g, other)| g * other.multiplier).sum::<Real>() + of_points;
                // The mean over its area of where the tool is.
                let flat = radius - sample.rounded;
                let place = sample.place;
                let overlap = n.dot(&(start - place)) - dent + flat;
                // Other nodes show other parts of the dents: nothing is to be felt of that at once.
                let changed = n.dot(&sample.moved) + self.deepened(round.samples(), i);
                let shift = known.map_or(0.0, |m| m.shift) - changed;
                let Closing { slack, slack_end, shift_end } = Closing::new(known, overlap - shift, shift, moved);
                constraint.offset = n.dot(&start) + flat - slack - shift;
                constraint.rate = (moved + slack - slack_end + shift - shift_end) / TICK;
                constraint.multiplier = sample.multiplier;
                (remembered.slack, remembered.shift) = (slack_end, shift_end);
                remembered.shown = sample.load.shown;
                if friction > 0.0 {
                    constraint.friction.coefficient = friction;
                    let stuck = known.filter(|m| m.multiplier > 0.0);
                    let tangential = stuck.map_or(Vec3::zeros(), |m| m.tangential - n * n.dot(&m.tangential));
                    let anchor = match stuck {
                        // The samples have moved over the surface: the anchor goes along by as much.
                        Some(m) => tool.previous.to_world(m.anchor) + sample.displayed - displayed(on, m),
                        None => place,
                    };
                    let own = tool.previous.to_own(anchor);
                    constraint.friction.anchor = anchor;
                    constraint.friction.rate = (tool.pose.to_world(own) - anchor) / TICK;
                    constraint.friction.multiplier = tangential;
                    (remembered.anchor, remembered.tangential) = (own, tangential);
                }
            }
            out.constraints.push(constraint);
            out.points_of_action.push(sample.place);
            memory.push(remembered);
        }
    }
}

/// Where the place of the surface is now that a sample touched [m].
fn displayed(on: &Touchable, m: &PointMemory) -> Vec3 {
    let corners = on.body.corners_of_point(m.point).map(|v| on.vertex(v));
    corners.iter().zip(m.weights).map(|(c, w)| c * w).sum()
}

/// Over its size at rest, how far the surface is drawn out under a tool.
const REACH: Real = 1.3;
/// Part of a sample's disc on the surface below which it touches nothing.
const LEAST_PART: Real = 0.02;
