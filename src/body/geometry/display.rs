//! The surface that is shown and touched: triangles of even size, as many as asked for.

use super::decimate::decimate;
use palpate_core::geometry::Surface;
use palpate_core::math::{Real, Vec3, from_parry, to_parry};
use parry3d_f64::query::PointQuery;
use parry3d_f64::shape::TriMesh;

/// `surface`, which is closed, in about `vertices` vertices, or fewer where no edge is longer than `longest` [m]: its own
/// triangles where they are as many, others of the same shape where not.
pub fn displayed(surface: &Surface, vertices: usize, longest: Real) -> Surface {
    let other = decimate(surface, vertices).refined(vertices, longest);
    if other == *surface { other } else { evened(other, &surface.to_trimesh()) }
}

/// `surface` with its vertices moved along the shape `onto`, each to the middle of the triangles around it, but for vertices on
/// edges of the shape: a tool that slides feels triangles of uneven size.
fn evened(mut surface: Surface, onto: &TriMesh) -> Surface {
    let mut around = vec![Vec::new(); surface.vertices.len()];
    for (t, triangle) in surface.triangles.iter().enumerate() {
        triangle.iter().for_each(|v| around[*v as usize].push(t));
    }
    let normal = |surface: &Surface, t: usize| {
        let [a, b, c] = surface.corners(t);
        (b - a).cross(&(c - a))
    };
    for _ in 0..ROUNDS {
        for (v, around) in around.iter().enumerate() {
            let before: Vec<Vec3> = around.iter().map(|t| normal(&surface, *t)).collect();
            let total: Vec3 = before.iter().sum();
            let smooth = |n: &Vec3| n.dot(&total) > SMOOTH * n.norm() * total.norm();
            if !before.iter().all(smooth) {
                continue;
            }
            let (mut area, mut sum) = (0.0, Vec3::zeros());
            for (t, normal) in around.iter().zip(&before) {
                let [a, b, c] = surface.corners(*t);
                area += normal.norm();
                sum += (a + b + c) * (normal.norm() / 3.0);
            }
            let middle = sum / area;
            let place = from_parry(onto.project_local_point(to_parry(middle), false).point);
            let old = std::mem::replace(&mut surface.vertices[v], place);
            let kept = around.iter().zip(&before).all(|(t, before)| {
                let now = normal(&surface, *t);
                now.dot(before) > SMOOTH * now.norm() * before.norm()
            });
            if !kept {
                surface.vertices[v] = old;
            }
        }
    }
    surface
}

/// Times that every vertex is moved.
const ROUNDS: usize = 5;
/// Cosine of the angle between normals from which on they are those of a smooth place.
const SMOOTH: Real = 0.8;

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::primitives::liver_surface;
    use crate::geometry::soundness::check_closed;
    use palpate_core::geometry::primitives::box_surface;

    /// Largest over smallest area of a vertex, but for the tenth at either end, and the areas' sum [m²].
    fn unevenness(surface: &Surface) -> (Real, Real) {
        let mut areas = surface.vertex_areas();
        areas.sort_by(Real::total_cmp);
        let tenth = areas.len() / 10;
        (areas[areas.len() - 1 - tenth] / areas[tenth], areas.iter().sum())
    }

    #[test]
    fn what_is_shown_of_a_shape_has_even_triangles_its_edges_and_its_volume() {
        let edge = Vec3::repeat(0.1);
        for (name, shape, most) in [
            ("a box in two triangles a side", box_surface(edge, [1; 3]), 3.2),
            ("a box in many", box_surface(edge, [56; 3]), 2.1),
            ("liver in many", liver_surface(0.002), 3.2),
            ("liver in few", liver_surface(0.012), 3.2),
        ] {
            let shown = displayed(&shape, 5_000, 0.0);
            let (uneven, area) = unevenness(&shown);
            let raw = unevenness(&decimate(&shape, 5_000).refined(5_000, 0.0)).0;
            println!("{name}: {} vertices, areas within {uneven:.2} (before {raw:.2})", shown.vertices.len());
            assert!(check_closed(&mut shown.clone()).is_ok(), "{name}");
            assert!((4_900..=5_100).contains(&shown.vertices.len()), "{name}: {}", shown.vertices.len());
            // Edges cut in halves leave vertices of four neighbours and of eight.
            assert!(uneven < most && uneven < 1.05 * raw, "{name}: {uneven}, before {raw}");
            assert!((shown.volume() / shape.volume() - 1.0).abs() < 5e-3, "{name}");
            assert!((area / shape.vertex_areas().iter().sum::<Real>() - 1.0).abs() < 0.02, "{name}");
        }
    }

    #[test]
    fn what_needs_no_other_triangles_keeps_its_own() {
        let liver = liver_surface(0.004);
        assert_eq!(displayed(&liver, liver.vertices.len(), 0.0), liver);
        assert_eq!(displayed(&liver, 20_000, 0.1), liver);
    }
}
