//! A recording (MCAP): an index of its frames in memory, the frames themselves read when they are asked for.

use super::{Moment, SourceError, Subject, forces};
use mcap::records::Record;
use mcap::sans_io::linear_reader::{LinearReadEvent, LinearReader, LinearReaderOptions};
use palpate_sdk::proto::{Message, RecordingStart, SurfaceFrame, SurfacePicture, SurfaceTopology, keys::topics};
use palpate_sdk::{Picture, SdkError, Surface, SurfaceDecoder};
use std::collections::{BTreeMap, VecDeque};
use std::fs::File;
use std::io::{Read, Seek, SeekFrom};
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// A record that claims to be longer than this [B] is damaged.
const LARGEST_RECORD: usize = 1 << 30;
/// What a byte of LZ4 can stand for at most [B].
const LZ4_EXPANSION: usize = 255;
/// Bytes of the magic at the start of a file.
const MAGIC: u64 = 8;
/// Bytes of a record's opcode and length.
const RECORD_HEAD: u64 = 9;

/// An open recording.
pub struct Recording {
    path: PathBuf,
    file: File,
    subject: Arc<Subject>,
    /// By channel number.
    topics: BTreeMap<u16, String>,
    chunks: Vec<Chunk>,
    frames: Vec<Frame>,
    /// The two chunks that were read last, by number, with their moments: what lies between two frames may need both.
    read: VecDeque<(usize, Vec<Moment>)>,
    cut: Option<String>,
}

/// A chunk: opcode, where its content lies in the file [B], which frames begin in it, and which is the key frame of the
/// first of them.
struct Chunk {
    opcode: u8,
    content: Range<u64>,
    frames: Range<usize>,
    key: usize,
}

/// What the time line shows of a frame.
#[derive(Clone, Debug, PartialEq)]
pub struct Frame {
    /// Simulated time [ms].
    pub tick: u64,
    /// (tools) rendered force [N] by the tool's number; shorter where the last ones are not held.
    pub forces: Vec<f32>,
}

impl Recording {
    /// Opens the recording at `path` and finds its frames. A file cut short gives what is whole before the cut.
    ///
    /// # Errors
    /// When it is no recording, has no frame, or is cut before the first one.
    pub fn open(path: &Path) -> Result<Self, SourceError> {
        let io = |source| SourceError::Io { path: path.to_owned(), source };
        let content = |what: String| SourceError::Content { path: path.to_owned(), what };
        let mut file = File::open(path).map_err(io)?;
        let mut index = Index::default();
        let cut = index.fill(&mut file).map_err(|fault| match fault {
            Fault::Io(source) => io(source),
            Fault::Content(what) => content(what),
        })?;
        let because = cut.as_ref().map_or(String::new(), |cut| format!(" ({cut})"));
        let start = index.start.take().ok_or_else(|| {
            content(format!("no recording of palpate: it has no whole message on {}{because}", topics::START))
        })?;
        let surface = Surface::from_parts(std::mem::take(&mut index.surface));
        let surface = surface.map_err(|e| content(format!("{e}{because}")))?;
        let pictures = Picture::from_parts(std::mem::take(&mut index.pictures), surface.topology);
        let pictures = pictures.map_err(|e| content(format!("{e}{because}")))?;
        index.drop_unfinished_frame(surface.parts());
        if index.frames.is_empty() {
            return Err(content(format!("it has no surface frame{because}: record for longer than 32 ms")));
        }
        let made_by = format!("palpate {}", start.palpate_version);
        let subject = Subject::new(start.session.unwrap_or_default(), surface.into(), &pictures, made_by)?;
        Ok(Self {
            path: path.to_owned(),
            file,
            subject: Arc::new(subject),
            topics: index.topics,
            chunks: index.chunks,
            frames: index.frames,
            read: VecDeque::new(),
            cut,
        })
    }

    /// What was recorded.
    pub fn subject(&self) -> &Arc<Subject> {
        &self.subject
    }

    /// Ascending by tick, at least one.
    pub fn frames(&self) -> &[Frame] {
        &self.frames
    }

    /// Why reading ended before the end of the file, when it did.
    pub fn cut(&self) -> Option<&str> {
        self.cut.as_deref()
    }

    /// Simulated time from the first frame to the last [s].
    pub fn duration(&self) -> f64 {
        (self.frames[self.frames.len() - 1].tick - self.frames[0].tick) as f64 * super::TICK
    }

