//! Elastic, viscous and relaxing forces of a group of elements at a time.
//!
//! One source over a group of lanes, in three forms: plain arrays for any CPU, AVX2 and AVX-512 registers, picked once
//! at run time. All do the same additions and multiplications on each element in the same order, and none fuses them:
//! a fused multiply-add rounds once where two operations round twice, so its result would depend on the CPU. Forces
//! are added to the nodes element by element, whatever the width of the group. Hence all give the same bits (tested),
//! and a recording replays on any x86-64 machine.
//!
//! With `F` the deformation gradient, `E = ½(FᵀF − I)` and `ΔE` its change since the last evaluation, the stress is
//! `S = λ tr(E) I + 2μ E + c_v λ tr(ΔE) I + 2 c_s μ ΔE + Σ_b 2μ r g_b dev(D_b)` with the element's own factor `r` on all
//! branches and the memory of branch `b` `D_b ← (D_b + ΔE)·decay_b`, and the force on vertex `i` is `−P ∇L_i` with
//! `P = F S`, plus `k (J − 0.6) cof F` where `J = det F < 0.6`. Viscosity acts on `ΔE`, so no velocity is read.

pub use super::lanes::Padded;
use super::lanes::{LANES, Lanes, Plain, Row};
use super::material::{COLLAPSE_ONSET, COLLAPSE_STIFFNESS};
use crate::math::Real;
use serde::{Deserialize, Serialize};
use std::ops::Range;

/// Most Maxwell branches of an element.
pub const MAX_BRANCHES: usize = 2;

/// Memories are rounded to multiples of 2⁻¹¹⁸ by adding and taking away this number. Else, where nothing moves, they
/// would fade into subnormal numbers, which some CPUs handle a hundred times slower.
const FADE: Real = 1.0 / ((1u128 << 66) as Real);

/// What the kernel reads and writes of [`LANES`] elements. Constants carry fraction·volume, so that forces come out in
/// newtons.
#[derive(Clone, Copy, Debug)]
#[repr(C, align(64))]
pub(super) struct Block {
    /// Node numbers: vertex, then element.
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

/// Strain up to which an element may keep its step: `|dev 2E| ≤ deviator − slope · tr 2E`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct StrainLimit {
    /// No unit.
    pub deviator: Real,
    /// No unit.
    pub slope: Real,
}

impl StrainLimit {
    /// Whatever the strain.
    pub const NONE: Self = Self { deviator: Real::INFINITY, slope: 0.0 };
}

/// What one Maxwell branch of [`LANES`] elements remembers: `2D`, components as in [`Block::strain`].
#[derive(Clone, Copy, Debug)]
#[repr(C, align(64))]
pub(super) struct Memory(pub [Row; 6]);

/// What one evaluation needs beside the elements themselves; the same for all elements of a class.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Rates {
    /// `c_v = φ/(λh)`: viscosity against volume change over `λ` and the step.
    pub volume: Real,
    /// `c_s = ψ/(μh)`: shear viscosity over `μ` and the step.
    pub shear: Real,
    /// `1/(1 + h/T)` of each branch: what is left of its memory after the step.
    pub decay: [Real; MAX_BRANCHES],
    /// `g` of each branch: its shear modulus over `μ`.
    pub share: [Real; MAX_BRANCHES],
}

impl Rates {
    /// Elastic forces alone (for elements without branches).
    pub const ELASTIC: Rates =
        Rates { volume: 0.0, shear: 0.0, decay: [0.0; MAX_BRANCHES], share: [0.0; MAX_BRANCHES] };
}

/// How far the elements are from rest: what bounds the next step.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Extremes {
    /// Largest `E:E` of any element.
    pub strain_squared: Real,
    /// Smallest `det F` of any element, at most 1.
    pub det_f: Real,
}

impl Extremes {
    /// A body at rest.
    pub const REST: Extremes = Extremes { strain_squared: 0.0, det_f: 1.0 };

    /// The farther from rest of both, measure by measure.
    pub fn join(&self, other: &Extremes) -> Extremes {
        Extremes { strain_squared: self.strain_squared.max(other.strain_squared), det_f: self.det_f.min(other.det_f) }
    }
}

/// Which form of the kernel runs. All give the same bits.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Path {
    /// Plain arrays: any CPU.
    Portable,
    /// AVX2 registers.
    Avx2,
    /// AVX-512 registers.
    Avx512,
}

impl Path {
    /// Every form, the fastest last.
    pub const ALL: [Path; 3] = [Path::Portable, Path::Avx2, Path::Avx512];

