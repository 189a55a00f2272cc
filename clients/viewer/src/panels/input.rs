//! Mouse and keyboard.

use crate::app::{App, Pressing};
use crate::colour::Colouring;
use crate::pick::pick;
use crate::poke::Press;
use three_d::Viewport;
use three_d::egui::{self, Key, PointerButton, Sense};

/// What the keys and the mouse do, for the help.
pub const HELP: [(&str, &str); 13] = [
    ("drag", "turn"),
    ("right drag", "move"),
    ("wheel", "nearer, farther"),
    ("F", "whole body"),
    ("1 2 3 4", "colour by material, level, strain, displacement"),
    ("Space", "pause, go on"),
    ("R", "reset"),
    ("T", "take a tool, let it go"),
    ("press", "with a tool: poke; drag to stroke, wheel for depth, or to pull"),
    ("G", "open jaws, close them"),
    ("← →", "frame before, frame after (recording)"),
    ("P", "panels"),
    ("H", "this help"),
];

/// Depth that a press starts with, in diagonals of the body.
const FIRST_DEPTH: f32 = 0.04;
/// What a step of the wheel adds to it, in diagonals of the body.
const DEPTH_STEP: f32 = 0.004;
/// How far above the surface the wheel takes it at most, in diagonals of the body: jaws pull at what they hold. Chosen: with less little
/// is lifted, with more the hand soon leaves the picture.
const HIGHEST: f32 = 0.15;
/// Scroll of one step of a wheel [points].
const WHEEL: f32 = 24.0;

/// Obeys the keys.
pub fn keys(context: &egui::Context, app: &mut App) {
    let pressed = |key| context.input(|input| input.key_pressed(key));
    for (key, colouring) in [Key::Num1, Key::Num2, Key::Num3, Key::Num4].into_iter().zip(Colouring::ALL) {
        if pressed(key) {
            app.colouring = colouring;
        }
    }
    for (key, act) in [
        (Key::Space, App::toggle_pause as fn(&mut App)),
        (Key::R, App::reset),
        (Key::F, App::fit),
        (Key::T, App::toggle_poke),
        (Key::G, App::toggle_jaws),
        (Key::P, |app| app.panels = !app.panels),
        (Key::H, |app| app.help = !app.help),
        (Key::ArrowLeft, |app| app.step(false)),
        (Key::ArrowRight, |app| app.step(true)),
    ] {
        if pressed(key) {
            act(app);
        }
    }
}

/// Turns, moves and pokes what is in `rect`.
pub fn mouse(ui: &mut egui::Ui, rect: egui::Rect, app: &mut App) {
    let response = ui.allocate_rect(rect, Sense::click_and_drag());
    let scroll = if response.contains_pointer() { ui.input(|input| input.smooth_scroll_delta().y) } else { 0.0 };
    poke(ui, &response, scroll, app);
    let Some(orbit) = &mut app.orbit else { return };
    if app.pressing.is_some() {
        return;
    }
    let drag = response.drag_delta() / rect.height();
    if response.dragged_by(PointerButton::Primary) {
        orbit.turn(drag.x, drag.y);
    } else if response.dragged() {
        orbit.pan(drag.x, drag.y);
    }
    if scroll != 0.0 {
        orbit.zoom(scroll / WHEEL);
    }
}

/// Presses the mouse's tool where the pointer is on the organ, from the press until the button is let go.
fn poke(ui: &egui::Ui, response: &egui::Response, scroll: f32, app: &mut App) {
    let (Some(poke), Some(body), Some(orbit)) = (&app.poke, app.body(), app.orbit) else { return };
    let rect = response.rect;
    let viewport = Viewport::new_at_origo(rect.width().max(1.0) as u32, rect.height().max(1.0) as u32);
    let camera = orbit.camera(viewport);
    let hit = |positions: &[[f32; 3]]| {
        let pointer = response.interact_pointer_pos()?;
        let pixel = (pointer.x - rect.min.x, rect.max.y - pointer.y);
        let sight = camera.view_direction_at_pixel(pixel);
        let normals = body.deformation.normals(positions);
        pick(camera.position(), sight, positions, &app.shown_triangles(), &normals)
    };
    let began = ui.input(|input| input.pointer.primary_pressed()) && response.contains_pointer();
    let held = response.is_pointer_button_down_on() && ui.input(|input| input.pointer.primary_down());
    let pressing = match &app.pressing {
        Some(pressing) if held => {
            let depth = pressing.press.depth + scroll / WHEEL * DEPTH_STEP * body.size();
            let depth = depth.max(-HIGHEST * body.size());
            let place = hit(&pressing.surface).map_or(pressing.press, |hit| Press {
                point: hit.point,
                normal: hit.normal,
                depth,
            });
            Some(Pressing { surface: pressing.surface.clone(), press: Press { depth, ..place } })
        }
        None if began => hit(&app.moment().positions).map(|hit| Pressing {
            surface: app.moment().positions.clone(),
            press: Press { point: hit.point, normal: hit.normal, depth: FIRST_DEPTH * body.size() },
        }),
        _ => None,
    };
    poke.press(pressing.as_ref().map(|pressing| pressing.press));
    app.pressing = pressing;
}
