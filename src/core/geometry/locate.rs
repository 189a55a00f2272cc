//! Where a point lies: the element that contains it, and the nearest of a set of points.
//!
//! Built with parry's bounding-volume hierarchy; used while a body is prepared, never inside a tick.

use super::tet_mesh::{TetMesh, barycentric};
use crate::math::{Real, Vec3, to_parry};
use parry3d_f64::bounding_volume::Aabb;
use parry3d_f64::partitioning::{Bvh, BvhBuildStrategy};
use serde::{Deserialize, Serialize};

/// A point as an affine combination of an element's four nodes.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Host<Id = u32> {
    /// Element of the host's mesh: its place there, or its id in a body.
    pub element: Id,
    /// Barycentric weights, sum 1; negative ones extrapolate.
    pub weights: [Real; 4],
}

impl<Id> Host<Id> {
    /// How far the point lies outside its element: the most negative weight, or 0 inside.
    pub fn extrapolation(&self) -> Real {
        self.weights.iter().fold(0.0, |worst: Real, w| worst.min(*w))
    }
}

/// Finds the element that contains a point.
pub struct Locator<'a> {
    mesh: &'a TetMesh,
    bvh: Bvh,
    reach: Real,
}

impl<'a> Locator<'a> {
    /// Index of `mesh`'s elements; `reach` [m] is the first radius tried for points outside all of them (about one
    /// element edge).
    pub fn new(mesh: &'a TetMesh, reach: Real) -> Self {
        let boxes = (0..mesh.elements.len()).map(|e| {
            let [a, b, c, d] = mesh.corners(e);
            (e, Aabb::new(to_parry(a.inf(&b).inf(&c.inf(&d))), to_parry(a.sup(&b).sup(&c.sup(&d)))))
        });
        Self { mesh, bvh: Bvh::from_iter(BvhBuildStrategy::Binned, boxes), reach }
    }

    /// The element that contains `p` [m]; outside the mesh, the one among the near elements that has to extrapolate
    /// least, with its affine weights.
    pub fn host(&self, p: Vec3) -> Host {
        let mut radius = self.reach * 1e-6;
        loop {
            let mut best: Option<(Real, u32, [Real; 4])> = None;
            let window = Aabb::new(to_parry(p.add_scalar(-radius)), to_parry(p.add_scalar(radius)));
            for e in self.bvh.intersect_aabb(&window) {
                let weights = barycentric(&self.mesh.corners(e as usize), p);
                let least = weights.iter().copied().fold(Real::INFINITY, Real::min);
                // Ties go to the smaller element number, so that the result does not depend on the tree.
                if best.is_none_or(|(b, i, _)| least > b || (least == b && e < i)) {
                    best = Some((least, e, weights));
                }
            }
            match best {
                Some((least, element, weights)) if least >= 0.0 || radius >= self.reach => {
                    return Host { element, weights };
                }
                _ => radius = if radius < self.reach { self.reach } else { radius * 2.0 },
            }
        }
    }
}

/// For each of `queries` the index of the nearest of `points`, or, ascending, of all that are as near; `reach` [m] is the
/// first radius tried, about the spacing of `points`.
pub fn nearest(points: &[Vec3], queries: &[Vec3], reach: Real) -> Vec<Vec<u32>> {
    let leaves = points.iter().enumerate().map(|(i, p)| (i, Aabb::new(to_parry(*p), to_parry(*p))));
    let bvh = Bvh::from_iter(BvhBuildStrategy::Binned, leaves);
    let one = |q: &Vec3| {
        let mut radius = reach;
        loop {
            let window = Aabb::new(to_parry(q.add_scalar(-radius)), to_parry(q.add_scalar(radius)));
            let distance = |i: u32| (points[i as usize] - q).norm_squared();
            let least = bvh.intersect_aabb(&window).map(distance).fold(Real::INFINITY, Real::min);
            // A point in the window's corner may be farther than one just outside a face.
            if least <= radius * radius {
                let mut tied: Vec<u32> =
                    bvh.intersect_aabb(&window).filter(|i| distance(*i) <= least * (1.0 + TIE)).collect();
                tied.sort_unstable();
                return tied;
            }
            radius *= 2.0;
        }
    };
    queries.iter().map(one).collect()
}

/// Squared distances that differ by less than this part are alike: coordinates are rounded.
const TIE: Real = 1e-9;

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::primitives::box_mesh;

    #[test]
    fn a_host_gives_its_point_back_inside_and_outside() {
        let mesh = box_mesh(Vec3::new(0.2, 0.1, 0.1), [4, 2, 2]);
        let locator = Locator::new(&mesh, 0.05);
        for p in [Vec3::new(0.03, 0.071, 0.02), Vec3::new(0.1, 0.05, 0.05), Vec3::new(0.21, 0.11, -0.01)] {
            let host = locator.host(p);
            let corners = mesh.corners(host.element as usize);
            let back: Vec3 = corners.iter().zip(host.weights).map(|(u, w)| u * w).sum();
            assert!((back - p).norm() < 1e-15);
        }
        assert!(locator.host(Vec3::new(0.03, 0.071, 0.02)).extrapolation() > -1e-12);
        assert!(locator.host(Vec3::new(0.21, 0.11, -0.01)).extrapolation() < 0.0);
    }

    #[test]
    fn the_nearest_point_agrees_with_trying_them_all() {
        let points = box_mesh(Vec3::new(0.2, 0.1, 0.1), [5, 3, 4]).nodes;
        let queries: Vec<Vec3> = (0..50).map(|i| Vec3::new(0.004 * i as Real, 0.0021 * i as Real, 0.03)).collect();
        for (q, found) in queries.iter().zip(nearest(&points, &queries, 0.01)) {
            let best = points.iter().map(|p| (p - q).norm()).fold(Real::INFINITY, Real::min);
            let as_near = |p: &u32| (points[*p as usize] - q).norm() <= best * (1.0 + TIE);
            let all: Vec<u32> = (0..points.len() as u32).filter(as_near).collect();
            assert!(!found.is_empty() && found == all);
        }
    }
}
