//! What holds when something breaks: the server as a process of its own, and what is done to it.
#![cfg(target_os = "linux")] // signals, and the server itself

mod faults;
#[path = "../common/hand.rs"]
mod hand;
#[path = "../common/random.rs"]
mod random;
#[path = "../common/roads.rs"]
mod roads;
mod roles;
#[path = "../common/secured.rs"]
mod secured;
#[path = "../common/served.rs"]
mod served;
mod sites;
mod stopped;
#[path = "../common/stranger.rs"]
mod stranger;
mod strangers;

use std::sync::{Mutex, MutexGuard, PoisonError};

/// Held by each test that takes the machine or that asks how a hand is served meanwhile: one at a time.
fn alone() -> MutexGuard<'static, ()> {
    static ALONE: Mutex<()> = Mutex::new(());
    ALONE.lock().unwrap_or_else(PoisonError::into_inner)
}
