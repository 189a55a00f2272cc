//! The elements in use, each in one of the step classes, in blocks that the kernel evaluates.
//!
//! The elements of a class form one sequence: forces are added in its order, so the order decides the last bits of the
//! sums. An element joins at the end; where one leaves, the last of the class takes its place. Which blocks hold the
//! sequence is of no consequence, so the order of the ids is all that a saved state needs of it.

pub use super::element::{ElementConstants, History};
use super::element::{MAX_BRANCHES, StrainLimit};
use super::element_block::{Blocks, Lane};
use super::element_kernel::{self, Batch, Extremes, Rates, Simd};
use super::lanes::{LANES, Padded};
use super::material::Material;
use crate::ids::{self, Element, Node, Slot};
use crate::math::Real;

/// Step classes.
pub const CLASSES: usize = 8;

/// Where an element is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Place {
    /// Its class, or [`Place::OUT`].
    class: u8,
    /// Its place in the sequence of its class.
    sequence: u32,
}

impl Place {
    const OUT: Place = Place { class: u8::MAX, sequence: 0 };
}

/// One class: a dense sequence of elements.
#[derive(Clone, Debug, Default)]
struct Class {
    /// Its blocks, in order; all are full, but for the last.
    blocks: Vec<u32>,
    /// Its elements.
    count: usize,
}

/// The tetrahedra in use.
pub type ElementPool = Pool<Element>;
/// The stars in use, by the node that each is around.
pub type StarPool = Pool<Node>;

/// All elements of a kind that are in use. Nothing allocates after it is made.
#[derive(Clone, Debug)]
pub struct Pool<Id> {
    blocks: Blocks,
    /// Ids of the elements of each block, or none.
    owners: Vec<[Id; LANES]>,
    /// Blocks that belong to no class, the next to be used last.
    free: Vec<u32>,
    classes: [Class; CLASSES],
    /// By class, the blocks that the last evaluation found with an element over its limit.
    over_limit: [Vec<u32>; CLASSES],
    places: Vec<Place>,
    len: usize,
    capacity: usize,
    nodes: usize,
    /// Whether some elements may be neo-Hookean.
    neo_hookean: bool,
}

/// What is an element by itself, or has a star around it.
pub trait Kind: ids::Id {
    /// Whether it has a star.
    const HAS_STAR: bool;
}

impl Kind for Element {
    const HAS_STAR: bool = false;
}

impl Kind for Node {
    const HAS_STAR: bool = true;
}

impl ElementPool {
    /// An empty pool for elements `0..total_elements`, of which `capacity` may be in use at once, between `nodes`
    /// nodes, with that many Maxwell `branches` each.
    ///
    /// # Panics
    /// When there are more than [`MAX_BRANCHES`] branches, or more elements than a `u32` counts.
    pub fn new(total_elements: usize, capacity: usize, nodes: usize, branches: usize) -> Self {
        Self::with_spokes(total_elements, capacity, nodes, 3, branches)
    }
}

impl<Id: Kind> Pool<Id> {
    /// As [`ElementPool::new`], of elements with at most `spokes` nodes beside the first.
    pub(super) fn with_spokes(total: usize, capacity: usize, nodes: usize, spokes: usize, branches: usize) -> Self {
        assert!(branches <= MAX_BRANCHES, "at most {MAX_BRANCHES} branches");
        assert!(total < Id::NONE.index(), "too many elements");
        let capacity = capacity.min(total);
        let full = capacity.div_ceil(LANES);
        // Every class may have one block that is not full.
        let blocks = full + CLASSES;
        let mut pool = Self {
            blocks: Blocks::new(blocks, spokes, branches),
            owners: vec![[Id::NONE; LANES]; blocks],
            free: Vec::with_capacity(blocks),
            classes: std::array::from_fn(|_| Class { blocks: Vec::with_capacity(full + 1), count: 0 }),
            over_limit: std::array::from_fn(|_| Vec::with_capacity(full + 1)),
            places: vec![Place::OUT; total],
            len: 0,
            capacity,
            nodes,
            neo_hookean: false,
        };
        pool.clear();
        pool
    }

