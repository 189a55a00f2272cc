//! Tools and surfaces of a server, over the SDK: its renderer, its decoder, its watchdog.

use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, Ordering::Relaxed};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use numpy::{PyArray1, PyArray2};
use palpate_core::contact::jaws::Stance;
use palpate_sdk as sdk;
use palpate_sdk::{Device, Endpoints, Frame, Hold, PoseSample, Registration, RenderMode, Renderer, SdkError};
use pyo3::exceptions::PyRuntimeError;
use pyo3::prelude::*;
use pyo3::types::PyDict;

use crate::poses::{named_values, one_pose, poses};
use crate::wrenches::{Row, Wrench, Wrenches, phase_name, table};
use crate::{bad_value, no_connection};

/// An open connection.
#[pyclass(frozen, module = "palpate")]
pub struct Connection(sdk::Connection);

/// Connects to a server: zenoh endpoints such as "tcp/192.168.0.2:7447"; by default one on this machine.
///
/// ``identity`` is the folder of this client's certificate, where the server asks for one. ``watch_only`` opens no force channel. Raises ``ConnectionError``, after 5 s for each endpoint at most.
#[pyfunction]
#[pyo3(signature = (force = None, surface = None, session = None, *, identity = None, watch_only = false))]
pub fn connect(
    py: Python<'_>,
    force: Option<String>,
    surface: Option<String>,
    session: Option<String>,
    identity: Option<PathBuf>,
    watch_only: bool,
) -> PyResult<Connection> {
    let local = Endpoints::default();
    let endpoints = Endpoints {
        force: force.unwrap_or(local.force),
        surface: surface.unwrap_or(local.surface),
        session: session.unwrap_or(local.session),
        identity,
    };
    let open = if watch_only { sdk::Connection::open_surface } else { sdk::Connection::open };
    py.detach(|| open(&endpoints)).map(Connection).map_err(no_connection)
}

