//! Where a tool meets the display surface: point constraints, once per tick.
//!
//! A constraint stands at each display vertex near the tool and at each near triangle's point nearest to the core of each
//! of the tool's parts, so that nothing slips between vertices. Normals run from the core to the point, at the tool's
//! place in the middle of the tick.

use super::shape::{MOST_PARTS, Posed, Shape, posed};
use super::tool::{MOST_POINTS, Tool, ToolState};
use super::wrench::middle_pose;
use crate::math::{Pose, Real, Vec3};
use crate::model::constraint::{Constraint, PointMemory, dent};
use crate::model::{ActiveMesh, Body, Friction, skin};

/// Points this far from the tool [m] become constraints, so that contact begins with an open gap, and no tool passes
/// between two ticks what it did not push: more where a tick's motion is more.
const MARGIN: Real = 2e-3;

/// A surface that comes to meet a tool is taken to be no faster [m/s].
const FASTEST_SURFACE: Real = 1.0;

/// Part of an overlap found late that remains after each tick: 32 of them (a frame) close 99.5 % of it.
const SLACK_KEPT: Real = 0.85;

/// κ of the sub-grid compliance: the half-space's displacement farther than κ·spacing from a load is already in the
/// mesh.
const KAPPA: Real = 1.0 / 3.0;

/// A constraint in the making.
#[derive(Clone, Copy, Debug)]
struct Candidate {
    /// As [`Constraint::point`].
    point: u32,
    /// Signed distance from the tool's surface [m].
    gap: Real,
    normal: Vec3,
    /// The surface point [m].
    place: Vec3,
    /// Number of the tool's part.
    part: u32,
    /// Coordinates of the place of the part's core that it is measured from.
    core: Vec3,
    /// What is remembered of it: index into the memory.
    known: Option<u32>,
    /// Display vertices and weights; one entry counts for a vertex.
    stencil: [(u32, Real); 3],
    /// Surface area that the point stands for [m²].
    area: Real,
}

impl Candidate {
    /// The place of its triangle with other `weights` [m].
    fn at(&self, on: &Touchable, weights: [Real; 3]) -> Vec3 {
        self.stencil.iter().zip(weights).map(|(s, w)| on.vertices[s.0 as usize] * w).sum()
    }

    fn stencil(&self) -> &[(u32, Real)] {
        if self.stencil[0].1 == 1.0 { &self.stencil[..1] } else { &self.stencil[..] }
    }
}

/// What a candidate's force does to the surface below the mesh's size.
#[derive(Clone, Copy, Debug)]
struct Load {
    place: Vec3,
    normal: Vec3,
    /// Radius of the disc that it spreads over [m].
    radius: Real,
    /// Spacing of the level that carries it [m].
    spacing: Real,
    /// Last multiplier [N].
    multiplier: Real,
}

/// Memory that detection needs and no one keeps.
#[derive(Debug)]
pub struct Workspace {
    candidates: Vec<Candidate>,
    loads: Vec<Load>,
    memory: Vec<PointMemory>,
    /// Display vertices around the tool.
    near: Vec<u32>,
    /// Turn in which each display triangle was last looked at.
    seen: Vec<u32>,
    turn: u32,
    /// No display edge is longer [m], unless it is stretched beyond [`MOST_STRETCH`].
    longest_edge: Real,
}

/// Stretch of display edges up to which no triangle near a tool is missed.
const MOST_STRETCH: Real = 2.0;

impl Workspace {
    /// For surfaces of `body`: all of it may come near a tool at once.
    pub fn new(body: &Body) -> Self {
        let most = body.surface().vertices.len() + body.surface().triangles.len();
        let surface = body.surface();
        let edge = |t: &[u32; 3], i: usize| {
            (surface.vertices[t[i] as usize] - surface.vertices[t[(i + 1) % 3] as usize]).norm()
        };
        let longest = surface.triangles.iter().flat_map(|t| (0..3).map(move |i| edge(t, i))).fold(0.0, Real::max);
        Self {
            candidates: Vec::with_capacity(most),
            loads: Vec::with_capacity(MOST_POINTS),
            memory: Vec::with_capacity(MOST_POINTS),
            near: Vec::with_capacity(surface.vertices.len()),
            seen: vec![0; surface.triangles.len()],
            turn: 0,
            longest_edge: MOST_STRETCH * longest,
        }
    }
}

