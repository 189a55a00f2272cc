//! VTK's XML files: unstructured grids (`.vtu`) and poly data (`.vtp`), their arrays as text, base64 or raw bytes, plain or
//! compressed by zlib.

use super::cells::Cells;
use super::mesh_error::{MeshError, shown};
use super::reader::{Encoding, MAX_FILE, Number, Reader, no_number};
use super::vtk::{Kinds, Lists, POLYGON, STRIP};
use base64::Engine;
use base64::prelude::BASE64_STANDARD;
use palpate_core::math::Real;
use roxmltree::{Document, Node};
use std::io::Read;

/// What comes after the text of a file, if anything does.
const APPENDED: &[u8] = b"<AppendedData";
/// What is to be done about what cannot be read.
const PLAIN: &str = "save it as text, or compressed by zlib or not at all";

/// Points and cells of all pieces, what labels the cells bear, and how fibres lie in them; other data on them are left out.
pub(super) fn parse_vtk_xml(bytes: &[u8]) -> Result<Cells, MeshError> {
    // Appended bytes are no XML: what comes before them is, once it ends.
    let end = bytes.windows(APPENDED.len()).position(|w| w == APPENDED);
    let (text, appended) = bytes.split_at(end.unwrap_or(bytes.len()));
    let text = std::str::from_utf8(text)
        .map_err(|e| wrong(None, format!("it is no text from byte {} on", e.valid_up_to())))?;
    let text = if end.is_some() { format!("{text}</VTKFile>") } else { text.to_owned() };
    let document = Document::parse(&text).map_err(|e| wrong(Some(e.pos().row as usize), e.to_string()))?;
    let root = document.root_element();
    let kind = root.attribute("type").unwrap_or_default();
    if root.tag_name().name() != "VTKFile" || !matches!(kind, "UnstructuredGrid" | "PolyData") {
        let what = format!("<{} type=\"{}\">", root.tag_name().name(), shown(kind.as_bytes()));
        return Err(MeshError::Unsupported {
            what,
            remedy: "save it as an unstructured grid (.vtu) or as poly data (.vtp)",
        });
    }
    let file = XmlFile {
        document: &document,
        encoding: match root.attribute("byte_order") {
            Some("BigEndian") => Encoding::BigEndian,
            _ => Encoding::LittleEndian,
        },
        length: Number::Unsigned(if root.attribute("header_type") == Some("UInt64") { 8 } else { 4 }),
        compressed: match root.attribute("compressor") {
            None => false,
            Some("vtkZLibDataCompressor") => true,
            Some(other) => {
                let what = format!("what {} has compressed", shown(other.as_bytes()));
                return Err(MeshError::Unsupported { what, remedy: PLAIN });
            }
        },
        // After the tag and an underscore.
        appended: appended
            .iter()
            .position(|b| *b == b'>')
            .and_then(|tag| appended[tag + 1..].trim_ascii_start().strip_prefix(b"_"))
            .unwrap_or_default(),
        raw: appended.split(|b| *b == b'>').next().is_some_and(|tag| tag.windows(5).any(|w| w == b"\"raw\"")),
    };
    let mut cells = Cells { indexed: true, ..Cells::default() };
    let pieces = root.children().filter(|n| n.has_tag_name(kind)).flat_map(|n| n.children());
    for piece in pieces.filter(|n| n.has_tag_name("Piece")) {
        file.piece(piece, &mut cells)?;
    }
    cells.drop_partial_arrays();
    Ok(cells)
}

fn wrong(line: Option<usize>, what: String) -> MeshError {
    MeshError::Syntax { format: "VTK XML", line, what }
}

/// How the arrays of a file are written.
struct XmlFile<'a> {
    document: &'a Document<'a>,
    encoding: Encoding,
    /// The type of the lengths before arrays.
    length: Number,
    compressed: bool,
    appended: &'a [u8],
    /// False when what is appended is base64.
    raw: bool,
}

