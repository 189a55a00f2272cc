//! Figure 7's loop with a tool, as printed: collisions once a frame, surface points moved out of the tool over the frame,
//! the nodes that they hang on moved with them, γ for the rest; and the core on the same meshes, of the same material, under
//! the same ball.

use super::{Claim, Verdict};
use crate::Progress;
use crate::levels::Levels;
use crate::plot::{Chart, Curve, charts, table};
use crate::printed::{FRAME, Options, Printed, Stepping};
use crate::trial::{Trial, attached, body_of, detached, held_at};
use palpate_core::adaptation::Adaptivity;
use palpate_core::math::{Bounds, Real, Vec3};
use palpate_core::model::Material;
use palpate_core::model::step_class::TICK;
use palpate_core::simulation::Inputs;
use rayon::prelude::*;
use std::io::Result;
use std::path::Path;

/// Edge of the cube [m], clamped at x = 0; the ball comes from the other side.
const SIDE: Real = 0.1;
const RADIUS: Real = 0.02;
/// Deepest [m].
const DEPTH: Real = 0.008;
/// Display points along an edge of the face that is pressed.
const POINTS: u32 = 40;
/// The ball is down, begins to go, and is gone [s].
const DOWN: Real = 0.3;
const UP: Real = 0.8;
const GONE: Real = 0.9;
/// Merge below the first, split above the second γ [m].
const GAMMA: [Real; 2] = [1.5e-4, 4e-4];
/// φ/λ = ψ/μ [s] of the damped runs.
pub const TAU: Real = 0.004;
/// A step of a force that a hand can just feel, over the force.
const FELT: Real = 0.07;

/// Levels of the cube, of `cells` along an edge each; viscosities of `tau` [s].
pub fn cube(cells: &[u32], tau: Real) -> Levels {
    let material = Material::from_young(1e4, 0.35, 1000.0);
    let material = Material { phi: tau * material.lambda, psi: tau * material.mu, ..material };
    let cells: Vec<[u32; 3]> = cells.iter().map(|c| [*c; 3]).collect();
    Levels::of_box(Vec3::repeat(SIDE), &cells, material, true)
}

/// Centre of the ball at `time` [s].
fn ball_at(time: Real) -> Vec3 {
    let air = 0.002;
    let depth = match time {
        t if t < DOWN => (DEPTH + air) * t / DOWN - air,
        t if t < UP => DEPTH,
        t => DEPTH - (DEPTH + 2.0 * air) * ((t - UP) / (GONE - UP)).min(1.0),
    };
    Vec3::new(SIDE + RADIUS - depth, 0.47 * SIDE, 0.52 * SIDE)
}

/// A display point's triangle on one level, and its weights.
type Hung = ([usize; 3], [Real; 3]);

/// The surface that is displayed and touched [DDCB01 4.1]: points on the face, each on a triangle of every level.
struct Skin {
    /// Triangle of each point, by level.
    on: Vec<Vec<Hung>>,
}

impl Skin {
    fn new(levels: &Levels) -> Self {
        let faces: Vec<Vec<[usize; 3]>> = (0..levels.count())
            .map(|r| {
                let all = levels.tied[r].mesh.boundary();
                let numbered = all.into_iter().map(|t| t.map(|n| levels.first_node[r] + n as usize));
                numbered.filter(|t| t.iter().all(|n| levels.rest[*n].x > SIDE - 1e-9)).collect()
            })
            .collect();
        let place = |i: u32| (Real::from(i) + 0.5) * SIDE / Real::from(POINTS);
        let hung = |y: Real, z: Real| {
            let in_level = |face: &Vec<[usize; 3]>| {
                let weights = |t: &[usize; 3]| {
                    let [a, b, c] = t.map(|n| (levels.rest[n].y, levels.rest[n].z));
                    let cross = |p: (Real, Real), q: (Real, Real), r: (Real, Real)| {
                        (q.0 - p.0) * (r.1 - p.1) - (r.0 - p.0) * (q.1 - p.1)
                    };
                    let whole = cross(a, b, c);
                    [cross((y, z), b, c), cross(a, (y, z), c), cross(a, b, (y, z))].map(|part| part / whole)
                };
                let inside = |t: &[usize; 3]| weights(t).into_iter().fold(Real::INFINITY, Real::min);
                // The face is covered, so one contains the point.
                let best = face.iter().max_by(|a, b| inside(a).total_cmp(&inside(b))).copied().unwrap_or_default();
                (best, weights(&best))
            };
            faces.iter().map(in_level).collect::<Vec<Hung>>()
        };
        Self { on: (0..POINTS * POINTS).map(|i| hung(place(i % POINTS), place(i / POINTS))).collect() }
    }

