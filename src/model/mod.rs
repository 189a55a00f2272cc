//! Physics: what a body is made of and how its elements answer to deformation.
//!
//! Knows levels and shapes; knows nothing of steps, tools or messages.

pub mod body;
pub mod constraint;
pub mod element_kernel;
pub mod energy;
pub mod lanes;
pub mod material;
pub mod skin;
pub mod state;

pub use body::Body;
pub use constraint::{Constraint, Row};
pub use material::Material;
pub use state::State;
