//! The interface patch test: a uniform strain should pass through the seam between two levels unchanged, and with
//! quarter weights it does not. Here are the error, three cures, and what of it a tool feels.

use super::coupling::Mixed;
use super::laws::green_strain;
use super::levels::Levels;
use super::relax::relax;
use super::rows::Row;
use palpate_core::math::{Mat3, Real, Vec3};

/// Which components of a node's position are prescribed: `(node, axis)`.
pub type Held<'a> = &'a dyn Fn(usize, usize) -> bool;

/// How the elements at an interface are weighted.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Weights {
    /// A quarter per active vertex.
    Quarter,
    /// So many Kaczmarz sweeps from the quarter weights towards weights that pass the test.
    Kaczmarz(usize),
    /// The weights between [`LEAST`] and 1 that miss the test least, in the sense of least squares.
    BoundedLeastSquares,
}

impl Weights {
    /// Words for a table.
    pub fn name(self) -> String {
        match self {
            Self::Quarter => "quarter weights".into(),
            Self::Kaczmarz(sweeps) => format!("{sweeps} Kaczmarz sweeps"),
            Self::BoundedLeastSquares => "bounded least squares".into(),
        }
    }
}

/// Smallest weight of an element that touches an active node: with nothing left, nodes come loose.
pub const LEAST: Real = 0.05;
/// Iterations of the bounded least squares; a fixed number, so that its time can be compared.
const ITERATIONS: usize = 400;
/// Pull towards the quarter weights, against the largest squared singular value: picks one of many solutions.
const PULL: Real = 1e-4;

/// Unknown weights and what they have to satisfy, `Σ_t w_t vol_t Σ_i P_ij ∂L_i/∂u_a = 0` for every free component `a` of
/// every moving node `j`: the force under any uniform stress.
struct Equations {
    /// Places in `Mixed::weighted` of the unknown ones.
    unknown: Vec<usize>,
    /// One row for each equation: its coefficients by number of unknown [m²].
    rows: Vec<Row>,
    /// Right-hand sides [m²].
    target: Vec<Real>,
}

impl Equations {
    fn new(mixed: &Mixed, held: Held) -> Self {
        let mut row_of: Vec<Option<&Row>> = vec![None; mixed.mass.len()];
        mixed.interface.iter().for_each(|(i, row)| row_of[*i] = Some(row));
        let mut unknown = Vec::new();
        let mut rows = vec![Row::new(); 3 * mixed.mass.len()];
        let mut target = vec![0.0; rows.len()];
        for (place, (e, weight)) in mixed.weighted.iter().enumerate() {
            let element = &mixed.levels.elements[*e];
            let mut add = |node: usize, vector: Vec3| {
                for axis in (0..3).filter(|a| mixed.moving[node] && !held(node, *a)) {
                    if *weight < 1.0 {
                        rows[3 * node + axis].push((unknown.len(), vector[axis]));
                    } else {
                        target[3 * node + axis] -= vector[axis];
                    }
                }
            };
            for (n, gradient) in element.nodes.iter().zip(&element.gradient) {
                match row_of[*n] {
                    Some(row) => row.iter().for_each(|(j, p)| add(*j, gradient * (element.volume * p))),
                    None => add(*n, gradient * element.volume),
                }
            }
            if *weight < 1.0 {
                unknown.push(place);
            }
        }
        let kept: Vec<usize> = (0..rows.len()).filter(|r| !rows[*r].is_empty()).collect();
        Self {
            unknown,
            target: kept.iter().map(|r| target[*r]).collect(),
            rows: kept.into_iter().map(|r| std::mem::take(&mut rows[r])).collect(),
        }
    }

    fn residual(&self, row: usize, weights: &[Real]) -> Real {
        self.rows[row].iter().map(|(t, a)| a * weights[*t]).sum::<Real>() - self.target[row]
    }

    /// `Aᵀ(A w − b)`.
    fn gradient(&self, weights: &[Real]) -> Vec<Real> {
        let mut gradient = vec![0.0; weights.len()];
        for (r, row) in self.rows.iter().enumerate() {
            let residual = self.residual(r, weights);
            row.iter().for_each(|(t, a)| gradient[*t] += a * residual);
        }
        gradient
    }
}

/// Gives the mixed elements of `mixed` their `weights`, and the nodes the masses that follow. Of the components that are
/// `held` nothing is asked.
pub fn weigh(mixed: &mut Mixed, weights: Weights, held: Held) {
    if weights == Weights::Quarter {
        return;
    }
    let equations = Equations::new(mixed, held);
    let quarter: Vec<Real> = equations.unknown.iter().map(|place| mixed.weighted[*place].1).collect();
    let found = match weights {
        Weights::Kaczmarz(sweeps) => kaczmarz(&equations, quarter, sweeps),
        _ => bounded_least_squares(&equations, &quarter),
    };
    for (place, weight) in equations.unknown.iter().zip(found) {
        mixed.weighted[*place].1 = weight;
    }
    mixed.lump_mass();
}

