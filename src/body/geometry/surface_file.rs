//! Surface files: the triangles in OBJ and STL files, as listed there.

use super::cells::Cells;
use super::mesh_error::{MeshError, shown};
use palpate_core::math::Real;

/// Lines of a text file, numbered from 1, cut into words.
fn lines(text: &str) -> impl Iterator<Item = (usize, std::str::SplitWhitespace<'_>)> {
    text.lines().enumerate().map(|(i, line)| (i + 1, line.split_whitespace()))
}

/// The next three words as coordinates.
fn coordinates<'a>(words: &mut impl Iterator<Item = &'a str>) -> Option<[Real; 3]> {
    let mut next = || words.next()?.parse().ok();
    Some([next()?, next()?, next()?])
}

/// The text of an OBJ file without comments, and lines that a backslash continues on one line. Lines after these keep their
/// numbers.
fn plain(text: &str) -> String {
    let (mut plain, mut breaks) = (String::with_capacity(text.len()), 1);
    for line in text.lines() {
        let line = line.split('#').next().unwrap_or_default().trim_end();
        let (content, goes_on) = line.strip_suffix('\\').map_or((line, false), |content| (content, true));
        plain += content;
        if goes_on {
            plain.push(' ');
            breaks += 1;
        } else {
            plain.extend(std::iter::repeat_n('\n', std::mem::replace(&mut breaks, 1)));
        }
    }
    plain
}

/// Positions and faces of an OBJ file; everything else in it is about looks.
pub(super) fn parse_obj(bytes: &[u8]) -> Result<Cells, MeshError> {
    let wrong = |line, what: String| MeshError::Syntax { format: "OBJ", line: Some(line), what };
    let text = plain(&String::from_utf8_lossy(bytes));
    let mut cells = Cells { indexed: true, ..Cells::default() };
    for (line, mut words) in lines(&text).filter(|(_, words)| words.clone().next() == Some("v")) {
        let position = coordinates(&mut words.by_ref().skip(1));
        cells.points.push(position.ok_or_else(|| wrong(line, "a vertex needs three numbers".into()))?);
    }
    let mut vertices_so_far = 0;
    let mut corners = Vec::new();
    for (line, mut words) in lines(&text) {
        match words.next() {
            Some("v") => vertices_so_far += 1,
            Some("f") => {
                corners.clear();
                for word in words {
                    // "7/2/5" is vertex 7 with texture 2 and normal 5; "-1" is the vertex defined last.
                    let number: Option<i64> = word.split('/').next().and_then(|v| v.parse().ok());
                    let number = number
                        .ok_or_else(|| wrong(line, format!("'{}' is no corner of a face", shown(word.as_bytes()))))?;
                    let index = if number < 0 { number.saturating_add(vertices_so_far) } else { number - 1 };
                    if index < 0 || index >= cells.points.len() as i64 {
                        let count = cells.points.len();
                        return Err(wrong(line, format!("the face refers to vertex {number}, the file has {count}")));
                    }
                    corners.push(index as u32);
                }
                if corners.is_empty() {
                    return Err(wrong(line, "a face without corners".into()));
                }
                cells.polygon(&corners)?;
            }
            _ => {}
        }
    }
    Ok(cells)
}

/// The triangles of an STL file, three vertices each.
///
/// The length tells binary from text, because binary headers, too, may begin with "solid". A text file never passes
/// for binary: four printable characters, read as a count, announce more triangles than fit in [`MAX_FILE`](super::mesh_io::MAX_FILE).
pub(super) fn parse_stl(bytes: &[u8]) -> Result<Cells, MeshError> {
    let announced = bytes.get(80..84).and_then(|b| b.first_chunk()).map(|b| u32::from_le_bytes(*b) as usize);
    let (records, _) = bytes.get(84..).unwrap_or_default().as_chunks::<50>();
    let points: Vec<_> = match announced.and_then(|n| records.get(..n)) {
        Some(records) => records.iter().flat_map(binary_stl_triangle).collect(),
        None if bytes.trim_ascii_start().get(..5).is_some_and(|word| word.eq_ignore_ascii_case(b"solid")) => {
            text_stl_vertices(bytes)?
        }
        None => {
            let what = match announced {
                Some(n) => format!("{n} triangles are announced, {} are there: the file was cut off", records.len()),
                None => "neither a binary header nor the word 'solid' is at its beginning".to_owned(),
            };
            return Err(MeshError::Syntax { format: "STL", line: None, what });
        }
    };
    let triangles = (0..points.len() as u32 / 3).map(|t| [3 * t, 3 * t + 1, 3 * t + 2]).collect();
    Ok(Cells { points, triangles, ..Cells::default() })
}

