//! A running server, watched and poked.

use crate::display::children;
use crate::look::{all, is_fine, is_force, is_tissue, part};
use crate::screen::{Screen, button, readable, said};
use palpate_sdk::Endpoints;
use palpate_viewer::Scenes;
use palpate_viewer::app::App;
use palpate_viewer::colour::Colouring;
use palpate_viewer::poke::Felt;
use palpate_viewer::snapshot::Photographer;
use palpate_viewer::three_d::egui::{PointerButton, Pos2, pos2};
use palpate_viewer::three_d::{Viewport, vec3};
use std::process::{Child, Command, Stdio};
use std::sync::mpsc;
use std::time::{Duration, Instant};

/// Endpoints of two ports that nobody listens on.
pub fn free_endpoints() -> [String; 2] {
    [0, 1].map(|_| crate::ports::free_endpoint())
}

/// A server of the weightless cube in a process of its own.
struct Serving(Child);

impl Serving {
    fn start(endpoints: &Endpoints) -> Self {
        Self::with(endpoints, &[])
    }

    fn with(endpoints: &Endpoints, more: &[&str]) -> Self {
        let server = Command::new(env!("CARGO_BIN_EXE_palpate"))
            .args(["serve", "--scene", "cube", "--set", "world.gravity=[0.0, 0.0, 0.0]", "--until-input-ends"])
            .args(["--force-endpoint", &endpoints.force, "--surface-endpoint", &endpoints.surface])
            .args(more)
            .stdin(Stdio::piped())
            .stdout(Stdio::null())
            .spawn()
            .unwrap();
        Self(server)
    }
}

