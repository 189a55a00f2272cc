//! Where pictures come from: bytes from the wire ([`Live`]) or from a file ([`Recording`]), never a server's memory.

mod live;
mod pace;
mod picture;
mod recording;

pub use live::{Link, Live, LiveView};
pub use picture::Picture;
pub use recording::{Frame, Recording};

use palpate_sdk::proto::{Obstacle, ObstacleState, ToolState};
use palpate_sdk::{SdkError, Session, Surface, ToolDescription};
use std::path::PathBuf;
use std::sync::Arc;

/// Length of a tick [s].
pub const TICK: f64 = 1e-3;
/// What is looked at: all that stays as it is while frames come.
#[derive(Clone, Debug)]
pub struct Subject {
    /// The body's name.
    pub name: String,
    /// Its surface at rest.
    pub surface: Arc<Surface>,
    /// Pictures that its materials name.
    pub pictures: Vec<Picture>,
    /// How many levels of resolution it has.
    pub levels: usize,
    /// Its tools; their place in the list is their number.
    pub tools: Vec<ToolDescription>,
    /// Rigid things that no hand moves.
    pub obstacles: Vec<Obstacle>,
    /// The largest force that a tool renders [N].
    pub force_limit: f32,
    /// What simulates or has simulated it, for people.
    pub made_by: String,
}

/// The surface and the tools at one tick.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Moment {
    /// Simulated time [ms].
    pub tick: u64,
    /// (vertices) [m].
    pub positions: Vec<[f32; 3]>,
    /// (vertices) the level of resolution that each vertex shows, coarsest 0; empty where the source does not say.
    pub levels: Vec<u8>,
    /// What every tool does.
    pub tools: Vec<ToolState>,
    /// Where the obstacles are; those that it does not say are where they begin.
    pub obstacles: Vec<ObstacleState>,
}

/// Why there is nothing to see.
#[derive(Debug, thiserror::Error)]
pub enum SourceError {
    /// The file system said no.
    #[error("{}: {source}", path.display())]
    Io {
        /// The recording.
        path: PathBuf,
        /// Why.
        source: std::io::Error,
    },
    /// Not a recording, or one without anything to see.
    #[error("{}: {what}", path.display())]
    Content {
        /// The recording.
        path: PathBuf,
        /// What is wrong, and what to do.
        what: String,
    },
    /// The server, or what it sends.
    #[error(transparent)]
    Sdk(#[from] SdkError),
}

impl Subject {
    /// What `session` describes, with its surface and the pictures on it. Errors: a picture that is none.
    fn new(
        session: Session,
        surface: Arc<Surface>,
        pictures: &[palpate_sdk::Picture],
        made_by: String,
    ) -> Result<Self, SourceError> {
        let body = session.body.unwrap_or_default();
        let pictures = pictures.iter().map(Picture::decode).collect::<Result<_, _>>()?;
        Ok(Self {
            name: body.name,
            surface,
            pictures,
            levels: body.levels as usize,
            tools: session.tools,
            obstacles: session.obstacles,
            force_limit: session.limits.unwrap_or_default().force as f32,
            made_by,
        })
    }
}

impl From<palpate_sdk::Moment> for Moment {
    fn from(decoded: palpate_sdk::Moment) -> Self {
        let palpate_sdk::Moment { tick, positions, levels, tools, obstacles, .. } = decoded;
        Self { tick, positions, levels, tools, obstacles }
    }
}

impl Moment {
    /// The body at rest, before any frame.
    pub fn at_rest(surface: &Surface) -> Self {
        Self { positions: surface.rest_positions.clone(), ..Self::default() }
    }