/// Inputs of detection that are the same for every tool.
#[derive(Debug)]
pub struct Touchable<'a> {
    /// The body.
    pub body: &'a Body,
    /// The body as it moves.
    pub mesh: &'a ActiveMesh,
    /// Display vertices at the start of the tick [m], (n_vertices).
    pub vertices: &'a [Vec3],
    /// Length of the tick [s].
    pub tick: Real,
}

/// Appends the constraints of tool `index` to `constraints` and the surface point at which each one acts [m] to
/// `points_of_action`; `memory` holds the tool's points of the last tick, ascending, and receives this tick's.
pub fn detect(
    on: &Touchable,
    index: u32,
    of: &Tool,
    tool: &ToolState,
    memory: &mut Vec<PointMemory>,
    (constraints, points_of_action): (&mut Vec<Constraint>, &mut Vec<Vec3>),
    work: &mut Workspace,
) {
    let candidates = &mut work.candidates;
    candidates.clear();
    let per_part = points_of_a_part(on.body);
    let ((all, parts), (start, _), (end, _)) =
        (posed(&middle_pose(tool), &of.shape), posed(&tool.previous, &of.shape), posed(&tool.pose, &of.shape));
    let way = |i: usize| start[i].frame.farthest_move(&end[i].frame, all[i].part);
    let margin = (0..parts).map(|i| way(i) + FASTEST_SURFACE * on.tick).fold(MARGIN, Real::max);
    let touch = Touch { parts: &all[..parts], margin, per_part, memory };
    // Whatever touches the tool has all its vertices within an edge's length of the box of one of its parts.
    work.near.clear();
    let windows = touch.windows(work.longest_edge);
    for (v, p) in on.vertices.iter().enumerate() {
        if windows[..parts].iter().any(|w| is_in(w, p)) {
            work.near.push(v as u32);
        }
    }
    near_vertices(on, &touch, &work.near, candidates);
    work.turn = work.turn.wrapping_add(1);
    if work.turn == 0 {
        work.seen.fill(0);
        work.turn = 1;
    }
    near_triangles(on, &touch, &work.near, (&mut work.seen, work.turn), candidates);

    thin_out(candidates, on.vertices.len() as u32, per_part);
    recall(candidates, memory, per_part, parts as u32);

    work.memory.clear();
    work.loads.clear();
    work.loads.extend(candidates.iter().map(|c| Load::new(on, c, memory)));
    let (first, half_space) = (constraints.len() as u32, half_space(on.body));
    let nu = on.body.material().poisson_ratio();
    for (i, candidate) in candidates.iter().enumerate() {
        let (n, core) = (candidate.normal, candidate.core);
        let [start, end] = [&start, &end].map(|posed| posed[candidate.part as usize].frame.at(core));
        let part = all[candidate.part as usize].part;
        let (radius, most_dent) = (part.radius(), MOST_DENT * part.half_thickness());
        let (row, fade) = skin::row(on.mesh, candidate.stencil());
        let share = row.entries().iter().map(|(_, b)| b * b).sum::<Real>() / MEAN_SQUARE;
        let mut compliance = [0.0; MOST_POINTS];
        for (j, (g, other)) in compliance.iter_mut().zip(&work.loads).enumerate() {
            *g = half_space * if i == j { other.own(share) } else { work.loads[i].from(other) };
        }
        let moved = n.dot(&(end - start));
        let known = candidate.known.map(|k| &memory[k as usize]);
        // Overlap at the start of the tick that neither the last multiplier nor the last slack explains: a tool that
        // came too fast, a body that stood still meanwhile, a point just found. It is closed gradually.
        let soft: Real = compliance.iter().zip(&work.loads).map(|(g, other)| g * other.multiplier).sum();
        let shown = dent(soft, most_dent);
        let overlap = n.dot(&start) + radius - n.dot(&candidate.place) - shown;
        let slack = match known {
            Some(m) if overlap <= m.slack + UNNOTICED + 0.5 * moved.abs() => m.slack.min(overlap.max(0.0)),
            _ => overlap.max(0.0),
        };
        let (anchor, tangential) = match known.filter(|_| of.friction > 0.0) {
            Some(m) => {
                // Another place of the triangle is the nearest now: the anchor goes along by as much.
                let now = candidate.place - candidate.at(on, m.weights);
                let back = m.tangential - n * n.dot(&m.tangential);
                (tool.previous.to_own(tool.previous.to_world(m.anchor) + now), back)
            }
            None => (tool.previous.to_own(candidate.place), Vec3::zeros()),
        };
        let anchored = (tool.previous.to_world(anchor), tool.pose.to_world(anchor));
        let slack_end = if slack > 1e-7 { slack * SLACK_KEPT } else { 0.0 };
        constraints.push(Constraint {
            row,
            normal: n,
            // What is displayed, and touched, is the row's point and its fade.
            offset: n.dot(&(start - fade)) + radius - slack,
            rate: (moved + slack - slack_end) / on.tick,
            first,
            compliance,
            most_dent,
            tool: index,
            point: candidate.point,
            multiplier: work.loads[i].multiplier,
            mean_multiplier: 0.0,
            friction: Friction {
                coefficient: of.friction,
                compliance: (2.0 - nu) / (2.0 * (1.0 - nu)),
                anchor: anchored.0 - fade,
                rate: (anchored.1 - anchored.0) / on.tick,
                multiplier: tangential,
                mean_multiplier: Vec3::zeros(),
            },
        });
        // The surface's own point, not the tool's: that is where the body gets the force.
        points_of_action.push(candidate.place);
        work.memory.push(PointMemory {
            point: candidate.point,
            // What the solve changes is written back after it.
            multiplier: 0.0,
            slack: slack_end,
            normal: n,
            tangential,
            anchor,
            weights: candidate.stencil.map(|s| s.1),
        });
    }
    std::mem::swap(memory, &mut work.memory);
}