    /// The moment `seconds` after the first frame, between two frames where it falls between them; the first or the last
    /// frame beyond the ends.
    ///
    /// # Errors
    /// When the file has changed since it was opened, or a frame does not fit the surface.
    pub fn at(&mut self, seconds: f64) -> Result<Moment, SourceError> {
        let first = self.frames[0].tick as f64;
        let tick = (first + seconds.max(0.0) / super::TICK).min(self.frames[self.frames.len() - 1].tick as f64);
        let after = self.frames.partition_point(|frame| (frame.tick as f64) < tick);
        let moment = self.frame(after)?;
        if after == 0 || moment.tick as f64 == tick {
            return Ok(moment);
        }
        let before = self.frame(after - 1)?;
        let t = (tick - before.tick as f64) / (moment.tick - before.tick) as f64;
        Ok(before.towards(&moment, t as f32))
    }

    /// The moment of frame `number`.
    fn frame(&mut self, number: usize) -> Result<Moment, SourceError> {
        let chunk = self.chunks.partition_point(|chunk| chunk.frames.end <= number);
        if !self.read.iter().any(|(read, _)| *read == chunk) {
            let moments = self.moments(chunk)?;
            self.read.truncate(1);
            self.read.push_front((chunk, moments));
        }
        let moments = self.read.iter().find(|(read, _)| *read == chunk).map(|(_, moments)| moments);
        let moment = moments.and_then(|moments| moments.get(number - self.chunks[chunk].frames.start));
        moment.cloned().ok_or_else(|| self.changed())
    }

    /// The moments of the frames that begin in chunk `number`.
    fn moments(&mut self, number: usize) -> Result<Vec<Moment>, SourceError> {
        let Chunk { frames: wanted, key, .. } = &self.chunks[number];
        let first = self.chunks.partition_point(|chunk| chunk.frames.end <= *key);
        let mut decoder = SurfaceDecoder::new(self.subject.surface.clone());
        let mut moments = Vec::new();
        // The last parts of the last frame may be in the next chunk that has any.
        for number in first..self.chunks.len() {
            if moments.len() == wanted.len() {
                break;
            }
            let Chunk { opcode, content, .. } = &self.chunks[number];
            let mut bytes = vec![0; (content.end - content.start) as usize];
            let io = |source| SourceError::Io { path: self.path.clone(), source };
            self.file.seek(SeekFrom::Start(content.start)).map_err(io)?;
            self.file.read_exact(&mut bytes).map_err(io)?;
            let mut fault = None;
            let mut topics = self.topics.clone();
            for_each_message(*opcode, &bytes, &mut topics, &mut |topic, data| {
                if topic != topics::SURFACE || fault.is_some() || moments.len() == wanted.len() {
                    return;
                }
                let Ok(frame) = SurfaceFrame::decode(data) else {
                    fault = Some(self.changed());
                    return;
                };
                match decoder.receive(&frame) {
                    Ok(Some(moment)) if moment.tick >= self.frames[wanted.start].tick => moments.push(moment.into()),
                    Ok(_) => {}
                    Err(e) => fault = Some(SdkError::from(e).into()),
                }
            })
            .map_err(|_| self.changed())?;
            if let Some(fault) = fault {
                return Err(fault);
            }
        }
        Ok(moments)
    }

    fn changed(&self) -> SourceError {
        SourceError::Content {
            path: self.path.clone(),
            what: "it has changed since it was opened: open it again".into(),
        }
    }
}

/// What a pass over a file finds.
#[derive(Default)]
struct Index {
    topics: BTreeMap<u16, String>,
    start: Option<RecordingStart>,
    surface: Vec<SurfaceTopology>,
    pictures: Vec<SurfacePicture>,
    chunks: Vec<Chunk>,
    frames: Vec<Frame>,
    /// (frames) number of each one's key frame.
    keys: Vec<usize>,
    /// Parts of frames so far, and those of the last frame.
    parts: usize,
    parts_of_last: usize,
}

enum Fault {
    Io(std::io::Error),
    Content(String),
}

impl Index {
    /// Reads `file` from its start; the reason where it had to stop before the end.
    fn fill(&mut self, file: &mut File) -> Result<Option<String>, Fault> {
        let length = file.metadata().map_err(Fault::Io)?.len();
        let options = LinearReaderOptions::default()
            .with_emit_chunks(true)
            .with_skip_end_magic(true)
            .with_record_length_limit(LARGEST_RECORD);
        let mut reader = LinearReader::new_with_options(options);
        let mut offset = MAGIC;
        while let Some(event) = reader.next_event() {
            match event {
                // What a damaged length asks for beyond the file is never there: do not make room for it.
                Ok(LinearReadEvent::ReadRequest(wanted)) => {
                    let room = wanted.min(length as usize + 1);
                    let count = file.read(reader.insert(room)).map_err(Fault::Io)?;
                    reader.notify_read(count);
                }
                Ok(LinearReadEvent::Record { opcode, data }) => {
                    let content = offset + RECORD_HEAD..offset + RECORD_HEAD + data.len() as u64;
                    offset = content.end;
                    if let Err(cut) = self.add(opcode, data, content)? {
                        return Ok(Some(cut));
                    }
                }
                Err(mcap::McapError::BadMagic) if offset == MAGIC => {
                    return Err(Fault::Content(
                        "no MCAP file; record one with `palpate demo --record FILE.mcap`".into(),
                    ));
                }
                Err(e) => return Ok(Some(e.to_string())),
            }
        }
        Ok(None)
    }

