//! The displayed surface: where its vertices hang, and what changes of resolution leave on it to fade.

use super::{ActiveMesh, Work, vec3};
use crate::geometry::locate::Host;
use crate::geometry::tet_mesh::barycentric;
use crate::ids::{Element, Node, Slot, Vertex};
use crate::math::{Real, Vec3};
use crate::model::active_set::Status;
use crate::model::body::Body;
use crate::model::element_kernel::Padded;

/// Where a display vertex hangs.
#[derive(Clone, Copy, Debug)]
pub struct Embedding {
    /// Its element.
    pub element: Element,
    /// Slots of the element's nodes.
    pub slots: [Slot; 4],
    /// Barycentric weights.
    pub weights: [Real; 4],
    /// Spacing of the element's level [m].
    pub spacing: Real,
}

impl Embedding {
    /// Its place with the node in each slot at `position(slot)` [m].
    fn place<'p>(&self, position: impl Fn(usize) -> &'p Padded) -> Padded {
        let mut sum = [0.0; 4];
        for (slot, w) in self.slots.iter().zip(self.weights) {
            let x = position(slot.index());
            for c in 0..4 {
                sum[c] += w * x[c];
            }
        }
        sum
    }
}

impl ActiveMesh {
    /// Display vertices that it looked at: all others hang as before, on nodes that it left where they were.
    pub fn revisited(&self) -> &[Vertex] {
        &self.work.revisited
    }

    /// Where display vertex `v` hangs.
    pub fn embedding(&self, v: Vertex) -> &Embedding {
        &self.embedded[v.index()]
    }

    /// Position of display vertex `v` [m], geomorph offset included.
    pub fn vertex(&self, v: Vertex) -> Vec3 {
        vec3(&self.place(&self.embedded[v.index()])) + vec3(&self.geomorph[v.index()])
    }

    fn place(&self, embedded: &Embedding) -> Padded {
        embedded.place(|slot| &self.motion.position[slot])
    }

    /// Where it was before the change that is under way.
    fn place_before(&self, embedded: &Embedding) -> Padded {
        let moved = |slot: usize| self.work.moved_slots.contains(slot);
        embedded.place(|slot| if moved(slot) { &self.work.was[slot] } else { &self.motion.position[slot] })
    }

    /// Positions of all display vertices [m].
    pub fn skin(&self, vertices: &mut [Vec3]) {
        for (v, place) in vertices.iter_mut().enumerate() {
            *place = self.vertex(Vertex::at(v));
        }
    }

    /// Level of the element that each display vertex hangs on.
    pub fn display_levels(&self, body: &Body, levels: &mut [u8]) {
        for (level, a) in levels.iter_mut().zip(&self.embedded) {
            *level = body.level_of_element(a.element) as u8;
        }
    }

    /// Slots whose nodes the last change has put elsewhere, or there in the first place.
    pub fn moved(&self) -> &[Slot] {
        &self.work.moved
    }

    /// Remembers where the node in `slot` is, before a change puts it elsewhere for the first time.
    pub(super) fn remember_place(&mut self, slot: Slot) {
        let s = slot.index();
        if self.work.moved_slots.visit(s) {
            self.work.was[s] = self.motion.position[s];
            self.work.moved.push(slot);
        }
    }

