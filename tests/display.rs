//! A surface of one's own to look at: it moves with the one that is touched, and moves nothing.

#[path = "common/textured_cube.rs"]
mod textured_cube;

use palpate::display::Display;
use palpate::recording::{Recording, RecordingWriter, replay};
use palpate::scene::LoadedScene;
use palpate::wire::surface::{SurfaceEncoder, grid_step, pictures, shown, topology};
use palpate_core::contact::dent::deepen;
use palpate_core::contact::tool::{Coupling, PoseSample, ToolEvent};
use palpate_core::geometry::Surface as Touched;
use palpate_core::math::{Pose, Vec3, to_parry};
use palpate_core::model::Body;
use palpate_core::model::element_kernel::Simd;
use palpate_core::simulation::{Inputs, Outputs, Simulation};
use palpate_proto::Message;
use palpate_proto::surface::MOST_MESSAGE_BYTES;
use palpate_sdk::{Picture, Surface, SurfaceDecoder};
use parry3d_f64::query::PointQuery;
use std::path::Path;
use std::sync::Arc;
use textured_cube::{STANDS_OFF, textured_cube};

fn load(scene: &Path, overrides: &[&str]) -> (LoadedScene, Arc<Body>) {
    let overrides: Vec<String> = overrides.iter().map(|s| (*s).to_owned()).collect();
    let loaded = LoadedScene::load(scene, &overrides).unwrap();
    let body = Arc::new(loaded.build(&mut |_, _, _| {}).unwrap());
    (loaded, body)
}

/// The ball, pressed 10 mm into the middle of the top within 0.4 s.
fn press(tick: u64) -> Inputs {
    let mut inputs = Inputs::default();
    let depth = 0.012 * (tick as f64 / 400.0).min(1.0);
    let pose = Pose { position: Vec3::new(0.05, 0.05, 0.122 - depth), ..Pose::default() };
    inputs.tools[0] = Some(match tick {
        0 => ToolEvent::Attach { epoch: 1, period_ticks: 1, coupling: Coupling::RIGID },
        _ => ToolEvent::Pose(PoseSample { sequence: tick as u32, time_ns: 0, pose, buttons: 0, opening: 0.0 }),
    });
    inputs
}

fn run(loaded: &LoadedScene, body: &Arc<Body>, mut each: impl FnMut(&Inputs, &Outputs)) -> u64 {
    let start = loaded.scene.at_rest(body);
    let mut simulation = Simulation::new(body.clone(), loaded.scene.settings(), start).unwrap();
    for tick in 0..640 {
        let inputs = press(tick);
        each(&inputs, simulation.advance(&inputs));
    }
    simulation.hash()
}

#[test]
fn what_is_shown_changes_no_force_and_no_state() {
    let folder = tempfile::tempdir().unwrap();
    let scene = textured_cube(folder.path(), 30);
    let plain = folder.path().join("plain.toml");
    let text = std::fs::read_to_string(&scene).unwrap();
    let without: String =
        text.lines().filter(|line| !line.starts_with("display")).map(|line| format!("{line}\n")).collect();
    std::fs::write(&plain, without).unwrap();
    let ran = |scene: &Path| {
        let (loaded, body) = load(scene, &[]);
        let mut forces = Vec::new();
        let hash = run(&loaded, &body, |_, o| forces.push(o.tools[0].state));
        (loaded.scene.shown_counts(&body), body.checksum(), forces, hash)
    };
    let (shown, touched) = (ran(&scene), ran(&plain));
    assert!(shown.0 != touched.0, "another surface is shown");
    assert!(shown.2.iter().any(|tool| tool.physical_force.z > 0.1), "it is touched");
    assert_eq!((shown.1, shown.2, shown.3), (touched.1, touched.2, touched.3));
}

