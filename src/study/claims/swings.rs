//! Section 3.1, figures 4 to 6: a cube held by one side is let go under gravity, at three resolutions, each by itself,
//! without damping, under each law; and by the core on the same three meshes.
//!
//! The paper prints neither size nor constants, so the load is not known: it is swept, and the figures are drawn at the
//! largest load that the printed law bears on all three meshes. Linear tetrahedra are stiffer the larger they are, under
//! any law, and the paper does not say so.

use super::{Claim, Verdict};
use crate::Progress;
use crate::laws::{Element, Law, green_strain};
use crate::levels::Levels;
use crate::oscillate::{GRAVITY, Swing, damped, material, root_mean_square, strongest_line};
use crate::plot::{Chart, Curve, Shape, charts, markdown, shapes};
use crate::trial::{Trial, body_of};
use palpate_core::ids::Node;
use palpate_core::math::{Real, Vec3};
use palpate_core::model::Material;
use palpate_core::model::step_class::TICK;
use palpate_core::simulation::Inputs;
use rayon::prelude::*;
use std::io::Result;
use std::path::Path;

/// Cells along an edge of the three meshes: 27, 64 and 125 nodes.
const CELLS: [u32; 3] = [2, 3, 4];
/// Times gravity.
const LOADS: [Real; 6] = [0.25, 0.5, 1.0, 1.5, 2.0, 3.0];
/// Simulated time [s].
const DURATION: Real = 5.0;
/// Ticks between two points of a curve.
const SAMPLE: u32 = 10;
/// φ/λ = ψ/μ [s] of figure 5b.
const DAMPING_TIME: Real = 0.02;
/// Depth and period that differ by less than this part are "nearly unchanged".
pub const NEARLY: Real = 0.05;
/// Between these the slowest mode of the cube is looked for [Hz].
const BAND: [Real; 2] = [0.4, 5.0];

/// What swings.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Method {
    /// A law in plain code on linear tetrahedra.
    Plain(Law),
    /// The core.
    Core,
}

impl Method {
    /// Words for a legend.
    pub fn name(self) -> String {
        match self {
            Method::Plain(law) => law.name().into(),
            Method::Core => "the core".into(),
        }
    }
}

/// The cube on meshes of `cells`.
pub fn cube(cells: &[u32], material: Material) -> Levels {
    let cells: Vec<[u32; 3]> = cells.iter().map(|c| [*c; 3]).collect();
    Levels::of_box(Vec3::repeat(1.0), &cells, material, true)
}

/// One mesh let go.
#[derive(Clone, Debug)]
pub struct Swung {
    /// Height of the upper free corner over where it began [m], over time [s].
    pub height: Vec<(Real, Real)>,
    /// An element was inside out at some time.
    pub inverted: bool,
    /// Positions of the nodes when the corner first turned round [m].
    pub lowest: Vec<Vec3>,
}

impl Swung {
    /// How far the corner first goes down [m], and its period [s].
    fn depth_and_period(&self) -> (Real, Real) {
        let lowest = self.height.windows(2).find(|p| p[1].1 > p[0].1).map_or(Real::NAN, |p| -p[0].1);
        (lowest, 1.0 / strongest_line(&self.height, BAND).0)
    }
}

