//! Section 5, figure 8: "changing the material's physical coefficients allows the simulation of a wide scope of material
//! behaviors", moduli "from 10 to 10⁶": one organ pressed and let go, in time.

use super::{Claim, Verdict};
use crate::Progress;
use crate::plot::{Chart, Coloured, Curve, Shape, charts, coloured, table};
use crate::touch::{Stroke, organ_stroke};
use crate::trial::{Trial, attached, detached, held_at};
use palpate_body::geometry::primitives::liver_surface;
use palpate_body::prepare::{Elements, Region, refit};
use palpate_core::adaptation::{Adaptivity, finest_steppable};
use palpate_core::ids::Vertex;
use palpate_core::math::{Bounds, Real, Vec3};
use palpate_core::model::step_class::TICK;
use palpate_core::model::{Body, Material};
use palpate_core::simulation::{Budget, Inputs, Simulation};
use rayon::prelude::*;
use std::io::{Error, Result};
use std::path::Path;
use std::sync::Arc;

/// A material.
#[derive(Clone, Copy, Debug)]
pub struct Behaviour {
    /// A word for it.
    pub name: &'static str,
    /// Shear modulus [Pa].
    pub mu: Real,
    /// Damping ratio of the slowest mode.
    pub zeta: Real,
}

/// From the softest to the stiffest that the paper names, ringing and sluggish.
pub const BEHAVIOURS: [Behaviour; 5] = [
    Behaviour { name: "slime", mu: 1e1, zeta: 0.3 },
    Behaviour { name: "jelly", mu: 1e3, zeta: 0.02 },
    Behaviour { name: "tissue", mu: 3e3, zeta: 0.3 },
    Behaviour { name: "rubber", mu: 1e5, zeta: 0.05 },
    Behaviour { name: "stiff", mu: 1e6, zeta: 0.05 },
];

/// When the ball is down and rests, before the stroke would begin [ticks].
const DOWN: u32 = 200;
/// When it is gone [ticks]; pictures so long after that, the first before it.
const GONE: u32 = 300;
const PICTURES: [u32; 4] = [299, 330, 420, 900];
const TICKS: u32 = 1300;

/// What one material did.
pub struct Shown {
    /// On the tool over time [N].
    pub force: Vec<(Real, Real)>,
    /// Dent of the place that was pressed over time [m].
    pub dent: Vec<(Real, Real)>,
    /// Finest level that can be stepped.
    pub usable: usize,
    /// Active nodes by level when pressed.
    pub active: Vec<u32>,
    /// The body was reset.
    pub restored: bool,
    pictures: Vec<Coloured>,
}

impl Shown {
    /// Largest force [N].
    pub fn peak(&self) -> Real {
        self.force.iter().map(|f| f.1).fold(0.0, Real::max)
    }

    /// Time after the release until less than `part` of the dent is left for the first time [s].
    pub fn recovers(&self, part: Real) -> Option<Real> {
        let gone = GONE as usize;
        let first = self.dent[gone - 1].1;
        self.dent[gone..].iter().find(|d| d.1 < part * first).map(|d| d.0 - self.dent[gone].0)
    }

    /// Times that the place passes its rest by more than a hundredth of the dent, after the release.
    pub fn passes(&self) -> usize {
        let gone = GONE as usize;
        let least = 0.01 * self.dent[gone - 1].1;
        let sides: Vec<bool> = self.dent[gone..].iter().filter(|d| d.1.abs() > least).map(|d| d.1 > 0.0).collect();
        sides.windows(2).filter(|two| two[0] != two[1]).count()
    }

    /// How far the place springs back beyond its rest, over the dent.
    pub fn overshoot(&self) -> Real {
        let gone = GONE as usize;
        -self.dent[gone..].iter().map(|d| d.1).fold(0.0, Real::min) / self.dent[gone - 1].1
    }
}

/// The organ that all are made from: levels are calibrated once.
///
/// # Errors
/// When it cannot be prepared.
pub fn organ(spacings: &[Real]) -> Result<Stroke> {
    organ_stroke(liver_surface(0.006), spacings, 2.9 * BEHAVIOURS[0].mu)
}

