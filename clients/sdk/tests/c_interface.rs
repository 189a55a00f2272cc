//! The C interface as a C program meets it: the header with the system's compiler, and the example, linked with the static
//! library, against the stand-in server.
#![cfg(unix)] // the flags are those of cc

mod c_program;
mod fake_server;

use std::{path::Path, process::Command};

use c_program::{compile_example, held_forces, run};
use fake_server::{FLOOR_STIFFNESS, FakeServer, TOOL_RADIUS};

fn sdk() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

#[test]
fn the_header_is_clean_c99_and_cxx() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("header.c");
    std::fs::write(&file, "#include \"palpate.h\"\nint main(void) { return palpate_version() == NULL; }\n").unwrap();
    for (compiler, standard, language) in [("cc", "-std=c99", "c"), ("c++", "-std=c++11", "c++")] {
        let flags = ["-Wall", "-Wextra", "-Werror", "-pedantic", "-fsyntax-only", standard, "-x", language];
        run(Command::new(compiler).args(flags).arg("-I").arg(sdk().join("include")).arg(&file));
    }
}

#[test]
fn the_example_in_c_feels_the_floor() {
    let server = FakeServer::current();
    let folder = tempfile::tempdir().unwrap();
    let program = folder.path().join("touch");
    compile_example(sdk(), &program);

    let endpoints = &server.endpoints;
    let said = run(Command::new(&program).args([&endpoints.force, &endpoints.surface, &endpoints.session]));
    assert!(said.contains(concat!("library ", env!("CARGO_PKG_VERSION"))), "{said}");
    // It ends 1 mm above the floor, under a ball's radius. On a busy machine a wrench may be late and its force fade.
    let expected = FLOOR_STIFFNESS * (TOOL_RADIUS - 1e-3);
    let most = held_forces(&said).into_iter().fold(0.0, f64::max);
    assert!((most / expected - 1.0).abs() < 1e-3, "{expected} N expected\n{said}");

    // Errors are text.
    let elsewhere = Command::new(&program).args([&endpoints.force, &endpoints.surface, "a/b"]).output().unwrap();
    assert!(!elsewhere.status.success());
    let complaint = String::from_utf8_lossy(&elsewhere.stderr);
    assert!(complaint.contains("connect: 'a/b' cannot be a session name"), "{complaint}");
}