#[pymethods]
impl Connection {
    /// What the server simulates: name, version, tick, body, mass [kg], bounds and workspace [m], force_limit [N],
    /// torque_limit [N·m], tools with name, shape, radius [m] and taken, names of obstacles, and parameters that may be set, each
    /// with its values, the least and the most.
    fn session<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let session = py.detach(|| self.0.session()).map_err(no_connection)?;
        let out = PyDict::new(py);
        out.set_item("name", session.name)?;
        out.set_item("version", (session.version_major, session.version_minor))?;
        out.set_item("tick", session.tick)?;
        let body = session.body.unwrap_or_default();
        out.set_item("body", body.name)?;
        out.set_item("mass", body.mass_kg)?;
        out.set_item("bounds", corners(&body.bounds))?;
        let limits = session.limits.unwrap_or_default();
        out.set_item("workspace", corners(&limits.workspace))?;
        out.set_item("force_limit", limits.force)?;
        out.set_item("torque_limit", limits.torque)?;
        let tools = session.tools.iter().map(|tool| {
            let out = PyDict::new(py);
            out.set_item("name", &tool.name)?;
            out.set_item("shape", &tool.shape)?;
            out.set_item("radius", tool.radius)?;
            out.set_item("taken", tool.taken)?;
            PyResult::Ok(out)
        });
        out.set_item("tools", tools.collect::<PyResult<Vec<_>>>()?)?;
        out.set_item("obstacles", session.obstacles.into_iter().map(|obstacle| obstacle.name).collect::<Vec<_>>())?;
        let parameters = PyDict::new(py);
        for parameter in session.parameters {
            let told = PyDict::new(py);
            told.set_item("values", parameter.values)?;
            told.set_item("least", parameter.least)?;
            told.set_item("most", parameter.most)?;
            parameters.set_item(parameter.name, told)?;
        }
        out.set_item("parameters", parameters)?;
        Ok(out)
    }

    /// Sets parameters of the running simulation, all of them or none: ``{"stiffness.nodule": 2.0, "gravity": [0, 0, -9.81]}``.
    ///
    /// ``session()["parameters"]`` has their names and ranges. Raises ``ConnectionError`` with the name and the range of one that is
    /// refused.
    fn set_parameters(&self, py: Python<'_>, parameters: &Bound<'_, PyDict>) -> PyResult<()> {
        let parameters = named_values(parameters)?;
        py.detach(|| self.0.set_parameters(parameters)).map_err(no_connection)
    }

    /// Takes a tool, by name or any free one, and starts a force loop on a thread of its own, ``rate_hz`` times a second.
    ///
    /// ``device`` ("Touch", "omega", …, or a TOML file) limits force and coupling. ``frame`` gives axes and unit of poses
    /// and forces ("palpate", "openxr", "unity", "unreal", "ros", "phantom", "haply"); scale, rotation and translation [m]
    /// place the device in the body. ``render`` is "raw", "passive", "local" or "local-passive".
    #[pyo3(signature = (tool = "", *, device = "PHANTOM Omni", frame = "palpate", render = "local-passive", rate_hz = 1000.0, client = "python", scale = 1.0, rotation = [0.0, 0.0, 0.0, 1.0], translation = [0.0; 3]))]
    #[allow(clippy::too_many_arguments, reason = "keywords of Python, each with its default")]
    fn attach(
        &self,
        py: Python<'_>,
        tool: &str,
        device: &str,
        frame: &str,
        render: &str,
        rate_hz: f64,
        client: &str,
        scale: f64,
        rotation: [f64; 4],
        translation: [f64; 3],
    ) -> PyResult<Tool> {
        let device = if device.ends_with(".toml") { Device::from_file(device) } else { Device::by_name(device) };
        let device = device.map_err(bad_value)?;
        let frame = Frame::by_name(frame).map_err(bad_value)?;
        let mode: RenderMode = render.parse().map_err(bad_value)?;
        let registration = Registration::new(scale, rotation, translation).map_err(bad_value)?;
        let attachment =
            sdk::Attachment { tool: tool.to_owned(), rate_hz, ..sdk::Attachment::of(client, &device, &registration) };
        let tool = py.detach(|| self.0.attach(&attachment)).map_err(no_connection)?;
        let renderer = Renderer::new(&registration.in_body(&device), mode);
        Tool::start(Hand { tool, renderer, frame, registration }, rate_hz)
    }

    /// Watches the surface: every frame (1), second (2), fourth (4) or eighth (8) of 31.25 a second.
    #[pyo3(signature = (every = 1, levels = false))]
    fn watch(&self, py: Python<'_>, every: u32, levels: bool) -> PyResult<Watch> {
        py.detach(|| self.0.watch_surface(sdk::WatchOptions { every, levels })).map(Watch).map_err(no_connection)
    }
}

/// Least and greatest coordinates [m].
fn corners(bounds: &[f64]) -> Vec<Vec<f64>> {
    bounds.chunks(3).map(<[f64]>::to_vec).collect()
}

/// A tool in the hand, and everything between the device's numbers and the server's.
struct Hand {
    tool: sdk::Tool,
    renderer: Renderer,
    frame: Frame,
    registration: Registration,
}

/// Where the device is, in its own frame.
#[derive(Clone, Copy)]
struct Measured {
    position: [f64; 3],
    velocity: [f64; 3],
    orientation: [f64; 4],
    /// How far the jaws are to be open.
    opening: f64,
}

impl Measured {
    fn new(Stance { pose, opening }: Stance, velocity: [f64; 3]) -> Self {
        Self { position: pose.position.into(), velocity, orientation: pose.orientation, opening }
    }
}

/// What Python and the force loop tell each other.
#[derive(Default)]
struct Desk {
    /// None before the first.
    device: Option<Measured>,
    /// Poses to follow, one a period, and the next of them.
    path: Vec<Stance>,
    next: usize,
    /// What was felt on the way.
    felt: Vec<Row>,
    /// Rendered force [N] and torque [N·m] in the device's frame.
    rendered: [[f64; 3]; 2],
    wrench: Option<Row>,
    status: Option<sdk::ToolStatus>,
    /// Why the loop has ended.
    ended: Option<String>,
}

