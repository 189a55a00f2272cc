//! How the mouse's tool moves: around the body, never through it, onto the place that was pressed, and in.

use three_d::{InnerSpace, Quat, Rotation, Vec3};

/// Fastest that the hand travels where it touches nothing [m/s].
const TRAVEL: f32 = 0.6;
/// Fastest that it presses and strokes [m/s].
const PRESS: f32 = 0.15;
/// Between the tool and the surface before it is pressed in [m].
const HOVER: f32 = 0.015;

/// Time in which jaws open or close all the way [s]. Chosen, as of the virtual Phantom: a faster grip is a blow, a slower one is waited for.
const JAWS: f32 = 0.5;

/// A place on the surface that the mouse presses.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Press {
    /// On the surface as it was when the press began [m].
    pub point: Vec3,
    /// Out of the body there, unit.
    pub normal: Vec3,
    /// How far in the tool is to go [m]; below zero it is above.
    pub depth: f32,
}

/// The tool in the mouse's hand. Its shaft points out of the body.
#[derive(Clone, Copy, Debug)]
pub struct Hand {
    /// The tool's reference point [m].
    pub position: Vec3,
    /// Where the tool's own +z points, unit.
    shaft: Vec3,
    /// From the reference point to the part that touches, against the shaft [m].
    reach: f32,
    /// A ball that holds the body: centre and radius [m], with room for the tool around it.
    around: (Vec3, f32),
    /// The place that it is on, from hovering above it until it hovers again.
    on: Option<Press>,
    /// How far it holds the tool's jaws open: 0, closed, to 1.
    pub opening: f32,
}

impl Hand {
    /// Far enough above a body that lies within the ball of `radius` around `centre` [m]; the tool's reference point is
    /// `reach` behind the part that touches.
    pub fn above(centre: Vec3, radius: f32, reach: f32) -> Self {
        let radius = radius + reach + HOVER;
        Self {
            position: centre + radius * Vec3::unit_z(),
            shaft: Vec3::unit_z(),
            reach,
            around: (centre, radius),
            on: None,
            opening: 0.0,
        }
    }

    /// Opens or closes jaws, as far as `dt` [s] lasts.
    pub fn move_jaws(&mut self, open: bool, dt: f32) {
        let way = if open { dt } else { -dt } / JAWS;
        self.opening = (self.opening + way).clamp(0.0, 1.0);
    }

    /// One step of `dt` [s] towards what the mouse wants; `None` lets go.
    pub fn step(&mut self, wanted: Option<Press>, dt: f32) {
        match (self.on, wanted) {
            (Some(_), Some(wanted)) => {
                self.go(self.place(&wanted, wanted.depth), PRESS * dt);
                self.on = Some(wanted);
            }
            (Some(last), None) => {
                if self.go(self.place(&last, -HOVER), PRESS * dt) {
                    self.on = None;
                }
            }
            (None, Some(wanted)) => {
                if self.travel(self.place(&wanted, -HOVER), TRAVEL * dt) {
                    self.on = Some(wanted);
                }
            }
            (None, None) => {}
        }
        let shaft = match self.on.or(wanted) {
            Some(press) => press.normal,
            None => self.shaft,
        };
        // Turns within about a tenth of a second.
        self.shaft = (self.shaft + (10.0 * dt).min(1.0) * (shaft - self.shaft)).normalize();
    }

    /// How the tool is turned.
    pub fn orientation(&self) -> Quat {
        Quat::between_vectors(Vec3::unit_z(), self.shaft)
    }

    /// Where the reference point is when the tool is `depth` in.
    fn place(&self, press: &Press, depth: f32) -> Vec3 {
        press.point + (self.reach - depth) * press.normal
    }

    /// Straight towards `goal`, `step` far; true when it is there.
    fn go(&mut self, goal: Vec3, step: f32) -> bool {
        let way = goal - self.position;
        let there = way.magnitude() <= step;
        self.position = if there { goal } else { self.position + way.normalize_to(step) };
        there
    }