    /// Area of a point [m²].
    fn area(&self) -> Real {
        SIDE * SIDE / self.on.len() as Real
    }

    /// The triangle that a point hangs on now: that with the most active nodes, the finer of two alike.
    fn now<'a>(&'a self, point: usize, active: &[bool]) -> &'a Hung {
        let count = |h: &&Hung| h.0.iter().filter(|n| active[**n]).count();
        // Of several largest, `max_by_key` takes the last.
        self.on[point].iter().max_by_key(count).unwrap_or(&self.on[point][0])
    }
}

/// The response to the tool, by how "the force on a surface point is weighted by the area that it samples" is read.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Response {
    /// Sum of what the nodes transmit, not weighted [N].
    pub sum: Real,
    /// Each point weighted by its part of the area that collides [N].
    pub mean: Real,
    /// Each point weighted by its area [N·m²].
    pub area: Real,
}

/// What a run gave.
#[derive(Clone, Debug, Default)]
pub struct Felt {
    /// Response over time [s]; the core has a force, in [`Response::sum`] alone.
    pub response: Vec<(Real, Response)>,
    /// Active nodes over time [s].
    pub nodes: Vec<(Real, Real)>,
    /// Displacement of the middle of the face along x [m] over time [s].
    pub face: Vec<(Real, Real)>,
    /// Part of the time that the tool rests in which all nodes that it moves are of the finest level; of the core the nearest
    /// node.
    pub finest: Real,
    /// When it blew up [s].
    pub blown: Option<Real>,
}

impl Felt {
    /// Mean of a response while the tool rests.
    pub fn resting(&self, of: fn(&Response) -> Real) -> Real {
        let all: Vec<Real> = self.response.iter().filter(|(t, _)| (0.6..UP).contains(t)).map(|(_, r)| of(r)).collect();
        all.iter().sum::<Real>() / all.len() as Real
    }

    /// Largest change of the force within a millisecond while the tool touches, over the force at rest.
    pub fn largest_step(&self) -> Real {
        let touching = |t: Real| (0.1..UP).contains(&t);
        let steps = self.response.windows(2).filter(|two| touching(two[0].0) && touching(two[1].0));
        steps.map(|two| (two[1].1.sum - two[0].1.sum).abs()).fold(0.0, Real::max) / self.resting(|r| r.sum).abs()
    }
}

