//! Bytes as they should be: of every kind of file and message that is read.

use palpate::offline::{BUDGET_COLUMNS, EVENT_COLUMNS, TRAJECTORY_HEADER, Trajectory};
use palpate::recording::RecordingWriter;
use palpate::scene::{self, Scene};
use palpate_body::geometry::primitives::toy_surface;
use palpate_body::prepare::body_file::{BodyFile, Provenance};
use palpate_body::prepare::{Recipe, Region, Shape, prepare};
use palpate_core::geometry::primitives::{box_mesh, box_surface};
use palpate_core::geometry::{Surface, TetMesh};
use palpate_core::math::{Bounds, Real, Vec3};
use palpate_core::model::Material;
use palpate_core::simulation::{Simulation, Snapshot};
use palpate_proto::keys::topics;
use palpate_proto::{self as proto, Message};
use std::fmt::Write as _;
use std::io::{Cursor, Write as _};
use std::sync::LazyLock;
use xxhash_rust::xxh3::xxh3_64;

/// A small body with all that a body can have: two levels, springs, Maxwell branches.
pub static PREPARED: LazyLock<Vec<u8>> = LazyLock::new(|| {
    let recipe = Recipe {
        name: "toy".into(),
        shape: Shape::closed(toy_surface(0.006), vec![0.025, 0.016]),
        material: Material::from_young(5e3, 0.45, 1050.0),
        inclusions: vec![],
        holds: vec![Region {
            bounds: Bounds::new(Vec3::repeat(-1.0), Vec3::new(1.0, 1.0, 0.03)),
            stiffness: None,
            exact: false,
        }],
        elements: Default::default(),
        damping_ratio: 0.15,
    };
    let body = prepare(&recipe, &mut |_, _, _| {}).unwrap();
    let scene = "name = \"toy\"\n[body]\nsource = \"prepared\"\n".into();
    BodyFile { provenance: Provenance { scene, ..Provenance::default() }, body }.bytes()
});

/// Where the parts of the body begin in [`PREPARED`]: after its name, version and checksum.
pub static PARTS: LazyLock<usize> =
    LazyLock::new(|| PREPARED.windows(11).position(|w| w == b"palpate-bdy").unwrap() + 20);

/// `bytes`, as [`PREPARED`] up to its [`PARTS`], with both checksums put right, as someone would who means harm.
pub fn resealed(mut bytes: Vec<u8>) -> Vec<u8> {
    let inner = xxh3_64(&bytes[*PARTS..]);
    bytes[*PARTS - 8..*PARTS].copy_from_slice(&inner.to_le_bytes());
    let length = bytes.len() as u64 - 28;
    bytes[12..20].copy_from_slice(&length.to_le_bytes());
    let outer = xxh3_64(&bytes[28..]);
    bytes[20..28].copy_from_slice(&outer.to_le_bytes());
    bytes
}

/// A mesh in the format of the extension `name`, in every way of writing it.
pub fn mesh(name: &str) -> Vec<Vec<u8>> {
    let surface = box_surface(Vec3::repeat(0.1), [2; 3]);
    let mesh = box_mesh(Vec3::repeat(0.1), [2; 3]);
    match name {
        "obj" => vec![obj(&surface)],
        "off" => vec![off(&surface)],
        "stl" => vec![stl(&surface), text_stl(&surface)],
        "ply" => vec![ply(&surface), binary_ply(&surface)],
        "glb" => vec![glb(&surface)],
        "vtk" => vec![vtk(&mesh), binary_vtk(&mesh)],
        "vtu" => vec![vtu(&mesh, false), vtu(&mesh, true)],
        "mesh" => vec![medit(&mesh)],
        "msh" => vec![msh(&mesh), msh_4(&mesh)],
        "inp" => vec![inp(&mesh)],
        "node" => vec![tetgen(&mesh)],
        _ => unreachable!("{name} is no mesh"),
    }
}

