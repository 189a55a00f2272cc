//! Ties between neighbouring levels: Voronoi parents and hosts [DDCB01 2.1], found once, never searched at run time.

use super::level::Level;
use crate::geometry::locate::{Locator, nearest};
use xxhash_rust::xxh3::xxh3_64_with_seed;

/// Fills `parent`, `coarser_host` and `finer_host` of every level.
pub fn tie(levels: &mut [Level]) {
    for fine in 1..levels.len() {
        let (coarser, finer) = levels.split_at_mut(fine);
        let (coarse, fine) = (&mut coarser[fine - 1], &mut finer[0]);
        fine.parent = parents(coarse, fine);
        adopt_for_the_childless(coarse, fine);
        let locator = Locator::new(&coarse.mesh, coarse.spacing);
        fine.coarser_host = fine.mesh.nodes.iter().map(|u| locator.host(*u)).collect();
        let locator = Locator::new(&fine.mesh, fine.spacing);
        coarse.finer_host = coarse.mesh.nodes.iter().map(|u| locator.host(*u)).collect();
    }
}

/// The nearest coarse node of each fine one. Where several are as near, as on nested lattices, the one whose children
/// make up the least part of its own volume: what a node stands for is to be about what its children stand for.
fn parents(coarse: &Level, fine: &Level) -> Vec<u32> {
    let nearest = nearest(&coarse.mesh.nodes, &fine.mesh.nodes, coarse.spacing);
    let (own, share) = (coarse.mesh.node_volumes(), fine.mesh.node_volumes());
    let mut children = vec![0.0; own.len()];
    for (n, tied) in nearest.iter().enumerate().filter(|(_, tied)| tied.len() == 1) {
        children[tied[0] as usize] += share[n];
    }
    let mut parents: Vec<u32> = nearest.iter().map(|tied| tied[0]).collect();
    for (n, tied) in nearest.iter().enumerate().filter(|(_, tied)| tied.len() > 1) {
        let part = |p: u32| children[p as usize] / own[p as usize];
        // By lot where that is alike, too, lest all cells lie off their nodes the same way.
        let lot = |p: u32| xxh3_64_with_seed(&p.to_le_bytes(), n as u64);
        let order = |a: &u32, b: &u32| part(*a).total_cmp(&part(*b)).then(lot(*a).cmp(&lot(*b)));
        parents[n] = tied.iter().copied().min_by(order).unwrap_or_default();
        children[parents[n] as usize] += share[n];
    }
    parents
}

/// On independent meshes a few parents come out without a child: each adopts the nearest finer node whose own parent
/// keeps another one, so that splitting any node puts something in its place.
fn adopt_for_the_childless(coarse: &Level, fine: &mut Level) {
    let mut children = vec![0u32; coarse.mesh.nodes.len()];
    for &p in &fine.parent {
        children[p as usize] += 1;
    }
    for (p, u) in coarse.mesh.nodes.iter().enumerate() {
        if children[p] > 0 {
            continue;
        }
        let adopted = (0..fine.mesh.nodes.len()).filter(|&n| children[fine.parent[n] as usize] > 1).min_by(|&a, &b| {
            let distance = |n: usize| (fine.mesh.nodes[n] - u).norm_squared();
            distance(a).total_cmp(&distance(b)).then(a.cmp(&b))
        });
        // With fewer fine nodes than coarse ones there may be none to spare; `body` refuses such levels.
        if let Some(n) = adopted {
            children[fine.parent[n] as usize] -= 1;
            children[p] = 1;
            fine.parent[n] = p as u32;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::primitives::box_mesh;
    use crate::math::{Real, Vec3};

    #[test]
    fn what_is_tied_goes_where_volume_is_wanting() {
        let level = |cells: u32| {
            let mesh = box_mesh(Vec3::repeat(0.1), [cells; 3]);
            let whole = vec![1.0; mesh.elements.len()];
            Level::new(mesh, whole, 0.1 / Real::from(cells), 1000.0)
        };
        let (coarse, fine) = (level(4), level(8));
        let parents = parents(&coarse, &fine);
        let (own, share) = (coarse.mesh.node_volumes(), fine.mesh.node_volumes());
        let mut parts = vec![0.0; own.len()];
        parents.iter().zip(&share).for_each(|(p, v)| parts[*p as usize] += v / own[*p as usize]);
        let (least, most) = parts.iter().fold((Real::INFINITY, 0.0), |(l, m): (Real, Real), p| (l.min(*p), m.max(*p)));
        assert!(least > 0.25 && most < 2.0, "{least} {most}");
    }
}
