//! Rigid things that no hand moves: what they look like, and where they are.

use crate::tool_shape::Skin;
use palpate_sdk::proto;
use three_d::{InnerSpace, Quat, Rotation, Vec3, vec3};

/// An obstacle where it begins. It does not turn.
#[derive(Clone, Debug, PartialEq)]
pub struct Obstacle {
    /// What it looks like.
    pub form: Form,
    /// Its reference point [m].
    pub position: Vec3,
    /// How it is turned.
    pub orientation: Quat,
}

/// Shape of an obstacle, in its own frame.
#[derive(Clone, Debug, PartialEq)]
pub enum Form {
    /// All that is below the plane z = 0; what is shown of it is around `middle` [m].
    Ground {
        /// Of the plane.
        middle: Vec3,
    },
    /// The skins of its parts.
    Parts(Vec<Skin>),
}

impl Obstacle {
    /// As `description` has it, beside a body with its middle at `centre` [m]; `None` where it makes no sense.
    pub fn new(description: &proto::Obstacle, centre: Vec3) -> Option<Self> {
        let position = place(&description.position)?;
        let [x, y, z, w]: [f64; 4] = description.orientation[..].try_into().ok()?;
        let orientation = Quat::new(w as f32, x as f32, y as f32, z as f32);
        let is_turn = (orientation.magnitude2() - 1.0).abs() < 1e-3;
        let form = if description.parts.is_empty() {
            let middle = orientation.conjugate().rotate_vector(centre - position);
            Form::Ground { middle: vec3(middle.x, middle.y, 0.0) }
        } else {
            Form::Parts(Skin::all(&description.parts))
        };
        is_turn.then_some(Self { form, position, orientation })
    }

    /// Where `state` has its reference point [m]; where it begins, if that says nothing.
    pub fn position(&self, state: Option<&proto::ObstacleState>) -> Vec3 {
        let told = |state: &proto::ObstacleState| {
            let at: [f32; 3] = state.position[..].try_into().ok()?;
            Some(Vec3::from(at)).filter(|at| at.magnitude2().is_finite())
        };
        state.and_then(told).unwrap_or(self.position)
    }
}

fn place(at: &[f64]) -> Option<Vec3> {
    let [x, y, z]: [f64; 3] = at.try_into().ok()?;
    Some(vec3(x as f32, y as f32, z as f32)).filter(|at| at.magnitude2().is_finite())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn described(parts: Vec<proto::ToolPart>, orientation: [f64; 4]) -> proto::Obstacle {
        let position = vec![0.0, 0.0, 0.1];
        proto::Obstacle { name: "table".into(), parts, position, orientation: orientation.into() }
    }

    #[test]
    fn the_ground_is_shown_below_the_body_however_it_is_turned() {
        let centre = vec3(0.3, 0.2, 0.5);
        let ground = |turn| match Obstacle::new(&described(vec![], turn), centre).unwrap().form {
            Form::Ground { middle } => middle,
            Form::Parts(_) => panic!("the ground has no parts"),
        };
        assert!((ground([0.0, 0.0, 0.0, 1.0]) - vec3(0.3, 0.2, 0.0)).magnitude() < 1e-6);
        // A quarter turn about +y: its +z is the world's +x, its +x the world's -z.
        let half = std::f64::consts::FRAC_1_SQRT_2;
        assert!((ground([0.0, half, 0.0, half]) - vec3(-0.4, 0.2, 0.0)).magnitude() < 1e-6);
    }

    #[test]
    fn an_obstacle_is_where_the_frame_says_and_else_where_it_begins() {
        let ball = proto::ToolPart { corners: vec![0.0; 3], rounding: 0.02, ..Default::default() };
        let whole = described(vec![ball], [0.0, 0.0, 0.0, 1.0]);
        let obstacle = Obstacle::new(&whole, vec3(0.0, 0.0, 0.0)).unwrap();
        let state = |position: Vec<f32>| proto::ObstacleState { position, force: vec![] };
        assert_eq!(obstacle.position(Some(&state(vec![0.0, 0.0, 0.2]))), vec3(0.0, 0.0, 0.2));
        for unsaid in [None, Some(state(vec![])), Some(state(vec![0.0, f32::NAN, 0.0]))] {
            assert_eq!(obstacle.position(unsaid.as_ref()), vec3(0.0, 0.0, 0.1));
        }
        let senseless = [
            proto::Obstacle { position: vec![0.0; 2], ..whole.clone() },
            proto::Obstacle { position: vec![f64::NAN; 3], ..whole.clone() },
            proto::Obstacle { orientation: vec![], ..whole.clone() },
            proto::Obstacle { orientation: vec![0.0; 4], ..whole },
        ];
        assert!(senseless.iter().all(|of| Obstacle::new(of, vec3(0.0, 0.0, 0.0)).is_none()));
    }
}
