//! A point of the surface that a tool, an obstacle or another organ pushes: what contact hands to the solver, and nothing else
//! passes between them.

use super::element_kernel::Padded;
use crate::ids::{Slot, ToolId};
use crate::math::{Mat3, Real, Vec3};
use serde::{Deserialize, Serialize};

/// Most tools of a session.
pub const MOST_TOOLS: usize = 8;

/// Most parts of a tool: what bounds the cost of a tick.
pub const MOST_PARTS: usize = 8;

/// Most obstacles of a session. To the solver an obstacle is a tool, with a number after those of the tools.
pub const MOST_OBSTACLES: usize = 8;

/// All that pushes the body has a number: tools, obstacles, and the organs that push each other one for all.
pub const MOST_PUSHERS: usize = MOST_TOOLS + MOST_OBSTACLES + 1;

/// Most contact points of one tool: what bounds the cost of a tick.
pub const MOST_POINTS: usize = 64;

/// Active nodes that a surface point can hang on. Three display vertices with four nodes each make twelve, or some 40 where these are
/// interface nodes; of a lattice there are 51 to 57 within two lattice constants of a place on a flat face.
pub const MOST_ROW_NODES: usize = 64;

/// A surface point as an affine combination of active nodes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Row {
    /// Slot and weight; only the first `len` count, slots distinct.
    entries: [(Slot, Real); MOST_ROW_NODES],
    len: u32,
}

impl Row {
    /// No nodes yet.
    pub const EMPTY: Row = Row { entries: [(Slot(0), 0.0); MOST_ROW_NODES], len: 0 };

    /// Adds `weight` on the node in `slot`. Beyond the last place it goes to the heaviest entry, so that the sum stays.
    pub fn add(&mut self, slot: Slot, weight: Real) {
        let len = self.len as usize;
        if let Some(entry) = self.entries[..len].iter_mut().find(|e| e.0 == slot) {
            entry.1 += weight;
        } else if len < MOST_ROW_NODES {
            self.entries[len] = (slot, weight);
            self.len += 1;
        } else if let Some(entry) = self.entries.iter_mut().max_by(|a, b| a.1.total_cmp(&b.1)) {
            entry.1 += weight;
        }
    }

    /// Of the first `len` of these, no slot twice.
    #[inline(always)]
    pub fn of(slots: &[Slot; MOST_ROW_NODES], weights: &[Real; MOST_ROW_NODES], len: usize) -> Self {
        Self { entries: std::array::from_fn(|i| (slots[i], weights[i])), len: len as u32 }
    }

    /// Slots and weights.
    pub fn entries(&self) -> &[(Slot, Real)] {
        &self.entries[..self.len as usize]
    }

    /// Whether there is no place left.
    pub fn is_full(&self) -> bool {
        self.len as usize == MOST_ROW_NODES
    }

    /// Number of the entry of the node in `slot`, which is added with no weight where there is none yet.
    fn entry_of(&mut self, slot: Slot) -> Option<u32> {
        let known = |row: &Self| row.entries().iter().position(|e| e.0 == slot);
        if known(self).is_none() && !self.is_full() {
            self.add(slot, 0.0);
        }
        known(self).map(|entry| entry as u32)
    }

    /// `Σ b_i field_i`, of every fourth entry each: in one sum each term would wait for the one before.
    #[inline(always)]
    pub fn interpolate(&self, field: &[Padded]) -> Vec3 {
        let [mut s, mut t, mut u, mut v] = [[0.0; 4]; 4];
        let add = |sum: &mut Padded, &(n, b): &(Slot, Real)| {
            let x = &field[n.index()];
            for c in 0..4 {
                sum[c] += b * x[c];
            }
        };
        let (fours, rest) = self.entries().as_chunks::<4>();
        for [a, b, c, d] in fours {
            add(&mut s, a);
            add(&mut t, b);
            add(&mut u, c);
            add(&mut v, d);
        }
        rest.iter().for_each(|entry| add(&mut s, entry));
        let total = |c: usize| (s[c] + t[c]) + (u[c] + v[c]);
        Vec3::new(total(0), total(1), total(2))
    }

    /// `Σ b_i field_i` of numbers, likewise.
    #[inline(always)]
    pub fn sum(&self, field: &[Real]) -> Real {
        let [mut s, mut t, mut u, mut v] = [0.0; 4];
        let of = |&(n, b): &(Slot, Real)| b * field[n.index()];
        let (fours, rest) = self.entries().as_chunks::<4>();
        for [a, b, c, d] in fours {
            s += of(a);
            t += of(b);
            u += of(c);
            v += of(d);
        }
        rest.iter().for_each(|entry| s += of(entry));
        (s + t) + (u + v)
    }
}

