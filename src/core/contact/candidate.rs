//! Places of the display surface near a tool that may become constraints, and on which side of them the tool is.
//!
//! A tool comes from outside, so whatever is behind a sheet of the surface that it touched has sunk below it, and pushes it
//! as before: what is remembered of each point tells the two apart, and where a thin tip slides on below the next
//! triangle, it is followed.

use super::posed::Posed;
use super::shape::MOST_PARTS;
use super::touchable::{FASTEST_SURFACE, Touchable, area_vector, weights_in_triangle};
use crate::ids::{Triangle, Vertex};
use crate::math::{Bounds, Real, Vec3};
use crate::model::constraint::PointMemory;
use crate::model::step_class::TICK;
use crate::model::{ActiveMesh, Body};
use crate::visited::Visited;

/// A constraint in the making.
#[derive(Clone, Copy, Debug)]
pub(super) struct Candidate {
    /// As [`Constraint::point`].
    pub(super) point: u32,
    /// Signed distance from the tool's surface [m].
    pub(super) gap: Real,
    pub(super) normal: Vec3,
    /// The surface point [m].
    pub(super) place: Vec3,
    /// Number of the tool's part.
    pub(super) part: u32,
    /// Coordinates of the place of the part's core that it is measured from.
    pub(super) core: Vec3,
    pub(super) sheet: Sheet,
    /// What is remembered of it: index into the memory.
    pub(super) known: Option<u32>,
    /// Display vertices and weights; one entry counts for a vertex.
    pub(super) stencil: [(Vertex, Real); 3],
    /// Surface area that the point stands for [m²].
    pub(super) area: Real,
    /// Part of its own area that a triangle's point has not left to the corners.
    pub(super) share: Real,
    /// That of points beside it that were left out [m²].
    pub(super) taken: Real,
    /// Where not all can be kept, those go first of which this is greater: apart from the tool, not of the last tick, a
    /// triangle's.
    pub(super) last: (bool, bool, bool),
}

impl Candidate {
    fn new(part: usize, side: Side, spot: &Spot, area: Real) -> Self {
        let Spot { place, stencil, .. } = *spot;
        let Side { point, normal, gap, core, sheet } = side;
        Self {
            point,
            gap,
            normal,
            place,
            part: part as u32,
            core,
            sheet,
            known: None,
            stencil,
            area,
            share: 1.0,
            taken: 0.0,
            last: Default::default(),
        }
    }

    /// The place of its triangle with other `weights` [m].
    pub(super) fn at(&self, on: &Touchable, weights: [Real; 3]) -> Vec3 {
        self.stencil.iter().zip(weights).map(|(s, w)| on.vertices[s.0.index()] * w).sum()
    }

    pub(super) fn stencil(&self) -> &[(Vertex, Real)] {
        stencil_of(&self.stencil)
    }

    /// Squared distance [m²], as far as it tells whether one of two points can stand for the other: more where their normals
    /// differ, and without bound to a point of another part or side of the tool.
    pub(super) fn away(&self, other: &Candidate) -> Real {
        let alike = self.part == other.part && self.normal.dot(&other.normal) > ALIKE;
        let turned = (self.normal - other.normal) * TURNED;
        if alike { (self.place - other.place).norm_squared() + turned.norm_squared() } else { Real::INFINITY }
    }

    /// Takes the area of `other`, which is left out, and the mean of both normals.
    pub(super) fn stand_for(&mut self, other: &Candidate) {
        self.taken += other.area;
        let part = other.area / (self.area + self.taken).max(Real::MIN_POSITIVE);
        self.normal = (self.normal + (other.normal - self.normal) * part).normalize();
    }

    /// True for a point of another place of the same sheet: their triangles or vertices meet.
    fn meets(&self, other: &Candidate) -> bool {
        self.stencil().iter().any(|(v, _)| other.stencil().iter().any(|(w, _)| v == w))
    }

    /// True for a place inside a triangle.
    fn is_within(&self) -> bool {
        self.stencil().len() == 3 && self.stencil.iter().all(|(_, w)| *w > ON_EDGE)
    }
}

fn stencil_of(stencil: &[(Vertex, Real); 3]) -> &[(Vertex, Real)] {
    if stencil[0].1 == 1.0 { &stencil[..1] } else { &stencil[..] }
}

/// Cosine between two normals up to which they count as those of one contact.
pub(super) const ALIKE: Real = 0.5;

/// Distance as which a normal counts that is another by one radian [m]: on a wide tool, rims need more points than faces.
const TURNED: Real = 5e-3;

/// How far the place in a triangle that a solid core pushes the most goes within a tick beyond the core's own way [m]: the
/// deepest place inside of a core jumps.
const MOST_HOP: Real = 1e-4;