    /// The name that it is chosen by.
    pub const fn name(self) -> &'static str {
        match self {
            Path::Portable => "portable",
            Path::Avx2 => "avx2",
            Path::Avx512 => "avx512",
        }
    }

    /// True when this CPU can run it. Cheap: the standard library asks the CPU once.
    pub fn is_available(self) -> bool {
        match self {
            Path::Portable => true,
            #[cfg(target_arch = "x86_64")]
            Path::Avx2 => is_x86_feature_detected!("avx2"),
            #[cfg(target_arch = "x86_64")]
            Path::Avx512 => is_x86_feature_detected!("avx2") && is_x86_feature_detected!("avx512f"),
            #[cfg(not(target_arch = "x86_64"))]
            _ => false,
        }
    }

    /// Every path that this CPU can run, the fastest last.
    pub fn available() -> Vec<Path> {
        Path::ALL.into_iter().filter(|path| path.is_available()).collect()
    }

    /// The fastest available.
    pub fn best() -> Path {
        Path::available().pop().unwrap_or(Path::Portable)
    }
}

/// The elements to evaluate.
pub(super) struct Batch<'a> {
    /// All blocks of the pool.
    pub blocks: &'a mut [Block],
    /// All memories of the pool, those of a block side by side.
    pub memories: &'a mut [Memory],
    /// Blocks to evaluate, in order.
    pub order: &'a [u32],
    /// Elements to evaluate: all blocks are full, but for the last.
    pub count: usize,
    /// Maxwell branches of each element, at most [`MAX_BRANCHES`].
    pub branches: usize,
    /// Receives the blocks with an element that is strained beyond its limit or crushed; has room for all.
    pub alarmed: &'a mut Vec<u32>,
}

/// Adds the forces of the elements of `batch` to `force` [N] and stores what they remember. `position` [m].
///
/// # Safety
/// `path` must be available; every node number of `batch` must lie within `position` and `force`.
pub(super) unsafe fn add_forces(
    path: Path,
    batch: Batch<'_>,
    rates: &Rates,
    position: &[Padded],
    force: &mut [Padded],
) -> Extremes {
    // SAFETY: the caller's promise.
    unsafe {
        match path {
            #[cfg(target_arch = "x86_64")]
            Path::Avx512 => add_forces_avx512(batch, rates, position, force),
            #[cfg(target_arch = "x86_64")]
            Path::Avx2 => add_forces_avx2(batch, rates, position, force),
            _ => add_forces_with::<Plain>(batch, rates, position, force),
        }
    }
}

/// # Safety
/// The CPU must have AVX-512F; node numbers must lie within the fields.
#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2,avx512f")]
unsafe fn add_forces_avx512(batch: Batch<'_>, rates: &Rates, x: &[Padded], f: &mut [Padded]) -> Extremes {
    // SAFETY: passed on.
    unsafe { add_forces_with::<super::lanes::Avx512>(batch, rates, x, f) }
}

/// # Safety
/// The CPU must have AVX2; node numbers must lie within the fields.
#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2")]
unsafe fn add_forces_avx2(batch: Batch<'_>, rates: &Rates, x: &[Padded], f: &mut [Padded]) -> Extremes {
    // SAFETY: passed on.
    unsafe { add_forces_with::<super::lanes::Avx2>(batch, rates, x, f) }
}

/// # Safety
/// `L` must run on this CPU; node numbers must lie within the fields.
#[inline(always)]
unsafe fn add_forces_with<L: Lanes>(batch: Batch<'_>, rates: &Rates, x: &[Padded], f: &mut [Padded]) -> Extremes {
    // SAFETY: passed on.
    unsafe {
        match batch.branches {
            0 => add_forces_here::<L, 0>(batch, rates, x, f),
            1 => add_forces_here::<L, 1>(batch, rates, x, f),
            _ => add_forces_here::<L, 2>(batch, rates, x, f),
        }
    }
}

