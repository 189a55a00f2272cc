//! What of a mesh hangs together, and what only by a hinge.

use palpate_core::geometry::tet_mesh::{FACES, TetMesh};
use palpate_core::ids::NONE;
use palpate_core::math::Vec3;

/// Things of which some have been found to belong together.
pub struct Groups {
    root: Vec<u32>,
}

impl Groups {
    /// `count` things, each by itself.
    pub fn new(count: usize) -> Self {
        Self { root: (0..count as u32).collect() }
    }

    /// One of the group of `n`: the same for all that belong together.
    pub fn of(&mut self, mut n: u32) -> u32 {
        while self.root[n as usize] != n {
            self.root[n as usize] = self.root[self.root[n as usize] as usize];
            n = self.root[n as usize];
        }
        n
    }

    /// `a` and `b` belong together; false when that was known.
    pub fn join(&mut self, a: u32, b: u32) -> bool {
        let (a, b) = (self.of(a), self.of(b));
        self.root[b as usize] = a;
        a != b
    }
}

/// The element across each face of each of `elements` (n_elements), or [`NONE`].
pub fn neighbours(elements: &[[u32; 4]]) -> Vec<[u32; 4]> {
    let face = |e: usize, i: usize| {
        let mut nodes = FACES[i].map(|c| elements[e][c]);
        nodes.sort_unstable();
        (nodes, e as u32, i as u32)
    };
    let mut faces: Vec<_> = (0..elements.len()).flat_map(|e| (0..4).map(move |i| face(e, i))).collect();
    faces.sort_unstable();
    let mut across = vec![[NONE; 4]; elements.len()];
    for pair in faces.windows(2).filter(|pair| pair[0].0 == pair[1].0) {
        let [(_, a, i), (_, b, j)] = [pair[0], pair[1]];
        across[a as usize][i as usize] = b;
        across[b as usize][j as usize] = a;
    }
    across
}

/// One of the elements with which each element of `mesh` hangs together firmly (n_elements): across faces, or where two
/// pieces share three nodes that are not in a line. Pieces of their own hang on others by hinges at most.
pub fn firm_pieces(mesh: &TetMesh) -> Vec<u32> {
    let all = 0..mesh.elements.len() as u32;
    let mut groups = Groups::new(mesh.elements.len());
    for (e, across) in all.clone().zip(neighbours(&mesh.elements)) {
        across.into_iter().filter(|other| *other != NONE).for_each(|other| {
            groups.join(e, other);
        });
    }
    let mut corners: Vec<(u32, u32)> = all.clone().flat_map(|e| mesh.elements[e as usize].map(|n| (n, e))).collect();
    corners.sort_unstable();
    loop {
        // Pairs of pieces, and a node that they share.
        let mut shared: Vec<([u32; 2], u32)> = Vec::new();
        for around in corners.chunk_by(|a, b| a.0 == b.0) {
            let mut pieces: Vec<u32> = around.iter().map(|(_, e)| groups.of(*e)).collect();
            pieces.sort_unstable();
            pieces.dedup();
            for (i, a) in pieces.iter().enumerate() {
                shared.extend(pieces[i + 1..].iter().map(|b| ([*a, *b], around[0].0)));
            }
        }
        shared.sort_unstable();
        let mut joined = false;
        for pair in shared.chunk_by(|a, b| a.0 == b.0) {
            let points: Vec<Vec3> = pair.iter().map(|(_, n)| mesh.nodes[*n as usize]).collect();
            if span_a_plane(&points) {
                joined |= groups.join(pair[0].0[0], pair[0].0[1]);
            }
        }
        if !joined {
            return all.map(|e| groups.of(e)).collect();
        }
    }
}

/// True when the points do not all lie in a line.
fn span_a_plane(points: &[Vec3]) -> bool {
    let first = points[0];
    let farthest = points.iter().map(|p| p - first).max_by(|a, b| a.norm_squared().total_cmp(&b.norm_squared()));
    let along = farthest.unwrap_or_default();
    points.iter().any(|p| (p - first).cross(&along).norm() > 1e-6 * along.norm_squared())
}

#[cfg(test)]
mod tests {
    use super::*;
    use palpate_core::geometry::primitives::box_mesh;

    fn count(mesh: &TetMesh) -> usize {
        let mut pieces = firm_pieces(mesh);
        pieces.sort_unstable();
        pieces.dedup();
        pieces.len()
    }

    #[test]
    fn pieces_that_share_an_edge_or_a_corner_are_two_and_three_corners_hold() {
        let tetrahedra = |elements: &[[u32; 4]]| TetMesh {
            nodes: [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1], [1, 1, 1], [2, 1, 1], [1, 2, 1], [2, 2, 0]]
                .map(|p: [i32; 3]| Vec3::new(p[0].into(), p[1].into(), p[2].into()))
                .to_vec(),
            elements: elements.to_vec(),
        };
        assert_eq!(count(&tetrahedra(&[[0, 1, 2, 3], [1, 2, 3, 4]])), 1, "a face");
        assert_eq!(count(&tetrahedra(&[[0, 1, 2, 3], [1, 2, 4, 7]])), 2, "an edge");
        assert_eq!(count(&tetrahedra(&[[0, 1, 2, 3], [3, 4, 5, 6]])), 2, "a corner");
        // Each of two pieces of two elements shares an edge and a corner with the other.
        let firm = [[0, 1, 2, 3], [1, 2, 3, 4], [4, 5, 6, 7], [1, 5, 6, 7], [2, 5, 6, 7]];
        assert_eq!(count(&tetrahedra(&firm)), 1, "three corners apart");
        assert_eq!(count(&box_mesh(Vec3::repeat(0.1), [3; 3])), 1);
    }

    #[test]
    fn elements_know_their_neighbours_across_each_face() {
        let mesh = box_mesh(Vec3::repeat(0.1), [2; 3]);
        let across = neighbours(&mesh.elements);
        for (e, others) in across.iter().enumerate() {
            for (i, other) in others.iter().enumerate().filter(|(_, other)| **other != NONE) {
                assert!(FACES[i].iter().all(|c| mesh.elements[*other as usize].contains(&mesh.elements[e][*c])));
                assert!(across[*other as usize].contains(&(e as u32)));
            }
        }
        let outer = across.iter().flatten().filter(|other| **other == NONE).count();
        assert_eq!(outer, mesh.boundary().len());
    }
}
