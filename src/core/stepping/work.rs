//! What a tick is made of, what each part costs, and what a tick will cost: counted before it runs.
//!
//! The counts are the core's, the prices are an input: whoever owns the clock measures them and hands them in, and a
//! recording keeps them. So what the core decides depends on nothing but its inputs.

use crate::model::active_mesh::ChangeCost;
use crate::model::element_pool::CLASSES;
use crate::model::{ActiveMesh, Body};
use serde::{Deserialize, Serialize};

/// A part of a tick, and what it is counted in.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Part {
    /// What every tick takes: tools, messages, forces. Ticks.
    Fixed,
    /// Looking where resolution is wanted, every few ticks. Elements in use.
    Look,
    /// Positions and velocities. Visits of a node.
    Node,
    /// Interface rows. Visits of an entry.
    Row,
    /// Supports. Visits of an element that carries some.
    Support,
    /// Looking for contacts near the surface, where there are none. Tools.
    Search,
    /// Contact points of balls and capsules, found and made ready. Points.
    Point,
    /// Contact points of cylinders and convex hulls. Points.
    SolidPoint,
    /// Patches that lie on the ground or meet another organ, found and made ready. Points.
    PatchPoint,
    /// The contact solve. Points in one solve.
    Solve,
    /// Changes of resolution. Units of [`change_units`].
    Change,
    /// Surface, levels of detail and hash at the end of a frame. Frames.
    Frame,
    /// A copy of the state for questions. Copies.
    Copy,
    /// Elements of a step class. Evaluations.
    Element(u8),
}

/// Parts of a tick.
pub const PARTS: usize = 13 + CLASSES;

impl Part {
    /// All of them.
    pub const ALL: [Part; PARTS] = {
        use Part::{
            Change, Copy, Element, Fixed, Frame, Look, Node, PatchPoint, Point, Row, Search, SolidPoint, Solve, Support,
        };
        let mut all = [Fixed; PARTS];
        let others =
            [Fixed, Look, Node, Row, Support, Search, Point, SolidPoint, PatchPoint, Solve, Change, Frame, Copy];
        let mut i = 0;
        while i < PARTS {
            all[i] = if i < others.len() { others[i] } else { Element((i - others.len()) as u8) };
            i += 1;
        }
        all
    };

    /// Its place in [`Part::ALL`].
    pub fn index(self) -> usize {
        match self {
            Part::Fixed => 0,
            Part::Look => 1,
            Part::Node => 2,
            Part::Row => 3,
            Part::Support => 4,
            Part::Search => 5,
            Part::Point => 6,
            Part::SolidPoint => 7,
            Part::PatchPoint => 8,
            Part::Solve => 9,
            Part::Change => 10,
            Part::Frame => 11,
            Part::Copy => 12,
            Part::Element(class) => 13 + usize::from(class),
        }
    }

    /// What it is, and what it is counted in.
    pub fn describe(self) -> (String, &'static str) {
        let name = match self {
            Part::Fixed => "what every tick takes",
            Part::Look => "looking where resolution is wanted",
            Part::Node => "nodes",
            Part::Row => "interface rows",
            Part::Support => "supports",
            Part::Search => "looking for contacts",
            Part::Point => "contact points, balls and capsules",
            Part::SolidPoint => "contact points, cylinders and hulls",
            Part::PatchPoint => "contact points, ground and organs",
            Part::Solve => "contact solve",
            Part::Change => "changes of resolution",
            Part::Frame => "surface of a frame",
            Part::Copy => "copy of the state",
            Part::Element(class) => return (format!("elements, {} steps a tick", 1u32 << class), "evaluation"),
        };
        let of = match self {
            Part::Fixed => "tick",
            Part::Look => "element",
            Part::Node => "visit",
            Part::Row => "entry",
            Part::Support => "element",
            Part::Search => "tool",
            Part::Point | Part::SolidPoint | Part::PatchPoint | Part::Solve => "point",
            Part::Change => "unit",
            Part::Frame => "frame",
            _ => "copy",
        };
        (name.into(), of)
    }
}

