//! A tool: its shape, who moves it, and how it follows the poses that arrive.
//!
//! Everything is counted in ticks, so that the same inputs give the same motion whenever they are replayed.

use super::jaws::{Jaws, Mechanism, Stance};
use crate::math::{Pose, Real, Vec3, is_finite};
use serde::{Deserialize, Serialize};

pub use super::shape::{Part, Shape};
pub use crate::model::constraint::{Coupling, MOST_POINTS, MOST_TOOLS};

/// A tool as the scene gives it.
#[derive(Clone, Debug, PartialEq)]
pub struct Tool {
    /// Name that clients ask for.
    pub name: String,
    /// Its shape.
    pub shape: Shape,
    /// Coulomb's coefficient of friction μ on the body.
    pub friction: Real,
    /// Where its shaft passes through a wall [m]: wherever a client puts it, its own +z points there.
    pub pivot: Option<Vec3>,
}

/// Where a tool stands in its life.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum Phase {
    /// Nobody moves it; it touches nothing.
    #[default]
    Detached,
    /// Moved, but it has not been outside the body yet; it touches nothing.
    Waiting,
    /// It touches, and its force is rendered.
    Engaged,
    /// Poses stopped: it stays where it is while the force goes to zero.
    Holding,
}

/// A pose as the tick consumes it.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct PoseSample {
    /// Client's sequence number.
    pub sequence: u32,
    /// Client's monotonic time [ns], echoed.
    pub time_ns: u64,
    /// Where the tool is.
    pub pose: Pose,
    /// Bit i: button i is held.
    pub buttons: u32,
    /// How far the tool's jaws are to be open: 0 to 1.
    pub opening: Real,
}

/// Force [N] and torque about a tool's reference point [N·m].
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Wrench {
    /// Force [N].
    pub force: Vec3,
    /// Torque [N·m].
    pub torque: Vec3,
    /// What opens its jaws, for the angle between them [N·m].
    pub grip: Real,
}

/// What happens to a tool in one tick.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum ToolEvent {
    /// A client takes the tool; its poses come every `period_ticks`.
    Attach {
        /// Tells this holding of the tool from earlier ones.
        epoch: u32,
        /// Ticks between two poses, at least 1.
        period_ticks: u32,
        /// What the tool hangs on, see [`ToolState::coupling`].
        coupling: Coupling,
    },
    /// The client is gone.
    Detach,
    /// A new pose.
    Pose(PoseSample),
}

/// When a tool whose poses stopped is held, silenced and given up, in ticks of pose age.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Watchdog {
    /// Older: hold the pose, ramp the force down.
    pub hold: u32,
    /// From here on no force.
    pub silent: u32,
    /// From here on no contact.
    pub detach: u32,
}

impl ToolEvent {
    /// The same with a pose whose own +z points at `pivot` [m].
    pub fn through(self, pivot: Vec3) -> Self {
        match self {
            Self::Pose(sample) => Self::Pose(PoseSample { pose: sample.pose.pointed(pivot), ..sample }),
            other => other,
        }
    }
}

impl Watchdog {
    /// 20, 70 and 100 ms, or 3, 6 and 9 client periods where those are longer.
    pub fn for_period(period_ticks: u32) -> Self {
        let periods = |n: u32, least: u32| least.max(n.saturating_mul(period_ticks));
        Self { hold: periods(3, 20), silent: periods(6, 70), detach: periods(9, 100) }
    }
}

