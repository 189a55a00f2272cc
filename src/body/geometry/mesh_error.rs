//! What can be wrong with a mesh.

use palpate_core::math::{Real, Vec3};
use std::path::PathBuf;

/// What is wrong with a mesh, where, and what to do about it.
#[derive(Debug, thiserror::Error)]
#[allow(missing_docs, reason = "the message of each variant names its fields")]
pub enum MeshError {
    #[error("cannot read {}: {reason}", path.display())]
    Io { path: PathBuf, reason: std::io::Error },
    #[error(
        "{}: this kind of file is not read here; surfaces come as .obj, .stl, .ply, .off, .glb, .gltf, .vtk, .vtp, .mesh, \
         .msh or .inp, tetrahedra as .msh, .vtk, .vtu, .mesh, .inp or .ele with .node",
        path.display()
    )]
    UnknownFormat { path: PathBuf },
    #[error("'{given}' is no unit of length: write m, cm, mm or in")]
    UnknownUnit { given: String },
    #[error("the file holds more than {limit} {what}: decimate the mesh before loading it")]
    TooBig { limit: usize, what: &'static str },
    #[error("{format} file{}: {what}", line.map_or(String::new(), |n| format!(", line {n}")))]
    Syntax { format: &'static str, line: Option<usize>, what: String },
    #[error("{what} cannot be read: {remedy}")]
    Unsupported { what: String, remedy: &'static str },
    #[error(
        "no labels of tetrahedra are called '{wanted}' in the file: it has {}",
        if has.is_empty() { "none".to_owned() } else { has.join(", ") }
    )]
    NoLabels { wanted: String, has: Vec<String> },
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
         close its holes, with --fill-holes of `palpate prepare`, or in Blender with Mesh > Clean Up > Fill Holes",
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

/// The beginning of a piece of a file, fit for a message.
pub(super) fn shown(bytes: &[u8]) -> String {
    String::from_utf8_lossy(&bytes[..bytes.len().min(40)]).escape_debug().to_string()
}
