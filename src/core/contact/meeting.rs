//! Where organs meet, and where one folds onto itself: point constraints with two sides, once per tick, one for each patch of the surface
//! that is near another organ, or another place of its own.
//!
//! A patch meets the display triangles of the other organ that face it with its mean place, as it does the ground, and the other's
//! patches meet it likewise: neither is the master. What a constraint does to one organ it does to the other at the same place, so that
//! no momentum comes of it, nor any moment.

use super::closing::Closing;
use super::detection::MOST_STRETCH;
use super::facing::{self, Now, Patch, Seen};
use super::friction::SLIPS;
use super::outside::boxes;
use super::rigid::Found;
use super::tool::MOST_POINTS;
use super::touchable::MARGIN;
use crate::ids::{OrganId, ToolId, Vertex};
use crate::math::{Bounds, Real, Vec3};
use crate::model::active_mesh::skin;
use crate::model::constraint::{Constraint, Foot, Held, Pushed};
use crate::model::meeting::{MOST_MEETINGS, Meeting};
use crate::model::organ::MOST_ORGANS;
use crate::model::step_class::{TICK, step_of};
use crate::model::{ActiveMesh, Body, Friction};

/// Patches that are this far from another organ, or another place of their own, [m] are followed, so that all that come with up to 1 m/s
/// within [`LOOKS`] ticks are known before they touch.
const NEAR: Real = 10e-3;
/// Ticks in which all patches are looked at once for what they come near to, at the soonest: with fewer each takes longer, with more fast
/// ones are found late.
const LOOKS: u64 = 8;
/// And for what they come near to on their own organ, which every body has: [`NEAR`] less [`MARGIN`] in so many ticks is 0.5 m/s. With
/// fewer each tick takes longer; with more slower folds are found late, and one that is through is not found any more.
const LOOKS_AT_ITSELF: u64 = 16;
/// And at the latest, when all is slow: two frames.
const LATEST: u64 = 64;
/// What two places come nearer to each other by at most [m] between two looks, if these are later than the soonest: so deep is what was
/// beside a patch, and turned to it since. With less, slow motion takes longer.
const LATE: Real = MARGIN / 4.0;
/// How much faster than now all may move until the next look: what speeds up by more within some ticks is found late, as what comes with
/// more than 1 m/s is, and with more each tick takes longer.
const FASTER: Real = 2.0;
/// Coulomb's coefficients of friction between organs: of each two of them, and of each with itself where it is folded.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Between([[Real; MOST_ORGANS]; MOST_ORGANS]);

impl Between {
    /// Between all of them alike.
    pub fn all(friction: Real) -> Self {
        Self([[friction; MOST_ORGANS]; MOST_ORGANS])
    }

    /// With this `friction` between two of them.
    pub fn set(&mut self, a: OrganId, b: OrganId, friction: Real) {
        (self.0[a.index()][b.index()], self.0[b.index()][a.index()]) = (friction, friction);
    }

    /// That between two of them.
    pub fn of(&self, a: OrganId, b: OrganId) -> Real {
        self.0[a.index()][b.index()]
    }
}

/// What meets.
#[derive(Clone, Copy, Debug)]
pub struct Organs<'a> {
    /// The body that they are.
    pub body: &'a Body,
    /// As it moves.
    pub mesh: &'a ActiveMesh,
    /// What of friction is between them.
    pub friction: &'a Between,
    /// Their number among all that pushes.
    pub id: ToolId,
}

impl<'a> Organs<'a> {
    fn now(&self) -> Now<'a> {
        Now { body: self.body, mesh: self.mesh }
    }
}

/// How far a body has come.
#[derive(Clone, Copy, Debug)]
pub struct Moved {
    /// What display vertices moved by at most in the last tick, but for what moved them all alike [m].
    pub by: Real,
    /// Since it was where it begins.
    pub ticks: u64,
}

/// Receives what is found.
#[derive(Debug)]
pub struct Met<'a> {
    /// Constraints, and where they act.
    pub found: Found<'a>,
    /// The other side of each.
    pub feet: &'a mut Vec<Foot>,
}

/// Memory that looking for meetings needs and no one keeps.
#[derive(Debug)]
pub struct Workspace {
    surface: facing::Workspace,
    before: Vec<Meeting>,
}

impl Workspace {
    /// For `body`.
    pub fn new(body: &Body) -> Self {
        Self { surface: facing::Workspace::new(body), before: Vec::with_capacity(MOST_MEETINGS) }
    }
}

