//! The simulation thread: gather inputs, advance, hand out, sleep.

use super::clock::Clock;
use super::governor::Governor;
use super::mailbox::{Command, Frame, RecordTap, RecordedTick, SimulationEnds, TickReport, TickTiming};
use super::pacer::{Begin, Pacer};
use crate::contact::tool::{MOST_TOOLS, ToolEvent};
use crate::simulation::{Inputs, Outputs, Simulation, TICKS_PER_FRAME, ToolOutput};
use crate::stepping::work;
use std::sync::atomic::{AtomicBool, Ordering};

/// Everything that the thread owns.
pub struct SimThread {
    simulation: Simulation,
    ends: SimulationEnds,
    governor: Governor,
    tap: Option<Box<RecordTap>>,
    /// A recording that has been asked for and begins with the next frame.
    awaited: Option<Box<RecordTap>>,
    epochs: [u32; MOST_TOOLS],
}

impl SimThread {
    /// `simulation`, ready to run.
    pub fn new(simulation: Simulation, ends: SimulationEnds) -> Self {
        let floor = work::floor(simulation.body());
        let mut epochs = [0; MOST_TOOLS];
        for (epoch, tool) in epochs.iter_mut().zip(simulation.tools()) {
            *epoch = tool.epoch;
        }
        Self { simulation, ends, governor: Governor::new(floor), tap: None, awaited: None, epochs }
    }

    /// Ticks until `stop`. After this call begins, nothing is allocated, locked or logged on this thread.
    pub fn run(&mut self, clock: impl Clock, stop: &AtomicBool) {
        let mut pacer = Pacer::start(clock);
        while !stop.load(Ordering::Relaxed) {
            let begin = pacer.begin();
            let inputs = self.gather(begin);
            let outputs = self.simulation.advance(&inputs);
            hand_out(&mut self.ends, outputs);
            let overflowed = record(&mut self.tap, &self.ends, &inputs, outputs);
            // A tick in which the body stood still says nothing of what work costs.
            let stood = outputs.plan.taken < outputs.plan.needed;
            let spent = if stood { 0 } else { outputs.plan.taken + outputs.adapted.work };
            let mut timing = TickTiming {
                tick: outputs.tick,
                lateness: begin.lateness,
                compute: 0,
                missed: false,
                lapsed: begin.lapsed,
                plan: outputs.plan,
                element_evaluations: outputs.element_evaluations,
                budget: inputs.budget,
                active: outputs.active,
                elements: outputs.elements,
                adapted: outputs.adapted,
                restored: outputs.restored,
            };
            let engaged = outputs.tools.iter().any(|t| t.state.touches());
            if overflowed {
                self.retire();
            }
            self.copy_if_due(engaged);
            (timing.compute, timing.missed) = pacer.end();
            self.governor.measure(spent, timing.compute);
            if self.ends.timings.push(timing).is_err() {
                self.ends.dropped.timings.fetch_add(1, Ordering::Relaxed);
            }
        }
        self.retire();
    }

    /// The inputs of the tick that begins: one event per tool, those of the control side first.
    fn gather(&mut self, begin: Begin) -> Inputs {
        let mut inputs = Inputs { lapsed: begin.lapsed, budget: self.governor.budget(), ..Inputs::default() };
        // A command that cannot be taken now (its tool has an event already) waits for the next tick.
        while let Ok(command) = self.ends.commands.peek() {
            let tool = match command {
                Command::Attach { tool, .. } | Command::Detach { tool } => Some(*tool),
                _ => None,
            };
            if tool.is_some_and(|t| inputs.tools.get(t).is_none_or(Option::is_some)) {
                break;
            }
            let Ok(command) = self.ends.commands.pop() else { break };
            self.obey(command, &mut inputs);
        }
        self.begin_recording();
        for (i, slot) in self.ends.poses.iter_mut().enumerate() {
            // The slot is left alone until its turn: it keeps only the newest anyway.
            if inputs.tools[i].is_some() || !slot.updated() {
                continue;
            }
            if let Some(pose) = slot.read().filter(|p| p.epoch == self.epochs[i]) {
                inputs.tools[i] = Some(ToolEvent::Pose(pose.sample));
            }
        }
        inputs
    }