impl Drop for Serving {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

fn endpoints() -> Endpoints {
    let [force, surface] = free_endpoints();
    Endpoints { force, surface, ..Endpoints::default() }
}

/// Lets `app` take what comes until `done`.
fn watch_until(app: &mut App, what: &str, mut done: impl FnMut(&mut App) -> bool) {
    let began = Instant::now();
    loop {
        app.advance(0.0).unwrap();
        if done(app) {
            return;
        }
        assert!(began.elapsed() < Duration::from_secs(90), "waited in vain: {what}; {:?}", app.notice());
        std::thread::sleep(Duration::from_millis(10));
    }
}

fn newtons(app: &App) -> f64 {
    match app.felt() {
        Some(Felt::Held(_, Some(touch))) => touch.newtons,
        _ => 0.0,
    }
}

#[test]
fn a_press_of_the_mouse_is_felt_and_seen_and_all_that_is_said_can_be_read() {
    let endpoints = endpoints();
    let _server = Serving::start(&endpoints);
    let mut app = App::live(&endpoints);
    watch_until(&mut app, "the first frame", |app| app.moment().tick > 0 && app.status().tick > 0);
    let mut screen = Screen::new();
    app.toggle_poke();
    watch_until(&mut app, "a tool", |app| matches!(app.felt(), Some(Felt::Held(_, Some(_)))));

    // Press on the middle of the cube's top, where the screen shows it.
    let (free, _) = screen.show(&mut app, vec![]);
    let camera = app.orbit.unwrap().camera(Viewport::new_at_origo(free.width() as u32, free.height() as u32));
    let pixel = camera.pixel_at_position(vec3(0.05, 0.05, 0.1));
    let top: Pos2 = pos2(free.min.x + pixel.x, free.max.y - pixel.y);
    let orbit = app.orbit;
    screen.show(&mut app, button(top, PointerButton::Primary, true));
    watch_until(&mut app, "a force", |app| {
        screen.show(app, vec![]);
        newtons(app) > 0.1
    });
    // All at once, and nothing is taken in between this and the picture.
    watch_until(&mut app, "the force in the picture, and who holds the tool", |app| {
        let (_, texts) = screen.show(app, vec![]);
        let seen = app.tools().first().is_some_and(|tool| tool.force.z > 0.1) && newtons(app) > 0.1;
        let written = said(&texts, "contact points") && said(&texts, "mouse (ball)");
        if seen && written {
            readable(&texts);
        }
        seen && written
    });
    let picture = Photographer::new().unwrap().take(&mut app, 1280, 800).unwrap();
    let (arrow, tissue) = (part(all(&picture), is_force), part(all(&picture), is_tissue));
    assert!(arrow > 1e-3 && tissue > 0.05, "{arrow} {tissue}");
    app.colouring = Colouring::Level;
    // A machine that has other things to do gives the body the work for its finest level when it can.
    let mut photographer = Photographer::new().unwrap();
    watch_until(&mut app, "the body to be fine under the tool", |app| {
        let picture = photographer.take(app, 1280, 800).unwrap();
        part(picture.region(0.2, 0.2, 0.6, 0.8), is_fine) > 5e-3
    });
    assert_eq!(app.orbit, orbit, "a press with a tool does not turn the body");

    screen.show(&mut app, button(top, PointerButton::Primary, false));
    watch_until(&mut app, "no force any more", |app| {
        screen.show(app, vec![]);
        newtons(app) == 0.0
    });
    app.toggle_poke();
    assert!(app.felt().is_none());
}

#[test]
fn a_server_that_goes_and_comes_back_is_watched_again_and_until_then_the_picture_is_grey() {
    let endpoints = endpoints();
    let server = Serving::start(&endpoints);
    let mut app = App::live(&endpoints);
    app.panels = false;
    let mut photographer = Photographer::new().unwrap();
    watch_until(&mut app, "the first frame", |app| app.moment().tick > 0 && !app.stale());
    let alive = photographer.take(&mut app, 640, 480).unwrap();
    assert!(part(all(&alive), is_tissue) > 0.1);

    drop(server);
    watch_until(&mut app, "that nothing comes", |app| app.stale());
    let stale = photographer.take(&mut app, 640, 480).unwrap();
    assert!(part(all(&stale), is_tissue) < 0.01, "grey");
    assert!(app.notice().is_some());

    let _server = Serving::start(&endpoints);
    watch_until(&mut app, "frames again", |app| !app.stale());
    let again = photographer.take(&mut app, 640, 480).unwrap();
    assert!(part(all(&again), is_tissue) > 0.1);
}

/// Greatest distance along an axis of a vertex from where it is at rest [m].
fn moved(app: &App) -> f32 {
    let rest = &app.body().unwrap().subject.surface.rest_positions;
    let pairs = app.moment().positions.iter().zip(rest);
    pairs.flat_map(|(now, rest)| (0..3).map(move |c| (now[c] - rest[c]).abs())).fold(0.0, f32::max)
}

#[test]
fn a_reset_puts_the_body_back() {
    let endpoints = endpoints();
    // Nothing holds it: what is pushed away stays away.
    let _server = Serving::with(&endpoints, &["--set", "hold=[]"]);
    let mut app = App::live(&endpoints);
    watch_until(&mut app, "the first frame", |app| app.moment().tick > 100);
    let connection = palpate_sdk::Connection::open(&endpoints).unwrap();
    let mut tool = connection.attach(&palpate_sdk::Attachment { client: "hand".into(), ..Default::default() }).unwrap();
    let mut height = 0.15;
    watch_until(&mut app, "the body to be pushed away", |app| {
        tool.send_pose(palpate_sdk::PoseSample {
            position: [0.05, 0.05, height],
            orientation: [0.0, 0.0, 0.0, 1.0],
            linear_velocity: None,
            buttons: 0,
            opening: 0.0,
        })
        .unwrap();
        height = f64::max(height - 1e-3, 0.06);
        moved(app) > 0.02
    });
    tool.detach().unwrap();
    app.reset();
    watch_until(&mut app, "the body to be back", |app| moved(app) < 1e-3);
    assert!(app.notice().is_none(), "{:?}", app.notice());
}

#[test]
fn a_bundled_scene_can_be_chosen_and_its_server_ends_with_the_viewer() {
    let mut app = App::live(&endpoints());
    let program = std::path::PathBuf::from(env!("CARGO_BIN_EXE_palpate"));
    app.scenes = Some(Scenes { program, names: vec!["cube".into(), "toy".into()] });
    let (mut screen, before) = (Screen::new(), children(std::process::id()));
    screen.show(&mut app, vec![]);
    let (_, texts) = screen.show(&mut app, vec![]);
    let menu = texts.iter().find(|text| text.words.contains("scene")).expect("a menu of scenes").rect.center();
    let mut click = |app: &mut App, at: Pos2| {
        screen.show(app, button(at, PointerButton::Primary, true));
        screen.show(app, button(at, PointerButton::Primary, false));
        screen.show(app, vec![]).1
    };
    let texts = click(&mut app, menu);
    let cube = texts.iter().find(|text| text.words == "cube").expect("the cube is in the menu").rect.center();
    click(&mut app, cube);
    watch_until(&mut app, "the chosen scene", |app| app.moment().tick > 0 && !app.stale());
    assert_eq!(app.body().unwrap().subject.name, "cube");
    let started: Vec<u32> = children(std::process::id()).into_iter().filter(|child| !before.contains(child)).collect();
    drop(app);
    let served = |child: &u32| {
        let command = std::fs::read_to_string(format!("/proc/{child}/cmdline")).unwrap_or_default();
        command.contains("serve\0--until-input-ends\0--scene\0cube\0--force")
    };
    assert!(!started.iter().any(served), "its server is still there");
}

#[test]
fn a_server_that_was_started_by_a_viewer_ends_when_the_viewer_dies() {
    let mut server = Serving::start(&endpoints());
    std::thread::sleep(Duration::from_millis(500));
    assert!(server.0.try_wait().unwrap().is_none());
    // What the system does to the pipe of a process that dies.
    drop(server.0.stdin.take());
    let began = Instant::now();
    while server.0.try_wait().unwrap().is_none() {
        assert!(began.elapsed() < Duration::from_secs(90), "it serves nobody");
        std::thread::sleep(Duration::from_millis(20));
    }
    assert!(server.0.wait().unwrap().success());
}

/// Two tools beside each other into the top of the cube, from 50 mm above to 8 mm below it, and on until `end`'s other
/// half is dropped.
fn press_with_two(connection: &palpate_sdk::Connection, end: mpsc::Receiver<()>) {
    let mut tools = ["left", "right"].map(|name| {
        let attachment = palpate_sdk::Attachment { tool: name.into(), client: name.into(), ..Default::default() };
        connection.attach(&attachment).unwrap()
    });
    let mut depth = -0.05;
    while end.recv_timeout(Duration::from_millis(2)) == Err(mpsc::RecvTimeoutError::Timeout) {
        for (tool, (x, radius)) in tools.iter_mut().zip([(0.02, 0.02), (0.08, 0.01)]) {
            tool.send_pose(palpate_sdk::PoseSample {
                position: [x, 0.05, 0.1 + radius - depth],
                orientation: [0.0, 0.0, 0.0, 1.0],
                linear_velocity: None,
                buttons: 0,
                opening: 0.0,
            })
            .unwrap();
        }
        depth = f64::min(depth + 1e-4, 0.008);
    }
}

#[test]
fn two_tools_are_drawn_and_each_has_a_curve_of_its_own() {
    let endpoints = endpoints();
    let two = "tool=[{name=\"left\", radius=0.02}, {name=\"right\", radius=0.01, length=0.05}]";
    let _server = Serving::with(&endpoints, &["--set", two]);
    let mut app = App::live(&endpoints);
    app.panels = false;
    watch_until(&mut app, "the first frame", |app| app.moment().tick > 0);
    let alone = Photographer::new().unwrap().take(&mut app, 640, 480).unwrap();
    let connection = palpate_sdk::Connection::open(&endpoints).unwrap();
    let both = std::thread::scope(|scope| {
        let (ended, end) = mpsc::channel::<()>();
        scope.spawn(|| press_with_two(&connection, end));
        // Enough for arrows that can be seen, and held while the picture is taken.
        watch_until(&mut app, "both forces", |app| {
            app.tools().len() == 2 && app.tools().iter().all(|tool| tool.force.z > 0.3)
        });
        let both = Photographer::new().unwrap().take(&mut app, 640, 480).unwrap();
        drop(ended);
        both
    });
    // Each of them covers something that was to be seen before, on its own side.
    for (left, right) in [(0.2, 0.48), (0.52, 0.8)] {
        let pairs = alone.region(left, 0.05, right, 0.5).zip(both.region(left, 0.05, right, 0.5));
        let changed = pairs.filter(|(a, b)| (0..3).any(|channel| a[channel].abs_diff(b[channel]) > 30)).count();
        assert!(changed > 1000, "from {left} to {right}: {changed} pixels");
    }
    assert!(part(all(&both), is_force) > 1e-3);
    assert_eq!(app.history().tools(), 2);
    for tool in 0..2 {
        assert!(app.history().force(tool, 1000).iter().any(|point| point[1] > 0.05), "tool {tool}");
    }
}
