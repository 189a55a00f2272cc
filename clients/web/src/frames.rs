//! Parts of frames to whole frames, ready to be sent.

use std::sync::Arc;

use axum::body::Bytes;
use palpate_sdk::SurfaceFrame;

use crate::message;

/// All parts of a frame, as messages.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Whole {
    pub sequence: u64,
    /// Sequence of its key frame; its own: it is one.
    pub key: u64,
    pub parts: Vec<Bytes>,
}

/// The newest frame, and the key frame without which nobody can read it.
#[derive(Clone, Debug, Default)]
pub(crate) struct Newest {
    pub key: Option<Arc<Whole>>,
    pub frame: Option<Arc<Whole>>,
}

/// Puts the frames of one surface together. What is not whole when the next frame begins is lost.
pub(crate) struct Assembler {
    topology: u32,
    sequence: u64,
    /// (parts) of the frame under way.
    parts: Vec<Option<Bytes>>,
    newest: Newest,
}

impl Assembler {
    /// For frames of the surface `topology`, which come in `parts`.
    pub fn new(topology: u32, parts: usize) -> Self {
        Self { topology, sequence: 0, parts: vec![None; parts], newest: Newest::default() }
    }

    /// Takes a part; gives the newest frames where that changes them.
    pub fn take(&mut self, frame: &SurfaceFrame) -> Option<Newest> {
        if frame.topology != self.topology || frame.part as usize >= self.parts.len() {
            return None;
        }
        if frame.sequence != self.sequence {
            self.parts.fill(None);
            self.sequence = frame.sequence;
        }
        self.parts[frame.part as usize] = Some(message::to_page(message::SURFACE_FRAME, frame));
        let parts: Vec<Bytes> = self.parts.iter().flatten().cloned().collect();
        if parts.len() < self.parts.len() {
            return None;
        }
        let whole = Arc::new(Whole { sequence: frame.sequence, key: frame.key, parts });
        let newer = |than: &Option<Arc<Whole>>| than.as_ref().is_none_or(|than| whole.sequence > than.sequence);
        if whole.key == whole.sequence && newer(&self.newest.key) {
            self.newest.key = Some(whole.clone());
        }
        let readable = self.newest.key.as_ref().is_some_and(|key| key.sequence == whole.key);
        if !readable || !newer(&self.newest.frame) {
            return None;
        }
        self.newest.frame = Some(whole);
        Some(self.newest.clone())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn part(sequence: u64, key: u64, part: u32) -> SurfaceFrame {
        SurfaceFrame { topology: 7, sequence, key, part, ..Default::default() }
    }

    /// Sequences of key frame and frame after `parts` have come.
    fn after(parts: &[SurfaceFrame]) -> (Option<u64>, Option<u64>) {
        let mut assembler = Assembler::new(7, 2);
        parts.iter().for_each(|part| drop(assembler.take(part)));
        let sequence = |of: &Option<Arc<Whole>>| of.as_ref().map(|whole| whole.sequence);
        (sequence(&assembler.newest.key), sequence(&assembler.newest.frame))
    }

    #[test]
    fn a_frame_is_shown_when_it_is_whole_and_its_key_frame_is_there() {
        assert_eq!(after(&[part(16, 16, 0)]), (None, None));
        assert_eq!(after(&[part(16, 16, 1), part(16, 16, 0)]), (Some(16), Some(16)));
        assert_eq!(after(&[part(17, 16, 0), part(17, 16, 1)]), (None, None));
        let key = [part(16, 16, 0), part(16, 16, 1)];
        let with = |more: &[SurfaceFrame]| after(&[&key[..], more].concat());
        assert_eq!(with(&[part(17, 16, 0), part(17, 16, 1)]), (Some(16), Some(17)));
        assert_eq!(with(&[part(17, 16, 0), part(18, 16, 1)]), (Some(16), Some(16)), "halves of two frames");
        assert_eq!(with(&[part(33, 32, 0), part(33, 32, 1)]), (Some(16), Some(16)), "its key frame was lost");
        assert_eq!(with(&[part(0, 0, 0), part(0, 0, 1)]), (Some(16), Some(16)), "older");
    }

    #[test]
    fn what_belongs_to_another_surface_is_left_out() {
        let mut assembler = Assembler::new(7, 1);
        assert!(assembler.take(&SurfaceFrame { topology: 8, ..part(1, 1, 0) }).is_none());
        assert!(assembler.take(&part(1, 1, 1)).is_none());
        assert!(assembler.take(&part(1, 1, 0)).is_some());
    }
}
