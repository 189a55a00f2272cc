//! Touching through a page.

use crate::browser::{Heard, Page};
use crate::{Server, Web, free_endpoints, wait_for};
use palpate_proto::ToolPhase;
use palpate_sdk::{Connection, Surface, SurfaceDecoder};
use palpate_web::Rights;
use palpate_web::message::{Notice, SEEN};
use std::sync::Arc;
use std::sync::atomic::Ordering::Relaxed;
use std::time::{Duration, Instant};

#[test]
fn an_operator_presses_sees_the_dent_and_feels_the_force() {
    let endpoints = free_endpoints();
    let _server = Server::start(&endpoints);
    let web = Web::start(&endpoints);
    let mut page = web.page(Rights::Operator);
    let mut parts = Vec::new();
    let mut decoder = page.wait("a surface", |heard| {
        if let Heard::Topology(part) = heard {
            parts.push(part);
        }
        let whole = parts.first().is_some_and(|first| first.parts as usize == parts.len());
        whole.then(|| SurfaceDecoder::new(Arc::new(Surface::from_parts(parts.clone()).unwrap())))
    });
    page.wait("a frame", |heard| matches!(heard, Heard::Frame(_)).then_some(()));
    let hand = page.attach("left").unwrap();
    // Where poses came so late that the tool was let go, it has to be outside before it is felt again.
    let press = |page: &mut Page| {
        page.press(hand, 0.02, 0.02, 10);
        page.press(hand, 0.02, -0.008, 40);
    };
    press(&mut page);
    let began = Instant::now();
    let mut last = 0;
    let felt = loop {
        last = page.pose(hand, -0.008).max(last);
        let Heard::Wrench(wrench) = page.hear() else { continue };
        let answers = wrench.pose_sequence > 0 && wrench.pose_time_ns == 1000 * u64::from(wrench.pose_sequence);
        if wrench.phase() == ToolPhase::Engaged && wrench.force[2] > 0.1 && answers {
            break wrench;
        }
        assert!(began.elapsed() < Duration::from_secs(60), "{wrench:?}");
        if wrench.phase() == ToolPhase::Waiting {
            press(&mut page);
        }
    };
    assert!(felt.pose_sequence <= last && felt.contact_points > 0 && felt.force[2] < 3.31, "{felt:?}");
    let dent = loop {
        page.pose(hand, -0.008);
        assert!(began.elapsed() < Duration::from_secs(60), "no dent");
        let frame = match page.hear() {
            Heard::Frame(frame) => frame,
            Heard::Wrench(wrench) if wrench.phase() == ToolPhase::Waiting => {
                press(&mut page);
                continue;
            }
            _ => continue,
        };
        // Frames before their key frame are nothing.
        let Some(moment) = decoder.receive(&frame).unwrap() else { continue };
        let rest = decoder.surface().rest_positions.iter();
        let dent = rest.zip(&moment.positions).map(|(rest, now)| rest[2] - now[2]).fold(0.0, f32::max);
        if dent > 0.002 {
            break dent;
        }
    };
    println!("{:.3} N, {:.1} mm", felt.force[2], 1e3 * dent);

    page.give_back(hand);
    let connection = Connection::open_surface(&endpoints).unwrap();
    let is_free = || !connection.session().unwrap().tools[0].taken;
    assert!(is_free());
    // A page that ends gives its tools back.
    page.attach("left").unwrap();
    assert!(!is_free());
    drop(page);
    wait_for("the tool to be free", is_free);
}

#[test]
fn of_poses_the_newest_goes_on_and_no_more_than_250_a_second() {
    let endpoints = free_endpoints();
    let _server = Server::start(&endpoints);
    let web = Web::start(&endpoints);
    let mut page = web.page(Rights::Operator).ready();
    let hand = page.attach("left").unwrap();
    page.press(hand, 0.02, 0.02, 10);
    let counters = web.gateway().counters();
    let before = counters.poses_superseded.load(Relaxed);
    for _ in 0..400 {
        page.pose(hand, 0.03);
    }
    let last = page.pose(hand, 0.05);
    // All came within some milliseconds: few were sent, the newest is one of them.
    page.wait("an answer to the newest", |heard| match heard {
        Heard::Wrench(wrench) if wrench.pose_sequence == last => Some(()),
        _ => None,
    });
    assert!(counters.poses_superseded.load(Relaxed) - before > 200, "{counters:?}");
    // Another thousand at once are too many.
    for _ in 0..1500 {
        page.pose(hand, 0.03);
    }
    let reason = page.wait("an end", |heard| match heard {
        Heard::Closed(reason) => Some(reason),
        _ => None,
    });
    assert!(reason.contains("too many messages"), "{reason}");
}

