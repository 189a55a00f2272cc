//! `palpate export`: a recording for other tools.

use anyhow::Context;
use clap::{ArgGroup, Args};
use palpate::export::{self, Series};
use palpate::recording::Recording;
use palpate::{say, tell, writable};
use std::num::NonZeroUsize;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

/// Arguments of `export`.
#[derive(Args)]
#[command(group = ArgGroup::new("outputs").required(true).multiple(true))]
pub struct ExportArgs {
    /// The recording
    file: PathBuf,
    /// Poses and wrenches, a row for each tick of each held tool (CSV)
    #[arg(long, value_name = "FILE.csv", group = "outputs")]
    table: Option<PathBuf>,
    /// Folder for the surface as a series of VTU files, with surface.pvd for ParaView
    #[arg(long, value_name = "FOLDER", group = "outputs")]
    surface: Option<PathBuf>,
    /// Surface, tools and wrenches for Foxglove (MCAP)
    #[arg(long, value_name = "FILE.mcap", group = "outputs")]
    foxglove: Option<PathBuf>,
    /// Of the surface every frame, or every second, third …
    #[arg(long, default_value_t = NonZeroUsize::MIN)]
    every: NonZeroUsize,
}

pub fn run(args: &ExportArgs) -> anyhow::Result<ExitCode> {
    let input = || [args.file.as_path()];
    for (option, path) in [("--table", &args.table), ("--foxglove", &args.foxglove)] {
        path.iter().try_for_each(|path| writable::file(option, path, input()))?;
    }
    if let Some(folder) = &args.surface {
        writable::folder("--surface", folder)?;
    }
    let recording = Recording::read(&args.file)?;
    if let Some(cut) = &recording.cut {
        tell!("cut after tick {}: {cut}", recording.inputs.last().map_or(0, |inputs| inputs.0));
    }
    let every = args.every.get();
    let series = Series::of(&recording, every);
    if let Some(folder) = &args.surface {
        series.files(folder).iter().try_for_each(|file| writable::file("--surface", file, input()))?;
    }
    let about = |path: &Path| path.display().to_string();
    // Files first: who reads what is said may be gone.
    let mut said = Vec::new();
    if let Some(path) = &args.table {
        let rows = export::write_table(&recording, path).with_context(|| about(path))?;
        said.push(format!("{}: {rows} rows", about(path)));
    }
    if let Some(folder) = &args.surface {
        let frames = export::write_series(&recording, &series, folder).with_context(|| about(folder))?;
        said.push(format!("{}: {frames} frames, listed in surface.pvd", about(folder)));
    }
    if let Some(path) = &args.foxglove {
        let frames = export::write_foxglove(&recording, every, path).with_context(|| about(path))?;
        said.push(format!("{}: {frames} frames", about(path)));
    }
    say!("{}", said.join("\n"))?;
    Ok(ExitCode::SUCCESS)
}
