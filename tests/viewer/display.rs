//! Windows on a display.

use crate::look::{all, part};
use crate::pictures::PRESSED;
use palpate_viewer::snapshot::Snapshot;
use std::process::{Child, Command};
use std::time::{Duration, Instant};

/// A display of its own: a virtual X server, whose picture is a file.
pub struct Display {
    server: std::process::Child,
    /// As the environment names it.
    pub name: String,
    folder: tempfile::TempDir,
}

impl Display {
    /// Opens it, 1280 times 800 pixels.
    pub fn open() -> Self {
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
    pub fn picture(&self) -> Snapshot {
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

/// Waits until the display shows a pale or red body and the panels' paper; false when `viewer` ends before that.
fn shows_a_body(display: &Display, viewer: &mut Child) -> bool {
    let began = Instant::now();
    while began.elapsed() < Duration::from_secs(90) && viewer.try_wait().unwrap().is_none() {
        let picture = display.picture();
        let body = part(all(&picture), |[r, g, b]| r > 150 && i32::from(r) > i32::from(b) + 30 && g > 60);
        let paper = part(all(&picture), |pixel| pixel.iter().all(|c| *c > 240));
        if body > 0.04 && paper > 0.1 {
            return true;
        }
        std::thread::sleep(Duration::from_millis(200));
    }
    false
}

/// A process that ends with the test, however that ends.
struct Running(Child);

impl Drop for Running {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

fn palpate(display: Option<&Display>, arguments: &[&str]) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_palpate"));
    command.args(arguments).env_remove("DISPLAY").env_remove("WAYLAND_DISPLAY");
    if let Some(display) = display {
        command.env("DISPLAY", &display.name);
    }
    command
}

#[test]
fn a_window_shows_a_recording_and_closes_by_itself() {
    let display = Display::open();
    let recording = PRESSED.1.to_str().unwrap();
    let view = |seconds: &str| {
        let arguments = ["view", recording, "--colour", "displacement", "--seconds", seconds];
        Running(palpate(Some(&display), &arguments).spawn().unwrap())
    };
    // As long as it takes on a busy machine.
    assert!(shows_a_body(&display, &mut view("120").0), "the window never showed the body and its panels");
    assert!(view("1").0.wait().unwrap().success());
}

#[test]
fn a_display_that_cannot_be_reached_is_an_error_with_a_remedy() {
    let recording = PRESSED.1.to_str().unwrap();
    for display in [None, Some(":4711")] {
        let mut command = palpate(None, &["view", recording]);
        if let Some(name) = display {
            command.env("DISPLAY", name);
        }
        let outcome = command.output().unwrap();
        let said = String::from_utf8_lossy(&outcome.stderr).into_owned();
        assert!(!outcome.status.success() && said.contains("--snapshot"), "{display:?}: {said}");
    }
}

/// The processes that `parent` has started.
pub fn children(parent: u32) -> Vec<u32> {
    let threads = std::fs::read_dir(format!("/proc/{parent}/task")).unwrap().map(|thread| thread.unwrap().path());
    let lists = threads.filter_map(|thread| std::fs::read_to_string(thread.join("children")).ok());
    let lists: Vec<String> = lists.collect();
    lists.iter().flat_map(|list| list.split_whitespace()).filter_map(|number| number.parse().ok()).collect()
}

#[test]
fn the_demo_opens_a_window_where_there_is_a_display_and_ends_with_it() {
    let display = Display::open();
    let [force, surface] = crate::live::free_endpoints();
    let arguments = ["demo", "--scene", "cube", "--force-endpoint", &force, "--surface-endpoint", &surface];
    let mut demo = Running(palpate(Some(&display), &arguments).spawn().unwrap());
    let shown = shows_a_body(&display, &mut demo.0);
    let viewers = children(demo.0.id());
    assert_eq!(viewers.len(), 1, "the window is a process of its own");
    // Closed, as far as the demo can tell.
    assert!(Command::new("kill").arg(viewers[0].to_string()).status().unwrap().success());
    let began = Instant::now();
    while demo.0.try_wait().unwrap().is_none() {
        assert!(began.elapsed() < Duration::from_secs(90), "the demo goes on without its window");
        std::thread::sleep(Duration::from_millis(50));
    }
    assert!(shown && demo.0.wait().unwrap().success());
}

#[test]
fn the_demo_runs_in_the_terminal_where_the_display_cannot_be_reached() {
    let [force, surface] = crate::live::free_endpoints();
    let arguments =
        ["demo", "--scene", "cube", "--seconds", "2", "--force-endpoint", &force, "--surface-endpoint", &surface];
    let outcome = palpate(None, &arguments).env("DISPLAY", ":4711").output().unwrap();
    let said = String::from_utf8_lossy(&outcome.stderr).into_owned();
    assert!(outcome.status.success() && said.contains("watching in the terminal"), "{said}");
    assert!(String::from_utf8_lossy(&outcome.stdout).contains("tick lateness"));
}
