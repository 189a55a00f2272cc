//! Endpoints for servers of a test.

use std::net::TcpListener;
use std::sync::atomic::{AtomicU32, Ordering};

/// Below the ports that systems give to connections which go out (32,768 and up on Linux): one of those may be taken before a server
/// listens on it.
const FIRST: u32 = 10_000;
const PORTS: u32 = 20_000;

/// An endpoint of this machine that nobody listens on, another one each time.
pub fn free_endpoint() -> String {
    static NEXT: AtomicU32 = AtomicU32::new(0);
    // Processes that run side by side begin far from each other.
    let begin = std::process::id().wrapping_mul(7919);
    loop {
        let port = FIRST + begin.wrapping_add(NEXT.fetch_add(1, Ordering::Relaxed)) % PORTS;
        if TcpListener::bind(("127.0.0.1", port as u16)).is_ok() {
            return format!("tcp/127.0.0.1:{port}");
        }
    }
}
