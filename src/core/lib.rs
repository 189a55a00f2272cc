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
//! | [`geometry`] | shapes at rest: surfaces, tetrahedra, where a point lies | materials, levels, time |
//! | [`hierarchy`] | levels of resolution and what ties them together | motion, tools |
//! | [`model`] | a body (fixed), its state (moving), the material law and its kernel | steps, tools, messages |
//! | [`stepping`] | how a tick moves the body, and the contact solve | tools, clocks |
//! | [`adaptation`] | when and where to refine and coarsen, within the work budget | tools, clocks, how constraints are solved |
//! | [`contact`] | tools, where they touch, the wrench, the limits of what a hand feels | how constraints are solved |
//! | [`simulation`] | `advance(&Inputs) -> &Outputs`: the core ends here | clocks, files, networks, threads, logs |
//! | [`feedback`] | how the force will change where the tool goes next, for hands that are far away | ticks: it looks at a copy |
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
//! A ball pressed 5 mm into a cube that stands on a table:
//! ```
//! use palpate_core::contact::safety::ForceLimits;
//! use palpate_core::contact::tool::{Coupling, Following, PoseSample, Shape, Tool, ToolEvent};
//! use palpate_core::geometry::primitives::{box_mesh, box_surface};
//! use palpate_core::math::{Pose, Vec3};
//! use palpate_core::model::{Body, Material, body::BodyParts};
//! use palpate_core::simulation::{Inputs, Settings, Simulation, Snapshot};
//!
//! // 0.1 m wide, 10 kPa stiff, in 6 × 6 × 6 cells of tetrahedra; its lowest nodes do not move.
//! let (size, cells) = (Vec3::repeat(0.1), [6; 3]);
//! let material = Material { psi: 5.0, ..Material::from_young(1e4, 0.35, 1000.0) };
//! let mut parts = BodyParts::of_mesh("cube", box_mesh(size, cells), box_surface(size, cells), material);
//! let level = &mut parts.levels[0];
//! level.fixed = (0..).zip(&level.mesh.nodes).filter(|(_, u)| u.z == 0.0).map(|(n, _)| n).collect();
//! let body = Body::new(parts)?;
//!
//! let settings = Settings {
//!     gravity: Vec3::zeros(),
//!     tools: vec![Tool { name: "ball".into(), shape: Shape::ball(0.02), friction: 0.0 }],
//!     following: Following { speed: 1.0, engage_ticks: 1 },
//!     limits: ForceLimits { force: 100.0, torque: 10.0, slew: 1e6 },
//!     adaptivity: None,
//!     most_elements: body.element_count(),
//! };
//! let start = Snapshot::at_rest(&body, 0, 1);
//! let mut simulation = Simulation::new(body.into(), settings, start)?;
//!
//! let mut inputs = Inputs::default();
//! inputs.tools[0] = Some(ToolEvent::Attach { epoch: 1, period_ticks: 1, coupling: Coupling::RIGID });
//! simulation.advance(&inputs);
//! for tick in 0..700 {
//!     // From 1 mm above the cube 10 mm/s downward, then at rest.
//!     let height = (0.121 - 1e-5 * f64::from(tick)).max(0.115);
//!     let pose = Pose { position: Vec3::new(0.05, 0.05, height), ..Pose::default() };
//!     inputs.tools[0] = Some(ToolEvent::Pose(PoseSample { sequence: tick, pose, ..PoseSample::default() }));
//!     simulation.advance(&inputs);
//! }
//! let force = simulation.outputs().tools[0].state.physical_force;
//! println!("{:.2} N", force.z);
//! assert!(force.z > 0.6 && force.z < 1.0 && force.x.abs() < 0.1);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

#![allow(rustdoc::broken_intra_doc_links, reason = "units stand in square brackets, as in `[m]`")]

pub mod adaptation;
pub mod contact;
pub mod feedback;
pub mod geometry;
#[doc = include_str!("glossary.md")]
pub mod glossary {}
pub mod hierarchy;
pub mod math;
pub mod model;
pub mod simulation;
pub mod stepping;
