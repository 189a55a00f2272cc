//! The contact solve of one sub-step: projected Gauss–Seidel on end-of-step positions, warm-started.
//!
//! For each point: `r = n·(Σ b_i (x_i + h v_i)) + d − (offset + rate·t)`, `d = Σ_j G_j λ_j` the dent;
//! `λ ← max(0, λ − r / (Δt h Σ b_i²/m_i + G))`, `h` the sub-step Δt or a longer
//! [horizon](Constraint::horizon), and the change of λ at once acts on the velocities
//! and on the other points' dents. The gap is closed as a whole: scaling it (Baumgarte) would make the force too small,
//! because G turns gap into force. Where there is friction, the tangential multiplier follows the same way, and is then cut
//! to the disc of radius μ λ [Coulomb]. A tool that hangs on springs gives way to the sum of its points' forces and turns
//! with the sum of their moments: compliances that all of them share. What an impulse at one point does to the velocity of another is
//! known for the whole tick ([`prepare`]), so that the sweeps leave the nodes alone: these get what all sweeps have added up to.

use crate::math::{Real, Vec3};
use crate::model::active_mesh::Motion;
use crate::model::constraint::{Coupling, Foot, MOST_PUSHERS, MOST_ROW_NODES, Pushed};
use crate::model::element_kernel::Padded;
use crate::model::sweeps::sweep;
use crate::model::{ActiveMesh, Constraint};
use std::ops::Range;

/// Sweeps over all points in one sub-step; the multipliers of the last sub-step are the start.
const SWEEPS: usize = 5;

/// What the sweeps need of a point, one beside the other: a constraint is as long as its row.
#[derive(Clone, Copy, Debug, Default)]
struct Point {
    normal: Vec3,
    arm: Vec3,
    lever: Vec3,
    /// `Σ b_i x_i` at the start of the sub-step [m].
    place: Vec3,
    /// Within which the gap is closed [s].
    horizon: Real,
    /// Least `n·q` then [m].
    target: Real,
    /// Where it sticks then [m].
    anchor: Vec3,
    /// `Σ_k b_k²/m_k` [1/kg].
    inverse_mass: Real,
    /// What a gap gives, along the normal and across [N/m].
    stiffness: [Real; 2],
    /// Coefficient of friction, and tangential compliances over the normal ones.
    friction: [Real; 2],
    /// [N].
    multiplier: Real,
    /// Along the surface [N].
    tangential: Vec3,
    /// Of all sweeps, and what they start from [N·s].
    impulse: Vec3,
}

/// Constraints whose compliances are known from one to another: those of a tool, or one patch on the ground.
#[derive(Clone, Debug)]
struct Group {
    own: Range<usize>,
    /// Constraints among which are all that hang on nodes of these.
    reach: Range<usize>,
}

/// What an impulse at one constraint adds to the velocity of another, `W_ij = Σ_k b_ik b_jk / m_k` [1/kg]: the Delassus operator, with `b`
/// as at the start of the tick.
#[derive(Debug)]
struct Mobility {
    /// Row by row; of row `i` what its group reaches.
    all: Vec<Real>,
    constraints: usize,
}

impl Mobility {
    #[inline(always)]
    fn between(&mut self, i: usize, j: usize) -> &mut Real {
        &mut self.all[i * self.constraints + j]
    }

    #[inline(always)]
    fn of(&self, i: usize, reach: &Range<usize>) -> &[Real] {
        &self.all[i * self.constraints..][reach.clone()]
    }

    /// The `group` reaches those, too.
    #[inline(always)]
    fn widen(&mut self, group: &mut Group, to: &Range<usize>) {
        let Range { start, end } = group.reach.clone();
        if start <= to.start && to.end <= end {
            return;
        }
        for i in group.own.clone() {
            let row = &mut self.all[i * self.constraints..][..self.constraints];
            row[to.start.min(start)..start].fill(0.0);
            row[end..to.end.max(end)].fill(0.0);
        }
        group.reach = to.start.min(start)..to.end.max(end);
    }
}

/// A node's part in a constraint.
#[derive(Clone, Copy, Debug)]
struct Part {
    constraint: usize,
    group: usize,
    weight: Real,
    /// Number of another part of the same node.
    next: Option<u32>,
}

