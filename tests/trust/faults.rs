//! Faults show: in the status, in the exit code, in the recording and in what replay says of it.

use super::hand::{Hand, INSIDE};
use super::served::{Served, replayed};
use palpate_proto::{self as proto, control_request::Request};
use palpate_sdk::{Connection, Endpoints};
use std::io::{Read, Write};
use std::net::{TcpListener, TcpStream};
use std::path::Path;
use std::process::Command;
use std::sync::mpsc;
use std::time::{Duration, Instant};

const PROGRAM: &str = env!("CARGO_BIN_EXE_palpate");
/// A body that starts at once.
const ONE_LEVEL: [&str; 2] = ["--set", "body.cells=[[5,5,5]]"];

fn connected(served: &Served) -> Connection {
    let [force, surface] = served.endpoints.clone();
    Connection::open(&Endpoints { force, surface, ..Endpoints::default() }).unwrap()
}

/// The first status that `wanted` likes.
fn status(connection: &Connection, wanted: impl Fn(&proto::Status) -> bool) -> proto::Status {
    let (told, tell) = mpsc::channel();
    let _watched = connection.subscribe_status(move |status| drop(told.send(status))).unwrap();
    let began = Instant::now();
    loop {
        let status = tell.recv_timeout(Duration::from_secs(60)).expect("a status each second");
        if wanted(&status) {
            return status;
        }
        assert!(began.elapsed() < Duration::from_secs(60), "waited in vain: {status:?}");
    }
}

/// Of "ended early, after tick N": N.
fn last_tick(said: &str) -> u64 {
    let at = said.split("after tick ").nth(1).unwrap_or_else(|| panic!("{said}"));
    at.split(':').next().unwrap().parse().unwrap()
}

#[test]
fn a_closed_terminal_ends_a_server_with_its_recording_whole_and_another_exit_code() {
    let folder = tempfile::tempdir().unwrap();
    for (signal, code) in [("HUP", 129), ("TERM", 0), ("INT", 0)] {
        let recording = folder.path().join(format!("{signal}.mcap"));
        let more = [&ONE_LEVEL[..], &["--record", recording.to_str().unwrap()]].concat();
        let mut served = Served::start_with(Command::new(PROGRAM), &more);
        served.signal(signal);
        assert_eq!(served.code(), Some(code), "{signal}");
        let (code, said) = replayed(&recording, &[]);
        assert!(code == Some(0) && said.contains("identical"), "{signal}: {said}");
    }
}

#[test]
fn what_a_killed_server_recorded_is_there_to_the_last_second_and_replay_says_that_it_ended_early() {
    let folder = tempfile::tempdir().unwrap();
    let recording = folder.path().join("killed.mcap");
    let more = [&ONE_LEVEL[..], &["--record", recording.to_str().unwrap()]].concat();
    let mut served = Served::start_with(Command::new(PROGRAM), &more);
    let mut hand = Hand::new(&served.endpoints);
    let pressed = hand.press().tick;
    hand.hold_until(INSIDE, "three seconds of pressing", |wrench, _| wrench.tick > pressed + 3000);
    let last = hand.tick();
    served.signal("KILL");
    assert_eq!(served.code(), None);
    let (code, said) = replayed(&recording, &[]);
    assert!(code == Some(3) && said.contains("identical") && said.contains("ended early"), "{said}");
    let recorded = last_tick(&said);
    println!("killed after tick {last}: recorded up to {recorded}");
    assert!(recorded + 1000 >= last, "tick {recorded} of {last}");
}

#[test]
fn a_recording_of_which_a_byte_changed_or_that_was_cut_is_never_said_to_be_what_it_was() {
    let folder = tempfile::tempdir().unwrap();
    let (recording, damaged) = (folder.path().join("whole.mcap"), folder.path().join("damaged.mcap"));
    let more = [&ONE_LEVEL[..], &["--record", recording.to_str().unwrap()]].concat();
    let mut served = Served::start_with(Command::new(PROGRAM), &more);
    let mut hand = Hand::new(&served.endpoints);
    let pressed = hand.press().tick;
    hand.hold_until(INSIDE, "three seconds of pressing", |wrench, _| wrench.tick > pressed + 3000);
    served.signal("TERM");
    assert_eq!(served.code(), Some(0));
    let portable = ["--kernel", "portable"];
    assert_eq!(replayed(&recording, &portable).0, Some(0));
    let whole = std::fs::read(&recording).unwrap();
    // Records of a byte that tells the kind, eight for the length, and content. Between chunks stand indices, which replay does not
    // need.
    let (mut chunks, mut at) = (Vec::new(), mcap::MAGIC.len());
    while at + mcap::MAGIC.len() < whole.len() {
        let length = u64::from_le_bytes(whole[at + 1..at + 9].try_into().unwrap()) as usize;
        chunks.extend((whole[at] == mcap::records::op::CHUNK).then_some(at));
        at += 9 + length;
    }
    assert!(chunks.len() > 3, "{} chunks", chunks.len());
    for chunk in [chunks[1], chunks[chunks.len() - 1]] {
        // Far enough into the chunk to be among its messages.
        let at = chunk + 1000;
        let mut changed = whole.clone();
        changed[at] ^= 0x55;
        for bytes in [&changed[..], &whole[..at]] {
            std::fs::write(&damaged, bytes).unwrap();
            let (code, said) = replayed(&damaged, &portable);
            assert!(matches!(code, Some(1 | 3)), "byte {at} of {}: {code:?}, {said}", whole.len());
        }
    }
}