/// Told what a tick is doing, part by part. The core passes counts and keeps nothing.
pub trait Laps {
    /// What has been done since the last call was `part`, `count` times.
    fn lap(&mut self, part: Part, count: u32);
}

/// Nobody listens.
impl Laps for () {
    fn lap(&mut self, _: Part, _: u32) {}
}

/// What each part costs [ps], by [`Part::index`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Prices(pub [u32; PARTS]);

impl Prices {
    /// Those of a common machine (one core of a server of 2023): what offline runs, studies and tests count with, and what
    /// a session begins with before anything is measured.
    pub const COMMON: Prices = {
        let mut prices = [20_000; PARTS];
        let others = [
            20_000_000, // tick
            20_000,     // look
            3_000,      // node
            1_500,      // row
            25_000,     // support
            20_000_000, // search
            3_000_000,  // point
            4_000_000,  // solid point
            1_000_000,  // patch point
            250_000,    // solve
            15_000,     // change
            80_000_000, // frame
            80_000_000, // copy
        ];
        let mut i = 0;
        while i < others.len() {
            prices[i] = others[i];
            i += 1;
        }
        Prices(prices)
    };

    /// Cost of `part`, `count` times [ns].
    pub fn of(&self, part: Part, count: u32) -> u32 {
        let ns = u64::from(self.0[part.index()]) * u64::from(count) / 1000;
        ns.min(u64::from(u32::MAX / 4)) as u32
    }

    /// How many times `part` may be done in `time` [ns].
    pub fn count(&self, part: Part, time: u32) -> u32 {
        (u64::from(time) * 1000 / u64::from(self.0[part.index()].max(1))).min(u64::from(u32::MAX)) as u32
    }
}

/// Time and count of one part, each a running mean.
#[derive(Clone, Copy, Debug, Default)]
struct Cost {
    /// [ns]; of parts that do not come in every tick, what it would be on a common machine.
    time: f64,
    count: f64,
    occurred: u32,
}

/// Evaluations of an element at the mean price of all classes that count in the price of each: in a class of a few elements
/// what the event itself costs would be taken for theirs.
const SHARED_EVALUATIONS: f64 = 200.0;

/// What parts of ticks have been measured to cost: [`Prices`] follow from it. It reads no clock.
///
/// Parts that come in every tick tell how slow the machine is; of the others it is measured how they compare with those, or
/// a machine that becomes slower would be followed only after sixteen frames.
#[derive(Clone, Copy, Debug)]
pub struct Costs {
    all: [Cost; PARTS],
    /// How slow this machine is: what has been measured over what it would cost on a common one.
    slowness: f64,
    /// Of the tick that runs: time [ns] and count.
    now: [(u64, u32); PARTS],
    /// By part: whether its last lap was far too long.
    long: [bool; PARTS],
    /// Time in such laps of the tick that runs [ns].
    away: u64,
}

/// A lap that takes this many times what it should, and [`LONG`] more [ns], is not the part's own: an interrupt or the
/// hypervisor had the processor. Unless the next lap of the part is as long: then its cost has changed. Spreads of costs stay
/// well below; interruptions of a virtual machine take 0.2 ms and more.
const TIMES_LONG: f64 = 4.0;
const LONG: f64 = 50_000.0;

impl Default for Costs {
    fn default() -> Self {
        let idle = [(0, 0); PARTS];
        Self { all: [Cost::default(); PARTS], slowness: 1.0, now: idle, long: [false; PARTS], away: 0 }
    }
}

/// Whether a part comes in every tick in which the body moves.
fn is_steady(part: Part) -> bool {
    matches!(part, Part::Fixed | Part::Node | Part::Row | Part::Support | Part::Element(_))
}

