//! A ball pressed into a block, against answers for the continuum: what the dent below the mesh's size does to the force,
//! and 'move and hold', the paper's own response.

use super::Progress;
use super::laws::{Law, Solid};
use super::plot::{Chart, Curve, charts, table};
use super::relax::relax;
use palpate_body::prepare::{self, Recipe, Region, prepare};
use palpate_core::adaptation::Adaptivity;
use palpate_core::contact::safety::ForceLimits;
use palpate_core::contact::tool::{Coupling, Following, PoseSample, Shape, Tool, ToolEvent};
use palpate_core::geometry::Moments;
use palpate_core::geometry::primitives::{box_mesh, box_surface};
use palpate_core::hierarchy::{Level, embedding};
use palpate_core::math::{Bounds, Pose, Real, Vec3};
use palpate_core::model::{Body, Material};
use palpate_core::simulation::{Inputs, Settings, Simulation, Snapshot};
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
/// Spacings that only the middle of the top has, down to half of the contact's radius [m].
const FINER: [Real; 3] = [0.0032, 0.00225, 0.0016];
/// How far from there they reach [m], ...
const AS_FINE: Real = 8e-3;
/// ... and how many of them away the elements are e times as wide.
const GROWN: Real = 10.0 / 3.0;
/// Width of the displayed triangles there over the radius of the contact: larger ones are felt one by one.
const TRIANGLES: Real = 0.4;
/// Damping ratio of the slowest mode.
const DAMPING: Real = 0.3;
/// Time for each depth [ticks], and within it for going there.
const STAY: u32 = 700;
const GOING: u32 = 300;

fn material() -> Material {
    Material::from_young(1e4, 0.35, 1000.0)
}

/// Of a ball pressed in by `depth` [m].
fn contact_radius(depth: Real) -> Real {
    (RADIUS * depth).sqrt()
}

fn on_its_bottom(size: Vec3) -> Vec<Region> {
    vec![Region { bounds: Bounds::new(Vec3::zeros(), Vec3::new(size.x, size.y, 0.0)), stiffness: None, exact: false }]
}

fn covered(size: Vec3, cells: [u32; 3], spacings: Vec<Real>) -> Result<Body> {
    let recipe = Recipe {
        name: "block".into(),
        shape: prepare::Shape::closed(box_surface(size, cells), spacings),
        material: material(),
        inclusions: vec![],
        holds: on_its_bottom(size),
        damping_ratio: DAMPING,
    };
    prepare(&recipe, &mut |_, _, _| {}).map_err(Error::other)
}

fn block(finest: Real) -> Result<Arc<Body>> {
    let mut spacings: Vec<Real> = (0..4).map(|i| finest * Real::powi(1.77, i)).filter(|s| *s < 0.036).collect();
    spacings.reverse();
    Ok(Arc::new(covered(SIZE, [160, 160, 20], spacings)?))
}

/// The same block in one level, which is `finest` around the middle of its top and ever coarser away from it: a smaller
/// block's cover, drawn out. `triangle`: width of the displayed triangles there [m].
fn drawn_out(finest: Real, triangle: Real) -> Result<Arc<Body>> {
    let grown = GROWN * finest;
    let half = AS_FINE + grown * (1.0 + (SIZE.z - AS_FINE) / grown).ln();
    let n = (half / triangle).round() as u32;
    let mut parts = covered(Vec3::new(2.0 * half, 2.0 * half, half), [2 * n, 2 * n, n], vec![finest])?.into_parts();
    let outward = |x: Real| {
        let beyond = (x.abs() - AS_FINE).max(0.0);
        x.signum() * (x.abs() - beyond + grown * ((beyond / grown).exp() - 1.0))
    };
    let top = Vec3::new(0.5 * SIZE.x, 0.5 * SIZE.y, SIZE.z);
    let draw = |p: &mut Vec3| *p = top + p.add_scalar(-half).map(outward);
    parts.surface.vertices.iter_mut().for_each(draw);
    for level in &mut parts.levels {
        level.mesh.nodes.iter_mut().for_each(draw);
        let (mesh, fraction) = (std::mem::take(&mut level.mesh), std::mem::take(&mut level.fraction));
        *level = Level::new(mesh, fraction, finest, material().density);
    }
    embedding::embed(&mut parts.levels, &parts.surface.vertices);
    parts.shape = Moments::of_surface(&parts.surface);
    parts.weigh();
    let body = Body::new(parts).map_err(Error::other)?;
    let held = on_its_bottom(SIZE);
    let refitted = prepare::refit(body, "block", material(), &[], &held, DAMPING, &mut |_, _, _| {});
    Ok(Arc::new(refitted.map_err(Error::other)?))
}

