//! Several numbers at a time, one for each element of a group.
//!
//! Every operation rounds each lane as IEEE 754 says, and forces are added element by element whatever the width, so
//! all forms give the same bits.

use crate::math::Real;
use std::ops::Range;

/// A position [m] or a force [N] of a node, padded to a whole register: the fourth number is always zero.
pub type Padded = [Real; 4];

/// Elements in a block: as many as the widest form takes at once. A row of a block is then one cache line.
pub const LANES: usize = 8;

/// One number for each element of a block.
pub type Row = [Real; LANES];

/// What the element kernel needs of a group of lanes.
///
/// Methods are safe to call only where the form runs on the CPU: [`super::simd::Simd`] sees to that.
pub trait Lanes: Copy {
    /// Elements in a group; divides [`LANES`].
    const WIDTH: usize;
    /// The same number in every lane.
    fn splat(x: Real) -> Self;
    /// From a row, starting at element `at`.
    ///
    /// # Safety
    /// `at + WIDTH` must not exceed [`LANES`].
    unsafe fn load(row: &Row, at: usize) -> Self;
    /// To a row, starting at element `at`.
    ///
    /// # Safety
    /// `at + WIDTH` must not exceed [`LANES`].
    unsafe fn store(self, row: &mut Row, at: usize);
    /// Sum.
    fn add(self, other: Self) -> Self;
    /// Difference.
    fn sub(self, other: Self) -> Self;
    /// Product.
    fn mul(self, other: Self) -> Self;
    /// `self` where it is smaller, else `other` (also where either is not a number).
    fn min(self, other: Self) -> Self;
    /// `self` where it is larger, else `other` (also where either is not a number).
    fn max(self, other: Self) -> Self;
    /// True when `self < other` in any lane.
    fn any_less(self, other: Self) -> bool;
    /// `self` where `a < b`, else zero.
    fn where_less(self, a: Self, b: Self) -> Self;
    /// Vertices 1..3 of the elements from `at` on, relative to their vertex 0: vertex, then component.
    ///
    /// # Safety
    /// Every node must lie within `position`, and `at + WIDTH` must not exceed [`LANES`].
    unsafe fn edges(position: &[Padded], node: &[[u32; LANES]; 4], at: usize) -> [[Self; 3]; 3];
    /// Takes `q[i]` from the force on vertices 1..3 and adds `(q[0] + q[1]) + q[2]` to that on vertex 0: element by
    /// element in order, each from vertex 0 to 3.
    ///
    /// # Safety
    /// Every node must lie within `force`, and `at + WIDTH` must not exceed [`LANES`].
    unsafe fn scatter(force: &mut [Padded], node: &[[u32; LANES]; 4], at: usize, q: &[[Self; 3]; 3]);
    /// Positions [m] of one node of the elements from `at` on, by component.
    ///
    /// # Safety
    /// Every node must lie within `position`, and `at + WIDTH` must not exceed [`LANES`].
    unsafe fn gather(position: &[Padded], node: &[u32; LANES], at: usize) -> [Self; 3];
    /// Takes `q` from the force on one node of the elements `elements`, one after the other: as many as there are lanes at most.
    ///
    /// # Safety
    /// Every node must lie within `force`, and `elements` within [`LANES`].
    unsafe fn subtract(force: &mut [Padded], node: &[u32; LANES], elements: Range<usize>, q: &[Self; 3]);
}

/// Plain arrays, four lanes.
#[derive(Clone, Copy, Debug)]
pub struct Plain([Real; 4]);

impl Plain {
    #[inline(always)]
    fn zip(self, other: Self, op: impl Fn(Real, Real) -> Real) -> Self {
        let (a, b) = (self.0, other.0);
        Self([op(a[0], b[0]), op(a[1], b[1]), op(a[2], b[2]), op(a[3], b[3])])
    }
}

