//! Tables: both kinds of rows, four kinds of weights.

use super::Progress;
use super::coupling::{Coupling, Mixed};
use super::drift::{let_go, random_gradient};
use super::laws::Law;
use super::levels::Levels;
use super::oscillate::material;
use super::patch::{Press, Weights, patch_error, sliding_walls, weigh};
use super::plot::table;
use super::rows::{RowKind, rows};
use palpate_body::cover::cover;
use palpate_core::geometry::primitives::box_surface;
use palpate_core::math::{Real, Vec3};
use rayon::prelude::*;
use std::io::{Error, Result};
use std::path::Path;
use std::time::Instant;

/// Lattice constants of the covers [m].
const LATTICES: [Real; 3] = [0.34, 0.21, 0.13];

fn covers() -> Result<Levels> {
    let surface = box_surface(Vec3::repeat(1.0), [8; 3]);
    let level = |(i, a): (usize, &Real)| cover(&surface, *a, i as u32, material().density);
    let levels: std::result::Result<Vec<_>, _> = LATTICES.iter().enumerate().map(level).collect();
    Ok(Levels::new(levels.map_err(Error::other)?, material(), |_| false))
}

fn sorted(values: impl Iterator<Item = Real>) -> Vec<Real> {
    let mut values: Vec<Real> = values.collect();
    values.sort_by(Real::total_cmp);
    values
}

fn median(values: impl Iterator<Item = Real>) -> Real {
    let values = sorted(values);
    values[values.len() / 2]
}

fn largest(values: impl Iterator<Item = Real>) -> Real {
    sorted(values).last().copied().unwrap_or(0.0)
}

/// Interface rows by hosts and by moving least squares: their lengths and signs, and what they do to step, patch
/// test and energy. Coupled by energy, quarter weights.
pub fn rows_compared(out: &Path, progress: Progress) -> Result<String> {
    const SETS: u64 = 10;
    let mut table_rows = Vec::new();
    for (mesh, levels) in [("conforming", Levels::of_cube(material(), false)), ("cover", covers()?)] {
        let held = held_nodes(&levels);
        let uniform = uniform_frequency(&levels);
        for (scattered, sets) in [(0, "around a point"), (1, "scattered")] {
            for kind in [RowKind::Hosts, RowKind::MovingLeastSquares] {
                progress(&format!("rows by {}, {mesh} levels, refined {sets}", kind.name()));
                let one = |i: u64| {
                    let seed = 2 * i + scattered;
                    let active = levels.random_active_set(seed);
                    let mixed = Mixed::new(&levels, active, Law::GreenWithCompression, Coupling::Energy, kind);
                    let wanted: Vec<usize> = mixed.interface.iter().map(|(n, _)| *n).collect();
                    let start = Instant::now();
                    let found = rows(kind, &levels, &mixed.active, &wanted);
                    let micros = start.elapsed().as_secs_f64() * 1e6 / wanted.len() as Real;
                    let count = found.len() as Real;
                    let lengths = || found.iter().map(|r| r.iter().filter(|(_, w)| w.abs() > 1e-6).count() as Real);
                    let negative = |r: &&Vec<(usize, Real)>| r.iter().map(|(_, w)| w.min(0.0)).sum::<Real>() < -0.01;
                    let frequency = mixed.largest_frequency();
                    let run = let_go(&mixed, random_gradient(seed), Vec3::zeros(), 10.0, 1.0 / frequency);
                    [
                        lengths().sum::<Real>() / count,
                        lengths().fold(0.0, Real::max),
                        found.iter().filter(negative).count() as Real / count,
                        found.iter().map(|r| r.iter().map(|(_, w)| w.abs()).sum()).fold(0.0, Real::max),
                        mixed.mass.iter().sum::<Real>() / levels.body_mass(),
                        uniform / frequency,
                        patch_error(&mixed, 0.1, &held).strain,
                        patch_error(&mixed, 0.3, &held).strain,
                        run.drift,
                        run.strain,
                        if run.drift < 0.02 { 0.0 } else { 1.0 },
                        micros,
                    ]
                };
                let runs: Vec<[Real; 12]> = (0..SETS).into_par_iter().map(one).collect();
                let column = |i: usize| runs.iter().map(move |r| r[i]);
                let percent =
                    |i: usize| format!("{} / {}", short(100.0 * median(column(i))), short(100.0 * largest(column(i))));
                table_rows.push(vec![
                    mesh.into(),
                    sets.into(),
                    kind.name().into(),
                    format!("{:.1} / {:.0}", median(column(0)), largest(column(1))),
                    format!("{:.0} %", 100.0 * median(column(2))),
                    short(largest(column(3))),
                    format!("{} / {}", short(median(column(4))), short(largest(column(4)))),
                    format!("{:.2} / {:.2}", median(column(5)), sorted(column(5))[0]),
                    percent(6),
                    percent(7),
                    format!("{:.0} of {SETS}", column(10).sum::<Real>()),
                    power(median(column(8))),
                    format!("{} / {}", short(median(column(9))), short(largest(column(9)))),
                    format!("{:.0}", median(column(11))),
                ]);
            }
        }
    }
    let header = [
        "levels",
        "refined",
        "rows",
        "length mean/max",
        "with negatives",
        "Σ|w| max",
        "mass/body med/max",
        "step/uniform med/min",
        "patch 10 % [%] med/max",
        "patch 30 % [%]",
        "drift > 2 %",
        "drift med",
        "max |E| med/max",
        "µs/row",
    ];
    table(out, "rows", &header, &table_rows)
}

