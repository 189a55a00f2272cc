//! Levels of smoothed elements answer alike, and as the continuum where that is known, in every load: the core's own forces,
//! in small strain, without any factor.

use palpate_body::prepare::inclusions::Inclusion;
use palpate_body::prepare::region::Reach;
use palpate_body::prepare::{Elements, Recipe, Region, Shape, prepare};
use palpate_core::adaptation::Adaptivity;
use palpate_core::contact::safety::ForceLimits;
use palpate_core::contact::tool::Following;
use palpate_core::geometry::primitives::{box_mesh, box_surface};
use palpate_core::ids::{Node, Slot, Vertex};
use palpate_core::math::{Bounds, Mat3, Real, Vec3};
use palpate_core::model::element_kernel::Simd;
use palpate_core::model::energy::{Energy, energy};
use palpate_core::model::{ActiveMesh, Body, Fibres, Material, State};
use palpate_core::simulation::{Inputs, Settings, Simulation, Snapshot};
use palpate_core::stepping::step;
use std::sync::Arc;

const YOUNGS_MODULUS: Real = 1e4;

/// A box of `size`, held at x = 0 or free.
fn body(shape: Shape, size: Vec3, nu: Real, held: bool, zeta: Real) -> Body {
    body_of(shape, size, Material::from_young(YOUNGS_MODULUS, nu, 1000.0), held, zeta, None)
}

/// The same of `material`, with a `layer` ten times as stiff.
fn body_of(shape: Shape, size: Vec3, material: Material, held: bool, zeta: Real, layer: Option<Bounds>) -> Body {
    let stiff = |layer| Inclusion {
        place: Reach::Box(layer).into(),
        youngs_modulus: 10.0 * YOUNGS_MODULUS,
        poisson_ratio: material.poisson_ratio(),
        density: 1000.0,
        neo_hookean: 0.0,
        fibres: Fibres::NONE,
    };
    let bounds = Bounds::new(Vec3::repeat(-1e-6), Vec3::new(1e-6, size.y, size.z) + Vec3::y() * 1e-6);
    let exact = matches!(shape, Shape::Meshes { .. });
    let recipe = Recipe {
        name: "box".into(),
        shape,
        material,
        inclusions: layer.map(stiff).into_iter().collect(),
        holds: if held { vec![Region { bounds, stiffness: None, exact }] } else { vec![] },
        elements: Elements::Smoothed,
        damping_ratio: zeta,
    };
    prepare(&recipe, &mut |_, _, _| {}).unwrap()
}

fn cover(size: Vec3, spacings: &[Real]) -> Shape {
    // As dense as surfaces are shown: between supports farther apart, the finer a level the more it would give way.
    let cells = size / (0.4 * spacings[spacings.len() - 1]);
    Shape::closed(box_surface(size, [cells.x as u32, cells.y as u32, cells.z as u32]), spacings.to_vec())
}

/// Forces on the active nodes [N], by slot: `acceleration` of the rest place times the masses.
fn on_masses(body: &Body, mesh: &ActiveMesh, acceleration: &dyn Fn(&Vec3) -> Vec3) -> Vec<Vec3> {
    let mut load = vec![Vec3::zeros(); mesh.motion.mass.len()];
    for &slot in mesh.active() {
        load[slot.index()] = acceleration(&body.rest(mesh.node(slot))) * mesh.motion.mass[slot.index()];
    }
    load
}

/// The same of `traction` (place, area vector) [N] on the displayed surface.
fn on_surface(body: &Body, mesh: &ActiveMesh, traction: &dyn Fn(&Vec3, &Vec3) -> Vec3) -> Vec<Vec3> {
    let mut load = vec![Vec3::zeros(); mesh.motion.mass.len()];
    for triangle in &body.surface().triangles {
        let [a, b, c] = triangle.map(|v| body.surface().vertices[v as usize]);
        let area = (b - a).cross(&(c - a)) * 0.5;
        for v in triangle {
            let force = traction(&body.surface().vertices[*v as usize], &area) / 3.0;
            let at = mesh.embedding(Vertex(*v));
            at.slots.iter().zip(at.weights).for_each(|(slot, w)| load[slot.index()] += force * w);
        }
    }
    load
}

