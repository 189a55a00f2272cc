//! The core's physics against answers from independent tools: closed forms checked with NGSolve 6.2 (R1), scikit-fem
//! 12.0 with SciPy 1.17's DOP853 (R2, R6 in the time domain), and SciPy's eigenvalues (R6). All on the same meshes of
//! linear tetrahedra, so what remains is rounding, or the step's own error.

use nalgebra::{DMatrix, DVector, SymmetricEigen};
use palpate::geometry::primitives::box_mesh;
use palpate::math::{Mat3, Real, Vec3};
use palpate::model::element_kernel::{Path, add_forces};
use palpate::model::energy::energy;
use palpate::model::{Body, Material, State};
use palpate::prepare::{Recipe, Region, Shape, prepare};
use palpate::stepping::step::{Workspace, substeps};

const SIDE: Real = 0.1;

/// The reference cube: `n` cells a side, lumped masses; clamped at x = 0 or free.
fn cube(n: u32, material: Material, clamped: bool) -> Body {
    let clamp = Region { bounds: (Vec3::zeros(), Vec3::new(0.0, SIDE, SIDE)), stiffness: None, exact: true };
    let recipe = Recipe {
        name: "cube".into(),
        shape: Shape::Meshes(vec![box_mesh(Vec3::repeat(SIDE), [n; 3])]),
        material,
        holds: if clamped { vec![clamp] } else { vec![] },
        active_level: None,
    };
    prepare(&recipe, &mut |_, _, _| {}).unwrap()
}