/// A power of ten, or a word for what has run away.
fn power(v: Real) -> String {
    if v.is_finite() { format!("{v:.1e}") } else { "runaway".into() }
}

/// Three digits, or a word for what has run away.
fn short(v: Real) -> String {
    if v.is_finite() && v.abs() < 1e4 { format!("{v:.2}") } else { "runaway".into() }
}

/// Held components for the patch test: sliding walls on a conforming box; on a cover all nodes of elements that the
/// surface cuts, because those pull even on a uniform level.
fn held_nodes(levels: &Levels) -> impl Fn(usize, usize) -> bool + '_ {
    let mut cut = vec![false; levels.rest.len()];
    for (level, first) in levels.tied.iter().zip(&levels.first_element) {
        for e in (0..level.fraction.len()).filter(|e| level.fraction[*e] < 1.0 - 1e-9) {
            levels.elements[first + e].nodes.iter().for_each(|n| cut[*n] = true);
        }
    }
    let is_cover = cut.contains(&true);
    let walls = sliding_walls(&levels.rest, Vec3::repeat(1.0));
    move |node, axis| if is_cover { cut[node] } else { walls(node, axis) }
}

/// Largest angular frequency [rad/s] with all of the finest level active.
fn uniform_frequency(levels: &Levels) -> Real {
    let finest = levels.uniform(levels.count() - 1);
    Mixed::new(levels, finest, Law::GreenWithCompression, Coupling::Energy, RowKind::Hosts).largest_frequency()
}

/// Steps between two changes of the active set, after each of which weights would have to be found anew: in a stroke the
/// core changes it in one of 7 to 19 ticks, of one to two steps.
const STEPS_PER_CHANGE: Real = 10.0;