struct Shared {
    desk: Mutex<Desk>,
    stop: AtomicBool,
}

impl Shared {
    /// Held for some lines at a time on either side.
    fn desk(&self) -> MutexGuard<'_, Desk> {
        self.desk.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Hand {
    /// Sends poses and renders forces until it is told to stop or the connection is closed. Gives the tool back then.
    fn run(mut self, shared: &Shared, period: Duration) {
        let mut due = Instant::now();
        let ended = loop {
            if shared.stop.load(Relaxed) {
                break None;
            }
            let (device, followed) = {
                let mut desk = shared.desk();
                let at = desk.next;
                match desk.path.get(at).copied() {
                    Some(stance) => {
                        desk.next += 1;
                        let before = desk.path[at.saturating_sub(1)].pose.position;
                        let velocity = (stance.pose.position - before) / period.as_secs_f64();
                        let device = Measured::new(stance, velocity.into());
                        desk.device = Some(device);
                        (Some(device), true)
                    }
                    None => (desk.device, false),
                }
            };
            if let Some(device) = device
                && let Err(error) = self.touch(shared, device, followed)
            {
                break Some(error.to_string());
            }
            shared.desk().status = Some(self.tool.status(self.tool.now_ns()));
            due += period;
            match due.checked_duration_since(Instant::now()) {
                Some(wait) => std::thread::sleep(wait),
                // A machine that was away does not send what it has missed.
                None => due = Instant::now(),
            }
        };
        let detached = self.tool.detach();
        let mut desk = shared.desk();
        desk.rendered = Default::default();
        desk.ended = Some(ended.or(detached.err().map(|error| error.to_string())).unwrap_or_default());
    }

    fn touch(&mut self, shared: &Shared, device: Measured, followed: bool) -> Result<(), SdkError> {
        let Measured { position, velocity, orientation, opening } = device;
        let pose = self.registration.pose(&PoseSample {
            position: self.frame.position_in(position),
            orientation: self.frame.orientation_in(orientation),
            linear_velocity: Some(self.frame.velocity_in(velocity)),
            buttons: 0,
            opening,
        });
        self.tool.send_pose(pose)?;
        let received = self.tool.latest_wrench();
        if let Some(received) = received.filter(|received| received.fresh) {
            self.renderer.receive(&received.wrench, received.arrival_ns);
        }
        let now_ns = self.tool.now_ns();
        let force = self.renderer.force(pose.position, pose.linear_velocity.unwrap_or_default(), now_ns);
        let force = self.frame.force_out(self.registration.force_to_device(force));
        let torque = self.registration.torque_to_device(self.renderer.torque(now_ns));
        let mut desk = shared.desk();
        desk.rendered = [force, self.frame.torque_out(torque)];
        desk.wrench = received.map(|received| Row::from(&received.wrench));
        if followed {
            let row = desk.wrench.unwrap_or_default();
            let [force, torque] = desk.rendered;
            desk.felt.push(Row { force, torque, ..row });
        }
        Ok(())
    }
}

/// A tool in the hand. Calls raise ``ConnectionError`` once it is gone. As a context manager it gives itself back.
#[pyclass(frozen, module = "palpate")]
pub struct Tool {
    shared: Arc<Shared>,
    thread: Mutex<Option<JoinHandle<()>>>,
    id: u32,
    period: Duration,
}

impl Tool {
    fn start(hand: Hand, rate_hz: f64) -> PyResult<Self> {
        let (id, period) = (hand.tool.id(), Duration::from_secs_f64(1.0 / rate_hz));
        let shared = Arc::new(Shared { desk: Mutex::default(), stop: AtomicBool::new(false) });
        let of_thread = shared.clone();
        let run = move || hand.run(&of_thread, period);
        let thread = std::thread::Builder::new().name("palpate forces".into()).spawn(run)?;
        Ok(Self { shared, thread: Mutex::new(Some(thread)), id, period })
    }

