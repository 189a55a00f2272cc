//! The closed loop: path, hand, device and server, a thousand times a second.

use std::{
    sync::{
        Arc, Mutex,
        atomic::{AtomicBool, Ordering::Relaxed},
    },
    thread,
    time::{Duration, Instant},
};

use anyhow::{Context, Result, anyhow, bail, ensure};
use hdrhistogram::Histogram;
use palpate_sdk::{
    Attachment, Connection, EchoProbe, Endpoints, Link, LinkConditions, PoseSample, Registration, RenderMode, Renderer,
    Session, Tool, ToolDescription, ToolPhase, WRENCH_BYTES, Wrench, proto::ToolPart,
};

use crate::{
    Device, Distribution, Given, Hand, HeldDevice, Live, Path, Pattern, Report, Sample, Site, Vec3,
    report::histogram,
    scheduling::raise_this_thread,
    top_of_surface,
    wrench_log::{WrenchLog, locked},
};

/// Rate of the device loop [Hz] and its period [s], by the device's clock.
const RATE_HZ: f64 = 1000.0;
const DT: f64 = 1e-3;
/// Largest drift of the device's clock [1].
const MOST_DRIFT: f64 = 0.01;
/// Height of the tool above the body at the start [m].
const STANDOFF: f64 = 0.02;
/// Silence after which the server counts as gone [ns].
const SILENCE_NS: u64 = 2_000_000_000;
/// Ticks from one call of `live` to the next.
const LIVE_TICKS: u64 = 100;
/// Time between two bare round trips.
const ECHO_PERIOD: Duration = Duration::from_millis(10);
/// Time after which an echo counts as lost.
const ECHO_TIMEOUT: Duration = Duration::from_millis(500);

/// What to run.
#[derive(Clone, Debug)]
pub struct Options {
    /// Where the server is.
    pub endpoints: Endpoints,
    /// Device to model.
    pub device: Device,
    /// Hand that holds it.
    pub hand: Hand,
    /// What the hand does.
    pub pattern: Pattern,
    /// How far below the surface the hand wants to go [m].
    pub depth: f64,
    /// Poses per second [Hz], up to 1000. The device loop runs at 1000 Hz in any case.
    pub rate_hz: f64,
    /// How much faster the device's clock runs than this machine's [1], up to 0.01 either way: crystals differ by up to
    /// 1e-4. Without drift the poses of a run all come at the same time before the server's tick.
    pub clock_drift: f64,
    /// Length of the run [s]; `None` runs until stopped.
    pub seconds: Option<f64>,
    /// Tool to take, by name; empty for any free one.
    pub tool: String,
    /// Surface point [m] and outward normal to touch at; `None` takes the top, where the first organ is at the start.
    pub site: Option<(Vec3, Vec3)>,
    /// Whether to measure the bare round trip meanwhile, 100 times a second.
    pub echo: bool,
    /// How the force is made from the wrenches.
    pub render: RenderMode,
    /// What to do to poses and to wrenches beside what the network does.
    pub link: LinkConditions,
    /// Seed of the jitter and the loss.
    pub seed: u64,
    /// How many ticks to keep as samples, from the beginning.
    pub samples: usize,
}

impl Default for Options {
    /// A PHANTOM Omni pressing on the top of the body of a server on this machine, until stopped.
    fn default() -> Self {
        Self {
            endpoints: Endpoints::default(),
            device: Device::default(),
            hand: Hand::default(),
            pattern: Pattern::Press,
            depth: 0.008,
            rate_hz: 1000.0,
            clock_drift: 0.0,
            seconds: None,
            tool: String::new(),
            site: None,
            echo: true,
            render: RenderMode::default(),
            link: LinkConditions::default(),
            seed: 0,
            samples: 0,
        }
    }
}

