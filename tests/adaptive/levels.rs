//! The levels answer alike: they sag as far and swing as fast.

use super::*;

/// Levels with fewer nodes are too coarse to be asked.
const LEAST_NODES: usize = 100;

struct Answer {
    nodes: usize,
    /// Mean displacement of the displayed surface along the load [m].
    surface: Real,
    /// Root mean square displacement of the mass [m]: what levels are calibrated by.
    mean_square: Real,
    period: Real,
}

/// How level `level` sags under `gravity`, and swings when it is taken away.
fn answer(body: &Arc<Body>, level: usize, gravity: Vec3) -> Answer {
    let sag = sagging(body, uniform(body, level), gravity, 1500);
    let mesh = sag.mesh();
    let along = gravity.normalize();
    let vertices = &body.surface().vertices;
    let moved = |(v, area): (usize, &Real)| (mesh.vertex(v as u32) - vertices[v]).dot(&along) * area;
    let area: Real = body.vertex_area().iter().sum();
    let surface = body.vertex_area().iter().enumerate().map(moved).sum::<Real>() / area;
    let square =
        |s: &u32| (mesh.position(*s) - body.rest(mesh.node(*s))).norm_squared() * mesh.motion.mass[*s as usize];
    let mean_square = (mesh.active().iter().map(square).sum::<Real>() / body.mass()).sqrt();

    let mut swing = with_settings(&sag, &settings(None));
    let signal: Vec<Real> = (0..3000)
        .map(|_| {
            swing.advance(&Inputs::default());
            mean_displacement(body, swing.mesh()).dot(&along)
        })
        .collect();
    Answer { nodes: mesh.active().len(), surface, mean_square, period: period(&signal) }
}

/// `most` gives what a level of so many nodes may sag and swing otherwise than the finest, as parts.
fn levels_agree(name: &str, body: &Arc<Body>, gravity: Vec3, most: impl Fn(usize) -> (Real, Real)) {
    report(body);
    let answers: Vec<Answer> = (0..body.levels().len()).map(|r| answer(body, r, gravity)).collect();
    let finest = answers.last().unwrap();
    let mut judged = 0;
    for a in &answers {
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
        if a.nodes >= LEAST_NODES {
            judged += 1;
            let (sag, swing) = most(a.nodes);
            assert!(surface.abs() < sag && mean_square.abs() < sag, "{} nodes sag otherwise", a.nodes);
            assert!(slower.abs() < swing, "{} nodes swing otherwise", a.nodes);
        }
    }
    assert!(judged >= 2);
}

fn four_levels() -> Arc<Body> {
    Cube { spacings: vec![0.034, 0.027, 0.020, 0.013], ..elastic_cube(2e4, true) }.body()
}

/// The softest way to load it, and its slowest mode: what calibration goes by.
#[test]
fn levels_sag_and_swing_alike_across_the_hold() {
    levels_agree("across", &four_levels(), Vec3::new(0.0, 0.0, -2.0), |nodes| {
        if nodes < 200 { (0.02, 0.02) } else { (0.02, 0.015) }
    });
}

/// One factor per level serves all loads. Along the hold the body moves by a fifth of what it does across it, so that
/// it counts for little, and the levels' reach beyond the held face for much.
#[test]
fn levels_sag_and_swing_nearly_alike_along_the_hold() {
    levels_agree("along", &four_levels(), Vec3::new(2.0, 0.0, 0.0), |_| (0.05, 0.03));
}

/// Thin parts ask for more nodes: the left lobe is as thick as the coarsest level's elements are large.
#[test]
fn levels_of_the_liver_sag_and_swing_alike() {
    let body = liver(0.3, vec![0.028, 0.018, 0.011], 1e4, 0.0);
    for (name, gravity) in [("liver, down", Vec3::new(0.0, 0.0, -2.0)), ("liver, back", Vec3::new(0.0, 2.0, 0.0))] {
        levels_agree(name, &body, gravity, |nodes| if nodes < 500 { (0.05, 0.04) } else { (0.02, 0.016) });
    }
}
