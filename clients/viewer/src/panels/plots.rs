//! Curves over the last seconds, or over a recording.

use super::{FAINT, INK, colour};
use crate::app::App;
use crate::colour::{self, round_number};
use crate::history::{Health, SPAN};
use egui_plot::{GridMark, Line, Plot, PlotPoints, VLine};
use three_d::egui::{self, Color32, RichText};

/// Height of a plot [points].
const HEIGHT: f32 = 92.0;
/// Points of a curve: as many as there are columns of pixels.
const POINTS: usize = 300;
/// Of tools, in their order.
const TOOLS: [Color32; 4] = [
    Color32::from_rgb(28, 96, 200),
    Color32::from_rgb(200, 70, 40),
    Color32::from_rgb(40, 140, 90),
    Color32::from_rgb(140, 80, 170),
];

/// A line of a plot: name, colour, points.
type Curve = (String, Color32, Vec<[f64; 2]>);

/// The force on each tool.
pub fn forces(ui: &mut egui::Ui, app: &App, height: f32) {
    let Some(body) = app.body() else { return };
    let history = app.history();
    let mut curves = Vec::new();
    for tool in 0..history.tools() {
        let curve = history.force(tool, POINTS);
        // A tool that nobody touches with has no line to tell apart.
        if tool == 0 || curve.iter().any(|point| point[1] > 0.0) {
            let name = body.subject.tools.get(tool).map_or_else(|| format!("tool {tool}"), |tool| tool.name.clone());
            curves.push((name, TOOLS[tool % TOOLS.len()], curve));
        }
    }
    let now = app.recorded().map(|recording| recording.frames()[0].tick as f64 * crate::source::TICK + app.time);
    let title = if now.is_some() { "force [N]" } else { "force [N], last 20 s" };
    show(ui, title, &curves, span(app), 0.1, now, height);
}

/// Active nodes of each level.
pub fn nodes(ui: &mut egui::Ui, app: &App) {
    let health = app.history().health();
    let levels = health.back().map_or(0, |last| last.nodes.len());
    let curves: Vec<Curve> = (0..levels)
        .map(|level| {
            let curve = points(health, |health| health.nodes.get(level).copied().unwrap_or(0) as f64);
            (format!("L{level}"), colour(colour::level(level)), curve)
        })
        .collect();
    show(ui, "active nodes", &curves, span(app), 10.0, None, HEIGHT);
}

/// How late ticks start.
pub fn lateness(ui: &mut egui::Ui, app: &App) {
    two(ui, app, "tick lateness since the start [µs]", ["p50", "p99"], 20.0, |health| health.lateness);
}

/// What ticks are planned to take, and what they may be.
pub fn planned(ui: &mut egui::Ui, app: &App) {
    two(ui, app, "a tick is planned to take [µs]", ["at most", "takes"], 100.0, |health| {
        [health.planned[1], health.planned[0]]
    });
}

/// A faint curve and a strong one of how the server fares.
fn two(ui: &mut egui::Ui, app: &App, title: &str, names: [&str; 2], least: f64, values: impl Fn(&Health) -> [f64; 2]) {
    let health = app.history().health();
    let curves = [FAINT, INK]
        .into_iter()
        .zip(names)
        .enumerate()
        .map(|(which, (ink, name))| (name.to_owned(), ink, points(health, |health| values(health)[which])));
    show(ui, title, &curves.collect::<Vec<_>>(), span(app), least, None, HEIGHT);
}

fn points<'a>(health: impl IntoIterator<Item = &'a Health>, value: impl Fn(&Health) -> f64) -> Vec<[f64; 2]> {
    health.into_iter().map(|health| [health.time, value(health)]).collect()
}

/// All of a recording, or the last seconds of a live session.
fn span(app: &App) -> (f64, f64) {
    let (first, last) = app.history().span();
    if app.recorded().is_some() { (first, last) } else { (last - SPAN, last) }
}

/// Plots `curves` over the time `span` [s], from 0 to their largest value, at least `least`; a line marks `now`.
fn show(ui: &mut egui::Ui, title: &str, curves: &[Curve], span: (f64, f64), least: f64, now: Option<f64>, height: f32) {
    let shown = |curve: &Curve| curve.2.iter().rev().take_while(|p| p[0] >= span.0).map(|p| p[1]).fold(0.0, f64::max);
    let largest = curves.iter().map(shown).fold(least, f64::max);
    ui.horizontal(|ui| {
        ui.label(RichText::new(title).size(12.5));
        for (name, ink, curve) in curves.iter().filter(|curve| !curve.0.is_empty()) {
            let value = curve.last().map_or(0.0, |point| point[1]);
            let words = if largest < 10.0 { format!("{name} {value:.2}") } else { format!("{name} {value:.0}") };
            let peak = curve.iter().map(|point| point[1]).fold(0.0, f64::max);
            let words = if now.is_some() { format!("{name}, at most {peak:.2}") } else { words };
            // Darker than the line: yellow cannot be read on paper.
            ui.label(RichText::new(words).size(11.5).color(ink.lerp_to_gamma(INK, 0.35)).strong());
        }
    });
    Plot::new(title)
        .height(height)
        .show_x(false)
        .show_y(false)
        .allow_drag(false)
        .allow_zoom(false)
        .allow_scroll(false)
        .allow_boxed_zoom(false)
        .allow_double_click_reset(false)
        .show_axes([now.is_some(), true])
        .show_grid([false, true])
        .y_axis_min_width(36.0)
        .y_grid_spacer(move |_| {
            let step_size = f64::from(round_number(0.6 * largest as f32));
            let values = (0..4).map(|number| f64::from(number) * step_size).filter(|value| *value <= largest);
            values.map(|value| GridMark { value, step_size }).collect()
        })
        .set_margin_fraction(egui::vec2(0.0, 0.0))
        .default_x_bounds(span.0, span.1.max(span.0 + 1e-3))
        .default_y_bounds(0.0, 1.08 * largest)
        .show(ui, |plot| {
            plot.set_plot_bounds_x(span.0..=span.1.max(span.0 + 1e-3));
            plot.set_plot_bounds_y(0.0..=1.08 * largest);
            for (name, ink, curve) in curves {
                plot.line(Line::new(name, PlotPoints::new(curve.clone())).color(*ink).width(1.6));
            }
            if let Some(now) = now {
                plot.vline(VLine::new("now", now).color(super::ACCENT).width(1.5));
            }
        });
}
