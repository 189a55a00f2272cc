//! Pictures of a recording, drawn without a display.

use crate::look::{all, is_coarse, is_fine, is_force, is_second_tissue, is_tissue, mean, part};
use crate::textured_cube::textured_cube;
use assert_cmd::Command;
use palpate_viewer::app::App;
use palpate_viewer::colour::Colouring;
use palpate_viewer::snapshot::{Photographer, Snapshot};
use palpate_viewer::source::Recording;
use std::path::{Path, PathBuf};
use std::sync::LazyLock;

/// The clamped cube, weightless, pressed from above: made once for all tests.
pub static PRESSED: LazyLock<(tempfile::TempDir, PathBuf)> = LazyLock::new(|| press("3.2", &[]));

/// A recording of so many seconds of the cube.
fn press(seconds: &str, more: &[&str]) -> (tempfile::TempDir, PathBuf) {
    let folder = tempfile::tempdir().unwrap();
    let recording = folder.path().join("press.mcap");
    let trajectory = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/trajectories/press.csv");
    Command::new(env!("CARGO_BIN_EXE_palpate"))
        .args(["simulate", "cube", "--seconds", seconds, "--trajectory", trajectory.to_str().unwrap()])
        .args(["--set", "world.gravity=[0.0, 0.0, 0.0]"])
        // The finest level is to come with the press, not where the tool waits.
        .args(["--set", "resolution.reach=1.0"])
        .args(more)
        .args(["--out", folder.path().join("out").to_str().unwrap(), "--record", recording.to_str().unwrap()])
        .assert()
        .success();
    (folder, recording)
}

/// When the ball of [`PRESSED`] is deepest [s].
const DEEPEST: f64 = 2.6;

fn palpate(arguments: &[&str]) -> assert_cmd::assert::Assert {
    Command::new(env!("CARGO_BIN_EXE_palpate")).args(arguments).timeout(std::time::Duration::from_secs(180)).assert()
}

fn picture(time: f64, change: impl FnOnce(&mut App)) -> Snapshot {
    picture_of(&PRESSED.1, time, change)
}

fn picture_of(recording: &Path, time: f64, change: impl FnOnce(&mut App)) -> Snapshot {
    let mut app = App::recording(Recording::open(recording).unwrap()).unwrap();
    (app.paused, app.time, app.panels) = (true, time, false);
    change(&mut app);
    app.advance(0.0).unwrap();
    Photographer::new().unwrap().take(&mut app, 640, 480).unwrap()
}

#[test]
fn the_body_stands_in_the_middle_of_a_light_backdrop() {
    let rest = picture(0.0, |_| ());
    for (left, top) in [(0.0, 0.3), (0.93, 0.3), (0.93, 0.9)] {
        let corner = mean(rest.region(left, top, left + 0.06, top + 0.06));
        assert!(corner.iter().all(|channel| (180.0..250.0).contains(channel)), "{corner:?}");
    }
    let middle = mean(rest.region(0.45, 0.45, 0.55, 0.55)).map(|channel| channel as u8);
    assert!(is_tissue(middle), "{middle:?}");
    let tissue = part(all(&rest), is_tissue);
    assert!((0.12..0.6).contains(&tissue), "{tissue}");
    assert!(part(all(&rest), is_force) < 1e-4, "nobody touches it");
}

#[test]
fn a_press_shows_the_tool_the_dent_and_the_force() {
    let (rest, pressed) = (picture(0.0, |_| ()), picture(DEEPEST, |_| ()));
    let arrow = part(all(&pressed), is_force);
    assert!(arrow > 1e-3, "{arrow}");
    let changed = rest.pixels.iter().zip(&pressed.pixels).filter(|(a, b)| (0..3).any(|c| a[c].abs_diff(b[c]) > 12));
    let changed = changed.count() as f32 / rest.pixels.len() as f32;
    assert!((0.02..0.7).contains(&changed), "{changed}");
    // What is clamped below does not move.
    let foot = |picture: &Snapshot| mean(picture.region(0.3, 0.8, 0.7, 0.95));
    let moved = (0..3).map(|c| (foot(&rest)[c] - foot(&pressed)[c]).abs()).fold(0.0, f32::max);
    assert!(moved < 3.0, "{moved}");
}

