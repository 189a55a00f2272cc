//! Mesh files: bytes in, shapes in metres out.
//!
//! | file | holds | read |
//! |---|---|---|
//! | `.obj` | surface | positions and faces; all objects make one surface |
//! | `.stl` | surface | binary or text; all solids make one surface |
//! | `.ply` | surface | text or binary of both byte orders |
//! | `.off` | surface | text; positions and faces |
//! | `.gltf`, `.glb` | surface | glTF 2.0, its buffers inside or beside it; the meshes of the scene where its nodes put them |
//! | `.vtp` | surface | VTK's XML poly data: polygons and strips of triangles |
//! | `.vtk` | either | VTK's legacy files up to version 5.1, text or binary: poly data and unstructured grids |
//! | `.vtu` | either | VTK's XML unstructured grids: text, base64 or raw, plain or compressed by zlib |
//! | `.mesh` | either | Medit's text files |
//! | `.inp` | either | Abaqus's input files of one part: linear tetrahedra, triangles and quadrangles |
//! | `.msh` | either | Gmsh 4.1 and 2.x, binary or text; Gmsh 1 (`$NOD`, `$ELM`) |
//! | `.ele`, `.node` | tetrahedra | TetGen's two files, by the name of either |
//!
//! Polygons and strips become triangles; a file that holds tetrahedra is a volume, and its triangles are left out, which is
//! said where they are not faces of tetrahedra. Text may be UTF-8 or UTF-16, with lines that end as on any system.
//!
//! Most readers are our own, because a file that is cut off or lies about its sizes must not end the program, as it does
//! with the libraries there are for these formats.
//!
//! Bytes are not trusted: whatever they say, a reader answers with a shape or a [`MeshError`], in memory proportional
//! to the bytes there are. Nothing here touches the file system except the functions whose names begin with
//! `read_`. Numbers of vertices, triangles and elements in errors count from 1, as people do, except where they are the
//! file's own.

use super::cells::Cells;
use super::gltf::{buffer_files, parse_gltf};
use super::inp::parse_inp;
use super::labels::LabelledMesh;
use super::medit::parse_medit;
use super::mesh_error::MeshError;
use super::msh::parse_msh;
use super::off::parse_off;
use super::ply::parse_ply;
pub use super::reader::MAX_FILE;
use super::repair::{Repairs, repair};
use super::soundness::{check_closed, check_finite};
use super::surface_file::{parse_obj, parse_stl};
use super::tetgen::parse_tetgen;
use super::text::{plain, utf8};
use super::volume::volume;
use super::vtk::parse_vtk;
use super::vtk_xml::parse_vtk_xml;
use palpate_core::geometry::{Surface, TetMesh};
use palpate_core::math::{Real, Vec3};
use serde::{Deserialize, Serialize};
use std::io::Read;
use std::path::{Path, PathBuf};

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
    /// Every unit.
    pub const ALL: [LengthUnit; 4] =
        [LengthUnit::Metre, LengthUnit::Centimetre, LengthUnit::Millimetre, LengthUnit::Inch];

    /// The name it is chosen by.
    pub fn name(self) -> &'static str {
        match self {
            LengthUnit::Metre => "m",
            LengthUnit::Centimetre => "cm",
            LengthUnit::Millimetre => "mm",
            LengthUnit::Inch => "in",
        }
    }

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
        f.write_str(self.name())
    }
}

impl std::str::FromStr for LengthUnit {
    type Err = MeshError;

    fn from_str(text: &str) -> Result<Self, MeshError> {
        let unit = Self::ALL.into_iter().find(|unit| unit.name() == text);
        unit.ok_or_else(|| MeshError::UnknownUnit { given: text.to_owned() })
    }
}

/// A shape as a file holds it, in metres.
#[derive(Clone, Debug, PartialEq)]
pub enum Solid {
    /// The closed surface around it.
    Surface(Surface),
    /// Tetrahedra that fill it, with their labels.
    Volume(LabelledMesh),
}

/// The closed surface in the file at `path`, lengths in `unit`; see [`parse`].
pub fn read_surface(path: &Path, unit: LengthUnit) -> Result<Surface, MeshError> {
    surface_of(parse(&read_files(path)?, unit, 0.0, None)?.0)
}

/// The tetrahedra in the file at `path`, lengths in `unit`, with the labels called `labels`; see [`parse`].
pub fn read_labelled(path: &Path, unit: LengthUnit, labels: Option<&str>) -> Result<LabelledMesh, MeshError> {
    volume_of(parse(&read_files(path)?, unit, 0.0, labels)?.0)
}

