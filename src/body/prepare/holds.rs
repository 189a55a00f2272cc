//! What holds a body in space: regions to springs and fixed nodes.

use super::{PrepareError, Region};
use palpate_core::geometry::Surface;
use palpate_core::hierarchy::Level;
use palpate_core::ids::Vertex;
use palpate_core::math::{Bounds, Real, Vec3};
use palpate_core::model::body::{Support, vertices_in};
use palpate_core::model::material::Material;
use std::collections::BTreeMap;

/// What holds the levels of a body.
pub(super) struct Held {
    /// Display vertices on springs.
    pub(super) springs: Vec<Support>,
    /// Nodes that do not move at all, ascending, (n_levels) lists.
    pub(super) fixed: Vec<Vec<u32>>,
}

/// What of a body of `material` lies in `regions`.
pub(super) fn hold_regions(
    regions: &[Region],
    material: &Material,
    surface: &Surface,
    levels: &[Level],
) -> Result<Held, PrepareError> {
    let finest = &levels[levels.len() - 1];
    let areas = surface.vertex_areas();
    let mut held = Held { springs: Vec::new(), fixed: vec![Vec::new(); levels.len()] };
    for (i, region) in regions.iter().enumerate() {
        let Bounds { low, high } = region.bounds;
        // A hair of tolerance, so that a box face that coincides with a mesh face holds it.
        let slack = 1e-9 + 1e-6 * surface.bounds().size().norm();
        let inside = |p: &Vec3| (0..3).all(|c| p[c] >= low[c] - slack && p[c] <= high[c] + slack);
        let empty =
            |what| PrepareError::EmptyHold { index: i + 1, what, region: region.bounds, body: surface.bounds() };
        if region.exact {
            if !finest.fills_body() {
                return Err(PrepareError::ExactOnCover(i + 1));
            }
            for (level, fixed) in levels.iter().zip(&mut held.fixed) {
                let nodes: Vec<u32> =
                    (0..level.mesh.nodes.len() as u32).filter(|n| inside(&level.mesh.nodes[*n as usize])).collect();
                if nodes.is_empty() {
                    return Err(empty("node"));
                }
                fixed.extend(nodes);
                fixed.sort_unstable();
                fixed.dedup();
            }
        } else {
            let per_area = region.stiffness.unwrap_or(10.0 * material.youngs_modulus() / finest.spacing);
            let vertices = vertices_in(surface, inside);
            if vertices.is_empty() {
                return Err(empty("surface point"));
            }
            let spread = spread_out(&vertices, surface, &areas, APART * finest.spacing);
            held.springs
                .extend(spread.into_iter().map(|(vertex, area)| Support { vertex, stiffness: per_area * area }));
        }
    }
    Ok(held)
}

/// Of `vertices` one for each cube of edge `apart` [m], the one nearest to the middle of those in it, with the area [m²] of
/// all of them: springs closer than elements hold no better, and every one of them costs time in every step.
fn spread_out(vertices: &[Vertex], surface: &Surface, areas: &[Real], apart: Real) -> Vec<(Vertex, Real)> {
    let mut cubes: BTreeMap<[i64; 3], Vec<Vertex>> = BTreeMap::new();
    for &v in vertices {
        let place = surface.vertices[v.index()] / apart;
        cubes.entry([place.x, place.y, place.z].map(|x| x.floor() as i64)).or_default().push(v);
    }
    let spread = cubes.values().map(|together| {
        let area: Real = together.iter().map(|v| areas[v.index()]).sum();
        let middle: Vec3 = together.iter().map(|v| surface.vertices[v.index()] * (areas[v.index()] / area)).sum();
        let away = |v: &Vertex| (surface.vertices[v.index()] - middle).norm_squared();
        let nearest = together.iter().copied().min_by(|a, b| away(a).total_cmp(&away(b)));
        (nearest.unwrap_or_default(), area)
    });
    let mut spread: Vec<(Vertex, Real)> = spread.collect();
    spread.sort_unstable_by_key(|s| s.0);
    spread
}

/// Edge of the cubes that hold one spring each, over the finest spacing: with wider ones levels do not sag alike.
const APART: Real = 0.5;
