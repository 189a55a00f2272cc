//! The C# client and Unity's components: compiled by mono, and the plain part run against a server.
//!
//! It needs mcs and mono (`apt-get install mono-mcs mono-runtime`); where one is missing it says that it skips.
#![cfg(target_os = "linux")] // how the library is found

#[path = "../clients/sdk/tests/c_program/mod.rs"]
mod c_program;
#[path = "common/secured.rs"]
mod secured;
#[path = "common/served.rs"]
mod served;

use c_program::{Linked, library, run};
use secured::Secured;
use served::Served;
use std::path::{Path, PathBuf};
use std::process::Command;

/// True where C# can be compiled and run.
fn mono_is_there() -> bool {
    let is_there = |program: &str| Command::new(program).arg("--version").output().is_ok_and(|o| o.status.success());
    let both = is_there("mcs") && is_there("mono");
    if !both {
        println!("skipped: mcs or mono is not there (apt-get install mono-mcs mono-runtime)");
    }
    both
}

fn unity() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("clients/unity")
}

/// Compiles C# without a warning.
fn compile(sources: &[&str], more: &[&str], program: &Path) {
    let mut compile = Command::new("mcs");
    compile.args(["-langversion:7", "-warnaserror"]).args(more).arg(format!("-out:{}", program.display()));
    run(compile.args(sources).current_dir(unity()));
}

#[test]
fn the_components_and_the_sample_compile_without_unity() {
    if !mono_is_there() {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let sources = ["Runtime/*.cs", "Runtime/Components/*.cs", "Samples~/Touch/*.cs", "Tests~/UnityEngine.cs"];
    compile(&sources, &["-target:library"], &folder.path().join("all.dll"));
}

#[test]
fn a_program_in_csharp_feels_and_sees_the_body() {
    if !mono_is_there() {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let program = folder.path().join("touch.exe");
    compile(&["Runtime/*.cs", "Tests~/Touch.cs"], &[], &program);
    std::fs::copy(library(Linked::Shared), folder.path().join("libpalpate_sdk.so")).unwrap();
    {
        // It ends before the other begins: both would have to share the processors.
        let secured = Secured::start();
        shows(folder.path(), &secured.served.endpoints, secured.certificate("anna").to_str().unwrap());
    }
    let server = Served::start(Path::new(env!("CARGO_BIN_EXE_palpate")));
    shows(folder.path(), &server.endpoints, "");
}

/// What touch.exe in `folder` shows of the server at `endpoints`, with the certificate in `identity`, if any: a force, and a dent
/// of more than 1 mm, as a body shows it that a slow machine does not refine.
fn shows(folder: &Path, endpoints: &[String; 2], identity: &str) {
    // The ball's centre ends 12 mm above the middle of the top, its lowest point 8 mm below it: right, up, forward.
    let place = ["0.05", "0.112", "0.05"];
    let number = |said: &str, what: &str| -> Option<f64> {
        said.lines().find_map(|line| line.strip_prefix(what)).map(|number| number.trim().parse().unwrap())
    };
    // A machine that is busy elsewhere for a tenth of a second silences the hand, which then has to come from outside again; for a
    // second, and the tool is gone.
    let pressed = (0..10).find_map(|_| {
        let mut mono = Command::new("mono");
        mono.arg(folder.join("touch.exe")).args(endpoints).arg("main").args(place).arg(identity);
        let said = run(mono.env("LD_LIBRARY_PATH", folder));
        println!("{identity}\n{said}");
        (number(&said, "most")? > 0.3 && number(&said, "lowest")? < 0.099 && said.contains("Engaged")).then_some(said)
    });
    let said = pressed.expect("pressed ten times, and never felt and seen");
    assert!(said.contains(concat!("library ", env!("CARGO_PKG_VERSION"))), "{said}");
    assert!(number(&said, "most").unwrap() < 3.4 && number(&said, "lowest").unwrap() > 0.05, "{said}");
    assert!(said.contains("Held and Engaged") && said.contains("clients 1"), "{said}");
    assert!(number(&said.replace(", triangles", "\ntriangles"), "vertices").unwrap() > 100.0, "{said}");
    assert!(said.contains("refused: ") && said.contains("no such tool"), "{said}");
}
