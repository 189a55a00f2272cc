//! The surface out: every frame, encoded away from the simulation thread, on the streams that viewers choose from; and
//! the topology, its pictures and the newest key frame for those who ask.
//!
//! A message that does not fit a viewer's queue is dropped for that viewer: a slow one holds up nobody.

use super::health::Weight;
use super::queries::{Answer, Desk};
use super::{ServerError, Shared, lock, network};
use crate::wire::surface::{SurfaceEncoder, pictures, topology};
use palpate_core::simulation::Frame;
use palpate_proto::surface::EVERY;
use palpate_proto::{self as proto, Message, keys};
use std::sync::atomic::Ordering;
use std::sync::{Arc, Mutex};
use std::time::{Duration, SystemTime, UNIX_EPOCH};
use tokio::task::JoinHandle;
use zenoh::bytes::ZBytes;
use zenoh::pubsub::Publisher;
use zenoh::qos::{CongestionControl, Priority};

/// How often a new frame is looked for: a frame lasts 32 ms, so a viewer's picture is at most this much older.
const POLL: Duration = Duration::from_millis(4);

/// The parts of the newest key frame, with levels; none before the first.
type NewestKey = Arc<Mutex<Vec<ZBytes>>>;

/// Starts answering, until the session closes, and publishing, until the task is aborted.
pub(super) async fn publish(
    shared: &Arc<Shared>,
    session: &zenoh::Session,
    desk: &Desk,
    mut frames: triple_buffer::Output<Frame>,
) -> Result<JoinHandle<()>, ServerError> {
    let name = &shared.options.session;
    let streams = Streams::declare(session, name).await?;
    // Viewers that stayed must not take a frame of this run for one of the last.
    let run = SystemTime::now().duration_since(UNIX_EPOCH).map_or(0, |d| d.as_millis()) as u32;
    let newest_key = NewestKey::default();
    answer(shared, session, desk, run, newest_key.clone()).await?;
    let shared = shared.clone();
    let publishing = shared.clone().health.spawn("the task of the surface", Weight::Degrades, async move {
        let mut encoder = SurfaceEncoder::new(shared.display.clone(), run);
        let mut interval = tokio::time::interval(POLL);
        interval.set_missed_tick_behavior(tokio::time::MissedTickBehavior::Delay);
        loop {
            interval.tick().await;
            if !frames.updated() {
                continue;
            }
            let frame = frames.read();
            match encoder.frame(frame) {
                Ok(parts) => {
                    streams.send(parts, &newest_key).await;
                    shared.counters.surface_frames.fetch_add(1, Ordering::Relaxed);
                }
                Err(e) => tracing::warn!("a frame was left out: {e}"),
            }
        }
    });
    Ok(publishing)
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

/// Answers queries for the topology, its pictures and the newest key frame until `session` closes.
async fn answer(
    shared: &Shared,
    session: &zenoh::Session,
    desk: &Desk,
    run: u32,
    newest_key: NewestKey,
) -> Result<(), ServerError> {
    let name = &shared.options.session;
    let pictures: Vec<ZBytes> = pictures(&shared.display, run).iter().map(|part| part.encode_to_vec().into()).collect();
    let surface = topology(&shared.body, &shared.display, run);
    let surface: Vec<ZBytes> = surface.iter().map(|part| part.encode_to_vec().into()).collect();
    for (key, parts) in [(keys::surface_topology(name), surface), (keys::surface_pictures(name), pictures)] {
        let answer = parts_of(&key, &parts);
        desk.offer(session, key, move |_, _| std::future::ready(answer.clone())).await?;
    }
    let key = keys::surface_key(name);
    desk.offer(session, key.clone(), move |_, _| std::future::ready(parts_of(&key, &lock(&newest_key)))).await
}

/// Each part with its key, of those that `key` asks for.
fn parts_of(key: &str, parts: &[ZBytes]) -> Answer {
    (0..).zip(parts).map(|(part, bytes)| (keys::surface_part(key, part), bytes.clone())).collect()
}
