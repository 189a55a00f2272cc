//! Section 4.2: surface points inside the tool are moved out of it and held, the forces that hold them are weighted by area
//! and summed; through an embedding [4.1], on meshes and displays of several widths, against the continuum.

use super::{Claim, Verdict};
use crate::Progress;
use crate::indentation::{CONTINUUM, RADIUS, SIZE, block, felt, material};
use crate::laws::{Law, Solid};
use crate::plot::{Chart, Curve, charts, table};
use crate::relax::relax;
use palpate_core::geometry::primitives::box_mesh;
use palpate_core::math::{Real, Vec3};
use rayon::prelude::*;
use std::io::Result;
use std::path::Path;

/// What is held, and what it answers.
#[derive(Clone, Copy, Debug)]
pub struct Held {
    /// Spacing of the mesh under the ball [m].
    pub spacing: Real,
    /// Spacing of the displayed points [m].
    pub display: Real,
    /// Nodes that the held points hang on, of a quarter.
    pub nodes: usize,
    /// What all nodes transmit, not weighted [N].
    pub sum: Real,
    /// Each point's force weighted by its part of the area that collides [N].
    pub mean: Real,
    /// Each point's force weighted by its part of the area of the nodes that it hangs on [N].
    pub part: Real,
    /// Each point's force weighted by its area [N·m²].
    pub area: Real,
}

/// A response that [`Held`] has.
pub type Reading = fn(&Held) -> Real;

/// How the weights are read, and what of [`Held`] that is.
pub const READINGS: [(&str, Reading); 4] = [
    ("not weighted [N]", |h| h.sum),
    ("part of the nodes' area [N]", |h| h.part),
    ("part of the collision's area [N]", |h| h.mean),
    ("area [N·mm²]", |h| 1e6 * h.area),
];

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

/// How far a point at `u` of the face z = 0.1 m is inside a ball that is in by `depth` [m], along the face's normal.
fn inside(u: (Real, Real), depth: Real) -> Real {
    let aside = u.0 * u.0 + u.1 * u.1;
    if aside < RADIUS * RADIUS { (depth - RADIUS + (RADIUS * RADIUS - aside).sqrt()).max(0.0) } else { 0.0 }
}

