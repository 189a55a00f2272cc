//! The dent that the mesh is too coarse to show.
//!
//! Under a point load an elastic half-space gives way by `1/r`, times [`Material::half_space`]; a mesh shows the part of it
//! that its nodes can. What that is follows from what the nodes that carry the points give way ([`Body::compliance_between`]);
//! the rest is put in series with the contact points, as a compliance that all points of a tool share.
//!
//! [`Body::compliance_between`]: crate::model::Body::compliance_between

use super::candidate::{Candidate, Sheet};
use super::posed::Posed;
use super::tool::MOST_POINTS;
use super::touchable::{MARGIN, Touchable};
use crate::ids::{Node, Vertex};
use crate::math::{Real, Vec3};
use crate::model::active_mesh::skin;
use crate::model::constraint::{Constraint, Firming, PointMemory};
use crate::model::{Material, Row};
use std::f64::consts::PI;
use std::ops::Range;

/// What a candidate's force does to the surface below the mesh's size.
#[derive(Clone, Copy, Debug)]
pub(super) struct Load {
    /// At rest [m].
    pub(super) place: Vec3,
    normal: Vec3,
    /// The nodes that carry it, ...
    pub(super) row: Row,
    /// ... and the geomorph offset of the place [m].
    pub(super) geomorph: Vec3,
    /// Where both together are [m]: what the tool touches.
    pub(super) touched: Vec3,
    /// As [`Candidate::taken`], followed [m²].
    pub(super) taken: Real,
    /// Radius of the disc that it spreads over [m].
    pub(super) radius: Real,
    /// What the mesh shows of its dent, over that of a half-space at a distance of one [1/m].
    pub(super) shown: Real,
    /// What a half-space of the material under it gives way by, per newton and per distance [m²/N].
    pub(super) half_space: Real,
    /// Poisson's ratio of that material.
    pub(super) nu: Real,
    /// Last multiplier [N] ...
    pub(super) multiplier: Real,
    /// ... and last dent below the mesh's size [m].
    dent: Real,
    /// Whether it has come to hang on a coarser level, and does not count as all of that yet.
    pub(super) coarsened: bool,
    /// What a half-space's dents count with, so that all points of a ball together give way as the disc that it touches.
    scale: Real,
    /// How much more than in small strain a half-space gives way, over that, ...
    softened: Real,
    /// ... and the mesh, followed.
    pub(super) mesh_softened: Real,
    /// As [`Constraint::disc`](crate::model::Constraint::disc).
    pub(super) disc: Real,
    /// How near it is to touching: 1 when it does, 0 from the margin on.
    closed: Real,
}

impl Load {
    pub(super) fn new(on: &Touchable, candidate: &Candidate, memory: &[PointMemory], followed: Real) -> Self {
        let stencil = candidate.stencil();
        let nearest = stencil.iter().max_by(|a, b| a.1.total_cmp(&b.1)).map_or(stencil[0].0, |(v, _)| *v);
        let material = on.mesh.material_at(on.body, nearest);
        let (row, geomorph) = skin::row(on.mesh, stencil);
        let known = candidate.known.map(|k| &memory[k as usize]);
        // A point beside this one that is no longer kept leaves it its area all at once.
        let taken = known.map_or(candidate.taken, |m| m.taken + followed * (candidate.taken - m.taken));
        Self {
            place: stencil.iter().map(|(v, w)| on.body.surface().vertices[v.index()] * *w).sum(),
            normal: candidate.normal,
            row,
            geomorph,
            touched: candidate.place,
            taken,
            radius: ((candidate.area + taken) / PI).sqrt().max(LEAST_RADIUS),
            shown: 0.0,
            half_space: material.half_space(),
            nu: material.poisson_ratio(),
            multiplier: known.map_or(0.0, |m| m.multiplier),
            dent: known.map_or(0.0, |m| m.dent),
            coarsened: stencil.iter().any(|(v, _)| on.mesh.geomorph[v.index()][3] < 0.0),
            scale: 1.0,
            softened: 0.0,
            mesh_softened: 0.0,
            disc: 0.0,
            closed: (1.0 - candidate.gap / MARGIN).clamp(0.0, 1.0),
        }
    }

