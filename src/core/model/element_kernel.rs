//! Elastic, viscous and relaxing forces of a group of elements at a time: of tetrahedra, and of stars, of which all nodes
//! around one move its deformation gradient.
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
//!
//! Fibres add `M : (E + c_s ΔE) M` to `S`, `M = √(K w vol) a ⊗ a`.
//!
//! An element of which the part `w` is neo-Hookean has `1 − w` of `λ tr(E) I + 2μ E`, and `w (μ F + ((λ + μ)(J − 1) − μ) cof F)` in `P`.

pub use super::element::{MAX_BRANCHES, StrainLimit};
use super::element_block::{Block, Gradients, Memory, Nodes};
pub use super::lanes::Padded;
use super::lanes::{LANES, Lanes, Plain, Row};
use super::material::{COLLAPSE_ONSET, COLLAPSE_STIFFNESS};
pub use super::simd::Simd;
use crate::math::Real;
use std::ops::Range;

/// Memories are rounded to multiples of 2⁻¹¹⁸ by adding and taking away this number. Else, where nothing moves, they
/// would fade into subnormal numbers, which some CPUs handle a hundred times slower.
const FADE: Real = 1.0 / ((1u128 << 66) as Real);

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

/// The elements to evaluate.
pub(super) struct Batch<'a> {
    /// All blocks of the pool.
    pub blocks: &'a mut [Block],
    /// All nodes of the pool, `1 + spokes` rows for each block.
    pub nodes: &'a [Nodes],
    /// All gradients of the pool, `spokes` for each block.
    pub gradients: &'a [Gradients],
    /// How many of its spokes each element has.
    pub counts: &'a [[u16; LANES]],
    /// Most nodes of an element beside the first; 3 of tetrahedra.
    pub spokes: usize,
    /// All memories of the pool, those of a block side by side.
    pub memories: &'a mut [Memory],
    /// Fibres of all blocks of the pool; empty where none has some.
    pub fibres: &'a [Memory],
    /// Blocks to evaluate, in order.
    pub order: &'a [u32],
    /// Elements to evaluate: all blocks are full, but for the last.
    pub count: usize,
    /// Maxwell branches of each element, at most [`MAX_BRANCHES`].
    pub branches: usize,
    /// Whether some elements are neo-Hookean.
    pub neo_hookean: bool,
    /// Receives the blocks with an element that is strained beyond its limit or crushed; has room for all.
    pub over_limit: &'a mut Vec<u32>,
}

/// Adds the forces of the elements of `batch`, tetrahedra or `STARS`, to `force` [N] and stores what they remember.
/// `position` [m].
///
/// # Safety
/// `path` must be available; every node number of `batch` must lie within `position` and `force`.
pub(super) unsafe fn add_forces<const STARS: bool>(
    path: Simd,
    batch: Batch<'_>,
    rates: &Rates,
    position: &[Padded],
    force: &mut [Padded],
) -> Extremes {
    // SAFETY: the caller's promise.
    unsafe {
        match path {
            #[cfg(target_arch = "x86_64")]
            Simd::Avx512 => add_forces_avx512::<STARS>(batch, rates, position, force),
            #[cfg(target_arch = "x86_64")]
            Simd::Avx2 => add_forces_avx2::<STARS>(batch, rates, position, force),
            _ => add_forces_with::<Plain, STARS>(batch, rates, position, force),
        }
    }
}

/// # Safety
/// The CPU must have AVX-512F; node numbers must lie within the fields.
#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2,avx512f")]
unsafe fn add_forces_avx512<const STARS: bool>(
    batch: Batch<'_>,
    rates: &Rates,
    x: &[Padded],
    f: &mut [Padded],
) -> Extremes {
    // SAFETY: passed on.
    unsafe { add_forces_with::<super::lanes::Avx512, STARS>(batch, rates, x, f) }
}

/// # Safety
/// The CPU must have AVX2; node numbers must lie within the fields.
#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2")]
unsafe fn add_forces_avx2<const STARS: bool>(
    batch: Batch<'_>,
    rates: &Rates,
    x: &[Padded],
    f: &mut [Padded],
) -> Extremes {
    // SAFETY: passed on.
    unsafe { add_forces_with::<super::lanes::Avx2, STARS>(batch, rates, x, f) }
}

