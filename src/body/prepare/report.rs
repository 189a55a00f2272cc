//! What a prepared body is like, level by level: sizes, shape, steps, and what may be wrong with it.

use super::calibration::CalibrationError;
use super::calibration::agreement::{LOADS, agreement};
use palpate_core::geometry::Moments;
use palpate_core::geometry::tet_mesh::FACES;
use palpate_core::hierarchy::Level;
use palpate_core::ids::{NONE, Node};
use palpate_core::math::{Real, Vec3};
use palpate_core::model::Body;
use palpate_core::model::element_pool::CLASSES;
use palpate_core::model::step_class::{Strained, omega_squared, stable_step, step_of};
use std::collections::BTreeMap;
use std::fmt;

/// How far volume, centre of mass and inertia of a level may be from the shape's, as a part.
pub const TOLERANCE: Real = 0.01;

/// What one level is like.
#[derive(Clone, Debug, PartialEq)]
pub struct LevelReport {
    /// Typical node distance [m].
    pub spacing: Real,
    /// Number of nodes.
    pub nodes: usize,
    /// Number of elements.
    pub elements: usize,
    /// False for a level of a region, whose volume, mass, centre and inertia say nothing of the body's.
    pub whole: bool,
    /// Volume of the elements inside the body over the shape's, less one.
    pub volume: Real,
    /// Mass [kg].
    pub mass: Real,
    /// How far the centre of mass is from the body's ([`Body::mass_moments`]), over its radius of gyration.
    pub centre: Real,
    /// How far the inertia of the node masses is from the body's, as a part of it.
    pub inertia: Real,
    /// Smallest and largest dihedral angle [degree].
    pub dihedral: (Real, Real),
    /// Smallest and mean of the elements' smallest altitudes [m].
    pub altitude: (Real, Real),
    /// Longest stable step of the whole level at rest [s].
    pub step: Real,
    /// The element that is so short-stepped: its number in the level and its centre [m].
    pub stiffest: (usize, Vec3),
    /// Part α of the energy of strain jumps that tetrahedra keep ([`palpate_core::model::body::stars`]).
    pub stabilisation: Real,
    /// How much more it gives way than the finest whole level under each of [`LOADS`], as a part.
    pub agreement: Option<[Real; LOADS.len()]>,
    /// Most negative weight of any row on the level's elements: of display vertices and of nodes of its neighbours.
    pub extrapolation: Real,
    /// Memory of the level in the body [bytes], about.
    pub memory: usize,
}

impl LevelReport {
    /// False where the elements need shorter steps than there are.
    pub fn can_be_stepped(&self) -> bool {
        self.step >= step_of(CLASSES - 1)
    }
}

/// What a body is like.
#[derive(Clone, Debug, PartialEq)]
pub struct Report {
    /// Each level, coarsest first.
    pub levels: Vec<LevelReport>,
    /// Labels of the files that it was made from, and the part of the volume that bears each, ascending.
    pub labels: Vec<(i64, Real)>,
    /// What users should know, in words.
    pub warnings: Vec<String>,
}

