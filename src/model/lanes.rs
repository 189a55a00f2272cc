//! Four numbers at a time, one for each element of a block.
//!
//! Every operation rounds each lane as IEEE 754 says, so both forms give the same bits.

use super::element_kernel::PaddedForce;
use crate::math::{Real, Vec3};

/// Elements in a block.
pub const LANES: usize = 4;

/// What the element kernel needs of four lanes.
///
/// Methods are safe to call only where the form runs on the CPU: [`super::element_kernel::Path`] sees to that.
pub trait Lanes: Copy {
    /// The same number in every lane.
    fn splat(x: Real) -> Self;
    /// From memory.
    fn load(x: &[Real; LANES]) -> Self;
    /// To memory.
    fn to_array(self) -> [Real; LANES];
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
    /// The three components of `field` at four nodes.
    ///
    /// # Safety
    /// Every node must lie within `field`.
    unsafe fn gather(field: &[Vec3], node: &[u32; LANES]) -> [Self; 3];
    /// Adds `value` to `field` at four nodes, lane by lane.
    ///
    /// # Safety
    /// Every node must lie within `field`.
    unsafe fn scatter_add(field: &mut [PaddedForce], node: &[u32; LANES], value: &[Self; 3]);
}

/// Plain arrays.
#[derive(Clone, Copy, Debug)]
pub struct Plain([Real; LANES]);

impl Plain {
    #[inline(always)]
    fn zip(self, other: Self, op: impl Fn(Real, Real) -> Real) -> Self {
        let (a, b) = (self.0, other.0);
        Self([op(a[0], b[0]), op(a[1], b[1]), op(a[2], b[2]), op(a[3], b[3])])
    }
}

impl Lanes for Plain {
    #[inline(always)]
    fn splat(x: Real) -> Self {
        Self([x; LANES])
    }
    #[inline(always)]
    fn load(x: &[Real; LANES]) -> Self {
        Self(*x)
    }
    #[inline(always)]
    fn to_array(self) -> [Real; LANES] {
        self.0
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
        (0..LANES).any(|l| self.0[l] < other.0[l])
    }
    #[inline(always)]
    fn where_less(self, a: Self, b: Self) -> Self {
        let keep = |l: usize| if a.0[l] < b.0[l] { self.0[l] } else { 0.0 };
        Self([keep(0), keep(1), keep(2), keep(3)])
    }
    #[inline(always)]
    unsafe fn gather(field: &[Vec3], node: &[u32; LANES]) -> [Self; 3] {
        // SAFETY: the caller's promise.
        let at = |l: usize| unsafe { field.get_unchecked(node[l] as usize) };
        let (a, b, c, d) = (at(0), at(1), at(2), at(3));
        [Self([a.x, b.x, c.x, d.x]), Self([a.y, b.y, c.y, d.y]), Self([a.z, b.z, c.z, d.z])]
    }
    #[inline(always)]
    unsafe fn scatter_add(field: &mut [PaddedForce], node: &[u32; LANES], value: &[Self; 3]) {
        #[expect(clippy::needless_range_loop, reason = "four arrays under the same index")]
        for l in 0..LANES {
            // SAFETY: the caller's promise.
            let at = unsafe { field.get_unchecked_mut(node[l] as usize) };
            at[0] += value[0].0[l];
            at[1] += value[1].0[l];
            at[2] += value[2].0[l];
        }
    }
}

/// AVX2 registers.
#[cfg(target_arch = "x86_64")]
#[derive(Clone, Copy, Debug)]
pub struct Avx2(std::arch::x86_64::__m256d);

#[cfg(target_arch = "x86_64")]
mod avx2 {
    use super::{Avx2, LANES, Lanes, PaddedForce, Real, Vec3};
    use std::arch::x86_64::*;

    impl Lanes for Avx2 {
        #[inline(always)]
        fn splat(x: Real) -> Self {
            // SAFETY: this form runs only where the CPU has AVX2 (see the trait); so in all methods below.
            Self(unsafe { _mm256_set1_pd(x) })
        }
        #[inline(always)]
        fn load(x: &[Real; LANES]) -> Self {
            // SAFETY: see `splat`; four numbers are there to be read.
            Self(unsafe { _mm256_loadu_pd(x.as_ptr()) })
        }
        #[inline(always)]
        fn to_array(self) -> [Real; LANES] {
            let mut out = [0.0; LANES];
            // SAFETY: see `splat`; there is room for four numbers.
            unsafe { _mm256_storeu_pd(out.as_mut_ptr(), self.0) };
            out
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
        unsafe fn gather(field: &[Vec3], node: &[u32; LANES]) -> [Self; 3] {
            // SAFETY: the caller's promise for the nodes; the mask keeps the loads to the three numbers of each.
            unsafe {
                let three = _mm256_set_epi64x(0, -1, -1, -1);
                let first = field.as_ptr();
                let a = _mm256_maskload_pd(first.add(node[0] as usize).cast(), three);
                let b = _mm256_maskload_pd(first.add(node[1] as usize).cast(), three);
                let c = _mm256_maskload_pd(first.add(node[2] as usize).cast(), three);
                let d = _mm256_maskload_pd(first.add(node[3] as usize).cast(), three);
                let (xy_ab, z_ab) = (_mm256_unpacklo_pd(a, b), _mm256_unpackhi_pd(a, b));
                let (xy_cd, z_cd) = (_mm256_unpacklo_pd(c, d), _mm256_unpackhi_pd(c, d));
                // Low halves hold x and y of two nodes, high halves their z.
                [
                    Self(_mm256_permute2f128_pd::<0x20>(xy_ab, xy_cd)),
                    Self(_mm256_permute2f128_pd::<0x20>(z_ab, z_cd)),
                    Self(_mm256_permute2f128_pd::<0x31>(xy_ab, xy_cd)),
                ]
            }
        }
        #[inline(always)]
        unsafe fn scatter_add(field: &mut [PaddedForce], node: &[u32; LANES], value: &[Self; 3]) {
            // SAFETY: the caller's promise for the nodes; a padded force is a whole register.
            unsafe {
                let (x, y, z) = (value[0].0, value[1].0, value[2].0);
                let zero = _mm256_setzero_pd();
                let (xy_02, xy_13) = (_mm256_unpacklo_pd(x, y), _mm256_unpackhi_pd(x, y));
                let (z_02, z_13) = (_mm256_unpacklo_pd(z, zero), _mm256_unpackhi_pd(z, zero));
                let lanes = [
                    _mm256_permute2f128_pd::<0x20>(xy_02, z_02),
                    _mm256_permute2f128_pd::<0x20>(xy_13, z_13),
                    _mm256_permute2f128_pd::<0x31>(xy_02, z_02),
                    _mm256_permute2f128_pd::<0x31>(xy_13, z_13),
                ];
                let mut l = 0;
                while l < LANES {
                    let at = field.as_mut_ptr().add(node[l] as usize).cast::<Real>();
                    _mm256_storeu_pd(at, _mm256_add_pd(_mm256_loadu_pd(at), lanes[l]));
                    l += 1;
                }
            }
        }
    }
}
