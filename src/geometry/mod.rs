//! Shapes at rest: surfaces, tetrahedral meshes, where a point lies in them, and the files they come from.
//!
//! Knows nothing of materials, levels or time.

mod cells;
pub mod crossings;
pub mod decimate;
pub mod display;
mod gltf;
pub mod labels;
pub mod locate;
mod medit;
mod mesh_error;
pub mod mesh_io;
pub mod moments;
mod msh;
pub mod pieces;
mod ply;
pub mod primitives;
mod reader;
pub mod repair;
pub mod soundness;
pub mod surface;
mod surface_file;
pub mod tet_mesh;
mod tetgen;
mod vtk;
mod vtk_xml;

pub use labels::{LabelledMesh, Labels};
pub use mesh_error::MeshError;
pub use moments::Moments;
pub use surface::Surface;
pub use tet_mesh::TetMesh;