/// Keeps as many points as the solver may take, in the order of their numbers: vertices before triangles and the deepest
/// first, ties to the smaller number. Those left out that touch leave their area to the nearest that is kept, so that the
/// surface is as stiff as before.
fn thin_out(candidates: &mut Vec<Candidate>, vertices: u32, per_part: u32) {
    if candidates.len() > MOST_POINTS {
        let first = |c: &Candidate| (c.gap > 0.0, c.point % per_part >= vertices);
        candidates
            .sort_unstable_by(|a, b| first(a).cmp(&first(b)).then(a.gap.total_cmp(&b.gap)).then(a.point.cmp(&b.point)));
        let (kept, others) = candidates.split_at_mut(MOST_POINTS);
        let places: [Vec3; MOST_POINTS] = std::array::from_fn(|i| kept[i].place);
        for other in others.iter().filter(|o| o.gap < 0.0) {
            let away = |i: &usize| (places[*i] - other.place).norm_squared();
            let nearest = (0..MOST_POINTS).min_by(|a, b| away(a).total_cmp(&away(b)));
            kept[nearest.unwrap_or(0)].area += other.area;
        }
        candidates.truncate(MOST_POINTS);
    }
    candidates.sort_unstable_by_key(|c| c.point);
}

/// Finds what is remembered of each candidate. A point that has gone from one part of a tool to the next keeps its force
/// and its anchor.
fn recall(candidates: &mut [Candidate], memory: &[PointMemory], per_part: u32, parts: u32) {
    let index = |point: u32| memory.binary_search_by_key(&point, |m| m.point).ok();
    for i in 0..candidates.len() {
        let (own, normal) = (candidates[i].point, candidates[i].normal);
        let left = |point: &u32| candidates.binary_search_by_key(point, |c| c.point).is_err();
        let others = (0..parts).map(|part| own % per_part + part * per_part).filter(|point| *point != own);
        let alike = |k: &usize| memory[*k].normal.dot(&normal) > ALIKE;
        let known = index(own).or_else(|| others.filter(left).filter_map(index).find(alike));
        candidates[i].known = known.map(|k| k as u32);
    }
}

