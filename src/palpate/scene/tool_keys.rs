//! The keys of a tool: its shape in words, and the shape that follows from them.

use garde::Validate;
use palpate_body::geometry::mesh_io::LengthUnit;
use palpate_core::contact::jaws::Hinge;
use palpate_core::contact::tool::{Part, Shape, Tool};
use palpate_core::math::{Pose, Real, Vec3, normalized_quaternion};
use serde::{Deserialize, Serialize};
use std::path::PathBuf;

/// What a tool, or a part of one, looks like.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum ToolKind {
    /// Around the reference point.
    Ball,
    /// A ball moved along +z by the length.
    Capsule,
    /// Along +z from the reference point, with flat ends and rounded rims.
    Cylinder,
    /// The convex hull of points.
    Convex,
    /// Several of the others.
    Compound,
    /// All that is below a plane: for obstacles.
    Plane,
}

impl ToolKind {
    /// As scenes and messages write it.
    pub fn name(self) -> &'static str {
        match self {
            ToolKind::Ball => "ball",
            ToolKind::Capsule => "capsule",
            ToolKind::Cylinder => "cylinder",
            ToolKind::Convex => "convex",
            ToolKind::Compound => "compound",
            ToolKind::Plane => "plane",
        }
    }
}

/// `[[tool]]`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, Validate)]
#[serde(deny_unknown_fields)]
#[garde(allow_unvalidated)]
pub struct ToolKeys {
    /// Name that clients ask for.
    #[garde(length(min = 1, max = 32))]
    pub name: String,
    /// Its shape; left out: a ball, or a capsule where there is a length.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub shape: Option<ToolKind>,
    /// Radius [m].
    #[serde(default = "centimetre")]
    #[garde(range(min = 5e-4, max = 0.1))]
    pub radius: Real,
    /// Length of a capsule's axis or of a cylinder along the tool's own +z [m].
    #[serde(default)]
    #[garde(range(min = 0.0, max = 1.0))]
    pub length: Real,
    /// Radius of the rounding of a cylinder's rims, or around a convex hull [m]; left out: [`ROUNDING`].
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[garde(inner(range(min = 1e-4, max = 0.1)))]
    pub rounding: Option<Real>,
    /// `convex`: points whose hull it is [m].
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    #[garde(length(max = 1_000), inner(inner(range(min = -1.0, max = 1.0))))]
    pub points: Vec<[Real; 3]>,
    /// `convex`: surface file whose hull it is, relative to the scene's.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub file: Option<PathBuf>,
    /// Unit of the file's coordinates.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub unit: Option<LengthUnit>,
    /// Coulomb's coefficient of friction on the body.
    #[serde(default)]
    #[garde(range(min = 0.0, max = 2.0))]
    pub friction: Real,
    /// Where its shaft passes through the wall [m]: its own +z points there, wherever it is put; left out: it is free.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[garde(inner(inner(range(min = -1e3, max = 1e3))))]
    pub pivot: Option<[Real; 3]>,
    /// `compound`: its parts.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    #[garde(dive)]
    pub part: Vec<PartKeys>,
    /// Where parts have hinges: moment between jaws that a client closes all the way and something holds wide open [N·m].
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[garde(inner(range(min = 1e-4, max = 10.0)))]
    pub grip: Option<Real>,
}

/// `[[tool.part]]`: as a tool without parts, and where it is.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, Validate)]
#[serde(deny_unknown_fields)]
#[garde(allow_unvalidated)]
pub struct PartKeys {
    /// As [`ToolKeys::shape`].
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub shape: Option<ToolKind>,
    /// As [`ToolKeys::radius`].
    #[serde(default = "centimetre")]
    #[garde(range(min = 5e-4, max = 0.1))]
    pub radius: Real,
    /// As [`ToolKeys::length`].
    #[serde(default)]
    #[garde(range(min = 0.0, max = 1.0))]
    pub length: Real,
    /// As [`ToolKeys::rounding`].
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[garde(inner(range(min = 1e-4, max = 0.1)))]
    pub rounding: Option<Real>,
    /// As [`ToolKeys::points`].
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    #[garde(length(max = 1_000), inner(inner(range(min = -1.0, max = 1.0))))]
    pub points: Vec<[Real; 3]>,
    /// As [`ToolKeys::file`].
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub file: Option<PathBuf>,
    /// As [`ToolKeys::unit`].
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub unit: Option<LengthUnit>,
    /// Where its own reference point is in the tool's frame [m].
    #[serde(default)]
    #[garde(inner(range(min = -1.0, max = 1.0)))]
    pub position: [Real; 3],
    /// How its own frame is turned in the tool's: unit quaternion x, y, z, w.
    #[serde(default = "upright")]
    #[garde(custom(unit_quaternion))]
    pub orientation: [Real; 4],
    /// A jaw: what it turns about as a client opens it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[garde(dive)]
    pub hinge: Option<HingeKeys>,
}

