//! Everything that Palpate reads and somebody else wrote, as one table: [`TARGETS`].
//!
//! Whatever the bytes, the answer is an error or something that holds together, in memory and time that the number of bytes
//! bounds. `tests/damage.rs` tries seeds with some damage, with any compiler; `tests/fuzz/run` has libFuzzer mutate them by the
//! code that they reach.

#![allow(rustdoc::broken_intra_doc_links, reason = "units stand in square brackets, as in `[m]`")]

pub mod cost;
pub mod seeds;

use palpate::offline::Trajectory;
use palpate::recording::{Recording, replay};
use palpate::{scene, wire};
use palpate_body::geometry::mesh_io::{self, LengthUnit, Solid};
use palpate_body::geometry::textured::TexturedMesh;
use palpate_body::prepare::body_file::BodyFile;
use palpate_client::{Device, Order, Picture, RenderMode, Renderer, Surface, SurfaceDecoder, Wrench};
use palpate_core::math::{Bounds, Vec3};
use palpate_core::model::element_kernel::Simd;
use palpate_core::model::{ActiveMesh, Body};
use palpate_core::simulation::Snapshot;
use palpate_proto::{self as proto, Message, keys};
use palpate_web::message::{FromPage, Wish};
use seeds::{PARTS, PREPARED, RECORDINGS};

/// Something that is read.
#[derive(Clone, Copy)]
pub struct Target {
    /// A name, for the command line and for folders.
    pub name: &'static str,
    /// Bytes as they should be.
    pub seeds: fn() -> Vec<Vec<u8>>,
    read: fn(&[u8]) -> bool,
}

impl Target {
    /// Reads `bytes`; whether they were taken for something. Panics where the reader does, where what it gives does not hold together, and where it costs more than
    /// [`cost::bounded`] allows.
    pub fn take(&self, bytes: &[u8]) -> bool {
        cost::bounded(bytes.len(), || (self.read)(bytes))
    }
}

/// A target that reads meshes in the format of the extension `$name`.
macro_rules! mesh {
    ($name:literal) => {
        Target { name: concat!("mesh-", $name), seeds: || seeds::mesh($name), read: |bytes| mesh($name, bytes) }
    };
}

/// All there are.
pub const TARGETS: [Target; 27] = [
    mesh!("obj"),
    mesh!("off"),
    mesh!("stl"),
    mesh!("ply"),
    mesh!("glb"),
    mesh!("vtk"),
    mesh!("vtu"),
    mesh!("mesh"),
    mesh!("msh"),
    mesh!("inp"),
    mesh!("node"),
    Target { name: "textured-obj", seeds: || vec![seeds::textured_obj()], read: |bytes| textured("a.obj", bytes) },
    Target { name: "textured-glb", seeds: || seeds::mesh("glb"), read: |bytes| textured("a.glb", bytes) },
    Target { name: "prepared", seeds: || vec![PREPARED.clone()], read: prepared },
    Target { name: "body", seeds: || vec![PREPARED[*PARTS..].to_vec()], read: body },
    Target { name: "scene", seeds: seeds::scenes, read: scene },
    Target { name: "device", seeds: seeds::devices, read: device },
    Target { name: "trajectory", seeds: seeds::trajectories, read: trajectory },
    Target { name: "recording", seeds: || RECORDINGS.to_vec(), read: recording },
    Target { name: "pose", seeds: || vec![seeds::pose().encode_to_vec()], read: pose },
    Target { name: "inputs", seeds: seeds::inputs, read: inputs },
    Target { name: "wrenches", seeds: || vec![seeds::wrenches()], read: wrenches },
    Target { name: "surface", seeds: || vec![seeds::surface()], read: surface },
    Target { name: "pictures", seeds: || vec![seeds::pictures()], read: pictures },
    Target { name: "key", seeds: seeds::keys, read: key },
    Target { name: "page", seeds: seeds::page, read: page },
    Target { name: "messages", seeds: seeds::messages, read: messages },
];

fn mesh(extension: &str, bytes: &[u8]) -> bool {
    let name = format!("a.{extension}").into();
    let files = match (extension, parted(bytes)) {
        ("node", (nodes, elements)) => vec![(name, nodes.to_vec()), ("a.ele".into(), elements.to_vec())],
        _ => vec![(name, bytes.to_vec())],
    };
    // Half of them with holes that are to be closed.
    let holes = if bytes.len().is_multiple_of(2) { 0.2 } else { 0.0 };
    match mesh_io::parse(&files, LengthUnit::Metre, holes, None) {
        Err(e) => {
            assert!(!e.to_string().is_empty());
            return false;
        }
        Ok((Solid::Surface(surface), _)) => assert!(surface.volume() > 0.0),
        Ok((Solid::Volume(of), _)) => assert!((0..of.mesh.elements.len()).all(|e| of.mesh.volume(e) > 0.0)),
    }
    true
}

