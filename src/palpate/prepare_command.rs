//! `palpate prepare`: mesh files to a body in one file, and what it is like.

use crate::progress::Progress;
use anyhow::{Context, bail};
use clap::Args;
use clap::builder::{PossibleValuesParser, TypedValueParser};
use palpate::preparation::{Preparation, Prepared};
use palpate::realtime::clock::{Clock, Monotonic};
use palpate::say;
use palpate_body::geometry::mesh_io::LengthUnit;
use palpate_body::prepare::body_file::BodyFile;
use palpate_body::prepare::forecast::{LevelForecast, forecast};
use palpate_body::prepare::input::Fineness;
use palpate_body::prepare::report::{LevelReport, report};
use palpate_body::prepare::thin_walls::{Thin, ThinPlaces, thin_places};
use palpate_body::prepare::{DISPLAY_VERTICES, Shape};
use palpate_core::model::active_mesh::contact_row::support;
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
    #[arg(long, value_delimiter = ',', conflicts_with = "finest", value_parser = length)]
    levels: Vec<f64>,
    /// Lattice constant of the finest level, as in 3mm; coarser ones follow
    #[arg(long, value_parser = length)]
    finest: Option<f64>,
    /// The finest level covers only this region, in the files' own coordinates: a box x0,y0,z0,x1,y1,z1 or a ball
    /// x,y,z,radius
    #[arg(long, value_delimiter = ',', allow_hyphen_values = true, value_name = "NUMBERS")]
    finest_in: Vec<f64>,
    /// The array of labels, of several in the volume files, that regions of the material go by
    #[arg(long, value_name = "NAME")]
    labels: Option<String>,
    /// About how many vertices viewers get
    #[arg(long, default_value_t = DISPLAY_VERTICES)]
    display_vertices: usize,
    /// Scene whose material and holds the body is prepared for; scenes that use the body may have others
    #[arg(long, default_value = "organ")]
    scene: PathBuf,
    /// Override a key of that scene, as in material.youngs_modulus=8000
    #[arg(long = "set", value_name = "KEY=VALUE")]
    set: Vec<String>,
    /// Close holes of the surface that are at most this wide, as in 5mm
    #[arg(long, value_name = "WIDTH", value_parser = length)]
    fill_holes: Option<f64>,
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

/// A length as people write it, `3mm`, `0.3cm`, in metres.
fn length(text: &str) -> Result<f64, String> {
    let number = text.trim_end_matches(|c: char| c.is_ascii_alphabetic());
    let unit: LengthUnit = text[number.len()..].parse().map_err(|_| format!("'{text}': write it as in 3mm"))?;
    let length = number.trim().parse::<f64>().map_err(|_| format!("'{text}': write it as in 3mm"))?;
    // Divided, so that 13mm is the number that is nearest to 0.013.
    let metres = match unit {
        LengthUnit::Millimetre => length / 1000.0,
        LengthUnit::Centimetre => length / 100.0,
        LengthUnit::Metre | LengthUnit::Inch => length * unit.metres(),
    };
    if (1e-5..=10.0).contains(&metres) {
        Ok(metres)
    } else {
        Err(format!("'{text}': lengths are from 0.01 mm to 10 m"))
    }
}

pub fn run(args: &PrepareArgs) -> anyhow::Result<ExitCode> {
    let outputs = [("-o", args.out.as_ref().filter(|_| !args.check)), ("--picture", args.picture())];
    let outputs: Vec<(&str, &Path)> =
        outputs.iter().filter_map(|(option, path)| Some((*option, path.as_ref()?.as_path()))).collect();
    let mut progress = Progress::new();
    let prepared = args.preparation().run(&outputs, &mut |what, done, of| progress.show(what, done, of))?;
    let Prepared { file: BodyFile { provenance, body }, shape, said } = prepared;
    progress.show("touching it", 1, 1);
    let shared = Arc::new(body);
    let forecast = forecast(&shared, || Monotonic.computed()).map_err(anyhow::Error::msg)?;
    let body = Arc::into_inner(shared).context("the forecast keeps the body")?;
    let file = BodyFile { provenance, body };
    let body = &file.body;

    progress.show("looking at the levels", 1, 1);
    let report = report(body);
    let thin = match &shape {
        Shape::Closed { surface, .. } => {
            let around = surface.to_trimesh();
            let looked = |level| thin_places(surface, &around, level, support(body));
            body.levels().iter().map(looked).collect()
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
        body.supports().len() + body.level(body.finest()).fixed.len()
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
        // Coarser levels are not what is felt.
        let spread = thin[r].spread.filter(|_| r == body.finest());
        for (what, thin) in [
            ("walls thinner than an element", thin[r].walls),
            ("gaps that it bridges", thin[r].gaps),
            ("too thin for what a touch is spread over, and felt too soft", spread),
        ] {
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
        picture(file, body, &shape).with_context(|| file.display().to_string())?;
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
    use palpate_core::math::Bounds;
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

    fn preparation(&self) -> Preparation {
        Preparation {
            inputs: self.inputs.clone(),
            unit: self.unit,
            scale: self.scale,
            fineness: match self.finest {
                Some(finest) => Fineness::Finest(finest),
                None if self.levels.is_empty() => Fineness::Automatic,
                None => Fineness::Levels(self.levels.clone()),
            },
            finest_in: self.finest_in.clone(),
            labels: self.labels.clone(),
            display_vertices: self.display_vertices,
            scene: self.scene.clone(),
            set: self.set.clone(),
            fill_holes: self.fill_holes.unwrap_or(0.0),
            largest: self.largest,
            allow_crossings: self.allow_crossings,
            any_size: self.any_size,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lengths_are_read_with_their_unit_and_refused_without() {
        for (text, length) in [("3mm", 0.003), ("0.5cm", 0.005), ("1in", 0.0254), ("0.02 m", 0.02)] {
            assert!((super::length(text).unwrap() - length).abs() < 1e-15, "{text}");
        }
        for text in ["3", "mm", "3 feet", "-3mm", "NaNmm", "1e9m"] {
            assert!(length(text).unwrap_err().contains(text), "{text}");
        }
    }
}
