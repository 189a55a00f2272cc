//! Recordings (MCAP): everything that a run consumed, so that it can be run again, and what it gave, to compare.
//!
//! A recording starts with one `RecordingStart` (scene, body, starting state), then holds for every tick its
//! `TickInputs` and the wrenches of held tools, and for every frame the state's hash and the surface. Log times are
//! simulated time. Any MCAP reader opens it: the schema is embedded.

pub mod replay;
pub mod writer;

pub use replay::{Recording, ReplayReport, replay};
pub use writer::RecordingWriter;

/// Version of what `RecordingStart`, with the body in it, `TickInputs`, the hashes and the surface mean. A change of the
/// physics does not change it: replay says where the result differs.
pub const FORMAT: u32 = 31;

/// Why a recording cannot be written or read.
#[derive(Debug, thiserror::Error)]
pub enum RecordingError {
    /// The file system said no.
    #[error("{path}: {source}")]
    Io {
        /// The recording.
        path: String,
        /// Why.
        source: std::io::Error,
    },
    /// The container is damaged beyond its first messages.
    #[error("{path}: not a readable MCAP file: {source}")]
    Mcap {
        /// The recording.
        path: String,
        /// Why.
        source: mcap::McapError,
    },
    /// Readable, but not a recording of this format.
    #[error("{path}: {what}")]
    Content {
        /// The recording.
        path: String,
        /// What is missing or wrong.
        what: String,
    },
}
