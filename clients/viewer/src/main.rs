//! The viewer as a program of its own; `palpate view` is the same.

use clap::Parser;
use std::process::ExitCode;

#[derive(Parser)]
#[command(name = "palpate-viewer", version, about = "Draws a running Palpate server, or a recording")]
struct Cli {
    #[command(flatten)]
    args: palpate_viewer::Args,
}

fn main() -> ExitCode {
    match palpate_viewer::run(Cli::parse().args, None) {
        Ok(()) => ExitCode::SUCCESS,
        Err(e) => {
            eprintln!("palpate-viewer: {e:#}");
            ExitCode::FAILURE
        }
    }
}
