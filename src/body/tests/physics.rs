//! The core's physics against answers from independent tools: closed forms checked with NGSolve 6.2 (R1), scikit-fem
//! 12.0 with SciPy 1.17's DOP853 (R2, R6 in the time domain), and SciPy's eigenvalues (R6). All on the same meshes of
//! linear tetrahedra, so what remains is rounding, or the step's own error.
//!
//! A step's own error is measured with all elements in one class of steps: nothing but `Simulation::advance` moves them
//! to others.

use nalgebra::{DMatrix, DVector, SymmetricEigen};
use palpate_body::prepare::{Elements, Recipe, Region, Shape, prepare};
use palpate_core::geometry::primitives::box_mesh;
use palpate_core::ids::{Node, Slot};
use palpate_core::math::{Bounds, Mat3, Real, Vec3};
use palpate_core::model::active_set::{ActiveSet, Change};
use palpate_core::model::element_kernel::{Rates, Simd};
use palpate_core::model::element_pool::CLASSES;
use palpate_core::model::energy::energy;
use palpate_core::model::step_class::{TICK, class_for, step_of};
use palpate_core::model::{ActiveMesh, Body, Material, State};
use palpate_core::stepping::step::{self, Pushing, Workspace, World};

const SIDE: Real = 0.1;

/// The reference cube: one level for each of `cells` cells a side, lumped masses; clamped at x = 0 or free.
fn cube_of(cells: &[u32], material: Material, clamped: bool) -> Body {
    let clamp = Region { bounds: Bounds::new(Vec3::zeros(), Vec3::new(0.0, SIDE, SIDE)), stiffness: None, exact: true };
    let recipe = Recipe {
        name: "cube".into(),
        shape: Shape::meshes(cells.iter().map(|n| box_mesh(Vec3::repeat(SIDE), [*n; 3]))),
        material,
        inclusions: vec![],
        holds: if clamped { vec![clamp] } else { vec![] },
        elements: Elements::Tetrahedra,
        damping_ratio: 0.0,
    };
    prepare(&recipe, &mut |_, _, _| {}).unwrap()
}

/// The reference cube with one level of `n` cells a side.
fn cube(n: u32, material: Material, clamped: bool) -> Body {
    cube_of(&[n], material, clamped)
}

/// A body of one level at rest, all elements of which take `per_tick` steps a tick, a power of two.
fn at_rest(body: &Body, per_tick: u32) -> ActiveMesh {
    let mut state = State::at_rest(body, 0);
    let all = state.classes.concat();
    state.classes = vec![Vec::new(); CLASSES];
    let class = class_for(TICK / Real::from(per_tick));
    assert_eq!(step_of(class) * Real::from(per_tick), TICK);
    state.classes[class] = all;
    ActiveMesh::new(body, &state, usize::MAX).unwrap()
}

/// Forces on the nodes [N] where they are now, by number; they and the elements' memories are those of `rates`.
fn forces_by(path: Simd, mesh: &mut ActiveMesh, rates: &Rates) -> Vec<Vec3> {
    for class in 0..CLASSES {
        mesh.add_forces(path, class, rates);
    }
    mesh.hand_back_all();
    let slots: Vec<(Slot, Node)> = mesh.active().iter().map(|s| (*s, mesh.node(*s))).collect();
    let mut force = vec![Vec3::zeros(); slots.iter().map(|s| s.1.index() + 1).max().unwrap_or(0)];
    for (slot, node) in slots {
        let f = std::mem::replace(&mut mesh.motion.force[slot.index()], [0.0; 4]);
        force[node.index()] = Vec3::new(f[0], f[1], f[2]);
    }
    force
}

fn elastic_forces(mesh: &mut ActiveMesh, position: &[Vec3]) -> Vec<Vec3> {
    mesh.change_motion(|n, x, _| *x = position[n.index()]);
    forces_by(Simd::best(), mesh, &Rates::ELASTIC)
}

