//! From shapes to a body: levels, their ties, the display surface in each of them, and the holds.

pub mod bodies;
pub mod body_check;
pub mod body_file;
pub mod calibration;
pub mod forecast;
mod holds;
pub mod inclusions;
pub mod input;
mod labels;
pub mod merge;
pub mod region;
pub mod report;
pub mod section;
pub mod shape_fault;
pub mod spacings;
pub mod thin_walls;

use crate::cover::{CoverError, cover_within};
use crate::geometry::LabelledMesh;
use crate::geometry::display::displayed;
use calibration::{Calibration, CalibrationError, FINEST, calibrate};
use holds::{Held, hold_regions};
use inclusions::{Inclusion, Materials, materials};
use labels::label_parts;
use merge::MergeError;
use palpate_core::geometry::{Moments, Surface, TetMesh};
use palpate_core::hierarchy::level::{Level, mean_edge};
use palpate_core::hierarchy::{embedding, parentage};
use palpate_core::ids::NONE;
use palpate_core::math::{Bounds, Real};
use palpate_core::model::body::{Body, BodyError, BodyParts, MaxwellBranch, material_in};
use palpate_core::model::material::Material;
use serde::{Deserialize, Serialize};

/// Vertices that are shown and touched of a body unless somebody says otherwise, about. A tool touches few places of large
/// triangles, and the force would change as it slides from one to the next; of very small ones a wide tool touches more
/// places than count.
pub const DISPLAY_VERTICES: usize = 5_500;
/// Longest edge of a displayed triangle, over the finest spacing, unless there would be more vertices then.
const DISPLAYED: Real = 0.35;

/// Where the levels come from.
#[derive(Clone, Debug)]
pub enum Shape {
    /// A closed surface, covered by lattices.
    Closed {
        /// It faces outward.
        surface: Surface,
        /// Lattice constants [m], coarse to fine; empty picks four by volume.
        spacings: Vec<Real>,
        /// A simpler surface of the same shape to show; `None` shows the surface itself.
        display: Option<Surface>,
        /// The mesh that the surface is that of, for its labels.
        labelled: Option<Box<LabelledMesh>>,
    },
    /// Given meshes, the levels themselves.
    Meshes {
        /// Coarse to fine.
        meshes: Vec<LabelledMesh>,
        /// The boundary of the last is shown, cut into triangles so small that it has about as many vertices.
        display_vertices: usize,
    },
}

impl Shape {
    /// A closed surface, shown as it is, covered by lattices of the constants `spacings` [m].
    pub fn closed(surface: Surface, spacings: Vec<Real>) -> Self {
        Shape::Closed { surface, spacings, display: None, labelled: None }
    }

    /// The same, about `display_vertices` of it shown; `labelled` is the mesh that it is that of, for its labels.
    pub fn covered(
        surface: Surface,
        spacings: Vec<Real>,
        labelled: Option<LabelledMesh>,
        display_vertices: usize,
    ) -> Self {
        // Between the vertices of triangles that are wider than elements nothing would be held, seen to move or felt as it is.
        let finest = spacings.last().copied().unwrap_or_else(|| spacings::automatic(surface.volume())[3]);
        let display = displayed(&surface, display_vertices, DISPLAYED * finest);
        let display = Some(display).filter(|display| *display != surface);
        Shape::Closed { surface, spacings, display, labelled: labelled.map(Box::new) }
    }

    /// Given meshes, coarse to fine, without labels.
    pub fn meshes(meshes: impl IntoIterator<Item = TetMesh>) -> Self {
        let meshes = meshes.into_iter().map(LabelledMesh::from).collect();
        Shape::Meshes { meshes, display_vertices: DISPLAY_VERTICES }
    }

    /// The meshes that it was given, for their labels.
    fn labelled(&self) -> &[LabelledMesh] {
        match self {
            Shape::Closed { labelled, .. } => labelled.as_deref().map_or(&[], std::slice::from_ref),
            Shape::Meshes { meshes, .. } => meshes,
        }
    }

