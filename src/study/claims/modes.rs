//! Abstract: "damped elastic vibration modes are shown to be nearly unchanged for several levels of refinement". Three
//! modes of a clamped cube, pushed gently, on each level by itself, and in the core on mixed levels, too.

use super::swings::{Method, NEARLY};
use super::{Claim, Verdict};
use crate::Progress;
use crate::laws::Law;
use crate::levels::Levels;
use crate::oscillate::{Swing, damped, damping_ratio, strongest_line};
use crate::plot::table;
use crate::trial::{Trial, balanced, body_of};
use palpate_core::ids::Node;
use palpate_core::math::{Real, Vec3};
use palpate_core::model::step_class::TICK;
use palpate_core::simulation::Inputs;
use rayon::prelude::*;
use std::io::Result;
use std::path::Path;

/// φ/λ = ψ/μ [s]: the slowest mode is damped at 2.5 %.
pub const TAU: Real = 0.005;
/// Speed that the modes are pushed with [m/s]: strains stay below a thousandth.
const SPEED: Real = 1e-3;
/// Between two samples [s].
const SAMPLE: Real = 0.005;

/// A mode.
#[derive(Clone, Copy, Debug)]
pub struct Mode {
    /// Its name.
    pub name: &'static str,
    /// How it is pushed, and what of the motion is looked at, at a node at rest at `u` [m].
    pub shape: fn(Vec3) -> Vec3,
    /// Between these its frequency is looked for [Hz].
    pub between: [Real; 2],
}

/// The slowest of its kind each.
pub const MODES: [Mode; 3] = [
    Mode { name: "bending", shape: |u| Vec3::z() * u.x, between: [1.0, 4.0] },
    Mode { name: "torsion", shape: |u| Vec3::x().cross(&(u - Vec3::repeat(0.5))) * u.x, between: [1.0, 6.0] },
    Mode { name: "stretch", shape: |u| Vec3::x() * u.x, between: [2.0, 8.0] },
];

/// Frequency [Hz] and damping ratio of `mode` over `duration` [s]: in plain code on level `r`, or in the core on `nodes`.
///
/// # Errors
/// When the core cannot be prepared.
pub fn measure(levels: &Levels, on: &On, mode: &Mode, duration: Real) -> Result<(Real, Real)> {
    let mut points: Vec<(Real, Real)> = Vec::new();
    let samples = (duration / SAMPLE).round() as usize;
    match on {
        On::Plain(r) => {
            let mut swing = Swing::new(levels, *r, Law::Green);
            let moves = |n: usize| swing.solid.rest[n].x > 1e-9;
            let v = (0..swing.x.len())
                .map(|n| if moves(n) { (mode.shape)(swing.solid.rest[n]) * SPEED } else { Vec3::zeros() });
            swing.v = v.collect();
            for i in 0..samples {
                let solid = &swing.solid;
                let of = |n: usize| (swing.x[n] - solid.rest[n]).dot(&(mode.shape)(solid.rest[n])) * solid.mass[n];
                points.push((i as Real * SAMPLE, (0..solid.rest.len()).map(of).sum()));
                swing.advance(SAMPLE);
            }
        }
        On::Core(nodes) => {
            let body = body_of(levels, 0.0, 1)?;
            let mut run = Trial::hanging(Vec3::zeros()).on_nodes(&body, nodes.clone())?;
            run.mesh_mut().change_motion(|n, _, v| {
                if !body.is_fixed(n) {
                    *v = (mode.shape)(body.rest(n)) * SPEED;
                }
            });
            for i in 0..samples {
                let mesh = run.mesh();
                let of = |slot: &palpate_core::ids::Slot| {
                    let n = mesh.node(*slot);
                    let moved = mesh.position(*slot) - body.rest(n);
                    moved.dot(&(mode.shape)(body.rest(n))) * mesh.motion.mass[slot.index()]
                };
                points.push((i as Real * SAMPLE, mesh.active().iter().map(of).sum()));
                for _ in 0..(SAMPLE / TICK).round() as usize {
                    run.advance(&Inputs::default());
                }
            }
        }
    }
    let frequency = strongest_line(&points, mode.between).0;
    Ok((frequency, damping_ratio(&points, frequency)))
}

