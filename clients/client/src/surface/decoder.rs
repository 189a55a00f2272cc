//! Frames to moments.

use std::sync::Arc;

use palpate_proto::surface::{CodeError, GridPoint};
use palpate_proto::{ObstacleState, SurfaceFrame, ToolState};

use super::Surface;
use crate::ClientError;

/// The surface at one tick.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Moment {
    /// Number of its [`Surface`].
    pub topology: u32,
    /// Simulated time [ms].
    pub tick: u64,
    /// +1 with every frame of the server.
    pub sequence: u64,
    /// (vertices) [m].
    pub positions: Vec<[f32; 3]>,
    /// (vertices) level of detail that displays each, 0 the coarsest; empty where the stream has none.
    pub levels: Vec<u8>,
    /// Tools that somebody holds.
    pub tools: Vec<ToolState>,
    /// Obstacles, in the order of the session; empty before 1.10.
    pub obstacles: Vec<ObstacleState>,
}

/// Makes moments of the frames of one surface, which may come with gaps, as long as a frame's key frame came before it.
pub struct SurfaceDecoder {
    surface: Arc<Surface>,
    /// Sequence of the newest key frame of which each part has come (parts).
    key: Vec<Option<u64>>,
    key_points: Vec<GridPoint>,
    /// Which parts have come of the frame under way (parts).
    came: Vec<bool>,
    points: Vec<GridPoint>,
    levels: Vec<u8>,
    under_way: Moment,
}

impl SurfaceDecoder {
    /// For frames of `surface`.
    pub fn new(surface: Arc<Surface>) -> Self {
        let parts = surface.code.parts();
        let at_rest = surface.code.rest().to_vec();
        Self {
            key: vec![None; parts],
            key_points: at_rest.clone(),
            came: vec![false; parts],
            levels: vec![0; at_rest.len()],
            points: at_rest,
            under_way: Moment::default(),
            surface,
        }
    }

    /// The surface.
    pub fn surface(&self) -> &Arc<Surface> {
        &self.surface
    }

    /// Takes a frame, or a part of one; gives the moment that it completes. `None`: its key frame has not come, or not
    /// all of its parts have. Errors: [`ClientError::Undecodable`] when it is no frame of this surface.
    pub fn receive(&mut self, frame: &SurfaceFrame) -> Result<Option<Moment>, ClientError> {
        self.decode(frame).map_err(|reason| ClientError::Undecodable { message: "SurfaceFrame", reason })
    }

    fn decode(&mut self, frame: &SurfaceFrame) -> Result<Option<Moment>, String> {
        if frame.topology != self.surface.topology {
            return Err(format!("it is of surface {}, not of {}", frame.topology, self.surface.topology));
        }
        let words = |e: CodeError| e.to_string();
        let (code, part) = (&self.surface.code, frame.part as usize);
        let range = code.part(part).map_err(words)?;
        let is_key = frame.key == frame.sequence;
        if self.lacks_key(frame) {
            return Ok(None);
        }
        if is_key {
            code.decode(part, code.rest(), &frame.displacements, &mut self.key_points).map_err(words)?;
            self.key[part] = Some(frame.sequence);
        }
        if self.under_way.sequence != frame.sequence || self.under_way.tick != frame.tick {
            self.came.fill(false);
            (self.under_way.sequence, self.under_way.tick) = (frame.sequence, frame.tick);
        }
        if is_key {
            self.points[range.clone()].copy_from_slice(&self.key_points[range.clone()]);
        } else {
            code.decode(part, &self.key_points, &frame.displacements, &mut self.points).map_err(words)?;
        }
        let levelled = !frame.levels.is_empty();
        if levelled {
            code.decode_levels(part, &frame.levels, &mut self.levels).map_err(words)?;
        }
        self.came[part] = true;
        if part == 0 {
            self.under_way.tools.clone_from(&frame.tools);
            self.under_way.obstacles.clone_from(&frame.obstacles);
        }
        if !self.came.iter().all(|came| *came) {
            return Ok(None);
        }
        Ok(Some(Moment {
            topology: frame.topology,
            positions: self.points.iter().map(|point| code.position(*point)).collect(),
            levels: if levelled { self.levels.clone() } else { Vec::new() },
            ..self.under_way.clone()
        }))
    }

    /// True when the part of `frame` cannot be decoded before its key frame has come.
    pub fn lacks_key(&self, frame: &SurfaceFrame) -> bool {
        frame.key != frame.sequence && self.key.get(frame.part as usize) != Some(&Some(frame.key))
    }
}

