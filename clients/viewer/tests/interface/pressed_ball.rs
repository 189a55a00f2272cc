//! A recording to look at: a ball of tissue on whose top a tool presses.

use palpate_sdk::proto::keys::topics;
use palpate_sdk::proto::{Message, RecordingStart, SurfaceFrame, SurfaceTopology, ToolPhase, ToolState};
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
/// Of triangles, from pole to pole and around.
const RINGS: u32 = 20;
const SECTORS: u32 = 40;
const SCENE: &str = "name = 'ball'\n[body]\nspacings = [0.1, 0.05]\n[safety]\nforce_limit = 3.3\n\
                     [[tool]]\nname = 'probe'\nradius = 0.01\nlength = 0.1\n";

/// Rest positions, a pole first and last.
fn rest() -> Vec<[f32; 3]> {
    let mut positions = vec![[0.0, 0.0, RADIUS]];
    for ring in 1..RINGS {
        let down = PI * ring as f32 / RINGS as f32;
        positions.extend((0..SECTORS).map(|sector| {
            let around = TAU * sector as f32 / SECTORS as f32;
            [RADIUS * down.sin() * around.cos(), RADIUS * down.sin() * around.sin(), RADIUS * down.cos()]
        }));
    }
    positions.push([0.0, 0.0, -RADIUS]);
    positions
}

fn triangles() -> Vec<[u32; 3]> {
    let vertex = |ring: u32, sector: u32| match ring {
        0 => 0,
        RINGS => 1 + (RINGS - 1) * SECTORS,
        ring => 1 + (ring - 1) * SECTORS + sector % SECTORS,
    };
    let mut triangles = Vec::new();
    for ring in 0..RINGS {
        for sector in 0..SECTORS {
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

/// Writes `frames` frames; the first is number 1.
pub fn record(path: &Path, frames: u64) {
    let options = mcap::WriteOptions::new().chunk_size(Some(40_000)).compression(Some(mcap::Compression::Lz4));
    let mut writer = options.create(File::create(path).unwrap()).unwrap();
    let mut say = |topic: &str, tick: u64, bytes: Vec<u8>| {
        let channel_id = writer.add_channel(0, topic, "protobuf", &BTreeMap::new()).unwrap();
        let time = tick * 1_000_000;
        let header = mcap::records::MessageHeader { channel_id, sequence: 0, log_time: time, publish_time: time };
        writer.write_to_known_channel(&header, &bytes).unwrap();
    };
    let start = RecordingStart { scene_toml: SCENE.into(), palpate_version: "7".into(), ..Default::default() };
    say(topics::START, 0, start.encode_to_vec());
    let rest = rest();
    let topology = SurfaceTopology {
        topology: 3,
        vertices: rest.len() as u32,
        triangles: triangles().into_iter().flatten().flat_map(u32::to_le_bytes).collect(),
        rest_positions: bytes(rest.clone()),
    };
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
        };
        let frame = SurfaceFrame {
            topology: 3,
            tick: TICKS * number,
            sequence: number,
            positions: bytes(positions),
            tools: vec![tool],
        };
        say(topics::SURFACE, TICKS * number, frame.encode_to_vec());
    }
    writer.finish().unwrap();
}
