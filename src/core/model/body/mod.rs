//! A body: everything about it that does not move. Built once, then only read.
//!
//! Nodes and elements of all levels are numbered through, coarsest level first: a node's number says its level.

mod check;
mod parts;
pub mod patches;
pub mod stars;
mod tissues;

pub use parts::{BodyParts, LabelParts, MaxwellBranch, MixtureParts, Support, material_in, vertices_in};

use super::constraint::MOST_PARTS;
use super::csr::Csr;
use super::material::Material;
use super::organ::{self, Organ, OrganLevel, OrganParts};
use crate::geometry::locate::Host;
use crate::geometry::{Moments, Surface};
use crate::hierarchy::Level;
use crate::ids::{Element, NONE, Node, OrganId, Triangle, Vertex};
use crate::math::{Real, Vec3};
use crate::visited::Visited;
use check::check;
use parts::finest_whole;
use patches::Patches;
use stars::Stars;

/// First bytes of a body file: name and format version.
const MAGIC: &[u8; 12] = b"palpate-bdy\x0d";

/// How much stiffer one element around a node is than another where the material counts as heterogeneous.
const CONTRAST: Real = 1.25;

/// A body ready to be stepped: its parts, and what follows from them.
#[derive(Debug)]
pub struct Body {
    parts: BodyParts,
    /// First node and first element of each level, and their totals.
    first_node: Vec<u32>,
    first_element: Vec<u32>,
    level_of_node: Vec<u8>,
    organs: Vec<Organ>,
    organ_of_node: Vec<OrganId>,
    rest: Vec<Vec3>,
    elements: Vec<[Node; 4]>,
    volume: Vec<Real>,
    around: Csr<Element>,
    neighbours: Csr<Node>,
    children: Csr<Node>,
    hosted: Csr<Vertex>,
    fixed: Vec<bool>,
    ghosts: Vec<bool>,
    heterogeneous: Vec<bool>,
    mass: Real,
    centre: Vec3,
    vertex_area: Vec<Real>,
    patches: Patches,
    stars: Stars,
    adjacency: Csr<Triangle>,
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
        let elements: Vec<[Node; 4]> = levels()
            .flat_map(|(r, l)| l.mesh.elements.iter().map(move |e| (r, e)))
            .map(|(r, e)| e.map(|n| Node(first_node[r] + n)))
            .collect();
        let (mut fixed, mut ghosts) = (vec![false; nodes], vec![false; nodes]);
        let mut parents = Vec::with_capacity(nodes);
        for (r, level) in levels() {
            level.fixed.iter().for_each(|n| fixed[(first_node[r] + n) as usize] = true);
            level.ghosts.iter().for_each(|n| ghosts[(first_node[r] + n) as usize] = true);
            let coarser = first_node[r.max(1) - 1];
            let own = (first_node[r]..).zip(&level.parent).map(|(n, p)| ((coarser + p) as usize, Node(n)));
            // A ghost node is nobody's child: it never stands for anything.
            parents.extend(own.filter(|(_, n)| !ghosts[n.index()]));
        }
        let hosts: Vec<(usize, Vertex)> = levels()
            .flat_map(|(r, l)| l.embedding.iter().enumerate().map(move |(v, h)| (r, Vertex::at(v), h.element)))
            .filter(|(_, _, e)| *e != NONE)
            .map(|(r, v, e)| ((first_element[r] + e) as usize, v))
            .collect();
        let corners = elements.iter().enumerate().flat_map(|(e, nodes)| nodes.map(|n| (n.index(), Element::at(e))));
        let around = Csr::new(nodes, corners);
        // Each node once, in the order in which the elements around bring them.
        let mut seen = Visited::new(nodes);
        let mut pairs = Vec::with_capacity(16 * nodes);
        for n in 0..nodes {
            seen.clear();
            for m in around.of(n).iter().flat_map(|e| elements[e.index()]) {
                if seen.visit(m.index()) {
                    pairs.push((n, m));
                }
            }
        }
        let neighbours = Csr::new(nodes, pairs.iter().copied());
        let shear = |e: &Element| {
            let level = first_element.partition_point(|first| *first <= e.0) - 1;
            let material =
                material_in(&parts.materials, &parts.material_of[level], (e.0 - first_element[level]) as usize);
            material.mu + material.fibres.modulus
        };
        let is_heterogeneous = |n: usize| {
            let moduli = || around.of(n).iter().map(shear);
            moduli().fold(0.0, Real::max) > CONTRAST * moduli().fold(Real::INFINITY, Real::min)
        };
        let heterogeneous = (0..nodes).map(|n| parts.materials.len() > 1 && is_heterogeneous(n)).collect();
        let triangles = parts.surface.triangles.iter().enumerate();
        let one =
            OrganParts::whole(&parts.name, parts.surface.vertices.len(), parts.surface.triangles.len(), &parts.levels);
        let organs = if parts.organs.is_empty() { std::slice::from_ref(&one) } else { &parts.organs[..] };
        let of_level =
            |r: usize| (0..).map(OrganId).zip(organs).map(move |(i, organ)| (i, organ.levels[r].nodes as usize));
        let organ_of_node =
            levels().flat_map(|(r, _)| of_level(r)).flat_map(|(i, n)| std::iter::repeat_n(i, n)).collect();
        let finest = finest_whole(&parts.levels);
        let vertex_area = parts.surface.vertex_areas();
        let organs = organ::organs(organs, finest, &parts.levels);
        let of_organs: Vec<_> =
            organs.iter().map(|organ| (organ.vertices.clone(), organ.levels[finest].spacing)).collect();
        let mut body = Body {
            level_of_node: levels().flat_map(|(r, l)| vec![r as u8; l.mesh.nodes.len()]).collect(),
            organs,
            organ_of_node,
            rest: levels().flat_map(|(_, l)| l.mesh.nodes.iter().copied()).collect(),
            around,
            neighbours,
            children: Csr::new(nodes, parents.iter().copied()),
            hosted: Csr::new(elements.len(), hosts.iter().copied()),
            fixed,
            ghosts,
            heterogeneous,
            mass: parts.levels[finest].node_mass.iter().sum(),
            centre: parts.levels[finest].centre_of_mass(),
            patches: Patches::new(&parts.surface, &vertex_area, &of_organs),
            stars: Stars::default(),
            vertex_area,
            adjacency: Csr::new(
                parts.surface.vertices.len(),
                triangles.flat_map(|(t, triangle)| triangle.map(|v| (v as usize, Triangle::at(t)))),
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
        body.stars = Stars::new(&body);
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

    /// The nodes of all levels, coarsest level first.
    pub fn nodes(&self) -> impl ExactSizeIterator<Item = Node> + Clone + use<> {
        (0..self.rest.len() as u32).map(Node)
    }

    /// The elements of all levels, coarsest level first.
    pub fn elements(&self) -> impl ExactSizeIterator<Item = Element> + Clone + use<> {
        (0..self.elements.len() as u32).map(Element)
    }

    /// The nodes of level `r`.
    pub fn nodes_of(&self, r: usize) -> impl ExactSizeIterator<Item = Node> + Clone + use<> {
        (self.first_node[r]..self.first_node[r + 1]).map(Node)
    }

    /// The elements of level `r`.
    pub fn elements_of(&self, r: usize) -> impl ExactSizeIterator<Item = Element> + Clone + use<> {
        (self.first_element[r]..self.first_element[r + 1]).map(Element)
    }

    /// The vertices of the display surface.
    pub fn vertices(&self) -> impl ExactSizeIterator<Item = Vertex> + Clone + use<> {
        (0..self.surface().vertices.len() as u32).map(Vertex)
    }

    /// The three vertices of display triangle `t`.
    pub fn triangle(&self, t: Triangle) -> [Vertex; 3] {
        self.surface().triangles[t.index()].map(Vertex)
    }

    /// The three vertices of each display triangle.
    pub fn triangles(&self) -> impl ExactSizeIterator<Item = [Vertex; 3]> + Clone + '_ {
        self.surface().triangles.iter().map(|corners| corners.map(Vertex))
    }

    /// Level of node `n`.
    pub fn level_of(&self, n: Node) -> usize {
        usize::from(self.level_of_node[n.index()])
    }

    /// Level of element `e`.
    pub fn level_of_element(&self, e: Element) -> usize {
        self.level_of(self.elements[e.index()][0])
    }

    /// Level of element `e`, and its place among those of that level.
    pub fn place_of_element(&self, e: Element) -> (usize, usize) {
        let r = self.level_of_element(e);
        (r, (e.0 - self.first_element[r]) as usize)
    }

    /// Level of node `n`, and its place among those of that level.
    fn place_of(&self, n: Node) -> (usize, usize) {
        let r = self.level_of(n);
        (r, (n.0 - self.first_node[r]) as usize)
    }

    /// Rest position of node `n` [m].
    pub fn rest(&self, n: Node) -> Vec3 {
        self.rest[n.index()]
    }

    /// The four nodes of element `e`.
    pub fn element(&self, e: Element) -> [Node; 4] {
        self.elements[e.index()]
    }

    /// Rest positions of the nodes of element `e` [m].
    pub fn corners(&self, e: Element) -> [Vec3; 4] {
        self.element(e).map(|n| self.rest(n))
    }

    /// Elements around node `n`.
    pub fn elements_around(&self, n: Node) -> &[Element] {
        self.around.of(n.index())
    }

    /// How many triangles of the display surface one part of a tool may touch.
    pub fn points_of_a_part(&self) -> u32 {
        self.surface().triangles.len() as u32
    }

    /// The triangle of the point numbered as [`Constraint::point`](crate::model::Constraint::point).
    pub fn triangle_of_point(&self, point: u32) -> Triangle {
        Triangle(point % self.points_of_a_part())
    }

    /// Its corners.
    pub fn corners_of_point(&self, point: u32) -> [Vertex; 3] {
        self.triangle(self.triangle_of_point(point))
    }

    /// Patches of the display surface, each of which meets flat ground as one.
    pub fn patches(&self) -> &Patches {
        &self.patches
    }

    /// Number of patch `i` as a [`Constraint::point`](crate::model::Constraint::point): after those of all parts of a tool.
    pub fn point_of_patch(&self, i: u32) -> u32 {
        self.points_of_a_part() * MOST_PARTS as u32 + i
    }

    /// The patch with this number as a point; `None` for a triangle.
    pub fn patch_of_point(&self, point: u32) -> Option<&[(Vertex, Real)]> {
        point.checked_sub(self.point_of_patch(0)).map(|i| self.patches.of(i))
    }

    /// Nodes of the next finer level that stand for node `n` together; none where that does not reach.
    pub fn children(&self, n: Node) -> &[Node] {
        self.children.of(n.index())
    }

    /// Node of the next coarser level that stands for `n` and its siblings; [`Node::NONE`] on level 0.
    pub fn parent(&self, n: Node) -> Node {
        match self.place_of(n) {
            (0, _) => Node::NONE,
            (r, place) => Node(self.first_node[r - 1] + self.level(r).parent[place]),
        }
    }

    /// Where node `n` lies in the next coarser level; `None` on level 0.
    pub fn coarser_host(&self, n: Node) -> Option<Host<Element>> {
        let (r, place) = self.place_of(n);
        self.host_on(r.checked_sub(1)?, self.level(r).coarser_host[place])
    }

    /// Where node `n` lies in the next finer level. `None` on the finest, and where the next finer one does not reach.
    pub fn finer_host(&self, n: Node) -> Option<Host<Element>> {
        let (r, place) = self.place_of(n);
        let host = self.level(r).finer_host.get(place)?;
        self.host_on(r + 1, *host)
    }

    /// Where display vertex `v` lies on level `r`. `None` where the level does not reach.
    pub fn embedding(&self, r: usize, v: Vertex) -> Option<Host<Element>> {
        self.host_on(r, self.level(r).embedding[v.index()])
    }

    /// A node that carries display vertex `v` on level 0, which reaches everywhere.
    pub fn coarsest_carrier(&self, v: Vertex) -> Node {
        self.elements[self.level(0).embedding[v.index()].element as usize][0]
    }

    /// The host of level `r` as one of the body. `None` where the level does not reach.
    pub fn host_on(&self, r: usize, host: Host) -> Option<Host<Element>> {
        let Host { element, weights } = host;
        (element != NONE).then(|| Host { element: Element(self.first_element[r] + element), weights })
    }

    /// Display vertices that lie in element `e` on its level.
    pub fn hosted(&self, e: Element) -> &[Vertex] {
        self.hosted.of(e.index())
    }

    /// Level `r`.
    pub fn level(&self, r: usize) -> &Level {
        &self.parts.levels[r]
    }

    /// Index of the finest level.
    pub fn finest(&self) -> usize {
        self.parts.levels.len() - 1
    }

    /// Volume of element `e` inside the body [m³].
    pub fn volume(&self, e: Element) -> Real {
        self.volume[e.index()]
    }

    /// Part `α` of the energy of strain jumps that the tetrahedra around node `n` keep, 1 where they have all energy: see
    /// [`stars`].
    pub fn stabilisation(&self, n: Node) -> Real {
        self.organ_level(n).stabilisation
    }

    /// True where [`Body::stars`] have a part of the energy.
    pub fn is_smoothed(&self) -> bool {
        self.parts.is_smoothed()
    }

    /// The nodes' stars, which have the rest.
    pub fn stars(&self) -> &Stars {
        &self.stars
    }

    /// What element `e`, so many of whose nodes are active, has of its `material`, and not the stars of these.
    pub fn of_jumps(&self, material: &Material, e: Element, active: u8) -> Material {
        stars::of_jumps(&self.led(material, e), self.stabilisation_of(e, active))
    }

    /// Part α of the energy of strain jumps that element `e` keeps where so many of its nodes are active.
    pub fn stabilisation_of(&self, e: Element, active: u8) -> Real {
        let of_level = self.stabilisation(self.element(e)[0]);
        if active < 4 && of_level < 1.0 { stars::LARGEST } else { of_level }
    }

    /// The same that the star of node `n` leaves to the elements around it, of whose nodes so many are active: their mean by volume.
    pub fn stabilisation_around(&self, n: Node, active: impl Fn(Element) -> u8) -> Real {
        let (mut all, mut part) = (0.0, 0.0);
        for &e in self.elements_around(n) {
            all += self.volume(e);
            part += self.volume(e) * self.stabilisation_of(e, active(e));
        }
        part / all
    }

    /// Density of element `e` [kg/m³].
    pub fn density(&self, e: Element) -> Real {
        let (r, place) = self.place_of_element(e);
        self.parts.levels[r].density[place]
    }

    /// Mass [kg], centre [m] and second moments [kg m²] that every whole level is weighed to: the shape's, and what
    /// elements of the finest whole level are of another density for.
    pub fn mass_moments(&self) -> Moments {
        self.parts.mass_moments()
    }

    /// True for ghost nodes: never active, on the border of a level that covers only a region.
    pub fn is_ghost(&self, n: Node) -> bool {
        self.ghosts[n.index()]
    }

    /// The nodes of the elements around node `n`, itself among them.
    pub fn neighbours(&self, n: Node) -> &[Node] {
        self.neighbours.of(n.index())
    }

    /// True for nodes around which one element is much stiffer than another.
    pub fn is_heterogeneous(&self, n: Node) -> bool {
        self.heterogeneous[n.index()]
    }

    /// The nodes that cover the body together at level `r`, ascending: those of the level, and where it does not reach,
    /// those of the next coarser one.
    pub fn covering(&self, r: usize) -> Vec<Node> {
        let childless = |n: &Node| self.children(*n).is_empty();
        let coarser = (!self.level(r).is_whole()).then(|| self.nodes_of(r - 1).filter(childless));
        coarser.into_iter().flatten().chain(self.nodes_of(r).filter(|n| !self.is_ghost(*n))).collect()
    }

    /// True for nodes that do not move at all.
    pub fn is_fixed(&self, n: Node) -> bool {
        self.fixed[n.index()]
    }

    /// Springs that hold regions in space.
    pub fn supports(&self) -> &[Support] {
        &self.parts.supports
    }

    /// A third of the triangles around each display vertex [m²].
    pub fn vertex_area(&self) -> &[Real] {
        &self.vertex_area
    }

    /// Display triangles around display vertex `v`.
    pub fn triangles_around(&self, v: Vertex) -> &[Triangle] {
        self.adjacency.of(v.index())
    }

    /// Mass [kg], the same for every set of active nodes.
    pub fn mass(&self) -> Real {
        self.mass
    }

    /// The organs, one at least: pieces that share nothing.
    pub fn organs(&self) -> &[Organ] {
        &self.organs
    }

    /// An organ.
    pub fn organ(&self, organ: OrganId) -> &Organ {
        &self.organs[organ.index()]
    }

    /// Organ of node `n`.
    pub fn organ_of(&self, n: Node) -> OrganId {
        self.organ_of_node[n.index()]
    }

    /// What the level of node `n` has of its organ.
    fn organ_level(&self, n: Node) -> &OrganLevel {
        &self.organ(self.organ_of(n)).levels[self.level_of(n)]
    }

    /// Typical distance of nodes around node `n` on its level [m].
    pub fn spacing_at(&self, n: Node) -> Real {
        self.organ_level(n).spacing
    }

    /// Least mass of node `n` when it is active [kg].
    pub fn least_mass(&self, n: Node) -> Real {
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
