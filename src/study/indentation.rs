//! A ball pressed into a block, against answers for the continuum: what the dent below the mesh's size does to the force,
//! and 'move and hold', the paper's own response.

use super::Progress;
use super::laws::{Law, Solid};
use super::plot::{Chart, Curve, charts, table};
use super::relax::relax;
use crate::adaptation::Adaptivity;
use crate::contact::safety::ForceLimits;
use crate::contact::tool::{Following, PoseSample, Shape, Tool, ToolEvent};
use crate::geometry::primitives::{box_mesh, box_surface};
use crate::math::{Pose, Real, Vec3};
use crate::model::{Body, Material};
use crate::prepare::{self, Recipe, Region, prepare};
use crate::simulation::{Inputs, Settings, Simulation, Snapshot};
use rayon::prelude::*;
use std::io::{Error, Result};
use std::path::Path;
use std::sync::Arc;

/// Radius of the ball, size of the block [m].
const RADIUS: Real = 0.02;
const SIZE: Vec3 = Vec3::new(0.2, 0.2, 0.1);
/// Depth [m] and force [N] of a frictionless ball: elements of third order, Newton's method (NGSolve 6.2).
const CONTINUUM: [(Real, Real); 3] = [(2.5e-4, 8.30e-3), (5e-4, 0.02320), (1e-3, 0.0642)];
/// Finest spacings, each with coarser levels above it [m].
const SPACINGS: [Real; 5] = [0.018, 0.013, 0.009, 0.0064, 0.0045];
/// Time for each depth [ticks], and within it for going there.
const STAY: u32 = 700;
const GOING: u32 = 300;

fn material() -> Material {
    Material::from_young(1e4, 0.35, 1000.0)
}

fn block(finest: Real) -> Result<Arc<Body>> {
    let mut spacings: Vec<Real> = (0..4).map(|i| finest * Real::powi(1.77, i)).filter(|s| *s < 0.036).collect();
    spacings.reverse();
    let recipe = Recipe {
        name: "block".into(),
        shape: prepare::Shape::closed(box_surface(SIZE, [160, 160, 20]), spacings),
        material: material(),
        inclusions: vec![],
        holds: vec![Region { bounds: (Vec3::zeros(), Vec3::new(SIZE.x, SIZE.y, 0.0)), stiffness: None, exact: false }],
        damping_ratio: 0.3,
    };
    Ok(Arc::new(prepare(&recipe, &mut |_, _, _| {}).map_err(Error::other)?))
}

/// Force [N] at each depth of [`CONTINUUM`]; `restored`: with the compliance of the dent below the mesh's size.
fn felt(body: &Arc<Body>, restored: bool) -> Result<Vec<Real>> {
    let settings = Settings {
        gravity: Vec3::zeros(),
        tools: vec![Tool { name: "ball".into(), shape: Shape::ball(RADIUS), friction: 0.0 }],
        following: Following { speed: 1.0, engage_ticks: 1 },
        limits: ForceLimits { force: 100.0, torque: 10.0, slew: 1e6 },
        adaptivity: Some(Adaptivity { split: 0.01, ..Adaptivity::default() }),
        most_elements: 1_000_000,
    };
    let mut press = Simulation::new(body.clone(), settings, Snapshot::at_rest(body, 0, 1)).map_err(Error::other)?;
    if !restored {
        press.restore_no_dents();
    }
    let mut event = Some(ToolEvent::Attach { epoch: 1, period_ticks: 1, coupling: 0.0 });
    let (mut forces, mut before) = (Vec::new(), -1e-3);
    for (depth, _) in CONTINUUM {
        let mut force = 0.0;
        for tick in 0..STAY {
            let reached = before + (depth - before) * (Real::from(tick) / Real::from(GOING)).min(1.0);
            let pose =
                Pose { position: Vec3::new(0.5 * SIZE.x, 0.5 * SIZE.y, SIZE.z + RADIUS - reached), ..Pose::default() };
            let (linear_velocity, angular_velocity) = (Vec3::zeros(), Vec3::zeros());
            let sample = PoseSample { sequence: tick, time_ns: 0, pose, linear_velocity, angular_velocity, buttons: 0 };
            let mut inputs = Inputs::default();
            inputs.tools[0] = event.take().or(Some(ToolEvent::Pose(sample)));
            force = press.advance(&inputs).tools[0].state.physical_force.z;
        }
        before = depth;
        forces.push(force);
    }
    Ok(forces)
}

