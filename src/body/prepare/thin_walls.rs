//! Where two sheets of a surface run through one element: walls that are too thin for a level to bend as they do, and
//! gaps that it bridges. And where a wall is thinner than what a touch is spread over.

use palpate_core::geometry::Surface;
use palpate_core::geometry::locate::Locator;
use palpate_core::geometry::tet_mesh::barycentric;
use palpate_core::hierarchy::Level;
use palpate_core::math::{Real, Vec3, from_parry, to_parry};
use parry3d_f64::query::{Ray, RayCast};
use parry3d_f64::shape::TriMesh;
use rayon::prelude::*;

/// Cosine of the angle between two sheets up to which they run side by side.
const FACING: Real = 0.7;

/// Support of a touch over the thickness of a wall, up to which what is felt is within 2 % on a slab that is bonded below (against the layer's
/// Green function, Poisson's ratio 0.3). With less, walls are reported that feel right; with more, some that feel too soft are not: 7 % at
/// 1.75, 14 at 2.2.
const WIDER_THAN_WALL: Real = 1.5;

/// Most points looked from along an edge of a triangle.
const MOST_POINTS: usize = 32;

/// Two sheets in one element, or, where they are close to each other, in none.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Thin {
    /// Part of the surface from which another sheet lies in the same element.
    pub part: Real,
    /// Distance of the nearest two such sheets [m].
    pub thickness: Real,
    /// Where they are [m].
    pub at: Vec3,
}

/// What of a surface is thin for a level.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ThinPlaces {
    /// Body between two sheets in one element.
    pub walls: Option<Thin>,
    /// Nothing between two sheets in one element, which ties them together.
    pub gaps: Option<Thin>,
    /// Body between two sheets so near each other that a touch of the one is spread over both.
    pub spread: Option<Thin>,
}

/// What of `surface` (closed, outward; `around` is parry's mesh of it) is thin for `level`, a cover of it: looked for along
/// the normals, from points half a spacing apart. A touch is spread over nodes up to `support` spacings away.
pub fn thin_places(surface: &Surface, around: &TriMesh, level: &Level, support: Real) -> ThinPlaces {
    let locator = Locator::new(&level.mesh, level.spacing);
    let spread = support * level.spacing / WIDER_THAN_WALL;
    let farthest = level.spacing.max(spread);
    // How far it is from `p` along `direction` to the next sheet, and whether that runs through the same element.
    let next_sheet = |p: Vec3, direction: Vec3, leaves: bool| {
        let start = 1e-6 * level.spacing;
        let ray = Ray::new(to_parry(p + direction * start), to_parry(direction));
        let hit = around.cast_local_ray_and_get_normal(&ray, farthest, false)?;
        let outward = surface_normal(surface, hit.subshape as usize);
        let distance = hit.time_of_impact + start;
        // Going in, one leaves through the next sheet; going out, one enters. A rim's two sides are sheets of their own only
        // where they run side by side: elsewhere any rim would be thin for any element.
        let along = outward.dot(&direction);
        if (along > 0.0) != leaves || along.abs() < FACING {
            return None;
        }
        let corners = level.mesh.corners(locator.host(p).element as usize);
        let within = |x: Vec3| barycentric(&corners, x).iter().all(|w| *w >= -1e-9);
        // So little of a very thin wall lies in an element that the level has none there.
        let lost = leaves && !within(p);
        let shared = distance <= level.spacing && within(p) && within(from_parry(ray.point_at(hit.time_of_impact)));
        Some((distance, shared || lost && distance <= level.spacing))
    };
    // Area looked from, and of it with another sheet in the element; the nearest two sheets.
    let of_triangle = |t: usize| {
        let [a, b, c] = surface.corners(t);
        let normal = (b - a).cross(&(c - a));
        let area = 0.5 * normal.norm();
        let mut found = [area, 0.0, 0.0, 0.0];
        let mut nearest = [(Real::INFINITY, a); 3];
        if area == 0.0 {
            return (found, nearest);
        }
        let longest = (b - a).norm().max((c - b).norm()).max((a - c).norm());
        let parts = ((2.0 * longest / level.spacing).ceil() as usize).clamp(1, MOST_POINTS);
        let share = area / (parts * parts) as Real;
        for i in 0..parts {
            for j in 0..2 * (parts - i) - 1 {
                // Middles of the small triangles, those that point up and down in turn.
                let (u, v) = (i as Real + (1 + j % 2) as Real / 3.0, (j / 2) as Real + (1 + j % 2) as Real / 3.0);
                let p = a + ((b - a) * u + (c - a) * v) / parts as Real;
                let inward = -normal / (2.0 * area);
                for (kind, (direction, leaves)) in [(inward, true), (-inward, false)].into_iter().enumerate() {
                    let Some((distance, shared)) = next_sheet(p, direction, leaves) else { continue };
                    for (kind, is) in [(kind, shared), (2, leaves && distance < spread)] {
                        if is {
                            found[1 + kind] += share;
                        }
                        if is && distance < nearest[kind].0 {
                            nearest[kind] = (distance, p + direction * (0.5 * distance));
                        }
                    }
                }
            }
        }
        (found, nearest)
    };
    let all: Vec<_> = (0..surface.triangles.len()).into_par_iter().map(of_triangle).collect();
    let area: Real = all.iter().map(|(found, _)| found[0]).sum();
    let thin = |kind: usize| {
        let part = all.iter().map(|(found, _)| found[1 + kind]).sum::<Real>() / area;
        let nearest = all.iter().map(|(_, nearest)| nearest[kind]);
        let (thickness, at) = nearest.min_by(|a, b| a.0.total_cmp(&b.0))?;
        thickness.is_finite().then_some(Thin { part, thickness, at })
    };
    ThinPlaces { walls: thin(0), gaps: thin(1), spread: thin(2) }
}

