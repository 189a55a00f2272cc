//! Pictures (PNG): a canvas of panels under a title, and cuts through the levels of a body on it.
//!
//! Drawn by `plotters` at three times the size and averaged down, which smooths every line; the font comes with the program,
//! so that a bare machine without fonts draws the same picture.

use crate::output::Output;
use palpate_core::math::Real;
use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};
use plotters::style::{FontStyle, register_font};
use std::io::{Error, Result};
use std::path::Path;
use std::sync::Once;

/// Pixels drawn for each pixel kept, along each axis.
const OVERSAMPLING: u32 = 3;
/// Height of the strip above the panels [pixel].
const HEAD: u32 = 64;
/// Lines and letters.
pub const INK: RGBColor = RGBColor(40, 42, 48);

/// Colours of the levels, coarsest first: the paper's blue, green and yellow, then finer ones.
pub const LEVELS: [RGBColor; 5] = [
    RGBColor(70, 110, 210),
    RGBColor(70, 170, 90),
    RGBColor(240, 208, 60),
    RGBColor(235, 130, 50),
    RGBColor(205, 60, 70),
];

/// A cut through a level for [`sections`].
#[derive(Clone, Debug)]
pub struct Section {
    /// Words below it.
    pub title: String,
    /// Cut elements [m], and how full of colour each is, 0..=1.
    pub polygons: Vec<(Vec<(Real, Real)>, Real)>,
    /// Lines of the surface [m].
    pub outline: Vec<[(Real, Real); 2]>,
}

/// Writes `name.png` with the `sections` side by side, all to the same scale, each in the colour of its level.
pub fn sections(out: &Path, name: &str, title: &str, sections: &[Section]) -> Result<()> {
    let all = || sections.iter().flat_map(|s| s.polygons.iter().flat_map(|p| &p.0).chain(s.outline.iter().flatten()));
    let reach = |pick: fn(&(Real, Real)) -> Real| all().map(pick).map(Real::abs).fold(1e-9, Real::max);
    let (width, height) = (reach(|p| p.0), reach(|p| p.1));
    // As many beside each other as are legible, and as high as the cut is.
    let columns = if sections.len() == 4 { 2 } else { sections.len().clamp(1, 3) };
    let extent = (780, ((780.0 * height / width) as u32).clamp(240, 900) + 40);
    let numbered: Vec<(usize, &Section)> = sections.iter().enumerate().collect();
    panels(out, name, title, extent, columns, &numbered, |area, (level, section)| {
        let (w, h) = area.dim_in_pixel();
        let scale = (0.47 * Real::from(w) / width).min(0.47 * Real::from(h - size(40)) / height);
        let middle = (w as i32 / 2, (h - size(40)) as i32 / 2);
        let place = |p: &(Real, Real)| (middle.0 + (p.0 * scale) as i32, middle.1 - (p.1 * scale) as i32);
        for (polygon, full) in &section.polygons {
            let colour = LEVELS[(*level).min(LEVELS.len() - 1)].mix(0.2 + 0.6 * full.clamp(0.0, 1.0));
            let mut corners: Vec<(i32, i32)> = polygon.iter().map(place).collect();
            area.draw(&Polygon::new(corners.clone(), colour.filled()))?;
            corners.extend(corners.first().copied());
            area.draw(&PathElement::new(corners, RGBColor(70, 74, 84).stroke_width(1)))?;
        }
        for line in &section.outline {
            area.draw(&PathElement::new(line.each_ref().map(place), INK.stroke_width(size(2))))?;
        }
        let style = font(19).pos(Pos::new(HPos::Center, VPos::Bottom));
        area.draw_text(&section.title, &style, (w as i32 / 2, h as i32 - size(8) as i32))?;
        Ok(())
    })
}

/// What a panel is drawn on.
pub type Area<'a> = DrawingArea<BitMapBackend<'a>, plotters::coord::Shift>;
/// How drawing went.
pub type Drawn = std::result::Result<(), Box<dyn std::error::Error>>;

/// As many pixels as are drawn for `pixels` kept.
pub fn size(pixels: u32) -> u32 {
    pixels * OVERSAMPLING
}

/// Letters `pixels` high.
pub fn font(pixels: u32) -> TextStyle<'static> {
    ("sans-serif", size(pixels)).into_font().color(&INK)
}

fn picture(path: &Path, width: u32, height: u32, draw: impl FnOnce(&Area) -> Drawn) -> Result<()> {
    static FONT: Once = Once::new();
    FONT.call_once(|| {
        // The bytes are a constant of the program: they parse or no test passes.
        let _ = register_font("sans-serif", FontStyle::Normal, epaint_default_fonts::UBUNTU_LIGHT);
    });
    let (w, h) = (size(width), size(height));
    let mut large = vec![255u8; 3 * (w * h) as usize];
    {
        let area = BitMapBackend::with_buffer(&mut large, (w, h)).into_drawing_area();
        area.fill(&WHITE).map_err(Error::other)?;
        draw(&area).map_err(|e| Error::other(e.to_string()))?;
        area.present().map_err(Error::other)?;
    }
    let mut small = Vec::with_capacity(3 * (width * height) as usize);
    for y in 0..height {
        for x in 0..width {
            for colour in 0..3 {
                let sum: u32 = (0..OVERSAMPLING * OVERSAMPLING)
                    .map(|i| (size(x) + i % OVERSAMPLING, size(y) + i / OVERSAMPLING))
                    .map(|(x, y)| u32::from(large[(3 * (y * w + x) + colour) as usize]))
                    .sum();
                small.push((sum / (OVERSAMPLING * OVERSAMPLING)) as u8);
            }
        }
    }
    let mut file = Output::create(path)?;
    let mut encoder = png::Encoder::new(&mut file, width, height);
    encoder.set_color(png::ColorType::Rgb);
    encoder.write_header().and_then(|mut w| w.write_image_data(&small)).map_err(Error::other)?;
    file.finish()
}

/// Writes `name.png`: under `title` a panel of `extent` [pixel] for each of the `items`, `columns` in a row.
pub fn panels<T>(
    out: &Path,
    name: &str,
    title: &str,
    extent: (u32, u32),
    columns: usize,
    items: &[T],
    draw: impl Fn(&Area, &T) -> Drawn,
) -> Result<()> {
    let rows = items.len().div_ceil(columns);
    let (width, height) = (extent.0 * columns as u32, extent.1 * rows as u32);
    picture(&out.join(format!("{name}.png")), width, HEAD + height, |area| {
        let (head, body) = area.split_vertically(size(HEAD));
        let style = font(26).pos(Pos::new(HPos::Center, VPos::Center));
        head.draw_text(title, &style, ((head.dim_in_pixel().0 / 2) as i32, size(HEAD / 2) as i32))?;
        body.split_evenly((rows, columns)).iter().zip(items).try_for_each(|(panel, item)| draw(panel, item))
    })
}
