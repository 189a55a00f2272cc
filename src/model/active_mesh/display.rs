//! The displayed surface: where its vertices hang, and what changes of resolution leave on it to fade.

use super::{ActiveMesh, vec3};
use crate::geometry::locate::Host;
use crate::geometry::tet_mesh::barycentric;
use crate::math::{Real, Vec3};
use crate::model::active_set::Status;
use crate::model::body::Body;
use crate::model::element_kernel::Padded;

/// Where a display vertex hangs.
#[derive(Clone, Copy, Debug)]
pub struct Attachment {
    /// Its element.
    pub element: u32,
    /// Slots of the element's nodes.
    pub slots: [u32; 4],
    /// Barycentric weights.
    pub weights: [Real; 4],
    /// Spacing of the element's level [m].
    pub spacing: Real,
}

impl ActiveMesh {
    /// Display vertices that the last change hung on another element.
    pub fn rehung(&self) -> &[u32] {
        &self.work.rehung
    }

    /// Where display vertex `v` hangs.
    pub fn attachment(&self, v: u32) -> &Attachment {
        &self.attachment[v as usize]
    }

    /// Position of display vertex `v` [m], fade included.
    pub fn vertex(&self, v: u32) -> Vec3 {
        vec3(&self.embedded(v)) + vec3(&self.fade[v as usize])
    }

    pub(super) fn embedded(&self, v: u32) -> Padded {
        let a = &self.attachment[v as usize];
        let mut sum = [0.0; 4];
        for (slot, w) in a.slots.iter().zip(a.weights) {
            let x = &self.motion.position[*slot as usize];
            for c in 0..4 {
                sum[c] += w * x[c];
            }
        }
        sum
    }

    /// Positions of all display vertices [m].
    pub fn skin(&self, vertices: &mut [Vec3]) {
        for (v, place) in vertices.iter_mut().enumerate() {
            *place = self.vertex(v as u32);
        }
    }

    /// Level of the element that each display vertex hangs on.
    pub fn display_levels(&self, body: &Body, levels: &mut [u8]) {
        for (level, a) in levels.iter_mut().zip(&self.attachment) {
            *level = body.level_of_element(a.element) as u8;
        }
    }

    /// Display vertices hang on the element whose vertices are active the most, the finer one of two alike; what they
    /// would jump by from `before` goes into the fade.
    pub(super) fn reattach(&mut self, body: &Body, before: &[Vec3]) {
        self.work.rehung.clear();
        for i in 0..self.work.elements.len() {
            for &v in body.hosted(self.work.elements[i]) {
                let before = self.attachment[v as usize];
                self.attach(body, v);
                let now = &self.attachment[v as usize];
                self.fade[v as usize][3] += before.spacing - now.spacing;
                if now.element != before.element {
                    self.work.rehung.push(v);
                }
            }
        }
        for (v, place) in before.iter().enumerate() {
            let jump = place - self.vertex(v as u32);
            // What has not moved but by rounding stays exactly where it is.
            if jump.norm_squared() > 1e-24 {
                for c in 0..3 {
                    self.fade[v][c] += jump[c];
                }
            }
        }
        self.weigh_springs(body);
    }

    pub(super) fn attach(&mut self, body: &Body, v: u32) {
        let (mut most, mut host) = (0, None);
        for r in (0..body.levels().len()).rev() {
            let Some(candidate) = body.embedding(r, v) else { continue };
            let active = self.active_vertices[candidate.element as usize];
            if active > most {
                (most, host) = (active, Some(candidate));
            }
        }
        let host = host.unwrap_or_else(|| self.near_element(body, v));
        let nodes = body.element(host.element);
        self.attachment[v as usize] = Attachment {
            element: host.element,
            slots: nodes.map(|n| self.slot[n as usize]),
            weights: host.weights,
            spacing: body.spacing_at(nodes[0]),
        };
    }