/// Work [J] of the balanced `load` (by slot) on the displacements that it brings about: conjugate gradients on differences of
/// the core's forces.
fn work(body: &Body, mesh: &mut ActiveMesh, load: &[Vec3]) -> Real {
    /// Largest displacement in a difference of forces [m].
    const SMALL: Real = 1e-7;
    // What acts on interface nodes acts on their masters.
    mesh.motion.force.iter_mut().zip(load).for_each(|(f, load)| *f = [load.x, load.y, load.z, 0.0]);
    mesh.hand_back_all();
    let handed: Vec<Vec3> = mesh.motion.force.iter().map(|f| Vec3::from_column_slice(&f[..3])).collect();
    let slots: Vec<Slot> = mesh.active().to_vec();
    let rest: Vec<Vec3> = slots.iter().map(|slot| body.rest(mesh.node(*slot))).collect();
    let fixed: Vec<bool> = slots.iter().map(|slot| body.is_fixed(mesh.node(*slot))).collect();
    let mut resist = |u: &[Vec3]| -> Vec<Vec3> {
        let h = SMALL / u.iter().map(|u| u.norm()).fold(1e-300, Real::max);
        let mut forces = |sign: Real| -> Vec<Vec3> {
            mesh.motion.force.fill([0.0; 4]);
            for (i, slot) in slots.iter().enumerate() {
                let x = rest[i] + u[i] * (h * sign);
                mesh.motion.position[slot.index()] = [x.x, x.y, x.z, 0.0];
            }
            step::add_elastic_forces(Simd::best(), mesh);
            let force = |slot: &Slot| Vec3::from_column_slice(&mesh.motion.force[slot.index()][..3]);
            slots.iter().map(force).collect()
        };
        let (ahead, behind) = (forces(1.0), forces(-1.0));
        let slope = |i: usize| if fixed[i] { Vec3::zeros() } else { (behind[i] - ahead[i]) / (2.0 * h) };
        (0..slots.len()).map(slope).collect()
    };
    let dot = |a: &[Vec3], b: &[Vec3]| a.iter().zip(b).map(|(a, b)| a.dot(b)).sum::<Real>();
    let load: Vec<Vec3> =
        slots.iter().zip(&fixed).map(|(s, f)| if *f { Vec3::zeros() } else { handed[s.index()] }).collect();
    let (mut u, mut r, mut p) = (vec![Vec3::zeros(); slots.len()], load.clone(), load.clone());
    let (mut square, enough) = (dot(&r, &r), 1e-7 * dot(&load, &load));
    for _ in 0..10_000 {
        if square < enough {
            return dot(&u, &load);
        }
        let q = resist(&p);
        let along = square / dot(&p, &q);
        for i in 0..u.len() {
            u[i] += p[i] * along;
            r[i] -= q[i] * along;
        }
        let next = dot(&r, &r);
        for (p, r) in p.iter_mut().zip(&r) {
            *p = r + *p * (next / square);
        }
        square = next;
    }
    panic!("no rest");
}

type Load<'a> = (&'a str, Box<dyn Fn(&Body, &ActiveMesh) -> Vec<Vec3>>);

/// Own weight in three directions; an end pulled along, aside and turned; a press.
fn loads(size: Vec3) -> Vec<Load<'static>> {
    let mut all: Vec<Load> = vec![];
    for (axis, name) in [(0, "hanging"), (1, "bending y"), (2, "bending z")] {
        all.push((name, Box::new(move |b, m| on_masses(b, m, &|_| Vec3::ith(axis, 1.0)))));
    }
    let mut at_end = |name, direction: fn(Vec3) -> Vec3| {
        let traction = move |x: &Vec3, area: &Vec3| {
            if x.x > 0.999 * size.x { direction(x - size / 2.0) * area.x.max(0.0) } else { Vec3::zeros() }
        };
        all.push((name, Box::new(move |b: &Body, m: &ActiveMesh| on_surface(b, m, &traction)) as _));
    };
    at_end("end pulled", |_| Vec3::x());
    at_end("end aside", |_| Vec3::y());
    at_end("twist", |x| Vec3::x().cross(&x));
    let press = move |x: &Vec3, area: &Vec3| {
        let away = x - size / 2.0;
        let inside = x.z > 0.999 * size.z && away.x.abs() < 0.0151 && away.y.abs() < 0.0151;
        if inside { -Vec3::z() * area.z } else { Vec3::zeros() }
    };
    all.push(("press", Box::new(move |b, m| on_surface(b, m, &press))));
    all
}

