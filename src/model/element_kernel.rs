//! Elastic and viscous forces of four elements at a time.
//!
//! One source over a four-lane number, in two forms: plain arrays for any CPU, and AVX2 registers, picked once at run
//! time. Both do the same additions and multiplications on each element in the same order, and neither fuses them: a
//! fused multiply-add rounds once where two operations round twice, so its result would depend on the CPU. Hence both
//! give the same bits (tested), and a recording replays on any x86-64 machine.

use super::lanes::{LANES, Lanes, Plain};
use super::material::{COLLAPSE_ONSET, COLLAPSE_STIFFNESS, Material};
use crate::hierarchy::Level;
use crate::math::{Real, Vec3};

/// A force on a node [N], padded to a whole register: the fourth number is always zero.
pub type PaddedForce = [Real; 4];

/// The elements of a level in blocks of four, in mesh order.
#[derive(Clone, Debug)]
pub struct Elements {
    blocks: Vec<Block>,
    n_nodes: usize,
}

/// What the kernel reads of four elements. The constants carry fraction·volume, so that forces come out in newtons.
#[derive(Clone, Copy, Debug)]
#[repr(align(32))]
struct Block {
    /// Node numbers: vertex, then lane. A block that is not full repeats its last element with zero constants.
    node: [[u32; LANES]; 4],
    /// ∇L_1, ∇L_2, ∇L_3 at rest [1/m]: vertex, then component; ∇L_0 is minus their sum.
    gradient: [[[Real; LANES]; 3]; 3],
    /// λ·w·vol [N·m].
    lambda: [Real; LANES],
    /// μ·w·vol [N·m].
    mu: [Real; LANES],
    /// φ·w·vol [N·m·s].
    phi: [Real; LANES],
    /// ψ·w·vol [N·m·s].
    psi: [Real; LANES],
    /// k·w·vol of the compression term [N·m].
    collapse: [Real; LANES],
}

impl Elements {
    /// The elements of `level`, element `e` of material `material(e)`.
    ///
    /// # Panics
    /// When an element names a node that the level does not have.
    pub fn new(level: &Level, material: impl Fn(usize) -> Material) -> Self {
        let n_nodes = level.mesh.nodes.len();
        // What lets the kernel go without bounds checks.
        assert!(level.mesh.elements.iter().flatten().all(|n| (*n as usize) < n_nodes), "an element names a lost node");
        Self { blocks: blocks(level, material), n_nodes }
    }
}

fn blocks(level: &Level, material: impl Fn(usize) -> Material) -> Vec<Block> {
    let count = level.mesh.elements.len();
    (0..count.div_ceil(LANES))
        .map(|b| {
            let mut block = Block {
                node: [[0; LANES]; 4],
                gradient: [[[0.0; LANES]; 3]; 3],
                lambda: [0.0; LANES],
                mu: [0.0; LANES],
                phi: [0.0; LANES],
                psi: [0.0; LANES],
                collapse: [0.0; LANES],
            };
            for l in 0..LANES {
                let e = (b * LANES + l).min(count - 1);
                let u = level.mesh.corners(e);
                let (d1, d2, d3) = (u[1] - u[0], u[2] - u[0], u[3] - u[0]);
                let six_volume = d1.cross(&d2).dot(&d3);
                let gradients = [d2.cross(&d3), d3.cross(&d1), d1.cross(&d2)].map(|g| g / six_volume);
                for i in 0..4 {
                    block.node[i][l] = level.mesh.elements[e][i];
                }
                #[expect(clippy::needless_range_loop, reason = "three arrays under the same indices")]
                for i in 0..3 {
                    for c in 0..3 {
                        block.gradient[i][c][l] = gradients[i][c];
                    }
                }
                let filler = b * LANES + l >= count;
                let weight = if filler { 0.0 } else { level.fraction[e] * six_volume / 6.0 };
                let m = material(e);
                block.lambda[l] = weight * m.lambda;
                block.mu[l] = weight * m.mu;
                block.phi[l] = weight * m.phi;
                block.psi[l] = weight * m.psi;
                block.collapse[l] = weight * COLLAPSE_STIFFNESS * m.pressure_modulus();
            }
            block
        })
        .collect()
}

