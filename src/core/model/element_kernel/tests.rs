//! The kernel gives the forces of the law, in every form to the same bit.

use super::super::element_pool::{ElementConstants, History, Kind, Pool};
use super::super::fibres::Fibres;
use super::super::material::Material;
use super::*;
use crate::ids::{Element, Node, Slot};
use crate::math::{Mat3, Vec3, components, symmetric};

/// Numbers in ±1 that look random.
struct Noise(u64);

impl Noise {
    fn next(&mut self) -> Real {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        (self.0 >> 11) as Real / (1u64 << 52) as Real - 1.0
    }
    fn vector(&mut self) -> Vec3 {
        Vec3::new(self.next(), self.next(), self.next())
    }
    fn below(&mut self, n: usize) -> usize {
        ((self.next() * 0.5 + 0.5) * n as Real) as usize % n
    }
}

fn edges(x: &[Vec3], n: [u32; 4]) -> Mat3 {
    let at = |i: usize| x[n[i] as usize];
    Mat3::from_columns(&[at(1) - at(0), at(2) - at(0), at(3) - at(0)])
}

type Constants = ElementConstants<Vec<[Real; 3]>>;

/// Elements between random nodes, each of another stiffness: tetrahedra, or stars of three to nine neighbours.
struct Soup {
    rest: Vec<Vec3>,
    elements: Vec<(Vec<u32>, Constants)>,
}

impl Soup {
    fn new(noise: &mut Noise, nodes: usize, count: usize) -> Self {
        let rest: Vec<_> = (0..nodes).map(|_| noise.vector() * 0.01).collect();
        let mut elements = vec![];
        while elements.len() < count {
            let mut n = [0; 4].map(|_: u32| noise.below(nodes) as u32);
            let volume = edges(&rest, n).determinant() / 6.0;
            if volume.abs() < 1e-8 {
                continue;
            }
            if volume < 0.0 {
                n.swap(2, 3);
            }
            let g = edges(&rest, n).try_inverse().expect("a volume");
            let gradient = [0, 1, 2].map(|i| [0, 1, 2].map(|c| g[(i, c)])).to_vec();
            elements.push((n.to_vec(), stiff(noise, volume.abs(), gradient)));
        }
        Self { rest, elements }
    }

    /// Stars of which the neighbours' gradients reproduce every affine field.
    fn stars(noise: &mut Noise, nodes: usize, count: usize) -> Self {
        let rest: Vec<_> = (0..nodes).map(|_| noise.vector() * 0.01).collect();
        let mut elements = vec![];
        while elements.len() < count {
            let n: Vec<u32> = (0..4 + noise.below(7)).map(|_| noise.below(nodes) as u32).collect();
            let edges: Vec<Vec3> = n[1..].iter().map(|m| rest[*m as usize] - rest[n[0] as usize]).collect();
            let weights: Vec<Real> = edges.iter().map(|_| 1.5 + noise.next()).collect();
            let gram: Mat3 = edges.iter().zip(&weights).map(|(d, w)| d * d.transpose() * *w).sum();
            let inverse = gram.try_inverse().filter(|inverse| inverse.norm() < 2e4);
            let Some(inverse) = inverse else { continue };
            let gradient = edges.iter().zip(weights).map(|(d, w)| (inverse * d * w).into()).collect();
            elements.push((n, stiff(noise, 1e-7, gradient)));
        }
        Self { rest, elements }
    }

    /// Each of one of both laws or of a mixture, some with fibres, and with more or less of the term against collapse.
    fn of_all_laws(mut self, noise: &mut Noise) -> Self {
        for (_, constants) in &mut self.elements {
            constants.neo_hookean = [0.0, 1.0, 0.5 + 0.4 * noise.next()][noise.below(3)];
            constants.collapse = [0.0, 1.0, 12.0][noise.below(3)];
            let modulus = [0.0, 30.0 * constants.mu][noise.below(2)];
            constants.fibres = Fibres { modulus, direction: noise.vector().normalize() }.rows(1.0);
        }
        self
    }

    fn pool<I: Kind>(&self, branches: usize) -> Pool<I> {
        let count = self.elements.len();
        let spokes = self.elements.iter().map(|(n, _)| n.len() - 1).max().unwrap_or(3);
        let materials: Vec<Material> = self.elements.iter().map(|(_, constants)| material(constants)).collect();
        let mut pool = Pool::<I>::with_spokes(count, count, self.rest.len(), spokes, branches).of_materials(&materials);
        for (id, (nodes, constants)) in self.elements.iter().enumerate() {
            assert!(pool.insert(I::at(id), 5, &slots(nodes), constants, &History::REST));
        }
        pool
    }