#[test]
fn a_surface_of_ones_own_has_its_picture_on_it_unless_colours_mean_numbers() {
    let folder = tempfile::tempdir().unwrap();
    let scene = textured_cube(folder.path(), 16);
    let recording = folder.path().join("shown.mcap");
    palpate(&[
        "simulate",
        scene.to_str().unwrap(),
        "--seconds",
        "0.1",
        "--out",
        folder.path().join("out").to_str().unwrap(),
        "--record",
        recording.to_str().unwrap(),
    ])
    .success();
    let is_green = |[r, g, b]: [u8; 3]| g > 90 && i32::from(g) > i32::from(r) + 50 && i32::from(g) > i32::from(b) + 50;
    let is_yellow = |[r, g, b]: [u8; 3]| r > 110 && g > 100 && i32::from(b) < i32::from(g) - 50 && r.abs_diff(g) < 60;
    let shown = picture_of(&recording, 0.0, |_| ());
    let (green, yellow) = (part(all(&shown), is_green), part(all(&shown), is_yellow));
    assert!(green > 0.01 && yellow > 0.01, "{green} green, {yellow} yellow");
    // Colours that mean numbers cover it.
    let level = picture_of(&recording, 0.0, |app| app.colouring = Colouring::Strain);
    assert!(part(all(&level), is_green) < 1e-3);
}

#[test]
fn strain_and_displacement_colour_what_was_moved() {
    for colouring in [Colouring::Strain, Colouring::Displacement] {
        let rest = picture(0.0, |app| app.colouring = colouring);
        let pressed = picture(DEEPEST, |app| app.colouring = colouring);
        // The scale goes from pale yellow to red: much more red than blue is much of what is shown. The legend is elsewhere.
        let warm = |picture: &Snapshot| {
            part(picture.region(0.25, 0.2, 0.75, 0.8), |[red, _, blue]| red > blue.saturating_add(60))
        };
        let (before, after) = (warm(&rest), warm(&pressed));
        println!("{colouring:?}: {before} of the picture is warm at rest, {after} pressed");
        assert!(before < 1e-3 && (0.02..0.6).contains(&after), "{colouring:?}: {before}, {after}");
    }
}

#[test]
fn levels_of_detail_are_blue_where_they_are_coarse_and_yellow_under_the_tool() {
    let at = |time: f64| picture(time, |app| app.colouring = Colouring::Level);
    let (rest, pressed) = (at(0.0), at(DEEPEST));
    let of = |picture: &Snapshot, [left, top, right, bottom]: [f32; 4], holds: fn([u8; 3]) -> bool| {
        part(picture.region(left, top, right, bottom), holds)
    };
    let (crown, foot) = ([0.35, 0.2, 0.65, 0.45], [0.27, 0.6, 0.76, 0.87]);
    // The tool is near from the start: two levels of three.
    assert!(of(&rest, crown, is_fine) < 1e-3 && of(&rest, foot, is_coarse) > 0.3, "{}", of(&rest, foot, is_coarse));
    let (top, bottom) = (of(&pressed, crown, is_fine), of(&pressed, foot, is_coarse));
    println!("fine: {top} of the top; coarse: {bottom} of the foot");
    assert!(top > 0.1 && of(&pressed, foot, is_fine) < 0.01 && bottom > 0.02);
    // The legend has both.
    assert!(part(pressed.region(0.8, 0.9, 1.0, 1.0), is_fine) > 0.01);
}

#[test]
fn two_organs_are_told_apart_and_either_can_be_hidden() {
    let block = "organ=[{name=\"block\", position=[0.15, 0.02, 0.0], body={source=\"box\", size=[0.07, 0.06, 0.08], \
                 cells=[[3, 3, 3], [4, 4, 4], [6, 6, 6]]}, hold=[{min=[0, 0, 0], max=[0.07, 0.06, 0], exact=true}]}]";
    let (_folder, recording) = press("0.1", &["--set", block]);
    let shown = |hidden: [bool; 2]| {
        let picture = picture_of(&recording, 0.05, |app| app.hidden = hidden.into());
        let first = part(all(&picture), |pixel| is_tissue(pixel) && !is_second_tissue(pixel));
        (first, part(all(&picture), is_second_tissue))
    };
    let both = shown([false, false]);
    println!("{both:?} of the picture");
    assert!(both.0 > 0.05 && both.1 > 0.02, "{both:?}");
    let (first, second) = (shown([false, true]), shown([true, false]));
    assert!(first.0 > 0.95 * both.0 && first.1 < 0.1 * both.1, "{first:?}");
    assert!(second.1 > 0.95 * both.1 && second.0 < 0.1 * both.0, "{second:?}");
    // Levels are those of both, in the same colours.
    let levels = picture_of(&recording, 0.05, |app| app.colouring = Colouring::Level);
    assert!(part(all(&levels), is_coarse) > 0.9 * both.1);
}

