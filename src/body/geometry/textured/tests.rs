//! Files of surfaces to look at, made here.

use super::*;
use palpate_core::math::Vec3;
use std::fs;

const PNG: &[u8] = b"\x89PNG\r\n\x1a\n and so on";

/// Two quadrangles beside each other, of two materials, with a seam of texture coordinates between them.
const OBJ: &str = "mtllib looks.mtl
v 0 0 0\nv 10 0 0\nv 20 0 0\nv 0 10 0\nv 10 10 0\nv 20 10 0
vt 0 0\nvt 0.5 0\nvt 0.5 1\nvt 0 1\nvt 0.9 0.25\nvt 1 1
vn 0 0 2
usemtl skin\nf 1/1/1 2/2/1 5/3/1 4/4/1
usemtl vein\nf 2/5/1 3/6/1 6/6/1 5/5/1
";
const MTL: &str = "newmtl skin\nKd 1 1 1\nmap_Kd -s 1 1 1 skin.png\nnewmtl vein\nKd 0.5 0 1\n";

fn folder(files: &[(&str, &[u8])]) -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    files.iter().for_each(|(name, bytes)| fs::write(folder.path().join(name), bytes).unwrap());
    folder
}

fn read(files: &[(&str, &[u8])]) -> Result<TexturedMesh, MeshError> {
    let folder = folder(files);
    TexturedMesh::read(&folder.path().join(files[0].0), LengthUnit::Millimetre)
}

#[test]
fn an_obj_file_keeps_its_materials_pictures_normals_and_seams() {
    let mesh = read(&[("a.obj", OBJ.as_bytes()), ("looks.mtl", MTL.as_bytes()), ("skin.png", PNG)]).unwrap();
    let names: Vec<_> = mesh.materials.iter().map(|m| (m.name.as_str(), m.triangles, m.picture)).collect();
    assert_eq!(names, [("skin", 2, Some(0)), ("vein", 2, None)]);
    assert_eq!(mesh.pictures, [Picture { media_type: "image/png", bytes: PNG.into() }]);
    assert_eq!(mesh.materials[0].colour, Some([1.0; 3]));
    let [r, g, b] = mesh.materials[1].colour.unwrap();
    assert!((r - 0.218).abs() < 1e-3 && g == 0.0 && b == 1.0, "linear");
    // The two vertices of the seam stand twice.
    assert_eq!((mesh.surface.vertices.len(), mesh.surface.triangles.len()), (8, 4));
    assert!(mesh.normals.iter().all(|n| *n == [0.0, 0.0, 1.0]) && mesh.normals.len() == 8);
    let seam: Vec<_> =
        (0..8).filter(|v| (mesh.surface.vertices[*v] - Vec3::new(0.01, 0.0, 0.0)).norm() < 1e-9).collect();
    let mut uvs: Vec<_> = seam.iter().map(|v| mesh.uvs[*v]).collect();
    uvs.sort_by(|a, b| a[0].total_cmp(&b[0]));
    // From above, where OBJ counts from below.
    assert_eq!(uvs, [[0.5, 1.0], [0.9, 0.75]]);
}

/// A triangle of the material, in a `.glb`, twice as large and moved by its node.
fn glb(material: &str) -> Vec<u8> {
    let floats = [0f32, 0., 0., 1., 0., 0., 0., 1., 0., 0., 0., 1., 0., 0., 1., 0., 0., 1., 0., 0., 1., 0., 0., 1.];
    let mut binary: Vec<u8> = floats.iter().flat_map(|x| x.to_le_bytes()).collect();
    binary.extend(PNG);
    binary.resize(binary.len().next_multiple_of(4), 0);
    let json = format!(
        r#"{{"asset":{{"version":"2.0"}},"scene":0,"scenes":[{{"nodes":[0]}}],
        "nodes":[{{"mesh":0,"scale":[2,2,-2],"translation":[0,0,5]}}],
        "meshes":[{{"primitives":[{{"attributes":{{"POSITION":0,"NORMAL":1,"TEXCOORD_0":2}},"material":0}}]}}],
        "materials":[{{"name":"skin","pbrMetallicRoughness":{material}}}],
        "textures":[{{"source":0}}],"images":[{{"bufferView":3,"mimeType":"image/png"}}],
        "buffers":[{{"byteLength":{}}}],
        "bufferViews":[{{"buffer":0,"byteLength":36}},{{"buffer":0,"byteOffset":36,"byteLength":36}},
        {{"buffer":0,"byteOffset":72,"byteLength":24}},{{"buffer":0,"byteOffset":96,"byteLength":{}}}],
        "accessors":[{{"bufferView":0,"componentType":5126,"count":3,"type":"VEC3","min":[0,0,0],"max":[1,1,0]}},
        {{"bufferView":1,"componentType":5126,"count":3,"type":"VEC3"}},
        {{"bufferView":2,"componentType":5126,"count":3,"type":"VEC2"}}]}}"#,
        binary.len(),
        PNG.len()
    );
    let mut json = json.into_bytes();
    json.resize(json.len().next_multiple_of(4), b' ');
    let mut bytes = b"glTF".to_vec();
    let length = 12 + 8 + json.len() + 8 + binary.len();
    bytes.extend([2u32, length as u32, json.len() as u32].iter().flat_map(|x| x.to_le_bytes()));
    bytes.extend(b"JSON");
    bytes.extend(json);
    bytes.extend((binary.len() as u32).to_le_bytes());
    bytes.extend(b"BIN\0");
    bytes.extend(binary);
    bytes
}

