//! What adaptive resolution buys under a tool: error of the force against cost, and a budget cut in the middle of a press.
//! All of it runs the core as it is, driven by its own indicator.

use super::Progress;
use super::plot::{Chart, Curve, charts, table};
use super::trial::{Trial, attached, held_at};
use palpate_body::geometry::decimate::decimate;
use palpate_body::geometry::primitives::liver_surface;
use palpate_body::prepare::{self, Recipe, Region, prepare};
use palpate_core::adaptation::Adaptivity;
use palpate_core::geometry::Surface;
use palpate_core::geometry::primitives::box_surface;
use palpate_core::math::{Bounds, Real, Vec3};
use palpate_core::model::step_class::TICK;
use palpate_core::model::{Body, Material};
use palpate_core::simulation::{Budget, Inputs, Simulation};
use std::io::{Error, Result};
use std::path::Path;
use std::sync::Arc;
use std::time::{Duration, Instant};

/// A ball that presses and strokes a body.
pub struct Stroke {
    /// What it presses.
    pub body: Arc<Body>,
    /// Of the ball [m].
    pub radius: Real,
    depth: Real,
    /// Where the ball's centre stands when its surface touches the rest shape, at the start of the stroke.
    start: Vec3,
    /// Along x [m].
    length: Real,
    /// Height of the rest surface under the ball along the stroke, relative to the start [m].
    height: Vec<Real>,
}

/// [s]: down to the full depth, then a rest, then the stroke at 0.1 m/s.
const PRESS: Real = 0.15;
const REST: Real = 0.05;
const SPEED: Real = 0.1;
/// Between two words on how far a stroke is.
const TELL: Duration = Duration::from_secs(20);

impl Stroke {
    /// How long it takes.
    pub fn ticks(&self) -> u32 {
        ((PRESS + REST + self.length / SPEED) / TICK) as u32 + 50
    }

    /// Centre of the ball [m] at `tick`.
    pub fn place(&self, tick: u32) -> Vec3 {
        let time = Real::from(tick) * TICK;
        let air = 0.5 * self.radius;
        let depth = if time < PRESS { (self.depth + air) * time / PRESS - air } else { self.depth };
        let along = ((time - PRESS - REST).max(0.0) * SPEED).min(self.length);
        let last = self.height.len() - 1;
        let at = along / self.length * last as Real;
        let (i, part) = (at as usize, at - at.floor());
        let height = self.height[i] * (1.0 - part) + self.height[(i + 1).min(last)] * part;
        self.start + Vec3::new(along, 0.0, height - depth)
    }
}

/// What one run gave.
pub struct Run {
    /// [N], (n_ticks).
    pub force: Vec<Real>,
    /// Element evaluations in all, ...
    pub evaluations: Real,
    /// ... and what one global step would have taken for the same elements.
    pub global: Real,
    /// [s].
    pub wall: Real,
    /// In use, on the mean.
    pub elements: Real,
}

/// `adaptivity` on the coarsest level, or one level alone, with the ball in hand.
fn begin(on: &Stroke, adaptivity: Option<Adaptivity>, level: usize) -> Result<Simulation> {
    let mut simulation = Trial::ball(on.radius, adaptivity).on_level(&on.body, level)?;
    simulation.advance(&attached());
    Ok(simulation)
}

