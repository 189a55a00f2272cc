//! libFuzzer's program, whose arguments are libFuzzer's: `PALPATE_FUZZ_TARGET` names the target. With `PALPATE_FUZZ_SEEDS` it writes
//! the seeds of every target into that folder instead, as `TARGET/NUMBER`, and says the names of the targets.
#![no_main]

use palpate_fuzz::{TARGETS, Target};
use std::path::Path;
use std::sync::LazyLock;

static TARGET: LazyLock<&Target> = LazyLock::new(|| {
    let name = std::env::var("PALPATE_FUZZ_TARGET").unwrap_or_default();
    let target = TARGETS.iter().find(|target| target.name == name).unwrap_or_else(|| panic!("no target {name:?}"));
    // What is made once, with the seeds, costs no input anything.
    assert!((target.seeds)().iter().all(|seed| target.take(seed)), "{name}");
    target
});

libfuzzer_sys::fuzz_target!(
    init: {
        if let Some(folder) = std::env::var_os("PALPATE_FUZZ_SEEDS") {
            write_seeds(folder.as_ref()).unwrap();
            std::process::exit(0);
        }
    },
    |bytes: &[u8]| {
        TARGET.take(bytes);
    }
);

fn write_seeds(folder: &Path) -> std::io::Result<()> {
    for target in TARGETS {
        let folder = folder.join(target.name);
        std::fs::create_dir_all(&folder)?;
        for (number, seed) in (target.seeds)().into_iter().enumerate() {
            std::fs::write(folder.join(number.to_string()), seed)?;
        }
        println!("{}", target.name);
    }
    Ok(())
}
