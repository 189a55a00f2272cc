//! Where a ball touches the surface, as samples on the ball: rings about each direction in which it pushes, as wide as the disc that
//! it touches there.
//!
//! The samples follow the tool and not the displayed triangles: they neither come nor go while the tool slides, and each touches the
//! surface wherever that is straight ahead of it. The surface is the one of the mesh, through rows of nodes around each place
//! ([`crate::model::contact_row`]), plus what the mesh leaves out of the samples' own loads ([`super::influence`]).

use super::closing::{Closing, UNNOTICED};
use super::influence::{potential, variance_of_disc};
use super::posed::Posed;
use super::rigid::{Found, Rigid};
use super::touchable::{Touchable, area_vector};
use super::wrench::middle_pose;
use crate::ids::{Triangle, Vertex};
use crate::math::{Real, Vec3};
use crate::model::constraint::{Constraint, Firming, Friction, MOST_POINTS, PointMemory, Pushed};
use crate::model::contact_row::{DEVIATION, Surroundings};
use crate::model::step_class::TICK;
use crate::model::{Body, Material, Row};
use std::f64::consts::PI;

/// Rings of samples around the middle one of a disc; ring `k` has `6k`, so that all stand for about the same area.
const RINGS: usize = 2;
/// Samples of one disc.
const SAMPLES: usize = 1 + 3 * RINGS * (RINGS + 1);
/// Most discs of one ball: in a corner it touches three faces.
const MOST_DISCS: usize = MOST_POINTS / SAMPLES;

/// What samples need and no one keeps.
#[derive(Debug)]
pub(super) struct Samples {
    /// Places on the plane: distance in widths of rings, and the unit vector there.
    pattern: [(Real, [Real; 2]); SAMPLES],
    around: Surroundings,
    discs: Vec<Disc>,
    /// Of all discs, one after the other.
    found: Vec<Sample>,
}

/// Where a ball touches a part of the surface that faces it.
#[derive(Clone, Copy, Debug)]
struct Disc {
    /// The direction in which it pushes.
    ahead: Vec3,
    /// Of the outermost samples from the axis [m].
    cap: Real,
    /// How far from the axis the surface of the mesh may overlap the ball [m].
    reach: Real,
    /// As [`Material::half_space`], with what large strain adds [m²/N].
    compliance: Real,
    /// Variance of a load as the mesh shows it [m²].
    shown: Real,
    /// Poisson's ratio.
    nu: Real,
}

/// A place of the tool and what is ahead of it.
#[derive(Clone, Copy, Debug)]
struct Sample {
    disc: u32,
    /// From the tool towards the surface.
    normal: Vec3,
    /// From the ball's centre [m].
    arm: Vec3,
    /// Area that it stands for [m²]; none where the surface ends.
    area: Real,
    /// Variance of its load [m²].
    variance: Real,
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
    /// Last multiplier [N].
    multiplier: Real,
}

/// Where the tool looks at the surface from, and how: along `ahead`, `across` being right-handed with it.
#[derive(Clone, Copy, Debug)]
struct View {
    ahead: Vec3,
    across: [Vec3; 2],
}

/// Where a walk over the surface ends.
#[derive(Clone, Copy, Debug)]
struct End {
    triangle: Triangle,
    /// Barycentric weights of the place that was looked for, or of the nearest one of the edge at which the surface ends.
    weights: [Real; 3],
    /// How far before the place that edge is, as it is seen [m]; zero where the place was found.
    beyond: Real,
}

impl View {
    /// Along `ahead`; `near` says which way the first axis goes, as far as that is possible.
    fn new(ahead: Vec3, near: Vec3) -> Self {
        let other = if ahead.x.abs() < 0.7 { Vec3::x() } else { Vec3::y() };
        let flat = |v: Vec3| v - ahead * ahead.dot(&v);
        let first = flat(near).try_normalize(1e-6).unwrap_or_else(|| flat(other).normalize());
        Self { ahead, across: [first, ahead.cross(&first)] }
    }