    /// Errors: the tool is no longer in the hand.
    fn check(&self) -> PyResult<()> {
        let desk = self.shared.desk();
        if let Some(reason) = &desk.ended {
            let reason = if reason.is_empty() { "it was given back" } else { reason };
            return Err(no_connection(format!("the tool is gone: {reason}")));
        }
        match desk.status.map(|status| (status.hold, status.age_ns)) {
            Some((Hold::Gone, age_ns)) => Err(no_connection(SdkError::ToolGone { silence_s: age_ns as f64 * 1e-9 })),
            _ => Ok(()),
        }
    }

    fn end(&self) {
        self.shared.stop.store(true, Relaxed);
        if let Some(thread) = self.thread.lock().unwrap_or_else(PoisonError::into_inner).take() {
            // A panic of the loop has been printed, and there is nothing left to do for it.
            let _ = thread.join();
        }
    }
}

impl Drop for Tool {
    fn drop(&mut self) {
        self.end();
    }
}

#[pymethods]
impl Tool {
    /// Number of the tool in the session.
    #[getter]
    fn id(&self) -> u32 {
        self.id
    }

    /// Where the device is from now on, in its frame, and how fast (unit of the frame per second): the loop sends it.
    #[pyo3(signature = (pose, velocity = [0.0; 3]))]
    fn r#move(&self, pose: &Bound<'_, PyAny>, velocity: [f64; 3]) -> PyResult<()> {
        let pose = one_pose(pose)?;
        if !velocity.iter().all(|v| v.is_finite()) {
            return Err(bad_value("the velocity is not finite"));
        }
        self.check()?;
        self.shared.desk().device = Some(Measured::new(pose, velocity));
        Ok(())
    }

    /// Sends a row of ``poses`` each period and returns what was felt at each: force and torque are those that the
    /// device would render, in its frame; the rest is the newest wrench.
    fn follow(&self, py: Python<'_>, poses: &Bound<'_, PyAny>) -> PyResult<Wrenches> {
        let path = self::poses(poses)?;
        self.check()?;
        let n = path.len();
        {
            let mut desk = self.shared.desk();
            if desk.next < desk.path.len() {
                return Err(PyRuntimeError::new_err("the tool is following other poses"));
            }
            (desk.path, desk.next, desk.felt) = (path, 0, Vec::with_capacity(n));
        }
        loop {
            py.detach(|| std::thread::sleep(self.period.max(Duration::from_millis(5))));
            let stopped = self.check().and_then(|()| py.check_signals());
            let mut desk = self.shared.desk();
            if stopped.is_err() || desk.felt.len() == n {
                desk.path.clear();
                let felt = std::mem::take(&mut desk.felt);
                return stopped.map(|()| Wrenches(felt));
            }
        }
    }

    /// (3) [N] to give now, in the device's frame. Zero 70 ms after wrenches have stopped.
    #[getter]
    fn force<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray1<f64>>> {
        self.check()?;
        Ok(PyArray1::from_slice(py, &self.shared.desk().rendered[0]))
    }

    /// (3) [N·m] to give now, in the device's frame.
    #[getter]
    fn torque<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray1<f64>>> {
        self.check()?;
        Ok(PyArray1::from_slice(py, &self.shared.desk().rendered[1]))
    }

    /// The newest wrench, in the world frame; ``None`` before the first.
    #[getter]
    fn wrench(&self) -> PyResult<Option<Wrench>> {
        self.check()?;
        Ok(self.shared.desk().wrench.map(Wrench))
    }

