//! Where organs meet, and where one folds onto itself: point constraints with two sides, once per tick, one for each patch of the surface
//! that is near another organ, or another place of its own.
//!
//! A patch meets the display triangles of the other organ that face it with its mean place, as it does the ground, and the other's
//! patches meet it likewise: neither is the master. What a constraint does to one organ it does to the other at the same place, so that
//! no momentum comes of it, nor any moment.

use super::closing::Closing;
use super::detection::MOST_STRETCH;
use super::friction::SLIPS;
use super::outside::boxes;
use super::rigid::Found;
use super::tool::MOST_POINTS;
use super::touchable::{FASTEST_SURFACE, MARGIN, Touchable, area_vector, weights_in_triangle};
use crate::ids::{OrganId, ToolId, Triangle, Vertex};
use crate::math::{Bounds, Real, Vec3, from_parry, to_parry};
use crate::model::active_mesh::skin;
use crate::model::body::patches::{Extent, SAME_SIDE};
use crate::model::constraint::{Constraint, Foot, Held, Pushed};
use crate::model::meeting::{MOST_MEETINGS, Meeting};
use crate::model::organ::MOST_ORGANS;
use crate::model::step_class::{TICK, step_of};
use crate::model::{ActiveMesh, Body, Friction};
use crate::visited::Visited;
use parry3d_f64::query::PointQuery;
use parry3d_f64::shape::Triangle as Flat;
use std::ops::Range;

/// Patches that are this far from another organ [m] are followed, so that all that come with up to 1 m/s within [`LOOKS`] ticks are
/// known before they touch.
const NEAR: Real = 10e-3;
/// Ticks in which all patches are looked at once for what they come near to: with fewer each takes longer, with more fast ones are found
/// late.
const LOOKS: u64 = 8;
/// And for what they come near to on their own organ, which every body has: [`NEAR`] less [`MARGIN`] in so many ticks is 0.5 m/s. With
/// fewer each tick takes longer; with more slower folds are found late, and one that is through is not found any more.
const LOOKS_AT_ITSELF: u64 = 16;
/// Least cosine between the normal of a triangle and what comes against that of a patch: an edge's patches, whose normals are between
/// those of its sides, meet what lies flat against a side, and not what is beside it.
const FACING: Real = 0.1;
/// Steps from triangle to triangle that a place takes within a tick at most.
const MOST_STEPS: usize = 4;
/// A way this much off a triangle's normal is along it, but for rounding.
const STRAIGHT: Real = 1e-6;

/// Coulomb's coefficients of friction between organs: of each two of them, and of each with itself where it is folded.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Between([[Real; MOST_ORGANS]; MOST_ORGANS]);

impl Between {
    /// Between all of them alike.
    pub fn all(friction: Real) -> Self {
        Self([[friction; MOST_ORGANS]; MOST_ORGANS])
    }

    /// With this `friction` between two of them.
    pub fn set(&mut self, a: OrganId, b: OrganId, friction: Real) {
        (self.0[a.index()][b.index()], self.0[b.index()][a.index()]) = (friction, friction);
    }

    /// That between two of them.
    pub fn of(&self, a: OrganId, b: OrganId) -> Real {
        self.0[a.index()][b.index()]
    }
}

/// What meets.
#[derive(Clone, Copy, Debug)]
pub struct Organs<'a> {
    /// The body that they are.
    pub body: &'a Body,
    /// As it moves.
    pub mesh: &'a ActiveMesh,
    /// What of friction is between them.
    pub friction: &'a Between,
    /// Their number among all that pushes.
    pub id: ToolId,
}

/// Receives what is found.
#[derive(Debug)]
pub struct Met<'a> {
    /// Constraints, and where they act.
    pub found: Found<'a>,
    /// The other side of each.
    pub feet: &'a mut Vec<Foot>,
}

/// Memory that looking for meetings needs and no one keeps.
#[derive(Debug)]
pub struct Workspace {
    /// Display vertices [m], (n_vertices); only those that are placed count.
    vertices: Vec<Vec3>,
    placed: Visited,
    /// Of each patch the vertex in its middle [m].
    middles: Vec<Vec3>,
    /// Patches that the one which looks does not meet.
    beside: Visited,
    /// Patches that may be near the place that is looked from, and the squared distances of their middles [m²].
    candidates: Vec<(u32, Real)>,
    before: Vec<Meeting>,
}

