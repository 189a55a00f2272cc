//! What every Palpate client shares over zenoh: connect, poses out, wrenches and surface in.
//!
//! What needs no network stands in [`palpate_client`], which this crate exports as a whole.
//!
//! Data flow: [`Connection::open`] connects, [`Connection::attach`] takes a [`Tool`], [`Tool::send_pose`] says where it
//! is held, and the server answers each tick with a [`Wrench`]. Viewers use [`Connection::open_surface`] and
//! [`Connection::watch_surface`].
//!
//! A device that renders force: [`Device`] has its limits, [`Frame`] and [`Registration`] say where it lies in the body,
//! [`Renderer`] makes the force at its own rate from the wrenches that came. C and C++ have all of it in `include/palpate.h`.
//!
//! Units are SI, frames right-handed, quaternions x, y, z, w. Nothing here depends on one operating system.
//!
//! # Real time
//! zenoh starts its threads with the first session of the process, and they inherit the scheduling class of the thread
//! that opens it. A client that renders force should raise its own thread first and call [`Connection::open`] from it.
//! Callbacks run on zenoh's receiving threads, which poses and wrenches share: they must return quickly.
#![allow(rustdoc::broken_intra_doc_links)] // units stand in square brackets: [m]

mod c_api;
mod connection;
mod echo;
mod error;
mod relay;
mod tool;
mod watch;

pub use connection::{Connection, Endpoints, Subscription, sessions};
pub use echo::EchoProbe;
pub use error::SdkError;
pub use palpate_client::*;
pub use palpate_proto::{
    ControlReply, ControlRequest, Organ, Role, Session, Status, SurfaceFrame, SurfaceTopology, ToolDescription,
    ToolPhase, ToolState, control_request,
};
pub use tool::{Attachment, Counters, Received, Tool, ToolStatus};
pub use watch::{SurfaceWatch, WatchCounters, WatchOptions};
