//! What passes between the simulation thread and the rest: latest-wins slots in, single-producer rings out.
//!
//! No side ever waits for another. A full ring is an ordinary answer: the entry is dropped and counted.

use palpate_core::adaptation::Adapted;
use palpate_core::contact::tool::{Coupling, MOST_TOOLS, PoseSample};
use palpate_core::model::Body;
use palpate_core::model::step_class::TICK_NS;
use palpate_core::simulation::{
    Budget, Frame, Inputs, MOST_LEVELS, Parameter, Plan, Prices, Settings, Snapshot, TickFlags, ToolOutput,
};
use rustix::event::{EventfdFlags, eventfd};
use rustix::fd::OwnedFd;
use std::sync::Arc;
use std::sync::atomic::{AtomicU32, AtomicU64};

/// A pose on its way to the tick, with the epoch of the client that sent it.
#[derive(Clone, Copy, Debug)]
pub struct PoseSlot {
    /// Of the sender.
    pub epoch: u32,
    /// The pose.
    pub sample: PoseSample,
}

/// What the control side asks of the simulation thread.
pub enum Command {
    /// A client takes a tool.
    Attach {
        /// The tool.
        tool: usize,
        /// Its new epoch.
        epoch: u32,
        /// Ticks between two poses.
        period_ticks: u32,
        /// What it hangs on.
        coupling: Coupling,
    },
    /// The client is gone.
    Detach {
        /// The tool.
        tool: usize,
    },
    /// Back to the starting state.
    Reset,
    /// A quantity gets another value.
    Set(Parameter),
    /// Record from the next tick on.
    StartRecording(Box<RecordTap>),
    /// Stop recording.
    StopRecording,
}

/// The simulation thread's end of a recording. It is made, and dropped, elsewhere; that it was dropped tells the
/// recorder that the recording is over.
pub struct RecordTap {
    /// Where the state before the first recorded tick goes; sent once.
    pub start: rtrb::Producer<Box<Snapshot>>,
    /// Room for it.
    pub room: Option<Box<Snapshot>>,
    /// Every tick.
    pub ticks: rtrb::Producer<RecordedTick>,
    /// Frames on their way.
    pub frames: rtrb::Producer<Box<Frame>>,
    /// Empty frames that come back.
    pub empty_frames: rtrb::Consumer<Box<Frame>>,
}

/// A tick as the recorder gets it.
#[derive(Clone, Copy)]
pub struct RecordedTick {
    /// The tick.
    pub tick: u64,
    /// What it consumed.
    pub inputs: Inputs,
    /// What each tool felt.
    pub tools: [ToolOutput; MOST_TOOLS],
    /// What else it said with every wrench.
    pub flags: TickFlags,
    /// The state's hash, at frames.
    pub hash: Option<u64>,
}

/// A tick as the force output gets it.
#[derive(Clone, Copy)]
pub struct TickReport {
    /// The tick.
    pub tick: u64,
    /// When it began, on the thread's clock [ns].
    pub began: u64,
    /// Each tool.
    pub tools: [ToolOutput; MOST_TOOLS],
    /// What else the tick said.
    pub flags: TickFlags,
}

/// A tick as the status gets it.
#[derive(Clone, Copy, Debug)]
pub struct TickTiming {
    /// The tick.
    pub tick: u64,
    /// Begun this long after its deadline [ns].
    pub lateness: u64,
    /// Time inside it [ns].
    pub compute: u64,
    /// It ended after the next deadline.
    pub missed: bool,
    /// Ticks lost before it.
    pub lapsed: u32,
    /// Time of it in which the thread was away: another thread, or the hypervisor, had its processor [ns].
    pub away: u64,
    /// Time that it was planned to take.
    pub plan: Plan,
    /// Element evaluations spent.
    pub element_evaluations: u32,
    /// What it was allowed.
    pub budget: Budget,
    /// What work costs, where that was told anew.
    pub prices: Option<Prices>,
    /// Active nodes per level.
    pub active: [u32; MOST_LEVELS],
    /// Elements in use.
    pub elements: u32,
    /// Changes of resolution.
    pub adapted: Adapted,
    /// A non-finite state was contained.
    pub restored: bool,
}

impl TickTiming {
    /// True when the machine, not the tick, is why it ended late: without the time away, and begun on time, it had not.
    pub fn was_away(&self) -> bool {
        self.compute.saturating_sub(self.away) <= TICK_NS
    }
}

