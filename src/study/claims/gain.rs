//! Section 5: "the speedup factor … ranges between 5 and 20 on our simple examples", against a fixed fine discretisation.

use super::{Claim, Verdict};
use crate::Progress;
use crate::plot::table;
use crate::touch::{cube_stroke, error, stroke};
use palpate_core::adaptation::Adaptivity;
use palpate_core::math::Real;
use std::io::Result;
use std::path::Path;

/// Spacings of two cubes of 0.1 m [m].
const CUBES: [(&str, &[Real]); 2] = [("2 k nodes", &[0.032, 0.018, 0.011]), ("5 k nodes", &[0.030, 0.016, 0.0082])];
/// The force may be off by this part.
const ERROR: Real = 0.05;

/// The claim on speed.
///
/// # Errors
/// When a cube cannot be prepared.
pub fn claims(out: &Path, progress: Progress) -> Result<Vec<Claim>> {
    let (mut rows, mut gains) = (Vec::new(), Vec::new());
    for (name, spacings) in CUBES {
        let on = cube_stroke(spacings)?;
        let finest = on.body.finest();
        let reference = stroke(&on, None, finest, &format!("cube of {name}: uniform"), progress)?;
        let adaptivity = Adaptivity { reach: 0.7, ..Adaptivity::default() };
        let run = stroke(&on, Some(adaptivity), 0, &format!("cube of {name}: adaptive"), progress)?;
        let off = error(&run, &reference);
        let gain =
            [reference.global / run.evaluations, reference.evaluations / run.evaluations, reference.wall / run.wall];
        rows.push(vec![
            on.body.nodes_of(finest).len().to_string(),
            format!("{:.0}", run.elements),
            format!("{:.1} %", 100.0 * off),
            format!("{:.1}", gain[0]),
            format!("{:.1}", gain[1]),
            format!("{:.1}", gain[2]),
        ]);
        gains.push((off, gain));
    }
    let header = [
        "nodes, finest",
        "elements used",
        "force error, rms",
        "evaluations, against one step for all",
        "against own steps",
        "time",
    ];
    let list = |i: usize| gains.iter().map(|(_, g)| format!("{:.0}", g[i])).collect::<Vec<_>>().join(" and ");
    Ok(vec![Claim {
        section: "5",
        says: "Adaptive resolution is 5 to 20 times faster than a fixed fine discretisation",
        measured: format!(
            "A ball pressed in and stroked over a cube, times fewer; study `speed` has more and larger bodies. The paper's \
             classical technique steps all nodes alike.\n\n{}",
            table(out, "gain", &header, &rows)?
        ),
        picture: None,
        printed: None,
        shipped: Some(Verdict::new(
            gains.iter().all(|(off, gain)| *off < ERROR && gain[0] >= 5.0),
            format!(
                "against one step for all it needs {} times fewer evaluations, against a step for each element {}, in time {}; \
                 the force is off by less than {:.0} %",
                list(0),
                list(1),
                list(2),
                (100.0 * gains.iter().map(|g| g.0).fold(0.0, Real::max)).ceil()
            ),
        )),
    }])
}
