//! The client against a stand-in server, over real zenoh sessions on the loopback interface.

mod fake_server;

use std::{
    sync::atomic::Ordering::Relaxed,
    time::{Duration, Instant},
};

use fake_server::{FLOOR_STIFFNESS, FakeServer, height};
use palpate_sdk::proto::{StopRecording, control_request::Request};
use palpate_sdk::{
    Attachment, ClientError, Connection, Device, Endpoints, PoseSample, Registration, SdkError, SurfaceWatch,
    WatchOptions,
};

/// `tool` for `client`, held rigidly.
fn rigid(client: &str, tool: &str, rate_hz: f64) -> Attachment {
    Attachment { client: client.to_owned(), tool: tool.to_owned(), rate_hz, ..Attachment::default() }
}

fn pose(z: f64) -> PoseSample {
    PoseSample {
        position: [0.0, 0.0, z],
        orientation: [0.0, 0.0, 0.0, 1.0],
        linear_velocity: None,
        buttons: 0,
        opening: 0.0,
    }
}

/// Waits until `ready` gives something, at most 60 s.
fn wait_for<T>(mut ready: impl FnMut() -> Option<T>) -> T {
    let start = Instant::now();
    loop {
        if let Some(found) = ready() {
            return found;
        }
        assert!(start.elapsed() < Duration::from_secs(60), "waited in vain");
        std::thread::sleep(Duration::from_millis(1));
    }
}

#[test]
fn a_device_holds_its_tool_as_stiffly_as_it_can_render() {
    let server = FakeServer::current();
    let connection = Connection::open(&server.endpoints).unwrap();
    let device = Device::by_name("PHANTOM Premium 1.5 6DOF").unwrap();
    let _tool = connection.attach(&Attachment::of("test", &device, &Registration::default())).unwrap();
    let asked = server.attached.lock().unwrap().clone();
    assert_eq!((asked.coupling_stiffness, asked.coupling_angular_stiffness), (800.0, 0.3));
}

#[test]
fn a_pose_is_answered_by_the_wrench_that_names_it() {
    let server = FakeServer::current();
    let connection = Connection::open(&server.endpoints).unwrap();
    assert_eq!(connection.session().unwrap().name, "fake");
    let mut tool = connection.attach(&rigid("test", "", 1000.0)).unwrap();
    assert_eq!(tool.latest_wrench(), None);
    assert_eq!(tool.safe_force(0), [0.0; 3]);
    wait_for(|| server.is_attended().then_some(()));

    for expected in 1..=3 {
        let sent_ns = tool.now_ns();
        assert_eq!(tool.send_pose(pose(0.001)).unwrap(), expected);
        let received = wait_for(|| tool.latest_wrench().filter(|r| r.wrench.pose_sequence == expected));
        assert!(received.fresh && received.wrench.pose_time_ns >= sent_ns && received.arrival_ns > sent_ns);
        assert!((received.wrench.force[2] - 0.004 * FLOOR_STIFFNESS).abs() < 1e-6);
        assert!(!tool.latest_wrench().unwrap().fresh);
        assert_eq!(tool.safe_force(received.arrival_ns), received.wrench.force);
    }
    let counters = tool.counters();
    assert_eq!((counters.received, counters.missed, counters.undecodable, counters.foreign), (3, 0, 0, 0));

    tool.detach().unwrap();
    wait_for(|| (!server.is_attended()).then_some(()));
    connection.attach(&rigid("test", "ball", 80.0)).unwrap();
}

#[test]
fn a_refusal_carries_the_reason_of_the_server() {
    let server = FakeServer::current();
    let connection = Connection::open(&server.endpoints).unwrap();
    let unknown = connection.attach(&rigid("test", "scalpel", 1000.0)).err().unwrap();
    assert_eq!(unknown.to_string(), "the server refused: there is no tool 'scalpel'");
    assert!(matches!(connection.control(Request::StopRecording(StopRecording {})), Err(SdkError::Refused(_))));
}

#[test]
fn a_server_of_another_version_is_refused_and_both_versions_are_named() {
    let server = FakeServer::start((9, 0));
    let connection = Connection::open_surface(&server.endpoints).unwrap();
    let expected = "the server speaks version 9 of the contract, this client version 1";
    assert_eq!(connection.session().unwrap_err().to_string(), expected);
    assert_eq!(connection.watch_surface(WatchOptions::default()).err().unwrap().to_string(), expected);
}

#[test]
fn a_viewer_of_a_server_before_quantised_frames_is_told_both_versions() {
    let server = FakeServer::start((1, 0));
    let connection = Connection::open_surface(&server.endpoints).unwrap();
    connection.session().unwrap();
    let error = connection.watch_surface(WatchOptions::default()).err().unwrap();
    let client = format!("{}.{}", palpate_sdk::proto::VERSION_MAJOR, palpate_sdk::proto::VERSION_MINOR);
    let told = format!("the server speaks version 1.0 of the contract, this client version {client}");
    assert_eq!(error.to_string(), told);
}

