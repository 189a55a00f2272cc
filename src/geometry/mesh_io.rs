//! Mesh files: bytes in, shapes in metres out.
//!
//! | file | holds | read |
//! |---|---|---|
//! | `.obj` | surface | positions and faces; polygons become fans of triangles; all objects make one surface |
//! | `.stl` | surface | binary or text; all solids make one surface |
//! | `.msh` | tetrahedra | Gmsh 4.1 and 2.x, binary or text; Gmsh 1 (`$NOD`, `$ELM`) |
//!
//! Bytes are not trusted: whatever they say, a reader answers with a shape or a [`MeshError`], in memory proportional
//! to the bytes there are. Nothing here touches the file system except the two functions whose names begin with
//! `read_`. Numbers of vertices, triangles and elements in errors count from 1, as people do.

use super::tet_mesh::volume;
use super::{Surface, TetMesh};
use crate::math::{Real, Vec3};
use serde::{Deserialize, Serialize};
use std::collections::{HashMap, HashSet};
use std::io::Read;
use std::path::{Path, PathBuf};

/// Longest file read [bytes]; a surface that moves in real time needs a hundredth of it.
pub const MAX_FILE: usize = 128 << 20;
/// Most triangles read; only the polygons of an OBJ file can make so many from so few bytes.
const MAX_TRIANGLES: usize = 8_000_000;
/// Coordinates beyond this [m] are taken for damage or a wrong unit.
const MAX_COORDINATE: Real = 1e6;
/// Smallest volume of a tetrahedron over its longest edge cubed, and of a surface over its extent cubed; rounding alone
/// reaches 1e-15.
const FLAT: Real = 1e-12;
/// Share of the volume [1] that decimation may add or take away.
const VOLUME_TOLERANCE: Real = 0.02;
/// Distance decimation may move the surface, over the largest extent [1].
const DECIMATION_ERROR: f32 = 0.02;

/// The unit of length in which a file was written; mesh files do not say.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum LengthUnit {
    /// 1 m, written "m".
    #[serde(rename = "m")]
    Metre,
    /// 0.01 m, written "cm".
    #[serde(rename = "cm")]
    Centimetre,
    /// 0.001 m, written "mm".
    #[serde(rename = "mm")]
    Millimetre,
    /// 0.0254 m, written "in".
    #[serde(rename = "in")]
    Inch,
}

impl LengthUnit {
    /// One unit in metres.
    pub fn metres(self) -> Real {
        match self {
            LengthUnit::Metre => 1.0,
            LengthUnit::Centimetre => 0.01,
            LengthUnit::Millimetre => 0.001,
            LengthUnit::Inch => 0.0254,
        }
    }
}

impl std::str::FromStr for LengthUnit {
    type Err = MeshError;

    fn from_str(text: &str) -> Result<Self, MeshError> {
        match text {
            "m" => Ok(LengthUnit::Metre),
            "cm" => Ok(LengthUnit::Centimetre),
            "mm" => Ok(LengthUnit::Millimetre),
            "in" => Ok(LengthUnit::Inch),
            _ => Err(MeshError::UnknownUnit { given: text.to_owned() }),
        }
    }
}

/// What is wrong with a mesh, where, and what to do about it.
#[derive(Debug, thiserror::Error)]
#[allow(missing_docs, reason = "the message of each variant names its fields")]
pub enum MeshError {
    #[error("cannot read {}: {reason}", path.display())]
    Io { path: PathBuf, reason: std::io::Error },
    #[error("{}: this kind of file is not read here; {reads}", path.display())]
    UnknownFormat { path: PathBuf, reads: &'static str },
    #[error("'{given}' is no unit of length: write m, cm, mm or in")]
    UnknownUnit { given: String },
    #[error("the file holds more than {limit} {what}: decimate the mesh before loading it")]
    TooBig { limit: usize, what: &'static str },
    #[error("{format} file{}: {what}", line.map_or(String::new(), |n| format!(", line {n}")))]
    Syntax { format: &'static str, line: Option<usize>, what: String },
    #[error("{what} cannot be read: {remedy}")]
    Unsupported { what: String, remedy: &'static str },
    #[error("the mesh has no {what}: check that it was exported with its {what}")]
    Empty { what: &'static str },
    #[error("vertex {vertex} has a coordinate that is no number or lies beyond 1000 km: check the file and its unit")]
    NonFinite { vertex: usize },
    #[error(
        "{cell} {number} refers to vertex {index}, which the mesh does not have: the file is damaged, export it again"
    )]
    BadIndex { cell: &'static str, number: i64, index: i64 },
    #[error(
        "the surface is not closed: {border_edges} edges have a triangle on one side only, the first from {} to {}; \
         close its holes, in Blender with Mesh > Clean Up > Fill Holes",
        metres(from),
        metres(to)
    )]
    NotClosed { border_edges: usize, from: Vec3, to: Vec3 },
    #[error(
        "the surface meets itself: {edges} edges belong to more than two triangles, the first from {} to {}; \
         remove inner walls and doubled triangles, in Blender with Select > All by Trait > Non Manifold",
        metres(from),
        metres(to)
    )]
    NonManifold { edges: usize, from: Vec3, to: Vec3 },
    #[error(
        "neighbouring triangles face opposite ways across {edges} edges, the first from {} to {}; \
         turn them, in Blender with Mesh > Normals > Recalculate Outside",
        metres(from),
        metres(to)
    )]
    InconsistentOrientation { edges: usize, from: Vec3, to: Vec3 },
    #[error("the surface encloses no volume ({volume:e} m³): check that it is a body and not a sheet")]
    NoVolume { volume: Real },
    #[error(
        "{count} of {total} tetrahedra are inside out, the first is element {element} ({volume:e} m³) around {}; \
         swap two of its nodes, or mesh the body again",
        metres(at)
    )]
    Inverted { element: i64, volume: Real, at: Vec3, count: usize, total: usize },
    #[error("element {element} around {} is flat ({volume:e} m³): mesh the body again", metres(at))]
    Degenerate { element: i64, volume: Real, at: Vec3 },
}

