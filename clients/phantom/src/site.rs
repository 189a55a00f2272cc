//! Where to touch a body one has never seen: its top, as it is now.

use anyhow::{Result, ensure};
use palpate_sdk::Surface;

use crate::Vec3;

/// How far outside a triangle, in barycentric weight, still counts as hitting it: a column through an edge or a vertex
/// must not slip between its triangles.
const EDGE: f64 = 1e-6;

/// The topmost point [m] of `surface` with its vertices at `positions` [m], in the column along z through the middle of the bounds of its
/// first organ, and the outward unit normal there (vertex normals, interpolated). Where that column misses the body, it goes through the
/// upward facing vertex of the first organ nearest to it instead.
///
/// Errors: the surface has no upward facing part.
pub fn top_of_surface(surface: &Surface, positions: &[[f32; 3]]) -> Result<(Vec3, Vec3)> {
    let first = match &surface.organs[..] {
        [first, _, ..] => first.vertices as usize,
        _ => positions.len(),
    };
    let positions: Vec<Vec3> = positions.iter().map(|p| Vec3::from(p.map(f64::from))).collect();
    let normals = vertex_normals(&positions, &surface.triangles);
    let upward = |vertex: &usize| normals[*vertex].z > 0.5;
    ensure!((0..first).any(|vertex| upward(&vertex)), "the surface has no upward facing part to touch");

    let (min, max) =
        positions[..first].iter().fold((positions[0], positions[0]), |(min, max), p| (min.inf(p), max.sup(p)));
    let middle = 0.5 * (min + max);
    if let Some(hit) = topmost_hit(&positions, &normals, &surface.triangles, middle) {
        return Ok(hit);
    }
    let distance = |vertex: &usize| (positions[*vertex] - middle).xy().norm_squared();
    let nearest = (0..first).filter(upward).min_by(|a, b| distance(a).total_cmp(&distance(b)));
    // An upward facing vertex lies on upward facing triangles, so its column hits at least itself.
    let column = nearest.map(|vertex| positions[vertex]).unwrap_or(middle);
    topmost_hit(&positions, &normals, &surface.triangles, column)
        .ok_or_else(|| anyhow::anyhow!("the surface has no upward facing part to touch"))
}

/// The highest point in which the column along z through `column` leaves the body, and the normal there.
fn topmost_hit(positions: &[Vec3], normals: &[Vec3], triangles: &[[u32; 3]], column: Vec3) -> Option<(Vec3, Vec3)> {
    let hits = triangles.iter().filter_map(|triangle| {
        let [a, b, c] = triangle.map(|vertex| positions[vertex as usize]);
        let twice_area = (b - a).xy().perp(&(c - a).xy());
        // Seen from above, upward facing triangles run counter-clockwise.
        (twice_area > 0.0).then_some(())?;
        let weight = |from: Vec3, to: Vec3| (to - from).xy().perp(&(column - from).xy()) / twice_area;
        let weights = [weight(b, c), weight(c, a), weight(a, b)];
        weights.iter().all(|&w| w > -EDGE).then_some(())?;
        let blend = |values: &[Vec3]| -> Vec3 { (0..3).map(|i| values[triangle[i] as usize] * weights[i]).sum() };
        Some((blend(positions), blend(normals).try_normalize(0.0)?))
    });
    hits.max_by(|(a, _), (b, _)| a.z.total_cmp(&b.z))
}

