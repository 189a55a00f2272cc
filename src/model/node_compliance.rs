//! How far each node of a body gives way alone: what a mesh shows of the dent under a point load depends on it.

use super::body::Body;
use crate::math::{Mat3, Real, Vec3};

/// For each node of all levels, `n·K⁻¹n` [m/N]: how far it moves along the surface's normal `n` for a newton along it while all
/// others are held, `K` being its own block of the level's stiffness at rest. Nodes that carry no part of the displayed
/// surface move alike in all directions, on average; fixed ones do not move.
pub(super) fn node_compliance(body: &Body) -> Vec<Real> {
    let outward = normals(body);
    let stiffness = blocks(body);
    let along = |(n, (k, outward)): (usize, (&Mat3, &Vec3))| {
        let (Some(inverse), false) = (k.try_inverse(), body.is_fixed(n as u32)) else { return 0.0 };
        let length = outward.norm();
        if length > 0.0 { outward.dot(&(inverse * outward)) / (length * length) } else { inverse.trace() / 3.0 }
    };
    stiffness.iter().zip(&outward).enumerate().map(along).collect()
}

/// Sum of what hangs on each node of the surface's area vectors [m²].
fn normals(body: &Body) -> Vec<Vec3> {
    let surface = body.surface();
    let mut of_vertex = vec![Vec3::zeros(); surface.vertices.len()];
    for triangle in &surface.triangles {
        let [a, b, c] = triangle.map(|v| surface.vertices[v as usize]);
        triangle.iter().for_each(|v| of_vertex[*v as usize] += (b - a).cross(&(c - a)));
    }
    let mut normals = vec![Vec3::zeros(); body.node_count()];
    for r in 0..body.levels().len() {
        for (v, outward) in of_vertex.iter().enumerate() {
            let Some(host) = body.embedding(r, v as u32) else { continue };
            for (n, w) in body.element(host.element).iter().zip(host.weights) {
                normals[*n as usize] += outward * w.max(0.0);
            }
        }
    }
    normals
}

/// Each node's own block of the stiffness of its level at rest [N/m]: `Σ V (μ |g|² I + (λ + μ) g gᵀ)` over its elements.
fn blocks(body: &Body) -> Vec<Mat3> {
    let mut blocks = vec![Mat3::zeros(); body.node_count()];
    for e in 0..body.element_count() as u32 {
        let (corners, material) = (body.corners(e), body.material_of(e));
        let weight = body.volume(e) * body.stiffness_factor(e);
        let cross = opposite_faces(&corners);
        let six_volumes = (corners[1] - corners[0]).cross(&(corners[2] - corners[0])).dot(&(corners[3] - corners[0]));
        for (n, cross) in body.element(e).iter().zip(cross) {
            let g = cross / six_volumes;
            let shear = Mat3::identity() * (material.mu * g.norm_squared());
            blocks[*n as usize] += (shear + g * g.transpose() * (material.lambda + material.mu)) * weight;
        }
    }
    blocks
}

/// The area vectors of a tetrahedron's faces, twice their area long [m²], each by the corner opposite.
fn opposite_faces(u: &[Vec3; 4]) -> [Vec3; 4] {
    let face = |a: usize, b: usize, c: usize| (u[b] - u[a]).cross(&(u[c] - u[a]));
    [face(1, 3, 2), face(0, 2, 3), face(0, 3, 1), face(0, 1, 2)]
}

/// `V Σ|g|²` [m] of the tetrahedron of these corners, `g` the gradients of its four weights.
pub(super) fn element_width(corners: [Vec3; 4]) -> Real {
    let volume = (corners[1] - corners[0]).cross(&(corners[2] - corners[0])).dot(&(corners[3] - corners[0])) / 6.0;
    opposite_faces(&corners).iter().map(Vec3::norm_squared).sum::<Real>() / (36.0 * volume)
}
