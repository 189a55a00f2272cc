//! The body as it moves: the active nodes, the elements that touch them, and what hangs on them.
//!
//! One energy for the whole body: `U = Σ w_t vol_t W(F_t)` over the elements of all levels with an active vertex,
//! `w_t` the active part of their vertices. An element's other vertices are interface nodes, placed by their rows; the
//! force on one goes back to its masters through the same weights. Forces are therefore the gradient of `U`, which the
//! printed method's are not.
//!
//! Everything here is sized once. What changes with the resolution changes where it changes, and only there.

mod classes;
pub mod contact_row;
mod display;
mod estimate;
mod masses;
mod momentum;
mod reshape;
mod residual;
mod saving;
pub mod skin;
mod stiffness;
mod supports;

pub use display::{Embedding, MOST_ASIDE};
use masses::MASS_UNITS;
use momentum::ByOrgan;
pub use momentum::Momenta;
pub use reshape::ChangeCost;
use residual::NO_RESIDUAL;
pub use residual::{Loads, RESIDUAL_KEPT};
use stiffness::Materials;
pub use stiffness::Stiffening;
use supports::Supports;

use contact_row::Surroundings;

use super::active_set::ActiveSet;
use super::body::Body;
use super::constraint::{MOST_OBSTACLES, MOST_POINTS, MOST_TOOLS};
use super::element::ElementConstants;
use super::element_kernel::Padded;
use super::element_pool::{CLASSES, ElementPool, StarPool};
use super::interface::{InterfaceRow, Search};
use super::material::Material;
use super::meeting::MOST_MEETINGS;
use super::state::State;
use super::step_class::Residual;
use super::sweeps::{self, Registers};
use crate::geometry::tet_mesh::gradients;
use crate::ids::{Element, Node, OrganId, Slot, Vertex};
use crate::math::{Bounds, Real, Vec3};
use crate::visited::Visited;

/// Motion and mass by slot: active nodes and interface nodes alike.
#[derive(Debug)]
pub struct Motion {
    /// World positions [m].
    pub position: Vec<Padded>,
    /// Velocities [m/s]; those of interface nodes are not kept.
    pub velocity: Vec<Padded>,
    /// Forces under way [N], zero between events.
    pub force: Vec<Padded>,
    /// Forces that changes of resolution have left to fade [N], see [`ActiveMesh::apply_under`]; of active nodes.
    pub residual: Vec<Residual<Padded>>,
    /// [1/kg]; 0 for nodes that are held fast and for interface nodes.
    pub inverse_mass: Vec<Real>,
    /// [kg]; 0 for interface nodes.
    pub mass: Vec<Real>,
}

/// The body as it moves.
#[derive(Debug)]
pub struct ActiveMesh {
    set: ActiveSet,
    pool: ElementPool,
    /// The active nodes' stars, where the body has any.
    stars: StarPool,
    /// Motion and mass by slot.
    pub motion: Motion,
    /// Slot of each node, or [`Slot::NONE`].
    slot: Vec<Slot>,
    /// Active vertices of each element; 0 when it is not in use.
    active_vertices: Vec<u8>,
    /// `ω²` at rest [1/s²] of the elements in use, the Maxwell branches' share included.
    omega_squared: Vec<Real>,
    /// The same of the stars in use, by node; none where the body has no stars.
    star_omega_squared: Vec<Real>,
    /// By node: part α of the energy of strain jumps that its star leaves to tetrahedra.
    star_stabilisation: Vec<Real>,
    /// Node of each slot, where that is at rest [m], and its organ.
    node: Vec<Node>,
    rest: Vec<Vec3>,
    organ: Vec<OrganId>,
    /// In units, by slot: mass of the slot's own elements; what hangs on it; and what of its own it has handed on.
    own_mass: Vec<i64>,
    gathered_mass: Vec<i64>,
    handed_mass: Vec<i64>,
    /// Rows of the interface nodes' slots, masters as slots.
    row: Vec<InterfaceRow<Slot>>,
    /// By slot: the row's [`InterfaceRow::reach_squared`] [m²], infinite without a row. All are looked at in each change.
    reach: Vec<Real>,
    /// Springs' share of `ω²` [1/s²] by slot.
    springs: Vec<Real>,
    /// Place of each slot in `active` or `interface`.
    place: Vec<u32>,
    active: Vec<Slot>,
    interface: Vec<Slot>,
    free: Vec<Slot>,
    embedded: Vec<Embedding>,
    /// By display vertex: offset [m] of the displayed from the embedded place; what a change of resolution leaves, faded to zero.
    pub geomorph: Vec<Padded>,
    /// By slot: where the node was when its place was noted.
    noted: Vec<Padded>,
    morphing: Vec<Vertex>,
    extrapolated: Vec<Vertex>,
    lever: Real,
    /// Whether a node has a residual force.
    residuals: bool,
    /// Whether nothing holds an organ: neither supports nor fixed nodes.
    free_organs: ByOrgan<bool>,
    /// Counts up with every change of a class's elements, and with every change of interface rows (all classes).
    revision: [u32; CLASSES],
    /// By organ [kg].
    mass_unit: Vec<Real>,
    /// Longest side of the surface's bounding box at rest [m].
    size: Real,
    row_entries: u32,
    registers: Registers,
    supports: Supports,
    stiffest_spring: Real,
    /// By node: what is around it steps in this class at least; none where the body is a single organ.
    least_class: Vec<u8>,
    /// Nodes around which that is more than 0.
    held_alike: Vec<Node>,
    /// The points that they carry, ...
    alike_points: Vec<u32>,
    /// ... as long as the elements around them are those that were looked at.
    alike_is_known: bool,
    materials: Materials,
    /// Factor on the viscosities and the Maxwell branches of all tissues.
    pub damping: Real,
    work: Work,
}