    /// Towards `goal` outside the ball around the body until it is above it, then down; true when it is there.
    fn travel(&mut self, goal: Vec3, step: f32) -> bool {
        let (centre, radius) = self.around;
        let (from, to) = (self.position - centre, goal - centre);
        if from.angle(to).0.abs() < 0.05 {
            return self.go(goal, step);
        }
        if from.magnitude() < radius - 1e-4 {
            self.go(centre + from.normalize_to(radius), step);
            return false;
        }
        // Along the great circle; from the very opposite side any of them will do.
        let mut across = to - from * (to.dot(from) / from.magnitude2());
        if across.magnitude() < 1e-6 {
            across = from.cross(if from.x.abs() < 0.5 * from.magnitude() { Vec3::unit_x() } else { Vec3::unit_y() });
        }
        self.position = centre + (from + across.normalize_to(step)).normalize_to(radius);
        false
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use three_d::{Rotation, vec3};

    const BALL: f32 = 0.1;
    const DT: f32 = 1e-3;

    fn hand() -> Hand {
        Hand::above(vec3(0.0, 0.0, 0.0), BALL, 0.01)
    }

    /// A press on the ball of [`BALL`] around the origin.
    fn press(direction: Vec3) -> Press {
        let normal = direction.normalize();
        Press { point: BALL * normal, normal, depth: 0.02 }
    }

    #[test]
    fn a_press_goes_around_the_body_and_then_in_along_the_normal() {
        let mut hand = hand();
        for direction in [vec3(1.0, 0.2, 0.1), vec3(0.0, 0.0, -1.0), vec3(0.0, 1.0, 1.0), vec3(0.0, -1.0, -1.0)] {
            let press = press(direction);
            let mut closest = f32::MAX;
            for _ in 0..3000 {
                let before = hand.position;
                hand.step(Some(press), DT);
                assert!((hand.position - before).magnitude() <= TRAVEL * DT * 1.01);
                if hand.position.normalize().dot(press.normal) < 0.99 {
                    closest = closest.min(hand.position.magnitude());
                }
            }
            assert!(closest > BALL + 0.01, "it went through the body: {closest}");
            assert!((hand.position.magnitude() - (BALL + 0.01 - 0.02)).abs() < 1e-5, "{:?}", hand.position);
            assert!(hand.orientation().rotate_vector(Vec3::unit_z()).dot(press.normal) > 0.999);
            for _ in 0..1000 {
                hand.step(None, DT);
            }
            assert!((hand.position.magnitude() - (BALL + 0.01 + HOVER)).abs() < 1e-5, "let go, it hovers");
        }
    }

    #[test]
    fn jaws_open_and_close_within_half_a_second() {
        let mut hand = hand();
        for (open, end) in [(true, 1.0), (false, 0.0)] {
            (0..450).for_each(|_| hand.move_jaws(open, DT));
            assert!((hand.opening - end).abs() > 0.05);
            (0..60).for_each(|_| hand.move_jaws(open, DT));
            assert_eq!(hand.opening, end);
        }
    }

    #[test]
    fn a_drag_strokes_and_the_wheel_goes_deeper_no_faster_than_a_hand() {
        let mut hand = hand();
        let start = press(vec3(0.0, 0.0, 1.0));
        (0..2000).for_each(|_| hand.step(Some(start), DT));
        let moved = Press { point: start.point + vec3(0.03, 0.0, 0.0), depth: 0.03, ..start };
        let (mut seconds, mut fastest) = (0.0, 0f32);
        while (hand.position - vec3(0.03, 0.0, BALL + 0.01 - 0.03)).magnitude() > 1e-5 && seconds < 2.0 {
            let before = hand.position;
            hand.step(Some(moved), DT);
            fastest = fastest.max((hand.position - before).magnitude() / DT);
            seconds += DT;
        }
        assert!((0.2..0.3).contains(&seconds), "{seconds}");
        assert!(fastest <= PRESS * 1.01);
    }
}
