//! One picture: panels around, the body in what they leave free. The same for a window and for a file.

use crate::app::App;
use crate::panels;
use crate::scene::Scene;
use std::time::{Duration, Instant};
use three_d::{Camera, Context, CoreError, Event, GUI, Viewport, egui};

/// How long the parts of a picture took.
#[derive(Clone, Copy, Debug, Default)]
pub struct Spent {
    /// Layout of the panels and what the user did.
    pub panels: Duration,
    /// Normals, colours and their way to the graphics card.
    pub mesh: Duration,
}

/// Draws pictures with one OpenGL context.
pub struct Painter {
    gui: GUI,
    scene: Scene,
    cameras: Option<[Camera; 2]>,
}

impl Painter {
    /// With `context`, which stays current as long as this lives.
    pub fn new(context: &Context) -> Self {
        let gui = GUI::new(context);
        panels::style(gui.context());
        Self { gui, scene: Scene::new(context), cameras: None }
    }

    /// Lays out the panels, lets them take what mouse and keyboard did, and takes over how the body looks.
    ///
    /// `viewport` is all of the picture, `milliseconds` the time since the start, `pixels_per_point` the screen's scale.
    pub fn prepare(
        &mut self,
        app: &mut App,
        events: &mut [Event],
        milliseconds: f64,
        viewport: Viewport,
        pixels_per_point: f32,
    ) -> Spent {
        let began = Instant::now();
        let mut free = egui::Rect::ZERO;
        self.gui.update(events, milliseconds, viewport, pixels_per_point, |ui| free = panels::show(ui, app));
        // Panels count points from above, OpenGL pixels from below.
        let pixels = |points: f32| (points * pixels_per_point).round() as i32;
        let region = Viewport {
            x: pixels(free.min.x),
            y: viewport.height as i32 - pixels(free.max.y),
            width: pixels(free.width()).max(1) as u32,
            height: pixels(free.height()).max(1) as u32,
        };
        let whole = Camera::new_2d(viewport);
        self.cameras = app.orbit.map(|orbit| [whole, orbit.camera(region)]);
        let panels = began.elapsed();
        self.scene.update(app);
        Spent { panels, mesh: began.elapsed() - panels }
    }

    /// Draws what was prepared into the render target that is being written.
    pub fn paint(&mut self, app: &App) -> Result<(), CoreError> {
        if let Some([whole, camera]) = &self.cameras {
            self.scene.draw(app, whole, camera);
        }
        self.gui.render()
    }
}