    /// The same where elements are of such `materials`: of what none of them has the kernel need not ask.
    #[must_use]
    pub fn of_materials(mut self, materials: &[Material]) -> Self {
        self.neo_hookean = materials.iter().any(|material| material.neo_hookean > 0.0);
        if materials.iter().any(|material| material.fibres.are_there()) {
            self.blocks.add_fibres();
        }
        self
    }

    /// Takes all elements out.
    pub fn clear(&mut self) {
        self.blocks.clear();
        self.owners.fill([Id::NONE; LANES]);
        self.places.fill(Place::OUT);
        for class in &mut self.classes {
            class.blocks.clear();
            class.count = 0;
        }
        self.free.clear();
        self.free.extend((0..self.blocks.all.len() as u32).rev());
        self.len = 0;
    }

    /// Puts element `id` at the end of `class`. False, without effect, when the pool is full or has the element.
    ///
    /// # Panics
    /// When the id, the class or a node is beyond what the pool was made for.
    pub fn insert(
        &mut self,
        id: Id,
        class: usize,
        nodes: &[Slot],
        constants: &ElementConstants<impl AsRef<[[Real; 3]]>>,
        history: &History,
    ) -> bool {
        self.check_nodes(nodes);
        assert!(class < CLASSES, "no such class");
        debug_assert!(self.neo_hookean || constants.neo_hookean == 0.0);
        debug_assert!(!self.blocks.fibres.is_empty() || constants.fibres == [0.0; 6]);
        if self.places[id.index()] != Place::OUT || self.len == self.capacity {
            return false;
        }
        let lane = self.append(id, class);
        self.blocks.write(lane, nodes, constants, history);
        self.len += 1;
        true
    }

    /// Takes element `id` out; the last of its class takes its place. `None` when the pool does not have it.
    pub fn remove(&mut self, id: Id) -> Option<History> {
        let place = self.place(id)?;
        let history = self.blocks.history(self.lane(place));
        self.vacate(place);
        self.places[id.index()] = Place::OUT;
        self.len -= 1;
        Some(history)
    }

    /// Moves element `id` to the end of `class`; nothing happens when it is there. False when the pool does not have
    /// it.
    ///
    /// # Panics
    /// When there is no such class.
    pub fn set_class(&mut self, id: Id, class: usize) -> bool {
        assert!(class < CLASSES, "no such class");
        let Some(place) = self.place(id) else { return false };
        if place.class as usize != class {
            let from = self.lane(place);
            let to = self.append(id, class);
            self.blocks.copy(from, to);
            self.vacate(place);
        }
        true
    }

    /// Gives element `id` the stiffness of `constants`, whose gradients it has. False when the pool does not have it.
    pub fn set_stiffness<G>(&mut self, id: Id, constants: &ElementConstants<G>) -> bool {
        let Some(at) = self.find(id) else { return false };
        self.blocks.all[at.block].lambda[at.lane] = constants.lambda;
        self.blocks.all[at.block].mu[at.lane] = constants.mu;
        self.blocks.all[at.block].collapse[at.lane] = constants.collapse;
        self.blocks.set_fibres(at, &constants.fibres);
        true
    }

    /// What element `id` remembers.
    pub fn history(&self, id: Id) -> Option<History> {
        self.find(id).map(|lane| self.blocks.history(lane))
    }

    /// Has element `id` remember `history`. False when the pool does not have it.
    pub fn set_history(&mut self, id: Id, history: &History) -> bool {
        let Some(lane) = self.find(id) else { return false };
        self.blocks.write_history(lane, history);
        true
    }

    /// Strain of element `id` at its last evaluation: xx, yy, zz, yz, xz, xy.
    pub fn strain(&self, id: Id) -> Option<[Real; 6]> {
        // Not by way of the whole history: the branches lie elsewhere, and this is asked for often.
        self.find(id).map(|lane| self.blocks.strain(lane))
    }