    /// The nodes moved by `amount` element sizes; a quarter of the calls mirrors or crushes the whole.
    fn moved(&self, noise: &mut Noise, amount: Real) -> Vec<Vec3> {
        let shape = Mat3::from_diagonal(&match noise.below(8) {
            0 => Vec3::new(-0.8, 1.0, 1.0),
            1 => Vec3::new(0.3, 0.2, 1.1),
            _ => Vec3::repeat(1.0),
        });
        self.rest.iter().map(|x| shape * x + noise.vector() * 0.01 * amount).collect()
    }

    fn deformation(&self, e: usize, x: &[Vec3]) -> Mat3 {
        let (nodes, constants) = &self.elements[e];
        let gradient = constants.gradient.iter().map(|g| Vec3::from(*g));
        nodes[1..].iter().zip(gradient).map(|(n, g)| (x[*n as usize] - x[nodes[0] as usize]) * g.transpose()).sum()
    }

    /// Elastic energy [J].
    fn energy(&self, x: &[Vec3]) -> Real {
        let of = |e: usize| material(&self.elements[e].1).energy_density(&self.deformation(e, x));
        (0..self.elements.len()).map(of).sum()
    }
}

/// The material of which one cubic metre is such an element.
fn material(constants: &Constants) -> Material {
    let ElementConstants { lambda, mu, neo_hookean, collapse, fibres, .. } = *constants;
    // `√K a ⊗ a` has the trace `√K`; its longest column is along the fibres.
    let rows = symmetric(fibres);
    let along = rows.column_iter().map(Vec3::from).max_by(|a, b| a.norm().total_cmp(&b.norm())).unwrap_or_default();
    let direction = along.try_normalize(0.0).unwrap_or_default();
    let fibres = Fibres { modulus: rows.trace().powi(2), direction };
    Material { lambda, mu, phi: 0.0, psi: 0.0, density: 1.0, neo_hookean, collapse, fibres }
}

fn stiff(noise: &mut Noise, volume: Real, gradient: Vec<[Real; 3]>) -> Constants {
    let weight = volume * (0.5 + 0.4 * noise.next());
    let (lambda, mu) = (weight * (5e4 + 3e4 * noise.next()), weight * (2e3 + 1e3 * noise.next()));
    ElementConstants { gradient, lambda, mu, neo_hookean: 0.0, collapse: 1.0, fibres: [0.0; 6] }
}

fn slots(nodes: &[u32]) -> Vec<Slot> {
    nodes.iter().copied().map(Slot).collect()
}

fn padded(x: &[Vec3]) -> Vec<Padded> {
    x.iter().map(|v| [v.x, v.y, v.z, 0.0]).collect()
}

fn forces<I: Kind>(pool: &mut Pool<I>, path: Simd, rates: &Rates, x: &[Vec3]) -> (Vec<Padded>, Extremes) {
    let mut force = vec![[0.0; 4]; x.len()];
    let extremes = pool.add_forces(path, 5, rates, &padded(x), &mut force);
    (force, extremes)
}

fn force<I: Kind>(pool: &mut Pool<I>, rates: &Rates, x: &[Vec3]) -> Vec<Vec3> {
    forces(pool, Simd::best(), rates, x).0.iter().map(|f| Vec3::new(f[0], f[1], f[2])).collect()
}

const RATES: Rates = Rates { volume: 0.7, shear: 1.3, decay: [0.97, 0.6], share: [0.8, 0.4] };

fn bits(x: &[Real]) -> Vec<u64> {
    x.iter().map(|x| x.to_bits()).collect()
}

fn history_bits<I: Kind>(pool: &Pool<I>, id: I) -> Vec<u64> {
    let h = pool.history(id).expect("there");
    bits(&[&h.strain[..], &[h.det], h.branch.as_flattened()].concat())
}

#[test]
fn all_forms_give_the_same_bits() {
    let mut noise = Noise(7);
    for count in (0..40).chain([200, 333]) {
        let soup = Soup::new(&mut noise, 40, count);
        give_the_same_bits::<Element>(&mut noise, &soup);
        let soup = soup.of_all_laws(&mut noise);
        give_the_same_bits::<Element>(&mut noise, &soup);
        let soup = Soup::stars(&mut noise, 40, count);
        give_the_same_bits::<Node>(&mut noise, &soup);
        let soup = soup.of_all_laws(&mut noise);
        give_the_same_bits::<Node>(&mut noise, &soup);
    }
}