#[test]
fn whoever_would_touch_on_a_server_before_roles_is_told_both_versions() {
    let server = FakeServer::start((1, 5));
    let connection = Connection::open(&server.endpoints).unwrap();
    let error = connection.attach(&rigid("test", "", 1000.0)).err().unwrap();
    assert!(error.to_string().starts_with("the server speaks version 1.5 of the contract"), "{error}");
}

#[test]
fn a_server_that_knows_nothing_of_organs_shows_one() {
    let server = FakeServer::start((1, 1));
    let connection = Connection::open_surface(&server.endpoints).unwrap();
    let watch = connection.watch_surface(WatchOptions::default()).unwrap();
    let surface = watch.surface();
    assert_eq!(surface.organs.len(), 1);
    assert_eq!(surface.ranges().next(), Some([0..surface.rest_positions.len(), 0..surface.triangles.len()]));
}

#[test]
fn a_server_that_is_just_coming_up_is_waited_for() {
    let server = FakeServer::start_slowly((1, 1), Duration::from_millis(700));
    let connection = Connection::open_surface(&server.endpoints).unwrap();
    assert_eq!(connection.session().unwrap().version_minor, 1);
}

#[test]
fn no_answer_names_the_key_and_the_endpoint() {
    let server = FakeServer::current();
    let elsewhere = Endpoints { session: "elsewhere".to_owned(), ..server.endpoints.clone() };
    let error = Connection::open_surface(&elsewhere).unwrap().session().unwrap_err();
    let expected = format!("no answer on palpate/v1/elsewhere/session from {}", server.endpoints.surface);
    assert!(error.to_string().starts_with(&expected), "{error}");
}

#[test]
fn a_viewer_needs_no_force_channel_and_cannot_attach() {
    let server = FakeServer::current();
    let viewer = Connection::open_surface(&server.endpoints).unwrap();
    assert!(matches!(viewer.attach(&rigid("test", "", 1000.0)), Err(SdkError::NoForceChannel)));
    let watch = viewer.watch_surface(WatchOptions::default()).unwrap();
    assert_eq!(watch.surface().triangles, [[0, 1, 2], [0, 2, 3]]);
    assert!(matches!(
        viewer.watch_surface(WatchOptions { every: 3, levels: false }),
        Err(SdkError::Client(ClientError::Unknown { .. }))
    ));
}

/// A watch to which `server` already sends.
fn watch(server: &FakeServer, sequence: u64) -> SurfaceWatch {
    let viewer = Connection::open_surface(&server.endpoints).unwrap();
    let watch = viewer.watch_surface(WatchOptions::default()).unwrap();
    wait_for(|| {
        server.publish_frame(sequence, false);
        (watch.counters().bytes > 0).then_some(())
    });
    watch
}

/// Waits until `watch` shows frame `sequence`, which must stand where the server has it.
fn shows(watch: &SurfaceWatch, sequence: u64) {
    let moment = wait_for(|| watch.latest().filter(|moment| moment.sequence == sequence));
    assert_eq!((moment.tick, moment.positions.len()), (32 * sequence, 4));
    for (now, rest) in moment.positions.iter().zip(&watch.surface().rest_positions) {
        for (c, offset) in [0.0, 0.0, height(sequence)].into_iter().enumerate() {
            let off = f64::from(now[c]) - f64::from(rest[c]) - offset;
            assert!(off.abs() <= 0.51 * watch.surface().step, "{now:?} {rest:?}");
        }
    }
}

#[test]
fn a_late_viewer_sees_the_newest_key_frame_before_any_frame_comes() {
    let server = FakeServer::current();
    server.publish_frame(37, false);
    let viewer = Connection::open_surface(&server.endpoints).unwrap();
    let watch = viewer.watch_surface(WatchOptions::default()).unwrap();
    shows(&watch, 32);
}

#[test]
fn a_viewer_that_loses_a_tenth_of_the_frames_shows_every_other_one_right() {
    let server = FakeServer::current();
    let watch = watch(&server, 0);
    shows(&watch, 0);
    let (mut lost, mut lost_keys) = (0, 0);
    for sequence in 1..=320u64 {
        let is_lost = sequence % 10 == 8 || sequence == 160;
        server.publish_frame(sequence, is_lost);
        if is_lost {
            lost += 1;
            lost_keys += u64::from(sequence.is_multiple_of(16));
        } else {
            shows(&watch, sequence);
        }
    }
    let counters = watch.counters();
    assert!(lost > 30 && lost_keys > 1, "{lost} frames, {lost_keys} key frames");
    // The watch has asked for every key frame that was lost, and shown it.
    assert_eq!((counters.frames, counters.lost, counters.undecodable), (321 - lost + lost_keys, lost - lost_keys, 0));
    // One more at the start.
    assert_eq!(server.keys_asked_for.load(Relaxed), 1 + lost_keys);
}

#[test]
fn the_bare_round_trip_returns_its_own_payload() {
    let server = FakeServer::current();
    let connection = Connection::open(&server.endpoints).unwrap();
    let mut probe = connection.round_trip_probe(142).unwrap();
    let round_trip = wait_for(|| probe.round_trip(Duration::from_millis(200)));
    assert!(round_trip > Duration::ZERO && round_trip < Duration::from_millis(200));
}
