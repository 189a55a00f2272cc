//! The keys of a motion that a scene prescribes: of supports, as with breathing, and of obstacles.

use garde::Validate;
use palpate_core::math::{Real, Vec3};
use palpate_core::model::Periodic;
use palpate_core::simulation::TICK;
use serde::{Deserialize, Serialize};

/// `[hold.motion]` and `[obstacle.motion]`: to and fro, once a period.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, Validate)]
#[serde(deny_unknown_fields)]
#[garde(allow_unvalidated)]
pub struct MotionKeys {
    /// How far it goes [m].
    #[garde(inner(range(min = -1.0, max = 1.0)))]
    pub displacement: [Real; 3],
    /// Time until it begins again [s].
    #[garde(range(min = 0.1, max = 600.0))]
    pub period: Real,
    /// Part of the period in which it goes there.
    #[serde(default = "two_fifths")]
    #[garde(range(min = 0.01, max = 1.0))]
    pub rise: Real,
    /// Part in which it stays there.
    #[serde(default)]
    #[garde(range(min = 0.0, max = 1.0))]
    pub stay: Real,
    /// Part in which it comes back.
    #[serde(default = "two_fifths")]
    #[garde(range(min = 0.01, max = 1.0))]
    pub fall: Real,
}

fn two_fifths() -> Real {
    0.4
}

/// Fastest that a support or an obstacle may move [m/s]: as fast as a tool may.
const FASTEST: Real = 1.0;
/// Largest speed of a rise or fall of least jerk over its mean speed.
const PEAK: Real = 1.875;

impl MotionKeys {
    /// The motion.
    pub(super) fn periodic(&self) -> Periodic {
        Periodic {
            displacement: Vec3::from(self.displacement),
            period: (self.period / TICK).round() as u32,
            parts: [self.rise, self.stay, self.fall],
        }
    }

    pub(super) fn faults(&self, path: &str, out: &mut Vec<(String, String)>) {
        // Numbers that are written as decimal fractions need not sum to one exactly.
        if self.rise + self.stay + self.fall > 1.0 + 1e-9 {
            out.push((format!("{path}.stay"), "rise, stay and fall are parts of a period: at most 1 together".into()));
        }
        let fastest = PEAK * Vec3::from(self.displacement).norm() / (self.period * self.rise.min(self.fall));
        if fastest > FASTEST {
            let fault = format!("it would move by {fastest:.2} m/s, and may by {FASTEST} m/s: a longer one");
            out.push((format!("{path}.period"), fault));
        }
    }
}
