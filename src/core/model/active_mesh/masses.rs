//! Masses of the nodes: of their own elements, of what hangs on them, and so that each organ keeps its mass and its centre.

use super::ActiveMesh;
use crate::ids::{Element, Slot};
use crate::math::{Mat3, Real, Vec3};
use crate::model::body::Body;
use crate::model::organ::MOST_ORGANS;

/// Units of mass in an organ's mass: sums of whole numbers do not depend on their order, so a node's mass does not
/// depend on how the set of active nodes came about.
pub(super) const MASS_UNITS: Real = (1u64 << 50) as Real;

impl ActiveMesh {
    /// Adds `more` active vertices' worth of the mass of element `e` to its nodes.
    pub(super) fn weigh(&mut self, body: &Body, e: Element, more: i64) {
        let mass = body.density(e) * body.volume(e);
        let nodes = body.element(e);
        let unit = (mass / 16.0 / self.mass_unit[body.organ_of(nodes[0]).index()] + 0.5) as i64;
        for n in nodes {
            self.own_mass[self.slot[n.index()].index()] += more * unit;
        }
    }

    pub(super) fn hand_mass(&mut self, slot: Slot, sign: i64) {
        let row = &self.row[slot.index()];
        let mass = self.handed_mass[slot.index()] as Real * row.amplification();
        for (master, weight) in row.entries() {
            self.gathered_mass[master.index()] += sign * (mass * weight.abs() + 0.5) as i64;
        }
    }

    /// Masses in kg: the sums in units, times the one affine function of the rest position that gives each organ its
    /// mass and its centre of mass whatever the active nodes are.
    pub(super) fn normalise(&mut self, body: &Body) {
        let mut sums = [(0.0, Vec3::zeros(), Mat3::zeros()); MOST_ORGANS];
        for &slot in &self.active {
            let s = slot.index();
            let organ = self.organ[s];
            let m = self.raw_mass(body, s);
            self.motion.mass[s] = m;
            let d = self.rest[s] - body.organ(organ).centre_of_mass;
            let (sum, first, second) = &mut sums[organ.index()];
            *sum += m;
            *first += d * m;
            *second += d * d.transpose() * m;
        }
        // Σ m (q + b·d) = M and Σ m (q + b·d) d = 0.
        let mut affine = [(0.0, Vec3::zeros()); MOST_ORGANS];
        for ((organ, (sum, first, second)), (q, b)) in body.organs().iter().zip(&sums).zip(&mut affine) {
            let along = second.try_inverse().map_or(Vec3::zeros(), |inverse| -(inverse * first));
            *q = organ.mass / (sum + along.dot(first));
            *b = along * *q;
        }
        for &slot in &self.active {
            let s = slot.index();
            let organ = self.organ[s];
            let (q, b) = &affine[organ.index()];
            let mass = self.motion.mass[s] * (q + b.dot(&(self.rest[s] - body.organ(organ).centre_of_mass)));
            self.motion.mass[s] = mass;
            self.motion.inverse_mass[s] = if body.is_fixed(self.node[s]) { 0.0 } else { 1.0 / mass };
        }
    }

    /// Mass [kg] of the active node in slot `s` before the body's mass and centre are restored.
    pub(super) fn raw_mass(&self, body: &Body, s: usize) -> Real {
        let unit = self.mass_unit[self.organ[s].index()];
        ((self.own_mass[s] + self.gathered_mass[s]) as Real * unit).max(body.least_mass(self.node[s]))
    }
}
