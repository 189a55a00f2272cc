//! The force at the device's own rate: what to give the motors between two wrenches, and when the network is late.
//!
//! Pure: no clock, no network, so that it runs in simulated time as well. Everything is in body space and its limits are
//! those of the device seen from there ([`Registration::in_body`](crate::Registration::in_body)).

#![allow(non_snake_case)] // F is a force, K a stiffness, E an energy, as printed

use std::str::FromStr;

use nalgebra::{Matrix3, Vector3};

use crate::{Device, SdkError, Wrench, wrench::watchdog_scale};

/// Time constant [s] with which the difference between an old and a new model fades. Shorter clicks in the hand, longer
/// hides what the server says.
const BLEND_TIME: f64 = 8e-3;

/// How the force is made from the wrenches.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum RenderMode {
    /// The newest force, held until the next comes. For comparison: a delayed force makes a stiff contact shake.
    Raw,
    /// The newest force, guarded by the passivity controller.
    Passive,
    /// The local model of the newest wrench, evaluated where the device is now. Holds the force where there is none.
    LocalModel,
    /// The local model, guarded by the passivity controller.
    #[default]
    LocalModelPassive,
}

/// Every mode with the name it is chosen by.
const MODES: [(&str, RenderMode); 4] = [
    ("raw", RenderMode::Raw),
    ("passive", RenderMode::Passive),
    ("local", RenderMode::LocalModel),
    ("local-passive", RenderMode::LocalModelPassive),
];

impl RenderMode {
    /// The names of all modes.
    pub fn names() -> [&'static str; 4] {
        MODES.map(|(name, _)| name)
    }

    /// The name it is chosen by.
    pub fn name(self) -> &'static str {
        MODES[self as usize].0
    }

    fn uses_model(self) -> bool {
        matches!(self, Self::LocalModel | Self::LocalModelPassive)
    }

    fn is_guarded(self) -> bool {
        matches!(self, Self::Passive | Self::LocalModelPassive)
    }
}

impl FromStr for RenderMode {
    type Err = SdkError;

    /// The mode of that name, in whatever case. Errors: no such mode; the error lists those there are.
    fn from_str(name: &str) -> Result<Self, SdkError> {
        MODES.iter().find(|(known, _)| known.eq_ignore_ascii_case(name)).map(|&(_, mode)| mode).ok_or_else(|| {
            SdkError::Unknown { what: "render mode", name: name.to_owned(), known: Self::names().join(", ") }
        })
    }
}

/// What one wrench says about the force nearby: F(x) = F₀ − K (x − x₀), where |x − x₀| counts up to `range`.
#[derive(Clone, Copy, Debug, Default)]
struct Model {
    F0: Vector3<f64>,
    x0: Vector3<f64>,
    K: Matrix3<f64>,
    /// Unit, out of the body; zero where nothing is near, and where the force is only held.
    normal: Vector3<f64>,
    /// [m]; 0 where the force is only held.
    range: f64,
    /// When its wrench came [ns].
    arrival_ns: u64,
}

