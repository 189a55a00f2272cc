//! The keys of an obstacle: what the body lies on or is met by, where it is, and how it moves.

use super::motion_keys::MotionKeys;
use super::tool_keys::{PartKeys, ToolKind, centimetre, unit_quaternion, upright};
use super::{LoadedScene, SceneError};
use garde::Validate;
use palpate_core::contact::obstacle::{Form, Obstacle, deepest_overlap};
use palpate_core::math::{Pose, Real, Vec3, normalized_quaternion};
use palpate_core::model::Body;
use serde::{Deserialize, Serialize};

/// `[[obstacle]]`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, Validate)]
#[serde(deny_unknown_fields)]
#[garde(allow_unvalidated)]
pub struct ObstacleKeys {
    /// For people.
    #[garde(length(min = 1, max = 32))]
    pub name: String,
    /// Its shape: a plane, or one that a tool's part may have.
    #[serde(default = "plane")]
    pub shape: ToolKind,
    /// A point of the plane, or where the shape's reference point is [m].
    #[serde(default)]
    #[garde(inner(range(min = -1e3, max = 1e3)))]
    pub position: [Real; 3],
    /// `plane`: across it, towards the body, of any length.
    #[serde(default = "up")]
    #[garde(inner(range(min = -1e3, max = 1e3)))]
    pub normal: [Real; 3],
    /// How the shape's own frame is turned: unit quaternion x, y, z, w.
    #[serde(default = "upright")]
    #[garde(custom(unit_quaternion))]
    pub orientation: [Real; 4],
    /// Radius of a ball, capsule or cylinder [m].
    #[serde(default = "centimetre")]
    #[garde(range(min = 1e-3, max = 1.0))]
    pub radius: Real,
    /// Length of a capsule's axis or of a cylinder along the shape's own +z [m].
    #[serde(default)]
    #[garde(range(min = 0.0, max = 2.0))]
    pub length: Real,
    /// Radius of the rounding of a cylinder's rims, or around a convex hull [m].
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[garde(inner(range(min = 1e-4, max = 0.1)))]
    pub rounding: Option<Real>,
    /// `convex`: points whose hull it is, in the shape's own frame [m].
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    #[garde(length(max = 1_000), inner(inner(range(min = -2.0, max = 2.0))))]
    pub points: Vec<[Real; 3]>,
    /// Coulomb's coefficient of friction on the body.
    #[serde(default = "half")]
    #[garde(range(min = 0.0, max = 2.0))]
    pub friction: Real,
    /// How it moves; left out: not at all.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[garde(dive)]
    pub motion: Option<MotionKeys>,
}

fn plane() -> ToolKind {
    ToolKind::Plane
}
fn up() -> [Real; 3] {
    [0.0, 0.0, 1.0]
}
fn half() -> Real {
    0.5
}

impl ObstacleKeys {
    /// The obstacle.
    pub fn obstacle(&self) -> Obstacle {
        let (shape, orientation) = match self.shape {
            ToolKind::Plane => (Form::Ground, from_z(&Vec3::from(self.normal))),
            _ => (Form::Parts(self.part().part().into()), normalized_quaternion(self.orientation)),
        };
        Obstacle {
            name: self.name.clone(),
            shape,
            friction: self.friction,
            pose: Pose { position: Vec3::from(self.position), orientation: orientation.unwrap_or_else(upright) },
            motion: self.motion.as_ref().map(MotionKeys::periodic),
        }
    }

    /// Its shape as that of a part of a tool.
    fn part(&self) -> PartKeys {
        PartKeys {
            shape: Some(self.shape),
            radius: self.radius,
            length: self.length,
            rounding: self.rounding,
            points: self.points.clone(),
            file: None,
            unit: None,
            position: [0.0; 3],
            orientation: upright(),
            hinge: None,
        }
    }

    /// What is wrong with it beyond single values: key behind `path`, and why.
    pub(super) fn faults(&self, path: &str, out: &mut Vec<(String, String)>) {
        let mut fault = |key: &str, message: &str| out.push((format!("{path}.{key}"), message.to_owned()));
        match self.shape {
            ToolKind::Compound => {
                fault("shape", "an obstacle is a plane, ball, capsule, cylinder or convex: give several obstacles");
            }
            ToolKind::Plane if from_z(&Vec3::from(self.normal)).is_none() => fault("normal", "give a direction"),
            ToolKind::Plane if self.orientation != upright() => fault("orientation", "a plane has a normal instead"),
            ToolKind::Plane => {}
            _ if self.normal != up() => fault("normal", "is for shape = \"plane\""),
            _ => {}
        }
        // Parts of tools may come from files.
        match self.shape {
            ToolKind::Convex if self.points.is_empty() => {
                out.push((format!("{path}.points"), "a convex obstacle needs points = [[x, y, z], …]".into()));
            }
            _ => self.part().faults(path, out),
        }
        if let Some(motion) = &self.motion {
            motion.faults(&format!("{path}.motion"), out);
        }
    }
}

impl LoadedScene {
    /// Refuses obstacles that are in `body` by more than half a spacing of what is displayed: what overlaps by less is eased
    /// apart while it settles.
    pub(super) fn check_obstacles(&self, body: &Body) -> Result<(), SceneError> {
        let areas = body.vertex_area();
        let most = 0.5 * (areas.iter().sum::<Real>() / areas.len() as Real).sqrt();
        for (index, obstacle) in self.scene.settings().obstacles.iter().enumerate() {
            let (depth, place) = deepest_overlap(body, obstacle);
            if depth > most {
                let (origin, name) = (self.origin.clone(), obstacle.name.clone());
                return Err(SceneError::Overlap { origin, index, name, depth, place, most });
            }
        }
        Ok(())
    }
}

/// The shortest turn from +z to `normal`; `None` where that is no direction.
fn from_z(normal: &Vec3) -> Option<[Real; 4]> {
    (normal.norm() >= 1e-9).then(|| Pose::default().pointed(*normal).orientation)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_plane_faces_along_its_normal() {
        for n in [[0.0, 0.0, 1.0], [0.0, 0.0, -1.0], [1.0, 0.0, 0.0], [-0.3, 0.2, -5.0], [1e-9, 0.0, -1.0]] {
            let n = Vec3::from(n);
            let pose = Pose { position: Vec3::zeros(), orientation: from_z(&n).unwrap() };
            assert!((pose.rotate(Vec3::z()) - n.normalize()).norm() < 1e-7, "{n}");
        }
        assert_eq!(from_z(&Vec3::zeros()), None);
    }
}
