//! What a simulation carries from tick to tick: how it is saved, hashed and restored.

use super::given::most_parameters;
use super::parameter::Parameter;
use super::{Settings, Simulation};
use crate::contact::tool::{MOST_POINTS, ToolState};
use crate::math::Real;
use crate::model::active_mesh::Stiffening;
use crate::model::constraint::PointMemory;
use crate::model::meeting::{MOST_MEETINGS, Meeting};
use crate::model::{Body, State};
use crate::stepping::work::Prices;
use serde::{Deserialize, Serialize};

/// Everything that changes from tick to tick.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Snapshot {
    /// Ticks since the start of the session.
    pub tick: u64,
    /// Ticks in a row until now in which the body stood still.
    pub frozen: u32,
    /// What display vertices moved by at most in the last tick, but for what moved them all alike [m]; infinite where that was not asked
    /// for, as nothing meets.
    pub moved: Real,
    /// Ticks for which supports and obstacles have followed their [motion](crate::model::Periodic) since it began: those that were
    /// simulated since the start, or the last return to it.
    pub moved_for: u64,
    /// What work costs.
    pub prices: Prices,
    /// Frames in a row that the body, which nothing touches, has been entangled in itself.
    pub entangled: u32,
    /// What has been changed since the settings, in the order in which each was first.
    pub parameters: Vec<Parameter>,
    /// How far the body has followed in stiffness; [`Stiffening::NONE`] where nothing has been changed.
    pub stiffening: Stiffening,
    /// Motion of the body.
    pub body: State,
    /// Each tool, by id.
    pub tools: Vec<ToolState>,
    /// Each tool's contact points of the last tick, at most [`MOST_POINTS`]: those of its cylinders and hulls, ascending, then those of its
    /// balls and capsules, part by part.
    pub points: Vec<Vec<PointMemory>>,
    /// Each obstacle's; empty where the body touches none.
    pub obstacle_points: Vec<Vec<PointMemory>>,
    /// Where organs meet, by patch and other organ.
    pub meetings: Vec<Meeting>,
}

impl Snapshot {
    /// The body at rest with every node of level `level` active, no tool held.
    pub fn at_rest(body: &Body, level: usize, tools: usize) -> Self {
        Self::with_state(State::at_rest(body, level), tools)
    }

    /// The body in `state`, no tool held.
    pub fn with_state(state: State, tools: usize) -> Self {
        Self {
            tick: 0,
            frozen: 0,
            moved: Real::INFINITY,
            moved_for: 0,
            prices: Prices::COMMON,
            entangled: 0,
            parameters: Vec::new(),
            stiffening: Stiffening::NONE,
            body: state,
            tools: vec![ToolState::default(); tools],
            points: (0..tools).map(|_| Vec::with_capacity(MOST_POINTS)).collect(),
            obstacle_points: Vec::new(),
            meetings: Vec::new(),
        }
    }

    /// Room for any snapshot of a session of `body` with `settings`, so that saving into it allocates nothing.
    pub fn with_room(body: &Body, settings: &Settings) -> Self {
        let elements = settings.most_elements.min(body.element_count());
        let state = State::with_room(body, elements, body.node_count().min(elements + 64));
        let points = settings.obstacles.iter().map(|obstacle| Vec::with_capacity(obstacle.most_points(body)));
        Self {
            parameters: Vec::with_capacity(most_parameters(body, settings)),
            stiffening: Stiffening::with_room(body.tissue_count()),
            obstacle_points: points.collect(),
            meetings: Vec::with_capacity(MOST_MEETINGS),
            ..Self::with_state(state, settings.tools.len())
        }
    }
}

impl Simulation {
    /// Everything that the next tick depends on beside its inputs.
    pub fn snapshot(&self) -> Snapshot {
        let mut snapshot = Snapshot::with_room(&self.body, &self.settings);
        self.save_into(&mut snapshot);
        snapshot
    }

    /// Saves what [`Simulation::snapshot`] gives without allocating; `snapshot` was made by [`Snapshot::with_room`].
    pub fn save_into(&self, snapshot: &mut Snapshot) {
        self.mesh.save_into(&mut snapshot.body);
        self.save_rest_into(snapshot);
    }