#[test]
fn a_slow_page_gets_few_and_new_frames_and_holds_up_nobody() {
    let endpoints = free_endpoints();
    let _server = Server::start(&endpoints);
    let web = Web::start(&endpoints);
    let mut slow = web.page(Rights::Viewer);
    slow.sees = false;
    let frame = |heard| match heard {
        Heard::Frame(frame) => Some(frame.sequence),
        _ => None,
    };
    let first = slow.wait("a frame", frame);
    let mut quick = web.page(Rights::Operator).ready();
    let hand = quick.attach("left").unwrap();
    // Two seconds, in which the slow one reads nothing and says nothing.
    let (mut frames, mut wrenches) = (0, 0);
    let until = Instant::now() + Duration::from_secs(2);
    while Instant::now() < until {
        match quick.hear() {
            Heard::Frame(_) => frames += 1,
            Heard::Wrench(_) => wrenches += 1,
            _ => {}
        }
        quick.pose(hand, 0.02);
        std::thread::sleep(Duration::from_millis(3));
    }
    assert!(frames > 20 && wrenches > 50, "{frames} frames, {wrenches} wrenches");
    // What had waited for it: four frames in parts, with a key frame each at most. And then, when it sees again, the newest.
    let mut waited = vec![first];
    slow.socket.get_mut().set_read_timeout(Some(Duration::from_millis(200))).unwrap();
    let until = Instant::now() + Duration::from_secs(1);
    while Instant::now() < until {
        waited.extend(frame(slow.hear()));
    }
    waited.dedup();
    assert!((4..=8).contains(&waited.len()), "{waited:?}");
    slow.sees = true;
    slow.send(&[&[SEEN], &waited.iter().max().unwrap().to_le_bytes()[..]].concat());
    let next = slow.wait("a new frame", frame);
    quick.socket.get_mut().set_read_timeout(Some(Duration::from_millis(5))).unwrap();
    let mut newest = 0;
    loop {
        match quick.hear() {
            Heard::Nothing => break,
            heard => newest = frame(heard).unwrap_or(newest),
        }
    }
    println!("{waited:?}, then {next}, newest {newest}");
    // A key frame may come before a frame that needs it.
    assert!(next + 20 > newest && next > waited[waited.len() - 1] + 20, "{waited:?}, {next}, {newest}");
    assert!(web.gateway().counters().frames_missed.load(Relaxed) > 20);
}

#[test]
fn a_server_that_is_killed_and_comes_back_is_found_again() {
    let endpoints = free_endpoints();
    let server = Server::start(&endpoints);
    let web = Web::start(&endpoints);
    let mut page = web.page(Rights::Operator).ready();
    let hand = page.attach("left").unwrap();
    assert!(page.press(hand, 0.02, 0.01, 30).is_some());
    server.kill();
    let (mut lost, mut fault) = (None, None);
    while lost.is_none() || fault.is_none() {
        match page.hear() {
            Heard::Notice(Notice::Lost { tool, .. }) => lost = Some(tool),
            Heard::Notice(Notice::Link { fault: Some(why) }) => fault = Some(why),
            Heard::Closed(reason) => panic!("{reason}"),
            _ => {}
        }
    }
    assert_eq!(lost, Some(hand.0));
    assert_eq!(page.attach("left").unwrap_err(), "the server is not there");

    let _server = Server::start(&endpoints);
    let mut seen = Vec::new();
    page.wait("a frame of the new server", |heard| {
        seen.push(match heard {
            Heard::Notice(Notice::Link { fault: None }) => "link",
            Heard::Session(_) => "session",
            Heard::Topology(_) => "topology",
            Heard::Frame(_) => "frame",
            _ => "",
        });
        seen.ends_with(&["frame"]).then_some(())
    });
    assert!(["link", "session", "topology"].iter().all(|what| seen.contains(what)), "{seen:?}");
    let hand = page.attach("left").unwrap();
    assert!(page.press(hand, 0.02, 0.01, 30).is_some());
}