/// `[tool.part.hinge]`: a part is where its position and orientation say, turned by the angle that its opening gives.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, Validate)]
#[serde(deny_unknown_fields)]
#[garde(allow_unvalidated)]
pub struct HingeKeys {
    /// In the tool's frame, of any length.
    #[garde(inner(range(min = -1e3, max = 1e3)))]
    pub axis: [Real; 3],
    /// A place of it in the tool's frame [m].
    #[serde(default)]
    #[garde(inner(range(min = -1.0, max = 1.0)))]
    pub point: [Real; 3],
    /// Angle while the jaws are closed [rad].
    #[serde(default)]
    #[garde(range(min = -MOST_ANGLE, max = MOST_ANGLE))]
    pub closed: Real,
    /// And while they are open [rad].
    #[garde(range(min = -MOST_ANGLE, max = MOST_ANGLE))]
    pub open: Real,
}

/// Farthest that a jaw is turned [rad]: half a turn, beyond which two angles are one place; with less some hinges cannot be written.
const MOST_ANGLE: Real = std::f64::consts::PI;

/// Rounding where none is given [m].
pub const ROUNDING: Real = 5e-4;

pub(super) fn centimetre() -> Real {
    0.01
}
pub(super) fn upright() -> [Real; 4] {
    Pose::default().orientation
}

pub(super) fn unit_quaternion(q: &[Real; 4], _: &()) -> garde::Result {
    let unit = (q.iter().map(|c| c * c).sum::<Real>() - 1.0).abs() < 0.02;
    if unit { Ok(()) } else { Err(garde::Error::new("not a unit quaternion x, y, z, w")) }
}

fn vectors(points: &[[Real; 3]]) -> Vec<Vec3> {
    points.iter().copied().map(Vec3::from).collect()
}

impl PartKeys {
    fn kind(&self) -> ToolKind {
        self.shape.unwrap_or(if self.length > 0.0 { ToolKind::Capsule } else { ToolKind::Ball })
    }

    fn rounding(&self) -> Real {
        self.rounding.unwrap_or(ROUNDING)
    }

    /// The hull of `points`; `None` where they are in a plane.
    fn hull(&self, points: &[Vec3]) -> Option<Part> {
        Part::convex(points, self.rounding())
    }

    pub(super) fn part(&self) -> Part {
        let part = match self.kind() {
            // Planes are obstacles.
            ToolKind::Ball | ToolKind::Compound | ToolKind::Plane => Part::capsule(self.radius, 0.0),
            ToolKind::Capsule => Part::capsule(self.radius, self.length),
            ToolKind::Cylinder => Part::cylinder(self.radius, self.length, self.rounding()),
            // Checked scenes have hulls, and load their files.
            ToolKind::Convex => {
                self.hull(&vectors(&self.points)).unwrap_or_else(|| Part::capsule(self.rounding(), 0.0))
            }
        };
        let orientation = normalized_quaternion(self.orientation).unwrap_or_else(upright);
        let part = part.at(Pose { position: Vec3::from(self.position), orientation });
        match self.hinge.and_then(|keys| Some((keys, Vec3::from(keys.axis).try_normalize(1e-9)?))) {
            None => part,
            Some((HingeKeys { point, closed, open, .. }, axis)) => {
                part.hinged(Hinge { axis, point: Vec3::from(point), closed, open })
            }
        }
    }

    /// What is wrong with it beyond single values: key behind `path`, and why.
    pub(super) fn faults(&self, path: &str, out: &mut Vec<(String, String)>) {
        let kind = self.kind();
        let mut fault = |key: &str, message: &str| out.push((format!("{path}.{key}"), message.to_owned()));
        match kind {
            ToolKind::Ball | ToolKind::Convex | ToolKind::Compound | ToolKind::Plane if self.length > 0.0 => {
                fault("length", "is for shape = \"capsule\" and \"cylinder\"");
            }
            ToolKind::Cylinder if self.length == 0.0 => fault("length", "a cylinder needs one"),
            ToolKind::Cylinder if self.rounding() > self.radius.min(0.5 * self.length) => fault(
                "rounding",
                &format!("{} m is more than the cylinder's radius or half its length", self.rounding()),
            ),
            ToolKind::Convex if self.points.is_empty() && self.file.is_none() => {
                fault("points", "a convex shape needs points = [[x, y, z], …] or file = \"….stl\"");
            }
            ToolKind::Convex if !self.points.is_empty() && self.file.is_some() => {
                fault("file", "give either points or a file");
            }
            ToolKind::Convex if self.file.is_some() && self.unit.is_none() => {
                fault("unit", "a file needs one of \"m\", \"cm\", \"mm\", \"in\"");
            }
            ToolKind::Convex if self.file.is_none() && self.hull(&vectors(&self.points)).is_none() => {
                fault("points", "a convex shape needs four points or more that do not lie in a plane");
            }
            _ => {}
        }
        if kind != ToolKind::Convex {
            let given =
                [("points", !self.points.is_empty()), ("file", self.file.is_some()), ("unit", self.unit.is_some())];
            for (key, _) in given.iter().filter(|g| g.1) {
                fault(key, "is for shape = \"convex\"");
            }
        }
        if self.rounding.is_some() && !matches!(kind, ToolKind::Cylinder | ToolKind::Convex) {
            fault("rounding", "is for shape = \"cylinder\" and \"convex\"");
        }
    }
}

