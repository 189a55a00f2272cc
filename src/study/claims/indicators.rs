//! Section 3.3, eq. 9: γ = |f|/h as "a fast and accurate measure of the inadequacy of the node", beside the shipped strain
//! jump, under a tool.
//!
//! Eq. 9 is meant to show how far the displacement is from a linear function around a node. That is measured itself: on the
//! finest level, under the same tool, the residual of the best affine fit to the displacements within a spacing of the
//! node. Both indicators see only the coarse level.

use super::{Claim, Verdict};
use crate::Progress;
use crate::laws::Law;
use crate::levels::Levels;
use crate::plot::{Chart, Coloured, Curve, Shape, charts, coloured, table};
use crate::trial::{Trial, attached, body_of, detached, held_at};
use nalgebra::{Matrix4, Matrix4x3, Vector4};
use palpate_core::adaptation::indicator::strain_jump;
use palpate_core::ids::Node;
use palpate_core::math::{Real, Vec3};
use palpate_core::model::Body;
use palpate_core::model::Material;
use palpate_core::model::step_class::TICK;
use palpate_core::simulation::{Inputs, Simulation};
use std::io::Result;
use std::path::Path;

/// Edge of the cube [m], clamped at x = 0.
const SIDE: Real = 0.1;
/// The ball [m], how deep it is pressed into the face at x = 0.1, and when it is down and let go [ticks].
const RADIUS: Real = 0.02;
const DEPTH: Real = 0.008;
const DOWN: u32 = 200;
const GONE: u32 = 900;
/// When it is looked at: on the way down, at rest, and 10 ms after the ball is gone.
pub const MOMENTS: [(u32, &str); 3] =
    [(120, "pressing"), (GONE - 1, "pressed, at rest"), (GONE + 10, "10 ms after release")];
/// Damping ratio.
const ZETA: Real = 0.15;

/// One moment: of each node of the coarse level that is not fixed, what is true and what the indicators say.
#[derive(Clone, Debug)]
pub struct Seen {
    /// Nodes.
    pub nodes: Vec<Node>,
    /// Distance from the affine on the finest level [m].
    pub truth: Vec<Real>,
    /// |f|/h over λ + 2μ [m].
    pub gamma: Vec<Real>,
    /// Strain jump.
    pub jump: Vec<Real>,
}

fn levels(cells: [u32; 2]) -> Levels {
    let material = Material::from_young(1e4, 0.35, 1000.0);
    Levels::of_box(Vec3::repeat(SIDE), &[[cells[0]; 3], [cells[1]; 3]], material, true)
}

fn inputs(tick: u32) -> Inputs {
    let down = (Real::from(tick) / Real::from(DOWN)).min(1.0);
    let depth = -0.001 + (DEPTH + 0.001) * down;
    match tick {
        0 => attached(),
        GONE => detached(),
        t if t > GONE => Inputs::default(),
        _ => held_at(tick, Vec3::new(SIDE + RADIUS - depth, 0.45 * SIDE, 0.55 * SIDE)),
    }
}

/// Root mean square distance [m] of the displacements `d` at `u` [m] from the best affine function.
fn from_affine(u: &[Vec3], d: &[Vec3]) -> Real {
    let centre = u.iter().sum::<Vec3>() / u.len() as Real;
    // In units of the cube: well conditioned.
    let basis = |u: &Vec3| {
        let r = (u - centre) / SIDE;
        Vector4::new(1.0, r.x, r.y, r.z)
    };
    let (mut moments, mut sums) = (Matrix4::zeros(), Matrix4x3::zeros());
    for (u, d) in u.iter().zip(d) {
        moments += basis(u) * basis(u).transpose();
        sums += basis(u) * d.transpose();
    }
    let fit = moments.try_inverse().unwrap_or_else(Matrix4::zeros) * sums;
    let square = |(u, d): (&Vec3, &Vec3)| (fit.transpose() * basis(u) - d).norm_squared();
    (u.iter().zip(d).map(square).sum::<Real>() / u.len() as Real).sqrt()
}

/// Elastic forces [N] on the nodes of the coarse level: the core's law, without what damps.
fn elastic_forces(levels: &Levels, coarse: &Simulation) -> Vec<Vec3> {
    let at = |n: usize| coarse.mesh().position_of(Node::at(n)).unwrap_or(levels.rest[n]);
    let x: Vec<Vec3> = (0..levels.first_node[1]).map(at).collect();
    let mut force = vec![Vec3::zeros(); x.len()];
    for element in &levels.elements[..levels.first_element[1]] {
        let stress = Law::GreenWithCompression.stress(&levels.material, &element.gradient_of(&x));
        let stress = stress * element.volume;
        element.nodes.iter().zip(&element.gradient).for_each(|(n, gradient)| force[*n] -= stress * gradient);
    }
    force
}

