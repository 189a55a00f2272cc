//! Levels that answer alike: one stiffness factor per level.
//!
//! Linear tetrahedra are too stiff, the more so the larger they are: a coarse level sags less under the same weight than
//! a fine one, and swings faster. A factor on λ and μ of each level takes that out: it is chosen so that the level moves
//! under a smooth load as far as the finest level does, which keeps its material as it is.
//!
//! The load is the body's weight along each of the three axes, as the finest level bears it, handed down to the coarser
//! ones. What must agree is the root mean square of the displacement, over the mass and all axes. That stands between
//! the work of the load, which makes amplitudes agree but leaves coarse levels swinging too slowly (their mass reaches
//! beyond the body), and the first frequency, which leaves them sagging too little; it takes no mode to be found. Only
//! what deforms the body counts: sinking and tipping as a whole on soft springs tells nothing about its elements. A body
//! that nothing holds is loaded without resultant instead, its middle against its ends.
//!
//! Each answer is a linear elastic solution at rest, by conjugate gradients. The three axes are solved as one system, a
//! node's unknown being a 3×3 block with a column per axis: that reads the matrix once for three. All of it is
//! `+ − × ÷ √` in a fixed order, whatever the number of threads: each row of the matrix gathers its own sum, and sums
//! over nodes run in chunks of fixed length.

mod block;
mod grid;
mod load;
mod rigid;
mod solver;
mod system;

use crate::hierarchy::Level;
use crate::math::{Mat3, Real, Vec3};
use crate::model::material::Material;
use block::{Block, ZERO, add_scaled, columns, product};
use load::{balanced_load, weight};
use rigid::{holds_firmly, mean_motion};
use solver::solve;
use system::System;

/// Smallest factor ever returned: with a smaller one the level's own shape and holds are wrong, not its stiffness.
pub const LEAST_FACTOR: Real = 0.2;
/// Largest factor ever returned: a level that is far softer than the finest does not cover the same body, and stiffening
/// it shortens its step.
pub const LARGEST_FACTOR: Real = 1.5;

/// Why levels could not be calibrated.
#[derive(Debug, PartialEq, thiserror::Error)]
pub enum CalibrationError {
    /// The elastic solution was not found: an element is degenerate, or stiffness differs too much from place to place.
    #[error(
        "level {level} does not come to rest under its weight ({:.1e} of it unbalanced after {iterations} iterations): \
         look for flat or inverted elements in it",
        residual
    )]
    NotConverged {
        /// Level, coarsest first.
        level: usize,
        /// Unbalanced force over the load, both as root of the sum of squares.
        residual: Real,
        /// Iterations done.
        iterations: usize,
    },
}

/// What the answers to a smooth load tell.
#[derive(Clone, Debug, PartialEq)]
pub struct Calibration {
    /// Factors on λ and μ (n_levels) that make all levels answer as the finest does; the last one is 1.
    pub factors: Vec<Real>,
    /// Angular frequency ω₁ of the slowest mode [rad/s], without the body's sinking on its holds: Rayleigh and Ritz's
    /// estimate from the three answers, a few per cent too high at most. 0 when nothing moves.
    pub slowest_mode: Real,
}

