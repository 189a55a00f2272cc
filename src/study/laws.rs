//! The laws that the paper compares [DDCB01 3.1], and two later ones, as plain forces on one tetrahedral mesh.
//!
//! Every continuum law is a first Piola–Kirchhoff stress `P(F)`; the force of an element on its node i is
//! `f_i = −vol P ∇L_i`. Springs along the edges are the exception: they know no `F`.
//!
//! References: [VG98] A. Van Gelder, *Approximate simulation of elastic membranes by triangulated spring meshes*,
//! Journal of Graphics Tools 3(2), 1998. [DDBC99] G. Debunne, M. Desbrun, A. Barr, M.-P. Cani, *Interactive
//! multiresolution animation of deformable models*, Eurographics Workshop on Computer Animation and Simulation, 1999.
//! [SGK18] B. Smith, F. de Goes, T. Kim, *Stable neo-Hookean flesh simulation*, ACM Transactions on Graphics 37(2),
//! 2018.

use palpate_core::geometry::TetMesh;
use palpate_core::math::{Mat3, Real, Vec3};
use palpate_core::model::Material;
use palpate_core::model::material::{COLLAPSE_ONSET, COLLAPSE_STIFFNESS};

/// How a solid answers to deformation.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Law {
    /// Springs along the edges, `k = E Σ vol / L²` over the tetrahedra around an edge of length `L` [VG98, as used by
    /// the paper's references 13 and 16]. Has an energy, but no Poisson's ratio: `λ` and `μ` enter through Young's
    /// modulus alone, so it does not linearise to the other laws.
    MassSpring,
    /// Small strain `ε = ½(F + Fᵀ) − I`: linear, and blind to the fact that a rotation is no deformation.
    Cauchy,
    /// The paper says only that [DDBC99] "used a simplified version of this tensor". Taken here: Lamé's equation
    /// `f/vol = μ Δd + (λ + μ) ∇(∇·d)` with its two operators discretised one by one, as that article does, which is
    /// the energy `½ μ |∇d|² + ½ (λ + μ) (∇·d)²`. It differs from Cauchy's by a null Lagrangian: the forces on inner
    /// nodes are the same to rounding, and those on free boundaries resist shear without turning.
    SimplifiedCauchy,
    /// Green strain `E = ½(FᵀF − I)`, St. Venant–Kirchhoff: the paper's law.
    Green,
    /// The same with `½ k (J − 0.6)²` where `J = det F < 0.6`, `k = 8 (λ + 2μ)`: what the project ships.
    GreenWithCompression,
    /// `½ μ' (I_C − 3) + ½ λ' (J − α)² − ½ μ' ln(I_C + 1)` with `μ' = 4μ/3`, `λ' = λ + 5μ/6`,
    /// `α = 1 + 3μ'/(4λ')`, which linearises to `λ` and `μ` [SGK18 eq. 14, 16, section 3.4].
    StableNeoHookean,
}

impl Law {
    /// All of them, in the paper's order.
    pub const ALL: [Self; 6] = [
        Self::MassSpring,
        Self::Cauchy,
        Self::SimplifiedCauchy,
        Self::Green,
        Self::GreenWithCompression,
        Self::StableNeoHookean,
    ];

