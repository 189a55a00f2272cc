//! Sections 3.3 and 5: "we guarantee a true real-time simulation … regardless of computational platform", "the faster the
//! CPU, the more our model will refine": one stroke on three machines. What work costs and what a tick may take are inputs
//! of the core, so a machine is a list of prices, and the runs repeat bit for bit.

use super::{Claim, Verdict};
use crate::Progress;
use crate::plot::{Chart, Curve, charts, table};
use crate::touch::{Stroke, organ_stroke};
use crate::trial::{Trial, attached, held_at};
use palpate_body::geometry::primitives::liver_surface;
use palpate_core::adaptation::Adaptivity;
use palpate_core::math::Real;
use palpate_core::model::step_class::TICK;
use palpate_core::simulation::{Budget, Prices};
use palpate_core::stepping::governor::{LIMIT, MOST_PLANNED};
use rayon::prelude::*;
use std::io::Result;
use std::path::Path;

/// How long work takes there over what it takes on a common machine of 2023.
pub const MACHINES: [(&str, Real); 3] =
    [("three times as fast", 1.0 / 3.0), ("common", 1.0), ("three times as slow", 3.0)];

/// What a stroke was like on one machine.
#[derive(Clone, Debug, PartialEq)]
pub struct Stroked {
    /// Ticks that took more than the limit, by the prices, counted before they ran.
    pub late: u32,
    /// Ticks in which the body stood still, and most of them in a row.
    pub still: [u32; 2],
    /// Time that each tick takes [µs], active nodes, force [N], over time [s].
    pub time: Vec<(Real, Real)>,
    /// See [`Stroked::time`].
    pub nodes: Vec<(Real, Real)>,
    /// See [`Stroked::time`].
    pub force: Vec<(Real, Real)>,
    /// Of the state at the end.
    pub hash: u64,
}

/// The stroke `on` the machine that takes `slowness` times the common machine's time; without limit when `None`.
///
/// # Errors
/// When the body does not start.
pub fn stroke(on: &Stroke, slowness: Option<Real>) -> Result<Stroked> {
    let mut run = Trial::ball(on.radius, Some(Adaptivity::default())).on_level(&on.body, 0)?;
    let slower = |price: u32| (Real::from(price) * slowness.unwrap_or(1.0)).round() as u32;
    let prices = Prices(Prices::COMMON.0.map(slower));
    let budget = match slowness {
        Some(_) => Budget { limit: LIMIT, planned: MOST_PLANNED, frame: LIMIT, change: LIMIT },
        None => Budget::UNLIMITED,
    };
    let mut stroked = Stroked { late: 0, still: [0; 2], time: vec![], nodes: vec![], force: vec![], hash: 0 };
    let mut in_a_row = 0;
    for tick in 0..on.ticks() {
        let mut inputs = if tick == 0 { attached() } else { held_at(tick, on.place(tick)) };
        (inputs.budget, inputs.prices) = (budget, (tick == 0).then_some(prices));
        let outputs = run.advance(&inputs);
        let time = Real::from(tick) * TICK;
        let still = outputs.plan.taken < outputs.plan.needed;
        in_a_row = if still { in_a_row + 1 } else { 0 };
        stroked.still = [stroked.still[0] + u32::from(still), stroked.still[1].max(in_a_row)];
        stroked.late += u32::from(outputs.plan.whole > budget.limit);
        stroked.time.push((time, Real::from(outputs.plan.whole) / 1e3));
        stroked.nodes.push((time, Real::from(outputs.active.iter().sum::<u32>())));
        stroked.force.push((time, outputs.tools[0].state.physical_force.norm()));
    }
    stroked.hash = run.hash();
    Ok(stroked)
}

fn mean(points: &[(Real, Real)]) -> Real {
    points.iter().map(|p| p.1).sum::<Real>() / points.len() as Real
}

/// Root mean square difference of two forces over the peak of the second.
pub fn error(force: &[(Real, Real)], reference: &[(Real, Real)]) -> Real {
    let peak = reference.iter().map(|p| p.1).fold(0.0, Real::max);
    crate::oscillate::root_mean_square(force, reference) / peak
}

