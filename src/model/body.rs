//! A body: everything about it that does not move. Built once, then only read.

use super::element_kernel::Elements;
use super::material::Material;
use crate::geometry::Surface;
use crate::hierarchy::Level;
use crate::math::{Real, Vec3};
use serde::{Deserialize, Serialize};
use std::collections::BTreeSet;

/// First bytes of a body file: name and format version.
const MAGIC: &[u8; 12] = b"palpate-bdy\x01";

/// A display vertex held in space by a spring.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Hold {
    /// Display vertex.
    pub vertex: u32,
    /// Stiffness [N/m]: the region's stiffness per area times the vertex's area.
    pub stiffness: Real,
}

/// What is saved of a body: its file.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct BodyParts {
    /// A name for people.
    pub name: String,
    /// The display surface at rest [m].
    pub surface: Surface,
    /// Independent levels, coarsest first.
    pub levels: Vec<Level>,
    /// Materials that elements refer to.
    pub materials: Vec<Material>,
    /// Material of each element, per level (n_elements); an empty list stands for material 0 everywhere.
    pub material_of: Vec<Vec<u8>>,
    /// Springs that hold regions in space, the same on every level.
    pub holds: Vec<Hold>,
    /// Index of the level that moves.
    pub active_level: u32,
}

/// A body ready to be stepped: its parts, and what follows from them.
#[derive(Debug)]
pub struct Body {
    parts: BodyParts,
    elements: Elements,
    inverse_mass: Vec<Real>,
    hold_rows: Vec<[(u32, Real); 4]>,
    vertex_area: Vec<Real>,
    adjacency_start: Vec<u32>,
    adjacency: Vec<u32>,
    bytes: Vec<u8>,
    checksum: u64,
    undamped_step: Real,
}

/// Why bytes are not a body.
#[derive(Debug, thiserror::Error, PartialEq)]
pub enum BodyError {
    /// Other first bytes.
    #[error("not a palpate body (it starts with other bytes): make one with this version of palpate")]
    Foreign,
    /// Cut short or changed.
    #[error("damaged body: its checksum does not match its content; build it again")]
    Damaged,
    /// Content that contradicts itself.
    #[error("inconsistent body: {0}")]
    Inconsistent(String),
}

impl Body {
    /// Checks the parts against each other and derives what stepping needs.
    ///
    /// # Errors
    /// When an index points nowhere or a number that must be positive is not.
    pub fn new(parts: BodyParts) -> Result<Body, BodyError> {
        check(&parts).map_err(BodyError::Inconsistent)?;
        let payload = postcard::to_stdvec(&parts).map_err(|e| BodyError::Inconsistent(e.to_string()))?;
        let checksum = xxhash_rust::xxh3::xxh3_64(&payload);
        let mut bytes = Vec::with_capacity(payload.len() + 20);
        bytes.extend_from_slice(MAGIC);
        bytes.extend_from_slice(&checksum.to_le_bytes());
        bytes.extend_from_slice(&payload);

        let level = &parts.levels[parts.active_level as usize];
        let material_of = &parts.material_of[parts.active_level as usize];
        let material = |e: usize| parts.materials[material_of.get(e).copied().unwrap_or_default() as usize];
        let elements = Elements::new(level, material);
        let mut inverse_mass: Vec<Real> = level.node_mass.iter().map(|m| 1.0 / m).collect();
        for &n in &level.fixed {
            inverse_mass[n as usize] = 0.0;
        }
        let hold_rows = parts
            .holds
            .iter()
            .map(|hold| {
                let host = &level.embedding[hold.vertex as usize];
                let nodes = level.mesh.elements[host.element as usize];
                std::array::from_fn(|i| (nodes[i], host.weights[i]))
            })
            .collect::<Vec<[(u32, Real); 4]>>();
        let (adjacency_start, adjacency) = vertex_triangles(&parts.surface);
        let undamped_step = undamped_step(level, &parts, &hold_rows, &inverse_mass);
        Ok(Body {
            vertex_area: parts.surface.vertex_areas(),
            elements,
            inverse_mass,
            hold_rows,
            adjacency_start,
            adjacency,
            bytes,
            checksum,
            undamped_step,
            parts,
        })
    }

    /// Reads a body back from [`Body::bytes`].
    ///
    /// # Errors
    /// When the bytes are foreign, damaged or inconsistent.
    pub fn from_bytes(bytes: &[u8]) -> Result<Body, BodyError> {
        let rest = bytes.strip_prefix(MAGIC).ok_or(BodyError::Foreign)?;
        let (checksum, payload) = rest.split_first_chunk::<8>().ok_or(BodyError::Damaged)?;
        if xxhash_rust::xxh3::xxh3_64(payload) != u64::from_le_bytes(*checksum) {
            return Err(BodyError::Damaged);
        }
        Body::new(postcard::from_bytes(payload).map_err(|_| BodyError::Damaged)?)
    }