    fn obey(&mut self, command: Command, inputs: &mut Inputs) {
        match command {
            Command::Attach { tool, epoch, period_ticks, coupling } => {
                self.epochs[tool] = epoch;
                inputs.tools[tool] = Some(ToolEvent::Attach { epoch, period_ticks, coupling });
            }
            Command::Detach { tool } => {
                self.epochs[tool] = 0;
                inputs.tools[tool] = Some(ToolEvent::Detach);
            }
            Command::Reset => inputs.reset = true,
            Command::StartRecording(tap) => {
                self.retire();
                self.awaited = Some(tap);
            }
            Command::StopRecording => self.retire(),
        }
    }

    /// A copy while a tool may touch, in the middle of each frame: its end has enough to do.
    fn copy_if_due(&mut self, engaged: bool) {
        if engaged && self.simulation.tick() % TICKS_PER_FRAME == TICKS_PER_FRAME / 2 {
            self.simulation.save_into(self.ends.copies.input_buffer_mut());
            self.ends.copies.publish();
        }
    }

    /// Recordings begin where a frame ended: there the last good state, which is not recorded, is the state itself.
    fn begin_recording(&mut self) {
        if !self.simulation.tick().is_multiple_of(TICKS_PER_FRAME) {
            return;
        }
        let Some(mut tap) = self.awaited.take() else { return };
        if let Some(mut room) = tap.room.take() {
            self.simulation.save_into(&mut room);
            // The ring has room for the one start of this recording.
            if let Err(rtrb::PushError::Full(room)) = tap.start.push(room) {
                tap.room = Some(room);
            }
        }
        self.tap = Some(tap);
    }

    /// Sends the tap of the recording to where it is dropped.
    fn retire(&mut self) {
        if let Some(tap) = self.tap.take().or_else(|| self.awaited.take())
            && let Err(rtrb::PushError::Full(tap)) = self.ends.retired.push(tap)
        {
            // Four recordings ended and nobody looked: leaking is the one thing that cannot block.
            std::mem::forget(tap);
        }
    }

    /// The simulation, between ticks.
    pub fn simulation(&self) -> &Simulation {
        &self.simulation
    }
}

fn all_tools(outputs: &Outputs) -> [ToolOutput; MOST_TOOLS] {
    let mut tools = [ToolOutput::default(); MOST_TOOLS];
    for (to, from) in tools.iter_mut().zip(&outputs.tools) {
        *to = *from;
    }
    tools
}

fn fill(frame: &mut Frame, outputs: &Outputs) {
    frame.tick = outputs.tick;
    frame.skin.copy_from_slice(&outputs.skin);
    frame.levels.copy_from_slice(&outputs.levels);
    for (to, from) in frame.tools.iter_mut().zip(&outputs.tools) {
        *to = from.state;
    }
}

fn hand_out(ends: &mut SimulationEnds, outputs: &Outputs) {
    let report = TickReport { tick: outputs.tick, tools: all_tools(outputs), flags: outputs.flags() };
    if ends.reports.push(report).is_err() {
        ends.dropped.reports.fetch_add(1, Ordering::Relaxed);
    }
    // The eventfd's counter is far from full, so this never blocks.
    let _ = rustix::io::write(&ends.wake, &1u64.to_ne_bytes());
    if outputs.frame {
        fill(ends.frames.input_buffer_mut(), outputs);
        ends.frames.publish();
    }
}

/// Hands the tick to the recorder; true when it was too slow and the recording now has a hole.
fn record(tap: &mut Option<Box<RecordTap>>, ends: &SimulationEnds, inputs: &Inputs, outputs: &Outputs) -> bool {
    let Some(tap) = tap else { return false };
    let tick = RecordedTick {
        tick: outputs.tick,
        inputs: *inputs,
        tools: all_tools(outputs),
        flags: outputs.flags(),
        hash: outputs.frame.then_some(outputs.hash),
    };
    if tap.ticks.push(tick).is_err() {
        return true;
    }
    if outputs.frame {
        // A frame that nobody gave room for is left out: a replay does not need it.
        let kept = tap.empty_frames.pop().is_ok_and(|mut frame| {
            fill(&mut frame, outputs);
            tap.frames.push(frame).is_ok()
        });
        if !kept {
            ends.dropped.frames.fetch_add(1, Ordering::Relaxed);
        }
    }
    false
}