/// A place as people read it.
fn metres(p: &Vec3) -> String {
    format!("({:.6}, {:.6}, {:.6}) m", p.x, p.y, p.z)
}

/// The closed surface in the `.obj` or `.stl` file at `path`, lengths in `unit`; see [`parse_surface`].
pub fn read_surface(path: &Path, unit: LengthUnit) -> Result<Surface, MeshError> {
    parse_surface(path, &read_bytes(path)?, unit)
}

/// The tetrahedra in the `.msh` file at `path`, lengths in `unit`; see [`parse_tet_mesh`].
pub fn read_tet_mesh(path: &Path, unit: LengthUnit) -> Result<TetMesh, MeshError> {
    parse_tet_mesh(path, &read_bytes(path)?, unit)
}

fn read_bytes(path: &Path) -> Result<Vec<u8>, MeshError> {
    let failed = |reason| MeshError::Io { path: path.to_owned(), reason };
    let mut bytes = Vec::new();
    let file = std::fs::File::open(path).map_err(failed)?;
    // One byte past the limit is enough for the parser to refuse the rest.
    file.take(MAX_FILE as u64 + 1).read_to_end(&mut bytes).map_err(failed)?;
    Ok(bytes)
}

/// The closed surface in `bytes`, lengths in `unit`; the extension of `name` tells the format.
///
/// Vertices at one place become one; triangles with two corners at one place and vertices in no triangle are dropped.
/// The result has passed [`check_closed`], so it faces outward.
pub fn parse_surface(name: &Path, bytes: &[u8], unit: LengthUnit) -> Result<Surface, MeshError> {
    let soup = match extension(name, bytes)?.as_str() {
        "obj" => parse_obj(bytes)?,
        "stl" => parse_stl(bytes)?,
        _ => return Err(MeshError::UnknownFormat { path: name.to_owned(), reads: "surfaces come as .obj or .stl" }),
    };
    let mut surface = weld(&in_metres(soup.vertices.into_iter(), unit)?, &soup.triangles);
    check_closed(&mut surface)?;
    Ok(surface)
}

/// The tetrahedra in `bytes`, lengths in `unit`; the extension of `name` tells the format.
///
/// Points, lines, triangles and quadrangles among the elements are ignored, tetrahedra listed twice count once, nodes
/// in no tetrahedron are dropped. A file whose tetrahedra are *all* inside out, be it a single one, merely numbers
/// nodes the other way round and is turned; when only some are, that is an error.
pub fn parse_tet_mesh(name: &Path, bytes: &[u8], unit: LengthUnit) -> Result<TetMesh, MeshError> {
    if extension(name, bytes)? != "msh" {
        return Err(MeshError::UnknownFormat { path: name.to_owned(), reads: "tetrahedra come as .msh" });
    }
    let mut file = MshReader { bytes, at: 0, encoding: Encoding::Text };
    let (nodes, elements) = file.mesh()?;
    let mut node_of_tag = HashMap::new();
    for (node, (tag, _)) in nodes.iter().enumerate() {
        if node_of_tag.insert(*tag, node as u32).is_some() {
            return Err(file.wrong(format!("node {tag} is defined twice")));
        }
    }
    let positions = nodes.into_iter().map(|(_, position)| position);
    let mut mesh = TetMesh { nodes: in_metres(positions, unit)?, elements: Vec::new() };
    let mut numbers = Vec::new();
    let mut seen = HashSet::new();
    for (number, tags) in elements {
        let mut element = [0; 4];
        for (node, tag) in element.iter_mut().zip(tags) {
            let missing = MeshError::BadIndex { cell: "element", number, index: tag };
            *node = *node_of_tag.get(&tag).ok_or(missing)?;
        }
        let mut key = element;
        key.sort_unstable();
        if seen.insert(key) {
            numbers.push(number);
            mesh.elements.push(element);
        }
    }
    mesh.nodes = keep_referenced(&mesh.nodes, &mut mesh.elements);
    orient(&mut mesh, &numbers)?;
    Ok(mesh)
}

/// Lower-case extension of `name`, once `bytes` are known not to be too many.
fn extension(name: &Path, bytes: &[u8]) -> Result<String, MeshError> {
    if bytes.len() > MAX_FILE {
        return Err(MeshError::TooBig { limit: MAX_FILE, what: "bytes" });
    }
    Ok(name.extension().map_or(String::new(), |e| e.to_string_lossy().to_lowercase()))
}