fn see(levels: &Levels, body: &Body, coarse: &Simulation, fine: &Simulation) -> Seen {
    let forces = elastic_forces(levels, coarse);
    let mut seen = Seen { nodes: vec![], truth: vec![], gamma: vec![], jump: vec![] };
    let moved = |n: Node| fine.mesh().position_of(n).map(|x| (body.rest(n), x - body.rest(n)));
    let all: Vec<(Vec3, Vec3)> = body.nodes_of(1).filter_map(moved).collect();
    for n in body.nodes_of(0) {
        if body.is_fixed(n) {
            continue;
        }
        let near = |m: &Node| (body.rest(*m) - body.rest(n)).norm();
        let neighbours = body.elements_around(n).iter().flat_map(|e| body.element(*e)).filter(|m| *m != n);
        let spacing = neighbours.map(|m| near(&m)).fold(Real::INFINITY, Real::min);
        let (u, d): (Vec<Vec3>, Vec<Vec3>) =
            all.iter().filter(|(u, _)| (u - body.rest(n)).norm() < body.spacing_at(n)).copied().unzip();
        seen.nodes.push(n);
        seen.truth.push(from_affine(&u, &d));
        seen.gamma.push(forces[n.index()].norm() / (spacing * body.material().pressure_modulus()));
        seen.jump.push(strain_jump(body, coarse.mesh(), n).unwrap_or(Real::MAX));
    }
    seen
}

/// The cube on meshes of so many cells, coarse and fine, pressed and let go: what is seen at each of [`MOMENTS`].
///
/// # Errors
/// When the core cannot be prepared.
pub fn watch(cells: [u32; 2]) -> Result<(std::sync::Arc<Body>, Vec<Seen>)> {
    let levels = levels(cells);
    let body = body_of(&levels, ZETA, 2000)?;
    let trial = Trial::ball(RADIUS, None);
    let (mut coarse, mut fine) = (trial.on_level(&body, 0)?, trial.on_level(&body, 1)?);
    let mut all = Vec::new();
    for tick in 0..=GONE + 10 {
        coarse.advance(&inputs(tick));
        fine.advance(&inputs(tick));
        if MOMENTS.iter().any(|m| m.0 == tick) {
            all.push(see(&levels, &body, &coarse, &fine));
        }
    }
    Ok((body, all))
}

/// Place of each value in ascending order, from 0 to 1.
pub fn ranks(values: &[Real]) -> Vec<Real> {
    let mut order: Vec<usize> = (0..values.len()).collect();
    order.sort_by(|a, b| values[*a].total_cmp(&values[*b]));
    let mut ranks = vec![0.0; values.len()];
    order.into_iter().enumerate().for_each(|(place, i)| ranks[i] = place as Real / (values.len() - 1) as Real);
    ranks
}

/// Spearman's rank correlation.
pub fn rank_correlation(a: &[Real], b: &[Real]) -> Real {
    let (a, b) = (ranks(a), ranks(b));
    let product: Real = a.iter().zip(&b).map(|(a, b)| (a - 0.5) * (b - 0.5)).sum();
    product / a.iter().map(|a| (a - 0.5) * (a - 0.5)).sum::<Real>()
}

/// Of the tenth of nodes that `indicator` would refine first, the part that is of the tenth that needs it most.
pub fn found(indicator: &[Real], truth: &[Real]) -> Real {
    let first = |ranks: Vec<Real>| ranks.into_iter().map(|r| r >= 0.9).collect::<Vec<_>>();
    let (chosen, needed) = (first(ranks(indicator)), first(ranks(truth)));
    let both = chosen.iter().zip(&needed).filter(|(c, n)| **c && **n).count();
    both as Real / needed.iter().filter(|n| **n).count() as Real
}

/// The surface of the coarse level at rest, in five colours by rank.
fn map(body: &Body, seen: &Seen, values: &[Real], title: String) -> Coloured {
    let level = &body.level(0).mesh;
    let mut class = vec![0; level.nodes.len()];
    for (n, rank) in seen.nodes.iter().zip(ranks(values)) {
        class[n.index()] = [0.4, 0.6, 0.8, 0.9].iter().filter(|limit| rank >= **limit).count();
    }
    let triangles = level.boundary();
    Coloured {
        class: triangles.iter().map(|t| t.map(|n| class[n as usize]).into_iter().max().unwrap_or(0)).collect(),
        shape: Shape { title, vertices: level.nodes.clone(), triangles },
        toward: Vec3::new(0.8, -0.5, 0.4),
        around: None,
    }
}