impl Lanes for Plain {
    const WIDTH: usize = 4;
    #[inline(always)]
    fn splat(x: Real) -> Self {
        Self([x; 4])
    }
    #[inline(always)]
    unsafe fn load(row: &Row, at: usize) -> Self {
        Self([row[at], row[at + 1], row[at + 2], row[at + 3]])
    }
    #[inline(always)]
    unsafe fn store(self, row: &mut Row, at: usize) {
        row[at..at + 4].copy_from_slice(&self.0);
    }
    #[inline(always)]
    fn add(self, other: Self) -> Self {
        self.zip(other, |a, b| a + b)
    }
    #[inline(always)]
    fn sub(self, other: Self) -> Self {
        self.zip(other, |a, b| a - b)
    }
    #[inline(always)]
    fn mul(self, other: Self) -> Self {
        self.zip(other, |a, b| a * b)
    }
    #[inline(always)]
    fn min(self, other: Self) -> Self {
        self.zip(other, |a, b| if a < b { a } else { b })
    }
    #[inline(always)]
    fn max(self, other: Self) -> Self {
        self.zip(other, |a, b| if a > b { a } else { b })
    }
    #[inline(always)]
    fn any_less(self, other: Self) -> bool {
        (0..4).any(|l| self.0[l] < other.0[l])
    }
    #[inline(always)]
    fn where_less(self, a: Self, b: Self) -> Self {
        let keep = |l: usize| if a.0[l] < b.0[l] { self.0[l] } else { 0.0 };
        Self([keep(0), keep(1), keep(2), keep(3)])
    }
    #[inline(always)]
    unsafe fn edges(position: &[Padded], node: &[[u32; LANES]; 4], at: usize) -> [[Self; 3]; 3] {
        let mut edges = [[Self([0.0; 4]); 3]; 3];
        for l in 0..4 {
            // SAFETY: the caller's promise.
            let origin = unsafe { position.get_unchecked(node[0][at + l] as usize) };
            for i in 0..3 {
                // SAFETY: the caller's promise.
                let end = unsafe { position.get_unchecked(node[i + 1][at + l] as usize) };
                for c in 0..3 {
                    edges[i][c].0[l] = end[c] - origin[c];
                }
            }
        }
        edges
    }
    #[inline(always)]
    unsafe fn scatter(force: &mut [Padded], node: &[[u32; LANES]; 4], at: usize, q: &[[Self; 3]; 3]) {
        for l in 0..4 {
            // SAFETY: the caller's promise.
            let origin = unsafe { force.get_unchecked_mut(node[0][at + l] as usize) };
            for c in 0..3 {
                origin[c] += (q[0][c].0[l] + q[1][c].0[l]) + q[2][c].0[l];
            }
            for i in 0..3 {
                // SAFETY: the caller's promise.
                let end = unsafe { force.get_unchecked_mut(node[i + 1][at + l] as usize) };
                for c in 0..3 {
                    end[c] -= q[i][c].0[l];
                }
            }
        }
    }
    #[inline(always)]
    unsafe fn gather(position: &[Padded], node: &[u32; LANES], at: usize) -> [Self; 3] {
        let mut x = [Self([0.0; 4]); 3];
        for l in 0..4 {
            // SAFETY: the caller's promise.
            let place = unsafe { position.get_unchecked(node[at + l] as usize) };
            for c in 0..3 {
                x[c].0[l] = place[c];
            }
        }
        x
    }
    #[inline(always)]
    unsafe fn subtract(force: &mut [Padded], node: &[u32; LANES], elements: Range<usize>, q: &[Self; 3]) {
        for (l, e) in elements.enumerate() {
            // SAFETY: the caller's promise.
            let force = unsafe { force.get_unchecked_mut(node[e] as usize) };
            for c in 0..3 {
                force[c] -= q[c].0[l];
            }
        }
    }
}

/// AVX2 registers, four lanes.
#[cfg(target_arch = "x86_64")]
#[derive(Clone, Copy, Debug)]
pub struct Avx2(std::arch::x86_64::__m256d);

/// AVX-512 registers, eight lanes.
#[cfg(target_arch = "x86_64")]
#[derive(Clone, Copy, Debug)]
pub struct Avx512(std::arch::x86_64::__m512d);

#[cfg(target_arch = "x86_64")]
mod x86 {
    use super::{Avx2, Avx512, LANES, Lanes, Padded, Range, Real, Row};
    use std::arch::x86_64::*;

    /// # Safety
    /// `node` must lie within `field`.
    #[inline(always)]
    unsafe fn at(field: &[Padded], node: u32) -> __m256d {
        // SAFETY: the caller's promise; a padded vector is a whole register.
        unsafe { _mm256_loadu_pd(field.as_ptr().add(node as usize).cast()) }
    }