fn kaczmarz(equations: &Equations, mut weights: Vec<Real>, sweeps: usize) -> Vec<Real> {
    for _ in 0..sweeps {
        for (r, row) in equations.rows.iter().enumerate() {
            let square: Real = row.iter().map(|(_, a)| a * a).sum();
            if square > 0.0 {
                let step = equations.residual(r, &weights) / square;
                row.iter().for_each(|(t, a)| weights[*t] -= step * a);
            }
        }
        weights.iter_mut().for_each(|w| *w = w.max(LEAST));
    }
    weights
}

/// Accelerated projected gradients (FISTA).
fn bounded_least_squares(equations: &Equations, quarter: &[Real]) -> Vec<Real> {
    // The largest squared singular value bounds the step.
    let mut probe = vec![1.0; quarter.len()];
    let mut largest = 1.0;
    for _ in 0..30 {
        let offset = equations.gradient(&vec![0.0; probe.len()]);
        let image: Vec<Real> = equations.gradient(&probe).iter().zip(offset).map(|(a, b)| a - b).collect();
        largest = image.iter().map(|a| a * a).sum::<Real>().sqrt();
        probe = image.into_iter().map(|a| a / largest).collect();
    }
    let (pull, step) = (PULL * largest, 1.0 / (1.1 * largest));
    let mut weights = quarter.to_vec();
    let mut ahead = weights.clone();
    let mut momentum: Real = 1.0;
    for _ in 0..ITERATIONS {
        let gradient = equations.gradient(&ahead);
        let next_momentum = 0.5 * (1.0 + (1.0 + 4.0 * momentum * momentum).sqrt());
        for t in 0..weights.len() {
            let next = (ahead[t] - step * (gradient[t] + pull * (ahead[t] - quarter[t]))).clamp(LEAST, 1.0);
            ahead[t] = next + (momentum - 1.0) / next_momentum * (next - weights[t]);
            weights[t] = next;
        }
        momentum = next_momentum;
    }
    weights
}

/// Result of one patch test.
#[derive(Clone, Copy, Debug)]
pub struct PatchError {
    /// Root mean square over the weighted elements of |E − Ē| / |Ē| once the nodes have come to rest.
    pub strain: Real,
    /// Largest force on a free component before they moved, over (λ + 2μ) |Ē| spacing² of the finest level.
    pub ghost_force: Real,
}

/// Brings all but the `held` components of `x` [m] to rest; the largest force on one of the others before [N].
fn settle(mixed: &Mixed, x: &mut [Vec3], held: Held) -> Real {
    let mut first = None;
    relax(x, &mixed.mass, 0.4 * 2.0 / mixed.largest_frequency(), 4000, |x| {
        mixed.place_interface(x);
        let mut force = mixed.force(x);
        for (n, force) in force.iter_mut().enumerate() {
            (0..3).filter(|a| held(n, *a)).for_each(|a| force[a] = 0.0);
        }
        let largest = force.iter().map(|f| f.norm()).fold(0.0, Real::max);
        (largest > 1e-4 * *first.get_or_insert(largest)).then_some(force)
    });
    mixed.place_interface(x);
    first.unwrap_or(0.0)
}

/// Stretches the body along x by `stretch` (0.1 is 10 %) with the contraction of a free bar, holds the `held`
/// components there, lets the others go and measures what they have done to the strain.
pub fn patch_error(mixed: &Mixed, stretch: Real, held: Held) -> PatchError {
    let levels = mixed.levels;
    let across = 1.0 - levels.material.poisson_ratio() * stretch;
    let f = Mat3::from_diagonal(&Vec3::new(1.0 + stretch, across, across));
    let mean = green_strain(&f);
    let mut x: Vec<Vec3> = levels.rest.iter().map(|u| f * u).collect();
    let ghost_force = settle(mixed, &mut x, held);
    let (mut square, mut volume) = (0.0, 0.0);
    for (e, weight) in &mixed.weighted {
        let element = &levels.elements[*e];
        square += weight * element.volume * (green_strain(&element.gradient_of(&x)) - mean).norm_squared();
        volume += weight * element.volume;
    }
    let spacing = levels.tied[levels.count() - 1].spacing;
    PatchError {
        strain: (square / volume).sqrt() / mean.norm(),
        ghost_force: ghost_force / (levels.material.pressure_modulus() * mean.norm() * spacing * spacing),
    }
}

/// A few neighbouring nodes of the finest level that a tool moves together.
#[derive(Clone, Debug)]
pub struct Press {
    nodes: Vec<usize>,
    by: Vec3,
}

/// How far they are moved, over the spacing of the finest level.
const PRESSED: Real = 0.4;
/// Fewer nodes are not what a tool touches.
const LEAST_PRESSED: usize = 3;