/// How far the elements are from rest: what bounds the next step.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Extremes {
    /// Largest `E:E` of any element.
    pub strain_squared: Real,
    /// Smallest `det F` of any element.
    pub det_f: Real,
    /// Largest `|cof F|²` of an element whose compression term acts, else 0.
    pub collapse_cofactor_squared: Real,
}

impl Extremes {
    /// Bound on the present squared stretch over the one at rest: what viscosity grows by.
    pub fn stretching(&self) -> Real {
        1.0 + 2.0 * self.strain_squared.sqrt()
    }

    /// A body at rest.
    pub const REST: Extremes = Extremes { strain_squared: 0.0, det_f: 1.0, collapse_cofactor_squared: 0.0 };

    /// Bound on the present pressure modulus over the one at rest.
    ///
    /// Along a stretch `s` the tangent of St. Venant–Kirchhoff is `(λ+2μ)(3s²−1)/2 ≤ (λ+2μ)(1 + 3|E|)`; the
    /// compression term adds at most `k |cof F|²`.
    pub fn stiffening(&self) -> Real {
        1.0 + 3.0 * self.strain_squared.sqrt() + COLLAPSE_STIFFNESS * self.collapse_cofactor_squared
    }
}

/// Which form of the kernel runs. Both give the same bits.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Path {
    /// Plain arrays: any CPU.
    Portable,
    /// AVX2 registers.
    Avx2,
}

impl Path {
    /// Every path that this CPU can run, the fastest last.
    pub fn available() -> Vec<Path> {
        let mut paths = vec![Path::Portable];
        #[cfg(target_arch = "x86_64")]
        if is_x86_feature_detected!("avx2") {
            paths.push(Path::Avx2);
        }
        paths
    }

    /// The fastest available.
    pub fn best() -> Path {
        Path::available().pop().unwrap_or(Path::Portable)
    }
}

/// Adds the internal forces of every element to `force` [N].
///
/// `position` [m], `velocity` [m/s], `force`: (n_nodes). `path` must be one of [`Path::available`].
pub fn add_forces(
    path: Path,
    elements: &Elements,
    position: &[Vec3],
    velocity: &[Vec3],
    force: &mut [PaddedForce],
) -> Extremes {
    let n = elements.n_nodes;
    if position.len() != n || velocity.len() != n || force.len() != n {
        debug_assert!(false, "fields of another level");
        return Extremes::REST;
    }
    match path {
        #[cfg(target_arch = "x86_64")]
        // SAFETY: `Path::available` offers this path only where the CPU has AVX2; every field has `n_nodes` entries
        // and `Elements::new` let no element name a node beyond them.
        Path::Avx2 => unsafe { add_forces_avx2(&elements.blocks, position, velocity, force) },
        // SAFETY: as above.
        _ => unsafe { add_forces_here::<Plain>(&elements.blocks, position, velocity, force) },
    }
}

/// # Safety
/// The CPU must have AVX2; node numbers must lie within the fields.
#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2")]
unsafe fn add_forces_avx2(blocks: &[Block], x: &[Vec3], v: &[Vec3], f: &mut [PaddedForce]) -> Extremes {
    // SAFETY: passed on.
    unsafe { add_forces_here::<super::lanes::Avx2>(blocks, x, v, f) }
}