/// Outward unit normals (vertices): the normals of the adjacent triangles, weighted with their angle at the vertex, so
/// that it does not matter how a face is cut into triangles. Zero where there is none.
fn vertex_normals(positions: &[Vec3], triangles: &[[u32; 3]]) -> Vec<Vec3> {
    let mut normals = vec![Vec3::zeros(); positions.len()];
    for triangle in triangles {
        let corners = triangle.map(|vertex| positions[vertex as usize]);
        for (corner, &vertex) in triangle.iter().enumerate() {
            let [one, other] = [1, 2].map(|step| corners[(corner + step) % 3] - corners[corner]);
            if let Some(normal) = one.cross(&other).try_normalize(0.0) {
                normals[vertex as usize] += normal * one.angle(&other);
            }
        }
    }
    normals.iter().map(|normal| normal.try_normalize(0.0).unwrap_or_default()).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A box between two corners, two triangles per face.
    fn box_surface(min: [f32; 3], max: [f32; 3]) -> Surface {
        let corner = |i: usize| [0, 1, 2].map(|axis| if i >> axis & 1 == 1 { max[axis] } else { min[axis] });
        let faces = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
        let triangles = faces.iter().flat_map(|[a, b, c, d]| [[*a, *b, *c], [*a, *c, *d]]).collect();
        Surface::new(1, triangles, (0..8).map(corner).collect(), 1e-5).unwrap()
    }

    /// Two surfaces as one.
    fn both(mut one: Surface, other: Surface) -> Surface {
        let offset = one.rest_positions.len() as u32;
        one.triangles.extend(other.triangles.iter().map(|t| t.map(|vertex| vertex + offset)));
        one.rest_positions.extend(other.rest_positions);
        one
    }

    fn top(surface: &Surface) -> Result<(Vec3, Vec3)> {
        top_of_surface(surface, &surface.rest_positions)
    }

    #[test]
    fn the_top_of_a_box_is_the_middle_of_its_upper_face() {
        let (point, normal) = top(&box_surface([-1.0, -2.0, 0.0], [3.0, 4.0, 5.0])).unwrap();
        assert!((point - Vec3::new(1.0, 1.0, 5.0)).norm() < 1e-12);
        assert!((normal - Vec3::z()).norm() < 1e-6);
    }

    #[test]
    fn a_body_that_has_sunk_is_touched_where_it_is_now() {
        let surface = box_surface([0.0; 3], [1.0, 1.0, 2.0]);
        let sunk: Vec<[f32; 3]> = surface.rest_positions.iter().map(|[x, y, z]| [x + 3.0, *y, 0.5 * z]).collect();
        let (point, normal) = top_of_surface(&surface, &sunk).unwrap();
        assert!((point - Vec3::new(3.5, 0.5, 1.0)).norm() < 1e-6 && (normal - Vec3::z()).norm() < 1e-6);
    }

    #[test]
    fn the_top_of_two_bodies_is_that_of_the_upper_one() {
        let stacked = both(box_surface([0.0; 3], [2.0, 2.0, 1.0]), box_surface([0.0, 0.0, 2.0], [2.0, 2.0, 3.0]));
        assert!((top(&stacked).unwrap().0.z - 3.0).abs() < 1e-12);
    }

    #[test]
    fn of_several_organs_the_first_is_touched_or_what_lies_on_it() {
        let (first, other) = (box_surface([0.0; 3], [1.0; 3]), box_surface([-4.0, 0.0, 2.0], [2.0, 2.0, 3.0]));
        let organs = [first.organs.clone(), other.organs.clone()].concat();
        let mut surface = both(first, other);
        surface.organs = organs;
        // The middle of both is beside the first.
        assert!((top(&surface).unwrap().0 - Vec3::new(0.5, 0.5, 3.0)).norm() < 1e-6);
        let apart = |p: &[f32; 3]| if p[2] < 2.0 { *p } else { [p[0] - 3.0, p[1], p[2]] };
        let positions: Vec<_> = surface.rest_positions.iter().map(apart).collect();
        assert!((top_of_surface(&surface, &positions).unwrap().0 - Vec3::new(0.5, 0.5, 1.0)).norm() < 1e-6);
    }

    #[test]
    fn where_the_middle_is_empty_the_nearest_upward_vertex_is_touched() {
        let apart = both(box_surface([0.0; 3], [1.0; 3]), box_surface([3.0, 0.0, 0.0], [5.0, 1.0, 0.5]));
        let (point, normal) = top(&apart).unwrap();
        // The middle is at x = 2.5: nearest is the second box's edge at x = 3, height 0.5.
        assert!((point - Vec3::new(3.0, point.y, 0.5)).norm() < 1e-6);
        assert!(normal.z > 0.5);
    }

    #[test]
    fn a_surface_without_an_upper_side_is_refused() {
        let corners = vec![[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]];
        let below = Surface::new(1, vec![[0, 2, 1]], corners, 1e-5).unwrap();
        assert!(top(&below).is_err());
        assert!(top(&Surface::new(1, vec![], vec![], 1e-5).unwrap()).is_err());
    }
}