/// What 'move and hold' gives at one spacing under the ball.
#[derive(Clone, Copy, Debug)]
pub struct Held {
    /// Spacing under the ball [m].
    pub spacing: Real,
    /// Points that are held, of a quarter.
    pub points: usize,
    /// Sum of the forces that hold them [N].
    pub force: Real,
    /// The printed sum: each force times the area that its point samples [N·m²].
    pub weighted: Real,
}

/// Where the planes of a mesh stand that is `spacing` fine within 8 mm of the middle and ever coarser away from it, from
/// 0 to `half` [m].
fn planes(spacing: Real, half: Real) -> Vec<Real> {
    let mut all: Vec<Real> = (0..=(8e-3 / spacing).round() as u32).map(|i| Real::from(i) * spacing).collect();
    let mut step = spacing;
    while all[all.len() - 1] < half {
        step *= 1.35;
        all.push(all[all.len() - 1] + step);
    }
    let stretch = half / all[all.len() - 1];
    all.iter().map(|p| if *p > 8.5e-3 { p * stretch } else { *p }).collect()
}

/// 'Move and hold' [DDCB01 section 4.2]: the points of the surface inside the ball are moved along its normal onto it, and
/// held there in all directions, so that those near the rim are pulled down. Static, Green strain, `depth` [m] deep in a
/// block of 0.2 by 0.2 by 0.1 m.
pub fn move_and_hold(spacing: Real, depth: Real) -> Held {
    let across = planes(spacing, 0.1);
    let n = across.len() as u32 - 1;
    // A quarter of it: its inner faces stay in their planes.
    let mut mesh = box_mesh(Vec3::repeat(Real::from(n)), [n; 3]);
    let at = |i: Real| across[i.round() as usize];
    mesh.nodes.iter_mut().for_each(|p| *p = Vec3::new(at(p.x), at(p.y), 0.1 - at(Real::from(n) - p.z)));
    let solid = Solid::new(&mesh, material());
    let mut x = solid.rest.clone();
    // Masses that let every element take the same step: only the end counts.
    let mut mass = vec![0.0; x.len()];
    for e in &solid.elements {
        let steepest = e.gradient.iter().map(Vec3::norm_squared).fold(0.0, Real::max);
        let share = e.volume * steepest * (solid.material.lambda + 2.0 * solid.material.mu);
        e.nodes.iter().for_each(|n| mass[*n] += share);
    }
    let mut held = Vec::new();
    for (i, u) in solid.rest.iter().enumerate() {
        let aside = u.x * u.x + u.y * u.y;
        let down = if u.z > 0.1 - 1e-9 && aside < RADIUS * RADIUS {
            depth - RADIUS + (RADIUS * RADIUS - aside).sqrt()
        } else {
            0.0
        };
        if down > 0.0 {
            x[i].z -= down;
            held.push(i);
        }
        if down > 0.0 || u.z < 1e-9 {
            mass[i] = 0.0;
        }
    }
    let mut forces = Vec::new();
    relax(&mut x, &mass, 0.5, 6000, |x| {
        forces = solid.force(Law::Green, x);
        for (f, u) in forces.iter_mut().zip(&solid.rest) {
            (f.x, f.y) = (if u.x > 0.0 { f.x } else { 0.0 }, if u.y > 0.0 { f.y } else { 0.0 });
        }
        let reaction: Real = held.iter().map(|n| forces[*n].z).sum();
        let left: Real = (0..x.len()).filter(|n| mass[*n] > 0.0).map(|n| forces[n].norm_squared()).sum();
        (left.sqrt() > 1e-4 * reaction.abs()).then(|| forces.clone())
    });
    let force = 4.0 * held.iter().map(|n| forces[*n].z).sum::<Real>();
    Held { spacing, points: held.len(), force, weighted: force * spacing * spacing }
}