/// Half of the body in the nodes of the level before the finest, the other half in their children.
fn halves(body: &Body, size: Vec3) -> State {
    let far = |n: &Node| body.rest(*n).x > 0.5 * size.x && !body.children(*n).is_empty();
    let (split, kept): (Vec<Node>, Vec<Node>) = body.nodes_of(body.finest() - 1).partition(far);
    let nodes = kept.into_iter().chain(split.iter().flat_map(|n| body.children(*n).iter().copied()));
    State::at_rest_on(body, nodes.collect()).unwrap()
}

/// Work of each load on each level over that on the finest − 1, and of a mixed set.
fn compared(name: &str, body: &Body, size: Vec3, most: &[Real], most_mixed: Real) {
    let finest = body.finest();
    println!("{name}: α {:.3?}", body.levels().iter().map(|l| l.stabilisation).collect::<Vec<_>>());
    for (what, load) in loads(size) {
        let work = |state: &State| {
            let mut mesh = ActiveMesh::new(body, state, usize::MAX).unwrap();
            let load = load(body, &mesh);
            work(body, &mut mesh, &load)
        };
        let of_finest = work(&State::at_rest(body, finest));
        let off: Vec<Real> = (0..finest).map(|r| work(&State::at_rest(body, r)) / of_finest - 1.0).collect();
        let mixed = work(&halves(body, size)) / of_finest - 1.0;
        let percent: Vec<String> = off.iter().chain([&mixed]).map(|x| format!("{:+.1}", 100.0 * x)).collect();
        println!("{name}, {what}: {} % (the last of a mixed set)", percent.join(", "));
        for (r, (off, most)) in off.iter().zip(most).enumerate() {
            assert!(off.abs() < *most, "{name}, {what}: level {r} gives way {off} more");
        }
        assert!(mixed.abs() < most_mixed, "{name}, {what}: a mixed set gives way {mixed} more");
    }
}

#[test]
fn smoothed_levels_answer_alike_up_to_incompressible() {
    let cube = Vec3::repeat(0.1);
    for nu in [0.3, 0.49, 0.499] {
        let body = body(cover(cube, &[0.0333, 0.02, 0.0125]), cube, nu, true, 0.0);
        compared(&format!("cube, ν = {nu}"), &body, cube, &[0.1, 0.04], 0.03);
    }
    // The coarsest of these is wider than 2/3 of the bar.
    let (bar, spacings) = (Vec3::new(0.2, 0.04, 0.04), [0.03, 0.018, 0.01]);
    let of_bar = body(cover(bar, &spacings), bar, 0.45, true, 0.0);
    compared("bar 5:1, ν = 0.45", &of_bar, bar, &[0.1, 0.05], 0.03);
    let slender = Vec3::new(0.3, 0.03, 0.03);
    let of_slender = body(cover(slender, &[0.0135, 0.0085]), slender, 0.45, true, 0.0);
    compared("bar 10:1, ν = 0.45", &of_slender, slender, &[0.05], 0.03);
    let across = Bounds::new(Vec3::new(0.067, -1.0, -1.0), Vec3::new(0.133, 1.0, 1.0));
    let plain = Material::from_young(YOUNGS_MODULUS, 0.3, 1000.0);
    let of_layer = |layer| body_of(cover(bar, &spacings), bar, plain, true, 0.0, Some(layer));
    compared("bar 5:1 with a stiff layer across", &of_layer(across), bar, &[0.1, 0.05], 0.04);
    // Elements that are wider than a layer cannot show how it bends the bar.
    let along = Bounds::new(Vec3::repeat(-1.0), Vec3::new(1.0, 1.0, 0.013));
    compared("bar 5:1 with a stiff layer along", &of_layer(along), bar, &[0.3, 0.15], 0.08);
}

