//! VTK's legacy files, text and binary: unstructured grids of tetrahedra or of polygons, and poly data.

use super::cells::Cells;
use super::mesh_error::{MeshError, shown};
use super::reader::{Encoding, Number, Reader};
use palpate_core::math::Real;

/// What is to be done about solids that are no tetrahedra.
const FIRST_ORDER: &str = "mesh the body with tetrahedra of 4 nodes (first order)";

/// Points and cells of a legacy VTK file, what labels its cells bear, and how fibres lie in them; other data on them are left out.
pub(super) fn parse_vtk(bytes: &[u8]) -> Result<Cells, MeshError> {
    let mut file = Reader::text("VTK", bytes, None);
    if !file.line().starts_with(b"# vtk DataFile") {
        file.at = 0;
        return Err(file.wrong("it does not begin with '# vtk DataFile'"));
    }
    file.line();
    match file.line() {
        b"ASCII" => {}
        b"BINARY" => file.encoding = Encoding::BigEndian,
        other => return Err(file.wrong(format!("expected ASCII or BINARY, found '{}'", shown(other)))),
    }
    let mut cells = Cells { indexed: true, ..Cells::default() };
    let (mut lists, mut polygons, mut types) = (Lists::default(), Lists::default(), Vec::new());
    let mut strips = Lists::default();
    loop {
        let name = file.name();
        match name {
            b"" => break,
            b"CELL_DATA" | b"POINT_DATA" => {
                file.at -= name.len();
                break;
            }
            b"DATASET" => match file.line() {
                b"UNSTRUCTURED_GRID" | b"POLYDATA" => {}
                other => {
                    let what = format!("a data set of type {}", shown(other));
                    return Err(MeshError::Unsupported {
                        what,
                        remedy: "save it as an unstructured grid or as poly data",
                    });
                }
            },
            b"POINTS" => {
                let (count, number) = (file.word::<i64>()?, number(&mut file)?);
                let coordinates = file.numbers(number, count.saturating_mul(3))?;
                cells.points = coordinates.as_chunks().0.to_vec();
            }
            b"CELLS" => lists = Lists::read(&mut file)?,
            b"POLYGONS" => polygons = Lists::read(&mut file)?,
            b"TRIANGLE_STRIPS" => strips = Lists::read(&mut file)?,
            b"VERTICES" | b"LINES" => drop(Lists::read(&mut file)?),
            b"CELL_TYPES" => {
                let count = file.word()?;
                file.line();
                types = file.numbers(Number::Signed(4), count)?;
            }
            b"FIELD" => skip_field(&mut file)?,
            // Up to an empty line.
            b"METADATA" => {
                file.line();
                while !file.line().is_empty() {}
            }
            _ => return Err(file.wrong(format!("'{}' is no section of a mesh", shown(name)))),
        }
    }
    lists.put(&mut cells, Kinds::Each(&types))?;
    polygons.put(&mut cells, Kinds::All(POLYGON))?;
    strips.put(&mut cells, Kinds::All(STRIP))?;
    cell_arrays(&mut file, &mut cells)?;
    Ok(cells)
}