/// Forces where the nodes are at `position` and were at `before` when the elements were last evaluated, `step` [s] ago.
fn forces(body: &Body, mesh: &mut ActiveMesh, before: &[Vec3], position: &[Vec3], step: Real) -> Vec<Vec3> {
    elastic_forces(mesh, before);
    mesh.change_motion(|n, x, _| *x = position[n.index()]);
    let material = body.material();
    let rates = Rates {
        volume: material.phi / (material.lambda * step),
        shear: material.psi / (material.mu * step),
        ..Rates::ELASTIC
    };
    forces_by(Simd::best(), mesh, &rates)
}

// ---- R1: homogeneous states, E = 10 kPa, ν = 0.35 ----

struct Homogeneous {
    name: &'static str,
    /// Rows of F.
    f: [[Real; 3]; 3],
    /// Of the cube [J].
    energy: Real,
    /// What the outside puts on the faces +x, +y, +z of the cube [N].
    face: [[Real; 3]; 3],
}

const STATES: [Homogeneous; 9] = [
    Homogeneous {
        name: "uniaxial_stretch_lateral_constrained",
        f: [[1.3, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]],
        energy: 0.9551388888888893,
        face: [[71.9814814814815, 0.0, 0.0], [0.0, 29.81481481481482, 0.0], [0.0, 0.0, 29.81481481481482]],
    },
    Homogeneous {
        name: "uniaxial_stretch_lateral_free",
        f: [[1.3, 0.0, 0.0], [0.0, 0.8709190547921202, 0.0], [0.0, 0.0, 0.8709190547921202]],
        energy: 0.5951250000000005,
        face: [[44.85000000000004, 0.0, 0.0], [0.0, 1.1881443990097802e-14, 0.0], [0.0, 0.0, 1.1881443990097802e-14]],
    },
    Homogeneous {
        name: "uniaxial_compress_lateral_constrained",
        f: [[0.8, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]],
        energy: 0.25999999999999984,
        face: [[-23.111111111111107, 0.0, 0.0], [0.0, -15.55555555555555, 0.0], [0.0, 0.0, -15.55555555555555]],
    },
    Homogeneous {
        name: "uniaxial_compress_lateral_free",
        f: [[0.8, 0.0, 0.0], [0.0, 1.0611314715905846, 0.0], [0.0, 0.0, 1.0611314715905846]],
        energy: 0.16199999999999992,
        face: [[-14.400000000000018, 0.0, 0.0], [0.0, -3.679418783066562e-14, 0.0], [0.0, 0.0, -3.679418783066562e-14]],
    },
    Homogeneous {
        name: "simple_shear",
        f: [[1.0, 0.3, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]],
        energy: 0.18291666666666673,
        face: [
            [7.222222222222225, 11.111111111111112, 0.0],
            [13.27777777777778, 7.2222222222222285, 0.0],
            [0.0, 0.0, 3.8888888888888924],
        ],
    },
    Homogeneous {
        name: "rigid_rotation_90deg_z",
        f: [[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]],
        energy: 0.0,
        face: [[0.0, 0.0, 0.0], [0.0, 0.0, 0.0], [0.0, 0.0, 0.0]],
    },
    Homogeneous {
        name: "hydrostatic_compression",
        f: [[0.9, 0.0, 0.0], [0.0, 0.9, 0.0], [0.0, 0.0, 0.9]],
        energy: 0.45124999999999976,
        face: [[-28.499999999999993, 0.0, 0.0], [0.0, -28.499999999999993, 0.0], [0.0, 0.0, -28.499999999999993]],
    },
    Homogeneous {
        name: "rotation_90deg_z_after_stretch",
        f: [[0.0, -1.0, 0.0], [1.3, 0.0, 0.0], [0.0, 0.0, 1.0]],
        energy: 0.9551388888888893,
        face: [[0.0, 71.9814814814815, 0.0], [-29.81481481481482, 0.0, 0.0], [0.0, 0.0, 29.81481481481482]],
    },
    Homogeneous {
        name: "general",
        f: [[1.1, 0.2, -0.1], [0.05, 0.9, 0.15], [-0.2, 0.1, 1.05]],
        energy: 0.5418605324074078,
        face: [
            [25.023148148148174, 7.432870370370373, -15.254629629629639],
            [10.268518518518524, 6.634259259259273, 7.291666666666669],
            [-12.671296296296303, 9.1087962962963, 19.608796296296312],
        ],
    },
];

