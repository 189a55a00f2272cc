//! The paper's comparison of laws [DDCB01 3.1, fig. 4–6]: a cube held by one side is let go under gravity, at three
//! resolutions, each on its own, without damping; the curves show the height of one corner.
//!
//! The paper's meshes have 27, 57 and 135 (in the text 137) nodes; its cube's size and constants are not printed. Here:
//! 1 m, λ = 146 kPa, μ = 75 kPa, 1000 kg/m³, and 27, 64 and 125 nodes on independent meshes.

use super::Progress;
use super::laws::{Law, Solid};
use super::levels::independent_box;
use super::plot::{Chart, Curve, Shape, charts, shapes, table};
use palpate_core::math::{Real, Vec3};
use palpate_core::model::Material;
use std::io::Result;
use std::path::Path;

/// Cells along an edge of the three meshes.
const CELLS: [u32; 3] = [2, 3, 4];
/// Simulated time [s]: seven or eight swings.
const DURATION: Real = 5.0;
/// Between two points of a curve [s].
const SAMPLE: Real = 0.01;
/// φ/λ = ψ/μ [s] of the damped figure: each swing is about half as wide as the last.
const DAMPING_TIME: Real = 0.02;
/// Field of all studies that have one [m/s²].
pub const GRAVITY: Vec3 = Vec3::new(0.0, 0.0, -9.81);

/// What all studies are made of.
pub fn material() -> Material {
    damped(0.0)
}

/// The same with viscosities `φ = τ λ`, `ψ = τ μ`, `tau` in [s].
pub fn damped(tau: Real) -> Material {
    let (lambda, mu) = (1.46e5, 0.75e5);
    Material { lambda, mu, phi: tau * lambda, psi: tau * mu, density: 1000.0 }
}

/// The cube of 1 m held at x = 0, with what is needed to let it swing.
struct Swing {
    solid: Solid,
    triangles: Vec<[u32; 3]>,
    law: Law,
    x: Vec<Vec3>,
    v: Vec<Vec3>,
    dt: Real,
}

impl Swing {
    fn new(cells: u32, law: Law, material: Material) -> Self {
        let mesh = independent_box(Vec3::repeat(1.0), [cells; 3], 11 + u64::from(cells));
        let solid = Solid::new(&mesh, material);
        // A quarter of the altitude: springs and stretched elements are stiffer than the material at rest. Viscosity
        // shortens the limit 2/ω to (2/ω)(√(1 + ξ²) − ξ), ξ = τω/2.
        let elastic = solid.altitude / material.wave_speed();
        let xi = material.damping_time() / elastic;
        let limit = 0.25 * elastic * ((1.0 + xi * xi).sqrt() - xi);
        let dt = SAMPLE / (SAMPLE / limit).ceil();
        let (x, v) = (solid.rest.clone(), vec![Vec3::zeros(); solid.rest.len()]);
        Self { triangles: mesh.boundary(), solid, law, x, v, dt }
    }

    /// Advances by [`SAMPLE`].
    ///
    /// Kick, then drift, all nodes together: symplectic, so that an undamped run neither gains nor loses.
    fn advance(&mut self) {
        for _ in 0..(SAMPLE / self.dt).round() as usize {
            let mut force = self.solid.force(self.law, &self.x);
            if self.solid.material.psi > 0.0 {
                let viscous = self.solid.viscous_force(&self.x, &self.v);
                force.iter_mut().zip(viscous).for_each(|(f, d)| *f += d);
            }
            for (n, force) in force.iter().enumerate() {
                if self.solid.rest[n].x > 1e-9 {
                    self.v[n] += (force / self.solid.mass[n] + GRAVITY) * self.dt;
                    self.x[n] += self.v[n] * self.dt;
                }
            }
        }
    }

    /// How far the upper free corner stands below where it began, as a (negative) height [m].
    fn corner(&self) -> Real {
        let corner = Vec3::repeat(1.0);
        // The corner is a node of every mesh.
        let node = (0..self.x.len()).find(|n| (self.solid.rest[*n] - corner).norm() < 1e-9).unwrap_or(0);
        self.x[node].z - 1.0
    }
}

