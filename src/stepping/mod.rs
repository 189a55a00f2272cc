//! Time: how one tick moves the body.
//!
//! Knows the body, its state and a list of point constraints; knows nothing of tools, clocks or messages. Where the
//! work budget comes from is not its business either: it arrives as a count of element evaluations.

pub mod constraint_solve;
pub mod internal_force;
pub mod step;
pub mod time_step;