impl Workspace {
    /// For `body`.
    pub fn new(body: &Body) -> Self {
        let patches = body.patches().count() as usize;
        Self {
            vertices: body.surface().vertices.clone(),
            placed: Visited::new(body.surface().vertices.len()),
            middles: Vec::with_capacity(patches),
            beside: Visited::new(patches),
            candidates: Vec::with_capacity(patches),
            before: Vec::with_capacity(MOST_MEETINGS),
        }
    }

    /// Another tick begins.
    fn begin(&mut self, body: &Body, mesh: &ActiveMesh) {
        self.placed.clear();
        self.middles.clear();
        let patches = 0..body.patches().count();
        self.middles.extend(patches.map(|i| mesh.vertex(body.patches().middle(i))));
    }

    /// Where display vertex `v` is [m].
    fn at(&mut self, mesh: &ActiveMesh, v: Vertex) -> Vec3 {
        if self.placed.visit(v.index()) {
            self.vertices[v.index()] = mesh.vertex(v);
        }
        self.vertices[v.index()]
    }

    /// Readies a look from `place` [m] at the `patches`.
    fn measure(&mut self, body: &Body, place: Vec3, patches: Range<u32>) {
        self.candidates.clear();
        for i in patches {
            let away = (self.middles[i as usize] - place).norm_squared();
            let far = NEAR + MOST_STRETCH * body.patches().extent(i).reach;
            if away <= far * far && !self.beside.contains(i as usize) {
                self.candidates.push((i, away));
            }
        }
    }

    /// Places those of all triangles that share a corner with one.
    fn place_around(&mut self, body: &Body, mesh: &ActiveMesh, t: Triangle) {
        let around = body.triangle(t).into_iter().flat_map(|v| body.triangles_around(v));
        for v in around.flat_map(|t| body.triangle(*t)) {
            self.at(mesh, v);
        }
    }

    /// The displayed surface, which takes less where it has been placed.
    fn shown<'a>(&'a self, body: &'a Body, mesh: &'a ActiveMesh) -> Touchable<'a> {
        Touchable { body, mesh, vertices: &self.vertices, near: &self.placed }
    }
}

/// Appends the constraints between `organs` at the start of tick `tick` to `out`; `memory` holds the meetings of the last tick and
/// receives this tick's, by patch and other organ. No more than `room` of them are new.
pub fn meet(organs: &Organs, tick: u64, room: u32, memory: &mut Vec<Meeting>, out: Met, work: &mut Workspace) {
    let (Organs { body, mesh, .. }, Met { found, feet }) = (*organs, out);
    std::mem::swap(memory, &mut work.before);
    memory.clear();
    work.begin(body, mesh);
    for k in 0..work.before.len() {
        let m = work.before[k];
        if !(tick + u64::from(m.patch)).is_multiple_of(rest(m.gap)) {
            memory.push(m);
            continue;
        }
        let seen = Patch::of(organs, m.patch, work).and_then(|patch| patch.follow(organs, m.triangle, work));
        if let Some(seen) = seen.filter(|seen| seen.gap < NEAR) {
            let Seen { triangle, weights, gap, normal, share, .. } = seen;
            memory.push(Meeting { triangle, weights, gap, normal, share, ..m });
        }
    }
    let mut room = Room { left: room, memory };
    look_at_others(organs, tick, &mut room, work);
    look_at_themselves(organs, tick, &mut room, work);
    let on = &work.shown(body, mesh);
    for m in memory.iter_mut() {
        m.held = m.gap < MARGIN;
        if m.held {
            constrain(organs, m, found.constraints, feet);
            found.points_of_action.push(on.displayed(m.triangle, m.weights));
        } else {
            (m.multiplier, m.slack) = (0.0, 0.0);
            (m.force, m.tangential, m.stretch) = (Vec3::zeros(), Vec3::zeros(), Vec3::zeros());
        }
    }
}

