//! `palpate._native`: what the package `palpate` in Python is made of; `python/palpate/_native.pyi` documents it.
//!
//! | module | gives Python |
//! |---|---|
//! | `poses` | arrays of poses in, checked |
//! | `wrenches` | wrenches out, one by one or as arrays |
//! | `simulation` | a simulation in this process |
//! | `network` | tools and surfaces of a server, over the SDK |
//! | `recording` | recordings as arrays |
//! | `preparing` | bodies from mesh files |
//!
//! Whatever takes time lets go of Python's lock.

// What calls Python links only into a Python: `cargo test --lib` finds nothing here, and pytest tests it.
#![cfg(not(test))]

mod network;
mod poses;
mod preparing;
mod recording;
mod simulation;
mod wrenches;

use pyo3::exceptions::{PyConnectionError, PyOSError, PyValueError};
use pyo3::prelude::*;

/// A value that makes no sense, in the words of whoever refused it.
fn bad_value(error: impl ToString) -> PyErr {
    PyValueError::new_err(error.to_string())
}

/// A server that is away, or refuses.
fn no_connection(error: impl ToString) -> PyErr {
    PyConnectionError::new_err(error.to_string())
}

/// A file that cannot be read or written, or is none of ours.
fn bad_file(error: impl ToString) -> PyErr {
    PyOSError::new_err(error.to_string())
}

#[pymodule]
mod _native {
    #[pymodule_export]
    use super::network::{Connection, Tool, Watch, connect};
    #[pymodule_export]
    use super::preparing::prepare;
    #[pymodule_export]
    use super::recording::{Recording, read_recording};
    #[pymodule_export]
    use super::simulation::Simulation;
    #[pymodule_export]
    use super::wrenches::{Wrench, Wrenches};
}