#[cfg(test)]
mod tests {
    use super::super::tests::one_triangle;
    use super::*;
    use palpate_proto::surface::SurfaceCode;
    use proptest::prelude::*;

    fn decoder() -> SurfaceDecoder {
        SurfaceDecoder::new(Arc::new(Surface::from_parts(one_triangle()).unwrap()))
    }

    /// The triangle, risen by `sequence` steps, as a frame against the key frame `key`.
    fn frame(sequence: u64, key: u64) -> SurfaceFrame {
        let Surface { triangles, rest_positions, step, .. } = Surface::from_parts(one_triangle()).unwrap();
        let code = SurfaceCode::new(&triangles, &rest_positions, step).unwrap();
        let risen = |by: u64| code.rest().iter().map(|[x, y, z]| [*x, *y, z + by as i32]).collect::<Vec<_>>();
        let reference = if sequence == key { code.rest().to_vec() } else { risen(key) };
        SurfaceFrame {
            topology: 4,
            tick: 32 * sequence,
            sequence,
            key,
            displacements: code.encode(0, &reference, &risen(sequence)).unwrap(),
            levels: code.encode_levels(0, &[0, 1, 2]).unwrap(),
            tools: vec![ToolState::default()],
            obstacles: vec![ObstacleState { position: vec![0.0, 0.0, sequence as f32], force: vec![] }],
            ..Default::default()
        }
    }

    #[test]
    fn a_frame_needs_its_key_frame_and_nothing_else() {
        let mut decoder = decoder();
        assert_eq!(decoder.receive(&frame(5, 0)).unwrap(), None);
        assert_eq!(decoder.receive(&frame(16, 16)).unwrap().unwrap().sequence, 16);
        assert_eq!(decoder.receive(&frame(5, 0)).unwrap(), None);
        for sequence in [31, 18, 25, 16] {
            let moment = decoder.receive(&frame(sequence, 16)).unwrap().unwrap();
            assert_eq!((moment.tick, moment.sequence, moment.topology), (32 * sequence, sequence, 4));
            assert!((moment.positions[1][2] - 1e-4 * sequence as f32).abs() < 1e-6, "{:?}", moment.positions);
            assert_eq!((moment.levels, moment.tools.len()), (vec![0, 1, 2], 1));
            assert_eq!(moment.obstacles[0].position[2], sequence as f32);
        }
    }

    #[test]
    fn a_frame_that_comes_again_and_again_has_its_tools_once() {
        let mut decoder = decoder();
        for _ in 0..3 {
            assert_eq!(decoder.receive(&frame(16, 16)).unwrap().unwrap().tools.len(), 1);
        }
    }

    #[test]
    fn a_stream_without_levels_has_none() {
        let mut decoder = decoder();
        assert_eq!(decoder.receive(&frame(0, 0)).unwrap().unwrap().levels, [0, 1, 2]);
        let without = SurfaceFrame { levels: vec![], ..frame(1, 0) };
        assert!(decoder.receive(&without).unwrap().unwrap().levels.is_empty());
    }

    #[test]
    fn a_frame_of_another_surface_or_version_is_refused_with_the_reason() {
        let refused = |frame: SurfaceFrame| decoder().receive(&frame).unwrap_err().to_string();
        assert!(refused(SurfaceFrame { topology: 5, ..frame(0, 0) }).contains("of surface 5, not of 4"));
        assert!(refused(SurfaceFrame { part: 1, ..frame(0, 0) }).contains("part 1 of a surface in 1 parts"));
        // As a recording of version 1.0 has it: the positions are in a field that is no more.
        assert!(refused(SurfaceFrame { displacements: vec![], ..frame(0, 0) }).contains("0 bytes for a part of 36"));
    }

    proptest! {
        #[test]
        fn any_frame_gives_a_moment_of_this_surface_nothing_or_an_error(
            part in 0u32..3, sequence in 0u64..3, key in 0u64..3, tick in any::<u64>(),
            displacements in prop::collection::vec(any::<u8>(), 0..60), good in any::<bool>(),
            levels in prop::collection::vec(any::<u8>(), 0..20),
        ) {
            let mut decoder = decoder();
            decoder.receive(&frame(0, 0)).unwrap();
            let displacements = if good { frame(sequence, key).displacements } else { displacements };
            let any = SurfaceFrame { topology: 4, part, sequence, key, tick, displacements, levels, ..Default::default() };
            if let Ok(Some(moment)) = decoder.receive(&any) {
                prop_assert_eq!(moment.positions.len(), 3);
                prop_assert!(moment.levels.is_empty() || moment.levels.len() == 3);
            }
        }
    }
}
