//! The dent that the mesh is too coarse to show.
//!
//! Under a point load an elastic half-space gives way by `1/r`, times [`half_space`]; a mesh shows the part of it that lies
//! farther away than its elements are wide. The rest is put in series with each contact point, as a compliance that all
//! points of a tool share.

use super::candidate::Candidate;
use super::detection::{Touchable, points_of_a_part};
use super::shape::Posed;
use crate::math::{Real, Vec3};
use crate::model::constraint::PointMemory;
use crate::model::{Material, Row, skin};

/// What a candidate's force does to the surface below the mesh's size.
#[derive(Clone, Copy, Debug)]
pub(super) struct Load {
    place: Vec3,
    normal: Vec3,
    /// The nodes that carry it, ...
    pub(super) row: Row,
    /// ... and the fade of the place [m].
    pub(super) fade: Vec3,
    /// As [`Candidate::taken`], followed [m²].
    pub(super) taken: Real,
    /// Radius of the disc that it spreads over [m].
    radius: Real,
    /// What the mesh shows of its dent, over that of a half-space at a distance of one [1/m].
    pub(super) shown: Real,
    /// What a half-space of the material under it gives way by, per newton and per distance [m²/N].
    half_space: Real,
    /// Poisson's ratio of that material.
    pub(super) nu: Real,
    /// Last multiplier [N].
    pub(super) multiplier: Real,
    /// As [`Constraint::disc`](crate::model::Constraint::disc).
    pub(super) disc: Real,
}

impl Load {
    pub(super) fn new(on: &Touchable, candidate: &Candidate, memory: &[PointMemory], followed: Real) -> Self {
        let stencil = candidate.stencil();
        let nearest = stencil.iter().max_by(|a, b| a.1.total_cmp(&b.1)).map_or(stencil[0].0, |(v, _)| *v);
        let material = on.body.material_at(nearest);
        let half_space = half_space(material);
        let (row, fade) = skin::row(on.mesh, stencil);
        // A load is felt about as far as the elements that carry it are wide, and as much as their nodes give way: one on
        // a node moves that alone, one between nodes has to move them all.
        let width: Real = stencil.iter().map(|(v, w)| w * width(on, *v)).sum();
        let alone = |&(slot, b): &(u32, Real)| b * b * on.body.node_compliance(on.mesh.node(slot));
        let alone: Real = row.entries().iter().map(alone).sum();
        let now = WIDE / width + (ALONE + ALONE_LAMBDA * material.lambda / material.mu) * alone / half_space;
        let known = candidate.known.map(|k| &memory[k as usize]);
        // Where the resolution has changed, or a point beside this one is no longer kept, they are others all at once.
        let follow = |before: Real, now: Real| before + followed * (now - before);
        let shown = known.map_or(now, |m| follow(m.shown, now));
        let taken = known.map_or(candidate.taken, |m| follow(m.taken, candidate.taken));
        Self {
            place: candidate.place,
            normal: candidate.normal,
            row,
            fade,
            taken,
            radius: ((candidate.area + taken) / std::f64::consts::PI).sqrt().max(LEAST_RADIUS),
            shown,
            half_space,
            nu: material.poisson_ratio(),
            multiplier: known.map_or(0.0, |m| m.multiplier),
            disc: 0.0,
        }
    }

    /// Under itself [m/N]: the mean over its disc.
    pub(super) fn own(&self) -> Real {
        let (s, c) = (self.radius, self.shown);
        self.half_space * if s * c < CUT { 2.0 / s - c + 2.0 / 15.0 * s * c * c } else { BEYOND / (c * s * s) }
    }

    /// Here, along this normal, because of `other` [m/N]. Discs that overlap count as side by side, or the matrix would not
    /// be positive definite.
    pub(super) fn from(&self, other: &Load) -> Real {
        let c = 0.5 * (self.shown + other.shown);
        let squared = (self.place - other.place).norm_squared();
        // Most pairs are farther apart than that.
        if squared * c * c >= CUT * CUT {
            return 0.0;
        }
        let apart = squared.sqrt().max(LEAST_APART * (self.radius + other.radius));
        let shown = (1.0 / apart - c + 0.2 * c * c * apart).max(0.0);
        // Between two materials it is neither's.
        0.5 * (self.half_space + other.half_space) * shown * self.normal.dot(&other.normal).max(0.0)
    }

    /// What is left of it beyond [`MOST_DENT`] [m/N]: none at all would leave nothing to divide by where a point hangs on
    /// nodes that are held fast.
    pub(super) fn firm(&self) -> Real {
        FIRMER * self.half_space * self.shown
    }
}

