//! `palpate doctor`: what this machine can hold.

use crate::SceneArgs;
use clap::Args;
use hdrhistogram::Histogram;
use palpate::realtime::clock::{Clock, Monotonic};
use palpate::realtime::scheduling::{self, Granted};
use palpate::say;
use palpate_body::prepare::forecast::forecast;
use palpate_core::model::step_class::TICK_NS;
use palpate_core::simulation::Part;
use std::process::ExitCode;

#[derive(Args)]
pub struct DoctorArgs {
    #[command(flatten)]
    scene: SceneArgs,
    /// How long to watch how late this machine wakes a thread [s]
    #[arg(long, default_value_t = 2.0)]
    seconds: f64,
}

pub fn run(args: &DoctorArgs) -> anyhow::Result<ExitCode> {
    let (loaded, body, _) = crate::build(&args.scene)?;
    say!("machine: {}", scheduling::machine())?;
    // On a thread of its own, which has the rights of the simulation thread and ends with them.
    let seconds = args.seconds.clamp(0.0, 600.0);
    let touched = body.clone();
    let (granted, lateness, forecast) = std::thread::spawn(move || {
        let granted = Granted::ask(None);
        (granted, lateness(seconds), forecast(&touched, || Monotonic.computed()))
    })
    .join()
    .map_err(|_| anyhow::anyhow!("the trial panicked"))?;
    say!("scheduling: {}", granted.describe())?;
    if let Some(warning) = granted.warning() {
        say!("warning: {warning}")?;
    }
    if let Some(limit) = real_time_limit() {
        say!("the kernel stops real-time threads above {:.0} % of a processor", 100.0 * limit)?;
    }
    let micros = |ns: u64| ns as f64 / 1e3;
    say!(
        "wake-up: p50 {:.0} µs late, p99 {:.0}, p99.9 {:.0}, at most {:.0}, of {} ticks",
        micros(lateness.value_at_quantile(0.5)),
        micros(lateness.value_at_quantile(0.99)),
        micros(lateness.value_at_quantile(0.999)),
        micros(lateness.max()),
        lateness.len()
    )?;
    let forecast = forecast.map_err(anyhow::Error::msg)?;
    say!("\n{:<40}{:>12}  an", "cost of a part", "ns")?;
    for part in Part::ALL {
        let ns = f64::from(forecast.prices.0[part.index()]) / 1e3;
        let (name, of) = part.describe();
        say!("{name:<40}{ns:>12.1}  {of}")?;
    }
    say!(
        "\n{}: {:.0} µs of each tick as it starts, of {:.0} that are there; under a touch about {} elements, {} evaluations, \
         at 1 kHz",
        loaded.scene.name,
        1e6 * forecast.floor,
        forecast.planned * 1e6,
        forecast.elements,
        forecast.evaluations
    )?;
    let fits = forecast.floor <= forecast.planned;
    if !fits {
        say!("this machine cannot serve it at 1 kHz: choose a coarser first level")?;
    }
    Ok(if fits { ExitCode::SUCCESS } else { ExitCode::FAILURE })
}

/// Part of a processor that the kernel lets real-time threads have; `None` where it does not tell, or has no limit.
fn real_time_limit() -> Option<f64> {
    let read = |name: &str| {
        let text = std::fs::read_to_string(format!("/proc/sys/kernel/sched_rt_{name}_us")).ok()?;
        text.trim().parse::<f64>().ok().filter(|us| *us > 0.0)
    };
    Some(read("runtime")? / read("period")?)
}

/// How late this thread wakes up [ns], tick for tick.
fn lateness(seconds: f64) -> Histogram<u64> {
    let mut histogram =
        Histogram::new_with_bounds(1, 60_000_000_000, 3).unwrap_or_else(|_| unreachable!("valid bounds"));
    let mut clock = Monotonic;
    let mut deadline = clock.now() + TICK_NS;
    let end = clock.now() + (seconds * 1e9) as u64;
    while deadline < end {
        clock.sleep_until(deadline);
        let now = clock.now();
        histogram.saturating_record((now - deadline).max(1));
        deadline += TICK_NS * (1 + (now - deadline) / TICK_NS);
    }
    histogram
}
