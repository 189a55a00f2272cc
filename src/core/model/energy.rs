//! Energies of a body: plain sums for samples and tests, off the hot path.

use super::active_mesh::ActiveMesh;
use super::body::Body;
use crate::ids::{Element, Node};
use crate::math::{Mat3, Real, Vec3};

/// Energies [J] and momenta of the body about the origin.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Energy {
    /// Σ ½ m v² [J].
    pub kinetic: Real,
    /// Strain energy of the elements and of the springs that hold the body [J]; not what Maxwell branches store.
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

/// Deformation gradient of element `e`, which is in use.
pub fn deformation_gradient(body: &Body, mesh: &ActiveMesh, e: Element) -> Mat3 {
    let u = body.corners(e);
    let x = body.element(e).map(|n| mesh.position_of(n).unwrap_or_else(|| body.rest(n)));
    let columns = |p: &[Vec3; 4]| Mat3::from_columns(&[p[1] - p[0], p[2] - p[0], p[3] - p[0]]);
    // Elements have volume (checked when the body is made), so the inverse exists.
    columns(&x) * columns(&u).try_inverse().unwrap_or_else(Mat3::identity)
}

/// Energies and momenta of `mesh` in the field `gravity` [m/s²].
pub fn energy(body: &Body, mesh: &ActiveMesh, gravity: Vec3) -> Energy {
    let mut sum = Energy::default();
    for &slot in mesh.active() {
        let (s, mass) = (slot.index(), mesh.motion.mass[slot.index()]);
        let vec3 = |p: &[Real; 4]| Vec3::new(p[0], p[1], p[2]);
        let (x, v) = (vec3(&mesh.motion.position[s]), vec3(&mesh.motion.velocity[s]));
        sum.kinetic += 0.5 * mass * v.norm_squared();
        sum.gravity -= mass * gravity.dot(&(x - body.rest(mesh.node(slot))));
        sum.linear_momentum += v * mass;
        sum.angular_momentum += x.cross(&v) * mass;
    }
    for e in body.elements() {
        let active = mesh.active_vertices(e);
        if active > 0 {
            let f = deformation_gradient(body, mesh, e);
            let weight = body.volume(e) * Real::from(active) / 4.0;
            sum.elastic += weight * mesh.jumps_material(body, e).energy_density(&f);
        }
    }
    for n in mesh.active().iter().map(|slot| mesh.node(*slot)).filter(|_| !body.stars().is_empty()) {
        let place = |n: &Node| mesh.position_of(*n).unwrap_or_else(|| body.rest(*n));
        let constants = mesh.star_constants(body, n);
        let f = constants.deformation(place(&n), body.stars().neighbours(n).iter().map(place));
        sum.elastic += body.stars().of(n).volume * mesh.means_material(body, n).energy_density(&f);
    }
    for hold in body.supports() {
        let stretch = mesh.vertex(hold.vertex) - body.surface().vertices[hold.vertex.index()];
        sum.elastic += 0.5 * mesh.support_factor() * hold.stiffness * stretch.norm_squared();
    }
    sum
}