/// The meetings, and how many more there is room for.
struct Room<'a> {
    /// New ones, by the time of the tick.
    left: u32,
    memory: &'a mut Vec<Meeting>,
}

impl Room<'_> {
    fn is_full(&self) -> bool {
        self.left == 0 || self.memory.len() == MOST_MEETINGS
    }

    /// Where the meeting of patch `i` and organ `other` is to stand, unless there is one.
    fn place(&self, i: u32, other: OrganId) -> Option<usize> {
        self.memory.binary_search_by_key(&(i, other), |m| (m.patch, m.other)).err()
    }

    fn insert(&mut self, at: usize, met: Meeting) {
        self.memory.insert(at, met);
        self.left -= 1;
    }
}

/// Finds what some of the patches come near to on other organs.
fn look_at_others(organs: &Organs, tick: u64, room: &mut Room, work: &mut Workspace) {
    let Organs { body, mesh, .. } = *organs;
    let patches = body.patches();
    if body.organs().len() == 1 {
        return;
    }
    let boxes = boxes(body, mesh);
    let window = window(&boxes, body.organs().len());
    work.beside.clear();
    for i in (0..patches.count()).filter(|i| (u64::from(*i) + tick).is_multiple_of(LOOKS)) {
        let far = MOST_STRETCH * patches.extent(i).reach;
        if room.is_full() || !window.grown(far).contains(&work.middles[i as usize]) {
            continue;
        }
        let Some(patch) = Patch::of(organs, i, work).filter(|patch| window.contains(&patch.place)) else {
            continue;
        };
        let own = patches.organ(i);
        for other in (0..body.organs().len()).map(OrganId::at).filter(|other| *other != own) {
            let Some(place) = room.place(i, other) else { continue };
            if room.is_full() || !boxes[other.index()].grown(NEAR).contains(&patch.place) {
                continue;
            }
            if let Some(seen) = patch.look(organs, patches.of_organ(other), false, work) {
                room.insert(place, seen.met_anew(i, other));
            }
        }
    }
}

/// Finds what some of the patches come near to on their own organ.
fn look_at_themselves(organs: &Organs, tick: u64, room: &mut Room, work: &mut Workspace) {
    let patches = organs.body.patches();
    for i in (0..patches.count()).filter(|i| (u64::from(*i) + tick).is_multiple_of(LOOKS_AT_ITSELF)) {
        let own = patches.organ(i);
        let Some(place) = room.place(i, own).filter(|_| !room.is_full()) else { continue };
        work.beside.clear();
        patches.beside(i).iter().for_each(|of| _ = work.beside.visit(*of as usize));
        let seen = Patch::of(organs, i, work).and_then(|patch| patch.look(organs, patches.of_organ(own), true, work));
        if let Some(seen) = seen {
            room.insert(place, seen.met_anew(i, own));
        }
    }
}

/// Ticks, a power of two, within which what is this far from another organ [m] does not come to be a constraint.
fn rest(gap: Real) -> u64 {
    let ticks = ((gap - MARGIN) / (FASTEST_SURFACE * TICK)).max(1.0) as u64;
    1 << ticks.min(LOOKS).ilog2()
}

/// Around all places where the boxes of two of so many organs are near each other [m].
fn window(boxes: &[Bounds; MOST_ORGANS], organs: usize) -> Bounds {
    let pairs = (0..organs).flat_map(|i| (0..i).map(move |j| (i, j)));
    let shared = pairs.map(|(i, j)| {
        let (a, b) = (boxes[i].grown(NEAR), boxes[j].grown(NEAR));
        Bounds::new(a.low.sup(&b.low), a.high.inf(&b.high))
    });
    let is_any = |shared: &Bounds| (0..3).all(|c| shared.low[c] <= shared.high[c]);
    shared.filter(is_any).fold(Bounds::NOTHING, |all, shared| all.joined(&shared))
}

/// A patch where it is now.
struct Patch {
    /// Its mean place [m].
    place: Vec3,
    /// Outward unit normal in its middle.
    normal: Vec3,
    /// Of the disc that is as large [m].
    radius: Real,
}