    /// Under itself [m/N]: the mean over its disc. Where the mesh shows more than that, something is left all the same.
    fn own(&self) -> Real {
        let s = self.radius / self.scale;
        let shown = s * self.shown * (1.0 + self.mesh_softened) / (1.0 + self.softened);
        let left = if shown < CUT { DISC - shown + 2.0 / 15.0 * shown * shown } else { BEYOND / shown };
        (1.0 + self.softened) * self.half_space * left / s
    }

    /// Here, along this normal, because of `other` [m/N], when the mesh shows `shown` of it [m/N].
    fn from(&self, other: &Load, shown: Real) -> Real {
        // Between two materials it is neither's.
        let between = |of: fn(&Load) -> Real| 0.5 * (of(self) + of(other));
        let whole = between(|load| load.scale * load.half_space * (1.0 + load.softened));
        let disc = |load: &Load| Disc { middle: load.place, radius: load.radius };
        let apart = disc(self).apart(&disc(other));
        let rest = whole / apart - shown * between(|load| 1.0 + load.mesh_softened);
        rest * self.normal.dot(&other.normal).max(0.0)
    }

    /// How much it counts for what others may be raised by [m]: one that comes or goes, open or without area, not at all.
    fn weight(&self) -> Real {
        self.radius * self.closed
    }

    /// Where dents under a ball or capsule of `radius` [m] get firmer, on a surface whose edges are at most `edge` long [m].
    /// What is firm pushes hard and shakes: it must not come before the tool might get lost.
    pub(super) fn firming(&self, radius: Real, edge: Real) -> Firming {
        let wide = (radius / edge).min(1.0);
        let between = |[thin, thick]: [Real; 2]| thin + wide * wide * (thick - thin);
        Firming {
            from: radius * between(MOST_DENT),
            within: radius * wide * HALVED,
            most: radius * MOST_MORE,
            own: self.half_space * self.shown * between(FIRM),
        }
    }
}

/// Dents of the points of one tool, as far as the mesh does not show them. Reused from tick to tick.
#[derive(Debug)]
pub(super) struct Dents {
    /// Nodes that carry the points, ascending.
    wanted: Vec<Node>,
    /// Node in each place; [`Node::NONE`] in free ones.
    nodes: Vec<Node>,
    /// Place of each node (n_nodes); [`NOWHERE`] for most.
    place_of: Vec<u8>,
    /// [`ActiveMesh::softness`](crate::model::ActiveMesh::softness) at the node in each place.
    softness: Vec<Real>,
    /// Compliance between the nodes of two places [m/N]. It is the body's at rest, and so kept from tick to tick.
    between: Vec<Real>,
    /// Of each point the nodes' places and weights.
    carriers: Vec<Vec<(u8, Real)>>,
    /// What each node gives way to a newton on one point [m/N].
    given: Vec<Real>,
    /// What the mesh shows at one point of the dent of another, then what it does not [m/N].
    points: Vec<[Real; MOST_POINTS]>,
}

/// Most nodes of the elements that a point hangs on: three vertices have four each.
const MOST_NODES: usize = 12;
/// Most nodes that carry the points of a tool and count for their dents.
const MOST_CARRIERS: usize = 192;
const NOWHERE: u8 = u8::MAX;

impl Dents {
    /// For a body of `nodes`.
    pub(super) fn new(nodes: usize) -> Self {
        Self {
            wanted: Vec::with_capacity(MOST_POINTS * MOST_NODES),
            nodes: vec![Node::NONE; MOST_CARRIERS],
            place_of: vec![NOWHERE; nodes],
            softness: vec![1.0; MOST_CARRIERS],
            between: vec![0.0; MOST_CARRIERS * MOST_CARRIERS],
            carriers: (0..MOST_POINTS).map(|_| Vec::with_capacity(MOST_NODES)).collect(),
            given: vec![0.0; MOST_CARRIERS],
            points: vec![[0.0; MOST_POINTS]; MOST_POINTS],
        }
    }

    /// The body is of another stiffness than before.
    pub(super) fn forget(&mut self) {
        for node in self.nodes.iter_mut().filter(|node| **node != Node::NONE) {
            self.place_of[node.index()] = NOWHERE;
            *node = Node::NONE;
        }
    }

