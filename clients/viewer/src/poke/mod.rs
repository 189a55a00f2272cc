//! A tool for who has no device: the mouse presses it onto the organ, and the screen says what it feels.
//!
//! It is a client like any other: a connection of its own, poses a thousand times a second from a thread of its own.

mod hand;

pub use hand::Press;

use hand::Hand;
use palpate_sdk::{Attachment, Connection, Endpoints, PoseSample, SdkError};
use std::sync::atomic::{AtomicBool, Ordering::Relaxed};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};
use three_d::Vec3;

/// Between two poses.
const PERIOD: Duration = Duration::from_millis(1);
/// After a pause of the machine the hand goes on from where it was instead of catching up [s].
const LONGEST_STEP: f32 = 0.01;

/// What the mouse's tool feels.
#[derive(Clone, Debug, Default)]
pub enum Felt {
    /// It is being taken.
    #[default]
    Waiting,
    /// It holds the tool with this number; `None` before the first answer.
    Held(u32, Option<Touch>),
    /// It could not be taken, or was lost: why.
    Lost(String),
}

/// What the server answered last.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Touch {
    /// Rendered force [N].
    pub newtons: f64,
    /// Contacts that carry it; 0 means free.
    pub contact_points: u32,
}

/// A tool held by the mouse until this is dropped.
pub struct Poke {
    shared: Arc<Shared>,
    thread: Option<std::thread::JoinHandle<()>>,
}

#[derive(Default)]
struct Shared {
    stop: AtomicBool,
    wanted: Mutex<Option<Press>>,
    jaws_open: AtomicBool,
    felt: Mutex<Felt>,
}

/// What the hand must know of the body and the tool, lengths in metres.
#[derive(Clone, Copy, Debug)]
pub struct Reach {
    /// Centre of a ball that holds the body.
    pub centre: Vec3,
    /// Its radius.
    pub radius: f32,
    /// From the part of the tool that touches to its reference point.
    pub tool: f32,
}

impl Poke {
    /// Takes the tool `name`, or any free one where that is empty, in the background.
    pub fn take(endpoints: &Endpoints, name: &str, reach: Reach) -> Self {
        let shared = Arc::new(Shared::default());
        let (held, endpoints, name) = (shared.clone(), endpoints.clone(), name.to_owned());
        let thread = std::thread::spawn(move || {
            if let Err(e) = held.hold(&endpoints, name, reach) {
                *lock(&held.felt) = Felt::Lost(e.to_string());
            }
        });
        Self { shared, thread: Some(thread) }
    }

    /// Where to press; `None` lets go of the body, not of the tool.
    pub fn press(&self, wanted: Option<Press>) {
        *lock(&self.shared.wanted) = wanted;
    }

    /// Opens the tool's jaws where they are closed, and the other way round.
    pub fn toggle_jaws(&self) {
        self.shared.jaws_open.fetch_not(Relaxed);
    }

    /// Whether they are open, or opening.
    pub fn has_jaws_open(&self) -> bool {
        self.shared.jaws_open.load(Relaxed)
    }

    /// What the tool feels now.
    pub fn felt(&self) -> Felt {
        lock(&self.shared.felt).clone()
    }
}

impl Drop for Poke {
    fn drop(&mut self) {
        self.shared.stop.store(true, Relaxed);
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}

impl Shared {
    fn hold(&self, endpoints: &Endpoints, tool: String, reach: Reach) -> Result<(), SdkError> {
        let connection = Connection::open(endpoints)?;
        let mut tool = connection.attach(&Attachment { client: "mouse".into(), tool, ..Attachment::default() })?;
        let mut hand = Hand::above(reach.centre, reach.radius, reach.tool);
        let mut last = Instant::now();
        let mut due = last;
        while !self.stop.load(Relaxed) {
            let now = Instant::now();
            let wanted = *lock(&self.wanted);
            let dt = now.duration_since(last).as_secs_f32().min(LONGEST_STEP);
            hand.step(wanted, dt);
            hand.move_jaws(self.jaws_open.load(Relaxed), dt);
            last = now;
            let q = hand.orientation();
            tool.send_pose(PoseSample {
                position: [hand.position.x, hand.position.y, hand.position.z].map(f64::from),
                orientation: [q.v.x, q.v.y, q.v.z, q.s].map(f64::from),
                linear_velocity: None,
                buttons: 0,
                opening: hand.opening.into(),
            })?;
            let touch = tool.latest_wrench().map(|received| Touch {
                newtons: received.wrench.force.iter().map(|c| c * c).sum::<f64>().sqrt(),
                contact_points: received.wrench.contact_points,
            });
            *lock(&self.felt) = Felt::Held(tool.id(), touch);
            due = (due + PERIOD).max(now);
            std::thread::sleep(due.saturating_duration_since(Instant::now()));
        }
        tool.detach()
    }
}

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}