    /// How the tool is doing; does not raise when it is gone.
    #[getter]
    fn state<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let desk = self.shared.desk();
        let out = PyDict::new(py);
        let status = desk.status.filter(|_| desk.ended.is_none());
        let hold = match status.map(|status| status.hold) {
            Some(Hold::Held) => "held",
            Some(Hold::Fading) => "fading",
            Some(Hold::Refused) => "refused",
            Some(Hold::Gone) | None => "gone",
        };
        out.set_item("hold", hold)?;
        out.set_item("phase", phase_name(status.map_or(0, |status| status.phase as u8)))?;
        out.set_item("flags", status.map_or(0, |status| status.flags))?;
        out.set_item("age", status.map_or(f64::INFINITY, |status| status.age_ns as f64 * 1e-9))?;
        out.set_item("contact_points", status.map_or(0, |status| status.contact_points))?;
        Ok(out)
    }

    /// Gives the tool back and ends the loop.
    fn detach(&self, py: Python<'_>) -> PyResult<()> {
        // It is let go in any case.
        let held = self.check();
        py.detach(|| self.end());
        match self.shared.desk().ended.as_deref() {
            None | Some("") => held,
            Some(reason) => Err(no_connection(reason)),
        }
    }

    fn __enter__(slf: Py<Self>) -> Py<Self> {
        slf
    }

    #[pyo3(signature = (*_args))]
    fn __exit__(&self, py: Python<'_>, _args: &Bound<'_, pyo3::types::PyTuple>) {
        py.detach(|| self.end());
    }
}

/// A running view of the surface.
#[pyclass(frozen, module = "palpate")]
pub struct Watch(sdk::SurfaceWatch);

#[pymethods]
impl Watch {
    /// (m, 3) vertex numbers.
    #[getter]
    fn triangles<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<u32>>> {
        table(py, self.0.surface().triangles.iter().copied())
    }

    /// (n, 3) [m] at rest.
    #[getter]
    fn rest_vertices<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f32>>> {
        table(py, self.0.surface().rest_positions.iter().copied())
    }

    /// The newest frame: tick, sequence, topology, vertices (n, 3) [m], levels (n, or 0), tools with position,
    /// orientation, force [N] and phase, and obstacles with position and the force on each [N]; ``None`` before the first.
    fn latest<'py>(&self, py: Python<'py>) -> PyResult<Option<Bound<'py, PyDict>>> {
        let Some(moment) = self.0.latest() else { return Ok(None) };
        let out = PyDict::new(py);
        out.set_item("tick", moment.tick)?;
        out.set_item("sequence", moment.sequence)?;
        out.set_item("topology", moment.topology)?;
        out.set_item("vertices", table(py, moment.positions.iter().copied())?)?;
        out.set_item("levels", PyArray1::from_slice(py, &moment.levels))?;
        let tools = moment.tools.iter().map(|tool| {
            let out = PyDict::new(py);
            out.set_item("tool", tool.tool)?;
            out.set_item("position", tool.position.clone())?;
            out.set_item("orientation", tool.orientation.clone())?;
            out.set_item("force", tool.force.clone())?;
            out.set_item("phase", phase_name(u8::try_from(tool.phase).unwrap_or_default()))?;
            PyResult::Ok(out)
        });
        out.set_item("tools", tools.collect::<PyResult<Vec<_>>>()?)?;
        let obstacles = moment.obstacles.iter().map(|obstacle| {
            let out = PyDict::new(py);
            out.set_item("position", obstacle.position.clone())?;
            out.set_item("force", obstacle.force.clone())?;
            PyResult::Ok(out)
        });
        out.set_item("obstacles", obstacles.collect::<PyResult<Vec<_>>>()?)?;
        Ok(Some(out))
    }

    /// Frames decoded and lost, undecodable messages, bytes.
    #[getter]
    fn counters<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let sdk::WatchCounters { frames, lost, undecodable, bytes } = self.0.counters();
        let out = PyDict::new(py);
        for (name, count) in [("frames", frames), ("lost", lost), ("undecodable", undecodable), ("bytes", bytes)] {
            out.set_item(name, count)?;
        }
        Ok(out)
    }
}
