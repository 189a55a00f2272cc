//! The list of organs, where there are several: what each is, and whether it is shown.

use super::{FAINT, colour};
use crate::app::App;
use crate::colour::tissue;
use three_d::egui::{self, RichText};

/// Letters of a name that fit beside what is said of it.
const LONGEST_NAME: usize = 11;

/// Fills the list.
pub fn show(ui: &mut egui::Ui, app: &mut App) {
    let Some(body) = app.body() else { return };
    let surface = body.subject.surface.clone();
    if surface.organs.len() < 2 {
        return;
    }
    ui.separator();
    egui::Grid::new("organs").num_columns(4).min_col_width(0.0).spacing([8.0, 3.0]).show(ui, |ui| {
        for ((i, organ), hidden) in surface.organs.iter().enumerate().zip(&mut app.hidden) {
            ui.horizontal(|ui| {
                let (swatch, _) = ui.allocate_exact_size(egui::vec2(12.0, 12.0), egui::Sense::hover());
                ui.painter().rect_filled(swatch, 2.0, colour(tissue(i)));
                let mut shown = !*hidden;
                ui.checkbox(&mut shown, RichText::new(shortened(&organ.name)).size(13.0)).on_hover_text(&organ.name);
                *hidden = !shown;
            });
            let millilitres = format!("{:.0} mL", 1e6 * organ.volume);
            let stiffness = format!("{} kPa", round(1e-3 * organ.youngs_modulus));
            for words in [millilitres, stiffness, format!("{} vertices", organ.vertices)] {
                ui.label(RichText::new(words).size(12.0).color(FAINT));
            }
            ui.end_row();
        }
    });
}

/// A name as far as it fits.
fn shortened(name: &str) -> String {
    if name.chars().count() <= LONGEST_NAME {
        return name.to_owned();
    }
    name.chars().take(LONGEST_NAME - 1).chain(['…']).collect()
}

/// To two digits behind the point at most.
fn round(value: f64) -> f64 {
    (100.0 * value).round() / 100.0
}
