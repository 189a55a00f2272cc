//! Pictures (PNG) and their numbers (CSV).
//!
//! On the canvas of [`palpate::picture`].

use palpate::picture::{Area, Drawn, INK, LEVELS, font, panels, size};
use palpate_core::math::{Real, Vec3};
use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};
use std::io::Result;
use std::path::Path;

/// Size of one panel [pixel]; of several rows of them.
const PANEL: (u32, u32) = (800, 520);
const SMALL_PANEL: (u32, u32) = (620, 420);

/// Size of a coloured shape [pixel].
const COLOURED: (u32, u32) = (330, 250);

/// Colours of the curves: the paper's red, black and blue, toned down, then three more that stay apart in grey.
pub const COLOURS: [RGBColor; 6] = [
    RGBColor(200, 44, 48),
    RGBColor(36, 36, 40),
    RGBColor(38, 104, 190),
    RGBColor(226, 142, 24),
    RGBColor(34, 140, 96),
    RGBColor(140, 80, 170),
];
const GRID: RGBColor = RGBColor(226, 228, 232);

/// One line.
#[derive(Clone, Debug, Default)]
pub struct Curve {
    /// Words for the legend.
    pub name: String,
    /// Points, in the units of the chart's axes; whatever is not finite ends the line.
    pub points: Vec<(Real, Real)>,
    /// Points that get a dot, in the same units.
    pub dots: Vec<(Real, Real)>,
}

/// One panel of axes.
#[derive(Clone, Debug, Default)]
pub struct Chart {
    /// Words above it.
    pub title: String,
    /// What runs to the right, with its unit.
    pub x_label: String,
    /// What runs upward, with its unit.
    pub y_label: String,
    /// The lines, first ones below.
    pub curves: Vec<Curve>,
    /// Lowest and highest value shown; by the data when absent.
    pub y_range: Option<(Real, Real)>,
    /// The values are powers of ten, and labelled so.
    pub powers: bool,
    /// Each label along x is twice the one before.
    pub log_x: bool,
}

/// Charts in a row, by how many there are.
fn columns(charts: usize) -> usize {
    match charts {
        0..=3 => charts,
        4 => 2,
        _ => 3,
    }
}

/// Writes `name.png` with the `charts`, up to three in a row, under `title`, and `name.csv` with every point, into `out`.
pub fn charts(out: &Path, name: &str, title: &str, charts: &[Chart]) -> Result<()> {
    let mut csv = csv::Writer::from_path(out.join(format!("{name}.csv")))?;
    csv.write_record(["panel", "curve", "x", "y"])?;
    for chart in charts {
        for curve in &chart.curves {
            for (x, y) in &curve.points {
                csv.write_record([&chart.title, &curve.name, &x.to_string(), &y.to_string()])?;
            }
        }
    }
    csv.flush()?;
    let size = if charts.len() > 3 { SMALL_PANEL } else { PANEL };
    panels(out, name, title, size, columns(charts.len()), charts, draw_chart)
}

/// A triangulated shape for [`shapes`].
#[derive(Clone, Debug)]
pub struct Shape {
    /// Words below it.
    pub title: String,
    /// Vertices [m], z up.
    pub vertices: Vec<Vec3>,
    /// Triangles, counter-clockwise seen from outside.
    pub triangles: Vec<[u32; 3]>,
}

/// Writes `name.png` with the `shapes`, `columns` in a row, all to the same scale, lines of the box from the origin to
/// `rest` [m] behind each.
pub fn shapes(out: &Path, name: &str, title: &str, shapes: &[Shape], columns: usize, rest: Vec3) -> Result<()> {
    panels(out, name, title, (440, 430), columns, shapes, |area, shape| draw_shape(area, shape, rest))
}

/// A shape in colours.
#[derive(Clone, Debug)]
pub struct Coloured {
    /// The shape.
    pub shape: Shape,
    /// Place in the legend of each triangle (n_triangles).
    pub class: Vec<usize>,
    /// Seen from where this points.
    pub toward: Vec3,
    /// Only what is as close to this place as the second [m]; all of it when absent.
    pub around: Option<(Vec3, Real)>,
}

/// Writes `name.png` with the `shapes`, `columns` in a row, each triangle in the colour of its class; `legend`: a word
/// for each.
pub fn coloured(
    out: &Path,
    name: &str,
    title: &str,
    shapes: &[Coloured],
    columns: usize,
    legend: &[&str],
) -> Result<()> {
    panels(out, name, title, COLOURED, columns, shapes, |area, shape| draw_coloured(area, shape, legend))
}