    /// Walks from a triangle over the surface as it is seen towards the place ahead of `place` [m], and ends where the surface goes
    /// around an edge behind which it is not seen.
    fn walk(&self, on: &Touchable, from: Triangle, place: Vec3) -> End {
        let mut at = from;
        let [u, v] = self.across;
        for _ in 0..MOST_STEPS {
            let triangle = on.body.triangle(at);
            let corners = triangle.map(|c| {
                let away = on.mesh.vertex(c) - place;
                [away.dot(&u), away.dot(&v)]
            });
            // Twice the area that the place has with each side, above zero inside of what faces the tool.
            let side = |i: usize, j: usize| corners[i][1] * corners[j][0] - corners[i][0] * corners[j][1];
            let sides = [side(1, 2), side(2, 0), side(0, 1)];
            let area: Real = sides.iter().sum();
            if area <= 0.0 {
                break;
            }
            let weights = sides.map(|s| s / area);
            let out = weights.iter().enumerate().min_by(|a, b| a.1.total_cmp(b.1)).map_or(0, |(i, _)| i);
            if weights[out] >= -INSIDE {
                return End { triangle: at, weights, beyond: 0.0 };
            }
            let (i, j) = ((out + 1) % 3, (out + 2) % 3);
            let has = |t: &&Triangle| **t != at && on.body.triangle(**t).contains(&triangle[j]);
            let next = on.body.triangles_around(triangle[i]).iter().find(has);
            match next.filter(|t| outward(on, **t).dot(&self.ahead) < 0.0) {
                Some(next) => at = *next,
                None => return end(at, corners, [out, i, j]),
            }
        }
        End { triangle: at, weights: [1.0 / 3.0; 3], beyond: Real::INFINITY }
    }

    /// How far [m] the surface ends beyond what is ahead of `place`, on which the walk has found it, as far as that is within
    /// `reach` [m]; below zero.
    fn margin(&self, on: &Touchable, from: Triangle, place: Vec3, reach: Real) -> Real {
        let [u, v] = self.across;
        let mut nearest = reach;
        for [x, y] in AROUND {
            let aside = (u * x + v * y) * reach;
            let end = self.walk(on, from, place + aside);
            if end.beyond > 0.0 && end.beyond.is_finite() {
                // The edge is that far before a place which lies `reach` away.
                let corners = on.body.triangle(end.triangle).map(|c| on.mesh.vertex(c));
                let border: Vec3 = corners.iter().zip(end.weights).map(|(c, w)| c * w).sum();
                let across = border - (place + aside);
                let flat = across - self.ahead * self.ahead.dot(&across);
                let straight = flat.try_normalize(1e-12).map_or(0.0, |n| -n.dot(&aside));
                nearest = nearest.min((straight - end.beyond).max(0.0));
            }
        }
        -nearest
    }
}

/// The end at the side between the corners `i` and `j` of a triangle, `out` being the third, as seen from a place at the origin.
fn end(triangle: Triangle, corners: [[Real; 2]; 3], [out, i, j]: [usize; 3]) -> End {
    let (a, b) = (corners[i], corners[j]);
    let along = [b[0] - a[0], b[1] - a[1]];
    let length = along[0] * along[0] + along[1] * along[1];
    let part = (-(a[0] * along[0] + a[1] * along[1]) / length.max(Real::MIN_POSITIVE)).clamp(0.0, 1.0);
    let nearest = [a[0] + part * along[0], a[1] + part * along[1]];
    let mut weights = [0.0; 3];
    (weights[out], weights[i], weights[j]) = (0.0, 1.0 - part, part);
    End { triangle, weights, beyond: (nearest[0] * nearest[0] + nearest[1] * nearest[1]).sqrt() }
}

/// Part of a disc of radius one that lies on the near side of a straight edge `beyond` its middle: 1 from -1 on, 0 from 1 on.
fn part_before(beyond: Real) -> Real {
    let x = beyond.clamp(-1.0, 1.0);
    (libm::acos(x) - x * (1.0 - x * x).sqrt()) / PI
}

/// A ball that may touch.
#[derive(Clone, Copy, Debug)]
pub(super) struct Ball<'a> {
    pub(super) at: &'a Posed<'a>,
    /// Its centre at the start and at the end of the tick [m].
    pub(super) moves: [Vec3; 2],
    /// Up to this far away it is looked at [m].
    pub(super) margin: Real,
}