/// The printed loop, for `duration` [s].
pub fn printed(levels: &Levels, duration: Real) -> Felt {
    let skin = Skin::new(levels);
    let tau = levels.material.damping_time();
    // Kelvin–Voigt shortens the limit of eq. 10, which knows no viscosity.
    let xi = tau * levels.material.wave_speed() / levels.altitude.iter().copied().fold(Real::INFINITY, Real::min);
    let safety = 0.5 * ((1.0 + xi * xi).sqrt() - xi);
    let options =
        Options { stepping: Stepping::OwnStale, filter: false, safety, gamma: Some(GAMMA), gravity: Vec3::zeros() };
    let mut body = Printed::new(levels, levels.uniform(0), vec![Vec3::zeros(); levels.rest.len()], options);
    let mut felt = Felt::default();
    let (mut rests, mut finest) = (0, 0);
    // A polygon whose corners are on the ball still intersects it, up to this deep.
    let across = SIDE / Real::from(POINTS);
    let tolerance = across * across / (4.0 * RADIUS);
    let middle = (POINTS * POINTS / 2 + POINTS / 2) as usize;
    for frame in 0..(duration / FRAME) as usize {
        let (start, end) = (frame as Real * FRAME, (frame + 1) as Real * FRAME);
        let centre = ball_at(end);
        // Colliding points, and by node the sum of their weights, and of their weighted way out.
        let mut colliding: Vec<(usize, [Real; 3])> = Vec::new();
        let mut on_node = vec![(0.0, 0.0); levels.rest.len()];
        for point in 0..skin.on.len() {
            let (nodes, weights) = skin.now(point, body.active());
            let p: Vec3 = nodes.iter().zip(weights).map(|(n, w)| body.positions()[*n] * *w).sum();
            let d = p - centre;
            let aside = RADIUS * RADIUS - d.y * d.y - d.z * d.z;
            let out = d.x + aside.max(0.0).sqrt();
            if aside <= 0.0 || out < -tolerance {
                continue;
            }
            colliding.push((point, *weights));
            for (n, w) in nodes.iter().zip(weights).filter(|(n, _)| body.active()[**n]) {
                on_node[*n].0 += w;
                on_node[*n].1 += w * out.max(0.0);
            }
        }
        let moved: Vec<(usize, Vec3)> = (0..on_node.len())
            .filter(|n| on_node[*n].0 > 1e-9)
            .map(|n| (n, -Vec3::x() * (on_node[n].1 / on_node[n].0 / FRAME)))
            .collect();
        if start > DOWN && start < UP {
            rests += 1;
            let last = levels.count() - 1;
            finest += usize::from(!moved.is_empty() && moved.iter().all(|(n, _)| levels.level_of[*n] == last));
        }
        let active = body.active().to_vec();
        body.hold(&moved, (centre, RADIUS));
        let mut response = Vec::new();
        body.frame(&mut |body, time| {
            let mut of_node = vec![0.0; on_node.len()];
            body.transmitted().for_each(|(n, force)| of_node[n] = force.x);
            let mut now = Response { sum: of_node.iter().sum(), ..Response::default() };
            for (point, weights) in &colliding {
                let (nodes, _) = skin.now(*point, &active);
                let share =
                    |(n, w): (&usize, &Real)| if on_node[*n].0 > 1e-9 { of_node[*n] * w / on_node[*n].0 } else { 0.0 };
                let force: Real = nodes.iter().zip(weights).map(share).sum();
                now.area += skin.area() * force;
                now.mean += force / colliding.len() as Real;
            }
            response.push((start + time, now));
        });
        // One sample a millisecond: shorter steps are no coarser force.
        let mut last = 0;
        for sample in response {
            let millisecond = (sample.0 / TICK - 1e-6).floor() as i64;
            if millisecond > last || felt.response.is_empty() {
                felt.response.push(sample);
                last = millisecond;
            }
        }
        let (nodes, weights) = skin.now(middle, body.active());
        let place: Vec3 = nodes.iter().zip(weights).map(|(n, w)| body.positions()[*n] * *w).sum();
        felt.face.push((end, place.x - SIDE));
        felt.nodes.push((end, body.active().iter().filter(|a| **a).count() as Real));
        if !body.positions().iter().zip(body.active()).all(|(x, a)| !a || x.norm() < 10.0 * SIDE) {
            felt.blown = Some(end);
            break;
        }
    }
    felt.finest = Real::from(finest as u32) / Real::from(rests.max(1) as u32);
    felt
}

