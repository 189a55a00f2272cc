//! Resolution: independent tetrahedral levels of one body and what ties them together.
//!
//! Level 0 is the coarsest. Knows shapes at rest; knows nothing of motion, time or tools.

pub mod embedding;
pub mod level;
pub mod parentage;

pub use level::Level;