    /// Words for a legend.
    pub fn name(self) -> &'static str {
        match self {
            Self::MassSpring => "mass–spring",
            Self::Cauchy => "Cauchy strain",
            Self::SimplifiedCauchy => "simplified Cauchy",
            Self::Green => "Green strain",
            Self::GreenWithCompression => "Green with compression term",
            Self::StableNeoHookean => "stable neo-Hookean",
        }
    }

    /// Energy density [J/m³] at the deformation gradient `f`, zero at rest; zero for springs, whose energy is not a
    /// density.
    pub fn energy_density(self, material: &Material, f: &Mat3) -> Real {
        let (lambda, mu) = (material.lambda, material.mu);
        let identity = Mat3::identity();
        match self {
            Self::MassSpring => 0.0,
            Self::Cauchy => {
                let strain = (f + f.transpose()) * 0.5 - identity;
                0.5 * lambda * strain.trace() * strain.trace() + mu * strain.norm_squared()
            }
            Self::SimplifiedCauchy => {
                let gradient = f - identity;
                0.5 * mu * gradient.norm_squared() + 0.5 * (lambda + mu) * gradient.trace() * gradient.trace()
            }
            Self::Green => {
                let strain = green_strain(f);
                0.5 * lambda * strain.trace() * strain.trace() + mu * strain.norm_squared()
            }
            Self::GreenWithCompression => material.energy_density(f),
            Self::StableNeoHookean => {
                let (lambda, mu, alpha) = neo_hookean_constants(material);
                let energy = |i_c: Real, j: Real| {
                    0.5 * mu * (i_c - 3.0) + 0.5 * lambda * (j - alpha) * (j - alpha) - 0.5 * mu * (i_c + 1.0).ln()
                };
                energy(f.norm_squared(), f.determinant()) - energy(3.0, 1.0)
            }
        }
    }

    /// First Piola–Kirchhoff stress `P = ∂W/∂F` [Pa] at the deformation gradient `f`; zero for springs.
    pub fn stress(self, material: &Material, f: &Mat3) -> Mat3 {
        let (lambda, mu) = (material.lambda, material.mu);
        let identity = Mat3::identity();
        match self {
            Self::MassSpring => Mat3::zeros(),
            Self::Cauchy => {
                let strain = (f + f.transpose()) * 0.5 - identity;
                identity * (lambda * strain.trace()) + strain * (2.0 * mu)
            }
            Self::SimplifiedCauchy => {
                let gradient = f - identity;
                gradient * mu + identity * ((lambda + mu) * gradient.trace())
            }
            Self::Green => {
                let strain = green_strain(f);
                f * (identity * (lambda * strain.trace()) + strain * (2.0 * mu))
            }
            Self::GreenWithCompression => {
                let squeeze = (f.determinant() - COLLAPSE_ONSET).min(0.0);
                let k = COLLAPSE_STIFFNESS * material.pressure_modulus();
                Self::Green.stress(material, f) + cofactor(f) * (k * squeeze)
            }
            Self::StableNeoHookean => {
                let (lambda, mu, alpha) = neo_hookean_constants(material);
                f * (mu * (1.0 - 1.0 / (f.norm_squared() + 1.0))) + cofactor(f) * (lambda * (f.determinant() - alpha))
            }
        }
    }
}

/// `E = ½(FᵀF − I)`.
pub fn green_strain(f: &Mat3) -> Mat3 {
    (f.transpose() * f - Mat3::identity()) * 0.5
}

/// `F S` [Pa] with the viscous `S = φ tr(Ė) I + 2ψ Ė` [DDCB01 eq. 3, 4] at the deformation gradient `f` and its `rate`
/// [1/s].
pub fn viscous_stress(material: &Material, f: &Mat3, rate: &Mat3) -> Mat3 {
    let half = f.transpose() * rate;
    let strain_rate = (half + half.transpose()) * 0.5;
    f * (Mat3::identity() * (material.phi * strain_rate.trace()) + strain_rate * (2.0 * material.psi))
}

/// `∂J/∂F`, which needs no inverse and so survives inverted elements.
fn cofactor(f: &Mat3) -> Mat3 {
    let (a, b, c) = (f.column(0), f.column(1), f.column(2));
    Mat3::from_columns(&[b.cross(&c), c.cross(&a), a.cross(&b)])
}

/// λ', μ' and α of [SGK18] that linearise to the material's λ and μ.
fn neo_hookean_constants(material: &Material) -> (Real, Real, Real) {
    let mu = 4.0 / 3.0 * material.mu;
    let lambda = material.lambda + 5.0 / 6.0 * material.mu;
    (lambda, mu, 1.0 + 0.75 * mu / lambda)
}

/// A linear tetrahedron at rest.
#[derive(Clone, Debug)]
pub struct Element {
    /// Its nodes.
    pub nodes: [usize; 4],
    /// `∇L_i` of each node [1/m].
    pub gradient: [Vec3; 4],
    /// Rest volume inside the body [m³].
    pub volume: Real,
}