/// Force [N] at each of `depths` [m]; `restored`: with the compliance of the dent below the mesh's size.
fn felt(body: &Arc<Body>, depths: &[Real], restored: bool) -> Result<Vec<Real>> {
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
    let mut event = Some(ToolEvent::Attach { epoch: 1, period_ticks: 1, coupling: Coupling::RIGID });
    let (mut forces, mut before) = (Vec::new(), -1e-3);
    for &depth in depths {
        let mut force = 0.0;
        for tick in 0..STAY {
            let reached = before + (depth - before) * (Real::from(tick) / Real::from(GOING)).min(1.0);
            let pose =
                Pose { position: Vec3::new(0.5 * SIZE.x, 0.5 * SIZE.y, SIZE.z + RADIUS - reached), ..Pose::default() };
            let sample = PoseSample { sequence: tick, time_ns: 0, pose, buttons: 0 };
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
    progress("a ball pressed into blocks of eight spacings");
    let spacings = FINER.iter().rev().flat_map(|s| [0, 1, 2].map(|k| (*s, k..k + 1)));
    let blocks: Vec<_> = spacings.chain(SPACINGS.iter().rev().map(|s| (*s, 0..CONTINUUM.len()))).collect();
    let runs: Vec<[Vec<Real>; 2]> = blocks
        .par_iter()
        .map(|(finest, of)| {
            let depths: Vec<Real> = CONTINUUM[of.clone()].iter().map(|c| c.0).collect();
            let body = match depths[..] {
                [depth] => drawn_out(*finest, TRIANGLES * contact_radius(depth))?,
                _ => block(*finest)?,
            };
            Ok([felt(&body, &depths, true)?, felt(&body, &depths, false)?])
        })
        .collect::<Result<_>>()?;
    let mut curves = [("with the dent below the mesh's size", 0), ("without", 1)].map(|(name, _)| Curve {
        name: name.into(),
        points: Vec::new(),
        dots: Vec::new(),
    });
    let mut rows = Vec::new();
    for ((finest, of), both) in blocks.iter().zip(&runs) {
        for (k, (depth, expected)) in CONTINUUM[of.clone()].iter().enumerate() {
            let relative = finest / contact_radius(*depth);
            let errors = [0, 1].map(|i: usize| 100.0 * (both[i][k] / expected - 1.0));
            for (curve, error) in curves.iter_mut().zip(errors) {
                curve.dots.push((relative, error));
            }
            rows.push(vec![
                format!("{:.2}", finest * 1e3),
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

    fn error(spacing: Real, (depth, expected): (Real, Real), force: Real) -> Real {
        let error = force / expected - 1.0;
        println!("{:.2} mm, {:.2} mm deep: {:+.1} %", 1e3 * spacing, 1e3 * depth, 100.0 * error);
        error.abs()
    }

    /// R4's rows of a ball without friction, on elements much and little wider than the contact.
    #[test]
    fn a_ball_is_pushed_back_as_by_the_continuum() {
        for spacing in [0.013, 0.0064] {
            let forces = felt(&block(spacing).unwrap(), &CONTINUUM.map(|c| c.0), true).unwrap();
            for (row, force) in CONTINUUM.into_iter().zip(forces) {
                assert!(error(spacing, row, force) < 0.07);
            }
        }
    }

    #[test]
    fn on_elements_narrower_than_the_contact_a_ball_is_pushed_back_within_five_per_cent() {
        for (spacing, row) in [(0.0032, CONTINUUM[2]), (0.00225, CONTINUUM[1]), (0.00225, CONTINUUM[2])] {
            let body = drawn_out(spacing, TRIANGLES * contact_radius(row.0)).unwrap();
            let force = felt(&body, &[row.0], true).unwrap()[0];
            assert!(error(spacing, row, force) < 0.05);
            // Without the dent even these elements are too stiff.
            assert!(spacing < 0.6 * contact_radius(row.0) || felt(&body, &[row.0], false).unwrap()[0] > 1.05 * row.1);
        }
    }

    /// The points that are kept stand for all that the ball touches, not for the deepest.
    #[test]
    fn of_more_points_than_a_tool_may_touch_a_ball_is_pushed_back_alike() {
        let (spacing, row) = (0.00225, CONTINUUM[2]);
        let force = felt(&drawn_out(spacing, 6.25e-4).unwrap(), &[row.0], true).unwrap()[0];
        assert!(error(spacing, row, force) < 0.05);
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
