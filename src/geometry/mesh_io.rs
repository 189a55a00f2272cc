//! Mesh files: bytes in, shapes in metres out.
//!
//! | file | holds | read |
//! |---|---|---|
//! | `.obj` | surface | positions and faces; all objects make one surface |
//! | `.stl` | surface | binary or text; all solids make one surface |
//! | `.ply` | surface | text or binary of both byte orders |
//! | `.gltf`, `.glb` | surface | glTF 2.0 with its buffers inside; the meshes of the scene where its nodes put them |
//! | `.vtp` | surface | VTK's XML poly data |
//! | `.vtk` | either | VTK's legacy files up to version 5.1, text or binary: poly data and unstructured grids |
//! | `.vtu` | either | VTK's XML unstructured grids: text, base64 or raw, plain or compressed by zlib |
//! | `.mesh` | either | Medit's text files |
//! | `.msh` | tetrahedra | Gmsh 4.1 and 2.x, binary or text; Gmsh 1 (`$NOD`, `$ELM`) |
//! | `.ele`, `.node` | tetrahedra | TetGen's two files, by the name of either |
//!
//! Polygons become fans of triangles; a file that holds tetrahedra is a volume, and its triangles are left out.
//!
//! Bytes are not trusted: whatever they say, a reader answers with a shape or a [`MeshError`], in memory proportional
//! to the bytes there are. Nothing here touches the file system except the functions whose names begin with
//! `read_`. Numbers of vertices, triangles and elements in errors count from 1, as people do, except where they are the
//! file's own.

use super::cells::Cells;
use super::gltf::parse_gltf;
use super::medit::parse_medit;
use super::mesh_error::MeshError;
use super::msh::parse_msh;
use super::ply::parse_ply;
use super::repair::{Repairs, repair};
use super::soundness::{check_closed, check_finite, keep_referenced, orient};
use super::surface_file::{parse_obj, parse_stl};
use super::tetgen::parse_tetgen;
use super::vtk::parse_vtk;
use super::vtk_xml::parse_vtk_xml;
use super::{Surface, TetMesh};
use crate::math::{Real, Vec3};
use serde::{Deserialize, Serialize};
use std::collections::HashSet;
use std::io::Read;
use std::path::{Path, PathBuf};

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

/// A shape as a file holds it, in metres.
#[derive(Clone, Debug, PartialEq)]
pub enum Solid {
    /// The closed surface around it.
    Surface(Surface),
    /// Tetrahedra that fill it.
    Volume(TetMesh),
}

/// The closed surface in the file at `path`, lengths in `unit`; see [`parse`].
pub fn read_surface(path: &Path, unit: LengthUnit) -> Result<Surface, MeshError> {
    surface_of(parse(&read_files(path)?, unit, 0.0)?.0)
}

/// The tetrahedra in the file at `path`, lengths in `unit`; see [`parse`].
pub fn read_tet_mesh(path: &Path, unit: LengthUnit) -> Result<TetMesh, MeshError> {
    tet_mesh_of(parse(&read_files(path)?, unit, 0.0)?.0)
}

/// The names and bytes of the mesh that the file at `path` holds: one file, or TetGen's nodes and elements, whichever of
/// them `path` is. Of a file that is too long there is one byte too many.
///
/// # Errors
/// Those of the file system.
pub fn read_files(path: &Path) -> Result<Vec<(PathBuf, Vec<u8>)>, MeshError> {
    let read = |path: PathBuf| {
        let failed = |reason| MeshError::Io { path: path.clone(), reason };
        let mut bytes = Vec::new();
        let file = std::fs::File::open(&path).map_err(failed)?;
        // One byte past the limit is enough for the parser to refuse the rest.
        file.take(MAX_FILE as u64 + 1).read_to_end(&mut bytes).map_err(failed)?;
        Ok((path, bytes))
    };
    match extension(path).as_str() {
        "ele" | "node" => [path.with_extension("node"), path.with_extension("ele")].into_iter().map(read).collect(),
        _ => Ok(vec![read(path.to_owned())?]),
    }
}

