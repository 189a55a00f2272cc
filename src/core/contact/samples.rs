//! Where the parts of a tool touch the surface, as samples on it: a patch of them in each direction in which one pushes, as wide as
//! what it touches there ([`super::patch`]).
//!
//! The samples follow the tool and not the displayed triangles: they neither come nor go while the tool slides, and each touches the
//! surface wherever that is straight ahead of it. The surface is the one of the mesh, through rows of nodes around each place
//! ([`crate::model::active_mesh::contact_row`]), plus what the mesh leaves out of the samples' own loads ([`super::influence`]).

use super::ahead::{Ahead, overlapped, still_ahead};
use super::closing::{Before, Closing, UNNOTICED};
use super::density::{COLUMNS, MOST_PATCHES, MOST_SAMPLES, ROWS};
use super::dent::Dent;
use super::influence::{Grid, Narrow, variance_of_disc};
use super::jaws::Mechanism;
use super::moving_part::{MovingPart, Silhouette};
use super::patch::{Patch, Pressed};
use super::rigid::{Found, Rigid};
use super::touchable::{Touchable, area_vector};
use super::view::{LEAST_FACING, View, part_before};
use crate::ids::{Triangle, Vertex};
use crate::math::{Real, Vec3};
use crate::model::Row;
use crate::model::active_mesh::contact_row::{self, DEVIATION, Surroundings, support};
use crate::model::constraint::{Constraint, Friction, Held, MOST_POINTS, PointMemory, Pushed};
use crate::model::step_class::TICK;
use std::f64::consts::PI;

/// What samples need and no one keeps.
#[derive(Debug)]
pub(super) struct Samples {
    faces: Vec<Face>,
    /// Of all faces, one after the other.
    found: Vec<Sample>,
    /// How many of them may be new ones yet.
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
    /// How far from the patch's line the surface of the mesh may overlap a round part [m], ...
    reach: Real,
    /// ... and how far ahead of the start of a solid one the surface under it is at least [m].
    level: Real,
    /// What the mesh leaves out of loads on the cells of a strip or of a rectangle.
    grid: Option<Grid<COLUMNS, ROWS>>,
    /// Where the resolution has changed since the last tick, the variance with which the mesh showed the loads then [m²], and what of them
    /// it left out.
    was: Option<(Real, Option<Grid<COLUMNS, ROWS>>)>,
    /// Poisson's ratio.
    nu: Real,
    /// Variance with which the mesh displays the loads [m²].
    displayed: Real,
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

/// A place of the surface near the tool.
#[derive(Clone, Copy, Debug)]
struct Met {
    /// From the part's start [m].
    arm: Vec3,
    /// Out of the part.
    normal: Vec3,
    /// Out of the tool and into the body, straight.
    inward: Vec3,
    /// How far away the part is along the normal [m].
    gap: Real,
    /// Whether it is inside of a solid core: then the normal and the gap are those of what is straight ahead.
    is_inside: bool,
}

impl Samples {
    pub(super) fn new() -> Self {
        Self { faces: Vec::with_capacity(MOST_PATCHES), found: Vec::with_capacity(MOST_POINTS), room: 0 }
    }

    /// Begins with a tool that may have so many new samples.
    pub(super) fn begin(&mut self, room: usize) {
        self.found.clear();
        self.faces.clear();
        self.room = room;
    }