/// Positions as written, now in metres.
fn in_metres(positions: impl Iterator<Item = [Real; 3]>, unit: LengthUnit) -> Result<Vec<Vec3>, MeshError> {
    let scaled: Vec<Vec3> = positions.map(|p| Vec3::from(p) * unit.metres()).collect();
    check_finite(&scaled)?;
    Ok(scaled)
}

fn check_finite(vertices: &[Vec3]) -> Result<(), MeshError> {
    let fits = |p: &Vec3| p.iter().all(|c| c.abs() <= MAX_COORDINATE);
    vertices.iter().position(|p| !fits(p)).map_or(Ok(()), |v| Err(MeshError::NonFinite { vertex: v + 1 }))
}

/// Triangles as a file lists them, not yet connected.
#[derive(Default)]
struct Soup {
    /// In the file's unit, (n_vertices).
    vertices: Vec<[Real; 3]>,
    /// Valid indices into `vertices`, (n_triangles).
    triangles: Vec<[u32; 3]>,
}

/// Lines of a text file, numbered from 1, cut into words.
fn lines(text: &str) -> impl Iterator<Item = (usize, std::str::SplitWhitespace<'_>)> {
    text.lines().enumerate().map(|(i, line)| (i + 1, line.split_whitespace()))
}

/// The next three words as coordinates.
fn coordinates<'a>(words: &mut impl Iterator<Item = &'a str>) -> Option<[Real; 3]> {
    let mut next = || words.next()?.parse().ok();
    Some([next()?, next()?, next()?])
}

/// Positions and faces of an OBJ file; everything else in it is about looks.
fn parse_obj(bytes: &[u8]) -> Result<Soup, MeshError> {
    let wrong = |line, what: String| MeshError::Syntax { format: "OBJ", line: Some(line), what };
    let text = String::from_utf8_lossy(bytes);
    let mut soup = Soup::default();
    for (line, mut words) in lines(&text).filter(|(_, words)| words.clone().next() == Some("v")) {
        let position = coordinates(&mut words.by_ref().skip(1));
        soup.vertices.push(position.ok_or_else(|| wrong(line, "a vertex needs three numbers".into()))?);
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
                    if index < 0 || index >= soup.vertices.len() as i64 {
                        let count = soup.vertices.len();
                        return Err(wrong(line, format!("the face refers to vertex {number}, the file has {count}")));
                    }
                    corners.push(index as u32);
                }
                let [first, rest @ ..] = corners.as_slice() else {
                    return Err(wrong(line, "a face without corners".into()));
                };
                if soup.triangles.len() + rest.len() > MAX_TRIANGLES {
                    return Err(MeshError::TooBig { limit: MAX_TRIANGLES, what: "triangles" });
                }
                soup.triangles.extend(rest.windows(2).map(|pair| [*first, pair[0], pair[1]]));
            }
            _ => {}
        }
    }
    Ok(soup)
}