/// Where the surface is about to be touched: a triangle, how it is looked at, and what it was pushed with [N].
#[derive(Clone, Copy, Debug)]
struct Ahead {
    triangle: Triangle,
    view: View,
    load: Real,
    /// What is remembered of its first sample.
    known: Option<u32>,
}

impl Samples {
    pub(super) fn new(body: &Body) -> Self {
        let mut pattern = [(0.0, [1.0, 0.0]); SAMPLES];
        for ring in 1..=RINGS {
            let first = 1 + 3 * ring * (ring - 1);
            for i in 0..6 * ring {
                let (sin, cos) = libm::sincos(2.0 * PI * i as Real / (6 * ring) as Real);
                pattern[first + i] = (ring as Real, [cos, sin]);
            }
        }
        let found = Vec::with_capacity(MOST_DISCS * SAMPLES);
        Self { pattern, around: Surroundings::new(body), discs: Vec::with_capacity(MOST_DISCS), found }
    }

    /// Finds the samples of a ball: on the discs that it touched a tick ago, of which `memory` holds the points, and on a new one where
    /// it overlaps the surface beside those. `near` are the triangles that it may touch.
    pub(super) fn find(
        &mut self,
        on: &Touchable,
        ball: &Ball,
        memory: &[PointMemory],
        near: impl Iterator<Item = Triangle>,
    ) {
        self.found.clear();
        self.discs.clear();
        for (i, known) in memory.chunks(SAMPLES).enumerate() {
            if let Some(ahead) = still_ahead(on, ball, known, (i * SAMPLES) as u32) {
                let is_covered = |disc: &Disc| disc.covers(ahead.view.ahead * ball.at.part.radius(), disc.cap);
                if !self.discs.iter().any(is_covered) {
                    self.look(on, ball, memory, &ahead);
                }
            }
        }
        if self.discs.len() < MOST_DISCS
            && let Some(ahead) = self.new_ahead(on, ball, near)
        {
            self.look(on, ball, memory, &ahead);
        }
    }

    /// Where the ball touches the surface next beside the discs that there are: at first what is nearest.
    fn new_ahead(&self, on: &Touchable, ball: &Ball, near: impl Iterator<Item = Triangle>) -> Option<Ahead> {
        let (radius, centre) = (ball.at.part.radius(), ball.at.middle());
        let mut nearest = (if self.discs.is_empty() { ball.margin } else { -UNNOTICED }, None);
        for t in near {
            let corners = on.body.triangle(t).map(|v| on.vertices[v.index()]);
            let outward = area_vector(on, t);
            let (place, _) = ball.at.nearest_in_triangle(&corners, -outward);
            let away = place - centre;
            let mut gap = away.norm() - radius;
            if outward.dot(&away) >= 0.0 || gap >= nearest.0 || self.discs.iter().any(|d| d.covers(away, d.reach)) {
                continue;
            }
            if !self.discs.is_empty() {
                gap += self.dent(away, away.normalize());
            }
            if gap < nearest.0 {
                nearest = (gap, Some((t, away)));
            }
        }
        let (triangle, away) = nearest.1?;
        Some(Ahead { triangle, view: View::new(away.normalize(), Vec3::zeros()), load: 0.0, known: None })
    }

    /// What the mesh leaves out of the dent of all samples [m] at `away` from the ball's centre [m], along `normal`.
    fn dent(&self, away: Vec3, normal: Vec3) -> Real {
        let from = |sample: &Sample| {
            let disc = &self.discs[sample.disc as usize];
            let apart = (away - sample.arm).norm_squared();
            let left_out = potential(apart, sample.variance) - potential(apart, 2.0 * disc.shown.max(sample.variance));
            disc.compliance * left_out * normal.dot(&sample.normal).max(0.0) * sample.multiplier
        };
        self.found.iter().filter(|sample| sample.multiplier > 0.0).map(from).sum()
    }

