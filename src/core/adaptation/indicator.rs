//! How badly the present resolution shows the strain.

use crate::ids::Node;
use crate::math::Real;
use crate::model::{ActiveMesh, Body};

/// An element with less of its volume left is crushed, as next to a node that was pushed through a face of its own
/// elements: smaller ones show nothing better there, but stay tangled when the body is let go, where larger ones do not.
const CRUSHED: Real = 0.5;

/// Strain jump of active node `n` (no unit): the mean over the node's elements, by volume, of `|E_t − Ē|`, `Ē` their
/// mean strain; `None` where one of them is crushed. Unlike the printed γ = |f|/h it does not vanish in equilibrium and does
/// not fire on passing waves.
pub fn strain_jump(body: &Body, mesh: &ActiveMesh, n: Node) -> Option<Real> {
    let mut mean = [0.0; 6];
    let mut volume = 0.0;
    let elements = body.elements_around(n);
    for &e in elements {
        if let Some((strain, det)) = mesh.pool().strain_and_det(e) {
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
        if let Some(s) = mesh.pool().strain(e) {
            let d: [Real; 6] = std::array::from_fn(|c| s[c] - mean[c]);
            let squared = d[0] * d[0] + d[1] * d[1] + d[2] * d[2] + 2.0 * (d[3] * d[3] + d[4] * d[4] + d[5] * d[5]);
            sum += body.volume(e) * squared.sqrt();
        }
    }
    Some(sum / volume)
}