/// Memory that a change of resolution needs and no one keeps.
#[derive(Debug)]
struct Work {
    search: Search,
    /// There but while it is used.
    around: Option<Surroundings>,
    on: Vec<(Node, Vec3, Vec3)>,
    off: Vec<Node>,
    elements: Vec<Element>,
    nodes: Vec<Node>,
    /// Slots of the star of one node.
    star: Vec<Slot>,
    entering: Vec<Element>,
    leaving: Vec<Element>,
    dirty: Vec<Slot>,
    /// What the change has looked at.
    noted_nodes: Visited,
    noted_elements: Visited,
    noted_stars: Visited,
    /// Slots whose nodes the change puts elsewhere, with where they were [m], by slot.
    moved: Vec<Slot>,
    was: Vec<Padded>,
    moved_slots: Visited,
    /// Display vertices that may hang elsewhere, or on what has moved.
    revisited: Vec<Vertex>,
    noted_vertices: Visited,
    concerned: Vec<Element>,
    concerned_stars: Vec<Node>,
    /// Forces of one element on its nodes [N].
    weighed: Vec<(Slot, Vec3)>,
    handed: Vec<Residual<Vec3>>,
    /// Of each change, at rest [m].
    boxes: Vec<Bounds>,
    /// Points that push, at rest [m], and the squared support of their rows [m²]; whether changes are as near.
    loaded: Vec<(Vec3, Real)>,
    near: Vec<bool>,
}

fn vec3(p: &Padded) -> Vec3 {
    Vec3::new(p[0], p[1], p[2])
}

fn padded(v: Vec3) -> Padded {
    [v.x, v.y, v.z, 0.0]
}

