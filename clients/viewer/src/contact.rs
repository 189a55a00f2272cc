//! Tools on the organ: their shapes as the session describes them, and where they touch.

use palpate_sdk::ToolDescription;
use palpate_sdk::proto::{ToolPhase, ToolState};
use three_d::{InnerSpace, Quat, Rotation, Vec3, vec3};

/// A tool where it is now. Its own +z runs from the reference point along the shaft.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PlacedTool {
    /// What it looks like.
    pub shape: Shape,
    /// Its reference point [m].
    pub position: Vec3,
    /// How it is turned.
    pub orientation: Quat,
    /// Rendered force on it [N].
    pub force: Vec3,
    /// Whether somebody holds it.
    pub held: bool,
}

/// What a tool looks like, lengths in metres.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Shape {
    /// Around the reference point.
    Ball {
        /// Its radius.
        radius: f32,
    },
    /// A ball moved along +z.
    Capsule {
        /// Its radius.
        radius: f32,
        /// Of its axis.
        length: f32,
    },
    /// Along +z, with flat ends.
    Cylinder {
        /// Its radius.
        radius: f32,
        /// Of its axis.
        length: f32,
    },
    /// A shape that the session does not describe further than by the ball that holds it.
    Within {
        /// Of that ball.
        radius: f32,
    },
}

impl Shape {
    fn of(description: &ToolDescription) -> Self {
        let (radius, length) = (description.radius as f32, description.length as f32);
        match description.shape.as_str() {
            "ball" => Self::Ball { radius },
            "capsule" => Self::Capsule { radius, length },
            "cylinder" => Self::Cylinder { radius, length },
            _ => Self::Within { radius },
        }
    }

    /// Radius [m] of the part that touches, or of the ball that holds it.
    pub fn radius(self) -> f32 {
        let (Self::Ball { radius }
        | Self::Capsule { radius, .. }
        | Self::Cylinder { radius, .. }
        | Self::Within { radius }) = self;
        radius
    }

    /// Distance [m] from the shape to `point` in the tool's own frame, negative inside. `None` where the shape is not
    /// known. That of a cylinder is too small beside its rims.
    fn distance(self, point: Vec3) -> Option<f32> {
        let from_axis = |length: f32| point - vec3(0.0, 0.0, point.z.clamp(0.0, length));
        match self {
            Self::Ball { radius } => Some(point.magnitude() - radius),
            Self::Capsule { radius, length } => Some(from_axis(length).magnitude() - radius),
            Self::Cylinder { radius, length } => {
                let beside = vec3(point.x, point.y, 0.0).magnitude() - radius;
                Some(beside.max(-point.z).max(point.z - length))
            }
            Self::Within { .. } => None,
        }
    }
}

impl PlacedTool {
    /// The tool that `state` moves; `None` where the state is not whole or not finite.
    pub fn new(state: &ToolState, descriptions: &[ToolDescription]) -> Option<Self> {
        let description = descriptions.iter().find(|description| description.tool == state.tool)?;
        let finite = |numbers: &[f32]| numbers.iter().all(|number| number.is_finite());
        let position: [f32; 3] = state.position[..].try_into().ok().filter(|p: &[f32; 3]| finite(p))?;
        let [x, y, z, w]: [f32; 4] = state.orientation[..].try_into().ok().filter(|q: &[f32; 4]| finite(q))?;
        let force: [f32; 3] = state.force[..].try_into().ok().filter(|f: &[f32; 3]| finite(f))?;
        Some(Self {
            shape: Shape::of(description),
            position: position.into(),
            orientation: Quat::new(w, x, y, z),
            force: force.into(),
            held: state.phase() != ToolPhase::Detached,
        })
    }

    /// (vertices) how much of each touches the tool, 0 to 1: everything closer than a tenth of its radius, fading out
    /// within `edge` [m], the distance between vertices. Nothing where the tool feels nothing.
    pub fn add_touch(&self, positions: &[[f32; 3]], edge: f32, touch: &mut [f32]) {
        if self.force.magnitude() < 1e-4 {
            return;
        }
        let (back, near) = (self.orientation.conjugate(), 0.1 * self.shape.radius());
        for (touch, &position) in touch.iter_mut().zip(positions) {
            let local = back.rotate_vector(Vec3::from(position) - self.position);
            if let Some(distance) = self.shape.distance(local) {
                *touch = touch.max(1.0 - ((distance - near) / edge).clamp(0.0, 1.0));
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn tool(shape: &str, orientation: [f32; 4]) -> PlacedTool {
        let description =
            ToolDescription { tool: 1, shape: shape.into(), radius: 0.01, length: 0.1, ..Default::default() };
        let state = ToolState {
            tool: 1,
            position: vec![0.0, 0.0, 1.0],
            orientation: orientation.into(),
            force: vec![0.0, 0.0, 0.5],
            phase: ToolPhase::Engaged.into(),
        };
        PlacedTool::new(&state, &[description]).unwrap()
    }

    fn touch(tool: &PlacedTool, at: [f32; 3]) -> f32 {
        let mut touch = [0.0];
        tool.add_touch(&[at], 0.004, &mut touch);
        touch[0]
    }

    #[test]
    fn what_a_tool_touches_is_beside_its_shape_however_it_is_turned() {
        const UPRIGHT: [f32; 4] = [0.0, 0.0, 0.0, 1.0];
        // A quarter turn about +y lays the shaft along +x.
        let lying = [0.0, std::f32::consts::FRAC_1_SQRT_2, 0.0, std::f32::consts::FRAC_1_SQRT_2];
        for (shape, orientation, on, off) in [
            ("ball", UPRIGHT, [0.0, 0.01, 1.0], [0.0, 0.0, 1.05]),
            ("capsule", UPRIGHT, [0.01, 0.0, 1.05], [0.05, 0.0, 1.0]),
            ("capsule", lying, [0.05, 0.01, 1.0], [0.0, 0.0, 1.05]),
            ("cylinder", lying, [0.0, 0.005, 1.0], [-0.01, 0.0, 1.0]),
        ] {
            let tool = tool(shape, orientation);
            assert!(touch(&tool, on) > 0.99, "{shape} {on:?}: {}", touch(&tool, on));
            assert!(touch(&tool, off) < 0.01, "{shape} {off:?}: {}", touch(&tool, off));
        }
        let free = PlacedTool { force: vec3(0.0, 0.0, 0.0), ..tool("ball", UPRIGHT) };
        assert_eq!(touch(&free, [0.0, 0.01, 1.0]), 0.0);
        assert_eq!(touch(&tool("compound", UPRIGHT), [0.0, 0.01, 1.0]), 0.0);
    }

    #[test]
    fn a_tool_without_a_whole_state_is_not_drawn() {
        let descriptions = [ToolDescription { tool: 1, ..Default::default() }];
        let whole = ToolState {
            tool: 1,
            position: vec![0.0; 3],
            orientation: vec![0.0, 0.0, 0.0, 1.0],
            force: vec![0.0; 3],
            ..Default::default()
        };
        assert!(PlacedTool::new(&whole, &descriptions).is_some());
        assert!(PlacedTool::new(&ToolState { tool: 2, ..whole.clone() }, &descriptions).is_none());
        assert!(PlacedTool::new(&ToolState { position: vec![f32::NAN; 3], ..whole.clone() }, &descriptions).is_none());
        assert!(PlacedTool::new(&ToolState { orientation: vec![], ..whole }, &descriptions).is_none());
    }
}
