//! The paper [DDCB01], claim by claim: what it says, what its printed method does in plain code, and what the shipped core
//! does beside it.
//!
//! Each claim is judged by numbers that are computed where it is written; nothing here is set so that one holds. One that
//! does not is shown as such, in the table on top of the page.
//!
//! | module | claims |
//! |---|---|
//! | [`swings`] | 3.1, fig. 4 to 6: laws and resolutions |
//! | [`mixes`] | 2.3, 3.1, 6: levels mixed in one body, without damping |
//! | [`modes`] | abstract: damped modes are nearly unchanged from level to level |
//! | [`indicators`] | 3.3, eq. 9: γ tells where resolution is wanted |
//! | [`tool_loop`] | 3.3, 4.2, fig. 7: the loop under a tool |
//! | [`holding`] | 4.2: the response force, and its areas |
//! | [`releases`] | 5: oscillations when the tool is removed |
//! | [`behaviours`] | 5, fig. 8: soft to stiff |
//! | [`machines`] | 3.3, 5: a guaranteed rate |
//! | [`gain`] | 5: five to twenty times faster |

pub mod behaviours;
pub mod gain;
pub mod holding;
pub mod indicators;
pub mod machines;
pub mod mixes;
pub mod modes;
pub mod releases;
pub mod swings;
pub mod tool_loop;

use super::Progress;
use std::io::Result;
use std::path::Path;

/// Whether a claim holds, by what was measured.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Verdict {
    /// It does.
    pub holds: bool,
    /// The numbers that say so, in one sentence.
    pub because: String,
}

impl Verdict {
    /// It holds when `holds`, `because` of these numbers.
    pub fn new(holds: bool, because: impl Into<String>) -> Self {
        Self { holds, because: because.into() }
    }

    fn word(&self) -> &'static str {
        if self.holds { "holds" } else { "**does not hold**" }
    }
}

/// One claim of the paper.
#[derive(Clone, Debug)]
pub struct Claim {
    /// Where the paper says it.
    pub section: &'static str,
    /// What it says, in one sentence.
    pub says: &'static str,
    /// Tables and sentences, as Markdown.
    pub measured: String,
    /// Name of a picture (without `.png`), and what it shows.
    pub picture: Option<(&'static str, String)>,
    /// Of the method as printed, in plain code; `None` where only the core was tried.
    pub printed: Option<Verdict>,
    /// Of the core; `None` where only the printed method was tried.
    pub shipped: Option<Verdict>,
}

/// A page of claims, as Markdown: a table of verdicts, then each claim with what was measured.
pub fn page(claims: &[Claim]) -> String {
    let failing =
        |of: fn(&Claim) -> &Option<Verdict>| claims.iter().filter(|c| of(c).as_ref().is_some_and(|v| !v.holds)).count();
    let tried = |of: fn(&Claim) -> &Option<Verdict>| claims.iter().filter(|c| of(c).is_some()).count();
    let mut text = format!(
        "[DDCB01] claim by claim. Of the method as printed {} of {} do not hold, of the shipped core {} of {}.\n\n\
         | | claim | section | as printed | as shipped |\n|---|---|---|---|---|\n",
        failing(|c| &c.printed),
        tried(|c| &c.printed),
        failing(|c| &c.shipped),
        tried(|c| &c.shipped),
    );
    let word = |verdict: &Option<Verdict>| verdict.as_ref().map_or("–", Verdict::word);
    for (i, c) in claims.iter().enumerate() {
        let says = c.says.replace('|', "\\|");
        text += &format!("| {} | {says} | {} | {} | {} |\n", i + 1, c.section, word(&c.printed), word(&c.shipped));
    }
    for (i, c) in claims.iter().enumerate() {
        text += &format!("\n### Claim {}: {} [{}]\n\n", i + 1, c.says, c.section);
        for (whose, verdict) in [("As printed", &c.printed), ("As shipped", &c.shipped)] {
            if let Some(verdict) = verdict {
                text += &format!("- {whose} it {}: {}.\n", verdict.word(), verdict.because);
            }
        }
        text += &format!("\n{}\n", c.measured.trim_end());
        if let Some((name, shows)) = &c.picture {
            text += &format!("\n![{shows}]({name}.png)\n");
        }
    }
    text
}

/// A module's claims, measured; its pictures and tables go into the folder.
type Part = fn(&Path, Progress) -> Result<Vec<Claim>>;

/// All claims, measured.
///
/// # Errors
/// When a body cannot be prepared or a picture not be written.
pub fn claims(out: &Path, progress: Progress) -> Result<String> {
    let parts: [Part; 10] = [
        swings::claims,
        mixes::claims,
        modes::claims,
        indicators::claims,
        tool_loop::claims,
        holding::claims,
        releases::claims,
        behaviours::claims,
        machines::claims,
        gain::claims,
    ];
    let mut all = Vec::new();
    for part in parts {
        all.extend(part(out, progress)?);
    }
    Ok(page(&all))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_claim_that_fails_is_counted_and_shown_on_top() {
        let claim = |holds: bool| Claim {
            section: "3.1",
            says: "Grass is green",
            measured: "a table".into(),
            picture: Some(("grass", "grass".into())),
            printed: Some(Verdict::new(holds, "it is blue")),
            shipped: None,
        };
        let text = page(&[claim(true), claim(false)]);
        assert!(text.contains("printed 1 of 2 do not hold, of the shipped core 0 of 0"), "{text}");
        assert!(text.contains("| 2 | Grass is green | 3.1 | **does not hold** | – |"), "{text}");
        assert!(text.contains("- As printed it **does not hold**: it is blue.\n\na table\n\n![grass](grass.png)"));
    }
}