#[test]
fn homogeneous_states_have_the_reference_forces_and_energies() {
    let body = cube(3, Material::from_young(1e4, 0.35, 1000.0), false);
    let mut now = at_rest(&body, 1);
    for state in &STATES {
        let f = Mat3::from_fn(|r, c| state.f[r][c]);
        let rest = &body.level(0).mesh.nodes;
        let position: Vec<Vec3> = rest.iter().map(|u| f * u).collect();
        let internal = elastic_forces(&mut now, &position);
        let scale = state.face.iter().flatten().fold(1e-3, |a: Real, b| a.max(b.abs()));
        for (axis, face) in state.face.iter().enumerate() {
            // ∫ P ∇(u_axis / side) dV is the force through the face; the nodes carry its negative.
            let through: Vec3 = internal.iter().zip(rest).map(|(f, u)| -f * (u[axis] / SIDE)).sum();
            let error = (through - Vec3::from(*face)).norm();
            assert!(error <= 1e-9 * scale, "{}: face {axis}: {through} for {face:?}", state.name);
        }
        // Inside, forces balance.
        for (u, f) in rest.iter().zip(&internal) {
            let inside = (0..3).all(|c| u[c] > 1e-9 && u[c] < SIDE - 1e-9);
            assert!(!inside || f.norm() <= 1e-12 * scale, "{}: {f}", state.name);
        }
        let elastic = energy(&body, &now, Vec3::zeros()).elastic;
        assert!((elastic - state.energy).abs() <= 1e-9 * state.energy.max(1e-3), "{}: {elastic}", state.name);
    }
}

// ---- R2: gravity switched on, displacements u_z [m] at (tick, value) ----

type Trace = (usize, [(usize, Real); 5]);

/// Largest difference from the traces [m], stepping `per_tick` times a millisecond; smallest det F on the way.
fn trajectory_error(body: &Body, gravity: Real, traces: &[Trace], per_tick: u32) -> (Real, Real) {
    let mut mesh = at_rest(body, per_tick);
    let mut work = Workspace::new(&mesh, 0);
    let gravity = Vec3::new(0.0, 0.0, -gravity);
    let last = traces.iter().flat_map(|t| t.1).map(|p| p.0).max().unwrap_or(0);
    let (mut worst, mut least_det) = (0.0 as Real, Real::INFINITY);
    for tick in 1..=last {
        let extremes =
            step::tick(&World { path: Simd::best(), body, gravity }, &mut mesh, Pushing::default(), &mut work, &mut ());
        least_det = least_det.min(extremes.det_f);
        for (node, points) in traces {
            for (_, value) in points.iter().filter(|p| p.0 == tick) {
                let u = mesh.position_of(Node::at(*node)).unwrap().z - body.rest(Node::at(*node)).z;
                worst = worst.max((u - value).abs());
            }
        }
    }
    (worst, least_det)
}

fn second_order(name: &str, errors: &[Real], reference_uncertainty: Real) {
    println!("{name}: errors {errors:?} m as the step halves");
    for pair in errors.windows(2) {
        // Halving the step quarters the error, down to the reference's own digits.
        let expected = (0.3 * pair[0]).max(2.0 * reference_uncertainty);
        assert!(pair[1] <= expected, "{name}: {errors:?}");
    }
}

#[test]
fn a_clamped_cube_swings_as_the_reference_and_half_the_step_quarters_the_error() {
    let body = cube(2, Material::from_young(5e4, 0.35, 1000.0), true);
    let traces: [Trace; 2] = [
        (
            6,
            [
                (200, -0.004465042),
                (400, -0.006590569),
                (1000, -0.003893804),
                (1500, -0.006152054),
                (2000, -0.003295879),
            ],
        ),
        (
            26,
            [
                (200, -0.004623537),
                (400, -0.007116744),
                (1000, -0.004404671),
                (1500, -0.006579143),
                (2000, -0.003294359),
            ],
        ),
    ];
    let errors: Vec<Real> = [2, 4, 8, 16].map(|n| trajectory_error(&body, 9.81, &traces, n).0).into();
    second_order("R2 n=2", &errors, 1e-9);
    assert!(errors[3] < 1e-6);
}