/// Cosine between two normals up to which they count as those of one contact.
const ALIKE: Real = 0.5;

/// Overlap [m] that rounding and a solve of few sweeps may leave.
const UNNOTICED: Real = 5e-5;

/// Part of half of a part's thickness that the dent below the mesh's size may take: beyond it the displayed surface would swallow
/// a thin tip and lose it at the next triangle.
const MOST_DENT: Real = 0.3;

/// `(1−ν²)/(πE)` [m²/N]: an elastic half-space gives way by this much per newton and per distance from the load.
fn half_space(body: &Body) -> Real {
    let material = body.material();
    let nu = material.poisson_ratio();
    (1.0 - nu * nu) / (std::f64::consts::PI * material.youngs_modulus())
}

/// The dent that the mesh is too coarse to show: the half-space's `1/r`, less what a mesh of the level's spacing shows,
/// which is what lies beyond κ·spacing. All in 1/m, to be multiplied by [`half_space`].
impl Load {
    fn new(on: &Touchable, candidate: &Candidate, memory: &[PointMemory]) -> Self {
        // Each vertex hangs on a level of its own; after a change of resolution its spacing, too, fades over.
        let spacing = |v: u32| on.mesh.attachment(v).spacing + on.mesh.fade[v as usize][3];
        Self {
            place: candidate.place,
            normal: candidate.normal,
            radius: (candidate.area / std::f64::consts::PI).sqrt(),
            spacing: candidate.stencil().iter().map(|(v, w)| w * spacing(*v)).sum(),
            multiplier: candidate.known.map_or(0.0, |k| memory[k as usize].multiplier),
        }
    }

    /// Under itself: the mean over its disc. `share`: how much the mesh shows of it here, over what it shows on average; a
    /// point on a node moves that node alone, one between nodes has to move them all.
    fn own(&self, share: Real) -> Real {
        let (s, cut) = (self.radius, KAPPA * self.spacing / share);
        if s < cut { 2.0 / s - 1.0 / cut } else { cut / (s * s) }
    }

    /// Here, along this normal, because of `other`. Discs that overlap count as side by side, or the matrix would not be
    /// positive definite.
    fn from(&self, other: &Load) -> Real {
        let cut = KAPPA * 0.5 * (self.spacing + other.spacing);
        let squared = (self.place - other.place).norm_squared();
        // Most pairs are farther apart than that.
        if squared >= cut * cut {
            return 0.0;
        }
        let apart = squared.sqrt().max(LEAST_APART * (self.radius + other.radius));
        (1.0 / apart - 1.0 / cut).max(0.0) * self.normal.dot(&other.normal).max(0.0)
    }
}

/// Mean `Σ b²` of surface points.
const MEAN_SQUARE: Real = 0.35;

/// Least distance between two loads over the sum of their radii.
const LEAST_APART: Real = 0.85;

/// Numbers that the points of one part of a tool take: its vertices and triangles.
pub fn points_of_a_part(body: &Body) -> u32 {
    (body.surface().vertices.len() + body.surface().triangles.len()) as u32
}

/// A tool near a surface, and what it touched before.
struct Touch<'a> {
    parts: &'a [Posed<'a>],
    /// Points with a gap up to this become constraints [m].
    margin: Real,
    per_part: u32,
    memory: &'a [PointMemory],
}

