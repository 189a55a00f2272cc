//! Levels from a closed surface: a lattice cover whose elements are weighted by the part of them inside.
//!
//! parry's body-centred cubic cover takes any closed surface, and all its elements are alike, with every altitude
//! a/√2 for the lattice constant `a`. Each level turns and shifts the lattice by its own seeded motion, which makes
//! the levels independent: parry's lattices of ratio two would otherwise share vertices.

use super::level::Level;
use crate::geometry::Surface;
use crate::geometry::tet_mesh::TetMesh;
use crate::math::{Mat3, Pose, Real, Vec3, from_parry, normalized_quaternion, to_parry};
use parry3d_f64::query::PointQuery;
use parry3d_f64::shape::TriMesh;
use parry3d_f64::transformation::{VolumeMeshParameters, volume_mesh};
use rayon::prelude::*;

/// Elements with less than this part inside are dropped: nearly empty ones invert after seconds and blow up even a
/// uniform level.
const LEAST_FRACTION: Real = 0.1;

/// Why a surface could not be covered.
#[derive(Debug, thiserror::Error)]
pub enum CoverError {
    /// parry found nothing inside.
    #[error("no element of spacing {spacing} m fits the surface: give a spacing below its smallest thickness")]
    Empty {
        /// Lattice constant [m].
        spacing: Real,
    },
    /// More elements than one level may have.
    #[error(
        "spacing {spacing} m would make about {elements:.0} elements, over the limit of {limit}: give a coarser one"
    )]
    TooFine {
        /// Lattice constant [m].
        spacing: Real,
        /// Elements that it would make.
        elements: Real,
        /// Most elements of a level.
        limit: usize,
    },
}

/// Most elements of one level: about 2 GB while it is built.
pub const MOST_ELEMENTS: usize = 4_000_000;

/// The cover of `surface` (closed, outward) by a lattice of constant `spacing` [m], as level `index` of a body of
/// `density` [kg/m³].
///
/// # Errors
/// When nothing of the lattice lies inside, or far too much does.
pub fn cover(surface: &Surface, spacing: Real, index: u32, density: Real) -> Result<Level, CoverError> {
    let volume = surface.volume();
    let elements = 12.0 * volume / (spacing * spacing * spacing);
    #[expect(clippy::neg_cmp_op_on_partial_ord, reason = "NaN is far too much, too")]
    if !(elements <= MOST_ELEMENTS as Real) {
        return Err(CoverError::TooFine { spacing, elements, limit: MOST_ELEMENTS });
    }
    let motion = seeded_motion(index, spacing);
    let turn = rotation(&motion);
    let moved: Vec<_> = surface.vertices.iter().map(|v| to_parry(turn * v + motion.position)).collect();
    let lattice = volume_mesh(&moved, &surface.triangles, &VolumeMeshParameters::new(spacing))
        .ok_or(CoverError::Empty { spacing })?;
    let back = turn.transpose();
    let nodes = lattice.vertices.iter().map(|v| back * (from_parry(*v) - motion.position)).collect();
    let mesh = TetMesh { nodes, elements: lattice.cells };

    let mut fraction = fractions_inside(&mesh, &surface.to_trimesh());
    give_on_what_is_dropped(&mesh, &mut fraction);
    fill_up(&mesh, &mut fraction, volume);
    let (mesh, fraction) = keep_largest_piece(&mesh, &fraction);
    if mesh.elements.is_empty() {
        return Err(CoverError::Empty { spacing });
    }
    Ok(Level::new(mesh, fraction, spacing, density))
}