/// # Safety
/// `L` must run on this CPU; node numbers must lie within the fields.
#[inline(always)]
unsafe fn add_forces_here<L: Lanes, const B: usize>(
    batch: Batch<'_>,
    rates: &Rates,
    position: &[Padded],
    force: &mut [Padded],
) -> Extremes {
    let zero = L::splat(0.0);
    let half = L::splat(0.5);
    let third = L::splat(1.0 / 3.0);
    let one = L::splat(1.0);
    let fade = L::splat(FADE);
    let onset = L::splat(COLLAPSE_ONSET);
    let stiffness = L::splat(COLLAPSE_STIFFNESS);
    let (volume, shear) = (L::splat(rates.volume), L::splat(rates.shear));
    let mut decay = [zero; B];
    let mut share = [zero; B];
    for b in 0..B {
        decay[b] = L::splat(rates.decay[b]);
        share[b] = L::splat(rates.share[b]);
    }
    let mut strain_squared = zero;
    let mut least_det = one;
    for (i, index) in batch.order.iter().enumerate() {
        let index = *index as usize;
        let block = &mut batch.blocks[index];
        let memory = &mut batch.memories[index * B..(index + 1) * B];
        let used = batch.count - i * LANES;
        let mut at = 0;
        let mut alarm = false;
        while at < LANES && at < used {
            // SAFETY: the caller's promise, and `at` is a multiple of the width below the number of lanes.
            unsafe {
                // F = Σ (x_i − x_0) ⊗ ∇L_i, i = 1..3.
                let f = deformation(&L::edges(position, &block.node, at), &block.gradient, at);

                // 2E = FᵀF − I, its components xx, yy, zz, yz, xz, xy.
                let e = [
                    column_dot(&f, 0, 0).sub(one),
                    column_dot(&f, 1, 1).sub(one),
                    column_dot(&f, 2, 2).sub(one),
                    column_dot(&f, 1, 2),
                    column_dot(&f, 0, 2),
                    column_dot(&f, 0, 1),
                ];
                let mut change = e;
                // S over μ without what is a multiple of I.
                let mut s = e;
                for c in 0..6 {
                    change[c] = e[c].sub(L::load(&block.strain[c], at));
                    e[c].store(&mut block.strain[c], at);
                    s[c] = e[c].add(shear.mul(change[c]));
                }
                let trace = e[0].add(e[1]).add(e[2]);
                let trace_change = change[0].add(change[1]).add(change[2]);
                let lambda = L::load(&block.lambda, at);
                let mu = L::load(&block.mu, at);
                let mut pressure = half.mul(lambda).mul(trace.add(volume.mul(trace_change)));
                let branch = if B > 0 { L::load(&block.branch, at) } else { one };
                for b in 0..B {
                    let share = branch.mul(share[b]);
                    let mut d = e;
                    for c in 0..6 {
                        let row = &mut memory[b].0[c];
                        d[c] = L::load(row, at).add(change[c]).mul(decay[b]).add(fade).sub(fade);
                        d[c].store(row, at);
                        s[c] = s[c].add(share.mul(d[c]));
                    }
                    pressure = pressure.sub(mu.mul(share.mul(third.mul(d[0].add(d[1]).add(d[2])))));
                }
                for s in &mut s {
                    *s = mu.mul(*s);
                }
                for s in &mut s[..3] {
                    *s = s.add(pressure);
                }

                // Rows of cof F are cross products of rows of F.
                let cofactor_0 = cross(&f[1], &f[2]);
                let mut det = dot(&f[0], &cofactor_0);
                let diagonal = e[0].mul(e[0]).add(e[1].mul(e[1])).add(e[2].mul(e[2]));
                let shears = e[3].mul(e[3]).add(e[4].mul(e[4])).add(e[5].mul(e[5]));
                let mut squares = diagonal.add(shears).add(shears);
                if used - at < L::WIDTH {
                    // Lanes without an element are at rest.
                    let lane = L::load(&LANE, 0);
                    let used = L::splat((used - at) as Real);
                    squares = squares.where_less(lane, used);
                    det = det.where_less(lane, used).add(one.sub(one.where_less(lane, used)));
                }
                det.store(&mut block.det, at);
                // |dev 2E|² against the square of its limit; where that is below zero every deviator is beyond it.
                let limit = L::load(&block.limit, at).sub(L::load(&block.slope, at).mul(trace)).max(zero);
                alarm |= limit.mul(limit).any_less(squares.sub(third.mul(trace.mul(trace))));
                strain_squared = squares.max(strain_squared);
                least_det = det.min(least_det);

                // P = F S.
                let mut p = [row_times(&f[0], &s), row_times(&f[1], &s), row_times(&f[2], &s)];
                if det.any_less(onset) {
                    alarm = true;
                    // P += k (J − 0.6) cof F where J < 0.6.
                    let k = stiffness.mul(lambda.add(mu.add(mu)));
                    let squeeze = k.mul(det.sub(onset).min(zero));
                    let cofactor = [cofactor_0, cross(&f[2], &f[0]), cross(&f[0], &f[1])];
                    for r in 0..3 {
                        for c in 0..3 {
                            p[r][c] = p[r][c].add(squeeze.mul(cofactor[r][c]));
                        }
                    }
                }

                // f_i = −P ∇L_i; the fourth is minus their sum, so that no force is left over.
                let mut q = [[zero; 3]; 3];
                for (q, gradient) in q.iter_mut().zip(&block.gradient) {
                    let g = load3(gradient, at);
                    *q = [dot(&p[0], &g), dot(&p[1], &g), dot(&p[2], &g)];
                }
                if used - at < L::WIDTH {
                    let mut rows = [[[0.0; LANES]; 3]; 3];
                    for i in 0..3 {
                        for c in 0..3 {
                            q[i][c].store(&mut rows[i][c], at);
                        }
                    }
                    scatter_some(force, &block.node, at..used, &rows);
                } else {
                    L::scatter(force, &block.node, at, &q);
                }
            }
            at += L::WIDTH;
        }
        if alarm {
            batch.alarmed.push(index as u32);
        }
    }
    Extremes {
        // The strains above are doubled.
        strain_squared: 0.25 * lanes(strain_squared).into_iter().fold(0.0, Real::max),
        det_f: lanes(least_det).into_iter().fold(1.0, Real::min),
    }
}