    /// Fills in what the mesh shows of the dents of `loads`, which belong to `candidates`.
    pub(super) fn show(&mut self, on: &Touchable, candidates: &[Candidate], loads: &mut [Load]) {
        self.find_carriers(on, candidates);
        for i in 0..loads.len() {
            self.given.fill(0.0);
            for &(l, b) in &self.carriers[i] {
                let to_l = &self.between[usize::from(l) * MOST_CARRIERS..][..MOST_CARRIERS];
                self.given.iter_mut().zip(to_l).for_each(|(given, c)| *given += b * c);
            }
            for j in 0..=i {
                self.points[i][j] = self.carriers[j].iter().map(|(k, b)| b * self.given[usize::from(*k)]).sum();
            }
        }
        let mut part = [0.0; MOST_POINTS];
        for (i, (load, candidate)) in loads.iter_mut().zip(candidates).enumerate() {
            let wider: Real = candidate.stencil().iter().map(|(v, w)| w * wider(on, *v)).sum();
            load.shown = (self.points[i][i] / (load.half_space * wider)).max(LEAST_SHOWN / load.radius);
            part[i] = (1.0 / wider).sqrt();
            (0..=i).for_each(|j| self.points[i][j] *= part[i] * part[j]);
        }
    }

    /// How much more than in small strain the mesh gives way, over that, to the forces of `loads`, which begin with the load
    /// `first` of those that [`Dents::show`] was given.
    ///
    /// An energy `U₂ + U₃` of second and third order in the displacements gives way by `-3/2 U₃/U₂` more. That of the elements
    /// which carry the loads is `Σ S:E / 2` and, of no rotation, `Σ S:E² / 2`; as an element that is crushed hands on what it
    /// carries, it softens the mesh the less. Cut elements soften by how they are cut, which nothing at rest tells.
    fn mesh_softening(&mut self, on: &Touchable, first: usize, loads: &[Load]) -> Real {
        let force: Real = loads.iter().map(|load| load.multiplier).sum();
        self.given.fill(0.0);
        for (load, carriers) in loads.iter().zip(&self.carriers[first..]) {
            carriers.iter().for_each(|(k, b)| self.given[usize::from(*k)] += b * load.multiplier / force);
        }
        let carried = |node: &Node| match self.place_of[node.index()] {
            NOWHERE => 0.0,
            place => self.given[usize::from(place)].max(0.0),
        };
        let (mut second, mut third) = (0.0, 0.0);
        for node in self.wanted.iter().filter(|node| carried(node) > 0.0) {
            for &e in on.body.elements_around(*node) {
                let nodes = on.body.element(e);
                // Each element once: by the first of its nodes that carry.
                if nodes.iter().find(|n| carried(n) > 0.0) != Some(node) {
                    continue;
                }
                let Some(strain) = on.mesh.pool().strain(e) else { continue };
                // One that comes to carry does not count all at once.
                let share = (nodes.iter().map(carried).sum::<Real>() / ALL_COUNTS).min(1.0);
                let weight = share * on.body.volume(e) * on.body.stiffness_factor(e);
                let [two, three, four] = on.mesh.material_of(on.body, e).works(&strain);
                second += weight * two;
                third += weight * (three + four);
            }
        }
        let [least, most] = MESH_SOFTENS;
        if second > 0.0 { (-SOFTENS * third / second).clamp(least, most) } else { 0.0 }
    }

    /// The points of a ball together touch the disc of radius `a³ = 3FR/(4E*)` [Hertz 1881], `F` the force of the last tick,
    /// wherever they are on it and however large the triangles are; `memory` holds the points of that tick. A ball that is thinner
    /// than the surface's edges has too few points to tell a disc by, and they change at once. The `loads` have been
    /// [shown](Dents::show).
    pub(super) fn share_discs(
        &mut self,
        on: &Touchable,
        parts: &[Posed],
        candidates: &[Candidate],
        memory: &[PointMemory],
        loads: &mut [Load],
    ) {
        let per_part = on.body.points_of_a_part();
        for (part, at) in parts.iter().enumerate() {
            let Some(radius) = at.part.ball_radius() else { continue };
            let own = of_part(part, candidates, |c| c.part as usize);
            let (first, loads) = (own.start, &mut loads[own]);
            let before = &memory[of_part(part, memory, |m| (m.point / per_part) as usize)];
            let least = (LEAST_DEPTH * radius).sqrt();
            let known: Real = loads.iter().map(|load| load.multiplier).sum();
            if known <= 0.0 {
                loads.iter_mut().for_each(|load| load.radius = load.radius.min(least));
                continue;
            }
            // Of the last tick's points, too, that are none any more.
            let force: Real = before.iter().map(|m| m.multiplier).sum();
            let half_space = mean_by_force(loads, |load| load.half_space);
            // 1/E* is π times the half-space's compliance.
            let disc = cube_root(0.75 * PI * radius * half_space * force).max(least);
            if radius < on.longest_edge {
                no_wider_than(disc, loads);
            } else {
                let mesh_softens = self.mesh_softening(on, first, loads);
                give_way_as(disc, radius, before, mesh_softens, loads);
            }
        }
    }

