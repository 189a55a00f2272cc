//! Levels that answer alike: one stiffness factor per level.
//!
//! Linear tetrahedra are too stiff, the more so the larger they are: a coarse level sags less under the same weight than
//! a fine one, and swings faster. A factor on λ and μ of each level takes that out: it is chosen so that the level moves
//! under a smooth load as far as the finest level does, which keeps its material as it is.
//!
//! The load is the body's weight along each of the three axes, as the finest level bears it, handed down to the coarser
//! ones. What must agree is the root mean square of the displacement, over the mass and all axes. That stands between
//! the work of the load, which makes amplitudes agree but leaves coarse levels swinging too slowly (their mass reaches
//! beyond the body), and the first frequency, which leaves them sagging too little; it takes no mode to be found. Only
//! what deforms the body counts: sinking and tipping as a whole on soft springs tells nothing about its elements. A body
//! that nothing holds is loaded without resultant instead, its middle against its ends.
//!
//! Each answer is a linear elastic solution at rest, by conjugate gradients. The three axes are solved as one system, a
//! node's unknown being a 3×3 block with a column per axis: that reads the matrix once for three. All of it is
//! `+ − × ÷ √` in a fixed order, whatever the number of threads: each row of the matrix gathers its own sum, and sums
//! over nodes run in chunks of fixed length.

use crate::geometry::TetMesh;
use crate::geometry::locate::Host;
use crate::hierarchy::Level;
use crate::math::{Mat3, Real, Vec3};
use crate::model::material::Material;
use nalgebra::SMatrix;
use rayon::prelude::*;

/// Smallest factor ever returned: with a smaller one the level's own shape and holds are wrong, not its stiffness.
pub const LEAST_FACTOR: Real = 0.2;
/// Largest factor ever returned: a level that is far softer than the finest does not cover the same body, and stiffening
/// it shortens its step.
pub const LARGEST_FACTOR: Real = 1.5;

/// Why levels could not be calibrated.
#[derive(Debug, PartialEq, thiserror::Error)]
pub enum CalibrationError {
    /// The elastic solution was not found: an element is degenerate, or stiffness differs too much from place to place.
    #[error(
        "level {level} does not come to rest under its weight ({:.1e} of it unbalanced after {iterations} iterations): \
         look for flat or inverted elements in it",
        residual
    )]
    NotConverged {
        /// Level, coarsest first.
        level: usize,
        /// Unbalanced force over the load, both as root of the sum of squares.
        residual: Real,
        /// Iterations done.
        iterations: usize,
    },
}

/// What the answers to a smooth load tell.
#[derive(Clone, Debug, PartialEq)]
pub struct Calibration {
    /// Factors on λ and μ (n_levels) that make all levels answer as the finest does; the last one is 1.
    pub factors: Vec<Real>,
    /// Angular frequency ω₁ of the slowest mode [rad/s], without the body's sinking on its holds: Rayleigh and Ritz's
    /// estimate from the three answers, a few per cent too high at most. 0 when nothing moves.
    pub slowest_mode: Real,
}

/// Makes all levels answer to a smooth load as the finest does.
///
/// `material` of an element, by level and element. `holds`: display vertices held by springs [N/m], which act through
/// the rows of `embedding` and are not scaled. The levels must be tied, embedded and have their fixed nodes. Accurate to
/// 1e-3; [`LEAST_FACTOR`] or [`LARGEST_FACTOR`] means that no factor makes that level agree.
///
/// # Errors
/// When a level has no elastic solution.
pub fn calibrate(
    levels: &[Level],
    material: impl Fn(usize, usize) -> Material + Sync,
    holds: &[(u32, Real)],
) -> Result<Calibration, CalibrationError> {
    let mut factors = vec![1.0; levels.len()];
    if levels.is_empty() {
        return Ok(Calibration { factors, slowest_mode: 0.0 });
    }
    // All levels bear the same load, or their answers could not be compared.
    let held = levels.iter().all(|level| holds_firmly(level, holds));
    let mut systems: Vec<System> =
        (0..levels.len()).map(|l| System::new(levels, l, &material, held.then_some(holds))).collect();
    let mut load = Vec::new();
    for l in (0..levels.len()).rev() {
        load = match systems.get(l + 1) {
            Some(finer) if finer.is_tied() => finer.to_coarser(&load),
            _ if held => weight(&levels[l]),
            _ => balanced_load(&levels[l]),
        };
        // What fixed nodes bear does not reach the body.
        load.iter_mut().enumerate().filter(|(n, _)| systems[l].is_fixed(*n)).for_each(|(_, load)| *load = ZERO);
        systems[l].bear(&load);
    }

    let mut answers: Vec<Answer> = Vec::new();
    for (l, level) in levels.iter().enumerate() {
        let mut guess = vec![ZERO; level.mesh.nodes.len()];
        if let Some(coarser) = answers.last() {
            systems[l].add_from_coarser(&coarser.displacement, &mut guess);
        }
        answers.push(answer(&systems, l, 1.0, guess)?);
    }
    let finest = answers.pop();
    let wanted = finest.as_ref().map_or(0.0, |finest| finest.amplitude);
    let slowest_mode = finest.map_or(0.0, |finest| slowest_mode(&systems[levels.len() - 1], &finest.deforming));
    for (l, first) in answers.into_iter().enumerate() {
        factors[l] = matching_factor(first, wanted, |factor, guess| answer(&systems, l, factor, guess))?;
    }
    Ok(Calibration { factors, slowest_mode })
}

/// The slowest mode [rad/s] among the combinations of the answers `u` to the loads along the three axes: the largest
/// eigenvalue of `K⁻¹M`, `K_ij = u_i·f_j`, `M_ij = Σ m u_i·u_j`.
fn slowest_mode(system: &System, deforming: &[Block]) -> Real {
    let (mut k, mut m) = (Mat3::zeros(), Mat3::zeros());
    for ((u, f), mass) in deforming.iter().zip(&system.load).zip(&system.level.node_mass) {
        // Rows are components, columns axes.
        let (u, f) = (columns(u).transpose(), columns(f).transpose());
        // What deforms the body is kept with its sign turned.
        k -= u.transpose() * f;
        m += u.transpose() * u * *mass;
    }
    let Some(inverse) = k.try_inverse() else { return 0.0 };
    let mut shape = Vec3::new(1.0, 0.8, 0.6);
    let mut largest = 0.0;
    for _ in 0..200 {
        let next = inverse * (m * shape);
        largest = next.norm();
        #[expect(clippy::neg_cmp_op_on_partial_ord, reason = "NaN, too, must leave here")]
        if !(largest > 0.0) {
            return 0.0;
        }
        shape = next / largest;
    }
    1.0 / largest.sqrt()
}