    /// Adds a disc, and its samples, where something is `ahead`.
    fn look(&mut self, on: &Touchable, ball: &Ball, memory: &[PointMemory], ahead: &Ahead) {
        let Ahead { triangle, view, load, known } = *ahead;
        let (radius, centre, first) = (ball.at.part.radius(), ball.at.middle(), self.found.len());
        let middle = view.walk(on, triangle, centre);
        let corners = on.body.triangle(middle.triangle);
        let material = on.mesh.material_at(on.body, corners[0]);
        // Hertz's disc under the last load; large strain makes it wider.
        let disc = |k: Real| libm::cbrt(0.75 * PI * radius * k * load);
        let softening = Material::softening(material.poisson_ratio(), disc(material.half_space()) / radius);
        let compliance = material.half_space() * (1.0 + softening);
        let cap = (WIDER * disc(compliance)).clamp(LEAST_CAP * radius, MOST_CAP * radius);
        let ring = cap / (RINGS as Real + 0.3);
        let (number, mut triangle) = (self.discs.len() as u32, middle.triangle);
        for (i, &(k, [x, y])) in self.pattern.iter().enumerate() {
            let sin = k * ring / radius;
            let cos = (1.0 - sin * sin).sqrt();
            let normal = view.ahead * cos + (view.across[0] * x + view.across[1] * y) * sin;
            let arm = normal * radius;
            let from = if i % 6 == 1 { middle.triangle } else { triangle };
            let end = view.walk(on, from, centre + arm);
            triangle = end.triangle;
            let area = PI * ring * ring * if i == 0 { 0.25 } else { 1.0 / 3.0 } / cos;
            let width = (area / PI).sqrt();
            let beyond = if end.beyond > 0.0 { end.beyond } else { view.margin(on, end.triangle, centre + arm, width) };
            let part = part_before(beyond / width);
            let area = if part > LEAST_PART { part * area } else { 0.0 };
            let known = known.map(|k| k + i as u32);
            let corners = on.body.triangle(end.triangle).map(|v| on.mesh.vertex(v));
            self.found.push(Sample {
                disc: number,
                normal,
                arm,
                area,
                variance: variance_of_disc(area),
                triangle: end.triangle,
                weights: end.weights,
                displayed: corners.iter().zip(end.weights).map(|(c, w)| c * w).sum(),
                place: centre + arm,
                row: Row::EMPTY,
                known,
                multiplier: known.map_or(0.0, |k| memory[k as usize].multiplier),
            });
        }
        let spacing = self.hang(on, first, middle.triangle, cap);
        let shown = shown_variance(on, corners[0], spacing);
        // Of the mesh, which does not show the dent, the ball overlaps more than its disc.
        let along = |v: Vec3| view.ahead.dot(&v);
        let depth = along(self.found[first].displayed - centre) - along(ball.moves[1] - ball.moves[0]).abs();
        let reach = cap.max((radius * radius - depth.clamp(0.0, radius).powi(2)).sqrt());
        self.discs.push(Disc { ahead: view.ahead, cap, reach, compliance, shown, nu: material.poisson_ratio() });
    }

    /// Gives the samples from the `first` on their rows; returns the spacing of the nodes under the `middle` one [m].
    fn hang(&mut self, on: &Touchable, first: usize, middle: Triangle, cap: Real) -> Real {
        let rest = |v: Vertex| on.body.surface().vertices[v.index()];
        let spacing = |t: Triangle, w: [Real; 3]| {
            let corners = on.body.triangle(t);
            corners.iter().zip(w).map(|(v, w)| on.mesh.embedding(*v).spacing * w).sum::<Real>()
        };
        let width = spacing(middle, [1.0 / 3.0; 3]);
        let corners = on.body.triangle(middle);
        let origin = corners.map(rest).iter().sum::<Vec3>() / 3.0;
        let support = support(on);
        let slots = on.mesh.embedding(corners[0]).slots;
        self.around.gather(on.body, on.mesh, &slots, origin, REACH * (support * width + cap));
        for sample in self.found[first..].iter_mut().filter(|sample| sample.area > 0.0) {
            let corners = on.body.triangle(sample.triangle);
            let place: Vec3 = corners.iter().zip(sample.weights).map(|(v, w)| rest(*v) * w).sum();
            match self.around.row(place, support * spacing(sample.triangle, sample.weights)) {
                Some(row) => {
                    sample.row = row;
                    sample.place = row.interpolate(&on.mesh.motion.position);
                }
                None => sample.area = 0.0,
            }
        }
        width
    }
}

