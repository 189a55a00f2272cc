//! Gmsh's MSH files: 4.1 and 2.x, binary or text; 1 (`$NOD`, `$ELM`).

use super::cells::Cells;
use super::mesh_error::{MeshError, shown};
use super::reader::{Encoding, Reader};
use palpate_core::math::Real;
use std::collections::HashMap;

/// Nodes, tetrahedra, triangles and quadrangles of a MSH file; tetrahedra are labelled by their physical groups and elementary
/// entities. Points and lines in it are ignored.
pub(super) fn parse_msh(bytes: &[u8]) -> Result<Cells, MeshError> {
    let mut file = Reader::text("MSH", bytes, None);
    let Sections { nodes, tetrahedra, polygons, several_groups } = file.mesh()?;
    let mut node_of_tag = HashMap::new();
    for (node, (tag, _)) in nodes.iter().enumerate() {
        if node_of_tag.insert(*tag, node as u32).is_some() {
            return Err(file.wrong(format!("node {tag} is defined twice")));
        }
    }
    let mut cells = Cells { indexed: true, ..Cells::default() };
    cells.points = nodes.into_iter().map(|(_, position)| position).collect();
    let node_of = |number: i64, tag: i64| {
        node_of_tag.get(&tag).copied().ok_or(MeshError::BadIndex { cell: "element", number, index: tag })
    };
    for Tetrahedron { number, nodes: [a, b, c, d], .. } in &tetrahedra {
        let node = |tag: &i64| node_of(*number, *tag);
        cells.tetrahedra.push((*number, [node(a)?, node(b)?, node(c)?, node(d)?]));
    }
    for (number, tags) in &polygons {
        let corners: Result<Vec<u32>, MeshError> = tags.iter().map(|tag| node_of(*number, *tag)).collect();
        cells.polygon(&corners?)?;
    }
    // 0 stands for no group.
    if tetrahedra.iter().any(|t| t.physical != 0) {
        cells.label("physical", tetrahedra.iter().map(|t| t.physical as Real));
    }
    if tetrahedra.iter().any(|t| t.elementary != 0) {
        cells.label("elementary", tetrahedra.iter().map(|t| t.elementary as Real));
    }
    if several_groups {
        cells.notes.push("volumes in several physical groups: the first of each counts".into());
    }
    if cells.tetrahedra.is_empty() && cells.triangles.is_empty() {
        return Err(MeshError::Empty { what: "tetrahedra or triangles" });
    }
    Ok(cells)
}

/// A tetrahedron as a MSH file lists it.
struct Tetrahedron {
    number: i64,
    /// Tags of its nodes.
    nodes: [i64; 4],
    /// The groups that it belongs to; 0 for none.
    physical: i64,
    elementary: i64,
}

/// What a MSH file lists.
#[derive(Default)]
struct Sections {
    /// Tag and position in the file's unit.
    nodes: Vec<(i64, [Real; 3])>,
    tetrahedra: Vec<Tetrahedron>,
    /// Number, and tags of the nodes, of triangles and quadrangles.
    polygons: Vec<(i64, Vec<i64>)>,
    /// Some volume is in several physical groups.
    several_groups: bool,
}

/// The volume that one of version 4 is a part of, and its physical group; 0 for none.
#[derive(Clone, Copy)]
struct Volume {
    tag: i64,
    physical: i64,
}

/// What an element is here.
enum Cell {
    Tetrahedron([i64; 4]),
    /// Tags of the nodes of a triangle or quadrangle.
    Polygon(Vec<i64>),
    /// A point or a line.
    Other,
}

/// Nodes of a Gmsh element of type 1, 2, 3, ...
const NODES_OF_TYPE: [u8; 31] =
    [2, 3, 4, 4, 8, 6, 5, 3, 6, 9, 10, 27, 18, 14, 1, 8, 20, 15, 13, 9, 10, 12, 15, 15, 21, 4, 5, 6, 20, 35, 56];
/// The Gmsh types of the tetrahedron with four nodes, the triangle and the quadrangle.
const TETRAHEDRON: i64 = 4;
const TRIANGLE: i64 = 2;
const QUADRANGLE: i64 = 3;
/// Gmsh types of lines of any order and of points: nothing of a body.
const LINES: [i64; 6] = [1, 8, 15, 26, 27, 28];