/// Writes `name.csv` into `out` and gives the same table back as [`markdown`].
pub fn table(out: &Path, name: &str, header: &[&str], rows: &[Vec<String>]) -> Result<String> {
    let mut csv = csv::Writer::from_path(out.join(format!("{name}.csv")))?;
    csv.write_record(header)?;
    for row in rows {
        csv.write_record(row)?;
    }
    csv.flush()?;
    Ok(markdown(header, rows))
}

/// A table in Markdown with aligned columns, which reads as well where it is printed.
pub fn markdown(header: &[&str], rows: &[Vec<String>]) -> String {
    let escaped = |cell: &str| cell.replace('|', "\\|");
    let cells: Vec<Vec<String>> = std::iter::once(header.iter().map(|h| escaped(h)).collect())
        .chain(rows.iter().map(|row| row.iter().map(|cell| escaped(cell)).collect()))
        .collect();
    let width = |column: usize| cells.iter().map(|row| row[column].chars().count()).max().unwrap_or(0).max(3);
    let widths: Vec<usize> = (0..header.len()).map(width).collect();
    let line = |row: &Vec<String>| {
        let padded = row.iter().zip(&widths).map(|(cell, width)| format!("{cell:<width$}"));
        format!("| {} |\n", padded.collect::<Vec<_>>().join(" | "))
    };
    let rule: Vec<String> = widths.iter().map(|width| "-".repeat(*width)).collect();
    let body: String = cells[1..].iter().map(line).collect();
    format!("{}{}{body}", line(&cells[0]), line(&rule))
}

fn draw_chart(area: &Area, chart: &Chart) -> Drawn {
    let place = |p: &(Real, Real)| (if chart.log_x { p.0.log2() } else { p.0 }, p.1);
    let shown = |c: &Curve| c.points.iter().map(place).take_while(|p| p.0.is_finite() && p.1.is_finite()).collect();
    let curves: Vec<Vec<(Real, Real)>> = chart.curves.iter().map(shown).collect();
    let dots: Vec<Vec<(Real, Real)>> = chart.curves.iter().map(|c| c.dots.iter().map(place).collect()).collect();
    let span = |pick: fn(&(Real, Real)) -> Real| {
        let values = || curves.iter().chain(&dots).flatten().map(pick);
        (values().fold(Real::INFINITY, Real::min), values().fold(-Real::INFINITY, Real::max))
    };
    let (mut left, mut right) = span(|p| p.0);
    let mut x_labels = 9;
    if chart.log_x {
        (left, right) = (left.floor(), right.ceil());
        x_labels = (right - left) as usize + 1;
    } else {
        // A run that begins or stops just short of a round time still gets its label.
        left = if (0.0..0.01 * right).contains(&left) { 0.0 } else { left };
        right = if right.ceil() - right < 0.01 * right { right.ceil() } else { right };
    }
    let (low, high) = chart.y_range.unwrap_or_else(|| {
        let (low, high) = span(|p| p.1);
        (low - 0.06 * (high - low), high + 0.06 * (high - low))
    });
    let longest = chart.curves.iter().map(|c| c.name.chars().count()).max().unwrap_or(0);
    let width = if longest > 23 { 330 } else { 245 };
    let columns = ((area.dim_in_pixel().0 / size(1) - 100) / width).max(1) as usize;
    let legend_rows = chart.curves.len().div_ceil(columns) as u32;
    let (strip, body) = area.split_vertically(size(44 + 30 * legend_rows));
    strip.draw_text(
        &chart.title,
        &font(21).pos(Pos::new(HPos::Center, VPos::Center)),
        ((strip.dim_in_pixel().0 / 2) as i32, size(18) as i32),
    )?;
    // The legend stands above the axes, where it hides nothing.
    let column = |i: usize| size(100 + (i % columns) as u32 * width) as i32;
    for (i, curve) in chart.curves.iter().enumerate() {
        let y = size(52 + 30 * (i / columns) as u32) as i32;
        let line = [(column(i), y), (column(i) + size(34) as i32, y)];
        strip.draw(&PathElement::new(line, COLOURS[i % COLOURS.len()].stroke_width(size(3))))?;
        let style = font(18).pos(Pos::new(HPos::Left, VPos::Center));
        strip.draw_text(&curve.name, &style, (column(i) + size(44) as i32, y))?;
    }
    let mut axes = ChartBuilder::on(&body)
        .margin_left(size(14))
        .margin_right(size(28))
        .margin_bottom(size(10))
        .x_label_area_size(size(56))
        .y_label_area_size(size(92))
        .build_cartesian_2d(left..right, low..high)?;
    axes.configure_mesh()
        .x_labels(x_labels)
        .y_labels(7)
        .max_light_lines(0)
        .bold_line_style(GRID.stroke_width(size(1)))
        .axis_style(INK.stroke_width(size(1)))
        .label_style(font(17))
        .axis_desc_style(font(19))
        .x_label_formatter(&|v| number(if chart.log_x { v.exp2() } else { *v }))
        .set_all_tick_mark_size(size(5))
        .y_label_formatter(&|v| if chart.powers { power(*v) } else { number(*v) })
        .x_desc(&chart.x_label)
        .y_desc(&chart.y_label)
        .draw()?;
    for (i, points) in curves.into_iter().enumerate() {
        let colour = COLOURS[i % COLOURS.len()];
        let points_only = points.is_empty();
        // A run that leaves the axes is drawn up to where it does.
        let inside: Vec<_> = points.into_iter().take_while(|p| p.1 >= low && p.1 <= high).collect();
        // Piece by piece with round joints: the joints of one long line stick out as spikes where it turns sharply.
        axes.draw_series(inside.windows(2).map(|two| PathElement::new(two, colour.stroke_width(size(2)))))?;
        axes.draw_series(inside.iter().map(|p| Circle::new(*p, size(1), colour.filled())))?;
        let inside = dots[i].iter().filter(|p| p.1 >= low && p.1 <= high);
        axes.draw_series(inside.map(|p| Circle::new(*p, size(if points_only { 3 } else { 5 }), colour.filled())))?;
    }
    Ok(())
}

