//! A triangulated surface at rest.

use crate::math::{Real, Vec3, to_parry};
use parry3d_f64::shape::{TriMesh, TriMeshFlags};
use serde::{Deserialize, Serialize};

/// A surface as it came: vertices [m] and triangles, counter-clockwise seen from outside when it is closed.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Surface {
    /// Rest positions [m], (n_vertices).
    pub vertices: Vec<Vec3>,
    /// Vertex indices, (n_triangles).
    pub triangles: Vec<[u32; 3]>,
}

impl Surface {
    /// Corners of triangle `t` [m].
    pub fn corners(&self, t: usize) -> [Vec3; 3] {
        self.triangles[t].map(|v| self.vertices[v as usize])
    }

    /// Signed volume enclosed [m³]: positive when the triangles face outward.
    pub fn volume(&self) -> Real {
        (0..self.triangles.len())
            .map(|t| {
                let [a, b, c] = self.corners(t);
                a.dot(&b.cross(&c)) / 6.0
            })
            .sum()
    }

    /// Smallest and largest coordinates [m].
    pub fn bounds(&self) -> (Vec3, Vec3) {
        self.vertices.iter().fold((Vec3::repeat(Real::INFINITY), Vec3::repeat(Real::NEG_INFINITY)), |(low, high), v| {
            (low.inf(v), high.sup(v))
        })
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