    /// Leaves what the mesh does not show of the dents of `loads`.
    pub(super) fn take_off_what_is_shown(&mut self, loads: &[Load]) {
        let (mut root, mut too_much) = ([0.0; MOST_POINTS], [0.0; MOST_POINTS]);
        for (i, load) in loads.iter().enumerate() {
            let own = load.own();
            root[i] = own.sqrt();
            for (j, other) in loads[..i].iter().enumerate() {
                let most = root[i] * root[j];
                let rest = load.from(other, self.points[i][j]).clamp(-MOST_RAISED * most, MOST_SHARED * most);
                self.points[i][j] = rest;
                let raised = (-rest).max(0.0);
                too_much[i] += other.weight() * raised;
                too_much[j] += load.weight() * raised;
            }
            self.points[i][i] = own;
        }
        // Any positive weights of the points keep the matrix diagonally dominant; one without weight is not raised.
        let mut part = [0.0; MOST_POINTS];
        for (i, load) in loads.iter().enumerate() {
            let most = MOST_RAISED_IN_ALL * load.weight() * root[i] * root[i];
            part[i] = if most > 0.0 { most / too_much[i] } else { 0.0 };
        }
        for i in 0..loads.len() {
            for j in 0..i {
                let rest = self.points[i][j];
                let kept = if rest < 0.0 { rest * part[i].min(part[j]).min(1.0) } else { rest };
                (self.points[i][j], self.points[j][i]) = (kept, kept);
            }
        }
    }

    /// Compliances of point `i` to those of all `n` [m/N].
    pub(super) fn of_point(&self, i: usize, n: usize) -> &[Real] {
        &self.points[i][..n]
    }

    /// Finds a place for each node that carries one of `loads`. Should there be more nodes than places, the last ones count
    /// as not giving way.
    fn find_carriers(&mut self, on: &Touchable, candidates: &[Candidate]) {
        // Nodes of the element that a vertex hangs on, also where these hang on others: when they come to be active, what is
        // shown stays as it is.
        let of_vertex = |(v, w): &(Vertex, Real)| {
            let (at, w) = (on.mesh.embedding(*v), *w);
            at.slots.into_iter().zip(at.weights).map(move |(slot, b)| (on.mesh.node(slot), w * b))
        };
        let rows = || candidates.iter().map(|c| c.stencil().iter().flat_map(of_vertex));
        self.wanted.clear();
        self.wanted.extend(rows().flatten().filter(|(_, b)| b.abs() > LEAST_CARRIED).map(|(node, _)| node));
        self.wanted.sort_unstable();
        self.wanted.dedup();
        self.wanted.truncate(MOST_CARRIERS);
        let is_free = |node: Node, wanted: &[Node]| node == Node::NONE || wanted.binary_search(&node).is_err();
        let mut place = 0;
        for w in 0..self.wanted.len() {
            let node = self.wanted[w];
            if self.place_of[node.index()] != NOWHERE {
                continue;
            }
            while place < MOST_CARRIERS && !is_free(self.nodes[place], &self.wanted) {
                place += 1;
            }
            let Some(before) = self.nodes.get_mut(place) else { break };
            if let Some(old) = self.place_of.get_mut(std::mem::replace(before, node).index()) {
                *old = NOWHERE;
            }
            self.place_of[node.index()] = place as u8;
            self.softness[place] = on.mesh.softness(on.body, node);
            for (other, of) in self.nodes.iter().enumerate().filter(|(_, of)| **of != Node::NONE) {
                let softer = 0.5 * (self.softness[place] + self.softness[other]);
                let c = on.body.compliance_between(node, *of) * softer;
                self.between[place * MOST_CARRIERS + other] = c;
                self.between[other * MOST_CARRIERS + place] = c;
            }
        }
        for (row, carriers) in rows().zip(&mut self.carriers) {
            carriers.clear();
            let placed = row.map(|(node, b)| (node, self.place_of[node.index()], b));
            let wanted = |node: Node| self.wanted.binary_search(&node).is_ok();
            carriers
                .extend(placed.filter(|(node, place, _)| *place != NOWHERE && wanted(*node)).map(|(_, p, b)| (p, b)));
        }
    }
}

