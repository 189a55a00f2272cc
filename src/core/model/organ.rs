//! The organs of a body: pieces that share nothing but the space around them.
//!
//! Every body has one at least. Vertices, triangles, and the nodes and elements of each level stand organ by organ, so that
//! a count of each says whose is what.

use crate::hierarchy::Level;
use crate::math::{Real, Vec3};
use serde::{Deserialize, Serialize};
use std::ops::Range;

/// Most organs of a body.
pub const MOST_ORGANS: usize = 8;

/// What is saved of one of several organs.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct OrganParts {
    /// A name for people.
    pub name: String,
    /// Its display vertices.
    pub vertices: u32,
    /// Its display triangles.
    pub triangles: u32,
    /// Its material, but for regions: a number in the body's list.
    pub material: u16,
    /// What each level has of it, coarsest first.
    pub levels: Vec<OrganLevel>,
}

/// What a level has of an organ.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct OrganLevel {
    /// Its nodes.
    pub nodes: u32,
    /// Its elements.
    pub elements: u32,
    /// As [`Level::spacing`] [m].
    pub spacing: Real,
    /// As [`Level::least_mass`] [kg].
    pub least_mass: Real,
    /// As [`Level::stabilisation`].
    pub stabilisation: Real,
}

/// An organ, with what follows from it.
#[derive(Clone, Debug)]
pub struct Organ {
    /// A name for people.
    pub name: String,
    /// Its display vertices.
    pub vertices: Range<usize>,
    /// Its display triangles.
    pub triangles: Range<usize>,
    /// Its material, but for regions: a number in the body's list.
    pub material: u16,
    /// Mass [kg], the same for every set of active nodes.
    pub mass: Real,
    /// Centre of mass at rest [m], the same for every set of active nodes.
    pub centre_of_mass: Vec3,
    /// What each level has of it, coarsest first.
    pub levels: Vec<OrganLevel>,
}

impl OrganParts {
    /// All of a body that is a single organ.
    pub fn whole(name: &str, vertices: usize, triangles: usize, levels: &[Level]) -> Self {
        let level = |level: &Level| OrganLevel {
            nodes: level.mesh.nodes.len() as u32,
            elements: level.mesh.elements.len() as u32,
            spacing: level.spacing,
            least_mass: level.least_mass,
            stabilisation: level.stabilisation,
        };
        Self {
            name: name.to_owned(),
            vertices: vertices as u32,
            triangles: triangles as u32,
            material: 0,
            levels: levels.iter().map(level).collect(),
        }
    }
}

/// What follows from `parts`, which have been checked; `finest` is the finest of the `levels` that covers the body.
pub(super) fn organs(parts: &[OrganParts], finest: usize, levels: &[Level]) -> Vec<Organ> {
    let (mut vertex, mut triangle, mut node) = (0, 0, 0);
    let mut next = |organ: &OrganParts| {
        let range = |from: &mut usize, count: u32| {
            *from += count as usize;
            *from - count as usize..*from
        };
        let nodes = range(&mut node, organ.levels[finest].nodes);
        let weighed = nodes.map(|n| (levels[finest].mesh.nodes[n], levels[finest].node_mass[n]));
        let mass: Real = weighed.clone().map(|(_, m)| m).sum();
        let moment: Vec3 = weighed.map(|(u, m)| u * m).sum();
        Organ {
            name: organ.name.clone(),
            vertices: range(&mut vertex, organ.vertices),
            triangles: range(&mut triangle, organ.triangles),
            material: organ.material,
            mass,
            centre_of_mass: moment / mass,
            levels: organ.levels.clone(),
        }
    };
    parts.iter().map(&mut next).collect()
}
