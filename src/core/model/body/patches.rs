//! Patches: pieces of the display surface, each of which meets flat ground, another organ, or its own, as one.
//!
//! A body lies on ground with all of a side, by more vertices than a tick has time for. A patch meets the ground with its mean
//! place, by area, so that an even pressure loads the surface evenly however much finer than a patch the mesh is. Patches are
//! those of the rest shape: chosen anew in each tick, they would keep a body that lies still in motion.

use crate::geometry::Surface;
use crate::ids::{OrganId, Triangle, Vertex};
use crate::math::{Bounds, Real, Vec3};
use crate::model::csr::Csr;
use std::collections::BTreeSet;
use std::f64::consts::PI;
use std::ops::Range;

/// Patches of a smooth organ whose finest level has nodes enough, about: chosen for cost, which is in proportion to those that
/// touch. What lies still weighs the same on any number; fewer resolve the moment of their pressure less. Twice as many halve what two
/// balls push too little, and take half as much again of the tick of an organ that nothing touches.
const PATCHES: Real = 256.0;
/// Most patches of any body: what bounds the cost of a tick.
pub const MOST_PATCHES: usize = 1024;
/// Most vertices that stand for a patch: the nodes that carry them fit a [`Row`](crate::model::Row), and cost what these do.
const MOST_VERTICES: usize = 8;
/// Cosine between normals of a patch, 26°, less than half of a block's edge (45° from either side to the normal on it): the
/// vertices of an edge make patches of their own. Where it is below 0.7 they join those of a side, and a block tips over a line
/// inside of it; near 1 each vertex of a curved surface is a patch.
pub const SAME_SIDE: Real = 0.9;
/// Factor on the squared distance of patches while they are too many: nearer to 1 takes more rounds at start-up, and a larger one
/// leaves fewer patches than there may be.
const WIDER: Real = 1.4;

/// Steps from patch to patch along the surface within which two of them do not meet: what is between them keeps them apart, and their
/// mean places are off a surface that bends by as much as a fold between them is wide. With one those of a tight bend meet beside their
/// places, with more tighter folds pass through themselves.
const BESIDE: usize = 2;

/// All patches of a body.
#[derive(Debug)]
pub struct Patches {
    /// By patch: display vertices and their weights, which sum to one.
    of: Csr<(Vertex, Real)>,
    /// By organ: its first patch; after the last, how many there are.
    first: Vec<u32>,
    /// By patch: radius of the disc that is as large [m].
    radius: Vec<Real>,
    /// By patch: display triangles, each of one patch, ...
    triangles: Csr<Triangle>,
    /// ... and how far these go.
    extent: Vec<Extent>,
    /// By patch: itself, and those at most [`BESIDE`] steps from it.
    beside: Csr<u32>,
}

/// How far the display triangles of a patch go at rest.
#[derive(Clone, Copy, Debug, Default)]
pub struct Extent {
    /// A corner of them is no farther from the patch's middle [m].
    pub reach: Real,
    /// None of their edges is longer [m].
    pub edge: Real,
}

impl Patches {
    /// Those of `surface`, around whose vertices are these `areas` [m²]: of organs with these vertices and this spacing of their finest level
    /// [m].
    pub(super) fn new(surface: &Surface, areas: &[Real], organs: &[(Range<usize>, Real)]) -> Self {
        let place = &surface.vertices;
        let mut normals = vec![Vec3::zeros(); place.len()];
        for (t, triangle) in surface.triangles.iter().enumerate() {
            let [a, b, c] = surface.corners(t);
            triangle.iter().for_each(|v| normals[*v as usize] += (b - a).cross(&(c - a)));
        }
        normals.iter_mut().for_each(|n| *n = n.try_normalize(0.0).unwrap_or_default());
        let (mut patches, mut first) = (Vec::new(), vec![0]);
        for organ in organs {
            patches.extend(of_organ(place, areas, &normals, organ, MOST_PATCHES / organs.len()));
            first.push(patches.len() as u32);
        }
        let mut patch_of = vec![None; place.len()];
        for (i, patch) in patches.iter().enumerate() {
            patch.members.iter().for_each(|v| patch_of[*v] = Some(i));
        }
        let owner = |triangle: &[u32; 3]| triangle.iter().find_map(|v| patch_of[*v as usize]);
        let owned = surface.triangles.iter().enumerate().filter_map(|(t, corners)| Some((owner(corners)?, t)));
        let owned: Vec<(usize, Triangle)> = owned.map(|(i, t)| (i, Triangle::at(t))).collect();
        let mut extent = vec![Extent::default(); patches.len()];
        for (i, t) in &owned {
            let (middle, [a, b, c]) = (place[patches[*i].vertices[0].0.index()], surface.corners(t.index()));
            let far = |pairs: [(Vec3, Vec3); 3]| pairs.iter().map(|(p, q)| (p - q).norm()).fold(0.0, Real::max);
            let Extent { reach, edge } = &mut extent[*i];
            *reach = reach.max(far([a, b, c].map(|p| (p, middle))));
            *edge = edge.max(far([(a, b), (b, c), (c, a)]));
        }
        let triangles = Csr::new(patches.len(), owned.into_iter());
        let beside = beside(surface, &patch_of, patches.len());
        let all = patches.iter().enumerate();
        let entries = all.flat_map(|(i, patch)| patch.vertices.iter().map(move |entry| (i, *entry)));
        let of = Csr::new(patches.len(), entries);
        Self {
            of,
            first,
            radius: patches.iter().map(|patch| (patch.area / PI).sqrt()).collect(),
            triangles,
            extent,
            beside,
        }
    }

