//! Which nodes are active [DDCB01 2.2]: together they cover the body once, each standing for its Voronoi region.
//!
//! Splitting replaces a node by its children, merging puts it back in their place. Neighbouring regions stay within one
//! level: a node is refined only where its neighbours, and those of its children, are at least as fine as it is.

use super::body::Body;
use crate::ids::Node;

/// How a node's region is represented.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Status {
    /// By a node of a coarser level.
    Coarser,
    /// By this node.
    Active,
    /// By nodes of finer levels.
    Refined,
}

/// A change of resolution: one node and all its children.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Change {
    /// The node gives way to its children.
    Split(Node),
    /// The children give way to the node.
    Merge(Node),
}

/// The active nodes of a body.
#[derive(Clone, Debug)]
pub struct ActiveSet {
    status: Vec<Status>,
    count: Vec<u32>,
}

impl ActiveSet {
    /// Every node of level `level`, which covers the whole body.
    pub fn uniform(body: &Body, level: usize) -> Self {
        debug_assert!(body.level(level).is_whole());
        let mut set = Self { status: Vec::with_capacity(body.node_count()), count: vec![0; body.levels().len()] };
        for r in 0..body.levels().len() {
            let status = match r.cmp(&level) {
                std::cmp::Ordering::Less => Status::Refined,
                std::cmp::Ordering::Equal => Status::Active,
                std::cmp::Ordering::Greater => Status::Coarser,
            };
            set.status.resize(set.status.len() + body.nodes_of(r).len(), status);
        }
        set.count[level] = body.nodes_of(level).len() as u32;
        set
    }

    /// The set whose active nodes are `nodes`; `None` unless they cover every part of the body exactly once.
    pub fn from_nodes(body: &Body, nodes: &[Node]) -> Option<Self> {
        let mut set = Self { status: vec![Status::Coarser; body.node_count()], count: vec![0; body.levels().len()] };
        set.assign(body, nodes).then_some(set)
    }

    /// Makes `nodes` the active ones; false, and the set is of no use, unless they cover every part of the body exactly
    /// once. Allocates nothing.
    pub fn assign(&mut self, body: &Body, nodes: &[Node]) -> bool {
        self.status.fill(Status::Coarser);
        self.count.fill(0);
        for &n in nodes {
            if n.index() >= self.status.len() || self.status[n.index()] != Status::Coarser || body.is_ghost(n) {
                return false;
            }
            self.status[n.index()] = Status::Active;
            self.count[body.level_of(n)] += 1;
            let mut above = body.parent(n);
            while above != Node::NONE && self.status[above.index()] != Status::Refined {
                if self.status[above.index()] == Status::Active {
                    return false;
                }
                self.status[above.index()] = Status::Refined;
                above = body.parent(above);
            }
        }
        let covered = |n: Node| match self.status(n) {
            Status::Active => true,
            Status::Refined => body.children(n).iter().all(|c| self.status(*c) != Status::Coarser),
            Status::Coarser => body.level_of(n) > 0,
        };
        body.nodes().all(covered)
    }

    /// How the region of node `n` is represented.
    pub fn status(&self, n: Node) -> Status {
        self.status[n.index()]
    }

    /// True when `n` is active.
    pub fn is_active(&self, n: Node) -> bool {
        self.status(n) == Status::Active
    }

    /// Active nodes per level.
    pub fn count(&self) -> &[u32] {
        &self.count
    }

    /// True when the region of `n` is at least as fine as the level of `n`.
    fn is_fine(&self, n: Node) -> bool {
        self.status(n) != Status::Coarser
    }

    /// Calls `each` with every node of the level of `n` (with repetitions) whose region must be at least as fine as
    /// that level before `n` may be refined: the neighbours of `n`, and the parents of its children's neighbours. The
    /// relation is symmetric. Stops early when `each` returns false.
    fn each_neighbour(body: &Body, n: Node, mut each: impl FnMut(Node) -> bool) -> bool {
        let beside = |n: Node, each: &mut dyn FnMut(Node) -> bool| {
            body.elements_around(n).iter().all(|e| body.element(*e).iter().all(|v| each(*v)))
        };
        beside(n, &mut each) && body.children(n).iter().all(|c| beside(*c, &mut |v| each(body.parent(v))))
    }

    /// A node that has to be split before `n` may be, so that neighbouring regions stay within one level.
    pub fn first_needed(&self, body: &Body, n: Node) -> Option<Node> {
        let mut needed = None;
        Self::each_neighbour(body, n, |v| {
            if !self.is_fine(v) {
                let mut above = body.parent(v);
                while !self.is_fine(above) {
                    above = body.parent(above);
                }
                needed = Some(above);
            }
            needed.is_none()
        });
        needed
    }

    /// True when `n` is refined, its children are all active, and no neighbour is so fine that they must stay.
    pub fn may_merge(&self, body: &Body, n: Node) -> bool {
        self.status(n) == Status::Refined
            && body.children(n).iter().all(|c| self.is_active(*c))
            && body.children(n).iter().all(|c| Self::each_neighbour(body, *c, |v| self.status(v) != Status::Refined))
    }

    /// Makes a change that is allowed: [`ActiveSet::first_needed`] of a split is `None`, [`ActiveSet::may_merge`] holds.
    pub fn apply(&mut self, body: &Body, change: Change) {
        let (n, own, theirs) = match change {
            Change::Split(n) => (n, Status::Refined, Status::Active),
            Change::Merge(n) => (n, Status::Active, Status::Coarser),
        };
        self.status[n.index()] = own;
        body.children(n).iter().for_each(|c| self.status[c.index()] = theirs);
        let (level, children) = (body.level_of(n), body.children(n).len() as u32);
        match change {
            Change::Split(_) => {
                self.count[level] -= 1;
                self.count[level + 1] += children;
            }
            Change::Merge(_) => {
                self.count[level] += 1;
                self.count[level + 1] -= children;
            }
        }
    }
}