const TEXTURED: &str = r#"{"baseColorFactor":[1,0.5,0.25,1],"baseColorTexture":{"index":0}}"#;

#[test]
fn a_gltf_file_keeps_its_materials_pictures_and_normals_where_its_nodes_put_them() {
    let mesh = read(&[("a.glb", &glb(TEXTURED))]).unwrap();
    assert_eq!(mesh.pictures, [Picture { media_type: "image/png", bytes: PNG.into() }]);
    let material = &mesh.materials[0];
    assert_eq!((material.name.as_str(), material.colour, material.picture), ("skin", Some([1.0, 0.5, 0.25]), Some(0)));
    // Mirrored: it faces where its normals point.
    assert_eq!(mesh.surface.triangles, [[0, 2, 1]]);
    assert_eq!(mesh.normals, [[0.0, 0.0, -1.0]; 3]);
    assert!((mesh.surface.vertices[1] - Vec3::new(0.002, 0.0, 0.005)).norm() < 1e-12);
    assert_eq!(mesh.uvs[2], [0.0, 1.0]);
    let plain = read(&[("a.glb", &glb("{}"))]).unwrap();
    assert_eq!((plain.materials[0].colour, plain.materials[0].picture), (Some([1.0; 3]), None));
}

#[test]
fn what_cannot_be_shown_is_refused_with_a_remedy() {
    let refused = |files: &[(&str, &[u8])]| read(files).unwrap_err().to_string();
    let obj = ("a.obj", OBJ.as_bytes());
    assert!(refused(&[obj]).contains("looks.mtl"));
    let looks = ("looks.mtl", MTL.as_bytes());
    assert!(refused(&[obj, looks]).contains("skin.png"));
    assert!(refused(&[obj, looks, ("skin.png", b"BM")]).contains("PNG or JPEG"));
    let elsewhere = MTL.replace("skin.png", "/elsewhere/skin.png");
    assert!(refused(&[obj, ("looks.mtl", elsewhere.as_bytes())]).contains("beside the mesh file"));
    assert!(refused(&[("a.stl", b"solid")]).contains(".obj, .glb or .gltf"));
    assert!(refused(&[("a.obj", b"v 0 0 0\n")]).contains("triangles"));
    assert!(refused(&[("a.obj", b"v 0 0 0\nf 1 2 3\n")]).contains("OBJ file"));
}

#[test]
fn a_vertex_of_an_absurd_number_is_an_error() {
    for vertex in ["9223372036854775807", "-9223372036854775807"] {
        for face in [format!("{vertex}/1/1"), format!("1/{vertex}/1"), format!("1/1/{vertex}")] {
            let obj = OBJ.replacen("f 1/1/1", &format!("f {face}"), 1);
            let e = read(&[("a.obj", obj.as_bytes()), ("looks.mtl", MTL.as_bytes()), ("skin.png", PNG)]).unwrap_err();
            assert!(e.to_string().contains("does not exist"), "{e}");
        }
    }
}

#[test]
fn a_colour_of_fewer_than_three_numbers_is_an_error() {
    for kind in ["Ka", "Kd", "Ks", "Ke"] {
        let mtl = MTL.replace("Kd 0.5 0 1", &format!("{kind} 0.5 0"));
        let e = read(&[("a.obj", OBJ.as_bytes()), ("looks.mtl", mtl.as_bytes()), ("skin.png", PNG)]).unwrap_err();
        assert!(e.to_string().contains("material file"), "{e}");
    }
}

#[test]
fn a_damaged_file_is_an_error_and_nothing_worse() {
    let whole = glb(TEXTURED);
    for cut in 0..whole.len() {
        assert!(read(&[("a.glb", &whole[..cut])]).is_err(), "cut to {cut} bytes");
    }
    // In its header the file says how long it is.
    let said = |length: u32| read(&[("a.glb", &[&whole[..8], &length.to_le_bytes(), &whole[12..]].concat())]);
    for length in [0, 11, u32::MAX] {
        assert_eq!(said(length).unwrap(), read(&[("a.glb", &whole)]).unwrap());
    }
    let text = String::from_utf8_lossy(&whole).into_owned();
    for (good, bad) in [
        (r#""count":3,"type":"VEC3","min""#, r#""count":9,"type":"VEC3","min""#),
        (r#""count":3,"type":"VEC2""#, r#""count":2,"type":"VEC2""#),
        (r#""componentType":5126,"count":3,"type":"VEC2""#, r#""componentType":5125,"count":3,"type":"VEC2""#),
        (r#""byteOffset":96"#, r#""byteOffset":999"#),
        (r#""nodes":[0]"#, r#""nodes":[7]"#),
        (r#""POSITION":0"#, r#""POSITION":7"#),
        (r#""mimeType""#, r#""kind""#),
    ] {
        assert!(text.contains(good), "{good}");
        let at = text.find(good).unwrap();
        let json_end = 20 + u32::from_le_bytes(whole[12..16].try_into().unwrap()) as usize;
        let json = String::from_utf8(whole[20..json_end].to_vec()).unwrap().replacen(good, bad, 1);
        let file = ("a.gltf", json.replace(r#""buffers":[{"#, r#""buffers":[{"uri":"a.bin","#));
        let outcome = read(&[(file.0, file.1.as_bytes()), ("a.bin", &whole[json_end + 8..])]);
        assert!(outcome.is_err(), "{bad} at {at}");
    }
}
