//! Places of the surface as moving least squares fits to the active nodes around them, of whatever level these are.
//!
//! The weights `w_k = m_k W(|X_k − p|/ρ)` of the nodes around the place `p` at rest, `W` the cubic spline, are corrected to
//! first order, so that `Σ w = 1` and `Σ w X = p`: the shape functions of the element-free Galerkin method [Belytschko, Lu & Gu
//! 1994]. They change continuously with the place, and as the masses `m_k` are the nodes' parts of the volume, hardly with how the
//! nodes lie around it.

use super::ActiveMesh;
use crate::ids::{Slot, Vertex};
use crate::math::{Mat3, Real, Vec3};
use crate::model::body::Body;
use crate::model::constraint::{MOST_ROW_NODES, Row};
use crate::model::interface::Search;
use crate::model::sweeps::{Registers, sweep};

/// Support of a row over the spacing of the nodes: with less the lattice is felt, with more rows have no room and thin bodies no depth.
/// Elements that are softer in their shortest waves need a wider one.
pub fn support(body: &Body) -> Real {
    if body.stars().is_empty() { 1.75 } else { 2.0 }
}

/// Spacing of the nodes under the place of the surface that is such a combination of display vertices [m].
pub fn spacing(mesh: &ActiveMesh, stencil: impl IntoIterator<Item = (Vertex, Real)>) -> Real {
    stencil.into_iter().map(|(v, w)| mesh.embedding(v).spacing * w).sum()
}

/// Part α of the energy of strain jumps that elements keep there ([`ActiveMesh::stabilisation_around`]).
pub fn stabilisation(mesh: &ActiveMesh, stencil: impl IntoIterator<Item = (Vertex, Real)>) -> Real {
    let of_vertex = |v: Vertex| -> Real {
        let at = mesh.embedding(v);
        at.slots.iter().zip(at.weights).map(|(slot, w)| w * mesh.stabilisation_around(mesh.node(*slot))).sum()
    };
    stencil.into_iter().map(|(v, w)| of_vertex(v) * w).sum()
}

/// And where that is at rest [m].
pub fn at_rest(body: &Body, stencil: impl IntoIterator<Item = (Vertex, Real)>) -> Vec3 {
    stencil.into_iter().map(|(v, w)| body.surface().vertices[v.index()] * w).sum()
}

/// The active nodes around a place of the surface: all that can be reached from there, so that the lips of a slit do not hang on each
/// other.
#[derive(Debug)]
struct Around {
    /// A display vertex, and how far around it nodes are [m].
    key: Option<(Vertex, Real)>,
    slots: Vec<Slot>,
    /// At rest [m], (3, nodes).
    places: [Vec<Real>; 3],
    /// [kg].
    masses: Vec<Real>,
}

impl Around {
    fn new() -> Self {
        let numbers = || Vec::with_capacity(MOST_NEAR);
        let places = [numbers(), numbers(), numbers()];
        Self { key: None, slots: Vec::with_capacity(MOST_NEAR), places, masses: numbers() }
    }

    fn gather(&mut self, body: &Body, mesh: &ActiveMesh, search: &mut Search, (v, radius): (Vertex, Real)) {
        self.key = Some((v, radius));
        self.slots.clear();
        self.places.iter_mut().for_each(Vec::clear);
        self.masses.clear();
        let seeds = mesh.embedding(v).slots.map(|slot| mesh.node(slot));
        let found = search.within(body, mesh.set(), body.surface().vertices[v.index()], seeds.into_iter(), radius);
        for (_, n) in found.iter().filter(|(distance, _)| *distance < radius * radius) {
            if let Some(slot) = mesh.slot(*n).filter(|_| self.slots.len() < MOST_NEAR) {
                self.slots.push(slot);
                self.places.iter_mut().zip(body.rest(*n).iter()).for_each(|(all, x)| all.push(*x));
                self.masses.push(mesh.motion.mass[slot.index()]);
            }
        }
    }
}

