//! Prescribed periodic motion, as breathing or a heartbeat makes it.

use super::body::Body;
use crate::ids::OrganId;
use crate::math::{Bounds, Pose, Real, Vec3};

/// A displacement that comes and goes once a period: it rises, stays, falls and is zero for what is left of it. Rise and fall
/// are those of least jerk, `u³ (10 − 15 u + 6 u²)` [Flash & Hogan 1985]: velocity and acceleration have no steps.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Periodic {
    /// All of the displacement [m].
    pub displacement: Vec3,
    /// Ticks of a period, at least 1.
    pub period: u32,
    /// Parts of the period in which it rises, stays and falls; together at most 1.
    pub parts: [Real; 3],
}

impl Periodic {
    /// The displacement [m] after `tick` ticks; zero at tick 0.
    pub fn at(&self, tick: u64) -> Vec3 {
        let period = u64::from(self.period.max(1));
        let phase = (tick % period) as Real / period as Real;
        let [rise, stay, fall] = self.parts;
        let smooth = |u: Real| u * u * u * (10.0 - u * (15.0 - 6.0 * u));
        let part = if phase < rise {
            smooth(phase / rise)
        } else if phase < rise + stay {
            1.0
        } else if phase < rise + stay + fall {
            1.0 - smooth((phase - rise - stay) / fall)
        } else {
            0.0
        };
        self.displacement * part
    }
}

/// Supports that move together, each as far as the others.
#[derive(Clone, Debug, PartialEq)]
pub struct SupportMotion {
    /// Of this organ, ...
    pub organ: OrganId,
    /// ... whose own frame this is, ...
    pub frame: Pose,
    /// ... the supports of surface points that are in this region of the frame at rest [m].
    pub region: Bounds,
    /// Corners of the region are fractions of the organ's box in its frame instead of metres.
    pub relative: bool,
    /// How they move, in the frame of the world.
    pub motion: Periodic,
}

impl SupportMotion {
    /// Numbers of its supports among [`Body::supports`].
    pub fn supports(&self, body: &Body) -> Vec<u32> {
        let Some(organ) = body.organs().get(self.organ.index()) else { return Vec::new() };
        let place = |v: usize| self.frame.to_own(body.surface().vertices[v]);
        let own = Bounds::of(organ.vertices.clone().map(place));
        let corner = |at: Vec3| if self.relative { own.low + own.size().component_mul(&at) } else { at };
        // A hair of tolerance, so that a face of the region that coincides with one of the body has it.
        let slack = 1e-9 + 1e-6 * own.size().norm();
        let region = Bounds::new(corner(self.region.low), corner(self.region.high)).grown(slack);
        let all = (0..).zip(body.supports());
        let own = all.filter(|(_, support)| organ.vertices.contains(&support.vertex.index()));
        own.filter(|(_, support)| region.contains(&place(support.vertex.index()))).map(|(h, _)| h).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_breath_returns_to_where_it_began_without_a_jump_of_place_or_speed() {
        let breath = Periodic { displacement: Vec3::z() * 0.01, period: 4000, parts: [0.3, 0.1, 0.4] };
        let height = |tick: u64| breath.at(tick).z;
        assert_eq!((height(0), height(1400), height(3999), height(8000)), (0.0, 0.01, 0.0, 0.0));
        let speed = |tick: u64| height(tick + 1) - height(tick);
        // At most 15/8 of the mean speed, and 10/√3 times the mean acceleration.
        assert!((0..9000).all(|tick| speed(tick).abs() < 1.88 * 0.01 / 1200.0));
        assert!((0..9000).all(|tick| (speed(tick + 1) - speed(tick)).abs() < 5.8 * 0.01 / (1200.0 * 1200.0)));
    }
}