/// The tetrahedra in the file at `path`, lengths in `unit`; see [`parse`].
pub fn read_tet_mesh(path: &Path, unit: LengthUnit) -> Result<TetMesh, MeshError> {
    Ok(read_labelled(path, unit, None)?.mesh)
}

/// The names and bytes of the mesh that the file at `path` holds: one file, TetGen's nodes and elements, whichever of
/// them `path` is, or a glTF file and those with its buffers. Of a file that is too long there is one byte too many.
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
        "gltf" | "glb" => {
            let mut files = vec![read(path.to_owned())?];
            let folder = path.parent().unwrap_or(Path::new(""));
            let buffers = buffer_files(&utf8(&files[0].1))?;
            for file in buffers {
                files.push(read(folder.join(file))?);
                if files.iter().map(|(_, bytes)| bytes.len()).sum::<usize>() > MAX_FILE {
                    return Err(MeshError::TooBig { limit: MAX_FILE, what: "bytes" });
                }
            }
            Ok(files)
        }
        _ => Ok(vec![read(path.to_owned())?]),
    }
}

/// The solid that `files` hold, as [`read_files`] gives them, lengths in `unit`, and what of it was repaired.
///
/// Of a surface, vertices at one place become one, those on borders also within rounding of another, vertices in no triangle, degenerate triangles and those listed twice
/// are dropped, triangles that face another way than most of their neighbours are turned, and holes at most `holes` wide
/// [m] are closed. The result has passed [`check_closed`], so it faces outward.
///
/// Of tetrahedra, those listed twice count once, nodes in no tetrahedron are dropped, and nodes at one place become one where
/// they belong to pieces that do not hang together. A file whose tetrahedra are *all*
/// inside out, be it a single one, merely numbers nodes the other way round and is turned; when only some are, that is an
/// error. Their labels are the ones called `labels`, or without it those whose name says so (see [`Labels`]): of MSH files
/// the `physical` groups or the `elementary` entities, of VTK's any array of whole numbers on the cells, of TetGen's the first
/// `attribute`, of Medit's the `reference`, of Abaqus's the `section` or the `elset`.
pub fn parse(
    files: &[(PathBuf, Vec<u8>)],
    unit: LengthUnit,
    holes: Real,
    labels: Option<&str>,
) -> Result<(Solid, Repairs), MeshError> {
    if files.iter().any(|(_, bytes)| bytes.len() > MAX_FILE) {
        return Err(MeshError::TooBig { limit: MAX_FILE, what: "bytes" });
    }
    let cells = match files {
        [] => Cells::default(),
        [(name, bytes), beside @ ..] => match extension(name).as_str() {
            "node" | "ele" => match beside {
                [(_, ele), ..] => parse_tetgen(&plain(bytes), &plain(ele))?,
                [] => return Err(MeshError::Empty { what: "tetrahedra" }),
            },
            "obj" => parse_obj(&plain(bytes))?,
            "off" => parse_off(&plain(bytes))?,
            "inp" => parse_inp(&plain(bytes))?,
            "mesh" => parse_medit(&plain(bytes))?,
            // Binary files may hold any bytes.
            "stl" => parse_stl(bytes)?,
            "ply" => parse_ply(&utf8(bytes))?,
            "gltf" | "glb" => parse_gltf(&utf8(bytes), beside)?,
            "vtk" => parse_vtk(&utf8(bytes))?,
            "vtu" | "vtp" => parse_vtk_xml(&utf8(bytes))?,
            "msh" => parse_msh(&utf8(bytes))?,
            _ => return Err(MeshError::UnknownFormat { path: name.clone() }),
        },
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
        repairs.dropped += cells.degenerate;
        (repairs.left_out, repairs.notes) = (cells.left_out, cells.notes);
        check_closed(&mut surface)?;
        return Ok((Solid::Surface(surface), repairs));
    }
    let (mesh, repairs) = volume(points, cells, labels)?;
    Ok((Solid::Volume(mesh), repairs))
}

/// The closed surface in `bytes`, lengths in `unit`; the extension of `name` tells the format; see [`parse`].
#[cfg(test)]
pub(super) fn parse_surface(name: &Path, bytes: &[u8], unit: LengthUnit) -> Result<Surface, MeshError> {
    surface_of(parse(&[(name.to_owned(), bytes.to_owned())], unit, 0.0, None)?.0)
}