impl Touch<'_> {
    /// Boxes around everything that each part may touch, grown by `more`.
    fn windows(&self, more: Real) -> [(Vec3, Vec3); MOST_PARTS] {
        let mut windows = [(Vec3::zeros(), Vec3::zeros()); MOST_PARTS];
        for (window, at) in windows.iter_mut().zip(self.parts) {
            *window = at.window(at.part.radius() + self.margin + more);
        }
        windows
    }

    /// Where part `part` touches the surface's `place`, which faces `outward`, or `None` where it is out of reach or its
    /// sheet of the surface is not one that the tool pushes. `core`: coordinates of the core's nearest point.
    ///
    /// A point that was touched keeps the side it was touched on: should the core itself slip below the surface, the
    /// point is still pushed the way it was, instead of being let go.
    fn side(&self, part: usize, core: Vec3, place: Vec3, outward: Vec3, base: u32) -> Option<Side> {
        let at = &self.parts[part];
        let (away, radius) = (place - at.frame.at(core), at.part.radius());
        let distance = away.norm();
        if distance > radius + self.margin {
            return None;
        }
        let inside = distance <= 1e-9;
        let normal = if inside { -outward.normalize() } else { away / distance };
        let point = base + part as u32 * self.per_part;
        let known = remembered(self.memory, point);
        let sunk = match known {
            Some(m) => m.normal.dot(&normal) < 0.0,
            None if normal.dot(&outward) < 0.0 => false,
            None => return None,
        };
        let (back, gap) = if sunk { (-normal, -distance - radius) } else { (normal, distance - radius) };
        let side = Side { point, normal: back, gap, core };
        let side = if sunk || inside { pushed_out(at, place, side, known.filter(|_| inside)) } else { side };
        Some(side).filter(|side| side.gap <= self.margin)
    }
}

/// How a part of a tool touches a point of the surface.
#[derive(Clone, Copy, Debug)]
struct Side {
    /// As [`Constraint::point`].
    point: u32,
    normal: Vec3,
    /// [m].
    gap: Real,
    /// Coordinates of the core's point.
    core: Vec3,
}

/// A place inside of a solid core, or past it, is pushed out all the way, along `known`'s normal where there is one.
fn pushed_out(at: &Posed, place: Vec3, side: Side, known: Option<&PointMemory>) -> Side {
    let normal = known.map_or(side.normal, |m| m.normal);
    match at.exit(place, normal) {
        Some((core, way)) => Side { normal, core, gap: -way - at.part.radius(), ..side },
        None => side,
    }
}

fn is_in((low, high): &(Vec3, Vec3), p: &Vec3) -> bool {
    (p.x >= low.x) & (p.x <= high.x) & (p.y >= low.y) & (p.y <= high.y) & (p.z >= low.z) & (p.z <= high.z)
}

fn remembered(memory: &[PointMemory], point: u32) -> Option<&PointMemory> {
    memory.binary_search_by_key(&point, |m| m.point).ok().map(|i| &memory[i])
}

/// Outward area vector of display triangle `t`, twice its area long [m²].
fn area_vector(on: &Touchable, t: u32) -> Vec3 {
    let [a, b, c] = on.body.surface().triangles[t as usize].map(|v| on.vertices[v as usize]);
    (b - a).cross(&(c - a))
}

/// Part of the surface's area that vertices stand for; the rest is that of points inside triangles.
const VERTEX_SHARE: Real = 0.5;

/// Part nearest to `place`, coordinates of its core's nearest point there, and its distance [m], less that of its surface
/// from its core.
fn nearest_part(parts: &[Posed], place: Vec3) -> (usize, Vec3, Real) {
    let mut best = (0, Vec3::zeros(), Real::INFINITY);
    for (i, at) in parts.iter().enumerate() {
        let core = at.nearest(place);
        let gap = (place - at.frame.at(core)).norm() - at.part.radius();
        if gap < best.2 {
            best = (i, core, gap);
        }
    }
    best
}