/// A display triangle where it is now.
struct Face {
    triangle: Triangle,
    /// [m].
    corners: [Vec3; 3],
    /// Outward, twice as long as the triangle is large [m²].
    area: Vec3,
}

impl Face {
    fn new(triangle: Triangle, corners: [Vec3; 3]) -> Self {
        Self { triangle, corners, area: (corners[1] - corners[0]).cross(&(corners[2] - corners[0])) }
    }

    /// Its place that is nearest to `p` [m].
    fn nearest(&self, p: Vec3) -> Vec3 {
        let [a, b, c] = self.corners.map(to_parry);
        from_parry(Flat::new(a, b, c).project_local_point(to_parry(p), false).point)
    }
}

/// The place of another organ that is next to a patch.
struct Seen {
    squared: Real,
    triangle: Triangle,
    weights: [Real; 3],
    gap: Real,
    normal: Vec3,
    /// How much of the patch meets it.
    share: Real,
}

impl Seen {
    fn met_anew(self, patch: u32, other: OrganId) -> Meeting {
        Meeting {
            patch,
            other,
            triangle: self.triangle,
            weights: self.weights,
            gap: self.gap,
            share: self.share,
            held: false,
            normal: self.normal,
            force: Vec3::zeros(),
            multiplier: 0.0,
            tangential: Vec3::zeros(),
            // All that they overlap by is closed gradually.
            slack: Real::INFINITY,
            stretch: Vec3::zeros(),
        }
    }
}

impl Patch {
    /// `None` where it has no normal.
    fn of(organs: &Organs, i: u32, work: &mut Workspace) -> Option<Self> {
        let Organs { body, mesh, .. } = *organs;
        let (all, middle) = (body.patches().of(i), body.patches().middle(i));
        let mut normal = Vec3::zeros();
        for t in body.triangles_around(middle) {
            let [a, b, c] = body.triangle(*t).map(|v| work.at(mesh, v));
            normal += (b - a).cross(&(c - a));
        }
        let place = all.iter().map(|(v, w)| work.at(mesh, *v) * *w).sum();
        Some(Self { place, normal: normal.try_normalize(0.0)?, radius: body.patches().radius(i) })
    }

    /// What is next to it beside what was next to it a tick ago.
    fn follow(&self, organs: &Organs, was: Triangle, work: &mut Workspace) -> Option<Seen> {
        let Organs { body, mesh, .. } = *organs;
        let mut best: Option<Seen> = None;
        let mut at = was;
        for _ in 0..MOST_STEPS {
            work.place_around(body, mesh, at);
            let on = work.shown(body, mesh);
            let face = |t: Triangle| Face::new(t, body.triangle(t).map(|v| on.vertex(v)));
            self.consider(&face(at), false, &mut best);
            for t in body.triangle(at).iter().flat_map(|v| body.triangles_around(*v)) {
                self.consider(&face(*t), false, &mut best);
            }
            match best.as_ref().map(|seen| seen.triangle) {
                Some(next) if next != at => at = next,
                _ => break,
            }
        }
        best.and_then(|seen| self.met(organs, seen, work))
    }

    /// What is next to it on the `patches`, if it is near; of its `own` organ only what faces it across what is outside of it.
    fn look(&self, organs: &Organs, patches: Range<u32>, own: bool, work: &mut Workspace) -> Option<Seen> {
        let Organs { body, mesh, .. } = *organs;
        let mut best: Option<Seen> = None;
        work.measure(body, self.place, patches.clone());
        // From the nearest middle on: what is found there leaves most of the rest too far.
        let first =
            (0..work.candidates.len()).min_by(|i, j| work.candidates[*i].1.total_cmp(&work.candidates[*j].1))?;
        work.candidates.swap(0, first);
        for k in 0..work.candidates.len() {
            let far = best.as_ref().map_or(NEAR, |seen| seen.squared.sqrt().min(NEAR));
            self.near(organs, k, far, work, |face| self.consider(&face, own, &mut best));
        }
        let seen = best?;
        work.place_around(body, mesh, seen.triangle);
        let seen = self.met(organs, seen, work).filter(|seen| seen.gap.abs() < NEAR)?;
        // Behind what faces it, but outside: on the far side of a thin organ.
        (seen.gap >= 0.0 || !self.is_outside(organs, &seen, work)).then_some(seen)
    }

