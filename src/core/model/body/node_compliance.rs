//! What a mesh shows of the dent under a point load: how far its nodes give way to a force on themselves and on each other.
//!
//! Estimates, made of what is near: an elastic solution for each node would take minutes. A node held by its neighbours
//! alone tells most of how its elements lie around it, the rest is as under a load on a half-space.

use super::Body;
use crate::geometry::tet_mesh::{gradients, volume};
use crate::ids::{Element, Node, Vertex};
use crate::math::{Mat3, Real, Vec3};
use crate::model::csr::Csr;
use crate::model::material::Material;

/// How far nodes give way along the surface's normal for a newton along it, on the level at rest [m/N].
#[derive(Clone, Debug, Default)]
pub(super) struct NodeCompliance {
    /// To a force on themselves (n_nodes).
    own: Vec<Real>,
    /// Around each node (n_nodes).
    around: Vec<Surroundings>,
    /// Nodes of larger number that share an element with each node, both of elements that display the surface.
    neighbours: Csr<Node>,
    /// To a force on the node, for each of its neighbours, in their order.
    shared: Vec<Real>,
}

/// The mesh around a node, on the average over its elements' volume.
#[derive(Clone, Copy, Debug, Default)]
struct Surroundings {
    /// [`Material::half_space`] [m²/N].
    half_space: Real,
    /// What near nodes give way more than points of a half-space do.
    nearer: Real,
    /// [`element_width`] times the factor on the stiffness [m].
    width: Real,
}

impl NodeCompliance {
    /// Of all nodes of `body`.
    pub(super) fn new(body: &Body) -> Self {
        let normals = normals(body);
        let blocks = blocks(body);
        let (around, materials) = surroundings(body);
        let of_node = |n: usize| {
            let (outward, near, material) = (normals[n], &around[n], &materials[n]);
            let held = if body.is_fixed(Node::at(n)) { None } else { blocks[n].try_inverse() };
            // Nodes that carry no part of the displayed surface move alike in all directions, on average.
            let along = |m: Mat3| if outward == Vec3::zeros() { m.trace() / 3.0 } else { outward.dot(&(m * outward)) };
            let nu = material.poisson_ratio();
            let wide = near.half_space * (WIDE + WIDE_NU * nu * nu) / near.width;
            held_share(material) * held.map_or(0.0, along) + wide
        };
        let own = (0..body.node_count()).map(of_node).collect();

        let carries = carriers(body);
        let nodes_of = |e: Element, [i, j]: [usize; 2]| (body.element(e)[i], body.element(e)[j]);
        let mut edges = Vec::new();
        each_edge(body, &carries, |e, edge| edges.push(nodes_of(e, edge)));
        edges.sort_unstable();
        edges.dedup();
        let mut stiffness = vec![Mat3::zeros(); edges.len()];
        each_edge(body, &carries, |e, edge| {
            if let Ok(i) = edges.binary_search(&nodes_of(e, edge)) {
                let [g, h] = edge.map(|i| gradients(&body.corners(e))[i]);
                let weight = body.volume(e) * body.stiffness_factor(e);
                stiffness[i] += stiffness_between(body.material_of(e), &g, &h) * weight;
            }
        });
        let of_edge = |(edge, between): (&(Node, Node), &Mat3)| {
            let (k, l) = (edge.0.index(), edge.1.index());
            let give = if body.is_fixed(edge.0) || body.is_fixed(edge.1) {
                None
            } else {
                mutual(&blocks[k], &blocks[l], between)
            };
            let along = give.map_or(0.0, |m| normals[k].dot(&(m * normals[l])));
            let apart = (body.rest(edge.0) - body.rest(edge.1)).norm();
            held_share(&materials[k]) * along + around[k].mean(&around[l]).near(apart)
        };
        let shared = edges.iter().zip(&stiffness).map(of_edge).collect();
        Self {
            own,
            around,
            neighbours: Csr::new(body.node_count(), edges.iter().map(|(k, l)| (k.index(), *l))),
            shared,
        }
    }

    /// Of node `k` to a force on node `l`, or the other way round; `apart` from each other at rest [m].
    pub(super) fn between(&self, k: Node, l: Node, apart: Real) -> Real {
        if k == l {
            return self.own[k.index()];
        }
        let (k, l) = (k.min(l), k.max(l));
        if let Ok(i) = self.neighbours.of(k.index()).binary_search(&l) {
            return self.shared[self.neighbours.start_of(k.index()) + i];
        }
        let around = self.around[k.index()].mean(&self.around[l.index()]);
        // Nodes of different levels may be at one place.
        let most = 0.5 * (self.own[k.index()] + self.own[l.index()]);
        most.min(if apart < NEAR * around.width { around.near(apart) } else { around.half_space / apart })
    }
}

impl Surroundings {
    fn mean(&self, other: &Self) -> Self {
        Self {
            half_space: 0.5 * (self.half_space + other.half_space),
            nearer: 0.5 * (self.nearer + other.nearer),
            width: 0.5 * (self.width + other.width),
        }
    }

    /// What nodes that are near give way to a force `apart` from them [m/N], as far as it is a half-space's.
    fn near(&self, apart: Real) -> Real {
        self.nearer * self.half_space / apart
    }
}

