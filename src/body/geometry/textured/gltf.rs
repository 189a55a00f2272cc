//! glTF 2.0 with its pictures: `.glb`, and `.gltf` with buffers and pictures inside or beside it.

use super::obj::unit;
use super::{Beside, Material, MeshError, Picture, Piece, TexturedMesh};
use crate::geometry::gltf::root;
use base64::Engine;
use base64::prelude::BASE64_STANDARD;
use gltf::image::Source;
use gltf::mesh::{Mode, Semantic};
use nalgebra::Matrix4;
use palpate_core::math::{Mat3, Real, Vec3};
use percent_encoding::percent_decode_str;

pub(super) fn parse(bytes: &[u8], beside: Beside) -> Result<TexturedMesh, MeshError> {
    // Not by the library, which panics where a file says that it is shorter than its header.
    let (root, blob) = root(bytes)?;
    // The library's check looks up positions before it has checked that there are so many accessors.
    let mut named = root.meshes.iter().flat_map(|mesh| &mesh.primitives).flat_map(|p| p.attributes.values());
    if named.any(|accessor| accessor.value() >= root.accessors.len()) {
        return Err(wrong("a mesh refers to an accessor that does not exist".into()));
    }
    // And it takes for granted that a picture in the file has a kind.
    let is_there = |image: &gltf_json::Image| match image.buffer_view {
        Some(_) => image.mime_type.is_some(),
        None => image.uri.is_some(),
    };
    if !root.images.iter().all(is_there) {
        return Err(wrong("a picture is neither in the file, with its kind, nor beside it".into()));
    }
    let document = gltf::Document::from_json(root).map_err(|e| wrong(e.to_string()))?;
    let buffers = document
        .buffers()
        .map(|buffer| {
            let bytes = match buffer.source() {
                gltf::buffer::Source::Bin => blob.unwrap_or_default().to_vec(),
                gltf::buffer::Source::Uri(uri) => content(uri, beside)?,
            };
            match bytes.len() < buffer.length() {
                true => Err(wrong(format!("buffer {} is cut off", buffer.index()))),
                false => Ok(bytes),
            }
        })
        .collect::<Result<Vec<_>, _>>()?;
    let mut mesh = TexturedMesh::default();
    for image in document.images() {
        let name = format!("{} of the file", image.index());
        let bytes = match image.source() {
            Source::Uri { uri, .. } => content(uri, beside)?,
            Source::View { view, .. } => buffers
                .get(view.buffer().index())
                .and_then(|buffer| buffer.get(view.offset()..view.offset().checked_add(view.length())?))
                .ok_or_else(|| wrong(format!("picture {} lies outside of its buffer", image.index())))?
                .to_vec(),
        };
        mesh.pictures.push(Picture::new(&name, bytes)?);
    }
    let scene = document.default_scene().or_else(|| document.scenes().next());
    let mut open: Vec<(gltf::Node, Matrix4<Real>)> = Vec::new();
    if let Some(scene) = scene {
        open.extend(scene.nodes().map(|node| (node, Matrix4::identity())));
    }
    let mut visited = 0;
    while let Some((node, outer)) = open.pop() {
        visited += 1;
        if visited > document.nodes().len() {
            return Err(wrong("its nodes go round in circles".into()));
        }
        let own = node.transform().matrix();
        let place = outer * Matrix4::from_fn(|row, column| Real::from(own[column][row]));
        open.extend(node.children().map(|child| (child, place)));
        for primitive in node.mesh().iter().flat_map(gltf::Mesh::primitives) {
            if primitive.mode() == Mode::Triangles {
                add(&mut mesh, &primitive, &buffers, &place)?;
            }
        }
    }
    Ok(mesh)
}

fn wrong(what: String) -> MeshError {
    MeshError::Syntax { format: "glTF", line: None, what: what.chars().take(200).collect() }
}

/// What `uri` names: data in it, or a file beside.
fn content(uri: &str, beside: Beside) -> Result<Vec<u8>, MeshError> {
    match uri.strip_prefix("data:").and_then(|uri| uri.split_once(";base64,")) {
        Some((_, text)) => BASE64_STANDARD.decode(text).map_err(|e| wrong(e.to_string())),
        None => beside(&percent_decode_str(uri).decode_utf8_lossy()),
    }
}