/// The core on the same meshes, for `duration` [s]: adaptive, or with all of the finest level active.
///
/// # Errors
/// When it cannot be prepared.
pub fn core(levels: &Levels, adaptive: bool, duration: Real) -> Result<Felt> {
    let body = body_of(levels, 0.0, 4000)?;
    let last = levels.count() - 1;
    let trial = Trial::ball(RADIUS, adaptive.then(Adaptivity::default));
    let mut run = trial.on_level(&body, if adaptive { 0 } else { last })?;
    let middle = Bounds::of(levels.rest.iter().copied()).high.component_mul(&Vec3::new(1.0, 0.5, 0.5));
    let from_middle = |v: &palpate_core::ids::Vertex| (body.surface().vertices[v.index()] - middle).norm();
    let middle = body.vertices().min_by(|a, b| from_middle(a).total_cmp(&from_middle(b)));
    let mut felt = Felt::default();
    let (mut rests, mut finest) = (0, 0);
    for tick in 0..(duration / TICK) as u32 {
        let time = Real::from(tick) * TICK;
        let inputs = match time {
            _ if tick == 0 => attached(),
            t if t < GONE => held_at(tick, ball_at(time + TICK)),
            t if t < GONE + TICK => detached(),
            _ => Inputs::default(),
        };
        let outputs = run.advance(&inputs);
        let response = Response { sum: outputs.tools[0].state.physical_force.x, ..Response::default() };
        let nodes = Real::from(outputs.active.iter().sum::<u32>());
        if outputs.restored {
            felt.blown = Some(time);
            break;
        }
        felt.response.push((time + TICK, response));
        felt.nodes.push((time + TICK, nodes));
        if let Some(v) = middle {
            felt.face.push((time + TICK, run.mesh().vertex(v).x - body.surface().vertices[v.index()].x));
        }
        if time > DOWN && time < UP {
            let (mesh, centre) = (run.mesh(), ball_at(time));
            let near = |s: &&palpate_core::ids::Slot| (mesh.position(**s) - centre).norm();
            let nearest = mesh.active().iter().min_by(|a, b| near(a).total_cmp(&near(b)));
            rests += 1;
            finest += usize::from(nearest.is_some_and(|s| body.level_of(mesh.node(*s)) == last));
        }
    }
    felt.finest = Real::from(finest as u32) / Real::from(rests.max(1) as u32);
    Ok(felt)
}

/// Levels, and how long they run [s].
const CELLS: [u32; 3] = [4, 7, 12];
const DURATION: Real = 2.2;

