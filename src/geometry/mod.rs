//! Shapes at rest: surfaces, tetrahedral meshes, where a point lies in them, and the files they come from.
//!
//! Knows nothing of materials, levels or time.

pub mod locate;
pub mod mesh_io;
pub mod primitives;
pub mod surface;
pub mod tet_mesh;

pub use surface::Surface;
pub use tet_mesh::TetMesh;
