//! Abaqus input files (`.inp`), which CalculiX and Gmsh write, too: nodes, tetrahedra and triangles of a flat file or of one
//! part.

use super::cells::Cells;
use super::mesh_error::{MeshError, shown};
use super::reader::no_number;
use palpate_core::math::Real;
use std::collections::{BTreeMap, HashMap, HashSet};

const FORMAT: &str = "Abaqus";
/// What is to be done about what is put together from elsewhere.
const FLAT: &str = "write it as one flat file, with one part and no generated nodes or elements";
/// What is to be done about elements of other kinds.
const FIRST_ORDER: &str = "mesh the body with tetrahedra of 4 nodes (C3D4)";

/// A line of keywords: `*ELEMENT, TYPE=C3D4, ELSET=LIVER`, in capitals.
struct Keywords {
    name: String,
    parameters: BTreeMap<String, String>,
}

impl Keywords {
    fn of(line: &str) -> Self {
        let upper = line.to_uppercase();
        let mut words = upper.split(',').map(str::trim);
        let name = words.next().unwrap_or_default().split_whitespace().collect::<Vec<_>>().join(" ");
        let parameter = |word: &str| {
            let (key, value) = word.split_once('=').unwrap_or((word, ""));
            (key.trim().to_owned(), value.trim().trim_matches('\u{22}').to_owned())
        };
        Self { name, parameters: words.map(parameter).collect() }
    }

    fn parameter(&self, key: &str) -> &str {
        self.parameters.get(key).map_or("", String::as_str)
    }
}

/// What an element is here.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Kind {
    Tetrahedron,
    Polygon(usize),
    /// A line, a spring or a mass, of which no surface or volume is made.
    None,
}

impl Kind {
    /// That of elements of `type`.
    fn of(name: &str) -> Option<Self> {
        let starts = |names: &[&str]| names.iter().any(|start| name.starts_with(start));
        // Shells, membranes, rigid facets, and the plane elements that Gmsh writes for boundaries, by their nodes.
        let flat = ["S", "M3D", "R3D", "SFM3D", "STRI", "DS", "CPS", "CPE", "CAX", "F3D"];
        let of_nodes = |nodes: char| {
            flat.iter().any(|start| {
                let rest = name.strip_prefix(start).and_then(|rest| rest.strip_prefix(nodes));
                rest.is_some_and(|rest| !rest.starts_with(|c: char| c.is_ascii_digit()))
            })
        };
        let linear = |start: &str| {
            let rest = name.strip_prefix(start);
            rest.is_some_and(|rest| !rest.starts_with(|c: char| c.is_ascii_digit()))
        };
        match () {
            () if ["C3D4", "DC3D4", "AC3D4", "Q3D4"].into_iter().any(linear) => Some(Self::Tetrahedron),
            () if of_nodes('3') => Some(Self::Polygon(3)),
            () if of_nodes('4') => Some(Self::Polygon(4)),
            () if starts(&["T2D", "T3D", "B2", "B3", "R2D", "RB", "MASS", "SPRING", "DASHPOT", "CONN", "ROTARYI"]) => {
                Some(Self::None)
            }
            () => None,
        }
    }
}

/// What data lines after a line of keywords are.
enum Section {
    Nodes,
    Elements {
        kind: Kind,
        sets: Vec<String>,
    },
    /// Numbers of elements, or of the first and last of some, and a step.
    Set {
        name: String,
        generate: bool,
    },
    Other,
    /// A place of an instance, which is not known here.
    Instance,
}

/// A file on its way to [`Cells`].
#[derive(Default)]
struct InputFile {
    cells: Cells,
    node_of: HashMap<i64, u32>,
    /// Elements of each set, in the order in which the sets come.
    sets: Vec<(String, HashSet<i64>)>,
    /// Sets that sections give a material.
    sections: Vec<String>,
    parts: usize,
    instances: usize,
}