/// The triangles of an STL file, three vertices each.
///
/// The length tells binary from text, because binary headers, too, may begin with "solid". A text file never passes
/// for binary: four printable characters, read as a count, announce more triangles than fit in [`MAX_FILE`].
fn parse_stl(bytes: &[u8]) -> Result<Soup, MeshError> {
    let announced = bytes.get(80..84).and_then(|b| b.first_chunk()).map(|b| u32::from_le_bytes(*b) as usize);
    let (records, _) = bytes.get(84..).unwrap_or_default().as_chunks::<50>();
    let vertices = match announced.and_then(|n| records.get(..n)) {
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
    let triangles = (0..vertices.len() as u32 / 3).map(|t| [3 * t, 3 * t + 1, 3 * t + 2]).collect();
    Ok(Soup { vertices, triangles })
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

/// One vertex per place, no triangle with two corners at one place, no vertex without a triangle.
fn weld(vertices: &[Vec3], triangles: &[[u32; 3]]) -> Surface {
    let mut first_at = HashMap::new();
    let mut welded = Vec::new();
    let joined: Vec<u32> = vertices
        .iter()
        .map(|p| {
            // Adding zero turns −0 into 0: one place, two bit patterns.
            let bits: [u64; 3] = std::array::from_fn(|i| (p[i] + 0.0).to_bits());
            *first_at.entry(bits).or_insert_with(|| {
                welded.push(*p);
                welded.len() as u32 - 1
            })
        })
        .collect();
    let mut triangles: Vec<[u32; 3]> = triangles.iter().map(|t| t.map(|v| joined[v as usize])).collect();
    triangles.retain(|&[a, b, c]| a != b && b != c && c != a);
    let vertices = keep_referenced(&welded, &mut triangles);
    Surface { vertices, triangles }
}

/// The `points` that some cell refers to, in their old order; `cells` are renumbered to match. Indices must be valid.
pub(super) fn keep_referenced<const N: usize>(points: &[Vec3], cells: &mut [[u32; N]]) -> Vec<Vec3> {
    let mut new_index = vec![u32::MAX; points.len()];
    for &point in cells.as_flattened() {
        new_index[point as usize] = 0;
    }
    let mut kept = Vec::new();
    for (point, index) in points.iter().zip(&mut new_index).filter(|(_, index)| **index == 0) {
        *index = kept.len() as u32;
        kept.push(*point);
    }
    for point in cells.as_flattened_mut() {
        *point = new_index[*point as usize];
    }
    kept
}

/// A side of a triangle: its edge, the lower vertex first, and whether it runs that way.
type Side = ([u32; 2], bool);

/// Checks that `surface` encloses a body: every edge belongs to exactly two triangles that face the same side. When
/// the triangles face inward on the whole (negative volume), all are turned.
///
/// Several bodies, hollow bodies (the cavity faces inward) and handles pass, also bodies that touch in a vertex.
/// Self-intersection is not looked for.
///
/// # Errors
/// `Empty`, `BadIndex`, `NonFinite`, `NonManifold` (also for a triangle that has one vertex twice), `NotClosed`,
/// `InconsistentOrientation` or `NoVolume`; the surface is then unchanged.
pub fn check_closed(surface: &mut Surface) -> Result<(), MeshError> {
    if surface.triangles.is_empty() {
        return Err(MeshError::Empty { what: "triangles" });
    }
    let count = surface.vertices.len();
    for (t, triangle) in surface.triangles.iter().enumerate() {
        if let Some(&v) = triangle.iter().find(|&&v| v as usize >= count) {
            return Err(MeshError::BadIndex { cell: "triangle", number: t as i64 + 1, index: i64::from(v) + 1 });
        }
    }
    check_finite(&surface.vertices)?;

    let mut sides: Vec<Side> = surface
        .triangles
        .iter()
        .flat_map(|&[a, b, c]| [[a, b], [b, c], [c, a]])
        .map(|[a, b]| ([a.min(b), a.max(b)], a < b))
        .collect();
    sides.sort_unstable();
    // How many edges are wrong in one way, and the ends of the first.
    let find = |is_wrong: fn(&[Side]) -> bool| {
        let mut wrong = sides.chunk_by(|a, b| a.0 == b.0).filter(|edge| is_wrong(edge));
        wrong.next().map(|edge| (1 + wrong.count(), edge[0].0.map(|v| surface.vertices[v as usize])))
    };
    if let Some((edges, [from, to])) = find(|edge| edge.len() > 2 || edge[0].0[0] == edge[0].0[1]) {
        return Err(MeshError::NonManifold { edges, from, to });
    }
    if let Some((border_edges, [from, to])) = find(|edge| edge.len() == 1) {
        return Err(MeshError::NotClosed { border_edges, from, to });
    }
    if let Some((edges, [from, to])) = find(|edge| edge[0].1 == edge[1].1) {
        return Err(MeshError::InconsistentOrientation { edges, from, to });
    }

    let volume = surface.volume();
    let (low, high) = surface.bounds();
    let size = (high - low).norm();
    if volume.abs() <= FLAT * size * size * size {
        return Err(MeshError::NoVolume { volume });
    }
    if volume < 0.0 {
        surface.triangles.iter_mut().for_each(|t| t.swap(1, 2));
    }
    Ok(())
}

/// Makes all tetrahedra positive when all are negative; names the flat and the inverted ones otherwise by their
/// `numbers` in the file, (n_elements).
fn orient(mesh: &mut TetMesh, numbers: &[i64]) -> Result<(), MeshError> {
    if mesh.elements.is_empty() {
        return Err(MeshError::Empty { what: "tetrahedra" });
    }
    let total = mesh.elements.len();
    let mut inverted = Vec::new();
    for (e, &element) in numbers.iter().enumerate() {
        let u = mesh.corners(e);
        let volume = volume(&u);
        let at = (u[0] + u[1] + u[2] + u[3]) / 4.0;
        let edges = (0..4).flat_map(|i| (0..i).map(move |j| (u[i] - u[j]).norm()));
        let longest = edges.fold(0.0, Real::max);
        if volume.abs() <= FLAT * longest * longest * longest {
            return Err(MeshError::Degenerate { element, volume, at });
        }
        if volume < 0.0 {
            inverted.push((element, volume, at));
        }
    }
    let count = inverted.len();
    match inverted.first() {
        Some(&(element, volume, at)) if count < total => Err(MeshError::Inverted { element, volume, at, count, total }),
        Some(_) => {
            mesh.elements.iter_mut().for_each(|element| element.swap(2, 3));
            Ok(())
        }
        None => Ok(()),
    }
}

/// Nodes (tag, position in the file's unit) and tetrahedra (number, node tags) of a MSH file.
type MshMesh = (Vec<(i64, [Real; 3])>, Vec<(i64, [i64; 4])>);

/// How numbers are written in a MSH file.
#[derive(Clone, Copy, PartialEq)]
enum Encoding {
    Text,
    LittleEndian,
    BigEndian,
}

/// Walks through a MSH file. Counts in the file only bound loops that consume bytes: one that lies costs nothing.
struct MshReader<'a> {
    bytes: &'a [u8],
    /// First byte not yet read.
    at: usize,
    encoding: Encoding,
}

/// Nodes of a Gmsh element of type 1, 2, 3, ...
const NODES_OF_TYPE: [u8; 31] =
    [2, 3, 4, 4, 8, 6, 5, 3, 6, 9, 10, 27, 18, 14, 1, 8, 20, 15, 13, 9, 10, 12, 15, 15, 21, 4, 5, 6, 20, 35, 56];
/// The Gmsh type of the tetrahedron with four nodes.
const TETRAHEDRON: i64 = 4;
/// Gmsh types of hexahedra, prisms, pyramids and tetrahedra of higher order: leaving them out would leave holes.
const OTHER_SOLIDS: [i64; 13] = [5, 6, 7, 11, 12, 13, 14, 17, 18, 19, 29, 30, 31];

impl<'a> MshReader<'a> {
    fn wrong(&self, what: impl Into<String>) -> MeshError {
        let before = self.bytes.get(..self.at).unwrap_or_default();
        let line = (self.encoding == Encoding::Text).then(|| 1 + before.iter().filter(|&&b| b == b'\n').count());
        MeshError::Syntax { format: "MSH", line, what: what.into() }
    }

    /// The rest of the file.
    fn rest(&self) -> &'a [u8] {
        self.bytes.get(self.at..).unwrap_or_default()
    }

    fn skip_space(&mut self) {
        self.at += self.rest().len() - self.rest().trim_ascii_start().len();
    }

    /// Up to the end of the line, without space around it; steps over the line break.
    fn line(&mut self) -> &'a [u8] {
        let rest = self.rest();
        let length = rest.iter().position(|&b| b == b'\n').unwrap_or(rest.len());
        self.at += (length + 1).min(rest.len());
        rest[..length].trim_ascii()
    }

    /// The next number of a text file, or a word of a header.
    fn word<T: std::str::FromStr>(&mut self) -> Result<T, MeshError> {
        self.skip_space();
        let rest = self.rest();
        let word = &rest[..rest.iter().position(|b| b.is_ascii_whitespace()).unwrap_or(rest.len())];
        let value = std::str::from_utf8(word).ok().and_then(|w| w.parse().ok());
        let value = value.ok_or_else(|| self.wrong(format!("'{}' is no number", shown(word))))?;
        self.at += word.len();
        Ok(value)
    }

    /// The next `N` bytes of a binary file, least significant first.
    fn raw<const N: usize>(&mut self) -> Result<[u8; N], MeshError> {
        let mut bytes = *self.rest().first_chunk::<N>().ok_or_else(|| self.wrong("the file was cut off"))?;
        self.at += N;
        if self.encoding == Encoding::BigEndian {
            bytes.reverse();
        }
        Ok(bytes)
    }

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
    fn mesh(&mut self) -> Result<MshMesh, MeshError> {
        let (mut nodes, mut elements) = (Vec::new(), Vec::new());
        let mut version = None;
        loop {
            self.skip_space();
            if self.rest().is_empty() {
                return Ok((nodes, elements));
            }
            let name = self.line();
            match (name, version) {
                (b"$MeshFormat", _) => version = Some(self.format()?),
                (b"$NOD", _) => self.nodes_2(&mut nodes)?,
                (b"$ELM", _) => self.elements_1(&mut elements)?,
                (b"$Nodes", Some(2)) => self.nodes_2(&mut nodes)?,
                (b"$Elements", Some(2)) => self.elements_2(&mut elements)?,
                (b"$Nodes", Some(_)) => self.nodes_4(&mut nodes)?,
                (b"$Elements", Some(_)) => self.elements_4(&mut elements)?,
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
    fn elements_1(&mut self, elements: &mut Vec<(i64, [i64; 4])>) -> Result<(), MeshError> {
        for _ in 0..self.count_line()? {
            let [number, kind, _, _, _] = [self.int()?, self.int()?, self.int()?, self.int()?, self.int()?];
            elements.extend(self.tetrahedron(kind, MshReader::int)?.map(|nodes| (number, nodes)));
        }
        Ok(())
    }

    /// Elements of version 2: number, type, tags, nodes; in binary files type and number of tags head a group.
    fn elements_2(&mut self, elements: &mut Vec<(i64, [i64; 4])>) -> Result<(), MeshError> {
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
                for _ in 0..n_tags {
                    self.int()?;
                }
                elements.extend(self.tetrahedron(kind, MshReader::int)?.map(|nodes| (number, nodes)));
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

    /// Elements of version 4.1: blocks of one type, each element its number and nodes.
    fn elements_4(&mut self, elements: &mut Vec<(i64, [i64; 4])>) -> Result<(), MeshError> {
        let [blocks, _, _, _] = [self.size()?, self.size()?, self.size()?, self.size()?];
        for _ in 0..blocks {
            let [_, _, kind] = [self.int()?, self.int()?, self.int()?];
            for _ in 0..self.size()? {
                let number = self.size()?;
                elements.extend(self.tetrahedron(kind, MshReader::size)?.map(|nodes| (number, nodes)));
            }
        }
        Ok(())
    }

    /// The nodes of an element of type `kind`, each read by `node`; `None` when it is no solid.
    fn tetrahedron(
        &mut self,
        kind: i64,
        node: fn(&mut Self) -> Result<i64, MeshError>,
    ) -> Result<Option<[i64; 4]>, MeshError> {
        if kind == TETRAHEDRON {
            return Ok(Some([node(self)?, node(self)?, node(self)?, node(self)?]));
        }
        let index = kind.checked_sub(1).and_then(|i| usize::try_from(i).ok());
        let n_nodes = index.and_then(|i| NODES_OF_TYPE.get(i));
        match n_nodes {
            Some(&n_nodes) if !OTHER_SOLIDS.contains(&kind) => {
                for _ in 0..n_nodes {
                    node(self)?;
                }
                Ok(None)
            }
            _ => Err(MeshError::Unsupported {
                what: format!("an element of Gmsh type {kind}"),
                remedy: "mesh the body with tetrahedra of 4 nodes (first order)",
            }),
        }
    }
}

/// The beginning of a piece of a file, fit for a message.
fn shown(bytes: &[u8]) -> String {
    String::from_utf8_lossy(&bytes[..bytes.len().min(40)]).escape_debug().to_string()
}

/// `surface` with about `target_vertices` vertices, all of them among the old ones; its shape moves by about 2 % of
/// its extent at most, so the target may be missed.
///
/// Returned unchanged when it is small enough already, when it is not closed, and when decimation would open it or
/// change its volume by more than 2 %.
pub fn decimate(surface: &Surface, target_vertices: usize) -> Surface {
    if surface.vertices.len() <= target_vertices {
        return surface.clone();
    }
    simplified(surface, target_vertices).unwrap_or_else(|| surface.clone())
}

fn simplified(surface: &Surface, target_vertices: usize) -> Option<Surface> {
    // The simplifier trusts its indices.
    check_closed(&mut surface.clone()).ok()?;
    let (low, high) = surface.bounds();
    let centre = (low + high) / 2.0;
    let positions: Vec<[f32; 3]> = surface.vertices.iter().map(|p| (p - centre).map(|c| c as f32).into()).collect();
    let adapter =
        meshopt::VertexDataAdapter::new(meshopt::typed_to_bytes(&positions), size_of::<[f32; 3]>(), 0).ok()?;
    // A closed surface has about two triangles per vertex. Regular triangles cost a little accuracy and are worth it:
    // each vertex is a place to touch.
    let indices = meshopt::simplify(
        surface.triangles.as_flattened(),
        &adapter,
        target_vertices.saturating_mul(6),
        DECIMATION_ERROR,
        meshopt::SimplifyOptions::RegularizeLight,
        None,
    );
    let mut triangles = indices.as_chunks::<3>().0.to_vec();
    let vertices = keep_referenced(&surface.vertices, &mut triangles);
    let mut small = Surface { vertices, triangles };
    check_closed(&mut small).ok()?;
    let (before, after) = (surface.volume(), small.volume());
    ((after - before).abs() <= VOLUME_TOLERANCE * before.abs()).then_some(small)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::primitives::{box_mesh, box_surface, liver_surface};
    use std::fmt::Write;

    const CUBE_OBJ: &str = "mtllib nowhere.mtl\no cube\n\
        v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nv 0 0 1\nv 1 0 1\nv 1 1 1\nv 0 1 1\nvt 0 0\nvn 0 0 1\n\
        usemtl skin\ns off\nf 4/1/1 3/1/1 2/1/1 1/1/1\nf 5//1 6//1 7//1 8//1\n\
        g sides\nf -8 -7 -3 -4\nf 2 3 7 6\nf 3 4 8 7\nf 4 1 5 8\n";

    fn obj(text: &str) -> Result<Surface, MeshError> {
        parse_surface(Path::new("a.obj"), text.as_bytes(), LengthUnit::Metre)
    }
    fn stl(bytes: &[u8]) -> Result<Surface, MeshError> {
        parse_surface(Path::new("a.STL"), bytes, LengthUnit::Metre)
    }
    fn msh(bytes: &[u8]) -> Result<TetMesh, MeshError> {
        parse_tet_mesh(Path::new("a.msh"), bytes, LengthUnit::Metre)
    }
    fn cube() -> Surface {
        box_surface(Vec3::repeat(1.0), [1, 1, 1])
    }

    fn text_stl(surface: &Surface, name: &str) -> String {
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

    fn binary_stl(surface: &Surface, header: &[u8]) -> Vec<u8> {
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

    fn msh_1(mesh: &TetMesh) -> Vec<u8> {
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

    fn msh_2(mesh: &TetMesh, encoding: Encoding) -> Vec<u8> {
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

    fn every_msh(mesh: &TetMesh) -> Vec<Vec<u8>> {
        let encodings = [Encoding::Text, Encoding::LittleEndian, Encoding::BigEndian];
        let mut files = vec![msh_1(mesh)];
        files.extend(encodings.into_iter().flat_map(|encoding| [msh_2(mesh, encoding), msh_4(mesh, encoding)]));
        files
    }

    #[test]
    fn a_unit_of_length_reads_as_it_is_written() {
        for (text, factor) in [("m", 1.0), ("cm", 0.01), ("mm", 0.001), ("in", 0.0254)] {
            assert_eq!(text.parse::<LengthUnit>().unwrap().metres(), factor);
        }
        assert!(matches!("ft".parse::<LengthUnit>(), Err(MeshError::UnknownUnit { .. })));
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
    fn a_surface_turned_inside_out_is_turned_back() {
        let inward = CUBE_OBJ.lines().map(|line| match line.strip_prefix("f ") {
            Some(face) => format!("f {}\n", face.split(' ').rev().collect::<Vec<_>>().join(" ")),
            None => format!("{line}\n"),
        });
        assert!((obj(&inward.collect::<String>()).unwrap().volume() - 1.0).abs() < 1e-15);
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
    fn minus_zero_and_zero_are_one_place() {
        let file = text_stl(&cube(), "").replacen("vertex 0e0 0 0\n", "vertex -0e0 -0 0\n", 1);
        assert!(file.contains("-0"));
        assert_eq!(stl(file.as_bytes()).unwrap().vertices.len(), 8);
    }

    #[test]
    fn a_hole_is_refused_with_its_place() {
        let open = CUBE_OBJ.replace("f 4 1 5 8\n", "");
        match obj(&open) {
            Err(MeshError::NotClosed { border_edges: 4, from, to }) => assert_eq!((from.x, to.x), (0.0, 0.0)),
            other => panic!("{other:?}"),
        }
    }

    #[test]
    fn an_inner_wall_a_turned_face_and_a_sheet_are_refused() {
        assert!(matches!(obj(&format!("{CUBE_OBJ}f 1 2 6\n")), Err(MeshError::NonManifold { edges: 3, .. })));
        let turned = CUBE_OBJ.replace("f 2 3 7 6", "f 6 7 3 2");
        assert!(matches!(obj(&turned), Err(MeshError::InconsistentOrientation { edges: 4, .. })));
        let sheet = "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\nf 3 2 1\n";
        assert!(matches!(obj(sheet), Err(MeshError::NoVolume { .. })));
        assert!(matches!(obj("v 0 0 0\n"), Err(MeshError::Empty { what: "triangles" })));
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
        let unknown = parse_surface(Path::new("organ.ply"), b"", LengthUnit::Metre).unwrap_err().to_string();
        assert!(unknown.contains("organ.ply") && unknown.contains(".stl"));
        let absent = read_surface(Path::new("absent/organ.stl"), LengthUnit::Metre).unwrap_err().to_string();
        assert!(absent.contains("organ.stl"));
        let cut = stl(&binary_stl(&cube(), b"")[..200]).unwrap_err().to_string();
        assert!(cut.contains("12 triangles are announced, 2 are there"), "{cut}");
    }

    #[test]
    fn indices_out_of_range_are_refused_before_they_are_used() {
        let mut surface = cube();
        surface.triangles[3][1] = 8;
        let expected = MeshError::BadIndex { cell: "triangle", number: 4, index: 9 };
        assert_eq!(check_closed(&mut surface).unwrap_err().to_string(), expected.to_string());
        assert_eq!(decimate(&surface, 4), surface);
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
    fn an_inverted_tetrahedron_is_refused_by_its_number_and_a_mirrored_mesh_is_turned() {
        let mesh = box_mesh(Vec3::repeat(1.0), [1, 1, 1]);
        let mut one = mesh.clone();
        one.elements[4].swap(0, 1);
        match msh(&msh_2(&one, Encoding::Text)) {
            Err(MeshError::Inverted { element: 6, count: 1, total: 6, volume, .. }) => assert_eq!(volume, -1.0 / 6.0),
            other => panic!("{other:?}"),
        }
        let mut all = mesh.clone();
        all.elements.iter_mut().for_each(|e| e.swap(2, 3));
        assert_eq!(msh(&msh_1(&all)).unwrap(), mesh);
        one.elements[4] = [0, 1, 2, 3];
        assert!(matches!(msh(&msh_1(&one)), Err(MeshError::Degenerate { element: 6, .. })));
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
        says("$MeshFormat\n2.2 0 8\n$EndMeshFormat\n".into(), "no tetrahedra");
        says("$Nodes\n0\n$EndNodes\n".into(), "$MeshFormat must come first");
    }

    /// Nothing but the absence of a panic is claimed, which overflow checks and debug assertions sharpen.
    #[test]
    fn damaged_files_are_refused_or_read_but_never_crash() {
        let mesh = box_mesh(Vec3::repeat(1.0), [1, 1, 1]);
        let mut files: Vec<(&str, Vec<u8>)> = every_msh(&mesh).into_iter().map(|file| ("a.msh", file)).collect();
        files.push(("a.obj", CUBE_OBJ.into()));
        files.push(("a.stl", text_stl(&cube(), "").into()));
        files.push(("a.stl", binary_stl(&cube(), b"")));
        let mut seed: u64 = 1;
        let mut random = |below: usize| {
            seed = seed.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
            (seed >> 33) as usize % below.max(1)
        };
        for (name, file) in &files {
            for _ in 0..400 {
                let mut bytes = file.clone();
                for _ in 0..=random(4) {
                    let at = random(bytes.len());
                    let replace = |bytes: &mut Vec<u8>, length: usize, with: &[u8]| {
                        let end = (at + length).min(bytes.len());
                        bytes.splice(at.min(end)..end, with.iter().copied());
                    };
                    match random(8) {
                        0 => bytes.truncate(at),
                        1 => replace(&mut bytes, 1, &[random(256) as u8]),
                        2 => replace(&mut bytes, 8, &[0xff; 8]),
                        3 => replace(&mut bytes, 4, &[0xff, 0xff, 0xff, 0x7f]),
                        4 => replace(&mut bytes, 8, &[0; 8]),
                        5 => replace(&mut bytes, 1, b"9223372036854775807"),
                        6 => replace(&mut bytes, 1, b"-9223372036854775808 "),
                        _ => replace(&mut bytes, random(40), b" -1 "),
                    }
                }
                match *name {
                    "a.msh" => drop(parse_tet_mesh(Path::new(name), &bytes, LengthUnit::Millimetre)),
                    _ => drop(parse_surface(Path::new(name), &bytes, LengthUnit::Millimetre)),
                }
            }
        }
    }

    #[test]
    fn decimation_keeps_the_liver_closed_and_its_volume() {
        let liver = liver_surface(0.004);
        let small = decimate(&liver, 1000);
        assert!((900..=1010).contains(&small.vertices.len()), "{}", small.vertices.len());
        assert!(check_closed(&mut small.clone()).is_ok());
        assert!((small.volume() / liver.volume() - 1.0).abs() < 0.01);
        assert!(small.vertices.iter().all(|p| liver.vertices.contains(p)));
        assert_eq!(decimate(&liver, liver.vertices.len()), liver);
    }

    #[test]
    fn decimation_returns_the_surface_unchanged_rather_than_ruin_it() {
        let liver = liver_surface(0.008);
        let tiny = decimate(&liver, 0);
        assert!((tiny.volume() / liver.volume() - 1.0).abs() <= VOLUME_TOLERANCE);
        let mut open = liver.clone();
        open.triangles.pop();
        assert_eq!(decimate(&open, 100), open);
    }

    /// A file of the folder beside the project, when it is there.
    fn shared(name: &str) -> Option<PathBuf> {
        let path = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../shared/meshes")).join(name);
        if !path.exists() {
            eprintln!("{} is not there: not tested", path.display());
            return None;
        }
        Some(path)
    }

    #[test]
    fn real_organs_are_closed_and_of_their_known_size() {
        for (name, vertices, litres) in [
            ("Liver.stl", 15_365, 1.818),
            ("Spleen.stl", 5_409, 0.344),
            ("Kidney_left.stl", 3_287, 0.192),
            ("gallbladder_collision.stl", 252, 0.036),
            ("instrument_shaft.stl", 522, 0.005),
            ("liver-smooth.obj", 2_194, 0.000),
            ("torus.obj", 800, 0.000),
        ] {
            let Some(path) = shared(name) else { return };
            let surface = read_surface(&path, LengthUnit::Millimetre).unwrap_or_else(|e| panic!("{name}: {e}"));
            assert_eq!(surface.vertices.len(), vertices, "{name}");
            assert!((1e3 * surface.volume() - litres).abs() < 0.001, "{name}: {}", surface.volume());
        }
    }

    #[test]
    fn a_real_open_and_a_real_self_touching_surface_are_refused() {
        let (Some(bunny), Some(dragon)) = (shared("bunny.obj"), shared("dragon.stl")) else { return };
        assert!(matches!(read_surface(&bunny, LengthUnit::Metre), Err(MeshError::NotClosed { border_edges: 42, .. })));
        assert!(matches!(read_surface(&dragon, LengthUnit::Metre), Err(MeshError::NonManifold { .. })));
    }

    #[test]
    fn real_tetrahedra_come_back_in_full_and_inverted_ones_by_number() {
        for (name, nodes, elements) in [
            ("cube_22_ascii_vol_gmshApp.msh", 14, 24),
            ("liver.msh", 181, 596),
            ("truthcylinder1.msh", 642, 2_524),
            ("single_tetra.msh", 4, 1),
        ] {
            let Some(path) = shared(name) else { return };
            let mesh = read_tet_mesh(&path, LengthUnit::Metre).unwrap_or_else(|e| panic!("{name}: {e}"));
            assert_eq!((mesh.nodes.len(), mesh.elements.len()), (nodes, elements), "{name}");
            assert!((0..elements).all(|e| mesh.volume(e) > 0.0));
        }
        let Some(bad) = shared("6_tetra_bad.msh") else { return };
        let error = read_tet_mesh(&bad, LengthUnit::Metre);
        assert!(matches!(error, Err(MeshError::Inverted { element: 44, count: 1, total: 6, .. })), "{error:?}");
    }

    #[test]
    fn a_real_liver_decimates_to_a_sixth_and_keeps_its_volume() {
        let Some(path) = shared("Liver.stl") else { return };
        let liver = read_surface(&path, LengthUnit::Millimetre).unwrap();
        let small = decimate(&liver, 2_500);
        assert!((2_450..=2_550).contains(&small.vertices.len()), "{}", small.vertices.len());
        assert!((small.volume() / liver.volume() - 1.0).abs() < 0.005);
    }
}