impl Costs {
    /// `part` has been done `count` times in `time` [ns] of the tick that runs.
    pub fn lap(&mut self, part: Part, count: u32, time: u64) {
        let mut time = time;
        let known = self.all[part.index()].occurred > 0;
        let expected = self.price(part) * f64::from(count.max(1));
        let long = known && time as f64 > TIMES_LONG * expected + LONG;
        if long && !std::mem::replace(&mut self.long[part.index()], long) {
            self.away += time - expected as u64;
            time = expected as u64;
        }
        self.long[part.index()] = long;
        if count > 0 && matches!(part, Part::Point | Part::SolidPoint | Part::PatchPoint) {
            // Looking for them comes on top of the points.
            time -= (self.price(Part::Search) as u64).min(3 * time / 4);
        }
        let now = &mut self.now[part.index()];
        *now = (now.0 + time, now.1 + count);
    }

    /// Takes the tick's laps in; prices are means over about `memory` occurrences. Time of the tick [ns] in laps that were so
    /// much longer than the part's others that the machine was away.
    pub fn end_tick(&mut self, memory: f64) -> u64 {
        let now = std::mem::replace(&mut self.now, [(0, 0); PARTS]);
        let mut learn = |steady: bool, slowness: f64| {
            let parts = Part::ALL.iter().zip(&mut self.all).zip(now);
            for ((_, cost), (time, count)) in
                parts.filter(|((part, _), (_, count))| is_steady(**part) == steady && *count > 0)
            {
                cost.occurred = cost.occurred.saturating_add(1);
                let weight = 1.0 / f64::from(cost.occurred).min(memory);
                cost.time += (time as f64 / slowness - cost.time) * weight;
                cost.count += (f64::from(count) - cost.count) * weight;
            }
        };
        learn(true, 1.0);
        learn(false, self.slowness);
        self.slowness = self.measured_slowness();
        std::mem::take(&mut self.away)
    }

    /// Leaves the tick's laps out.
    pub fn drop_tick(&mut self) {
        (self.now, self.away) = ([(0, 0); PARTS], 0);
    }

    fn measured_slowness(&self) -> f64 {
        let (mut time, mut common) = (0.0, 0.0);
        for (part, cost) in Part::ALL.iter().zip(&self.all).filter(|(part, _)| is_steady(**part)) {
            time += cost.time;
            common += cost.count * f64::from(Prices::COMMON.0[part.index()]) / 1e3;
        }
        if common > 0.0 { time / common } else { 1.0 }
    }

    /// Price of `part` [ns]; what has not been measured costs what it would on a common machine as slow as this.
    fn price(&self, part: Part) -> f64 {
        let (cost, common) = (self.all[part.index()], f64::from(Prices::COMMON.0[part.index()]) / 1e3 * self.slowness);
        if let Part::Element(_) = part {
            let sum = |of: fn(&Cost) -> f64| self.all[PARTS - CLASSES..].iter().map(of).sum::<f64>();
            let count = sum(|cost| cost.count);
            let mean = if count > 0.0 { sum(|cost| cost.time) / count } else { common };
            return (cost.time + SHARED_EVALUATIONS * mean) / (cost.count + SHARED_EVALUATIONS);
        }
        let slowness = if is_steady(part) { 1.0 } else { self.slowness };
        if cost.count > 0.0 { cost.time / cost.count * slowness } else { common }
    }

    /// What each part costs.
    pub fn prices(&self) -> Prices {
        Prices(Part::ALL.map(|part| (1e3 * self.price(part)).clamp(1.0, 4e9) as u32))
    }
}

/// What a tick may take.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Budget {
    /// Time of a tick, by the prices [ns]: the body stands still in a tick that would take more.
    pub limit: u32,
    /// What ticks are planned to take at most [ns]: less, because some take longer than their prices say.
    pub planned: u32,
    /// And those that end a frame, or copy the state.
    pub frame: u32,
    /// And those that change the resolution: the body stands still in one that would take more.
    pub change: u32,
}

impl Budget {
    /// All work is done.
    pub const UNLIMITED: Budget = Budget::of(u32::MAX);

    /// `limit` [ns], all of it to be used.
    pub const fn of(limit: u32) -> Self {
        Self { limit, planned: limit, frame: limit, change: limit }
    }
}