/// Lets level `r` of `levels` go under `load` times gravity, for `duration` [s].
///
/// # Errors
/// When the core cannot be prepared.
pub fn swing(levels: &Levels, r: usize, method: Method, load: Real, duration: Real) -> Result<Swung> {
    let samples = (duration / (Real::from(SAMPLE) * TICK)).round() as usize;
    let corner = Vec3::repeat(1.0);
    let corner = (levels.first_node[r]..levels.first_node[r + 1]).find(|n| (levels.rest[*n] - corner).norm() < 1e-9);
    let corner = corner.unwrap_or_default();
    let mut swung = Swung { height: vec![(0.0, 0.0)], inverted: false, lowest: Vec::new() };
    let mut note = |x: Vec<Vec3>, inverted: bool| {
        let height = x[corner - levels.first_node[r]].z - 1.0;
        let (time, last) = swung.height[swung.height.len() - 1];
        if swung.lowest.is_empty() && (height > last || !height.is_finite()) {
            swung.lowest = x;
        }
        swung.inverted |= inverted || !height.is_finite();
        swung.height.push((time + Real::from(SAMPLE) * TICK, height));
        height.is_finite()
    };
    match method {
        Method::Plain(law) => {
            let mut swing = Swing { gravity: GRAVITY * load, ..Swing::new(levels, r, law) };
            for _ in 0..samples {
                swing.advance(Real::from(SAMPLE) * TICK);
                if !note(swing.x.clone(), swing.is_inverted()) {
                    break;
                }
            }
        }
        Method::Core => {
            let body = body_of(levels, 0.0, 1)?;
            let mut swing = Trial::hanging(GRAVITY * load).on_level(&body, r)?;
            for _ in 0..samples {
                let mut inverted = false;
                for _ in 0..SAMPLE {
                    let outputs = swing.advance(&Inputs::default());
                    inverted |= outputs.extremes.det_f < 0.0 || outputs.restored;
                }
                let place = |n| swing.mesh().position_of(Node::at(n)).unwrap_or_default();
                note((levels.first_node[r]..levels.first_node[r + 1]).map(place).collect(), inverted);
            }
        }
    }
    Ok(swung)
}

/// The three meshes under one load.
#[derive(Clone, Debug)]
pub struct Compared {
    /// As let go, coarsest first.
    pub swung: Vec<Swung>,
    /// Largest difference of first depth and of period from the finest mesh, as parts.
    pub depth: Real,
    /// See [`Compared::depth`].
    pub period: Real,
    /// Root mean square difference of the curves from the finest mesh's over how far that swings, the larger of the two.
    pub apart: Real,
}

/// Lets all `levels` go.
///
/// # Errors
/// When the core cannot be prepared.
pub fn compare(levels: &Levels, method: Method, load: Real, duration: Real) -> Result<Compared> {
    let swung: Vec<Swung> =
        (0..levels.count()).map(|r| swing(levels, r, method, load, duration)).collect::<Result<_>>()?;
    let (finest, coarser) = (&swung[swung.len() - 1], &swung[..swung.len() - 1]);
    let (depth, period) = finest.depth_and_period();
    let extent = |pick: fn(Real, Real) -> Real| finest.height.iter().map(|p| p.1).fold(0.0, pick);
    let width = extent(Real::max) - extent(Real::min);
    let largest = |of: &dyn Fn(&Swung) -> Real| {
        coarser.iter().map(of).fold(0.0, |a: Real, b| if b > a || b.is_nan() { b } else { a })
    };
    let (depth, period, apart) = (
        largest(&|s| (s.depth_and_period().0 / depth - 1.0).abs()),
        largest(&|s| (s.depth_and_period().1 / period - 1.0).abs()),
        largest(&|s| root_mean_square(&s.height, &finest.height) / width),
    );
    Ok(Compared { depth, period, apart, swung })
}

fn inverted(c: &Compared) -> bool {
    c.swung.iter().any(|s| s.inverted)
}

fn percent(part: Real) -> String {
    if part.is_finite() { format!("{:.1} %", 100.0 * part) } else { "blown up".into() }
}

/// Root mean square of |E| [Green strain] over the volume of the elements in the free quarter of level `r`, which bears next
/// to nothing but turns the most.
fn free_strain(levels: &Levels, r: usize, x: &[Vec3]) -> Real {
    let (mut square, mut volume) = (0.0, 0.0);
    for e in &levels.elements[levels.first_element[r]..levels.first_element[r + 1]] {
        let nodes = e.nodes.map(|n| n - levels.first_node[r]);
        if e.nodes.iter().map(|n| levels.rest[*n].x).sum::<Real>() > 4.0 * 0.75 {
            let of_level = Element { nodes, ..e.clone() };
            square += e.volume * green_strain(&of_level.gradient_of(x)).norm_squared();
            volume += e.volume;
        }
    }
    (square / volume).sqrt()
}

