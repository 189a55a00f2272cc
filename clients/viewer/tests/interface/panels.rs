//! Panels, mouse and keyboard.

use crate::fake_server::FakeServer;
use crate::pressed_ball::{record, record_organs};
use crate::screen::{Screen, button, readable, said};
use palpate_sdk::{Endpoints, Organ};
use palpate_viewer::app::App;
use palpate_viewer::colour::Colouring;
use palpate_viewer::source::Recording;
use three_d::egui::{Event, Key, Modifiers, PointerButton, pos2, vec2};

fn press(key: Key) -> Vec<Event> {
    [true, false]
        .map(|pressed| Event::Key { key, physical_key: None, pressed, repeat: false, modifiers: Modifiers::NONE })
        .into()
}

/// An app that plays a recording of the pressed ball.
fn app() -> App {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("ball.mcap");
    record(&path, 40);
    App::recording(Recording::open(&path).unwrap()).unwrap()
}

#[test]
fn what_must_be_read_is_on_the_screen_and_no_two_texts_overlap() {
    let (mut app, mut screen) = (app(), Screen::new());
    (app.paused, app.time, app.colouring) = (true, 1.0, Colouring::Displacement);
    app.advance(0.0).unwrap();
    screen.show(&mut app, vec![]);
    let (free, texts) = screen.show(&mut app, vec![]);
    assert!(free.width() > 900.0 && free.height() > 600.0, "{free:?}");
    for part in
        ["ball", "1.03 s", "1.61 N", "displacement", "mm", "force [N]", "1.00 s of 1.25 s", "probe", "palpate 7"]
    {
        assert!(said(&texts, part), "{part} of {texts:#?}");
    }
    readable(&texts);
}

#[test]
fn keys_choose_colours_pause_step_and_help() {
    let (mut app, mut screen) = (app(), Screen::new());
    for (key, colouring) in
        [(Key::Num2, Colouring::Level), (Key::Num3, Colouring::Strain), (Key::Num1, Colouring::Material)]
    {
        screen.show(&mut app, press(key));
        assert_eq!(app.colouring, colouring);
    }
    screen.show(&mut app, press(Key::Space));
    assert!(app.paused);
    app.time = 0.5;
    screen.show(&mut app, press(Key::ArrowRight));
    assert!((app.time - 0.512).abs() < 1e-9, "{}", app.time);
    screen.show(&mut app, press(Key::ArrowLeft));
    assert!((app.time - 0.480).abs() < 1e-9, "{}", app.time);
    screen.show(&mut app, press(Key::R));
    assert_eq!(app.time, 0.0);
    screen.show(&mut app, press(Key::H));
    let (_, texts) = screen.show(&mut app, vec![]);
    assert!(said(&texts, "take a tool"), "{texts:?}");
    let (free, _) = screen.show(&mut app, press(Key::P));
    assert_eq!(free.width(), 1280.0);
}

#[test]
fn the_mouse_turns_moves_and_zooms() {
    let (mut app, mut screen) = (app(), Screen::new());
    let (free, _) = screen.show(&mut app, vec![]);
    let centre = free.center();
    let mut drag = |app: &mut App, which: PointerButton| {
        let before = app.orbit.unwrap();
        screen.show(app, button(centre, which, true));
        screen.show(app, vec![Event::PointerMoved(centre + vec2(80.0, 40.0))]);
        screen.show(app, vec![Event::PointerMoved(centre + vec2(120.0, 60.0))]);
        screen.show(app, button(centre + vec2(120.0, 60.0), which, false));
        (before, app.orbit.unwrap())
    };
    let (before, after) = drag(&mut app, PointerButton::Primary);
    assert!(after.yaw < before.yaw - 0.1 && after.pitch > before.pitch + 0.05 && after.target == before.target);
    let (before, after) = drag(&mut app, PointerButton::Secondary);
    assert!(after.yaw == before.yaw && after.target != before.target);
    let wheel = Event::MouseWheel {
        unit: three_d::egui::MouseWheelUnit::Point,
        delta: vec2(0.0, 60.0),
        phase: three_d::egui::TouchPhase::Move,
        modifiers: Modifiers::NONE,
    };
    let before = app.orbit.unwrap().distance;
    screen.show(&mut app, vec![Event::PointerMoved(centre), wheel]);
    (0..5).for_each(|_| drop(screen.show(&mut app, vec![])));
    assert!(app.orbit.unwrap().distance < 0.95 * before);
    screen.show(&mut app, press(Key::F));
    assert!((app.orbit.unwrap().distance / before - 1.0).abs() < 1e-6);
}

