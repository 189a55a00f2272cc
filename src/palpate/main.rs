//! The command line: arguments, start, wait, stop.

mod certificates_command;
mod companion;
mod demo;
mod doctor;
mod ending;
mod export_command;
mod list_command;
mod metrics_page;
mod prepare_command;
mod progress;
mod set_command;
#[cfg(feature = "web")]
mod web_command;

use anyhow::{Context, bail};
use clap::builder::{PossibleValuesParser, TypedValueParser};
use clap::{Args, Parser, Subcommand};
use palpate::offline::{self, SampleWriter, Trajectory};
use palpate::realtime::scheduling;
use palpate::recording::{Recording, RecordingWriter, replay};
use palpate::scene::LoadedScene;
use palpate::server::{self, Reach, Roles, Server, Trust};
use palpate::{say, tell, writable};
use palpate_core::model::element_kernel::Simd;
use palpate_core::simulation::{Inputs, ParameterRanges, Simulation, Snapshot, TICK};
use palpate_proto::{self as proto, keys};
use std::io::IsTerminal;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::sync::Arc;

#[derive(Parser)]
#[command(name = "palpate", version, about = "Touch soft bodies in real time")]
struct Cli {
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    /// Build an organ, serve it, and let the virtual Phantom touch it, in a window, a browser or the terminal
    Demo(demo::DemoArgs),
    /// Watch a running server, or play a recording, in a window or into a picture
    #[cfg(feature = "viewer")]
    View(palpate_viewer::Args),
    /// Serve a page on which browsers and headsets watch and touch what a running server simulates
    #[cfg(feature = "web")]
    Web(web_command::WebArgs),
    /// Say what this machine can hold: scheduling, wake-ups, the cost of each part of a tick, elements at 1 kHz
    Doctor(doctor::DoctorArgs),
    /// Serve a scene to remote tools and viewers
    Serve(ServeArgs),
    /// Run a scene without a network, as fast as it goes
    Simulate(SimulateArgs),
    /// Make a body from mesh files, look at it, and write it into one file that scenes load at once
    Prepare(prepare_command::PrepareArgs),
    /// Make certificates for a server and for each name of its roles file
    Certificates(certificates_command::CertificatesArgs),
    /// Start a recording on a running server, and stop it again
    Record(RecordArgs),
    /// Change stiffness, gravity and more of a running server, or list what can be changed
    Set(set_command::SetArgs),
    /// List the servers that a server or a zenoh router knows
    List(list_command::ListArgs),
    /// Run a recording again and compare bit for bit
    Replay(ReplayArgs),
    /// Write a recording for other tools: a table, a series for ParaView, a file for Foxglove
    Export(export_command::ExportArgs),
}

/// What a scene can be.
fn scene_help() -> String {
    format!("Scene file, prepared body (.palpate), or a bundled scene: {}", palpate::scene::bundled_names())
}

/// What to simulate.
#[derive(Args)]
struct SceneArgs {
    #[arg(long, default_value = "liver", help = scene_help())]
    scene: PathBuf,
    /// Override a key of the scene, as in material.youngs_modulus=8000
    #[arg(long = "set", value_name = "KEY=VALUE")]
    set: Vec<String>,
}

impl SceneArgs {
    /// The files that it reads; of a scene that cannot be read, itself.
    fn inputs(&self) -> Vec<PathBuf> {
        let loaded = LoadedScene::load(&self.scene, &self.set);
        let files = loaded.map(|loaded| loaded.files()).unwrap_or_default();
        [vec![self.scene.clone()], files].concat()
    }
}

