//! experiment
use palpate_body::prepare::{Recipe, Region, Shape, prepare};
use palpate_core::geometry::primitives::{box_mesh, box_surface};
use palpate_core::math::{Bounds, Real, Vec3};
use palpate_core::model::element_kernel::Simd;
use palpate_core::model::{ActiveMesh, Body, Material, State};
use palpate_core::stepping::step;

/// Displacements at rest under small forces (by slot) by conjugate gradients on differences of the core's own forces.
fn rest(body: &Body, mesh: &mut ActiveMesh, load: &[Vec3], free: bool) -> Vec<Vec3> {
    let slots: Vec<_> = mesh.active().to_vec();
    let n = slots.len();
    let rest: Vec<Vec3> = slots.iter().map(|s| body.rest(mesh.node(*s))).collect();
    let fixed: Vec<bool> = slots.iter().map(|s| body.is_fixed(mesh.node(*s))).collect();
    let eps = 1e-7;
    let mut apply = |u: &[Vec3]| -> Vec<Vec3> {
        let most = u.iter().map(|u| u.norm()).fold(0.0, Real::max);
        let h = if most > 0.0 { eps / most } else { 1.0 };
        let mut side = |sign: Real| {
            for (i, s) in slots.iter().enumerate() {
                let x = rest[i] + u[i] * (h * sign);
                mesh.motion.position[s.index()] = [x.x, x.y, x.z, 0.0];
                mesh.motion.force[s.index()] = [0.0; 4];
            }
            for s in mesh.interface().to_vec() {
                mesh.motion.force[s.index()] = [0.0; 4];
            }
            step::add_elastic_forces(Simd::best(), mesh);
            slots
                .iter()
                .map(|s| {
                    let f = mesh.motion.force[s.index()];
                    Vec3::new(f[0], f[1], f[2])
                })
                .collect::<Vec<_>>()
        };
        let (a, b) = (side(1.0), side(-1.0));
        (0..n).map(|i| if fixed[i] { Vec3::zeros() } else { (b[i] - a[i]) / (2.0 * h) }).collect()
    };
    let project = |r: &mut Vec<Vec3>| {
        if free {
            // balanced: remove the mean and the moment
            let c: Vec3 = rest.iter().sum::<Vec3>() / n as Real;
            let m: Vec3 = r.iter().sum::<Vec3>() / n as Real;
            r.iter_mut().for_each(|r| *r -= m);
            let mut inertia = nalgebra::Matrix3::zeros();
            let mut t = Vec3::zeros();
            for i in 0..n {
                let d = rest[i] - c;
                inertia += nalgebra::Matrix3::identity() * d.norm_squared() - d * d.transpose();
                t += d.cross(&r[i]);
            }
            let w = inertia.try_inverse().unwrap() * t;
            for i in 0..n {
                let d = rest[i] - c;
                r[i] -= w.cross(&d);
            }
        }
    };
    let dot = |a: &[Vec3], b: &[Vec3]| a.iter().zip(b).map(|(a, b)| a.dot(b)).sum::<Real>();
    let mut x = vec![Vec3::zeros(); n];
    let mut r: Vec<Vec3> = load.iter().zip(&fixed).map(|(l, f)| if *f { Vec3::zeros() } else { *l }).collect();
    project(&mut r);
    let mut p = r.clone();
    let mut rr = dot(&r, &r);
    let enough = 1e-8 * rr;
    for k in 0..3000 {
        let q = apply(&p);
        let a = rr / dot(&p, &q);
        for i in 0..n {
            x[i] += p[i] * a;
            r[i] -= q[i] * a;
        }
        let next = dot(&r, &r);
        if next < enough {
            break;
        }
        assert!(k < 2999, "no rest");
        let b = next / rr;
        rr = next;
        for i in 0..n {
            p[i] = r[i] + p[i] * b;
        }
    }
    x
}

fn compliance(
    body: &Body,
    level: usize,
    load: &dyn Fn(&Vec3) -> Vec3,
    traction: Option<&dyn Fn(&Vec3, &Vec3) -> Vec3>,
) -> Real {
    let state = State::at_rest(body, level);
    let mut mesh = ActiveMesh::new(body, &state, usize::MAX).unwrap();
    let slots = mesh.active().to_vec();
    let mut f = vec![Vec3::zeros(); mesh.motion.mass.len()];
    match traction {
        None => {
            for s in &slots {
                f[s.index()] += load(&body.rest(mesh.node(*s))) * mesh.motion.mass[s.index()];
            }
        }
        Some(t) => {
            let surface = body.surface();
            for tri in &surface.triangles {
                let [a, b, c] = tri.map(|v| surface.vertices[v as usize]);
                let n = (b - a).cross(&(c - a)) * 0.5;
                for v in tri {
                    let e = mesh.embedding(palpate_core::ids::Vertex(*v));
                    let force = t(&surface.vertices[*v as usize], &n) / 3.0;
                    for (s, w) in e.slots.iter().zip(e.weights) {
                        f[s.index()] += force * w;
                    }
                }
            }
        }
    }
    let load: Vec<Vec3> = slots.iter().map(|s| f[s.index()]).collect();
    let held = !body.supports().is_empty() || body.nodes().any(|n| body.is_fixed(n));
    let u = rest(body, &mut mesh, &load, !held);
    u.iter().zip(&load).map(|(u, f)| u.dot(f)).sum()
}