    /// The body's file: magic, xxh3-64 of the rest, the parts (postcard).
    pub fn bytes(&self) -> &[u8] {
        &self.bytes
    }

    /// xxh3-64 of the parts' bytes.
    pub fn checksum(&self) -> u64 {
        self.checksum
    }

    /// A name for people.
    pub fn name(&self) -> &str {
        &self.parts.name
    }

    /// The display surface at rest [m].
    pub fn surface(&self) -> &Surface {
        &self.parts.surface
    }

    /// Every level, coarsest first.
    pub fn levels(&self) -> &[Level] {
        &self.parts.levels
    }

    /// Index of the level that moves.
    pub fn active_level(&self) -> usize {
        self.parts.active_level as usize
    }

    /// The level that moves.
    pub fn level(&self) -> &Level {
        &self.parts.levels[self.active_level()]
    }

    /// Material 0.
    pub fn material(&self) -> &Material {
        &self.parts.materials[0]
    }

    /// Material of element `e` of the level that moves.
    pub fn material_of(&self, e: usize) -> &Material {
        let index = self.parts.material_of[self.active_level()].get(e).copied().unwrap_or_default();
        &self.parts.materials[index as usize]
    }

    /// Elements of the level that moves, for the kernel.
    pub fn elements(&self) -> &Elements {
        &self.elements
    }

    /// 1/kg per node of the level that moves; 0 for nodes held fast.
    pub fn inverse_mass(&self) -> &[Real] {
        &self.inverse_mass
    }

    /// Springs and the rows of the points they hold.
    pub fn holds(&self) -> impl Iterator<Item = (&Hold, &[(u32, Real); 4])> {
        self.parts.holds.iter().zip(&self.hold_rows)
    }

    /// A third of the triangles around each display vertex [m²].
    pub fn vertex_area(&self) -> &[Real] {
        &self.vertex_area
    }

    /// Display triangles around display vertex `v`.
    pub fn triangles_around(&self, v: usize) -> &[u32] {
        &self.adjacency[self.adjacency_start[v] as usize..self.adjacency_start[v + 1] as usize]
    }

    /// Mass at rest [kg].
    pub fn mass(&self) -> Real {
        self.level().node_mass.iter().sum()
    }

    /// Longest viscous relaxation time of any material [s].
    pub fn damping_time(&self) -> Real {
        self.parts.materials.iter().map(Material::damping_time).fold(0.0, Real::max)
    }

    /// Longest stable step [s] of the level that moves, undamped and at rest, with its safety factor.
    pub fn undamped_step(&self) -> Real {
        self.undamped_step
    }
}

fn check(parts: &BodyParts) -> Result<(), String> {
    let vertices = parts.surface.vertices.len();
    if parts.levels.is_empty() || parts.active_level as usize >= parts.levels.len() {
        return Err(format!("active level {} of {} levels", parts.active_level, parts.levels.len()));
    }
    if parts.materials.is_empty() || parts.material_of.len() != parts.levels.len() {
        return Err("every level needs its materials".into());
    }
    for m in &parts.materials {
        let positive = m.mu > 0.0 && m.density > 0.0 && m.pressure_modulus() > 0.0 && m.phi >= 0.0 && m.psi >= 0.0;
        if !positive || !m.pressure_modulus().is_finite() {
            return Err(format!("material {m:?} is not a stable solid"));
        }
    }
    if parts.surface.triangles.is_empty() || parts.surface.triangles.iter().flatten().any(|v| *v as usize >= vertices) {
        return Err("a display triangle names a vertex that does not exist".into());
    }
    if parts.holds.iter().any(|h| h.vertex as usize >= vertices || !(h.stiffness >= 0.0 && h.stiffness.is_finite())) {
        return Err("a hold names a vertex that does not exist or has a bad stiffness".into());
    }
    for (i, level) in parts.levels.iter().enumerate() {
        let (nodes, elements) = (level.mesh.nodes.len(), level.mesh.elements.len());
        let in_range = |n: &u32| (*n as usize) < nodes;
        let whole = !level.mesh.elements.is_empty()
            && level.mesh.elements.iter().flatten().all(in_range)
            && level.fraction.len() == elements
            && level.fraction.iter().all(|w| *w > 0.0 && *w <= 1.0 + 1e-9)
            && level.node_mass.len() == nodes
            && level.embedding.len() == vertices
            && level.embedding.iter().all(|h| (h.element as usize) < elements)
            && level.fixed.iter().all(in_range)
            && (parts.material_of[i].is_empty() || parts.material_of[i].len() == elements)
            && parts.material_of[i].iter().all(|m| (*m as usize) < parts.materials.len());
        if !whole {
            return Err(format!("level {i}: its arrays do not fit together"));
        }
        let positive = level.altitude > 0.0
            && level.spacing > 0.0
            && level.node_mass.iter().all(|m| *m > 0.0 && m.is_finite())
            && (0..elements).all(|e| level.mesh.volume(e) > 0.0);
        if !positive {
            return Err(format!("level {i}: an element without volume or a node without mass"));
        }
    }
    for i in 1..parts.levels.len() {
        let (coarse, fine) = (&parts.levels[i - 1], &parts.levels[i]);
        let parents: BTreeSet<u32> = fine.parent.iter().copied().collect();
        if fine.parent.len() != fine.mesh.nodes.len()
            || fine.coarser_host.len() != fine.mesh.nodes.len()
            || coarse.finer_host.len() != coarse.mesh.nodes.len()
            || parents.len() != coarse.mesh.nodes.len()
            || parents.last().is_some_and(|p| *p as usize >= coarse.mesh.nodes.len())
        {
            return Err(format!(
                "levels {} and {i}: every coarse node needs a finer child; order the levels from coarse to fine \
                 (now {} and {} nodes)",
                i - 1,
                coarse.mesh.nodes.len(),
                fine.mesh.nodes.len()
            ));
        }
    }
    Ok(())
}