fn add(
    mesh: &mut TexturedMesh,
    primitive: &gltf::Primitive,
    buffers: &[Vec<u8>],
    place: &Matrix4<Real>,
) -> Result<(), MeshError> {
    // The library trusts what a file states of kinds and sizes.
    let indices = primitive.indices().map(|accessor| (None, accessor));
    for (what, accessor) in primitive.attributes().map(|(what, accessor)| (Some(what), accessor)).chain(indices) {
        use gltf::accessor::{DataType, Dimensions};
        let (number, dimensions) = (accessor.data_type(), accessor.dimensions());
        let is_read = match what {
            Some(Semantic::Positions | Semantic::Normals) => (number, dimensions) == (DataType::F32, Dimensions::Vec3),
            Some(Semantic::TexCoords(_)) => {
                dimensions == Dimensions::Vec2 && matches!(number, DataType::F32 | DataType::U8 | DataType::U16)
            }
            None => dimensions == Dimensions::Scalar && matches!(number, DataType::U8 | DataType::U16 | DataType::U32),
            Some(_) => continue,
        };
        let Some(view) = accessor.view().filter(|_| is_read && accessor.sparse().is_none()) else {
            let what =
                format!("accessor {} of a glTF file, which is sparse or of another kind of number,", accessor.index());
            return Err(MeshError::Unsupported { what, remedy: "export it as .glb without compression" });
        };
        let stride = view.stride().unwrap_or(accessor.size());
        let last = accessor.count().checked_sub(1).and_then(|n| n.checked_mul(stride));
        let end = last.and_then(|last| last.checked_add(accessor.size())?.checked_add(accessor.offset()));
        let held = buffers.get(view.buffer().index()).and_then(|b| b.get(view.offset()..)).map_or(0, <[u8]>::len);
        if end.is_none_or(|end| end > view.length().min(held)) {
            return Err(wrong(format!("accessor {} lies outside of its buffer", accessor.index())));
        }
    }
    let reader = primitive.reader(|buffer| buffers.get(buffer.index()).map(Vec::as_slice));
    let positions: Vec<[f32; 3]> =
        reader.read_positions().ok_or_else(|| wrong("triangles without positions".into()))?.collect();
    let corners: Vec<u32> = match reader.read_indices() {
        Some(indices) => indices.into_u32().collect(),
        None => (0..positions.len() as u32).collect(),
    };
    if corners.iter().any(|v| *v as usize >= positions.len()) {
        return Err(wrong("a triangle refers to a vertex that does not exist".into()));
    }
    let own = primitive.material();
    let looks = own.pbr_metallic_roughness();
    let texture = looks.base_color_texture();
    let set = texture.as_ref().map_or(0, gltf::texture::Info::tex_coord);
    let uvs: Vec<[f32; 2]> = reader.read_tex_coords(set).map_or_else(Vec::new, |uvs| uvs.into_f32().collect());
    let linear: Mat3 = place.fixed_view::<3, 3>(0, 0).into_owned();
    // Normals go with the inverse transpose; a mirrored mesh is turned inside out with its triangles.
    let turn = linear.try_inverse().unwrap_or_else(Mat3::identity).transpose();
    let mirrored = linear.determinant() < 0.0;
    let single = |v: Vec3| [v.x as f32, v.y as f32, v.z as f32];
    let moved = |x: [f32; 3]| single((place * Vec3::from(x.map(Real::from)).push(1.0)).xyz());
    let turned = |n: [f32; 3]| unit(single(turn * Vec3::from(n.map(Real::from))));
    let [r, g, b, _] = looks.base_color_factor();
    let triangles: Vec<[u32; 3]> =
        corners.as_chunks::<3>().0.iter().map(|&[a, b, c]| if mirrored { [a, c, b] } else { [a, b, c] }).collect();
    let material = Material {
        name: own.name().unwrap_or_default().to_owned(),
        triangles: triangles.len(),
        colour: own.index().map(|_| [r, g, b]),
        picture: texture.filter(|_| uvs.len() == positions.len()).map(|t| t.texture().source().index()),
    };
    let normals: Vec<[f32; 3]> = reader.read_normals().map_or_else(Vec::new, |normals| normals.map(turned).collect());
    let fits = |count: usize| count == 0 || count == positions.len();
    if !fits(normals.len()) || !fits(uvs.len()) {
        return Err(wrong("normals or texture coordinates of another count than its positions".into()));
    }
    mesh.add(material, Piece { positions: positions.into_iter().map(moved).collect(), normals, uvs, triangles });
    Ok(())
}
