//! Several bodies to one, of which each is an organ.
//!
//! They share nothing, so that each moves as it would alone; what is not simulated is that they touch: two organs go
//! through each other. So bodies that overlap at rest are refused.

use super::{PrepareError, maxwell_branches};
use crate::geometry::crossings::crossings;
use palpate_core::geometry::locate::Host;
use palpate_core::geometry::{Moments, Surface};
use palpate_core::hierarchy::Level;
use palpate_core::ids::NONE;
use palpate_core::math::{Mat3, Pose, Real, Vec3, to_parry};
use palpate_core::model::Body;
use palpate_core::model::body::{BodyParts, LabelParts};
use palpate_core::model::organ::{MOST_ORGANS, OrganParts};
use parry3d_f64::query::PointQuery;

/// Why bodies cannot be organs of one.
#[derive(Debug, PartialEq, thiserror::Error)]
#[allow(missing_docs, reason = "the message of each variant names its fields")]
pub enum MergeError {
    #[error("{0} organs: a scene has up to {MOST_ORGANS}, [body] among them")]
    TooMany(usize),
    #[error(
        "{first} has {of_first} levels, {second} has {of_second}: organs of a scene have equally many; give their \
         spacings, or prepare one of them again with --levels"
    )]
    Levels { first: String, of_first: usize, second: String, of_second: usize },
    #[error(
        "{first} and {second} overlap or touch around ({:.4}, {:.4}, {:.4}) m: organs do not feel each other, so give \
         them positions apart",
        at.x, at.y, at.z
    )]
    Overlap { first: String, second: String, at: Vec3 },
    #[error("{first} and {second} are of other kinds of elements: organs of a scene are of one")]
    Elements { first: String, second: String },
    #[error("the organs are of more than 65,535 materials together: give fewer regions")]
    Materials,
}

/// The bodies, each at its pose, as one body of as many organs. `damping_ratio` is that of the slowest mode of all.
///
/// # Errors
/// When the bodies overlap or do not fit together.
pub fn merge(bodies: Vec<(Body, Pose)>, damping_ratio: Real) -> Result<Body, PrepareError> {
    if bodies.len() > MOST_ORGANS {
        return Err(MergeError::TooMany(bodies.len()).into());
    }
    let mut all = bodies.into_iter().map(|(body, pose)| placed(body.into_parts(), &pose));
    let Some(mut whole) = all.next() else { return Err(MergeError::TooMany(0).into()) };
    let mut moving: Vec<Real> = Some(whole.slowest_mode).filter(|mode| *mode > 0.0).into_iter().collect();
    for next in all {
        moving.extend(Some(next.slowest_mode).filter(|mode| *mode > 0.0));
        check(&whole, &next)?;
        append(&mut whole, next)?;
    }
    whole.name = whole.organs.iter().map(|organ| organ.name.as_str()).collect::<Vec<_>>().join(", ");
    whole.slowest_mode = moving.iter().copied().reduce(Real::min).unwrap_or(0.0);
    let fastest = moving.iter().copied().fold(0.0, Real::max);
    whole.maxwell = maxwell_branches(damping_ratio, whole.slowest_mode, fastest);
    Ok(Body::new(whole)?)
}

/// A body that is an organ, at `pose`.
fn placed(mut parts: BodyParts, pose: &Pose) -> BodyParts {
    let points = parts.levels.iter_mut().flat_map(|level| &mut level.mesh.nodes);
    points.chain(&mut parts.surface.vertices).for_each(|p| *p = pose.to_world(*p));
    let turn = Mat3::from_columns(&[Vec3::x(), Vec3::y(), Vec3::z()].map(|axis| pose.rotate(axis)));
    parts.shape.centre = pose.to_world(parts.shape.centre);
    parts.shape.second = turn * parts.shape.second * turn.transpose();
    let (vertices, triangles) = (parts.surface.vertices.len(), parts.surface.triangles.len());
    // Labels say what material is where, and that is settled.
    parts.labels = LabelParts::default();
    parts.organs = vec![OrganParts::whole(&parts.name, vertices, triangles, &parts.levels)];
    parts
}

/// Refuses `next` beside `whole` where they have other numbers of levels, or where an organ of `whole` is in its place.
fn check(whole: &BodyParts, next: &BodyParts) -> Result<(), MergeError> {
    if whole.levels.len() != next.levels.len() {
        return Err(MergeError::Levels {
            first: whole.organs[0].name.clone(),
            of_first: whole.levels.len(),
            second: next.name.clone(),
            of_second: next.levels.len(),
        });
    }
    if whole.is_smoothed() != next.is_smoothed() {
        return Err(MergeError::Elements { first: whole.organs[0].name.clone(), second: next.name.clone() });
    }
    let (mut vertex, mut triangle) = (0, 0);
    for organ in &whole.organs {
        let surface = part(&whole.surface, vertex, organ.vertices, triangle, organ.triangles);
        (vertex, triangle) = (vertex + organ.vertices, triangle + organ.triangles);
        if let Some(at) = meet(&surface, &next.surface) {
            return Err(MergeError::Overlap { first: organ.name.clone(), second: next.name.clone(), at });
        }
    }
    Ok(())
}