    /// # Safety
    /// The four nodes must lie within `force`.
    #[inline(always)]
    unsafe fn scatter_one(force: *mut Padded, node: [u32; 4], q0: __m256d, q: [__m256d; 3]) {
        // SAFETY: the caller's promise; a padded vector is a whole register.
        unsafe {
            let f: *mut Real = force.add(node[0] as usize).cast();
            _mm256_storeu_pd(f, _mm256_add_pd(_mm256_loadu_pd(f), q0));
            let f: *mut Real = force.add(node[1] as usize).cast();
            _mm256_storeu_pd(f, _mm256_sub_pd(_mm256_loadu_pd(f), q[0]));
            let f: *mut Real = force.add(node[2] as usize).cast();
            _mm256_storeu_pd(f, _mm256_sub_pd(_mm256_loadu_pd(f), q[1]));
            let f: *mut Real = force.add(node[3] as usize).cast();
            _mm256_storeu_pd(f, _mm256_sub_pd(_mm256_loadu_pd(f), q[2]));
        }
    }

    /// Components of the vectors of four elements.
    ///
    /// # Safety
    /// The CPU must have AVX2.
    #[inline(always)]
    unsafe fn by_component(a: __m256d, b: __m256d, c: __m256d, d: __m256d) -> [Avx2; 3] {
        // SAFETY: the caller's promise.
        unsafe {
            let (xz_ab, y_ab) = (_mm256_unpacklo_pd(a, b), _mm256_unpackhi_pd(a, b));
            let (xz_cd, y_cd) = (_mm256_unpacklo_pd(c, d), _mm256_unpackhi_pd(c, d));
            [
                Avx2(_mm256_permute2f128_pd::<0x20>(xz_ab, xz_cd)),
                Avx2(_mm256_permute2f128_pd::<0x20>(y_ab, y_cd)),
                Avx2(_mm256_permute2f128_pd::<0x31>(xz_ab, xz_cd)),
            ]
        }
    }

    /// Vectors of four elements, each with a zero in the fourth place, of their components.
    ///
    /// # Safety
    /// The CPU must have AVX2.
    #[inline(always)]
    unsafe fn by_element(x: __m256d, y: __m256d, z: __m256d) -> [__m256d; 4] {
        // SAFETY: the caller's promise.
        unsafe {
            let zero = _mm256_setzero_pd();
            let (xy_02, xy_13) = (_mm256_unpacklo_pd(x, y), _mm256_unpackhi_pd(x, y));
            let (z_02, z_13) = (_mm256_unpacklo_pd(z, zero), _mm256_unpackhi_pd(z, zero));
            [
                _mm256_permute2f128_pd::<0x20>(xy_02, z_02),
                _mm256_permute2f128_pd::<0x20>(xy_13, z_13),
                _mm256_permute2f128_pd::<0x31>(xy_02, z_02),
                _mm256_permute2f128_pd::<0x31>(xy_13, z_13),
            ]
        }
    }

