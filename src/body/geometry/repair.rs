//! What can safely be repaired of a mesh before it is judged.

use super::pieces::Groups;
use super::soundness::weld;
use palpate_core::geometry::Surface;
use palpate_core::math::{Bounds, Real, Vec3};
use std::collections::BTreeMap;

/// What has been repaired, and how often.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Repairs {
    /// Vertices that lay where another does and were merged with it.
    pub merged: usize,
    /// Vertices on borders that lay within rounding of another there and were merged with it; nodes of meshes, too, that
    /// belong to pieces apart.
    pub joined: usize,
    /// Triangles dropped: with two corners at one place, or listed twice; tetrahedra listed twice.
    pub dropped: usize,
    /// Triangles that faced another way than their neighbours, or inward, and were turned; tetrahedra that were all inside
    /// out.
    pub turned: usize,
    /// Holes closed.
    pub closed: usize,
    /// What the file holds and was not taken, in words.
    pub left_out: Vec<String>,
    /// What else a report is to say of the file.
    pub notes: Vec<String>,
}

impl std::fmt::Display for Repairs {
    fn fmt(&self, f: &mut std::fmt::Formatter) -> std::fmt::Result {
        let parts = [
            (self.merged, "vertices merged with others at their place"),
            (self.joined, "vertices merged with others that differ from them in the last digits"),
            (self.dropped, "degenerate or doubled cells dropped"),
            (self.turned, "cells turned the right way round"),
            (self.closed, "holes closed"),
        ];
        let said: Vec<String> =
            parts.iter().filter(|(count, _)| *count > 0).map(|(count, what)| format!("{count} {what}")).collect();
        f.write_str(if said.is_empty() { "nothing" } else { "" })?;
        f.write_str(&said.join(", "))
    }
}

/// The surface of `triangles`, with one vertex for each place, no triangle that is degenerate or listed twice,
/// neighbours that face the same side, and no holes that are at most `holes` wide [m]. Whether it faces outward on the
/// whole is not looked at; nor whether it is sound now.
pub(super) fn repair(vertices: &[Vec3], triangles: &[[u32; 3]], holes: Real) -> (Surface, Repairs) {
    let mut surface = weld(vertices, triangles);
    let joined = join_borders(&mut surface);
    let mut named = vec![false; vertices.len()];
    triangles.as_flattened().iter().for_each(|v| named[*v as usize] = true);
    let merged = named.iter().filter(|named| **named).count().saturating_sub(surface.vertices.len() + joined);
    drop_doubled(&mut surface.triangles);
    let dropped = triangles.len() - surface.triangles.len();
    let turned = turn(&mut surface.triangles);
    let closed = if holes > 0.0 { close_holes(&mut surface, holes) } else { 0 };
    (surface, Repairs { merged, joined, dropped, turned, closed, ..Repairs::default() })
}

/// Merges vertices on borders that lie within rounding of another on a border; how many. Elsewhere no vertex is moved, so that
/// a surface without borders stays as it is, however fine.
fn join_borders(surface: &mut Surface) -> usize {
    let mut sides: Vec<[u32; 2]> =
        surface.triangles.iter().flat_map(|t| edges(*t).map(|[a, b]| [a.min(b), a.max(b)])).collect();
    sides.sort_unstable();
    let mut border: Vec<u32> =
        sides.chunk_by(|a, b| a == b).filter(|edge| edge.len() == 1).flat_map(|edge| edge[0]).collect();
    border.sort_unstable();
    border.dedup();
    let number = joined(&surface.vertices, &border, rounding(surface.bounds()));
    let triangles: Vec<[u32; 3]> = surface.triangles.iter().map(|t| t.map(|v| number[v as usize])).collect();
    let before = surface.vertices.len();
    *surface = weld(&surface.vertices, &triangles);
    before - surface.vertices.len()
}

/// How far apart two places may be that are one but for how their coordinates were rounded [m], in `bounds`: as far as
/// numbers of five digits are within them, or numbers of single precision at their distance from the origin.
pub(super) fn rounding(bounds: Bounds) -> Real {
    let extent = bounds.size().norm();
    let farthest = bounds.low.amax().max(bounds.high.amax());
    (DIGITS * extent).max(SINGLE * farthest).min(MOST_ROUNDED * extent)
}

/// Tolerance over the extent (no unit, tuned): 2 µm in an organ of 0.2 m. With less, files of five digits keep their cracks;
/// with more, borders would close that lie apart on purpose, as of a wall of paper.
const DIGITS: Real = 1e-5;
/// Four units in the last place of a number of single precision, over the number (no unit, derived): two roundings of a
/// number and its conversion. With less, cracks stay in files far from the origin; with more as above.
const SINGLE: Real = 4.0 * f32::EPSILON as Real;
/// Largest tolerance over the extent (no unit, tuned): so far from the origin single precision holds no shape. With less,
/// cracks stay in files that are far away; with more, what is written in double precision there loses details.
const MOST_ROUNDED: Real = 1e-3;