/// Where to serve.
#[derive(Args)]
struct ServerArgs {
    /// Session name, part of every key
    #[arg(long, default_value = keys::DEFAULT_SESSION)]
    session: String,
    /// Endpoint of the force channel; give an address of this machine to be reachable from others
    #[arg(long, default_value = keys::DEFAULT_FORCE_ENDPOINT)]
    force_endpoint: String,
    /// Endpoint of surface, session, control, status and presence
    #[arg(long, default_value = keys::DEFAULT_SURFACE_ENDPOINT)]
    surface_endpoint: String,
    /// Also connect to this zenoh router, which passes on what the server and its clients send; may be given several times
    #[arg(long, value_name = "ENDPOINT")]
    connect: Vec<String>,
    /// Bind the simulation thread to this CPU
    #[arg(long)]
    cpu: Option<usize>,
    /// Record from the first tick into this file (MCAP)
    #[arg(long, value_name = "FILE")]
    record: Option<PathBuf>,
    /// Folder for recordings that clients start
    #[arg(long, default_value = "recordings")]
    recordings: PathBuf,
    /// Serve metrics for Prometheus at this address, as in 127.0.0.1:9464
    #[arg(long, value_name = "ADDRESS")]
    metrics: Option<std::net::SocketAddr>,
    /// Settings of zenoh beside the server's own (JSON5)
    #[arg(long, value_name = "FILE")]
    zenoh_config: Option<PathBuf>,
    /// Let whoever reaches an endpoint that other machines reach do everything, without encryption
    #[arg(long)]
    insecure: bool,
    /// How lines of the log are written
    #[arg(long, value_enum, default_value = "text")]
    log: LogFormat,
}

/// How lines of the log are written.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, clap::ValueEnum)]
enum LogFormat {
    /// For people
    #[default]
    Text,
    /// A JSON object a line, for programs
    Json,
}

impl ServerArgs {
    /// Who may connect, where no certificates are asked for.
    fn trust(&self) -> Trust {
        if self.insecure { Trust::Insecure } else { Trust::ThisMachine }
    }

    /// Fails, with a remedy, where the recording cannot be written.
    fn check_writable(&self, scene: &SceneArgs) -> anyhow::Result<()> {
        let Some(path) = &self.record else { return Ok(()) };
        writable::new_file("--record", path, scene.inputs().iter().map(PathBuf::as_path))
    }

    fn options(&self, trust: Trust) -> server::Options {
        server::Options {
            session: self.session.clone(),
            force_endpoint: self.force_endpoint.clone(),
            surface_endpoint: self.surface_endpoint.clone(),
            routers: self.connect.clone(),
            cpu: self.cpu,
            record: self.record.clone(),
            recordings: self.recordings.clone(),
            trust,
            zenoh_config: self.zenoh_config.clone(),
        }
    }
}

/// Where a server with `options` will listen, and who can reach it. Fails, with a remedy, where it cannot listen: before the
/// body is built.
fn describe(options: &server::Options) -> anyhow::Result<String> {
    let reach = match (server::check(options)?, &options.trust) {
        (_, Trust::Certificates { roles, .. }) => {
            let names: Vec<&str> = roles.names().collect();
            format!("with a certificate of {}", names.join(", "))
        }
        (Reach::ThisMachine, _) => "from this machine only".into(),
        (Reach::Others, _) => {
            "FROM OTHER MACHINES TOO. THIS IS INSECURE: whoever reaches it may move tools, reset the body \
             and record, nobody is asked who they are, and nothing is encrypted"
                .into()
        }
    };
    let server::Options { session, force_endpoint, surface_endpoint, .. } = options;
    Ok(format!(
        "session {session} on {force_endpoint} (forces) and {surface_endpoint} (everything else), reachable {reach}"
    ))
}

#[derive(Args)]
struct ServeArgs {
    #[command(flatten)]
    scene: SceneArgs,
    #[command(flatten)]
    server: ServerArgs,
    /// Folder of the server's certificate: clients need one, too, and come over quic/
    #[arg(long, value_name = "FOLDER", requires = "roles", conflicts_with = "insecure")]
    identity: Option<PathBuf>,
    /// Who may do what (TOML): a table for each name in a client's certificate
    #[arg(long, value_name = "FILE", requires = "identity")]
    roles: Option<PathBuf>,
    /// Stop after this long [s]
    #[arg(long)]
    seconds: Option<f64>,
    /// Stop when standard input ends: for a program that starts a server of its own
    #[arg(long)]
    until_input_ends: bool,
}