    /// Display vertices hang on the element whose vertices are active the most, the finer one of two alike; what they
    /// would jump by from where the nodes were goes into the geomorph offset. Only those that may hang elsewhere now, or on a node that
    /// has moved, are looked at.
    pub(super) fn reattach(&mut self, body: &Body) {
        let may_hang_elsewhere = self.find_shifted(body);
        let revisited = std::mem::take(&mut self.work.revisited);
        // Those on it are looked at again.
        self.extrapolated.clear();
        for (i, &v) in revisited.iter().enumerate() {
            let before = self.embedded[v.index()];
            let place = vec3(&self.place_before(&before));
            if i < may_hang_elsewhere {
                self.attach(body, v);
            }
            let now = &self.embedded[v.index()];
            if now.element != before.element || now.slots != before.slots {
                self.supports.rehang(v, before.element, now.element);
            }
            let jump = place - vec3(&self.place(now));
            let geomorph = &mut self.geomorph[v.index()];
            let faded = *geomorph == [0.0; 4];
            // What has not moved but by rounding stays exactly where it is.
            if jump.norm_squared() > 1e-24 {
                (0..3).for_each(|c| geomorph[c] += jump[c]);
            }
            if faded && *geomorph != [0.0; 4] {
                self.morphing.push(v);
                self.supports.displace(v);
            }
        }
        self.work.revisited = revisited;
        self.fold_supports(body);
        self.weigh_supports();
    }

    /// Returns how many of them, the first ones, may hang elsewhere; the others are on what has moved.
    fn find_shifted(&mut self, body: &Body) -> usize {
        self.work.revisited.clear();
        let Self { work: Work { revisited, noted_vertices, moved, elements, .. }, embedded, .. } = self;
        let mut add = |revisited: &mut Vec<Vertex>, v: Vertex| {
            if noted_vertices.visit(v.index()) {
                revisited.push(v);
            }
        };
        elements.iter().flat_map(|e| body.hosted(*e)).chain(&self.extrapolated).for_each(|v| add(revisited, *v));
        let may_hang_elsewhere = revisited.len();
        for slot in moved.iter() {
            for &e in body.elements_around(self.node[slot.index()]) {
                let on_it = body.hosted(e).iter().filter(|v| embedded[v.index()].element == e);
                on_it.for_each(|v| add(revisited, *v));
            }
        }
        may_hang_elsewhere
    }

    /// Display vertices that are not where the elements lie that they hang on.
    pub fn extrapolated(&self) -> &[Vertex] {
        &self.extrapolated
    }

    /// Notes where all nodes are, for [`Self::most_moved`].
    pub fn note_places(&mut self) {
        let Self { active, interface, motion, noted, .. } = self;
        active.iter().chain(&*interface).for_each(|slot| noted[slot.index()] = motion.position[slot.index()]);
    }

    /// What a display vertex has moved by at most since then, but for what moved them all alike, and fades by in a tick at most [m].
    ///
    /// Velocities would tell more than that: what is pushed and held swings within a tick.
    pub fn most_moved(&self) -> Real {
        let all = || self.active.iter().chain(&self.interface);
        let of = |slot: &Slot| vec3(&self.motion.position[slot.index()]) - vec3(&self.noted[slot.index()]);
        let mean = all().map(of).sum::<Vec3>() / (all().count().max(1) as Real);
        let most = all().map(|slot| (of(slot) - mean).norm_squared()).fold(0.0, Real::max).sqrt();
        let fades = |v: &Vertex| faded(vec3(&self.geomorph[v.index()]).norm(), self.size);
        // Not by the lever: what that was before is no part of the state.
        let lever = |v: &Vertex| self.embedded[v.index()].weights.iter().map(|w| w.abs()).sum::<Real>();
        let lever = self.extrapolated.iter().map(lever).fold(MOST_LEVER, Real::max);
        lever * most + self.morphing.iter().map(fades).fold(0.0, Real::max)
    }

    /// No display vertex moves by more than this when no node moves by more than one.
    pub fn lever(&self) -> Real {
        self.lever
    }

    /// Display vertices whose [`ActiveMesh::geomorph`] is not zero.
    pub fn morphing(&self) -> &[Vertex] {
        &self.morphing
    }

