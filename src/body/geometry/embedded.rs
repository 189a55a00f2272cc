//! A surface to look at, embedded in the one that is touched [DDCB01 4.1]: every vertex hangs on the closest triangle there,
//! by three weights and an offset in the triangle's own frame.
//!
//! The touched surface is embedded in every level of the body and moves without jumps where the resolution changes; whatever
//! hangs on it does so, too, and cannot move it.

use palpate_core::geometry::Surface;
use palpate_core::math::{Mat3, Real, Vec3, from_parry, to_parry};
use parry3d_f64::query::PointQueryWithLocation;
use rayon::prelude::*;

/// Where a vertex hangs.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Embedding {
    /// Vertices of the triangle.
    pub corners: [u32; 3],
    /// Barycentric weights of the closest point.
    pub weights: [Real; 3],
    /// From there to the vertex at rest: along the triangle's first and last edge from its first corner [1], and along its
    /// normal [m].
    pub offset: Vec3,
}

/// First and last edge from the first corner [m], and the unit normal; where the triangle has no area, a normal of zero.
fn frame([a, b, c]: [Vec3; 3]) -> Mat3 {
    let (first, last) = (b - a, c - a);
    let normal = first.cross(&last).try_normalize(0.0).unwrap_or_else(Vec3::zeros);
    Mat3::from_columns(&[first, last, normal])
}

impl Embedding {
    /// Of `vertices` [m] in `touched`, both at rest.
    pub fn of(vertices: &[Vec3], touched: &Surface) -> Vec<Self> {
        let shape = touched.to_trimesh();
        let embed = |v: &Vec3| {
            let (closest, (triangle, location)) = shape.project_local_point_and_get_location(to_parry(*v), false);
            let corners = touched.triangles[triangle as usize];
            let frame = frame(touched.corners(triangle as usize));
            let offset =
                frame.try_inverse().map_or_else(Vec3::zeros, |to_own| to_own * (v - from_parry(closest.point)));
            let weights = location.barycentric_coordinates().unwrap_or([1.0 / 3.0; 3]);
            Self { corners, weights, offset }
        };
        vertices.par_iter().map(embed).collect()
    }

    /// On vertex `v` of the touched surface, wherever it goes.
    pub fn on_vertex(v: u32) -> Self {
        Self { corners: [v; 3], weights: [1.0, 0.0, 0.0], offset: Vec3::zeros() }
    }

    /// Where the vertex is with the touched vertices at `now` [m].
    pub fn position(&self, now: &[Vec3]) -> Vec3 {
        let corners = self.corners.map(|v| now[v as usize]);
        let point: Vec3 = corners.iter().zip(self.weights).map(|(x, w)| x * w).sum();
        point + frame(corners) * self.offset
    }

    /// The touched vertex that counts most.
    pub fn nearest(&self) -> u32 {
        let most = (0..3).max_by(|a, b| self.weights[*a].total_cmp(&self.weights[*b]));
        self.corners[most.unwrap_or(0)]
    }

    /// Distance at rest from the touched surface, with its vertices at `rest` [m].
    pub fn distance(&self, rest: &[Vec3]) -> Real {
        (frame(self.corners.map(|v| rest[v as usize])) * self.offset).norm()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use palpate_core::geometry::primitives::box_surface;

    fn bumps() -> Vec<Vec3> {
        // On, above and below the faces of a box of 0.1 m, at its edges and in its middle.
        let at = |i: u32| [-0.002, 0.0, 0.03, 0.0501, 0.1, 0.1004][i as usize % 6];
        (0..216).map(|i| Vec3::new(at(i), at(i / 6), at(i / 36))).collect()
    }

    #[test]
    fn at_rest_every_vertex_is_where_it_was_and_follows_rigid_motion_exactly() {
        let touched = box_surface(Vec3::repeat(0.1), [4, 5, 6]);
        let bumps = bumps();
        let embedded = Embedding::of(&bumps, &touched);
        let turn = |x: &Vec3| Vec3::new(-x.y + 0.3, x.x, x.z - 1.0);
        let turned: Vec<Vec3> = touched.vertices.iter().map(turn).collect();
        for (bump, embedding) in bumps.iter().zip(&embedded) {
            assert!((embedding.position(&touched.vertices) - bump).norm() < 1e-12);
            assert!((embedding.position(&turned) - turn(bump)).norm() < 1e-12);
            assert!((embedding.weights.iter().sum::<Real>() - 1.0).abs() < 1e-12);
        }
    }

    #[test]
    fn a_stretched_surface_takes_along_what_lies_on_it_and_keeps_heights() {
        let touched = box_surface(Vec3::repeat(0.1), [4, 4, 4]);
        let stretched: Vec<Vec3> = touched.vertices.iter().map(|x| Vec3::new(1.5 * x.x, 0.8 * x.y, x.z)).collect();
        let above = Vec3::new(0.033, 0.041, 0.102);
        let embedding = Embedding::of(&[above], &touched)[0];
        let moved = embedding.position(&stretched);
        assert!((moved - Vec3::new(1.5 * above.x, 0.8 * above.y, above.z)).norm() < 1e-12, "{moved}");
        assert!((embedding.distance(&touched.vertices) - 0.002).abs() < 1e-12);
    }

    #[test]
    fn a_triangle_pressed_flat_gives_finite_places() {
        let touched = box_surface(Vec3::repeat(0.1), [2, 2, 2]);
        let flat = vec![Vec3::repeat(0.05); touched.vertices.len()];
        assert!(Embedding::of(&bumps(), &touched).iter().all(|e| e.position(&flat).iter().all(|c| c.is_finite())));
    }
}
