//! What the plots show: the last seconds of a live session, or the whole of a recording.

use crate::source::{Frame, Moment, TICK, forces};
use palpate_sdk::Status;
use std::collections::VecDeque;

/// How much of a live session is kept [s].
pub const SPAN: f64 = 20.0;

/// Curves over simulated time [s], oldest first.
#[derive(Clone, Debug, Default)]
pub struct History {
    forces: VecDeque<(f64, Vec<f32>)>,
    health: VecDeque<Health>,
}

/// How a server fared at one time.
#[derive(Clone, Debug, PartialEq)]
pub struct Health {
    /// Simulated time [s].
    pub time: f64,
    /// (levels) active nodes.
    pub nodes: Vec<u64>,
    /// Wake-up after the deadline since the start [µs]: median and 99th percentile.
    pub lateness: [f64; 2],
    /// What the last tick was planned to take, and what it might be [µs]. A machine that is always interrupted leaves nothing.
    pub planned: [f64; 2],
}

impl History {
    /// That of a whole recording.
    pub fn of_recording(frames: &[Frame]) -> Self {
        let forces = frames.iter().map(|frame| (frame.tick as f64 * TICK, frame.forces.clone()));
        Self { forces: forces.collect(), health: VecDeque::new() }
    }

    /// Adds a moment of a live session; one that is not later than the last is left out, and an earlier one starts anew.
    pub fn add(&mut self, moment: &Moment) {
        let time = moment.tick as f64 * TICK;
        match self.forces.back() {
            Some((last, _)) if time < *last - 1.0 => *self = Self::default(),
            Some((last, _)) if *last >= time => return,
            _ => {}
        }
        self.forces.push_back((time, forces(&moment.tools)));
        while self.forces.front().is_some_and(|(first, _)| *first < time - SPAN) {
            self.forces.pop_front();
        }
    }

    /// Adds a server's status, once for each.
    pub fn add_status(&mut self, status: &Status) {
        let time = status.tick as f64 * TICK;
        if status.tick == 0 || self.health.back().is_some_and(|last| last.time == time) {
            return;
        }
        if self.health.back().is_some_and(|last| last.time > time) {
            self.health.clear();
        }
        let lateness = status.lateness_us.unwrap_or_default();
        self.health.push_back(Health {
            time,
            nodes: status.active_nodes.clone(),
            lateness: [lateness.p50, lateness.p99],
            planned: [status.work, status.planned].map(|nanoseconds| nanoseconds as f64 * 1e-3),
        });
        while self.health.front().is_some_and(|first| first.time < time - SPAN) {
            self.health.pop_front();
        }
    }

    /// First and last time [s] of what is kept.
    pub fn span(&self) -> (f64, f64) {
        let last = self.forces.back().map_or(0.0, |(time, _)| *time);
        (self.forces.front().map_or(0.0, |(time, _)| *time), last)
    }

    /// The largest number of tools that were held.
    pub fn tools(&self) -> usize {
        self.forces.iter().map(|(_, forces)| forces.len()).max().unwrap_or(0)
    }

    /// Force of `tool` over time: ([s], [N]). No more than `points` of them, the largest of those that fall together.
    pub fn force(&self, tool: usize, points: usize) -> Vec<[f64; 2]> {
        let together = self.forces.len().div_ceil(points.max(1)).max(1);
        let mut curve: Vec<[f64; 2]> = Vec::with_capacity(self.forces.len().div_ceil(together));
        for (number, (time, forces)) in self.forces.iter().enumerate() {
            let force = forces.get(tool).copied().map_or(0.0, f64::from);
            match curve.last_mut() {
                Some([_, largest]) if number % together != 0 => *largest = force.max(*largest),
                _ => curve.push([*time, force]),
            }
        }
        curve
    }

    /// The statuses that are kept.
    pub fn health(&self) -> &VecDeque<Health> {
        &self.health
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use palpate_sdk::proto::ToolState;

    fn moment(tick: u64, newtons: f32) -> Moment {
        let tool = ToolState { force: vec![newtons, 0.0, 0.0], ..Default::default() };
        Moment { tick, tools: vec![tool], ..Default::default() }
    }

    #[test]
    fn a_live_session_keeps_its_last_seconds_and_a_new_server_starts_anew() {
        let mut history = History::default();
        for tick in (0..60_000).step_by(32) {
            history.add(&moment(tick, 1.0));
            history.add(&moment(tick, 2.0)); // the same moment, shown twice
        }
        let (first, last) = history.span();
        assert!((last - first - SPAN).abs() < 0.1 && (last - 59.968).abs() < 1e-9, "{first} {last}");
        assert!(history.force(0, 1000).iter().all(|point| point[1] == 1.0));
        history.add(&moment(40, 3.0));
        assert_eq!(history.force(0, 1000), [[0.04, 3.0]]);
    }

    #[test]
    fn a_curve_of_few_points_keeps_its_peaks() {
        let frames: Vec<Frame> =
            (0..1000).map(|n| Frame { tick: 32 * n, forces: vec![if n == 777 { 2.5 } else { 0.1 }] }).collect();
        let curve = History::of_recording(&frames).force(0, 100);
        assert_eq!(curve.len(), 100);
        assert_eq!(curve.iter().map(|point| point[1]).fold(0.0, f64::max), 2.5);
        assert_eq!((curve[0][0], curve[1][0]), (0.0, 0.32));
    }

    #[test]
    fn every_status_is_one_point() {
        let mut history = History::default();
        let status = Status { tick: 1000, work: 30, planned: 120, active_nodes: vec![5, 7], ..Default::default() };
        history.add_status(&status);
        history.add_status(&status);
        history.add_status(&Status::default());
        assert_eq!(history.health().len(), 1);
        assert_eq!((history.health()[0].planned, history.health()[0].nodes.len()), ([0.03, 0.12], 2));
    }
}
