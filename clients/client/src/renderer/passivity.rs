//! The passivity controller: a force gives the hand no more energy than a budget [Hannaford & Ryu 2002].

use nalgebra::Vector3;

use crate::Device;

/// The account of the energy that a force has given out, and the damping that takes back what is too much.
#[derive(Clone, Debug)]
pub(super) struct PassivityController {
    /// Most energy that may be given out [J], see [`Device::passivity_budget`].
    budget: f64,
    /// Greatest damping that the device renders [N·s/m].
    max_damping: f64,
    /// Energy given out to the hand [J]; negative when the hand has put in more.
    energy: f64,
}

impl PassivityController {
    /// For `device` as it is seen from body space; nothing is given out yet.
    pub(super) fn new(device: &Device) -> Self {
        Self { budget: device.passivity_budget(), max_damping: device.max_damping, energy: 0.0 }
    }

    /// Energy given out to the hand [J], beyond what was taken in since the touch began.
    pub(super) fn energy(&self) -> f64 {
        self.energy
    }

    /// Takes into account that the device moved by `step` [m] under the force `F` [N]. A force held over a step does exactly
    /// this much work, whatever the estimate of the velocity.
    pub(super) fn add_work(&mut self, F: Vector3<f64>, step: Vector3<f64>) {
        self.energy += F.dot(&step);
    }

    /// The force has ended: what the touch has taken in pays for nothing new.
    pub(super) fn end_touch(&mut self) {
        self.energy = self.energy.max(0.0);
    }

    /// `F` with what takes energy back where too much has been given out.
    pub(super) fn guarded(&self, F: Vector3<f64>, v: Vector3<f64>, dt: f64) -> Vector3<f64> {
        let half = 0.5 * self.budget;
        let beyond = self.energy - half;
        if beyond <= 0.0 || dt == 0.0 {
            return F;
        }
        let share = (1.0 - beyond / half).max(0.0);
        // Damping that would take it all back within one step, at most the device's.
        let damping = (beyond / (v.norm_squared() * dt)).min(self.max_damping);
        F * share - v * damping
    }
}

#[cfg(test)]
mod tests {
    use crate::renderer::tests::{MS, floor, held, omni};
    use crate::{Device, Link, LinkConditions, RenderMode, Wrench};

    /// A hand on the device along z [m]: 0.1 kg, pulled to a target by 150 N/m and 1 N s/m, a light grip.
    struct Grip {
        z: f64,
        v: f64,
    }

    impl Grip {
        /// Moves on by a millisecond under `force` [N], in ten steps.
        fn step(&mut self, target: f64, force: f64) {
            for _ in 0..10 {
                self.v += (150.0 * (target - self.z) - 1.0 * self.v + force) / 0.1 * 1e-4;
                self.z += self.v * 1e-4;
            }
        }
    }

    /// Greatest energy given out [J] and shake (root mean square of the velocity [m/s]) over the last of `seconds`,
    /// while a hand presses on what `environment` answers (its force [N] from position and velocity of the tool),
    /// `delay_ms` away each way.
    fn press(
        mode: RenderMode,
        seconds: u64,
        delay_ms: u64,
        environment: impl Fn(u64, f64, f64) -> Wrench,
    ) -> (f64, f64) {
        let conditions = LinkConditions { delay_ns: delay_ms * MS, ..LinkConditions::default() };
        let (mut out, mut back) = (Link::new(conditions, 1), Link::new(conditions, 2));
        let mut renderer = omni(mode);
        let mut grip = Grip { z: 0.001, v: 0.0 };
        let (mut greatest, mut shake) = (f64::MIN, 0.0);
        for tick in 1..=seconds * 1000 {
            let now_ns = tick * MS;
            out.send(now_ns, (grip.z, grip.v));
            if let Some((z, v)) = out.poll(now_ns) {
                back.send(now_ns, environment(tick, z, v));
            }
            while let Some(wrench) = back.poll(now_ns) {
                renderer.receive(&wrench, now_ns);
            }
            let force = renderer.force([0.0, 0.0, grip.z], [0.0, 0.0, grip.v], now_ns);
            greatest = greatest.max(renderer.observed_energy());
            grip.step(-0.008, force[2]);
            if tick > (seconds - 1) * 1000 {
                shake += grip.v * grip.v / 1000.0;
            }
        }
        (greatest, shake.sqrt())
    }

