//! The time line of a recording: the force over all of it, and where it stands.

use super::plots;
use crate::app::App;
use three_d::egui::{self, RichText};

/// Fills the panel.
pub fn show(ui: &mut egui::Ui, app: &mut App) {
    let Some(duration) = app.recorded().map(|recording| recording.duration()) else { return };
    ui.horizontal(|ui| {
        if ui.button("◀").clicked() {
            app.step(false);
        }
        if ui.add_sized([54.0, 20.0], egui::Button::new(if app.paused { "play" } else { "pause" })).clicked() {
            app.toggle_pause();
        }
        if ui.button("▶").clicked() {
            app.step(true);
        }
        ui.spacing_mut().slider_width = (ui.available_width() - 130.0).max(60.0);
        let slider = egui::Slider::new(&mut app.time, 0.0..=duration.max(1e-3)).show_value(false);
        if ui.add(slider).changed() {
            app.paused = true;
        }
        ui.label(RichText::new(format!("{:.2} s of {duration:.2} s", app.time)).size(13.0));
    });
    plots::forces(ui, app, 52.0);
}