/// The interface patch test with four kinds of weights, what of its error the force of a tool shows, and what each costs.
///
/// The force is that of a press where the set is finest, against the same press on the uniform finest level. Part of what it is off is
/// that coarse linear tetrahedra are stiffer, the same for all weights.
pub fn patch_tests(out: &Path, progress: Progress) -> Result<String> {
    const SETS: u64 = 30;
    let size = Vec3::repeat(1.0);
    let kinds = [Weights::Quarter, Weights::Kaczmarz(3), Weights::Kaczmarz(20), Weights::BoundedLeastSquares];
    let levels = Levels::of_cube(material(), false);
    let clamped = Levels::of_cube(material(), true);
    let held = held_nodes(&levels);
    let mixed = |levels, active, kind| Mixed::new(levels, active, Law::GreenWithCompression, Coupling::Energy, kind);
    progress("patch test: presses on the finest level");
    let pressed = |seed: u64| {
        let press = Press::new(&clamped, &clamped.random_active_set(seed), size)?;
        let force = press.force(&mixed(&clamped, clamped.uniform(clamped.count() - 1), RowKind::Hosts));
        Some((press, force))
    };
    let presses: Vec<Option<(Press, Real)>> = (0..SETS).into_par_iter().map(pressed).collect();
    let mut table_rows = Vec::new();
    for kind in [RowKind::Hosts, RowKind::MovingLeastSquares] {
        // What quarter weights take in each set, which is what the others are measured in.
        let mut quarter: Vec<PatchRun> = Vec::new();
        for weights in kinds {
            progress(&format!("patch test, {}, rows by {}", weights.name(), kind.name()));
            let one = |seed: u64| {
                let mut patch = mixed(&levels, levels.random_active_set(seed), kind);
                let start = busy();
                weigh(&mut patch, weights, &held);
                let found = busy() - start;
                let start = busy();
                (0..20).for_each(|_| drop(patch.force(&levels.rest)));
                let step = (busy() - start) / 20.0;
                let error = |stretch| patch_error(&patch, stretch, &held).strain;
                let force = presses[seed as usize].as_ref().map(|(press, reference)| {
                    let mut body = mixed(&clamped, clamped.random_active_set(seed), kind);
                    weigh(&mut body, weights, &held);
                    press.force(&body) / reference - 1.0
                });
                PatchRun {
                    strain: [error(0.1), error(0.3)],
                    force,
                    frequency: patch.largest_frequency(),
                    largest: patch.weighted.iter().map(|(_, w)| *w).fold(0.0, Real::max),
                    found,
                    step,
                }
            };
            let runs: Vec<PatchRun> = (0..SETS).into_par_iter().map(one).collect();
            if weights == Weights::Quarter {
                quarter = runs.clone();
            }
            for (which, sets) in [(Some(0), "around a point"), (Some(1), "scattered"), (None, "all")] {
                let chosen = || (0..runs.len()).filter(|i| which.is_none_or(|w| i % 2 == w));
                let of = |value: &dyn Fn(&PatchRun) -> Real| chosen().map(|i| value(&runs[i])).collect::<Vec<_>>();
                let strain = |k: usize| {
                    let all = of(&|r| 100.0 * r.strain[k]);
                    format!("{:.1} / {:.1}", mean(&all), largest(all.into_iter()))
                };
                let signed: Vec<Real> = chosen().filter_map(|i| runs[i].force).map(|e| 100.0 * e).collect();
                let force: Vec<Real> = signed.iter().map(|e| e.abs()).collect();
                let shorter: Vec<Real> = chosen().map(|i| runs[i].frequency / quarter[i].frequency).collect();
                let search = match weights {
                    Weights::Quarter => 0.0,
                    _ => median(chosen().map(|i| runs[i].found / runs[i].step)),
                };
                // Work for the same time: more steps, and what the weights take between them.
                let cost = mean(&shorter) * (1.0 + search / STEPS_PER_CHANGE);
                table_rows.push(vec![
                    sets.into(),
                    kind.name().into(),
                    weights.name(),
                    strain(0),
                    strain(1),
                    format!(
                        "{:.1} / {:.1} / {:.1}",
                        mean(&force),
                        median(force.iter().copied()),
                        largest(force.iter().copied())
                    ),
                    format!("{:+.1}", mean(&signed)),
                    format!("{:.2} / {:.2}", 1.0 / mean(&shorter), 1.0 / largest(shorter.into_iter())),
                    format!("{:.2}", largest(of(&|r| r.largest).into_iter())),
                    format!("{:.2}", 1e3 * median(of(&|r| if search > 0.0 { r.found } else { 0.0 }).into_iter())),
                    format!("{search:.1}"),
                    format!("{cost:.2}"),
                    format!("{:.1}", mean(&force) * cost),
                ]);
            }
        }
    }
    table_rows.sort_by_key(|row| ["around a point", "scattered", "all"].iter().position(|s| *s == row[0]));
    let header = [
        "refined",
        "rows",
        "weights",
        "strain error at 10 % [%] mean/max",
        "at 30 % [%] mean/max",
        "force error [%] mean/med/max",
        "with its sign",
        "step/quarter mean/min",
        "largest weight",
        "search [ms]",
        "in steps",
        "cost",
        "force error x cost",
    ];
    table(out, "patch", &header, &table_rows)
}

/// What one kind of weights did in one set.
#[derive(Clone)]
struct PatchRun {
    /// Relative strain error at 10 and at 30 %.
    strain: [Real; 2],
    /// Relative error of the force of the press, where there is one.
    force: Option<Real>,
    /// Largest angular frequency [rad/s].
    frequency: Real,
    /// Largest weight.
    largest: Real,
    /// Time that finding the weights took [s].
    found: Real,
    /// Time that all forces of one step take [s].
    step: Real,
}

/// Time [s] that this thread has computed for: other work on the machine does not count.
fn busy() -> Real {
    let time = rustix::time::clock_gettime(rustix::time::ClockId::ThreadCPUTime);
    time.tv_sec as Real + 1e-9 * time.tv_nsec as Real
}

fn mean(values: &[Real]) -> Real {
    values.iter().sum::<Real>() / values.len() as Real
}