/// A turn and a shift of up to one spacing that only the level's index determines.
fn seeded_motion(index: u32, spacing: Real) -> Pose {
    let mut seed = 0x9E37_79B9_7F4A_7C15u64.wrapping_mul(u64::from(index) + 1);
    let mut uniform = || {
        // splitmix64
        seed = seed.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut z = seed;
        z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        ((z ^ (z >> 31)) >> 11) as Real / (1u64 << 53) as Real
    };
    let position = Vec3::new(uniform(), uniform(), uniform()) * spacing;
    loop {
        let q: [Real; 4] = std::array::from_fn(|_| 2.0 * uniform() - 1.0);
        // Only points of the unit ball give evenly spread orientations.
        if q.iter().map(|c| c * c).sum::<Real>() <= 1.0
            && let Some(orientation) = normalized_quaternion(q)
        {
            return Pose { position, orientation };
        }
    }
}

fn rotation(pose: &Pose) -> Mat3 {
    Mat3::from_columns(&[pose.rotate(Vec3::x()), pose.rotate(Vec3::y()), pose.rotate(Vec3::z())])
}

/// Signed distance of `p` from the surface [m], negative inside.
fn signed_distance(surface: &TriMesh, p: Vec3) -> Real {
    let projection = surface.project_local_point(to_parry(p), false);
    let distance = (from_parry(projection.point) - p).norm();
    if projection.is_inside { -distance } else { distance }
}

/// Part of each element inside the surface, (n_elements).
fn fractions_inside(mesh: &TetMesh, surface: &TriMesh) -> Vec<Real> {
    let at_nodes: Vec<Real> = mesh.nodes.par_iter().map(|u| signed_distance(surface, *u)).collect();
    (0..mesh.elements.len())
        .into_par_iter()
        .map(|e| {
            let u = mesh.corners(e);
            let d = mesh.elements[e].map(|n| at_nodes[n as usize]);
            part_inside(surface, &u, &d, HALVINGS)
        })
        .collect()
}

/// How often a cut element is split into eight before it is cut linearly: twice brings a sphere of 60 elements within
/// 1 % of its volume, where once misses 2 %.
const HALVINGS: u32 = 2;

/// Part of the tetrahedron `u` inside the surface, from the signed distances `d` at its corners.
fn part_inside(surface: &TriMesh, u: &[Vec3; 4], d: &[Real; 4], halvings: u32) -> Real {
    // The distance changes by at most the distance walked: far from the surface there is no cut.
    let reach = u.iter().map(|p| (p - u[0]).norm()).fold(0.0, Real::max);
    if d[0] <= -reach {
        return 1.0;
    } else if d[0] >= reach {
        return 0.0;
    } else if halvings == 0 {
        return linear_cut(*d);
    }
    const EDGES: [(usize, usize); 6] = [(0, 1), (0, 2), (0, 3), (1, 2), (1, 3), (2, 3)];
    // Four corner tetrahedra, then the inner octahedron about the diagonal from middle 01 to middle 23.
    const PARTS: [[usize; 4]; 8] = [
        [0, 4, 5, 6],
        [1, 4, 7, 8],
        [2, 5, 7, 9],
        [3, 6, 8, 9],
        [4, 9, 5, 6],
        [4, 9, 6, 8],
        [4, 9, 8, 7],
        [4, 9, 7, 5],
    ];
    // Points 0–3 are the corners, 4–9 the middles of EDGES.
    let point = |k: usize| if k < 4 { u[k] } else { (u[EDGES[k - 4].0] + u[EDGES[k - 4].1]) * 0.5 };
    let points: [Vec3; 10] = std::array::from_fn(point);
    let values: [Real; 10] = std::array::from_fn(|k| if k < 4 { d[k] } else { signed_distance(surface, points[k]) });
    let part = |p: &[usize; 4]| part_inside(surface, &p.map(|k| points[k]), &p.map(|k| values[k]), halvings - 1);
    PARTS.iter().map(part).sum::<Real>() / 8.0
}

