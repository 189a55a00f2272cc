//! Places of a body where its material is another, and what each element of each level is made of.

use super::PrepareError;
use super::region::Reach;
use palpate_core::geometry::TetMesh;
use palpate_core::hierarchy::Level;
use palpate_core::math::{Real, Vec3};
use palpate_core::model::Fibres;
use palpate_core::model::body::{LabelParts, MixtureParts};
use palpate_core::model::material::{Material, PARTS};
use rayon::prelude::*;
use std::collections::BTreeMap;

/// Where a material is another.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Place {
    /// Within a part of space.
    Within(Reach),
    /// Where the files that the body is made from have this label.
    Labelled(i64),
}

impl From<Reach> for Place {
    fn from(reach: Reach) -> Self {
        Place::Within(reach)
    }
}

/// A place where the material is another; in proportion to its stiffness it is as viscous as the rest of the body.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Inclusion {
    /// Where.
    pub place: Place,
    /// Young's modulus [Pa].
    pub youngs_modulus: Real,
    /// Poisson's ratio.
    pub poisson_ratio: Real,
    /// Density [kg/m³].
    pub density: Real,
    /// As [`Material::neo_hookean`].
    pub neo_hookean: Real,
    /// As [`Material::fibres`].
    pub fibres: Fibres,
}

impl Inclusion {
    fn material(&self) -> Material {
        let material = Material::from_young(self.youngs_modulus, self.poisson_ratio, self.density);
        Material { neo_hookean: self.neo_hookean, fibres: self.fibres, ..material }
    }
}

/// Elements are sampled at least this often across the smallest inclusion, ...
const ACROSS: Real = 8.0;
/// ... but not halved more often than this.
const MOST_HALVINGS: u32 = 5;

/// What a body is made of, as its parts have it.
#[derive(Debug)]
pub(super) struct Materials {
    pub(super) list: Vec<Material>,
    /// By level, the place in the list of each element's.
    pub(super) of: Vec<Vec<u16>>,
    pub(super) mixtures: MixtureParts,
}

/// The materials of a body of `levels` that is of `base` but for `inclusions`, of which later ones cover earlier ones: a
/// list, for each level the place in it of each element's, or nothing where all are of the first, `base`, and what they are
/// mixed of. An element partly inside is of a [`mixed_cell`] by volume, in steps of one in [`PARTS`]; `labels` say where they
/// are.
///
/// # Errors
/// When an inclusion lies in no element, or fibres have no direction.
pub(super) fn materials(
    base: Material,
    inclusions: &[Inclusion],
    levels: &[Level],
    labels: &LabelParts,
) -> Result<Materials, PrepareError> {
    let mut has: Vec<i64> = labels.mixed_cells.iter().flatten().map(|(label, _)| *label).collect();
    has.sort_unstable();
    has.dedup();
    for (i, inclusion) in inclusions.iter().enumerate() {
        if let Place::Labelled(label) = inclusion.place
            && !has.contains(&label)
        {
            return Err(PrepareError::UnknownLabel { index: i + 1, label, name: labels.name.clone(), has });
        }
    }
    let mixture = |parts: &[u32]| {
        let inside: u32 = parts.iter().sum();
        let inclusions = (1..).zip(parts).filter(|(_, n)| **n > 0).map(|(tissue, n)| (tissue, *n as u8));
        std::iter::once((0, PARTS.saturating_sub(inside) as u8)).chain(inclusions).collect()
    };
    let (mut list, mut mixtures) = (vec![base], vec![mixture(&[])]);
    let mut number_of = BTreeMap::from([(vec![0; inclusions.len()], 0)]);
    let mut met = vec![inclusions.is_empty(); inclusions.len()];
    let mut of_levels = Vec::new();
    for (r, level) in levels.iter().enumerate() {
        let mut parts = parts(&level.mesh, level.spacing, inclusions);
        if let Some(of) = labels.of.get(r) {
            parts
                .iter_mut()
                .zip(of)
                .for_each(|(parts, m)| add_labels(parts, inclusions, &labels.mixed_cells[usize::from(*m)]));
        }
        let mut of = Vec::new();
        for (e, parts) in parts.into_iter().enumerate().filter(|(_, parts)| parts.iter().any(|n| *n > 0)) {
            met.iter_mut().zip(&parts).for_each(|(met, n)| *met |= *n > 0);
            let next = u16::try_from(list.len()).map_err(|_| PrepareError::TooManyMixtures)?;
            let number = *number_of.entry(parts).or_insert_with_key(|parts| {
                list.push(mixed_cell(base, inclusions, parts));
                mixtures.push(mixture(parts));
                next
            });
            of.resize(level.mesh.elements.len(), 0);
            of[e] = number;
        }
        of_levels.push(of);
    }
    let has_no_direction = |m: &Material| m.fibres.are_there() && m.fibres.direction == Vec3::zeros();
    if labels.directions.is_empty() && list.iter().any(has_no_direction) {
        return Err(PrepareError::NoDirections);
    }
    match met.iter().position(|met| !met) {
        Some(index) => Err(PrepareError::EmptyInclusion(index + 1)),
        None => {
            let tissues = std::iter::once(base).chain(inclusions.iter().map(Inclusion::material)).collect();
            Ok(Materials { list, of: of_levels, mixtures: MixtureParts { tissues, of: mixtures } })
        }
    }
}

