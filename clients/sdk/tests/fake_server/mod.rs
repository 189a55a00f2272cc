//! A stand-in for the server: a springy floor at z = 0, which also holds what presses it against turning about z, that answers each pose
//! at once, with its local model. Shared by the clients' tests.
#![allow(dead_code)] // each of them uses a part

use std::{
    net::TcpListener,
    sync::{
        Arc, Mutex,
        atomic::{AtomicBool, AtomicU64, Ordering::Relaxed},
    },
    time::Duration,
};

use palpate_proto::{
    Attach, Attached, BodyDescription, CONTROL_MINOR, ControlReply, ControlRequest, Limits, Message, Role, Session,
    Status, SurfaceFrame, SurfaceTopology, ToolDescription, ToolPhase, ToolPose, ToolWrench, VERSION_MAJOR,
    VERSION_MINOR,
    control_request::Request,
    keys,
    surface::{KEY_INTERVAL, SurfaceCode},
};
use palpate_sdk::Endpoints;
use zenoh::{
    Wait,
    pubsub::Publisher,
    qos::{CongestionControl, Priority},
};

/// Radius of the only tool [m].
pub const TOOL_RADIUS: f64 = 0.005;
/// Stiffness of the floor [N/m].
pub const FLOOR_STIFFNESS: f64 = 300.0;
/// And against turning about z [N·m/rad], for small turns.
pub const FLOOR_TORSION: f64 = 0.1;
const EPOCH: u32 = 41;
/// That came with it.
const SECRET: u64 = 0x0123_4567_89ab_cdef;
const TOOL: u32 = 3;

/// The surface: two triangles.
const TRIANGLES: [[u32; 3]; 2] = [[0, 1, 2], [0, 2, 3]];
const CORNERS: [[f32; 3]; 4] = [[-0.05, -0.05, 0.0], [0.05, -0.05, 0.0], [0.05, 0.05, 0.0], [-0.05, 0.05, 0.0]];
/// Number of the surface, and step of its grid [m].
const TOPOLOGY: u32 = 1;
const STEP: f64 = 1.0 / 65536.0;

/// Height of the surface in frame `sequence` [m], but for the grid.
pub fn height(sequence: u64) -> f64 {
    1e-3 * (sequence % 100) as f64
}

fn frame(sequence: u64) -> SurfaceFrame {
    let code = SurfaceCode::new(&TRIANGLES, &CORNERS, STEP).unwrap();
    let at = |sequence| CORNERS.map(|[x, y, z]| code.on_grid([x.into(), y.into(), f64::from(z) + height(sequence)]));
    let key = sequence - sequence % KEY_INTERVAL;
    let reference = if sequence == key { code.rest().to_vec() } else { at(key).to_vec() };
    let displacements = code.encode(0, &reference, &at(sequence)).unwrap();
    SurfaceFrame { topology: TOPOLOGY, tick: 32 * sequence, sequence, key, displacements, ..Default::default() }
}

/// Runs until dropped.
pub struct FakeServer {
    pub endpoints: Endpoints,
    /// While true, poses get no answer.
    pub mute: Arc<AtomicBool>,
    /// Buttons that a pose has said are down, and the greatest torque of an answer [nN·m].
    pub buttons: Arc<AtomicU64>,
    pub torque: Arc<AtomicU64>,
    /// What the last client to get a tool asked for.
    pub attached: Arc<Mutex<Attach>>,
    /// Sequence of the newest key frame, published or not, and how often viewers have asked for it.
    newest_key: Arc<AtomicU64>,
    pub keys_asked_for: Arc<AtomicU64>,
    surface: zenoh::Session,
    _force: zenoh::Session,
}

impl FakeServer {
    /// Listens on two free ports of the loopback interface and speaks `version` (major, minor) of the contract.
    pub fn start(version: (u32, u32)) -> Self {
        Self::start_slowly(version, Duration::ZERO)
    }

    /// As [`start`](Self::start), but takes queries only `after` it takes connections.
    pub fn start_slowly(version: (u32, u32), after: Duration) -> Self {
        let ((force, force_endpoint), (surface, surface_endpoint)) = (open_router(), open_router());
        let endpoints =
            Endpoints { force: force_endpoint, surface: surface_endpoint, session: "fake".to_owned(), identity: None };
        let mute = Arc::new(AtomicBool::new(false));
        let (buttons, torque) = <(Arc<AtomicU64>, Arc<AtomicU64>)>::default();
        answer_poses(&force, &endpoints.session, mute.clone(), [buttons.clone(), torque.clone()]);
        let attached = Arc::new(Mutex::new(Attach::default()));
        let (session, name, to) = (surface.clone(), endpoints.session.clone(), attached.clone());
        let offer = move || answer_queries(&session, &name, version, to);
        if after.is_zero() {
            offer();
        } else {
            std::thread::spawn(move || {
                std::thread::sleep(after);
                offer();
            });
        }
        let (newest_key, keys_asked_for) = <(Arc<AtomicU64>, Arc<AtomicU64>)>::default();
        answer_surface(&surface, &endpoints.session, newest_key.clone(), keys_asked_for.clone());
        Self { endpoints, mute, buttons, torque, attached, newest_key, keys_asked_for, surface, _force: force }
    }