fn give_the_same_bits<I: Kind + std::fmt::Debug>(noise: &mut Noise, soup: &Soup) {
    let count = soup.elements.len();
    {
        for branches in 0..=MAX_BRANCHES {
            let mut pools = Simd::available().into_iter().map(|p| (p, soup.pool::<I>(branches))).collect::<Vec<_>>();
            let mut crushed = false;
            for call in 0..12 {
                let amount = [0.0, 0.02, 0.3, 2.0][call % 4];
                let x = padded(&soup.moved(noise, amount));
                // Forces of other classes are there already, zeros of both signs among them.
                let before: Vec<Padded> = x.iter().map(|x| [x[0], -0.0, 0.0 * x[2], 0.0]).collect();
                let mut expected: Option<(Vec<Padded>, Extremes)> = None;
                for (path, pool) in &mut pools {
                    let mut force = before.clone();
                    let extremes = pool.add_forces(*path, 5, &RATES, &x, &mut force);
                    assert!(force.as_flattened().iter().all(|f| f.is_finite()));
                    let (f, e) = expected.get_or_insert((force.clone(), extremes));
                    assert_eq!(bits(f.as_flattened()), bits(force.as_flattened()), "{path:?}");
                    assert_eq!(*e, extremes, "{path:?}");
                    crushed |= extremes.det_f < COLLAPSE_ONSET;
                }
                for id in (0..count).map(I::at) {
                    let expected = history_bits(&pools[0].1, id);
                    assert!(pools.iter().all(|(_, pool)| history_bits(pool, id) == expected));
                }
                if count > 0 {
                    // Leaves other unused lanes behind, and other elements in the last block.
                    let id = I::at(noise.below(count));
                    for (_, pool) in &mut pools {
                        let history = pool.remove(id).expect("there");
                        let (nodes, constants) = &soup.elements[id.index()];
                        assert!(pool.insert(id, 5, &slots(nodes), constants, &history));
                    }
                }
            }
            assert!(crushed || count < 8);
        }
    }
}

#[test]
fn the_force_is_minus_the_slope_of_the_energy() {
    let mut noise = Noise(3);
    let soup = Soup::new(&mut noise, 12, 21);
    is_minus_the_slope::<Element>(&mut noise, &soup);
    let soup = soup.of_all_laws(&mut noise);
    is_minus_the_slope::<Element>(&mut noise, &soup);
    let soup = Soup::stars(&mut noise, 12, 21);
    is_minus_the_slope::<Node>(&mut noise, &soup);
    let soup = soup.of_all_laws(&mut noise);
    is_minus_the_slope::<Node>(&mut noise, &soup);
}

fn is_minus_the_slope<I: Kind>(noise: &mut Noise, soup: &Soup) {
    for round in 0..8 {
        let x = soup.moved(noise, [0.05, 0.4, 1.0][round % 3]);
        let f = force(&mut soup.pool::<I>(0), &Rates::ELASTIC, &x);
        let scale = f.iter().map(|f| f.norm()).fold(0.0, Real::max);
        let step = 1e-7;
        for n in 0..x.len() {
            for c in 0..3 {
                let energy = |d: Real| {
                    let mut x = x.clone();
                    x[n][c] += d;
                    soup.energy(&x)
                };
                let slope = (energy(step) - energy(-step)) / (2.0 * step);
                assert!((f[n][c] + slope).abs() < 1e-6 * scale, "{} {slope} of {scale}", f[n][c]);
            }
        }
    }
}

#[test]
fn a_rigid_rotation_costs_no_force() {
    let mut noise = Noise(5);
    let soup = Soup::new(&mut noise, 20, 50);
    costs_no_force_to_turn::<Element>(&soup);
    costs_no_force_to_turn::<Element>(&soup.of_all_laws(&mut noise));
    let soup = Soup::stars(&mut noise, 20, 50);
    costs_no_force_to_turn::<Node>(&soup);
    costs_no_force_to_turn::<Node>(&soup.of_all_laws(&mut noise));
}

fn costs_no_force_to_turn<I: Kind>(soup: &Soup) {
    let turn = nalgebra::Rotation3::from_euler_angles(0.4, -2.0, 1.1);
    let x: Vec<_> = soup.rest.iter().map(|x| turn * x + Vec3::new(0.1, -0.2, 0.05)).collect();
    for path in Simd::available() {
        for branches in 0..=MAX_BRANCHES {
            let (force, extremes) = forces(&mut soup.pool::<I>(branches), path, &RATES, &x);
            assert!(force.as_flattened().iter().all(|f| f.abs() < 1e-11));
            assert!(extremes.strain_squared < 1e-24 && (extremes.det_f - 1.0).abs() < 1e-12);
        }
    }
}