impl ServeArgs {
    /// Who may connect. Fails where the roles file makes no sense, also for the scene.
    fn trust(&self) -> anyhow::Result<Trust> {
        let Some((identity, file)) = self.identity.clone().zip(self.roles.as_ref()) else {
            return Ok(self.server.trust());
        };
        let roles = Roles::read(file)?;
        roles.clients(&LoadedScene::load(&self.scene.scene, &self.scene.set)?.scene)?;
        Ok(Trust::Certificates { identity, roles })
    }
}

#[derive(Args)]
struct SimulateArgs {
    #[arg(help = scene_help())]
    scene: PathBuf,
    /// Override a key of the scene
    #[arg(long = "set", value_name = "KEY=VALUE")]
    set: Vec<String>,
    /// Simulated time [s]
    #[arg(long)]
    seconds: f64,
    /// Tool trajectory (CSV): columns time_s,tool,x_m,y_m,z_m,qx,qy,qz,qw,buttons
    #[arg(long)]
    trajectory: Option<PathBuf>,
    /// Folder for samples.csv and summary.json
    #[arg(long)]
    out: PathBuf,
    /// Ticks between two rows of samples.csv
    #[arg(long, default_value_t = 1)]
    every: u64,
    /// Record into this file (MCAP), to replay it later
    #[arg(long, value_name = "FILE")]
    record: Option<PathBuf>,
}

#[derive(Args)]
struct RecordArgs {
    /// File name below the server's recordings folder
    file: String,
    /// Stop after this long [s]; without it, at Ctrl-C
    #[arg(long)]
    seconds: Option<f64>,
    /// Session name
    #[arg(long, default_value = keys::DEFAULT_SESSION)]
    session: String,
    /// Endpoint of the server's control
    #[arg(long, default_value = keys::DEFAULT_SURFACE_ENDPOINT)]
    surface_endpoint: String,
    /// Folder of your certificate, where the server asks for one
    #[arg(long, value_name = "FOLDER")]
    identity: Option<PathBuf>,
}

#[derive(Args)]
struct ReplayArgs {
    /// The recording
    file: PathBuf,
    /// Run on this form of the kernel instead of all that this CPU has
    #[arg(long, value_parser = kernel_form())]
    kernel: Option<Simd>,
    /// Write the tools' poses as a trajectory that `simulate` reads
    #[arg(long, value_name = "FILE")]
    trajectory_out: Option<PathBuf>,
}

/// A form of the kernel by its name.
fn kernel_form() -> impl TypedValueParser<Value = Simd> {
    PossibleValuesParser::new(Simd::ALL.map(Simd::name)).try_map(|name| {
        Simd::ALL.into_iter().find(|path| path.name() == name).ok_or("there is no such form of the kernel")
    })
}

/// zenoh's threads that send and receive, of all sessions of this process together. It has one that sends by default, and that
/// waits where a connection ends whose reader has stopped: forces would wait with it.
const ZENOH_THREADS: &str = "(rx: (worker_threads: 4), tx: (worker_threads: 4))";

fn main() -> ExitCode {
    if std::env::var_os("ZRUNTIME").is_none() {
        // SAFETY: no other thread runs yet that could read the environment.
        unsafe { std::env::set_var("ZRUNTIME", ZENOH_THREADS) };
    }
    let cli = Cli::parse();
    let outcome = match cli.command {
        Command::Demo(args) => demo::run(args),
        #[cfg(feature = "viewer")]
        Command::View(args) => view(args),
        #[cfg(feature = "web")]
        Command::Web(args) => web_command::run(args),
        Command::Doctor(args) => doctor::run(&args),
        Command::Serve(args) => serve(&args),
        Command::Simulate(args) => simulate(&args),
        Command::Prepare(args) => prepare_command::run(&args),
        Command::Certificates(args) => certificates_command::run(args),
        Command::Record(args) => record(&args),
        Command::Set(args) => set_command::run(&args),
        Command::List(args) => list_command::run(&args),
        Command::Replay(args) => replay_file(&args),
        Command::Export(args) => export_command::run(&args),
    };
    match outcome {
        Ok(code) => code,
        Err(e) => {
            // Most errors tell what caused them themselves, and some what they are about, which is told before them.
            let mut text = String::new();
            for cause in e.chain().map(|cause| cause.to_string()) {
                if cause.contains(&text) {
                    text = cause;
                } else if !text.contains(&cause) {
                    text += &format!(": {cause}");
                }
            }
            tell!("palpate: {text}");
            ExitCode::FAILURE
        }
    }
}

