//! Levels from a closed surface: a lattice cover whose elements are weighted by the part of them inside.
//!
//! A body-centred cubic lattice takes any closed surface, and all its elements are alike. Each level turns and shifts
//! the lattice by its own seeded motion, which makes the levels independent: lattices of ratio two would otherwise share
//! vertices.

mod lattice;

use crate::geometry::pieces::{Groups, neighbours};
use lattice::{Lattice, signed_distance};
use palpate_core::geometry::Surface;
use palpate_core::geometry::tet_mesh::TetMesh;
use palpate_core::hierarchy::Level;
use palpate_core::ids::NONE;
use palpate_core::math::{Pose, Real, Vec3, normalized_quaternion};
use parry3d_f64::shape::TriMesh;
use rayon::prelude::*;
use std::cmp::Reverse;
use std::collections::BinaryHeap;

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
    cover_within(surface, &surface.to_trimesh(), spacing, index, density)
}

/// [`cover`] of a surface of which `around` is parry's mesh: for one of a million triangles that takes seconds to make.
///
/// # Errors
/// As [`cover`].
pub fn cover_within(
    surface: &Surface,
    around: &TriMesh,
    spacing: Real,
    index: u32,
    density: Real,
) -> Result<Level, CoverError> {
    let volume = surface.volume();
    let elements = 12.0 * volume / (spacing * spacing * spacing);
    #[expect(clippy::neg_cmp_op_on_partial_ord, reason = "NaN is far too much, too")]
    if !(elements <= MOST_ELEMENTS as Real) {
        return Err(CoverError::TooFine { spacing, elements, limit: MOST_ELEMENTS });
    }
    let lattice = Lattice::around(surface, around, spacing, &seeded_motion(index, spacing));
    let mut fraction = fractions_inside(&lattice, around, halvings(surface, spacing));
    let mesh = lattice.mesh;
    let kept = keep_one_piece(&mesh, &mut fraction);
    give_on_what_is_dropped(&mesh, &kept, &mut fraction);
    fill_up(&mesh, &kept, &mut fraction, volume);
    let (mesh, fraction) = only(&mesh, &kept, &fraction);
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

/// Part of each element inside the surface, (n_elements).
fn fractions_inside(lattice: &Lattice, surface: &TriMesh, halvings: u32) -> Vec<Real> {
    let Lattice { mesh, inside } = lattice;
    let mut is_cut = vec![false; mesh.nodes.len()];
    let cut = mesh.elements.iter().zip(inside).filter(|(_, inside)| !**inside);
    cut.for_each(|(element, _)| element.iter().for_each(|n| is_cut[*n as usize] = true));
    let at_node = |(u, is_cut): (&Vec3, &bool)| if *is_cut { signed_distance(surface, *u) } else { 0.0 };
    let at_nodes: Vec<Real> = mesh.nodes.par_iter().zip(&is_cut).map(at_node).collect();
    (0..mesh.elements.len())
        .into_par_iter()
        .map(|e| {
            if inside[e] {
                return 1.0;
            }
            let u = mesh.corners(e);
            let d = mesh.elements[e].map(|n| at_nodes[n as usize]);
            part_inside(surface, &u, &d, halvings)
        })
        .collect()
}

/// How often a cut element is split into eight before it is cut linearly: twice brings a sphere of 60 elements within
/// 1 % of its volume, where once misses 2 %.
const HALVINGS: u32 = 2;
/// The same for sheets that would slip between the places looked at: 4,096 parts for an element.
const MOST_HALVINGS: u32 = 4;

/// How often elements are split where the body of `surface` is on the average so thin: parts are to be no wider than that.
fn halvings(surface: &Surface, spacing: Real) -> u32 {
    // Of a sheet of thickness t, twice the volume over the area is t.
    let thickness = 2.0 * surface.volume() / surface.vertex_areas().iter().sum::<Real>();
    (HALVINGS..MOST_HALVINGS).find(|n| Real::from(1 << n) * thickness >= spacing).unwrap_or(MOST_HALVINGS)
}

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

/// Which elements are kept: those with enough inside, and few more that join pieces of them across faces (of which
/// `fraction` is made what elements have at least). A piece that hung on a corner or an edge would turn freely there; pieces
/// too small to be worth it are dropped.
fn keep_one_piece(mesh: &TetMesh, fraction: &mut [Real]) -> Vec<bool> {
    let mut kept: Vec<bool> = fraction.iter().map(|f| *f >= LEAST_FRACTION).collect();
    let across = neighbours(&mesh.elements);
    let next = |e: usize| across[e].iter().filter(|other| **other != NONE).map(|other| *other as usize);
    let mut pieces = Groups::new(kept.len());
    for e in (0..kept.len()).filter(|e| kept[*e]) {
        next(e).filter(|other| kept[*other]).for_each(|other| {
            pieces.join(e as u32, other as u32);
        });
    }
    let piece_of: Vec<u32> = (0..kept.len() as u32).map(|e| pieces.of(e)).collect();
    let mut size = vec![0; kept.len()];
    (0..kept.len()).filter(|e| kept[*e]).for_each(|e| size[piece_of[e] as usize] += 1);
    let largest = (0..size.len()).max_by_key(|n| (size[*n], Reverse(*n))).unwrap_or(0) as u32;
    if size.iter().filter(|size| **size > 0).count() <= 1 {
        return kept;
    }

    // The way from the largest piece to each element that takes least: nothing through what is kept, one through an
    // element with something inside, more through one with nothing.
    let cost_of = |e: usize| match fraction[e] {
        f if f >= LEAST_FRACTION => 0,
        f if f > 0.0 => 1,
        _ => OUTSIDE,
    };
    let mut cost = vec![u32::MAX; kept.len()];
    let mut from = vec![NONE; kept.len()];
    let mut open = BinaryHeap::new();
    for e in (0..kept.len()).filter(|e| kept[*e] && piece_of[*e] == largest) {
        cost[e] = 0;
        open.push((Reverse(0), e));
    }
    while let Some((Reverse(so_far), e)) = open.pop() {
        if so_far > cost[e] {
            continue;
        }
        for other in next(e) {
            let through = so_far + cost_of(other);
            if through < cost[other] {
                (cost[other], from[other]) = (through, e as u32);
                open.push((Reverse(through), other));
            }
        }
    }

    // The element of each piece that is nearest, the smallest piece last: its way may lead through others.
    let mut nearest: Vec<u32> = vec![NONE; kept.len()];
    for e in (0..kept.len()).filter(|e| kept[*e]) {
        let best = &mut nearest[piece_of[e] as usize];
        if *best == NONE || cost[e] < cost[*best as usize] {
            *best = e as u32;
        }
    }
    let mut others: Vec<u32> = (0..kept.len() as u32).filter(|p| size[*p as usize] > 0 && *p != largest).collect();
    others.sort_by_key(|p| (Reverse(size[*p as usize]), *p));
    let mut is_joined = vec![false; kept.len()];
    is_joined[largest as usize] = true;
    for piece in others {
        let mut e = nearest[piece as usize];
        if is_joined[piece as usize] || cost[e as usize] > size[piece as usize] {
            continue;
        }
        while e != NONE {
            if fraction[e as usize] >= LEAST_FRACTION {
                is_joined[piece_of[e as usize] as usize] |= kept[e as usize];
            } else {
                fraction[e as usize] = LEAST_FRACTION;
                kept[e as usize] = true;
            }
            e = from[e as usize];
        }
    }
    (0..kept.len()).for_each(|e| kept[e] &= size[piece_of[e] as usize] == 0 || is_joined[piece_of[e] as usize]);
    kept
}

/// What it costs to join pieces by an element with nothing of the body inside, over one with something.
const OUTSIDE: u32 = 4;

/// Gives what is inside of the elements that are dropped to cut elements that share a node with them, in proportion to
/// the room that they have: a coarse level would lose a hundredth of the body.
fn give_on_what_is_dropped(mesh: &TetMesh, kept: &[bool], fraction: &mut [Real]) {
    let room_of = |e: usize, fraction: &[Real]| (1.0 - fraction[e]) * mesh.volume(e);
    let mut room = vec![0.0; mesh.nodes.len()];
    for e in (0..fraction.len()).filter(|e| kept[*e]) {
        mesh.elements[e].iter().for_each(|n| room[*n as usize] += room_of(e, fraction));
    }
    let mut given = vec![0.0; mesh.nodes.len()];
    for e in (0..fraction.len()).filter(|e| fraction[*e] > 0.0 && !kept[*e]) {
        let takers = || mesh.elements[e].iter().map(|n| *n as usize).filter(|n| room[*n] > 0.0);
        let share = fraction[e] * mesh.volume(e) / takers().count() as Real;
        takers().for_each(|n| given[n] += share);
    }
    for (e, fraction) in fraction.iter_mut().enumerate().filter(|(e, _)| kept[*e]) {
        let of_room = |n: &u32| if given[*n as usize] > 0.0 { given[*n as usize] / room[*n as usize] } else { 0.0 };
        let part: Real = mesh.elements[e].iter().map(of_room).sum();
        *fraction += (1.0 - *fraction) * part.min(1.0);
    }
}

/// Brings the elements that are kept to `volume` [m³]: cuts are linear within a part of an element, and miss what a
/// round or sharp surface has beyond, most where an element is cut in halves.
fn fill_up(mesh: &TetMesh, kept: &[bool], fraction: &mut [Real], volume: Real) {
    let kept: Vec<usize> = (0..fraction.len()).filter(|e| kept[*e]).collect();
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

/// The elements that are kept, with unused nodes removed.
fn only(mesh: &TetMesh, kept: &[bool], fraction: &[Real]) -> (TetMesh, Vec<Real>) {
    let mut number = vec![NONE; mesh.nodes.len()];
    let mut piece = TetMesh::default();
    let mut inside = Vec::new();
    for e in (0..kept.len()).filter(|e| kept[*e]) {
        let element = mesh.elements[e].map(|n| {
            if number[n as usize] == NONE {
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
    use crate::geometry::primitives::sphere_surface;
    use palpate_core::geometry::Moments;
    use palpate_core::geometry::primitives::box_surface;

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

    /// Two cubes of 40 mm and between them a square bar of `width` [m], 40 mm long, all along x.
    fn dumbbell(width: Real) -> Surface {
        let mut surface = box_surface(Vec3::new(0.12, 0.04, 0.04), [3, 3, 3]);
        for v in &mut surface.vertices {
            // Sections at 0, 40, 80 and 120 mm, with lines at thirds: the middle two are drawn in to the bar.
            let is_bar = (0.03..0.09).contains(&v.x);
            let drawn = |y: Real| 0.02 + (y - 0.02) * if is_bar { width / 0.04 } else { 1.0 };
            (v.y, v.z) = (drawn(v.y), drawn(v.z));
        }
        surface
    }

    #[test]
    fn a_level_hangs_together_by_faces_also_where_the_body_is_thinner_than_its_elements() {
        let mut pieces_before = 0;
        for width in [0.001, 0.002, 0.004, 0.006] {
            let surface = dumbbell(width);
            for (index, spacing) in [(0, 0.015), (1, 0.011), (2, 0.008)] {
                let lattice = Lattice::around(&surface, &surface.to_trimesh(), spacing, &seeded_motion(index, spacing));
                let fraction = fractions_inside(&lattice, &surface.to_trimesh(), halvings(&surface, spacing));
                let kept: Vec<bool> = fraction.iter().map(|f| *f >= LEAST_FRACTION).collect();
                pieces_before += pieces(&only(&lattice.mesh, &kept, &fraction).0) - 1;
                let level = cover(&surface, spacing, index, 1000.0).unwrap();
                assert_eq!(pieces(&level.mesh), 1, "{width} at {spacing}");
                assert!((level.volume() / surface.volume() - 1.0).abs() < 0.01, "{width} at {spacing}");
                // Both cubes are there.
                let ends =
                    level.mesh.nodes.iter().fold((1.0 as Real, 0.0 as Real), |(a, b), u| (a.min(u.x), b.max(u.x)));
                assert!(ends.0 < 0.005 && ends.1 > 0.115, "{width} at {spacing}: {ends:?}");
            }
        }
        assert!(pieces_before > 5, "{pieces_before}");
    }

    /// How many pieces hang together by faces.
    fn pieces(mesh: &TetMesh) -> usize {
        let mut groups = Groups::new(mesh.elements.len());
        let mut count = mesh.elements.len();
        for (e, across) in (0..).zip(neighbours(&mesh.elements)) {
            count -= across.iter().filter(|other| **other != NONE && groups.join(e, **other)).count();
        }
        count
    }

    #[test]
    fn a_sheet_a_tenth_of_an_element_thick_has_its_volume() {
        let sheet = box_surface(Vec3::new(0.05, 0.05, 0.0005), [1; 3]);
        let level = cover(&sheet, 0.005, 0, 1000.0).unwrap();
        assert!((level.volume() / sheet.volume() - 1.0).abs() < 0.01, "{}", level.volume() / sheet.volume());
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