/// Gives `cells` the arrays of one or three numbers a cell.
fn cell_arrays(file: &mut Reader, cells: &mut Cells) -> Result<(), MeshError> {
    let (mut of_cells, mut count) = (false, 0);
    loop {
        let keyword = file.name();
        let mut array = |file: &mut Reader, name: &[u8], kind: ArrayType, components: i64, tuples: i64| {
            let numbers = kind.numbers(file, components.saturating_mul(tuples))?;
            let name = String::from_utf8_lossy(name);
            match (numbers, components) {
                (Some(numbers), 1) if of_cells && tuples == count => cells.label_by_cell(&name, &numbers, 0),
                (Some(numbers), 3) if of_cells && tuples == count => cells.lead_by_cell(&name, &numbers, 0),
                _ => {}
            }
            Ok(())
        };
        match keyword {
            b"" => return Ok(()),
            b"CELL_DATA" | b"POINT_DATA" => (of_cells, count) = (keyword == b"CELL_DATA", file.word()?),
            b"SCALARS" => {
                let name = file.name();
                let at = file.at;
                let mut words = file.line().split(u8::is_ascii_whitespace).filter(|word| !word.is_empty());
                let kind = ArrayType::of(words.next().unwrap_or_default());
                let kind = kind.ok_or_else(|| Reader { at, ..*file }.wrong("it has no known type of number"))?;
                let components = words.next().and_then(|word| std::str::from_utf8(word).ok()?.parse().ok());
                if file.peek() == b"LOOKUP_TABLE" {
                    file.line();
                }
                array(file, name, kind, components.unwrap_or(1), count)?;
            }
            b"FIELD" => {
                file.name();
                for _ in 0..file.word::<i64>()? {
                    let (name, components, tuples) = (file.name(), file.word()?, file.word()?);
                    let kind = array_type(file)?;
                    array(file, name, kind, components, tuples)?;
                    skip_metadata(file);
                }
            }
            b"VECTORS" | b"NORMALS" | b"TENSORS" | b"TENSORS6" | b"GLOBAL_IDS" | b"PEDIGREE_IDS" | b"EDGE_FLAGS" => {
                let name = file.name();
                let kind = array_type(file)?;
                let components = match keyword {
                    b"VECTORS" | b"NORMALS" => 3,
                    b"TENSORS" => 9,
                    b"TENSORS6" => 6,
                    _ => 1,
                };
                array(file, name, kind, components, count)?;
            }
            b"TEXTURE_COORDINATES" => {
                let (name, components) = (file.name(), file.word()?);
                let kind = array_type(file)?;
                array(file, name, kind, components, count)?;
            }
            // Bytes in binary files, numbers from 0 to 1 in text; of no label.
            b"COLOR_SCALARS" | b"LOOKUP_TABLE" => {
                let (_, number) = (file.name(), file.word::<i64>()?);
                file.line();
                let (components, tuples) = if keyword == b"LOOKUP_TABLE" { (4, number) } else { (number, count) };
                file.numbers(Number::Unsigned(1), components.saturating_mul(tuples))?;
            }
            b"METADATA" => {
                file.at -= "METADATA".len();
                skip_metadata(file);
            }
            other => return Err(file.wrong(format!("'{}' is no array of data", shown(other)))),
        }
    }
}

/// Steps over what files of version 5 say about an array, up to an empty line.
fn skip_metadata(file: &mut Reader) {
    if file.peek() == b"METADATA" {
        file.line();
        while !file.line().is_empty() {}
    }
}

/// What an array of data holds.
#[derive(Clone, Copy)]
enum ArrayType {
    Numbers(Number),
    /// Eight of them in a byte of a binary file.
    Bits,
    /// One on each line of a text, each with its length before it in a binary file.
    Words,
}

impl ArrayType {
    /// That of the name `name`.
    fn of(name: &[u8]) -> Option<Self> {
        let number = match name.to_ascii_lowercase().as_slice() {
            b"bit" => return Some(Self::Bits),
            b"string" | b"utf8_string" => return Some(Self::Words),
            b"char" | b"signed_char" | b"vtktypeint8" => Number::Signed(1),
            b"unsigned_char" | b"vtktypeuint8" => Number::Unsigned(1),
            b"short" | b"vtktypeint16" => Number::Signed(2),
            b"unsigned_short" | b"vtktypeuint16" => Number::Unsigned(2),
            b"int" | b"vtkidtype" | b"vtktypeint32" => Number::Signed(4),
            b"unsigned_int" | b"vtktypeuint32" => Number::Unsigned(4),
            b"long" | b"vtktypeint64" => Number::Signed(8),
            b"unsigned_long" | b"vtktypeuint64" => Number::Unsigned(8),
            b"float" | b"vtktypefloat32" => Number::Float(4),
            b"double" | b"vtktypefloat64" => Number::Float(8),
            _ => return None,
        };
        Some(Self::Numbers(number))
    }