/// The claims on the rate.
///
/// # Errors
/// When a picture cannot be written.
pub fn claims(out: &Path, progress: Progress) -> Result<Vec<Claim>> {
    progress("one stroke on three machines");
    let on = organ_stroke(liver_surface(0.006), &[0.026, 0.015, 0.0085, 0.005], 5e3)?;
    let cases: Vec<Option<Real>> = [None].into_iter().chain(MACHINES.iter().flat_map(|m| [Some(m.1); 2])).collect();
    let all: Vec<Stroked> = cases.par_iter().map(|slowness| stroke(&on, *slowness)).collect::<Result<_>>()?;
    let (unlimited, twice) = (&all[0], &all[1..]);
    let mut rows = vec![vec![
        "no limit".into(),
        "–".into(),
        format!("{:.0}", unlimited.time.iter().map(|t| t.1).fold(0.0, Real::max)),
        "–".into(),
        format!("{:.0}", mean(&unlimited.nodes)),
        "–".into(),
        "–".into(),
    ]];
    for ((name, _), two) in MACHINES.iter().zip(twice.chunks(2)) {
        rows.push(vec![
            (*name).into(),
            two[0].late.to_string(),
            format!("{:.0}", two[0].time.iter().map(|t| t.1).fold(0.0, Real::max)),
            format!("{} ({})", two[0].still[0], two[0].still[1]),
            format!("{:.0}", mean(&two[0].nodes)),
            format!("{:.1} %", 100.0 * error(&two[0].force, &unlimited.force)),
            if two[0] == two[1] { "yes".into() } else { "no".into() },
        ]);
    }
    let curves = |of: fn(&Stroked) -> &Vec<(Real, Real)>| {
        let one = |((name, _), two): (&(&str, Real), &[Stroked])| Curve {
            name: (*name).into(),
            points: of(&two[0]).clone(),
            ..Curve::default()
        };
        MACHINES.iter().zip(twice.chunks(2)).map(one).collect::<Vec<_>>()
    };
    let panel = |title: &str, y_label: &str, of: fn(&Stroked) -> &Vec<(Real, Real)>| Chart {
        title: title.into(),
        x_label: "time [s]".into(),
        y_label: y_label.into(),
        curves: curves(of),
        ..Chart::default()
    };
    let mut force = panel("force on the tool", "force [N]", |s| &s.force);
    force.curves.push(Curve { name: "no limit".into(), points: unlimited.force.clone(), ..Curve::default() });
    let panels = [
        panel("time of a tick", "µs by the machine's prices", |s| &s.time),
        panel("active nodes", "nodes", |s| &s.nodes),
        force,
    ];
    charts(out, "machines", "One stroke on three machines: 0.95 ms a tick on each", &panels)?;
    let machines: Vec<&Stroked> = twice.chunks(2).map(|two| &two[0]).collect();
    let same = twice.chunks(2).all(|two| two[0] == two[1]);
    let late: u32 = machines.iter().map(|m| m.late).sum();
    let worst_row = machines.iter().map(|m| m.still[1]).max().unwrap_or(0);
    let nodes: Vec<Real> = machines.iter().map(|m| mean(&m.nodes)).collect();
    let errors: Vec<Real> = machines.iter().map(|m| error(&m.force, &unlimited.force)).collect();
    Ok(vec![
        Claim {
            section: "3.3",
            says: "The frame rate is guaranteed, and simulated time is that of the clock, whatever the platform",
            measured: format!(
                "A stroke over the bundled organ, levels down to 5 mm. A machine is a list of prices of work; both prices and \
                 budget are inputs that recordings keep. Still: ticks in which the body stands still because its step did \
                 not fit (most in a row); time goes on.\n\n{}",
                table(
                    out,
                    "machines",
                    &[
                        "machine",
                        "ticks over 950 µs",
                        "longest tick [µs]",
                        "still",
                        "active nodes, mean",
                        "force error, rms",
                        "repeats bit for bit"
                    ],
                    &rows
                )?
            ),
            picture: Some(("machines", "time of a tick, active nodes and force on three machines".into())),
            printed: None,
            shipped: Some(Verdict::new(
                late == 0 && worst_row <= palpate_core::simulation::MOST_FROZEN && same,
                format!(
                    "{late} of {} ticks take more than 950 µs, the body stands still for at most {worst_row} in a row, and each \
                     run {} bit for bit",
                    machines.len() * on.ticks() as usize,
                    if same { "repeats" } else { "does not repeat" }
                ),
            )),
        },
        Claim {
            section: "5",
            says: "The faster the CPU, the more the model refines in deformed regions",
            measured: "From the same runs.".into(),
            picture: None,
            printed: None,
            shipped: Some(Verdict::new(
                nodes.windows(2).all(|two| two[0] > two[1]) && errors.windows(2).all(|two| two[0] < two[1]),
                format!(
                    "from the fastest machine to the slowest {} active nodes on the mean, and the force is {} off",
                    nodes.iter().map(|n| format!("{n:.0}")).collect::<Vec<_>>().join(", "),
                    errors.iter().map(|e| format!("{:.1} %", 100.0 * e)).collect::<Vec<_>>().join(", ")
                ),
            )),
        },
    ])
}
