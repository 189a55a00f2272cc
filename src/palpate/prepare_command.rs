//! `palpate prepare`: mesh files to a body in one file, and what it is like.

use crate::progress::Progress;
use crate::writable;
use anyhow::{Context, bail};
use clap::Args;
use clap::builder::{PossibleValuesParser, TypedValueParser};
use palpate::realtime::clock::{Clock, Monotonic};
use palpate::say;
use palpate::scene::LoadedScene;
use palpate::scene::prepared::body_keys;
use palpate_body::geometry::mesh_io::LengthUnit;
use palpate_body::prepare::bodies::one_body;
use palpate_body::prepare::body_check::check;
use palpate_body::prepare::body_file::{BodyFile, Provenance};
use palpate_body::prepare::forecast::{LevelForecast, forecast};
use palpate_body::prepare::input::{Fineness, Input, shape};
use palpate_body::prepare::region::{Reach, keep_finest_within};
use palpate_body::prepare::report::{LevelReport, report};
use palpate_body::prepare::thin_walls::{Thin, ThinPlaces, thin_places};
use palpate_body::prepare::{self, Shape, prepare};
use palpate_core::math::{Bounds, Vec3};
use std::fmt::Write;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::sync::Arc;

/// Arguments of `prepare`.
#[derive(Args)]
pub struct PrepareArgs {
    /// A closed surface (OBJ, STL, PLY, OFF, glTF, VTK, VTP, Medit, MSH, INP), or tetrahedral meshes (MSH, VTK, VTU, TetGen,
    /// Medit, INP): several are the levels of one body
    #[arg(required = true)]
    inputs: Vec<PathBuf>,
    /// File to write
    #[arg(short, long, value_name = "FILE.palpate", required_unless_present = "check")]
    out: Option<PathBuf>,
    /// Unit of length of the files
    #[arg(long, value_parser = length_unit())]
    unit: LengthUnit,
    /// Further factor on their coordinates
    #[arg(long, default_value_t = 1.0)]
    scale: f64,
    /// Lattice constants of the levels, coarse to fine, as in 20mm,12mm,7mm
    #[arg(long, value_delimiter = ',', conflicts_with = "finest")]
    levels: Vec<Length>,
    /// Lattice constant of the finest level, as in 3mm; coarser ones follow
    #[arg(long)]
    finest: Option<Length>,
    /// The finest level covers only this region, in the files' own coordinates: a box x0,y0,z0,x1,y1,z1 or a ball
    /// x,y,z,radius
    #[arg(long, value_delimiter = ',', allow_hyphen_values = true, value_name = "NUMBERS")]
    finest_in: Vec<f64>,
    /// The array of labels, of several in the volume files, that regions of the material go by
    #[arg(long, value_name = "NAME")]
    labels: Option<String>,
    /// About how many vertices viewers get
    #[arg(long, default_value_t = prepare::DISPLAY_VERTICES)]
    display_vertices: usize,
    /// Scene whose material and holds the body is prepared for; scenes that use the body may have others
    #[arg(long, default_value = "organ")]
    scene: PathBuf,
    /// Override a key of that scene, as in material.youngs_modulus=8000
    #[arg(long = "set", value_name = "KEY=VALUE")]
    set: Vec<String>,
    /// Close holes of the surface that are at most this wide, as in 5mm
    #[arg(long, value_name = "WIDTH")]
    fill_holes: Option<Length>,
    /// Of several bodies in a file take the largest, and leave out the others
    #[arg(long)]
    largest: bool,
    /// Take a surface that crosses itself as it is
    #[arg(long)]
    allow_crossings: bool,
    /// Take a body of any size as it is
    #[arg(long)]
    any_size: bool,
    /// Draw a cut through each level into this file
    #[cfg(feature = "pictures")]
    #[arg(long, value_name = "FILE.png")]
    picture: Option<PathBuf>,
    /// Write nothing, only look
    #[arg(long)]
    check: bool,
}

/// A unit by its name: the library that has the units does without clap.
fn length_unit() -> impl TypedValueParser<Value = LengthUnit> {
    PossibleValuesParser::new(LengthUnit::ALL.map(LengthUnit::name)).try_map(|name| name.parse::<LengthUnit>())
}

/// A length as people write it: `3mm`, `0.3cm`.
#[derive(Clone, Debug, PartialEq)]
struct Length {
    metres: f64,
    text: String,
}