impl Element {
    /// The tetrahedron `nodes` at the rest positions `u` [m]; `fraction` of it lies inside the body.
    pub fn new(nodes: [usize; 4], u: [Vec3; 4], fraction: Real) -> Self {
        let edges = Mat3::from_columns(&[u[1] - u[0], u[2] - u[0], u[3] - u[0]]);
        // Meshes are checked for positive volume where they are read, so the inverse exists.
        let inverse = edges.try_inverse().unwrap_or_else(Mat3::zeros);
        let [a, b, c] = [0, 1, 2].map(|i| inverse.row(i).transpose());
        Self { nodes, gradient: [-(a + b + c), a, b, c], volume: fraction * edges.determinant() / 6.0 }
    }

    /// `F = ∂x/∂u` for the positions `x` of all nodes; the velocity gradient `Ḟ` for their velocities.
    pub fn gradient_of(&self, x: &[Vec3]) -> Mat3 {
        let mut f = Mat3::zeros();
        for (node, gradient) in self.nodes.iter().zip(&self.gradient) {
            f += x[*node] * gradient.transpose();
        }
        f
    }
}

/// A spring along an edge.
#[derive(Clone, Debug)]
pub struct Spring {
    /// Its ends.
    pub nodes: [usize; 2],
    /// Rest length [m].
    pub length: Real,
    /// `Σ vol / L²` over the tetrahedra around it [m]; times Young's modulus it is the stiffness [N/m].
    pub thickness: Real,
}

impl Spring {
    /// Springs along the edges of `elements`, whose nodes are at `rest` [m].
    pub fn along(elements: &[Element], rest: &[Vec3]) -> Vec<Self> {
        let pairs = |e: &Element| {
            let [a, b, c, d] = e.nodes;
            [[a, b], [a, c], [a, d], [b, c], [b, d], [c, d]].map(|[a, b]| ([a.min(b), a.max(b)], e.volume))
        };
        let mut edges: Vec<([usize; 2], Real)> = elements.iter().flat_map(pairs).collect();
        edges.sort_by_key(|edge| edge.0);
        let springs = edges.chunk_by(|a, b| a.0 == b.0).map(|around| {
            let nodes = around[0].0;
            let length = (rest[nodes[0]] - rest[nodes[1]]).norm();
            let volume: Real = around.iter().map(|edge| edge.1).sum();
            Self { nodes, length, thickness: volume / (length * length) }
        });
        springs.collect()
    }

    /// Its energy per Young's modulus [m³] at the positions `x` [m].
    pub fn energy(&self, x: &[Vec3]) -> Real {
        let stretch = (x[self.nodes[1]] - x[self.nodes[0]]).norm() - self.length;
        0.5 * self.thickness * stretch * stretch
    }

    /// What it pulls its first node with, and its second the other way, per Young's modulus [m²].
    pub fn pull(&self, x: &[Vec3]) -> Vec3 {
        let along = x[self.nodes[1]] - x[self.nodes[0]];
        along * (self.thickness * (1.0 - self.length / along.norm()))
    }
}

/// One mesh of one material at rest, with everything that any of the laws needs.
#[derive(Clone, Debug)]
pub struct Solid {
    /// Rest positions [m] (n_nodes).
    pub rest: Vec<Vec3>,
    /// Lumped mass [kg] (n_nodes).
    pub mass: Vec<Real>,
    /// Tetrahedra, for the continuum laws.
    pub elements: Vec<Element>,
    /// Edges, for the springs.
    pub springs: Vec<Spring>,
    /// Smallest altitude [m].
    pub altitude: Real,
    /// λ, μ [Pa], φ, ψ [Pa·s], ρ [kg/m³].
    pub material: Material,
}

impl Solid {
    /// `mesh` [m] filled with `material`.
    pub fn new(mesh: &TetMesh, material: Material) -> Self {
        let mut mass = vec![0.0; mesh.nodes.len()];
        let mut elements = Vec::new();
        let mut altitude = Real::INFINITY;
        for e in 0..mesh.elements.len() {
            let element = Element::new(mesh.elements[e].map(|n| n as usize), mesh.corners(e), 1.0);
            element.nodes.iter().for_each(|n| mass[*n] += 0.25 * material.density * element.volume);
            altitude = altitude.min(mesh.smallest_altitude(e));
            elements.push(element);
        }
        let springs = Spring::along(&elements, &mesh.nodes);
        Self { rest: mesh.nodes.clone(), mass, springs, elements, altitude, material }
    }

