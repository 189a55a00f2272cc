//! The viewer on real recordings, real servers and real displays.
#![cfg(feature = "viewer")]

mod display;
mod live;
mod look;
mod pictures;
#[path = "../common/ports.rs"]
mod ports;
#[path = "../../clients/viewer/tests/interface/screen.rs"]
mod screen;
#[path = "../common/textured_cube.rs"]
mod textured_cube;