/// Nodes, tetrahedra and polygons. Labels are `section`, by the sets to which sections give materials, and `elset`, by the
/// sets that elements are listed in, each numbered from 1 in the order of the file.
pub(super) fn parse_inp(bytes: &[u8]) -> Result<Cells, MeshError> {
    let text = String::from_utf8_lossy(bytes);
    let mut file = InputFile { cells: Cells { indexed: true, ..Cells::default() }, ..InputFile::default() };
    let mut section = Section::Other;
    // The words of an element may go on in the next line, after a comma.
    let mut unfinished: Vec<&str> = Vec::new();
    for (line, number) in text.lines().zip(1..) {
        let line = line.trim();
        if line.is_empty() || line.starts_with("**") {
            continue;
        }
        if let Some(keywords) = line.strip_prefix('*') {
            if !unfinished.is_empty() {
                return Err(wrong(number, "the element before it has too few nodes: it was cut off".into()));
            }
            section = file.section(&Keywords::of(keywords), number)?;
            continue;
        }
        let words = line.split(',').map(str::trim).filter(|word| !word.is_empty());
        match &section {
            Section::Nodes => file.node(&words.collect::<Vec<_>>(), number)?,
            Section::Elements { kind, sets } => {
                unfinished.extend(words);
                let nodes = match kind {
                    Kind::Tetrahedron => 4,
                    Kind::Polygon(corners) => *corners,
                    Kind::None => 0,
                };
                if nodes == 0 || unfinished.len() > nodes {
                    let words = std::mem::take(&mut unfinished);
                    file.element(*kind, &words, sets, number)?;
                }
            }
            Section::Set { name, generate } => file.list(name, *generate, &words.collect::<Vec<_>>(), number)?,
            Section::Instance => {
                let what = "an instance that is moved or turned".to_owned();
                return Err(MeshError::Unsupported { what, remedy: FLAT });
            }
            Section::Other => {}
        }
    }
    if !unfinished.is_empty() {
        return Err(MeshError::Syntax { format: FORMAT, line: None, what: "it ends within an element".into() });
    }
    file.label();
    Ok(file.cells)
}

fn wrong(line: usize, what: String) -> MeshError {
    MeshError::Syntax { format: FORMAT, line: Some(line), what }
}

fn number<T: std::str::FromStr>(word: &str, line: usize) -> Result<T, MeshError> {
    word.parse().map_err(|_| wrong(line, no_number(word.as_bytes())))
}

impl InputFile {
    /// What comes after a line of keywords.
    fn section(&mut self, keywords: &Keywords, line: usize) -> Result<Section, MeshError> {
        let refused = |what: String| Err(MeshError::Unsupported { what, remedy: FLAT });
        match keywords.name.as_str() {
            "NODE" => match keywords.parameter("SYSTEM") {
                "" | "R" => Ok(Section::Nodes),
                system => refused(format!("a file with nodes in coordinates of kind {}", shown(system.as_bytes()))),
            },
            "ELEMENT" => {
                let name = keywords.parameter("TYPE");
                let Some(kind) = Kind::of(name) else {
                    let what = format!("an element of type '{}' (line {line})", shown(name.as_bytes()));
                    return Err(MeshError::Unsupported { what, remedy: FIRST_ORDER });
                };
                let set = keywords.parameter("ELSET");
                let sets = if set.is_empty() { vec![] } else { vec![set.to_owned()] };
                Ok(Section::Elements { kind, sets })
            }
            "ELSET" => {
                let generate = keywords.parameters.contains_key("GENERATE");
                Ok(Section::Set { name: keywords.parameter("ELSET").to_owned(), generate })
            }
            "SOLID SECTION" => {
                self.sections.push(keywords.parameter("ELSET").to_owned());
                Ok(Section::Other)
            }
            "PART" => {
                self.parts += 1;
                if self.parts > 1 { refused("a file of several parts".into()) } else { Ok(Section::Other) }
            }
            "INSTANCE" => {
                self.instances += 1;
                if self.instances > 1 { refused("a file of several instances".into()) } else { Ok(Section::Instance) }
            }
            "INCLUDE" => {
                let other = shown(keywords.parameter("INPUT").as_bytes());
                refused(format!("the rest of the mesh, which is in another file ({other}),"))
            }
            name @ ("NGEN" | "NFILL" | "NCOPY" | "NMAP" | "ELGEN" | "ELCOPY" | "SYSTEM") => {
                refused(format!("a file with *{name}"))
            }
            _ => Ok(Section::Other),
        }
    }

    fn node(&mut self, words: &[&str], line: usize) -> Result<(), MeshError> {
        let [node, rest @ ..] = words else { return Ok(()) };
        let node: i64 = number(node, line)?;
        let mut point = [0.0; 3];
        for (coordinate, word) in point.iter_mut().zip(rest) {
            *coordinate = number::<Real>(word, line)?;
        }
        if self.node_of.insert(node, self.cells.points.len() as u32).is_some() {
            return Err(wrong(line, format!("node {node} is defined twice")));
        }
        self.cells.points.push(point);
        Ok(())
    }

