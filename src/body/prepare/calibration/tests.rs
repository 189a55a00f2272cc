use super::block::CHUNK;
use super::system::row;
use super::*;

fn factors(
    levels: &[Level],
    material: impl Fn(usize, usize) -> Material + Sync,
    holds: &[(u32, Real)],
) -> Result<Vec<Vec<Real>>, CalibrationError> {
    calibrate(levels, material, holds).map(|c| c.factors)
}

/// Mean factor of each level, one over the mean softness.
fn means(factors: &[Vec<Real>]) -> Vec<Real> {
    factors.iter().map(|f| f.len() as Real / f.iter().map(|f| 1.0 / f).sum::<Real>()).collect()
}

/// The largest part by which two calibrations differ anywhere.
fn difference(a: &[Vec<Real>], b: &[Vec<Real>]) -> Real {
    a.iter().flatten().zip(b.iter().flatten()).map(|(a, b)| (a / b - 1.0).abs()).fold(0.0, Real::max)
}
use crate::cover::cover;
use nalgebra::{DMatrix, SMatrix};
use palpate_core::geometry::Surface;
use palpate_core::geometry::primitives::{box_mesh, box_surface};
use palpate_core::hierarchy::{embedding, parentage};

fn jelly() -> Material {
    Material::from_young(5e3, 0.45, 1050.0)
}

fn covers(surface: &Surface, spacings: &[Real]) -> Vec<Level> {
    let one = |(i, a): (usize, &Real)| {
        let mut level = cover(surface, *a, i as u32, 1050.0).unwrap();
        // As heavy as the body, and otherwise as it came.
        let factor = 1050.0 * surface.volume() / level.node_mass.iter().sum::<Real>();
        level.node_mass.iter_mut().for_each(|mass| *mass *= factor);
        level
    };
    tied(spacings.iter().enumerate().map(one).collect(), surface)
}

