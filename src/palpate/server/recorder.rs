//! Recordings made while serving: what the simulation thread consumed, written on a thread of its own.
//!
//! That thread alone waits for the disk. No lock is held across a call of the file system, and whoever waits for the thread
//! does so for a bounded time: a disk that hangs holds up nothing but its recording.

use super::health::Weight;
use super::{Shared, lock};
use crate::realtime::mailbox::{Command, RecordTap, RecordedTick};
use crate::realtime::scheduling;
use crate::recording::RecordingWriter;
use palpate_core::simulation::{Frame, Snapshot, TICKS_PER_FRAME};
use palpate_proto as proto;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};
use tokio::sync::{oneshot, watch};

/// Ticks that may wait for the disk: four seconds.
const WAITING_TICKS: usize = 4096;
/// Frames that may wait for it.
const WAITING_FRAMES: usize = WAITING_TICKS / TICKS_PER_FRAME as usize;
/// How often what was recorded goes to the system: what is lost when the process is killed.
const FLUSH: Duration = Duration::from_millis(500);

/// The recording that runs, or the last one that did.
pub(super) struct Recorder {
    newest: Mutex<Option<Running>>,
}

/// What others know of a recording.
#[derive(Clone)]
struct Running {
    /// Somebody wants it to end: otherwise its end is a fault.
    wanted_to_end: Arc<AtomicBool>,
    status: Arc<Mutex<proto::RecordingStatus>>,
    /// True when its thread is done with the disk.
    done: watch::Receiver<bool>,
}

impl Running {
    fn is_done(&self) -> bool {
        // A thread that died is done, too.
        *self.done.borrow() || self.done.has_changed().is_err()
    }
}

impl Recorder {
    pub(super) fn new() -> Self {
        Self { newest: Mutex::new(None) }
    }

    /// Of the recording that runs, or of the last one that did.
    pub(super) fn status(&self) -> Option<proto::RecordingStatus> {
        lock(&self.newest).as_ref().map(|running| lock(&running.status).clone())
    }
}

/// The recorder's ends of a tap.
struct Ends {
    start: rtrb::Consumer<Box<Snapshot>>,
    ticks: rtrb::Consumer<RecordedTick>,
    frames: rtrb::Consumer<Box<Frame>>,
    empty_frames: rtrb::Producer<Box<Frame>>,
}

/// Starts a recording into the new file `path` at the next tick; waits for the disk for at most `limit`.
pub(super) async fn start(shared: &Arc<Shared>, path: PathBuf, limit: Duration) -> Result<(), String> {
    let (began, begun) = oneshot::channel();
    let (finished, done) = watch::channel(false);
    let status = proto::RecordingStatus { path: path.display().to_string(), ..Default::default() };
    let running =
        Running { wanted_to_end: Arc::new(AtomicBool::new(false)), status: Arc::new(Mutex::new(status)), done };
    {
        let mut newest = lock(&shared.recorder.newest);
        if let Some(now) = newest.as_ref().filter(|running| !running.is_done()) {
            return Err(format!("a recording is running already, into {}", lock(&now.status).path));
        }
        *newest = Some(running.clone());
    }
    let (of, server) = (running.clone(), shared.clone());
    std::thread::Builder::new()
        .name("recorder".into())
        .spawn(move || {
            match begin(&server, &path) {
                Ok((writer, ends)) => {
                    // Nobody waits any more: the recording has been given up.
                    if began.send(Ok(())).is_err() {
                        of.wanted_to_end.store(true, Ordering::Relaxed);
                        let _ = server.command(Command::StopRecording);
                    }
                    write(&server, writer, ends, &of);
                }
                Err(e) => {
                    let _ = server.command(Command::StopRecording);
                    // There is no recording of which anybody could be told.
                    lock(&server.recorder.newest).take_if(|newest| Arc::ptr_eq(&newest.status, &of.status));
                    let _ = began.send(Err(e));
                }
            }
            finished.send_replace(true);
        })
        .map_err(|e| e.to_string())?;
    match tokio::time::timeout(limit, begun).await {
        Ok(begun) => begun.unwrap_or_else(|_| Err("the recorder died".into())),
        Err(_) => Err("the disk does not answer: the recording is given up".into()),
    }
}

/// Asks the simulation for its state and writes how the recording starts.
fn begin(shared: &Shared, path: &Path) -> Result<(RecordingWriter, Ends), String> {
    if let Some(folder) = path.parent().filter(|folder| !folder.as_os_str().is_empty()) {
        std::fs::create_dir_all(folder).map_err(|e| format!("{}: {e}", folder.display()))?;
    }
    let (tap, mut ends) = tap(shared);
    shared.command(Command::StartRecording(tap))?;
    let asked = Instant::now();
    let start = loop {
        match ends.start.pop() {
            Ok(start) => break start,
            Err(_) if asked.elapsed() > Duration::from_secs(2) => return Err("the simulation does not answer".into()),
            Err(_) => std::thread::sleep(Duration::from_millis(1)),
        }
    };
    let writer = RecordingWriter::create(path, &shared.scene, &shared.body, &start, &shared.reset);
    Ok((writer.map_err(|e| e.to_string())?, ends))
}

