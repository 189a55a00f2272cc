//! Stars: a node and its neighbours, with the mean deformation gradient of the elements around it.
//!
//! Linear tetrahedra are exact in uniform strain and too stiff where it varies: they bend, twist and, near
//! incompressibility, swell too little. What is too stiff is the part of the energy that the *jumps* of strain between them
//! carry. So a body may be given, in part, the energy of node-averaged deformation gradients [Dohrmann, Heinstein, Jung, Key &
//! Witkowski 2000; Puso & Solberg 2006]:
//!
//! `U = Σ_n V_n [W(F̄_n; λ, μ) − α W(F̄_n; λ_s, μ)] + α Σ_t V_t W(F_t; λ_s, μ)`,
//! `V_n = Σ_{t∋n} V_t/4`, `F̄_n = Σ_{t∋n} (V_t/4) F_t / V_n`, `λ_s = min(λ, 1.5 μ)`.
//!
//! Uniform strain has its exact energy whatever `α`; jumps have the part `α` of theirs, which holds the modes that means do
//! not see [Puso & Solberg 2006], and of what they have against volume change hardly any. As the law is linear in its moduli,
//! both sums are elements of that law: tetrahedra of `αλ_s, αμ`, and stars of `λ − αλ_s, (1−α)μ`. Maxwell branches act on the
//! stars' strain alone.

use super::Body;
use crate::geometry::tet_mesh::gradients;
use crate::ids::Node;
use crate::math::{Mat3, Real, Vec3};
use crate::model::element::ElementConstants;
use crate::model::material::Material;
use crate::model::step_class;

/// Largest `λ/μ` of what strain jumps are held by [Puso & Solberg 2006]: near incompressibility volume is not to be held
/// element by element.
const MOST_LAMBDA: Real = 1.5;

/// The part of `material` that tetrahedra keep in a body of `stabilisation` α: `λ_s` and μ times α.
pub fn of_jumps(material: &Material, stabilisation: Real) -> Material {
    if stabilisation >= 1.0 {
        return *material;
    }
    let lambda = material.lambda.min(MOST_LAMBDA * material.mu);
    Material { lambda: stabilisation * lambda, mu: stabilisation * material.mu, ..*material }
}

/// The part that stars have: the rest.
fn of_means(material: &Material, stabilisation: Real) -> Material {
    let jumps = of_jumps(material, stabilisation);
    Material { lambda: material.lambda - jumps.lambda, mu: material.mu - jumps.mu, ..*material }
}

/// The stars of all nodes of a body; none where tetrahedra have all of the energy.
#[derive(Debug, Default)]
pub struct Stars {
    /// Of each node: where its neighbours begin in the lists of all, and the end.
    first: Vec<u32>,
    /// Neighbours of all nodes, each without itself.
    neighbours: Vec<Node>,
    /// Gradients [1/m] that belong to them: `b_nj = Σ_{t∋n,j} (V_t/4) ∇L_j / V_n`.
    gradients: Vec<[Real; 3]>,
    stars: Vec<Star>,
    /// Most neighbours of a node.
    most: usize,
}

/// What a star is made of.
#[derive(Clone, Copy, Debug)]
pub struct Star {
    /// A quarter of the volume of the elements around [m³].
    pub volume: Real,
    /// Its part of the material: of the geometric mean of the moduli μ and λ + 2μ around, by volume.
    pub material: Material,
    /// μ over that of `material`: Maxwell branches are of the whole material, and act on stars alone.
    pub branch: Real,
    /// `ω²` [1/s²] of its stiffest mode at rest, with the safety factor of [`step_class::omega_squared`], the Maxwell branches
    /// at their stiffest.
    pub omega_squared: Real,
}

