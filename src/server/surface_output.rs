//! The surface out: every frame, encoded away from the simulation thread.

use super::{ServerError, Shared, network};
use crate::realtime::mailbox::Frame;
use crate::wire;
use palpate_proto::{Message, keys};
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::time::Duration;
use zenoh::qos::{CongestionControl, Priority};

/// How often a new frame is looked for: a frame lasts 32 ms, so a viewer's picture is at most this much older.
const POLL: Duration = Duration::from_millis(4);

pub(super) async fn publish(
    shared: &Arc<Shared>,
    session: &zenoh::Session,
    mut frames: triple_buffer::Output<Frame>,
) -> Result<tokio::task::JoinHandle<()>, ServerError> {
    let publisher = session
        .declare_publisher(keys::surface_frame(&shared.options.session))
        .priority(Priority::DataLow)
        .congestion_control(CongestionControl::Drop)
        .await
        .map_err(network)?;
    let shared = shared.clone();
    Ok(tokio::spawn(async move {
        let mut interval = tokio::time::interval(POLL);
        interval.set_missed_tick_behavior(tokio::time::MissedTickBehavior::Delay);
        let mut sequence = 0;
        loop {
            interval.tick().await;
            if !frames.updated() {
                continue;
            }
            let frame = frames.read();
            sequence += 1;
            let tools = &frame.tools[..shared.scene.tool.len()];
            let message = wire::surface_frame(frame.tick, sequence, &frame.skin, tools);
            if publisher.put(message.encode_to_vec()).await.is_ok() {
                shared.counters.surface_frames.fetch_add(1, Ordering::Relaxed);
            }
        }
    }))
}
