//! Whether the parts of a body fit together: what a damaged or a foreign file, or a fault of the preparation, may break.

use super::parts::{BodyParts, MixtureParts, finest_whole};
use crate::geometry::locate::Host;
use crate::hierarchy::Level;
use crate::ids::NONE;
use crate::math::{Real, Vec3};
use crate::model::fibres::Fibres;
use crate::model::organ::{MOST_ORGANS, OrganLevel, OrganParts};

/// Refuses parts that name what is not there, or of which a number that must be positive is not.
pub(super) fn check(parts: &BodyParts) -> Result<(), String> {
    let vertices = parts.surface.vertices.len();
    if parts.levels.is_empty() || parts.levels.len() > 16 {
        return Err(format!("{} levels: a body has 1 to 16", parts.levels.len()));
    }
    if parts.maxwell.len() > 2
        || parts.maxwell.iter().any(|b| !(b.modulus >= 0.0 && b.modulus.is_finite() && b.time > 0.0))
    {
        return Err(format!("Maxwell branches {:?}: at most two, each of positive time", parts.maxwell));
    }
    if parts.materials.is_empty() || parts.material_of.len() != parts.levels.len() {
        return Err("every level needs its materials".into());
    }
    let labels = &parts.labels;
    let labelled = |(level, of): (&Level, &Vec<u16>)| {
        of.len() == level.mesh.elements.len() && of.iter().all(|m| usize::from(*m) < labels.mixed_cells.len())
    };
    if !labels.of.is_empty()
        && (labels.of.len() != parts.levels.len() || !parts.levels.iter().zip(&labels.of).all(labelled))
    {
        return Err("an element has no label".into());
    }
    let led = |(level, of): (&Level, &Vec<Vec3>)| {
        of.len() == level.mesh.elements.len() && of.iter().all(|a| (a.norm() - 1.0).abs() < 1e-6 || *a == Vec3::zeros())
    };
    let (directions, levels) = (&labels.directions, &parts.levels);
    if !(directions.is_empty() || directions.len() == levels.len() && levels.iter().zip(directions).all(led)) {
        return Err("an element has no direction of fibres, or one that is not of length 1".into());
    }
    let MixtureParts { tissues, of } = &parts.mixtures;
    let known =
        |mixed: &Vec<(u16, u8)>| !mixed.is_empty() && mixed.iter().all(|(t, _)| usize::from(*t) < tissues.len());
    if !of.is_empty() && (of.len() != parts.materials.len() || !of.iter().all(known)) {
        return Err("a material is mixed of what is not there".into());
    }
    for m in parts.materials.iter().chain(tissues) {
        let positive = m.mu > 0.0 && m.density > 0.0 && m.pressure_modulus() > 0.0 && m.phi >= 0.0 && m.psi >= 0.0;
        if !positive || ![m.pressure_modulus(), m.density, m.phi, m.psi].iter().all(|c| c.is_finite()) {
            return Err(format!("material {m:?} is not a stable solid"));
        }
        let Fibres { modulus, direction } = m.fibres;
        let leads = (direction.norm() - 1.0).abs() < 1e-6 || direction == Vec3::zeros() && !directions.is_empty();
        if !(modulus == 0.0 || modulus > 0.0 && modulus.is_finite() && leads) {
            return Err(format!("material {m:?} has fibres without a stiffness or a direction"));
        }
    }
    if parts.surface.triangles.is_empty() || parts.surface.triangles.iter().flatten().any(|v| *v as usize >= vertices) {
        return Err("a display triangle names a vertex that does not exist".into());
    }
    if parts.supports.iter().any(|h| h.vertex.index() >= vertices || !(h.stiffness >= 0.0 && h.stiffness.is_finite())) {
        return Err("a hold names a vertex that does not exist or has a bad stiffness".into());
    }
    if !(parts.shape.volume > 0.0 && parts.shape.centre.iter().chain(&parts.shape.second).all(|x| x.is_finite())) {
        return Err("the shape has no volume, or moments that are no finite numbers".into());
    }
    if !(parts.surface.vertices.iter().all(finite) && parts.slowest_mode >= 0.0 && parts.slowest_mode.is_finite()) {
        return Err("a display vertex or the slowest mode is no finite number".into());
    }
    let organs = || parts.organs.iter().flat_map(|organ| &organ.levels).map(|level| level.stabilisation);
    let stabilisations = || parts.levels.iter().map(|level| level.stabilisation).chain(organs());
    if !stabilisations().all(|alpha| alpha > 0.0 && alpha <= 1.0) {
        return Err("a stabilisation is not above 0 and at most 1".into());
    }
    // A star of no stiffness would have no step.
    if stabilisations().any(|alpha| alpha < 1.0) && stabilisations().any(|alpha| alpha == 1.0) {
        return Err("some levels are of smoothed elements and others are not".into());
    }
    for (i, level) in parts.levels.iter().enumerate() {
        let (nodes, elements) = (level.mesh.nodes.len(), level.mesh.elements.len());
        let in_range = |n: &u32| (*n as usize) < nodes;
        let whole = !level.mesh.elements.is_empty()
            && level.mesh.elements.iter().flatten().all(in_range)
            && level.mesh.nodes.iter().all(finite)
            && level.fraction.len() == elements
            && level.fraction.iter().all(|w| *w > 0.0 && *w <= 1.0 + 1e-9)
            && level.density.len() == elements
            && level.node_mass.len() == nodes
            && level.embedding.len() == vertices
            && level.embedding.iter().all(|h| lies_in(h, elements) || !level.is_whole() && h.element == NONE)
            && level.fixed.iter().chain(&level.ghosts).all(in_range)
            && (parts.material_of[i].is_empty() || parts.material_of[i].len() == elements)
            && parts.material_of[i].iter().all(|m| (*m as usize) < parts.materials.len());
        if !whole {
            return Err(format!("level {i}: its arrays do not fit together"));
        }
        let positive = level.altitude > 0.0
            && level.spacing > 0.0
            && level.least_mass >= 0.0
            && level.density.iter().all(|d| *d > 0.0 && d.is_finite())
            && level.node_mass.iter().all(|m| *m > 0.0 && m.is_finite())
            && (0..elements).all(|e| level.mesh.volume(e) > 0.0);
        if !positive {
            return Err(format!("level {i}: an element without volume or a node without mass"));
        }
    }
    let (first, last) = (&parts.levels[0], &parts.levels[parts.levels.len() - 1]);
    if parts.levels[..parts.levels.len() - 1].iter().chain([first]).any(|level| !level.is_whole()) {
        return Err("a level covers only a region, but is not the finest of several".into());
    }
    let body_mass: Real = parts.levels[finest_whole(&parts.levels)].node_mass.iter().sum();
    for (i, level) in parts.levels.iter().enumerate().filter(|(_, level)| level.is_whole()) {
        let mass = |e: usize| level.density[e] * level.fraction[e] * level.mesh.volume(e);
        let of_elements = (0..level.mesh.elements.len()).map(mass).sum::<Real>();
        let of_nodes: Real = level.node_mass.iter().sum();
        if [of_elements, of_nodes].iter().any(|mass| !(0.5..2.0).contains(&(mass / body_mass))) {
            return Err(format!(
                "level {i} weighs {of_nodes:.3e} kg, its elements {of_elements:.3e} kg, the finest level {body_mass:.3e} kg: \
                 they are not of one body"
            ));
        }
    }
    if !(first.parent.is_empty() && first.coarser_host.is_empty() && last.finer_host.is_empty()) {
        return Err("the coarsest or the finest level is tied to one that is not there".into());
    }
    for i in 1..parts.levels.len() {
        let (coarse, fine) = (&parts.levels[i - 1], &parts.levels[i]);
        let coarse_nodes = coarse.mesh.nodes.len();
        if fine.parent.len() != fine.mesh.nodes.len() || fine.parent.iter().any(|p| *p as usize >= coarse_nodes) {
            return Err(format!("level {i}: a node has no parent"));
        }
        let mut on_rim = vec![false; fine.parent.len()];
        fine.ghosts.iter().for_each(|n| on_rim[*n as usize] = true);
        let (mut childless, mut unreached) = (vec![true; coarse_nodes], vec![false; coarse_nodes]);
        for (p, on_rim) in fine.parent.iter().zip(on_rim) {
            let mark = if on_rim { &mut unreached } else { &mut childless };
            mark[*p as usize] = on_rim;
        }
        if fine.is_whole() && childless.contains(&true) {
            return Err(format!(
                "levels {} and {i}: every coarse node needs a finer child; order the levels from coarse to fine \
                 (now {coarse_nodes} and {} nodes)",
                i - 1,
                fine.mesh.nodes.len()
            ));
        }
        // A family is in the region as a whole or not at all.
        if childless.iter().zip(&unreached).any(|(childless, unreached)| *unreached && !childless)
            || !childless.contains(&false)
        {
            return Err(format!("level {i} covers only a region, whose ghosts runs through a family"));
        }
        let hosts_above =
            |(h, childless): (&Host, &bool)| lies_in(h, fine.mesh.elements.len()) || *childless && h.element == NONE;
        let hosted = fine.coarser_host.len() == fine.mesh.nodes.len()
            && coarse.finer_host.len() == coarse_nodes
            && fine.coarser_host.iter().all(|h| lies_in(h, coarse.mesh.elements.len()))
            && coarse.finer_host.iter().zip(&childless).all(hosts_above);
        if !hosted {
            return Err(format!("levels {} and {i}: a node lies in no element of the other level", i - 1));
        }
    }
    check_organs(parts)
}