fn obj(surface: &Surface) -> Vec<u8> {
    let mut text = String::new();
    surface.vertices.iter().for_each(|v| writeln!(text, "v {} {} {}", v.x, v.y, v.z).unwrap());
    surface.triangles.iter().for_each(|t| writeln!(text, "f {} {} {}", t[0] + 1, t[1] + 1, t[2] + 1).unwrap());
    text.into()
}

fn stl(surface: &Surface) -> Vec<u8> {
    let mut bytes = vec![0; 80];
    bytes.extend((surface.triangles.len() as u32).to_le_bytes());
    for t in 0..surface.triangles.len() {
        let numbers = [Vec3::zeros()].into_iter().chain(surface.corners(t)).flat_map(|p| [p.x, p.y, p.z]);
        bytes.extend(numbers.flat_map(|x| (x as f32).to_le_bytes()));
        bytes.extend([0; 2]);
    }
    bytes
}

fn text_stl(surface: &Surface) -> Vec<u8> {
    let mut text = "solid a\n".to_owned();
    for t in 0..surface.triangles.len() {
        text += "facet normal 0 0 0\nouter loop\n";
        surface.corners(t).iter().for_each(|v| writeln!(text, "vertex {} {} {}", v.x, v.y, v.z).unwrap());
        text += "endloop\nendfacet\n";
    }
    (text + "endsolid a\n").into()
}

fn ply_header(encoding: &str, surface: &Surface) -> String {
    format!(
        "ply\nformat {encoding} 1.0\nelement vertex {}\nproperty double x\nproperty double y\nproperty double z\n\
         element face {}\nproperty list uchar int vertex_indices\nend_header\n",
        surface.vertices.len(),
        surface.triangles.len()
    )
}

fn ply(surface: &Surface) -> Vec<u8> {
    let mut text = ply_header("ascii", surface);
    surface.vertices.iter().for_each(|v| writeln!(text, "{} {} {}", v.x, v.y, v.z).unwrap());
    surface.triangles.iter().for_each(|[a, b, c]| writeln!(text, "3 {a} {b} {c}").unwrap());
    text.into()
}

fn binary_ply(surface: &Surface) -> Vec<u8> {
    let mut bytes = ply_header("binary_little_endian", surface).into_bytes();
    bytes.extend(surface.vertices.iter().flatten().flat_map(|c| c.to_le_bytes()));
    for t in &surface.triangles {
        bytes.push(3);
        bytes.extend(t.iter().flat_map(|v| v.to_le_bytes()));
    }
    bytes
}

fn glb(surface: &Surface) -> Vec<u8> {
    let (points, corners) = (surface.vertices.len(), 3 * surface.triangles.len());
    let mut json = format!(
        r#"{{"asset": {{"version": "2.0"}}, "scenes": [{{"nodes": [0]}}], "nodes": [{{"mesh": 0}}],
"meshes": [{{"primitives": [{{"attributes": {{"POSITION": 0}}, "indices": 1, "material": 0}}]}}],
"images": [{{"uri": "skin.png"}}], "textures": [{{"source": 0}}],
"materials": [{{"pbrMetallicRoughness": {{"baseColorTexture": {{"index": 0}}}}}}],
"accessors": [{{"bufferView": 0, "componentType": 5126, "count": {points}, "type": "VEC3", "min": [0, 0, 0], "max": [1, 1, 1]}},
{{"bufferView": 1, "componentType": 5125, "count": {corners}, "type": "SCALAR"}}],
"bufferViews": [{{"buffer": 0, "byteLength": {at}}}, {{"buffer": 0, "byteOffset": {at}, "byteLength": {}}}],
"buffers": [{{"byteLength": {}}}]}}"#,
        4 * corners,
        12 * points + 4 * corners,
        at = 12 * points
    );
    while json.len() % 4 != 0 {
        json.push(' ');
    }
    let positions = surface.vertices.iter().flatten().flat_map(|c| (*c as f32).to_le_bytes());
    let binary: Vec<u8> = positions.chain(surface.triangles.iter().flatten().flat_map(|v| v.to_le_bytes())).collect();
    let number = |n: usize| (n as u32).to_le_bytes();
    let parts: [&[u8]; 7] = [
        &[b"glTF".as_slice(), &number(2), &number(28 + json.len() + binary.len())].concat(),
        &number(json.len()),
        b"JSON",
        json.as_bytes(),
        &number(binary.len()),
        b"BIN\0",
        &binary,
    ];
    parts.concat()
}

