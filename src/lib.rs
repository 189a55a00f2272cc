//! Palpate: touch soft bodies in real time.
//!
//! A haptic device or a VR controller sends the pose of a tool; Palpate simulates the organ under it and answers with
//! the force, a thousand times a second, and streams the deforming surface to every viewer.
//!
//! # The map
//! Data flows down this list. A module may use what stands above it, and only that; `tests/layering.rs` holds it to it.
//!
//! | module | is | does not know |
//! |---|---|---|
//! | [`math`] | one scalar, one vector, one pose; nalgebra to parry | anything else |
//! | [`geometry`] | shapes at rest: surfaces, tetrahedra, where a point lies, mesh files | materials, levels, time |
//! | [`hierarchy`] | levels of resolution and what ties them together | motion, tools |
//! | [`model`] | a body (fixed), its state (moving), the material law and its kernel | steps, tools, messages |
//! | [`stepping`] | how a tick moves the body, and the contact solve | tools, clocks |
//! | [`adaptation`] | when and where to refine and coarsen, within the work budget | tools, clocks, how constraints are solved |
//! | [`contact`] | tools, where they touch, the wrench, the limits of what a hand feels | how constraints are solved |
//! | [`simulation`] | `advance(&Inputs) -> &Outputs`: the core ends here | clocks, files, networks, threads, logs |
//! | [`feedback`] | how the force will change where the tool goes next, for hands that are far away | ticks: it looks at a copy |
//! | [`prepare`] | shapes to a body, its file, and what it is like | scenes |
//! | [`scene`] | scene text to checked parameters, a body and settings | networks |
//! | [`offline`] | a simulation under a trajectory, as fast as it goes | networks, clocks |
//! | [`wire`] | messages to core types and back; what is refused and why | zenoh, threads |
//! | [`recording`] | what a run consumed; run it again and compare | networks, clocks |
//! | [`study`] | the paper's figures, its printed variants, and what adaptive resolution buys; plain code, off the hot path | networks |
//! | [`realtime`] | the 1 kHz thread, its pacer, governor and mailboxes | zenoh, messages |
//! | [`server`] | postman between zenoh and the simulation thread | physics |
//!
//! # Invariants
//! - **The core is a function.** Body, settings and ordered [`simulation::Inputs`] give the same states and forces, bit
//!   for bit, on any x86-64 machine: only `+ − × ÷ √`, no fused multiply-add, every sum in a fixed order.
//! - **Nothing else enters a tick.** Ticks that the machine lost, the budget and the prices of work are inputs, and recorded.
//! - **The tick is poor.** No allocation, lock, log or system call but the clock, its sleep and one wake-up.
//! - **Contact and stepping meet in one list**, [`model::Constraint`]: contact fills it, stepping solves it, contact
//!   sums the multipliers into the wrench.
//! - **Body and state**: [`model::Body`] is built once and only read; [`simulation::Snapshot`] is all that changes, and
//!   exactly what is hashed, saved and restored.
//!
//! # Symbols
//! SI units throughout, in square brackets; shapes in parentheses. `F` deformation gradient, `E` Green strain (the
//! paper's ε is 2E), `S` second Piola–Kirchhoff stress (the paper's σ is 2S), `λ, μ` Lamé parameters, `φ, ψ` the
//! viscosities that go with them.
//!
//! `[DDCB01]`: G. Debunne, M. Desbrun, M.-P. Cani, A. H. Barr, *Dynamic Real-Time Deformations using Space & Time
//! Adaptive Sampling*, SIGGRAPH 2001.

#![allow(rustdoc::broken_intra_doc_links, reason = "units stand in square brackets, as in `[m]`")]

pub mod adaptation;
pub mod contact;
pub mod feedback;
pub mod geometry;
pub mod hierarchy;
pub mod math;
pub mod model;
pub mod offline;
pub mod prepare;
pub mod realtime;
pub mod recording;
pub mod scene;
pub mod server;
pub mod simulation;
pub mod stepping;
pub mod study;
pub mod wire;
