//! The server: postman between the network and the simulation thread.
//!
//! Two zenoh sessions, so that no viewer can hold up a force: one for poses and wrenches, one for everything else.
//! Nothing in here decides physics; what arrives becomes an input of some tick, and the tick records it.

mod control;
mod endpoint;
mod force_output;
mod health;
mod local_model;
mod metrics;
mod queries;
mod recorder;
mod status;
mod surface_output;
mod tool_input;

pub use endpoint::{Reach, reach};
pub use metrics::TIMES;

use crate::display::Display;
use crate::realtime::clock::Monotonic;
use crate::realtime::mailbox::{Command, ServerEnds, mailboxes};
use crate::realtime::scheduling::{self, Granted};
use crate::realtime::sim_thread::{Measured, SimThread};
use crate::scene::Scene;
use crate::wire;
use health::{Health, Weight};
use palpate_core::model::{Body, State};
use palpate_core::simulation::{Simulation, Snapshot};
use palpate_proto as proto;
use palpate_proto::keys;
use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;
use tokio::sync::watch;
use zenoh::Wait;

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
        }
    }
}

/// The options of the command line that give the endpoints.
pub const FORCE_OPTION: &str = "--force-endpoint";
/// See [`FORCE_OPTION`].
pub const SURFACE_OPTION: &str = "--surface-endpoint";
/// The option of the command line that gives the routers.
pub const ROUTER_OPTION: &str = "--connect";

/// Connections to the force endpoint, which hands alone need: viewers cannot take their places.
const HANDS: u32 = 64;
/// Connections to the surface endpoint.
const VIEWERS: u32 = 512;

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
    input: tool_input::ToolInput,
    holders: control::Holders,
    recorder: recorder::Recorder,
    health: Arc<Health>,
    counters: status::Counters,
    scheduling: String,
    measured: Measured,
}

impl Shared {
    /// Sends a command to the simulation thread.
    fn command(&self, command: Command) -> Result<(), String> {
        lock(&self.commands).push(command).map_err(|_| "the simulation is busy: try again".to_owned())
    }
}

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
        if !keys::is_session_name(&options.session) {
            return Err(ServerError::SessionName(options.session));
        }
        reach(&options.force_endpoint, FORCE_OPTION)?;
        reach(&options.surface_endpoint, SURFACE_OPTION)?;
        let simulation = Simulation::new(body.clone(), scene.settings(), start).map_err(ServerError::Simulation)?;
        let display = Arc::new(scene.display(&body).map_err(ServerError::Simulation)?);
        let reset = simulation.reset_state().clone();
        let (sim_ends, ends) = mailboxes(scene.tool.len(), body.surface().vertices.len(), || {
            Snapshot::with_room(&body, simulation.settings())
        })?;
        let ServerEnds { poses, commands, retired, reports, wake, timings, frames, copies, dropped, others } = ends;

        // The force session first, and from a real-time thread: zenoh's threads inherit its class.
        let force_session = open_force_session(&options)?;
        let surface_session = open(&options.surface_endpoint, SURFACE_OPTION, &options, VIEWERS)?;

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
            recorder: recorder::Recorder::new(),
            health,
            counters: status::Counters::default(),
            scheduling: granted.describe(),
            measured,
            reset,
            commands: Mutex::new(commands),
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

fn open_force_session(options: &Options) -> Result<zenoh::Session, ServerError> {
    let options = options.clone();
    let opened = std::thread::spawn(move || {
        if scheduling::fifo(scheduling::FORCE_NETWORK).is_err() {
            tracing::debug!("the force network's threads run at normal priority");
        }
        open(&options.force_endpoint, FORCE_OPTION, &options, HANDS)
    });
    opened.join().map_err(|_| ServerError::Network("zenoh panicked while opening".into()))?
}

/// What passes between the server's router and a client, of the session `name`; nothing else does. So wrenches, frames, status
/// and answers are the server's alone, whoever else sends on their keys, and nobody overhears a pose or an epoch.
///
/// A rule has to include the whole key of a message, so that one with wildcards passes only where all that it means may.
/// Clients and servers tell each other of what they declare: those messages pass as well.
fn access(name: &str) -> String {
    let from_clients = [keys::all_tool_poses(name), keys::echo_request(name)];
    let answers = [
        keys::session_of_any_version(name),
        keys::control(name),
        keys::surface_topology(name),
        keys::surface_key(name),
        keys::surface_pictures(name),
    ];
    let from_server =
        [keys::all_tool_wrenches(name), keys::echo_reply(name), keys::status(name), keys::all_surface_frames(name)];
    let presence = [keys::all_presence(name)];
    // Servers are found by the liveliness of their session keys.
    let (alive, whoever) = ([keys::session(name)], [keys::session("*")]);
    let rules = [
        ("ingress", &["put"][..], &from_clients[..]),
        ("ingress", &["query"], &answers),
        ("ingress", &["declare_subscriber"], &from_server),
        ("ingress", &["liveliness_token"], &presence),
        ("egress", &["put"], &from_server),
        ("egress", &["reply", "declare_queryable"], &answers),
        ("egress", &["declare_subscriber"], &from_clients),
        ("egress", &["declare_liveliness_subscriber", "liveliness_query"], &presence),
        ("egress", &["liveliness_token"], &alive),
        ("ingress", &["declare_liveliness_subscriber", "liveliness_query"], &whoever),
    ];
    let rules: Vec<_> = rules
        .iter()
        .enumerate()
        .map(|(id, (flow, messages, keys))| {
            serde_json::json!({
                "id": id.to_string(), "permission": "allow", "flows": [flow], "messages": messages, "key_exprs": keys,
            })
        })
        .collect();
    let all: Vec<String> = (0..rules.len()).map(|id| id.to_string()).collect();
    serde_json::json!({
        "enabled": true,
        "default_permission": "deny",
        "rules": rules,
        "subjects": [{ "id": "everybody" }],
        "policies": [{ "rules": all, "subjects": ["everybody"] }],
    })
    .to_string()
}