fn vtk(mesh: &TetMesh) -> Vec<u8> {
    let mut text = "# vtk DataFile Version 3.0\na\nASCII\nDATASET UNSTRUCTURED_GRID\n".to_owned();
    writeln!(text, "POINTS {} float", mesh.nodes.len()).unwrap();
    mesh.nodes.iter().for_each(|u| writeln!(text, "{} {} {}", u.x, u.y, u.z).unwrap());
    writeln!(text, "CELLS {} {}", mesh.elements.len(), 5 * mesh.elements.len()).unwrap();
    mesh.elements.iter().for_each(|[a, b, c, d]| writeln!(text, "4 {a} {b} {c} {d}").unwrap());
    writeln!(text, "CELL_TYPES {}", mesh.elements.len()).unwrap();
    mesh.elements.iter().for_each(|_| writeln!(text, "10").unwrap());
    text.into()
}

fn binary_vtk(mesh: &TetMesh) -> Vec<u8> {
    let mut bytes = b"# vtk DataFile Version 5.1\na\nBINARY\nDATASET UNSTRUCTURED_GRID\n".to_vec();
    let line = |bytes: &mut Vec<u8>, text: String| bytes.extend((text + "\n").bytes());
    line(&mut bytes, format!("POINTS {} double", mesh.nodes.len()));
    bytes.extend(mesh.nodes.iter().flatten().flat_map(|c| c.to_be_bytes()));
    line(&mut bytes, format!("\nCELLS {} {}\nOFFSETS vtktypeint64", mesh.elements.len() + 1, 4 * mesh.elements.len()));
    bytes.extend((0..=mesh.elements.len()).flat_map(|e| (4 * e as i64).to_be_bytes()));
    line(&mut bytes, "\nCONNECTIVITY vtktypeint64".into());
    bytes.extend(mesh.elements.iter().flatten().flat_map(|n| i64::from(*n).to_be_bytes()));
    line(&mut bytes, format!("\nCELL_TYPES {}", mesh.elements.len()));
    bytes.extend(mesh.elements.iter().flat_map(|_| 10i32.to_be_bytes()));
    bytes
}

/// With arrays in base64, compressed and behind the text, or as text.
fn vtu(mesh: &TetMesh, packed: bool) -> Vec<u8> {
    let mut appended = Vec::new();
    let mut array = |name: &str, numbers: Vec<Real>| {
        let tag = format!("<DataArray type=\"Float64\" Name=\"{name}\"");
        if !packed {
            let text: Vec<String> = numbers.iter().map(Real::to_string).collect();
            return format!("{tag} format=\"ascii\">{}</DataArray>\n", text.join(" "));
        }
        let bytes: Vec<u8> = numbers.iter().flat_map(|x| x.to_le_bytes()).collect();
        let mut encoder = flate2::write::ZlibEncoder::new(Vec::new(), flate2::Compression::fast());
        encoder.write_all(&bytes).unwrap();
        let block = encoder.finish().unwrap();
        let offset = appended.len();
        appended.extend([1, bytes.len(), 0, block.len()].iter().flat_map(|n| (*n as u32).to_le_bytes()));
        appended.extend(block);
        format!("{tag} format=\"appended\" offset=\"{offset}\"/>\n")
    };
    let points = array("Points", mesh.nodes.iter().flatten().copied().collect());
    let connectivity = array("connectivity", mesh.elements.iter().flatten().map(|n| (*n).into()).collect());
    let offsets = array("offsets", (1..=mesh.elements.len()).map(|e| 4.0 * e as Real).collect());
    let types = array("types", vec![10.0; mesh.elements.len()]);
    let text = format!(
        "<VTKFile type=\"UnstructuredGrid\" byte_order=\"LittleEndian\"{}>\n<UnstructuredGrid>\n<Piece>\n<Points>{points}\
         </Points>\n<Cells>{connectivity}{offsets}{types}</Cells>\n</Piece>\n</UnstructuredGrid>\n",
        if packed { " compressor=\"vtkZLibDataCompressor\"" } else { "" }
    );
    match packed {
        false => (text + "</VTKFile>\n").into(),
        true => {
            [text.as_bytes(), b"<AppendedData encoding=\"raw\">_", &appended, b"</AppendedData></VTKFile>"].concat()
        }
    }
}