impl Stars {
    /// Of all nodes of `body`.
    pub(super) fn new(body: &Body) -> Self {
        let alpha = body.stabilisation();
        if alpha >= 1.0 {
            return Self::default();
        }
        let mut all = Self { first: vec![0], ..Self::default() };
        for n in body.nodes() {
            let others = body.neighbours(n).iter().copied().filter(|m| *m != n);
            let begin = all.neighbours.len();
            all.neighbours.extend(others);
            let neighbours = &all.neighbours[begin..];
            let mut b = vec![Vec3::zeros(); neighbours.len()];
            let mut masses = vec![0.0; neighbours.len()];
            let (mut volume, mut own_mass, mut pressure, mut mu) = (0.0, 0.0, 0.0, 0.0);
            for &e in body.elements_around(n) {
                let (quarter, material) = (body.volume(e) / 4.0, body.material_of(e));
                volume += quarter;
                pressure += quarter * material.pressure_modulus().ln();
                mu += quarter * material.mu.ln();
                // A quarter of an element's mass goes with the star, in equal parts at its nodes.
                let mass = body.density(e) * quarter / 4.0;
                own_mass += mass;
                for (m, g) in body.element(e).iter().zip(gradients(&body.corners(e))) {
                    if let Some(i) = neighbours.iter().position(|other| other == m) {
                        b[i] += g * quarter;
                        masses[i] += mass;
                    }
                }
            }
            b.iter_mut().for_each(|b| *b /= volume);
            let mu = (mu / volume).exp();
            let whole = Material { lambda: (pressure / volume).exp() - 2.0 * mu, mu, ..*body.material() };
            let material = of_means(&whole, alpha);
            let branch = whole.mu / material.mu;
            let own = -b.iter().sum::<Vec3>();
            let spread = b.iter().zip(&masses).chain([(&own, &own_mass)]).map(|(b, m)| b * b.transpose() / *m).sum();
            // The part of the masses that goes with the star's part of the stiffness, the rest with the tetrahedra.
            let part = material.pressure_modulus() / whole.pressure_modulus();
            let stiffest = stiffest(&material, &spread) * volume / part;
            let of_elements = body.elements_around(n).iter().map(|e| step_class::altitude_omega_squared(body, *e));
            let bound = of_elements.fold(0.0, Real::max);
            let omega_squared = stiffest.min(bound) * step_class::instantaneous(&material, branch, body.maxwell());
            all.gradients.extend(b.into_iter().map(<[Real; 3]>::from));
            all.stars.push(Star { volume, material, branch, omega_squared });
            all.most = all.most.max(all.neighbours.len() - begin);
            all.first.push(all.neighbours.len() as u32);
        }
        all
    }

    /// True where tetrahedra have all of the energy.
    pub fn is_empty(&self) -> bool {
        self.stars.is_empty()
    }

    /// Most neighbours of a node.
    pub fn most_neighbours(&self) -> usize {
        self.most
    }

    /// What the star of node `n` is made of.
    pub fn of(&self, n: Node) -> &Star {
        &self.stars[n.index()]
    }

    fn range(&self, n: Node) -> std::ops::Range<usize> {
        self.first[n.index()] as usize..self.first[n.index() + 1] as usize
    }

    /// Neighbours of node `n`: nodes of the elements around it, without itself.
    pub fn neighbours(&self, n: Node) -> &[Node] {
        &self.neighbours[self.range(n)]
    }

    /// The element that the star of node `n` is: between `n` and its neighbours.
    pub fn constants(&self, n: Node) -> ElementConstants<&[[Real; 3]]> {
        let Star { volume, material, branch, .. } = *self.of(n);
        ElementConstants {
            gradient: &self.gradients[self.range(n)],
            lambda: volume * material.lambda,
            mu: volume * material.mu,
            branch,
        }
    }
}

/// Bound on the stiffness of a star at rest over its volume and the masses of its nodes, `spread = Σ b bᵀ/m`: a displacement
/// gradient `G` has the energy `½ (λ tr²G + 2μ |sym G|²)`, and takes at least `½ |G spread^{-1/2}|²` of `Σ ½ m u²`.
fn stiffest(material: &Material, spread: &Mat3) -> Real {
    material.lambda * spread.trace() + 2.0 * material.mu * spread.symmetric_eigenvalues().max()
}
