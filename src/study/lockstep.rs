//! Hands on one body, in one loop and in simulated time: path, hand, device, client library, network, core, network.
//!
//! The real core, the real client library and the virtual Phantom's device and hand; what a server adds to them is
//! threads and clocks.

use palpate::wire;
use palpate_core::contact::tool::{Coupling, MOST_TOOLS, PoseSample, ToolEvent};
use palpate_core::feedback::LocalModel;
use palpate_core::feedback::relaxed::{Probe, Stiffness};
use palpate_core::math::{Pose, Real, Vec3};
use palpate_core::model::Body;
use palpate_core::model::step_class::TICK;
use palpate_core::simulation::{Inputs, Settings, Simulation, Snapshot, TICKS_PER_FRAME, ToolOutput};
use palpate_phantom::{Given, Hand, HeldDevice, Target};
use palpate_sdk::{Device, Link, LinkConditions, RenderMode, Renderer, Wrench};
use std::io::{Error, Result};
use std::sync::Arc;

/// Ticks from a copy of the simulation to its local model, as a busy server takes.
const MODEL_TICKS: u64 = 16;

/// What stands between a path and a body.
#[derive(Clone, Debug)]
pub struct Loop {
    /// What renders.
    pub device: Device,
    /// What holds it.
    pub hand: Hand,
    /// How the client renders.
    pub mode: RenderMode,
    /// Either way of the network.
    pub link: LinkConditions,
}

/// What a hand went through in a tick.
#[derive(Clone, Copy, Debug)]
pub struct Moment {
    /// Force that the device gave [N].
    pub force: Vec3,
    /// Where the device has come by the end of it [m].
    pub position: Vec3,
    /// Energy that the renderer has seen going out to the hand [J].
    pub energy: Real,
    /// What the core says of the tool.
    pub tool: ToolOutput,
}

/// A hand on a tool.
struct Client<'a> {
    path: Box<dyn Fn(Real) -> Target + 'a>,
    held: HeldDevice,
    renderer: Renderer,
    poses: Link<(u32, Vec3)>,
    wrenches: Link<Wrench>,
    local: LocalModel,
    /// What happens to the tool next beside its poses.
    event: Option<ToolEvent>,
    /// False from when its process is dead.
    alive: bool,
}

/// A body and the hands on it.
pub struct Lockstep<'a> {
    core: Simulation,
    probe: Probe,
    clients: Vec<Client<'a>>,
    found: [Option<Stiffness>; MOST_TOOLS],
    /// What will be found, and in which tick.
    next: Option<(u64, [Option<Stiffness>; MOST_TOOLS])>,
    tick: u64,
}

impl<'a> Lockstep<'a> {
    /// The body at rest, nobody there.
    ///
    /// # Errors
    /// When the body does not fit the simulation.
    pub fn new(body: &Arc<Body>, settings: Settings) -> Result<Self> {
        let start = Snapshot::at_rest(body, 0, settings.tools.len());
        let core = Simulation::new(body.clone(), settings.clone(), start).map_err(Error::other)?;
        let probe = Probe::new(body.clone(), settings).map_err(Error::other)?;
        Ok(Self { core, probe, clients: Vec::new(), found: [None; MOST_TOOLS], next: None, tick: 0 })
    }

    /// A hand takes the next tool and follows `path`, a function of time [s]; `seed` is that of its network.
    pub fn attach(&mut self, on: &Loop, path: impl Fn(Real) -> Target + 'a, seed: u64) {
        let coupling = Coupling { compliance: 1.0 / on.device.max_stiffness, ..Coupling::RIGID };
        self.clients.push(Client {
            held: HeldDevice::new(on.device.clone(), on.hand, path(0.0).position),
            path: Box::new(path),
            renderer: Renderer::new(&on.device, on.mode),
            poses: Link::new(on.link, seed),
            wrenches: Link::new(on.link, seed ^ 0x5eed),
            local: LocalModel::default(),
            event: Some(ToolEvent::Attach { epoch: 1, period_ticks: 1, coupling }),
            alive: true,
        });
    }

    /// The process of a hand is killed: no pose comes any more. `noticed`: the system closes its connection, and the
    /// server frees the tool; otherwise only silence tells.
    pub fn kill(&mut self, tool: usize, noticed: bool) {
        let client = &mut self.clients[tool];
        client.alive = false;
        client.event = noticed.then_some(ToolEvent::Detach);
    }