/// Makes all levels answer to a smooth load as the finest does.
///
/// `material` of an element, by level and element. `holds`: display vertices held by springs [N/m], which act through
/// the rows of `embedding` and are not scaled. The levels must be tied, embedded and have their fixed nodes. Accurate to
/// 1e-3; [`LEAST_FACTOR`] or [`LARGEST_FACTOR`] means that no factor makes that level agree.
///
/// # Errors
/// When a level has no elastic solution.
pub fn calibrate(
    levels: &[Level],
    material: impl Fn(usize, usize) -> Material + Sync,
    holds: &[(u32, Real)],
) -> Result<Calibration, CalibrationError> {
    let mut factors = vec![1.0; levels.len()];
    if levels.is_empty() {
        return Ok(Calibration { factors, slowest_mode: 0.0 });
    }
    // All levels bear the same load, or their answers could not be compared.
    let held = levels.iter().all(|level| holds_firmly(level, holds));
    let mut systems: Vec<System> =
        (0..levels.len()).map(|l| System::new(levels, l, &material, held.then_some(holds))).collect();
    let mut load = Vec::new();
    for l in (0..levels.len()).rev() {
        load = match systems.get(l + 1) {
            Some(finer) if finer.is_tied() => finer.to_coarser(&load),
            _ if held => weight(&levels[l]),
            _ => balanced_load(&levels[l]),
        };
        // What fixed nodes bear does not reach the body.
        load.iter_mut().enumerate().filter(|(n, _)| systems[l].is_fixed(*n)).for_each(|(_, load)| *load = ZERO);
        systems[l].bear(&load);
    }

    let mut answers: Vec<Answer> = Vec::new();
    for (l, level) in levels.iter().enumerate() {
        let mut guess = vec![ZERO; level.mesh.nodes.len()];
        if let Some(coarser) = answers.last() {
            systems[l].add_from_coarser(&coarser.displacement, &mut guess);
        }
        answers.push(answer(&systems, l, 1.0, guess)?);
    }
    let finest = answers.pop();
    let wanted = finest.as_ref().map_or(0.0, |finest| finest.amplitude);
    let slowest_mode = finest.map_or(0.0, |finest| slowest_mode(&systems[levels.len() - 1], &finest.deforming));
    for (l, first) in answers.into_iter().enumerate() {
        factors[l] = matching_factor(first, wanted, |factor, guess| answer(&systems, l, factor, guess))?;
    }
    Ok(Calibration { factors, slowest_mode })
}

/// The slowest mode [rad/s] among the combinations of the answers `u` to the loads along the three axes: the largest
/// eigenvalue of `K⁻¹M`, `K_ij = u_i·f_j`, `M_ij = Σ m u_i·u_j`.
fn slowest_mode(system: &System, deforming: &[Block]) -> Real {
    let (mut k, mut m) = (Mat3::zeros(), Mat3::zeros());
    for ((u, f), mass) in deforming.iter().zip(&system.load).zip(&system.level.node_mass) {
        // Rows are components, columns axes.
        let (u, f) = (columns(u).transpose(), columns(f).transpose());
        // What deforms the body is kept with its sign turned.
        k -= u.transpose() * f;
        m += u.transpose() * u * *mass;
    }
    let Some(inverse) = k.try_inverse() else { return 0.0 };
    let mut shape = Vec3::new(1.0, 0.8, 0.6);
    let mut largest = 0.0;
    for _ in 0..200 {
        let next = inverse * (m * shape);
        largest = next.norm();
        #[expect(clippy::neg_cmp_op_on_partial_ord, reason = "NaN, too, must leave here")]
        if !(largest > 0.0) {
            return 0.0;
        }
        shape = next / largest;
    }
    1.0 / largest.sqrt()
}

/// The factor at which a level has the amplitude `wanted`; `answer` is its answer at factor 1.
///
/// Secants in the softness `1/factor`: the amplitude is almost proportional to it, but for what the holds give way.
fn matching_factor(
    mut answer: Answer,
    wanted: Real,
    solve: impl Fn(Real, Vec<Block>) -> Result<Answer, CalibrationError>,
) -> Result<Real, CalibrationError> {
    let (mut factor, mut softness) = (1.0, 1.0);
    // Rigid elements do not deform.
    let mut before = (0.0, 0.0);
    for _ in 0..8 {
        let slope = (answer.amplitude - before.1) / (softness - before.0);
        // Nothing moves when every node is fixed; then any factor will do.
        if !(slope > 0.0 && slope.is_finite()) {
            break;
        }
        before = (softness, answer.amplitude);
        softness = (softness + (wanted - answer.amplitude) / slope).clamp(1.0 / LARGEST_FACTOR, 1.0 / LEAST_FACTOR);
        let change = (softness / before.0 - 1.0).abs();
        factor = 1.0 / softness;
        // The last secant corrects far more than what it leaves.
        if change < 1e-3 {
            break;
        }
        answer = solve(factor, answer.displacement)?;
    }
    Ok(factor.clamp(LEAST_FACTOR, LARGEST_FACTOR))
}