/// Height of the corner over time for one law at one resolution.
fn curve(cells: u32, law: Law, material: Material) -> Curve {
    let mut swing = Swing::new(cells, law, material);
    let mut points = vec![(0.0, 0.0)];
    for i in 1..=(DURATION / SAMPLE).round() as usize {
        swing.advance();
        points.push((i as Real * SAMPLE, swing.corner()));
    }
    Curve { name: format!("{} nodes", (cells + 1).pow(3)), points, ..Curve::default() }
}

/// Deepest point of the first swing [m], and the period [s] of the strongest frequency between 0.5 and 5 Hz.
fn depth_and_period(points: &[(Real, Real)]) -> (Real, Real) {
    let mean = points.iter().map(|p| p.1).sum::<Real>() / points.len() as Real;
    let turn = points.windows(2).position(|p| p[1].1 > p[0].1 && p[0].1 < mean).unwrap_or(0);
    let duration = points[points.len() - 1].0;
    let strength = |frequency: Real| {
        let (mut real, mut imaginary) = (0.0, 0.0);
        for (t, y) in points {
            // A window that fades at both ends keeps the other frequencies from leaking in.
            let window = (std::f64::consts::PI * t / duration).sin().powi(2);
            let phase = std::f64::consts::TAU * frequency * t;
            real += window * (y - mean) * phase.cos();
            imaginary += window * (y - mean) * phase.sin();
        }
        real * real + imaginary * imaginary
    };
    let frequencies = (0..900).map(|i| 0.5 + 0.005 * Real::from(i));
    let best = frequencies.map(|f| (strength(f), f)).fold((0.0, Real::NAN), |a, b| if b.0 > a.0 { b } else { a });
    (points[turn].1, 1.0 / best.1)
}

fn root_mean_square(a: &[(Real, Real)], b: &[(Real, Real)]) -> Real {
    (a.iter().zip(b).map(|(a, b)| (a.1 - b.1) * (a.1 - b.1)).sum::<Real>() / a.len() as Real).sqrt()
}

fn panel(title: &str, curves: Vec<Curve>) -> Chart {
    Chart {
        title: title.into(),
        x_label: "time [s]".into(),
        y_label: "height of the corner [m]".into(),
        curves,
        y_range: Some((-0.5, 0.1)),
        ..Chart::default()
    }
}

