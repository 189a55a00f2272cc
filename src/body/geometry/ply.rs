//! PLY files: text, and binary of both byte orders.

use super::cells::Cells;
use super::mesh_error::{MeshError, shown};
use palpate_core::math::Real;
use ply_rs_bw::parser::{ParseError, Parser, Reader};
use ply_rs_bw::ply::{ElementDef, Encoding, Header, Property, PropertyAccess, PropertyAccessResult};

/// What is to be done about surfaces that are no faces.
const FACES: &str = "export it with faces, each a list vertex_indices";

/// A point; what it lacks is no number.
struct Vertex([Real; 3]);

impl PropertyAccess for Vertex {
    fn new() -> Self {
        Vertex([Real::NAN; 3])
    }

    fn set_property(&mut self, name: &str, property: Property) -> PropertyAccessResult {
        let Some(axis) = ["x", "y", "z"].iter().position(|axis| *axis == name) else {
            return PropertyAccessResult::Ignored;
        };
        self.0[axis] = match property {
            Property::Float(x) => x.into(),
            Property::Double(x) => x,
            Property::Char(x) => x.into(),
            Property::UChar(x) => x.into(),
            Property::Short(x) => x.into(),
            Property::UShort(x) => x.into(),
            Property::Int(x) => x.into(),
            Property::UInt(x) => x.into(),
            _ => return PropertyAccessResult::UnsupportedType,
        };
        PropertyAccessResult::Set
    }
}

/// Indices of the corners of a polygon, or of strips of triangles.
struct Face(Vec<i64>);

/// What lists of corners are called.
const CORNERS: [&str; 2] = ["vertex_indices", "vertex_index"];

impl PropertyAccess for Face {
    fn new() -> Self {
        Face(Vec::new())
    }

    fn set_property(&mut self, name: &str, property: Property) -> PropertyAccessResult {
        if !CORNERS.contains(&name) {
            return PropertyAccessResult::Ignored;
        }
        self.0 = match property {
            Property::ListChar(list) => list.into_iter().map(i64::from).collect(),
            Property::ListUChar(list) => list.into_iter().map(i64::from).collect(),
            Property::ListShort(list) => list.into_iter().map(i64::from).collect(),
            Property::ListUShort(list) => list.into_iter().map(i64::from).collect(),
            Property::ListInt(list) => list.into_iter().map(i64::from).collect(),
            Property::ListUInt(list) => list.into_iter().map(i64::from).collect(),
            _ => return PropertyAccessResult::UnsupportedType,
        };
        PropertyAccessResult::Set
    }
}

/// Something else that a file lists.
struct Other;

impl PropertyAccess for Other {
    fn new() -> Self {
        Other
    }
}

/// Vertices, faces and strips of triangles of a PLY file; polygons become triangles.
pub(super) fn parse_ply(bytes: &[u8]) -> Result<Cells, MeshError> {
    let mut reader = Reader::new(bytes);
    let header = Parser::<Other>::new().read_header(&mut reader).map_err(|e| wrong(&e, Encoding::Ascii))?;
    let mut cells = Cells { indexed: true, ..Cells::default() };
    let (mut faces, mut strips) = (Vec::new(), Vec::new());
    for element in header.elements.values() {
        // Of elements without properties a file could announce any number.
        if element.count > bytes.len() || (element.count > 0 && element.properties.is_empty()) {
            let what = format!(
                "{} of '{}' are announced, which do not fit in {} bytes: it was cut off or damaged",
                element.count,
                shown(element.name.as_bytes()),
                bytes.len()
            );
            return Err(MeshError::Syntax { format: "PLY", line: None, what });
        }
        let has_corners = CORNERS.iter().any(|corners| element.properties.contains_key(*corners));
        match element.name.as_str() {
            "vertex" => {
                let vertices = elements::<Vertex>(&mut reader, element, &header)?;
                cells.points.extend(vertices.into_iter().map(|v| v.0));
            }
            "face" if has_corners || element.count == 0 => {
                faces.extend(elements::<Face>(&mut reader, element, &header)?);
            }
            "tristrips" if has_corners => strips.extend(elements::<Face>(&mut reader, element, &header)?),
            "face" => {
                let what = "a PLY file whose faces have no vertex_indices".to_owned();
                return Err(MeshError::Unsupported { what, remedy: FACES });
            }
            name if has_corners => {
                let what = format!("a PLY file of '{}'", shown(name.as_bytes()));
                return Err(MeshError::Unsupported { what, remedy: FACES });
            }
            _ => drop(elements::<Other>(&mut reader, element, &header)?),
        }
    }
    for (Face(corners), number) in faces.iter().zip(1..) {
        let corners: Result<Vec<u32>, MeshError> = corners.iter().map(|c| cells.index("face", number, *c, 0)).collect();
        cells.polygon(&corners?)?;
    }
    // Of one list, −1 ends a strip.
    for strip in strips.iter().flat_map(|Face(corners)| corners.split(|corner| *corner == -1)) {
        let corners: Result<Vec<u32>, MeshError> = strip.iter().map(|c| cells.index("strip", 1, *c, 0)).collect();
        cells.strip(&corners?)?;
    }
    Ok(cells)
}