    /// Whether the patch is in front of the triangle of the candidates that is nearest of all, whichever way it faces, where that is nearer
    /// than what was `seen`.
    fn is_outside(&self, organs: &Organs, seen: &Seen, work: &mut Workspace) -> bool {
        let mut nearest = (seen.squared * (1.0 - STRAIGHT), false);
        for k in 0..work.candidates.len() {
            self.near(organs, k, seen.squared.sqrt(), work, |face| {
                let away = self.place - face.nearest(self.place);
                if away.norm_squared() < nearest.0 {
                    nearest = (away.norm_squared(), face.area.dot(&away) > 0.0);
                }
            });
        }
        nearest.1
    }

    /// Calls `with` each triangle of candidate `k` of which some place may be no farther than `far` [m].
    fn near(&self, organs: &Organs, k: usize, far: Real, work: &mut Workspace, mut with: impl FnMut(Face)) {
        let Organs { body, mesh, .. } = *organs;
        let (i, away) = work.candidates[k];
        let Extent { reach, edge } = body.patches().extent(i);
        if away > (far + MOST_STRETCH * reach).powi(2) {
            return;
        }
        let most = (far + MOST_STRETCH * edge).powi(2);
        for t in body.patches().triangles(i) {
            let corners = body.triangle(*t);
            if (work.at(mesh, corners[0]) - self.place).norm_squared() <= most {
                with(Face::new(*t, corners.map(|v| work.at(mesh, v))));
            }
        }
    }

    /// Takes the place of the `face` that is nearest for the `best` where it faces the patch and is nearer; `across` what is outside where
    /// both are in front of each other.
    fn consider(&self, face: &Face, across: bool, best: &mut Option<Seen>) {
        let facing = -face.area.dot(&self.normal);
        if facing <= 0.0 || facing * facing <= FACING * FACING * face.area.norm_squared() {
            return;
        }
        // None of its places is nearer than its plane, but for rounding.
        let height = face.area.dot(&(self.place - face.corners[0]));
        if across && height <= 0.0 {
            return;
        }
        let plane = height * height * (1.0 + STRAIGHT);
        if best.as_ref().is_some_and(|seen| plane >= seen.squared * face.area.norm_squared()) {
            return;
        }
        let nearest = face.nearest(self.place);
        let squared = (self.place - nearest).norm_squared();
        if across && self.normal.dot(&(nearest - self.place)) <= 0.0 {
            return;
        }
        if best.as_ref().is_none_or(|seen| squared < seen.squared)
            && let Some(weights) = weights_in_triangle(&face.corners, nearest)
        {
            let normal = Vec3::zeros();
            *best = Some(Seen { squared, triangle: face.triangle, weights, gap: 0.0, normal, share: 1.0 });
        }
    }

    /// How the patch is to the place that was `seen` to be nearest; `None` where it is beyond the edge of what faces it.
    fn met(&self, organs: &Organs, seen: Seen, work: &Workspace) -> Option<Seen> {
        let on = &work.shown(organs.body, organs.mesh);
        let normal = smooth_normal(on, seen.triangle, seen.weights)?;
        let away = self.place - on.displayed(seen.triangle, seen.weights);
        let flat = area_vector(on, seen.triangle).try_normalize(0.0)?;
        let height = flat.dot(&away);
        let (distance, aside) = (away.norm(), (away - flat * height).norm());
        if height > 0.0 && aside > STRAIGHT * height {
            // Over a sharp edge the way to it is the normal.
            let out = away / distance;
            let normal = if out.dot(&normal) > SAME_SIDE { normal } else { out };
            return Some(Seen { gap: distance, normal, ..seen });
        }
        // A patch whose middle is beyond an edge, but behind it, lies on it with less and less until all of it has slid off.
        let share = 1.0 - aside / self.radius;
        (share > 0.0).then_some(Seen { gap: height, normal, share, ..seen })
    }
}

