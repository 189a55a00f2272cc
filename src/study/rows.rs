//! Where interface nodes are: rows of weights on masters, `x_I = Σ P_Ij x_j`, two ways.
//!
//! Masters are the active nodes and the fixed ones, whose place is known in any case.

use super::levels::Levels;
use nalgebra::{Matrix4, Vector4};
use palpate_core::math::{Real, Vec3};

/// Weights on masters, ascending by node; they sum to one and reproduce affine fields.
pub type Row = Vec<(usize, Real)>;

/// How an interface node finds its masters.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum RowKind {
    /// The tetrahedron of the next coarser or finer level that contains it [DDCB01 2.3]; where that hangs on other
    /// interface nodes, these are replaced by their own rows, again and again.
    Hosts,
    /// A moving-least-squares row straight on the active nodes nearby, whatever their level.
    MovingLeastSquares,
}

impl RowKind {
    /// Words for a table.
    pub fn name(self) -> &'static str {
        match self {
            Self::Hosts => "hosts",
            Self::MovingLeastSquares => "MLS",
        }
    }
}

/// Rows of the nodes in `wanted`.
pub fn rows(kind: RowKind, levels: &Levels, active: &[bool], wanted: &[usize]) -> Vec<Row> {
    let master: Vec<bool> = active.iter().zip(&levels.fixed).map(|(a, f)| *a || *f).collect();
    match kind {
        RowKind::Hosts => wanted.iter().map(|node| substituted_row(levels, active, &master, *node)).collect(),
        RowKind::MovingLeastSquares => {
            let masters: Vec<usize> = (0..master.len()).filter(|n| master[*n]).collect();
            wanted.iter().map(|node| least_squares_row(levels, &masters, *node)).collect()
        }
    }
}

/// The containing tetrahedron with less weight on nodes that are not masters: the paper's "currently active
/// tetrahedron". Where both have as much, the side on which the node's own region is active: finer if it was split, else
/// coarser. (Counting masters instead of weighing them sends a corner that two levels share round in a circle.)
fn direct_row(levels: &Levels, active: &[bool], master: &[bool], node: usize) -> [(usize, Real); 4] {
    let open = |host: &Option<[(usize, Real); 4]>| match host {
        Some(row) => row.iter().filter(|(n, _)| !master[*n]).map(|(_, w)| w.abs()).sum(),
        None => Real::INFINITY,
    };
    let (coarser, finer) = (levels.coarser_host(node), levels.finer_host(node));
    let (open_coarser, open_finer): (Real, Real) = (open(&coarser), open(&finer));
    let alike = (open_coarser - open_finer).abs() < 1e-9;
    let finer_wins = if alike { levels.is_refined(active, node) } else { open_finer < open_coarser };
    // One of the two exists, because a body of one level has no interface nodes.
    if finer_wins { finer } else { coarser }.unwrap_or([(node, 0.25); 4])
}

/// Weight on other interface nodes that ends the substitution.
const REMAINDER: Real = 1e-12;
/// Passes of substitution at most; what is then left is shared out in proportion.
const PASSES: usize = 60;

fn substituted_row(levels: &Levels, active: &[bool], master: &[bool], node: usize) -> Row {
    let mut row: Row = Vec::new();
    let mut open: Row = vec![(node, 1.0)];
    for _ in 0..PASSES {
        let mut next: Row = Vec::new();
        for (n, weight) in open {
            for (m, w) in direct_row(levels, active, master, n) {
                if master[m] { row.push((m, weight * w)) } else { next.push((m, weight * w)) }
            }
        }
        open = summed(next);
        if open.iter().map(|(_, w)| w.abs()).sum::<Real>() < REMAINDER {
            break;
        }
    }
    let mut row = summed(row);
    row.retain(|(_, w)| w.abs() > REMAINDER);
    let sum: Real = row.iter().map(|(_, w)| w).sum();
    row.iter_mut().for_each(|(_, w)| *w /= sum);
    row
}