/// A ball pressed `depth` [m] into a block of 0.2 by 0.2 by 0.1 m, static, Green strain: points `display` apart on the
/// face, those inside the ball moved along the normal onto it, the nodes that they hang on moved by the mean of their
/// points and held there in all directions.
pub fn move_and_hold(spacing: Real, display: Real, depth: Real) -> Held {
    let across = planes(spacing, 0.5 * SIZE.x);
    let n = across.len() as u32 - 1;
    // A quarter of it: its inner faces stay in their planes.
    let mut mesh = box_mesh(Vec3::repeat(Real::from(n)), [n; 3]);
    let at = |i: Real| across[i.round() as usize];
    mesh.nodes.iter_mut().for_each(|p| *p = Vec3::new(at(p.x), at(p.y), SIZE.z - at(Real::from(n) - p.z)));
    let solid = Solid::new(&mesh, material());
    let face: Vec<[usize; 3]> = mesh.boundary().into_iter().map(|t| t.map(|n| n as usize)).collect();
    let face: Vec<[usize; 3]> =
        face.into_iter().filter(|t| t.iter().all(|n| solid.rest[*n].z > SIZE.z - 1e-9)).collect();
    // Points that collide: how far, and on which nodes by which weights.
    let mut points: Vec<(Real, [usize; 3], [Real; 3])> = Vec::new();
    let count = (0.5 * SIZE.x / display).round() as u32;
    let place = |i: u32| (Real::from(i) + 0.5) * display;
    for (y, x) in (0..count).flat_map(|y| (0..count).map(move |x| (place(y), place(x)))) {
        let down = inside((x, y), depth);
        if down <= 0.0 {
            continue;
        }
        let weights = |t: &[usize; 3]| {
            let [a, b, c] = t.map(|n| (solid.rest[n].x, solid.rest[n].y));
            let cross = |p: (Real, Real), q: (Real, Real), r: (Real, Real)| {
                (q.0 - p.0) * (r.1 - p.1) - (r.0 - p.0) * (q.1 - p.1)
            };
            let whole = cross(a, b, c);
            [cross((x, y), b, c), cross(a, (x, y), c), cross(a, b, (x, y))].map(|part| part / whole)
        };
        let least = |t: &&[usize; 3]| weights(t).into_iter().fold(Real::INFINITY, Real::min);
        // The face is covered, so one contains the point.
        if let Some(t) = face.iter().max_by(|a, b| least(a).total_cmp(&least(b))) {
            points.push((down, *t, weights(t)));
        }
    }
    let mut on_node = vec![(0.0, 0.0); solid.rest.len()];
    for (down, nodes, weights) in &points {
        for (n, w) in nodes.iter().zip(weights).filter(|(_, w)| **w > 1e-9) {
            on_node[*n].0 += w;
            on_node[*n].1 += w * down;
        }
    }
    let held: Vec<usize> = (0..on_node.len()).filter(|n| on_node[*n].0 > 0.0).collect();
    let mut x = solid.rest.clone();
    // Masses that let every element take the same step: only the end counts.
    let mut mass = vec![0.0; x.len()];
    for e in &solid.elements {
        let steepest = e.gradient.iter().map(Vec3::norm_squared).fold(0.0, Real::max);
        let share = e.volume * steepest * solid.material.pressure_modulus();
        e.nodes.iter().for_each(|n| mass[*n] += share);
    }
    held.iter().for_each(|n| x[*n].z -= on_node[*n].1 / on_node[*n].0);
    let bottom: Vec<usize> = (0..x.len()).filter(|n| solid.rest[*n].z < 1e-9).collect();
    held.iter().chain(&bottom).for_each(|n| mass[*n] = 0.0);
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
    // Every point takes its part of what the nodes that it hangs on transmit.
    let area = display * display;
    let (mut weighted, mut part) = (0.0, 0.0);
    for (_, nodes, weights) in &points {
        for (n, w) in nodes.iter().zip(weights).filter(|(n, w)| **w > 1e-9 && on_node[**n].0 > 0.0) {
            // The node's area is that of its points, by their weights.
            let area_of_node = area * on_node[*n].0;
            part += forces[*n].z * w * area / area_of_node;
            weighted += forces[*n].z * w / on_node[*n].0;
        }
    }
    Held {
        spacing,
        display,
        nodes: held.len(),
        sum: 4.0 * held.iter().map(|n| forces[*n].z).sum::<Real>(),
        part: 4.0 * part,
        // Of four quarters, as many points each.
        mean: weighted / points.len() as Real,
        area: 4.0 * weighted * area,
    }
}

/// Spacings of mesh and display [m], and the depth.
const SPACINGS: [Real; 3] = [4e-3, 2e-3, 1e-3];
const DISPLAYS: [Real; 3] = [2e-3, 1e-3, 5e-4];
/// A force is right within this part.
const RIGHT: Real = 0.1;