/// `what` is run, for `progress`: a fine uniform mesh takes minutes.
///
/// # Errors
/// When the body does not start.
pub fn stroke(
    on: &Stroke,
    adaptivity: Option<Adaptivity>,
    level: usize,
    what: &str,
    progress: Progress,
) -> Result<Run> {
    progress(what);
    let mut simulation = begin(on, adaptivity, level)?;
    let mut run = Run { force: Vec::new(), evaluations: 0.0, global: 0.0, wall: 0.0, elements: 0.0 };
    let started = Instant::now();
    let mut told = started;
    for tick in 0..on.ticks() {
        if told.elapsed() > TELL {
            progress(&format!("{what}: tick {tick} of {}", on.ticks()));
            told = Instant::now();
        }
        let outputs = simulation.advance(&held_at(tick + 1, on.place(tick)));
        run.force.push(outputs.tools[0].state.physical_force.norm());
        run.evaluations += Real::from(outputs.element_evaluations);
        run.elements += Real::from(outputs.elements) / Real::from(on.ticks());
        let pool = simulation.mesh().pool();
        let finest = (0..palpate_core::model::element_pool::CLASSES).rev().find(|c| pool.count(*c) > 0).unwrap_or(0);
        run.global += (pool.len() << finest) as Real;
    }
    run.wall = started.elapsed().as_secs_f64();
    Ok(run)
}

/// Error of the force: root mean square over the stroke, over the peak.
pub fn error(run: &Run, reference: &Run) -> Real {
    let peak = reference.force.iter().copied().fold(0.0, Real::max);
    let squares: Real = run.force.iter().zip(&reference.force).map(|(a, b)| (a - b) * (a - b)).sum();
    (squares / run.force.len() as Real).sqrt() / peak
}

fn body(surface: Surface, spacings: &[Real], young: Real, holds: Bounds) -> Result<Arc<Body>> {
    let recipe = Recipe {
        name: "study".into(),
        shape: prepare::Shape::closed(surface, spacings.to_vec()),
        material: Material::from_young(young, 0.45, 1050.0),
        inclusions: vec![],
        holds: vec![Region { bounds: holds, stiffness: None, exact: false }],
        elements: Default::default(),
        damping_ratio: 0.15,
    };
    Ok(Arc::new(prepare(&recipe, &mut |_, _, _| {}).map_err(Error::other)?))
}

/// A clamped cube of 0.1 m, ball of a tenth of that pressed half its radius in and stroked over half the face.
///
/// # Errors
/// When the cube cannot be prepared.
pub fn cube_stroke(spacings: &[Real]) -> Result<Stroke> {
    let side = 0.1;
    let surface = box_surface(Vec3::repeat(side), [24; 3]);
    let body = body(surface, spacings, 1e4, Bounds::new(Vec3::zeros(), Vec3::new(side, side, 0.0)))?;
    let start = Vec3::new(0.25 * side, 0.5 * side, 1.1 * side);
    Ok(Stroke { body, radius: 0.1 * side, depth: 0.05 * side, start, length: 0.5 * side, height: vec![0.0] })
}

/// An organ in its bed, a ball of 10 mm pressed 10 mm and stroked 50 mm along its top.
///
/// # Errors
/// When the organ cannot be prepared.
pub fn organ_stroke(surface: Surface, spacings: &[Real], young: Real) -> Result<Stroke> {
    let Bounds { low, high } = surface.bounds();
    let bed = Vec3::new(high.x, high.y, low.z + 0.45 * (high.z - low.z));
    let radius = 0.01;
    let top = surface.vertices.iter().copied().max_by(|a, b| a.z.total_cmp(&b.z)).unwrap_or_default();
    let length = 0.05;
    // Where a ball that comes from above would touch.
    let touch = |x: Real| {
        let lift = |v: &Vec3| {
            let beside = (v.x - x) * (v.x - x) + (v.y - top.y) * (v.y - top.y);
            (beside < radius * radius).then(|| v.z + (radius * radius - beside).sqrt())
        };
        surface.vertices.iter().filter_map(lift).fold(Real::NEG_INFINITY, Real::max)
    };
    let first = top.x - 0.5 * length;
    let start = Vec3::new(first, top.y, touch(first));
    let height = (0..=100).map(|i| touch(first + length * Real::from(i) / 100.0) - start.z).collect();
    let body = body(surface, spacings, young, Bounds::new(low, bed))?;
    Ok(Stroke { body, radius, depth: 0.01, start, length, height })
}

