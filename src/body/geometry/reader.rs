//! Walks through a mesh file, text or binary.

use super::mesh_error::{MeshError, shown};
use palpate_core::math::Real;

/// Longest file read [bytes]; a surface that moves in real time needs a hundredth of it.
pub const MAX_FILE: usize = 128 << 20;

/// How numbers are written.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Encoding {
    Text,
    LittleEndian,
    BigEndian,
}

/// The type of a number in a binary file: how many bytes it has.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Number {
    Signed(u8),
    Unsigned(u8),
    Float(u8),
}

impl Number {
    /// Length in a binary file [bytes].
    pub(super) fn size(self) -> usize {
        let (Number::Signed(size) | Number::Unsigned(size) | Number::Float(size)) = self;
        size.into()
    }
}

/// Why `word` is no number.
pub(super) fn no_number(word: &[u8]) -> String {
    let word = String::from_utf8_lossy(word);
    if word.contains(',') && word.replacen(',', ".", 1).parse::<Real>().is_ok() {
        return format!("'{}' has a decimal comma: export the file with decimal points", shown(word.as_bytes()));
    }
    format!("'{}' is no number", shown(word.as_bytes()))
}

/// Walks through a mesh file. Counts in the file only bound loops that consume bytes: one that lies costs nothing.
pub(super) struct Reader<'a> {
    /// What errors call the file.
    pub format: &'static str,
    pub bytes: &'a [u8],
    /// First byte not yet read.
    pub at: usize,
    pub encoding: Encoding,
    /// What follows it on a line of text is no content.
    pub comment: Option<u8>,
}

impl<'a> Reader<'a> {
    /// At the beginning of a text.
    pub(super) fn text(format: &'static str, bytes: &'a [u8], comment: Option<u8>) -> Self {
        Self { format, bytes, at: 0, encoding: Encoding::Text, comment }
    }

    /// The error of what was found here, with its line, or its offset in a binary file.
    pub(super) fn wrong(&self, what: impl Into<String>) -> MeshError {
        let before = self.bytes.get(..self.at).unwrap_or_default();
        let text = self.encoding == Encoding::Text;
        let line = text.then(|| 1 + before.iter().filter(|&&b| b == b'\n').count());
        let place = if text { String::new() } else { format!(" (at byte {})", self.at) };
        MeshError::Syntax { format: self.format, line, what: what.into() + &place }
    }

    /// The rest of the file.
    pub(super) fn rest(&self) -> &'a [u8] {
        self.bytes.get(self.at..).unwrap_or_default()
    }

    /// Steps over white space and comments.
    pub(super) fn skip_space(&mut self) {
        loop {
            self.at += self.rest().len() - self.rest().trim_ascii_start().len();
            if self.comment.is_none() || self.rest().first().copied() != self.comment {
                return;
            }
            self.line();
        }
    }

    /// Up to the end of the line, without space around it; steps over the line break.
    pub(super) fn line(&mut self) -> &'a [u8] {
        let rest = self.rest();
        let length = rest.iter().position(|&b| b == b'\n').unwrap_or(rest.len());
        self.at += (length + 1).min(rest.len());
        rest[..length].trim_ascii()
    }

    /// The word that comes next, empty at the end of the file; stays before it.
    pub(super) fn peek(&mut self) -> &'a [u8] {
        self.skip_space();
        let rest = self.rest();
        let ends = |b: &u8| b.is_ascii_whitespace() || self.comment == Some(*b);
        &rest[..rest.iter().position(ends).unwrap_or(rest.len())]
    }

    /// The next word, as it stands.
    pub(super) fn name(&mut self) -> &'a [u8] {
        let word = self.peek();
        self.at += word.len();
        word
    }

    /// The next number of a text file, or a word of a header.
    pub(super) fn word<T: std::str::FromStr>(&mut self) -> Result<T, MeshError> {
        let word = self.peek();
        let value = std::str::from_utf8(word).ok().and_then(|w| w.parse().ok());
        let value = value.ok_or_else(|| match word {
            b"" => self.wrong("it ends where a number is expected: it was cut off"),
            _ => self.wrong(no_number(word)),
        })?;
        self.at += word.len();
        Ok(value)
    }

    /// The next `N` bytes of a binary file, least significant first.
    pub(super) fn raw<const N: usize>(&mut self) -> Result<[u8; N], MeshError> {
        let mut bytes = *self.rest().first_chunk::<N>().ok_or_else(|| self.wrong("the file was cut off"))?;
        self.at += N;
        if self.encoding == Encoding::BigEndian {
            bytes.reverse();
        }
        Ok(bytes)
    }

    /// The next number, of type `number` in a binary file; integers from 2⁵³ on are rounded.
    pub(super) fn number(&mut self, number: Number) -> Result<Real, MeshError> {
        if self.encoding == Encoding::Text {
            return self.word();
        }
        Ok(match number {
            Number::Signed(1) => i8::from_le_bytes(self.raw()?).into(),
            Number::Signed(2) => i16::from_le_bytes(self.raw()?).into(),
            Number::Signed(4) => i32::from_le_bytes(self.raw()?).into(),
            Number::Signed(_) => i64::from_le_bytes(self.raw()?) as Real,
            Number::Unsigned(1) => u8::from_le_bytes(self.raw()?).into(),
            Number::Unsigned(2) => u16::from_le_bytes(self.raw()?).into(),
            Number::Unsigned(4) => u32::from_le_bytes(self.raw()?).into(),
            Number::Unsigned(_) => u64::from_le_bytes(self.raw()?) as Real,
            Number::Float(4) => f32::from_le_bytes(self.raw()?).into(),
            Number::Float(_) => f64::from_le_bytes(self.raw()?),
        })
    }

    /// `count` numbers.
    pub(super) fn numbers(&mut self, number: Number, count: i64) -> Result<Vec<Real>, MeshError> {
        let mut numbers = Vec::new();
        for _ in 0..count {
            numbers.push(self.number(number)?);
        }
        Ok(numbers)
    }
}
