//! glTF 2.0 files: `.glb`, and `.gltf` with its buffers inside or in files beside it.

use super::cells::Cells;
use super::mesh_error::{MeshError, shown};
use super::reader::{Encoding, Reader};
use base64::Engine;
use base64::prelude::BASE64_STANDARD;
use gltf_json::accessor::{Accessor, ComponentType, Type};
use gltf_json::mesh::{Mode, Primitive, Semantic};
use gltf_json::scene::Node;
use gltf_json::validation::Checked;
use gltf_json::{Index, Root};
use palpate_core::math::{Mat3, Real, Vec3};
use percent_encoding::percent_decode_str;
use std::borrow::Cow;
use std::path::{Component, PathBuf};

/// What is to be done about all that is compressed, sparse or elsewhere.
const PLAIN: &str = "export it as .glb without compression";
/// Extensions that a file may require, because they are read or change nothing but looks.
const KNOWN: [&str; 3] = ["KHR_mesh_quantization", "KHR_texture_transform", "KHR_materials_unlit"];
/// Extensions of nodes that put more meshes into a scene.
const INSTANCES: &str = "EXT_mesh_gpu_instancing";

/// What a file says of itself, and its binary part.
pub(super) fn root(bytes: &[u8]) -> Result<(Root, Option<&[u8]>), MeshError> {
    let (json, binary) = if bytes.starts_with(b"glTF") { chunks(bytes)? } else { (bytes, None) };
    let root = Root::from_slice(json).map_err(|e| MeshError::Syntax {
        format: "glTF",
        line: Some(e.line()),
        what: e.to_string().chars().take(200).collect(),
    })?;
    Ok((root, binary))
}

/// The files with the buffers of a glTF file, relative to its folder, each once.
///
/// # Errors
/// When the file cannot be read, or a buffer is not in its folder or one below.
pub(super) fn buffer_files(bytes: &[u8]) -> Result<Vec<PathBuf>, MeshError> {
    let mut files = Vec::new();
    for (b, buffer) in root(bytes)?.0.buffers.iter().enumerate() {
        let Some(uri) = buffer.uri.as_ref().filter(|uri| !uri.starts_with("data:")) else { continue };
        let file = file_of(b, uri)?;
        if !files.contains(&file) {
            files.push(file);
        }
    }
    Ok(files)
}

/// The file that `uri` of buffer `b` names: one below the folder of the glTF file.
fn file_of(b: usize, uri: &str) -> Result<PathBuf, MeshError> {
    let name: Vec<u8> = percent_decode_str(uri).collect();
    let file = PathBuf::from(String::from_utf8_lossy(&name).into_owned());
    let is_below = file.components().all(|part| matches!(part, Component::Normal(_) | Component::CurDir));
    if !is_below || uri.contains(':') {
        let what = format!("buffer {b}, which is elsewhere ({}),", shown(uri.as_bytes()));
        return Err(MeshError::Unsupported { what, remedy: "put its buffers beside the file, or export it as .glb" });
    }
    Ok(file)
}

/// The triangles of the scene of a glTF file, each mesh where its nodes put it; `beside` are the files that [`buffer_files`]
/// names, in its order. Points and lines are ignored.
pub(super) fn parse_gltf(bytes: &[u8], beside: &[(PathBuf, Vec<u8>)]) -> Result<Cells, MeshError> {
    let (root, binary) = root(bytes)?;
    let unknown = root.extensions_required.iter().find(|name| !KNOWN.contains(&name.as_str()));
    let instances = root.extensions_used.iter().find(|name| *name == INSTANCES);
    if let Some(name) = unknown.or(instances) {
        let what = format!("a glTF file with the extension {}", shown(name.as_bytes()));
        return Err(MeshError::Unsupported { what, remedy: PLAIN });
    }
    let files = buffer_files(bytes)?;
    let buffers = root.buffers.iter().enumerate().map(|(b, buffer)| match &buffer.uri {
        None => Ok(Cow::Borrowed(binary.filter(|_| b == 0).unwrap_or_default())),
        Some(uri) => match uri.strip_prefix("data:").and_then(|uri| uri.split_once(";base64,")) {
            Some((_, text)) => match BASE64_STANDARD.decode(text) {
                Ok(bytes) => Ok(Cow::Owned(bytes)),
                Err(e) => Err(wrong(format!("buffer {b}: {e}"))),
            },
            None => {
                let file = file_of(b, uri)?;
                let found = files.iter().position(|known| *known == file).and_then(|i| beside.get(i));
                let (_, bytes) =
                    found.ok_or_else(|| wrong(format!("buffer {b} is in another file, {}", file.display())))?;
                Ok(Cow::Borrowed(bytes.as_slice()))
            }
        },
    });
    let buffers: Vec<Cow<[u8]>> = buffers.collect::<Result<_, _>>()?;
    let mut document = Document {
        root: &root,
        buffers: &buffers,
        cells: Cells { indexed: true, ..Cells::default() },
        shown: vec![false; root.meshes.len()],
    };
    document.scene()?;
    let hidden = document.shown.iter().filter(|shown| !**shown).count();
    if hidden > 0 {
        document.cells.left_out.push(format!("{hidden} meshes that its scene does not show"));
    }
    Ok(document.cells)
}

