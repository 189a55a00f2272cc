//! Pictures of real recordings and of a real server, drawn without a display and looked at region by region.
#![cfg(feature = "viewer")]

use assert_cmd::Command;
use palpate_viewer::app::App;
use palpate_viewer::colour::Colouring;
use palpate_viewer::snapshot::{Photographer, Snapshot};
use palpate_viewer::source::Recording;
use std::path::{Path, PathBuf};
use std::sync::LazyLock;

/// The clamped cube, weightless, pressed from above: made once for all tests.
static PRESSED: LazyLock<(tempfile::TempDir, PathBuf)> = LazyLock::new(|| {
    let folder = tempfile::tempdir().unwrap();
    let recording = folder.path().join("press.mcap");
    let trajectory = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/trajectories/press.csv");
    Command::new(env!("CARGO_BIN_EXE_palpate"))
        .args(["simulate", "cube", "--seconds", "3.2", "--trajectory", trajectory.to_str().unwrap()])
        .args(["--set", "world.gravity=[0.0, 0.0, 0.0]"])
        .args(["--out", folder.path().join("out").to_str().unwrap(), "--record", recording.to_str().unwrap()])
        .assert()
        .success();
    (folder, recording)
});

/// When the ball of [`PRESSED`] is deepest [s].
const DEEPEST: f64 = 2.6;

fn palpate(arguments: &[&str]) -> assert_cmd::assert::Assert {
    Command::new(env!("CARGO_BIN_EXE_palpate")).args(arguments).timeout(std::time::Duration::from_secs(60)).assert()
}

fn picture(time: f64, change: impl FnOnce(&mut App)) -> Snapshot {
    let mut app = App::recording(Recording::open(&PRESSED.1).unwrap()).unwrap();
    (app.paused, app.time, app.panels) = (true, time, false);
    change(&mut app);
    app.advance(0.0).unwrap();
    Photographer::new().unwrap().take(&mut app, 640, 480).unwrap()
}

/// The part of `region` for which `holds`.
fn part(region: impl Iterator<Item = [u8; 3]>, holds: impl Fn([u8; 3]) -> bool) -> f32 {
    let (held, all) = region.fold((0, 0), |(held, all), pixel| (held + u32::from(holds(pixel)), all + 1));
    held as f32 / all as f32
}

/// Mean red, green and blue.
fn mean(region: impl Iterator<Item = [u8; 3]>) -> [f32; 3] {
    let (sum, all) =
        region.fold(([0.0; 3], 0.0), |(sum, all), p| ([0, 1, 2].map(|c| sum[c] + f32::from(p[c])), all + 1.0));
    sum.map(|sum| sum / all)
}

fn all(picture: &Snapshot) -> impl Iterator<Item = [u8; 3]> + '_ {
    picture.pixels.iter().copied()
}

/// Tissue: clearly more red than green and blue.
fn is_tissue([r, g, b]: [u8; 3]) -> bool {
    i32::from(r) > i32::from(g) + 40 && i32::from(r) > i32::from(b) + 40
}

/// The force's arrow and its number.
fn is_force([r, g, b]: [u8; 3]) -> bool {
    i32::from(b) > i32::from(r) + 60 && i32::from(b) > i32::from(g) + 30
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
fn strain_and_displacement_colour_what_was_moved() {
    for colouring in [Colouring::Strain, Colouring::Displacement] {
        let rest = picture(0.0, |app| app.colouring = colouring);
        let pressed = picture(DEEPEST, |app| app.colouring = colouring);
        // The scale goes from pale yellow to red: more red than blue is more of what is shown.
        let warmth = |picture: &Snapshot| {
            let [red, _, blue] = mean(picture.region(0.32, 0.35, 0.7, 0.75));
            red - blue
        };
        assert!((0.0..60.0).contains(&warmth(&rest)), "{colouring:?} at rest: {}", warmth(&rest));
        let more = warmth(&pressed) - warmth(&rest);
        assert!(more > 8.0, "{colouring:?}: {more}");
    }
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

/// A display of its own: a virtual X server, whose picture is a file.
struct Display {
    server: std::process::Child,
    name: String,
    folder: tempfile::TempDir,
}

impl Display {
    fn open() -> Self {
        use std::io::{BufRead, BufReader};
        let folder = tempfile::tempdir().unwrap();
        let mut server = std::process::Command::new("Xvfb")
            .args(["-displayfd", "1", "-screen", "0", "1280x800x24", "-nolisten", "tcp", "-fbdir"])
            .arg(folder.path())
            .stdout(std::process::Stdio::piped())
            .stderr(std::process::Stdio::null())
            .spawn()
            .expect("Xvfb: `apt-get install xvfb libgl1 libgl1-mesa-dri libxcursor1 libxi6 libxrandr2`");
        let mut number = String::new();
        BufReader::new(server.stdout.as_mut().unwrap()).read_line(&mut number).unwrap();
        Self { server, name: format!(":{}", number.trim()), folder }
    }

    /// What the display shows now: an X window dump of 32 bits a pixel.
    fn picture(&self) -> Snapshot {
        let dump = std::fs::read(self.folder.path().join("Xvfb_screen0")).unwrap();
        let word = |at: usize| u32::from_be_bytes(dump[4 * at..4 * at + 4].try_into().unwrap());
        let (width, height, row) = (word(4), word(5), word(12));
        let pixels = &dump[(word(0) + 12 * word(19)) as usize..];
        let rows = pixels.chunks(row as usize).take(height as usize);
        let pixels = rows.flat_map(|row| row[..4 * width as usize].as_chunks::<4>().0).map(|[b, g, r, _]| [*r, *g, *b]);
        Snapshot { width, height, pixels: pixels.collect() }
    }
}

impl Drop for Display {
    fn drop(&mut self) {
        let _ = self.server.kill();
        let _ = self.server.wait();
    }
}

#[test]
fn a_window_shows_what_a_picture_shows_and_closes_by_itself() {
    let display = Display::open();
    let mut viewer = std::process::Command::new(env!("CARGO_BIN_EXE_palpate"))
        .args(["view", PRESSED.1.to_str().unwrap(), "--colour", "displacement", "--seconds", "6"])
        .env("DISPLAY", &display.name)
        .env_remove("WAYLAND_DISPLAY")
        .spawn()
        .unwrap();
    let began = std::time::Instant::now();
    let shown = loop {
        let picture = display.picture();
        // Pale, then red: the scale of displacement; and the panels' paper.
        let body = part(all(&picture), |[r, g, b]| r > 150 && i32::from(r) > i32::from(b) + 30 && g > 60);
        let paper = part(all(&picture), |pixel| pixel.iter().all(|c| *c > 240));
        if body > 0.05 && paper > 0.1 {
            break true;
        }
        if viewer.try_wait().unwrap().is_some() || began.elapsed().as_secs() > 30 {
            break false;
        }
        std::thread::sleep(std::time::Duration::from_millis(200));
    };
    assert!(shown, "the window never showed the body and its panels");
    assert!(viewer.wait().unwrap().success());
}