#[test]
fn table() {
    let cover = std::env::var("COVER").is_ok();
    for (name, size, spacings, cells) in [
        (
            "cube",
            Vec3::new(0.1, 0.1, 0.1),
            vec![0.0333, 0.02, 0.0125, 0.0083],
            vec![[3u32; 3], [5; 3], [8; 3], [12; 3]],
        ),
        (
            "bar 5:1",
            Vec3::new(0.2, 0.04, 0.04),
            vec![0.03, 0.018, 0.01, 0.006],
            vec![[7, 2, 2], [11, 2, 2], [20, 4, 4], [33, 7, 7]],
        ),
        (
            "plate",
            Vec3::new(0.1, 0.1, 0.02),
            vec![0.025, 0.016, 0.01, 0.006],
            vec![[4, 4, 1], [6, 6, 2], [10, 10, 2], [17, 17, 4]],
        ),
    ] {
        for nu in [0.3, 0.45, 0.49] {
            let material = Material::from_young(1e4, nu, 1000.0);
            let exact = !cover;
            let clamp = Region {
                bounds: Bounds::new(Vec3::repeat(-1e-6), Vec3::new(1e-6, size.y, size.z)),
                stiffness: None,
                exact,
            };
            let shape = || {
                if cover {
                    let n = 40.0 / size.max();
                    let s = size * n;
                    Shape::closed(box_surface(size, [s.x as u32, s.y as u32, s.z as u32]), spacings.clone())
                } else {
                    Shape::meshes(cells.iter().map(|c| box_mesh(size, *c)))
                }
            };
            let of = |holds| {
                prepare(
                    &Recipe {
                        name: "b".into(),
                        shape: shape(),
                        material,
                        inclusions: vec![],
                        holds,
                        damping_ratio: 0.0,
                    },
                    &mut |_, _, _| {},
                )
                .unwrap()
            };
            let (held, free) = (of(vec![clamp]), of(vec![]));
            let half = size / 2.0;
            let levels = held.levels().len();
            let row = |label: &str,
                       body: &Body,
                       load: &dyn Fn(&Vec3) -> Vec3,
                       t: Option<&dyn Fn(&Vec3, &Vec3) -> Vec3>,
                       truth: Option<Real>| {
                let c: Vec<Real> = (0..levels).map(|l| compliance(body, l, load, t)).collect();
                let finest = truth.unwrap_or(c[levels - 1]);
                print!("{name} nu {nu} {label:>8}:");
                c.iter().for_each(|c| print!(" {:+6.1}", 100.0 * (c / finest - 1.0)));
                println!();
            };
            let none = |_: &Vec3| Vec3::zeros();
            row("gx", &held, &|_| Vec3::x(), None, None);
            row("gy", &held, &|_| Vec3::y(), None, None);
            row("gz", &held, &|_| Vec3::z(), None, None);
            let c = half;
            row("torsion", &held, &|x| Vec3::x().cross(&(x - c)), None, None);
            let v = size.x * size.y * size.z;
            let e = 1e4;
            for (i, l) in ["sxx", "syy", "szz"].iter().enumerate() {
                let mut s = nalgebra::Matrix3::zeros();
                s[(i, i)] = 1.0;
                row(l, &free, &none, Some(&|_, n| s * n), Some(v / e));
            }
            let mut s = nalgebra::Matrix3::zeros();
            s[(0, 1)] = 1.0;
            s[(1, 0)] = 1.0;
            row("sxy", &free, &none, Some(&|_, n| s * n), Some(v / material.mu));
            let press = |x: &Vec3, n: &Vec3| {
                if n.z > 0.0 && x.z > size.z - 1e-9 && (x.x - half.x).abs() < 0.0151 && (x.y - half.y).abs() < 0.0151 {
                    -Vec3::z() * n.z
                } else {
                    Vec3::zeros()
                }
            };
            row("press", &held, &none, Some(&press), None);
        }
    }
}
