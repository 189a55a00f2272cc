//! Palpate.
pub mod contact;
pub mod geometry;
pub mod hierarchy;
pub mod math;
pub mod model;
pub mod offline;
pub mod prepare;
pub mod scene;
pub mod simulation;
pub mod stepping;
