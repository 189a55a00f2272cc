//! The command line of the studies.

use anyhow::{Context, bail};
use clap::Parser;
use clap::builder::{PossibleValuesParser, TypedValueParser};
use palpate::{say, tell};
use palpate_body::geometry::mesh_io::{LengthUnit, read_surface};
use std::path::PathBuf;
use std::process::ExitCode;

/// Regenerate the comparisons and the paper's figures, as CSV and pictures
#[derive(Parser)]
#[command(name = "palpate-study", version)]
struct Args {
    /// One of them, or `all`, which write a report; `list` names them
    #[arg(default_value = "all")]
    name: String,
    /// Folder for tables and pictures
    #[arg(long, default_value = "study")]
    out: PathBuf,
    /// File of an organ's closed surface to run the study `speed` on instead
    #[arg(long)]
    surface: Option<PathBuf>,
    /// Its unit of length
    #[arg(long, value_parser = length_unit(), default_value = "m")]
    unit: LengthUnit,
}

/// A unit by its name: the library that has the units does without clap.
fn length_unit() -> impl TypedValueParser<Value = LengthUnit> {
    PossibleValuesParser::new(LengthUnit::ALL.map(LengthUnit::name)).try_map(|name| name.parse::<LengthUnit>())
}

fn main() -> ExitCode {
    let Err(e) = run(&Args::parse()) else { return ExitCode::SUCCESS };
    // Most errors tell what caused them themselves.
    let mut text = String::new();
    for cause in e.chain().map(|cause| cause.to_string()).filter(|cause| !cause.is_empty()) {
        if !text.contains(&cause) {
            text += if text.is_empty() { "" } else { ": " };
            text += &cause;
        }
    }
    tell!("palpate-study: {text}");
    ExitCode::FAILURE
}

fn run(args: &Args) -> anyhow::Result<()> {
    let name = Some(args.name.as_str()).filter(|name| *name != "all");
    if name == Some("list") {
        for study in palpate_study::STUDIES {
            say!("{:<12} {}", study.name, study.about)?;
        }
        return Ok(());
    }
    let progress = |what: &str| tell!("{what}");
    let text = match &args.surface {
        None => palpate_study::run(name, &args.out, &progress)?,
        Some(_) if name != Some("speed") => {
            bail!("--surface is for the study 'speed' alone: palpate-study speed --surface FILE --unit mm")
        }
        Some(file) => {
            let surface = read_surface(file, args.unit).with_context(|| file.display().to_string())?;
            std::fs::create_dir_all(&args.out).with_context(|| args.out.display().to_string())?;
            palpate_study::touch::speed_on(&surface, &args.out, &progress)?
        }
    };
    say!("{text}pictures and tables: {}", args.out.display())?;
    Ok(())
}
