//! Shapes at rest: surfaces, tetrahedral meshes, where a point lies in them, and the files they come from.
//!
//! Knows nothing of materials, levels or time.

pub mod crossings;
pub mod decimate;
pub mod locate;
pub mod mesh_error;
pub mod mesh_io;
pub mod moments;
mod msh;
pub mod primitives;
pub mod soundness;
pub mod surface;
mod surface_file;
pub mod tet_mesh;

pub use mesh_error::MeshError;
pub use moments::Moments;
pub use surface::Surface;
pub use tet_mesh::TetMesh;
