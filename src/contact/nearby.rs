//! The part of the displayed surface that a tool may touch: the rest need not be moved every tick.

use super::candidate::is_in;
use crate::math::{Real, Vec3};
use crate::model::element_kernel::Padded;
use crate::model::{ActiveMesh, Body};

/// Display vertices around a tool, kept until one that is not among them may have come near. Which they are makes no
/// difference but of time.
#[derive(Debug)]
pub(super) struct Nearby {
    /// All vertices in a box when it was last looked for them, and all that share a triangle with those; ascending.
    vertices: Vec<u32>,
    reach: (Vec3, Vec3),
    /// Where the nodes were then [m], (n_slots).
    from: Vec<Padded>,
    /// Most that a vertex moves when no node moves by more than one.
    lever: Real,
    marked: Vec<bool>,
    is_known: bool,
}

/// How much farther than now vertices are looked for [m]: as far as hands move in some 30 ticks.
const AHEAD: Real = 8e-3;

impl Nearby {
    pub(super) fn new(body: &Body, mesh: &ActiveMesh) -> Self {
        let vertices = body.surface().vertices.len();
        Self {
            vertices: Vec::with_capacity(vertices),
            reach: Default::default(),
            from: Vec::with_capacity(mesh.motion.position.len()),
            lever: 0.0,
            marked: vec![false; vertices],
            is_known: false,
        }
    }

    /// The resolution is another, or the state is.
    pub(super) fn forget(&mut self) {
        self.is_known = false;
    }

    /// Moves to their `places` [m] at least all vertices that are in the `window` now, and the corners of all triangles that meet
    /// there; returns a list of vertices in which the first of these are, ascending.
    pub(super) fn place(
        &mut self,
        body: &Body,
        mesh: &ActiveMesh,
        window: (Vec3, Vec3),
        places: &mut [Vec3],
    ) -> &[u32] {
        if !self.holds(mesh, window) {
            self.look(body, mesh, window);
        }
        self.vertices.iter().for_each(|v| places[*v as usize] = mesh.vertex(*v));
        &self.vertices
    }

    /// True while nothing else can have come into the `window`.
    fn holds(&self, mesh: &ActiveMesh, (low, high): (Vec3, Vec3)) -> bool {
        if !self.is_known {
            return false;
        }
        let mut moved = 0.0 as Real;
        for &slot in mesh.active().iter().chain(mesh.interface()) {
            let (now, then) = (&mesh.motion.position[slot as usize], &self.from[slot as usize]);
            moved = moved.max((0..3).map(|c| (now[c] - then[c]) * (now[c] - then[c])).sum());
        }
        let far = self.lever * moved.sqrt();
        let (least, most) = (self.reach.0.add_scalar(far), self.reach.1.add_scalar(-far));
        (0..3).all(|c| low[c] >= least[c] && high[c] <= most[c])
    }

    fn look(&mut self, body: &Body, mesh: &ActiveMesh, (low, high): (Vec3, Vec3)) {
        self.reach = (low.add_scalar(-AHEAD), high.add_scalar(AHEAD));
        self.from.clear();
        self.from.extend_from_slice(&mesh.motion.position);
        self.marked.fill(false);
        self.lever = 1.0;
        for v in 0..self.marked.len() as u32 {
            self.lever = self.lever.max(mesh.attachment(v).weights.iter().map(|w| w.abs()).sum());
            // What fades goes no farther than that.
            let fade = Vec3::from_row_slice(&mesh.fade[v as usize][..3]).norm();
            let wider = (self.reach.0.add_scalar(-fade), self.reach.1.add_scalar(fade));
            if is_in(&wider, &mesh.vertex(v)) {
                for t in body.triangles_around(v as usize) {
                    body.surface().triangles[*t as usize].iter().for_each(|v| self.marked[*v as usize] = true);
                }
            }
        }
        self.vertices.clear();
        self.vertices.extend((0..self.marked.len() as u32).filter(|v| self.marked[*v as usize]));
        self.is_known = true;
    }
}
