//! A body: everything about it that does not move. Built once, then only read.
//!
//! Nodes and elements of all levels are numbered through, coarsest level first: a node's number says its level.

use super::csr::Csr;
use super::material::Material;
use super::node_compliance::NodeCompliance;
use super::organ::{self, Organ, OrganLevel, OrganParts};
use crate::geometry::locate::Host;
use crate::geometry::{Moments, Surface, TetMesh};
use crate::hierarchy::level::{NOWHERE, mean_edge};
use crate::hierarchy::{Level, embedding};
use crate::math::{Real, Vec3};
use serde::{Deserialize, Serialize};

/// First bytes of a body file: name and format version.
const MAGIC: &[u8; 12] = b"palpate-bdy\x09";

/// Stands for "no node", "no element".
pub const NONE: u32 = u32::MAX;

/// How much stiffer one element around a node is than another where the material counts as uneven.
const CONTRAST: Real = 1.25;

/// A display vertex held in space by a spring.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Hold {
    /// Display vertex.
    pub vertex: u32,
    /// Stiffness [N/m]: the region's stiffness per area times the vertex's area.
    pub stiffness: Real,
}

/// A Maxwell branch of the deviatoric stress: part of a Prony series.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct MaxwellBranch {
    /// Shear modulus of the branch over μ.
    pub modulus: Real,
    /// Relaxation time [s].
    pub time: Real,
}

/// Which labels of the files that a body was made from its elements bear.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct LabelParts {
    /// What the files call them.
    pub name: String,
    /// Labels, and how many 64ths of an element's volume bear each.
    pub mixtures: Vec<Vec<(i64, u8)>>,
    /// Place in `mixtures` of each element's, per level (n_elements); an empty list where there are no labels.
    pub of: Vec<Vec<u16>>,
}

/// What is saved of a body: its file.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct BodyParts {
    /// A name for people.
    pub name: String,
    /// The display surface at rest [m].
    pub surface: Surface,
    /// Volume, centre and second moments of the shape that it was made from [m].
    pub shape: Moments,
    /// Independent levels, coarsest first.
    pub levels: Vec<Level>,
    /// Materials that elements refer to.
    pub materials: Vec<Material>,
    /// Material of each element, per level (n_elements); an empty list stands for material 0 everywhere.
    pub material_of: Vec<Vec<u16>>,
    /// Labels that regions of the material go by.
    pub labels: LabelParts,
    /// Springs that hold regions in space, the same on every level.
    pub holds: Vec<Hold>,
    /// Maxwell branches of every material, at most two.
    pub maxwell: Vec<MaxwellBranch>,
    /// Angular frequency of the slowest mode [rad/s], as calibration found it; 0 when nothing moves.
    pub slowest_mode: Real,
    /// The organs, where there are several; empty: the body is one.
    pub organs: Vec<OrganParts>,
}

impl BodyParts {
    /// Of one mesh, which is the only level, all of one material, touched and shown by `surface`, which is to be its
    /// boundary or near it. Nothing holds it or damps it yet.
    pub fn of_mesh(name: &str, mesh: TetMesh, surface: Surface, material: Material) -> Self {
        let whole = vec![1.0; mesh.elements.len()];
        let (shape, spacing) = (Moments::of_mesh(&mesh, &whole), mean_edge(&mesh));
        let mut levels = vec![Level::new(mesh, whole, spacing, material.density)];
        embedding::embed(&mut levels, &surface.vertices);
        Self {
            name: name.to_owned(),
            surface,
            shape,
            levels,
            materials: vec![material],
            material_of: vec![Vec::new()],
            labels: LabelParts::default(),
            holds: Vec::new(),
            maxwell: Vec::new(),
            slowest_mode: 0.0,
            organs: Vec::new(),
        }
    }

    /// [`Body::mass_moments`].
    pub fn mass_moments(&self) -> Moments {
        let r = self.levels.iter().rposition(Level::is_whole).unwrap_or_default();
        let level = &self.levels[r];
        let density = |e: usize| material_in(&self.materials, &self.material_of[r], e).density;
        let weights: Vec<Real> = level.fraction.iter().enumerate().map(|(e, part)| part * density(e)).collect();
        let base = self.materials[0].density;
        let (all, plain) = (Moments::of_mesh(&level.mesh, &weights), Moments::of_mesh(&level.mesh, &level.fraction));
        Moments::combined(&[(self.shape, base), (all, 1.0), (plain, -base)])
    }

