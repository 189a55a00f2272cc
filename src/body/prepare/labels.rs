//! Which labels of the files that a body is made from the elements of its levels bear, and how fibres lie in them.

use super::PrepareError;
use super::inclusions::samples;
use crate::geometry::LabelledMesh;
use palpate_core::geometry::locate::Locator;
use palpate_core::geometry::tet_mesh::FACES;
use palpate_core::hierarchy::Level;
use palpate_core::hierarchy::level::mean_edge;
use palpate_core::math::{Real, Vec3, from_parry, to_parry};
use palpate_core::model::body::LabelParts;
use palpate_core::model::material::PARTS;
use parry3d_f64::query::PointQuery;
use parry3d_f64::shape::TriMesh;
use rayon::prelude::*;
use std::collections::BTreeMap;

/// Halvings of the edges of an element through which a border runs: 512 places are asked for their labels.
const HALVINGS: u32 = 3;

/// The labels and fibres of the elements of `levels`: their own where a level is one of `meshes`, else those that they lie in of the
/// finest of these that has labels. What lies outside that mesh is taken for what is nearest.
///
/// # Errors
/// When they meet in too many ways.
pub(super) fn label_parts(levels: &[Level], meshes: &[LabelledMesh]) -> Result<LabelParts, PrepareError> {
    let directions = directions(levels, meshes);
    let labelled = || meshes.iter().filter(|mesh| !mesh.labels.of.is_empty());
    let Some(finest) = finest(labelled()) else { return Ok(LabelParts { directions, ..LabelParts::default() }) };
    let map = LabelMap::new(finest);
    let mut parts = LabelParts { name: finest.labels.name.clone(), directions, ..LabelParts::default() };
    let mut number_of = BTreeMap::new();
    for level in levels {
        let own = labelled().find(|own| own.mesh == level.mesh && own.labels.name == parts.name);
        let elements = 0..level.mesh.elements.len();
        let of_level: Vec<Vec<(i64, u8)>> = match own {
            Some(own) => own.labels.of.iter().map(|label| vec![(*label, PARTS as u8)]).collect(),
            None => elements.into_par_iter().map(|e| map.parts_of(&level.mesh.corners(e))).collect(),
        };
        let mut of = Vec::with_capacity(of_level.len());
        for mixed_cell in of_level {
            let next = u16::try_from(parts.mixed_cells.len()).map_err(|_| PrepareError::TooManyMixtures)?;
            of.push(*number_of.entry(mixed_cell).or_insert_with_key(|mixed_cell| {
                parts.mixed_cells.push(mixed_cell.clone());
                next
            }));
        }
        parts.of.push(of);
    }
    Ok(parts)
}

fn finest<'a>(meshes: impl Iterator<Item = &'a LabelledMesh>) -> Option<&'a LabelledMesh> {
    meshes.max_by_key(|mesh| mesh.mesh.elements.len())
}

/// How fibres lie in the elements of `levels`: their own directions where a level is one of `meshes`, else those in their middle of the
/// finest of these that has some. Empty where none has.
fn directions(levels: &[Level], meshes: &[LabelledMesh]) -> Vec<Vec<Vec3>> {
    let led = || meshes.iter().filter(|mesh| !mesh.directions.is_empty());
    let Some(finest) = finest(led()) else { return Vec::new() };
    let locator = Locator::new(&finest.mesh, mean_edge(&finest.mesh));
    let of_level = |level: &Level| match led().find(|own| own.mesh == level.mesh) {
        Some(own) => own.directions.clone(),
        None => {
            let middle = |e: usize| level.mesh.corners(e).iter().sum::<Vec3>() / 4.0;
            let at = |e: usize| finest.directions[locator.host(middle(e)).element as usize];
            (0..level.mesh.elements.len()).into_par_iter().map(at).collect()
        }
    };
    levels.iter().map(of_level).collect()
}

/// Finds the labels of places.
struct LabelMap<'a> {
    mesh: &'a LabelledMesh,
    locator: Locator<'a>,
    /// The triangles between tetrahedra of different labels, if there are any.
    borders: Option<TriMesh>,
    samples: Vec<[Real; 4]>,
}

impl<'a> LabelMap<'a> {
    fn new(mesh: &'a LabelledMesh) -> Self {
        let mut faces: Vec<([u32; 3], i64)> = Vec::with_capacity(4 * mesh.mesh.elements.len());
        for (element, label) in mesh.mesh.elements.iter().zip(&mesh.labels.of) {
            for face in FACES {
                let mut key = face.map(|i| element[i]);
                key.sort_unstable();
                faces.push((key, *label));
            }
        }
        faces.sort_unstable();
        let between = |pair: &[([u32; 3], i64)]| pair[0].0 == pair[1].0 && pair[0].1 != pair[1].1;
        let borders: Vec<[u32; 3]> = faces.windows(2).filter(|pair| between(pair)).map(|pair| pair[0].0).collect();
        let points = mesh.mesh.nodes.iter().map(|u| to_parry(*u)).collect();
        Self {
            mesh,
            locator: Locator::new(&mesh.mesh, mean_edge(&mesh.mesh)),
            borders: TriMesh::new(points, borders).ok(),
            samples: samples(HALVINGS),
        }
    }