/// The label of ten to the power of `v`: half powers read as 3, 30, 300.
fn power(v: Real) -> String {
    let whole = v.floor();
    match (v - whole, whole) {
        (half, 0.0..4.0) if (half - 0.5).abs() < 1e-9 => number(3.0 * Real::powi(10.0, whole as i32)),
        (0.0, 0.0..4.0) => number(Real::powi(10.0, whole as i32)),
        _ => format!("1e{}", number(v)),
    }
}

/// A label without needless digits.
fn number(v: Real) -> String {
    if v.abs() < 1e-12 {
        return "0".into();
    }
    let digits = format!("{v:.3}");
    let short = digits.trim_end_matches('0').trim_end_matches('.');
    short.replace('-', "−")
}

/// A parallel projection onto a picture.
struct View {
    toward: Vec3,
    right: Vec3,
    up: Vec3,
    centre: Vec3,
    /// Pixels per metre.
    scale: Real,
    size: (u32, u32),
}

impl View {
    /// Seen from where `toward` points, z up, with `centre` in the middle.
    fn new(toward: Vec3, centre: Vec3, scale: Real, size: (u32, u32)) -> Self {
        let toward = toward.normalize();
        let right = Vec3::z().cross(&toward).normalize();
        Self { toward, right, up: toward.cross(&right), centre, scale, size }
    }

    fn place(&self, p: Vec3) -> (i32, i32) {
        let d = (p - self.centre) * self.scale;
        let middle = (self.size.0 as i32 / 2, self.size.1 as i32 / 2);
        (middle.0 + d.dot(&self.right) as i32, middle.1 - d.dot(&self.up) as i32 - size(10) as i32)
    }
}

fn draw_shape(area: &Area, shape: &Shape, rest: Vec3) -> Drawn {
    let (w, h) = area.dim_in_pixel();
    // Seen from the front right, slightly from above: x to the right, z up, the held side on the left.
    let centre = rest.component_mul(&Vec3::new(0.5, 0.5, 0.34));
    let view = View::new(Vec3::new(0.45, -0.80, 0.38), centre, Real::from(w) / (2.3 * rest.max()), (w, h));
    let place = |p: Vec3| view.place(p);
    let corner = |i: u32| rest.component_mul(&Vec3::from_fn(|axis, _| Real::from((i >> axis) & 1)));
    let wall = [[-0.25, -0.55], [1.25, -0.55], [1.25, 1.25], [-0.25, 1.25]]
        .map(|[y, z]| place(Vec3::new(0.0, y * rest.y, z * rest.z)));
    area.draw(&Polygon::new(wall, RGBColor(240, 240, 236).filled()))?;
    for a in 0..8u32 {
        for axis in (0..3).filter(|axis| (a >> axis) & 1 == 0) {
            let line = [place(corner(a)), place(corner(a | (1 << axis)))];
            area.draw(&PathElement::new(line, RGBColor(190, 194, 202).stroke_width(size(1))))?;
        }
    }
    draw_triangles(area, shape, &view, |_| RGBColor(172, 206, 244))?;
    let style = font(20).pos(Pos::new(HPos::Center, VPos::Bottom));
    area.draw_text(&shape.title, &style, (w as i32 / 2, h as i32 - size(14) as i32))?;
    Ok(())
}