impl ActiveMesh {
    /// `body` as `state` says; room for at most `most_elements` elements in use at once.
    ///
    /// # Errors
    /// When the state does not fit the body.
    pub fn new(body: &Body, state: &State, most_elements: usize) -> Result<Self, String> {
        let capacity = most_elements.min(body.element_count()).max(body.elements_of(0).len());
        // A connected mesh of tetrahedra has at most as many nodes as elements, and three more.
        let slots = (capacity + 64).min(body.node_count());
        let vertices = body.surface().vertices.len();
        let Bounds { low, high } = body.surface().bounds();
        let nowhere = Embedding { element: Element::NONE, slots: [Slot::NONE; 4], weights: [0.0; 4], spacing: 0.0 };
        let list = || Vec::with_capacity(slots);
        // Stars come before others leave; each is around a node with a slot.
        let (plain, branches) = (body.stars().is_empty(), body.maxwell().len());
        let materials = &body.parts().materials;
        let of_stars = if plain { 0 } else { slots };
        let mut mesh = Self {
            set: ActiveSet::uniform(body, 0),
            pool: ElementPool::new(body.element_count(), capacity, slots, branches).of_materials(materials),
            stars: StarPool::with_spokes(body.node_count(), of_stars, slots, body.stars().most_neighbours(), branches)
                .of_materials(materials),
            motion: Motion {
                position: vec![[0.0; 4]; slots],
                velocity: vec![[0.0; 4]; slots],
                force: vec![[0.0; 4]; slots],
                residual: vec![NO_RESIDUAL; slots],
                inverse_mass: vec![0.0; slots],
                mass: vec![0.0; slots],
            },
            slot: vec![Slot::NONE; body.node_count()],
            active_vertices: vec![0; body.element_count()],
            omega_squared: vec![0.0; body.element_count()],
            star_omega_squared: vec![0.0; if plain { 0 } else { body.node_count() }],
            star_stabilisation: vec![0.0; if plain { 0 } else { body.node_count() }],
            node: vec![Node::NONE; slots],
            rest: vec![Vec3::zeros(); slots],
            organ: vec![OrganId::NONE; slots],
            own_mass: vec![0; slots],
            gathered_mass: vec![0; slots],
            handed_mass: vec![0; slots],
            row: vec![InterfaceRow::empty(); slots],
            reach: vec![Real::INFINITY; slots],
            springs: vec![0.0; slots],
            place: vec![0; slots],
            active: list(),
            interface: list(),
            free: list(),
            embedded: vec![nowhere; vertices],
            geomorph: vec![[0.0; 4]; vertices],
            noted: vec![[0.0; 4]; slots],
            morphing: Vec::with_capacity(vertices),
            extrapolated: Vec::with_capacity(vertices),
            lever: 1.0,
            residuals: false,
            free_organs: std::array::from_fn(|organ| {
                let of_it = |n: &Node| body.organ_of(*n).index() == organ;
                let fixed = body.nodes().filter(of_it).any(|n| body.is_fixed(n));
                // Every level carries every display vertex, or the next coarser one does.
                let supported = body.supports().iter().any(|hold| of_it(&body.coarsest_carrier(hold.vertex)));
                organ < body.organs().len() && !supported && !fixed
            }),
            revision: [0; CLASSES],
            mass_unit: body.organs().iter().map(|organ| organ.mass / MASS_UNITS).collect(),
            size: (high - low).max(),
            row_entries: 0,
            registers: Registers::best(),
            supports: Supports::new(body),
            stiffest_spring: 0.0,
            least_class: vec![0; body.node_count()],
            held_alike: Vec::with_capacity(body.node_count()),
            alike_points: Vec::with_capacity(2 * MOST_MEETINGS),
            alike_is_known: false,
            materials: Materials::new(body),
            damping: 1.0,
            work: Work {
                search: Search::new(body),
                around: Some(Surroundings::new(body)),
                on: Vec::with_capacity(slots),
                off: Vec::with_capacity(slots),
                elements: Vec::with_capacity(body.element_count()),
                nodes: Vec::with_capacity(body.node_count()),
                star: Vec::with_capacity(1 + body.stars().most_neighbours()),
                entering: Vec::with_capacity(capacity),
                leaving: Vec::with_capacity(capacity),
                dirty: list(),
                noted_nodes: Visited::new(body.node_count()),
                noted_elements: Visited::new(body.element_count()),
                noted_stars: Visited::new(if plain { 0 } else { body.node_count() }),
                moved: list(),
                was: vec![[0.0; 4]; slots],
                moved_slots: Visited::new(slots),
                revisited: Vec::with_capacity(vertices),
                noted_vertices: Visited::new(vertices),
                concerned: Vec::with_capacity(body.element_count()),
                concerned_stars: Vec::with_capacity(if plain { 0 } else { body.node_count() }),
                weighed: Vec::with_capacity(4.max(1 + body.stars().most_neighbours())),
                handed: Vec::with_capacity(slots),
                boxes: Vec::with_capacity(slots),
                loaded: Vec::with_capacity(MOST_POINTS * (MOST_TOOLS + MOST_OBSTACLES)),
                near: Vec::with_capacity(MOST_POINTS * (MOST_TOOLS + MOST_OBSTACLES)),
            },
        };
        let set = ActiveSet::from_nodes(body, &state.nodes)
            .ok_or_else(|| format!("the {} active nodes of the state do not cover the body once", state.nodes.len()))?;
        mesh.check(body, &set, state)?;
        mesh.restore(body, state);
        Ok(mesh)
    }

    /// The active nodes, as a set.
    pub fn set(&self) -> &ActiveSet {
        &self.set
    }

    /// The elements in use.
    pub fn pool(&self) -> &ElementPool {
        &self.pool
    }

