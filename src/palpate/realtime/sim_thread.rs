//! The simulation thread: gather inputs, advance, hand out, sleep.

use super::clock::Clock;
use super::mailbox::{Command, RecordTap, RecordedTick, SimulationEnds, TickReport, TickTiming};
use super::pacer::{Begin, Pacer};
use palpate_core::contact::tool::{MOST_TOOLS, ToolEvent};
use palpate_core::model::{ActiveMesh, State};
use palpate_core::simulation::{Inputs, Laps, Outputs, Part, Prices, Simulation, TICKS_PER_FRAME, ToolOutput};
use palpate_core::stepping::governor::{Governor, MOST_PLANNED, TickKind};
use palpate_core::stepping::work;
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
        let mut epochs = [0; MOST_TOOLS];
        for (epoch, tool) in epochs.iter_mut().zip(simulation.tools()) {
            *epoch = tool.epoch;
        }
        Self { simulation, ends, governor: Governor::new(), tap: None, awaited: None, epochs }
    }

    /// Measures on `clock` what the parts of a tick cost on this machine, by ticks that lead nowhere: the body is as it was
    /// afterwards. Time that the coarsest body takes of a tick with a frame [ns], and what a tick may take.
    pub fn measure(&mut self, clock: &mut impl Clock) -> Measured {
        let start = self.simulation.snapshot();
        for i in 0..MEASURED_TICKS {
            let prices = self.governor.prices();
            let inputs = Inputs { prices: Some(prices), ..Inputs::default() };
            let (began, computed) = (clock.now(), clock.computed());
            let mut watch = Stopwatch { last: began, clock: &mut *clock, governor: &mut self.governor };
            self.simulation.advance_with(&inputs, &mut watch);
            self.simulation.save_shape_into(self.ends.copies.input_buffer_mut());
            watch.lap(Part::Copy, 1);
            watch.lap(Part::Fixed, 1);
            let (compute, computed) = (clock.now() - began, clock.computed() - computed);
            let planned = self.simulation.outputs().plan.whole + prices.of(Part::Copy, 1);
            self.governor.end_tick(planned, TickKind::Ordinary, computed, compute.saturating_sub(computed));
            if i < MEASURED_TICKS / 4 {
                // The first ticks warm up caches.
                self.governor = Governor::new();
            }
        }
        self.simulation.load(&start);
        let (body, prices) = (self.simulation.body().clone(), self.governor.prices());
        // A body that adapts can do with its coarsest level, however fine it starts.
        let adapts = self.simulation.settings().adaptivity.is_some();
        let coarsest = adapts.then(|| ActiveMesh::new(&body, &State::at_rest(&body, 0), 0).ok()).flatten();
        let floor = work::floor(&body, coarsest.as_ref().unwrap_or(self.simulation.mesh()), &prices);
        Measured { prices, floor, planned: MOST_PLANNED }
    }

    /// Ticks until `stop`. After this call begins, nothing is allocated, locked or logged on this thread.
    pub fn run(&mut self, clock: impl Clock, stop: &AtomicBool) {
        let mut pacer = Pacer::start(clock);
        while !stop.load(Ordering::Relaxed) {
            let begin = pacer.begin();
            let computed = pacer.clock().computed();
            self.governor.share_with(self.ends.others.load(Ordering::Relaxed));
            let inputs = self.gather(begin);
            let clock = pacer.clock();
            let mut watch = Stopwatch { last: clock.after(Part::Fixed, 0), clock, governor: &mut self.governor };
            let outputs = self.simulation.advance_with(&inputs, &mut watch);
            hand_out(&mut self.ends, outputs, begin.began);
            let overflowed = record(&mut self.tap, &self.ends, &inputs, outputs);
            let mut timing = TickTiming {
                tick: outputs.tick,
                lateness: begin.lateness,
                compute: 0,
                missed: false,
                lapsed: begin.lapsed,
                away: 0,
                plan: outputs.plan,
                element_evaluations: outputs.element_evaluations,
                budget: inputs.budget,
                prices: inputs.prices,
                active: outputs.active,
                elements: outputs.elements,
                adapted: outputs.adapted,
                restored: outputs.restored,
            };
            let engaged = outputs.tools.iter().any(|t| t.state.touches());
            let copies = engaged && outputs.tick % TICKS_PER_FRAME == TICKS_PER_FRAME / 2;
            let kind = TickKind::of(outputs.adapted.work > 0, outputs.frame || copies);
            watch.lap(Part::Fixed, 1);
            if copies {
                // In the middle of a frame: its end has enough to do.
                self.simulation.save_shape_into(self.ends.copies.input_buffer_mut());
                self.ends.copies.publish();
                watch.lap(Part::Copy, 1);
                timing.plan.whole += self.governor.prices().of(Part::Copy, 1);
            }
            if overflowed {
                self.retire();
            }
            let computed = pacer.clock().computed() - computed;
            (timing.compute, timing.missed) = pacer.end();
            let away = timing.compute.saturating_sub(computed);
            timing.away = self.governor.end_tick(timing.plan.whole, kind, computed, away);
            if self.ends.timings.push(timing).is_err() {
                self.ends.dropped.timings.fetch_add(1, Ordering::Relaxed);
            }
        }
        self.retire();
    }

    /// The inputs of the tick that begins: one event per tool, those of the control side first.
    fn gather(&mut self, begin: Begin) -> Inputs {
        let tells = self.simulation.tick().is_multiple_of(TICKS_PER_PRICES);
        let mut inputs = Inputs {
            lapsed: begin.lapsed,
            budget: self.governor.budget(),
            prices: tells.then(|| self.governor.prices()),
            ..Inputs::default()
        };
        // A command that cannot be taken now (its tool has an event already, or a parameter is set) waits for the next tick.
        while let Ok(command) = self.ends.commands.peek() {
            let tool = match command {
                Command::Attach { tool, .. } | Command::Detach { tool } => Some(*tool),
                _ => None,
            };
            let is_set = matches!(command, Command::Set(_)) && inputs.parameter.is_some();
            if is_set || tool.is_some_and(|t| inputs.tools.get(t).is_none_or(Option::is_some)) {
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
            Command::Set(parameter) => inputs.parameter = Some(parameter),
            Command::StartRecording(tap) => {
                self.retire();
                self.awaited = Some(tap);
            }
            Command::StopRecording => self.retire(),
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

/// Ticks from which costs are first measured: two of them end a frame.
const MEASURED_TICKS: u32 = 96;
/// Ticks between two lists of prices that the core is told.
const TICKS_PER_PRICES: u64 = 8;

/// What a machine can do with a body.
#[derive(Clone, Copy, Debug)]
pub struct Measured {
    /// What the parts of a tick cost.
    pub prices: Prices,
    /// Time that a tick takes in which the body is as coarse as it can be, untouched [ns].
    pub floor: u32,
    /// Time that a tick may be planned to take [ns].
    pub planned: u32,
}

impl Measured {
    /// Whether the machine can serve it at 1 kHz.
    pub fn fits(&self) -> bool {
        self.floor <= self.planned
    }

    /// In words, for a start line.
    pub fn describe(&self) -> String {
        format!(
            "the coarsest body takes {} µs of each tick, of {} µs that are there",
            self.floor / 1000,
            self.planned / 1000
        )
    }
}

/// Reads the clock between the parts of a tick, for the governor.
struct Stopwatch<'a, C> {
    clock: &'a mut C,
    governor: &'a mut Governor,
    last: u64,
}

impl<C: Clock> Laps for Stopwatch<'_, C> {
    fn lap(&mut self, part: Part, count: u32) {
        let now = self.clock.after(part, count);
        self.governor.lap(part, count, now.saturating_sub(self.last));
        self.last = now;
    }
}

fn all_tools(outputs: &Outputs) -> [ToolOutput; MOST_TOOLS] {
    let mut tools = [ToolOutput::default(); MOST_TOOLS];
    for (to, from) in tools.iter_mut().zip(&outputs.tools) {
        *to = *from;
    }
    tools
}

fn hand_out(ends: &mut SimulationEnds, outputs: &Outputs, began: u64) {
    let report = TickReport { tick: outputs.tick, began, tools: all_tools(outputs), flags: outputs.flags() };
    if ends.reports.push(report).is_err() {
        ends.dropped.reports.fetch_add(1, Ordering::Relaxed);
    }
    // The eventfd's counter is far from full, so this never blocks.
    let _ = rustix::io::write(&ends.wake, &1u64.to_ne_bytes());
    if outputs.frame {
        ends.frames.input_buffer_mut().fill(outputs);
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
            frame.fill(outputs);
            tap.frames.push(frame).is_ok()
        });
        if !kept {
            ends.dropped.frames.fetch_add(1, Ordering::Relaxed);
        }
    }
    false
}