/// Outward unit normal of the surface that the triangles stand for, at the place of one with these weights: it turns continuously but at
/// edges, where those around a corner that belong to another side do not count.
fn smooth_normal(on: &Touchable, t: Triangle, weights: [Real; 3]) -> Option<Vec3> {
    let flat = area_vector(on, t).try_normalize(0.0)?;
    let mut sum = Vec3::zeros();
    for (v, w) in on.body.triangle(t).into_iter().zip(weights) {
        let around = on.body.triangles_around(v).iter().map(|t| area_vector(on, *t));
        let side: Vec3 = around.filter(|area| area.dot(&flat) > SAME_SIDE * area.norm()).sum();
        sum += side.try_normalize(0.0)? * w;
    }
    sum.try_normalize(0.0)
}

/// Appends the constraint of `m`.
fn constrain(organs: &Organs, m: &mut Meeting, constraints: &mut Vec<Constraint>, feet: &mut Vec<Foot>) {
    let Organs { body, mesh, friction, id } = *organs;
    let patch = body.patches().of(m.patch);
    let corners = body.triangle(m.triangle);
    let stencil: [(Vertex, Real); 3] = std::array::from_fn(|i| (corners[i], m.weights[i]));
    let (row, foot) = skin::two_sided(mesh, patch, &stencil);
    let mobility: Real = row.entries().iter().map(|(s, b)| b * b * mesh.motion.inverse_mass[s.index()]).sum();
    // Of the elements that carry it, the one that is kicked the least often.
    let kicked = |v: Vertex| mesh.pool().class_of(mesh.embedding(v).element);
    let carriers = patch.iter().map(|(v, _)| *v).chain(corners);
    let horizon = carriers.filter_map(kicked).map(step_of).fold(0.0, Real::max);
    // As on the ground: as much as its inertia gives way within a step.
    let mut compliance = [0.0; MOST_POINTS];
    compliance[0] = horizon * horizon * mobility / m.share;
    // What the compliance gives way by is no overlap that was found late.
    let closing = Closing::new(Some(m.slack), -m.gap - compliance[0] * m.multiplier, 0.0, 0.0);
    m.slack = closing.slack_end;
    let apart = row.interpolate(&mesh.motion.position);
    let along = |v: &Vec3| v - m.normal * m.normal.dot(v);
    let coefficient = friction.of(body.patches().organ(m.patch), m.other);
    (m.tangential, m.stretch) = (along(&m.tangential), along(&m.stretch));
    constraints.push(Constraint {
        row,
        normal: m.normal,
        offset: m.normal.dot(&apart) - m.gap - closing.slack,
        rate: (closing.slack - closing.slack_end) / TICK,
        first: constraints.len() as u32,
        compliance,
        tool: id,
        point: body.point_of_patch(m.patch),
        multiplier: m.multiplier,
        mean_multiplier: 0.0,
        friction: Friction {
            coefficient,
            compliance: 1.0,
            anchor: apart - m.stretch,
            rate: Vec3::zeros(),
            multiplier: m.tangential,
            mean_multiplier: Vec3::zeros(),
        },
        arm: Vec3::zeros(),
        lever: Vec3::zeros(),
        held: Held::default(),
        allowed_for: Pushed::default(),
        horizon,
    });
    feet.push(foot);
}

/// Writes what the `constraints` between organs were solved to into the meetings; nothing where the body stood still.
pub fn remember(mesh: &ActiveMesh, constraints: &[Constraint], meetings: &mut [Meeting]) {
    for (c, m) in constraints.iter().zip(meetings.iter_mut().filter(|m| m.held)) {
        m.multiplier = c.multiplier;
        m.force = c.normal * c.mean_multiplier + c.friction.mean_multiplier;
        if c.friction.coefficient == 0.0 {
            continue;
        }
        m.tangential = c.friction.multiplier;
        let stretch = c.row.interpolate(&mesh.motion.position) - c.friction.anchor;
        let slips = c.friction.multiplier.norm() >= SLIPS * c.friction.coefficient * c.multiplier;
        // One that slips takes the place that it sticks to along.
        m.stretch = if slips { c.friction.multiplier * (-c.compliance[0] * c.friction.compliance) } else { stretch };
    }
}