impl Reader<'_> {
    /// An `int`.
    fn int(&mut self) -> Result<i64, MeshError> {
        if self.encoding == Encoding::Text { self.word() } else { Ok(i32::from_le_bytes(self.raw()?).into()) }
    }

    /// A `size_t`, used since version 4.
    fn size(&mut self) -> Result<i64, MeshError> {
        if self.encoding == Encoding::Text { self.word() } else { Ok(i64::from_le_bytes(self.raw()?)) }
    }

    /// A `double`.
    fn real(&mut self) -> Result<Real, MeshError> {
        if self.encoding == Encoding::Text { self.word() } else { Ok(Real::from_le_bytes(self.raw()?)) }
    }

    fn position(&mut self) -> Result<[Real; 3], MeshError> {
        Ok([self.real()?, self.real()?, self.real()?])
    }

    /// A count alone on its line, which is text even in binary files of version 2.
    fn count_line(&mut self) -> Result<i64, MeshError> {
        let count = self.word()?;
        self.line();
        Ok(count)
    }

    /// All sections up to the end of the file.
    fn mesh(&mut self) -> Result<Sections, MeshError> {
        let (mut sections, mut volumes) = (Sections::default(), HashMap::new());
        let mut version = None;
        loop {
            self.skip_space();
            if self.rest().is_empty() {
                return Ok(sections);
            }
            let name = self.line();
            match (name, version) {
                (b"$MeshFormat", _) => version = Some(self.format()?),
                (b"$NOD", _) => self.nodes_2(&mut sections.nodes)?,
                (b"$ELM", _) => self.elements_1(&mut sections)?,
                (b"$Nodes", Some(2)) => self.nodes_2(&mut sections.nodes)?,
                (b"$Elements", Some(2)) => self.elements_2(&mut sections)?,
                (b"$Nodes", Some(_)) => self.nodes_4(&mut sections.nodes)?,
                (b"$Entities", Some(4)) => sections.several_groups |= self.entities_4(&mut volumes, false)?,
                (b"$PartitionedEntities", Some(4)) => {
                    sections.several_groups |= self.entities_4(&mut volumes, true)?;
                }
                (b"$Elements", Some(_)) => self.elements_4(&mut sections, &volumes)?,
                (b"$ParametricNodes", _) => {
                    return Err(MeshError::Unsupported {
                        what: "$ParametricNodes of an old MSH file".to_owned(),
                        remedy: "save it from Gmsh as version 4.1, or without parametric coordinates",
                    });
                }
                (b"$Nodes" | b"$Elements", None) => return Err(self.wrong("$MeshFormat must come first")),
                ([b'$', name @ ..], _) if name.len() < 80 => {
                    let end = [b"$End", name].concat();
                    let found = self.rest().windows(end.len()).position(|bytes| bytes == end);
                    self.at += found.ok_or_else(|| self.wrong(format!("{} is missing", shown(&end))))?;
                }
                _ => return Err(self.wrong(format!("expected a section, found '{}'", shown(name)))),
            }
            self.skip_space();
            let end = self.line();
            if !end.get(..4).is_some_and(|word| word.eq_ignore_ascii_case(b"$End")) {
                return Err(self.wrong(format!("expected the end of {}, found '{}'", shown(name), shown(end))));
            }
        }
    }

    /// Sets the encoding and gives the version, 2 or 4.
    fn format(&mut self) -> Result<u8, MeshError> {
        let (version, binary, size): (String, i64, i64) = (self.word()?, self.word()?, self.word()?);
        self.line();
        if binary != 0 {
            self.encoding = Encoding::LittleEndian;
            match self.raw()? {
                [1, 0, 0, 0] => {}
                [0, 0, 0, 1] => self.encoding = Encoding::BigEndian,
                _ => return Err(self.wrong("the byte order is neither little nor big endian")),
            }
            if size != 8 {
                return Err(self.wrong(format!("numbers of {size} bytes instead of 8")));
            }
        }
        match version.as_str() {
            "4.1" => Ok(4),
            "2" | "2.0" | "2.1" | "2.2" => Ok(2),
            _ => Err(MeshError::Unsupported {
                what: format!("a MSH file of version {}", shown(version.as_bytes())),
                remedy: "save it from Gmsh as version 4.1 or 2.2",
            }),
        }
    }

    /// Nodes of versions 1 and 2: tag and position.
    fn nodes_2(&mut self, nodes: &mut Vec<(i64, [Real; 3])>) -> Result<(), MeshError> {
        for _ in 0..self.count_line()? {
            nodes.push((self.int()?, self.position()?));
        }
        Ok(())
    }

    /// Elements of version 1: number, type, two regions, number of nodes, nodes.
    fn elements_1(&mut self, sections: &mut Sections) -> Result<(), MeshError> {
        for _ in 0..self.count_line()? {
            let [number, kind, physical, elementary, _] =
                [self.int()?, self.int()?, self.int()?, self.int()?, self.int()?];
            let cell = self.cell(kind, Reader::int)?;
            sections.add(cell, number, physical, elementary);
        }
        Ok(())
    }

    /// Elements of version 2: number, type, tags, nodes; in binary files type and number of tags head a group.
    fn elements_2(&mut self, sections: &mut Sections) -> Result<(), MeshError> {
        let mut left = self.count_line()?;
        while left > 0 {
            let text = self.encoding == Encoding::Text;
            let (text_number, kind) = if text { (self.int()?, self.int()?) } else { (0, self.int()?) };
            let group = if text { 1 } else { self.int()? };
            let n_tags = self.int()?;
            if !(1..=left).contains(&group) {
                return Err(self.wrong(format!("a group of {group} elements where {left} are left")));
            }
            for _ in 0..group {
                let number = if text { text_number } else { self.int()? };
                let [mut physical, mut elementary] = [0, 0];
                for tag in 0..n_tags {
                    let value = self.int()?;
                    match tag {
                        0 => physical = value,
                        1 => elementary = value,
                        _ => {}
                    }
                }
                let cell = self.cell(kind, Reader::int)?;
                sections.add(cell, number, physical, elementary);
            }
            left -= group;
        }
        Ok(())
    }

    /// Nodes of version 4.1: blocks of tags, then positions, which may carry up to three parameters.
    fn nodes_4(&mut self, nodes: &mut Vec<(i64, [Real; 3])>) -> Result<(), MeshError> {
        let [blocks, _, _, _] = [self.size()?, self.size()?, self.size()?, self.size()?];
        for _ in 0..blocks {
            let [dimension, _, parametric] = [self.int()?, self.int()?, self.int()?];
            let mut tags = Vec::new();
            for _ in 0..self.size()? {
                tags.push(self.size()?);
            }
            for tag in tags {
                nodes.push((tag, self.position()?));
                for _ in 0..if parametric == 0 { 0 } else { dimension } {
                    self.real()?;
                }
            }
        }
        Ok(())
    }

    /// Entities of version 4.1, or parts of them: the volume and the physical group, if any, of each volume by its tag. True
    /// where one is in several groups.
    fn entities_4(&mut self, volumes: &mut HashMap<i64, Volume>, partitioned: bool) -> Result<bool, MeshError> {
        if partitioned {
            self.size()?;
            // Ghosts: elements of other parts that are listed once more.
            for _ in 0..self.size()? {
                self.int()?;
                self.int()?;
            }
        }
        let mut several = false;
        let counts = [self.size()?, self.size()?, self.size()?, self.size()?];
        for (dimension, count) in counts.into_iter().enumerate() {
            for _ in 0..count {
                let tag = self.int()?;
                let mut volume = Volume { tag, physical: 0 };
                if partitioned {
                    let [parent_dimension, parent] = [self.int()?, self.int()?];
                    for _ in 0..self.size()? {
                        self.int()?;
                    }
                    if parent_dimension == 3 {
                        volume = volumes.get(&parent).copied().unwrap_or(Volume { tag: parent, physical: 0 });
                    }
                }
                for _ in 0..if dimension == 0 { 3 } else { 6 } {
                    self.real()?;
                }
                for i in 0..self.size()? {
                    let group = self.int()?;
                    if i == 0 {
                        volume.physical = group;
                    }
                    several |= dimension == 3 && i > 0;
                }
                for _ in 0..if dimension == 0 { 0 } else { self.size()? } {
                    self.int()?;
                }
                if dimension == 3 {
                    volumes.insert(tag, volume);
                }
            }
        }
        Ok(several)
    }

    /// Elements of version 4.1: blocks of one entity and type, each element its number and nodes. `volumes` as
    /// [`Reader::entities_4`] finds them.
    fn elements_4(&mut self, sections: &mut Sections, volumes: &HashMap<i64, Volume>) -> Result<(), MeshError> {
        let [blocks, _, _, _] = [self.size()?, self.size()?, self.size()?, self.size()?];
        for _ in 0..blocks {
            let [_, entity, kind] = [self.int()?, self.int()?, self.int()?];
            let Volume { tag, physical } = volumes.get(&entity).copied().unwrap_or(Volume { tag: entity, physical: 0 });
            for _ in 0..self.size()? {
                let number = self.size()?;
                let cell = self.cell(kind, Reader::size)?;
                sections.add(cell, number, physical, tag);
            }
        }
        Ok(())
    }

    /// An element of type `kind`, each of whose nodes is read by `node`.
    fn cell(&mut self, kind: i64, node: fn(&mut Self) -> Result<i64, MeshError>) -> Result<Cell, MeshError> {
        let index = kind.checked_sub(1).and_then(|i| usize::try_from(i).ok());
        match (kind, index.and_then(|i| NODES_OF_TYPE.get(i))) {
            (TETRAHEDRON, _) => Ok(Cell::Tetrahedron([node(self)?, node(self)?, node(self)?, node(self)?])),
            (TRIANGLE | QUADRANGLE, Some(&nodes)) => {
                (0..nodes).map(|_| node(self)).collect::<Result<_, _>>().map(Cell::Polygon)
            }
            (_, Some(&nodes)) if LINES.contains(&kind) => {
                for _ in 0..nodes {
                    node(self)?;
                }
                Ok(Cell::Other)
            }
            _ => Err(MeshError::Unsupported {
                what: format!("an element of Gmsh type {kind}"),
                remedy: "mesh the body with tetrahedra of 4 nodes (first order)",
            }),
        }
    }
}

