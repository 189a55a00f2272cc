//! A running view of the surface: subscribes, decodes on a thread of its own, and asks for what it has missed.

use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use palpate_proto::surface::EVERY;
use palpate_proto::{Message, SURFACE_MINOR, SurfaceFrame, VERSION_MAJOR, VERSION_MINOR, keys};
use zenoh::{Wait, bytes::ZBytes, pubsub::Subscriber};

use crate::{Connection, SdkError, error::reason};
use palpate_client::{ClientError, Moment, Picture, Surface, SurfaceDecoder};

/// Messages that may wait for the decoding thread; more are lost, as on a bad network.
const WAITING: usize = 64;
/// Between two attempts to get a surface that frames are already of.
const RETRY: Duration = Duration::from_millis(200);

/// What a viewer wants of the surface.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct WatchOptions {
    /// Every frame (1), every second (2), fourth (4) or eighth (8): 31, 16, 8 or 4 a second.
    pub every: u32,
    /// With the level of detail of each vertex.
    pub levels: bool,
}

impl Default for WatchOptions {
    /// Every frame, without levels.
    fn default() -> Self {
        Self { every: 1, levels: false }
    }
}

/// What became of the frames, since the watch began.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct WatchCounters {
    /// Frames decoded.
    pub frames: u64,
    /// Frames of the stream between them that were not: they never came whole, or their key frame did not.
    pub lost: u64,
    /// Messages that are no frame.
    pub undecodable: u64,
    /// Bytes of all messages.
    pub bytes: u64,
}

/// What the decoding thread has made of the frames.
struct View {
    surface: Arc<Surface>,
    latest: Option<Arc<Moment>>,
    counters: WatchCounters,
}

/// A running view of the surface; it ends when this is dropped.
pub struct SurfaceWatch {
    view: Arc<Mutex<View>>,
    _subscriber: Subscriber<()>,
    // Last, so that the subscription goes before its session closes.
    _connection: Connection,
}

impl Connection {
    /// The surface of the body. Errors: [`SdkError::NoAnswer`] after 2 s, [`ClientError::Undecodable`] when what comes is
    /// no surface.
    pub fn surface_topology(&self) -> Result<Surface, SdkError> {
        Ok(Surface::from_parts(self.topology_parts()?)?)
    }

    /// The surface of the body, and how it was half a second ago at most: the newest key frame. Errors: as
    /// [`Connection::surface_topology`]; [`SdkError::NoAnswer`] also when no frame comes within 2 s.
    pub fn surface_now(&self) -> Result<(Arc<Surface>, Moment), SdkError> {
        let surface = Arc::new(self.surface_topology()?);
        let mut decoder = SurfaceDecoder::new(surface.clone());
        let mut newest = None;
        for part in self.key_frame()? {
            newest = decoder.receive(&part)?.or(newest);
        }
        let key = keys::surface_key(&self.endpoints().session);
        let endpoint = self.endpoints().surface.clone();
        newest.map(|moment| (surface, moment)).ok_or(SdkError::NoAnswer { key, endpoint })
    }

    /// The pictures on the surface `topology`, for one whose materials name some. Errors: [`SdkError::NoAnswer`] after 2 s,
    /// as of a server before 1.4; [`SdkError::Undecodable`] when parts are missing.
    pub fn surface_pictures(&self, topology: u32) -> Result<Vec<Picture>, SdkError> {
        let key = keys::surface_pictures(&self.endpoints().session);
        Ok(Picture::from_parts(self.ask_all(key, None, "SurfacePicture")?, topology)?)
    }

    /// Watches the surface: at once with the newest key frame, then with every frame that comes. After a lost key frame,
    /// a lost connection or a restart of the server it goes on by itself. Errors: [`SdkError::Version`],
    /// [`SdkError::NoAnswer`] after 2 s, [`ClientError::Unknown`] when there is no such stream, [`ClientError::Undecodable`],
    /// [`SdkError::Zenoh`].
    pub fn watch_surface(&self, options: WatchOptions) -> Result<SurfaceWatch, SdkError> {
        if !EVERY.contains(&options.every) {
            let (name, known) = (options.every.to_string(), format!("{EVERY:?}"));
            return Err(ClientError::Unknown { what: "stream of frames with every", name, known }.into());
        }
        let session = self.session()?;
        if session.version_minor < SURFACE_MINOR {
            return Err(SdkError::Version {
                server: format!("{}.{}", session.version_major, session.version_minor),
                client: format!("{VERSION_MAJOR}.{VERSION_MINOR}"),
            });
        }
        let surface = Arc::new(self.surface_topology()?);
        let (sender, messages) = sync_channel(WAITING);
        let subscriber = subscribe(self, options, sender)?;
        let view =
            Arc::new(Mutex::new(View { surface: surface.clone(), latest: None, counters: WatchCounters::default() }));
        let decoding = Decoding {
            connection: self.clone(),
            decoder: SurfaceDecoder::new(surface),
            options,
            view: view.clone(),
            asked: None,
            retry: Instant::now(),
        };
        std::thread::Builder::new().name("surface".into()).spawn(move || decoding.run(&messages)).map_err(|e| {
            SdkError::Zenoh { operation: "start a thread for", key: "the surface".to_owned(), reason: e.to_string() }
        })?;
        Ok(SurfaceWatch { view, _subscriber: subscriber, _connection: self.clone() })
    }
}

