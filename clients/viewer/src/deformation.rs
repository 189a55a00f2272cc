//! How a surface has moved and stretched against its rest shape, vertex by vertex.

use palpate_sdk::Surface;
use std::collections::BTreeMap;
use std::sync::Arc;
use three_d::{InnerSpace, Quat, Rotation, Vec3, vec3};

/// What of the rest shape every frame is compared with.
pub struct Deformation {
    surface: Arc<Surface>,
    triangles: Vec<RestTriangle>,
    /// (vertices) sum of the rest areas around each [m²].
    area: Vec<f32>,
    /// (vertices) the first vertex at the same place with the same normal: where texture coordinates have a seam, the surface
    /// is smooth all the same.
    same: Vec<u32>,
    /// (vertices) normals of the triangles around each at rest, where the surface has normals of its own.
    rest_normals: Vec<Vec3>,
}

/// A triangle at rest, in its own plane: the first edge along +x.
struct RestTriangle {
    area: f32,
    /// Inverse of the matrix whose columns are the two edges from its first corner [1/m]; upper triangular: xx, xy, yy.
    /// Zero for a triangle without area, which then counts nowhere.
    inverse: [f32; 3],
}

impl Deformation {
    /// Against the rest shape of `surface`.
    pub fn new(surface: &Arc<Surface>) -> Self {
        let mut area = vec![0.0; surface.rest_positions.len()];
        let triangles = surface.triangles.iter().map(|&corners| {
            let rest = RestTriangle::new(edges(&surface.rest_positions, corners));
            corners.iter().for_each(|&v| area[v as usize] += rest.area);
            rest
        });
        let triangles = triangles.collect();
        let mut first = BTreeMap::new();
        let mut place = |v: usize| {
            let normal = surface.normals.get(v).copied().unwrap_or_default();
            let key = (surface.rest_positions[v].map(f32::to_bits), normal.map(f32::to_bits));
            *first.entry(key).or_insert(v as u32)
        };
        // Without a seam each vertex is its own.
        let own = |v: usize| v as u32;
        let vertices = 0..surface.rest_positions.len();
        let has_seams = !surface.uvs.is_empty();
        let same = if has_seams { vertices.map(&mut place).collect() } else { vertices.map(own).collect() };
        let mut deformation = Self { surface: surface.clone(), triangles, area, same, rest_normals: Vec::new() };
        if !surface.normals.is_empty() {
            deformation.rest_normals = deformation.normals_of_triangles(&surface.rest_positions);
        }
        deformation
    }

    /// The surface at rest.
    pub fn surface(&self) -> &Surface {
        &self.surface
    }

    /// (vertices) unit normals out of the body: those of the triangles around each, weighted by area; where the surface has
    /// normals of its own, these, turned as those of the triangles have.
    pub fn normals(&self, positions: &[[f32; 3]]) -> Vec<Vec3> {
        let mut normals = self.normals_of_triangles(positions);
        for ((now, rest), own) in normals.iter_mut().zip(&self.rest_normals).zip(&self.surface.normals) {
            if *own != [0.0; 3] {
                *now = Quat::between_vectors(*rest, *now).rotate_vector(Vec3::from(*own));
            }
        }
        normals
    }

    fn normals_of_triangles(&self, positions: &[[f32; 3]]) -> Vec<Vec3> {
        let mut normals = vec![vec3(0.0, 0.0, 0.0); positions.len()];
        for &corners in &self.surface.triangles {
            let [a, b] = edges(positions, corners);
            let normal = a.cross(b);
            corners.iter().for_each(|&v| normals[self.same[v as usize] as usize] += normal);
        }
        for v in 0..normals.len() {
            normals[v] = normals[self.same[v] as usize];
        }
        for normal in &mut normals {
            let length = normal.magnitude();
            *normal = if length > 0.0 { *normal / length } else { Vec3::unit_z() };
        }
        normals
    }

    /// (vertices) how far each has gone from rest [m].
    pub fn displacement(&self, positions: &[[f32; 3]]) -> Vec<f32> {
        let rest = self.surface.rest_positions.iter();
        rest.zip(positions).map(|(&rest, &now)| (Vec3::from(now) - Vec3::from(rest)).magnitude()).collect()
    }

    /// (vertices) largest stretch or squeeze along the surface, |λ − 1| with λ a principal stretch: 0 at rest and under
    /// any rigid motion; mean over the triangles around a vertex, weighted by rest area.
    pub fn strain(&self, positions: &[[f32; 3]]) -> Vec<f32> {
        let mut strain = vec![0.0; positions.len()];
        for (&corners, rest) in self.surface.triangles.iter().zip(&self.triangles) {
            let weighted = rest.area * rest.strain(edges(positions, corners));
            corners.iter().for_each(|&v| strain[v as usize] += weighted);
        }
        strain.iter().zip(&self.area).map(|(sum, area)| if *area > 0.0 { sum / area } else { 0.0 }).collect()
    }

    /// Mean length of an edge at rest [m].
    pub fn edge(&self) -> f32 {
        let edges = self.surface.triangles.iter().map(|&c| edges(&self.surface.rest_positions, c)[0].magnitude());
        edges.sum::<f32>() / self.triangles.len().max(1) as f32
    }
}

fn edges(positions: &[[f32; 3]], corners: [u32; 3]) -> [Vec3; 2] {
    let [a, b, c] = corners.map(|v| Vec3::from(positions[v as usize]));
    [b - a, c - a]
}

