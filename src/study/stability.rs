//! How stiff a body may be before the hand that feels it over a network shakes: every device preset, delay and way of
//! rendering, with the real core, the real client library and the virtual Phantom's device and hand in one loop, in
//! simulated time.

use super::Progress;
use super::lockstep::{Lockstep, Loop};
use super::plot::{Chart, Curve, charts, table};
use palpate_body::prepare::{self, Recipe, Region, prepare};
use palpate_core::adaptation::Adaptivity;
use palpate_core::contact::safety::ForceLimits;
use palpate_core::contact::tool::{Following, Shape, Tool};
use palpate_core::geometry::primitives::box_surface;
use palpate_core::math::{Bounds, Real, Vec3};
use palpate_core::model::step_class::TICK;
use palpate_core::model::{Body, Material};
use palpate_core::simulation::Settings;
use palpate_phantom::{Hand, Target};
use palpate_sdk::{Device, LinkConditions, RenderMode};
use rayon::prelude::*;
use std::io::{Error, Result};
use std::path::Path;
use std::sync::Arc;

/// Edge of the body [m].
const SIDE: Real = 0.1;
/// Radius of the ball [m].
const RADIUS: Real = 0.01;
/// How far below the surface the hand wants to go [m].
const DEPTH: Real = 0.006;
/// Length of a run [s], and of its end in which the hand should be at rest.
const LENGTH: Real = 2.0;
const REST: Real = 0.5;
/// One-way delays [ms].
pub const DELAYS: [u64; 6] = [0, 1, 2, 5, 10, 20];
/// Part of the messages that never arrive.
const LOSS: f64 = 0.05;
/// Stiffnesses between which the map is drawn [N/m].
const SOFTEST: Real = 50.0;
const STIFFEST: Real = 1600.0;
/// The way of rendering and how it is called.
pub const WAYS: [(RenderMode, &str); 4] = [
    (RenderMode::Raw, "raw force"),
    (RenderMode::Passive, "passivity control"),
    (RenderMode::LocalModel, "local model"),
    (RenderMode::LocalModelPassive, "local model and passivity control"),
];

/// What the hand went through.
#[derive(Clone, Debug)]
pub struct Felt {
    /// Force that the device gave along the normal [N], (n_ticks).
    pub force: Vec<Real>,
    /// Height of the device over the undeformed surface [m], (n_ticks).
    pub height: Vec<Real>,
    /// Most energy that the renderer saw going out to the hand [J].
    pub energy: Real,
}

impl Felt {
    /// How far the hand still moves to and fro at the end [m].
    pub fn shake(&self) -> Real {
        let end = &self.height[self.height.len() - (REST / TICK) as usize..];
        let (low, high) = end.iter().fold((Real::INFINITY, Real::NEG_INFINITY), |(l, h), x| (l.min(*x), h.max(*x)));
        high - low
    }
}

/// To and fro up to this [m] is the device's own: some steps of its encoders and what its friction holds.
const STILL: Real = 4e-4;

/// A cube whose relaxed stiffness under the ball, pressed in by 1 mm, is about `stiffness` [N/m]; deeper in it is
/// stiffer, but a hand gets no deeper into a stiff one.
pub fn cube(stiffness: Real) -> Result<Arc<Body>> {
    let surface = box_surface(Vec3::repeat(SIDE), [16; 3]);
    let recipe = Recipe {
        name: "study".into(),
        shape: prepare::Shape::closed(surface, vec![0.034, 0.022]),
        material: Material::from_young(stiffness * MODULUS_FOR, 0.45, 1050.0),
        inclusions: vec![],
        holds: vec![Region {
            bounds: Bounds::new(Vec3::zeros(), Vec3::new(SIDE, SIDE, 0.0)),
            stiffness: None,
            exact: false,
        }],
        elements: Default::default(),
        damping_ratio: 0.15,
    };
    Ok(Arc::new(prepare(&recipe, &mut |_, _, _| {}).map_err(Error::other)?))
}

/// Young's modulus [Pa] that gives the cube a newton per metre: the force is proportional to it at a given depth.
const MODULUS_FOR: Real = 135.3;

/// Of a simulation of a cube under `tools` balls.
pub fn settings(tools: usize) -> Settings {
    let ball = Tool { name: "ball".into(), shape: Shape::ball(RADIUS), friction: 0.0, pivot: None };
    Settings {
        gravity: Vec3::zeros(),
        tools: vec![ball; tools],
        obstacles: vec![],
        organ_friction: Default::default(),
        support_motions: vec![],
        following: Following { speed: 1.0, engage_ticks: 100 },
        limits: ForceLimits { force: 20.0, torque: 1.0, slew: 1000.0 },
        adaptivity: Some(Adaptivity::default()),
        most_elements: 60_000,
    }
}

