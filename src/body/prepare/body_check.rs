//! What makes shapes unfit to be a body, beside what readers find: several bodies, crossings, odd sizes, odd levels.

use super::bodies::check_one_body;
use super::shape_fault::{ShapeFault, across};
use crate::geometry::LabelledMesh;
use crate::geometry::crossings::crossings;
use crate::geometry::mesh_io::{LengthUnit, Solid};
use crate::geometry::pieces::firm_pieces;
use palpate_core::geometry::{Moments, Surface, TetMesh};
use palpate_core::math::{Bounds, Real, Vec3};

/// Extents that bodies to be touched have [m]; others are asked about.
const EXTENTS: std::ops::RangeInclusive<Real> = 0.005..=3.0;
/// The extent that is taken for the likeliest [m]: an organ's.
const LIKELY: Real = 0.2;
/// How far volumes of levels may differ, and their centres over the radius of gyration.
const LEVELS: Real = 0.1;

/// Refuses solids, read in `unit` and scaled by `scale`, that are no levels of one body of a likely size.
/// `any_size` and `allow_crossings` leave out those checks.
///
/// # Errors
/// The first fault found.
pub fn check(
    solids: &[Solid],
    unit: LengthUnit,
    scale: Real,
    any_size: bool,
    allow_crossings: bool,
) -> Result<(), ShapeFault> {
    for solid in solids {
        let bounds = match solid {
            Solid::Surface(surface) => surface.bounds(),
            Solid::Volume(mesh) => Bounds::of(mesh.mesh.nodes.iter().copied()),
        };
        let extent = bounds.size().max();
        if !any_size && !EXTENTS.contains(&extent) {
            return Err(ShapeFault::Size(doubt(extent, unit, scale)));
        }
        check_one_body(solid)?;
        match solid {
            Solid::Surface(surface) if !allow_crossings => check_crossings(surface)?,
            Solid::Surface(_) => {}
            Solid::Volume(mesh) => check_one_piece(&mesh.mesh)?,
        }
    }
    check_levels(solids)
}

/// Words about a body of an unlikely `extent` [m], whose coordinates were taken to be in `unit` times `scale`.
fn doubt(extent: Real, unit: LengthUnit, scale: Real) -> String {
    let units = [LengthUnit::Millimetre, LengthUnit::Centimetre, LengthUnit::Metre, LengthUnit::Inch];
    let as_in = |other: LengthUnit| extent / unit.metres() * other.metres();
    let unlikely = |other: &LengthUnit| {
        let ratio = as_in(*other) / LIKELY;
        // Few scan in inches.
        let rare = if *other == LengthUnit::Inch { 10.0 } else { 1.0 };
        rare * if ratio < 1.0 { 1.0 / ratio } else { ratio }
    };
    let other = units.into_iter().min_by(|a, b| unlikely(a).total_cmp(&unlikely(b))).unwrap_or(unit);
    let asked = if EXTENTS.contains(&as_in(other)) {
        format!("is it in {other}? Then it is {} across: give --unit {other}", across(as_in(other)))
    } else {
        format!("in no unit is it of a likely size: give --scale, a factor on its coordinates (now {scale})")
    };
    format!("the body would be {} across, as --unit {unit} says; {asked}, or --any-size if that is so", across(extent))
}

/// Refuses meshes of pieces that hang together by a hinge.
fn check_one_piece(mesh: &TetMesh) -> Result<(), ShapeFault> {
    // How many pieces, and the middles of two.
    let several = |piece_of: &[u32]| {
        let mut numbers = piece_of.to_vec();
        numbers.sort_unstable();
        numbers.dedup();
        let centre = |number: u32| {
            let own = (0..mesh.elements.len()).filter(|e| piece_of[*e] == number);
            let (sum, count) = own.fold((Vec3::zeros(), 0.0), |(sum, count), e| {
                (sum + mesh.corners(e).iter().sum::<Vec3>() / 4.0, count + 1.0)
            });
            sum / count
        };
        match numbers[..] {
            [first, second, ..] => Some((numbers.len(), centre(first), centre(second))),
            _ => None,
        }
    };
    several(&firm_pieces(mesh))
        .map_or(Ok(()), |(count, first, second)| Err(ShapeFault::Hinged { count, first, second }))
}

