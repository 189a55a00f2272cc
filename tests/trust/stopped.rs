//! The server stopped mid-press, as by a debugger, a hypervisor or a suspended machine.

use super::hand::{Hand, INSIDE, length};
use super::served::{Served, replayed};
use palpate_sdk::ToolPhase;
use std::process::Command;
use std::time::{Duration, Instant};

/// Presses, and waits until the force has come to rest on a machine that has little time for it; that force [N].
fn pressed(hand: &mut Hand) -> f64 {
    let began = hand.press().tick;
    length(hand.hold_until(INSIDE, "a force at rest", |wrench, _| wrench.tick > began + 500).force)
}

/// Presses, stops the server for `stop`, and goes on to press: what is felt afterwards.
///
/// Who attaches whom again: where the stop is shorter than a second, nobody does, and the server waits for the tool to come
/// from outside. Where it is longer, the client finds its tool gone, as no wrench has come for a second; the two connections
/// may have ended, too, and zenoh opens them again; and the client attaches once the server answers.
fn a_stop_of(stop: Duration) {
    let _alone = super::alone();
    let folder = tempfile::tempdir().unwrap();
    let recording = folder.path().join("stop.mcap");
    let cells = ["--set", "body.cells=[[5,5,5]]", "--record", recording.to_str().unwrap()];
    let mut served = Served::start_with(Command::new(env!("CARGO_BIN_EXE_palpate")), &cells);
    let mut hand = Hand::new(&served.endpoints);
    let before = pressed(&mut hand);

    served.signal("STOP");
    let stopped = Instant::now();
    while stopped.elapsed() < stop {
        let felt = hand.step(INSIDE).map_or(0.0, |(_, force)| force);
        assert!(felt == 0.0 || stopped.elapsed() < Duration::from_millis(500), "{felt} N from a server that stands");
    }
    let (last, holding) = (hand.tick(), hand.attached);
    served.signal("CONT");
    let resumed = Instant::now();
    // The hand stays where it is, inside, until it has been told for half a second that it has to leave.
    let mut since = None;
    hand.hold_until(INSIDE, "half a second of waiting", |wrench, felt| {
        assert_eq!(felt, 0.0, "{:?} after the stop, {wrench:?}", resumed.elapsed());
        let waits = wrench.tick > last && wrench.phase == ToolPhase::Waiting;
        since = if waits { Some(since.unwrap_or(wrench.tick)) } else { None };
        since.is_some_and(|since| wrench.tick >= since + 500)
    });
    let waited = hand.wrenches_after(last);
    let most = waited.iter().map(|wrench| length(wrench.force)).fold(0.0, f64::max);
    assert!(waited.len() >= 100 && most == 0.0, "{most} N in one of {} wrenches after the stop", waited.len());
    println!(
        "stopped for {stop:?} at {before:.2} N: {} wrenches without force, the hand attached {} times more",
        waited.len(),
        hand.attached - holding
    );
    // Outside and in again, it feels as before, and the force begins at zero and grows: no tick brings half of it, however late
    // the machine lets the hand's poses go (a hand that comes at once gets a tenth of it in a tick).
    let last = hand.tick();
    let again = pressed(&mut hand);
    assert!((again / before - 1.0).abs() < 0.25, "{before} N before, {again} N after");
    let steps = hand.wrenches_after(last);
    let steps = steps.windows(2).filter(|pair| pair[1].tick == pair[0].tick + 1);
    let largest = steps.map(|pair| (length(pair[1].force) - length(pair[0].force)).abs()).fold(0.0, f64::max);
    assert!(largest < 0.5 * before, "{largest} N in a tick");

    // The stop is a number among the inputs: what was felt follows from the recording, bit for bit.
    served.signal("TERM");
    assert_eq!(served.code(), Some(0));
    let (code, said) = replayed(&recording, &[]);
    assert!(code == Some(0) && said.contains("identical"), "{said}");
}

#[test]
fn a_hand_inside_the_body_feels_nothing_after_a_stop_of_half_a_second() {
    a_stop_of(Duration::from_millis(500));
}

#[test]
fn a_hand_inside_the_body_feels_nothing_after_a_stop_of_five_seconds() {
    a_stop_of(Duration::from_secs(5));
}

/// With `PALPATE_WHOLE` set: a minute says no more than five seconds to whoever only changed something.
#[test]
fn a_hand_inside_the_body_feels_nothing_after_a_stop_of_a_minute() {
    if std::env::var_os("PALPATE_WHOLE").is_some() {
        a_stop_of(Duration::from_secs(60));
    }
}
