//! What makes shapes fit for use: closed surfaces, positive tetrahedra, no point that nothing refers to.

use super::mesh_error::MeshError;
use palpate_core::geometry::surface::keep_referenced;
use palpate_core::geometry::tet_mesh::volume;
use palpate_core::geometry::{Surface, TetMesh};
use palpate_core::math::{Bounds, Real, Vec3};
use std::collections::HashMap;

/// Coordinates beyond this [m] are taken for damage or a wrong unit.
const MAX_COORDINATE: Real = 1e6;
/// Smallest volume of a tetrahedron over its longest edge cubed, and of a surface over its extent cubed; rounding alone
/// reaches 1e-15.
const FLAT: Real = 1e-12;

/// Refuses numbers that are none, infinite or absurd.
pub(super) fn check_finite(vertices: &[Vec3]) -> Result<(), MeshError> {
    let fits = |p: &Vec3| p.iter().all(|c| c.abs() <= MAX_COORDINATE);
    vertices.iter().position(|p| !fits(p)).map_or(Ok(()), |v| Err(MeshError::NonFinite { vertex: v + 1 }))
}

/// One vertex per place, no triangle with two corners at one place, no vertex without a triangle.
pub(super) fn weld(vertices: &[Vec3], triangles: &[[u32; 3]]) -> Surface {
    let mut first_at = HashMap::new();
    let mut welded = Vec::new();
    let joined: Vec<u32> = vertices
        .iter()
        .map(|p| {
            // Adding zero turns −0 into 0: one place, two bit patterns.
            let bits: [u64; 3] = std::array::from_fn(|i| (p[i] + 0.0).to_bits());
            *first_at.entry(bits).or_insert_with(|| {
                welded.push(*p);
                welded.len() as u32 - 1
            })
        })
        .collect();
    let mut triangles: Vec<[u32; 3]> = triangles.iter().map(|t| t.map(|v| joined[v as usize])).collect();
    triangles.retain(|&[a, b, c]| a != b && b != c && c != a);
    let vertices = keep_referenced(&welded, &mut triangles);
    Surface { vertices, triangles }
}

/// A side of a triangle: its edge, the lower vertex first, and whether it runs that way.
type Side = ([u32; 2], bool);

/// Checks that `surface` encloses a body: every edge belongs to exactly two triangles that face the same side. When
/// the triangles face inward on the whole (negative volume), all are turned.
///
/// Several bodies, hollow bodies (the cavity faces inward) and handles pass, also bodies that touch in a vertex.
/// Self-intersection is not looked for.
///
/// # Errors
/// `Empty`, `BadIndex`, `NonFinite`, `NonManifold` (also for a triangle that has one vertex twice), `NotClosed`,
/// `InconsistentOrientation` or `NoVolume`; the surface is then unchanged.
pub fn check_closed(surface: &mut Surface) -> Result<(), MeshError> {
    if surface.triangles.is_empty() {
        return Err(MeshError::Empty { what: "triangles" });
    }
    let count = surface.vertices.len();
    for (t, triangle) in surface.triangles.iter().enumerate() {
        if let Some(&v) = triangle.iter().find(|&&v| v as usize >= count) {
            return Err(MeshError::BadIndex { cell: "triangle", number: t as i64 + 1, index: i64::from(v) + 1 });
        }
    }
    check_finite(&surface.vertices)?;

    let mut sides: Vec<Side> = surface
        .triangles
        .iter()
        .flat_map(|&[a, b, c]| [[a, b], [b, c], [c, a]])
        .map(|[a, b]| ([a.min(b), a.max(b)], a < b))
        .collect();
    sides.sort_unstable();
    // How many edges are wrong in one way, and the ends of the first.
    let find = |is_wrong: fn(&[Side]) -> bool| {
        let mut wrong = sides.chunk_by(|a, b| a.0 == b.0).filter(|edge| is_wrong(edge));
        wrong.next().map(|edge| (1 + wrong.count(), edge[0].0.map(|v| surface.vertices[v as usize])))
    };
    if let Some((edges, [from, to])) = find(|edge| edge.len() > 2 || edge[0].0[0] == edge[0].0[1]) {
        return Err(MeshError::NonManifold { edges, from, to });
    }
    if let Some((border_edges, [from, to])) = find(|edge| edge.len() == 1) {
        return Err(MeshError::NotClosed { border_edges, from, to });
    }
    if let Some((edges, [from, to])) = find(|edge| edge[0].1 == edge[1].1) {
        return Err(MeshError::InconsistentOrientation { edges, from, to });
    }

    let volume = surface.volume();
    let Bounds { low, high } = surface.bounds();
    let size = (high - low).norm();
    if volume.abs() <= FLAT * size * size * size {
        return Err(MeshError::NoVolume { volume });
    }
    if volume < 0.0 {
        surface.triangles.iter_mut().for_each(|t| t.swap(1, 2));
    }
    Ok(())
}