    /// The next `count` of them, where they are numbers.
    fn numbers(self, file: &mut Reader, count: i64) -> Result<Option<Vec<Real>>, MeshError> {
        let text = file.encoding == Encoding::Text;
        match self {
            Self::Numbers(number) => file.numbers(number, count).map(Some),
            Self::Bits if text => file.numbers(Number::Unsigned(1), count).map(Some),
            Self::Bits => {
                // Not `div_ceil`, which no signed number has yet.
                file.numbers(Number::Unsigned(1), count / 8 + i64::from(count % 8 > 0))?;
                Ok(None)
            }
            Self::Words => {
                for _ in 0..count {
                    if file.rest().is_empty() {
                        return Err(file.wrong("the file was cut off"));
                    }
                    if text { _ = file.line() } else { skip_word(file)? }
                }
                Ok(None)
            }
        }
    }
}

/// Steps over a word of a binary file: two bits tell how many bytes its length has.
fn skip_word(file: &mut Reader) -> Result<(), MeshError> {
    let first = *file.rest().first().ok_or_else(|| file.wrong("the file was cut off"))?;
    let length = match first >> 6 {
        3 => u64::from(u8::from_le_bytes(file.raw()?) & 0x3f),
        2 => u64::from(u16::from_le_bytes(file.raw()?) & 0x3fff),
        1 => u64::from(u32::from_le_bytes(file.raw()?) & 0x3fff_ffff),
        _ => u64::from_le_bytes(file.raw()?),
    };
    let length = usize::try_from(length).ok().filter(|length| *length <= file.rest().len());
    file.at += length.ok_or_else(|| file.wrong("the file was cut off"))?;
    Ok(())
}

/// The type of an array that comes next, and the end of its line.
fn array_type(file: &mut Reader) -> Result<ArrayType, MeshError> {
    let at = file.at;
    let name = file.line();
    ArrayType::of(name).ok_or_else(|| Reader { at, ..*file }.wrong(format!("'{}' is no type of number", shown(name))))
}

/// The type of number that comes next, and the end of its line.
fn number(file: &mut Reader) -> Result<Number, MeshError> {
    let at = file.at;
    match array_type(file)? {
        ArrayType::Numbers(number) => Ok(number),
        ArrayType::Bits | ArrayType::Words => Err(Reader { at, ..*file }.wrong("numbers are expected here")),
    }
}

/// Steps over arrays that have nothing to do with the shape.
fn skip_field(file: &mut Reader) -> Result<(), MeshError> {
    file.name();
    for _ in 0..file.word::<i64>()? {
        file.name();
        let (components, tuples, kind) = (file.word::<i64>()?, file.word::<i64>()?, array_type(file)?);
        kind.numbers(file, components.saturating_mul(tuples))?;
        skip_metadata(file);
    }
    Ok(())
}

/// Lists of point numbers, one after the other, and where each ends.
#[derive(Default)]
pub(super) struct Lists {
    pub numbers: Vec<Real>,
    pub ends: Vec<Real>,
}

impl Lists {
    /// As they stand in a legacy file: each with its length before it, or, since version 5, where they begin and end.
    fn read(file: &mut Reader) -> Result<Self, MeshError> {
        let [first, second] = [file.word::<i64>()?, file.word::<i64>()?];
        file.line();
        let mut lists = Self::default();
        if file.rest().trim_ascii_start().starts_with(b"OFFSETS") {
            for (name, count) in [("OFFSETS", first), ("CONNECTIVITY", second)] {
                let found = file.name();
                if found != name.as_bytes() {
                    return Err(file.wrong(format!("expected {name}, found '{}'", shown(found))));
                }
                let number = number(file)?;
                lists.ends = std::mem::replace(&mut lists.numbers, file.numbers(number, count)?);
            }
            // The first one says where the first begins.
            lists.ends.drain(..1.min(lists.ends.len()));
            return Ok(lists);
        }
        for _ in 0..first {
            let length = file.number(Number::Signed(4))?;
            lists.numbers.extend(file.numbers(Number::Signed(4), length as i64)?);
            lists.ends.push(lists.numbers.len() as Real);
        }
        Ok(lists)
    }

