//! A triangulated surface at rest.

use crate::ids::NONE;
use crate::math::{Bounds, Real, Vec3, to_parry};
use parry3d_f64::shape::{TriMesh, TriMeshFlags};
use serde::{Deserialize, Serialize};
use std::ops::Range;

/// A surface as it came: vertices [m] and triangles, counter-clockwise seen from outside when it is closed.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Surface {
    /// Rest positions [m], (n_vertices).
    pub vertices: Vec<Vec3>,
    /// Vertex indices, (n_triangles).
    pub triangles: Vec<[u32; 3]>,
}

/// How many times its size a surface may be away from the origin before its volume is reckoned from its middle.
const FAR: Real = 100.0;

impl Surface {
    /// Corners of triangle `t` [m].
    pub fn corners(&self, t: usize) -> [Vec3; 3] {
        self.triangles[t].map(|v| self.vertices[v as usize])
    }

    /// Length of the longest edge [m].
    pub fn longest_edge(&self) -> Real {
        let edge = |t: usize, i: usize| {
            let corners = self.corners(t);
            (corners[i] - corners[(i + 1) % 3]).norm()
        };
        (0..self.triangles.len()).flat_map(|t| (0..3).map(move |i| edge(t, i))).fold(0.0, Real::max)
    }

    /// Signed volume enclosed [m³]: positive when the triangles face outward.
    pub fn volume(&self) -> Real {
        self.volume_within(0..self.triangles.len())
    }

    /// Signed volume [m³] that these triangles enclose by themselves.
    pub fn volume_within(&self, triangles: Range<usize>) -> Real {
        // Far from the origin large volumes would cancel: 1 km away those of an organ are a thousandth off.
        let bounds = self.bounds();
        let centre = bounds.middle();
        let is_far = centre.norm() > FAR * bounds.size().norm();
        let origin = if is_far { centre } else { Vec3::zeros() };
        triangles
            .map(|t| {
                let [a, b, c] = self.corners(t).map(|corner| corner - origin);
                a.dot(&b.cross(&c)) / 6.0
            })
            .sum()
    }

    /// The same with each edge in `parts` equal parts.
    pub fn subdivided(&self, parts: u32) -> Surface {
        let mut surface = Surface { vertices: self.vertices.clone(), triangles: Vec::new() };
        let mut on_edge = std::collections::BTreeMap::new();
        for triangle in &self.triangles {
            let [a, b, c] = triangle.map(|v| self.vertices[v as usize]);
            let mut number = std::collections::BTreeMap::new();
            for i in 0..=parts {
                for j in 0..=parts - i {
                    let k = parts - i - j;
                    let ends: Vec<(u32, u32)> =
                        triangle.iter().copied().zip([k, i, j]).filter(|(_, w)| *w > 0).collect();
                    let place = a + ((b - a) * Real::from(i) + (c - a) * Real::from(j)) / Real::from(parts);
                    let mut add = || {
                        surface.vertices.push(place);
                        surface.vertices.len() as u32 - 1
                    };
                    let v = match ends[..] {
                        [(v, _)] => v,
                        [(v, w), (u, x)] => {
                            let key = if v < u { (v, u, w) } else { (u, v, x) };
                            *on_edge.entry(key).or_insert_with(add)
                        }
                        _ => add(),
                    };
                    number.insert((i, j), v);
                }
            }
            for i in 0..parts {
                for j in 0..parts - i {
                    surface.triangles.push([number[&(i, j)], number[&(i + 1, j)], number[&(i, j + 1)]]);
                    if i + j + 1 < parts {
                        surface.triangles.push([number[&(i + 1, j)], number[&(i + 1, j + 1)], number[&(i, j + 1)]]);
                    }
                }
            }
        }
        surface
    }

