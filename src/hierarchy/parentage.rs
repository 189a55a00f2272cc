//! Ties between neighbouring levels: Voronoi parents and hosts [DDCB01 2.1], found once, never searched at run time.

use super::level::Level;
use crate::geometry::locate::{Locator, nearest};

/// Fills `parent`, `coarser_host` and `finer_host` of every level.
pub fn tie(levels: &mut [Level]) {
    for fine in 1..levels.len() {
        let (coarser, finer) = levels.split_at_mut(fine);
        let (coarse, fine) = (&mut coarser[fine - 1], &mut finer[0]);
        fine.parent = nearest(&coarse.mesh.nodes, &fine.mesh.nodes, coarse.spacing);
        adopt_for_the_childless(coarse, fine);
        let locator = Locator::new(&coarse.mesh, coarse.spacing);
        fine.coarser_host = fine.mesh.nodes.iter().map(|u| locator.host(*u)).collect();
        let locator = Locator::new(&fine.mesh, fine.spacing);
        coarse.finer_host = coarse.mesh.nodes.iter().map(|u| locator.host(*u)).collect();
    }
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