    /// Where levels meet, none of the elements that contain a vertex may be in use: then one around an active node that
    /// stands for their nodes is extrapolated.
    fn near_element(&self, body: &Body, v: u32) -> Host {
        let p = body.surface().vertices[v as usize];
        let mut n = body.element(body.level(0).embedding[v as usize].element)[0];
        while self.set.status(n) == Status::Refined {
            let distance = |c: &u32| (body.rest(*c) - p).norm_squared();
            n = body.children(n).iter().copied().min_by(|a, b| distance(a).total_cmp(&distance(b))).unwrap_or(n);
        }
        let least = |e: u32| {
            let weights = barycentric(&body.corners(e), p);
            (weights.iter().copied().fold(Real::INFINITY, Real::min), weights)
        };
        let mut best = (Real::NEG_INFINITY, 0, [0.25; 4]);
        for &e in body.elements_around(n) {
            let (inside, weights) = least(e);
            if inside > best.0 {
                best = (inside, e, weights);
            }
        }
        Host { element: best.1, weights: best.2 }
    }

    /// What the springs add to `ω²` at most: `Σ_h k |b_j| Σ_i|b_i| / m_j` by row sums.
    pub(super) fn weigh_springs(&mut self, body: &Body) {
        if body.holds().is_empty() {
            return;
        }
        self.active.iter().for_each(|s| self.springs[*s as usize] = 0.0);
        for hold in body.holds() {
            let a = self.attachment[hold.vertex as usize];
            let amplification: Real = a
                .slots
                .iter()
                .zip(a.weights)
                .map(|(s, w)| w.abs() * if self.is_master(*s) { 1.0 } else { self.row[*s as usize].amplification() })
                .sum();
            for (slot, w) in a.slots.iter().zip(a.weights) {
                let stiffness = hold.stiffness * w.abs() * amplification;
                if self.is_master(*slot) {
                    self.springs[*slot as usize] += stiffness * self.motion.inverse_mass[*slot as usize];
                } else {
                    for (master, p) in self.row[*slot as usize].entries() {
                        self.springs[master as usize] +=
                            stiffness * p.abs() * self.motion.inverse_mass[master as usize];
                    }
                }
            }
        }
        self.stiffest_spring = self.active.iter().map(|s| self.springs[*s as usize]).fold(0.0, Real::max);
    }

    /// Bound on the springs' share of `ω²` [1/s²] of any node.
    pub fn stiffest_spring(&self) -> Real {
        self.stiffest_spring
    }

    /// Fades what changes of resolution have left, by one tick.
    pub fn fade_out(&mut self) {
        self.ease_off();
        let most = FASTEST_FADE * self.size;
        for fade in &mut self.fade {
            let away = vec3(fade).norm();
            if away > 1e-9 {
                let far = (away - FAR_FADE * self.size).max(0.0);
                let faded = ((away - far) * (1.0 - FADE_KEPT)).min(most) + far * (1.0 - FADE_KEPT);
                let kept = 1.0 - faded / away;
                fade[..3].iter_mut().for_each(|x| *x *= kept);
            } else if away > 0.0 {
                fade[..3].fill(0.0);
            }
            fade[3] = if fade[3].abs() > 1e-9 { fade[3] * SPACING_FADE_KEPT } else { 0.0 };
        }
    }
}

/// Part of the fade of a place that is left after a tick: a time constant of 285 ms, slow enough for the eye.
const FADE_KEPT: Real = 0.9965;
/// What a place moves by at most in a tick because of it, over the body's size: 1e-3 in a frame cannot be seen.
const FASTEST_FADE: Real = 2.8e-5;
/// Beyond this part of the body's size, which only the wildest motion leaves, the fade is faster.
const FAR_FADE: Real = 0.045;
/// Part of the fade of a spacing that is left after a tick: 20 ms are slow enough for the hand, and a surface that was
/// refined because a tool comes near must not feel as soft as the coarse one when it arrives.
const SPACING_FADE_KEPT: Real = 0.95;
