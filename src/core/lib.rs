//! The core of Palpate: soft bodies that answer to touch, in one function of its inputs.
//!
//! It stands alone: no clock, file, network, thread or log, and nothing that only one system has.
//!
//! # The map
//! Data flows down this list. A module may use what stands above it, and only that; `tests/layering.rs` at the top of the
//! project holds it to it.
//!
//! | module | is | does not know |
//! |---|---|---|
//! | [`math`] | one scalar, one vector, one pose; nalgebra to parry | anything else |
//! | [`ids`] | numbers that things go by | anything else |
//! | [`visited`] | which of the things of one kind have been looked at | anything else |
//! | [`geometry`] | shapes at rest: surfaces, tetrahedra, where a point lies | materials, levels, time |
//! | [`hierarchy`] | levels of resolution and what ties them together | motion, tools |
//! | [`model`] | a body (fixed), its state (moving), the material law and its kernel | when it is moved, and how far; of tools all but their index and points of contact; messages |
//! | [`stepping`] | how a tick moves the body, and the contact solve | shapes and poses of tools: their points have an index; clocks: times are arguments |
//! | [`adaptation`] | when and where to refine and coarsen, within the work budget | of tools all but the axis and radius of a [`Focus`](adaptation::Focus); clocks; how constraints are solved |
//! | [`contact`] | tools, where they touch, the wrench, the limits of what a hand feels | how constraints are solved |
//! | [`simulation`] | `advance(&Inputs) -> &Outputs`: the core ends here | clocks, files, networks, threads, logs |
//! | [`feedback`] | how the force will change where the tool goes next, for hands that are far away | the running simulation: it looks at a copy |
//!
//! # Invariants
//! - **The core is a function.** Body, settings and ordered [`simulation::Inputs`] give the same states and forces, bit
//!   for bit, on any x86-64 machine: only `+ − × ÷ √`, no fused multiply-add, every sum in a fixed order.
//! - **Nothing else enters a tick.** Ticks that the machine lost, the budget and the prices of work are inputs, and recorded.
//! - **The tick is poor.** No allocation, lock, log or system call.
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
//! The [`glossary`] has all terms and symbols, and the sources: `[DDCB01]`, `[Hertz 1881]`, `[Johnson 1985]` and others.
//!
//! # Example
//! A ball pressed 5 mm into a cube that stands on a table, `examples/press_a_cube.rs`:
#![doc = concat!("```\n", include_str!("examples/press_a_cube.rs"), "```")]
#![allow(rustdoc::broken_intra_doc_links, reason = "units stand in square brackets, as in `[m]`")]

pub mod adaptation;
pub mod contact;
pub mod feedback;
pub mod geometry;
#[doc = include_str!("glossary.md")]
pub mod glossary {}
pub mod hierarchy;
pub mod ids;
pub mod math;
pub mod model;
pub mod simulation;
pub mod stepping;
pub mod visited;