/// Weight of a corner below which a place counts as on the edge opposite.
const ON_EDGE: Real = 1e-3;

/// On which side of its sheet of the surface a core is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Sheet {
    /// Outside.
    Front,
    /// It came from outside and is behind the sheet now.
    Sunk,
    /// Behind a sheet that it did not touch so far: that of a far side, or one next to a sheet that it has sunk below.
    Behind,
    /// Not in front of a sheet that it did not touch so far, as beside an edge of the body.
    Beside,
    /// Not in front of a sheet that it touched: it has gone around an edge of the body, or through it there.
    Turned,
}

/// A tool near a surface, and what it touched before.
pub(super) struct Touch<'a> {
    pub(super) parts: &'a [Posed<'a>],
    /// How far any point of each part moves in this tick at most [m].
    pub(super) ways: [Real; MOST_PARTS],
    /// Change of the tool's force that is not felt [N].
    pub(super) noticeable: Real,
    /// Points with a gap up to this become constraints [m].
    pub(super) margin: Real,
    /// How deep the tool has sunk below what it touched [m].
    pub(super) deep: Real,
    pub(super) per_part: u32,
    pub(super) memory: &'a [PointMemory],
}

/// How deep any core is behind any of the points that it touched at the last tick [m].
pub(super) fn sunk_depth(body: &Body, mesh: &ActiveMesh, parts: &[Posed], memory: &[PointMemory]) -> Real {
    let (vertices, per_part) = (body.surface().vertices.len() as u32, body.points_of_a_part());
    let depth = |m: &PointMemory| {
        let (part, point) = ((m.point / per_part) as usize, m.point % per_part);
        let place = match point.checked_sub(vertices) {
            None => mesh.vertex(Vertex(point)),
            Some(t) => {
                let corners = body.triangle(Triangle(t)).map(|v| mesh.vertex(v));
                place_in(&corners, m.weights)
            }
        };
        let Some(at) = parts.get(part) else { return 0.0 };
        let away = place - at.frame.at(at.nearest(place));
        if away.dot(&m.normal) < 0.0 { away.norm() } else { 0.0 }
    };
    memory.iter().map(depth).fold(0.0, Real::max)
}

impl Touch<'_> {
    /// Boxes around everything that each part may touch, grown by `more`.
    pub(super) fn windows(&self, more: Real) -> [Bounds; MOST_PARTS] {
        let mut windows = [Bounds::NOTHING; MOST_PARTS];
        for (window, at) in windows.iter_mut().zip(self.parts) {
            *window = at.window(at.part.radius() + self.margin + self.deep + more);
        }
        windows
    }

    /// Where the `nearest` part touches the surface's `spot`, or `None` where it is out of reach or its sheet of the surface is
    /// not one that the tool pushes. `base`: the point's number on the first part.
    ///
    /// A point that was touched stays touched: should the core itself slip below the surface, the point is still pushed
    /// the way it was, instead of being let go. A core that has come behind a sheet around its rim has not slipped: the
    /// last normal did not point into that sheet.
    fn side(&self, on: &Touchable, nearest: Nearest, spot: &Spot, base: u32) -> Option<Side> {
        let (Nearest { part, core }, Spot { place, outward, stencil }) = (nearest, *spot);
        let at = &self.parts[part];
        let (from, radius) = (at.frame.at(core), at.part.radius());
        let away = place - from;
        let distance = away.norm();
        if distance > radius + self.margin + self.deep {
            return None;
        }
        let inside = distance <= 1e-9;
        let normal = if inside { -outward.normalize() } else { away / distance };
        let point = base + part as u32 * self.per_part;
        let known = remembered(self.memory, point);
        let turned = normal.dot(&outward) >= 0.0;
        let behind = turned && is_behind(on, from, stencil_of(&stencil));
        // What a solid core passes gets inside of it first, unless it is thin and fast; what is beside its wall has not been.
        let leaps = FASTEST_SURFACE * TICK + self.ways[part] > at.part.half_thickness();
        let passed = |m: &PointMemory| leaps && m.normal.dot(&normal) < -ALIKE;
        let sheet = match known {
            Some(m) if behind && m.normal.dot(&outward) < 0.0 && passed(m) => Sheet::Sunk,
            // A thin tip that slides fast turns its normal, and so does one that is through an edge.
            Some(m) if m.normal.dot(&normal) < 0.0 => Sheet::Turned,
            _ if !turned => Sheet::Front,
            Some(_) => Sheet::Turned,
            None if behind => Sheet::Behind,
            None => Sheet::Beside,
        };
        let front = matches!(sheet, Sheet::Front | Sheet::Turned);
        // A point that pushes does not turn at once, as long as that does not draw it into the core.
        let follows = |m: &PointMemory| towards(m.normal, normal, self.noticeable / m.multiplier).try_normalize(0.1);
        let bit_by_bit = known.filter(|_| front).and_then(follows).filter(|n| n.dot(&away) > -radius);
        let normal = bit_by_bit.unwrap_or(normal);
        let (normal, gap) = if front { (normal, normal.dot(&away) - radius) } else { (-normal, -distance - radius) };
        let side = Side { point, normal, gap, core, sheet };
        let side = if inside || !front { pushed_out(at, place, side, known.filter(|_| inside)) } else { side };
        // In a dent, what is beside the wall of a vertex's triangles may be below it all the same: `follow_sunk` finds out.
        Some(side).filter(|side| side.gap <= self.margin || side.sheet == Sheet::Turned)
    }
}