/// The law on matrices, element by element, with viscosity.
fn reference(soup: &Soup, rates: &Rates, memory: &mut [History], branches: usize, x: &[Vec3]) -> Vec<Vec3> {
    let mut force = vec![Vec3::zeros(); x.len()];
    for (e, memory) in memory.iter_mut().enumerate() {
        let (nodes, c) = &soup.elements[e];
        let f = soup.deformation(e, x);
        let strain = (f.transpose() * f - Mat3::identity()) * 0.5;
        let change = strain - symmetric(std::mem::replace(&mut memory.strain, components(&strain)));
        for (d, decay) in memory.branch.iter_mut().zip(rates.decay).take(branches) {
            *d = components(&((symmetric(*d) + change) * decay));
        }
        let viscous =
            Mat3::from_diagonal_element(c.lambda * rates.volume * change.trace()) + 2.0 * c.mu * rates.shear * change;
        let stress = c.stress(&f, rates.share[..branches].iter().copied(), memory);
        let along = symmetric(c.fibres);
        let stress = stress + viscous + along * (rates.shear * along.dot(&change));
        for (n, f) in nodes[1..].iter().zip(c.forces(&f, &stress)) {
            force[*n as usize] += f;
            force[nodes[0] as usize] -= f;
        }
    }
    force
}

#[test]
fn the_law_with_viscosity_and_memory_agrees_with_matrices() {
    let mut noise = Noise(11);
    let soup = Soup::new(&mut noise, 15, 30);
    agrees_with_matrices::<Element>(&mut noise, &soup);
    let soup = soup.of_all_laws(&mut noise);
    agrees_with_matrices::<Element>(&mut noise, &soup);
    let soup = Soup::stars(&mut noise, 15, 30);
    agrees_with_matrices::<Node>(&mut noise, &soup);
    let soup = soup.of_all_laws(&mut noise);
    agrees_with_matrices::<Node>(&mut noise, &soup);
}

fn agrees_with_matrices<I: Kind>(noise: &mut Noise, soup: &Soup) {
    for branches in 0..=MAX_BRANCHES {
        let mut pool = soup.pool::<I>(branches);
        let mut memory = vec![History::REST; soup.elements.len()];
        for _ in 0..20 {
            let x = soup.moved(noise, 0.3);
            let f = force(&mut pool, &RATES, &x);
            let expected = reference(soup, &RATES, &mut memory, branches, &x);
            let scale = expected.iter().map(|f| f.norm()).fold(0.0, Real::max);
            assert!(f.iter().zip(&expected).all(|(a, b)| (a - b).norm() < 1e-12 * scale));
        }
    }
}

#[test]
fn a_branch_relaxes_under_a_held_shear() {
    // A tenth of the relaxation time in 1000 steps; the elastic share stays, the branch fades by 1/(1 + h/T).
    let soup = {
        let mut noise = Noise(2);
        let mut soup = Soup::new(&mut noise, 4, 1);
        soup.rest = vec![Vec3::zeros(), Vec3::x() * 0.01, Vec3::y() * 0.01, Vec3::z() * 0.01];
        let gradient = vec![[100.0, 0.0, 0.0], [0.0, 100.0, 0.0], [0.0, 0.0, 100.0]];
        soup.elements[0] = (
            vec![0, 1, 2, 3],
            ElementConstants { gradient, lambda: 3e-3, mu: 2e-4, neo_hookean: 0.0, collapse: 0.0, fibres: [0.0; 6] },
        );
        soup
    };
    let shear = 1e-7;
    let mut x = soup.rest.clone();
    x[2].x += shear * 0.01;
    let (h, time, share) = (1e-4, 1.0, 0.7);
    let rates = Rates { volume: 0.0, shear: 0.0, decay: [1.0 / (1.0 + h / time), 0.0], share: [share, 0.0] };
    let mut pool = soup.pool::<Element>(1);
    let mut model = 0.5 * shear;
    for step in 1..=1000 {
        let f = force(&mut pool, &rates, &x);
        model *= rates.decay[0];
        let stress = 2.0 * 2e-4 * (0.5 * shear + share * model);
        assert!((f[2].x / (-stress * 100.0) - 1.0).abs() < 1e-6);
        let exact = 0.5 * shear * (-(step as Real) * h / time).exp();
        assert!((pool.history(Element(0)).expect("there").branch[0][5] / exact - 1.0).abs() < 1e-5);
    }
}