/// Triangles around each vertex, as starts (n_vertices + 1) into one list.
fn vertex_triangles(surface: &Surface) -> (Vec<u32>, Vec<u32>) {
    let mut start = vec![0u32; surface.vertices.len() + 1];
    for &v in surface.triangles.iter().flatten() {
        start[v as usize + 1] += 1;
    }
    for v in 1..start.len() {
        start[v] += start[v - 1];
    }
    let mut next = start.clone();
    let mut list = vec![0; surface.triangles.len() * 3];
    for (t, triangle) in surface.triangles.iter().enumerate() {
        for &v in triangle {
            list[next[v as usize] as usize] = t as u32;
            next[v as usize] += 1;
        }
    }
    (start, list)
}

/// Part of the explicit limit that is used. Meshes of regular elements become unstable at 0.9 altitudes per wave
/// travel time (the factor below them is the margin for cut elements and for the sub-step in which a strain grows).
const SAFETY: Real = 0.75;

/// `Δt = SAFETY · altitude / c`, shortened where springs add stiffness: `ω² ≤ ω_elements² + ω_springs²`.
fn undamped_step(level: &Level, parts: &BodyParts, rows: &[[(u32, Real); 4]], inverse_mass: &[Real]) -> Real {
    let speed = parts.materials.iter().map(Material::wave_speed).fold(0.0, Real::max);
    let elements = 2.0 * speed / (SAFETY * level.altitude);
    let springs = fastest_spring(&parts.holds, rows, inverse_mass);
    2.0 / (elements * elements + springs).sqrt()
}

/// Largest eigenvalue [1/s²] of `M⁻¹K`, K the springs' stiffness: what they add to `ω²` at most.
///
/// K is the same along every axis, so one is enough. Power iteration from below converges to it; the last factor
/// covers what is missing after this many rounds.
fn fastest_spring(holds: &[Hold], rows: &[[(u32, Real); 4]], inverse_mass: &[Real]) -> Real {
    let mut shape = vec![1.0; inverse_mass.len()];
    let mut eigenvalue = 0.0;
    for _ in 0..100 {
        let mut next = vec![0.0; shape.len()];
        for (hold, row) in holds.iter().zip(rows) {
            let stretch: Real = row.iter().map(|(n, w)| w * shape[*n as usize]).sum();
            for (n, w) in row {
                next[*n as usize] += hold.stiffness * stretch * w * inverse_mass[*n as usize];
            }
        }
        eigenvalue = next.iter().fold(0.0, |most: Real, x| most.max(x.abs()));
        if eigenvalue == 0.0 {
            return 0.0;
        }
        shape = next.into_iter().map(|x| x / eigenvalue).collect();
    }
    1.05 * eigenvalue
}

/// Display vertices within a region, for [`Hold`]s and probes: those that `inside` accepts.
pub fn vertices_in(surface: &Surface, inside: impl Fn(&Vec3) -> bool) -> Vec<u32> {
    (0..surface.vertices.len()).filter(|v| inside(&surface.vertices[*v])).map(|v| v as u32).collect()
}