/// `(1−ν²)/(πE)` [m²/N]: an elastic half-space gives way by this much per newton and per distance from the load.
fn half_space(material: &Material) -> Real {
    let nu = material.poisson_ratio();
    (1.0 - nu * nu) / (std::f64::consts::PI * material.youngs_modulus())
}

/// How far a load on display vertex `v` is felt [m]. Each vertex hangs on a level of its own; after a change of resolution that
/// fades over, too.
fn width(on: &Touchable, v: u32) -> Real {
    let attachment = on.mesh.attachment(v);
    on.body.element_width(attachment.element) * (1.0 + on.mesh.fade[v as usize][3] / attachment.spacing)
}

/// A triangle's point that comes near one of its corners hands its area on to all three, little by little: on the corner it
/// is no more, and nothing is to be felt of that.
pub(super) fn give_on(on: &Touchable, parts: &[Posed], candidates: &mut [Candidate]) {
    let (vertices, per_part) = (on.vertices.len() as u32, points_of_a_part(on.body));
    for i in 0..candidates.len() {
        let c = candidates[i];
        if c.point % per_part < vertices {
            continue;
        }
        let near = GIVEN_ON * parts[c.part as usize].part.half_thickness();
        let nearest = c.stencil.iter().map(|(v, _)| (on.vertices[*v as usize] - c.place).norm()).fold(near, Real::min);
        let x = nearest / near;
        let kept = x * x * (3.0 - 2.0 * x);
        candidates[i].area *= kept;
        for (v, _) in c.stencil {
            let corner = v + c.part * per_part;
            if let Ok(k) = candidates.binary_search_by_key(&corner, |c| c.point) {
                candidates[k].area += (1.0 - kept) * c.area / 3.0;
            }
        }
    }
}

/// The points of a ball together have no more area than the disc that it touches, of radius `a³ = 3FR/(4E*)` [Hertz 1881],
/// `F` the force of the last tick, however large the triangles are. The area that counts is `(ΣF)²/Σ(F²/A)`, to which a new
/// point adds nothing at first.
pub(super) fn share_discs(parts: &[Posed], candidates: &[Candidate], loads: &mut [Load]) {
    for (part, at) in parts.iter().enumerate() {
        let Some(radius) = at.part.ball_radius() else { continue };
        let own = |i: &usize| candidates[*i].part as usize == part;
        let (mut force, mut reach, mut squares) = (0.0, 0.0, 0.0);
        for load in (0..loads.len()).filter(own).map(|i| &loads[i]) {
            force += load.multiplier;
            reach += load.multiplier * load.half_space;
            squares += load.multiplier * load.multiplier / (load.radius * load.radius);
        }
        // 1/E* is π times the half-space's compliance.
        let disc = cube_root(0.75 * std::f64::consts::PI * radius * reach);
        let most = (disc * disc).max(LEAST_DEPTH * radius);
        for i in (0..loads.len()).filter(own) {
            let load = &mut loads[i];
            if force <= 0.0 {
                load.radius = load.radius.min(most.sqrt());
            } else if force * force > most * squares {
                load.radius *= (most * squares).sqrt() / force;
                // The disc grows with the cube root of the force.
                let (s, c) = (load.radius, load.shown);
                let grows = (2.0 / s - 2.0 / 15.0 * s * c * c).max(0.0) / 3.0;
                load.disc = load.half_space * grows * load.multiplier / force;
            }
        }
    }
}

/// By Newton's method, after bringing `x` ≥ 0 between 1/8 and 1: the same on every machine.
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

/// What a mesh shows of a point load's dent, measured at random places of covers of blocks: this over the width of the
/// elements that carry it, ...
const WIDE: Real = 0.97;
/// ... and this much of what its nodes give way alone, ...
const ALONE: Real = 1.2;
/// ... more by this for each λ/μ.
const ALONE_LAMBDA: Real = 0.05;
/// The mesh shows all of a dent from this far on, times what it shows of it at its middle: where `1/x − 1 + x/5` is 0.
const CUT: Real = 1.382;
/// What continues a disc's own dent beyond that.
const BEYOND: Real = 1.206;
/// Least distance between two loads over the sum of their radii.
const LEAST_APART: Real = 0.85;
/// Part of half of a part's thickness that the dent below the mesh's size may take: beyond it the displayed surface would swallow
/// a thin tip and lose it at the next triangle.
pub(super) const MOST_DENT: Real = 0.3;
/// Part of what the mesh shows that is left of the compliance beyond that.
const FIRMER: Real = 0.025;
/// Part of half of a part's thickness within which a triangle's point hands its area on to a corner.
const GIVEN_ON: Real = 0.3;
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
