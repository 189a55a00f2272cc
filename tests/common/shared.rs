//! Meshes and references that are not part of the project: a folder `shared` beside it, where there is one.

use std::io::Write;
use std::path::{Path, PathBuf};

/// The file or folder `name` of `../shared`, seen from the top of the project. Where it is not there `None`, and a line on
/// standard error, which shows in the output of tests that pass, too, names the test that has been skipped.
pub fn shared(name: &str) -> Option<PathBuf> {
    let top = Path::new(env!("CARGO_MANIFEST_DIR")).ancestors().find(|folder| folder.join("Cargo.lock").exists());
    let path = top.unwrap_or(Path::new(".")).join("../shared").join(name);
    if path.exists() {
        return Some(path);
    }
    let thread = std::thread::current();
    // Not by a macro: what those print is kept from sight unless the test fails.
    let _ = writeln!(std::io::stderr(), "skipped: {} needs ../shared/{name}", thread.name().unwrap_or("a test"));
    None
}
