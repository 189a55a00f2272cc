//! Blocks of [`LANES`] elements, laid out as the kernel reads them: a row of each number, a lane for each element.

use super::element::{ElementConstants, History, MAX_BRANCHES, StrainLimit};
use super::lanes::{LANES, Row};
use crate::ids::Slot;
use crate::math::Real;

/// Slots of one node of each element of a block.
pub(super) type Nodes = [u32; LANES];

/// Gradient of the weight of one node of each element of a block [1/m]: its components.
pub(super) type Gradients = [Row; 3];

/// What the kernel reads and writes of [`LANES`] elements, wherever their nodes are. Constants carry fraction·volume, so that
/// forces come out in newtons.
#[derive(Clone, Copy, Debug)]
#[repr(C, align(64))]
pub(super) struct Block {
    /// λ·w·vol [N·m].
    pub lambda: Row,
    /// μ·w·vol [N·m].
    pub mu: Row,
    /// As [`ElementConstants::neo_hookean`].
    pub neo_hookean: Row,
    /// As [`ElementConstants::collapse`].
    pub collapse: Row,
    /// `2E` at the last evaluation: xx, yy, zz, yz, xz, xy. Twice the strain saves nine halvings; it is exact.
    pub strain: [Row; 6],
    /// `J` at the last evaluation.
    pub det: Row,
    /// [`StrainLimit::deviator`].
    pub limit: Row,
    /// [`StrainLimit::slope`].
    pub slope: Row,
}

/// A symmetric matrix of each of [`LANES`] elements, components as in [`Block::strain`]: `2D`, what one Maxwell branch remembers, or the
/// rows of their fibres.
#[derive(Clone, Copy, Debug)]
#[repr(C, align(64))]
pub(super) struct Memory(pub [Row; 6]);

/// A block without elements.
const UNUSED: Block = Block {
    lambda: [0.0; LANES],
    mu: [0.0; LANES],
    neo_hookean: [0.0; LANES],
    collapse: [0.0; LANES],
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
    /// Nodes of each block's elements, `1 + spokes` rows side by side: the node that the others are seen from, then those. An
    /// element with fewer has its first node in their places, without a gradient.
    pub nodes: Vec<Nodes>,
    /// Gradients of the weights of all nodes but the first, `spokes` of them side by side.
    pub gradients: Vec<Gradients>,
    /// Those of a block side by side; empty without branches.
    pub memories: Vec<Memory>,
    /// Fibres of the elements of each block; empty where none has some.
    pub fibres: Vec<Memory>,
    /// How many nodes each element has beside the first.
    pub counts: Vec<[u16; LANES]>,
    /// Most nodes of an element beside the first: 3 of tetrahedra.
    pub spokes: usize,
    /// Maxwell branches of each element, at most [`MAX_BRANCHES`].
    pub branches: usize,
}

impl Blocks {
    /// So many, without elements.
    pub(super) fn new(blocks: usize, spokes: usize, branches: usize) -> Self {
        Self {
            all: vec![UNUSED; blocks],
            nodes: vec![[0; LANES]; blocks * (spokes + 1)],
            gradients: vec![[[0.0; LANES]; 3]; blocks * spokes],
            memories: vec![NO_MEMORY; blocks * branches],
            fibres: Vec::new(),
            counts: vec![[0; LANES]; blocks],
            spokes,
            branches,
        }
    }

    /// Makes room for the fibres of elements.
    pub(super) fn add_fibres(&mut self) {
        self.fibres = vec![NO_MEMORY; self.all.len()];
    }

    /// Takes all elements out.
    pub(super) fn clear(&mut self) {
        self.all.fill(UNUSED);
        self.nodes.fill([0; LANES]);
        self.gradients.fill([[0.0; LANES]; 3]);
        self.memories.fill(NO_MEMORY);
        self.fibres.fill(NO_MEMORY);
        self.counts.fill([0; LANES]);
    }

    /// What the branches of the elements of `block` remember.
    pub(super) fn memories_of(&self, block: usize) -> &[Memory] {
        &self.memories[block * self.branches..(block + 1) * self.branches]
    }

