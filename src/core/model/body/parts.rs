//! What is saved of a body: its surface, its levels, what they are made of, and what holds them.

use crate::geometry::{Moments, Surface, TetMesh};
use crate::hierarchy::level::mean_edge;
use crate::hierarchy::{Level, embedding};
use crate::ids::Vertex;
use crate::math::Real;
use crate::math::Vec3;
use crate::model::material::Material;
use crate::model::organ::OrganParts;
use serde::{Deserialize, Serialize};

/// A display vertex held in space by a spring.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Support {
    /// Display vertex.
    pub vertex: Vertex,
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
    pub mixed_cells: Vec<Vec<(i64, u8)>>,
    /// Place in `mixed_cells` of each element's, per level (n_elements); an empty list where there are no labels.
    pub of: Vec<Vec<u16>>,
    /// Unit direction of the fibres in each element, zero where there are none, per level (n_elements); an empty list where the files have
    /// no directions.
    pub directions: Vec<Vec<Vec3>>,
}

/// What the materials of a body are mixed of.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct MixtureParts {
    /// Of each organ its tissue, and after it those of its regions, as each is alone.
    pub tissues: Vec<Material>,
    /// By material: its tissues, first the one around the others, and how many [`PARTS`](crate::model::material::PARTS) of it
    /// each is. Empty: each material is a tissue of its own.
    pub of: Vec<Vec<(u16, u8)>>,
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
    /// What they are mixed of.
    pub mixtures: MixtureParts,
    /// Labels that regions of the material go by.
    pub labels: LabelParts,
    /// Springs that hold regions in space, the same on every level.
    pub supports: Vec<Support>,
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
            mixtures: MixtureParts::default(),
            labels: LabelParts::default(),
            supports: Vec::new(),
            maxwell: Vec::new(),
            slowest_mode: 0.0,
            organs: Vec::new(),
        }
    }

    /// Material of element `e` of level `r`.
    pub fn material_at(&self, r: usize, e: usize) -> Material {
        self.led(material_in(&self.materials, &self.material_of[r], e), r, e)
    }

    /// `material` with the fibres of element `e` of level `r` where the files say how they lie.
    pub(super) fn led(&self, material: &Material, r: usize, e: usize) -> Material {
        match self.labels.directions.get(r) {
            Some(of) if material.fibres.are_there() => Material { fibres: material.fibres.led(of[e]), ..*material },
            _ => *material,
        }
    }

    /// True where [`stars`](super::stars) have a part of the energy.
    pub fn is_smoothed(&self) -> bool {
        self.levels.iter().any(|level| level.stabilisation < 1.0)
    }

    /// As [`Body::mass_moments`](super::Body::mass_moments).
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

/// What element `e` of a level is made of, from the body's `materials` and the level's list of [`BodyParts::material_of`].
pub fn material_in<'a>(materials: &'a [Material], of: &[u16], e: usize) -> &'a Material {
    &materials[usize::from(of.get(e).copied().unwrap_or_default())]
}

/// Number of the finest level that covers the body as a whole: what the body weighs, and where its centre is.
pub(super) fn finest_whole(levels: &[Level]) -> usize {
    levels.iter().rposition(Level::is_whole).unwrap_or(0)
}

/// Display vertices within a region, for [`Support`]s and probes: those that `inside` accepts.
pub fn vertices_in(surface: &Surface, inside: impl Fn(&Vec3) -> bool) -> Vec<Vertex> {
    (0..surface.vertices.len()).filter(|v| inside(&surface.vertices[*v])).map(Vertex::at).collect()
}
