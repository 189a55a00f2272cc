//! Places that results go to, tried before the work that takes time.

use crate::output;
use anyhow::{Context, bail};
use std::fs::{self, OpenOptions};
use std::io::ErrorKind;
use std::path::Path;

/// Fails, with a remedy, unless a file can be written at `path`, the value of the option `option`, that is none of `inputs`.
/// Changes nothing: a file that exists keeps its content, and one that does not is gone again.
///
/// # Errors
/// It is an input, or cannot be written; then an [`std::io::Error`] is among the causes.
pub fn file<'a>(option: &str, path: &Path, inputs: impl IntoIterator<Item = &'a Path>) -> anyhow::Result<()> {
    if let Some(input) = inputs.into_iter().find(|input| output::same_file(path, input)) {
        bail!(
            "{option} {}: this is the file that is read ({}), which would be lost. Remedy: give another name",
            path.display(),
            input.display()
        );
    }
    let beside = |path: &Path| output::beside(path, 0o600).map(drop);
    let tried = match fs::metadata(path) {
        Ok(found) if found.is_dir() => OpenOptions::new().append(true).open(path).map(drop),
        Ok(found) if found.is_file() => {
            let place = fs::canonicalize(path);
            OpenOptions::new().append(true).open(path).and_then(|_| beside(&place?))
        }
        // A pipe or a device: opening it would be felt at its other end.
        Ok(_) => Ok(()),
        Err(_) => OpenOptions::new().write(true).create_new(true).open(path).and_then(|_| fs::remove_file(path)),
    };
    let Err(e) = tried else { return Ok(()) };
    let folder = path.parent().filter(|f| !f.as_os_str().is_empty()).unwrap_or(Path::new(".")).display();
    let remedy = match e.kind() {
        ErrorKind::NotFound => format!("make the folder {folder} first, or name a file in one that exists"),
        ErrorKind::NotADirectory => format!("{folder} is no folder: name a file in one"),
        ErrorKind::IsADirectory => "this is a folder: name a file in it".to_owned(),
        _ => format!("name a file in a folder that you may write to; {folder} is none"),
    };
    let what = format!("{option} {}: cannot be written: {e}. Remedy: {remedy}", path.display());
    Err(e).context(what)
}

/// As [`file`], for a file that is not there yet: a recording takes the place of nothing.
///
/// # Errors
/// There is something at `path`, or it cannot be written.
pub fn new_file<'a>(option: &str, path: &Path, inputs: impl IntoIterator<Item = &'a Path>) -> anyhow::Result<()> {
    file(option, path, inputs)?;
    if fs::symlink_metadata(path).is_ok() {
        bail!("{option} {}: is there already. Remedy: give another name, or remove it first", path.display());
    }
    Ok(())
}

/// Makes the folder at `path`, the value of the option `option`, where there is none yet; fails, with a remedy, unless
/// files can be written into it.
///
/// # Errors
/// Those of the file system.
pub fn folder(option: &str, path: &Path) -> anyhow::Result<()> {
    let probe = path.join(".palpate-writable");
    let tried = fs::create_dir_all(path)
        .and_then(|()| OpenOptions::new().write(true).create(true).truncate(true).open(&probe))
        .and_then(|_| fs::remove_file(&probe));
    let Err(e) = tried else { return Ok(()) };
    let remedy = "give a folder that you may write to, or that can be made; it must not be a file";
    let what = format!("{option} {}: cannot write into this folder: {e}. Remedy: {remedy}", path.display());
    Err(e).context(what)
}