#[test]
fn what_does_not_move_feels_no_viscosity() {
    let mut noise = Noise(13);
    let soup = Soup::new(&mut noise, 20, 35);
    let x = soup.moved(&mut noise, 0.2);
    let mut pool = soup.pool::<Element>(0);
    let moving = force(&mut pool, &RATES, &x);
    let still = force(&mut pool, &RATES, &x);
    let elastic = force(&mut soup.pool::<Element>(0), &Rates::ELASTIC, &x);
    assert_ne!(moving, still);
    assert_eq!(still, elastic);
}

#[test]
fn lanes_without_an_element_are_not_seen() {
    let mut noise = Noise(17);
    for count in 1..=17 {
        sees_no_empty_lane::<Element>(Soup::new(&mut noise, 12, count));
        sees_no_empty_lane::<Node>(Soup::stars(&mut noise, 12, count));
    }
}

fn sees_no_empty_lane<I: Kind>(mut soup: Soup) {
    {
        // Node 0, which unused lanes name, is far away and in no element.
        for (nodes, _) in &mut soup.elements {
            nodes.iter_mut().for_each(|n| *n += 1);
        }
        soup.rest.insert(0, Vec3::repeat(Real::NAN));
        let x: Vec<_> = soup.rest.iter().map(|x| x * 1.1).collect();
        for path in Simd::available() {
            let mut pool = soup.pool::<I>(2);
            for _ in 0..3 {
                let (force, extremes) = forces(&mut pool, path, &RATES, &x);
                assert!(force.as_flattened().iter().all(|f| f.is_finite()));
                assert_eq!(force[0], [0.0; 4]);
                // E = 0.105 I, J = 1.331.
                assert!((extremes.strain_squared - 3.0 * 0.105 * 0.105).abs() < 1e-12);
                assert_eq!(extremes.det_f, 1.0);
            }
        }
    }
}

#[test]
fn a_memory_fades_without_becoming_subnormal() {
    let mut noise = Noise(19);
    let soup = Soup::new(&mut noise, 10, 9);
    let x = soup.moved(&mut noise, 0.1);
    let mut pool = soup.pool::<Element>(2);
    for _ in 0..4000 {
        force(&mut pool, &RATES, &x);
    }
    for id in (0..9).map(Element) {
        let history = pool.history(id).expect("there");
        let faded = |d: &Real| d.abs() < 1e-30 && !d.is_subnormal();
        assert!(history.branch.as_flattened().iter().all(faded));
    }
}

#[test]
fn extremes_are_those_of_the_elements_and_who_is_over_its_limit_is_named() {
    let mut noise = Noise(23);
    let soup = Soup::new(&mut noise, 30, 61);
    for amount in [0.02, 0.5, 1.5] {
        let x = soup.moved(&mut noise, amount);
        let mut pool = soup.pool::<Element>(1);
        let (_, extremes) = forces(&mut pool, Simd::best(), &RATES, &x);
        let mut expected = Extremes::REST;
        let (mut strained, mut within_limit) = (vec![], vec![]);
        let limit = StrainLimit { deviator: 0.6, slope: 0.8 };
        for e in 0..soup.elements.len() {
            let f = soup.deformation(e, &x);
            let strain = (f.transpose() * f - Mat3::identity()) * 0.5;
            let det = f.determinant();
            let own = Extremes { strain_squared: strain.dot(&strain), det_f: det };
            let deviator = (strain - Mat3::identity() * (strain.trace() / 3.0)).norm();
            let over = 2.0 * deviator - (limit.deviator - limit.slope * 2.0 * strain.trace());
            if det < COLLAPSE_ONSET || over > 1e-9 {
                strained.push(Element::at(e));
            } else if over < -1e-9 {
                within_limit.push(Element::at(e));
            }
            expected = expected.join(&own);
        }
        let near = |a: Real, b: Real| (a - b).abs() < 1e-11 * (1.0 + b.abs());
        assert!(near(extremes.strain_squared, expected.strain_squared));
        assert!(near(extremes.det_f, expected.det_f));
        for path in Simd::available() {
            let mut pool = soup.pool::<Element>(1);
            (0..soup.elements.len()).map(Element::at).for_each(|e| pool.set_strain_limit(e, limit));
            forces(&mut pool, path, &RATES, &x);
            let over: Vec<Element> = pool.over_limit(5).collect();
            assert!(strained.iter().all(|e| over.contains(e)), "{strained:?} in {over:?}");
            // One over its limit brings along those of its block, and no others.
            let block = |e: &Element| strained.iter().any(|s| s.index() / LANES == e.index() / LANES);
            assert!(within_limit.iter().all(|e| block(e) || !over.contains(e)), "{over:?} for {strained:?}");
        }
    }
}
