//! What `palpate export` writes, read back and compared with the recording. `test_export.py` of the Python package does so
//! with the readers of others.

use assert_cmd::Command;
use palpate::recording::Recording;
use palpate_proto::{Message, foxglove::SceneUpdate};
use std::fs;
use std::path::{Path, PathBuf};

/// A cube pressed by a ball for two seconds, recorded in `folder`.
fn recorded(folder: &Path) -> PathBuf {
    let press = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/trajectories/press.csv");
    let mut simulate = Command::new(env!("CARGO_BIN_EXE_palpate"));
    simulate.args(["simulate", "cube", "--seconds", "2", "--set", "body.active_level=1", "--trajectory"]).arg(press);
    simulate.args(["--out", "run", "--record", "press.mcap"]).current_dir(folder).assert().success();
    folder.join("press.mcap")
}

fn export(folder: &Path, arguments: &[&str]) -> assert_cmd::assert::Assert {
    Command::new(env!("CARGO_BIN_EXE_palpate")).arg("export").args(arguments).current_dir(folder).assert()
}

#[test]
fn tables_series_and_scenes_say_what_was_recorded() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    let recording = Recording::read(&recorded(at)).unwrap();
    fs::write(at.join("press.csv"), "an older file").unwrap();
    let all = ["press.mcap", "--table", "press.csv", "--surface", "series", "--foxglove", "fox.mcap", "--every", "4"];
    let said = export(at, &all).success();
    let said = String::from_utf8_lossy(&said.get_output().stdout).into_owned();
    assert!(said.contains(&format!("press.csv: {} rows", recording.wrenches.len())), "{said}");

    let mut table = csv::Reader::from_path(at.join("press.csv")).unwrap();
    let header = table.headers().unwrap().clone();
    let rows: Vec<csv::StringRecord> = table.records().map(Result::unwrap).collect();
    assert_eq!(rows.len(), recording.wrenches.len());
    assert!(rows.len() > 900);
    let field = |row: &csv::StringRecord, name: &str| row[header.iter().position(|h| h == name).unwrap()].to_owned();
    let number = |row: &csv::StringRecord, name: &str| field(row, name).parse::<f64>().unwrap();
    for (row, ((tick, _), wrench)) in rows.iter().zip(&recording.wrenches) {
        assert_eq!(field(row, "time_s"), format!("{:.3}", *tick as f64 * 1e-3));
        assert_eq!(
            (field(row, "tool"), number(row, "contact_points") as u32),
            ("ball".to_owned(), wrench.contact_points)
        );
        for (axis, name) in ["force_x_N", "force_y_N", "force_z_N"].into_iter().enumerate() {
            assert_eq!(number(row, name), f64::from(wrench.force[axis]), "{name} at {tick}");
        }
    }
    let deepest = rows.iter().max_by(|a, b| number(a, "force_z_N").total_cmp(&number(b, "force_z_N"))).unwrap();
    assert!(number(deepest, "force_z_N") > 0.05 && field(deepest, "phase") == "engaged");
    // The simulated tool hangs back from the handle.
    assert!((number(deepest, "handle_z_m") - number(deepest, "z_m")).abs() < 0.01);

    let frames = recording.frames.len().div_ceil(4);
    let list = fs::read_to_string(at.join("series/surface.pvd")).unwrap();
    let listed: Vec<&str> = list.split("file=\"").skip(1).map(|rest| rest.split('"').next().unwrap()).collect();
    assert_eq!(listed.len(), frames);
    assert_eq!(fs::read_dir(at.join("series")).unwrap().count(), frames + 1);
    let last = fs::read_to_string(at.join("series").join(listed[frames - 1])).unwrap();
    let (vertices, triangles) = (recording.display.rest.len(), recording.display.triangles.len());
    assert!(last.contains(&format!("NumberOfPoints=\"{vertices}\" NumberOfCells=\"{triangles}\"")));
    let numbers = |name: &str| -> Vec<f64> {
        let array = last.split_once(&format!("Name=\"{name}\"")).unwrap().1.split_once('>').unwrap().1;
        array.split('<').next().unwrap().split_whitespace().map(|number| number.parse().unwrap()).collect()
    };
    assert_eq!((numbers("connectivity").len(), numbers("level").len()), (3 * triangles, vertices));
    assert_eq!(numbers("offsets").last(), Some(&(3.0 * triangles as f64)));
    let lowest = numbers("displacement_m").chunks(3).map(|u| u[2]).fold(0.0, f64::min);
    assert!(lowest < -0.002 && lowest > -0.05, "pressed in by {lowest} m");

    let bytes = fs::read(at.join("fox.mcap")).unwrap();
    let (mut scenes, mut wrenches, mut latest) = (0, 0, 0);
    for message in mcap::MessageStream::new(&bytes).unwrap().map(Result::unwrap) {
        match message.channel.topic.as_str() {
            "/surface" => {
                let scene = SceneUpdate::decode(&message.data[..]).unwrap();
                let triangles_of = &scene.entities[0].triangles[0];
                assert_eq!((triangles_of.points.len(), triangles_of.indices.len()), (vertices, 3 * triangles));
                scenes += 1;
            }
            "/tools" => {
                let scene = SceneUpdate::decode(&message.data[..]).unwrap();
                assert!(scene.entities.iter().all(|tool| tool.spheres[0].size.unwrap().x > 0.0));
            }
            "/wrench/ball" => wrenches += 1,
            other => panic!("{other}"),
        }
        assert!(message.log_time >= latest, "in the order of time");
        latest = message.log_time;
    }
    assert_eq!((scenes, wrenches), (frames, recording.wrenches.len()));
}

#[test]
fn exports_spare_the_recording_and_end_quietly_without_a_reader() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    let before = fs::read(recorded(at)).unwrap();
    fs::hard_link(at.join("press.mcap"), at.join("again.csv")).unwrap();
    fs::create_dir(at.join("series")).unwrap();
    fs::hard_link(at.join("press.mcap"), at.join("series/surface.pvd")).unwrap();
    for output in [["--table", "again.csv"], ["--foxglove", "press.mcap"], ["--surface", "series"]] {
        let refused = export(at, &[&["press.mcap"][..], &output].concat()).failure();
        let text = String::from_utf8_lossy(&refused.get_output().stderr).into_owned();
        assert!(text.contains("this is the file that is read") && text.contains("Remedy: "), "{text}");
    }
    let nothing = export(at, &["press.mcap"]).failure();
    assert!(String::from_utf8_lossy(&nothing.get_output().stderr).contains("--table"));
    assert!(fs::read(at.join("press.mcap")).unwrap() == before);
    // A pipe whose reading end is closed already.
    let mut program = std::process::Command::new(env!("CARGO_BIN_EXE_palpate"));
    program.args(["export", "press.mcap", "--table", "t.csv"]).current_dir(at).stdout(std::io::pipe().unwrap().1);
    assert!(program.status().unwrap().success() && at.join("t.csv").exists());
}
