//! Surfaces to look at: triangles with normals, texture coordinates, materials and pictures. OBJ with MTL, and glTF 2.0.
//!
//! Other than a surface that a body is made of, one that is only shown may be open, may cross itself, and may be of any
//! density.

mod gltf;
mod obj;

use super::mesh_error::MeshError;
use super::mesh_io::LengthUnit;
use super::reader::MAX_FILE;
use super::soundness::check_finite;
use palpate_core::geometry::Surface;
use palpate_core::math::Real;
use std::io::Read;
use std::path::{Component, Path, PathBuf};

/// Gives the bytes of the file of a name, which a mesh file refers to.
pub type Beside<'a> = &'a dyn Fn(&str) -> Result<Vec<u8>, MeshError>;

/// Largest total of a mesh's pictures [bytes]: every viewer gets them.
pub const MOST_PICTURE_BYTES: usize = 64 << 20;

/// A surface to look at.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct TexturedMesh {
    /// Vertices [m] and triangles, counter-clockwise seen from outside; a vertex of two texture coordinates stands twice.
    pub surface: Surface,
    /// Unit normals of the vertices, (n_vertices); empty where the file has none.
    pub normals: Vec<[f32; 3]>,
    /// Texture coordinates, (n_vertices): (0, 0) is the upper left corner of a picture, (1, 1) the lower right; empty where
    /// the file has none.
    pub uvs: Vec<[f32; 2]>,
    /// What the triangles look like: each material's stand one after another, in this order.
    pub materials: Vec<Material>,
    /// Pictures that materials refer to.
    pub pictures: Vec<Picture>,
}

/// What triangles look like.
#[derive(Clone, Debug, PartialEq)]
pub struct Material {
    /// Name in the file.
    pub name: String,
    /// How many triangles are of it.
    pub triangles: usize,
    /// Red, green and blue, linear, 0 to 1: a factor on the picture where there is one; `None`: the file does not say.
    pub colour: Option<[f32; 3]>,
    /// Place of its picture among [`TexturedMesh::pictures`].
    pub picture: Option<usize>,
}

/// A picture as its file has it.
#[derive(Clone, Debug, PartialEq)]
pub struct Picture {
    /// `image/png` or `image/jpeg`.
    pub media_type: &'static str,
    /// The file's bytes.
    pub bytes: Vec<u8>,
}

impl TexturedMesh {
    /// The surface to look at in the file at `path`, lengths in `unit`, with the files that it refers to in its folder or below.
    ///
    /// # Errors
    /// When a file is missing or damaged, holds no triangles, or a picture is neither PNG nor JPEG.
    pub fn read(path: &Path, unit: LengthUnit) -> Result<Self, MeshError> {
        let folder = path.parent().unwrap_or(Path::new(""));
        Self::parse(path, &read_file(path)?, &|name| read_file(&folder.join(below(name)?)), unit)
    }

    /// The surface to look at in `bytes`, lengths in `unit`; the extension of `path` tells the format, and `beside` gives the
    /// bytes of a file that it refers to.
    ///
    /// # Errors
    /// As [`TexturedMesh::read`].
    pub fn parse(path: &Path, bytes: &[u8], beside: Beside, unit: LengthUnit) -> Result<Self, MeshError> {
        let mut mesh = match path.extension().map(|e| e.to_string_lossy().to_lowercase()).as_deref() {
            Some("obj") => obj::parse(bytes, beside)?,
            Some("glb" | "gltf") => gltf::parse(bytes, beside)?,
            _ => {
                let what = format!("{} as a surface to look at", path.display());
                return Err(MeshError::Unsupported { what, remedy: "give an .obj, .glb or .gltf file" });
            }
        };
        if mesh.surface.triangles.is_empty() {
            return Err(MeshError::Empty { what: "triangles" });
        }
        mesh.surface.vertices.iter_mut().for_each(|v| *v *= unit.metres());
        check_finite(&mesh.surface.vertices)?;
        if mesh.pictures.iter().map(|picture| picture.bytes.len()).sum::<usize>() > MOST_PICTURE_BYTES {
            return Err(MeshError::TooBig { limit: MOST_PICTURE_BYTES, what: "bytes of pictures" });
        }
        Ok(mesh)
    }

    /// Adds triangles of the material `material`, whose vertices `mesh` numbers from 0.
    fn add(&mut self, material: Material, mesh: Piece) {
        let first = self.surface.vertices.len() as u32;
        let before = self.surface.vertices.len();
        // A mesh has normals or texture coordinates as soon as one of its pieces has some.
        fn extend<const N: usize>(all: &mut Vec<[f32; N]>, of: Vec<[f32; N]>, before: usize, count: usize) {
            if !of.is_empty() || !all.is_empty() {
                all.resize(before, [0.0; N]);
                all.extend(of);
                all.resize(before + count, [0.0; N]);
            }
        }
        extend(&mut self.normals, mesh.normals, before, mesh.positions.len());
        extend(&mut self.uvs, mesh.uvs, before, mesh.positions.len());
        self.surface
            .vertices
            .extend(mesh.positions.into_iter().map(|x| palpate_core::math::Vec3::from(x.map(Real::from))));
        self.surface.triangles.extend(mesh.triangles.into_iter().map(|t| t.map(|v| v + first)));
        self.materials.push(material);
    }
}

/// Triangles of one material.
#[derive(Default)]
struct Piece {
    positions: Vec<[f32; 3]>,
    normals: Vec<[f32; 3]>,
    uvs: Vec<[f32; 2]>,
    triangles: Vec<[u32; 3]>,
}

impl Picture {
    /// Of a file's bytes. Errors: those of another kind of file.
    fn new(name: &str, bytes: Vec<u8>) -> Result<Self, MeshError> {
        let media_type = match bytes.as_slice() {
            [0x89, b'P', b'N', b'G', ..] => "image/png",
            [0xff, 0xd8, 0xff, ..] => "image/jpeg",
            _ => {
                let what = format!("the picture {name}");
                return Err(MeshError::Unsupported { what, remedy: "save it as PNG or JPEG" });
            }
        };
        Ok(Self { media_type, bytes })
    }
}

/// The file `name`, which a mesh file refers to: one in its folder or below.
fn below(name: &str) -> Result<PathBuf, MeshError> {
    let file = PathBuf::from(name.replace('\\', "/"));
    let is_below = file.components().all(|part| matches!(part, Component::Normal(_) | Component::CurDir));
    if is_below && !name.contains(':') {
        return Ok(file);
    }
    let what = format!("the file {name}, which is elsewhere,");
    Err(MeshError::Unsupported { what, remedy: "put it beside the mesh file and name it there without its folder" })
}

fn read_file(path: &Path) -> Result<Vec<u8>, MeshError> {
    let failed = |reason| MeshError::Io { path: path.to_owned(), reason };
    let mut bytes = Vec::new();
    let file = std::fs::File::open(path).map_err(failed)?;
    file.take(MAX_FILE as u64 + 1).read_to_end(&mut bytes).map_err(failed)?;
    if bytes.len() > MAX_FILE {
        return Err(MeshError::TooBig { limit: MAX_FILE, what: "bytes" });
    }
    Ok(bytes)
}

#[cfg(test)]
mod tests;