/// Change units per element put in or taken out.
const ELEMENT_COST: u32 = 40;
/// Change units of weighing the forces of one element, as is done before and after changes under a load.
const RESIDUAL_COST: u32 = 10;
/// Change units of both rows of a contact point, measured: 3 µs with its part of gathering nodes. With less ticks that change the resolution
/// are late, with more loads are weighed by the display's rows although there were time.
const POINT_COST: u32 = 200;
/// Change units per interface row made.
const ROW_COST: u32 = 40;
/// Visits of nodes and of row entries by an event of `class`; all may be concerned. Each is visited twice: moved and kicked,
/// placed and handed back.
fn visits(body: &Body, mesh: &ActiveMesh, class: usize) -> (u32, u32) {
    let in_stars = mesh.stars().count(class) * (1 + body.stars().most_neighbours());
    let most = (4 * mesh.pool().count(class) + in_stars) as u32;
    let part = |all: u32| 2 * all.min(most);
    (part(mesh.active().len() as u32), part(mesh.row_entries()))
}

/// Time of moving the body by a tick with `solves` points in all solves of the contact [ns].
pub fn of_motion(body: &Body, mesh: &ActiveMesh, prices: &Prices, solves: u32) -> u32 {
    // After the last event all nodes drift to the end of the tick.
    let (mut nodes, mut rows) = (mesh.active().len() as u32, mesh.row_entries());
    let mut time = 0u32;
    for class in 0..CLASSES {
        let elements = mesh.evaluations(class);
        let (of_nodes, of_rows) = visits(body, mesh, class);
        (nodes, rows) = (nodes + (of_nodes << class), rows + (of_rows << class));
        time = time.saturating_add(prices.of(Part::Element(class as u8), elements << class));
    }
    let supports = (mesh.support_count() as u32) << mesh.support_class(body);
    [(Part::Node, nodes), (Part::Row, rows), (Part::Support, supports), (Part::Solve, solves)]
        .into_iter()
        .fold(time, |time, (part, count)| time.saturating_add(prices.of(part, count)))
}

/// Time of what a tick takes beside motion, contacts and resolution [ns]; at the end of a `frame` more.
pub fn of_rest(prices: &Prices, frame: bool) -> u32 {
    let frame = if frame { of_frame(prices) } else { 0 };
    prices.of(Part::Fixed, 1).saturating_add(frame)
}

/// Time that the end of a frame takes, or the copy that is made in its middle [ns].
pub fn of_frame(prices: &Prices) -> u32 {
    prices.of(Part::Frame, 1).max(prices.of(Part::Copy, 1))
}

/// Time of looking for contact points and finding `points`, which are counted as `part` [ns].
pub fn of_contact(prices: &Prices, points: u32, part: Part) -> u32 {
    prices.of(Part::Search, 1).saturating_add(prices.of(part, points))
}

/// Element evaluations of a tick.
pub fn evaluations(mesh: &ActiveMesh) -> u32 {
    (0..CLASSES).map(|c| mesh.evaluations(c) << c).sum()
}

/// Change units of the rows by which the load of so many contact points is weighed, before and after changes.
pub fn weighing_units(points: u32) -> u32 {
    points * POINT_COST
}

/// Change units of a batch of changes of resolution of a body with `nodes` nodes in use, whatever is in it: momenta,
/// masses and the surface before and after.
fn empty_batch(nodes: u32) -> u32 {
    1_000 + nodes
}

/// As [`change_units`], of a batch with nothing in it.
pub fn empty_batch_units(mesh: &ActiveMesh) -> u32 {
    empty_batch((mesh.active().len() + mesh.interface().len()) as u32)
}

/// Change units of a batch of changes of resolution of `mesh`: one is the 40th part of putting in an element.
pub fn change_units(mesh: &ActiveMesh, cost: &ChangeCost) -> u32 {
    let each = cost.elements * ELEMENT_COST + cost.rows * ROW_COST + cost.residual * RESIDUAL_COST;
    empty_batch_units(mesh) + each
}

/// Time of a tick at rest in which only the coarsest level of `body` is used [ns], a frame with it: what the body really
/// takes, and cannot do with less.
pub fn floor(body: &Body, mesh: &ActiveMesh, prices: &Prices) -> u32 {
    of_motion(body, mesh, prices, 0).saturating_add(of_rest(prices, true))
}
