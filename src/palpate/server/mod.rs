//! The server: postman between the network and the simulation thread.
//!
//! Two zenoh sessions, so that no viewer can hold up a force: one for poses and wrenches, one for everything else.
//! Nothing in here decides physics; what arrives becomes an input of some tick, and the tick records it.

mod access;
mod control;
mod endpoint;
mod force_output;
mod health;
mod local_model;
mod metrics;
mod queries;
mod recorder;
mod roles;
mod router;
mod status;
mod surface_output;
mod tool_input;

pub use endpoint::{Reach, check};
pub use metrics::TIMES;
pub use roles::{Role, Roles, Trust};

use crate::display::Display;
use crate::realtime::clock::Monotonic;
use crate::realtime::mailbox::{Command, ServerEnds, mailboxes};
use crate::realtime::scheduling::{self, Granted};
use crate::realtime::sim_thread::{Measured, SimThread};
use crate::scene::Scene;
use crate::wire;
use health::{Health, Weight};
use palpate_core::model::{Body, State};
use palpate_core::simulation::{Parameter, ParameterRanges, Simulation, Snapshot};
use palpate_proto as proto;
use palpate_proto::keys;
use roles::Clients;
use router::{Router, network};
use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;
use tokio::sync::watch;

/// Where a server listens and what else it is told.
#[derive(Clone, Debug)]
pub struct Options {
    /// Session name, a key chunk.
    pub session: String,
    /// Endpoint of the force channel.
    pub force_endpoint: String,
    /// Endpoint of everything else.
    pub surface_endpoint: String,
    /// Endpoints of zenoh routers that pass on what the server and its clients send.
    pub routers: Vec<String>,
    /// CPU to bind the simulation thread to.
    pub cpu: Option<usize>,
    /// Record from the first tick into this file.
    pub record: Option<PathBuf>,
    /// Folder that clients' recordings go to.
    pub recordings: PathBuf,
    /// Who may connect.
    pub trust: Trust,
    /// zenoh's own settings, of both endpoints, from this file.
    pub zenoh_config: Option<PathBuf>,
}

impl Default for Options {
    /// Loopback, the default ports, nothing recorded.
    fn default() -> Self {
        Self {
            session: keys::DEFAULT_SESSION.into(),
            force_endpoint: keys::DEFAULT_FORCE_ENDPOINT.into(),
            surface_endpoint: keys::DEFAULT_SURFACE_ENDPOINT.into(),
            routers: Vec::new(),
            cpu: None,
            record: None,
            recordings: "recordings".into(),
            trust: Trust::default(),
            zenoh_config: None,
        }
    }
}

/// The options of the command line that give the endpoints.
pub const FORCE_OPTION: &str = "--force-endpoint";
/// See [`FORCE_OPTION`].
pub const SURFACE_OPTION: &str = "--surface-endpoint";
/// The option of the command line that gives the routers.
pub const ROUTER_OPTION: &str = "--connect";

/// Why a server does not start.
#[derive(Debug, thiserror::Error)]
pub enum ServerError {
    /// The name cannot be part of a key.
    #[error("session name {0:?}: use letters, digits, '-' and '_'")]
    SessionName(String),
    /// An endpoint cannot be listened on: taken, not of this machine, or none.
    #[error("cannot listen on {endpoint}: {reason}. Remedy: {}", listen_remedy(reason, option))]
    Listen {
        /// The endpoint.
        endpoint: String,
        /// The option of the command line that gives it.
        option: &'static str,
        /// The system's words, or zenoh's.
        reason: String,
    },
    /// An endpoint would let in clients that the server knows nothing of, or nobody.
    #[error("{option} {endpoint}: {reason}")]
    Trust {
        /// The endpoint.
        endpoint: String,
        /// The option of the command line that gives it.
        option: &'static str,
        /// Why, with a remedy.
        reason: &'static str,
    },
    /// The server's certificate is not there.
    #[error("--identity: {0}")]
    Identity(String),
    /// The roles file cannot be read, or says what makes no sense.
    #[error("--roles {}: {reason}", file.display())]
    Roles {
        /// The file.
        file: PathBuf,
        /// What is wrong with it.
        reason: String,
    },
    /// The zenoh configuration file cannot be read, or sets what is the server's own.
    #[error("--zenoh-config {}: {reason}", file.display())]
    ZenohConfig {
        /// The file.
        file: PathBuf,
        /// What is wrong with it.
        reason: String,
    },
    /// What is given for a router is no endpoint.
    #[error("cannot connect to {0}: this is no endpoint. Remedy: give {ROUTER_OPTION} as in tcp/192.168.0.2:7447")]
    Router(String),
    /// zenoh refused something later.
    #[error("network: {0}")]
    Network(String),
    /// The system has no thread or eventfd to give.
    #[error("system: {0}")]
    System(#[from] std::io::Error),
    /// The starting state does not fit.
    #[error("{0}")]
    Simulation(String),
    /// The machine is too slow for it.
    #[error(
        "this machine cannot serve it at 1 kHz: as coarse as it can be and untouched, the body takes {floor} µs of \
         each tick, and {limit} µs are there. Remedy: a coarser body (a larger first number in body.spacings, or in \
         --levels of `palpate prepare`), or no body.active_level"
    )]
    TooSlow {
        /// [µs].
        floor: u32,
        /// [µs].
        limit: u32,
    },
    /// The recording could not be started.
    #[error("recording: {0}")]
    Recording(String),
}

