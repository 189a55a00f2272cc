//! What stands over the body: its name, a scale, what colours mean, how large forces are.

use super::{FAINT, INK, WARNING, card, colour};
use crate::app::App;
use crate::colour::{Legend, round_number, scale};
use crate::scene::Arrow;
use crate::source::TICK;
use three_d::egui::{self, Align2, Color32, FontId, Pos2, Rect, RichText, Stroke, StrokeKind, pos2, vec2};
use three_d::{Camera, Viewport};

/// From the edges of the picture [points].
const MARGIN: f32 = 16.0;

/// Writes over what is in `rect`.
pub fn show(ui: &mut egui::Ui, rect: Rect, app: &App) {
    let painter = ui.painter_at(rect);
    if let (Some(body), Some(orbit)) = (app.body(), app.orbit) {
        let viewport = Viewport::new_at_origo(rect.width().max(1.0) as u32, rect.height().max(1.0) as u32);
        let camera = orbit.camera(viewport);
        for tool in app.tools() {
            if let Some(arrow) = Arrow::of(&tool, body.size(), body.subject.force_limit) {
                force(&painter, point(rect, &camera, arrow.start + arrow.way), arrow.newtons);
            }
        }
        scale_bar(&painter, rect, rect.height() / orbit.height());
        heading(&painter, rect, app);
        legend(&painter, rect, app);
    }
    notice(ui, rect, app);
    if app.help {
        help(ui, rect);
    }
}

/// Where a place is on the screen.
fn point(rect: Rect, camera: &Camera, place: three_d::Vec3) -> Pos2 {
    let pixel = camera.pixel_at_position(place);
    pos2(rect.min.x + pixel.x, rect.max.y - pixel.y)
}

/// Lines of text in a light box whose corner or side `anchor` is at `at`.
fn label(painter: &egui::Painter, at: Pos2, anchor: Align2, lines: &[(String, f32, Color32)]) -> Rect {
    let lines =
        lines.iter().map(|(words, size, ink)| painter.layout_no_wrap(words.clone(), FontId::proportional(*size), *ink));
    let lines: Vec<_> = lines.collect();
    let width = lines.iter().map(|line| line.size().x).fold(0.0, f32::max);
    let height = lines.iter().map(|line| line.size().y).sum();
    let rect = anchor.anchor_size(at, vec2(width, height));
    paper(painter, rect);
    let mut y = rect.min.y;
    for line in lines {
        let size = line.size();
        painter.galley(pos2(rect.min.x, y), line, INK);
        y += size.y;
    }
    rect
}

/// A light box behind what is in `rect`.
fn paper(painter: &egui::Painter, rect: Rect) {
    painter.rect_filled(rect.expand2(vec2(7.0, 4.0)), 5.0, super::PAPER.gamma_multiply(0.72));
}

fn force(painter: &egui::Painter, tip: Pos2, newtons: f32) {
    // An arrow that leaves the picture keeps its number in it.
    let picture = painter.clip_rect();
    let within = picture.shrink2(vec2(50.0, 34.0).min(0.4 * picture.size()));
    let at = within.clamp(tip) + vec2(14.0, -6.0);
    label(painter, at, Align2::LEFT_BOTTOM, &[(format!("{newtons:.2} N"), 16.0, super::ACCENT)]);
}

fn heading(painter: &egui::Painter, rect: Rect, app: &App) {
    let Some(body) = app.body() else { return };
    let seconds = app.moment().tick as f64 * TICK;
    let lines =
        [(body.subject.name.clone(), 22.0, INK), (format!("{seconds:.2} s   {}", body.subject.made_by), 12.5, FAINT)];
    label(painter, rect.min + vec2(MARGIN, MARGIN - 4.0), Align2::LEFT_TOP, &lines);
}

fn scale_bar(painter: &egui::Painter, rect: Rect, points_per_metre: f32) {
    let metres = round_number(140.0 / points_per_metre);
    let start = pos2(rect.min.x + MARGIN, rect.max.y - MARGIN);
    let end = start + vec2(metres * points_per_metre, 0.0);
    paper(painter, Rect::from_min_max(start - vec2(0.0, 22.0), end));
    let stroke = Stroke::new(2.0, INK);
    painter.line_segment([start, end], stroke);
    for at in [start, end] {
        painter.line_segment([at - vec2(0.0, 6.0), at], stroke);
    }
    let words = if metres < 9.9e-4 { format!("{:.1} mm", metres * 1e3) } else { format!("{:.0} mm", metres * 1e3) };
    let at = start + vec2(0.5 * (end.x - start.x), -7.0);
    painter.text(at, Align2::CENTER_BOTTOM, words, FontId::proportional(13.0), INK);
}