/// Part of a tetrahedron where the linear interpolant of the corner values `d` is negative.
fn linear_cut(mut d: [Real; 4]) -> Real {
    d.sort_unstable_by(Real::total_cmp);
    let [a, b, c, e] = d;
    // How far along the edge from a negative value `n` to a positive one `p` the zero lies.
    let along = |n: Real, p: Real| n / (n - p);
    if a >= 0.0 {
        0.0
    } else if b >= 0.0 {
        along(a, b) * along(a, c) * along(a, e)
    } else if c >= 0.0 {
        let (ac, ae, bc, be) = (along(a, c), along(a, e), along(b, c), along(b, e));
        ac * ae * (1.0 - be) + ac * (1.0 - bc) * be + bc * be
    } else if e >= 0.0 {
        1.0 - (1.0 - along(a, e)) * (1.0 - along(b, e)) * (1.0 - along(c, e))
    } else {
        1.0
    }
}

/// Gives what is inside of the elements that will be dropped to cut elements that share a node with them, in proportion to
/// the room that they have: a coarse level would lose a hundredth of the body.
fn give_on_what_is_dropped(mesh: &TetMesh, fraction: &mut [Real]) {
    let room_of = |e: usize, fraction: &[Real]| (1.0 - fraction[e]) * mesh.volume(e);
    let mut room = vec![0.0; mesh.nodes.len()];
    for e in (0..fraction.len()).filter(|e| fraction[*e] >= LEAST_FRACTION) {
        mesh.elements[e].iter().for_each(|n| room[*n as usize] += room_of(e, fraction));
    }
    let mut given = vec![0.0; mesh.nodes.len()];
    for e in (0..fraction.len()).filter(|e| fraction[*e] > 0.0 && fraction[*e] < LEAST_FRACTION) {
        let takers = || mesh.elements[e].iter().map(|n| *n as usize).filter(|n| room[*n] > 0.0);
        let share = fraction[e] * mesh.volume(e) / takers().count() as Real;
        takers().for_each(|n| given[n] += share);
    }
    for (e, fraction) in fraction.iter_mut().enumerate().filter(|(_, fraction)| **fraction >= LEAST_FRACTION) {
        let of_room = |n: &u32| if given[*n as usize] > 0.0 { given[*n as usize] / room[*n as usize] } else { 0.0 };
        let part: Real = mesh.elements[e].iter().map(of_room).sum();
        *fraction += (1.0 - *fraction) * part.min(1.0);
    }
}

/// Brings the elements that will be kept to `volume` [m³]: cuts are linear within a part of an element, and miss what a
/// round or sharp surface has beyond, most where an element is cut in halves.
fn fill_up(mesh: &TetMesh, fraction: &mut [Real], volume: Real) {
    let kept: Vec<usize> = (0..fraction.len()).filter(|e| fraction[*e] >= LEAST_FRACTION).collect();
    let sum = |of: &dyn Fn(Real) -> Real| kept.iter().map(|e| of(fraction[*e]) * mesh.volume(*e)).sum::<Real>();
    let (filled, cut) = (sum(&|f| f), sum(&|f| f * (1.0 - f)));
    if cut > 0.0 {
        let missed = ((volume - filled) / cut).clamp(-MOST_MISSED, MOST_MISSED);
        let full = |f: Real| (f + missed * f * (1.0 - f)).max(LEAST_FRACTION);
        kept.iter().for_each(|e| fraction[*e] = full(fraction[*e]));
    }
}

/// Most that a cut element is filled up by, as a part of `f(1−f)`: what is missing beyond it is missing elsewhere.
const MOST_MISSED: Real = 0.25;