/// Claims of figures 4, 5 and 6.
///
/// # Errors
/// When a picture cannot be written.
pub fn claims(out: &Path, progress: Progress) -> Result<Vec<Claim>> {
    progress("figures 4 to 6: a cube let go at three resolutions, under six loads");
    let levels = cube(&CELLS, material());
    let laws = [Law::MassSpring, Law::Cauchy, Law::SimplifiedCauchy, Law::Green];
    let mut methods: Vec<Method> = laws.into_iter().map(Method::Plain).collect();
    methods.push(Method::Core);
    let cases: Vec<(Method, Real)> = methods.iter().flat_map(|m| LOADS.map(|load| (*m, load))).collect();
    let all: Vec<Compared> =
        cases.par_iter().map(|(m, load)| compare(&levels, *m, *load, DURATION)).collect::<Result<_>>()?;
    let of = |method: Method, load: Real| {
        let found = cases.iter().zip(&all).find(|((m, l), _)| *m == method && *l == load);
        found.map(|(_, c)| c)
    };
    let green = Method::Plain(Law::Green);
    // What the printed law bears.
    let borne = |load: &&Real| of(green, **load).is_some_and(|c| !inverted(c));
    let load = LOADS.iter().take_while(borne).last().copied().unwrap_or(LOADS[0]);

    let row = |method: &Method| {
        let c = |load: &Real| of(*method, *load);
        let mut row = vec![method.name()];
        row.extend(LOADS.iter().map(|load| {
            c(load).map_or(String::new(), |c| {
                let mark = if inverted(c) { " (inverted)" } else { "" };
                format!("{}, {}, {}{mark}", percent(c.depth), percent(c.period), percent(c.apart))
            })
        }));
        row
    };
    let header: Vec<String> =
        ["law".to_owned()].into_iter().chain(LOADS.iter().map(|load| format!("{load} g"))).collect();
    let header: Vec<&str> = header.iter().map(String::as_str).collect();
    let rows: Vec<Vec<String>> = methods.iter().map(row).collect();
    let table = markdown(&header, &rows);
    let measured = format!(
        "Largest difference from the mesh of 125 nodes on those of 27 and 64: of the first depth, of the period, and rms of \
         the curves over how far the finest swings. Pictures: {load} g, the largest load at which no element of the printed \
         law turns inside out on any mesh.\n\n{table}"
    );

    // Figures 4 and 5, at that load.
    let viscous = cube(&CELLS, damped(DAMPING_TIME));
    let damped_green = compare(&viscous, green, load, DURATION)?;
    let damped_core = compare(&viscous, Method::Core, load, DURATION)?;
    let panel = |title: String, c: &Compared| {
        let curve = |(cells, s): (&u32, &Swung)| Curve {
            name: format!("{} nodes", (cells + 1).pow(3)),
            points: s.height.clone(),
            ..Curve::default()
        };
        Chart {
            title,
            x_label: "time [s]".into(),
            y_label: "height of the corner [m]".into(),
            curves: CELLS.iter().zip(&c.swung).map(curve).collect(),
            ..Chart::default()
        }
    };
    let named = |method: Method, letter: &str| of(method, load).map(|c| panel(format!("{letter}{}", method.name()), c));
    let panels: Vec<Chart> = [
        named(Method::Plain(Law::MassSpring), "Fig. 4a: "),
        named(Method::Plain(Law::Cauchy), "Fig. 4b: "),
        named(Method::Plain(Law::SimplifiedCauchy), ""),
        named(green, "Fig. 5a: "),
        named(Method::Core, "shipped: "),
        Some(panel("Fig. 5b: Green strain, damped".into(), &damped_green)),
    ]
    .into_iter()
    .flatten()
    .collect();
    charts(out, "figures_4_and_5", &format!("A cube let go at three resolutions, {load} g"), &panels)?;
    let sweep = |title: &str, of_these: &[Method]| Chart {
        title: title.into(),
        x_label: "load [g]".into(),
        y_label: "apart from the finest mesh [% of its swing, rms]".into(),
        curves: of_these
            .iter()
            .map(|m| Curve {
                name: m.name(),
                points: LOADS.iter().filter_map(|l| of(*m, *l).map(|c| (*l, 100.0 * c.apart))).collect(),
                ..Curve::default()
            })
            .collect(),
        ..Chart::default()
    };
    let sweeps = [sweep("", &methods)];
    charts(out, "laws_and_loads", "How far apart three resolutions swing", &sweeps)?;

    let at = |method: Method| of(method, load).cloned().unwrap_or_else(|| all[0].clone());
    let (springs, cauchy, green, core) =
        (at(Method::Plain(Law::MassSpring)), at(Method::Plain(Law::Cauchy)), at(green), at(Method::Core));
    let simple = at(Method::Plain(Law::SimplifiedCauchy));
    let differs = |c: &Compared| c.depth > NEARLY || c.period > NEARLY;
    let numbers = |c: &Compared| {
        format!(
            "depth differs by {}, period by {}, rms {} of the swing",
            percent(c.depth),
            percent(c.period),
            percent(c.apart)
        )
    };
    let closest = |load: &Real| {
        let apart = |law| of(Method::Plain(law), *load).map_or(Real::NAN, |c| c.apart);
        apart(Law::Green) < apart(Law::Cauchy) && apart(Law::Green) < apart(Law::MassSpring)
    };
    let closest_at = LOADS.iter().filter(|l| closest(l)).count();
    let mut claims = vec![
        Claim {
            section: "3.1, fig. 4a",
            says: "Mass–spring systems fail to keep amplitude and frequency from resolution to resolution",
            measured: measured.clone(),
            picture: Some(("figures_4_and_5", format!("the corner of the cube over time under each law, {load} g"))),
            printed: Some(Verdict::new(differs(&springs), numbers(&springs))),
            shipped: None,
        },
        Claim {
            section: "3.1, fig. 4b",
            says: "Under Cauchy strain different resolutions swing differently, too",
            measured: "The table and picture of claim 1.".into(),
            picture: None,
            printed: Some(Verdict::new(differs(&cauchy), numbers(&cauchy))),
            shipped: None,
        },
        Claim {
            section: "3.1",
            says: "Simplified Cauchy strain has better multiresolution properties than Cauchy strain",
            measured: "The table and picture of claim 1.".into(),
            picture: None,
            printed: Some(Verdict::new(
                simple.apart < cauchy.apart,
                format!("rms {} of the swing against {}", percent(simple.apart), percent(cauchy.apart)),
            )),
            shipped: None,
        },
        Claim {
            section: "3.1, fig. 5a",
            says: "Under Green strain resolutions resemble each other more closely than under Cauchy strain or springs",
            measured: "Linear tetrahedra lock, coarse ones more, under any law that has elements; the core's do not. Over all loads:".into(),
            picture: Some(("laws_and_loads", "difference between resolutions against load, for each law".into())),
            printed: Some(Verdict::new(
                green.apart < cauchy.apart && green.apart < springs.apart,
                format!(
                    "at {load} g rms {} of the swing, Cauchy strain {}, springs {}; Green strain is the closest at {closest_at} \
                     of {} loads",
                    percent(green.apart),
                    percent(cauchy.apart),
                    percent(springs.apart),
                    LOADS.len()
                ),
            )),
            shipped: Some(Verdict::new(core.apart < cauchy.apart && core.apart < springs.apart, numbers(&core))),
        },
        Claim {
            section: "3.1, fig. 5b",
            says: "Damped, resolutions resemble each other under Green strain at least as closely as undamped",
            measured: format!("φ/λ = ψ/μ = {:.0} ms, {load} g; undamped see above.", 1e3 * DAMPING_TIME),
            picture: None,
            printed: Some(Verdict::new(damped_green.apart <= green.apart, numbers(&damped_green))),
            shipped: Some(Verdict::new(damped_core.apart <= core.apart, numbers(&damped_core))),
        },
    ];
    claims.extend(deformed_shapes(&levels, out, load, progress)?);
    Ok(claims)
}

