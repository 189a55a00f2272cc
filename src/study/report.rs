//! What the studies found, in one file: `REPORT.md`, which nothing else quotes by hand.

use super::Study;
use palpate::realtime::scheduling::machine;
use std::io;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::SystemTime;

/// Title, machine, version, commit, build and date.
pub fn head() -> String {
    format!(
        "# Report\n\nWritten by `palpate-study`; nothing in it is typed by hand.\n\n- machine: {}\n- version: {}, {}\n- build: {}\n\
         - date: {}\n",
        machine(),
        env!("CARGO_PKG_VERSION"),
        commit().unwrap_or_else(|| "commit unknown".into()),
        if cfg!(debug_assertions) { "with debug assertions, so times are longer" } else { "optimised" },
        humantime::format_rfc3339_seconds(SystemTime::now())
    )
}

/// The commit of the folder that this runs in, and whether files differ from it.
fn commit() -> Option<String> {
    let git = |args: &[&str]| {
        let output = Command::new("git").args(args).output().ok().filter(|output| output.status.success())?;
        Some(String::from_utf8_lossy(&output.stdout).trim().to_owned())
    };
    let changed =
        if git(&["status", "--porcelain", "--untracked-files=no"])?.is_empty() { "" } else { " with changes" };
    Some(format!("commit {}{changed}", git(&["rev-parse", "--short", "HEAD"])?))
}

/// Whether `text` shows the `picture`.
pub fn shows(text: &str, picture: &Path) -> bool {
    text.contains(&format!("({})", picture.file_name().unwrap_or_default().to_string_lossy()))
}

/// What a study found, in Markdown, and those of the `pictures` that it does not show itself.
pub fn section(study: &Study, found: &str, pictures: &[PathBuf]) -> String {
    let mut text = format!("\n## {}: {}\n\n{}\n", study.name, study.about, found.trim_end());
    for picture in pictures.iter().filter(|picture| !shows(found, picture)) {
        let name = picture.file_stem().unwrap_or_default().to_string_lossy();
        let file = picture.file_name().unwrap_or_default().to_string_lossy();
        text += &format!("\n![{}]({file})\n", name.replace(['-', '_'], " "));
    }
    text
}

/// Pictures in `folder` that were written since `began`, by name.
///
/// # Errors
/// When the folder cannot be read.
pub fn pictures_since(folder: &Path, began: SystemTime) -> io::Result<Vec<PathBuf>> {
    let mut pictures = Vec::new();
    for entry in std::fs::read_dir(folder)? {
        let entry = entry?;
        let is_picture = entry.path().extension().is_some_and(|e| e == "png");
        // Clocks of file systems are coarse, by up to some ten milliseconds.
        let written = entry.metadata()?.modified()? + std::time::Duration::from_millis(50);
        if is_picture && written >= began {
            pictures.push(entry.path());
        }
    }
    pictures.sort();
    Ok(pictures)
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::time::Duration;

    #[test]
    fn a_section_shows_the_tables_of_a_study_and_the_pictures_that_it_wrote() {
        let folder = std::env::temp_dir().join(format!("palpate-report-{}", std::process::id()));
        std::fs::create_dir_all(&folder).unwrap();
        let began = SystemTime::now();
        for file in ["b_curve.png", "a.png", "table.csv"] {
            std::fs::write(folder.join(file), "x").unwrap();
        }
        let old = std::fs::File::create(folder.join("old.png")).unwrap();
        old.set_modified(began - Duration::from_secs(60)).unwrap();
        let pictures = pictures_since(&folder, began).unwrap();
        std::fs::remove_dir_all(&folder).unwrap();
        let text = section(&crate::STUDIES[0], "1 2 3\n\n![shown](a.png)\n", &pictures);
        assert!(text.contains("## claims: ") && text.contains("\n1 2 3\n"), "{text}");
        assert!(text.contains("![shown](a.png)\n\n![b curve](b_curve.png)"), "{text}");
        assert!(!text.contains("![a](a.png)") && !text.contains("old"), "{text}");
        assert!(head().contains("machine: ") && head().contains("date: 20"));
    }
}