/// How much farther a load on display vertex `v` is felt than the level shows that it hangs on now: each vertex hangs on a level
/// of its own, and a change of it fades over.
fn wider(on: &Touchable, v: Vertex) -> Real {
    1.0 + on.mesh.geomorph[v.index()][3] / on.mesh.embedding(v).spacing
}

/// Vertices have all the area when `candidates` come, ascending by point; a triangle's point takes its own from the corners,
/// the less the nearer it is to one of them: on a corner it is none, and nothing is to be felt of how it gets there. What
/// has next to none left is no candidate, unless it tells that something has sunk below it.
pub(super) fn share_areas(on: &Touchable, parts: &[Posed], candidates: &mut Vec<Candidate>) {
    let (vertices, per_part) = (on.vertices.len() as u32, on.body.points_of_a_part());
    let is_vertex = |c: &Candidate| c.point % per_part < vertices;
    for i in 0..candidates.len() {
        let c = candidates[i];
        if is_vertex(&c) {
            continue;
        }
        let near = GIVEN_ON * parts[c.part as usize].part.half_thickness();
        let nearest = c.stencil.iter().map(|(v, _)| (on.vertices[v.index()] - c.place).norm()).fold(near, Real::min);
        let x = nearest / near;
        candidates[i].share = x * x * (3.0 - 2.0 * x);
        candidates[i].area = candidates[i].share * c.area;
        for (v, _) in c.stencil {
            let corner = v.0 + c.part * per_part;
            if let Ok(k) = candidates.binary_search_by_key(&corner, |c| c.point) {
                candidates[k].area = (candidates[k].area - candidates[i].area / 3.0).max(0.0);
            }
        }
    }
    candidates.retain(|c| c.share > LEAST_SHARE || c.sheet != Sheet::Front);
}

/// Those of `all` that belong to `part`; the points of a part follow one another.
fn of_part<T>(part: usize, all: &[T], part_of: impl Fn(&T) -> usize) -> Range<usize> {
    all.partition_point(|x| part_of(x) < part)..all.partition_point(|x| part_of(x) <= part)
}

/// To which a point that comes or goes without force adds nothing.
fn mean_by_force(loads: &[Load], of: fn(&Load) -> Real) -> Real {
    let sum = |of: &dyn Fn(&Load) -> Real| loads.iter().map(|load| load.multiplier * of(load)).sum::<Real>();
    sum(&of) / sum(&|_| 1.0)
}

/// Leaves the points of a ball together no more area than that of a `disc` [m] that they touch. The area that counts is
/// `(ΣF)²/Σ(F²/A)`, to which a new point adds nothing at first.
fn no_wider_than(disc: Real, loads: &mut [Load]) {
    let force: Real = loads.iter().map(|load| load.multiplier).sum();
    let pressure =
        |load: &Load| (load.multiplier / (load.radius * load.radius)).min(MOST_PRESSURE * force / (disc * disc));
    let squares: Real = loads.iter().map(|load| load.multiplier * pressure(load)).sum();
    if force * force <= disc * disc * squares {
        return;
    }
    for load in loads {
        load.radius *= disc * squares.sqrt() / force;
        // The disc grows with the cube root of the force.
        let (s, c) = (load.radius, load.shown);
        let grows = (DISC / s - 2.0 / 15.0 * s * c * c).max(0.0) / 3.0;
        load.disc = load.half_space * grows * load.multiplier / force;
    }
}