impl Press {
    /// In a box from the origin to `size` [m], in the middle of what is `active` of its finest level: into a face, or
    /// downward inside the body where no face is that fine. `None` when too few nodes are that fine for a tool.
    pub fn new(levels: &Levels, active: &[bool], size: Vec3) -> Option<Self> {
        let last = levels.count() - 1;
        let finest = levels.first_node[last]..levels.first_node[last + 1];
        let coarse: Vec<Vec3> = finest.clone().filter(|n| !active[*n]).map(|n| levels.rest[n]).collect();
        let depth = |n: usize| coarse.iter().map(|u| (u - levels.rest[n]).norm()).fold(size.norm(), Real::min);
        // Across which axis the node lies on a face; on an edge it does on two.
        let walls = sliding_walls(&levels.rest, size);
        let faces = |n: usize| (0..3).filter(|axis| walls(n, *axis)).collect::<Vec<_>>();
        let middle = finest
            .filter(|n| active[*n] && !levels.fixed[*n] && faces(*n).len() < 2)
            .max_by(|a, b| faces(*a).len().cmp(&faces(*b).len()).then(depth(*a).total_cmp(&depth(*b))))?;
        let by = match faces(middle).first() {
            Some(&axis) if levels.rest[middle][axis] < 0.5 * size[axis] => Vec3::ith(axis, 1.0),
            Some(&axis) => Vec3::ith(axis, -1.0),
            None => -Vec3::z(),
        };
        let elements = &levels.elements[levels.first_element[last]..];
        let around = elements.iter().filter(|e| e.nodes.contains(&middle)).flat_map(|e| e.nodes);
        let mut nodes: Vec<usize> =
            around.filter(|n| active[*n] && !levels.fixed[*n] && faces(*n) == faces(middle)).collect();
        nodes.sort_unstable();
        nodes.dedup();
        (nodes.len() >= LEAST_PRESSED).then_some(Self { nodes, by: by * (PRESSED * levels.tied[last].spacing) })
    }

    /// The force [N] that it takes, once the body has come to rest.
    pub fn force(&self, mixed: &Mixed) -> Real {
        let mut x = mixed.levels.rest.clone();
        self.nodes.iter().for_each(|n| x[*n] += self.by);
        settle(mixed, &mut x, &|n, _| self.nodes.binary_search(&n).is_ok());
        let force = mixed.force(&x);
        -self.nodes.iter().map(|n| force[*n].dot(&self.by)).sum::<Real>() / self.by.norm()
    }
}

/// The held components of a box from the origin to `size` [m] between sliding walls: each node that lies on a face keeps
/// its place across that face.
pub fn sliding_walls(rest: &[Vec3], size: Vec3) -> impl Fn(usize, usize) -> bool + '_ {
    move |node, axis| rest[node][axis] < 1e-9 || rest[node][axis] > size[axis] - 1e-9
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::coupling::Coupling;
    use crate::laws::Law;
    use crate::levels::Levels;
    use crate::rows::RowKind;
    use palpate_core::model::Material;

    #[test]
    fn a_uniform_level_passes_and_better_weights_come_nearer() {
        let size = Vec3::repeat(1.0);
        let levels = Levels::of_box(size, &[[2; 3], [3; 3], [5; 3]], Material::from_young(2e5, 0.33, 1000.0), false);
        let held = sliding_walls(&levels.rest, size);
        let error = |active: Vec<bool>, weights: Weights| {
            let mut mixed = Mixed::new(&levels, active, Law::Green, Coupling::Energy, RowKind::Hosts);
            weigh(&mut mixed, weights, &held);
            patch_error(&mixed, 0.1, &held).strain
        };
        assert!(error(levels.uniform(1), Weights::Quarter) < 1e-12);
        let active = levels.random_active_set(2);
        let quarter = error(active.clone(), Weights::Quarter);
        let sweeps = error(active.clone(), Weights::Kaczmarz(20));
        let bounded = error(active, Weights::BoundedLeastSquares);
        assert!(bounded < sweeps && sweeps < quarter, "{quarter} {sweeps} {bounded}");
    }

    #[test]
    fn a_press_moves_finest_nodes_and_is_resisted() {
        let size = Vec3::repeat(1.0);
        let levels = Levels::of_box(size, &[[2; 3], [3; 3], [5; 3]], Material::from_young(2e5, 0.33, 1000.0), true);
        assert!(Press::new(&levels, &levels.uniform(1), size).is_none());
        for seed in 0..4 {
            let active = levels.random_active_set(seed);
            let Some(press) = Press::new(&levels, &active, size) else { continue };
            assert!(press.nodes.iter().all(|n| active[*n] && !levels.fixed[*n] && levels.level_of[*n] == 2));
            let force = |active| {
                press.force(&Mixed::new(&levels, active, Law::Green, Coupling::Energy, RowKind::MovingLeastSquares))
            };
            let (mixed, fine) = (force(active.clone()), force(levels.uniform(2)));
            assert!(fine > 0.0 && mixed > 0.3 * fine && mixed < 3.0 * fine, "{seed}: {mixed} and {fine} N");
        }
    }
}