    /// What lies between `self` and the later `next`: `t` from 0 to 1. Positions, forces and poses go straight from one
    /// to the other; what is no number is that of the nearer one.
    pub fn towards(&self, next: &Moment, t: f32) -> Moment {
        let nearer = if t < 0.5 { self } else { next };
        if self.positions.len() != next.positions.len() {
            return nearer.clone();
        }
        let mix = |a: f32, b: f32| a + t * (b - a);
        let positions = self.positions.iter().zip(&next.positions);
        let positions = positions.map(|(a, b)| [mix(a[0], b[0]), mix(a[1], b[1]), mix(a[2], b[2])]).collect();
        let mix_all = |a: &[f32], b: &[f32]| a.iter().zip(b).map(|(a, b)| mix(*a, *b)).collect();
        // A tool that is taken or let go between the two is where the nearer one has it.
        let tools = nearer.tools.iter().map(|tool| {
            let of = |moment: &Moment| moment.tools.iter().find(|other| other.tool == tool.tool).cloned();
            let (Some(a), Some(b)) = (of(self), of(next)) else { return tool.clone() };
            ToolState {
                position: mix_all(&a.position, &b.position),
                orientation: turn_towards(&a.orientation, &b.orientation, t),
                force: mix_all(&a.force, &b.force),
                ..tool.clone()
            }
        });
        let obstacles = self.obstacles.iter().zip(&next.obstacles).map(|(a, b)| ObstacleState {
            position: mix_all(&a.position, &b.position),
            force: mix_all(&a.force, &b.force),
        });
        let tick = self.tick + (t * next.tick.saturating_sub(self.tick) as f32).round() as u64;
        Moment {
            tick,
            positions,
            levels: nearer.levels.clone(),
            tools: tools.collect(),
            obstacles: obstacles.collect(),
        }
    }
}

/// The shorter way from one unit quaternion to another, at even parts of the chord: frames are close together.
fn turn_towards(a: &[f32], b: &[f32], t: f32) -> Vec<f32> {
    let sign = a.iter().zip(b).map(|(a, b)| a * b).sum::<f32>().signum();
    let mixed: Vec<f32> = a.iter().zip(b).map(|(a, b)| a + t * (sign * b - a)).collect();
    let norm = mixed.iter().map(|c| c * c).sum::<f32>().sqrt();
    mixed.into_iter().map(|c| c / norm).collect()
}

/// Numbers of tools that are plotted are below this: a session has no more than 8.
const MOST_TOOLS: usize = 64;

/// (tools) The force on each tool [N], by its number; 0 for one that nobody holds.
pub fn forces(tools: &[ToolState]) -> Vec<f32> {
    let mut forces = Vec::new();
    for tool in tools.iter().filter(|tool| (tool.tool as usize) < MOST_TOOLS) {
        let number = tool.tool as usize;
        forces.resize(forces.len().max(number + 1), 0.0);
        forces[number] = tool.force.iter().map(|c| c * c).sum::<f32>().sqrt();
    }
    forces
}

#[cfg(test)]
mod tests {
    use super::*;

    fn moment(tick: u64, x: f32, orientation: [f32; 4]) -> Moment {
        let tool = ToolState {
            position: vec![x; 3],
            orientation: orientation.into(),
            force: vec![0.0, 0.0, x],
            ..Default::default()
        };
        let obstacles = vec![ObstacleState { position: vec![0.0, 0.0, x], force: vec![] }];
        Moment { tick, positions: vec![[x; 3]; 2], levels: vec![tick as u8; 2], tools: vec![tool], obstacles }
    }

    #[test]
    fn between_two_frames_everything_is_between_them() {
        let half = std::f32::consts::FRAC_1_SQRT_2;
        let (a, b) = (moment(32, 0.0, [0.0, 0.0, 0.0, 1.0]), moment(64, 1.0, [0.0, 0.0, -half, -half]));
        let quarter = a.towards(&b, 0.25);
        assert_eq!((quarter.tick, quarter.positions[1], quarter.levels[0]), (40, [0.25; 3], 32));
        assert_eq!(forces(&quarter.tools), [0.25]);
        assert_eq!(quarter.obstacles[0].position, [0.0, 0.0, 0.25]);
        // Two quaternions of opposite sign are neighbours: the tool does not turn the long way round.
        let turned = &quarter.tools[0].orientation;
        assert!(turned[2] > 0.1 && turned[3] > 0.9, "{turned:?}");
        assert!((turned.iter().map(|c| c * c).sum::<f32>() - 1.0).abs() < 1e-6);
        assert_eq!(a.towards(&b, 1.0).positions, b.positions);
    }

    #[test]
    fn a_tool_that_is_let_go_between_two_frames_leaves_and_the_surface_moves_on() {
        let b = moment(64, 1.0, [0.0, 0.0, 0.0, 1.0]);
        let a = Moment { tools: vec![], ..moment(32, 0.0, [0.0, 0.0, 0.0, 1.0]) };
        assert_eq!((a.towards(&b, 0.4).tools.len(), a.towards(&b, 0.6).tools.len()), (0, 1));
        assert!((a.towards(&b, 0.4).positions[0][0] - 0.4).abs() < 1e-6);
        let third = ToolState { tool: 2, force: vec![3.0, 0.0, 4.0], ..Default::default() };
        assert_eq!(forces(&[third]), [0.0, 0.0, 5.0]);
    }
}
