//! Wavefront OBJ with its MTL files.

use super::{Beside, Material, MeshError, Picture, Piece, TexturedMesh};
use std::cell::RefCell;
use std::io::Cursor;
use std::path::Path;

/// Exponent between the colours of MTL files, as screens have them, and linear ones.
const GAMMA: f32 = 2.2;

pub(super) fn parse(bytes: &[u8], beside: Beside) -> Result<TexturedMesh, MeshError> {
    let wrong = |what: String| MeshError::Syntax { format: "OBJ", line: None, what };
    // The library multiplies numbers of vertices before it compares them with how many there are.
    if has_absurd_index(bytes) {
        return Err(wrong("a face refers to a vertex that does not exist".into()));
    }
    // Faces become triangles; each vertex has one position, one normal and one texture coordinate.
    let options = tobj::LoadOptions { single_index: true, triangulate: true, ignore_points: true, ignore_lines: true };
    let failed = RefCell::new(None);
    let (models, materials) =
        tobj::load_obj_buf(&mut Cursor::new(bytes), &options, |name: &Path| match beside(&name.to_string_lossy()) {
            // The library panics at a colour of fewer than three numbers.
            Ok(bytes) if has_short_colour(&bytes) => Err(tobj::LoadError::MaterialParseError),
            Ok(bytes) => tobj::load_mtl_buf(&mut Cursor::new(bytes)),
            Err(e) => {
                *failed.borrow_mut() = Some(e);
                Err(tobj::LoadError::OpenFileFailed)
            }
        })
        .map_err(|e| wrong(e.to_string()))?;
    if let Some(e) = failed.into_inner() {
        return Err(e);
    }
    let materials = materials.map_err(|e| wrong(format!("its material file: {e}")))?;
    let mut mesh = TexturedMesh::default();
    // Each picture once, whatever many materials have it.
    let mut pictures: Vec<String> = Vec::new();
    let mut looks: Vec<(String, Option<[f32; 3]>, Option<usize>)> = Vec::new();
    for material in materials {
        let picture = match &material.diffuse_texture {
            None => None,
            Some(text) => {
                // Options stand before the name.
                let has_options = text.trim_start().starts_with('-');
                let last = text.split_whitespace().last().unwrap_or_default();
                let name = if has_options { last } else { text.trim() }.to_owned();
                let known = pictures.iter().position(|picture| *picture == name);
                if known.is_none() {
                    mesh.pictures.push(Picture::new(&name, beside(&name)?)?);
                    pictures.push(name);
                }
                Some(known.unwrap_or(pictures.len() - 1))
            }
        };
        // Programs write black, or nothing, beside a picture that has all the colour.
        let colour = match (material.diffuse, picture) {
            (Some([0.0, 0.0, 0.0]) | None, Some(_)) => [1.0; 3],
            (colour, _) => colour.unwrap_or([0.8; 3]).map(|c| c.clamp(0.0, 1.0).powf(GAMMA)),
        };
        looks.push((material.name, Some(colour), picture));
    }
    for model in models {
        let own = model.mesh;
        let look = own.material_id.and_then(|id| looks.get(id));
        let (name, colour, picture) = look.cloned().unwrap_or((model.name, None, None));
        let piece = Piece {
            positions: own.positions.as_chunks::<3>().0.to_vec(),
            normals: own.normals.as_chunks::<3>().0.iter().copied().map(unit).collect(),
            // OBJ counts from below.
            uvs: own.texcoords.as_chunks::<2>().0.iter().map(|[u, v]| [*u, 1.0 - v]).collect(),
            triangles: own.indices.as_chunks::<3>().0.to_vec(),
        };
        mesh.add(Material { name, triangles: piece.triangles.len(), colour, picture }, piece);
    }
    Ok(mesh)
}

/// True where a face, line or point of the file `bytes` has a number larger than the file.
fn has_absurd_index(bytes: &[u8]) -> bool {
    String::from_utf8_lossy(bytes).lines().any(|line| {
        let mut words = line.split_whitespace();
        let is_absurd = |number: &str| number.parse::<i64>().is_ok_and(|n| n.unsigned_abs() > bytes.len() as u64);
        matches!(words.next(), Some("f" | "l" | "p")) && words.flat_map(|word| word.split('/')).any(is_absurd)
    })
}

/// True where a colour of the material file `bytes` has fewer than three numbers.
fn has_short_colour(bytes: &[u8]) -> bool {
    String::from_utf8_lossy(bytes).lines().any(|line| {
        let mut words = line.split_whitespace();
        matches!(words.next(), Some("Ka" | "Kd" | "Ks" | "Ke")) && words.count() < 3
    })
}

/// `normal` of unit length; one of no length as it is.
pub(super) fn unit(normal: [f32; 3]) -> [f32; 3] {
    let length = normal.iter().map(|c| c * c).sum::<f32>().sqrt();
    if length > 0.0 { normal.map(|c| c / length) } else { normal }
}
