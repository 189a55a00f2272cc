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

use super::mesh_error::MeshError;
use super::msh::parse_msh;
use super::soundness::{check_closed, check_finite, keep_referenced, orient, weld};
use super::surface_file::{parse_obj, parse_stl};
use super::{Surface, TetMesh};
use crate::math::{Real, Vec3};
use serde::{Deserialize, Serialize};
use std::collections::HashSet;
use std::io::Read;
use std::path::Path;

/// Longest file read [bytes]; a surface that moves in real time needs a hundredth of it.
pub const MAX_FILE: usize = 128 << 20;

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

impl std::fmt::Display for LengthUnit {
    fn fmt(&self, f: &mut std::fmt::Formatter) -> std::fmt::Result {
        f.write_str(match self {
            LengthUnit::Metre => "m",
            LengthUnit::Centimetre => "cm",
            LengthUnit::Millimetre => "mm",
            LengthUnit::Inch => "in",
        })
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

/// The closed surface in the `.obj` or `.stl` file at `path`, lengths in `unit`; see [`parse_surface`].
pub fn read_surface(path: &Path, unit: LengthUnit) -> Result<Surface, MeshError> {
    parse_surface(path, &read_bytes(path)?, unit)
}

/// The tetrahedra in the `.msh` file at `path`, lengths in `unit`; see [`parse_tet_mesh`].
pub fn read_tet_mesh(path: &Path, unit: LengthUnit) -> Result<TetMesh, MeshError> {
    parse_tet_mesh(path, &read_bytes(path)?, unit)
}

/// The bytes of the file at `path`, and one too many of a file that is too long.
///
/// # Errors
/// Those of the file system.
pub fn read_bytes(path: &Path) -> Result<Vec<u8>, MeshError> {
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
    let file = parse_msh(bytes)?;
    let mut mesh = TetMesh { nodes: in_metres(file.positions.into_iter(), unit)?, elements: Vec::new() };
    let mut numbers = Vec::new();
    let mut seen = HashSet::new();
    for (number, tags) in file.tetrahedra {
        let mut element = [0; 4];
        for (node, tag) in element.iter_mut().zip(tags) {
            let missing = MeshError::BadIndex { cell: "element", number, index: tag };
            *node = *file.node_of_tag.get(&tag).ok_or(missing)?;
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

#[cfg(test)]
pub(super) mod tests {
    use super::super::msh::tests::every_msh;
    use super::super::surface_file::tests::{CUBE_OBJ, binary_stl, cube, text_stl};
    use super::*;
    use crate::geometry::primitives::box_mesh;
    use std::path::PathBuf;

    #[test]
    fn a_unit_of_length_reads_as_it_is_written() {
        for (text, factor) in [("m", 1.0), ("cm", 0.01), ("mm", 0.001), ("in", 0.0254)] {
            assert_eq!(text.parse::<LengthUnit>().unwrap().metres(), factor);
        }
        assert!(matches!("ft".parse::<LengthUnit>(), Err(MeshError::UnknownUnit { .. })));
    }

    #[test]
    fn a_file_that_is_not_there_or_of_another_kind_is_named() {
        let unknown = parse_surface(Path::new("organ.ply"), b"", LengthUnit::Metre).unwrap_err().to_string();
        assert!(unknown.contains("organ.ply") && unknown.contains(".stl"));
        let absent = read_surface(Path::new("absent/organ.stl"), LengthUnit::Metre).unwrap_err().to_string();
        assert!(absent.contains("organ.stl"));
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

    /// A file of the folder beside the project, when it is there.
    pub(in crate::geometry) fn shared(name: &str) -> Option<PathBuf> {
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
}