/// Vertices of the displayed surface of an organ of one's own.
const DISPLAY_VERTICES: usize = 4000;

/// Thresholds from coarse to fine: strain jump, reach.
const DRIVEN: [(Real, Real); 7] =
    [(0.3, 0.2), (0.1, 0.35), (0.1, 0.5), (0.1, 0.7), (0.05, 0.7), (0.05, 1.0), (0.1, 1.4)];

/// Error of the tool force against cost: the curve that the mission is about.
pub fn speed(out: &Path, progress: Progress) -> Result<String> {
    let cases = [
        ("cube, 2 k nodes", cube_stroke(&[0.032, 0.018, 0.011])?),
        ("cube, 20 k nodes", cube_stroke(&[0.030, 0.016, 0.0088, 0.0049])?),
        ("cube, 100 k nodes", cube_stroke(&[0.032, 0.018, 0.010, 0.0052, 0.0028])?),
        ("organ, 6 mm", organ_stroke(liver_surface(0.005), &[0.024, 0.012, 0.006], 5e3)?),
    ];
    speed_of("speed", &cases, out, progress)
}

/// The same on an organ of one's own, its bed below 45 % of its height, against uniform 6 and 4 mm.
pub fn speed_on(surface: &Surface, out: &Path, progress: Progress) -> Result<String> {
    let surface = decimate(surface, DISPLAY_VERTICES);
    let cases = [
        ("6 mm", organ_stroke(surface.clone(), &[0.024, 0.012, 0.006], 5e3)?),
        ("4 mm", organ_stroke(surface, &[0.026, 0.014, 0.0075, 0.004], 5e3)?),
    ];
    speed_of("speed-own", &cases, out, progress)
}

fn speed_of(file: &str, cases: &[(&str, Stroke)], out: &Path, progress: Progress) -> Result<String> {
    let mut rows = Vec::new();
    // By what the cost is measured: two counts of element evaluations, and time.
    let mut curves: [Vec<Curve>; 3] = Default::default();
    for (name, on) in cases {
        let finest = on.body.finest();
        let nodes = on.body.level(finest).mesh.nodes.len();
        let reference = stroke(on, None, finest, &format!("{name}: uniform, {nodes} nodes"), progress)?;
        let mut row = |what: String, run: &Run| {
            let e = 100.0 * error(run, &reference);
            let gains = [
                reference.global / run.evaluations,
                reference.evaluations / run.evaluations,
                reference.wall / run.wall,
            ];
            let mut row = vec![(*name).into(), nodes.to_string(), what, format!("{:.0}", run.elements)];
            row.push(format!("{e:.2}"));
            row.extend(gains.map(|g| format!("{g:.1}")));
            rows.push(row);
            gains.map(|g| (g, e))
        };
        row("uniform finest".into(), &reference);
        for level in 0..finest {
            let what = format!("uniform level {level}");
            let run = stroke(on, None, level, &format!("{name}: {what}"), progress)?;
            row(what, &run);
        }
        let mut points: [Vec<(Real, Real)>; 3] = Default::default();
        for (split, reach) in DRIVEN {
            let adaptivity = Adaptivity { split, reach, ..Adaptivity::default() };
            let what = format!("split {split} reach {reach}");
            let run = stroke(on, Some(adaptivity), 0, &format!("{name}: {what}"), progress)?;
            points.iter_mut().zip(row(what, &run)).for_each(|(points, point)| points.push(point));
        }
        for (curves, points) in curves.iter_mut().zip(points) {
            curves.push(Curve { name: (*name).into(), dots: points.clone(), points });
        }
    }
    let most = curves[0].iter().flat_map(|c| &c.points).map(|p| p.1).fold(0.0, Real::max);
    let chart = |(curves, (title, x_label)): (Vec<Curve>, (&str, &str))| Chart {
        title: title.into(),
        x_label: x_label.into(),
        y_label: "error of the force [% of its peak, rms]".into(),
        curves,
        y_range: Some((0.0, 1.06 * most)),
        log_x: true,
        ..Chart::default()
    };
    let axes = [
        ("work, against one step for all", "times fewer element evaluations"),
        ("work, against a step for each element", "times fewer element evaluations"),
        ("time", "times faster"),
    ];
    let panels: Vec<Chart> = curves.into_iter().zip(axes).map(chart).collect();
    charts(out, file, "A ball pressed in and stroked along: adaptive against uniform finest resolution", &panels)?;
    let header = [
        "case",
        "finest nodes",
        "run",
        "elements",
        "error %",
        "evaluations, global",
        "evaluations, local",
        "wall time",
    ];
    table(out, &format!("{file}-table"), &header, &rows)
}