/// The solid that `files` hold, as [`read_files`] gives them, lengths in `unit`, and what of it was repaired.
///
/// Of a surface, vertices at one place become one, vertices in no triangle, degenerate triangles and those listed twice
/// are dropped, triangles that face another way than most of their neighbours are turned, and holes at most `holes` wide
/// [m] are closed. The result has passed [`check_closed`], so it faces outward.
///
/// Of tetrahedra, those listed twice count once, nodes in no tetrahedron are dropped. A file whose tetrahedra are *all*
/// inside out, be it a single one, merely numbers nodes the other way round and is turned; when only some are, that is an
/// error.
pub fn parse(files: &[(PathBuf, Vec<u8>)], unit: LengthUnit, holes: Real) -> Result<(Solid, Repairs), MeshError> {
    if files.iter().any(|(_, bytes)| bytes.len() > MAX_FILE) {
        return Err(MeshError::TooBig { limit: MAX_FILE, what: "bytes" });
    }
    let cells = match files {
        [(_, node), (_, ele)] => parse_tetgen(node, ele)?,
        [(name, bytes), ..] => match extension(name).as_str() {
            "obj" => parse_obj(bytes)?,
            "stl" => parse_stl(bytes)?,
            "ply" => parse_ply(bytes)?,
            "gltf" | "glb" => parse_gltf(bytes)?,
            "vtk" => parse_vtk(bytes)?,
            "vtu" | "vtp" => parse_vtk_xml(bytes)?,
            "mesh" => parse_medit(bytes)?,
            "msh" => parse_msh(bytes)?,
            _ => return Err(MeshError::UnknownFormat { path: name.clone() }),
        },
        [] => Cells::default(),
    };
    let points: Vec<Vec3> = cells.points.iter().map(|p| Vec3::from(*p) * unit.metres()).collect();
    check_finite(&points)?;
    if cells.tetrahedra.is_empty() {
        let (mut surface, mut repairs) = repair(&points, &cells.triangles, holes);
        if !cells.indexed {
            repairs.merged = 0;
        }
        if surface.volume() < 0.0 {
            repairs.turned = surface.triangles.len() - repairs.turned;
        }
        check_closed(&mut surface)?;
        return Ok((Solid::Surface(surface), repairs));
    }
    let mut repairs = Repairs::default();
    let (mut mesh, mut numbers, mut seen) = (TetMesh::default(), Vec::new(), HashSet::new());
    for (number, element) in cells.tetrahedra {
        let mut key = element;
        key.sort_unstable();
        if seen.insert(key) {
            numbers.push(number);
            mesh.elements.push(element);
        } else {
            repairs.dropped += 1;
        }
    }
    mesh.nodes = keep_referenced(&points, &mut mesh.elements);
    repairs.turned = orient(&mut mesh, &numbers)?;
    Ok((Solid::Volume(mesh), repairs))
}

/// The closed surface in `bytes`, lengths in `unit`; the extension of `name` tells the format; see [`parse`].
#[cfg(test)]
pub(super) fn parse_surface(name: &Path, bytes: &[u8], unit: LengthUnit) -> Result<Surface, MeshError> {
    surface_of(parse(&[(name.to_owned(), bytes.to_owned())], unit, 0.0)?.0)
}

/// The tetrahedra in `bytes`, lengths in `unit`; the extension of `name` tells the format; see [`parse`].
#[cfg(test)]
pub(super) fn parse_tet_mesh(name: &Path, bytes: &[u8], unit: LengthUnit) -> Result<TetMesh, MeshError> {
    tet_mesh_of(parse(&[(name.to_owned(), bytes.to_owned())], unit, 0.0)?.0)
}