/// # Safety
/// `L` must run on this CPU; node numbers must lie within the fields.
#[inline(always)]
unsafe fn add_forces_with<L: Lanes, const STARS: bool>(
    batch: Batch<'_>,
    rates: &Rates,
    x: &[Padded],
    f: &mut [Padded],
) -> Extremes {
    // SAFETY: passed on.
    unsafe {
        match (STARS, batch.branches) {
            (false, 0) => add_forces_here::<L, 0>(batch, rates, x, f),
            (false, 1) => add_forces_here::<L, 1>(batch, rates, x, f),
            (false, _) => add_forces_here::<L, 2>(batch, rates, x, f),
            (true, 0) => add_star_forces_here::<L, 0>(batch, rates, x, f),
            (true, 1) => add_star_forces_here::<L, 1>(batch, rates, x, f),
            (true, _) => add_star_forces_here::<L, 2>(batch, rates, x, f),
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
    let law = Law::<L, B>::new(rates, batch.neo_hookean);
    let mut seen = Seen::new();
    let (nodes, gradients) = (batch.nodes.as_chunks::<4>().0, batch.gradients.as_chunks::<3>().0);
    for (i, index) in batch.order.iter().enumerate() {
        let index = *index as usize;
        let (node, gradient) = (&nodes[index], &gradients[index]);
        let mut parts = Parts {
            block: &mut batch.blocks[index],
            memory: &mut batch.memories[index * B..(index + 1) * B],
            fibres: batch.fibres.get(index),
        };
        let used = batch.count - i * LANES;
        let mut at = 0;
        seen.alarm = false;
        while at < LANES && at < used {
            // SAFETY: the caller's promise, and `at` is a multiple of the width below the number of lanes.
            unsafe {
                // F = Σ (x_i − x_0) ⊗ ∇L_i, i = 1..3.
                let f = deformation(&L::edges(position, node, at), gradient, at);
                let p = law.stress(&f, &mut parts, at, used, &mut seen);

                // f_i = −P ∇L_i; the fourth is minus their sum, so that no force is left over.
                let mut q = [[L::splat(0.0); 3]; 3];
                for (q, gradient) in q.iter_mut().zip(gradient) {
                    *q = times(&p, &load3(gradient, at));
                }
                if used - at < L::WIDTH {
                    let mut rows = [[[0.0; LANES]; 3]; 3];
                    for i in 0..3 {
                        for c in 0..3 {
                            q[i][c].store(&mut rows[i][c], at);
                        }
                    }
                    scatter_some(force, node, at..used, &rows);
                } else {
                    L::scatter(force, node, at, &q);
                }
            }
            at += L::WIDTH;
        }
        if seen.alarm {
            batch.over_limit.push(index as u32);
        }
    }
    seen.extremes()
}

/// Most groups of lanes in a block.
const MOST_GROUPS: usize = LANES / 4;

/// Places of a star without a neighbour have the star's own node and no gradient: nothing is added there but zeros. (To a
/// force that is not negative zero; sums that begin with zero are not.)
///
/// # Safety
/// `L` must run on this CPU; node numbers must lie within the fields.
#[inline(always)]
unsafe fn add_star_forces_here<L: Lanes, const B: usize>(
    batch: Batch<'_>,
    rates: &Rates,
    position: &[Padded],
    force: &mut [Padded],
) -> Extremes {
    let zero = L::splat(0.0);
    let law = Law::<L, B>::new(rates, batch.neo_hookean);
    let mut seen = Seen::new();
    for (i, index) in batch.order.iter().enumerate() {
        let index = *index as usize;
        let spokes = batch.counts[index].iter().fold(0, |most, count| most.max(usize::from(*count)));
        let node = &batch.nodes[index * (batch.spokes + 1)..][..=spokes];
        let gradient = &batch.gradients[index * batch.spokes..][..spokes];
        let mut parts = Parts {
            block: &mut batch.blocks[index],
            memory: &mut batch.memories[index * B..(index + 1) * B],
            fibres: batch.fibres.get(index),
        };
        let used = (batch.count - i * LANES).min(LANES);
        let groups = used.div_ceil(L::WIDTH);
        // First Piola–Kirchhoff stress of each group, and what acts on the stars' own nodes.
        let (mut p, mut sum) = ([[[zero; 3]; 3]; MOST_GROUPS], [[zero; 3]; MOST_GROUPS]);
        seen.alarm = false;
        // SAFETY: the caller's promise, and `at` is a multiple of the width below the number of lanes.
        unsafe {
            for (group, p) in p.iter_mut().enumerate().take(groups) {
                let at = group * L::WIDTH;
                // F = Σ (x_j − x_0) ⊗ b_j.
                let origin = L::gather(position, &node[0], at);
                let mut f = [[zero; 3]; 3];
                for (node, gradient) in node[1..].iter().zip(gradient) {
                    let (x, g) = (L::gather(position, node, at), load3(gradient, at));
                    for r in 0..3 {
                        let d = x[r].sub(origin[r]);
                        for c in 0..3 {
                            f[r][c] = f[r][c].add(d.mul(g[c]));
                        }
                    }
                }
                *p = law.stress(&f, &mut parts, at, used, &mut seen);
            }
            // f_j = −P b_j; the first is minus their sum, so that no force is left over.
            for (node, gradient) in node[1..].iter().zip(gradient) {
                for (group, (p, sum)) in p.iter().zip(&mut sum).enumerate().take(groups) {
                    let at = group * L::WIDTH;
                    let q = times(p, &load3(gradient, at));
                    for c in 0..3 {
                        sum[c] = sum[c].sub(q[c]);
                    }
                    L::subtract(force, node, at..used.min(at + L::WIDTH), &q);
                }
            }
            for (group, sum) in sum.iter().enumerate().take(groups) {
                let at = group * L::WIDTH;
                L::subtract(force, &node[0], at..used.min(at + L::WIDTH), sum);
            }
        }
        if seen.alarm {
            batch.over_limit.push(index as u32);
        }
    }
    seen.extremes()
}

/// What is remembered and known of the elements of a block beside their nodes.
struct Parts<'a> {
    block: &'a mut Block,
    memory: &'a mut [Memory],
    fibres: Option<&'a Memory>,
}

/// How far from rest the elements are that have been evaluated.
struct Seen<L> {
    /// Largest `|2E|²`.
    strain_squared: L,
    least_det: L,
    /// Whether an element of the block is over its limit, or crushed.
    alarm: bool,
}

impl<L: Lanes> Seen<L> {
    #[inline(always)]
    fn new() -> Self {
        Self { strain_squared: L::splat(0.0), least_det: L::splat(1.0), alarm: false }
    }

    #[inline(always)]
    fn extremes(&self) -> Extremes {
        Extremes {
            // The strains are doubled.
            strain_squared: 0.25 * lanes(self.strain_squared).into_iter().fold(0.0, Real::max),
            det_f: lanes(self.least_det).into_iter().fold(1.0, Real::min),
        }
    }
}

/// The law with `B` branches, over one step.
struct Law<L, const B: usize> {
    /// Whether some elements are neo-Hookean; all that differs is left out where none is.
    neo_hookean: bool,
    volume: L,
    shear: L,
    decay: [L; B],
    share: [L; B],
}

impl<L: Lanes, const B: usize> Law<L, B> {
    #[inline(always)]
    fn new(rates: &Rates, neo_hookean: bool) -> Self {
        let mut decay = [L::splat(0.0); B];
        let mut share = [L::splat(0.0); B];
        for b in 0..B {
            decay[b] = L::splat(rates.decay[b]);
            share[b] = L::splat(rates.share[b]);
        }
        Self { neo_hookean, volume: L::splat(rates.volume), shear: L::splat(rates.shear), decay, share }
    }

    /// First Piola–Kirchhoff stress, times its part of the volume, of the elements from lane `at` on at the deformation
    /// gradient `f`, of which the first `used` lanes of the block hold one.
    ///
    /// # Safety
    /// `L` must run on this CPU; see [`Lanes::load`].
    #[inline(always)]
    unsafe fn stress(
        &self,
        f: &[[L; 3]; 3],
        parts: &mut Parts<'_>,
        at: usize,
        used: usize,
        seen: &mut Seen<L>,
    ) -> [[L; 3]; 3] {
        let Parts { block, memory, fibres } = parts;
        let zero = L::splat(0.0);
        let half = L::splat(0.5);
        let third = L::splat(1.0 / 3.0);
        let one = L::splat(1.0);
        let fade = L::splat(FADE);
        let onset = L::splat(COLLAPSE_ONSET);
        let stiffness = L::splat(COLLAPSE_STIFFNESS);
        // SAFETY: the caller's promise.
        unsafe {
            // 2E = FᵀF − I, its components xx, yy, zz, yz, xz, xy.
            let e = [
                column_dot(f, 0, 0).sub(one),
                column_dot(f, 1, 1).sub(one),
                column_dot(f, 2, 2).sub(one),
                column_dot(f, 1, 2),
                column_dot(f, 0, 2),
                column_dot(f, 0, 1),
            ];
            let mut change = e;
            // S over μ without what is a multiple of I.
            let mut s = e;
            let trace = e[0].add(e[1]).add(e[2]);
            let mut green = trace;
            if self.neo_hookean {
                let part = one.sub(L::load(&block.neo_hookean, at));
                for s in &mut s {
                    *s = part.mul(*s);
                }
                green = part.mul(trace);
            }
            for c in 0..6 {
                change[c] = e[c].sub(L::load(&block.strain[c], at));
                e[c].store(&mut block.strain[c], at);
                s[c] = s[c].add(self.shear.mul(change[c]));
            }
            let trace_change = change[0].add(change[1]).add(change[2]);
            let lambda = L::load(&block.lambda, at);
            let mu = L::load(&block.mu, at);
            let mut pressure = half.mul(lambda).mul(green.add(self.volume.mul(trace_change)));
            for (memory, (share, decay)) in memory.iter_mut().zip(self.share.iter().zip(&self.decay)) {
                let mut d = e;
                for c in 0..6 {
                    let row = &mut memory.0[c];
                    d[c] = L::load(row, at).add(change[c]).mul(*decay).add(fade).sub(fade);
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
            if let Some(Memory(rows)) = fibres {
                // Half of M : 2E; what is beside the diagonal counts twice.
                let (mut diagonal, mut beside) = (zero, zero);
                for c in 0..3 {
                    let along = |c: usize| e[c].add(self.shear.mul(change[c]));
                    diagonal = diagonal.add(L::load(&rows[c], at).mul(along(c)));
                    beside = beside.add(L::load(&rows[c + 3], at).mul(along(c + 3)));
                }
                let tension = half.mul(diagonal).add(beside);
                for c in 0..6 {
                    s[c] = s[c].add(tension.mul(L::load(&rows[c], at)));
                }
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
            seen.alarm |= limit.mul(limit).any_less(squares.sub(third.mul(trace.mul(trace))));
            seen.strain_squared = squares.max(seen.strain_squared);
            seen.least_det = det.min(seen.least_det);

            // P = F S.
            let mut p = [row_times(&f[0], &s), row_times(&f[1], &s), row_times(&f[2], &s)];
            let is_crushed = det.any_less(onset);
            seen.alarm |= is_crushed;
            if self.neo_hookean || is_crushed {
                // P += k (J − 0.6) cof F where J < 0.6.
                let k = stiffness.mul(lambda.add(mu.add(mu))).mul(L::load(&block.collapse, at));
                let mut squeeze = k.mul(det.sub(onset).min(zero));
                if self.neo_hookean {
                    // P += w (μ F + ((λ + μ)(J − 1) − μ) cof F).
                    let part = L::load(&block.neo_hookean, at);
                    squeeze = squeeze.add(part.mul(lambda.add(mu).mul(det.sub(one)).sub(mu)));
                    let part_of_mu = part.mul(mu);
                    for r in 0..3 {
                        for c in 0..3 {
                            p[r][c] = p[r][c].add(part_of_mu.mul(f[r][c]));
                        }
                    }
                }
                let cofactor = [cofactor_0, cross(&f[2], &f[0]), cross(&f[0], &f[1])];
                for r in 0..3 {
                    for c in 0..3 {
                        p[r][c] = p[r][c].add(squeeze.mul(cofactor[r][c]));
                    }
                }
            }
            p
        }
    }
}

/// What [`Lanes::scatter`] does, for some elements of a block: lanes without an element must leave even the sign of a
/// zero alone, since there are more of them in a wider group.
#[inline(never)]
fn scatter_some(force: &mut [Padded], node: &[Nodes; 4], elements: Range<usize>, q: &[[Row; 3]; 3]) {
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
unsafe fn deformation<L: Lanes>(x: &[[L; 3]; 3], gradient: &[Gradients; 3], at: usize) -> [[L; 3]; 3] {
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

/// `A x`, by rows.
#[inline(always)]
fn times<L: Lanes>(a: &[[L; 3]; 3], x: &[L; 3]) -> [L; 3] {
    [dot(&a[0], x), dot(&a[1], x), dot(&a[2], x)]
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
mod tests;
