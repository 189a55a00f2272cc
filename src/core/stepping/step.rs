//! The step: asynchronous variational integration [Lew, Marsden, Ortiz & West 2003].
//!
//! Nodes drift freely; in the middle of each of its steps an element brings its nodes to the present, evaluates its
//! force once and gives each node its impulse. No two classes of steps have a middle in common, and the events of a tick
//! lie symmetrically about its middle: the scheme is symplectic and of second order without damping. Contact is held at
//! the next event of its own class. What changes of resolution have left held acts at the events of the class that it stands
//! for.

use super::constraint_solve;
use super::work::{Laps, Part};
use crate::ids::Slot;
use crate::math::{Real, Vec3};
use crate::model::active_mesh::Motion;
use crate::model::constraint::Foot;
use crate::model::element_kernel::{Extremes, Rates, Simd};
use crate::model::element_pool::CLASSES;
use crate::model::step_class::{self, Residual, STEP_VISCOSITY, TICK};
use crate::model::sweeps::{self, Falling, Registers};
use crate::model::{ActiveMesh, Body, Constraint};
use crate::visited::Visited;

/// Nodes that the elements of one class concern.
#[derive(Debug, Default)]
struct Concerned {
    active: Vec<Slot>,
    interface: Vec<Slot>,
    /// Entries of the interface nodes' rows.
    entries: u32,
    revision: Option<u32>,
}

/// Memory that the step needs and no one keeps.
#[derive(Debug)]
pub struct Workspace {
    /// Time of each slot's position [s] since the start of the tick.
    time: Vec<Real>,
    solve: constraint_solve::Workspace,
    concerned: Vec<Concerned>,
    /// Slots that have been noted.
    noted: Visited,
    contact_nodes: Vec<Slot>,
    /// Active nodes that something is held on.
    residual: Residual<Vec<Slot>>,
}

impl Workspace {
    /// For `mesh` and at most `constraints` points at a time.
    pub fn new(mesh: &ActiveMesh, constraints: usize) -> Self {
        let slots = mesh.motion.mass.len();
        let list = || Vec::with_capacity(slots);
        Self {
            time: vec![0.0; slots],
            solve: constraint_solve::Workspace::new(constraints, slots),
            concerned: (0..CLASSES)
                .map(|_| Concerned { active: list(), interface: list(), entries: 0, revision: None })
                .collect(),
            noted: Visited::new(slots),
            contact_nodes: list(),
            residual: std::array::from_fn(|_| list()),
        }
    }
}

/// What no step changes.
#[derive(Clone, Copy, Debug)]
pub struct World<'a> {
    /// Form of the kernel; it makes no difference but of time.
    pub path: Simd,
    /// The body.
    pub body: &'a Body,
    /// [m/s²].
    pub gravity: Vec3,
}

/// What pushes the body within a tick.
#[derive(Debug)]
pub struct Pushing<'a> {
    /// Points that are pushed.
    pub constraints: &'a mut [Constraint],
    /// Other sides of the last of them, which are between organs.
    pub feet: &'a [Foot],
    /// They are held by the steps of this class, [`ActiveMesh::contact_class`].
    pub class: usize,
}

impl Default for Pushing<'_> {
    /// Nothing.
    fn default() -> Self {
        Self { constraints: &mut [], feet: &[], class: 0 }
    }
}

/// What is due within a tick.
#[derive(Clone, Copy, Debug)]
struct Due {
    /// When [s].
    now: Real,
    /// The elements of this class.
    class: usize,
    /// And the supports.
    held: bool,
}