/// What the solve needs beside the constraints; reused from tick to tick.
#[derive(Debug)]
pub struct Workspace {
    points: Vec<Point>,
    groups: Vec<Group>,
    mobility: Mobility,
    /// `b/m` of the nodes of one row [1/kg], by slot; else zero.
    weights: Vec<Real>,
    /// Of all nodes in constraints, ...
    parts: Vec<Part>,
    /// ... and by slot the number of the last one.
    last_part: Vec<Option<u32>>,
    /// `Σ b_i v_i` [m/s], by constraint.
    velocities: Vectors,
    /// `Σ_j G_j λ_j` [m].
    dents: Vec<Real>,
    /// `Σ_j G_j τ_j` [m], tangential compliances.
    shears: Vectors,
}

/// Vectors by constraint, component by component: so that four of them are changed at once.
#[derive(Debug)]
struct Vectors([Vec<Real>; 3]);

impl Vectors {
    fn new(constraints: usize) -> Self {
        Self(std::array::from_fn(|_| vec![0.0; constraints]))
    }

    #[inline(always)]
    fn at(&self, i: usize) -> Vec3 {
        Vec3::from(self.0.each_ref().map(|all| all[i]))
    }

    #[inline(always)]
    fn set(&mut self, i: usize, vector: Vec3) {
        self.0.iter_mut().zip(vector.iter()).for_each(|(all, x)| all[i] = *x);
    }

    /// Adds `change` times `of` each to its `own`.
    #[inline(always)]
    fn add_times(&mut self, own: &Range<usize>, of: &[Real], change: Vec3) {
        self.0.iter_mut().zip(change.iter()).for_each(|(all, x)| add_times(&mut all[own.clone()], of, *x));
    }
}

impl Workspace {
    /// For so many `constraints` on nodes in so many `slots` at most.
    pub fn new(constraints: usize, slots: usize) -> Self {
        Self {
            points: vec![Point::default(); constraints],
            groups: Vec::with_capacity(constraints),
            mobility: Mobility { all: vec![0.0; constraints * constraints], constraints: 0 },
            weights: vec![0.0; slots],
            parts: Vec::with_capacity(constraints * MOST_ROW_NODES),
            last_part: vec![None; slots],
            velocities: Vectors::new(constraints),
            dents: vec![0.0; constraints],
            shears: Vectors::new(constraints),
        }
    }
}

/// Readies `work` for all sub-steps of a tick.
pub fn prepare(mesh: &ActiveMesh, constraints: &[Constraint], work: &mut Workspace) {
    prepare_in(mesh.registers(), &mesh.motion.inverse_mass, constraints, work);
}

/// Changes the velocities so that no surface point ends the sub-step inside a tool, and leaves each point's
/// multiplier [N] in `constraint.multiplier`. `end` [s]: end of the sub-step, from the start of the tick.
pub fn solve(mesh: &mut ActiveMesh, constraints: &mut [Constraint], work: &mut Workspace, step: Real, end: Real) {
    solve_in(mesh.registers(), &mut mesh.motion, constraints, work, step, end);
}

/// Before a solve: where organs have slid along each other, the place that one meets of the other is another. `feet` are those of the
/// last constraints.
pub fn follow(mesh: &ActiveMesh, constraints: &mut [Constraint], feet: &[Foot]) {
    let first = constraints.len() - feet.len();
    for (c, foot) in constraints[first..].iter_mut().zip(feet) {
        let apart = foot.follow(&mut c.row, &mesh.motion.position);
        c.offset -= c.normal.dot(&apart);
        c.friction.anchor -= apart;
    }
}