/// What a mode is measured on.
#[derive(Clone, Debug)]
pub enum On {
    /// The law in plain code on one level as it is.
    Plain(usize),
    /// The core on these active nodes.
    Core(Vec<Node>),
}

/// Simulated time [s]: lines a tenth of a hertz apart are told from each other.
const DURATION: Real = 3.0;
/// Mixed sets of active nodes.
const SETS: u64 = 4;

/// The claim of the abstract.
///
/// # Errors
/// When a table cannot be written.
pub fn claims(out: &Path, progress: Progress) -> Result<Vec<Claim>> {
    progress("three damped modes on every level");
    let levels = Levels::of_cube(damped(TAU), true);
    let body = body_of(&levels, 0.0, 1)?;
    let count = |r: usize| levels.first_node[r + 1] - levels.first_node[r];
    let last = levels.count() - 1;
    let mut cases: Vec<(String, On)> = Vec::new();
    for r in (0..=last).rev() {
        cases.push((format!("{} nodes", count(r)), On::Plain(r)));
    }
    for r in (0..=last).rev() {
        cases.push((format!("{} nodes", count(r)), On::Core(body.nodes_of(r).collect())));
    }
    for seed in 0..SETS {
        let nodes = balanced(&body, &levels, &levels.random_active_set(seed));
        let how = if seed.is_multiple_of(2) { "around a point" } else { "scattered" };
        cases.push((format!("{} nodes of three levels, {how}", nodes.len()), On::Core(nodes)));
    }
    let runs: Vec<(usize, usize)> = (0..cases.len()).flat_map(|c| (0..MODES.len()).map(move |m| (c, m))).collect();
    let found: Vec<(Real, Real)> =
        runs.par_iter().map(|(c, m)| measure(&levels, &cases[*c].1, &MODES[*m], DURATION)).collect::<Result<_>>()?;
    let mut rows = Vec::new();
    // Of frequency and damping, printed and shipped.
    let mut worst = [[0.0 as Real; 2]; 2];
    for (c, (name, on)) in cases.iter().enumerate() {
        let shipped = matches!(on, On::Core(_));
        let finest = if shipped { last + 1 } else { 0 };
        let method = if shipped { Method::Core } else { Method::Plain(Law::Green) };
        let mut row = vec![method.name(), name.clone()];
        for m in 0..MODES.len() {
            let (now, reference) = (found[c * MODES.len() + m], found[finest * MODES.len() + m]);
            let (frequency, damping) = (now.0 / reference.0 - 1.0, now.1 / reference.1 - 1.0);
            let of = &mut worst[usize::from(shipped)];
            *of = [of[0].max(frequency.abs()), of[1].max(damping.abs())];
            row.push(format!("{:.3} Hz ({:+.1} %)", now.0, 100.0 * frequency));
            row.push(format!("{:.4} ({:+.0} %)", now.1, 100.0 * damping));
        }
        rows.push(row);
    }
    let header: Vec<String> = ["method".to_owned(), "active".to_owned()]
        .into_iter()
        .chain(MODES.iter().flat_map(|m| [m.name.to_owned(), format!("damping of {}", m.name)]))
        .collect();
    let header: Vec<&str> = header.iter().map(String::as_str).collect();
    let words = |[frequency, damping]: [Real; 2]| {
        format!("frequencies differ by up to {:.1} %, damping by {:.0} %", 100.0 * frequency, 100.0 * damping)
    };
    Ok(vec![Claim {
        section: "abstract",
        says: "Damped elastic vibration modes are nearly unchanged for several levels of refinement",
        measured: format!(
            "A clamped cube, φ/λ = ψ/μ = {:.0} ms, against the finest level of 729 nodes. Nearly: within {:.0} % of the \
             frequency.\n\n{}",
            1e3 * TAU,
            100.0 * NEARLY,
            table(out, "modes", &header, &rows)?
        ),
        picture: None,
        printed: Some(Verdict::new(worst[0][0] < NEARLY, words(worst[0]))),
        shipped: Some(Verdict::new(worst[1][0] < NEARLY, words(worst[1]))),
    }])
}
