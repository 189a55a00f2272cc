//! The viewer: the deforming organ, its tools and forces, drawn from the surface stream or from a recording.
//!
//! | module | is | does not know |
//! |---|---|---|
//! | [`source`] | bytes from the wire or from a file to moments in time | drawing |
//! | [`deformation`] | normals, strain, displacement of a surface | tools, colours |
//! | [`colour`] | what a colour means | drawing |
//! | [`tool_shape`], [`contact`], [`obstacle`] | what tools and obstacles look like, where they are, and where tools touch | drawing |
//! | [`history`] | what the plots show | drawing |
//! | [`orbit`], [`pick`] | where the picture is taken from, and what is under the pointer | OpenGL |
//! | [`poke`] | a tool that the mouse holds, a client of its own | drawing |
//! | [`Scenes`] | servers of bundled scenes, as processes of their own | drawing |
//! | [`app`] | what is on the screen: a source and how it is looked at | OpenGL |
//! | [`panels`] | plots, buttons, text; mouse and keyboard | OpenGL |
//! | [`shading`], [`scene`], [`painter`] | a picture of an [`app::App`], with OpenGL | windows, files |
//! | [`window`] | pictures on a display | files |
//! | [`offscreen`], [`snapshot`] | pictures without a display | windows |
//! | [`Args`], [`run`] | the command line | OpenGL |
//!
//! Every picture comes from bytes that were decoded from the wire or a recording: nothing here links the simulation.
//!
//! Units are SI, frames right-handed with +z up.

#![allow(rustdoc::broken_intra_doc_links, reason = "units stand in square brackets, as in `[m]`")]

mod args;

pub mod app;
pub mod colour;
pub mod contact;
pub mod deformation;
pub mod history;
pub mod obstacle;
pub mod offscreen;
pub mod orbit;
pub mod painter;
pub mod panels;
pub mod pick;
pub mod poke;
pub mod scene;
mod scenes;
pub mod shading;
pub mod snapshot;
pub mod source;
pub mod tool_shape;
pub mod window;

pub use args::{Args, run};
pub use scenes::Scenes;
// Vectors, views and egui in the interfaces above are of this version.
pub use three_d;
