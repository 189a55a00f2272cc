//! The relaxed stiffness under a tool: how the contact force changes with where the tool is held, once the body has
//! come to rest there.
//!
//! The contact set is frozen. With `K_T` the tangent of the body's elastic forces, of its holds and of the points that lie on obstacles, `J` what the displacement
//! of the active nodes does to the contact points, `S` what that of the device does, and `H` the stiffness of what lies
//! between them (the dent below the mesh's size and the virtual coupling, in series), moving the device along the axis
//! `e_k` moves the nodes by `u_k`:
//!
//! `(K_T + Jᵀ H J) u_k = Jᵀ H S e_k`, and the force changes by `−K e_k`, `K e_k = Sᵀ H (S e_k − J u_k)`.
//!
//! With friction, points count with all three directions: those that slip now stick when the tool goes back or aside, and
//! give nothing more when it goes on, so along the way that they slip the answer is in the middle. Without friction a point
//! counts along its normal, which turns as the tool goes by. Conjugate gradients that start from the last answer: much of
//! it is still true a frame later.

use super::approach::ahead;
pub use super::stiffness::Stiffness;
use crate::contact::tool::{MOST_TOOLS, Shape};
use crate::ids::{Element, Node, ToolId};
use crate::math::{Mat3, Pose, Real, Vec3};
use crate::model::constraint::Row;
use crate::model::constraint::{Coupling, Held};
use crate::model::element_kernel::Simd;
use crate::model::{ActiveMesh, Body, Constraint};
use crate::simulation::{Settings, Simulation, Snapshot};
use crate::stepping::step;
use crate::visited::Visited;
use nalgebra::{Cholesky, DMatrix, DVector, Dyn};
use std::sync::Arc;

/// Iterations for one axis, at most: the answer may be a little old, but not late.
const ITERATIONS: usize = 80;
/// Unbalanced force over the load at which an answer is good enough.
const ENOUGH: Real = 0.003;
/// Largest displacement in a difference of forces [m]: strains of 1e-4 at most, and 1e-9 of the forces lost to rounding.
const SMALL: Real = 1e-7;
/// A tool that feels less than this [N] has no stiffness to tell.
const LEAST_FORCE: Real = 1e-3;
/// Least and largest range of a model [m].
const RANGES: (Real, Real) = (5e-4, 5e-3);

/// A copy of the simulation to ask questions of, away from the clock.
#[derive(Debug)]
pub struct Probe {
    simulation: Simulation,
    path: Simd,
    answers: [Option<Answer>; MOST_TOOLS],
}

/// Displacements of the nodes for a metre of the device along each axis, by node of the body.
#[derive(Clone, Debug)]
struct Answer {
    displacement: Vec<[Vec3; 3]>,
    /// Nodes whose displacement answers the last question.
    asked: Visited,
}

impl Answer {
    fn new(nodes: usize) -> Self {
        Self { displacement: vec![[Vec3::zeros(); 3]; nodes], asked: Visited::new(nodes) }
    }

    /// What is known of node `n`: its own displacement, or that of the nodes that stood for it.
    fn guess(&self, body: &Body, n: Node) -> [Vec3; 3] {
        let known = |n: Node| self.asked.contains(n.index()).then(|| self.displacement[n.index()]);
        if let Some(own) = known(n).or_else(|| if body.level_of(n) > 0 { known(body.parent(n)) } else { None }) {
            return own;
        }
        let children = body.children(n).iter().filter_map(|c| known(*c));
        let (count, sum) = children.fold((0.0, [Vec3::zeros(); 3]), |(count, sum): (Real, [Vec3; 3]), child| {
            (count + 1.0, std::array::from_fn(|k| sum[k] + child[k]))
        });
        if count > 0.0 { sum.map(|s| s / count) } else { [Vec3::zeros(); 3] }
    }
}

impl Probe {
    /// For sessions of `body` with `settings`.
    ///
    /// # Errors
    /// As [`Simulation::new`].
    pub fn new(body: Arc<Body>, settings: Settings) -> Result<Self, String> {
        let start = Snapshot::at_rest(&body, 0, settings.tools.len());
        let simulation = Simulation::new(body, Settings { adaptivity: None, ..settings }, start)?;
        Ok(Self { simulation, path: Simd::best(), answers: [const { None }; MOST_TOOLS] })
    }

