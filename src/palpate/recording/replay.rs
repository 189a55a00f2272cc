//! Runs a recording again, as fast as it goes, and compares bit for bit.

use super::{FORMAT, RecordingError};
use crate::display::Display;
use crate::scene::{self, Scene};
use crate::wire;
use mcap::sans_io::LinearReaderOptions;
use palpate_core::math::Real;
use palpate_core::model::element_kernel::Simd;
use palpate_core::model::{Body, State};
use palpate_core::simulation::{Frame, Inputs, Simulation, Snapshot, TICK};
use palpate_proto::keys::topics;
use palpate_proto::{self as proto, Message};
use std::collections::BTreeMap;
use std::path::Path;
use std::sync::Arc;

/// What a byte of LZ4 can stand for at most [B].
const LZ4_EXPANSION: usize = 255;

/// A recording read back.
pub struct Recording {
    /// The scene, every default written out.
    pub scene: Scene,
    /// The body.
    pub body: Arc<Body>,
    /// The state before the first recorded tick.
    pub start: Snapshot,
    /// What a reset returns to.
    pub reset: State,
    /// What each tick consumed, ascending, without a gap.
    pub inputs: Vec<(u64, Inputs)>,
    /// Hash of the state at frames, by tick.
    pub hashes: BTreeMap<u64, u64>,
    /// Wrenches, by tick and tool.
    pub wrenches: BTreeMap<(u64, u32), proto::ToolWrench>,
    /// What was shown, and how it hangs on what was touched.
    pub display: Display,
    /// Surfaces in parts, by tick.
    pub frames: BTreeMap<u64, Vec<proto::SurfaceFrame>>,
    /// Why it ends early, when it does: its writer said so, or was killed, or the file is cut.
    pub cut: Option<String>,
}

impl Recording {
    /// Reads the recording at `path`. A file cut short gives what is whole before the cut.
    ///
    /// # Errors
    /// When it is no recording, or is cut before its start is whole.
    pub fn read(path: &Path) -> Result<Self, RecordingError> {
        let name = path.display().to_string();
        let bytes = std::fs::read(path).map_err(|source| RecordingError::Io { path: name.clone(), source })?;
        Self::from_bytes(&bytes, &name)
    }

    /// The recording in `bytes`, which errors call `name`. Bytes are not trusted.
    ///
    /// # Errors
    /// As [`Recording::read`].
    pub fn from_bytes(bytes: &[u8], name: &str) -> Result<Self, RecordingError> {
        let content = |what: String| RecordingError::Content { path: name.to_owned(), what };
        // Without the end-of-file magic a cut file still gives its messages up to the cut; checksums are not checked unless asked for.
        // A record that claims to be longer than these bytes can hold is damaged: it gets no room.
        let options = LinearReaderOptions::default()
            .with_skip_end_magic(true)
            .with_validate_chunk_crcs(true)
            .with_record_length_limit(bytes.len().saturating_mul(LZ4_EXPANSION));
        let stream = mcap::io::MessageReader::new_with_options(bytes, options);
        let mut start = None;
        let (mut inputs, mut hashes) = (Vec::<(u64, Inputs)>::new(), BTreeMap::new());
        let (mut wrenches, mut frames) = (BTreeMap::new(), BTreeMap::<u64, Vec<_>>::new());
        let (mut rest, mut triangles) = (Vec::new(), Vec::new());
        let mut cut = None;
        for message in stream {
            let message = match message {
                Ok(message) => message,
                Err(e) => {
                    cut = Some(e.to_string());
                    break;
                }
            };
            let broken =
                |e: prost::DecodeError| content(format!("a message of {} is damaged: {e}", message.channel.topic));
            let data = &message.data[..];
            match message.channel.topic.as_str() {
                topics::START => start = Some(proto::RecordingStart::decode(data).map_err(broken)?),
                topics::INPUTS => {
                    let message = proto::TickInputs::decode(data).map_err(broken)?;
                    let tick_inputs = wire::inputs_from_message(&message)
                        .ok_or_else(|| content(format!("the inputs of tick {} contradict the format", message.tick)))?;
                    inputs.push((message.tick, tick_inputs));
                }
                topics::HASH => {
                    let hash = proto::StateHash::decode(data).map_err(broken)?;
                    hashes.insert(hash.tick, hash.hash);
                }
                topics::WRENCH => {
                    let wrench = proto::ToolWrench::decode(data).map_err(broken)?;
                    wrenches.insert((wrench.tick, wrench.tool), wrench);
                }
                topics::TOPOLOGY => {
                    let part = proto::SurfaceTopology::decode(data).map_err(broken)?;
                    rest.extend(triples(&part.rest_positions, f32::from_le_bytes));
                    triangles.extend(triples(&part.triangles, u32::from_le_bytes));
                }
                topics::SURFACE => {
                    let frame = proto::SurfaceFrame::decode(data).map_err(broken)?;
                    frames.entry(frame.tick).or_default().push(frame);
                }
                topics::END => cut = Some(proto::RecordingEnd::decode(data).map_err(broken)?.fault),
                _ => {}
            }
        }
        if cut.is_none() && !bytes.ends_with(mcap::MAGIC) {
            cut = Some("it has no end: its writer was killed, or the file was cut".into());
        }
        let start = start.ok_or_else(|| match &cut {
            Some(cut) => content(format!("cut before the recording's start is whole ({cut})")),
            None => content("no recording of palpate: it has no message on palpate/start".into()),
        })?;
        if start.format != FORMAT {
            return Err(content(format!(
                "recorded in format {} by palpate {}; this is palpate {} with format {FORMAT}",
                start.format,
                start.palpate_version,
                env!("CARGO_PKG_VERSION")
            )));
        }
        let scene = scene::parse(&start.scene_toml, &format!("scene of {name}")).map_err(|e| content(e.to_string()))?;
        let body = Body::from_bytes(&start.body).map_err(|e| content(e.to_string()))?;
        if body.checksum() != start.body_checksum {
            return Err(content("the body is not the one that was recorded: its checksum differs".into()));
        }
        let damaged = |e: postcard::Error| content(format!("the starting state is damaged: {e}"));
        let snapshot = postcard::from_bytes(&start.state).map_err(damaged)?;
        let reset: State = postcard::from_bytes(&start.reset_state).map_err(damaged)?;
        let mut last = start.first_tick.saturating_sub(1);
        for (tick, inputs) in &inputs {
            if *tick != last + 1 + u64::from(inputs.lapsed) {
                return Err(content(format!("tick {tick} does not follow tick {last}: the recording has a hole")));
            }
            last = *tick;
        }
        if triangles.iter().flatten().any(|v| *v as usize >= rest.len()) {
            return Err(content("the surface that it shows is damaged".into()));
        }
        let (display, body) = (Display::recorded(&body, rest, triangles), Arc::new(body));
        Ok(Self { scene, body, start: snapshot, reset, inputs, hashes, wrenches, display, frames, cut })
    }
}

