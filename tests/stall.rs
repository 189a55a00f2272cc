//! What a recording shows of a stall: 5 ms after the machine is back, the ticks are within one of the wall clock, caught
//! up or lapsed.

use palpate::realtime::clock::{Clock, Monotonic};
use palpate::realtime::mailbox::{Command, RecordTap, mailboxes};
use palpate::realtime::sim_thread::SimThread;
use palpate::recording::{Recording, RecordingWriter};
use palpate::scene::LoadedScene;
use palpate_core::model::step_class::TICK_NS;
use palpate_core::simulation::{Frame, Part, Simulation, Snapshot};
use std::cell::RefCell;
use std::path::Path;
use std::rc::Rc;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

/// Time from the end of a stall until the clock must be right again [ns].
const RECOVERY_NS: u64 = 5_000_000;

/// What a clock saw.
#[derive(Default)]
struct Seen {
    /// When the thread started [ns].
    started: u64,
    /// When each tick began [ns].
    begun: Vec<u64>,
    /// When each stall ended [ns].
    recovered: Vec<u64>,
}

/// A time in which the machine is away.
#[derive(Clone, Copy)]
struct Stall {
    /// Ticks begun before it.
    after: usize,
    /// Its length [ns].
    length: u64,
    /// While a tick computes; else while the thread sleeps.
    inside: bool,
}

/// Time that passes only as it is told.
struct MadeUp {
    now: u64,
    /// The next question is asked at the end of a tick.
    ends_tick: bool,
    /// Time that every tick takes [ns].
    compute: u64,
    stalls: Vec<Stall>,
    ticks: usize,
    stop: Arc<AtomicBool>,
    seen: Rc<RefCell<Seen>>,
}

impl MadeUp {
    fn stall(&mut self, inside: bool) {
        let mut seen = self.seen.borrow_mut();
        let begun = seen.begun.len();
        if let Some(stall) = self.stalls.iter().find(|s| s.inside == inside && s.after == begun) {
            self.now += stall.length;
            seen.recovered.push(self.now);
        }
    }
}

impl Clock for MadeUp {
    fn now(&mut self) -> u64 {
        if self.seen.borrow().started == 0 {
            self.seen.borrow_mut().started = self.now;
        } else if self.ends_tick {
            self.now += self.compute;
            self.stall(true);
        }
        self.ends_tick = !self.ends_tick;
        self.now
    }
    fn computed(&mut self) -> u64 {
        self.now
    }
    fn after(&mut self, _: Part, _: u32) -> u64 {
        self.now
    }
    fn sleep_until(&mut self, deadline: u64) {
        self.ends_tick = false;
        self.now = self.now.max(deadline);
        self.stall(false);
        self.seen.borrow_mut().begun.push(self.now);
        if self.seen.borrow().begun.len() == self.ticks {
            self.stop.store(true, Ordering::Relaxed);
        }
    }
}

/// Runs a simulation thread on `clock` until it is told to stop; what was recorded of it.
fn recorded(name: &str, clock: impl Clock, stop: &AtomicBool) -> Recording {
    let given = ["body.cells=[[2,2,2],[3,3,3]]", "hold=[{min=[0,0,0], max=[0.1,0.1,0]}]"].map(String::from);
    let loaded = LoadedScene::load(Path::new("cube"), &given).unwrap();
    let body = Arc::new(loaded.build(&mut |_, _, _| {}).unwrap());
    let (settings, start) = (loaded.scene.settings(), loaded.scene.at_rest(&body));
    let reset = start.body.clone();
    let simulation = Simulation::new(body.clone(), settings.clone(), start).unwrap();
    let (ends, mut server) = mailboxes(&body, &settings).unwrap();

    let (start_in, mut start) = rtrb::RingBuffer::new(1);
    let (ticks_in, mut ticks) = rtrb::RingBuffer::new(4096);
    let (frames_in, _frames) = rtrb::RingBuffer::new(128);
    let (mut empty, empty_out) = rtrb::RingBuffer::new(128);
    while empty.push(Box::new(Frame::with_room(&body, &settings))).is_ok() {}
    let tap = RecordTap {
        start: start_in,
        room: Some(Box::new(Snapshot::with_room(&body, &settings))),
        ticks: ticks_in,
        frames: frames_in,
        empty_frames: empty_out,
    };
    server.commands.push(Command::StartRecording(Box::new(tap))).ok().unwrap();
    SimThread::new(simulation, ends).run(clock, stop);

    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join(format!("{name}.mcap"));
    let mut writer = RecordingWriter::create(&path, &loaded.scene, &body, &start.pop().unwrap(), &reset).unwrap();
    while let Ok(tick) = ticks.pop() {
        writer.tick(tick.tick, &tick.inputs, &tick.tools[..1], tick.flags, tick.hash).unwrap();
    }
    writer.finish().unwrap();
    Recording::read(&path).unwrap()
}

/// Of each recorded tick, when it began [ns since the start], and how far its number is from the wall clock [ns].
fn off_the_wall(recording: &Recording, seen: &Seen) -> Vec<(u64, u64)> {
    let began = &seen.begun[seen.begun.len() - recording.inputs.len()..];
    let off = |((tick, _), began): (&(u64, _), &u64)| (*began, (began - seen.started).abs_diff(tick * TICK_NS));
    recording.inputs.iter().zip(began).map(off).collect()
}

