//! The Python package: its wheel, built and installed in an environment of its own.
//!
//! It needs python3 with venv, and maturin (`pip install maturin`).

use std::path::{Path, PathBuf};
use std::process::Command;

/// Runs a command to its end; what it said, or a panic that shows it.
pub fn run(command: &mut Command) -> String {
    let output = command.output().unwrap_or_else(|e| panic!("{command:?}: {e}"));
    let said = [&output.stdout, &output.stderr].map(|bytes| String::from_utf8_lossy(bytes)).concat();
    assert!(output.status.success(), "{command:?}\n{said}");
    said
}

/// True when `command` can be run.
fn is_there(command: &mut Command) -> bool {
    command.output().is_ok_and(|output| output.status.success())
}

/// How to call maturin, where it is.
fn maturin() -> Option<Command> {
    let on_path = || Command::new("maturin");
    let of_python = || {
        let mut python = Command::new("python3");
        python.args(["-m", "maturin"]);
        python
    };
    if is_there(on_path().arg("--version")) {
        return Some(on_path());
    }
    is_there(of_python().arg("--version")).then(of_python)
}

/// The newest wheel in `folder`.
fn wheel(folder: &Path) -> PathBuf {
    let files = std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path());
    let wheels = files.filter(|path| path.extension().is_some_and(|e| e == "whl"));
    wheels.max_by_key(|path| path.metadata().unwrap().modified().unwrap()).expect("maturin makes a wheel")
}

/// Where the wheel, its environment and what it was built with are.
pub fn folder() -> PathBuf {
    Path::new(env!("CARGO_TARGET_TMPDIR")).join("python")
}

/// The Python of an environment that has the wheel of this source and what its tests need; `None`, and it says why, where
/// it cannot be made.
pub fn python() -> Option<PathBuf> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    if !is_there(Command::new("python3").args(["-c", "import venv, ensurepip"])) {
        println!("skipped: python3 with venv is not there (apt-get install python3-venv)");
        return None;
    }
    let Some(mut maturin) = maturin() else {
        println!("skipped: maturin is not there (pip install maturin)");
        return None;
    };
    let folder = folder();
    let (wheels, environment) = (folder.join("wheels"), folder.join("environment"));
    // As the program of the tests is built, so that their speeds can be compared, but in a folder of its own: built by itself the
    // package asks for other features, and the shared library's file, which has one name for all, would be replaced.
    let profile = if cfg!(debug_assertions) { "dev" } else { "release" };
    let target = folder.join("target");
    maturin.args(["build", "--locked", "--profile", profile, "--manifest-path", "clients/python/Cargo.toml", "--out"]);
    run(maturin.arg(&wheels).env("CARGO_TARGET_DIR", target).current_dir(root));
    if !environment.exists() {
        // Of the packages that the system's Python has, none is loaded again.
        run(Command::new("python3").args(["-m", "venv", "--system-site-packages"]).arg(&environment));
    }
    let python = environment.join("bin/python");
    let pip = |arguments: &[&str], wheel: &Path| {
        let wheel = format!("{}[test]", wheel.display());
        run(Command::new(&python).args(["-m", "pip", "install", "--quiet"]).args(arguments).arg(wheel));
    };
    let wheel = wheel(&wheels);
    pip(&[], &wheel);
    // The version is the same as ever.
    pip(&["--force-reinstall", "--no-deps"], &wheel);
    Some(python)
}
