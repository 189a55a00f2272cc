//! The passivity controller: a force gives the hand no more energy than a budget [Hannaford & Ryu 2002].

use nalgebra::Vector3;

use super::BLEND_TIME;
use crate::Device;

/// The account of the energy that a force has given out, and what keeps it within the budget.
///
/// A force gives energy out only while the hand moves with it, F · Δx > 0. From half of the budget on the environment's share of
/// the force falls, to nothing at the whole, and damping takes energy back.
///
/// Without a force nothing could take a debt back, and a device that tells no velocity is not damped: a hand that was snatched
/// out would feel nothing for ever. So a hand that moves against the force gets it back: its work pays the debt. When
/// it turns, it gets back no more than it has paid in this touch, and the force is gone when that is used up: a vibration gains
/// nothing, however active the environment is.
///
/// Late by one step in either direction, as every controller in discrete time: what a longer step than the ones before gives out
/// is found when it is over. Above the budget the force of the paying hand is smaller by as much as the debt is greater, or a hand
/// that is snatched out again and again would be given the same each time.
#[derive(Clone, Debug)]
pub(super) struct PassivityController {
    /// Most energy that may be given out [J], see [`Device::passivity_budget`].
    budget: f64,
    /// Greatest force of the device [N].
    max_force: f64,
    /// Greatest damping that the device renders [N·s/m].
    max_damping: f64,
    /// Step of the encoders [m].
    resolution: f64,
    /// Energy given out to the hand [J]; negative when the hand has put in more.
    energy: f64,
    /// The environment's force of the last call [N].
    pushed: Vector3<f64>,
    /// Where the way begins that tells the direction of motion [m].
    mark: Vector3<f64>,
    /// True where the hand moved against the force, over the last way that tells.
    resisted: bool,
    /// Energy that the hand has put in since the touch began [J], less what it got back; not below 0.
    paid: f64,
    /// Share of the environment's force that is given for this, whatever the account says.
    least_share: f64,
}

impl PassivityController {
    /// For `device` as it is seen from body space; nothing is given out yet.
    pub(super) fn new(device: &Device) -> Self {
        Self {
            budget: device.passivity_budget(),
            max_force: device.max_force,
            max_damping: device.max_damping,
            resolution: device.resolution,
            energy: 0.0,
            pushed: Vector3::zeros(),
            mark: Vector3::zeros(),
            resisted: false,
            paid: 0.0,
            least_share: 0.0,
        }
    }

    /// Energy given out to the hand [J], beyond what was taken in since the touch began.
    pub(super) fn energy(&self) -> f64 {
        self.energy
    }

    /// The device is at `x` [m], and came from nowhere that is known.
    pub(super) fn begin(&mut self, x: Vector3<f64>) {
        (self.resisted, self.mark) = (false, x);
    }

    /// Takes into account that the device moved `from` one place `to` another [m] in `dt` [s] under the force `F` [N]. A force held
    /// over a step does exactly this much work, whatever the estimate of the velocity.
    pub(super) fn add_step(&mut self, F: Vector3<f64>, from: Vector3<f64>, to: Vector3<f64>, dt: f64) {
        let step = to - from;
        let work = F.dot(&step);
        self.energy += work;
        let left = (self.paid - work).max(0.0);
        if work > 0.0 {
            self.least_share *= if left > 0.0 { left / self.paid } else { 0.0 };
        }
        self.paid = left;
        let way = to - self.mark;
        if self.pushed == Vector3::zeros() || work > 0.0 && left == 0.0 {
            (self.resisted, self.mark) = (false, to);
        } else if way.norm() > 2.0 * self.resolution {
            // Shorter is no motion: an encoder between two steps tells one in every axis.
            (self.resisted, self.mark) = (self.pushed.dot(&way) < 0.0, to);
        }
        if self.resisted {
            let against = -self.pushed.normalize().dot(&step);
            // No quicker than models blend, and not before the hand has paid what a step of it may take back: the way over
            // which the greatest force does the work of the budget.
            let way = self.budget / self.max_force;
            let risen = (against.max(0.0) / way).min(dt / BLEND_TIME);
            self.least_share = 1.0 - (1.0 - self.least_share) * (-risen).exp();
        } else {
            self.least_share *= (-dt / BLEND_TIME).exp();
        }
    }

    /// The force has ended: what the touch has taken in pays for nothing new.
    pub(super) fn end_touch(&mut self) {
        (self.energy, self.paid) = (self.energy.max(0.0), 0.0);
    }

