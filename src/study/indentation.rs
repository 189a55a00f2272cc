//! A ball pressed into a block, against answers for the continuum: what the dent below the mesh's size does to the force.

use super::Progress;
use super::plot::{Chart, Curve, charts, table};
use super::trial::{Trial, attached, held_at};
use palpate_body::prepare::{self, Elements, Recipe, Region, prepare};
use palpate_core::adaptation::Adaptivity;
use palpate_core::geometry::Moments;
use palpate_core::geometry::primitives::box_surface;
use palpate_core::hierarchy::{Level, embedding};
use palpate_core::math::{Bounds, Real, Vec3};
use palpate_core::model::{Body, Material};
use rayon::prelude::*;
use std::io::{Error, Result};
use std::path::Path;
use std::sync::Arc;

/// Radius of the ball [m].
pub const RADIUS: Real = 0.02;
/// Size of the block [m].
pub const SIZE: Vec3 = Vec3::new(0.2, 0.2, 0.1);
/// Depth [m] and force [N] of a frictionless ball: elements of third order, Newton's method (NGSolve 6.2).
pub const CONTINUUM: [(Real, Real); 3] = [(2.5e-4, 8.30e-3), (5e-4, 0.02320), (1e-3, 0.0642)];
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

/// What the block is made of.
pub fn material() -> Material {
    Material::from_young(1e4, 0.35, 1000.0)
}

/// Of a ball pressed in by `depth` [m].
fn contact_radius(depth: Real) -> Real {
    (RADIUS * depth).sqrt()
}

/// What holds a block of this `size` [m].
pub fn on_its_bottom(size: Vec3) -> Vec<Region> {
    vec![Region { bounds: Bounds::new(Vec3::zeros(), Vec3::new(size.x, size.y, 0.0)), stiffness: None, exact: false }]
}

fn covered(size: Vec3, cells: [u32; 3], spacings: Vec<Real>) -> Result<Body> {
    let recipe = Recipe {
        name: "block".into(),
        shape: prepare::Shape::closed(box_surface(size, cells), spacings),
        material: material(),
        inclusions: vec![],
        holds: on_its_bottom(size),
        elements: Default::default(),
        damping_ratio: DAMPING,
    };
    prepare(&recipe, &mut |_, _, _| {}).map_err(Error::other)
}

/// The block on its bottom, down to the spacing `finest` [m].
///
/// # Errors
/// When it cannot be prepared.
pub fn block(finest: Real) -> Result<Arc<Body>> {
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
    let refitted =
        prepare::refit(body, "block", material(), &[], &held, Elements::Tetrahedra, DAMPING, &mut |_, _, _| {});
    Ok(Arc::new(refitted.map_err(Error::other)?))
}

/// Force [N] at each of `depths` [m].
///
/// # Errors
/// When the body does not start.
pub fn felt(body: &Arc<Body>, depths: &[Real]) -> Result<Vec<Real>> {
    let adaptivity = Adaptivity { split: 0.01, ..Adaptivity::default() };
    let mut press = Trial::ball(RADIUS, Some(adaptivity)).on_level(body, 0)?;
    press.advance(&attached());
    let (mut forces, mut before) = (Vec::new(), -1e-3);
    for &depth in depths {
        let mut force = 0.0;
        for tick in 0..STAY {
            let reached = before + (depth - before) * (Real::from(tick) / Real::from(GOING)).min(1.0);
            let centre = Vec3::new(0.5 * SIZE.x, 0.5 * SIZE.y, SIZE.z + RADIUS - reached);
            force = press.advance(&held_at(tick + 1, centre)).tools[0].state.physical_force.z;
        }
        before = depth;
        forces.push(force);
    }
    Ok(forces)
}

/// Error of the force against spacing.
///
/// # Errors
/// When a picture cannot be written.
pub fn indentation(out: &Path, progress: Progress) -> Result<String> {
    progress("a ball pressed into blocks of eight spacings");
    let spacings = FINER.iter().rev().flat_map(|s| [0, 1, 2].map(|k| (*s, k..k + 1)));
    let blocks: Vec<_> = spacings.chain(SPACINGS.iter().rev().map(|s| (*s, 0..CONTINUUM.len()))).collect();
    let runs: Vec<Vec<Real>> = blocks
        .par_iter()
        .map(|(finest, of)| {
            let depths: Vec<Real> = CONTINUUM[of.clone()].iter().map(|c| c.0).collect();
            let body = match depths[..] {
                [depth] => drawn_out(*finest, TRIANGLES * contact_radius(depth))?,
                _ => block(*finest)?,
            };
            felt(&body, &depths)
        })
        .collect::<Result<_>>()?;
    let mut curve = Curve { name: "by samples".into(), points: Vec::new(), dots: Vec::new() };
    let mut rows = Vec::new();
    for ((finest, of), forces) in blocks.iter().zip(&runs) {
        for ((depth, expected), force) in CONTINUUM[of.clone()].iter().zip(forces) {
            let relative = finest / contact_radius(*depth);
            let error = 100.0 * (force / expected - 1.0);
            curve.dots.push((relative, error));
            rows.push(vec![
                format!("{:.2}", finest * 1e3),
                format!("{:.2}", depth * 1e3),
                format!("{relative:.2}"),
                format!("{error:+.1}"),
            ]);
        }
    }
    curve.dots.sort_by(|a, b| a.0.total_cmp(&b.0));
    curve.points = curve.dots.clone();
    let chart = Chart {
        title: "error of the force of a ball of 20 mm, 0.25 to 1 mm deep".into(),
        x_label: "finest spacing over the radius of the contact".into(),
        y_label: "error [%]".into(),
        curves: vec![curve],
        ..Chart::default()
    };
    charts(out, "indentation", "A ball pressed into a block, against the continuum", &[chart])?;
    let header = ["spacing [mm]", "depth [mm]", "spacing over contact radius", "error [%]"];
    table(out, "indentation-table", &header, &rows)
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
            let forces = felt(&block(spacing).unwrap(), &CONTINUUM.map(|c| c.0)).unwrap();
            for (row, force) in CONTINUUM.into_iter().zip(forces) {
                assert!(error(spacing, row, force) < 0.07);
            }
        }
    }

    #[test]
    fn on_elements_narrower_than_the_contact_a_ball_is_pushed_back_within_five_per_cent() {
        for (spacing, row) in [(0.0032, CONTINUUM[2]), (0.00225, CONTINUUM[1]), (0.00225, CONTINUUM[2])] {
            let body = drawn_out(spacing, TRIANGLES * contact_radius(row.0)).unwrap();
            assert!(error(spacing, row, felt(&body, &[row.0]).unwrap()[0]) < 0.05);
        }
    }
}
