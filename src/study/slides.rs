//! Tools that slide over a block at constant depth: how even the force is, and how far from the continuum's.

use super::Progress;
use super::indentation::on_its_bottom;
use super::plot::{Chart, Curve, charts, table};
use super::trial::{Trial, attached, posed};
use palpate_body::prepare::{self, Elements, Recipe, prepare};
use palpate_core::adaptation::Adaptivity;
use palpate_core::contact::tool::Shape;
use palpate_core::geometry::primitives::box_surface;
use palpate_core::math::{Pose, Real, Vec3};
use palpate_core::model::step_class::TICK;
use palpate_core::model::{Body, Material};
use rayon::prelude::*;
use std::f64::consts::{FRAC_1_SQRT_2, PI};
use std::io::{Error, Result};
use std::path::Path;
use std::sync::Arc;

/// Size of the block [m].
const SIZE: Vec3 = Vec3::new(0.16, 0.16, 0.08);
/// [Pa]. All forces are in proportion to it.
const YOUNGS_MODULUS: Real = 1e4;
/// The slide [m], over more than an element of any level that touches, and how fast it is gone [m/s], a hand's slow stroke: with a faster one
/// the block's own swing is felt.
const LENGTH: Real = 0.02;
const SPEED: Real = 0.05;
/// Until the block is at rest under the tool, and within it for going there [ticks].
const REST: u32 = 900;
const GOING: u32 = 300;
/// Within how much of the slide [m] the largest change of the force is looked for: what a hand might feel as a step.
const STEP: Real = 1e-4;

/// What slides.
#[derive(Clone, Copy, Debug)]
struct Slider {
    name: &'static str,
    /// [m].
    radius: Real,
    /// Between its ends, lying across the slide [m].
    length: Real,
    /// [m].
    depth: Real,
}

const fn ball(name: &'static str, radius: Real, depth: Real) -> Slider {
    Slider { name, radius, length: 0.0, depth }
}

const SLIDERS: [Slider; 4] = [
    ball("ball of 10 mm, 0.25 mm deep", 0.01, 0.25e-3),
    ball("ball of 10 mm, 3 mm deep", 0.01, 3e-3),
    ball("ball of 40 mm, 3 mm deep", 0.04, 3e-3),
    Slider { name: "lying capsule of 3 mm, 1 mm deep", radius: 3e-3, length: 0.03, depth: 1e-3 },
];

impl Slider {
    fn shape(&self) -> Shape {
        if self.length > 0.0 { Shape::capsule(self.radius, self.length) } else { Shape::ball(self.radius) }
    }

    /// Force of the continuum [N]: Hertz's ball on a layer that is bonded below (Dimitriadis 2002), softened as large strain softens the material; `None` where
    /// no closed form is known.
    fn continuum(&self, material: &Material) -> Option<Real> {
        if self.length > 0.0 {
            return None;
        }
        let (nu, contact) = (material.poisson_ratio(), (self.radius * self.depth).sqrt());
        let hertz = 4.0 / 3.0 * YOUNGS_MODULUS / (1.0 - nu * nu) * contact * self.depth;
        let chi = contact / SIZE.z;
        let alpha = -(1.2876 - 1.4678 * nu + 1.3442 * nu * nu) / (1.0 - nu);
        let beta = (0.6387 - 1.0277 * nu + 1.5164 * nu * nu) / (1.0 - nu);
        let (second, third) = (4.0 * alpha * alpha / (PI * PI), alpha.powi(3) + 4.0 * PI * PI / 15.0 * beta);
        let fourth = 16.0 * alpha / PI.powi(4) * (alpha.powi(3) + 3.0 * PI * PI / 5.0 * beta);
        let layer = 1.0 - 2.0 * alpha / PI * chi + second * chi.powi(2) - 8.0 / PI.powi(3) * third * chi.powi(3)
            + fourth * chi.powi(4);
        Some(hertz * layer / (1.0 + material.softening(contact / self.radius)))
    }
}

/// What it slides on.
#[derive(Clone, Copy, Debug)]
struct Ground {
    material: Material,
    elements: Elements,
    /// Of the finest level [m].
    spacing: Real,
    /// Whether a coarser level is refined under the tool, and the finest not used alone.
    adaptive: bool,
}

impl Ground {
    fn name(&self) -> String {
        format!("{:.1} mm{}", 1e3 * self.spacing, if self.adaptive { ", adaptive" } else { "" })
    }