/// For each of `points` its own number, or for those of `some`, ascending, that of the first of them within `tolerance` [m],
/// step by step.
pub(super) fn joined(points: &[Vec3], some: &[u32], tolerance: Real) -> Vec<u32> {
    let mut groups = Groups::new(points.len());
    // By place along x, so that only neighbours there need a look.
    let mut along: Vec<u32> = some.to_vec();
    let at = |n: u32| points[n as usize];
    along.sort_by(|a, b| at(*a).x.total_cmp(&at(*b).x));
    for (i, a) in along.iter().enumerate() {
        let near = along[i + 1..].iter().take_while(|b| at(**b).x - at(*a).x <= tolerance);
        for b in near.filter(|b| (at(**b) - at(*a)).norm() <= tolerance) {
            groups.join(*a.min(b), *a.max(b));
        }
    }
    // The least of each group stands for it.
    let mut least: Vec<u32> = (0..points.len() as u32).collect();
    some.iter().rev().for_each(|n| least[groups.of(*n) as usize] = *n);
    (0..points.len() as u32).map(|n| least[groups.of(n) as usize]).collect()
}

/// Drops triangles whose corners another lists in the same order.
fn drop_doubled(triangles: &mut Vec<[u32; 3]>) {
    let turned_to_least = |&[a, b, c]: &[u32; 3]| [[a, b, c], [b, c, a], [c, a, b]].into_iter().min();
    let mut seen = std::collections::HashSet::new();
    triangles.retain(|t| seen.insert(turned_to_least(t)));
}

/// The edges of triangle `t`, each from corner to corner.
fn edges([a, b, c]: [u32; 3]) -> [[u32; 2]; 3] {
    [[a, b], [b, c], [c, a]]
}

/// Turns the fewer triangles of each connected part, so that neighbours face the same side where that can be; how many.
fn turn(triangles: &mut [[u32; 3]]) -> usize {
    let mut sides: Vec<([u32; 2], bool, usize)> = triangles
        .iter()
        .enumerate()
        .flat_map(|(t, triangle)| edges(*triangle).map(|[a, b]| ([a.min(b), a.max(b)], a < b, t)))
        .collect();
    sides.sort_unstable();
    let mut beside: Vec<Vec<(usize, bool)>> = vec![Vec::new(); triangles.len()];
    for pair in sides.chunk_by(|a, b| a.0 == b.0).filter(|edge| edge.len() == 2) {
        let apart = pair[0].1 == pair[1].1;
        beside[pair[0].2].push((pair[1].2, apart));
        beside[pair[1].2].push((pair[0].2, apart));
    }
    let mut faces: Vec<Option<bool>> = vec![None; triangles.len()];
    let mut turned = 0;
    for first in 0..triangles.len() {
        if faces[first].is_some() {
            continue;
        }
        faces[first] = Some(false);
        let mut part = vec![first];
        let mut next = 0;
        while let Some(&t) = part.get(next) {
            next += 1;
            for &(other, apart) in &beside[t] {
                if faces[other].is_none() {
                    faces[other] = faces[t].map(|turned| turned ^ apart);
                    part.push(other);
                }
            }
        }
        let count = part.iter().filter(|t| faces[**t] == Some(true)).count();
        let fewer = 2 * count <= part.len();
        for t in part.iter().filter(|t| faces[**t] == Some(fewer)) {
            triangles[*t].swap(1, 2);
        }
        turned += if fewer { count } else { part.len() - count };
    }
    turned
}

/// Closes holes that are at most `width` wide [m] by a fan around their middle; how many. Holes that touch are left.
fn close_holes(surface: &mut Surface, width: Real) -> usize {
    let mut sides: Vec<([u32; 2], [u32; 2])> =
        (surface.triangles.iter()).flat_map(|t| edges(*t).map(|[a, b]| ([a.min(b), a.max(b)], [a, b]))).collect();
    sides.sort_unstable();
    let border = sides.chunk_by(|a, b| a.0 == b.0).filter(|edge| edge.len() == 1).map(|edge| edge[0].1);
    // Where a border goes on from each of its vertices; nowhere where two holes touch.
    let mut onward: BTreeMap<u32, Option<u32>> = BTreeMap::new();
    for [from, to] in border {
        onward.entry(from).and_modify(|next| *next = None).or_insert(Some(to));
    }
    let mut closed = 0;
    while let Some((first, next)) = onward.pop_first() {
        let mut hole = vec![first];
        let mut next = next;
        while let Some(v) = next.filter(|v| *v != first) {
            hole.push(v);
            next = onward.remove(&v).flatten();
        }
        let at = |v: &u32| surface.vertices[*v as usize];
        let wide = Bounds::of(hole.iter().map(at)).size().norm();
        if next != Some(first) || hole.len() < 3 || wide > width {
            continue;
        }
        // The border runs the way of its triangles, what closes it the other way.
        if let [a, b, c] = hole[..] {
            surface.triangles.push([c, b, a]);
        } else {
            let middle = hole.iter().map(at).sum::<Vec3>() / hole.len() as Real;
            let m = surface.vertices.len() as u32;
            surface.vertices.push(middle);
            let next = hole.iter().cycle().skip(1);
            surface.triangles.extend(hole.iter().zip(next).map(|(a, b)| [*b, *a, m]));
        }
        closed += 1;
    }
    closed
}

