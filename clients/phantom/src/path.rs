//! Where the hand wants to be: paths of palpation, as functions of time.

use clap::ValueEnum;
use nalgebra::UnitQuaternion;

use crate::Vec3;

/// Every path stays at its beginning this long [s]: the server gives no force before a tool has been outside.
const SETTLE: f64 = 0.5;
/// Time of the way from the standoff to just outside [s], where a pattern begins there.
const APPROACH: f64 = 0.5;
/// A press and the rest after it [s].
const PRESS_TIME: f64 = 3.5;
/// Height "just outside" [m] at which the hand moves between two presses.
const CLEARANCE: f64 = 2e-3;
/// Height from which taps begin [m].
const TAP_HEIGHT: f64 = 5e-3;
/// Taps per second [Hz].
const TAP_RATE: f64 = 4.0;
/// Sites of a palpation along the tangent [m], visited in turn and again from the front.
const RASTER: [f64; 8] = [0.0, 0.01, 0.02, 0.01, 0.0, -0.01, -0.02, -0.01];
/// Share of a palpation's second that is the press; the rest moves to the next site.
const PRESS_SHARE: f64 = 0.8;
/// Length of a stroke along the tangent [m] and its duration [s]: 0.1 m/s in the mean.
const STROKE_LENGTH: f64 = 0.05;
const STROKE_TIME: f64 = 0.5;
/// A physiological tremor: frequency [Hz] and amplitude [m].
const TREMOR_RATE: f64 = 10.0;
const TREMOR_AMPLITUDE: f64 = 0.3e-3;
/// A turn of a held tool [rad]: about the normal, and its tilt about the tangent. Chosen: with much less there is little to feel, and with
/// much more a hand would turn from the elbow.
const TWIST: f64 = 0.6;
const TILT: f64 = 0.25;
/// Time in which jaws close or open [s], when a grasp lifts what it holds, when it lets go, and how long it takes in all. Chosen:
/// so that a hand can be followed by the eye.
const CLOSING_TIME: f64 = 0.6;
const LIFTS: f64 = 1.0 + CLOSING_TIME + 0.2;
const OPENS: f64 = LIFTS + 3.0;
const GRASP_TIME: f64 = OPENS + CLOSING_TIME + 1.5;
/// Button that is held meanwhile.
const BUTTON: u32 = 1;
/// Half the distance of the central difference that gives velocities [s].
const DIFFERENCE: f64 = 1e-5;

/// What the hand does.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Pattern {
    /// In within 1 s, held 1 s, out within 1 s, 0.5 s of rest, again.
    Press,
    /// A press per second, at sites up to 20 mm to either side.
    Palpate,
    /// Press, 50 mm along the tangent at 0.1 m/s and back, lift.
    Stroke,
    /// Four light taps per second.
    Tap,
    /// Press and hold, with a trembling hand: 10 Hz, 0.3 mm.
    Tremor,
    /// A press in which the tool is turned by 34° to either side and tilted by 14°, with a button down.
    Turn,
    /// Down with open jaws, closed there, lifted for a second, set down and let go: for a tool with jaws.
    Grasp,
}

impl Pattern {
    /// How far below the surface the hand goes where nobody says [m]; chosen: a press that is felt, and as deep as jaws hold with
    /// all of their faces.
    pub fn depth(self) -> f64 {
        if self == Pattern::Grasp { 0.016 } else { 0.012 }
    }

    /// The name it is chosen by.
    pub fn name(self) -> String {
        self.to_possible_value().map(|value| value.get_name().to_owned()).unwrap_or_default()
    }
}

/// Where the body is touched.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Site {
    /// The tool's reference point when the tool just touches [m]: for a ball one radius off the surface.
    pub point: Vec3,
    /// Unit normal of the surface, outward.
    pub normal: Vec3,
    /// Unit tangent of the surface, along which the hand moves.
    pub tangent: Vec3,
    /// Height above touch at which paths begin and rest [m].
    pub standoff: f64,
    /// How far below touch the hand wants to go [m]; the body lets it go less far.
    pub depth: f64,
}

/// Where the hand wants the tool to be, and how it wants it to move.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Target {
    /// Of the tool's reference point [m].
    pub position: Vec3,
    /// [m/s]
    pub velocity: Vec3,
    /// From the tool's own frame to the world's.
    pub orientation: UnitQuaternion<f64>,
    /// [rad/s], about the world's axes.
    pub angular_velocity: Vec3,
    /// Buttons that are down, one a bit.
    pub buttons: u32,
    /// How far the jaws are open, 0 to 1.
    pub opening: f64,
}

impl Target {
    /// Not turned, with no button down.
    pub fn upright(position: Vec3, velocity: Vec3) -> Self {
        let (orientation, angular_velocity) = (UnitQuaternion::identity(), Vec3::zeros());
        Self { position, velocity, orientation, angular_velocity, buttons: 0, opening: 0.0 }
    }
}

/// A pattern at a site.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Path {
    /// What the hand does.
    pub pattern: Pattern,
    /// And where.
    pub site: Site,
}

