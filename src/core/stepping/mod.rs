//! Time: how one tick moves the body.
//!
//! Knows the body, its motion and a list of point constraints, which it sums by the index of their tool. Knows nothing of
//! tools' shapes and poses or of messages, reads no clock, and does not ask why the resolution is what it is.

pub mod constraint_solve;
pub mod governor;
pub mod step;
pub mod work;