/// The factor at which a level has the amplitude `wanted`; `answer` is its answer at factor 1.
///
/// Secants in the softness `1/factor`: the amplitude is almost proportional to it, but for what the holds give way.
fn matching_factor(
    mut answer: Answer,
    wanted: Real,
    solve: impl Fn(Real, Vec<Block>) -> Result<Answer, CalibrationError>,
) -> Result<Real, CalibrationError> {
    let (mut factor, mut softness) = (1.0, 1.0);
    // Rigid elements do not deform.
    let mut before = (0.0, 0.0);
    for _ in 0..8 {
        let slope = (answer.amplitude - before.1) / (softness - before.0);
        // Nothing moves when every node is fixed; then any factor will do.
        if !(slope > 0.0 && slope.is_finite()) {
            break;
        }
        before = (softness, answer.amplitude);
        softness = (softness + (wanted - answer.amplitude) / slope).clamp(1.0 / LARGEST_FACTOR, 1.0 / LEAST_FACTOR);
        let change = (softness / before.0 - 1.0).abs();
        factor = 1.0 / softness;
        // The last secant corrects far more than what it leaves.
        if change < 1e-3 {
            break;
        }
        answer = solve(factor, answer.displacement)?;
    }
    Ok(factor.clamp(LEAST_FACTOR, LARGEST_FACTOR))
}

/// Three columns: a displacement [m] or force [N] for the load along each axis.
type Block = [[Real; 3]; 3];
const ZERO: Block = [[0.0; 3]; 3];

/// Nodes per chunk of a sum or a pass; part of the result's last bits, so never the number of threads.
const CHUNK: usize = 1024;

/// The linear equations of one level at rest, `(factor · elastic + spring) u = load`, by rows of node blocks.
///
/// Rows are gathered, not scattered by elements, so that threads need no order among them. The rows of fixed nodes are
/// empty, which keeps their displacement at zero.
struct System<'a> {
    level: &'a Level,
    /// None when they do not hold the body firmly; then fixed nodes are left free, too.
    holds: Option<&'a [(u32, Real)]>,
    /// Row starts (n_nodes + 1) into the three lists below.
    start: Vec<u32>,
    /// Node of each entry, ascending within a row.
    column: Vec<u32>,
    /// Elastic stiffness at factor 1 [N/m].
    elastic: Vec<Block>,
    /// Stiffness of the holds [N/m], the same along each axis.
    spring: Vec<Real>,
    /// Inverse of the diagonal blocks at factor 1 [m/N], zero at fixed nodes (n_nodes).
    inverse_diagonal: Vec<Block>,
    /// Force that deforms the body, per axis [N] for an acceleration of 1 m/s² (n_nodes).
    load: Vec<Block>,
    /// Where each node lies in the next coarser level (n_nodes), or empty.
    coarser: Vec<([u32; 4], [Real; 4])>,
    /// The same by coarser node: starts (n_coarser_nodes + 1) into node and weight.
    finer_start: Vec<u32>,
    finer: Vec<(u32, Real)>,
    /// On the coarsest level.
    grid: Option<Grid>,
}

impl<'a> System<'a> {
    /// The equations of level `l`, without load.
    fn new(
        levels: &'a [Level],
        l: usize,
        material: &(impl Fn(usize, usize) -> Material + Sync),
        holds: Option<&'a [(u32, Real)]>,
    ) -> Self {
        let level = &levels[l];
        let n_nodes = level.mesh.nodes.len();
        let mut fixed = vec![false; n_nodes];
        if holds.is_some() {
            level.fixed.iter().for_each(|n| fixed[*n as usize] = true);
        }
        let (start, column, elastic) = elastic_rows(level, |e| material(l, e), &fixed);
        let mut spring = vec![0.0; column.len()];
        for &(vertex, stiffness) in holds.unwrap_or_default() {
            let (nodes, weights) = row(&level.embedding[vertex as usize], &level.mesh);
            for (a, weight_a) in nodes.iter().zip(weights) {
                for (b, weight_b) in nodes.iter().zip(weights) {
                    if let Some(entry) = entry(&start, &column, *a, *b) {
                        spring[entry] += stiffness * weight_a * weight_b;
                    }
                }
            }
        }
        let inverse = |n: u32| {
            let diagonal = entry(&start, &column, n, n)?;
            // Symmetric, so that rows for columns make no difference.
            let block = Mat3::from(elastic[diagonal]) + Mat3::identity() * spring[diagonal];
            block.try_inverse().map(Block::from)
        };
        let inverse_diagonal = (0..n_nodes as u32).map(|n| inverse(n).unwrap_or(ZERO)).collect();
        let coarser: Vec<_> = match l {
            0 => Vec::new(),
            _ => level.coarser_host.iter().map(|host| row(host, &levels[l - 1].mesh)).collect(),
        };
        let (finer_start, finer) = transposed(&coarser, if l == 0 { 0 } else { levels[l - 1].mesh.nodes.len() });
        let mut system = System {
            level,
            holds,
            start,
            column,
            elastic,
            spring,
            inverse_diagonal,
            load: Vec::new(),
            coarser,
            finer_start,
            finer,
            grid: None,
        };
        if l == 0 {
            system.grid = Grid::new(level, &system);
        }
        system
    }

    /// Sets the load, less what the holds bear while the body moves on them as a whole: what is left deforms it.
    fn bear(&mut self, load: &[Block]) {
        let borne = self.in_place(&self.rigid_motion(load));
        let left = |(n, load): (usize, &Block)| {
            let mut left = *load;
            add_scaled(&mut left, -1.0, &self.force_of_holds(n, &borne));
            left
        };
        self.load = load.iter().enumerate().map(left).collect();
    }

    /// How `forces` would move the body on its springs if elements were rigid; not at all with fixed nodes.
    fn rigid_motion(&self, forces: &[Block]) -> RigidMotion {
        let springs = self.holds.filter(|_| self.level.fixed.is_empty()).unwrap_or_default();
        rigid_stiffness(held_points(self.level, springs)).cholesky().map_or(RigidMotion::zeros(), |stiffness| {
            let arms = Arms::new(self.level);
            let mut resultant = RigidMotion::zeros();
            for (u, force) in self.level.mesh.nodes.iter().zip(forces) {
                resultant += rigid_modes(arms.to(u)).transpose() * columns(force);
            }
            stiffness.solve(&resultant)
        })
    }

