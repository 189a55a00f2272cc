//! A finest level that covers only a region of the body: as fine as wanted where it is wanted, at the memory of that.

use super::PrepareError;
use palpate_core::geometry::locate::{Host, Locator};
use palpate_core::hierarchy::Level;
use palpate_core::ids::NONE;
use palpate_core::math::{Bounds, Real, Vec3};
use palpate_core::model::body::{Body, BodyParts};

/// A part of space: where a level is to reach, or where a material is another.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Reach {
    /// A box between these corners [m].
    Box(Bounds),
    /// A ball around a point, of this radius [m].
    Ball(Vec3, Real),
}

impl Reach {
    /// Signed distance of `p` from its border [m], negative inside.
    pub fn distance(&self, p: &Vec3) -> Real {
        match self {
            Reach::Box(Bounds { low, high }) => {
                let beyond = (low - p).sup(&(p - high));
                beyond.sup(&Vec3::zeros()).norm() + beyond.max().min(0.0)
            }
            Reach::Ball(centre, radius) => (p - centre).norm() - radius,
        }
    }

    /// How far it reaches across, where that is least [m].
    pub fn width(&self) -> Real {
        match self {
            Reach::Box(all) => all.size().min(),
            Reach::Ball(_, radius) => 2.0 * radius,
        }
    }

    /// True for points inside.
    pub fn contains(&self, p: &Vec3) -> bool {
        match self {
            Reach::Box(all) => all.contains(p),
            Reach::Ball(centre, radius) => (p - centre).norm_squared() <= radius * radius,
        }
    }
}

/// `body` whose finest level is left out but for the families of the nodes of the next coarser level in `reach`, and for
/// the elements around them. There it moves as the whole body does.
///
/// # Errors
/// When the body has one level only, or `reach` contains no node of the next coarser one.
pub fn keep_finest_within(body: Body, reach: &Reach) -> Result<Body, PrepareError> {
    let empty = PrepareError::EmptyReach { body: body.surface().bounds() };
    let mut parts = body.into_parts();
    let BodyParts { levels, material_of, labels, .. } = &mut parts;
    let (Some(fine), Some(materials)) = (levels.pop(), material_of.pop()) else { return Err(empty) };
    let Some(coarse) = levels.last_mut() else { return Err(empty) };
    let refined: Vec<bool> = coarse.mesh.nodes.iter().map(|u| reach.contains(u)).collect();
    if !refined.contains(&true) {
        return Err(empty);
    }
    let stands = |n: u32| refined[fine.parent[n as usize] as usize];
    let kept: Vec<usize> =
        (0..fine.mesh.elements.len()).filter(|e| fine.mesh.elements[*e].iter().any(|n| stands(*n))).collect();
    let (nodes, number) = numbered(fine.mesh.nodes.len(), kept.iter().flat_map(|e| fine.mesh.elements[*e]));
    let (_, element) = numbered(fine.mesh.elements.len(), kept.iter().map(|e| *e as u32));
    let of_nodes = |values: &[Real]| nodes.iter().map(|n| values[*n as usize]).collect();
    let of_elements = |values: &[Real]| kept.iter().map(|e| values[*e]).collect();
    let mut small = Level {
        mesh: palpate_core::geometry::TetMesh {
            nodes: nodes.iter().map(|n| fine.mesh.nodes[*n as usize]).collect(),
            elements: kept.iter().map(|e| fine.mesh.elements[*e].map(|n| number[n as usize])).collect(),
        },
        fraction: of_elements(&fine.fraction),
        density: of_elements(&fine.density),
        node_mass: of_nodes(&fine.node_mass),
        parent: nodes.iter().map(|n| fine.parent[*n as usize]).collect(),
        coarser_host: nodes.iter().map(|n| fine.coarser_host[*n as usize]).collect(),
        embedding: fine.embedding.iter().map(|h| Host { element: renumbered(&element, h.element), ..*h }).collect(),
        fixed: fine.fixed.iter().map(|n| number[*n as usize]).filter(|n| *n != NONE).collect(),
        ghosts: (0..nodes.len() as u32).filter(|n| !stands(nodes[*n as usize])).collect(),
        finer_host: Vec::new(),
        ..fine
    };
    small.fixed.sort_unstable();
    let locator = Locator::new(&small.mesh, small.spacing);
    let host = |(u, refined): (&Vec3, &bool)| {
        if *refined { locator.host(*u) } else { Host { element: NONE, weights: [0.25; 4] } }
    };
    coarse.finer_host = coarse.mesh.nodes.iter().zip(&refined).map(host).collect();
    material_of.push(if materials.is_empty() { materials } else { kept.iter().map(|e| materials[*e]).collect() });
    if let Some(of) = labels.of.last_mut() {
        *of = kept.iter().map(|e| of[*e]).collect();
    }
    if let Some(of) = labels.directions.last_mut() {
        *of = kept.iter().map(|e| of[*e]).collect();
    }
    levels.push(small);
    Ok(Body::new(parts)?)
}

/// Which of `count` things are `named`, ascending, and the new number of each; [`NONE`] for the others.
fn numbered(count: usize, named: impl Iterator<Item = u32>) -> (Vec<u32>, Vec<u32>) {
    let mut number = vec![NONE; count];
    named.for_each(|n| number[n as usize] = 0);
    let kept: Vec<u32> = (0..count as u32).filter(|n| number[*n as usize] == 0).collect();
    kept.iter().zip(0..).for_each(|(n, new)| number[*n as usize] = new);
    (kept, number)
}

/// The new number of `element`, which may lie nowhere already.
fn renumbered(number: &[u32], element: u32) -> u32 {
    number.get(element as usize).copied().unwrap_or(NONE)
}
