//! Shapes at rest: surfaces, tetrahedral meshes, and where a point lies in them.
//!
//! Knows nothing of materials, levels or time.

pub mod locate;
pub mod moments;
pub mod primitives;
pub mod surface;
pub mod tet_mesh;

pub use moments::Moments;
pub use surface::Surface;
pub use tet_mesh::TetMesh;
