//! What there is to see: the surface of the body, and the server's status.

use palpate_proto::{Message, Status, SurfaceFrame, SurfaceTopology, keys};
use zenoh::{Wait, pubsub::Subscriber};

use crate::{Connection, SdkError, error::reason};

/// The triangulated surface of the body at rest.
#[derive(Clone, Debug, PartialEq)]
pub struct Surface {
    /// Frames of this surface carry the same number.
    pub topology: u32,
    /// (n) vertex numbers of each triangle, counter-clockwise seen from outside; all below `rest_positions.len()`.
    pub triangles: Vec<[u32; 3]>,
    /// (vertices) [m].
    pub rest_positions: Vec<[f32; 3]>,
}

/// A running subscription; it ends when this is dropped.
pub struct Subscription {
    _subscriber: Subscriber<()>,
    // Last, so that the subscription goes before its session closes.
    _connection: Connection,
}

impl Connection {
    /// The surface of the body. Errors: [`SdkError::NoAnswer`] after 2 s, [`SdkError::Undecodable`] when a triangle
    /// names a vertex that does not exist.
    pub fn surface_topology(&self) -> Result<Surface, SdkError> {
        let message: SurfaceTopology =
            self.ask(keys::surface_topology(&self.endpoints().session), None, "SurfaceTopology")?;
        surface(&message)
    }

    /// Calls `callback` with each surface frame, about 31 times a second. It runs on a receiving thread of zenoh and
    /// must return quickly. Messages that are no frame are left out. Errors: [`SdkError::Zenoh`].
    pub fn subscribe_surface(
        &self,
        callback: impl Fn(SurfaceFrame) + Send + Sync + 'static,
    ) -> Result<Subscription, SdkError> {
        self.subscribe(keys::surface_frame(&self.endpoints().session), callback)
    }

    /// Calls `callback` with the server's status, once a second; otherwise as
    /// [`subscribe_surface`](Self::subscribe_surface).
    pub fn subscribe_status(
        &self,
        callback: impl Fn(Status) + Send + Sync + 'static,
    ) -> Result<Subscription, SdkError> {
        self.subscribe(keys::status(&self.endpoints().session), callback)
    }

    fn subscribe<M: Message + Default>(
        &self,
        key: String,
        callback: impl Fn(M) + Send + Sync + 'static,
    ) -> Result<Subscription, SdkError> {
        let subscriber = self
            .surface_session()
            .declare_subscriber(&key)
            .callback(move |sample| {
                if let Ok(message) = M::decode(&*sample.payload().to_bytes()) {
                    callback(message);
                }
            })
            .wait()
            .map_err(|error| SdkError::Zenoh { operation: "subscribe to", key, reason: reason(error) })?;
        Ok(Subscription { _subscriber: subscriber, _connection: self.clone() })
    }
}

/// The vertices of a frame (vertices) [m]. Errors: [`SdkError::Undecodable`] when the bytes are no whole positions.
pub fn frame_positions(frame: &SurfaceFrame) -> Result<Vec<[f32; 3]>, SdkError> {
    triples(&frame.positions, f32::from_le_bytes).ok_or_else(|| SdkError::Undecodable {
        message: "SurfaceFrame",
        reason: format!("{} bytes are no whole positions", frame.positions.len()),
    })
}

fn surface(message: &SurfaceTopology) -> Result<Surface, SdkError> {
    let undecodable = |reason: &str| SdkError::Undecodable { message: "SurfaceTopology", reason: reason.to_owned() };
    let triangles = triples(&message.triangles, u32::from_le_bytes).ok_or(undecodable("triangles are not whole"))?;
    let rest_positions =
        triples(&message.rest_positions, f32::from_le_bytes).ok_or(undecodable("positions are not whole"))?;
    if rest_positions.len() != message.vertices as usize {
        return Err(undecodable("positions are not as many as vertices"));
    }
    if triangles.iter().flatten().any(|&vertex| vertex >= message.vertices) {
        return Err(undecodable("a triangle names a vertex that does not exist"));
    }
    Ok(Surface { topology: message.topology, triangles, rest_positions })
}

/// `bytes` as triples of four-byte numbers; `None` when they are not whole.
fn triples<T: Copy>(bytes: &[u8], number: impl Fn([u8; 4]) -> T) -> Option<Vec<[T; 3]>> {
    let (triples, rest) = bytes.as_chunks::<12>();
    rest.is_empty().then_some(())?;
    let number_at = |triple: &[u8; 12], at: usize| number([0, 1, 2, 3].map(|byte| triple[4 * at + byte]));
    Some(triples.iter().map(|triple| [0, 1, 2].map(|at| number_at(triple, at))).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn one_triangle() -> SurfaceTopology {
        SurfaceTopology {
            topology: 4,
            vertices: 3,
            triangles: [0u32, 1, 2].iter().flat_map(|v| v.to_le_bytes()).collect(),
            rest_positions: [0.0f32, 0., 0., 1., 0., 0., 0., 1., 0.5].iter().flat_map(|x| x.to_le_bytes()).collect(),
        }
    }

    #[test]
    fn a_surface_reads_back_what_was_written() {
        let surface = surface(&one_triangle()).unwrap();
        assert_eq!(surface.triangles, [[0, 1, 2]]);
        assert_eq!(surface.rest_positions[2], [0.0, 1.0, 0.5]);
    }

    #[test]
    fn a_surface_that_does_not_fit_together_is_refused() {
        assert!(surface(&SurfaceTopology { vertices: 2, ..one_triangle() }).is_err());
        assert!(surface(&SurfaceTopology { triangles: vec![0; 11], ..one_triangle() }).is_err());
        let missing = [0u32, 1, 3].iter().flat_map(|v| v.to_le_bytes()).collect();
        assert!(surface(&SurfaceTopology { triangles: missing, ..one_triangle() }).is_err());
        assert!(frame_positions(&SurfaceFrame { positions: vec![0; 13], ..Default::default() }).is_err());
    }
}
