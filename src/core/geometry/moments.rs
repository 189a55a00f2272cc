//! Volume, centre and second moments of shapes: what a body's mass, centre of mass and inertia follow from.

use super::{Surface, TetMesh};
use crate::math::{Mat3, Real, Vec3};
use serde::{Deserialize, Serialize};

/// Moments of a solid or of a set of points.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Moments {
    /// Volume [m³], or sum of the weights.
    pub volume: Real,
    /// Centre [m].
    pub centre: Vec3,
    /// Second moments about the centre, `∫ (x−c)(x−c)ᵀ` [m⁵].
    pub second: Mat3,
}

impl Moments {
    /// Of the solid that `surface` encloses, exactly.
    pub fn of_surface(surface: &Surface) -> Self {
        // Tetrahedra from the first vertex to each triangle; those outside count negative.
        let origin = surface.vertices.first().copied().unwrap_or_default();
        let tetrahedra = (0..surface.triangles.len()).map(|t| {
            let [a, b, c] = surface.corners(t);
            ([origin, a, b, c], 1.0)
        });
        Self::of_tetrahedra(tetrahedra)
    }

    /// Of a mesh of which each element counts by its part in `fraction`, (n_elements).
    pub fn of_mesh(mesh: &TetMesh, fraction: &[Real]) -> Self {
        Self::of_tetrahedra((0..mesh.elements.len()).map(|e| (mesh.corners(e), fraction[e])))
    }

    /// Of `points` [m] with `weights`, (n_points).
    pub fn of_points(points: &[Vec3], weights: &[Real]) -> Self {
        let volume = weights.iter().sum::<Real>();
        let centre = points.iter().zip(weights).map(|(x, w)| x * *w).sum::<Vec3>() / volume;
        let about = |x: &Vec3| (x - centre) * (x - centre).transpose();
        Self { volume, centre, second: points.iter().zip(weights).map(|(x, w)| about(x) * *w).sum() }
    }

    /// Of several together, each counted so many times.
    pub fn combined(parts: &[(Moments, Real)]) -> Self {
        let volume = parts.iter().map(|(m, times)| m.volume * times).sum::<Real>();
        let centre = parts.iter().map(|(m, times)| m.centre * (m.volume * times)).sum::<Vec3>() / volume;
        let about = |(m, times): &(Moments, Real)| {
            let away = m.centre - centre;
            (m.second + away * away.transpose() * m.volume) * *times
        };
        Self { volume, centre, second: parts.iter().map(about).sum() }
    }

    fn of_tetrahedra(tetrahedra: impl Iterator<Item = ([Vec3; 4], Real)>) -> Self {
        let (mut volume, mut first, mut second) = (0.0, Vec3::zeros(), Mat3::zeros());
        let mut origin = None;
        for (corners, part) in tetrahedra {
            // About a point of the body, so that a body far from the origin loses no digits.
            let origin = *origin.get_or_insert(corners[0]);
            let u = corners.map(|u| u - origin);
            let v = part * super::tet_mesh::volume(&u);
            let sum: Vec3 = u.iter().sum();
            volume += v;
            first += sum * (v / 4.0);
            second += (u.iter().map(|u| u * u.transpose()).sum::<Mat3>() + sum * sum.transpose()) * (v / 20.0);
        }
        let centre = first / volume;
        let second = second - centre * centre.transpose() * volume;
        Self { volume, centre: centre + origin.unwrap_or_default(), second }
    }

    /// Radius of gyration about the centre [m].
    pub fn radius(&self) -> Real {
        (self.second.trace() / self.volume).sqrt()
    }

    /// How far the inertia per mass is from that of `other` where they differ most, over the largest of `other`'s
    /// principal moments; negative for less.
    pub fn inertia_error(&self, other: &Moments) -> Real {
        let inertia = |m: &Moments| (Mat3::identity() * m.second.trace() - m.second) / m.volume;
        let (a, b) = (inertia(self), inertia(other));
        let difference = (a - b).symmetric_eigenvalues();
        difference[difference.iamax()] / b.symmetric_eigenvalues().amax()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::primitives::{box_mesh, box_surface};

    #[test]
    fn a_box_far_away_has_the_moments_of_the_textbook() {
        let (size, away) = (Vec3::new(0.1, 0.2, 0.3), Vec3::new(5.0, -3.0, 2.0));
        let mut surface = box_surface(size, [2, 1, 3]);
        surface.vertices.iter_mut().for_each(|v| *v += away);
        let mut mesh = box_mesh(size, [2, 1, 3]);
        mesh.nodes.iter_mut().for_each(|v| *v += away);
        let volume = 0.1 * 0.2 * 0.3;
        for moments in [Moments::of_surface(&surface), Moments::of_mesh(&mesh, &vec![1.0; mesh.elements.len()])] {
            assert!((moments.volume - volume).abs() < 1e-15);
            assert!((moments.centre - away - size / 2.0).norm() < 1e-13);
            let textbook = Mat3::from_diagonal(&size.component_mul(&size)) * (volume / 12.0);
            assert!((moments.second - textbook).norm() < 1e-14, "{}", moments.second);
        }
        let points = Moments::of_points(&[Vec3::x(), -Vec3::x()], &[1.0, 3.0]);
        assert_eq!((points.volume, points.centre, points.radius()), (4.0, -Vec3::x() / 2.0, (3.0f64 / 4.0).sqrt()));
    }
}