/// False for what is no number or so far away [m] that it can only be damage: its products would not be finite.
fn finite(p: &Vec3) -> bool {
    p.iter().all(|c| c.abs() <= 1e6)
}

/// True for a row on one of `elements` elements whose weights sum to one.
fn lies_in(host: &Host, elements: usize) -> bool {
    (host.element as usize) < elements && (host.weights.iter().sum::<Real>() - 1.0).abs() < 1e-6
}

/// Refuses organs that are not those of the body, or that share anything; all else of `parts` has been checked.
fn check_organs(parts: &BodyParts) -> Result<(), String> {
    let BodyParts { organs, surface, levels, materials, .. } = parts;
    if organs.is_empty() {
        return Ok(());
    }
    if organs.len() > MOST_ORGANS || organs.iter().any(|organ| organ.levels.len() != levels.len()) {
        return Err(format!("{} organs: a body has 1 to {MOST_ORGANS}, each on every level", organs.len()));
    }
    let of = |r: usize| organs.iter().map(move |organ| &organ.levels[r]);
    let positive = |level: &OrganLevel| level.spacing > 0.0 && level.least_mass >= 0.0;
    let known = |organ: &OrganParts| usize::from(organ.material) < materials.len();
    if !(0..levels.len()).flat_map(of).all(positive) || !organs.iter().all(known) {
        return Err("an organ has a spacing or a material that is none".into());
    }
    let shared = || "organs share a part, or have none of the surface or of a level".to_owned();
    let vertices = owners(organs.iter().map(|o| o.vertices), surface.vertices.len()).ok_or_else(shared)?;
    let triangles = owners(organs.iter().map(|o| o.triangles), surface.triangles.len()).ok_or_else(shared)?;
    // True where nothing names a thing of another organ.
    fn own(owner: &[u8], mut names: impl Iterator<Item = (usize, u32)>, of: &[u8]) -> bool {
        names.all(|(i, named)| named == NONE || of.get(named as usize) == Some(&owner[i]))
    }
    let corners = surface.triangles.iter().enumerate().flat_map(|(t, corners)| corners.map(|v| (t, v)));
    let mut apart = own(&triangles, corners, &vertices);
    let mut coarser: Option<(Vec<u8>, Vec<u8>)> = None;
    for (r, level) in levels.iter().enumerate() {
        let nodes = owners(of(r).map(|l| l.nodes), level.mesh.nodes.len()).ok_or_else(shared)?;
        let elements = owners(of(r).map(|l| l.elements), level.mesh.elements.len()).ok_or_else(shared)?;
        let corners = level.mesh.elements.iter().enumerate().flat_map(|(e, corners)| corners.map(|n| (e, n)));
        apart &= own(&elements, corners, &nodes);
        apart &= own(&vertices, hosts(&level.embedding), &elements);
        if let Some((coarse_nodes, coarse_elements)) = &coarser {
            apart &= own(&nodes, level.parent.iter().copied().enumerate(), coarse_nodes);
            apart &= own(&nodes, hosts(&level.coarser_host), coarse_elements);
            apart &= own(coarse_nodes, hosts(&levels[r - 1].finer_host), &elements);
        }
        coarser = Some((nodes, elements));
    }
    if apart { Ok(()) } else { Err(shared()) }
}

fn hosts(of: &[Host]) -> impl Iterator<Item = (usize, u32)> + '_ {
    of.iter().map(|host| host.element).enumerate()
}

/// Which organ each of `total` things is of, when `counts` says how many each has; `None` unless that is at least one
/// each and all of them together.
fn owners(counts: impl Iterator<Item = u32> + Clone, total: usize) -> Option<Vec<u8>> {
    let fits = counts.clone().all(|n| n > 0) && counts.clone().map(u64::from).sum::<u64>() == total as u64;
    fits.then(|| counts.zip(0..).flat_map(|(count, organ)| std::iter::repeat_n(organ, count as usize)).collect())
}