    /// Adds the elastic and viscous forces of one class's elements to [`Motion::force`].
    pub fn add_forces(
        &mut self,
        path: super::element_kernel::Simd,
        class: usize,
        rates: &super::element_kernel::Rates,
    ) -> super::element_kernel::Extremes {
        let Motion { position, force, .. } = &mut self.motion;
        let extremes = self.pool.add_forces(path, class, rates, position, force);
        extremes.join(&self.stars.add_forces(path, class, rates, position, force))
    }

    /// The stars in use: of the active nodes, where the body has any.
    pub fn stars(&self) -> &StarPool {
        &self.stars
    }

    /// Evaluations that one step of `class` takes, counted in tetrahedra.
    pub fn evaluations(&self, class: usize) -> u32 {
        (self.pool.count(class) + STAR_EVALUATIONS * self.stars.count(class)) as u32
    }

    /// Slots of the active nodes.
    pub fn active(&self) -> &[Slot] {
        &self.active
    }

    /// Slots of the interface nodes.
    pub fn interface(&self) -> &[Slot] {
        &self.interface
    }

    /// Node in `slot`.
    pub fn node(&self, slot: Slot) -> Node {
        self.node[slot.index()]
    }

    /// Slot of node `n`, if it has one.
    pub fn slot(&self, n: Node) -> Option<Slot> {
        Some(self.slot[n.index()]).filter(|s| *s != Slot::NONE)
    }

    /// True when `slot` holds an active node.
    pub fn is_master(&self, slot: Slot) -> bool {
        self.set.is_active(self.node[slot.index()])
    }

    /// Row of the interface node in `slot`; masters are slots.
    pub fn row(&self, slot: Slot) -> &InterfaceRow<Slot> {
        &self.row[slot.index()]
    }

    /// Entries of all interface rows.
    pub fn row_entries(&self) -> u32 {
        self.row_entries
    }

    /// Active vertices of element `e`, 0 when it is not in use.
    pub fn active_vertices(&self, e: Element) -> u8 {
        self.active_vertices[e.index()]
    }

    /// Changes whenever the elements of `class`, or what they hang on, change.
    pub fn revision(&self, class: usize) -> u32 {
        self.revision[class]
    }

    /// Places the interface nodes of `slots` where their masters say.
    pub fn place_these(&mut self, slots: &[Slot]) {
        sweeps::place(self.registers, &self.row, slots, &mut self.motion.position);
    }

    /// Places all interface nodes.
    pub fn place_interface(&mut self) {
        let slots = std::mem::take(&mut self.interface);
        self.place_these(&slots);
        self.interface = slots;
    }

    /// Hands the forces on the interface nodes of `slots` to their masters.
    pub fn hand_back(&mut self, slots: &[Slot]) {
        sweeps::hand_back(self.registers, &self.row, slots, &mut self.motion.force);
    }

    /// Hands the forces on all interface nodes to their masters.
    pub fn hand_back_all(&mut self) {
        let slots = std::mem::take(&mut self.interface);
        self.hand_back(&slots);
        self.interface = slots;
    }

    /// Registers that sweeps over its nodes use.
    pub fn registers(&self) -> Registers {
        self.registers
    }

    /// Slots of the active nodes, and their motion to be changed.
    pub fn active_motion(&mut self) -> (&[Slot], &mut Motion) {
        (&self.active, &mut self.motion)
    }

    /// World position of node `n` [m], if it has a slot.
    pub fn position_of(&self, n: Node) -> Option<Vec3> {
        self.slot(n).map(|s| vec3(&self.motion.position[s.index()]))
    }

    /// World position of the node in `slot` [m].
    pub fn position(&self, slot: Slot) -> Vec3 {
        vec3(&self.motion.position[slot.index()])
    }

    /// True when no number that moves is infinite or not a number.
    pub fn is_finite(&self) -> bool {
        let moves = |s: &Slot| {
            let s = s.index();
            // A product with zero is zero for every finite number, and not a number for the others.
            let sum = |p: &Padded| p[0] * 0.0 + p[1] * 0.0 + p[2] * 0.0;
            sum(&self.motion.position[s]) + sum(&self.motion.velocity[s]) == 0.0
        };
        self.active.iter().all(moves)
    }

