//! Blocks of [`LANES`] elements, laid out as the kernel reads them: a row of each number, a lane for each element.

use super::element::{ElementConstants, History, MAX_BRANCHES, StrainLimit};
use super::lanes::{LANES, Row};
use crate::ids::Slot;
use crate::math::Real;

/// What the kernel reads and writes of [`LANES`] elements. Constants carry fraction·volume, so that forces come out in
/// newtons.
#[derive(Clone, Copy, Debug)]
#[repr(C, align(64))]
pub(super) struct Block {
    /// Slots of the nodes: vertex, then element.
    pub node: [[u32; LANES]; 4],
    /// ∇L_1, ∇L_2, ∇L_3 at rest [1/m]: vertex, then component; ∇L_0 is minus their sum.
    pub gradient: [[Row; 3]; 3],
    /// λ·w·vol [N·m].
    pub lambda: Row,
    /// μ·w·vol [N·m].
    pub mu: Row,
    /// Factor on the shear moduli of the Maxwell branches over μ.
    pub branch: Row,
    /// `2E` at the last evaluation: xx, yy, zz, yz, xz, xy. Twice the strain saves nine halvings; it is exact.
    pub strain: [Row; 6],
    /// `J` at the last evaluation.
    pub det: Row,
    /// [`StrainLimit::deviator`].
    pub limit: Row,
    /// [`StrainLimit::slope`].
    pub slope: Row,
}

/// What one Maxwell branch of [`LANES`] elements remembers: `2D`, components as in [`Block::strain`].
#[derive(Clone, Copy, Debug)]
#[repr(C, align(64))]
pub(super) struct Memory(pub [Row; 6]);

/// A block without elements.
const UNUSED: Block = Block {
    node: [[0; LANES]; 4],
    gradient: [[[0.0; LANES]; 3]; 3],
    lambda: [0.0; LANES],
    mu: [0.0; LANES],
    branch: [0.0; LANES],
    strain: [[0.0; LANES]; 6],
    det: [1.0; LANES],
    limit: [Real::INFINITY; LANES],
    slope: [0.0; LANES],
};

/// Place of an element among the blocks.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Lane {
    /// Its block.
    pub block: usize,
    /// Its lane in there.
    pub lane: usize,
}

/// All blocks of a pool, and what the Maxwell branches of their elements remember.
#[derive(Clone, Debug)]
pub(super) struct Blocks {
    /// The blocks.
    pub all: Vec<Block>,
    /// Those of a block side by side; empty without branches.
    pub memories: Vec<Memory>,
    /// Maxwell branches of each element, at most [`MAX_BRANCHES`].
    pub branches: usize,
}

impl Blocks {
    /// So many, without elements.
    pub(super) fn new(blocks: usize, branches: usize) -> Self {
        Self { all: vec![UNUSED; blocks], memories: vec![NO_MEMORY; blocks * branches], branches }
    }

    /// Takes all elements out.
    pub(super) fn clear(&mut self) {
        self.all.fill(UNUSED);
        self.memories.fill(NO_MEMORY);
    }

    /// What the branches of the elements of `block` remember.
    pub(super) fn memories_of(&self, block: usize) -> &[Memory] {
        &self.memories[block * self.branches..(block + 1) * self.branches]
    }

    /// Puts an element between `nodes` into a lane.
    pub(super) fn write(&mut self, at: Lane, nodes: [Slot; 4], constants: &ElementConstants, history: &History) {
        let (b, lane) = (&mut self.all[at.block], at.lane);
        for (row, node) in b.node.iter_mut().zip(nodes) {
            row[lane] = node.0;
        }
        for (row, x) in b.gradient.as_flattened_mut().iter_mut().zip(constants.gradient.as_flattened()) {
            row[lane] = *x;
        }
        b.lambda[lane] = constants.lambda;
        b.mu[lane] = constants.mu;
        b.branch[lane] = constants.branch;
        self.write_history(at, history);
    }

    /// Leaves a lane without weight, and on nodes that are there.
    pub(super) fn vacate(&mut self, at: Lane) {
        const NOTHING: ElementConstants =
            ElementConstants { gradient: [[0.0; 3]; 3], lambda: 0.0, mu: 0.0, branch: 0.0 };
        self.write(at, [Slot(0); 4], &NOTHING, &History::REST);
        self.set_limit(at, StrainLimit::NONE);
    }

    /// Copies an element to another lane.
    pub(super) fn copy(&mut self, from: Lane, to: Lane) {
        let source = self.all[from.block];
        let (i, j) = (from.lane, to.lane);
        let b = &mut self.all[to.block];
        for (row, n) in b.node.iter_mut().zip(&source.node) {
            row[j] = n[i];
        }
        for (row, x) in b.gradient.as_flattened_mut().iter_mut().zip(source.gradient.as_flattened()) {
            row[j] = x[i];
        }
        b.lambda[j] = source.lambda[i];
        b.mu[j] = source.mu[i];
        b.branch[j] = source.branch[i];
        b.limit[j] = source.limit[i];
        b.slope[j] = source.slope[i];
        let history = self.history(from);
        self.write_history(to, &history);
    }

    /// Nodes of the element in a lane.
    pub(super) fn nodes(&self, at: Lane) -> [Slot; 4] {
        self.all[at.block].node.map(|row| Slot(row[at.lane]))
    }

    /// `E` of the element in a lane at its last evaluation.
    pub(super) fn strain(&self, at: Lane) -> [Real; 6] {
        let rows = &self.all[at.block].strain;
        std::array::from_fn(|c| 0.5 * rows[c][at.lane])
    }

    /// What the element in a lane remembers.
    pub(super) fn history(&self, at: Lane) -> History {
        let mut branch = [[0.0; 6]; MAX_BRANCHES];
        // Mapped, the rows of all lanes would be copied first.
        for (d, memory) in branch.iter_mut().zip(self.memories_of(at.block)) {
            *d = std::array::from_fn(|c| 0.5 * memory.0[c][at.lane]);
        }
        History { strain: self.strain(at), det: self.all[at.block].det[at.lane], branch }
    }

    /// Has the element in a lane remember `history`.
    pub(super) fn write_history(&mut self, at: Lane, history: &History) {
        let memories = &mut self.memories[at.block * self.branches..(at.block + 1) * self.branches];
        for (d, memory) in history.branch.iter().zip(memories) {
            for (row, d) in memory.0.iter_mut().zip(d) {
                row[at.lane] = 2.0 * d;
            }
        }
        let b = &mut self.all[at.block];
        for (row, e) in b.strain.iter_mut().zip(history.strain) {
            row[at.lane] = 2.0 * e;
        }
        b.det[at.lane] = history.det;
    }

    /// How far the element in a lane may be strained.
    pub(super) fn limit(&self, at: Lane) -> StrainLimit {
        let block = &self.all[at.block];
        StrainLimit { deviator: block.limit[at.lane], slope: block.slope[at.lane] }
    }

    /// Lets the element in a lane be strained up to `limit`.
    pub(super) fn set_limit(&mut self, at: Lane, limit: StrainLimit) {
        self.all[at.block].limit[at.lane] = limit.deviator;
        self.all[at.block].slope[at.lane] = limit.slope;
    }
}

/// Of an element that has always been at rest.
const NO_MEMORY: Memory = Memory([[0.0; LANES]; 6]);