impl XmlFile<'_> {
    /// Adds a piece, whose cells count its own points.
    fn piece(&self, piece: Node, cells: &mut Cells) -> Result<(), MeshError> {
        let child = |name: &str| piece.children().find(|n| n.has_tag_name(name));
        let named = |parent: Node, name: &str| {
            let array = parent.children().find(|n| n.has_tag_name("DataArray") && n.attribute("Name") == Some(name));
            array.map_or(Ok(Vec::new()), |array| self.array(array))
        };
        let mut own = Cells::default();
        if let Some(points) = child("Points").and_then(|n| n.children().find(|n| n.has_tag_name("DataArray"))) {
            own.points = self.array(points)?.as_chunks().0.to_vec();
        }
        for name in ["Cells", "Polys", "Strips"] {
            let lists = match child(name) {
                Some(parent) => {
                    let lists = Lists { numbers: named(parent, "connectivity")?, ends: named(parent, "offsets")? };
                    let types = if name == "Cells" { named(parent, "types")? } else { Vec::new() };
                    let kinds = match name {
                        "Cells" => Kinds::Each(&types),
                        "Polys" => Kinds::All(POLYGON),
                        _ => Kinds::All(STRIP),
                    };
                    lists.put(&mut own, kinds)?;
                    lists.ends.len()
                }
                None => 0,
            };
            // What the piece says of itself.
            let announced = piece.attribute(format!("NumberOf{name}").as_str()).and_then(|n| n.trim().parse().ok());
            if let Some(announced) = announced.filter(|n: &usize| *n != lists) {
                let line = self.document.text_pos_at(piece.range().start).row as usize;
                let what = format!("a piece announces {announced} {name} and holds {lists}: it was cut off or damaged");
                return Err(wrong(Some(line), what));
            }
        }
        let first = cells.points.len() as u32;
        cells.points.extend(own.points);
        cells.triangles.extend(own.triangles.into_iter().map(|t| t.map(|n| n + first)));
        cells.degenerate += own.degenerate;
        let before = cells.tetrahedra.len();
        cells.tetrahedra.extend(own.tetrahedra.into_iter().map(|(number, t)| (number, t.map(|n| n + first))));
        for array in child("CellData").into_iter().flat_map(|n| n.children().filter(|n| n.has_tag_name("DataArray"))) {
            // Words and bits label nothing.
            let is_number = !matches!(array.attribute("type"), Some("String" | "Bit"));
            let Some(name) = array.attribute("Name").filter(|_| is_number) else { continue };
            match array.attribute("NumberOfComponents") {
                None | Some("1") => cells.label_by_cell(name, &self.array(array)?, before),
                Some("3") => cells.lead_by_cell(name, &self.array(array)?, before),
                _ => {}
            }
        }
        Ok(())
    }

    /// The numbers of a DataArray.
    fn array(&self, array: Node) -> Result<Vec<Real>, MeshError> {
        let line = self.document.text_pos_at(array.range().start).row as usize;
        let name = array.attribute("Name").unwrap_or("Points");
        let at = |what: String| wrong(Some(line), format!("array '{}': {what}", shown(name.as_bytes())));
        let number = match array.attribute("type") {
            Some("Int8") => Number::Signed(1),
            Some("UInt8") => Number::Unsigned(1),
            Some("Int16") => Number::Signed(2),
            Some("UInt16") => Number::Unsigned(2),
            Some("Int32") => Number::Signed(4),
            Some("UInt32") => Number::Unsigned(4),
            Some("Int64") => Number::Signed(8),
            Some("UInt64") => Number::Unsigned(8),
            Some("Float32") => Number::Float(4),
            Some("Float64") => Number::Float(8),
            other => return Err(at(format!("'{}' is no type of number", shown(other.unwrap_or("").as_bytes())))),
        };
        let text = array.text().unwrap_or_default().trim();
        let bytes = match array.attribute("format") {
            Some("ascii") | None => {
                let numbers =
                    text.split_ascii_whitespace().map(|word| word.parse().map_err(|_| at(no_number(word.as_bytes()))));
                return numbers.collect();
            }
            Some("binary") => self.decoded(&Text(text.as_bytes())),
            Some("appended") => {
                let offset = array.attribute("offset").and_then(|o| o.parse().ok());
                let rest = offset.and_then(|o: usize| self.appended.get(o..)).unwrap_or_default();
                if self.raw { self.decoded(&Raw(rest)) } else { self.decoded(&Text(rest)) }
            }
            Some(other) => return Err(at(format!("the format '{}' is not known", shown(other.as_bytes())))),
        };
        let bytes = bytes.ok_or_else(|| at("its bytes do not hold together: it was cut off or damaged".into()))?;
        let mut reader = Reader { format: "VTK XML", bytes: &bytes, at: 0, encoding: self.encoding, comment: None };
        reader.numbers(number, (bytes.len() / number.size()) as i64)
    }

    /// The content behind its header: its length, or how many blocks there are, how long each is and becomes.
    fn decoded(&self, source: &dyn Source) -> Option<Vec<u8>> {
        let size = self.length.size();
        let lengths = |bytes: &[u8]| {
            let mut reader = Reader { format: "VTK XML", bytes, at: 0, encoding: self.encoding, comment: None };
            Some(
                reader
                    .numbers(self.length, (bytes.len() / size) as i64)
                    .ok()?
                    .into_iter()
                    .map(|n| n as usize)
                    .collect::<Vec<_>>(),
            )
        };
        if !self.compressed {
            let length = *lengths(&source.bytes(0, size)?)?.first()?;
            let all = source.bytes(0, length.checked_add(size)?)?;
            return Some(all.get(size..)?.to_vec());
        }
        let blocks = *lengths(&source.bytes(0, size)?)?.first()?;
        let header = blocks.checked_add(3)?.checked_mul(size)?;
        let lengths = lengths(&source.bytes(0, header)?)?;
        let (whole, last) = (lengths[1], lengths[2]);
        let packed = source
            .bytes(source.after(header), lengths[3..].iter().try_fold(0, |sum: usize, n| sum.checked_add(*n))?)?;
        let (mut content, mut at) = (Vec::new(), 0);
        for (block, length) in lengths[3..].iter().enumerate() {
            let unpacked = if block + 1 == blocks && last > 0 { last } else { whole };
            let before = content.len();
            if unpacked > MAX_FILE - before.min(MAX_FILE) {
                return None;
            }
            let mut decoder = flate2::read::ZlibDecoder::new(packed.get(at..at + length)?).take(unpacked as u64 + 1);
            decoder.read_to_end(&mut content).ok()?;
            if content.len() - before != unpacked {
                return None;
            }
            at += length;
        }
        Some(content)
    }
}