/// `bytes` as triples of little-endian numbers of four bytes.
fn triples<T: Copy>(bytes: &[u8], number: impl Fn([u8; 4]) -> T) -> Vec<[T; 3]> {
    let numbers: Vec<T> = bytes.as_chunks().0.iter().map(|bytes| number(*bytes)).collect();
    numbers.as_chunks().0.to_vec()
}

/// What a replay found.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ReplayReport {
    /// Ticks run again.
    pub ticks: u64,
    /// State hashes that were compared and agreed.
    pub hashes: u64,
    /// Wrenches that were compared and agreed.
    pub wrenches: u64,
    /// The first difference.
    pub difference: Option<Difference>,
    /// Wall-clock time [s].
    pub wall_seconds: Real,
}

/// Where a replay first leaves the recording.
#[derive(Clone, Debug, PartialEq)]
pub struct Difference {
    /// The tick.
    pub tick: u64,
    /// What differs, and by how much.
    pub what: String,
}

impl ReplayReport {
    /// One line for people.
    pub fn verdict(&self) -> String {
        let speed = self.ticks as Real * TICK / self.wall_seconds.max(1e-9);
        match &self.difference {
            None => format!(
                "identical: {} ticks, {} state hashes, {} wrenches ({speed:.1} times real time)",
                self.ticks, self.hashes, self.wrenches
            ),
            Some(d) => format!("differs at tick {}: {}", d.tick, d.what),
        }
    }
}

/// Runs the recording again on kernel path `path`, up to its end or the first difference.
///
/// # Errors
/// When its state does not fit its body.
pub fn replay(recording: &Recording, path: Simd) -> Result<ReplayReport, String> {
    let started = std::time::Instant::now();
    let settings = recording.scene.settings();
    let mut simulation = Simulation::new(recording.body.clone(), settings, recording.start.clone())?
        .with_reset_state(&recording.reset)?
        .with_path(path);
    let mut report = ReplayReport::default();
    for (tick, inputs) in &recording.inputs {
        let outputs = simulation.advance(inputs);
        report.ticks += 1;
        debug_assert_eq!(outputs.tick, *tick);
        let flags = outputs.flags();
        for (i, output) in outputs.tools.iter().enumerate() {
            let Some(recorded) = recording.wrenches.get(&(*tick, i as u32)) else { continue };
            let again = wire::wrench(i as u32, *tick, recorded.sequence, output, flags);
            if again != *recorded {
                report.difference = Some(Difference { tick: *tick, what: wrench_difference(i, recorded, &again) });
                report.wall_seconds = started.elapsed().as_secs_f64();
                return Ok(report);
            }
            report.wrenches += 1;
        }
        if let Some(recorded) = recording.hashes.get(tick) {
            if outputs.hash != *recorded {
                let what = match farthest(recording, &outputs.into()) {
                    Some(moved) => format!("state hash; the surface is at most {moved:e} m from the recorded one"),
                    None => "state hash".into(),
                };
                report.difference = Some(Difference { tick: *tick, what });
                break;
            }
            report.hashes += 1;
        }
    }
    report.wall_seconds = started.elapsed().as_secs_f64();
    Ok(report)
}

fn wrench_difference(tool: usize, recorded: &proto::ToolWrench, again: &proto::ToolWrench) -> String {
    let apart = |a: &[f32], b: &[f32]| -> f64 {
        a.iter().zip(b).map(|(a, b)| f64::from(a - b) * f64::from(a - b)).sum::<f64>().sqrt()
    };
    format!(
        "wrench of tool {tool}: physical force by {:e} N, rendered force by {:e} N, pose by {:e} m, phase {} for {}",
        apart(&recorded.physical_force, &again.physical_force),
        apart(&recorded.force, &again.force),
        apart(&recorded.position, &again.position),
        again.phase,
        recorded.phase
    )
}

/// Largest distance [m] of what is shown in a frame from the recorded vertices of its tick, where their frame and its key frame are whole.
fn farthest(recording: &Recording, now: &Frame) -> Option<Real> {
    let frame = recording.frames.get(&now.tick)?;
    let key = frame.first()?.key;
    let key = recording.frames.values().find(|parts| parts.first().is_some_and(|part| part.sequence == key))?;
    let recorded = wire::surface::vertices(&recording.display, key, frame)?;
    Some(
        recorded
            .iter()
            .zip(wire::surface::shown(&recording.display, now).iter())
            .map(|(a, b)| (a - b).norm())
            .fold(0.0, Real::max),
    )
}