    impl Lanes for Avx2 {
        const WIDTH: usize = 4;
        #[inline(always)]
        fn splat(x: Real) -> Self {
            // SAFETY: this form runs only where the CPU has AVX2 (see the trait); so in all methods below.
            Self(unsafe { _mm256_set1_pd(x) })
        }
        #[inline(always)]
        unsafe fn load(row: &Row, at: usize) -> Self {
            // SAFETY: see `splat`; the caller's promise.
            Self(unsafe { _mm256_loadu_pd(row.as_ptr().add(at)) })
        }
        #[inline(always)]
        unsafe fn store(self, row: &mut Row, at: usize) {
            // SAFETY: see `splat`; the caller's promise.
            unsafe { _mm256_storeu_pd(row.as_mut_ptr().add(at), self.0) };
        }
        #[inline(always)]
        fn add(self, other: Self) -> Self {
            // SAFETY: see `splat`.
            Self(unsafe { _mm256_add_pd(self.0, other.0) })
        }
        #[inline(always)]
        fn sub(self, other: Self) -> Self {
            // SAFETY: see `splat`.
            Self(unsafe { _mm256_sub_pd(self.0, other.0) })
        }
        #[inline(always)]
        fn mul(self, other: Self) -> Self {
            // SAFETY: see `splat`.
            Self(unsafe { _mm256_mul_pd(self.0, other.0) })
        }
        #[inline(always)]
        fn min(self, other: Self) -> Self {
            // SAFETY: see `splat`.
            Self(unsafe { _mm256_min_pd(self.0, other.0) })
        }
        #[inline(always)]
        fn max(self, other: Self) -> Self {
            // SAFETY: see `splat`.
            Self(unsafe { _mm256_max_pd(self.0, other.0) })
        }
        #[inline(always)]
        fn any_less(self, other: Self) -> bool {
            // SAFETY: see `splat`.
            unsafe { _mm256_movemask_pd(_mm256_cmp_pd::<_CMP_LT_OQ>(self.0, other.0)) != 0 }
        }
        #[inline(always)]
        fn where_less(self, a: Self, b: Self) -> Self {
            // SAFETY: see `splat`.
            Self(unsafe { _mm256_and_pd(_mm256_cmp_pd::<_CMP_LT_OQ>(a.0, b.0), self.0) })
        }
        #[inline(always)]
        unsafe fn edges(position: &[Padded], node: &[[u32; LANES]; 4], first: usize) -> [[Self; 3]; 3] {
            let mut edges = [[Self::splat(0.0); 3]; 3];
            // SAFETY: see `splat`; the caller's promise.
            unsafe {
                let o = &node[0];
                let origin = [
                    at(position, o[first]),
                    at(position, o[first + 1]),
                    at(position, o[first + 2]),
                    at(position, o[first + 3]),
                ];
                let mut i = 0;
                while i < 3 {
                    // Differences come before the change from nodes to lanes: that is one vertex less to change.
                    let n = &node[i + 1];
                    let a = _mm256_sub_pd(at(position, n[first]), origin[0]);
                    let b = _mm256_sub_pd(at(position, n[first + 1]), origin[1]);
                    let c = _mm256_sub_pd(at(position, n[first + 2]), origin[2]);
                    let d = _mm256_sub_pd(at(position, n[first + 3]), origin[3]);
                    edges[i] = by_component(a, b, c, d);
                    i += 1;
                }
            }
            edges
        }
        #[inline(always)]
        unsafe fn scatter(force: &mut [Padded], node: &[[u32; LANES]; 4], first: usize, q: &[[Self; 3]; 3]) {
            // SAFETY: see `splat`; the caller's promise.
            unsafe {
                let zero = _mm256_setzero_pd();
                // Vertex, then element.
                let mut by_node = [[zero; 4]; 3];
                let mut i = 0;
                while i < 3 {
                    by_node[i] = by_element(q[i][0].0, q[i][1].0, q[i][2].0);
                    i += 1;
                }
                let force = force.as_mut_ptr();
                let mut l = 0;
                while l < 4 {
                    let q = [by_node[0][l], by_node[1][l], by_node[2][l]];
                    let sum = _mm256_add_pd(_mm256_add_pd(q[0], q[1]), q[2]);
                    let e = first + l;
                    scatter_one(force, [node[0][e], node[1][e], node[2][e], node[3][e]], sum, q);
                    l += 1;
                }
            }
        }
        #[inline(always)]
        unsafe fn gather(position: &[Padded], node: &[u32; LANES], first: usize) -> [Self; 3] {
            // SAFETY: see `splat`; the caller's promise.
            unsafe {
                let (a, b) = (at(position, node[first]), at(position, node[first + 1]));
                let (c, d) = (at(position, node[first + 2]), at(position, node[first + 3]));
                by_component(a, b, c, d)
            }
        }
        #[inline(always)]
        unsafe fn subtract(force: &mut [Padded], node: &[u32; LANES], elements: Range<usize>, q: &[Self; 3]) {
            // SAFETY: see `splat`; the caller's promise.
            unsafe {
                let by_element = by_element(q[0].0, q[1].0, q[2].0);
                let force = force.as_mut_ptr();
                let (mut l, first) = (0, elements.start);
                while l < 4 && first + l < elements.end {
                    let f: *mut Real = force.add(node[first + l] as usize).cast();
                    _mm256_storeu_pd(f, _mm256_sub_pd(_mm256_loadu_pd(f), by_element[l]));
                    l += 1;
                }
            }
        }
    }

    /// The nodes of elements `a` and `b`, one in each half.
    ///
    /// # Safety
    /// The CPU must have AVX-512; the nodes must lie within `field`.
    #[inline(always)]
    unsafe fn two_at(field: &[Padded], a: u32, b: u32) -> __m512d {
        // SAFETY: the caller's promise.
        unsafe { _mm512_insertf64x4::<1>(_mm512_castpd256_pd512(at(field, a)), at(field, b)) }
    }

