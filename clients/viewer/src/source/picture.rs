//! Pictures on the surface, from files to pixels.

use super::SourceError;
use palpate_sdk::{ClientError, SdkError};

/// A picture's pixels.
#[derive(Clone, Debug, PartialEq)]
pub struct Picture {
    /// Its number, as materials name it.
    pub number: u32,
    /// Pixels in a row.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// (height, width) red, green, blue and alpha, from above.
    pub pixels: Vec<[u8; 4]>,
}

/// The longest side of a picture [pixels]: what graphics cards of ten years ago take.
const LONGEST_SIDE: u32 = 16_384;

impl Picture {
    /// From the bytes of its file. Errors: [`ClientError::Undecodable`] when it is damaged, too large or of another kind.
    pub(super) fn decode(picture: &palpate_sdk::Picture) -> Result<Self, SourceError> {
        let failed = |e: image::ImageError| {
            let reason = format!("picture {}: {e}", picture.number);
            SdkError::from(ClientError::Undecodable { message: "SurfacePicture", reason })
        };
        let mut reader = image::ImageReader::new(std::io::Cursor::new(&picture.bytes));
        let mut limits = image::Limits::default();
        (limits.max_image_width, limits.max_image_height) = (Some(LONGEST_SIDE), Some(LONGEST_SIDE));
        reader.limits(limits);
        let reader = reader.with_guessed_format().map_err(|e| failed(e.into()))?;
        let image = reader.decode().map_err(failed)?.into_rgba8();
        let (width, height) = image.dimensions();
        let pixels = image.into_raw().as_chunks().0.to_vec();
        Ok(Self { number: picture.number, width, height, pixels })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_picture_is_read_from_above_and_a_damaged_one_is_named() {
        let mut bytes = Vec::new();
        let mut encoder = png::Encoder::new(&mut bytes, 1, 2);
        encoder.set_color(png::ColorType::Rgb);
        encoder.write_header().unwrap().write_image_data(&[250, 0, 0, 0, 0, 250]).unwrap();
        let of = |bytes: &[u8]| {
            Picture::decode(&palpate_sdk::Picture { number: 3, media_type: "image/png".into(), bytes: bytes.into() })
        };
        let picture = of(&bytes).unwrap();
        assert_eq!((picture.number, picture.width, picture.height), (3, 1, 2));
        assert_eq!(picture.pixels, [[250, 0, 0, 255], [0, 0, 250, 255]]);
        for damaged in [&bytes[..40], b"no picture"] {
            assert!(of(damaged).unwrap_err().to_string().contains("picture 3"));
        }
    }
}