/// The tetrahedra in `bytes`, lengths in `unit`; the extension of `name` tells the format; see [`parse`].
#[cfg(test)]
pub(super) fn parse_tet_mesh(name: &Path, bytes: &[u8], unit: LengthUnit) -> Result<TetMesh, MeshError> {
    Ok(volume_of(parse(&[(name.to_owned(), bytes.to_owned())], unit, 0.0, None)?.0)?.mesh)
}

/// The surface that `solid` is.
///
/// # Errors
/// When it is a volume.
pub fn surface_of(solid: Solid) -> Result<Surface, MeshError> {
    match solid {
        Solid::Surface(surface) => Ok(surface),
        Solid::Volume(_) => Err(MeshError::Unsupported {
            what: "a file of tetrahedra, where a surface is wanted,".into(),
            remedy: "take it as a volume, or export its surface",
        }),
    }
}

/// The tetrahedra that `solid` is.
///
/// # Errors
/// When it is a surface.
pub fn volume_of(solid: Solid) -> Result<LabelledMesh, MeshError> {
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
    use super::super::inp::tests::inp;
    use super::super::medit::tests::medit;
    use super::super::msh::tests::every_msh;
    use super::super::off::tests::off;
    use super::super::ply::tests::every_ply;
    use super::super::surface_file::tests::{CUBE_OBJ, binary_stl, cube, text_stl};
    use super::super::tetgen::tests::tetgen;
    use super::super::vtk::tests::every_vtk;
    use super::super::vtk_xml::tests::{every_vtp, every_vtu};
    use super::*;
    use crate::geometry::shared::shared;
    use palpate_core::geometry::primitives::box_mesh;

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
        files.push(("a.off", off(&cube()).into()));
        files.push(("a.inp", inp(&mesh.nodes, "C3D4", &mesh.elements).into()));
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
                drop(parse(&files, LengthUnit::Millimetre, 1.0, None));
            }
        }
    }

    #[test]
    fn directions_of_fibres_come_with_the_cells_of_vtk_files() {
        // A triangle and a tetrahedron, twice, each beside the other.
        let legacy = |data: &str| {
            format!(
                "# vtk DataFile Version 3.0\nx\nASCII\nDATASET UNSTRUCTURED_GRID\nPOINTS 5 double\n0 0 0\n1 0 0\n0 1 0\n0 0 1\n1 1 1\n\
                 CELLS 3 14\n3 0 1 2\n4 0 1 2 3\n4 1 2 3 4\nCELL_TYPES 3\n5 10 10\nCELL_DATA 3\n{data}"
            )
        };
        let array = |name: &str, components: usize, text: &str| {
            let kind = if components == 3 { "Float64" } else { "Int32" };
            format!(
                "<DataArray type=\"{kind}\" Name=\"{name}\" NumberOfComponents=\"{components}\" format=\"ascii\">{text}</DataArray>"
            )
        };
        let piece = |x: usize, data: &str| {
            let points = format!("{x} 0 0 {} 0 0 {x} 1 0 {x} 0 1", x + 1);
            let cells =
                [array("connectivity", 1, "0 1 2 3"), array("offsets", 1, "4"), array("types", 1, "10")].concat();
            format!(
                "<Piece><Points>{}</Points><Cells>{cells}</Cells><CellData>{data}</CellData></Piece>",
                array("Points", 3, &points)
            )
        };
        let vtu = |first: &str, second: &str| {
            let pieces = [piece(0, first), piece(1, second)].concat();
            format!("<VTKFile type=\"UnstructuredGrid\"><UnstructuredGrid>{pieces}</UnstructuredGrid></VTKFile>")
        };
        let (up, aside) = (array("fibers", 3, "0 0 4"), array("fibers", 3, "0 0 0"));
        for (name, text, expected) in [
            (
                "a.vtk",
                legacy("VECTORS velocity double\n1 1 1 1 1 1 1 1 1\nVECTORS Fibre_dir float\n9 9 9 0 0 2 0 -3 0\n"),
                vec![Vec3::z(), -Vec3::y()],
            ),
            ("b.vtk", legacy("FIELD f 1\nfiber 3 3 double\n9 9 9 0 0 2 0 0 0\n"), vec![Vec3::z(), Vec3::zeros()]),
            ("c.vtk", legacy("VECTORS velocity double\n1 1 1 1 1 1 1 1 1\n"), vec![]),
            ("d.vtk", legacy("VECTORS fibre double\n1 1 1 1 nan 1 1 1 1\n"), vec![]),
            ("a.vtu", vtu(&up, &aside), vec![Vec3::z(), Vec3::zeros()]),
            ("b.vtu", vtu(&up, ""), vec![]),
            ("c.vtu", vtu("", &up), vec![]),
        ] {
            let files = [(PathBuf::from(name), text.into_bytes())];
            let (Solid::Volume(found), repairs) = parse(&files, LengthUnit::Millimetre, 0.0, None).unwrap() else {
                panic!("{name}")
            };
            assert_eq!(found.directions, expected, "{name}");
            assert_eq!(
                repairs.notes.iter().any(|note| note.starts_with("directions of fibres: '")),
                !expected.is_empty()
            );
            let is_said = repairs.left_out.iter().any(|note| note.contains("which leads no fibres"));
            assert_eq!(is_said, ["d.vtk", "b.vtu", "c.vtu"].contains(&name), "{name}");
        }
    }

    #[test]
    fn labels_come_with_the_tetrahedra_of_every_format() {
        // Two tetrahedra, the first listed twice, and a triangle before them.
        let points = ["0 0 0", "1 0 0", "0 1 0", "0 0 1", "1 1 1"];
        let numbered: String = points.iter().zip(1..).map(|(p, n)| format!("{n} {p}\n")).collect();
        let lines = points.join("\n");
        let entities =
            "$Entities\n1 0 0 2\n1 0 0 0 0\n1 0 0 0 1 1 1 1 30 0\n2 0 0 0 1 1 1 2 40 41 1 -9\n$EndEntities\n";
        let vtk = |data: &str| {
            format!(
                "# vtk DataFile Version 3.0\nx\nASCII\nDATASET UNSTRUCTURED_GRID\nPOINTS 5 double\n{lines}\nCELLS 4 19\n3 0 1 2\n\
                 4 0 1 2 3\n4 0 1 2 3\n4 1 2 3 4\nCELL_TYPES 4\n5 10 10 10\n{data}"
            )
        };
        let vtu = |label: &str| {
            let array = |name: &str, kind: &str, text: &str| {
                format!("<DataArray type=\"{kind}\" Name=\"{name}\" format=\"ascii\">{text}</DataArray>")
            };
            let text = [
                "<VTKFile type=\"UnstructuredGrid\"><UnstructuredGrid><Piece><Points>".to_owned(),
                array("Points", "Float64", &points.join(" ")),
                "</Points><Cells>".into(),
                array("connectivity", "Int32", "0 1 2 0 1 2 3 0 1 2 3 1 2 3 4"),
                array("offsets", "Int32", "3 7 11 15"),
                array("types", "Int32", "5 10 10 10"),
                "</Cells><CellData>".into(),
                array("pressure", "Float64", "0.1 0.2 0.2 0.3"),
                array(label, "UInt8", "9 30 30 40"),
                "</CellData></Piece></UnstructuredGrid></VTKFile>".into(),
            ];
            text.concat()
        };
        for (name, text, called) in [
            (
                "1.msh",
                format!(
                    "$NOD\n5\n{numbered}$ENDNOD\n$ELM\n4\n1 2 5 6 3 1 2 3\n2 4 30 1 4 1 2 3 4\n3 4 30 1 4 1 2 3 4\n4 4 40 2 4 2 3 4 5\n\
                     $ENDELM\n"
                ),
                "physical",
            ),
            (
                "2.msh",
                format!(
                    "$MeshFormat\n2.2 0 8\n$EndMeshFormat\n$Nodes\n5\n{numbered}$EndNodes\n$Elements\n4\n1 2 2 5 6 1 2 3\n2 4 2 0 30 1 2 \
                     3 4\n3 4 2 0 30 1 2 3 4\n4 4 3 0 40 8 2 3 4 5\n$EndElements\n"
                ),
                "elementary",
            ),
            (
                "4.msh",
                format!(
                    "$MeshFormat\n4.1 0 8\n$EndMeshFormat\n{entities}$Nodes\n1 5 1 5\n3 1 0 5\n1\n2\n3\n4\n5\n{lines}\n$EndNodes\n\
                     $Elements\n2 3 1 3\n3 1 4 2\n1 1 2 3 4\n2 1 2 3 4\n3 2 4 1\n3 2 3 4 5\n$EndElements\n"
                ),
                "physical",
            ),
            (
                "s.vtk",
                vtk(
                    "POINT_DATA 5\nSCALARS t double 1\nLOOKUP_TABLE default\n1 2 3 4 5\nCELL_DATA 4\nSCALARS material int\nLOOKUP_TABLE default\n9 30 30 40\n",
                ),
                "material",
            ),
            (
                "f.vtk",
                vtk(
                    "CELL_DATA 4\nVECTORS v double\n1 2 3 4 5 6 7 8 9 1 2 3\nFIELD f 2\nid 1 4 int\n1 2 3 4\nRegion 1 4 double\n9 30 30 40\n",
                ),
                "Region",
            ),
            ("a.vtu", vtu("PartIds"), "PartIds"),
            ("b.vtu", vtu("x"), "x"),
            (
                "a.mesh",
                format!(
                    "MeshVersionFormatted 2\nDimension 3\nVertices 5\n{}Triangles 1\n1 2 3 9\nTetrahedra 3\n1 2 3 4 30\n1 2 3 4 30\n2 3 4 \
                     5 40\nEnd\n",
                    points.map(|p| format!("{p} 0\n")).concat()
                ),
                "reference",
            ),
        ] {
            let files = [(PathBuf::from(name), text.clone().into_bytes())];
            let (Solid::Volume(found), _) = parse(&files, LengthUnit::Metre, 0.0, None).unwrap() else {
                panic!("{name}")
            };
            assert_eq!((found.labels.name.as_str(), &found.labels.of[..]), (called, &[30, 40][..]), "{name}");
            let refused = parse(&files, LengthUnit::Metre, 0.0, Some("none such")).unwrap_err().to_string();
            assert!(refused.contains(called), "{refused}");
            // Labels that are cut off are not lost in silence.
            if name.ends_with("vtk") {
                let cut = [(PathBuf::from(name), text.replace("30 40\n", "").into_bytes())];
                let refused = parse(&cut, LengthUnit::Metre, 0.0, None).unwrap_err().to_string();
                assert!(refused.contains("VTK file, line ") && refused.contains("cut off"), "{refused}");
            }
        }
        let node = format!("5 3 0 0\n{numbered}").into_bytes();
        let ele = b"3 4 2\n1 1 2 3 4 30 7\n2 1 2 3 4 30 7\n3 2 3 4 5 40 8\n".to_vec();
        let files = [("a.node".into(), node), ("a.ele".into(), ele)];
        let (Solid::Volume(found), _) = parse(&files, LengthUnit::Metre, 0.0, None).unwrap() else { panic!() };
        assert_eq!((found.labels.name.as_str(), &found.labels.of[..]), ("attribute", &[30, 40][..]));
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
            let Some(path) = shared(&format!("meshes/{name}")) else { return };
            let surface = read_surface(&path, LengthUnit::Millimetre).unwrap_or_else(|e| panic!("{name}: {e}"));
            assert_eq!(surface.vertices.len(), vertices, "{name}");
            assert!((1e3 * surface.volume() - litres).abs() < 0.001, "{name}: {}", surface.volume());
        }
    }

    #[test]
    fn a_real_open_surface_is_refused_or_closed_on_request_and_one_that_meets_itself_is_refused() {
        let (Some(bunny), Some(dragon)) = (shared("meshes/bunny.obj"), shared("meshes/dragon.stl")) else { return };
        assert!(matches!(read_surface(&bunny, LengthUnit::Metre), Err(MeshError::NotClosed { border_edges: 42, .. })));
        assert!(matches!(read_surface(&dragon, LengthUnit::Metre), Err(MeshError::NonManifold { .. })));
        let (solid, repairs) = parse(&read_files(&bunny).unwrap(), LengthUnit::Metre, 1.0, None).unwrap();
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
            let Some(path) = shared(&format!("meshes/{name}")) else { return };
            let mesh = read_tet_mesh(&path, LengthUnit::Metre).unwrap_or_else(|e| panic!("{name}: {e}"));
            assert_eq!((mesh.nodes.len(), mesh.elements.len()), (nodes, elements), "{name}");
            assert!((0..elements).all(|e| mesh.volume(e) > 0.0));
        }
        let Some(bad) = shared("meshes/6_tetra_bad.msh") else { return };
        let error = read_tet_mesh(&bad, LengthUnit::Metre);
        assert!(matches!(error, Err(MeshError::Inverted { element: 44, count: 1, total: 6, .. })), "{error:?}");
    }
}