/// Makes the points of a ball of `radius` give way together as the `disc` [m] that they touched in the last tick, `before`. A point whose normal is at the angle `θ` to the force is then `u = a²/R − R (1 − cos θ)` deep, and so the
/// work `Σ F u` of all is known; what it would be on a half-space as they are tells [`measure`].
///
/// Large strain softens the continuum as [`Material::softening`] says, and the mesh by `mesh_softens`.
fn give_way_as(disc: Real, radius: Real, before: &[PointMemory], mesh_softens: Real, loads: &mut [Load]) {
    let force: Real = before.iter().map(|m| m.multiplier).sum();
    // All points of a part remember the same.
    let (distance, was) = before.first().map_or((0.0, 0.0), |m| (m.distance, m.mesh_softened));
    // A ball that is in by as much as its radius touches no disc any more.
    let shallow = ((1.0 - disc / radius) / (1.0 - SHALLOW)).clamp(0.0, 1.0);
    let softened = shallow * Material::softening(mean_by_force(loads, |load| load.nu), disc / radius);
    let mesh_softened = was + SOFTENING_FOLLOWED * (shallow * mesh_softens - was);
    let deep = disc * disc / radius;
    let axis = before.iter().map(|m| m.normal * m.multiplier).sum::<Vec3>() / force;
    let mean = (deep - radius * (1.0 - axis.norm())).max(LEAST_MEAN * deep);
    // The half-space's compliance times the force; not less than the least disc's, however small the force is.
    let reach = disc * disc * disc / (0.75 * PI * radius);
    let whole = WORK * mean * distance / reach;
    let scale = 1.0 + shallow * (whole - 1.0);
    for load in loads {
        (load.scale, load.softened, load.mesh_softened) = (scale, softened, mesh_softened);
        // The disc grows with the cube root of the force, ...
        let own = (deep - radius * (1.0 - load.normal.dot(&axis))).max(0.0);
        let grows = own / mean * (mean - 2.0 / 3.0 * deep).max(0.0);
        // ... and softens.
        load.disc = (grows - load.dent * softened / (1.0 + softened) / 3.0) * load.half_space / reach;
    }
}

/// Leaves in `points`, one for each of a tool's `constraints`, what the sharing of discs asks for in the next tick.
pub fn measure(constraints: &[Constraint], points: &mut [PointMemory], per_part: u32) {
    let part = |c: &Constraint| c.point / per_part;
    for first in 0..constraints.len() {
        if first > 0 && part(&constraints[first - 1]) == part(&constraints[first]) {
            continue;
        }
        let own = || constraints[first..].iter().take_while(|c| part(c) == part(&constraints[first]));
        let pushing = || own().filter(|c| c.multiplier > 0.0);
        let disc = |c: &Constraint| Disc { middle: c.arm, radius: c.radius };
        let (mut force, mut work) = (0.0, 0.0);
        for (i, c) in pushing().enumerate() {
            let give = |other: &Constraint| {
                let apart = disc(c).apart(&disc(other));
                other.multiplier * c.normal.dot(&other.normal).max(0.0) / apart
            };
            let others: Real = pushing().take(i).map(give).sum();
            work += c.multiplier * (c.multiplier * DISC / c.radius + 2.0 * others);
            force += c.multiplier;
        }
        let before = points[first..].iter().zip(own()).map(|(point, _)| point.distance).fold(0.0, Real::max);
        let now = if work > 0.0 { force * force / work } else { 0.0 };
        let distance = if before.min(now) > 0.0 { before + DISTANCE_FOLLOWED * (now - before) } else { now };
        points[first..].iter_mut().zip(own()).for_each(|(point, _)| point.distance = distance);
    }
}

/// What a force spreads over.
#[derive(Clone, Copy, Debug)]
struct Disc {
    /// [m].
    middle: Vec3,
    /// [m].
    radius: Real,
}

impl Disc {
    /// Distance of the middles [m]; discs that overlap count as side by side, or the matrix of their compliances would not be
    /// positive definite.
    fn apart(&self, other: &Disc) -> Real {
        (self.middle - other.middle).norm().max(LEAST_APART * (self.radius + other.radius))
    }
}

/// By Newton's method, after bringing `x` ≥ 0 between 1/8 and 1: the same on every machine.
/// Not the cube root of `libm`, which rounds the last bit otherwise: every recorded hash depends on it.
fn cube_root(x: Real) -> Real {
    if !(Real::MIN_POSITIVE..1e9).contains(&x) {
        return 0.0;
    }
    let (mut scaled, mut factor) = (x, 1.0);
    while scaled < 0.125 {
        (scaled, factor) = (8.0 * scaled, 0.5 * factor);
    }
    while scaled > 1.0 {
        (scaled, factor) = (0.125 * scaled, 2.0 * factor);
    }
    let root = (0..6).fold(1.0, |y: Real, _| (2.0 * y + scaled / (y * y)) / 3.0);
    factor * root
}

