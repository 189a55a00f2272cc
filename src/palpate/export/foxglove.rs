//! What Foxglove shows by itself: the surface and the tools as scenes, and the wrench of each tool to plot.

use super::{moments, surface};
use crate::output::Output;
use crate::recording::Recording;
use crate::wire;
use mcap::records::MessageHeader;
use mcap::write::NoSeek;
use nalgebra::{UnitQuaternion, Vector3};
use palpate_client::{Moment, Surface};
use palpate_proto::foxglove::{
    ArrowPrimitive, Color, Point3, Pose, Quaternion, SceneEntity, SceneEntityDeletion, SceneUpdate, SpherePrimitive,
    TriangleListPrimitive, Vector3 as Vector, scene_entity_deletion::Type,
};
use palpate_proto::{self as proto, Message, foxglove};
use std::collections::BTreeMap;
use std::io;
use std::path::Path;

/// Length of the arrow of a force [m/N]; tuned for the eye. Longer, and arrows hide the organ; shorter, and light touch shows none.
const ARROW: f64 = 0.02;
const TISSUE: Color = Color { r: 0.78, g: 0.42, b: 0.38, a: 1.0 };
const TOOL: Color = Color { r: 0.75, g: 0.77, b: 0.8, a: 1.0 };
const FORCE: Color = Color { r: 0.1, g: 0.45, b: 0.9, a: 1.0 };

/// Nanoseconds of a tick.
const TICK_NS: u64 = 1_000_000;

type Writer = mcap::Writer<NoSeek<Output>>;

/// Writes `recording` as Foxglove reads it to `path`: topics `/surface` and `/tools`, and `/wrench/{name}` of each tool. Every
/// `every`-th frame; how many that are.
///
/// # Errors
/// Those of the file system, and when a frame is damaged.
pub fn write_foxglove(recording: &Recording, every: usize, path: &Path) -> io::Result<usize> {
    let surface = surface(recording).map_err(io::Error::other)?;
    let options = mcap::WriteOptions::new()
        .compression(Some(mcap::Compression::Lz4))
        .disable_seeking(true)
        .library(format!("palpate {}", env!("CARGO_PKG_VERSION")));
    let mut mcap = options.create(NoSeek::new(Output::create(path)?)).map_err(io::Error::other)?;
    let scene = schema(&mut mcap, "foxglove.SceneUpdate", foxglove::DESCRIPTOR_SET)?;
    let wrench = schema(&mut mcap, &proto::schema_name("ToolWrench"), proto::DESCRIPTOR_SET)?;
    let (surfaces, tools) = (channel(&mut mcap, scene, "/surface")?, channel(&mut mcap, scene, "/tools")?);
    let keys = recording.scene.tool.iter();
    let wrenches = keys.map(|keys| channel(&mut mcap, wrench, &format!("/wrench/{}", keys.name)));
    let wrenches = wrenches.collect::<io::Result<Vec<u16>>>()?;
    let radii = wire::session::describe(&recording.scene, &recording.body).tools;
    let radii: Vec<f64> = radii.iter().map(|tool| tool.radius).collect();

    let mut felt = recording.wrenches.values().peekable();
    let mut written = 0;
    for moment in moments(recording, surface.clone()).step_by(every.max(1)) {
        let moment = moment.map_err(io::Error::other)?;
        // In the order of time, as readers like it.
        while let Some(wrench) = felt.next_if(|wrench| wrench.tick <= moment.tick) {
            put_wrench(&mut mcap, &wrenches, wrench)?;
        }
        put(&mut mcap, surfaces, moment.tick, &shown(&surface, &moment))?;
        put(&mut mcap, tools, moment.tick, &held(&moment, &radii))?;
        written += 1;
    }
    felt.try_for_each(|wrench| put_wrench(&mut mcap, &wrenches, wrench))?;
    mcap.finish().map_err(io::Error::other)?;
    mcap.into_inner().into_inner().finish()?;
    Ok(written)
}

fn schema(mcap: &mut Writer, name: &str, descriptors: &[u8]) -> io::Result<u16> {
    mcap.add_schema(name, "protobuf", descriptors).map_err(io::Error::other)
}

fn channel(mcap: &mut Writer, schema: u16, topic: &str) -> io::Result<u16> {
    mcap.add_channel(schema, topic, "protobuf", &BTreeMap::new()).map_err(io::Error::other)
}