    /// A server of this contract's version.
    pub fn current() -> Self {
        Self::start((VERSION_MAJOR, VERSION_MINOR))
    }

    /// Publishes the surface frame of the given sequence number; `lost`: it never leaves.
    pub fn publish_frame(&self, sequence: u64, lost: bool) {
        self.newest_key.store(sequence - sequence % KEY_INTERVAL, Relaxed);
        if !lost {
            let key = keys::surface_frames(&self.endpoints.session, 1, false);
            self.surface.put(key, frame(sequence).encode_to_vec()).wait().unwrap();
        }
    }

    /// Publishes a status at simulated time `tick` [ms], of a machine that is so often away that no time is left to plan with.
    pub fn publish_status(&self, tick: u64) {
        let clients = vec!["a hand".to_owned()];
        let status = Status { tick, tick_rate_hz: 1000.0, clients, work: 200_000, planned: 0, ..Default::default() };
        self.surface.put(keys::status(&self.endpoints.session), status.encode_to_vec()).wait().unwrap();
    }

    /// True when a client holds a liveliness token.
    pub fn is_attended(&self) -> bool {
        let present = self.surface.liveliness().get(keys::all_presence(&self.endpoints.session)).wait().unwrap();
        let keys: Vec<_> =
            present.iter().filter_map(|r| r.into_result().ok()).map(|s| s.key_expr().to_string()).collect();
        keys == [keys::presence(&self.endpoints.session, TOOL, EPOCH)]
    }
}

fn free_endpoint() -> String {
    let port = TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap().port();
    format!("tcp/127.0.0.1:{port}")
}

/// A router and where it listens.
fn open_router() -> (zenoh::Session, String) {
    // Until it listens, another process may take a port that was free.
    let listening = (0..20).find_map(|_| {
        let endpoint = free_endpoint();
        let mut config = zenoh::Config::default();
        for (key, value) in [
            ("mode", r#""router""#),
            ("listen/endpoints", &format!("[{endpoint:?}]")),
            ("scouting/multicast/enabled", "false"),
            // A router's `open` sleeps this long [ms], scouting or not.
            ("scouting/delay", "0"),
            // A router stamps every message by default.
            ("timestamping/enabled", "false"),
            ("transport/link/tx/queue/congestion_control/drop/wait_before_drop", "0"),
        ] {
            config.insert_json5(key, value).unwrap();
        }
        Some((zenoh::open(config).wait().ok()?, endpoint))
    });
    listening.expect("a free port in twenty attempts")
}

fn publisher(session: &zenoh::Session, key: String) -> Publisher<'static> {
    session
        .declare_publisher(key)
        .priority(Priority::RealTime)
        .express(true)
        .congestion_control(CongestionControl::Drop)
        .wait()
        .unwrap()
}

fn answer_poses(
    force: &zenoh::Session,
    session: &str,
    mute: Arc<AtomicBool>,
    [buttons, most_torque]: [Arc<AtomicU64>; 2],
) {
    let wrenches = publisher(force, keys::tool_wrench(session, TOOL));
    let (sequence, started) = (AtomicU64::new(0), std::time::Instant::now());
    let answer = move |sample: zenoh::sample::Sample| {
        let pose = ToolPose::decode(&*sample.payload().to_bytes()).unwrap();
        if (pose.epoch, pose.secret) != (EPOCH, SECRET) || mute.load(Relaxed) {
            return;
        }
        let depth = TOOL_RADIUS - f64::from(pose.position[2]);
        let overlap = depth.max(0.0);
        let force = vec![0.0, 0.0, (FLOOR_STIFFNESS * overlap) as f32];
        let turned = pose.orientation.get(2).map_or(0.0, |z| 2.0 * f64::from(*z));
        let torque = if overlap > 0.0 { -FLOOR_TORSION * turned } else { 0.0 };
        buttons.fetch_or(pose.buttons.into(), Relaxed);
        most_torque.fetch_max((torque.abs() * 1e9) as u64, Relaxed);
        let number = sequence.fetch_add(1, Relaxed) + 1;
        let wrench = ToolWrench {
            tool: TOOL,
            epoch: EPOCH,
            sequence: number,
            tick: started.elapsed().as_millis() as u64,
            pose_sequence: pose.sequence,
            pose_time_ns: pose.time_ns,
            model_position: pose.position.clone(),
            model_force: vec![0.0, 0.0, (FLOOR_STIFFNESS * depth) as f32],
            model_normal: vec![0.0, 0.0, 1.0],
            model_stiffness: vec![0.0, 0.0, FLOOR_STIFFNESS as f32, 0.0, 0.0, 0.0],
            model_range: 0.01,
            position: pose.position,
            orientation: pose.orientation,
            physical_force: force.clone(),
            physical_torque: vec![0.0; 3],
            force,
            torque: vec![0.0, 0.0, torque as f32],
            contact_points: u32::from(overlap > 0.0),
            phase: ToolPhase::Engaged as i32,
            ..Default::default()
        };
        wrenches.put(wrench.encode_to_vec()).wait().unwrap();
    };
    force.declare_subscriber(keys::all_tool_poses(session)).callback(answer).background().wait().unwrap();

    let echoes = publisher(force, keys::echo_reply(session));
    let echo = move |sample: zenoh::sample::Sample| echoes.put(sample.payload().clone()).wait().unwrap();
    force.declare_subscriber(keys::echo_request(session)).callback(echo).background().wait().unwrap();
}

