//! Strangers who reach the ports: what they send, ask and do not read.

use super::hand::{Hand, INSIDE, TOOLS, length};
use super::served::Served;
use super::stranger::{SESSION, asker, asks, forged, stranger};
use palpate_proto::{self as proto, Message, control_request::Request, keys};
use palpate_sdk::{Connection, Endpoints, ToolPhase};
use std::net::TcpStream;
use std::process::Command;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, mpsc};
use std::time::{Duration, Instant};
use zenoh::Wait;

fn serve() -> Served {
    Served::start_with(Command::new(env!("CARGO_BIN_EXE_palpate")), &["--set", "body.cells=[[6,6,6]]"])
}

fn connected(served: &Served) -> Connection {
    let [force, surface] = served.endpoints.clone();
    Connection::open(&Endpoints { force, surface, ..Endpoints::default() }).unwrap()
}

#[test]
fn forged_wrenches_reach_nobody_and_nobody_overhears_a_pose() {
    let _alone = super::alone();
    let served = serve();
    let mut hand = Hand::new(&served.endpoints);
    let pressed = hand.press();
    let sessions = [stranger(&served.endpoints[0]), stranger(&served.endpoints[1])];
    let (heard, hear) = mpsc::channel();
    for session in &sessions {
        for key in ["**".to_owned(), keys::all_tool_poses(SESSION), keys::all_tool_wrenches(SESSION)] {
            let heard = heard.clone();
            let listen = move |sample: zenoh::sample::Sample| {
                let _ = heard.send((sample.key_expr().to_string(), sample.payload().to_bytes().into_owned()));
            };
            session.declare_subscriber(key).callback(listen).background().wait().unwrap();
        }
        let key = keys::all_presence(SESSION);
        let heard = heard.clone();
        let listen = move |sample: zenoh::sample::Sample| drop(heard.send((sample.key_expr().to_string(), vec![])));
        session.liveliness().declare_subscriber(key).history(true).callback(listen).background().wait().unwrap();
    }
    let wrench = (0..).find_map(|_| {
        let (key, bytes) = hear.recv_timeout(Duration::from_secs(60)).unwrap();
        key.ends_with("wrench").then(|| proto::ToolWrench::decode(&bytes[..]).unwrap())
    });
    let (epoch, began) = (wrench.unwrap().epoch, hand.tick());
    let mut sent = 0;
    hand.hold_until(INSIDE, "a second and a half of forgeries", |wrench, _| {
        for sequence in [wrench.sequence + 1, u64::MAX] {
            let bytes = forged(epoch, sequence, wrench.tick + 1);
            for key in [keys::tool_wrench(SESSION, 0), keys::all_tool_wrenches(SESSION), "palpate/**".into()] {
                for session in &sessions {
                    session.put(key.clone(), bytes.clone()).wait().unwrap();
                    sent += 1;
                }
            }
        }
        wrench.tick > began + 1500
    });
    let wrenches = hand.wrenches_after(began);
    let sideways = wrenches.iter().map(|wrench| wrench.force[0].abs()).fold(0.0, f64::max);
    println!("{sent} forgeries: {sideways} N sideways in {} wrenches of 1500 ticks", wrenches.len());
    assert!(sideways < 0.1 && wrenches.len() > 1000, "{sideways} N, {} wrenches", wrenches.len());
    assert_eq!((hand.attached, length(pressed.force) > 0.1), (1, true));
    let all: Vec<String> = hear.try_iter().map(|heard| heard.0).collect();
    let private: Vec<_> = all.iter().filter(|key| key.contains("pose") || key.contains("presence")).collect();
    assert!(all.len() > 100 && private.is_empty(), "{} heard, {private:?}", all.len());
}