/// What is around each node, and the mean of the materials there.
fn surroundings(body: &Body) -> (Vec<Surroundings>, Vec<Material>) {
    // λ, μ and width times the volume, and the volume.
    let mut sums = vec![[0.0; 4]; body.node_count()];
    for e in body.elements() {
        let (material, part) = (body.material_of(e), body.volume(e));
        let width = body.stiffness_factor(e) * element_width(body.corners(e));
        for n in body.element(e) {
            let more = [part * material.lambda, part * material.mu, part * width, part];
            sums[n.index()].iter_mut().zip(more).for_each(|(sum, more)| *sum += more);
        }
    }
    let of_node = |[lambda, mu, width, volume]: [Real; 4]| {
        let material = Material { lambda: lambda / volume, mu: mu / volume, ..*body.material() };
        let nu = material.poisson_ratio();
        let nearer = 1.0 + NEARER_NU * nu * nu;
        (Surroundings { half_space: material.half_space(), nearer, width: width / volume }, material)
    };
    sums.into_iter().map(of_node).unzip()
}

/// What counts of how far a node gives way that its neighbours hold.
fn held_share(material: &Material) -> Real {
    1.0 + HELD_LAMBDA * material.lambda / material.mu
}

/// Whether the displayed surface lies in an element of each node (n_nodes).
fn carriers(body: &Body) -> Vec<bool> {
    let mut carries = vec![false; body.node_count()];
    for r in 0..body.levels().len() {
        for host in body.vertices().filter_map(|v| body.embedding(r, v)) {
            body.element(host.element).iter().for_each(|n| carries[n.index()] = true);
        }
    }
    carries
}

/// Calls `f` for each element's edges between nodes that carry the surface, as the element and two of its corners, that of
/// the smaller number first.
fn each_edge(body: &Body, carries: &[bool], mut f: impl FnMut(Element, [usize; 2])) {
    for e in body.elements() {
        let nodes = body.element(e);
        for i in (0..4).filter(|i| carries[nodes[*i].index()]) {
            (0..4).filter(|j| nodes[i] < nodes[*j] && carries[nodes[*j].index()]).for_each(|j| f(e, [i, j]));
        }
    }
}

/// How two nodes of own stiffness `k` and `l` and stiffness `between` them give way to a force on each other [m/N], while
/// all others are held: the inverse's block beside the diagonal.
fn mutual(k: &Mat3, l: &Mat3, between: &Mat3) -> Option<Mat3> {
    let own = k.try_inverse()?;
    let rest = l - between.transpose() * own * between;
    Some(-(own * between) * rest.try_inverse()?)
}

/// Unit normal of what hangs on each node of the surface; zero where nothing does.
fn normals(body: &Body) -> Vec<Vec3> {
    let surface = body.surface();
    let mut of_vertex = vec![Vec3::zeros(); surface.vertices.len()];
    for triangle in &surface.triangles {
        let [a, b, c] = triangle.map(|v| surface.vertices[v as usize]);
        triangle.iter().for_each(|v| of_vertex[*v as usize] += (b - a).cross(&(c - a)));
    }
    let mut normals = vec![Vec3::zeros(); body.node_count()];
    for r in 0..body.levels().len() {
        for (v, outward) in of_vertex.iter().enumerate() {
            let Some(host) = body.embedding(r, Vertex::at(v)) else { continue };
            for (n, w) in body.element(host.element).iter().zip(host.weights) {
                normals[n.index()] += outward * w.max(0.0);
            }
        }
    }
    normals.into_iter().map(|n| n.try_normalize(0.0).unwrap_or_default()).collect()
}

/// Each node's own block of the stiffness of its level at rest [N/m].
fn blocks(body: &Body) -> Vec<Mat3> {
    let mut blocks = vec![Mat3::zeros(); body.node_count()];
    for e in body.elements() {
        let (material, weight) = (body.material_of(e), body.volume(e) * body.stiffness_factor(e));
        for (n, g) in body.element(e).iter().zip(gradients(&body.corners(e))) {
            blocks[n.index()] += stiffness_between(material, &g, &g) * weight;
        }
    }
    blocks
}

/// Stiffness between two nodes of an element, whose weights have the gradients `g` and `h`, over its volume:
/// `μ (g·h I + h gᵀ) + λ g hᵀ` [N/m⁴].
fn stiffness_between(material: &Material, g: &Vec3, h: &Vec3) -> Mat3 {
    (Mat3::identity() * g.dot(h) + h * g.transpose()) * material.mu + g * h.transpose() * material.lambda
}

/// `V Σ|g|²` [m] of the tetrahedron of these corners, `g` the gradients of its four weights.
fn element_width(corners: [Vec3; 4]) -> Real {
    gradients(&corners).iter().map(Vec3::norm_squared).sum::<Real>() * volume(&corners)
}

// Measured on covers of a block with spacings of 6 to 12.5 mm and ν of 0.1, 0.35 and 0.45: with these, the small force of a
// ball on the mesh and the dents that it does not show is 0 to 5 % below the continuum's, wherever the ball is.

/// What a node gives way while its neighbours are held counts more by this for each λ/μ.
const HELD_LAMBDA: Real = 0.03;
/// Beside that a node gives way by this over the width of its elements, ...
const WIDE: Real = 0.88;
/// ... more by this for each ν².
const WIDE_NU: Real = 3.0;
/// Near nodes give way more by this for each ν² than points of a half-space do.
const NEARER_NU: Real = 0.45;
/// How many widths of the elements that are near.
const NEAR: Real = 2.8;