    /// Gives the whole levels their masses, as their materials say.
    pub fn weigh(&mut self) {
        let wanted = self.mass_moments();
        for (level, of) in self.levels.iter_mut().zip(&self.material_of).filter(|(level, _)| level.is_whole()) {
            let elements = 0..level.mesh.elements.len();
            let density: Vec<Real> = elements.map(|e| material_in(&self.materials, of, e).density).collect();
            level.weigh(&density, &wanted);
        }
    }
}

/// A body ready to be stepped: its parts, and what follows from them.
#[derive(Debug)]
pub struct Body {
    parts: BodyParts,
    /// First node and first element of each level, and their totals.
    first_node: Vec<u32>,
    first_element: Vec<u32>,
    level_of_node: Vec<u8>,
    organs: Vec<Organ>,
    organ_of_node: Vec<u8>,
    rest: Vec<Vec3>,
    elements: Vec<[u32; 4]>,
    volume: Vec<Real>,
    around: Csr,
    neighbours: Csr,
    children: Csr,
    hosted: Csr,
    fixed: Vec<bool>,
    rim: Vec<bool>,
    uneven: Vec<bool>,
    compliance: NodeCompliance,
    mass: Real,
    centre: Vec3,
    vertex_area: Vec<Real>,
    adjacency: Csr,
    bytes: Vec<u8>,
    checksum: u64,
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
        Ok(Body::with_bytes(parts, bytes, checksum))
    }

    /// What follows from `parts`, which have been checked, and whose `bytes` these are.
    fn with_bytes(parts: BodyParts, bytes: Vec<u8>, checksum: u64) -> Body {
        let sums = |count: &dyn Fn(&Level) -> usize| {
            let mut sum = 0;
            std::iter::once(0)
                .chain(parts.levels.iter().map(|l| {
                    sum += count(l) as u32;
                    sum
                }))
                .collect::<Vec<u32>>()
        };
        let first_node = sums(&|l| l.mesh.nodes.len());
        let first_element = sums(&|l| l.mesh.elements.len());
        let levels = || parts.levels.iter().enumerate();
        let nodes = first_node[parts.levels.len()] as usize;
        let elements: Vec<[u32; 4]> = levels()
            .flat_map(|(r, l)| l.mesh.elements.iter().map(move |e| (r, e)))
            .map(|(r, e)| e.map(|n| n + first_node[r]))
            .collect();
        let (mut fixed, mut rim) = (vec![false; nodes], vec![false; nodes]);
        let mut parents = Vec::with_capacity(nodes);
        for (r, level) in levels() {
            level.fixed.iter().for_each(|n| fixed[(first_node[r] + n) as usize] = true);
            level.rim.iter().for_each(|n| rim[(first_node[r] + n) as usize] = true);
            let own = (first_node[r]..).zip(&level.parent).map(|(n, p)| (first_node[r.max(1) - 1] + p, n));
            // A node on the rim is nobody's child: it never stands for anything.
            parents.extend(own.filter(|(_, n)| !rim[*n as usize]));
        }
        let hosts: Vec<(u32, u32)> = levels()
            .flat_map(|(r, l)| l.embedding.iter().enumerate().map(move |(v, h)| (r, v as u32, h.element)))
            .filter(|(_, _, e)| *e != NOWHERE)
            .map(|(r, v, e)| (first_element[r] + e, v))
            .collect();
        let corners = elements.iter().enumerate().flat_map(|(e, nodes)| nodes.map(|n| (n, e as u32)));
        let around = Csr::new(nodes, corners);
        // Each node once, in the order in which the elements around bring them.
        let mut seen = vec![u32::MAX; nodes];
        let mut pairs = Vec::with_capacity(16 * nodes);
        for n in 0..nodes as u32 {
            for m in around.of(n).iter().flat_map(|e| elements[*e as usize]) {
                if std::mem::replace(&mut seen[m as usize], n) != n {
                    pairs.push((n, m));
                }
            }
        }
        let neighbours = Csr::new(nodes, pairs.iter().copied());
        let shear = |e: &u32| {
            let level = first_element.partition_point(|first| first <= e) - 1;
            material_in(&parts.materials, &parts.material_of[level], (e - first_element[level]) as usize).mu
        };
        let is_uneven = |n: u32| {
            let moduli = || around.of(n).iter().map(shear);
            moduli().fold(0.0, Real::max) > CONTRAST * moduli().fold(Real::INFINITY, Real::min)
        };
        let uneven = (0..nodes as u32).map(|n| parts.materials.len() > 1 && is_uneven(n)).collect();
        let triangles = parts.surface.triangles.iter().enumerate();
        let one =
            OrganParts::whole(&parts.name, parts.surface.vertices.len(), parts.surface.triangles.len(), &parts.levels);
        let organs = if parts.organs.is_empty() { std::slice::from_ref(&one) } else { &parts.organs[..] };
        let of_level = |r: usize| (0..).zip(organs).map(move |(i, organ)| (i, organ.levels[r].nodes as usize));
        let organ_of_node =
            levels().flat_map(|(r, _)| of_level(r)).flat_map(|(i, n)| std::iter::repeat_n(i, n)).collect();
        let finest = finest_whole(&parts.levels);
        let mut body = Body {
            level_of_node: levels().flat_map(|(r, l)| vec![r as u8; l.mesh.nodes.len()]).collect(),
            organs: organ::organs(organs, finest, &parts.levels),
            organ_of_node,
            rest: levels().flat_map(|(_, l)| l.mesh.nodes.iter().copied()).collect(),
            around,
            neighbours,
            children: Csr::new(nodes, parents.iter().copied()),
            hosted: Csr::new(elements.len(), hosts.iter().copied()),
            fixed,
            rim,
            uneven,
            compliance: NodeCompliance::default(),
            mass: parts.levels[finest].node_mass.iter().sum(),
            centre: parts.levels[finest].centre_of_mass(),
            vertex_area: parts.surface.vertex_areas(),
            adjacency: Csr::new(
                parts.surface.vertices.len(),
                triangles.flat_map(|(t, triangle)| triangle.map(|v| (v, t as u32))),
            ),
            volume: levels()
                .flat_map(|(_, l)| (0..l.mesh.elements.len()).map(|e| l.fraction[e] * l.mesh.volume(e)))
                .collect(),
            elements,
            first_node,
            first_element,
            bytes,
            checksum,
            parts,
        };
        body.compliance = NodeCompliance::new(&body);
        body
    }

    /// Reads a body back from [`Body::bytes`].
    ///
    /// # Errors
    /// When the bytes are foreign, damaged or inconsistent.
    pub fn from_bytes(bytes: &[u8]) -> Result<Body, BodyError> {
        let rest = bytes.strip_prefix(MAGIC).ok_or(BodyError::Foreign)?;
        let (checksum, payload) = rest.split_first_chunk::<8>().ok_or(BodyError::Damaged)?;
        let checksum = u64::from_le_bytes(*checksum);
        if xxhash_rust::xxh3::xxh3_64(payload) != checksum {
            return Err(BodyError::Damaged);
        }
        let parts = postcard::from_bytes(payload).map_err(|_| BodyError::Damaged)?;
        check(&parts).map_err(BodyError::Inconsistent)?;
        Ok(Body::with_bytes(parts, bytes.to_vec(), checksum))
    }

    /// The body's file: magic, xxh3-64 of the rest, the parts (postcard).
    pub fn bytes(&self) -> &[u8] {
        &self.bytes
    }

    /// What it was made of.
    pub fn parts(&self) -> &BodyParts {
        &self.parts
    }

    /// What it was made of.
    pub fn into_parts(self) -> BodyParts {
        self.parts
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

    /// Material 0.
    pub fn material(&self) -> &Material {
        &self.parts.materials[0]
    }

    /// Maxwell branches, at most two.
    pub fn maxwell(&self) -> &[MaxwellBranch] {
        &self.parts.maxwell
    }

    /// Angular frequency of the slowest mode [rad/s]; 0 when nothing moves.
    pub fn slowest_mode(&self) -> Real {
        self.parts.slowest_mode
    }

    /// Nodes of all levels.
    pub fn node_count(&self) -> usize {
        self.rest.len()
    }

    /// Elements of all levels.
    pub fn element_count(&self) -> usize {
        self.elements.len()
    }

    /// Numbers of the nodes of level `r`.
    pub fn nodes_of(&self, r: usize) -> std::ops::Range<u32> {
        self.first_node[r]..self.first_node[r + 1]
    }

    /// Numbers of the elements of level `r`.
    pub fn elements_of(&self, r: usize) -> std::ops::Range<u32> {
        self.first_element[r]..self.first_element[r + 1]
    }

    /// Level of node `n`.
    pub fn level_of(&self, n: u32) -> usize {
        usize::from(self.level_of_node[n as usize])
    }

    /// Level of element `e`.
    pub fn level_of_element(&self, e: u32) -> usize {
        self.level_of(self.elements[e as usize][0])
    }

    /// Rest position of node `n` [m].
    pub fn rest(&self, n: u32) -> Vec3 {
        self.rest[n as usize]
    }

    /// The four nodes of element `e`.
    pub fn element(&self, e: u32) -> [u32; 4] {
        self.elements[e as usize]
    }

    /// Rest positions of the nodes of element `e` [m].
    pub fn corners(&self, e: u32) -> [Vec3; 4] {
        self.element(e).map(|n| self.rest(n))
    }

    /// Elements around node `n`.
    pub fn elements_around(&self, n: u32) -> &[u32] {
        self.around.of(n)
    }

    /// Nodes of the next finer level that stand for node `n` together; none where that does not reach.
    pub fn children(&self, n: u32) -> &[u32] {
        self.children.of(n)
    }

    /// Node of the next coarser level that stands for `n` and its siblings; [`NONE`] on level 0.
    pub fn parent(&self, n: u32) -> u32 {
        match self.level_of(n) {
            0 => NONE,
            r => self.first_node[r - 1] + self.level(r).parent[(n - self.first_node[r]) as usize],
        }
    }

    /// Where node `n` lies in the next coarser level; `element` is numbered through. `None` on level 0.
    pub fn coarser_host(&self, n: u32) -> Option<Host> {
        let r = self.level_of(n).checked_sub(1)?;
        self.host_on(r, self.level(r + 1).coarser_host[(n - self.first_node[r + 1]) as usize])
    }

    /// Where node `n` lies in the next finer level; `element` is numbered through. `None` on the finest, and where the
    /// next finer one does not reach.
    pub fn finer_host(&self, n: u32) -> Option<Host> {
        let r = self.level_of(n);
        let host = self.level(r).finer_host.get((n - self.first_node[r]) as usize)?;
        self.host_on(r + 1, *host)
    }

    /// Where display vertex `v` lies on level `r`; `element` is numbered through. `None` where the level does not reach.
    pub fn embedding(&self, r: usize, v: u32) -> Option<Host> {
        self.host_on(r, self.level(r).embedding[v as usize])
    }

    fn host_on(&self, r: usize, host: Host) -> Option<Host> {
        (host.element != NOWHERE).then(|| Host { element: host.element + self.first_element[r], ..host })
    }

    /// Display vertices that lie in element `e` on its level.
    pub fn hosted(&self, e: u32) -> &[u32] {
        self.hosted.of(e)
    }

    /// Level `r`.
    pub fn level(&self, r: usize) -> &Level {
        &self.parts.levels[r]
    }

    /// Index of the finest level.
    pub fn finest(&self) -> usize {
        self.parts.levels.len() - 1
    }

    /// Material of element `e`.
    pub fn material_of(&self, e: u32) -> &Material {
        let r = self.level_of_element(e);
        material_in(&self.parts.materials, &self.parts.material_of[r], (e - self.first_element[r]) as usize)
    }

    /// Material under display vertex `v`, on the finest level that reaches there.
    pub fn material_at(&self, v: u32) -> &Material {
        let host = (0..self.levels().len()).rev().find_map(|r| self.embedding(r, v));
        host.map_or(self.material(), |host| self.material_of(host.element))
    }

    /// Volume of element `e` inside the body [m³].
    pub fn volume(&self, e: u32) -> Real {
        self.volume[e as usize]
    }

    /// Factor on the stiffness of element `e`, from calibration.
    pub fn stiffness_factor(&self, e: u32) -> Real {
        let r = self.level_of_element(e);
        self.parts.levels[r].stiffness_factor[(e - self.first_element[r]) as usize]
    }

    /// Factor on the moduli of element `e`'s Maxwell branches over μ, from calibration.
    pub fn branch_factor(&self, e: u32) -> Real {
        let r = self.level_of_element(e);
        self.parts.levels[r].branch_factor[(e - self.first_element[r]) as usize]
    }

    /// Density of element `e` [kg/m³].
    pub fn density(&self, e: u32) -> Real {
        let r = self.level_of_element(e);
        self.parts.levels[r].density[(e - self.first_element[r]) as usize]
    }

    /// Mass [kg], centre [m] and second moments [kg m²] that every whole level is weighed to: the shape's, and what
    /// elements of the finest whole level are of another density for.
    pub fn mass_moments(&self) -> Moments {
        self.parts.mass_moments()
    }

    /// How far node `k` gives way along the surface's normal for a newton on node `l` along it, about [m/N].
    pub fn compliance_between(&self, k: u32, l: u32) -> Real {
        self.compliance.between(k, l, (self.rest(k) - self.rest(l)).norm())
    }

    /// True for nodes that are never active, on the rim of a level that covers only a region.
    pub fn is_on_rim(&self, n: u32) -> bool {
        self.rim[n as usize]
    }

    /// The nodes of the elements around node `n`, itself among them.
    pub fn neighbours(&self, n: u32) -> &[u32] {
        self.neighbours.of(n)
    }

    /// True for nodes around which one element is much stiffer than another.
    pub fn is_uneven(&self, n: u32) -> bool {
        self.uneven[n as usize]
    }

    /// The nodes that cover the body together at level `r`, ascending: those of the level, and where it does not reach,
    /// those of the next coarser one.
    pub fn covering(&self, r: usize) -> Vec<u32> {
        let childless = |n: &u32| self.children(*n).is_empty();
        let coarser = if self.level(r).is_whole() { 0..0 } else { self.nodes_of(r - 1) };
        coarser.filter(childless).chain(self.nodes_of(r).filter(|n| !self.is_on_rim(*n))).collect()
    }

    /// True for nodes that do not move at all.
    pub fn is_fixed(&self, n: u32) -> bool {
        self.fixed[n as usize]
    }

    /// Springs that hold regions in space.
    pub fn holds(&self) -> &[Hold] {
        &self.parts.holds
    }

    /// A third of the triangles around each display vertex [m²].
    pub fn vertex_area(&self) -> &[Real] {
        &self.vertex_area
    }

    /// Display triangles around display vertex `v`.
    pub fn triangles_around(&self, v: usize) -> &[u32] {
        self.adjacency.of(v as u32)
    }

    /// Mass [kg], the same for every set of active nodes.
    pub fn mass(&self) -> Real {
        self.mass
    }

    /// The organs, one at least: pieces that share nothing.
    pub fn organs(&self) -> &[Organ] {
        &self.organs
    }

    /// Organ of node `n`.
    pub fn organ_of(&self, n: u32) -> usize {
        usize::from(self.organ_of_node[n as usize])
    }

    /// What the level of node `n` has of its organ.
    fn organ_level(&self, n: u32) -> &OrganLevel {
        &self.organs[self.organ_of(n)].levels[self.level_of(n)]
    }

    /// Typical distance of nodes around node `n` on its level [m].
    pub fn spacing_at(&self, n: u32) -> Real {
        self.organ_level(n).spacing
    }

    /// Least mass of node `n` when it is active [kg].
    pub fn least_mass(&self, n: u32) -> Real {
        self.organ_level(n).least_mass
    }

    /// Centre of mass at rest [m], the same for every set of active nodes.
    pub fn centre_of_mass(&self) -> Vec3 {
        self.centre
    }

    /// Longest viscous relaxation time of any material [s].
    pub fn damping_time(&self) -> Real {
        self.parts.materials.iter().map(Material::damping_time).fold(0.0, Real::max)
    }
}