fn answer_surface(surface: &zenoh::Session, session: &str, newest_key: Arc<AtomicU64>, asked: Arc<AtomicU64>) {
    let topology = SurfaceTopology {
        topology: TOPOLOGY,
        vertices: 4,
        triangles: TRIANGLES.as_flattened().iter().flat_map(|v| v.to_le_bytes()).collect(),
        rest_positions: CORNERS.as_flattened().iter().flat_map(|x| x.to_le_bytes()).collect(),
        part: 0,
        parts: 1,
        step: STEP,
        ..Default::default()
    };
    answer(surface, keys::surface_topology(session), move |_| topology.encode_to_vec());
    answer(surface, keys::surface_key(session), move |_| {
        asked.fetch_add(1, Relaxed);
        frame(newest_key.load(Relaxed)).encode_to_vec()
    });
}

fn answer_queries(surface: &zenoh::Session, session: &str, version: (u32, u32), attached: Arc<Mutex<Attach>>) {
    let description = Session {
        version_major: version.0,
        version_minor: version.1,
        name: session.to_owned(),
        tick_s: 0.001,
        body: Some(BodyDescription { name: "floor".to_owned(), mass_kg: 2.0, ..Default::default() }),
        tools: vec![ToolDescription {
            tool: TOOL,
            name: "ball".to_owned(),
            shape: "ball".to_owned(),
            radius: TOOL_RADIUS,
            ..Default::default()
        }],
        limits: Some(Limits { workspace: vec![-0.2, -0.2, -0.2, 0.2, 0.2, 0.2], ..Default::default() }),
        ..Default::default()
    };
    answer(surface, keys::session(session), move |_| description.encode_to_vec());
    if version.1 < CONTROL_MINOR {
        return;
    }
    let role = Role {
        name: keys::ANYBODY.to_owned(),
        role: "admin".to_owned(),
        actions: keys::ACTIONS.map(String::from).to_vec(),
        tools: vec![TOOL],
    };
    answer(surface, keys::all_roles(session), move |_| role.encode_to_vec());

    let taken = AtomicBool::new(false);
    answer(surface, keys::all_control(session), move |payload| {
        let reply = match ControlRequest::decode(payload).unwrap().request {
            Some(Request::Attach(attach)) if !attach.tool.is_empty() && attach.tool != "ball" => {
                ControlReply { error: format!("there is no tool '{}'", attach.tool), ..Default::default() }
            }
            Some(Request::Attach(_)) if taken.swap(true, Relaxed) => {
                ControlReply { error: "every tool is taken".to_owned(), ..Default::default() }
            }
            Some(Request::Attach(attach)) => {
                *attached.lock().unwrap() = attach;
                ControlReply {
                    attached: Some(Attached { tool: TOOL, epoch: EPOCH, secret: SECRET }),
                    ..Default::default()
                }
            }
            Some(Request::Detach(_)) => {
                taken.store(false, Relaxed);
                ControlReply::default()
            }
            _ => ControlReply { error: "not here".to_owned(), ..Default::default() },
        };
        reply.encode_to_vec()
    });
}

fn answer(session: &zenoh::Session, key: String, reply: impl Fn(&[u8]) -> Vec<u8> + Send + Sync + 'static) {
    session
        .declare_queryable(&key)
        .callback(move |query| {
            let request = query.payload().map(|payload| payload.to_bytes().into_owned()).unwrap_or_default();
            query.reply(keys::surface_part(query.key_expr(), 0), reply(&request)).wait().unwrap();
        })
        .background()
        .wait()
        .unwrap();
}
