//! The Python package under its own tests. Where what it needs is missing it says that it skips.
#![cfg(target_os = "linux")]

#[path = "common/python.rs"]
mod python;

use python::{python, run};
use std::path::Path;
use std::process::Command;

#[test]
fn the_package_passes_its_tests() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let program = Path::new(env!("CARGO_BIN_EXE_palpate"));
    let Some((python, folder)) = python() else { return };
    let mut tests = Command::new(python);
    tests.args(["-m", "pytest", "-ra", "-s", "-p", "no:cacheprovider"]).arg(root.join("clients/python"));
    let said = run(tests.env("PALPATE", program).env("MPLBACKEND", "Agg").current_dir(folder));
    println!("{said}");
    assert!(said.contains(" passed") && !said.contains(" skipped"), "{said}");
}