/// Presses the organ of this material with the ball of `on`, and lets go.
///
/// # Errors
/// When it cannot be refitted.
pub fn show(on: &Stroke, behaviour: &Behaviour, ticks: u32) -> Result<Shown> {
    let Bounds { low, high } = on.body.surface().bounds();
    let bed = Vec3::new(high.x, high.y, low.z + 0.45 * (high.z - low.z));
    let hold = Region { bounds: Bounds::new(low, bed), stiffness: None, exact: false };
    let material = Material::from_young(2.9 * behaviour.mu, 0.45, 1050.0);
    let copy = Body::from_bytes(on.body.bytes()).map_err(Error::other)?;
    let body =
        refit(copy, behaviour.name, material, &[], &[hold], Elements::Tetrahedra, behaviour.zeta, &mut |_, _, _| {});
    let body = Arc::new(body.map_err(Error::other)?);
    let usable = finest_steppable(&body);
    let adaptivity = Adaptivity { split: 0.05, ..Adaptivity::default() };
    let mut run = Trial::ball(on.radius, Some(adaptivity)).on_level(&body, 0)?;
    let below = on.place(DOWN) - Vec3::z() * on.radius;
    let rest = &body.surface().vertices;
    let aside = |v: &Vertex| (rest[v.index()] - below).norm();
    let place = body.vertices().min_by(|a, b| aside(a).total_cmp(&aside(b))).unwrap_or(Vertex::at(0));
    let mut shown = Shown { force: vec![], dent: vec![], usable, active: vec![], restored: false, pictures: vec![] };
    for tick in 0..ticks {
        let inputs = match tick {
            0 => attached(),
            GONE => detached(),
            t if t > GONE => Inputs::default(),
            _ => held_at(tick, on.place(tick.min(DOWN))),
        };
        let outputs = run.advance(&Inputs { budget: Budget::of(1_600_000), ..inputs });
        let time = Real::from(tick) * TICK;
        shown.restored |= outputs.restored;
        shown.force.push((time, outputs.tools[0].state.physical_force.norm()));
        if tick == GONE - 1 {
            shown.active = outputs.active[..body.levels().len()].to_vec();
        }
        shown.dent.push((time, rest[place.index()].z - run.mesh().vertex(place).z));
        if PICTURES.contains(&tick) {
            let when = if tick < GONE { "pressed".into() } else { format!("{} ms after release", tick + 1 - GONE) };
            let title = format!("{}, μ = {}: {when}", behaviour.name, pascal(behaviour.mu));
            shown.pictures.push(picture(&run, title, rest[place.index()]));
        }
    }
    Ok(shown)
}

fn pascal(mu: Real) -> String {
    match mu {
        mu if mu >= 1e6 => format!("{} MPa", 1e-6 * mu),
        mu if mu >= 1e3 => format!("{} kPa", 1e-3 * mu),
        mu => format!("{mu} Pa"),
    }
}

/// The surface around a `place` [m], with the level that each triangle hangs on.
fn picture(run: &Simulation, title: String, place: Vec3) -> Coloured {
    let (body, mesh) = (run.body(), run.mesh());
    let mut vertices = vec![Vec3::zeros(); body.surface().vertices.len()];
    mesh.skin(&mut vertices);
    let mut of_vertex = vec![0; vertices.len()];
    mesh.display_levels(body, &mut of_vertex);
    let level = |v: u32| usize::from(of_vertex[v as usize]);
    let triangles = body.surface().triangles.clone();
    let class = triangles.iter().map(|t| t.map(level).into_iter().max().unwrap_or(0)).collect();
    // From the front, well above, so that the place that is pressed shows.
    Coloured {
        shape: Shape { title, vertices, triangles },
        class,
        toward: Vec3::new(0.15, -0.75, 0.75),
        around: Some((place, 0.055)),
    }
}