    /// What the controller may be late by: the work of one step, less than a hundredth of the budget at hand speeds.
    fn within_budget(energy: f64) -> bool {
        energy <= 1.01 * Device::default().passivity_budget()
    }

    #[test]
    fn a_body_of_negative_damping_gives_out_no_more_than_the_budget() {
        // It pushes in the direction of motion with 4 N s/m: four times what the hand itself damps.
        let active = |tick, z: f64, v: f64| held(tick, [0.0, 0.0, (-200.0 * z + 4.0 * v).clamp(-3.0, 3.0)]);
        let (raw, raw_shake) = press(RenderMode::Raw, 10, 0, active);
        let (guarded, shake) = press(RenderMode::Passive, 10, 0, active);
        assert!(!within_budget(raw) && raw > 1.0, "unguarded it gives out {raw} J");
        assert!(within_budget(guarded), "{guarded} J");
        assert!(shake < 0.5 * raw_shake, "{shake} of {raw_shake} m/s");
    }

    #[test]
    fn a_stiff_floor_far_away_gives_out_no_more_than_the_budget() {
        for delay_ms in [2, 5, 10, 20] {
            let far = |tick, z: f64, _| held(tick, [0.0, 0.0, (-600.0 * z).max(0.0)]);
            let (raw, raw_shake) = press(RenderMode::Raw, 10, delay_ms, far);
            let (guarded, shake) = press(RenderMode::Passive, 10, delay_ms, far);
            assert!(raw > 0.05, "{delay_ms} ms: unguarded it gives out {raw} J");
            assert!(within_budget(guarded), "{delay_ms} ms: {guarded} J");
            assert!(shake < raw_shake, "{delay_ms} ms: {shake} of {raw_shake} m/s");
        }
    }

    #[test]
    fn a_push_that_never_ends_gives_out_no_more_than_the_budget() {
        // Damping alone could not stop this: it would take 3 N at less than 0.6 m/s.
        let push = |tick, _, _| held(tick, [0.0, 0.0, 3.0]);
        assert!(within_budget(press(RenderMode::Passive, 3, 0, push).0));
    }

    #[test]
    fn the_local_model_is_still_where_the_held_force_shakes() {
        for delay_ms in [5, 10, 20] {
            let far = |tick, z: f64, _| floor(tick, 600.0, z);
            let (_, raw) = press(RenderMode::Raw, 4, delay_ms, far);
            for mode in [RenderMode::LocalModel, RenderMode::LocalModelPassive] {
                let (energy, still) = press(mode, 4, delay_ms, far);
                assert!(raw > 0.05 && still < 1e-3, "{delay_ms} ms: raw {raw} m/s, {mode:?} {still} m/s");
                assert!(!mode.is_guarded() || within_budget(energy), "{delay_ms} ms: {energy} J");
            }
        }
    }

    #[test]
    fn a_passive_body_is_not_altered_by_the_guard() {
        let run = |mode| {
            let mut renderer = omni(mode);
            let press = |step: u64| {
                let z = -0.005 * (step as f64 * 2e-3).sin().abs();
                let v = -1e-3;
                renderer.receive(&floor(step + 1, 400.0, z), step * MS);
                renderer.force([0.0, 0.0, z], [0.0, 0.0, v], step * MS)
            };
            (0..5000).map(press).collect::<Vec<_>>()
        };
        assert_eq!(run(RenderMode::LocalModel), run(RenderMode::LocalModelPassive));
    }
}