/// Adds what an element of the labels in `mixed_cell` has of inclusions that go by labels to its `parts` of the others. What
/// an element has of a label and what it has of another place overlap in proportion.
fn add_labels(parts: &mut [u32], inclusions: &[Inclusion], mixed_cell: &[(i64, u8)]) {
    let (mut later_places, mut later_labels) = (0, 0);
    let mut taken = Vec::new();
    for (part, inclusion) in parts.iter_mut().zip(inclusions).rev() {
        match inclusion.place {
            Place::Within(_) => {
                later_places += *part;
                *part = (*part * (PARTS - later_labels) + PARTS / 2) / PARTS;
            }
            Place::Labelled(label) if !taken.contains(&label) => {
                taken.push(label);
                let own = mixed_cell.iter().find(|(of, _)| *of == label).map_or(0, |(_, n)| u32::from(*n));
                *part = (own * PARTS.saturating_sub(later_places) + PARTS / 2) / PARTS;
                later_labels = (later_labels + own).min(PARTS);
            }
            Place::Labelled(_) => {}
        }
    }
}

/// How many [`PARTS`] of its volume each element has in each inclusion that is a part of space.
fn parts(mesh: &TetMesh, spacing: Real, inclusions: &[Inclusion]) -> Vec<Vec<u32>> {
    let reach = |i: &Inclusion| if let Place::Within(reach) = i.place { Some(reach) } else { None };
    let smallest = inclusions.iter().filter_map(reach).map(|r| r.width()).fold(Real::INFINITY, Real::min);
    let wanted = ACROSS * spacing / smallest;
    let halvings = (1..MOST_HALVINGS).find(|n| Real::from(1u32 << n) >= wanted).unwrap_or(MOST_HALVINGS);
    let samples = samples(halvings);
    let of_element = |e: usize| {
        let u = mesh.corners(e);
        let centre = u.iter().sum::<Vec3>() / 4.0;
        let radius = u.iter().map(|p| (p - centre).norm()).fold(0.0, Real::max);
        let covers = |p: &Vec3| inclusions.iter().rposition(|i| reach(i).is_some_and(|r| r.contains(p)));
        let mut counts = vec![0; inclusions.len()];
        if inclusions.iter().filter_map(reach).all(|r| r.distance(&centre).abs() > radius) {
            // No border runs through it.
            if let Some(i) = covers(&centre) {
                counts[i] = PARTS;
            }
            return counts;
        }
        for weights in &samples {
            let p = u.iter().zip(weights).map(|(u, w)| u * *w).sum();
            if let Some(i) = covers(&p) {
                counts[i] += 1;
            }
        }
        let all = samples.len() as u32;
        counts.iter().map(|n| (n * PARTS + all / 2) / all).collect()
    };
    (0..mesh.elements.len()).into_par_iter().map(of_element).collect()
}