/// Claims about the loop and the force that it returns.
///
/// # Errors
/// When a picture cannot be written.
pub fn claims(out: &Path, progress: Progress) -> Result<Vec<Claim>> {
    progress("figure 7's loop under a tool");
    let damped = cube(&CELLS, TAU);
    let free = cube(&CELLS, 0.0);
    let run = |i: &usize| -> Result<Felt> {
        match i {
            0 => Ok(printed(&damped, DURATION)),
            1 => core(&damped, true, DURATION),
            2 => core(&damped, false, DURATION),
            3 => Ok(printed(&free, DURATION)),
            4 => core(&free, true, DURATION),
            _ => core(&free, false, DURATION),
        }
    };
    let all: Vec<Felt> = [0, 1, 2, 3, 4, 5].par_iter().map(run).collect::<Result<_>>()?;
    let names = ["printed loop", "the core", "the core, finest level"];
    let mut panels = Vec::new();
    for (three, damping) in all.chunks(3).zip(["damped", "undamped"]) {
        let panel = |what: &str, y_label: &str, of: &dyn Fn(&Felt) -> Vec<(Real, Real)>, y_range| Chart {
            title: format!("{what}, {damping}"),
            x_label: "time [s]".into(),
            y_label: y_label.into(),
            curves: three
                .iter()
                .zip(names)
                .map(|(felt, name)| Curve { name: name.into(), points: of(felt), ..Curve::default() })
                .collect(),
            y_range,
            ..Chart::default()
        };
        let most = three[2].resting(|r| r.sum);
        panels.push(panel(
            "force on the tool",
            "force [N]",
            &|f| f.response.iter().map(|(t, r)| (*t, r.sum)).collect(),
            Some((-0.5 * most, 2.5 * most)),
        ));
        panels.push(panel(
            "middle of the face",
            "displacement [mm]",
            &|f| f.face.iter().map(|(t, x)| (*t, 1e3 * x)).collect(),
            Some((-12.0, 12.0)),
        ));
        panels.push(panel("active nodes", "nodes", &|f| f.nodes.clone(), None));
    }
    charts(out, "tool_loop", "Figure 7's loop: a ball pressed in, held, and taken away", &panels)?;
    let mut rows = Vec::new();
    for (i, felt) in all.iter().enumerate() {
        let mean = felt.nodes.iter().map(|n| n.1).sum::<Real>() / felt.nodes.len() as Real;
        rows.push(vec![
            names[i % 3].into(),
            if i < 3 { format!("{:.0} ms", 1e3 * TAU) } else { "none".into() },
            format!("{:.3}", felt.resting(|r| r.sum)),
            if i % 3 == 0 { format!("{:.4}", felt.resting(|r| r.mean)) } else { "–".into() },
            if i % 3 == 0 { format!("{:.4}", 1e6 * felt.resting(|r| r.area)) } else { "–".into() },
            format!("{:.1} %", 100.0 * felt.largest_step()),
            format!("{:.0} %", 100.0 * felt.finest),
            format!("{mean:.0}"),
            felt.blown.map_or("no".into(), |t| format!("at {t:.2} s")),
        ]);
    }
    let header = [
        "method",
        "damping τ",
        "force at rest: sum [N]",
        "by part of the area [N]",
        "by area [N·mm²]",
        "largest step in 1 ms",
        "finest under the tool",
        "active nodes, mean",
        "blown up",
    ];
    let (loop_, ours, fine) = (&all[0], &all[1], &all[2]);
    let off = |felt: &Felt| felt.resting(|r| r.sum) / fine.resting(|r| r.sum) - 1.0;
    let step = |felt: &Felt| {
        format!("the force changes by up to {:.1} % of itself within a millisecond", 100.0 * felt.largest_step())
    };
    let stable = |felt: &Felt| {
        felt.blown.map_or_else(|| "runs to the end".to_owned(), |t| format!("blows up {:.2} s after the start", t))
    };
    Ok(vec![
        Claim {
            section: "3.3, fig. 7",
            says: "The loop runs under a tool, the finest level where the tool is, with damping and without",
            measured: format!(
                "A ball of {:.0} mm pressed {:.0} mm into a cube of 100 mm on levels of {} cells along an edge, held, and taken \
                 away; γ splits above {} and merges below {} m. Without damping the core's loop is the same.\n\n{}",
                1e3 * RADIUS,
                1e3 * DEPTH,
                CELLS.map(|c| c.to_string()).join(", "),
                GAMMA[1],
                GAMMA[0],
                table(out, "tool-loop", &header, &rows)?
            ),
            picture: Some(("tool_loop", "force, displacement and active nodes of the printed loop and of the core".into())),
            printed: Some(Verdict::new(
                all[0].blown.is_none() && all[3].blown.is_none() && loop_.finest > 0.95,
                format!(
                    "damped it {}, undamped it {}; finest under the tool {:.0} % of the time",
                    stable(&all[0]),
                    stable(&all[3]),
                    100.0 * loop_.finest
                ),
            )),
            shipped: Some(Verdict::new(
                all[1].blown.is_none() && all[4].blown.is_none() && ours.finest > 0.95,
                format!(
                    "damped it {}, undamped it {}; finest under the tool {:.0} % of the time",
                    stable(&all[1]),
                    stable(&all[4]),
                    100.0 * ours.finest
                ),
            )),
        },
        Claim {
            section: "4.2",
            says: "Motion spread over the frame prevents discontinuities of the response force",
            measured: format!("From the same damped runs. A hand can just feel a step of {:.0} %.", 100.0 * FELT),
            picture: None,
            printed: Some(Verdict::new(loop_.largest_step() < FELT, step(loop_))),
            shipped: Some(Verdict::new(ours.largest_step() < FELT, step(ours))),
        },
        Claim {
            section: "4.2",
            says: "The response force that is computed from the inner physical model is correct",
            measured: "From the same damped runs, while the ball rests: against the core with all of the finest level active. \
                       The core's contact pushes only, and has the compliance of the dent that elements are too large to show; \
                       the printed response holds every colliding point."
                .into(),
            picture: None,
            printed: Some(Verdict::new(off(loop_).abs() < 0.1, format!("the sum of the nodes' forces is {:+.1} % off", 100.0 * off(loop_)))),
            shipped: Some(Verdict::new(off(ours).abs() < 0.1, format!("the force is {:+.1} % off", 100.0 * off(ours)))),
        },
    ])
}