    /// As [`Simulation::save_into`], without what the elements remember of their motion: for questions about a body at rest
    /// where it is now, in a fraction of the time.
    pub fn save_shape_into(&self, snapshot: &mut Snapshot) {
        self.mesh.save_shape_into(&mut snapshot.body);
        self.save_rest_into(snapshot);
    }

    fn save_rest_into(&self, snapshot: &mut Snapshot) {
        snapshot.tick = self.tick;
        snapshot.frozen = self.frozen;
        (snapshot.moved, snapshot.moved_for) = (self.moved, self.moved_for);
        snapshot.prices = self.prices;
        snapshot.entangled = self.entangled;
        snapshot.parameters.clear();
        snapshot.parameters.extend_from_slice(&self.parameters);
        let none = Stiffening::NONE;
        let stiffening = if self.parameters.is_empty() { &none } else { self.mesh.stiffening() };
        snapshot.stiffening.copy_from(stiffening);
        snapshot.tools.copy_from_slice(&self.tools);
        copy_points(&mut snapshot.points, &self.points);
        copy_points(&mut snapshot.obstacle_points, &self.obstacle_points);
        snapshot.meetings.clear();
        snapshot.meetings.extend_from_slice(&self.meetings);
    }

    /// xxh3-64 of exactly what [`Simulation::snapshot`] saves: the same for the same history, whatever the machine.
    pub fn hash(&self) -> u64 {
        let mut hash = xxhash_rust::xxh3::Xxh3::new();
        hash.update(&self.tick.to_le_bytes());
        hash.update(&self.frozen.to_le_bytes());
        hash.update(&self.moved.to_le_bytes());
        hash.update(&self.moved_for.to_le_bytes());
        hash.update(bytemuck::cast_slice(&self.prices.0));
        hash.update(&self.entangled.to_le_bytes());
        self.parameters.iter().for_each(|parameter| hash_saved(parameter, &mut hash));
        if !self.parameters.is_empty() {
            self.mesh.stiffening().hash_into(&mut hash);
        }
        self.mesh.hash_into(&mut hash);
        for (tool, points) in self.tools.iter().zip(&self.points) {
            hash_saved(tool, &mut hash);
            hash_points(points, &mut hash);
        }
        self.obstacle_points.iter().for_each(|points| hash_points(points, &mut hash));
        self.meetings.iter().for_each(|meeting| hash_saved(meeting, &mut hash));
        hash.digest()
    }

    /// Takes over `snapshot`, which is one of this body and these tools: for questions about a copy.
    pub fn load(&mut self, snapshot: &Snapshot) {
        (self.tick, self.frozen, self.entangled) = (snapshot.tick, snapshot.frozen, snapshot.entangled);
        self.prices = snapshot.prices;
        (self.moved, self.moved_for) = (snapshot.moved, snapshot.moved_for);
        self.move_supports();
        self.assume_all(&snapshot.parameters, &snapshot.stiffening);
        self.mesh.restore(&self.body, &snapshot.body);
        self.detection.forget();
        self.tools.copy_from_slice(&snapshot.tools);
        copy_points(&mut self.points, &snapshot.points);
        self.obstacle_points.iter_mut().for_each(Vec::clear);
        copy_points(&mut self.obstacle_points, &snapshot.obstacle_points);
        self.meetings.clear();
        self.meetings.extend_from_slice(&snapshot.meetings);
    }
}

/// Without allocating where there is room.
fn copy_points(to: &mut [Vec<PointMemory>], from: &[Vec<PointMemory>]) {
    for (to, from) in to.iter_mut().zip(from) {
        to.clear();
        to.extend_from_slice(from);
    }
}

fn hash_points(points: &[PointMemory], hash: &mut xxhash_rust::xxh3::Xxh3) {
    hash.update(&(points.len() as u32).to_le_bytes());
    points.iter().for_each(|point| hash_saved(point, hash));
}

/// Feeds `hash` the bytes that `value`, of at most 1 KiB, is saved as.
fn hash_saved(value: &impl Serialize, hash: &mut xxhash_rust::xxh3::Xxh3) {
    let mut bytes = [0u8; 1024];
    match postcard::to_slice(value, &mut bytes) {
        Ok(used) => hash.update(used),
        Err(_) => debug_assert!(false, "the value fits the buffer"),
    }
}
