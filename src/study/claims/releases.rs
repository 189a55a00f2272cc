//! Section 5: "nice oscillations when the tool is removed": a body that was refined under the tool, let go from one tick to
//! the next, against one that is fine everywhere.

use super::{Claim, Verdict};
use crate::Progress;
use crate::levels::Levels;
use crate::oscillate::{damping_ratio, strongest_line};
use crate::plot::{Chart, Curve, charts, table};
use crate::trial::{Trial, attached, body_of, detached, held_at};
use palpate_core::adaptation::Adaptivity;
use palpate_core::ids::Vertex;
use palpate_core::math::{Real, Vec3};
use palpate_core::model::Material;
use palpate_core::model::step_class::TICK;
use palpate_core::simulation::Inputs;
use rayon::prelude::*;
use std::io::Result;
use std::path::Path;

/// Edge of the cube [m]; the ball bends it down near its free edge.
const SIDE: Real = 0.1;
const RADIUS: Real = 0.01;
const DEPTH: Real = 0.012;
/// Ticks until the ball is down, until it is gone, and after that.
const DOWN: u32 = 400;
const GONE: u32 = 600;
const SWING: u32 = 1500;

/// A cube let go.
#[derive(Clone, Debug, Default)]
pub struct Released {
    /// Height of the middle of the free face over where it rests [m], from the release on [s].
    pub tip: Vec<(Real, Real)>,
    /// Active nodes over the same time.
    pub nodes: Vec<(Real, Real)>,
    /// The body was reset.
    pub restored: bool,
}

/// Levels of `cells` along an edge: presses and lets go, adaptively or with all of the finest level active, and watches for
/// `swing` ticks.
///
/// # Errors
/// When the core cannot be prepared.
pub fn release(cells: &[u32], zeta: Real, adaptive: bool, swing: u32) -> Result<Released> {
    let cells: Vec<[u32; 3]> = cells.iter().map(|c| [*c; 3]).collect();
    let levels = Levels::of_box(Vec3::repeat(SIDE), &cells, Material::from_young(2e4, 0.35, 1000.0), true);
    let body = body_of(&levels, zeta, 2500)?;
    let trial = Trial::ball(RADIUS, adaptive.then(Adaptivity::default));
    let mut run = trial.on_level(&body, if adaptive { 0 } else { body.finest() })?;
    let middle = Vec3::new(SIDE, 0.5 * SIDE, 0.5 * SIDE);
    let rest = &body.surface().vertices;
    let to_middle = |v: &Vertex| (rest[v.index()] - middle).norm();
    let tip = body.vertices().min_by(|a, b| to_middle(a).total_cmp(&to_middle(b))).unwrap_or(Vertex::at(0));
    let mut released = Released::default();
    for tick in 0..GONE + swing {
        let down = (Real::from(tick) / Real::from(DOWN)).min(1.0);
        let depth = -0.001 + (DEPTH + 0.001) * down * down * (3.0 - 2.0 * down);
        let inputs = match tick {
            0 => attached(),
            GONE => detached(),
            t if t > GONE => Inputs::default(),
            _ => held_at(tick, Vec3::new(0.85 * SIDE, 0.5 * SIDE, SIDE + RADIUS - depth)),
        };
        let outputs = run.advance(&inputs);
        released.restored |= outputs.restored;
        let nodes = Real::from(outputs.active.iter().sum::<u32>());
        if tick >= GONE {
            let time = Real::from(tick - GONE) * TICK;
            released.nodes.push((time, nodes));
            released.tip.push((time, run.mesh().vertex(tip).z - rest[tip.index()].z));
        }
    }
    Ok(released)
}

/// Frequency [Hz] and damping ratio of the swing.
pub fn swing(released: &Released) -> (Real, Real) {
    let frequency = strongest_line(&released.tip, [2.0, 30.0]).0;
    (frequency, damping_ratio(&released.tip, frequency))
}

/// Times that the tip passes its place of rest with more than a hundredth of the first swing still to come.
pub fn passes(released: &Released) -> usize {
    let tip = &released.tip;
    let most = tip.iter().map(|p| p.1.abs()).fold(0.0, Real::max);
    let visible = tip.iter().rposition(|p| p.1.abs() > 0.01 * most).unwrap_or(0);
    tip[..visible].windows(2).filter(|two| two[0].1 * two[1].1 < 0.0).count()
}

/// The claim on oscillations.
///
/// # Errors
/// When a picture cannot be written.
pub fn claims(out: &Path, progress: Progress) -> Result<Vec<Claim>> {
    progress("a cube let go by a tool");
    let cases = [(0.0, true), (0.0, false), (0.05, true), (0.05, false)];
    let runs: Vec<Released> = cases
        .par_iter()
        .map(|(zeta, adaptive)| release(&[3, 6, 10], *zeta, *adaptive, SWING))
        .collect::<Result<_>>()?;
    let (mut rows, mut panels) = (Vec::new(), Vec::new());
    for ((zeta, adaptive), run) in cases.iter().zip(&runs) {
        let (frequency, damping) = swing(run);
        let mean = run.nodes.iter().map(|n| n.1).sum::<Real>() / run.nodes.len() as Real;
        rows.push(vec![
            if *adaptive { "adaptive".into() } else { "finest level".into() },
            format!("{zeta}"),
            format!("{frequency:.3}"),
            format!("{damping:.4}"),
            passes(run).to_string(),
            format!("{mean:.0}"),
        ]);
    }
    for (two, zeta) in runs.chunks(2).zip(["undamped", "damping ratio 0.05"]) {
        let curves = two.iter().zip(["adaptive", "finest level"]).map(|(run, name)| Curve {
            name: name.into(),
            points: run.tip.iter().map(|(t, z)| (*t, 1e3 * z)).collect(),
            ..Curve::default()
        });
        panels.push(Chart {
            title: zeta.into(),
            x_label: "time since the release [s]".into(),
            y_label: "middle of the free face [mm]".into(),
            curves: curves.collect(),
            ..Chart::default()
        });
    }
    charts(out, "release", "A cube bent down by a ball that is taken away", &panels)?;
    let [(f0, _), (g0, _), (f1, d1), (g1, e1)] = [0, 1, 2, 3].map(|i| swing(&runs[i]));
    let off = [f0 / g0 - 1.0, f1 / g1 - 1.0];
    let worst = off.iter().fold(0.0, |a: Real, b| a.max(b.abs()));
    Ok(vec![Claim {
        section: "5",
        says: "Bodies show realistic oscillations when the tool is removed",
        measured: format!(
            "A ball bends a cube of 100 mm by {:.0} mm near its free edge and is gone from one tick to the next. Passes: times \
             that the face swings through its place of rest before less than a hundredth of the first swing is left.\n\n{}",
            1e3 * DEPTH,
            table(
                out,
                "release",
                &["run", "damping ratio", "frequency [Hz]", "measured damping", "passes", "active nodes, mean"],
                &rows
            )?
        ),
        picture: Some(("release", "the free face after the release, adaptive and fine".into())),
        printed: None,
        shipped: Some(Verdict::new(
            worst < 0.02 && runs.iter().all(|r| passes(r) > 4 && !r.restored),
            format!(
                "undamped and damped the adaptive body swings at {:+.2} and {:+.2} % of the fine one's frequency, damped at \
                 {d1:.3} against {e1:.3}",
                100.0 * off[0],
                100.0 * off[1]
            ),
        )),
    }])
}
