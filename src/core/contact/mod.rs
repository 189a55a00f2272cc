//! Touch: tools and obstacles, where they meet the surface, where organs meet each other or themselves, and the wrench that comes of it.
//!
//! Emits point constraints and receives their multipliers; knows nothing of how they are solved.

mod ahead;
mod closing;
mod density;
pub mod dent;
pub mod detection;
mod facing;
pub mod friction;
pub mod ground;
mod hinge;
mod influence;
pub mod jaws;
pub mod meeting;
mod moving_part;
mod nearby;
pub mod obstacle;
pub mod outside;
mod patch;
pub mod posed;
pub mod rigid;
pub mod safety;
mod samples;
pub mod shape;
mod solid;
pub mod tool;
mod touchable;
mod view;
pub mod wrench;

pub use obstacle::Obstacle;
pub use shape::Shape;
pub use tool::{Tool, ToolState};
