//! Poses in: decoded, checked and put into the newest-wins slot of their tool, or refused and counted.

use super::{ServerError, Shared, lock, network};
use crate::realtime::mailbox::PoseSlot;
use crate::wire::{Gate, Refusal};
use palpate_core::math::Bounds;
use palpate_proto::keys;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex};
use std::time::Instant;
use zenoh::Wait;
use zenoh::qos::{CongestionControl, Priority};

/// Poses a second from the holder of a tool that are no mistake: four times as many as can be declared.
const MOST_POSES: f64 = 8000.0;
/// Of as many at once: what a network held up for some seconds arrives together.
const MOST_AT_ONCE: f64 = 2.0 * MOST_POSES;

/// The receiving side of every tool.
pub(super) struct ToolInput {
    doors: Vec<Mutex<Door>>,
    refused: [AtomicU64; Refusal::ALL.len()],
}

struct Door {
    gate: Gate,
    slot: triple_buffer::Input<Option<PoseSlot>>,
    last_pose: Instant,
    /// Poses that the holder may send before they are too many, and when this was reckoned.
    room: (f64, Instant),
}

impl Door {
    /// The holder has sent one.
    fn count(&mut self, now: Instant) {
        let (room, before) = self.room;
        let room = (room + MOST_POSES * (now - before).as_secs_f64()).min(MOST_AT_ONCE);
        self.room = ((room - 1.0).max(-1.0), now);
    }
}

impl ToolInput {
    pub(super) fn new(slots: Vec<triple_buffer::Input<Option<PoseSlot>>>, workspace: Bounds) -> Self {
        let now = Instant::now();
        let door = |slot| {
            Mutex::new(Door { gate: Gate::new(0, 0, workspace), slot, last_pose: now, room: (MOST_AT_ONCE, now) })
        };
        Self { doors: slots.into_iter().map(door).collect(), refused: Default::default() }
    }

    /// From now on tool `tool` listens to `epoch` with its `secret` alone; 0 closes it.
    pub(super) fn admit(&self, tool: usize, epoch: u32, secret: u64) {
        let mut door = lock(&self.doors[tool]);
        door.gate = Gate::new(epoch, secret, door.gate.workspace);
        door.last_pose = Instant::now();
        door.room = (MOST_AT_ONCE, door.last_pose);
    }

    /// How long tool `tool` has been silent, and whether its holder has sent a pose at all.
    pub(super) fn silence(&self, tool: usize) -> (std::time::Duration, bool) {
        let door = lock(&self.doors[tool]);
        (door.last_pose.elapsed(), door.gate.sequence != 0)
    }

    /// How often the pose numbers of the holder of tool `tool` have jumped back, and were followed.
    pub(super) fn jumps(&self, tool: usize) -> u32 {
        lock(&self.doors[tool]).gate.jumps
    }

    /// Whether the holder of tool `tool` sends more poses than any device has.
    pub(super) fn is_flooded(&self, tool: usize) -> bool {
        lock(&self.doors[tool]).room.0 < 0.0
    }

    fn receive(&self, key: &str, bytes: &[u8]) {
        let door = keys::tool_of_pose_key(key).and_then(|tool| self.doors.get(tool as usize));
        let outcome = match door {
            None => Err(Refusal::UnknownTool),
            Some(door) => {
                let mut door = lock(door);
                let (outcome, now) = (door.gate.pass(bytes), Instant::now());
                // What strangers send is not the holder's.
                if !matches!(outcome, Err(Refusal::Malformed | Refusal::WrongEpoch)) {
                    door.count(now);
                }
                outcome.map(|sample| {
                    let epoch = door.gate.epoch;
                    door.last_pose = now;
                    door.slot.write(Some(PoseSlot { epoch, sample }));
                })
            }
        };
        if let Err(refusal) = outcome {
            self.refused[refusal as usize].fetch_add(1, Ordering::Relaxed);
        }
    }

    /// Refusals so far, by reason.
    pub(super) fn refused(&self) -> impl Iterator<Item = (&'static str, u64)> {
        Refusal::ALL.iter().map(|r| (r.name(), self.refused[*r as usize].load(Ordering::Relaxed)))
    }
}

/// Listens for poses, and answers echoes with the same bytes.
pub(super) fn listen(shared: &Arc<Shared>, session: &zenoh::Session) -> Result<(), ServerError> {
    let name = &shared.options.session;
    let receiver = shared.clone();
    session
        .declare_subscriber(keys::all_tool_poses(name))
        .callback(move |sample| receiver.input.receive(sample.key_expr().as_str(), &sample.payload().to_bytes()))
        .background()
        .wait()
        .map_err(network)?;
    let echo = session
        .declare_publisher(keys::echo_reply(name))
        .priority(Priority::RealTime)
        .express(true)
        .congestion_control(CongestionControl::Drop)
        .wait()
        .map_err(network)?;
    session
        .declare_subscriber(keys::echo_request(name))
        .callback(move |sample| {
            let _ = echo.put(sample.payload().clone()).wait();
        })
        .background()
        .wait()
        .map_err(network)
}
