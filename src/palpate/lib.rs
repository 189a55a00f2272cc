//! Palpate: touch soft bodies in real time.
//!
//! A haptic device or a VR controller sends the pose of a tool; Palpate simulates the organ under it and answers with
//! the force, a thousand times a second, and streams the deforming surface to every viewer.
//!
//! The [`guide`] explains the use: scenes, bodies, commands, clients, recordings, method. What follows is for those who
//! change the code.
//!
//! # The map
//! Four crates, cut where their dependencies differ, each with a map of its own:
//! - [`palpate_core`], the physics: a function without a clock, file, network, thread or log;
//! - [`palpate_body`], from mesh files to bodies;
//! - `palpate`, this one: scenes, recordings, the real-time thread, the server and the command line;
//! - `palpate-study`, the paper's figures, its printed variants and what adaptive resolution buys; no part of the others.
//!
//! Clients stand beside them, and know none but the contract, `palpate-proto`: `palpate-client` is what all of them compute,
//! without network, C or clock; `palpate-sdk` adds zenoh and the interface for C; phantom and viewer use it. The package for
//! Python has both sides, as it simulates in process, too.
//!
//! Data flows down this list, after the core and the bodies. A module may use what stands above it, and only that;
//! `tests/layering.rs` holds it to it.
//!
//! | module | is | does not know |
//! |---|---|---|
//! | [`guide`] | pages of the manual, no code | all else |
//! | [`output`] | files that come to be as a whole, or not at all | what is in them |
//! | [`writable`] | places for results, tried before the work | what goes there |
//! | [`terminal`] | lines for people, whose readers may be gone | what they say |
//! | `picture` | panels of a picture, and cuts through the levels of a body on them | scenes |
//! | [`display`] | the surface that viewers get, on the one that is touched | scenes, messages |
//! | [`scene`] | scene text to checked parameters, a body and settings | networks |
//! | [`preparation`] | mesh files to a body in a file | networks, reports |
//! | [`offline`] | a simulation under a trajectory, as fast as it goes | networks; clocks, but to say how fast that was |
//! | [`wire`] | messages to core types and back; what is refused and why | zenoh, threads |
//! | [`recording`] | what a run consumed; run it again and compare | networks; clocks, but to say how fast that was |
//! | [`export`] | a recording for ParaView, Foxglove and tables | networks |
//! | [`realtime`] | the 1 kHz thread, its pacer, governor and mailboxes | zenoh, messages |
//! | [`server`] | postman between zenoh and the simulation thread | physics |
//!
//! # Invariants
//! Beside [those of the core](palpate_core#invariants), whose [symbols](palpate_core#symbols) hold here, too:
//! - **The tick is poor.** The thread that ticks allocates nothing, takes no lock, logs nothing, and makes no system call but
//!   the clock, its sleep and one wake-up.
//! - **What a tick consumed is recorded**: inputs, ticks that the machine lost, the budget and the prices of work.

#![allow(rustdoc::broken_intra_doc_links, reason = "units stand in square brackets, as in `[m]`")]

pub mod display;
pub mod export;
pub mod guide;
pub mod offline;
pub mod output;
#[cfg(feature = "pictures")]
pub mod picture;
pub mod preparation;
pub mod realtime;
pub mod recording;
pub mod scene;
pub mod server;
pub mod terminal;
pub mod wire;
pub mod writable;