/// Runs until `options.seconds` have passed or `stop` is set, and reports.
///
/// Raises the priority of the calling thread where the system permits, before it opens the zenoh sessions: zenoh's
/// threads inherit it. `live` is called ten times a second from the device loop and must return quickly.
///
/// Errors: bad options, no connection, the server refuses, the path leaves the workspace of the device or the
/// server, or no wrench comes for 2 s.
pub fn run(options: &Options, stop: &AtomicBool, live: &mut dyn FnMut(&Live)) -> Result<Report> {
    ensure!(options.rate_hz > 0.0 && options.rate_hz <= RATE_HZ, "the pose rate must be above 0 and at most 1000 Hz");
    ensure!(options.clock_drift.abs() <= MOST_DRIFT, "the clock's drift must be -{MOST_DRIFT} to {MOST_DRIFT}");
    ensure!(options.depth > 0.0 && options.depth.is_finite(), "the depth must be above 0");
    options.link.check()?;
    let scheduling = raise_this_thread();
    let connection = Connection::open(&options.endpoints)?;
    let session = connection.session()?;

    let log = Arc::new(Mutex::new(WrenchLog::new()));
    let observed = log.clone();
    let observer = move |wrench: &Wrench, arrival_ns| locked(&observed).record(wrench, arrival_ns);
    // The imagined device stands in the body's own frame.
    let registration = Registration::default();
    let attachment = Attachment {
        tool: options.tool.clone(),
        rate_hz: options.rate_hz,
        ..Attachment::of("palpate-phantom", &options.device, &registration)
    };
    let tool = connection.attach_observed(&attachment, observer)?;
    let description = session
        .tools
        .iter()
        .find(|description| description.tool == tool.id())
        .with_context(|| format!("the server gave tool {}, which is not in its session", tool.id()))?;
    let path = Path { pattern: options.pattern, site: find_site(options, &connection, description)? };
    check_reach(&path, &options.device, &session)?;

    let device_loop = DeviceLoop {
        options,
        held: HeldDevice::new(options.device.clone(), options.hand, path.target(0.0).position),
        path,
        tool,
        registration,
        renderer: Renderer::new(&registration.in_body(&options.device), options.render),
        poses: Link::new(options.link, options.seed),
        // Another sequence of chances than that of the poses.
        wrenches: Link::new(options.link, !options.seed),
        log: &log,
        update_age: histogram(),
        lateness: histogram(),
        newest: Sample::default(),
        buttons: 0,
        opening: 0.0,
        phase: ToolPhase::Waiting,
        contact_points: 0,
        pose_slots: 0,
        start_ns: 0,
        period_ns: (DT * 1e9 / (1.0 + options.clock_drift)).round() as u64,
        report: Report {
            device: options.device.name.to_string(),
            pattern: options.pattern.name(),
            tool: description.name.clone(),
            rate_hz: options.rate_hz,
            render: options.render.name().to_owned(),
            delay_ms: options.link.delay_ns as f64 * 1e-6,
            jitter_ms: options.link.jitter_ns as f64 * 1e-6,
            loss: options.link.loss,
            scheduling,
            depth: options.depth,
            energy_budget: options.device.passivity_budget(),
            samples: Vec::with_capacity(options.samples),
            ..Default::default()
        },
    };
    if options.echo {
        let probe = connection.round_trip_probe(WRENCH_BYTES)?;
        beside_echo(probe, || device_loop.run(stop, live))
    } else {
        device_loop.run(stop, live)
    }
}

/// Everything the device loop works with.
struct DeviceLoop<'a> {
    options: &'a Options,
    path: Path,
    held: HeldDevice,
    tool: Tool,
    registration: Registration,
    renderer: Renderer,
    /// On their way to the server.
    poses: Link<PoseSample>,
    /// On their way from it.
    wrenches: Link<Wrench>,
    log: &'a Mutex<WrenchLog>,
    update_age: Histogram<u64>,
    lateness: Histogram<u64>,
    newest: Sample,
    /// Buttons that the hand holds down, one a bit.
    buttons: u32,
    /// How far it holds the jaws open.
    opening: f64,
    phase: ToolPhase,
    contact_points: u32,
    /// Poses that the rate has given room for so far.
    pose_slots: u64,
    /// Start of the loop and length of its tick, by this machine's clock [ns].
    start_ns: u64,
    period_ns: u64,
    report: Report,
}

