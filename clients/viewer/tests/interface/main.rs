//! The viewer from outside: recordings in, panels and input, all without a display.

#[path = "../../../sdk/tests/fake_server/mod.rs"]
mod fake_server;
mod panels;
mod pressed_ball;
mod recordings;
mod screen;