/// How a level answers to its load.
struct Answer {
    /// Displacement, per axis [m] (n_nodes).
    displacement: Vec<Block>,
    /// What of it deforms the body, its sign turned [m] (n_nodes).
    deforming: Vec<Block>,
    /// Root of the sum over the mass of its square, all axes together [m √kg].
    amplitude: Real,
}

/// The answer of level `l` at `factor`, from the displacements `guess`.
fn answer(systems: &[System], l: usize, factor: Real, guess: Vec<Block>) -> Result<Answer, CalibrationError> {
    let system = &systems[l];
    let displacement = solve(systems, l, factor, guess)?;
    // Where little or nothing holds the body, it may have drifted; what deforms it leaves the holds in balance.
    let drift = match system.holds {
        Some(_) => {
            let forces: Vec<Block> = (0..displacement.len()).map(|n| system.force_of_holds(n, &displacement)).collect();
            system.rigid_motion(&forces)
        }
        None => mean_motion(system.level, &displacement),
    };
    let mut deforming = system.in_place(&drift);
    let mut squares = 0.0;
    for ((drift, u), m) in deforming.iter_mut().zip(&displacement).zip(&system.level.node_mass) {
        add_scaled(drift, -1.0, u);
        squares += m * product(drift, drift);
    }
    Ok(Answer { displacement, deforming, amplitude: squares.sqrt() })
}

#[cfg(test)]
mod tests {
    use super::block::CHUNK;
    use super::system::row;
    use super::*;

    fn factors(
        levels: &[Level],
        material: impl Fn(usize, usize) -> Material + Sync,
        holds: &[(u32, Real)],
    ) -> Result<Vec<Real>, CalibrationError> {
        calibrate(levels, material, holds).map(|c| c.factors)
    }
    use crate::geometry::Surface;
    use crate::geometry::primitives::{box_mesh, box_surface};
    use crate::hierarchy::cover::cover;
    use crate::hierarchy::{embedding, parentage};
    use nalgebra::{DMatrix, SMatrix};

    fn jelly() -> Material {
        Material::from_young(5e3, 0.45, 1050.0)
    }

    fn covers(surface: &Surface, spacings: &[Real]) -> Vec<Level> {
        let one = |(i, a): (usize, &Real)| cover(surface, *a, i as u32, 1050.0).unwrap();
        tied(spacings.iter().enumerate().map(one).collect(), surface)
    }

    /// Conforming boxes with these numbers of cells, coarse to fine.
    fn boxes(size: Vec3, cells: &[[u32; 3]], surface: &Surface) -> Vec<Level> {
        let one = |cells: &[u32; 3]| {
            let mesh = box_mesh(size, *cells);
            let fraction = vec![1.0; mesh.elements.len()];
            Level::new(mesh, fraction, size.x / Real::from(cells[0]), 1050.0, None)
        };
        tied(cells.iter().map(one).collect(), surface)
    }

    fn tied(mut levels: Vec<Level>, surface: &Surface) -> Vec<Level> {
        parentage::tie(&mut levels);
        embedding::embed(&mut levels, &surface.vertices);
        levels
    }

    /// Area springs of `per_area` [N/m³] on the face x = 0.
    fn clamp(surface: &Surface, per_area: Real) -> Vec<(u32, Real)> {
        let areas = surface.vertex_areas();
        let held = (0..areas.len()).filter(|v| surface.vertices[*v].x < 1e-9);
        held.map(|v| (v as u32, per_area * areas[v])).collect()
    }