/// What keeps a surface point from sliding along a tool: Coulomb's friction. While the point sticks, its tangential gap
/// from the anchor, `q(t) + Σ_j G_j τ_j − a(t)`, is zero; the tangential multiplier τ is at most μ λ.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Friction {
    /// Coefficient μ; 0 lets the point slide freely.
    pub coefficient: Real,
    /// Tangential compliances over the normal ones: `(2 − ν)/(2 (1 − ν))` for a half-space.
    pub compliance: Real,
    /// Where `a` is at the start of the tick [m].
    pub anchor: Vec3,
    /// How fast it moves with the tool [m/s].
    pub rate: Vec3,
    /// Force along the surface that the tool puts on the body, to start from [N].
    pub multiplier: Vec3,
    /// Its mean over the sub-steps of the tick [N]: the solver's answer.
    pub mean_multiplier: Vec3,
}

/// The virtual coupling: springs without mass between the device and the tool, so that nothing feels stiffer than the
/// device can render [Colgate et al. 1995].
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Coupling {
    /// How far a force moves the tool [m/N]; 0 holds it rigidly.
    pub compliance: Real,
    /// How far a torque about the reference point turns it [rad/(N·m)]; 0 leaves it the orientation of the device.
    pub angular_compliance: Real,
}

impl Coupling {
    /// None: the tool is where the device is.
    pub const RIGID: Self = Self { compliance: 0.0, angular_compliance: 0.0 };
}

/// What holds a tool's jaws: a spring between the angle at which a client holds them and that of the simulated ones.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Grip {
    /// Angle between them that the client asks for, more than where they are closed [rad].
    pub free: Real,
    /// How far a moment opens them [rad/(N·m)].
    pub compliance: Real,
    /// Farthest that they open [rad].
    pub most: Real,
}

impl Grip {
    /// Angle between the jaws [rad] where their points put that `moment` [N·m] on the body: between stops.
    pub fn angle(&self, moment: Real) -> Real {
        (self.free - self.compliance * moment).max(0.0).min(self.most)
    }
}

/// What holds a tool, and its jaws.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Held {
    /// The tool.
    pub coupling: Coupling,
    /// Its jaws.
    pub grip: Grip,
}

/// What a tool's points put on the body in all: `Σ_j f_j`, `Σ_j r_j × f_j` and `Σ_j l_j · f_j` over its constraints, `f_j = n_j λ_j + τ_j`.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Pushed {
    /// [N].
    pub force: Vec3,
    /// About the tool's reference point [N·m].
    pub torque: Vec3,
    /// For the angle between its jaws [N·m].
    pub grip: Real,
}

impl Pushed {
    /// Adds `force` [N] at `arm` from the reference point [m], with `lever` [m/rad].
    pub fn add(&mut self, arm: &Vec3, lever: &Vec3, force: &Vec3) {
        self.force += force;
        self.torque += arm.cross(force);
        self.grip += lever.dot(force);
    }

    /// How far [m] a tool that hangs by `held` gives way at `arm` [m] with `lever` [m/rad] to this instead of `before`, away from
    /// the body.
    pub fn give(&self, before: &Pushed, held: &Held, arm: &Vec3, lever: &Vec3) -> Vec3 {
        let Held { coupling, grip } = held;
        (self.force - before.force) * coupling.compliance
            + ((self.torque - before.torque) * coupling.angular_compliance).cross(arm)
            + lever * (grip.angle(before.grip) - grip.angle(self.grip))
    }
}

/// One unilateral constraint `n·q(t) + d ≥ offset + rate·t`, `λ ≥ 0`, on the surface point `q`, whose dent `d` is
/// `Σ_j G_j λ_j`; `t` [s] from the start of the tick. The multiplier λ [N] is the force along `normal`
/// that the tool puts on the body.
#[derive(Clone, Copy, Debug)]
pub struct Constraint {
    /// The surface point.
    pub row: Row,
    /// Unit vector from the tool towards the surface.
    pub normal: Vec3,
    /// Least `n·q` at the start of the tick [m].
    pub offset: Real,
    /// How fast that grows [m/s]: the tool's own speed, and the gradual closing of a gap found late.
    pub rate: Real,
    /// Number of the tool's first constraint in the list.
    pub first: u32,
    /// Compliances `G_j` [m/N] in series: what a newton at the tool's `j`-th constraint adds here to the dent that the
    /// mesh is too coarse to show.
    pub compliance: [Real; MOST_POINTS],
    /// The tool.
    pub tool: ToolId,
    /// Which display triangle it is on, and of which part of the tool: the triangle's number plus, for each part of the tool before its
    /// own, that of all triangles.
    pub point: u32,
    /// Multiplier to start from [N].
    pub multiplier: Real,
    /// Mean multiplier over the sub-steps of the tick [N]: the solver's answer.
    pub mean_multiplier: Real,
    /// What acts along the surface.
    pub friction: Friction,
    /// From the tool's reference point to where the surface point is met [m].
    pub arm: Vec3,
    /// How the place of the tool there moves as the angle between its jaws grows [m/rad].
    pub lever: Vec3,
    /// What holds the tool.
    pub held: Held,
    /// What [`Constraint::offset`] and [`Friction::anchor`] allow for already.
    pub allowed_for: Pushed,
    /// Time within which the gap is closed [s], at least one step of the contact. Where the elements are kicked less often than
    /// the contact is solved, closing it within each solve would push twice as much after a kick and not at all before the
    /// next; zero for tools, whose compliance has that effect.
    pub horizon: Real,
}

