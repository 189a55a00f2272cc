//! Writes a recording; runs on a thread of its own and never on the simulation's.

use super::{FORMAT, RecordingError};
use crate::scene::Scene;
use crate::wire;
use crate::wire::surface::SurfaceEncoder;
use mcap::records::MessageHeader;
use palpate_core::contact::tool::Phase;
use palpate_core::model::{Body, State};
use palpate_core::simulation::{Frame, Inputs, Snapshot, TICK, TickFlags, ToolOutput};
use palpate_proto::keys::topics;
use palpate_proto::{self as proto, Message};
use std::collections::BTreeMap;
use std::fs::File;
use std::io::BufWriter;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// A recording being written.
pub struct RecordingWriter {
    path: PathBuf,
    /// The file once more, to ask how full its disk is.
    disk: File,
    mcap: mcap::Writer<BufWriter<File>>,
    channels: BTreeMap<&'static str, u16>,
    wrenches: Vec<u64>,
    first_tick: u64,
    ticks: u64,
    surface: SurfaceEncoder,
}

/// Room on the disk [bytes] that a recording leaves to others. Below, what a recording adds until it is asked about again (half
/// a second, some MB) may fill the disk; above, small disks record nothing.
const LEAST_FREE: u64 = 64_000_000;

/// What frames of a recording call its only surface.
const TOPOLOGY: u32 = 1;

impl RecordingWriter {
    /// Creates the file, which must not be there yet, and writes how the run starts: `start` is the state before the first recorded tick, at the end
    /// of a frame; `reset` what a reset returns to.
    ///
    /// # Errors
    /// Those of the file system, and when the surface to look at is far from the body.
    pub fn create(
        path: &Path,
        scene: &Scene,
        body: &Body,
        start: &Snapshot,
        reset: &State,
    ) -> Result<Self, RecordingError> {
        let io = |source| RecordingError::Io { path: path.display().to_string(), source };
        // A new file alone, which also follows no link.
        let file = File::options().write(true).create_new(true).open(path).map_err(io)?;
        let disk = file.try_clone().map_err(io)?;
        // Chunks of a few hundred ticks: what a failing disk may cost.
        let options = mcap::WriteOptions::new()
            .compression(Some(mcap::Compression::Lz4))
            .chunk_size(Some(256 * 1024))
            .library(format!("palpate {}", env!("CARGO_PKG_VERSION")));
        let mut mcap = options.create(BufWriter::new(file)).map_err(|e| fault(path, e))?;
        let mut channels = BTreeMap::new();
        for (topic, message) in [
            (topics::START, "RecordingStart"),
            (topics::INPUTS, "TickInputs"),
            (topics::WRENCH, "ToolWrench"),
            (topics::HASH, "StateHash"),
            (topics::TOPOLOGY, "SurfaceTopology"),
            (topics::PICTURE, "SurfacePicture"),
            (topics::SURFACE, "SurfaceFrame"),
            (topics::END, "RecordingEnd"),
        ] {
            let schema = mcap
                .add_schema(&proto::schema_name(message), "protobuf", proto::DESCRIPTOR_SET)
                .map_err(|e| fault(path, e))?;
            let channel = mcap.add_channel(schema, topic, "protobuf", &BTreeMap::new()).map_err(|e| fault(path, e))?;
            channels.insert(topic, channel);
        }
        let shown = scene.display(body);
        let shown = shown.map_err(|what| RecordingError::Content { path: path.display().to_string(), what })?;
        let display = Arc::new(shown);
        let mut writer = Self {
            path: path.to_owned(),
            disk,
            mcap,
            channels,
            wrenches: vec![0; start.tools.len()],
            first_tick: start.tick + 1,
            ticks: 0,
            surface: SurfaceEncoder::new(display.clone(), TOPOLOGY),
        };
        let content =
            |e: postcard::Error| RecordingError::Content { path: path.display().to_string(), what: e.to_string() };
        let opening = proto::RecordingStart {
            format: FORMAT,
            palpate_version: env!("CARGO_PKG_VERSION").into(),
            scene_toml: scene.to_toml(),
            body: body.bytes().to_vec(),
            body_checksum: body.checksum(),
            state: postcard::to_stdvec(start).map_err(content)?,
            reset_state: postcard::to_stdvec(reset).map_err(content)?,
            first_tick: writer.first_tick,
            session: Some(wire::session::describe(scene, body)),
        };
        writer.message(topics::START, start.tick, &opening)?;
        for part in wire::surface::topology(body, &display, TOPOLOGY) {
            writer.message(topics::TOPOLOGY, start.tick, &part)?;
        }
        for part in wire::surface::pictures(&display, TOPOLOGY) {
            writer.message(topics::PICTURE, start.tick, &part)?;
        }
        writer.flush()?;
        Ok(writer)
    }

