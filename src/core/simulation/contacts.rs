//! What pushes the body in a tick: its tools, its obstacles, and its organs each other.

use super::Simulation;
use super::room::{self, Room, part_of};
use crate::contact::ground::{self, Ground};
use crate::contact::meeting::{self, Met, Moved, Organs};
use crate::contact::obstacle::Form;
use crate::contact::outside::{boxes, is_apart, is_outside};
use crate::contact::rigid::{Found, Rigid};
use crate::contact::tool::{Phase, ToolState};
use crate::ids::ToolId;
use crate::model::step_class;
use crate::stepping::work::{self, Budget, Laps, Part};

/// Ticks after which a tool that was not outside, and is within the bounds of the body, is looked at again: each look takes all of the
/// display surface. With many, a hand that comes out of the body and goes back in at once may wait on.
const WAITING_TICKS: u32 = 8;

impl Simulation {
    /// Time that finding contacts takes [ns] with as many points as in the last tick, but at least `least` in all, and how
    /// many points these are.
    pub(super) fn contact_time(&self, least: u32) -> (u32, u32) {
        let (mut time, mut points) = (0u32, 0);
        for ((tool, memory), of) in self.tools.iter().zip(&self.points).zip(&self.settings.tools) {
            if tool.phase == Phase::Detached {
                continue;
            }
            let own = (memory.len() as u32).max(least.saturating_sub(points));
            time = time.saturating_add(work::of_contact(&self.prices, own, room::part_of_tool(&of.shape)));
            points += own;
        }
        for (memory, of) in self.obstacle_points.iter().zip(&self.settings.obstacles) {
            let own = memory.len() as u32;
            time = time.saturating_add(work::of_contact(&self.prices, own, part_of(of)));
            points += own;
        }
        if self.looks_for_meetings() {
            time = time.saturating_add(work::of_contact(&self.prices, self.meetings.len() as u32, Part::PatchPoint));
            points += self.meetings.iter().filter(|m| m.held).count() as u32;
        }
        (time, points)
    }

    /// Whether looking for meetings counts as a search: a single organ that is not folded takes little, in every tick alike.
    pub(super) fn looks_for_meetings(&self) -> bool {
        self.body.organs().len() > 1 || !self.meetings.is_empty()
    }

    /// Fills the constraint list, tool by tool and obstacle by obstacle. What is touched anew waits for a tick that has time for it, be it
    /// while the body stands still.
    pub(super) fn find_contacts(&mut self, budget: Budget, laps: &mut dyn Laps) {
        self.constraints.clear();
        self.feet.clear();
        self.points_of_action.clear();
        self.detection.begin();
        // What is touched stays: the end of a frame has to have time for it, too.
        let taken = self.beside_motion(true).saturating_add(self.contact_time(0).0);
        let mut room = Room::new(self.prices, self.most_of(budget).saturating_sub(taken));
        self.find_tool_contacts(&mut room, laps);
        for (i, (of, points)) in self.settings.obstacles.iter().zip(&mut self.obstacle_points).enumerate() {
            laps.lap(Part::Fixed, 0);
            let (id, state) = (ToolId::at(self.tools.len() + i), &of.state_at(self.moved_for, points));
            let out = Found { constraints: &mut self.constraints, points_of_action: &mut self.points_of_action };
            match &of.shape {
                Form::Ground => {
                    let ground = Ground { id, friction: of.friction, state };
                    ground::lie(&self.body, &self.mesh, &ground, points, out, &mut self.detection);
                }
                Form::Parts(shape) => {
                    let horizon = step_class::longest(&self.body);
                    let rigid = Rigid { id, shape, friction: of.friction, state, horizon };
                    room.detect((&self.body, &self.mesh), rigid, points, out, &mut self.detection);
                }
            }
            room::lap_points(laps, points.len(), part_of(of));
        }
        self.find_meetings(&mut room, laps);
    }

    /// Those of organs with each other, and with themselves.
    fn find_meetings(&mut self, room: &mut Room, laps: &mut dyn Laps) {
        laps.lap(Part::Fixed, 0);
        let id = ToolId::at(self.tools.len() + self.settings.obstacles.len());
        let organs = Organs { body: &self.body, mesh: &self.mesh, friction: &self.settings.organ_friction, id };
        let found = Found { constraints: &mut self.constraints, points_of_action: &mut self.points_of_action };
        let out = Met { found, feet: &mut self.feet };
        let moved = Moved { by: self.moved, ticks: self.moved_for };
        meeting::meet(&organs, moved, room.of(Part::PatchPoint), &mut self.meetings, out, &mut self.meeting);
        if self.looks_for_meetings() {
            room::lap_points(laps, self.meetings.len(), Part::PatchPoint);
        }
    }

    /// Those of tools, of which waiting ones engage where they are outside.
    fn find_tool_contacts(&mut self, room: &mut Room, laps: &mut dyn Laps) {
        if self.tools.iter().all(|t| t.phase == Phase::Detached) {
            self.points.iter_mut().for_each(Vec::clear);
            return;
        }
        let is_waiting = |t: &ToolState| t.phase == Phase::Waiting;
        let looks = |t: &ToolState| is_waiting(t) && t.waited.is_multiple_of(WAITING_TICKS);
        let boxes = self.tools.iter().any(is_waiting).then(|| boxes(&self.body, &self.mesh));
        let boxes = boxes.as_ref().map_or(&[][..], |boxes| &boxes[..self.body.organs().len()]);
        if self.tools.iter().any(looks) {
            self.mesh.skin(&mut self.vertices);
        }
        for (i, (tool, points)) in self.tools.iter_mut().zip(&mut self.points).enumerate() {
            let of = &self.settings.tools[i];
            let is_free = |tool: &ToolState| {
                let stance = &tool.stance();
                is_apart(boxes, &of.shape, stance)
                    || looks(tool) && is_outside(&self.body, &self.vertices, &of.shape, stance)
            };
            if is_waiting(tool) && !is_free(tool) {
                tool.waited = tool.waited.saturating_add(1);
            } else if is_waiting(tool) {
                tool.phase = Phase::Engaged;
                tool.stand();
                // It may have touched elsewhere a tick ago, before its client let go of it and took it up again.
                points.clear();
            }
            if !tool.touches() {
                points.clear();
                continue;
            }
            laps.lap(Part::Fixed, 0);
            let out = Found { constraints: &mut self.constraints, points_of_action: &mut self.points_of_action };
            let (shape, friction) = (&of.shape, of.friction + tool.friction_left);
            let rigid = Rigid { id: ToolId::at(i), shape, friction, state: tool, horizon: 0.0 };
            room.detect((&self.body, &self.mesh), rigid, points, out, &mut self.detection);
            room::lap_points(laps, points.len(), room::part_of_tool(&of.shape));
        }
    }
}