#[test]
fn nobody_answers_in_the_server_s_place_or_frees_the_tool_of_another() {
    let _alone = super::alone();
    let served = serve();
    let mut hand = Hand::new(&served.endpoints);
    hand.press();
    let session = stranger(&served.endpoints[1]);
    let asked = Arc::new(AtomicU64::new(0));
    for key in [keys::session_of_any_version(SESSION), keys::all_control(SESSION), "palpate/**".into()] {
        let asked = asked.clone();
        let lie = move |query: zenoh::query::Query| {
            asked.fetch_add(1, Ordering::Relaxed);
            let _ = query.reply(query.key_expr().clone(), Vec::new()).wait();
        };
        session.declare_queryable(key).complete(true).callback(lie).background().wait().unwrap();
    }
    let connection = connected(&served);
    for _ in 0..20 {
        assert_eq!(connection.session().unwrap().tools.len(), 1);
        hand.step(INSIDE);
    }
    // The epoch stands in every wrench; the secret does not.
    let epoch = hand.epoch();
    for secret in [0, 1, u64::MAX] {
        let e = connection.control(Request::Detach(proto::Detach { tool: 0, epoch, secret })).unwrap_err().to_string();
        assert!(e.contains("not held"), "{e}");
    }
    let force = stranger(&served.endpoints[0]);
    let began = hand.tick();
    hand.hold_until(INSIDE, "half a second of forged poses", |wrench, _| {
        let pose = proto::ToolPose {
            epoch,
            sequence: wrench.pose_sequence + 50,
            position: vec![0.05, 0.05, 0.3],
            orientation: vec![0.0, 0.0, 0.0, 1.0],
            ..Default::default()
        };
        force.put(keys::tool_pose(SESSION, 0), pose.encode_to_vec()).wait().unwrap();
        assert!(wrench.position[2] < 0.13, "{wrench:?}");
        wrench.tick > began + 500
    });
    assert_eq!((asked.load(Ordering::Relaxed), hand.attached), (0, 1));
}

#[test]
fn a_hand_whose_pose_numbers_jumped_is_followed_again() {
    let _alone = super::alone();
    let served = serve();
    let connection = connected(&served);
    let attach = proto::Attach { client: "damaged".into(), rate_hz: 1000.0, ..Default::default() };
    let reply = connection.control(Request::Attach(attach)).unwrap();
    let proto::Attached { epoch, secret, .. } = reply.attached.unwrap();
    let session = stranger(&served.endpoints[0]);
    let answered = Arc::new(AtomicU64::new(0));
    let newest = answered.clone();
    let listen = move |sample: zenoh::sample::Sample| {
        let wrench = proto::ToolWrench::decode(&*sample.payload().to_bytes()).unwrap();
        newest.store(wrench.pose_sequence.into(), Ordering::Relaxed);
    };
    session.declare_subscriber(keys::tool_wrench(SESSION, 0)).callback(listen).background().wait().unwrap();
    let send = |sequence: u32| {
        let (position, orientation) = (vec![0.05, 0.05, 0.14], vec![0.0, 0.0, 0.0, 1.0]);
        let pose = proto::ToolPose { epoch, secret, sequence, position, orientation, ..Default::default() };
        session.put(keys::tool_pose(SESSION, 0), pose.encode_to_vec()).wait().unwrap();
        std::thread::sleep(Duration::from_millis(1));
    };
    let until = |from: u32, likes: &dyn Fn(u64) -> bool| {
        let mut sequences = from..from + 60_000;
        let reached = sequences.find(|sequence| {
            send(*sequence);
            likes(answered.load(Ordering::Relaxed))
        });
        reached.expect("an answer")
    };
    let last = until(1, &|answered| answered > 20);
    let wrong = last + (1 << 31) - 16;
    send(wrong);
    let back = until(last + 1, &|answered| answered > u64::from(last) && answered < u64::from(wrong));
    println!("followed again after {} poses", back - last);
}

#[test]
fn a_client_that_floods_the_server_with_poses_loses_its_tool_and_the_hand_beside_it_feels_on() {
    let _alone = super::alone();
    let served = Served::start_with(Command::new(env!("CARGO_BIN_EXE_palpate")), &["--set", TOOLS]);
    let mut hand = Hand::with("left", [0.03, 0.05], &served.endpoints);
    hand.press();
    let connection = connected(&served);
    let attach = proto::Attach { client: "broken".into(), tool: "right".into(), rate_hz: 1000.0, ..Default::default() };
    let proto::Attached { tool, epoch, secret } =
        connection.control(Request::Attach(attach)).unwrap().attached.unwrap();
    let is_taken = || connection.session().unwrap().tools[tool as usize].taken;
    assert!(is_taken());
    let stop = Arc::new(AtomicU64::new(0));
    let (stopped, session) = (stop.clone(), stranger(&served.endpoints[0]));
    let flood = std::thread::spawn(move || {
        let mut poses = (1..u32::MAX).take_while(|_| stopped.load(Ordering::Relaxed) == 0);
        let sent = poses.by_ref().map(|sequence| {
            let (position, orientation) = (vec![0.07, 0.05, 0.2], vec![0.0, 0.0, 0.0, 1.0]);
            let pose = proto::ToolPose { epoch, secret, sequence, position, orientation, ..Default::default() };
            session.put(keys::tool_pose(SESSION, tool), pose.encode_to_vec()).wait().unwrap();
        });
        sent.count()
    });
    // A look at the session now and then: a query in each step would be what holds the hand up.
    let (began, first, mut lost) = (Instant::now(), hand.tick(), 0);
    let mut looked = began;
    hand.hold_until(INSIDE, "the tool of the flood to be free", |wrench, _| {
        lost += u64::from(wrench.phase != ToolPhase::Engaged);
        looked.elapsed() > Duration::from_millis(500) && {
            looked = Instant::now();
            !is_taken()
        }
    });
    stop.store(1, Ordering::Relaxed);
    let (sent, time) = (flood.join().unwrap(), began.elapsed().as_secs_f64());
    let ticks = hand.tick() - first;
    let had = hand.wrenches_after(first).len();
    println!(
        "free after {time:.1} s of {:.0} poses a second; the hand had {had} wrenches in {ticks} ticks",
        sent as f64 / time
    );
    hand.press();
    assert_eq!(hand.attached, 1);
    Hand::with("right", [0.07, 0.05], &served.endpoints).press();
}