    /// Gives the active nodes other positions and velocities: `change(node, position, velocity)`. For tests, studies
    /// and for settling a body before it is served.
    pub fn change_motion(&mut self, mut change: impl FnMut(Node, &mut Vec3, &mut Vec3)) {
        for i in 0..self.active.len() {
            let s = self.active[i].index();
            let (mut x, mut v) = (vec3(&self.motion.position[s]), vec3(&self.motion.velocity[s]));
            change(self.node[s], &mut x, &mut v);
            self.motion.position[s] = padded(x);
            self.motion.velocity[s] = padded(v);
        }
        self.place_interface();
    }

    /// An unused slot, for node `n`; its motion and masses start from nothing.
    fn take_slot(&mut self, body: &Body, n: Node) -> Slot {
        // Whoever plans a change asks for room first, and restoring counts.
        debug_assert!(!self.free.is_empty());
        let slot = self.free.pop().unwrap_or_default();
        let s = slot.index();
        self.slot[n.index()] = slot;
        self.node[s] = n;
        self.rest[s] = body.rest(n);
        self.organ[s] = body.organ_of(n);
        self.own_mass[s] = 0;
        self.gathered_mass[s] = 0;
        self.handed_mass[s] = 0;
        self.set_row(slot, InterfaceRow::empty());
        self.motion.position[s] = [0.0; 4];
        self.motion.velocity[s] = [0.0; 4];
        self.motion.residual[s] = NO_RESIDUAL;
        self.motion.mass[s] = 0.0;
        self.motion.inverse_mass[s] = 0.0;
        self.springs[s] = 0.0;
        slot
    }

    fn enlist(&mut self, slot: Slot, active: bool) {
        let list = if active { &mut self.active } else { &mut self.interface };
        self.place[slot.index()] = list.len() as u32;
        list.push(slot);
        if !active {
            self.motion.mass[slot.index()] = 0.0;
            self.motion.inverse_mass[slot.index()] = 0.0;
            self.motion.velocity[slot.index()] = [0.0; 4];
            self.motion.residual[slot.index()] = NO_RESIDUAL;
            self.springs[slot.index()] = 0.0;
        }
    }

    fn delist(&mut self, slot: Slot, active: bool) {
        let list = if active { &mut self.active } else { &mut self.interface };
        let place = self.place[slot.index()];
        list.swap_remove(place as usize);
        if let Some(&moved) = list.get(place as usize) {
            self.place[moved.index()] = place;
        }
    }

    /// Gives the interface node in `slot` its row, and hands its mass to its masters:
    /// `m_j = Σ_i |P_ij| s_i m_i`, `s_i = Σ_k |P_ik|`, a diagonal that bounds `PᵀMP`, so that the step limit of the
    /// elements holds for the coupled system.
    fn make_row(&mut self, body: &Body, slot: Slot) {
        let row = self.work.search.row(body, &self.set, self.node[slot.index()]);
        let row = row.renumbered(|n| self.slot[n.index()]);
        self.set_row(slot, row);
        self.handed_mass[slot.index()] = self.own_mass[slot.index()];
        self.hand_mass(slot, 1);
        self.row_entries += self.row[slot.index()].entries().count() as u32;
    }

    fn drop_row(&mut self, slot: Slot) {
        self.row_entries -= self.row[slot.index()].entries().count() as u32;
        self.hand_mass(slot, -1);
        self.handed_mass[slot.index()] = 0;
        self.set_row(slot, InterfaceRow::empty());
    }

    fn set_row(&mut self, slot: Slot, row: InterfaceRow<Slot>) {
        self.reach[slot.index()] = if row.is_empty() { Real::INFINITY } else { row.reach_squared * (1.0 + 1e-12) };
        self.row[slot.index()] = row;
    }
}

/// Evaluations of a tetrahedron that take as long as one of a star of 14 neighbours: see the benchmarks.
pub const STAR_EVALUATIONS: usize = 3;

/// Rest gradients and weighted stiffness of element `e` of what it has of `material` with `active` active vertices.
fn constants(body: &Body, material: &Material, e: Element, active: u8) -> ElementConstants {
    let [_, g1, g2, g3] = gradients(&body.corners(e));
    let weight = body.volume(e) * Real::from(active) / 4.0;
    let material = body.of_jumps(material, e, active);
    ElementConstants {
        gradient: [g1, g2, g3].map(Into::into),
        lambda: weight * material.lambda,
        mu: weight * material.mu,
        neo_hookean: material.neo_hookean,
        collapse: material.collapse,
        fibres: material.fibres.rows(weight),
    }
}
