//! Energies and momenta of a state: plain sums for samples and tests, off the hot path.

use super::body::Body;
use super::state::State;
use crate::math::{Mat3, Real, Vec3};

/// Energies [J] and momenta of the body about the origin.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Energy {
    /// Σ ½ m v² [J].
    pub kinetic: Real,
    /// Strain energy of the elements and of the springs that hold the body [J].
    pub elastic: Real,
    /// −Σ m g·(x − u) [J]: zero at rest.
    pub gravity: Real,
    /// Σ m v [kg·m/s].
    pub linear_momentum: Vec3,
    /// Σ m x × v [kg·m²/s].
    pub angular_momentum: Vec3,
}

impl Energy {
    /// The three energies together [J].
    pub fn total(&self) -> Real {
        self.kinetic + self.elastic + self.gravity
    }
}

/// Deformation gradient of element `e` of the level that moves.
pub fn deformation_gradient(body: &Body, position: &[Vec3], e: usize) -> Mat3 {
    let level = body.level();
    let u = level.mesh.corners(e);
    let x = level.mesh.elements[e].map(|n| position[n as usize]);
    let columns = |p: &[Vec3; 4]| Mat3::from_columns(&[p[1] - p[0], p[2] - p[0], p[3] - p[0]]);
    // Elements have volume (checked when the body is made), so the inverse exists.
    columns(&x) * columns(&u).try_inverse().unwrap_or_else(Mat3::identity)
}

/// Energies and momenta of `state` in the field `gravity` [m/s²].
pub fn energy(body: &Body, state: &State, gravity: Vec3) -> Energy {
    let level = body.level();
    let mut sum = Energy::default();
    for (n, mass) in level.node_mass.iter().enumerate() {
        let (x, v) = (state.position[n], state.velocity[n]);
        sum.kinetic += 0.5 * mass * v.norm_squared();
        sum.gravity -= mass * gravity.dot(&(x - level.mesh.nodes[n]));
        sum.linear_momentum += v * *mass;
        sum.angular_momentum += x.cross(&v) * *mass;
    }
    for e in 0..level.mesh.elements.len() {
        let f = deformation_gradient(body, &state.position, e);
        sum.elastic += level.fraction[e] * level.mesh.volume(e) * body.material_of(e).energy_density(&f);
    }
    for (hold, row) in body.holds() {
        let q: Vec3 = row.iter().map(|(n, w)| state.position[*n as usize] * *w).sum();
        sum.elastic += 0.5 * hold.stiffness * (q - body.surface().vertices[hold.vertex as usize]).norm_squared();
    }
    sum
}
