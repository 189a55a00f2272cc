//! A picture without a window: drawn as on the screen, into a file.

use crate::app::App;
use crate::offscreen::{GraphicsError, Offscreen};
use crate::painter::Painter;
use std::path::Path;
use three_d::{ClearState, RenderTargetMultisample, Viewport};

/// Samples per pixel, against jagged edges.
const SAMPLES: u32 = 4;
/// Passes until panels know their sizes.
const PASSES: u32 = 3;
/// Sides of the smallest and the largest picture [pixels].
pub const SIDES: std::ops::RangeInclusive<u32> = 64..=8192;

/// A picture.
#[derive(Clone, Debug, PartialEq)]
pub struct Snapshot {
    /// Pixels in a row.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// (height, width) red, green and blue, from above.
    pub pixels: Vec<[u8; 3]>,
}

/// Takes pictures; its OpenGL context stays on the thread that made it.
pub struct Photographer {
    painter: Painter,
    // Last: what the painter has on the card goes before it.
    offscreen: Offscreen,
}

impl Photographer {
    /// Errors: [`GraphicsError::None`] on a machine without OpenGL.
    pub fn new() -> Result<Self, GraphicsError> {
        let offscreen = Offscreen::new()?;
        Ok(Self { painter: Painter::new(&offscreen.context), offscreen })
    }

    /// What a window of `width` times `height` pixels would show of `app` now.
    ///
    /// # Errors
    /// [`GraphicsError::OpenGl`] for a size outside of [`SIDES`], or when drawing fails.
    pub fn take(&mut self, app: &mut App, width: u32, height: u32) -> Result<Snapshot, GraphicsError> {
        if !SIDES.contains(&width) || !SIDES.contains(&height) {
            let (least, most) = (SIDES.start(), SIDES.end());
            return Err(GraphicsError::OpenGl(format!("{width}x{height}: both from {least} to {most} pixels")));
        }
        let viewport = Viewport::new_at_origo(width, height);
        let target = RenderTargetMultisample::<[u8; 4], f32>::new(&self.offscreen.context, width, height, SAMPLES);
        for pass in 0..PASSES {
            self.painter.prepare(app, &mut [], 1e3 * f64::from(pass), viewport, 1.0);
            target
                .clear(ClearState::color_and_depth(1.0, 1.0, 1.0, 1.0, 1.0))
                .write(|| self.painter.paint(app))
                .map_err(|e| GraphicsError::OpenGl(e.to_string()))?;
        }
        let resolved = target.resolve_color();
        let pixels: Vec<[u8; 4]> = resolved.as_color_target(None).read();
        Ok(Snapshot { width, height, pixels: pixels.into_iter().map(|[r, g, b, _]| [r, g, b]).collect() })
    }
}

impl Snapshot {
    /// Writes it as PNG. Errors: those of the file system.
    pub fn write(&self, path: &Path) -> std::io::Result<()> {
        let file = std::io::BufWriter::new(std::fs::File::create(path)?);
        let mut encoder = png::Encoder::new(file, self.width, self.height);
        encoder.set_color(png::ColorType::Rgb);
        encoder.set_depth(png::BitDepth::Eight);
        encoder.set_compression(png::Compression::High);
        let mut writer = encoder.write_header()?;
        writer.write_image_data(self.pixels.as_flattened())?;
        writer.finish()?;
        Ok(())
    }

    /// The pixels from `left`, `top` to `right`, `bottom`, each in parts of the side.
    pub fn region(&self, left: f32, top: f32, right: f32, bottom: f32) -> impl Iterator<Item = [u8; 3]> + '_ {
        let columns = self.span(left, right, self.width);
        self.span(top, bottom, self.height)
            .flat_map(move |row| columns.clone().map(move |column| (row, column)))
            .map(|(row, column)| self.pixels[(row * self.width + column) as usize])
    }

    fn span(&self, from: f32, to: f32, side: u32) -> std::ops::Range<u32> {
        let at = |part: f32| ((part * side as f32) as u32).min(side - 1);
        at(from)..at(to) + 1
    }
}