/// Looks at `body`.
pub fn report(body: &Body) -> Report {
    let wanted = body.mass_moments();
    let mut levels: Vec<LevelReport> = (0..body.levels().len()).map(|r| level_report(body, r, &wanted)).collect();
    let mut warnings = Vec::new();
    match agreement_of(body) {
        Ok(all) => levels.iter_mut().zip(all).for_each(|(level, one)| level.agreement = Some(one)),
        Err(error) => warnings.push(format!("its levels are not compared: {error}")),
    }
    for (r, level) in levels.iter().enumerate() {
        for (what, error) in [("volume", level.volume), ("centre of mass", level.centre), ("inertia", level.inertia)] {
            if level.whole && error.abs() > TOLERANCE {
                // Masses are at nodes, which lie farther out than the elements do.
                let few = if what == "inertia" && error > 0.0 { "; of a finer mesh it is less" } else { "" };
                warnings.push(format!("level {r}: its {what} is {:+.1} % off the body's{few}", 100.0 * error));
            }
        }
        let off = level.agreement.iter().flat_map(|all| all.iter().enumerate());
        if let Some((load, off)) =
            off.filter(|(_, off)| off.abs() > MOST_OFF).max_by(|a, b| a.1.abs().total_cmp(&b.1.abs()))
        {
            warnings.push(format!(
                "level {r} is too coarse for this body: it gives way {:.0} % {} than the finest under a {}; leave it out, \
                 or make it finer",
                100.0 * off.abs(),
                if *off > 0.0 { "more" } else { "less" },
                LOADS[load]
            ));
        }
        let nested = shared_places(body, r);
        if nested > MOST_SHARED {
            warnings.push(format!(
                "level {r} has a node where {:.0} % of level {}'s nodes are: a body of both resolutions is up to an eighth \
                 softer than either; mesh them apart, the one 1.6 to 1.8 times as fine as the other",
                100.0 * nested,
                r - 1
            ));
        }
        if !level.can_be_stepped() {
            let (element, at) = level.stiffest;
            warnings.push(format!(
                "level {r} cannot be used: element {} around ({:.4}, {:.4}, {:.4}) m needs steps of {:.1} µs, the \
                 shortest is {:.1} µs; mesh it without slivers, or take a softer material",
                element + 1,
                at.x,
                at.y,
                at.z,
                1e6 * level.step,
                1e6 * step_of(CLASSES - 1)
            ));
        }
    }
    Report { levels, labels: labels(body), warnings }
}

fn level_report(body: &Body, r: usize, wanted: &Moments) -> LevelReport {
    let level = body.level(r);
    let masses = Moments::of_points(&level.mesh.nodes, &level.node_mass);
    let elements = level.mesh.elements.len();
    let altitudes = (0..elements).map(|e| level.mesh.smallest_altitude(e));
    let (mut least, mut sum) = (Real::INFINITY, 0.0);
    altitudes.for_each(|a| (least, sum) = (least.min(a), sum + a));
    let stiffness = body.elements_of(r).map(|e| omega_squared(body, body.material_of(e), e));
    let stiffest = stiffness.enumerate().fold((0, 0.0), |most, (e, w)| if w > most.1 { (e, w) } else { most });
    let middle = |e: usize| level.mesh.corners(e).iter().sum::<Vec3>() / 4.0;
    LevelReport {
        spacing: level.spacing,
        nodes: level.mesh.nodes.len(),
        elements,
        whole: level.is_whole(),
        volume: level.volume() / body.parts().shape.volume - 1.0,
        mass: masses.volume,
        centre: (masses.centre - wanted.centre).norm() / wanted.radius(),
        inertia: masses.inertia_error(wanted),
        dihedral: dihedral_angles(level),
        altitude: (least, sum / elements as Real),
        step: stable_step(stiffest.1, Strained::REST, body.damping_time(), 0.0),
        stiffest: (stiffest.0, middle(stiffest.0)),
        stabilisation: level.stabilisation,
        agreement: None,
        extrapolation: worst_row(body, r),
        memory: memory(body, r),
    }
}

/// How levels agree.
fn agreement_of(body: &Body) -> Result<Vec<[Real; LOADS.len()]>, CalibrationError> {
    let parts = body.parts();
    let whole = parts.levels.iter().take_while(|level| level.is_whole()).count();
    let springs: Vec<(u32, Real)> = parts.supports.iter().map(|hold| (hold.vertex.0, hold.stiffness)).collect();
    let material = |level: usize, e: usize| parts.material_at(level, e);
    agreement(&parts.levels[..whole], material, &springs)
}

/// How much more or less than the finest a level may give way under any load before users are told, as a part.
const MOST_OFF: Real = 0.1;

