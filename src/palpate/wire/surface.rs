//! The surface on its way to viewers and into recordings; how its bytes are coded stands in [`palpate_proto::surface`].

use super::session::organs;
use super::{obstacle_state, tool_state};
use crate::display::{Display, Look};
use palpate_body::geometry::textured::Picture;
use palpate_core::contact::dent::deepen;
use palpate_core::contact::tool::Phase;
use palpate_core::math::{Bounds, Real, Vec3};
use palpate_core::model::Body;
use palpate_core::simulation::Frame;
use palpate_proto as proto;
use palpate_proto::surface::{CodeError, GridPoint, KEY_INTERVAL, SurfaceCode};
use std::sync::Arc;

/// Codes the frames of one surface, one after another.
#[derive(Debug)]
pub struct SurfaceEncoder {
    topology: u32,
    display: Arc<Display>,
    code: SurfaceCode,
    sequence: u64,
    key: (u64, Vec<GridPoint>),
    now: Vec<GridPoint>,
}

/// Triangles and vertices in one part of a topology: 60,000 bytes, of vertices with normals and texture coordinates 63,600.
const TRIANGLES_PER_PART: usize = 3_000;
const POSITIONS_PER_PART: usize = 2_000;
const TEXTURED_PER_PART: usize = 850;
/// Bytes in one part of a picture.
const PICTURE_BYTES_PER_PART: usize = 60_000;

/// The surface that is shown of `body` at rest, in parts; frames of it carry the number `topology`.
pub fn topology(body: &Body, display: &Display, topology: u32) -> Vec<proto::SurfaceTopology> {
    let plain = display.normals.is_empty() && display.uvs.is_empty();
    let per_part = if plain { POSITIONS_PER_PART } else { TEXTURED_PER_PART };
    let vertices = display.rest.len();
    let parts = display.triangles.len().div_ceil(TRIANGLES_PER_PART).max(vertices.div_ceil(per_part));
    fn singles<const N: usize>(of: &[[f32; N]], size: usize, part: usize) -> Vec<u8> {
        chunk(of, size, part).as_flattened().iter().flat_map(|x| x.to_le_bytes()).collect()
    }
    let part = |part: usize| proto::SurfaceTopology {
        topology,
        vertices: vertices as u32,
        triangles: chunk(&display.triangles, TRIANGLES_PER_PART, part)
            .as_flattened()
            .iter()
            .flat_map(|v| v.to_le_bytes())
            .collect(),
        rest_positions: singles(&display.rest, per_part, part),
        part: part as u32,
        parts: parts as u32,
        step: grid_step(&display.rest, &display.triangles),
        organs: if part == 0 { organs(body, &display.organs) } else { Vec::new() },
        normals: singles(&display.normals, per_part, part),
        uvs: singles(&display.uvs, per_part, part),
        materials: if part == 0 { display.looks.iter().map(material).collect() } else { Vec::new() },
    };
    (0..parts).map(part).collect()
}

fn material(look: &Look) -> proto::SurfaceMaterial {
    proto::SurfaceMaterial {
        name: look.name.clone(),
        triangles: look.triangles as u32,
        colour: look.colour.map_or_else(Vec::new, Vec::from),
        picture: look.picture.map_or(0, |picture| picture as u32 + 1),
    }
}

/// The pictures on the surface `topology`, in parts.
pub fn pictures(display: &Display, topology: u32) -> Vec<proto::SurfacePicture> {
    let parts = |(number, picture): (u32, &Picture)| {
        let chunks = picture.bytes.chunks(PICTURE_BYTES_PER_PART);
        let (parts, media_type) = (chunks.len() as u32, picture.media_type);
        let part = |(part, content): (u32, &[u8])| proto::SurfacePicture {
            topology,
            picture: number,
            media_type: media_type.into(),
            content: content.into(),
            part,
            parts,
        };
        (0..).zip(chunks).map(part).collect::<Vec<_>>()
    };
    (1..).zip(&display.pictures).flat_map(parts).collect()
}

fn chunk<T>(of: &[T], size: usize, part: usize) -> &[T] {
    of.chunks(size).nth(part).unwrap_or_default()
}

/// Vertices [m] of a frame, given its parts and those of its key frame; `None` where some are missing or not of `display`.
pub fn vertices(display: &Display, key: &[proto::SurfaceFrame], frame: &[proto::SurfaceFrame]) -> Option<Vec<Vec3>> {
    let code = code(display);
    let read = |parts: &[proto::SurfaceFrame], reference: &[GridPoint]| {
        let mut points = reference.to_vec();
        for part in 0..code.parts() {
            let of = parts.iter().find(|frame| frame.part as usize == part)?;
            code.decode(part, reference, &of.displacements, &mut points).ok()?;
        }
        Some(points)
    };
    let mut points = read(key, code.rest())?;
    if frame.first()?.sequence != frame.first()?.key {
        points = read(frame, &points)?;
    }
    Some(points.into_iter().map(|point| Vec3::from(code.position(point).map(Real::from))).collect())
}