/// What to do about an endpoint, given with `option`, that cannot be listened on for `reason`.
fn listen_remedy(reason: &str, option: &str) -> String {
    if reason.contains("in use") {
        let both = "a second server needs both ports to be its own: --force-endpoint and --surface-endpoint";
        format!(
            "another program, perhaps a Palpate server, has this port: end it, or give another with {option} ({both})"
        )
    } else if reason.contains("assign") {
        format!("give an address of this machine with {option}, or 0.0.0.0 for all of them")
    } else {
        format!("give {option} as in tcp/127.0.0.1:7447")
    }
}

/// What the server's parts share, all of it away from the simulation thread.
struct Shared {
    /// What is simulated, as clients are told it; but for what changes.
    session: proto::Session,
    scene: Scene,
    body: Arc<Body>,
    /// What viewers are shown of it.
    display: Arc<Display>,
    /// What a reset returns to.
    reset: State,
    options: Options,
    commands: Mutex<rtrb::Producer<Command>>,
    /// What clients have changed of what the scene says.
    parameters: Mutex<Vec<Parameter>>,
    ranges: ParameterRanges,
    input: tool_input::ToolInput,
    holders: control::Holders,
    clients: Clients,
    recorder: recorder::Recorder,
    health: Arc<Health>,
    counters: status::Counters,
    scheduling: String,
    measured: Measured,
}

impl Shared {
    /// Sends a command to the simulation thread.
    fn command(&self, command: Command) -> Result<(), String> {
        lock(&self.commands).push(command).map_err(|_| BUSY.to_owned())
    }

    /// Has the simulation thread set `parameters`, one a tick, where all are within their ranges.
    fn set(&self, parameters: &[Parameter]) -> Result<(), String> {
        let mut set = lock(&self.parameters);
        let mut then = set.clone();
        self.scene.check_parameters(&self.body, &self.ranges, parameters, &mut then)?;
        let mut commands = lock(&self.commands);
        if commands.slots() < parameters.len() {
            return Err(BUSY.to_owned());
        }
        for parameter in parameters {
            // There is room.
            let _ = commands.push(Command::Set(*parameter));
        }
        *set = then;
        Ok(())
    }
}

const BUSY: &str = "the simulation is busy: try again";

/// A lock's content, whether or not another thread panicked holding it.
fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

/// A running server.
pub struct Server {
    shared: Arc<Shared>,
    warning: Option<String>,
    stop: Arc<AtomicBool>,
    simulation: std::thread::JoinHandle<SimThread>,
    force_output: force_output::ForceOutput,
    local_models: local_model::LocalModels,
    tasks: Vec<tokio::task::JoinHandle<()>>,
    sessions: [zenoh::Session; 2],
    _alive: zenoh::liveliness::LivelinessToken,
    live: watch::Receiver<proto::Status>,
    flush_status: tokio::sync::mpsc::Sender<tokio::sync::oneshot::Sender<()>>,
}