impl DeviceLoop<'_> {
    fn run(mut self, stop: &AtomicBool, live: &mut dyn FnMut(&Live)) -> Result<Report> {
        let ticks = self.options.seconds.map_or(u64::MAX, |seconds| (seconds / DT).round() as u64);
        let start = Instant::now();
        self.start_ns = self.tool.now_ns();
        let mut tick = 0;
        while tick < ticks && !stop.load(Relaxed) {
            // Absolute deadlines: a late wake-up never shifts the next one.
            let deadline = start + Duration::from_nanos(tick * self.period_ns);
            thread::sleep(deadline.saturating_duration_since(Instant::now()));
            let late = deadline.elapsed();
            self.lateness.saturating_record(late.as_nanos() as u64);
            // Ticks that were slept through are made up for at once: device and hand have moved on meanwhile.
            let due = 1 + late.as_nanos() as u64 / self.period_ns;
            self.wake(tick, due)?;
            tick += due;
            if tick % LIVE_TICKS < due {
                live(&self.live());
            }
        }
        self.report.seconds = start.elapsed().as_secs_f64();
        Ok(self.finish())
    }

    /// One wake-up: reads the newest wrench, moves device and hand through `due` ticks from `tick`, sends the pose.
    fn wake(&mut self, tick: u64, due: u64) -> Result<()> {
        // Link and renderer live by the loop's deadlines, so that ticks made up for are as long as all others.
        let tick_ns = self.start_ns + tick * self.period_ns;
        let received = self.tool.latest_wrench();
        let age_ns = self.tool.now_ns().saturating_sub(received.map_or(self.start_ns, |received| received.arrival_ns));
        if age_ns > SILENCE_NS {
            bail!("no wrench for 2 s from {}: the server is gone or has stopped", self.options.endpoints.force);
        }
        if let Some(received) = received {
            self.update_age.saturating_record(age_ns);
            if received.fresh {
                self.wrenches.send(tick_ns, received.wrench);
            }
            (self.phase, self.contact_points) = (received.wrench.phase, received.wrench.contact_points);
            self.report.peak_grip_torque = self.report.peak_grip_torque.max(received.wrench.grip_torque);
        }
        self.report.stale_ticks += u64::from(received.is_none_or(|received| !received.fresh));

        for tick in tick..tick + due {
            let (time, now_ns) = (tick as f64 * DT, self.start_ns + tick * self.period_ns);
            while let Some(wrench) = self.wrenches.poll(now_ns) {
                self.renderer.receive(&wrench, now_ns);
            }
            let commanded = self.render(now_ns);
            let target = self.path.target(time);
            let given = self.held.step(DT, &target, commanded);
            (self.buttons, self.opening) = (target.buttons, target.opening);
            self.report.peak_device_force = self.report.peak_device_force.max(given.force.norm());
            self.report.peak_device_torque = self.report.peak_device_torque.max(given.torque.norm());
            self.report.turned = self.report.turned.max(self.held.orientation().angle());
            self.record(Sample {
                time,
                target: target.position.into(),
                position: self.held.position().into(),
                orientation: self.held.orientation().coords.into(),
                force: given.force.into(),
                torque: given.torque.into(),
            });
        }
        self.report.ticks += due;
        self.report.late_ticks += due - 1;

        let slots = 1 + (tick as f64 * self.options.rate_hz / RATE_HZ) as u64;
        if slots > self.pose_slots {
            self.pose_slots = slots;
            let in_body = self.registration.pose(&self.measured());
            self.poses.send(tick_ns, in_body);
        }
        while let Some(pose) = self.poses.poll(tick_ns) {
            self.tool.send_pose(pose)?;
            self.report.poses_sent += 1;
        }
        Ok(())
    }

    /// What the motors are told to give, from what the encoders say at `now_ns`.
    fn render(&mut self, now_ns: u64) -> Given {
        let in_body = self.registration.pose(&self.measured());
        let force = self.renderer.force(in_body.position, in_body.linear_velocity.unwrap_or_default(), now_ns);
        self.report.peak_energy = self.report.peak_energy.max(self.renderer.observed_energy());
        let torque = self.registration.torque_to_device(self.renderer.torque(now_ns));
        Given { force: self.registration.force_to_device(force).into(), torque: torque.into() }
    }

    fn record(&mut self, sample: Sample) {
        let above_touch = Vec3::from(sample.position) - self.path.site.point;
        self.report.reached_depth = self.report.reached_depth.max(-above_touch.dot(&self.path.site.normal));
        // Only as many as there is room for: the loop does not allocate.
        if self.report.samples.len() < self.options.samples {
            self.report.samples.push(sample);
        }
        self.newest = sample;
    }

    /// What the driver reports.
    fn measured(&self) -> PoseSample {
        PoseSample {
            position: self.held.reported_position().into(),
            orientation: self.held.orientation().coords.into(),
            linear_velocity: Some(self.held.reported_velocity().into()),
            buttons: self.buttons,
            opening: self.opening,
        }
    }

    fn live(&self) -> Live {
        let counters = self.tool.counters();
        let round_trip = Distribution::of(&locked(self.log).round_trip);
        Live {
            sample: self.newest,
            phase: self.phase,
            contact_points: self.contact_points,
            wrenches: counters.received,
            missed_wrenches: counters.missed,
            round_trip_p50: round_trip.p50,
            round_trip_p99: round_trip.p99,
        }
    }

    fn finish(mut self) -> Report {
        self.report.take_counters(self.tool.counters());
        // The run is measured; a server that is gone by now has freed the tool itself.
        let _ = self.tool.detach();
        let log = locked(self.log);
        Report {
            round_trip: Distribution::of(&log.round_trip),
            update_age: Distribution::of(&self.update_age),
            lateness: Distribution::of(&self.lateness),
            peak_force: log.peak_force,
            peak_physical_force: log.peak_physical_force,
            peak_force_step: log.peak_force_step,
            non_finite_wrenches: log.non_finite,
            contact_wrenches: log.in_contact,
            ..self.report
        }
    }
}

