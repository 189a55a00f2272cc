//! Tetrahedra as files list them, put together to a mesh with labels.

use super::cells::Cells;
use super::labels::{LabelledMesh, Labels};
use super::mesh_error::MeshError;
use super::pieces::Groups;
use super::repair::{Repairs, joined, rounding};
use super::soundness::orient;
use palpate_core::geometry::TetMesh;
use palpate_core::geometry::surface::keep_referenced;
use palpate_core::geometry::tet_mesh::FACES;
use palpate_core::math::{Bounds, Vec3};
use std::collections::{HashMap, HashSet};

/// The mesh of the tetrahedra of `cells`, whose points lie at `points` [m], with the labels called `wanted` and its fibres, and what of it
/// was repaired or left out.
pub(super) fn volume(
    points: Vec<Vec3>,
    cells: Cells,
    wanted: Option<&str>,
) -> Result<(LabelledMesh, Repairs), MeshError> {
    let mut repairs = Repairs { left_out: cells.left_out, notes: cells.notes, ..Repairs::default() };
    let left = cells.triangles.len() - faces_among(&cells.triangles, &cells.tetrahedra);
    if left > 0 {
        repairs.left_out.push(format!("{left} triangles that are no faces of its tetrahedra"));
    }
    let names: Vec<String> = cells.labels.iter().map(|labels| format!("'{}'", labels.name)).collect();
    let mut labels = Labels::choose(cells.labels, wanted)?;
    match names.len() {
        0 => repairs.notes.push("labels: none in the file".into()),
        1 => {}
        _ if labels.of.is_empty() => {
            repairs.notes.push(format!("labels: none taken of {}: name one with --labels", names.join(", ")));
        }
        _ => repairs.notes.push(format!("labels: '{}' of {}; --labels takes others", labels.name, names.join(", "))),
    }
    let label_of = std::mem::take(&mut labels.of);
    let direction_of = cells.directions.map(|(name, of)| {
        repairs.notes.push(format!("directions of fibres: '{name}'"));
        of
    });
    let mut directions = Vec::new();
    let (mut mesh, mut numbers, mut seen) = (TetMesh::default(), Vec::new(), HashMap::new());
    let mut differ = 0;
    for (i, (number, element)) in cells.tetrahedra.into_iter().enumerate() {
        let mut key = element;
        key.sort_unstable();
        let label = label_of.get(i).copied();
        match seen.entry(key) {
            std::collections::hash_map::Entry::Vacant(entry) => {
                entry.insert(label);
                labels.of.extend(label);
                let direction = direction_of.as_ref().map(|of| of[i].try_normalize(0.0).unwrap_or_default());
                directions.extend(direction);
                numbers.push(number);
                mesh.elements.push(element);
            }
            std::collections::hash_map::Entry::Occupied(entry) => {
                repairs.dropped += 1;
                differ += usize::from(*entry.get() != label);
            }
        }
    }
    if differ > 0 {
        repairs.notes.push(format!("{differ} tetrahedra are listed again with another label: the first counts"));
    }
    mesh.nodes = keep_referenced(&points, &mut mesh.elements);
    repairs.joined = join_pieces(&mut mesh);
    repairs.turned = orient(&mut mesh, &numbers)?;
    Ok((LabelledMesh { mesh, labels, directions }, repairs))
}

/// How many of `triangles` are faces of `tetrahedra`.
fn faces_among(triangles: &[[u32; 3]], tetrahedra: &[(i64, [u32; 4])]) -> usize {
    let sorted = |mut face: [u32; 3]| {
        face.sort_unstable();
        face
    };
    if triangles.is_empty() {
        return 0;
    }
    let faces: HashSet<[u32; 3]> =
        tetrahedra.iter().flat_map(|(_, t)| FACES.map(|face| sorted(face.map(|corner| t[corner])))).collect();
    triangles.iter().filter(|t| faces.contains(&sorted(**t))).count()
}

