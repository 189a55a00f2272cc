//! The slowest modes do not tell which nodes are active.

use super::*;
use palpate_core::model::element_kernel::{Rates, Simd};

/// Displacements small enough for the forces to be linear in them: strains of 1e-5 leave 1e-5 of them, and differences
/// of forces 1e-10.
const SMALL: Real = 1e-6;

/// The mesh about its rest shape, as the linear system it is there.
struct Linear<'a> {
    body: &'a Body,
    mesh: ActiveMesh,
    rest: Vec<Vec3>,
    mass: Vec<Real>,
}

impl<'a> Linear<'a> {
    fn new(body: &'a Body, nodes: Vec<Node>) -> Self {
        let mesh = mesh_on(body, nodes);
        let rest = mesh.active().iter().map(|s| body.rest(mesh.node(*s))).collect();
        let mass = mesh.active().iter().map(|s| mesh.motion.mass[s.index()]).collect();
        Self { body, mesh, rest, mass }
    }

    /// Forces with the active nodes displaced by `scale · u`, added to `sum` times `factor`.
    fn add_forces(&mut self, u: &[Vec3], scale: Real, factor: Real, sum: &mut [Vec3]) {
        let mut i = 0;
        let rest = &self.rest;
        self.mesh.change_motion(|_, x, _| {
            *x = rest[i] + u[i] * scale;
            i += 1;
        });
        for class in 0..8 {
            self.mesh.add_forces(Simd::best(), class, &Rates::ELASTIC);
        }
        for hold in self.body.supports() {
            let stretch = self.body.surface().vertices[hold.vertex.index()] - self.mesh.vertex(hold.vertex);
            let attachment = *self.mesh.embedding(hold.vertex);
            for (slot, w) in attachment.slots.iter().zip(attachment.weights) {
                for c in 0..3 {
                    self.mesh.motion.force[slot.index()][c] += stretch[c] * hold.stiffness * w;
                }
            }
        }
        self.mesh.hand_back_all();
        let (active, motion) = self.mesh.active_motion();
        for (sum, slot) in sum.iter_mut().zip(active) {
            let f = std::mem::take(&mut motion.force[slot.index()]);
            *sum += Vec3::new(f[0], f[1], f[2]) * factor;
        }
    }

    /// `M^(-1/2) K M^(-1/2) y`, by central differences of the mesh's own forces.
    fn stiffness(&mut self, y: &[Vec3]) -> Vec<Vec3> {
        let u: Vec<Vec3> = y.iter().zip(&self.mass).map(|(y, m)| y / m.sqrt()).collect();
        let scale = SMALL / u.iter().map(|u| u.norm()).fold(0.0, Real::max);
        let mut force = vec![Vec3::zeros(); u.len()];
        self.add_forces(&u, scale, -0.5 / scale, &mut force);
        self.add_forces(&u, -scale, 0.5 / scale, &mut force);
        force.iter().zip(&self.mass).map(|(f, m)| f / m.sqrt()).collect()
    }

    /// `z` such that the stiffness of it is `y`, by conjugate gradients from `start`.
    fn solve(&mut self, y: &[Vec3], start: Vec<Vec3>) -> Vec<Vec3> {
        let mut z = start;
        let applied = self.stiffness(&z);
        let mut r: Vec<Vec3> = y.iter().zip(&applied).map(|(y, a)| y - a).collect();
        let mut p = r.clone();
        let mut rr = dot(&r, &r);
        let enough = 1e-8 * dot(y, y);
        for _ in 0..400 {
            if rr < enough {
                break;
            }
            let applied = self.stiffness(&p);
            let step = rr / dot(&p, &applied);
            add(&mut z, step, &p);
            add(&mut r, -step, &applied);
            let next = dot(&r, &r);
            p.iter_mut().zip(&r).for_each(|(p, r)| *p = r + *p * (next / rr));
            rr = next;
        }
        z
    }

    /// The lowest three angular frequencies [rad/s], by inverse iteration of five vectors.
    fn slowest(&mut self) -> [Real; 3] {
        let centre = self.body.centre_of_mass();
        let root: Vec<Real> = self.mass.iter().map(|m| m.sqrt()).collect();
        let smooth: [&dyn Fn(Vec3) -> Vec3; 5] = [
            &|u| Vec3::y() * u.x,
            &|u| Vec3::z() * u.x,
            &|u| Vec3::x().cross(&(u - centre)) * u.x,
            &|u| Vec3::x() * u.x,
            &|u| Vec3::y() * u.x * (u.x - 0.6 * SIDE),
        ];
        let mut y: Vec<Vec<Vec3>> =
            smooth.iter().map(|f| self.rest.iter().zip(&root).map(|(u, m)| f(*u) * *m).collect()).collect();
        let mut values = [0.0; 5];
        for round in 0..12 {
            let last = values;
            let mut next: Vec<Vec<Vec3>> = Vec::new();
            for (y, value) in y.iter().zip(values) {
                let start: Vec<Vec3> = y.iter().map(|y| if value > 0.0 { y / value } else { Vec3::zeros() }).collect();
                let start = if round == 0 { y.iter().map(|y| y * 1e-3).collect() } else { start };
                next.push(self.solve(y, start));
            }
            orthonormalise(&mut next);
            let applied: Vec<Vec<Vec3>> = next.iter().map(|y| self.stiffness(y)).collect();
            let small = nalgebra::SMatrix::<Real, 5, 5>::from_fn(|i, j| {
                0.5 * (dot(&next[i], &applied[j]) + dot(&next[j], &applied[i]))
            });
            let eigen = small.symmetric_eigen();
            let mut order = [0, 1, 2, 3, 4];
            order.sort_by(|a, b| eigen.eigenvalues[*a].total_cmp(&eigen.eigenvalues[*b]));
            for (k, &of) in order.iter().enumerate() {
                values[k] = eigen.eigenvalues[of];
                let mut sum = vec![Vec3::zeros(); root.len()];
                next.iter().enumerate().for_each(|(i, y)| add(&mut sum, eigen.eigenvectors[(i, of)], y));
                y[k] = sum;
            }
            if (0..3).all(|k| (values[k] / last[k] - 1.0).abs() < 1e-5) {
                break;
            }
        }
        [values[0].sqrt(), values[1].sqrt(), values[2].sqrt()]
    }
}

