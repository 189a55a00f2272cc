//! Recordings made while serving: what the simulation thread consumed, written on a thread of its own.

use super::{Shared, lock};
use crate::realtime::mailbox::{Command, Frame, RecordTap, RecordedTick};
use crate::recording::RecordingWriter;
use palpate_core::simulation::{Snapshot, TICKS_PER_FRAME};
use palpate_proto as proto;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

/// Ticks that may wait for the disk: four seconds.
const WAITING_TICKS: usize = 4096;
/// Frames that may wait for it.
const WAITING_FRAMES: usize = WAITING_TICKS / TICKS_PER_FRAME as usize;

/// The recording that runs, if one does.
pub(super) struct Recorder {
    running: Mutex<Option<Running>>,
}

struct Running {
    /// Somebody wants it to end: otherwise its end is a fault.
    wanted_to_end: Arc<AtomicBool>,
    thread: std::thread::JoinHandle<proto::RecordingStatus>,
    status: Arc<Mutex<proto::RecordingStatus>>,
}

impl Recorder {
    pub(super) fn new() -> Self {
        Self { running: Mutex::new(None) }
    }

    pub(super) fn status(&self) -> Option<proto::RecordingStatus> {
        lock(&self.running).as_ref().map(|r| lock(&r.status).clone())
    }
}

/// The recorder's ends of a tap.
struct Ends {
    start: rtrb::Consumer<Box<Snapshot>>,
    ticks: rtrb::Consumer<RecordedTick>,
    frames: rtrb::Consumer<Box<Frame>>,
    empty_frames: rtrb::Producer<Box<Frame>>,
}

/// Starts a recording into `path` at the next tick.
pub(super) async fn start(shared: &Arc<Shared>, path: PathBuf) -> Result<(), String> {
    let shared = shared.clone();
    tokio::task::spawn_blocking(move || start_now(&shared, &path))
        .await
        .map_err(|e| format!("the recorder died: {e}"))?
}

fn start_now(shared: &Shared, path: &Path) -> Result<(), String> {
    let mut running = lock(&shared.recorder.running);
    if let Some(now) = running.as_ref().filter(|r| !r.thread.is_finished()) {
        return Err(format!("a recording is running already, into {}", lock(&now.status).path));
    }
    let (tap, mut ends) = tap(shared);
    shared.command(Command::StartRecording(tap))?;
    let asked = Instant::now();
    let start = loop {
        match ends.start.pop() {
            Ok(start) => break start,
            Err(_) if asked.elapsed() > Duration::from_secs(2) => {
                let _ = shared.command(Command::StopRecording);
                return Err("the simulation does not answer".into());
            }
            Err(_) => std::thread::sleep(Duration::from_millis(1)),
        }
    };
    let writer = match RecordingWriter::create(path, &shared.scene, &shared.body, &start, &shared.reset) {
        Ok(writer) => writer,
        Err(e) => {
            let _ = shared.command(Command::StopRecording);
            return Err(e.to_string());
        }
    };
    let status = Arc::new(Mutex::new(writer.status()));
    let (tools, told) = (shared.scene.tool.len(), status.clone());
    let wanted_to_end = Arc::new(AtomicBool::new(false));
    let wanted = wanted_to_end.clone();
    let thread = std::thread::Builder::new()
        .name("recorder".into())
        .spawn(move || write(writer, ends, tools, &told, &wanted))
        .map_err(|e| e.to_string())?;
    *running = Some(Running { wanted_to_end, thread, status });
    Ok(())
}

fn tap(shared: &Shared) -> (Box<RecordTap>, Ends) {
    let vertices = shared.body.surface().vertices.len();
    let (start_in, start) = rtrb::RingBuffer::new(1);
    let (ticks_in, ticks) = rtrb::RingBuffer::new(WAITING_TICKS);
    let (frames_in, frames) = rtrb::RingBuffer::new(WAITING_FRAMES);
    let (mut empty_frames, empty_out) = rtrb::RingBuffer::new(WAITING_FRAMES);
    while empty_frames.push(Box::new(Frame::empty(vertices))).is_ok() {}
    let tap = RecordTap {
        start: start_in,
        room: Some(Box::new(Snapshot::with_room(&shared.body, &shared.scene.settings()))),
        ticks: ticks_in,
        frames: frames_in,
        empty_frames: empty_out,
    };
    (Box::new(tap), Ends { start, ticks, frames, empty_frames })
}

/// Writes until the tap is dropped and its rings are empty.
fn write(
    mut writer: RecordingWriter,
    mut ends: Ends,
    tools: usize,
    status: &Mutex<proto::RecordingStatus>,
    wanted_to_end: &AtomicBool,
) -> proto::RecordingStatus {
    let mut fault = String::new();
    let mut last_status = Instant::now();
    loop {
        // Abandonment is asked for first: what was pushed before it is then certainly in the ring.
        let over = ends.ticks.is_abandoned();
        let mut idle = true;
        while let Ok(tick) = ends.ticks.pop() {
            idle = false;
            if fault.is_empty()
                && let Err(e) = writer.tick(tick.tick, &tick.inputs, &tick.tools[..tools], tick.flags, tick.hash)
            {
                fault = e.to_string();
            }
        }
        while let Ok(frame) = ends.frames.pop() {
            if fault.is_empty()
                && let Err(e) = writer.frame(frame.tick, &frame.skin, &frame.levels, &frame.tools[..tools])
            {
                fault = e.to_string();
            }
            let _ = ends.empty_frames.push(frame);
        }
        if last_status.elapsed() > Duration::from_millis(200) {
            last_status = Instant::now();
            *lock(status) = proto::RecordingStatus { fault: fault.clone(), ..writer.status() };
        }
        if over && idle {
            break;
        }
        if idle {
            std::thread::sleep(Duration::from_millis(5));
        }
    }
    if fault.is_empty() && !wanted_to_end.load(Ordering::Relaxed) {
        fault = "the disk was too slow: ticks were lost, and the recording ends before them".into();
    }
    let before = writer.status();
    let done = match writer.finish() {
        Ok(done) => proto::RecordingStatus { fault, ..done },
        Err(e) => proto::RecordingStatus { fault: e.to_string(), ..before },
    };
    *lock(status) = done.clone();
    done
}

/// Says that the running recording, if there is one, is wanted to end: to be called before its tap is told.
pub(super) fn expect_end(shared: &Shared) {
    if let Some(running) = lock(&shared.recorder.running).as_ref() {
        running.wanted_to_end.store(true, Ordering::Relaxed);
    }
}

/// Waits until the running recording, whose tap has been told to stop, is on disk.
pub(super) async fn finish(shared: &Arc<Shared>) -> Option<proto::RecordingStatus> {
    let running = lock(&shared.recorder.running).take()?;
    tokio::task::spawn_blocking(move || running.thread.join().ok()).await.ok().flatten()
}
