//! Physics: what a body is made of, which of its nodes are active, and how its elements answer to deformation.
//!
//! Knows levels and shapes. Of tools it has points of contact alone, with an index, an arm and a coupling
//! ([`Constraint`]): no shape and no pose. Knows nothing of messages, or of why a resolution is chosen.

pub mod active_mesh;
pub mod active_set;
pub mod body;
pub mod constraint;
pub mod csr;
pub mod element;
mod element_block;
pub mod element_kernel;
pub mod element_pool;
pub mod energy;
pub mod entangled;
pub mod fibres;
pub mod interface;
pub mod lanes;
pub mod material;
pub mod meeting;
pub mod organ;
pub mod periodic;
pub mod simd;
pub mod state;
pub mod step_class;
pub mod sweeps;

pub use active_mesh::ActiveMesh;
pub use body::Body;
pub use constraint::{Constraint, Friction, Row};
pub use fibres::Fibres;
pub use material::Material;
pub use organ::Organ;
pub use periodic::{Periodic, SupportMotion};
pub use state::State;
