//! Sections 2.3, 3.1 and 6: levels mixed in one body that nothing damps, the same mixes under each of the paper's laws,
//! coupled by forces as printed and by one energy as shipped; and by the core itself.

use super::{Claim, Verdict};
use crate::Progress;
use crate::coupling::{Coupling, Mixed};
use crate::drift::{self, Run, Watch, random_gradient};
use crate::laws::Law;
use crate::levels::Levels;
use crate::oscillate::{GRAVITY, material};
use crate::plot::{Chart, Curve, charts, table};
use crate::rows::RowKind;
use crate::trial::{Trial, balanced, body_of};
use palpate_core::math::{Mat3, Real, Vec3};
use palpate_core::model::energy::energy;
use palpate_core::model::step_class::TICK;
use palpate_core::simulation::Inputs;
use rayon::prelude::*;
use std::io::Result;
use std::path::Path;

/// What is tried.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Method {
    /// A law in plain code, levels coupled so.
    Plain(Law, Coupling),
    /// The core.
    Core,
}

impl Method {
    /// Words for a table: law and coupling.
    fn names(self) -> [String; 2] {
        match self {
            Method::Plain(law, coupling) => [law.name().into(), coupling.name().into()],
            Method::Core => ["the core".into(), "by energy, as shipped".into()],
        }
    }
}

/// Lets the cube go for `duration` [s] on the set of active nodes of `seed`: clamped under gravity, or free and spinning.
///
/// # Errors
/// When the core cannot be prepared.
pub fn let_go(levels: &Levels, method: Method, seed: u64, duration: Real) -> Result<Run> {
    let clamped = levels.fixed.contains(&true);
    let gravity = if clamped { GRAVITY } else { Vec3::zeros() };
    let gradient = if clamped { Mat3::zeros() } else { random_gradient(seed) };
    let body = body_of(levels, 0.0, 1)?;
    let nodes = balanced(&body, levels, &levels.random_active_set(seed));
    match method {
        Method::Plain(law, coupling) => {
            let mut active = vec![false; levels.rest.len()];
            nodes.iter().for_each(|n| active[n.index()] = true);
            let mixed = Mixed::new(levels, active, law, coupling, RowKind::Hosts);
            // The coupling by forces has no symmetric stiffness, so no frequency to bound its step: take a quarter of the
            // altitude, well below what the coupling by energy allows. Springs are stiffer than the elements between them.
            let by_altitude = 0.25 * mixed.smallest_altitude() / levels.material.wave_speed();
            let dt = match (law, coupling) {
                (Law::MassSpring, _) | (_, Coupling::Force) => by_altitude,
                (_, Coupling::Energy) => 1.0 / mixed.largest_frequency(),
            };
            Ok(drift::let_go(&mixed, gradient, gravity, duration, dt))
        }
        Method::Core => {
            let mut run = Trial::hanging(gravity).on_nodes(&body, nodes)?;
            let centre = body.centre_of_mass();
            run.mesh_mut().change_motion(|_, x, v| *v = gradient * (*x - centre));
            let start = energy(&body, run.mesh(), gravity);
            let mut watch = Watch::new(start.total(), start.kinetic);
            for tick in 1..=(duration / TICK) as usize {
                let restored = run.advance(&Inputs::default()).restored;
                if tick % 10 == 0 || restored {
                    let now = energy(&body, run.mesh(), gravity);
                    let total = if restored { Real::NAN } else { now.total() };
                    let speed = (now.linear_momentum - start.linear_momentum).norm() / body.mass();
                    watch.run.centre_speed = watch.run.centre_speed.max(speed);
                    if !watch.note(tick as Real * TICK, total, now.kinetic) {
                        break;
                    }
                }
            }
            Ok(watch.end())
        }
    }
}

/// Sets of active nodes, and how long each runs [s].
const SETS: u64 = 6;
const DURATION: Real = 15.0;
/// The paper's laws.
pub const LAWS: [Law; 4] = [Law::MassSpring, Law::Cauchy, Law::SimplifiedCauchy, Law::Green];
/// An undamped body whose energy stays within this part of its motion's keeps it.
pub const KEPT: Real = 0.02;

