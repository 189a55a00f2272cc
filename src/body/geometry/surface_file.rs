//! Surface files: the triangles in OBJ and STL files, as listed there.

use super::cells::Cells;
use super::mesh_error::{MeshError, shown};
use super::reader::{Reader, no_number};
use super::text::plain;
use palpate_core::math::Real;

/// Lines of a text file, numbered from 1, cut into words.
fn lines(text: &str) -> impl Iterator<Item = (usize, std::str::SplitWhitespace<'_>)> {
    text.lines().enumerate().map(|(i, line)| (i + 1, line.split_whitespace()))
}

/// The next three words as coordinates.
fn coordinates<'a>(words: &mut impl Iterator<Item = &'a str>) -> Result<[Real; 3], String> {
    let mut next = || {
        let word = words.next().ok_or("a vertex needs three numbers")?;
        word.parse().map_err(|_| format!("a vertex needs three numbers: {}", no_number(word.as_bytes())))
    };
    Ok([next()?, next()?, next()?])
}

/// The text of an OBJ file without comments, and lines that a backslash continues on one line. Lines after these keep their
/// numbers.
fn joined_lines(text: &str) -> String {
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

/// Words of OBJ files that put more into a body than their faces do.
const MORE_SHAPES: [&str; 6] = ["surf", "bzp", "bsp", "cdc", "cdp", "call"];

/// Positions and faces of an OBJ file; everything else in it is about looks, but for curved surfaces, which are refused.
pub(super) fn parse_obj(bytes: &[u8]) -> Result<Cells, MeshError> {
    let wrong = |line, what: String| MeshError::Syntax { format: "OBJ", line: Some(line), what };
    let text = joined_lines(&String::from_utf8_lossy(bytes));
    let mut cells = Cells { indexed: true, ..Cells::default() };
    for (line, mut words) in lines(&text).filter(|(_, words)| words.clone().next() == Some("v")) {
        let position = coordinates(&mut words.by_ref().skip(1));
        cells.points.push(position.map_err(|what| wrong(line, what))?);
    }
    let mut vertices_so_far = 0;
    let mut corners = Vec::new();
    for (line, mut words) in lines(&text) {
        match words.next() {
            Some("v") => vertices_so_far += 1,
            Some("f" | "fo") => {
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
            Some(word) if MORE_SHAPES.contains(&word) => {
                let what = format!("'{word}' in an OBJ file (line {line})");
                return Err(MeshError::Unsupported { what, remedy: "export it as polygons, in one file" });
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
    let text = plain(bytes);
    let points: Vec<_> = match announced.and_then(|n| records.get(..n)) {
        Some(records) => records.iter().flat_map(binary_stl_triangle).collect(),
        None if text.trim_ascii_start().get(..5).is_some_and(|word| word.eq_ignore_ascii_case(b"solid")) => {
            text_stl_vertices(&text)?
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

/// Corners of the facets of a text file, word by word: how they are put on lines does not matter.
fn text_stl_vertices(bytes: &[u8]) -> Result<Vec<[Real; 3]>, MeshError> {
    let mut file = Reader::text("STL", bytes, None);
    let mut vertices = Vec::new();
    let mut facet = None;
    loop {
        let mut word = file.name().to_ascii_lowercase();
        // Some write "end solid" in two words.
        if word == b"end" {
            word.extend(file.name().to_ascii_lowercase());
        }
        match word.as_slice() {
            b"" if facet.is_some() => return Err(file.wrong("the file ends within a facet")),
            b"" => return Ok(vertices),
            // A name comes after it, up to the end of the line or to the first facet.
            b"solid" | b"endsolid" if facet.is_none() => {
                let (start, line) = (file.at, file.line().to_ascii_lowercase());
                if let Some(first) = line.windows(12).position(|words| words == b"facet normal") {
                    file.at = start;
                    file.skip_space();
                    file.at += first;
                }
            }
            b"facet" => facet = Some(vertices.len()),
            b"normal" => (0..3).for_each(|_| _ = file.name()),
            b"outer" | b"loop" | b"endloop" => {}
            b"vertex" if facet.is_some() => vertices.push([file.word()?, file.word()?, file.word()?]),
            b"endfacet" if facet.take().is_none_or(|first| vertices.len() - first != 3) => {
                return Err(file.wrong("a facet needs three vertices"));
            }
            b"endfacet" => {}
            other => {
                return Err(file.wrong(format!("expected a facet, a vertex or endsolid, found '{}'", shown(other))));
            }
        }
    }
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
    fn a_text_stl_is_read_however_its_words_are_put_on_lines() {
        let text = text_stl(&cube(), " a part");
        for file in [
            text.replace("endsolid", "end solid").replace("endfacet", "end facet").replace("endloop", "end loop"),
            text.split_whitespace().collect::<Vec<_>>().join(" "),
            text.split_whitespace().collect::<Vec<_>>().join("\n").replacen("solid\na\npart", "solid a part", 1),
            text.replace('\n', "\r"),
        ] {
            let read = stl(file.as_bytes()).unwrap();
            assert_eq!((read.vertices.len(), read.triangles.len()), (8, 12), "{file}");
        }
        let says = |text: String, expected: &str| {
            let message = stl(text.as_bytes()).unwrap_err().to_string();
            assert!(message.contains(expected), "{message}");
        };
        says(
            text.replacen("endloop\n", "endloop\nfast\n", 1),
            "line 8: expected a facet, a vertex or endsolid, found 'fast'",
        );
        says(text.replacen("   vertex 0e0 0 0\n", "", 1), "a facet needs three vertices");
        says(text.replacen("vertex 0e0 0 0", "vertex 0,5 0 0", 1), "'0,5' has a decimal comma");
        says(text.replace("endfacet\nendsolid", ""), "the file ends within a facet");
    }

    #[test]
    fn an_obj_file_in_two_bytes_a_letter_is_read_and_a_decimal_comma_and_curved_surfaces_are_named() {
        let wide: Vec<u8> =
            [0xff, 0xfe].into_iter().chain(CUBE_OBJ.encode_utf16().flat_map(u16::to_le_bytes)).collect();
        let read = parse_surface(Path::new("a.obj"), &wide, LengthUnit::Metre).unwrap();
        assert_eq!(read, obj(CUBE_OBJ).unwrap());
        let says = |text: String, expected: &str| {
            let message = obj(&text).unwrap_err().to_string();
            assert!(message.contains(expected), "{message}");
        };
        says(
            CUBE_OBJ.replace("v 1 1 0", "v 1,25 1,0 0,0"),
            "line 5: a vertex needs three numbers: '1,25' has a decimal comma",
        );
        says(format!("{CUBE_OBJ}surf 0 1 0 1 1 2 3 4\n"), "'surf' in an OBJ file (line 22) cannot be read");
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