/// What [`Lanes::scatter`] does, for some elements of a block: lanes without an element must leave even the sign of a
/// zero alone, since there are more of them in a wider group.
#[inline(never)]
fn scatter_some(force: &mut [Padded], node: &[[u32; LANES]; 4], elements: Range<usize>, q: &[[Row; 3]; 3]) {
    for e in elements {
        for c in 0..3 {
            force[node[0][e] as usize][c] += (q[0][c][e] + q[1][c][e]) + q[2][c][e];
            for i in 0..3 {
                force[node[i + 1][e] as usize][c] -= q[i][c][e];
            }
        }
    }
}

/// The number of each lane.
const LANE: Row = [0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0];

/// The lanes as numbers, in the first places; the rest repeats the first.
#[inline(always)]
fn lanes<L: Lanes>(x: L) -> Row {
    let mut row = [0.0; LANES];
    let mut at = 0;
    while at < LANES {
        // SAFETY: the width divides the number of lanes.
        unsafe { x.store(&mut row, at) };
        at += L::WIDTH;
    }
    row
}

// The compiler makes a closure a function of its own, which lacks the kernel's register width: only functions that
// are always inlined may stand between the kernel and its lanes.

/// # Safety
/// See [`Lanes::load`].
#[inline(always)]
unsafe fn load3<L: Lanes>(x: &[Row; 3], at: usize) -> [L; 3] {
    // SAFETY: passed on.
    unsafe { [L::load(&x[0], at), L::load(&x[1], at), L::load(&x[2], at)] }
}

/// `Σ_i x_i ⊗ ∇L_i`: row, then column.
///
/// # Safety
/// See [`Lanes::load`].
#[inline(always)]
unsafe fn deformation<L: Lanes>(x: &[[L; 3]; 3], gradient: &[[Row; 3]; 3], at: usize) -> [[L; 3]; 3] {
    // SAFETY: passed on.
    let g: [[L; 3]; 3] = unsafe { [load3(&gradient[0], at), load3(&gradient[1], at), load3(&gradient[2], at)] };
    let mut sum = *x;
    for r in 0..3 {
        for c in 0..3 {
            sum[r][c] = x[0][r].mul(g[0][c]).add(x[1][r].mul(g[1][c])).add(x[2][r].mul(g[2][c]));
        }
    }
    sum
}

#[inline(always)]
fn dot<L: Lanes>(a: &[L; 3], b: &[L; 3]) -> L {
    a[0].mul(b[0]).add(a[1].mul(b[1])).add(a[2].mul(b[2]))
}

/// Column `i` times column `j`.
#[inline(always)]
fn column_dot<L: Lanes>(a: &[[L; 3]; 3], i: usize, j: usize) -> L {
    a[0][i].mul(a[0][j]).add(a[1][i].mul(a[1][j])).add(a[2][i].mul(a[2][j]))
}

/// A row of `F` times the symmetric `S`.
#[inline(always)]
fn row_times<L: Lanes>(f: &[L; 3], s: &[L; 6]) -> [L; 3] {
    [dot(f, &[s[0], s[5], s[4]]), dot(f, &[s[5], s[1], s[3]]), dot(f, &[s[4], s[3], s[2]])]
}

