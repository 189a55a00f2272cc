//! The organs of a body: pieces that share nothing but the space around them.
//!
//! Every body has one at least. Vertices, triangles, and the nodes and elements of each level stand organ by organ, so that
//! a count of each says whose is what.

use super::body::BodyParts;
use crate::geometry::locate::Host;
use crate::hierarchy::Level;
use crate::hierarchy::level::NOWHERE;
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
}

/// An organ, with what follows from it.
#[derive(Clone, Debug)]
pub struct Organ {
    /// A name for people.
    pub name: String,
    /// Its display vertices.
    pub vertices: Range<u32>,
    /// Its display triangles.
    pub triangles: Range<u32>,
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
        let range = |from: &mut u32, count: u32| {
            *from += count;
            *from - count..*from
        };
        let nodes = range(&mut node, organ.levels[finest].nodes);
        let weighed = nodes.map(|n| (levels[finest].mesh.nodes[n as usize], levels[finest].node_mass[n as usize]));
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

/// Refuses organs that are not those of the body, or that share anything; all else of `parts` has been checked.
pub(super) fn check(parts: &BodyParts) -> Result<(), String> {
    let BodyParts { organs, surface, levels, materials, .. } = parts;
    if organs.is_empty() {
        return Ok(());
    }
    if organs.len() > MOST_ORGANS || organs.iter().any(|organ| organ.levels.len() != levels.len()) {
        return Err(format!("{} organs: a body has 1 to {MOST_ORGANS}, each on every level", organs.len()));
    }
    let of = |r: usize| organs.iter().map(move |organ| &organ.levels[r]);
    let positive = |level: &OrganLevel| level.spacing > 0.0 && level.least_mass >= 0.0;
    let known = |organ: &OrganParts| usize::from(organ.material) < materials.len();
    if !(0..levels.len()).flat_map(of).all(positive) || !organs.iter().all(known) {
        return Err("an organ has a spacing or a material that is none".into());
    }
    let shared = || "organs share a part, or have none of the surface or of a level".to_owned();
    let vertices = owners(organs.iter().map(|o| o.vertices), surface.vertices.len()).ok_or_else(shared)?;
    let triangles = owners(organs.iter().map(|o| o.triangles), surface.triangles.len()).ok_or_else(shared)?;
    // True where nothing names a thing of another organ.
    fn own(owner: &[u8], mut names: impl Iterator<Item = (usize, u32)>, of: &[u8]) -> bool {
        names.all(|(i, named)| named == NOWHERE || of.get(named as usize) == Some(&owner[i]))
    }
    let corners = surface.triangles.iter().enumerate().flat_map(|(t, corners)| corners.map(|v| (t, v)));
    let mut apart = own(&triangles, corners, &vertices);
    let mut coarser: Option<(Vec<u8>, Vec<u8>)> = None;
    for (r, level) in levels.iter().enumerate() {
        let nodes = owners(of(r).map(|l| l.nodes), level.mesh.nodes.len()).ok_or_else(shared)?;
        let elements = owners(of(r).map(|l| l.elements), level.mesh.elements.len()).ok_or_else(shared)?;
        let corners = level.mesh.elements.iter().enumerate().flat_map(|(e, corners)| corners.map(|n| (e, n)));
        apart &= own(&elements, corners, &nodes);
        apart &= own(&vertices, hosts(&level.embedding), &elements);
        if let Some((coarse_nodes, coarse_elements)) = &coarser {
            apart &= own(&nodes, level.parent.iter().copied().enumerate(), coarse_nodes);
            apart &= own(&nodes, hosts(&level.coarser_host), coarse_elements);
            apart &= own(coarse_nodes, hosts(&levels[r - 1].finer_host), &elements);
        }
        coarser = Some((nodes, elements));
    }
    if apart { Ok(()) } else { Err(shared()) }
}

fn hosts(of: &[Host]) -> impl Iterator<Item = (usize, u32)> + '_ {
    of.iter().map(|host| host.element).enumerate()
}

/// Which organ each of `total` things is of, when `counts` says how many each has; `None` unless that is at least one
/// each and all of them together.
fn owners(counts: impl Iterator<Item = u32> + Clone, total: usize) -> Option<Vec<u8>> {
    let fits = counts.clone().all(|n| n > 0) && counts.clone().map(u64::from).sum::<u64>() == total as u64;
    fits.then(|| counts.zip(0..).flat_map(|(count, organ)| std::iter::repeat_n(organ, count as usize)).collect())
}