    fn nodes_of(&mut self, block: usize) -> &mut [Nodes] {
        &mut self.nodes[block * (self.spokes + 1)..(block + 1) * (self.spokes + 1)]
    }

    fn gradients_of(&mut self, block: usize) -> &mut [Gradients] {
        &mut self.gradients[block * self.spokes..(block + 1) * self.spokes]
    }

    /// Puts an element between `nodes` into a lane.
    pub(super) fn write<G: AsRef<[[Real; 3]]>>(
        &mut self,
        at: Lane,
        nodes: &[Slot],
        constants: &ElementConstants<G>,
        history: &History,
    ) {
        let lane = at.lane;
        let first = nodes.first().map_or(0, |slot| slot.0);
        for (i, row) in self.nodes_of(at.block).iter_mut().enumerate() {
            row[lane] = nodes.get(i).map_or(first, |slot| slot.0);
        }
        let gradients = constants.gradient.as_ref();
        for (i, rows) in self.gradients_of(at.block).iter_mut().enumerate() {
            let gradient = gradients.get(i).copied().unwrap_or_default();
            rows.iter_mut().zip(gradient).for_each(|(row, x)| row[lane] = x);
        }
        self.counts[at.block][lane] = gradients.len().min(self.spokes) as u16;
        let b = &mut self.all[at.block];
        b.lambda[lane] = constants.lambda;
        b.mu[lane] = constants.mu;
        b.neo_hookean[lane] = constants.neo_hookean;
        b.collapse[lane] = constants.collapse;
        self.set_fibres(at, &constants.fibres);
        self.write_history(at, history);
    }

    /// Leaves a lane without weight, and on nodes that are there.
    pub(super) fn vacate(&mut self, at: Lane) {
        let nothing =
            ElementConstants { gradient: [], lambda: 0.0, mu: 0.0, neo_hookean: 0.0, collapse: 0.0, fibres: [0.0; 6] };
        self.write(at, &[], &nothing, &History::REST);
        self.set_limit(at, StrainLimit::NONE);
    }

    /// Copies an element to another lane.
    pub(super) fn copy(&mut self, from: Lane, to: Lane) {
        let (i, j) = (from.lane, to.lane);
        for k in 0..=self.spokes {
            let node = self.nodes_of(from.block)[k][i];
            self.nodes_of(to.block)[k][j] = node;
        }
        for k in 0..self.spokes {
            let gradient = self.gradients_of(from.block)[k].map(|row| row[i]);
            self.gradients_of(to.block)[k].iter_mut().zip(gradient).for_each(|(row, x)| row[j] = x);
        }
        self.counts[to.block][j] = self.counts[from.block][i];
        let source = self.all[from.block];
        let b = &mut self.all[to.block];
        b.lambda[j] = source.lambda[i];
        b.mu[j] = source.mu[i];
        b.neo_hookean[j] = source.neo_hookean[i];
        b.collapse[j] = source.collapse[i];
        b.limit[j] = source.limit[i];
        b.slope[j] = source.slope[i];
        if let Some(rows) = self.fibres.get(from.block) {
            let fibres = rows.0.map(|row| row[i]);
            self.set_fibres(to, &fibres);
        }
        let history = self.history(from);
        self.write_history(to, &history);
    }

    /// Gives the element in a lane other fibres.
    pub(super) fn set_fibres(&mut self, at: Lane, fibres: &[Real; 6]) {
        if let Some(rows) = self.fibres.get_mut(at.block) {
            rows.0.iter_mut().zip(fibres).for_each(|(row, x)| row[at.lane] = *x);
        }
    }

    /// Nodes of the element in a lane.
    pub(super) fn nodes(&self, at: Lane) -> impl Iterator<Item = Slot> + '_ {
        let first = at.block * (self.spokes + 1);
        let count = usize::from(self.counts[at.block][at.lane]);
        self.nodes[first..=first + count].iter().map(move |row| Slot(row[at.lane]))
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
