//! What a body is made of, as it lies in files.

use super::body_file::InputFile;
use super::{Shape, boundary_surface, spacings};
use crate::geometry::mesh_io::{self, LengthUnit, Solid};
use crate::geometry::repair::Repairs;
use crate::geometry::{LabelledMesh, MeshError};
use palpate_core::hierarchy::level::mean_edge;
use palpate_core::math::Real;
use std::path::{Path, PathBuf};
use xxhash_rust::xxh3::xxh3_64;

/// A mesh that has been read.
#[derive(Clone, Debug, PartialEq)]
pub struct Input {
    /// Names and checksums of its files.
    pub files: Vec<InputFile>,
    /// What they hold, in metres.
    pub solid: Solid,
    /// What was repaired of it.
    pub repairs: Repairs,
}

impl Input {
    /// The solid in the file at `path`, lengths in `unit`, times `scale`; holes at most `holes` wide [m] are closed; its
    /// labels are those called `labels`, or without it what [`mesh_io::parse`] takes for some.
    ///
    /// # Errors
    /// When it cannot be read or is no solid.
    pub fn read(
        path: &Path,
        unit: LengthUnit,
        scale: Real,
        holes: Real,
        labels: Option<&str>,
    ) -> Result<Self, MeshError> {
        let files = mesh_io::read_files(path)?;
        let (mut solid, repairs) = mesh_io::parse(&files, unit, holes / scale, labels)?;
        let points = match &mut solid {
            Solid::Surface(surface) => &mut surface.vertices,
            Solid::Volume(mesh) => &mut mesh.mesh.nodes,
        };
        points.iter_mut().for_each(|p| *p *= scale);
        let name = |path: &Path| path.file_name().unwrap_or_default().to_string_lossy().into_owned();
        let named = |(path, bytes): &(PathBuf, Vec<u8>)| InputFile { name: name(path), checksum: xxh3_64(bytes) };
        Ok(Self { files: files.iter().map(named).collect(), solid, repairs })
    }
}

impl Input {
    /// What a report is to say of it: what was repaired, left out and found, a line each.
    pub fn said(&self) -> Vec<String> {
        let Repairs { left_out, notes, .. } = &self.repairs;
        let repaired = self.repairs.to_string();
        let mut said = if repaired == "nothing" { vec![] } else { vec![format!("repaired: {repaired}")] };
        said.extend(left_out.iter().map(|what| format!("left out: {what}")));
        said.extend(notes.iter().cloned());
        said
    }
}

/// How fine the levels of a covered surface are to be.
#[derive(Clone, Debug, PartialEq)]
pub enum Fineness {
    /// Four levels, by volume.
    Automatic,
    /// From a few hundred nodes down to this lattice constant [m].
    Finest(Real),
    /// These lattice constants [m], coarse to fine.
    Levels(Vec<Real>),
}

impl Fineness {
    /// The size of the finest elements [m] of a body of `solid`: of its lattice, or of its own where it is a level itself.
    pub fn finest_element(&self, solid: &Solid) -> Real {
        let volume = match solid {
            Solid::Surface(surface) => surface.volume(),
            Solid::Volume(mesh) if *self == Fineness::Automatic => return mean_edge(&mesh.mesh),
            Solid::Volume(_) => 0.0,
        };
        match self {
            Fineness::Automatic => spacings::automatic(volume)[3],
            Fineness::Finest(finest) => *finest,
            Fineness::Levels(spacings) => spacings.last().copied().unwrap_or_default(),
        }
    }
}

/// The shape that `solids` make together: one surface, or one mesh to which `fineness` applies, or meshes
/// that are the levels themselves, which are put in order. About `display_vertices` are shown of a covered surface.
///
/// # Errors
/// In words, when they make no body together.
pub fn shape(solids: Vec<Solid>, fineness: &Fineness, display_vertices: usize) -> Result<Shape, String> {
    let (mut surfaces, mut meshes) = (Vec::new(), Vec::new());
    for solid in solids {
        match solid {
            Solid::Surface(surface) => surfaces.push(surface),
            Solid::Volume(mesh) => meshes.push(mesh),
        }
    }
    let (surface, labelled) = match (surfaces.len(), meshes.len()) {
        (1, 0) => (surfaces.remove(0), None),
        (0, 1) if *fineness != Fineness::Automatic => {
            let mesh: LabelledMesh = meshes.remove(0);
            (boundary_surface(&mesh.mesh), Some(mesh))
        }
        (0, 1..) if *fineness == Fineness::Automatic => {
            meshes.sort_by_key(|mesh| mesh.mesh.nodes.len());
            return Ok(Shape::Meshes { meshes, display_vertices });
        }
        (0, _) => return Err("several meshes are the levels themselves: leave --levels and --finest out".into()),
        _ => return Err("one body takes one surface, or meshes alone: prepare the others by themselves".into()),
    };
    let spacings = match fineness {
        Fineness::Automatic => spacings::automatic(surface.volume()).to_vec(),
        Fineness::Finest(finest) => spacings::down_to(*finest, surface.volume()),
        Fineness::Levels(spacings) => spacings.clone(),
    };
    Ok(Shape::covered(surface, spacings, labelled, display_vertices))
}

#[cfg(test)]
mod tests {
    use super::*;
    use palpate_core::geometry::primitives::box_surface;
    use palpate_core::math::Vec3;

    #[test]
    fn a_surface_of_few_large_triangles_is_shown_in_small_ones_and_covered_as_it_is() {
        let box_of_twelve = box_surface(Vec3::new(0.2, 0.05, 0.05), [1; 3]);
        let shape = shape(vec![Solid::Surface(box_of_twelve.clone())], &Fineness::Automatic, 2500).unwrap();
        let Shape::Closed { surface, display: Some(display), .. } = shape else { panic!("{shape:?}") };
        assert_eq!(surface, box_of_twelve);
        assert!((1000..=2500).contains(&display.vertices.len()), "{}", display.vertices.len());
    }
}