#[test]
fn smoothed_elements_are_exact_in_uniform_stress() {
    let size = Vec3::new(0.1, 0.08, 0.06);
    for nu in [0.3, 0.49, 0.499] {
        let material = Material::from_young(YOUNGS_MODULUS, nu, 1000.0);
        let shapes = [
            ("cover", cover(size, &[0.03, 0.018, 0.011]), 0.02),
            ("meshes", Shape::meshes([[3, 2, 2], [5, 4, 3], [9, 7, 5]].map(|cells| box_mesh(size, cells))), 1e-4),
        ];
        for (name, shape, most) in shapes {
            let body = body(shape, size, nu, false, 0.0);
            let states = (0..3).map(|r| State::at_rest(&body, r)).chain([halves(&body, size)]);
            for (i, state) in states.enumerate() {
                let off = |stress: Mat3, expected: Real| compliance(&body, &state, stress) / expected - 1.0;
                let along = |axis: usize| Mat3::from_diagonal(&Vec3::ith(axis, 1.0));
                let mut all: Vec<Real> = (0..3).map(|axis| off(along(axis), 1.0 / YOUNGS_MODULUS)).collect();
                let mut shear = Mat3::zeros();
                (shear[(0, 1)], shear[(1, 0)]) = (1.0, 1.0);
                all.push(off(shear, 1.0 / material.mu));
                println!("{name}, ν = {nu}, set {i}: {all:+.5?}");
                // Interface rows carry affine fields, quarter weights between levels do not quite.
                let most = if i == 3 { 0.025 } else { most };
                assert!(all.iter().all(|off| off.abs() < most), "{name}, ν = {nu}, set {i}: {all:?}");
            }
        }
    }
}

/// Strain energy density over half of the squared stress in `body`, free and of the active nodes of `state`, under this uniform stress.
fn compliance(body: &Body, state: &State, stress: Mat3) -> Real {
    let mut mesh = ActiveMesh::new(body, state, usize::MAX).unwrap();
    let load = on_surface(body, &mesh, &|_, area| stress * area);
    work(body, &mut mesh, &load) / body.parts().shape.volume
}

/// With fibres along a slanted direction a body is the transversely isotropic solid that textbooks have: Young's modulus along them is
/// `E + K`, across them and in shear it is what the matrix and the fibres give together.
#[test]
fn fibres_make_a_body_stiffer_along_them_as_the_closed_form_says() {
    let size = Vec3::new(0.1, 0.08, 0.06);
    let a = Vec3::new(2.0, 1.0, -0.5).normalize();
    let across = a.cross(&Vec3::z()).normalize();
    for (nu, factor) in [(0.3, 10.0), (0.45, 3.0), (0.49, 30.0)] {
        let fibres = Fibres { modulus: factor * YOUNGS_MODULUS, direction: a };
        let material = Material { fibres, ..Material::from_young(YOUNGS_MODULUS, nu, 1000.0).as_neo_hookean() };
        let uniaxial = |n: &Vec3| n * n.transpose();
        let shear = a * across.transpose() + across * a.transpose();
        // ε of a stress σ: the matrix's answer, less that of the tension `t = K a·ε a` of the fibres, which the matrix bears too.
        let of_matrix = |s: &Mat3| s / (2.0 * material.mu) - Mat3::identity() * (nu / YOUNGS_MODULUS * s.trace());
        let expected = |s: &Mat3| {
            let (alone, unit) = (a.dot(&(of_matrix(s) * a)), a.dot(&(of_matrix(&uniaxial(&a)) * a)));
            let tension = fibres.modulus * alone / (1.0 + fibres.modulus * unit);
            s.dot(&of_matrix(&(s - uniaxial(&a) * tension)))
        };
        let along = expected(&uniaxial(&a)) * (YOUNGS_MODULUS + fibres.modulus);
        assert!((along - 1.0).abs() < 1e-12, "{along}");
        let shapes = [
            ("cover", cover(size, &[0.03, 0.018, 0.011]), 0.03),
            ("meshes", Shape::meshes([[3, 2, 2], [5, 4, 3], [9, 7, 5]].map(|cells| box_mesh(size, cells))), 1e-4),
        ];
        for (name, shape, most) in shapes {
            let body = body_of(shape, size, material, false, 0.0, None);
            let states = (0..3).map(|r| State::at_rest(&body, r)).chain([halves(&body, size)]);
            for (i, state) in states.enumerate() {
                let stresses = [uniaxial(&a), uniaxial(&across), uniaxial(&Vec3::z()), shear];
                let off = stresses.map(|s| compliance(&body, &state, s) / expected(&s) - 1.0);
                println!("{name}, ν = {nu}, K = {factor} E, set {i}: {off:+.5?}");
                let most = if i == 3 { 0.05 } else { most };
                assert!(off.iter().all(|off| off.abs() < most), "{name}, ν = {nu}, set {i}: {off:?}");
            }
        }
    }
}