fn medit(mesh: &TetMesh) -> Vec<u8> {
    let mut text = format!("MeshVersionFormatted 2\nDimension 3\nVertices {}\n", mesh.nodes.len());
    mesh.nodes.iter().for_each(|u| writeln!(text, "{} {} {} 0", u.x, u.y, u.z).unwrap());
    writeln!(text, "Edges 1\n1 2 0\nTetrahedra {}", mesh.elements.len()).unwrap();
    for e in &mesh.elements {
        let [a, b, c, d] = e.map(|n| n + 1);
        writeln!(text, "{a} {b} {c} {d} 7").unwrap();
    }
    (text + "End\n").into()
}

/// Both files, parted by a zero.
fn tetgen(mesh: &TetMesh) -> Vec<u8> {
    let mut node = format!("{} 3 1 0 # nodes\n", mesh.nodes.len());
    mesh.nodes.iter().enumerate().for_each(|(i, u)| writeln!(node, "{i} {} {} {} 0", u.x, u.y, u.z).unwrap());
    let mut ele = format!("{} 4 0\n", mesh.elements.len());
    mesh.elements.iter().enumerate().for_each(|(i, [a, b, c, d])| writeln!(ele, "{i} {a} {b} {c} {d}").unwrap());
    (node + "\0" + &ele).into()
}

fn msh(mesh: &TetMesh) -> Vec<u8> {
    let mut text = format!("$MeshFormat\n2.2 0 8\n$EndMeshFormat\n$Nodes\n{}\n", mesh.nodes.len());
    mesh.nodes.iter().enumerate().for_each(|(i, u)| writeln!(text, "{} {} {} {}", i + 1, u.x, u.y, u.z).unwrap());
    writeln!(text, "$EndNodes\n$Elements\n{}", mesh.elements.len()).unwrap();
    for (i, e) in mesh.elements.iter().enumerate() {
        let [a, b, c, d] = e.map(|n| n + 1);
        writeln!(text, "{} 4 2 0 1 {a} {b} {c} {d}", i + 1).unwrap();
    }
    (text + "$EndElements\n").into()
}

/// In blocks of entities.
fn msh_4(mesh: &TetMesh) -> Vec<u8> {
    let (n, e) = (mesh.nodes.len(), mesh.elements.len());
    let mut text = format!("$MeshFormat\n4.1 0 8\n$EndMeshFormat\n$Nodes\n1 {n} 1 {n}\n3 1 0 {n}\n");
    (1..=n).for_each(|i| writeln!(text, "{i}").unwrap());
    mesh.nodes.iter().for_each(|u| writeln!(text, "{} {} {}", u.x, u.y, u.z).unwrap());
    writeln!(text, "$EndNodes\n$Elements\n1 {e} 1 {e}\n3 1 4 {e}").unwrap();
    for (i, corners) in mesh.elements.iter().enumerate() {
        let [a, b, c, d] = corners.map(|n| n + 1);
        writeln!(text, "{} {a} {b} {c} {d}", i + 1).unwrap();
    }
    (text + "$EndElements\n").into()
}

