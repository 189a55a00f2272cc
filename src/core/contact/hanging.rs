//! How points of the display hang on the nodes around them, of whatever level these are: by moving least squares
//! ([`crate::model::active_mesh::contact_row`]), and with what the mesh leaves out of their own loads ([`super::influence`]).

use super::candidate::{ALIKE, Candidate};
use super::closing::Before;
use super::influence::{Narrow, variance_of_disc};
use super::samples::shown_variance;
use super::tool::MOST_POINTS;
use super::touchable::Touchable;
use crate::math::{Real, Vec3};
use crate::model::active_mesh::contact_row::{Surroundings, at_rest, spacing, support};
use crate::model::active_mesh::skin;
use crate::model::constraint::PointMemory;
use crate::model::{Body, Row};

/// How a point of the display gives way.
#[derive(Clone, Copy, Debug)]
pub(super) struct Load {
    /// At rest [m].
    place: Vec3,
    /// The nodes that carry it, ...
    pub(super) row: Row,
    /// ... how far from where they have it the tool touches it [m], ...
    pub(super) geomorph: Vec3,
    /// ... and where that is [m].
    pub(super) touched: Vec3,
    /// By how much a change of resolution has moved it away from the tool, and made its dent deeper [m].
    pub(super) receded: Real,
    /// As [`Candidate::taken`], followed [m²].
    pub(super) taken: Real,
    /// Area that it spreads over [m²].
    area: Real,
    /// What a half-space of the material under it gives way by, per newton and per distance [m²/N].
    half_space: Real,
    /// Poisson's ratio of that material.
    pub(super) nu: Real,
    /// Last multiplier [N].
    pub(super) multiplier: Real,
}

impl Load {
    /// As it is displayed, and without what the mesh leaves out.
    pub(super) fn new(on: &Touchable, candidate: &Candidate, memory: &[PointMemory], followed: Real) -> Self {
        let stencil = candidate.stencil();
        let nearest = stencil.iter().max_by(|a, b| a.1.total_cmp(&b.1)).map_or(stencil[0].0, |(v, _)| *v);
        let material = on.mesh.material_at(on.body, nearest);
        let (row, geomorph) = skin::row(on.mesh, stencil);
        let known = candidate.known.map(|k| &memory[k as usize]);
        // A point beside this one that is no longer kept leaves it its area all at once.
        let taken = known.map_or(candidate.taken, |m| m.taken + followed * (candidate.taken - m.taken));
        Self {
            place: at_rest(on.body, stencil.iter().copied()),
            row,
            geomorph,
            touched: candidate.place,
            receded: 0.0,
            taken,
            area: (candidate.area + taken).max(LEAST_AREA),
            half_space: material.half_space(),
            nu: material.poisson_ratio(),
            multiplier: known.map_or(0.0, |m| m.multiplier),
        }
    }
}

/// What it takes to hang points on nodes.
#[derive(Debug)]
pub(super) struct Hanging {
    /// Nodes, for all that touches the body.
    pub(super) around: Surroundings,
    /// Of each point.
    spread: Vec<Narrow>,
    /// Of each point, the support of its row [m]; zero once it has one.
    supports: Vec<Real>,
}

impl Hanging {
    pub(super) fn new(body: &Body) -> Self {
        Self {
            around: Surroundings::new(body),
            spread: Vec::with_capacity(MOST_POINTS),
            supports: Vec::with_capacity(MOST_POINTS),
        }
    }

    /// Gives the `loads` their rows, which belong to `candidates`.
    pub(super) fn hang(&mut self, on: &Touchable, candidates: &[Candidate], loads: &mut [Load], before: Before) {
        self.spread.clear();
        self.supports.clear();
        for (candidate, load) in candidates.iter().zip(loads.iter()) {
            let stencil = candidate.stencil();
            let spacing = spacing(on.mesh, stencil.iter().copied());
            self.supports.push(support(on.body) * spacing);
            self.spread.push(Narrow {
                place: candidate.place,
                normal: candidate.normal,
                variance: variance_of_disc(load.area),
                shown: shown_variance(on, stencil[0].0, spacing),
                compliance: load.half_space,
            });
        }
        for i in 0..loads.len() {
            if self.supports[i] > 0.0 {
                self.hang_around(on, i, candidates, loads, before);
            }
        }
        if before.changed {
            let known = |c: &Candidate| c.known.map(|k| &before.memory[k as usize]);
            for i in 0..loads.len() {
                let Some(was) = known(&candidates[i]).map(|m| m.shown) else { continue };
                let own = self.spread[i].shown_as(was);
                let from = |(j, c): (usize, &Candidate)| {
                    let Some(m) = known(c) else { return 0.0 };
                    (self.between(i, j) - own.between(&self.spread[j].shown_as(m.shown))) * m.multiplier
                };
                loads[i].receded += candidates.iter().enumerate().map(from).sum::<Real>();
            }
        }
    }

    /// Gives the load `i` its row, and those after it that are near it on the same face.
    fn hang_around(
        &mut self,
        on: &Touchable,
        i: usize,
        candidates: &[Candidate],
        loads: &mut [Load],
        Before { memory, changed }: Before,
    ) {
        let (origin, normal, near) = (loads[i].place, candidates[i].normal, self.supports[i]);
        let is_near =
            |j: usize, load: &Load| candidates[j].normal.dot(&normal) > ALIKE && (load.place - origin).norm() < near;
        let with = || (i..loads.len()).filter(|j| self.supports[*j] > 0.0 && is_near(*j, &loads[*j]));
        let radius = with().map(|j| (loads[j].place - origin).norm() + self.supports[j]).fold(0.0, Real::max);
        self.around.gather(on.body, on.mesh, candidates[i].stencil[0].0, origin, radius);
        for j in i..loads.len() {
            let load = &mut loads[j];
            if self.supports[j] <= 0.0 || !is_near(j, load) {
                continue;
            }
            // What hangs on too few nodes for that hangs as it is displayed.
            if let Some(row) = self.around.row(load.place, self.supports[j]) {
                load.touched = row.interpolate(&on.mesh.motion.position);
                (load.row, load.geomorph) = (row, Vec3::zeros());
            }
            let known = candidates[j].known.filter(|_| changed).map(|k| &memory[k as usize]);
            if let Some(m) = known.filter(|m| m.multiplier > 0.0) {
                let corners = on.body.corners_of_point(m.point);
                let at = at_rest(on.body, corners.into_iter().zip(m.weights));
                let row = self.around.row(at, self.supports[j]);
                let now = row.map_or(m.place, |row| row.interpolate(&on.mesh.motion.position));
                load.receded = candidates[j].normal.dot(&(now - m.place));
            }
            self.supports[j] = 0.0;
        }
    }

    /// The load of point `i` as the mesh shows it.
    pub(super) fn load(&self, i: usize) -> &Narrow {
        &self.spread[i]
    }

    /// What a newton on point `j` adds at point `i` to the dent that the mesh leaves out [m/N].
    pub(super) fn between(&self, i: usize, j: usize) -> Real {
        self.spread[i].between(&self.spread[j])
    }
}

/// Of a point [m²]: what has no area would give way without bound.
const LEAST_AREA: Real = 1e-12;