#[inline(always)]
fn cross<L: Lanes>(a: &[L; 3], b: &[L; 3]) -> [L; 3] {
    [a[1].mul(b[2]).sub(a[2].mul(b[1])), a[2].mul(b[0]).sub(a[0].mul(b[2])), a[0].mul(b[1]).sub(a[1].mul(b[0]))]
}

#[cfg(test)]
mod tests {
    use super::super::element_pool::{ElementConstants, ElementPool, History};
    use super::super::material::Material;
    use super::*;
    use crate::math::{Mat3, Vec3};

    /// Numbers in ±1 that look random.
    struct Noise(u64);

    impl Noise {
        fn next(&mut self) -> Real {
            self.0 ^= self.0 << 13;
            self.0 ^= self.0 >> 7;
            self.0 ^= self.0 << 17;
            (self.0 >> 11) as Real / (1u64 << 52) as Real - 1.0
        }
        fn vector(&mut self) -> Vec3 {
            Vec3::new(self.next(), self.next(), self.next())
        }
        fn below(&mut self, n: usize) -> usize {
            ((self.next() * 0.5 + 0.5) * n as Real) as usize % n
        }
    }

    fn edges(x: &[Vec3], n: [u32; 4]) -> Mat3 {
        let at = |i: usize| x[n[i] as usize];
        Mat3::from_columns(&[at(1) - at(0), at(2) - at(0), at(3) - at(0)])
    }

    /// Elements between random nodes, each of another stiffness.
    struct Soup {
        rest: Vec<Vec3>,
        elements: Vec<([u32; 4], ElementConstants)>,
    }

    impl Soup {
        fn new(noise: &mut Noise, nodes: usize, count: usize) -> Self {
            let rest: Vec<_> = (0..nodes).map(|_| noise.vector() * 0.01).collect();
            let mut elements = vec![];
            while elements.len() < count {
                let mut n = [0; 4].map(|_: u32| noise.below(nodes) as u32);
                let volume = edges(&rest, n).determinant() / 6.0;
                if volume.abs() < 1e-8 {
                    continue;
                }
                if volume < 0.0 {
                    n.swap(2, 3);
                }
                let g = edges(&rest, n).try_inverse().expect("a volume");
                let gradient = [0, 1, 2].map(|i| [0, 1, 2].map(|c| g[(i, c)]));
                let weight = volume.abs() * (0.5 + 0.4 * noise.next());
                let (lambda, mu) = (weight * (5e4 + 3e4 * noise.next()), weight * (2e3 + 1e3 * noise.next()));
                elements.push((n, ElementConstants { gradient, lambda, mu, branch: 1.0 + 0.3 * noise.next() }));
            }
            Self { rest, elements }
        }

        fn pool(&self, branches: usize) -> ElementPool {
            let count = self.elements.len();
            let mut pool = ElementPool::new(count, count, self.rest.len(), branches);
            for (id, (nodes, constants)) in self.elements.iter().enumerate() {
                assert!(pool.insert(id as u32, 5, *nodes, constants, &History::REST));
            }
            pool
        }

        /// The nodes moved by `amount` element sizes; a quarter of the calls mirrors or crushes the whole.
        fn moved(&self, noise: &mut Noise, amount: Real) -> Vec<Vec3> {
            let shape = Mat3::from_diagonal(&match noise.below(8) {
                0 => Vec3::new(-0.8, 1.0, 1.0),
                1 => Vec3::new(0.3, 0.2, 1.1),
                _ => Vec3::repeat(1.0),
            });
            self.rest.iter().map(|x| shape * x + noise.vector() * 0.01 * amount).collect()
        }

        fn gradient_of(&self, e: usize) -> Mat3 {
            Mat3::from_fn(|i, c| self.elements[e].1.gradient[i][c])
        }

        fn deformation(&self, e: usize, x: &[Vec3]) -> Mat3 {
            edges(x, self.elements[e].0) * self.gradient_of(e)
        }

        /// Elastic energy [J].
        fn energy(&self, x: &[Vec3]) -> Real {
            let of = |e: usize| {
                let c = &self.elements[e].1;
                let material = Material { lambda: c.lambda, mu: c.mu, phi: 0.0, psi: 0.0, density: 0.0 };
                material.energy_density(&self.deformation(e, x))
            };
            (0..self.elements.len()).map(of).sum()
        }
    }

    fn padded(x: &[Vec3]) -> Vec<Padded> {
        x.iter().map(|v| [v.x, v.y, v.z, 0.0]).collect()
    }