    /// Adds them to `cells`, whose points they count.
    pub(super) fn put(&self, cells: &mut Cells, kinds: Kinds) -> Result<(), MeshError> {
        let wrong = |what: String| MeshError::Syntax { format: "VTK", line: None, what };
        if let Kinds::Each(types) = kinds
            && types.len() != self.ends.len()
        {
            return Err(wrong(format!("{} cells and {} types of cells", self.ends.len(), types.len())));
        }
        let mut start = 0;
        for (i, end) in self.ends.iter().enumerate() {
            let number = i as i64 + 1;
            let end = *end as usize;
            let list = self.numbers.get(start..end);
            let list =
                list.ok_or_else(|| wrong(format!("the points of cell {number} are not there: it was cut off")))?;
            start = end;
            let corners: Result<Vec<u32>, MeshError> =
                list.iter().map(|index| cells.index("cell", number, whole(*index), 0)).collect();
            let corners = corners?;
            let kind = match kinds {
                Kinds::Each(types) => types[i] as i64,
                Kinds::All(kind) => kind,
            };
            match (kind, corners.as_slice()) {
                (EMPTY..=LINES, _) => {}
                (STRIP, [_, _, _, ..]) => cells.strip(&corners)?,
                (TRIANGLE | POLYGON | QUADRANGLE, [_, _, _, ..]) => cells.polygon(&corners)?,
                (PIXEL, &[a, b, c, d]) => cells.polygon(&[a, b, d, c])?,
                (TETRAHEDRON, &[a, b, c, d]) => cells.tetrahedra.push((number, [a, b, c, d])),
                (TRIANGLE | STRIP | POLYGON | PIXEL | QUADRANGLE | TETRAHEDRON, _) => {
                    return Err(wrong(format!("cell {number} has {} points", corners.len())));
                }
                (kind, _) => {
                    let what = format!("cell {number}, of VTK's type {kind},");
                    return Err(MeshError::Unsupported { what, remedy: FIRST_ORDER });
                }
            }
        }
        Ok(())
    }
}

/// What lists of points are.
#[derive(Clone, Copy)]
pub(super) enum Kinds<'a> {
    /// Each of its own of VTK's types.
    Each(&'a [Real]),
    /// All of one.
    All(i64),
}

/// VTK's types of cells: none, points and lines up to [`LINES`], then faces and solids.
const EMPTY: i64 = 0;
const LINES: i64 = 4;
const TRIANGLE: i64 = 5;
pub(super) const STRIP: i64 = 6;
pub(super) const POLYGON: i64 = 7;
const PIXEL: i64 = 8;
const QUADRANGLE: i64 = 9;
const TETRAHEDRON: i64 = 10;