/// Ticks dropped because a reader was too slow, by reader.
#[derive(Debug, Default)]
pub struct Dropped {
    /// Force output.
    pub reports: AtomicU64,
    /// Status.
    pub timings: AtomicU64,
    /// Frames not recorded because none was empty.
    pub frames: AtomicU64,
}

/// The simulation thread's ends.
pub struct SimulationEnds {
    /// One latest-wins slot per tool.
    pub poses: Vec<triple_buffer::Output<Option<PoseSlot>>>,
    /// Commands, drained at the start of a tick.
    pub commands: rtrb::Consumer<Command>,
    /// Taps of recordings that ended, to be dropped elsewhere.
    pub retired: rtrb::Producer<Box<RecordTap>>,
    /// To the force output.
    pub reports: rtrb::Producer<TickReport>,
    /// Wakes it.
    pub wake: Arc<OwnedFd>,
    /// To the status.
    pub timings: rtrb::Producer<TickTiming>,
    /// To the surface output.
    pub frames: triple_buffer::Input<Frame>,
    /// To whoever asks questions about a copy.
    pub copies: triple_buffer::Input<Snapshot>,
    /// Dropped entries.
    pub dropped: Arc<Dropped>,
    /// Time that the process's other real-time threads take of each tick [ns].
    pub others: Arc<AtomicU32>,
}

/// Everybody else's ends.
pub struct ServerEnds {
    /// One slot per tool.
    pub poses: Vec<triple_buffer::Input<Option<PoseSlot>>>,
    /// To the simulation thread.
    pub commands: rtrb::Producer<Command>,
    /// Taps that come back.
    pub retired: rtrb::Consumer<Box<RecordTap>>,
    /// Of the force output.
    pub reports: rtrb::Consumer<TickReport>,
    /// Readable when there is a report.
    pub wake: Arc<OwnedFd>,
    /// Of the status.
    pub timings: rtrb::Consumer<TickTiming>,
    /// Of the surface output.
    pub frames: triple_buffer::Output<Frame>,
    /// Copies of the simulation while a tool touches, one a frame.
    pub copies: triple_buffer::Output<Snapshot>,
    /// Dropped entries.
    pub dropped: Arc<Dropped>,
    /// Time that the process's other real-time threads take of each tick [ns].
    pub others: Arc<AtomicU32>,
}

/// Both sides, for a simulation of `body` with `settings`.
///
/// # Errors
/// When the system has no eventfd to give.
pub fn mailboxes(body: &Body, settings: &Settings) -> std::io::Result<(SimulationEnds, ServerEnds)> {
    let (pose_in, pose_out) = (0..settings.tools.len()).map(|_| triple_buffer::triple_buffer(&None)).unzip();
    // One request may set the stiffness of every tissue of every organ.
    let (command_in, command_out) = rtrb::RingBuffer::new(256);
    let (retired_in, retired_out) = rtrb::RingBuffer::new(4);
    // The force output sends the newest; a burst of caught-up ticks fits.
    let (report_in, report_out) = rtrb::RingBuffer::new(64);
    // The status looks in every tenth of a second.
    let (timing_in, timing_out) = rtrb::RingBuffer::new(8192);
    let (frame_in, frame_out) = triple_buffer::triple_buffer(&Frame::with_room(body, settings));
    let room = || Snapshot::with_room(body, settings);
    let (mut copy_in, mut copy_out) = triple_buffer::triple_buffer(&room());
    // A clone keeps what is in a list, not its room: each of the three gets its own, and none counts as news.
    for _ in 0..3 {
        copy_in.write(room());
        copy_out.update();
    }
    let wake = Arc::new(eventfd(0, EventfdFlags::CLOEXEC)?);
    let dropped = Arc::new(Dropped::default());
    let others = Arc::new(AtomicU32::new(0));
    let simulation = SimulationEnds {
        poses: pose_out,
        commands: command_out,
        retired: retired_in,
        reports: report_in,
        wake: wake.clone(),
        timings: timing_in,
        frames: frame_in,
        copies: copy_in,
        dropped: dropped.clone(),
        others: others.clone(),
    };
    let server = ServerEnds {
        poses: pose_in,
        commands: command_in,
        retired: retired_out,
        reports: report_out,
        wake,
        timings: timing_out,
        frames: frame_out,
        copies: copy_out,
        dropped,
        others,
    };
    Ok((simulation, server))
}
