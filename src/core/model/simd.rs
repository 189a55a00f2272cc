//! The forms of the element kernel: which registers it runs in, picked once at run time.

/// Which form of the kernel runs. All give the same bits.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Simd {
    /// Plain arrays: any CPU.
    Portable,
    /// AVX2 registers.
    Avx2,
    /// AVX-512 registers.
    Avx512,
}

impl Simd {
    /// Every form, the fastest last.
    pub const ALL: [Simd; 3] = [Simd::Portable, Simd::Avx2, Simd::Avx512];

    /// The name that it is chosen by.
    pub const fn name(self) -> &'static str {
        match self {
            Simd::Portable => "portable",
            Simd::Avx2 => "avx2",
            Simd::Avx512 => "avx512",
        }
    }

    /// True when this CPU can run it. Cheap: the standard library asks the CPU once.
    pub fn is_available(self) -> bool {
        match self {
            Simd::Portable => true,
            #[cfg(target_arch = "x86_64")]
            Simd::Avx2 => is_x86_feature_detected!("avx2"),
            #[cfg(target_arch = "x86_64")]
            Simd::Avx512 => is_x86_feature_detected!("avx2") && is_x86_feature_detected!("avx512f"),
            #[cfg(not(target_arch = "x86_64"))]
            _ => false,
        }
    }

    /// Every path that this CPU can run, the fastest last.
    pub fn available() -> Vec<Simd> {
        Simd::ALL.into_iter().filter(|path| path.is_available()).collect()
    }

    /// The fastest available.
    pub fn best() -> Simd {
        Simd::available().pop().unwrap_or(Simd::Portable)
    }
}