#[test]
fn a_finer_cube_swings_as_the_reference() {
    let body = cube(4, Material::from_young(5e4, 0.35, 1000.0), true);
    let traces: [Trace; 1] = [(
        20,
        [(100, -0.002983879), (200, -0.008066064), (400, -0.004640257), (700, -0.006283029), (1000, -0.002178126)],
    )];
    let errors: Vec<Real> = [4, 8, 16].map(|n| trajectory_error(&body, 9.81, &traces, n).0).into();
    second_order("R2 n=4", &errors, 1e-9);
}

#[test]
fn a_soft_cube_follows_the_reference_where_the_law_is_the_same() {
    // E = 10 kPa sags by a third. The reference is pure St. Venant–Kirchhoff; ours agrees while no element is
    // squeezed below J = 0.6, where the compression term begins.
    let body = cube(2, Material::from_young(1e4, 0.35, 1000.0), true);
    let traces: [Trace; 1] =
        [(6, [(100, -0.03287818), (200, -0.0225027), (400, -0.02950121), (700, -0.03300398), (1000, -0.02518232)])];
    let runs = [4, 8, 16].map(|n| trajectory_error(&body, 9.81, &traces, n));
    println!("smallest det F {}", runs[2].1);
    assert!(runs[2].1 > 0.6);
    second_order("R2 soft", &runs.map(|r| r.0), 1e-8);
}

#[test]
fn a_damped_cube_comes_to_rest_as_the_reference_and_half_the_step_halves_the_error() {
    let body = cube(2, Material { psi: 60.0, ..Material::from_young(5e4, 0.35, 1000.0) }, true);
    let traces: [Trace; 2] = [
        (
            6,
            [
                (100, -1.174575e-05),
                (200, -2.126464e-05),
                (400, -2.209494e-05),
                (700, -1.877322e-05),
                (1000, -1.939352e-05),
            ],
        ),
        (
            26,
            [
                (100, -1.247404e-05),
                (200, -2.279911e-05),
                (400, -2.359373e-05),
                (700, -1.992028e-05),
                (1000, -2.064236e-05),
            ],
        ),
    ];
    let errors: Vec<Real> = [8, 16, 32, 64].map(|n| trajectory_error(&body, 0.05, &traces, n).0).into();
    println!("R2 damped: errors {errors:?} m as the step halves");
    for pair in errors.windows(2) {
        assert!(pair[1] <= 0.6 * pair[0], "{errors:?}");
    }
    assert!(errors[3] < 1e-3 * 2.4e-5);
}

// ---- R5: a free body, E = 10 kPa, turning at 2 rad/s about z ----