/// Error of the force against spacing, with and without the dent, and 'move and hold' on three meshes.
///
/// # Errors
/// When a picture cannot be written.
pub fn indentation(out: &Path, progress: Progress) -> Result<String> {
    progress("a ball pressed into blocks of five spacings");
    let runs: Vec<[Vec<Real>; 2]> = SPACINGS
        .par_iter()
        .map(|finest| {
            let body = block(*finest)?;
            Ok([felt(&body, true)?, felt(&body, false)?])
        })
        .collect::<Result<_>>()?;
    let mut curves = [("with the dent below the mesh's size", 0), ("without", 1)].map(|(name, _)| Curve {
        name: name.into(),
        points: Vec::new(),
        dots: Vec::new(),
    });
    let mut rows = Vec::new();
    for (finest, both) in SPACINGS.iter().zip(&runs) {
        for (k, (depth, expected)) in CONTINUUM.iter().enumerate() {
            let relative = finest / (RADIUS * depth).sqrt();
            let errors = [0, 1].map(|i: usize| 100.0 * (both[i][k] / expected - 1.0));
            for (curve, error) in curves.iter_mut().zip(errors) {
                curve.dots.push((relative, error));
            }
            rows.push(vec![
                format!("{:.1}", finest * 1e3),
                format!("{:.2}", depth * 1e3),
                format!("{relative:.2}"),
                format!("{:+.1}", errors[0]),
                format!("{:+.1}", errors[1]),
            ]);
        }
    }
    for curve in &mut curves {
        curve.dots.sort_by(|a, b| a.0.total_cmp(&b.0));
        curve.points = curve.dots.clone();
    }
    let chart = Chart {
        title: "error of the force of a ball of 20 mm, 0.25 to 1 mm deep".into(),
        x_label: "finest spacing over the radius of the contact".into(),
        y_label: "error [%]".into(),
        curves: curves.into(),
        ..Chart::default()
    };
    charts(out, "indentation", "A ball pressed into a block, against the continuum", &[chart])?;
    let header = ["spacing [mm]", "depth [mm]", "spacing over contact radius", "with the dent [%]", "without [%]"];
    let text = table(out, "indentation-table", &header, &rows)?;

    progress("'move and hold', as printed");
    let depth = 1e-3;
    let held: Vec<Held> = [4e-3, 2e-3, 1e-3].into_par_iter().map(|s| move_and_hold(s, depth)).collect();
    let rows: Vec<Vec<String>> = held
        .iter()
        .map(|h| {
            vec![
                format!("{:.0}", h.spacing * 1e3),
                h.points.to_string(),
                format!("{:.4}", h.force),
                format!("{:.4}", h.weighted * 1e6),
            ]
        })
        .collect();
    let header =
        ["spacing [mm]", "points held in a quarter", "sum of their forces [N]", "weighted by area, as printed [N·mm²]"];
    Ok(text + &table(out, "move-and-hold-table", &header, &rows)?)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// R4's rows of a ball without friction, on elements much and little wider than the contact.
    #[test]
    fn a_ball_is_pushed_back_as_by_the_continuum() {
        for spacing in [0.013, 0.0064] {
            let forces = felt(&block(spacing).unwrap(), true).unwrap();
            for ((depth, expected), force) in CONTINUUM.iter().zip(forces) {
                let error = force / expected - 1.0;
                println!("{:.1} mm, {:.2} mm deep: {:+.1} %", 1e3 * spacing, 1e3 * depth, 100.0 * error);
                assert!(error.abs() < 0.07, "{error}");
            }
        }
    }

    /// R4's rows of displacement-driven contact: 0.0436 N at 1 mm, two thirds of what a ball without friction feels.
    #[test]
    fn move_and_hold_comes_to_the_continuum_and_its_weights_to_nothing() {
        let [coarse, fine] = [2e-3, 1e-3].map(|spacing| move_and_hold(spacing, 1e-3));
        let limit = fine.force + (fine.force - coarse.force);
        println!("{coarse:?}, {fine:?}, towards {limit:.4} N");
        assert!((fine.force / 0.0436 - 1.0).abs() < 0.15 && (limit / 0.0436 - 1.0).abs() < 0.05);
        assert!(fine.weighted < 0.3 * coarse.weighted, "a force that goes with the area of a triangle is none");
    }
}