/// Fails where `routers` holds something that is no endpoint: before a body is built.
///
/// # Errors
/// [`ServerError::Router`].
pub fn check_routers(routers: &[String]) -> Result<(), ServerError> {
    let is_endpoint = |router: &String| router.parse::<zenoh::config::EndPoint>().is_ok();
    routers.iter().find(|router| !is_endpoint(router)).map_or(Ok(()), |router| Err(ServerError::Router(router.clone())))
}

/// A session that routes for its clients: no router has to run beside it. At most `places` may be connected. Routers that do
/// not answer are tried again as long as it lasts, and what passes between them and this one is what passes for clients.
fn open(endpoint: &str, option: &'static str, options: &Options, places: u32) -> Result<zenoh::Session, ServerError> {
    let (name, routers) = (&options.session, &options.routers);
    let mut config = zenoh::Config::default();
    for (key, value) in [
        ("mode", "\"router\"".to_owned()),
        ("listen/endpoints", format!("[{endpoint:?}]")),
        ("listen/exit_on_failure", "true".into()),
        ("connect/endpoints", format!("{routers:?}")),
        // One that was away is back within a second or two [ms].
        ("connect/retry", "{ period_init_ms: 200, period_max_ms: 1000 }".into()),
        ("scouting/multicast/enabled", "false".into()),
        ("scouting/gossip/enabled", "false".into()),
        // There is nobody to look for: without this, opening waits half a second.
        ("scouting/delay", "0".into()),
        ("timestamping/enabled", "false".into()),
        ("access_control", access(name)),
        ("transport/unicast/max_sessions", places.to_string()),
        // Whoever connects and says nothing makes room for others after this long [ms].
        ("transport/unicast/accept_timeout", "1000".into()),
        ("transport/unicast/accept_pending", places.to_string()),
        // Bytes of a message: a pose has about 60, a request some hundred.
        ("transport/link/rx/max_message_size", "65536".into()),
        // A client that stops answering is noticed after this long [ms]; safety does not wait for it.
        ("transport/link/tx/lease", "1500".into()),
        // A message that does not fit the queue at once is dropped: a slow viewer holds up nobody.
        ("transport/link/tx/queue/congestion_control/drop/wait_before_drop", "0".into()),
        // Whoever does not read the answers to its questions is cut off after this long [µs]. Longer, and more threads wait for
        // it; shorter, and a link of less than 2 Mbit/s, which needs as long for a batch, is no link.
        ("transport/link/tx/queue/congestion_control/block/wait_before_close", "250000".into()),
        // Batches of 64 KiB that may wait for a viewer: a frame of the largest surface has more parts than the default of two.
        ("transport/link/tx/queue/size/data_low", "16".into()),
    ] {
        config.insert_json5(key, &value).map_err(|e| match key {
            "listen/endpoints" => {
                let reason = "this is no endpoint".to_owned();
                ServerError::Listen { endpoint: endpoint.to_owned(), option, reason }
            }
            _ => ServerError::Network(format!("{key}: {e}")),
        })?;
    }
    zenoh::open(config).wait().map_err(|e| {
        let words = words(&e);
        // The system's words stand last, after the same endpoint twice.
        let reason = words.split_once(": [").map_or(&*words, |(_, list)| list.rsplit(": ").next().unwrap_or(list));
        ServerError::Listen { endpoint: endpoint.to_owned(), option, reason: reason.trim_end_matches(']').to_owned() }
    })
}

fn network(e: zenoh::Error) -> ServerError {
    ServerError::Network(words(&e))
}

/// zenoh's message without the places in its source that it appends.
fn words(e: &zenoh::Error) -> String {
    let text = e.to_string();
    text.split(" at ").filter(|part| !part.contains(".rs:")).collect::<Vec<_>>().join(" at ")
}
