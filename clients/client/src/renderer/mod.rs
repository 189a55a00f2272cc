//! The force at the device's own rate: what to give the motors between two wrenches, and when the network is late.
//!
//! Pure: no clock, no network, so that it runs in simulated time as well. Everything is in body space and its limits are
//! those of the device seen from there ([`Registration::in_body`](crate::Registration::in_body)).

#![allow(non_snake_case)] // F is a force, K a stiffness, E an energy, as printed

mod mode;
mod model;
mod passivity;

pub use mode::RenderMode;

use nalgebra::Vector3;

use crate::{Device, Wrench, watchdog_scale};
use model::Model;
use passivity::PassivityController;

/// Time constant [s] with which the difference between an old and a new model fades. Shorter clicks in the hand, longer
/// hides what the server says.
const BLEND_TIME: f64 = 8e-3;

/// Makes the force of a device from the wrenches that come, at whatever rate the device asks.
///
/// Always on: every number is checked, the force is never longer than the device's greatest, and it fades with the age
/// of the newest wrench by [`watchdog_scale`](crate::watchdog_scale), counted from arrival: what the network delays is
/// not late yet. When a newer model says another force, the difference fades in 8 ms instead of jumping.
///
/// # Passivity
/// The guarded modes keep account of the energy that the force has given out to the hand [Hannaford & Ryu 2002]. Beyond
/// half of the budget, [`Device::passivity_budget`], damping takes it back, up to the device's greatest, and the force
/// of the environment fades, to nothing at the whole budget. A hand that moves against the force then gets it back over a few
/// millimetres, and its work pays: what was too much, as after a hand was snatched out under a force that a slow client holds, does
/// not silence the device for good. A touch that gives back no more than it took is not altered. What a touch has taken
/// in counts until the force ends: old friction pays for nothing new.
#[derive(Clone, Debug)]
pub struct Renderer {
    mode: RenderMode,
    device: Device,
    model: Model,
    torque: Vector3<f64>,
    grip: f64,
    /// Came since the last force was asked for.
    newer: Option<Model>,
    /// Sequence and arrival [ns] of the newest wrench that was taken.
    taken: Option<(u64, u64)>,
    /// What an older model gave more than the newer one, fading [N].
    excess: Vector3<f64>,
    passivity: PassivityController,
    /// The force of the last call, where the device was and when [ns].
    last: Option<(Vector3<f64>, Vector3<f64>, u64)>,
}

impl Renderer {
    /// For `device` as it is seen from body space; gives no force before the first wrench.
    pub fn new(device: &Device, mode: RenderMode) -> Self {
        Self {
            mode,
            device: device.clone(),
            model: Model::default(),
            torque: Vector3::zeros(),
            grip: 0.0,
            newer: None,
            taken: None,
            excess: Vector3::zeros(),
            passivity: PassivityController::new(device),
            last: None,
        }
    }

    /// Takes a wrench that came at `now_ns`. False, and nothing changes, when it is not newer than the last one or holds
    /// a number that is not finite: a server that sends only such fades out as a silent one does.
    pub fn receive(&mut self, wrench: &Wrench, now_ns: u64) -> bool {
        let is_old = |(sequence, at_ns): (u64, u64)| {
            // Nothing is left of a force from before a silence, and a wrong sequence must not keep the true ones out for good.
            let is_silent = watchdog_scale(now_ns.saturating_sub(at_ns)) == 0.0;
            wrench.sequence == sequence || wrench.sequence < sequence && !is_silent
        };
        if self.taken.is_some_and(is_old) {
            return false;
        }
        let model = Model::of(wrench, self.mode.uses_model(), self.device.max_stiffness, now_ns);
        if model.is_none() || wrench.torque.iter().chain([&wrench.grip_torque]).any(|torque| !torque.is_finite()) {
            return false;
        }
        (self.newer, self.taken) = (model, Some((wrench.sequence, now_ns)));
        self.torque = Vector3::from(wrench.torque).cap_magnitude(self.device.max_torque);
        self.grip = wrench.grip_torque;
        true
    }

    /// The force (3) [N] on the tool held at `position` (3) [m] and moving with `velocity` (3) [m/s] at `now_ns`, to be
    /// given until the next call. `now_ns` is the clock of [`receive`](Self::receive) and never goes back.
    ///
    /// Zero where position or velocity is not finite.
    pub fn force(&mut self, position: [f64; 3], velocity: [f64; 3], now_ns: u64) -> [f64; 3] {
        let (x, v) = (Vector3::from(position), Vector3::from(velocity));
        if !(x.iter().chain(&v).all(|number| number.is_finite())) {
            self.last = None;
            return [0.0; 3];
        }
        let mut dt = 0.0;
        if let Some((F, x_last, last_ns)) = self.last {
            dt = now_ns.saturating_sub(last_ns) as f64 * 1e-9;
            self.passivity.add_step(F, x_last, x, dt);
            self.excess *= (-dt / BLEND_TIME).exp();
        } else {
            self.passivity.begin(x);
        }
        if let Some(newer) = self.newer.take() {
            self.change_model(newer, x, now_ns);
        }
        let mut F = self.environment(x, now_ns);
        if F == Vector3::zeros() {
            self.passivity.end_touch();
        }
        if self.mode.is_guarded() {
            F = self.passivity.guarded(F, v, dt);
        }
        let F = F.cap_magnitude(self.device.max_force);
        self.last = Some((F, x, now_ns));
        F.into()
    }

