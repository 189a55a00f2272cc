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

/// The receiving side of every tool.
pub(super) struct ToolInput {
    doors: Vec<Mutex<Door>>,
    refused: [AtomicU64; Refusal::ALL.len()],
}

struct Door {
    gate: Gate,
    slot: triple_buffer::Input<Option<PoseSlot>>,
    last_pose: Instant,
}

impl ToolInput {
    pub(super) fn new(slots: Vec<triple_buffer::Input<Option<PoseSlot>>>, workspace: Bounds) -> Self {
        let door = |slot| Mutex::new(Door { gate: Gate::new(0, 0, workspace), slot, last_pose: Instant::now() });
        Self { doors: slots.into_iter().map(door).collect(), refused: Default::default() }
    }

    /// From now on tool `tool` listens to `epoch` with its `secret` alone; 0 closes it.
    pub(super) fn admit(&self, tool: usize, epoch: u32, secret: u64) {
        let mut door = lock(&self.doors[tool]);
        door.gate = Gate::new(epoch, secret, door.gate.workspace);
        door.last_pose = Instant::now();
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

    fn receive(&self, key: &str, bytes: &[u8]) {
        let door = keys::tool_of_pose_key(key).and_then(|tool| self.doors.get(tool as usize));
        let outcome = match door {
            None => Err(Refusal::UnknownTool),
            Some(door) => {
                let mut door = lock(door);
                door.gate.pass(bytes).map(|sample| {
                    let epoch = door.gate.epoch;
                    door.last_pose = Instant::now();
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