sweep! {
    /// As [`prepare`].
    fn prepare_in(inverse_mass: &[Real], constraints: &[Constraint], work: &mut Workspace) {
        let Workspace { groups, mobility, weights, parts, last_part, .. } = work;
        mobility.constraints = constraints.len();
        groups.clear();
        for (i, c) in constraints.iter().enumerate() {
            match groups.last_mut().filter(|group| group.own.start == c.first as usize) {
                Some(group) => (group.own.end, group.reach.end) = (i + 1, i + 1),
                None => groups.push(Group { own: i..i + 1, reach: i..i + 1 }),
            }
        }
        for g in 0..groups.len() {
            let own = groups[g].own.clone();
            for i in own.clone() {
                let row = &constraints[i].row;
                row.entries().iter().for_each(|&(n, b)| weights[n.index()] = b * inverse_mass[n.index()]);
                for (j, other) in (i..own.end).zip(&constraints[i..own.end]) {
                    let mobile = other.row.sum(weights);
                    (*mobility.between(i, j), *mobility.between(j, i)) = (mobile, mobile);
                }
                row.entries().iter().for_each(|&(n, _)| weights[n.index()] = 0.0);
            }
            for i in own.clone() {
                for &(n, b) in constraints[i].row.entries() {
                    let mut next = last_part[n.index()];
                    while let Some(part) = next.map(|k| parts[k as usize]) {
                        let other = part.group;
                        if !(groups[g].reach.contains(&part.constraint) && groups[other].reach.contains(&i)) {
                            let of_other = groups[other].own.clone();
                            mobility.widen(&mut groups[g], &of_other);
                            mobility.widen(&mut groups[other], &own);
                        }
                        *mobility.between(i, part.constraint) += b * part.weight * inverse_mass[n.index()];
                        next = part.next;
                    }
                }
            }
            // The last one's are looked for by none.
            for i in own.filter(|_| g + 1 < groups.len()) {
                for &(n, weight) in constraints[i].row.entries() {
                    let last = &mut last_part[n.index()];
                    parts.push(Part { constraint: i, group: g, weight, next: *last });
                    *last = Some(parts.len() as u32 - 1);
                }
            }
        }
        for Group { own, reach } in groups.iter() {
            for i in own.clone() {
                for j in reach.start..own.start {
                    *mobility.between(j, i) = *mobility.between(i, j);
                }
            }
        }
        parts.clear();
        let held = constraints.iter().flat_map(|c| c.row.entries());
        held.for_each(|&(n, _)| last_part[n.index()] = None);
    }
}

sweep! {
    /// As [`solve`].
    fn solve_in(motion: &mut Motion, constraints: &mut [Constraint], work: &mut Workspace, step: Real, end: Real) {
        let Workspace { points, groups, mobility, velocities, dents, shears, .. } = work;
        let Motion { position, velocity, inverse_mass, .. } = motion;
        // By tool: the sum of what its points push with.
        let mut pushed = [Pushed::default(); MOST_PUSHERS];
        let all = constraints.len();
        dents[..all].fill(0.0);
        shears.0.iter_mut().for_each(|shears| shears[..all].fill(0.0));
        for (i, c) in constraints.iter().enumerate() {
            let force = c.normal * c.multiplier + c.friction.multiplier;
            pushed[c.tool.index()].add(&c.arm, &c.lever, &force);
            let horizon = c.horizon.max(step);
            let due = end + (horizon - step);
            let own = i - c.first as usize;
            let (compliance, inverse_mass) = (c.compliance[own], *mobility.between(i, i));
            let (Coupling { compliance: moved, angular_compliance }, grip) = (c.held.coupling, c.held.grip.compliance);
            let opened = c.lever.dot(&c.normal);
            let turned = angular_compliance * c.arm.cross(&c.normal).norm_squared() + grip * opened * opened;
            // No direction along the surface turns the tool, or its jaws, by more than this.
            let turned_across = angular_compliance * c.arm.norm_squared() + grip * c.lever.norm_squared();
            let gives = step * horizon * inverse_mass + moved;
            let stiffness =
                [1.0 / (gives + turned + compliance), 1.0 / (gives + turned_across + c.friction.compliance * compliance)];
            points[i] = Point {
                normal: c.normal,
                arm: c.arm,
                lever: c.lever,
                place: c.row.interpolate(position),
                horizon,
                target: c.offset + c.rate * due,
                anchor: c.friction.anchor + c.friction.rate * due,
                inverse_mass,
                stiffness,
                friction: [c.friction.coefficient, c.friction.compliance],
                multiplier: c.multiplier,
                tangential: c.friction.multiplier,
                impulse: force * step,
            };
        }
        for (i, c) in constraints.iter().enumerate() {
            velocities.set(i, c.row.interpolate(velocity));
        }
        for Group { own, reach } in groups.iter() {
            for (i, c) in own.clone().zip(&constraints[own.clone()]) {
                add_times(&mut dents[own.clone()], &c.compliance, c.multiplier);
                shears.add_times(own, &c.compliance, c.friction.multiplier * c.friction.compliance);
                velocities.add_times(reach, mobility.of(i, reach), points[i].impulse);
            }
        }
        for sweep in 0..SWEEPS {
            // To and fro: what one end is told by the other must not take a sweep for the way back.
            let forth = sweep % 2 == 0;
            for k in 0..groups.len() {
                let Group { own, reach } = &groups[if forth { k } else { groups.len() - 1 - k }];
                let Constraint { tool, held, allowed_for, .. } = &constraints[own.start];
                let pushed = &mut pushed[tool.index()];
                for k in own.clone() {
                    let i = if forth { k } else { own.start + own.end - 1 - k };
                    let p = &mut points[i];
                    let place = p.place + velocities.at(i) * p.horizon;
                    let open = p.normal.dot(&(place + pushed.give(allowed_for, held, &p.arm, &p.lever))) - p.target;
                    // A point that would pull is released: its multiplier stays at zero.
                    let multiplier = (p.multiplier - (open + dents[i]) * p.stiffness[0]).max(0.0);
                    let change = multiplier - p.multiplier;
                    if multiplier == 0.0 && change == 0.0 && p.tangential == Vec3::zeros() {
                        continue;
                    }
                    p.multiplier = multiplier;
                    let compliance = &constraints[i].compliance;
                    let mut force = p.normal * change;
                    pushed.add(&p.arm, &p.lever, &force);
                    add_times(&mut dents[own.clone()], compliance, change);
                    if p.friction[0] > 0.0 {
                        let place = place + force * (step * p.inverse_mass * p.horizon);
                        let apart = place + shears.at(i) + pushed.give(allowed_for, held, &p.arm, &p.lever) - p.anchor;
                        let gap = apart - p.normal * p.normal.dot(&apart);
                        let stuck = p.tangential - gap * p.stiffness[1];
                        let (most, square) = (p.friction[0] * multiplier, stuck.norm_squared());
                        let tangential = if square > most * most { stuck * (most / square.sqrt()) } else { stuck };
                        let change = tangential - p.tangential;
                        p.tangential = tangential;
                        pushed.add(&p.arm, &p.lever, &change);
                        shears.add_times(own, compliance, change * p.friction[1]);
                        force += change;
                    }
                    p.impulse += force * step;
                    velocities.add_times(reach, mobility.of(i, reach), force * step);
                }
            }
        }
        push(velocity, inverse_mass, constraints, points);
        for (c, p) in constraints.iter_mut().zip(points.iter()) {
            (c.multiplier, c.friction.multiplier) = (p.multiplier, p.tangential);
        }
    }
}