    /// [`ElementPool::strain`], and the determinant of the deformation gradient then.
    pub fn strain_and_det(&self, id: Id) -> Option<([Real; 6], Real)> {
        let det = self.find(id).map(|at| self.blocks.all[at.block].det[at.lane]);
        self.strain(id).zip(det)
    }

    /// Element at `place` in the sequence of `class`.
    pub fn id_at(&self, class: usize, place: usize) -> Option<Id> {
        (place < self.classes[class].count)
            .then(|| self.owners[self.classes[class].blocks[place / LANES] as usize][place % LANES])
    }

    /// Beyond `limit`, and when crushed, element `id` is among those [over their limit](ElementPool::over_limit).
    pub fn set_strain_limit(&mut self, id: Id, limit: StrainLimit) {
        if let Some(lane) = self.find(id) {
            self.blocks.set_limit(lane, limit);
        }
    }

    /// What [`ElementPool::set_strain_limit`] has set.
    pub fn strain_limit(&self, id: Id) -> Option<StrainLimit> {
        self.find(id).map(|lane| self.blocks.limit(lane))
    }

    /// Elements of the blocks of `class` in which the last evaluation found one over its limit.
    pub fn over_limit(&self, class: usize) -> impl Iterator<Item = Id> + '_ {
        self.over_limit[class].iter().flat_map(|b| self.owners[*b as usize]).filter(|e| *e != Id::NONE)
    }

    /// Forgets who is over its limit: what was found in one tick says nothing in the next.
    pub fn forget_over_limit(&mut self) {
        self.over_limit.iter_mut().for_each(Vec::clear);
    }

    /// Most elements in use at once.
    pub fn capacity(&self) -> usize {
        self.capacity
    }

    /// The class of element `id`.
    pub fn class_of(&self, id: Id) -> Option<usize> {
        self.place(id).map(|place| place.class as usize)
    }

    /// The nodes of element `id`.
    pub fn nodes_of(&self, id: Id) -> Option<impl Iterator<Item = Slot> + '_> {
        self.find(id).map(|lane| self.blocks.nodes(lane))
    }

    /// True when element `id` is in use.
    pub fn contains(&self, id: Id) -> bool {
        self.place(id).is_some()
    }

    /// Elements of a class.
    pub fn count(&self, class: usize) -> usize {
        self.classes[class].count
    }

    /// Elements in use.
    pub fn len(&self) -> usize {
        self.len
    }

    /// True when no element is in use.
    pub fn is_empty(&self) -> bool {
        self.len == 0
    }

    /// The elements of a class in the order of its sequence: inserted in this order, they make up the same sequence.
    pub fn ids(&self, class: usize) -> impl Iterator<Item = Id> + '_ {
        let of = &self.classes[class];
        (0..of.count).map(|s| self.owners[of.blocks[s / LANES] as usize][s % LANES])
    }

    /// Feeds every bit of what is saved of the elements of a class to `hash`, in the order of its sequence: ids, histories
    /// and strain limits. Block by block, because element by element takes several times as long.
    pub fn hash_into(&self, class: usize, hash: &mut xxhash_rust::xxh3::Xxh3) {
        let of = &self.classes[class];
        hash.update(&(of.count as u32).to_le_bytes());
        for (i, &block) in of.blocks.iter().enumerate() {
            let block = block as usize;
            // Lanes that are not in use hold what the kernel has left there.
            let used = (of.count - i * LANES).min(LANES);
            hash.update(bytemuck::cast_slice(&self.owners[block].map(|id| id.index() as u32)[..used]));
            let (b, memories) = (&self.blocks.all[block], self.blocks.memories_of(block));
            let parts = [&b.strain[..], &[b.det, b.limit, b.slope]];
            for rows in parts.into_iter().chain(memories.iter().map(|memory| &memory.0[..])) {
                if used == LANES {
                    hash.update(bytemuck::cast_slice(rows.as_flattened()));
                } else {
                    rows.iter().for_each(|row| hash.update(bytemuck::cast_slice(&row[..used])));
                }
            }
        }
    }

    /// Adds the forces of the elements of a class to `force` [N] and has them remember this evaluation.
    ///
    /// `position` [m], `force`: (nodes). A `path` that is not available gives way to the portable one.
    pub fn add_forces(
        &mut self,
        path: Simd,
        class: usize,
        rates: &Rates,
        position: &[Padded],
        force: &mut [Padded],
    ) -> Extremes {
        if position.len() != self.nodes || force.len() != self.nodes {
            debug_assert!(false, "fields of another body");
            return Extremes::REST;
        }
        self.over_limit[class].clear();
        let Class { blocks: order, count } = &self.classes[class];
        if *count == 0 {
            return Extremes::REST;
        }
        let Blocks { all, nodes, gradients, memories, fibres, counts, spokes, branches } = &mut self.blocks;
        let batch = Batch {
            blocks: all,
            nodes,
            gradients,
            memories,
            fibres,
            counts,
            spokes: *spokes,
            order,
            count: *count,
            branches: *branches,
            neo_hookean: self.neo_hookean,
            over_limit: &mut self.over_limit[class],
        };
        let path = if path.is_available() { path } else { Simd::Portable };
        // SAFETY: the path is available; both fields have `nodes` entries, and no element names a node beyond them
        // (`check_nodes`). Unused lanes name node 0, which is there because the class has an element.
        unsafe {
            if Id::HAS_STAR {
                element_kernel::add_forces::<true>(path, batch, rates, position, force)
            } else {
                element_kernel::add_forces::<false>(path, batch, rates, position, force)
            }
        }
    }

    /// What lets the kernel go without bounds checks.
    fn check_nodes(&self, nodes: &[Slot]) {
        assert!(nodes.iter().all(|n| n.index() < self.nodes), "an element names a lost node");
        assert!(Id::HAS_STAR || nodes.len() == 4, "a tetrahedron has four nodes");
    }

    fn place(&self, id: Id) -> Option<Place> {
        self.places.get(id.index()).copied().filter(|place| *place != Place::OUT)
    }

    fn lane(&self, place: Place) -> Lane {
        let s = place.sequence as usize;
        Lane { block: self.classes[place.class as usize].blocks[s / LANES] as usize, lane: s % LANES }
    }

    fn find(&self, id: Id) -> Option<Lane> {
        self.place(id).map(|place| self.lane(place))
    }

    /// A lane at the end of `class` for element `id`. There is a free block for it: see `new`.
    fn append(&mut self, id: Id, class: usize) -> Lane {
        let to = &mut self.classes[class];
        if to.count.is_multiple_of(LANES) {
            debug_assert!(!self.free.is_empty());
            to.blocks.push(self.free.pop().unwrap_or_default());
        }
        let place = Place { class: class as u8, sequence: to.count as u32 };
        to.count += 1;
        self.places[id.index()] = place;
        let lane = self.lane(place);
        self.owners[lane.block][lane.lane] = id;
        lane
    }

    /// Fills `place` with the last element of its class, whose lane falls into disuse.
    fn vacate(&mut self, place: Place) {
        let class = place.class as usize;
        let sequence = self.classes[class].count - 1;
        let last = self.lane(Place { class: place.class, sequence: sequence as u32 });
        let hole = self.lane(place);
        if last != hole {
            self.blocks.copy(last, hole);
            let moved = self.owners[last.block][last.lane];
            self.owners[hole.block][hole.lane] = moved;
            self.places[moved.index()] = place;
        }
        self.owners[last.block][last.lane] = Id::NONE;
        let from = &mut self.classes[class];
        from.count = sequence;
        if last.lane == 0 {
            from.blocks.pop();
            self.free.push(last.block as u32);
        }
        self.blocks.vacate(last);
    }
}

#[cfg(test)]
mod tests;