    /// The displacement of each node in a rigid motion.
    fn in_place(&self, motion: &RigidMotion) -> Vec<Block> {
        let arms = Arms::new(self.level);
        // nalgebra stores columns, a block rows.
        self.level.mesh.nodes.iter().map(|u| (rigid_modes(arms.to(u)) * motion).transpose().into()).collect()
    }

    /// Force of the springs on node `n` [N] at the displacements `u`, backwards.
    fn force_of_holds(&self, n: usize, u: &[Block]) -> Block {
        let mut force = ZERO;
        for entry in self.start[n] as usize..self.start[n + 1] as usize {
            add_scaled(&mut force, self.spring[entry], &u[self.column[entry] as usize]);
        }
        force
    }

    fn is_fixed(&self, n: usize) -> bool {
        self.start[n] == self.start[n + 1]
    }

    /// True when each node has a place in the next coarser level.
    fn is_tied(&self) -> bool {
        !self.coarser.is_empty() && self.coarser.len() + 1 == self.start.len()
    }

    /// Adds the coarser level's displacement, interpolated; fixed nodes stay.
    fn add_from_coarser(&self, coarse: &[Block], fine: &mut [Block]) {
        if !self.is_tied() {
            return;
        }
        for_each_node(fine, |n, u| {
            if !self.is_fixed(n) {
                let (nodes, weights) = &self.coarser[n];
                for (c, weight) in nodes.iter().zip(weights) {
                    add_scaled(u, *weight, &coarse[*c as usize]);
                }
            }
        });
    }

    /// Forces on this level's nodes, handed to the coarser level's through the same rows.
    fn to_coarser(&self, fine: &[Block]) -> Vec<Block> {
        let mut coarse = vec![ZERO; self.finer_start.len() - 1];
        for_each_node(&mut coarse, |c, f| {
            for (n, weight) in &self.finer[self.finer_start[c] as usize..self.finer_start[c + 1] as usize] {
                add_scaled(f, *weight, &fine[*n as usize]);
            }
        });
        coarse
    }

    /// Force of node `n` [N] at the displacements `u`: row `n` of the matrix times `u`.
    fn force(&self, n: usize, factor: Real, u: &[Block]) -> Block {
        let (mut elastic, mut spring) = (ZERO, ZERO);
        for entry in self.start[n] as usize..self.start[n + 1] as usize {
            let (u, k) = (&u[self.column[entry] as usize], &self.elastic[entry]);
            for i in 0..3 {
                for j in 0..3 {
                    elastic[i][j] += k[i][0] * u[0][j] + k[i][1] * u[1][j] + k[i][2] * u[2][j];
                }
            }
            add_scaled(&mut spring, self.spring[entry], u);
        }
        add_scaled(&mut spring, factor, &elastic);
        spring
    }
}

/// The four nodes that carry a point of `mesh`, and their weights.
fn row(host: &Host, mesh: &TetMesh) -> ([u32; 4], [Real; 4]) {
    (mesh.elements[host.element as usize], host.weights)
}

/// How a level answers to its load.
struct Answer {
    /// Displacement, per axis [m] (n_nodes).
    displacement: Vec<Block>,
    /// What of it deforms the body, its sign turned [m] (n_nodes).
    deforming: Vec<Block>,
    /// Root of the sum over the mass of its square, all axes together [m √kg].
    amplitude: Real,
}

/// The answer of level `l` at `factor`, from the displacements `guess`.
fn answer(systems: &[System], l: usize, factor: Real, guess: Vec<Block>) -> Result<Answer, CalibrationError> {
    let system = &systems[l];
    let displacement = solve(systems, l, factor, guess)?;
    // Where little or nothing holds the body, it may have drifted; what deforms it leaves the holds in balance.
    let drift = match system.holds {
        Some(_) => {
            let forces: Vec<Block> = (0..displacement.len()).map(|n| system.force_of_holds(n, &displacement)).collect();
            system.rigid_motion(&forces)
        }
        None => mean_motion(system.level, &displacement),
    };
    let mut deforming = system.in_place(&drift);
    let mut squares = 0.0;
    for ((drift, u), m) in deforming.iter_mut().zip(&displacement).zip(&system.level.node_mass) {
        add_scaled(drift, -1.0, u);
        squares += m * product(drift, drift);
    }
    Ok(Answer { displacement, deforming, amplitude: squares.sqrt() })
}

/// Most iterations of one solution.
const MOST_ITERATIONS: usize = 3000;
/// A solution is done when this many iterations ...
const LOOK_BACK: usize = 8;
/// ... add less than this part of its work.
const TOLERANCE: Real = 1e-7;

/// Solves level `l` at the stiffness `factor` from the displacements `u`, by preconditioned conjugate gradients.
fn solve(systems: &[System], l: usize, factor: Real, mut u: Vec<Block>) -> Result<Vec<Block>, CalibrationError> {
    let system = &systems[l];
    let load = &system.load;
    let mut r = load.clone();
    for_each_node(&mut r, |n, r| add_scaled(r, -1.0, &system.force(n, factor, &u)));
    let mut p = vec![ZERO; u.len()];
    let mut q = p.clone();
    let mut rz = 0.0;
    // What the iterations add to the work 2 f·u − u·K u, which the solution makes largest.
    let mut work = dot(load, &u) + dot(&r, &u);
    let mut gains = [Real::INFINITY; LOOK_BACK];
    let mut iterations = 0;
    loop {
        let z = precondition(systems, l, &r);
        let rz_before = rz;
        rz = dot(&r, &z);
        if rz == 0.0 || gains.iter().sum::<Real>() <= TOLERANCE * work {
            return Ok(u);
        }
        let beta = if iterations == 0 { 0.0 } else { rz / rz_before };
        for_each_node(&mut p, |n, p| {
            let mut next = z[n];
            add_scaled(&mut next, beta, p);
            *p = next;
        });
        for_each_node(&mut q, |n, q| *q = system.force(n, factor, &p));
        let step = rz / dot(&p, &q);
        let gain = step * rz;
        #[expect(clippy::neg_cmp_op_on_partial_ord, reason = "NaN is no gain, too")]
        if !(gain > 0.0) || iterations == MOST_ITERATIONS {
            let residual = (dot(&r, &r) / dot(load, load)).sqrt();
            return Err(CalibrationError::NotConverged { level: l, residual, iterations });
        }
        for_each_node(&mut u, |n, u| add_scaled(u, step, &p[n]));
        for_each_node(&mut r, |n, r| add_scaled(r, -step, &q[n]));
        work += gain;
        gains[iterations % LOOK_BACK] = gain;
        iterations += 1;
    }
}

