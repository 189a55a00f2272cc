//! libFuzzer's program: the target is named by `PALPATE_FUZZ_TARGET`, as arguments are libFuzzer's.
#![no_main]

use palpate_fuzz::{TARGETS, Target};
use std::sync::LazyLock;

static TARGET: LazyLock<&Target> = LazyLock::new(|| {
    let name = std::env::var("PALPATE_FUZZ_TARGET").unwrap_or_default();
    TARGETS.iter().find(|target| target.name == name).unwrap_or_else(|| panic!("no target {name:?}"))
});

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| {
    TARGET.take(bytes);
});
