//! The surface stream as it comes, for those who pass it on without decoding it.

use palpate_proto::{SurfaceFrame, SurfaceTopology, keys};

use crate::{Connection, SdkError, Subscription, WatchOptions};

impl Connection {
    /// The parts of the topology. Errors: [`SdkError::NoAnswer`] after 2 s, [`SdkError::Undecodable`].
    pub fn topology_parts(&self) -> Result<Vec<SurfaceTopology>, SdkError> {
        self.ask_all(keys::surface_topology(&self.endpoints().session), None, "SurfaceTopology")
    }

    /// The parts of the newest key frame, with levels. Errors as [`topology_parts`](Self::topology_parts).
    pub fn key_frame(&self) -> Result<Vec<SurfaceFrame>, SdkError> {
        self.ask_all(keys::surface_key(&self.endpoints().session), None, "SurfaceFrame")
    }

    /// Calls `callback` with every part of every frame of the stream. It runs on a receiving thread of zenoh and must
    /// return quickly. Messages that are no frame are left out. Errors: [`SdkError::Zenoh`].
    pub fn subscribe_frames(
        &self,
        options: WatchOptions,
        callback: impl Fn(SurfaceFrame) + Send + Sync + 'static,
    ) -> Result<Subscription, SdkError> {
        let WatchOptions { every, levels } = options;
        self.subscribe(keys::surface_frames(&self.endpoints().session, every, levels), callback)
    }
}
