//! Several bodies to one, of which each is an organ.
//!
//! They share nothing, and push each other where they touch. What overlaps at rest by more than display surfaces are off what they stand
//! for is refused.

use super::{PrepareError, maxwell_branches};
use palpate_core::geometry::locate::Host;
use palpate_core::geometry::{Moments, Surface};
use palpate_core::hierarchy::Level;
use palpate_core::ids::NONE;
use palpate_core::math::{Mat3, Pose, Real, Vec3, from_parry, to_parry};
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
        "{first} and {second} overlap by {:.2} mm around ({:.4}, {:.4}, {:.4}) m: organs may touch, but give them positions in which \
         they overlap by no more than {:.2} mm, half of what their display vertices are apart",
        depth * 1e3, at.x, at.y, at.z, most * 1e3
    )]
    Overlap { first: String, second: String, depth: Real, most: Real, at: Vec3 },
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
    let mut directions = std::mem::take(&mut parts.labels.directions);
    let of_materials = parts.materials.iter_mut().chain(&mut parts.mixtures.tissues).map(|m| &mut m.fibres.direction);
    directions.iter_mut().flatten().chain(of_materials).for_each(|a| *a = turn * *a);
    parts.labels = LabelParts { directions, ..LabelParts::default() };
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
        let most = 0.5 * spacing(&surface).min(spacing(&next.surface));
        if let Some((depth, at)) = deepest(&surface, &next.surface).filter(|(depth, _)| *depth > most) {
            return Err(MergeError::Overlap { first: organ.name.clone(), second: next.name.clone(), depth, most, at });
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

/// How far apart neighbouring vertices of `surface` are on the mean [m]: edges of as many equal triangles.
fn spacing(surface: &Surface) -> Real {
    let area: Real = surface.vertex_areas().iter().sum();
    (area / surface.triangles.len() as Real * 4.0 / (3.0 as Real).sqrt()).sqrt()
}

/// How deep two closed surfaces are in each other at most [m], and where [m]: at their vertices, and in the middle of their triangles and
/// edges. `None` where they are apart.
fn deepest(a: &Surface, b: &Surface) -> Option<(Real, Vec3)> {
    let (of_a, of_b) = (a.bounds(), b.bounds());
    if (0..3).any(|c| of_a.high[c] < of_b.low[c] || of_b.high[c] < of_a.low[c]) {
        return None;
    }
    let (bounds, mesh) = ([of_b, of_a], [b.to_trimesh(), a.to_trimesh()]);
    let places = |surface: &Surface| {
        let of_triangle = |t: usize| {
            let [a, b, c] = surface.corners(t);
            [(a + b + c) / 3.0, (a + b) * 0.5, (b + c) * 0.5, (c + a) * 0.5]
        };
        let within = (0..surface.triangles.len()).flat_map(of_triangle);
        surface.vertices.iter().copied().chain(within).collect::<Vec<_>>()
    };
    let inside = |(other, p): (usize, Vec3)| {
        let found = bounds[other].contains(&p).then(|| mesh[other].project_local_point(to_parry(p), false));
        found.filter(|found| found.is_inside).map(|found| ((from_parry(found.point) - p).norm(), p))
    };
    let all = [places(a), places(b)].into_iter().enumerate().flat_map(|(i, all)| all.into_iter().map(move |p| (i, p)));
    all.filter_map(inside).max_by(|a, b| a.0.total_cmp(&b.0))
}

fn append_surface(to: &mut Surface, from: Surface) {
    let first = to.vertices.len() as u32;
    to.vertices.extend(from.vertices);
    to.triangles.extend(from.triangles.into_iter().map(|t| t.map(|v| v + first)));
}

/// Puts `next` behind what `whole` has of everything.
fn append(whole: &mut BodyParts, mut next: BodyParts) -> Result<(), MergeError> {
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
    let directions = [&mut whole.labels.directions, &mut next.labels.directions];
    if directions.iter().any(|of| !of.is_empty()) {
        for (directions, levels) in directions.into_iter().zip([&whole.levels, &next.levels]) {
            let none = levels.iter().map(|level| vec![Vec3::zeros(); level.mesh.elements.len()]);
            directions.extend(none.skip(directions.len()));
        }
        let own = whole.labels.directions.iter_mut();
        own.zip(&next.labels.directions).for_each(|(own, next)| own.extend(next));
    }
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
    to.parent.extend(from.parent.into_iter().map(|n| n + coarser.nodes));
    to.coarser_host.extend(from.coarser_host.into_iter().map(behind(coarser.elements)));
    to.finer_host.extend(from.finer_host.into_iter().map(behind(finer.elements)));
    to.embedding.extend(from.embedding.into_iter().map(behind(own.elements)));
    to.fixed.extend(from.fixed.into_iter().map(|n| n + own.nodes));
    to.ghosts.extend(from.ghosts.into_iter().map(|n| n + own.nodes));
}