    /// Root mean square displacement [m] of a level under `load` (n_nodes), by dense elimination over the free nodes.
    fn dense_amplitude(level: &Level, factor: Real, holds: &[(u32, Real)], load: &[Real]) -> Real {
        let free: Vec<usize> = (0..level.mesh.nodes.len()).filter(|n| !level.fixed.contains(&(*n as u32))).collect();
        let mut place = vec![usize::MAX; level.mesh.nodes.len()];
        free.iter().enumerate().for_each(|(i, n)| place[*n] = i);
        let mut k = DMatrix::<Real>::zeros(3 * free.len(), 3 * free.len());
        let Material { lambda, mu, .. } = jelly();
        // Energy density ½ λ tr(ε)² + μ ε:ε, differentiated through the six components of the strain.
        let law = SMatrix::<Real, 6, 6>::from_fn(|i, j| match (i, j) {
            (0..3, 0..3) => lambda + if i == j { 2.0 * mu } else { 0.0 },
            _ => {
                if i == j {
                    mu
                } else {
                    0.0
                }
            }
        });
        for (e, nodes) in level.mesh.elements.iter().enumerate() {
            let u = level.mesh.corners(e);
            let edges = Mat3::from_columns(&[u[1] - u[0], u[2] - u[0], u[3] - u[0]]);
            let inverse = edges.try_inverse().unwrap();
            let mut g = [Vec3::zeros(); 4];
            for i in 0..3 {
                g[i + 1] = inverse.row(i).transpose();
                g[0] -= g[i + 1];
            }
            let strain = |g: Vec3| {
                #[rustfmt::skip]
                let b = SMatrix::<Real, 6, 3>::new(
                    g.x, 0.0, 0.0,  0.0, g.y, 0.0,  0.0, 0.0, g.z,
                    g.y, g.x, 0.0,  0.0, g.z, g.y,  g.z, 0.0, g.x,
                );
                b
            };
            let scale = factor * level.fraction[e] * edges.determinant() / 6.0;
            for (a, ga) in nodes.iter().zip(g) {
                for (b, gb) in nodes.iter().zip(g) {
                    let (a, b) = (place[*a as usize], place[*b as usize]);
                    if a != usize::MAX && b != usize::MAX {
                        let mut view = k.fixed_view_mut::<3, 3>(3 * a, 3 * b);
                        view += strain(ga).transpose() * law * strain(gb) * scale;
                    }
                }
            }
        }
        for &(vertex, stiffness) in holds {
            let (nodes, weights) = row(&level.embedding[vertex as usize], &level.mesh);
            for (a, wa) in nodes.iter().zip(weights) {
                for (b, wb) in nodes.iter().zip(weights) {
                    for i in 0..3 {
                        k[(3 * place[*a as usize] + i, 3 * place[*b as usize] + i)] += stiffness * wa * wb;
                    }
                }
            }
        }
        let f = DMatrix::from_fn(3 * free.len(), 3, |i, j| if i % 3 == j { load[free[i / 3]] } else { 0.0 });
        let u = k.cholesky().unwrap().solve(&f);
        let squares = (0..3 * free.len()).map(|i| level.node_mass[free[i / 3]] * u.row(i).norm_squared());
        (squares.sum::<Real>() / level.node_mass.iter().sum::<Real>()).sqrt()
    }

    /// The finest level's weight, handed down.
    fn handed_down(levels: &[Level]) -> Vec<Vec<Real>> {
        let mut loads = vec![levels.last().unwrap().node_mass.clone()];
        for l in (1..levels.len()).rev() {
            let mut load = vec![0.0; levels[l - 1].mesh.nodes.len()];
            for (n, (host, f)) in levels[l].coarser_host.iter().zip(&loads[0]).enumerate() {
                let (nodes, weights) = row(host, &levels[l - 1].mesh);
                if !levels[l].fixed.contains(&(n as u32)) {
                    nodes.iter().zip(weights).for_each(|(c, w)| load[*c as usize] += w * f);
                }
            }
            loads.insert(0, load);
        }
        loads
    }