fn simulation(body: &Arc<Body>, state: State) -> Simulation {
    let settings = Settings {
        gravity: Vec3::zeros(),
        tools: vec![],
        obstacles: vec![],
        organ_friction: Default::default(),
        support_motions: vec![],
        following: Following { speed: 1.0, engage_ticks: 1 },
        limits: ForceLimits { force: 100.0, torque: 10.0, slew: 1e6 },
        adaptivity: None,
        most_elements: usize::MAX,
    };
    let snapshot = Snapshot { body: state, ..Snapshot::at_rest(body, 0, 0) };
    Simulation::new(body.clone(), settings, snapshot).unwrap()
}

fn energy_of(simulation: &Simulation) -> Energy {
    energy(simulation.body(), simulation.mesh(), Vec3::zeros())
}

#[test]
fn smoothed_elements_keep_energy_and_momenta_and_go_on_from_a_snapshot() {
    let size = Vec3::repeat(0.1);
    let body = Arc::new(body(cover(size, &[0.0333, 0.02, 0.0125]), size, 0.45, false, 0.0));
    let mut free = simulation(&body, halves(&body, size));
    // Stretched, sheared and turning.
    free.mesh_mut().change_motion(|n, x, v| {
        let d = body.rest(n) - size / 2.0;
        *x += Vec3::new(0.03 * d.x, 0.02 * d.x - 0.01 * d.y, 0.0);
        *v = Vec3::new(0.1, 0.0, 0.05) + Vec3::new(1.0, 2.0, -1.0).cross(&d);
    });
    let before = energy_of(&free);
    let (mut least, mut most) = (before.total(), before.total());
    let mut copy = None;
    for tick in 0..2000 {
        free.advance(&Inputs::default());
        if tick % 10 == 0 {
            let now = energy_of(&free).total();
            (least, most) = (least.min(now), most.max(now));
        }
        if tick == 1000 {
            copy = Some(Simulation::new(body.clone(), free.settings().clone(), free.snapshot()).unwrap());
        }
        if let Some(copy) = copy.as_mut().filter(|_| tick > 1000) {
            copy.advance(&Inputs::default());
            // A body is looked at from where it started: that is not the state's.
            assert_eq!(copy.snapshot().body, free.snapshot().body, "tick {tick}");
        }
    }
    let after = energy_of(&free);
    let linear = (after.linear_momentum - before.linear_momentum).norm() / before.linear_momentum.norm();
    let angular = (after.angular_momentum - before.angular_momentum).norm() / before.angular_momentum.norm();
    let range = (most - least) / before.total();
    println!("energy within {range:.1e} of {:.3e} J, momenta within {linear:.1e} and {angular:.1e}", before.total());
    assert!(range < 5e-3 && linear < 1e-11 && angular < 1e-11, "{range}, {linear}, {angular}");
}

