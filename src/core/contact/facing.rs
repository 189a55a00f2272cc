//! What faces a patch of the surface: the nearest place of another organ, or of its own across what is outside of both.

use super::detection::MOST_STRETCH;
use super::touchable::{Touchable, weights_in_triangle};
use crate::ids::{Triangle, Vertex};
use crate::math::{Real, Vec3, from_parry, to_parry};
use crate::model::body::patches::{Extent, SAME_SIDE};
use crate::model::{ActiveMesh, Body};
use crate::visited::Visited;
use parry3d_f64::query::PointQuery;
use parry3d_f64::shape::Triangle as Flat;
use std::ops::Range;

/// Least cosine between the normal of a triangle and what comes against that of a patch: an edge's patches, whose normals are between
/// those of its sides, meet what lies flat against a side, and not what is beside it.
const FACING: Real = 0.1;
/// Steps from triangle to triangle that a place takes within a tick at most.
const MOST_STEPS: usize = 4;
/// A way this much off a triangle's normal is along it, but for rounding.
const STRAIGHT: Real = 1e-6;

/// A body as it is displayed now.
#[derive(Clone, Copy, Debug)]
pub(super) struct Now<'a> {
    pub(super) body: &'a Body,
    pub(super) mesh: &'a ActiveMesh,
}

/// What is known of the surface in a tick, and memory that a look needs.
#[derive(Debug)]
pub(super) struct Workspace {
    /// Display vertices [m], (n_vertices); only those that are placed count.
    vertices: Vec<Vec3>,
    placed: Visited,
    /// Of each patch the vertex in its middle [m].
    pub(super) middles: Vec<Vec3>,
    /// Twice the area vectors of display triangles [m²], (n_triangles); only those that are measured count.
    areas: Vec<Vec3>,
    measured: Visited,
    /// Triangles that the patch which follows has looked at.
    seen: Visited,
    /// Patches that the one which looks does not meet.
    pub(super) beside: Visited,
    /// Patches that may be near the place that is looked from, and the squared distances of their middles [m²].
    candidates: Vec<(u32, Real)>,
}

impl Workspace {
    /// For `body`.
    pub(super) fn new(body: &Body) -> Self {
        let (patches, triangles) = (body.patches().count() as usize, body.surface().triangles.len());
        Self {
            vertices: body.surface().vertices.clone(),
            placed: Visited::new(body.surface().vertices.len()),
            middles: Vec::with_capacity(patches),
            areas: vec![Vec3::zeros(); triangles],
            measured: Visited::new(triangles),
            seen: Visited::new(triangles),
            beside: Visited::new(patches),
            candidates: Vec::with_capacity(patches),
        }
    }

    /// Another tick begins.
    pub(super) fn begin(&mut self, Now { body, mesh }: Now) {
        self.placed.clear();
        self.measured.clear();
        self.middles.clear();
        let patches = 0..body.patches().count();
        self.middles.extend(patches.map(|i| mesh.vertex(body.patches().middle(i))));
    }

    /// Where display vertex `v` is [m].
    fn at(&mut self, now: Now, v: Vertex) -> Vec3 {
        if self.placed.visit(v.index()) {
            self.vertices[v.index()] = now.mesh.vertex(v);
        }
        self.vertices[v.index()]
    }

    /// Twice the area vector of display triangle `t` [m²].
    fn area(&mut self, now: Now, t: Triangle) -> Vec3 {
        if self.measured.visit(t.index()) {
            let [a, b, c] = now.body.triangle(t).map(|v| self.at(now, v));
            self.areas[t.index()] = (b - a).cross(&(c - a));
        }
        self.areas[t.index()]
    }

    fn face(&mut self, now: Now, t: Triangle) -> Face {
        Face { triangle: t, corners: now.body.triangle(t).map(|v| self.at(now, v)), area: self.area(now, t) }
    }

    /// Readies a look from `place` [m] at those of the `patches` that may be no farther than `near` [m].
    fn measure(&mut self, body: &Body, place: Vec3, near: Real, patches: Range<u32>) {
        self.candidates.clear();
        for i in patches {
            let away = (self.middles[i as usize] - place).norm_squared();
            let far = near + MOST_STRETCH * body.patches().extent(i).reach;
            if away <= far * far && !self.beside.contains(i as usize) {
                self.candidates.push((i, away));
            }
        }
    }

    /// The displayed surface, which takes less where it has been placed.
    pub(super) fn shown<'a>(&'a self, Now { body, mesh }: Now<'a>) -> Touchable<'a> {
        Touchable { body, mesh, vertices: &self.vertices, near: &self.placed }
    }
}

/// A patch where it is now.
pub(super) struct Patch {
    /// Its mean place [m].
    pub(super) place: Vec3,
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
    /// Its place that is nearest to `p` [m].
    fn nearest(&self, p: Vec3) -> Vec3 {
        let [a, b, c] = self.corners.map(to_parry);
        from_parry(Flat::new(a, b, c).project_local_point(to_parry(p), false).point)
    }
}