impl ToolKeys {
    /// A ball.
    pub fn ball(name: &str, radius: Real) -> Self {
        Self {
            name: name.into(),
            shape: None,
            radius,
            length: 0.0,
            rounding: None,
            points: vec![],
            file: None,
            unit: None,
            friction: 0.0,
            pivot: None,
            part: vec![],
            grip: None,
        }
    }

    /// Its shape in a word.
    pub fn kind(&self) -> ToolKind {
        self.shape.unwrap_or_else(|| self.alone().kind())
    }

    /// The tool as a part of its own.
    fn alone(&self) -> PartKeys {
        PartKeys {
            shape: self.shape,
            radius: self.radius,
            length: self.length,
            rounding: self.rounding,
            points: self.points.clone(),
            file: self.file.clone(),
            unit: self.unit,
            position: [0.0; 3],
            orientation: upright(),
            hinge: None,
        }
    }

    /// Its shape.
    pub fn shape(&self) -> Shape {
        let parts = if self.kind() == ToolKind::Compound { &self.part[..] } else { &[] };
        let compound = Shape::compound(parts.iter().map(PartKeys::part).collect());
        compound.unwrap_or_else(|| self.alone().part().into()).with_grip(self.grip.unwrap_or_default())
    }

    /// The tool.
    pub fn tool(&self) -> Tool {
        Tool {
            name: self.name.clone(),
            shape: self.shape(),
            friction: self.friction,
            pivot: self.pivot.map(Vec3::from),
        }
    }

    /// What is wrong with it beyond single values: key behind `path`, and why.
    pub(super) fn faults(&self, path: &str, out: &mut Vec<(String, String)>) {
        self.alone().faults(path, out);
        let planes = std::iter::once((path.to_owned(), self.shape))
            .chain(self.part.iter().enumerate().map(|(i, part)| (format!("{path}.part[{i}]"), part.shape)));
        for (path, _) in planes.filter(|(_, shape)| *shape == Some(ToolKind::Plane)) {
            out.push((format!("{path}.shape"), "a plane is for [[obstacle]]".into()));
        }
        let most = palpate_core::contact::shape::MOST_PARTS;
        match self.kind() {
            ToolKind::Compound if !(1..=most).contains(&self.part.len()) => {
                out.push((format!("{path}.part"), format!("a compound has 1 to {most} parts, [[tool.part]]")));
            }
            ToolKind::Compound => {}
            _ if !self.part.is_empty() => {
                out.push((format!("{path}.part"), "parts are for shape = \"compound\"".into()));
            }
            _ => {}
        }
        let jaws = self.part.iter().any(|part| part.hinge.is_some());
        match self.grip {
            None if jaws => {
                out.push((format!("{path}.grip"), "jaws need one: how hard they close, in N·m, as grip = 0.05".into()));
            }
            Some(_) if !jaws => {
                out.push((format!("{path}.grip"), "is for a tool with jaws: parts with a [tool.part.hinge]".into()));
            }
            _ => {}
        }
        for (i, part) in self.part.iter().enumerate() {
            let path = format!("{path}.part[{i}]");
            if let Some(hinge) = &part.hinge {
                if Vec3::from(hinge.axis).norm() < 1e-9 {
                    out.push((format!("{path}.hinge.axis"), "has no direction".into()));
                }
                if hinge.open == hinge.closed {
                    out.push((format!("{path}.hinge.open"), "is where it is closed: it does not move".into()));
                }
            }
            if part.shape == Some(ToolKind::Compound) {
                out.push((format!("{path}.shape"), "a part is a ball, capsule, cylinder or convex".into()));
            }
            part.faults(&path, out);
        }
    }

    /// Puts the corners of the hull that `read` gives for each file in the file's place, so that the scene says all there
    /// is to say.
    pub(super) fn load_files<E>(
        &mut self,
        path: &str,
        mut read: impl FnMut(&str, &PathBuf, LengthUnit, Real) -> Result<Vec<[Real; 3]>, E>,
    ) -> Result<(), E> {
        let rounding = self.alone().rounding();
        let own = [(path.to_owned(), &mut self.file, &mut self.unit, &mut self.points, rounding)];
        let parts = self.part.iter_mut().enumerate().map(|(i, p)| {
            let rounding = p.rounding();
            (format!("{path}.part[{i}]"), &mut p.file, &mut p.unit, &mut p.points, rounding)
        });
        for (path, file, unit, points, rounding) in own.into_iter().chain(parts) {
            if let (Some(name), Some(given)) = (file.take(), unit.take()) {
                *points = read(&path, &name, given, rounding)?;
            }
        }
        Ok(())
    }
}
