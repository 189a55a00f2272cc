//! Jaws of a tool: parts that turn about hinges, all by one mechanism, which a client opens and closes.
//!
//! Between the opening that the client asks for and that of the simulated jaws is a spring, as between device and tool, so that
//! jaws which cannot close press no harder than the instrument can. What acts on the jaws is measured by the moment that is
//! conjugate to the angle between them, the sum of the angles by which parts turn: of two jaws that turn alike, that on either.

pub use super::hinge::Hinge;
use super::shape::{Part, Shape};
use crate::math::{Pose, Real, Vec3};
use crate::model::constraint::Grip;
use serde::{Deserialize, Serialize};

/// Where a tool is, and how far its jaws are open.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Stance {
    /// Of the tool.
    pub pose: Pose,
    /// From 0, closed, to 1.
    pub opening: Real,
}

impl Stance {
    /// Of a tool without jaws.
    pub fn at(pose: Pose) -> Self {
        Self { pose, opening: 0.0 }
    }

    /// Half way to `other`.
    pub fn half_way(&self, other: &Stance) -> Self {
        Self { pose: self.pose.towards(&other.pose, 0.5), opening: 0.5 * (self.opening + other.opening) }
    }

    /// The frame of the tool as `part` has it: turned about its hinge.
    pub fn of_part(&self, part: &Part) -> Pose {
        part.hinge().map_or(self.pose, |hinge| hinge.turned(&self.pose, self.opening))
    }

    /// How the place `p` of `part` [m] moves as the angle between the jaws of `mechanism` grows [m/rad].
    pub fn lever(&self, part: &Part, mechanism: &Mechanism, p: Vec3) -> Vec3 {
        match part.hinge() {
            Some(hinge) if mechanism.angle > 0.0 => {
                hinge.lever(&self.pose, p) * ((hinge.open - hinge.closed) / mechanism.angle)
            }
            _ => Vec3::zeros(),
        }
    }
}

/// What moves the jaws of a tool.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Mechanism {
    /// Between the jaws where they are open, more than where they are closed [rad]; 0: there are none.
    pub angle: Real,
    /// By how much a moment opens or closes them [rad/(N·m)].
    pub compliance: Real,
    /// Farthest that a place of them goes from closed to open [m], ...
    way: Real,
    /// ... and farthest that one turns [rad].
    turn: Real,
}

impl Mechanism {
    /// Of a tool of that `shape`.
    pub fn of(shape: &Shape) -> Self {
        let turn = |part: &Part| part.hinge().map_or(0.0, |hinge| (hinge.open - hinge.closed).abs());
        let all = |value: &dyn Fn(&Part) -> Real| shape.parts().iter().map(value).fold(0.0, Real::max);
        let angle: Real = shape.parts().iter().map(turn).sum();
        let compliance = if shape.grip() > 0.0 { angle / shape.grip() } else { 0.0 };
        Self { angle, compliance, way: all(&|part| turn(part) * part.reach()), turn: all(&turn) }
    }

    /// What the solver needs to know of jaws that a client holds `opening` wide.
    pub fn grip(&self, opening: Real) -> Grip {
        Grip { free: self.angle * opening, compliance: self.compliance, most: self.angle }
    }

    /// Part of the way from closed to open that the jaws go at most within `time` [s], so that no place is faster than `speed` [m/s],
    /// and none turns by more than `turn` [rad/s].
    pub(super) fn most_within(&self, time: Real, speed: Real, turn: Real) -> Real {
        (speed / self.way).min(turn / self.turn) * time
    }
}

/// How far the jaws of a tool are open, from 0 to 1; all zero where it has none.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Jaws {
    /// As the client asks for.
    pub target: Real,
    /// As the client holds them: what moves towards that.
    pub device: Real,
    /// Of the simulated tool at the end of the tick.
    pub opening: Real,
    /// And at its start.
    pub previous: Real,
    /// Moment of the contact that opens them [N·m], last tick.
    pub physical_torque: Real,
    /// What of it is rendered [N·m], last tick.
    pub torque: Real,
}

impl Jaws {
    /// As a client holds them from now on; one that cannot be seen in the body may be so at once.
    pub(super) fn take(&mut self, opening: Real, at_once: bool) {
        self.target = if opening.is_finite() { opening.clamp(0.0, 1.0) } else { self.device };
        if at_once {
            (self.device, self.opening) = (self.target, self.target);
        }
    }

    /// They stay as they are held.
    pub(super) fn hold(&mut self) {
        self.target = self.device;
    }

    /// One tick towards the target: a `fraction` of the way, but no more than `most` of it all where they may touch something.
    pub(super) fn follow(&mut self, mechanism: &Mechanism, fraction: Real, most: Option<Real>) {
        self.previous = self.opening;
        if mechanism.angle == 0.0 {
            *self = Self::default();
            return;
        }
        let step = (self.target - self.device) * fraction;
        let bound = most.unwrap_or(1.0);
        self.device += step.max(-bound).min(bound);
        self.give_way(mechanism, most.is_some());
    }

