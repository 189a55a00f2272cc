//! The C interface as a C program meets it: the header with the system's compiler, and the example, linked with the static
//! library, against the stand-in server.
#![cfg(unix)] // the flags are those of cc

mod fake_server;

use std::{
    path::{Path, PathBuf},
    process::Command,
};

use fake_server::{FLOOR_STIFFNESS, FakeServer, TOOL_RADIUS};

/// What a static Rust library needs of the system beside itself.
const SYSTEM_LIBRARIES: &[&str] = if cfg!(target_os = "macos") {
    &["-framework", "CoreFoundation", "-framework", "Security", "-lm"]
} else {
    &["-lpthread", "-ldl", "-lm"]
};

fn source(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join(name)
}

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

/// Runs a command to its end; its output, or a panic that shows what it said.
fn run(command: &mut Command) -> String {
    let output = command.output().unwrap_or_else(|error| panic!("{command:?}: {error}"));
    let [out, err] = [&output.stdout, &output.stderr].map(|bytes| String::from_utf8_lossy(bytes));
    assert!(output.status.success(), "{command:?}\n{out}\n{err}");
    out.into_owned()
}

#[test]
fn the_header_is_clean_c99_and_cxx() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("header.c");
    std::fs::write(&file, "#include \"palpate.h\"\nint main(void) { return palpate_version() == NULL; }\n").unwrap();
    for (compiler, standard, language) in [("cc", "-std=c99", "c"), ("c++", "-std=c++11", "c++")] {
        let flags = ["-Wall", "-Wextra", "-Werror", "-pedantic", "-fsyntax-only", standard, "-x", language];
        run(Command::new(compiler).args(flags).arg("-I").arg(source("include")).arg(&file));
    }
}

#[test]
fn the_example_in_c_feels_the_floor() {
    let server = FakeServer::current();
    let folder = tempfile::tempdir().unwrap();
    let program = folder.path().join("touch");
    let mut compile = Command::new("cc");
    compile.args(["-std=c99", "-Wall", "-Wextra", "-Werror", "-pedantic", "-I"]).arg(source("include"));
    compile.arg(source("examples/touch.c")).arg(static_library()).args(SYSTEM_LIBRARIES).arg("-o").arg(&program);
    run(&mut compile);

    let endpoints = &server.endpoints;
    let said = run(Command::new(&program).args([&endpoints.force, &endpoints.surface, &endpoints.session]));
    // It ends 1 mm above the floor, under a ball's radius.
    let expected = FLOOR_STIFFNESS * (TOOL_RADIUS - 1e-3);
    let last = format!("library {}, at the end {expected:.3} N up, 0.000 N aside", env!("CARGO_PKG_VERSION"));
    assert!(said.contains(&last), "{said}");

    // Errors are text: nobody is there, and the tool is taken.
    let elsewhere = Command::new(&program).args([&endpoints.force, &endpoints.surface, "a/b"]).output().unwrap();
    assert!(!elsewhere.status.success());
    let complaint = String::from_utf8_lossy(&elsewhere.stderr);
    assert!(complaint.contains("connect: 'a/b' cannot be a session name"), "{complaint}");
}