    /// How many they are.
    pub fn count(&self) -> u32 {
        self.first.last().copied().unwrap_or(0)
    }

    /// Numbers of those of an organ.
    pub fn of_organ(&self, organ: OrganId) -> Range<u32> {
        self.first[organ.index()]..self.first[organ.index() + 1]
    }

    /// The organ that patch `i` is of.
    pub fn organ(&self, i: u32) -> OrganId {
        OrganId::at(self.first.partition_point(|first| *first <= i) - 1)
    }

    /// Radius of the disc that is as large as patch `i` [m].
    pub fn radius(&self, i: u32) -> Real {
        self.radius[i as usize]
    }

    /// Display triangles of patch `i`: each is of one patch.
    pub fn triangles(&self, i: u32) -> &[Triangle] {
        self.triangles.of(i as usize)
    }

    /// How far these go.
    pub fn extent(&self, i: u32) -> Extent {
        self.extent[i as usize]
    }

    /// Patch `i` and those beside it, which it does not meet however the surface folds.
    pub fn beside(&self, i: u32) -> &[u32] {
        self.beside.of(i as usize)
    }

    /// The vertex in the middle of patch `i`.
    pub fn middle(&self, i: u32) -> Vertex {
        self.of(i)[0].0
    }

    /// Vertices of patch `i` and their weights; the first is [in its middle](Self::middle).
    pub fn of(&self, i: u32) -> &[(Vertex, Real)] {
        self.of.of(i as usize)
    }
}

/// By patch: itself, and those at most [`BESIDE`] steps from it over triangles of both; `patch_of` each vertex.
fn beside(surface: &Surface, patch_of: &[Option<usize>], count: usize) -> Csr<u32> {
    let of_corners = |corners: &[u32; 3]| corners.map(|v| patch_of[v as usize]);
    let mut next = vec![BTreeSet::new(); count];
    for [a, b, c] in surface.triangles.iter().map(of_corners) {
        for (from, to) in [(a, b), (b, c), (c, a)] {
            if let (Some(from), Some(to)) = (from, to) {
                next[from].insert(to);
                next[to].insert(from);
            }
        }
    }
    let around = |i: usize| {
        let step = |all: BTreeSet<usize>| all.iter().flat_map(|i| next[*i].iter().chain([i])).copied().collect();
        (0..BESIDE).fold(BTreeSet::from([i]), |all, _| step(all))
    };
    let pairs: Vec<_> = (0..count).flat_map(|i| around(i).into_iter().map(move |of| (i, of as u32))).collect();
    Csr::new(count, pairs.into_iter())
}

/// A patch as it is made.
struct Patch {
    /// Display vertices and their weights.
    vertices: Vec<(Vertex, Real)>,
    /// [m²].
    area: Real,
    /// All display vertices that it stands for.
    members: Vec<usize>,
}

