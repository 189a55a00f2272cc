//! Bodies for [`palpate_core`]: from files and shapes to levels that are tied together and answer alike.
//!
//! What takes seconds and memory once, so that a tick takes neither.
//!
//! # The map
//! Data flows down this list, from the core's shapes and levels. A module may use what stands above it, and only that;
//! `tests/layering.rs` at the top of the project holds it to it.
//!
//! | module | is | does not know |
//! |---|---|---|
//! | [`geometry`] | shapes on their way in: mesh files, repair, what is sound, what is shown | materials (labels are numbers), levels, time |
//! | [`cover`] | levels from a closed surface, by lattices | motion; of materials all but the density |
//! | [`prepare`] | shapes to a body, its file, and what it is like | scenes: a file keeps the text of one, unread |
//!
//! # Example
//! A body from a closed surface, with its file, `examples/make_a_body.rs`:
#![doc = concat!("```no_run\n", include_str!("examples/make_a_body.rs"), "```")]
#![allow(rustdoc::broken_intra_doc_links, reason = "units stand in square brackets, as in `[m]`")]

pub mod cover;
pub mod geometry;
pub mod prepare;