fn tap(shared: &Shared) -> (Box<RecordTap>, Ends) {
    let settings = shared.scene.settings();
    let (start_in, start) = rtrb::RingBuffer::new(1);
    let (ticks_in, ticks) = rtrb::RingBuffer::new(WAITING_TICKS);
    let (frames_in, frames) = rtrb::RingBuffer::new(WAITING_FRAMES);
    let (mut empty_frames, empty_out) = rtrb::RingBuffer::new(WAITING_FRAMES);
    while empty_frames.push(Box::new(Frame::with_room(&shared.body, &settings))).is_ok() {}
    let tap = RecordTap {
        start: start_in,
        room: Some(Box::new(Snapshot::with_room(&shared.body, &settings))),
        ticks: ticks_in,
        frames: frames_in,
        empty_frames: empty_out,
    };
    // The simulation thread writes into it. Where the system refuses, the server has said so at its start.
    scheduling::lock_memory();
    (Box::new(tap), Ends { start, ticks, frames, empty_frames })
}

/// Writes until the tap is dropped and its rings are empty, or until something goes wrong.
fn write(shared: &Shared, mut writer: RecordingWriter, mut ends: Ends, of: &Running) {
    let (tools, path) = (shared.scene.tool.len(), writer.status().path);
    tracing::info!(path, "recording");
    let mut flushed = Instant::now();
    let written = loop {
        // Abandonment is asked for first: what was pushed before it is then certainly in the ring.
        let over = ends.ticks.is_abandoned();
        let round = round(&mut writer, &mut ends, tools);
        let idle = match round {
            Ok(idle) => idle,
            Err(e) => break Err(e.to_string()),
        };
        if flushed.elapsed() > FLUSH {
            if let Err(e) = writer.flush() {
                break Err(e.to_string());
            }
            flushed = Instant::now();
            let status = writer.status();
            *lock(&of.status) = status;
        }
        match (over && idle, of.wanted_to_end.load(Ordering::Relaxed)) {
            (true, true) => break Ok(()),
            (true, false) => {
                break Err("the disk was too slow: ticks were lost, and the recording ends before them".into());
            }
            _ if idle => std::thread::sleep(Duration::from_millis(5)),
            _ => {}
        }
    };
    let mut status = writer.status();
    let written = written.inspect_err(|why| {
        let _ = shared.command(Command::StopRecording);
        // Where the disk takes nothing any more, the missing end says it.
        let _ = writer.end_early(why);
    });
    let written = match (written, writer.finish()) {
        (Err(why), _) => Err(why),
        (Ok(()), Err(e)) => Err(e.to_string()),
        (Ok(()), Ok(done)) => {
            status = done;
            Ok(())
        }
    };
    match written {
        Ok(()) => tracing::info!(path, ticks = status.ticks, bytes = status.bytes, "recorded"),
        Err(why) => {
            shared.health.report(Weight::Degrades, format!("the recording {path} ended early: {why}"));
            status.fault = why;
        }
    }
    *lock(&of.status) = status;
}

/// Writes what has come; true when nothing had.
fn round(
    writer: &mut RecordingWriter,
    ends: &mut Ends,
    tools: usize,
) -> Result<bool, crate::recording::RecordingError> {
    let mut idle = true;
    while let Ok(tick) = ends.ticks.pop() {
        idle = false;
        writer.tick(tick.tick, &tick.inputs, &tick.tools[..tools], tick.flags, tick.hash)?;
    }
    while let Ok(frame) = ends.frames.pop() {
        writer.frame(&frame)?;
        let _ = ends.empty_frames.push(frame);
    }
    Ok(idle)
}

/// Says that the running recording, if there is one, is wanted to end: to be called before its tap is told.
pub(super) fn expect_end(shared: &Shared) {
    if let Some(running) = lock(&shared.recorder.newest).as_ref() {
        running.wanted_to_end.store(true, Ordering::Relaxed);
    }
}

/// Waits for at most `limit` until the running recording, whose tap has been told to stop, is on disk. `None`: none runs, nor
/// has one run that nobody has been told of.
pub(super) async fn finish(shared: &Arc<Shared>, limit: Duration) -> Option<proto::RecordingStatus> {
    let running = lock(&shared.recorder.newest).clone()?;
    let mut done = running.done.clone();
    let ended = tokio::time::timeout(limit, done.wait_for(|done| *done)).await;
    let mut status = lock(&running.status).clone();
    let fault = match ended {
        Ok(Ok(_)) => "",
        Ok(Err(_)) => "the recorder died",
        Err(_) => "the disk does not answer: what it has not taken yet may be lost",
    };
    if ended.is_ok() {
        lock(&shared.recorder.newest).take_if(|newest| Arc::ptr_eq(&newest.status, &running.status));
    }
    if !fault.is_empty() {
        shared.health.report(Weight::Degrades, format!("the recording {}: {fault}", status.path));
        status.fault = fault.into();
    }
    Some(status)
}