/// Conforming boxes with these numbers of cells, coarse to fine.
fn boxes(size: Vec3, cells: &[[u32; 3]], surface: &Surface) -> Vec<Level> {
    let one = |cells: &[u32; 3]| {
        let mesh = box_mesh(size, *cells);
        let fraction = vec![1.0; mesh.elements.len()];
        Level::new(mesh, fraction, size.x / Real::from(cells[0]), 1050.0)
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
fn dense_amplitude(level: &Level, factors: &[Real], holds: &[(u32, Real)], load: &[Real]) -> Real {
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
        let scale = factors[e] * level.fraction[e] * edges.determinant() / 6.0;
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
fn agree(name: &str, levels: &[Level], factors: &[Vec<Real>], holds: &[(u32, Real)], tolerance: Real) {
    let amplitude = |l: usize, factors: &[Real]| dense_amplitude(&levels[l], factors, holds, &handed_down(levels)[l]);
    let wanted = amplitude(levels.len() - 1, &factors[levels.len() - 1]);
    for (l, (factors, mean)) in factors.iter().zip(means(factors)).enumerate() {
        let raw = amplitude(l, &vec![1.0; factors.len()]) / wanted - 1.0;
        let calibrated = amplitude(l, factors) / wanted - 1.0;
        let nodes = levels[l].mesh.nodes.len();
        println!("{name}, {nodes} nodes: factor {mean:.4}, amplitude {raw:+.4} before, {calibrated:+.5} after");
        assert!(calibrated.abs() < tolerance, "{name}, level {l}: {calibrated}");
    }
}

#[test]
fn one_level_keeps_its_material() {
    let surface = box_surface(Vec3::repeat(0.1), [4; 3]);
    let levels = covers(&surface, &[0.03]);
    assert_eq!(factors(&levels, |_, _| jelly(), &[]), Ok(vec![vec![1.0; levels[0].mesh.elements.len()]]));
    assert_eq!(factors(&[], |_, _| jelly(), &[]), Ok(vec![]));
}

#[test]
fn covers_of_a_clamped_cube_move_as_far_as_the_finest() {
    let surface = box_surface(Vec3::repeat(0.1), [12; 3]);
    let levels = covers(&surface, &[0.05, 0.035, 0.022]);
    let holds = clamp(&surface, 10.0 * 5e3 / 0.022);
    let factors = factors(&levels, |_, _| jelly(), &holds).unwrap();
    let means = means(&factors);
    assert!(means.is_sorted() && means[0] > 0.8 && means[0] < 0.95, "{means:?}");
    // The dense solution counts what the body sinks into its springs, too, which no factor moves.
    agree("cube", &levels, &factors, &holds, 2e-3);
}

#[test]
fn conforming_boxes_with_fixed_nodes_move_as_far_as_the_finest() {
    let size = Vec3::new(0.2, 0.05, 0.05);
    let surface = box_surface(size, [8, 2, 2]);
    let mut levels = boxes(size, &[[4, 1, 1], [8, 2, 2], [16, 4, 4]], &surface);
    for level in &mut levels {
        level.fixed = (0..level.mesh.nodes.len() as u32).filter(|n| level.mesh.nodes[*n as usize].x == 0.0).collect();
    }
    let factors = factors(&levels, |_, _| jelly(), &[]).unwrap();
    agree("bar", &levels, &factors, &[], 1e-3);
}

#[test]
fn a_soft_bed_does_not_hide_the_stiffness_of_elements() {
    let surface = box_surface(Vec3::repeat(0.1), [10; 3]);
    let levels = covers(&surface, &[0.035, 0.02]);
    let factor = |per_area: Real| means(&factors(&levels, |_, _| jelly(), &clamp(&surface, per_area)).unwrap())[0];
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
    let means = means(&free);
    println!("free beam {means:?}");
    assert!(means.iter().all(|mean| (mean - 1.0).abs() < 0.05), "{means:?}");
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
        let difference = difference(&before, &after);
        println!("{:?} {:?}, {difference:.1e} anywhere", means(&before), means(&after));
        let mean = means(&after)[0] / means(&before)[0] - 1.0;
        // What conjugate gradients leave, which rounding leads another way.
        assert!(mean.abs() < 1e-5 && difference < 2e-4, "{mean} in the mean, {difference} anywhere");
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
        let factors = pool.install(|| factors(&levels, |_, _| jelly(), &holds).unwrap());
        factors.into_iter().flatten().map(Real::to_bits).collect::<Vec<_>>()
    };
    assert_eq!(bits(1), bits(2));
    assert_eq!(bits(1), bits(5));
}

#[test]
fn a_finest_level_of_another_material_is_matched_or_the_end_of_the_range_returned() {
    let surface = box_surface(Vec3::repeat(0.1), [10; 3]);
    let levels = covers(&surface, &[0.03, 0.02]);
    let factor = |scale: Real| {
        let material = |l: usize, _: usize| Material::from_young(if l == 0 { scale * 5e3 } else { 5e3 }, 0.45, 1050.0);
        factors(&levels, material, &clamp(&surface, 1e6)).unwrap()[0][0]
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
    let ones: Vec<_> = levels.iter().map(|level| vec![1.0; level.mesh.elements.len()]).collect();
    assert_eq!(factors(&levels, |_, _| jelly(), &[]), Ok(ones));
}

#[test]
fn a_slender_coarsest_level_is_solved_directly() {
    let rod = box_surface(Vec3::new(0.004, 0.004, 0.3), [1, 1, 60]);
    let mut levels = covers(&rod, &[0.0035]);
    let holds = clamp(&rod, 1e6);
    // Nothing fixed, and a part in the middle, which cuts the rod in two.
    let middle: Vec<u32> =
        (0..).zip(&levels[0].mesh.nodes).filter(|(_, u)| (0.14..0.16).contains(&u.z)).map(|(n, _)| n).collect();
    assert!(middle.len() > 10);
    for fixed in [vec![], middle] {
        levels[0].fixed = fixed.clone();
        let system = System::new(&levels, 0, &|_, _| jelly(), 1.0, Some(&holds));
        let load = load::weight(&levels[0]);
        let u = system.direct.as_ref().unwrap().correction(&load);
        let (mut left, mut whole) = (0.0, 0.0);
        for n in 0..u.len() {
            if fixed.contains(&(n as u32)) {
                assert_eq!(u[n], ZERO);
                continue;
            }
            let mut unbalanced = load[n];
            add_scaled(&mut unbalanced, -1.0, &system.force(n, &u));
            left += product(&unbalanced, &unbalanced);
            whole += product(&load[n], &load[n]);
        }
        assert!((left / whole).sqrt() < 1e-2, "{} with {} fixed nodes", (left / whole).sqrt(), fixed.len());
    }
    let cube = box_surface(Vec3::repeat(0.1), [4; 3]);
    let (compact, holds) = (covers(&cube, &[0.014]), clamp(&cube, 1e6));
    assert!(compact[0].mesh.nodes.len() > 700);
    assert!(System::new(&compact, 0, &|_, _| jelly(), 1.0, Some(&holds)).direct.is_none());
}

#[test]
fn a_slender_body_that_nothing_holds_is_calibrated() {
    let rod = box_surface(Vec3::new(0.004, 0.004, 0.35), [1, 1, 60]);
    let levels = covers(&rod, &[0.0036, 0.002]);
    let factors = factors(&levels, |_, _| jelly(), &[]).unwrap();
    assert!((LEAST_FACTOR..1.0).contains(&means(&factors)[0]), "{:?}", means(&factors));
}

#[test]
fn a_plate_thinner_than_its_elements_is_calibrated_in_a_few_answers() {
    let plate = box_surface(Vec3::new(0.06, 0.06, 0.0004), [20, 20, 1]);
    let levels = covers(&plate, &[0.003, 0.0014, 0.001]);
    let factors = factors(&levels, |_, _| jelly(), &clamp(&plate, 1e6)).unwrap();
    // Softer by as much everywhere: to find where more and where less takes twenty answers.
    let first = factors[1][0];
    assert!(first > LEAST_FACTOR && first < LARGEST_FACTOR && factors[1].iter().all(|f| *f == first), "{first}");
}
