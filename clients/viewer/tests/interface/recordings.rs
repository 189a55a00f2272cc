//! Recordings, whole and not.

use crate::pressed_ball::{TICKS, height, record, record_ball};
use palpate_viewer::source::{Frame, Recording};

#[test]
fn any_time_of_a_recording_is_found_and_lies_between_its_frames() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("ball.mcap");
    record(&path, 40);
    let mut recording = Recording::open(&path).unwrap();
    assert_eq!(recording.frames().len(), 40);
    assert_eq!(recording.cut(), None);
    assert_eq!(recording.frames()[7].tick, 8 * TICKS);
    assert!((recording.frames()[7].forces[0] - 0.4).abs() < 1e-6);
    assert!((recording.duration() - 39.0 * 0.032).abs() < 1e-9);
    // Forwards, backwards, between two frames, before the first and after the last.
    for (seconds, frame) in [(1.0, 32.25), (0.016, 1.5), (0.0, 1.0), (0.32, 11.0), (-1.0, 1.0), (99.0, 40.0)] {
        let moment = recording.at(seconds).unwrap();
        let expected = height(0) + frame * (height(1) - height(0));
        assert!((moment.positions[0][2] - expected).abs() < 1e-6, "{seconds} s: {:?}", moment.positions[0]);
        assert!((moment.tools[0].force[2] - 0.05 * frame).abs() < 1e-5);
        assert!((moment.obstacles[0].position[2] + expected).abs() < 1e-6);
    }
    let subject = recording.subject();
    assert_eq!((subject.name.as_str(), subject.levels, subject.made_by.as_str()), ("ball", 2, "palpate 7"));
    assert_eq!(subject.obstacles[0].name, "floor");
    assert_eq!((subject.tools[0].shape.as_str(), subject.tools[0].radius), ("capsule", 0.01));
}

#[test]
fn a_recording_cut_anywhere_gives_what_is_before_the_cut_or_says_what_is_wrong() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("cut.mcap");
    // Of 762 vertices, a message a frame; of 4,902, two.
    for (rings, step) in [(20, 499), (50, 1999)] {
        record_ball(&path, rings, 40);
        let whole = std::fs::read(&path).unwrap();
        let mut most = 0;
        for length in (0..whole.len()).step_by(step) {
            std::fs::write(&path, &whole[..length]).unwrap();
            match Recording::open(&path) {
                Ok(mut recording) => {
                    let frames = recording.frames().len();
                    assert!(recording.cut().is_some() || frames == 40, "{frames} frames of {length} bytes");
                    let tip = recording.at(1e9).unwrap().positions[0][2];
                    assert!((tip - height(frames as u64)).abs() < 1e-6, "{tip} in frame {frames}");
                    most = most.max(frames);
                }
                Err(e) => assert!(e.to_string().contains("cut.mcap"), "{e}"),
            }
        }
        assert!(most > 30, "{most}");
    }
}

#[test]
fn what_is_no_recording_is_named_with_a_remedy() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("x.mcap");
    let said = |bytes: &[u8]| {
        std::fs::write(&path, bytes).unwrap();
        Recording::open(&path).err().unwrap().to_string()
    };
    assert!(said(b"solid cube, not a recording").contains("palpate demo --record"));
    assert!(said(b"").contains("x.mcap"));
    record(&path, 0);
    let said = Recording::open(&path).err().unwrap().to_string();
    assert!(said.contains("no surface frame"), "{said}");
}

#[test]
fn damaged_bytes_give_an_error_or_a_recording_and_no_panic() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("bits.mcap");
    record(&path, 3);
    let whole = std::fs::read(&path).unwrap();
    for at in (0..whole.len()).step_by(whole.len() / 500) {
        let mut bytes = whole.clone();
        bytes[at] ^= 0x81;
        std::fs::write(&path, &bytes).unwrap();
        if let Ok(mut recording) = Recording::open(&path) {
            let _ = recording.at(0.05);
        }
    }
}

#[test]
fn frames_are_listed_with_their_time_and_their_forces() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("ball.mcap");
    record(&path, 2);
    let recording = Recording::open(&path).unwrap();
    assert_eq!(recording.frames()[0], Frame { tick: 32, forces: vec![0.05] });
}
