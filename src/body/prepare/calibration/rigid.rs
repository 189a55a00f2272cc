//! Rigid motions of a level, and what holds it against them.

use super::block::{Block, columns};
use nalgebra::SMatrix;
use palpate_core::hierarchy::Level;
use palpate_core::math::{Real, Vec3};

/// A rigid motion for the load along each axis (column): three shifts [m], three turns times the radius of gyration [m].
pub(super) type RigidMotion = SMatrix<Real, 6, 3>;
pub(super) type Mat6 = SMatrix<Real, 6, 6>;

/// Where points lie from the centre of mass, in radii of gyration: makes shifts and turns comparable.
pub(super) struct Arms {
    centre: Vec3,
    radius: Real,
}

impl Arms {
    pub(super) fn new(level: &Level) -> Arms {
        let mass: Real = level.node_mass.iter().sum();
        let centre = level.centre_of_mass();
        let moment = level.mesh.nodes.iter().zip(&level.node_mass).map(|(u, m)| m * (u - centre).norm_squared());
        Arms { centre, radius: (moment.sum::<Real>() / mass).sqrt() }
    }

    pub(super) fn to(&self, point: &Vec3) -> Vec3 {
        (point - self.centre) / self.radius
    }
}

/// Displacement at `arm` for the six rigid motions.
pub(super) fn rigid_modes(arm: Vec3) -> SMatrix<Real, 3, 6> {
    let (x, y, z) = (arm.x, arm.y, arm.z);
    SMatrix::<Real, 3, 6>::new(
        1.0, 0.0, 0.0, 0.0, z, -y, //
        0.0, 1.0, 0.0, -z, 0.0, x, //
        0.0, 0.0, 1.0, y, -x, 0.0,
    )
}

/// The rigid motion nearest to `u` in the mean over the mass.
pub(super) fn mean_motion(level: &Level, u: &[Block]) -> RigidMotion {
    let arms = Arms::new(level);
    let (mut inertia, mut momentum) = (Mat6::zeros(), RigidMotion::zeros());
    for ((at, m), u) in level.mesh.nodes.iter().zip(&level.node_mass).zip(u) {
        let modes = rigid_modes(arms.to(at));
        inertia += modes.transpose() * modes * *m;
        momentum += modes.transpose() * columns(u) * *m;
    }
    inertia.cholesky().map_or(RigidMotion::zeros(), |inertia| inertia.solve(&momentum))
}

/// Stiffness of springs (arm, N/m) against the six rigid motions [N/m].
pub(super) fn rigid_stiffness(springs: impl Iterator<Item = (Vec3, Real)>) -> Mat6 {
    springs.fold(Mat6::zeros(), |sum, (arm, stiffness)| {
        let modes = rigid_modes(arm);
        sum + modes.transpose() * modes * stiffness
    })
}

/// Arm and stiffness [N/m] of each hold.
pub(super) fn held_points(level: &Level, holds: &[(u32, Real)]) -> impl Iterator<Item = (Vec3, Real)> {
    let arms = Arms::new(level);
    holds.iter().map(move |&(vertex, stiffness)| {
        let host = &level.embedding[vertex as usize];
        let corners = level.mesh.corners(host.element as usize);
        let point: Vec3 = corners.iter().zip(host.weights).map(|(u, w)| u * w).sum();
        (arms.to(&point), stiffness)
    })
}

/// True when holds and fixed nodes leave no rigid motion free. A body that hangs on a point or a hinge counts as free.
pub(super) fn holds_firmly(level: &Level, holds: &[(u32, Real)]) -> bool {
    // How firm a fixed node is makes no difference here, as long as it compares with the springs.
    let firm = holds.iter().map(|hold| hold.1).fold(0.0, Real::max);
    let firm = if firm > 0.0 { firm } else { 1.0 };
    let arms = Arms::new(level);
    let fixed = level.fixed.iter().map(|n| (arms.to(&level.mesh.nodes[*n as usize]), firm));
    let stiffness = rigid_stiffness(held_points(level, holds).chain(fixed));
    // Without the shared scale a pivot would tell nothing. A hinge leaves one of rounding errors; what holds less than
    // a thousandth of the body's size apart is one, too.
    let scaled = stiffness * (6.0 / stiffness.trace());
    scaled.cholesky().is_some_and(|factor| factor.l().diagonal().iter().all(|pivot| pivot * pivot > 1e-6))
}