impl std::str::FromStr for Length {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let number = text.trim_end_matches(|c: char| c.is_ascii_alphabetic());
        let unit: LengthUnit = text[number.len()..].parse().map_err(|_| format!("'{text}': write it as in 3mm"))?;
        let length = number.trim().parse::<f64>().map_err(|_| format!("'{text}': write it as in 3mm"))?;
        // Divided, so that 13mm is the number that is nearest to 0.013.
        let metres = match unit {
            LengthUnit::Millimetre => length / 1000.0,
            LengthUnit::Centimetre => length / 100.0,
            LengthUnit::Metre | LengthUnit::Inch => length * unit.metres(),
        };
        if !(1e-5..=10.0).contains(&metres) {
            return Err(format!("'{text}': lengths are from 0.01 mm to 10 m"));
        }
        Ok(Length { metres, text: text.to_owned() })
    }
}

pub fn run(args: &PrepareArgs) -> anyhow::Result<ExitCode> {
    if !(1e-6..=1e6).contains(&args.scale) || !(50..=20_000).contains(&args.display_vertices) {
        bail!("--scale is from 1e-6 to 1e6, --display-vertices from 50 to 20000");
    }
    let scene_files = crate::SceneArgs { scene: args.scene.clone(), set: args.set.clone() }.inputs();
    let outputs = [("-o", args.out.as_ref().filter(|_| !args.check)), ("--picture", args.picture())];
    let writable_beside = |inputs: &[PathBuf]| {
        let all = || inputs.iter().chain(&args.inputs).chain(&scene_files).map(PathBuf::as_path);
        outputs
            .iter()
            .filter_map(|(option, path)| Some((option, (*path)?)))
            .try_for_each(|(o, p)| writable::file(o, p, all()))
    };
    writable_beside(&[])?;
    let mut progress = Progress::new();
    let fineness = args.fineness()?;
    let (mut files, mut solids, mut said) = (Vec::new(), Vec::new(), Vec::new());
    for (i, path) in args.inputs.iter().enumerate() {
        progress.show(&format!("reading {}", path.display()), i, args.inputs.len());
        let holes = args.fill_holes.as_ref().map_or(0.0, |width| width.metres);
        let input = Input::read(path, args.unit, args.scale, holes, args.labels.as_deref());
        let input = input.with_context(|| path.display().to_string())?;
        // What it is made of may be more files than were named.
        let folder = path.parent().unwrap_or(Path::new(""));
        let beside: Vec<PathBuf> = input.files.iter().map(|file| folder.join(&file.name)).collect();
        writable_beside(&beside)?;
        let (name, lines) = (input.files[0].name.clone(), input.said());
        let element = fineness.finest_element(&input.solid);
        let one = one_body(input.solid, element, args.largest).with_context(|| path.display().to_string());
        let (solid, dropped) = one?;
        said.extend(lines.into_iter().chain(dropped).map(|line| format!("{name}: {line}")));
        files.extend(input.files);
        solids.push(solid);
    }
    progress.show("checking shapes", 1, 1);
    check(&solids, args.unit, args.scale, args.any_size, args.allow_crossings)?;
    let shape = shape(solids, &fineness, args.display_vertices).map_err(anyhow::Error::msg)?;
    let mut loaded = LoadedScene::load(&args.scene, &args.set)?;
    loaded.scene.name = args.inputs[0].file_stem().unwrap_or_default().to_string_lossy().chars().take(64).collect();
    loaded.scene.body = body_keys();
    // The file is that of one body.
    loaded.scene.organ.clear();
    let recipe = loaded.recipe(shape);
    let mut body = prepare(&recipe, &mut |what, done, of| progress.show(what, done, of))?;
    if let Some(reach) = args.reach()? {
        progress.show("keeping the finest level in its region", 1, 1);
        body = keep_finest_within(body, &reach)?;
    }
    let provenance = Provenance {
        palpate: env!("CARGO_PKG_VERSION").into(),
        inputs: files,
        options: args.options(),
        scene: loaded.scene.to_toml(),
    };
    progress.show("touching it", 1, 1);
    let shared = Arc::new(body);
    let forecast = forecast(&shared, || Monotonic.computed()).map_err(anyhow::Error::msg)?;
    let body = Arc::into_inner(shared).context("the forecast keeps the body")?;
    let file = BodyFile { provenance, body };
    let body = &file.body;

    progress.show("looking at the levels", 1, 1);
    let report = report(body);
    let thin = match &recipe.shape {
        Shape::Closed { surface, .. } => {
            let around = surface.to_trimesh();
            body.levels().iter().map(|level| thin_places(surface, &around, level)).collect()
        }
        Shape::Meshes { .. } => vec![ThinPlaces::default(); body.levels().len()],
    };
    progress.finish("looked at the levels");
    let mut text = String::new();
    let size = body.surface().bounds().size();
    writeln!(
        text,
        "{}: {:.4} × {:.4} × {:.4} m, {:.4} L, {:.4} kg, slowest mode {:.2} Hz, held at {} points",
        body.name(),
        size.x,
        size.y,
        size.z,
        1e3 * body.parts().shape.volume,
        body.mass(),
        body.slowest_mode() / std::f64::consts::TAU,
        body.holds().len() + body.level(body.finest()).fixed.len()
    )?;
    for line in said {
        writeln!(text, "{line}")?;
    }
    if !report.labels.is_empty() {
        let share = |(label, share): &(i64, f64)| format!("{label} ({:.1} %)", 100.0 * share);
        let shares: Vec<String> = report.labels.iter().map(share).collect();
        writeln!(text, "labels '{}': {} of the volume", body.parts().labels.name, shares.join(", "))?;
    }
    write!(text, "{report}")?;
    for (r, (level, forecast)) in report.levels.iter().zip(&forecast.levels).enumerate() {
        writeln!(text, "level {r}: {}", in_words(level, forecast))?;
        for (what, thin) in [("walls thinner than an element", thin[r].walls), ("gaps that it bridges", thin[r].gaps)] {
            if let Some(Thin { part, thickness, at }) = thin {
                writeln!(
                    text,
                    "level {r}: {what}: {:.3} % of the surface, the thinnest {:.2} mm at ({:.4}, {:.4}, {:.4}) m",
                    100.0 * part,
                    1e3 * thickness,
                    at.x,
                    at.y,
                    at.z
                )?;
            }
        }
    }
    writeln!(
        text,
        "on this machine: {:.0} µs of each tick at rest; under a touch about {} elements in {:.0} µs",
        1e6 * forecast.floor,
        forecast.elements,
        1e6 * forecast.tick
    )?;
    if forecast.floor > forecast.planned {
        writeln!(text, "warning: this machine cannot serve it at 1 kHz; choose a coarser first level")?;
    }
    // Files first: who reads the report may be gone.
    #[cfg(feature = "pictures")]
    if let Some(file) = &args.picture {
        picture(file, body, &recipe.shape).with_context(|| file.display().to_string())?;
    }
    let usable = report.levels[0].can_be_stepped();
    if let Some(out) = args.out.as_ref().filter(|_| !args.check && usable) {
        let bytes = file.bytes();
        palpate::output::write(out, &bytes).with_context(|| out.display().to_string())?;
        writeln!(
            text,
            "{}: {:.1} MB; palpate demo --scene {}",
            out.display(),
            bytes.len() as f64 / 1e6,
            out.display()
        )?;
    }
    say!("{}", text.trim_end())?;
    if !usable {
        bail!("not even the coarsest level can be used: see the warnings");
    }
    Ok(ExitCode::SUCCESS)
}