fn dot(a: &[Vec3], b: &[Vec3]) -> Real {
    a.iter().zip(b).map(|(a, b)| a.dot(b)).sum()
}

fn add(to: &mut [Vec3], factor: Real, of: &[Vec3]) {
    to.iter_mut().zip(of).for_each(|(to, of)| *to += of * factor);
}

fn orthonormalise(vectors: &mut [Vec<Vec3>]) {
    for i in 0..vectors.len() {
        let (done, rest) = vectors.split_at_mut(i);
        for other in done.iter() {
            let part = dot(&rest[0], other);
            add(&mut rest[0], -part, other);
        }
        let length = dot(&rest[0], &rest[0]).sqrt();
        rest[0].iter_mut().for_each(|v| *v /= length);
    }
}

fn cube() -> Cube {
    Cube { spacings: vec![0.030, 0.020, 0.0135], ..elastic_cube(1e4, true) }
}

#[test]
fn the_three_slowest_modes_are_those_of_the_finest_level_whatever_is_active() {
    let body = cube().body();
    report(&body);
    let finest = Linear::new(&body, uniform(&body, body.finest())).slowest();
    println!("finest: {finest:.3?} rad/s");
    let mut worst = [0.0 as Real; 3];
    let mut sets: Vec<(String, Vec<Node>)> =
        (0..body.finest()).map(|r| (format!("level {r}"), uniform(&body, r))).collect();
    sets.extend((0..8).map(|seed| (format!("set {seed}"), random_set(&body, &mut Random(seed)))));
    // Scattered as no tool leaves it: as many interfaces as there can be.
    for seed in 0..3 {
        let mut random = Random(seed);
        let mut mesh = mesh_on(&body, uniform(&body, 1));
        for _ in 0..40 {
            let changes = random_changes(&body, mesh.set(), &mut random);
            mesh.apply(&body, &changes);
        }
        sets.push((format!("walk {seed}"), active_nodes(&body, mesh.set())));
    }
    for (name, nodes) in sets {
        let count = nodes.len();
        let modes = Linear::new(&body, nodes).slowest();
        let off: [Real; 3] = std::array::from_fn(|k| modes[k] / finest[k] - 1.0);
        println!("{name}, {count} nodes: {:+.2?} %", off.map(|o| o * 100.0));
        let most = off.iter().fold(0.0 as Real, |most, o| most.max(o.abs()));
        let of = ["level", "set", "walk"].iter().position(|kind| name.starts_with(kind)).unwrap();
        worst[of] = worst[of].max(most);
    }
    // Of levels, of mixed sets, and of ones that are scattered as no tool leaves them, whose elements only partly count.
    let is_fine = worst[0] < 0.03 && worst[1] < 0.025 && worst[2] < 0.02;
    assert!(is_fine, "modes of levels, mixed and scattered sets are off by {worst:.4?}");
}

/// The swing of a body whose set changes all the time, against one of the finest level.
#[test]
fn a_body_whose_set_changes_while_it_swings_keeps_time() {
    let body = cube().body();
    let run = |seed: Option<u64>, every: usize| -> (Vec<Real>, usize) {
        let level = if seed.is_some() { 1 } else { body.finest() };
        let start = sagging(&body, uniform(&body, level), Vec3::new(0.0, 0.0, -1.0), 1200);
        let mut swing = with_settings(&start, &settings(None));
        let mut random = Random(seed.unwrap_or(0));
        let mut made = 0;
        let signal = (0..4000)
            .map(|i| {
                if seed.is_some() && i % every == every - 1 {
                    let changes = random_changes(&body, swing.mesh().set(), &mut random);
                    made += changes.len();
                    swing.mesh_mut().apply(&body, &changes);
                }
                assert!(!swing.advance(&Inputs::default()).restored);
                mean_displacement(&body, swing.mesh()).z
            })
            .collect();
        (signal, made)
    };
    let finest = run(None, 1).0;
    let largest = |signal: &[Real]| signal.iter().fold(0.0 as Real, |most, x| most.max(x.abs()));
    println!("finest: period {:.2} ms, swings by {:.3} mm", period(&finest) * 1e3, largest(&finest) * 1e3);
    for (seed, every) in [(0, 20), (1, 20), (2, 60), (3, 200)] {
        let (signal, made) = run(Some(seed), every);
        let off = period(&signal) / period(&finest) - 1.0;
        let late = largest(&signal[3000..]) / largest(&finest[3000..]);
        println!(
            "walk {seed}, {made} changes: period {:+.2} %, amplitude in the last second {late:.3} of that",
            off * 100.0
        );
        assert!(made > 50);
        // Scattered sets are softer by a per cent or two; the two slowest modes are so close that zeros tell the
        // period to half a per cent.
        assert!(off.abs() < 0.03, "{off}");
        // Every change takes or gives a little energy; on the whole it must not build up.
        assert!(late < 1.05 && late > 0.7, "the swing comes to {late} of what it should be");
    }
}