/// All elements of a kind.
fn elements<E: PropertyAccess>(
    reader: &mut Reader<&[u8]>,
    element: &ElementDef,
    header: &Header,
) -> Result<Vec<E>, MeshError> {
    Parser::<E>::new().read_payload_for_element(reader, element, header).map_err(|e| wrong(&e, header.encoding))
}

/// What the parser says, on one line and without the bytes that it could not read.
fn wrong(error: &ParseError, encoding: Encoding) -> MeshError {
    let text = error.to_string();
    let said = match error.line() {
        Some(line) => text.strip_prefix(&format!("Line {line}: ")).unwrap_or(&text),
        None => &text,
    };
    let said: String = said.split_whitespace().collect::<Vec<_>>().join(" ").chars().take(200).collect();
    // In a binary file it counts elements.
    let line = error.line().filter(|_| encoding == Encoding::Ascii);
    MeshError::Syntax { format: "PLY", line, what: said }
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

    fn ply(bytes: &[u8]) -> Result<Surface, MeshError> {
        parse_surface(Path::new("a.ply"), bytes, LengthUnit::Metre)
    }

    fn header(encoding: &str, surface: &Surface) -> String {
        format!(
            "ply\nformat {encoding} 1.0\ncomment a box\nelement vertex {}\nproperty double x\nproperty double y\n\
             property double z\nproperty uchar red\nelement face {}\nproperty list uchar int vertex_indices\nend_header\n",
            surface.vertices.len(),
            surface.triangles.len()
        )
    }

    fn text(surface: &Surface) -> String {
        let mut text = header("ascii", surface);
        surface.vertices.iter().for_each(|v| writeln!(text, "{} {} {} 9", v.x, v.y, v.z).unwrap());
        surface.triangles.iter().for_each(|[a, b, c]| writeln!(text, "3 {a} {b} {c}").unwrap());
        text
    }

    fn binary(surface: &Surface, big: bool) -> Vec<u8> {
        let mut bytes = header(if big { "binary_big_endian" } else { "binary_little_endian" }, surface).into_bytes();
        let mut put = |mut raw: Vec<u8>| {
            if big {
                raw.reverse();
            }
            bytes.extend(raw);
        };
        for v in &surface.vertices {
            v.iter().for_each(|c| put(c.to_le_bytes().to_vec()));
            put(vec![9]);
        }
        for t in &surface.triangles {
            put(vec![3]);
            t.iter().for_each(|v| put((*v as i32).to_le_bytes().to_vec()));
        }
        bytes
    }

    pub(in crate::geometry) fn every_ply(surface: &Surface) -> Vec<Vec<u8>> {
        vec![text(surface).into(), binary(surface, false), binary(surface, true)]
    }

    #[test]
    fn a_box_comes_back_from_every_encoding_of_ply() {
        let cube = box_surface(Vec3::new(0.1, 0.2, 0.3), [2, 1, 3]);
        for file in every_ply(&cube) {
            assert_eq!(ply(&file).unwrap(), cube, "{}", shown(&file[..40]));
        }
        // Quadrangles, too.
        let sides = "4 0 3 2 1\n4 4 5 6 7\n4 0 1 5 4\n4 1 2 6 5\n4 2 3 7 6\n4 3 0 4 7\n";
        let corners = "0 0 0 9\n1 0 0 9\n1 1 0 9\n0 1 0 9\n0 0 1 9\n1 0 1 9\n1 1 1 9\n0 1 1 9\n";
        let eight = Surface { vertices: vec![Vec3::zeros(); 8], triangles: vec![[0; 3]; 6] };
        let file = header("ascii", &eight) + corners + sides;
        assert!((ply(file.as_bytes()).unwrap().volume() - 1.0).abs() < 1e-15);
    }

    /// A closed surface of strips: two rows around a prism of `n` sides, and its ends, each triangle a strip.
    pub(in crate::geometry) fn prism(n: u32) -> (Surface, Vec<Vec<u32>>) {
        let ring = |z: f64| {
            (0..n).map(move |i| {
                let angle = std::f64::consts::TAU * f64::from(i) / f64::from(n);
                Vec3::new(angle.cos(), angle.sin(), z)
            })
        };
        let vertices: Vec<Vec3> = ring(0.0).chain(ring(1.0)).chain([Vec3::zeros(), Vec3::z()]).collect();
        let mut strips = vec![(0..=n).flat_map(|i| [n + i % n, i % n]).collect::<Vec<u32>>()];
        strips.extend((0..n).map(|i| vec![2 * n, (i + 1) % n, i]));
        strips.extend((0..n).map(|i| vec![2 * n + 1, n + i, n + (i + 1) % n]));
        let triangles = strips.iter().flat_map(|strip| {
            let turned = |(i, t): (usize, &[u32])| if i % 2 == 0 { [t[0], t[1], t[2]] } else { [t[1], t[0], t[2]] };
            strip.windows(3).enumerate().map(turned)
        });
        let triangles = triangles.collect();
        (Surface { vertices, triangles }, strips)
    }

    #[test]
    fn strips_of_triangles_are_read_and_other_lists_of_corners_refused() {
        let (surface, strips) = prism(7);
        let mut listed: Vec<String> = Vec::new();
        for strip in &strips {
            listed.extend(strip.iter().map(u32::to_string));
            listed.push("-1".into());
        }
        let empty = Surface { triangles: vec![], ..surface.clone() };
        let head = header("ascii", &empty)
            .replace("element face 0\nproperty list uchar int", "element tristrips 1\nproperty list int int");
        let corners: String = surface.vertices.iter().map(|v| format!("{} {} {} 9\n", v.x, v.y, v.z)).collect();
        let file = format!("{head}{corners}{} {}\n", listed.len(), listed.join(" "));
        assert_eq!(ply(file.as_bytes()).unwrap(), surface);
        let e = ply(file.replace("tristrips", "tetra").as_bytes()).unwrap_err().to_string();
        assert!(e.contains("a PLY file of 'tetra' cannot be read"), "{e}");
        let e = ply(file.replace("tristrips", "face").replace("vertex_indices", "corners").as_bytes());
        assert!(e.unwrap_err().to_string().contains("no vertex_indices"));
    }

    #[test]
    fn a_ply_file_that_cannot_be_used_says_where_and_why() {
        let cube = box_surface(Vec3::repeat(1.0), [1; 3]);
        let says = |file: &[u8], expected: &[&str]| {
            let message = ply(file).unwrap_err().to_string();
            assert!(expected.iter().all(|e| message.contains(e)) && message.len() < 400, "{message}");
        };
        let good = text(&cube);
        says(good.replacen("\n0 0 0 9", "\n0 zero 0 9", 1).as_bytes(), &["PLY file, line 12"]);
        says(good.replace("face 12", "face 13").as_bytes(), &["PLY file, line 32", "end of file"]);
        says(good.replace("face 12", "face 99999999999").as_bytes(), &["99999999999 of 'face'", "cut off"]);
        says(good.replacen("\n3 0", "\n3 8", 1).as_bytes(), &["face 2 refers to vertex 8"]);
        says(good.replace("double y", "double w").as_bytes(), &["vertex 1 has a coordinate that is no number"]);
        let raw = binary(&cube, true);
        says(&raw[..raw.len() - 5], &["PLY file: ", "expected 12, got 11"]);
        says(b"plywood", &["PLY file"]);
    }
}