/// Draws a cut through each level of `body`, which was made of `shape`: elements the paler, the less of them lies inside.
#[cfg(feature = "pictures")]
fn picture(file: &std::path::Path, body: &palpate_core::model::Body, shape: &Shape) -> anyhow::Result<()> {
    use palpate::picture::{Section, sections as draw};
    use palpate_body::prepare::section::Plane;
    use palpate_core::hierarchy::Level;
    let name = file.file_stem().context("the picture needs a file name")?.to_string_lossy();
    if file.extension().is_none_or(|e| e != "png") {
        bail!("pictures are PNG: name it {name}.png");
    }
    let surface = match shape {
        Shape::Closed { surface, .. } => surface,
        Shape::Meshes { .. } => body.surface(),
    };
    let Bounds { low, high } = surface.bounds();
    let plane = Plane::through(low, high);
    let section = |(r, level): (usize, &Level)| Section {
        title: format!("level {r}: {:.2} mm, {} elements", 1e3 * level.spacing, level.mesh.elements.len()),
        polygons: plane.cut(&level.mesh).into_iter().map(|(e, polygon)| (polygon, level.fraction[e])).collect(),
        outline: plane.outline(surface),
    };
    let sections: Vec<Section> = body.levels().iter().enumerate().map(section).collect();
    let title = format!("{}, cut at its middle, {:.0} mm wide", body.name(), 1e3 * (high - low).dot(&plane.right));
    draw(file.parent().unwrap_or(std::path::Path::new("")), &name, &title, &sections)?;
    Ok(())
}