fn near_vertices(on: &Touchable, touch: &Touch, near: &[u32], out: &mut Vec<Candidate>) {
    let windows = touch.windows(0.0);
    for &v in near {
        let place = on.vertices[v as usize];
        if !windows[..touch.parts.len()].iter().any(|w| is_in(w, &place)) {
            continue;
        }
        let (part, core) = match touch.parts {
            [at] => (0, at.nearest(place)),
            parts => {
                let (part, core, _) = nearest_part(parts, place);
                (part, core)
            }
        };
        let outward: Vec3 = on.body.triangles_around(v as usize).iter().map(|t| area_vector(on, *t)).sum();
        if let Some(Side { point, normal, gap, core }) = touch.side(part, core, place, outward, v) {
            let stencil = [(v, 1.0), (0, 0.0), (0, 0.0)];
            let area = VERTEX_SHARE * on.body.vertex_area()[v as usize];
            out.push(Candidate { point, gap, normal, place, part: part as u32, core, known: None, stencil, area });
        }
    }
}

/// Points inside triangles: between three vertices the surface could otherwise pass through the tool unfelt. Each part
/// that is the nearest somewhere in a triangle has a point of its own there, and they share the area.
fn near_triangles(
    on: &Touchable,
    touch: &Touch,
    near: &[u32],
    (seen, turn): (&mut [u32], u32),
    out: &mut Vec<Candidate>,
) {
    let windows = touch.windows(0.0);
    let first = on.vertices.len() as u32;
    let around = near.iter().flat_map(|v| on.body.triangles_around(*v as usize));
    for &t in around {
        if std::mem::replace(&mut seen[t as usize], turn) == turn {
            continue;
        }
        let triangle = &on.body.surface().triangles[t as usize];
        let corners = triangle.map(|v| on.vertices[v as usize]);
        let found = out.len();
        for (part, at) in touch.parts.iter().enumerate() {
            if is_apart(&corners, &windows[part]) {
                continue;
            }
            let outward = area_vector(on, t);
            let known = remembered(touch.memory, first + t + part as u32 * touch.per_part);
            let (place, core) = at.nearest_in_triangle(&corners, known.map_or(-outward, |m| m.normal));
            let Some(weights) = weights_in_triangle(&corners, place) else { continue };
            // A corner is a point of its own already.
            if weights.iter().any(|w| *w > 0.999) {
                continue;
            }
            let place = corners[0] * weights[0] + corners[1] * weights[1] + corners[2] * weights[2];
            let core = core.unwrap_or_else(|| at.nearest(place));
            if touch.parts.len() > 1 && nearest_part(touch.parts, place).0 != part {
                continue;
            }
            if let Some(Side { point, normal, gap, core }) = touch.side(part, core, place, outward, first + t) {
                let stencil = std::array::from_fn(|i| (triangle[i], weights[i]));
                let (part, area) = (part as u32, (1.0 - VERTEX_SHARE) * 0.5 * outward.norm());
                out.push(Candidate { point, gap, normal, place, part, core, known: None, stencil, area });
            }
        }
        if out.len() > found + 1 {
            let sharing = (out.len() - found) as Real;
            out[found..].iter_mut().for_each(|c| c.area /= sharing);
        }
    }
}

/// True when the triangle lies wholly beyond one face of the box.
fn is_apart(corners: &[Vec3; 3], (low, high): &(Vec3, Vec3)) -> bool {
    (0..3).any(|c| corners.iter().all(|p| p[c] < low[c]) || corners.iter().all(|p| p[c] > high[c]))
}