impl Sections {
    fn add(&mut self, cell: Cell, number: i64, physical: i64, elementary: i64) {
        match cell {
            Cell::Tetrahedron(nodes) => self.tetrahedra.push(Tetrahedron { number, nodes, physical, elementary }),
            Cell::Polygon(nodes) => self.polygons.push((number, nodes)),
            Cell::Other => {}
        }
    }
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;
    use crate::geometry::mesh_io::{LengthUnit, Solid, parse, parse_surface, parse_tet_mesh};
    use palpate_core::geometry::TetMesh;
    use palpate_core::geometry::primitives::{box_mesh, box_surface};
    use palpate_core::math::Vec3;
    use std::fmt::Write;
    use std::path::Path;

    pub(in crate::geometry) fn msh(bytes: &[u8]) -> Result<TetMesh, MeshError> {
        parse_tet_mesh(Path::new("a.msh"), bytes, LengthUnit::Metre)
    }

    /// Numbers as a MSH file writes them.
    struct MshWriter {
        bytes: Vec<u8>,
        encoding: Encoding,
    }

    impl MshWriter {
        fn new(version: &str, encoding: Encoding) -> Self {
            let mut file = MshWriter { bytes: Vec::new(), encoding };
            file.line(&format!("$MeshFormat\n{version} {} 8", i32::from(encoding != Encoding::Text)));
            if encoding != Encoding::Text {
                file.ints(&[1]);
                file.line("");
            }
            file.line("$EndMeshFormat\n$PhysicalNames\n1\n3 1 \"organ\"\n$EndPhysicalNames");
            file
        }
        fn line(&mut self, text: &str) {
            self.bytes.extend(text.bytes().chain([b'\n']));
        }
        fn put(&mut self, text: String, mut raw: Vec<u8>) {
            match self.encoding {
                Encoding::Text => raw = text.into_bytes(),
                Encoding::LittleEndian => {}
                Encoding::BigEndian => raw.reverse(),
            }
            self.bytes.extend(raw);
        }
        fn ints(&mut self, numbers: &[i32]) {
            numbers.iter().for_each(|n| self.put(format!("{n} "), n.to_le_bytes().to_vec()));
        }
        fn sizes(&mut self, numbers: &[usize]) {
            numbers.iter().for_each(|n| self.put(format!("{n}\n"), n.to_le_bytes().to_vec()));
        }
        fn position(&mut self, p: &Vec3) {
            p.iter().for_each(|c| self.put(format!("{c:?} "), c.to_le_bytes().to_vec()));
        }
    }

