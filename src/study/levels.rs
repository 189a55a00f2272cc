//! Independent levels of one body for the studies, and sets of active nodes on them.
//!
//! The nodes of all levels stand in one array, coarsest level first, so that a node is one number whatever its level.

use super::laws::{Element, Spring};
use palpate_core::geometry::TetMesh;
use palpate_core::geometry::primitives::box_mesh;
use palpate_core::geometry::tet_mesh::volume;
use palpate_core::hierarchy::level::mean_edge;
use palpate_core::hierarchy::{Level, parentage};
use palpate_core::math::{Bounds, Real, Vec3};
use palpate_core::model::Material;

/// Chance from a seed: SplitMix64, so that every study repeats bit for bit.
#[derive(Clone, Debug)]
pub struct Random(u64);

impl Random {
    /// The sequence of `seed`.
    pub fn new(seed: u64) -> Self {
        Self(seed)
    }

    /// Uniform in 0..1.
    pub fn unit(&mut self) -> Real {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((z ^ (z >> 31)) >> 11) as Real / (1u64 << 53) as Real
    }

    /// Uniform in the cube from −1 to 1.
    pub fn in_cube(&mut self) -> Vec3 {
        Vec3::from_fn(|_, _| 2.0 * self.unit() - 1.0)
    }
}

/// How far a node of [`independent_box`] strays, in cells: much more would flatten elements and shorten every step.
const STRAY: Real = 0.12;

/// A box from the origin to `size` [m] whose mesh conforms to it and shares with another seed's only the corners: the
/// regular mesh of `cells`, mirrored by chance, every node moved by chance along the faces it lies on.
pub fn independent_box(size: Vec3, cells: [u32; 3], seed: u64) -> TetMesh {
    let mut mesh = box_mesh(size, cells);
    let mut random = Random::new(seed);
    for axis in 0..3 {
        if random.unit() < 0.5 {
            mesh.nodes.iter_mut().for_each(|u| u[axis] = size[axis] - u[axis]);
        }
        let step = size[axis] / Real::from(cells[axis]);
        for u in &mut mesh.nodes {
            let stray = STRAY * step * (2.0 * random.unit() - 1.0);
            if u[axis] > 0.1 * step && u[axis] < size[axis] - 0.1 * step {
                u[axis] += stray;
            }
        }
    }
    for element in &mut mesh.elements {
        if volume(&element.map(|n| mesh.nodes[n as usize])) < 0.0 {
            element.swap(2, 3);
        }
    }
    mesh
}

/// The levels of one body, their nodes and elements numbered through.
#[derive(Clone, Debug)]
pub struct Levels {
    /// The levels as prepared, coarsest first.
    pub tied: Vec<Level>,
    /// Number of each level's first node, and after the last the count of all (n_levels + 1).
    pub first_node: Vec<usize>,
    /// Number of each level's first element, and after the last the count of all (n_levels + 1).
    pub first_element: Vec<usize>,
    /// Rest positions [m] (n_nodes).
    pub rest: Vec<Vec3>,
    /// Level of each node (n_nodes).
    pub level_of: Vec<usize>,
    /// Nodes that never move (n_nodes).
    pub fixed: Vec<bool>,
    /// All elements, with numbered-through nodes.
    pub elements: Vec<Element>,
    /// Springs along the edges of all elements, for the law that has no elements.
    pub springs: Vec<Spring>,
    /// Smallest altitude [m] of each element.
    pub altitude: Vec<Real>,
    /// Children of each node (n_nodes); none on the finest level.
    pub children: Vec<Vec<usize>>,
    /// What the body is made of.
    pub material: Material,
}

impl Levels {
    /// Ties `levels` (coarsest first) of a body of `material`; nodes for which `fixed` holds never move.
    pub fn new(mut levels: Vec<Level>, material: Material, fixed: impl Fn(&Vec3) -> bool) -> Self {
        parentage::tie(&mut levels);
        let (mut rest, mut level_of, mut elements, mut altitude) = (vec![], vec![], vec![], vec![]);
        let (mut first_node, mut first_element) = (vec![0], vec![0]);
        for (index, level) in levels.iter().enumerate() {
            let first = rest.len();
            for (e, nodes) in level.mesh.elements.iter().enumerate() {
                let nodes = nodes.map(|n| first + n as usize);
                elements.push(Element::new(nodes, level.mesh.corners(e), level.fraction[e]));
                altitude.push(level.mesh.smallest_altitude(e));
            }
            rest.extend(&level.mesh.nodes);
            level_of.resize(rest.len(), index);
            first_node.push(rest.len());
            first_element.push(elements.len());
        }
        let mut children = vec![Vec::new(); rest.len()];
        for (index, level) in levels.iter().enumerate().skip(1) {
            for (n, parent) in level.parent.iter().enumerate() {
                children[first_node[index - 1] + *parent as usize].push(first_node[index] + n);
            }
        }
        let fixed = rest.iter().map(fixed).collect();
        let springs = Spring::along(&elements, &rest);
        Self {
            tied: levels,
            first_node,
            first_element,
            rest,
            level_of,
            fixed,
            elements,
            springs,
            altitude,
            children,
            material,
        }
    }

    /// A box of `size` [m] with one independent conforming mesh for each of `cells`, coarsest first; `clamped` fixes
    /// the nodes at x = 0.
    pub fn of_box(size: Vec3, cells: &[[u32; 3]], material: Material, clamped: bool) -> Self {
        let level = |(index, cells): (usize, &[u32; 3])| {
            let mesh = independent_box(size, *cells, 11 + index as u64);
            let (n, edge) = (mesh.elements.len(), mean_edge(&mesh));
            Level::new(mesh, vec![1.0; n], edge, material.density)
        };
        Self::new(cells.iter().enumerate().map(level).collect(), material, |u| clamped && u.x < 1e-9)
    }