fn inp(mesh: &TetMesh) -> Vec<u8> {
    let mut text = "*HEADING\na body\n*NODE\n".to_owned();
    mesh.nodes.iter().enumerate().for_each(|(i, u)| writeln!(text, "{}, {}, {}, {}", i + 1, u.x, u.y, u.z).unwrap());
    text += "*ELEMENT, TYPE=C3D4, ELSET=LIVER\n";
    for (i, e) in mesh.elements.iter().enumerate() {
        let [a, b, c, d] = e.map(|n| n + 1);
        writeln!(text, "{}, {a}, {b}, {c}, {d}", i + 1).unwrap();
    }
    (text + "*ELSET, ELSET=HARD, GENERATE\n1, 8, 1\n*SOLID SECTION, ELSET=LIVER, MATERIAL=SOFT\n").into()
}

fn off(surface: &Surface) -> Vec<u8> {
    let mut text = format!("OFF\n{} {} 0\n", surface.vertices.len(), surface.triangles.len());
    surface.vertices.iter().for_each(|v| writeln!(text, "{} {} {}", v.x, v.y, v.z).unwrap());
    surface.triangles.iter().for_each(|[a, b, c]| writeln!(text, "3 {a} {b} {c}").unwrap());
    text.into()
}

/// A surface to look at and its materials, parted by a zero.
pub fn textured_obj() -> Vec<u8> {
    let surface = box_surface(Vec3::repeat(0.1), [2; 3]);
    let mut text = "mtllib a.mtl\n".to_owned();
    for v in &surface.vertices {
        writeln!(text, "v {} {} {}\nvt {} {}\nvn 0 0 1", v.x, v.y, v.z, v.x, v.y).unwrap();
    }
    for (i, t) in surface.triangles.iter().enumerate() {
        if i % 12 == 0 {
            writeln!(text, "usemtl {}", ["skin", "fat"][i / 12 % 2]).unwrap();
        }
        let [a, b, c] = t.map(|v| v + 1);
        writeln!(text, "f {a}/{a}/{a} {b}/{b}/{b} {c}/{c}/{c}").unwrap();
    }
    (text + "\0newmtl skin\nKd 0.8 0.4 0.4\nmap_Kd skin.png\nnewmtl fat\nKd 1 1 0\n").into()
}

/// Every bundled scene, and the one with all keys.
pub fn scenes() -> Vec<Vec<u8>> {
    let texts = [
        include_str!("../../../config/scenes/cube.toml"),
        include_str!("../../../config/scenes/liver.toml"),
        include_str!("../../../config/scenes/organ.toml"),
        include_str!("../../../config/scenes/organs.toml"),
        include_str!("../../../config/scenes/reference.toml"),
        include_str!("../../../config/scenes/toy.toml"),
        include_str!("../../../config/scenes/laparoscopy.toml"),
    ];
    texts.map(|text| text.as_bytes().to_vec()).to_vec()
}

/// A device and what a file may leave out.
pub fn devices() -> Vec<Vec<u8>> {
    let whole = "name = \"six bar\"\nmax_force = 5 # N\nmax_torque = 0.2\nmax_angular_stiffness = 0.3\n\
        max_stiffness = 800.0\nmax_damping = 2.0\nworkspace_radius = 0.09\nresolution = 20e-6\nmass = 0.1\nfriction = 0.1\n";
    vec![whole.into(), include_bytes!("../../../clients/devices/inverse3.toml").to_vec()]
}

/// Of poses alone, with events, and with budgets.
pub fn trajectories() -> Vec<Vec<u8>> {
    let poses = "0.0,0,0.05,0.05,0.15,0,0,0,1,0\n0.001,1,0.05,0.05,0.149,0,0,0,1,1\n0.002,0,0.05,0.05,0.11,0,0,0,1,0\n";
    let events = "0.0,0,,,,,,,,,attach,0.001,0.0001,0.1\n0.001,0,0.05,0.05,0.15,0,0,0,1,0,pose,,,\n\
        0.002,,,,,,,,,,reset,,,\n0.003,0,,,,,,,,,detach,,,\n";
    let budgets = "0.0,,,,,,,,,,budget,,,,1000000 900000 800000 700000,\n0.001,0,,,,,,,,,attach,0.001,0.0001,0.1,,\n";
    vec![
        format!("{TRAJECTORY_HEADER}\n{poses}").into(),
        format!("{TRAJECTORY_HEADER},{EVENT_COLUMNS}\n{events}").into(),
        format!("{TRAJECTORY_HEADER},{EVENT_COLUMNS},{BUDGET_COLUMNS}\n{budgets}").into(),
    ]
}