    /// The environment's force `F` [N] with what takes energy back where too much has been given out; `v` [m/s] is the hand's
    /// velocity and `dt` [s] the time since the last call.
    pub(super) fn guarded(&mut self, F: Vector3<f64>, v: Vector3<f64>, dt: f64) -> Vector3<f64> {
        self.pushed = F;
        let half = 0.5 * self.budget;
        let beyond = self.energy - half;
        if beyond <= 0.0 || dt == 0.0 {
            return F;
        }
        let least_share = self.least_share * (self.budget / self.energy).min(1.0);
        let share = (1.0 - beyond / half).max(least_share);
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

    /// What a device says that knows its velocity, and one that does not.
    const TELLS: [bool; 2] = [true, false];

    /// Greatest energy given out [J] and shake (root mean square of the velocity [m/s]) over the last of `seconds`,
    /// while a hand presses on what `environment` answers (its force [N] from position and velocity of the tool),
    /// `delay_ms` away each way, on a device that tells its velocity where `tells`.
    fn press(
        mode: RenderMode,
        tells: bool,
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
            let force = renderer.force([0.0, 0.0, grip.z], [0.0, 0.0, if tells { grip.v } else { 0.0 }], now_ns);
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
        let (raw, raw_shake) = press(RenderMode::Raw, true, 10, 0, active);
        assert!(!within_budget(raw) && raw > 1.0, "unguarded it gives out {raw} J");
        for tells in TELLS {
            let (guarded, shake) = press(RenderMode::Passive, tells, 10, 0, active);
            assert!(within_budget(guarded), "{guarded} J");
            assert!(shake < 0.5 * raw_shake, "{shake} of {raw_shake} m/s");
        }
    }

    #[test]
    fn a_stiff_floor_far_away_gives_out_no_more_than_the_budget() {
        for delay_ms in [2, 5, 10, 20] {
            let far = |tick, z: f64, _| held(tick, [0.0, 0.0, (-600.0 * z).max(0.0)]);
            let (raw, raw_shake) = press(RenderMode::Raw, true, 10, delay_ms, far);
            assert!(raw > 0.05, "{delay_ms} ms: unguarded it gives out {raw} J");
            for tells in TELLS {
                let (guarded, shake) = press(RenderMode::Passive, tells, 10, delay_ms, far);
                assert!(within_budget(guarded), "{delay_ms} ms: {guarded} J");
                assert!(shake < raw_shake, "{delay_ms} ms: {shake} of {raw_shake} m/s");
            }
        }
    }

    #[test]
    fn a_push_that_never_ends_gives_out_no_more_than_the_budget() {
        // Damping alone could not stop this: it would take 3 N at less than 0.6 m/s.
        let push = |tick, _, _| held(tick, [0.0, 0.0, 3.0]);
        for tells in TELLS {
            assert!(within_budget(press(RenderMode::Passive, tells, 3, 0, push).0));
        }
    }

    #[test]
    fn the_local_model_is_still_where_the_held_force_shakes() {
        for delay_ms in [5, 10, 20] {
            let far = |tick, z: f64, _| floor(tick, 600.0, z);
            let (_, raw) = press(RenderMode::Raw, true, 4, delay_ms, far);
            for mode in [RenderMode::LocalModel, RenderMode::LocalModelPassive] {
                let (energy, still) = press(mode, true, 4, delay_ms, far);
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

    /// A floor of 300 N/m is pressed 8 mm deep at 0.1 m/s once a second: height [m] after `t` [s]. The hand comes out as slowly,
    /// but as long as `is_snatched`, by 10 mm from one call to the next.
    fn presses(t: f64, is_snatched: bool) -> f64 {
        let t = t % 1.0;
        0.002 - if is_snatched || t < 0.5 { (0.1 * t).min(0.010) } else { (0.1 * (1.0 - t)).min(0.010) }
    }

    /// Time [s], force [N] and energy given out [J] at each call, while the hand goes where `path` says over time [s], a call
    /// every `period_ms`, on a floor `delay_ms` away each way. It tells no velocity: no damping helps.
    fn follow(
        mode: RenderMode,
        (period_ms, delay_ms): (u64, u64),
        seconds: u64,
        path: impl Fn(f64) -> f64,
    ) -> Vec<(f64, f64, f64)> {
        let conditions = LinkConditions { delay_ns: delay_ms * MS, ..LinkConditions::default() };
        let (mut out, mut back) = (Link::new(conditions, 1), Link::new(conditions, 2));
        let mut renderer = omni(mode);
        let call = |now_ms: u64| {
            let (now_ns, t) = (now_ms * MS, now_ms as f64 * 1e-3);
            out.send(now_ns, path(t));
            if let Some(z) = out.poll(now_ns) {
                back.send(now_ns, floor(now_ms, 300.0, z));
            }
            while let Some(wrench) = back.poll(now_ns) {
                renderer.receive(&wrench, now_ns);
            }
            let force = renderer.force([0.0, 0.0, path(t)], [0.0; 3], now_ns)[2];
            (t, force, renderer.observed_energy())
        };
        (period_ms..=seconds * 1000).step_by(period_ms as usize).map(call).collect()
    }

    const GUARDED: [RenderMode; 2] = [RenderMode::Passive, RenderMode::LocalModelPassive];
    /// Time from call to call, and delay each way [ms].
    const NETWORKS: [(u64, u64); 5] = [(1, 0), (1, 20), (4, 5), (11, 0), (11, 20)];

    /// The last call before `time`.
    fn at(felt: &[(f64, f64, f64)], time: f64) -> (f64, f64, f64) {
        *felt.iter().rfind(|(t, ..)| *t < time).unwrap()
    }

    #[test]
    fn a_snatched_hand_feels_again_on_its_next_press_and_pays_its_debt() {
        let budget = Device::default().passivity_budget();
        for (mode, network) in GUARDED.into_iter().flat_map(|mode| NETWORKS.map(|network| (mode, network))) {
            let felt = follow(mode, network, 6, |t| presses(t, t < 1.0));
            let [first, next, last] = [0.49, 1.49, 5.49].map(|t| at(&felt, t).1);
            let [debt, end] = [1.05, 5.95].map(|t| at(&felt, t).2 / budget);
            println!("{mode:?}, {network:?} ms: {first:.2}, {next:.2}, {last:.2} N; {debt:.2}, {end:.2} budgets");
            assert!((first - 2.4).abs() < 1e-6 && debt > 1.5, "snatched, it owes more than the budget");
            assert!(next > 0.25 * first);
            // Held forces from far away take back on the way out what the way in has paid.
            let is_behind = mode == RenderMode::Passive && network.1 > 0;
            assert!(is_behind || (last - first).abs() < 1e-6 && end < 1.0);
            assert!(end < 1.1 * debt);
            let change = |pair: &[(f64, f64, f64)]| (pair[1].1 - pair[0].1).abs();
            let most = felt.windows(2).filter(|pair| pair[1].0 > 1.01).map(change).fold(0.0, f64::max);
            // Not quicker than models blend.
            assert!(network.0 > 1 || is_behind || most < 0.15 * first, "{most} N in a millisecond");
        }
    }

    #[test]
    fn a_hand_that_is_snatched_again_and_again_is_given_less_each_time() {
        let budget = Device::default().passivity_budget();
        for (mode, network) in GUARDED.into_iter().flat_map(|mode| NETWORKS.map(|network| (mode, network))) {
            let felt = follow(mode, network, 41, |t| presses(t, true));
            let [once, ten, forty] = [1.05, 10.05, 40.05].map(|t| at(&felt, t).2 / budget);
            assert!(ten < 5.0 * once && forty < 8.0 * once, "{mode:?}, {network:?} ms: {once}, {ten}, {forty} budgets");
        }
    }

    #[test]
    fn no_vibration_in_debt_gives_out_more_than_was_paid_for_it() {
        let budget = Device::default().passivity_budget();
        // Of a hand, up to 4 g, and of an encoder between two of its steps: amplitude [m] and period [s].
        for (amplitude, period) in
            [(3e-3, 0.1), (1e-3, 0.033), (1e-4, 0.01), (0.5 * Device::default().resolution, 0.002)]
        {
            for (mode, delay_ms) in GUARDED.into_iter().flat_map(|mode| [0, 5, 20].map(|delay_ms| (mode, delay_ms))) {
                let shake = |t: f64| amplitude * t.min(1.0) * (std::f64::consts::TAU * t / period).cos();
                // After it was snatched out, 2 mm into the floor.
                let again = |t: f64| presses(t.min(0.04), true) + shake(t);
                let felt = follow(mode, (1, delay_ms), 10, |t| if t < 1.0 { presses(t, true) } else { again(t - 1.0) });
                let debt = at(&felt, 1.012).2;
                let most =
                    felt.iter().filter(|(t, ..)| *t > 1.012).map(|(.., energy)| energy - debt).fold(0.0, f64::max);
                assert!(debt > 1.5 * budget);
                assert!(most < 0.02 * budget, "{amplitude} m, {period} s, {mode:?}, {delay_ms} ms: {most} J");
            }
        }
    }
}
