//! What the studies found, in one file: `REPORT.md`, which nothing else quotes by hand.

use super::Study;
use palpate::realtime::scheduling::machine;
use std::io;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::SystemTime;

/// What stands above all sections.
const HEAD: &str = "# Report\n\nWritten by `palpate-study`, study by study; nothing in it is typed by hand. Each section names its run.\n";

/// Machine, version, commit, build and date of a run, as a line.
fn run() -> String {
    format!(
        "*{}; version {}, {}, {}; {}.*",
        machine(),
        env!("CARGO_PKG_VERSION"),
        commit().unwrap_or_else(|| "commit unknown".into()),
        if cfg!(debug_assertions) { "built with debug assertions, so times are longer" } else { "optimised" },
        humantime::format_rfc3339_seconds(SystemTime::now())
    )
}

/// The report `old`, which may be empty, with the `section` of the study `name` in place of the one that it had, in the order of
/// the studies.
pub fn with_section(old: &str, name: &str, section: &str) -> String {
    let begin = |name: &str| format!("\n## {name}: ");
    let start = |text: &str, name: &str| text.find(&begin(name));
    let mut text = HEAD.to_owned();
    for study in crate::STUDIES {
        if study.name == name {
            text += section;
        } else if let Some(from) = start(old, study.name) {
            let others = crate::STUDIES.iter().filter_map(|study| start(old, study.name));
            let to = others.filter(|other| *other > from).min().unwrap_or(old.len());
            text += &old[from..to];
        }
    }
    text
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
    let mut text = format!("\n## {}: {}\n\n{}\n\n{}\n", study.name, study.about, run(), found.trim_end());
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
        assert!(text.contains("; version 0.") && text.contains(" processors, ") && text.contains("; 20"), "{text}");
    }

    #[test]
    fn a_study_that_is_run_again_replaces_its_own_section_and_no_other() {
        let [first, second, third] = [0, 1, 2].map(|i| crate::STUDIES[i].name);
        let section = |name: &str, found: &str| format!("\n## {name}: it\n\n{found}\n");
        let mut report = String::new();
        for (name, found) in [(third, "old"), (first, "1"), (second, "2"), (third, "3")] {
            report = with_section(&report, name, &section(name, found));
        }
        let sections = [(first, "1"), (second, "2"), (third, "3")].map(|(name, found)| section(name, found));
        assert_eq!(report, format!("{HEAD}{}", sections.concat()));
    }
}