/// The claim of section 4.2 on the areas.
///
/// # Errors
/// When a picture cannot be written.
pub fn claims(out: &Path, progress: Progress) -> Result<Vec<Claim>> {
    progress("points moved out of a ball and held, through an embedding");
    let (depth, continuum) = CONTINUUM[2];
    let cases: Vec<(Real, Real)> = SPACINGS.iter().flat_map(|s| DISPLAYS.map(|d| (*s, d))).collect();
    let held: Vec<Held> = cases.par_iter().map(|(s, d)| move_and_hold(*s, *d, depth)).collect();
    let core_spacings = [0.009, 0.0064];
    let core: Vec<Real> =
        core_spacings.par_iter().map(|finest| Ok(felt(&block(*finest)?, &[depth])?[0])).collect::<Result<_>>()?;
    let mut rows: Vec<Vec<String>> = held
        .iter()
        .map(|h| {
            let mut row = vec![
                "printed".into(),
                format!("{:.0}", 1e3 * h.spacing),
                format!("{:.1}", 1e3 * h.display),
                h.nodes.to_string(),
            ];
            row.extend(READINGS.iter().map(|(_, of)| format!("{:.5}", of(h))));
            row
        })
        .collect();
    for (spacing, force) in core_spacings.iter().zip(&core) {
        let none = || "–".to_owned();
        rows.push(vec![
            "the core".into(),
            format!("{:.1}", 1e3 * spacing),
            "1.2".into(),
            none(),
            format!("{force:.5}"),
            none(),
            none(),
            none(),
        ]);
    }
    let mut header = vec!["method", "mesh [mm]", "display [mm]", "nodes held in a quarter"];
    header.extend(READINGS.iter().map(|(name, _)| *name));
    // Over the finest mesh's value with the widest display: a response that means something does not change.
    let finest = |of: fn(&Held) -> Real| of(&held[held.len() - 1]);
    let curves = READINGS.iter().map(|(name, of)| {
        let at = |h: &&Held| h.display == DISPLAYS[1];
        let points: Vec<(Real, Real)> =
            held.iter().filter(at).map(|h| (1e3 * h.spacing, of(h) / finest(*of))).collect();
        Curve { name: (*name).into(), dots: points.clone(), points }
    });
    let by_mesh = Chart {
        title: "points 1 mm apart, over the finest of all".into(),
        x_label: "spacing of the mesh [mm]".into(),
        y_label: "response over the finest's".into(),
        curves: curves.collect(),
        ..Chart::default()
    };
    let curves = READINGS.iter().map(|(name, of)| {
        let at = |h: &&Held| h.spacing == SPACINGS[1];
        let points: Vec<(Real, Real)> =
            held.iter().filter(at).map(|h| (1e3 * h.display, of(h) / finest(*of))).collect();
        Curve { name: (*name).into(), dots: points.clone(), points }
    });
    let by_display = Chart {
        title: "mesh of 2 mm, over the finest of all".into(),
        x_label: "spacing of the displayed points [mm]".into(),
        y_label: "response over the finest's".into(),
        curves: curves.collect(),
        ..Chart::default()
    };
    charts(
        out,
        "move_and_hold",
        "A ball held 1 mm deep: the response by how its area weights are read",
        &[by_mesh, by_display],
    )?;
    let range = |of: fn(&Held) -> Real| {
        let all = || held.iter().map(of);
        all().fold(0.0, Real::max) / all().fold(Real::INFINITY, Real::min)
    };
    let off = |force: Real| force / continuum - 1.0;
    let worst = |of: fn(&Held) -> Real| held.iter().map(|h| off(of(h)).abs()).fold(0.0, Real::max);
    let right = READINGS[..3].iter().any(|(_, of)| worst(*of) < RIGHT);
    let ranges: Vec<String> = READINGS.iter().map(|(name, of)| format!("{name} by {:.1}", range(*of))).collect();
    let core_worst = core.iter().map(|f| off(*f).abs()).fold(0.0, Real::max);
    Ok(vec![Claim {
        section: "4.2",
        says: "The forces on surface points, weighted by the area that each samples and summed, are the correct response",
        measured: format!(
            "A ball of 20 mm held {:.0} mm deep; without friction the continuum answers {continuum} N, and by that a response \
             is judged, within {:.0} %. Weights that are parts of the nodes' areas sum to one: that is the sum without weights. \
             Parts of the collision's area make it a mean, which goes down as points are added; areas themselves make it no \
             force. The sum itself tends to two thirds of the frictionless force as the mesh is refined: points near the rim \
             are pulled down, and all are held sideways.\n\n{}",
            1e3 * depth,
            100.0 * RIGHT,
            table(out, "move-and-hold", &header, &rows)?
        ),
        picture: Some(("move_and_hold", "response against mesh and display, by how the weights are read; not weighted and by parts of the nodes' area it is the same".into())),
        printed: Some(Verdict::new(
            right,
            format!(
                "over meshes of 4 to 1 mm and displays of 2 to 0.5 mm the response varies, as a factor: {}; the sum is up to \
                 {:.0} % off, on the finest {:+.0} %",
                ranges.join(", "),
                100.0 * worst(|h| h.sum),
                100.0 * off(finest(|h| h.sum))
            ),
        )),
        shipped: Some(Verdict::new(core_worst < RIGHT, format!("it is up to {:.1} % off", 100.0 * core_worst))),
    }])
}
