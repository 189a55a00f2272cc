//! TetGen's text files: nodes in a `.node` file, tetrahedra in the `.ele` file beside it.

use super::cells::Cells;
use super::mesh_error::MeshError;
use super::reader::Reader;

/// The next line with words on it; empty at the end of the file.
fn row<'a>(file: &mut Reader<'a>) -> (Reader<'a>, Vec<&'a [u8]>) {
    file.skip_space();
    let start = Reader { at: file.at, ..*file };
    let line = file.line();
    let content = line.split(|b| *b == b'#').next().unwrap_or_default();
    (start, content.split(u8::is_ascii_whitespace).filter(|word| !word.is_empty()).collect())
}

/// The numbers of a header, of which the last may be left out: those are `usual`.
fn header<'a, const N: usize>(file: &mut Reader<'a>, usual: [i64; N]) -> Result<(Reader<'a>, [i64; N]), MeshError> {
    let (start, words) = row(file);
    let (mut line, mut numbers) = (Reader { ..start }, usual);
    for number in numbers.iter_mut().take(words.len().max(1)) {
        *number = line.word()?;
    }
    Ok((start, numbers))
}

/// Nodes and tetrahedra, whose first attribute is their label; those of nodes are left out.
pub(super) fn parse_tetgen(node: &[u8], ele: &[u8]) -> Result<Cells, MeshError> {
    let mut cells = Cells { indexed: true, ..Cells::default() };
    let mut file = Reader::text("TetGen .node", node, Some(b'#'));
    let (start, [count, dimension, _, _]) = header(&mut file, [0, 3, 0, 0])?;
    if dimension != 3 {
        return Err(start.wrong(format!("{dimension} dimensions instead of 3")));
    }
    let mut first = 0;
    for i in 0..count {
        // Attributes and markers come after the coordinates.
        let (mut line, words) = row(&mut file);
        let number: i64 = line.word()?;
        if i == 0 {
            first = number;
        }
        if number.checked_sub(first) != Some(i) {
            return Err(line.wrong(format!("node {number} is out of order")));
        }
        if words.len() < 4 {
            return Err(line.wrong("a node needs its number and three coordinates"));
        }
        cells.points.push([line.word()?, line.word()?, line.word()?]);
    }
    let mut file = Reader::text("TetGen .ele", ele, Some(b'#'));
    // Some writers leave out how many attributes there are.
    let (start, [count, corners, mut attributes]) = header(&mut file, [0, 4, -1])?;
    if corners != 4 {
        return Err(start.wrong(format!("tetrahedra of {corners} nodes: mesh the body with those of 4 (without -o2)")));
    }
    let mut first_attributes = Vec::new();
    for i in 0..count {
        let (mut line, words) = row(&mut file);
        if (1..5).contains(&words.len()) {
            return Err(line.wrong("an element needs its number and four nodes"));
        }
        let [number, a, b, c, d]: [i64; 5] = [line.word()?, line.word()?, line.word()?, line.word()?, line.word()?];
        let index = |index: i64| cells.index("element", number, index, first);
        let corners = [index(a)?, index(b)?, index(c)?, index(d)?];
        cells.tetrahedra.push((number, corners));
        let found = words.len() as i64 - 5;
        if i == 0 && attributes < 0 {
            attributes = found;
        }
        if found != attributes {
            return Err(line.wrong(format!("{found} attributes where {attributes} are announced")));
        }
        if attributes > 0 {
            first_attributes.push(line.word()?);
        }
    }
    if attributes > 0 {
        cells.label("attribute", first_attributes.into_iter());
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
    fn headers_may_leave_out_what_is_usual_and_labels_are_found_without_them() {
        let mesh = box_mesh(Vec3::new(0.1, 0.2, 0.3), [1; 3]);
        let (node, ele) = tetgen(&mesh, 1);
        let cells =
            parse_tetgen(node.replace("8 3 1 1", "8 3").as_bytes(), ele.replace("6 4 1", "6").as_bytes()).unwrap();
        assert_eq!((cells.points.len(), &cells.labels[0].of[..]), (8, &[7; 6][..]));
        assert_eq!(cells.points, mesh.nodes.iter().map(|p| (*p).into()).collect::<Vec<[f64; 3]>>());
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
        says(
            &node.replace(" 0.5 1 # here", "").replacen("1 0 0 0\n", "1 0 0\n", 1),
            &ele,
            "line 3: a node needs its number",
        );
        says(&node, &ele.replacen(" 7\n", "\n", 1), ".ele file, line 3: 0 attributes where 1 are announced");
        says(&node, &ele.replace(" 7\n", " seven\n"), ".ele file, line 3: 'seven' is no number");
    }
}