    /// Its volume, centre and second moments.
    pub fn moments(&self) -> Moments {
        match self {
            Shape::Closed { surface, .. } => Moments::of_surface(surface),
            Shape::Meshes { meshes, .. } => {
                let none = LabelledMesh::default();
                let finest = &meshes.last().unwrap_or(&none).mesh;
                Moments::of_mesh(finest, &vec![1.0; finest.elements.len()])
            }
        }
    }

    /// The box [m] that regions given as fractions are fractions of: around what is shown, or around all meshes.
    pub fn bounds(&self) -> Bounds {
        match self {
            Shape::Closed { surface, display, .. } => display.as_ref().unwrap_or(surface).bounds(),
            Shape::Meshes { meshes, .. } => Bounds::of(meshes.iter().flat_map(|mesh| mesh.mesh.nodes.iter().copied())),
        }
    }
}

/// [`Shape::bounds`] of the shape that `body` was made from.
pub fn bounds(body: &Body) -> Bounds {
    if body.level(body.finest()).fills_body() {
        Bounds::of(body.levels().iter().flat_map(|level| level.mesh.nodes.iter().copied()))
    } else {
        body.surface().bounds()
    }
}

/// A region that is held in space.
#[derive(Clone, Debug)]
pub struct Region {
    /// A box around it at rest.
    pub bounds: Bounds,
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
    /// Its material, ...
    pub material: Material,
    /// ... but for these places, of which later ones cover earlier ones.
    pub inclusions: Vec<Inclusion>,
    /// Regions held in space.
    pub holds: Vec<Region>,
    /// Of which elements it is made.
    pub elements: Elements,
    /// Damping ratio ζ of the slowest mode that Maxwell branches give the body; 0 gives it none.
    pub damping_ratio: Real,
}