impl SurfaceWatch {
    /// The newest moment; `None` before the first. It may be of another surface than [`surface`](Self::surface) gave:
    /// compare their topology.
    pub fn latest(&self) -> Option<Arc<Moment>> {
        lock(&self.view).latest.clone()
    }

    /// The surface that is shown now.
    pub fn surface(&self) -> Arc<Surface> {
        lock(&self.view).surface.clone()
    }

    /// What became of the frames.
    pub fn counters(&self) -> WatchCounters {
        lock(&self.view).counters
    }
}

fn lock(view: &Mutex<View>) -> MutexGuard<'_, View> {
    view.lock().unwrap_or_else(PoisonError::into_inner)
}

fn subscribe(
    connection: &Connection,
    options: WatchOptions,
    sender: SyncSender<ZBytes>,
) -> Result<Subscriber<()>, SdkError> {
    let key = keys::surface_frames(&connection.endpoints().session, options.every, options.levels);
    connection
        .surface_session()
        .declare_subscriber(&key)
        // Full: the decoding thread has fallen behind, and what is lost is counted by its gap.
        .callback(move |sample| drop(sender.try_send(sample.payload().clone())))
        .wait()
        .map_err(|error| SdkError::Zenoh { operation: "subscribe to", key, reason: reason(error) })
}

/// What the decoding thread works with.
struct Decoding {
    connection: Connection,
    decoder: SurfaceDecoder,
    options: WatchOptions,
    view: Arc<Mutex<View>>,
    /// Newest key frame that was asked for or has come by asking.
    asked: Option<u64>,
    /// Not before this is another surface asked for.
    retry: Instant,
}

impl Decoding {
    /// Until the subscription ends.
    fn run(mut self, messages: &Receiver<ZBytes>) {
        self.ask_for_key(0);
        while let Ok(message) = messages.recv() {
            lock(&self.view).counters.bytes += message.len() as u64;
            match SurfaceFrame::decode(&*message.to_bytes()) {
                Ok(frame) => self.take(&frame),
                Err(_) => lock(&self.view).counters.undecodable += 1,
            }
        }
    }

    fn take(&mut self, frame: &SurfaceFrame) {
        if frame.topology != self.decoder.surface().topology && !self.change_surface(frame.topology) {
            return;
        }
        if self.decoder.lacks_key(frame) && self.asked.is_none_or(|asked| frame.key > asked) {
            self.ask_for_key(frame.key);
        }
        self.decode(frame);
    }

    fn decode(&mut self, frame: &SurfaceFrame) {
        let moment = self.decoder.receive(frame);
        let mut view = lock(&self.view);
        match moment {
            Ok(Some(moment)) => {
                let before = view.latest.as_ref().filter(|latest| latest.topology == moment.topology);
                let before = before.map(|latest| latest.sequence);
                // A key frame that was asked for may be older than what has come since.
                if before.is_some_and(|before| before >= moment.sequence) {
                    return;
                }
                let frames = before.map_or(1, |before| (moment.sequence - before) / u64::from(self.options.every));
                view.counters.lost += frames.saturating_sub(1);
                view.counters.frames += 1;
                view.latest = Some(Arc::new(moment));
            }
            Ok(None) => {}
            Err(_) => view.counters.undecodable += 1,
        }
    }

    /// Asks for the newest key frame, which should be `key` or a later one.
    fn ask_for_key(&mut self, key: u64) {
        self.asked = Some(key);
        let name = keys::surface_key(&self.connection.endpoints().session);
        let Ok(parts) = self.connection.ask_once::<SurfaceFrame>(name, None, "SurfaceFrame") else { return };
        let topology = self.decoder.surface().topology;
        for mut part in parts.into_iter().filter(|part| part.topology == topology) {
            self.asked = Some(part.sequence.max(key));
            if !self.options.levels {
                part.levels.clear();
            }
            self.decode(&part);
        }
    }

    /// Gets the surface with this number, unless it was tried just now; true when frames of it can be decoded.
    fn change_surface(&mut self, topology: u32) -> bool {
        if Instant::now() < self.retry {
            return false;
        }
        self.retry = Instant::now() + RETRY;
        let Ok(surface) = self.connection.surface_topology() else { return false };
        if surface.topology != topology {
            return false;
        }
        let surface = Arc::new(surface);
        self.decoder = SurfaceDecoder::new(surface.clone());
        self.asked = None;
        lock(&self.view).surface = surface;
        true
    }
}
