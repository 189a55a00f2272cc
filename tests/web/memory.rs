//! What many pages cost.
#![cfg(target_os = "linux")] // where a process says how much memory it has

use crate::browser::{Heard, Page, Visitor};
use crate::{Server, free_endpoints};
use std::io::{BufRead, BufReader};
use std::process::{Command, Stdio};
use std::sync::atomic::{AtomicBool, Ordering::Relaxed};
use std::time::{Duration, Instant};

/// Memory of the process `id` that is not swapped out [bytes].
fn resident(id: u32) -> u64 {
    let status = std::fs::read_to_string(format!("/proc/{id}/status")).unwrap();
    let line = status.lines().find_map(|line| line.strip_prefix("VmRSS:")).unwrap();
    1024 * line.trim().strip_suffix(" kB").unwrap().parse::<u64>().unwrap()
}

/// Reads until `done`; how many frames came.
fn watch(mut page: Page, done: &AtomicBool) -> u32 {
    page.socket.get_mut().set_read_timeout(Some(Duration::from_millis(100))).unwrap();
    let mut frames = 0;
    while !done.load(Relaxed) {
        match page.hear() {
            Heard::Frame(_) => frames += 1,
            Heard::Closed(reason) => panic!("{reason}"),
            _ => {}
        }
    }
    frames
}

#[test]
fn fifty_pages_of_which_ten_do_not_read_take_half_a_megabyte_each() {
    const READ: usize = 39;
    const DO_NOT: usize = 10;
    let endpoints = free_endpoints();
    let _server = Server::start(&endpoints);
    let mut child = Command::new(env!("CARGO_BIN_EXE_palpate"))
        .args(["web", "--listen", "127.0.0.1:0"])
        .args(["--force-endpoint", &endpoints.force, "--surface-endpoint", &endpoints.surface])
        .stdin(Stdio::null())
        .stdout(Stdio::piped())
        .spawn()
        .unwrap();
    let mut line = String::new();
    BufReader::new(child.stdout.take().unwrap()).read_line(&mut line).unwrap();
    let (id, _web) = (child.id(), Server(child));
    let visitor = Visitor::enter(line.trim().strip_prefix("to touch: ").unwrap());
    // It presses, so that frames are long.
    let mut hand = visitor.page().ready();
    let tool = hand.attach("left").unwrap();
    hand.press(tool, 0.02, -0.01, 60);
    let before = resident(id);
    let reading: Vec<Page> = (0..READ).map(|_| visitor.page().ready()).collect();
    let _not_reading: Vec<Page> = (0..DO_NOT).map(|_| visitor.page()).collect();
    let done = AtomicBool::new(false);
    let (most, frames) = std::thread::scope(|scope| {
        let threads: Vec<_> = reading.into_iter().map(|page| scope.spawn(|| watch(page, &done))).collect();
        let (began, mut most) = (Instant::now(), 0);
        while began.elapsed() < Duration::from_secs(5) {
            hand.press(tool, -0.01, 0.002, 30);
            hand.press(tool, 0.002, -0.01, 30);
            most = most.max(resident(id));
        }
        done.store(true, Relaxed);
        (most, threads.into_iter().map(|thread| thread.join().unwrap()).collect::<Vec<u32>>())
    });
    let each = (most - before) as f64 / (READ + DO_NOT) as f64;
    println!("{:.1} MB, {:.0} kB a page; {frames:?} frames", most as f64 / 1e6, each / 1e3);
    assert!(each < 0.5e6, "{each} bytes a page");
    assert!(frames.iter().all(|frames| *frames > 10), "who reads gets frames: {frames:?}");
}
