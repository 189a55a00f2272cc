//! Where the picture is taken from: around a point, +z up.

use three_d::{Camera, InnerSpace, Vec3, Viewport, degrees, vec3};

/// Angle of view from top to bottom [degrees].
const FIELD_OF_VIEW: f32 = 32.0;
/// Part of the picture's height that a body fills at first.
const FILLED: f32 = 0.72;
/// Width of a picture over its height that a body is fitted to; wider ones have more beside it.
const ASPECT: f32 = 1.3;
/// How far the camera may look up or down [rad], short of straight.
const STEEPEST: f32 = 1.5;

/// An eye that goes around a point.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Orbit {
    /// What it looks at [m].
    pub target: Vec3,
    /// About +z [rad]; 0 looks along +y.
    pub yaw: f32,
    /// Above the horizon [rad].
    pub pitch: f32,
    /// From the target [m].
    pub distance: f32,
    /// Radius [m] of the body, for what is near and far.
    size: f32,
}

/// From where a body is first looked at.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Angle {
    /// About +z [rad].
    pub yaw: f32,
    /// Above the horizon [rad].
    pub pitch: f32,
    /// How much nearer than to see the whole body.
    pub zoom: f32,
}

impl Default for Angle {
    fn default() -> Self {
        Self { yaw: -0.5, pitch: 0.5, zoom: 1.0 }
    }
}

impl Orbit {
    /// Looks at the body with vertices at `positions` [m] from `angle`, so that it fills a picture.
    pub fn around(positions: &[[f32; 3]], angle: Angle) -> Self {
        let (min, max) = bounds(positions);
        let size = (0.5 * (max - min).magnitude()).max(1e-4);
        let pitch = angle.pitch.clamp(-STEEPEST, STEEPEST);
        let mut orbit = Self { target: 0.5 * (min + max), yaw: angle.yaw, pitch, distance: 0.0, size };
        let outward = orbit.outward();
        let across = Vec3::unit_z().cross(outward).normalize();
        let up = outward.cross(across);
        let slope = FILLED * (0.5 * FIELD_OF_VIEW).to_radians().tan();
        // Every vertex within the picture's height and width asks for its distance.
        let asked = positions.iter().map(|&position| {
            let from = Vec3::from(position) - orbit.target;
            from.dot(outward) + from.dot(up).abs().max(from.dot(across).abs() / ASPECT) / slope
        });
        orbit.distance = asked.fold(size, f32::max) / angle.zoom.clamp(0.1, 10.0);
        orbit
    }

    /// From the target to the eye, unit.
    fn outward(&self) -> Vec3 {
        vec3(self.pitch.cos() * self.yaw.sin(), -self.pitch.cos() * self.yaw.cos(), self.pitch.sin())
    }

    /// The camera for a picture of `viewport` pixels.
    pub fn camera(&self, viewport: Viewport) -> Camera {
        let eye = self.target + self.distance * self.outward();
        let reach = 4.0 * self.size;
        let near = (self.distance - reach).max(0.01 * self.distance);
        Camera::new_perspective(
            viewport,
            eye,
            self.target,
            Vec3::unit_z(),
            degrees(FIELD_OF_VIEW),
            near,
            self.distance + reach,
        )
    }

    /// How much of the target's surroundings is seen from top to bottom [m].
    pub fn height(&self) -> f32 {
        2.0 * self.distance * (0.5 * FIELD_OF_VIEW).to_radians().tan()
    }

    /// Turns by a drag of the mouse, in parts of the picture's height.
    pub fn turn(&mut self, right: f32, down: f32) {
        self.yaw -= 4.0 * right;
        self.pitch = (self.pitch + 4.0 * down).clamp(-STEEPEST, STEEPEST);
    }

    /// Moves what is looked at by a drag of the mouse, in parts of the picture's height: the body stays under the pointer.
    pub fn pan(&mut self, right: f32, down: f32) {
        let outward = self.outward();
        let across = Vec3::unit_z().cross(outward).normalize();
        self.target += self.height() * (down * outward.cross(across) - right * across);
    }

