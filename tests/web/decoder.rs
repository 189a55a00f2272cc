//! The page's decoder against what the server's encoder writes, and its messages against the contract; by node, where that is
//! installed.

use crate::random::Random;
use palpate_proto::surface::{GridPoint, SurfaceCode, VERTICES_PER_PART};
use palpate_proto::{
    ControlRequest, Message, ObstacleState, Organ, SurfaceFrame, SurfaceMaterial, SurfaceTopology, ToolPose, ToolState,
    control_request::Request,
};
use std::io::Write;
use std::path::Path;
use std::process::Command;

const STEP: f64 = 1.0 / 32768.0;
const TOPOLOGY: u32 = 9;

/// Triangles and vertices of a sheet of `side` × `side` vertices, 3 mm apart.
fn sheet(side: u32) -> (Vec<[u32; 3]>, Vec<[f32; 3]>) {
    let at = |v: u32| [0.003 * (v % side) as f32, 0.003 * (v / side) as f32, 1e-3 * (v % 7) as f32];
    let cells = (0..side * side).filter(|v| v % side + 1 < side && v / side + 1 < side);
    let triangles = cells.flat_map(|v| [[v, v + 1, v + side], [v + 1, v + side + 1, v + side]]).collect();
    (triangles, (0..side * side).map(at).collect())
}

fn bytes<const N: usize>(numbers: impl IntoIterator<Item = [u8; N]>) -> Vec<u8> {
    numbers.into_iter().flatten().collect()
}

/// A picture on the first two triangles, a colour on the third, nothing on the rest of so many.
fn materials(triangles: usize) -> Vec<SurfaceMaterial> {
    let material = |name: &str, triangles, colour: &[f32], picture| SurfaceMaterial {
        name: name.into(),
        triangles,
        colour: colour.into(),
        picture,
    };
    vec![
        material("skin", 2, &[1.0, 0.5, 0.25], 3),
        material("vessel", 1, &[0.5, 0.0, 0.0], 0),
        material("", triangles as u32 - 3, &[], 0),
    ]
}

/// Writes a topology, frames and what they decode to; gives the index that node reads.
fn write_vectors(folder: &Path, name: &str, side: u32, wild: bool) -> serde_json::Value {
    let (triangles, rest) = sheet(side);
    let code = SurfaceCode::new(&triangles, &rest, STEP).unwrap();
    let put = |file: String, bytes: &[u8]| {
        std::fs::write(folder.join(&file), bytes).unwrap();
        file
    };
    let (half, count) = (rest.len() / 2, triangles.len());
    let parts = [(0, &triangles[..], &rest[..half]), (1, &[][..], &rest[half..])].map(|(part, triangles, rest)| {
        let topology = SurfaceTopology {
            topology: TOPOLOGY,
            vertices: code.vertices() as u32,
            triangles: bytes(triangles.as_flattened().iter().map(|v| v.to_le_bytes())),
            rest_positions: bytes(rest.as_flattened().iter().map(|x| x.to_le_bytes())),
            part,
            parts: 2,
            step: STEP,
            organs: if part == 0 {
                vec![Organ { name: "sheet ä".into(), vertices: code.vertices() as u32, ..Default::default() }]
            } else {
                vec![]
            },
            normals: bytes(rest.iter().flat_map(|_| [0.0f32, 0.6, 0.8]).map(f32::to_le_bytes)),
            uvs: bytes(rest.iter().flat_map(|[x, y, _]| [*x, *y]).map(f32::to_le_bytes)),
            materials: if part == 0 { materials(count) } else { vec![] },
        };
        put(format!("{name}-topology-{part}"), &topology.encode_to_vec())
    });
    let mut random = Random(u64::from(side));
    let mut key: (u64, Vec<GridPoint>) = (0, vec![]);
    let frames = (0..40u64).map(|sequence| {
        let wave = |v: usize| {
            let depth = 40.0 * (0.05 * v as f64 + 0.4 * sequence as f64).sin();
            if wild {
                [0, 1, 2].map(|_| random.bits() as i32)
            } else {
                [depth as i32 / 3, sequence as i32, depth as i32]
            }
        };
        let moved: Vec<[i32; 3]> = (0..code.vertices()).map(wave).collect();
        let now: Vec<GridPoint> =
            code.rest().iter().zip(moved).map(|(rest, by)| [0, 1, 2].map(|c| rest[c].wrapping_add(by[c]))).collect();
        let levels: Vec<u8> = (0..code.vertices()).map(|v| ((v as u64 / 300 + sequence) % 4) as u8).collect();
        let is_key = sequence.is_multiple_of(16);
        let reference = if is_key { code.rest() } else { &key.1[..] };
        let parts: Vec<String> = (0..code.parts())
            .map(|part| {
                let tools = vec![ToolState {
                    tool: 1,
                    position: vec![0.5, -0.25, 1.0],
                    force: vec![0.0, 0.0, 2.5],
                    ..Default::default()
                }];
                let obstacle = ObstacleState { position: vec![0.0, 0.125, -0.5], force: vec![0.0, 0.0, -1.5] };
                let frame = SurfaceFrame {
                    topology: TOPOLOGY,
                    tick: 32 * sequence,
                    sequence,
                    key: if is_key { sequence } else { key.0 },
                    part: part as u32,
                    displacements: code.encode(part, reference, &now).unwrap(),
                    levels: code.encode_levels(part, &levels).unwrap(),
                    tools: if part == 0 { tools } else { vec![] },
                    obstacles: if part == 0 { vec![obstacle] } else { vec![] },
                };
                put(format!("{name}-frame-{sequence}-{part}"), &frame.encode_to_vec())
            })
            .collect();
        let positions: Vec<[f32; 3]> = now.iter().map(|point| code.position(*point)).collect();
        let whole = bytes(positions.as_flattened().iter().map(|x| x.to_le_bytes()));
        let whole = serde_json::json!({
            "parts": parts,
            "positions": put(format!("{name}-positions-{sequence}"), &whole),
            "levels": put(format!("{name}-levels-{sequence}"), &levels),
            "tick": 32 * sequence,
        });
        if is_key {
            key = (sequence, now);
        }
        whole
    });
    let frames: Vec<_> = frames.collect();
    serde_json::json!({ "name": name, "topology": parts, "frames": frames })
}