/// Time of a tick before, during and after the cut [ns], by the prices of a common machine.
const BUDGET: [u32; 3] = [3_200_000, 320_000, 3_200_000];

/// The budget cut tenfold in the middle of a press.
pub fn overload(out: &Path, progress: Progress) -> Result<String> {
    progress("a press with the budget cut tenfold");
    let on = organ_stroke(liver_surface(0.005), &[0.026, 0.015, 0.0085, 0.005], 5e3)?;
    let mut simulation = begin(&on, Some(Adaptivity { reach: 3.0, ..Adaptivity::default() }), 0)?;
    let (mut force, mut rendered, mut nodes) = (Vec::new(), Vec::new(), Vec::new());
    let (mut needed, mut budget) = (Vec::new(), Vec::new());
    let (mut stood, mut overspent, mut longest, mut now) = (0u32, 0u32, 0u32, 0u32);
    for tick in 0..3000u32 {
        let inputs =
            Inputs { budget: Budget::of(BUDGET[(tick / 1000) as usize]), ..held_at(tick + 1, on.place(tick.min(400))) };
        let outputs = simulation.advance(&inputs);
        let time = Real::from(tick) * TICK;
        force.push((time, outputs.tools[0].state.physical_force.norm()));
        rendered.push((time, outputs.tools[0].state.force.norm()));
        nodes.push((time, Real::from(outputs.active.iter().sum::<u32>())));
        needed.push((time, Real::from(outputs.plan.needed) / 1e3));
        budget.push((time, Real::from(inputs.budget.limit) / 1e3));
        let still = outputs.plan.taken < outputs.plan.needed;
        stood += u32::from(still);
        now = if still { now + 1 } else { 0 };
        longest = longest.max(now);
        overspent += u32::from(outputs.plan.whole > inputs.budget.limit);
    }
    let chart = |title: &str, y_label: &str, curves: Vec<Curve>| Chart {
        title: title.into(),
        x_label: "time [s]".into(),
        y_label: y_label.into(),
        curves,
        ..Chart::default()
    };
    let curve = |name: &str, points: Vec<(Real, Real)>| Curve { name: name.into(), points, ..Curve::default() };
    let fewest = |part: std::ops::Range<usize>| nodes[part].iter().map(|n| n.1).fold(Real::INFINITY, Real::min);
    let text = format!(
        "active nodes: {:.0} before the cut, {:.0} at its end, {:.0} a second later; the body stood still in {stood} ticks \
         (at most {longest} in a row); {overspent} ticks took more than their budget\n",
        nodes[999].1,
        fewest(1900..2000),
        nodes[2999].1
    );
    let panels = [
        chart("active nodes", "nodes", vec![curve("active nodes", nodes)]),
        chart("work", "µs a tick", vec![curve("needed", needed), curve("budget", budget)]),
        chart("force on the tool", "force [N]", vec![curve("of the contact", force), curve("rendered", rendered)]),
    ];
    charts(out, "overload", "The budget cut tenfold in the middle of a press", &panels)?;
    Ok(text)
}