/// # Safety
/// `L` must run on this CPU; node numbers must lie within the fields.
#[inline(always)]
unsafe fn add_forces_here<L: Lanes>(
    blocks: &[Block],
    position: &[Vec3],
    velocity: &[Vec3],
    force: &mut [PaddedForce],
) -> Extremes {
    let zero = L::splat(0.0);
    let half = L::splat(0.5);
    let onset = L::splat(COLLAPSE_ONSET);
    let mut strain_squared = zero;
    let mut least_det = L::splat(1.0);
    let mut cofactor_squared = zero;
    for block in blocks {
        // SAFETY: the caller's promise.
        let (x, v) = unsafe { (edges::<L>(&block.node, position), edges::<L>(&block.node, velocity)) };
        let g = [load3(&block.gradient[0]), load3(&block.gradient[1]), load3(&block.gradient[2])];
        // F = Σ (x_i − x_0) ⊗ ∇L_i and its rate, i = 1..3.
        let f = outer_sum(&x, &g);
        let rate = outer_sum(&v, &g);

        // E = ½(FᵀF − I), its components xx, yy, zz, yz, xz, xy.
        let e = [
            half.mul(column_dot(&f, &f, 0, 0)).sub(half),
            half.mul(column_dot(&f, &f, 1, 1)).sub(half),
            half.mul(column_dot(&f, &f, 2, 2)).sub(half),
            half.mul(column_dot(&f, &f, 1, 2)),
            half.mul(column_dot(&f, &f, 0, 2)),
            half.mul(column_dot(&f, &f, 0, 1)),
        ];
        // Ė = sym(Fᵀ Ḟ).
        let e_rate = [
            column_dot(&f, &rate, 0, 0),
            column_dot(&f, &rate, 1, 1),
            column_dot(&f, &rate, 2, 2),
            half.mul(column_dot(&f, &rate, 1, 2).add(column_dot(&f, &rate, 2, 1))),
            half.mul(column_dot(&f, &rate, 0, 2).add(column_dot(&f, &rate, 2, 0))),
            half.mul(column_dot(&f, &rate, 0, 1).add(column_dot(&f, &rate, 1, 0))),
        ];
        // S = λ tr(E) I + 2μ E + φ tr(Ė) I + 2ψ Ė, times the element's weight.
        let (mu, psi) = (L::load(&block.mu), L::load(&block.psi));
        let (two_mu, two_psi) = (mu.add(mu), psi.add(psi));
        let volumetric = L::load(&block.lambda)
            .mul(e[0].add(e[1]).add(e[2]))
            .add(L::load(&block.phi).mul(e_rate[0].add(e_rate[1]).add(e_rate[2])));
        let s = [
            two_mu.mul(e[0]).add(two_psi.mul(e_rate[0])).add(volumetric),
            two_mu.mul(e[1]).add(two_psi.mul(e_rate[1])).add(volumetric),
            two_mu.mul(e[2]).add(two_psi.mul(e_rate[2])).add(volumetric),
            two_mu.mul(e[3]).add(two_psi.mul(e_rate[3])),
            two_mu.mul(e[4]).add(two_psi.mul(e_rate[4])),
            two_mu.mul(e[5]).add(two_psi.mul(e_rate[5])),
        ];
        // P = F S.
        let mut p = [row_times(&f[0], &s), row_times(&f[1], &s), row_times(&f[2], &s)];

        // Rows of cof F are cross products of rows of F.
        let cofactor_0 = cross(&f[1], &f[2]);
        let det = f[0][0].mul(cofactor_0[0]).add(f[0][1].mul(cofactor_0[1])).add(f[0][2].mul(cofactor_0[2]));
        if det.any_less(onset) {
            // P += k (J − 0.6) cof F where J < 0.6.
            let squeeze = L::load(&block.collapse).mul(det.sub(onset).min(zero));
            let cofactor = [cofactor_0, cross(&f[2], &f[0]), cross(&f[0], &f[1])];
            let mut norm = zero;
            for r in 0..3 {
                for c in 0..3 {
                    p[r][c] = p[r][c].add(squeeze.mul(cofactor[r][c]));
                    norm = norm.add(cofactor[r][c].mul(cofactor[r][c]));
                }
            }
            cofactor_squared = cofactor_squared.max(norm.where_less(det, onset));
        }

        let diagonal = e[0].mul(e[0]).add(e[1].mul(e[1])).add(e[2].mul(e[2]));
        let shear = e[3].mul(e[3]).add(e[4].mul(e[4])).add(e[5].mul(e[5]));
        strain_squared = diagonal.add(shear).add(shear).max(strain_squared);
        least_det = det.min(least_det);

        // f_i = −P ∇L_i; the fourth is minus their sum, so that no force is left over.
        let (f1, f2, f3) = (minus_times(&p, &g[0]), minus_times(&p, &g[1]), minus_times(&p, &g[2]));
        let f0 = [
            zero.sub(f1[0].add(f2[0]).add(f3[0])),
            zero.sub(f1[1].add(f2[1]).add(f3[1])),
            zero.sub(f1[2].add(f2[2]).add(f3[2])),
        ];
        // SAFETY: the caller's promise.
        unsafe {
            L::scatter_add(force, &block.node[0], &f0);
            L::scatter_add(force, &block.node[1], &f1);
            L::scatter_add(force, &block.node[2], &f2);
            L::scatter_add(force, &block.node[3], &f3);
        }
    }
    Extremes {
        strain_squared: strain_squared.to_array().into_iter().fold(0.0, Real::max),
        det_f: least_det.to_array().into_iter().fold(Real::INFINITY, Real::min),
        collapse_cofactor_squared: cofactor_squared.to_array().into_iter().fold(0.0, Real::max),
    }
}