    fn forces(pool: &mut ElementPool, path: Path, rates: &Rates, x: &[Vec3]) -> (Vec<Padded>, Extremes) {
        let mut force = vec![[0.0; 4]; x.len()];
        let extremes = pool.add_forces(path, 5, rates, &padded(x), &mut force);
        (force, extremes)
    }

    fn force(pool: &mut ElementPool, rates: &Rates, x: &[Vec3]) -> Vec<Vec3> {
        forces(pool, Path::best(), rates, x).0.iter().map(|f| Vec3::new(f[0], f[1], f[2])).collect()
    }

    const RATES: Rates = Rates { volume: 0.7, shear: 1.3, decay: [0.97, 0.6], share: [0.8, 0.4] };

    fn bits(x: &[Real]) -> Vec<u64> {
        x.iter().map(|x| x.to_bits()).collect()
    }

    fn history_bits(pool: &ElementPool, id: u32) -> Vec<u64> {
        let h = pool.history(id).expect("there");
        bits(&[&h.strain[..], &[h.det], h.branch.as_flattened()].concat())
    }

    #[test]
    fn all_forms_give_the_same_bits() {
        let mut noise = Noise(7);
        for count in (0..40).chain([200, 333]) {
            let soup = Soup::new(&mut noise, 40, count);
            for branches in 0..=MAX_BRANCHES {
                let mut pools = Path::available().into_iter().map(|p| (p, soup.pool(branches))).collect::<Vec<_>>();
                let mut crushed = false;
                for call in 0..12 {
                    let amount = [0.0, 0.02, 0.3, 2.0][call % 4];
                    let x = padded(&soup.moved(&mut noise, amount));
                    // Forces of other classes are there already, zeros of both signs among them.
                    let before: Vec<Padded> = x.iter().map(|x| [x[0], -0.0, 0.0 * x[2], 0.0]).collect();
                    let mut expected: Option<(Vec<Padded>, Extremes)> = None;
                    for (path, pool) in &mut pools {
                        let mut force = before.clone();
                        let extremes = pool.add_forces(*path, 5, &RATES, &x, &mut force);
                        assert!(force.as_flattened().iter().all(|f| f.is_finite()));
                        let (f, e) = expected.get_or_insert((force.clone(), extremes));
                        assert_eq!(bits(f.as_flattened()), bits(force.as_flattened()), "{path:?}");
                        assert_eq!(*e, extremes, "{path:?}");
                        crushed |= extremes.det_f < COLLAPSE_ONSET;
                    }
                    for id in 0..count as u32 {
                        let expected = history_bits(&pools[0].1, id);
                        assert!(pools.iter().all(|(_, pool)| history_bits(pool, id) == expected));
                    }
                    if count > 0 {
                        // Leaves other unused lanes behind, and other elements in the last block.
                        let id = noise.below(count) as u32;
                        for (_, pool) in &mut pools {
                            let history = pool.remove(id).expect("there");
                            let (nodes, constants) = &soup.elements[id as usize];
                            assert!(pool.insert(id, 5, *nodes, constants, &history));
                        }
                    }
                }
                assert!(crushed || count < 8);
            }
        }
    }

    #[test]
    fn the_force_is_minus_the_slope_of_the_energy() {
        let mut noise = Noise(3);
        let soup = Soup::new(&mut noise, 12, 21);
        for round in 0..8 {
            let x = soup.moved(&mut noise, [0.05, 0.4, 1.0][round % 3]);
            let f = force(&mut soup.pool(0), &Rates::ELASTIC, &x);
            let scale = f.iter().map(|f| f.norm()).fold(0.0, Real::max);
            let step = 1e-7;
            for n in 0..x.len() {
                for c in 0..3 {
                    let energy = |d: Real| {
                        let mut x = x.clone();
                        x[n][c] += d;
                        soup.energy(&x)
                    };
                    let slope = (energy(step) - energy(-step)) / (2.0 * step);
                    assert!((f[n][c] + slope).abs() < 1e-6 * scale, "{} {slope} of {scale}", f[n][c]);
                }
            }
        }
    }

    #[test]
    fn a_rigid_rotation_costs_no_force() {
        let mut noise = Noise(5);
        let soup = Soup::new(&mut noise, 20, 50);
        let turn = nalgebra::Rotation3::from_euler_angles(0.4, -2.0, 1.1);
        let x: Vec<_> = soup.rest.iter().map(|x| turn * x + Vec3::new(0.1, -0.2, 0.05)).collect();
        for path in Path::available() {
            for branches in 0..=MAX_BRANCHES {
                let (force, extremes) = forces(&mut soup.pool(branches), path, &RATES, &x);
                assert!(force.as_flattened().iter().all(|f| f.abs() < 1e-11));
                assert!(extremes.strain_squared < 1e-24 && (extremes.det_f - 1.0).abs() < 1e-12);
            }
        }
    }