/// Barycentric weights of the triangle's place `p`; `None` for a collapsed triangle.
fn weights_in_triangle(corners: &[Vec3; 3], p: Vec3) -> Option<[Real; 3]> {
    let (e1, e2, d) = (corners[1] - corners[0], corners[2] - corners[0], p - corners[0]);
    let (a, b, c) = (e1.norm_squared(), e1.dot(&e2), e2.norm_squared());
    let det = a * c - b * b;
    #[expect(clippy::neg_cmp_op_on_partial_ord, reason = "NaN, too, must leave here")]
    if !(det > 0.0) {
        return None;
    }
    let (r, s) = (e1.dot(&d), e2.dot(&d));
    let (w1, w2) = ((c * r - b * s) / det, (a * s - b * r) / det);
    Some([1.0 - w1 - w2, w1, w2])
}

/// True when the tool neither touches nor lies inside the closed surface `vertices`: where it may engage.
pub fn is_outside(on: &Touchable, shape: &Shape, pose: &Pose) -> bool {
    let (all, parts) = posed(pose, shape);
    all[..parts].iter().all(|at| is_part_outside(on, at))
}

fn is_part_outside(on: &Touchable, at: &Posed) -> bool {
    let radius = at.part.radius();
    let window = at.window(radius);
    let near = |p: Vec3, core: Vec3| (p - at.frame.at(core)).norm_squared() < radius * radius;
    if on.vertices.iter().any(|p| is_in(&window, p) && near(*p, at.nearest(*p))) {
        return false;
    }
    let grazes = on.body.surface().triangles.iter().any(|triangle| {
        let corners = triangle.map(|v| on.vertices[v as usize]);
        if is_apart(&corners, &window) {
            return false;
        }
        let (place, core) = at.nearest_in_triangle(&corners, Vec3::z());
        weights_in_triangle(&corners, place).is_some_and(|w| {
            let p = corners[0] * w[0] + corners[1] * w[1] + corners[2] * w[2];
            near(p, core.unwrap_or_else(|| at.nearest(p)))
        })
    });
    !grazes && !is_inside(on, at.frame.at(Vec3::zeros()))
}

/// True when `p` lies inside: three rays vote by the parity of their crossings, so that none decides alone.
fn is_inside(on: &Touchable, p: Vec3) -> bool {
    let mut crossings = [0u32; 3];
    for triangle in &on.body.surface().triangles {
        for (axis, count) in crossings.iter_mut().enumerate() {
            *count += u32::from(crosses(on.vertices, triangle, p, axis));
        }
    }
    crossings.iter().filter(|c| *c % 2 == 1).count() >= 2
}

/// True when the ray from `p`, nearly along +`axis`, meets the triangle.
///
/// The ray leans a little, so that it does not run along the edges of boxes and other regular shapes. A ray through an
/// edge meets exactly one of its two triangles: both ask on which side it passes with the edge's ends in the same order.
fn crosses(vertices: &[Vec3], triangle: &[u32; 3], p: Vec3, axis: usize) -> bool {
    let (i, j) = ((axis + 1) % 3, (axis + 2) % 3);
    let flat = |v: u32| {
        let d = vertices[v as usize] - p;
        (d[i] - 0.0173 * d[axis], d[j] - 0.0419 * d[axis])
    };
    // Twice the area of the ray's foot with the edge, and the side; positive counts as left, zero too.
    let side = |from: u32, to: u32| {
        let (a, b) = (flat(from.min(to)), flat(from.max(to)));
        let area = a.0 * b.1 - a.1 * b.0;
        if from < to { (area, area >= 0.0) } else { (-area, area < 0.0) }
    };
    let [a, b, c] = *triangle;
    let (to_a, to_b, to_c) = (side(b, c), side(c, a), side(a, b));
    if to_a.1 != to_b.1 || to_b.1 != to_c.1 {
        return false;
    }
    let height = |v: u32| vertices[v as usize][axis] - p[axis];
    let total = to_a.0 + to_b.0 + to_c.0;
    let weighted = to_a.0 * height(a) + to_b.0 * height(b) + to_c.0 * height(c);
    // The sign of weighted / total.
    (weighted > 0.0) == (total > 0.0) && weighted != 0.0
}