/// Log lines to standard error, in colours where that is a terminal and [`NO_COLOR`](https://no-color.org) is not set;
/// `RUST_LOG` changes what is logged.
fn log_to_stderr(format: LogFormat) {
    let filter = tracing_subscriber::EnvFilter::try_from_default_env()
        .unwrap_or_else(|_| tracing_subscriber::EnvFilter::new("palpate=info,zenoh=error"));
    let coloured = std::io::stderr().is_terminal() && std::env::var_os("NO_COLOR").is_none_or(|value| value.is_empty());
    let log = tracing_subscriber::fmt().with_env_filter(filter).with_ansi(coloured).log_internal_errors(false);
    let log = log.with_writer(std::io::stderr);
    // Whoever has set up a log before keeps it.
    let _ = match format {
        LogFormat::Text => log.try_init(),
        LogFormat::Json => log.json().try_init(),
    };
}

/// A body, and the state in which it has come to rest.
fn build(scene: &SceneArgs) -> anyhow::Result<(LoadedScene, Arc<palpate_core::model::Body>, Snapshot)> {
    let loaded = LoadedScene::load(&scene.scene, &scene.set)?;
    let mut progress = progress::Progress::new();
    let body = Arc::new(loaded.build(&mut |what, done, of| progress.show(what, done, of))?);
    let start = loaded.scene.settled(&body, &mut |what, done, of| progress.show(what, done, of));
    loaded.scene.check_settled(&body, &start).with_context(|| loaded.origin.clone())?;
    loaded.scene.display(&body).map_err(|e| anyhow::anyhow!("{}: {e}", loaded.origin))?;
    let levels: Vec<String> = body.levels().iter().map(|l| format!("{}", l.mesh.nodes.len())).collect();
    progress.finish(&format!(
        "{}: {:.2} kg, {} levels of {} nodes; starts with {} active",
        body.name(),
        body.mass(),
        body.levels().len(),
        levels.join(", "),
        start.body.nodes.len(),
    ));
    if let Some(warning) = loaded.scene.warning(&body) {
        tell!("{warning}");
    }
    Ok((loaded, body, start))
}

fn runtime() -> anyhow::Result<tokio::runtime::Runtime> {
    tokio::runtime::Builder::new_multi_thread().enable_all().worker_threads(2).build().context("starting tokio")
}