/// What element `e` of a level is made of, from the body's `materials` and the level's list of [`BodyParts::material_of`].
pub fn material_in<'a>(materials: &'a [Material], of: &[u16], e: usize) -> &'a Material {
    &materials[usize::from(of.get(e).copied().unwrap_or_default())]
}

fn check(parts: &BodyParts) -> Result<(), String> {
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
        of.len() == level.mesh.elements.len() && of.iter().all(|m| usize::from(*m) < labels.mixtures.len())
    };
    if !labels.of.is_empty()
        && (labels.of.len() != parts.levels.len() || !parts.levels.iter().zip(&labels.of).all(labelled))
    {
        return Err("an element has no label".into());
    }
    for m in &parts.materials {
        let positive = m.mu > 0.0 && m.density > 0.0 && m.pressure_modulus() > 0.0 && m.phi >= 0.0 && m.psi >= 0.0;
        if !positive || ![m.pressure_modulus(), m.density, m.phi, m.psi].iter().all(|c| c.is_finite()) {
            return Err(format!("material {m:?} is not a stable solid"));
        }
    }
    if parts.surface.triangles.is_empty() || parts.surface.triangles.iter().flatten().any(|v| *v as usize >= vertices) {
        return Err("a display triangle names a vertex that does not exist".into());
    }
    if parts.holds.iter().any(|h| h.vertex as usize >= vertices || !(h.stiffness >= 0.0 && h.stiffness.is_finite())) {
        return Err("a hold names a vertex that does not exist or has a bad stiffness".into());
    }
    if !(parts.shape.volume > 0.0 && parts.shape.centre.iter().chain(&parts.shape.second).all(|x| x.is_finite())) {
        return Err("the shape has no volume, or moments that are no finite numbers".into());
    }
    if !(parts.surface.vertices.iter().all(finite) && parts.slowest_mode >= 0.0 && parts.slowest_mode.is_finite()) {
        return Err("a display vertex or the slowest mode is no finite number".into());
    }
    for (i, level) in parts.levels.iter().enumerate() {
        let (nodes, elements) = (level.mesh.nodes.len(), level.mesh.elements.len());
        let in_range = |n: &u32| (*n as usize) < nodes;
        let whole = !level.mesh.elements.is_empty()
            && level.mesh.elements.iter().flatten().all(in_range)
            && level.mesh.nodes.iter().all(finite)
            && level.fraction.len() == elements
            && level.fraction.iter().all(|w| *w > 0.0 && *w <= 1.0 + 1e-9)
            && level.stiffness_factor.len() == elements
            && level.branch_factor.len() == elements
            && level.density.len() == elements
            && level.node_mass.len() == nodes
            && level.embedding.len() == vertices
            && level.embedding.iter().all(|h| lies_in(h, elements) || !level.is_whole() && h.element == NOWHERE)
            && level.fixed.iter().chain(&level.rim).all(in_range)
            && (parts.material_of[i].is_empty() || parts.material_of[i].len() == elements)
            && parts.material_of[i].iter().all(|m| (*m as usize) < parts.materials.len());
        if !whole {
            return Err(format!("level {i}: its arrays do not fit together"));
        }
        let positive = level.altitude > 0.0
            && level.spacing > 0.0
            && level.least_mass >= 0.0
            && level.density.iter().all(|d| *d > 0.0 && d.is_finite())
            && level.stiffness_factor.iter().chain(&level.branch_factor).all(|f| *f > 0.0 && f.is_finite())
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
        fine.rim.iter().for_each(|n| on_rim[*n as usize] = true);
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
            return Err(format!("level {i} covers only a region, whose rim runs through a family"));
        }
        let hosts_above =
            |(h, childless): (&Host, &bool)| lies_in(h, fine.mesh.elements.len()) || *childless && h.element == NOWHERE;
        let hosted = fine.coarser_host.len() == fine.mesh.nodes.len()
            && coarse.finer_host.len() == coarse_nodes
            && fine.coarser_host.iter().all(|h| lies_in(h, coarse.mesh.elements.len()))
            && coarse.finer_host.iter().zip(&childless).all(hosts_above);
        if !hosted {
            return Err(format!("levels {} and {i}: a node lies in no element of the other level", i - 1));
        }
    }
    organ::check(parts)
}

/// Number of the finest level that covers the body as a whole: what the body weighs, and where its centre is.
fn finest_whole(levels: &[Level]) -> usize {
    levels.iter().rposition(Level::is_whole).unwrap_or(0)
}

/// False for what is no number or so far away [m] that it can only be damage: its products would not be finite.
fn finite(p: &Vec3) -> bool {
    p.iter().all(|c| c.abs() <= 1e6)
}

/// True for a row on one of `elements` elements whose weights sum to one.
fn lies_in(host: &Host, elements: usize) -> bool {
    (host.element as usize) < elements && (host.weights.iter().sum::<Real>() - 1.0).abs() < 1e-6
}

/// Display vertices within a region, for [`Hold`]s and probes: those that `inside` accepts.
pub fn vertices_in(surface: &Surface, inside: impl Fn(&Vec3) -> bool) -> Vec<u32> {
    (0..surface.vertices.len()).filter(|v| inside(&surface.vertices[*v])).map(|v| v as u32).collect()
}
