//! TetGen's text files: nodes in a `.node` file, tetrahedra in the `.ele` file beside it.

use super::cells::Cells;
use super::labels::Labels;
use super::mesh_error::MeshError;
use super::reader::Reader;
use palpate_core::math::Real;

/// Nodes and tetrahedra, whose first attribute is their label; those of nodes are left out.
pub(super) fn parse_tetgen(node: &[u8], ele: &[u8]) -> Result<Cells, MeshError> {
    let mut cells = Cells { indexed: true, ..Cells::default() };
    let mut file = Reader::text("TetGen .node", node, Some(b'#'));
    let [count, dimension, attributes, markers]: [i64; 4] = [file.word()?, file.word()?, file.word()?, file.word()?];
    if dimension != 3 {
        return Err(file.wrong(format!("{dimension} dimensions instead of 3")));
    }
    let mut first = 0;
    for i in 0..count {
        let number: i64 = file.word()?;
        if i == 0 {
            first = number;
        }
        if number.checked_sub(first) != Some(i) {
            return Err(file.wrong(format!("node {number} is out of order")));
        }
        cells.points.push([file.word()?, file.word()?, file.word()?]);
        for _ in 0..attributes.saturating_add(markers) {
            file.word::<Real>()?;
        }
    }
    let mut file = Reader::text("TetGen .ele", ele, Some(b'#'));
    let [count, corners, attributes]: [i64; 3] = [file.word()?, file.word()?, file.word()?];
    if corners != 4 {
        return Err(file.wrong(format!("tetrahedra of {corners} nodes: mesh the body with those of 4 (without -o2)")));
    }
    let mut first_attributes = Vec::new();
    for _ in 0..count {
        let [number, a, b, c, d]: [i64; 5] = [file.word()?, file.word()?, file.word()?, file.word()?, file.word()?];
        let index = |index: i64| cells.index("element", number, index, first);
        let corners = [index(a)?, index(b)?, index(c)?, index(d)?];
        cells.tetrahedra.push((number, corners));
        for attribute in 0..attributes {
            let value: Real = file.word()?;
            if attribute == 0 {
                first_attributes.push(value);
            }
        }
    }
    if attributes > 0 {
        cells.labels.extend(Labels::from_numbers("attribute", first_attributes.into_iter()));
    }
    Ok(cells)
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;
    use crate::geometry::mesh_io::{LengthUnit, read_tet_mesh};
    use palpate_core::geometry::TetMesh;
    use palpate_core::geometry::primitives::box_mesh;
    use palpate_core::math::Vec3;
    use std::fmt::Write;

    pub(in crate::geometry) fn tetgen(mesh: &TetMesh, first: usize) -> (String, String) {
        let mut node = format!("# a box\n{} 3 1 1\n", mesh.nodes.len());
        for (i, p) in mesh.nodes.iter().enumerate() {
            writeln!(node, "  {} {} {} {} 0.5 1 # here", i + first, p.x, p.y, p.z).unwrap();
        }
        let mut ele = format!("{} 4 1\n\n", mesh.elements.len());
        for (i, e) in mesh.elements.iter().enumerate() {
            let [a, b, c, d] = e.map(|n| n as usize + first);
            writeln!(ele, "{} {a} {b} {c} {d} 7", i + first).unwrap();
        }
        (node, ele)
    }

    #[test]
    fn a_box_comes_back_from_tetgen_by_either_of_its_files() {
        let mesh = box_mesh(Vec3::new(0.1, 0.2, 0.3), [2, 1, 2]);
        for first in [0, 1] {
            let folder = tempfile::tempdir().unwrap();
            let (node, ele) = tetgen(&mesh, first);
            std::fs::write(folder.path().join("a.node"), node).unwrap();
            let absent = read_tet_mesh(&folder.path().join("a.node"), LengthUnit::Metre).unwrap_err().to_string();
            assert!(absent.contains("a.ele"), "{absent}");
            std::fs::write(folder.path().join("a.ele"), ele).unwrap();
            for name in ["a.node", "a.ele"] {
                assert_eq!(read_tet_mesh(&folder.path().join(name), LengthUnit::Metre).unwrap(), mesh);
            }
        }
    }

    #[test]
    fn a_tetgen_file_that_cannot_be_used_says_where_and_why() {
        let (node, ele) = tetgen(&box_mesh(Vec3::repeat(1.0), [1; 3]), 1);
        let says = |node: &str, ele: &str, expected: &str| {
            let message = parse_tetgen(node.as_bytes(), ele.as_bytes()).unwrap_err().to_string();
            assert!(message.contains(expected), "{message}");
        };
        says(&node.replace("8 3 1 1", "8 2 1 1"), &ele, ".node file, line 2: 2 dimensions");
        says(&node.replace("  2 ", "  3 "), &ele, ".node file, line 4: node 3 is out of order");
        says(&node.replace("8 3 1 1", "9 3 1 1"), &ele, "cut off");
        says(&node, &ele.replace("6 4 1", "6 10 1"), ".ele file, line 1: tetrahedra of 10 nodes");
        says(&node, &ele.replace("\n1 1 ", "\n1 9 "), "element 1 refers to vertex 9");
        says(&node, &ele.replace(" 7\n", " seven\n"), ".ele file, line 3: 'seven' is no number");
    }
}