    /// The relaxed stiffness under each tool that touches in `snapshot`, and what is told of those about to, by id.
    pub fn stiffness(&mut self, snapshot: &Snapshot) -> [Option<Stiffness>; MOST_TOOLS] {
        let mut found = [None; MOST_TOOLS];
        self.simulation.load(snapshot);
        let body = self.simulation.body().clone();
        let shapes: Vec<Shape> = self.simulation.settings().tools.iter().map(|t| t.shape.clone()).collect();
        let tools = snapshot.tools.clone();
        let (mesh, constraints, vertices) = self.simulation.contacts();
        let mut system: Option<System> = None;
        for (i, tool) in tools.iter().enumerate() {
            let own: Vec<&Constraint> = constraints.iter().filter(|c| c.tool == ToolId::at(i)).collect();
            if tool.physical_force.norm() < LEAST_FORCE || !own.iter().any(|c| c.multiplier > 0.0) {
                self.answers[i] = None;
                found[i] = Some(tool).filter(|t| t.touches()).and_then(|t| ahead(&body, mesh, vertices, &shapes[i], t));
                continue;
            }
            let system = system.get_or_insert_with(|| {
                let lying = |(_, c): &(usize, &Constraint)| c.tool.index() >= tools.len() && c.multiplier > 0.0;
                System::new(&body, self.path, mesh, constraints.iter().enumerate().filter(lying))
            });
            let Some(contact) = Contact::new(&own, round(&shapes[i], &tool.pose), system) else { continue };
            let answer = self.answers[i].get_or_insert_with(|| Answer::new(body.node_count()));
            found[i] = system.relax(mesh, &contact, answer).map(|(matrix, iterations)| {
                let matrix = half_along(&matrix, slip(&own));
                let normal = tool.physical_force.normalize();
                let along = normal.dot(&(matrix * normal));
                let range = (tool.physical_force.norm() / along.max(1.0)).clamp(RANGES.0, RANGES.1);
                Stiffness { matrix, normal, range, load: tool.physical_force.norm(), begins: None, iterations }
            });
        }
        found
    }
}

/// What lies between the device and the nodes.
struct Contact {
    /// Node weights of each point, as indices of active nodes.
    points: Vec<Vec<(usize, Real)>>,
    /// The directions that count: point and unit vector.
    rows: Vec<(usize, Vec3)>,
    /// Inverse of `H`.
    compliance: Cholesky<Real, Dyn>,
    /// Of each point: `λ/R` times the projection onto the directions along which its normal turns [N/m].
    turning: Vec<Mat3>,
}

impl Contact {
    fn new(own: &[&Constraint], round: Option<(Real, Vec3)>, system: &System) -> Option<Self> {
        let first = own.first()?.first as usize;
        let pushing: Vec<(usize, &Constraint)> =
            own.iter().enumerate().filter(|(_, c)| c.multiplier > 0.0).map(|(i, c)| (i, *c)).collect();
        debug_assert!(own.iter().all(|c| c.first as usize == first));
        let mut rows = Vec::new();
        let mut turning = Vec::new();
        for (p, (_, c)) in pushing.iter().enumerate() {
            rows.push((p, c.normal));
            let sticks = c.friction.coefficient > 0.0;
            if sticks {
                let (s, t) = perpendicular(&c.normal);
                rows.extend([(p, s), (p, t)]);
            }
            let mut across = Mat3::identity() - c.normal * c.normal.transpose();
            let (radius, axis) = round.unwrap_or((Real::INFINITY, Vec3::zeros()));
            if let Some(along) = (axis - c.normal * c.normal.dot(&axis)).try_normalize(0.1) {
                across -= along * along.transpose();
            }
            turning.push(if sticks { Mat3::zeros() } else { across * (c.multiplier / radius) });
        }
        let Held { coupling: Coupling { compliance, angular_compliance }, grip } = own.first()?.held;
        let between = |a: usize, b: usize| {
            let ((p, d), (q, e)) = (rows[a], rows[b]);
            let ((i, c), (j, other)) = (pushing[p], pushing[q]);
            let (normal_a, normal_b) = (d == c.normal, e == other.normal);
            let factor = match (normal_a, normal_b) {
                (true, true) => 1.0,
                (false, false) => c.friction.compliance * d.dot(&e),
                _ => 0.0,
            };
            let dent = 0.5 * (c.compliance[j] + other.compliance[i]);
            let turns = angular_compliance * c.arm.cross(&d).dot(&other.arm.cross(&e));
            let opens = grip.compliance * c.lever.dot(&d) * other.lever.dot(&e);
            dent * factor + compliance * d.dot(&e) + turns + opens
        };
        let n = rows.len();
        let compliance = Cholesky::new(DMatrix::from_fn(n, n, between))?;
        let index = |row: &Row| row.entries().iter().map(|(slot, b)| (system.index[slot.index()], *b)).collect();
        Some(Self { points: pushing.iter().map(|(_, c)| index(&c.row)).collect(), rows, compliance, turning })
    }