/// Runs `work` while another thread of the same priority measures bare round trips, and adds these to its report.
fn beside_echo(mut probe: EchoProbe, work: impl FnOnce() -> Result<Report>) -> Result<Report> {
    let done = AtomicBool::new(false);
    thread::scope(|scope| {
        let echo = scope.spawn(|| {
            let (mut round_trip, mut lost) = (histogram(), 0);
            while !done.load(Relaxed) {
                match probe.round_trip(ECHO_TIMEOUT) {
                    Some(time) => round_trip.saturating_record(time.as_nanos() as u64),
                    None => lost += 1,
                }
                thread::sleep(ECHO_PERIOD);
            }
            (Distribution::of(&round_trip), lost)
        });
        let report = work();
        done.store(true, Relaxed);
        let (bare_round_trip, lost_echoes) = echo.join().map_err(|_| anyhow!("the echo thread panicked"))?;
        Ok(Report { bare_round_trip: Some(bare_round_trip), lost_echoes, ..report? })
    })
}

/// Where the tool's reference point touches the body, and which way is out.
fn find_site(options: &Options, connection: &Connection, tool: &ToolDescription) -> Result<Site> {
    let (surface_point, normal) = match options.site {
        Some((point, normal)) => (point, normal.try_normalize(0.0).context("the normal must not be zero")?),
        None => {
            let (surface, now) = connection.surface_now()?;
            top_of_surface(&surface, &now.positions)?
        }
    };
    let extent = extent(tool, normal);
    // The tangent is the x axis, or y where the normal is too near to that, made perpendicular to the normal.
    let axis = if normal.x.abs() < 0.9 { Vec3::x() } else { Vec3::y() };
    let tangent = (axis - normal * axis.dot(&normal)).normalize();
    Ok(Site { point: surface_point + normal * extent, normal, tangent, standoff: STANDOFF, depth: options.depth })
}