    /// The same law on matrices, element by element.
    fn reference(soup: &Soup, rates: &Rates, memory: &mut [[Mat3; 3]], branches: usize, x: &[Vec3]) -> Vec<Vec3> {
        let mut force = vec![Vec3::zeros(); x.len()];
        for (e, [before, d @ ..]) in memory.iter_mut().enumerate() {
            let (nodes, c) = &soup.elements[e];
            let f = soup.deformation(e, x);
            let strain = (f.transpose() * f - Mat3::identity()) * 0.5;
            let change = strain - *before;
            *before = strain;
            let mut s = Mat3::from_diagonal_element(c.lambda * (strain.trace() + rates.volume * change.trace()))
                + 2.0 * c.mu * (strain + rates.shear * change);
            for (b, d) in d.iter_mut().enumerate().take(branches) {
                *d = (*d + change) * rates.decay[b];
                let deviator = *d - Mat3::from_diagonal_element(d.trace() / 3.0);
                s += 2.0 * c.mu * c.branch * rates.share[b] * deviator;
            }
            let squeeze = (f.determinant() - COLLAPSE_ONSET).min(0.0);
            let rows = [f.row(0).transpose(), f.row(1).transpose(), f.row(2).transpose()];
            let cofactor =
                Mat3::from_columns(&[rows[1].cross(&rows[2]), rows[2].cross(&rows[0]), rows[0].cross(&rows[1])]);
            let p = f * s + COLLAPSE_STIFFNESS * (c.lambda + 2.0 * c.mu) * squeeze * cofactor.transpose();
            for i in 0..3 {
                let q = p * Vec3::from(c.gradient[i]);
                force[nodes[i + 1] as usize] -= q;
                force[nodes[0] as usize] += q;
            }
        }
        force
    }

    #[test]
    fn the_law_with_viscosity_and_memory_agrees_with_matrices() {
        let mut noise = Noise(11);
        let soup = Soup::new(&mut noise, 15, 30);
        for branches in 0..=MAX_BRANCHES {
            let mut pool = soup.pool(branches);
            let mut memory = vec![[Mat3::zeros(); 3]; soup.elements.len()];
            for _ in 0..20 {
                let x = soup.moved(&mut noise, 0.3);
                let f = force(&mut pool, &RATES, &x);
                let expected = reference(&soup, &RATES, &mut memory, branches, &x);
                let scale = expected.iter().map(|f| f.norm()).fold(0.0, Real::max);
                assert!(f.iter().zip(&expected).all(|(a, b)| (a - b).norm() < 1e-12 * scale));
            }
        }
    }

    #[test]
    fn a_branch_relaxes_under_a_held_shear() {
        // A tenth of the relaxation time in 1000 steps; the elastic share stays, the branch fades by 1/(1 + h/T).
        let soup = {
            let mut noise = Noise(2);
            let mut soup = Soup::new(&mut noise, 4, 1);
            soup.rest = vec![Vec3::zeros(), Vec3::x() * 0.01, Vec3::y() * 0.01, Vec3::z() * 0.01];
            let gradient = [[100.0, 0.0, 0.0], [0.0, 100.0, 0.0], [0.0, 0.0, 100.0]];
            soup.elements[0] = ([0, 1, 2, 3], ElementConstants { gradient, lambda: 3e-3, mu: 2e-4, branch: 1.5 });
            soup
        };
        let shear = 1e-7;
        let mut x = soup.rest.clone();
        x[2].x += shear * 0.01;
        let (h, time, share) = (1e-4, 1.0, 0.7);
        let rates = Rates { volume: 0.0, shear: 0.0, decay: [1.0 / (1.0 + h / time), 0.0], share: [share, 0.0] };
        let mut pool = soup.pool(1);
        let mut model = 0.5 * shear;
        for step in 1..=1000 {
            let f = force(&mut pool, &rates, &x);
            model *= rates.decay[0];
            let stress = 2.0 * 2e-4 * (0.5 * shear + 1.5 * share * model);
            assert!((f[2].x / (-stress * 100.0) - 1.0).abs() < 1e-6);
            let exact = 0.5 * shear * (-(step as Real) * h / time).exp();
            assert!((pool.history(0).expect("there").branch[0][5] / exact - 1.0).abs() < 1e-5);
        }
    }