    /// Displacements of the points, given those of the active nodes.
    fn at_points(&self, u: &[Vec3]) -> Vec<Vec3> {
        self.points.iter().map(|entries| entries.iter().map(|(i, b)| u[*i] * *b).sum()).collect()
    }

    /// Forces on the points [N] when they have moved by `moved` [m] against the tool.
    fn forces(&self, moved: &[Vec3]) -> Vec<Vec3> {
        let along = DVector::from_iterator(self.rows.len(), self.rows.iter().map(|(p, d)| d.dot(&moved[*p])));
        let pushed = self.compliance.solve(&along);
        let mut forces: Vec<Vec3> = self.turning.iter().zip(moved).map(|(turning, m)| turning * m).collect();
        for ((p, d), f) in self.rows.iter().zip(pushed.iter()) {
            forces[*p] -= d * *f;
        }
        forces
    }

    /// Adds minus these forces to the nodes.
    fn subtract_from(&self, forces: &[Vec3], nodes: &mut [Vec3]) {
        for (entries, f) in self.points.iter().zip(forces) {
            entries.iter().for_each(|(i, b)| nodes[*i] -= f * *b);
        }
    }
}

/// The way in which the points slip, as long as the part of the tangential force that slips.
fn slip(own: &[&Constraint]) -> Vec3 {
    let slips = |c: &&&Constraint| c.friction.multiplier.norm() > 0.999 * c.friction.coefficient * c.multiplier;
    let tangential = |c: &&Constraint| c.friction.multiplier;
    let all: Real = own.iter().map(|c| tangential(c).norm()).sum();
    let slipping: Vec3 = own.iter().filter(slips).map(tangential).sum();
    if all > 0.0 { slipping / all } else { Vec3::zeros() }
}

/// Half of `k` along the unit vector `way`, all of it across: a point that slips gives nothing more ahead and all of it back.
/// Where the rim of a round contact slips, as in the part `|way|` of the force, the middle has `1 − |way|²` of the stiffness
/// left ahead, within 4 % of it [Mindlin 1949].
fn half_along(k: &Mat3, way: Vec3) -> Mat3 {
    let Some(along) = way.try_normalize(1e-9) else { return *k };
    let a = Mat3::identity() - along * along.transpose() * (1.0 - (1.0 - 0.5 * way.norm_squared().min(1.0)).sqrt());
    a * k * a
}

/// Radius and axis (unit, or zero for a ball) of a tool that is round all over. Along flat faces normals do not turn, and
/// edges are too sharp for a model that is linear.
fn round(shape: &Shape, pose: &Pose) -> Option<(Real, Vec3)> {
    let [part] = shape.parts() else { return None };
    let (_, axis, radius) = part.outline();
    let axis = pose.rotate(axis).try_normalize(1e-9).unwrap_or_default();
    (!part.is_solid()).then_some((radius, axis))
}

/// Two unit vectors across `n`.
fn perpendicular(n: &Vec3) -> (Vec3, Vec3) {
    let other = if n.x.abs() < 0.7 { Vec3::x() } else { Vec3::y() };
    let s = n.cross(&other).normalize();
    (s, n.cross(&s))
}

/// The body's tangent about a state.
struct System<'a> {
    body: &'a Body,
    path: Simd,
    /// Place of each slot among the active nodes.
    index: Vec<usize>,
    /// Where the active nodes are.
    at: Vec<Vec3>,
    fixed: Vec<bool>,
    /// Elastic forces there.
    force: Vec<Vec3>,
    /// About the diagonal of the tangent [N/m].
    diagonal: Vec<Real>,
    /// Points that lie on obstacles.
    resting: Vec<Resting>,
}

