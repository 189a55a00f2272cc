//! C programs that link the static library: compiled with the system's compiler and run. Shared by the tests that do so.
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

/// The static library that cargo built for this test, beside the test itself: it builds every crate type of a library
/// that a test needs, and puts a hash into the name. Older builds may lie there too; this one is the newest.
fn static_library() -> PathBuf {
    let test = std::env::current_exe().unwrap();
    let candidates = std::fs::read_dir(test.parent().unwrap()).unwrap().filter_map(|entry| {
        let entry = entry.unwrap();
        let name = entry.file_name().into_string().unwrap();
        let ours = name.starts_with("libpalpate_sdk") && name.ends_with(".a");
        ours.then(|| (entry.metadata().unwrap().modified().unwrap(), entry.path()))
    });
    candidates.max().expect("cargo leaves the static library beside the tests").1
}

/// Compiles `examples/touch.c` of the client library in the folder `sdk` into `program`, without a single warning.
pub fn compile_example(sdk: &Path, program: &Path) {
    let mut compile = Command::new("cc");
    compile.args(["-std=c99", "-Wall", "-Wextra", "-Werror", "-pedantic", "-I"]).arg(sdk.join("include"));
    compile.arg(sdk.join("examples/touch.c")).arg(static_library()).args(SYSTEM_LIBRARIES).arg("-o").arg(program);
    run(&mut compile);
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
