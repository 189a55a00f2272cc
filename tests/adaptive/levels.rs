//! The levels answer alike: they sag as far and swing as fast.

use super::shared::shared;
use super::*;
use palpate_body::geometry::mesh_io::{LengthUnit, read_surface};
use palpate_core::ids::{Slot, Vertex};

/// Levels with fewer nodes are too coarse to be asked.
const LEAST_NODES: usize = 100;
/// Ticks of a swing: lines half a hertz apart are told from each other.
const SWING: usize = 6000;

struct Answer {
    nodes: usize,
    /// Mean displacement of the displayed surface along the load [m].
    surface: Real,
    /// Root mean square displacement of the mass [m].
    mean_square: Real,
    /// Of the strongest line of the swing [s].
    period: Real,
}

/// Period [s] of the strongest line of a signal, one sample a tick, under Hann's window: other modes swing along.
fn strongest_period(signal: &[Real]) -> Real {
    let n = signal.len() as Real;
    let turn = 2.0 * std::f64::consts::PI;
    let mean = signal.iter().sum::<Real>() / n;
    let window = |i: usize| 1.0 - (turn * (i as Real + 0.5) / n).cos();
    let windowed: Vec<Real> = signal.iter().enumerate().map(|(i, s)| (s - mean) * window(i)).collect();
    let power = |frequency: Real| {
        let (mut re, mut im) = (0.0, 0.0);
        for (i, s) in windowed.iter().enumerate() {
            let (sin, cos) = (turn * frequency * i as Real * TICK).sin_cos();
            (re, im) = (re + s * cos, im + s * sin);
        }
        re * re + im * im
    };
    // A line is 4 / (n TICK) wide.
    let mut step = 1.0 / (n * TICK);
    let of = |f: Real| (power(f), f);
    let strongest = |a: (Real, Real), b: (Real, Real)| if b.0 > a.0 { b } else { a };
    let mut best = (2..100).map(|i| of(Real::from(i) * step)).reduce(strongest).unwrap();
    while step > 1e-5 {
        step *= 0.5;
        best = [of(best.1 - step), of(best.1 + step)].into_iter().fold(best, strongest);
    }
    1.0 / best.1
}

/// How level `level` sags under `gravity`, and swings when it is taken away.
fn answer(body: &Arc<Body>, level: usize, gravity: Vec3) -> Answer {
    let sag = sagging(body, uniform(body, level), gravity, 1500);
    let mesh = sag.mesh();
    let along = gravity.normalize();
    let vertices = &body.surface().vertices;
    let moved = |(v, area): (usize, &Real)| (mesh.vertex(Vertex::at(v)) - vertices[v]).dot(&along) * area;
    let area: Real = body.vertex_area().iter().sum();
    let surface = body.vertex_area().iter().enumerate().map(moved).sum::<Real>() / area;
    let square = |s: &Slot| (mesh.position(*s) - body.rest(mesh.node(*s))).norm_squared() * mesh.motion.mass[s.index()];
    let mean_square = (mesh.active().iter().map(square).sum::<Real>() / body.mass()).sqrt();

    let mut swing = with_settings(&sag, &settings(None));
    let signal: Vec<Real> = (0..SWING)
        .map(|_| {
            swing.advance(&Inputs::default());
            mean_displacement(body, swing.mesh()).dot(&along)
        })
        .collect();
    Answer { nodes: mesh.active().len(), surface, mean_square, period: strongest_period(&signal) }
}

/// What a level may sag otherwise than the finest, as a part, and the coarsest one.
const MOST_SAG: Real = 0.05;
const MOST_SAG_OF_COARSEST: Real = 0.1;
/// What a level may swing otherwise, and the coarsest one: as the root of what it sags.
const MOST_SWING: Real = 0.03;
const MOST_SWING_OF_COARSEST: Real = 0.05;

fn levels_agree(name: &str, body: &Arc<Body>, gravity: Vec3) {
    report(body);
    let answers: Vec<Answer> = (0..body.levels().len()).map(|r| answer(body, r, gravity)).collect();
    let finest = answers.last().unwrap();
    let warnings = palpate_body::prepare::report::report(body).warnings;
    let mut judged = 0;
    for (r, a) in answers.iter().enumerate() {
        let surface = a.surface / finest.surface - 1.0;
        let mean_square = a.mean_square / finest.mean_square - 1.0;
        let slower = a.period / finest.period - 1.0;
        println!(
            "{name}, {} nodes: surface sags {:.3} mm ({:+.2} %), rms {:.3} mm ({:+.2} %), period {:.1} ms ({:+.2} %)",
            a.nodes,
            a.surface * 1e3,
            surface * 100.0,
            a.mean_square * 1e3,
            mean_square * 100.0,
            a.period * 1e3,
            slower * 100.0
        );
        // What `prepare` says is too coarse for the body is not asked.
        let is_told = warnings.iter().any(|warning| warning.starts_with(&format!("level {r} is too coarse")));
        assert!(r == 0 || !is_told);
        if a.nodes >= LEAST_NODES && !is_told {
            judged += 1;
            let most = if r == 0 { MOST_SAG_OF_COARSEST } else { MOST_SAG };
            assert!(surface.abs() < most && mean_square.abs() < most, "{} nodes sag otherwise", a.nodes);
            let most = if r == 0 { MOST_SWING_OF_COARSEST } else { MOST_SWING };
            assert!(slower.abs() < most, "{} nodes swing otherwise", a.nodes);
        }
    }
    assert!(judged >= 2);
}

fn four_levels() -> Arc<Body> {
    Cube { spacings: vec![0.034, 0.027, 0.020, 0.013], ..elastic_cube(2e4, true) }.body()
}

/// The softest way to load it, and its slowest mode.
#[test]
fn levels_sag_and_swing_alike_across_the_hold() {
    levels_agree("across", &four_levels(), Vec3::new(0.0, 0.0, -2.0));
}

/// Along the hold the body moves by a fifth of what it does across it, and the levels' reach beyond the held face counts
/// for much.
#[test]
fn levels_sag_and_swing_alike_along_the_hold() {
    levels_agree("along", &four_levels(), Vec3::new(2.0, 0.0, 0.0));
}

/// Its left lobe is as thick as the coarsest level's elements are large.
#[test]
fn levels_of_the_liver_sag_and_swing_alike() {
    let body = liver(0.3, vec![0.028, 0.018, 0.011], 1e4, 0.0);
    levels_agree("liver, down", &body, Vec3::new(0.0, 0.0, -2.0));
    levels_agree("liver, back", &body, Vec3::new(0.0, 2.0, 0.0));
    levels_agree("liver, sideways", &body, Vec3::new(2.0, 0.0, 0.0));
}

#[test]
fn levels_of_a_human_liver_sag_and_swing_alike() {
    let Some(path) = shared("meshes/Liver.stl") else { return };
    let surface = read_surface(&path, LengthUnit::Millimetre).unwrap();
    let body = organ(surface, 0.3, vec![0.034, 0.024, 0.016], 1e4, 0.0);
    levels_agree("human liver, down", &body, Vec3::new(0.0, 0.0, -2.0));
    levels_agree("human liver, back", &body, Vec3::new(0.0, 2.0, 0.0));
}
