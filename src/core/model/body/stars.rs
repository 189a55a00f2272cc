//! Stars: a node and its neighbours, with the mean deformation gradient of the elements around it.
//!
//! Linear tetrahedra are exact in uniform strain and too stiff where it varies: they bend, twist and, near
//! incompressibility, swell too little. What is too stiff is the part of the energy that the *jumps* of strain between them
//! carry. So a body may be given, in part, the energy of node-averaged deformation gradients [Dohrmann, Heinstein, Jung, Key &
//! Witkowski 2000; Puso & Solberg 2006]:
//!
//! `U = Σ_n V_n [W(F̄_n; λ, μ) − α W(F̄_n; 0, μ)] + α Σ_t V_t W(F_t; 0, μ)`,
//! `V_n = Σ_{t∋n} V_t/4`, `F̄_n = Σ_{t∋n} (V_t/4) F_t / V_n`.
//!
//! `α` is a number of each level. Uniform strain has its exact energy whatever it is; jumps have the part `α` of theirs, which
//! holds the modes that means do not see [Puso & Solberg 2006], and of λ nothing: volume is held by means alone. As the
//! law is linear in its moduli, both sums are elements of that law, viscosity and Maxwell branches included: tetrahedra of
//! `0, αμ`, and stars of `λ, (1−α)μ`. Both step by themselves, with the same part of the masses as of the stiffness.
//!
//! Between levels, where some nodes of an element are interface nodes, α is [`LARGEST`]: elements that count by quarters do not quite balance in
//! uniform strain, and jumps that are soft answer what is left by more than bending gains there. A star has the mean of the α of its
//! elements by volume, so that uniform strain keeps its exact energy.
//!
//! The compression term is the tetrahedra's alone, all of it: where one is crushed or inside out, the mean around may be as it should.

use super::Body;
use crate::geometry::tet_mesh::gradients;
use crate::ids::{Element, Node};
use crate::math::{Real, Vec3};
use crate::model::element::ElementConstants;
use crate::model::fibres::Fibres;
use crate::model::material::Material;

/// Largest α of a level, and that between levels: with more, the stars have next to no stiffness; with less, levels that bend too much would
/// not agree, and mixed sets become softer (modes of scattered ones by 4 % with 0.35, within 1 % with this and with 0.99).
pub const LARGEST: Real = 0.9;

/// The part of `material` that tetrahedra keep in a body of `stabilisation` α: that of its μ.
pub fn of_jumps(material: &Material, stabilisation: Real) -> Material {
    if stabilisation >= 1.0 {
        return *material;
    }
    let fibres = material.fibres.stiffened(stabilisation);
    let jumps = Material { lambda: 0.0, mu: stabilisation * material.mu, fibres, ..*material };
    Material { collapse: material.pressure_modulus() / jumps.pressure_modulus(), ..jumps }
}

/// The part that stars have: the rest.
pub fn of_means(material: &Material, stabilisation: Real) -> Material {
    let jumps = of_jumps(material, stabilisation);
    let fibres = Fibres { modulus: material.fibres.modulus - jumps.fibres.modulus, ..material.fibres };
    Material { lambda: material.lambda - jumps.lambda, mu: material.mu - jumps.mu, fibres, collapse: 0.0, ..*material }
}

/// The geometric mean of the arithmetic and the harmonic mean of materials by their weights, of μ and of λ + 2μ each: that of two
/// in equal parts is their geometric mean. As much of it is neo-Hookean, and has fibres, as of their volume; all else is of the first. `None`
/// without any.
pub fn mean(materials: impl Iterator<Item = (Material, Real)> + Clone) -> Option<Material> {
    let mut first = None;
    let (mut weights, mut neo_hookean, mut sums, mut inverses) = (0.0, 0.0, [0.0; 2], [0.0; 2]);
    let fibres = Fibres::mean(materials.clone().map(|(material, weight)| (material.fibres, weight)));
    for (material, weight) in materials {
        first.get_or_insert(material);
        weights += weight;
        neo_hookean += weight * material.neo_hookean;
        for (i, modulus) in [material.mu, material.pressure_modulus()].into_iter().enumerate() {
            sums[i] += weight * modulus;
            inverses[i] += weight / modulus;
        }
    }
    // Roots, unlike logarithms, are the same on every machine.
    let [mu, pressure] = [0, 1].map(|i| (sums[i] / inverses[i]).sqrt());
    let first = first.filter(|_| weights > 0.0)?;
    Some(Material { lambda: pressure - 2.0 * mu, mu, neo_hookean: neo_hookean / weights, fibres, ..first })
}

/// The [`mean`] around node `n` where those are the `materials` of `body`.
pub fn mean_around(body: &Body, n: Node, materials: &[Material]) -> Material {
    let material = |e: Element| body.led(&materials[body.material_number(e)], e);
    let around = body.elements_around(n).iter().map(|e| (material(*e), body.volume(*e)));
    // Every node is of an element.
    mean(around).unwrap_or(*body.material())
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
    /// The [`mean`] of the materials around, by volume, as prepared.
    pub material: Material,
}

impl Stars {
    /// Of all nodes of `body`.
    pub(super) fn new(body: &Body) -> Self {
        if !body.is_smoothed() {
            return Self::default();
        }
        let mut all = Self { first: vec![0], ..Self::default() };
        for n in body.nodes() {
            let begin = all.neighbours.len();
            all.neighbours.extend(body.neighbours(n).iter().copied().filter(|m| *m != n));
            let (star, gradients) = star(body, n, &all.neighbours[begin..]);
            all.gradients.extend(gradients);
            all.stars.push(star);
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

    /// The element that the star of node `n` is where it has this `material`: between `n` and its neighbours.
    pub fn constants(&self, n: Node, material: &Material) -> ElementConstants<&[[Real; 3]]> {
        let volume = self.of(n).volume;
        ElementConstants {
            gradient: &self.gradients[self.range(n)],
            lambda: volume * material.lambda,
            mu: volume * material.mu,
            neo_hookean: material.neo_hookean,
            collapse: material.collapse,
            fibres: material.fibres.rows(volume),
        }
    }
}

/// The star of node `n` with these `neighbours`, and its gradients there.
fn star(body: &Body, n: Node, neighbours: &[Node]) -> (Star, Vec<[Real; 3]>) {
    let mut gradient = vec![Vec3::zeros(); neighbours.len()];
    let mut volume = 0.0;
    for &e in body.elements_around(n) {
        let quarter = body.volume(e) / 4.0;
        volume += quarter;
        for (m, g) in body.element(e).iter().zip(gradients(&body.corners(e))) {
            if let Some(i) = neighbours.iter().position(|other| other == m) {
                gradient[i] += g * quarter;
            }
        }
    }
    let material = mean_around(body, n, &body.parts().materials);
    (Star { volume, material }, gradient.into_iter().map(|b| (b / volume).into()).collect())
}