    /// Components of the vectors of eight elements, given as those of elements 0|2, 1|3, 4|6, 5|7.
    ///
    /// # Safety
    /// The CPU must have AVX-512F.
    #[inline(always)]
    unsafe fn pairs_by_component(a: __m512d, b: __m512d, c: __m512d, d: __m512d) -> [Avx512; 3] {
        // SAFETY: the caller's promise.
        unsafe {
            let (xz_ab, y_ab) = (_mm512_unpacklo_pd(a, b), _mm512_unpackhi_pd(a, b));
            let (xz_cd, y_cd) = (_mm512_unpacklo_pd(c, d), _mm512_unpackhi_pd(c, d));
            // Quarters 0 and 2 of both hold x or y, quarters 1 and 3 hold z.
            [
                Avx512(_mm512_shuffle_f64x2::<0b10_00_10_00>(xz_ab, xz_cd)),
                Avx512(_mm512_shuffle_f64x2::<0b10_00_10_00>(y_ab, y_cd)),
                Avx512(_mm512_shuffle_f64x2::<0b11_01_11_01>(xz_ab, xz_cd)),
            ]
        }
    }

    /// Vectors of elements 0|2, 1|3, 4|6, 5|7, each with a zero in the fourth place, of their components: x and y from pairs
    /// of them, z from its own register (8 and up).
    ///
    /// # Safety
    /// The CPU must have AVX-512F.
    #[inline(always)]
    unsafe fn by_pair(x: __m512d, y: __m512d, z: __m512d) -> [__m512d; 4] {
        // SAFETY: the caller's promise.
        unsafe {
            let (even, odd) = (_mm512_unpacklo_pd(x, y), _mm512_unpackhi_pd(x, y));
            [
                _mm512_maskz_permutex2var_pd(0x77, even, _mm512_set_epi64(0, 10, 3, 2, 0, 8, 1, 0), z),
                _mm512_maskz_permutex2var_pd(0x77, odd, _mm512_set_epi64(0, 11, 3, 2, 0, 9, 1, 0), z),
                _mm512_maskz_permutex2var_pd(0x77, even, _mm512_set_epi64(0, 14, 7, 6, 0, 12, 5, 4), z),
                _mm512_maskz_permutex2var_pd(0x77, odd, _mm512_set_epi64(0, 15, 7, 6, 0, 13, 5, 4), z),
            ]
        }
    }

