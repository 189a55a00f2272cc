//! The paper's figures, the printed variants and the comparisons behind what the project ships, in plain code off the
//! hot path.
//!
//! `cargo run --release -p palpate-study -- list` names them, `-- all` runs them all and writes `REPORT.md`. It may
//! use all the rest but the server and recordings, and the clients; nothing uses it.
//!
//! | module | is |
//! |---|---|
//! | [`laws`] | the laws of section 3.1 of the paper, and two later ones, on one mesh |
//! | [`oscillate`] | figures 4 to 6: one cube, three resolutions, every law |
//! | [`levels`] | independent levels and sets of active nodes, numbered through |
//! | [`rows`] | where interface nodes are: hosts with substitution, or moving least squares |
//! | [`coupling`] | levels in one body: by forces as printed, by energy as shipped |
//! | [`patch`] | the interface patch test and weights that come nearer to passing it |
//! | [`printed`] | the method as printed: steps per node, the filter of eq. 11, the criterion of eq. 9 |
//! | [`compare`] | the tables: couplings, rows, weights |
//! | [`press`] | a punch pressed deep into a cube, under every law |
//! | [`indentation`] | a ball in a block against the continuum: the dent below the mesh's size, 'move and hold' |
//! | [`relax`] | bodies brought to rest |
//! | [`touch`] | the core under a tool: error against cost, a cut budget, the paper's figure 8 |
//! | [`lockstep`] | hands on one body, with device, client library and network in one loop, in simulated time |
//! | [`stability`] | how stiff a body may be before a hand far away shakes |
//! | [`plot`] | pictures and tables |
//! | [`report`] | what all of them found, in one file |

#![allow(rustdoc::broken_intra_doc_links, reason = "units stand in square brackets, as in `[m]`")]

pub mod compare;
pub mod coupling;
pub mod indentation;
pub mod laws;
pub mod levels;
pub mod lockstep;
pub mod oscillate;
pub mod patch;
pub mod plot;
pub mod press;
pub mod printed;
pub mod relax;
pub mod report;
pub mod rows;
pub mod stability;
pub mod touch;

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
pub const STUDIES: [Study; 12] = [
    Study { name: "laws", about: "figures 4, 5 and 6 of the paper: laws and resolutions", work: oscillate::figures },
    Study { name: "depth", about: "force against depth of a punch, under every law", work: press::depth },
    Study {
        name: "couplings",
        about: "coupling by forces (printed) and by energy on the same active sets",
        work: compare::couplings,
    },
    Study { name: "rows", about: "interface rows: hosts against moving least squares", work: compare::rows_compared },
    Study {
        name: "patch",
        about: "interface patch test and force of a press: four kinds of weights",
        work: compare::patch_tests,
    },
    Study { name: "steps", about: "steps per node and the filter of eq. 10 and 11", work: printed::steps },
    Study { name: "adaptive", about: "splitting and merging by eq. 9, as printed", work: printed::adaptive },
    Study {
        name: "speed",
        about: "error of the tool force against cost, adaptive against uniform",
        work: touch::speed,
    },
    Study {
        name: "indentation",
        about: "a ball in a block: the dent below the mesh's size, and 'move and hold' as printed",
        work: indentation::indentation,
    },
    Study { name: "overload", about: "the work budget cut tenfold in a press", work: touch::overload },
    Study {
        name: "figure8",
        about: "figure 8 of the paper: soft to stiff, coloured by level",
        work: touch::stiffnesses,
    },
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

/// Runs the study `name`, or all of them, and writes its pictures and tables into the folder `out`, which is made if
/// need be; all of them write a [`report`], too. The text that comes back is for reading: every table, under the name of its
/// study.
pub fn run(name: Option<&str>, out: &Path, progress: Progress) -> Result<String, StudyError> {
    let chosen: Vec<Study> = STUDIES.into_iter().filter(|s| name.is_none_or(|n| n == s.name)).collect();
    if chosen.is_empty() {
        return Err(StudyError::Unknown { name: name.unwrap_or_default().into() });
    }
    let failed = |source| StudyError::Write { path: out.into(), source };
    std::fs::create_dir_all(out).map_err(failed)?;
    let (mut text, mut report) = (String::new(), report::head());
    for study in chosen {
        progress(study.about);
        let began = std::time::SystemTime::now();
        let tables = (study.work)(out, progress).map_err(failed)?;
        report += &report::section(&study, &tables, &report::pictures_since(out, began).map_err(failed)?);
        text += &format!("## {}: {}\n{tables}\n", study.name, study.about);
    }
    match name {
        Some(name) => std::fs::write(out.join(format!("{name}.txt")), &text),
        None => std::fs::write(out.join("REPORT.md"), report),
    }
    .map_err(failed)?;
    Ok(text)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_unknown_study_is_refused_with_the_names_of_the_known() {
        let error = run(Some("nonsense"), Path::new("/nowhere"), &|_| ()).unwrap_err();
        assert!(error.to_string().contains("laws, depth, couplings"));
    }
}
