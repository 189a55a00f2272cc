//! `palpate-phantom`: holds a virtual haptic device against a server and reports what it felt.
#![allow(rustdoc::broken_intra_doc_links)] // units stand in square brackets: [m]

use std::{
    io::{IsTerminal, Write},
    path::PathBuf,
    sync::{
        Arc,
        atomic::{AtomicBool, Ordering::Relaxed},
        mpsc::sync_channel,
    },
    thread,
};

use anyhow::{Context, Result, ensure};
use clap::Parser;
use palpate_phantom::{Device, Live, Network, Options, Pattern, Vec3, run};
use palpate_sdk::Endpoints;

/// A virtual haptic device and the hand that holds it: presses on the body of a Palpate server and reports.
#[derive(Parser)]
#[command(version)]
struct Arguments {
    /// Endpoint of the server's force channel.
    #[arg(long, default_value_t = Endpoints::default().force)]
    force_endpoint: String,
    /// Endpoint of everything else.
    #[arg(long, default_value_t = Endpoints::default().surface)]
    surface_endpoint: String,
    /// Session name of the server.
    #[arg(long, default_value_t = Endpoints::default().session)]
    session: String,
    /// Folder of this client's certificate, where the server asks for one.
    #[arg(long, value_name = "FOLDER")]
    identity: Option<PathBuf>,
    /// Device to model: Touch, PHANTOM Omni, PHANTOM Desktop, Touch X, PHANTOM Premium 1.5 6DOF, omega.
    #[arg(long, default_value = "PHANTOM Omni", value_parser = Device::by_name)]
    device: Device,
    /// Device to model, from a TOML file with its limits.
    #[arg(long, conflicts_with = "device")]
    device_file: Option<PathBuf>,
    #[command(flatten)]
    network: Network,
    /// What the hand does.
    #[arg(long, value_enum, ignore_case = true, default_value = "press")]
    pattern: Pattern,
    /// How far below the surface the hand wants to go [m].
    #[arg(long, default_value_t = Options::default().depth)]
    depth: f64,
    /// Poses per second [Hz], up to 1000; about 80 for a headset.
    #[arg(long, default_value_t = Options::default().rate_hz)]
    rate_hz: f64,
    /// How much faster the device's clock runs than this machine's, as a fraction; crystals differ by up to 1e-4.
    #[arg(long, default_value_t = Options::default().clock_drift, allow_hyphen_values = true)]
    clock_drift: f64,
    /// Length of the run [s]; without it the run goes on until Ctrl-C.
    #[arg(long)]
    seconds: Option<f64>,
    /// Tool to take, by name; without it any free one.
    #[arg(long, default_value = "")]
    tool: String,
    /// Surface point to touch, x,y,z [m]; without it the top, where the first organ is.
    #[arg(long, value_parser = vector, requires = "normal", allow_hyphen_values = true)]
    site: Option<Vec3>,
    /// Outward normal there, x,y,z.
    #[arg(long, value_parser = vector, requires = "site", allow_hyphen_values = true)]
    normal: Option<Vec3>,
    /// Leave out the bare round trips beside the poses.
    #[arg(long)]
    no_echo: bool,
    /// Also write the report to this file, as JSON.
    #[arg(long)]
    json: Option<PathBuf>,
}

fn main() -> Result<()> {
    let arguments = Arguments::parse();
    let options = Options {
        endpoints: Endpoints {
            force: arguments.force_endpoint,
            surface: arguments.surface_endpoint,
            session: arguments.session,
            identity: arguments.identity,
        },
        device: arguments.device_file.map_or(Ok(arguments.device), Device::from_file)?,
        render: arguments.network.render,
        link: arguments.network.conditions()?,
        seed: arguments.network.seed,
        pattern: arguments.pattern,
        depth: arguments.depth,
        rate_hz: arguments.rate_hz,
        clock_drift: arguments.clock_drift,
        seconds: arguments.seconds,
        tool: arguments.tool,
        site: arguments.site.zip(arguments.normal),
        echo: !arguments.no_echo,
        ..Options::default()
    };
    let stop = Arc::new(AtomicBool::new(false));
    let stopping = stop.clone();
    ctrlc::set_handler(move || stopping.store(true, Relaxed)).context("cannot catch Ctrl-C")?;

    let report = run(&options, &stop, &mut watcher())?;
    println!("{report}");
    if let Some(file) = arguments.json {
        std::fs::write(&file, report.to_json() + "\n").with_context(|| format!("cannot write {}", file.display()))?;
    }
    Ok(())
}

/// Shows the run on a terminal, from a thread of its own: a terminal may block, the device loop may not.
fn watcher() -> impl FnMut(&Live) {
    let (sender, lives) = sync_channel::<Live>(1);
    thread::spawn(move || {
        let mut terminal = std::io::stderr();
        if !terminal.is_terminal() {
            return;
        }
        for live in lives {
            let force = Vec3::from(live.sample.force).norm();
            // Nothing is lost when the terminal is gone.
            let _ = write!(
                terminal,
                "\r{:8.1} s  {:6.3} N  {:2} contacts  pose to wrench {:.0} / {:.0} µs  {} missed   ",
                live.sample.time,
                force,
                live.contact_points,
                live.round_trip_p50,
                live.round_trip_p99,
                live.missed_wrenches
            );
        }
        let _ = writeln!(terminal);
    });
    move |live| {
        // A full channel means that the terminal is slow: this one is left out.
        let _ = sender.try_send(*live);
    }
}

fn vector(text: &str) -> Result<Vec3> {
    let numbers = text.split(',').map(|number| number.trim().parse::<f64>()).collect::<Result<Vec<_>, _>>()?;
    ensure!(numbers.len() == 3, "expected x,y,z");
    Ok(Vec3::from_column_slice(&numbers))
}