/// Places of all vertices of `display` [m] in a `frame`, with the dents of what touches them.
pub fn shown(display: &Display, frame: &Frame) -> Vec<Vec3> {
    let mut vertices = display.positions(&frame.skin).into_owned();
    deepen(&mut vertices, &display.triangles, &frame.dents);
    vertices
}

fn code(display: &Display) -> SurfaceCode {
    SurfaceCode::new(&display.triangles, &display.rest, grid_step(&display.rest, &display.triangles))
        .unwrap_or_else(|| unreachable!("triangles name vertices of their surface"))
}

/// A coordinate is off by half of this part of the surface's diagonal at most: 0.03 mm on an organ of 0.25 m.
const OF_DIAGONAL: Real = 1.0 / 4096.0;
/// Steps are no shorter than this part of the diagonal, whatever the triangles: the grid has to reach far.
const FINEST: Real = 1.0 / (1 << 20) as Real;
/// Most that the grid tilts the normal of a vertex at rest if all errors conspire [rad]: on bodies that move, normals are
/// then off by less than 1°, but where the surface is crushed. Half the step takes half a byte a vertex more.
const MOST_TILT: Real = 1.4 * std::f64::consts::PI / 180.0;

/// Step of the grid on which frames of a surface stand [m].
///
/// The normal of a vertex is the sum N of its triangles' area vectors. Neighbours that are off by δ change it by at most
/// δ P, P the sum of the edges opposite to the vertex; and δ is at most √3/2 steps.
pub fn grid_step(rest: &[[f32; 3]], triangles: &[[u32; 3]]) -> Real {
    let place = |v: u32| Vec3::from(rest[v as usize].map(Real::from));
    let Bounds { low, high } = Bounds::of((0..rest.len() as u32).map(place));
    let diagonal = (high - low).norm();
    let mut ring = vec![(Vec3::zeros(), 0.0); rest.len()];
    for t in triangles {
        let corner = t.map(place);
        let area = (corner[1] - corner[0]).cross(&(corner[2] - corner[0])) * 0.5;
        for c in 0..3 {
            let (normal, around) = &mut ring[t[c] as usize];
            *normal += area;
            *around += (corner[(c + 1) % 3] - corner[(c + 2) % 3]).norm();
        }
    }
    let breadth = ring.iter().filter(|r| r.1 > 0.0).map(|(normal, around)| normal.norm() / around);
    let finest_needed = breadth.fold(Real::INFINITY, Real::min) * MOST_TILT / (0.5 * (3.0 as Real).sqrt());
    finest_needed.clamp(diagonal * FINEST, diagonal * OF_DIAGONAL)
}

impl SurfaceEncoder {
    /// For frames of what `display` shows; they carry the number `topology`.
    pub fn new(display: Arc<Display>, topology: u32) -> Self {
        let code = code(&display);
        let (key, now) = ((0, code.rest().to_vec()), code.rest().to_vec());
        Self { topology, display, code, sequence: 0, key, now }
    }

    /// The `frame` in parts, with all obstacles and those tools that somebody holds. Every [`KEY_INTERVAL`]-th, and the first, is
    /// a key frame.
    ///
    /// # Errors
    /// [`CodeError::Compression`] when there is no memory.
    pub fn frame(&mut self, frame: &Frame) -> Result<Vec<proto::SurfaceFrame>, CodeError> {
        let Frame { tick, levels, tools, obstacles, .. } = frame;
        let sequence = self.sequence;
        self.sequence += 1;
        let (shown, levels) = (shown(&self.display, frame), self.display.levels(levels));
        self.now.iter_mut().zip(shown.iter()).for_each(|(to, x)| *to = self.code.on_grid([x.x, x.y, x.z]));
        let is_key = sequence.is_multiple_of(KEY_INTERVAL);
        let reference = if is_key { self.code.rest() } else { &self.key.1[..] };
        let held = tools.iter().enumerate().filter(|(_, t)| t.phase != Phase::Detached);
        let mut held: Vec<_> = held.map(|(i, t)| tool_state(i as u32, t)).collect();
        let mut obstacles: Vec<_> = obstacles.iter().map(obstacle_state).collect();
        let frame = |part: usize| {
            Ok(proto::SurfaceFrame {
                topology: self.topology,
                tick: *tick,
                sequence,
                tools: std::mem::take(&mut held),
                obstacles: std::mem::take(&mut obstacles),
                key: if is_key { sequence } else { self.key.0 },
                part: part as u32,
                displacements: self.code.encode(part, reference, &self.now)?,
                levels: self.code.encode_levels(part, &levels)?,
            })
        };
        let frames = (0..self.code.parts()).map(frame).collect::<Result<Vec<_>, CodeError>>()?;
        if is_key {
            self.key.0 = sequence;
            self.key.1.copy_from_slice(&self.now);
        }
        Ok(frames)
    }
}