fn check_crossings(surface: &Surface) -> Result<(), ShapeFault> {
    let met = crossings(surface);
    met.first().map_or(Ok(()), |(t, _)| {
        let at = surface.corners(*t as usize).iter().sum::<Vec3>() / 3.0;
        Err(ShapeFault::Crosses { count: met.len(), at })
    })
}

/// Refuses meshes of which one is not of the body that the finest is of.
fn check_levels(solids: &[Solid]) -> Result<(), ShapeFault> {
    let of = |solid: &Solid| match solid {
        Solid::Surface(_) => None,
        Solid::Volume(LabelledMesh { mesh, .. }) => {
            Some((mesh.nodes.len(), Moments::of_mesh(mesh, &vec![1.0; mesh.elements.len()])))
        }
    };
    let all: Vec<_> = solids.iter().map(of).collect();
    let finest = all.iter().enumerate().filter_map(|(i, m)| Some((i, (*m)?))).max_by_key(|(_, m)| m.0);
    let Some((finest, (_, whole))) = finest else { return Ok(()) };
    for (i, (_, moments)) in all.iter().enumerate().filter_map(|(i, m)| Some((i, (*m)?))) {
        let volume = moments.volume / whole.volume - 1.0;
        let centre = (moments.centre - whole.centre).norm() / whole.radius();
        if volume.abs() > LEVELS || centre > LEVELS {
            return Err(ShapeFault::OtherBody { mesh: i + 1, of: finest + 1, volume, centre });
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::primitives::sphere_surface;
    use palpate_core::geometry::primitives::{box_mesh, box_surface};

    fn checked(solid: Solid, unit: LengthUnit) -> Result<(), String> {
        check(&[solid], unit, 1.0, false, false).map_err(|e| e.to_string())
    }

    fn joined(mut a: Surface, b: Surface) -> Surface {
        let first = a.vertices.len() as u32;
        a.vertices.extend(b.vertices);
        a.triangles.extend(b.triangles.iter().map(|t| t.map(|v| v + first)));
        a
    }

    #[test]
    fn two_bodies_in_one_file_are_refused_with_their_places_and_a_cavity_is_none() {
        let cube = box_surface(Vec3::repeat(0.1), [2; 3]);
        let mut away = cube.clone();
        away.vertices.iter_mut().for_each(|v| v.x += 0.3);
        let e = checked(Solid::Surface(joined(cube.clone(), away)), LengthUnit::Metre).unwrap_err();
        assert!(e.contains("2 bodies") && e.contains("(0.0500, 0.0500, 0.0500)") && e.contains("(0.3500,"), "{e}");
        let mut cavity = sphere_surface(0.02, 0.006);
        cavity.vertices.iter_mut().for_each(|v| *v += Vec3::repeat(0.05));
        let island = Solid::Surface(joined(cube.clone(), cavity.clone()));
        assert!(checked(island, LengthUnit::Metre).unwrap_err().contains("2 bodies"));
        cavity.triangles.iter_mut().for_each(|t| t.swap(1, 2));
        checked(Solid::Surface(joined(cube, cavity)), LengthUnit::Metre).unwrap();

        // At a corner, where they share a vertex.
        let mut touching = box_surface(Vec3::repeat(0.1), [2; 3]);
        touching.vertices.iter_mut().for_each(|v| *v += Vec3::repeat(0.1));
        let mut touching = joined(box_surface(Vec3::repeat(0.1), [2; 3]), touching);
        let at = |v: &Vec3| (v - Vec3::repeat(0.1)).norm() < 1e-9;
        let shared: Vec<u32> = (0..).zip(&touching.vertices).filter(|(_, v)| at(v)).map(|(n, _)| n).collect();
        assert_eq!(shared.len(), 2);
        touching.triangles.iter_mut().flatten().filter(|v| **v == shared[1]).for_each(|v| *v = shared[0]);
        assert!(checked(Solid::Surface(touching), LengthUnit::Metre).unwrap_err().contains("2 bodies"));

        let mut mesh = box_mesh(Vec3::repeat(0.1), [1; 3]);
        let nodes = mesh.nodes.len() as u32;
        mesh.nodes.extend(mesh.nodes.clone().iter().map(|u| u + Vec3::x()));
        mesh.elements.extend(mesh.elements.clone().iter().map(|e| e.map(|n| n + nodes)));
        assert!(checked(Solid::Volume(mesh.into()), LengthUnit::Metre).unwrap_err().contains("2 bodies"));
    }

    #[test]
    fn pieces_of_a_mesh_that_hang_on_a_corner_or_an_edge_are_refused_with_their_places() {
        for (at, refused) in
            [(Vec3::new(0.1, 0.1, 0.1), true), (Vec3::new(0.1, 0.1, 0.0), true), (Vec3::x() * 0.1, false)]
        {
            let cube = box_mesh(Vec3::repeat(0.1), [2; 3]);
            let mut both = cube.clone();
            let number: Vec<u32> = (cube.nodes.iter().map(|u| u + at))
                .map(|u| {
                    let known = cube.nodes.iter().position(|v| (u - v).norm() < 1e-9);
                    known.unwrap_or_else(|| {
                        both.nodes.push(u);
                        both.nodes.len() - 1
                    }) as u32
                })
                .collect();
            both.elements.extend(cube.elements.iter().map(|e| e.map(|n| number[n as usize])));
            let checked = checked(Solid::Volume(both.into()), LengthUnit::Metre);
            assert_eq!(checked.is_err(), refused, "{checked:?}");
            if let Err(e) = checked {
                assert!(e.contains("2 pieces") && e.contains("(0.0500, 0.0500, 0.0500)"), "{e}");
            }
        }
    }

    #[test]
    fn a_body_of_an_unlikely_size_is_asked_about_with_the_likely_unit() {
        let cube = |size: Real| Solid::Surface(box_surface(Vec3::repeat(size), [1; 3]));
        let e = checked(cube(212.0), LengthUnit::Metre).unwrap_err();
        assert!(e.contains("212.000 m across") && e.contains("--unit mm") && e.contains("--any-size"), "{e}");
        let e = checked(cube(0.000_2), LengthUnit::Millimetre).unwrap_err();
        assert!(e.contains("0.200 mm across") && e.contains("give --unit m,"), "{e}");
        let e = checked(cube(1e-9), LengthUnit::Metre).unwrap_err();
        assert!(e.contains("--scale"), "{e}");
        check(&[cube(212.0)], LengthUnit::Metre, 1.0, true, false).unwrap();
    }

    #[test]
    fn meshes_of_another_body_are_no_levels_of_this_one() {
        let mesh = |size: Real, cells: u32| Solid::Volume(box_mesh(Vec3::repeat(size), [cells; 3]).into());
        let check = |solids: &[Solid]| check(solids, LengthUnit::Metre, 1.0, false, false);
        check(&[mesh(0.1, 2), mesh(0.1, 4)]).unwrap();
        let e = check(&[mesh(0.1, 4), mesh(0.12, 2)]).unwrap_err();
        assert!(matches!(e, ShapeFault::OtherBody { mesh: 2, of: 1, .. }), "{e}");
    }

    #[test]
    fn a_surface_that_crosses_itself_is_refused_unless_that_is_allowed() {
        let cube = box_surface(Vec3::repeat(0.1), [2; 3]);
        let mut through = cube.clone();
        // One corner pulled through the opposite faces.
        through.vertices[0] = Vec3::new(0.13, 0.12, 0.11);
        let e = check(&[Solid::Surface(through.clone())], LengthUnit::Metre, 1.0, false, false).unwrap_err();
        assert!(matches!(e, ShapeFault::Crosses { .. }), "{e}");
        check(&[Solid::Surface(through)], LengthUnit::Metre, 1.0, false, true).unwrap();
    }
}