fn wrong(what: String) -> MeshError {
    MeshError::Syntax { format: "glTF", line: None, what }
}

/// The JSON text of a binary file and what comes with it.
fn chunks(bytes: &[u8]) -> Result<(&[u8], Option<&[u8]>), MeshError> {
    let mut file = Reader { format: "glTF", bytes, at: 4, encoding: Encoding::LittleEndian, comment: None };
    let [version, _length] = [u32::from_le_bytes(file.raw()?), u32::from_le_bytes(file.raw()?)];
    if version != 2 {
        return Err(file.wrong(format!("version {version} of the format instead of 2")));
    }
    let mut chunk = |kind: &[u8; 4]| {
        let length = u32::from_le_bytes(file.raw()?) as usize;
        if &file.raw::<4>()? != kind {
            return Err(file.wrong(format!("expected a chunk '{}'", shown(kind))));
        }
        let content = file.rest().get(..length);
        let content = content.ok_or_else(|| file.wrong(format!("a chunk of {length} bytes: the file was cut off")))?;
        file.at += length;
        Ok((content, file.rest().is_empty()))
    };
    let (json, last) = chunk(b"JSON")?;
    let binary = if last { None } else { Some(chunk(b"BIN\0")?.0) };
    Ok((json, binary))
}

/// Where a node puts its meshes: `x ↦ linear x + shift`.
#[derive(Clone, Copy)]
struct Placement {
    linear: Mat3,
    shift: Vec3,
}

impl Placement {
    fn of(node: &Node) -> Self {
        if let Some(m) = node.matrix {
            let m = m.map(Real::from);
            let column = |c: usize| Vec3::new(m[4 * c], m[4 * c + 1], m[4 * c + 2]);
            return Self { linear: Mat3::from_columns(&[column(0), column(1), column(2)]), shift: column(3) };
        }
        let [x, y, z, w] = node.rotation.map_or([0.0, 0.0, 0.0, 1.0], |q| q.0).map(Real::from);
        let turn = Mat3::new(
            1.0 - 2.0 * (y * y + z * z),
            2.0 * (x * y - z * w),
            2.0 * (x * z + y * w),
            2.0 * (x * y + z * w),
            1.0 - 2.0 * (x * x + z * z),
            2.0 * (y * z - x * w),
            2.0 * (x * z - y * w),
            2.0 * (y * z + x * w),
            1.0 - 2.0 * (x * x + y * y),
        );
        let scale = Vec3::from(node.scale.unwrap_or([1.0; 3]).map(Real::from));
        let shift = Vec3::from(node.translation.unwrap_or([0.0; 3]).map(Real::from));
        Self { linear: turn * Mat3::from_diagonal(&scale), shift }
    }

    /// First `inner`, then this.
    fn after(&self, inner: &Self) -> Self {
        Self { linear: self.linear * inner.linear, shift: self.linear * inner.shift + self.shift }
    }
}