    /// The cube of 1 m that most studies share: spacings in a ratio of about 5/3.
    pub fn of_cube(material: Material, clamped: bool) -> Self {
        Self::of_box(Vec3::repeat(1.0), &[[3; 3], [5; 3], [8; 3]], material, clamped)
    }

    /// Number of levels.
    pub fn count(&self) -> usize {
        self.tied.len()
    }

    /// Mass of the body [kg].
    pub fn body_mass(&self) -> Real {
        self.tied[self.count() - 1].node_mass.iter().sum()
    }

    /// The node's number within its own level.
    pub fn local(&self, node: usize) -> usize {
        node - self.first_node[self.level_of[node]]
    }

    /// Where `node` lies in the next coarser level: four nodes and their weights.
    pub fn coarser_host(&self, node: usize) -> Option<[(usize, Real); 4]> {
        let level = self.level_of[node];
        let host = self.tied[level].coarser_host.get(self.local(node))?;
        let corners = self.elements[self.first_element[level - 1] + host.element as usize].nodes;
        Some(std::array::from_fn(|i| (corners[i], host.weights[i])))
    }

    /// Where `node` lies in the next finer level: four nodes and their weights.
    pub fn finer_host(&self, node: usize) -> Option<[(usize, Real); 4]> {
        let level = self.level_of[node];
        let host = self.tied[level].finer_host.get(self.local(node))?;
        let corners = self.elements[self.first_element[level + 1] + host.element as usize].nodes;
        Some(std::array::from_fn(|i| (corners[i], host.weights[i])))
    }

    /// All nodes of one level active.
    pub fn uniform(&self, level: usize) -> Vec<bool> {
        self.level_of.iter().map(|l| *l == level).collect()
    }

    /// True where `node` has given way to finer ones: one below it is active.
    pub fn is_refined(&self, active: &[bool], node: usize) -> bool {
        self.children[node].iter().any(|c| active[*c] || self.is_refined(active, *c))
    }

    /// Replaces the active `node` by its children; refuses when it has none.
    pub fn split(&self, active: &mut [bool], node: usize) -> bool {
        if !active[node] || self.children[node].is_empty() {
            return false;
        }
        active[node] = false;
        self.children[node].iter().for_each(|c| active[*c] = true);
        true
    }

    /// Replaces the children of `parent` by it; refuses unless all of them are active.
    pub fn merge(&self, active: &mut [bool], parent: usize) -> bool {
        if self.children[parent].is_empty() || !self.children[parent].iter().all(|c| active[*c]) {
            return false;
        }
        active[parent] = true;
        self.children[parent].iter().for_each(|c| active[*c] = false);
        true
    }

    /// A set of active nodes made by chance: even seeds refine around one point, radius shrinking with the level, as a
    /// tool does; odd seeds split single nodes here and there, the worst that any criterion could do.
    pub fn random_active_set(&self, seed: u64) -> Vec<bool> {
        let mut random = Random::new(1000 + seed);
        let around = Bounds::of(self.rest.iter().copied());
        let centre = around.low + around.size().component_mul(&Vec3::from_fn(|_, _| random.unit()));
        let radius = (0.35 + 0.25 * random.unit()) * around.size().max();
        let mut active = self.uniform(0);
        for level in 0..self.count() - 1 {
            for node in self.first_node[level]..self.first_node[level + 1] {
                let wanted = if seed.is_multiple_of(2) {
                    (self.rest[node] - centre).norm() < radius * (0.6 as Real).powi(level as i32)
                } else {
                    random.unit() < 0.5
                };
                if wanted {
                    self.split(&mut active, node);
                }
            }
        }
        active
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn levels() -> Levels {
        let material = Material::from_young(2e5, 0.33, 1000.0);
        Levels::of_box(Vec3::repeat(1.0), &[[2; 3], [3; 3], [5; 3]], material, false)
    }

    #[test]
    fn an_active_set_covers_the_body_once() {
        let levels = levels();
        for seed in 0..6 {
            let active = levels.random_active_set(seed);
            // Every finest node has exactly one active ancestor, itself included.
            for node in levels.first_node[2]..levels.first_node[3] {
                let parent = levels.tied[2].parent[levels.local(node)] as usize + levels.first_node[1];
                let grandparent = levels.tied[1].parent[levels.local(parent)] as usize + levels.first_node[0];
                assert_eq!([node, parent, grandparent].iter().filter(|n| active[**n]).count(), 1);
            }
        }
    }

    #[test]
    fn boxes_are_sound_and_independent() {
        let levels = levels();
        let volume: Real = (0..levels.count()).map(|l| levels.tied[l].volume()).sum();
        assert!((volume - 3.0).abs() < 1e-12);
        assert!(levels.elements.iter().all(|e| e.volume > 0.0));
        let shared = levels.tied[0]
            .mesh
            .nodes
            .iter()
            .filter(|u| levels.tied[1].mesh.nodes.iter().any(|v| (*u - v).norm() < 1e-6));
        assert_eq!(shared.count(), 8);
    }

    #[test]
    fn merging_undoes_splitting() {
        let levels = levels();
        let mut active = levels.uniform(0);
        assert!(levels.split(&mut active, 4));
        assert!(!levels.split(&mut active, 4));
        assert!(levels.merge(&mut active, 4));
        assert_eq!(active, levels.uniform(0));
    }
}