    pub(in crate::geometry) fn msh_1(mesh: &TetMesh) -> Vec<u8> {
        let mut text = format!("$NOD\n{}\n", mesh.nodes.len());
        for (i, p) in mesh.nodes.iter().enumerate() {
            writeln!(text, "{} {} {} {}", i + 1, p.x, p.y, p.z).unwrap();
        }
        writeln!(text, "$ENDNOD\n$ELM\n{}\n1 2 0 0 3 1 2 3", mesh.elements.len() + 1).unwrap();
        for (i, e) in mesh.elements.iter().enumerate() {
            let [a, b, c, d] = e.map(|n| n + 1);
            writeln!(text, "{} 4 1 1 4 {a} {b} {c} {d}", i + 2).unwrap();
        }
        (text + "$ENDELM\n").into_bytes()
    }

    pub(in crate::geometry) fn msh_2(mesh: &TetMesh, encoding: Encoding) -> Vec<u8> {
        let mut file = MshWriter::new("2.2", encoding);
        file.line(&format!("$Nodes\n{}", mesh.nodes.len()));
        for (i, p) in mesh.nodes.iter().enumerate() {
            file.ints(&[i as i32 + 1]);
            file.position(p);
        }
        let n_elements = mesh.elements.len() as i32;
        file.line(&format!("\n$EndNodes\n$Elements\n{}", n_elements + 1));
        let text = encoding == Encoding::Text;
        file.ints(if text { &[1, 2, 2, 7, 7, 1, 2, 3] } else { &[2, 1, 2, 1, 7, 7, 1, 2, 3] });
        if !text {
            file.ints(&[4, n_elements, 2]);
        }
        for (i, e) in mesh.elements.iter().enumerate() {
            file.ints(&[i as i32 + 2]);
            file.ints(if text { &[4, 2, 7, 7] } else { &[7, 7] });
            file.ints(&e.map(|n| n as i32 + 1));
        }
        file.line("\n$EndElements");
        file.bytes
    }

