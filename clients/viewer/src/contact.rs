//! Tools on the organ: where they are, and where they touch.

use crate::tool_shape::ToolShape;
use palpate_sdk::proto::{ToolPhase, ToolState};
use std::sync::Arc;
use three_d::{InnerSpace, Quat, Rotation, Vec3};

/// A tool where it is now. Its own +z runs from the reference point along the shaft.
#[derive(Clone, Debug, PartialEq)]
pub struct PlacedTool {
    /// Number of the tool whose shape it has.
    pub shape_of: usize,
    /// What it looks like.
    pub shape: Arc<ToolShape>,
    /// Its reference point [m].
    pub position: Vec3,
    /// How it is turned.
    pub orientation: Quat,
    /// How far its jaws are open: 0 to 1.
    pub opening: f32,
    /// Rendered force on it [N].
    pub force: Vec3,
    /// Whether somebody holds it.
    pub held: bool,
}

impl PlacedTool {
    /// The one of the tools of these `shapes` that `state` moves; `None` where the state is not whole or not finite.
    pub fn new(state: &ToolState, shapes: &[Arc<ToolShape>]) -> Option<Self> {
        let shape_of = state.shape_of() as usize;
        let shape = shapes.get(shape_of)?.clone();
        let finite = |numbers: &[f32]| numbers.iter().all(|number| number.is_finite());
        let position: [f32; 3] = state.position[..].try_into().ok().filter(|p: &[f32; 3]| finite(p))?;
        let [x, y, z, w]: [f32; 4] = state.orientation[..].try_into().ok().filter(|q: &[f32; 4]| finite(q))?;
        let force: [f32; 3] = state.force[..].try_into().ok().filter(|f: &[f32; 3]| finite(f))?;
        Some(Self {
            shape_of,
            shape,
            position: position.into(),
            orientation: Quat::new(w, x, y, z),
            opening: Some(state.opening).filter(|opening| (0.0..=1.0).contains(opening)).unwrap_or_default(),
            force: force.into(),
            held: state.phase() != ToolPhase::Detached,
        })
    }

    /// (vertices) how much of each touches the tool, 0 to 1: everything closer than a tenth of its radius, but no
    /// more than `edge` [m], the distance between vertices, fading out within that. Nothing where the tool feels nothing.
    pub fn add_touch(&self, positions: &[[f32; 3]], edge: f32, touch: &mut [f32]) {
        if self.force.magnitude() < 1e-4 {
            return;
        }
        let (back, near) = (self.orientation.conjugate(), (0.1 * self.shape.radius).min(edge));
        let reach = self.shape.reach() + near + edge;
        for (touch, &position) in touch.iter_mut().zip(positions) {
            let away = Vec3::from(position) - self.position;
            if away.magnitude2() < reach * reach {
                let distance = self.shape.distance(back.rotate_vector(away), self.opening);
                *touch = touch.max(1.0 - ((distance - near) / edge).clamp(0.0, 1.0));
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use palpate_sdk::ToolDescription;
    use palpate_sdk::proto::ToolPart;
    use three_d::vec3;

    /// A tool of radius 10 mm: everything within `rounding` of `corners`, or of a disc between them.
    fn shape(corners: &[f64], rounding: f64) -> Arc<ToolShape> {
        let disc = if rounding < 0.01 { 0.01 - rounding } else { 0.0 };
        let part = ToolPart { corners: corners.into(), rounding, disc, axis: vec![0.0, 0.0, 1.0], hinge: None };
        ToolShape::new(&ToolDescription { radius: 0.01, parts: vec![part], ..Default::default() }).into()
    }

    fn tool(shape: &Arc<ToolShape>, orientation: [f32; 4]) -> PlacedTool {
        let state = ToolState {
            tool: 1,
            position: vec![0.0, 0.0, 1.0],
            orientation: orientation.into(),
            force: vec![0.0, 0.0, 0.5],
            phase: ToolPhase::Engaged.into(),
            opening: 0.0,
            shape: 0,
        };
        PlacedTool::new(&state, &[shape.clone(), shape.clone()]).unwrap()
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
        let shaft = [0.0, 0.0, 0.0, 0.0, 0.0, 0.1];
        let (ball, capsule, cylinder) = (shape(&[0.0; 3], 0.01), shape(&shaft, 0.01), shape(&shaft, 1e-4));
        for (shape, orientation, on, off) in [
            (&ball, UPRIGHT, [0.0, 0.01, 1.0], [0.0, 0.0, 1.05]),
            (&capsule, UPRIGHT, [0.01, 0.0, 1.05], [0.05, 0.0, 1.0]),
            (&capsule, lying, [0.05, 0.01, 1.0], [0.0, 0.0, 1.05]),
            (&cylinder, lying, [0.0, 0.005, 1.0], [-0.01, 0.0, 1.0]),
        ] {
            let tool = tool(shape, orientation);
            assert!(touch(&tool, on) > 0.99, "{on:?}: {}", touch(&tool, on));
            assert!(touch(&tool, off) < 0.01, "{off:?}: {}", touch(&tool, off));
        }
        let free = PlacedTool { force: vec3(0.0, 0.0, 0.0), ..tool(&ball, UPRIGHT) };
        assert_eq!(touch(&free, [0.0, 0.01, 1.0]), 0.0);
    }

    #[test]
    fn a_tool_without_a_whole_state_is_not_drawn() {
        let shapes = [shape(&[0.0; 3], 0.01), shape(&[0.0; 3], 0.01)];
        let whole = ToolState {
            tool: 1,
            position: vec![0.0; 3],
            orientation: vec![0.0, 0.0, 0.0, 1.0],
            force: vec![0.0; 3],
            ..Default::default()
        };
        assert_eq!(PlacedTool::new(&whole, &shapes).unwrap().shape_of, 1);
        assert_eq!(PlacedTool::new(&ToolState { shape: 1, ..whole.clone() }, &shapes).unwrap().shape_of, 0);
        assert!(PlacedTool::new(&ToolState { shape: 3, ..whole.clone() }, &shapes).is_none());
        assert!(PlacedTool::new(&ToolState { tool: 2, ..whole.clone() }, &shapes).is_none());
        assert!(PlacedTool::new(&ToolState { position: vec![f32::NAN; 3], ..whole.clone() }, &shapes).is_none());
        assert!(PlacedTool::new(&ToolState { orientation: vec![], ..whole }, &shapes).is_none());
    }
}