/// Outward unit normal of triangle `t`.
fn surface_normal(surface: &Surface, t: usize) -> Vec3 {
    let [a, b, c] = surface.corners(t);
    (b - a).cross(&(c - a)).normalize()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cover::cover;
    use palpate_core::geometry::primitives::box_surface;

    fn looked(surface: &Surface, spacing: Real) -> ThinPlaces {
        thin_places(surface, &surface.to_trimesh(), &cover(surface, spacing, 0, 1000.0).unwrap(), 1.75)
    }

    #[test]
    fn a_plate_is_thin_for_large_elements_and_not_for_small_ones() {
        let plate = box_surface(Vec3::new(0.1, 0.1, 0.005), [10, 10, 1]);
        let walls = looked(&plate, 0.02).walls.unwrap();
        assert!(walls.part > 0.1 && (walls.thickness - 0.005).abs() < 1e-9, "{walls:?}");
        assert!((walls.at.z - 0.0025).abs() < 1e-9, "{walls:?}");
        assert_eq!(looked(&plate, 0.004), ThinPlaces::default());
    }

    #[test]
    fn a_plate_that_is_thick_enough_to_bend_may_be_thin_for_what_touches_it() {
        let plate = box_surface(Vec3::new(0.1, 0.1, 0.01), [10, 10, 1]);
        let places = looked(&plate, 0.009);
        let spread = places.spread.unwrap();
        assert!(spread.part > 0.6 && (spread.thickness - 0.01).abs() < 1e-9, "{spread:?}");
        assert_eq!(looked(&plate, 0.0085).spread, None);
    }

    #[test]
    fn a_slot_that_a_level_bridges_is_found_with_its_width_and_place() {
        // A block with a slot of 3 mm from above, at x = 48.5 to 51.5 mm.
        let mut block = box_surface(Vec3::new(0.1, 0.04, 0.1), [4, 1, 1]);
        let columns = [0.0, 0.0485, 0.05, 0.0515, 0.1];
        for v in &mut block.vertices {
            let column = (v.x / 0.025).round() as usize;
            v.x = columns[column];
            if column == 2 && v.z > 0.05 {
                v.z = 0.03;
            }
        }
        let gaps = looked(&block, 0.02).gaps.unwrap();
        assert!(gaps.thickness < 0.003 && (gaps.at.x - 0.05).abs() < 0.002 && gaps.at.z > 0.03, "{gaps:?}");
        assert_eq!(looked(&box_surface(Vec3::repeat(0.1), [4; 3]), 0.02).gaps, None);
    }

    #[test]
    fn a_fin_is_found_however_small_and_a_rim_is_none() {
        // A block with a fin beside it that makes up less than a thousandth of the surface.
        let mut finned = box_surface(Vec3::repeat(0.1), [4; 3]);
        let fin = box_surface(Vec3::new(0.004, 0.004, 0.0005), [2, 2, 1]);
        let first = finned.vertices.len() as u32;
        finned.vertices.extend(fin.vertices.iter().map(|v| v + Vec3::new(0.12, 0.05, 0.05)));
        finned.triangles.extend(fin.triangles.iter().map(|t| t.map(|v| v + first)));
        let walls = looked(&finned, 0.02).walls.unwrap();
        assert!(walls.part < 1e-3 && (walls.thickness - 0.0005).abs() < 1e-9 && walls.at.x > 0.12, "{walls:?}");
        // A prism of 60 degrees.
        let mut prism = box_surface(Vec3::repeat(0.1), [8; 3]);
        for v in &mut prism.vertices {
            (v.x, v.z) = (0.05 + (v.x - 0.05) * (1.0 - 9.9 * v.z), v.z * 0.866);
        }
        let near_the_ridge = |thin: &Thin| thin.at.z > 0.07;
        assert!(!looked(&prism, 0.02).walls.is_some_and(|walls| near_the_ridge(&walls)));
    }
}