    /// Goes on by a tick. What every hand that is there went through, by tool.
    ///
    /// # Errors
    /// When the client library does not understand the core.
    pub fn step(&mut self) -> Result<Vec<Moment>> {
        self.tick += 1;
        let (tick, now_ns) = (self.tick, self.tick * 1_000_000);
        let mut inputs = Inputs::default();
        let mut moments: Vec<Moment> = Vec::with_capacity(self.clients.len());
        for (client, event) in self.clients.iter_mut().zip(&mut inputs.tools) {
            let (force, position) = client.render(tick);
            let energy = client.renderer.observed_energy();
            moments.push(Moment { force, position, energy, tool: ToolOutput::default() });
            while let Some((sequence, position)) = client.poses.poll(now_ns) {
                *event = Some(pose(sequence, position)).filter(|_| client.alive);
            }
            *event = client.event.take().or(*event);
        }
        let outputs = self.core.advance(&inputs);
        let flags = outputs.flags();
        if self.next.is_some_and(|(at, _)| at == tick) {
            self.found = self.next.take().map_or(self.found, |(_, found)| found);
        }
        for (i, (client, moment)) in self.clients.iter_mut().zip(&mut moments).enumerate() {
            moment.tool = outputs.tools[i];
            let mut message = wire::wrench(i as u32, tick, tick, &moment.tool, flags);
            wire::add_model(&mut message, client.local.update(&moment.tool, &self.found[i]));
            client.wrenches.send(now_ns, Wrench::try_from(&message).map_err(Error::other)?);
        }
        if tick.is_multiple_of(TICKS_PER_FRAME) && moments.iter().any(|m| m.tool.state.touches()) {
            self.next = Some((tick + MODEL_TICKS, self.probe.stiffness(&self.core.snapshot())));
        }
        Ok(moments)
    }
}

impl Client<'_> {
    /// One tick of hand, device and client library: the force given [N], and where the device has come [m].
    fn render(&mut self, tick: u64) -> (Vec3, Vec3) {
        let now_ns = tick * 1_000_000;
        while let Some(wrench) = self.wrenches.poll(now_ns) {
            self.renderer.receive(&wrench, now_ns);
        }
        let (x, v) = (self.held.reported_position(), self.held.reported_velocity());
        let force = self.renderer.force(x.into(), v.into(), now_ns);
        self.poses.send(now_ns, (tick as u32, x));
        let commanded = Given { force: Vec3::from(force), ..Given::default() };
        let given = self.held.step(TICK, &(self.path)(tick as Real * TICK), commanded);
        (given.force, self.held.position())
    }
}