/// Where a disc of the last tick is now, whose points are `known` and begin at number `first`: in the direction in which it pushed.
fn still_ahead(on: &Touchable, ball: &Ball, known: &[PointMemory], first: u32) -> Option<Ahead> {
    let push: Vec3 = known.iter().map(|m| m.normal * m.multiplier).sum();
    let (middle, load) = (known.first()?, push.norm());
    let triangle = Triangle(middle.point % on.body.points_of_a_part() - on.vertices.len() as u32);
    let ahead = if load > 0.0 { push / load } else { middle.normal };
    let view = View::new(ahead, known.get(1).map_or(ahead, |m| m.normal));
    if load <= 0.0 {
        // It has let go, unless the mesh alone would swallow the ball.
        let corners = on.body.triangle(triangle).map(|v| on.mesh.vertex(v));
        let foot: Vec3 = corners.iter().zip(middle.weights).map(|(c, w)| c * w).sum();
        if ahead.dot(&(foot - ball.at.middle())) > 0.0 {
            return None;
        }
    }
    Some(Ahead { triangle, view, load, known: Some(first) })
}

impl Disc {
    /// True for a place `away` from the ball's centre [m] that is within `reach` [m] of the axis, ahead or, of a ball that is half in, beside.
    fn covers(&self, away: Vec3, reach: Real) -> bool {
        let along = self.ahead.dot(&away);
        along > -0.5 * away.norm() && (away - self.ahead * along).norm() < reach
    }
}

/// Support of a row over the spacing of the nodes: with less the lattice is felt, with more rows have no room and thin bodies no depth.
/// Elements that are softer in their shortest waves need a wider one.
fn support(on: &Touchable) -> Real {
    if on.body.stars().is_empty() { 1.75 } else { 2.0 }
}

/// Variance of a load as the mesh shows it [m²], `under` which nodes are of this `spacing` [m]: that of the rows, less what the
/// lattice's short waves are too soft by. Their stiffness is `C k² (1 + c a²k²)`, `c = −.167 + .145 α` for the part α that strain jumps keep, from the
/// symbol of the infinite body-centred lattice; it does not depend on Poisson's ratio.
fn shown_variance(on: &Touchable, under: Vertex, spacing: Real) -> Real {
    let deviation = DEVIATION * support(on);
    let node = on.mesh.node(on.mesh.embedding(under).slots[0]);
    (deviation * deviation - (0.167 - 0.145 * on.body.stabilisation(node))) * spacing * spacing
}

/// What stays the same for all samples of a tool.
#[derive(Clone, Copy, Debug)]
pub(super) struct Hold<'a> {
    pub(super) rigid: Rigid<'a>,
    pub(super) allowed_for: Pushed,
    /// Whether dents below the mesh's size are restored.
    pub(super) restores: bool,
}

impl Samples {
    /// What a newton on one sample adds at the other to the dent that the mesh leaves out [m/N].
    fn between(&self, a: &Sample, b: &Sample) -> Real {
        let [one, other] = [a, b].map(|sample| &self.discs[sample.disc as usize]);
        let shown = one.shown.max(other.shown).max(a.variance).max(b.variance);
        let apart = (a.arm - b.arm).norm_squared();
        let facing = a.normal.dot(&b.normal);
        if facing <= 0.0 || a.area <= 0.0 || b.area <= 0.0 {
            return 0.0;
        }
        let left_out = potential(apart, a.variance + b.variance) - potential(apart, 2.0 * shown);
        0.5 * (one.compliance + other.compliance) * left_out * facing
    }

