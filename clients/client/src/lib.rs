//! What every Palpate client computes, in whatever language and over whatever network: no network, C or clock in here.
//!
//! | module | gives |
//! |---|---|
//! | [`Renderer`] | the force at the device's own rate, from the [`Wrench`]es that came |
//! | [`Order`] | which wrenches are taken |
//! | [`watchdog_scale`], [`Grip`] | how a force fades when wrenches stop, and whether the tool is still in the hand |
//! | [`Device`] | a device's limits |
//! | [`Frame`] | axes, units and quaternions of other systems |
//! | [`Registration`], [`Clutch`] | where the device lies in the body |
//! | [`Surface`], [`SurfaceDecoder`] | the surface from the messages of its topology and its frames |
//! | [`Link`] | a bad network, in simulated time |
//!
//! Time is an argument, in nanoseconds on any monotonic clock. Units are SI, frames right-handed, quaternions x, y, z, w.
//! `proto/contract.md` states the laws; its test vectors hold this crate to them. `palpate-sdk` adds zenoh.
#![allow(rustdoc::broken_intra_doc_links)] // units stand in square brackets: [m]

mod device;
mod error;
mod frame;
mod link;
mod order;
mod pose;
mod registration;
mod renderer;
mod surface;
mod watchdog;
mod wrench;

pub use device::Device;
pub use error::ClientError;
pub use frame::Frame;
pub use link::{Link, LinkConditions};
pub use order::{Order, Verdict};
pub use palpate_proto as proto;
pub use pose::PoseSample;
pub use registration::{Clutch, Fit, Registration};
pub use renderer::{RenderMode, Renderer};
pub use surface::{Material, Moment, Picture, Surface, SurfaceDecoder};
pub use watchdog::{Grip, Hold, watchdog_scale};
pub use wrench::{LocalModel, WRENCH_BYTES, Wrench};