impl Server {
    /// Starts serving `body` of `scene` in the state `start`.
    ///
    /// # Errors
    /// When an endpoint is taken, a thread cannot be had, or the recording cannot be written.
    pub async fn start(
        scene: Scene,
        body: Arc<Body>,
        start: Snapshot,
        options: Options,
    ) -> Result<Server, ServerError> {
        if !keys::is_name(&options.session) {
            return Err(ServerError::SessionName(options.session));
        }
        check(&options)?;
        let clients = match &options.trust {
            Trust::Certificates { roles, .. } => roles.clients(&scene)?,
            Trust::ThisMachine | Trust::Insecure => Clients::everybody(&scene),
        };
        let router = Router::new(&options, &clients)?;
        let simulation = Simulation::new(body.clone(), scene.settings(), start).map_err(ServerError::Simulation)?;
        let display = Arc::new(scene.display(&body).map_err(ServerError::Simulation)?);
        let reset = simulation.reset_state().clone();
        let (sim_ends, ends) = mailboxes(&body, simulation.settings())?;
        let ServerEnds { poses, commands, retired, reports, wake, timings, frames, copies, dropped, others } = ends;

        // The force session first: zenoh's threads inherit the class of the thread that opens it.
        let force_session = router.force(&options)?;
        let surface_session = router.surface(&options)?;

        let (stop, health) = (Arc::new(AtomicBool::new(false)), Health::new());
        let thread = SimThread::new(simulation, sim_ends);
        let (simulation, granted, measured) = spawn_simulation(thread, options.cpu, stop.clone(), &health)?;
        if !measured.fits() {
            let _ = simulation.join();
            return Err(ServerError::TooSlow { floor: measured.floor / 1000, limit: measured.planned / 1000 });
        }
        let shared = Arc::new(Shared {
            input: tool_input::ToolInput::new(poses, scene.workspace(&body)),
            holders: control::Holders::new(scene.tool.len()),
            clients,
            recorder: recorder::Recorder::new(),
            health,
            counters: status::Counters::default(),
            scheduling: granted.describe(),
            measured,
            reset,
            commands: Mutex::new(commands),
            parameters: Mutex::default(),
            ranges: ParameterRanges::new(&body, &scene.settings()),
            session: wire::session::describe(&scene, &body),
            scene,
            body,
            display,
            options,
        });
        if let Some(path) = shared.options.record.clone() {
            recorder::start(&shared, path, LONGEST_DISK).await.map_err(ServerError::Recording)?;
        }
        let (local_models, models) = local_model::LocalModels::start(&shared, copies)?;
        let force_output = force_output::ForceOutput::start(&shared, &force_session, reports, models, wake)?;
        tool_input::listen(&shared, &force_session)?;
        let (live_in, live) = watch::channel(proto::Status::default());
        let (flush_status, flush_requests) = tokio::sync::mpsc::channel(1);
        let desk = queries::Desk::open(&shared.health)?;
        control::serve(&shared, &surface_session, &desk).await?;
        let mut tasks = vec![
            control::watch_presence(&shared, &surface_session).await?,
            status::publish(
                &shared,
                &surface_session,
                status::Sources { timings, retired, dropped, others },
                live_in,
                flush_requests,
            )
            .await?,
        ];
        tasks.push(surface_output::publish(&shared, &surface_session, &desk, frames).await?);
        // It can be found now that it answers.
        let alive = surface_session.liveliness().declare_token(keys::session(&shared.options.session));
        let alive = alive.await.map_err(network)?;
        Ok(Server {
            shared,
            warning: granted.warning(),
            stop,
            simulation,
            force_output,
            local_models,
            tasks,
            sessions: [force_session, surface_session],
            _alive: alive,
            live,
            flush_status,
        })
    }

    /// What the system refused the simulation thread, with the remedy.
    pub fn warning(&self) -> Option<&str> {
        self.warning.as_deref()
    }

    /// What the machine was found to be able to do with the body.
    pub fn measured(&self) -> &Measured {
        &self.shared.measured
    }

    /// Comes back when a part has died without which the server cannot go on; the status says which.
    pub async fn failed(&self) {
        self.shared.health.failed().await;
    }

    /// The status as it changes, about ten times a second.
    pub fn live(&self) -> watch::Receiver<proto::Status> {
        self.live.clone()
    }

    /// Ends the simulation, closes the recording and the sessions; returns the last status, which says what had gone wrong.
    /// A disk that does not answer is waited for for ten seconds.
    pub async fn stop(self) -> proto::Status {
        recorder::expect_end(&self.shared);
        self.shared.health.stop();
        self.stop.store(true, Ordering::Relaxed);
        // That it died has been said.
        let thread = tokio::task::spawn_blocking(move || self.simulation.join().ok()).await;
        self.force_output.stop();
        self.local_models.stop();
        // The last ticks and the retired tap are still in their rings.
        let (done, wait) = tokio::sync::oneshot::channel();
        if self.flush_status.send(done).await.is_ok() {
            let _ = wait.await;
        }
        drop(thread);
        let recording = recorder::finish(&self.shared, LONGEST_DISK).await;
        self.tasks.iter().for_each(tokio::task::JoinHandle::abort);
        for session in self.sessions {
            let _ = session.close().await;
        }
        let mut status = self.live.borrow().clone();
        status.recording = recording.or(status.recording);
        let (health, faults) = self.shared.health.status();
        (status.health, status.faults) = (health.into(), faults);
        status
    }
}

/// How long the start and the stop of a server wait for the disk.
const LONGEST_DISK: Duration = Duration::from_secs(10);

fn spawn_simulation(
    mut thread: SimThread,
    cpu: Option<usize>,
    stop: Arc<AtomicBool>,
    health: &Arc<Health>,
) -> std::io::Result<(std::thread::JoinHandle<SimThread>, Granted, Measured)> {
    let (tell, told) = std::sync::mpsc::sync_channel(1);
    let name = scheduling::SIMULATION_THREAD.into();
    let health = health.clone();
    let handle = std::thread::Builder::new().name(name).stack_size(4 << 20).spawn(move || {
        let granted = Granted::ask(cpu);
        let measured = thread.measure(&mut Monotonic);
        let _ = tell.send((granted, measured));
        drop(tell);
        if measured.fits() {
            let _watch = health.watch("the simulation thread", Weight::Fails);
            thread.run(Monotonic, &stop);
        }
        thread
    })?;
    let (granted, measured) = told.recv().map_err(|_| std::io::Error::other("the simulation thread died at start"))?;
    Ok((handle, granted, measured))
}