/// The place of a triangle with these barycentric `weights`.
fn place_in(corners: &[Vec3; 3], weights: [Real; 3]) -> Vec3 {
    corners[0] * weights[0] + corners[1] * weights[1] + corners[2] * weights[2]
}

/// From `from` to `to`, but no farther than `most`.
fn towards(from: Vec3, to: Vec3, most: Real) -> Vec3 {
    let way = to - from;
    let length = way.norm();
    if length > most { from + way * (most / length) } else { to }
}

/// True when `p` is behind all triangles that meet in the place of the `stencil`: inside the body, if it is near.
fn is_behind(on: &Touchable, p: Vec3, stencil: &[(Vertex, Real)]) -> bool {
    let mut meeting = stencil.iter().filter(|(_, w)| *w > ON_EDGE).map(|s| s.0);
    let Some(first) = meeting.next() else { return false };
    on.body.triangles_around(first).iter().all(|t| {
        let triangle = on.body.triangle(*t);
        let meets = meeting.clone().all(|v| triangle.contains(&v));
        !meets || area_vector(on, *t).dot(&(p - on.vertices[first.index()])) < 0.0
    })
}

/// A core that has sunk below the surface somewhere has sunk below the sheets that meet there, too: else a thin part would
/// be lost at the next triangle. Of edges and corners only those nearest to it count.
///
/// That holds down to four times the `margin` [m] only: a surface that still clung to a tool deep inside would be turned
/// inside out by it.
pub(super) fn follow_sunk(margin: Real, candidates: &mut Vec<Candidate>) {
    spread(4.0 * margin, candidates);
    candidates.retain(|c| !matches!(c.sheet, Sheet::Behind | Sheet::Beside) && c.gap <= margin);
    let mut i = 0;
    while i < candidates.len() {
        let c = candidates[i];
        let better = |o: &Candidate| o.is_within() || o.gap > c.gap + 1e-9;
        let nearer = |o: &Candidate| o.sheet == Sheet::Sunk && o.part == c.part && better(o) && o.meets(&c);
        let same = |o: &Candidate| o.sheet == Sheet::Sunk && o.point == c.point;
        let gives_way = match c.sheet {
            Sheet::Sunk => !c.is_within() && candidates.iter().any(nearer),
            _ => candidates.iter().any(same),
        };
        if gives_way {
            candidates.remove(i);
        } else {
            i += 1;
        }
    }
}

/// From sheets that a core has sunk below to those that meet them, which the part's far side is no more than `deepest` [m]
/// behind.
fn spread(deepest: Real, candidates: &mut [Candidate]) {
    for _ in 0..FOLLOWED {
        let mut more = false;
        for i in 0..candidates.len() {
            let c = candidates[i];
            let follows = |o: &Candidate| {
                o.sheet == Sheet::Sunk && o.part == c.part && o.meets(&c) && o.normal.dot(&c.normal) > 0.0
            };
            if c.sheet == Sheet::Behind && c.gap > -deepest && candidates.iter().any(follows) {
                candidates[i].sheet = Sheet::Sunk;
                more = true;
            }
        }
        if !more {
            break;
        }
    }
}

/// Rings of triangles around the sunk ones of the last tick that are followed in one tick.
const FOLLOWED: usize = 3;

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
    sheet: Sheet,
}

/// A place inside of a solid core, or past it, is pushed out all the way, along `known`'s normal where there is one.
fn pushed_out(at: &Posed, place: Vec3, side: Side, known: Option<&PointMemory>) -> Side {
    let normal = known.map_or(side.normal, |m| m.normal);
    match at.exit(place, normal) {
        Some((core, way)) => Side { normal, core, gap: -way - at.part.radius(), ..side },
        None => side,
    }
}

fn remembered(memory: &[PointMemory], point: u32) -> Option<&PointMemory> {
    memory.binary_search_by_key(&point, |m| m.point).ok().map(|i| &memory[i])
}

