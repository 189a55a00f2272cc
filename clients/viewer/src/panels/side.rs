//! The panel at the side: what to choose, how the server fares, who is there.

use super::{FAINT, WARNING, organs, plots};
use crate::app::App;
use crate::colour::Colouring;
use crate::poke::Felt;
use three_d::egui::{self, RichText};

/// Fills the panel.
pub fn show(ui: &mut egui::Ui, app: &mut App) {
    ui.horizontal(|ui| {
        ui.label(RichText::new("colour").size(12.5).color(FAINT));
        for colouring in Colouring::ALL {
            ui.selectable_value(&mut app.colouring, colouring, colouring.short());
        }
    });
    if app.recorded().is_none() {
        live(ui, app);
    }
    organs::show(ui, app);
    ui.separator();
    if app.recorded().is_none() {
        plots::forces(ui, app, 92.0);
        plots::nodes(ui, app);
        plots::lateness(ui, app);
        plots::planned(ui, app);
        status(ui, app);
    } else {
        recording(ui, app);
    }
    ui.with_layout(egui::Layout::bottom_up(egui::Align::Min), |ui| {
        ui.label(RichText::new("H: keys and mouse").size(11.5).color(FAINT));
    });
}

/// The bundled scenes, where servers of them can be started.
fn scenes(ui: &mut egui::Ui, app: &mut App) {
    let names = app.scenes.as_ref().map_or(vec![], |scenes| scenes.names.clone());
    if names.is_empty() {
        return;
    }
    ui.menu_button("scene ⏷", |ui| {
        for name in names {
            if ui.button(&name).clicked() {
                app.choose_scene(&name);
                ui.close();
            }
        }
    });
}

/// Buttons that a live session obeys, and what the mouse's tool feels.
fn live(ui: &mut egui::Ui, app: &mut App) {
    ui.horizontal(|ui| {
        if ui.button(if app.paused { "go on" } else { "pause" }).clicked() {
            app.toggle_pause();
        }
        if ui.button("reset").clicked() {
            app.reset();
        }
        if ui.button(if app.poke.is_some() { "let the tool go" } else { "take a tool" }).clicked() {
            app.toggle_poke();
        }
        if let (Some(Felt::Held(tool, _)), Some(poke)) = (app.felt(), &app.poke)
            && app.body().is_some_and(|body| body.has_jaws(tool))
            && ui.button(if poke.has_jaws_open() { "close jaws" } else { "open jaws" }).clicked()
        {
            poke.toggle_jaws();
        }
        scenes(ui, app);
    });
    let (words, ink) = match app.felt() {
        None => return,
        Some(Felt::Waiting) => ("taking a tool …".to_owned(), FAINT),
        Some(Felt::Lost(why)) => (why, WARNING),
        Some(Felt::Held(tool, touch)) => {
            let name = app.body().and_then(|body| body.subject.tools.get(tool as usize)).map(|tool| tool.name.clone());
            let feels = match touch {
                Some(touch) => format!("{:.3} N, {} contact points", touch.newtons, touch.contact_points),
                None => "nothing yet".into(),
            };
            let depth = app.pressing.as_ref().map(|p| format!(", {:.0} mm deep", 1e3 * p.press.depth));
            (format!("{}: {feels}{}", name.unwrap_or_default(), depth.unwrap_or_default()), super::ACCENT)
        }
    };
    ui.label(RichText::new(words).size(13.0).color(ink));
}

/// The server in words.
fn status(ui: &mut egui::Ui, app: &App) {
    let status = app.status();
    ui.separator();
    let line = |ui: &mut egui::Ui, words: String| {
        ui.add(egui::Label::new(RichText::new(words).size(12.0)).wrap());
    };
    line(ui, format!("{:.1} Hz, {:.1} frames/s, {}", status.tick_rate_hz, status.surface_frames_hz, status.scheduling));
    let trouble = format!(
        "{:.1} missed deadlines a minute, {} stalls, stood still in {} ticks",
        status.missed_per_minute, status.stalls, status.unmoved_ticks
    );
    line(ui, trouble);
    let share = format!(
        "a tick is planned to take {:.0} µs, at most {:.0}; real-time threads take {:.0} % of a processor",
        status.work as f64 / 1e3,
        status.planned as f64 / 1e3,
        100.0 * status.real_time_share
    );
    line(ui, share);
    if let Some(recording) = status.recording.as_ref().filter(|recording| !recording.path.is_empty()) {
        line(ui, format!("recording, {} s, {:.1} MB", recording.ticks / 1000, recording.bytes as f64 / 1e6));
    }
    let present = if status.clients.is_empty() { "nobody".to_owned() } else { status.clients.join(", ") };
    line(ui, format!("holding a tool: {present}"));
}

/// What there is to know of a recording beside its curve.
fn recording(ui: &mut egui::Ui, app: &App) {
    let (Some(recording), Some(body)) = (app.recorded(), app.body()) else { return };
    let surface = &body.subject.surface;
    let rows = [
        ("made by", body.subject.made_by.clone()),
        ("length", format!("{:.1} s, {} frames", recording.duration(), recording.frames().len())),
        ("surface", format!("{} vertices", surface.rest_positions.len())),
        ("levels", body.subject.levels.to_string()),
        ("tools", body.subject.tools.iter().map(|tool| tool.name.clone()).collect::<Vec<_>>().join(", ")),
    ];
    egui::Grid::new("recording").num_columns(2).spacing([12.0, 5.0]).show(ui, |ui| {
        for (name, value) in rows {
            ui.label(RichText::new(name).size(12.5).color(FAINT));
            ui.label(RichText::new(value).size(12.5));
            ui.end_row();
        }
    });
    ui.separator();
    for tool in app.tools() {
        let newtons = three_d::InnerSpace::magnitude(tool.force);
        ui.label(RichText::new(format!("force now {newtons:.3} N")).size(14.0).color(super::ACCENT));
    }
}