/// Displacements that roughly balance the forces `r` [N]: what each node alone would give way, on this level and on all
/// coarser ones [Bramble, Pasciak and Xu 1990]; the coarse levels carry forces across the body at once.
fn precondition(systems: &[System], l: usize, r: &[Block]) -> Vec<Block> {
    let system = &systems[l];
    let mut z = vec![ZERO; r.len()];
    for_each_node(&mut z, |n, z| {
        let k = &system.inverse_diagonal[n];
        for i in 0..3 {
            for j in 0..3 {
                z[i][j] = k[i][0] * r[n][0][j] + k[i][1] * r[n][1][j] + k[i][2] * r[n][2][j];
            }
        }
    });
    if let Some(grid) = &system.grid {
        grid.add_correction(r, &mut z);
    } else if l > 0 && system.coarser.len() == r.len() {
        system.add_from_coarser(&precondition(systems, l - 1, &system.to_coarser(r)), &mut z);
    }
    z
}

/// A box grid around the coarsest level, coarse enough to be solved directly: what moves large parts of the body.
struct Grid {
    /// Grid points around each node, and their weights there (n_nodes): trilinear.
    rows: Vec<([u32; 8], [Real; 8])>,
    /// Cholesky factor of the stiffness between grid points, lower rows one after the other [√(N/m)].
    factor: Vec<Real>,
    /// Three times the grid points.
    size: usize,
}

/// Most points of the grid: the direct solution costs their square in each iteration.
const MOST_GRID_POINTS: usize = 150;

impl Grid {
    /// None when the mesh has no extent or its stiffness is not finite.
    fn new(level: &Level, system: &System) -> Option<Grid> {
        let nodes = &level.mesh.nodes;
        let low = nodes.iter().fold(Vec3::repeat(Real::INFINITY), |low, u| low.inf(u));
        let extent = nodes.iter().fold(0.0, |extent: Real, u| extent.max((u - low).max()));
        // The eight grid points around a node, as whole numbers of cells.
        let around = |u: &Vec3, cell: Real| {
            let first = ((u - low) / cell).map(Real::floor);
            [0, 1, 2, 3, 4, 5, 6, 7].map(|c| [0, 1, 2].map(|i| first[i] as u32 + (c >> i & 1)))
        };
        let mut cell = (2.0 * level.spacing).max(extent / 32.0);
        if !(cell > 0.0 && cell.is_finite()) {
            return None;
        }
        let points = loop {
            let mut points: Vec<[u32; 3]> = nodes.iter().flat_map(|u| around(u, cell)).collect();
            points.sort_unstable();
            points.dedup();
            // One cell around all of it has eight.
            if points.len() <= MOST_GRID_POINTS {
                break points;
            }
            cell *= 1.2;
        };
        let row = |u: &Vec3| {
            let corners = around(u, cell);
            let weight = |c: &[u32; 3]| {
                (0..3).map(|i| 1.0 - ((u[i] - low[i]) / cell - Real::from(c[i])).abs()).product::<Real>()
            };
            (corners.map(|c| points.binary_search(&c).unwrap_or(0) as u32), corners.each_ref().map(weight))
        };
        let mut rows: Vec<_> = nodes.iter().map(row).collect();
        for (_, (_, weights)) in rows.iter_mut().enumerate().filter(|(n, _)| system.is_fixed(*n)) {
            *weights = [0.0; 8];
        }

        let size = 3 * points.len();
        let mut stiffness = vec![0.0; size * size];
        for (n, row) in rows.iter().enumerate() {
            for entry in system.start[n] as usize..system.start[n + 1] as usize {
                let mut k = system.elastic[entry];
                (0..3).for_each(|i| k[i][i] += system.spring[entry]);
                let column = &rows[system.column[entry] as usize];
                for (a, weight_a) in row.0.iter().zip(row.1) {
                    for (b, weight_b) in column.0.iter().zip(column.1) {
                        // The lower triangle is all that the factor reads.
                        for i in 0..3 {
                            for j in 0..3 {
                                stiffness[(3 * *a as usize + i) * size + 3 * *b as usize + j] +=
                                    weight_a * weight_b * k[i][j];
                            }
                        }
                    }
                }
            }
        }
        // Points that barely touch the body, and a free body's rigid motions, would leave pivots of rounding errors.
        let trace: Real = (0..size).map(|i| stiffness[i * size + i]).sum();
        (0..size).for_each(|i| stiffness[i * size + i] += 1e-6 * trace / size as Real);
        cholesky(&mut stiffness, size).then_some(Grid { rows, factor: stiffness, size })
    }

    /// Adds to `z` the displacement that balances the forces `r` on the grid points.
    fn add_correction(&self, r: &[Block], z: &mut [Block]) {
        let mut x = vec![[0.0; 3]; self.size];
        for ((points, weights), r) in self.rows.iter().zip(r) {
            for (point, weight) in points.iter().zip(weights) {
                for i in 0..3 {
                    (0..3).for_each(|j| x[3 * *point as usize + i][j] += weight * r[i][j]);
                }
            }
        }
        let row = |i: usize| &self.factor[i * self.size..i * self.size + i + 1];
        for i in 0..self.size {
            let mut sum = x[i];
            for (l, x) in row(i)[..i].iter().zip(&x) {
                (0..3).for_each(|j| sum[j] -= l * x[j]);
            }
            x[i] = sum.map(|s| s / row(i)[i]);
        }
        for i in (0..self.size).rev() {
            x[i] = x[i].map(|s| s / row(i)[i]);
            let known = x[i];
            for (l, x) in row(i)[..i].iter().zip(&mut x) {
                (0..3).for_each(|j| x[j] -= l * known[j]);
            }
        }
        for ((points, weights), z) in self.rows.iter().zip(z) {
            for (point, weight) in points.iter().zip(weights) {
                for i in 0..3 {
                    (0..3).for_each(|j| z[i][j] += weight * x[3 * *point as usize + i][j]);
                }
            }
        }
    }
}