/// The place of another organ that is next to a patch.
pub(super) struct Seen {
    squared: Real,
    pub(super) triangle: Triangle,
    pub(super) weights: [Real; 3],
    pub(super) gap: Real,
    pub(super) normal: Vec3,
    /// How much of the patch meets it.
    pub(super) share: Real,
}

impl Patch {
    /// `None` where it has no normal.
    pub(super) fn of(now: Now, i: u32, work: &mut Workspace) -> Option<Self> {
        let body = now.body;
        let (all, middle) = (body.patches().of(i), body.patches().middle(i));
        let mut normal = Vec3::zeros();
        for t in body.triangles_around(middle) {
            normal += work.area(now, *t);
        }
        let place = all.iter().map(|(v, w)| work.at(now, *v) * *w).sum();
        Some(Self { place, normal: normal.try_normalize(0.0)?, radius: body.patches().radius(i) })
    }

    /// What is next to it beside what was next to it a tick ago.
    pub(super) fn follow(&self, now: Now, was: Triangle, work: &mut Workspace) -> Option<Seen> {
        let body = now.body;
        let mut best: Option<Seen> = None;
        let mut at = was;
        work.seen.clear();
        for _ in 0..MOST_STEPS {
            for t in [at].iter().chain(body.triangle(at).iter().flat_map(|v| body.triangles_around(*v))) {
                if work.seen.visit(t.index()) {
                    self.consider(&work.face(now, *t), false, &mut best);
                }
            }
            match best.as_ref().map(|seen| seen.triangle) {
                Some(next) if next != at => at = next,
                _ => break,
            }
        }
        best.and_then(|seen| self.met(now, seen, work))
    }

    /// What is next to it on the `patches`, if it is near; of its `own` organ only what faces it across what is outside of it.
    pub(super) fn look(
        &self,
        now: Now,
        near: Real,
        patches: Range<u32>,
        own: bool,
        work: &mut Workspace,
    ) -> Option<Seen> {
        let body = now.body;
        let mut best: Option<Seen> = None;
        work.measure(body, self.place, near, patches);
        // From the nearest middle on: what is found there leaves most of the rest too far.
        let first =
            (0..work.candidates.len()).min_by(|i, j| work.candidates[*i].1.total_cmp(&work.candidates[*j].1))?;
        work.candidates.swap(0, first);
        for k in 0..work.candidates.len() {
            let far = best.as_ref().map_or(near, |seen| seen.squared.sqrt().min(near));
            self.near(now, k, far, work, |face| self.consider(&face, own, &mut best));
        }
        let seen = best?;
        let seen = self.met(now, seen, work).filter(|seen| seen.gap.abs() < near)?;
        // Behind what faces it, but outside: on the far side of a thin organ.
        (seen.gap >= 0.0 || !self.is_outside(now, &seen, work)).then_some(seen)
    }

    /// Whether the patch is in front of the triangle of the candidates that is nearest of all, whichever way it faces, where that is nearer
    /// than what was `seen`.
    fn is_outside(&self, now: Now, seen: &Seen, work: &mut Workspace) -> bool {
        let mut nearest = (seen.squared * (1.0 - STRAIGHT), false);
        for k in 0..work.candidates.len() {
            self.near(now, k, seen.squared.sqrt(), work, |face| {
                let away = self.place - face.nearest(self.place);
                if away.norm_squared() < nearest.0 {
                    nearest = (away.norm_squared(), face.area.dot(&away) > 0.0);
                }
            });
        }
        nearest.1
    }

    /// Calls `with` each triangle of candidate `k` of which some place may be no farther than `far` [m].
    fn near(&self, now: Now, k: usize, far: Real, work: &mut Workspace, mut with: impl FnMut(Face)) {
        let body = now.body;
        let (i, away) = work.candidates[k];
        let Extent { reach, edge } = body.patches().extent(i);
        if away > (far + MOST_STRETCH * reach).powi(2) {
            return;
        }
        let most = (far + MOST_STRETCH * edge).powi(2);
        for t in body.patches().triangles(i) {
            let corners = body.triangle(*t);
            if (work.at(now, corners[0]) - self.place).norm_squared() <= most {
                with(work.face(now, *t));
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
    fn met(&self, now: Now, seen: Seen, work: &mut Workspace) -> Option<Seen> {
        let normal = smooth_normal(now, seen.triangle, seen.weights, work)?;
        let away = self.place - work.shown(now).displayed(seen.triangle, seen.weights);
        let flat = work.area(now, seen.triangle).try_normalize(0.0)?;
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
fn smooth_normal(now: Now, t: Triangle, weights: [Real; 3], work: &mut Workspace) -> Option<Vec3> {
    let body = now.body;
    let flat = work.area(now, t).try_normalize(0.0)?;
    let mut sum = Vec3::zeros();
    for (v, w) in body.triangle(t).into_iter().zip(weights) {
        let around = body.triangles_around(v).iter().map(|t| work.area(now, *t));
        let side: Vec3 = around.filter(|area| area.dot(&flat) > SAME_SIDE * area.norm()).sum();
        sum += side.try_normalize(0.0)? * w;
    }
    sum.try_normalize(0.0)
}