/// A device's pose as the tick consumes it.
pub fn pose(sequence: u32, position: Vec3) -> ToolEvent {
    let pose = Pose { position, ..Pose::default() };
    ToolEvent::Pose(PoseSample { sequence, time_ns: 0, pose, buttons: 0, opening: 0.0 })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::stability::{cube, network, over, settings};
    use palpate_core::contact::tool::Phase;
    use palpate_phantom::{Path, Pattern, Site};
    use rayon::prelude::*;

    /// Touching the cube `aside` [m] of the middle of its top, and 8 mm into it.
    fn path(pattern: Pattern, aside: Real) -> Path {
        let point = over(0.0) + Vec3::new(aside, 0.0, 0.0);
        Path { pattern, site: Site { point, normal: Vec3::z(), tangent: Vec3::x(), standoff: 0.01, depth: 0.008 } }
    }

    /// Greatest force [N], greatest energy that the renderer saw going out to the hand [J], and the same from the forces
    /// and the ways that the device really went, not those that its encoders report.
    fn play(body: &Arc<Body>, on: &Loop, pattern: Pattern) -> [Real; 3] {
        let path = path(pattern, 0.0);
        let mut lockstep = Lockstep::new(body, settings(1)).unwrap();
        lockstep.attach(on, |t| path.target(t), 7);
        let (mut peak, mut seen, mut net, mut work): (Real, Real, Real, Real) = (0.0, 0.0, 0.0, 0.0);
        let mut last = path.target(0.0).position;
        for _ in 0..3500 {
            let now = lockstep.step().unwrap()[0];
            (peak, seen) = (peak.max(now.force.norm()), seen.max(now.energy));
            work += now.force.dot(&(now.position - last));
            (net, last) = (net.max(work), now.position);
        }
        [peak, seen, net]
    }

    #[test]
    fn no_pattern_over_any_network_gives_out_more_than_the_budget() {
        let [soft, stiff] = [200.0, 1600.0].map(|stiffness| cube(stiffness).unwrap());
        let [omni, omega] = ["PHANTOM Omni", "omega"].map(|name| Device::by_name(name).unwrap());
        let guarded = RenderMode::LocalModelPassive;
        let mut cases = Vec::new();
        for pattern in [Pattern::Press, Pattern::Palpate, Pattern::Stroke, Pattern::Tap, Pattern::Tremor] {
            for (body, device) in [(&soft, &omni), (&stiff, &omni), (&stiff, &omega)] {
                cases.extend([0, 5, 20].map(|delay| (body, device, pattern, delay, guarded)));
            }
            // What the local model and the controller are for.
            cases.push((&stiff, &omni, pattern, 20, RenderMode::Raw));
        }
        let raw_share = |(body, device, pattern, delay, mode): &(&Arc<Body>, &Device, Pattern, u64, RenderMode)| {
            let on = Loop { device: (*device).clone(), hand: Hand::default(), mode: *mode, link: network(*delay) };
            let ([peak, seen, net], budget) = (play(body, &on, *pattern), device.passivity_budget());
            let [seen, net] = [seen / budget, net / budget];
            println!("{pattern:?}, {}, {delay} ms, {mode:?}: {peak:.2} N, {seen:.3}, {net:.3} of budget", device.name);
            assert!(peak > 0.1, "{pattern:?} touches: {peak} N");
            assert!(
                *mode != guarded || (seen <= 1.0 && net <= 1.0),
                "{pattern:?}, {delay} ms: {seen}, {net} of budget"
            );
            if *mode == guarded { 0.0 } else { seen }
        };
        let worst_raw = cases.par_iter().map(raw_share).reduce(|| 0.0, Real::max);
        assert!(worst_raw > 10.0, "unguarded, {worst_raw} times the budget");
    }

    /// What the second of two hands feels [N] while both press 28 mm apart and hold, (n_ticks), and the first tool.
    fn two_hands(first: impl Fn(&mut Lockstep, u64)) -> Vec<(Vec3, ToolOutput)> {
        let body = cube(400.0).unwrap();
        // Without friction and steps of its encoders the device shows what the tissue does.
        let device = Device { friction: 0.0, resolution: 1e-9, ..Device::default() };
        let on = Loop { device, hand: Hand::default(), mode: RenderMode::default(), link: network(0) };
        let mut lockstep = Lockstep::new(&body, settings(2)).unwrap();
        for aside in [-0.014, 0.014] {
            // The phantom's press holds from 1.5 s to 2.5 s; this one holds on.
            let path = path(Pattern::Press, aside);
            lockstep.attach(&on, move |t| path.target(t.min(2.0)), 7);
        }
        let felt = |tick| {
            first(&mut lockstep, tick);
            let moments = lockstep.step().unwrap();
            (moments[1].force, moments[0].tool)
        };
        (1..=3500).map(felt).collect()
    }

    #[test]
    fn when_one_of_two_hands_is_killed_the_other_feels_nothing_but_the_tissue() {
        const KILLED: usize = 2000;
        let kill = |noticed: Option<bool>, at: usize| {
            two_hands(move |lockstep, tick| {
                if let Some(noticed) = noticed.filter(|_| tick == at as u64) {
                    lockstep.kill(0, noticed);
                }
            })
        };
        let runs: Vec<_> = [(None, 0), (Some(true), 1), (Some(true), KILLED), (Some(false), KILLED)]
            .into_par_iter()
            .map(|(noticed, at)| kill(noticed, at))
            .collect();
        let [both, alone, dead, silent] = &runs[..] else { unreachable!() };
        let change = |felt: &[(Vec3, ToolOutput)]| -> Real {
            felt.windows(2).map(|pair| (pair[1].0 - pair[0].0).norm()).fold(0.0, Real::max)
        };
        let bound = change(both);
        let end = |felt: &[(Vec3, ToolOutput)]| felt[3400..].iter().map(|f| f.0.norm()).sum::<Real>() / 100.0;
        println!("with the other {:.4} N, alone {:.4} N, {bound:.4} N in a tick at most", end(both), end(alone));
        for (name, run) in [("killed", dead), ("silent", silent)] {
            let before = run[KILLED - 2].0.norm();
            let (most, after) = (change(&run[KILLED - 2..]), end(run));
            println!("{name}: {before:.4} N before, {after:.4} N after, {most:.4} N in a tick at most");
            assert!(before > 0.3 && run[..KILLED - 1].iter().zip(&both[..]).all(|(a, b)| a.0 == b.0));
            assert!(most <= bound, "{most} N in a tick, {bound} N where nobody is killed");
            // What is left is the touch of one hand, as if the other had never been there; that had taken 1.7 % of it.
            assert!((after / end(alone) - 1.0).abs() < 5e-3, "{after} N");
        }
        let tool = |run: &[(Vec3, ToolOutput)], after: usize| run[KILLED - 2 + after].1;
        let before = tool(dead, 0).state.force.norm();
        assert!(before > 0.3 && tool(dead, 0).contact_points > 0);
        // Noticed, the tool leaves the body at once, and its force falls as fast as a force may.
        assert_eq!((tool(dead, 1).contact_points, tool(dead, 1).state.phase), (0, Phase::Detached));
        assert!(tool(dead, 4).state.force == Vec3::zeros());
        // Silent, it is held, its force falls from 20 ms to 70 ms, and at 100 ms it leaves.
        for (ms, share) in [(19, 1.0), (45, 0.5), (70, 0.0)] {
            let force = tool(silent, ms).state.force.norm();
            assert!((force / before - share).abs() < 0.05, "{force} N after {ms} ms");
        }
        assert!(tool(silent, 98).contact_points > 0);
        assert_eq!((tool(silent, 101).contact_points, tool(silent, 101).state.phase), (0, Phase::Detached));
    }
}