    /// Adds what is in one record of the file; `Ok(Err)` where nothing after it can be trusted.
    fn add(&mut self, opcode: u8, data: &[u8], content: Range<u64>) -> Result<Result<(), String>, Fault> {
        let (first, parts) = (self.frames.len(), self.parts);
        let mut topics = std::mem::take(&mut self.topics);
        let mut fault = None;
        let outcome = for_each_message(opcode, data, &mut topics, &mut |topic, data| {
            if fault.is_none()
                && let Err(what) = self.message(topic, data)
            {
                fault = Some(what);
            }
        });
        self.topics = topics;
        if let Some(what) = fault {
            return Err(Fault::Content(what));
        }
        if self.parts > parts {
            let key = self.keys.get(first).copied().unwrap_or(first);
            self.chunks.push(Chunk { opcode, content, frames: first..self.frames.len(), key });
        }
        Ok(outcome.map_err(|e| e.to_string()))
    }

    fn message(&mut self, topic: &str, data: &[u8]) -> Result<(), String> {
        let broken = |e: &dyn std::fmt::Display| format!("a message of {topic} is damaged: {e}");
        match topic {
            topics::START => self.start = Some(RecordingStart::decode(data).map_err(|e| broken(&e))?),
            topics::TOPOLOGY => {
                self.surface.push(SurfaceTopology::decode(data).map_err(|e| broken(&e))?);
            }
            topics::PICTURE => {
                self.pictures.push(SurfacePicture::decode(data).map_err(|e| broken(&e))?);
            }
            topics::SURFACE => {
                let frame = SurfaceFrame::decode(data).map_err(|e| broken(&e))?;
                self.parts += 1;
                let is_key = frame.key == frame.sequence;
                match self.frames.last() {
                    Some(last) if last.tick > frame.tick => {
                        return Err(format!("the frame of tick {} comes after a later one", frame.tick));
                    }
                    // A further part of it; tools are in the first.
                    Some(last) if last.tick == frame.tick => self.parts_of_last += 1,
                    // Frames before the first key frame are none.
                    None if !is_key => {}
                    _ => {
                        let own = self.frames.len();
                        self.keys.push(if is_key { own } else { self.keys.last().copied().unwrap_or(own) });
                        self.frames.push(Frame { tick: frame.tick, forces: forces(&frame.tools) });
                        self.parts_of_last = 1;
                    }
                }
            }
            _ => {}
        }
        Ok(())
    }

    /// Leaves out the last frame if fewer than its `parts` are there: the file was cut between them.
    fn drop_unfinished_frame(&mut self, parts: usize) {
        if self.parts_of_last < parts {
            self.frames.pop();
        }
        let frames = self.frames.len();
        for chunk in &mut self.chunks {
            chunk.frames = chunk.frames.start.min(frames)..chunk.frames.end.min(frames);
        }
    }
}

/// Calls `each` with topic and content of every message in a record of the file, chunk or not; learns channels on the way.
fn for_each_message(
    opcode: u8,
    content: &[u8],
    topics: &mut BTreeMap<u16, String>,
    each: &mut dyn FnMut(&str, &[u8]),
) -> mcap::McapResult<()> {
    // A chunk that claims to hold more than its bytes can is damaged: it gets no room.
    let most = content.len().saturating_mul(LZ4_EXPANSION).saturating_add(1 << 16);
    let options = LinearReaderOptions::default()
        .with_skip_start_magic(true)
        .with_skip_end_magic(true)
        .with_prevalidate_chunk_crcs(true)
        .with_record_length_limit(most);
    let mut reader = LinearReader::new_with_options(options);
    let head = [&[opcode][..], &(content.len() as u64).to_le_bytes()].concat();
    let mut rest = head.as_slice().chain(content);
    while let Some(event) = reader.next_event() {
        match event? {
            LinearReadEvent::ReadRequest(wanted) => {
                let count = rest.read(reader.insert(wanted.min(content.len() + head.len())))?;
                reader.notify_read(count);
            }
            LinearReadEvent::Record { opcode, data } => match mcap::parse_record(opcode, data)? {
                Record::Channel(channel) => {
                    topics.insert(channel.id, channel.topic);
                }
                Record::Message { header, data } => {
                    if let Some(topic) = topics.get(&header.channel_id) {
                        each(topic, &data);
                    }
                }
                _ => {}
            },
        }
    }
    Ok(())
}