    #[test]
    fn what_does_not_move_feels_no_viscosity() {
        let mut noise = Noise(13);
        let soup = Soup::new(&mut noise, 20, 35);
        let x = soup.moved(&mut noise, 0.2);
        let mut pool = soup.pool(0);
        let moving = force(&mut pool, &RATES, &x);
        let still = force(&mut pool, &RATES, &x);
        let elastic = force(&mut soup.pool(0), &Rates::ELASTIC, &x);
        assert_ne!(moving, still);
        assert_eq!(still, elastic);
    }

    #[test]
    fn lanes_without_an_element_are_not_seen() {
        let mut noise = Noise(17);
        for count in 1..=17 {
            let mut soup = Soup::new(&mut noise, 12, count);
            // Node 0, which unused lanes name, is far away and in no element.
            for (nodes, _) in &mut soup.elements {
                *nodes = nodes.map(|n| n + 1);
            }
            soup.rest.insert(0, Vec3::repeat(Real::NAN));
            let x: Vec<_> = soup.rest.iter().map(|x| x * 1.1).collect();
            for path in Path::available() {
                let mut pool = soup.pool(2);
                for _ in 0..3 {
                    let (force, extremes) = forces(&mut pool, path, &RATES, &x);
                    assert!(force.as_flattened().iter().all(|f| f.is_finite()));
                    assert_eq!(force[0], [0.0; 4]);
                    // E = 0.105 I, J = 1.331.
                    assert!((extremes.strain_squared - 3.0 * 0.105 * 0.105).abs() < 1e-12);
                    assert_eq!(extremes.det_f, 1.0);
                }
            }
        }
    }

    #[test]
    fn a_memory_fades_without_becoming_subnormal() {
        let mut noise = Noise(19);
        let soup = Soup::new(&mut noise, 10, 9);
        let x = soup.moved(&mut noise, 0.1);
        let mut pool = soup.pool(2);
        for _ in 0..4000 {
            force(&mut pool, &RATES, &x);
        }
        for id in 0..9 {
            let history = pool.history(id).expect("there");
            let faded = |d: &Real| d.abs() < 1e-30 && !d.is_subnormal();
            assert!(history.branch.as_flattened().iter().all(faded));
        }
    }

    #[test]
    fn extremes_are_those_of_the_elements_and_who_is_over_its_limit_is_named() {
        let mut noise = Noise(23);
        let soup = Soup::new(&mut noise, 30, 61);
        for amount in [0.02, 0.5, 1.5] {
            let x = soup.moved(&mut noise, amount);
            let mut pool = soup.pool(1);
            let (_, extremes) = forces(&mut pool, Path::best(), &RATES, &x);
            let mut expected = Extremes::REST;
            let (mut strained, mut calm) = (vec![], vec![]);
            let limit = StrainLimit { deviator: 0.6, slope: 0.8 };
            for e in 0..soup.elements.len() {
                let f = soup.deformation(e, &x);
                let strain = (f.transpose() * f - Mat3::identity()) * 0.5;
                let det = f.determinant();
                let own = Extremes { strain_squared: strain.dot(&strain), det_f: det };
                let deviator = (strain - Mat3::identity() * (strain.trace() / 3.0)).norm();
                let over = 2.0 * deviator - (limit.deviator - limit.slope * 2.0 * strain.trace());
                if det < COLLAPSE_ONSET || over > 1e-9 {
                    strained.push(e as u32);
                } else if over < -1e-9 {
                    calm.push(e as u32);
                }
                expected = expected.join(&own);
            }
            let near = |a: Real, b: Real| (a - b).abs() < 1e-11 * (1.0 + b.abs());
            assert!(near(extremes.strain_squared, expected.strain_squared));
            assert!(near(extremes.det_f, expected.det_f));
            for path in Path::available() {
                let mut pool = soup.pool(1);
                (0..soup.elements.len() as u32).for_each(|e| pool.set_strain_limit(e, limit));
                forces(&mut pool, path, &RATES, &x);
                let over: Vec<u32> = pool.over_limit(5).collect();
                assert!(strained.iter().all(|e| over.contains(e)), "{strained:?} in {over:?}");
                // One over its limit brings along those of its block, and no others.
                let block = |e: &u32| strained.iter().any(|s| s / LANES as u32 == e / LANES as u32);
                assert!(calm.iter().all(|e| block(e) || !over.contains(e)), "{over:?} for {strained:?}");
            }
        }
    }
}