/// Everything about a tool that changes: part of what is hashed, saved and restored.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct ToolState {
    /// Where it stands in its life.
    pub phase: Phase,
    /// Of the client that holds it; 0 when none does.
    pub epoch: u32,
    /// Ticks between two poses.
    pub period_ticks: u32,
    /// Where the simulated tool is at the end of the tick.
    pub pose: Pose,
    /// Where it was at its start.
    pub previous: Pose,
    /// Where the client holds it: what moves towards [`ToolState::target`].
    pub device: Pose,
    /// By what the simulated tool hangs on it.
    pub coupling: Coupling,
    /// Newest pose from the client.
    pub target: Pose,
    /// Ticks until it should be reached.
    pub remaining_ticks: u32,
    /// Ticks since it arrived.
    pub age_ticks: u32,
    /// Ticks for which it has [waited](Phase::Waiting), as far as it is waiting.
    pub waited: u32,
    /// Its sequence number; 0 before the first.
    pub sequence: u32,
    /// Its time stamp [ns].
    pub time_ns: u64,
    /// Buttons held.
    pub buttons: u32,
    /// How far its jaws are open.
    pub jaws: Jaws,
    /// The tool whose shape it has, where that is not its own.
    pub shape: Option<u16>,
    /// The tool cannot keep up with the poses: its speed is bounded.
    pub speed_limited: bool,
    /// Part of the physical force that is rendered, 0..=1.
    pub ramp: Real,
    /// What its coefficient of friction is more than the one that it is to have: that is taken over gradually.
    pub friction_left: Real,
    /// Force of the contact on the tool [N], last tick.
    pub physical_force: Vec3,
    /// Moment about the reference point [N·m], last tick.
    pub physical_torque: Vec3,
    /// Rendered force [N], last tick.
    pub force: Vec3,
    /// Rendered torque [N·m], last tick.
    pub torque: Vec3,
}

/// Bounds on how a tool follows.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Following {
    /// Fastest that an engaged tool moves [m/s].
    pub speed: Real,
    /// Ticks for the force to rise from zero to full at engage.
    pub engage_ticks: u32,
}

/// Ticks without wrenches from which a client lets the force fall, and at which it has none: the contract's law for clients.
const CLIENT_FADE: (u32, u32) = (20, 70);

/// Fastest that an engaged tool turns [rad/s]: two turns a second is more than a wrist does.
const MOST_TURN: Real = 12.0;

impl ToolState {
    /// True when the tool pushes the body.
    pub fn touches(&self) -> bool {
        matches!(self.phase, Phase::Engaged | Phase::Holding)
    }

    /// `ticks` pass in which the machine was away. Poses age, and the hand has heard nothing: its client has let the force
    /// fade by the contract's law, so that the force goes on from there, and rises again from zero where nothing is left.
    pub fn lapse(&mut self, ticks: u32, bounds: &Following) {
        if ticks == 0 {
            return;
        }
        self.age_ticks = self.age_ticks.saturating_add(ticks);
        self.watch(bounds);
        let (hold, silent) = CLIENT_FADE;
        let left = (Real::from(silent.saturating_sub(ticks)) / Real::from(silent - hold)).min(1.0);
        self.ramp = self.ramp.min(left);
        self.force *= left;
        self.torque *= left;
        self.jaws.torque *= left;
    }

    /// Takes in what happened and moves the tool by one tick of `tick` [s].
    pub fn follow(&mut self, event: Option<&ToolEvent>, mechanism: &Mechanism, tick: Real, bounds: &Following) {
        self.age_ticks = self.age_ticks.saturating_add(1);
        match event {
            Some(ToolEvent::Attach { epoch, period_ticks, coupling }) => {
                self.let_go();
                // The hand before let go of a force that still falls at the slew limit: it is not the next one's.
                (self.force, self.torque, self.jaws.torque) = Default::default();
                (self.epoch, self.period_ticks) = (*epoch, (*period_ticks).max(1));
                self.coupling = *coupling;
                (self.sequence, self.time_ns, self.buttons) = (0, 0, 0);
            }
            Some(ToolEvent::Detach) => {
                self.let_go();
                self.epoch = 0;
            }
            Some(ToolEvent::Pose(sample)) => self.take(sample),
            None => {}
        }
        self.watch(bounds);
        // In a tick the force along the surface changes by no more of the pressure than the whole force does at engage.
        let most = 1.0 / Real::from(bounds.engage_ticks.max(1));
        self.friction_left -= self.friction_left.max(-most).min(most);
        self.move_on(mechanism, tick, bounds);
    }

    fn let_go(&mut self) {
        self.phase = Phase::Detached;
        self.ramp = 0.0;
        (self.physical_force, self.physical_torque, self.jaws.physical_torque) = Default::default();
    }