#[cfg(test)]
mod tests {
    use super::super::soundness::check_closed;
    use super::*;
    use crate::geometry::primitives::sphere_surface;
    use palpate_core::geometry::primitives::box_surface;

    #[test]
    fn what_is_sound_stays_as_it_is() {
        for surface in [box_surface(Vec3::repeat(0.1), [2; 3]), sphere_surface(0.05, 0.01)] {
            let (after, repairs) = repair(&surface.vertices, &surface.triangles, 1.0);
            assert_eq!((&after, &repairs), (&surface, &Repairs::default()));
            assert_eq!(repairs.to_string(), "nothing");
        }
    }

    #[test]
    fn vertices_on_borders_that_differ_in_their_last_digits_are_one_and_no_others() {
        for (away, digit) in [(0.0, 1e-7), (1e2, 8e-6)] {
            let cube = box_surface(Vec3::repeat(0.1), [5; 3]);
            let place = |v: u32, t: usize| {
                let off = if (t + v as usize).is_multiple_of(3) { digit } else { 0.0 };
                cube.vertices[v as usize] + Vec3::new(away + off, off, 0.0)
            };
            let vertices: Vec<Vec3> =
                cube.triangles.iter().enumerate().flat_map(|(t, corners)| corners.map(|v| place(v, t))).collect();
            let triangles: Vec<[u32; 3]> =
                (0..cube.triangles.len() as u32).map(|t| [3 * t, 3 * t + 1, 3 * t + 2]).collect();
            let (mut after, repairs) = repair(&vertices, &triangles, 0.0);
            check_closed(&mut after).unwrap();
            assert_eq!(after.vertices.len(), cube.vertices.len());
            assert!(repairs.joined > 0 && repairs.to_string().contains("in the last digits"), "{repairs}");
        }
        // As far apart as a millionth of it, but on no border.
        let mut fine = box_surface(Vec3::repeat(0.1), [2; 3]);
        let [a, b, _] = fine.triangles[0];
        fine.vertices[a as usize] = fine.vertices[b as usize] + Vec3::repeat(1e-8);
        let (after, repairs) = repair(&fine.vertices, &fine.triangles, 0.0);
        assert_eq!((after, repairs), (fine, Repairs::default()));
    }

    #[test]
    fn triangles_that_face_another_way_than_most_are_turned() {
        let cube = box_surface(Vec3::repeat(0.1), [3; 3]);
        for turned in [5, cube.triangles.len() - 5] {
            let mut mixed = cube.clone();
            mixed.triangles.iter_mut().take(turned).for_each(|t| t.swap(1, 2));
            let (mut after, repairs) = repair(&mixed.vertices, &mixed.triangles, 0.0);
            assert_eq!(repairs, Repairs { turned: 5, ..Repairs::default() });
            check_closed(&mut after).unwrap();
            assert!((after.volume() - cube.volume()).abs() < 1e-15);
        }
    }

    #[test]
    fn doubled_and_degenerate_triangles_go_and_vertices_at_one_place_become_one() {
        let cube = box_surface(Vec3::repeat(0.1), [1; 3]);
        let [a, b, c] = cube.triangles[3];
        let mut more = cube.clone();
        more.vertices.push(cube.vertices[0]);
        more.triangles.extend([[b, c, a], [a, a, b], [0, 8, b]]);
        let (after, repairs) = repair(&more.vertices, &more.triangles, 0.0);
        assert_eq!((after, &repairs), (cube, &Repairs { merged: 1, dropped: 3, ..Repairs::default() }));
        assert!(repairs.to_string().starts_with("1 vertices merged"), "{repairs}");
    }

    #[test]
    fn holes_up_to_a_width_are_closed_and_wider_ones_left() {
        let cube = box_surface(Vec3::repeat(0.1), [4; 3]);
        let mut holed = cube.clone();
        // One triangle, and all around a vertex elsewhere.
        let around = |v: Vec3| move |p: &Vec3| (p - v).norm() < 1e-9;
        let middle = cube.vertices.iter().position(around(Vec3::new(0.05, 0.05, 0.1))).unwrap() as u32;
        holed.triangles.retain(|t| !t.contains(&middle));
        holed.triangles.remove(0);
        let (mut after, repairs) = repair(&holed.vertices, &holed.triangles, 0.08);
        assert_eq!(repairs, Repairs { closed: 2, ..Repairs::default() });
        check_closed(&mut after).unwrap();
        assert!((after.volume() - cube.volume()).abs() < 1e-12);
        let (mut after, repairs) = repair(&holed.vertices, &holed.triangles, 0.04);
        assert_eq!(repairs.closed, 1);
        check_closed(&mut after).unwrap_err();
    }
}