    /// The torque (3) [N·m] at `now_ns`: the newest one, at most the device's greatest, faded as the force is.
    pub fn torque(&self, now_ns: u64) -> [f64; 3] {
        (self.torque * self.left(now_ns)).into()
    }

    /// What opens the jaws [N·m] at `now_ns`: that of the newest wrench, faded as the force is. A gripper has no limit here: the
    /// server keeps its own.
    pub fn grip_torque(&self, now_ns: u64) -> f64 {
        self.grip * self.left(now_ns)
    }

    /// What is left of the newest wrench.
    fn left(&self, now_ns: u64) -> f64 {
        watchdog_scale(now_ns.saturating_sub(self.newer.as_ref().unwrap_or(&self.model).arrival_ns))
    }

    /// Energy that the forces so far have given out to the hand [J], beyond what they have taken in since the touch
    /// began; negative when the hand has put in more. Observed in every mode, limited in the guarded ones.
    pub fn observed_energy(&self) -> f64 {
        self.passivity.energy()
    }

    /// Goes over to `newer` so that the force at `x` stays what it was.
    fn change_model(&mut self, newer: Model, x: Vector3<f64>, now_ns: u64) {
        let faded = watchdog_scale(now_ns.saturating_sub(self.model.arrival_ns)) < 1.0;
        let before = self.environment(x, now_ns);
        // A held force is the server's own, without jumps: to blend from one to the next would only delay it.
        let blend = !(newer.is_held() && self.model.is_held()) || faded;
        self.model = newer;
        if blend {
            self.excess = before - self.model.force(x).cap_magnitude(self.device.max_force);
        }
    }