    /// Goes nearer by `steps` of a wheel, or farther where they are negative.
    pub fn zoom(&mut self, steps: f32) {
        self.distance = (self.distance * 0.9f32.powf(steps)).clamp(0.05 * self.size, 30.0 * self.size);
    }
}

/// Corners of the box around `positions` [m].
pub fn bounds(positions: &[[f32; 3]]) -> (Vec3, Vec3) {
    let by = |choose: fn(f32, f32) -> f32, start: f32| {
        let corner = positions.iter().fold([start; 3], |a, b| [0, 1, 2].map(|i| choose(a[i], b[i])));
        Vec3::from(corner)
    };
    if positions.is_empty() {
        (vec3(0.0, 0.0, 0.0), vec3(0.0, 0.0, 0.0))
    } else {
        (by(f32::min, f32::MAX), by(f32::max, f32::MIN))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use three_d::Vec2;

    const CORNERS: [[f32; 3]; 8] = [
        [-0.1, -0.05, 0.0],
        [0.1, -0.05, 0.0],
        [-0.1, 0.05, 0.0],
        [0.1, 0.05, 0.0],
        [-0.1, -0.05, 0.1],
        [0.1, -0.05, 0.1],
        [-0.1, 0.05, 0.1],
        [0.1, 0.05, 0.1],
    ];

    fn orbit() -> Orbit {
        Orbit::around(&CORNERS, Angle::default())
    }

    /// Where `point` is in a picture of 800 times 600 pixels, from the left and from below.
    fn pixel(orbit: &Orbit, point: Vec3) -> Vec2 {
        orbit.camera(Viewport::new_at_origo(800, 600)).pixel_at_position(point).into()
    }

    #[test]
    fn the_whole_body_is_in_the_picture_and_fills_it_from_every_side() {
        for (yaw, pitch) in [(0.0, 0.0), (-0.5, 0.5), (1.6, 0.2), (3.0, -1.2), (0.7, 1.4)] {
            let orbit = Orbit::around(&CORNERS, Angle { yaw, pitch, zoom: 1.0 });
            let pixels: Vec<Vec2> = CORNERS.iter().map(|&corner| pixel(&orbit, corner.into())).collect();
            assert!(pixels.iter().all(|p| (0.0..800.0).contains(&p.x) && (0.0..600.0).contains(&p.y)));
            let extent = |of: fn(&Vec2) -> f32| {
                let along = pixels.iter().map(of);
                along.clone().fold(f32::MIN, f32::max) - along.fold(f32::MAX, f32::min)
            };
            let (width, height) = (extent(|p| p.x), extent(|p| p.y));
            assert!(width > 400.0 || height > 300.0, "{yaw} {pitch}: {width} x {height}");
        }
    }

    #[test]
    fn panning_keeps_the_body_under_the_pointer() {
        let mut orbit = orbit();
        let before = pixel(&orbit, orbit.target);
        let target = orbit.target;
        orbit.pan(0.25, 0.125);
        let after = pixel(&orbit, target);
        assert!((after.x - before.x - 150.0).abs() < 1.0, "{} {}", before.x, after.x);
        assert!((before.y - after.y - 75.0).abs() < 1.0, "{} {}", before.y, after.y);
    }

    #[test]
    fn turning_never_goes_over_the_pole_and_zooming_never_through_the_body() {
        let mut orbit = orbit();
        for _ in 0..100 {
            orbit.turn(0.1, 0.3);
            orbit.zoom(1.0);
        }
        assert!(orbit.pitch <= STEEPEST && orbit.distance > 0.0);
        let up = pixel(&orbit, orbit.target + vec3(0.0, 0.0, 0.001)).y;
        assert!(up > pixel(&orbit, orbit.target).y, "up is still up");
    }
}
