//! OFF files, as text.

use super::cells::Cells;
use super::mesh_error::{MeshError, shown};
use super::reader::Reader;

/// Vertices and faces of an OFF file; normals, colours and texture coordinates beside them are about looks.
pub(super) fn parse_off(bytes: &[u8]) -> Result<Cells, MeshError> {
    let mut file = Reader::text("OFF", bytes, Some(b'#'));
    let mut cells = Cells { indexed: true, ..Cells::default() };
    let name = file.peek();
    // The name may be left out. Letters before it tell what comes after the three coordinates, 4 and n that there are others.
    if let Some(before) = name.strip_suffix(b"OFF") {
        if before.contains(&b'4') || before.contains(&b'n') {
            let what = format!("an OFF file of more than three dimensions ({})", shown(name));
            return Err(MeshError::Unsupported { what, remedy: "export it with three coordinates a vertex" });
        }
        file.name();
        if file.peek() == b"BINARY" {
            let what = "a binary OFF file".to_owned();
            return Err(MeshError::Unsupported { what, remedy: "export it as text" });
        }
    } else if !name.first().is_some_and(u8::is_ascii_digit) {
        return Err(file.wrong(format!("expected OFF or the number of vertices, found '{}'", shown(name))));
    }
    let [vertices, faces]: [i64; 2] = [file.word()?, file.word()?];
    // The number of edges, which nobody needs.
    file.line();
    for _ in 0..vertices {
        cells.points.push([file.word()?, file.word()?, file.word()?]);
        file.line();
    }
    let mut corners = Vec::new();
    for number in 1..=faces {
        corners.clear();
        for _ in 0..file.word::<i64>()? {
            corners.push(cells.index("face", number, file.word()?, 0)?);
        }
        cells.polygon(&corners)?;
        file.line();
    }
    if !file.peek().is_empty() {
        let what = format!("'{}' after the last face: it holds more than its header says", shown(file.peek()));
        return Err(file.wrong(what));
    }
    Ok(cells)
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;
    use crate::geometry::mesh_io::{LengthUnit, parse_surface};
    use palpate_core::geometry::Surface;
    use palpate_core::geometry::primitives::box_surface;
    use palpate_core::math::Vec3;
    use std::fmt::Write;
    use std::path::Path;

    fn read(text: &str) -> Result<Surface, MeshError> {
        parse_surface(Path::new("a.OFF"), text.as_bytes(), LengthUnit::Metre)
    }

    pub(in crate::geometry) fn off(surface: &Surface) -> String {
        let mut text = format!("OFF # a box\n{} {} 0\n\n", surface.vertices.len(), surface.triangles.len());
        surface.vertices.iter().for_each(|v| writeln!(text, "{} {} {}", v.x, v.y, v.z).unwrap());
        surface.triangles.iter().for_each(|[a, b, c]| writeln!(text, "3 {a} {b} {c}").unwrap());
        text
    }

    #[test]
    fn a_box_comes_back_from_off_with_and_without_what_is_about_looks() {
        let cube = box_surface(Vec3::new(0.1, 0.2, 0.3), [2, 1, 3]);
        let text = off(&cube);
        let coloured: String = text
            .replace("OFF # a box\n", "COFF ")
            .lines()
            .map(|line| if line.starts_with("3 ") { format!("{line} 9 9 9\n") } else { format!("{line} 1 0 0 1\n") })
            .collect();
        for text in [text.clone(), text.replace("OFF # a box\n", ""), coloured.replace("\n 1 0 0 1", "")] {
            assert_eq!(read(&text).unwrap(), cube, "{text}");
        }
    }

    #[test]
    fn an_off_file_that_cannot_be_used_says_where_and_why() {
        let text = off(&box_surface(Vec3::repeat(1.0), [1; 3]));
        let says = |text: &str, expected: &str| {
            let message = read(text).unwrap_err().to_string();
            assert!(message.contains(expected), "{message}");
        };
        says("solid a", "line 1: expected OFF or the number of vertices, found 'solid'");
        says(&text.replace("OFF #", "4OFF #"), "more than three dimensions");
        says(&text.replace("OFF #", "OFF BINARY #"), "a binary OFF file cannot be read: export it as text");
        says(&text.replace("8 12 0", "8 13 0"), "it ends where a number is expected");
        says(&text.replace("8 12 0", "8 11 0"), "line 23: '3' after the last face");
        says(&text.replace("\n0 0 0\n", "\n0,5 0 0\n"), "line 4: '0,5' has a decimal comma");
        says(&text.replacen("\n3 0", "\n3 8", 1), "refers to vertex 8");
    }
}