/// Patches of an organ with these vertices and this spacing of its finest level [m], at most so many.
fn of_organ(
    place: &[Vec3],
    areas: &[Real],
    normals: &[Vec3],
    (vertices, spacing): &(Range<usize>, Real),
    most: usize,
) -> Vec<Patch> {
    let own = || vertices.clone();
    // No smaller than the faces of the finest elements, two to a square of nodes, in each of which the stress is one.
    let mut apart = (areas[own()].iter().sum::<Real>() / PATCHES).max(0.5 * spacing * spacing);
    let alike = |v: usize, w: usize| normals[v].dot(&normals[w]) > SAME_SIDE;
    let nearest = |from: &[usize], v: usize| {
        let squared = |i: usize| (place[from[i]] - place[v]).norm_squared();
        (0..from.len()).filter(|i| alike(v, from[*i])).map(|i| (i, squared(i))).min_by(|a, b| a.1.total_cmp(&b.1))
    };
    let size = Bounds::of(place[own()].iter().copied()).size().norm_squared();
    let centres = loop {
        let mut centres: Vec<usize> = Vec::new();
        for v in own().filter(|v| areas[*v] > 0.0) {
            if nearest(&centres, v).is_none_or(|(_, squared)| squared >= apart) {
                centres.push(v);
            }
        }
        if centres.len() <= most || apart > size {
            centres.truncate(most);
            break centres;
        }
        apart *= WIDER;
    };
    let mut members: Vec<Vec<usize>> = vec![Vec::new(); centres.len()];
    for v in own().filter(|v| areas[*v] > 0.0) {
        if let Some((i, _)) = nearest(&centres, v) {
            members[i].push(v);
        }
    }
    let patches = centres.iter().zip(members).map(|(centre, members)| {
        let (vertices, area) = weighed(place, areas, *centre, &members);
        Patch { vertices, area, members }
    });
    patches.collect()
}

/// At most [`MOST_VERTICES`] of `all` vertices of a patch, far from each other, with the parts of its area nearest to them, and that [m²].
fn weighed(place: &[Vec3], areas: &[Real], centre: usize, all: &[usize]) -> (Vec<(Vertex, Real)>, Real) {
    let mut kept = vec![centre];
    let nearest = |kept: &[usize], v: usize| {
        let squared = |i: &usize| (place[kept[*i]] - place[v]).norm_squared();
        (0..kept.len()).map(|i| (i, squared(&i))).min_by(|a, b| a.1.total_cmp(&b.1)).unwrap_or_default()
    };
    while kept.len() < MOST_VERTICES.min(all.len()) {
        let far = |v: &&usize| nearest(&kept, **v).1;
        match all.iter().max_by(|a, b| far(a).total_cmp(&far(b))) {
            Some(v) if far(&v) > 0.0 => kept.push(*v),
            _ => break,
        }
    }
    let mut area = vec![0.0; kept.len()];
    all.iter().for_each(|v| area[nearest(&kept, *v).0] += areas[*v]);
    let whole: Real = area.iter().sum();
    (kept.iter().zip(area).map(|(v, a)| (Vertex::at(*v), a / whole)).collect(), whole)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::primitives::box_surface;

    #[test]
    fn patches_of_a_block_lie_on_one_side_and_have_the_mean_place_of_their_area() {
        let surface = box_surface(Vec3::new(0.1, 0.08, 0.05), [25, 20, 12]);
        let areas = surface.vertex_areas();
        let patches = Patches::new(&surface, &areas, &[(0..surface.vertices.len(), 0.004)]);
        let all = || (0..patches.count()).map(|i| patches.of(i));
        assert!((200..=600).contains(&patches.count()), "{}", patches.count());
        assert!(all().all(|p| (p.iter().map(|(_, w)| w).sum::<Real>() - 1.0).abs() < 1e-12));
        assert!(all().all(|p| p.len() <= MOST_VERTICES));
        let place = |p: &[(Vertex, Real)]| p.iter().map(|(v, w)| surface.vertices[v.index()] * *w).sum::<Vec3>();
        // Those that have a vertex on the lower side's inside lie in it as a whole, and the rim has its own on the very edge.
        let below = |v: &Vertex| surface.vertices[v.index()].z == 0.0;
        let lower: Vec<_> = all().filter(|p| p.iter().any(|(v, _)| below(v))).map(place).collect();
        assert!(lower.iter().filter(|p| p.z == 0.0).count() >= 30);
        assert!(lower.iter().any(|p| p.x == 0.0 && p.z == 0.0) && lower.iter().any(|p| p.x == 0.1 && p.z == 0.0));
    }
}
