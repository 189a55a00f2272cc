//! The packages: made by one command, installed where nothing else of ours is, and used from there. The wheel has a test of its
//! own, `python.rs`.
#![cfg(target_os = "linux")]

#[path = "../clients/sdk/tests/c_program/mod.rs"]
mod c_program;
#[path = "common/random.rs"]
mod random;
#[path = "common/served.rs"]
mod served;

use c_program::{Linked, library, run};
use served::Served;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

const VERSION: &str = env!("CARGO_PKG_VERSION");

/// True where `program` can be run; else it says what skips.
fn is_there(program: &str, what: &str) -> bool {
    let found = Command::new(program).arg("--version").output().is_ok_and(|output| output.status.success());
    if !found {
        println!("skipped: {program} is not there, which {what} needs");
    }
    found
}

/// The only file in `folder` whose name ends like this.
fn package(folder: &Path, end: &str) -> PathBuf {
    let files = fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path());
    let found: Vec<PathBuf> = files.filter(|path| path.to_string_lossy().ends_with(end)).collect();
    assert_eq!(found.len(), 1, "{end}: {found:?}");
    found[0].clone()
}

fn unpack(archive: &Path, folder: &Path) {
    fs::create_dir_all(folder).unwrap();
    run(Command::new("tar").arg("--extract").arg("--file").arg(archive).arg("--directory").arg(folder));
}

#[test]
fn packages_are_made_by_one_command_and_work_where_they_are_installed() {
    if !is_there("dpkg-deb", "the package for Debian") {
        return;
    }
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let folder = tempfile::tempdir().unwrap();
    let (built, out) = (folder.path().join("built"), folder.path().join("out"));
    // What the tests were built with.
    fs::create_dir(&built).unwrap();
    let program = Path::new(env!("CARGO_BIN_EXE_palpate")).to_owned();
    for (file, name) in [
        (program, "palpate"),
        (library(Linked::Shared), "libpalpate_sdk.so"),
        (library(Linked::Static), "libpalpate_sdk.a"),
    ] {
        std::os::unix::fs::symlink(file, built.join(name)).unwrap();
    }
    let said = run(Command::new(root.join("clients/package")).arg(&out).arg(&built));
    assert_eq!(said.lines().filter(|line| line.contains(VERSION) && Path::new(line).exists()).count(), 4, "{said}");

    let installed = debian(&package(&out, ".deb"), &folder.path().join("debian"));
    c(&package(&out, ".tar.gz"), &folder.path().join("c"), &installed);
    npm(&package(&out, &format!("palpate-client-{VERSION}.tgz")), &folder.path().join("npm"));
    unity(&package(&out, &format!("org.palpate.client-{VERSION}.tgz")), &folder.path().join("unity"));
}

/// Installs the program into a root of its own, with a list of packages of its own; where it is.
fn debian(package: &Path, root: &Path) -> PathBuf {
    let state = root.join("var/lib/dpkg");
    for made in ["updates", "info"] {
        fs::create_dir_all(state.join(made)).unwrap();
    }
    fs::write(state.join("status"), "").unwrap();
    let dpkg = |arguments: &[&str]| {
        let mut dpkg = Command::new("dpkg");
        // In this root there is no C library; the one of this machine does.
        dpkg.arg("--root").arg(root).args(["--force-depends", "--force-not-root", "--log=/dev/null"]);
        run(dpkg.args(arguments))
    };
    dpkg(&["--install", package.to_str().unwrap()]);
    let listed = dpkg(&["--status", "palpate"]);
    assert!(
        listed.contains("Status: install ok installed") && listed.contains(&format!("Version: {VERSION}")),
        "{listed}"
    );
    let installed = root.join("usr/bin/palpate");
    let said = run(Command::new(&installed).arg("--version"));
    assert_eq!(said.trim(), format!("palpate {VERSION}"));
    installed
}

/// Builds an example with what pkg-config says of the archive, and touches a body that the installed program serves.
fn c(archive: &Path, folder: &Path, program: &Path) {
    unpack(archive, folder);
    let inside = fs::read_dir(folder).unwrap().next().unwrap().unwrap().path();
    // Of what the tests are built with, which checks itself.
    for (name, most) in [("libpalpate_sdk.so", 15_000_000), ("libpalpate_sdk.a", 25_000_000)] {
        let size = inside.join("lib").join(name).metadata().unwrap().len();
        println!("{name}: {:.1} MB", size as f64 / 1e6);
        assert!(size < most, "stripped, and no more than that: {size}");
    }
    let mut flags = vec![format!("-I{}", inside.join("include").display())];
    flags.extend([format!("-L{}", inside.join("lib").display()), "-lpalpate_sdk".to_owned()]);
    if is_there("pkg-config", "the file for it") {
        let mut ask = Command::new("pkg-config");
        let said =
            run(ask.args(["--cflags", "--libs", "palpate"]).env("PKG_CONFIG_PATH", inside.join("lib/pkgconfig")));
        flags = said.split_whitespace().map(str::to_owned).collect();
    }
    // With the shared library, then with the static one.
    let archive = inside.join("lib/libpalpate_sdk.a").display().to_string();
    let include = format!("-I{}", inside.join("include").display());
    let server = Served::start(program);
    for flags in [flags, [&include[..], &archive, "-lpthread", "-ldl"].map(String::from).into()] {
        let touch = folder.join("touch");
        let mut compile = Command::new("cc");
        compile.arg("-std=c99").arg(inside.join("examples/touch.c")).arg("-o").arg(&touch);
        run(compile.args(flags).arg("-lm"));
        // Far above the body: what is felt is tried elsewhere.
        let mut touch = Command::new(&touch);
        touch.args(&server.endpoints).args(["main", "0.05", "0.05", "0.2"]).env("LD_LIBRARY_PATH", inside.join("lib"));
        let said = run(&mut touch);
        assert!(said.contains("session main: cube, 1 tools") && said.contains(&format!("library {VERSION}")), "{said}");
    }
}

