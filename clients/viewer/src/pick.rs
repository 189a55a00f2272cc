//! What of the organ is under the pointer.

use three_d::{InnerSpace, Vec3};

/// Where a line of sight meets the surface first.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Hit {
    /// On the surface [m].
    pub point: Vec3,
    /// Out of the body there, unit: between the normals of the triangle's corners.
    pub normal: Vec3,
}

/// The first triangle that faces the line from `eye` along the unit vector `sight`.
pub fn pick(eye: Vec3, sight: Vec3, positions: &[[f32; 3]], triangles: &[[u32; 3]], normals: &[Vec3]) -> Option<Hit> {
    let mut nearest: Option<(f32, Hit)> = None;
    for corners in triangles {
        let [a, b, c] = corners.map(|v| Vec3::from(positions[v as usize]));
        let (first, second) = (b - a, c - a);
        let across = sight.cross(second);
        let volume = first.dot(across);
        // Seen from behind, or edge on.
        if volume <= 1e-12 * second.magnitude() * first.magnitude() {
            continue;
        }
        let from = eye - a;
        let along_first = from.dot(across) / volume;
        let turned = from.cross(first);
        let along_second = sight.dot(turned) / volume;
        let distance = second.dot(turned) / volume;
        let inside = along_first >= 0.0 && along_second >= 0.0 && along_first + along_second <= 1.0;
        if inside && distance > 0.0 && nearest.is_none_or(|(best, _)| distance < best) {
            let [na, nb, nc] = corners.map(|v| normals[v as usize]);
            let normal = (na + along_first * (nb - na) + along_second * (nc - na)).normalize();
            nearest = Some((distance, Hit { point: eye + distance * sight, normal }));
        }
    }
    nearest.map(|(_, hit)| hit)
}

#[cfg(test)]
mod tests {
    use super::*;
    use three_d::vec3;

    #[test]
    fn the_nearest_triangle_that_faces_the_eye_is_picked() {
        // Two parallel triangles that face +z, and one between them that faces −z.
        let at = |z: f32| [[0.0, 0.0, z], [1.0, 0.0, z], [0.0, 1.0, z]];
        let positions: Vec<[f32; 3]> = [at(0.0), at(1.0), at(2.0)].concat();
        let triangles = [[0, 1, 2], [3, 4, 5], [6, 8, 7]];
        let normals = vec![Vec3::unit_z(); 9];
        let down = |x: f32, y: f32| pick(vec3(x, y, 5.0), -Vec3::unit_z(), &positions, &triangles, &normals);
        let hit = down(0.2, 0.3).unwrap();
        assert!((hit.point - vec3(0.2, 0.3, 1.0)).magnitude() < 1e-6, "{hit:?}");
        assert_eq!(hit.normal, Vec3::unit_z());
        assert_eq!(down(0.7, 0.7), None);
        assert_eq!(pick(vec3(0.2, 0.3, 0.5), Vec3::unit_z(), &positions, &triangles, &normals).unwrap().point.z, 2.0);
    }
}
