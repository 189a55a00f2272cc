//! Palpate.
pub mod contact;
pub mod geometry;
pub mod hierarchy;
pub mod math;
pub mod model;
pub mod offline;
pub mod prepare;
pub mod realtime;
pub mod recording;
pub mod scene;
pub mod server;
pub mod simulation;
pub mod stepping;
pub mod wire;
