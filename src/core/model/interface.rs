//! Interface nodes: the vertices of elements in use that are not active themselves [DDCB01 2.3].
//!
//! Each hangs on active nodes by a row of weights that reproduces every affine field exactly. Where the element of the
//! neighbouring level that contains it has four active vertices, those are its masters and the weights are barycentric.
//! Elsewhere that element's own vertices would hang on others, in chains and cycles: there the row is the moving least
//! squares fit to the nearest active nodes of any level, which needs none.

use super::active_set::{ActiveSet, Status};
use super::body::Body;
use crate::ids::Node;
use crate::math::{Real, Vec3};
use crate::visited::Visited;

/// Most masters of an interface node.
pub const MOST_MASTERS: usize = 10;

/// How far a node hangs on others.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct InterfaceRow<Id> {
    /// Masters, nodes of the body or their slots; only the first `len` count.
    master: [Id; MOST_MASTERS],
    weight: [Real; MOST_MASTERS],
    len: u8,
    /// It hangs in one element, and does so while all of that is active.
    hosted: bool,
    /// Squared distance [m²] beyond which a change of active nodes does not change the row.
    pub reach_squared: Real,
}

impl<Id: Copy + Default> InterfaceRow<Id> {
    /// No masters.
    pub fn empty() -> Self {
        Self {
            master: [Id::default(); MOST_MASTERS],
            weight: [0.0; MOST_MASTERS],
            len: 0,
            hosted: false,
            reach_squared: 0.0,
        }
    }

    /// Masters and weights.
    pub fn entries(&self) -> impl Iterator<Item = (Id, Real)> + '_ {
        self.master[..usize::from(self.len)].iter().copied().zip(self.weight[..usize::from(self.len)].iter().copied())
    }

    /// Calls each master by `number(master)`.
    pub fn renumbered<To: Copy + Default>(&self, number: impl Fn(Id) -> To) -> InterfaceRow<To> {
        let len = usize::from(self.len);
        let mut master = [To::default(); MOST_MASTERS];
        master[..len].iter_mut().zip(&self.master[..len]).for_each(|(to, from)| *to = number(*from));
        let Self { weight, len, hosted, reach_squared, .. } = *self;
        InterfaceRow { master, weight, len, hosted, reach_squared }
    }

    /// `Σ |w|`, at least 1: how much the row amplifies.
    pub fn amplification(&self) -> Real {
        self.weight[..usize::from(self.len)].iter().map(|w| w.abs()).sum()
    }

    /// True where nothing but the loss of a master changes the row.
    pub fn is_hosted(&self) -> bool {
        self.hosted
    }

    /// True before the row is made.
    pub fn is_empty(&self) -> bool {
        self.len == 0
    }

    fn push(&mut self, master: Id, weight: Real) {
        self.master[usize::from(self.len)] = master;
        self.weight[usize::from(self.len)] = weight;
        self.len += 1;
    }
}

/// Memory for making rows.
#[derive(Debug)]
pub struct Search {
    /// Squared distance, node.
    found: Vec<(Real, Node)>,
    /// Nodes whose neighbours have been looked at.
    ring: Vec<Node>,
    /// Nodes that have been looked at, and those that have been stood in for.
    looked_at: Visited,
    stood_in: Visited,
    origin: Vec3,
    /// Squared distance [m²] of the farthest node that was looked at, and of the farthest of the host's.
    reach_squared: Real,
    host_squared: Real,
}

impl Search {
    /// For `body`.
    pub fn new(body: &Body) -> Self {
        Self {
            found: Vec::with_capacity(body.node_count().min(4096)),
            ring: Vec::with_capacity(body.node_count().min(4096)),
            looked_at: Visited::new(body.node_count()),
            stood_in: Visited::new(body.node_count()),
            origin: Vec3::zeros(),
            reach_squared: 0.0,
            host_squared: 0.0,
        }
    }

    fn begin(&mut self, origin: Vec3) {
        self.found.clear();
        self.ring.clear();
        self.looked_at.clear();
        self.stood_in.clear();
        self.origin = origin;
        (self.reach_squared, self.host_squared) = (0.0, 0.0);
    }