/// Part of the next coarser level's nodes that have a node of level `r` at their place.
fn shared_places(body: &Body, r: usize) -> Real {
    let Some(coarser) = r.checked_sub(1) else { return 0.0 };
    let near = 1e-6 * body.level(r).spacing;
    let at_home = |n: &Node| body.children(*n).iter().any(|child| (body.rest(*child) - body.rest(*n)).norm() < near);
    body.nodes_of(coarser).filter(at_home).count() as Real / body.nodes_of(coarser).len() as Real
}

/// Part of a level's nodes that the next finer one may share: boxes have their corners in common.
const MOST_SHARED: Real = 0.3;

/// Labels and their parts of the volume, on the finest whole level.
fn labels(body: &Body) -> Vec<(i64, Real)> {
    let (parts, r) = (body.parts(), body.levels().iter().rposition(Level::is_whole).unwrap_or_default());
    let Some(of) = parts.labels.of.get(r) else { return Vec::new() };
    let mut volumes = BTreeMap::new();
    for (e, mixed_cell) in body.elements_of(r).zip(of) {
        for (label, part) in &parts.labels.mixed_cells[usize::from(*mixed_cell)] {
            *volumes.entry(*label).or_insert(0.0) += Real::from(*part) * body.volume(e);
        }
    }
    let all: Real = volumes.values().sum();
    volumes.into_iter().map(|(label, volume)| (label, volume / all)).collect()
}

/// Smallest and largest angle between two faces of an element [degree].
fn dihedral_angles(level: &Level) -> (Real, Real) {
    let (mut least, mut most) = (Real::INFINITY, 0.0 as Real);
    for e in 0..level.mesh.elements.len() {
        let u = level.mesh.corners(e);
        let normals = FACES.map(|f| (u[f[1]] - u[f[0]]).cross(&(u[f[2]] - u[f[0]])).normalize());
        for (i, a) in normals.iter().enumerate() {
            for b in &normals[..i] {
                let angle = (-a.dot(b)).clamp(-1.0, 1.0).acos().to_degrees();
                (least, most) = (least.min(angle), most.max(angle));
            }
        }
    }
    (least, most)
}

/// Most negative weight of a row on an element of level `r`, or 0.
fn worst_row(body: &Body, r: usize) -> Real {
    let coarser = r.checked_sub(1).map_or(&[][..], |c| &body.level(c).finer_host);
    let finer = body.levels().get(r + 1).map_or(&[][..], |f| &f.coarser_host);
    let rows = body.level(r).embedding.iter().chain(coarser).chain(finer);
    rows.filter(|host| host.element != NONE).map(|host| host.extrapolation()).fold(0.0, Real::min)
}

/// What a body keeps of a level [bytes]: the level itself, and what follows from it for stepping.
fn memory(body: &Body, r: usize) -> usize {
    let level = body.level(r);
    let nodes = level.mesh.nodes.len() * (24 + 8 + 4 + 2 * 40 + 24 + 1 + 4 + 4 + 1);
    // Two lists of corners, fraction, density, volume, and the elements around each node.
    let elements = level.mesh.elements.len() * (2 * 16 + 3 * 8 + 16 + 4);
    let stars = body.stars();
    let neighbours: usize =
        if stars.is_empty() { 0 } else { body.nodes_of(r).map(|n| stars.neighbours(n).len()).sum() };
    nodes
        + elements
        + neighbours * (4 + 24)
        + level.embedding.len() * (40 + 4)
        + (level.fixed.len() + level.ghosts.len()) * 4
}