/// What stands before and after the first zero.
fn parted(bytes: &[u8]) -> (&[u8], &[u8]) {
    let at = bytes.iter().position(|byte| *byte == 0).unwrap_or(bytes.len());
    (&bytes[..at], bytes.get(at + 1..).unwrap_or_default())
}

fn textured(name: &str, bytes: &[u8]) -> bool {
    let (mesh, beside) = if name.ends_with("obj") { parted(bytes) } else { (bytes, &b"\x89PNG"[..]) };
    let beside = |name: &str| Ok(if name.ends_with("png") { b"\x89PNG".to_vec() } else { beside.to_vec() });
    let Ok(mesh) = TexturedMesh::parse(name.as_ref(), mesh, &beside, LengthUnit::Metre) else { return false };
    let (vertices, triangles) = (mesh.surface.vertices.len(), &mesh.surface.triangles);
    assert!(triangles.iter().flatten().all(|v| (*v as usize) < vertices));
    assert!([mesh.normals.len(), mesh.uvs.len()].iter().all(|count| [0, vertices].contains(count)));
    assert_eq!(mesh.materials.iter().map(|material| material.triangles).sum::<usize>(), triangles.len());
    assert!(mesh.materials.iter().all(|material| material.picture.is_none_or(|at| at < mesh.pictures.len())));
    true
}

fn prepared(bytes: &[u8]) -> bool {
    let Ok(file) = BodyFile::from_bytes(bytes) else { return false };
    holds_together(&file.body);
    true
}

/// The parts of a body, under checksums that are right.
fn body(bytes: &[u8]) -> bool {
    prepared(&seeds::resealed([&PREPARED[..*PARTS], bytes].concat()))
}

/// A body from a file can be put to work.
pub fn holds_together(body: &Body) {
    for level in 0..body.levels().len() {
        ActiveMesh::new(body, &Snapshot::at_rest(body, level, 1).body, usize::MAX).unwrap();
    }
    assert_eq!(Body::from_bytes(body.bytes()).unwrap().checksum(), body.checksum());
}

fn scene(bytes: &[u8]) -> bool {
    let Ok(Ok(scene)) = str::from_utf8(bytes).map(|text| scene::parse(text, "a")) else { return false };
    scene.settings();
    let again = scene::parse(&scene.to_toml(), "b").unwrap_or_else(|e| panic!("{e}: {}", scene.to_toml()));
    assert_eq!(again.to_toml(), scene.to_toml());
    true
}

fn device(bytes: &[u8]) -> bool {
    let Ok(Ok(device)) = str::from_utf8(bytes).map(|text| Device::from_text(text, "a")) else { return false };
    assert!(device.max_force > 0.0 && device.passivity_budget() >= 0.0);
    true
}

fn trajectory(bytes: &[u8]) -> bool {
    let Ok(Ok(trajectory)) = str::from_utf8(bytes).map(|text| Trajectory::parse(text, "a", 2)) else { return false };
    for tick in 0..=trajectory.last_tick().min(10) {
        trajectory.inputs(tick);
    }
    true
}

/// Ticks that a recording is run again for: enough for its frames.
const MOST_TICKS: usize = 100;

fn recording(bytes: &[u8]) -> bool {
    // For a name of a damaged length the library reserves as much as 32 bits can say, and then finds that it is not there.
    let read = cost::reserving(|| Recording::from_bytes(bytes, "a"));
    let Ok(mut recording) = read else { return false };
    recording.inputs.truncate(MOST_TICKS);
    replay(&recording, Simd::best()).is_ok()
}

/// Epoch and secret of the holder whose poses pass.
pub const EPOCH: u32 = 9;
/// See [`EPOCH`].
pub const SECRET: u64 = 77;

fn pose(bytes: &[u8]) -> bool {
    let workspace = Bounds::new(Vec3::repeat(-1.0), Vec3::repeat(1.0));
    let Ok(sample) = wire::Gate::new(EPOCH, SECRET, workspace).pass(bytes) else { return false };
    let length = sample.pose.orientation.iter().map(|q| q * q).sum::<f64>();
    assert!(workspace.contains(&sample.pose.position) && (length - 1.0).abs() < 1e-9);
    true
}

