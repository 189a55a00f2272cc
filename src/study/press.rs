//! A flat punch pressed deep into a clamped cube, slowly, under every law: what a hand would feel, and when elements turn
//! inside out.

use super::Progress;
use super::laws::{Law, Solid};
use super::plot::{Chart, Curve, charts, table};
use super::relax::relax;
use palpate_core::geometry::primitives::box_mesh;
use palpate_core::math::{Real, Vec3};
use palpate_core::model::Material;
use rayon::prelude::*;
use std::io::Result;
use std::path::Path;

/// Edge of the cube [m], and its cells along it.
const SIDE: Real = 0.1;
const CELLS: u32 = 10;
/// Edge of the square punch in the middle of the top face [m].
const PUNCH: Real = 0.04;
/// The first depth gives the stiffness; the others follow in steps of this, so many of them [m].
const FIRST: Real = 1e-4;
const STEP: Real = 1.25e-3;
const STEPS: u32 = 40;
/// Root sum square of the forces out of balance over the force on the punch, at rest.
const RESIDUAL: Real = 3e-4;
/// Steps of relaxation at most; a law that has not come to rest by then ends its curve.
const PATIENCE: usize = 20_000;

fn cube(cells: u32) -> Solid {
    Solid::new(&box_mesh(Vec3::repeat(SIDE), [cells; 3]), Material::from_young(1e4, 0.45, 1050.0))
}

/// What the punch feels at one depth.
struct Felt {
    /// [m].
    depth: Real,
    /// Upward [N].
    force: Real,
    /// Elements with det F < 0.
    inverted: usize,
}

/// The punch goes down from depth to depth [m], its nodes stuck to it; each shape begins from the last, so that a law with
/// several answers shows the one it is pushed into.
fn press(solid: &Solid, law: Law, depths: &[Real]) -> Vec<Felt> {
    let nodes = || 0..solid.rest.len();
    let beside = |v: Real| (v - 0.5 * SIDE).abs() < 0.5 * PUNCH + 1e-9;
    let under = |u: &Vec3| u.z > SIDE - 1e-9 && beside(u.x) && beside(u.y);
    let punch: Vec<usize> = nodes().filter(|n| under(&solid.rest[*n])).collect();
    let mut mass = solid.mass.clone();
    nodes().filter(|n| solid.rest[*n].z < 1e-9).chain(punch.iter().copied()).for_each(|n| mass[n] = 0.0);
    // The compression term makes flat elements nine times as stiff as the material at rest, and more.
    let dt = 0.12 * solid.altitude / solid.material.wave_speed();
    let mut x = solid.rest.clone();
    let mut all: Vec<Felt> = Vec::new();
    for &depth in depths {
        // All displacements grow alike: a good guess, and the answer of a linear law.
        let growth = all.last().map_or(0.0, |last| depth / last.depth);
        x.iter_mut().zip(&solid.rest).for_each(|(x, u)| *x = u + (*x - u) * growth);
        punch.iter().for_each(|n| x[*n] = solid.rest[*n] - Vec3::z() * depth);
        let mut reaction = 0.0;
        let at_rest = relax(&mut x, &mass, dt, PATIENCE, |x| {
            let force = solid.force(law, x);
            reaction = punch.iter().map(|n| force[*n].z).sum();
            let square: Real = nodes().filter(|n| mass[*n] > 0.0).map(|n| force[n].norm_squared()).sum();
            (square.sqrt() > RESIDUAL * reaction.abs()).then_some(force)
        });
        if !at_rest {
            break;
        }
        let inverted = solid.elements.iter().filter(|e| e.gradient_of(&x).determinant() < 0.0).count();
        all.push(Felt { depth, force: reaction, inverted });
    }
    all
}

/// Force against depth for every law.
pub fn depth(out: &Path, progress: Progress) -> Result<String> {
    progress("a punch pressed into a cube");
    let solid = cube(CELLS);
    let depths: Vec<Real> = [FIRST].into_iter().chain((1..=STEPS).map(|i| STEP * Real::from(i))).collect();
    let felt: Vec<Vec<Felt>> = Law::ALL.into_par_iter().map(|law| press(&solid, law, &depths)).collect();
    let (mut curves, mut rows) = (Vec::new(), Vec::new());
    for (law, felt) in Law::ALL.iter().zip(&felt) {
        let at = |depth: Real| felt.iter().find(|f| (f.depth - depth).abs() < 1e-9);
        let first = felt.iter().find(|f| f.inverted > 0);
        let or_none = |text: Option<String>| text.unwrap_or_else(|| "–".into());
        let mut row = vec![law.name().into(), or_none(felt.first().map(|f| format!("{:.0}", f.force / f.depth)))];
        row.extend([0.1, 0.2, 0.3].map(|part| or_none(at(part * SIDE).map(|f| format!("{:.2}", f.force)))));
        row.push(or_none(first.map(|f| format!("{:.1}", 1e3 * f.depth))));
        row.push(or_none(felt.last().map(|f| format!("{} at {:.1} mm", f.inverted, 1e3 * f.depth))));
        rows.push(row);
        let point = |f: &Felt| (1e3 * f.depth, f.force);
        curves.push(Curve {
            name: law.name().into(),
            points: [(0.0, 0.0)].into_iter().chain(felt.iter().map(point)).collect(),
            dots: first.map(point).into_iter().collect(),
        });
    }
    let chart = Chart {
        title: "force on the punch (dots: the first element turns inside out)".into(),
        x_label: "depth [mm]".into(),
        y_label: "force [N]".into(),
        curves,
        ..Chart::default()
    };
    charts(out, "depth", "A 40 mm punch pressed into a clamped cube of 100 mm", &[chart])?;
    let header = [
        "law",
        "stiffness at first [N/m]",
        "force at 10 % [N]",
        "at 20 % [N]",
        "at 30 % [N]",
        "first inverted at [mm]",
        "inverted at the end",
    ];
    table(out, "depth-table", &header, &rows)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn laws_agree_at_first_and_only_the_linear_one_stays_straight() {
        let solid = cube(5);
        let felt = |law| press(&solid, law, &[1e-4, 0.01, 0.02]);
        let linear = felt(Law::Cauchy);
        assert!((linear[2].force / linear[1].force - 2.0).abs() < 1e-3);
        for (law, bend) in [(Law::GreenWithCompression, 0.85), (Law::StableNeoHookean, 1.03)] {
            let felt = felt(law);
            assert!((felt[0].force / linear[0].force - 1.0).abs() < 0.02, "{law:?}");
            let straight = felt[2].force / linear[2].force;
            assert!(if bend < 1.0 { straight < bend } else { straight > bend }, "{law:?}: {straight}");
            assert!(felt.iter().all(|f| f.inverted == 0), "{law:?}");
        }
    }
}