#[test]
fn smoothed_levels_swing_and_fade_alike_as_asked() {
    let (size, zeta) = (Vec3::new(0.1, 0.05, 0.05), 0.1);
    let body = Arc::new(body(cover(size, &[0.022, 0.013, 0.008]), size, 0.45, true, zeta));
    let swings: Vec<(Real, Real)> = (0..3)
        .map(|r| State::at_rest(&body, r))
        .chain([halves(&body, size)])
        .map(|state| {
            let mut swing = simulation(&body, state);
            swing.mesh_mut().change_motion(|n, x, _| x.z += 0.02 * (body.rest(n).x / size.x).powi(2) * size.z);
            let along = |simulation: &Simulation| -> Real {
                let mesh = simulation.mesh();
                mesh.active()
                    .iter()
                    .map(|s| mesh.motion.mass[s.index()] * (mesh.position(*s) - body.rest(mesh.node(*s))).z)
                    .sum()
            };
            let signal: Vec<Real> = (0..2500)
                .map(|_| {
                    swing.advance(&Inputs::default());
                    along(&swing)
                })
                .collect();
            let peaks: Vec<(Real, Real)> = signal
                .windows(3)
                .enumerate()
                .filter(|(_, w)| w[1] > w[0] && w[1] >= w[2] && w[1] > 0.0)
                .map(|(i, w)| {
                    let bend = 2.0 * w[1] - w[0] - w[2];
                    let ahead = (w[2] - w[0]) / (2.0 * bend);
                    ((i as Real + 1.0 + ahead) * 1e-3, w[1] + 0.25 * (w[2] - w[0]) * ahead)
                })
                .collect();
            let (first, last) = (peaks[1], peaks[4]);
            let decrement = (first.1 / last.1).ln() / 3.0;
            (3.0 / (last.0 - first.0), decrement / (4.0 * std::f64::consts::PI.powi(2) + decrement * decrement).sqrt())
        })
        .collect();
    println!("frequency [Hz] and damping ratio of each level, and of a mixed set: {swings:.4?}");
    let finest = swings[2];
    for (frequency, ratio) in &swings {
        assert!((frequency / finest.0 - 1.0).abs() < 0.03, "{frequency} Hz");
        assert!((ratio / finest.1 - 1.0).abs() < 0.05 && (ratio / zeta - 1.0).abs() < 0.1, "{ratio}");
    }
}

#[test]
fn a_bar_of_two_smoothed_elements_is_refined_where_it_bends_under_its_weight() {
    let size = Vec3::new(0.2, 0.04, 0.04);
    let body = Arc::new(body(cover(size, &[0.02, 0.0125]), size, 0.45, true, 0.1));
    let refined = |weight: Real| {
        let settings = Settings {
            gravity: Vec3::z() * -weight,
            adaptivity: Some(Adaptivity::default()),
            ..simulation(&body, State::at_rest(&body, 0)).settings().clone()
        };
        let mut bar = Simulation::new(body.clone(), settings, Snapshot::at_rest(&body, 0, 0)).unwrap();
        let [settled, later] = [2000, 500].map(|ticks| {
            for _ in 0..ticks {
                bar.advance(&Inputs::default());
                bar.mesh_mut().change_motion(|_, _, v| *v *= 0.98);
            }
            let fine = bar.mesh().active().iter().map(|slot| bar.mesh().node(*slot)).filter(|n| body.level_of(*n) == 1);
            fine.collect::<Vec<Node>>()
        });
        assert!(settled.iter().all(|n| later.contains(n)), "what was refined is merged again");
        let farthest = settled.iter().map(|n| body.rest(*n).x).fold(0.0, Real::max);
        println!("under {weight} m/s²: {} fine nodes, as far as {farthest} m", settled.len());
        (settled.len(), farthest)
    };
    assert_eq!(refined(0.1).0, 0);
    let (fine, farthest) = refined(4.0);
    assert!(fine > 20 && farthest < 0.5 * size.x, "{fine} nodes, as far as {farthest} m");
}