fn put(mcap: &mut Writer, channel_id: u16, tick: u64, message: &impl Message) -> io::Result<()> {
    let time = tick * TICK_NS;
    let header = MessageHeader { channel_id, sequence: tick as u32, log_time: time, publish_time: time };
    mcap.write_to_known_channel(&header, &message.encode_to_vec()).map_err(io::Error::other)
}

fn put_wrench(mcap: &mut Writer, channels: &[u16], wrench: &proto::ToolWrench) -> io::Result<()> {
    match channels.get(wrench.tool as usize) {
        Some(channel) => put(mcap, *channel, wrench.tick, wrench),
        None => Ok(()),
    }
}

/// The surface at `moment`.
fn shown(surface: &Surface, moment: &Moment) -> SceneUpdate {
    let point = |p: &[f32; 3]| {
        let [x, y, z] = p.map(f64::from);
        Point3 { x, y, z }
    };
    let triangles = TriangleListPrimitive {
        pose: Some(pose([0.0; 3], [0.0, 0.0, 0.0, 1.0])),
        points: moment.positions.iter().map(point).collect(),
        color: Some(TISSUE),
        indices: surface.triangles.as_flattened().to_vec(),
    };
    let body = SceneEntity { triangles: vec![triangles], ..entity(moment, "body") };
    SceneUpdate { deletions: Vec::new(), entities: vec![body] }
}

/// The tools that somebody holds at `moment`, each with the force on it; none else.
fn held(moment: &Moment, radii: &[f64]) -> SceneUpdate {
    let all = SceneEntityDeletion { timestamp: Some(stamp(moment)), r#type: Type::All as i32, id: String::new() };
    let entities = moment.tools.iter().map(|tool| {
        let [position, force] = [&tool.position, &tool.force].map(|list| three(list));
        let orientation = <[f32; 4]>::try_from(&tool.orientation[..]).unwrap_or([0.0, 0.0, 0.0, 1.0]).map(f64::from);
        let diameter = 2.0 * radii.get(tool.shape_of() as usize).copied().unwrap_or_default();
        let ball = SpherePrimitive {
            pose: Some(pose(position, orientation)),
            size: Some(Vector { x: diameter, y: diameter, z: diameter }),
            color: Some(TOOL),
        };
        SceneEntity {
            spheres: vec![ball],
            arrows: arrow(position, force).into_iter().collect(),
            ..entity(moment, &format!("tool {}", tool.tool))
        }
    });
    SceneUpdate { deletions: vec![all], entities: entities.collect() }
}

/// The force [N] on a tool at `position` [m]; none where there is none.
fn arrow(position: [f64; 3], force: [f64; 3]) -> Option<ArrowPrimitive> {
    let force = Vector3::from(force);
    let length = ARROW * force.norm();
    if length == 0.0 {
        return None;
    }
    // Half a turn has no axis of its own.
    let turn = UnitQuaternion::rotation_between(&Vector3::x(), &force)
        .unwrap_or_else(|| UnitQuaternion::from_axis_angle(&Vector3::z_axis(), std::f64::consts::PI));
    Some(ArrowPrimitive {
        pose: Some(pose(position, turn.coords.into())),
        shaft_length: 0.75 * length,
        shaft_diameter: 0.1 * ARROW,
        head_length: 0.25 * length,
        head_diameter: 0.2 * ARROW,
        color: Some(FORCE),
    })
}

fn entity(moment: &Moment, id: &str) -> SceneEntity {
    SceneEntity { timestamp: Some(stamp(moment)), frame_id: "world".into(), id: id.into(), ..SceneEntity::default() }
}

fn stamp(moment: &Moment) -> prost_types::Timestamp {
    let nanoseconds = moment.tick * TICK_NS;
    prost_types::Timestamp {
        seconds: (nanoseconds / 1_000_000_000) as i64,
        nanos: (nanoseconds % 1_000_000_000) as i32,
    }
}

fn pose([x, y, z]: [f64; 3], [qx, qy, qz, qw]: [f64; 4]) -> Pose {
    Pose { position: Some(Vector { x, y, z }), orientation: Some(Quaternion { x: qx, y: qy, z: qz, w: qw }) }
}

fn three(list: &[f32]) -> [f64; 3] {
    <[f32; 3]>::try_from(list).unwrap_or_default().map(f64::from)
}
