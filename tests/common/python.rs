//! The Python package in an environment of its own: as `cargo test` has built it, or, with `PALPATE_WHOLE` set, as the wheel that
//! maturin makes, which builds all that the package depends on once more.
//!
//! It needs python3 with venv; the wheel needs maturin (`pip install maturin`).

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

/// The newest file in `folder` whose name begins and ends like this.
fn newest(folder: &Path, begin: &str, end: &str) -> PathBuf {
    let files = std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path());
    let ours = files.filter(|path| {
        let name = path.file_name().unwrap().to_string_lossy();
        name.starts_with(begin) && name.ends_with(end)
    });
    ours.max_by_key(|path| path.metadata().unwrap().modified().unwrap()).expect("what was built is there")
}

/// The Python of an environment that has the package of this source and what its tests need, and where it may leave files;
/// `None`, and it says why, where it cannot be made.
pub fn python() -> Option<(PathBuf, PathBuf)> {
    if !is_there(Command::new("python3").args(["-c", "import venv, ensurepip"])) {
        println!("skipped: python3 with venv is not there (apt-get install python3-venv)");
        return None;
    }
    let whole = std::env::var_os("PALPATE_WHOLE").is_some();
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join(if whole { "wheel" } else { "package" });
    std::fs::create_dir_all(&folder).unwrap();
    let environment = folder.join("environment");
    if !environment.exists() {
        // Of the packages that the system's Python has, none is loaded again.
        run(Command::new("python3").args(["-m", "venv", "--system-site-packages"]).arg(&environment));
    }
    let python = environment.join("bin/python");
    match whole {
        true => install_wheel(&folder, &python)?,
        false => link(&folder, &python),
    }
    Some((python, folder))
}

fn pip(python: &Path, arguments: &[&str]) {
    run(Command::new(python).args(["-m", "pip", "install", "--quiet"]).args(arguments));
}

/// Has `python` find the sources, with the library that cargo built beside this test, as it builds every crate type of a library
/// that a test depends on.
fn link(folder: &Path, python: &Path) {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("clients/python");
    let project: toml::Table = std::fs::read_to_string(root.join("pyproject.toml")).unwrap().parse().unwrap();
    let project = &project["project"];
    let needed = [&project["dependencies"], &project["optional-dependencies"]["test"]];
    let needed: Vec<&str> =
        needed.iter().flat_map(|list| list.as_array().unwrap()).filter_map(|x| x.as_str()).collect();
    pip(python, &needed);
    let package = folder.join("built/palpate");
    let _ = std::fs::remove_dir_all(&package);
    std::fs::create_dir_all(&package).unwrap();
    for file in std::fs::read_dir(root.join("python/palpate")).unwrap().map(|entry| entry.unwrap().path()) {
        if file.is_file() {
            std::fs::copy(&file, package.join(file.file_name().unwrap())).unwrap();
        }
    }
    let test = std::env::current_exe().unwrap();
    let library = newest(test.parent().unwrap(), "libpalpate_python", ".so");
    std::fs::copy(library, package.join("_native.abi3.so")).unwrap();
    let paths = run(Command::new(python).args(["-c", "import sysconfig; print(sysconfig.get_path('purelib'))"]));
    std::fs::write(Path::new(paths.trim()).join("palpate.pth"), package.parent().unwrap().to_str().unwrap()).unwrap();
}

/// Installs the wheel that maturin makes; `None` where maturin is not there.
fn install_wheel(folder: &Path, python: &Path) -> Option<()> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let Some(mut maturin) = maturin() else {
        println!("skipped: maturin is not there (pip install maturin)");
        return None;
    };
    // As the program of the tests is built, so that their speeds can be compared, but in a folder of its own: built by itself the
    // package asks for other features.
    let profile = if cfg!(debug_assertions) { "dev" } else { "release" };
    let wheels = folder.join("wheels");
    maturin.args(["build", "--locked", "--profile", profile, "--manifest-path", "clients/python/Cargo.toml", "--out"]);
    run(maturin.arg(&wheels).env("CARGO_TARGET_DIR", folder.join("target")).current_dir(root));
    let wheel = newest(&wheels, "palpate", ".whl").display().to_string();
    pip(python, &[&format!("{wheel}[test]")]);
    // The version is the same as ever.
    pip(python, &["--force-reinstall", "--no-deps", &wheel]);
    Some(())
}
