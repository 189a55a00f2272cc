//! The surface out: every frame, encoded away from the simulation thread, on the streams that viewers choose from; and
//! the topology, its pictures and the newest key frame for those who ask.
//!
//! A message that does not fit a viewer's queue is dropped for that viewer: a slow one holds up nobody.

use super::{ServerError, Shared, lock, network};
use crate::realtime::mailbox::Frame;
use crate::wire::surface::{SurfaceEncoder, pictures, topology};
use palpate_proto::surface::EVERY;
use palpate_proto::{self as proto, Message, keys};
use std::sync::atomic::Ordering;
use std::sync::{Arc, Mutex};
use std::time::{Duration, SystemTime, UNIX_EPOCH};
use tokio::task::JoinHandle;
use zenoh::Wait;
use zenoh::bytes::ZBytes;
use zenoh::pubsub::Publisher;
use zenoh::qos::{CongestionControl, Priority};
use zenoh::query::Query;

/// How often a new frame is looked for: a frame lasts 32 ms, so a viewer's picture is at most this much older.
const POLL: Duration = Duration::from_millis(4);

/// The parts of the newest key frame, with levels; none before the first.
type NewestKey = Arc<Mutex<Vec<ZBytes>>>;

/// Starts publishing and answering; both go on until they are aborted.
pub(super) async fn publish(
    shared: &Arc<Shared>,
    session: &zenoh::Session,
    mut frames: triple_buffer::Output<Frame>,
) -> Result<[JoinHandle<()>; 2], ServerError> {
    let name = &shared.options.session;
    let streams = Streams::declare(session, name).await?;
    // Viewers that stayed must not take a frame of this run for one of the last.
    let run = SystemTime::now().duration_since(UNIX_EPOCH).map_or(0, |d| d.as_millis()) as u32;
    let newest_key = NewestKey::default();
    let answering = answer(shared, session, run, newest_key.clone()).await?;
    let shared = shared.clone();
    let publishing = tokio::spawn(async move {
        let mut encoder = SurfaceEncoder::new(shared.display.clone(), run);
        let mut interval = tokio::time::interval(POLL);
        interval.set_missed_tick_behavior(tokio::time::MissedTickBehavior::Delay);
        loop {
            interval.tick().await;
            if !frames.updated() {
                continue;
            }
            let frame = frames.read();
            let tools = &frame.tools[..shared.scene.tool.len()];
            match encoder.frame(frame.tick, &frame.skin, &frame.levels, tools) {
                Ok(parts) => {
                    streams.send(parts, &newest_key).await;
                    shared.counters.surface_frames.fetch_add(1, Ordering::Relaxed);
                }
                Err(e) => tracing::warn!("a frame was left out: {e}"),
            }
        }
    });
    Ok([publishing, answering])
}

/// The streams, each with how many frames it skips and whether levels are in it.
struct Streams(Vec<(u32, bool, Publisher<'static>)>);

impl Streams {
    async fn declare(session: &zenoh::Session, name: &str) -> Result<Self, ServerError> {
        let mut streams = Vec::new();
        for (every, levels) in EVERY.into_iter().flat_map(|every| [(every, false), (every, true)]) {
            let stream = session
                .declare_publisher(keys::surface_frames(name, every, levels))
                .priority(Priority::DataLow)
                .congestion_control(CongestionControl::Drop)
                .await
                .map_err(network)?;
            streams.push((every, levels, stream));
        }
        Ok(Self(streams))
    }

    /// Sends the parts of a frame on every stream that carries it; zenoh sends nothing where nobody listens.
    async fn send(&self, parts: Vec<proto::SurfaceFrame>, newest_key: &NewestKey) {
        let is_key = parts.first().is_some_and(|part| part.key == part.sequence);
        let mut key_parts = Vec::new();
        for mut part in parts {
            let with = ZBytes::from(part.encode_to_vec());
            part.levels.clear();
            let without = ZBytes::from(part.encode_to_vec());
            for (every, levels, stream) in &self.0 {
                if part.sequence.is_multiple_of(u64::from(*every))
                    && let Err(e) = stream.put(if *levels { &with } else { &without }.clone()).await
                {
                    tracing::debug!("a frame was not sent: {e}");
                }
            }
            key_parts.push(with);
        }
        if is_key {
            *lock(newest_key) = key_parts;
        }
    }
}

/// Answers queries for the topology, its pictures and the newest key frame.
async fn answer(
    shared: &Shared,
    session: &zenoh::Session,
    run: u32,
    newest_key: NewestKey,
) -> Result<JoinHandle<()>, ServerError> {
    let name = &shared.options.session;
    let (topology_key, frame_key) = (keys::surface_topology(name), keys::surface_key(name));
    let picture_key = keys::surface_pictures(name);
    let topologies = session.declare_queryable(&topology_key).await.map_err(network)?;
    let key_frames = session.declare_queryable(&frame_key).await.map_err(network)?;
    let picture_queries = session.declare_queryable(&picture_key).await.map_err(network)?;
    let on_it: Vec<ZBytes> = pictures(&shared.display, run).iter().map(|part| part.encode_to_vec().into()).collect();
    let surface = topology(&shared.body, &shared.display, run);
    let surface: Vec<ZBytes> = surface.iter().map(|part| part.encode_to_vec().into()).collect();
    Ok(tokio::spawn(async move {
        loop {
            let (query, key, parts) = tokio::select! {
                Ok(query) = topologies.recv_async() => (query, topology_key.clone(), surface.clone()),
                Ok(query) = picture_queries.recv_async() => (query, picture_key.clone(), on_it.clone()),
                Ok(query) = key_frames.recv_async() => (query, frame_key.clone(), lock(&newest_key).clone()),
                else => return,
            };
            // A reply waits for room in the viewer's queue: on a thread of its own, so that nobody else waits.
            tokio::task::spawn_blocking(move || reply(&query, &key, parts));
        }
    }))
}

fn reply(query: &Query, key: &str, parts: Vec<ZBytes>) {
    for (part, bytes) in parts.into_iter().enumerate() {
        if let Err(e) = query.reply(keys::surface_part(key, part as u32), bytes).wait() {
            tracing::debug!("a viewer's query went unanswered: {e}");
        }
    }
}
