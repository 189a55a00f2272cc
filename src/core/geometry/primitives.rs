//! Boxes on a grid.
//!
//! Only `+ − × ÷ √` in f64 decide where a vertex lies, so a shape is the same on every x86-64 machine.

use super::surface::keep_referenced;
use super::tet_mesh::volume;
use super::{Surface, TetMesh};
use crate::math::{Real, Vec3};

/// The closed surface of a box from the origin to `size` [m], triangulated like the outside of [`box_mesh`].
pub fn box_surface(size: Vec3, cells: [u32; 3]) -> Surface {
    let mesh = box_mesh(size, cells);
    let mut triangles = mesh.boundary();
    let vertices = keep_referenced(&mesh.nodes, &mut triangles);
    Surface { vertices, triangles }
}

/// Corners two and three of the six tetrahedra of a cell, all around its diagonal from (0, 0, 0) to (1, 1, 1).
const CELL_PATTERNS: [[[u32; 3]; 2]; 6] = [
    [[0, 1, 0], [0, 1, 1]],
    [[0, 1, 0], [1, 1, 0]],
    [[1, 0, 0], [1, 1, 0]],
    [[0, 0, 1], [0, 1, 1]],
    [[1, 0, 0], [1, 0, 1]],
    [[0, 0, 1], [1, 0, 1]],
];

/// A box from the origin to `size` [m, all positive], `cells` [nx, ny, nz] along each axis (0 counts as 1), six
/// tetrahedra per cell.
///
/// Node `(k (nx+1) + i) (ny+1) + j` lies at `(i/nx, j/ny, k/nz) size`. Elements: every cell in pattern 0, then every
/// cell in pattern 1, and so on; cells run like nodes, y fastest, then x, then z.
pub fn box_mesh(size: Vec3, cells: [u32; 3]) -> TetMesh {
    let [nx, ny, nz] = cells.map(|n| n.max(1));
    let node = |i: u32, j: u32, k: u32| (k * (nx + 1) + i) * (ny + 1) + j;
    let mut mesh = TetMesh::default();
    for k in 0..=nz {
        for i in 0..=nx {
            for j in 0..=ny {
                let fraction = |i: u32, n: u32| Real::from(i) / Real::from(n);
                let p = Vec3::new(fraction(i, nx), fraction(j, ny), fraction(k, nz));
                mesh.nodes.push(p.component_mul(&size));
            }
        }
    }
    for [b, c] in CELL_PATTERNS {
        for k in 0..nz {
            for i in 0..nx {
                for j in 0..ny {
                    let corner = |[di, dj, dk]: [u32; 3]| node(i + di, j + dj, k + dk);
                    let mut element = [corner([0, 0, 0]), corner(b), corner(c), corner([1, 1, 1])];
                    if volume(&element.map(|n| mesh.nodes[n as usize])) < 0.0 {
                        element.swap(2, 3);
                    }
                    mesh.elements.push(element);
                }
            }
        }
    }
    mesh
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::tet_mesh::FACES;

    #[test]
    fn the_box_mesh_numbers_nodes_and_elements_as_documented() {
        let mesh = box_mesh(Vec3::repeat(1.0), [2, 2, 2]);
        assert_eq!(mesh.nodes.len(), 27);
        assert_eq!(mesh.elements.len(), 48);
        assert_eq!((mesh.nodes[1], mesh.nodes[3], mesh.nodes[9]), (Vec3::y() / 2.0, Vec3::x() / 2.0, Vec3::z() / 2.0));
        let expected = [
            [[0, 1, 10, 13], [1, 2, 11, 14]],
            [[0, 1, 4, 13], [1, 2, 5, 14]],
            [[0, 3, 4, 13], [1, 4, 5, 14]],
            [[0, 9, 10, 13], [1, 10, 11, 14]],
            [[0, 3, 12, 13], [1, 4, 13, 14]],
            [[0, 9, 12, 13], [1, 10, 13, 14]],
        ];
        for (pattern, first_two) in expected.iter().enumerate() {
            for (cell, nodes) in first_two.iter().enumerate() {
                let mut found = mesh.elements[8 * pattern + cell];
                found.sort_unstable();
                assert_eq!(&found, nodes, "pattern {pattern}");
            }
        }
    }

    #[test]
    fn the_tetrahedra_of_a_box_are_positive_and_fill_it() {
        let mesh = box_mesh(Vec3::repeat(1.0), [2, 2, 2]);
        assert!((0..48).all(|e| mesh.volume(e) == 1.0 / 48.0));
        assert_eq!((0..48).map(|e| mesh.volume(e) * 48.0).sum::<Real>(), 48.0);
        let bar = box_mesh(Vec3::new(0.25, 0.5, 2.0), [1, 2, 8]);
        assert_eq!(bar.elements.len(), 6 * 16);
        assert!((0..96).all(|e| bar.volume(e) > 0.0));
        assert!(((0..96).map(|e| bar.volume(e)).sum::<Real>() - 0.25).abs() < 1e-15);
    }

    #[test]
    fn neighbouring_tetrahedra_of_a_box_share_whole_faces() {
        let mesh = box_mesh(Vec3::new(0.1, 0.2, 0.3), [2, 3, 4]);
        let outer = 2 * 2 * (2 * 3 + 3 * 4 + 4 * 2);
        assert_eq!(mesh.boundary().len(), outer);
        let faces = mesh.elements.len() * FACES.len();
        assert_eq!((faces - outer) % 2, 0);
    }
}
