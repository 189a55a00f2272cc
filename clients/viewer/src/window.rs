//! The window: frames as fast as the display takes them.

use crate::app::App;
use crate::painter::Painter;
use std::panic::{AssertUnwindSafe, catch_unwind};
use three_d::{ClearState, FrameOutput, Window, WindowSettings};

/// Why there is no window.
#[derive(Debug, thiserror::Error)]
#[error("no window: {0}; `--snapshot FILE.png` draws without one")]
pub struct WindowError(String);

/// True where the environment names a display.
pub fn display_is_named() -> bool {
    ["DISPLAY", "WAYLAND_DISPLAY"].iter().any(|name| std::env::var_os(name).is_some_and(|value| !value.is_empty()))
}

/// Shows `app` until its window is closed, or for `seconds` when given.
///
/// # Errors
/// When there is no display, or no OpenGL on it.
pub fn show(mut app: App, title: &str, seconds: Option<f64>) -> Result<(), WindowError> {
    if !display_is_named() {
        return Err(WindowError("neither DISPLAY nor WAYLAND_DISPLAY is set".into()));
    }
    let settings = WindowSettings {
        title: title.to_owned(),
        initial_size: Some((1280, 800)),
        min_size: (640, 400),
        ..Default::default()
    };
    // The window library panics where the display cannot be reached.
    let window = catch_unwind(AssertUnwindSafe(|| Window::new(settings)))
        .map_err(|_| WindowError("the display cannot be reached".into()))?
        .map_err(|e| WindowError(e.to_string()))?;
    let mut painter = Painter::new(&window.gl());
    let mut pictures = 0u32;
    window.render_loop(move |mut frame| {
        if let Err(e) = app.advance(1e-3 * frame.elapsed_time) {
            app.say(e.to_string());
        }
        painter.prepare(&mut app, &mut frame.events, frame.accumulated_time, frame.viewport, frame.device_pixel_ratio);
        let screen = frame.screen();
        screen.clear(ClearState::color_and_depth(1.0, 1.0, 1.0, 1.0, 1.0));
        if let Err(e) = screen.write(|| painter.paint(&app)) {
            app.say(e.to_string());
        }
        pictures += 1;
        let shown = 1e-3 * frame.accumulated_time;
        let exit = seconds.is_some_and(|most| shown > most);
        if exit {
            println!("{pictures} pictures in {shown:.1} s: {:.1} a second", f64::from(pictures) / shown);
        }
        FrameOutput { exit, ..Default::default() }
    });
    Ok(())
}