/// Barycentric coordinates of the middles of the tetrahedra, all of one volume, that so many halvings of the edges make.
pub(super) fn samples(halvings: u32) -> Vec<[Real; 4]> {
    let corners: [[Real; 4]; 4] = std::array::from_fn(|i| std::array::from_fn(|j| if i == j { 1.0 } else { 0.0 }));
    let mut all = vec![corners];
    for _ in 0..halvings {
        all = all.iter().flat_map(eighths).collect();
    }
    all.iter().map(|corners| std::array::from_fn(|j| corners.iter().map(|c| c[j]).sum::<Real>() / 4.0)).collect()
}

/// The eight parts of a tetrahedron: one at each corner, four around a diagonal of what is left.
fn eighths(corners: &[[Real; 4]; 4]) -> [[[Real; 4]; 4]; 8] {
    let middle = |a: usize, b: usize| -> [Real; 4] { std::array::from_fn(|j| (corners[a][j] + corners[b][j]) / 2.0) };
    let [a, b, c, d] = *corners;
    let [ab, ac, ad, bc, bd, cd] = [middle(0, 1), middle(0, 2), middle(0, 3), middle(1, 2), middle(1, 3), middle(2, 3)];
    [
        [a, ab, ac, ad],
        [b, ab, bc, bd],
        [c, ac, bc, cd],
        [d, ad, bd, cd],
        [ab, cd, ac, ad],
        [ab, cd, ad, bd],
        [ab, cd, bd, bc],
        [ab, cd, bc, ac],
    ]
}

