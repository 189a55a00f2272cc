//! Haply's service with an imagined Inverse3 and its grip.

use serde_json::{Value, json};
use std::net::TcpListener;
use std::time::Instant;
use tungstenite::Message;

/// Serves the first that comes to `listener` for `seconds`: after `t` seconds `hand` says how high the hand is [m] and whether it
/// presses the clutch, and `feel` takes the upward force that was commanded [N]. How many messages were exchanged.
pub fn run(
    listener: &TcpListener,
    seconds: f64,
    hand: impl Fn(f64) -> (f64, bool),
    mut feel: impl FnMut(f64, f64),
) -> u32 {
    let mut socket = tungstenite::accept(listener.accept().unwrap().0).unwrap();
    let begun = Instant::now();
    let (mut named, mut messages) = (false, 0);
    let vector = |z: f64| json!({ "x": 0.0, "y": 0.0, "z": z });
    loop {
        let t = begun.elapsed().as_secs_f64();
        let (up, clutch) = hand(t);
        let state = json!({ "cursor_position": vector(up), "cursor_velocity": vector(0.0) });
        // What is as before is left out.
        let grip = if messages % 2 == 0 { json!({ "buttons": { "a": clutch } }) } else { json!({}) };
        let other = json!({ "device_id": "other", "state": { "cursor_position": vector(-1.0) } });
        let devices = json!([{ "device_id": "049D", "state": state }, other]);
        let state = json!({ "inverse3": devices, "wireless_verse_grip": [{ "device_id": "7", "state": grip }] });
        socket.send(Message::text(state.to_string())).unwrap();
        if t > seconds {
            break;
        }
        let answer: Value = serde_json::from_str(socket.read().unwrap().to_text().unwrap()).unwrap();
        messages += 1;
        let device = &answer["inverse3"][0];
        assert_eq!(device["device_id"], "049D");
        named |= answer["session"]["configure"]["profile"]["name"].is_string();
        feel(t, device["commands"]["set_cursor_force"]["vector"]["z"].as_f64().unwrap());
    }
    socket.close(None).unwrap();
    while socket.read().is_ok() {}
    assert!(named);
    messages
}
