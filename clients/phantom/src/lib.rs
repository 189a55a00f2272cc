//! The virtual Phantom: a haptic device and the hand that holds it, in closed loop over the network.
//!
//! Data flow: a [`Path`] says where the hand wants to be; [`HeldDevice`] moves and turns device and hand under its pull and
//! the force and torque that [`Renderer`](palpate_sdk::Renderer) makes of the server's; [`run`] sends the pose the encoders report a
//! thousand times a second, over a [`Link`](palpate_sdk::Link) as bad as asked for, and measures what comes back. Device, hand and path know no clock and no network: the same inputs give the same motion.
#![allow(rustdoc::broken_intra_doc_links)] // units stand in square brackets: [m]

mod hand;
mod network;
mod path;
mod report;
mod run;
mod scheduling;
mod site;
mod wrench_log;

/// A vector of the world frame (3), in the unit its name says.
pub type Vec3 = nalgebra::Vector3<f64>;

pub use hand::{Given, Hand, HeldDevice};
pub use network::Network;
pub use palpate_sdk::Device;
pub use path::{Path, Pattern, Site, Target};
pub use report::{Distribution, Live, Report, Sample};
pub use run::{Options, run};
pub use site::top_of_surface;