/// The elements with enough inside, of the largest piece that hangs together by nodes, with unused nodes removed.
fn keep_largest_piece(mesh: &TetMesh, fraction: &[Real]) -> (TetMesh, Vec<Real>) {
    let kept: Vec<usize> = (0..mesh.elements.len()).filter(|&e| fraction[e] >= LEAST_FRACTION).collect();
    let mut root: Vec<u32> = (0..mesh.nodes.len() as u32).collect();
    fn find(root: &mut [u32], mut n: u32) -> u32 {
        while root[n as usize] != n {
            root[n as usize] = root[root[n as usize] as usize];
            n = root[n as usize];
        }
        n
    }
    for &e in &kept {
        let first = find(&mut root, mesh.elements[e][0]);
        for &n in &mesh.elements[e][1..] {
            let other = find(&mut root, n);
            root[other as usize] = first;
        }
    }
    let mut size = vec![0usize; mesh.nodes.len()];
    for &e in &kept {
        size[find(&mut root, mesh.elements[e][0]) as usize] += 1;
    }
    let largest = (0..size.len()).max_by_key(|&n| (size[n], std::cmp::Reverse(n))).unwrap_or(0) as u32;

    let mut number = vec![u32::MAX; mesh.nodes.len()];
    let mut piece = TetMesh::default();
    let mut inside = Vec::with_capacity(kept.len());
    for &e in &kept {
        if find(&mut root, mesh.elements[e][0]) != largest {
            continue;
        }
        let element = mesh.elements[e].map(|n| {
            if number[n as usize] == u32::MAX {
                number[n as usize] = piece.nodes.len() as u32;
                piece.nodes.push(mesh.nodes[n as usize]);
            }
            number[n as usize]
        });
        piece.elements.push(element);
        inside.push(fraction[e]);
    }
    (piece, inside)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::Moments;
    use crate::geometry::primitives::{box_surface, sphere_surface};

    #[test]
    fn a_plane_through_a_tetrahedron_cuts_the_exact_part() {
        // Corner values −1, 1, 1, 1: the cut corner has half the edges, an eighth of the volume.
        assert!((linear_cut([1.0, -1.0, 1.0, 1.0]) - 0.125).abs() < 1e-15);
        assert!((linear_cut([1.0, -1.0, -1.0, -1.0]) - 0.875).abs() < 1e-15);
        // The middle plane between two opposite edges halves it.
        assert!((linear_cut([-1.0, 1.0, -1.0, 1.0]) - 0.5).abs() < 1e-15);
        assert_eq!(linear_cut([-1.0; 4]), 1.0);
    }

    #[test]
    fn covers_have_the_volume_and_the_centre_of_the_surface() {
        let surface = sphere_surface(0.05, 0.004);
        for (index, spacing) in [(0, 0.03), (1, 0.018), (2, 0.011)] {
            let mut level = cover(&surface, spacing, index, 1000.0).unwrap();
            let shape = Moments::of_surface(&surface);
            level.weigh(&vec![1000.0; level.mesh.elements.len()], &Moments::combined(&[(shape, 1000.0)]));
            let error = level.volume() / surface.volume() - 1.0;
            println!("spacing {spacing} m, {} nodes: volume {:+.2} %", level.mesh.nodes.len(), 100.0 * error);
            assert!(error.abs() < 1e-3, "{spacing}: {error}");
            assert!(level.centre_of_mass().norm() < 0.02 * 0.05, "{spacing}: {}", level.centre_of_mass());
            let mass: Real = level.node_mass.iter().sum();
            assert!((mass / (1000.0 * surface.volume()) - 1.0).abs() < 1e-12);
            assert!((level.altitude / (spacing / 2.0f64.sqrt()) - 1.0).abs() < 1e-9);
        }
    }

    #[test]
    fn levels_share_no_node() {
        let surface = box_surface(Vec3::repeat(0.1), [4, 4, 4]);
        let coarse = cover(&surface, 0.04, 0, 1000.0).unwrap();
        let fine = cover(&surface, 0.02, 1, 1000.0).unwrap();
        for u in &coarse.mesh.nodes {
            assert!(fine.mesh.nodes.iter().all(|v| (u - v).norm() > 1e-6));
        }
    }

    #[test]
    fn a_spacing_that_would_fill_the_memory_is_refused() {
        let surface = box_surface(Vec3::repeat(0.1), [2, 2, 2]);
        assert!(matches!(cover(&surface, 1e-5, 0, 1000.0), Err(CoverError::TooFine { .. })));
    }
}