/// Appends the constraints between `organs`, which have `moved`, at the start of a tick to `out`; `memory` holds the meetings of the last
/// tick and receives this tick's, by patch and other organ. No more than `room` of them are new.
pub fn meet(organs: &Organs, moved: Moved, room: u32, memory: &mut Vec<Meeting>, out: Met, work: &mut Workspace) {
    let (now, Met { found, feet }) = (organs.now(), out);
    let Workspace { surface: work, before } = work;
    std::mem::swap(memory, before);
    memory.clear();
    work.begin(now);
    let nearer = Nearer(2.0 * FASTER * moved.by);
    let looks = if moved.ticks < LATEST { LOOKS } else { nearer.looks() };
    for &m in &*before {
        if !(moved.ticks + u64::from(m.patch)).is_multiple_of(nearer.rest(m.gap)) {
            memory.push(m);
            continue;
        }
        let seen = Patch::of(now, m.patch, work).and_then(|patch| patch.follow(now, m.triangle, work));
        if let Some(seen) = seen.filter(|seen| seen.gap < NEAR) {
            let Seen { triangle, weights, gap, normal, share, .. } = seen;
            memory.push(Meeting { triangle, weights, gap, normal, share, ..m });
        }
    }
    let mut room = Room { left: room, memory };
    look_at_others(organs, Look { tick: moved.ticks, every: looks }, &mut room, work);
    look_at_themselves(organs, Look { tick: moved.ticks, every: looks.max(LOOKS_AT_ITSELF) }, &mut room, work);
    let on = &work.shown(now);
    for m in memory.iter_mut() {
        m.held = m.gap < MARGIN;
        if m.held {
            constrain(organs, m, found.constraints, feet);
            found.points_of_action.push(on.displayed(m.triangle, m.weights));
        } else {
            (m.multiplier, m.slack) = (0.0, 0.0);
            (m.force, m.tangential, m.stretch) = (Vec3::zeros(), Vec3::zeros(), Vec3::zeros());
        }
    }
}

/// The meetings, and how many more there is room for.
struct Room<'a> {
    /// New ones, by the time of the tick.
    left: u32,
    memory: &'a mut Vec<Meeting>,
}

impl Room<'_> {
    fn is_full(&self) -> bool {
        self.left == 0 || self.memory.len() == MOST_MEETINGS
    }

    /// Where the meeting of patch `i` and organ `other` is to stand, unless there is one.
    fn place(&self, i: u32, other: OrganId) -> Option<usize> {
        self.memory.binary_search_by_key(&(i, other), |m| (m.patch, m.other)).err()
    }

    fn insert(&mut self, at: usize, met: Meeting) {
        self.memory.insert(at, met);
        self.left -= 1;
    }
}

/// Which patches look.
#[derive(Clone, Copy, Debug)]
struct Look {
    tick: u64,
    /// Each in so many ticks.
    every: u64,
}

impl Look {
    /// Whether patch `i` does.
    fn is_of(self, i: u32) -> bool {
        (u64::from(i) + self.tick).is_multiple_of(self.every)
    }
}

/// Finds what some of the patches come near to on other organs.
fn look_at_others(organs: &Organs, look: Look, room: &mut Room, work: &mut facing::Workspace) {
    let Organs { body, mesh, .. } = *organs;
    let patches = body.patches();
    if body.organs().len() == 1 {
        return;
    }
    let boxes = boxes(body, mesh);
    let window = window(&boxes, body.organs().len());
    work.beside.clear();
    for i in (0..patches.count()).filter(|i| look.is_of(*i)) {
        let far = MOST_STRETCH * patches.extent(i).reach;
        if room.is_full() || !window.grown(far).contains(&work.middles[i as usize]) {
            continue;
        }
        let Some(patch) = Patch::of(organs.now(), i, work).filter(|patch| window.contains(&patch.place)) else {
            continue;
        };
        let own = patches.organ(i);
        for other in (0..body.organs().len()).map(OrganId::at).filter(|other| *other != own) {
            let Some(place) = room.place(i, other) else { continue };
            if room.is_full() || !boxes[other.index()].grown(NEAR).contains(&patch.place) {
                continue;
            }
            if let Some(seen) = patch.look(organs.now(), NEAR, patches.of_organ(other), false, work) {
                room.insert(place, met_anew(seen, i, other));
            }
        }
    }
}

/// Finds what some of the patches come near to on their own organ.
fn look_at_themselves(organs: &Organs, look: Look, room: &mut Room, work: &mut facing::Workspace) {
    let patches = organs.body.patches();
    for i in (0..patches.count()).filter(|i| look.is_of(*i)) {
        let own = patches.organ(i);
        let Some(place) = room.place(i, own).filter(|_| !room.is_full()) else { continue };
        work.beside.clear();
        patches.beside(i).iter().for_each(|of| _ = work.beside.visit(*of as usize));
        let seen = Patch::of(organs.now(), i, work)
            .and_then(|patch| patch.look(organs.now(), NEAR, patches.of_organ(own), true, work));
        if let Some(seen) = seen {
            room.insert(place, met_anew(seen, i, own));
        }
    }
}

fn met_anew(seen: Seen, patch: u32, other: OrganId) -> Meeting {
    Meeting {
        patch,
        other,
        triangle: seen.triangle,
        weights: seen.weights,
        gap: seen.gap,
        share: seen.share,
        held: false,
        normal: seen.normal,
        force: Vec3::zeros(),
        multiplier: 0.0,
        tangential: Vec3::zeros(),
        // All that they overlap by is closed gradually.
        slack: Real::INFINITY,
        stretch: Vec3::zeros(),
    }
}

