//! What a viewer is told on the command line.

use crate::app::App;
use crate::colour::Colouring;
use crate::scenes::Scenes;
use crate::snapshot::{Photographer, SIDES};
use crate::source::Recording;
use crate::window;
use anyhow::{Context, bail};
use palpate_sdk::Endpoints;
use palpate_sdk::proto::keys;
use std::path::PathBuf;
use std::time::{Duration, Instant};

/// What to draw, and where.
#[derive(Clone, Debug, clap::Args)]
pub struct Args {
    /// Recording (MCAP) to play; without one, a running server is watched
    pub file: Option<PathBuf>,
    /// Session name of the server
    #[arg(long, default_value = keys::DEFAULT_SESSION)]
    pub session: String,
    /// Where the server sends the surface from
    #[arg(long, visible_alias = "connect", default_value = keys::DEFAULT_SURFACE_ENDPOINT)]
    pub surface_endpoint: String,
    /// Where the server takes poses, to poke with the mouse
    #[arg(long, default_value = keys::DEFAULT_FORCE_ENDPOINT)]
    pub force_endpoint: String,
    /// Folder of your certificate, where the server asks for one
    #[arg(long, value_name = "FOLDER")]
    pub identity: Option<PathBuf>,
    /// Write one picture into this file (PNG) instead of opening a window; needs no display
    #[arg(long, value_name = "FILE")]
    pub snapshot: Option<PathBuf>,
    /// When [s]: after a recording's first frame, or after a server's first one has come
    #[arg(long, default_value_t = 0.0)]
    pub at: f64,
    /// Size of the picture
    #[arg(long, default_value = "1280x800", value_name = "WIDTHxHEIGHT", value_parser = size)]
    pub size: (u32, u32),
    /// What the organ's colour shows
    #[arg(long, visible_alias = "color", value_enum, default_value = "material")]
    pub colour: Colouring,
    /// The body alone, without plots and buttons
    #[arg(long)]
    pub no_panels: bool,
    /// Look from the right of the front by this angle [degrees]
    #[arg(long, default_value_t = -28.0, allow_hyphen_values = true)]
    pub yaw: f32,
    /// Look from above the horizon by this angle [degrees]
    #[arg(long, default_value_t = 28.0, allow_hyphen_values = true)]
    pub pitch: f32,
    /// How much nearer than to see the whole body
    #[arg(long, default_value_t = 1.0)]
    pub zoom: f32,
    /// Close the window after this long [s]
    #[arg(long)]
    pub seconds: Option<f64>,
}

/// How long a picture of a live session waits for its first frame.
const PATIENCE: Duration = Duration::from_secs(10);

fn size(text: &str) -> Result<(u32, u32), String> {
    let sides = text.split_once('x').and_then(|(width, height)| Some((width.parse().ok()?, height.parse().ok()?)));
    let fits = |side: &u32| SIDES.contains(side);
    sides.filter(|(width, height)| fits(width) && fits(height)).ok_or_else(|| {
        format!("give width and height from {} to {} pixels, as in 1280x800", SIDES.start(), SIDES.end())
    })
}

impl Args {
    fn endpoints(&self) -> Endpoints {
        Endpoints {
            force: self.force_endpoint.clone(),
            surface: self.surface_endpoint.clone(),
            session: self.session.clone(),
            identity: self.identity.clone(),
        }
    }

    fn app(&self) -> anyhow::Result<App> {
        if !(self.at.is_finite() && self.zoom.is_finite() && self.zoom > 0.0) {
            bail!("--at and --zoom take finite numbers, --zoom one above 0");
        }
        let mut app = match &self.file {
            Some(file) => App::recording(Recording::open(file)?)?,
            None => App::live(&self.endpoints()),
        };
        app.colouring = self.colour;
        app.panels = !self.no_panels;
        app.angle = crate::orbit::Angle { yaw: self.yaw.to_radians(), pitch: self.pitch.to_radians(), zoom: self.zoom };
        app.fit();
        Ok(app)
    }
}

/// Opens a window, or writes a picture. `scenes` can be chosen from in the window.
///
/// # Errors
/// When the recording cannot be read, nothing comes from the server, or there is no display or OpenGL.
pub fn run(args: Args, scenes: Option<Scenes>) -> anyhow::Result<()> {
    let mut app = args.app()?;
    app.scenes = scenes;
    let Some(file) = &args.snapshot else {
        let title = args.file.as_ref().map_or_else(|| "Palpate".into(), |file| format!("Palpate: {}", file.display()));
        return Ok(window::show(app, &title, args.seconds)?);
    };
    if app.recorded().is_some() {
        app.paused = true;
        app.time = args.at;
        app.advance(0.0)?;
    } else {
        watch(&mut app, args.at)?;
    }
    let picture = Photographer::new()?.take(&mut app, args.size.0, args.size.1)?;
    picture.write(file).with_context(|| file.display().to_string())
}

/// Takes what comes for `seconds` from the first frame on.
fn watch(app: &mut App, seconds: f64) -> anyhow::Result<()> {
    let began = Instant::now();
    let mut first = None;
    while first.is_none_or(|first: Instant| first.elapsed().as_secs_f64() < seconds) {
        std::thread::sleep(Duration::from_millis(10));
        app.advance(0.0)?;
        if app.moment().tick > 0 {
            first.get_or_insert_with(Instant::now);
        } else if began.elapsed() > PATIENCE {
            bail!("nothing to see: {}", app.notice().unwrap_or("no frame came"));
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_size_is_two_sides_within_bounds() {
        assert_eq!(size("1280x800"), Ok((1280, 800)));
        for bad in ["1280", "1280x", "x800", "1280x-8", "10x800", "1280x80000", "1280×800"] {
            assert!(size(bad).unwrap_err().contains("1280x800"), "{bad}");
        }
    }
}