/// As the guide says to build it, which takes minutes.
#[test]
fn without_certificates_the_libraries_take_less() {
    if !random::whole() || !is_there("dpkg-deb", "the package for Debian") {
        return;
    }
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let folder = tempfile::tempdir().unwrap();
    let (built, out) = (folder.path().join("library"), folder.path().join("out"));
    let mut build = Command::new(env!("CARGO"));
    build.args(["build", "--profile", "library", "--locked", "-p", "palpate-sdk", "--no-default-features"]);
    run(build.current_dir(root).arg("--target-dir").arg(folder.path()));
    std::os::unix::fs::symlink(env!("CARGO_BIN_EXE_palpate"), built.join("palpate")).unwrap();
    run(Command::new(root.join("clients/package")).arg(&out).arg(&built));
    let inside = folder.path().join("c");
    unpack(&package(&out, ".tar.gz"), &inside);
    let inside = fs::read_dir(inside).unwrap().next().unwrap().unwrap().path();
    for (name, most) in [("libpalpate_sdk.so", 12_000_000), ("libpalpate_sdk.a", 18_000_000)] {
        let size = inside.join("lib").join(name).metadata().unwrap().len();
        println!("{name}: {:.1} MB", size as f64 / 1e6);
        assert!(size < most, "{size}");
    }
}

/// Decodes the vectors of the contract with the package as node finds it.
fn npm(archive: &Path, folder: &Path) {
    if !is_there("node", "the package of the decoder") {
        return;
    }
    unpack(archive, &folder.join("node_modules"));
    fs::rename(folder.join("node_modules/package"), folder.join("node_modules/palpate-client")).unwrap();
    let about = fs::read_to_string(folder.join("node_modules/palpate-client/package.json")).unwrap();
    let about: serde_json::Value = serde_json::from_str(&about).unwrap();
    assert_eq!((&about["name"], &about["version"]), (&"palpate-client".into(), &VERSION.into()));
    fs::write(
        folder.join("decode.mjs"),
        "import assert from 'node:assert/strict';
import { readFileSync } from 'node:fs';
import { Decoder, FRAME, Surface, decode } from 'palpate-client';
const vectors = JSON.parse(readFileSync(process.argv[2], 'utf8'));
const bytes = (text) => new Uint8Array(Buffer.from(text, 'hex'));
const surface = new Surface(vectors.topology.map(bytes)), decoder = new Decoder(surface);
const positions = new Float32Array(3 * surface.vertices);
for (const frame of vectors.frames) {
    assert.equal(decoder.take(decode(bytes(frame.message), FRAME), positions).sequence, frame.sequence);
    assert.deepEqual([...positions], frame.positions.flat());
}
console.log(vectors.frames.length, 'frames');
",
    )
    .unwrap();
    let vectors = Path::new(env!("CARGO_MANIFEST_DIR")).join("proto/vectors/surface.json");
    let said = run(Command::new("node").arg("decode.mjs").arg(vectors).current_dir(folder));
    assert_eq!(said.trim(), "3 frames");
}

/// What Unity's package manager and importer go by: a manifest, and a name in a .meta file for each thing.
fn unity(archive: &Path, folder: &Path) {
    unpack(archive, folder);
    let package = folder.join("package");
    let about: serde_json::Value =
        serde_json::from_str(&fs::read_to_string(package.join("package.json")).unwrap()).unwrap();
    assert_eq!(about["version"], VERSION);
    assert!(package.join("Runtime/Plugins/libpalpate_sdk.so").exists());
    let (mut folders, mut names) = (vec![package.clone()], std::collections::BTreeSet::new());
    while let Some(folder) = folders.pop() {
        for path in fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()) {
            if path.is_dir() {
                folders.push(path.clone());
            }
            // Unity does not look at folders that end in a tilde, but into them where a sample is taken.
            let name = path.file_name().unwrap().to_str().unwrap().to_owned();
            let hidden = name.ends_with(".meta") || name.ends_with('~') || path.parent().unwrap().ends_with("Samples~");
            if !hidden {
                let meta = fs::read_to_string(format!("{}.meta", path.display()));
                let meta = meta.unwrap_or_else(|e| panic!("{}.meta: {e}", path.display()));
                assert!(names.insert(meta), "{}: its name is another's", path.display());
            }
        }
    }
    // The scene of the sample refers to its script by that name.
    let sample = package.join("Samples~/Touch");
    let meta = fs::read_to_string(sample.join("TouchSample.cs.meta")).unwrap();
    let guid = meta.split("guid: ").nth(1).unwrap().trim();
    assert!(fs::read_to_string(sample.join("Touch.unity")).unwrap().contains(guid));
}