    /// Adds a tick: what it consumed and what each tool felt; at a frame the state's hash.
    ///
    /// # Errors
    /// Those of the file system.
    pub fn tick(
        &mut self,
        tick: u64,
        inputs: &Inputs,
        tools: &[ToolOutput],
        flags: TickFlags,
        hash: Option<u64>,
    ) -> Result<(), RecordingError> {
        self.message(topics::INPUTS, tick, &wire::inputs_to_message(tick, inputs))?;
        for (i, tool) in tools.iter().enumerate() {
            if tool.state.phase != Phase::Detached {
                self.wrenches[i] += 1;
                let wrench = wire::wrench(i as u32, tick, self.wrenches[i], tool, flags);
                self.message(topics::WRENCH, tick, &wrench)?;
            }
        }
        if let Some(hash) = hash {
            self.message(topics::HASH, tick, &proto::StateHash { tick, hash })?;
        }
        self.ticks += 1;
        Ok(())
    }

    /// Adds what is shown of a tick.
    ///
    /// # Errors
    /// Those of the file system, or when there is no memory.
    pub fn frame(&mut self, frame: &Frame) -> Result<(), RecordingError> {
        let tick = frame.tick;
        let parts = self.surface.frame(frame).map_err(|e| RecordingError::Content {
            path: self.path.display().to_string(),
            what: format!("the surface of tick {tick}: {e}"),
        })?;
        parts.iter().try_for_each(|part| self.message(topics::SURFACE, tick, part))
    }

    fn message(&mut self, topic: &'static str, tick: u64, message: &impl Message) -> Result<(), RecordingError> {
        let time = tick * (TICK * 1e9) as u64;
        let header = MessageHeader {
            channel_id: self.channels[topic],
            sequence: tick as u32,
            log_time: time,
            publish_time: time,
        };
        self.mcap.write_to_known_channel(&header, &message.encode_to_vec()).map_err(|e| fault(&self.path, e))
    }

    /// Hands all that has been added to the system: it is there when this process is killed.
    ///
    /// # Errors
    /// Those of the file system, and when hardly any room is left on it: a full disk stops others, too.
    pub fn flush(&mut self) -> Result<(), RecordingError> {
        self.mcap.flush().map_err(|e| fault(&self.path, e))?;
        let path = || self.path.display().to_string();
        let disk = rustix::fs::fstatvfs(&self.disk)
            .map_err(|source| RecordingError::Io { path: path(), source: source.into() })?;
        let free = disk.f_bavail.saturating_mul(disk.f_frsize);
        if free < LEAST_FREE {
            let what = format!("the disk is nearly full: {} MB are free", free / 1_000_000);
            return Err(RecordingError::Content { path: path(), what });
        }
        Ok(())
    }

    /// Marks that the recording ends early, and why.
    ///
    /// # Errors
    /// Those of the file system.
    pub fn end_early(&mut self, why: &str) -> Result<(), RecordingError> {
        let tick = (self.first_tick + self.ticks).saturating_sub(1);
        self.message(topics::END, tick, &proto::RecordingEnd { fault: why.to_owned() })
    }

    /// Where the recording stands.
    pub fn status(&self) -> proto::RecordingStatus {
        proto::RecordingStatus {
            path: self.path.display().to_string(),
            first_tick: self.first_tick,
            ticks: self.ticks,
            bytes: std::fs::metadata(&self.path).map_or(0, |m| m.len()),
            fault: String::new(),
        }
    }

    /// Writes the index and closes the file.
    ///
    /// # Errors
    /// Those of the file system.
    pub fn finish(mut self) -> Result<proto::RecordingStatus, RecordingError> {
        self.mcap.finish().map_err(|e| fault(&self.path, e))?;
        Ok(self.status())
    }
}

fn fault(path: &Path, source: mcap::McapError) -> RecordingError {
    let path = path.display().to_string();
    match source {
        mcap::McapError::Io(source) => RecordingError::Io { path, source },
        source => RecordingError::Mcap { path, source },
    }
}