/// Presses until the recording has ended early for `why`, and some more; then the server ends, degraded.
fn ends_early(mut served: Served, why: &str) {
    let connection = connected(&served);
    assert_eq!(status(&connection, |_| true).health(), proto::Health::Serving);
    let mut hand = Hand::new(&served.endpoints);
    hand.press();
    let began = Instant::now();
    let (told, tell) = mpsc::channel();
    let watched = connection.subscribe_status(move |status| drop(told.send(status))).unwrap();
    let status = loop {
        hand.step(INSIDE);
        match tell.try_recv() {
            Ok(status) if status.health() == proto::Health::Degraded => break status,
            _ => assert!(began.elapsed() < Duration::from_secs(60), "the recording goes on"),
        }
    };
    drop(watched);
    let fault = status.faults.join(", ");
    assert!(fault.contains("ended early") && fault.contains(why), "{fault}");
    assert_eq!(status.recording.map(|recording| recording.fault.contains(why)), Some(true), "{fault}");
    // Hands are served as before.
    hand.press();
    served.signal("TERM");
    assert_eq!(served.code(), Some(3));
}

#[test]
fn a_file_that_may_not_grow_ends_the_recording_and_not_the_server() {
    let folder = tempfile::tempdir().unwrap();
    let recording = folder.path().join("limited.mcap");
    let mut limited = Command::new("sh");
    // In blocks of 512 bytes: a megabyte.
    limited.args(["-c", &format!("ulimit -f 2048; exec {PROGRAM} \"$@\""), "sh"]);
    let more = [&ONE_LEVEL[..], &["--record", recording.to_str().unwrap()]].concat();
    ends_early(Served::start_with(limited, &more), "too large");
    let (code, said) = replayed(&recording, &[]);
    assert!(code == Some(3) && said.contains("ended early") && said.contains("identical"), "{said}");
}

#[test]
fn a_recording_ends_before_the_disk_is_full_and_says_so_itself() {
    let folder = tempfile::tempdir().unwrap();
    let (disk, kept) = (folder.path().join("disk"), folder.path().join("kept.mcap"));
    std::fs::create_dir(&disk).unwrap();
    let mount = format!("mount -t tmpfs -o size=63200k none {}", disk.display());
    if !Command::new("unshare").args(["-rm", "sh", "-c", &mount]).status().is_ok_and(|status| status.success()) {
        println!("skipped: nothing may be mounted here");
        return;
    }
    let recording = disk.join("full.mcap");
    let mut small = Command::new("unshare");
    let (from, to) = (recording.display(), kept.display());
    // The signal reaches the server, which the shell waits for.
    let script = format!(
        "{mount}; exec 3<&0; {PROGRAM} \"$@\" <&3 & server=$!; trap 'kill $server' TERM; wait $server; wait $server; code=$?; cp {from} {to}; exit $code"
    );
    small.args(["-rm", "sh", "-c", &script, "sh"]);
    let more = [&ONE_LEVEL[..], &["--record", recording.to_str().unwrap()]].concat();
    ends_early(Served::start_with(small, &more), "nearly full");
    let (code, said) = replayed(&kept, &[]);
    assert!(code == Some(3) && said.contains("nearly full") && said.contains("identical"), "{said}");
}

