//! A body of the core with one tool, as the studies run it: a hand without limits, and the shipped stepping, contact and
//! adaptation.

use super::levels::Levels;
use palpate_body::geometry::LabelledMesh;
use palpate_body::prepare::{Recipe, Region, Shape as Source, prepare};
use palpate_core::adaptation::Adaptivity;
use palpate_core::contact::safety::ForceLimits;
use palpate_core::contact::tool::{Coupling, Following, PoseSample, Shape, Tool, ToolEvent};
use palpate_core::ids::Node;
use palpate_core::math::{Bounds, Pose, Real, Vec3};
use palpate_core::model::active_set::{ActiveSet, Change};
use palpate_core::model::{Body, State};
use palpate_core::simulation::{Inputs, Settings, Simulation, Snapshot};
use std::io::{Error, Result};
use std::sync::Arc;

/// What a body is tried with.
#[derive(Clone, Debug)]
pub struct Trial {
    /// What is held.
    pub shape: Shape,
    /// Field [m/s²].
    pub gravity: Vec3,
    /// When to refine and coarsen; `None` keeps the active nodes.
    pub adaptivity: Option<Adaptivity>,
}

impl Trial {
    /// A ball of `radius` [m], no gravity.
    pub fn ball(radius: Real, adaptivity: Option<Adaptivity>) -> Self {
        Self { shape: Shape::ball(radius), gravity: Vec3::zeros(), adaptivity }
    }

    /// In the field `gravity` [m/s²], without a tool that matters, on fixed active nodes.
    pub fn hanging(gravity: Vec3) -> Self {
        Self { gravity, ..Self::ball(0.01, None) }
    }

    /// `body` at rest on one level, the ball not yet held.
    ///
    /// # Errors
    /// When the level does not fit the body.
    pub fn on_level(&self, body: &Arc<Body>, level: usize) -> Result<Simulation> {
        self.on(body, State::at_rest(body, level))
    }

    /// `body` at rest on the active `nodes`.
    ///
    /// # Errors
    /// When these do not cover the body once.
    pub fn on_nodes(&self, body: &Arc<Body>, nodes: Vec<Node>) -> Result<Simulation> {
        let state =
            State::at_rest_on(body, nodes).ok_or_else(|| Error::other("the nodes do not cover the body once"))?;
        self.on(body, state)
    }

    fn on(&self, body: &Arc<Body>, state: State) -> Result<Simulation> {
        let settings = Settings {
            gravity: self.gravity,
            tools: vec![Tool { name: "tool".into(), shape: self.shape.clone(), friction: 0.0, pivot: None }],
            obstacles: vec![],
            organ_friction: Default::default(),
            support_motions: vec![],
            following: Following { speed: 1.0, engage_ticks: 1 },
            limits: ForceLimits { force: 1e6, torque: 1e6, slew: 1e9 },
            adaptivity: self.adaptivity.clone(),
            most_elements: 4_000_000,
        };
        Simulation::new(body.clone(), settings, Snapshot::with_state(state, 1)).map_err(Error::other)
    }
}

/// The ball is taken in hand.
pub fn attached() -> Inputs {
    with(ToolEvent::Attach { epoch: 1, period_ticks: 1, coupling: Coupling::RIGID })
}

/// The ball is let go.
pub fn detached() -> Inputs {
    with(ToolEvent::Detach)
}

/// The ball is held with its centre at `position` [m]; `sequence` counts up.
pub fn held_at(sequence: u32, position: Vec3) -> Inputs {
    posed(sequence, Pose { position, ..Pose::default() })
}

/// The tool is held at `pose`; `sequence` counts up.
pub fn posed(sequence: u32, pose: Pose) -> Inputs {
    with(ToolEvent::Pose(PoseSample { sequence, time_ns: 0, pose, buttons: 0, opening: 0.0 }))
}

fn with(event: ToolEvent) -> Inputs {
    let mut inputs = Inputs::default();
    inputs.tools[0] = Some(event);
    inputs
}

/// The meshes of `levels` as a body of the core, calibrated, of the same material, its nodes at x = 0 fixed where `levels`
/// has them fixed; node `i` of the one is node `i` of the other.
///
/// # Errors
/// When it cannot be prepared.
pub fn body_of(levels: &Levels, damping_ratio: Real, display_vertices: usize) -> Result<Arc<Body>> {
    let meshes = levels.tied.iter().map(|level| LabelledMesh::from(level.mesh.clone())).collect();
    let size = Bounds::of(levels.rest.iter().copied()).high;
    let face = Bounds::new(Vec3::zeros(), Vec3::new(0.0, size.y, size.z));
    let recipe = Recipe {
        name: "box".into(),
        shape: Source::Meshes { meshes, display_vertices },
        material: levels.material,
        inclusions: vec![],
        holds: if levels.fixed.contains(&true) {
            vec![Region { bounds: face, stiffness: None, exact: true }]
        } else {
            vec![]
        },
        elements: Default::default(),
        damping_ratio,
    };
    Ok(Arc::new(prepare(&recipe, &mut |_, _, _| {}).map_err(Error::other)?))
}

/// Active nodes of `body` (see [`body_of`]) that are at least as fine as those of the set `active` of `levels`, and split
/// further only where neighbouring regions would else be more than one level apart, as the core keeps them.
pub fn balanced(body: &Body, levels: &Levels, active: &[bool]) -> Vec<Node> {
    let mut set = ActiveSet::uniform(body, 0);
    for n in body.nodes().filter(|n| levels.is_refined(active, n.index())) {
        while set.is_active(n) {
            let mut first = n;
            while let Some(before) = set.first_needed(body, first) {
                first = before;
            }
            set.apply(body, Change::Split(first));
        }
    }
    body.nodes().filter(|n| set.is_active(*n)).collect()
}