#[test]
fn a_free_spinning_cube_keeps_its_momentum_to_rounding_and_its_energy_to_the_step() {
    let body = cube(2, Material::from_young(1e4, 0.35, 1000.0), false);
    let centre = body.centre_of_mass();
    let turn = Vec3::new(0.0, 0.0, 2.0);
    let momentum = |mesh: &ActiveMesh| {
        let e = energy(&body, mesh, Vec3::zeros());
        // About the centre of mass, which stays where it is.
        (e.linear_momentum, e.angular_momentum - centre.cross(&e.linear_momentum), e.total())
    };
    let mut drifts = Vec::new();
    for per_tick in [1, 2, 4] {
        let mut mesh = at_rest(&body, per_tick);
        mesh.change_motion(|_, x, v| *v = turn.cross(&(*x - centre)));
        let (p0, l0, e0) = momentum(&mesh);
        assert!(p0.norm() < 1e-15);
        assert!((l0 - Vec3::new(-0.00041666666666666664, -0.0004166666666666667, 0.005)).norm() < 1e-12);
        assert!((e0 - 0.005).abs() < 1e-12);
        let mut work = Workspace::new(&mesh, 0);
        let (mut linear, mut angular, mut drift) = (0.0 as Real, 0.0 as Real, 0.0 as Real);
        for _ in 0..5000 {
            step::tick(
                &World { path: Simd::best(), body: &body, gravity: Vec3::zeros() },
                &mut mesh,
                Pushing::default(),
                &mut work,
                &mut (),
            );
            let (p, l, e) = momentum(&mesh);
            linear = linear.max((p - p0).norm());
            angular = angular.max((l - l0).norm());
            drift = drift.max((e - e0).abs());
        }
        println!("{per_tick} steps a tick: |Δp| {linear:e}, |ΔL| {angular:e}, |ΔE| {drift:e} J");
        assert!(linear < 1e-14 && angular < 1e-14);
        drifts.push(drift);
    }
    // Second order, and far below the energy itself.
    assert!(drifts[0] < 1e-5 * 0.005);
    assert!(drifts[1] < 0.3 * drifts[0] && drifts[2] < 0.3 * drifts[1], "{drifts:?}");
}

// ---- R6: damping of the lowest mode, E = 50 kPa ----

struct Modes {
    lowest: DVector<Real>,
    omega: Real,
    /// φᵀ C φ / (2ω) for the mass-normalised mode φ.
    zeta: Real,
    free: Vec<usize>,
}

/// The linearised cube: stiffness by central differences of the kernel's own force, damping by those of what the force
/// has beyond that when the last evaluation was elsewhere.
fn lowest_mode(body: &Body) -> Modes {
    let rest = &body.level(0).mesh.nodes;
    let mass = &body.level(0).node_mass;
    let free: Vec<usize> = (0..rest.len()).filter(|n| !body.is_fixed(Node::at(*n))).collect();
    let size = 3 * free.len();
    let mut mesh = at_rest(body, 1);
    let mut column = |k: usize, moving: bool, h: Real| {
        let mut x = rest.clone();
        x[free[k / 3]][k % 3] += h;
        let standing = elastic_forces(&mut mesh, &x);
        // In a tick: at a speed of 1/s of the way.
        let f = if moving { forces(body, &mut mesh, rest, &x, TICK) } else { standing.clone() };
        DVector::from_fn(size, |i, _| {
            let n = free[i / 3];
            if moving { (f[n] - standing[n])[i % 3] } else { f[n][i % 3] }
        })
    };
    let weight = |i: usize| mass[free[i / 3]].sqrt();
    let (mut stiffness, mut damping) = (DMatrix::zeros(size, size), DMatrix::zeros(size, size));
    for k in 0..size {
        stiffness.set_column(k, &((column(k, false, -1e-6) - column(k, false, 1e-6)) / 2e-6));
        damping.set_column(k, &((column(k, true, -1e-6) - column(k, true, 1e-6)) / (2e-6 / TICK)));
    }
    let scaled =
        DMatrix::from_fn(size, size, |i, j| 0.5 * (stiffness[(i, j)] + stiffness[(j, i)]) / weight(i) / weight(j));
    let eigen = SymmetricEigen::new(scaled);
    let first = eigen.eigenvalues.imin();
    let omega = eigen.eigenvalues[first].sqrt();
    let lowest = DVector::from_fn(size, |i, _| eigen.eigenvectors[(i, first)] / weight(i));
    let zeta = (lowest.transpose() * &damping * &lowest)[0] / (2.0 * omega);
    Modes { lowest, omega, zeta, free }
}

