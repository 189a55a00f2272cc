//! The clock: one thread that owes a force every millisecond, and what it needs from the system.
//!
//! Wall-clock time enters here and nowhere else, and it reaches the core only as inputs (ticks lost, work budget) that
//! are recorded with the rest. The simulation thread allocates nothing, takes no lock, logs nothing and makes no
//! system call but the clock, its sleep and the wake-up of the force output.

pub mod clock;
pub mod mailbox;
pub mod pacer;
pub mod scheduling;
pub mod sim_thread;