impl RestTriangle {
    fn new([first, second]: [Vec3; 2]) -> Self {
        let length = first.magnitude();
        let area = 0.5 * first.cross(second).magnitude();
        if area <= 1e-6 * (length * length + second.magnitude2()) {
            return Self { area: 0.0, inverse: [0.0; 3] };
        }
        let (x, y) = (second.dot(first) / length, 2.0 * area / length);
        Self { area, inverse: [1.0 / length, -x / (length * y), 1.0 / y] }
    }

    fn strain(&self, [first, second]: [Vec3; 2]) -> f32 {
        if self.area == 0.0 {
            return 0.0;
        }
        // F = [first second] · inverse (3, 2), C = FᵀF; the stretches are the roots of C's eigenvalues.
        let along = first * self.inverse[0];
        let across = first * self.inverse[1] + second * self.inverse[2];
        let (xx, xy, yy) = (along.magnitude2(), along.dot(across), across.magnitude2());
        let (middle, spread) = (0.5 * (xx + yy), (0.25 * (xx - yy) * (xx - yy) + xy * xy).sqrt());
        let stretch = |eigenvalue: f32| (eigenvalue.max(0.0).sqrt() - 1.0).abs();
        stretch(middle + spread).max(stretch(middle - spread))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn tetrahedron() -> Deformation {
        let triangles = vec![[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]];
        let rest = vec![[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
        Deformation::new(&Arc::new(Surface::new(0, triangles, rest, 1e-4).unwrap()))
    }

    fn moved(by: impl Fn([f32; 3]) -> [f32; 3]) -> Vec<[f32; 3]> {
        tetrahedron().surface.rest_positions.iter().map(|&x| by(x)).collect()
    }

    #[test]
    fn rigid_motion_has_no_strain_but_a_displacement() {
        let turned = moved(|[x, y, z]| [-y + 3.0, x, z]);
        let deformation = tetrahedron();
        assert!(deformation.strain(&turned).iter().all(|s| *s < 1e-6));
        let displacement = deformation.displacement(&turned);
        assert!((displacement[0] - 3.0).abs() < 1e-6 && (displacement[1] - 5f32.sqrt()).abs() < 1e-6);
    }

    #[test]
    fn strain_is_the_stretch_or_the_squeeze_that_was_done() {
        for factor in [1.2, 0.7] {
            let strain = tetrahedron().strain(&moved(|x| x.map(|c| factor * c)));
            assert!(strain.iter().all(|s| (s - (factor - 1.0f32).abs()).abs() < 1e-5), "{strain:?}");
        }
        // Sheared by 2 ε along the surface, the principal stretches are 1 ± ε; of the triangles around the first vertex
        // only one of three lies in the plane of shear, and one leans over by 2 ε, which stretches nothing to first order.
        let strain = 3.0 * tetrahedron().strain(&moved(|[x, y, z]| [x + 0.02 * y, y, z]))[0];
        assert!((strain - 0.01).abs() < 5e-4, "{strain}");
    }

    #[test]
    fn normals_point_out_of_the_body() {
        let deformation = tetrahedron();
        let positions = &deformation.surface.rest_positions;
        let centre = vec3(0.25, 0.25, 0.25);
        for (normal, &position) in deformation.normals(positions).iter().zip(positions) {
            assert!((normal.magnitude() - 1.0).abs() < 1e-6);
            assert!(normal.dot(Vec3::from(position) - centre) > 0.0);
        }
    }

    #[test]
    fn a_seam_of_texture_coordinates_is_smooth_and_own_normals_turn_with_the_surface() {
        // Two triangles that meet at an edge of 90°, whose ends stand twice.
        let rest = vec![[0.0; 3], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0; 3], [0.0, 1.0, 0.0], [0.0, 0.0, -1.0]];
        let triangles = vec![[0, 1, 2], [3, 5, 4]];
        let mut surface = Surface::new(0, triangles, rest, 1e-4).unwrap();
        let normals =
            |surface: &Surface, positions: &[[f32; 3]]| Deformation::new(&Arc::new(surface.clone())).normals(positions);
        let rest = surface.rest_positions.clone();
        assert!(
            normals(&surface, &rest)[0].dot(normals(&surface, &rest)[3]).abs() < 1e-6,
            "an edge without a seam is sharp"
        );
        surface.uvs = vec![[0.0; 2]; 6];
        let smooth = normals(&surface, &rest);
        assert!(smooth[0] == smooth[3] && smooth[1] == smooth[4] && smooth[0].magnitude() - 1.0 < 1e-6);
        surface.normals = vec![[0.0, 0.0, 1.0]; 6];
        surface.normals[5] = [0.0; 3];
        assert!(normals(&surface, &rest)[0].dot(Vec3::unit_z()) > 1.0 - 1e-6);
        let turned: Vec<[f32; 3]> = rest.iter().map(|[x, y, z]| [*z, *y, -x]).collect();
        let now = normals(&surface, &turned);
        assert!(now[0].dot(Vec3::unit_x()) > 1.0 - 1e-5, "{:?}", now[0]);
    }

    #[test]
    fn a_triangle_without_area_counts_nowhere() {
        let mut surface = (*tetrahedron().surface).clone();
        surface.triangles.push([0, 1, 1]);
        let deformation = Deformation::new(&Arc::new(surface));
        let strain = deformation.strain(&moved(|x| x.map(|c| 1.5 * c)));
        assert!(strain.iter().all(|s| (s - 0.5).abs() < 1e-5), "{strain:?}");
    }
}