    /// Energy [J] under `law` at the positions `x` [m].
    pub fn energy(&self, law: Law, x: &[Vec3]) -> Real {
        if law == Law::MassSpring {
            return self.material.youngs_modulus() * self.springs.iter().map(|s| s.energy(x)).sum::<Real>();
        }
        self.elements.iter().map(|e| e.volume * law.energy_density(&self.material, &e.gradient_of(x))).sum()
    }

    /// Elastic forces [N] under `law` at the positions `x` [m]: minus the gradient of the energy.
    pub fn force(&self, law: Law, x: &[Vec3]) -> Vec<Vec3> {
        let mut force = vec![Vec3::zeros(); x.len()];
        if law == Law::MassSpring {
            let young = self.material.youngs_modulus();
            for s in &self.springs {
                let pull = s.pull(x) * young;
                force[s.nodes[0]] += pull;
                force[s.nodes[1]] -= pull;
            }
            return force;
        }
        for e in &self.elements {
            let stress = law.stress(&self.material, &e.gradient_of(x));
            for (node, gradient) in e.nodes.iter().zip(&e.gradient) {
                force[*node] -= stress * gradient * e.volume;
            }
        }
        force
    }

    /// Viscous forces [N] at positions `x` [m] and velocities `v` [m/s]. No energy belongs to them, and none to rigid
    /// motion.
    pub fn viscous_force(&self, x: &[Vec3], v: &[Vec3]) -> Vec<Vec3> {
        let mut force = vec![Vec3::zeros(); x.len()];
        for e in &self.elements {
            let stress = viscous_stress(&self.material, &e.gradient_of(x), &e.gradient_of(v));
            for (node, gradient) in e.nodes.iter().zip(&e.gradient) {
                force[*node] -= stress * gradient * e.volume;
            }
        }
        force
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::levels::{Random, independent_box};

    fn solid() -> Solid {
        let mesh = independent_box(Vec3::new(0.1, 0.08, 0.06), [3, 2, 2], 5);
        Solid::new(&mesh, Material::from_young(8000.0, 0.4, 1000.0))
    }

    /// The rest positions moved by up to `size` [m] each.
    fn shaken(solid: &Solid, size: Real) -> Vec<Vec3> {
        let mut random = Random::new(3);
        solid.rest.iter().map(|u| u + random.in_cube() * size).collect()
    }

    fn rotation() -> Mat3 {
        nalgebra::Rotation3::from_euler_angles(0.7, -0.4, 1.1).into_inner()
    }

    fn norm(forces: &[Vec3]) -> Real {
        forces.iter().map(|f| f.norm_squared()).sum::<Real>().sqrt()
    }

    #[test]
    fn force_is_minus_energy_gradient() {
        let solid = solid();
        // Strong enough to reach the compression term.
        let x = shaken(&solid, 0.02);
        assert!(solid.elements.iter().any(|e| e.gradient_of(&x).determinant() < COLLAPSE_ONSET));
        for law in Law::ALL {
            let force = solid.force(law, &x);
            let h = 1e-7;
            let mut worst: Real = 0.0;
            for node in 0..x.len() {
                for axis in 0..3 {
                    let energy = |step: Real| {
                        let mut moved = x.clone();
                        moved[node][axis] += step;
                        solid.energy(law, &moved)
                    };
                    worst = worst.max((force[node][axis] + (energy(h) - energy(-h)) / (2.0 * h)).abs());
                }
            }
            assert!(worst < 1e-6 * norm(&force), "{law:?}: {worst} of {}", norm(&force));
        }
    }

    #[test]
    fn rest_is_without_force_and_without_energy() {
        let solid = solid();
        for law in Law::ALL {
            assert!(norm(&solid.force(law, &solid.rest)) < 1e-11, "{law:?}");
            assert!(solid.energy(law, &solid.rest).abs() < 1e-11, "{law:?}");
        }
    }

    #[test]
    fn laws_that_see_true_strain_agree_to_first_order() {
        let solid = solid();
        let cauchy = |size| solid.force(Law::Cauchy, &shaken(&solid, size));
        for law in [Law::Green, Law::GreenWithCompression, Law::StableNeoHookean] {
            let difference = |size: Real| {
                let (ours, linear) = (solid.force(law, &shaken(&solid, size)), cauchy(size));
                norm(&ours.iter().zip(&linear).map(|(a, b)| a - b).collect::<Vec<_>>()) / norm(&linear)
            };
            // Ten times less displacement, ten times less relative difference.
            let (large, small) = (difference(1e-5), difference(1e-6));
            assert!(large < 1e-2, "{law:?}: {large}");
            assert!((small / large - 0.1).abs() < 0.01, "{law:?}: {large} {small}");
        }
    }

    #[test]
    fn simplified_cauchy_is_cauchy_inside_and_only_there() {
        let mesh = independent_box(Vec3::repeat(0.1), [4, 4, 4], 5);
        let solid = Solid::new(&mesh, Material::from_young(8000.0, 0.4, 1000.0));
        let x = shaken(&solid, 0.004);
        let (full, simple) = (solid.force(Law::Cauchy, &x), solid.force(Law::SimplifiedCauchy, &x));
        let mut on_boundary = vec![false; x.len()];
        mesh.boundary().iter().flatten().for_each(|n| on_boundary[*n as usize] = true);
        let (mut inside, mut outside): (Real, Real) = (0.0, 0.0);
        for n in 0..x.len() {
            let difference = (full[n] - simple[n]).norm();
            if on_boundary[n] { outside = outside.max(difference) } else { inside = inside.max(difference) }
        }
        assert!(inside < 1e-13 * norm(&full), "{inside}");
        assert!(outside > 0.005 * norm(&full), "{outside}");
    }

    #[test]
    fn rotation_gives_no_force_but_under_cauchy_strain() {
        let solid = solid();
        let turned: Vec<Vec3> = solid.rest.iter().map(|u| rotation() * u + Vec3::new(0.3, 0.1, -0.2)).collect();
        for law in Law::ALL {
            let force = norm(&solid.force(law, &turned));
            match law {
                // Their documented fault: a turn counts as strain.
                Law::Cauchy | Law::SimplifiedCauchy => assert!(force > 1.0, "{law:?}: {force}"),
                _ => assert!(force < 1e-10, "{law:?}: {force}"),
            }
        }
    }

    #[test]
    fn forces_turn_with_the_body() {
        let solid = solid();
        let x = shaken(&solid, 0.01);
        let turned: Vec<Vec3> = x.iter().map(|x| rotation() * x).collect();
        for law in [Law::MassSpring, Law::Green, Law::GreenWithCompression, Law::StableNeoHookean] {
            let (before, after) = (solid.force(law, &x), solid.force(law, &turned));
            let difference: Vec<Vec3> = before.iter().zip(&after).map(|(a, b)| rotation() * a - b).collect();
            assert!(norm(&difference) < 1e-12 * norm(&before), "{law:?}");
            assert!((solid.energy(law, &x) / solid.energy(law, &turned) - 1.0).abs() < 1e-12, "{law:?}");
        }
    }

    #[test]
    fn springs_carry_the_load_of_their_bar() {
        // A single tetrahedron has six springs of vol/L² each; a stretched one must resist.
        let solid = solid();
        let pulled: Vec<Vec3> = solid.rest.iter().map(|u| Vec3::new(1.05 * u.x, u.y, u.z)).collect();
        let total: Real = solid.springs.iter().map(|s| s.thickness * s.length * s.length).sum();
        let volume: Real = solid.elements.iter().map(|e| e.volume).sum();
        assert!((total / (6.0 * volume) - 1.0).abs() < 1e-12);
        assert!(solid.energy(Law::MassSpring, &pulled) > 0.0);
    }

    #[test]
    fn viscosity_takes_energy_from_strain_and_none_from_a_turn() {
        let mut solid = solid();
        (solid.material.phi, solid.material.psi) = (3.0, 2.0);
        let x = shaken(&solid, 0.005);
        let spin: Vec<Vec3> = x.iter().map(|x| Vec3::new(1.0, 2.0, -0.5).cross(x)).collect();
        assert!(norm(&solid.viscous_force(&x, &spin)) < 1e-12);
        let mut random = Random::new(9);
        let v: Vec<Vec3> = x.iter().map(|_| random.in_cube()).collect();
        let power: Real = solid.viscous_force(&x, &v).iter().zip(&v).map(|(f, v)| f.dot(v)).sum();
        assert!(power < 0.0);
    }
}