    /// All levels move as far as the finest, by the dense solution.
    fn agree(name: &str, levels: &[Level], factors: &[Real], holds: &[(u32, Real)], tolerance: Real) {
        let amplitude = |l: usize, factor| dense_amplitude(&levels[l], factor, holds, &handed_down(levels)[l]);
        let wanted = amplitude(levels.len() - 1, 1.0);
        for (l, factor) in factors.iter().enumerate() {
            let (raw, calibrated) = (amplitude(l, 1.0) / wanted - 1.0, amplitude(l, *factor) / wanted - 1.0);
            let nodes = levels[l].mesh.nodes.len();
            println!("{name}, {nodes} nodes: factor {factor:.4}, amplitude {raw:+.4} before, {calibrated:+.5} after");
            assert!(calibrated.abs() < tolerance, "{name}, level {l}: {calibrated}");
        }
    }

    #[test]
    fn one_level_keeps_its_material() {
        let surface = box_surface(Vec3::repeat(0.1), [4; 3]);
        let levels = covers(&surface, &[0.03]);
        assert_eq!(factors(&levels, |_, _| jelly(), &[]), Ok(vec![1.0]));
        assert_eq!(factors(&[], |_, _| jelly(), &[]), Ok(vec![]));
    }

    #[test]
    fn covers_of_a_clamped_cube_move_as_far_as_the_finest() {
        let surface = box_surface(Vec3::repeat(0.1), [12; 3]);
        let levels = covers(&surface, &[0.05, 0.035, 0.022]);
        let holds = clamp(&surface, 10.0 * 5e3 / 0.022);
        let factors = factors(&levels, |_, _| jelly(), &holds).unwrap();
        assert!(factors.is_sorted() && factors[0] > 0.8 && factors[0] < 0.95, "{factors:?}");
        // The dense solution counts what the body sinks into its springs, too, which no factor moves.
        agree("cube", &levels, &factors, &holds, 2e-3);
    }

    #[test]
    fn conforming_boxes_with_fixed_nodes_move_as_far_as_the_finest() {
        let size = Vec3::new(0.2, 0.05, 0.05);
        let surface = box_surface(size, [8, 2, 2]);
        let mut levels = boxes(size, &[[4, 1, 1], [8, 2, 2], [16, 4, 4]], &surface);
        for level in &mut levels {
            level.fixed =
                (0..level.mesh.nodes.len() as u32).filter(|n| level.mesh.nodes[*n as usize].x == 0.0).collect();
        }
        let factors = factors(&levels, |_, _| jelly(), &[]).unwrap();
        agree("bar", &levels, &factors, &[], 1e-3);
    }

    #[test]
    fn a_soft_bed_does_not_hide_the_stiffness_of_elements() {
        let surface = box_surface(Vec3::repeat(0.1), [10; 3]);
        let levels = covers(&surface, &[0.035, 0.02]);
        let factor = |per_area: Real| factors(&levels, |_, _| jelly(), &clamp(&surface, per_area)).unwrap()[0];
        // Springs ten thousand times softer: the body sinks a hundred times more than it deforms.
        let (firm, soft) = (factor(10.0 * 5e3 / 0.02), factor(1e-3 * 5e3 / 0.02));
        println!("factor on firm springs {firm:.4}, on soft ones {soft:.4}");
        assert!((soft / firm - 1.0).abs() < 0.1);
        assert!((factor(1e-5 * 5e3 / 0.02) / soft - 1.0).abs() < 1e-3);
        // Down to springs of the size of rounding errors.
        for per_area in [1.0, 1e-3, 1e-6, 1e-9] {
            assert!((factor(per_area) / soft - 1.0).abs() < 2e-3, "{per_area}: {}", factor(per_area));
        }
    }

    #[test]
    fn a_free_body_and_one_on_a_hinge_have_factors_too() {
        let surface = box_surface(Vec3::new(0.3, 0.06, 0.06), [20, 4, 4]);
        let levels = covers(&surface, &[0.03, 0.02, 0.014]);
        let free = factors(&levels, |_, _| jelly(), &[]).unwrap();
        println!("free beam {free:?}");
        assert!(free[0] > 0.9 && free[0] < free[1] && free[1] < 1.02, "{free:?}");
        let point = factors(&levels, |_, _| jelly(), &[(0, 1e3)]).unwrap();
        let hinge: Vec<_> = (0..3).map(|v| (v, 1e3)).collect();
        assert_eq!(surface.vertices[..3].iter().map(|u| (u.x, u.z)).collect::<Vec<_>>(), vec![(0.0, 0.0); 3]);
        assert_eq!(point, free);
        assert_eq!(factors(&levels, |_, _| jelly(), &hinge).unwrap(), free);
    }

