//! A prepared body in one file, `.palpate`: levels, ties, display surface and calibration, and where they come from.
//!
//! | bytes | hold |
//! |---|---|
//! | 8 | `palpate` and a zero byte |
//! | 4 | version of the format, u32, little-endian like all that follows |
//! | 8 | length of the rest, u64 |
//! | 8 | xxh3-64 of the rest |
//! | rest | [`Provenance`] (postcard), then [`Body::bytes`] |
//!
//! The same input gives the same bytes: no date, no folder, no machine stands in them.

use palpate_core::model::body::{Body, BodyError};
use serde::{Deserialize, Serialize};
use std::io::Read;
use std::path::Path;
use xxhash_rust::xxh3::xxh3_64;

/// Extension of such files.
pub const EXTENSION: &str = "palpate";
const MAGIC: &[u8; 8] = b"palpate\0";
/// Changes when the bytes of [`Provenance`] or of a body mean something else.
const VERSION: u32 = 10;
const HEADER: usize = 28;
/// Longest file read [bytes]: some ten million elements.
const MAX_FILE: usize = 1 << 30;

/// Where a body comes from.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Provenance {
    /// Version of palpate that made it.
    pub palpate: String,
    /// The files that it was made of, without their folders.
    pub inputs: Vec<InputFile>,
    /// How they were read and what was asked for, as on the command line.
    pub options: String,
    /// The scene that it was made for (TOML): its material and what holds it are those of the body.
    pub scene: String,
}

/// A file that a body was made of.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct InputFile {
    /// Its name, without folders.
    pub name: String,
    /// xxh3-64 of its bytes.
    pub checksum: u64,
}

/// A body and where it comes from.
#[derive(Debug)]
pub struct BodyFile {
    /// Where it comes from.
    pub provenance: Provenance,
    /// The body.
    pub body: Body,
}

/// Why a file is not a prepared body.
#[derive(Debug, thiserror::Error)]
pub enum BodyFileError {
    /// The file system said no.
    #[error(transparent)]
    Io(#[from] std::io::Error),
    /// Other first bytes.
    #[error("not a prepared body: it does not start as one; make one from a mesh with `palpate prepare`")]
    Foreign,
    /// Of another version of the format.
    #[error(
        "a prepared body of format {found}, this palpate reads format {VERSION}: {}",
        if *found > VERSION { "update palpate, or prepare the body again with this one" } else { "prepare it again" }
    )]
    OtherVersion {
        /// Format of the file.
        found: u32,
    },
    /// Fewer or more bytes than its header says.
    #[error(
        "{found} bytes, of which its header announces {announced}: the file was cut off or added to; copy it again"
    )]
    Length {
        /// Bytes there.
        found: usize,
        /// Bytes that there should be.
        announced: u64,
    },
    /// Changed bytes.
    #[error("damaged: its checksum does not match its content; copy it again, or prepare the body again")]
    Damaged,
    /// Larger than any body that runs.
    #[error("larger than {} MiB: prepare the body with a coarser finest level", MAX_FILE >> 20)]
    TooBig,
    /// Content that contradicts itself.
    #[error(transparent)]
    Body(#[from] BodyError),
}

impl BodyFile {
    /// The file's bytes.
    pub fn bytes(&self) -> Vec<u8> {
        // Strings and numbers always have their bytes.
        let mut rest = postcard::to_stdvec(&self.provenance).unwrap_or_default();
        rest.extend_from_slice(self.body.bytes());
        let mut bytes = Vec::with_capacity(HEADER + rest.len());
        bytes.extend_from_slice(MAGIC);
        bytes.extend_from_slice(&VERSION.to_le_bytes());
        bytes.extend_from_slice(&(rest.len() as u64).to_le_bytes());
        bytes.extend_from_slice(&xxh3_64(&rest).to_le_bytes());
        bytes.extend_from_slice(&rest);
        bytes
    }

    /// Reads back what [`BodyFile::bytes`] gave. Bytes are not trusted: whatever they say, the answer is a body that can
    /// be stepped or an error, in memory proportional to their number.
    ///
    /// # Errors
    /// When the bytes are foreign, of another version, cut, damaged or inconsistent.
    pub fn from_bytes(bytes: &[u8]) -> Result<Self, BodyFileError> {
        let (provenance, body) = content(bytes)?;
        Ok(Self { provenance, body: Body::from_bytes(body)? })
    }

    /// Reads the file at `path`.
    ///
    /// # Errors
    /// As [`BodyFile::from_bytes`], and those of the file system.
    pub fn read(path: &Path) -> Result<Self, BodyFileError> {
        Self::from_bytes(&read_bytes(path)?)
    }
}

impl Provenance {
    /// The provenance in the file at `path`, whose body is not looked at.
    ///
    /// # Errors
    /// As [`BodyFile::read`].
    pub fn read(path: &Path) -> Result<Self, BodyFileError> {
        Ok(content(&read_bytes(path)?)?.0)
    }
}

fn read_bytes(path: &Path) -> Result<Vec<u8>, BodyFileError> {
    let mut bytes = Vec::new();
    std::fs::File::open(path)?.take(MAX_FILE as u64 + 1).read_to_end(&mut bytes)?;
    if bytes.len() > MAX_FILE { Err(BodyFileError::TooBig) } else { Ok(bytes) }
}

/// The provenance in `bytes` and the bytes of the body.
fn content(bytes: &[u8]) -> Result<(Provenance, &[u8]), BodyFileError> {
    let header = bytes.strip_prefix(MAGIC).ok_or(BodyFileError::Foreign)?;
    let cut = BodyFileError::Length { found: bytes.len(), announced: HEADER as u64 };
    let Some((version, header)) = header.split_first_chunk::<4>() else { return Err(cut) };
    let found = u32::from_le_bytes(*version);
    if found != VERSION {
        return Err(BodyFileError::OtherVersion { found });
    }
    let Some((length, header)) = header.split_first_chunk::<8>() else { return Err(cut) };
    let Some((checksum, rest)) = header.split_first_chunk::<8>() else { return Err(cut) };
    let length = u64::from_le_bytes(*length);
    if rest.len() as u64 != length {
        return Err(BodyFileError::Length { found: bytes.len(), announced: length.saturating_add(HEADER as u64) });
    }
    if xxh3_64(rest) != u64::from_le_bytes(*checksum) {
        return Err(BodyFileError::Damaged);
    }
    postcard::take_from_bytes(rest).map_err(|_| BodyFileError::Damaged)
}