/// A point that lies on an obstacle, which stays where it is.
struct Resting {
    /// Node weights, as indices of active nodes.
    entries: Vec<(usize, Real)>,
    /// Inverse of its own compliance: along the normal, and in all directions where there is friction [N/m].
    stiffness: Mat3,
}

impl<'a> System<'a> {
    /// `lying`: constraints of obstacles that push, and their places in the list of all.
    fn new<'c>(
        body: &'a Body,
        path: Simd,
        mesh: &mut ActiveMesh,
        lying: impl Iterator<Item = (usize, &'c Constraint)>,
    ) -> Self {
        let mut index = vec![usize::MAX; mesh.motion.mass.len()];
        mesh.active().iter().enumerate().for_each(|(i, slot)| index[slot.index()] = i);
        let at: Vec<Vec3> = mesh.active().iter().map(|s| mesh.position(*s)).collect();
        let fixed = mesh.active().iter().map(|s| mesh.motion.inverse_mass[s.index()] == 0.0).collect();
        let mut diagonal: Vec<Real> = mesh
            .active()
            .iter()
            .map(|s| {
                let around = body.elements_around(mesh.node(*s)).iter();
                // An element's share of a diagonal entry: about (λ + 2μ) V / 3 over its altitude squared.
                let share = |e: &Element| {
                    let m = mesh.material_of(body, *e);
                    let x = body.corners(*e);
                    let edge = (0..4).flat_map(|i| (0..i).map(move |j| (i, j)));
                    let longest = edge.map(|(i, j)| (x[i] - x[j]).norm_squared()).fold(0.0, Real::max);
                    m.largest_modulus() * body.volume(*e) / longest
                };
                around.map(share).sum::<Real>()
            })
            .collect();
        let mut resting = Vec::new();
        for (i, c) in lying {
            let own = 1.0 / c.compliance[i - c.first as usize];
            let entries: Vec<(usize, Real)> = c.row.entries().iter().map(|(s, b)| (index[s.index()], *b)).collect();
            entries.iter().for_each(|(i, b)| diagonal[*i] += b * b * own);
            let held = if c.friction.coefficient > 0.0 { Mat3::identity() } else { c.normal * c.normal.transpose() };
            resting.push(Resting { entries, stiffness: held * own });
        }
        let mut force = vec![Vec3::zeros(); at.len()];
        forces(path, mesh, &mut force);
        Self { body, path, index, at, fixed, force, diagonal, resting }
    }

    /// `K_T u`, by a difference of forces.
    fn apply(&self, mesh: &mut ActiveMesh, u: &[Vec3], out: &mut [Vec3]) {
        let largest = u.iter().map(Vec3::norm).fold(0.0, Real::max);
        if largest == 0.0 {
            return out.fill(Vec3::zeros());
        }
        let scale = SMALL / largest;
        let mut i = 0;
        mesh.change_motion(|_, x, _| {
            *x = self.at[i] + u[i] * scale;
            i += 1;
        });
        forces(self.path, mesh, out);
        for ((out, before), fixed) in out.iter_mut().zip(&self.force).zip(&self.fixed) {
            *out = if *fixed { Vec3::zeros() } else { (before - *out) / scale };
        }
        for Resting { entries, stiffness } in &self.resting {
            let resists = stiffness * entries.iter().map(|(i, b)| u[*i] * *b).sum::<Vec3>();
            entries.iter().for_each(|(i, b)| out[*i] += resists * *b);
        }
    }

