//! A recording to look at: a ball of tissue on whose top a tool presses.

use palpate_sdk::proto::keys::topics;
use palpate_sdk::proto::surface::{KEY_INTERVAL, SurfaceCode};
use palpate_sdk::proto::{
    BodyDescription, Limits, Message, Obstacle, ObstacleState, Organ, RecordingStart, Session, SurfaceFrame,
    SurfaceTopology, ToolDescription, ToolPart, ToolPhase, ToolState,
};
use std::collections::BTreeMap;
use std::f32::consts::{PI, TAU};
use std::fs::File;
use std::path::Path;

/// Radius of the ball [m].
pub const RADIUS: f32 = 0.1;
/// Ticks from one frame to the next.
pub const TICKS: u64 = 32;
/// The body sinks by this much a frame under the tool [m].
pub const SINK: f32 = 0.001;
/// Of the grid that frames' vertices stand on [m].
const STEP: f64 = 1e-6;

/// Rest positions, a pole first and last; `rings` of triangles from pole to pole, twice as many sectors around.
fn rest(rings: u32) -> Vec<[f32; 3]> {
    let sectors = 2 * rings;
    let mut positions = vec![[0.0, 0.0, RADIUS]];
    for ring in 1..rings {
        let down = PI * ring as f32 / rings as f32;
        positions.extend((0..sectors).map(|sector| {
            let around = TAU * sector as f32 / sectors as f32;
            [RADIUS * down.sin() * around.cos(), RADIUS * down.sin() * around.sin(), RADIUS * down.cos()]
        }));
    }
    positions.push([0.0, 0.0, -RADIUS]);
    positions
}

fn triangles(rings: u32) -> Vec<[u32; 3]> {
    let sectors = 2 * rings;
    let vertex = |ring: u32, sector: u32| match ring {
        0 => 0,
        ring if ring == rings => 1 + (rings - 1) * sectors,
        ring => 1 + (ring - 1) * sectors + sector % sectors,
    };
    let mut triangles = Vec::new();
    for ring in 0..rings {
        for sector in 0..sectors {
            let [a, b] = [vertex(ring, sector), vertex(ring, sector + 1)];
            let [c, d] = [vertex(ring + 1, sector), vertex(ring + 1, sector + 1)];
            triangles
                .extend([[a, c, d], [a, d, b]].into_iter().filter(|t| t[0] != t[1] && t[1] != t[2] && t[2] != t[0]));
        }
    }
    triangles
}

fn bytes(values: impl IntoIterator<Item = [f32; 3]>) -> Vec<u8> {
    values.into_iter().flatten().flat_map(f32::to_le_bytes).collect()
}

/// The top of the ball after `frame` frames of pressing.
pub fn height(frame: u64) -> f32 {
    RADIUS - SINK * frame as f32
}

/// Writes `frames` frames of a ball of 762 vertices; the first is number 1.
pub fn record(path: &Path, frames: u64) {
    record_ball(path, 20, frames);
}

/// As [`record`], with another number of rings.
pub fn record_ball(path: &Path, rings: u32, frames: u64) {
    record_organs(path, rings, frames, &[]);
}

/// As [`record_ball`], of `organs` that follow one another as vertices and triangles do; the last has what is left.
pub fn record_organs(path: &Path, rings: u32, frames: u64, organs: &[Organ]) {
    let options = mcap::WriteOptions::new().chunk_size(Some(4_000)).compression(Some(mcap::Compression::Lz4));
    let mut writer = options.create(File::create(path).unwrap()).unwrap();
    let mut say = |topic: &str, tick: u64, bytes: Vec<u8>| {
        let channel_id = writer.add_channel(0, topic, "protobuf", &BTreeMap::new()).unwrap();
        let time = tick * 1_000_000;
        let header = mcap::records::MessageHeader { channel_id, sequence: 0, log_time: time, publish_time: time };
        writer.write_to_known_channel(&header, &bytes).unwrap();
    };
    let shaft = ToolPart { corners: vec![0.0, 0.0, 0.0, 0.0, 0.0, 0.1], rounding: 0.01, ..Default::default() };
    let probe = ToolDescription {
        name: "probe".into(),
        shape: "capsule".into(),
        radius: 0.01,
        length: 0.1,
        parts: vec![shaft],
        ..Default::default()
    };
    // It rises as the tool sinks.
    let floor = Obstacle {
        name: "floor".into(),
        parts: vec![],
        position: vec![0.0, 0.0, f64::from(-height(0))],
        orientation: vec![0.0, 0.0, 0.0, 1.0],
    };
    let session = Session {
        body: Some(BodyDescription { name: "ball".into(), levels: 2, ..Default::default() }),
        tools: vec![probe],
        obstacles: vec![floor],
        limits: Some(Limits { force: 3.3, ..Default::default() }),
        ..Default::default()
    };
    let start = RecordingStart { palpate_version: "7".into(), session: Some(session), ..Default::default() };
    say(topics::START, 0, start.encode_to_vec());
    let (rest, triangles) = (rest(rings), triangles(rings));
    let mut organs = organs.to_vec();
    if let Some((last, others)) = organs.split_last_mut() {
        last.vertices = rest.len() as u32 - others.iter().map(|organ| organ.vertices).sum::<u32>();
        last.triangles = triangles.len() as u32 - others.iter().map(|organ| organ.triangles).sum::<u32>();
    }
    let topology = SurfaceTopology {
        topology: 3,
        vertices: rest.len() as u32,
        triangles: triangles.iter().flatten().flat_map(|v| v.to_le_bytes()).collect(),
        rest_positions: bytes(rest.clone()),
        part: 0,
        parts: 1,
        step: STEP,
        organs,
        ..Default::default()
    };
    let code = SurfaceCode::new(&triangles, &rest, STEP).unwrap();
    let mut key = (0, code.rest().to_vec());
    say(topics::TOPOLOGY, 0, topology.encode_to_vec());
    for number in 1..=frames {
        let top = height(number);
        // Everything above the tool's tip is pushed down to it, and only that.
        let positions = rest.iter().map(|&[x, y, z]| [x, y, if x.hypot(y) < 0.03 { z.min(top) } else { z }]);
        let tool = ToolState {
            tool: 0,
            position: vec![0.0, 0.0, top + 0.01],
            orientation: vec![0.0, 0.0, 0.0, 1.0],
            force: vec![0.0, 0.0, 0.05 * number as f32],
            phase: ToolPhase::Engaged.into(),
            opening: 0.0,
            shape: 0,
        };
        let floor = ObstacleState { position: vec![0.0, 0.0, -height(number)], force: vec![0.0; 3] };
        let points: Vec<_> = positions.map(|x| code.on_grid(x.map(f64::from))).collect();
        let is_key = (number - 1) % KEY_INTERVAL == 0;
        let reference = if is_key { code.rest() } else { &key.1 };
        let coded: Vec<_> = (0..code.parts()).map(|part| code.encode(part, reference, &points).unwrap()).collect();
        if is_key {
            key = (number, points);
        }
        for (part, displacements) in (0..).zip(coded) {
            let frame = SurfaceFrame {
                topology: 3,
                tick: TICKS * number,
                sequence: number,
                tools: if part == 0 { vec![tool.clone()] } else { vec![] },
                key: key.0,
                part,
                displacements,
                levels: Vec::new(),
                obstacles: if part == 0 { vec![floor.clone()] } else { vec![] },
            };
            say(topics::SURFACE, TICKS * number, frame.encode_to_vec());
        }
    }
    writer.finish().unwrap();
}