/// Part of a triangle's area that is its own point's, far from all corners.
const OWN_SHARE: Real = 0.5;

/// A place of the surface.
#[derive(Clone, Copy, Debug)]
struct Spot {
    /// [m].
    place: Vec3,
    /// Out of the body there, of any length.
    outward: Vec3,
    /// As [`Candidate::stencil`].
    stencil: [(Vertex, Real); 3],
}

/// The part of a tool that is nearest to a place.
#[derive(Clone, Copy, Debug)]
struct Nearest {
    part: usize,
    /// Coordinates of its core's nearest point.
    core: Vec3,
}

/// Part whose surface is nearest to `place`.
fn nearest_part(parts: &[Posed], place: Vec3) -> Nearest {
    let mut best = (Nearest { part: 0, core: Vec3::zeros() }, Real::INFINITY);
    for (i, at) in parts.iter().enumerate() {
        let core = at.nearest(place);
        let gap = (place - at.frame.at(core)).norm() - at.part.radius();
        if gap < best.1 {
            best = (Nearest { part: i, core }, gap);
        }
    }
    best.0
}

/// Adds to the list what there is room for: a tick allocates nothing.
fn put(out: &mut Vec<Candidate>, candidate: Candidate) {
    if out.len() < out.capacity() {
        out.push(candidate);
    }
}

pub(super) fn near_vertices(on: &Touchable, touch: &Touch, near: &[Vertex], out: &mut Vec<Candidate>) {
    let windows = touch.windows(0.0);
    for &v in near {
        let place = on.vertices[v.index()];
        if !windows[..touch.parts.len()].iter().any(|w| w.contains(&place)) {
            continue;
        }
        let nearest = match touch.parts {
            [at] => Nearest { part: 0, core: at.nearest(place) },
            parts => nearest_part(parts, place),
        };
        if !touch.parts[nearest.part].is_solid() {
            continue;
        }
        let outward: Vec3 = on.body.triangles_around(v).iter().map(|t| area_vector(on, *t)).sum();
        let spot = Spot { place, outward, stencil: [(v, 1.0), (Vertex(0), 0.0), (Vertex(0), 0.0)] };
        if let Some(side) = touch.side(on, nearest, &spot, v.0) {
            let area = on.body.vertex_area()[v.index()];
            put(out, Candidate::new(nearest.part, side, &spot, area));
        }
    }
}

/// Points inside triangles: between three vertices the surface could otherwise pass through the tool unfelt. Each part
/// that is the nearest somewhere in a triangle has a point of its own there, and they share the area.
pub(super) fn near_triangles(
    on: &Touchable,
    touch: &Touch,
    near: &[Vertex],
    seen: &mut Visited,
    out: &mut Vec<Candidate>,
) {
    let windows = touch.windows(0.0);
    let first = on.vertices.len() as u32;
    let around = near.iter().flat_map(|v| on.body.triangles_around(*v));
    for &t in around {
        if !seen.visit(t.index()) {
            continue;
        }
        let triangle = on.body.triangle(t);
        let corners = triangle.map(|v| on.vertices[v.index()]);
        let found = out.len();
        for (part, at) in touch.parts.iter().enumerate() {
            if !at.is_solid() || windows[part].is_apart(&corners) {
                continue;
            }
            let outward = area_vector(on, t);
            let known = remembered(touch.memory, first + t.0 + part as u32 * touch.per_part);
            let (place, _) = at.nearest_in_triangle(&corners, known.map_or(-outward, |m| m.normal));
            let hops = |m: &PointMemory| towards(place_in(&corners, m.weights), place, touch.ways[part] + MOST_HOP);
            let place = known.filter(|m| m.multiplier > 0.0).map_or(place, hops);
            let Some(weights) = weights_in_triangle(&corners, place) else { continue };
            // A corner is a point of its own already.
            if weights.iter().any(|w| *w > 0.999) {
                continue;
            }
            let place = place_in(&corners, weights);
            let core = at.nearest(place);
            if touch.parts.len() > 1 && nearest_part(touch.parts, place).part != part {
                continue;
            }
            let stencil = std::array::from_fn(|i| (triangle[i], weights[i]));
            let spot = Spot { place, outward, stencil };
            let side = touch.side(on, Nearest { part, core }, &spot, first + t.0);
            let area = OWN_SHARE * 0.5 * outward.norm();
            side.into_iter().for_each(|side| put(out, Candidate::new(part, side, &spot, area)));
        }
        if touch.parts.len() > 1 && out.len() > found + 1 {
            let sharing = (out.len() - found) as Real;
            out[found..].iter_mut().for_each(|c| c.area /= sharing);
        }
    }
}