impl Constraint {
    /// How far the surface gives way here below the mesh's size [m] under the multipliers of the tool's constraints, `own`.
    pub fn dent<'a>(&self, own: impl IntoIterator<Item = &'a Constraint>) -> Real {
        self.compliance.iter().zip(own).map(|(g, other)| g * other.multiplier).sum()
    }
}

/// Most entries of a row that a [`Foot`] moves: nodes of an element, or what these hang on.
const MOST_FOOT_NODES: usize = 40;

/// How the other side of a constraint between two organs goes along with the first: its row holds both sides, that of the first with
/// positive weights and that of the other with negative ones. While they slide along each other, the place of the other organ that
/// the first one meets is another; two forces that act in two places would turn both.
#[derive(Clone, Copy, Debug)]
pub struct Foot {
    /// Numbers of entries of the row, and how their weights change with the place [1/m]: `Σ g = 0`, and `Σ x gᵀ` is the identity.
    gradients: [(u32, Vec3); MOST_FOOT_NODES],
    len: u32,
}

impl Foot {
    /// That stays.
    pub const FIXED: Self = Self { gradients: [(0, Vec3::new(0.0, 0.0, 0.0)); MOST_FOOT_NODES], len: 0 };

    /// The weight of the node in `slot` of `row` changes by `gradient` [1/m]; false where there is no room.
    pub fn add(&mut self, row: &mut Row, slot: Slot, gradient: Vec3) -> bool {
        let Some(entry) = row.entry_of(slot) else { return false };
        let len = self.len as usize;
        if let Some(known) = self.gradients[..len].iter_mut().find(|known| known.0 == entry) {
            known.1 += gradient;
        } else if len < MOST_FOOT_NODES {
            self.gradients[len] = (entry, gradient);
            self.len += 1;
        } else {
            return false;
        }
        true
    }

    /// Has the other side of `row` where the first is, with nodes at these `positions` [m]: its place is then zero. What it was [m].
    pub fn follow(&self, row: &mut Row, positions: &[Padded]) -> Vec3 {
        let apart = row.interpolate(positions);
        let gradients = &self.gradients[..self.len as usize];
        let mut moved = Mat3::zeros();
        for (entry, g) in gradients {
            let x = &positions[row.entries[*entry as usize].0.index()];
            moved += Vec3::new(x[0], x[1], x[2]) * g.transpose();
        }
        let Some(weights) = moved.try_inverse().map(|inverse| inverse * apart) else { return Vec3::zeros() };
        for (entry, g) in gradients {
            row.entries[*entry as usize].1 -= g.dot(&weights);
        }
        apart
    }
}

/// What is remembered of a contact point from tick to tick.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct PointMemory {
    /// [`Constraint::point`].
    pub point: u32,
    /// Last multiplier [N].
    pub multiplier: Real,
    /// Overlap that has not been closed yet [m].
    pub slack: Real,
    /// What changes of resolution have made of the dent more (below zero) or less, and how far the tool has come while the body
    /// stood still, as far as neither is followed yet [m].
    pub shift: Real,
    /// [`Constraint::dent`] after the last tick [m].
    pub dent: Real,
    /// Where its row was after the last tick [m].
    pub place: Vec3,
    /// Variance of its load as the mesh showed it [m²].
    pub shown: Real,
    /// Last normal, from the tool towards the surface.
    pub normal: Vec3,
    /// Last force along the surface [N].
    pub tangential: Vec3,
    /// The place of the tool, in its own frame [m], that the point sticks to.
    pub anchor: Vec3,
    /// Barycentric weights of the point in its display triangle.
    pub weights: [Real; 3],
    /// The place of the tool's core that it is next to: on an axis, the part of it; else in the frame of its part [m].
    pub core: Vec3,
}