/// Where the hand wants to be: from 5 mm above the surface to [`DEPTH`] below it within 0.4 s, and there it stays.
fn target(time: Real) -> Target {
    let (from, to, in_time) = (0.005, -DEPTH, 0.4);
    let s = (time / in_time).min(1.0);
    let height = from + (to - from) * s * s * (3.0 - 2.0 * s);
    let speed = (to - from) * 6.0 * s * (1.0 - s) / in_time;
    Target::upright(over(height), Vec3::new(0.0, 0.0, speed))
}

/// Centre of the ball when its lowest point is `height` over the middle of the top [m].
pub fn over(height: Real) -> Vec3 {
    Vec3::new(0.5 * SIDE, 0.5 * SIDE, SIDE + RADIUS + height)
}

/// Closes the loop for 2 s.
///
/// # Errors
/// When the body does not fit the simulation.
pub fn close(body: &Arc<Body>, on: &Loop, seed: u64) -> Result<Felt> {
    let mut lockstep = Lockstep::new(body, settings(1))?;
    lockstep.attach(on, target, seed);
    let mut felt = Felt { force: Vec::new(), height: Vec::new(), energy: 0.0 };
    for _ in 0..(LENGTH / TICK) as u64 {
        let now = lockstep.step()?[0];
        felt.force.push(now.force.z);
        felt.height.push(now.position.z - over(0.0).z);
        felt.energy = felt.energy.max(now.energy);
    }
    Ok(felt)
}

/// A network of that one-way delay [ms], jitter up to as much, and loss.
pub fn network(delay: u64) -> LinkConditions {
    let ns = delay * 1_000_000;
    LinkConditions { delay_ns: ns, jitter_ns: ns, loss: if delay > 0 { LOSS } else { 0.0 } }
}

/// The largest stiffness [N/m] on the ladder, up from the softest, at which the hand comes to rest.
fn largest_stable(bodies: &[(Real, Arc<Body>)], on: &Loop) -> Result<Real> {
    let mut largest = 0.0;
    for (stiffness, body) in bodies {
        if close(body, on, 1)?.shake() > STILL {
            break;
        }
        largest = *stiffness;
    }
    Ok(largest)
}

/// The map: the largest stable stiffness for every device, delay and way of rendering, in a firm and in a light grip.
///
/// # Errors
/// When a picture cannot be written.
pub fn map(out: &Path, progress: Progress) -> Result<String> {
    let ladder: Vec<Real> = (0..).map(|i| SOFTEST * Real::powi(2.0, i)).take_while(|k| *k <= STIFFEST).collect();
    progress("bodies from soft to stiff");
    let bodies: Vec<(Real, Arc<Body>)> = ladder.iter().map(|k| Ok((*k, cube(*k)?))).collect::<Result<_>>()?;
    let firm = Hand::default();
    let grips = [
        ("stability", "firm grip, 3 N·s/m", firm),
        ("stability-light", "light grip, 1 N·s/m", Hand { damping: 1.0, ..firm }),
    ];
    let devices: Vec<Device> =
        DEVICES.iter().map(|name| Device::by_name(name).map_err(Error::other)).collect::<Result<_>>()?;
    let mut rows = Vec::new();
    for (name, grip, hand) in grips {
        let mut panels = Vec::new();
        for device in &devices {
            progress(&format!("{}, {grip}", device.name));
            let mut curves = Vec::new();
            for (mode, way) in WAYS {
                let stable: Vec<Real> = DELAYS
                    .par_iter()
                    .map(|delay| {
                        let on = Loop { device: device.clone(), hand, mode, link: network(*delay) };
                        largest_stable(&bodies, &on)
                    })
                    .collect::<Result<_>>()?;
                let mut row = vec![device.name.to_string(), grip.into(), way.into()];
                row.extend(stable.iter().map(|k| format!("{k:.0}")));
                rows.push(row);
                let points: Vec<(Real, Real)> =
                    DELAYS.iter().zip(&stable).map(|(d, k)| (*d as Real, k.max(0.5 * SOFTEST).log10())).collect();
                curves.push(Curve { name: way.into(), dots: points.clone(), points });
            }
            panels.push(Chart {
                title: device.name.to_string(),
                x_label: "one-way delay [ms]".into(),
                y_label: "largest stable stiffness [N/m]".into(),
                curves,
                y_range: Some(((0.5 * SOFTEST).log10(), (1.2 * STIFFEST).log10())),
                powers: true,
                ..Chart::default()
            });
        }
        charts(out, name, &format!("How stiff a body may be before the hand shakes: {grip}"), &panels)?;
    }
    let header = ["device", "grip", "rendering", "0 ms", "1 ms", "2 ms", "5 ms", "10 ms", "20 ms"];
    let text = table(out, "stability-table", &header, &rows)?;
    Ok(format!("{text}{}", faithful(progress)?))
}

/// Devices of the map, by name.
const DEVICES: [&str; 4] = ["Touch", "PHANTOM Omni", "PHANTOM Desktop", "omega"];