/// Bytes as they lie in a file.
trait Source {
    /// `length` bytes of what begins at place `start` of the source.
    fn bytes(&self, start: usize, length: usize) -> Option<Vec<u8>>;
    /// The place after a header of `length` bytes.
    fn after(&self, length: usize) -> usize;
}

/// As they are.
struct Raw<'a>(&'a [u8]);

impl Source for Raw<'_> {
    fn bytes(&self, start: usize, length: usize) -> Option<Vec<u8>> {
        Some(self.0.get(start..start.checked_add(length)?)?.to_vec())
    }

    fn after(&self, length: usize) -> usize {
        length
    }
}

/// In base64: a header and what follows are texts of their own.
struct Text<'a>(&'a [u8]);

impl Source for Text<'_> {
    fn bytes(&self, start: usize, length: usize) -> Option<Vec<u8>> {
        let text = self.0.get(start..start.checked_add(self.after(length))?)?;
        let mut bytes = BASE64_STANDARD.decode(text).ok()?;
        (bytes.len() >= length).then(|| bytes.truncate(length))?;
        Some(bytes)
    }

    fn after(&self, length: usize) -> usize {
        length.div_ceil(3).saturating_mul(4)
    }
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;
    use crate::geometry::mesh_io::{LengthUnit, parse_surface, parse_tet_mesh, read_tet_mesh};
    use crate::geometry::ply::tests::prism;
    use crate::geometry::shared::shared;
    use palpate_core::geometry::primitives::{box_mesh, box_surface};
    use palpate_core::geometry::{Surface, TetMesh};
    use std::io::Write;
    use std::path::Path;

    /// How the arrays of a test's file are written.
    #[derive(Clone, Copy, Debug)]
    struct Form {
        format: &'static str,
        raw: bool,
        zlib: bool,
        big: bool,
    }

    const fn form(format: &'static str, raw: bool, zlib: bool, big: bool) -> Form {
        Form { format, raw, zlib, big }
    }

    const FORMS: [Form; 7] = [
        form("ascii", false, false, true),
        form("binary", false, false, false),
        form("binary", false, true, true),
        form("appended", true, false, false),
        form("appended", true, true, false),
        form("appended", false, false, true),
        form("appended", false, true, false),
    ];

    /// The arrays of a file as they are written.
    struct Writer {
        form: Form,
        appended: Vec<u8>,
    }

    impl Writer {
        fn length(&self, n: usize) -> Vec<u8> {
            if self.form.big { (n as u64).to_be_bytes().into() } else { (n as u64).to_le_bytes().into() }
        }

        fn array(&mut self, name: &str, kind: &str, text: &str, mut numbers: Vec<Vec<u8>>) -> String {
            let tag = format!("<DataArray type=\"{kind}\" Name=\"{name}\" format=\"{}\"", self.form.format);
            if self.form.format == "ascii" {
                return format!("{tag}>\n{text}\n</DataArray>\n");
            }
            if self.form.big {
                numbers.iter_mut().for_each(|n| n.reverse());
            }
            let content = numbers.concat();
            let mut header = self.length(content.len());
            let mut packed = content.clone();
            if self.form.zlib {
                // Blocks of 100 bytes, of which the last is shorter.
                let blocks: Vec<Vec<u8>> = content
                    .chunks(100)
                    .map(|block| {
                        let mut encoder = flate2::write::ZlibEncoder::new(Vec::new(), flate2::Compression::fast());
                        encoder.write_all(block).unwrap();
                        encoder.finish().unwrap()
                    })
                    .collect();
                let sizes = [blocks.len(), 100, content.len() % 100];
                let sizes = sizes.into_iter().chain(blocks.iter().map(Vec::len));
                header = sizes.flat_map(|n| self.length(n)).collect();
                packed = blocks.concat();
            }
            let bytes = match (self.form.format == "appended" && self.form.raw, self.form.zlib) {
                (true, _) => [header, packed].concat(),
                (false, true) => (BASE64_STANDARD.encode(header) + &BASE64_STANDARD.encode(packed)).into(),
                (false, false) => BASE64_STANDARD.encode([header, packed].concat()).into(),
            };
            if self.form.format == "binary" {
                return format!("{tag}>\n{}\n</DataArray>\n", String::from_utf8(bytes).unwrap());
            }
            let offset = self.appended.len();
            self.appended.extend(bytes);
            format!("{tag} offset=\"{offset}\"/>\n")
        }

        fn integers(&mut self, name: &str, numbers: &[u32]) -> String {
            let text: Vec<String> = numbers.iter().map(u32::to_string).collect();
            self.array(name, "Int32", &text.join(" "), numbers.iter().map(|n| n.to_le_bytes().into()).collect())
        }
    }

    /// Two pieces, the first of the first cell.
    fn file<const N: usize>(points: &[palpate_core::math::Vec3], cells: &[[u32; N]], form: Form) -> Vec<u8> {
        let mut writer = Writer { form, appended: Vec::new() };
        let (kind, parent) = if N == 4 { ("UnstructuredGrid", "Cells") } else { ("PolyData", "Polys") };
        let mut text = format!(
            "<?xml version=\"1.0\"?>\n<VTKFile type=\"{kind}\" byte_order=\"{}\" header_type=\"UInt64\"{}>\n<{kind}>\n",
            if form.big { "BigEndian" } else { "LittleEndian" },
            if form.zlib { " compressor=\"vtkZLibDataCompressor\"" } else { "" }
        );
        for cells in [&cells[..1], &cells[1..]] {
            text += "<Piece>\n<Points>\n";
            let written: Vec<String> = points.iter().flatten().map(f64::to_string).collect();
            let raw = points.iter().flatten().map(|c| c.to_le_bytes().into()).collect();
            text += &writer.array("Points", "Float64", &written.join(" "), raw);
            text += &format!("</Points>\n<{parent}>\n");
            text += &writer.integers("connectivity", cells.as_flattened());
            text += &writer.integers("offsets", &(1..=cells.len()).map(|i| (N * i) as u32).collect::<Vec<_>>());
            if N == 4 {
                text += &writer.integers("types", &vec![10; cells.len()]);
            }
            text += &format!("</{parent}>\n</Piece>\n");
        }
        text += &format!("</{kind}>\n");
        let encoding = if form.raw { "raw" } else { "base64" };
        let appended = format!("<AppendedData encoding=\"{encoding}\">\n_");
        if writer.appended.is_empty() {
            (text + "</VTKFile>\n").into()
        } else {
            [text.as_bytes(), appended.as_bytes(), &writer.appended, b"\n</AppendedData>\n</VTKFile>\n"].concat()
        }
    }

    pub(in crate::geometry) fn every_vtu(mesh: &TetMesh) -> Vec<Vec<u8>> {
        FORMS.iter().map(|form| file(&mesh.nodes, &mesh.elements, *form)).collect()
    }

    pub(in crate::geometry) fn every_vtp(surface: &Surface) -> Vec<Vec<u8>> {
        FORMS.iter().map(|form| file(&surface.vertices, &surface.triangles, *form)).collect()
    }

    fn vtu(bytes: &[u8]) -> Result<TetMesh, MeshError> {
        parse_tet_mesh(Path::new("a.vtu"), bytes, LengthUnit::Metre)
    }

    #[test]
    fn boxes_come_back_from_every_form_of_vtk_xml() {
        let mesh = box_mesh(palpate_core::math::Vec3::new(0.1, 0.2, 0.3), [2, 1, 2]);
        let surface = box_surface(palpate_core::math::Vec3::new(0.1, 0.2, 0.3), [2, 1, 2]);
        for ((volume, shell), form) in every_vtu(&mesh).iter().zip(every_vtp(&surface)).zip(FORMS) {
            // Points of the first piece, which the second has again, are one.
            let read = vtu(volume).unwrap();
            assert!((read.elements.len(), read.nodes.len()) == (24, 18), "{form:?}");
            assert!((0..24).all(|e| read.corners(e) == mesh.corners(e)), "{form:?}");
            let read = parse_surface(Path::new("a.vtp"), &shell, LengthUnit::Metre).unwrap();
            assert!((read.volume() - surface.volume()).abs() < 1e-15, "{form:?}");
        }
    }

    #[test]
    fn strips_of_triangles_are_read_alone_and_beside_polygons_and_none_goes_missing() {
        let (surface, strips) = prism(5);
        let text = |lists: &[Vec<u32>]| {
            let mut end = 0;
            let ends: Vec<u32> = lists.iter().map(|list| (end += list.len() as u32, end).1).collect();
            let array = |name: &str, numbers: &[u32]| {
                let numbers: Vec<String> = numbers.iter().map(u32::to_string).collect();
                format!("<DataArray type=\"Int32\" Name=\"{name}\">{}</DataArray>", numbers.join(" "))
            };
            array("connectivity", &lists.concat()) + &array("offsets", &ends)
        };
        let points: Vec<String> = surface.vertices.iter().flatten().map(f64::to_string).collect();
        let file = |polygons: &[Vec<u32>], strips: &[Vec<u32>]| {
            format!(
                "<VTKFile type=\"PolyData\"><PolyData><Piece NumberOfPolys=\"{}\" NumberOfStrips=\"{}\"><Points>\
                 <DataArray type=\"Float64\">{}</DataArray></Points><Polys>{}</Polys><Strips>{}</Strips></Piece></PolyData></VTKFile>",
                polygons.len(),
                strips.len(),
                points.join(" "),
                text(polygons),
                text(strips)
            )
        };
        let read = |text: &str| parse_surface(Path::new("a.vtp"), text.as_bytes(), LengthUnit::Metre);
        assert_eq!(read(&file(&[], &strips)).unwrap(), surface);
        let mixed = file(&strips[1..], &strips[..1]);
        assert!((read(&mixed).unwrap().volume() - surface.volume()).abs() < 1e-12);
        let fewer = mixed.replace("<Strips>", "<Spare>").replace("</Strips>", "</Spare>");
        let e = read(&fewer).unwrap_err().to_string();
        assert!(e.contains("announces 1 Strips and holds 0"), "{e}");
    }

    #[test]
    fn a_vtu_file_that_cannot_be_used_says_where_and_why() {
        let mesh = box_mesh(palpate_core::math::Vec3::repeat(1.0), [1; 3]);
        let says = |bytes: &[u8], expected: &str| {
            let message = vtu(bytes).unwrap_err().to_string();
            assert!(message.contains(expected), "{message}");
        };
        let text = String::from_utf8(file(&mesh.nodes, &mesh.elements, FORMS[0])).unwrap();
        says(text.replace("<Points>", "<Dots>").as_bytes(), "VTK XML file, line ");
        says(text.replace("UnstructuredGrid", "ImageData").as_bytes(), "<VTKFile type=\"ImageData\"> cannot be read");
        says(text.replacen("10", "12", 1).as_bytes(), "cell 1, of VTK's type 12, cannot be read");
        says(text.replace("Float64", "String").as_bytes(), "line 6: array 'Points': 'String' is no type");
        says(text.replacen("0 0 0", "0 zero 0", 1).as_bytes(), "line 6: array 'Points': 'zero' is no number");
        says(text.replace("\n4\n", "\n5\n").as_bytes(), "the points of cell 1 are not there");
        says(text.replace("header_type", "compressor=\"vtkLZ4DataCompressor\" a").as_bytes(), "save it as text");
        for form in &FORMS[1..] {
            let mut bytes = file(&mesh.nodes, &mesh.elements, *form);
            let packed = bytes.len() - 120;
            bytes.truncate(packed);
            assert!(vtu(&bytes).is_err(), "{form:?}");
        }
        let cut = file(&mesh.nodes, &mesh.elements, FORMS[4]);
        says(&cut[..cut.len() - 60], "array 'types': its bytes do not hold together");
    }

    #[test]
    fn real_vtu_files_come_back_in_full() {
        for (name, nodes, elements) in [
            ("raptorTetra_8418.vtu", 2_996, 8_418),
            ("raptorTetra_12580.vtu", 4_104, 12_580),
            ("raptorTetra_19409.vtu", 5_992, 19_409),
            ("Armadillo_Tetra_4406.vtu", 1_446, 4_406),
        ] {
            let Some(path) = shared(&format!("meshes/{name}")) else { return };
            let mesh = read_tet_mesh(&path, LengthUnit::Metre).unwrap_or_else(|e| panic!("{name}: {e}"));
            assert!(mesh.elements.len() == elements && mesh.nodes.len() <= nodes, "{name}: {} nodes", mesh.nodes.len());
        }
    }
}