    /// K and the iterations it took; `None` where the system is not one of a body at rest.
    fn relax(&self, mesh: &mut ActiveMesh, contact: &Contact, answer: &mut Answer) -> Option<(Mat3, usize)> {
        let n = self.at.len();
        let nodes: Vec<Node> = mesh.active().iter().map(|s| mesh.node(*s)).collect();
        let guesses: Vec<[Vec3; 3]> = nodes.iter().map(|n| answer.guess(self.body, *n)).collect();
        let mut solutions = Vec::with_capacity(3);
        let mut stiffness = Mat3::zeros();
        let mut iterations = 0;
        for k in 0..3 {
            let mut axis = Vec3::zeros();
            axis[k] = 1.0;
            let mut load = vec![Vec3::zeros(); n];
            // The device's motion is that of the points, turned round.
            let moved = vec![-axis; contact.points.len()];
            contact.subtract_from(&contact.forces(&moved).iter().map(|f| -f).collect::<Vec<_>>(), &mut load);
            self.let_go(&mut load);
            let mut u: Vec<Vec3> = guesses.iter().map(|g| g[k]).collect();
            self.let_go(&mut u);
            iterations += self.solve(mesh, contact, &load, &mut u)?;
            let moved: Vec<Vec3> = contact.at_points(&u).iter().map(|u| u - axis).collect();
            // What the points get the tool loses.
            let on_tool: Vec3 = contact.forces(&moved).iter().map(|f| -f).sum();
            stiffness.set_column(k, &-on_tool);
            solutions.push(u);
        }
        answer.asked.clear();
        for (i, n) in nodes.iter().enumerate() {
            answer.displacement[n.index()] = std::array::from_fn(|k| solutions[k][i]);
            answer.asked.visit(n.index());
        }
        let eigen = (0.5 * (stiffness + stiffness.transpose())).symmetric_eigen();
        let values = eigen.eigenvalues.map(|v| v.max(0.0));
        let sound = eigen.eigenvectors * Mat3::from_diagonal(&values) * eigen.eigenvectors.transpose();
        sound.iter().all(|k| k.is_finite()).then_some((sound, iterations))
    }

    fn let_go(&self, field: &mut [Vec3]) {
        field.iter_mut().zip(&self.fixed).filter(|(_, fixed)| **fixed).for_each(|(v, _)| *v = Vec3::zeros());
    }

    fn apply_all(&self, mesh: &mut ActiveMesh, contact: &Contact, u: &[Vec3], out: &mut [Vec3]) {
        self.apply(mesh, u, out);
        contact.subtract_from(&contact.forces(&contact.at_points(u)), out);
        self.let_go(out);
    }

    /// Conjugate gradients from `u`; the iterations it took.
    fn solve(&self, mesh: &mut ActiveMesh, contact: &Contact, load: &[Vec3], u: &mut [Vec3]) -> Option<usize> {
        let mut image = vec![Vec3::zeros(); u.len()];
        self.apply_all(mesh, contact, u, &mut image);
        let mut r: Vec<Vec3> = load.iter().zip(&image).map(|(l, a)| l - a).collect();
        let weighted = |r: &[Vec3]| r.iter().zip(&self.diagonal).map(|(r, d)| r / *d).collect::<Vec<Vec3>>();
        let mut z = weighted(&r);
        let mut p = z.clone();
        let mut rz = dot(&r, &z);
        let enough = ENOUGH * ENOUGH * dot(load, &weighted(load));
        for iteration in 0..ITERATIONS {
            if rz <= enough {
                return Some(iteration);
            }
            self.apply_all(mesh, contact, &p, &mut image);
            let curvature = dot(&p, &image);
            // A body about to buckle, or to roll off: what is known so far is the answer.
            #[expect(clippy::neg_cmp_op_on_partial_ord, reason = "NaN, too, must leave here")]
            if !(curvature > 0.0) {
                return curvature.is_finite().then_some(iteration);
            }
            let step = rz / curvature;
            for i in 0..u.len() {
                u[i] += p[i] * step;
                r[i] -= image[i] * step;
            }
            z = weighted(&r);
            let next = dot(&r, &z);
            let keep = next / rz;
            rz = next;
            p.iter_mut().zip(&z).for_each(|(p, z)| *p = z + *p * keep);
        }
        Some(ITERATIONS)
    }
}

fn dot(a: &[Vec3], b: &[Vec3]) -> Real {
    a.iter().zip(b).map(|(a, b)| a.dot(b)).sum()
}

/// Elastic forces and those of the holds on the active nodes [N], as `mesh` is now.
fn forces(path: Simd, mesh: &mut ActiveMesh, out: &mut [Vec3]) {
    step::add_elastic_forces(path, mesh);
    let (active, motion) = mesh.active_motion();
    for (out, slot) in out.iter_mut().zip(active) {
        let f = std::mem::take(&mut motion.force[slot.index()]);
        *out = Vec3::new(f[0], f[1], f[2]);
    }
}