/// Moves `mesh` by one tick, and tells `laps` what it does, and leaves the mean multiplier of each constraint over the
/// tick.
pub fn tick(
    world: &World,
    mesh: &mut ActiveMesh,
    pushing: Pushing,
    work: &mut Workspace,
    laps: &mut dyn Laps,
) -> Extremes {
    let (World { body, gravity, .. }, Pushing { constraints, feet, class: contact }) = (*world, pushing);
    let mut extremes = Extremes::REST;
    let finest = mesh.finest_class();
    let holds = mesh.support_class(body);
    collect_residuals(mesh, work);
    let mut deepest = finest.max(work.residual.iter().rposition(|slots| !slots.is_empty()).unwrap_or(0));
    if !constraints.is_empty() {
        deepest = deepest.max(contact);
        collect_contact_nodes(constraints, work);
        constraint_solve::follow(mesh, constraints, feet);
        constraint_solve::prepare(mesh, constraints, &mut work.solve);
    }
    if !body.supports().is_empty() {
        deepest = deepest.max(holds);
    }
    for c in constraints.iter_mut() {
        (c.mean_multiplier, c.friction.mean_multiplier) = (0.0, Vec3::zeros());
    }
    // Class c is due at the odd multiples of half its step.
    let halves = 2u32 << deepest;
    for i in 1..halves {
        let now = TICK * Real::from(i) / Real::from(halves);
        let class = deepest - i.trailing_zeros() as usize;
        let held = class == holds && !body.supports().is_empty();
        let touched = class == contact && !constraints.is_empty();
        if mesh.is_used(class) || held || !&work.residual[class].is_empty() {
            let elements = event(world, mesh, Due { now, class, held }, work, laps);
            extremes = extremes.join(&elements);
        }
        if touched {
            let step = step_class::step_of(class);
            drift(&work.contact_nodes, &mut work.time, mesh, gravity, now);
            constraint_solve::follow(mesh, constraints, feet);
            constraint_solve::solve(mesh, constraints, &mut work.solve, step, now + step);
            for c in constraints.iter_mut() {
                c.mean_multiplier += c.multiplier;
                c.friction.mean_multiplier += c.friction.multiplier;
            }
            laps.lap(Part::Solve, constraints.len() as u32);
        }
    }
    drift_all(&mut work.time, mesh, gravity, TICK);
    mesh.active().iter().for_each(|s| work.time[s.index()] = 0.0);
    laps.lap(Part::Node, mesh.active().len() as u32);
    mesh.place_interface();
    laps.lap(Part::Row, mesh.row_entries());
    let solves = Real::from(1u32 << contact);
    for c in constraints.iter_mut() {
        c.mean_multiplier /= solves;
        c.friction.mean_multiplier /= solves;
    }
    extremes
}

/// Moves what is `due`.
fn event(world: &World, mesh: &mut ActiveMesh, due: Due, work: &mut Workspace, laps: &mut dyn Laps) -> Extremes {
    let (World { path, body, gravity }, Due { now, class, held }) = (*world, due);
    let step = step_class::step_of(class);
    let (rates, registers) = (rates(body, mesh.damping, step), mesh.registers());
    let residual = &work.residual[class];
    // Residuals of a body that can move as a whole are balanced where all its nodes are now.
    let balanced = mesh.has_free_organs() && !residual.is_empty();
    // Where most elements are due most nodes are concerned: finding out which costs more than moving the others.
    let due = |all: usize, of_class: usize| 4 * of_class > all;
    let (pool, stars) = (mesh.pool(), mesh.stars());
    if balanced || due(pool.len() + stars.len(), pool.count(class) + stars.count(class)) {
        let (nodes, entries) = (mesh.active().len() as u32, mesh.row_entries());
        drift_all(&mut work.time, mesh, gravity, now);
        laps.lap(Part::Node, nodes);
        mesh.place_interface();
        laps.lap(Part::Row, entries);
        let extremes = add_forces(path, mesh, class, held, &rates, laps);
        mesh.hand_back_all();
        laps.lap(Part::Row, entries);
        if balanced {
            mesh.balance_residuals(class);
        }
        let (active, motion) = mesh.active_motion();
        add_residuals(if balanced { active } else { residual }, motion, class);
        kick(registers, active, motion, step);
        laps.lap(Part::Node, nodes);
        return extremes;
    }
    find_concerned(mesh, class, held, work);
    let (concerned, residual) = (&work.concerned[class], &work.residual[class]);
    drift(&concerned.active, &mut work.time, mesh, gravity, now);
    drift(residual, &mut work.time, mesh, gravity, now);
    laps.lap(Part::Node, (concerned.active.len() + residual.len()) as u32);
    mesh.place_these(&concerned.interface);
    laps.lap(Part::Row, concerned.entries);
    let extremes = add_forces(path, mesh, class, held, &rates, laps);
    mesh.hand_back(&concerned.interface);
    laps.lap(Part::Row, concerned.entries);
    kick(registers, &concerned.active, &mut mesh.motion, step);
    add_residuals(residual, &mut mesh.motion, class);
    kick(registers, residual, &mut mesh.motion, step);
    laps.lap(Part::Node, (concerned.active.len() + residual.len()) as u32);
    extremes
}

/// Forces of the elements of `class`, and of the supports when `held`.
fn add_forces(
    path: Simd,
    mesh: &mut ActiveMesh,
    class: usize,
    held: bool,
    rates: &Rates,
    laps: &mut dyn Laps,
) -> Extremes {
    let extremes = mesh.add_forces(path, class, rates);
    laps.lap(Part::Element(class as u8), mesh.evaluations(class));
    if held {
        mesh.add_supports();
        laps.lap(Part::Support, mesh.support_count() as u32);
    }
    extremes
}

