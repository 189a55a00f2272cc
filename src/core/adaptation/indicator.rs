//! How badly the present resolution shows the strain.

use crate::ids::{Element, Node};
use crate::math::Real;
use crate::model::{ActiveMesh, Body};

/// An element with less of its volume left is crushed, as next to a node that was pushed through a face of its own
/// elements: smaller ones show nothing better there, but stay tangled when the body is let go, where larger ones do not.
const CRUSHED: Real = 0.5;

/// Strain jump of active node `n` (no unit): the mean over the node's elements, by volume, of `|E_t − Ē|`, `Ē` their
/// mean strain; `None` where one of them is crushed. Unlike the printed γ = |f|/h it does not vanish in equilibrium and does
/// not fire on passing waves.
///
/// `E_t` is the strain of the element; of smoothed elements the mean of its nodes' stars [Zienkiewicz & Zhu 1992]. A tetrahedron
/// that has a part of the energy only takes strains that are of no load: they would be refined for their own sake.
pub fn strain_jump(body: &Body, mesh: &ActiveMesh, n: Node) -> Option<Real> {
    let mut mean = [0.0; 6];
    let mut volume = 0.0;
    let elements = body.elements_around(n);
    for &e in elements {
        if let Some((strain, det)) = strain_and_det(body, mesh, e) {
            if det < CRUSHED {
                return None;
            }
            let v = body.volume(e);
            volume += v;
            mean.iter_mut().zip(strain).for_each(|(m, s)| *m += v * s);
        }
    }
    if volume == 0.0 {
        return Some(0.0);
    }
    mean.iter_mut().for_each(|m| *m /= volume);
    let mut sum = 0.0;
    for &e in elements {
        if let Some((s, _)) = strain_and_det(body, mesh, e) {
            let d: [Real; 6] = std::array::from_fn(|c| s[c] - mean[c]);
            let squared = d[0] * d[0] + d[1] * d[1] + d[2] * d[2] + 2.0 * (d[3] * d[3] + d[4] * d[4] + d[5] * d[5]);
            sum += body.volume(e) * squared.sqrt();
        }
    }
    Some(sum / volume)
}

/// Strain and `det F` of element `e` as its energy has them, if it is in use.
fn strain_and_det(body: &Body, mesh: &ActiveMesh, e: Element) -> Option<([Real; 6], Real)> {
    if body.stars().is_empty() {
        return mesh.pool().strain_and_det(e);
    }
    let (mut strain, mut det, mut stars) = ([0.0; 6], Real::INFINITY, 0.0);
    // Nodes that are not active have no star.
    for (s, d) in body.element(e).iter().filter_map(|n| mesh.stars().strain_and_det(*n)) {
        strain.iter_mut().zip(s).for_each(|(sum, s)| *sum += s);
        (det, stars) = (det.min(d), stars + 1.0);
    }
    (stars > 0.0).then(|| (strain.map(|sum| sum / stars), det))
}
