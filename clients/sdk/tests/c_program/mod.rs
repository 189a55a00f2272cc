//! C programs that link the client library: compiled with the system's compiler and run. Shared by the tests that do so.
#![allow(dead_code)] // each of them uses a part

use std::{
    path::{Path, PathBuf},
    process::Command,
};

/// What a static Rust library needs of the system beside itself.
const SYSTEM_LIBRARIES: &[&str] = if cfg!(target_os = "macos") {
    &["-framework", "CoreFoundation", "-framework", "Security", "-lm"]
} else {
    &["-lpthread", "-ldl", "-lm"]
};

/// Which library a program links.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Linked {
    Shared,
    Static,
}

/// The library that cargo built for this test, beside the test itself: it builds every crate type of a library that a test
/// needs, and may put a hash into the name. Older builds may lie there too; this one is the newest.
pub fn library(linked: Linked) -> PathBuf {
    let extension = match linked {
        Linked::Static => "a",
        Linked::Shared if cfg!(target_os = "macos") => "dylib",
        Linked::Shared => "so",
    };
    let test = std::env::current_exe().unwrap();
    let candidates = std::fs::read_dir(test.parent().unwrap()).unwrap().filter_map(|entry| {
        let path = entry.unwrap().path();
        let ours = path.file_name().unwrap().to_string_lossy().starts_with("libpalpate_sdk");
        let ours = ours && path.extension().is_some_and(|e| e == extension);
        ours.then(|| (path.metadata().unwrap().modified().unwrap(), path))
    });
    candidates.max().expect("cargo leaves the library beside the tests").1
}

/// Compiles `examples/{example}.c` of the client library in the folder `sdk` into `program`, without a single warning.
pub fn compile_example(sdk: &Path, example: &str, linked: Linked, program: &Path) {
    let source = sdk.join(format!("examples/{example}.c"));
    compile_against(&[sdk.join("include")], &[source], "-std=c99", &[], linked, program);
}

/// Compiles `sources` with the headers of the folders `include` and more `flags`, without a single warning.
pub fn compile_against(
    include: &[PathBuf],
    sources: &[PathBuf],
    standard: &str,
    flags: &[&str],
    linked: Linked,
    program: &Path,
) {
    let mut compile = Command::new("cc");
    compile.args([standard, "-Wall", "-Wextra", "-Werror", "-pedantic"]);
    for folder in include {
        compile.arg("-I").arg(folder);
    }
    compile.args(sources).arg(library(linked)).args(flags);
    match linked {
        Linked::Static => compile.args(SYSTEM_LIBRARIES),
        Linked::Shared => compile.arg("-lm"),
    };
    run(compile.arg("-o").arg(program));
}

/// Runs a command to its end; its output, or a panic that shows what it said.
pub fn run(command: &mut Command) -> String {
    let output = command.output().unwrap_or_else(|error| panic!("{command:?}: {error}"));
    let [out, err] = [&output.stdout, &output.stderr].map(|bytes| String::from_utf8_lossy(bytes));
    assert!(output.status.success(), "{command:?}\n{out}\n{err}");
    out.into_owned()
}

/// The forces [N] that the example has printed while it held still: from 1100 ms on, as `1100 ms: 1.0 mm, 1.200 N`.
pub fn held_forces(said: &str) -> Vec<f64> {
    let lines = said.lines().filter_map(|line| line.split_once(" ms: "));
    let held = lines.filter(|(ms, _)| ms.trim().parse::<u32>().is_ok_and(|ms| ms >= 1100));
    held.map(|(_, rest)| rest.split_once(", ").unwrap().1.trim().trim_end_matches(" N").parse().unwrap()).collect()
}
