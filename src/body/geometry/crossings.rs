//! Where a surface crosses or touches itself, decided exactly.
//!
//! Two triangles meet when an edge of one meets the other. On which side of a plane or a line a point lies is decided by
//! predicates that are never wrong (`robust`), so that triangles which only share a corner or an edge do not count.

use palpate_core::geometry::Surface;
use palpate_core::math::{Real, Vec3, to_parry};
use parry3d_f64::bounding_volume::Aabb;
use parry3d_f64::partitioning::{Bvh, BvhBuildStrategy};
use rayon::prelude::*;
use robust::{Coord, Coord3D, orient2d, orient3d};

/// Pairs of triangles of `surface` that meet elsewhere than in the corners that they share, each pair once, ascending.
/// Indices must be valid and coordinates finite.
pub fn crossings(surface: &Surface) -> Vec<(u32, u32)> {
    let around = |t: usize| {
        let [a, b, c] = surface.corners(t);
        Aabb::new(to_parry(a.inf(&b).inf(&c)), to_parry(a.sup(&b).sup(&c)))
    };
    let all = 0..surface.triangles.len();
    let bvh = Bvh::from_iter(BvhBuildStrategy::Binned, all.clone().map(|t| (t, around(t))));
    let of_triangle = |t: usize| {
        let window = around(t);
        let near = bvh.intersect_aabb(&window).filter(|other| *other as usize > t);
        let mut met: Vec<u32> = near.filter(|other| meet(surface, t, *other as usize)).collect();
        met.sort_unstable();
        met.into_iter().map(move |other| (t as u32, other)).collect::<Vec<_>>()
    };
    all.into_par_iter().flat_map_iter(of_triangle).collect()
}

/// True when the triangles `s` and `t` meet elsewhere than in the corners that they share.
fn meet(surface: &Surface, s: usize, t: usize) -> bool {
    let (first, second) = (surface.triangles[s], surface.triangles[t]);
    let point = |v: u32| surface.vertices[v as usize];
    let apart = |from: [u32; 3], other: [u32; 3]| from.into_iter().filter(move |v| !other.contains(v));
    match apart(first, second).count() {
        // One and the same triangle, or its back.
        0 => true,
        // Across a shared edge they can only lie on one another, folded.
        1 => {
            let shared: Vec<Vec3> = first.into_iter().filter(|v| second.contains(v)).map(point).collect();
            let apexes: Vec<Vec3> = apart(first, second).chain(apart(second, first)).map(point).collect();
            side(shared[0], shared[1], apexes[0], apexes[1]) == 0.0 && {
                let flat = Flat::new(&first.map(point));
                flat.turn(shared[0], shared[1], apexes[0]) * flat.turn(shared[0], shared[1], apexes[1]) > 0.0
            }
        }
        // The edges at a shared corner leave it: if one meets the other triangle elsewhere, so does an opposite edge.
        _ => {
            let edges = |from: [u32; 3], other: [u32; 3]| {
                [[from[0], from[1]], [from[1], from[2]], [from[2], from[0]]]
                    .into_iter()
                    .filter(move |edge| !edge.iter().any(|v| other.contains(v)))
                    .map(|edge| edge.map(point))
            };
            edges(first, second).any(|edge| pierces(edge, second.map(point)))
                || edges(second, first).any(|edge| pierces(edge, first.map(point)))
        }
    }
}

/// Positive, negative or zero as `p` lies below, above or in the plane through `a`, `b` and `c`, or below zero volume.
fn side(a: Vec3, b: Vec3, c: Vec3, p: Vec3) -> Real {
    let coordinates = |p: Vec3| Coord3D { x: p.x, y: p.y, z: p.z };
    sign(orient3d(coordinates(a), coordinates(b), coordinates(c), coordinates(p)))
}

fn sign(value: Real) -> Real {
    if value > 0.0 {
        1.0
    } else if value < 0.0 {
        -1.0
    } else {
        0.0
    }
}

/// True when the segment meets the triangle.
fn pierces([p, q]: [Vec3; 2], [a, b, c]: [Vec3; 3]) -> bool {
    let (at_p, at_q) = (side(a, b, c, p), side(a, b, c, q));
    if at_p == 0.0 && at_q == 0.0 {
        return Flat::new(&[a, b, c]).meets([p, q], [a, b, c]);
    }
    if at_p * at_q > 0.0 {
        return false;
    }
    let turns = [side(p, q, a, b), side(p, q, b, c), side(p, q, c, a)];
    turns.iter().all(|turn| *turn >= 0.0) || turns.iter().all(|turn| *turn <= 0.0)
}

