//! Medit's text files (`.mesh`), as INRIA's and Mmg's tools write them.

use super::cells::Cells;
use super::mesh_error::{MeshError, shown};
use super::reader::Reader;
use palpate_core::math::Real;

/// How names of sections that hold a part of the body begin.
const SHAPES: [&[u8]; 6] = [b"Triangles", b"Quadrilaterals", b"Tetrahedra", b"Hexahedra", b"Prisms", b"Pyramids"];

/// Vertices, triangles, quadrangles and tetrahedra of a Medit file; the triangles count where there are no tetrahedra.
pub(super) fn parse_medit(bytes: &[u8]) -> Result<Cells, MeshError> {
    let mut file = Reader::text("Medit", bytes, Some(b'#'));
    let mut cells = Cells { indexed: true, ..Cells::default() };
    if file.name() != b"MeshVersionFormatted" {
        return Err(file.wrong("it does not begin with MeshVersionFormatted; of Medit's files the text ones are read"));
    }
    file.word::<i64>()?;
    let mut references = Vec::new();
    loop {
        let name = file.name();
        match name {
            b"" | b"End" => {
                if !cells.tetrahedra.is_empty() {
                    cells.label("reference", references.into_iter());
                }
                return Ok(cells);
            }
            b"Dimension" => match file.word::<i64>()? {
                3 => {}
                other => return Err(file.wrong(format!("{other} dimensions instead of 3"))),
            },
            b"Vertices" => {
                for _ in 0..file.word::<i64>()? {
                    cells.points.push([file.word()?, file.word()?, file.word()?]);
                    file.word::<Real>()?;
                }
            }
            b"Triangles" => polygons::<3>(&mut file, &mut cells, "triangle")?,
            b"Quadrilaterals" => polygons::<4>(&mut file, &mut cells, "quadrangle")?,
            b"Tetrahedra" => {
                for number in 1..=file.word::<i64>()? {
                    let (corners, reference) = corners::<4>(&mut file, &cells, "element", number)?;
                    cells.tetrahedra.push((number, corners));
                    references.push(reference);
                }
            }
            // Those of higher order, too.
            _ if SHAPES.iter().any(|shape| name.starts_with(shape)) => {
                return Err(MeshError::Unsupported {
                    what: format!("a Medit file with {}", shown(name)),
                    remedy: "mesh the body with tetrahedra of 4 nodes (first order)",
                });
            }
            // Edges, normals and the like are numbers up to the next name.
            _ if name[0].is_ascii_alphabetic() => {
                while file.peek().first().is_some_and(|b| !b.is_ascii_alphabetic()) {
                    file.name();
                }
            }
            _ => return Err(file.wrong(format!("expected the name of a section, found '{}'", shown(name)))),
        }
    }
}

fn polygons<const N: usize>(file: &mut Reader, cells: &mut Cells, cell: &'static str) -> Result<(), MeshError> {
    for number in 1..=file.word::<i64>()? {
        let (corners, _) = corners::<N>(file, cells, cell, number)?;
        cells.polygon(&corners)?;
    }
    Ok(())
}

/// Points of a cell, and its reference.
fn corners<const N: usize>(
    file: &mut Reader,
    cells: &Cells,
    cell: &'static str,
    number: i64,
) -> Result<([u32; N], Real), MeshError> {
    let mut corners = [0; N];
    for corner in &mut corners {
        *corner = cells.index(cell, number, file.word()?, 1)?;
    }
    Ok((corners, file.word()?))
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;
    use crate::geometry::mesh_io::{LengthUnit, parse_surface, parse_tet_mesh};
    use palpate_core::geometry::primitives::{box_mesh, box_surface};
    use palpate_core::geometry::{Surface, TetMesh};
    use palpate_core::math::Vec3;
    use std::fmt::Write;
    use std::path::Path;

    pub(in crate::geometry) fn medit<const N: usize>(points: &[Vec3], name: &str, cells: &[[u32; N]]) -> String {
        let mut text = format!("MeshVersionFormatted 2 # a box\n\nDimension\n3\nVertices {}\n", points.len());
        points.iter().for_each(|p| writeln!(text, "{} {} {} 0", p.x, p.y, p.z).unwrap());
        text += "Corners 2\n1 2\nEdges\n1\n1 2 0\n";
        writeln!(text, "{name}\n{}", cells.len()).unwrap();
        for cell in cells {
            cell.iter().for_each(|n| write!(text, "{} ", n + 1).unwrap());
            writeln!(text, "7").unwrap();
        }
        text + "End\n"
    }

    fn volume(text: &str) -> Result<TetMesh, MeshError> {
        parse_tet_mesh(Path::new("a.mesh"), text.as_bytes(), LengthUnit::Metre)
    }

    #[test]
    fn boxes_come_back_from_medit() {
        let mesh = box_mesh(Vec3::new(0.1, 0.2, 0.3), [2, 1, 2]);
        assert_eq!(volume(&medit(&mesh.nodes, "Tetrahedra", &mesh.elements)).unwrap(), mesh);
        let cube: Surface = box_surface(Vec3::new(0.1, 0.2, 0.3), [2, 1, 2]);
        let text = medit(&cube.vertices, "Triangles", &cube.triangles);
        assert_eq!(parse_surface(Path::new("a.mesh"), text.as_bytes(), LengthUnit::Metre).unwrap(), cube);
    }

    #[test]
    fn a_medit_file_that_cannot_be_used_says_where_and_why() {
        let mesh = box_mesh(Vec3::repeat(1.0), [1; 3]);
        let text = medit(&mesh.nodes, "Tetrahedra", &mesh.elements);
        let says = |text: String, expected: &str| {
            let message = volume(&text).unwrap_err().to_string();
            assert!(message.contains(expected), "{message}");
        };
        says("\u{1}\0\0\0".into(), "does not begin with MeshVersionFormatted");
        says(text.replace("Dimension\n3", "Dimension\n2"), "line 4: 2 dimensions");
        says(text.replace("Tetrahedra", "Hexahedra"), "a Medit file with Hexahedra cannot be read");
        says(text.replace("Tetrahedra", "TetrahedraP2"), "a Medit file with TetrahedraP2 cannot be read");
        says(text.replace("Vertices 8", "Vertices 9"), "line 14: 'Corners' is no number");
        says(text.replace("Tetrahedra\n6", "Tetrahedra\n7"), "'End' is no number");
        says(text.replace("Tetrahedra\n6", "Tetrahedra\n5"), "expected the name of a section");
        says(text.replace("Tetrahedra\n6\n1 ", "Tetrahedra\n6\n0 "), "element 1 refers to vertex 0");
    }
}