impl Path {
    /// The target `t` seconds after the beginning. Periodic patterns go on for ever.
    pub fn target(&self, t: f64) -> Target {
        let [before, after] = [t - DIFFERENCE, t + DIFFERENCE];
        let velocity = (self.position(after) - self.position(before)) / (2.0 * DIFFERENCE);
        let turn = self.orientation(after) * self.orientation(before).inverse();
        let (orientation, angular_velocity) = (self.orientation(t), turn.scaled_axis() / (2.0 * DIFFERENCE));
        Target {
            orientation,
            angular_velocity,
            buttons: self.buttons(t),
            opening: self.opening(t),
            ..Target::upright(self.position(t), velocity)
        }
    }

    /// While a turning hand holds, it turns to one side, to the other and back.
    fn orientation(&self, t: f64) -> UnitQuaternion<f64> {
        let Some(held) = self.held(t) else { return UnitQuaternion::identity() };
        let turn = (std::f64::consts::TAU * minimum_jerk(held)).sin();
        UnitQuaternion::new(self.site.normal * (TWIST * turn)) * UnitQuaternion::new(self.site.tangent * (TILT * turn))
    }

    fn opening(&self, t: f64) -> f64 {
        if self.pattern != Pattern::Grasp {
            return 0.0;
        }
        let t = (t - SETTLE).max(0.0) % GRASP_TIME;
        1.0 - minimum_jerk((t - 1.0) / CLOSING_TIME) + minimum_jerk((t - OPENS) / CLOSING_TIME)
    }

    fn buttons(&self, t: f64) -> u32 {
        if self.held(t).is_some() { BUTTON } else { 0 }
    }

    /// How long a turning hand has held its depth [s].
    fn held(&self, t: f64) -> Option<f64> {
        let held = (t - SETTLE).max(0.0) % PRESS_TIME - 1.0;
        Some(held).filter(|held| self.pattern == Pattern::Turn && (0.0..1.0).contains(held))
    }

    fn position(&self, t: f64) -> Vec3 {
        let (along, height) = self.along_and_height((t - SETTLE).max(0.0));
        self.site.point + self.site.tangent * along + self.site.normal * height
    }

    /// Way along the tangent and height above touch [m], `t` seconds after the settling time.
    fn along_and_height(&self, t: f64) -> (f64, f64) {
        let Site { standoff, depth, .. } = self.site;
        let pressed = |share: f64| between(standoff, -depth, share);
        match self.pattern {
            Pattern::Press | Pattern::Turn => {
                let t = t % PRESS_TIME;
                (0.0, pressed(minimum_jerk(t) - minimum_jerk(t - 2.0)))
            }
            Pattern::Grasp => {
                let t = t % GRASP_TIME;
                let lifted = minimum_jerk(t - LIFTS) - minimum_jerk(t - LIFTS - 2.0);
                (0.0, pressed(minimum_jerk(t) - lifted - minimum_jerk(t - OPENS - CLOSING_TIME)))
            }
            Pattern::Palpate => {
                let clearance = CLEARANCE.min(standoff);
                if t < APPROACH {
                    return (RASTER[0], between(standoff, clearance, minimum_jerk(t / APPROACH)));
                }
                let cycle = (t - APPROACH).floor();
                let t = t - APPROACH - cycle;
                let site = cycle as usize % RASTER.len();
                let press = raised_cosine((t / PRESS_SHARE).min(1.0));
                let move_on = minimum_jerk((t - PRESS_SHARE) / (1.0 - PRESS_SHARE));
                let along = between(RASTER[site], RASTER[(site + 1) % RASTER.len()], move_on);
                (along, between(clearance, -depth, press))
            }
            Pattern::Stroke => {
                let t = t % 3.5;
                let there = minimum_jerk((t - 1.0) / STROKE_TIME) - minimum_jerk((t - 1.0 - STROKE_TIME) / STROKE_TIME);
                let lift = minimum_jerk(t - 1.0 - 2.0 * STROKE_TIME);
                (STROKE_LENGTH * (there - 0.5), pressed(minimum_jerk(t) - lift))
            }
            Pattern::Tap => {
                let top = TAP_HEIGHT.min(standoff);
                if t < APPROACH {
                    return (0.0, between(standoff, top, minimum_jerk(t / APPROACH)));
                }
                (0.0, between(top, -depth, raised_cosine((t - APPROACH) * TAP_RATE)))
            }
            Pattern::Tremor => {
                // The tremor grows during the first held second, so that the path has no jump in velocity.
                let amplitude = TREMOR_AMPLITUDE * minimum_jerk(t - 1.0);
                let phase = std::f64::consts::TAU * TREMOR_RATE * t;
                (amplitude * phase.sin(), pressed(minimum_jerk(t)) + amplitude * phase.cos())
            }
        }
    }
}

/// From 0 at s ≤ 0 to 1 at s ≥ 1 with the least jerk: at rest and unaccelerated at both ends.
fn minimum_jerk(s: f64) -> f64 {
    let s = s.clamp(0.0, 1.0);
    s * s * s * (10.0 + s * (6.0 * s - 15.0))
}