/// [`Material::mixed`] of so many [`PARTS`] of each inclusion in `base`.
fn mixed_cell(base: Material, inclusions: &[Inclusion], parts: &[u32]) -> Material {
    base.mixed(parts.iter().copied().zip(inclusions.iter().map(Inclusion::material)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cover::cover;
    use palpate_core::geometry::primitives::box_surface;
    use palpate_core::math::Bounds;

    const BASE: Material = Material {
        lambda: 2e4,
        mu: 1e4,
        phi: 2.0,
        psi: 1.0,
        density: 1000.0,
        neo_hookean: 0.0,
        collapse: 1.0,
        fibres: Fibres::NONE,
    };

    /// A place that is stiffer than [`BASE`] by `factor`.
    fn stiff(place: Reach, factor: Real) -> Inclusion {
        let (youngs_modulus, poisson_ratio) = (factor * BASE.youngs_modulus(), BASE.poisson_ratio());
        Inclusion {
            place: place.into(),
            youngs_modulus,
            poisson_ratio,
            density: 1500.0,
            neo_hookean: 0.0,
            fibres: Fibres::NONE,
        }
    }

    fn levels() -> Vec<Level> {
        let surface = box_surface(Vec3::repeat(0.1), [2; 3]);
        [0.04, 0.022, 0.012].iter().zip(0..).map(|(a, i)| cover(&surface, *a, i, 1000.0).unwrap()).collect()
    }

    #[test]
    fn every_level_has_the_volume_of_a_small_ball_and_of_a_box() {
        let levels = levels();
        let ball = Reach::Ball(Vec3::new(0.05, 0.05, 0.09), 0.004);
        let slab = Reach::Box(Bounds::new(Vec3::new(0.02, 0.02, 0.02), Vec3::new(0.08, 0.07, 0.05)));
        for (place, wanted) in [(ball, 4.0 / 3.0 * std::f64::consts::PI * 0.004f64.powi(3)), (slab, 0.06 * 0.05 * 0.03)]
        {
            for level in &levels {
                let parts = parts(&level.mesh, level.spacing, &[stiff(place, 10.0)]);
                let part = |e: usize| Real::from(parts[e][0]) / Real::from(PARTS);
                let volume: Real = (0..parts.len()).map(|e| level.mesh.volume(e) * part(e)).sum();
                let error = volume / wanted - 1.0;
                println!("{:.0} mm: {:+.1} %", 1e3 * level.spacing, 100.0 * error);
                // The ball is a few parts of each of a few elements.
                assert!(error.abs() < if place == ball { 0.15 } else { 0.01 }, "{error}");
            }
        }
    }

    #[test]
    fn a_mixture_is_what_theory_says_of_few_balls_and_each_material_when_alone() {
        let ball = |factor: Real| [stiff(Reach::Ball(Vec3::zeros(), 1.0), factor)];
        for factor in [0.1, 10.0] {
            let all = mixed_cell(BASE, &ball(factor), &[PARTS]);
            assert!((all.mu / BASE.mu / factor - 1.0).abs() < 1e-12, "{all:?}");
            assert!((all.lambda / BASE.lambda / factor - 1.0).abs() < 1e-12, "{all:?}");
            let none = mixed_cell(BASE, &ball(factor), &[0]);
            assert!((none.mu / BASE.mu - 1.0).abs() < 1e-12 && (none.lambda / BASE.lambda - 1.0).abs() < 1e-12);
            let half = mixed_cell(BASE, &ball(factor), &[PARTS / 2]).mu / BASE.mu;
            let (plain, harmonic) = ((1.0 + factor) / 2.0, 2.0 / (1.0 + 1.0 / factor));
            assert!(harmonic < half && half < plain, "{harmonic} {half} {plain}");
        }
        // Rigid balls in what does not change its volume: Einstein's 1 + 5/2 c.
        let soft = Material::from_young(1e3, 0.4999, 1000.0);
        let rigid = [Inclusion { youngs_modulus: 1e9, ..ball(1.0)[0] }];
        let c = 1.0 / Real::from(PARTS);
        let found = (mixed_cell(soft, &rigid, &[1]).mu / soft.mu - 1.0) / c;
        assert!((found - 2.5 / (1.0 - c)).abs() < 0.01, "{found}");
        // What does not mind its volume changing stays a stable solid.
        let loose = Material::from_young(1e4, 0.0, 1000.0);
        let stiffer = [Inclusion { youngs_modulus: 7e4, poisson_ratio: 0.0, ..ball(1.0)[0] }];
        assert!((0..=PARTS).all(|n| mixed_cell(loose, &stiffer, &[n]).lambda >= 0.0));
        // Viscosities go along; densities go by volume.
        let mixed = mixed_cell(BASE, &ball(10.0), &[PARTS / 4]);
        assert!((mixed.psi / mixed.mu / (BASE.psi / BASE.mu) - 1.0).abs() < 1e-12);
        assert!((mixed.density / 1125.0 - 1.0).abs() < 1e-12);
    }

    #[test]
    fn a_later_inclusion_covers_an_earlier_one_and_where_they_meet_is_something_between() {
        let levels = levels();
        let all = Reach::Box(Bounds::new(Vec3::repeat(-1.0), Vec3::repeat(1.0)));
        let half = Reach::Box(Bounds::new(Vec3::repeat(-1.0), Vec3::new(0.05, 1.0, 1.0)));
        let Materials { list, of, .. } =
            materials(BASE, &[stiff(all, 3.0), stiff(half, 5.0)], &levels, &LabelParts::default()).unwrap();
        for (level, of) in levels.iter().zip(of) {
            let mut between = 0;
            for (e, number) in of.iter().enumerate() {
                let stiffness = list[usize::from(*number)].mu / BASE.mu;
                let x = level.mesh.corners(e).map(|p| p.x);
                if x.iter().all(|x| *x < 0.05) {
                    assert!((stiffness - 5.0).abs() < 1e-12);
                } else if x.iter().all(|x| *x > 0.05) {
                    assert!((stiffness - 3.0).abs() < 1e-12);
                } else {
                    between += usize::from(stiffness > 3.1 && stiffness < 4.9);
                    assert!((3.0 - 1e-12..=5.0 + 1e-12).contains(&stiffness));
                }
            }
            assert!(between > 0);
        }
    }

    #[test]
    fn a_body_without_inclusions_lists_nothing_and_an_inclusion_outside_is_refused() {
        let levels = levels();
        let Materials { list, of, .. } = materials(BASE, &[], &levels, &LabelParts::default()).unwrap();
        assert!(list == [BASE] && of.iter().all(Vec::is_empty) && of.len() == 3);
        let away = stiff(Reach::Ball(Vec3::repeat(0.3), 0.02), 2.0);
        let middle = stiff(Reach::Ball(Vec3::repeat(0.05), 0.02), 2.0);
        let refused = materials(BASE, &[middle, away], &levels, &LabelParts::default()).unwrap_err();
        assert!(matches!(refused, PrepareError::EmptyInclusion(2)), "{refused}");
    }

    #[test]
    fn labels_and_places_cover_what_comes_before_them() {
        let ball = stiff(Reach::Ball(Vec3::zeros(), 1.0), 2.0);
        let by = |label: i64| Inclusion { place: Place::Labelled(label), ..ball };
        let parts = |inclusions: &[Inclusion], of_places: &[u32]| {
            let mut parts = of_places.to_vec();
            add_labels(&mut parts, inclusions, &[(7, 48), (8, 16)]);
            parts
        };
        assert_eq!(parts(&[by(7), by(8), by(9)], &[0; 3]), [48, 16, 0]);
        assert_eq!(parts(&[by(7), by(7)], &[0; 2]), [0, 48]);
        assert_eq!(parts(&[by(7), ball], &[0, 32]), [24, 32]);
        assert_eq!(parts(&[ball, by(7)], &[32, 0]), [8, 48]);
        assert_eq!(parts(&[ball, by(7)], &[64, 0]), [16, 48]);
    }

    #[test]
    fn a_label_that_the_body_does_not_have_is_refused_with_those_that_it_has() {
        let levels = levels();
        let of = levels.iter().map(|level| vec![0; level.mesh.elements.len()]).collect();
        let labels = LabelParts {
            name: "region".into(),
            mixed_cells: vec![vec![(3, 60), (-5, 4)]],
            of,
            ..LabelParts::default()
        };
        let by =
            |label: i64| Inclusion { place: Place::Labelled(label), ..stiff(Reach::Ball(Vec3::zeros(), 1.0), 2.0) };
        let Materials { list, of, .. } = materials(BASE, &[by(-5)], &levels, &labels).unwrap();
        assert!(list.len() == 2 && of.iter().flatten().all(|m| *m == 1));
        let refused = |labels: &LabelParts| materials(BASE, &[by(3), by(4)], &levels, labels).unwrap_err().to_string();
        let e = refused(&labels);
        assert!(e.contains("region 2") && e.contains("label 4") && e.contains("('region') are -5, 3"), "{e}");
        let e = refused(&LabelParts::default());
        assert!(e.contains("region 1") && e.contains("--labels"), "{e}");
    }

    #[test]
    fn samples_are_spread_evenly() {
        for halvings in 1..4 {
            let samples = samples(halvings);
            assert_eq!(samples.len(), 8usize.pow(halvings));
            for j in 0..4 {
                let mean = samples.iter().map(|w| w[j]).sum::<Real>() / samples.len() as Real;
                assert!((mean - 0.25).abs() < 1e-12);
            }
            assert!(samples.iter().flatten().all(|w| *w > 0.0));
        }
    }
}