#[test]
fn recordings_take_the_place_of_nothing_and_follow_no_link() {
    let folder = tempfile::tempdir().unwrap();
    let recordings = folder.path().join("recordings");
    std::fs::create_dir(&recordings).unwrap();
    std::fs::write(recordings.join("old.mcap"), "precious").unwrap();
    let outside = folder.path().join("outside.mcap");
    std::os::unix::fs::symlink(&outside, recordings.join("link.mcap")).unwrap();
    let more = [&ONE_LEVEL[..], &["--recordings", recordings.to_str().unwrap()]].concat();
    let mut served = Served::start_with(Command::new(PROGRAM), &more);
    let connection = connected(&served);
    let record = |name: &str| {
        let start = Request::StartRecording(proto::StartRecording { path: name.into() });
        connection.control(start)
    };
    let long = "x".repeat(50_000);
    for (name, word) in [
        ("old.mcap", "exists"),
        ("link.mcap", "exists"),
        ("a/b.mcap", "name of a new file"),
        ("..", "name of a new file"),
        ("", "name of a new file"),
        (".hidden", "name of a new file"),
        ("new\nline.mcap", "name of a new file"),
        (long.as_str(), "name of a new file"),
    ] {
        let e = record(name).unwrap_err().to_string();
        assert!(e.contains(word) && e.len() < 400, "{name:.20}: {e:.400}");
    }
    let stop = || connection.control(Request::StopRecording(proto::StopRecording {}));
    assert!(stop().unwrap_err().to_string().contains("no recording"), "none of them runs");
    record("new.mcap").unwrap();
    stop().unwrap();
    let names: Vec<_> = std::fs::read_dir(&recordings).unwrap().map(|entry| entry.unwrap().file_name()).collect();
    assert_eq!(names.len(), 3, "{names:?}");
    assert_eq!(std::fs::read(recordings.join("old.mcap")).unwrap(), b"precious");
    assert!(!outside.exists());
    served.signal("TERM");
    assert_eq!(served.code(), Some(0), "a refusal is no fault of the server");
    assert_eq!(replayed(&recordings.join("new.mcap"), &[]).0, Some(0));
}

/// What the page of metrics says.
fn metrics(address: &str) -> String {
    let mut page = TcpStream::connect(address).unwrap();
    page.write_all(b"GET /metrics HTTP/1.1\r\nHost: a\r\nConnection: close\r\n\r\n").unwrap();
    let mut text = String::new();
    page.read_to_string(&mut text).unwrap();
    text
}

#[test]
fn what_is_counted_stands_on_a_page_for_prometheus() {
    let free = TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap().to_string();
    let more = [&ONE_LEVEL[..], &["--metrics", &free]].concat();
    let served = Served::start_with(Command::new(PROGRAM), &more);
    let mut hand = Hand::new(&served.endpoints);
    let pressed = hand.press().tick;
    hand.hold_until(INSIDE, "two seconds of pressing", |wrench, _| wrench.tick > pressed + 2000);
    let page = metrics(&free);
    let value = |name: &str| -> f64 {
        let line = page.lines().find(|line| line.strip_prefix(name).is_some_and(|rest| rest.starts_with(' ')));
        line.unwrap_or_else(|| panic!("no {name}: {page}")).rsplit(' ').next().unwrap().parse().unwrap()
    };
    println!("{page}");
    assert!(value("palpate_ticks_total") > 1000.0 && value("palpate_wrenches_sent_total") > 500.0);
    assert!(value("palpate_tick_compute_seconds_count") > 1000.0);
    assert!(value("palpate_tick_lateness_seconds_bucket{le=\"+Inf\"}") > 1000.0);
    assert_eq!(value("palpate_health{state=\"serving\"}"), 1.0);
    assert_eq!((value("palpate_tools_held"), value("palpate_active_nodes{level=\"0\"}")), (1.0, 216.0));
    assert!(value("palpate_pose_age_seconds{tool=\"ball\"}") < 10.0);
    assert!(!page.contains("hand"), "no client's name");
}

#[test]
fn the_log_is_json_where_a_program_reads_it() {
    let folder = tempfile::tempdir().unwrap();
    let mut serve = Command::new(PROGRAM);
    serve.args(["serve", "--scene", "cube", "--seconds", "0.5", "--log", "json", "--record", "a.mcap"]).args(ONE_LEVEL);
    let ports: Vec<TcpListener> = (0..2).map(|_| TcpListener::bind("127.0.0.1:0").unwrap()).collect();
    let at = |i: usize| format!("tcp/{}", ports[i].local_addr().unwrap());
    serve.args(["--force-endpoint", &at(0), "--surface-endpoint", &at(1)]).current_dir(folder.path());
    drop(ports);
    let said = serve.output().unwrap();
    let said = String::from_utf8_lossy(&said.stderr);
    let lines = said.lines().filter(|line| line.starts_with('{'));
    let lines: Vec<serde_json::Value> = lines.map(|line| serde_json::from_str(line).unwrap()).collect();
    let event = |message: &str| lines.iter().find(|line| line["fields"]["message"] == message);
    let (begun, ended) = (event("recording"), event("recorded"));
    assert!(begun.is_some_and(|line| line["fields"]["path"] == "a.mcap" && line["level"] == "INFO"), "{said}");
    assert!(ended.is_some_and(|line| line["fields"]["ticks"].as_u64() > Some(100)), "{said}");
    assert!(Path::new(&folder.path().join("a.mcap")).exists());
}