impl Model {
    /// `None` when a number is not finite.
    fn of(wrench: &Wrench, use_model: bool, max_stiffness: f64, arrival_ns: u64) -> Option<Self> {
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
    fn force(&self, x: Vector3<f64>) -> Vector3<f64> {
        let F = self.F0 - self.K * (x - self.x0).cap_magnitude(self.range);
        if self.normal.dot(&F) < 0.0 { Vector3::zeros() } else { F }
    }

    fn is_held(&self) -> bool {
        self.range == 0.0
    }
}

/// Makes the force of a device from the wrenches that come, at whatever rate the device asks.
///
/// Always on: every number is checked, the force is never longer than the device's greatest, and it fades with the age
/// of the newest wrench by [`watchdog_scale`](crate::watchdog_scale), counted from arrival: what the network delays is
/// not late yet. When a newer model says another force, the difference fades in 8 ms instead of jumping.
///
/// # Passivity
/// The guarded modes keep account of the energy that the force has given out to the hand [Hannaford & Ryu 2002]. Beyond
/// half of the budget, [`Device::passivity_budget`], damping takes it back, up to the device's greatest, and the force
/// of the environment fades, to nothing at the whole budget. A touch that gives back no more than it took is not
/// altered. What a touch has taken in counts until the force ends: old friction pays for nothing new.
#[derive(Clone, Debug)]
pub struct Renderer {
    mode: RenderMode,
    device: Device,
    model: Model,
    torque: Vector3<f64>,
    /// Came since the last force was asked for.
    newer: Option<Model>,
    last_sequence: Option<u64>,
    /// What an older model gave more than the newer one, fading [N].
    excess: Vector3<f64>,
    /// Energy given out to the hand [J]; negative when the hand has put in more.
    energy: f64,
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
            newer: None,
            last_sequence: None,
            excess: Vector3::zeros(),
            energy: 0.0,
            last: None,
        }
    }

    /// Takes a wrench that came at `now_ns`. False, and nothing changes, when it is not newer than the last one or holds
    /// a number that is not finite: a server that sends only such fades out as a silent one does.
    pub fn receive(&mut self, wrench: &Wrench, now_ns: u64) -> bool {
        if self.last_sequence.is_some_and(|last| wrench.sequence <= last) {
            return false;
        }
        let model = Model::of(wrench, self.mode.uses_model(), self.device.max_stiffness, now_ns);
        if model.is_none() || wrench.torque.iter().any(|torque| !torque.is_finite()) {
            return false;
        }
        (self.newer, self.last_sequence) = (model, Some(wrench.sequence));
        self.torque = Vector3::from(wrench.torque).cap_magnitude(self.device.max_torque);
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
            // A force held over a step does exactly this much work, whatever the estimate of the velocity.
            self.energy += F.dot(&(x - x_last));
            self.excess *= (-dt / BLEND_TIME).exp();
        }
        if let Some(newer) = self.newer.take() {
            self.change_model(newer, x, now_ns);
        }
        let mut F = self.environment(x, now_ns);
        if F == Vector3::zeros() {
            self.energy = self.energy.max(0.0);
        }
        if self.mode.is_guarded() {
            F = self.guarded(F, v, dt);
        }
        let F = F.cap_magnitude(self.device.max_force);
        self.last = Some((F, x, now_ns));
        F.into()
    }

    /// The torque (3) [N·m] at `now_ns`: the newest one, at most the device's greatest, faded as the force is.
    pub fn torque(&self, now_ns: u64) -> [f64; 3] {
        let arrival_ns = self.newer.as_ref().unwrap_or(&self.model).arrival_ns;
        (self.torque * watchdog_scale(now_ns.saturating_sub(arrival_ns))).into()
    }

    /// Energy that the forces so far have given out to the hand [J], beyond what they have taken in since the touch
    /// began; negative when the hand has put in more. Observed in every mode, limited in the guarded ones.
    pub fn observed_energy(&self) -> f64 {
        self.energy
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

    /// `F` with what takes energy back where too much has been given out.
    fn guarded(&self, F: Vector3<f64>, v: Vector3<f64>, dt: f64) -> Vector3<f64> {
        let half = 0.5 * self.device.passivity_budget();
        let beyond = self.energy - half;
        if beyond <= 0.0 || dt == 0.0 {
            return F;
        }
        let share = (1.0 - beyond / half).max(0.0);
        // Damping that would take it all back within one step, at most the device's.
        let damping = (beyond / (v.norm_squared() * dt)).min(self.device.max_damping);
        F * share - v * damping
    }
}

#[cfg(test)]
mod tests {
    use palpate_proto::ToolPhase;
    use proptest::prelude::*;

    use super::*;
    use crate::{Link, LinkConditions, LocalModel};

    const MS: u64 = 1_000_000;
    const REST: [f64; 3] = [0.0; 3];

    fn held(sequence: u64, force: [f64; 3]) -> Wrench {
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
            contact_points: 1,
            phase: ToolPhase::Engaged,
            flags: 0,
            model: None,
        }
    }

    /// A floor at z = 0 of stiffness `k` [N/m], as felt by a tool at height `z` [m].
    fn floor(sequence: u64, k: f64, z: f64) -> Wrench {
        let model = LocalModel {
            position: [0.0, 0.0, z],
            force: [0.0, 0.0, -k * z],
            normal: [0.0, 0.0, 1.0],
            stiffness: [[0.0; 3], [0.0; 3], [0.0, 0.0, k]],
            range: 0.01,
        };
        Wrench { model: Some(model), ..held(sequence, [0.0, 0.0, (-k * z).max(0.0)]) }
    }

    fn omni(mode: RenderMode) -> Renderer {
        Renderer::new(&Device::default(), mode)
    }

    fn length(v: [f64; 3]) -> f64 {
        Vector3::from(v).norm()
    }

    #[test]
    fn modes_go_by_their_names() {
        for (name, mode) in MODES {
            assert_eq!((name.parse::<RenderMode>().unwrap(), mode.name()), (mode, name));
        }
        assert!("fast".parse::<RenderMode>().unwrap_err().to_string().contains("raw, passive, local, local-passive"));
    }

    #[test]
    fn without_a_model_the_newest_force_is_held_in_every_mode() {
        for (_, mode) in MODES {
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
    fn a_model_counts_no_farther_than_its_range_and_no_stiffer_than_the_device() {
        let model = |k: f64| Model::of(&floor(1, k, 0.0), true, 700.0, 0).unwrap();
        assert!((model(200.0).force(Vector3::new(0.0, 0.0, -0.05)).z - 200.0 * 0.01).abs() < 1e-12);
        assert!((model(1400.0).force(Vector3::new(0.0, 0.0, -0.001)).z - 0.7).abs() < 1e-12);
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
        for (_, mode) in MODES {
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
            let mut renderer = omni(MODES[mode].1);
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
