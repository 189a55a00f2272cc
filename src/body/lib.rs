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
//! | [`geometry`] | shapes on their way in: mesh files, repair, what is sound, what is shown | materials, levels, time |
//! | [`cover`] | levels from a closed surface, by lattices | motion, materials |
//! | [`prepare`] | shapes to a body, its file, and what it is like | scenes |
//!
//! # Example
//! A body from a closed surface, with its file:
//! ```
//! use palpate_body::geometry::primitives::sphere_surface;
//! use palpate_body::prepare::{Recipe, Shape, prepare};
//! use palpate_core::model::{Body, Material};
//!
//! let recipe = Recipe {
//!     name: "ball".into(),
//!     shape: Shape::closed(sphere_surface(0.05, 0.01), vec![0.03, 0.018]),
//!     material: Material::from_young(1e4, 0.35, 1000.0),
//!     inclusions: vec![],
//!     holds: vec![],
//!     damping_ratio: 0.1,
//! };
//! let body = prepare(&recipe, &mut |what, step, of| println!("{what} ({step} of {of})"))?;
//! assert!((body.mass() - 0.52).abs() < 0.02);
//! assert_eq!(Body::from_bytes(body.bytes())?.checksum(), body.checksum());
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

#![allow(rustdoc::broken_intra_doc_links, reason = "units stand in square brackets, as in `[m]`")]

pub mod cover;
pub mod geometry;
pub mod prepare;

#[cfg(test)]
#[path = "../../tests/common/shared.rs"]
mod shared;