/// A coordinate as one of the numbers that glTF has: whole ones, where `normalised`, are parts of the largest.
fn coordinate(number: ComponentType, normalised: bool, bytes: &[u8]) -> Real {
    let pair = || [bytes[0], bytes[1]];
    let (value, largest): (Real, Real) = match number {
        ComponentType::I8 => (i8::from_le_bytes([bytes[0]]).into(), i8::MAX.into()),
        ComponentType::U8 => (bytes[0].into(), u8::MAX.into()),
        ComponentType::I16 => (i16::from_le_bytes(pair()).into(), i16::MAX.into()),
        ComponentType::U16 => (u16::from_le_bytes(pair()).into(), u16::MAX.into()),
        ComponentType::U32 | ComponentType::F32 => {
            return f32::from_le_bytes(std::array::from_fn(|b| bytes[b])).into();
        }
    };
    if normalised { (value / largest).max(-1.0) } else { value }
}

/// A file on its way to [`Cells`].
struct Document<'a> {
    root: &'a Root,
    buffers: &'a [Cow<'a, [u8]>],
    cells: Cells,
    /// Meshes that are in the scene, (n_meshes).
    shown: Vec<bool>,
}

impl Document<'_> {
    /// What the default scene shows, or the first; of a file without scenes every mesh as it is.
    fn scene(&mut self) -> Result<(), MeshError> {
        let root = self.root;
        let here = Placement { linear: Mat3::identity(), shift: Vec3::zeros() };
        let Some(scene) = root.scenes.get(root.scene.map_or(0, |s| s.value())) else {
            for mesh in 0..root.meshes.len() {
                self.mesh(mesh, &here)?;
            }
            return Ok(());
        };
        let mut left: Vec<(Index<Node>, Placement)> = scene.nodes.iter().map(|n| (*n, here)).collect();
        let mut seen = vec![false; root.nodes.len()];
        while let Some((index, outer)) = left.pop() {
            let (Some(node), Some(seen)) = (root.get(index), seen.get_mut(index.value())) else {
                return Err(wrong(format!("node {index} is not there")));
            };
            if std::mem::replace(seen, true) {
                return Err(wrong(format!("node {index} hangs on two others, or on itself")));
            }
            let placement = outer.after(&Placement::of(node));
            if let Some(mesh) = node.mesh {
                self.mesh(mesh.value(), &placement)?;
            }
            left.extend(node.children.iter().flatten().map(|child| (*child, placement)));
        }
        Ok(())
    }

    fn mesh(&mut self, mesh: usize, placement: &Placement) -> Result<(), MeshError> {
        let found = self.root.meshes.get(mesh).ok_or_else(|| wrong(format!("mesh {mesh} is not there")))?;
        self.shown[mesh] = true;
        found.primitives.iter().try_for_each(|primitive| self.primitive(mesh, primitive, placement))
    }

    fn primitive(&mut self, mesh: usize, primitive: &Primitive, placement: &Placement) -> Result<(), MeshError> {
        let Checked::Valid(mode) = primitive.mode else {
            return Err(wrong(format!("mesh {mesh} is of an unknown mode")));
        };
        if !matches!(mode, Mode::Triangles | Mode::TriangleStrip | Mode::TriangleFan) {
            return Ok(());
        }
        let Some(positions) = primitive.attributes.get(&Checked::Valid(Semantic::Positions)) else {
            return Err(wrong(format!("mesh {mesh} has no positions")));
        };
        let first = self.cells.points.len();
        let accessor = self.root.get(*positions);
        let number = accessor.map_or(ComponentType::F32, |a| match a.component_type {
            Checked::Valid(component) => component.0,
            Checked::Invalid => ComponentType::F32,
        });
        let normalised = accessor.is_some_and(|a| a.normalized);
        let points = self.items(*positions, Type::Vec3, |t| t != ComponentType::U32)?.map(|(size, item)| {
            let coordinates = item[..size].chunks(size / 3).map(|bytes| coordinate(number, normalised, bytes));
            (placement.linear * Vec3::from_iterator(coordinates) + placement.shift).into()
        });
        let points: Vec<[Real; 3]> = points.collect();
        let count = points.len();
        self.cells.points.extend(points);
        let corners: Vec<u32> = match primitive.indices {
            None => (0..count as u32).collect(),
            Some(indices) => {
                let unsigned = |t| matches!(t, ComponentType::U8 | ComponentType::U16 | ComponentType::U32);
                let number = |bytes: &[u8]| bytes.iter().rev().fold(0, |sum, b| sum << 8 | u32::from(*b));
                self.items(indices, Type::Scalar, unsigned)?.map(|(size, item)| number(&item[..size])).collect()
            }
        };
        if let Some(at) = corners.iter().position(|c| *c as usize >= count) {
            return Err(MeshError::BadIndex { cell: "triangle", number: at as i64 / 3 + 1, index: corners[at].into() });
        }
        let mirrored = placement.linear.determinant() < 0.0;
        let mut put = |a: u32, b: u32, c: u32| {
            let [b, c] = if mirrored { [c, b] } else { [b, c] };
            self.cells.polygon(&[a, b, c].map(|v| v + first as u32))
        };
        let whole = match mode {
            Mode::Triangles => corners.len().is_multiple_of(3),
            _ => corners.len() > 2,
        };
        if !whole {
            return Err(wrong(format!("mesh {mesh} ends within a triangle: the file was cut off or damaged")));
        }
        match mode {
            Mode::TriangleStrip => corners.windows(3).enumerate().try_for_each(|(i, t)| match i % 2 {
                0 => put(t[0], t[1], t[2]),
                _ => put(t[1], t[0], t[2]),
            }),
            Mode::TriangleFan => corners.windows(2).skip(1).try_for_each(|t| put(corners[0], t[0], t[1])),
            _ => corners.chunks_exact(3).try_for_each(|t| put(t[0], t[1], t[2])),
        }
    }

    /// The items of an accessor, each with its length [bytes].
    fn items(
        &self,
        index: Index<Accessor>,
        of: Type,
        fits: impl Fn(ComponentType) -> bool,
    ) -> Result<impl Iterator<Item = (usize, &[u8])>, MeshError> {
        let accessor = self.root.get(index).ok_or_else(|| wrong(format!("accessor {index} is not there")))?;
        let component = match accessor.component_type {
            Checked::Valid(component) if accessor.type_ == Checked::Valid(of) && fits(component.0) => component.0,
            _ => {
                return Err(MeshError::Unsupported { what: format!("the numbers of accessor {index}"), remedy: PLAIN });
            }
        };
        let Some(view) = accessor.buffer_view.filter(|_| accessor.sparse.is_none()) else {
            return Err(MeshError::Unsupported {
                what: format!("accessor {index}, sparse or compressed,"),
                remedy: PLAIN,
            });
        };
        let view = self.root.get(view).ok_or_else(|| wrong(format!("buffer view {view} is not there")))?;
        let size = component.size() * of.multiplicity();
        let stride = view.byte_stride.map_or(size, |s| s.0);
        let out_of_bounds =
            || wrong(format!("accessor {index} reaches beyond its buffer: the file was cut off or damaged"));
        let at = |offset: u64, length: u64| {
            Some(usize::try_from(offset).ok()?..usize::try_from(offset.checked_add(length)?).ok()?)
        };
        let offset = view.byte_offset.unwrap_or_default().0;
        let bytes = self.buffers.get(view.buffer.value());
        let bytes = bytes.and_then(|bytes| bytes.get(at(offset, view.byte_length.0)?)).ok_or_else(out_of_bounds)?;
        let count = accessor.count.0;
        let length = count.saturating_sub(1).saturating_mul(stride as u64).saturating_add(if count == 0 {
            0
        } else {
            size as u64
        });
        let items = at(accessor.byte_offset.unwrap_or_default().0, length).and_then(|range| bytes.get(range));
        let items = items.filter(|_| stride >= size).ok_or_else(out_of_bounds)?;
        Ok(items.chunks(stride).map(move |item| (size, item)))
    }
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;
    use crate::geometry::mesh_io::{LengthUnit, parse_surface, read_surface};
    use palpate_core::geometry::Surface;
    use palpate_core::geometry::primitives::box_surface;
    use palpate_core::math::Bounds;
    use std::path::Path;

    fn gltf(bytes: &[u8]) -> Result<Surface, MeshError> {
        parse_surface(Path::new("a.glb"), bytes, LengthUnit::Metre)
    }

    /// Positions, then 16-bit indices.
    fn binary(surface: &Surface) -> Vec<u8> {
        let positions = surface.vertices.iter().flatten().flat_map(|c| (*c as f32).to_le_bytes());
        let indices = surface.triangles.iter().flatten().flat_map(|v| (*v as u16).to_le_bytes());
        let mut bytes: Vec<u8> = positions.chain(indices).collect();
        bytes.resize(bytes.len().next_multiple_of(4), 0);
        bytes
    }

    fn json(surface: &Surface, node: &str, uri: &str) -> String {
        let (points, corners) = (surface.vertices.len(), 3 * surface.triangles.len());
        let length = (12 * points + 2 * corners).next_multiple_of(4);
        format!(
            r#"{{"asset": {{"version": "2.0"}}, "scene": 0, "scenes": [{{"nodes": [0]}}],
"nodes": [{{"children": [1]}}, {{"mesh": 0{node}}}],
"meshes": [{{"primitives": [{{"attributes": {{"POSITION": 0}}, "indices": 1}}]}}],
"accessors": [{{"bufferView": 0, "componentType": 5126, "count": {points}, "type": "VEC3"}},
 {{"bufferView": 1, "componentType": 5123, "count": {corners}, "type": "SCALAR"}}],
"bufferViews": [{{"buffer": 0, "byteLength": {}}}, {{"buffer": 0, "byteOffset": {}, "byteLength": {}}}],
"buffers": [{{"byteLength": {length}{uri}}}]}}"#,
            12 * points,
            12 * points,
            2 * corners
        )
    }

    pub(in crate::geometry) fn glb(surface: &Surface, node: &str) -> Vec<u8> {
        let (mut text, binary) = (json(surface, node, "").into_bytes(), binary(surface));
        text.resize(text.len().next_multiple_of(4), b' ');
        let numbers = |n: &[usize]| n.iter().flat_map(|n| (*n as u32).to_le_bytes()).collect::<Vec<u8>>();
        let length = 12 + 8 + text.len() + 8 + binary.len();
        [
            &b"glTF"[..],
            &numbers(&[2, length]),
            &numbers(&[text.len()]),
            b"JSON",
            &text,
            &numbers(&[binary.len()]),
            b"BIN\0",
            &binary,
        ]
        .concat()
    }

    pub(in crate::geometry) fn embedded(surface: &Surface) -> Vec<u8> {
        let data = BASE64_STANDARD.encode(binary(surface));
        json(surface, "", &format!(r#", "uri": "data:application/octet-stream;base64,{data}""#)).into_bytes()
    }

    fn cube() -> Surface {
        box_surface(Vec3::new(0.5, 0.25, 0.125), [2, 1, 2])
    }

    #[test]
    fn a_box_comes_back_from_both_forms_of_gltf_where_its_nodes_put_it() {
        assert_eq!(gltf(&glb(&cube(), "")).unwrap(), cube());
        assert_eq!(gltf(&embedded(&cube())).unwrap(), cube());
        // A quarter turn about z, twice as large, mirrored in x, lifted.
        let node = r#", "rotation": [0, 0, 0.70710678, 0.70710678], "scale": [-2, 2, 2], "translation": [0, 0, 1]"#;
        let turned = gltf(&glb(&cube(), node)).unwrap();
        let Bounds { low, high } = turned.bounds();
        assert!((low - Vec3::new(-0.5, -1.0, 1.0)).norm() < 1e-6 && (high - Vec3::new(0.0, 0.0, 1.25)).norm() < 1e-6);
        assert!((turned.volume() - 8.0 * cube().volume()).abs() < 1e-6);
        let node = r#", "matrix": [-2, 0, 0, 0, 0, 2, 0, 0, 0, 0, 2, 0, 0, 0, 1, 1]"#;
        let moved = gltf(&glb(&cube(), node)).unwrap();
        assert!((moved.bounds().low - Vec3::new(-1.0, 0.0, 1.0)).norm() < 1e-12 && moved.volume() > 0.0);
    }

    #[test]
    fn buffers_in_files_beside_it_are_read() {
        let folder = tempfile::tempdir().unwrap();
        std::fs::create_dir(folder.path().join("a b")).unwrap();
        let file = folder.path().join("cube.gltf");
        std::fs::write(&file, json(&cube(), "", r#", "uri": "a%20b/cube.bin""#)).unwrap();
        let absent = read_surface(&file, LengthUnit::Metre).unwrap_err().to_string();
        assert!(absent.contains("cube.bin"), "{absent}");
        std::fs::write(folder.path().join("a b/cube.bin"), binary(&cube())).unwrap();
        assert_eq!(read_surface(&file, LengthUnit::Metre).unwrap(), cube());
    }

    #[test]
    fn coordinates_that_are_whole_numbers_are_read_as_parts_or_as_they_are() {
        // Corners of a box at the ends of what numbers of two bytes say.
        let cube = box_surface(Vec3::repeat(1.0), [1; 3]);
        for (kind, low, high, normalised) in [
            (5122, -32767i32, 32767i32, true),
            (5123, 0, 65535, true),
            (5122, -100, 100, false),
            (5123, 0, 1000, false),
        ] {
            let place = |c: f64| if c > 0.5 { high } else { low };
            // Two bytes each, and two more, so that each vertex begins at a multiple of four.
            let positions: Vec<u8> = cube
                .vertices
                .iter()
                .flat_map(|v| [place(v.x), place(v.y), place(v.z), 0])
                .flat_map(|n| (n as u16).to_le_bytes())
                .collect();
            let indices = cube.triangles.iter().flatten().flat_map(|v| (*v as u16).to_le_bytes());
            let data = BASE64_STANDARD.encode(positions.iter().copied().chain(indices).collect::<Vec<u8>>());
            let text = json(&cube, "", &format!(r#", "uri": "data:application/octet-stream;base64,{data}""#))
                .replace(
                    "\"componentType\": 5126,",
                    &format!("\"componentType\": {kind}, \"normalized\": {normalised},"),
                )
                .replace("\"byteLength\": 96}", "\"byteLength\": 64, \"byteStride\": 8}")
                .replace("\"byteOffset\": 96", "\"byteOffset\": 64");
            let Bounds { low: least, high: most } = gltf(text.as_bytes()).unwrap().bounds();
            let wanted = |end: i32| if normalised && end != 0 { f64::from(end.signum()) } else { f64::from(end) };
            assert_eq!((least, most), (Vec3::repeat(wanted(low)), Vec3::repeat(wanted(high))));
        }
    }

    #[test]
    fn a_gltf_file_that_cannot_be_used_says_where_and_why() {
        let text = String::from_utf8(embedded(&cube())).unwrap();
        let says = |file: &[u8], expected: &str| {
            let message = gltf(file).unwrap_err().to_string();
            assert!(message.contains(expected), "{message}");
        };
        let glb = glb(&cube(), "");
        says(&glb[..glb.len() - 9], "the file was cut off (at byte");
        says(&[&glb[..4], &[1], &glb[5..]].concat(), "version 1 of the format");
        says(text.replace("\"nodes\": [{", "\"nodes\": {{").as_bytes(), "glTF file, line 2");
        says(text.replace("\"children\": [1]", "\"children\": [0]").as_bytes(), "node 0 hangs on two others");
        says(text.replace("\"children\": [1]", "\"children\": [7]").as_bytes(), "node 7 is not there");
        says(text.replace("5126", "5125").as_bytes(), "accessor 0 cannot be read");
        says(text.replace("\"count\": 96", "\"count\": 95").as_bytes(), "mesh 0 ends within a triangle");
        says(text.replace("{\"bufferView\": 0, ", "{").as_bytes(), "accessor 0, sparse or compressed,");
        says(
            text.replacen("\"count\": 18", "\"count\": 18446744073709551615", 1).as_bytes(),
            "accessor 0 reaches beyond",
        );
        let elsewhere = |uri: &str| json(&cube(), "", &format!(r#", "uri": "{uri}""#));
        says(elsewhere("mesh.bin").as_bytes(), "in another file, mesh.bin");
        for uri in ["../mesh.bin", "/mesh.bin", "a/%2e%2e/../mesh.bin", "http://example.org/mesh.bin"] {
            says(elsewhere(uri).as_bytes(), "buffer 0, which is elsewhere (");
        }
        for (key, name) in [("extensionsRequired", "EXT_meshopt_compression"), ("extensionsUsed", INSTANCES)] {
            let more = text.replacen("{\"asset\"", &format!("{{\"{key}\": [\"{name}\"], \"asset\""), 1);
            says(more.as_bytes(), &format!("the extension {name} cannot be read"));
        }
        says(text.replace(";base64,", ";base64,!").as_bytes(), "buffer 0: ");
    }
}