/// Merges nodes that lie within rounding of another of a piece that does not hang together with theirs; how many. Within a
/// piece, nodes at one place are a cut that somebody has made.
fn join_pieces(mesh: &mut TetMesh) -> usize {
    let mut groups = Groups::new(mesh.nodes.len());
    for [a, rest @ ..] in &mesh.elements {
        rest.iter().for_each(|n| _ = groups.join(*a, *n));
    }
    let piece: Vec<u32> = (0..mesh.nodes.len() as u32).map(|n| groups.of(n)).collect();
    if piece.iter().all(|p| *p == piece[0]) {
        return 0;
    }
    let all: Vec<u32> = (0..mesh.nodes.len() as u32).collect();
    let number = joined(&mesh.nodes, &all, rounding(Bounds::of(mesh.nodes.iter().copied())));
    let other = |n: u32| piece[number[n as usize] as usize] != piece[n as usize];
    mesh.elements.iter_mut().flatten().filter(|n| other(**n)).for_each(|n| *n = number[*n as usize]);
    let before = mesh.nodes.len();
    mesh.nodes = keep_referenced(&mesh.nodes, &mut mesh.elements);
    before - mesh.nodes.len()
}

#[cfg(test)]
mod tests {
    use super::*;
    use palpate_core::geometry::primitives::box_mesh;

    fn cells(elements: &[[u32; 4]]) -> Cells {
        Cells { tetrahedra: (1..).zip(elements.iter().copied()).collect(), indexed: true, ..Cells::default() }
    }

    #[test]
    fn pieces_whose_nodes_lie_within_rounding_of_each_other_are_one_and_a_cut_stays() {
        let half = box_mesh(Vec3::repeat(0.1), [2; 3]);
        let count = half.nodes.len() as u32;
        let beside = half.nodes.iter().map(|p| p + Vec3::new(0.1 + 1e-9, 0.0, 0.0));
        let points: Vec<Vec3> = half.nodes.iter().copied().chain(beside).collect();
        let both: Vec<[u32; 4]> =
            half.elements.iter().copied().chain(half.elements.iter().map(|e| e.map(|n| n + count))).collect();
        let (mesh, repairs) = volume(points.clone(), cells(&both), None).unwrap();
        assert_eq!((repairs.joined, mesh.mesh.nodes.len()), (9, 45));
        // Tied together at one corner, they are one piece that is cut.
        let at = |p: Vec3| points.iter().position(|q| (q - p).norm() < 1e-12).unwrap() as u32;
        let (from, to) = (at(Vec3::new(0.1 + 1e-9, 0.0, 0.0)), at(Vec3::new(0.1, 0.0, 0.0)));
        let tied: Vec<[u32; 4]> = both.iter().map(|e| e.map(|n| if n == from { to } else { n })).collect();
        assert_eq!(volume(points, cells(&tied), None).unwrap().1.joined, 0);
    }

    #[test]
    fn a_report_says_what_labels_there_are_and_which_triangles_are_left_out() {
        let mesh = box_mesh(Vec3::repeat(0.1), [1; 3]);
        let (_, repairs) = volume(mesh.nodes.clone(), cells(&mesh.elements), None).unwrap();
        assert_eq!(repairs.notes, ["labels: none in the file"]);
        let mut listed = cells(&mesh.elements);
        // A side of the box is cut along 0-3, not along 1-2.
        listed.triangles = vec![[1, 2, 0], mesh.boundary()[0]];
        listed.label("id", (1..=6).map(f64::from));
        listed.label("order", (0..6).map(f64::from));
        listed.label("material", (0..6).map(|n| f64::from(n) / 2.0));
        let (_, repairs) = volume(mesh.nodes.clone(), listed, None).unwrap();
        assert_eq!(repairs.notes, ["labels: none taken of 'id', 'order': name one with --labels"]);
        assert!(repairs.left_out[0].contains("'material', which is no label: not all its numbers are whole"));
        assert_eq!(repairs.left_out.last().unwrap(), "1 triangles that are no faces of its tetrahedra");
    }
}