#[test]
fn viscosity_damps_the_lowest_mode_as_the_reference() {
    for (psi, zeta, log_decrement) in
        [(20.0, 0.025142557252377955, 0.15802173103289835), (60.0, 0.07542767175713377, 0.47518204495233235)]
    {
        let body = cube(2, Material { psi, ..Material::from_young(5e4, 0.35, 1000.0) }, true);
        let mode = lowest_mode(&body);
        let frequency = mode.omega / (2.0 * std::f64::consts::PI);
        assert!((frequency / 8.420311824500702 - 1.0).abs() < 1e-7, "{frequency}");
        assert!((mode.zeta / zeta - 1.0).abs() < 1e-6, "{}", mode.zeta);

        // Swing in that mode, 1e-5 m wide, and compare the decrement of its amplitude per period.
        let weight = |n: usize| body.level(0).node_mass[n];
        let errors: Vec<Real> = [8, 16, 32]
            .map(|per_tick: u32| {
                let scale = 1e-5 / mode.lowest.amax();
                let mut start = body.level(0).mesh.nodes.clone();
                for (i, value) in mode.lowest.iter().enumerate() {
                    start[mode.free[i / 3]][i % 3] += scale * value;
                }
                let mut mesh = at_rest(&body, per_tick);
                // Evaluated once where it starts, so that the elements know that it is not on its way there.
                elastic_forces(&mut mesh, &start);
                let amplitude = |mesh: &ActiveMesh| -> Real {
                    mode.lowest
                        .iter()
                        .enumerate()
                        .map(|(i, v)| {
                            let n = mode.free[i / 3];
                            let moved = mesh.position_of(Node::at(n)).unwrap() - body.rest(Node::at(n));
                            v * weight(n) * moved[i % 3]
                        })
                        .sum()
                };
                let mut work = Workspace::new(&mesh, 0);
                let mut track = vec![amplitude(&mesh)];
                for _ in 0..600 {
                    step::tick(
                        &World { path: Simd::best(), body: &body, gravity: Vec3::zeros() },
                        &mut mesh,
                        Pushing::default(),
                        &mut work,
                        &mut (),
                    );
                    track.push(amplitude(&mesh));
                }
                // Peaks by the parabola through three samples.
                let peaks: Vec<Real> = track
                    .windows(3)
                    .filter(|w| w[1] > w[0] && w[1] >= w[2])
                    .map(|w| w[1] + (w[2] - w[0]) * (w[2] - w[0]) / (8.0 * (2.0 * w[1] - w[0] - w[2])))
                    .collect();
                let last = 4.min(peaks.len() - 1);
                ((peaks[0] / peaks[last]).ln() / last as Real - log_decrement).abs()
            })
            .into();
        println!("R6 ψ = {psi}: decrement errors {errors:?} as the step halves");
        assert!(errors[2] < 2e-4 * log_decrement, "{errors:?}");
        for pair in errors.windows(2) {
            assert!(pair[1] < 0.6 * pair[0] || pair[1] < 5e-5, "{errors:?}");
        }
    }
}

// ---- the law and its kernel ----

/// Numbers in −1..1 that only `seed` determines.
fn noise(seed: u64) -> impl FnMut() -> Real {
    let mut state = seed.wrapping_mul(0x9E37_79B9_7F4A_7C15) | 1;
    move || {
        state ^= state << 13;
        state ^= state >> 7;
        state ^= state << 17;
        (state >> 11) as Real / (1u64 << 52) as Real - 1.0
    }
}

/// `rest`, each moved by up to `size` [m].
fn shaken(rest: &[Vec3], seed: u64, size: Real) -> Vec<Vec3> {
    let mut noise = noise(seed);
    rest.iter().map(|u| u + Vec3::new(noise(), noise(), noise()) * size).collect()
}

#[test]
fn force_is_minus_energy_gradient_where_levels_meet_too() {
    let green = Material::from_young(1e4, 0.35, 1000.0);
    force_is_minus_the_gradient_of(&cube_of(&[2, 4, 8], green, false));
    force_is_minus_the_gradient_of(&cube_of(&[2, 4, 8], green.as_neo_hookean(), false));
}