/// An organ's part of `surface`, as a surface of its own.
fn part(surface: &Surface, vertex: u32, vertices: u32, triangle: u32, triangles: u32) -> Surface {
    let range = |from: u32, count: u32| from as usize..(from + count) as usize;
    Surface {
        vertices: surface.vertices[range(vertex, vertices)].to_vec(),
        triangles: surface.triangles[range(triangle, triangles)].iter().map(|t| t.map(|v| v - vertex)).collect(),
    }
}

/// Where two closed surfaces cross or touch, or the one lies in the other.
fn meet(a: &Surface, b: &Surface) -> Option<Vec3> {
    let apart = {
        let (a, b) = (a.bounds(), b.bounds());
        (0..3).any(|c| a.high[c] < b.low[c] || b.high[c] < a.low[c])
    };
    if apart {
        return None;
    }
    let mut both = a.clone();
    append_surface(&mut both, b.clone());
    let between = |(s, t): &(u32, u32)| (*s as usize) < a.triangles.len() && *t as usize >= a.triangles.len();
    if let Some((s, _)) = crossings(&both).into_iter().find(between) {
        return Some(both.corners(s as usize).iter().sum::<Vec3>() / 3.0);
    }
    let lies_in = |inner: &Surface, outer: &Surface| {
        let point = inner.corners(0)[0];
        outer.to_trimesh().project_local_point(to_parry(point), false).is_inside.then_some(point)
    };
    lies_in(b, a).or_else(|| lies_in(a, b))
}

fn append_surface(to: &mut Surface, from: Surface) {
    let first = to.vertices.len() as u32;
    to.vertices.extend(from.vertices);
    to.triangles.extend(from.triangles.into_iter().map(|t| t.map(|v| v + first)));
}

/// Puts `next` behind what `whole` has of everything.
fn append(whole: &mut BodyParts, next: BodyParts) -> Result<(), MergeError> {
    let first_vertex = whole.surface.vertices.len() as u32;
    let first_material = whole.materials.len();
    if first_material + next.materials.len() > usize::from(u16::MAX) {
        return Err(MergeError::Materials);
    }
    append_surface(&mut whole.surface, next.surface);
    whole.shape = Moments::combined(&[(whole.shape, 1.0), (next.shape, 1.0)]);
    let supports = next.supports.into_iter().map(|mut hold| {
        hold.vertex.0 += first_vertex;
        hold
    });
    whole.supports.extend(supports);
    whole.materials.extend(next.materials);
    let first_tissue = whole.mixtures.tissues.len() as u16;
    whole.mixtures.tissues.extend(next.mixtures.tissues);
    let mixed = next.mixtures.of.into_iter();
    whole.mixtures.of.extend(mixed.map(|of| of.into_iter().map(|(t, n)| (t + first_tissue, n)).collect()));
    whole.organs.extend(next.organs.into_iter().map(|organ| OrganParts { material: first_material as u16, ..organ }));
    let count =
        |level: &Level| Count { nodes: level.mesh.nodes.len() as u32, elements: level.mesh.elements.len() as u32 };
    let before: Vec<Count> = whole.levels.iter().map(count).collect();
    for (r, from) in next.levels.into_iter().enumerate() {
        // A list that is left out stands for the first material everywhere.
        whole.material_of[r].resize(before[r].elements as usize, 0);
        let mut own = next.material_of[r].clone();
        own.resize(from.mesh.elements.len(), 0);
        whole.material_of[r].extend(own.iter().map(|m| m + first_material as u16));
        let finer = before[(r + 1).min(before.len() - 1)];
        append_level(&mut whole.levels[r], from, before[r.saturating_sub(1)], before[r], finer);
    }
    Ok(())
}

/// How much there is of a level.
#[derive(Clone, Copy)]
struct Count {
    nodes: u32,
    elements: u32,
}

/// Puts `from` behind `to`, of which there is `own` so far, and so much of the levels beside it.
fn append_level(to: &mut Level, from: Level, coarser: Count, own: Count, finer: Count) {
    to.spacing = to.spacing.min(from.spacing);
    to.altitude = to.altitude.min(from.altitude);
    to.least_mass = to.least_mass.min(from.least_mass);
    to.stabilisation = to.stabilisation.min(from.stabilisation);
    let behind = |first: u32| {
        move |host: Host| Host { element: if host.element == NONE { NONE } else { host.element + first }, ..host }
    };
    to.mesh.nodes.extend(from.mesh.nodes);
    to.mesh.elements.extend(from.mesh.elements.into_iter().map(|e| e.map(|n| n + own.nodes)));
    to.fraction.extend(from.fraction);
    to.density.extend(from.density);
    to.node_mass.extend(from.node_mass);
    to.stiffness_factor.extend(from.stiffness_factor);
    to.branch_factor.extend(from.branch_factor);
    to.parent.extend(from.parent.into_iter().map(|n| n + coarser.nodes));
    to.coarser_host.extend(from.coarser_host.into_iter().map(behind(coarser.elements)));
    to.finer_host.extend(from.finer_host.into_iter().map(behind(finer.elements)));
    to.embedding.extend(from.embedding.into_iter().map(behind(own.elements)));
    to.fixed.extend(from.fixed.into_iter().map(|n| n + own.nodes));
    to.ghosts.extend(from.ghosts.into_iter().map(|n| n + own.nodes));
}