    fn element(&mut self, kind: Kind, words: &[&str], sets: &[String], line: usize) -> Result<(), MeshError> {
        if kind == Kind::None {
            return Ok(());
        }
        let element: i64 = number(words[0], line)?;
        let mut corners = Vec::new();
        for word in &words[1..] {
            let node: i64 = number(word, line)?;
            let missing = MeshError::BadIndex { cell: "element", number: element, index: node };
            corners.push(*self.node_of.get(&node).ok_or(missing)?);
        }
        match (kind, corners.as_slice()) {
            (Kind::Tetrahedron, &[a, b, c, d]) => {
                self.cells.tetrahedra.push((element, [a, b, c, d]));
                sets.iter().for_each(|set| _ = self.set(set).insert(element));
            }
            (Kind::Polygon(count), corners) if corners.len() == count => self.cells.polygon(corners)?,
            _ => return Err(wrong(line, format!("element {element} has {} nodes", corners.len()))),
        }
        Ok(())
    }

    /// The elements of the set `name`.
    fn set(&mut self, name: &str) -> &mut HashSet<i64> {
        let at = self.sets.iter().position(|(known, _)| known == name).unwrap_or_else(|| {
            self.sets.push((name.to_owned(), HashSet::new()));
            self.sets.len() - 1
        });
        &mut self.sets[at].1
    }

    /// Adds to the set `name` the elements, or the elements of other sets, that a line lists.
    fn list(&mut self, name: &str, generate: bool, words: &[&str], line: usize) -> Result<(), MeshError> {
        if generate {
            let [first, last] = [0, 1].map(|i| words.get(i).copied().unwrap_or_default());
            let [first, last]: [i64; 2] = [number(first, line)?, number(last, line)?];
            let step: i64 = words.get(2).map_or(Ok(1), |word| number(word, line))?;
            // No more than there are elements.
            let there: Vec<i64> = (self.cells.tetrahedra.iter().map(|(element, _)| *element))
                .filter(|element| (first..=last).contains(element) && (element - first) % step.max(1) == 0)
                .collect();
            self.set(name).extend(there);
            return Ok(());
        }
        for word in words {
            if let Ok(element) = word.parse::<i64>() {
                self.set(name).insert(element);
            } else {
                let other = word.trim_matches('\u{22}').to_uppercase();
                let known = self.sets.iter().find(|(known, _)| *known == other);
                let known =
                    known.ok_or_else(|| wrong(line, format!("there is no set '{}'", shown(other.as_bytes()))))?;
                let elements = known.1.clone();
                self.set(name).extend(elements);
            }
        }
        Ok(())
    }