/// Three corners from a record: normal, corners (each three f32, little-endian), two bytes of attributes.
fn binary_stl_triangle(record: &[u8; 50]) -> [[Real; 3]; 3] {
    let number = |i: usize| Real::from(f32::from_le_bytes(std::array::from_fn(|b| record[4 * i + b])));
    std::array::from_fn(|corner| std::array::from_fn(|axis| number(3 + 3 * corner + axis)))
}

fn text_stl_vertices(bytes: &[u8]) -> Result<Vec<[Real; 3]>, MeshError> {
    let wrong = |line, what: &str| MeshError::Syntax { format: "STL", line: Some(line), what: what.to_owned() };
    let text = String::from_utf8_lossy(bytes);
    let mut vertices = Vec::new();
    let mut last_line = 0;
    for (line, mut words) in lines(&text) {
        last_line = line;
        let Some(word) = words.next() else { continue };
        match word.to_ascii_lowercase().as_str() {
            "vertex" => {
                vertices.push(coordinates(&mut words).ok_or_else(|| wrong(line, "a vertex needs three numbers"))?);
            }
            "endfacet" | "endsolid" if vertices.len() % 3 != 0 => {
                return Err(wrong(line, "a facet needs three vertices"));
            }
            "solid" | "facet" | "outer" | "endloop" | "endfacet" | "endsolid" => {}
            _ => return Err(wrong(line, "expected a facet, a vertex or endsolid")),
        }
    }
    if vertices.len() % 3 != 0 {
        return Err(wrong(last_line, "the file ends within a facet"));
    }
    Ok(vertices)
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;
    use crate::geometry::mesh_io::{LengthUnit, parse_surface};
    use crate::geometry::primitives::liver_surface;
    use palpate_core::geometry::Surface;
    use palpate_core::geometry::primitives::box_surface;
    use palpate_core::math::Vec3;
    use std::fmt::Write;
    use std::path::Path;

    pub(in crate::geometry) const CUBE_OBJ: &str = "mtllib nowhere.mtl\no cube\n\
        v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nv 0 0 1\nv 1 0 1\nv 1 1 1\nv 0 1 1\nvt 0 0\nvn 0 0 1\n\
        usemtl skin\ns off\nf 4/1/1 3/1/1 2/1/1 1/1/1\nf 5//1 6//1 7//1 8//1\n\
        g sides\nf -8 -7 -3 -4\nf 2 3 7 6\nf 3 4 8 7\nf 4 1 5 8\n";

    pub(in crate::geometry) fn obj(text: &str) -> Result<Surface, MeshError> {
        parse_surface(Path::new("a.obj"), text.as_bytes(), LengthUnit::Metre)
    }

    pub(in crate::geometry) fn stl(bytes: &[u8]) -> Result<Surface, MeshError> {
        parse_surface(Path::new("a.STL"), bytes, LengthUnit::Metre)
    }

    pub(in crate::geometry) fn cube() -> Surface {
        box_surface(Vec3::repeat(1.0), [1, 1, 1])
    }

    pub(in crate::geometry) fn text_stl(surface: &Surface, name: &str) -> String {
        let mut text = format!("solid{name}\n");
        for t in 0..surface.triangles.len() {
            text += " facet normal 0 0 0\n  outer loop\n";
            for p in surface.corners(t) {
                writeln!(text, "   vertex {:e} {} {}", p.x, p.y, p.z).unwrap();
            }
            text += "  endloop\n endfacet\n";
        }
        text + "endsolid\n"
    }

    pub(in crate::geometry) fn binary_stl(surface: &Surface, header: &[u8]) -> Vec<u8> {
        let mut bytes = header.to_vec();
        bytes.resize(80, 0);
        bytes.extend((surface.triangles.len() as u32).to_le_bytes());
        for t in 0..surface.triangles.len() {
            let numbers = [Vec3::zeros()].into_iter().chain(surface.corners(t));
            bytes.extend(numbers.flat_map(|p| [p.x, p.y, p.z]).flat_map(|c| (c as f32).to_le_bytes()));
            bytes.extend([0, 0]);
        }
        bytes
    }

    #[test]
    fn an_obj_cube_of_quadrangles_with_textures_and_groups_is_a_unit_cube() {
        let surface = obj(CUBE_OBJ).unwrap();
        assert_eq!((surface.vertices.len(), surface.triangles.len()), (8, 12));
        assert!((surface.volume() - 1.0).abs() < 1e-15);
        let in_inches = parse_surface(Path::new("a.OBJ"), CUBE_OBJ.as_bytes(), LengthUnit::Inch).unwrap();
        assert!((in_inches.volume() / 0.0254f64.powi(3) - 1.0).abs() < 1e-12);
    }

    #[test]
    fn an_obj_file_may_have_comments_continued_lines_and_a_mark_of_its_encoding() {
        let odd = CUBE_OBJ.replace("v 1 1 0", "v 1 \\\n 1 0 # a corner").replace('\n', "\r\n");
        assert_eq!(obj(&format!("\u{feff}{odd}")).unwrap(), obj(CUBE_OBJ).unwrap());
        let wrong = obj(&odd.replacen("\r\nf ", "\r\nv 1 x\r\nf ", 1)).unwrap_err().to_string();
        let line = 1 + odd.lines().position(|line| line.starts_with("f ")).unwrap();
        assert!(wrong.contains(&format!("line {line}:")), "{wrong}");
    }

    #[test]
    fn a_box_comes_back_from_text_and_binary_stl() {
        let (cube, liver) = (cube(), liver_surface(0.008));
        for file in [
            text_stl(&cube, "").into_bytes(),
            text_stl(&cube, " named").to_uppercase().replace('\n', "\r\n").into_bytes(),
            binary_stl(&cube, b"made by hand"),
            binary_stl(&cube, b"solid made by hand"),
        ] {
            let read = stl(&file).unwrap();
            assert_eq!((read.vertices.len(), read.triangles.len()), (8, 12));
            assert!((read.volume() - 1.0).abs() < 1e-15);
        }
        let read = stl(&binary_stl(&liver, b"")).unwrap();
        assert_eq!((read.vertices.len(), read.triangles.len()), (liver.vertices.len(), liver.triangles.len()));
        assert!((read.volume() / liver.volume() - 1.0).abs() < 1e-6);
    }

    #[test]
    fn two_solids_in_one_stl_file_are_two_bodies_of_one_surface() {
        let mut apart = cube();
        apart.vertices.iter_mut().for_each(|p| p.x += 3.0);
        let read = stl((text_stl(&cube(), " one") + &text_stl(&apart, " two")).as_bytes()).unwrap();
        assert_eq!(read.vertices.len(), 16);
        assert!((read.volume() - 2.0).abs() < 1e-14);
    }

    #[test]
    fn a_message_names_the_line_and_the_vertex() {
        let says = |text: &str, expected: &str| {
            let message = obj(text).unwrap_err().to_string();
            assert!(message.contains(expected), "{message}");
        };
        says("v 0 0 0\n\nv 0 zero 0\n", "line 3: a vertex needs three numbers");
        says("v 0 0 0\nf 1 2 1\n", "line 2: the face refers to vertex 2, the file has 1");
        says("v 0 0 0\nf 1 0 1\n", "vertex 0");
        says("v 0 0 0\nf 1 -9223372036854775808 1\n", "vertex -9223372036854775808");
        says(&CUBE_OBJ.replace("v 1 1 0", "v nan 1 0"), "vertex 3 ");
        says(&CUBE_OBJ.replace("v 1 1 0", "v 1e300 1 0"), "beyond 1000 km");
        let cut = stl(&binary_stl(&cube(), b"")[..200]).unwrap_err().to_string();
        assert!(cut.contains("12 triangles are announced, 2 are there"), "{cut}");
    }
}
