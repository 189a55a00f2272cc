//! The paper's figures, the printed variants and the comparisons behind what the project ships, in plain code off the
//! hot path.
//!
//! `cargo run --release -p palpate-study -- list` names them, `-- all` runs them all and writes `REPORT.md`. It may
//! use all the rest but the server and recordings, and the clients; nothing uses it.
//!
//! | module | is |
//! |---|---|
//! | [`claims`] | the paper, claim by claim: as printed, and as shipped |
//! | [`laws`] | the laws of section 3.1 of the paper, and two later ones, on one mesh |
//! | [`oscillate`] | a cube that is let go, and what its swing tells |
//! | [`levels`] | independent levels and sets of active nodes, numbered through |
//! | [`loads`] | how levels agree, load by load |
//! | [`rows`] | where interface nodes are: hosts with substitution, or moving least squares |
//! | [`coupling`] | levels in one body: by forces as printed, by energy as shipped |
//! | [`drift`] | what becomes of the energy of a body that nothing damps |
//! | [`patch`] | the interface patch test and weights that come nearer to passing it |
//! | [`printed`] | the method as printed: steps per node, the filter of eq. 11, the criterion of eq. 9 |
//! | [`compare`] | the tables: rows, weights |
//! | [`press`] | a punch pressed deep into a cube, under every law |
//! | [`indentation`] | a ball in a block against the continuum: the dent below the mesh's size |
//! | [`slides`] | tools that slide over a block: how even the force is |
//! | [`relax`] | bodies brought to rest |
//! | [`trial`] | a body of the core with one ball |
//! | [`touch`] | the core under a tool: error against cost, a cut budget |
//! | [`lockstep`] | hands on one body, with device, client library and network in one loop, in simulated time |
//! | [`stability`] | how stiff a body may be before a hand far away shakes |
//! | [`plot`] | pictures and tables |
//! | [`report`] | what all of them found, in one file |

#![allow(rustdoc::broken_intra_doc_links, reason = "units stand in square brackets, as in `[m]`")]

pub mod claims;
pub mod compare;
pub mod coupling;
pub mod drift;
pub mod indentation;
pub mod laws;
pub mod levels;
pub mod loads;
pub mod lockstep;
pub mod oscillate;
pub mod patch;
pub mod plot;
pub mod press;
pub mod printed;
pub mod relax;
pub mod report;
pub mod rows;
pub mod slides;
pub mod stability;
pub mod touch;
pub mod trial;

use std::path::Path;

/// Told what a study is at, in a few words.
pub type Progress<'a> = &'a dyn Fn(&str);

/// A study by name.
#[derive(Clone, Copy)]
pub struct Study {
    /// What to ask for.
    pub name: &'static str,
    /// What it shows, in one line.
    pub about: &'static str,
    work: fn(&Path, Progress) -> std::io::Result<String>,
}

/// All studies, in the order in which they run.
pub const STUDIES: [Study; 11] = [
    Study { name: "claims", about: "the paper, claim by claim: as printed, and as shipped", work: claims::claims },
    Study {
        name: "loads",
        about: "levels under loads, of tetrahedra and of smoothed elements",
        work: loads::agreement,
    },
    Study { name: "depth", about: "force against depth of a punch, under every law", work: press::depth },
    Study { name: "rows", about: "interface rows: hosts against moving least squares", work: compare::rows_compared },
    Study {
        name: "patch",
        about: "interface patch test and force of a press: four kinds of weights",
        work: compare::patch_tests,
    },
    Study { name: "steps", about: "steps per node and the filter of eq. 10 and 11", work: printed::steps },
    Study {
        name: "speed",
        about: "error of the tool force against cost, adaptive against uniform",
        work: touch::speed,
    },
    Study {
        name: "indentation",
        about: "a ball in a block: the dent below the mesh's size",
        work: indentation::indentation,
    },
    Study { name: "slides", about: "tools that slide over a block: how even the force is", work: slides::slides },
    Study { name: "overload", about: "the work budget cut tenfold in a press", work: touch::overload },
    Study {
        name: "stability",
        about: "largest stable stiffness against network delay, by device and way of rendering",
        work: stability::map,
    },
];

/// Why a study did not run.
#[derive(Debug, thiserror::Error)]
pub enum StudyError {
    /// There is none of this name.
    #[error("there is no study '{name}': choose one of {}", STUDIES.map(|s| s.name).join(", "))]
    Unknown {
        /// As asked for.
        name: String,
    },
    /// A picture or table could not be written.
    #[error("{}: {source}", path.display())]
    Write {
        /// Where to.
        path: std::path::PathBuf,
        /// Why not.
        source: std::io::Error,
    },
}

/// Runs the study `name`, or all of them, and writes pictures, tables and a [`report`] into the folder `out`, which is made
/// if need be: `REPORT.md`, in which only what ran is new. What the studies found comes back, too.
pub fn run(name: Option<&str>, out: &Path, progress: Progress) -> Result<String, StudyError> {
    let chosen: Vec<Study> = STUDIES.into_iter().filter(|s| name.is_none_or(|n| n == s.name)).collect();
    if chosen.is_empty() {
        return Err(StudyError::Unknown { name: name.unwrap_or_default().into() });
    }
    let failed = |source| StudyError::Write { path: out.into(), source };
    std::fs::create_dir_all(out).map_err(failed)?;
    let (file, mut found_now) = (out.join("REPORT.md"), String::new());
    for study in chosen {
        progress(study.about);
        let began = std::time::SystemTime::now();
        let found = (study.work)(out, progress).map_err(failed)?;
        let mut pictures = report::pictures_since(out, began).map_err(failed)?;
        // Clocks of file systems are coarse: the last picture of the study before may be among them.
        pictures.retain(|picture| !report::shows(&found_now, picture));
        let section = report::section(&study, &found, &pictures);
        // Study by study: what ends early keeps what it has.
        let old = match std::fs::read_to_string(&file) {
            Ok(old) => old,
            Err(e) if e.kind() == std::io::ErrorKind::NotFound => String::new(),
            Err(e) => return Err(failed(e)),
        };
        std::fs::write(&file, report::with_section(&old, study.name, &section)).map_err(failed)?;
        found_now += &section;
    }
    Ok(found_now)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_unknown_study_is_refused_with_the_names_of_the_known() {
        let error = run(Some("nonsense"), Path::new("/nowhere"), &|_| ()).unwrap_err();
        assert!(error.to_string().contains("claims, loads, depth, rows"));
    }
}
