//! A bare round trip on the force channel: what the network alone costs.

use std::{
    sync::mpsc::{Receiver, channel},
    time::{Duration, Instant},
};

use palpate_proto::keys;
use zenoh::{
    Wait,
    pubsub::{Publisher, Subscriber},
};

use crate::{Connection, SdkError, connection::realtime_publisher, error::reason};

/// Bytes at the start of a payload that tell whose it is and which.
const TAG_BYTES: usize = 8;

/// Sends payloads to the server's echo and times their return.
pub struct EchoProbe {
    payload: Vec<u8>,
    sequence: u32,
    replies: Receiver<([u8; TAG_BYTES], Instant)>,
    requests: Publisher<'static>,
    _subscriber: Subscriber<()>,
    // Last, so that what is declared on the session goes before it closes.
    _connection: Connection,
}

impl Connection {
    /// A probe with payloads of `bytes` bytes (at least 8), sent just as poses are.
    ///
    /// Errors: [`SdkError::NoForceChannel`], [`SdkError::Zenoh`].
    pub fn round_trip_probe(&self, bytes: usize) -> Result<EchoProbe, SdkError> {
        let force = self.force_session()?;
        let session = &self.endpoints().session;
        let (sender, replies) = channel();
        let key = keys::echo_reply(session);
        let subscriber = force
            .declare_subscriber(&key)
            .callback(move |sample| {
                let arrival = Instant::now();
                if let Some(tag) = sample.payload().to_bytes().first_chunk::<TAG_BYTES>() {
                    // Fails only while the probe is being dropped, when nobody waits any more.
                    let _ = sender.send((*tag, arrival));
                }
            })
            .wait()
            .map_err(|error| SdkError::Zenoh { operation: "subscribe to", key, reason: reason(error) })?;
        let key = keys::echo_request(session);
        let requests = realtime_publisher(force, key)?;
        // Replies reach every client: four random bytes of the session's id tell ours apart.
        let mut payload = vec![0; bytes.max(TAG_BYTES)];
        payload[4..TAG_BYTES].copy_from_slice(&force.zid().to_le_bytes()[..4]);
        Ok(EchoProbe { payload, sequence: 0, replies, requests, _subscriber: subscriber, _connection: self.clone() })
    }
}

impl EchoProbe {
    /// The time from sending one payload to the arrival of its echo; `None` when it does not come within `timeout`.
    pub fn round_trip(&mut self, timeout: Duration) -> Option<Duration> {
        self.sequence = self.sequence.wrapping_add(1);
        self.payload[..4].copy_from_slice(&self.sequence.to_le_bytes());
        let sent = Instant::now();
        self.requests.put(self.payload.as_slice()).wait().ok()?;
        loop {
            let (tag, arrival) = self.replies.recv_timeout(timeout.checked_sub(sent.elapsed())?).ok()?;
            if tag == self.payload[..TAG_BYTES] {
                return Some(arrival - sent);
            }
        }
    }
}