#[test]
fn the_page_reads_what_the_server_writes_and_writes_what_it_reads() {
    if Command::new("node").arg("--version").output().is_err() {
        let _ = writeln!(std::io::stderr(), "skipped: the page's decoder needs node");
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    // As many vertices as the bundled liver shows; three parts; and whatever 32 bits can hold.
    let surfaces = [("liver", 74, false), ("parts", 110, false), ("wild", 40, true)];
    const { assert!(110 * 110 > 2 * VERTICES_PER_PART) };
    let vectors = surfaces.map(|(name, side, wild)| write_vectors(folder.path(), name, side, wild));
    std::fs::write(folder.path().join("index.json"), serde_json::to_string(&vectors).unwrap()).unwrap();
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/web/decoder.mjs");
    let output = Command::new("node").arg(script).arg(folder.path()).output().unwrap();
    let said = String::from_utf8_lossy(&output.stdout);
    println!("{said}");
    assert!(output.status.success(), "{said}{}", String::from_utf8_lossy(&output.stderr));

    let written = |name: &str| std::fs::read(folder.path().join(name)).unwrap();
    let pose = written("pose");
    assert_eq!(pose[..2], [palpate_web::message::POSE, 3]);
    let expected = ToolPose {
        epoch: 4_000_000_000,
        sequence: 70_000,
        time_ns: 1 << 50,
        position: vec![0.25, -0.5, 1e-3],
        orientation: vec![0.0, 0.6, 0.0, 0.8],
        buttons: 3,
        opening: 0.25,
        ..Default::default()
    };
    assert_eq!(ToolPose::decode(&pose[2..]).unwrap(), expected);
    let request = |name: &str| {
        let bytes = written(name);
        assert_eq!(bytes[0], palpate_web::message::CONTROL);
        ControlRequest::decode(&bytes[1..]).unwrap().request.unwrap()
    };
    let Request::Attach(attach) = request("attach") else { panic!("attach") };
    assert_eq!((&attach.client[..], &attach.tool[..], attach.rate_hz), ("left hand", "ball ä", 90.0));
    let Request::Detach(detach) = request("detach") else { panic!("detach") };
    assert_eq!((detach.tool, detach.epoch), (3, 4_000_000_000));
    assert!(matches!(request("reset"), Request::Reset(_)));
}