    /// What `touches` hangs back from where it is held under the last moment.
    fn give_way(&mut self, mechanism: &Mechanism, touches: bool) {
        let moment = if touches { -self.physical_torque } else { 0.0 };
        self.opening = mechanism.grip(self.device).angle(moment) / mechanism.angle;
    }

    /// Takes in the moment of this tick [N·m], under which the simulated jaws hang back from those that are held.
    pub(super) fn update(&mut self, mechanism: &Mechanism, moment: Real, touches: bool) {
        if mechanism.angle > 0.0 {
            self.physical_torque = if moment.is_finite() { moment } else { 0.0 };
            self.give_way(mechanism, touches);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::contact::shape::Part;

    fn forceps() -> Shape {
        let jaw = |side: Real| {
            let hinge = Hinge { axis: Vec3::y(), point: Vec3::z() * 0.1, closed: 0.0, open: 0.3 * side };
            Part::capsule(0.002, 0.1).hinged(hinge)
        };
        Shape::compound(vec![jaw(1.0), jaw(-1.0), Part::capsule(0.002, 0.02)]).unwrap().with_grip(0.06)
    }

    #[test]
    fn a_hinged_part_turns_about_its_hinge_in_the_tools_frame() {
        let shape = forceps();
        let pose = Pose { position: Vec3::new(1.0, 2.0, 3.0), ..Pose::default() }.turned(Vec3::new(0.2, -0.1, 0.4));
        for opening in [0.0, 0.4, 1.0] {
            let stance = Stance { pose, opening };
            let hinged = stance.of_part(&shape.parts()[0]);
            let angle = 0.3 * opening;
            // By hand: the tip is 0.1 m below the hinge.
            let own = Vec3::new(-0.1 * angle.sin(), 0.0, 0.1 - 0.1 * angle.cos());
            assert!((hinged.to_world(Vec3::zeros()) - pose.to_world(own)).norm() < 1e-15);
            assert_eq!(stance.of_part(&shape.parts()[2]), pose);
        }
        // However it is put together, one ball holds it.
        let (hinge, aside) =
            (*shape.parts()[0].hinge().unwrap(), Pose { position: Vec3::x() * 0.03, ..Pose::default() });
        let [one, other] = [|p: Part, h, at| p.hinged(h).at(at), |p: Part, h, at| p.at(at).hinged(h)]
            .map(|made: fn(Part, Hinge, Pose) -> Part| made(Part::capsule(0.002, 0.05), hinge, aside));
        assert_eq!(one, other);
    }

    #[test]
    fn a_lever_is_the_derivative_of_a_place_by_the_angle_between_the_jaws() {
        let shape = forceps();
        let mechanism = Mechanism::of(&shape);
        assert!((mechanism.angle - 0.6).abs() < 1e-15 && (mechanism.compliance - 10.0).abs() < 1e-12);
        let pose = Pose::default().turned(Vec3::new(0.5, 0.3, -0.2));
        let step = 1e-6;
        for part in &shape.parts()[..2] {
            let place = |opening: Real| Stance { pose, opening }.of_part(part).to_world(Vec3::new(0.0, 0.001, 0.02));
            let slope = (place(0.5 + step) - place(0.5 - step)) / (2.0 * step * mechanism.angle);
            let lever = Stance { pose, opening: 0.5 }.lever(part, &mechanism, place(0.5));
            assert!((slope - lever).norm() < 1e-9, "{slope} {lever}");
        }
    }

    #[test]
    fn jaws_that_are_held_open_press_with_no_more_than_the_grip() {
        let mechanism = Mechanism::of(&forceps());
        // Fully closed by the hand, and held fully open.
        let opened = mechanism.grip(0.0).angle(-0.06);
        assert!((opened - mechanism.angle).abs() < 1e-15);
        // Nothing opens them farther than they go, or closes them through one another.
        assert_eq!(mechanism.grip(0.2).angle(-1.0), mechanism.angle);
        assert_eq!(mechanism.grip(0.2).angle(1.0), 0.0);
    }

    #[test]
    fn jaws_that_touch_close_no_faster_than_a_tool_moves() {
        let mechanism = Mechanism::of(&forceps());
        let most = mechanism.most_within(1e-3, 0.1, 12.0);
        let mut jaws = Jaws { target: 0.0, device: 1.0, opening: 1.0, ..Jaws::default() };
        jaws.follow(&mechanism, 1.0, Some(most));
        // The farthest place, the rounding of the tip, goes 0.3 rad of a circle of some 0.102 m.
        let gone = (1.0 - jaws.device) * 0.3 * 0.102;
        assert!(gone > 0.9e-4 && gone <= 1e-4 + 1e-12, "{gone}");
    }
}