    impl Lanes for Avx512 {
        const WIDTH: usize = 8;
        #[inline(always)]
        fn splat(x: Real) -> Self {
            // SAFETY: this form runs only where the CPU has AVX-512F (see the trait); so in all methods below.
            Self(unsafe { _mm512_set1_pd(x) })
        }
        #[inline(always)]
        unsafe fn load(row: &Row, at: usize) -> Self {
            // SAFETY: see `splat`; the caller's promise.
            Self(unsafe { _mm512_loadu_pd(row.as_ptr().add(at)) })
        }
        #[inline(always)]
        unsafe fn store(self, row: &mut Row, at: usize) {
            // SAFETY: see `splat`; the caller's promise.
            unsafe { _mm512_storeu_pd(row.as_mut_ptr().add(at), self.0) };
        }
        #[inline(always)]
        fn add(self, other: Self) -> Self {
            // SAFETY: see `splat`.
            Self(unsafe { _mm512_add_pd(self.0, other.0) })
        }
        #[inline(always)]
        fn sub(self, other: Self) -> Self {
            // SAFETY: see `splat`.
            Self(unsafe { _mm512_sub_pd(self.0, other.0) })
        }
        #[inline(always)]
        fn mul(self, other: Self) -> Self {
            // SAFETY: see `splat`.
            Self(unsafe { _mm512_mul_pd(self.0, other.0) })
        }
        #[inline(always)]
        fn min(self, other: Self) -> Self {
            // SAFETY: see `splat`.
            Self(unsafe { _mm512_min_pd(self.0, other.0) })
        }
        #[inline(always)]
        fn max(self, other: Self) -> Self {
            // SAFETY: see `splat`.
            Self(unsafe { _mm512_max_pd(self.0, other.0) })
        }
        #[inline(always)]
        fn any_less(self, other: Self) -> bool {
            // SAFETY: see `splat`.
            unsafe { _mm512_cmp_pd_mask::<_CMP_LT_OQ>(self.0, other.0) != 0 }
        }
        #[inline(always)]
        fn where_less(self, a: Self, b: Self) -> Self {
            // SAFETY: see `splat`.
            Self(unsafe { _mm512_maskz_mov_pd(_mm512_cmp_pd_mask::<_CMP_LT_OQ>(a.0, b.0), self.0) })
        }
        #[inline(always)]
        unsafe fn edges(position: &[Padded], node: &[[u32; LANES]; 4], _: usize) -> [[Self; 3]; 3] {
            let mut edges = [[Self::splat(0.0); 3]; 3];
            // SAFETY: see `splat`; the caller's promise.
            unsafe {
                let o = &node[0];
                let origin = [
                    two_at(position, o[0], o[2]),
                    two_at(position, o[1], o[3]),
                    two_at(position, o[4], o[6]),
                    two_at(position, o[5], o[7]),
                ];
                let mut i = 0;
                while i < 3 {
                    // Differences come before the change from nodes to lanes: that is one vertex less to change.
                    let n = &node[i + 1];
                    let a = _mm512_sub_pd(two_at(position, n[0], n[2]), origin[0]);
                    let b = _mm512_sub_pd(two_at(position, n[1], n[3]), origin[1]);
                    let c = _mm512_sub_pd(two_at(position, n[4], n[6]), origin[2]);
                    let d = _mm512_sub_pd(two_at(position, n[5], n[7]), origin[3]);
                    edges[i] = pairs_by_component(a, b, c, d);
                    i += 1;
                }
            }
            edges
        }
        #[inline(always)]
        unsafe fn scatter(force: &mut [Padded], node: &[[u32; LANES]; 4], _: usize, q: &[[Self; 3]; 3]) {
            // SAFETY: see `splat`; the caller's promise.
            unsafe {
                let mut by_node = [[_mm512_setzero_pd(); 4]; 3];
                let mut i = 0;
                while i < 3 {
                    by_node[i] = by_pair(q[i][0].0, q[i][1].0, q[i][2].0);
                    i += 1;
                }
                let force = force.as_mut_ptr();
                let mut pair = 0;
                while pair < 4 {
                    // Pairs (0|2, 1|3) and then (4|6, 5|7): low halves in order, then high halves.
                    let (p, high) = (pair / 2 * 2, pair % 2 == 1);
                    let mut k = 0;
                    while k < 2 {
                        let q = [by_node[0][p + k], by_node[1][p + k], by_node[2][p + k]];
                        let sum = _mm512_add_pd(_mm512_add_pd(q[0], q[1]), q[2]);
                        let e = 2 * pair + k;
                        let (sum, q) = if high {
                            (upper(sum), [upper(q[0]), upper(q[1]), upper(q[2])])
                        } else {
                            (lower(sum), [lower(q[0]), lower(q[1]), lower(q[2])])
                        };
                        scatter_one(force, [node[0][e], node[1][e], node[2][e], node[3][e]], sum, q);
                        k += 1;
                    }
                    pair += 1;
                }
            }
        }
        #[inline(always)]
        unsafe fn gather(position: &[Padded], node: &[u32; LANES], _: usize) -> [Self; 3] {
            let n = node;
            // SAFETY: see `splat`; the caller's promise.
            unsafe {
                let (a, b) = (two_at(position, n[0], n[2]), two_at(position, n[1], n[3]));
                let (c, d) = (two_at(position, n[4], n[6]), two_at(position, n[5], n[7]));
                pairs_by_component(a, b, c, d)
            }
        }
        #[inline(always)]
        unsafe fn subtract(force: &mut [Padded], node: &[u32; LANES], elements: Range<usize>, q: &[Self; 3]) {
            // SAFETY: see `splat`; the caller's promise.
            unsafe {
                let by_pair = by_pair(q[0].0, q[1].0, q[2].0);
                let force = force.as_mut_ptr();
                let mut e = 0;
                while e < elements.end {
                    let pair = by_pair[e / 4 * 2 + e % 2];
                    let q = if e % 4 < 2 { lower(pair) } else { upper(pair) };
                    let f: *mut Real = force.add(node[e] as usize).cast();
                    _mm256_storeu_pd(f, _mm256_sub_pd(_mm256_loadu_pd(f), q));
                    e += 1;
                }
            }
        }
    }

    #[inline(always)]
    fn lower(x: __m512d) -> __m256d {
        // SAFETY: as in `Avx512::splat`.
        unsafe { _mm512_castpd512_pd256(x) }
    }

    #[inline(always)]
    fn upper(x: __m512d) -> __m256d {
        // SAFETY: as in `Avx512::splat`.
        unsafe { _mm512_extractf64x4_pd::<1>(x) }
    }
}