impl fmt::Display for Report {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        let header = [
            "level",
            "spacing",
            "nodes",
            "elements",
            "volume",
            "centre",
            "inertia",
            "mass",
            "dihedral",
            "altitude",
            "step",
            "weight x, y, z; twist",
            "worst row",
            "memory",
        ];
        let mut rows = vec![header.map(String::from)];
        for (r, level) in self.levels.iter().enumerate() {
            let of_whole = |cell: String| if level.whole { cell } else { "region".into() };
            rows.push([
                r.to_string(),
                format!("{:.2} mm", 1e3 * level.spacing),
                level.nodes.to_string(),
                level.elements.to_string(),
                of_whole(format!("{:+.2} %", 100.0 * level.volume)),
                of_whole(format!("{:.2} %", 100.0 * level.centre)),
                of_whole(format!("{:+.2} %", 100.0 * level.inertia)),
                of_whole(format!("{:.4} kg", level.mass)),
                format!("{:.0} to {:.0}°", level.dihedral.0, level.dihedral.1),
                format!("{:.2} ({:.2}) mm", 1e3 * level.altitude.0, 1e3 * level.altitude.1),
                format!("{:.3} ms", 1e3 * level.step),
                match level.agreement {
                    Some(off) => {
                        let [x, y, z, about_x, about_y, about_z] = off.map(|off| format!("{:+.0}", 100.0 * off));
                        format!("{x} {y} {z}; {about_x} {about_y} {about_z} % (α {:.2})", level.stabilisation)
                    }
                    None => format!("(α {:.2})", level.stabilisation),
                },
                format!("{:.2}", level.extrapolation),
                format!("{:.1} MB", level.memory as Real / 1e6),
            ]);
        }
        let width = |c: usize| rows.iter().map(|row| row[c].chars().count()).max().unwrap_or(0);
        let widths: Vec<usize> = (0..header.len()).map(width).collect();
        for row in &rows {
            let cells: Vec<String> = row.iter().zip(&widths).map(|(cell, width)| format!("{cell:>width$}")).collect();
            writeln!(f, "{}", cells.join("  "))?;
        }
        self.warnings.iter().try_for_each(|warning| writeln!(f, "warning: {warning}"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::prepare::{Elements, Recipe, Region, Shape, prepare};
    use palpate_core::geometry::primitives::{box_mesh, box_surface};
    use palpate_core::math::Bounds;
    use palpate_core::model::Material;

    #[test]
    fn levels_are_compared_and_one_that_is_too_coarse_is_warned_of() {
        let size = Vec3::new(0.2, 0.04, 0.04);
        let of_levels = |spacings: Vec<Real>| {
            let bounds = Bounds::new(Vec3::repeat(-1e-6), Vec3::new(1e-6, size.y, size.z) + Vec3::y() * 1e-6);
            let recipe = Recipe {
                name: "bar".into(),
                shape: Shape::closed(box_surface(size, [40, 8, 8]), spacings),
                material: Material::from_young(1e4, 0.45, 1000.0),
                inclusions: vec![],
                holds: vec![Region { bounds, stiffness: None, exact: false }],
                elements: Elements::Smoothed,
                damping_ratio: 0.0,
            };
            report(&prepare(&recipe, &mut |_, _, _| {}).unwrap())
        };
        let fine = of_levels(vec![0.018, 0.012]);
        let [first, finest] = [0, 1].map(|r| fine.levels[r].agreement.unwrap());
        println!("{fine}");
        assert!(first.iter().all(|off| off.abs() < MOST_OFF && *off != 0.0) && finest == [0.0; LOADS.len()]);
        assert!(!fine.warnings.iter().any(|w| w.contains("too coarse")), "{:?}", fine.warnings);
        let coarse = of_levels(vec![0.06, 0.018]);
        println!("{coarse}");
        assert!(coarse.warnings.iter().any(|w| w.starts_with("level 0 is too coarse")), "{:?}", coarse.warnings);
    }

    #[test]
    fn nested_levels_are_warned_of() {
        let warned = |cells: [u32; 2]| {
            let recipe = Recipe {
                name: "cube".into(),
                shape: Shape::meshes(cells.map(|n| box_mesh(Vec3::repeat(0.1), [n; 3]))),
                material: Material::from_young(1e4, 0.3, 1000.0),
                inclusions: vec![],
                holds: vec![],
                elements: Default::default(),
                damping_ratio: 0.0,
            };
            let warnings = report(&prepare(&recipe, &mut |_, _, _| {}).unwrap()).warnings;
            warnings.iter().any(|w| w.contains("level 1 has a node where 100 % of level 0's nodes are"))
        };
        assert!(warned([4, 8]) && !warned([5, 8]));
    }
}