    /// It has to be outside the body before it touches.
    pub fn wait(&mut self) {
        (self.phase, self.ramp, self.waited) = (Phase::Waiting, 0.0, 0);
    }

    fn take(&mut self, sample: &PoseSample) {
        self.age_ticks = 0;
        self.sequence = sample.sequence;
        self.time_ns = sample.time_ns;
        self.buttons = sample.buttons;
        self.target = sample.pose;
        self.remaining_ticks = self.period_ticks.max(1);
        self.jaws.take(sample.opening, self.phase == Phase::Detached);
        match self.phase {
            // A tool that touches nothing may be anywhere at once.
            Phase::Detached => {
                self.wait();
                (self.pose, self.device) = (sample.pose, sample.pose);
                self.remaining_ticks = 0;
            }
            // Back before its force was gone: go on, and let the force rise again.
            Phase::Holding if self.ramp > 0.0 => self.phase = Phase::Engaged,
            Phase::Holding => {
                self.let_go();
                self.wait();
            }
            Phase::Waiting | Phase::Engaged => {}
        }
    }

    fn watch(&mut self, bounds: &Following) {
        let dog = Watchdog::for_period(self.period_ticks);
        match self.phase {
            Phase::Engaged if self.age_ticks > dog.hold => {
                self.phase = Phase::Holding;
                self.target = self.device;
                self.jaws.hold();
                self.remaining_ticks = 0;
            }
            Phase::Engaged => self.ramp = (self.ramp + 1.0 / Real::from(bounds.engage_ticks.max(1))).min(1.0),
            _ => {}
        }
        if self.phase == Phase::Holding {
            let left = Real::from(dog.silent.saturating_sub(self.age_ticks)) / Real::from(dog.silent - dog.hold);
            self.ramp = self.ramp.min(left);
        }
        if self.phase != Phase::Detached && self.age_ticks >= dog.detach {
            self.let_go();
        }
    }

    /// One tick along the way to the newest pose: a `remaining_ticks`-th of it, so that a headset's 72 poses a second
    /// become a smooth path, and never faster than the bounds.
    fn move_on(&mut self, mechanism: &Mechanism, tick: Real, bounds: &Following) {
        self.previous = self.pose;
        self.speed_limited = false;
        let fraction = 1.0 / Real::from(self.remaining_ticks.max(1));
        self.remaining_ticks = self.remaining_ticks.saturating_sub(1);
        let most = mechanism.most_within(tick, bounds.speed, MOST_TURN);
        self.jaws.follow(mechanism, fraction, Some(most).filter(|_| self.touches()));
        if !self.touches() {
            self.device = self.device.towards(&self.target, fraction);
            self.pose = self.device;
            return;
        }
        let distance = (self.target.position - self.device.position).norm();
        let (a, b) = (self.device.orientation, self.target.orientation);
        // The chord between unit quaternions is about half the angle between the orientations.
        let chord = |sign: Real| (0..4).map(|i| (b[i] - sign * a[i]) * (b[i] - sign * a[i])).sum::<Real>();
        let angle = 2.0 * chord(1.0).min(chord(-1.0)).sqrt();
        let mut allowed = fraction;
        if distance * allowed > bounds.speed * tick {
            allowed = bounds.speed * tick / distance;
        }
        if angle * allowed > MOST_TURN * tick {
            allowed = MOST_TURN * tick / angle;
        }
        self.speed_limited = allowed < fraction;
        self.device = self.device.towards(&self.target, allowed);
        // The springs keep their lengths until the contacts of this tick are solved.
        self.pose = self.proxy();
    }

    /// The device's pose, moved and turned by what the coupling gives way by under the last contact force and torque.
    fn proxy(&self) -> Pose {
        if !self.touches() {
            return self.device;
        }
        let Coupling { compliance, angular_compliance } = self.coupling;
        let mut pose = self.device;
        pose.position += self.physical_force * compliance;
        if angular_compliance > 0.0 {
            pose = pose.turned(self.physical_torque * angular_compliance);
        }
        pose
    }

