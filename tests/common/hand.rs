//! A hand as a careful program has it: it presses, notices when its tool is gone, and attaches again.
#![allow(dead_code, reason = "each test uses a part")]

use palpate_sdk::{Attachment, Connection, Endpoints, Hold, PoseSample, Tool, ToolPhase, Wrench};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

/// Two balls, one for each hand.
pub const TOOLS: &str = "tool=[{name=\"left\", radius=0.015}, {name=\"right\", radius=0.015}]";

/// Height of the tool above touching the cube [m] where it is outside, and where it presses.
pub const OUTSIDE: f64 = 0.02;
pub const INSIDE: f64 = -0.008;

/// A hand on the cube.
pub struct Hand {
    connection: Connection,
    /// What it takes, and where it holds it: x and y [m].
    attachment: Attachment,
    place: [f64; 2],
    tool: Option<Tool>,
    /// Every wrench of every tool that it has had, as they came.
    wrenches: Arc<Mutex<Vec<Wrench>>>,
    /// Times that it has attached.
    pub attached: u32,
}

/// What waiting for something may take: a minute is enough for a machine on which much else runs.
const PATIENCE: Duration = Duration::from_secs(60);

impl Hand {
    /// Connected, above the middle of the cube; it attaches with its first pose.
    pub fn new(endpoints: &[String; 2]) -> Self {
        Self::with("", [0.05, 0.05], endpoints)
    }

    /// The same with the tool called `tool`, or any where the name is empty, above `place` (x, y) [m].
    pub fn with(tool: &str, place: [f64; 2], endpoints: &[String; 2]) -> Self {
        let [force, surface] = endpoints.clone();
        let connection = Connection::open(&Endpoints { force, surface, ..Endpoints::default() }).unwrap();
        Self::of(connection, tool, place)
    }

    /// The same over `connection`.
    pub fn of(connection: Connection, tool: &str, place: [f64; 2]) -> Self {
        let attachment = Attachment { client: "hand".into(), tool: tool.into(), ..Attachment::default() };
        Self { connection, attachment, place, tool: None, wrenches: Arc::default(), attached: 0 }
    }

    /// Holds the tool at `height` for a millisecond; attaches first where it has none. The newest wrench of the tool, with
    /// the force [N] that its watchdog lets through.
    pub fn step(&mut self, height: f64) -> Option<(Wrench, f64)> {
        if self.tool.as_mut().is_some_and(|tool| tool.status(tool.now_ns()).hold == Hold::Gone) {
            self.tool = None;
        }
        if self.tool.is_none() {
            let seen = self.wrenches.clone();
            let observer = move |wrench: &Wrench, _| seen.lock().unwrap().push(*wrench);
            // Refused, or unanswered, it tries again with the next step.
            self.tool = self.connection.attach_observed(&self.attachment, observer).ok();
            self.attached += u32::from(self.tool.is_some());
        }
        std::thread::sleep(Duration::from_millis(1));
        let tool = self.tool.as_mut()?;
        let [x, y] = self.place;
        let position = [x, y, 0.12 + height];
        tool.send_pose(PoseSample {
            position,
            orientation: [0.0, 0.0, 0.0, 1.0],
            linear_velocity: None,
            buttons: 0,
            opening: 0.0,
        })
        .ok()?;
        let wrench = tool.latest_wrench()?.wrench;
        let force = tool.safe_force(tool.now_ns());
        Some((wrench, force.iter().map(|f| f * f).sum::<f64>().sqrt()))
    }

    /// Holds the tool at `height` until `done` likes what it feels.
    pub fn hold_until(&mut self, height: f64, what: &str, mut done: impl FnMut(&Wrench, f64) -> bool) -> Wrench {
        let began = Instant::now();
        loop {
            if let Some((wrench, force)) = self.step(height)
                && done(&wrench, force)
            {
                return wrench;
            }
            assert!(began.elapsed() < PATIENCE, "waited in vain: {what}; attached {} times", self.attached);
        }
    }

    /// Presses from outside until it has felt the body for 100 ticks, however often its tool is taken from it meanwhile.
    pub fn press(&mut self) -> Wrench {
        let began = Instant::now();
        loop {
            let holding = self.attached;
            self.hold_until(OUTSIDE, "contact outside", |wrench, _| wrench.phase == ToolPhase::Engaged);
            let (mut since, mut lost) = (None, false);
            let wrench = self.hold_until(INSIDE, "a pressed tool", |wrench, force| {
                lost = wrench.phase != ToolPhase::Engaged;
                let felt = wrench.contact_points > 0 && force > 0.1;
                since = if felt { Some(since.unwrap_or(wrench.tick)) } else { None };
                lost || since.is_some_and(|since| wrench.tick > since + 100)
            });
            if !lost && self.attached == holding {
                return wrench;
            }
            assert!(began.elapsed() < PATIENCE, "waited in vain: a press that nothing disturbs");
        }
    }

    /// The wrenches of ticks after `tick`, of all tools that it has had.
    pub fn wrenches_after(&self, tick: u64) -> Vec<Wrench> {
        self.wrenches.lock().unwrap().iter().filter(|wrench| wrench.tick > tick).copied().collect()
    }

    /// Every wrench that has come since this was asked last, of all tools that it has had.
    pub fn take_wrenches(&self) -> Vec<Wrench> {
        std::mem::take(&mut self.wrenches.lock().unwrap())
    }

    /// The epoch of the tool that it holds; 0: none.
    pub fn epoch(&self) -> u32 {
        self.tool.as_ref().map_or(0, Tool::epoch)
    }

    /// The newest tick that it has heard of.
    pub fn tick(&self) -> u64 {
        self.wrenches.lock().unwrap().iter().map(|wrench| wrench.tick).max().unwrap_or(0)
    }
}

/// Length of a force [N].
pub fn length(force: [f64; 3]) -> f64 {
    force.iter().map(|f| f * f).sum::<f64>().sqrt()
}