    fn words(&self) -> &'static str {
        match self.elements {
            Elements::Tetrahedra if self.material.neo_hookean > 0.0 => "tetrahedra, neo-Hookean",
            Elements::Tetrahedra => "tetrahedra",
            Elements::Smoothed => "smoothed",
        }
    }

    fn body(&self) -> Result<Arc<Body>> {
        let coarser = [3.2, 1.8].map(|wider| wider * self.spacing);
        let spacings = coarser.into_iter().filter(|s| self.adaptive && *s < 0.5 * SIZE.z).chain([self.spacing]);
        let recipe = Recipe {
            name: "block".into(),
            shape: prepare::Shape::closed(box_surface(SIZE, [40, 40, 20]), spacings.collect()),
            material: self.material,
            inclusions: vec![],
            holds: on_its_bottom(SIZE),
            elements: self.elements,
            damping_ratio: 0.3,
        };
        Ok(Arc::new(prepare(&recipe, &mut |_, _, _| {}).map_err(Error::other)?))
    }
}

/// Place along the slide [m] and force [N], tick by tick.
fn slide(body: &Arc<Body>, adaptive: bool, slider: &Slider) -> Result<Vec<(Real, Real)>> {
    let trial = Trial { shape: slider.shape(), gravity: Vec3::zeros(), adaptivity: adaptive.then(Adaptivity::default) };
    let mut on = trial.on_level(body, 0)?;
    on.advance(&attached());
    // A capsule's axis is its own z: a quarter of a turn about x lays it across.
    let orientation =
        if slider.length > 0.0 { [FRAC_1_SQRT_2, 0.0, 0.0, FRAC_1_SQRT_2] } else { Pose::default().orientation };
    let mut felt = Vec::new();
    for tick in 0..REST + (LENGTH / SPEED / TICK).round() as u32 {
        let part = (Real::from(tick) / Real::from(GOING)).min(1.0);
        let along = Real::from(tick.saturating_sub(REST)) * TICK * SPEED;
        let above = slider.radius + 1e-3 - (slider.depth + 1e-3) * part * part * (3.0 - 2.0 * part);
        let position = Vec3::new(0.5 * (SIZE.x - LENGTH) + along, 0.47 * SIZE.y, SIZE.z + above);
        let force = on.advance(&posed(tick + 1, Pose { position, orientation })).tools[0].state.physical_force.z;
        if tick >= REST {
            felt.push((along, force));
        }
    }
    Ok(felt)
}

/// What is said of a slide [%]: how far its mean is from the continuum, from least to most, and the most within [`STEP`], all over the mean.
#[derive(Clone, Copy, Debug)]
struct Evenness {
    mean: Real,
    bias: Option<Real>,
    apart: Real,
    step: Real,
}

fn evenness(felt: &[(Real, Real)], continuum: Option<Real>) -> Evenness {
    let forces = || felt.iter().map(|f| f.1);
    let mean = forces().sum::<Real>() / felt.len() as Real;
    let (least, most) = forces().fold((Real::INFINITY, 0.0 as Real), |(a, b), f| (a.min(f), b.max(f)));
    let ticks = (STEP / (SPEED * TICK)).round() as usize;
    let step = felt.windows(ticks + 1).map(|w| (w[ticks].1 - w[0].1).abs()).fold(0.0, Real::max);
    Evenness {
        mean,
        bias: continuum.map(|of| 100.0 * (mean / of - 1.0)),
        apart: 100.0 * (most - least) / mean,
        step: 100.0 * step / mean,
    }
}