/// The active nodes around parts of the surface, kept while the resolution stays: which are kept makes no difference but of time.
#[derive(Debug)]
pub struct Surroundings {
    registers: Registers,
    search: Search,
    kept: [Around; KEPT],
    /// Which is in use, and which is the oldest.
    current: usize,
    oldest: usize,
    /// Squared distances of its nodes from the place at hand [m²].
    squares: Vec<Real>,
}

impl Surroundings {
    /// Of some part of `body`.
    pub fn new(body: &Body) -> Self {
        let kept = std::array::from_fn(|_| Around::new());
        let (registers, squares) = (Registers::best(), Vec::with_capacity(MOST_NEAR));
        Self { registers, search: Search::new(body), kept, current: 0, oldest: 0, squares }
    }

    /// The resolution is another, or the state.
    pub fn forget(&mut self) {
        self.kept.iter_mut().for_each(|around| around.key = None);
    }

    /// Has the nodes at hand up to `radius` [m] around the place `p` at rest, which is on a triangle of display vertex `v`.
    pub fn gather(&mut self, body: &Body, mesh: &ActiveMesh, v: Vertex, p: Vec3, radius: Real) {
        // In steps, so that it stays while `p` moves.
        let step = STEP * mesh.embedding(v).spacing;
        let radius = radius + (p - body.surface().vertices[v.index()]).norm();
        let key = (v, if step > 0.0 { step * (radius / step).ceil() } else { radius });
        if let Some(kept) = self.kept.iter().position(|around| around.key == Some(key)) {
            self.current = kept;
            return;
        }
        self.current = self.oldest;
        self.oldest = (self.oldest + 1) % KEPT;
        self.kept[self.current].gather(body, mesh, &mut self.search, key);
    }

    /// The row of the place `p` at rest [m] on nodes up to `support` [m] away: less where these are more than a row has room
    /// for, more where they do not fix a plane's slope. `None` where even as many as there is room for do not.
    pub fn row(&mut self, p: Vec3, mut support: Real) -> Option<Row> {
        let Self { registers, kept, current, squares, .. } = self;
        let around = &kept[*current];
        let [x, y, z] = &around.places;
        let square = |((x, y), z): ((&Real, &Real), &Real)| (x - p.x).powi(2) + (y - p.y).powi(2) + (z - p.z).powi(2);
        squares.clear();
        squares.extend(x.iter().zip(y).zip(z).map(square));
        let count = |support: Real| squares.iter().filter(|square| **square < support * support).count();
        let mut held = count(support);
        while held > MOST_ROW_NODES {
            support *= NARROWER;
            held = count(support);
        }
        for _ in 0..MOST_TRIES {
            let mut row = None;
            fit(*registers, around, squares, p, support, &mut row);
            let wider = support / NARROWER;
            if row.is_some() || count(wider) > MOST_ROW_NODES {
                return row;
            }
            support = wider;
        }
        None
    }
}

