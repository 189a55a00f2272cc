//! From shapes to a body: levels, their ties, the display surface in each of them, and the holds.

pub mod calibration;

use crate::geometry::{Surface, TetMesh};
use crate::hierarchy::cover::{CoverError, cover};
use crate::hierarchy::level::{Level, mean_edge};
use crate::hierarchy::{embedding, parentage};
use crate::math::{Real, Vec3};
use crate::model::body::{Body, BodyError, BodyParts, Hold, MaxwellBranch, vertices_in};
use crate::model::material::Material;
use calibration::{CalibrationError, calibrate};

/// Where the levels come from.
#[derive(Clone, Debug)]
pub enum Shape {
    /// A closed surface, covered by lattices of these constants [m], coarse to fine; empty picks four by volume.
    Closed(Surface, Vec<Real>),
    /// Given meshes, coarse to fine; the display surface is the boundary of the last.
    Meshes(Vec<TetMesh>),
}

/// A region that is held in space.
#[derive(Clone, Debug)]
pub struct Region {
    /// Corners of a box around it at rest [m].
    pub bounds: (Vec3, Vec3),
    /// Stiffness per area [N/m³]; `None` takes 10 E over the finest spacing.
    pub stiffness: Option<Real>,
    /// Do not move its nodes at all, instead of holding its surface by springs.
    pub exact: bool,
}

/// What a body is made from.
#[derive(Clone, Debug)]
pub struct Recipe {
    /// A name for people.
    pub name: String,
    /// Its shape.
    pub shape: Shape,
    /// Its material, the same everywhere.
    pub material: Material,
    /// Regions held in space.
    pub holds: Vec<Region>,
    /// Damping ratio ζ of the slowest mode that Maxwell branches give the body; 0 gives it none.
    pub damping_ratio: Real,
}