// The compiler makes a closure a function of its own, which lacks the kernel's register width: only functions that
// are always inlined may stand between the kernel and its lanes.

/// Vertices 1..3 relative to vertex 0: vertex, then component.
///
/// # Safety
/// `L` must run on this CPU; node numbers must lie within `field`.
#[inline(always)]
unsafe fn edges<L: Lanes>(node: &[[u32; LANES]; 4], field: &[Vec3]) -> [[L; 3]; 3] {
    // SAFETY: passed on.
    unsafe {
        let origin = L::gather(field, &node[0]);
        [
            difference(L::gather(field, &node[1]), origin),
            difference(L::gather(field, &node[2]), origin),
            difference(L::gather(field, &node[3]), origin),
        ]
    }
}

#[inline(always)]
fn difference<L: Lanes>(a: [L; 3], b: [L; 3]) -> [L; 3] {
    [a[0].sub(b[0]), a[1].sub(b[1]), a[2].sub(b[2])]
}

#[inline(always)]
fn load3<L: Lanes>(x: &[[Real; LANES]; 3]) -> [L; 3] {
    [L::load(&x[0]), L::load(&x[1]), L::load(&x[2])]
}

/// `Σ_i a_i ⊗ g_i`: row, then column.
#[inline(always)]
fn outer_sum<L: Lanes>(a: &[[L; 3]; 3], g: &[[L; 3]; 3]) -> [[L; 3]; 3] {
    let mut sum = [[a[0][0]; 3]; 3];
    for r in 0..3 {
        for c in 0..3 {
            sum[r][c] = a[0][r].mul(g[0][c]).add(a[1][r].mul(g[1][c])).add(a[2][r].mul(g[2][c]));
        }
    }
    sum
}

/// Column `i` of `a` times column `j` of `b`.
#[inline(always)]
fn column_dot<L: Lanes>(a: &[[L; 3]; 3], b: &[[L; 3]; 3], i: usize, j: usize) -> L {
    a[0][i].mul(b[0][j]).add(a[1][i].mul(b[1][j])).add(a[2][i].mul(b[2][j]))
}

/// A row of `F` times the symmetric `S`.
#[inline(always)]
fn row_times<L: Lanes>(f: &[L; 3], s: &[L; 6]) -> [L; 3] {
    [
        f[0].mul(s[0]).add(f[1].mul(s[5])).add(f[2].mul(s[4])),
        f[0].mul(s[5]).add(f[1].mul(s[1])).add(f[2].mul(s[3])),
        f[0].mul(s[4]).add(f[1].mul(s[3])).add(f[2].mul(s[2])),
    ]
}

/// `−P g`.
#[inline(always)]
fn minus_times<L: Lanes>(p: &[[L; 3]; 3], g: &[L; 3]) -> [L; 3] {
    let zero = L::splat(0.0);
    [
        zero.sub(p[0][0].mul(g[0]).add(p[0][1].mul(g[1])).add(p[0][2].mul(g[2]))),
        zero.sub(p[1][0].mul(g[0]).add(p[1][1].mul(g[1])).add(p[1][2].mul(g[2]))),
        zero.sub(p[2][0].mul(g[0]).add(p[2][1].mul(g[1])).add(p[2][2].mul(g[2]))),
    ]
}

#[inline(always)]
fn cross<L: Lanes>(a: &[L; 3], b: &[L; 3]) -> [L; 3] {
    [a[1].mul(b[2]).sub(a[2].mul(b[1])), a[2].mul(b[0]).sub(a[0].mul(b[2])), a[0].mul(b[1]).sub(a[1].mul(b[0]))]
}
