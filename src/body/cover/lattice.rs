//! The elements of a body-centred cubic lattice that a closed surface reaches or encloses.
//!
//! Labelle and Shewchuk's lattice [isosurface stuffing, 2007]: cubes and their middles are nodes, and around the line
//! between two neighbouring middles lie four elements, one per edge of the face between the cubes. All elements are alike,
//! with every altitude a/√2 for the edge `a` of a cube. Cubes are looked for from large blocks down, so that the work goes
//! with the body and not with the box around it, which is some thousand times as large for a turned rod or sheet.

use palpate_core::geometry::Surface;
use palpate_core::geometry::tet_mesh::TetMesh;
use palpate_core::math::{Bounds, Mat3, Pose, Real, Vec3, from_parry, to_parry};
use parry3d_f64::query::PointQuery;
use parry3d_f64::shape::TriMesh;
use rayon::prelude::*;

/// Elements of a lattice near and inside a surface.
pub(super) struct Lattice {
    /// All elements that the surface reaches or encloses, and some that it does not; in the surface's frame [m].
    pub(super) mesh: TetMesh,
    /// Elements that are known to lie inside (n_elements).
    pub(super) inside: Vec<bool>,
}

/// Blocks of fewer cubes along an edge are not worth a task of their own.
const SMALL_BLOCK: i32 = 8;

impl Lattice {
    /// The lattice of constant `spacing` [m] around `surface`, whose triangles are `around`, turned and shifted by
    /// `motion`.
    pub(super) fn around(surface: &Surface, around: &TriMesh, spacing: Real, motion: &Pose) -> Lattice {
        let turn = rotation(motion);
        let back = turn.transpose();
        let used = surface.triangles.iter().flatten().map(|v| turn * surface.vertices[*v as usize] + motion.position);
        let Bounds { low, high } = Bounds::of(used);
        // Two cubes of margin, so that all elements around a node of the surface's cubes are there.
        let origin = low.add_scalar(-spacing).add_scalar(-spacing);
        let half = spacing * 0.5;
        let place = |c: [i32; 3]| origin + Vec3::new(c[0].into(), c[1].into(), c[2].into()) * half;
        let in_body = |p: Vec3| back * (p - motion.position);
        let cubes = ((high - origin).max() / spacing).ceil() + 2.0;
        let mut size = 1;
        while Real::from(size) < cubes && size < 1 << 20 {
            size *= 2;
        }
        let distance = |first: [i32; 3], size: i32| {
            let middle = first.map(|c| 2 * c + size);
            signed_distance(around, in_body(place(middle)))
        };
        let mut cubes = reached([0; 3], size, spacing, &distance);
        cubes.par_sort_unstable_by_key(|(c, _)| (c[2], c[1], c[0]));

        let of_cube = |&(cube, inside): &([i32; 3], bool)| elements_of(cube).map(move |element| (element, inside));
        let elements: Vec<([[i32; 3]; 4], bool)> = cubes.par_iter().flat_map_iter(of_cube).collect();
        let mut nodes: Vec<[i32; 3]> = elements.par_iter().flat_map_iter(|(element, _)| *element).collect();
        nodes.par_sort_unstable();
        nodes.dedup();
        let number = |c: [i32; 3]| nodes.binary_search(&c).unwrap_or_default() as u32;
        let mesh = TetMesh {
            nodes: nodes.par_iter().map(|c| in_body(place(*c))).collect(),
            elements: elements.par_iter().map(|(element, _)| element.map(number)).collect(),
        };
        Lattice { mesh, inside: elements.into_iter().map(|(_, inside)| inside).collect() }
    }
}

/// The cubes of the block of `size` cubes along an edge from `first` on that have elements near or inside the surface at
/// `distance` from the middle of blocks, and whether those are known to be inside.
fn reached(
    first: [i32; 3],
    size: i32,
    spacing: Real,
    distance: &(impl Fn([i32; 3], i32) -> Real + Sync),
) -> Vec<([i32; 3], bool)> {
    // A cube's elements reach at most to the middle of the next one.
    let reach = spacing * (1.0 + 3.0f64.sqrt() / 2.0 * Real::from(size - 1));
    let distance_here = distance(first, size);
    if distance_here >= reach {
        return Vec::new();
    } else if distance_here <= -reach {
        let along = |axis: usize| first[axis]..first[axis] + size;
        let line = |k, j| along(0).map(move |i| ([i, j, k], true));
        return along(2).flat_map(|k| along(1).flat_map(move |j| line(k, j))).collect();
    } else if size == 1 {
        return vec![(first, false)];
    }
    let half = size / 2;
    let part = |c: usize| {
        let first = std::array::from_fn(|axis| first[axis] + if c >> axis & 1 == 1 { half } else { 0 });
        reached(first, half, spacing, distance)
    };
    if size > SMALL_BLOCK {
        (0..8).into_par_iter().flat_map_iter(part).collect()
    } else {
        (0..8).flat_map(part).collect()
    }
}