fn serve(args: &ServeArgs) -> anyhow::Result<ExitCode> {
    log_to_stderr(args.server.log);
    scheduling::share_arenas();
    args.server.check_writable(&args.scene)?;
    let options = args.server.options(args.trust()?);
    let where_it_listens = describe(&options)?;
    let is_insecure = matches!(options.trust, Trust::Insecure);
    let (loaded, body, start) = build(&args.scene)?;
    let runtime = runtime()?;
    let ended = runtime.block_on(async {
        let signals = ending::listen()?;
        args.server.metrics.map(metrics_page::serve).transpose()?;
        let server = Server::start(loaded.scene, body, start, options).await?;
        let begun = format!("{where_it_listens}; {}; Ctrl-C ends it", server.measured().describe());
        if is_insecure {
            tracing::warn!("{begun}");
        } else {
            tracing::info!("{begun}");
        }
        if let Some(warning) = server.warning() {
            tracing::warn!("{warning}");
        }
        let time_up = async {
            match args.seconds {
                Some(seconds) => {
                    tokio::time::sleep(std::time::Duration::try_from_secs_f64(seconds).unwrap_or_default()).await
                }
                None => std::future::pending().await,
            }
        };
        let input_ends = async {
            match args.until_input_ends {
                // A thread of its own, that nobody joins: a read of standard input cannot be called off.
                true => {
                    let (ended, end) = tokio::sync::oneshot::channel();
                    std::thread::spawn(move || {
                        let _ = std::io::copy(&mut std::io::stdin(), &mut std::io::sink());
                        let _ = ended.send(());
                    });
                    let _ = end.await;
                }
                false => std::future::pending().await,
            }
        };
        tokio::select! {
            () = time_up => {}
            () = input_ends => {}
            () = ending::asked(&signals) => {}
            () = server.failed() => {}
        }
        let status = server.stop().await;
        let signal = *signals.borrow();
        let said = say!("{}", demo::summary(&status));
        // Nobody reads on a terminal that was closed.
        if signal != Some(libc::SIGHUP) {
            said?;
        }
        Ok(ending::exit_code(&status, signal))
    });
    // Answers that wait for their readers, and a disk that hangs, are not waited for.
    runtime.shutdown_background();
    ended
}

/// The viewer, which may start servers of bundled scenes as processes of their own: this one has no simulation.
#[cfg(feature = "viewer")]
fn view(args: palpate_viewer::Args) -> anyhow::Result<ExitCode> {
    let scenes = palpate_viewer::Scenes {
        program: std::env::current_exe().context("where this program is")?,
        names: palpate::scene::BUNDLED.iter().map(|(name, _)| (*name).to_owned()).collect(),
    };
    palpate_viewer::run(args, Some(scenes))?;
    Ok(ExitCode::SUCCESS)
}

fn simulate(args: &SimulateArgs) -> anyhow::Result<ExitCode> {
    if !(args.seconds > 0.0 && args.seconds <= 1e6) {
        bail!("--seconds {}: give a time from 0.001 to 1e6", args.seconds);
    }
    writable::folder("--out", &args.out)?;
    let scene = SceneArgs { scene: args.scene.clone(), set: args.set.clone() };
    let mut inputs = scene.inputs();
    inputs.extend(args.trajectory.clone());
    let inputs = || inputs.iter().map(PathBuf::as_path);
    for name in ["samples.csv", "summary.json"] {
        writable::file("--out", &args.out.join(name), inputs())?;
    }
    if let Some(path) = &args.record {
        writable::new_file("--record", path, inputs())?;
    }
    let (loaded, body, start) = build(&scene)?;
    let trajectory = match &args.trajectory {
        Some(path) => {
            let text = std::fs::read_to_string(path).with_context(|| path.display().to_string())?;
            Trajectory::parse(&text, &path.display().to_string(), loaded.scene.tool.len())?
        }
        None => Trajectory::default(),
    };
    let settings = loaded.scene.settings();
    let (ranges, mut set) = (ParameterRanges::new(&body, &settings), Vec::new());
    for (_, parameter) in trajectory.parameters() {
        let checked = loaded.scene.check_parameters(&body, &ranges, &[*parameter], &mut set);
        checked.map_err(anyhow::Error::msg).context("--trajectory")?;
    }
    let mut simulation = Simulation::new(body.clone(), settings, start.clone()).map_err(anyhow::Error::msg)?;
    let mut samples = SampleWriter::create(&args.out, &loaded.scene, &simulation, args.every)?;
    let mut recording = match &args.record {
        Some(path) => Some(RecordingWriter::create(path, &loaded.scene, &body, &start, &start.body)?),
        None => None,
    };
    let ticks = (args.seconds / TICK).round() as u64;
    let mut progress = progress::Progress::new();
    let summary = offline::run(&mut simulation, &trajectory, ticks, |simulation, outputs| {
        if outputs.tick.is_multiple_of(100) {
            progress.show("simulating", outputs.tick as usize, ticks as usize);
        }
        if let Some(recording) = &mut recording {
            let inputs: Inputs = trajectory.inputs(outputs.tick);
            recording.tick(
                outputs.tick,
                &inputs,
                &outputs.tools,
                outputs.flags(),
                outputs.frame.then_some(outputs.hash),
            )?;
            if outputs.frame {
                recording.frame(&outputs.into())?;
            }
        }
        samples.write(simulation, outputs)?;
        anyhow::Ok(())
    })?;
    samples.finish().with_context(|| args.out.join("samples.csv").display().to_string())?;
    if let Some(recording) = recording {
        recording.finish()?;
    }
    progress.finish("simulated");
    let text = serde_json::to_string_pretty(&summary)?;
    let summary = args.out.join("summary.json");
    palpate::output::write(&summary, format!("{text}\n").as_bytes()).with_context(|| summary.display().to_string())?;
    say!("{text}")?;
    Ok(ExitCode::SUCCESS)
}