fn forces(body: &Body, position: &[Vec3], velocity: &[Vec3]) -> Vec<Vec3> {
    let mut force = vec![[0.0; 4]; position.len()];
    add_forces(Path::best(), body.elements(), position, velocity, &mut force);
    force.into_iter().map(|f| Vec3::new(f[0], f[1], f[2])).collect()
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
    for state in &STATES {
        let f = Mat3::from_fn(|r, c| state.f[r][c]);
        let rest = &body.level().mesh.nodes;
        let mut now = State::at_rest(&body);
        now.position = rest.iter().map(|u| f * u).collect();
        let internal = forces(&body, &now.position, &now.velocity);
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
    let mut state = State::at_rest(body);
    let mut work = Workspace::new(body, 0);
    let gravity = Vec3::new(0.0, 0.0, -gravity);
    let last = traces.iter().flat_map(|t| t.1).map(|p| p.0).max().unwrap_or(0);
    let (mut worst, mut least_det) = (0.0 as Real, Real::INFINITY);
    for tick in 1..=last {
        let step = (per_tick, 1e-3 / Real::from(per_tick));
        let extremes = substeps(Path::best(), body, &mut state, &mut [], gravity, step, &mut work);
        least_det = least_det.min(extremes.det_f);
        for (node, points) in traces {
            for (_, value) in points.iter().filter(|p| p.0 == tick) {
                let u = state.position[*node].z - body.level().mesh.nodes[*node].z;
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
    assert!(errors[3] < 2e-6);
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
    let centre = body.level().centre_of_mass();
    let turn = Vec3::new(0.0, 0.0, 2.0);
    let momentum = |state: &State| {
        let e = energy(&body, state, Vec3::zeros());
        // About the centre of mass, which stays where it is.
        (e.linear_momentum, e.angular_momentum - centre.cross(&e.linear_momentum), e.total())
    };
    let mut drifts = Vec::new();
    for per_tick in [1, 2, 4] {
        let mut state = State::at_rest(&body);
        state.velocity = state.position.iter().map(|x| turn.cross(&(x - centre))).collect();
        let (p0, l0, e0) = momentum(&state);
        assert!(p0.norm() < 1e-15);
        assert!((l0 - Vec3::new(-0.00041666666666666664, -0.0004166666666666667, 0.005)).norm() < 1e-12);
        assert!((e0 - 0.005).abs() < 1e-12);
        let mut work = Workspace::new(&body, 0);
        let (mut linear, mut angular, mut drift) = (0.0 as Real, 0.0 as Real, 0.0 as Real);
        for _ in 0..5000 {
            let step = (per_tick, 1e-3 / Real::from(per_tick));
            substeps(Path::best(), &body, &mut state, &mut [], Vec3::zeros(), step, &mut work);
            let (p, l, e) = momentum(&state);
            linear = linear.max((p - p0).norm());
            angular = angular.max((l - l0).norm());
            drift = drift.max((e - e0).abs());
        }
        println!("{per_tick} steps a tick: |Δp| {linear:e}, |ΔL| {angular:e}, |ΔE| {drift:e} J");
        assert!(linear < 1e-14 && angular < 1e-14);
        drifts.push(drift);
    }
    // Second order, and far below the energy itself.
    assert!(drifts[0] < 1e-3 * 0.005);
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

/// The linearised cube: stiffness by central differences of the kernel's own force, damping from its velocity.
fn lowest_mode(body: &Body) -> Modes {
    let rest = &body.level().mesh.nodes;
    let mass = &body.level().node_mass;
    let free: Vec<usize> = (0..rest.len()).filter(|n| body.inverse_mass()[*n] > 0.0).collect();
    let size = 3 * free.len();
    let still = vec![Vec3::zeros(); rest.len()];
    let column = |k: usize, moving: bool, h: Real| {
        let (mut x, mut v) = (rest.clone(), still.clone());
        let target = if moving { &mut v } else { &mut x };
        target[free[k / 3]][k % 3] += h;
        let f = forces(body, &x, &v);
        DVector::from_fn(size, |i, _| f[free[i / 3]][i % 3])
    };
    let weight = |i: usize| mass[free[i / 3]].sqrt();
    let (mut stiffness, mut damping) = (DMatrix::zeros(size, size), DMatrix::zeros(size, size));
    for k in 0..size {
        stiffness.set_column(k, &((column(k, false, -1e-6) - column(k, false, 1e-6)) / 2e-6));
        damping.set_column(k, &((column(k, true, -1e-3) - column(k, true, 1e-3)) / 2e-3));
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
        let weight = |n: usize| body.level().node_mass[n];
        let errors: Vec<Real> = [8, 16, 32]
            .map(|per_tick: u32| {
                let mut state = State::at_rest(&body);
                let scale = 1e-5 / mode.lowest.amax();
                for (i, value) in mode.lowest.iter().enumerate() {
                    state.position[mode.free[i / 3]][i % 3] += scale * value;
                }
                let amplitude = |state: &State| -> Real {
                    mode.lowest
                        .iter()
                        .enumerate()
                        .map(|(i, v)| {
                            let n = mode.free[i / 3];
                            v * weight(n) * (state.position[n] - body.level().mesh.nodes[n])[i % 3]
                        })
                        .sum()
                };
                let mut work = Workspace::new(&body, 0);
                let step = 1e-3 / Real::from(per_tick);
                let mut track = vec![amplitude(&state)];
                for _ in 0..600 * per_tick {
                    substeps(Path::best(), &body, &mut state, &mut [], Vec3::zeros(), (1, step), &mut work);
                    track.push(amplitude(&state));
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
        assert!(errors[2] < 2e-3 * log_decrement, "{errors:?}");
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

/// The reference cube's rest positions, each moved by up to `size` [m].
fn shaken(body: &Body, seed: u64, size: Real) -> Vec<Vec3> {
    let mut noise = noise(seed);
    body.level().mesh.nodes.iter().map(|u| u + Vec3::new(noise(), noise(), noise()) * size).collect()
}

#[test]
fn force_is_minus_energy_gradient() {
    let body = cube(2, Material::from_young(1e4, 0.35, 1000.0), false);
    let still = vec![Vec3::zeros(); body.level().mesh.nodes.len()];
    // The larger shake squeezes and even inverts elements: the compression term is part of the energy.
    for (seed, size) in [(1, 0.002), (2, 0.01), (3, 0.03)] {
        let mut state = State::at_rest(&body);
        state.position = shaken(&body, seed, size);
        let force = forces(&body, &state.position, &still);
        let scale = force.iter().map(|f| f.norm()).fold(0.0, Real::max);
        let mut worst = 0.0 as Real;
        for (n, force) in force.iter().enumerate() {
            for (c, force) in force.iter().enumerate() {
                let mut at = |h: Real| {
                    let before = state.position[n][c];
                    state.position[n][c] += h;
                    let elastic = energy(&body, &state, Vec3::zeros()).elastic;
                    state.position[n][c] = before;
                    elastic
                };
                worst = worst.max((force + (at(1e-6) - at(-1e-6)) / 2e-6).abs());
            }
        }
        println!("shaken by {size} m: {:.1e} of the largest force", worst / scale);
        assert!(worst < 1e-6 * scale, "{worst} of {scale} N");
    }
}

#[test]
fn rigid_motion_gives_no_force_and_viscosity_only_takes_energy() {
    let body = cube(2, Material { phi: 30.0, psi: 20.0, ..Material::from_young(1e4, 0.35, 1000.0) }, false);
    let rest = &body.level().mesh.nodes;
    let turn = *nalgebra::Rotation3::from_euler_angles(0.4, -1.1, 2.3).matrix();
    let spin = Vec3::new(3.0, -2.0, 5.0);
    let position: Vec<Vec3> = rest.iter().map(|u| turn * u + Vec3::new(0.3, 0.1, -0.2)).collect();
    let velocity: Vec<Vec3> = position.iter().map(|x| spin.cross(x) + Vec3::new(1.0, 2.0, 3.0)).collect();
    let largest = forces(&body, &position, &velocity).iter().map(|f| f.norm()).fold(0.0, Real::max);
    assert!(largest < 1e-11, "{largest} N");

    let still = vec![Vec3::zeros(); rest.len()];
    for seed in 1..20 {
        let position = shaken(&body, seed, 0.01);
        let mut noise = noise(seed + 100);
        let velocity: Vec<Vec3> = rest.iter().map(|_| Vec3::new(noise(), noise(), noise())).collect();
        let (moving, standing) = (forces(&body, &position, &velocity), forces(&body, &position, &still));
        let power: Real = (0..rest.len()).map(|n| (moving[n] - standing[n]).dot(&velocity[n])).sum();
        assert!(power < 0.0, "{power} W");
        // Neither part leaves a force or a moment over.
        let (sum, moment) = moving
            .iter()
            .zip(&position)
            .fold((Vec3::zeros(), Vec3::zeros()), |(f, m), (force, x)| (f + force, m + x.cross(force)));
        let scale: Real = moving.iter().map(|f| f.norm()).sum();
        assert!(sum.norm() < 1e-13 * scale && moment.norm() < 1e-13 * scale);
    }
}

#[test]
fn every_form_of_the_kernel_gives_the_same_bits() {
    // 162 elements: the last block is not full.
    let body = cube(3, Material { phi: 3.0, psi: 2.0, ..Material::from_young(1e4, 0.45, 1000.0) }, false);
    for seed in 0..50 {
        // From small to inverted, and once with a number that is none.
        let mut position = shaken(&body, seed, 0.0008 * seed as Real);
        let velocity = shaken(&body, seed + 1000, 1.0);
        if seed == 49 {
            position[5].y = Real::NAN;
        }
        let results: Vec<_> = Path::available()
            .into_iter()
            .map(|path| {
                let mut force = vec![[0.0; 4]; position.len()];
                let extremes = add_forces(path, body.elements(), &position, &velocity, &mut force);
                let bits: Vec<u64> = force.iter().flatten().map(|x| x.to_bits()).collect();
                (bits, extremes.strain_squared.to_bits(), extremes.det_f.to_bits(), extremes.stiffening().to_bits())
            })
            .collect();
        if seed < 49 {
            assert!(results.windows(2).all(|pair| pair[0] == pair[1]), "seed {seed}");
        } else {
            assert!(results.iter().all(|r| r.0.iter().any(|bits| Real::from_bits(*bits).is_nan())));
        }
    }
}