    /// Finds the samples of a tool of these `parts` on the faces that they touched a tick ago, of which `before` holds the points, face by
    /// face.
    pub(super) fn follow(&mut self, on: &Touchable, parts: &[MovingPart], before: Before, nodes: &mut Surroundings) {
        let per_part = on.body.points_of_a_part();
        let mut first = 0;
        while let Some(m) = before.memory.get(first) {
            let Some(part) = parts.get((m.point / per_part) as usize) else { return };
            let Some(known) = before.memory.get(first..first + part.samples()) else { return };
            // One beside others that does nothing is not looked for again.
            let idle = known.iter().all(|m| m.multiplier <= 0.0 && m.slack <= 0.0) && self.own(part).next().is_some();
            let ahead = if idle { None } else { still_ahead(on, part, known, first as u32) };
            if let Some(ahead) = ahead {
                let foot = part.front(&ahead.view, ahead.pressed.middle);
                if !self.own(part).any(|face| foot.is_some_and(|foot| face.has(foot.arm, foot.normal))) {
                    self.look(on, part, before, nodes, &ahead);
                }
            }
            first += part.samples();
        }
    }

    /// And on a new one where it overlaps the surface beside those, as long as there is room. `near` are the triangles that it may touch.
    pub(super) fn find_new(
        &mut self,
        on: &Touchable,
        part: &MovingPart,
        before: Before,
        nodes: &mut Surroundings,
        near: &[Triangle],
    ) {
        if self.found.len() + part.samples() > MOST_POINTS || part.samples() > self.room {
            return;
        }
        if let Some(ahead) = self.new_ahead(on, part, near) {
            self.room -= part.samples();
            self.look(on, part, before, nodes, &ahead);
        }
    }