/// Replaces the lower triangle of a symmetric matrix (rows one after the other) by its Cholesky factor; false when the
/// matrix is not positive.
fn cholesky(matrix: &mut [Real], size: usize) -> bool {
    for i in 0..size {
        let (above, row) = matrix.split_at_mut(i * size);
        for j in 0..i {
            let other = &above[j * size..j * size + j + 1];
            let sum: Real = row[..j].iter().zip(other).map(|(a, b)| a * b).sum();
            row[j] = (row[j] - sum) / other[j];
        }
        let pivot = row[i] - row[..i].iter().map(|a| a * a).sum::<Real>();
        #[expect(clippy::neg_cmp_op_on_partial_ord, reason = "NaN is not positive, too")]
        if !(pivot > 0.0) {
            return false;
        }
        row[i] = pivot.sqrt();
    }
    true
}

/// The elastic stiffness of a level by rows: starts, columns and blocks [N/m]; fixed nodes get empty rows.
fn elastic_rows(
    level: &Level,
    material: impl Fn(usize) -> Material + Sync,
    fixed: &[bool],
) -> (Vec<u32>, Vec<u32>, Vec<Block>) {
    let mesh = &level.mesh;
    let n_nodes = mesh.nodes.len();
    let corners: Vec<(u32, u32)> = {
        let all = mesh.elements.iter().enumerate();
        let mut corners: Vec<_> = all.flat_map(|(e, nodes)| nodes.map(|n| (n, e as u32))).collect();
        corners.sort_unstable();
        corners
    };
    let starts: Vec<usize> = (0..=n_nodes).map(|n| corners.partition_point(|c| (c.0 as usize) < n)).collect();
    let row = |n: usize| {
        let mut row: Vec<(u32, Block)> = Vec::with_capacity(28);
        if fixed[n] {
            return row;
        }
        for &(_, e) in &corners[starts[n]..starts[n + 1]] {
            let (e, u) = (e as usize, mesh.corners(e as usize));
            let (gradients, volume) = gradients(&u);
            let material = material(e);
            let lambda = material.lambda * level.fraction[e] * volume;
            let mu = material.mu * level.fraction[e] * volume;
            let nodes = mesh.elements[e];
            let Some(a) = nodes.iter().position(|m| *m as usize == n) else { continue };
            let ga = gradients[a];
            for (m, gb) in nodes.into_iter().zip(gradients) {
                let place = row.iter().position(|(column, _)| *column == m).unwrap_or_else(|| {
                    row.push((m, ZERO));
                    row.len() - 1
                });
                let both = mu * ga.dot(&gb);
                for i in 0..3 {
                    for j in 0..3 {
                        row[place].1[i][j] += lambda * ga[i] * gb[j] + mu * gb[i] * ga[j];
                    }
                    row[place].1[i][i] += both;
                }
            }
        }
        row.sort_unstable_by_key(|(column, _)| *column);
        row
    };
    let rows: Vec<_> = (0..n_nodes).into_par_iter().map(row).collect();
    let mut start = vec![0];
    let (mut column, mut block) = (Vec::new(), Vec::new());
    for row in rows {
        for (c, b) in row {
            column.push(c);
            block.push(b);
        }
        start.push(column.len() as u32);
    }
    (start, column, block)
}

/// Gradients of the barycentric coordinates [1/m] of the tetrahedron `u`, and its volume [m³].
fn gradients(u: &[Vec3; 4]) -> ([Vec3; 4], Real) {
    let (a, b, c) = (u[1] - u[0], u[2] - u[0], u[3] - u[0]);
    let six_volume = a.cross(&b).dot(&c);
    let (g1, g2, g3) = (b.cross(&c) / six_volume, c.cross(&a) / six_volume, a.cross(&b) / six_volume);
    ([-(g1 + g2 + g3), g1, g2, g3], six_volume / 6.0)
}

/// Weight along each axis [N] for 1 m/s².
fn weight(level: &Level) -> Vec<Block> {
    level.node_mass.iter().map(|m| (Mat3::identity() * *m).into()).collect()
}

/// A load without resultant along each axis [N]: an acceleration that grows with the square of the distance from the
/// centre of mass (1 m/s² at the radius of gyration), less the rigid motion in it. It bends what is long or flat.
fn balanced_load(level: &Level) -> Vec<Block> {
    let arms = Arms::new(level);
    let growing = |u: &Vec3| (Mat3::identity() * arms.to(u).norm_squared()).into();
    let mut load: Vec<Block> = level.mesh.nodes.iter().map(growing).collect();
    let rigid = mean_motion(level, &load);
    for ((load, u), m) in load.iter_mut().zip(&level.mesh.nodes).zip(&level.node_mass) {
        // nalgebra stores columns, a block rows.
        *load = ((columns(load) - rigid_modes(arms.to(u)) * rigid) * *m).transpose().into();
    }
    load
}

/// A rigid motion for the load along each axis (column): three shifts [m], three turns times the radius of gyration [m].
type RigidMotion = SMatrix<Real, 6, 3>;
type Mat6 = SMatrix<Real, 6, 6>;

/// Where points lie from the centre of mass, in radii of gyration: makes shifts and turns comparable.
struct Arms {
    centre: Vec3,
    radius: Real,
}

impl Arms {
    fn new(level: &Level) -> Arms {
        let mass: Real = level.node_mass.iter().sum();
        let centre = level.centre_of_mass();
        let moment = level.mesh.nodes.iter().zip(&level.node_mass).map(|(u, m)| m * (u - centre).norm_squared());
        Arms { centre, radius: (moment.sum::<Real>() / mass).sqrt() }
    }

    fn to(&self, point: &Vec3) -> Vec3 {
        (point - self.centre) / self.radius
    }
}

/// Displacement at `arm` for the six rigid motions.
fn rigid_modes(arm: Vec3) -> SMatrix<Real, 3, 6> {
    let (x, y, z) = (arm.x, arm.y, arm.z);
    SMatrix::<Real, 3, 6>::new(
        1.0, 0.0, 0.0, 0.0, z, -y, //
        0.0, 1.0, 0.0, -z, 0.0, x, //
        0.0, 0.0, 1.0, y, -x, 0.0,
    )
}