fn draw_coloured(area: &Area, coloured: &Coloured, legend: &[&str]) -> Drawn {
    let (w, h) = area.dim_in_pixel();
    let shape = &coloured.shape;
    let mut view = View::new(coloured.toward, Vec3::zeros(), 1.0, (w, h));
    let seen = |axis: &Vec3| {
        let along = || shape.vertices.iter().map(|v| v.dot(axis));
        (along().fold(Real::INFINITY, Real::min), along().fold(-Real::INFINITY, Real::max))
    };
    let (across, upward) = (seen(&view.right), seen(&view.up));
    view.centre = 0.5 * (view.right * (across.0 + across.1) + view.up * (upward.0 + upward.1));
    view.scale = (0.72 * Real::from(w) / (across.1 - across.0)).min(0.72 * Real::from(h) / (upward.1 - upward.0));
    let mut shape = shape.clone();
    let mut class = coloured.class.clone();
    if let Some((place, reach)) = coloured.around {
        let is_near = |t: &[u32; 3]| t.iter().all(|v| (shape.vertices[*v as usize] - place).norm() < reach);
        let near: Vec<bool> = shape.triangles.iter().map(is_near).collect();
        let mut kept = near.iter();
        class.retain(|_| kept.next().is_some_and(|k| *k));
        let mut kept = near.iter();
        shape.triangles.retain(|_| kept.next().is_some_and(|k| *k));
        (view.centre, view.scale) = (place, 0.45 * Real::from(w.min(h)) / reach);
    }
    let colour = |class: usize| LEVELS[class.min(LEVELS.len() - 1)];
    draw_triangles(area, &shape, &view, |t| colour(class[t]))?;
    for (class, word) in legend.iter().enumerate() {
        let y = size(16 + 18 * class as u32) as i32;
        let box_ = [(size(8) as i32, y - size(6) as i32), (size(22) as i32, y + size(6) as i32)];
        area.draw(&Rectangle::new(box_, colour(class).filled()))?;
        let style = font(13).pos(Pos::new(HPos::Left, VPos::Center));
        area.draw_text(word, &style, (size(27) as i32, y))?;
    }
    let style = font(16).pos(Pos::new(HPos::Center, VPos::Bottom));
    area.draw_text(&shape.title, &style, (w as i32 / 2, h as i32 - size(6) as i32))?;
    Ok(())
}

/// The triangles from back to front, lit, in the colour of each.
fn draw_triangles(area: &Area, shape: &Shape, view: &View, colour: impl Fn(usize) -> RGBColor) -> Drawn {
    let light = Vec3::new(0.75, -0.25, 0.65).normalize();
    let depth = |t: &[u32; 3]| t.iter().map(|v| shape.vertices[*v as usize].dot(&view.toward)).sum::<Real>();
    let mut order: Vec<(usize, &[u32; 3])> = shape.triangles.iter().enumerate().collect();
    order.sort_by(|a, b| depth(a.1).total_cmp(&depth(b.1)));
    for (t, triangle) in order {
        let [a, b, c] = triangle.map(|v| shape.vertices[v as usize]);
        let normal = (b - a).cross(&(c - a)).normalize();
        if normal.dot(&view.toward) < 0.0 {
            // What faces away lies behind; by depth alone, long triangles at an edge would come out in front.
            continue;
        }
        let bright = 0.5 + 0.5 * normal.dot(&light).max(0.0);
        let shade = |full: Real| (full * bright).min(255.0) as u8;
        let RGBColor(red, green, blue) = colour(t);
        let fill = RGBColor(shade(red.into()), shade(green.into()), shade(blue.into()));
        let corners = [a, b, c].map(|p| view.place(p));
        area.draw(&Polygon::new(corners, fill.filled()))?;
        let outline = [corners[0], corners[1], corners[2], corners[0]];
        area.draw(&PathElement::new(outline, RGBColor(60, 84, 120).stroke_width(1)))?;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_table_reads_as_markdown_whatever_stands_in_its_cells() {
        let text = markdown(&["a", "max |E|"], &[vec!["1".into(), "2.5".into()]]);
        assert_eq!(text, "| a   | max \\|E\\| |\n| --- | --------- |\n| 1   | 2.5       |\n");
    }
}
