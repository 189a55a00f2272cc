use super::block::CHUNK;
use super::system::row;
use super::*;
use crate::cover::cover;
use nalgebra::{DMatrix, SMatrix};
use palpate_core::geometry::Surface;
use palpate_core::geometry::primitives::{box_mesh, box_surface};
use palpate_core::hierarchy::{embedding, parentage};
use std::collections::BTreeMap;

fn alphas(
    levels: &[Level],
    material: impl Fn(usize, usize) -> Material + Sync,
    holds: &[(u32, Real)],
) -> Result<Vec<Real>, CalibrationError> {
    calibrate(levels, material, holds).map(|c| c.stabilisation)
}

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
    levels.iter_mut().for_each(|level| level.stabilisation = FINEST);
    levels
}

/// Area springs of `per_area` [N/m³] on the face x = 0.
fn clamp(surface: &Surface, per_area: Real) -> Vec<(u32, Real)> {
    let areas = surface.vertex_areas();
    let held = (0..areas.len()).filter(|v| surface.vertices[*v].x < 1e-9);
    held.map(|v| (v as u32, per_area * areas[v])).collect()
}

/// Root mean square displacement [m] of a level of stabilisation `alpha` under `load` (n_nodes), by dense elimination over the free
/// nodes.
fn dense_amplitude(level: &Level, alpha: Real, holds: &[(u32, Real)], load: &[Real]) -> Real {
    let n_nodes = level.mesh.nodes.len();
    let free: Vec<usize> = (0..n_nodes).filter(|n| !level.fixed.contains(&(*n as u32))).collect();
    let mut place = vec![usize::MAX; n_nodes];
    free.iter().enumerate().for_each(|(i, n)| place[*n] = i);
    let mut k = DMatrix::<Real>::zeros(3 * free.len(), 3 * free.len());
    // Energy density ½ λ tr(ε)² + μ ε:ε of what has these gradients, differentiated through the six components of the strain.
    let mut add = |gradients: &[(usize, Vec3)], lambda: Real, mu: Real, volume: Real| {
        let law = SMatrix::<Real, 6, 6>::from_fn(|i, j| match (i, j) {
            (0..3, 0..3) => lambda + if i == j { 2.0 * mu } else { 0.0 },
            _ if i == j => mu,
            _ => 0.0,
        });
        let strain = |g: Vec3| {
            #[rustfmt::skip]
            let b = SMatrix::<Real, 6, 3>::new(
                g.x, 0.0, 0.0,  0.0, g.y, 0.0,  0.0, 0.0, g.z,
                g.y, g.x, 0.0,  0.0, g.z, g.y,  g.z, 0.0, g.x,
            );
            b
        };
        for (a, ga) in gradients {
            for (b, gb) in gradients {
                let (a, b) = (place[*a], place[*b]);
                if a != usize::MAX && b != usize::MAX {
                    let mut view = k.fixed_view_mut::<3, 3>(3 * a, 3 * b);
                    view += strain(*ga).transpose() * law * strain(*gb) * volume;
                }
            }
        }
    };
    let Material { lambda, mu, .. } = jelly();
    // Of each node: sums over the elements around it of a quarter of their volume, alone and times their gradients.
    let mut stars = vec![(0.0, BTreeMap::<usize, Vec3>::new()); n_nodes];
    for (e, nodes) in level.mesh.elements.iter().enumerate() {
        let u = level.mesh.corners(e);
        let edges = Mat3::from_columns(&[u[1] - u[0], u[2] - u[0], u[3] - u[0]]);
        let inverse = edges.try_inverse().unwrap();
        let mut g = [Vec3::zeros(); 4];
        for i in 0..3 {
            g[i + 1] = inverse.row(i).transpose();
            g[0] -= g[i + 1];
        }
        let volume = level.fraction[e] * edges.determinant() / 6.0;
        let gradients: Vec<(usize, Vec3)> = nodes.iter().map(|n| *n as usize).zip(g).collect();
        // Strain jumps hold no pressure.
        add(&gradients, if alpha < 1.0 { 0.0 } else { lambda }, alpha * mu, volume);
        for (n, _) in &gradients {
            stars[*n].0 += volume / 4.0;
            gradients.iter().for_each(|(m, g)| *stars[*n].1.entry(*m).or_default() += g * volume / 4.0);
        }
    }
    for (volume, sums) in stars.iter().filter(|_| alpha < 1.0) {
        let means: Vec<(usize, Vec3)> = sums.iter().map(|(n, sum)| (*n, sum / *volume)).collect();
        add(&means, lambda, (1.0 - alpha) * mu, *volume);
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
fn agree(name: &str, levels: &[Level], alphas: &[Real], holds: &[(u32, Real)], tolerance: Real) {
    let amplitude = |l: usize, alpha: Real| dense_amplitude(&levels[l], alpha, holds, &handed_down(levels)[l]);
    let last = levels.len() - 1;
    assert_eq!(alphas[last], FINEST);
    let wanted = amplitude(last, FINEST);
    for (l, alpha) in alphas.iter().enumerate() {
        let [tetrahedra, same, calibrated] = [1.0, FINEST, *alpha].map(|alpha| amplitude(l, alpha) / wanted - 1.0);
        let nodes = levels[l].mesh.nodes.len();
        println!(
            "{name}, {nodes} nodes: α {alpha:.4}, amplitude {calibrated:+.5}; with the finest's {same:+.4}, of tetrahedra alone \
             {tetrahedra:+.4}"
        );
        assert!(calibrated.abs() < tolerance, "{name}, level {l}: {calibrated}");
        assert!((LEAST..LARGEST).contains(alpha) && tetrahedra < calibrated - 10.0 * tolerance, "{name}, level {l}");
    }
}

#[test]
fn one_level_keeps_its_stabilisation_and_tetrahedra_alone_keep_theirs() {
    let surface = box_surface(Vec3::repeat(0.1), [4; 3]);
    assert_eq!(alphas(&covers(&surface, &[0.03]), |_, _| jelly(), &[]), Ok(vec![FINEST]));
    assert_eq!(alphas(&[], |_, _| jelly(), &[]), Ok(vec![]));
    let mut plain = covers(&surface, &[0.04, 0.03]);
    plain.iter_mut().for_each(|level| level.stabilisation = 1.0);
    let found = calibrate(&plain, |_, _| jelly(), &clamp(&surface, 1e6)).unwrap();
    assert!(found.stabilisation == [1.0; 2] && found.slowest_mode > 0.0, "{found:?}");
}

#[test]
fn covers_of_a_clamped_cube_move_as_far_as_the_finest() {
    let surface = box_surface(Vec3::repeat(0.1), [12; 3]);
    let levels = covers(&surface, &[0.05, 0.035, 0.022]);
    let holds = clamp(&surface, 10.0 * 5e3 / 0.022);
    // The dense solution counts what the body sinks into its springs, too, which no α moves.
    agree("cube", &levels, &alphas(&levels, |_, _| jelly(), &holds).unwrap(), &holds, 2e-3);
}

#[test]
fn conforming_boxes_with_fixed_nodes_move_as_far_as_the_finest() {
    let size = Vec3::new(0.1, 0.1, 0.1);
    let surface = box_surface(size, [2; 3]);
    let mut levels = boxes(size, &[[5; 3], [6; 3], [8; 3]], &surface);
    for level in &mut levels {
        level.fixed = (0..level.mesh.nodes.len() as u32).filter(|n| level.mesh.nodes[*n as usize].x == 0.0).collect();
    }
    agree("block", &levels, &alphas(&levels, |_, _| jelly(), &[]).unwrap(), &[], 1e-3);
}

#[test]
fn a_soft_bed_does_not_hide_the_stiffness_of_elements() {
    let surface = box_surface(Vec3::repeat(0.1), [10; 3]);
    let levels = covers(&surface, &[0.035, 0.02]);
    let alpha = |per_area: Real| alphas(&levels, |_, _| jelly(), &clamp(&surface, per_area)).unwrap()[0];
    // Springs ten thousand times softer: the body sinks a hundred times more than it deforms.
    let (firm, soft) = (alpha(10.0 * 5e3 / 0.02), alpha(1e-3 * 5e3 / 0.02));
    println!("α on firm springs {firm:.4}, on soft ones {soft:.4}");
    assert!(firm > LEAST && soft > LEAST && (soft / firm - 1.0).abs() < 0.3);
    assert!((alpha(1e-5 * 5e3 / 0.02) / soft - 1.0).abs() < 1e-2);
    // Down to springs of the size of rounding errors.
    for per_area in [1.0, 1e-3, 1e-6, 1e-9] {
        assert!((alpha(per_area) / soft - 1.0).abs() < 2e-2, "{per_area}: {}", alpha(per_area));
    }
}

#[test]
fn a_free_body_and_one_on_a_hinge_are_calibrated_too() {
    let surface = box_surface(Vec3::new(0.3, 0.06, 0.06), [20, 4, 4]);
    let levels = covers(&surface, &[0.03, 0.02, 0.014]);
    let free = alphas(&levels, |_, _| jelly(), &[]).unwrap();
    println!("free beam {free:?}");
    assert!(free.iter().all(|alpha| (LEAST..LARGEST).contains(alpha)) && free[0] != FINEST, "{free:?}");
    let point = alphas(&levels, |_, _| jelly(), &[(0, 1e3)]).unwrap();
    let hinge: Vec<_> = (0..3).map(|v| (v, 1e3)).collect();
    assert_eq!(surface.vertices[..3].iter().map(|u| (u.x, u.z)).collect::<Vec<_>>(), vec![(0.0, 0.0); 3]);
    assert_eq!(point, free);
    assert_eq!(alphas(&levels, |_, _| jelly(), &hinge).unwrap(), free);
}

#[test]
fn turning_the_body_or_changing_its_units_does_not_change_the_stabilisation() {
    let surface = box_surface(Vec3::new(0.1, 0.05, 0.05), [8, 4, 4]);
    let mut levels = covers(&surface, &[0.03, 0.015]);
    let holds = clamp(&surface, 1e6);
    for holds in [&holds[..], &[]] {
        let before = alphas(&levels, |_, _| jelly(), holds).unwrap();
        let turn = nalgebra::Rotation3::from_euler_angles(0.3, -0.8, 1.9);
        for u in levels.iter_mut().flat_map(|level| &mut level.mesh.nodes) {
            *u = turn * *u + Vec3::new(0.3, -2.0, 5.0);
        }
        let after = alphas(&levels, |_, _| jelly(), holds).unwrap();
        println!("{before:?} {after:?}");
        // What conjugate gradients leave, which rounding leads another way.
        assert!((after[0] / before[0] - 1.0).abs() < 1e-4 && after[0] != FINEST);
    }
    // Stiffer elements on stiffer springs are the same body under less weight; powers of two round nothing.
    let stiff = Material { lambda: 1024.0 * jelly().lambda, mu: 1024.0 * jelly().mu, ..jelly() };
    let stiffer: Vec<_> = holds.iter().map(|(v, k)| (*v, 1024.0 * k)).collect();
    let before = alphas(&levels, |_, _| jelly(), &holds).unwrap();
    assert_eq!(alphas(&levels, |_, _| stiff, &stiffer).unwrap(), before);
}

#[test]
fn the_stabilisation_does_not_depend_on_the_number_of_threads() {
    let surface = box_surface(Vec3::repeat(0.1), [10; 3]);
    let levels = covers(&surface, &[0.025, 0.009]);
    assert!(levels[1].mesh.nodes.len() > 3 * CHUNK);
    let holds = clamp(&surface, 1e6);
    let bits = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        let found = pool.install(|| calibrate(&levels, |_, _| jelly(), &holds).unwrap());
        (found.stabilisation[0].to_bits(), found.slowest_mode.to_bits())
    };
    assert_eq!(bits(1), bits(2));
    assert_eq!(bits(1), bits(5));
}

#[test]
fn a_finest_level_of_another_material_is_matched_or_the_end_of_the_range_returned() {
    let surface = box_surface(Vec3::repeat(0.1), [10; 3]);
    let levels = covers(&surface, &[0.03, 0.02]);
    let alpha = |scale: Real| {
        let material = |l: usize, _: usize| Material::from_young(if l == 0 { scale * 5e3 } else { 5e3 }, 0.45, 1050.0);
        alphas(&levels, material, &clamp(&surface, 1e6)).unwrap()[0]
    };
    assert!(alpha(0.98) > alpha(1.0) && alpha(1.0) > alpha(1.02));
    assert_eq!(alpha(10.0), LEAST);
    assert_eq!(alpha(0.1), LARGEST);
}

#[test]
fn every_node_fixed_or_a_broken_material_is_no_panic() {
    let size = Vec3::repeat(0.1);
    let surface = box_surface(size, [2; 3]);
    let mut levels = boxes(size, &[[1; 3], [2; 3]], &surface);
    let broken = Material { lambda: Real::NAN, ..jelly() };
    assert!(matches!(alphas(&levels, |_, _| broken, &[]), Err(CalibrationError::NotConverged { level: 0, .. })));
    for level in &mut levels {
        level.fixed = (0..level.mesh.nodes.len() as u32).collect();
    }
    assert_eq!(alphas(&levels, |_, _| jelly(), &[]), Ok(vec![FINEST; 2]));
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
        let system = System::new(&levels, 0, &|_, _| jelly(), FINEST, Some(&holds));
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
    assert!(System::new(&compact, 0, &|_, _| jelly(), FINEST, Some(&holds)).direct.is_none());
}

#[test]
fn a_slender_free_body_and_a_plate_thinner_than_its_elements_are_calibrated() {
    let rod = box_surface(Vec3::new(0.004, 0.004, 0.35), [1, 1, 60]);
    let plate = box_surface(Vec3::new(0.06, 0.06, 0.0004), [20, 20, 1]);
    for (name, surface, spacings, holds) in
        [("rod", &rod, &[0.0036, 0.002][..], vec![]), ("plate", &plate, &[0.003, 0.0014, 0.001], clamp(&plate, 1e6))]
    {
        let levels = covers(surface, spacings);
        let found = calibrate(&levels, |_, _| jelly(), &holds).unwrap();
        println!("{name}: {found:?}");
        assert!(found.stabilisation.iter().all(|alpha| (LEAST..=LARGEST).contains(alpha)), "{name}");
        assert!(found.slowest_mode > 0.0, "{name}");
    }
}
