//! Shapes on their way in: the files they come from, what makes them fit for use, and what is shown of them.
//!
//! Knows nothing of materials, levels or time: labels of elements are numbers here.

mod cells;
pub mod crossings;
pub mod decimate;
pub mod display;
pub mod embedded;
mod gltf;
mod inp;
pub mod labels;
mod medit;
mod mesh_error;
pub mod mesh_io;
mod msh;
mod off;
pub mod pieces;
mod ply;
pub mod primitives;
mod reader;
pub mod repair;
pub mod soundness;
mod surface_file;
mod tetgen;
mod text;
pub mod textured;
mod volume;
mod vtk;
mod vtk_xml;

pub use labels::{LabelledMesh, Labels};
pub use mesh_error::MeshError;

#[cfg(test)]
#[path = "../../../tests/common/shared.rs"]
mod shared;