#[test]
fn it_arrives_whole_and_follows_the_touched_surface_into_the_dent() {
    let folder = tempfile::tempdir().unwrap();
    let (loaded, body) = load(&textured_cube(folder.path(), 30), &[]);
    let display = Arc::new(loaded.scene.display(&body).unwrap());
    let (parts, of_pictures) = (topology(&body, &display, 7), pictures(&display, 7));
    assert!(parts.iter().all(|part| part.encoded_len() <= MOST_MESSAGE_BYTES));
    assert!(of_pictures.iter().all(|part| part.encoded_len() <= MOST_MESSAGE_BYTES));
    let surface = Surface::from_parts(parts).unwrap();
    let vertices = surface.rest_positions.len();
    assert!(vertices > 5_000 && surface.uvs.len() == vertices && surface.normals.len() == vertices);
    let materials: Vec<_> = surface.materials.iter().map(|m| (m.name.as_str(), m.triangles, m.picture)).collect();
    assert_eq!(materials, [("top", 1_800, Some(1)), ("sides", 9_000, None)]);
    let picture = Picture::from_parts(of_pictures, 7).unwrap();
    assert_eq!(picture[0].bytes, std::fs::read(folder.path().join("top.png")).unwrap());
    assert_eq!(surface.organs[0].vertices as usize, vertices);

    let mut encoder = SurfaceEncoder::new(display.clone(), 7);
    let mut decoder = SurfaceDecoder::new(Arc::new(surface));
    let (mut farthest, mut nearest, mut sunk, mut dent, mut arrives) = (0.0, f64::INFINITY, 0.0, 0.0, 0.0);
    let step = grid_step(&display.rest, &display.triangles);
    run(&loaded, &body, |_, outputs| {
        if !outputs.frame {
            return;
        }
        let frame = encoder.frame(&outputs.into()).unwrap();
        assert!(frame.iter().all(|part| part.encoded_len() <= MOST_MESSAGE_BYTES));
        let moment = frame.iter().filter_map(|part| decoder.receive(part).unwrap()).last().unwrap();
        assert_eq!(moment.levels.len(), vertices);
        let touched =
            Touched { vertices: outputs.skin.clone(), triangles: body.surface().triangles.clone() }.to_trimesh();
        let placed = display.positions(&outputs.skin);
        let shown = shown(&display, &outputs.into());
        for (i, (now, rest)) in moment.positions.iter().zip(&decoder.surface().rest_positions).enumerate() {
            let off = touched.distance_to_local_point(to_parry(placed[i]), false);
            (nearest, farthest) = (f64::min(nearest, off), f64::max(farthest, off));
            arrives = f64::max(arrives, (Vec3::from(now.map(f64::from)) - shown[i]).norm());
            sunk = f64::max(sunk, f64::from(rest[2] - now[2]));
        }
        // What the mesh leaves out of the dent is added to both alike.
        let mut vertices = outputs.skin.clone();
        deepen(&mut vertices, &body.surface().triangles, &outputs.dents);
        let fall = |(now, rest): (&Vec3, &Vec3)| rest.z - now.z;
        dent = vertices.iter().zip(&body.surface().vertices).map(fall).fold(dent, f64::max);
    });
    println!("{:.3} to {:.3} mm off, {:.2} mm deep of {:.2}", 1e3 * nearest, 1e3 * farthest, 1e3 * sunk, 1e3 * dent);
    assert!(arrives < 0.87 * step, "{arrives} m of grid steps of {step} m");
    // Where the surface bends by less than it stands off; at the edges along the diagonal.
    assert!(nearest > 0.6 * STANDS_OFF && farthest < 1.2 * 3f64.sqrt() * STANDS_OFF);
    assert!(dent > 5e-3 && (sunk / dent - 1.0).abs() < 0.03);
}