    fn label_at(&self, p: Vec3) -> i64 {
        self.mesh.labels.of[self.locator.host(p).element as usize]
    }

    /// How many [`PARTS`] of the tetrahedron `u` bear each label.
    fn parts_of(&self, u: &[Vec3; 4]) -> Vec<(i64, u8)> {
        let centre = u.iter().sum::<Vec3>() / 4.0;
        let reach = u.iter().map(|p| (p - centre).norm()).fold(0.0, Real::max);
        let apart = |borders: &TriMesh| {
            (from_parry(borders.project_local_point(to_parry(centre), false).point) - centre).norm() > reach
        };
        if self.borders.as_ref().is_none_or(apart) {
            return vec![(self.label_at(centre), PARTS as u8)];
        }
        let mut counts = BTreeMap::new();
        for weights in &self.samples {
            let p = u.iter().zip(weights).map(|(u, w)| u * *w).sum();
            *counts.entry(self.label_at(p)).or_insert(0u32) += 1;
        }
        let all = self.samples.len() as u32;
        let part = |(label, count): (i64, u32)| (label, ((count * PARTS + all / 2) / all) as u8);
        counts.into_iter().map(part).filter(|(_, part)| *part > 0).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cover::cover;
    use crate::geometry::Labels;
    use palpate_core::geometry::primitives::{box_mesh, box_surface};

    /// A cube of 0.1 m of which what lies below x = 0.04 m is labelled 2, the rest 1.
    fn halves(cells: u32) -> LabelledMesh {
        let mesh = box_mesh(Vec3::repeat(0.1), [cells; 3]);
        let label = |e: usize| if mesh.corners(e).iter().map(|p| p.x).sum::<Real>() < 0.16 { 2 } else { 1 };
        let of = (0..mesh.elements.len()).map(label).collect();
        let direction = |e: usize| if label(e) == 2 { Vec3::y() } else { Vec3::z() };
        let directions = (0..mesh.elements.len()).map(direction).collect();
        LabelledMesh { labels: Labels { name: "region".into(), of }, mesh, directions }
    }

    #[test]
    fn a_labelled_mesh_keeps_its_labels_and_other_levels_have_as_much_of_each() {
        let fine = halves(10);
        let plain = box_mesh(Vec3::repeat(0.1), [3; 3]);
        let level = |mesh: &palpate_core::geometry::TetMesh| {
            Level::new(mesh.clone(), vec![1.0; mesh.elements.len()], mean_edge(mesh), 1000.0)
        };
        let covered = cover(&box_surface(Vec3::repeat(0.1), [4; 3]), 0.02, 0, 1000.0).unwrap();
        let levels = [level(&plain), level(&fine.mesh), covered];
        let parts = label_parts(&levels, &[plain.clone().into(), fine.clone()]).unwrap();
        assert_eq!(parts.name, "region");
        for (level, of) in levels.iter().zip(&parts.of) {
            let share = |e: usize| {
                let mixed_cell = &parts.mixed_cells[usize::from(of[e])];
                assert!(
                    (63..=65).contains(&mixed_cell.iter().map(|(_, n)| u32::from(*n)).sum::<u32>()),
                    "{mixed_cell:?}"
                );
                Real::from(mixed_cell.iter().find(|(label, _)| *label == 2).map_or(0, |(_, n)| *n)) / Real::from(PARTS)
            };
            let volume = |e: usize| level.fraction[e] * level.mesh.volume(e);
            let two: Real = (0..of.len()).map(|e| share(e) * volume(e)).sum();
            assert!((two / 4e-4 - 1.0).abs() < 0.02, "{two}");
        }
        for (level, of) in levels.iter().zip(&parts.directions) {
            let middle = |e: usize| level.mesh.corners(e).iter().sum::<Vec3>() / 4.0;
            let wanted = |e: usize| if middle(e).x < 0.04 { Vec3::y() } else { Vec3::z() };
            // Outside it is that of what is nearest.
            let is_clear = |p: Vec3| p.min() > 0.0 && p.max() < 0.1 && (p.x - 0.04).abs() > 1e-9;
            let as_there = |e: usize| of[e] == wanted(e) || !is_clear(middle(e));
            assert!(of.len() == level.mesh.elements.len() && (0..of.len()).all(as_there));
        }
        let own = |e: usize| vec![(fine.labels.of[e], 64)];
        assert!((0..fine.mesh.elements.len()).all(|e| parts.mixed_cells[usize::from(parts.of[1][e])] == own(e)));
        assert_eq!(label_parts(&levels, &[plain.into()]).unwrap(), LabelParts::default());
    }
}