    /// Looks at `n`: notes how far away it is; the first time, whether it is active.
    fn look(&mut self, body: &Body, set: &ActiveSet, n: Node) -> Status {
        let status = set.status(n);
        if self.looked_at.visit(n.index()) {
            let distance = (body.rest(n) - self.origin).norm_squared();
            self.reach_squared = self.reach_squared.max(distance);
            // A node too many is a node too far: there is room for every neighbourhood that can occur.
            if status == Status::Active && self.found.len() < self.found.capacity() {
                self.found.push((distance, n));
            }
        }
        status
    }

    /// Finds the active nodes that stand for the region of `n`: itself, one above it, or the next below it.
    fn stand_in(&mut self, body: &Body, set: &ActiveSet, n: Node) {
        if !self.stood_in.visit(n.index()) {
            return;
        }
        match self.look(body, set, n) {
            Status::Active => {}
            Status::Coarser => {
                let mut above = body.parent(n);
                while self.look(body, set, above) == Status::Coarser {
                    above = body.parent(above);
                }
            }
            Status::Refined => {
                for &c in body.children(n) {
                    if self.look(body, set, c) == Status::Refined {
                        body.children(c).iter().for_each(|d| {
                            self.look(body, set, *d);
                        });
                    }
                }
            }
        }
    }

    /// Active nodes around the place `origin` at rest [m], each with its squared distance [m²]: at least those up to `radius` [m] away
    /// that can be reached from what stands for the nodes `from` over neighbours that are as near.
    pub fn within(
        &mut self,
        body: &Body,
        set: &ActiveSet,
        origin: Vec3,
        from: impl Iterator<Item = Node>,
        radius: Real,
    ) -> &[(Real, Node)] {
        self.begin(origin);
        from.for_each(|n| self.stand_in(body, set, n));
        let mut looked = 0;
        while let Some(&(distance, n)) = self.found.get(looked) {
            if distance < radius * radius {
                body.neighbours(n).iter().for_each(|v| self.stand_in(body, set, *v));
            }
            looked += 1;
        }
        &self.found
    }

    /// The row of node `n`, which is not active.
    pub fn row(&mut self, body: &Body, set: &ActiveSet, n: Node) -> InterfaceRow<Node> {
        self.begin(body.rest(n));
        let host = match set.status(n) {
            Status::Refined => body.finer_host(n),
            _ => body.coarser_host(n),
        };
        if let Some(host) = host {
            let nodes = body.element(host.element);
            if nodes.iter().filter(|v| self.look(body, set, **v) == Status::Active).count() == 4 {
                let mut row = InterfaceRow::empty();
                nodes.iter().zip(host.weights).for_each(|(v, w)| row.push(*v, w));
                return InterfaceRow { hosted: true, reach_squared: self.reach_squared, ..row };
            }
            self.host_squared = self.reach_squared;
            nodes.iter().for_each(|v| self.stand_in(body, set, *v));
        }
        self.neighbours(body, set, n);
        let mut round = 0;
        loop {
            if let Some(row) = self.fit(body, round + 1) {
                return row;
            }
            // Too few, or nearly in one plane: look at the neighbours of those found, nearest first.
            match self.found.get(round).map(|f| f.1) {
                Some(v) => self.neighbours(body, set, v),
                // A body whose active nodes all lie in one plane has no volume; it holds still instead of breaking.
                None => return self.nearest_only(),
            }
            round += 1;
        }
    }

    fn neighbours(&mut self, body: &Body, set: &ActiveSet, n: Node) {
        if self.ring.contains(&n) || self.ring.len() == self.ring.capacity() {
            return;
        }
        self.ring.push(n);
        body.neighbours(n).iter().for_each(|v| self.stand_in(body, set, *v));
    }

    fn nearest_only(&self) -> InterfaceRow<Node> {
        let mut row = InterfaceRow { reach_squared: Real::INFINITY, ..InterfaceRow::empty() };
        if let Some((_, n)) = self.found.first() {
            row.push(*n, 1.0);
        }
        row
    }