fn small_scene() -> Scene {
    let text =
        include_str!("../../../config/scenes/cube.toml").replace("[[3, 3, 3], [5, 5, 5], [8, 8, 8]]", "[[2, 2, 2]]");
    scene::parse(&text, "seed").unwrap()
}

/// A tool that presses a cube for a tenth of a second: as it is written, and without compression or checksums, which hide what
/// is damaged.
pub static RECORDINGS: LazyLock<[Vec<u8>; 2]> = LazyLock::new(|| {
    let scene = small_scene();
    let loaded = scene::LoadedScene { scene, origin: "seed".into(), folder: "".into() };
    let body = std::sync::Arc::new(loaded.build(&mut |_, _, _| {}).unwrap());
    let scene = loaded.scene;
    let start = Snapshot::at_rest(&body, 0, 1);
    let mut simulation = Simulation::new(body.clone(), scene.settings(), start.clone()).unwrap();
    let mut rows = format!("{TRAJECTORY_HEADER}\n");
    for tick in 0..100 {
        writeln!(rows, "{},0,0.05,0.05,{},0,0,0,1,0", f64::from(tick) * 1e-3, 0.125 - f64::from(tick) * 2e-4).unwrap();
    }
    let trajectory = Trajectory::parse(&rows, "seed", 1).unwrap();
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("seed.mcap");
    let mut writer = RecordingWriter::create(&file, &scene, &body, &start, simulation.reset_state()).unwrap();
    for tick in 1..=100 {
        let inputs = trajectory.inputs(tick);
        let o = simulation.advance(&inputs);
        writer.tick(o.tick, &inputs, &o.tools, o.flags(), o.frame.then_some(o.hash)).unwrap();
        if o.frame {
            writer.frame(&o.into()).unwrap();
        }
    }
    writer.finish().unwrap();
    let written = std::fs::read(file).unwrap();
    let options = mcap::WriteOptions::new().compression(None).use_chunks(false).calculate_data_section_crc(false);
    let options = options.calculate_summary_section_crc(false).repeat_schemas(false).repeat_channels(false);
    let mut plain = options.emit_statistics(false).create(Cursor::new(Vec::new())).unwrap();
    for message in mcap::MessageStream::new(&written).unwrap() {
        let mut message = message.unwrap();
        // All schemas of the contract would be most of the file.
        let channel = std::sync::Arc::make_mut(&mut message.channel);
        channel.schema = None;
        plain.write(&message).unwrap();
    }
    plain.finish().unwrap();
    [written, plain.into_inner().into_inner()]
});

/// What was recorded under `topic`, message by message.
fn recorded(topic: &str) -> Vec<Vec<u8>> {
    let messages = mcap::MessageStream::new(&RECORDINGS[0]).unwrap().map(Result::unwrap);
    messages.filter(|message| message.channel.topic == topic).map(|message| message.data.to_vec()).collect()
}

/// `messages`, each after its length.
fn after_lengths(messages: impl IntoIterator<Item = Vec<u8>>) -> Vec<u8> {
    let mut bytes = Vec::new();
    for message in messages {
        prost::encode_length_delimiter(message.len(), &mut bytes).unwrap();
        bytes.extend(message);
    }
    bytes
}

/// The surface of the recording with its first frames: how many parts its topology has, then all messages, each after its length.
pub fn surface() -> Vec<u8> {
    let parts = recorded(topics::TOPOLOGY);
    let frames = recorded(topics::SURFACE);
    [vec![parts.len() as u8], after_lengths(parts), after_lengths(frames.into_iter().take(3))].concat()
}