/// Why a recipe makes no body.
#[derive(Debug, thiserror::Error)]
pub enum PrepareError {
    /// The surface could not be covered.
    #[error("level {level}: {source}")]
    Cover {
        /// Level that failed.
        level: usize,
        /// Why.
        source: CoverError,
    },
    /// A hold without effect is a mistake in its coordinates.
    #[error(
        "hold {index} holds nothing: no {what} of the body lies between ({:.4}, {:.4}, {:.4}) and ({:.4}, {:.4}, {:.4}) m; \
         the body reaches from ({:.4}, {:.4}, {:.4}) to ({:.4}, {:.4}, {:.4}) m",
        region.0.x, region.0.y, region.0.z, region.1.x, region.1.y, region.1.z,
        body.0.x, body.0.y, body.0.z, body.1.x, body.1.y, body.1.z
    )]
    EmptyHold {
        /// Hold, counted from 1.
        index: usize,
        /// "surface point" or "node".
        what: &'static str,
        /// Its box [m].
        region: (Vec3, Vec3),
        /// The body's box [m].
        body: (Vec3, Vec3),
    },
    /// Lattice covers reach beyond the body, so fixing their nodes in a box would hold more than the box.
    #[error(
        "hold {0} is exact, which only boxes and given meshes can be: leave `exact` out to hold the region by springs"
    )]
    ExactOnCover(usize),
    /// A level that no load can be put on.
    #[error(transparent)]
    Calibration(#[from] CalibrationError),
    /// Parts that do not fit.
    #[error(transparent)]
    Body(#[from] BodyError),
}

/// Builds the body; `progress` hears what is done next, and its place among how many.
///
/// # Errors
/// When a level cannot be made, a hold holds nothing, or the levels do not fit together.
pub fn prepare(recipe: &Recipe, progress: &mut dyn FnMut(&str, usize, usize)) -> Result<Body, PrepareError> {
    let material = recipe.material;
    let conforming = matches!(recipe.shape, Shape::Meshes(_));
    let (surface, mut levels) = match &recipe.shape {
        Shape::Closed(surface, spacings) => {
            let automatic = automatic_spacings(surface.volume());
            let spacings = if spacings.is_empty() { &automatic[..] } else { &spacings[..] };
            let mut levels = Vec::new();
            for (i, &spacing) in spacings.iter().enumerate() {
                progress(&format!("covering level {i} at {:.1} mm", spacing * 1e3), i, spacings.len() + 4);
                levels.push(
                    cover(surface, spacing, i as u32, material.density)
                        .map_err(|source| PrepareError::Cover { level: i, source })?,
                );
            }
            (surface.clone(), levels)
        }
        Shape::Meshes(meshes) => {
            let level = |mesh: &TetMesh| {
                let fraction = vec![1.0; mesh.elements.len()];
                Level::new(mesh.clone(), fraction, mean_edge(mesh), material.density, None)
            };
            (boundary_surface(meshes.last().unwrap_or(&TetMesh::default())), meshes.iter().map(level).collect())
        }
    };
    if levels.is_empty() {
        return Err(BodyError::Inconsistent("a body needs at least one level".into()).into());
    }
    let steps = levels.len() + 4;
    progress("finding parents and hosts", steps - 4, steps);
    parentage::tie(&mut levels);
    progress("embedding the display surface", steps - 3, steps);
    embedding::embed(&mut levels, &surface.vertices);
    progress("holding regions", steps - 2, steps);
    let holds = hold_regions(recipe, &surface, &mut levels, conforming)?;

    progress("calibrating levels", steps - 1, steps);
    let count = levels.len();
    let springs: Vec<(u32, Real)> = holds.iter().map(|h| (h.vertex, h.stiffness)).collect();
    let calibration = calibrate(&levels, |_, _| material, &springs)?;
    for (level, factors) in levels.iter_mut().zip(calibration.factors) {
        level.stiffness_factor = factors;
    }
    let body = Body::new(BodyParts {
        name: recipe.name.clone(),
        surface,
        material_of: vec![Vec::new(); count],
        levels,
        materials: vec![material],
        holds,
        maxwell: maxwell_branches(recipe.damping_ratio, calibration.slowest_mode),
    })?;
    progress("done", steps, steps);
    Ok(body)
}

/// Maxwell branches on the deviatoric stress that damp the slowest mode, of angular frequency `slowest` [rad/s], at the
/// ratio `zeta`, and with a second branch modes up to some ten times as fast, too.
///
/// With `k = 4ζ` one branch of modulus `g = (k² + k√(k²+4))/2` and time `T = 1/(ω₁√(1+g))` damps ω₁ at ζ, the most that
/// so small a modulus can. A second branch eight times as fast carries on where the first has faded.
pub fn maxwell_branches(zeta: Real, slowest: Real) -> Vec<MaxwellBranch> {
    if !(zeta > 0.0 && slowest > 0.0) {
        return Vec::new();
    }
    let k = 4.0 * zeta;
    let first = (k * k + k * (k * k + 4.0).sqrt()) / 2.0;
    let time = 1.0 / (slowest * (1.0 + first).sqrt());
    let branch = |modulus: Real, time: Real| MaxwellBranch { modulus, time };
    if zeta > 0.2 {
        vec![branch(first, time)]
    } else {
        vec![branch(first * 0.65, time), branch(first * 1.35, time / 8.0)]
    }
}

/// Four lattice constants [m], coarse to fine, 1.7 apart: the coarsest makes about 200 nodes (2 per a³).
fn automatic_spacings(volume: Real) -> [Real; 4] {
    let coarsest = (volume / 100.0).cbrt();
    [coarsest, coarsest / 1.7, coarsest / (1.7 * 1.7), coarsest / (1.7 * 1.7 * 1.7)]
}

fn hold_regions(
    recipe: &Recipe,
    surface: &Surface,
    levels: &mut [Level],
    conforming: bool,
) -> Result<Vec<Hold>, PrepareError> {
    let finest = levels[levels.len() - 1].spacing;
    let areas = surface.vertex_areas();
    let mut holds = Vec::new();
    for (i, region) in recipe.holds.iter().enumerate() {
        let (low, high) = region.bounds;
        // A hair of tolerance, so that a box face that coincides with a mesh face holds it.
        let slack = 1e-9 + 1e-6 * (surface.bounds().1 - surface.bounds().0).norm();
        let inside = |p: &Vec3| (0..3).all(|c| p[c] >= low[c] - slack && p[c] <= high[c] + slack);
        let empty =
            |what| PrepareError::EmptyHold { index: i + 1, what, region: region.bounds, body: surface.bounds() };
        if region.exact {
            if !conforming {
                return Err(PrepareError::ExactOnCover(i + 1));
            }
            for level in levels.iter_mut() {
                let nodes: Vec<u32> =
                    (0..level.mesh.nodes.len() as u32).filter(|n| inside(&level.mesh.nodes[*n as usize])).collect();
                if nodes.is_empty() {
                    return Err(empty("node"));
                }
                level.fixed.extend(nodes);
                level.fixed.sort_unstable();
                level.fixed.dedup();
            }
        } else {
            let per_area = region.stiffness.unwrap_or(10.0 * recipe.material.youngs_modulus() / finest);
            let vertices = vertices_in(surface, inside);
            if vertices.is_empty() {
                return Err(empty("surface point"));
            }
            holds.extend(vertices.into_iter().map(|v| Hold { vertex: v, stiffness: per_area * areas[v as usize] }));
        }
    }
    Ok(holds)
}

/// The boundary of a mesh as a surface of its own.
fn boundary_surface(mesh: &TetMesh) -> Surface {
    let mut number = vec![u32::MAX; mesh.nodes.len()];
    let mut surface = Surface::default();
    for triangle in mesh.boundary() {
        let triangle = triangle.map(|n| {
            if number[n as usize] == u32::MAX {
                number[n as usize] = surface.vertices.len() as u32;
                surface.vertices.push(mesh.nodes[n as usize]);
            }
            number[n as usize]
        });
        surface.triangles.push(triangle);
    }
    surface
}