fn record(args: &RecordArgs) -> anyhow::Result<ExitCode> {
    use proto::control_request::Request;
    let endpoints = palpate_sdk::Endpoints {
        surface: args.surface_endpoint.clone(),
        session: args.session.clone(),
        identity: args.identity.clone(),
        ..Default::default()
    };
    let connection = palpate_sdk::Connection::open_surface(&endpoints)?;
    let started = connection.control(Request::StartRecording(proto::StartRecording { path: args.file.clone() }))?;
    let path = started.recording.map(|r| r.path).unwrap_or_default();
    tell!("recording into {path} on the server's machine; Ctrl-C stops it");
    runtime()?.block_on(async {
        match args.seconds {
            Some(seconds) => {
                let time = std::time::Duration::try_from_secs_f64(seconds).context("--seconds")?;
                tokio::select! {
                    () = tokio::time::sleep(time) => {}
                    _ = tokio::signal::ctrl_c() => {}
                }
            }
            None => tokio::signal::ctrl_c().await?,
        }
        anyhow::Ok(())
    })?;
    let done = connection.control(Request::StopRecording(proto::StopRecording {}))?.recording.unwrap_or_default();
    if !done.fault.is_empty() {
        bail!("{}: {}", done.path, done.fault);
    }
    say!("{}: {} ticks from {}, {:.1} MB", done.path, done.ticks, done.first_tick, done.bytes as f64 / 1e6)?;
    Ok(ExitCode::SUCCESS)
}

fn replay_file(args: &ReplayArgs) -> anyhow::Result<ExitCode> {
    let paths = match args.kernel {
        None => Simd::available(),
        Some(path) if path.is_available() => vec![path],
        Some(path) => {
            let available = Simd::available().into_iter().map(Simd::name).collect::<Vec<_>>().join(", ");
            bail!("--kernel {}: this CPU cannot run it. Remedy: give one of {available}, or none", path.name())
        }
    };
    if let Some(path) = &args.trajectory_out {
        writable::file("--trajectory-out", path, [args.file.as_path()])?;
    }
    let recording = Recording::read(&args.file)?;
    if let Some(cut) = &recording.cut {
        say!("ended early, after tick {}: {cut}", recording.inputs.last().map_or(0, |i| i.0))?;
    }
    if let Some(path) = &args.trajectory_out {
        write_trajectory(path, &recording)?;
    }
    let mut identical = true;
    for path in paths {
        let report = replay(&recording, path).map_err(anyhow::Error::msg)?;
        say!("{path:?}: {}", report.verdict())?;
        identical &= report.difference.is_none();
    }
    Ok(match (identical, &recording.cut) {
        (false, _) => ExitCode::FAILURE,
        (true, Some(_)) => ExitCode::from(ending::INCOMPLETE),
        (true, None) => ExitCode::SUCCESS,
    })
}

fn write_trajectory(path: &Path, recording: &Recording) -> anyhow::Result<()> {
    let trajectory = Trajectory::recorded(&recording.start, &recording.inputs);
    trajectory.write(path).with_context(|| path.display().to_string())
}