    /// Appends the constraints of the samples that were found to `out`, and what is to be remembered of them to `memory`.
    pub(super) fn constrain(
        &self,
        on: &Touchable,
        ball: &Ball,
        hold: &Hold,
        known: &[PointMemory],
        out: Found,
        memory: &mut Vec<PointMemory>,
    ) {
        let Rigid { id, friction, state: tool, horizon, .. } = hold.rigid;
        let radius = ball.at.part.radius();
        let [start, end] = ball.moves;
        let first = out.constraints.len() as u32;
        for (i, sample) in self.found.iter().enumerate() {
            let n = sample.normal;
            let known = sample.known.map(|k| &known[k as usize]);
            let mut compliance = [0.0; MOST_POINTS];
            // Filled in once for both.
            for (j, (g, other)) in compliance.iter_mut().zip(&self.found).enumerate() {
                *g = match j {
                    _ if !hold.restores => 0.0,
                    j if j < i => out.constraints[first as usize + j].compliance[i],
                    _ => self.between(sample, other),
                };
            }
            let nu = self.discs[sample.disc as usize].nu;
            let point = on.vertices.len() as u32 + sample.triangle.0;
            let moved = n.dot(&(end - start));
            let mut constraint = Constraint {
                row: sample.row,
                normal: n,
                // It touches nothing where the surface ends.
                offset: Real::NEG_INFINITY,
                rate: 0.0,
                first,
                compliance,
                radius: (sample.area / PI).sqrt(),
                disc: 0.0,
                firming: Firming::NEVER,
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
                // The mesh shows the place above the tool's own; as it is pushed through the ball's centre, that makes no moment.
                arm: ball.at.middle() + sample.arm - middle_pose(tool).position,
                coupling: tool.coupling,
                allowed_for: hold.allowed_for,
                horizon,
            };
            let mut remembered = PointMemory { point, normal: n, weights: sample.weights, ..PointMemory::default() };
            if sample.area > 0.0 {
                let dent: Real = compliance.iter().zip(&self.found).map(|(g, other)| g * other.multiplier).sum();
                // The mean over its disc of where the tool is.
                let flat = radius - sample.area / (4.0 * PI * radius);
                let place = sample.place;
                let overlap = n.dot(&(start - place)) - dent + flat;
                let shift = known.map_or(0.0, |m| m.shift);
                let Closing { slack, slack_end, shift_end } = Closing::new(known, overlap - shift, shift, moved);
                constraint.offset = n.dot(&start) + flat - slack - shift;
                constraint.rate = (moved + slack - slack_end + shift - shift_end) / TICK;
                constraint.multiplier = sample.multiplier;
                (remembered.slack, remembered.shift) = (slack_end, shift_end);
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

/// As [`area_vector`], also of what has not been near the tool.
fn outward(on: &Touchable, t: Triangle) -> Vec3 {
    let [a, b, c] = on.body.triangle(t).map(|v| on.mesh.vertex(v));
    (b - a).cross(&(c - a))
}

/// Where the place of the surface is now that a sample touched [m].
fn displayed(on: &Touchable, m: &PointMemory) -> Vec3 {
    let corners = on.body.corners_of_point(m.point).map(|v| on.mesh.vertex(v));
    corners.iter().zip(m.weights).map(|(c, w)| c * w).sum()
}

/// Outermost samples over Hertz's disc: just outside of it.
const WIDER: Real = 1.05;
/// Over the ball's radius, what is looked at before there is a load: the disc of a depth of 1/500 of the radius.
const LEAST_CAP: Real = 0.045;
/// Over the ball's radius: samples beyond would push sideways.
const MOST_CAP: Real = 0.95;
/// Over its size at rest, how far the surface is drawn out under a tool.
const REACH: Real = 1.3;
/// Triangles that are walked over at most from one sample to the next.
const MOST_STEPS: usize = 64;
/// Barycentric weight below zero that counts as zero.
const INSIDE: Real = 1e-9;
/// Part of a sample's disc on the surface below which it touches nothing.
const LEAST_PART: Real = 0.02;
/// Directions in which a sample looks for the end of the surface.
const AROUND: [[Real; 2]; 6] = {
    const HALF_ROOT: Real = 0.866_025_403_784_438_6;
    [[1.0, 0.0], [0.5, HALF_ROOT], [-0.5, HALF_ROOT], [-1.0, 0.0], [-0.5, -HALF_ROOT], [0.5, -HALF_ROOT]]
};

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn half_of_a_disc_is_before_an_edge_through_its_middle() {
        assert!((part_before(0.0) - 0.5).abs() < 1e-15);
        assert_eq!((part_before(-2.0), part_before(2.0)), (1.0, 0.0));
        // The segment of a third of the turn.
        assert!((part_before(0.5) - (PI / 3.0 - 0.75_f64.sqrt() / 2.0) / PI).abs() < 1e-12);
    }
}