/// What of a level runs in real time on this machine.
fn in_words(level: &LevelReport, forecast: &LevelForecast) -> String {
    let tick = 1e3 * forecast.tick;
    match forecast.reach {
        _ if !level.can_be_stepped() => "not in real time: its elements are too stiff for their size".into(),
        None => format!("in real time as a whole ({tick:.2} ms a tick)"),
        Some(reach) if forecast.elements > 0 => format!(
            "in real time around a touch: about {} elements, {:.0} mm around it ({tick:.1} ms a tick as a whole)",
            forecast.elements,
            1e3 * reach
        ),
        Some(_) => format!("not in real time on this machine: {tick:.1} ms a tick"),
    }
}

impl PrepareArgs {
    /// Where a picture goes, if anywhere.
    fn picture(&self) -> Option<&PathBuf> {
        #[cfg(feature = "pictures")]
        return self.picture.as_ref();
        #[cfg(not(feature = "pictures"))]
        None
    }

    fn fineness(&self) -> anyhow::Result<Fineness> {
        if self.levels.windows(2).any(|pair| pair[1].metres > 0.8 * pair[0].metres) || self.levels.len() > 8 {
            bail!("--levels: at most 8, coarse to fine, each at most 0.8 of the one before it");
        }
        Ok(match &self.finest {
            Some(finest) => Fineness::Finest(finest.metres),
            None if self.levels.is_empty() => Fineness::Automatic,
            None => Fineness::Levels(self.levels.iter().map(|l| l.metres).collect()),
        })
    }

    /// Where the finest level is to be [m].
    fn reach(&self) -> anyhow::Result<Option<Reach>> {
        let numbers: Vec<f64> = self.finest_in.iter().map(|x| x * self.unit.metres() * self.scale).collect();
        let point = |at: usize| Vec3::from_row_slice(&numbers[at..at + 3]);
        Ok(match numbers.len() {
            0 => None,
            4 => Some(Reach::Ball(point(0), numbers[3])),
            6 => Some(Reach::Box(Bounds::of([point(0), point(3)]))),
            n => bail!("--finest-in: {n} numbers; a box has 6 (x0,y0,z0,x1,y1,z1), a ball 4 (x,y,z,radius)"),
        })
    }

    /// What decides the body beside files and scene, as on the command line.
    fn options(&self) -> String {
        let mut options = format!("--unit {} --display-vertices {}", self.unit, self.display_vertices);
        if self.scale != 1.0 {
            options += &format!(" --scale {}", self.scale);
        }
        if !self.levels.is_empty() {
            let levels: Vec<&str> = self.levels.iter().map(|l| l.text.as_str()).collect();
            options += &format!(" --levels {}", levels.join(","));
        }
        if let Some(finest) = &self.finest {
            options += &format!(" --finest {}", finest.text);
        }
        if let Some(name) = &self.labels {
            options += &format!(" --labels {name}");
        }
        if self.largest {
            options += " --largest";
        }
        if let Some(width) = &self.fill_holes {
            options += &format!(" --fill-holes {}", width.text);
        }
        if !self.finest_in.is_empty() {
            let numbers: Vec<String> = self.finest_in.iter().map(f64::to_string).collect();
            options += &format!(" --finest-in {}", numbers.join(","));
        }
        options
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lengths_are_read_with_their_unit_and_refused_without() {
        for (text, length) in [("3mm", 0.003), ("0.5cm", 0.005), ("1in", 0.0254), ("0.02 m", 0.02)] {
            assert!((text.parse::<Length>().unwrap().metres - length).abs() < 1e-15, "{text}");
        }
        for text in ["3", "mm", "3 feet", "-3mm", "NaNmm", "1e9m"] {
            assert!(text.parse::<Length>().unwrap_err().contains(text), "{text}");
        }
    }
}