/// Kinds of elements.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Elements {
    /// Linear tetrahedra alone, as textbooks have them: half as dear, and the larger they are, the stiffer than the body in bending, and
    /// under any load where the material hardly changes its volume.
    Tetrahedra,
    /// Linear tetrahedra and the means of their deformation gradients at nodes
    /// ([`palpate_core::model::body::stars`]). The levels are made to sag alike by the part of the energy of strain jumps that each
    /// keeps.
    #[default]
    Smoothed,
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
        region.low.x, region.low.y, region.low.z, region.high.x, region.high.y, region.high.z,
        body.low.x, body.low.y, body.low.z, body.high.x, body.high.y, body.high.z
    )]
    EmptyHold {
        /// Hold, counted from 1.
        index: usize,
        /// "surface point" or "node".
        what: &'static str,
        /// Its box [m].
        region: Bounds,
        /// The body's box [m].
        body: Bounds,
    },
    /// Lattice covers reach beyond the body, so fixing their nodes in a box would hold more than the box.
    #[error(
        "hold {0} is exact, which only boxes and given meshes can be: leave `exact` out to hold the region by springs"
    )]
    ExactOnCover(usize),
    /// A finest level that would cover nothing.
    #[error(
        "no node of the level before the finest lies in the region that the finest is to cover: give a larger one; the body \
         reaches from ({:.4}, {:.4}, {:.4}) to ({:.4}, {:.4}, {:.4}) m",
        body.low.x, body.low.y, body.low.z, body.high.x, body.high.y, body.high.z
    )]
    EmptyReach {
        /// The body's box [m].
        body: Bounds,
    },
    /// A place of another material that is not in the body.
    #[error(
        "region {0} of the material lies outside the body: check its coordinates, which are those of the body at rest"
    )]
    EmptyInclusion(usize),
    /// A label that no element bears.
    #[error(
        "region {index} of the material goes by label {label}, which the body does not have: {}",
        if has.is_empty() {
            "its files have no labels, or several kinds of which one is to be named (--labels, or body.labels)".to_owned()
        } else {
            format!("its labels ('{name}') are {}", has.iter().map(i64::to_string).collect::<Vec<_>>().join(", "))
        }
    )]
    UnknownLabel {
        /// Region, counted from 1.
        index: usize,
        /// What it goes by.
        label: i64,
        /// What the body's labels are called.
        name: String,
        /// Those that there are.
        has: Vec<i64>,
    },
    /// Fibres without a direction.
    #[error(
        "the fibres of the material have no direction: give one (fibre_direction), or a volume file whose cells have vectors called fibre"
    )]
    NoDirections,
    /// Regions that overlap in too many ways.
    #[error("the regions of the material meet in more than 65,535 ways: give fewer")]
    TooManyMixtures,
    /// A level that no load can be put on.
    #[error(transparent)]
    Calibration(#[from] CalibrationError),
    /// Bodies that are no organs of one.
    #[error(transparent)]
    Merge(#[from] MergeError),
    /// Parts that do not fit.
    #[error(transparent)]
    Body(#[from] BodyError),
}

/// Builds the body; `progress` hears what is done next, and its place among how many.
///
/// # Errors
/// When a level cannot be made, a hold holds nothing, or the levels do not fit together.
pub fn prepare(recipe: &Recipe, progress: &mut dyn FnMut(&str, usize, usize)) -> Result<Body, PrepareError> {
    let (surface, levels) = tied_levels(&recipe.shape, recipe.material.density, progress)?;
    let steps = levels.len() + 4;
    progress("holding regions", steps - 2, steps);
    let labels = label_parts(&levels, recipe.shape.labelled())?;
    let Materials { list: materials, of: material_of, mixtures } =
        materials(recipe.material, &recipe.inclusions, &levels, &labels)?;
    let mut parts = BodyParts {
        name: recipe.name.clone(),
        surface,
        shape: recipe.shape.moments(),
        material_of,
        levels,
        materials,
        mixtures,
        labels,
        supports: Vec::new(),
        maxwell: Vec::new(),
        slowest_mode: 0.0,
        organs: Vec::new(),
    };
    parts.weigh();
    let held = hold_regions(&recipe.holds, &recipe.material, &parts.surface, &parts.levels)?;
    let body = calibrated(parts, held, recipe.elements, recipe.damping_ratio, progress)?;
    progress("done", steps, steps);
    Ok(body)
}

/// The levels of `shape`, tied and with the display surface in each, and that surface; nothing holds them yet.
fn tied_levels(
    shape: &Shape,
    density: Real,
    progress: &mut dyn FnMut(&str, usize, usize),
) -> Result<(Surface, Vec<Level>), PrepareError> {
    let (surface, mut levels) = match shape {
        Shape::Closed { surface, spacings, display, .. } => {
            let automatic = spacings::automatic(surface.volume());
            let spacings = if spacings.is_empty() { &automatic[..] } else { &spacings[..] };
            let around = surface.to_trimesh();
            let mut levels = Vec::new();
            for (i, &spacing) in spacings.iter().enumerate() {
                progress(&format!("covering level {i} at {:.1} mm", spacing * 1e3), i, spacings.len() + 4);
                levels.push(
                    cover_within(surface, &around, spacing, i as u32, density)
                        .map_err(|source| PrepareError::Cover { level: i, source })?,
                );
            }
            (display.as_ref().unwrap_or(surface).clone(), levels)
        }
        Shape::Meshes { meshes, display_vertices } => {
            let level = |LabelledMesh { mesh, .. }: &LabelledMesh| {
                let fraction = vec![1.0; mesh.elements.len()];
                Level::new(mesh.clone(), fraction, mean_edge(mesh), density)
            };
            let surface = boundary_surface(&meshes.last().unwrap_or(&LabelledMesh::default()).mesh);
            let more = *display_vertices as Real / surface.vertices.len().max(1) as Real;
            let parts = more.sqrt().round().max(1.0) as u32;
            (surface.subdivided(parts), meshes.iter().map(level).collect())
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
    Ok((surface, levels))
}

/// The body of `parts`, held by `held`, whose levels have been made to answer alike.
fn calibrated(
    mut parts: BodyParts,
    held: Held,
    elements: Elements,
    damping_ratio: Real,
    progress: &mut dyn FnMut(&str, usize, usize),
) -> Result<Body, PrepareError> {
    let steps = parts.levels.len() + 4;
    progress("calibrating levels", steps - 1, steps);
    parts.supports = held.springs;
    parts.levels.iter_mut().zip(held.fixed).for_each(|(level, fixed)| level.fixed = fixed);
    let springs: Vec<(u32, Real)> = parts.supports.iter().map(|h| (h.vertex.0, h.stiffness)).collect();
    // A level of a region alone can bear no load that moves the body: the finest whole one, as soft as it was made to
    // agree with that, is what the others are to agree with.
    let whole = parts.levels.iter().take_while(|level| level.is_whole()).count();
    parts.slowest_mode = stabilise(&mut parts, whole, &springs, elements)?;
    parts.maxwell = maxwell_branches(damping_ratio, parts.slowest_mode, parts.slowest_mode);
    Ok(Body::new(parts)?)
}

/// Gives levels their stabilisation, of which the first `whole` cover the body. Angular frequency of the slowest mode [rad/s].
fn stabilise(
    parts: &mut BodyParts,
    whole: usize,
    springs: &[(u32, Real)],
    elements: Elements,
) -> Result<Real, CalibrationError> {
    let agreed = Some(parts.levels[whole - 1].stabilisation).filter(|alpha| whole < parts.levels.len() && *alpha < 1.0);
    let (finest, others) = match elements {
        Elements::Tetrahedra => (1.0, 1.0),
        Elements::Smoothed => (agreed.unwrap_or(FINEST), FINEST),
    };
    parts.levels.iter_mut().for_each(|level| level.stabilisation = others);
    parts.levels[whole - 1].stabilisation = finest;
    let material = |level: usize, element: usize| parts.material_at(level, element);
    let Calibration { stabilisation, slowest_mode } = calibrate(&parts.levels[..whole], material, springs)?;
    parts.levels.iter_mut().zip(stabilisation).for_each(|(level, alpha)| level.stabilisation = alpha);
    Ok(slowest_mode)
}

/// `body` under another `name`, of another `material` but for `inclusions` and of other `elements`, held by other regions, damped
/// otherwise.
///
/// How levels answer depends on where the body is held, on how stiff the holds are for its material, on how much stiffer or denser
/// it is in one place than in another, and on Poisson's ratio: where one of these differs, the levels are calibrated anew, which
/// takes most of the time that preparing a body does; `progress` hears of it. Otherwise it takes none.
///
/// # Errors
/// When a hold holds nothing, an inclusion lies outside, or a level has no elastic solution.
#[expect(clippy::too_many_arguments, reason = "all that a recipe has but for the shape")]
pub fn refit(
    body: Body,
    name: &str,
    material: Material,
    inclusions: &[Inclusion],
    holds: &[Region],
    elements: Elements,
    damping_ratio: Real,
    progress: &mut dyn FnMut(&str, usize, usize),
) -> Result<Body, PrepareError> {
    let held = hold_regions(holds, &material, body.surface(), body.levels())?;
    let before = *body.material();
    let (stiffer, denser) = (material.mu / before.mu, material.density / before.density);
    let alike = |a: Real, b: Real| (a - b).abs() <= 1e-9 * b.abs();
    let same_holds = held.springs.len() == body.supports().len()
        && held.fixed.iter().zip(body.levels()).all(|(fixed, level)| *fixed == level.fixed)
        && (held.springs.iter().zip(body.supports()))
            .all(|(a, b)| a.vertex == b.vertex && alike(a.stiffness, b.stiffness * stiffer));
    let parts = body.parts();
    let Materials { list: materials, of: material_of, mixtures } =
        materials(material, inclusions, body.levels(), &parts.labels)?;
    let same_in = |(level, (now, then)): (&Level, (&Vec<u16>, &Vec<u16>))| {
        (0..level.mesh.elements.len()).all(|e| {
            let (now, then) = (material_in(&materials, now, e), material_in(&parts.materials, then, e));
            alike(now.lambda, then.lambda * stiffer)
                && alike(now.mu, then.mu * stiffer)
                && alike(now.fibres.modulus, then.fibres.modulus * stiffer)
                && now.fibres.direction == then.fibres.direction
                && alike(now.density, then.density * denser)
        })
    };
    let same_proportions = body.levels().iter().zip(material_of.iter().zip(&parts.material_of)).all(same_in);
    let same_answers = same_holds && same_proportions && body.is_smoothed() == (elements == Elements::Smoothed);
    let slowest_mode = body.slowest_mode() * (stiffer / denser).sqrt();
    let maxwell = maxwell_branches(damping_ratio, slowest_mode, slowest_mode);
    if same_answers
        && (&materials, &material_of, &mixtures) == (&parts.materials, &parts.material_of, &parts.mixtures)
        && held.springs == body.supports()
        && maxwell == body.maxwell()
        && name == body.name()
    {
        return Ok(body);
    }
    let mut parts = body.into_parts();
    parts.name = name.to_owned();
    for (r, level) in parts.levels.iter_mut().enumerate() {
        let density = |e: usize, material: &[Material], of: &[Vec<u16>]| material_in(material, &of[r], e).density;
        for (e, d) in level.density.iter_mut().enumerate() {
            *d *= density(e, &materials, &material_of) / density(e, &parts.materials, &parts.material_of);
        }
        level.node_mass.iter_mut().for_each(|m| *m *= denser);
        level.least_mass *= denser;
    }
    (parts.materials, parts.material_of, parts.mixtures) = (materials, material_of, mixtures);
    if !same_proportions {
        parts.weigh();
    }
    if !same_answers {
        progress(
            "calibrating anew: held elsewhere, of other elements, or of materials in another proportion, than as prepared",
            0,
            1,
        );
        return calibrated(parts, held, elements, damping_ratio, &mut |_, _, _| {});
    }
    (parts.supports, parts.maxwell, parts.slowest_mode) = (held.springs, maxwell, slowest_mode);
    Ok(Body::new(parts)?)
}

/// Maxwell branches on the deviatoric stress that damp the slowest mode, of angular frequency `slowest` [rad/s], at the
/// ratio `zeta`, and with a second branch modes up to some ten times as fast, too.
///
/// With `k = 4ζ` one branch of modulus `g = (k² + k√(k²+4))/2` and time `T = 1/(ω₁√(1+g))` damps ω₁ at ζ, the most that
/// so small a modulus can. A second branch eight times as fast carries on where the first has faded: for a small ζ always,
/// for a large one, which it costs step length, where the slowest mode of another organ is as fast as `fastest` [rad/s].
pub fn maxwell_branches(zeta: Real, slowest: Real, fastest: Real) -> Vec<MaxwellBranch> {
    if !(zeta > 0.0 && slowest > 0.0) {
        return Vec::new();
    }
    let k = 4.0 * zeta;
    let first = (k * k + k * (k * k + 4.0).sqrt()) / 2.0;
    let time = 1.0 / (slowest * (1.0 + first).sqrt());
    let branch = |modulus: Real, time: Real| MaxwellBranch { modulus, time };
    if zeta > 0.2 && fastest < 2.0 * slowest {
        vec![branch(first, time)]
    } else {
        vec![branch(first * 0.65, time), branch(first * 1.35, time / 8.0)]
    }
}

/// The boundary of a mesh as a surface of its own.
pub fn boundary_surface(mesh: &TetMesh) -> Surface {
    let mut number = vec![NONE; mesh.nodes.len()];
    let mut surface = Surface::default();
    for triangle in mesh.boundary() {
        let triangle = triangle.map(|n| {
            if number[n as usize] == NONE {
                number[n as usize] = surface.vertices.len() as u32;
                surface.vertices.push(mesh.nodes[n as usize]);
            }
            number[n as usize]
        });
        surface.triangles.push(triangle);
    }
    surface
}