/// Adds `change` times `of` each to the `sums`.
#[inline(always)]
fn add_times(sums: &mut [Real], of: &[Real], change: Real) {
    for (sum, g) in sums.iter_mut().zip(of) {
        *sum += g * change;
    }
}

/// Gives the nodes the impulses of the `points` through their rows.
#[inline(always)]
fn push(velocity: &mut [Padded], inverse_mass: &[Real], constraints: &[Constraint], points: &[Point]) {
    for (c, p) in constraints.iter().zip(points) {
        if p.impulse == Vec3::zeros() {
            continue;
        }
        let impulse = [p.impulse.x, p.impulse.y, p.impulse.z, 0.0];
        for &(n, b) in c.row.entries() {
            let (part, v) = (b * inverse_mass[n.index()], &mut velocity[n.index()]);
            for k in 0..4 {
                v[k] += part * impulse[k];
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ids::{Slot, ToolId};
    use crate::model::Row;
    use crate::model::constraint::{Coupling, Friction, Grip, Held};
    use crate::model::sweeps::Registers;

    fn number(i: usize, k: usize) -> Real {
        libm::sin(((11 + 3 * k) * i + 5 * k) as Real + 0.3)
    }

    fn motion(nodes: usize) -> Motion {
        let field = |k: usize| (0..nodes).map(|i| [number(i, k), number(i, k + 1), number(i, k + 2), 0.0]).collect();
        Motion {
            position: field(1),
            velocity: field(4),
            force: vec![[0.0; 4]; nodes],
            residual: vec![],
            inverse_mass: (0..nodes).map(|i| 2.0 + number(i, 9)).collect(),
            mass: vec![],
        }
    }

    /// Of a tool, each on nine nodes from number `4 i` on.
    fn constraint(tool: u32, first: usize, i: usize) -> Constraint {
        let (mut slots, mut weights) = ([Slot(0); MOST_ROW_NODES], [0.0; MOST_ROW_NODES]);
        for k in 0..9 {
            (slots[k], weights[k]) = (Slot((4 * i + k) as u32), (1.0 + 0.3 * number(i, k)) / 9.0);
        }
        let normal = Vec3::new(0.2 * number(i, 1), 0.2 * number(i, 2), -1.0).normalize();
        let friction = Friction {
            coefficient: 0.4,
            compliance: 1.2,
            anchor: Vec3::zeros(),
            rate: Vec3::zeros(),
            multiplier: Vec3::zeros(),
            mean_multiplier: Vec3::zeros(),
        };
        Constraint {
            row: Row::of(&slots, &weights, 9),
            normal,
            offset: number(i, 3),
            rate: 0.1,
            first: first as u32,
            compliance: std::array::from_fn(|j| libm::exp(-(((i - first) as Real) - j as Real).powi(2))),
            tool: ToolId(tool),
            point: i as u32,
            multiplier: 0.0,
            mean_multiplier: 0.0,
            friction,
            arm: Vec3::new(number(i, 6), number(i, 7), 0.1),
            lever: Vec3::new(0.3 * number(i, 8), 0.2, 0.1 * number(i, 9)),
            held: Held {
                coupling: Coupling { compliance: 0.01, angular_compliance: 0.02 },
                grip: Grip { free: 0.3, compliance: 0.05, most: 10.0 },
            },
            allowed_for: Pushed::default(),
            horizon: 0.0,
        }
    }

    fn solved(registers: Registers) -> (Vec<Padded>, Vec<(Real, Vec3)>) {
        let mut motion = motion(80);
        // The second tool hangs on nodes of the first.
        let mut constraints: Vec<Constraint> =
            (0..12).map(|i| constraint(u32::from(i > 6), if i > 6 { 7 } else { 0 }, i)).collect();
        let mut work = Workspace::new(12, 80);
        prepare_in(registers, &motion.inverse_mass, &constraints, &mut work);
        assert!(work.groups.len() == 2 && work.groups.iter().all(|group| group.reach == (0..12)));
        for _ in 0..100 {
            let before = motion.velocity.clone();
            solve_in(registers, &mut motion, &mut constraints, &mut work, 1e-3, 1e-3);
            // What pushes is the answer of one step, from the same start.
            motion.velocity = before;
        }
        solve_in(registers, &mut motion, &mut constraints, &mut work, 1e-3, 1e-3);
        (motion.velocity, constraints.iter().map(|c| (c.multiplier, c.friction.multiplier)).collect())
    }

    #[test]
    fn all_registers_give_the_same_forces() {
        assert_eq!(solved(Registers::Any), solved(Registers::best()));
    }

    #[test]
    fn points_that_push_lie_where_they_are_to_and_the_nodes_have_what_they_pushed() {
        let (velocity, multipliers) = solved(Registers::best());
        let before = motion(80);
        let mut given = before.velocity.clone();
        let all: Vec<Constraint> =
            (0..12).map(|i| constraint(u32::from(i > 6), if i > 6 { 7 } else { 0 }, i)).collect();
        for (c, (normal, tangential)) in all.iter().zip(&multipliers) {
            let impulse = (c.normal * *normal + tangential) * 1e-3;
            for &(n, b) in c.row.entries() {
                (0..3).for_each(|k| given[n.index()][k] += b * before.inverse_mass[n.index()] * impulse[k]);
            }
        }
        let apart = |(a, b): (&Padded, &Padded)| (0..3).map(|k| (a[k] - b[k]).abs()).fold(0.0, Real::max);
        assert!(velocity.iter().zip(&given).map(apart).fold(0.0, Real::max) < 1e-9);
        let mut pushing = 0;
        for (i, c) in all.iter().enumerate().filter(|(i, _)| multipliers[*i].0 > 0.0) {
            let own = all.iter().zip(&multipliers).filter(|(other, _)| other.first == c.first);
            let mut pushed = Pushed::default();
            own.clone().for_each(|(other, m)| pushed.add(&other.arm, &other.lever, &(other.normal * m.0 + m.1)));
            let dent: Real = own.zip(&c.compliance).map(|((_, m), g)| g * m.0).sum();
            let place = c.row.interpolate(&before.position) + c.row.interpolate(&velocity) * 1e-3;
            let gap = c.normal.dot(&(place + pushed.give(&c.allowed_for, &c.held, &c.arm, &c.lever))) + dent
                - (c.offset + 1e-4);
            assert!(gap.abs() < 1e-9, "point {i}: {gap:e}");
            pushing += 1;
        }
        assert!(pushing > 3, "{multipliers:?}");
    }
}
