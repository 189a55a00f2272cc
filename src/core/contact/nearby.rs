//! The part of the displayed surface that a tool may touch: the rest need not be moved every tick.

use crate::ids::{Node, Triangle, Vertex};
use crate::math::{Bounds, Real, Vec3};
use crate::model::active_mesh::MOST_ASIDE;
use crate::model::element_kernel::Padded;
use crate::model::element_pool::CLASSES;
use crate::model::{ActiveMesh, Body, sweeps};
use crate::visited::Visited;

/// Display vertices around a tool, kept until one that is not among them may have come near. Which they are makes no
/// difference but of time.
#[derive(Debug)]
pub(super) struct Nearby {
    /// All vertices in a box when it was last looked for them, and all that share a triangle with those; ascending.
    vertices: Vec<Vertex>,
    /// Triangles of which one was in that box; ascending.
    triangles: Vec<Triangle>,
    /// That box [m].
    reach: Bounds,
    /// Where the nodes were then [m], (n_slots).
    from: Vec<Padded>,
    marked: Visited,
    listed: Visited,
    is_known: bool,
}

/// How much farther than now vertices are looked for [m]: as far as hands move in some 30 ticks.
const AHEAD: Real = 8e-3;

impl Nearby {
    pub(super) fn new(body: &Body, mesh: &ActiveMesh) -> Self {
        let vertices = body.surface().vertices.len();
        Self {
            vertices: Vec::with_capacity(vertices),
            reach: Bounds::NOTHING,
            from: Vec::with_capacity(mesh.motion.position.len()),
            marked: Visited::new(vertices),
            triangles: Vec::with_capacity(body.surface().triangles.len()),
            listed: Visited::new(body.surface().triangles.len()),
            is_known: false,
        }
    }

    /// The state is another.
    pub(super) fn forget(&mut self) {
        self.is_known = false;
    }

    /// The resolution is another: what hangs elsewhere now, or on nodes that are elsewhere, is looked at again.
    pub(super) fn follow_change(&mut self, body: &Body, mesh: &ActiveMesh) {
        if !self.is_known {
            return;
        }
        for &slot in mesh.moved() {
            self.from[slot.index()] = mesh.motion.position[slot.index()];
        }
        // They come to hang on nodes that have moved since, and may go back.
        let far = self.farthest(mesh);
        mesh.revisited().iter().for_each(|v| self.mark(body, mesh, *v, far));
        self.vertices.sort_unstable();
        self.triangles.sort_unstable();
    }

    /// Moves to their `places` [m] at least all vertices that are in the `window` now, and the corners of all triangles that meet
    /// there.
    pub(super) fn place(&mut self, body: &Body, mesh: &ActiveMesh, window: Bounds, places: &mut [Vec3]) {
        if !self.holds(mesh, window) {
            self.look(body, mesh, window);
        }
        self.vertices.iter().for_each(|v| places[v.index()] = mesh.vertex(*v));
    }

    /// Triangles among which are all that meet in the last window, ascending.
    pub(super) fn triangles(&self) -> &[Triangle] {
        &self.triangles
    }

    /// Vertices that have been moved to their places.
    pub(super) fn placed(&self) -> &Visited {
        &self.marked
    }

    /// True while nothing else can have come into the `window`.
    fn holds(&self, mesh: &ActiveMesh, window: Bounds) -> bool {
        if !self.is_known {
            return false;
        }
        let far = self.farthest(mesh);
        let within = self.reach.grown(-far);
        (0..3).all(|c| window.low[c] >= within.low[c] && window.high[c] <= within.high[c])
    }

    /// No vertex has moved farther since it was looked at [m], but by what fades.
    fn farthest(&self, mesh: &ActiveMesh) -> Real {
        let mut squares = [0.0; 4];
        for slots in [mesh.active(), mesh.interface()] {
            sweeps::farthest(mesh.registers(), slots, &mesh.motion.position, &self.from, &mut squares);
        }
        mesh.lever() * squares.iter().sum::<Real>().sqrt()
    }

    fn look(&mut self, body: &Body, mesh: &ActiveMesh, window: Bounds) {
        self.reach = window.grown(AHEAD);
        self.from.clear();
        self.from.extend_from_slice(&mesh.motion.position);
        self.marked.clear();
        self.vertices.clear();
        self.listed.clear();
        self.triangles.clear();
        for class in 0..CLASSES {
            for e in mesh.pool().ids(class) {
                let hosted = body.hosted(e);
                if !hosted.is_empty() && self.may_reach(mesh, body.element(e)) {
                    hosted
                        .iter()
                        .filter(|v| mesh.embedding(**v).element == e)
                        .for_each(|v| self.mark(body, mesh, *v, 0.0));
                }
            }
        }
        mesh.extrapolated().iter().chain(mesh.morphing()).for_each(|v| self.mark(body, mesh, *v, 0.0));
        self.vertices.sort_unstable();
        self.triangles.sort_unstable();
        self.is_known = true;
    }

    /// False when no vertex that hangs on the element of these nodes, which is neither extrapolated nor morphing, is within reach.
    fn may_reach(&self, mesh: &ActiveMesh, nodes: [Node; 4]) -> bool {
        let places = nodes.map(|n| mesh.slot(n).map_or(Vec3::zeros(), |slot| mesh.position(slot)));
        let around = Bounds::of(places);
        let aside = around.size() * (3.0 * MOST_ASIDE);
        let (low, high) = (around.low - aside, around.high + aside);
        (0..3).all(|c| low[c] <= self.reach.high[c] && high[c] >= self.reach.low[c])
    }

    /// Takes vertex `v` along, and all that it shares a triangle with, if it is within reach or no more than `far` [m] beyond.
    fn mark(&mut self, body: &Body, mesh: &ActiveMesh, v: Vertex, far: Real) {
        // What fades goes no farther than that.
        let far = far + Vec3::from_row_slice(&mesh.geomorph[v.index()][..3]).norm();
        if self.reach.grown(far).contains(&mesh.vertex(v)) {
            for &t in body.triangles_around(v) {
                if self.listed.visit(t.index()) {
                    self.triangles.push(t);
                }
                for v in body.triangle(t) {
                    if self.marked.visit(v.index()) {
                        self.vertices.push(v);
                    }
                }
            }
        }
    }
}