/// The claim of eq. 9.
///
/// # Errors
/// When a picture cannot be written.
pub fn claims(out: &Path, progress: Progress) -> Result<Vec<Claim>> {
    progress("γ against strain jump under a tool");
    let (body, all) = watch([7, 14])?;
    let (mut rows, mut maps, mut panels) = (Vec::new(), Vec::new(), Vec::new());
    let mut each: [Vec<(Real, Real)>; 2] = Default::default();
    for ((tick, moment), seen) in MOMENTS.iter().zip(&all) {
        let mut row = vec![(*moment).to_owned(), format!("{:.3} s", Real::from(*tick) * TICK)];
        for (of, values) in each.iter_mut().zip([&seen.gamma, &seen.jump]) {
            let (correlation, found) = (rank_correlation(values, &seen.truth), found(values, &seen.truth));
            of.push((correlation, found));
            row.extend([format!("{correlation:.2}"), format!("{:.0} %", 100.0 * found)]);
        }
        rows.push(row);
        for (what, values) in [("needed", &seen.truth), ("γ", &seen.gamma), ("strain jump", &seen.jump)] {
            maps.push(map(&body, seen, values, format!("{what}, {moment}")));
        }
        let dots = |values: &[Real]| -> Vec<(Real, Real)> {
            let percent = |v: Vec<Real>| v.into_iter().map(|r| 100.0 * r);
            percent(ranks(&seen.truth)).zip(percent(ranks(values))).collect()
        };
        panels.push(Chart {
            title: (*moment).into(),
            x_label: "rank by what is needed [%]".into(),
            y_label: "rank by the indicator [%]".into(),
            curves: vec![
                Curve { name: "γ (eq. 9)".into(), dots: dots(&seen.gamma), ..Curve::default() },
                Curve { name: "strain jump".into(), dots: dots(&seen.jump), ..Curve::default() },
            ],
            ..Chart::default()
        });
    }
    charts(out, "indicator_ranks", "Where resolution is needed, and where the indicators say so", &panels)?;
    let legend = ["lowest 40 %", "to 60 %", "to 80 %", "to 90 %", "top 10 %"];
    coloured(out, "indicators", "Nodes of a cube pressed on one face, ranked", &maps, 3, &legend)?;
    let header =
        ["moment", "time", "γ: rank correlation", "γ: tenth found", "jump: rank correlation", "jump: tenth found"];
    let words = |of: &[(Real, Real)]| {
        let text = of.iter().zip(MOMENTS).map(|((c, f), (_, moment))| {
            format!("{moment}: correlation {c:.2}, {:.0} % of the tenth that needs it most", 100.0 * f)
        });
        text.collect::<Vec<_>>().join("; ")
    };
    // Accurate: it finds most of what needs to be refined, at each moment.
    let accurate = |of: &[(Real, Real)]| of.iter().all(|(_, found)| *found > 0.5);
    Ok(vec![Claim {
        section: "3.3, eq. 9",
        says: "γ = |f|/h is an accurate measure of where the resolution is inadequate",
        measured: format!(
            "Needed: how far the finest level's displacements around a node are from the affine. Accurate: of the tenth of \
             nodes that the indicator would refine first, more than half are of the tenth that needs it most, at each moment.\n\n\
             {}\n![rank of each node by what is needed, against its rank by γ and by the strain jump](indicator_ranks.png)\n",
            table(out, "indicators", &header, &rows)?
        ),
        picture: Some((
            "indicators",
            "where resolution is needed on the face that is pressed, and where γ and strain jump ask for it".into(),
        )),
        printed: Some(Verdict::new(accurate(&each[0]), words(&each[0]))),
        shipped: Some(Verdict::new(accurate(&each[1]), words(&each[1]))),
    }])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ranks_correlations_and_distances_come_out() {
        let (a, b) = ([3.0, 1.0, 2.0, 9.0], [30.0, 10.0, 20.0, 90.0]);
        assert_eq!(ranks(&a), vec![2.0 / 3.0, 0.0, 1.0 / 3.0, 1.0]);
        assert!((rank_correlation(&a, &b) - 1.0).abs() < 1e-12);
        assert!((rank_correlation(&a, &b.map(|b: Real| -b)) + 1.0).abs() < 1e-12);
        assert_eq!(found(&a, &b), 1.0);
        let u: Vec<Vec3> =
            (0..27).map(|i| Vec3::new((i % 3).into(), (i / 3 % 3).into(), (i / 9).into()) * 0.01).collect();
        let affine: Vec<Vec3> = u.iter().map(|u| Vec3::new(0.1 * u.y, 0.2 * u.x - 0.3 * u.z, 1.0)).collect();
        assert!(from_affine(&u, &affine) < 1e-12);
        let bent: Vec<Vec3> = u.iter().map(|u| Vec3::z() * (u.x * u.x)).collect();
        // Of x² at 0, 1, 2 cm the residuals are (1, −2, 1)/3 cm².
        assert!((from_affine(&u, &bent) / (1e-4 * (2.0 as Real).sqrt() / 3.0) - 1.0).abs() < 1e-9);
    }
}