/// The claim of figure 8.
///
/// # Errors
/// When a picture cannot be written.
pub fn claims(out: &Path, progress: Progress) -> Result<Vec<Claim>> {
    progress("figure 8: soft to stiff, pressed and let go");
    let on = organ(&[0.026, 0.015, 0.0085, 0.005])?;
    let all: Vec<Shown> = BEHAVIOURS.par_iter().map(|b| show(&on, b, TICKS)).collect::<Result<_>>()?;
    let mut rows = Vec::new();
    for (b, s) in BEHAVIOURS.iter().zip(&all) {
        rows.push(vec![
            b.name.into(),
            pascal(b.mu),
            b.zeta.to_string(),
            format!("{:.3e}", s.peak()),
            s.recovers(0.5).map_or("–".into(), |t| format!("{:.0} ms", 1e3 * t)),
            format!("{:.0} %", 100.0 * s.overshoot()),
            s.passes().to_string(),
            s.usable.to_string(),
            s.active.iter().map(u32::to_string).collect::<Vec<_>>().join(" + "),
            if s.restored { "yes".into() } else { "no".into() },
        ]);
    }
    let pictures: Vec<Coloured> = all.iter().flat_map(|s| s.pictures.clone()).collect();
    let legend = ["level 0", "level 1", "level 2", "level 3"];
    coloured(
        out,
        "figure_8",
        "Fig. 8: pressed 10 mm and let go, coloured by level of detail",
        &pictures,
        PICTURES.len(),
        &legend,
    )?;
    let curves = |of: &dyn Fn(&Shown) -> Vec<(Real, Real)>| {
        let one = |(b, s): (&Behaviour, &Shown)| Curve { name: b.name.into(), points: of(s), ..Curve::default() };
        BEHAVIOURS.iter().zip(&all).map(one).collect::<Vec<_>>()
    };
    let panels = [
        Chart {
            title: "force on the tool".into(),
            x_label: "time [s]".into(),
            y_label: "force [N]".into(),
            curves: curves(&|s| {
                s.force[..GONE as usize]
                    .iter()
                    .map(|(t, f)| (*t, f.max(1e-9).log10()))
                    .filter(|(_, f)| *f > -5.0)
                    .collect()
            }),
            powers: true,
            ..Chart::default()
        },
        Chart {
            title: "dent of the place that is pressed".into(),
            x_label: "time [s]".into(),
            y_label: "depth [mm]".into(),
            curves: curves(&|s| s.dent.iter().map(|(t, d)| (*t, 1e3 * d)).collect()),
            ..Chart::default()
        },
    ];
    charts(out, "behaviours", "Pressed for 0.3 s and let go: force and dent in time", &panels)?;
    let (softest, stiffest) = (&all[0], &all[BEHAVIOURS.len() - 1]);
    let decades = (stiffest.peak() / softest.peak()).log10();
    let passes = |name: &str| BEHAVIOURS.iter().position(|b| b.name == name).map_or(0, |i| all[i].passes());
    let finest = on.body.finest();
    let unused: Vec<&str> =
        BEHAVIOURS.iter().zip(&all).filter(|(_, s)| s.usable < finest).map(|(b, _)| b.name).collect();
    Ok(vec![Claim {
        section: "5, fig. 8",
        says: "Changing the coefficients, from 10 to 10⁶, gives a wide scope of behaviours",
        measured: format!(
            "One organ of four levels down to 5 mm, a ball of 10 mm pressed 10 mm and taken away after 0.3 s; no gravity. Levels \
             whose step would be shorter than 1 ms / 128 are not used{}.\n\n{}\n![force and dent over time](behaviours.png)\n",
            if unused.is_empty() { String::new() } else { format!(", here of: {}", unused.join(", ")) },
            table(
                out,
                "figure_8",
                &[
                    "behaviour",
                    "μ",
                    "damping ratio",
                    "peak force [N]",
                    "half of the dent is gone after",
                    "springs back beyond rest",
                    "passes its rest",
                    "finest level that can be stepped",
                    "active nodes by level",
                    "reset"
                ],
                &rows
            )?
        ),
        picture: Some(("figure_8", "five materials pressed, and 31, 121 and 601 ms after the release".into())),
        printed: None,
        shipped: Some(Verdict::new(
            decades > 4.0 && passes("jelly") >= 4 && passes("tissue") <= 1 && !all.iter().any(|s| s.restored),
            format!(
                "forces span {decades:.1} decades; let go, jelly passes its rest {} times and tissue {} times",
                passes("jelly"),
                passes("tissue")
            ),
        )),
    }])
}