fn legend(painter: &egui::Painter, rect: Rect, app: &App) {
    let Some(body) = app.body() else { return };
    let right = rect.max - vec2(MARGIN, MARGIN);
    let text = |at: Pos2, anchor: Align2, words: &str, ink: Color32| {
        painter.text(at, anchor, words, FontId::proportional(12.5), ink);
    };
    match app.colouring.legend(app.moment(), body.subject.levels, body.size()) {
        Legend::None => {}
        Legend::Unknown(why) => {
            label(painter, right, Align2::RIGHT_BOTTOM, &[(why.to_owned(), 12.5, INK)]);
        }
        Legend::Levels(levels) => {
            let bar = Rect::from_min_max(right - vec2(30.0 * levels.len() as f32, 18.0), right);
            paper(painter, Rect::from_min_max(bar.min.min(right - vec2(124.0, 0.0)) - vec2(0.0, 20.0), right));
            for (number, level) in levels.iter().enumerate() {
                let left = bar.min + vec2(30.0 * number as f32, 0.0);
                let swatch = Rect::from_min_size(left, vec2(30.0, 18.0));
                painter.rect_filled(swatch, 0.0, colour(*level));
                let ink = if number == 2 { INK } else { Color32::WHITE };
                text(swatch.center(), Align2::CENTER_CENTER, &number.to_string(), ink);
            }
            text(bar.right_top() - vec2(0.0, 3.0), Align2::RIGHT_BOTTOM, "level, coarse to fine", INK);
        }
        Legend::Scale { title, end, unit } => {
            let (width, steps) = (180.0, 60);
            let bar = Rect::from_min_size(right - vec2(width, 28.0), vec2(width, 12.0));
            paper(painter, Rect::from_min_max(bar.min - vec2(0.0, 19.0), right));
            for step in 0..steps {
                let part = |step: i32| bar.min.x + width * step as f32 / steps as f32;
                let slice = Rect::from_x_y_ranges(part(step)..=part(step + 1), bar.y_range());
                painter.rect_filled(slice, 0.0, colour(scale((step as f32 + 0.5) / steps as f32)));
            }
            painter.rect_stroke(bar, 0.0, Stroke::new(1.0, INK.gamma_multiply(0.5)), StrokeKind::Outside);
            text(bar.min - vec2(0.0, 3.0), Align2::LEFT_BOTTOM, title, INK);
            for (part, anchor) in [(0.0, Align2::LEFT_TOP), (0.5, Align2::CENTER_TOP), (1.0, Align2::RIGHT_TOP)] {
                let number = (1e3 * end * part).round() / 1e3;
                let words = if part == 1.0 { format!("{number} {unit}") } else { format!("{number}") };
                text(pos2(bar.min.x + part * width, bar.max.y + 2.0), anchor, &words, INK);
            }
        }
    }
}

fn notice(ui: &mut egui::Ui, rect: Rect, app: &App) {
    let (words, ink) = match (app.notice(), app.paused && app.recorded().is_none()) {
        (Some(words), _) => (words.to_owned(), WARNING),
        (None, true) => ("paused: Space goes on".to_owned(), INK),
        (None, false) => return,
    };
    let at = pos2(rect.center().x, rect.min.y + MARGIN + 44.0);
    egui::Area::new("notice".into()).fixed_pos(at).pivot(Align2::CENTER_TOP).show(ui.ctx(), |ui| {
        card().show(ui, |ui| {
            ui.set_max_width(0.7 * rect.width());
            ui.label(RichText::new(words).color(ink).size(14.0));
        });
    });
}

fn help(ui: &mut egui::Ui, rect: Rect) {
    egui::Area::new("help".into()).fixed_pos(rect.center()).pivot(Align2::CENTER_CENTER).show(ui.ctx(), |ui| {
        card().show(ui, |ui| {
            egui::Grid::new("keys").num_columns(2).spacing([18.0, 6.0]).show(ui, |ui| {
                for (key, does) in super::input::HELP {
                    ui.label(RichText::new(key).strong().size(14.0));
                    ui.label(RichText::new(does).size(14.0));
                    ui.end_row();
                }
            });
        });
    });
}