/// Slides over blocks of several spacings and Poisson's ratios, of one level and of several.
///
/// # Errors
/// When a picture cannot be written.
pub fn slides(out: &Path, progress: Progress) -> Result<String> {
    let (plain, smoothed) = (Elements::Tetrahedra, Elements::Smoothed);
    let green = |nu| Material::from_young(YOUNGS_MODULUS, nu, 1000.0);
    let of = [
        (green(0.3), plain),
        (green(0.45), plain),
        (green(0.45).as_neo_hookean(), plain),
        (green(0.45), smoothed),
        (green(0.49), smoothed),
    ];
    let spacings = [0.0125, 0.008].into_iter().flat_map(|spacing| [false, true].map(|adaptive| (spacing, adaptive)));
    let grounds: Vec<Ground> = of
        .into_iter()
        .flat_map(|(material, elements)| {
            spacings.clone().map(move |(spacing, adaptive)| Ground { material, elements, spacing, adaptive })
        })
        .collect();
    let mut runs = Vec::new();
    for ground in &grounds {
        progress(&format!("{} at ν = {:.2}, {}", ground.name(), ground.material.poisson_ratio(), ground.words()));
        let body = ground.body()?;
        let felt: Vec<_> =
            SLIDERS.par_iter().map(|slider| slide(&body, ground.adaptive, slider)).collect::<Result<_>>()?;
        runs.push(felt);
    }
    let mut rows = Vec::new();
    for (ground, felt) in grounds.iter().zip(&runs) {
        for (slider, felt) in SLIDERS.iter().zip(felt) {
            let e = evenness(felt, slider.continuum(&ground.material));
            let mut row = vec![format!("{:.2}", ground.material.poisson_ratio()), ground.words().into(), ground.name()];
            row.extend([slider.name.into(), format!("{:.1}", 1e3 * e.mean)]);
            row.extend([e.bias.map_or("–".into(), |bias| format!("{bias:+.1}"))]);
            row.extend([format!("{:.1}", e.apart), format!("{:.2}", e.step)]);
            rows.push(row);
        }
    }
    let panels: Vec<Chart> = SLIDERS
        .iter()
        .enumerate()
        .map(|(k, slider)| {
            let shown = |ground: &Ground| {
                ground.material == green(0.45) && (ground.adaptive || ground.elements == Elements::Tetrahedra)
            };
            let curve = |(ground, felt): (&Ground, &Vec<Vec<(Real, Real)>>)| {
                let mean = evenness(&felt[k], None).mean;
                let points = felt[k].iter().map(|(x, f)| (1e3 * x, 100.0 * (f / mean - 1.0))).collect();
                let name = match ground.elements {
                    Elements::Tetrahedra => ground.name(),
                    Elements::Smoothed => format!("{:.1} mm, smoothed", 1e3 * ground.spacing),
                };
                Curve { name, points, dots: vec![] }
            };
            Chart {
                title: slider.name.into(),
                x_label: "along the slide [mm]".into(),
                y_label: "force off its mean [%]".into(),
                curves: grounds.iter().zip(&runs).filter(|(ground, _)| shown(ground)).map(curve).collect(),
                y_range: Some((-5.0, 5.0)),
                ..Chart::default()
            }
        })
        .collect();
    charts(
        out,
        "slides",
        "Tools that slide over a block of ν = 0.45 at constant depth (smoothed elements: adaptive)",
        &panels,
    )?;
    let header = [
        "ν",
        "elements",
        "finest spacing",
        "tool",
        "mean [mN]",
        "off the continuum [%]",
        "least to most [%]",
        "within 0.1 mm [%]",
    ];
    table(out, "slides-table", &header, &rows)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_shallow_press_of_a_thick_layer_is_hertz_s_and_a_deeper_one_stiffer_and_softer() {
        let of = |depth: Real| {
            let pressed = ball("", 0.01, depth);
            let hertz = 4.0 / 3.0 * YOUNGS_MODULUS / (1.0 - 0.35 * 0.35) * pressed.radius.sqrt() * depth.powf(1.5);
            pressed.continuum(&Material::from_young(YOUNGS_MODULUS, 0.35, 1000.0)).unwrap() / hertz
        };
        assert!((of(1e-9) - 1.0).abs() < 1e-4);
        // Contact radius 1 mm: the layer gives 1.4 %, large strain takes 4 %.
        assert!((0.96..0.99).contains(&of(1e-4)), "{}", of(1e-4));
        assert!(SLIDERS[3].continuum(&Material::from_young(YOUNGS_MODULUS, 0.35, 1000.0)).is_none());
    }

    #[test]
    fn a_force_that_rises_evenly_by_a_tenth_is_a_tenth_apart_and_half_a_per_mille_within_a_tenth_of_a_millimetre() {
        let ticks = (LENGTH / SPEED / TICK).round() as usize;
        let felt: Vec<_> = (0..=ticks)
            .map(|i| i as Real / ticks as Real)
            .map(|part| (LENGTH * part, 2.0 * (0.95 + 0.1 * part)))
            .collect();
        let e = evenness(&felt, Some(1.0));
        assert!((e.mean - 2.0).abs() < 1e-12 && (e.bias.unwrap() - 100.0).abs() < 1e-9);
        assert!((e.apart - 10.0).abs() < 1e-9 && (e.step - 0.05).abs() < 1e-9, "{e:?}");
    }
}