/// The twelve elements around the lines from the middle of `cube` to those of the next cube along each axis, as nodes in
/// half cubes: even ones are corners, odd ones middles.
fn elements_of(cube: [i32; 3]) -> impl Iterator<Item = [[i32; 3]; 4]> {
    let middle = cube.map(|c| 2 * c + 1);
    (0..12).map(move |e: usize| {
        let (axis, k) = (e / 4, e % 4);
        let mut next = middle;
        next[axis] += 2;
        let corner = |k: usize| {
            // Around the face between the two.
            const SIGNS: [[i32; 2]; 4] = [[1, 1], [-1, 1], [-1, -1], [1, -1]];
            let mut corner = middle;
            corner[axis] += 1;
            corner[(axis + 1) % 3] += SIGNS[k][0];
            corner[(axis + 2) % 3] += SIGNS[k][1];
            corner
        };
        oriented([middle, next, corner(k), corner((k + 1) % 4)])
    })
}

/// An element with its corners in the order of a positive volume.
fn oriented(element: [[i32; 3]; 4]) -> [[i32; 3]; 4] {
    let [a, b, c, d] = element.map(|p| Vec3::new(p[0].into(), p[1].into(), p[2].into()));
    if (b - a).cross(&(c - a)).dot(&(d - a)) < 0.0 { [element[1], element[0], element[2], element[3]] } else { element }
}

fn rotation(pose: &Pose) -> Mat3 {
    Mat3::from_columns(&[pose.rotate(Vec3::x()), pose.rotate(Vec3::y()), pose.rotate(Vec3::z())])
}

/// Signed distance of `p` from the surface [m], negative inside.
pub(super) fn signed_distance(surface: &TriMesh, p: Vec3) -> Real {
    let projection = surface.project_local_point(to_parry(p), false);
    let distance = (from_parry(projection.point) - p).norm();
    if projection.is_inside { -distance } else { distance }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::primitives::sphere_surface;
    use palpate_core::geometry::primitives::box_surface;
    use palpate_core::math::normalized_quaternion;
    use parry3d_f64::transformation::{VolumeMeshParameters, volume_mesh};
    use std::sync::atomic::{AtomicUsize, Ordering};

    fn turned() -> Pose {
        let orientation = normalized_quaternion([0.3, -0.2, 0.5, 0.7]).unwrap();
        Pose { position: Vec3::new(0.003, 0.001, 0.002), orientation }
    }

    #[test]
    fn the_lattice_has_all_that_a_search_through_the_whole_box_finds() {
        let spacing = 0.02;
        for surface in [sphere_surface(0.05, 0.01), box_surface(Vec3::new(0.2, 0.03, 0.01), [1; 3])] {
            let lattice = Lattice::around(&surface, &surface.to_trimesh(), spacing, &turned());
            let turn = rotation(&turned());
            let moved: Vec<_> = surface.vertices.iter().map(|v| to_parry(turn * v + turned().position)).collect();
            let all = volume_mesh(&moved, &surface.triangles, &VolumeMeshParameters::new(spacing)).unwrap();
            // Corners in half spacings.
            let key = |p: Vec3| (p / (0.5 * spacing)).map(|x| (x * 1e3).round() as i64);
            let sorted = |mut corners: [[i64; 3]; 4]| {
                corners.sort_unstable();
                corners
            };
            let ours: std::collections::HashSet<_> = (0..lattice.mesh.elements.len())
                .map(|e| sorted(lattice.mesh.corners(e).map(|u| key(turn * u + turned().position).into())))
                .collect();
            for cell in &all.cells {
                let cell = sorted(cell.map(|n| key(from_parry(all.vertices[n as usize])).into()));
                assert!(ours.contains(&cell), "{cell:?}");
            }
            for e in (0..lattice.mesh.elements.len()).filter(|e| lattice.inside[*e]) {
                assert!(lattice.mesh.corners(e).iter().all(|u| signed_distance(&surface.to_trimesh(), *u) <= 0.0));
                assert!(lattice.mesh.volume(e) > 0.0);
            }
        }
    }

    #[test]
    fn a_turned_rod_is_not_looked_for_in_the_whole_box_around_it() {
        let rod = box_surface(Vec3::new(0.004, 0.004, 0.4), [1; 3]);
        let (around, turn, spacing) = (rod.to_trimesh(), rotation(&turned()).transpose(), 0.001);
        let asked = AtomicUsize::new(0);
        let distance = |first: [i32; 3], size: i32| {
            asked.fetch_add(1, Ordering::Relaxed);
            let middle = Vec3::from(first.map(|c| Real::from(2 * c + size))) * (0.5 * spacing);
            signed_distance(&around, turn * (middle - Vec3::repeat(0.256)))
        };
        let reached = reached([0; 3], 512, spacing, &distance).len();
        assert!(reached > 2_000 && asked.into_inner() < 6 * reached, "{reached}");
    }
}