/// From 0 to 1 and back to 0 once per unit of `s`.
fn raised_cosine(s: f64) -> f64 {
    0.5 * (1.0 - (std::f64::consts::TAU * s).cos())
}

fn between(from: f64, to: f64, share: f64) -> f64 {
    from + (to - from) * share
}

#[cfg(test)]
mod tests {
    use super::*;

    fn path(pattern: Pattern) -> Path {
        let site = Site {
            point: Vec3::new(0.1, 0.2, 0.3),
            normal: Vec3::z(),
            tangent: Vec3::x(),
            standoff: 0.02,
            depth: 0.008,
        };
        Path { pattern, site }
    }

    fn every_path() -> impl Iterator<Item = Path> {
        Pattern::value_variants().iter().map(|pattern| path(*pattern))
    }

    fn height(path: &Path, t: f64) -> f64 {
        (path.target(t).position - path.site.point).dot(&path.site.normal)
    }

    #[test]
    fn paths_start_outside_and_are_continuous() {
        for path in every_path() {
            for millisecond in 0..=500 {
                let target = path.target(f64::from(millisecond) * 1e-3);
                assert!((height(&path, f64::from(millisecond) * 1e-3) - path.site.standoff).abs() < 1e-12);
                assert!(target.velocity.norm() < 1e-6);
            }
            // The fastest is the tap: 13 mm raised cosine at 4 Hz, π · 4 Hz · 13 mm = 0.163 m/s.
            for millisecond in 0..20_000 {
                let t = f64::from(millisecond) * 1e-3;
                let step = path.target(t + 1e-3).position - path.target(t).position;
                assert!(step.norm() < 0.2e-3, "{:?} at {t} s", path.pattern);
            }
        }
    }

    #[test]
    fn velocity_is_the_derivative_of_position() {
        for path in every_path() {
            for millisecond in 0..20_000 {
                let t = f64::from(millisecond) * 1e-3;
                let (now, next) = (path.target(t), path.target(t + 1e-3));
                let mean = 0.5 * (now.velocity + next.velocity);
                assert!((now.position + mean * 1e-3 - next.position).norm() < 2e-6, "{:?} at {t} s", path.pattern);
            }
        }
    }

    #[test]
    fn every_path_reaches_its_depth_and_goes_no_deeper_than_a_tremor() {
        for path in every_path() {
            let lowest = (0..20_000).map(|ms| height(&path, f64::from(ms) * 1e-3)).fold(f64::INFINITY, f64::min);
            let below = -path.site.depth - lowest;
            let allowed = if path.pattern == Pattern::Tremor { TREMOR_AMPLITUDE } else { 0.0 };
            assert!(below > -1e-6 && below < allowed + 1e-9, "{:?} reaches {lowest} m", path.pattern);
        }
    }

    #[test]
    fn a_press_holds_its_depth_for_a_second() {
        let path = path(Pattern::Press);
        assert!((height(&path, 1.5) + 0.008).abs() < 1e-12 && (height(&path, 2.5) + 0.008).abs() < 1e-12);
        assert!((height(&path, 3.6) - 0.02).abs() < 1e-12 && (height(&path, 4.0) - 0.02).abs() < 1e-12);
    }

    #[test]
    fn only_a_turning_hand_turns_and_holds_a_button_while_it_is_in() {
        for path in every_path() {
            let (mut most, mut before) = (0.0f64, path.target(0.0).orientation);
            for millisecond in 0..8000 {
                let target = path.target(f64::from(millisecond) * 1e-3);
                most = most.max(target.orientation.angle());
                // Evenly: no more than it turns in a millisecond.
                assert!(before.angle_to(&target.orientation) < 0.02);
                before = target.orientation;
                let is_in = (height(&path, f64::from(millisecond) * 1e-3) + path.site.depth).abs() < 1e-9;
                assert!(target.buttons == 0 || is_in);
                assert!(target.angular_velocity.norm() < 20.0);
            }
            let turns = path.pattern == Pattern::Turn;
            assert!(if turns { (0.6..0.7).contains(&most) } else { most == 0.0 }, "{:?}: {most} rad", path.pattern);
            assert_eq!(path.target(SETTLE + 1.5).buttons, u32::from(turns));
        }
    }

    #[test]
    fn a_palpation_moves_sideways_only_outside() {
        let path = path(Pattern::Palpate);
        for millisecond in 0..20_000 {
            let t = f64::from(millisecond) * 1e-3;
            let sideways = path.target(t).velocity.dot(&path.site.tangent).abs();
            assert!(sideways < 1e-6 || height(&path, t) > 0.9 * CLEARANCE);
        }
    }

    #[test]
    fn the_same_time_gives_the_same_target() {
        for path in every_path() {
            assert_eq!(path.target(1.234_567), path.target(1.234_567));
        }
    }

    #[test]
    fn a_pattern_is_found_by_its_name_in_whatever_case() {
        for pattern in Pattern::value_variants() {
            assert_eq!(Pattern::from_str(&pattern.name().to_uppercase(), true), Ok(*pattern));
        }
        assert_eq!(Pattern::Palpate.name(), "palpate");
        assert!(Pattern::from_str("poke", true).is_err());
    }
}
