//! Obstacles: rigid things of the scene that the body meets, and that no hand moves.

use super::jaws::Stance;
use super::outside::is_inside;
use super::posed::{Posed, posed};
use super::shape::Shape;
use super::tool::{Coupling, Phase, ToolState};
use crate::math::{Pose, Real, Vec3};
use crate::model::body::patches::MOST_PATCHES;
use crate::model::constraint::PointMemory;
use crate::model::{Body, Periodic};

pub use crate::model::constraint::{MOST_OBSTACLES, MOST_POINTS};

/// An obstacle as the scene gives it.
#[derive(Clone, Debug, PartialEq)]
pub struct Obstacle {
    /// Its name, for people.
    pub name: String,
    /// Its shape.
    pub shape: Form,
    /// Coulomb's coefficient of friction μ on the body.
    pub friction: Real,
    /// Where it begins.
    pub pose: Pose,
    /// How it moves from there; `None` for an obstacle that stays.
    pub motion: Option<Periodic>,
}

/// Shape of an obstacle.
#[derive(Clone, Debug, PartialEq)]
pub enum Form {
    /// All that is below the plane through the reference point across the obstacle's own +z.
    Ground,
    /// Convex parts, as a tool has.
    Parts(Shape),
}

impl Obstacle {
    /// Where it is, as a tool that nobody holds and nothing pushes away, after so many ticks of its motion; `points` are those of the last
    /// tick.
    pub fn state_at(&self, tick: u64, points: &[PointMemory]) -> ToolState {
        let at = |tick: u64| {
            let moved = self.motion.map_or(Vec3::zeros(), |motion| motion.at(tick));
            Pose { position: self.pose.position + moved, ..self.pose }
        };
        let push = |m: &PointMemory| m.normal * m.multiplier + m.tangential;
        ToolState {
            phase: Phase::Engaged,
            pose: at(tick),
            previous: at(tick.saturating_sub(1)),
            coupling: Coupling::RIGID,
            physical_force: -points.iter().map(push).sum::<Vec3>(),
            ..ToolState::default()
        }
    }

    /// Most points at which it can touch `body` at once.
    pub fn most_points(&self, body: &Body) -> usize {
        match self.shape {
            Form::Ground => (body.patches().count() as usize).min(MOST_PATCHES),
            Form::Parts(_) => MOST_POINTS,
        }
    }
}

/// How deep `obstacle`, where it begins, is in `body` at rest at most [m], and where [m]; below zero: how far away.
pub fn deepest_overlap(body: &Body, obstacle: &Obstacle) -> (Real, Vec3) {
    let (pose, vertices) = (obstacle.pose, &body.surface().vertices);
    let shape = match &obstacle.shape {
        Form::Ground => {
            let normal = pose.rotate(Vec3::z());
            let depths = vertices.iter().map(|p| (normal.dot(&(pose.position - p)), *p));
            return deepest(depths);
        }
        Form::Parts(shape) => shape,
    };
    let (all, parts) = posed(&Stance::at(pose), shape);
    let of_part = |at: &Posed| {
        let depth = |p: &Vec3| {
            let away = p - at.frame.at(at.nearest(*p));
            // Inside of a solid core: as deep as the way out from its middle.
            let out = at.exit(*p, (p - at.middle()).try_normalize(0.0).unwrap_or(Vec3::z()));
            let inside = out.filter(|_| away == Vec3::zeros()).map_or(0.0, |(_, way)| way);
            (inside + at.part.radius() - away.norm(), *p)
        };
        let middle = at.middle();
        let swallowed = is_inside(body, |v| vertices[v.index()], middle).then(|| (at.part.half_thickness(), middle));
        deepest(vertices.iter().map(depth).chain(swallowed))
    };
    deepest(all[..parts].iter().map(of_part))
}

fn deepest(all: impl Iterator<Item = (Real, Vec3)>) -> (Real, Vec3) {
    all.fold((Real::NEG_INFINITY, Vec3::zeros()), |most, one| if one.0 > most.0 { one } else { most })
}