/// Pixels in which two pictures differ, column by column.
fn changed_columns(a: &Snapshot, b: &Snapshot) -> Vec<usize> {
    let changed = |x: usize, y: usize| {
        let at = y * a.width as usize + x;
        (0..3).any(|c| a.pixels[at][c].abs_diff(b.pixels[at][c]) > 12)
    };
    (0..a.width as usize).map(|x| (0..a.height as usize).filter(|y| changed(x, *y)).count()).collect()
}

#[test]
fn convex_and_compound_tools_are_drawn_as_they_are_and_not_as_the_ball_that_holds_them() {
    let drawn = |tool: &str| {
        let (_folder, recording) = press("0.3", &["--set", &format!("tool=[{{name=\"tool\", {tool}}}]")]);
        picture_of(&recording, 0.2, |_| ())
    };
    let none = drawn("radius=0.0005");
    let columns = |tool: &str| changed_columns(&none, &drawn(tool));
    // All three are held by the same ball.
    let ball = columns("radius=0.025");
    let forceps = columns(
        "shape=\"compound\", part=[{radius=0.005, position=[-0.02, 0.0, 0.0]}, {radius=0.005, position=[0.02, 0.0, 0.0]}]",
    );
    let corners = [-0.02, 0.02].into_iter().flat_map(|x| {
        [-0.014, 0.014].into_iter().flat_map(move |y| [-0.002, 0.002].map(|z| format!("[{x}, {y}, {z}]")))
    });
    let corners: Vec<String> = corners.collect();
    let plate = columns(&format!("shape=\"convex\", points=[{}]", corners.join(", ")));
    let area = |columns: &[usize]| columns.iter().sum::<usize>();
    let [whole, two, flat] = [&ball, &forceps, &plate].map(|columns| area(columns));
    println!("{whole} pixels of a ball, {two} of two tips, {flat} of a plate");
    assert!(whole > 2000 && two > whole / 25 && two < whole / 5 && flat > whole / 5 && flat < whole / 2);
    // Between the tips the picture is as without a tool; the plate and the ball are whole.
    // What is compared with has a ball of half a millimetre.
    let runs = |columns: &[usize]| columns.windows(2).filter(|pair| pair[0] < 5 && pair[1] >= 5).count();
    assert_eq!([&ball, &forceps, &plate].map(|columns| runs(columns)), [1, 2, 1]);
}

#[test]
fn panels_leave_the_body_its_room_and_show_a_time_line() {
    let bare = picture(DEEPEST, |_| ());
    let panels = picture(DEEPEST, |app| app.panels = true);
    // The panel at the side is paper; so is the time line, but for its curve and its buttons.
    let side = mean(panels.region(0.7, 0.5, 0.99, 0.6));
    assert!(side.iter().all(|channel| *channel > 235.0), "{side:?}");
    assert!(mean(bare.region(0.7, 0.5, 0.99, 0.6))[0] < 235.0);
    let curve = part(panels.region(0.0, 0.9, 0.6, 1.0), is_force);
    assert!(curve > 2e-3, "the force's curve: {curve}");
    let tissue = part(all(&panels), is_tissue);
    assert!(tissue > 0.05, "the body is still there: {tissue}");
}

#[test]
fn the_command_line_writes_a_picture_of_the_size_that_was_asked_for() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("press.png");
    let (recording, file) = (PRESSED.1.to_str().unwrap(), file.to_str().unwrap());
    palpate(&["view", recording, "--snapshot", file, "--at", "2.8", "--size", "400x300", "--colour", "strain"])
        .success();
    let decoder = png::Decoder::new(std::io::BufReader::new(std::fs::File::open(file).unwrap()));
    let reader = decoder.read_info().unwrap();
    assert_eq!((reader.info().width, reader.info().height), (400, 300));

    let said =
        |arguments: &[&str]| String::from_utf8_lossy(&palpate(arguments).failure().get_output().stderr).into_owned();
    assert!(said(&["view", recording, "--snapshot", file, "--size", "4x3"]).contains("1280x800"));
    assert!(said(&["view", "nowhere.mcap", "--snapshot", file]).contains("nowhere.mcap"));
    let nobody = ["view", "--connect", "tcp/127.0.0.1:9", "--snapshot", file];
    assert!(said(&nobody).contains("tcp/127.0.0.1:9"));
}
