//! The simulation thread allocates nothing once it runs: counted by the allocator itself, on that very thread, while
//! a tool attaches, presses, is lost, a recording starts and stops, and the body is reset, and while all that refines
//! and coarsens the body.

use palpate::contact::tool::PoseSample;
use palpate::math::{Pose, Vec3};
use palpate::realtime::clock::Clock;
use palpate::realtime::mailbox::{Command, Frame, PoseSlot, RecordTap, mailboxes};
use palpate::realtime::sim_thread::SimThread;
use palpate::scene::LoadedScene;
use palpate::simulation::{Simulation, Snapshot};
use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

struct Counting;
thread_local! {
    static COUNTED: Cell<bool> = const { Cell::new(false) };
    static CALLS: Cell<u64> = const { Cell::new(0) };
}

fn count() {
    if COUNTED.get() {
        CALLS.set(CALLS.get() + 1);
    }
}

// SAFETY: every call is passed on to the system's allocator; counting touches only this thread's cells, which need no
// allocation and no drop.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        count();
        // SAFETY: passed on.
        unsafe { System.alloc(layout) }
    }
    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        count();
        // SAFETY: passed on.
        unsafe { System.dealloc(pointer, layout) }
    }
    unsafe fn realloc(&self, pointer: *mut u8, layout: Layout, size: usize) -> *mut u8 {
        count();
        // SAFETY: passed on.
        unsafe { System.realloc(pointer, layout, size) }
    }
}

#[global_allocator]
static ALLOCATOR: Counting = Counting;

/// Runs a script between ticks, from the other side of the mailboxes, without being counted; time jumps to every
/// deadline, and now and then far beyond it.
struct Scripted<F> {
    now: u64,
    tick: u64,
    script: F,
}
impl<F: FnMut(u64)> Clock for Scripted<F> {
    fn now(&mut self) -> u64 {
        self.now += 50_000;
        self.now
    }
    fn sleep_until(&mut self, deadline: u64) {
        self.tick += 1;
        let stall = if self.tick.is_multiple_of(500) { 200_000_000 } else { 0 };
        self.now = self.now.max(deadline) + stall;
        COUNTED.set(false);
        (self.script)(self.tick);
        COUNTED.set(true);
    }
}

#[test]
fn the_simulation_thread_allocates_nothing() {
    // On springs, with memory: everything that a body may have.
    let given = [
        "body.cells=[[3,3,3],[5,5,5],[9,9,9]]",
        "hold=[{min=[0,0,0], max=[0.1,0.1,0]}]",
        "material.damping_ratio=0.1",
        "world.gravity=[0,0,0]",
        // A ball, and solid cores beside it that touch, too.
        "tool=[{name='all', shape='compound', part=[{radius=0.02}, \
            {shape='cylinder', radius=0.005, length=0.03, position=[0.0,0.0,-0.02]}, \
            {shape='convex', points=[[0.01,0,-0.02],[0.03,0,-0.02],[0.01,0.01,-0.02],[0.01,0,0.01]]}]}]",
    ]
    .map(String::from);
    let loaded = LoadedScene::load(Path::new("cube"), &given).unwrap();
    let body = Arc::new(loaded.build(&mut |_, _, _| {}).unwrap());
    let (settings, start) = (loaded.scene.settings(), loaded.scene.at_rest(&body));
    let vertices = body.surface().vertices.len();
    let simulation = Simulation::new(body.clone(), settings.clone(), start).unwrap();
    let (sim_ends, mut ends) = mailboxes(1, vertices).unwrap();
    let mut thread = SimThread::new(simulation, sim_ends);
    let stop = Arc::new(AtomicBool::new(false));

    let (mut contacts, mut recorded, mut frames, mut taps) = (0u64, 0u64, 0u64, 0u64);
    let (mut splits, mut merges) = (0, 0);
    let mut consumers = None;
    let (stopped, surface_area) = (stop.clone(), 0.1);
    let script = |tick: u64| {
        match tick {
            100 => ends.commands.push(Command::Attach { tool: 0, epoch: 9, period_ticks: 1 }).ok().unwrap(),
            600 => {
                let (start_in, start_out) = rtrb::RingBuffer::new(1);
                let (ticks_in, ticks_out) = rtrb::RingBuffer::new(4096);
                let (frames_in, frames_out) = rtrb::RingBuffer::new(128);
                let (mut empty_in, empty_out) = rtrb::RingBuffer::new(128);
                while empty_in.push(Box::new(Frame::empty(vertices))).is_ok() {}
                let tap = RecordTap {
                    start: start_in,
                    room: Some(Box::new(Snapshot::with_room(&body, &settings))),
                    ticks: ticks_in,
                    frames: frames_in,
                    empty_frames: empty_out,
                };
                consumers = Some((start_out, ticks_out, frames_out, empty_in));
                ends.commands.push(Command::StartRecording(Box::new(tap))).ok().unwrap();
            }
            1400 => ends.commands.push(Command::StopRecording).ok().unwrap(),
            1500 => ends.commands.push(Command::Reset).ok().unwrap(),
            1900 => ends.commands.push(Command::Detach { tool: 0 }).ok().unwrap(),
            2500 => stopped.store(true, Ordering::Relaxed),
            _ => {}
        }
        // Presses from above for 0.6 s, then falls silent until the watchdog lets go, then comes back.
        if (101..1000).contains(&tick) || (1600..1900).contains(&tick) {
            let down = 0.035 * ((tick as f64 - 150.0) / 300.0).clamp(0.0, 1.0);
            let position = Vec3::new(surface_area / 2.0, 0.05, 0.1 + 0.02 + 0.02 - down);
            let sample = PoseSample {
                sequence: tick as u32,
                time_ns: tick,
                pose: Pose { position, ..Pose::default() },
                linear_velocity: Vec3::zeros(),
                angular_velocity: Vec3::zeros(),
                buttons: 0,
            };
            ends.poses[0].write(Some(PoseSlot { epoch: 9, sample }));
        }
        while let Ok(report) = ends.reports.pop() {
            contacts += u64::from(report.tools[0].contact_points > 0);
        }
        while let Ok(timing) = ends.timings.pop() {
            splits += timing.adapted.splits;
            merges += timing.adapted.merges;
        }
        frames += u64::from(ends.frames.update());
        if let Some((_, ticks, _, _)) = &mut consumers {
            while ticks.pop().is_ok() {
                recorded += 1;
            }
        }
        while ends.retired.pop().is_ok() {
            taps += 1;
        }
    };
    COUNTED.set(true);
    thread.run(Scripted { now: 1, tick: 0, script }, &stop);
    COUNTED.set(false);

    println!(
        "{} calls; {contacts} ticks in contact, {recorded} recorded, {frames} frames, {taps} taps, {splits} splits, \
         {merges} merges",
        CALLS.get()
    );
    assert_eq!(CALLS.get(), 0, "calls to the allocator on the simulation thread");
    // The script did happen.
    assert!(contacts > 300 && recorded > 700 && frames > 60 && taps == 1);
    assert!(splits > 20 && merges > 20);
    let tick = thread.simulation().tick();
    assert!(tick > 2500 + 3 * 75, "time passed during the stalls: {tick}");
}