/// A plane seen along the axis that it faces the most.
struct Flat {
    axes: [usize; 2],
}

impl Flat {
    fn new([a, b, c]: &[Vec3; 3]) -> Self {
        let along = (b - a).cross(&(c - a)).iamax();
        Flat { axes: [(along + 1) % 3, (along + 2) % 3] }
    }

    /// Which way one turns from `a` over `b` to `c`; 0 on a line.
    fn turn(&self, a: Vec3, b: Vec3, c: Vec3) -> Real {
        let seen = |p: Vec3| Coord { x: p[self.axes[0]], y: p[self.axes[1]] };
        sign(orient2d(seen(a), seen(b), seen(c)))
    }

    /// True when a segment in the plane meets a triangle in it.
    fn meets(&self, [p, q]: [Vec3; 2], [a, b, c]: [Vec3; 3]) -> bool {
        let inside = |x: Vec3| {
            let turns = [self.turn(a, b, x), self.turn(b, c, x), self.turn(c, a, x)];
            turns.iter().all(|t| *t >= 0.0) || turns.iter().all(|t| *t <= 0.0)
        };
        let between = |x: Vec3, [a, b]: [Vec3; 2]| {
            self.turn(a, b, x) == 0.0 && self.axes.iter().all(|i| (x[*i] - a[*i]) * (x[*i] - b[*i]) <= 0.0)
        };
        let cross = |[a, b]: [Vec3; 2]| {
            self.turn(p, q, a) * self.turn(p, q, b) < 0.0 && self.turn(a, b, p) * self.turn(a, b, q) < 0.0
                || between(a, [p, q])
                || between(p, [a, b])
                || between(q, [a, b])
        };
        inside(p) || inside(q) || [[a, b], [b, c], [c, a]].into_iter().any(cross)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::primitives::{sphere_surface, toy_surface};
    use palpate_core::geometry::primitives::box_surface;

    fn both(mut a: Surface, b: &Surface) -> Surface {
        let first = a.vertices.len() as u32;
        a.vertices.extend(&b.vertices);
        a.triangles.extend(b.triangles.iter().map(|t| t.map(|v| v + first)));
        a
    }

    #[test]
    fn sound_surfaces_do_not_cross_themselves() {
        for surface in [toy_surface(0.004), sphere_surface(0.05, 0.003), box_surface(Vec3::repeat(0.1), [7, 3, 5])] {
            assert_eq!(crossings(&surface), []);
        }
        let mut away = box_surface(Vec3::repeat(0.1), [2; 3]);
        away.vertices.iter_mut().for_each(|v| v.x += 0.1 + 1e-12);
        assert_eq!(crossings(&both(box_surface(Vec3::repeat(0.1), [2; 3]), &away)), []);
    }

    #[test]
    fn bodies_that_cross_or_touch_and_folded_triangles_are_found() {
        let cube = box_surface(Vec3::repeat(0.1), [2; 3]);
        for shift in [Vec3::new(0.05, 0.03, 0.02), Vec3::new(0.1, 0.0, 0.0), Vec3::new(0.1, 0.013, 0.027)] {
            let mut other = cube.clone();
            other.vertices.iter_mut().for_each(|v| *v += shift);
            let met = crossings(&both(cube.clone(), &other));
            assert!(met.len() > 8, "{shift}: {}", met.len());
            assert!(
                met.iter().all(|(s, t)| (*s as usize) < cube.triangles.len() && *t as usize >= cube.triangles.len())
            );
        }
        // Two triangles on one edge: apart, and on one another.
        let folded = |apex: Vec3| Surface {
            vertices: vec![Vec3::zeros(), Vec3::x(), Vec3::y(), apex],
            triangles: vec![[0, 1, 2], [1, 0, 3]],
        };
        assert_eq!(crossings(&folded(-Vec3::y())), []);
        assert_eq!(crossings(&folded(Vec3::y() + Vec3::z())), []);
        assert_eq!(crossings(&folded(Vec3::new(0.2, 0.5, 0.0))), [(0, 1)]);
        // A needle through a triangle whose corner it shares.
        let needle = Surface {
            vertices: vec![Vec3::zeros(), Vec3::x(), Vec3::y(), Vec3::new(0.3, 0.3, 0.1), Vec3::new(0.3, 0.3, -0.1)],
            triangles: vec![[0, 1, 2], [0, 3, 4]],
        };
        assert_eq!(crossings(&needle), [(0, 1)]);
    }
}
