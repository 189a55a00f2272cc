//! The phantom in closed loop with a stand-in server, over real zenoh sessions on the loopback interface.

#[path = "../../sdk/tests/fake_server/mod.rs"]
mod fake_server;

use std::sync::atomic::{AtomicBool, Ordering::Relaxed};

use fake_server::{FLOOR_STIFFNESS, FLOOR_TORSION, FakeServer};
use palpate_phantom::{Device, Hand, Options, Pattern, Report, Sample, Vec3, run};
use palpate_sdk::LinkConditions;

/// The sample of middle height while the hand holds: on a busy machine a wrench may be late and the force fade for a
/// moment.
fn held(report: &Report) -> Sample {
    let mut samples: Vec<_> = report.samples.iter().filter(|sample| sample.time >= 2.0).copied().collect();
    samples.sort_by(|a, b| a.position[2].total_cmp(&b.position[2]));
    samples[samples.len() / 2]
}

fn never() -> AtomicBool {
    AtomicBool::new(false)
}

#[test]
fn pressing_a_springy_floor_ends_where_hand_and_floor_are_in_balance() {
    let server = FakeServer::current();
    let hand = Hand::default();
    let options = Options {
        endpoints: server.endpoints.clone(),
        device: Device { friction: 0.0, ..Device::default() },
        seconds: Some(2.4),
        samples: 2400,
        ..Options::default()
    };
    let mut shown = 0;
    let report = run(&options, &never(), &mut |_| shown += 1).unwrap();

    // It is coupled as stiffly as the device renders.
    assert_eq!(server.attached.lock().unwrap().coupling_stiffness, options.device.max_stiffness);
    // Held at the depth: k_hand (depth − d) = k_floor d, within one encoder step of force.
    let expected = hand.stiffness * options.depth / (hand.stiffness + FLOOR_STIFFNESS);
    let held = held(&report);
    assert_eq!(report.samples.len(), 2400);
    assert!((0.005 - held.position[2] - expected).abs() < 2.0 * options.device.resolution, "{held:?}");
    assert!((held.force[2] - FLOOR_STIFFNESS * expected).abs() < 2.0 * FLOOR_STIFFNESS * options.device.resolution);
    // It began 20 mm above touch, on the axis of the floor.
    assert_eq!(report.samples[0].target, [0.0, 0.0, 0.025]);

    assert!(report.wrenches > 0 && report.refused_wrenches == 0);
    assert!(report.contact_wrenches > 0 && report.peak_force > 0.0 && report.non_finite_wrenches == 0);
    assert!(report.round_trip.count > 0 && report.bare_round_trip.unwrap().count > 0);
    assert!(shown > 0);
}

#[test]
fn a_turning_hand_feels_the_torque_that_the_floor_gives_and_its_button_goes_along() {
    let server = FakeServer::current();
    let device = Device { friction: 0.0, ..Device::by_name("PHANTOM Premium 1.5 6DOF").unwrap() };
    let options = Options {
        endpoints: server.endpoints.clone(),
        device,
        pattern: Pattern::Turn,
        seconds: Some(3.0),
        samples: 3000,
        echo: false,
        ..Options::default()
    };
    let report = run(&options, &never(), &mut |_| ()).unwrap();
    assert_eq!(server.attached.lock().unwrap().coupling_angular_stiffness, options.device.max_angular_stiffness);
    assert_eq!(server.buttons.load(Relaxed), 1);
    // Turned slowly, hand and floor are in balance at the farthest: k_hand (0.6 − θ) = k_floor · 2 sin(θ/2).
    let turned = |sample: &Sample| 2.0 * sample.orientation[2].atan2(sample.orientation[3]);
    let farthest = report.samples.iter().map(turned).fold(0.0, f64::max);
    let hand = Hand::default();
    let balanced = 0.6 * hand.angular_stiffness / (hand.angular_stiffness + FLOOR_TORSION);
    assert!((farthest / balanced - 1.0).abs() < 0.1, "{farthest} of {balanced} rad");
    let sent = server.torque.load(Relaxed) as f64 * 1e-9;
    assert!(report.peak_device_torque > 0.9 * sent && sent > 0.9 * FLOOR_TORSION * farthest, "{report}");
    // At the side to which it is turned it is pushed back.
    let most = report.samples.iter().max_by(|a, b| turned(a).total_cmp(&turned(b))).unwrap();
    assert!(most.torque[2] < 0.0 && report.turned > farthest && report.to_string().contains("mN·m given"));
}

