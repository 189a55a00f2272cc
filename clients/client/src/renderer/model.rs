//! The force near a place, as one wrench tells it.

use nalgebra::{Matrix3, Vector3};

use crate::Wrench;

/// What one wrench says about the force nearby: F(x) = F₀ − K (x − x₀), where |x − x₀| counts up to `range`.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Model {
    F0: Vector3<f64>,
    x0: Vector3<f64>,
    K: Matrix3<f64>,
    /// Unit, out of the body; zero where nothing is near, and where the force is only held.
    pub(super) normal: Vector3<f64>,
    /// [m]; 0 where the force is only held.
    range: f64,
    /// When its wrench came [ns].
    pub(super) arrival_ns: u64,
}

impl Model {
    /// Of `wrench`, its force or its local model, that came at `arrival_ns`; no stiffer than `max_stiffness` [N/m]. `None` when a
    /// number is not finite.
    pub(super) fn of(wrench: &Wrench, use_model: bool, max_stiffness: f64, arrival_ns: u64) -> Option<Self> {
        let held = Self { F0: Vector3::from(wrench.force), arrival_ns, ..Self::default() };
        let model = match wrench.model {
            Some(model) if use_model => {
                let mut K = Matrix3::from(model.stiffness); // symmetric: rows are columns
                if K.iter().all(|k| k.is_finite()) {
                    // Stiffer than the device can be is not rendered, whatever the server says.
                    let stiffest = K.symmetric_eigenvalues().max();
                    K *= (max_stiffness / stiffest.max(max_stiffness)).min(1.0);
                }
                let [F0, x0, normal] = [model.force, model.position, model.normal].map(Vector3::from);
                Self { F0, x0, K, normal, range: model.range, arrival_ns }
            }
            _ => held,
        };
        let finite = [held.F0, model.F0, model.x0, model.normal].iter().flatten().all(|number| number.is_finite());
        (finite && model.K.iter().all(|k| k.is_finite()) && model.range.is_finite()).then_some(model)
    }

    /// The force [N] at `x`, zero where it would pull.
    pub(super) fn force(&self, x: Vector3<f64>) -> Vector3<f64> {
        let F = self.F0 - self.K * (x - self.x0).cap_magnitude(self.range);
        if self.normal.dot(&F) < 0.0 { Vector3::zeros() } else { F }
    }

    /// True where the force is the same everywhere.
    pub(super) fn is_held(&self) -> bool {
        self.range == 0.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::renderer::tests::floor;

    #[test]
    fn a_model_counts_no_farther_than_its_range_and_no_stiffer_than_the_device() {
        let model = |k: f64| Model::of(&floor(1, k, 0.0), true, 700.0, 0).unwrap();
        assert!((model(200.0).force(Vector3::new(0.0, 0.0, -0.05)).z - 200.0 * 0.01).abs() < 1e-12);
        assert!((model(1400.0).force(Vector3::new(0.0, 0.0, -0.001)).z - 0.7).abs() < 1e-12);
    }
}