fn lapsed(recording: &Recording) -> u64 {
    recording.inputs.iter().map(|(_, inputs)| u64::from(inputs.lapsed)).sum()
}

#[test]
fn five_milliseconds_after_a_stall_the_recorded_ticks_are_within_one_of_the_wall_clock() {
    for compute in [50_000, 300_000, 800_000] {
        for length in [700_000, 1_500_000, 3_000_000, 7_000_000, 20_000_000, 150_000_000] {
            for inside in [false, true] {
                let (stop, seen) = (Arc::new(AtomicBool::new(false)), Rc::new(RefCell::new(Seen::default())));
                let clock = MadeUp {
                    now: 12_345_678,
                    ends_tick: false,
                    compute,
                    stalls: vec![Stall { after: 100, length, inside }, Stall { after: 200, length, inside: !inside }],
                    ticks: 300,
                    stop: stop.clone(),
                    seen: seen.clone(),
                };
                let recording = recorded("stall", clock, &stop);
                let seen = seen.borrow();
                assert_eq!((seen.recovered.len(), recording.inputs.len()), (2, 300));
                let off = off_the_wall(&recording, &seen);
                let recovering = |at: u64| seen.recovered.iter().any(|end| (*end..*end + RECOVERY_NS).contains(&at));
                let (mut judged, mut away) = (0, 0);
                for (at, off) in off {
                    if recovering(at) {
                        away = away.max(off);
                    } else {
                        judged += 1;
                        assert!(off <= TICK_NS, "compute {compute}, stall {length}: {off} ns off at {at}");
                    }
                }
                let lost = lapsed(&recording);
                // The stalls are on the recording, and most ticks, but those caught up at once, were judged.
                assert!(judged > 200 && (lost > 0 || away + TICK_NS >= length), "{judged} judged, {away} ns away");
                // What takes longer than 4 ms to catch up lapses, and nothing that is shorter does.
                let ticks = 2 * (length / TICK_NS);
                println!("compute {compute} ns, stall {length} ns: {lost} of {ticks} lost ticks lapsed");
                let gain = TICK_NS - compute;
                let slow = (length / TICK_NS) * compute * TICK_NS / gain > 4_500_000;
                let quick = (length / TICK_NS + 1) * compute * TICK_NS / gain < 3_500_000;
                assert!(!slow || lost >= ticks - 2, "{lost}");
                assert!(!quick || lost == 0, "{lost}");
            }
        }
    }
}

/// The system's clock, with stalls while the thread sleeps.
struct Stalling {
    clock: Monotonic,
    ticks: usize,
    stop: Arc<AtomicBool>,
    seen: Rc<RefCell<Seen>>,
}

impl Clock for Stalling {
    fn now(&mut self) -> u64 {
        let now = self.clock.now();
        let mut seen = self.seen.borrow_mut();
        if seen.started == 0 {
            seen.started = now;
        }
        now
    }
    fn sleep_until(&mut self, deadline: u64) {
        let mut seen = self.seen.borrow_mut();
        let stall = match seen.begun.len() {
            200 | 600 => 3_000_000,
            400 | 800 => 60_000_000,
            _ => 0,
        };
        self.clock.sleep_until(deadline + stall);
        let now = self.clock.now();
        seen.begun.push(now);
        if seen.begun.len() == self.ticks {
            self.stop.store(true, Ordering::Relaxed);
        }
    }
}

/// In real time. A busy machine stalls the thread where it likes: whenever a tick begins more than 1.4 ms after the one
/// before, a stall has ended.
#[test]
fn in_real_time_the_recorded_ticks_come_back_to_the_wall_clock() {
    let (stop, seen) = (Arc::new(AtomicBool::new(false)), Rc::new(RefCell::new(Seen::default())));
    let clock = Stalling { clock: Monotonic, ticks: 1000, stop: stop.clone(), seen: seen.clone() };
    let recording = recorded("stall_in_real_time", clock, &stop);
    let seen = seen.borrow();
    let off = off_the_wall(&recording, &seen);
    let (mut judged, mut wrong, mut stalls, mut end) = (0, 0, 0, 0);
    for pair in off.windows(2) {
        let [(before, _), (at, off)] = [pair[0], pair[1]];
        if at - before > 1_400_000 {
            (stalls, end) = (stalls + 1, at);
        } else if at > end + RECOVERY_NS {
            (judged, wrong) = (judged + 1, wrong + usize::from(off > TICK_NS));
        }
    }
    println!("{stalls} stalls, {judged} ticks judged, {wrong} of them off; {} lapsed", lapsed(&recording));
    assert!(
        stalls >= 4 && (lapsed(&recording) > 0 || off.iter().any(|(_, off)| *off > 50_000_000)),
        "the stalls are on the recording"
    );
    assert!(recording.inputs.last().unwrap().0 >= 1000);
    // A tick may come late of itself on a busy machine; one that stayed behind after a stall would be off for good.
    assert!(judged >= 20 && wrong * 20 <= judged, "{wrong} of {judged} ticks are more than a tick off the wall clock");
}