fn inputs(bytes: &[u8]) -> bool {
    let Ok(message) = proto::TickInputs::decode(bytes) else { return false };
    let Some(inputs) = wire::inputs_from_message(&message) else { return false };
    let again = wire::inputs_to_message(message.tick, &inputs);
    let same = wire::inputs_to_message(message.tick, &wire::inputs_from_message(&again).expect("what was written"));
    // Bytes, as numbers may be NaN.
    assert_eq!(same.encode_to_vec(), again.encode_to_vec());
    true
}

/// Messages of one kind, each after its length, up to the first that is none.
fn all<M: Message + Default>(mut bytes: &[u8]) -> impl Iterator<Item = M> {
    std::iter::from_fn(move || M::decode_length_delimited(&mut bytes).ok())
}

fn wrenches(bytes: &[u8]) -> bool {
    let mut taken = false;
    for mode in RenderMode::names() {
        let device = Device::default();
        let mut renderer = Renderer::new(&device, mode.parse().expect("a name of a mode"));
        let mut order = Order::default();
        for (i, message) in all::<proto::ToolWrench>(bytes).enumerate() {
            let (now, x) = (i as u64 * 1_000_000, 0.05 + 1e-4 * i as f64);
            if let Ok(wrench) = Wrench::try_from(&message) {
                order.judge(&wrench, now);
                taken |= renderer.receive(&wrench, now);
            }
            let force = renderer.force([x, 0.05, 0.11], [0.1, 0.0, 0.0], now);
            let length = force.iter().map(|f| f * f).sum::<f64>().sqrt();
            assert!(length <= device.max_force * (1.0 + 1e-9), "{force:?}");
            assert!(renderer.torque(now).iter().all(|torque| torque.is_finite()));
        }
    }
    taken
}

fn surface(bytes: &[u8]) -> bool {
    let Some((parts, mut bytes)) = bytes.split_first() else { return false };
    let mut topology = Vec::new();
    for _ in 0..*parts {
        let Ok(part) = proto::SurfaceTopology::decode_length_delimited(&mut bytes) else { return false };
        topology.push(part);
    }
    let Ok(surface) = Surface::from_parts(topology) else { return false };
    let (vertices, ranges) = (surface.rest_positions.len(), surface.ranges().last());
    assert!(ranges.is_some_and(|[v, t]| (v.end, t.end) == (vertices, surface.triangles.len())));
    let (mut decoder, mut taken) = (SurfaceDecoder::new(surface.into()), false);
    for frame in all::<proto::SurfaceFrame>(bytes) {
        if let Ok(Some(moment)) = decoder.receive(&frame) {
            assert_eq!(moment.positions.len(), vertices);
            decoder.surface().normals(&moment.positions);
            taken = true;
        }
    }
    taken
}

fn pictures(bytes: &[u8]) -> bool {
    Picture::from_parts(all(bytes).collect(), 1).is_ok()
}

fn page(bytes: &[u8]) -> bool {
    let message = FromPage::decode(bytes);
    if let Some(FromPage::Pose { pose, .. }) = &message {
        assert!(pose.sample.position.iter().chain(&pose.sample.orientation).all(|x| x.is_finite()));
    }
    message.is_some() || serde_json::from_slice::<Wish>(bytes).is_ok()
}

fn key(bytes: &[u8]) -> bool {
    let Ok(text) = str::from_utf8(bytes) else { return false };
    keys::tool_of_pose_key(text).is_some() || keys::holder_of_presence_key(text).is_some()
}

/// Reads back what it writes of a message `M`, byte for byte.
fn message<M: Message + Default>(bytes: &[u8]) -> bool {
    let Ok(message) = M::decode(bytes) else { return false };
    let written = message.encode_to_vec();
    assert_eq!(M::decode(&written[..]).expect("what was written").encode_to_vec(), written);
    true
}

/// Every message of the contract that somebody decodes.
pub const MESSAGES: [fn(&[u8]) -> bool; 13] = [
    message::<proto::ToolPose>,
    message::<proto::ToolWrench>,
    message::<proto::Session>,
    message::<proto::ControlRequest>,
    message::<proto::ControlReply>,
    message::<proto::Status>,
    message::<proto::SurfaceTopology>,
    message::<proto::SurfacePicture>,
    message::<proto::SurfaceFrame>,
    message::<proto::RecordingStart>,
    message::<proto::TickInputs>,
    message::<proto::StateHash>,
    message::<proto::RecordingEnd>,
];

fn messages(bytes: &[u8]) -> bool {
    let Some((kind, bytes)) = bytes.split_first() else { return false };
    MESSAGES.get(*kind as usize).is_some_and(|read| read(bytes))
}
