//! How points of the display hang on the nodes of smoothed elements, of whatever level these are: by moving least squares
//! ([`crate::model::contact_row`]), and with what the mesh leaves out of their own loads ([`super::influence`]).

use super::candidate::{ALIKE, Candidate};
use super::dent::Load;
use super::influence::{Narrow, variance_of_disc};
use super::samples::{shown_variance, support};
use super::tool::MOST_POINTS;
use super::touchable::Touchable;
use crate::math::{Real, Vec3};
use crate::model::Body;
use crate::model::contact_row::Surroundings;
use std::f64::consts::PI;

/// What it takes to hang points on nodes.
#[derive(Debug)]
pub(super) struct Hanging {
    around: Surroundings,
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
    pub(super) fn hang(&mut self, on: &Touchable, candidates: &[Candidate], loads: &mut [Load]) {
        self.spread.clear();
        self.supports.clear();
        for (candidate, load) in candidates.iter().zip(loads.iter()) {
            let stencil = candidate.stencil();
            let spacing: Real = stencil.iter().map(|(v, w)| on.mesh.embedding(*v).spacing * w).sum();
            self.supports.push(support(on) * spacing);
            self.spread.push(Narrow {
                place: candidate.place,
                normal: candidate.normal,
                variance: variance_of_disc(PI * load.radius * load.radius),
                shown: shown_variance(on, stencil[0].0, spacing),
                compliance: load.half_space,
            });
        }
        for i in 0..loads.len() {
            if self.supports[i] > 0.0 {
                self.hang_around(on, i, candidates, loads);
            }
        }
    }

    /// Gives the load `i` its row, and those after it that are near it on the same face.
    fn hang_around(&mut self, on: &Touchable, i: usize, candidates: &[Candidate], loads: &mut [Load]) {
        let (origin, normal, near) = (loads[i].place, candidates[i].normal, self.supports[i]);
        let is_near =
            |j: usize, load: &Load| candidates[j].normal.dot(&normal) > ALIKE && (load.place - origin).norm() < near;
        let with = || (i..loads.len()).filter(|j| self.supports[*j] > 0.0 && is_near(*j, &loads[*j]));
        let radius = with().map(|j| (loads[j].place - origin).norm() + self.supports[j]).fold(0.0, Real::max);
        let slots = on.mesh.embedding(candidates[i].stencil[0].0).slots;
        self.around.gather(on.body, on.mesh, &slots, origin, radius);
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
            self.supports[j] = 0.0;
        }
    }

    /// What a newton on point `j` adds at point `i` to the dent that the mesh leaves out [m/N].
    pub(super) fn between(&self, i: usize, j: usize) -> Real {
        self.spread[i].between(&self.spread[j])
    }
}
