//! Text as programs and editors write it, made plain: UTF-8 without a mark of the encoding, lines that end in a line feed.

use std::borrow::Cow;

/// `bytes` without a mark of UTF-8, and from UTF-16 to UTF-8 where they begin as text in UTF-16 does: with its mark, or
/// with four letters of two bytes each. Other bytes, of binary files, too, stay as they are.
pub(super) fn utf8(bytes: &[u8]) -> Cow<'_, [u8]> {
    let is_letter = |letter: u8| letter.is_ascii_graphic() || letter.is_ascii_whitespace();
    let letters = |bytes: &[u8], at: usize| {
        bytes.len() >= 8 && bytes[..8].as_chunks::<2>().0.iter().all(|pair| is_letter(pair[at]) && pair[1 - at] == 0)
    };
    let decoded = |bytes: &[u8], unit: fn([u8; 2]) -> u16| {
        let units = bytes.as_chunks::<2>().0.iter().map(|pair| unit(*pair));
        let text: String = char::decode_utf16(units).map(|c| c.unwrap_or(char::REPLACEMENT_CHARACTER)).collect();
        Cow::Owned(text.into_bytes())
    };
    match bytes {
        [0xef, 0xbb, 0xbf, rest @ ..] => Cow::Borrowed(rest),
        [0xff, 0xfe, rest @ ..] if letters(rest, 0) => decoded(rest, u16::from_le_bytes),
        [0xfe, 0xff, rest @ ..] if letters(rest, 1) => decoded(rest, u16::from_be_bytes),
        _ if letters(bytes, 0) => decoded(bytes, u16::from_le_bytes),
        _ if letters(bytes, 1) => decoded(bytes, u16::from_be_bytes),
        _ => Cow::Borrowed(bytes),
    }
}

/// The text `bytes`, of a format that is text alone, with line feeds where lines end in nothing but a carriage return.
pub(super) fn plain(bytes: &[u8]) -> Cow<'_, [u8]> {
    let bytes = utf8(bytes);
    if bytes.contains(&b'\n') || !bytes.contains(&b'\r') {
        return bytes;
    }
    let mut bytes = bytes.into_owned();
    bytes.iter_mut().filter(|b| **b == b'\r').for_each(|b| *b = b'\n');
    Cow::Owned(bytes)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn text_of_every_encoding_becomes_plain_and_other_bytes_stay() {
        let text = "v 1 0 0\nf ä 1\n";
        let little: Vec<u8> = text.encode_utf16().flat_map(u16::to_le_bytes).collect();
        let big: Vec<u8> = text.encode_utf16().flat_map(u16::to_be_bytes).collect();
        let files = [
            text.as_bytes().to_vec(),
            [b"\xef\xbb\xbf", text.as_bytes()].concat(),
            [b"\xff\xfe", &little[..]].concat(),
            [b"\xfe\xff", &big[..]].concat(),
            little,
            big,
            text.replace('\n', "\r").into_bytes(),
        ];
        for file in files {
            assert_eq!(plain(&file), text.as_bytes(), "{file:?}");
        }
        for bytes in [&b"solid\0\0\0\0"[..], b"\xff\xfe\0\0\x01\x02\x03\x04\x05\x06", b"v 1\r\nv 2\r\n", b"\xff"] {
            assert_eq!(plain(bytes), bytes);
        }
    }
}