#[test]
fn far_away_the_local_model_presses_as_well_as_near() {
    let server = FakeServer::current();
    let options = Options {
        endpoints: server.endpoints.clone(),
        device: Device { friction: 0.0, ..Device::default() },
        link: LinkConditions { delay_ns: 10_000_000, jitter_ns: 5_000_000, loss: 0.05 },
        seconds: Some(2.4),
        samples: 2400,
        echo: false,
        ..Options::default()
    };
    let report = run(&options, &never(), &mut |_| ()).unwrap();
    let hand = Hand::default();
    let expected = hand.stiffness * options.depth / (hand.stiffness + FLOOR_STIFFNESS);
    let held = held(&report);
    assert!((0.005 - held.position[2] - expected).abs() < 1e-4, "{held:?}");
    assert!(report.peak_energy <= 1.01 * options.device.passivity_budget(), "{} J", report.peak_energy);
    assert!(report.to_string().contains("'local-passive' over 10 ms and up to 5 ms more each way, 5 % lost"));
}

#[test]
fn a_headset_sends_few_poses_and_the_device_still_runs_a_thousand_times_a_second() {
    let server = FakeServer::current();
    let options = Options {
        endpoints: server.endpoints.clone(),
        pattern: Pattern::Tap,
        rate_hz: 80.0,
        seconds: Some(1.0),
        site: Some((Vec3::zeros(), Vec3::z())),
        echo: false,
        ..Options::default()
    };
    let report = run(&options, &never(), &mut |_| ()).unwrap();
    assert!(report.ticks >= 1000);
    assert!(report.poses_sent <= 80, "{} poses", report.poses_sent);
    assert!(report.bare_round_trip.is_none());
}

#[test]
fn a_server_that_falls_silent_ends_the_run_with_an_error() {
    let server = FakeServer::current();
    let options = Options { endpoints: server.endpoints.clone(), ..Options::default() };
    let error = run(&options, &never(), &mut |_| server.mute.store(true, Relaxed)).unwrap_err();
    assert!(error.to_string().starts_with("no wrench for 2 s from tcp/127.0.0.1:"), "{error}");
}

#[test]
fn stopping_ends_the_run_with_its_report() {
    let server = FakeServer::current();
    let options = Options { endpoints: server.endpoints.clone(), ..Options::default() };
    let stop = never();
    let report = run(&options, &stop, &mut |live| stop.store(live.sample.time > 0.25, Relaxed)).unwrap();
    assert!(report.seconds > 0.25 && report.seconds < 5.0);
}

#[test]
fn a_device_whose_clock_runs_slow_ticks_by_that_clock() {
    let server = FakeServer::current();
    let options =
        Options { endpoints: server.endpoints.clone(), clock_drift: -0.01, seconds: Some(2.0), ..Options::default() };
    let report = run(&options, &never(), &mut |_| ()).unwrap();
    // The last of its 2000 ticks is due when 1999 / 0.99 ms have passed, and never woken early.
    assert!(report.seconds > 2.019, "{} s", report.seconds);
}

#[test]
fn options_that_make_no_sense_are_refused() {
    let server = FakeServer::current();
    let good = Options { endpoints: server.endpoints.clone(), ..Options::default() };
    let refused = |options: Options| run(&options, &never(), &mut |_| ()).unwrap_err().to_string();
    assert!(refused(Options { rate_hz: 2000.0, ..good.clone() }).contains("1000 Hz"));
    assert!(refused(Options { clock_drift: f64::NAN, ..good.clone() }).contains("drift"));
    let link = LinkConditions { loss: 1.5, ..LinkConditions::default() };
    assert!(refused(Options { link, ..good.clone() }).contains("loss is 1.5"));
    assert!(refused(Options { depth: f64::NAN, ..good.clone() }).contains("depth"));
    assert!(refused(Options { tool: "scalpel".to_owned(), ..good.clone() }).contains("there is no tool 'scalpel'"));
    assert!(refused(Options { depth: 0.15, ..good }).contains("150 mm"));
}