/// How far an upright tool, its jaws as its parts are described, reaches beyond its reference point against `normal` [m].
fn extent(tool: &ToolDescription, normal: Vec3) -> f64 {
    let of_part = |part: &ToolPart| {
        let corner = |corner: &[f64; 3]| -normal.dot(&Vec3::from(*corner));
        let farthest = part.corners.as_chunks().0.iter().map(corner).fold(f64::NEG_INFINITY, f64::max);
        let axis = part.axis.first_chunk().map_or(Vec3::zeros(), |axis: &[f64; 3]| Vec3::from(*axis));
        farthest + part.rounding + part.disc * axis.cross(&normal).norm()
    };
    let farthest = tool.parts.iter().map(of_part).fold(f64::NEG_INFINITY, f64::max);
    // A server that tells no parts has balls and capsules.
    if farthest.is_finite() { farthest } else { tool.radius + (-normal.z * tool.length).max(0.0) }
}

/// Errors when the path leaves the device's workspace, centred on the site, or the poses the server accepts.
fn check_reach(path: &Path, device: &Device, session: &Session) -> Result<()> {
    // 10 s hold at least one whole period of every pattern.
    let positions = || (0..1000).map(|n| path.target(f64::from(n) * 0.01).position);
    let reach = positions().map(|position| (position - path.site.point).norm()).fold(0.0, f64::max);
    ensure!(
        reach <= device.workspace_radius,
        "the path reaches {:.0} mm from the site, {} only {:.0} mm",
        1e3 * reach,
        device.name,
        1e3 * device.workspace_radius
    );
    if let Some(&[x0, y0, z0, x1, y1, z1]) = session.limits.as_ref().map(|limits| limits.workspace.as_slice()) {
        let (min, max) = (Vec3::new(x0, y0, z0), Vec3::new(x1, y1, z1));
        ensure!(
            positions().all(|p| p.inf(&min) == min && p.sup(&max) == max),
            "the path leaves the workspace of the server, {:.3?} to {:.3?} m",
            min.as_slice(),
            max.as_slice()
        );
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_tool_is_held_with_its_lowest_place_on_the_surface() {
        let part = |corners: &[f64], rounding: f64, disc: f64| ToolPart {
            corners: corners.into(),
            rounding,
            disc,
            axis: if disc > 0.0 { vec![0.0, 0.0, 1.0] } else { vec![] },
            hinge: None,
        };
        let of = |part: ToolPart, normal: Vec3| {
            extent(&ToolDescription { radius: 1.0, parts: vec![part], ..Default::default() }, normal)
        };
        let shaft = [0.0, 0.0, 0.0, 0.0, 0.0, 0.1];
        for (part, normal, expected) in [
            (part(&[0.0; 3], 0.01, 0.0), Vec3::z(), 0.01),
            (part(&shaft, 0.01, 0.0), Vec3::z(), 0.01),
            (part(&shaft, 0.01, 0.0), -Vec3::z(), 0.11),
            (part(&shaft, 0.001, 0.009), Vec3::z(), 0.001),
            (part(&shaft, 0.001, 0.009), Vec3::x(), 0.01),
            (part(&[0.02, 0.0, 0.002], 0.001, 0.0), Vec3::z(), -0.001),
        ] {
            assert!((of(part.clone(), normal) - expected).abs() < 1e-12, "{part:?}");
        }
        assert_eq!(extent(&ToolDescription { radius: 0.01, ..Default::default() }, Vec3::z()), 0.01);
    }

    #[test]
    fn a_path_beyond_the_workspace_is_refused_before_it_begins() {
        let site =
            Site { point: Vec3::zeros(), normal: Vec3::z(), tangent: Vec3::x(), standoff: STANDOFF, depth: 0.01 };
        let path = Path { pattern: Pattern::Press, site };
        let omni = Device::default();
        let mut session = Session::default();
        assert!(check_reach(&path, &omni, &session).is_ok());
        let deep = Path { site: Site { depth: 0.2, ..site }, ..path };
        assert!(check_reach(&deep, &omni, &session).unwrap_err().to_string().contains("200 mm"));
        session.limits =
            Some(palpate_sdk::proto::Limits { workspace: vec![-1.0, -1.0, 0.0, 1.0, 1.0, 1.0], ..Default::default() });
        assert!(check_reach(&path, &omni, &session).unwrap_err().to_string().contains("workspace of the server"));
    }
}