    /// The same with the longest edges cut in halves, one after the other, until there are `vertices` or none is longer
    /// than `longest` [m]. The surface must be closed.
    pub fn refined(&self, vertices: usize, longest: Real) -> Surface {
        let mut surface = self.clone();
        let squared = |surface: &Surface, [a, b]: [u32; 2]| {
            (surface.vertices[a as usize] - surface.vertices[b as usize]).norm_squared()
        };
        let edges = |[a, b, c]: [u32; 3]| [[a, b], [b, c], [c, a]];
        // The triangle to the left of each edge, and the edges by length; lengths above zero are in the order of their bits.
        let mut left = std::collections::HashMap::new();
        let mut open = std::collections::BinaryHeap::new();
        for (t, triangle) in self.triangles.iter().enumerate() {
            for [a, b] in edges(*triangle) {
                left.insert([a, b], t);
                if a < b {
                    open.push((squared(self, [a, b]).to_bits(), [a, b]));
                }
            }
        }
        while let Some((length, [a, b])) = open.pop() {
            if surface.vertices.len() >= vertices || Real::from_bits(length) <= longest * longest {
                break;
            }
            let (Some(s), Some(t)) = (left.remove(&[a, b]), left.remove(&[b, a])) else { continue };
            let middle = surface.vertices.len() as u32;
            surface.vertices.push((surface.vertices[a as usize] + surface.vertices[b as usize]) * 0.5);
            open.extend([[a, middle], [b, middle]].map(|edge| (squared(&surface, edge).to_bits(), edge)));
            for (t, [from, to]) in [(s, [a, b]), (t, [b, a])] {
                let apex = surface.triangles[t].into_iter().find(|v| *v != a && *v != b).unwrap_or(middle);
                let other = surface.triangles.len();
                surface.triangles[t] = [from, middle, apex];
                surface.triangles.push([middle, to, apex]);
                edges([from, middle, apex]).into_iter().for_each(|edge| _ = left.insert(edge, t));
                edges([middle, to, apex]).into_iter().for_each(|edge| _ = left.insert(edge, other));
                open.push((squared(&surface, [apex, middle]).to_bits(), [apex, middle]));
            }
        }
        surface
    }

    /// The box around all vertices.
    pub fn bounds(&self) -> Bounds {
        Bounds::of(self.vertices.iter().copied())
    }

    /// A third of the area of the triangles around each vertex [m²], (n_vertices).
    pub fn vertex_areas(&self) -> Vec<Real> {
        let mut areas = vec![0.0; self.vertices.len()];
        for (t, triangle) in self.triangles.iter().enumerate() {
            let [a, b, c] = self.corners(t);
            let third = (b - a).cross(&(c - a)).norm() / 6.0;
            for &v in triangle {
                areas[v as usize] += third;
            }
        }
        areas
    }

    /// parry's mesh of this surface, oriented, so that its point projections tell inside from outside.
    ///
    /// # Panics
    /// When the surface has no triangle; a surface that passed [`super::soundness::check_closed`] has some.
    pub fn to_trimesh(&self) -> TriMesh {
        let vertices = self.vertices.iter().map(|v| to_parry(*v)).collect();
        TriMesh::with_flags(vertices, self.triangles.clone(), TriMeshFlags::ORIENTED)
            .expect("a surface with triangles makes a TriMesh")
    }
}

/// The `points` that some cell refers to, in their old order; `cells` are renumbered to match. Indices must be valid.
pub fn keep_referenced<const N: usize>(points: &[Vec3], cells: &mut [[u32; N]]) -> Vec<Vec3> {
    let mut new_index = vec![NONE; points.len()];
    for &point in cells.as_flattened() {
        new_index[point as usize] = 0;
    }
    let mut kept = Vec::new();
    for (point, index) in points.iter().zip(&mut new_index).filter(|(_, index)| **index == 0) {
        *index = kept.len() as u32;
        kept.push(*point);
    }
    for point in cells.as_flattened_mut() {
        *point = new_index[*point as usize];
    }
    kept
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::primitives::box_surface;

    #[test]
    fn a_volume_far_from_the_origin_is_as_near_it() {
        let near = box_surface(Vec3::new(0.1, 0.2, 0.3), [3, 5, 7]);
        let mut far = near.clone();
        far.vertices.iter_mut().for_each(|v| *v += Vec3::new(1e5, -2e5, 3e5));
        assert!((far.volume() / near.volume() - 1.0).abs() < 1e-8, "{}", far.volume());
    }
}