    /// With a parametric block for the first node, as Gmsh writes nodes on a curve.
    fn msh_4(mesh: &TetMesh, encoding: Encoding) -> Vec<u8> {
        let mut file = MshWriter::new("4.1", encoding);
        let n_nodes = mesh.nodes.len();
        file.line("$Nodes");
        file.sizes(&[2, n_nodes, 1, n_nodes]);
        file.ints(&[1, 5, 1]);
        file.sizes(&[1, 1]);
        file.position(&mesh.nodes[0]);
        file.put("0.5\n".into(), 0.5f64.to_le_bytes().to_vec());
        file.ints(&[3, 1, 0]);
        file.sizes(&[n_nodes - 1]);
        (2..=n_nodes).for_each(|tag| file.sizes(&[tag]));
        mesh.nodes[1..].iter().for_each(|p| file.position(p));
        file.line("\n$EndNodes\n$Elements");
        file.sizes(&[2, mesh.elements.len() + 1, 1, mesh.elements.len() + 1]);
        file.ints(&[2, 1, 2]);
        file.sizes(&[1, 1, 1, 2, 3]);
        file.ints(&[3, 1, 4]);
        file.sizes(&[mesh.elements.len()]);
        for (i, e) in mesh.elements.iter().enumerate() {
            file.sizes(&[i + 2]);
            file.sizes(&e.map(|n| n as usize + 1));
        }
        file.line("\n$EndElements");
        file.bytes
    }

    pub(in crate::geometry) fn every_msh(mesh: &TetMesh) -> Vec<Vec<u8>> {
        let encodings = [Encoding::Text, Encoding::LittleEndian, Encoding::BigEndian];
        let mut files = vec![msh_1(mesh)];
        files.extend(encodings.into_iter().flat_map(|encoding| [msh_2(mesh, encoding), msh_4(mesh, encoding)]));
        files
    }

    #[test]
    fn a_box_mesh_comes_back_from_every_msh_version_and_encoding() {
        let mesh = box_mesh(Vec3::new(0.1, 0.2, 0.3), [2, 1, 2]);
        for file in every_msh(&mesh) {
            assert_eq!(msh(&file).unwrap(), mesh, "{}", shown(&file));
        }
    }

    #[test]
    fn nodes_without_tetrahedron_and_tetrahedra_listed_twice_are_dropped() {
        let mesh = box_mesh(Vec3::repeat(1.0), [1, 1, 1]);
        let mut more = mesh.clone();
        more.nodes.insert(0, Vec3::repeat(7.0));
        more.elements.iter_mut().flatten().for_each(|n| *n += 1);
        let [a, b, c, d] = more.elements[0];
        more.elements.push([b, c, a, d]);
        for file in every_msh(&more) {
            assert_eq!(msh(&file).unwrap(), mesh);
        }
    }