    /// Faces of a part.
    fn own<'a>(&'a self, part: &MovingPart) -> impl Iterator<Item = &'a Face> {
        let number = part.number;
        self.faces.iter().filter(move |face| face.part == number)
    }

    /// Where the tool touches the surface next beside the faces that there are: at first what is nearest.
    fn new_ahead(&self, on: &Touchable, part: &MovingPart, near: &[Triangle]) -> Option<Ahead> {
        let (radius, start) = (part.radius(), part.start());
        let is_first = self.own(part).next().is_none();
        let mut nearest = (if is_first { part.margin } else { -UNNOTICED }, None);
        // What is farther away is not nearest.
        let window = part.at.window(radius + if is_first { part.margin } else { 0.0 });
        for &t in near {
            let corners = on.body.triangle(t).map(|v| on.vertices[v.index()]);
            if window.is_apart(&corners) {
                continue;
            }
            // Nor what is farther than that.
            if part.at.is_apart(&corners, (radius + nearest.0).max(0.0)) {
                continue;
            }
            let outward = area_vector(on, t);
            let Some(inward) = (-outward).try_normalize(0.0) else { continue };
            if self.own(part).any(|face| part.is_solid() && face.has_all(part, &corners, inward)) {
                continue;
            }
            let (place, core) = part.at.nearest_in_triangle(&corners, inward);
            let from = part.at.frame.at(core.unwrap_or_else(|| part.at.nearest(place)));
            let away = place - from;
            let mut gap = away.norm() - radius;
            let (normal, is_inside) = match away.try_normalize(1e-12) {
                Some(normal) => (normal, false),
                // Inside of a solid core it is pushed out straight ahead, unless it is the part's side that is there.
                None => {
                    let Some((out, normal)) = part.way_out(place, inward) else { continue };
                    gap = -out;
                    (normal, true)
                }
            };
            let met = Met { arm: place - start, normal, inward, gap, is_inside };
            // Beside a solid part, what is seen from the edge is pushed aside by what is under it.
            let least = if is_first || !part.is_solid() { 0.0 } else { LEAST_FACING };
            if inward.dot(&normal) <= least || gap >= nearest.0 || self.own(part).any(|face| face.covers(part, &met)) {
                continue;
            }
            if !is_first {
                gap += DENTED * self.dent(place, normal);
            }
            if gap < nearest.0 {
                nearest = (gap, Some((t, if is_inside { inward } else { normal }, place - start)));
            }
        }
        let (triangle, normal, place) = nearest.1?;
        let view = if part.is_solid() {
            View::of_solid(normal, part.longest_across(normal))
        } else {
            View::new(normal, part.axis())
        };
        let pressed = Pressed::not(if part.is_solid() {
            view.across.map(|u| u.dot(&place))
        } else {
            [view.across[0].dot(&place), 0.0]
        });
        Some(Ahead { triangle, view, pressed, known: None })
    }

    /// What the mesh leaves out of the dent of all samples [m] at `place` [m], along `normal`.
    fn dent(&self, place: Vec3, normal: Vec3) -> Real {
        let pushing = self.found.iter().filter(|sample| sample.multiplier > 0.0);
        pushing.map(|sample| sample.load.at(place, normal) * sample.multiplier).sum()
    }

    /// Adds a face, and its samples, where something is `ahead`.
    fn look(&mut self, on: &Touchable, part: &MovingPart, before: Before, nodes: &mut Surroundings, ahead: &Ahead) {
        let memory = before.memory;
        let Ahead { triangle, view, pressed, known } = *ahead;
        let (radius, start, first) = (part.radius(), part.start(), self.found.len());
        let middle = view.across[0] * pressed.middle[0] + view.across[1] * pressed.middle[1];
        let end = view.walk(on, triangle, start + middle);
        let (under, weights) = (end.triangle, end.weights);
        let corners = on.body.triangle(under);
        let material = on.mesh.material_at(on.body, corners[0]);
        let (nu, half_space) = (material.poisson_ratio(), material.half_space(&on.body.rest_normal(corners[0])));
        let outline = part.solid().map(|solid| Silhouette::of(part, solid, &view));
        let known_samples = || known.into_iter().flat_map(|k| memory[k as usize..].iter().take(part.samples()));
        let (patch, compliance) = match &outline {
            Some(outline) => {
                let patch = match pressed.edges {
                    Some(edges) => Patch::of_solid(part, outline, &pressed, edges),
                    None => overlapped(on, part, &view, outline, under),
                };
                (patch, half_space)
            }
            None => {
                let patch = |k: Real| Patch::of(part, &view, k, &pressed);
                // Large strain makes it wider, and softens what gives way as under a ball.
                let firm = patch(half_space);
                let as_ball = 2.0 * firm.half_width / (2.0 * firm.half_width + firm.straight()[0]);
                let softening = as_ball * material.softening(firm.half_width / radius);
                let compliance = half_space * (1.0 + softening);
                let mut ends = known_samples().enumerate().filter(|(i, _)| part.is_outermost(*i));
                let grows = !part.is_ball() && (pressed.force <= 0.0 || ends.any(|(_, m)| m.multiplier > 0.0));
                (Patch { grows, ..patch(compliance) }, compliance)
            }
        };
        let (number, mut triangle) = (self.faces.len() as u32, under);
        for i in 0..part.samples() {
            let spot = patch.spot(part, &view, outline.as_ref(), i);
            let from = if spot.starts_row { under } else { triangle };
            let end = view.walk(on, from, start + spot.arm);
            triangle = end.triangle;
            // What another patch has samples of already is not touched twice.
            let is_taken = self.own(part).any(|face| face.has(spot.arm, spot.normal));
            let area = if is_taken { 0.0 } else { spot.area };
            let width = (area / PI).sqrt();
            let beyond = match end.beyond {
                found if found > 0.0 || width == 0.0 => found,
                _ => view.margin(on, end.triangle, start + spot.arm, width),
            };
            let share = if width > 0.0 { part_before(beyond / width) } else { 0.0 };
            let area = if share > LEAST_PART { share * area } else { 0.0 };
            let known = known.map(|k| k + i as u32);
            self.found.push(Sample {
                face: number,
                load: Narrow {
                    place: start + spot.arm,
                    normal: spot.normal,
                    variance: variance_of_disc(area),
                    shown: 0.0,
                    compliance,
                },
                core: spot.core,
                area,
                rounded: share * spot.rounded,
                triangle: end.triangle,
                weights: end.weights,
                displayed: on.displayed(end.triangle, end.weights),
                place: start + spot.arm,
                row: Row::EMPTY,
                known,
                moved: Vec3::zeros(),
                multiplier: known.map_or(0.0, |k| memory[k as usize].multiplier),
            });
        }
        let spacing = spacing(on, under, weights);
        let [long, wide] = patch.straight();
        let cap = patch.half_width + 0.5 * (long * long + wide * wide).sqrt();
        self.hang(on, first, before, nodes, (support(on.body) * spacing).min(cap));
        let shown = shown_variance(on, stencil(on, under, weights), spacing);
        self.found[first..].iter_mut().for_each(|sample| sample.load.shown = shown);
        let displayed = displayed_variance(on, shown, spacing);
        // Of the mesh, which does not show the dent, the tool overlaps more than its patch: the most where the mesh is dented the least.
        let along = |v: Vec3| view.ahead.dot(&v);
        let depth = |sample: &Sample| {
            let [from, to] = part.moves.map(|moved| moved.frame.at(sample.core));
            along(sample.displayed - part.at.frame.at(sample.core)) - along(to - from).abs()
        };
        let foremost = &self.found[first..][part.on_line()];
        let least = foremost.iter().map(depth).fold(radius, Real::min);
        let reach = patch.half_width.max((radius * radius - least.max(0.0).powi(2)).sqrt());
        let touched = foremost.iter().filter(|sample| sample.area > 0.0);
        let level = |sample: &Sample| depth(sample) + along(part.at.frame.at(sample.core) - start);
        let level = touched.map(level).fold(Real::INFINITY, Real::min);
        let grid = |shown| part.cells().map(|cells| Grid::new(cells, patch.sides(cells), shown));
        // Those beside the tool have touched nothing.
        let was = known_samples().filter(|_| before.changed).map(|m| m.shown).find(|was| *was > 0.0);
        let was = was.filter(|was| *was != shown);
        let (grid, was) = (grid(shown), was.map(|was| (was, grid(was))));
        self.faces.push(Face { part: part.number, first, view, patch, reach, level, grid, was, nu, displayed });
    }

    /// Gives the samples from the `first` on their rows, on nodes that are gathered for all within `near` [m] of one of them at once: a
    /// long face is near more nodes than can be gathered.
    fn hang(&mut self, on: &Touchable, first: usize, before: Before, nodes: &mut Surroundings, near: Real) {
        let (support, near) = (support(on.body), REACH * near);
        let mut origins = [None; MOST_SAMPLES];
        for sample in self.found[first..].iter_mut().filter(|sample| sample.area > 0.0) {
            let at = at_rest(on, sample.triangle, sample.weights);
            let own = support * spacing(on, sample.triangle, sample.weights);
            let is_near =
                |origin: &Option<(Vec3, Vertex)>| origin.is_none_or(|(origin, _)| (at - origin).norm() <= near);
            let Some(origin) = origins.iter_mut().find(|origin| is_near(origin)) else { continue };
            let (origin, corner) = *origin.get_or_insert((at, on.body.triangle(sample.triangle)[0]));
            nodes.gather(on.body, on.mesh, corner, origin, near + REACH * own);
            match nodes.row(at, own) {
                Some(row) => {
                    sample.row = row;
                    sample.place = row.interpolate(&on.mesh.motion.position);
                }
                None => (sample.area, sample.load.variance) = (0.0, 0.0),
            }
            let known = sample.known.filter(|_| before.changed).map(|k| &before.memory[k as usize]);
            if let Some(m) = known.filter(|m| m.multiplier > 0.0) {
                let touched = on.body.triangle_of_point(m.point);
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

/// As [`Narrow::between`], of cells of one strip or rectangle.
fn between_cells(grid: &Grid<COLUMNS, ROWS>, [(i, a), (j, b)]: [(usize, &Sample); 2]) -> Real {
    if a.area <= 0.0 || b.area <= 0.0 {
        return 0.0;
    }
    let facing = a.load.normal.dot(&b.load.normal).max(0.0);
    // What is only partly on the tool or on the surface gives way more under the same force.
    let own = if i == j { grid.more_of_its_own(a.load.variance) } else { 0.0 };
    0.5 * (a.load.compliance + b.load.compliance) * (grid.between(i, j) + own) * facing
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

impl Face {
    /// True for a place of the part, `arm` from its start [m], on its patch, ahead or, where the part's `normal` there says so, beside.
    fn has(&self, arm: Vec3, normal: Vec3) -> bool {
        let is_solid = self.patch.half_width == 0.0;
        self.view.ahead.dot(&normal) > if is_solid { LEAST_FACING } else { -0.5 }
            && self.patch.covers(self.seen(arm), self.patch.half_width)
    }

    fn seen(&self, arm: Vec3) -> [Real; 2] {
        self.view.across.map(|u| u.dot(&arm))
    }

    /// True for a triangle which faces along `inward` and is seen within a rectangle of a solid part.
    fn has_all(&self, part: &MovingPart, corners: &[Vec3; 3], inward: Vec3) -> bool {
        corners.iter().all(|corner| self.has(corner - part.start(), inward))
    }

    /// True for a place of the surface that the part overlaps on this face: on its patch or, as the mesh does not show the dent, beside it.
    fn covers(&self, part: &MovingPart, met: &Met) -> bool {
        let at = self.seen(met.arm);
        if !part.is_solid() {
            return self.view.ahead.dot(&met.normal) > -0.5 && self.patch.covers(at, self.reach);
        }
        let faces = |v: Vec3| self.view.ahead.dot(&v) > LEAST_FACING;
        // It may not be told apart from what is touched within a cell of that.
        let cell = part.cells().map_or([0.0; 2], |cells| self.patch.sides(cells));
        if (faces(met.normal) || faces(met.inward)) && self.patch.grown(cell).covers(at, 0.0) {
            return true;
        }
        let Some(foot) = part.front(&self.view, at) else { return false };
        let far = self.view.ahead.dot(&foot.arm);
        // As deep as what it touches, or nearer to where this face would push it out than to where a face of its own would.
        (faces(met.inward) && far > self.level) || (met.is_inside && far - self.view.ahead.dot(&met.arm) < -met.gap)
    }
}

/// Variance of a load as the mesh shows it [m²], on a combination of display vertices, `under` which nodes are of this `spacing`
/// [m]: that of the rows, less what the lattice's short waves are too soft by. Their stiffness is `C k² (1 + c a²k²)`, `c = −.167 + .138 α` for the part α that strain jumps keep, and −.022 where
/// tetrahedra have all energy, from the symbol of the infinite body-centred lattice in shear, the mean of all directions; it hardly depends on
/// Poisson's ratio.
fn shown_variance(on: &Touchable, under: [(Vertex, Real); 3], spacing: Real) -> Real {
    let deviation = DEVIATION * support(on.body);
    let softness =
        if on.body.is_smoothed() { 0.167 - 0.138 * contact_row::stabilisation(on.mesh, under) } else { 0.167 - 0.145 };
    (deviation * deviation - softness) * spacing * spacing
}

/// The same where the other end is no row, as wide as the load's, but the display: that is linear within an element, and the mean over one of
/// the body-centred lattice of the squares by which its corners are off, in each direction, is a twelfth of the squared spacing.
fn displayed_variance(on: &Touchable, shown: Real, spacing: Real) -> Real {
    let deviation = DEVIATION * support(on.body);
    2.0 * shown + (1.0 / 12.0 - deviation * deviation) * spacing * spacing
}

/// What stays the same for all samples of a tool.
#[derive(Clone, Copy, Debug)]
pub(super) struct Hold<'a> {
    pub(super) rigid: Rigid<'a>,
    /// Its parts.
    pub(super) parts: &'a [MovingPart<'a>],
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
        let Rigid { id, shape, friction, state: tool, horizon } = hold.rigid;
        let (first, middle, mechanism) = (hold.first, tool.middle(), &Mechanism::of(shape));
        for (i, sample) in self.found.iter().enumerate() {
            let face = &self.faces[sample.face as usize];
            let part = &hold.parts[face.part];
            let (radius, carried) = (part.radius(), part.moves.map(|moved| moved.carrier));
            let n = sample.load.normal;
            let [start, end] = part.moves.map(|moved| moved.frame.at(sample.core));
            let known = sample.known.map(|k| &known[k as usize]);
            let mut compliance = [0.0; MOST_POINTS];
            let before = &out.constraints[first..];
            // Filled in once for both.
            for (j, g) in compliance[..self.found.len()].iter_mut().enumerate() {
                *g = before.get(j).map_or_else(|| self.between(i, j), |other| other.compliance[i]);
            }
            // The mesh shows the place above the tool's own. A ball is pushed through its middle all the same, and feels no moment.
            let met_at = if part.is_ball() { sample.load.place } else { sample.place };
            let nu = face.nu;
            let point = face.part as u32 * on.body.points_of_a_part() + sample.triangle.0;
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
                arm: met_at - middle.pose.position,
                lever: middle.lever(part.at.part, mechanism, met_at),
                held: Held { coupling: tool.coupling, grip: mechanism.grip(tool.jaws.device) },
                allowed_for: hold.allowed_for,
                horizon,
            };
            let mut remembered =
                PointMemory { point, normal: n, weights: sample.weights, core: sample.core, ..PointMemory::default() };
            if sample.area > 0.0 {
                let own = compliance.iter().zip(&self.found);
                let dent: Real = own.map(|(g, other)| g * other.multiplier).sum();
                // The mean over its area of where the tool is.
                let flat = radius - sample.rounded;
                let place = sample.place;
                let overlap = n.dot(&(start - place)) - dent + flat;
                // Other nodes show other parts of the dents: nothing is to be felt of that at once.
                let changed = n.dot(&sample.moved) + self.deepened(part.samples(), i);
                let shift = known.map_or(0.0, |m| m.shift) - changed;
                let Closing { slack, slack_end, shift_end } =
                    Closing::new(known.map(|m| m.slack), overlap - shift, shift, moved, hold.rigid.is_held());
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
                        Some(m) => carried[0].to_world(m.anchor) + sample.displayed - on.touched(m),
                        None => place,
                    };
                    let own = carried[0].to_own(anchor);
                    constraint.friction.anchor = anchor;
                    constraint.friction.rate = (carried[1].to_world(own) - anchor) / TICK;
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

impl Samples {
    /// What those of a tool of these `parts`, whose constraints are counted from `first`, add to what the mesh displays.
    pub(super) fn dents<'a>(&'a self, parts: &'a [MovingPart], first: usize) -> impl Iterator<Item = Dent> + 'a {
        let touches = self.found.iter().enumerate().filter(|(_, sample)| sample.area > 0.0);
        touches.map(move |(i, sample)| {
            let face = &self.faces[sample.face as usize];
            let sides = parts[face.part].cells().map_or([0.0; 2], |cells| face.patch.sides(cells));
            let sides = [0, 1].map(|c| face.view.across[c] * sides[c]);
            let load = Narrow { shown: face.displayed, ..sample.load };
            Dent::new(load, sides, sample.displayed, [first + i, first + face.first])
        })
    }
}

/// Over its size at rest, how far the surface is drawn out under a tool.
const REACH: Real = 1.3;
/// Over what the mesh leaves out of a dent, what is allowed for beside a face: the closed form is right to some 5 %. With less a deep rim makes
/// a second face of the edge of its first one; with more a second place beside a deep dent is felt too late.
const DENTED: Real = 1.05;
/// Part of a sample's disc on the surface below which it touches nothing.
const LEAST_PART: Real = 0.02;