    #[test]
    fn turning_the_body_or_changing_its_units_does_not_change_the_factors() {
        let surface = box_surface(Vec3::new(0.1, 0.05, 0.05), [8, 4, 4]);
        let mut levels = covers(&surface, &[0.03, 0.015]);
        let holds = clamp(&surface, 1e6);
        for holds in [&holds[..], &[]] {
            let before = factors(&levels, |_, _| jelly(), holds).unwrap();
            let turn = nalgebra::Rotation3::from_euler_angles(0.3, -0.8, 1.9);
            for u in levels.iter_mut().flat_map(|level| &mut level.mesh.nodes) {
                *u = turn * *u + Vec3::new(0.3, -2.0, 5.0);
            }
            let after = factors(&levels, |_, _| jelly(), holds).unwrap();
            println!("{before:?} {after:?}");
            assert!((after[0] / before[0] - 1.0).abs() < 1e-5, "{before:?} {after:?}");
        }
        // Stiffer elements on stiffer springs are the same body under less weight; powers of two round nothing.
        let stiff = Material { lambda: 1024.0 * jelly().lambda, mu: 1024.0 * jelly().mu, ..jelly() };
        let stiffer: Vec<_> = holds.iter().map(|(v, k)| (*v, 1024.0 * k)).collect();
        let before = factors(&levels, |_, _| jelly(), &holds).unwrap();
        assert_eq!(factors(&levels, |_, _| stiff, &stiffer).unwrap(), before);
    }

    #[test]
    fn the_factors_do_not_depend_on_the_number_of_threads() {
        let surface = box_surface(Vec3::repeat(0.1), [10; 3]);
        let levels = covers(&surface, &[0.025, 0.009]);
        assert!(levels[1].mesh.nodes.len() > 3 * CHUNK);
        let holds = clamp(&surface, 1e6);
        let bits = |threads| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| factors(&levels, |_, _| jelly(), &holds).unwrap()[0].to_bits())
        };
        assert_eq!(bits(1), bits(2));
        assert_eq!(bits(1), bits(5));
    }

    #[test]
    fn a_finest_level_of_another_material_is_matched_or_the_end_of_the_range_returned() {
        let surface = box_surface(Vec3::repeat(0.1), [10; 3]);
        let levels = covers(&surface, &[0.03, 0.02]);
        let factor = |scale: Real| {
            let material =
                |l: usize, _: usize| Material::from_young(if l == 0 { scale * 5e3 } else { 5e3 }, 0.45, 1050.0);
            factors(&levels, material, &clamp(&surface, 1e6)).unwrap()[0]
        };
        let usual = factor(1.0);
        assert!((factor(2.0) * 2.0 / usual - 1.0).abs() < 1e-3);
        assert_eq!(factor(10.0), LEAST_FACTOR);
        assert_eq!(factor(0.1), LARGEST_FACTOR);
    }

    #[test]
    fn every_node_fixed_or_a_broken_material_is_no_panic() {
        let size = Vec3::repeat(0.1);
        let surface = box_surface(size, [2; 3]);
        let mut levels = boxes(size, &[[1; 3], [2; 3]], &surface);
        let broken = Material { lambda: Real::NAN, ..jelly() };
        assert!(matches!(factors(&levels, |_, _| broken, &[]), Err(CalibrationError::NotConverged { level: 0, .. })));
        for level in &mut levels {
            level.fixed = (0..level.mesh.nodes.len() as u32).collect();
        }
        assert_eq!(factors(&levels, |_, _| jelly(), &[]), Ok(vec![1.0, 1.0]));
    }
}