/// How much nearer two places come within a tick at most [m].
#[derive(Clone, Copy, Debug)]
struct Nearer(Real);

impl Nearer {
    /// Ticks, a power of two, within which what is this far apart [m] does not come to be a constraint.
    fn rest(self, gap: Real) -> u64 {
        1 << self.ticks(gap - MARGIN).clamp(1, LATEST).ilog2()
    }

    /// Ticks, a power of two, in which all patches are to be looked at.
    fn looks(self) -> u64 {
        1 << self.ticks(LATE).clamp(LOOKS, LATEST).ilog2()
    }

    /// Until two places are this much nearer [m].
    fn ticks(self, way: Real) -> u64 {
        (way / self.0.max(Real::MIN_POSITIVE)) as u64
    }
}

/// Around all places where the boxes of two of so many organs are near each other [m].
fn window(boxes: &[Bounds; MOST_ORGANS], organs: usize) -> Bounds {
    let pairs = (0..organs).flat_map(|i| (0..i).map(move |j| (i, j)));
    let shared = pairs.map(|(i, j)| {
        let (a, b) = (boxes[i].grown(NEAR), boxes[j].grown(NEAR));
        Bounds::new(a.low.sup(&b.low), a.high.inf(&b.high))
    });
    let is_any = |shared: &Bounds| (0..3).all(|c| shared.low[c] <= shared.high[c]);
    shared.filter(is_any).fold(Bounds::NOTHING, |all, shared| all.joined(&shared))
}

/// Appends the constraint of `m`.
fn constrain(organs: &Organs, m: &mut Meeting, constraints: &mut Vec<Constraint>, feet: &mut Vec<Foot>) {
    let Organs { body, mesh, friction, id } = *organs;
    let patch = body.patches().of(m.patch);
    let corners = body.triangle(m.triangle);
    let stencil: [(Vertex, Real); 3] = std::array::from_fn(|i| (corners[i], m.weights[i]));
    let (row, foot) = skin::two_sided(mesh, patch, &stencil);
    let mobility: Real = row.entries().iter().map(|(s, b)| b * b * mesh.motion.inverse_mass[s.index()]).sum();
    // Of the elements that carry it, the one that is kicked the least often.
    let kicked = |v: Vertex| mesh.pool().class_of(mesh.embedding(v).element);
    let carriers = patch.iter().map(|(v, _)| *v).chain(corners);
    let horizon = carriers.filter_map(kicked).map(step_of).fold(0.0, Real::max);
    // As on the ground: as much as its inertia gives way within a step.
    let mut compliance = [0.0; MOST_POINTS];
    compliance[0] = horizon * horizon * mobility / m.share;
    // What the compliance gives way by is no overlap that was found late.
    let closing = Closing::new(Some(m.slack), -m.gap - compliance[0] * m.multiplier, 0.0, 0.0, false);
    m.slack = closing.slack_end;
    let apart = row.interpolate(&mesh.motion.position);
    let along = |v: &Vec3| v - m.normal * m.normal.dot(v);
    let coefficient = friction.of(body.patches().organ(m.patch), m.other);
    (m.tangential, m.stretch) = (along(&m.tangential), along(&m.stretch));
    constraints.push(Constraint {
        row,
        normal: m.normal,
        offset: m.normal.dot(&apart) - m.gap - closing.slack,
        rate: (closing.slack - closing.slack_end) / TICK,
        first: constraints.len() as u32,
        compliance,
        tool: id,
        point: body.point_of_patch(m.patch),
        multiplier: m.multiplier,
        mean_multiplier: 0.0,
        friction: Friction {
            coefficient,
            compliance: 1.0,
            anchor: apart - m.stretch,
            rate: Vec3::zeros(),
            multiplier: m.tangential,
            mean_multiplier: Vec3::zeros(),
        },
        arm: Vec3::zeros(),
        lever: Vec3::zeros(),
        held: Held::default(),
        allowed_for: Pushed::default(),
        horizon,
    });
    feet.push(foot);
}

/// Writes what the `constraints` between organs were solved to into the meetings; nothing where the body stood still.
pub fn remember(mesh: &ActiveMesh, constraints: &[Constraint], meetings: &mut [Meeting]) {
    for (c, m) in constraints.iter().zip(meetings.iter_mut().filter(|m| m.held)) {
        m.multiplier = c.multiplier;
        m.force = c.normal * c.mean_multiplier + c.friction.mean_multiplier;
        if c.friction.coefficient == 0.0 {
            continue;
        }
        m.tangential = c.friction.multiplier;
        let stretch = c.row.interpolate(&mesh.motion.position) - c.friction.anchor;
        let slips = c.friction.multiplier.norm() >= SLIPS * c.friction.coefficient * c.multiplier;
        // One that slips takes the place that it sticks to along.
        m.stretch = if slips { c.friction.multiplier * (-c.compliance[0] * c.friction.compliance) } else { stretch };
    }
}