sweep! {
    /// The `found` row of the place `p` [m] on the nodes `around` it, at such squared distances [m²], that are within `support` [m] of
    /// it, no more than a row has room for. Each sum is four, of every fourth node each, so that four nodes are weighed at once.
    fn fit(around: &Around, squares: &[Real], p: Vec3, support: Real, found: &mut Option<Row>) {
        let mut slots = [Slot::NONE; MOST_ROW_NODES];
        let [mut x, mut y, mut z] = [[0.0; MOST_ROW_NODES]; 3];
        // The rest weighs nothing.
        let [mut masses, mut near] = [[0.0; MOST_ROW_NODES]; 2];
        let mut len = 0;
        for (i, square) in squares.iter().enumerate() {
            if *square < support * support && len < MOST_ROW_NODES {
                slots[len] = around.slots[i];
                [x[len], y[len], z[len]] = around.places.each_ref().map(|all| all[i]);
                (masses[len], near[len]) = (around.masses[i], *square);
                len += 1;
            }
        }
        let mut weights = [0.0; MOST_ROW_NODES];
        for (i, weight) in weights.iter_mut().enumerate() {
            *weight = masses[i] * spline(near[i].sqrt() / support);
            (x[i], y[i], z[i]) = (x[i] - p.x, y[i] - p.y, z[i] - p.z);
        }
        let mut sums = [[0.0; LANES]; 10];
        for first in (0..MOST_ROW_NODES).step_by(LANES) {
            for lane in 0..LANES {
                let (w, x, y, z) = (weights[first + lane], x[first + lane], y[first + lane], z[first + lane]);
                let (wx, wy, wz) = (w * x, w * y, w * z);
                let products = [w, wx, wy, wz, wx * x, wy * y, wz * z, wx * y, wy * z, wz * x];
                for (sum, product) in sums.iter_mut().zip(products) {
                    sum[lane] += product;
                }
            }
        }
        let [sum, wx, wy, wz, xx, yy, zz, xy, yz, zx] = sums.map(|[a, b, c, d]| (a + b) + (c + d));
        if sum <= 0.0 {
            return;
        }
        let mean = Vec3::new(wx, wy, wz) / sum;
        let spread = Mat3::new(xx, xy, zx, xy, yy, yz, zx, yz, zz) / sum - mean * mean.transpose();
        // Its eigenvalues are squares of how far the nodes lie apart in each direction.
        if spread.determinant() < LEAST_SPREAD * (support * support).powi(3) {
            return;
        }
        let Some(inverse) = spread.try_inverse() else { return };
        let slope = inverse * mean;
        let level = 1.0 + slope.dot(&mean);
        for (i, weight) in weights.iter_mut().enumerate() {
            *weight *= (level - (slope.x * x[i] + slope.y * y[i] + slope.z * z[i])) / sum;
        }
        *found = Some(Row::of(&slots, &weights, len));
    }
}

/// Nodes that are weighed at once.
const LANES: usize = 4;

/// The cubic spline kernel on [0, 1], up to a factor.
#[inline(always)]
fn spline(q: Real) -> Real {
    let (inner, left) = (1.0 - 6.0 * q * q * (1.0 - q), (1.0 - q).max(0.0));
    if q < 0.5 { inner } else { 2.0 * left * left * left }
}

/// Deviation of a row's weights along the surface, in each of its directions, over the support: that of the spline in a half-ball,
/// corrected to first order. From `M_n = ∫ W(q) qⁿ dq` = .03125, .0138393, .0070313 and .0039374 for n of 2 to 5: the variance is
/// `.075 + .22143 · .0008577/.02597` before the correction, which takes off what the half-ball has of slope.
pub const DEVIATION: Real = 0.287;

/// Most nodes that are gathered around one place, ...
const MOST_NEAR: usize = 512;
/// ... around so many places at once: a strip has three or four, a flat face about as many.
const KEPT: usize = 16;
/// In what steps the radius goes within which nodes are gathered, over the spacing of the nodes: with less they are gathered anew more
/// often while a tool slides, with more each row looks at more that are too far away. A row has the same nodes, but beside the end of a slit, which a
/// wider search may go around.
const STEP: Real = 0.5;
/// A support that is too wide or too narrow is made narrower or wider by this, ...
const NARROWER: Real = 0.9;
/// ... so often at most.
const MOST_TRIES: usize = 12;
/// Over the sixth power of the support: below it the nodes lie in a plane but for rounding.
const LEAST_SPREAD: Real = 1e-8;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn all_registers_give_the_same_row() {
        let number = |i: usize, k: usize| libm::sin(((7 + 2 * k) * i + 3 * k) as Real + 0.4);
        let mut around = Around::new();
        for i in 0..90 {
            around.slots.push(Slot(i as u32));
            (0..3).for_each(|k| around.places[k].push(number(i, k)));
            around.masses.push(1.3 + number(i, 5));
        }
        let p = Vec3::new(0.1, -0.2, 0.3);
        let [x, y, z] = &around.places;
        let squares: Vec<Real> = (0..90).map(|i| (Vec3::new(x[i], y[i], z[i]) - p).norm_squared()).collect();
        let row = |registers| {
            let mut row = None;
            fit(registers, &around, &squares, p, 0.9, &mut row);
            row
        };
        assert!(row(Registers::Any).is_some_and(|row| row.entries().len() > 10));
        assert_eq!(row(Registers::Any), row(Registers::best()));
    }
}