    /// Finds the embedding of `v`, which is not on the list of those extrapolated.
    pub(super) fn attach(&mut self, body: &Body, v: Vertex) {
        let (mut most, mut host) = (0, None);
        for r in (0..body.levels().len()).rev() {
            let Some(candidate) = body.embedding(r, v) else { continue };
            let active = self.active_vertices[candidate.element.index()];
            if active > most {
                (most, host) = (active, Some(candidate));
            }
        }
        let extrapolated = host.is_none_or(|host| host.weights.iter().any(|w| *w < -MOST_ASIDE));
        let host = host.unwrap_or_else(|| self.near_element(body, v));
        if extrapolated {
            self.extrapolated.push(v);
        }
        let nodes = body.element(host.element);
        self.embedded[v.index()] = Embedding {
            element: host.element,
            slots: nodes.map(|n| self.slot[n.index()]),
            weights: host.weights,
            spacing: body.spacing_at(nodes[0]),
        };
        self.lever = self.lever.max(host.weights.iter().map(|w| w.abs()).sum());
    }

    /// Where levels meet, none of the elements that contain a vertex may be in use: then one around an active node that
    /// stands for their nodes is extrapolated.
    fn near_element(&self, body: &Body, v: Vertex) -> Host<Element> {
        let p = body.surface().vertices[v.index()];
        let mut n = body.coarsest_carrier(v);
        while self.set.status(n) == Status::Refined {
            let distance = |c: &Node| (body.rest(*c) - p).norm_squared();
            n = body.children(n).iter().copied().min_by(|a, b| distance(a).total_cmp(&distance(b))).unwrap_or(n);
        }
        let least = |e: Element| {
            let weights = barycentric(&body.corners(e), p);
            (weights.iter().copied().fold(Real::INFINITY, Real::min), weights)
        };
        let mut best = (Real::NEG_INFINITY, Element(0), [0.25; 4]);
        for &e in body.elements_around(n) {
            let (inside, weights) = least(e);
            if inside > best.0 {
                best = (inside, e, weights);
            }
        }
        Host { element: best.1, weights: best.2 }
    }

    /// Fades what changes of resolution have left, by one tick.
    pub fn decay_geomorph(&mut self) {
        let Self { morphing, geomorph, size, .. } = self;
        morphing.retain(|v| {
            let geomorph = &mut geomorph[v.index()];
            let away = vec3(geomorph).norm();
            if away > 1e-9 {
                let kept = 1.0 - faded(away, *size) / away;
                geomorph[..3].iter_mut().for_each(|x| *x *= kept);
            } else if away > 0.0 {
                geomorph[..3].fill(0.0);
            }
            *geomorph != [0.0; 4]
        });
    }
}

/// What fades in a tick of an offset of `away` [m] on a body of `size` [m].
fn faded(away: Real, size: Real) -> Real {
    let (least, most) = (SLOWEST_GEOMORPH * size, FASTEST_GEOMORPH * size);
    let far = (away - FAR_GEOMORPH * size).max(0.0);
    let near = ((away - far) * (1.0 - GEOMORPH_KEPT)).min(most).max(least).min(away);
    near + far * (1.0 - GEOMORPH_KEPT)
}

/// Weight that a vertex may have below zero and count as one of its element.
pub const MOST_ASIDE: Real = 0.2;
/// Sum of the weights' amounts that a vertex may have which counts as one of its element: of four that sum to one, three below zero.
const MOST_LEVER: Real = 1.0 + 2.0 * 3.0 * MOST_ASIDE;
/// Part of the geomorph offset of a place that is left after a tick: a time constant of 285 ms, slow enough for the eye.
const GEOMORPH_KEPT: Real = 0.9965;
/// What a place moves by at most in a tick because of it, over the body's size: 1e-3 in a frame cannot be seen.
const FASTEST_GEOMORPH: Real = 2.8e-5;
/// What it moves by at least, over the body's size: so it arrives, and a place that has arrived takes no more time.
const SLOWEST_GEOMORPH: Real = 3e-7;
/// Beyond this part of the body's size, which only the wildest motion leaves, the offset decays faster.
const FAR_GEOMORPH: Real = 0.045;
