//! Everything about a body that moves, as it is saved, sent and restored.

use super::active_set::ActiveSet;
use super::body::{Body, stars};
use super::element_kernel::StrainLimit;
use super::element_pool::{CLASSES, History};
use super::step_class::{self, Residual};
use crate::ids::{Element, Node};
use crate::math::{Real, Vec3, is_finite};
use crate::visited::Visited;
use serde::{Deserialize, Serialize};

/// The active nodes and what they do. Order counts: forces are summed in it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct State {
    /// Active nodes, numbered through all levels.
    pub nodes: Vec<Node>,
    /// Their world positions [m], (n_active).
    pub position: Vec<Vec3>,
    /// Their velocities [m/s], (n_active).
    pub velocity: Vec<Vec3>,
    /// Forces on them that changes of resolution have left to fade [N], by class of step, (n_active, 3).
    pub residual: Vec<Residual<Vec3>>,
    /// Interface nodes; where they are follows from the active ones.
    pub interface: Vec<Node>,
    /// Elements in use by step class.
    pub classes: Vec<Vec<Element>>,
    /// What each of them remembers, class by class; empty for what they would at rest where the nodes are.
    pub history: Vec<History>,
    /// Up to which strain each of them may keep its step; empty to have it found.
    pub strain_limit: Vec<StrainLimit>,
    /// Active nodes by step class of their stars; none where the body has no stars.
    pub stars: Vec<Vec<Node>>,
    /// As `history`, of the stars.
    pub star_history: Vec<History>,
    /// As `strain_limit`, of the stars.
    pub star_strain_limit: Vec<StrainLimit>,
    /// By display vertex: what changes of resolution have left to fade, see
    /// [`super::active_mesh::ActiveMesh::geomorph`].
    pub geomorph: Vec<[Real; 4]>,
}

impl State {
    /// At rest in the rest shape, every node of level `level` active; where it does not reach, those of the next coarser
    /// one.
    pub fn at_rest(body: &Body, level: usize) -> Self {
        let nodes = body.covering(level);
        let positions = nodes.iter().map(|n| body.rest(*n)).collect();
        Self::resting(body, nodes, positions)
    }

    /// At rest in the rest shape, with these active nodes; `None` unless they cover the body once.
    pub fn at_rest_on(body: &Body, nodes: Vec<Node>) -> Option<Self> {
        ActiveSet::from_nodes(body, &nodes)?;
        let positions = nodes.iter().map(|n| body.rest(*n)).collect();
        Some(Self::resting(body, nodes, positions))
    }

    fn resting(body: &Body, nodes: Vec<Node>, position: Vec<Vec3>) -> Self {
        let mut active = vec![false; body.node_count()];
        nodes.iter().for_each(|n| active[n.index()] = true);
        let mut classes = vec![Vec::new(); CLASSES];
        let mut interface = Vec::new();
        let mut listed = Visited::new(body.node_count());
        for e in body.elements() {
            let corners = body.element(e);
            if !corners.iter().any(|n| active[n.index()]) {
                continue;
            }
            classes[step_class::class_at_rest(body, e)].push(e);
            for n in corners {
                if !active[n.index()] && listed.visit(n.index()) {
                    interface.push(n);
                }
            }
        }
        let mut of_stars = vec![Vec::new(); CLASSES];
        if !body.stars().is_empty() {
            for &n in &nodes {
                let count = |e: Element| body.element(e).iter().filter(|n| active[n.index()]).count() as u8;
                let star = stars::of_means(&body.stars().of(n).material, body.stabilisation_around(n, count));
                let omega_squared = step_class::omega_squared_of_star(body, n, &body.parts().materials, &star);
                of_stars[step_class::class_of_rest(body, omega_squared)].push(n);
            }
        }
        Self {
            star_history: vec![History::REST; of_stars.iter().map(Vec::len).sum()],
            star_strain_limit: Vec::new(),
            stars: of_stars,
            velocity: vec![Vec3::zeros(); position.len()],
            residual: vec![Residual::default(); position.len()],
            strain_limit: Vec::new(),
            history: vec![History::REST; classes.iter().map(Vec::len).sum()],
            geomorph: vec![[0.0; 4]; body.surface().vertices.len()],
            nodes,
            position,
            interface,
            classes,
        }
    }

    /// An empty state with room for any state of a mesh of `elements` elements and `slots` nodes, so that saving into
    /// it allocates nothing.
    pub fn with_room(body: &Body, elements: usize, slots: usize) -> Self {
        let of_stars = if body.stars().is_empty() { 0 } else { slots };
        Self {
            nodes: Vec::with_capacity(slots),
            position: Vec::with_capacity(slots),
            velocity: Vec::with_capacity(slots),
            residual: Vec::with_capacity(slots),
            interface: Vec::with_capacity(slots),
            classes: (0..CLASSES).map(|_| Vec::with_capacity(elements)).collect(),
            history: Vec::with_capacity(elements),
            strain_limit: Vec::with_capacity(elements),
            stars: (0..CLASSES).map(|_| Vec::with_capacity(of_stars)).collect(),
            star_history: Vec::with_capacity(of_stars),
            star_strain_limit: Vec::with_capacity(of_stars),
            geomorph: Vec::with_capacity(body.surface().vertices.len()),
        }
    }

    /// True when no number is infinite or not a number.
    pub fn is_finite(&self) -> bool {
        self.position.iter().all(is_finite)
            && self.velocity.iter().all(is_finite)
            && self.residual.iter().flatten().all(is_finite)
            && self.history.iter().chain(&self.star_history).all(History::is_finite)
            && self.geomorph.iter().flatten().all(|x| x.is_finite())
    }
}
