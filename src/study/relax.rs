//! Bodies brought to rest.

use palpate_core::math::{Real, Vec3};

/// Dynamic relaxation: undamped steps of `dt` [s] from the positions `x` [m], all motion wiped out whenever the kinetic
/// energy passes a peak. Nodes without `mass` [kg] stay.
///
/// `force` may move `x` and gives the forces [N], or nothing once they are small enough. True when that came within
/// `steps`.
pub fn relax(
    x: &mut [Vec3],
    mass: &[Real],
    dt: Real,
    steps: usize,
    mut force: impl FnMut(&mut [Vec3]) -> Option<Vec<Vec3>>,
) -> bool {
    let mut v = vec![Vec3::zeros(); x.len()];
    let mut last_kinetic = 0.0;
    for _ in 0..steps {
        let Some(force) = force(x) else { return true };
        let mut kinetic = 0.0;
        for n in (0..x.len()).filter(|n| mass[*n] > 0.0) {
            v[n] += force[n] * (dt / mass[n]);
            kinetic += mass[n] * v[n].norm_squared();
        }
        if kinetic < last_kinetic {
            v.iter_mut().for_each(|v| *v = Vec3::zeros());
            kinetic = 0.0;
        }
        last_kinetic = kinetic;
        x.iter_mut().zip(&v).for_each(|(x, v)| *x += v * dt);
    }
    false
}