/// Pictures in parts, each after its length.
pub fn pictures() -> Vec<u8> {
    let part = |picture, part| proto::SurfacePicture {
        topology: 1,
        picture,
        media_type: "image/png".into(),
        content: vec![part as u8; 9],
        part,
        parts: 2,
    };
    after_lengths([(2, 1), (1, 0), (2, 0), (1, 1)].map(|(picture, of)| part(picture, of).encode_to_vec()))
}

/// Wrenches in contact, each after its length, some with what the force will be nearby.
pub fn wrenches() -> Vec<u8> {
    let mut wrenches: Vec<_> = recorded(topics::WRENCH).into_iter().skip(60).take(8).collect();
    let mut last = proto::ToolWrench::decode(&wrenches[7][..]).unwrap();
    last.model_position = vec![0.05, 0.05, 0.11];
    last.model_force = vec![0.0, 0.0, 1.5];
    last.model_normal = vec![0.0, 0.0, 1.0];
    last.model_stiffness = vec![200.0, 200.0, 400.0, 0.0, 0.0, 1.0];
    last.model_range = 0.005;
    wrenches[7] = last.encode_to_vec();
    after_lengths(wrenches)
}

/// What ticks of the recording consumed.
pub fn inputs() -> Vec<Vec<u8>> {
    recorded(topics::INPUTS).into_iter().take(8).collect()
}

/// A pose of the holder of [`crate::EPOCH`].
pub fn pose() -> proto::ToolPose {
    proto::ToolPose {
        epoch: crate::EPOCH,
        secret: crate::SECRET,
        sequence: 3,
        time_ns: 5,
        position: vec![0.05, 0.05, 0.12],
        orientation: vec![0.0, 0.0, 0.0, 1.0],
        buttons: 1,
        opening: 0.5,
    }
}

/// Keys from which something is read.
pub fn keys() -> Vec<Vec<u8>> {
    vec![palpate_proto::keys::tool_pose("main", 7).into(), palpate_proto::keys::presence("main", 2, 99).into()]
}

/// Requests of a page that begin with the byte of their kind.
pub fn page() -> Vec<Vec<u8>> {
    use palpate_web::message::{CONTROL, POSE, SEEN};
    let attach = proto::Attach { client: "page".into(), ..Default::default() };
    let request = proto::ControlRequest { request: Some(proto::control_request::Request::Attach(attach)) };
    vec![
        [&[CONTROL], &request.encode_to_vec()[..]].concat(),
        [&[POSE, 0], &pose().encode_to_vec()[..]].concat(),
        vec![SEEN, 4, 1, 0, 0, 0, 0, 0, 0],
        br#"{"invite":{"rights":"operator"}}"#.to_vec(),
    ]
}

/// A message of each kind after the byte of its kind, in the order of [`crate::MESSAGES`].
pub fn messages() -> Vec<Vec<u8>> {
    let start = proto::RecordingStart::decode(&recorded(topics::START)[0][..]).unwrap();
    let request = proto::ControlRequest {
        request: Some(proto::control_request::Request::StartRecording(proto::StartRecording { path: "a.mcap".into() })),
    };
    let status = proto::Status { faults: vec!["a".into()], clients: vec!["b".into()], ..Default::default() };
    let first = |topic: &str| recorded(topic).swap_remove(0);
    let messages = [
        pose().encode_to_vec(),
        first(topics::WRENCH),
        start.session.clone().unwrap_or_default().encode_to_vec(),
        request.encode_to_vec(),
        proto::ControlReply { error: "busy".into(), ..Default::default() }.encode_to_vec(),
        status.encode_to_vec(),
        first(topics::TOPOLOGY),
        proto::SurfacePicture { content: vec![1; 9], ..Default::default() }.encode_to_vec(),
        first(topics::SURFACE),
        start.encode_to_vec(),
        first(topics::INPUTS),
        first(topics::HASH),
        proto::RecordingEnd { fault: "full".into() }.encode_to_vec(),
    ];
    (0..).zip(messages).map(|(kind, message): (u8, _)| [vec![kind], message].concat()).collect()
}