/// Figures 4, 5 and 6 of the paper, and the laws that it does not have.
pub fn figures(out: &Path, progress: Progress) -> Result<String> {
    let cases = [
        ("4a", Law::MassSpring, material()),
        ("4b", Law::Cauchy, material()),
        ("5a", Law::Green, material()),
        ("5b", Law::Green, damped(DAMPING_TIME)),
        ("–", Law::SimplifiedCauchy, material()),
        ("–", Law::GreenWithCompression, material()),
        ("–", Law::StableNeoHookean, material()),
    ];
    let mut panels = Vec::new();
    let mut rows = Vec::new();
    for (figure, law, material) in cases {
        progress(&format!("swinging cube, {}", law.name()));
        let curves: Vec<Curve> = CELLS.iter().map(|c| curve(*c, law, material)).collect();
        let measured: Vec<(Real, Real)> = curves.iter().map(|c| depth_and_period(&c.points)).collect();
        let damping = if material.psi > 0.0 { ", damped" } else { "" };
        let percent = |pick: fn(&(Real, Real)) -> Real, i: usize| {
            format!("{:+.1} %", 100.0 * (pick(&measured[i]) / pick(&measured[2]) - 1.0))
        };
        let mut row = vec![figure.into(), format!("{}{damping}", law.name())];
        row.extend(measured.iter().map(|m| format!("{:.3}", m.0)));
        row.extend([percent(|m| m.0, 0), percent(|m| m.0, 1)]);
        row.extend(measured.iter().map(|m| format!("{:.3}", m.1)));
        row.extend([percent(|m| m.1, 0), percent(|m| m.1, 1)]);
        row.extend((0..2).map(|i| format!("{:.3}", root_mean_square(&curves[i].points, &curves[2].points))));
        rows.push(row);
        panels.push(panel(&format!("{}{damping}", law.name()), curves));
    }
    let letter = |mut chart: Chart, letter: &str| {
        chart.title = format!("{letter}  {}", chart.title);
        chart
    };
    let two = |a: usize, b: usize| [letter(panels[a].clone(), "(a)"), letter(panels[b].clone(), "(b)")];
    charts(out, "figure_4", "Fig. 4 – swinging cube at three resolutions", &two(0, 1))?;
    charts(out, "figure_5", "Fig. 5 – swinging cube at three resolutions, Green strain", &two(2, 3))?;
    charts(out, "more_laws", "Swinging cube at three resolutions, laws not in Fig. 4–5", &panels[4..])?;
    let header = [
        "fig.",
        "law",
        "low 27 [m]",
        "low 64",
        "low 125",
        "27/125",
        "64/125",
        "period 27 [s]",
        "period 64",
        "period 125",
        "27/125",
        "64/125",
        "rms 27–125 [m]",
        "rms 64–125",
    ];
    let text = table(out, "oscillation", &header, &rows)?;

    progress("shapes of the swinging cube");
    let laws = [
        Law::Cauchy,
        Law::SimplifiedCauchy,
        Law::Green,
        Law::MassSpring,
        Law::GreenWithCompression,
        Law::StableNeoHookean,
    ];
    let shape = |(i, law): (usize, &Law)| {
        let mut swing = Swing::new(6, *law, material());
        // Down until the corner turns round.
        let mut last = 0.0;
        loop {
            let before = (swing.x.clone(), swing.v.clone());
            swing.advance();
            if swing.corner() > last || swing.corner().is_nan() {
                (swing.x, swing.v) = before;
                break;
            }
            last = swing.corner();
        }
        let letter = ["(a) ", "(b) ", "(c) ", "", "", ""][i];
        Shape { title: format!("{letter}{}", law.name()), vertices: swing.x, triangles: swing.triangles }
    };
    let title = "Fig. 6 – deformed shapes at the lowest point (top row: the paper's three)";
    let six: Vec<Shape> = laws.iter().enumerate().map(shape).collect();
    shapes(out, "figure_6", title, &six, 3, Vec3::repeat(1.0))?;
    Ok(text)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_undamped_swing_keeps_its_energy_and_a_damped_one_comes_to_rest() {
        let total = |s: &Swing| {
            let one = |n: usize| {
                0.5 * s.v[n].norm_squared() * s.solid.mass[n]
                    - s.solid.mass[n] * GRAVITY.dot(&(s.x[n] - s.solid.rest[n]))
            };
            s.solid.energy(s.law, &s.x) + (0..s.x.len()).map(one).sum::<Real>()
        };
        for law in Law::ALL {
            let mut swing = Swing::new(2, law, material());
            let (mut kinetic, mut worst): (Real, Real) = (0.0, 0.0);
            for _ in 0..500 {
                swing.advance();
                kinetic = kinetic.max((0..27).map(|n| 0.5 * swing.solid.mass[n] * swing.v[n].norm_squared()).sum());
                worst = worst.max(total(&swing).abs());
            }
            println!("{law:?}: energy within {worst:.1} J, peak kinetic {kinetic:.1} J");
            assert!(worst < 0.1 * kinetic, "{law:?}: {worst} of {kinetic}");
        }
        let mut swing = Swing::new(2, Law::Green, damped(0.1));
        (0..600).for_each(|_| swing.advance());
        assert!(swing.v.iter().all(|v| v.norm() < 1e-3));
    }

    #[test]
    fn depth_and_period_of_a_cosine_come_out() {
        let points: Vec<(Real, Real)> =
            (0..500).map(|i| (0.01 * i as Real, 0.1 * (6.0 * 0.01 * i as Real).cos() - 0.1)).collect();
        let (depth, period) = depth_and_period(&points);
        assert!((depth + 0.2).abs() < 1e-3);
        assert!((period / (std::f64::consts::TAU / 6.0) - 1.0).abs() < 0.01);
    }
}