#[test]
fn a_recording_of_it_replays_identical() {
    let folder = tempfile::tempdir().unwrap();
    let (loaded, body) = load(&textured_cube(folder.path(), 12), &["body.active_level=1"]);
    let file = folder.path().join("shown.mcap");
    let start = loaded.scene.at_rest(&body);
    let mut writer = RecordingWriter::create(&file, &loaded.scene, &body, &start, &start.body).unwrap();
    run(&loaded, &body, |inputs, o| {
        writer.tick(o.tick, inputs, &o.tools, o.flags(), o.frame.then_some(o.hash)).unwrap();
        if o.frame {
            writer.frame(&o.into()).unwrap();
        }
    });
    writer.finish().unwrap();
    let recording = Recording::read(&file).unwrap();
    let report = replay(&recording, Simd::best()).unwrap();
    assert_eq!((report.difference, report.ticks), (None, 640));
    let shown = loaded.scene.display(&body).unwrap();
    assert_eq!((&recording.display.rest, &recording.display.triangles), (&shown.rest, &shown.triangles));
    // Read back, it hangs where it hung.
    let pressed: Vec<Vec3> = body.surface().vertices.iter().map(|v| Vec3::new(v.x, v.y, 0.9 * v.z)).collect();
    let pairs = recording
        .display
        .positions(&pressed)
        .iter()
        .zip(shown.positions(&pressed).iter())
        .map(|(a, b)| (a - b).norm())
        .fold(0.0, f64::max);
    // Where two triangles are equally close it may be the other: they differ in what is along and what across them.
    assert!(pairs < 0.3 * STANDS_OFF, "{pairs}");
}

#[test]
fn an_organ_without_one_shows_what_is_touched() {
    let folder = tempfile::tempdir().unwrap();
    let scene = textured_cube(folder.path(), 6);
    let text = std::fs::read_to_string(&scene).unwrap();
    let second = "[[organ]]\nname = \"second\"\nposition = [0.3, 0.0, 0.0]\n[organ.body]\nsource = \"box\"\n\
                  cells = [[3, 3, 3], [5, 5, 5], [8, 8, 8]]\n";
    std::fs::write(&scene, text.replace("[[tool]]", &format!("{second}[[tool]]"))).unwrap();
    let (loaded, body) = load(&scene, &[]);
    let display = loaded.scene.display(&body).unwrap();
    let surface = Surface::from_parts(topology(&body, &display, 1)).unwrap();
    assert_eq!(surface.organs[1].vertices as usize, body.organs()[1].vertices.len());
    let ranges: Vec<_> = surface.ranges().collect();
    let touched = &Display::touched(&body).rest[body.organs()[1].vertices.clone()];
    assert_eq!(&surface.rest_positions[ranges[1][0].clone()], touched);
    let moved: Vec<Vec3> = body.surface().vertices.iter().map(|v| v + Vec3::new(0.0, 0.01, 0.02 * v.x)).collect();
    assert_eq!(&display.positions(&moved)[ranges[1][0].clone()], &moved[body.organs()[1].vertices.clone()]);
    let looks: Vec<_> = surface.materials.iter().map(|m| (m.name.as_str(), m.colour.is_some())).collect();
    assert_eq!(looks, [("top", true), ("sides", true), ("second", false)]);
}

#[test]
fn a_surface_that_cannot_be_shown_is_refused_with_what_to_do() {
    let folder = tempfile::tempdir().unwrap();
    let scene = textured_cube(folder.path(), 4);
    let refused = |from: &str, to: &str| {
        let text = std::fs::read_to_string(&scene).unwrap();
        assert!(text.contains(from));
        let changed = folder.path().join("changed.toml");
        std::fs::write(&changed, text.replace(from, to)).unwrap();
        match LoadedScene::load(&changed, &[]) {
            Err(e) => e.to_string(),
            Ok(loaded) => loaded.scene.display(&loaded.build(&mut |_, _, _| {}).unwrap()).unwrap_err(),
        }
    };
    let e = refused("display_unit = \"mm\"", "display_unit = \"cm\"");
    assert!(e.contains("display_unit") && e.contains("cube"), "{e}");
    let e = refused("display_unit = \"mm\"\n", "");
    assert!(e.contains("changed.toml") && e.contains("give body.display_unit"), "{e}");
    let e = refused("cube.obj", "lost.glb");
    assert!(e.contains("body.display") && e.contains("lost.glb"), "{e}");
}