/// The rigid motion nearest to `u` in the mean over the mass.
fn mean_motion(level: &Level, u: &[Block]) -> RigidMotion {
    let arms = Arms::new(level);
    let (mut inertia, mut momentum) = (Mat6::zeros(), RigidMotion::zeros());
    for ((at, m), u) in level.mesh.nodes.iter().zip(&level.node_mass).zip(u) {
        let modes = rigid_modes(arms.to(at));
        inertia += modes.transpose() * modes * *m;
        momentum += modes.transpose() * columns(u) * *m;
    }
    inertia.cholesky().map_or(RigidMotion::zeros(), |inertia| inertia.solve(&momentum))
}

/// Stiffness of springs (arm, N/m) against the six rigid motions [N/m].
fn rigid_stiffness(springs: impl Iterator<Item = (Vec3, Real)>) -> Mat6 {
    springs.fold(Mat6::zeros(), |sum, (arm, stiffness)| {
        let modes = rigid_modes(arm);
        sum + modes.transpose() * modes * stiffness
    })
}

/// Arm and stiffness [N/m] of each hold.
fn held_points(level: &Level, holds: &[(u32, Real)]) -> impl Iterator<Item = (Vec3, Real)> {
    let arms = Arms::new(level);
    holds.iter().map(move |&(vertex, stiffness)| {
        let host = &level.embedding[vertex as usize];
        let corners = level.mesh.corners(host.element as usize);
        let point: Vec3 = corners.iter().zip(host.weights).map(|(u, w)| u * w).sum();
        (arms.to(&point), stiffness)
    })
}

/// True when holds and fixed nodes leave no rigid motion free. A body that hangs on a point or a hinge counts as free.
fn holds_firmly(level: &Level, holds: &[(u32, Real)]) -> bool {
    // How firm a fixed node is makes no difference here, as long as it compares with the springs.
    let firm = holds.iter().map(|hold| hold.1).fold(0.0, Real::max);
    let firm = if firm > 0.0 { firm } else { 1.0 };
    let arms = Arms::new(level);
    let fixed = level.fixed.iter().map(|n| (arms.to(&level.mesh.nodes[*n as usize]), firm));
    let stiffness = rigid_stiffness(held_points(level, holds).chain(fixed));
    // Without the shared scale a pivot would tell nothing. A hinge leaves one of rounding errors; what holds less than
    // a thousandth of the body's size apart is one, too.
    let scaled = stiffness * (6.0 / stiffness.trace());
    scaled.cholesky().is_some_and(|factor| factor.l().diagonal().iter().all(|pivot| pivot * pivot > 1e-6))
}

/// A block as nalgebra's matrix.
fn columns(block: &Block) -> Mat3 {
    Mat3::from(*block).transpose()
}

/// Index of column `b` in row `a`; none in the rows of fixed nodes.
fn entry(start: &[u32], column: &[u32], a: u32, b: u32) -> Option<usize> {
    let first = start[a as usize] as usize;
    column[first..start[a as usize + 1] as usize].binary_search(&b).ok().map(|i| first + i)
}

/// Rows of four weights by column: starts (n_columns + 1) into row and weight.
fn transposed(rows: &[([u32; 4], [Real; 4])], n_columns: usize) -> (Vec<u32>, Vec<(u32, Real)>) {
    let mut start = vec![0u32; n_columns + 1];
    for &c in rows.iter().flat_map(|(columns, _)| columns) {
        start[c as usize + 1] += 1;
    }
    for c in 1..start.len() {
        start[c] += start[c - 1];
    }
    let mut next = start.clone();
    let mut list = vec![(0, 0.0); rows.len() * 4];
    for (n, (columns, weights)) in rows.iter().enumerate() {
        for (c, weight) in columns.iter().zip(weights) {
            list[next[*c as usize] as usize] = (n as u32, *weight);
            next[*c as usize] += 1;
        }
    }
    (start, list)
}

/// Visits every node's block, chunks side by side.
fn for_each_node(blocks: &mut [Block], visit: impl Fn(usize, &mut Block) + Sync) {
    blocks.par_chunks_mut(CHUNK).enumerate().for_each(|(chunk, blocks)| {
        for (i, block) in blocks.iter_mut().enumerate() {
            visit(chunk * CHUNK + i, block);
        }
    });
}

/// `a += s b`.
fn add_scaled(a: &mut Block, s: Real, b: &Block) {
    for i in 0..3 {
        for j in 0..3 {
            a[i][j] += s * b[i][j];
        }
    }
}

/// Sum of the products of all components.
fn product(a: &Block, b: &Block) -> Real {
    (0..3).map(|i| a[i][0] * b[i][0] + a[i][1] * b[i][1] + a[i][2] * b[i][2]).sum()
}