/// Threads of the process, and its memory [MB].
fn size(served: &Served) -> (u64, u64) {
    let status = std::fs::read_to_string(format!("/proc/{}/status", served.id())).unwrap();
    let number = |name: &str| -> u64 {
        let line = status.lines().find(|line| line.starts_with(name)).unwrap();
        line.split_whitespace().nth(1).unwrap().parse().unwrap()
    };
    (number("Threads:"), number("VmRSS:") / 1000)
}

#[test]
fn thousands_of_questions_whose_answers_nobody_reads_part_no_hand_from_the_body_and_take_little_memory() {
    if asks() {
        return;
    }
    let _alone = super::alone();
    let served = serve();
    let mut hand = Hand::new(&served.endpoints);
    hand.press();
    let press = |hand: &mut Hand, ticks: u64, seen: &mut dyn FnMut()| {
        let (began, mut lost) = (hand.tick(), 0);
        hand.hold_until(INSIDE, "some seconds of pressing", |wrench, _| {
            // Held while the machine kept the hand's own poses is not parted.
            lost += u64::from(matches!(wrench.phase, ToolPhase::Detached | ToolPhase::Waiting));
            seen();
            wrench.tick > began + ticks
        });
        (hand.wrenches_after(began).len(), lost)
    };
    let quiet = press(&mut hand, 2000, &mut || ());
    let before = size(&served);
    let mut asker = asker(
        &served.endpoints[1],
        "strangers::thousands_of_questions_whose_answers_nobody_reads_part_no_hand_from_the_body_and_take_little_memory",
    );
    let (mut most, mut looked) = (before, Instant::now());
    let loud = press(&mut hand, 4000, &mut || {
        if looked.elapsed() > Duration::from_millis(100) {
            looked = Instant::now();
            let now = size(&served);
            most = (most.0.max(now.0), most.1.max(now.1));
        }
    });
    // Others are answered meanwhile.
    assert_eq!(connected(&served).session().unwrap().tools.len(), 1);
    asker.kill().unwrap();
    asker.wait().unwrap();
    println!("{quiet:?} wrenches, and looks without contact, in 2000 ticks; {loud:?} in 4000 with an asker");
    println!("{before:?} → {most:?} threads, MB");
    assert!(loud.0 * 10 > 2 * quiet.0 * 8 && loud.1 == 0 && hand.attached == 1, "{quiet:?}, {loud:?}");
    assert!(most.0 < before.0 + 120 && most.1 < before.1 + 100, "{before:?} → {most:?} threads, MB");
}

#[test]
fn connections_that_say_nothing_and_messages_of_megabytes_keep_nobody_out() {
    let _alone = super::alone();
    let served = serve();
    let mut hand = Hand::new(&served.endpoints);
    hand.press();
    let address = |i: usize| served.endpoints[i].strip_prefix("tcp/").unwrap().to_owned();
    let idle: Vec<TcpStream> = (0..600).filter_map(|i| TcpStream::connect(address(i % 2)).ok()).collect();
    let asked = Instant::now();
    let connection = connected(&served);
    assert_eq!(connection.session().unwrap().tools.len(), 1);
    println!("{} idle connections: a client is answered after {:?}", idle.len(), asked.elapsed());
    let big = stranger(&served.endpoints[0]);
    let began = hand.tick();
    hand.hold_until(INSIDE, "half a second of large messages", |wrench, _| {
        if wrench.tick % 50 == 0 {
            let _ = big.put(keys::tool_pose(SESSION, 0), vec![0xff; 2_000_000]).wait();
        }
        wrench.tick > began + 500
    });
    assert_eq!(hand.attached, 1);
}