fn surface_of(solid: Solid) -> Result<Surface, MeshError> {
    match solid {
        Solid::Surface(surface) => Ok(surface),
        Solid::Volume(_) => Err(MeshError::Unsupported {
            what: "a file of tetrahedra, where a surface is wanted,".into(),
            remedy: "take it as a volume, or export its surface",
        }),
    }
}

fn tet_mesh_of(solid: Solid) -> Result<TetMesh, MeshError> {
    match solid {
        Solid::Volume(mesh) => Ok(mesh),
        Solid::Surface(_) => Err(MeshError::Empty { what: "tetrahedra" }),
    }
}

/// Lower-case extension of `name`.
fn extension(name: &Path) -> String {
    name.extension().map_or(String::new(), |e| e.to_string_lossy().to_lowercase())
}

#[cfg(test)]
pub(super) mod tests {
    use super::super::gltf::tests::{embedded, glb};
    use super::super::medit::tests::medit;
    use super::super::msh::tests::every_msh;
    use super::super::ply::tests::every_ply;
    use super::super::surface_file::tests::{CUBE_OBJ, binary_stl, cube, text_stl};
    use super::super::tetgen::tests::tetgen;
    use super::super::vtk::tests::every_vtk;
    use super::super::vtk_xml::tests::{every_vtp, every_vtu};
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
        let unknown = parse_surface(Path::new("organ.dae"), b"", LengthUnit::Metre).unwrap_err().to_string();
        assert!(unknown.contains("organ.dae") && unknown.contains(".stl"));
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
        files.extend(every_ply(&cube()).into_iter().map(|file| ("a.ply", file)));
        files.extend(every_vtk(&mesh, &cube()).into_iter().map(|file| ("a.vtk", file)));
        files.extend(every_vtu(&mesh).into_iter().map(|file| ("a.vtu", file)));
        files.extend(every_vtp(&cube()).into_iter().map(|file| ("a.vtp", file)));
        files.push(("a.glb", glb(&cube(), "")));
        files.push(("a.gltf", embedded(&cube())));
        files.push(("a.mesh", medit(&mesh.nodes, "Tetrahedra", &mesh.elements).into()));
        files.push(("a.mesh", medit(&cube().vertices, "Triangles", &cube().triangles).into()));
        let (node, ele) = tetgen(&mesh, 1);
        files.extend([("a.node", node.clone().into()), ("a.ele", ele.clone().into())]);
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
                let files: Vec<(PathBuf, Vec<u8>)> = match *name {
                    "a.node" => vec![("a.node".into(), bytes), ("a.ele".into(), ele.clone().into())],
                    "a.ele" => vec![("a.node".into(), node.clone().into()), ("a.ele".into(), bytes)],
                    _ => vec![(name.into(), bytes)],
                };
                drop(parse(&files, LengthUnit::Millimetre, 1.0));
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
    fn a_real_open_surface_is_refused_or_closed_on_request_and_one_that_meets_itself_is_refused() {
        let (Some(bunny), Some(dragon)) = (shared("bunny.obj"), shared("dragon.stl")) else { return };
        assert!(matches!(read_surface(&bunny, LengthUnit::Metre), Err(MeshError::NotClosed { border_edges: 42, .. })));
        assert!(matches!(read_surface(&dragon, LengthUnit::Metre), Err(MeshError::NonManifold { .. })));
        let (solid, repairs) = parse(&read_files(&bunny).unwrap(), LengthUnit::Metre, 1.0).unwrap();
        println!("{repairs}");
        assert!(repairs.closed > 0 && matches!(solid, Solid::Surface(surface) if surface.volume() > 0.0));
    }

    #[test]
    fn real_tetrahedra_come_back_in_full_and_inverted_ones_by_number() {
        for (name, nodes, elements) in [
            ("cube_22_ascii_vol_gmshApp.msh", 14, 24),
            ("liver.msh", 181, 596),
            ("truthcylinder1.msh", 642, 2_524),
            ("single_tetra.msh", 4, 1),
            ("armadillo_4k.ele", 1_180, 3_717),
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