    /// Takes in the contact's `wrench` of this tick, under which the simulated tool hangs back from the device.
    pub fn update_proxy(&mut self, mechanism: &Mechanism, wrench: &Wrench) {
        let Wrench { force, torque, grip } = *wrench;
        let sound = is_finite(&force) && is_finite(&torque);
        (self.physical_force, self.physical_torque) = if sound { (force, torque) } else { Default::default() };
        self.pose = self.proxy();
        self.jaws.update(mechanism, grip, self.touches());
    }

    /// It has not moved in the tick.
    pub fn stand(&mut self) {
        (self.previous, self.jaws.previous) = (self.pose, self.jaws.opening);
    }

    /// Where it is at the end of the tick.
    pub fn stance(&self) -> Stance {
        Stance { pose: self.pose, opening: self.jaws.opening }
    }

    /// Where it was at its start.
    pub fn previous_stance(&self) -> Stance {
        Stance { pose: self.previous, opening: self.jaws.previous }
    }

    /// In the middle of the tick: where contacts are found and moments taken.
    pub fn middle(&self) -> Stance {
        self.previous_stance().half_way(&self.stance())
    }

    /// What the contact has put on it, last tick.
    pub fn physical(&self) -> Wrench {
        Wrench { force: self.physical_force, torque: self.physical_torque, grip: self.jaws.physical_torque }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const BOUNDS: Following = Following { speed: 1.0, engage_ticks: 100 };

    fn at(x: Real, sequence: u32) -> ToolEvent {
        ToolEvent::Pose(PoseSample {
            sequence,
            time_ns: 0,
            pose: Pose { position: Vec3::new(x, 0.0, 0.0), ..Pose::default() },
            buttons: 0,
            opening: 0.0,
        })
    }

    fn engaged(period_ticks: u32) -> ToolState {
        let mut tool = ToolState::default();
        tool.follow(
            Some(&ToolEvent::Attach { epoch: 1, period_ticks, coupling: Coupling::RIGID }),
            &Mechanism::default(),
            1e-3,
            &BOUNDS,
        );
        tool.follow(Some(&at(0.0, 1)), &Mechanism::default(), 1e-3, &BOUNDS);
        tool.phase = Phase::Engaged;
        tool
    }

    #[test]
    fn a_tool_through_a_pivot_points_there_wherever_its_client_puts_it() {
        let pivot = Vec3::new(0.0, 0.1, 0.2);
        let mut tool = engaged(1);
        for i in 2..300 {
            let event = at(5e-4 * Real::from(i), i).through(pivot);
            tool.follow(Some(&event), &Mechanism::default(), 1e-3, &BOUNDS);
            tool.phase = Phase::Engaged;
        }
        let shaft = tool.pose.rotate(Vec3::z());
        assert!(
            (tool.pose.position.x - 0.1495).abs() < 1e-12 && shaft.cross(&(pivot - tool.pose.position)).norm() < 1e-12
        );
        assert_eq!(ToolEvent::Detach.through(pivot), ToolEvent::Detach);
    }

    #[test]
    fn a_new_holder_feels_nothing_of_the_force_of_the_last_one() {
        let mut tool = engaged(1);
        (tool.ramp, tool.force, tool.torque) = (1.0, Vec3::new(0.0, 0.0, 1.6), Vec3::new(0.0, 0.05, 0.0));
        tool.follow(Some(&ToolEvent::Detach), &Mechanism::default(), 1e-3, &BOUNDS);
        let next = ToolEvent::Attach { epoch: 2, period_ticks: 1, coupling: Coupling::RIGID };
        tool.follow(Some(&next), &Mechanism::default(), 1e-3, &BOUNDS);
        assert_eq!((tool.epoch, tool.force, tool.torque), (2, Vec3::zeros(), Vec3::zeros()));
    }

    #[test]
    fn samples_at_72_hz_become_a_path_without_jumps() {
        let mut tool = engaged(14);
        let mut last = 0.0;
        for tick in 0..140 {
            let event = (tick % 14 == 0).then(|| at(0.0005 * Real::from(tick), 2 + tick as u32));
            tool.follow(event.as_ref(), &Mechanism::default(), 1e-3, &BOUNDS);
            assert!((tool.pose.position.x - last).abs() <= 0.0005 + 1e-12);
            last = tool.pose.position.x;
        }
        assert!(last > 0.055);
    }

    #[test]
    fn a_jump_of_a_metre_is_followed_at_the_speed_limit() {
        let mut tool = engaged(1);
        tool.follow(Some(&at(1.0, 2)), &Mechanism::default(), 1e-3, &BOUNDS);
        assert!((tool.pose.position.x - 1e-3).abs() < 1e-12 && tool.speed_limited);
    }

    #[test]
    fn silence_holds_then_silences_then_detaches() {
        let mut tool = engaged(1);
        tool.ramp = 1.0;
        let mut ramps = Vec::new();
        for _ in 0..100 {
            tool.follow(None, &Mechanism::default(), 1e-3, &BOUNDS);
            ramps.push((tool.age_ticks, tool.phase, tool.ramp));
        }
        let at_age = |age: u32| ramps.iter().find(|r| r.0 == age).copied().unwrap();
        assert_eq!(at_age(20).1, Phase::Engaged);
        assert_eq!(at_age(21).1, Phase::Holding);
        assert!((at_age(45).2 - 0.5).abs() < 1e-12);
        assert_eq!(at_age(70), (70, Phase::Holding, 0.0));
        assert_eq!(at_age(100).1, Phase::Detached);
    }

    #[test]
    fn ticks_that_lapse_age_a_pose_and_fade_the_force_as_the_client_does_meanwhile() {
        let pressing = |period_ticks: u32| {
            let mut tool = engaged(period_ticks);
            (tool.ramp, tool.force) = (1.0, Vec3::new(0.0, 0.0, 2.0));
            tool
        };
        for (period, ticks, phase, left) in [
            (1, 15, Phase::Engaged, 1.0),
            (1, 45, Phase::Engaged, 0.5),
            (14, 45, Phase::Engaged, 0.5),
            (14, 71, Phase::Waiting, 0.0),
            (1, 71, Phase::Waiting, 0.0),
            (1, 500, Phase::Waiting, 0.0),
            (14, 60_000, Phase::Waiting, 0.0),
            (14, u32::MAX, Phase::Waiting, 0.0),
        ] {
            let mut tool = pressing(period);
            tool.lapse(ticks, &BOUNDS);
            assert!((tool.force.z - 2.0 * left).abs() < 1e-12, "{period} {ticks}: {}", tool.force);
            // A pose that had waited since the machine went away does not make up for it.
            tool.follow(Some(&at(0.0, 2)), &Mechanism::default(), 1e-3, &BOUNDS);
            assert_eq!(tool.phase, phase, "{period} {ticks}");
            assert!(tool.ramp <= left + 0.01 + 1e-12, "{period} {ticks}: {}", tool.ramp);
        }
    }

    #[test]
    fn slow_clients_get_longer_deadlines() {
        assert_eq!(Watchdog::for_period(1), Watchdog { hold: 20, silent: 70, detach: 100 });
        assert_eq!(Watchdog::for_period(14), Watchdog { hold: 42, silent: 84, detach: 126 });
    }

    #[test]
    fn a_client_that_is_back_before_its_force_is_gone_goes_on_and_one_back_later_waits_outside() {
        let mut tool = engaged(1);
        tool.ramp = 1.0;
        (0..40).for_each(|_| tool.follow(None, &Mechanism::default(), 1e-3, &BOUNDS));
        tool.follow(Some(&at(0.0, 2)), &Mechanism::default(), 1e-3, &BOUNDS);
        assert_eq!(tool.phase, Phase::Engaged);
        assert!(tool.ramp < 0.7);
        (0..80).for_each(|_| tool.follow(None, &Mechanism::default(), 1e-3, &BOUNDS));
        tool.follow(Some(&at(0.0, 3)), &Mechanism::default(), 1e-3, &BOUNDS);
        assert_eq!((tool.phase, tool.ramp), (Phase::Waiting, 0.0));
    }
}
