//! The server: connected to, watched, and connected to again.

use std::collections::BTreeMap;
use std::sync::atomic::{AtomicBool, Ordering::Relaxed};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

use axum::body::Bytes;
use palpate_sdk::proto::surface::VERTICES_PER_PART;
use palpate_sdk::{Connection, Endpoints, SdkError, Session, WatchOptions};
use tokio::sync::{OnceCell, watch};

use crate::frames::{Assembler, Newest};
use crate::message;

/// Frames come 31 times a second: without one for so long the connection is made anew.
const SILENCE: Duration = Duration::from_millis(1500);
/// Between two attempts to connect.
const RETRY: Duration = Duration::from_millis(300);
/// Between two looks at the connection.
const LOOK: Duration = Duration::from_millis(50);
/// Between two questions which tools are taken.
const ASK_SESSION: Duration = Duration::from_secs(1);

/// A connection to a server, and what comes from it.
pub(crate) struct World {
    pub connection: Connection,
    /// Number of the surface.
    pub number: u32,
    /// Messages of the topology.
    pub topology: Vec<Bytes>,
    /// Message of the session as it is now.
    pub session: watch::Receiver<Bytes>,
    pub frames: watch::Receiver<Newest>,
    /// Message of the newest status; empty before the first.
    pub status: watch::Receiver<Bytes>,
    pictures: OnceCell<BTreeMap<u32, PictureFile>>,
}

/// A picture on the surface: its type, `image/png` or `image/jpeg`, and the bytes of its file.
#[derive(Clone)]
pub(crate) struct PictureFile {
    pub media_type: String,
    pub bytes: Bytes,
}

impl World {
    /// The pictures on the surface by their numbers. The first who asks waits for the server; where it does not answer, the
    /// next one asks again.
    ///
    /// # Errors
    /// Why they cannot be had.
    pub async fn pictures(&self) -> Result<&BTreeMap<u32, PictureFile>, String> {
        let ask = async || {
            let (connection, number) = (self.connection.clone(), self.number);
            let pictures = blocking(move || connection.surface_pictures(number)).await?;
            // A browser runs what is of another type.
            let known = pictures.into_iter().filter(|p| ["image/png", "image/jpeg"].contains(&&p.media_type[..]));
            Ok(known.map(|p| (p.number, PictureFile { media_type: p.media_type, bytes: p.bytes.into() })).collect())
        };
        self.pictures.get_or_try_init(ask).await
    }
}

/// Whether the server is there.
#[derive(Clone)]
pub(crate) enum Link {
    Waiting(String),
    Open(Arc<World>),
}

/// The thread that holds the connection; it ends soon after this is dropped.
pub(crate) struct Upstream {
    link: watch::Receiver<Link>,
    stop: Arc<AtomicBool>,
}

impl Upstream {
    /// Connects in the background, for as long as it takes; `touch`: to the force channel too.
    pub fn start(endpoints: Endpoints, touch: bool) -> Self {
        let (sender, link) = watch::channel(Link::Waiting(format!("connecting to {}", endpoints.surface)));
        let stop = Arc::new(AtomicBool::new(false));
        let stopped = stop.clone();
        std::thread::spawn(move || {
            while !stopped.load(Relaxed) {
                let fault = match hold(&endpoints, touch, &sender, &stopped) {
                    Ok(fault) => fault.to_owned(),
                    Err(e) => e.to_string(),
                };
                tracing::debug!("{fault}");
                sender.send_replace(Link::Waiting(fault));
                std::thread::sleep(RETRY);
            }
        });
        Self { link, stop }
    }

    pub fn link(&self) -> watch::Receiver<Link> {
        self.link.clone()
    }
}

impl Drop for Upstream {
    fn drop(&mut self) {
        self.stop.store(true, Relaxed);
    }
}

/// Connects and watches until nothing comes any more, or it is to stop; says why it ended.
fn hold(
    endpoints: &Endpoints,
    touch: bool,
    link: &watch::Sender<Link>,
    stop: &AtomicBool,
) -> Result<&'static str, SdkError> {
    let connection = if touch { Connection::open(endpoints)? } else { Connection::open_surface(endpoints)? };
    let session = described(&connection)?;
    let mut topology = connection.topology_parts()?;
    // Answers come in any order; pages get them in theirs.
    topology.sort_by_key(|part| part.part);
    let Some(first) = topology.first() else { return Ok("the server has no surface") };
    let number = first.topology;
    let parts = (first.vertices as usize).div_ceil(VERTICES_PER_PART);

    let (frames_in, frames) = watch::channel(Newest::default());
    let (status_in, status) = watch::channel(Bytes::new());
    let (session_in, session_out) = watch::channel(message::to_page(message::SESSION, &session));
    // When the newest frame came, and whether it was of another surface.
    let seen = Arc::new(Mutex::new((Instant::now(), false)));
    let (assembler, noted) = (Arc::new(Mutex::new(Assembler::new(number, parts))), seen.clone());
    let take = move |frame: palpate_sdk::SurfaceFrame| {
        *noted.lock().unwrap_or_else(PoisonError::into_inner) = (Instant::now(), frame.topology != number);
        let newest = assembler.lock().unwrap_or_else(PoisonError::into_inner).take(&frame);
        newest.map(|newest| frames_in.send_replace(newest));
    };
    let take = Arc::new(take);
    let stream = take.clone();
    let _frames = connection.subscribe_frames(WatchOptions { every: 1, levels: true }, move |frame| stream(frame))?;
    let _status = connection.subscribe_status(move |status| {
        status_in.send_replace(message::to_page(message::STATUS, &status));
    })?;
    // There is something to see before the next key frame.
    connection.key_frame()?.into_iter().for_each(|frame| take(frame));

    let world = World {
        connection: connection.clone(),
        number,
        topology: encoded(&topology),
        session: session_out,
        frames,
        status,
        pictures: OnceCell::new(),
    };
    link.send_replace(Link::Open(Arc::new(world)));
    let mut asked = Instant::now();
    while !stop.load(Relaxed) {
        let (newest, of_another) = *seen.lock().unwrap_or_else(PoisonError::into_inner);
        if of_another {
            return Ok("the server has another surface");
        }
        if newest.elapsed() > SILENCE {
            return Ok("the server sends no frames");
        }
        if asked.elapsed() > ASK_SESSION {
            // What the answer does not say the frames do, by not coming.
            if let Ok(session) = described(&connection) {
                let bytes = message::to_page(message::SESSION, &session);
                session_in.send_if_modified(|known| {
                    let changed = *known != bytes;
                    *known = bytes;
                    changed
                });
            }
            asked = Instant::now();
        }
        std::thread::sleep(LOOK);
    }
    Ok("the gateway ends")
}

/// The session, without the time of the answer: pages are told of changes, and that is none.
fn described(connection: &Connection) -> Result<Session, SdkError> {
    Ok(Session { tick: 0, ..connection.session()? })
}

fn encoded(topology: &[palpate_sdk::SurfaceTopology]) -> Vec<Bytes> {
    topology.iter().map(|part| message::to_page(message::SURFACE_TOPOLOGY, part)).collect()
}

/// Runs what waits for the network where nothing else waits for it.
pub(crate) async fn blocking<T: Send + 'static>(
    work: impl FnOnce() -> Result<T, SdkError> + Send + 'static,
) -> Result<T, String> {
    match tokio::task::spawn_blocking(work).await {
        Ok(outcome) => outcome.map_err(|e| e.to_string()),
        Err(e) => Err(e.to_string()),
    }
}