/// Weight from which on a node counts among those that carry a point.
const LEAST_CARRIED: Real = 0.02;
/// What the mesh shows at least, over the radius of the point's disc.
const LEAST_SHOWN: Real = 0.01;
/// Most that two points share of their own dents: all of it would be no dent of their own.
const MOST_SHARED: Real = 0.9;
/// Where a mesh shows more than there is, a point raises another; most of their own dents that it does so by, ...
const MOST_RAISED: Real = 0.05;
/// ... and that all others together do, or the matrix would not be positive definite on a body that is crumpled.
const MOST_RAISED_IN_ALL: Real = 0.9;
/// What a disc gives way on the average over a constant pressure, over its radius, would be 2; with this the forces of balls
/// on some ten discs are Hertz's.
const DISC: Real = 2.2;
/// Radius of a disc times what the mesh shows, from which on a disc gives way less than the mesh shows, or little more: ...
const CUT: Real = 1.382;
/// ... what it gives way then goes on without a step.
const BEYOND: Real = 1.482;
/// Least distance between two loads over the sum of their radii.
const LEAST_APART: Real = 0.85;
/// Part of the radius of a ball or capsule that the dent below the mesh's size may take before it gets firm: where triangles
/// are much wider the displayed surface would swallow the tip and lose it at the next triangle; where they are no wider there
/// are always several to stand on.
const MOST_DENT: [Real; 2] = [0.3, 0.6];
/// What [`Firming::within`] is over the radius, where triangles are no wider.
const HALVED: Real = 0.012;
/// What [`Firming::most`] is over the radius.
const MOST_MORE: Real = 0.25;
/// What [`Firming::own`] is of what the mesh shows: none at all would leave nothing to divide by where a point hangs on nodes
/// that are held fast.
const FIRM: [Real; 2] = [0.0125, 0.25];
/// Part of half of a part's thickness within which a triangle's point leaves its area to the corners.
const GIVEN_ON: Real = 0.3;
/// Of a triangle's own area that its point is a candidate for.
const LEAST_SHARE: Real = 1e-3;
/// Part of a tool's force that the nodes of an element carry from which on all of it counts for how the mesh softens.
const ALL_COUNTS: Real = 0.2;
/// What `Σ S:(E² + E³) / Σ S:E` makes a mesh of 6 to 12.5 mm softer by under a ball of 10 mm; to second order it is 3/2.
const SOFTENS: Real = 1.6;
/// How much the mesh may soften: a body that is drawn out or crumpled is not what this is for.
const MESH_SOFTENS: [Real; 2] = [-0.2, 0.4];
/// Of the work that is known, what the points of a ball do: with this the forces are the continuum's on elements of a third to
/// eight radii of the disc.
const WORK: Real = 0.98;
/// Disc over radius up to which a ball's points give way as its disc; at 1 nothing is left of that.
const SHALLOW: Real = 0.6;
/// Part of the way to what it is now that [`PointMemory::distance`] goes in a tick, ...
const DISTANCE_FOLLOWED: Real = 0.5;
/// ... and [`PointMemory::mesh_softened`].
const SOFTENING_FOLLOWED: Real = 0.2;
/// Over the depth, how deep a ball's points are on the average at least: on a sphere four fifths.
const LEAST_MEAN: Real = 0.5;
/// Over the mean pressure on Hertz's disc, what a point of a thin ball counts with at most: a small force on next to no area
/// would decide for all.
const MOST_PRESSURE: Real = 10.0;
/// A ball that does not push yet has the disc of this depth [m].
const LEAST_DEPTH: Real = 20e-6;
/// Of a disc [m]: what has no area would give way without bound.
const LEAST_RADIUS: Real = 1e-6;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cube_roots_are_roots() {
        for x in [1e-300, 1e-12, 3e-7, 0.125, 0.9, 1.0, 27.0, 1e8] {
            assert!((cube_root(x) / Real::cbrt(x) - 1.0).abs() < 1e-12, "{x}");
        }
        assert_eq!(cube_root(0.0), 0.0);
    }
}
