//! The guide: a page per topic.
//!
//! | page | for |
//! |---|---|
//! | [`scenes`] | describing a body, its supports and tools |
//! | [`bodies`] | mesh files, and `palpate prepare` |
//! | [`commands`] | the command line |
//! | [`clients`] | devices, headsets, C, other languages |
//! | [`surface`] | viewers of your own, and the viewer |
//! | [`recordings`] | recordings, replay, trajectories |
//! | [`faults`] | what happens when something goes wrong; limits |
//! | [`method`] | levels, material, time stepping |
//! | [`contact`] | tools, contact points, friction |
//! | [`resolution`] | refinement, governor, budget |
//! | [`remote`] | hands far away |
//! | [`figures`] | what was measured, and how |
//!
//! Terms and symbols: the [glossary](palpate_core::glossary).

#![warn(rustdoc::broken_intra_doc_links)]

#[doc = include_str!("guide/bodies.md")]
pub mod bodies {}
#[doc = include_str!("guide/clients.md")]
pub mod clients {}
#[doc = include_str!("guide/commands.md")]
pub mod commands {}
#[doc = include_str!("guide/contact.md")]
pub mod contact {}
#[doc = include_str!("guide/faults.md")]
pub mod faults {}
#[doc = include_str!("guide/figures.md")]
pub mod figures {}
#[doc = include_str!("guide/method.md")]
pub mod method {}
#[doc = include_str!("guide/recordings.md")]
pub mod recordings {}
#[doc = include_str!("guide/remote.md")]
pub mod remote {}
#[doc = include_str!("guide/resolution.md")]
pub mod resolution {}
#[doc = include_str!("guide/scenes.md")]
pub mod scenes {}
#[doc = include_str!("guide/surface.md")]
pub mod surface {}
