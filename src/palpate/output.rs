//! Files that come to be as a whole: written beside their place, and put there when all of it is written.

use std::fs::{self, File, Permissions};
use std::io::{self, BufWriter, Write};
use std::os::unix::fs::{MetadataExt, PermissionsExt};
use std::path::{Path, PathBuf};
use tempfile::NamedTempFile;

/// A file being written. Until [`Output::finish`] what was at its place before stays; without it nothing is left behind.
pub struct Output(Target);

enum Target {
    /// Beside its place.
    Beside(BufWriter<NamedTempFile>, PathBuf),
    /// A pipe or a device, which nothing else can be put in the place of.
    Through(BufWriter<File>),
}

impl Output {
    /// Begins the file at `path`; where a link is, the file that it leads to.
    ///
    /// # Errors
    /// Those of the file system.
    pub fn create(path: &Path) -> io::Result<Self> {
        let found = fs::metadata(path).ok();
        if found.as_ref().is_some_and(|found| !found.is_file() && !found.is_dir()) {
            return Ok(Self(Target::Through(BufWriter::new(File::options().write(true).open(path)?))));
        }
        let place = if found.is_some() { fs::canonicalize(path)? } else { path.to_owned() };
        let mode = found.map_or(0o666, |found| found.permissions().mode());
        Ok(Self(Target::Beside(BufWriter::new(beside(&place, mode)?), place)))
    }

    /// Writes out what is left and puts the file in its place.
    ///
    /// # Errors
    /// Those of the file system; what was in its place is then still there.
    pub fn finish(self) -> io::Result<()> {
        match self.0 {
            Target::Through(mut file) => file.flush(),
            Target::Beside(file, place) => {
                let file = file.into_inner()?;
                file.as_file().sync_all()?;
                file.persist(place)?;
                Ok(())
            }
        }
    }
}

impl Write for Output {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        match &mut self.0 {
            Target::Beside(file, _) => file.write(bytes),
            Target::Through(file) => file.write(bytes),
        }
    }

    fn flush(&mut self) -> io::Result<()> {
        match &mut self.0 {
            Target::Beside(file, _) => file.flush(),
            Target::Through(file) => file.flush(),
        }
    }
}

/// Writes `bytes` as the file at `path`.
///
/// # Errors
/// Those of the file system; what was there before is then still there.
pub fn write(path: &Path, bytes: &[u8]) -> io::Result<()> {
    let mut output = Output::create(path)?;
    output.write_all(bytes)?;
    output.finish()
}

/// A file beside `place`, of the permissions `mode` less what the process masks, which is gone again unless it is kept.
///
/// # Errors
/// Those of the file system.
pub fn beside(place: &Path, mode: u32) -> io::Result<NamedTempFile> {
    let folder = place.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
    tempfile::Builder::new().prefix(".palpate-").permissions(Permissions::from_mode(mode & 0o777)).tempfile_in(folder)
}

/// True when both paths lead to one file.
pub fn same_file(a: &Path, b: &Path) -> bool {
    let id = |path| fs::metadata(path).ok().map(|found| (found.dev(), found.ino()));
    id(a).is_some_and(|a| Some(a) == id(b))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_is_replaced_as_a_whole_or_not_at_all_and_nothing_else_is_left() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a");
        let names = || fs::read_dir(folder.path()).unwrap().count();
        write(&path, b"old").unwrap();
        let mut half = Output::create(&path).unwrap();
        half.write_all(b"new").unwrap();
        drop(half);
        assert_eq!((fs::read(&path).unwrap(), names()), (b"old".to_vec(), 1));
        fs::set_permissions(&path, Permissions::from_mode(0o640)).unwrap();
        let link = folder.path().join("link");
        std::os::unix::fs::symlink(&path, &link).unwrap();
        write(&link, b"new").unwrap();
        assert_eq!((fs::read(&path).unwrap(), names()), (b"new".to_vec(), 2));
        assert_eq!(fs::metadata(&path).unwrap().permissions().mode() & 0o777, 0o640);
        assert!(fs::symlink_metadata(&link).unwrap().is_symlink() && same_file(&link, &path));
        // As others make files.
        fs::write(folder.path().join("plain"), "").unwrap();
        let mode = |name: &str| fs::metadata(folder.path().join(name)).unwrap().permissions().mode();
        write(&folder.path().join("fresh"), b"").unwrap();
        assert_eq!(mode("fresh"), mode("plain"));
    }

    #[test]
    fn a_full_device_is_an_error() {
        let full = Path::new("/dev/full");
        if full.exists() {
            assert!(write(full, b"x").is_err());
        }
        write(Path::new("/dev/null"), b"x").unwrap();
    }
}