#[test]
fn the_time_line_is_dragged_and_a_recording_ends_at_its_end() {
    let (mut app, mut screen) = (app(), Screen::new());
    let (free, texts) = screen.show(&mut app, vec![]);
    let place = texts.iter().find(|text| text.words.contains(" s of ")).expect("the time line says where it stands");
    let slider = pos2(0.5 * (free.min.x + place.rect.min.x), place.rect.center().y);
    screen.show(&mut app, button(slider, PointerButton::Primary, true));
    screen.show(&mut app, button(slider, PointerButton::Primary, false));
    assert!(app.paused && (0.3..0.9).contains(&app.time), "{}", app.time);
    app.toggle_pause();
    app.advance(10.0).unwrap();
    assert!(app.paused);
    assert!((app.time - app.recorded().unwrap().duration()).abs() < 1e-9);
    app.toggle_pause();
    assert_eq!(app.time, 0.0, "from the end it begins again");
}

#[test]
fn organs_are_listed_and_each_can_be_hidden() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("organs.mcap");
    let organ = |name: &str, vertices, volume| Organ {
        name: name.into(),
        vertices,
        triangles: 700,
        volume,
        youngs_modulus: 5e3,
        ..Organ::default()
    };
    record_organs(&path, 20, 10, &[organ("upper half", 400, 2e-4), organ("lower", 0, 1.5e-4)]);
    let (mut app, mut screen) = (App::recording(Recording::open(&path).unwrap()).unwrap(), Screen::new());
    app.paused = true;
    app.advance(0.0).unwrap();
    screen.show(&mut app, vec![]);
    let (_, texts) = screen.show(&mut app, vec![]);
    for part in ["upper half", "lower", "200 mL", "150 mL", "5 kPa", "400 vertices", "362 vertices"] {
        assert!(said(&texts, part), "{part} of {texts:#?}");
    }
    readable(&texts);
    let triangles = app.body().unwrap().subject.surface.triangles.clone();
    assert_eq!(app.shown_triangles(), triangles);
    let lower = texts.iter().find(|text| text.words == "lower").unwrap().rect.center();
    let mut click = |app: &mut App| {
        screen.show(app, button(lower, PointerButton::Primary, true));
        screen.show(app, button(lower, PointerButton::Primary, false));
    };
    click(&mut app);
    assert_eq!(app.hidden, [false, true]);
    let shown = app.shown_triangles();
    assert!(shown[..700] == triangles[..700] && shown[700..].iter().all(|t| *t == [0; 3]));
    click(&mut app);
    assert_eq!(app.shown_triangles(), triangles);
}

/// Looks at the server at `endpoints` until `words` are on the screen.
fn look_until_it_says(endpoints: &Endpoints, words: &str) {
    let (mut app, mut screen) = (App::live(endpoints), Screen::new());
    let began = std::time::Instant::now();
    loop {
        app.advance(0.0).unwrap();
        let (_, texts) = screen.show(&mut app, vec![]);
        if said(&texts, words) {
            break;
        }
        assert!(began.elapsed().as_secs() < 60, "{texts:?}");
        std::thread::sleep(std::time::Duration::from_millis(50));
    }
    assert!(app.stale());
}

#[test]
fn a_server_that_is_not_there_is_named_on_the_screen() {
    let endpoints = Endpoints { surface: "tcp/127.0.0.1:9".into(), ..Endpoints::default() };
    look_until_it_says(&endpoints, "127.0.0.1:9");
}

#[test]
fn a_server_of_another_version_is_named_on_the_screen_with_both_versions() {
    for (version, words) in [((9, 0), "server speaks version 9 of"), ((1, 0), "server speaks version 1.0 of")] {
        let server = FakeServer::start(version);
        look_until_it_says(&server.endpoints, words);
    }
}

#[test]
fn how_a_server_fares_can_be_read_when_its_machine_leaves_it_no_time() {
    let server = FakeServer::current();
    let (mut app, mut screen) = (App::live(&server.endpoints), Screen::new());
    let began = std::time::Instant::now();
    for tick in 1.. {
        server.publish_frame(tick, false);
        server.publish_status(1000 * tick);
        app.advance(0.0).unwrap();
        let (_, texts) = screen.show(&mut app, vec![]);
        readable(&texts);
        if said(&texts, "takes 200") && said(&texts, "at most 0") {
            break;
        }
        assert!(began.elapsed().as_secs() < 60, "{texts:?}");
        std::thread::sleep(std::time::Duration::from_millis(50));
    }
}