/// Entries of the same node added up, ascending by node.
fn summed(mut row: Row) -> Row {
    row.sort_by_key(|entry| entry.0);
    row.chunk_by(|a, b| a.0 == b.0).map(|same| (same[0].0, same.iter().map(|e| e.1).sum())).collect()
}

/// Masters that a least-squares row starts with, and how many it may take when these lie nearly in a plane.
const NEIGHBOURS: [usize; 2] = [8, 24];
/// Softening of the weight function, in distances to the nearest master: keeps a row smooth as a node passes a master.
const SOFTENING: Real = 1.0;
/// Smallest over largest eigenvalue of the scaled moment matrix: below it the neighbours lie nearly in a plane, and
/// the row would extrapolate wildly. At 0.1 the rows are twice as long and nothing measured gets better.
const LEAST_SPREAD: Real = 0.02;

/// `P_j = θ_j (1, d_j)ᵀ A⁻¹ (1, 0)` with `d_j = u_j − u_I`, `A = Σ θ_j (1, d_j)(1, d_j)ᵀ`, `θ_j = 1/(d_j² + ε²)²`.
fn least_squares_row(levels: &Levels, masters: &[usize], node: usize) -> Row {
    let u = levels.rest[node];
    let mut near: Vec<(Real, usize)> = masters.iter().map(|j| ((levels.rest[*j] - u).norm_squared(), *j)).collect();
    let most = NEIGHBOURS[1].min(near.len());
    if most < near.len() {
        near.select_nth_unstable_by(most, |a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        near.truncate(most);
    }
    near.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
    let softening = SOFTENING * SOFTENING * near[0].0.max(1e-6 * near[most - 1].0);
    // Lengths in units of a typical distance make the moments comparable.
    let unit = near[NEIGHBOURS[0].min(most) - 1].0.sqrt();
    let basis = |j: usize| {
        let d: Vec3 = (levels.rest[j] - u) / unit;
        Vector4::new(1.0, d.x, d.y, d.z)
    };
    let theta = |d2: Real| {
        let soft = (d2 + softening) / (unit * unit);
        1.0 / (soft * soft)
    };
    let mut count = NEIGHBOURS[0].min(most);
    loop {
        let mut moments = Matrix4::zeros();
        // The spread is judged without θ: a very near master must not make the rest look flat.
        let mut spread = Matrix4::zeros();
        for (d2, j) in &near[..count] {
            let b = basis(*j);
            moments += b * b.transpose() * theta(*d2);
            spread += b * b.transpose();
        }
        let eigenvalues = spread.symmetric_eigenvalues();
        if count < most && eigenvalues.min() < LEAST_SPREAD * eigenvalues.max() {
            count += 1;
            continue;
        }
        let inverse = moments.try_inverse().unwrap_or_else(Matrix4::zeros);
        let row = near[..count].iter().map(|(d2, j)| (*j, theta(*d2) * basis(*j).dot(&inverse.column(0)))).collect();
        return summed(row);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use palpate_core::model::Material;

    #[test]
    fn rows_reproduce_affine_fields() {
        let material = Material::from_young(2e5, 0.33, 1000.0);
        let levels = Levels::of_box(Vec3::repeat(1.0), &[[2; 3], [3; 3], [5; 3]], material, true);
        for seed in 0..6 {
            let active = levels.random_active_set(seed);
            let inactive: Vec<usize> = (0..active.len()).filter(|n| !active[*n] && !levels.fixed[*n]).collect();
            for kind in [RowKind::Hosts, RowKind::MovingLeastSquares] {
                for (node, row) in inactive.iter().zip(rows(kind, &levels, &active, &inactive)) {
                    let back: Vec3 = row.iter().map(|(j, w)| levels.rest[*j] * *w).sum();
                    assert!((back - levels.rest[*node]).norm() < 1e-9, "{kind:?} {seed} {node}");
                    assert!((row.iter().map(|(_, w)| w).sum::<Real>() - 1.0).abs() < 1e-10);
                    assert!(row.iter().all(|(j, _)| active[*j] || levels.fixed[*j]));
                }
            }
        }
    }
}