/// Figure 6, on the finest of the three `levels`.
fn deformed_shapes(levels: &Levels, out: &Path, load: Real, progress: Progress) -> Result<Vec<Claim>> {
    progress("figure 6: shapes of the cube at its lowest point");
    let finest = levels.count() - 1;
    let triangles = levels.tied[finest].mesh.boundary();
    let methods = [
        (Method::Plain(Law::Cauchy), "(a) "),
        (Method::Plain(Law::SimplifiedCauchy), "(b) "),
        (Method::Plain(Law::Green), "(c) "),
        (Method::Core, "shipped: "),
    ];
    let swung: Vec<Swung> =
        methods.par_iter().map(|(m, _)| swing(levels, finest, *m, load, DURATION)).collect::<Result<_>>()?;
    let (mut rows, mut drawn, mut numbers) = (Vec::new(), Vec::new(), Vec::new());
    for ((method, letter), s) in methods.iter().zip(&swung) {
        let strain = free_strain(levels, finest, &s.lowest);
        let beside = 1.0 - strongest_line(&s.height, BAND).1;
        rows.push(vec![method.name(), format!("{:.1} %", 100.0 * strain), format!("{:.1} %", 100.0 * beside)]);
        numbers.push((strain, beside));
        let title = format!("{letter}{}", method.name());
        drawn.push(Shape { title, vertices: s.lowest.clone(), triangles: triangles.clone() });
    }
    let title = format!("Fig. 6: the cube at its lowest point, {load} g");
    shapes(out, "figure_6", &title, &drawn, 2, Vec3::repeat(1.0))?;
    let [cauchy, simple, green, core] = [0, 1, 2, 3].map(|i| numbers[i]);
    let strains = |(strain, _): (Real, Real)| {
        format!("{:.1} % against {:.1} % under Cauchy strain", 100.0 * strain, 100.0 * cauchy.0)
    };
    let motions = |(_, beside): (Real, Real)| {
        format!("{:.1} % of it against {:.1} % under simplified strain", 100.0 * beside, 100.0 * simple.1)
    };
    Ok(vec![
        Claim {
            section: "3.1, fig. 6",
            says: "Under Cauchy strain rotations make forces that deform the body, under Green strain they do not",
            measured: format!(
                "At the lowest point, the strain of the free quarter of the cube: it bears next to nothing and turns the most. \
                 Over the whole run, the part of the corner's motion beside its strongest frequency.\n\n{}",
                markdown(&["law", "strain of the free quarter, rms", "motion beside the strongest frequency"], &rows)
            ),
            picture: Some(("figure_6", format!("the cube at its lowest point under four laws, {load} g"))),
            printed: Some(Verdict::new(green.0 < 0.5 * cauchy.0, strains(green))),
            shipped: Some(Verdict::new(core.0 < 0.5 * cauchy.0, strains(core))),
        },
        Claim {
            section: "3.1, fig. 6",
            says: "Under Green strain the motion is more complex than under simplified Cauchy strain",
            measured: "The table of the claim before.".into(),
            picture: None,
            printed: Some(Verdict::new(green.1 > simple.1, motions(green))),
            shipped: Some(Verdict::new(core.1 > simple.1, motions(core))),
        },
    ])
}