    #[test]
    fn parts_of_a_partitioned_mesh_bear_the_groups_of_their_volumes() {
        let mesh = box_mesh(Vec3::repeat(1.0), [1; 3]);
        let nodes: String = mesh.nodes.iter().map(|p| format!("{} {} {}\n", p.x, p.y, p.z)).collect();
        let tags: String = (1..=8).map(|n| format!("{n}\n")).collect();
        let box_of = "0 0 0 1 1 1";
        let mut text = format!(
            "$MeshFormat\n4.1 0 8\n$EndMeshFormat\n$Entities\n0 0 0 2\n1 {box_of} 1 70 0\n2 {box_of} 2 80 90 0\n$EndEntities\n\
             $PartitionedEntities\n2\n1\n9 2\n0 0 0 3\n3 3 1 1 1 {box_of} 1 70 0\n4 3 2 1 2 {box_of} 0 0\n5 3 2 2 1 2 {box_of} 1 85 0\n\
             $EndPartitionedEntities\n$Nodes\n1 8 1 8\n3 3 0 8\n{tags}{nodes}$EndNodes\n$Elements\n3 6 1 6\n"
        );
        for (part, elements) in [(3, 0..2), (4, 2..4), (5, 4..6)] {
            writeln!(text, "3 {part} 4 2").unwrap();
            for e in elements {
                let [a, b, c, d] = mesh.elements[e].map(|n| n + 1);
                writeln!(text, "{} {a} {b} {c} {d}", e + 1).unwrap();
            }
        }
        let files = [("a.msh".into(), (text + "$EndElements\n").into_bytes())];
        for (wanted, labels) in [(None, [70, 70, 80, 80, 85, 85]), (Some("elementary"), [1, 1, 2, 2, 2, 2])] {
            let (Solid::Volume(found), repairs) = parse(&files, LengthUnit::Metre, 0.0, wanted).unwrap() else {
                panic!()
            };
            assert_eq!(found.labels.of, labels);
            assert!(repairs.notes[0].contains("several physical groups"), "{repairs:?}");
        }
    }

    #[test]
    fn triangles_alone_are_a_surface() {
        let cube = box_surface(Vec3::repeat(1.0), [1; 3]);
        let corners: String =
            cube.vertices.iter().zip(1..).map(|(p, n)| format!("{n} {} {} {}\n", p.x, p.y, p.z)).collect();
        let faces = |([a, b, c], n): (&[u32; 3], usize)| format!("{n} 2 2 1 1 {} {} {}\n", a + 1, b + 1, c + 1);
        let faces: String = cube.triangles.iter().zip(1..).map(faces).collect();
        let text = format!(
            "$MeshFormat\n2.2 0 8\n$EndMeshFormat\n$Nodes\n8\n{corners}$EndNodes\n$Elements\n12\n{faces}$EndElements\n"
        );
        assert_eq!(parse_surface(Path::new("a.msh"), text.as_bytes(), LengthUnit::Metre).unwrap(), cube);
    }

    #[test]
    fn a_msh_file_that_cannot_be_used_says_why() {
        let mesh = box_mesh(Vec3::repeat(1.0), [1, 1, 1]);
        let text = String::from_utf8(msh_2(&mesh, Encoding::Text)).unwrap();
        let says = |file: String, expected: &str| {
            let message = msh(file.as_bytes()).unwrap_err().to_string();
            assert!(message.contains(expected), "{message}");
        };
        says(text.replace("2.2 0 8", "4.0 0 8"), "version 4.0 cannot be read: save it from Gmsh as version 4.1");
        says(text.replace("2.2 0 8", "2.2 1 8"), "byte order");
        says(text.replace("7 4 2 7 7", "7 11 2 7 7"), "Gmsh type 11");
        says(text.replace("$Elements\n7", "$Elements\n8"), "line 15: '$EndElements' is no number");
        says(text.replace("$Elements\n7", "$Elements\n6"), "expected the end of $Elements");
        says(text.replace("$Nodes\n8\n1 ", "$Nodes\n8\n2 "), "node 2 is defined twice");
        says(text.replace("$Nodes\n8\n1 ", "$Nodes\n8\n9 "), "refers to vertex 1,");
        says("$MeshFormat\n2.2 0 8\n$EndMeshFormat\n".into(), "no tetrahedra or triangles");
        says("$Nodes\n0\n$EndNodes\n".into(), "$MeshFormat must come first");
    }
}
