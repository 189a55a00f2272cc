//! Pages that send what they should not.

use crate::browser::Page;
use crate::random::{Random, cases};
use crate::{Server, Web, free_endpoints};
use palpate_proto::{ControlRequest, Message as _, ResetBody, ToolPose, control_request::Request};
use palpate_web::Rights;
use palpate_web::message::{CONTROL, POSE, SEEN};
use std::io::{Read, Write};
use std::net::TcpStream;
use std::sync::atomic::Ordering::Relaxed;
use std::time::{Duration, Instant};
use tungstenite::Message;

/// A message that is good, changed in a place or two, or none at all.
fn garbage(random: &mut Random, hand: (u32, u32)) -> Vec<u8> {
    let pose = ToolPose {
        epoch: hand.1,
        sequence: random.bits() as u32,
        position: vec![f32::from_bits(random.bits() as u32), random.between(-0.2, 0.2) as f32, 0.14],
        orientation: vec![0.0, 0.0, f32::from_bits(random.bits() as u32), 1.0],
        ..Default::default()
    };
    let reset = ControlRequest { request: Some(Request::Reset(ResetBody {})) };
    let mut bytes = match random.below(4) {
        0 => [&[POSE, hand.0 as u8], &pose.encode_to_vec()[..]].concat(),
        1 => [&[CONTROL], &reset.encode_to_vec()[..]].concat(),
        2 => [&[SEEN], &random.bits().to_le_bytes()[..]].concat(),
        _ => (0..random.below(3000)).map(|_| random.bits() as u8).collect(),
    };
    for _ in 0..random.below(3) {
        if !bytes.is_empty() {
            let at = random.below(bytes.len());
            bytes[at] = random.bits() as u8;
        }
    }
    bytes.truncate(random.below(bytes.len().max(1) * 4));
    bytes
}

/// Reads what has come until the page is closed or `patience` is over.
fn drain(page: &mut Page, patience: Duration) -> bool {
    page.socket.get_mut().set_read_timeout(Some(Duration::from_millis(20))).unwrap();
    let began = Instant::now();
    while began.elapsed() < patience {
        match page.socket.read() {
            Err(tungstenite::Error::Io(e)) if e.kind() == std::io::ErrorKind::WouldBlock => {}
            Ok(Message::Close(_)) | Err(_) => return true,
            Ok(_) => {}
        }
    }
    false
}

#[test]
fn garbage_is_counted_closes_its_own_page_and_nobody_elses() {
    let endpoints = free_endpoints();
    let _server = Server::start(&endpoints);
    let web = Web::start(&endpoints);
    let mut good = web.page(Rights::Operator).ready();
    let hand = good.attach("right").unwrap();
    let visitor = web.visitor(Rights::Operator);
    let mut closed = 0;
    let seeds = cases(24, 400);
    for seed in 0..seeds {
        let mut random = Random(seed);
        // The tool of the last one comes back in a moment.
        let mut found = None;
        crate::wait_for("a free tool", || {
            let mut page = visitor.page().ready();
            found = page.attach("left").ok().map(|left| (page, left));
            found.is_some()
        });
        let (mut page, left) = found.unwrap_or_else(|| unreachable!("waited for"));
        for _ in 0..60 {
            match random.below(8) {
                0 => drop(page.socket.send(Message::Text("{\"invite\":{\"rights\":\"king\"}}".into()))),
                _ => page.send(&garbage(&mut random, left)),
            }
        }
        closed += u64::from(drain(&mut page, Duration::from_millis(300)));
        // Everything else goes on.
        crate::wait_for("a force", || good.press(hand, 0.02, 0.02, 3).is_some());
    }
    let counters = web.gateway().counters();
    println!("{closed} of {seeds} pages were closed; {counters:?}");
    assert!(closed > seeds / 2 && counters.malformed.load(Relaxed) > 10 * seeds, "{closed}, {counters:?}");
    // Longer than any message of a page.
    let mut page = visitor.page();
    let _ = page.socket.send(Message::Binary(vec![POSE; 1 << 20].into()));
    assert!(drain(&mut page, Duration::from_secs(20)), "a message without end closes the page");
}

#[test]
fn bytes_that_are_no_http_end_their_connection_only() {
    let web = Web::start(&free_endpoints());
    let visitor = web.visitor(Rights::Viewer);
    for seed in 0..cases(40, 1000) {
        let mut random = Random(seed);
        let mut stream = TcpStream::connect(&visitor.host).unwrap();
        stream.set_read_timeout(Some(Duration::from_millis(200))).unwrap();
        let mut bytes: Vec<u8> = (0..random.below(600)).map(|_| random.bits() as u8).collect();
        if random.below(2) == 0 {
            let path: String = (0..random.below(200)).map(|_| (33 + random.below(90)) as u8 as char).collect();
            bytes = format!("GET /{path} HTTP/1.1\r\nHost: {path}\r\nCookie: {path}\r\nOrigin: {path}\r\n\r\n").into();
        }
        let _ = stream.write_all(&bytes);
        let _ = stream.read(&mut [0; 1000]);
    }
    assert_eq!(visitor.get("/who").status, 204);
}

#[test]
fn there_are_no_more_pages_than_there_may_be() {
    let web = Web::start(&free_endpoints());
    let visitor = web.visitor(Rights::Viewer);
    let origin = format!("http://{}", visitor.host);
    let mut pages: Vec<_> = (0..64).map(|_| visitor.page()).collect();
    let one_more = || visitor.socket(Some(&origin), Some(&visitor.cookie));
    assert_eq!(one_more().unwrap_err(), 503);
    drop(pages.pop());
    crate::wait_for("a free seat", || one_more().is_ok());
}
