//! Time: how one tick moves the body.
//!
//! Knows the body, its motion and a list of point constraints; knows nothing of tools, clocks or messages, nor of why
//! the resolution is what it is.

pub mod constraint_solve;
pub mod governor;
pub mod step;
pub mod work;
