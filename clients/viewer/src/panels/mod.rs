//! What is written around and over the body, and what mouse and keyboard do.

mod input;
mod organs;
mod overlay;
mod plots;
mod side;
mod timeline;

use crate::app::App;
use three_d::egui::{self, CentralPanel, Color32, CornerRadius, Frame, Margin, Panel, Stroke};

/// Text and lines.
pub(crate) const INK: Color32 = Color32::from_rgb(38, 42, 50);
/// What matters less.
const FAINT: Color32 = Color32::from_rgb(112, 118, 128);
/// Behind panels.
const PAPER: Color32 = Color32::from_rgb(250, 251, 252);
/// What is on, or chosen.
const ACCENT: Color32 = Color32::from_rgb(28, 96, 200);
/// What needs attention.
const WARNING: Color32 = Color32::from_rgb(176, 84, 0);
/// Width of the panel at the side [points].
const SIDE: f32 = 304.0;
/// Height of the time line [points].
const TIMELINE: f32 = 116.0;

/// Sets colours, spacing and sizes of text.
pub fn style(context: &egui::Context) {
    context.set_theme(egui::Theme::Light);
    context.all_styles_mut(|style| {
        let widgets = &mut style.visuals.widgets;
        for state in [&mut widgets.noninteractive, &mut widgets.inactive, &mut widgets.hovered, &mut widgets.open] {
            state.fg_stroke.color = INK;
        }
        style.visuals.slider_trailing_fill = true;
        style.visuals.panel_fill = PAPER;
        style.visuals.selection.bg_fill = ACCENT;
        style.visuals.selection.stroke = Stroke::new(1.0, Color32::WHITE);
        style.spacing.item_spacing = egui::vec2(6.0, 5.0);
        style.interaction.selectable_labels = false;
    });
}

/// Shows everything and obeys; gives back the part [points] that is left for the body.
pub fn show(ui: &mut egui::Ui, app: &mut App) -> egui::Rect {
    input::keys(ui.ctx(), app);
    if app.panels {
        let frame = Frame::NONE.fill(PAPER).inner_margin(Margin::symmetric(12, 10));
        if app.recorded().is_some() {
            Panel::bottom("time line").exact_size(TIMELINE).resizable(false).frame(frame).show_inside(ui, |ui| {
                timeline::show(ui, app);
            });
        }
        Panel::right("side").exact_size(SIDE).resizable(false).frame(frame).show_inside(ui, |ui| side::show(ui, app));
    }
    let free = CentralPanel::default().frame(Frame::NONE).show_inside(ui, |ui| {
        let rect = ui.max_rect();
        input::mouse(ui, rect, app);
        overlay::show(ui, rect, app);
        rect
    });
    free.inner
}

/// A box for text over the body.
fn card() -> Frame {
    Frame::NONE
        .fill(PAPER.gamma_multiply(0.9))
        .corner_radius(CornerRadius::same(6))
        .inner_margin(Margin::symmetric(10, 7))
}

/// egui's colour for one of three-d's.
fn colour(of: three_d::Srgba) -> Color32 {
    Color32::from_rgb(of.r, of.g, of.b)
}