fn force_is_minus_the_gradient_of(body: &Body) {
    // Fine towards one corner, coarse at the opposite one.
    let mut set = ActiveSet::uniform(body, 0);
    for (level, reach) in [(0, 0.09), (1, 0.04)] {
        for n in body.nodes_of(level).filter(|n| body.rest(*n).norm() < reach) {
            while set.is_active(n) {
                let mut first = n;
                while let Some(before) = set.first_needed(body, first) {
                    first = before;
                }
                set.apply(body, Change::Split(first));
            }
        }
    }
    assert!(set.count().iter().all(|n| *n > 0), "{:?}", set.count());
    let nodes: Vec<Node> = body.nodes().filter(|n| set.is_active(*n)).collect();
    let rest: Vec<Vec3> = body.nodes().map(|n| body.rest(n)).collect();
    let state = State::at_rest_on(body, nodes.clone()).unwrap();
    assert!(!state.interface.is_empty());
    let mut mesh = ActiveMesh::new(body, &state, usize::MAX).unwrap();
    // The larger shake squeezes and even inverts elements: the compression term is part of the energy.
    for (seed, size) in [(1, 0.0005), (2, 0.003), (3, 0.01)] {
        let mut position = shaken(&rest, seed, size);
        let force = elastic_forces(&mut mesh, &position);
        let scale = force.iter().map(|f| f.norm()).fold(0.0, Real::max);
        let mut worst = 0.0 as Real;
        for &n in &nodes {
            for c in 0..3 {
                let mut at = |h: Real| {
                    let before = position[n.index()][c];
                    position[n.index()][c] += h;
                    mesh.change_motion(|n, x, _| *x = position[n.index()]);
                    position[n.index()][c] = before;
                    energy(body, &mesh, Vec3::zeros()).elastic
                };
                worst = worst.max((force[n.index()][c] + (at(1e-6) - at(-1e-6)) / 2e-6).abs());
            }
        }
        println!("shaken by {size} m: {:.1e} of the largest force", worst / scale);
        assert!(worst < 1e-6 * scale, "{worst} of {scale} N");
    }
}

#[test]
fn viscosity_only_takes_energy_and_no_force_or_moment_is_left_over() {
    let body = cube(2, Material { phi: 30.0, psi: 20.0, ..Material::from_young(1e4, 0.35, 1000.0) }, false);
    let mut mesh = at_rest(&body, 1);
    let rest = &body.level(0).mesh.nodes;
    for seed in 1..20 {
        let position = shaken(rest, seed, 0.01);
        let mut noise = noise(seed + 100);
        let velocity: Vec<Vec3> = rest.iter().map(|_| Vec3::new(noise(), noise(), noise())).collect();
        let before: Vec<Vec3> = position.iter().zip(&velocity).map(|(x, v)| x - v * TICK).collect();
        let moving = forces(&body, &mut mesh, &before, &position, TICK);
        let standing = elastic_forces(&mut mesh, &position);
        let power: Real = (0..rest.len()).map(|n| (moving[n] - standing[n]).dot(&velocity[n])).sum();
        assert!(power < 0.0, "{power} W");
        let (sum, moment) = moving
            .iter()
            .zip(&position)
            .fold((Vec3::zeros(), Vec3::zeros()), |(f, m), (force, x)| (f + force, m + x.cross(force)));
        let scale: Real = moving.iter().map(|f| f.norm()).sum();
        assert!(sum.norm() < 1e-13 * scale && moment.norm() < 1e-13 * scale);
    }
}

#[test]
fn a_number_that_is_none_shows_in_the_forces_whichever_form_the_kernel_has() {
    // 162 elements: the last block is not full.
    let body = cube(3, Material::from_young(1e4, 0.45, 1000.0), false);
    for path in Simd::available() {
        let mut mesh = at_rest(&body, 1);
        mesh.change_motion(|n, x, _| x.y = if n == Node(5) { Real::NAN } else { x.y });
        let force = forces_by(path, &mut mesh, &Rates::ELASTIC);
        // Those of its own elements, and no others.
        for n in body.nodes_of(0) {
            let beside = body.elements_around(Node(5)).iter().any(|e| body.element(*e).contains(&n));
            assert_eq!(force[n.index()].iter().any(|f| f.is_nan()), beside, "{path:?}, node {n}");
        }
    }
}
