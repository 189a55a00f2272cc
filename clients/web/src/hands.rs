//! The tools that one page holds: poses out, wrenches in, and what was lost.

use std::collections::{BTreeMap, VecDeque};
use std::sync::Arc;
use std::time::{Duration, Instant};

use palpate_sdk::proto::ToolWrench;
use palpate_sdk::{Tool, Wrench};

use crate::message::PagePose;
use crate::upstream::World;

/// Between two poses of a tool at least: a page sends no more than 250 a second on.
const BETWEEN_POSES: Duration = Duration::from_millis(4);
/// Poses whose answer may be under way.
const UNDER_WAY: usize = 64;
/// Wrenches come a thousand times a second: without one for so long, while poses go out, the tool is gone.
const SILENCE: Duration = Duration::from_secs(1);

/// A tool in the hand of a page.
struct Held {
    tool: Tool,
    /// Its connection: a tool of an earlier one is lost.
    world: Arc<World>,
    /// The newest pose that came and is not sent yet.
    waiting: Option<PagePose>,
    sent: Option<Instant>,
    /// Of poses that were sent: sequence, and what the page calls them: sequence and time [ns].
    names: VecDeque<(u32, u32, u64)>,
    newest_pose: Option<u32>,
    heard: Instant,
}

/// All tools of a page, by number.
#[derive(Default)]
pub(crate) struct Hands(BTreeMap<u32, Held>);

/// What became of a pose.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Taken {
    Sent,
    /// It replaced another that had waited for its turn.
    Superseded,
    Waits,
    /// The page does not hold the tool, or under another epoch.
    NotHeld,
    /// An earlier pose than the newest.
    Stale,
}

impl Hands {
    pub fn hold(&mut self, tool: Tool, world: Arc<World>) {
        let held = Held {
            world,
            waiting: None,
            sent: None,
            names: VecDeque::new(),
            newest_pose: None,
            heard: Instant::now(),
            tool,
        };
        self.0.insert(held.tool.id(), held);
    }

    /// Lets go of the tool, if this epoch of it is held.
    pub fn release(&mut self, tool: u32, epoch: u32) -> Option<Tool> {
        let held = self.0.get(&tool).filter(|held| held.tool.epoch() == epoch)?.tool.id();
        self.0.remove(&held).map(|held| held.tool)
    }

    pub fn count(&self) -> usize {
        self.0.len()
    }

    pub fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    /// Takes a pose of the page: the newest wins, and no more go out than [`BETWEEN_POSES`] allows.
    pub fn pose(&mut self, tool: u32, pose: PagePose, now: Instant) -> Taken {
        let Some(held) = self.0.get_mut(&tool).filter(|held| held.tool.epoch() == pose.epoch) else {
            return Taken::NotHeld;
        };
        if held.newest_pose.is_some_and(|newest| pose.sequence <= newest) {
            return Taken::Stale;
        }
        held.newest_pose = Some(pose.sequence);
        let superseded = held.waiting.replace(pose).is_some();
        if held.send(now) {
            Taken::Sent
        } else if superseded {
            Taken::Superseded
        } else {
            Taken::Waits
        }
    }

    /// Sends poses that have waited for their turn; gives the wrenches that are new, and which tools are lost.
    pub fn beat(&mut self, world: Option<&Arc<World>>, now: Instant) -> (Vec<ToolWrench>, Vec<(u32, &'static str)>) {
        let (mut wrenches, mut lost) = (Vec::new(), Vec::new());
        for (&tool, held) in &mut self.0 {
            held.send(now);
            if let Some(received) = held.tool.latest_wrench().filter(|received| received.fresh) {
                held.heard = now;
                wrenches.push(held.answer(&received.wrench));
            }
            if world.is_none_or(|world| !Arc::ptr_eq(world, &held.world)) {
                lost.push((tool, "the connection to the server was lost"));
            } else if held.sent.is_some_and(|sent| sent > held.heard + SILENCE) {
                lost.push((tool, "the server has freed the tool, or sends no forces"));
            }
        }
        lost.iter().for_each(|(tool, _)| drop(self.0.remove(tool)));
        (wrenches, lost)
    }
}

impl Held {
    /// Sends the pose that waits, if its turn has come.
    fn send(&mut self, now: Instant) -> bool {
        if self.sent.is_some_and(|sent| now.saturating_duration_since(sent) < BETWEEN_POSES) {
            return false;
        }
        let Some(pose) = self.waiting.take() else { return false };
        // Where the connection is gone, no wrench comes, which tells.
        if let Ok(sequence) = self.tool.send_pose(pose.sample) {
            self.names.push_back((sequence, pose.sequence, pose.time_ns));
            if self.names.len() > UNDER_WAY {
                self.names.pop_front();
            }
        }
        self.sent = Some(now);
        true
    }

    /// The wrench as the page gets it: it answers the page's pose.
    fn answer(&mut self, wrench: &Wrench) -> ToolWrench {
        while self.names.get(1).is_some_and(|(next, ..)| *next <= wrench.pose_sequence) {
            self.names.pop_front();
        }
        let named = self.names.front().filter(|(sequence, ..)| *sequence == wrench.pose_sequence);
        let (pose_sequence, pose_time_ns) = named.map_or((0, 0), |(_, sequence, time)| (*sequence, *time));
        let floats = |values: &[f64]| values.iter().map(|value| *value as f32).collect();
        ToolWrench {
            tool: self.tool.id(),
            epoch: self.tool.epoch(),
            sequence: wrench.sequence,
            tick: wrench.tick,
            pose_sequence,
            pose_time_ns,
            pose_age_ticks: wrench.pose_age_ticks,
            position: floats(&wrench.position),
            orientation: floats(&wrench.orientation),
            physical_force: floats(&wrench.physical_force),
            physical_torque: floats(&wrench.physical_torque),
            force: floats(&wrench.force),
            torque: floats(&wrench.torque),
            contact_points: wrench.contact_points,
            phase: wrench.phase as i32,
            flags: wrench.flags,
            ..Default::default()
        }
    }
}
