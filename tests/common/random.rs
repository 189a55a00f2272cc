//! Chance that any seed repeats.
#![allow(dead_code, reason = "each test uses a part")]

use palpate_core::math::Real;

/// Whether a run tries all cases, with `PALPATE_WHOLE=1`, and not only some.
pub fn whole() -> bool {
    std::env::var_os("PALPATE_WHOLE").is_some()
}

/// How many of `all` random cases a run tries, if not the `whole`.
pub fn cases(some: u64, all: u64) -> u64 {
    if whole() { all } else { some }
}

/// Splitmix64: any seed gives its own sequence.
pub struct Random(pub u64);

impl Random {
    pub fn bits(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let z = (self.0 ^ (self.0 >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        let z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    pub fn between(&mut self, low: Real, high: Real) -> Real {
        low + (high - low) * (self.bits() >> 11) as Real / (1u64 << 53) as Real
    }

    pub fn below(&mut self, count: usize) -> usize {
        (self.bits() % count as u64) as usize
    }
}