/// Makes all tetrahedra positive when all are negative, and says how many it turned; names the flat and the inverted ones otherwise by their
/// `numbers` in the file, (n_elements).
pub(super) fn orient(mesh: &mut TetMesh, numbers: &[i64]) -> Result<usize, MeshError> {
    if mesh.elements.is_empty() {
        return Err(MeshError::Empty { what: "tetrahedra" });
    }
    let total = mesh.elements.len();
    let mut inverted = Vec::new();
    for (e, &element) in numbers.iter().enumerate() {
        let u = mesh.corners(e);
        let volume = volume(&u);
        let at = (u[0] + u[1] + u[2] + u[3]) / 4.0;
        let edges = (0..4).flat_map(|i| (0..i).map(move |j| (u[i] - u[j]).norm()));
        let longest = edges.fold(0.0, Real::max);
        if volume.abs() <= FLAT * longest * longest * longest {
            return Err(MeshError::Degenerate { element, volume, at });
        }
        if volume < 0.0 {
            inverted.push((element, volume, at));
        }
    }
    let count = inverted.len();
    match inverted.first() {
        Some(&(element, volume, at)) if count < total => Err(MeshError::Inverted { element, volume, at, count, total }),
        _ => {
            mesh.elements.iter_mut().take(count).for_each(|element| element.swap(2, 3));
            Ok(count)
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::msh::tests::{msh, msh_1, msh_2};
    use super::super::reader::Encoding;
    use super::super::surface_file::tests::{CUBE_OBJ, cube, obj, stl, text_stl};
    use super::*;
    use palpate_core::geometry::primitives::box_mesh;

    #[test]
    fn a_surface_turned_inside_out_is_turned_back() {
        let inward = CUBE_OBJ.lines().map(|line| match line.strip_prefix("f ") {
            Some(face) => format!("f {}\n", face.split(' ').rev().collect::<Vec<_>>().join(" ")),
            None => format!("{line}\n"),
        });
        assert!((obj(&inward.collect::<String>()).unwrap().volume() - 1.0).abs() < 1e-15);
    }

    #[test]
    fn minus_zero_and_zero_are_one_place() {
        let file = text_stl(&cube(), "").replacen("vertex 0e0 0 0\n", "vertex -0e0 -0 0\n", 1);
        assert!(file.contains("-0"));
        assert_eq!(stl(file.as_bytes()).unwrap().vertices.len(), 8);
    }

    #[test]
    fn a_hole_is_refused_with_its_place() {
        let open = CUBE_OBJ.replace("f 4 1 5 8\n", "");
        match obj(&open) {
            Err(MeshError::NotClosed { border_edges: 4, from, to }) => assert_eq!((from.x, to.x), (0.0, 0.0)),
            other => panic!("{other:?}"),
        }
    }

    #[test]
    fn an_inner_wall_and_a_sheet_are_refused_and_a_turned_face_is_turned_back() {
        assert!(matches!(obj(&format!("{CUBE_OBJ}f 1 2 7\n")), Err(MeshError::NonManifold { edges: 2, .. })));
        assert!((obj(&format!("{CUBE_OBJ}f 1 2 6\n")).unwrap().volume() - 1.0).abs() < 1e-15, "listed twice");
        let turned = CUBE_OBJ.replace("f 2 3 7 6", "f 6 7 3 2");
        assert!((obj(&turned).unwrap().volume() - 1.0).abs() < 1e-15, "turned back");
        let sheet = "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\nf 3 2 1\n";
        assert!(matches!(obj(sheet), Err(MeshError::NoVolume { .. })));
        assert!(matches!(obj("v 0 0 0\n"), Err(MeshError::Empty { what: "triangles" })));
    }

    #[test]
    fn indices_out_of_range_and_a_turned_triangle_are_refused_where_nothing_is_repaired() {
        let mut surface = cube();
        surface.triangles[3][1] = 8;
        let expected = MeshError::BadIndex { cell: "triangle", number: 4, index: 9 };
        assert_eq!(check_closed(&mut surface).unwrap_err().to_string(), expected.to_string());
        let mut surface = cube();
        surface.triangles[3].swap(1, 2);
        let found = check_closed(&mut surface);
        assert!(matches!(found, Err(MeshError::InconsistentOrientation { edges: 3, .. })), "{found:?}");
    }

    #[test]
    fn an_inverted_tetrahedron_is_refused_by_its_number_and_a_mirrored_mesh_is_turned() {
        let mesh = box_mesh(Vec3::repeat(1.0), [1, 1, 1]);
        let mut one = mesh.clone();
        one.elements[4].swap(0, 1);
        match msh(&msh_2(&one, Encoding::Text)) {
            Err(MeshError::Inverted { element: 6, count: 1, total: 6, volume, .. }) => assert_eq!(volume, -1.0 / 6.0),
            other => panic!("{other:?}"),
        }
        let mut all = mesh.clone();
        all.elements.iter_mut().for_each(|e| e.swap(2, 3));
        assert_eq!(msh(&msh_1(&all)).unwrap(), mesh);
        one.elements[4] = [0, 1, 2, 3];
        assert!(matches!(msh(&msh_1(&one)), Err(MeshError::Degenerate { element: 6, .. })));
    }
}