    /// Moving least squares on the nearest found nodes, every `stride`-th of them: `P_j = θ_j (1, d_j)·y`, `Σ θ_j (1, d_j)(1, d_j)ᵀ y = (1, 0)`,
    /// `d_j` the offset from the interface node and `θ_j = 1/(d_j² + ε²)²`. `None` when they are too few or flat.
    fn fit(&mut self, body: &Body, stride: usize) -> Option<InterfaceRow<Node>> {
        let nearer = |a: &(Real, Node), b: &(Real, Node)| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1));
        // Only the nearest are asked for then.
        if stride == 1 && self.found.len() > MOST_MASTERS {
            self.found.select_nth_unstable_by(MOST_MASTERS, nearer);
            self.found[..MOST_MASTERS].sort_unstable_by(nearer);
        } else {
            self.found.sort_unstable_by(nearer);
        }
        if self.found.len() < 4 {
            return None;
        }
        let mut nearest = [(0.0, Node::NONE); MOST_MASTERS];
        let mut count = 0;
        for found in self.found.iter().step_by(if self.found.len() > MOST_MASTERS { stride } else { 1 }) {
            if count < MOST_MASTERS {
                nearest[count] = *found;
                count += 1;
            }
        }
        let used = &nearest[..count];
        if count < 4 {
            return None;
        }
        // Distances over that of the fourth nearest: its order of magnitude drops out.
        let scale = 1.0 / used[3].0.sqrt().max(1e-12);
        let mut a = [[0.0; 4]; 4];
        let moment = |n: Node| {
            let d = (body.rest(n) - self.origin) * scale;
            ([1.0, d.x, d.y, d.z], 1.0 / ((d.norm_squared() + EPSILON) * (d.norm_squared() + EPSILON)))
        };
        for &(_, n) in used {
            let (m, theta) = moment(n);
            for i in 0..4 {
                for j in 0..4 {
                    a[i][j] += theta * m[i] * m[j];
                }
            }
        }
        let y = solve(a)?;
        // The nearest of all that were found stay the nearest, whatever changes farther away.
        let full = stride == 1 && count == MOST_MASTERS;
        let reach_squared = if full { self.host_squared.max(used[count - 1].0) } else { self.reach_squared };
        let mut row = InterfaceRow { reach_squared, ..InterfaceRow::empty() };
        for &(_, n) in used {
            let (m, theta) = moment(n);
            row.push(n, theta * (m[0] * y[0] + m[1] * y[1] + m[2] * y[2] + m[3] * y[3]));
        }
        (row.amplification() < MOST_AMPLIFICATION).then_some(row)
    }
}

/// ε² of the weight function, in units of the fourth nearest distance.
const EPSILON: Real = 0.05;

/// Rows with a larger `Σ|w|` are fitted again to nodes farther apart.
const MOST_AMPLIFICATION: Real = 6.0;

/// `A y = (1, 0, 0, 0)` for a symmetric positive definite `A`, by Cholesky; `None` when it is nearly singular.
/// Not nalgebra's, which sums the back substitution in another order: the last bits of every recorded hash depend on it.
fn solve(a: [[Real; 4]; 4]) -> Option<[Real; 4]> {
    let mut l = [[0.0; 4]; 4];
    for i in 0..4 {
        for j in 0..=i {
            let mut s = a[i][j];
            for (a, b) in l[i][..j].iter().zip(&l[j][..j]) {
                s -= a * b;
            }
            if i == j {
                #[expect(clippy::neg_cmp_op_on_partial_ord, reason = "NaN, too, must leave here")]
                if !(s > 1e-4 * a[i][i]) {
                    return None;
                }
                l[i][i] = s.sqrt();
            } else {
                l[i][j] = s / l[j][j];
            }
        }
    }
    let mut z = [1.0, 0.0, 0.0, 0.0];
    for i in 0..4 {
        for k in 0..i {
            z[i] -= l[i][k] * z[k];
        }
        z[i] /= l[i][i];
    }
    for i in (0..4).rev() {
        for k in i + 1..4 {
            z[i] -= l[k][i] * z[k];
        }
        z[i] /= l[i][i];
    }
    Some(z)
}