/// Damping of one class: viscosity and Maxwell branches over its step, times `damping`.
fn rates(body: &Body, damping: Real, step: Real) -> Rates {
    let material = body.material();
    let numerical = if body.maxwell().is_empty() { 0.0 } else { STEP_VISCOSITY };
    let over =
        |viscosity: Real, modulus: Real| if modulus > 0.0 { damping * viscosity / (modulus * step) } else { 0.0 };
    let mut rates = Rates {
        volume: numerical + over(material.phi, material.lambda),
        shear: numerical + over(material.psi, material.mu),
        ..Rates::ELASTIC
    };
    for (b, branch) in body.maxwell().iter().enumerate() {
        rates.decay[b] = 1.0 / (1.0 + step / branch.time);
        rates.share[b] = damping * branch.modulus;
    }
    rates
}

/// Nodes of the elements of `class`, of the holds when `held`, and the masters they hang on.
fn find_concerned(mesh: &ActiveMesh, class: usize, held: bool, work: &mut Workspace) {
    if work.concerned[class].revision == Some(mesh.revision(class)) {
        return;
    }
    work.noted.clear();
    let Concerned { active, interface, entries, revision } = &mut work.concerned[class];
    let noted = &mut work.noted;
    active.clear();
    interface.clear();
    *entries = 0;
    let mut note = |slot: Slot| {
        if !noted.visit(slot.index()) {
            return;
        }
        if mesh.is_master(slot) {
            active.push(slot);
            return;
        }
        interface.push(slot);
        for (master, _) in mesh.row(slot).entries() {
            *entries += 1;
            if noted.visit(master.index()) {
                active.push(master);
            }
        }
    };
    for e in mesh.pool().ids(class) {
        if let Some(slots) = mesh.pool().nodes_of(e) {
            slots.for_each(&mut note);
        }
    }
    for n in mesh.stars().ids(class) {
        if let Some(slots) = mesh.stars().nodes_of(n) {
            slots.for_each(&mut note);
        }
    }
    if held {
        mesh.supported().for_each(&mut note);
    }
    *revision = Some(mesh.revision(class));
}

fn collect_residuals(mesh: &ActiveMesh, work: &mut Workspace) {
    work.residual.iter_mut().for_each(Vec::clear);
    if !mesh.has_residuals() {
        return;
    }
    for &slot in mesh.active() {
        for (slots, residual) in work.residual.iter_mut().zip(&mesh.motion.residual[slot.index()]) {
            if *residual != [0.0; 4] {
                slots.push(slot);
            }
        }
    }
}

fn collect_contact_nodes(constraints: &[Constraint], work: &mut Workspace) {
    work.noted.clear();
    work.contact_nodes.clear();
    for &(slot, _) in constraints.iter().flat_map(|c| c.row.entries()) {
        if work.noted.visit(slot.index()) {
            work.contact_nodes.push(slot);
        }
    }
}

/// Adds the relaxed elastic forces of all elements and the pull of the holds to [`ActiveMesh::motion`]'s forces.
pub fn add_elastic_forces(path: Simd, mesh: &mut ActiveMesh) {
    mesh.place_interface();
    for class in 0..CLASSES {
        mesh.add_forces(path, class, &Rates::ELASTIC);
    }
    mesh.add_supports();
    mesh.hand_back_all();
}

/// Free fall of the nodes in `slots` up to `now` [s].
fn drift(slots: &[Slot], time: &mut [Real], mesh: &mut ActiveMesh, gravity: Vec3, now: Real) {
    let registers = mesh.registers();
    fall(registers, slots, &mut mesh.motion, time, gravity, now);
}

fn drift_all(time: &mut [Real], mesh: &mut ActiveMesh, gravity: Vec3, now: Real) {
    let registers = mesh.registers();
    let (active, motion) = mesh.active_motion();
    fall(registers, active, motion, time, gravity, now);
}

fn fall(registers: Registers, slots: &[Slot], motion: &mut Motion, time: &mut [Real], gravity: Vec3, now: Real) {
    let Motion { position, velocity, inverse_mass, .. } = motion;
    let falling = Falling { position, velocity, inverse_mass, time };
    sweeps::fall(registers, slots, falling, [gravity.x, gravity.y, gravity.z, 0.0], now);
}

/// Residuals of the nodes in `slots` act now, with the elements of `class`.
fn add_residuals(slots: &[Slot], motion: &mut Motion, class: usize) {
    for &slot in slots {
        let residual = motion.residual[slot.index()][class];
        for (f, e) in motion.force[slot.index()].iter_mut().zip(residual) {
            *f += e;
        }
    }
}

fn kick(registers: Registers, slots: &[Slot], motion: &mut Motion, step: Real) {
    let Motion { velocity, force, inverse_mass, .. } = motion;
    sweeps::kick(registers, slots, inverse_mass, step, force, velocity);
}
