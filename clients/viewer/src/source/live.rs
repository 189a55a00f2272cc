//! A running server, watched: connects, keeps the newest frames, and connects again by itself when they stop.

use super::pace::Pace;
use super::{Moment, SourceError, Subject};
use palpate_sdk::control_request::Request;
use palpate_sdk::proto::ResetBody;
use palpate_sdk::{Connection, Endpoints, Status, WatchOptions};
use std::collections::VecDeque;
use std::sync::atomic::{AtomicBool, Ordering::Relaxed};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

/// Without a frame for this long the connection is given up and made anew.
const SILENCE: Duration = Duration::from_secs(1);
/// Between looks at whether a frame has come: an eighth of what lies between two.
const LOOK: Duration = Duration::from_millis(4);
/// Between attempts to connect.
const RETRY: Duration = Duration::from_millis(500);
/// Frames kept: a quarter of a second, to interpolate between.
const KEPT: usize = 8;

/// Whether frames come.
#[derive(Clone, Debug, PartialEq)]
pub enum Link {
    /// None yet, or none any more, and why the last attempt failed.
    Waiting(Option<String>),
    /// Frames come.
    Open,
}

/// What there is to see right now.
#[derive(Clone, Debug)]
pub struct LiveView {
    /// Whether frames come.
    pub link: Link,
    /// What is looked at; the last one while the link is down.
    pub subject: Option<Arc<Subject>>,
    /// How it looks; the last that came while the link is down.
    pub moment: Option<Moment>,
    /// Tick of the newest frame that has come; what is shown is a little older.
    pub newest: Option<u64>,
    /// How the server fares, and who is there.
    pub status: Status,
}

/// A server that is watched until this is dropped.
pub struct Live {
    shared: Arc<Shared>,
    thread: Option<std::thread::JoinHandle<()>>,
}

struct Shared {
    endpoints: Endpoints,
    opened: Instant,
    stop: AtomicBool,
    reset: AtomicBool,
    seen: Mutex<Seen>,
}

struct Seen {
    link: Link,
    subject: Option<Arc<Subject>>,
    frames: VecDeque<Arc<Moment>>,
    pace: Pace,
    /// When the newest frame came.
    newest: Instant,
    status: Status,
}

impl Live {
    /// Starts watching; connects in the background, for as long as it takes.
    pub fn watch(endpoints: &Endpoints) -> Self {
        let seen = Seen {
            link: Link::Waiting(None),
            subject: None,
            frames: VecDeque::new(),
            pace: Pace::default(),
            newest: Instant::now(),
            status: Status::default(),
        };
        let shared = Arc::new(Shared {
            endpoints: endpoints.clone(),
            opened: Instant::now(),
            stop: AtomicBool::new(false),
            reset: AtomicBool::new(false),
            seen: Mutex::new(seen),
        });
        let watched = shared.clone();
        let thread = std::thread::spawn(move || {
            while !watched.stop.load(Relaxed) {
                let why = watched.watch().err().map(|e| e.to_string());
                watched.lock().link = Link::Waiting(why);
                std::thread::park_timeout(RETRY);
            }
        });
        Self { shared, thread: Some(thread) }
    }

    /// Where it is watched.
    pub fn endpoints(&self) -> &Endpoints {
        &self.shared.endpoints
    }

    /// What to show now: between the two frames around the tick that is due.
    pub fn view(&self) -> LiveView {
        let clock = self.shared.opened.elapsed().as_secs_f64();
        let seen = self.shared.lock();
        let (link, subject, status) = (seen.link.clone(), seen.subject.clone(), seen.status.clone());
        let due = seen.pace.tick_at(clock).unwrap_or_default();
        let after = seen.frames.partition_point(|frame| (frame.tick as f64) < due);
        let next = seen.frames.get(after).or(seen.frames.back()).cloned();
        let newest = seen.frames.back().map(|frame| frame.tick);
        let last = after.checked_sub(1).and_then(|before| seen.frames.get(before)).cloned();
        drop(seen);
        let moment = match (last, next) {
            (Some(last), Some(next)) if last.tick < next.tick => {
                let t = (due - last.tick as f64) / (next.tick - last.tick) as f64;
                Some(last.towards(&next, t.clamp(0.0, 1.0) as f32))
            }
            (_, next) => next.map(|moment| (*moment).clone()),
        };
        LiveView { link, subject, moment, newest, status }
    }

    /// Asks the server to put the body back into its starting state.
    pub fn reset(&self) {
        self.shared.reset.store(true, Relaxed);
    }
}

impl Drop for Live {
    fn drop(&mut self) {
        self.shared.stop.store(true, Relaxed);
        if let Some(thread) = self.thread.take() {
            thread.thread().unpark();
            let _ = thread.join();
        }
    }
}

impl Shared {
    fn lock(&self) -> MutexGuard<'_, Seen> {
        self.seen.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Connects and keeps what comes until nothing comes any more, the surface changes, or it is to stop.
    fn watch(self: &Arc<Self>) -> Result<(), SourceError> {
        let connection = Connection::open_surface(&self.endpoints)?;
        let frames = connection.watch_surface(WatchOptions { every: 1, levels: true })?;
        let surface = frames.surface();
        let made_by = format!("session {} at {}", self.endpoints.session, self.endpoints.surface);
        let has_pictures = surface.materials.iter().any(|material| material.picture.is_some());
        let pictures = if has_pictures { connection.surface_pictures(surface.topology)? } else { Vec::new() };
        let subject = Arc::new(Subject::new(connection.session()?, surface.clone(), &pictures, made_by)?);
        {
            let mut seen = self.lock();
            seen.subject = Some(subject);
            seen.frames.clear();
            seen.newest = Instant::now();
        }
        let statuses = self.clone();
        let _statuses = connection.subscribe_status(move |status| statuses.lock().status = status)?;
        let mut last = None;
        while !self.stop.load(Relaxed) {
            if self.reset.swap(false, Relaxed) {
                connection.control(Request::Reset(ResetBody {}))?;
            }
            let moment = frames.latest().filter(|moment| last != Some(moment.sequence));
            let mut seen = self.lock();
            if let Some(moment) = moment {
                // Another surface: what is known of the body must be asked for anew.
                if moment.topology != surface.topology {
                    break;
                }
                last = Some(moment.sequence);
                seen.keep((*moment).clone().into(), self.opened.elapsed().as_secs_f64());
            }
            if seen.newest.elapsed() > SILENCE {
                break;
            }
            drop(seen);
            std::thread::park_timeout(LOOK);
        }
        Ok(())
    }
}

impl Seen {
    fn keep(&mut self, moment: Moment, clock: f64) {
        // A server that was started anew counts from the beginning.
        if self.frames.back().is_some_and(|last| last.tick >= moment.tick) {
            self.frames.clear();
        }
        self.pace.arrived(moment.tick, clock);
        self.frames.push_back(Arc::new(moment));
        if self.frames.len() > KEPT {
            self.frames.pop_front();
        }
        self.newest = Instant::now();
        self.link = Link::Open;
    }
}