/// Sum of the products over all nodes; chunks are summed side by side, their sums in order.
fn dot(a: &[Block], b: &[Block]) -> Real {
    let sum = |(a, b): (&[Block], &[Block])| a.iter().zip(b).map(|(a, b)| product(a, b)).sum();
    let sums: Vec<Real> = a.par_chunks(CHUNK).zip(b.par_chunks(CHUNK)).map(sum).collect();
    sums.iter().sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn factors(
        levels: &[Level],
        material: impl Fn(usize, usize) -> Material + Sync,
        holds: &[(u32, Real)],
    ) -> Result<Vec<Real>, CalibrationError> {
        calibrate(levels, material, holds).map(|c| c.factors)
    }
    use crate::geometry::Surface;
    use crate::geometry::primitives::{box_mesh, box_surface};
    use crate::hierarchy::cover::cover;
    use crate::hierarchy::{embedding, parentage};
    use nalgebra::DMatrix;

    fn jelly() -> Material {
        Material::from_young(5e3, 0.45, 1050.0)
    }

    fn covers(surface: &Surface, spacings: &[Real]) -> Vec<Level> {
        let one = |(i, a): (usize, &Real)| cover(surface, *a, i as u32, 1050.0).unwrap();
        tied(spacings.iter().enumerate().map(one).collect(), surface)
    }

    /// Conforming boxes with these numbers of cells, coarse to fine.
    fn boxes(size: Vec3, cells: &[[u32; 3]], surface: &Surface) -> Vec<Level> {
        let one = |cells: &[u32; 3]| {
            let mesh = box_mesh(size, *cells);
            let fraction = vec![1.0; mesh.elements.len()];
            Level::new(mesh, fraction, size.x / Real::from(cells[0]), 1050.0, None)
        };
        tied(cells.iter().map(one).collect(), surface)
    }

    fn tied(mut levels: Vec<Level>, surface: &Surface) -> Vec<Level> {
        parentage::tie(&mut levels);
        embedding::embed(&mut levels, &surface.vertices);
        levels
    }

    /// Area springs of `per_area` [N/m³] on the face x = 0.
    fn clamp(surface: &Surface, per_area: Real) -> Vec<(u32, Real)> {
        let areas = surface.vertex_areas();
        let held = (0..areas.len()).filter(|v| surface.vertices[*v].x < 1e-9);
        held.map(|v| (v as u32, per_area * areas[v])).collect()
    }

    /// Root mean square displacement [m] of a level under `load` (n_nodes), by dense elimination over the free nodes.
    fn dense_amplitude(level: &Level, factor: Real, holds: &[(u32, Real)], load: &[Real]) -> Real {
        let free: Vec<usize> = (0..level.mesh.nodes.len()).filter(|n| !level.fixed.contains(&(*n as u32))).collect();
        let mut place = vec![usize::MAX; level.mesh.nodes.len()];
        free.iter().enumerate().for_each(|(i, n)| place[*n] = i);
        let mut k = DMatrix::<Real>::zeros(3 * free.len(), 3 * free.len());
        let Material { lambda, mu, .. } = jelly();
        // Energy density ½ λ tr(ε)² + μ ε:ε, differentiated through the six components of the strain.
        let law = SMatrix::<Real, 6, 6>::from_fn(|i, j| match (i, j) {
            (0..3, 0..3) => lambda + if i == j { 2.0 * mu } else { 0.0 },
            _ => {
                if i == j {
                    mu
                } else {
                    0.0
                }
            }
        });
        for (e, nodes) in level.mesh.elements.iter().enumerate() {
            let u = level.mesh.corners(e);
            let edges = Mat3::from_columns(&[u[1] - u[0], u[2] - u[0], u[3] - u[0]]);
            let inverse = edges.try_inverse().unwrap();
            let mut g = [Vec3::zeros(); 4];
            for i in 0..3 {
                g[i + 1] = inverse.row(i).transpose();
                g[0] -= g[i + 1];
            }
            let strain = |g: Vec3| {
                #[rustfmt::skip]
                let b = SMatrix::<Real, 6, 3>::new(
                    g.x, 0.0, 0.0,  0.0, g.y, 0.0,  0.0, 0.0, g.z,
                    g.y, g.x, 0.0,  0.0, g.z, g.y,  g.z, 0.0, g.x,
                );
                b
            };
            let scale = factor * level.fraction[e] * edges.determinant() / 6.0;
            for (a, ga) in nodes.iter().zip(g) {
                for (b, gb) in nodes.iter().zip(g) {
                    let (a, b) = (place[*a as usize], place[*b as usize]);
                    if a != usize::MAX && b != usize::MAX {
                        let mut view = k.fixed_view_mut::<3, 3>(3 * a, 3 * b);
                        view += strain(ga).transpose() * law * strain(gb) * scale;
                    }
                }
            }
        }
        for &(vertex, stiffness) in holds {
            let (nodes, weights) = row(&level.embedding[vertex as usize], &level.mesh);
            for (a, wa) in nodes.iter().zip(weights) {
                for (b, wb) in nodes.iter().zip(weights) {
                    for i in 0..3 {
                        k[(3 * place[*a as usize] + i, 3 * place[*b as usize] + i)] += stiffness * wa * wb;
                    }
                }
            }
        }
        let f = DMatrix::from_fn(3 * free.len(), 3, |i, j| if i % 3 == j { load[free[i / 3]] } else { 0.0 });
        let u = k.cholesky().unwrap().solve(&f);
        let squares = (0..3 * free.len()).map(|i| level.node_mass[free[i / 3]] * u.row(i).norm_squared());
        (squares.sum::<Real>() / level.node_mass.iter().sum::<Real>()).sqrt()
    }

    /// The finest level's weight, handed down.
    fn handed_down(levels: &[Level]) -> Vec<Vec<Real>> {
        let mut loads = vec![levels.last().unwrap().node_mass.clone()];
        for l in (1..levels.len()).rev() {
            let mut load = vec![0.0; levels[l - 1].mesh.nodes.len()];
            for (n, (host, f)) in levels[l].coarser_host.iter().zip(&loads[0]).enumerate() {
                let (nodes, weights) = row(host, &levels[l - 1].mesh);
                if !levels[l].fixed.contains(&(n as u32)) {
                    nodes.iter().zip(weights).for_each(|(c, w)| load[*c as usize] += w * f);
                }
            }
            loads.insert(0, load);
        }
        loads
    }

    /// All levels move as far as the finest, by the dense solution.
    fn agree(name: &str, levels: &[Level], factors: &[Real], holds: &[(u32, Real)], tolerance: Real) {
        let amplitude = |l: usize, factor| dense_amplitude(&levels[l], factor, holds, &handed_down(levels)[l]);
        let wanted = amplitude(levels.len() - 1, 1.0);
        for (l, factor) in factors.iter().enumerate() {
            let (raw, calibrated) = (amplitude(l, 1.0) / wanted - 1.0, amplitude(l, *factor) / wanted - 1.0);
            let nodes = levels[l].mesh.nodes.len();
            println!("{name}, {nodes} nodes: factor {factor:.4}, amplitude {raw:+.4} before, {calibrated:+.5} after");
            assert!(calibrated.abs() < tolerance, "{name}, level {l}: {calibrated}");
        }
    }

    #[test]
    fn one_level_keeps_its_material() {
        let surface = box_surface(Vec3::repeat(0.1), [4; 3]);
        let levels = covers(&surface, &[0.03]);
        assert_eq!(factors(&levels, |_, _| jelly(), &[]), Ok(vec![1.0]));
        assert_eq!(factors(&[], |_, _| jelly(), &[]), Ok(vec![]));
    }

    #[test]
    fn covers_of_a_clamped_cube_move_as_far_as_the_finest() {
        let surface = box_surface(Vec3::repeat(0.1), [12; 3]);
        let levels = covers(&surface, &[0.05, 0.035, 0.022]);
        let holds = clamp(&surface, 10.0 * 5e3 / 0.022);
        let factors = factors(&levels, |_, _| jelly(), &holds).unwrap();
        assert!(factors.is_sorted() && factors[0] > 0.8 && factors[0] < 0.95, "{factors:?}");
        // The dense solution counts what the body sinks into its springs, too, which no factor moves.
        agree("cube", &levels, &factors, &holds, 2e-3);
    }

    #[test]
    fn conforming_boxes_with_fixed_nodes_move_as_far_as_the_finest() {
        let size = Vec3::new(0.2, 0.05, 0.05);
        let surface = box_surface(size, [8, 2, 2]);
        let mut levels = boxes(size, &[[4, 1, 1], [8, 2, 2], [16, 4, 4]], &surface);
        for level in &mut levels {
            level.fixed =
                (0..level.mesh.nodes.len() as u32).filter(|n| level.mesh.nodes[*n as usize].x == 0.0).collect();
        }
        let factors = factors(&levels, |_, _| jelly(), &[]).unwrap();
        agree("bar", &levels, &factors, &[], 1e-3);
    }

    #[test]
    fn a_soft_bed_does_not_hide_the_stiffness_of_elements() {
        let surface = box_surface(Vec3::repeat(0.1), [10; 3]);
        let levels = covers(&surface, &[0.035, 0.02]);
        let factor = |per_area: Real| factors(&levels, |_, _| jelly(), &clamp(&surface, per_area)).unwrap()[0];
        // Springs ten thousand times softer: the body sinks a hundred times more than it deforms.
        let (firm, soft) = (factor(10.0 * 5e3 / 0.02), factor(1e-3 * 5e3 / 0.02));
        println!("factor on firm springs {firm:.4}, on soft ones {soft:.4}");
        assert!((soft / firm - 1.0).abs() < 0.1);
        assert!((factor(1e-5 * 5e3 / 0.02) / soft - 1.0).abs() < 1e-3);
        // Down to springs of the size of rounding errors.
        for per_area in [1.0, 1e-3, 1e-6, 1e-9] {
            assert!((factor(per_area) / soft - 1.0).abs() < 2e-3, "{per_area}: {}", factor(per_area));
        }
    }

    #[test]
    fn a_free_body_and_one_on_a_hinge_have_factors_too() {
        let surface = box_surface(Vec3::new(0.3, 0.06, 0.06), [20, 4, 4]);
        let levels = covers(&surface, &[0.03, 0.02, 0.014]);
        let free = factors(&levels, |_, _| jelly(), &[]).unwrap();
        println!("free beam {free:?}");
        assert!(free[0] > 0.9 && free[0] < free[1] && free[1] < 1.02, "{free:?}");
        let point = factors(&levels, |_, _| jelly(), &[(0, 1e3)]).unwrap();
        let hinge: Vec<_> = (0..3).map(|v| (v, 1e3)).collect();
        assert_eq!(surface.vertices[..3].iter().map(|u| (u.x, u.z)).collect::<Vec<_>>(), vec![(0.0, 0.0); 3]);
        assert_eq!(point, free);
        assert_eq!(factors(&levels, |_, _| jelly(), &hinge).unwrap(), free);
    }

    #[test]
    fn turning_the_body_or_changing_its_units_does_not_change_the_factors() {
        let surface = box_surface(Vec3::new(0.1, 0.05, 0.05), [8, 4, 4]);
        let mut levels = covers(&surface, &[0.03, 0.015]);
        let holds = clamp(&surface, 1e6);
        for holds in [&holds[..], &[]] {
            let before = factors(&levels, |_, _| jelly(), holds).unwrap();
            let turn = nalgebra::Rotation3::from_euler_angles(0.3, -0.8, 1.9);
            for u in levels.iter_mut().flat_map(|level| &mut level.mesh.nodes) {
                *u = turn * *u + Vec3::new(0.3, -2.0, 5.0);
            }
            let after = factors(&levels, |_, _| jelly(), holds).unwrap();
            println!("{before:?} {after:?}");
            assert!((after[0] / before[0] - 1.0).abs() < 1e-5, "{before:?} {after:?}");
        }
        // Stiffer elements on stiffer springs are the same body under less weight; powers of two round nothing.
        let stiff = Material { lambda: 1024.0 * jelly().lambda, mu: 1024.0 * jelly().mu, ..jelly() };
        let stiffer: Vec<_> = holds.iter().map(|(v, k)| (*v, 1024.0 * k)).collect();
        let before = factors(&levels, |_, _| jelly(), &holds).unwrap();
        assert_eq!(factors(&levels, |_, _| stiff, &stiffer).unwrap(), before);
    }

    #[test]
    fn the_factors_do_not_depend_on_the_number_of_threads() {
        let surface = box_surface(Vec3::repeat(0.1), [10; 3]);
        let levels = covers(&surface, &[0.025, 0.009]);
        assert!(levels[1].mesh.nodes.len() > 3 * CHUNK);
        let holds = clamp(&surface, 1e6);
        let bits = |threads| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| factors(&levels, |_, _| jelly(), &holds).unwrap()[0].to_bits())
        };
        assert_eq!(bits(1), bits(2));
        assert_eq!(bits(1), bits(5));
    }

    #[test]
    fn a_finest_level_of_another_material_is_matched_or_the_end_of_the_range_returned() {
        let surface = box_surface(Vec3::repeat(0.1), [10; 3]);
        let levels = covers(&surface, &[0.03, 0.02]);
        let factor = |scale: Real| {
            let material =
                |l: usize, _: usize| Material::from_young(if l == 0 { scale * 5e3 } else { 5e3 }, 0.45, 1050.0);
            factors(&levels, material, &clamp(&surface, 1e6)).unwrap()[0]
        };
        let usual = factor(1.0);
        assert!((factor(2.0) * 2.0 / usual - 1.0).abs() < 1e-3);
        assert_eq!(factor(10.0), LEAST_FACTOR);
        assert_eq!(factor(0.1), LARGEST_FACTOR);
    }

    #[test]
    fn every_node_fixed_or_a_broken_material_is_no_panic() {
        let size = Vec3::repeat(0.1);
        let surface = box_surface(size, [2; 3]);
        let mut levels = boxes(size, &[[1; 3], [2; 3]], &surface);
        let broken = Material { lambda: Real::NAN, ..jelly() };
        assert!(matches!(factors(&levels, |_, _| broken, &[]), Err(CalibrationError::NotConverged { level: 0, .. })));
        for level in &mut levels {
            level.fixed = (0..level.mesh.nodes.len() as u32).collect();
        }
        assert_eq!(factors(&levels, |_, _| jelly(), &[]), Ok(vec![1.0, 1.0]));
    }
}