/// Claims about mixed levels.
///
/// # Errors
/// When a picture cannot be written.
pub fn claims(out: &Path, progress: Progress) -> Result<Vec<Claim>> {
    let mut methods: Vec<Method> = [Coupling::Force, Coupling::Energy]
        .into_iter()
        .flat_map(|coupling| LAWS.map(|law| Method::Plain(law, coupling)))
        .collect();
    methods.push(Method::Core);
    let (mut rows, mut panels) = (Vec::new(), Vec::new());
    let mut tallies: Vec<(Method, usize, Real, Real)> = methods.iter().map(|m| (*m, 0, 0.0, 0.0)).collect();
    for clamped in [false, true] {
        let body = if clamped { "clamped" } else { "free" };
        let levels = Levels::of_cube(material(), clamped);
        let cases: Vec<(usize, u64)> = (0..methods.len()).flat_map(|m| (0..SETS).map(move |seed| (m, seed))).collect();
        progress(&format!("mixed levels, {body} cube: {} runs of {DURATION} s", cases.len()));
        let one = |(m, seed): &(usize, u64)| let_go(&levels, methods[*m], *seed, DURATION);
        let runs: Vec<Run> = cases.par_iter().map(one).collect::<Result<_>>()?;
        let mut curves: [Vec<Curve>; 2] = Default::default();
        for (m, runs) in runs.chunks(SETS as usize).enumerate() {
            let mut blown: Vec<Real> = runs.iter().filter_map(|r| r.blown).collect();
            blown.sort_by(Real::total_cmp);
            let worst = runs.iter().map(|r| r.drift).fold(0.0, Real::max);
            let drifting = runs.iter().map(|r| r.centre_speed).fold(0.0, Real::max);
            let tally = &mut tallies[m];
            *tally = (
                methods[m],
                tally.1 + blown.len(),
                tally.2.max(worst),
                tally.3.max(if clamped { 0.0 } else { drifting }),
            );
            let [law, coupling] = methods[m].names();
            rows.push(vec![
                body.into(),
                coupling.clone(),
                law.clone(),
                match (blown.first(), blown.last()) {
                    (Some(a), Some(b)) => format!("{} of {SETS} ({a:.1}–{b:.1} s)", blown.len()),
                    _ => format!("0 of {SETS}"),
                },
                if worst.is_finite() { format!("{worst:.1e}") } else { "–".into() },
                if clamped { "–".into() } else { format!("{drifting:.1e}") },
            ]);
            let points = runs[0].energy.clone();
            let by_energy = !matches!(methods[m], Method::Plain(_, Coupling::Force));
            curves[usize::from(by_energy)].push(Curve { name: law, points, ..Curve::default() });
        }
        for (curves, how) in curves.into_iter().zip(["by forces, as printed", "by one energy"]) {
            panels.push(Chart {
                title: format!("{body} cube, levels coupled {how}"),
                x_label: "time [s]".into(),
                y_label: "energy error so far / peak kinetic".into(),
                curves,
                y_range: Some((-7.0, 1.0)),
                powers: true,
                ..Chart::default()
            });
        }
    }
    charts(out, "mixes", "Levels mixed in one undamped body, refined around one point", &panels)?;
    let header = ["body", "coupling", "law", "blown up", "largest energy error", "largest drift of the centre [m/s]"];
    let measured = format!(
        "{SETS} sets of active nodes on levels of 64, 216 and 729 nodes, {DURATION} s each, without any damping; half are \
         refined around a point, half scattered. The error is that of the total energy over the largest kinetic energy.\n\n{}",
        table(out, "mixes", &header, &rows)?
    );
    let of = |method: Method| tallies.iter().find(|t| t.0 == method).copied().unwrap_or((method, 0, Real::NAN, 0.0));
    let runs = 2 * SETS;
    let words = |(method, blown, worst, _): (Method, usize, Real, Real)| {
        let [law, _] = method.names();
        if blown > 0 {
            format!("under {law} {blown} of {runs} blow up")
        } else {
            format!("under {law} none of {runs} blows up, energies within {worst:.1e}")
        }
    };
    let [springs, cauchy, simple, green] = LAWS.map(|law| of(Method::Plain(law, Coupling::Force)));
    let core = of(Method::Core);
    let same_by_energy: Vec<String> = LAWS.iter().map(|law| words(of(Method::Plain(*law, Coupling::Energy)))).collect();
    Ok(vec![
        Claim {
            section: "3.1",
            says: "Resolutions that vibrate differently make a mixed body unstable: springs, Cauchy strain",
            measured,
            picture: Some(("mixes", "energy error of mixed bodies over time under four laws".into())),
            printed: Some(Verdict::new(
                springs.1 > 0 && cauchy.1 > 0,
                format!("{}, {}, {}", words(springs), words(cauchy), words(simple)),
            )),
            shipped: None,
        },
        Claim {
            section: "6",
            says: "With Green strain the method is stable even when no damping is applied",
            measured: format!(
                "The table and picture of the claim before. The law is not what decides: coupled by one energy, {}. As printed \
                 a node gathers forces from its own level alone, and interface nodes only follow: action is not reaction, and \
                 no energy belongs to it.",
                same_by_energy.join("; ")
            ),
            picture: None,
            printed: Some(Verdict::new(green.1 == 0 && green.2 < KEPT, words(green))),
            shipped: Some(Verdict::new(
                core.1 == 0 && core.2 < KEPT,
                format!("{}; the centre of a free body drifts at {:.0e} m/s at most", words(core), core.3),
            )),
        },
    ])
}