/// How far the force over a network is from that without one: root mean square over the peak, at 800 N/m.
fn faithful(progress: Progress) -> Result<String> {
    progress("the force over a network against that without one");
    let body = cube(800.0)?;
    let device = Device::by_name("omega").map_err(Error::other)?;
    let felt = |delay| {
        let on =
            Loop { device: device.clone(), hand: Hand::default(), mode: RenderMode::default(), link: network(delay) };
        close(&body, &on, 1)
    };
    let near = felt(0)?;
    let peak = near.force.iter().copied().fold(0.0, Real::max);
    let mut text = String::from("\nforce at 800 N/m on the omega against that without delay, rms over the peak:");
    for delay in &DELAYS[1..] {
        text += &format!(" {delay} ms {:.1} %;", 100.0 * apart(&near, &felt(*delay)?) / peak);
    }
    Ok(text + "\n")
}

/// Root mean square difference of the force [N].
pub fn apart(a: &Felt, b: &Felt) -> Real {
    let squares: Real = a.force.iter().zip(&b.force).map(|(a, b)| (a - b) * (a - b)).sum();
    (squares / a.force.len() as Real).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::lockstep::pose;
    use palpate_core::contact::tool::{Coupling, ToolEvent};
    use palpate_core::feedback::relaxed::Probe;
    use palpate_core::simulation::{Inputs, Simulation, Snapshot};

    fn loop_with(mode: RenderMode, delay: u64) -> Loop {
        let device = Device::by_name("omega").unwrap();
        Loop { device, hand: Hand::default(), mode, link: network(delay) }
    }

    /// Without it the studied bodies would not be as stiff as the map says.
    #[test]
    fn the_cube_is_as_stiff_as_it_is_called() {
        let body = cube(400.0).unwrap();
        let mut core = Simulation::new(body.clone(), settings(1), Snapshot::at_rest(&body, 0, 1)).unwrap();
        let mut probe = Probe::new(body, settings(1)).unwrap();
        let mut event = Some(ToolEvent::Attach { epoch: 1, period_ticks: 1, coupling: Coupling::RIGID });
        for tick in 0..1200u32 {
            let height = 0.005 - (0.005 + 0.001) * (Real::from(tick) / 500.0).min(1.0);
            let mut inputs = Inputs::default();
            inputs.tools[0] = event.take().or(Some(pose(tick, over(height))));
            core.advance(&inputs);
        }
        let found = probe.stiffness(&core.snapshot())[0].unwrap().matrix.m33;
        assert!((found / 400.0 - 1.0).abs() < 0.05, "{found} N/m");
    }

    #[test]
    fn far_away_a_stiff_body_shakes_the_hand_by_its_raw_force_and_not_by_its_local_model() {
        let body = cube(1600.0).unwrap();
        for delay in [5, 20] {
            let raw = close(&body, &loop_with(RenderMode::Raw, delay), 1).unwrap();
            let model = close(&body, &loop_with(RenderMode::LocalModelPassive, delay), 1).unwrap();
            assert!(raw.shake() > 2.0 * STILL, "{delay} ms: {} m", raw.shake());
            assert!(model.shake() < STILL, "{delay} ms: {} m", model.shake());
            let budget = loop_with(RenderMode::Raw, 0).device.passivity_budget();
            assert!(model.energy <= budget, "{} J given out", model.energy);
        }
    }

    #[test]
    fn a_hand_at_rest_feels_over_a_network_what_it_feels_without_one() {
        let body = cube(800.0).unwrap();
        let at_rest = |delay| {
            let felt = close(&body, &loop_with(RenderMode::LocalModelPassive, delay), 1).unwrap();
            let end = &felt.force[felt.force.len() - (REST / TICK) as usize..];
            end.iter().sum::<Real>() / end.len() as Real
        };
        let near = at_rest(0);
        assert!(near > 0.3, "{near} N");
        for delay in [5, 20] {
            let far = at_rest(delay);
            println!("{far:.4} N at {delay} ms, {near:.4} N without");
            assert!((far / near - 1.0).abs() < 0.05, "{far} N, not {near} N");
        }
    }

    #[test]
    fn over_a_network_the_force_is_that_without_one_within_five_per_cent() {
        let body = cube(800.0).unwrap();
        let felt = |delay, seed| close(&body, &loop_with(RenderMode::LocalModelPassive, delay), seed).unwrap();
        let near = felt(0, 1);
        let peak = near.force.iter().copied().fold(0.0, Real::max);
        for delay in DELAYS {
            for seed in [1, 2] {
                let off = apart(&near, &felt(delay, seed)) / peak;
                println!("{delay} ms: {:.1} % of {peak:.2} N", 100.0 * off);
                assert!(off < 0.05, "{delay} ms: {:.1} %", 100.0 * off);
            }
        }
    }
}
