//! A tetrahedral mesh at rest.

use crate::math::{Real, Vec3};
use serde::{Deserialize, Serialize};

/// Nodes and positively oriented linear tetrahedra.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct TetMesh {
    /// Rest positions [m], (n_nodes).
    pub nodes: Vec<Vec3>,
    /// Node indices; `det[u1−u0, u2−u0, u3−u0] > 0`, (n_elements).
    pub elements: Vec<[u32; 4]>,
}

/// Faces of a positively oriented tetrahedron, counter-clockwise seen from outside; face `i` lies opposite vertex `i`.
pub const FACES: [[usize; 3]; 4] = [[1, 2, 3], [0, 3, 2], [0, 1, 3], [0, 2, 1]];

/// Signed volume [m³] of the tetrahedron `u`.
pub fn volume(u: &[Vec3; 4]) -> Real {
    (u[1] - u[0]).cross(&(u[2] - u[0])).dot(&(u[3] - u[0])) / 6.0
}

/// Gradients of the four barycentric coordinates [1/m] in the tetrahedron `u`.
pub fn gradients(u: &[Vec3; 4]) -> [Vec3; 4] {
    let six_volumes = (u[1] - u[0]).cross(&(u[2] - u[0])).dot(&(u[3] - u[0]));
    let face = |a: usize, b: usize, c: usize| (u[b] - u[a]).cross(&(u[c] - u[a])) / six_volumes;
    [face(1, 3, 2), face(0, 2, 3), face(0, 3, 1), face(0, 1, 2)]
}

/// Barycentric coordinates of `p` in the tetrahedron `u`: they sum to one, and one below zero means outside.
pub fn barycentric(u: &[Vec3; 4], p: Vec3) -> [Real; 4] {
    let (a, b, c, d) = (u[1] - u[0], u[2] - u[0], u[3] - u[0], p - u[0]);
    let six_volume = a.cross(&b).dot(&c);
    let w1 = d.cross(&b).dot(&c) / six_volume;
    let w2 = a.cross(&d).dot(&c) / six_volume;
    let w3 = a.cross(&b).dot(&d) / six_volume;
    [1.0 - w1 - w2 - w3, w1, w2, w3]
}

impl TetMesh {
    /// The four rest positions of element `e` [m].
    pub fn corners(&self, e: usize) -> [Vec3; 4] {
        self.elements[e].map(|n| self.nodes[n as usize])
    }

    /// Volume of element `e` [m³].
    pub fn volume(&self, e: usize) -> Real {
        volume(&self.corners(e))
    }

    /// A fourth of the volume of each node's elements [m³], (n_nodes).
    pub fn node_volumes(&self) -> Vec<Real> {
        let mut volumes = vec![0.0; self.nodes.len()];
        for (e, nodes) in self.elements.iter().enumerate() {
            nodes.iter().for_each(|n| volumes[*n as usize] += self.volume(e) / 4.0);
        }
        volumes
    }

    /// Smallest altitude of element `e` [m]: three volumes over the largest face.
    pub fn smallest_altitude(&self, e: usize) -> Real {
        let u = self.corners(e);
        let largest_face =
            FACES.iter().map(|f| 0.5 * (u[f[1]] - u[f[0]]).cross(&(u[f[2]] - u[f[0]])).norm()).fold(0.0, Real::max);
        3.0 * volume(&u).abs() / largest_face
    }

    /// The outer triangles, counter-clockwise seen from outside, in element order.
    pub fn boundary(&self) -> Vec<[u32; 3]> {
        let mut faces: Vec<([u32; 3], [u32; 3])> = Vec::with_capacity(self.elements.len() * 4);
        for element in &self.elements {
            for face in FACES {
                let triangle = face.map(|i| element[i]);
                let mut key = triangle;
                key.sort_unstable();
                faces.push((key, triangle));
            }
        }
        let mut order: Vec<usize> = (0..faces.len()).collect();
        order.sort_unstable_by_key(|&i| (faces[i].0, i));
        let mut outer: Vec<usize> = order
            .chunk_by(|&a, &b| faces[a].0 == faces[b].0)
            .filter(|same| same.len() == 1)
            .map(|same| same[0])
            .collect();
        outer.sort_unstable();
        outer.into_iter().map(|i| faces[i].1).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn unit() -> TetMesh {
        TetMesh { nodes: vec![Vec3::zeros(), Vec3::x(), Vec3::y(), Vec3::z()], elements: vec![[0, 1, 2, 3]] }
    }

    #[test]
    fn the_faces_of_a_positive_tetrahedron_point_outward() {
        let mesh = unit();
        let centre = Vec3::repeat(0.25);
        for [a, b, c] in mesh.boundary() {
            let (a, b, c) = (mesh.nodes[a as usize], mesh.nodes[b as usize], mesh.nodes[c as usize]);
            assert!((b - a).cross(&(c - a)).dot(&(a - centre)) > 0.0);
        }
        assert_eq!(mesh.boundary().len(), 4);
    }

    #[test]
    fn barycentric_coordinates_give_the_point_back() {
        let u = unit().corners(0);
        let p = Vec3::new(0.2, -0.3, 0.5);
        let w = barycentric(&u, p);
        let back: Vec3 = u.iter().zip(w).map(|(u, w)| u * w).sum();
        assert!((back - p).norm() < 1e-15);
        assert!((w.iter().sum::<Real>() - 1.0).abs() < 1e-15);
    }

    #[test]
    fn the_smallest_altitude_of_the_corner_tetrahedron_is_over_its_slanted_face() {
        assert!((unit().smallest_altitude(0) - 1.0 / 3.0f64.sqrt()).abs() < 1e-15);
    }
}