    /// Labels the tetrahedra by sections and by sets, and says which number stands for which.
    fn label(&mut self) {
        let (sets, sections) = (std::mem::take(&mut self.sets), std::mem::take(&mut self.sections));
        let holds_some =
            |(_, own): &&(String, HashSet<i64>)| self.cells.tetrahedra.iter().any(|(element, _)| own.contains(element));
        let all: Vec<&(String, HashSet<i64>)> = sets.iter().filter(holds_some).collect();
        let with_section = all.iter().copied().filter(|(name, _)| sections.contains(name)).collect();
        for (label, sets) in [("section", with_section), ("elset", all)] {
            if sets.is_empty() {
                continue;
            }
            // 0 stands for no set, the first counts for an element of several.
            let of = |(element, _): &(i64, [u32; 4])| {
                sets.iter().position(|(_, own)| own.contains(element)).map_or(0.0, |set| set as Real + 1.0)
            };
            let numbers: Vec<Real> = self.cells.tetrahedra.iter().map(of).collect();
            let named: Vec<String> =
                sets.iter().zip(1..).map(|((name, _), n)| format!("{n} is {}", shown(name.as_bytes()))).collect();
            let overlap =
                self.cells.tetrahedra.iter().any(|(e, _)| sets.iter().filter(|s| s.1.contains(e)).count() > 1);
            let several = if overlap { "; of an element in several the first counts" } else { "" };
            self.cells.notes.push(format!("labels '{label}': {}{several}", named.join(", ")));
            self.cells.label(label, numbers.into_iter());
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

    pub(in crate::geometry) fn inp<const N: usize>(points: &[Vec3], kind: &str, cells: &[[u32; N]]) -> String {
        let mut text = "*Heading\n a box\n** of six\n*NODE, NSET=ALL\n".to_owned();
        for (p, n) in points.iter().zip(1..) {
            writeln!(text, "{n}, {}, {},{}", p.x, p.y, p.z).unwrap();
        }
        text += "*ELEMENT, TYPE=T3D2, ELSET=EDGES\n1, 1, 2\n";
        writeln!(text, "*Element, type={kind}, elset=Organ").unwrap();
        for (cell, e) in cells.iter().zip(2..) {
            let nodes: Vec<String> = cell.iter().map(|n| (n + 1).to_string()).collect();
            writeln!(text, "{e}, {}", nodes.join(", ")).unwrap();
        }
        text + "*MATERIAL, NAME=SOFT\n*ELASTIC\n5e3, 0.45\n"
    }

    fn volume(text: &str) -> Result<TetMesh, MeshError> {
        parse_tet_mesh(Path::new("a.inp"), text.as_bytes(), LengthUnit::Metre)
    }

    #[test]
    fn boxes_come_back_from_abaqus() {
        let mesh = box_mesh(Vec3::new(0.1, 0.2, 0.3), [2, 1, 2]);
        let text = inp(&mesh.nodes, "C3D4", &mesh.elements);
        assert_eq!(volume(&text).unwrap(), mesh);
        let [a, b, c, d] = mesh.elements[0].map(|n| n + 1);
        let cut = text.replace(&format!("\n2, {a}, {b}, {c}, {d}\n"), &format!("\n2, {a}, {b},\n{c}, {d}\n"));
        assert_ne!(cut, text);
        assert_eq!(volume(&cut).unwrap(), mesh);
        let cube = box_surface(Vec3::new(0.1, 0.2, 0.3), [2, 1, 2]);
        let text = inp(&cube.vertices, "S3", &cube.triangles);
        assert_eq!(parse_surface(Path::new("a.inp"), text.as_bytes(), LengthUnit::Metre).unwrap(), cube);
    }

    #[test]
    fn sets_and_sections_label_the_elements() {
        let mesh = box_mesh(Vec3::repeat(0.1), [1; 3]);
        let text = inp(&mesh.nodes, "C3D4", &mesh.elements);
        let labels = |more: &str, called| {
            let files = [("a.inp".into(), (text.clone() + more).into_bytes())];
            let (Solid::Volume(found), repairs) = parse(&files, LengthUnit::Metre, 0.0, called).unwrap() else {
                panic!()
            };
            (found.labels.name, found.labels.of, repairs.notes.join("; "))
        };
        let (name, of, notes) = labels("", None);
        assert_eq!((name.as_str(), &of[..]), ("elset", &[1; 6][..]));
        assert!(notes.contains("1 is ORGAN"), "{notes}");
        let more = "*ELSET, ELSET=A, GENERATE\n2, 6, 2\n*ELSET, ELSET=B\n3, 5,\n7\n*SOLID SECTION, ELSET=A, MATERIAL=X\n\
                    *SOLID SECTION, ELSET=B, MATERIAL=Y\n";
        let (name, of, notes) = labels(more, None);
        assert_eq!((name.as_str(), &of[..]), ("section", &[1, 2, 1, 2, 1, 2][..]));
        assert!(notes.contains("1 is A, 2 is B"), "{notes}");
    }

    #[test]
    fn an_abaqus_file_that_cannot_be_used_says_where_and_why() {
        let mesh = box_mesh(Vec3::repeat(1.0), [1; 3]);
        let text = inp(&mesh.nodes, "C3D4", &mesh.elements);
        let says = |text: String, expected: &str| {
            let message = volume(&text).unwrap_err().to_string();
            assert!(message.contains(expected), "{message}");
        };
        for kind in ["C3D8R", "C3D10", "S8R", "C3D6", ""] {
            says(text.replace("C3D4", kind), &format!("an element of type '{kind}' (line 15) cannot be read"));
        }
        says(format!("*PART, NAME=A\n{text}*PART, NAME=B\n"), "several parts");
        says(format!("{text}*INSTANCE, NAME=A, PART=B\n1, 0, 0\n"), "moved or turned");
        says(format!("{text}*INCLUDE, INPUT=mesh.inp\n"), "in another file (MESH.INP)");
        says(text.replace("\n1, 0, 0,0\n", "\n2, 0, 0,0\n"), "line 6: node 2 is defined twice");
        says(text.replace("\n1, 0, 0,0\n", "\n1, 0, x,0\n"), "line 5: 'x' is no number");
        says(text.replace("\n2, 1, ", "\n2, 9, "), "element 2 refers to vertex 9");
        says(
            text.split("*MATERIAL").next().unwrap().trim_end_matches(|c: char| c != ',').into(),
            "ends within an element",
        );
    }
}
