//! Recordings for tools that know nothing of Palpate: a table of what hands did and felt, the surface for ParaView, all of it
//! for Foxglove.

mod foxglove;
mod table;
mod vtu;

pub use foxglove::write_foxglove;
pub use table::write_table;
pub use vtu::{Series, write_series};

use crate::recording::Recording;
use crate::wire;
use palpate_client::{ClientError, Moment, Surface, SurfaceDecoder};
use std::sync::Arc;

/// What the frames of a recording call its only surface.
const TOPOLOGY: u32 = 1;

/// The surface of a recording as it lay at rest.
///
/// # Errors
/// When the recording is damaged there.
pub fn surface(recording: &Recording) -> Result<Arc<Surface>, ClientError> {
    let parts = wire::surface::topology(&recording.body, &recording.display, TOPOLOGY);
    Surface::from_parts(parts).map(Arc::new)
}

/// `surface` as it moved, frame by frame.
pub fn moments(recording: &Recording, surface: Arc<Surface>) -> impl Iterator<Item = Result<Moment, ClientError>> + '_ {
    let mut decoder = SurfaceDecoder::new(surface);
    recording.frames.values().flatten().filter_map(move |frame| decoder.receive(frame).transpose())
}