    /// What the body pushes with at `x`, faded by age [N].
    fn environment(&self, x: Vector3<f64>, now_ns: u64) -> Vector3<f64> {
        let max_force = self.device.max_force;
        let F = self.model.force(x).cap_magnitude(max_force) + self.excess;
        // While differences fade, too, a contact pushes and never pulls.
        let pull = self.model.normal.dot(&F).min(0.0);
        let F = (F - self.model.normal * pull).cap_magnitude(max_force);
        F * watchdog_scale(now_ns.saturating_sub(self.model.arrival_ns))
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use palpate_proto::ToolPhase;
    use proptest::prelude::*;

    use super::*;
    use crate::LocalModel;

    pub(crate) const MS: u64 = 1_000_000;
    const REST: [f64; 3] = [0.0; 3];

    pub(crate) fn held(sequence: u64, force: [f64; 3]) -> Wrench {
        Wrench {
            sequence,
            tick: sequence,
            pose_sequence: 1,
            pose_time_ns: 0,
            pose_age_ticks: 0,
            position: [0.0; 3],
            orientation: [0.0, 0.0, 0.0, 1.0],
            physical_force: force,
            physical_torque: [0.0; 3],
            force,
            torque: [0.0; 3],
            opening: 0.0,
            grip_torque: 0.0,
            contact_points: 1,
            phase: ToolPhase::Engaged,
            flags: 0,
            model: None,
        }
    }

    /// A floor at z = 0 of stiffness `k` [N/m], as felt by a tool at height `z` [m].
    pub(super) fn floor(sequence: u64, k: f64, z: f64) -> Wrench {
        let model = LocalModel {
            position: [0.0, 0.0, z],
            force: [0.0, 0.0, -k * z],
            normal: [0.0, 0.0, 1.0],
            stiffness: [[0.0; 3], [0.0; 3], [0.0, 0.0, k]],
            range: 0.01,
        };
        Wrench { model: Some(model), ..held(sequence, [0.0, 0.0, (-k * z).max(0.0)]) }
    }

    pub(super) fn omni(mode: RenderMode) -> Renderer {
        Renderer::new(&Device::default(), mode)
    }

    fn length(v: [f64; 3]) -> f64 {
        Vector3::from(v).norm()
    }

    #[test]
    fn without_a_model_the_newest_force_is_held_in_every_mode() {
        for mode in RenderMode::ALL {
            let mut renderer = omni(mode);
            assert_eq!(renderer.force(REST, REST, 0), [0.0; 3]);
            assert!(renderer.receive(&held(1, [0.0, 0.0, 1.0]), 0));
            assert_eq!(renderer.force([0.0, 0.0, 0.5], REST, MS), [0.0, 0.0, 1.0]);
            assert!(renderer.receive(&held(2, [0.0, 0.0, 1.5]), 2 * MS));
            assert_eq!(renderer.force([0.0, 0.0, 0.5], REST, 2 * MS), [0.0, 0.0, 1.5]);
        }
    }

    #[test]
    fn the_local_model_answers_where_the_device_is_now() {
        let mut renderer = omni(RenderMode::LocalModel);
        for sequence in 1..=80 {
            renderer.receive(&floor(sequence, 200.0, -0.002), sequence * MS);
            renderer.force([0.0, 0.0, -0.002], REST, sequence * MS);
        }
        let force = |renderer: &mut Renderer, z| renderer.force([0.003, 0.0, z], REST, 85 * MS)[2];
        assert!((force(&mut renderer, -0.004) - 0.8).abs() < 0.01);
        assert!((force(&mut renderer, -0.001) - 0.2).abs() < 0.01);
        // Raw mode holds what was felt there.
        let mut raw = omni(RenderMode::Raw);
        raw.receive(&floor(1, 200.0, -0.002), 0);
        raw.force(REST, REST, 0);
        assert!((raw.force([0.0, 0.0, -0.004], REST, MS)[2] - 0.4).abs() < 1e-12);
    }

    #[test]
    fn a_contact_never_pulls_not_even_while_models_change() {
        let mut renderer = omni(RenderMode::LocalModel);
        for step in 0..400u64 {
            // In and out of the floor, while the server changes its mind about the stiffness.
            let z = 0.003 * (step as f64 * 0.05).sin();
            if step % 7 == 0 {
                renderer.receive(&floor(step + 1, if step % 2 == 0 { 600.0 } else { 150.0 }, z), step * MS);
            }
            let force = renderer.force([0.0, 0.0, z], REST, step * MS);
            assert!(force[2] >= 0.0, "{force:?} at {z}");
        }
        // Settled, there is no force at all outside.
        let mut settled = omni(RenderMode::LocalModel);
        settled.receive(&floor(1, 300.0, 0.001), 0);
        assert_eq!(settled.force([0.0, 0.0, 0.001], REST, 0), [0.0; 3]);
        assert!(settled.force([0.0, 0.0, -0.002], REST, MS)[2] > 0.5, "the model goes on into the body");
    }

    #[test]
    fn a_newer_model_changes_the_force_without_a_jump() {
        let mut renderer = omni(RenderMode::LocalModel);
        let at = [0.0, 0.0, -0.002];
        renderer.receive(&floor(1, 300.0, -0.002), 0);
        for ms in 0..15 {
            renderer.force(at, REST, ms * MS);
        }
        // Models that say up to 1 N more or less, every 13 ms for 2 s; the device asks four times per millisecond.
        let mut before = renderer.force(at, REST, 15 * MS)[2];
        for quarter in 60..8000u64 {
            let now_ns = quarter * MS / 4;
            if quarter % 52 == 0 {
                let k = 350.0 + 250.0 * (quarter as f64).sin();
                renderer.receive(&floor(quarter, k, -0.002), now_ns);
                let after = renderer.force(at, REST, now_ns - MS / 4)[2]; // no time has passed since the last call
                assert!((after - before).abs() < 1e-12, "{before} to {after}");
            }
            let force = renderer.force(at, REST, now_ns)[2];
            assert!((force - before).abs() < 1.0 * (1.0 - (-0.25f64 / 8.0).exp()), "{before} to {force}");
            before = force;
        }
        // And it arrives where the newest model is: 1/e of the difference after 8 ms.
        renderer.receive(&floor(9000, 300.0, -0.002), 2000 * MS);
        let difference = |renderer: &mut Renderer, now_ns| renderer.force(at, REST, now_ns)[2] - 0.6;
        let first = difference(&mut renderer, 2000 * MS);
        assert!((difference(&mut renderer, 2008 * MS) / first - (-1.0f64).exp()).abs() < 1e-9);
    }

    #[test]
    fn the_force_fades_with_age_since_arrival_and_comes_back_without_a_jump() {
        for mode in RenderMode::ALL {
            let mut renderer = omni(mode);
            let force = |renderer: &mut Renderer, ms: u64| renderer.force(REST, REST, ms * MS)[2];
            for sequence in 1..=110 {
                renderer.receive(&held(sequence, [0.0, 0.0, 2.0]), (1000 + sequence) * MS);
                force(&mut renderer, 1000 + sequence);
            }
            assert!((force(&mut renderer, 1130) - 2.0).abs() < 1e-3);
            let half = force(&mut renderer, 1155);
            assert!((half - 1.0).abs() < 1e-3, "{half}");
            assert_eq!(force(&mut renderer, 1180), 0.0);
            renderer.receive(&held(111, [0.0, 0.0, 2.0]), 1300 * MS);
            assert_eq!(force(&mut renderer, 1300), 0.0);
            assert!((force(&mut renderer, 1308) - 2.0 * (1.0 - (-1.0f64).exp())).abs() < 1e-9);
        }
    }

    #[test]
    fn the_torque_is_that_of_the_newest_wrench_within_the_limits_of_the_device() {
        let device = Device { max_torque: 0.1, ..Device::default() };
        let mut renderer = Renderer::new(&device, RenderMode::default());
        renderer.receive(&Wrench { torque: [0.0, 0.3, 0.0], ..held(1, [0.0; 3]) }, 0);
        assert!((renderer.torque(MS)[1] - 0.1).abs() < 1e-12);
        assert!((renderer.torque(45 * MS)[1] - 0.05).abs() < 1e-12);
        let mut without = omni(RenderMode::default());
        without.receive(&Wrench { torque: [0.0, 0.3, 0.0], ..held(1, [0.0; 3]) }, 0);
        assert_eq!(without.torque(MS), [0.0; 3]);
        without.receive(&Wrench { grip_torque: 0.02, ..held(2, [0.0; 3]) }, 0);
        assert!((without.grip_torque(MS) - 0.02).abs() < 1e-12 && (without.grip_torque(45 * MS) - 0.01).abs() < 1e-12);
    }

    #[test]
    fn a_wrench_that_is_not_finite_or_not_newer_is_refused_and_changes_nothing() {
        let mut renderer = omni(RenderMode::LocalModel);
        renderer.receive(&held(5, [0.0, 0.0, 1.0]), 0);
        assert_eq!(renderer.force(REST, REST, 0)[2], 1.0);
        let good = floor(6, 100.0, -0.001);
        let broken = |change: fn(&mut LocalModel)| {
            let mut wrench = good;
            wrench.model.as_mut().map(change);
            wrench
        };
        for bad in [
            held(6, [0.0, f64::NAN, 0.0]),
            Wrench { torque: [f64::INFINITY, 0.0, 0.0], ..good },
            Wrench { grip_torque: f64::NAN, ..good },
            broken(|model| model.stiffness[1][1] = f64::NAN),
            broken(|model| model.stiffness[0][2] = f64::INFINITY),
            broken(|model| model.force[0] = f64::NAN),
            broken(|model| model.position[2] = f64::NEG_INFINITY),
            broken(|model| model.normal[2] = f64::NAN),
            broken(|model| model.range = f64::INFINITY),
            held(5, [0.0, 0.0, 3.0]),
            held(4, [0.0, 0.0, 3.0]),
        ] {
            assert!(!renderer.receive(&bad, MS));
            assert_eq!(renderer.force(REST, REST, MS)[2], 1.0);
        }
        assert_eq!(renderer.force([f64::NAN, 0.0, 0.0], REST, MS), [0.0; 3]);
        assert_eq!(renderer.force(REST, [0.0, f64::INFINITY, 0.0], MS), [0.0; 3]);
        assert!(renderer.receive(&good, MS));
    }

    proptest! {
        #[test]
        fn the_force_never_exceeds_the_device_whatever_the_server_says(
            mode in 0..4usize,
            steps in prop::collection::vec(
                (
                    [-100.0..100.0f64, -100.0..100.0, -100.0..100.0],
                    [-1e5..1e5f64, -1e5..1e5, -1e5..1e5, -1e5..1e5, -1e5..1e5, -1e5..1e5],
                    [-1.0..1.0f64, -1.0..1.0, -1.0..1.0],
                    0.0..1.0f64,
                    1..60u64,
                ),
                1..40,
            ),
        ) {
            let mut renderer = omni(RenderMode::ALL[mode]);
            let mut now_ns = 0;
            for (sequence, (force, [xx, yy, zz, yz, zx, xy], at, range, ms)) in (1..).zip(steps) {
                now_ns += ms * MS;
                let model = LocalModel {
                    position: at.map(|x| 0.1 * x),
                    force,
                    normal: at,
                    stiffness: [[xx, xy, zx], [xy, yy, yz], [zx, yz, zz]],
                    range,
                };
                let model = (sequence % 3 > 0).then_some(model);
                renderer.receive(&Wrench { model, ..held(sequence, force) }, now_ns);
                let force = renderer.force(at, at.map(|x| 3.0 * x), now_ns);
                prop_assert!(length(force) <= 3.3 * (1.0 + 1e-12), "{:?}", force);
            }
        }
    }
}