/// `number` as an index: one that is none for what is no whole number.
fn whole(number: Real) -> i64 {
    if number.fract() == 0.0 { number as i64 } else { -1 }
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;
    use crate::geometry::mesh_io::{LengthUnit, Solid, parse, parse_surface, parse_tet_mesh};
    use crate::geometry::ply::tests::prism;
    use palpate_core::geometry::primitives::{box_mesh, box_surface};
    use palpate_core::geometry::{Surface, TetMesh};
    use palpate_core::math::Vec3;
    use std::path::Path;

    fn vtk(bytes: &[u8]) -> Result<TetMesh, MeshError> {
        parse_tet_mesh(Path::new("a.vtk"), bytes, LengthUnit::Metre)
    }

    /// A file of `points` and cells of one type; version 5 says where cells begin instead of how long they are.
    fn file<const N: usize>(points: &[Vec3], cells: &[[u32; N]], kind: i32, binary: bool, version: u8) -> Vec<u8> {
        let mut bytes = format!(
            "# vtk DataFile Version {version}.1\nbox\n{}\nDATASET {}\nFIELD FieldData 1\nTIME 1 1 double\n",
            if binary { "BINARY" } else { "ASCII" },
            if N == 4 { "UNSTRUCTURED_GRID" } else { "POLYDATA" }
        )
        .into_bytes();
        let put = |bytes: &mut Vec<u8>, text: String, raw: &[u8]| match binary {
            true => bytes.extend(raw),
            false => bytes.extend((text + " ").bytes()),
        };
        let real = |bytes: &mut Vec<u8>, x: f64| put(bytes, format!("{x:?}"), &x.to_be_bytes());
        let int = |bytes: &mut Vec<u8>, n: i32| put(bytes, n.to_string(), &n.to_be_bytes());
        let long = |bytes: &mut Vec<u8>, n: i64| put(bytes, n.to_string(), &n.to_be_bytes());
        let line = |bytes: &mut Vec<u8>, text: String| bytes.extend((text + "\n").bytes());
        real(&mut bytes, 0.5);
        line(&mut bytes, format!("\nPOINTS {} double", points.len()));
        points.iter().flatten().for_each(|c| real(&mut bytes, *c));
        line(&mut bytes, "\nMETADATA\nINFORMATION 0\n".into());
        let name = if N == 4 { "CELLS" } else { "POLYGONS" };
        if version < 5 {
            line(&mut bytes, format!("{name} {} {}", cells.len(), (N + 1) * cells.len()));
            for cell in cells {
                int(&mut bytes, N as i32);
                cell.iter().for_each(|n| int(&mut bytes, *n as i32));
            }
        } else {
            line(&mut bytes, format!("{name} {} {}\nOFFSETS vtktypeint64", cells.len() + 1, N * cells.len()));
            (0..=cells.len()).for_each(|i| long(&mut bytes, (N * i) as i64));
            line(&mut bytes, "\nCONNECTIVITY vtktypeint64".into());
            cells.iter().flatten().for_each(|n| long(&mut bytes, i64::from(*n)));
        }
        if N == 4 {
            line(&mut bytes, format!("\nCELL_TYPES {}", cells.len()));
            cells.iter().for_each(|_| int(&mut bytes, kind));
        }
        line(&mut bytes, format!("\nCELL_DATA {}\nSCALARS region int\nLOOKUP_TABLE default", cells.len()));
        cells.iter().for_each(|_| int(&mut bytes, 7));
        bytes
    }

    pub(in crate::geometry) fn every_vtk(mesh: &TetMesh, surface: &Surface) -> Vec<Vec<u8>> {
        let forms = [(false, 3), (false, 5), (true, 3), (true, 5)];
        let volume = forms.iter().map(|(binary, version)| file(&mesh.nodes, &mesh.elements, 10, *binary, *version));
        let shell =
            forms.iter().map(|(binary, version)| file(&surface.vertices, &surface.triangles, 5, *binary, *version));
        volume.chain(shell).collect()
    }

    #[test]
    fn boxes_come_back_from_every_form_of_vtk() {
        let mesh = box_mesh(Vec3::new(0.1, 0.2, 0.3), [2, 1, 2]);
        let surface = box_surface(Vec3::new(0.1, 0.2, 0.3), [2, 1, 2]);
        let files = every_vtk(&mesh, &surface);
        for file in &files[..4] {
            assert_eq!(vtk(file).unwrap(), mesh, "{}", shown(file));
        }
        for file in &files[4..] {
            assert_eq!(parse_surface(Path::new("a.VTK"), file, LengthUnit::Metre).unwrap(), surface, "{}", shown(file));
        }
    }

    #[test]
    fn strips_of_triangles_are_read() {
        let (surface, strips) = prism(5);
        let points: String = surface.vertices.iter().map(|v| format!("{} {} {}\n", v.x, v.y, v.z)).collect();
        let list = |strip: &Vec<u32>| {
            let corners: Vec<String> = strip.iter().map(u32::to_string).collect();
            format!("{} {}\n", strip.len(), corners.join(" "))
        };
        let lists: String = strips.iter().map(list).collect();
        let head = format!("# vtk DataFile Version 3.0\nx\nASCII\nDATASET POLYDATA\nPOINTS 12 double\n{points}");
        let text = format!("{head}TRIANGLE_STRIPS {} 99\n{lists}", strips.len());
        assert_eq!(parse_surface(Path::new("a.vtk"), text.as_bytes(), LengthUnit::Metre).unwrap(), surface);
    }

    #[test]
    fn data_of_every_type_are_stepped_over_and_labels_behind_them_found() {
        let mesh = box_mesh(Vec3::repeat(1.0), [1; 3]);
        let text = String::from_utf8(file(&mesh.nodes, &mesh.elements, 10, false, 5)).unwrap();
        let whole = text.split("\nCELL_DATA").next().unwrap();
        let read = |kind: &str, more: &str| {
            let data = format!(
                "\nCELL_DATA 6\nFIELD FieldData 1\nregion 1 6 {kind}\n4 4 4 5 5 5\nMETADATA\nINFORMATION 0\n\n"
            );
            let files = [("a.vtk".into(), format!("{whole}{more}{data}").into_bytes())];
            match parse(&files, LengthUnit::Metre, 0.0, None)?.0 {
                Solid::Volume(found) => Ok::<_, MeshError>(found.labels.of),
                Solid::Surface(_) => panic!("a surface"),
            }
        };
        for kind in ["vtktypeint32", "vtktypeuint8", "signed_char", "long", "vtkIdType", "double"] {
            assert_eq!(read(kind, "").unwrap(), [4, 4, 4, 5, 5, 5], "{kind}");
        }
        for more in [
            "\nCELL_DATA 6\nFIELD f 2\nname 1 6 string\na\nb\nc\nd%20d\ne\nf\nbits 1 6 bit\n0 1 0 1 0 1\n",
            "\nPOINT_DATA 8\nCOLOR_SCALARS c 1\n0 0 0 0 0 0 0 0\nTEXTURE_COORDINATES t 1 float\n1 2 3 4 5 6 7 8\n",
            "\nCELL_DATA 6\nSCALARS  a\tint  1\nLOOKUP_TABLE b\n1 2 3 4 5 6\nLOOKUP_TABLE b 1\n1 1 1 1\n",
        ] {
            assert_eq!(read("int", more).unwrap(), [4, 4, 4, 5, 5, 5], "{more}");
        }
        let e = read("complex", "").unwrap_err().to_string();
        assert!(e.contains("VTK file, line ") && e.contains("'complex' is no type of number"), "{e}");
    }

    #[test]
    fn a_vtk_file_that_cannot_be_used_says_where_and_why() {
        let mesh = box_mesh(Vec3::repeat(1.0), [1; 3]);
        let says = |bytes: &[u8], expected: &str| {
            let message = vtk(bytes).unwrap_err().to_string();
            assert!(message.contains(expected), "{message}");
        };
        let text = String::from_utf8(file(&mesh.nodes, &mesh.elements, 10, false, 3)).unwrap();
        let changed = |from: &str, to: &str| {
            assert!(text.contains(from), "{from}");
            text.replacen(from, to, 1).into_bytes()
        };
        says(b"solid a", "does not begin with '# vtk DataFile'");
        says(&changed("UNSTRUCTURED_GRID", "STRUCTURED_POINTS"), "type STRUCTURED_POINTS cannot be read: save it as");
        says(&changed("POINTS 8 double", "POINTS 8 complex"), "line 8: 'complex' is no type of number");
        says(&changed("POINTS 8", "POINTS 9"), "line 10: 'METADATA' is no number");
        says(&changed("CELL_TYPES 6", "CELL_TYPES 5"), "line 16: '10' is no section");
        says(&file(&mesh.nodes, &mesh.elements, 24, false, 3), "cell 1, of VTK's type 24, cannot be read");
        says(&file(&mesh.nodes[1..], &mesh.elements, 10, true, 5), "refers to vertex 7");
        let binary = file(&mesh.nodes, &mesh.elements, 10, true, 3);
        says(&binary[..300], "the file was cut off (at byte 2");
        says(&changed("CELLS 6 30", "CELLS 99999999999999 30"), "is no number");
    }
}
